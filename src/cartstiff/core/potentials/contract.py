r"""Interfaces: a potential, and the posture at which it is evaluated.

A posture has *maps* of its coordinates (to the end-effector's pose, between any two
frames, to the closure residual): the first derivative is a Jacobian, the second
derivative is contracted with a covector. A potential returns energy, gradient and Hessian
in the same coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, ClassVar, NamedTuple, Protocol, Self, TypeVar

import numpy as np

from cartstiff.core.arrays import Array, read_only
from cartstiff.core.errors import InputError
from cartstiff.core.notes import Note


@dataclass(frozen=True, slots=True, eq=False)
class SecondOrderMap:
    """A map of the coordinates at a posture, to second order.

    Attributes
    ----------
    jacobian : ndarray, shape (m, n)
        First derivative. For a map to poses: the body Jacobian.
    curvature : callable
        ``curvature(w)`` is the (n, n) symmetric matrix sum_k w_k Hess(component k). For a
        map to poses the components are exponential coordinates at the posture, so that
        (theory page, section 5) ``S[a, b] = 1/2 w . [J_a, J_b]`` for joint a before joint
        b.
    sizes : ndarray, shape (m,), or None
        Natural sizes of the residual of closures: 1 for an angle, the characteristic
        length for a distance, so that results do not depend on the unit of length. None:
        1 each.
    """

    jacobian: Array
    curvature: Callable[[Array], Array]
    sizes: Array | None = None


def _flat(_: Array) -> Array:
    return np.zeros((6, 6))


#: The map of six coordinates to themselves.
IDENTITY = SecondOrderMap(np.eye(6), _flat)


class Evaluation(NamedTuple):
    """Energy, gradient (n,) and Hessian (n, n) in the mechanism's coordinates.

    ``hessian[a, b]`` is the derivative of gradient a along coordinate b. It is asymmetric
    if the forces have no potential (wrenches that follow the body); the energy is then
    NaN.
    """

    energy: float
    gradient: Array
    hessian: Array


def summed(parts: Sequence[Evaluation]) -> Evaluation:
    """Sum of one or more evaluations, in their order."""
    total = parts[0]
    for part in parts[1:]:
        total = Evaluation(
            total.energy + part.energy,
            total.gradient + part.gradient,
            total.hessian + part.hessian,
        )
    return total


def nothing(n: int) -> Evaluation:
    """Evaluation of no energy in n coordinates."""
    return Evaluation(0.0, np.zeros(n), np.zeros((n, n)))


class LineGeometry(NamedTuple):
    """Lengths (m,), unit vectors (m, 3) in frame b, and line coordinates g (m, 6)."""

    lengths: Array
    directions: Array
    lines: Array


class Posture(Protocol):
    """A mechanism at given coordinates, as potentials need it."""

    @property
    def q(self) -> Array:
        """Coordinates (n,)."""

    def relative(self, frame_a: str, frame_b: str) -> tuple[Array, SecondOrderMap]:
        """Pose ``T_a_b`` and its map, twists being those of b against a in
        components of b.
        """

    @property
    def closure(self) -> SecondOrderMap | None:
        """Map to the closure residual, or None for a mechanism without closures."""

    @property
    def coordinate_lengths(self) -> Array:
        """1 for angles, the characteristic length for distances: natural sizes (n,)."""

    def pose_of_frame(self, name: str) -> Array:
        """Pose ``T_F_b`` of a frame, without its map."""

    def legs(self, anchors: Array, points: Array) -> LineGeometry | None:
        """Lines from the ground to the body that the posture has cached for these
        very arrays.
        """

    def gravity(self, acceleration: Array) -> Evaluation:
        """Potential energy of all masses in a uniform field, with derivatives."""


#: Points of a mechanism without lines.
NO_POINTS = read_only(np.zeros((0, 3)))
#: Powers of the unit of length in the entries of a pose.
POSE = np.outer([1, 1, 1, 0], [0, 0, 0, 1])


def rescaled(thing: Any, a: float) -> Any:
    """The same with all lengths multiplied by `a`, and unchanged forces.

    `length_powers` of the object has the power of the unit of length of each number: one,
    or one for each entry. The power is not used for parts that have `length_powers`
    themselves.
    """
    powers = thing.length_powers
    changed = {name: _times(getattr(thing, name), a, powers[name]) for name in powers}
    if isinstance(thing, tuple):
        return thing._replace(**changed)  # type: ignore[attr-defined]
    if is_dataclass(thing):
        return replace(thing, **changed)  # type: ignore[type-var]
    other = copy(thing)
    vars(other).update(changed)
    return other


def _times(value: Any, a: float, power: Any) -> Any:
    if value is None:
        return None
    if hasattr(value, "length_powers"):
        return rescaled(value, a)
    if isinstance(value, tuple):
        powers = power if isinstance(power, tuple) else (power,) * len(value)
        return tuple(_times(v, a, p) for v, p in zip(value, powers, strict=True))
    return value * a**power


#: Ends the names of flexible links among those of parts.
LINK = " (link)"


class Number(NamedTuple):
    """A number of a mechanism or a potential that can be changed.

    Attributes
    ----------
    value : float
        In the mechanism's units.
    length, force : float
        Powers of the units of length and force in its unit.
    is_positive : bool
        Whether it can only be above zero.
    """

    value: float
    length: float = 0.0
    force: float = 0.0
    is_positive: bool = False


#: End of the name of a share of a beam's own compliance.
BEAM = " (beam)"


def key_of_pair(a: str, b: str) -> str:
    """Name of an entry of a compliance matrix, from those of two deflections."""
    return a if a == b else f"{a}*{b.rpartition('.')[2]}"


def key_of_law(joint: str, power: int) -> str:
    """Name of a coefficient of a polynomial spring among `Potential.compliances`."""
    return joint if power == 1 else f"{joint} x^{power}"


class Named(Protocol):
    """A coordinate, as potentials need it."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def is_length(self) -> bool:
        """Whether it is a distance."""


class Parts(NamedTuple):
    """The m deflections x(q) in which a potential stores energy, at a posture.

    The potential's gradient is ``rows^T forces``, its Hessian ``rows^T stiffness rows``
    with the curvature of x.

    Attributes
    ----------
    names : sequence of str
        Name of each deflection: "elbow", "leg2", "forearm.px".
    slides : sequence of bool
        Which are distances.
    rows : ndarray (m, n)
        Deflection per coordinate rate.
    stiffness : ndarray (m, m)
        Tangent stiffness.
    forces : ndarray (m,)
        Forces; NaN for springs without a rest position.
    whole : str
        Name of the one thing that deflects so, as a link; "" if each deflection has its
        own spring.
    """

    names: Sequence[str]
    slides: Sequence[bool]
    rows: Array
    stiffness: Array
    forces: Array
    whole: str = ""


class Sums(NamedTuple):
    """Sums of coordinates on which springs act, one spring on each.

    Attributes
    ----------
    names : tuple of str (m,)
        Of the springs.
    factors : ndarray (m, n)
        Factors of the coordinates in each sum.
    stiffness, rest : ndarray (m,)
        Of each spring; NaN for rest positions that are to be chosen.
    """

    names: tuple[str, ...]
    factors: Array
    stiffness: Array
    rest: Array

    def forces(self, q: Array) -> Array:
        """Force of each spring (m,) at coordinates (n,)."""
        return np.asarray(self.stiffness * (self.factors @ q - self.rest))


class Given(NamedTuple):
    """A wrench on the body, in the words of `cartstiff.analyse`.

    Attributes
    ----------
    kind : str
        How it acts while the body moves.
    wrench : ndarray (6,)
        Moment and force, which are constant along the axes.
    point : ndarray (3,)
        Point of application, in M.
    axes : str
        Axes of the components: "body" or "world".
    """

    kind: str
    wrench: Array
    point: Array
    axes: str


class DeadLoad(NamedTuple):
    """A constant force at a point.

    Attributes
    ----------
    mass : float
        That whose weight it is, in the unit of force per m/s^2; 0 for any other force.
    force, point : ndarray (3,)
        In F, and in the frame that carries it.
    frame : str
        That frame.
    """

    mass: float
    force: Array
    point: Array
    frame: str


class Drawn(NamedTuple):
    """Lines (m) that a potential stretches from `starts` to `ends` (m, 3) in F.

    Attributes
    ----------
    tensions : ndarray (m,)
        NaN where they are not known.
    is_taut, are_cables : ndarray of bool (m,)
        Lines that carry force, and lines that cannot push.
    """

    starts: Array
    ends: Array
    tensions: Array
    is_taut: Array
    are_cables: Array


class Potential(ABC):
    """A potential energy of a mechanism.

    All but `evaluate` has a default, so that a user's own energy has shares, units and
    pictures.
    """

    #: Whether it is a load or the weight, and not a part of the mechanism.
    is_external: ClassVar[bool] = False
    #: See `rescaled`; None: the potential cannot be converted to other units.
    length_powers: ClassVar[Mapping[str, Any] | None] = None
    #: Numbered, the name of what has none of its own.
    stem: ClassVar[str] = "energy "
    #: Coordinates that deflect together as one part, as those of a flexible link, and its
    #: name.
    members: tuple[int, ...] = ()
    link: str = ""
    #: What potentials have in common that are evaluated together, as beams with equal
    #: segments; None: it is evaluated alone.
    common: Hashable | None = None
    #: The sums of coordinates on which it has springs.
    sums: Sums | None = None
    #: Whether its stiffness is known but for a factor, as that of a beam.
    is_scaled: bool = False
    #: The constant force that it is.
    dead: DeadLoad | None = None
    #: The wrench on the body that it is, as in `cartstiff.analyse`.
    given: Given | None = None
    #: The mass [kg] whose weight it carries, as gravity compensation does.
    lifted: float = 0.0
    #: Time of one evaluation, in that of a coordinate.
    cost: int = 0
    #: Distance from F's origin of the farthest point of F that a line ties the body to.
    farthest_anchor: float = 0.0

    def __init_subclass__(cls, **kwargs: object) -> None:
        super().__init_subclass__(**kwargs)
        if "remarks" in vars(cls):
            what = f"{cls.__name__}: a potential's notes have another name"
            raise InputError(what, expected="diagnostics", got="remarks")

    @abstractmethod
    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian at a posture."""

    def is_bent(self, posture: Posture) -> bool:  # noqa: ARG002
        """Whether it has to be prepared with others at a posture."""
        return True

    def prepare(self, alike: Sequence[Self], posture: Posture) -> None:  # noqa: B027
        """Find at once what several with the same `common` have at a posture.

        Each of `alike` is evaluated there next.
        """

    def in_units(self, a: float, sizes: Array, efforts: Array) -> Self:  # noqa: ARG002
        """The same with lengths times `a`, coordinates times `sizes` (n,), their forces
        times `efforts` (n,).

        Raises
        ------
        InputError
            If it cannot be converted.
        """
        if self.length_powers is not None:
            scaled: Self = rescaled(self, a)
            return scaled
        own = self.numbers(self.labels(0))
        if a == 1.0 or own:
            each = {name: x.value * a**x.length for name, x in own.items()}
            return self.with_numbers(each, self.labels(0))
        raise InputError(
            "is not converted to other units", where="units", got=type(self).__name__
        )

    def member_forces(self, posture: Posture, gradient: Array) -> Array:  # noqa: ARG002
        """Sum (n,) of the absolute generalised forces of all members, by default of one.

        It includes forces that cancel in the gradient.
        """
        return np.abs(gradient)

    def diagnostics(self, posture: Posture) -> list[Note]:  # noqa: ARG002
        """Notes on limits of the result at a posture; none by default."""
        return []

    def labels(self, first: int) -> Sequence[str]:
        """Names of its parts, after `first` parts with the same `stem`;
        by default it is one.
        """
        return [f"{self.link or f'{self.stem}{first + 1}'}{LINK * bool(self.members)}"]

    def numbers(self, names: Sequence[str]) -> dict[str, Number]:  # noqa: ARG002
        """Its numbers that can be changed, with `names` of its parts; none by default."""
        return {}

    def with_numbers(self, values: Mapping[str, float], names: Sequence[str]) -> Self:  # noqa: ARG002
        """The same with some of `numbers` changed."""
        return self

    def parts(
        self, posture: Posture, coordinates: Sequence[Named], names: Sequence[str]
    ) -> Parts | None:
        """What deflects; by default the coordinates that it acts on,
        together as one part.

        None for loads.
        """
        if self.is_external:
            return None
        _, gradient, hessian = self.evaluate(posture)
        own = np.asarray(self.members or np.flatnonzero(hessian.any(axis=0)), int)
        return Parts(
            [coordinates[j].name for j in own],
            [coordinates[j].is_length for j in own],
            np.eye(len(gradient))[own],
            hessian[np.ix_(own, own)],
            gradient[own],
            names[0],
        )

    @property
    def own_stiffness(self) -> Array | None:
        """Stiffness (m, m) of its undeflected `parts`.

        None if it is no number of its own.
        """
        return None

    def compliances(
        self,
        names: Sequence[str],  # noqa: ARG002
        slides: Sequence[bool],  # noqa: ARG002
    ) -> dict[str, Number]:
        """Its compliances, which measurements find, with `names` of what deflects in it.

        A diagonal entry has the name of its deflection, another one that of two,
        "forearm.x*ry". Higher coefficients of polynomials count, "JOINT x^2".
        """
        return {}

    def with_compliances(self, values: Mapping[str, float], names: Sequence[str]) -> Self:  # noqa: ARG002
        """The same with some of `compliances` changed."""
        return self

    def softened(self, key: str, names: Sequence[str]) -> tuple[Self, Self, float]:  # noqa: ARG002
        """Two of the same and a factor: the difference of their energies times it is the
        derivative of the energy by one of `compliances`.

        That is exact, since energies are linear in stiffness.
        """
        return self, self, 0.0

    def drawn(self, posture: Posture) -> Drawn | None:  # noqa: ARG002
        """Lines to draw at a posture; none by default."""
        return None

    def in_file(self, entry: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """The keys of a link's `entry` in a mechanism file that its numbers change."""
        return {}

    def stress(self, wrench: Array) -> float | None:  # noqa: ARG002
        """Greatest stress of a link's section under a wrench (6,), if it is known."""
        return None

    def rest_is_free(self, every: bool = False) -> Array:  # noqa: ARG002
        """Rest positions to be chosen (m,), by default none: those not given, or all."""
        return np.zeros(0, bool)

    def with_forces(self, posture: Posture, forces: Array) -> Self:  # noqa: ARG002
        """The same with rest positions at which it exerts forces (m,) at a posture, NaN
        where a rest position stays.
        """
        return self

    def with_open_rest(self) -> Self:
        """The same with rest positions that are to be chosen, if it has some."""
        return self

    def conservative(self, posture: Posture) -> Potential | None:  # noqa: ARG002
        """A load with a potential that is the same at a posture;
        None if there is none.
        """
        return None

    def wrench_on(self, frame: str, T_F_b: Array) -> Array | None:  # noqa: ARG002
        """Wrench (6,) of a load on a frame at a pose, in its components;
        None if on another.
        """
        return None

    def exerted(self, posture: Posture) -> Array | None:  # noqa: ARG002
        """Wrenches (m, 6) of its lines on the last of `attachments`, in the components of
        that frame; None without lines.
        """
        return None

    def attachments(self) -> Sequence[tuple[str, Array]]:
        """Frames to which its lines are fixed, each with the points (m, 3) there."""
        return ()

    def under_gravity(self, acceleration: Array) -> Self:  # noqa: ARG002
        """The same in another uniform field (3,), which gravity compensation follows."""
        return self

    def lines_and_rest(self, posture: Posture) -> tuple[Array, Array, Array] | None:  # noqa: ARG002
        """Lines g (m, 6) from ground to body, their stiffnesses k (m,), and the rest (6,
        6) of K^B; None without.
        """
        return None


_Term = TypeVar("_Term", bound=Potential)


def alike(terms: Iterable[_Term]) -> Collection[list[_Term]]:
    """Groups of potentials that are evaluated together, without those that never are."""
    groups: dict[Hashable, list[_Term]] = {}
    for term in terms:
        if term.common is not None:
            groups.setdefault(term.common, []).append(term)
    return groups.values()


def evaluate_together(terms: Sequence[Potential], posture: Posture) -> list[Evaluation]:
    """Each potential at a posture, those that are alike at once."""
    for group in alike([t for t in terms if t.common is not None and t.is_bent(posture)]):
        if len(group) > 1:
            group[0].prepare(group, posture)
    return [term.evaluate(posture) for term in terms]


@dataclass(frozen=True, kw_only=True, eq=False)
class PosePotential(Potential):
    """A potential that depends on the pose of one frame relative to another.

    Attributes
    ----------
    frame_a, frame_b : str
        The potential is a function of ``T_a_b``. "world" is the inertial frame F, "body"
        the frame of interest M.
    """

    frame_a: str = "world"
    frame_b: str = "body"

    @abstractmethod
    def on_pose(self, T_a_b: Array) -> tuple[float, Array, Array]:
        """Energy, wrench W = dPhi (6,) and K^B (6, 6), in components of frame b."""

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian at a posture."""
        T, to_pose = posture.relative(self.frame_a, self.frame_b)
        return pulled_back(*self.on_pose(T), to_pose)


def pulled_back(
    energy: float, wrench: Array, stiffness: Array, to_pose: SecondOrderMap
) -> Evaluation:
    """An energy of a pose in the coordinates: gradient J^T W, Hessian J^T K^B J + S_W."""
    if to_pose is IDENTITY:
        return Evaluation(energy, wrench, stiffness)
    J = to_pose.jacobian
    return Evaluation(
        energy, J.T @ wrench, J.T @ stiffness @ J + to_pose.curvature(wrench)
    )
