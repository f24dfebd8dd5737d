"""How good a choice of rows can be: by chance, and at best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array

_DRAWS, _STEPS = 1000, 300


def by_chance(G: Array, start: Array, count: int) -> float:
    """Largest standard deviation of candidates drawn at random: the median of many draws."""
    rng = np.random.default_rng(0)
    worst = [
        spread_of(start + G[rng.integers(0, len(G), count)].sum(axis=0)).max()
        for _ in range(_DRAWS)
    ]
    return float(np.median(worst))


def bound_of(G: Array, start: Array, count: int) -> tuple[float, Array]:
    r"""What no choice of `count` candidates can beat: a lower bound of the largest deviation.

    Besides, how much each candidate helps the best mixture, by parameter (N, P).

    For shares mu of the parameters that add up to one, ``f = tr(diag(mu) M^-1)`` is at most
    ``max_j (M^-1)_jj``, and convex: with ``X = M^-1 diag(mu) M^-1`` at any M every choice has at
    least ``f^2 / (count max_i tr(X G_i) + tr(X M_0))`` [AtkinsonDonev]_. M is a mixture of
    candidates whose shares are raised where they help; mu, where the interval is wide.
    """
    N, P = G.shape[:2]
    shares, mu, best = np.full(N, 1.0 / N), np.full(P, 1.0 / P), 0.0
    for _ in range(_STEPS):
        inverse = np.linalg.inv(start + count * np.einsum("i,ijk->jk", shares, G))
        variances = inverse.diagonal()
        f, X = float(mu @ variances), (inverse * mu) @ inverse
        helps = np.maximum(np.einsum("ijk,jk->i", G, X), 0.0)
        best = max(best, f * f / (count * float(helps.max()) + float(np.sum(X * start))))
        shares = shares * np.sqrt(helps)
        shares /= shares.sum()
        mu = mu * np.sqrt(variances)
        mu /= mu.sum()
    parts = mu * np.einsum("jp,ijk,kp->ip", inverse, G, inverse, optimize=True)
    return float(np.sqrt(best)), parts


def most_helpful(helps: Array, count: int) -> NDArray[np.intp]:
    """Candidates that help most, half of them in all, half of them one of the parameters each.

    Where many candidates help alike, the first alone might leave a parameter out.
    """
    places = np.argsort(-np.column_stack([helps.sum(axis=1), helps]), axis=0, kind="stable")
    each = -(-count // (2 * helps.shape[1]))
    return np.unique(np.append(places[: count // 2, 0], places[:each, 1:]))


def spread_of(M: Array) -> Array:
    """Standard deviations from an information; infinite where it is singular."""
    inverse = numerics.invert(M)
    if inverse is None:
        return np.full(len(M), np.inf)
    return np.sqrt(np.maximum(inverse.matrix.diagonal(), 0.0))
