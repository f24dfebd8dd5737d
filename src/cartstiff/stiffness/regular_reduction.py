r"""The reductions of plainly regular arms, in fewer steps than the general one.

Six joints: ``K = J^-T H_L J^-1``. More than six: ``C = J H_L^-1 J^T`` of all joints and
``K = C^-1`` are what the reduction over the self-motion gives, with less work.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.potentials.contract import IDENTITY, Evaluation, Map
from cartstiff.stiffness.free_motions import FreeMotions
from cartstiff.stiffness.reduced import Reduction
from cartstiff.stiffness.rounding import doubtful, norm, without_noise


def _is_carried(J: Array, force: Array, energy: Evaluation) -> bool:
    """Whether springs carry a given wrench: their own torques are rounded where they are stiff."""
    missed = J.T.dot(force) - energy.gradient
    if not any(missed.tolist()):
        return True
    size = np.abs(J.T) @ np.abs(force) + np.abs(energy.gradient)
    rounding = numerics.ROUNDING * np.abs(energy.hessian).max(axis=0, initial=0.0)
    return bool(np.all(np.abs(missed) <= numerics.NEGLIGIBLE_FORCE * size + rounding))


def reduce_square(
    output: Map,
    energy: Evaluation,
    rows: Array,
    columns: Array,
    wrench: Array | None,
    apart: Callable[[], FreeMotions | None] | None,
) -> Reduction | None:
    """As many coordinates as outputs and no closure: K = J^-T H_L J^-1; None if J is singular."""
    J = A = output.jacobian
    values = np.ones(6)
    if output is not IDENTITY:
        values = numerics.singular_values(J * rows[:, None] * columns)
        if not values[-1] > numerics.RANK * values[0]:
            return None
        A = numerics.inverted(J, regular=True)
    is_carried = wrench is not None and _is_carried(J, wrench, energy)
    force = wrench if wrench is not None and is_carried else A.T.dot(energy.gradient)
    curvature = output.curvature(force)
    H = energy.hessian - curvature
    if energy.energy == energy.energy:  # without the asymmetry of rounding
        H = 0.5 * (H + H.T)
    n = len(values)

    def terms() -> Array:
        doubt = np.zeros(n)
        if force is not wrench:
            stiff = np.abs(energy.hessian).max(axis=0)
            doubt = np.abs(A.T) @ doubtful(energy.gradient, stiff)
        least = float((np.abs(force * numerics.EPSILON) + doubt) @ (1 / rows)) / numerics.IDLE
        size = np.abs(energy.hessian) + np.abs(curvature)
        return np.asarray(size + least / columns / columns[:, None])

    def largest() -> float:
        stiff = norm(energy.hessian)
        doubt = 0.0 if force is wrench else numerics.ROUNDING * stiff * norm(A)
        lengths = sqrt(3.0 + 3.0 / rows.item(-1) ** 2)
        least = (numerics.EPSILON * norm(force) + doubt) * lengths / numerics.IDLE
        return stiff + norm(curvature) + least / min(columns.tolist()) ** 2

    free = FreeMotions(
        J, H, terms, largest, is_symmetric=energy.energy == energy.energy, apart=apart
    )
    if not free.is_far_from_idle and free.idle.any() and free.inverse() is None:
        H = np.where(free.idle[:, None] | free.idle, 0.0, H)
    K = A.T.dot(H).dot(A)
    if energy.energy == energy.energy:
        K = 0.5 * (K + K.T)
    K = without_noise(K, rows)
    return Reduction(force, K, np.zeros(0), values, n, n, free, rates=A)


def plainly_redundant(
    output: Map, energy: Evaluation, rows: Array, columns: Array, wrench: Array | None
) -> tuple[Array, Array, Array, FreeMotions] | None:
    """The reduction of an arm with more than six joints, or None where it takes more care.

    Parameters
    ----------
    output : Map
        Jacobian (6, n) and curvature of the end-effector.
    energy : Evaluation
        In the coordinates.
    rows, columns : ndarray, shapes (6,), (n,)
        Scales of the output's components and natural sizes of the coordinates.
    wrench : ndarray, shape (6,), or None
        The wrench that the springs balance; without it they must exert nothing.

    Returns
    -------
    force, stiffness, singular_values, free
        w (6,), K (6, 6), the six of the scaled Jacobian, and the motions.
    """
    J, g, H = output.jacobian, energy.gradient, energy.hessian
    if energy.energy != energy.energy:
        return None
    missed = g if wrench is None else J.T @ wrench - g
    if any(missed.tolist()):
        return None
    values = numerics.singular_values(J * rows[:, None] * columns)
    if not values[-1] * numerics.WELL_CONDITIONED > values[0]:
        return None
    force = np.zeros(len(J)) if wrench is None else wrench
    curvature = output.curvature(force)
    H_L = H - curvature
    H_L = 0.5 * (H_L + H_L.T)
    inverse_of_H = numerics.plain_inverses(H_L[None])
    if inverse_of_H is None or not inverse_of_H[1][0] < np.inf or not _has_minimum(H_L):
        return None
    C = J @ inverse_of_H[0][0] @ J.T
    inverse = numerics.plain_inverses(0.5 * (C + C.T)[None])
    if inverse is None or not inverse[1][0] < np.inf:
        return None
    K = inverse[0][0]

    def terms() -> Array:
        least = numerics.EPSILON * float(np.abs(force) @ (1 / rows)) / numerics.IDLE
        return np.asarray(np.abs(H) + np.abs(curvature) + least / columns / columns[:, None])

    def largest() -> float:
        return float(np.linalg.norm(terms()))

    return force, 0.5 * (K + K.T), values, FreeMotions(J, H_L, terms, largest)


def _has_minimum(hessian: Array) -> bool:
    try:
        np.linalg.cholesky(hessian)
    except np.linalg.LinAlgError:
        return False
    return True
