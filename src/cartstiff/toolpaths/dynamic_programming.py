"""The best way through layers of candidates, one of each, where not every step is allowed.

Dynamic programming, exact: first the way whose worst candidate is least, then among all ways that
are no worse the one of least sum. Costs are not negative; what costs infinitely much is never
taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Literal, get_args

import numpy as np

from cartstiff import numerics
from cartstiff.errors import UnknownNameError
from cartstiff.geometry.se3 import Array

#: What is made small: the worst cost (and after it the sum), or the sum alone.
Objective = Literal["worst", "mean"]

# Costs are equal within this: the worst one must not exclude itself by rounding.
_EQUAL = 1.0 + numerics.ROUNDING
# Candidates of a layer that are tried at first; four times as many each time after.
_FEW = 100


def best_way(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    objective: Objective = "worst",
) -> tuple[list[int] | None, list[Array]]:
    """One candidate of each layer.

    Parameters
    ----------
    costs : sequence of ndarray (c_i,)
        Costs of the candidates of each layer.
    steps : callable
        ``steps(i, a, b)`` gives what steps from candidates a (indices in layer i) to candidates b
        (in layer i + 1) add to the sum, infinite where one is forbidden: (len(a), len(b)).
    objective : {"worst", "mean"}
        See `Objective`.

    Returns
    -------
    way : list of int, or None
        Indices; None if no way goes through all layers.
    reached : list of ndarray
        Candidates of each layer that some way from the first layer leads to, as far as any does.
    """
    if objective not in get_args(Objective):
        raise UnknownNameError("objective", str(objective), get_args(Objective))
    usable = [np.flatnonzero(np.isfinite(c)) for c in costs]
    if objective == "worst":
        total, reached, _ = _among_few(costs, steps, usable, worst=True)
        if total is None:
            return None, reached
        bound = float(total.min())
        better = [rows[c[rows] < bound] for c, rows in zip(costs, usable, strict=True)]
        if all(map(len, better)):
            total, *_ = _forward(costs, steps, _linked(steps, better), worst=True)
            bound = bound if total is None else float(total.min())
        usable = [rows[c[rows] <= bound * _EQUAL] for c, rows in zip(costs, usable, strict=True)]
    total, reached, origins = _among_few(costs, steps, usable, worst=False)
    if total is not None:
        # A way through a candidate costs at least it and the cheapest of all other layers.
        least = [float(c[rows].min()) for c, rows in zip(costs, usable, strict=True)]
        spare = float(total.min()) * _EQUAL - sum(least)
        usable = [
            rows[c[rows] <= own + spare] for c, rows, own in zip(costs, usable, least, strict=True)
        ]
        total, reached, origins = _forward(costs, steps, _linked(steps, usable), worst=False)
    if total is None:
        return None, reached
    k = int(np.argmin(total))
    way = [int(reached[-1][k])]
    for origin, layer in zip(reversed(origins), reversed(reached[:-1]), strict=True):
        k = int(origin[k])
        way.append(int(layer[k]))
    return way[::-1], reached


_Ways = tuple[Array | None, list[Array], list[Array]]


def _among_few(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    usable: Sequence[Array],
    worst: bool,
) -> _Ways:
    """`_forward` among the cheapest of each layer: ever more, until there is a way, or all."""
    count, most = _FEW, max(map(len, usable))
    while count < most:
        few = [
            np.sort(rows[np.argsort(c[rows], kind="stable")[:count]])
            for c, rows in zip(costs, usable, strict=True)
        ]
        way = _forward(costs, steps, few, worst)
        if way[0] is not None:
            return way
        count *= 4
    return _forward(costs, steps, usable, worst)


def _linked(steps: Callable[[int, Array, Array], Array], usable: Sequence[Array]) -> list[Array]:
    """What the smallest layer can be reached from, or reaches: a way goes through nothing else."""
    linked = list(usable)
    smallest = int(np.argmin([len(rows) for rows in usable]))
    for i in range(smallest - 1, -1, -1):
        linked[i] = linked[i][np.isfinite(steps(i, linked[i], linked[i + 1])).any(axis=1)]
    for i in range(smallest + 1, len(linked)):
        linked[i] = linked[i][np.isfinite(steps(i - 1, linked[i - 1], linked[i])).any(axis=0)]
    return linked


def _forward(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    usable: Sequence[Array],
    worst: bool,
) -> _Ways:
    """Costs of the best ways to the last layer, candidates reached, and whence each is reached."""
    reached, origins = [usable[0]], []
    total = costs[0][usable[0]]
    for i in range(1, len(costs)):
        a, b = reached[-1], usable[i]
        if not a.size:
            break
        step = steps(i - 1, a, b)
        # The worst candidate is what counts: a step is free or forbidden.
        step = np.where(np.isfinite(step), 0.0, np.inf) if worst else step
        arriving = total[:, None] + step
        origin = np.argmin(arriving, axis=0)
        before = arriving[origin, np.arange(b.size)]
        reachable = np.isfinite(before)
        reached.append(b[reachable])
        origins.append(origin[reachable])
        own = costs[i][b[reachable]]
        total = np.maximum(before[reachable], own) if worst else before[reachable] + own
    complete = len(reached) == len(costs) and reached[-1].size > 0
    return (total if complete else None), reached, origins


class Steps:
    """What a step of the coordinates costs: forbidden beyond a bound, dearer the larger below it.

    Parameters
    ----------
    q : sequence of ndarray (c_i, n)
        Coordinates of the candidates.
    periodic : ndarray of bool (n,)
        Coordinates of which whole turns do not count.
    bounds : ndarray (n,)
        Largest step of each.
    price : float
        Price of a step in which every coordinate reaches its bound; others cost by the mean square.
    sides : sequence of ndarray (c_i,), optional
        A step from one number to another is forbidden.
    """

    def __init__(
        self,
        q: Sequence[Array],
        periodic: Array,
        bounds: Array,
        price: float = 0.0,
        sides: Sequence[Array] | None = None,
    ) -> None:
        self.q, self.periodic, self.bounds, self.price = q, periodic, bounds, price
        self.sides = sides

    def crosses(self, i: int, a: Array, b: Array) -> Array:
        """Which steps change sides: bool (len(a), len(b))."""
        if self.sides is None:
            return np.zeros((len(a), len(b)), bool)
        changed: Array = self.sides[i][a][:, None] != self.sides[i + 1][b]
        return changed

    def _shares(self, i: int, a: Array, b: Array) -> Iterator[Array]:
        """Step over bound, coordinate by coordinate: each (len(a), len(b))."""
        for j, bound in enumerate(self.bounds):
            step = self.q[i + 1][b, j] - self.q[i][a, j][:, None]
            if self.periodic[j]:
                step = step - 2 * np.pi * np.round(step / (2 * np.pi))
            yield step / bound

    def share(self, i: int, a: Array, b: Array) -> Array:
        """Largest step over its bound, of all coordinates: (len(a), len(b))."""
        worst = np.zeros((len(a), len(b)))
        for share in self._shares(i, a, b):
            np.maximum(worst, np.abs(share), out=worst)
        return worst

    def __call__(self, i: int, a: Array, b: Array) -> Array:
        """Cost of steps from candidates a of layer i to candidates b of the next."""
        square, worst = np.zeros((2, len(a), len(b)))
        for share in self._shares(i, a, b):
            share = share * share
            square += share
            np.maximum(worst, share, out=worst)
        allowed = (worst <= 1.0) & ~self.crosses(i, a, b)
        return np.where(allowed, self.price / len(self.bounds) * square, np.inf)
