"""The contract of a mechanism: named coordinates,
and a posture for each value of them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core.arrays import Array, checked_input, fixed
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.lazily import cached_property
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import (
    NO_POINTS,
    Evaluation,
    LineGeometry,
    Number,
    SecondOrderMap,
)
from cartstiff.core.units import SI, Units


@dataclass(frozen=True)
class Coordinate:
    """One coordinate of a mechanism: a joint angle or a distance.

    Attributes
    ----------
    name : str
        As in the mechanism's file.
    type : {"revolute", "prismatic", "helical"}
        An angle [rad], for a prismatic joint a distance.
    lower, upper : float
        Its limits, in its unit; infinite where there are none.
    """

    name: str
    type: Literal["revolute", "prismatic", "helical"]
    lower: float = -np.inf
    upper: float = np.inf

    @property
    def is_length(self) -> bool:
        """Whether the coordinate is a distance."""
        return self.type == "prismatic"

    def times(self, a: float) -> Coordinate:
        """Return it with a unit of length that is `a` times as small."""
        a = a if self.is_length else 1.0
        return replace(self, lower=a * self.lower, upper=a * self.upper)


class Skeleton(NamedTuple):
    """What a picture of a mechanism shows at a posture.

    Attributes
    ----------
    paths : list of ndarray (k, 3)
        Lines in F from point to point: along the joints to the tip, or along each leg.
    points : ndarray (m, 3)
        Points in F that a picture has to hold.
    """

    paths: list[Array]
    points: Array


class MechanismPosture(ABC):
    """A mechanism at given coordinates, with everything its potentials and the
    reduction need.
    """

    q: Array
    #: ``T_F_M`` (4, 4).
    pose: Array
    #: Map to the end-effector's pose.
    motion: SecondOrderMap
    #: Map to the closure residual, or None for a mechanism without closures.
    closure: SecondOrderMap | None = None
    #: Closure residual (m,), or None.
    residual: Array | None = None
    #: Characteristic length at this posture.
    length: float
    #: 1 for angles, `length` for distances: natural sizes of the coordinates, shape (n,).
    coordinate_lengths: Array

    #: Jacobian of the actuators' positions (m, n): rows of chosen joints, or of leg
    #: lengths; None where every coordinate is actuated.
    actuation: Array | None = None
    #: Whether the coordinates are the pose itself; its Jacobian is then that of the
    #: chart.
    coordinates_are_pose: bool = False

    @abstractmethod
    def relative(self, frame_a: str, frame_b: str) -> tuple[Array, SecondOrderMap]:
        """Return the pose ``T_a_b`` (4, 4) and its map from the coordinates to body
        twists of b.
        """

    #: The lines from the ground to the body that hold it, in M; None without.
    lines: LineGeometry | None = None

    def pose_of_frame(self, name: str) -> Array:
        """Return the pose ``T_F_b`` (4, 4) of a frame, without its map."""
        return self.pose if name == "body" else self.relative("world", name)[0]

    def drawn(self) -> Skeleton:
        """Return what a picture shows, by default a line from the base to M."""
        at = self.pose[:3, 3]
        return Skeleton([np.array([np.zeros(3), at])], at[None])

    def map_of_bounded(self, which: Sequence[int]) -> SecondOrderMap:
        """Return the map to some (k,) of what `Mechanism.bounds` limits."""
        n = self.motion.jacobian.shape[1]
        rows = np.zeros((len(which), n))
        rows[np.arange(len(which)), which] = 1.0
        return SecondOrderMap(rows, lambda _: np.zeros((n, n)))

    def legs(self, anchors: Array, points: Array) -> LineGeometry | None:  # noqa: ARG002
        """Return lines from ground to body that are known for these very
        arrays; or None.
        """
        return None

    @abstractmethod
    def gravity(self, acceleration: Array) -> Evaluation:
        """Return the potential energy of the masses in a uniform field."""

    def weights_of_lines(self, acceleration: Array) -> Array | None:  # noqa: ARG002
        """Forces (m, 3) in M by which the masses of `lines` load the body's points; None
        where they have no masses.
        """
        return None

    def cut(self) -> Any:
        """The same with all joints cut (`cartstiff.core.mechanisms.cut_joints`); None for
        a body without joints.
        """
        return None

    def mass_matrix(self) -> Array | None:
        """Mass matrix (n, n), kg and length units: kinetic energy ``1/2 dq^T M dq``;
        or None.
        """
        return None

    def momentum(self) -> tuple[Array, float] | None:
        """Linear momentum (3, n) along the axes of F per coordinate rate, in kg and the
        unit of length, and the moving mass [kg]; or None.
        """
        return None

    @abstractmethod
    def chart(self) -> SecondOrderMap | str:
        """The map to the six coordinates of K^F, or the reason why there is none."""


class Quantities(NamedTuple):
    """Limited quantities other than coordinates and the lengths of lines.

    Attributes
    ----------
    rows : list of (str, float, float, bool)
        Name, lower and upper limit of each, and whether it is an angle.
    values : callable
        ``values(q, pose)`` (..., k) at coordinates q (..., n) and poses (..., 4, 4) of M.
    """

    rows: list[tuple[str, float, float, bool]]
    values: Callable[[Array, Array], Array]


class Mechanism(ABC):
    """A mechanism, which has a posture for all values of its coordinates.

    Attributes
    ----------
    kind : str
        As in mechanism files.
    frame : str
        Name of the frame of interest M.
    coordinates : tuple of Coordinate
        In the order of q.
    """

    kind: str
    frame: str
    coordinates: tuple[Coordinate, ...]
    units: Units = SI
    #: ``T_F_B`` (4, 4): the base frame B of the robot's controller in the room F.
    base_pose: Array = fixed(np.eye(4))
    #: ``T_L_M`` (4, 4): M in the link's frame that `frame` names.
    frame_offset: Array = fixed(np.eye(4))
    #: Rigid coordinates, which no load moves.
    rigid: frozenset[int] = frozenset()
    #: Coordinates without an actuator, to which a single stiffness for all joints does
    #: not apply.
    undriven: frozenset[int] = frozenset()
    #: Coordinates that are no joints: deflections of compliant links.
    virtual: frozenset[int] = frozenset()
    #: Coordinates with actuators; None if they are not stated.
    actuated: tuple[int, ...] | None = None
    #: Loop closures of a chain.
    closures: tuple[Any, ...] = ()
    #: Coordinates that `closed` holds if the others can close the mechanism.
    held: Sequence[int] = ()
    #: Whether the coordinates are the pose of the body, (x, y, z, roll, pitch, yaw).
    coordinates_are_pose: bool = False
    #: Ends (m, 3) of the lines that hold the body, in F and in M; none for joints.
    anchors: Array = NO_POINTS
    points: Array = NO_POINTS
    #: Whether these are legs of a robot, not springs that may be soft.
    has_legs: bool = False
    #: Whether its joints form a tree without closures, each with a coordinate of its own.
    is_open_tree: bool = False
    #: Positions of the joints (m, n) per coordinate, where some follow others; else None.
    mimic: Array | None = None
    #: The file's posture, closed, of a chain with closures.
    home: Any = None
    #: Name of a joint whose placement moves the whole mechanism against F alone.
    root: str = ""
    #: Sum of the ways along an arm to M; None for others.
    reach: float | None = None
    #: Least and largest tension (m, 2) of each such line; None without limits.
    tension_limits: Array | None = None
    #: Whether it is one of many that share a program and differ in their points.
    is_one_of_many: bool = False

    def with_rigid(self, rigid: frozenset[int]) -> Mechanism:
        """Return the mechanism with other rigid coordinates.

        Raises
        ------
        InputError
            If its coordinates are no joints.
        """
        raise InputError(
            f"coordinates of kind {self.kind} cannot be rigid", got=sorted(rigid)
        )

    @abstractmethod
    def at(self, q: ArrayLike) -> MechanismPosture:
        """Return the posture at coordinates q (n,)."""

    def closed(
        self,
        q_start: ArrayLike,
        *,
        named: Sequence[int] | None = None,  # noqa: ARG002
        hold: Sequence[int] | None = None,  # noqa: ARG002
    ) -> MechanismPosture:
        """The posture near `q_start` that satisfies the closures; at it without closures.

        The `named` coordinates are held if the others can close the mechanism, those in
        `hold` always.
        """
        return self.at(q_start)

    def adjusted(
        self,
        given: Array,  # noqa: ARG002
        q: Array,  # noqa: ARG002
        named: Sequence[int] | None = None,  # noqa: ARG002
    ) -> tuple[Note, ...]:
        """A note on coordinates that closing moved from given values (n,) to q (n,).

        Only coordinates that were `named` or are actuated are considered; without any,
        those that differ from the mechanism's reference posture.
        """
        return ()

    def assembled(self, q_start: ArrayLike) -> Array:
        """Return coordinates (n,) near `q_start` that satisfy the closures."""
        return self.closed(q_start).q

    def frames_as_dict(self) -> dict[str, Any]:
        """Return the frame, M in it, and the robot's base in F, for JSON."""
        return {
            "frame": self.frame,
            "frame_offset": self.frame_offset.tolist(),
            "base_pose": self.base_pose.tolist(),
        }

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Lower and upper limits of coordinates or lengths by name; infinite where there
        is none.
        """
        return {c.name: (c.lower, c.upper) for c in self.coordinates}

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames that potentials can act between."""
        return ("world", "body")

    def masses(self) -> dict[str, float]:
        """Masses [kg] that the coordinates move, by link, and of the "payload"."""
        return {}

    def with_mass(self, mass: float, centre: Array) -> Mechanism:  # noqa: ARG002
        """Return the mechanism with a point mass [kg] added at a point of M, `centre`
        (3,).

        Raises
        ------
        InputError
            If it has no masses.
        """
        raise InputError(f"mechanisms of kind {self.kind} carry no payload", got=mass)

    def with_masses(self, masses: Mapping[str, float]) -> Mechanism:
        """Return the mechanism with other masses [kg] by name at the same mass centres.

        Raises
        ------
        InputError
            If it has no masses.
        """
        raise InputError(
            f"mechanisms of kind {self.kind} have no masses", got=dict(masses)
        )

    def quantities(self) -> list[Quantities]:
        """Return what has limits beside `bounds`, as angles of ball joints."""
        return []

    def bounded(self, q: Array, pose: Array) -> Array:  # noqa: ARG002
        """Return what `bounds` limits, (..., k), at coordinates (..., n) and poses
        (..., 4, 4).
        """
        return q

    def coordinates_of(self, T_F_M: ArrayLike) -> Array:  # noqa: ARG002
        """Return coordinates (..., 6) from poses of M, where these are the same.

        Raises
        ------
        InputError
            If `coordinates_are_pose` is false.
        """
        raise InputError("coordinates are no pose", got=self.kind)

    def closed_as_given(self, q: Array) -> Array:
        """Close those of coordinates (N, n) of which a part was given;
        none without closures.
        """
        return q

    def forward_kinematics(self, lengths: ArrayLike, start: ArrayLike) -> Array:  # noqa: ARG002
        """Return coordinates (n,) near `start` (n,) at which the lines that hold the body
        have lengths.

        Raises
        ------
        InputError
            Without such lines.
        """
        raise InputError("leg lengths are for platforms", got=self.kind)

    def as_one_of_many(self) -> Self:
        """Return a copy for computing many that differ in their points,
        where that is quicker.
        """
        return self

    def numbers(self) -> dict[str, Number]:
        """Return the numbers that can be changed, by name: masses, placements, points."""
        return {}

    def with_numbers(self, values: Mapping[str, float]) -> Self:  # noqa: ARG002
        """Return the mechanism with some of `numbers` changed."""
        return self

    def in_units(self, a: float, units: Units) -> Self:
        """Return the same with all lengths times `a`; by default those of `numbers`.

        Raises
        ------
        InputError
            If it has none.
        """
        if not (own := self.numbers()):
            raise InputError(
                "is not converted to other units", where="units", got=self.kind
            )
        each = {name: x.value * a**x.length for name, x in own.items()}
        other = copy(self.with_numbers(each))
        other.units = units
        other.coordinates = tuple(c.times(a) for c in self.coordinates)
        return other

    @property
    def frames_of_body(self) -> list[str]:
        """Names of the frames that may take the place of M,
        the present one among them.
        """
        return [self.frame]

    def with_frame(self, name: str) -> Mechanism:
        """Return the mechanism with M at another of `frames_of_body`.

        Raises
        ------
        UnknownNameError
            For any other name.
        """
        raise UnknownNameError("frame", name, self.frames_of_body)

    def screws(self) -> Array:
        """Return the twists (m, 6) of the joints of a tree, each in its own frame."""
        return np.zeros((0, 6))

    def displaced(self, q: Array, step: Array) -> Array:
        """Return coordinates (n,) after a small step (n,) in the coordinates of the
        derivatives.
        """
        return q + step

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(c.name for c in self.coordinates)

    @cached_property
    def is_length(self) -> NDArray[np.bool_]:
        """Which coordinates are distances, and no angles (n,)."""
        return np.array([c.is_length for c in self.coordinates], bool)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the coordinates without the deflections of compliant links."""
        return tuple(name for j, name in enumerate(self.names) if j not in self.virtual)

    @property
    def shapes_of_rows(self) -> list[tuple[int | str, ...]]:
        """Shapes of tables of postures: all coordinates, or joint positions alone."""
        return [("m", n) for n in dict.fromkeys((len(self.names), len(self.joint_names)))]

    def undeflected(self, rows: Array) -> Array:
        """Return coordinates (..., n) from joint positions (..., m), without link
        deflections.

        `rows` (..., n) of all coordinates are returned as they are.
        """
        if rows.shape[-1] == len(self.names):
            return rows
        at = [j - k for k, j in enumerate(sorted(self.virtual))]
        return np.insert(rows, at, 0.0, axis=-1)

    def checked(self, q: ArrayLike, what: str = "q") -> Array:
        """Check coordinates (n,), or positions of the joints alone; return the former.
        The message calls them `what`.

        Raises
        ------
        InputError
            For a wrong count, text, NaN or infinity.
        """
        n, joints = len(self.coordinates), len(self.coordinates) - len(self.virtual)
        if self.virtual and np.shape(q) == (joints,):
            return self.undeflected(checked_input(q, (joints,), what))
        return checked_input(q, (n,), what)
