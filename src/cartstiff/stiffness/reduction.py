r"""One reduction for every mechanism: from energy in coordinates to stiffness of an output.

Given the gradient g and Hessian H of the energy in n coordinates, closures with Jacobian C, and an
output (the end-effector's pose, or the actuated coordinates) with Jacobian J, stationarity reads

    g + C^T lam = J^T w                                                                       (1)

and the Lagrangian Hessian H_L = H + sum lam_k c_k'' - sum w_k J_k' (symmetric for conservative
forces). On motions that keep the closures, N = null C, with H_N = N^T H_L N, J_N = J N and
self-motions Z = null J_N, the energy is minimised over the self-motion:

    S = H_N - H_N Z (Z^T H_N Z)^-1 Z^T H_N,     K = Y^T S Y,     J_N Y = U = range J_N          (2)
    C = J_N H_N^-1 J_N^T                                                                      (3)

For six independent outputs and no self-motion (2) is K = J^-T H_L J^-1. For the pose, K is K^B, in
components of the body frame. All decisions about rank are taken on length-scaled matrices: a
length is measured in the characteristic length l, so that every singular value is a pure number.

(3) does not invert K: it holds at singular postures and near them, where K has lost its digits.
`cartstiff.numerics.stiffness_scaled_basis` chooses the motions so that the stiffness of stiff
springs does not cancel that of soft ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cartstiff import numerics
from cartstiff.errors import ConvergenceError, UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note
from cartstiff.potentials.contract import Evaluation, SecondOrderMap
from cartstiff.stiffness.closures import Closures, decomposed, irregular
from cartstiff.stiffness.free_motions import FreeMotions
from cartstiff.stiffness.rounding import force_roundoff, symmetric_part, zero_roundoff


@dataclass(frozen=True, repr=False)
class Reduction(ShownInLines):
    """Result of equation (2) of `cartstiff.stiffness.reduction`, and the motions of (3).

    Attributes
    ----------
    force : ndarray (6,) or None
        Output force w; None if the posture is unbalanced.
    stiffness : ndarray (6, 6) or None
        K; None if it does not exist; `states` has the reason.
    multipliers : ndarray (m,)
        Closure forces lam.
    singular_values : ndarray
        Singular values of the length-scaled J_N.
    rank : int
        Rank of J_N.
    freedoms : int
        Number of free motions, the columns of N.
    usual_rank : int
        Rank of J_N at the postures around this one: less than six for a body with fewer freedoms,
        however many free motions are inside the mechanism, such as spins of rods.
    free : FreeMotions or None
        The motions of (3), without those that cost no energy; None if the posture is unbalanced or
        the energy has no minimum over the self-motion.
    reachable, reachable_stiffness : ndarray (6, r), (r, r)
        U and Y^T S Y: the stiffness on the motions that exist.
    rates : ndarray (n, 6) or None
        Coordinate rates per output rate, N J_N^-1, if unique.
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

    def _lines(self) -> list[str]:
        force = (
            "none: unbalanced"
            if self.force is None
            else ", ".join(f"{x:.6g}" for x in self.force.tolist())
        )
        return [
            f"Reduction of {self.freedoms} free motions to rank {self.rank}",
            f"  force     {force}",
            f"  stiffness {'none' if self.stiffness is None else 'array (6, 6)'}",
            f"  states    {', '.join(state.code for state in self.states) or 'none'}",
        ]

    @cached_property
    def compliance_with_error(self) -> numerics.Inverse | None:
        """C of equation (3) with its relative error; None if a motion costs no energy."""
        return None if self.free is None else self.free.compliance()

    @property
    def compliance(self) -> Array | None:
        """C (6, 6) of equation (3); None if a motion costs no energy."""
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


def _inverse(matrix: Array, sizes: Array | None) -> Array:
    """Inverse of a regular matrix, with zeros for entries that may be round-off.

    `sizes` (n,) are the sizes of the terms in the sums of each column of the matrix; None if it is
    no sum.
    """
    try:
        inverse: Array = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:  # chains that are singular in two ways at once
        raise UndefinedError(
            "the motions of the body and those inside the mechanism cannot be told apart here: the "
            "posture is singular in more than one way",
            code="ill-conditioned",
            values={"motions": matrix.tolist()},
        ) from None
    if sizes is None:
        return inverse
    size = np.abs(inverse)
    rounding = len(matrix) * numerics.EPSILON * np.outer(size.sum(axis=1), sizes @ size)
    inverse[size <= rounding] = 0.0
    return inverse


def _without(some: Array, count: int) -> list[int]:
    """Whole numbers below `count` that are not in `some`."""
    known = set(some.tolist())
    return [i for i in range(count) if i not in known]


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
    """Reduce an energy in coordinates to an output; equations (1) to (3) of this module.

    Parameters
    ----------
    output : SecondOrderMap
        Jacobian (6, n) of the output with its curvature. Rows 0..2 are angles and 3..5 lengths.
    energy : Evaluation
        Energy, gradient and Hessian in the n coordinates.
    closure : SecondOrderMap or None
        Closure residual's Jacobian (m, n) with curvature.
    length : float
        Characteristic length of the mechanism, in its unit.
    coordinate_lengths : ndarray, shape (n,)
        1 for an angle, `length` for a distance: the natural size of each coordinate.
    force : ndarray (6,), optional
        The physical wrench, if the structure carries a part that does no work on the coordinates.
    by_lengths : callable, optional
        See `FreeMotions`.
    rank_nearby : callable, optional
        Rank of J_N at a posture to which the free motions (n, f), in scaled coordinates, lead; None
        if none was found. Without it all of up to six free motions are expected to move the output.
    """
    rows, sizes = np.repeat([1.0, 1.0 / length], 3), coordinate_lengths
    with numerics.one_thread(len(energy.gradient)):
        return _reduced(
            output, energy, closure, rows, sizes, force, by_lengths, rank_nearby
        )


def _reduced(
    output: SecondOrderMap,
    energy: Evaluation,
    closure: SecondOrderMap | None,
    rows: Array,
    columns: Array,
    force: Array | None,
    by_lengths: Callable[[], FreeMotions | None] | None,
    rank_nearby: Callable[[Array], int | None] | None,
) -> Reduction:
    """`reduce_to` in scaled units throughout."""
    states, short = list[Note](), None
    J = output.jacobian * rows[:, None] * columns
    g = energy.gradient * columns
    H, n = energy.hessian * columns[:, None] * columns, len(g)
    if n:  # what is left of springs that cancel along a coordinate is no stiffness
        H = zero_roundoff(H, np.ones(n))
    stiff = np.abs(H).max(axis=0, initial=0.0)

    # N: all motions (n, f), parametrised by the coordinates `leading`; orthonormal for singular
    # values.
    closures, orthonormal = None, np.eye(n)
    N, leading, lam, closed = orthonormal, np.arange(n), np.zeros(0), np.zeros(0)
    if closure is not None:
        closed = (
            np.ones(len(closure.jacobian)) if closure.sizes is None else closure.sizes
        )
        closures = decomposed(closure, columns)
        orthonormal, lam = closures.N, np.zeros(len(closure.jacobian))
        if closures.rank < len(lam):
            lost = closures.lost / closed[:, None]
            state = irregular(
                closure, closures.values, closures.rank, lost, orthonormal, columns
            )
            if state is not None:
                return Reduction(
                    None,
                    None,
                    lam,
                    closures.values,
                    0,
                    orthonormal.shape[1],
                    min(len(rows), orthonormal.shape[1]),
                    motions=orthonormal,
                    states=[state],
                )
        N, leading = numerics.stiffness_scaled_basis(orthonormal, stiff, closures.V)
    motions = None if closure is None else orthonormal
    freedoms = N.shape[1]
    J_N = J if closure is None else J @ orthonormal
    values = numerics.singular_values(J_N)
    rank = numerics.rank(values, numerics.EPSILON * np.abs(J).sum())
    U, still, usual_rank = np.eye(len(rows)), list[slice](), min(len(rows), freedoms)
    Y, Z, along = N, N[:, rank:], orthonormal[:, rank:]
    if rank < max(J_N.shape):
        left, _, Vt = np.linalg.svd(J_N)
        along = orthonormal @ Vt[rank:].T
        if rank < len(rows):  # otherwise round-off of the basis replaces zeros of K
            U, lost, still = left[:, :rank], left[:, rank:], numerics.still_halves(J_N)
            maps = lost * rows[:, None], output, closure, closures
            if (
                rank < usual_rank
                and rank_nearby
                and not _rises(*maps, orthonormal, along, columns)
            ):
                usual_rank = rank_nearby(orthonormal) or usual_rank
            for half in still:
                U[half] = 0.0
        # Self-motions Z are parametrised by the stiffest coordinates; the remaining leading ones,
        # as many as the rank, make the output.
        across = (U.T @ J @ N).T
        Z, chosen = numerics.stiffness_scaled_basis(
            along[leading], stiff[leading], across
        )
        Z, Y = N @ Z, N[:, _without(chosen, freedoms)]
    # Motions of Y per reachable output.
    J_Y = J @ Y if rank == len(rows) else U.T @ J @ Y
    rounded = (
        None if closure is None else (np.abs(J) @ np.abs(Y)).max(axis=0, initial=0.0)
    )
    to_output = _inverse(J_Y, rounded)

    # Balance: the torque along a self-motion must vanish, whatever wrench acts on the output.
    if Z.size and _is_unbalanced(Z, g, stiff):
        torque = along @ (along.T @ g) / columns
        states.append(
            Note(
                "unbalanced",
                "no wrench at the end-effector balances this posture: a torque acts along the "
                "self-motion and the mechanism would move; choose rest positions that balance it, "
                "or let the self-motion settle",
                {
                    "unbalanced_torque": torque.tolist(),
                    "largest": float(np.abs(torque).max()),
                },
            )
        )
        return Reduction(
            None,
            None,
            lam,
            values,
            rank,
            freedoms,
            usual_rank,
            motions=motions,
            states=states,
        )

    w = U @ (to_output.T @ (Y.T @ g))
    if force is not None:
        asked = force / rows
        missed = N.T @ (J.T @ asked - g)
        size = np.abs(N.T) @ (np.abs(J.T) @ np.abs(asked) + np.abs(g))
        # Rates that should be zero have the round-off of the others.
        rounded = numerics.ROUNDOFF_OF_SUMS * (
            np.abs(J).max() * np.abs(asked).sum() + np.abs(g).max()
        )
        roundoff = np.abs(N.T) @ (rounded + numerics.ROUNDOFF * stiff)
        if np.all(np.abs(missed) <= numerics.NEGLIGIBLE_FORCE * size + roundoff):
            w = asked
        else:
            states.append(
                Note(
                    "wrench-ignored",
                    "the wrench given is not the one that the springs exert on the reachable "
                    "motions; the wrench of least norm is used",
                    {"difference": missed.tolist()},
                )
            )
    parts, follow = (
        [H, -output.curvature(w * rows) * columns[:, None] * columns],
        list[int](),
    )
    if closure is not None and closures is not None:
        follow = _without(leading, n)
        lam = closures.forces(J.T @ w - g, follow) / closed
        parts.append(closure.curvature(lam) * columns[:, None] * columns)
    H_L = sum(parts[1:], H)

    least = numerics.EPSILON * (np.abs(w).sum() + np.abs(lam * closed).sum())
    if force is None and g.any():
        uncertain = force_roundoff(g, stiff)
        outward = np.abs(U) @ (np.abs(to_output.T) @ (np.abs(Y.T) @ uncertain))
        least += outward.sum() + lam.size * uncertain[follow].max(initial=0.0)
    terms = sum(map(np.abs, parts)) + least / numerics.FREE_MOTION_STIFFNESS

    if rank < len(rows):
        missing = lost * rows[:, None]
        is_regular = freedoms < len(rows) or rank == usual_rank
        kind = "fewer-than-six-freedoms" if is_regular else "serial-singularity"
        short, still_too = len(states), freedoms - rank
        inside = ""
        if still_too > 0:
            inside = f", and {still_too} of the {freedoms} free motion(s) do not move it"
        states.append(
            Note(
                kind,
                f"the end-effector cannot move in {len(rows) - rank} of {len(rows)} directions here"
                + (inside if is_regular else " (serial singularity)")
                + f": {_COMPLIANCE_ALONE}; the wrench along them is carried by the structure"
                + (" and is taken as zero in the scaled norm" if force is None else ""),
                {
                    "rank": rank,
                    "singular_values": values.tolist(),
                    "characteristic_length": float(1 / rows[-1]),
                    "structural_wrenches": missing.T.tolist(),
                },
            )
        )
    held = _held_self_motions(H_L, terms, Y, Z, along, columns, states)
    K = reachable = reachable_K = rates = free = None
    if held is not None:
        Z, inner = held
        S = Y.T @ H_L @ Y
        size = np.abs(Y)
        idle = (
            np.abs(S) <= numerics.FREE_MOTION_STIFFNESS * (size.T @ terms @ size)
        ).all(axis=1)
        S[idle], S[:, idle] = (
            0.0,
            0.0,
        )  # remove the round-off of motions that cost no energy
        if Z.shape[1]:
            S = S - (Y.T @ H_L @ Z) @ inner @ (Z.T @ H_L @ Y)
        reachable_K = symmetric_part(
            to_output.T @ S @ to_output, energy
        )  # in the basis U
        reachable = U / rows[:, None]
        if rank == len(rows):
            K = zero_roundoff(reachable_K * rows[:, None] * rows, rows)
            if (
                Z.shape[1] == 0
            ):  # self-motions without energy, such as spins of legs, are fixed
                rates = columns[:, None] * (Y @ to_output) * rows
        B = np.concatenate([Y, Z], axis=1)
        # Self-motions keep their small output rates, as a lost rank need not be exactly zero. Rates
        # that are round-off of the basis become 0: a rotation that the closures forbid.
        J_B = J @ B
        if closure is not None:
            size = np.outer(np.abs(J).sum(axis=1), np.abs(B).max(axis=0, initial=0.0))
            J_B[np.abs(J_B) <= n * numerics.EPSILON * size] = 0.0
        for half in still:
            J_B[half] = 0.0
        free = FreeMotions(
            J_B / rows[:, None],
            symmetric_part(B.T @ H_L @ B, energy),
            np.abs(B.T) @ terms @ np.abs(B),
            columns[:, None] * B,
            energy.energy == energy.energy,
            by_lengths,
        )
    if short is not None and reachable is not None:
        words = states[short].message
        if free is not None and free.inverse() is None:
            words = words.replace(_COMPLIANCE_ALONE, _NEITHER)
        K_there = None if reachable_K is None else reachable_K.tolist()
        more = {"reachable_motions": reachable.T.tolist(), "reachable_stiffness": K_there}
        states[short] = Note(states[short].code, words, {**states[short].values, **more})
    return Reduction(
        w * rows,
        K,
        lam,
        values,
        rank,
        freedoms,
        usual_rank,
        free,
        reachable,
        reachable_K,
        rates,
        motions,
        states,
        None if closures is None else closures.values,
    )


def _rises(
    lost: Array,
    output: SecondOrderMap,
    closure: SecondOrderMap | None,
    closures: Closures | None,
    N: Array,
    along: Array,
    columns: Array,
) -> bool:
    """Whether the rank of J_N is larger at postures around this one, to first order.

    With u a direction that is lost, ``u^T J = nu^T C``, the motion x turns the self-motion z into
    one that moves the output along u at the rate ``x^T (u . J' - nu . c'') z``. The posture is
    singular if a rate exists. If none does, self-motions remain so to first order: spins of rods,
    joints beside those that move a body with fewer than six freedoms, and where two singularities
    meet.

    Parameters
    ----------
    lost : ndarray (6, k)
        Directions u that the output cannot move along.
    output, closure, closures, columns
        As in `_reduced`.
    N, along : ndarray (n, f), (n, f - r)
        Orthonormal free motions, and self-motions.
    """
    least = numerics.VANISHING_FORM * max(
        1.0, float(np.abs(output.jacobian * columns).max())
    )
    for u in lost.T:
        form = output.curvature(u)
        if closure is not None and closures is not None and closures.values.size:
            nu = closures.forces(
                columns * (output.jacobian.T @ u), list(range(len(columns)))
            )
            form = form - closure.curvature(
                nu if closure.sizes is None else nu / closure.sizes
            )
        rates = N.T @ (form * columns[:, None] * columns) @ along
        if float(np.abs(rates).max(initial=0.0)) > least:
            return True
    return False


def _is_unbalanced(Z: Array, g: Array, stiff: Array) -> bool:
    """Whether the work of the forces g (n,) along self-motions Z (n, k) exceeds round-off."""
    size, forces = np.abs(Z), np.abs(g)
    most = size.T @ (numerics.BALANCE_TOLERANCE * forces + numerics.ROUNDOFF * stiff)
    # Entries of Z below `RANK` may be missing, and with them the forces there.
    most += size.max(axis=0) * (numerics.RANK * forces.sum())
    return bool((np.abs(Z.T @ g) > most).any())


def _held_self_motions(
    H: Array,
    terms: Array,
    Y: Array,
    Z: Array,
    along: Array,
    columns: Array,
    states: list[Note],
) -> tuple[Array, Array] | None:
    """Self-motions (n, k) with a stiffness, and its inverse (k, k); None without a minimum.

    Each self-motion is judged in a unit of its own, in which the terms along it are 1.
    """
    if Z.shape[1] == 0:
        return Z, np.zeros((0, 0))
    every = np.concatenate([Y, Z], axis=1)
    size = np.abs(every)
    size = np.sqrt(((terms @ size) * size).sum(axis=0))
    every = every / np.where(size > 0.0, size, 1.0)
    unit = every[:, Y.shape[1] :]
    block = unit.T @ H @ unit
    eigenvalues, modes = np.linalg.eigh(0.5 * (block + block.T))
    idle = np.abs(eigenvalues) <= numerics.FREE_MOTION_STIFFNESS
    if np.any(eigenvalues[~idle] < 0.0):
        block = along.T @ H @ along
        stiffness, modes = np.linalg.eigh(0.5 * (block + block.T))
        states.append(
            Note(
                "buckled",
                "the self-motion is unstable: the energy has no minimum over it, the mechanism "
                "would snap away from this posture",
                {
                    "self_motion_stiffness": stiffness.tolist(),
                    "direction": (
                        columns * (along @ modes[:, 0])
                    ).tolist(),  # the softest
                },
            )
        )
        return None
    if idle.any():
        Z0 = unit @ modes[:, idle]
        # An entry of a semidefinite matrix is at most the root of its two diagonal ones.
        coupled = bool(
            np.abs(every.T @ H @ Z0).max() > np.sqrt(numerics.FREE_MOTION_STIFFNESS)
        )
        Z0 = Z0 / np.linalg.norm(Z0, axis=0)
        states.append(
            Note(
                "idle-self-motion",
                f"{int(idle.sum())} self-motion(s) cost no energy"
                + (
                    " but couple to the others: no minimum exists"
                    if coupled
                    else ": they do not move the end-effector and are left out"
                ),
                {
                    "directions": (columns[:, None] * Z0).T.tolist(),
                    "coupling": float(
                        np.abs(np.concatenate([Y, Z], axis=1).T @ H @ Z0).max()
                    ),
                },
            )
        )
        if coupled:
            return None
        unit = unit @ modes[:, ~idle]
    return unit, np.linalg.inv(unit.T @ H @ unit)


def values_of_closed(posture: MechanismPosture) -> tuple[Array, int, Array]:
    """`Reduction.singular_values`, `freedoms` and `motions` for regular closures."""
    assert posture.closure is not None
    N = decomposed(posture.closure, posture.coordinate_lengths).N
    J = _scaled(posture, posture.motion.jacobian, posture.length)
    return numerics.singular_values(J @ N), N.shape[1], N


def _scaled(posture: MechanismPosture, J: Array, length: float) -> Array:
    """A Jacobian (6, n) of a posture, length-scaled."""
    rows = np.repeat([1.0, 1.0 / length], 3)
    return np.asarray(J * rows[:, None] * posture.coordinate_lengths)


def scaled_values(
    posture: MechanismPosture, jacobian: Array | None = None, length: float | None = None
) -> Array:
    """Singular values of the length-scaled Jacobian of a posture; both may be known already."""
    J = posture.motion.jacobian if jacobian is None else jacobian
    length = posture.length if length is None else length
    return numerics.singular_values(_scaled(posture, J, length))


#: Lengths, rad or characteristic lengths, of the ways to a posture nearby: far enough that what is
#: lost at a point is regained, and a shorter one for chains that do not close so far away.
_AWAY = (0.1, 0.02)


def rank_nearby(
    mechanism: Mechanism, posture: MechanismPosture, motions: Array
) -> int | None:
    """Rank of the body's motions at a posture beside this one; None if the chain does not close.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism.
    posture : MechanismPosture
        Where the way starts.
    motions : ndarray (n, f)
        Free motions, in scaled coordinates: the way is a sum of all, none of them special.
    """
    way = motions @ np.cos(np.arange(motions.shape[1]) ** 2 + 1.0)
    way = (
        posture.coordinate_lengths * way / max(float(np.linalg.norm(way)), numerics.TINY)
    )
    for size in _AWAY:
        try:
            there = mechanism.closed(posture.q + size * way, hold=())
        except ConvergenceError:
            continue
        closed = there.closure is not None
        return numerics.rank(
            values_of_closed(there)[0] if closed else scaled_values(there)
        )
    return None
