"""Limits of legs, from the mechanism file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.platform import LegLimits

if TYPE_CHECKING:
    from cartstiff.loading.keys.bodies import LegJointsModel
    from cartstiff.loading.schema import PlatformFile, SpringsFile


def leg_limits_of(file: PlatformFile | SpringsFile, T_P_M: Array, where: str) -> LegLimits | None:
    """Limits of joint angles, distances and forces; None without any.

    Raises
    ------
    InputError
        For counts that differ from that of the legs, axes without a direction, and force limits
        the wrong way round.
    """
    legs, m = file.legs, len(file.base)
    base_axes, base_angles = _joints(legs.base_joints, m, f"{where}, key legs.base_joints")
    axes, angles = _joints(legs.platform_joints, m, f"{where}, key legs.platform_joints")
    diameters = None
    if legs.diameter is not None:
        diameters = _each(legs.diameter, m, f"{where}, key legs.diameter")
    place = f"{where}, key legs.force"
    forces = pair_per_leg(legs.force, m, place, "[least, largest]")
    if forces is not None and np.any(forces[:, 1] < 0.0) and getattr(file, "unilateral", False):
        raise InputError("cables cannot push", where=place, expected="0 or more", got=legs.force)
    if all(part is None for part in (base_axes, axes, diameters, forces)):
        return None
    in_body = None if axes is None else axes @ T_P_M[:3, :3]
    return LegLimits(base_axes, base_angles, in_body, angles, diameters, forces)


def pair_per_leg(value: Any, m: int, where: str, meaning: str) -> Array | None:
    """Limits (m, 2) from one pair for all legs or one each; None without any.

    Raises
    ------
    InputError
        For another number of pairs than legs, and for a pair the wrong way round.
    """
    if value is None:
        return None
    numbers = np.array(value, float)
    pairs = np.broadcast_to(numbers, (m, 2)) if numbers.ndim == 1 else numbers
    if len(pairs) != m:
        raise InputError(
            "wrong count", where=where, expected=f"{m} pairs, one per leg", got=len(pairs)
        )
    for i in np.flatnonzero(pairs[:, 0] > pairs[:, 1])[:1]:
        raise InputError(
            "limits are the wrong way round",
            where=f"{where}.{i + 1}",
            expected=meaning,
            got=pairs[i].tolist(),
        )
    return pairs


def _each(value: Any, m: int, where: str) -> Array:
    values = np.asarray(value, float)
    if values.ndim == 1 and len(values) != m:
        raise InputError(
            "wrong count", where=where, expected=f"{m} numbers, one per leg", got=len(values)
        )
    return np.broadcast_to(values, (m,)).copy()


def _joints(model: LegJointsModel | None, m: int, where: str) -> tuple[Array | None, Array | None]:
    """Unit axes (m, 3) and largest angles (m,)."""
    if model is None:
        return None, None
    axes = np.array(model.axis, float)
    if axes.ndim == 2 and len(axes) != m:
        raise InputError(
            "wrong count", where=f"{where}.axis", expected=f"{m} axes, one per leg", got=len(axes)
        )
    axes = np.broadcast_to(axes, (m, 3))
    sizes = np.linalg.norm(axes, axis=1)
    if not sizes.min() > 0.0:
        raise InputError("an axis has no direction", where=f"{where}.axis", got=model.axis)
    return axes / sizes[:, None], _each(model.angle, m, f"{where}.angle")
