r"""Springs in the joints: linear, or with any torque-deflection law.

Energy Phi = sum_j U_j(q_j - r_j) with rest positions r; torque U_j', stiffness U_j''.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import pi
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple, Self

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import checked_array, read_only, real_array
from cartstiff.errors import InputError, check_name
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.notes import Note
from cartstiff.potentials.contract import (
    Evaluation,
    Named,
    Number,
    Parts,
    Posture,
    Potential,
)

# Least share of a link's Euler load for a note that a 6x6 spring neglects it: the
# deflection is too small by about that share.
_NOTED_COMPRESSION = 0.05


class SpringLaw(ABC):
    """Torque of a spring as a function of its deflection x."""

    #: Coefficients c_1, c_2, ... of a polynomial; of other laws none.
    powers: tuple[float, ...] = ()
    #: Points of a table at which the stiffness jumps.
    corners: tuple[Corner, ...] = ()
    corner_width: float = 0.0

    def corner_at(self, x: float) -> Corner | None:  # noqa: ARG002
        """The corner at a deflection, where the stiffness jumps; None elsewhere."""
        return None

    @abstractmethod
    def evaluate(self, x: Any) -> tuple[Any, Any, Any]:
        """Energy, torque and tangent stiffness at a deflection, or at each of (N,)."""

    @abstractmethod
    def deflection_for(self, torque: float) -> float:
        """Deflection that carries a torque.

        Raises
        ------
        InputError
            If the law does not reach that torque.
        """

    def in_units(self, size: float, effort: float) -> SpringLaw:  # noqa: ARG002
        """The same law with the numbers of deflections times `size` and of torques
        times `effort`.

        Raises
        ------
        InputError
            For a law that has no such conversion.
        """
        what = "a spring's law is not converted to other units"
        raise InputError(what, where="units", got=type(self).__name__)


@dataclass(frozen=True)
class PolynomialLaw(SpringLaw):
    """Torque ``c_1 x + c_2 x^2 + ... + c_m x^m``.

    Attributes
    ----------
    coefficients : tuple of float
        c_1, c_2, ...: N m/rad, N m/rad^2, ... (N/m, ... for a prismatic joint).
    """

    coefficients: tuple[float, ...]

    @property
    def powers(self) -> tuple[float, ...]:  # type: ignore[override]
        """The coefficients."""
        return self.coefficients

    def __post_init__(self) -> None:
        if not self.coefficients or not np.all(np.isfinite(self.coefficients)):
            raise InputError(
                "polynomial spring needs finite coefficients", got=list(self.coefficients)
            )

    def evaluate(self, x: Any) -> tuple[Any, Any, Any]:
        """Energy, torque and tangent stiffness at a deflection, each of (N,),
        or a number.
        """
        energy = torque = stiffness = 0.0
        for power, c in reversed(list(enumerate(self.coefficients, start=1))):
            energy, torque = (energy + c / (power + 1)) * x, (torque + c) * x
            stiffness = stiffness * x + c * power
        return energy * x, torque, stiffness

    def in_units(self, size: float, effort: float) -> PolynomialLaw:
        """The same law in other units."""
        c = enumerate(self.coefficients, start=1)
        return PolynomialLaw(tuple(x * effort / size**k for k, x in c))

    def deflection_for(self, torque: float) -> float:
        """Real root of smallest size of ``law(x) = torque``."""
        roots = np.polynomial.polynomial.Polynomial([-torque, *self.coefficients]).roots()
        size = 1.0 + float(np.abs(roots).max(initial=0.0))
        real = roots.real[np.abs(roots.imag) < numerics.NEGLIGIBLE_DIFFERENCE * size]
        if real.size == 0:
            raise InputError(
                "polynomial spring never reaches the torque", got=f"{torque:.6g}"
            )
        x = float(real[np.argmin(np.abs(real))])
        for _ in range(3):  # roots of a companion matrix keep about half the digits
            _, t, k = self.evaluate(x)
            if k != 0.0:
                x -= (t - torque) / k
        return x


class Corner(NamedTuple):
    """A point of a table at which the stiffness changes: below it, above it."""

    deflection: float
    below: float
    above: float


@dataclass(frozen=True)
class TabulatedLaw(SpringLaw):
    """Torque through points: straight between them, or a smooth curve;
    straight beyond them.

    Attributes
    ----------
    deflections, torques : tuple of float
        At least two points; deflections strictly increasing.
    pieces : {"linear", "smooth"}
        Straight pieces, as a catalogue means them: the stiffness jumps at the points, and
        that of the piece above is taken there. Or a shape-preserving cubic (PCHIP):
        energy, torque and stiffness are continuous.
    """

    deflections: tuple[float, ...]
    torques: tuple[float, ...]
    pieces: Literal["linear", "smooth"] = "linear"

    def __post_init__(self) -> None:
        x, y = real_array(self.deflections), real_array(self.torques)
        if x.size < 2 or x.shape != y.shape or not np.all(np.isfinite(np.append(x, y))):
            raise InputError(
                "spring table needs two or more finite points", got=f"{x.size} points"
            )
        if np.any(np.diff(x) <= 0):
            raise InputError(
                "deflections of a spring table must increase strictly", got=x.tolist()
            )
        check_name("kind of pieces", self.pieces, ["linear", "smooth"])

    @cached_property
    def corners(self) -> tuple[Corner, ...]:  # type: ignore[override]
        """Points at which the stiffness jumps; none of a smooth curve."""
        slopes = self._rows[:, 3]
        jumps = (
            np.abs(np.diff(slopes))
            > numerics.NEGLIGIBLE_DIFFERENCE * np.abs(slopes).max()
        )
        sides = zip(self.deflections, slopes[:-1], slopes[1:], jumps, strict=True)
        is_linear = self.pieces == "linear"
        return tuple(
            Corner(float(x), float(below), float(above))
            for x, below, above, jumps_here in sides
            if is_linear and jumps_here
        )

    @cached_property
    def corner_width(self) -> float:  # type: ignore[override]
        """Distance to a corner below which the deflection counts as that
        of the corner.
        """
        return numerics.NEGLIGIBLE_DIFFERENCE * (
            self.deflections[-1] - self.deflections[0]
        )

    def corner_at(self, x: float) -> Corner | None:
        """Return the corner at a deflection, if there is one."""
        near = (c for c in self.corners if abs(c.deflection - x) <= self.corner_width)
        return next(near, None)

    @cached_property
    def _rows(self) -> Array:
        """A row for each piece: knot, energy, torque, slope,
        two more coefficients of the torque.

        The first and the last piece are straight. The energy is that without a
        deflection.
        """
        x, y = np.asarray(self.deflections, float), np.asarray(self.torques, float)
        h, secants = np.diff(x), np.diff(y) / np.diff(x)
        rows = np.zeros((len(x) + 1, 6))
        rows[0, 0], rows[1:, 0], rows[0, 2], rows[1:, 2] = x[0], x, y[0], y
        # Slopes, and for cubic pieces two more coefficients, that the knots determine.
        if self.pieces == "linear":
            energies = h * (y[1:] + y[:-1]) / 2
            rows[:, 3] = [secants[0], *secants, secants[-1]]
        else:
            from scipy.interpolate import PchipInterpolator

            slopes = PchipInterpolator(x, y).derivative()(x)
            energies = h * (y[1:] + y[:-1]) / 2 + h * h * (slopes[:-1] - slopes[1:]) / 12
            rows[0, 3], rows[1:, 3] = slopes[0], slopes
            rows[1:-1, 4] = (3 * secants - 2 * slopes[:-1] - slopes[1:]) / h
            rows[1:-1, 5] = (slopes[:-1] + slopes[1:] - 2 * secants) / (h * h)
        # Energies from knot to knot; zero at deflection 0.
        rows[2:, 1] = np.cumsum(energies)
        rows[:, 1] -= self.on_piece(rows[np.searchsorted(x, 0.0, side="right")], 0.0)[0]
        return rows

    @cached_property
    def _ends(self) -> Array:
        """Ascending deflections at which the pieces end.

        A corner belongs to the piece above.
        """
        x = np.asarray(self.deflections, float)
        return x - numerics.ROUNDOFF * (x[-1] - x[0]) * (self.pieces == "linear")

    def evaluate(self, x: Any) -> tuple[Any, Any, Any]:
        """Energy, torque and tangent stiffness at a deflection, or at each of (N,).

        The energy is zero without a deflection.
        """
        return self.on_piece(
            self._rows[np.searchsorted(self._ends, x, side="right")].T, x
        )

    @staticmethod
    def on_piece(piece: Any, x: Any) -> tuple[Any, Any, Any]:
        """`evaluate` on one piece: knot, energy, torque, slope and two
        coefficients there.
        """
        knot, energy, torque, slope, second, third = piece
        d = x - knot
        return (
            energy + d * (torque + d * (slope / 2 + d * (second / 3 + d * (third / 4)))),
            torque + d * (slope + d * (second + d * third)),
            slope + d * (2 * second + 3 * d * third),
        )

    def in_units(self, size: float, effort: float) -> TabulatedLaw:
        """The same law in other units."""
        deflections, torques = (x * size for x in self.deflections), self.torques
        return replace(
            self,
            deflections=tuple(deflections),
            torques=tuple(t * effort for t in torques),
        )

    def deflection_for(self, torque: float) -> float:
        """Deflection of smallest size that carries a torque."""
        each = (self._on_piece_at(i, torque) for i in range(len(self._rows)))
        found = [x for x in each if x is not None]
        if not found:
            raise InputError("spring table never reaches the torque", got=f"{torque:.6g}")
        return min(found, key=abs)

    def _on_piece_at(self, i: int, torque: float) -> float | None:
        """Deflection of smallest size on one piece that carries a torque;
        None if none does.
        """
        ends = (-np.inf, *self.deflections, np.inf)
        knot, _, at_knot, slope, *_ = self._rows[i].tolist()
        low, high = ends[i], ends[i + 1]
        is_outside, far = i in (0, len(self.deflections)), at_knot
        if not is_outside:
            far = self.torques[i]
        elif slope:
            far = at_knot + (high if i else low) * slope
        if not min(at_knot, far) <= torque <= max(at_knot, far):
            return None
        if at_knot == far:  # flat, as a play is
            return float(np.clip(0.0, low, high))
        if is_outside or self.pieces == "linear":
            return float(np.clip(knot + (torque - at_knot) / slope, low, high))
        for _ in range(200):
            middle = 0.5 * (low + high)
            if middle in (low, high):
                break
            if (self.on_piece(self._rows[i], middle)[1] > torque) == (far > at_knot):
                high = middle
            else:
                low = middle
        return 0.5 * (low + high)


class Springs(Potential):
    """Springs whose rest positions can be chosen: one per coordinate, or along lines.

    The defaults are those of one spring per coordinate.

    Attributes
    ----------
    stiffness, rest : ndarray (m,)
        Of each spring; NaN for rest positions that are to be chosen.
    laws : mapping of int to SpringLaw
        Nonlinear springs by number.
    rigid : frozenset of int
        Rigid ones.
    unilateral : bool or tuple of bool (m,)
        Springs that cannot push.
    driven : bool or tuple of bool (m,)
        Springs that a drive moves: all, or some of them.
    preload, balanced_at
        Given tensions of driven lines, and those that were chosen, see `LineSprings`.
    """

    stiffness: Array
    rest: Array
    laws: Mapping[int, SpringLaw] = MappingProxyType({})
    rigid: frozenset[int] = frozenset()
    unilateral: bool | tuple[bool, ...] = False
    driven: bool | tuple[bool, ...] = False
    preload: Array | None = None
    balanced_at: tuple[Array, Array, Array] | None = None
    #: What rest positions are called, and whose they are.
    rest_words: ClassVar[tuple[str, str]] = ("rest positions", "their joints")
    #: Smallest rest position.
    least_rest: float = -np.inf
    #: Whether a load leaves a choice of the springs' forces.
    is_redundant: bool = False
    #: Whether they give in other directions than their own, as flexures do.
    gives_aside: bool = False

    @property
    def is_complete(self) -> bool:
        """Whether every spring has a rest position."""
        return not self.rest_is_free().any()

    @property
    def is_passive(self) -> Array:
        """Which of them are no springs (m,)."""
        return np.zeros(len(self.stiffness), bool)

    @property
    def cables(self) -> Array:
        """Which of them cannot push (m,)."""
        return np.full(self.stiffness.shape, self.unilateral)

    @abstractmethod
    def rest_is_free(self, every: bool = False) -> Array:
        """Rest positions to be chosen (m,): those not given, or all."""

    @abstractmethod
    def replaced(self, stiffness: Array, rest: Array) -> Self:
        """The same springs with other stiffnesses and rest positions."""

    def with_forces(self, posture: Posture, forces: Array) -> Self:  # noqa: ARG002
        """The same with rest positions of coordinates' springs at which they exert
        forces (n,).
        """
        return self

    def with_rest_balancing(
        self, posture: Posture, gradient: Array, every: bool = False
    ) -> Self:
        """The same with rest positions at which they exert a gradient (n,)
        at a posture.
        """
        chosen = np.where(self.rest_is_free(every), gradient, np.nan)
        return self.with_forces(posture, chosen)

    @abstractmethod
    def tangent(self, posture: Posture) -> Array:
        """Tangent stiffness of each (m,) at a posture."""

    def labels(self, first: int) -> Sequence[str]:  # noqa: ARG002
        """None: those of coordinates beside the mechanism's own have no names."""
        return ()

    def names_in(self, coordinates: Sequence[Named]) -> tuple[str, ...]:
        """Name of each spring of a mechanism with these coordinates."""
        return tuple(c.name for c in coordinates)

    def slides_in(self, coordinates: Sequence[Named]) -> list[bool]:
        """Whether each spring of such a mechanism deflects by a distance."""
        return [c.is_length for c in coordinates]

    def positions(self, posture: Posture) -> Array:
        """Where each spring is (m,): its deflection is the difference to `rest`."""
        return posture.q

    def rows(self, posture: Posture) -> Array:
        """Change of `positions` per coordinate rate (m, n)."""
        return np.eye(len(posture.q))

    def torque(self, q: Array) -> Array:
        """Torque of each coordinate's own spring (n,); zero without one."""
        return np.zeros_like(q)

    def pull(self, posture: Posture) -> Array:
        """Force of each spring (m,) at a posture."""
        return self.torque(posture.q)

    def pull_at(self, q: Array, pose: Array) -> Array:  # noqa: ARG002
        """`pull` of a mechanism's own springs at coordinates (n,) and a pose of M."""
        return self.torque(q)

    def of_coordinates(self, count: int) -> Array:  # noqa: ARG002
        """Stiffness of each coordinate's own spring (n,).

        Zero without one, or with a law.
        """
        return self.stiffness

    def has_coordinate(self, count: int) -> Array:
        """Which coordinates (n,) have a spring of their own."""
        own = self.of_coordinates(count) > 0.0
        own[list(self.laws)] = True
        return own

    def taut(self, posture: Posture) -> Array:  # noqa: ARG002
        """Springs (m,) that carry force at a posture."""
        return np.ones(len(self.stiffness), bool)

    def holding(self, lines: Array | None = None) -> Array:  # noqa: ARG002
        """Springs (m,) that are to keep a given force at a posture, whatever acts."""
        return np.zeros(len(self.stiffness), bool)

    def require_ideal_joints(self, what: str) -> None:
        """Refuse springs that bend at their ends, for `what` they cannot have."""

    def linear(self, which: Container[int]) -> Self:  # noqa: ARG002
        """The same without the laws of some springs, and with none rigid."""
        return self

    def with_laws(self, laws: Mapping[int, SpringLaw]) -> Self:  # noqa: ARG002
        """The same with other laws, where it can have some."""
        return self

    def at_rest(self, q: Array) -> Self:  # noqa: ARG002
        """The same with springs of coordinates at rest at q (n,)."""
        return self

    def unloaded(self, positions: Array) -> Self:
        """The same at rest at `positions` (m,), NaN where these are open;
        cables are bars.
        """
        return self.replaced(self.stiffness, positions)

    def at_points(self, anchors: Array, points: Array) -> Self:  # noqa: ARG002
        """The same between other points of F and of M.

        Springs of coordinates have none.
        """
        return self

    def as_preloaded(self, tensions: Array) -> Self:  # noqa: ARG002
        """The same with open rest lengths and a preload of these tensions (m,),
        where that is a number they have.
        """
        return self

    def shifted(self, posture: Posture, which: Sequence[int], less: Array) -> Self:  # noqa: ARG002
        """The same with the tensions of some springs reduced,
        where that is a number they have.
        """
        return self

    @property
    def _linear(self) -> list[int]:
        own = np.flatnonzero(~self.is_passive).tolist()
        return [i for i in own if i not in self.laws]

    def parts(
        self, posture: Posture, coordinates: Sequence[Named], names: Sequence[str]
    ) -> Parts:
        """Each spring; slack cables have neither stiffness nor force."""
        names = names or self.names_in(coordinates)
        slides, rows = self.slides_in(coordinates), self.rows(posture)
        k, forces = self.tangent(posture), self.pull(posture)
        if self.is_passive.any():
            own = np.flatnonzero(~self.is_passive).tolist()
            names, slides = [names[i] for i in own], [slides[i] for i in own]
            rows, k, forces = rows[own], k[own], forces[own]
        return Parts(names, slides, rows, np.diag(k), forces)

    def numbers(
        self, names: Sequence[str], slides: Sequence[bool] | None = None
    ) -> dict[str, Number]:
        """Stiffnesses of linear springs, and rest positions that are known;
        lines slide.
        """
        linear = self._linear if names else []
        own = [(i, names[i], slides is None or slides[i]) for i in linear]
        k, rest = self.stiffness.tolist(), self.rest.tolist()
        found = {
            f"stiffness.{name}": Number(k[i], -1.0 if is_length else 1.0, 1.0, True)
            for i, name, is_length in own
        }
        known = [each for each in own if rest[each[0]] == rest[each[0]]]
        return found | {f"rest.{n}": Number(rest[i], float(x)) for i, n, x in known}

    def with_numbers(self, values: Mapping[str, float], names: Sequence[str]) -> Self:
        """The same with other stiffnesses, "stiffness.NAME", and rest positions,
        "rest.NAME".
        """
        if not names:
            return self
        k, rest = (
            [values.get(f"{word}.{n}", x) for n, x in zip(names, own, strict=True)]
            for word, own in (("stiffness", self.stiffness), ("rest", self.rest))
        )
        return self.replaced(np.array(k), np.array(rest))

    @property
    def own_stiffness(self) -> Array:
        """Diagonal of the linear springs' stiffnesses, slack cables among them."""
        return np.diag(self.stiffness[self._linear])

    def with_compliance(self, compliance: Array) -> Self:
        """The same with other linear springs."""
        k = self.stiffness.copy()
        k[self._linear] = 1.0 / np.diag(compliance)
        return self.replaced(k, self.rest)


@dataclass(frozen=True, eq=False)
class JointSprings(Springs):
    """One spring per coordinate.

    Attributes
    ----------
    stiffness : ndarray, shape (n,)
        N m/rad (N/m for a prismatic joint); 0 for a joint without a spring. Not used for
        a joint with a nonlinear law.
    rest : ndarray, shape (n,)
        Rest positions; NaN where they are to be chosen so that the springs balance the
        load at the posture.
    laws : mapping of int to SpringLaw
        Nonlinear springs by coordinate index.
    rigid : frozenset of int
        Coordinates with infinite stiffness. They store no energy, and `stiffness` is 0
        there; the mechanism does not move them.
    """

    stiffness: Array
    rest: Array
    laws: Mapping[int, SpringLaw] = field(default_factory=dict)
    rigid: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        k = checked_array(self.stiffness, None, "joint stiffness", finite=False)
        r = checked_array(self.rest, None, "rest position", finite=False)
        if k.ndim != 1 or k.shape != r.shape:
            raise InputError(
                "joint stiffnesses and rest positions differ in number",
                expected=f"{k.shape}",
                got=f"{r.shape}",
            )
        if np.isnan(k).any() or np.any(k < 0):
            raise InputError("joint stiffness must be a number from zero", got=k.tolist())
        rigid = self.rigid | frozenset(np.flatnonzero(np.isinf(k)).tolist())
        if any(np.isfinite(r[j]) and np.isinf(k[j]) for j in rigid):
            raise InputError(
                "a rigid joint stays where it is", expected="no rest position for it"
            )
        k[list(rigid)], r[list(rigid)] = 0.0, 0.0
        object.__setattr__(self, "rigid", rigid)
        passive = k == 0.0
        passive[list(self.laws)] = False
        r[passive & np.isnan(r)] = 0.0  # a joint without a spring is at rest anywhere
        k.flags.writeable = r.flags.writeable = False
        object.__setattr__(self, "stiffness", k)
        object.__setattr__(self, "rest", r)

    @cached_property
    def is_complete(self) -> bool:
        """Whether every spring has a rest position."""
        return not np.any(np.isnan(self.rest))

    @cached_property
    def is_passive(self) -> Array:
        """Whether each joint has no spring (n,)."""
        passive = self.stiffness == 0.0
        passive[list(self.laws)] = False
        passive.flags.writeable = False
        return passive

    def tangent(self, posture: Posture) -> Array:
        """Diagonal of the Hessian."""
        return self.evaluate(posture).hessian.diagonal()

    def linear(self, which: Container[int]) -> JointSprings:
        """The same without the laws of some joints, and with none rigid."""
        laws = {j: law for j, law in self.laws.items() if j not in which}
        return replace(self, laws=laws, rigid=frozenset())

    def with_laws(self, laws: Mapping[int, SpringLaw]) -> JointSprings:
        """The same with other laws."""
        return replace(self, laws=laws)

    def at_rest(self, q: Array) -> JointSprings:
        """The same at rest at q (n,)."""
        return replace(self, rest=q)

    def rest_is_free(self, every: bool = False) -> Array:
        """Rest positions to be chosen (n,): those not given, or all."""
        return ~self.is_passive if every else ~self.is_passive & np.isnan(self.rest)

    def torque(self, q: Array) -> Array:
        """Torques of the springs whose rest position is given; zero for the others."""
        x = np.where(np.isnan(self.rest), 0.0, q - self.rest)
        torque = self.stiffness * x
        for j, law in self.laws.items():
            torque[j] = 0.0 if np.isnan(self.rest[j]) else law.evaluate(float(x[j]))[1]
        return torque

    def beside_closures(
        self, posture: Posture, gradient: Array, size: float, every: bool = False
    ) -> tuple[Array, Array]:
        """The part of a gradient that closures leave to the springs,
        and what no spring has of it.

        Closures carry, as far as they can, what joints with a known torque do not carry:
        those that are passive, or whose rest position is not to be chosen.

        Returns
        -------
        gradient, left : ndarray, shape (n,) each
            What is left is zero where it is negligible beside the largest gradient and
            `size`.
        """
        chosen, closure = self.rest_is_free(every), posture.closure
        left = np.zeros(len(gradient))
        if not chosen.all():
            left = np.where(chosen, 0.0, gradient - self.torque(posture.q))
        if not left.any():
            return gradient, left
        if closure is not None:
            known, sizes = ~chosen, posture.coordinate_lengths
            _, values, Vt = np.linalg.svd(closure.jacobian * sizes)
            V, N = np.split(Vt.T, [numerics.rank(values)], axis=1)
            # The small singular values of V[known] and N[chosen] are the same: one
            # threshold, relative to the largest of N[chosen], decides on both.
            largest = [
                numerics.singular_values(m).max(initial=0.0)
                for m in (N[chosen], V[known])
            ]
            smallest = numerics.RANK * float(largest[0] / max(largest[1], numerics.TINY))
            forces = np.linalg.lstsq(V[known], (left * sizes)[known], rcond=smallest)[0]
            carried = V @ forces / sizes
            gradient, left = gradient - carried, np.where(known, left - carried, 0.0)
        size = max(size, float(np.abs(gradient).max()))
        least = numerics.BALANCE_TOLERANCE * size + numerics.ROUNDOFF
        return gradient, np.where(np.abs(left) > least, left, 0.0)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, torques and tangent stiffnesses."""
        x = posture.q - self.rest
        torque = self.stiffness * x
        energies, diagonal = 0.5 * torque * x, self.stiffness.copy()
        for j, law in self.laws.items():
            energies[j], torque[j], diagonal[j] = law.evaluate(float(x[j]))
        return Evaluation(float(energies.sum()), torque, read_only(np.diag(diagonal)))

    def in_units(self, a: float, sizes: Array, efforts: Array) -> Self:  # noqa: ARG002
        """The same springs in other units."""
        own = {
            j: law.in_units(float(sizes[j]), float(efforts[j]))
            for j, law in self.laws.items()
        }
        k, rest = self.stiffness * efforts / sizes, self.rest * sizes
        return replace(self, stiffness=k, rest=rest, laws=own)

    def replaced(self, stiffness: Array, rest: Array) -> JointSprings:
        """The same springs with other stiffnesses and rest positions."""
        return replace(self, stiffness=stiffness, rest=rest)

    def with_forces(self, posture: Posture, forces: Array) -> JointSprings:
        """The same springs with rest positions at which they exert torques (n,)
        at a posture.

        Where a torque is NaN the rest position stays; those of joints without a spring
        are ignored.

        Raises
        ------
        InputError
            If a spring's law never reaches its torque.
        """
        chosen = ~self.is_passive & ~np.isnan(forces)
        rest = self.rest.copy()
        for j, law in self.laws.items():
            if chosen[j]:
                rest[j] = posture.q[j] - law.deflection_for(float(forces[j]))
                chosen[j] = False
        rest[chosen] = posture.q[chosen] - forces[chosen] / self.stiffness[chosen]
        rest.flags.writeable = False
        # All else has been checked, and every posture of an arm comes here.
        own = object.__new__(JointSprings)
        vars(own).update(vars(self), rest=rest)
        vars(own).pop("is_complete", None)
        return own


def unheld(joint: str, torque: str, others: Collection[str]) -> InputError:
    """Refusal of a load that needs a torque at a joint where no rest position
    can be chosen.

    `others` are the kinds of energy that act on the joint.
    """
    needed = f"but the wrench needs {torque} from it"
    if not others:
        return InputError(
            f"{joint} has no spring, {needed}",
            expected="a stiffness above zero there, or a wrench that does not load it",
        )
    words = ", ".join(sorted(others))
    return InputError(
        f"{joint} has no spring whose rest position could be chosen, {needed}; "
        f"the energy that acts there ({words}) keeps its own rest",
        expected="equilibrium (cartstiff equilibrium), which deflects it, or springs "
        "whose rest may be chosen: springs or coupled_springs in the file",
    )


@dataclass(frozen=True, eq=False)
class CoupledSprings(Potential):
    """A spring over several coordinates, Phi = 1/2 x^T K x, as in a compliant link.

    Attributes
    ----------
    indices : ndarray of int, shape (m,)
        The coordinates x.
    matrix : ndarray, shape (m, m)
        Symmetric K.
    link : str
        Name of the compliant link: x is then (translation, rotation) of its far side.
    """

    indices: Array
    matrix: Array
    link: str = ""

    stem: ClassVar = "coupled springs "

    def __post_init__(self) -> None:
        for name, kind in (("indices", int), ("matrix", float)):
            array = np.array(getattr(self, name), kind)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def members(self) -> tuple[int, ...]:  # type: ignore[override]
        """The coordinates."""
        return tuple(self.indices.tolist())

    @property
    def own_stiffness(self) -> Array:
        """K."""
        return self.matrix

    def in_file(self, entry: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """The matrix, rotations before translations."""
        return {"stiffness": self.matrix[se3.SWAP][:, se3.SWAP].tolist()}

    def with_compliance(self, compliance: Array) -> CoupledSprings:
        """The same with ``K = C^-1``."""
        K = np.linalg.inv(compliance)
        return replace(self, matrix=0.5 * (K + K.T))

    def numbers(self, names: Sequence[str]) -> dict[str, Number]:
        """A factor on its stiffness."""
        return {f"stiffness.{names[0]}": Number(1.0, is_positive=True)}

    def with_numbers(
        self, values: Mapping[str, float], names: Sequence[str]
    ) -> CoupledSprings:
        """The same, stiffer by a factor."""
        factor = values.get(f"stiffness.{names[0]}", 1.0)
        return self if factor == 1.0 else replace(self, matrix=factor * self.matrix)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian."""
        q, at = posture.q, self.indices
        force = self.matrix @ q[at]
        gradient, hessian = np.zeros(q.size), np.zeros((q.size, q.size))
        gradient[at] = force
        hessian[np.ix_(at, at)] = self.matrix
        return Evaluation(0.5 * float(force @ q[at]), gradient, hessian)

    def in_units(self, a: float, sizes: Array, efforts: Array) -> Self:  # noqa: ARG002
        """The same spring in other units."""
        at = self.indices
        return replace(self, matrix=self.matrix * efforts[at][:, None] / sizes[at])

    def diagnostics(self, posture: Posture) -> list[Note]:
        """Note on compression that matters in a cantilever with the same compliance.

        Its length l and its axis follow from where a pure force turns the far side: the
        cross products of l/2 with the forces.
        """
        if not self.link or self.indices.size != 6:
            return []
        force = (self.matrix @ posture.q[self.indices])[:3]
        flexibility = np.linalg.pinv(self.matrix)
        turning = flexibility[3:, 3:]
        half = se3.unskew(np.linalg.pinv(turning) @ flexibility[3:, :3])
        distance = float(np.linalg.norm(half))
        if distance == 0.0:
            return []
        axis = half / distance
        bending = np.eye(3) - np.outer(axis, axis)
        softest = float(np.linalg.eigvalsh(bending @ turning @ bending)[-1])  # l / EI
        # Against pi^2 EI / 4 l^2.
        share = -float(force @ axis) * 8.0 * distance * softest / pi**2
        if not share >= _NOTED_COMPRESSION:
            return []
        message = (
            f"link {self.link!r} carries {100 * share:.0f} % of the Euler load of a "
            "cantilever with its compliance; a 6x6 spring does not feel its own axial "
            "force: give it as beam"
        )
        return [Note("link-compressed", message, {"link": self.link, "share": share})]
