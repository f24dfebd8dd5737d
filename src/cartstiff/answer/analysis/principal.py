"""Principal values of a posture's stiffness and compliance in a frame of its body."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from cartstiff.answer.analysis.ellipsoids import (
    Ellipsoid,
    Freedom,
    MatrixPair,
    Others,
    Quantity,
    is_direct,
)
from cartstiff.core.stiffness.posture import StiffnessInFrame


def block_ellipsoid(
    here: StiffnessInFrame,
    connection: str,
    quantity: Quantity,
    freedom: Freedom,
    others: Literal["block", "free", "held"],
) -> Ellipsoid | None:
    """Ellipsoid of a 3x3 block, or with the other freedoms free or held;
    None without a matrix.

    Each value comes from the matrix, stiffness or compliance, that has more correct
    digits.

    Raises
    ------
    UndefinedError
        See `cartstiff.answer.analysis.ellipsoids`.
    """
    if others == "block":
        others = "held" if is_direct(quantity, "held") else "free"
    return matrix_pair(here, connection, others).ellipsoid(freedom, others, quantity)


@lru_cache(maxsize=32)
def matrix_pair(
    here: StiffnessInFrame, connection: str, others: Others = "held"
) -> MatrixPair:
    """The matrices of a connection that the other freedoms, held or free, need:
    the same unless they are asymmetric.
    """
    K, own = here.matrices[connection], here.compliances[connection]
    if others == "held" or K is None or own is None:
        return MatrixPair(*here.pair(connection, others))
    held = matrix_pair(here, connection)
    if held.C is not None and own.tolist() == held.C.tolist():
        return held
    return MatrixPair(lambda: here.pair(connection, others)[0], 0.5 * (own + own.T))
