"""A mechanism on its way from files: robots, and what a mechanism file says of them.

A `Part` is one robot and becomes a tree of joints; an `Assembly` has one part, or one for
each leg, and becomes an `ElasticMechanism`. Passes (`cartstiff.files.passes`) do this
step by step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isnan
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.chain import Chain, Closure
from cartstiff.core.mechanisms.tree import FixedFrame, KinematicTree
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.potentials.joint_springs import JointSprings
from cartstiff.core.units import SI, Units
from cartstiff.files.bare import pose_of
from cartstiff.files.description import FileClosure, RobotDescription
from cartstiff.files.flexible_links import Give

if TYPE_CHECKING:
    from cartstiff.files.schema import LineModel

Kind = Literal["serial", "closed-chain", "parallel"]
_LATER: Any = None  # what a pass sets


class _Noted:
    """What passes add notes to."""

    notes: tuple[Note, ...]

    def noting(self, notes: Sequence[Note], **changes: Any) -> Self:
        """Return it with more notes, and changed."""
        return replace(self, notes=(*self.notes, *notes), **changes)  # type: ignore[type-var]


@dataclass(frozen=True)
class Part(_Noted):
    """One robot, and what a mechanism file says of it.

    Attributes
    ----------
    entry : SerialFile, ClosedChainFile or LegModel
        The file's keys of the robot.
    robot : RobotDescription
        The robot as its reader returned it.
    kind : str
        Kind of the mechanism. The loops of a robot are closed in a "closed-chain" only.
    number : int
        Number of the leg, from 1; 0 where there is one robot only.
    alone : bool
        Whether there is no mechanism file: the robot's loops are closed where they move
        the frame, joints that do not move it are left out, and its own actuators drive
        it.
    posture : mapping of str to float
        Default positions by coordinate, for those that are not in the entry.
    notes : tuple of Note
    keys : frozenset of str
        Keys that the entry has in the file.
    has_rest : bool
        Whether the entry or the robot's own file says where a spring is at rest.
    frame : str
        Frame of interest, or the end of a leg.
    lines : tuple of LineModel
        Line springs of the entry, and those of the robot's own file that act.
    ties : tuple of FileClosure
        Loops of the robot's own file that are closed.
    tree, q : KinematicTree, ndarray (n,)
        The joints that were kept, and their default posture.
    beyond : tuple of str
        Joints that do not move the frame.
    idle : tuple of str
        Those of them that have springs in the entry.
    free : tuple of str
        Joints of a contact without a spring.
    """

    entry: Any
    robot: RobotDescription
    kind: Kind = "serial"
    number: int = 0
    alone: bool = False
    posture: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    keys: frozenset[str] = frozenset()
    has_rest: bool = False
    frame: str = ""
    lines: tuple[LineModel, ...] = ()
    ties: tuple[FileClosure, ...] = ()
    tree: KinematicTree = _LATER
    q: Array = _LATER
    beyond: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()
    free: tuple[str, ...] = ()

    @classmethod
    def of(cls, entry: Any, robot: RobotDescription, **more: Any) -> Part:
        """Return a robot with an entry as it was read."""
        rests = [spring.rest for spring in entry.springs.values()]
        own = [spring.rest for spring in robot.springs.values()]
        return cls(
            entry,
            robot,
            more.pop("kind", entry.kind),
            keys=frozenset(entry.model_fields_set),
            has_rest=any(x is not None for x in rests) or not all(map(isnan, own)),
            lines=tuple(getattr(entry, "lines", ())),
            **more,
        )

    @property
    def prefix(self) -> str:
        """Stands before the names of the robot in the mechanism."""
        return f"leg{self.number}/" if self.number else ""

    @property
    def leg(self) -> str:
        """Which robot it is, for messages; empty for the only one."""
        return f"leg {self.number}" if self.number else ""

    @property
    def place(self) -> str:
        """Place of its entry, for messages; empty for the only one."""
        return f"key legs.{self.number}" if self.number else ""

    @property
    def base(self) -> Array:
        """Pose of the robot's root in F."""
        base = getattr(self.entry, "base", None)
        return np.eye(4) if base is None else pose_of(base)

    def says(self, words: str) -> str:
        """Words of a note that name the leg."""
        return f"{self.leg}: {words}" if self.leg else words

    def key(self, name: str) -> str:
        """Place of a key, for messages."""
        return f"{self.place}.{name}" if self.place else f"key {name}"

    def called(self, name: str) -> str:
        """Name in the mechanism of a joint or frame of the robot."""
        return self.prefix + name

    def gives(self) -> dict[str, Give]:
        """Compliant links by name."""
        return {name: give_of(link) for name, link in self.entry.flexible.items()}

    def virtual(self) -> list[str]:
        """Names in the mechanism of the virtual joints of compliant links."""
        return [
            self.called(f"{link}.{suffix}")
            for link, give in self.gives().items()
            for suffix, _, _ in give.joints
        ]


def give_of(entry: Any) -> Give:
    """Virtual joints of a compliant link."""
    start, beam = pose_of(entry.offset), entry.beam
    if beam is None:
        return Give(start, mass=None if entry.mass is None else np.array(entry.mass))
    own = None
    if beam.density > 0.0:
        own = beam.density * beam.area, beam.density * beam.Iy, beam.density * beam.Iz
    return Give(start, beam.length, beam.segments, own)


@dataclass(frozen=True)
class Assembly(_Noted):
    """Robots with what ties them and acts on them.

    Attributes
    ----------
    file : SerialFile, ClosedChainFile or ParallelFile
        Keys of the mechanism as a whole: payload, gravity, offset, actuated, pose.
    name : str
    parts : tuple of Part
    notes : tuple of Note
    tree, q : KinematicTree, ndarray (n,)
        All joints, and the default posture.
    frame : str
        Frame to which M is fixed.
    lines : tuple of LineModel
        Line springs between frames of the mechanism.
    closures : tuple of Closure
        Loops.
    free : tuple of str
        Joints of contacts and closures, which need no spring.
    actuated : tuple of str
        Joints that drive the loops.
    chain : Chain
        The mechanism.
    springs, potentials : JointSprings, tuple of Potential
        Springs in the joints, and everything else that stores energy.
    damping : ndarray (n,) or None
        Dampers in the joints.
    efforts : mapping of str to (float, float)
        Least and largest torque (force) of the joints' drives.
    """

    file: Any
    name: str
    parts: tuple[Part, ...]
    notes: tuple[Note, ...] = ()
    tree: KinematicTree = _LATER
    q: Array = _LATER
    frame: str = ""
    lines: tuple[LineModel, ...] = ()
    closures: tuple[Closure, ...] = ()
    free: tuple[str, ...] = ()
    actuated: tuple[str, ...] = ()
    chain: Chain = _LATER
    springs: JointSprings = _LATER
    potentials: tuple[Potential, ...] = ()
    damping: Array | None = None
    efforts: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def kind(self) -> Kind:
        """Kind of the mechanism."""
        return self.parts[0].kind

    @property
    def units(self) -> Units:
        """Units of the file's numbers: legs by name may be drawn in others than SI."""
        given = getattr(self.file, "units", None)
        return Units(given.length, given.force) if given else SI

    def named(self, values: Callable[[Part], Mapping[str, Any]]) -> dict[str, Any]:
        """Values of all parts by the joints' names in the mechanism."""
        return {
            part.called(name): value
            for part in self.parts
            for name, value in values(part).items()
        }

    def names(self, some: Callable[[Part], Sequence[str]]) -> list[str]:
        """Names of joints of all parts, as the mechanism has them."""
        return [part.called(name) for part in self.parts for name in some(part)]

    def key(self, key: str, name: str) -> str:
        """Place of the entry of a joint under a key, for messages."""
        part = self.leg_of(name)
        return part.key(f"{key}.{name.removeprefix(part.prefix)}")

    def leg_of(self, name: str) -> Part:
        """Return the robot of a joint or frame of the mechanism."""
        return next(part for part in self.parts if name.startswith(part.prefix))

    def virtual(self) -> list[str]:
        """Names of the virtual joints of compliant links."""
        return [name for part in self.parts for name in part.virtual()]


def placed_frame(tree: KinematicTree, name: str, base: str, T: Array) -> None:
    """Add a frame at T in another one."""
    at = tree.placement(base)
    tree.frames[name] = FixedFrame(at.joint, at.T_j_f @ T)
