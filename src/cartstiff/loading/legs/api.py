"""Parallel machines in Python: the same keys as in a mechanism file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.arrays import checked_pose, checked_vector
from cartstiff.geometry import se3
from cartstiff.loading import from_data, plain
from cartstiff.mechanisms.elastic import ElasticMechanism


def parallel(
    legs: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    pose: ArrayLike | None = None,
    *,
    name: str = "parallel",
    **keys: Any,
) -> ElasticMechanism:
    """A body carried by several legs, from the keys of a mechanism file of ``kind: parallel``.

    Parameters
    ----------
    legs : mapping or sequence of mappings
        Legs by name, such as ``{"chain": "PUS", "base": {"radius": 0.3, "half_angle": 0.2}, ...}``,
        chains of a robot description, or a list of both.
    pose : array_like (4, 4) or (6,), optional
        ``T_F_P`` where the legs are put together: the pose, or x, y, z, roll, pitch, yaw about
        fixed axes (lengths, rad). Legs by name need it.
    name : str
        For people.
    **keys
        Any other key of the file: gravity, payload, actuated, lines, source, ...

    Returns
    -------
    ElasticMechanism
        As `cartstiff.load` gives it.

    Raises
    ------
    InputError
        For what is wrong, with its key.

    Examples
    --------
    >>> import cartstiff
    >>> legs = {
    ...     "chain": "PUS", "rail": "vertical", "rod": 0.5, "stiffness": 2e7,
    ...     "base": {"radius": 0.35, "half_angle": 0.2},
    ...     "platform": {"radius": 0.15, "half_angle": 0.2},
    ... }
    >>> machine = cartstiff.parallel(legs, [0, 0, 0.55, 0, 0, 0])
    >>> round(cartstiff.analyse(machine).K.matrix[5, 5])
    120000000
    """
    data = {"kind": "parallel", "name": name, "legs": plain(legs)}
    data |= {key: plain(value) for key, value in keys.items()}
    if pose is not None:
        numbers = _numbers(pose)
        data["pose"] = {"xyz": numbers[:3], "rpy": numbers[3:]}
    return from_data(data, {}, Path(name), {})


def _numbers(pose: ArrayLike) -> list[float]:
    if np.shape(pose) == (4, 4):
        T = checked_pose(pose, "pose")
        return [*T[:3, 3].tolist(), *se3.roll_pitch_yaw(T).tolist()]
    return list(checked_vector(pose, 6, "pose").tolist())
