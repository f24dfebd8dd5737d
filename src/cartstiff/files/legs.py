"""Legs by name: their shapes, and their joints as Pinocchio models."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import count, filterfalse
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.geometry import se3
from cartstiff.core.notes import Note
from cartstiff.files.bare import pose_of
from cartstiff.files.description import RobotDescription
from cartstiff.files.leg_schema import LegEndsModel, LegModel, NamedLegs, ParallelFile
from cartstiff.files.schema import JointSpringModel, PoseModel, one_each
from cartstiff.kinematics.leg_shapes import Family, LegShape, frame_along, turns

_Z = np.array([0.0, 0.0, 1.0])


_WORDS = {"radial": [1, 0, 0], "tangential": [0, -1, 0], "vertical": [0, 0, 1]}


class _Layout:
    """Where the legs of an entry by name stand, and which way their axes point.

    Attributes
    ----------
    entry : NamedLegs
    place : str
        Place of the entry, for messages.
    base, platform : list of ndarray (3,)
        First joints in F, last joints in P.
    mirrored : list of bool
        Whether each leg is the mirror image of the next one.
    """

    def __init__(self, entry: NamedLegs, place: str) -> None:
        self.entry, self.place = entry, place
        rings = (entry.base, entry.platform)
        is_drawn = any(r.points is not None or r.angles is not None for r in rings)
        count = entry.symmetry or (1 if is_drawn else 3)
        #: Rotations (n, 3, 3) about z of the n equal parts.
        self.parts = turns(_Z, 2.0 * np.pi * np.arange(count) / count)
        self.base, self.mirrored = self._points(entry.base)
        self.platform, _ = self._points(entry.platform)
        if len(self.platform) != len(self.base):
            raise InputError(
                "base and platform differ in number",
                where=self.key("platform"),
                expected=f"{len(self.base)} joints as on the base",
                got=len(self.platform),
            )
        self.frames = self._frames()

    def key(self, name: str) -> str:
        """Place of a key, for messages."""
        return f"{self.place}.{name}"

    def each(self, key: str, row: bool = False) -> list[Any]:
        """Value of a key for each leg."""
        value = getattr(self.entry, key)
        return one_each(value, len(self.base), self.key(key), row=row)

    def _points(self, ring: LegEndsModel) -> tuple[list[Array], list[bool]]:
        """Points of base or platform, and whether each leg is the mirror image of
        the next one.

        The two legs of a pair of the base end at the neighbouring pairs of the platform.
        """
        n = len(self.parts)
        if ring.points is not None:
            own = [R @ p for R in self.parts for p in np.array(ring.points, float)]
            return own, [False] * len(own)
        angles, flips = ring.angles or [0.0], [False] * len(ring.angles or [0.0])
        if ring.half_angle is not None:
            is_base = ring is self.entry.base
            angles, flips = ring.pair(self.entry.turn, is_base), [True, False]
        return list(ring.joints(angles, n)), flips * n

    def _frames(self) -> list[Array]:
        """Frame of each leg: x radial on a circle.

        Else the axes of F, turned with the symmetry.
        """
        if self.entry.base.points is None:
            return [turns(_Z, np.asarray(np.arctan2(p[1], p[0]))) for p in self.base]
        count = len(self.base) // len(self.parts)
        return list(np.repeat(self.parts, count, axis=0))

    def directions(self, key: str, value: Any) -> list[Array]:
        """Unit vectors in F, one for each leg."""
        frames, m = self.frames, len(self.base)
        if is_word := isinstance(value, str):
            if value != "vertical":
                frames = [self._radial(p, self.key(key)) for p in self.base]
            # With -y as its axis a positive angle raises a crank that points outwards.
            outwards = {("rail", "tangential"): [0, 1, 0]}
            value = outwards.get((key, value), _WORDS[value])
        one = is_word or not isinstance(value[0], list)
        # An axis of rotation is reversed in a mirror.
        mirror = np.array([1.0, -1.0, 1.0]) * (2.0 * (key == "rail") - 1.0)
        directions = []
        for k, entry in enumerate(one_each(value, m, self.key(key), row=True)):
            size = numerics.norm(entry)
            if size < numerics.TINY:
                raise InputError("a direction has no length", where=self.key(key))
            v = np.array(entry, float) / size
            if one:
                v = frames[k] @ (v * mirror if self.mirrored[k] else v)
            directions.append(v)
        return directions

    def _radial(self, p: Array, where: str) -> Array:
        """Frame at a point with x away from the z axis."""
        if np.hypot(p[0], p[1]) <= self.least:
            raise InputError(
                "a joint on the z axis has no radial and no tangential direction",
                where=where,
                expected="vertical, or a vector",
            )
        return turns(_Z, np.arctan2(p[1], p[0]))

    @property
    def least(self) -> float:
        """Distance that counts as none."""
        return numerics.NEGLIGIBLE_DISTANCE * float(np.abs(self.base).max())

    def along(self, k: int, axis: Array) -> Array:
        """Direction in which a crank points at zero: across its axis, level, outwards."""
        level = np.cross(_Z, axis)
        size = numerics.norm(level)
        along = self.frames[k][:, 0]
        if size > numerics.NEGLIGIBLE_DISTANCE:
            along = level / size
        is_inwards = along @ (self.base[k] * [1.0, 1.0, 0.0]) < -self.least
        return -along if is_inwards else along


def drawn(
    entry: NamedLegs, T_F_P: Array, place: str
) -> list[tuple[LegShape, float | None]]:
    """The shape of each leg, with the body at a pose, and the other root of `_root`.

    Parameters
    ----------
    entry : NamedLegs
        The file's entry.
    T_F_P : ndarray (4, 4)
        The file's pose, at which all passive joints are zero.
    place : str
        Place of the entry, for messages.

    Raises
    ------
    InputError
        For counts that do not fit, legs that do not reach, and poses at which the joints
        of such legs could not be put together.
    """
    layout, letters = _Layout(entry, place), _without_free_spin(entry.chain)
    family: Family = "strut"
    if letters[1] not in "PC":
        family = "rail" if letters[0] == "P" else "crank"
    # Directions and dimensions of every leg, then the shape that has them at the pose.
    axes = at_body = layout.directions("axis", _axis(entry))
    if is_skew := entry.end_axis is not None:
        at_body = layout.directions("end_axis", entry.end_axis)
    rails = layout.directions("rail", entry.rail or "vertical")
    rods, cranks, modes = map(layout.each, ("rod", "crank", "mode"))
    first = letters[family != "strut"]
    R = T_F_P[:3, :3]
    shapes = []
    for k, (A, end) in enumerate(zip(layout.base, layout.platform, strict=True)):
        shape = LegShape(
            family,
            first,
            letters[1] == "C",
            letters[2:],
            A,
            layout.along(k, axes[k]) if family == "crank" else rails[k],
            axes[k],
            R @ at_body[k],
            cranks[k] or 0.0,
            rods[k] or 0.0,
            0.0,
            se3.pose(R, R @ end + T_F_P[:3, 3]),
        )
        sign, other = _root(shape, modes[k])
        is_straight = not (shape.spins or is_skew)
        shape = _at_home(shape, sign, f"leg {k + 1}", place, is_straight)
        shapes.append((shape, other))
    return shapes


def _axis(entry: NamedLegs) -> Any:
    """Direction of the first axes of the legs."""
    default = "vertical" if set(entry.chain) <= set("RP") else "tangential"
    return entry.axis or default


def _root(shape: LegShape, mode: str | None) -> tuple[int, float | None]:
    """Sign of the root with the smaller ("minus") or larger ("plus") coordinate at home.

    Angles of cranks are compared between -pi and pi, where -pi counts as pi. The default
    is the smaller slide, and the crank that points outwards more; of two that do so alike
    the larger angle. Coordinates within `NEGLIGIBLE_DISTANCE` count as alike, so that
    round-off does not choose, and legs that are alike choose alike.

    Returns
    -------
    sign : int
    other : float or None
        Coordinate of the other root, if it points outwards alike.
    """
    is_crank, alike = shape.family == "crank", numerics.NEGLIGIBLE_DISTANCE
    B = shape.end_home[None, :3, 3]
    roots = [(float(shape.driven(B, sign)[0][0]), sign) for sign in shape.modes]
    least = shape.rod * alike
    if is_crank:
        turn, least = 2.0 * np.pi, alike
        roots = [(t + turn * (t < alike - np.pi), sign) for t, sign in roots]
    # Two roots that meet are in the order of their signs, whatever their round-off.
    is_double = abs(roots[0][0] - roots[-1][0]) <= least
    smaller, larger = roots[0], roots[-1]
    if not is_double:
        smaller, larger = min(roots), max(roots)
    if mode is not None or not is_crank:
        return (larger if mode == "plus" else smaller)[1], None
    outwards = abs(larger[0]) - abs(smaller[0])
    if is_double:
        return larger[1], None
    if abs(outwards) <= alike:
        return larger[1], smaller[0]
    return [larger, smaller][outwards > 0.0][1], None


def _at_home(
    shape: LegShape, sign: int, name: str, place: str, is_straight: bool
) -> LegShape:
    """Set the driven coordinate at home; refuse joints that cannot be assembled there.

    With `is_straight`, a rod's axes at its two ends must be parallel.
    """
    B = shape.end_home[:3, 3]
    value = float(shape.driven(B[None], sign)[0][0])
    if not np.isfinite(value):
        raise InputError(
            "the pose cannot be reached",
            where="key pose",
            expected="a pose that every leg reaches",
            got=f"{name}, which is {shape.short_of(B):.3g} of the file's lengths too "
            "short",
        )
    shape = replace(shape, home=value)
    least = numerics.NEGLIGIBLE_DISTANCE * float(np.abs(B).max())
    if numerics.norm(B - shape.centre) <= least:
        raise InputError(f"{name} has no length at the pose", where="key pose")
    n = shape.line
    try:
        inner = shape.universal[1] if shape.middle == "U" else shape.axis
        end_inner = shape.end_inner if shape.end == "U" else shape.end_axis
    except InputError as error:
        raise InputError(
            f"{error.what} ({name})", where=f"{place}.axis", expected=error.expected
        ) from None
    # Joints that do not fit are not drawn with other axes: that would be another machine.
    hinges = ((shape.middle, shape.axis), (shape.end, shape.end_axis))
    sines = [abs(float(n @ axis)) * (letter == "R") for letter, axis in hinges]
    # Two hinges, or two universal joints, of a rod that does not spin.
    if shape.middle == shape.end and is_straight:
        sines.append(numerics.norm(np.cross(inner, end_inner)))
    if (largest := max(sines)) > numerics.NEGLIGIBLE_DISTANCE:
        raise InputError(
            f"the joints of {name} do not fit together at the pose",
            where="key pose",
            expected="a pose at which hinges are across the rod, and the axes at both "
            "its ends "
            "parallel",
            got=f"{np.arcsin(min(1.0, largest)):.3g} rad askew",
        )
    return shape


def _without_free_spin(chain: str) -> str:
    """Chain in which a universal joint replaces one of the two balls of a rod."""
    i = 0 if chain[1] == "P" else 1
    both = chain[i] == "S" and chain.endswith("S")
    return f"{chain[:i]}U{chain[i + 1 :]}" if both else chain


#: Frame at the end of a leg, with the body's directions at home.
END = "end"


@dataclass(frozen=True, eq=False)
class DrawnLeg:
    """Drawing of a leg by name.

    Attributes
    ----------
    description : RobotDescription
        Its joints.
    shape : LegShape
        Its dimensions.
    joints : tuple of str
        Names of its joints, from the ground to the body.
    driven : str
        The joint whose coordinate is the shape's.
    diameter : float or None
        Diameter of its rod.
    other : float or None
        Coordinate of the other working mode, if the file names none and both are equally
        near.
    """

    description: RobotDescription
    shape: LegShape
    joints: tuple[str, ...]
    driven: str
    diameter: float | None = None
    other: float | None = None


class _Drawing:
    """Model of a leg to which joints are added one by one,
    each with its frame in F at home.
    """

    def __init__(self) -> None:
        self.model = pin.Model()
        self.joint, self.frame = 0, 0
        self.T = np.eye(4)
        self.names: list[str] = []
        self._numbers = {letter: count(1) for letter in "urs"}

    def turn(
        self,
        letter: str,
        axis: Array,
        T_home: Array,
        at_home: float = 0.0,
        name: str | None = None,
    ) -> None:
        """Add a revolute joint about an axis in F whose angle in a frame is `at_home`."""
        own = T_home[:3, :3].T @ axis
        own = own / np.linalg.norm(own)
        back = se3.exp(np.concatenate([-at_home * own, np.zeros(3)]))
        name = name or f"{letter}{next(self._numbers[letter])}"
        self._add(name, pin.JointModelRevoluteUnaligned(own), T_home, back)

    def slide(self, T_home: Array, at_home: float) -> None:
        """Add a prismatic joint along x of a frame,
        in which its position is `at_home`.
        """
        self._add(
            "slide",
            pin.JointModelPX(),
            T_home,
            se3.pose(translation=(-at_home, 0.0, 0.0)),
        )

    def _add(self, name: str, joint: Any, T_home: Array, back: Array) -> None:
        placement = se3.inverse(self.T) @ T_home @ back
        self.joint = self.model.addJoint(self.joint, joint, pin.SE3(placement), name)
        self.frame = int(self.model.addJointFrame(self.joint, self.frame))
        self.names.append(name)
        self.T = T_home

    def link(self, name: str, T_home: Array | None = None) -> None:
        """Add a link's frame, fixed to the last joint."""
        T = np.eye(4) if T_home is None else se3.inverse(self.T) @ T_home
        frame = pin.Frame(name, self.joint, self.frame, pin.SE3(T), pin.FrameType.BODY)
        self.frame = int(self.model.addFrame(frame))

    def turns(self, letter: str, T: Array, axes: tuple[Array, ...], frame: Array) -> None:
        """Add a hinge, a universal joint or a ball at a point."""
        for axis in frame.T if letter == "S" else axes:
            self.turn(letter.lower(), axis, T)


def leg_model(shape: LegShape) -> tuple[Any, list[str]]:
    """Return Pinocchio's model of a leg at home, and the names of its joints."""
    drawing = _Drawing()
    T_rod = se3.pose(shape.rod_frame, shape.centre)
    # What drives the rod's lower end, then the joint there.
    if shape.family == "rail":
        helper = np.eye(3)[int(np.argmin(np.abs(shape.along)))]
        drawing.slide(
            se3.pose(frame_along(shape.along, helper), shape.centre), shape.home
        )
        drawing.link("slider")
    elif shape.family == "crank":
        arm = frame_along(shape.centre - shape.anchor, shape.axis)
        drawing.turn("", shape.axis, se3.pose(arm, shape.anchor), shape.home, "crank")
        drawing.link("crank")
    axes = (shape.axis, shape.universal[1]) if shape.middle == "U" else (shape.axis,)
    drawing.turns(shape.middle, T_rod, axes, shape.rod_frame)
    # The strut's slide, or the rod, then the joint at the body.
    B = shape.end_home[:3, 3]
    if shape.family == "strut":
        drawing.link("lower")
        T_upper = se3.pose(shape.rod_frame, B)
        drawing.slide(T_upper, shape.home)
        if shape.spins:
            drawing.turn("", shape.line, T_upper, name="spin")
        drawing.link("upper")
    else:
        drawing.link("rod")
    if shape.end:
        axes = (
            (shape.end_inner, shape.end_axis) if shape.end == "U" else (shape.end_axis,)
        )
        drawing.turns(
            shape.end, se3.pose(shape.rod_frame, B), axes, shape.end_home[:3, :3]
        )
    drawing.link(END, shape.end_home)
    return drawing.model, drawing.names


def with_drawn_legs(file: ParallelFile) -> ParallelFile:
    """Return the file with a drawn leg for each leg by name; itself where it has none."""
    named = [isinstance(entry, NamedLegs) for entry in file.entries]
    _check_units(file, all(named))
    if not any(named):
        return file
    if file.pose is None:
        raise InputError(
            "key 'pose' is missing",
            expected="where the body is: legs by name are drawn there",
        )
    legs: list[LegModel] = []
    driven: list[str] = []
    T_F_P = pose_of(file.pose)
    for i, entry in enumerate(file.entries, start=1):
        place = "key legs" if entry is file.legs else f"key legs.{i}"
        if isinstance(entry, LegModel):
            legs.append(entry)
            continue
        for leg, names in _legs(entry, T_F_P, place):
            legs.append(leg)
            driven += [f"leg{len(legs)}/{name}" for name in names]
    return file.model_copy(update={"legs": legs, "actuated": file.actuated or driven})


def _check_units(file: ParallelFile, is_by_name: bool) -> None:
    """Refuse units that robots' files do not have."""
    if file.units.force != "N":
        raise InputError(
            "cannot be used",
            where="key units.force",
            expected="N",
            got=repr(file.units.force),
        )
    if file.units.length != "m" and not is_by_name:
        raise InputError(
            "units are for legs by name: the files of robots are in m",
            where="key units",
            expected="m and N, or no units",
            got=file.units.length,
        )


def drawn_legs(file: ParallelFile) -> list[LegModel]:
    """Return the legs of a file in which all legs by name have been drawn."""
    return [entry for entry in file.entries if isinstance(entry, LegModel)]


def mode_notes(legs: Iterable[LegModel]) -> list[Note]:
    """Note on legs whose two working modes are equally near to the file's pose."""
    drawings = {f"leg{i}": leg.drawing for i, leg in enumerate(legs, start=1)}
    tied = {
        name: (float(d.shape.home), float(d.other))
        for name, d in drawings.items()
        if d is not None and d.other is not None
    }
    if not tied:
        return []
    each = [f"{np.degrees(a):.4g} and {np.degrees(b):.4g} deg" for a, b in tied.values()]
    angles = each[0]
    if len({*each}) > 1:
        angles = ", ".join(map(": ".join, zip(tied, each, strict=True)))
    words = (
        "no mode was given, and two working modes are equally near: cranks of "
        f"{', '.join(tied)} at {angles}; the larger angle is taken (mode: plus), and "
        "`mode: minus` in legs takes the other"
    )
    taken, other = ({n: x[i] for n, x in tied.items()} for i in (0, 1))
    return [Note("working-mode", words, {"taken": taken, "other": other})]


def _legs(entry: NamedLegs, T_F_P: Array, place: str) -> list[tuple[LegModel, list[str]]]:
    """Drawn legs of an entry by name, with their driven joints."""
    shapes, legs = drawn(entry, T_F_P, place), []
    each = {
        key: one_each(getattr(entry, key), len(shapes), f"{place}.{key}", row=row)
        for key, row in (("stiffness", False), ("limits", True), ("diameter", False))
    }
    for k, (shape, other) in enumerate(shapes):
        # The joints and their limits, then the springs, then the leg as a file has it.
        model, names = leg_model(shape)
        main = "crank" if shape.family == "crank" else "slide"
        actuated = [main] if entry.actuated is None else entry.actuated
        _check_names(place, names, actuated=actuated, springs=entry.springs)
        _check_names(place, [*filter(main.__ne__, names)], turns=entry.turns)
        limits = {**entry.turns, main: each["limits"][k]}
        for i, name in enumerate(names):
            if (pair := limits.get(name)) is not None:
                model.lowerPositionLimit[i], model.upperPositionLimit[i] = pair
        springs = _driven(entry, actuated, each["stiffness"][k], place)
        grip = se3.inverse(T_F_P) @ shape.end_home
        model_of_leg = LegModel(
            model="by name",
            frame=END,
            grip=PoseModel(xyz=grip[:3, 3].tolist()),
            springs=springs,
            passive=[*filterfalse(springs.__contains__, names)],
            q={main: shape.home},
            flexible=entry.flexible,
            effort={} if entry.effort is None else dict.fromkeys(actuated, entry.effort),
        )
        robot, diameter = RobotDescription(model), each["diameter"][k]
        drawing = DrawnLeg(robot, shape, tuple(names), main, diameter, other)
        legs.append((model_of_leg.drawn(drawing), [n for n in names if n in actuated]))
    return legs


def _check_names(place: str, known: list[str], **named: Iterable[str]) -> None:
    """Refuse names under keys that are no joints of a leg."""
    for key, names in named.items():
        for name in names:
            check_name("joint", name, known, f"{place}.{key}")


def _driven(
    entry: NamedLegs, actuated: list[str], stiffness: float | None, place: str
) -> dict[str, JointSpringModel]:
    """Springs of an entry, with those of its driven joints."""
    springs = dict(entry.springs)
    for name in actuated:
        if stiffness is not None:
            springs.setdefault(name, JointSpringModel(stiffness=stiffness))
        elif name not in springs:
            raise InputError(
                f"driven joint {name!r} has no spring",
                where=place,
                expected="stiffness, or an entry under springs",
            )
    return springs
