r"""The best of the postures at a pose, where self-motions make a family of them.

Quasi-Newton steps (BFGS) in the natural sizes of the coordinates: the part of the cost's slope
along the self-motions is followed, and each step is brought back to its pose. The change of that
part from one posture to the next tells how the cost curves along the family.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.joint_poses import JointPoses
from cartstiff.kinematics.platform_poses import Free

# Motions along a self-motion, in the natural sizes of the coordinates: the first that is tried,
# the longest, and the one at which a posture counts as settled; how often, at most.
_FIRST_STEP, _LONGEST_STEP, _SETTLED, _SETTLING = 0.2, 0.5, numerics.SETTLED, 200
# A slope that has become less by so much, or is so small beside the cost, is none; and how often a
# posture begins anew on one that is left.
_FLAT, _NO_SLOPE, _TRIES = 1e-3, numerics.NO_SLOPE, 3
# Half the distance of the postures whose costs' difference gives a slope.
_DIFFERENCE = numerics.DIFFERENCE


def settled(
    solver: JointPoses,
    q: Array,
    T: Array,
    free: Free,
    tolerance: float,
    cost: Callable[[Array], Array],
) -> Array:
    """Postures (N, n) moved along their self-motions to where the cost is smallest nearby.

    Parameters
    ----------
    solver : JointPoses
        Brings postures back to their poses.
    q, T : ndarray, shapes (N, n) and (N, 4, 4)
        Postures and the poses that they are at.
    free : {"none", "x", "y", "z", "rotation"}
        What of the body's rotation is left free.
    tolerance : float
        Largest error of the poses.
    cost : callable
        (k, n) postures to (k,) numbers, NaN where there is none.
    """
    result, rows, sizes = q.copy(), np.arange(len(q)), solver.sizes
    if not len(q):
        return result
    value = _values(cost, q)
    J, slope = solver.task(q, T, free)[1], _slopes(cost, q, value, sizes)
    reach, moved, tries = np.ones(len(q)), np.zeros_like(q), np.zeros(len(q), int)
    before, unit = solver.along_self_motions(q, J, slope), np.eye(q.shape[1])
    first = _length(before)
    begin = np.where(np.isfinite(value), _FIRST_STEP, _LONGEST_STEP)
    inverse = _ratio(begin, first)[:, None, None] * unit
    for _ in range(_SETTLING):
        along = solver.along_self_motions(q, J, slope)
        inverse = _updated(inverse, moved, along - before)
        step = solver.along_self_motions(q, J, slope, inverse)
        step *= (reach * np.minimum(1.0, _ratio(_LONGEST_STEP, _length(step))))[:, None]
        # Where the cost has an edge the steps end on a slope, and begin once more straight down.
        steep = _length(along)
        flat = steep <= np.where(np.isfinite(value), _NO_SLOPE * np.abs(value), 0.0)
        spent = flat | (_length(step) <= _SETTLED)
        again = spent & ~flat & (steep > _FLAT * first) & (tries < _TRIES)
        inverse[again] = _ratio(0.1 * _FIRST_STEP, steep[again])[:, None, None] * unit
        reach[again], tries[again] = 1.0, tries[again] + 1
        keep = ~spent | again
        result[rows] = q
        here = rows, q, T, J, value, slope, reach, inverse, along, step, first, tries
        kept: tuple[Any, ...] = tuple(array[keep] for array in here)
        rows, q, T, J, value, slope, reach, inverse, before, step, first, tries = kept
        if not rows.size:
            break
        trial = np.clip(q - step * sizes, solver.lower, solver.upper)
        trial, good = solver.solve(T, trial, free, tolerance)
        reached = np.where(good, _values(cost, trial), np.inf)
        better = reached < value - numerics.SUFFICIENT * (slope * step).sum(axis=1)
        # Without a cost either way may lead to one.
        reach = np.where(better, 1.0, np.where(np.isfinite(value), 0.3, -0.8) * reach)
        moved = np.where(better[:, None], trial - q, 0.0) / sizes
        q[better], value[better] = trial[better], reached[better]
        if better.any():
            J[better] = solver.task(q[better], T[better], free)[1]
            slope[better] = _slopes(cost, q[better], value[better], sizes)
    return result


def _values(cost: Callable[[Array], Array], q: Array) -> Array:
    return np.nan_to_num(cost(q), nan=np.inf)


def _slopes(cost: Callable[[Array], Array], q: Array, value: Array, sizes: Array) -> Array:
    """Derivatives of the cost (N, n) by differences; where there is none, any way out will do."""
    steps = _DIFFERENCE * np.vstack([np.diag(sizes), -np.diag(sizes)])
    around = cost((q[:, None] + steps).reshape(-1, q.shape[1])).reshape(len(q), 2, -1)
    around = np.where(np.isfinite(around), around, value[:, None, None])
    with np.errstate(invalid="ignore"):
        slopes = (around[:, 0] - around[:, 1]) / (2 * _DIFFERENCE)
    return np.where(np.isfinite(slopes), slopes, 1.0)


def _updated(inverse: Array, moved: Array, change: Array) -> Array:
    """Inverse Hessians that explain how the slopes have changed, where the cost curves upwards."""
    curved = np.einsum("ni,ni->n", moved, change)
    upwards = curved > numerics.SADDLE * _length(moved) * _length(change)
    scale = np.where(upwards, _ratio(1.0, curved), 0.0)
    left = np.eye(moved.shape[1]) - scale[:, None, None] * moved[:, :, None] * change[:, None, :]
    return left @ inverse @ left.swapaxes(1, 2) + scale[:, None, None] * (
        moved[:, :, None] * moved[:, None, :]
    )


def _length(rows: Array) -> Array:
    return np.sqrt((rows * rows).sum(axis=1))


def _ratio(number: float | Array, array: Array) -> Array:
    quotient: Array = number / np.where(array == 0.0, np.inf, array)
    return quotient
