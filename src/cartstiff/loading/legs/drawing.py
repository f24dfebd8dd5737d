"""Legs by name become numbers: points, directions and lengths of each leg, and its shape."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.legs.model import LegEndsModel, NamedLegsModel
from cartstiff.mechanisms.leg_shapes import Family, LegShape, turns

_Z = np.array([0.0, 0.0, 1.0])


def drawn(entry: NamedLegsModel, T_F_P: Array, where: str) -> list[LegShape]:
    """Shape of each leg, with the body at a pose.

    Parameters
    ----------
    entry : NamedLegsModel
        What the file says.
    T_F_P : ndarray (4, 4)
        The file's pose: there all passive joints are at zero.
    where : str
        The file and its entry, for messages.

    Raises
    ------
    InputError
        For counts that do not fit, legs that do not reach, and poses at which the joints of such
        legs could not be put together.
    """
    base, mirrored = _points(entry, entry.base)
    # The two legs of a pair of the base go to the neighbouring pairs of the platform.
    turn = np.pi / 3.0 if entry.turn is None else entry.turn
    platform, _ = _points(entry, entry.platform, (turn - 2.0 * np.pi / 3.0, turn))
    m = len(base)
    if len(platform) != m:
        raise InputError(
            "base and platform differ in number",
            where=f"{where}, key legs.platform",
            expected=f"{m} joints as on the base",
            got=len(platform),
        )
    letters = _without_idle_spin(entry.chain)
    family: Family = "strut" if letters[1] in "PC" else "rail" if letters[0] == "P" else "crank"
    middle = letters[0] if family == "strut" else letters[1]
    frames = _frames(entry, base)
    planar = set(entry.chain) <= set("RP")
    axes = _directions(
        entry.axis or ("vertical" if planar else "tangential"),
        "axis",
        base,
        frames,
        mirrored,
        where,
    )
    rails = _directions(entry.rail or "vertical", "rail", base, frames, mirrored, where)
    rods, cranks = one_each(entry.rod, m, "rod", where), one_each(entry.crank, m, "crank", where)
    modes = one_each(entry.mode, m, "mode", where)
    R = T_F_P[:3, :3]
    shapes = []
    for k in range(m):
        B = R @ platform[k] + T_F_P[:3, 3]
        axis = axes[k]
        along = rails[k]
        if family == "crank":
            level = np.cross(_Z, axis)
            size = float(np.linalg.norm(level))
            along = level / size if size > numerics.NEARBY else frames[k][:, 0]
            if along @ (base[k] * [1.0, 1.0, 0.0]) < -numerics.NEARBY * float(np.abs(base).max()):
                along = -along  # zero points outwards, whichever way the axis does
        shape = LegShape(
            family,
            middle,
            letters[1] == "C",
            letters[2:],
            base[k],
            along,
            axis,
            R @ axis,
            cranks[k] or 0.0,
            rods[k] or 0.0,
            0.0,
            se3.pose(R, B),
        )
        shapes.append(_at_home(shape, _root(shape, modes[k]), f"leg {k + 1}", where))
    return shapes


def _root(shape: LegShape, mode: str | None) -> int:
    """Sign of the root at home that gives the smaller ("minus") or larger coordinate ("plus").

    Angles of cranks are compared between -pi and pi. Default: the smaller slide, and the crank that
    points outwards the more.
    """
    B = shape.end_home[None, :3, 3]
    values = {float(shape.driven(B, sign)[0][0]): sign for sign in shape.modes}
    if mode is None and shape.family == "crank":
        return values[min(values, key=abs)]
    return values[max(values) if mode == "plus" else min(values)]


def _at_home(shape: LegShape, sign: int, leg: str, where: str) -> LegShape:
    """The same with its driven coordinate where the end is at home, checked."""
    B = shape.end_home[:3, 3]
    value = float(shape.driven(B[None], sign)[0][0])
    if not np.isfinite(value):
        raise InputError(
            "the pose cannot be reached",
            where=f"{where}, key pose",
            expected="a pose that every leg reaches",
            got=f"{leg}, which is {shape.short_of(B):.3g} too short",
        )
    shape = replace(shape, home=value)
    if float(np.linalg.norm(B - shape.centre)) <= numerics.NEARBY * float(np.abs(B).max()):
        raise InputError(f"{leg} has no length at the pose", where=f"{where}, key pose")
    n = shape.line
    try:
        inner = shape.universal[1] if shape.middle == "U" else shape.axis
        end_inner = shape.end_inner if shape.end == "U" else shape.end_axis
    except InputError as error:
        raise InputError(
            f"{error.what} ({leg})", where=f"{where}, key legs.axis", expected=error.expected
        ) from None
    # What cannot turn to fit is not drawn askew: another machine would come of it.
    askew = 0.0
    if shape.middle == "R":
        askew = abs(float(n @ shape.axis))
    if shape.end == "R":
        askew = max(askew, abs(float(n @ shape.end_axis)))
    if shape.middle == shape.end and not shape.spins:  # two hinges, or two universal joints
        askew = max(askew, float(np.linalg.norm(np.cross(inner, end_inner))))
    if askew > numerics.NEARBY:
        raise InputError(
            f"the joints of {leg} do not fit together at the pose",
            where=f"{where}, key pose",
            expected="a pose at which hinges are across the rod, and the axes at both its ends "
            "parallel",
            got=f"{np.arcsin(min(1.0, askew)):.3g} rad askew",
        )
    return shape


def _without_idle_spin(chain: str) -> str:
    """The chain with one ball of a rod that has two as a universal joint."""
    i = 0 if chain[1] == "P" else 1
    return chain[:i] + "U" + chain[i + 1 :] if chain[i] == "S" and chain.endswith("S") else chain


def _points(
    entry: NamedLegsModel, ring: LegEndsModel, middles: tuple[float, float] | None = None
) -> tuple[list[Array], list[bool]]:
    """Points of base or platform, and whether a leg is the mirror image of the next one.

    The first two legs stand on one pair, or on two whose middles are given.
    """
    own: list[Array]
    flips = [False]
    if ring.points is not None:
        own = [np.array(p, float) for p in ring.points]
        flips *= len(own)
    else:
        angles = ring.angles or [0.0]
        flips *= len(angles)
        if ring.half_angle is not None:
            half, flips = ring.half_angle, [True, False]
            angles = [-half, half] if middles is None else [middles[0] + half, middles[1] - half]
        radius = ring.radius or 0.0
        own = [np.array([radius * np.cos(a), radius * np.sin(a), ring.height]) for a in angles]
    count = _symmetry(entry)
    steps = turns(_Z, 2.0 * np.pi * np.arange(count) / count)
    return [T @ p for T in steps for p in own], flips * count


def _symmetry(entry: NamedLegsModel) -> int:
    is_drawn = any(
        r.points is not None or r.angles is not None for r in (entry.base, entry.platform)
    )
    return entry.symmetry or (1 if is_drawn else 3)


def _frames(entry: NamedLegsModel, base: list[Array]) -> list[Array]:
    """Frame of each leg: x radial on a circle; else the axes of F, turned with the symmetry."""
    if entry.base.points is None:
        return [turns(_Z, np.asarray(np.arctan2(p[1], p[0]))) for p in base]
    count = _symmetry(entry)
    own = len(base) // count
    steps = turns(_Z, 2.0 * np.pi * np.arange(count) / count)
    return [steps[k // own] for k in range(len(base))]


def _directions(
    value: Any, key: str, base: list[Array], frames: list[Array], mirrored: list[bool], where: str
) -> list[Array]:
    """Unit vectors in F, one for each leg."""
    m, is_word = len(base), isinstance(value, str)
    if is_word:
        words = {"radial": [1, 0, 0], "tangential": [0, 1, 0], "vertical": [0, 0, 1]}
        if value != "vertical":
            frames = [_radial(p, base, f"{where}, key legs.{key}") for p in base]
        # About it a positive angle raises a crank that points outwards.
        value = [0, -1, 0] if (key, value) == ("axis", "tangential") else words[value]
    one = is_word or not isinstance(value[0], list)
    if not one and len(value) != m:
        raise InputError(
            "wrong count",
            where=f"{where}, key legs.{key}",
            expected=f"one vector, or {m}, one per leg",
            got=len(value),
        )
    directions = []
    for k in range(m):
        v = np.array(value if one else value[k], float)
        size = float(np.linalg.norm(v))
        if size < numerics.TINY:
            raise InputError("a direction has no length", where=f"{where}, key legs.{key}")
        v = v / size
        if one and mirrored[k]:  # axes turn the other way in a mirror
            v = v * (np.array([-1.0, 1.0, -1.0]) if key == "axis" else np.array([1.0, -1.0, 1.0]))
        directions.append(frames[k] @ v if one else v)
    return directions


def _radial(p: Array, base: list[Array], where: str) -> Array:
    """Frame at a point: x away from the z axis, z up."""
    if np.hypot(p[0], p[1]) <= numerics.NEARBY * float(np.abs(base).max()):
        raise InputError(
            "a joint on the z axis has no radial and no tangential direction",
            where=where,
            expected="vertical, or a vector",
        )
    return turns(_Z, np.arctan2(p[1], p[0]))


def one_each(value: Any, m: int, key: str, where: str) -> list[Any]:
    """One value for each of m legs."""
    if not isinstance(value, list):
        return [value] * m
    if len(value) != m:
        raise InputError(
            "wrong count",
            where=f"{where}, key legs.{key}",
            expected=f"one, or {m}, one per leg",
            got=len(value),
        )
    return value
