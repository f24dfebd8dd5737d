"""Newton's method with steps of least change: how far a step goes, and when the search ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from cartstiff.numerics.criteria import ATTAINABLE_PRECISION, FUTILE, SMALLEST_STEP
from cartstiff.numerics.policy import RANK, ROUNDING, Array

T = TypeVar("T")


def least_change(
    x: T,
    equations: Callable[[T], tuple[Array, Array]],
    moved: Callable[[T, Array], T],
    *,
    most: int,
    longest: float,
    enough: float = ROUNDING,
    rank: float = RANK,
    weights: Array | float = 1.0,
) -> tuple[T, float, int]:
    """The point near x that meets equations best, what it misses, and how many were looked at.

    The search ends at `ATTAINABLE_PRECISION`, or below `enough` once a step no longer halves what
    is missed; where whole steps bring nothing `FUTILE` times in a row, which leads to where it is
    least and not to where it is zero; and where steps change nothing.

    Parameters
    ----------
    x
        Where the search starts; any kind of thing that the two functions know.
    equations : callable
        What a point misses (m,) and its rates (m, n), in natural units.
    moved : callable
        The point after a step (n,).
    most : int
        Bound on the number of points.
    longest : float
        Largest part of one step; longer ones are shortened.
    enough : float
        What may be missed where steps no longer halve it.
    rank : float
        Share of the largest singular value of the rates below which directions are left alone.
    weights : ndarray (n,) or float
        How far each part moves where all are pushed alike.
    """
    best, kept, futile, seen = np.inf, x, 0, 0
    while seen < most:
        seen += 1
        missed, rates = equations(x)
        size = float(np.abs(missed).max(initial=0.0))
        ended = size <= ATTAINABLE_PRECISION or (size <= enough and size >= 0.5 * best)
        futile = 0 if size < 0.9 * best else futile + 1
        if size < best:
            best, kept = size, x
        if ended:
            break
        step = weights * np.linalg.lstsq(rates * weights, -missed, rcond=rank)[0]
        largest = float(np.abs(step).max(initial=0.0))
        is_whole = largest < longest
        if not SMALLEST_STEP < largest < np.inf or (futile >= FUTILE and is_whole):
            break
        x = moved(x, np.asarray(step * min(1.0, longest / largest), float))
    return kept, best, seen
