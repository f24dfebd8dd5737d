r"""Forces, constraints and remaining motions of an equilibrium.

All forces together have gradient g and derivative H in the n coordinates. Closures, held
components of a displacement and touched limits are constraints with Jacobian A. On the
motions that satisfy them, N = null A,

    g_N = N^T g,    g + A^T lam = 0 at equilibrium,    H_N = N^T (H + sum lam_k A_k') N

H_N is the exact second derivative of the energy along motions that are pulled back onto
the constraints at right angles to N. Coordinates are measured in their natural units,
angles in radians and distances in the characteristic length, so that g_N and H_N are
energies.

A search is bounded by a number of postures, not by time, so that it ends alike on every
machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import ConvergenceError, InputError
from cartstiff.core.geometry import se3
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.limits import Limits, limit_notes, limits_of
from cartstiff.core.notes import Note
from cartstiff.core.numerics import EPSILON, FREE_MOTION_STIFFNESS, eigenvalues, invert
from cartstiff.core.numerics.searches import least_change
from cartstiff.core.potentials.contract import Evaluation, Potential, SecondOrderMap
from cartstiff.core.statics.held import Held
from cartstiff.core.stiffness.balance import with_rest_balancing
from cartstiff.core.stiffness.leg_length_basis import (
    ByLengths,
    by_lengths,
    line_springs_and_rest,
)
from cartstiff.core.stiffness.motions import decompose

# Costs in postures of one coordinate: the largest of a search, the least of a posture,
# and that of each beam or strut, whose own equilibrium is computed in every posture.
_MAX_SEARCH_COST, _MIN_POSTURE_COST = 150_000, 20
# Postures that every search may evaluate. Successful ones evaluate some hundred at most.
_MIN_POSTURES = 300


class ExhaustedError(Exception):
    """A search has evaluated as many postures as it may.

    Only the outermost search catches it.
    """


@dataclass
class _Budget:
    postures: int
    evaluated: int = 0


_budget: ContextVar[_Budget | None] = ContextVar("budget", default=None)


def cost(elastic: ElasticMechanism) -> int:
    """Cost of one posture, in postures of one coordinate."""
    terms = sum(term.cost for term in elastic.terms())
    return _MIN_POSTURE_COST + len(elastic.names) + terms


@contextmanager
def bounded(elastic: ElasticMechanism) -> Iterator[None]:
    """Bound the searches within; all of them share the bound of the outermost.

    Raises
    ------
    ConvergenceError
        If the bound is reached where no search reports its own progress.
    """
    if _budget.get() is not None:
        yield
        return
    token = _budget.set(_Budget(max(_MAX_SEARCH_COST // cost(elastic), _MIN_POSTURES)))
    try:
        yield
    except ExhaustedError as error:
        raise ConvergenceError(
            f"no equilibrium found, {error}", iterations=0, residual=inf
        ) from None
    finally:
        _budget.reset(token)


def count() -> None:
    """Count one more posture; raise `ExhaustedError`, with their number,
    beyond the bound.
    """
    budget = _budget.get()
    if budget is None:
        return
    if budget.evaluated >= budget.postures:
        raise ExhaustedError(f"the search was given up after {budget.evaluated} postures")
    budget.evaluated += 1


@dataclass(slots=True, eq=False)
class Point:
    """The mechanism at coordinates q, with all forces that act there.

    Attributes
    ----------
    energies : float
        Sum of the terms' absolute energies.
    forces : ndarray (n,)
        Sum of the absolute generalised forces of the terms' members, in natural units.
    stiffness_scale : ndarray (n, n)
        Sum of the terms' absolute stiffnesses, in natural units.
    limited : ndarray
        What the limits bound.
    areas : ndarray (n, n)
        Products of the coordinates' natural sizes.
    """

    q: Array
    posture: MechanismPosture
    evaluation: Evaluation
    energies: float
    forces: Array
    stiffness_scale: Array
    limited: Array
    areas: Array

    def add(self, term: Evaluation, members: Array) -> None:
        """Add a term that acts here, with the absolute forces (n,) of its members."""
        e, g, h = self.evaluation
        self.evaluation = Evaluation(e + term.energy, g + term.gradient, h + term.hessian)
        columns = self.posture.coordinate_lengths
        self.energies += abs(term.energy)
        self.forces += members * columns
        self.stiffness_scale += np.abs(term.hessian * self.areas)


@dataclass(eq=False)
class Balance:
    """Forces and stiffness on the motions that the constraints leave, in natural units.

    Attributes
    ----------
    free : ndarray (n, f) or None
        N; None means the identity.
    multipliers : ndarray (m,)
        Constraint forces lam, per unit of each constraint.
    force : ndarray (f,)
        g_N.
    stiffness : ndarray (f, f)
        H_N, symmetric where the loads have a potential.
    acting : ndarray (f,)
        Forces that act on each motion: the sum of their absolute values.
    rounding : ndarray (f,)
        Error of g_N by the rounding of coordinates and forces along each motion.
    roundoff : ndarray (f,)
        Error of g_N by the rounding of every spring's own deflection too.
    stiffness_scale : ndarray (f,)
        Reference size of H_N, motion by motion: stiffnesses that act there, at least the
        rounding of the stiffest.
    is_oblique : bool
        Whether the columns of `free` are not at right angles to each other, of length 1.
    """

    free: Array | None
    multipliers: Array
    force: Array
    stiffness: Array
    acting: Array
    rounding: Array
    roundoff: Array
    stiffness_scale: Array
    is_oblique: bool = False

    @cached_property
    def unbalanced(self) -> Array:
        """g_N (f,) where it is more than rounding, else 0."""
        return np.where(np.abs(self.force) > self.rounding, self.force, 0.0)

    @cached_property
    def residual(self) -> float:
        """Largest unbalanced force over the forces that act on the same motion."""
        left = np.abs(self.unbalanced)
        shares = np.divide(left, self.acting, out=np.zeros_like(left), where=left > 0.0)
        return float(shares.max(initial=0.0))

    @cached_property
    def is_rounding(self) -> bool:
        """Whether all unbalanced forces may be rounding."""
        return bool((np.abs(self.force) <= self.roundoff).all())

    @cached_property
    def merit(self) -> float:
        """Size of all unbalanced forces, each measured by the stiffness of its motion."""
        return numerics.norm(self.unbalanced / np.sqrt(self.stiffness_scale))

    @cached_property
    def undecided(self) -> float:
        """Error of `scaled`: unbalanced forces still move the posture, and with it H_N.

        H_N changes by as much as the stiffest stiffness turns over such a motion.
        """
        left = float(np.max(np.abs(self.unbalanced) / self.stiffness_scale, initial=0.0))
        stiffness_scale = self.stiffness_scale.tolist()
        return (
            left * max(stiffness_scale) / min(stiffness_scale) if stiffness_scale else 0.0
        )

    @cached_property
    def scaled(self) -> Array:
        """H_N over the geometric mean of its motions' scales:
        springs of any ratio alike.
        """
        per = 1 / np.sqrt(self.stiffness_scale)
        return self.stiffness * per[:, None] * per

    @cached_property
    def modes(self) -> tuple[Array, Array]:
        """Eigenvalues (f,) of `scaled` and motions (f, f):
        H_N between them is diagonal.
        """
        values, vectors = np.linalg.eigh(0.5 * (self.scaled + self.scaled.T))
        return values, vectors / np.sqrt(self.stiffness_scale)[:, None]

    def solved(self, right: Array, softest: float) -> Array:
        """Least-squares solution (f,) of H_N y = right, judged on `scaled`."""
        per = 1 / np.sqrt(self.stiffness_scale)
        return np.asarray(
            per * np.linalg.lstsq(self.scaled, per * right, rcond=softest)[0]
        )

    def motion(self, y: Array) -> Array:
        """Natural coordinates (n,) of a free motion (f,)."""
        return y if self.free is None else np.asarray(self.free @ y)


def spectrum(balance: Balance, conservative: bool) -> Array:
    """Eigenvalues of H_N by increasing real part.

    Without a potential they may be complex.
    """
    stiffness = balance.stiffness
    if balance.is_oblique and balance.free is not None:
        back = np.linalg.inv(np.linalg.qr(balance.free, mode="r"))
        stiffness = back.T @ stiffness @ back
        if conservative:
            return eigenvalues(stiffness)
    if conservative:
        inverse = invert(
            0.5 * (stiffness + stiffness.T), np.sqrt(balance.stiffness_scale)
        )
        if inverse is None:
            return eigenvalues(stiffness)
        return eigenvalues(stiffness, inverse.matrix, doubtful=True)
    roots = np.linalg.eigvals(stiffness)
    roots = roots[np.argsort(roots.real)]
    return roots.real if np.isrealobj(roots) or not roots.imag.any() else roots


class Contact(NamedTuple):
    """A limit that is touched: which quantity, and on which side (-1 lower, +1 upper)."""

    quantity: int
    side: int


def contact_limits(elastic: ElasticMechanism, start: MechanismPosture) -> Limits:
    """Limits that a mechanism can come to rest on.

    If it is at rest without a load at the start, limits that are exceeded there are left
    out: the way back to them would count as a deflection.
    """
    limits = limits_of(elastic.mechanism, contacts=True)
    if limits.holds(start.q, start.pose) or not _rests_at(elastic, start):
        return limits
    values = limits.values(start.q, start.pose)
    return limits.leaving_out(limits.side(values, sizes(limits, start)))


def _rests_at(elastic: ElasticMechanism, start: MechanismPosture) -> bool:
    """Whether the forces balance at a posture, closures aside."""
    springs = elastic.springs
    if springs is not None and springs.holding().any():
        elastic = with_rest_balancing(elastic, start)
    elif elastic.has_open_rest:
        return True
    energy, lengths = elastic.evaluate(start), start.coordinate_lengths
    stiffness = numerics.largest(energy.hessian * np.outer(lengths, lengths))
    return bool(
        numerics.largest(energy.gradient * lengths)
        <= numerics.NEGLIGIBLE_DIFFERENCE * stiffness
    )


def notes_at_start(
    mechanism: Mechanism, start: MechanismPosture, acting: Limits
) -> list[Note]:
    """Notes of limits that are exceeded at the start, and whether they are left out."""
    notes = limit_notes(mechanism, start, "at the start: ")
    words = ". What follows is computed without the limits that are exceeded there"
    if not acting.left_out.any():
        words = (
            ". The limits act from there on: the displacement begins with the way "
            "back to them"
        )
    if not len(acting):
        words = ""
    return [
        Note(n.code, n.message + (words if n.code == "beyond-limits" else ""), n.values)
        for n in notes
    ]


def sizes(limits: Limits, posture: MechanismPosture) -> Array:
    """Natural sizes (m,) of the limited quantities."""
    if limits.legs is not None:
        return np.full(len(limits), posture.length)
    return posture.coordinate_lengths[limits.columns]


def bound(limits: Limits, contact: Contact) -> float:
    """Value of the touched bound."""
    return float((limits.lower if contact.side < 0 else limits.upper)[contact.quantity])


def constraint(
    limits: Limits, posture: MechanismPosture, contacts: Sequence[Contact]
) -> tuple[Array, SecondOrderMap]:
    """Distances (k,) from the touched bounds, and their map of the coordinates."""
    where = [c.quantity for c in contacts]
    values = limits.values(posture.q, posture.pose)[where]
    residual = values - np.array([bound(limits, c) for c in contacts])
    columns = limits.columns[where]
    return residual, posture.map_of_bounded(columns.tolist())


#: Lines g (m, 6) that hold a body, their stiffnesses (m,), the remainder of the Hessian.
Lines = tuple[Array, Array, Array]

#: Error of an evaluated force, in units of rounding: Jacobians of long chains lose a few,
#: and coordinates are rounded themselves.
ROUNDINGS = 8.0
#: Longest step onto the constraints, in natural units, and the largest number of such
#: steps.
_LONGEST_RETRACTION, _MAX_RETRACTIONS = 0.2, 100


def refuse_springs_far_apart(elastic: ElasticMechanism) -> None:
    """Refuse springs of which double precision does not know the soft beside the stiff.

    Raises
    ------
    InputError
        With the two springs and the cure.
    """
    springs = elastic.springs
    if springs is None or not springs.stiffness.any():
        return
    k, slides = springs.stiffness, elastic.slides
    natural, cure = k, "stiffnesses nearer to each other: lines cannot be rigid"
    if springs.of_coordinates(len(elastic.names)).any():
        natural = k * elastic.mechanism.at(elastic.q).coordinate_lengths ** 2
        cure = "the stiff one made rigid (stiffness: rigid)"
    stiff = int(natural.argmax())
    soft = int(np.where(natural > 0.0, natural, np.inf).argmin())
    if natural[stiff] <= numerics.LARGEST_STIFFNESS_RATIO * natural[soft]:
        return
    shown = [
        f"{elastic.spring_names[i]} with {k[i]:.3g} {elastic.units.spring(slides[i])}"
        for i in (stiff, soft)
    ]
    raise InputError(
        "two springs differ by more than a factor "
        f"{numerics.LARGEST_STIFFNESS_RATIO:.0e}, which "
        f"double precision does not resolve together: {' and '.join(shown)}",
        expected=cure,
    )


class System:
    """An elastic mechanism with loads, held components and limits.

    Parameters
    ----------
    elastic : ElasticMechanism
        With all rest positions chosen.
    loads : sequence of Potential
        Further potentials.
    held : Held, optional
        With its reference pose.
    limits : Limits
        Limits of joints or legs.

    Raises
    ------
    InputError
        If a load is not a potential.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        loads: Sequence[Potential] = (),
        held: Held | None = None,
        limits: Limits | None = None,
    ) -> None:
        for load in loads:
            if not isinstance(load, Potential):
                raise InputError(
                    "a load is not a potential",
                    expected="DeadForce, DeadWrench, FollowerWrench or another Potential",
                    got=load,
                )
        self.elastic = elastic
        self.loads = tuple(loads)
        self.held = held
        self.limits = (
            limits_of(elastic.mechanism, ignore=True) if limits is None else limits
        )
        self.terms = (*elastic.terms(), *self.loads)

    def of(self, elastic: ElasticMechanism, loads: Sequence[Potential]) -> System:
        """The same held components and limits on another mechanism with other loads."""
        limits = limits_of(elastic.mechanism, ignore=not len(self.limits), contacts=True)
        if len(limits) == len(self.limits):
            limits = limits.leaving_out(self.limits.left_out)
        return System(elastic, loads, self.held, limits)

    def at(self, q: ArrayLike) -> Point:
        """Everything that acts at coordinates q."""
        count()
        posture = self.elastic.mechanism.at(q)
        columns = posture.coordinate_lengths
        n = columns.size
        if len(self.limits):
            limited = self.limits.values(posture.q, posture.pose)
        else:
            limited = np.empty(0)
        nothing = Evaluation(0.0, np.zeros(n), np.zeros((n, n)))
        point = Point(
            posture.q,
            posture,
            nothing,
            0.0,
            np.zeros(n),
            np.zeros((n, n)),
            limited,
            columns[:, None] * columns,
        )
        for term in self.terms:
            evaluation = term.evaluate(posture)
            point.add(evaluation, term.member_forces(posture, evaluation.gradient))
        return point

    def own_stiffness(self, posture: MechanismPosture) -> tuple[Array, float]:
        """Size (n,) of each coordinate's stiffness without loads,
        and the ratio of its extremes.

        In natural units; stiffnesses that are rounding are 0, and of no extreme.
        """
        hessian = self.elastic.evaluate(posture).hessian
        own = np.abs(np.diag(hessian)) * posture.coordinate_lengths**2
        own[own <= numerics.EPSILON * own.max(initial=0.0)] = 0.0
        return own, float(own.max(initial=0.0) / own.min(initial=inf, where=own > 0.0))

    def constraints(
        self, posture: MechanismPosture, contacts: Sequence[Contact]
    ) -> tuple[Array, SecondOrderMap, Array] | None:
        """Residual (m,), map, and natural size (m,) of closures, held components,
        contacts.
        """
        # Each constraint with the natural sizes of its residual.
        parts: list[tuple[Array, SecondOrderMap, Array]] = []
        if posture.closure is not None and posture.residual is not None:
            unit = np.full(len(posture.residual), max(1.0, posture.length))
            parts.append((posture.residual, posture.closure, unit))
        if self.held is not None:
            residual, to_held, _ = self.held.constraint(posture)
            unit = np.where(np.array(self.held.rows) < 3, 1.0, posture.length)
            parts.append((residual, to_held, unit))
        if contacts:
            unit = sizes(self.limits, posture)[[c.quantity for c in contacts]]
            parts.append((*constraint(self.limits, posture, contacts), unit))
        if len(parts) < 2:
            return parts[0] if parts else None
        # Several constraints are one map.
        residuals, maps, units = zip(*parts, strict=True)
        counts = np.cumsum(list(map(len, residuals)))[:-1]

        def curvature(multipliers: Array) -> Array:
            shares = np.split(multipliers, counts)
            each = (m.curvature(s) for m, s in zip(maps, shares, strict=True))
            total: Array = sum(each, start=np.zeros(1))
            return total

        jacobian = np.concatenate([m.jacobian for m in maps])
        whole = SecondOrderMap(jacobian, curvature)
        return np.concatenate(residuals), whole, np.concatenate(units)

    def balance(self, point: Point, contacts: Sequence[Contact] = ()) -> Balance:
        """Forces and stiffness on the motions that keep the constraints."""
        columns = point.posture.coordinate_lengths
        g = point.evaluation.gradient * columns
        H = point.evaluation.hessian * point.areas
        constraints = self.constraints(point.posture, contacts)
        N, lam, forces = None, np.empty(0), point.forces
        if constraints is not None:
            _, to_constraints, units = constraints
            A = to_constraints.jacobian * columns / units[:, None]
            closed = decompose(A)
            N, carried = closed.N, closed.forces(-g, list(range(len(g))))
            forces = forces + np.abs(A.T @ carried)
            lam = carried / units
            H = H + to_constraints.curvature(lam) * point.areas
        reach = self._reach(point.posture)
        lines = line_springs_and_rest(self.elastic, point.posture)
        legs = None if constraints is not None else self._by_lengths(point, lines)
        own_rounding: Array | float = 0.0
        if legs is not None:
            N, H, scale = legs.motions, legs.stiffness, legs.terms
            g, forces, own = N.T @ g, np.abs(N.T) @ forces, legs.terms.diagonal()
        elif (
            N is None
            and not self.elastic.potentials
            and not point.posture.coordinates_are_pose
        ):
            # Forces are judged by coordinate: each has its own spring.
            scale = point.stiffness_scale
            own = scale.diagonal()
        else:
            # Principal motions, so that no soft one is judged by the forces of a stiff
            # one.
            N = np.eye(len(g)) if N is None else N
            K = N.T @ H @ N
            N = N @ np.linalg.eigh(0.5 * (K + K.T))[1]
            g, H, forces = N.T @ g, N.T @ H @ N, np.abs(N.T) @ forces
            scale = np.abs(H)
            lost = len(g) * EPSILON * float(point.stiffness_scale.max(initial=0.0))
            own = np.maximum(np.diag(scale), lost / FREE_MOTION_STIFFNESS)
            own_rounding = self._rounding_stiffness(point.posture, lines, N) * reach
        own = np.maximum(
            own,
            max(
                numerics.FREE_STIFFNESS_SHARE * float(own.max(initial=0.0)), numerics.TINY
            ),
        )
        unit = ROUNDINGS * EPSILON
        rounding = unit * (
            scale.sum(axis=1) * reach + float(point.forces.max(initial=0.0))
        )
        roundoff = rounding + unit * own_rounding
        return Balance(N, lam, g, H, forces, rounding, roundoff, own, legs is not None)

    def _rounding_stiffness(
        self, posture: MechanismPosture, lines: Lines | None, N: Array
    ) -> Array:
        """Force (f,) on each motion per unit of rounding in every spring's own length.

        A soft motion of a matrix may still move a stiff spring a little.
        """
        columns, force = posture.coordinate_lengths, np.zeros(N.shape[1])
        if lines is not None:
            force += np.abs(N.T @ (lines[0] * columns).T) @ lines[1] * posture.length
        springs = self.elastic.springs
        if springs is not None:
            force += np.abs(N.T) @ (springs.of_coordinates(len(columns)) * columns**2)
        return force

    def _by_lengths(self, point: Point, parts: Lines | None) -> ByLengths | None:
        """Motions of a body on lines, with line lengths as coordinates;
        None if not needed.

        Stiff lines would hide soft motions in rounding. None if no line is much stiffer
        than another, or if the lengths do not determine the body's motions.
        """
        if parts is None:
            return None
        lines, k, rest = parts
        if not 0.0 < float(k.min()) * numerics.SLOWING_STIFFNESS_RATIO < float(k.max()):
            return None
        for load in self.loads:
            rest = rest + load.evaluate(point.posture).hessian
        columns, L = point.posture.coordinate_lengths, point.posture.length
        # Lengths in natural units, as all coordinates.
        return by_lengths(
            lines * columns / L, k * L**2, rest * columns * columns[:, None]
        )

    def at_rest(self, point: Point) -> ElasticMechanism:
        """The mechanism in an equilibrium, its lines with the tensions that balance.

        Computed from the lengths of stiff lines, tensions would be rounded and turn soft
        motions.
        """
        elastic, posture = self.elastic, point.posture
        springs = elastic.springs
        legs = self._by_lengths(point, line_springs_and_rest(elastic, posture))
        if legs is None or springs is None or self.held is not None:
            return elastic
        unbalanced = legs.motions.T @ (
            point.evaluation.gradient * posture.coordinate_lengths
        )
        less = unbalanced / posture.length
        return replace(
            elastic, springs=springs.shifted(posture, legs.leading.tolist(), less)
        )

    @cached_property
    def _farthest_anchor(self) -> float:
        """Distance from F's origin of the farthest point that a line holds
        the body to.
        """
        return max((term.farthest_anchor for term in self.terms), default=0.0)

    def _reach(self, posture: MechanismPosture) -> float:
        """Largest coordinate in natural units, at least 1.

        Their rounding is proportional to it.
        """
        if (
            posture.coordinates_are_pose
        ):  # a length is the difference of two points so far away
            farthest = max(
                float(np.abs(posture.pose[:3, 3]).max()), self._farthest_anchor
            )
            return 1.0 + farthest / posture.length
        return max(1.0, numerics.largest(posture.q / posture.coordinate_lengths))

    @cached_property
    def _is_constrained(self) -> bool:
        """Whether closures or held components constrain the coordinates in
        every posture.
        """
        closure = self.elastic.mechanism.at(self.elastic.q).closure
        return closure is not None or self.held is not None

    @cached_property
    def _step_weights(self) -> Array | float:
        """Motion of each coordinate (n,) under equal forces; the softest: 1."""
        springs = self.elastic.springs
        own = None if springs is None else springs.of_coordinates(len(self.elastic.names))
        if own is None or not own.any():
            return 1.0
        lengths = self.elastic.mechanism.at(self.elastic.q).coordinate_lengths
        k = np.asarray(own * lengths**2)
        softest = float(k[k > 0.0].min())
        return np.sqrt(softest / np.maximum(k, softest))

    def turning(self, posture: MechanismPosture, step: Array) -> float:
        """Largest angle of a step in natural units."""
        if posture.coordinates_are_pose:
            return float(np.abs(step[:3]).max())
        return numerics.largest(step[self._angles])

    @cached_property
    def _angles(self) -> list[bool]:
        return (~self.elastic.mechanism.is_length).tolist()

    def displacement(self, start: Point, end: Point) -> Array:
        """Step (n,) from one point to another, in natural units."""
        lengths = start.posture.coordinate_lengths
        if start.posture.coordinates_are_pose:
            return np.asarray(
                se3.log(se3.inverse(start.posture.pose) @ end.posture.pose) / lengths
            )
        return np.asarray((end.q - start.q) / lengths)

    def displaced(self, point: Point, step: Array) -> Array:
        """Coordinates after a step in natural units,
        before the constraints are restored.
        """
        return self.elastic.mechanism.displaced(
            point.q, step * point.posture.coordinate_lengths
        )

    def retracted(self, q: Array, contacts: Sequence[Contact] = ()) -> Array:
        """Coordinates near q that satisfy all constraints,
        by Newton's steps of least change.

        Stiff joints move least: there the rounding of a change is a force.

        Raises
        ------
        ConvergenceError
            If they cannot be met from there.
        """
        if not self._is_constrained and not contacts:
            return q
        mechanism = self.elastic.mechanism
        start = mechanism.at(q)

        def equations(posture: MechanismPosture) -> tuple[Array, Array]:
            count()
            constraints = self.constraints(posture, contacts)
            assert constraints is not None  # there are some, see above
            residual, to_constraints, units = constraints
            rates = to_constraints.jacobian * posture.coordinate_lengths / units[:, None]
            return residual / units, rates

        def retract(posture: MechanismPosture, step: Array) -> MechanismPosture:
            step = posture.coordinate_lengths * step
            return mechanism.at(mechanism.displaced(posture.q, step))

        posture, size, iterations = least_change(
            start,
            equations,
            retract,
            evaluations=_MAX_RETRACTIONS,
            longest_step=_LONGEST_RETRACTION,
            weights=self._step_weights,
        )
        if size <= numerics.CONSTRAINT_TOLERANCE:
            return posture.q
        kinds = ("closures", posture.closure), ("held displacement", self.held)
        what = [name for name, one in kinds if one is not None] + ["limits"] * bool(
            contacts
        )
        beyond = limit_notes(mechanism, start) if contacts else []
        raise ConvergenceError(
            f"the {' and '.join(what)} cannot be met from this posture"
            + "".join(f"; {note.message}" for note in beyond),
            iterations=iterations,
            residual=size,
        )
