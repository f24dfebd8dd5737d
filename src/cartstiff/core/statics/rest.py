r"""State of a mechanism at rest: coordinates, stability, reactions, stiffness.

Its derivative by a compliance theta: at rest ``g(q, theta) + A^T lam = 0``, so

    dq / d theta = - N H_N^-1 N^T dg / d theta

with H_N the tangent of all forces. Springs whose rest positions are chosen to balance the
others at the start keep their forces there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result, fixed, read_only
from cartstiff.core.described import described
from cartstiff.core.errors import ConvergenceError, UndefinedError
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import gravity_loads
from cartstiff.core.mechanisms.identified import CompliancePattern
from cartstiff.core.mechanisms.limits import deflection_notes, limit_notes, limits_of
from cartstiff.core.notes import Note
from cartstiff.core.numerics import FREE_MOTION_STIFFNESS
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.results import LabelledResult
from cartstiff.core.statics.continuation import load_curve
from cartstiff.core.statics.held import displacement_between
from cartstiff.core.statics.newton import Solution, solve
from cartstiff.core.statics.problem import (
    Balance,
    Point,
    System,
    bounded,
    notes_at_start,
    spectrum,
)
from cartstiff.core.statics.small_motions import (
    MASSLESS,
    UNDAMPED,
    divergence,
    unstable_up_to,
    vibrations,
)
from cartstiff.core.stiffness.forces import force_notes, forces_of, may_be_beyond
from cartstiff.core.stiffness.posture import PostureStiffness
from cartstiff.core.stiffness.posture_notes import near_constraint
from cartstiff.core.stiffness.reduction import reduced_at
from cartstiff.core.stiffness.tensor import StiffnessTensor, codes_of, numbers_text


def motion_under_forces(
    posture: MechanismPosture, balance: Balance, forces: Array
) -> Array:
    """Motion (n, k) of the coordinates at rest under small generalised forces (n, k)."""
    columns = posture.coordinate_lengths[:, None]
    right = forces * columns
    if balance.free is not None:
        right = balance.free.T @ right
    per = 1.0 / np.sqrt(balance.stiffness_scale)[:, None]
    y = per * np.linalg.lstsq(balance.scaled, per * right, rcond=numerics.ZERO_SHARE)[0]
    return np.asarray(columns * balance.motion(y))


def motion_by_compliance(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    balance: Balance,
    parameters: Sequence[CompliancePattern],
    start: MechanismPosture | None = None,
    chosen: Array | None = None,
) -> Array:
    """Derivative (n, P) of the coordinates at rest by each parameter.

    Parameters
    ----------
    elastic : ElasticMechanism
        With all rest positions chosen.
    posture : MechanismPosture
        At rest.
    balance : Balance
        Forces and stiffness there.
    parameters : sequence of CompliancePattern
        The parameters (P,).
    start : MechanismPosture, optional
        Where rest positions were chosen.
    chosen : ndarray (m,), optional
        Forces there of the springs whose rest positions these are, else NaN.
    """
    forces = np.zeros((len(posture.q), len(parameters)))
    for p, parameter in enumerate(parameters):
        for key, weight in parameter.keys:
            *both, factor = elastic.softened(key, start, chosen)
            more, less = (term.evaluate(posture).gradient for term in both)
            forces[:, p] -= weight * factor * np.nan_to_num(more - less)
    return motion_under_forces(posture, balance, forces)


_NEUTRAL = (
    "a motion costs no energy to second order, or too little to be seen beside the "
    "stiffest spring: definiteness does not decide stability here"
)


def state_of_rest(
    system: System,
    solution: Solution,
    start: MechanismPosture,
    stages: int,
    **facts: Any,
) -> Equilibrium:
    """The result of a solution: verdict on its stability, reactions, notes; with
    further facts of the result.
    """
    point, balance = solution.point, solution.balance
    notes = list(system.elastic.notes)
    conservative = not np.isnan(point.evaluation.energy)
    unresolved = _unresolved(point, balance, start)
    known = [n.values.get("largest") for n in unresolved]
    is_anywhere = any(isinstance(x, float) and x >= 1.0 for x in known)
    if conservative:
        stable, squares, diagnostics = _by_energy(balance, is_anywhere)
    else:
        stable, squares, diagnostics = _by_vibrations(system, point, balance)
    notes += diagnostics
    if stages > 1:
        notes.append(
            Note(
                "load-stages",
                f"the load was put on in {stages} stages: at once, no equilibrium was "
                "found",
                {"stages": stages},
            )
        )
    reactions = _reactions(system, solution)
    notes += _notes_on_posture(system, start, point.posture, reactions)
    # An unstable equilibrium is left anyway; the sign of a determinant gives no position.
    if stable is not False or not conservative:
        notes += unresolved
    for name, force in reactions.limits.items():
        side = "lower" if force > 0 else "upper"
        notes.append(
            Note("limit-contact", f"{name} rests on its {side} limit", {name: force})
        )
    return Equilibrium(
        system.elastic,
        system.loads,
        read_only(point.q),
        point.posture,
        start,
        point.evaluation.energy,
        0.0 if balance.is_rounding else balance.residual,
        solution.iterations,
        tuple(solution.history),
        stable,
        reactions,
        tuple(notes),
        system,
        solution,
        squares,
        **facts,
    )


def _notes_on_posture(
    system: System,
    start: MechanismPosture,
    posture: MechanismPosture,
    reactions: Reactions,
) -> list[Note]:
    """Notes on the start, and on limits, forces, deflections and weight at rest."""
    elastic, limits = system.elastic, system.limits
    notes = [*notes_at_start(elastic.mechanism, start, limits)]
    if not len(limits) or len(limits_of(elastic.mechanism)) > len(limits):
        notes += limit_notes(elastic.mechanism, posture, "at rest: ")
    if may_be_beyond(elastic, posture):
        notes += force_notes(forces_of(elastic, posture, reactions.rigid), elastic)
    notes += deflection_notes(elastic, posture.q)
    notes += elastic.diagnostics(posture)
    if elastic.gravity is not None:
        notes += gravity_loads(elastic).notes
    return notes


def _by_energy(
    balance: Balance, is_anywhere: bool
) -> tuple[bool | None, None, list[Note]]:
    """Verdict by the energy's second derivative, no vibrations, and notes.

    No verdict if the rounding leaves the posture open.
    """
    scaled, modes = balance.modes
    zero = max(FREE_MOTION_STIFFNESS, balance.undecided)
    if not is_anywhere and (scaled > zero).all():
        return True, None, []
    facts: dict[str, object] = {
        "eigenvalues": spectrum(balance, conservative=True).tolist()
    }
    if is_anywhere or (scaled >= -zero).all():
        return None, None, [Note("neutral", _NEUTRAL, facts)]
    direction = balance.motion(modes[:, 0])
    facts["direction"] = (direction / np.linalg.norm(direction)).tolist()
    words = "the equilibrium is unstable: the mechanism leaves it by itself"
    return False, None, [Note("unstable", words, facts)]


def _by_vibrations(
    system: System, point: Point, balance: Balance
) -> tuple[bool | None, Array, list[Note]]:
    """Verdict by small vibrations, for loads without a potential."""
    vibration = vibrations(point, balance, system.elastic.units, system.terms)
    words = "a load has no potential: the definiteness of its tangent proves nothing"
    notes = [Note("non-conservative", words)]
    squares = np.empty(0) if vibration is None else vibration.squares
    if vibration is not None and vibration.growing == "flutter":
        facts = {"frequency": vibration.frequency, "mode": vibration.mode.tolist()}
        words = "vibrations about the equilibrium grow (flutter)"
        return False, squares, [*notes, Note("flutter", words, facts)]
    is_growing = vibration is not None and vibration.growing == "divergence"
    mode = vibration.mode if vibration is not None and is_growing else divergence(balance)
    if mode is not None:
        words = "the mechanism leaves the equilibrium in one sense (divergence)"
        if vibration is None:
            words += (
                ", whatever its masses are: the determinant of the tangent is negative"
            )
        facts = {"frequency": None, "mode": mode.tolist()}
        return False, squares, [*notes, Note("divergence", words, facts)]
    if vibration is not None:
        return None, squares, [*notes, UNDAMPED]
    return _without_masses(balance, squares, notes)


def _without_masses(
    balance: Balance, squares: Array, notes: list[Note]
) -> tuple[bool | None, Array, list[Note]]:
    """Verdict by the tangent alone, if its determinant is not negative."""
    ratio = unstable_up_to(balance)
    if ratio <= 1.0:
        return None, squares, [*notes, MASSLESS]
    facts: dict[str, object] = {
        "eigenvalues": [complex(v).real for v in spectrum(balance, conservative=False)],
        "inertia_ratio": ratio if np.isfinite(ratio) else None,
    }
    whose = "whatever the masses are"
    if np.isfinite(ratio):
        whose = (
            f"unless the inertias of its motions differ by more than a factor {ratio:.2g}"
        )
    words = (
        f"the mechanism leaves the equilibrium by itself, {whose}: its energy is no "
        "minimum"
    )
    if ratio >= numerics.LARGEST_INERTIA_RATIO:
        return False, squares, [*notes, Note("unstable", words, facts)]
    return (
        None,
        squares,
        [*notes, Note(MASSLESS.code, f"{MASSLESS.message}; {words}", facts)],
    )


def _unresolved(point: Point, balance: Balance, start: MechanismPosture) -> list[Note]:
    """Notes on coordinates that are not known, as the rounding of stiff
    springs moves them.
    """
    per = 1 / np.sqrt(balance.stiffness_scale)
    if (
        np.isnan(point.evaluation.energy)
        and numerics.invert(balance.scaled, per / per) is None
    ):
        return [Note("neutral", _NEUTRAL)]  # with a potential `_by_energy` notes it
    inverse = np.abs(numerics.inverted(balance.scaled))
    errors = per * (inverse @ (per * (balance.rounding + np.abs(balance.unbalanced))))
    if not len(per) or not np.isfinite(errors).all():
        return []  # neutral, which is noted
    if balance.free is not None:
        errors = np.abs(balance.free) @ errors
    most = float(errors.max())
    away = np.abs(point.q - start.q) / point.posture.coordinate_lengths
    # The rounding includes the farthest anchor, up to twice as far away as the body.
    if most <= max(2.0 * numerics.ROUNDOFF, numerics.LOST_ERROR * float(away.max())):
        return []
    known = "are not known at all"
    if most < 1.0:
        known = f"are known to {most:.1g} (rad, or shares of the characteristic length)"
    words = (
        f"the rounding of stiff springs' forces moves soft motions: coordinates {known}"
    )
    each = errors * point.posture.coordinate_lengths
    return [
        Note("posture-unresolved", words, {"largest": most, "uncertainty": each.tolist()})
    ]


def _reactions(system: System, solution: Solution) -> Reactions:
    posture, lam = solution.point.posture, solution.balance.multipliers
    touched = len(solution.contacts)
    rows = 0 if system.held is None else len(system.held.rows)
    stiff = sorted(system.elastic.mechanism.rigid)
    loops = len(lam) - rows - touched
    closures = read_only(lam[: loops - len(stiff)])
    names = system.elastic.names
    torques = (-lam[loops - len(stiff) : loops]).tolist()
    rigid = {names[j]: torque for j, torque in zip(stiff, torques, strict=True)}
    stops = -lam[len(lam) - touched :]
    limits = {
        system.limits.names[c.quantity]: float(force)
        for c, force in zip(solution.contacts, stops, strict=True)
    }
    held, wrench = {}, None
    if system.held is not None:
        forces = -lam[loops : loops + rows]
        _, _, to_components = system.held.constraint(posture)
        held = dict(zip(system.held.names, forces.tolist(), strict=True))
        wrench = read_only(to_components.T @ forces)
    return Reactions(held, wrench, limits, closures, rigid)


#: Bound on the points of a curve on which critical loads, or its end, are sought.
MAX_CURVE_POINTS = 200
# Messages on critical loads of that curve, by kind.
_CRITICAL_LOADS = {
    "limit": "a limit point, where the mechanism snaps through: it comes to rest "
    "elsewhere than a small load leads to",
    "bifurcation": "a bifurcation, where the mechanism buckles",
}


@dataclass(frozen=True, eq=False)
class Reactions:
    """Constraint forces on the mechanism.

    Attributes
    ----------
    held : mapping of str to float
        Force or moment that the environment applies in each held component of the
        displacement.
    wrench : ndarray (6,) or None
        The same as a wrench (moment, force) on the held frame, in its components; None if
        nothing is held.
    limits : mapping of str to float
        Force of each touched stop on its joint or leg: positive at a lower limit,
        negative at an upper one.
    closures : ndarray
        Forces of the closures, frame b on frame a per component of the residual.
    rigid : mapping of str to float
        Torque (force) of each rigid joint on the link that it moves.
    """

    held: Mapping[str, float]
    wrench: Array | None
    limits: Mapping[str, float]
    closures: Array
    rigid: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Result, LabelledResult):
    """A state in which all forces balance.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism with the rest positions that were used.
    loads : tuple of Potential
        Added loads.
    q : ndarray (n,)
        Coordinates.
    posture, start : MechanismPosture
        Kinematics there, and at the start of the search.
    energy : float
        Springs, gravity, and loads; NaN if a load has no potential.
    residual : float
        Largest unbalanced generalised force over the forces that act on the same motion;
        0 if all that remains is the rounding of coordinates and forces.
    iterations : int
        Newton steps.
    history : tuple of float
        Residual before each of them, the same share.
    stable : bool or None
        Whether H_N is positive definite. None if that decides nothing: at a zero
        eigenvalue ("neutral"), and without an energy unless vibrations grow; see
        `cartstiff.core.statics.small_motions`.
    eigenvalues : ndarray
        Eigenvalues of H_N in natural units (angles in rad, distances in the
        characteristic length): energies. Without an energy omega^2 of the vibrations
        (rad^2/s^2), which may be complex; none if masses are missing.
    reactions : Reactions
        Forces of held components, limits and closures.
    """

    command: ClassVar = "equilibrium"

    elastic: ElasticMechanism
    loads: tuple[Potential, ...]
    q: Array
    posture: MechanismPosture
    start: MechanismPosture
    energy: float
    residual: float
    iterations: int
    history: tuple[float, ...]
    stable: bool | None
    reactions: Reactions
    _own_notes: tuple[Note, ...]
    _system: System
    _solution: Solution
    #: omega^2 of the vibrations, without an energy.
    _squares: Array | None = None
    #: State at the start of springs whose rest positions were chosen there; or None.
    _chosen: Array | None = None
    #: See `ElasticMechanism.before_load`, of the mechanism as it was given.
    _before_load: Literal["balanced", "given", "partly"] | None = None

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """Findings, assumptions, and critical loads on the way from zero.

        The latter are sought when this is first read, if the loads have a potential and
        the equilibrium is far from the first step's prediction.
        """
        if not (self.stable and self._solution.is_far):
            return self._own_notes
        notes = self._notes_on_start() or (self._notes_on_way() if self.loads else [])
        return (*self._own_notes, *notes)

    def _notes_on_start(self) -> list[Note]:
        """Note on a start that is balanced without the added loads, but not stable."""
        rest = self._without_loads(settle=False)
        if rest is None or rest.iterations or rest.stable is not False:
            return []
        words = "at the start the springs balance the mechanism without holding it: that "
        words += (
            "equilibrium is unstable, and the displacement includes the way from it to a "
        )
        return [
            Note("unstable-start", words + "stable one", {"q": self.start.q.tolist()})
        ]

    def _notes_on_way(self) -> list[Note]:
        """Notes on critical loads that gradually growing loads pass."""
        system = self._system
        try:
            with bounded(self.elastic):
                curve = load_curve(
                    self.elastic,
                    self.start.q,
                    *self.loads,
                    held=system.held,
                    points=MAX_CURVE_POINTS,
                )
        except (ConvergenceError, UndefinedError):
            return []
        # Beyond the first critical load the mechanism is no longer on this curve.
        passed = next(
            (point for point in curve.critical if point.kind in _CRITICAL_LOADS), None
        )
        if passed is not None:
            code = "limit-point" if passed.kind == "limit" else "bifurcation"
            factor = float(passed.factor)
            words = (
                f"the way from the unloaded state passes, at {factor:.4g} of the load, "
            )
            words, values = words + _CRITICAL_LOADS[passed.kind], {"factor": factor}
            mirror = None if code == "limit-point" else self._mirrored(curve.q[-1])
            if mirror is not None:
                words += (
                    ", and a mirror state exists: it is stable, too, and has the "
                    "same energy"
                )
                values["mirror"] = mirror.q.tolist()
            return [Note(code, words, values)]
        if curve.reason == "factor-reached":
            end = system.at(curve.q[-1])
            away = numerics.largest(system.displacement(end, self._solution.point))
            if away > numerics.NEGLIGIBLE_DISTANCE:
                words = (
                    "the loads, put on gradually, lead to another equilibrium than "
                    "this one"
                )
                return [Note("other-equilibrium", words, {"q": end.q.tolist()})]
        return []

    def _mirrored(self, middle: Array) -> Equilibrium | None:
        """The other stable state of the same energy, sought opposite to this one;
        None without.

        Parameters
        ----------
        middle : ndarray (n,)
            Coordinates on the curve that both states have left.
        """
        system = self._system
        try:
            start = self.elastic.mechanism.closed(2.0 * middle - self.q, hold=[]).q
            with bounded(self.elastic):
                found = state_of_rest(system, solve(system, start), self.start, 1)
        except (ConvergenceError, UndefinedError):
            return None
        away = np.abs(system.displacement(found._solution.point, self._solution.point))
        differ = abs(found.energy - self.energy)
        scale = abs(self.energy) + numerics.largest(self.eigenvalues)
        is_mirror = away.max(initial=0.0) > numerics.NEGLIGIBLE_DISTANCE
        if (
            is_mirror
            and found.stable
            and differ <= numerics.NEGLIGIBLE_DIFFERENCE * scale
        ):
            return found
        return None

    def _lines(self) -> list[str]:
        stable = {True: "stable", False: "unstable", None: "stability not decided"}[
            self.stable
        ]
        moved = self.pose[:3, 3] - self.start.pose[:3, 3]
        return [
            f"Equilibrium of {self.elastic.name} at {self.elastic.mechanism.frame}: "
            f"{stable}",
            f"  q      {numbers_text(self.q)}",
            f"  moved  {numbers_text(moved)} {self.elastic.units.length} since the "
            "start, in F",
            f"  notes  {codes_of(self.notes)}",
        ]

    def plot(self, ax: Any = None) -> Any:
        """Draw how far M moves under a small added unit force:
        see `PostureStiffness.plot`.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.
        """
        return self.stiffness.plot(ax)

    @property
    def pose(self) -> Array:
        """Pose ``T_F_M`` (4, 4)."""
        return fixed(self.posture.pose)

    @property
    def K(self) -> StiffnessTensor:  # noqa: N802
        """K^K there, the loads included; `stiffness` has all other results."""
        return self.stiffness.K

    @property
    def is_conservative(self) -> bool:
        """Whether all forces have a potential."""
        return not np.isnan(self.energy)

    @cached_property
    def eigenvalues(self) -> Array:
        """Eigenvalues (k,) of H_N, energies in natural units; without an energy omega^2
        [rad^2/s^2] of the vibrations.
        """
        if self._squares is not None:
            return fixed(self._squares)
        return read_only(spectrum(self._solution.balance, conservative=True))

    @cached_property
    def displacement(self) -> Array:
        """Rotation vector and translation (6,) of the body frame since the start,
        axes of F.
        """
        return displacement_between(self.start.pose, self.pose)

    @cached_property
    def before(self) -> Equilibrium | None:
        """The rest before the load, without the added loads and held components,
        near the start.

        The equilibrium itself without any; None if no such rest is found.
        """
        if not self.loads and self._system.held is None:
            return self
        return self._without_loads(settle=True)

    def _without_loads(self, settle: bool) -> Equilibrium | None:
        """The rest near the start without added loads and held components, if there is
        one; a stable one if the start is no equilibrium, and it may settle.
        """
        system = System(self.elastic, (), None, self._system.limits)
        try:
            with bounded(self.elastic):
                found = solve(system, self.start.q, settle=False)
                if settle and found.iterations:
                    found = solve(system, self.start.q)
        except (ConvergenceError, UndefinedError):
            return None
        return state_of_rest(system, found, self.start, 1)

    @property
    def relaxation(self) -> Array | None:
        """The part of `displacement` before the load: from the start to the rest
        `before`; (6,).

        Zero where the mechanism is at rest at the start, as with springs without rest
        positions.
        """
        return None if self.before is None else self.before.displacement

    @cached_property
    def displacement_by_load(self) -> Array | None:
        """Rotation vector and translation (6,) by the load, from the rest `before`;
        axes of F.
        """
        if self.before is None:
            return None
        return displacement_between(self.before.pose, self.pose)

    @property
    def has_free_motion(self) -> bool:
        """Whether a motion of the body costs no energy, so that its rest is
        not determined.
        """
        balance = self._solution.balance
        if (
            self.stable is not None
            or not self.is_conservative
            or not balance.stiffness.size
        ):
            return False
        values, modes = balance.modes
        free = balance.motion(
            modes[
                :,
                np.abs(values) <= max(numerics.FREE_MOTION_STIFFNESS, balance.undecided),
            ]
        )
        lengths = self.posture.coordinate_lengths[:, None]
        body = self.posture.motion.jacobian @ (lengths * free)
        body[3:] /= self.posture.length
        return bool(
            numerics.largest(body)
            > numerics.NEGLIGIBLE_DIFFERENCE * numerics.largest(free)
        )

    @cached_property
    def displacement_deviation(self) -> Array | None:
        """Standard deviation (6,) of `displacement` by measured springs;
        None without such.
        """
        known = self.elastic.identified
        if known is None:
            return None
        motion = motion_by_compliance(
            self.elastic,
            self.posture,
            self._solution.balance,
            known.patterns,
            self.start,
            self._chosen,
        )
        turned = (
            np.kron(np.eye(2), self.pose[:3, :3]) @ self.posture.motion.jacobian @ motion
        )
        variance = np.einsum("ip,pr,ir->i", turned, known.covariance, turned)
        return read_only(np.sqrt(np.maximum(variance, 0.0)))

    @cached_property
    def stiffness(self) -> PostureStiffness:
        """Stiffness with the loads included, which decides stability.

        If all loads have a potential and nothing is held, W = 0 and all connections
        agree. Touched limits are rigid.
        """
        return self._stiffness(self._at_rest.with_potential(*self.loads))

    @cached_property
    def elastic_stiffness(self) -> PostureStiffness:
        """Stiffness of the mechanism without the added loads,
        which appear as its wrench W.
        """
        return self._stiffness(self._at_rest, self._load_on_body)

    @cached_property
    def _at_rest(self) -> ElasticMechanism:
        if self._solution.contacts:
            return self.elastic
        return self._system.at_rest(self._solution.point)

    @property
    def meaning_of_elastic_wrench(self) -> str:
        """Meaning of W of `elastic_stiffness`, for people."""
        if self.elastic_stiffness.reduction.rank == 6:
            return "wrench that the springs balance, in the body frame"
        if self._load_on_body is not None:
            return (
                "load on the body, in its frame; springs and structure carry it together"
            )
        return (
            "part of the load that the springs balance, in the body frame; what the "
            "structure carries is not known"
        )

    @cached_property
    def _load_on_body(self) -> Array | None:
        """The loads' wrench on the body frame M; None if other loads act on
        the mechanism.

        Joint torques do not determine the part of the wrench that does no work on the
        joints.
        """
        if self._solution.contacts or self.reactions.held:
            return None
        W = np.zeros(6)
        for load in self.loads:
            own = load.wrench_on("body", self.pose)
            if own is None:
                return None
            W = W + own
        return W

    @cached_property
    def full_stiffness(self) -> tuple[Array, Array | None]:
        """K (n, n) of all forces on all coordinates, and the constraints'
        Jacobian (m, n).
        """
        point, H = self._solution.point, self._solution.point.evaluation.hessian
        constraints = self._system.constraints(point.posture, self._solution.contacts)
        if constraints is None:
            return H, None
        to_constraints = constraints[1]
        H = H + to_constraints.curvature(self._solution.balance.multipliers)
        return H, to_constraints.jacobian

    def _stiffness(
        self, elastic: ElasticMechanism, force: Array | None = None
    ) -> PostureStiffness:
        posture = self.posture
        evaluation = elastic.evaluate(posture)
        without = System(self.elastic, (), None, self._system.limits)
        constraints = without.constraints(posture, self._solution.contacts)
        closure = None if constraints is None else constraints[1]
        reduction = reduced_at(elastic, posture, evaluation, closure, force)
        notes = (*self.notes, *reduction.states, *near_constraint(reduction))
        # A given load is no rounding, however stiff the springs are that carry it.
        W = reduction.force
        is_given = (
            W is not None and force is not None and force.any() and np.allclose(W, force)
        )
        return PostureStiffness(
            elastic,
            self.q,
            posture,
            evaluation,
            reduction,
            notes,
            _load_is_given=bool(is_given),
            _before_load=self._before_load,
        )

    def _uncertainty(self) -> dict[str, Any] | None:
        """Deviation and interval of the displacement, if springs were measured."""
        known, s = self.elastic.identified, self.displacement_deviation
        if known is None or s is None:
            return None
        half = known.factor * s
        lower, upper = self.displacement - half, self.displacement + half
        return {"sd": s, "lower": lower, "upper": upper, "level": known.level}

    def to_dict(self) -> dict[str, Any]:
        """The object printed by ``cartstiff equilibrium --json``: the stiffness's,
        and more.
        """
        own = {
            "displacement_uncertainty": self._uncertainty(),
            "elastic_wrench": self.elastic_stiffness.wrench,
        }
        return self.stiffness.to_dict() | described("equilibrium", own, self)
