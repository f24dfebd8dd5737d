"""What mechanism files say of platforms: a base and a body that give, and limits of legs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.key_types import pose_of
from cartstiff.mechanisms.platform import LegLimits
from cartstiff.potentials.flexure_struts import Flexure, FlexureStruts
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.mounted_struts import Mount, MountedStruts

if TYPE_CHECKING:
    from cartstiff.loading.schema import FlexibleModel, LegJointsModel, PlatformFile, SpringsFile


def on_springs(
    springs: LineSprings, file: PlatformFile | SpringsFile, T_F_M: Array, where: str
) -> MountedStruts:
    """The legs between what the file's `flexible` says of base and platform.

    Raises
    ------
    InputError
        For cables, and for springs that are not symmetric and positive definite, are beams, or have
        a mass.
    """
    where = f"{where}, key flexible"
    if springs.unilateral:
        raise InputError(
            "cables hang from what does not give", where=where, expected="no key flexible"
        )
    if not isinstance(springs, FlexureStruts):
        ball = Flexure(math.inf, math.inf, 0.0, 0.0)
        springs = FlexureStruts.between(
            springs.anchors,
            springs.points,
            T_F_M,
            springs.stiffness,
            ball,
            ball._replace(torsion=math.inf),
            springs.rest_length,
        )
    to_body = se3.inverse(pose_of(file.frame))
    base = _mount(file.flexible.get("base"), np.eye(4), f"{where}.base")
    tip = _mount(file.flexible.get("platform"), to_body, f"{where}.platform")
    return MountedStruts.of(springs, base, tip)


def _mount(entry: FlexibleModel | None, T: Array, where: str) -> Mount | None:
    """A spring, its place moved by T; None where nothing gives."""
    if entry is None:
        return None
    if entry.stiffness is None or entry.mass is not None:
        got = "a beam" if entry.stiffness is None else "a superelement with M"
        raise InputError(
            "base and platform give as a spring without mass",
            where=where,
            expected="stiffness, or superelement without M",
            got=got,
        )
    K = np.array(entry.stiffness, float)
    sizes = np.sqrt(np.abs(np.diag(K)))
    if np.any(np.abs(K - K.T) > numerics.SYMMETRY * np.outer(sizes, sizes)):
        raise InputError("stiffness must be symmetric", where=where)
    least = float(np.linalg.eigvalsh(K / np.outer(sizes, sizes))[0]) if sizes.all() else 0.0
    if not least > numerics.RANK:
        raise InputError(
            "stiffness must hold the body in every direction",
            where=where,
            expected="a positive definite matrix",
            got=f"eigenvalue {least:.2g} of the diagonal's",
        )
    return Mount(T @ pose_of(entry.offset), K[np.ix_(se3.SWAP, se3.SWAP)])


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
