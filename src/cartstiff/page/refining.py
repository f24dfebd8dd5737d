"""Refinement of a sweep where its curves begin, end or jump, or may do so between two postures."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from itertools import pairwise
from math import log10
from typing import Any

import numpy as np

from cartstiff.geometry.se3 import Array

# A curve that changes by less than this factor from one posture to the next is drawn well enough.
_DECADES = 0.1
# A curve that begins or ends counts as a change of this many decades.
_BREAK = 3.0

#: The plotted numbers of a posture with its "q", or the "reason" why it is not reached.
Row = Mapping[str, Any]
#: By the coordinate that runs.
Rows = dict[float, Row]
_RowAt = Callable[[Array], Row]


def outwards(
    row_at: _RowAt, base: Array, i: int, values: Array, follow: bool
) -> Generator[None, None, Rows]:
    """Rows at all values of coordinate i, yielding between them.

    Outwards from `base`, each from its neighbour: a closed chain keeps its branch. Unless `follow`
    the coordinates of a row are not those to begin at (drives have moved them on).
    """
    rows: Rows = {}
    last = {-1: base, 1: base}
    for k in np.argsort(np.abs(values - base[i]), kind="stable"):
        side = 1 if values[k] >= base[i] else -1
        q = last[side].copy()
        q[i] = values[k]
        row = row_at(q)
        if "reason" not in row:
            last[side] = np.array(row["q"]) if follow else q
        rows[float(values[k])] = row
        yield
    return rows


def refine(
    rows: Rows, row_at: _RowAt, i: int, narrow: float, most: int
) -> Generator[None, None, None]:
    """Add up to `most` rows where `widest_jump` wants them, yielding between them."""
    known: dict[tuple[float, float], float] = {}
    for _ in range(most):
        if (middle := widest_jump(rows, narrow, known)) is None:
            return
        near = min((x for x in rows if "reason" not in rows[x]), key=lambda x: abs(x - middle))
        q = np.array(rows[near]["q"])
        q[i] = middle
        rows[middle] = row_at(q)
        yield


def widest_jump(
    rows: Mapping[float, Row], narrow: float, known: dict[tuple[float, float], float] | None = None
) -> float | None:
    """The middle of the interval over which the curves change most; None where all are smooth.

    A cable that is slack in two neighbours may be taut between them: its margin (length less
    natural length) is followed by the parabola through three neighbours.

    Parameters
    ----------
    rows : mapping of float to row
        By the coordinate that runs, in any order.
    narrow : float
        Intervals up to this width are left.
    known : dict, optional
        Changes over intervals that were looked at before; those that are new are added.
    """
    at, known = sorted(rows), {} if known is None else known
    if not any("reason" not in row for row in rows.values()):
        return None
    middle, most = None, _DECADES
    for k, (a, b) in enumerate(pairwise(at)):
        if b - a <= narrow:
            continue
        if (a, b) not in known:
            known[a, b] = _change(rows[a], rows[b])
        change, outside = known[a, b], (at[k - 1 : k] + at[k + 2 : k + 3])
        for outer in outside if rows[a].get("margins") else ():
            if change < _BREAK and _crosses_between(rows, a, b, outer):
                change = _BREAK
        if change > most:
            middle, most = 0.5 * (a + b), change
    return middle


def _change(one: Row, other: Row) -> float:
    """Decades between the values of two rows."""
    if "reason" in one or "reason" in other:
        return 0.0 if ("reason" in one) == ("reason" in other) else _BREAK
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


def _crosses_between(rows: Mapping[float, Row], a: float, b: float, outer: float) -> bool:
    """Whether a margin has one sign at a and b, and by a parabola the other one between."""
    one, other, third = rows[a], rows[b], rows[outer]
    if not all("reason" not in row for row in (one, other, third)):
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
