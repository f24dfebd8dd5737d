"""Where a sweep needs another posture: curves that break off, jump, or may do so between two."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from math import log10
from typing import Any

# A curve that changes by less than this factor from one posture to the next is drawn well enough.
_DECADES = 0.1
# What breaks off, or starts, counts as a change of this many decades.
_BREAK = 3.0

_Row = Mapping[str, Any] | None


def widest_jump(rows: Mapping[float, _Row], narrow: float) -> float | None:
    """The middle of the interval over which the curves change most; None where all are smooth.

    A cable that is slack in two neighbours may be taut between them: its margin (length less
    natural length) is followed by the parabola through three neighbours.

    Parameters
    ----------
    rows : mapping of float to row or None
        By the coordinate that runs, in any order; None where no posture is reached.
    narrow : float
        Intervals up to this width are left.
    """
    at = sorted(rows)
    if not any(rows.values()):
        return None
    middle, most = None, _DECADES
    for k, (a, b) in enumerate(pairwise(at)):
        if b - a <= narrow:
            continue
        change = _change(rows[a], rows[b])
        for outer in ([at[k - 1]] if k else []) + ([at[k + 2]] if k + 2 < len(at) else []):
            if change < _BREAK and _crosses_between(rows, a, b, outer):
                change = _BREAK
        if change > most:
            middle, most = 0.5 * (a + b), change
    return middle


def _change(one: _Row, other: _Row) -> float:
    """Decades between the values of two rows."""
    if one is None or other is None:
        return 0.0 if one is other else _BREAK
    change = 0.0
    for freedom in ("translation", "rotation"):
        a, b = one[freedom], other[freedom]
        if a is None or b is None:
            change = max(change, 0.0 if a is b else _BREAK)
            continue
        for x, y in zip(a, b, strict=True):
            if x * y <= 0.0:
                change = max(change, 0.0 if x == y else _BREAK)
            else:
                change = max(change, min(_BREAK, abs(log10(x / y))))
    return change


def _crosses_between(rows: Mapping[float, _Row], a: float, b: float, outer: float) -> bool:
    """Whether a margin has one sign at a and b, and by a parabola the other one between."""
    one, other, third = rows[a], rows[b], rows[outer]
    if one is None or other is None or third is None:
        return False
    for x, y, z in zip(one["margins"], other["margins"], third["margins"], strict=True):
        slope = (y - x) / (b - a)
        bend = ((z - x) / (outer - a) - slope) / (outer - b)
        if x * y <= 0.0 or not bend:
            continue
        t = 0.5 * (a + b) - 0.5 * slope / bend  # where the parabola has its turning point
        if a < t < b and (x + slope * (t - a) + bend * (t - a) * (t - b)) * x < 0.0:
            return True
    return False
