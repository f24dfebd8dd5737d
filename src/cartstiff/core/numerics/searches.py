"""Newton's method with steps of least norm, limits of a step,
and criteria for the end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from cartstiff.core.numerics.criteria import (
    ATTAINABLE_PRECISION,
    MAX_FUTILE_STEPS,
    SMALLEST_STEP,
)
from cartstiff.core.numerics.policy import RANK, ROUNDOFF, Array, largest

T = TypeVar("T")


def least_change(
    x: T,
    equations: Callable[[T], tuple[Array, Array]],
    retract: Callable[[T, Array], T],
    *,
    evaluations: int,
    longest_step: float,
    tolerance: float = ROUNDOFF,
    rank: float = RANK,
    weights: Array | float = 1.0,
) -> tuple[T, float, int]:
    """The point near x with the least residual, that residual,
    and the number of evaluations.

    The search ends at `ATTAINABLE_PRECISION`; below `tolerance` once a step no longer
    halves the residual; after `MAX_FUTILE_STEPS` consecutive whole steps without
    progress, at a minimum that is not zero; and when steps are too small to change the
    point.

    Parameters
    ----------
    x
        Start of the search, of any type that both functions accept.
    equations : callable
        Residual (m,) of a point and its rates (m, n), in natural units.
    retract : callable
        The point after a step (n,).
    evaluations : int
        Bound on the number of evaluations.
    longest_step : float
        Largest component of a step; longer steps are shortened.
    tolerance : float
        Largest residual that is accepted when steps no longer halve it.
    rank : float
        Share of the largest singular value of the rates below which directions are not
        used.
    weights : ndarray (n,) or float
        Relative mobility of the coordinates.
    """
    best, kept, futile, seen = np.inf, x, 0, 0
    while seen < evaluations:
        seen += 1
        residual, rates = equations(x)
        size = largest(residual)
        ended = size <= ATTAINABLE_PRECISION or (size <= tolerance and size >= 0.5 * best)
        futile = 0 if size < 0.9 * best else futile + 1
        if size < best:
            best, kept = size, x
        if ended:
            break
        step = weights * np.linalg.lstsq(rates * weights, -residual, rcond=rank)[0]
        length = largest(step)
        is_whole = length < longest_step
        if not SMALLEST_STEP < length < np.inf or (
            futile >= MAX_FUTILE_STEPS and is_whole
        ):
            break
        x = retract(x, np.asarray(step * min(1.0, longest_step / length), float))
    return kept, best, seen


def zero_between(
    value: Callable[[float], float],
    start: float,
    end: float,
    precision: float,
    evaluations: int,
) -> float:
    """Where a continuous function changes its sign between two places.

    Chandrupatla's method: inverse quadratic interpolation where the last three values
    are nearly a straight line, else half of what is left. It is here because the import
    of SciPy's searches takes as long as many an answer.

    Parameters
    ----------
    value : callable
        The function.
    start, end : float
        Places with values of different signs.
    precision : float
        Length of the interval in which the search ends.
    evaluations : int
        Bound on the number of evaluations.

    Returns
    -------
    float
        The place of the interval's ends with the smaller value.

    References
    ----------
    Chandrupatla, Advances in Engineering Software 28 (1997) 145-149.
    """
    near, far, third = (start, value(start)), (end, value(end)), (start, 0.0)
    share = 0.5
    for _ in range(evaluations - 2):
        best = min(near, far, key=lambda place: abs(place[1]))
        left = abs(far[0] - near[0])
        if best[1] == 0.0 or left <= precision:
            return best[0]
        x = near[0] + share * (far[0] - near[0])
        found = x, value(x)
        if (found[1] > 0.0) == (near[1] > 0.0):
            third = near
        else:
            third, far = far, near
        near = found
        share = _share_of_way(near, far, third)
        least = 0.5 * precision / abs(far[0] - near[0]) if far[0] != near[0] else 0.5
        share = min(max(share, least), 1.0 - least)
    return min(near, far, key=lambda place: abs(place[1]))[0]


def _share_of_way(
    near: tuple[float, float], far: tuple[float, float], third: tuple[float, float]
) -> float:
    """Share of the way from near to far at which `zero_between` looks next."""
    (a, f), (b, g), (c, h) = near, far, third
    if f == 0.0 or g == h:
        return 0.5
    way, rise = (a - b) / (c - b), (f - g) / (h - g)
    if not (rise**2 < way and (1.0 - rise) ** 2 < 1.0 - way):
        return 0.5
    return f / (g - f) * h / (g - h) + (c - a) / (b - a) * f / (h - f) * g / (h - g)
