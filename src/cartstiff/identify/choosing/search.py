"""Rows chosen greedily, exchanged for candidates, and moved to better places beside them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError
from cartstiff.identify.measurements import Measurements

#: Costs (k,) of informations (k, P, P).
Cost = Callable[[Array], Array]
#: Rows near those given, within a share of the ranges, and which of these each belongs to.
Beside = Callable[[Measurements, float, np.random.Generator], tuple[Measurements, NDArray[np.intp]]]

_PASSES = 20
#: Rows that are disturbed in all, a plan at a time, to leave a poor optimum.
_DISTURBED = 300
# Shares of the ranges by which rows are moved, one after the other; nearer than the last share but
# three no two rows of one load come, as the same row again would tell of noise, not of errors.
_SHARES = tuple(0.1 * 0.6**k for k in range(8))
_APART = 0.02


def cost_of(criterion: str, effects: Array | None, norm: float = np.inf) -> Cost:
    """Cost (k,) of informations (k, P, P); infinite for singular ones."""

    def of(M: Array) -> Array:
        if criterion == "all":
            sign, value = np.linalg.slogdet(M)
            return np.where(sign > 0, -value, np.inf)
        inverse = np.linalg.inv(M)
        if effects is not None:
            return np.einsum("ip,kpr,ir->k", effects, inverse, effects)
        return np.asarray(np.linalg.norm(inverse.diagonal(0, 1, 2), norm, axis=1))

    return of


def greedy(G: Array, start: Array, count: int, cost: Cost) -> list[int]:
    """Candidates, each the one that helps most after those before it."""
    M, chosen = start.copy(), list[int]()
    for _ in range(count):
        best = int(np.argmin(cost(M + G) + _taken(chosen, len(G))))
        chosen.append(best)
        M = M + G[best]
    return chosen


def _taken(chosen: list[int], offered: int) -> Array:
    """Infinite (N,) for what is chosen: the same row again would tell of noise, not of errors.

    Where nothing else is left, zero for all of it.
    """
    gains = np.zeros(offered)
    if len(set(chosen)) < offered:
        gains[chosen] = np.inf
    return gains


def _exchanged(G: Array, start: Array, chosen: list[int], cost: Cost) -> list[int]:
    """Each row exchanged for the candidate that helps most, until none does."""
    chosen = list(chosen)
    M = start + G[chosen].sum(axis=0)
    now = float(cost(M[None])[0])
    for _ in range(_PASSES):
        before = now
        for i, old in enumerate(chosen):
            costs = cost(M - G[old] + G) + _taken([*chosen[:i], *chosen[i + 1 :]], len(G))
            best = int(np.argmin(costs))
            if costs[best] < now - numerics.TELLING * abs(now):
                M, chosen[i], now = M - G[old] + G[best], best, float(costs[best])
        if not now < before:
            break
    return chosen


def searched(G: Array, start: Array, chosen: list[int], ways: list[Cost]) -> list[int]:
    """Exchanged by one cost after the other; then again after a quarter of the rows was drawn."""

    def through(rows: list[int], ways: list[Cost]) -> tuple[float, list[int]]:
        for way in ways:
            rows = _exchanged(G, start, rows, way)
        return float(ways[-1]((start + G[rows].sum(axis=0))[None])[0]), rows

    best, rng = through(chosen, ways), np.random.default_rng(0)
    for _ in range(_DISTURBED // len(chosen) if len(ways) > 1 else 0):
        rows = np.array(best[1])
        others = np.setdiff1d(np.arange(len(G)), rows)
        some = rng.permutation(len(rows))[: min(-(-len(rows) // 4), len(others))]
        rows[some] = rng.permutation(others)[: len(some)]
        best = min(best, through(rows.tolist(), ways[-2:]))
    return best[1]


def refined(
    rows: Measurements,
    information: Callable[[Measurements], Array],
    beside: Beside,
    start: Array,
    ways: list[Cost],
) -> tuple[Measurements, Array]:
    """Rows moved, each to the best of many places near it, ever nearer; what all places tell.

    Parameters
    ----------
    rows : Measurements
        Chosen.
    information : callable
        Informations (N, P, P) of rows.
    beside : callable
        Rows near those given; the first of each is it itself.
    start : ndarray (P, P)
        What is known besides.
    ways : list of callable
        Costs; the last one decides.

    Returns
    -------
    rows : Measurements
        No worse than those given.
    tried : ndarray (k, P, P)
        Informations of all rows that were tried.
    """
    rng, tried, best = np.random.default_rng(0), [information(rows)], rows
    least = float(ways[-1]((start + tried[0].sum(axis=0))[None])[0])
    for share in _SHARES:
        near, owner = beside(rows, share, rng)
        try:
            G = information(near)
        except CartstiffError:  # a place without an answer
            continue
        tried.append(G)
        at = np.unique(owner, return_index=True)[1]
        for way in ways[-2:]:
            M = start + G[at].sum(axis=0)
            now = float(way(M[None])[0])
            for i in range(len(at)):
                mine = np.flatnonzero(owner == i)
                mine = mine[_apart(near, mine, np.delete(at, i))]
                costs = way(M - G[at[i]] + G[mine])
                if mine.size and costs.min() < now - numerics.TELLING * abs(now):
                    to = int(mine[np.argmin(costs)])
                    M, at[i], now = M - G[at[i]] + G[to], to, float(costs.min())
        rows = near.taken(at.tolist())
        reached = float(ways[-1]((start + G[at].sum(axis=0))[None])[0])
        if reached < least:
            best, least = rows, reached
    return best, np.concatenate(tried)


def _apart(
    near: Measurements, mine: NDArray[np.intp], others: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Which rows are not all but one of the others: postures alike, loads along one line."""
    spans = np.ptp(near.q, axis=0)
    spans[spans == 0.0] = np.inf
    far = np.abs(near.q[mine, None] - near.q[others]) / spans
    loads = near.wrench / np.maximum(np.linalg.norm(near.wrench, axis=1), numerics.TINY)[:, None]
    crossed = np.abs(loads[mine] @ loads[others].T) < 0.5
    crossed &= loads[others].any(axis=1)
    return np.asarray((crossed | (far.max(axis=2) > _APART)).all(axis=1))
