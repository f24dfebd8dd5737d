"""The description of a robot that readers of all formats return, and its parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, one_line
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Description
from cartstiff.core.notes import Note

if TYPE_CHECKING:
    from cartstiff.core.mechanisms.shapes import Piece
    from cartstiff.files.schema import CoupledSpringModel, LineModel

#: Begins the description of actuators that are springs on request.
POSITION_ACTUATORS = "position actuators of joints"


Followers = dict[str, tuple[str, float, float]]
"""Follower -> (leader, factor, offset): position = factor * leader's + offset."""


@dataclass(frozen=True)
class FileSpring:
    """Spring of a hinge or slide: torque ``c_1 x + c_2 x^2 + ...`` at x beyond its
    rest position.

    Attributes
    ----------
    coefficients : tuple of float
        N m/rad, N m/rad^2, ... (N/m, ... for a slide); at least the first.
    rest : float
        Rest position.
    """

    coefficients: tuple[float, ...]
    rest: float


@dataclass(frozen=True, eq=False)
class FileClosure:
    """A loop that the file closes: frame a coincides with frame b,
    or shares a point with it.

    Attributes
    ----------
    type : {"point", "weld", "hinge", "universal"}
        Kind of closure; a hinge is about x of both frames, a universal joint about x of a
        and y of b.
    body_a, body_b : str
        The bodies.
    T_a, T_b : ndarray, shape (4, 4)
        The tied frames in them.
    joints : frozenset of str
        Coordinates on the way from one to the other.
    """

    type: Literal["point", "weld", "hinge", "universal"]
    body_a: str
    body_b: str
    T_a: Array
    T_b: Array
    joints: frozenset[str]


def turned_axes(
    kind: str, axes: Sequence[Sequence[float]] | None, where: str
) -> list[Array]:
    """Return rotations of a closure's two frames after which its axes are x of a,
    and x or y of b.

    Raises
    ------
    InputError
        For an axis without direction.
    """
    if kind not in ("hinge", "universal"):
        return [np.eye(3)] * 2
    hinge = kind == "hinge"
    rows = np.array(axes or ([[0, 0, 1]] * 2 if hinge else [[1, 0, 0], [0, 1, 0]]), float)
    if not rows.any(axis=1).all():
        raise InputError("an axis has no direction", where=where, got=rows.tolist())
    from cartstiff.kinematics.leg_shapes import frame_along

    a, b = frame_along(rows, np.eye(3)[np.abs(rows).argmin(axis=1)])
    return [a, b if hinge else np.roll(b, 1, axis=1)]


@dataclass(frozen=True)
class Obstacle:
    """Something in a file that cannot be used: refused where one of its joints
    moves the frame.

    Attributes
    ----------
    what : str
        Its name, for messages.
    joints : frozenset of str
        Coordinates that it acts on.
    expected : str
        The text that replaces it.
    keys : tuple of str
        Keys of a mechanism file that replace it: where one is given, nothing is refused.
    error : InputError or None
        The refusal, where something is wrong with a single joint.
    """

    what: str
    joints: frozenset[str]
    expected: str = (
        "springs of hinges and slides; "
        "connect, weld and joint equalities in a closed chain"
    )
    keys: tuple[str, ...] = ()
    error: InputError | None = None

    def refusal(self, moving: set[str], path: Path | None) -> InputError:
        """Return the refusal of a file in which it acts on one of some joints."""
        affected = min(self.joints & moving)
        return self.error or InputError(
            f"{self.what} acts on joint {affected!r} and cannot be expressed here",
            where="XML text" if path is None else one_line(str(path)),
            expected=self.expected,
        )


@dataclass(frozen=True, eq=False)
class Lifted:
    """Gravity compensation: the part of a body's mass that weighs nothing,
    at a point of it.
    """

    body: str
    mass: float
    point: Array


@dataclass(frozen=True, eq=False)
class RobotDescription:
    """A robot as a reader returns it, whatever the format: lengths in m, angles in rad,
    kg, N.

    Bodies, joints, frames and masses are Pinocchio's; everything else stands beside them.

    Attributes
    ----------
    model : pinocchio.Model
        As the file has it, all joints free.
    path : Path or None
        The file, if there is one.
    pieces : tuple of Piece or None
        Shapes of the links, where they are not read from the file.
    held : frozenset of str
        Joints that stay at their neutral position.
    text : str or None
        The XML, where it differs from the file's contents.
    packages : tuple of Path
        Folders in which package:// names are searched first.
    springs : dict of str to FileSpring
        Springs by coordinate.
    passive : tuple of str
        Coordinates that have no spring and need none: of free bodies, and joints within
        closed loops that other joints hold.
    loose : frozenset of str
        Free-flying joints that no closure holds, as joints of the model.
    actuated : tuple of str
        Coordinates that an actuator drives.
    lines : tuple of (LineModel, frozenset of str)
        Tendons that are line springs, and coordinates that change their lengths.
    coupled : tuple of CoupledSpringModel
        Fixed tendons, which are springs that couple joints.
    actuators : dict of str to float
        Stiffness of the position actuators' control by coordinate, N m/rad or N/m.
    efforts : dict of str to (float, float)
        Least and largest torque (force) of the drives by coordinate.
    followers : dict of str to (str, float, float)
        Coupled joints: leader, factor, offset.
    locked : dict of str to float
        Joints that an equality holds at a position.
    closures : tuple of FileClosure
        Active equality constraints between bodies.
    posture : dict of str to float
        Positions by coordinate: the keyframe's, else the file's own.
    keyframe : str or None
        Name of the keyframe that the posture comes from.
    gravity : ndarray (3,) or None
        The file's acceleration of gravity; None where it is switched off.
    lifted : tuple of Lifted
        Gravity compensation.
    planar_axes : dict of str to ndarray (3,)
        Normals of the planes in which planar joints move, where they are not z.
    notes : tuple of Note
        Notes of the reader.
    obstacles : tuple of Obstacle
        Parts that cannot be expressed, and faulty joints.
    ignored : tuple of str
        Names of parts without effect on statics.
    weightless : tuple of str
        Descriptions of bodies without mass, and of missing meshes on which masses depend.
    """

    model: Any
    path: Path | None = None
    pieces: tuple[Piece, ...] | None = None
    held: frozenset[str] = frozenset()
    text: str | None = None
    packages: tuple[Path, ...] = ()
    springs: dict[str, FileSpring] = field(default_factory=dict)
    passive: tuple[str, ...] = ()
    loose: frozenset[str] = frozenset()
    actuated: tuple[str, ...] = ()
    lines: tuple[tuple[LineModel, frozenset[str]], ...] = ()
    coupled: tuple[CoupledSpringModel, ...] = ()
    actuators: dict[str, float] = field(default_factory=dict)
    efforts: dict[str, tuple[float, float]] = field(default_factory=dict)
    followers: Followers = field(default_factory=dict)
    locked: dict[str, float] = field(default_factory=dict)
    closures: tuple[FileClosure, ...] = ()
    posture: dict[str, float] = field(default_factory=dict)
    keyframe: str | None = None
    gravity: Array | None = None
    lifted: tuple[Lifted, ...] = ()
    planar_axes: dict[str, Array] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    ignored: tuple[str, ...] = ()
    weightless: tuple[str, ...] = ()

    @property
    def leaders(self) -> Followers:
        """The joint that leads each follower in the end, with factor and offset."""
        return {name: to_root(name, self.followers) for name in self.followers}

    def shown(self, prefix: str = "") -> Description:
        """Return how its links look; `prefix` precedes their names."""
        return Description(self.path, prefix, self.pieces, self.text, self.packages)


def successive_turns(T: Array) -> Array:
    """Return the angles (3,) of turns about x, the new y and the new z that make a
    pose's rotation.

    These are the coordinates in the place of a ball joint.
    """
    # Without round-off, the third turn is zero where the second is a right angle.
    return 0.0 - se3.roll_pitch_yaw(np.round(se3.inverse(T), 15) + 0.0)


def to_root(follower: str, followers: Followers) -> tuple[str, float, float]:
    """Return the joint that leads a chain of followers, with factor and offset."""
    leader, factor, offset = followers[follower]
    while leader in followers:
        leader, more, shift = followers[leader]
        factor, offset = factor * more, offset + factor * shift
    return leader, factor, offset


def on_leaders(
    springs: dict[str, FileSpring], followers: Followers
) -> tuple[dict[str, FileSpring], list[Obstacle]]:
    """Move the springs of followers to their leaders.

    Nonlinear ones are returned as obstacles.
    """
    springs, others = dict(springs), []
    for follower in [name for name in followers if name in springs]:
        spring, (leader, factor, offset) = (
            springs.pop(follower),
            to_root(follower, followers),
        )
        own = springs.get(leader, FileSpring((0.0,), 0.0))
        if len(spring.coefficients) + len(own.coefficients) > 2:
            both = frozenset({follower, leader})
            others.append(
                Obstacle(f"curved spring of the coupled joint {follower!r}", both)
            )
            continue
        k, more = own.coefficients[0], spring.coefficients[0] * factor**2
        if more > 0.0:  # none of a follower that stays where it is
            rest = (k * own.rest + more * (spring.rest - offset) / factor) / (k + more)
            springs[leader] = FileSpring((k + more,), rest)
    return springs, others
