"""The tensor of a posture under a connection: matrix, inverse, wrench, frame and units together."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from cartstiff.geometry.connections import BI_INVARIANT, Connection
from cartstiff.geometry.se3 import Array
from cartstiff.stiffness.tensor import StiffnessTensor

if TYPE_CHECKING:
    from cartstiff.stiffness.posture import PostureStiffness


def named_tensor(
    result: PostureStiffness, K: Array, W: Array, connection: str | Connection
) -> StiffnessTensor:
    """The tensor under a connection, from K^B (6, 6) and the wrench W (6,), with its own inverse.

    Raises
    ------
    UndefinedError
        For K^F where it does not exist.
    """
    pose, frame, units = result.pose, result.frame, result.units
    compliances = result.compliances
    C = compliances.get(connection if isinstance(connection, str) else connection.name)
    if connection == "+" and compliances["A"] is not None:
        C = compliances["A"].T
    T_F_B = result.elastic.mechanism.base_pose
    bi_invariant = StiffnessTensor(
        K, BI_INVARIANT, W, pose, frame, units, inverse=compliances["B"], base=T_F_B
    )
    if connection == "B":
        return bi_invariant
    if connection == "F":
        flat, F = result.flat_connection(), result.matrices["F"]
        assert F is not None  # else there is no flat connection
        return StiffnessTensor(F, flat, W, pose, frame, units, inverse=C, base=T_F_B)
    other = result.load.connection if connection == "load" else connection
    moved = bi_invariant.to_connection(other)
    return moved if C is None or not isinstance(connection, str) else replace(moved, inverse=C)
