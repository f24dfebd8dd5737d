r"""One reduction for every mechanism: from energy in coordinates to stiffness
of an output.

Given the gradient g and Hessian H of the energy in n coordinates, closures with Jacobian
C, and an output (the end-effector's pose, or the actuated coordinates) with Jacobian J,
`reduce_to` takes five steps. Each solves one equation, and each is a function with a
small value as its result:

`motions` of `cartstiff.core.stiffness.motions`
    free motions N, self-motions Z, and motions Y that move the output along U:

        C N = 0,     J Z = 0,     J Y spans the range of J N                           (1)

`balance`
    the output's force w and the closures' forces lam:

        g + C^T lam = J^T w,     which needs Z^T g = 0                                 (2)

`lagrangian`
    the Hessian of the Lagrangian, symmetric for conservative forces:

        H_L = H + sum lam_k c_k'' - sum w_k J_k'                                       (3)

`minimise_self_motion`
    the energy is minimised over the self-motions, which needs Z^T H_L Z > 0:

        S = H_L - H_L Z (Z^T H_L Z)^-1 Z^T H_L,     K_U = Y^T S Y,     J Y = U         (4)

`explain`
    K = U K_U U^T where U has six directions, the state where it has not, and the motions
    of

        C = J_N H_N^-1 J_N^T,     H_N = N^T H_L N,     J_N = J N                       (5)

On the theory page these are `motions` (24), `closed` (26), `schur` (25) and
`compliance` (23). For six independent outputs and no self-motion (4) is K = J^-T H_L
J^-1. For the pose, K is K^B, in components of the body frame. (5) does not invert K: it
holds at singular postures and near them, where K has lost its digits.
`cartstiff.core.numerics.stiffness_scaled_basis` chooses the motions so that the stiffness
of stiff springs does not cancel that of soft ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import UndefinedError
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notebook import ShownInLines
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Evaluation, SecondOrderMap
from cartstiff.core.stiffness.free_motions import FreeMotions
from cartstiff.core.stiffness.leg_length_basis import leg_length_basis
from cartstiff.core.stiffness.motions import (
    Motions,
    Problem,
    decomposed,
    irregular,
    motions,
    rank_nearby,
)
from cartstiff.core.stiffness.rounding import (
    force_roundoff,
    symmetric_part,
    zero_roundoff,
)


@dataclass(frozen=True, eq=False, repr=False)
class Reduction(ShownInLines):
    """Result of (4) of `cartstiff.core.stiffness.reduction`, and the motions of (5).

    Attributes
    ----------
    force : ndarray (6,) or None
        Output force w; None if the posture is unbalanced.
    stiffness : ndarray (6, 6) or None
        K; None if it does not exist; `states` has the reason.
    multipliers : ndarray (m,)
        Closure forces lam.
    singular_values : ndarray
        Singular values of the length-scaled J N.
    rank : int
        Rank of J N.
    freedoms : int
        Number of free motions, the columns of N.
    usual_rank : int
        Rank of J N at the postures around this one: less than six for a body with fewer
        freedoms, however many free motions are inside the mechanism, such as spins of
        rods.
    free : FreeMotions or None
        The motions of (5), without those that cost no energy; None if the posture is
        unbalanced or the energy has no minimum over the self-motion.
    reachable, reachable_stiffness : ndarray (6, r), (r, r)
        U and K_U: the stiffness on the motions that exist.
    rates : ndarray (n, 6) or None
        Coordinate rates per output rate, N (J N)^-1, if unique.
    motions : ndarray (n, f) or None
        Motions that keep the closures, in scaled coordinates; None if all do.
    states : list of Note
        Named states found.
    closures : ndarray or None
        Singular values of the length-scaled closures, if there are any.
    """

    force: Array | None
    stiffness: Array | None
    multipliers: Array
    singular_values: Array
    rank: int
    freedoms: int
    usual_rank: int
    free: FreeMotions | None = None
    reachable: Array | None = None
    reachable_stiffness: Array | None = None
    rates: Array | None = None
    motions: Array | None = None
    states: list[Note] = field(default_factory=list)
    closures: Array | None = None

    @classmethod
    def of_state(
        cls,
        state: Note,
        values: Array,
        freedoms: int,
        *,
        rank: int = 0,
        usual_rank: int | None = None,
        motions: Array | None = None,
        count: int = 0,
    ) -> Reduction:
        """The reduction of a posture whose state leaves neither a force nor a stiffness.

        Without `usual_rank` up to six free motions are expected to move the output;
        `count` is the number of closures.
        """
        usual = min(6, freedoms) if usual_rank is None else usual_rank
        lam = np.zeros(count)
        return cls(
            None,
            None,
            lam,
            values,
            rank,
            freedoms,
            usual,
            motions=motions,
            states=[state],
        )

    def _lines(self) -> list[str]:
        if self.force is None:
            force = "none: unbalanced"
        else:
            force = ", ".join(f"{x:.6g}" for x in self.force.tolist())
        return [
            f"Reduction of {self.freedoms} free motions to rank {self.rank}",
            f"  force     {force}",
            f"  stiffness {'none' if self.stiffness is None else 'array (6, 6)'}",
            f"  states    {', '.join(state.code for state in self.states) or 'none'}",
        ]

    @cached_property
    def compliance_with_error(self) -> numerics.Inverse | None:
        """C of equation (5) with its relative error; None if a motion costs no energy."""
        return None if self.free is None else self.free.compliance()

    @property
    def compliance(self) -> Array | None:
        """C (6, 6) of equation (5); None if a motion costs no energy."""
        with_error = self.compliance_with_error
        return None if with_error is None else with_error.matrix

    def undefined(self) -> UndefinedError:
        """Error for a caller that needs the stiffness where it does not exist."""
        state = self.states[-1]
        return UndefinedError(state.message, code=state.code, values=state.values)


_COMPLIANCE_ALONE = "the stiffness matrix does not exist, the compliance does"
_NEITHER = (
    "the stiffness matrix does not exist, nor the compliance, as a motion costs nothing"
)
_UNBALANCED = (
    "no wrench at the end-effector balances this posture: a torque acts along the "
    "self-motion and the mechanism would move; choose rest positions that balance it, or "
    "let the self-motion settle"
)
_IGNORED = (
    "the wrench given is not the one that the springs exert on the reachable motions; "
    "the wrench of least norm is used"
)
_BUCKLED = (
    "the self-motion is unstable: the energy has no minimum over it, the mechanism would "
    "snap away from this posture"
)
_COUPLED = " but couple to the others: no minimum exists"
_IDLE = ": they do not move the end-effector and are left out"


def reduce_to(
    output: SecondOrderMap,
    energy: Evaluation,
    closure: SecondOrderMap | None,
    length: float,
    coordinate_lengths: Array,
    force: Array | None = None,
    by_lengths: Callable[[], FreeMotions | None] | None = None,
    rank_nearby: Callable[[Array], int | None] | None = None,
) -> Reduction:
    """Reduce an energy in coordinates to an output; equations (1) to (5) of this module.

    Parameters
    ----------
    output : SecondOrderMap
        Jacobian (6, n) of the output with its curvature. Rows 0..2 are angles and 3..5
        lengths.
    energy : Evaluation
        Energy, gradient and Hessian in the n coordinates.
    closure : SecondOrderMap or None
        Closure residual's Jacobian (m, n) with curvature.
    length : float
        Characteristic length of the mechanism, in its unit.
    coordinate_lengths : ndarray, shape (n,)
        1 for an angle, `length` for a distance: the natural size of each coordinate.
    force : ndarray (6,), optional
        The physical wrench, if the structure carries a part that does no work on the
        coordinates.
    by_lengths : callable, optional
        See `FreeMotions`.
    rank_nearby : callable, optional
        Rank of J N at a posture to which the free motions (n, f), in scaled coordinates,
        lead; None if none was found. Without it all of up to six free motions are
        expected to move the output.
    """
    rows, columns = np.array([1.0] * 3 + [1.0 / length] * 3), coordinate_lengths
    with numerics.one_thread(len(columns)):
        H = energy.hessian * columns[:, None] * columns
        # What is left of springs that cancel along a coordinate is no stiffness.
        H = zero_roundoff(H, np.ones(len(H))) if len(H) else H
        problem = Problem(
            output,
            closure,
            rows,
            columns,
            output.jacobian * rows[:, None] * columns,
            energy.gradient * columns,
            H,
            np.abs(H).max(axis=0, initial=0.0),
            energy.energy == energy.energy,
            by_lengths,
            rank_nearby,
        )
        return _reduced(problem, force)


def reduced_at(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    energy: Evaluation,
    closure: SecondOrderMap | None,
    force: Array | None,
) -> Reduction:
    """The reduction of an energy at a posture to the end-effector, under constraints."""
    return reduce_to(
        posture.motion,
        energy,
        closure,
        posture.length,
        posture.coordinate_lengths,
        force,
        partial(leg_length_basis, elastic, posture),
        partial(rank_nearby, elastic.mechanism, posture),
    )


def _reduced(problem: Problem, force: Array | None) -> Reduction:
    """The five steps; a state without stiffness ends them early."""
    closures = None
    if problem.closure is not None:
        closures = decomposed(problem.closure, problem.columns)
        state = irregular(problem.closure, closures, problem.columns)
        if state is not None:
            return Reduction.of_state(
                state,
                closures.values,
                closures.N.shape[1],
                motions=closures.N,
                count=len(closures.U),
            )
    free = motions(problem, closures)
    held = balance(problem, free, force)
    if isinstance(held, Note):
        return Reduction.of_state(
            held,
            free.values,
            free.freedoms,
            rank=free.rank,
            usual_rank=free.usual_rank,
            motions=None if closures is None else free.orthonormal,
            count=len(problem.closure_sizes),
        )
    tangent = lagrangian(problem, held)
    minimum = minimise_self_motion(problem, free, tangent)
    return explain(problem, free, held, tangent, minimum)


class Balance(NamedTuple):
    """Result of equation (2), in natural units.

    Attributes
    ----------
    w : ndarray (6,)
        Force of the output.
    lam : ndarray (m,)
        Forces of the closures, in the mechanism's own units.
    is_given : bool
        Whether w was given, and not the force of least norm.
    roundoff : float
        Sum of what round-off may contribute to w and lam.
    note : Note or None
        On a given force that does not balance the posture.
    """

    w: Array
    lam: Array
    is_given: bool
    roundoff: float
    note: Note | None = None


def balance(
    problem: Problem, free: Motions, force: Array | None = None
) -> Balance | Note:
    """Solve (2), ``g + C^T lam = J^T w``: the second step.

    Without a given `force` w has the least norm. No w balances a torque along a
    self-motion, ``Z^T g = 0``: a note with that state is returned.
    """
    J, g, stiff, N, Z, U = problem.J, problem.g, problem.stiff, free.N, free.Z, free.U
    if Z.size and _is_unbalanced(Z, g, stiff):
        torque = free.along @ (free.along.T @ g) / problem.columns
        numbers = {"unbalanced_torque": torque.tolist()}
        return Note(
            "unbalanced", _UNBALANCED, {**numbers, "largest": float(np.abs(torque).max())}
        )

    w, note = U @ (free.to_output.T @ (free.Y.T @ g)), None
    if force is not None:
        given = force / problem.rows
        missed = N.T @ (J.T @ given - g)
        size = np.abs(N.T) @ (np.abs(J.T) @ np.abs(given) + np.abs(g))
        # Rates that should be zero have the round-off of the others.
        rounded = numerics.ROUNDOFF_OF_SUMS * (
            np.abs(J).max() * np.abs(given).sum() + np.abs(g).max()
        )
        roundoff = np.abs(N.T) @ (rounded + numerics.ROUNDOFF * stiff)
        if (np.abs(missed) <= numerics.NEGLIGIBLE_FORCE * size + roundoff).all():
            w = given
        else:
            note = Note("wrench-ignored", _IGNORED, {"difference": missed.tolist()})
    sizes = problem.closure_sizes
    lam = np.zeros(len(sizes))
    if free.closures is not None:
        lam = free.closures.forces(J.T @ w - g, free.follow) / sizes

    least = numerics.EPSILON * (np.abs(w).sum() + np.abs(lam * sizes).sum())
    if force is None and g.any():
        uncertain = force_roundoff(g, stiff)
        outward = np.abs(U) @ (np.abs(free.to_output.T) @ (np.abs(free.Y.T) @ uncertain))
        least += outward.sum() + lam.size * uncertain[free.follow].max(initial=0.0)
    return Balance(w, lam, force is not None, float(least), note)


class Lagrangian(NamedTuple):
    """Result of equation (3): the Hessian H_L (n, n), and the sizes of the terms
    in its sums.
    """

    hessian: Array
    terms: Array


def lagrangian(problem: Problem, held: Balance) -> Lagrangian:
    """Add up (3), ``H_L = H + sum lam_k c_k'' - sum w_k J_k'``: the third step."""
    parts = [problem.H, -problem.curvature(problem.output, held.w * problem.rows)]
    if problem.closure is not None:
        parts.append(problem.curvature(problem.closure, held.lam))
    # Round-off of w and lam counts as much as would make a motion one without energy.
    rounding = held.roundoff / numerics.FREE_MOTION_STIFFNESS
    sizes = sum(map(np.abs, parts[1:]), np.abs(problem.H))
    return Lagrangian(sum(parts[1:], problem.H), sizes + rounding)


class Minimum(NamedTuple):
    """Result of equation (4), in natural units.

    Attributes
    ----------
    Z : ndarray (n, k)
        Self-motions that cost energy.
    stiffness : ndarray (r, r)
        K_U: stiffness on the directions U along which the output can move.
    note : Note or None
        On self-motions that cost no energy.
    """

    Z: Array
    stiffness: Array
    note: Note | None


def minimise_self_motion(
    problem: Problem, free: Motions, tangent: Lagrangian
) -> Minimum | Note:
    """Minimise the energy over the self-motions, (4): the fourth step.

    A note is returned where no minimum exists.
    """
    H, Y, to_output = tangent.hessian, free.Y, free.to_output
    held = _held_self_motions(problem, free, tangent)
    if isinstance(held, Note):
        return held
    Z, inverse, note = held
    S, size = Y.T @ H @ Y, np.abs(Y)
    # Remove the round-off of motions that cost no energy.
    least = numerics.FREE_MOTION_STIFFNESS * (size.T @ tangent.terms @ size)
    idle = (np.abs(S) <= least).all(axis=1)
    S[idle], S[:, idle] = 0.0, 0.0
    if Z.shape[1]:
        S = S - (Y.T @ H @ Z) @ inverse @ (Z.T @ H @ Y)
    return Minimum(
        Z, symmetric_part(to_output.T @ S @ to_output, problem.has_energy), note
    )


def explain(
    problem: Problem,
    free: Motions,
    held: Balance,
    tangent: Lagrangian,
    minimum: Minimum | Note,
) -> Reduction:
    """Say in the mechanism's units what exists, and why the rest does not:
    the last step.
    """
    rows, every = problem.rows, free.rank == len(problem.rows)
    K = K_U = rates = compliant = None
    note: Note | None
    if isinstance(minimum, Note):
        note = minimum
    else:
        note, K_U = minimum.note, minimum.stiffness
        compliant = _compliant_motions(problem, free, tangent, minimum.Z)
        if every:
            K = zero_roundoff(K_U * rows[:, None] * rows, rows)
            # Self-motions without energy, such as spins of legs, stay where they are.
            if not minimum.Z.shape[1]:
                rates = problem.columns[:, None] * (free.Y @ free.to_output) * rows
    lost = (
        None if every else _lost_directions(problem, free, held.is_given, K_U, compliant)
    )
    return Reduction(
        held.w * rows,
        K,
        held.lam,
        free.values,
        free.rank,
        free.freedoms,
        free.usual_rank,
        compliant,
        None if K_U is None else free.U / rows[:, None],
        K_U,
        rates,
        None if free.closures is None else free.orthonormal,
        [state for state in (held.note, lost, note) if state is not None],
        None if free.closures is None else free.closures.values,
    )


def _compliant_motions(
    problem: Problem,
    free: Motions,
    tangent: Lagrangian,
    Z: Array,
) -> FreeMotions:
    """The motions of (5): those that move the output, and the self-motions Z that
    cost energy.
    """
    B = np.concatenate([free.Y, Z], axis=1)
    # Self-motions keep their small output rates, as a lost rank need not be exactly zero.
    # Rates that are round-off of the basis become 0: a rotation that the closures forbid.
    J_B = problem.J @ B
    if free.closures is not None:
        size = np.outer(np.abs(problem.J).sum(axis=1), np.abs(B).max(axis=0, initial=0.0))
        J_B[np.abs(J_B) <= len(problem.g) * numerics.EPSILON * size] = 0.0
    for half in free.still:
        J_B[half] = 0.0
    return FreeMotions(
        J_B / problem.rows[:, None],
        symmetric_part(B.T @ tangent.hessian @ B, problem.has_energy),
        np.abs(B.T) @ tangent.terms @ np.abs(B),
        problem.columns[:, None] * B,
        problem.has_energy,
        problem.by_lengths,
    )


def _lost_directions(
    problem: Problem,
    free: Motions,
    is_given: bool,
    K_U: Array | None,
    compliant: FreeMotions | None,
) -> Note:
    """State of an output that cannot move in all directions,
    with what can be said about it.
    """
    rows, rank, freedoms = problem.rows, free.rank, free.freedoms
    is_regular = freedoms < len(rows) or rank == free.usual_rank
    inside = " (serial singularity)"
    if is_regular:
        inside, idle = "", freedoms - rank
        if idle > 0:
            inside = f", and {idle} of the {freedoms} free motion(s) do not move it"
    exists = _COMPLIANCE_ALONE
    if compliant is not None and compliant.inverse() is None:
        exists = _NEITHER
    numbers: dict[str, object] = {
        "rank": rank,
        "singular_values": free.values.tolist(),
        "characteristic_length": float(1 / rows[-1]),
        "structural_wrenches": (free.lost * rows[:, None]).T.tolist(),
    }
    if K_U is not None:
        numbers["reachable_motions"] = (free.U / rows[:, None]).T.tolist()
        numbers["reachable_stiffness"] = K_U.tolist()
    return Note(
        "fewer-than-six-freedoms" if is_regular else "serial-singularity",
        f"the end-effector cannot move in {len(rows) - rank} of {len(rows)} directions "
        f"here{inside}: {exists}; the wrench along them is carried by the "
        f"structure{'' if is_given else ' and is taken as zero in the scaled norm'}",
        numbers,
    )


def _is_unbalanced(Z: Array, g: Array, stiff: Array) -> bool:
    """Whether the work of the forces g (n,) along self-motions Z (n, k)
    exceeds round-off.
    """
    size, forces = np.abs(Z), np.abs(g)
    most = size.T @ (numerics.BALANCE_TOLERANCE * forces + numerics.ROUNDOFF * stiff)
    # Entries of Z below `RANK` may be missing, and with them the forces there.
    most += size.max(axis=0) * (numerics.RANK * forces.sum())
    return bool((np.abs(Z.T @ g) > most).any())


def _held_self_motions(
    problem: Problem, free: Motions, tangent: Lagrangian
) -> tuple[Array, Array, Note | None] | Note:
    """Self-motions (n, k) that cost energy, ``(Z^T H_L Z)^-1``,
    and a note on those that do not.

    Each self-motion is judged in a unit of its own, in which the terms along it are 1.
    Without a minimum a note is returned.
    """
    H, Y, Z = tangent.hessian, free.Y, free.Z
    if Z.shape[1] == 0:
        return Z, np.zeros((0, 0)), None
    every = np.concatenate([Y, Z], axis=1)
    size = np.abs(every)
    size = np.sqrt(((tangent.terms @ size) * size).sum(axis=0))
    every = every / np.where(size > 0.0, size, 1.0)
    unit, note = every[:, Y.shape[1] :], None
    values, modes = _eigen(unit.T @ H @ unit)
    idle = np.abs(values) <= numerics.FREE_MOTION_STIFFNESS
    if np.any(values[~idle] < 0.0):
        stiffness, modes = _eigen(free.along.T @ H @ free.along)
        softest = (problem.columns * (free.along @ modes[:, 0])).tolist()
        numbers = {"self_motion_stiffness": stiffness.tolist(), "direction": softest}
        return Note("buckled", _BUCKLED, numbers)
    if idle.any():
        still = unit @ modes[:, idle]
        # An entry of a semidefinite matrix is at most the root of its two diagonal ones.
        most = np.sqrt(numerics.FREE_MOTION_STIFFNESS)
        is_coupled = bool(np.abs(every.T @ H @ still).max() > most)
        still = still / np.linalg.norm(still, axis=0)
        coupling = np.abs(np.concatenate([Y, Z], axis=1).T @ H @ still).max()
        words = _COUPLED if is_coupled else _IDLE
        note = Note(
            "idle-self-motion",
            f"{int(idle.sum())} self-motion(s) cost no energy{words}",
            {
                "directions": (problem.columns[:, None] * still).T.tolist(),
                "coupling": float(coupling),
            },
        )
        if is_coupled:
            return note
        unit = unit @ modes[:, ~idle]
    return unit, np.linalg.inv(unit.T @ H @ unit), note


def _eigen(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues, the smallest first, and eigenvectors of the symmetric part
    of a matrix.
    """
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return values, vectors
