"""What an MJCF file says beside kinematics and masses, as values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from cartstiff.geometry.se3 import Array


@dataclass(frozen=True)
class MjcfSpring:
    """Spring of a hinge or slide: torque ``c_1 x + c_2 x^2 + ...`` at x beyond its rest position.

    Attributes
    ----------
    coefficients : tuple of float
        N m/rad, N m/rad^2, ... (N/m, ... for a slide); at least the first.
    rest : float
        Rest position.
    """

    coefficients: tuple[float, ...]
    rest: float


@dataclass(frozen=True)
class MjcfClosure:
    """A ``connect`` (point) or ``weld`` equality: frame a coincides with frame b.

    Attributes
    ----------
    type : {"point", "weld"}
        What is tied.
    body_a, body_b : str
        The bodies.
    T_a, T_b : ndarray, shape (4, 4)
        The tied frames in them.
    joints : frozenset of str
        Coordinates on the way from one to the other.
    """

    type: Literal["point", "weld"]
    body_a: str
    body_b: str
    T_a: Array
    T_b: Array
    joints: frozenset[str]


@dataclass(frozen=True)
class Obstacle:
    """Something that acts in MuJoCo and has no counterpart here, and the joints that feel it."""

    what: str
    joints: frozenset[str]


@dataclass(frozen=True)
class Lifted:
    """Gravity compensation: the part of a body's mass that weighs nothing, at a point of it."""

    body: str
    mass: float
    point: Array


@dataclass(frozen=True)
class MjcfFacts:
    """What an MJCF file says beside kinematics and masses.

    Attributes
    ----------
    springs : dict of str to MjcfSpring
        By coordinate.
    passive : tuple of str
        Coordinates that have no spring and need none: of free bodies, and joints within closed
        loops that other joints hold.
    loose : frozenset of str
        Coordinates of free bodies that no closure holds.
    actuated : tuple of str
        Coordinates that an actuator drives.
    followers : dict of str to (str, float, float)
        Coupled joints: leader, factor, offset.
    locked : dict of str to float
        Joints that an equality holds at a position.
    closures : tuple of MjcfClosure
        Active equality constraints between bodies.
    posture : dict of str to float
        The keyframe's, else the file's own, by coordinate.
    keyframe : str or None
        Name of the keyframe that the posture comes from.
    gravity : ndarray (3,) or None
        The file's, None where it is switched off.
    lifted : tuple of Lifted
        Gravity compensation.
    obstacles : tuple of Obstacle
        What the engine cannot express.
    ignored : tuple of str
        Things in the file that play no part in statics, in words.
    weightless : tuple of str
        In words: bodies without mass, meshes that masses depend on and that are missing.
    """

    springs: dict[str, MjcfSpring] = field(default_factory=dict)
    passive: tuple[str, ...] = ()
    loose: frozenset[str] = frozenset()
    actuated: tuple[str, ...] = ()
    followers: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    locked: dict[str, float] = field(default_factory=dict)
    closures: tuple[MjcfClosure, ...] = ()
    posture: dict[str, float] = field(default_factory=dict)
    keyframe: str | None = None
    gravity: Array | None = None
    lifted: tuple[Lifted, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    ignored: tuple[str, ...] = ()
    weightless: tuple[str, ...] = ()
