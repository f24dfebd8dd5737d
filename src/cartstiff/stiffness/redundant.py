r"""More joints than six, plainly regular: the compliance first, and from it the stiffness.

Where nothing is nearly lost, ``C = J H_L^-1 J^T`` of all joints and ``K = C^-1`` are what the
reduction over the self-motion gives, with less work.
"""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.potentials.contract import Evaluation, Map
from cartstiff.stiffness.free_motions import FreeMotions

__all__ = ["plainly_redundant"]


def plainly_redundant(
    output: Map, energy: Evaluation, rows: Array, columns: Array, given: Array | None
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
    given : ndarray, shape (6,), or None
        The wrench that the springs balance; without it they must exert nothing.

    Returns
    -------
    force, stiffness, singular_values, free
        w (6,), K (6, 6), the six of the scaled Jacobian, and the motions.
    """
    J, g, H = output.jacobian, energy.gradient, energy.hessian
    if energy.energy != energy.energy:
        return None
    missed = g if given is None else J.T @ given - g
    if any(missed.tolist()):
        return None
    values = numerics.singular_values(J * rows[:, None] * columns)
    if not values[-1] * numerics.WELL_CONDITIONED > values[0]:
        return None
    force = np.zeros(len(J)) if given is None else given
    curvature = output.curvature(force)
    H_L = H - curvature
    H_L = 0.5 * (H_L + H_L.T)
    found = numerics.plain_inverses(H_L[None])
    if found is None or not found[1][0] < np.inf or not _has_minimum(H_L):
        return None
    C = J @ found[0][0] @ J.T
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
