r"""Tensions of lines that balance a load: nearest to given ones, with every cable taut.

The tensions t of m lines balance a load w where ``A t = w``, with a column of A for each
line. Of more lines than motions many t do. The set that is chosen is

    min |t - t_0|^2 with A t = w, t_c >= kept(s) d_c for every cable c, t <= (1 + 2 v) h

where t_0 are the given tensions, d_c > 0 the tension that a cable should keep, and h the
largest forces of those lines that have such a limit (so for the forces of struts, with
both signs). v is the least share by which limits must be exceeded to balance the load
without a cable that pushes; 0 mostly. s is the largest share, at most 1, of d that all
cables can have at once within these limits, and, for lines without one, without tensions
above twice the largest one of t_0 and of the set with kept = 0. v and s are the values of
linear programs, and

    kept(s) = s (1 + s) / 2

is 1 if that is possible, and else below s. The set then has inner points, so that t is
continuous in the pose wherever taut cables balance the load. Without a limit on tensions,
d would be kept by ever larger ones towards the poses where the cables no longer hold the
body.

With ``t = t_1 + N y``, t_1 the balanced tensions nearest to t_0 and N an orthonormal
basis of the changes that need no wrench, the set is that of the shortest y within the
bounds. All functions here but the first take stacks of p postures: one posture is a stack
of one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.numerics.shortest import shortest_above

#: Largest tension that keeps other cables taut, over the largest tension without that
#: bound.
_LARGEST_INCREASE = 2.0
#: Weight of the changes of tensions in linear programs, see `_smallest`.
_EASE = 1e-3

Flags = NDArray[np.bool_]


def nearest_balance(matrix: Array, wanted: Array, given: Array) -> Array:
    """Tensions (m,) nearest to given ones for which ``matrix @ t`` is nearest
    to `wanted`.
    """
    tensions = given
    # A second step corrects the round-off of nearly dependent lines.
    for _ in range(2):
        missing = wanted - matrix @ tensions
        added, _, _, values = np.linalg.lstsq(matrix, missing, rcond=numerics.RANK)
        tensions = tensions + added
        if numerics.ratio(values) >= numerics.NEAR_SINGULARITY:
            break
    return tensions


class Bounds(NamedTuple):
    """Bounds of the tensions of m lines.

    Attributes
    ----------
    least : ndarray (p, m)
        For cables the tension that each should keep, above zero or zero; for other lines
        the lower limit of the force, or -inf.
    most : ndarray (p, m)
        Largest forces, or inf.
    cables : ndarray of bool (m,)
        The lines that cannot push.

    Whether a line has a bound is the same at all postures.
    """

    least: Array
    most: Array
    cables: Array

    def contain(self, tensions: Array) -> Flags:
        """Whether all tensions (p, m) are within the bounds."""
        inside = (tensions >= self.least) & (tensions <= self.most)
        return np.asarray(inside.all(axis=1))

    def of(self, which: Flags, size: Array) -> Bounds:
        """Those at some postures, as shares of a tension (p,)."""
        sizes = size[which, None]
        return Bounds(self.least[which] / sizes, self.most[which] / sizes, self.cables)

    def limits(self) -> tuple[Array, Array, Array]:
        """Limits that may be exceeded: ``R t <= b + v c``, R (r, m), b and c (p, r)."""
        rows = np.eye(len(self.cables))
        upper = np.isfinite(self.most).all(axis=0)
        lower = np.isfinite(self.least).all(axis=0) & ~self.cables
        R = np.vstack([rows[upper], -rows[lower]])
        b = np.concatenate([self.most[:, upper], -self.least[:, lower]], axis=1)
        finite = (
            np.where(np.isfinite(x), np.abs(x), 0.0) for x in (self.least, self.most)
        )
        sizes = np.maximum(*finite)
        return R, b, np.concatenate([sizes[:, upper], sizes[:, lower]], axis=1)


def null_basis(matrix: Array) -> Array:
    """Changes of tensions that need no wrench: an orthonormal basis (m, d) for a
    matrix (6, m).
    """
    _, values, Vt = np.linalg.svd(matrix)
    return np.asarray(Vt[numerics.rank(values) :].T)


def within_bounds(
    null: Array, tensions: Array, bounds: Bounds, largest: Array
) -> tuple[Array, Flags]:
    """Balanced tensions (p, m) nearest to balanced ones in which all cables are taut.

    Parameters
    ----------
    null : ndarray (p, m, d)
        Bases of changes that need no wrench, see `null_basis`.
    tensions : ndarray (p, m)
        Those nearest to the given ones, without a bound.
    bounds : Bounds
        Of their tensions.
    largest : ndarray (p,)
        Largest given tension.

    Returns
    -------
    found : ndarray (p, m)
    is_found : ndarray of bool (p,)
        False where a cable would have to push.
    """
    cables = bounds.cables
    found, is_found = tensions.copy(), bounds.contain(tensions)
    left = ~is_found
    if not left.any():
        return found, is_found
    size = np.maximum(
        np.abs(tensions).max(axis=1), bounds.least[:, cables].max(axis=1, initial=0.0)
    )
    t, sizes, N = tensions[left], size[left, None], null[left]
    if N.shape[2]:
        own, own_bounds = t / sizes, bounds.of(left, size)
        y = _nearest(N, own, own_bounds, largest[left] / sizes[:, 0])
        t = sizes * (own + _times(N, y))
    least = t[:, cables].min(axis=1, initial=0.0)
    is_found[left] = least >= -numerics.BALANCE_TOLERANCE * sizes[:, 0]
    # A cable at its bound has no tension, and not its round-off.
    t = np.where(cables & (t <= numerics.ROUNDOFF * sizes), 0.0, t)
    # No load, and no set of tensions balances itself.
    is_zero = np.abs(t).max(axis=1, keepdims=True) <= numerics.NEGLIGIBLE_FORCE * sizes
    found[left] = np.where(is_zero, 0.0, t)
    return found, is_found


def _nearest(N: Array, own: Array, bounds: Bounds, largest: Array) -> Array:
    """Shortest y (p, d) with which ``own + N y`` keeps the bounds, see the module."""
    cables = bounds.cables
    pull, taut, least = N[:, cables], own[:, cables], bounds.least[:, cables]
    R, b, c = bounds.limits()
    above = np.isinf(bounds.most).all(axis=0)
    G = np.concatenate([pull, -R @ N], axis=1)

    def shortest(which: Flags, kept: Array | float) -> tuple[Array, Flags]:
        """The same with the share `kept` of what cables should keep."""
        missing = (
            kept * least[which] - taut[which],
            own[which] @ R.T - b[which],
        )
        return shortest_above(G[which], np.concatenate(missing, axis=1))

    every = np.ones(len(own), bool)
    if len(R) and not (can_keep := shortest(every, 0.0)[1]).all():
        no = ~can_keep
        eased = np.concatenate([np.zeros_like(taut[no]), c[no]], axis=1)
        missing = np.concatenate([-taut[no], own[no] @ R.T - b[no]], axis=1)
        b[no] += 2.0 * _smallest(G[no], eased, missing)[0][:, None] * c[no]
    y, exists = shortest(every, 1.0)
    highest = (own + _times(N, y))[:, above].max(axis=1, initial=0.0)
    left = ~(exists & (highest <= _LARGEST_INCREASE * largest))
    if not left.any():
        return y
    # The largest tensions that need no lower bound above zero.
    edge = _edge(pull[left], taut[left])
    at_edge = (own[left] + _times(N[left], edge)).max(axis=1)
    most = _LARGEST_INCREASE * np.maximum(largest[left], at_edge)
    is_over = ~(exists[left] & (highest[left] <= most))
    left[left], edge, most = is_over, edge[is_over], most[is_over]
    if not left.any():
        return y
    # Below these the cables keep a share only.
    rows = np.vstack([R, np.eye(len(cables))[above]])
    limits = np.concatenate([b[left], np.repeat(most[:, None], above.sum(), 1)], axis=1)
    lost, inner = _smallest(
        np.concatenate([pull[left], -rows @ N[left]], axis=1),
        np.concatenate([least[left], np.zeros_like(limits)], axis=1),
        np.concatenate([least[left] - taut[left], own[left] @ rows.T - limits], axis=1),
    )
    share = np.maximum(1.0 - lost, 0.0)[:, None]
    found, exists = shortest(left, 0.5 * share * (1.0 + share))
    y[left] = np.where(exists[:, None], found, np.where(share > 0.0, inner, edge))
    return y


def _edge(N: Array, own: Array) -> Array:
    """Shortest y (p, d) with which no cable pushes, or the one with which
    they push least.
    """
    if not N.shape[1]:
        return np.zeros((len(N), N.shape[2]))
    # Where not all cables can pull, the set has no inner points.
    y, exists = shortest_above(N, -own - 0.5 * numerics.BALANCE_TOLERANCE)
    if not exists.all():
        no = ~exists
        y[no] = _smallest(N[no], np.ones_like(own[no]), -own[no])[1]
    return y


def _smallest(G: Array, eased: Array, g: Array) -> tuple[Array, Array]:
    """Smallest u (p,) from 0, and y (p, d), with ``G y + u eased >= g``.

    This linear program is the limit of ``min u^2 + e^2 |y|^2`` for small e. Its vertices
    are exact for finite e already, unless u is about e^2.
    """
    count, r, d = G.shape
    rows = np.zeros((count, r + 1, d + 1))
    rows[:, :r, :d], rows[:, :r, d], rows[:, r, d] = G / _EASE, eased, 1.0
    y, exists = shortest_above(rows, np.concatenate([g, np.zeros((count, 1))], axis=1))
    y = np.where(exists[:, None], y, 0.0)
    return np.maximum(y[:, d], 0.0), y[:, :d] / _EASE


def _times(N: Array, y: Array) -> Array:
    """``N y`` of stacks (p, m, d) and (p, d)."""
    return np.asarray((N @ y[:, :, None])[:, :, 0])
