"""Legs by name become joints: a Pinocchio model for each leg, drawn where the body is at home."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.keys.springs import JointSpringModel
from cartstiff.loading.keys.words import PoseModel, pose_of
from cartstiff.loading.legs.drawing import drawn, one_each
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.loading.schema import LegModel, NamedLegs, ParallelFile
from cartstiff.mechanisms.leg_shapes import LegShape, frame_along

#: Where a leg ends: on the body, in its directions at home.
END = "end"


@dataclass(frozen=True, eq=False)
class DrawnLeg:
    """What a leg by name has been drawn as.

    Attributes
    ----------
    description : RobotDescription
        Its joints.
    shape : LegShape
        Its numbers.
    joints : tuple of str
        Names of its joints, from the ground to the body.
    driven : str
        The joint whose coordinate is the shape's.
    diameter : float or None
        Of its rod.
    """

    description: RobotDescription
    shape: LegShape
    joints: tuple[str, ...]
    driven: str
    diameter: float | None = None


class _Drawing:
    """A leg's joints, one by one, each with its frame in F at home."""

    def __init__(self) -> None:
        self.model = pin.Model()
        self.joint, self.frame = 0, 0
        self.T = np.eye(4)
        self.names: list[str] = []
        self._numbers = {letter: count(1) for letter in "urs"}

    def turn(
        self, letter: str, axis: Array, T_home: Array, at_home: float = 0.0, name: str | None = None
    ) -> None:
        """A revolute joint about an axis in F; at `at_home` it stands in a frame."""
        own = T_home[:3, :3].T @ axis
        own = own / np.linalg.norm(own)
        back = se3.exp(np.concatenate([-at_home * own, np.zeros(3)]))
        name = name or f"{letter}{next(self._numbers[letter])}"
        self._add(name, pin.JointModelRevoluteUnaligned(own), T_home, back)

    def slide(self, T_home: Array, at_home: float) -> None:
        """A prismatic joint along x of a frame, in which it stands at `at_home`."""
        self._add("slide", pin.JointModelPX(), T_home, se3.pose(translation=(-at_home, 0.0, 0.0)))

    def _add(self, name: str, joint: Any, T_home: Array, back: Array) -> None:
        placement = se3.inverse(self.T) @ T_home @ back
        self.joint = self.model.addJoint(self.joint, joint, pin.SE3(placement), name)
        self.frame = int(self.model.addJointFrame(self.joint, self.frame))
        self.names.append(name)
        self.T = T_home

    def link(self, name: str, T_home: Array | None = None) -> None:
        """A link's frame, fixed to the last joint."""
        T = np.eye(4) if T_home is None else se3.inverse(self.T) @ T_home
        self.frame = int(
            self.model.addFrame(
                pin.Frame(name, self.joint, self.frame, pin.SE3(T), pin.FrameType.BODY)
            )
        )


def _universal(
    drawing: _Drawing, letter: str, T: Array, axes: tuple[Array, ...], frame: Array
) -> None:
    """A hinge, a universal joint or a ball at a point."""
    if letter == "S":
        axes = (frame[:, 0], frame[:, 1], frame[:, 2])
    for axis in axes:
        drawing.turn(letter.lower(), axis, T)


def leg_model(shape: LegShape) -> tuple[Any, list[str]]:
    """Pinocchio's model of a leg whose shape is at home, and the names of its joints."""
    drawing = _Drawing()
    T_rod = se3.pose(shape.rod_frame, shape.centre)
    if shape.family == "rail":
        helper = np.eye(3)[int(np.argmin(np.abs(shape.along)))]
        drawing.slide(se3.pose(frame_along(shape.along, helper), shape.centre), shape.home)
        drawing.link("slider")
    elif shape.family == "crank":
        arm = frame_along(shape.centre - shape.anchor, shape.axis)
        drawing.turn("", shape.axis, se3.pose(arm, shape.anchor), shape.home, "crank")
        drawing.link("crank")
    axes = (shape.axis, shape.universal[1]) if shape.middle == "U" else (shape.axis,)
    _universal(drawing, shape.middle, T_rod, axes, shape.rod_frame)
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
        axes = (shape.end_inner, shape.end_axis) if shape.end == "U" else (shape.end_axis,)
        _universal(drawing, shape.end, se3.pose(shape.rod_frame, B), axes, shape.end_home[:3, :3])
    drawing.link(END, shape.end_home)
    return drawing.model, drawing.names


def with_drawn_legs(file: ParallelFile, where: str) -> ParallelFile:
    """The file with its legs by name drawn, one entry for each; itself where it has none."""
    entries = file.legs if isinstance(file.legs, list) else [file.legs]
    if not any(isinstance(entry, NamedLegs) for entry in entries):
        return file
    if file.pose is None:
        raise InputError(
            "key 'pose' is missing",
            where=where,
            expected="where the body is: legs by name are drawn there",
        )
    legs: list[LegModel] = []
    driven: list[str] = []
    for i, entry in enumerate(entries):
        place = where if entry is file.legs else f"{where}, leg {i + 1}"
        if not isinstance(entry, NamedLegs):
            legs.append(entry)
            continue
        for leg, names in _legs(entry, pose_of(file.pose), place):
            legs.append(leg)
            driven += [f"leg{len(legs)}/{name}" for name in names]
    return file.model_copy(update={"legs": legs, "actuated": file.actuated or driven})


def drawn_legs(file: ParallelFile) -> list[LegModel]:
    """The legs of a file in which all have been drawn."""
    entries = file.legs if isinstance(file.legs, list) else []
    return [entry for entry in entries if isinstance(entry, LegModel)]


def _legs(entry: NamedLegs, T_F_P: Array, where: str) -> list[tuple[LegModel, list[str]]]:
    """Entries of the legs that a name stands for, with their driven joints."""
    shapes = drawn(entry, T_F_P, where)
    m = len(shapes)
    stiffness = one_each(entry.stiffness, m, "stiffness", where)
    ranges: Any = entry.limits
    one = ranges is None or not isinstance(ranges[0], list)
    limits = [ranges] * m if one else one_each(ranges, m, "limits", where)
    legs = []
    diameters = one_each(entry.diameter, m, "diameter", where)
    for shape, k, limit, diameter in zip(shapes, stiffness, limits, diameters, strict=True):
        model, names = leg_model(shape)
        main = "crank" if shape.family == "crank" else "slide"
        actuated = [main] if entry.actuated is None else entry.actuated
        others = [name for name in names if name != main]
        for key, entries, known in (
            ("actuated", actuated, names),
            ("springs", entry.springs, names),
            ("turns", entry.turns, others),
        ):
            for name in entries:
                if name not in known:
                    raise UnknownNameError("joint", name, known, where=f"{where}, key legs.{key}")
        limited = {name: ("turns", pair) for name, pair in entry.turns.items()}
        if limit is not None:
            limited[main] = "limits", limit
        lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        for name, (key, pair) in limited.items():
            if pair[0] > pair[1]:
                raise InputError(
                    "limits are the wrong way round",
                    expected="[least, most]",
                    where=f"{where}, key legs.{key}",
                    got=pair,
                )
            lower[names.index(name)], upper[names.index(name)] = pair
        model.lowerPositionLimit, model.upperPositionLimit = lower, upper
        springs = dict(entry.springs)
        for name in actuated:
            if k is not None:
                springs.setdefault(name, JointSpringModel(stiffness=k))
            elif name not in springs:
                raise InputError(
                    f"driven joint {name!r} has no spring",
                    where=f"{where}, key legs",
                    expected="stiffness, or an entry under springs",
                )
        grip = se3.inverse(T_F_P) @ shape.end_home
        leg = LegModel(
            model="by name",
            frame=END,
            grip=PoseModel(xyz=grip[:3, 3].tolist()),
            springs=springs,
            passive=[n for n in names if n not in springs],
            q={main: shape.home},
            flexible=entry.flexible,
        )
        description = RobotDescription(None, model)
        drawing = DrawnLeg(description, shape, tuple(names), main, diameter)
        legs.append((leg.drawn(drawing), [n for n in names if n in actuated]))
    return legs
