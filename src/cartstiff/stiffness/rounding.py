"""What of a stiffness, a force, a matrix may be the rounding of the numbers it is made of."""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.potentials.contract import Evaluation

#: How many units of rounding the direction of a spring may be off.
_GEOMETRY = 16.0
_NOISE = (_GEOMETRY * numerics.EPSILON) ** 2


def zero_roundoff(K: Array, rows: Array) -> Array:
    """K with zeros for motions that no spring feels but by the rounding of its own geometry.

    A spring k whose rate along a motion is rounded to 0 still adds ``k EPSILON^2`` there, and
    ``k EPSILON`` beside it. A load can leave zero on the diagonal alone: that is no noise.
    """
    # Where the least of the diagonal is above all that can count as noise there is none.
    least, units = min(map(abs, K.diagonal().tolist())), (1.0, rows.item(-1))
    if least * min(units) ** 2 > _NOISE * norm(K) * max(units) ** 2:
        return K
    size = np.abs(K) / rows / rows[:, None]
    most, share = size.max(initial=0.0), _GEOMETRY * numerics.EPSILON
    noise = (size.diagonal() <= share**2 * most) & (size.max(axis=1, initial=0.0) <= share * most)
    if noise.any():
        K = np.where(noise[:, None] | noise, 0.0, K)
    return K


def without_cancelled(sums: Array, K: Array, changes: Array, rows: Array) -> Array:
    """Sums K + D (k, 6, 6) with zeros for rows and columns that the terms cancel to rounding.

    What is left of a row is measured by the largest of its terms, lengths in the unit that `rows`
    is the inverse of: equilibrating would take it for a soft motion.
    """
    units = rows * rows[:, None]
    for axis in (-1, -2):
        left = np.abs(sums / units).max(axis=axis, keepdims=True)
        size = (np.abs(K / units) + np.abs(changes / units)).max(axis=axis, keepdims=True)
        sums = np.where(left <= numerics.LAST_DIGITS * size, 0.0, sums)
    return sums


def norm(array: Array) -> float:
    """Root of the sum of the squares of all entries."""
    return float(np.vdot(array, array)) ** 0.5


def symmetric_part(matrix: Array, energy: Evaluation) -> Array:
    """The matrix without the asymmetry of its rounding, where the forces have a potential."""
    if energy.energy != energy.energy or numerics.is_symmetric(matrix):
        return matrix
    return 0.5 * (matrix + matrix.T)


def force_roundoff(gradient: Array, stiffness: Array) -> Array:
    """What of each generalised force may be rounding of the coordinates that its spring feels."""
    return np.minimum(np.abs(gradient), numerics.ROUNDING * stiffness)


def exceeds_roundoff(wrench: Array, jacobian: Array, hessian: Array, sizes: Array) -> bool:
    """Whether some spring feels more of a wrench (6,) than the rounding of its coordinate.

    `sizes` (n,) are the natural sizes of the coordinates of J (6, n) and H (n, n).
    """
    torques = np.abs(jacobian.T @ wrench * sizes).tolist()
    stiffness = np.abs(hessian * (sizes[:, None] * sizes)).max(axis=0, initial=0.0).tolist()
    most = max(stiffness, default=0.0)  # for those without a spring the others' rounding counts
    return any(
        torque > numerics.ROUNDING * (k or most)
        for torque, k in zip(torques, stiffness, strict=True)
    )


def shown_wrench(wrench: Array, hessian: Array | None, sizes: Array, length: float) -> Array:
    """A wrench (6,) with moment and force set to 0 where they are rounding.

    Rounding is what the springs exert over a turn of `numerics.ROUNDING`, and what is below
    that share of the other half, a force taken over the characteristic length.
    """
    stiffest = 0.0
    if hessian is not None:
        stiffest = float(np.abs(hessian * (sizes[:, None] * sizes)).max(initial=0.0))
    values = wrench.tolist()
    scaled = [*map(abs, values[:3]), *(length * abs(x) for x in values[3:])]
    noise = numerics.ROUNDING * max(stiffest, *scaled)
    if min(scaled) > noise:
        return wrench
    return np.array([x if s > noise else 0.0 for x, s in zip(values, scaled, strict=True)])
