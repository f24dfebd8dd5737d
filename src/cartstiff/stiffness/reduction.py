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

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.potentials.contract import Evaluation, Map
from cartstiff.stiffness.closures import decomposed
from cartstiff.stiffness.free_motions import FreeMotions
from cartstiff.stiffness.general_reduction import reduce_any
from cartstiff.stiffness.reduced import Reduction as Reduction
from cartstiff.stiffness.regular_reduction import plainly_redundant, reduce_square
from cartstiff.stiffness.rounding import without_noise


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
        result = reduce_square(output, energy, rows, coordinate_lengths, force, apart)
        if result is not None:
            return result
    if closure is None and n > m:
        plain = plainly_redundant(output, energy, rows, coordinate_lengths, force)
        if plain is not None:
            force, K, values, free = plain
            K = without_noise(K, rows)
            inner = K / rows / rows[:, None]
            return Reduction(force, K, np.zeros(0), values, m, n, free, np.diag(1 / rows), inner)
    with numerics.one_thread(n):
        return reduce_any(output, energy, closure, rows, coordinate_lengths, force, what)


def values_of_closed(posture: MechanismPosture) -> tuple[Array, int, Array]:
    """`Reduction.singular_values`, `freedoms` and `motions` where closures are regular."""
    assert posture.closure is not None
    per_length, columns = 1 / posture.length, posture.coordinate_lengths
    rows = np.array([1.0, 1.0, 1.0, per_length, per_length, per_length])
    N = decomposed(posture.closure, columns).N
    J = posture.motion.jacobian * rows[:, None] * columns
    return numerics.singular_values(J @ N), N.shape[1], N


def scaled_values(posture: MechanismPosture, jacobian: Array | None = None) -> Array:
    """Singular values of the length-scaled Jacobian of a posture, which may be known."""
    J = posture.motion.jacobian if jacobian is None else jacobian
    per_length = 1 / posture.length
    rows = np.array([1.0, 1.0, 1.0, per_length, per_length, per_length])
    return numerics.singular_values(J * rows[:, None] * posture.coordinate_lengths)
