"""Build bodies on line springs: Stewart-Gough platforms, springs and cables."""

from __future__ import annotations

import math
from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, UndefinedError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.platform import LegLimits, Platform, Struts
from cartstiff.core.notes import Note
from cartstiff.core.potentials.line_springs import LineSprings, line_geometry
from cartstiff.core.units import SI, Units, convert_length
from cartstiff.files.bare import pose_of
from cartstiff.files.platform_schema import BodyModel
from cartstiff.files.plausible import large_strains
from cartstiff.files.schema import FlexibleModel, one_each
from cartstiff.files.struts.flexure_struts import Flexure, FlexureStruts
from cartstiff.files.struts.mounted_struts import Mount, MountedStruts

if TYPE_CHECKING:
    from cartstiff.files.platform_schema import PlatformFile, SpringsFile


def build_platform(file: PlatformFile | SpringsFile, name: str) -> ElasticMechanism:
    """Build the elastic mechanism of a body held by lines."""
    legs = _Legs(file)
    platform, T_F_M = _platform(file, legs), pose_of(file.pose) @ pose_of(file.frame)
    try:
        lengths = line_geometry(T_F_M, platform.anchors, platform.points).lengths
    except UndefinedError as error:
        raise InputError(
            f"leg {error.values['line']} has zero length at the file's pose"
        ) from None
    if platform.struts is not None:
        _check_bars(platform.struts, lengths)
    springs = _springs(file, legs, platform, T_F_M)
    if (limits := platform.leg_limits) is not None and limits.forces is not None:
        springs = replace(springs, least=limits.forces[:, 0], most=limits.forces[:, 1])
    springs = _wound(springs, legs, T_F_M, lengths)
    stretches = lengths - springs.rest_length
    if springs.preload is not None:
        by_drives = np.isnan(stretches)
        stretches = np.where(by_drives, springs.preload / springs.stiffness, stretches)
    # A rest length of zero is intended: such springs balance weights.
    strains = {
        f"stretch of leg {i + 1}": float(x)
        for i, x in enumerate(np.nan_to_num(stretches / lengths))
        if springs.rest_length[i] != 0.0
    }
    q, dampers = [*file.pose.xyz, *file.pose.rpy], legs.each("damping")
    elastic = ElasticMechanism(
        name,
        platform,
        np.array(q),
        springs,
        notes=(*legs.notes, *large_strains(strains)),
        damping=dampers if dampers is not None and dampers.any() else None,
    )
    return elastic.with_gravity(file.gravity, where="key gravity")


class _Legs:
    """What a file says of its legs, for each of them.

    Attributes
    ----------
    m : int
        Their number.
    cables : list of bool
        Which of them cannot push.
    notes : list of Note
    """

    def __init__(self, file: PlatformFile | SpringsFile) -> None:
        self.file, self.m, self.notes = file, len(file.base), list[Note]()
        one_each(file.platform, self.m, "key platform")
        cables = getattr(file, "unilateral", False)
        self.cables = one_each(cables, self.m, "key unilateral")

    def each(self, key: str, row: bool = False) -> Array | None:
        """Numbers (m,) from one for all legs or one each; with `row` pairs (m, 2).

        None without any.
        """
        value = attrgetter(key)(self.file.legs)
        if value is None:
            return None
        return np.array(one_each(value, self.m, f"key legs.{key}", row=row), float)

    def joints(self, key: str) -> tuple[Array | None, Array | None]:
        """Unit axes (m, 3) and largest angles (m,) of the joints at one end;
        None without any.
        """
        if (joints := getattr(self.file.legs, key)) is None:
            return None, None
        where = f"key legs.{key}.axis"
        axes = np.array(one_each(joints.axis, self.m, where, row=True), float)
        sizes = np.linalg.norm(axes, axis=1, keepdims=True)
        if not sizes.min() > 0.0:
            raise InputError("an axis has no direction", where=where, got=joints.axis)
        return axes / sizes, self.each(f"{key}.angle")

    def drives(self) -> list[bool]:
        """Which legs a drive winds: those that are named, else cables and those
        of hexapods.
        """
        driven = self.file.legs.driven
        if driven is not None:
            return one_each(driven, self.m, "key legs.driven")
        return [True] * self.m if self.file.kind == "stewart-gough" else self.cables


def _platform(file: PlatformFile | SpringsFile, legs: _Legs) -> Platform:
    """Mechanism of the file: points, masses and limits."""
    limits, payload = legs.each("limits", row=True), file.payload
    body = file.body or BodyModel.model_construct(mass=0.0)
    platform = Platform(
        file.base,
        file.platform,
        T_P_M=pose_of(file.frame),
        units=Units(file.units.length, file.units.force),
        kind=file.kind,
        limits=None if limits is None else [(a, b) for a, b in limits],
        mass=body.mass,
        mass_centre=body.com,
        inertia=np.array(body.inertia or np.zeros((3, 3)), float),
        struts=_struts(file, legs),
        leg_limits=_leg_limits(file, legs),
    )
    if payload is not None:
        platform = platform.with_mass(payload.mass, np.array(payload.com))
    return platform


def _leg_limits(file: PlatformFile | SpringsFile, legs: _Legs) -> LegLimits | None:
    """Return the limits of joint angles, distances and forces; None without any."""
    base_axes, base_angles = legs.joints("base_joints")
    axes, angles = legs.joints("platform_joints")
    diameters, forces = legs.each("diameter"), legs.each("force", row=True)
    if forces is not None:
        if np.any(forces[legs.cables, 1] < 0.0):
            raise InputError(
                "cables cannot push",
                where="key legs.force",
                expected="0 or more",
                got=file.legs.force,
            )
        forces[legs.cables, 0] = np.maximum(forces[legs.cables, 0], 0.0)
    if all(part is None for part in (base_axes, axes, diameters, forces)):
        return None
    in_body = None if axes is None else axes @ pose_of(file.frame)[:3, :3]
    return LegLimits(base_axes, base_angles, in_body, angles, diameters, forces)


def _struts(file: PlatformFile | SpringsFile, legs: _Legs) -> Struts | None:
    """Return the masses of the legs, with a note on assumed ones; None without any."""
    strut = file.legs.strut
    key = "mass" if strut is None or strut.mass is None else "strut.mass"
    mass = attrgetter(key)(file.legs)
    if mass is None:
        return None
    if hasattr(mass, "fixed"):
        keys = ("fixed", "moving", "fixed_com", "moving_com", "radius")
        return Struts(*(legs.each(f"{key}.{part}") for part in keys))  # type: ignore[arg-type]
    T, feet = pose_of(file.pose), np.array(file.base)
    heads = se3.placed(T, file.platform)
    quarter = np.linalg.norm(heads - feet, axis=1) / 4.0
    half = np.array(one_each(mass, legs.m, f"key legs.{key}"), float) / 2.0
    words = (
        "legs.mass is one number for a leg: a uniform bar of the leg's length at the "
        "file's pose, half of it on either joint; fixed, moving, fixed_com and "
        "moving_com state another distribution"
    )
    legs.notes.append(Note("leg-mass-spread", words, {"mass": (2.0 * half).tolist()}))
    return Struts(half, half, quarter, quarter, np.zeros(legs.m))


def _check_bars(struts: Struts, lengths: Array) -> None:
    """Refuse bars of legs whose mass centre lies beyond the leg's other end."""
    for key, masses in (("fixed_com", struts.fixed), ("moving_com", struts.moving)):
        for i in np.flatnonzero((masses > 0.0) & (getattr(struts, key) > lengths)):
            raise InputError(
                f"the mass centre of leg {i + 1} is beyond its other end",
                where=f"key legs.mass.{key}",
                got=f"{getattr(struts, key)[i]:g}",
                expected=f"a distance up to the leg's length, {lengths[i]:g}",
            )


def _springs(
    file: PlatformFile | SpringsFile, legs: _Legs, platform: Platform, T_F_M: Array
) -> LineSprings:
    """Return the springs of the legs: lines, or struts between flexures."""
    strut = file.legs.strut
    stiffness = legs.each("stiffness" if strut is None else "strut.axial")
    if stiffness is None:  # the schema requires it
        raise InputError("legs have no stiffness")
    rests = legs.each("rest_length")
    if rests is None:
        rests = np.full(legs.m, np.nan)
    springs = LineSprings(
        anchors=platform.anchors,
        points=platform.points,
        stiffness=stiffness,
        rest_length=rests,
        unilateral=tuple(legs.cables),
    )
    if strut is not None:
        # Moments are in N m, whatever the units.
        moment = math.prod(convert_length(SI, platform.units))
        ends = (
            Flexure(e.axial, e.shear, e.bending * moment, e.torsion * moment, e.offset)
            for e in (strut.lower, strut.upper)
        )
        springs = _between(springs, T_F_M, *ends)
    return _mounted(springs, file, T_F_M) if file.flexible else springs


def _between(
    lines: LineSprings, T_F_M: Array, lower: Flexure, upper: Flexure
) -> FlexureStruts:
    """Return struts in place of lines, straight with the body at a pose."""
    ends, k, rests = (lines.anchors, lines.points), lines.stiffness, lines.rest_length
    return FlexureStruts.between(*ends, T_F_M, k, lower, upper, rests)


def _wound(
    springs: LineSprings, legs: _Legs, T_F_M: Array, lengths: Array
) -> LineSprings:
    """Return the springs with their drives and preloads."""
    preload, drives = legs.each("preload"), legs.drives()
    springs = replace(springs, driven=tuple(drives))
    if preload is None:
        return springs
    # A passive spring was made with its rest length; a drive winds its leg to the
    # tension.
    own = lengths - preload / springs.stiffness
    if isinstance(springs, FlexureStruts):
        own = springs.wound(T_F_M[None], preload)[0]
    rests = np.where(drives, np.nan, own)
    wound = np.where(drives, preload, np.nan) if any(drives) else None
    return replace(springs, rest_length=rests, preload=wound)


def _mounted(
    springs: LineSprings, file: PlatformFile | SpringsFile, T_F_M: Array
) -> MountedStruts:
    """Mount the legs on the compliant base and platform of the file's `flexible`.

    Raises
    ------
    InputError
        For cables, and for springs that are not symmetric and positive definite, are
        beams, or have a mass.
    """
    where = "key flexible"
    if springs.unilateral:
        raise InputError(
            "cables need a rigid mounting", where=where, expected="no key flexible"
        )
    if not isinstance(springs, FlexureStruts):
        ball = Flexure(math.inf, math.inf, 0.0, 0.0)
        springs = _between(springs, T_F_M, ball, ball._replace(torsion=math.inf))
    to_body = se3.inverse(pose_of(file.frame))
    base = _mount(file.flexible.get("base"), np.eye(4), f"{where}.base")
    tip = _mount(file.flexible.get("platform"), to_body, f"{where}.platform")
    return MountedStruts.of(springs, base, tip)


def _mount(entry: FlexibleModel | None, T: Array, where: str) -> Mount | None:
    """Spring of a mounting with its place moved by T; None for a rigid mounting."""
    if entry is None:
        return None
    if entry.stiffness is None or entry.mass is not None:
        got = "a beam" if entry.stiffness is None else "a mass"
        raise InputError(
            "base and platform are mounted on springs without mass",
            where=where,
            expected="stiffness alone",
            got=got,
        )
    K = np.array(entry.stiffness, float)
    sizes, least = np.sqrt(np.abs(np.diag(K))), 0.0
    if sizes.all():
        least = float(np.linalg.eigvalsh(K / np.outer(sizes, sizes))[0])
    if not least > numerics.RANK:
        raise InputError(
            "stiffness must hold the body in every direction",
            where=where,
            expected="a positive definite matrix",
            got=f"eigenvalue {least:.2g} of the diagonal's",
        )
    return Mount(T @ pose_of(entry.offset), K[np.ix_(se3.SWAP, se3.SWAP)])
