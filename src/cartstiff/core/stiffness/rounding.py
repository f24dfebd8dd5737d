"""Round-off in stiffnesses, forces and wrenches: set to zero, or bounded."""

from __future__ import annotations

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array

#: Relative error of the direction of a spring.
_DIRECTION_ERROR = 16.0 * numerics.EPSILON


def zero_roundoff(K: Array, rows: Array) -> Array:
    """K with zeros for motions whose stiffness is only the round-off of the
    springs' directions.

    A spring k whose exact rate along a motion is 0 still adds ``k EPSILON^2`` to the
    diagonal, and ``k EPSILON`` beside it. A zero on the diagonal alone may come from a
    load and is kept.
    """
    # Return quickly if the least entry of the diagonal exceeds all possible round-off.
    least, units = min(map(abs, K.diagonal().tolist())), (1.0, rows.item(-1))
    if least * min(units) ** 2 > _DIRECTION_ERROR**2 * norm(K) * max(units) ** 2:
        return K
    size = np.abs(K) / rows / rows[:, None]
    limit = size.max(initial=0.0) * _DIRECTION_ERROR
    is_roundoff = size.diagonal() <= limit * _DIRECTION_ERROR
    is_roundoff &= size.max(axis=1, initial=0.0) <= limit
    return np.where(is_roundoff[:, None] | is_roundoff, 0.0, K)


def without_cancelled(sums: Array, K: Array, changes: Array, rows: Array) -> Array:
    """Sums K + D (k, 6, 6) with zeros for rows and columns whose terms cancel
    to round-off.

    Each row is compared with the largest of its terms, with lengths in the unit that
    `rows` is the inverse of; equilibration would make it a soft motion.
    """
    units = rows * rows[:, None]
    for axis in (-1, -2):
        left = np.abs(sums / units).max(axis=axis, keepdims=True)
        size = (np.abs(K / units) + np.abs(changes / units)).max(axis=axis, keepdims=True)
        sums = np.where(left <= numerics.ROUNDOFF_OF_SUMS * size, 0.0, sums)
    return sums


def norm(array: Array) -> float:
    """Root of the sum of the squares of all entries."""
    return float(np.vdot(array, array)) ** 0.5


def symmetric_part(matrix: Array, has_energy: bool) -> Array:
    """Symmetric part of a matrix if the forces have a potential, else the matrix."""
    if not has_energy or numerics.is_symmetric(matrix):
        return matrix
    return 0.5 * (matrix + matrix.T)


def force_roundoff(gradient: Array, stiffness: Array) -> Array:
    """Part of each generalised force that round-off of its coordinate may cause."""
    return np.minimum(np.abs(gradient), numerics.ROUNDOFF * stiffness)


def exceeds_roundoff(
    wrench: Array, jacobian: Array, hessian: Array, sizes: Array
) -> bool:
    """Whether a wrench (6,) exceeds, at some spring, the round-off of the coordinate.

    `sizes` (n,) are the natural sizes of the coordinates of J (6, n) and H (n, n).
    """
    torques = np.abs(jacobian.T @ wrench * sizes).tolist()
    stiffness = (
        np.abs(hessian * (sizes[:, None] * sizes)).max(axis=0, initial=0.0).tolist()
    )
    most = max(stiffness, default=0.0)  # also for coordinates without a spring
    return any(
        torque > numerics.ROUNDOFF * (k or most)
        for torque, k in zip(torques, stiffness, strict=True)
    )


def shown_wrench(
    wrench: Array, hessian: Array | None, sizes: Array, length: float
) -> Array:
    """A wrench (6,) with round-off in its moment and force set to 0.

    Round-off is the torque of the springs for a rotation by `numerics.ROUNDOFF`, and that
    share of the largest component, a force being multiplied by the characteristic length.
    """
    stiffest = 0.0
    if hessian is not None:
        stiffest = numerics.largest(hessian * (sizes[:, None] * sizes))
    values = wrench.tolist()
    scaled = [*map(abs, values[:3]), *(length * abs(x) for x in values[3:])]
    roundoff = numerics.ROUNDOFF * max(stiffest, *scaled)
    if min(scaled) > roundoff:
        return wrench
    return np.array(
        [x if s > roundoff else 0.0 for x, s in zip(values, scaled, strict=True)]
    )
