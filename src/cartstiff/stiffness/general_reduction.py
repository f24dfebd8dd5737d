"""The reduction with any number of coordinates, with closures, with lost ranks, in scaled units."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from cartstiff import numerics
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.notes import Note
from cartstiff.potentials.contract import Evaluation, Map
from cartstiff.stiffness.closures import decomposed, irregular
from cartstiff.stiffness.free_motions import FreeMotions
from cartstiff.stiffness.reduced import Reduction
from cartstiff.stiffness.rounding import doubtful, norm, symmetric_part, without_noise

_COMPLIANCE_ALONE = "the stiffness matrix does not exist, the compliance does"
_NEITHER = "the stiffness matrix does not exist, nor the compliance, as a motion costs nothing"


def _inverse(matrix: Array, sizes: Array) -> Array:
    """Inverse of a regular matrix, with zeros for entries that may be rounding alone.

    `sizes` (n,) are those of the numbers whose sums and products each column of the matrix is.
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
    size = np.abs(inverse)
    rounding = len(matrix) * numerics.EPSILON * np.outer(size.sum(axis=1), sizes @ size)
    inverse[size <= rounding] = 0.0
    return inverse


def _without(some: Array, count: int) -> list[int]:
    """The whole numbers below `count` that are not among some."""
    known = set(some.tolist())
    return [i for i in range(count) if i not in known]


def reduce_any(
    output: Map,
    energy: Evaluation,
    closure: Map | None,
    rows: Array,
    columns: Array,
    force: Array | None,
    what: str,
) -> Reduction:
    """Any number of coordinates, closures, lost ranks: in scaled units throughout."""
    states, short = list[Note](), None
    J = output.jacobian * rows[:, None] * columns
    g = energy.gradient * columns
    H = energy.hessian * columns[:, None] * columns
    n = len(g)
    stiff = np.abs(H).max(axis=0, initial=0.0)
    doubt = np.zeros(n) if force is not None else doubtful(g, stiff)

    # N: all motions (n, f), led by the coordinates `leading`; orthonormal for singular values.
    closures, orthonormal = None, np.eye(n)
    N, leading, lam, closed = orthonormal, np.arange(n), np.zeros(0), np.zeros(0)
    if closure is not None:
        closed = np.ones(len(closure.jacobian)) if closure.sizes is None else closure.sizes
        closures = decomposed(closure, columns)
        orthonormal, lam = closures.N, np.zeros(len(closure.jacobian))
        if closures.rank < len(lam):
            lost = closures.lost / closed[:, None]
            state = irregular(closure, closures.values, closures.rank, lost, orthonormal, columns)
            if state is not None:
                return Reduction(
                    None,
                    None,
                    lam,
                    closures.values,
                    0,
                    orthonormal.shape[1],
                    motions=orthonormal,
                    states=[state],
                )
        N, leading = numerics.graded_basis(orthonormal, stiff, closures.V)
    motions = None if closure is None else orthonormal
    freedoms = N.shape[1]
    U, values, Vt = np.linalg.svd(J if closure is None else J @ orthonormal)
    rank = numerics.rank(values, numerics.EPSILON * np.abs(J).sum())
    U, lost, along = U[:, :rank], U[:, rank:], orthonormal @ Vt[rank:].T
    still = list[slice]()
    if rank == len(rows):
        U = np.eye(rank)  # else rounding of the basis stands where K is zero
    else:
        still = numerics.still_halves(J @ orthonormal)
        for half in still:
            U[half] = 0.0

    # Self-motions Z, led by the stiffest; the other leaders, as many as the rank, make the output.
    across = (U.T @ J @ N).T
    Z, chosen = numerics.graded_basis(along[leading], stiff[leading], across)
    others = _without(chosen, freedoms)
    Z, Y = N @ Z, N[:, others]
    # Motions of Y per reachable output.
    to_output = _inverse(across[others].T, (np.abs(J) @ np.abs(Y)).max(axis=0, initial=0.0))

    # Balance: a self-motion must feel no torque, whatever wrench acts on the output.
    felt = np.abs(Z.T @ g)
    # What of Z is less than `RANK` may be missing, and with it the forces there.
    unseen = numerics.RANK * float(np.abs(g).sum())
    most = np.abs(Z.T) @ (numerics.BALANCE * np.abs(g) + numerics.ROUNDING * stiff)
    most += np.abs(Z).max(axis=0, initial=0.0) * unseen
    if felt.size and np.any(felt > most):
        torque = along @ (along.T @ g) / columns
        states.append(
            Note(
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
        asked = force / rows
        missed = N.T @ (J.T @ asked - g)
        size = np.abs(N.T) @ (np.abs(J.T) @ np.abs(asked) + np.abs(g))
        # Rates that should be zero are rounded, too, beside the others.
        rounded = numerics.LAST_DIGITS * (np.abs(J).max() * np.abs(asked).sum() + np.abs(g).max())
        unfelt = np.abs(N.T) @ (rounded + numerics.ROUNDING * stiff)
        if np.all(np.abs(missed) <= numerics.NEGLIGIBLE_FORCE * size + unfelt):
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
    parts, follow = [H, -output.curvature(w * rows) * columns[:, None] * columns], list[int]()
    if closure is not None and closures is not None:
        follow = _without(leading, n)
        lam = closures.forces(J.T @ w - g, follow) / closed
        parts.append(closure.curvature(lam) * columns[:, None] * columns)
    H_L = sum(parts[1:], H)

    @cache
    def terms() -> Array:
        outward = np.abs(U) @ (np.abs(to_output.T) @ (np.abs(Y.T) @ doubt))
        inward = lam.size * doubt[follow].max(initial=0.0)
        carried = np.abs(w).sum() + np.abs(lam * closed).sum()
        least = numerics.EPSILON * carried + outward.sum() + inward
        return np.asarray(sum(map(np.abs, parts)) + float(least) / numerics.IDLE)

    if rank < len(rows):
        missing = lost * rows[:, None]
        kind = "fewer-than-six-freedoms" if freedoms < len(rows) else "serial-singularity"
        short = len(states)
        states.append(
            Note(
                kind,
                f"the {what} cannot move in {len(rows) - rank} of {len(rows)} directions here"
                + ("" if kind == "fewer-than-six-freedoms" else " (serial singularity)")
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
        reachable_K = symmetric_part(to_output.T @ S @ to_output, energy)  # in the basis U
        reachable = U / rows[:, None]
        if rank == len(rows):
            K = symmetric_part((U @ reachable_K @ U.T) * rows[:, None] * rows, energy)
            K = without_noise(K, rows)
            if Z.shape[1] == 0:  # idle self-motions, such as spins of legs, may stay as they are
                rates = columns[:, None] * (Y @ to_output @ U.T) * rows
        B = np.concatenate([Y, Z], axis=1)
        # Self-motions keep what little they move the output: a lost rank need not be zero. Rates
        # that are rounding of the basis are none: a rotation that the closures forbid.
        J_B, size = J @ B, np.outer(np.abs(J).sum(axis=1), np.abs(B).max(axis=0, initial=0.0))
        J_B[np.abs(J_B) <= n * numerics.EPSILON * size] = 0.0
        for half in still:
            J_B[half] = 0.0
        free = FreeMotions(
            J_B / rows[:, None],
            symmetric_part(B.T @ H_L @ B, energy),
            lambda: np.abs(B.T) @ terms() @ np.abs(B),
            lambda: norm(terms()) * float(np.vdot(B, B)),
            columns[:, None] * B,
            energy.energy == energy.energy,
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
        free,
        reachable,
        reachable_K,
        rates,
        motions,
        states,
        None if closures is None else closures.values,
    )


def _held_self_motions(
    H: Array,
    terms: Callable[[], Array],
    Y: Array,
    Z: Array,
    along: Array,
    columns: Array,
    states: list[Note],
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
            Note(
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
