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

(3) never inverts K: it holds at singular postures and near them, where K has lost its digits.
Motions are combined by `cartstiff.numerics.graded_basis`: stiff and soft springs stay apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from math import sqrt

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.potentials.contract import Evaluation, Map
from cartstiff.stiffness.closures import State, decompose, irregular
from cartstiff.stiffness.free_motions import FreeMotions
from cartstiff.stiffness.redundant import plainly_redundant

__all__ = ["Reduction", "State", "reduce_to", "scaled_values"]


@dataclass(frozen=True)
class Reduction:
    """What equation (2) gave, or why not, and what (3) is made of.

    Attributes
    ----------
    force : ndarray (6,) or None
        Output force w; None if the posture is unbalanced.
    stiffness : ndarray (6, 6) or None
        K; None if it does not exist, for which `states` has the reason.
    multipliers : ndarray (m,)
        Closure forces lam.
    singular_values : ndarray
        Singular values of the length-scaled J_N.
    rank : int
        Rank of J_N.
    freedoms : int
        Number of free motions, the columns of N.
    free : FreeMotions or None
        The motions that (3) is made of, idle ones left out; None where the posture is unbalanced or
        its self-motion has no minimum.
    reachable, reachable_stiffness : ndarray (6, r), (r, r)
        U and Y^T S Y: the stiffness on the motions that exist.
    rates : ndarray (n, 6) or None
        Coordinate rates per output rate, N J_N^-1, where that is one to one.
    motions : ndarray (n, f) or None
        Motions that keep the closures, in scaled coordinates; None if all do.
    states : list of State
        Named states found.
    """

    force: Array | None
    stiffness: Array | None
    multipliers: Array
    singular_values: Array
    rank: int
    freedoms: int
    free: FreeMotions | None = None
    reachable: Array | None = None
    reachable_stiffness: Array | None = None
    rates: Array | None = None
    motions: Array | None = None
    states: list[State] = field(default_factory=list)

    @cached_property
    def compliance_with_error(self) -> numerics.Inverse | None:
        """C of equation (3) with its relative error; None where a motion costs nothing."""
        return None if self.free is None else self.free.compliance()

    @property
    def compliance(self) -> Array | None:
        """C (6, 6) of equation (3); None where a motion costs nothing."""
        found = self.compliance_with_error
        return None if found is None else found.matrix


def reduce_to(
    output: Map,
    energy: Evaluation,
    closure: Map | None,
    length: float,
    coordinate_lengths: Array,
    force: Array | None = None,
    what: str = "end-effector",
    apart: Callable[[], FreeMotions | None] | None = None,
) -> Reduction:
    """Reduce an energy in coordinates to an output; equations (1) to (3) of this module.

    Parameters
    ----------
    output : Map
        Jacobian (6, n) of the output with its curvature. Rows 0..2 are angles and 3..5 lengths.
    energy : Evaluation
        Energy, gradient and Hessian in the n coordinates.
    closure : Map or None
        Closure residual's Jacobian (m, n) with curvature.
    length : float
        Characteristic length of the mechanism, in its unit.
    coordinate_lengths : ndarray, shape (n,)
        1 for an angle, `length` for a distance: the natural size of each coordinate.
    force : ndarray (6,), optional
        The physical wrench, where the structure carries a part that the coordinates do not feel.
    what : str
        Name of the output in messages.
    apart : callable, optional
        See `FreeMotions`.
    """
    per_length = 1 / length
    rows = np.array([1.0, 1.0, 1.0, per_length, per_length, per_length])
    J = output.jacobian
    m, n = J.shape
    if closure is None and n == m:
        result = _square(output, energy, rows, coordinate_lengths, force, apart)
        if result is not None:
            return result
    if closure is None and n > m:
        found = plainly_redundant(output, energy, rows, coordinate_lengths, force)
        if found is not None:
            force, K, values, free = found
            K = _without_noise(K, rows)
            inner = K / rows / rows[:, None]
            return Reduction(force, K, np.zeros(0), values, m, n, free, np.diag(1 / rows), inner)
    return _general(output, energy, closure, rows, coordinate_lengths, force, what)


def scaled_values(posture: MechanismPosture) -> Array:
    """Singular values of the length-scaled Jacobian of a posture."""
    rows = np.repeat([1.0, 1 / posture.length], 3)
    return numerics.singular_values(
        posture.motion.jacobian * rows[:, None] * posture.coordinate_lengths
    )


#: How many units of rounding the direction of a spring may be off.
_GEOMETRY = 16.0
_NOISE = (_GEOMETRY * numerics.EPSILON) ** 2
_COMPLIANCE_ALONE = "the stiffness matrix does not exist, the compliance does"
_NEITHER = "the stiffness matrix does not exist, nor the compliance, as a motion costs nothing"


def _inverse(matrix: Array, sizes: Array) -> Array:
    """Inverse of a regular matrix, with zeros for entries that may be rounding alone.

    `sizes` (n,) are those of the numbers whose sums and products each column of the matrix is.
    """
    inverse: Array = np.linalg.inv(matrix)
    size = np.abs(inverse)
    rounding = len(matrix) * numerics.EPSILON * np.outer(size.sum(axis=1), sizes @ size)
    inverse[size <= rounding] = 0.0
    return inverse


def _without_noise(K: Array, rows: Array) -> Array:
    """K with zeros for motions that no spring feels but by the rounding of its own geometry.

    A spring k whose rate along a motion is rounded to 0 still adds ``k EPSILON^2`` there, and
    ``k EPSILON`` beside it. A load can leave zero on the diagonal alone: that is no noise.
    """
    # Where the least of the diagonal is above all that can count as noise there is none.
    least, units = min(map(abs, K.diagonal().tolist())), (1.0, rows.item(-1))
    if least * min(units) ** 2 > _NOISE * _norm(K) * max(units) ** 2:
        return K
    size = np.abs(K) / rows / rows[:, None]
    most, share = size.max(initial=0.0), _GEOMETRY * numerics.EPSILON
    noise = (size.diagonal() <= share**2 * most) & (size.max(axis=1, initial=0.0) <= share * most)
    if noise.any():
        K = np.where(noise[:, None] | noise, 0.0, K)
    return K


def _without(some: Array, count: int) -> list[int]:
    """The whole numbers below `count` that are not among some."""
    known = set(some.tolist())
    return [i for i in range(count) if i not in known]


def _norm(array: Array) -> float:
    """Root of the sum of the squares of all entries."""
    return float(np.vdot(array, array)) ** 0.5


def _symmetric(matrix: Array, energy: Evaluation) -> Array:
    """The matrix without the asymmetry of its rounding, where the forces have a potential."""
    if energy.energy != energy.energy or numerics.is_symmetric(matrix):
        return matrix
    return 0.5 * (matrix + matrix.T)


def _doubtful(gradient: Array, stiffness: Array) -> Array:
    """What of each generalised force may be rounding of the coordinates that its spring feels."""
    return np.minimum(np.abs(gradient), numerics.ROUNDING * stiffness)


def _slight(J: Array, given: Array, energy: Evaluation) -> Array:
    """Generalised forces by which springs that carry a given wrench may miss it."""
    size = np.abs(J.T) @ np.abs(given) + np.abs(energy.gradient)
    rounding = numerics.ROUNDING * np.abs(energy.hessian).max(axis=0, initial=0.0)
    return np.asarray(numerics.UNFELT * size + rounding)


def _square(
    output: Map,
    energy: Evaluation,
    rows: Array,
    columns: Array,
    given: Array | None,
    apart: Callable[[], FreeMotions | None] | None,
) -> Reduction | None:
    """As many coordinates as outputs and no closure: K = J^-T H_L J^-1; None if J is singular."""
    J = output.jacobian
    values = numerics.singular_values(J * rows[:, None] * columns)
    if not values[-1] > numerics.RANK * values[0]:
        return None
    A = numerics.inverted(J, regular=True)
    force = A.T @ energy.gradient
    if given is not None:  # the springs' own torques are rounded where they are stiff
        missed = J.T @ given - energy.gradient
        if not any(missed.tolist()) or np.all(np.abs(missed) <= _slight(J, given, energy)):
            force = given
    curvature = output.curvature(force)
    H = energy.hessian - curvature
    n = len(values)

    def terms() -> Array:
        doubt = np.zeros(n)
        if force is not given:
            stiff = np.abs(energy.hessian).max(axis=0)
            doubt = np.abs(A.T) @ _doubtful(energy.gradient, stiff)
        least = float((np.abs(force * numerics.EPSILON) + doubt) @ (1 / rows)) / numerics.IDLE
        size = np.abs(energy.hessian) + np.abs(curvature)
        return np.asarray(size + least / columns / columns[:, None])

    def largest() -> float:
        stiff = _norm(energy.hessian)
        doubt = 0.0 if force is given else numerics.ROUNDING * stiff * _norm(A)
        lengths = sqrt(3.0 + 3.0 / rows.item(-1) ** 2)
        least = (numerics.EPSILON * _norm(force) + doubt) * lengths / numerics.IDLE
        return stiff + _norm(curvature) + least / min(columns.tolist()) ** 2

    free = FreeMotions(
        J, _symmetric(H, energy), terms, largest, is_symmetric=energy.energy == energy.energy,
        apart=apart,
    )  # fmt: skip
    idle = free.idle
    if any(idle.tolist()) and free.inverse() is None:
        H = np.where(idle[:, None] | idle, 0.0, H)
    K = A.T @ H @ A
    if energy.energy == energy.energy:
        K = 0.5 * (K + K.T)
    K = _without_noise(K, rows)
    return Reduction(force, K, np.zeros(0), values, n, n, free, rates=A)


def _general(
    output: Map,
    energy: Evaluation,
    closure: Map | None,
    rows: Array,
    columns: Array,
    force: Array | None,
    what: str,
) -> Reduction:
    """Any number of coordinates, closures, lost ranks: in scaled units throughout."""
    states: list[State] = []
    J = output.jacobian * rows[:, None] * columns
    g = energy.gradient * columns
    H = energy.hessian * columns[:, None] * columns
    n = len(g)
    stiff = np.abs(H).max(axis=0, initial=0.0)
    doubt = np.zeros(n) if force is not None else _doubtful(g, stiff)

    # N: all motions (n, f), led by the coordinates `leading`; orthonormal for singular values.
    closures, orthonormal = None, np.eye(n)
    N, leading, lam = orthonormal, np.arange(n), np.zeros(0)
    if closure is not None:
        closures = decompose(closure.jacobian * columns)
        orthonormal, lam = closures.N, np.zeros(len(closure.jacobian))
        if closures.rank < len(lam):
            found = irregular(
                closure, closures.values, closures.rank, closures.lost, orthonormal, columns
            )
            if found is not None:
                return Reduction(
                    None, None, lam, closures.values, 0, orthonormal.shape[1],
                    motions=orthonormal, states=[found],
                )  # fmt: skip
        N, leading = numerics.graded_basis(orthonormal, stiff, closures.V)
    motions = None if closure is None else orthonormal
    freedoms = N.shape[1]
    U, values, Vt = np.linalg.svd(J if closure is None else J @ orthonormal)
    rank = numerics.rank(values, numerics.EPSILON * np.abs(J).sum())
    U, lost, along = U[:, :rank], U[:, rank:], orthonormal @ Vt[rank:].T
    if rank == len(rows):
        U = np.eye(rank)  # else rounding of the basis stands where K is zero

    # Self-motions Z, led by the stiffest; the other leaders, as many as the rank, make the output.
    across = (U.T @ J @ N).T
    Z, chosen = numerics.graded_basis(along[leading], stiff[leading], across)
    others = _without(chosen, freedoms)
    Z, Y = N @ Z, N[:, others]
    # Motions of Y per reachable output.
    to_output = _inverse(across[others].T, (np.abs(J) @ np.abs(Y)).max(axis=0, initial=0.0))

    # Balance: a self-motion must feel no torque, whatever wrench acts on the output.
    felt = np.abs(Z.T @ g)
    if felt.size and np.any(
        felt > np.abs(Z.T) @ (numerics.BALANCE * np.abs(g) + numerics.ROUNDING * stiff)
    ):
        torque = along @ (along.T @ g) / columns
        states.append(
            State(
                "unbalanced",
                f"no wrench at the {what} balances this posture: a torque acts along the "
                "self-motion and the mechanism would move; choose rest positions that balance it, "
                "or let the self-motion settle",
                {"unbalanced_torque": torque.tolist(), "largest": float(np.abs(torque).max())},
            )
        )
        return Reduction(None, None, lam, values, rank, freedoms, motions=motions, states=states)

    w = U @ (to_output.T @ (Y.T @ g))
    if force is not None:
        given = force / rows
        missed = N.T @ (J.T @ given - g)
        size = np.abs(N.T) @ (np.abs(J.T) @ np.abs(given) + np.abs(g))
        if np.all(
            np.abs(missed) <= numerics.UNFELT * size + numerics.ROUNDING * (np.abs(N.T) @ stiff)
        ):
            w = given
        else:
            states.append(
                State(
                    "wrench-ignored",
                    "the wrench given is not the one that the springs exert on the reachable "
                    "motions; the wrench of least norm is used",
                    {"difference": missed.tolist()},
                )
            )
    parts, follow = [H, -output.curvature(w * rows) * columns[:, None] * columns], list[int]()
    if closure is not None and closures is not None:
        follow = _without(leading, n)
        lam = closures.forces(J.T @ w - g, follow)
        parts.append(closure.curvature(lam) * columns[:, None] * columns)
    H_L = sum(parts[1:], H)

    @cache
    def terms() -> Array:
        outward = np.abs(U) @ (np.abs(to_output.T) @ (np.abs(Y.T) @ doubt))
        inward = lam.size * doubt[follow].max(initial=0.0)
        least = numerics.EPSILON * (np.abs(w).sum() + np.abs(lam).sum()) + outward.sum() + inward
        return np.asarray(sum(map(np.abs, parts)) + float(least) / numerics.IDLE)

    if rank < len(rows):
        missing = lost * rows[:, None]
        kind = "deficient" if freedoms < len(rows) else "serial-singularity"
        states.append(
            State(
                kind,
                f"the {what} cannot move in {len(rows) - rank} of {len(rows)} directions here"
                + ("" if kind == "deficient" else " (serial singularity)")
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
        idle = (np.abs(S) <= numerics.IDLE * (size.T @ terms() @ size)).all(axis=1)
        S[idle], S[:, idle] = 0.0, 0.0  # what costs nothing is no rounding either
        if Z.shape[1]:
            S = S - (Y.T @ H_L @ Z) @ inner @ (Z.T @ H_L @ Y)
        reachable_K = _symmetric(to_output.T @ S @ to_output, energy)  # in the basis U
        reachable = U / rows[:, None]
        if rank == len(rows):
            K = _symmetric((U @ reachable_K @ U.T) * rows[:, None] * rows, energy)
            K = _without_noise(K, rows)
            if along.shape[1] == 0:
                rates = columns[:, None] * (Y @ to_output @ U.T) * rows
        B = np.concatenate([Y, Z], axis=1)
        J_B = np.concatenate([J @ Y, np.zeros((len(rows), Z.shape[1]))], axis=1)
        free = FreeMotions(
            J_B / rows[:, None], _symmetric(B.T @ H_L @ B, energy),
            lambda: np.abs(B.T) @ terms() @ np.abs(B),
            lambda: _norm(terms()) * float(np.vdot(B, B)),
            columns[:, None] * B, energy.energy == energy.energy,
        )  # fmt: skip
    if states and states[0].code in ("deficient", "serial-singularity") and reachable is not None:
        states[0].values["reachable_motions"] = reachable.T.tolist()
        states[0].values["reachable_stiffness"] = (
            None if reachable_K is None else reachable_K.tolist()
        )
        if free is not None and free.inverse() is None:
            words = states[0].message.replace(_COMPLIANCE_ALONE, _NEITHER)
            states[0] = states[0]._replace(message=words)
    return Reduction(
        w * rows, K, lam, values, rank, freedoms, free, reachable, reachable_K, rates, motions,
        states,
    )  # fmt: skip


def _held_self_motions(
    H: Array,
    terms: Callable[[], Array],
    Y: Array,
    Z: Array,
    along: Array,
    columns: Array,
    states: list[State],
) -> tuple[Array, Array] | None:
    """Self-motions (n, k) that stiffness holds, and the inverse (k, k) of it; None if one is not.

    Each is judged against the terms that act along it: measured in a unit of its own, in which
    these are 1.
    """
    if Z.shape[1] == 0:
        return Z, np.zeros((0, 0))
    every = np.concatenate([Y, Z], axis=1)
    size = np.abs(every)
    size = np.sqrt(((terms() @ size) * size).sum(axis=0))
    every = every / np.where(size > 0.0, size, 1.0)
    unit = every[:, Y.shape[1] :]
    block = unit.T @ H @ unit
    eigenvalues, modes = np.linalg.eigh(0.5 * (block + block.T))
    idle = np.abs(eigenvalues) <= numerics.IDLE
    if np.any(eigenvalues[~idle] < 0.0):
        block = along.T @ H @ along
        stiffness, modes = np.linalg.eigh(0.5 * (block + block.T))
        states.append(
            State(
                "buckled",
                "the self-motion is unstable: the energy has no minimum over it, the mechanism "
                "would snap away from this posture",
                {
                    "self_motion_stiffness": stiffness.tolist(),
                    "direction": (columns * (along @ modes[:, 0])).tolist(),  # the softest
                },
            )
        )
        return None
    if idle.any():
        Z0 = unit @ modes[:, idle]
        # An entry of a semidefinite matrix is at most the root of its two diagonal ones.
        coupled = bool(np.abs(every.T @ H @ Z0).max() > np.sqrt(numerics.IDLE))
        Z0 = Z0 / np.linalg.norm(Z0, axis=0)
        states.append(
            State(
                "idle-self-motion",
                f"{int(idle.sum())} self-motion(s) cost no energy"
                + (
                    " but couple to the others: no minimum exists"
                    if coupled
                    else ": they do not move the end-effector and are left out"
                ),
                {
                    "directions": (columns[:, None] * Z0).T.tolist(),
                    "coupling": float(np.abs(np.concatenate([Y, Z], axis=1).T @ H @ Z0).max()),
                },
            )
        )
        if coupled:
            return None
        unit = unit @ modes[:, ~idle]
    if unit.shape[1] == 0:
        return unit, np.zeros((0, 0))
    return unit, np.linalg.inv(unit.T @ H @ unit)
