"""Passes over a mechanism's robots: where they stand, and what ties them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cartstiff.arrays import Array
from cartstiff.errors import InputError, check_name
from cartstiff.geometry import se3
from cartstiff.loading.assembly import Assembly, Part, placed_frame
from cartstiff.loading.description import FileClosure, turned_axes
from cartstiff.loading.joints import leaders_note, led_joints
from cartstiff.loading.postures import leg_at_pose
from cartstiff.loading.schema import ClosureModel, pose_of
from cartstiff.mechanisms.chain import Closure
from cartstiff.mechanisms.leg_shapes import PlacedLeg
from cartstiff.mechanisms.tree import FixedFrame, KinematicTree
from cartstiff.mechanisms.tree_building import extended, merged


def joined(whole: Assembly) -> Assembly:
    """Put the robots where they stand in F, with the lines of their own files."""
    parts, lines = whole.parts, [*whole.lines]
    for part in parts:
        check_joints(part, "zeros", part.tree)
        for line in part.lines:
            frames = [part.called(name) for name in line.frames]
            lines.append(line.model_copy(update={"frames": frames}))
    tree = merged(
        [
            (p.prefix, p.tree.with_zeros(getattr(p.entry, "zeros", {})), p.base)
            for p in parts
        ]
    )
    q = np.concatenate([part.q for part in parts])
    free = tuple(whole.names(lambda part: part.free))
    frame = parts[0].frame
    return replace(whole, tree=tree, q=q, lines=tuple(lines), free=free, frame=frame)


def check_joints(part: Part, key: str, tree: KinematicTree) -> None:
    """Refuse a name under a key that is no joint of a tree."""
    names = [n.removeprefix(part.prefix) for n in tree.names if n.startswith(part.prefix)]
    for name in getattr(part.entry, key, ()):
        check_name("joint", name, names, part.key(key))


def grips(whole: Assembly) -> list[Array]:
    """Poses in M of the ends of the legs."""
    to_M = se3.inverse(pose_of(whole.file.offset))
    return [to_M @ pose_of(part.entry.grip) for part in whole.parts]


def legs_at_pose(whole: Assembly) -> Assembly:
    """Move the joints of legs to where the file's pose is.

    A leg by name is drawn there.
    """
    if whole.kind != "parallel" or whole.file.pose is None:
        return whole
    T_F_M = pose_of(whole.file.pose) @ pose_of(whole.file.offset)
    q = [
        part.q if part.entry.drawing else leg_at_pose(part, se3.inverse(grip), T_F_M)
        for part, grip in zip(whole.parts, grips(whole), strict=True)
    ]
    return replace(whole, q=np.concatenate(q))


def welded(whole: Assembly) -> Assembly:
    """Weld the ends of all legs to the body, which is fixed to the first of them."""
    if whole.kind != "parallel":
        return whole
    bodies = [f"body of leg {part.number}" for part in whole.parts]
    for body, part, grip in zip(bodies, whole.parts, grips(whole), strict=True):
        placed_frame(whole.tree, body, part.called(part.frame), se3.inverse(grip))
    leaders = whole.named(led_joints)
    led = {
        name: whole.leg_of(name).called(leaders[name][0])
        for name in whole.file.actuated
        if name in leaders
    }
    return whole.noting(
        [leaders_note(led)] if led else [],
        frame=bodies[0],
        closures=tuple(Closure(bodies[0], other, "weld") for other in bodies[1:]),
        actuated=tuple(dict.fromkeys(led.get(n, n) for n in whole.file.actuated)),
    )


def placed_legs(whole: Assembly) -> tuple[PlacedLeg, ...]:
    """Legs by name with the indices of their joints among the coordinates."""
    placed = []
    for part, grip in zip(whole.parts, grips(whole), strict=True):
        if (drawing := part.entry.drawing) is not None:
            at = {n: whole.tree.names.index(part.called(n)) for n in drawing.joints}
            columns, driven = tuple(at.values()), at[drawing.driven]
            placed.append(
                PlacedLeg(drawing.shape, columns, driven, grip, drawing.diameter)
            )
    return tuple(placed)


def closed(whole: Assembly) -> Assembly:
    """Close the loops of a closed chain: those of the robot's own file,
    then the entries.
    """
    if whole.kind != "closed-chain":
        return whole
    (part,) = whole.parts
    closing = _Closing(whole.tree, whole.q, part.entry.q)
    for i, tie in enumerate(part.ties):
        closing.add_tie(tie, i)
    for i, entry in enumerate(getattr(part.entry, "closures", ())):
        closing.add_entry(entry, i)
    actuated = tuple(getattr(part.entry, "actuated", ()))
    if part.alone:
        actuated = tuple(n for n in part.robot.actuated if n in part.tree.names)
    return replace(
        whole,
        tree=closing.tree,
        q=closing.q,
        closures=tuple(closing.closures),
        free=tuple(closing.joints),
        actuated=actuated,
    )


#: Axes of frame a about which a closure leaves joints free; synonyms of the other
#: closures.
_FREE_AXES = {"hinge": ("RX",), "universal": ("RX", "RY")}
_SYNONYMS = {"ball": "point", "rigid": "weld"}


class _Closing:
    """Adds closures to a tree, with the joints of hinges and universal joints.

    A hinge is a weld at the end of one more joint about x of frame a, a universal joint
    of two more, about x of frame a and y of frame b: five and four conditions on the
    other joints.

    Attributes
    ----------
    tree, q : KinematicTree, ndarray (n,)
        The tree with the joints added so far, and coordinates at which they nearly close.
    closures : list of Closure
    joints : list of str
        Names of the added joints.
    """

    def __init__(
        self, tree: KinematicTree, q: Array, positions: Mapping[str, float]
    ) -> None:
        self.tree, self.q, self._positions = tree, q, positions
        self.closures: list[Closure] = []
        self.joints: list[str] = []

    def add(self, name: str, a: str, b: str, kind: str) -> None:
        """Tie frame b to frame a by a joint.

        Its own coordinates are named after the closure.
        """
        if kind in _FREE_AXES:
            tree = self.tree
            joints = [(f"{name}.{axis[1].lower()}", axis) for axis in _FREE_AXES[kind]]
            R = tree.at(self.q).relative(tree.placement(a), tree.placement(b))[0]
            turns = math.atan2(R[2, 1], R[1, 1]), math.atan2(R[0, 2], R[0, 0])
            self.tree = extended(tree, a, joints, name)
            for (joint, _), turn in zip(joints, turns, strict=False):
                self.q = np.append(self.q, self._positions.get(joint, turn))
                self.joints.append(joint)
            a, kind = name, "weld"
        self.closures.append(Closure(a, b, _SYNONYMS.get(kind, kind)))  # type: ignore[arg-type]

    def add_entry(self, entry: ClosureModel, i: int) -> None:
        """Add a file's entry; without points a frame is tied to "world"
        where it is at q.
        """
        place, tree = f"key closures.{i + 1}", self.tree
        for frame in entry.frames:
            check_name("frame", frame, tree.frames, place)
        a, b = entry.frames
        if a == b:
            raise InputError("a closure ties a frame to itself", where=place, got=repr(a))
        if entry.points is None and "world" in (a, b):
            other = b if a == "world" else a
            tied = f"world (closure {i + 1})"
            T = tree.at(self.q).pose(tree.placement(other))
            if entry.axes is not None:  # these are along the axes of F
                T = se3.pose(translation=T[:3, 3])
            tree.frames[tied] = FixedFrame(0, T)
            a, b = (tied, other) if a == "world" else (other, tied)
        if entry.points is not None or entry.type in _FREE_AXES:
            names = []
            points = entry.points or [[0.0] * 3] * 2
            turns = turned_axes(entry.type, entry.axes, place)
            for frame, point, R in zip((a, b), points, turns, strict=True):
                tied = f"{frame} (closure {i + 1})"
                placed_frame(tree, tied, frame, se3.pose(R, point))
                names.append(tied)
            a, b = names
        self.add(f"closure{i + 1}", a, b, entry.type)

    def add_tie(self, tie: FileClosure, i: int) -> None:
        """Add a closure of the robot's own file."""
        a, b = f"{tie.body_a} (equality {i + 1})", f"{tie.body_b} (equality {i + 1})"
        placed_frame(self.tree, a, tie.body_a, tie.T_a)
        placed_frame(self.tree, b, tie.body_b, tie.T_b)
        self.add(f"equality{i + 1}", a, b, tie.type)
