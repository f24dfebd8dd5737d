r"""Tensions of lines that balance a load: nearest to given ones, with every cable taut.

The tensions t of m lines balance a load w where ``A t = w``, with a column of A for each line. Of
more lines than motions many t do. The set that is chosen is

    min |t - t_0|^2   with   A t = w,   t_c >= kept(s) d_c for every cable c,   t <= (1 + 2 v) h

where t_0 are the given tensions, d_c > 0 the tension that a cable should keep, and h the largest
forces of those lines that have such a limit (so for the forces of struts, with both signs). v is
the least share by which limits must be exceeded to balance the load without a cable that pushes;
0 mostly. s is the largest share, at most 1, of d that all cables can have at once within these
limits, and, for lines without one, without tensions above twice the largest one of t_0 and of the
set with kept = 0. v and s are the values of linear programs, and

    kept(s) = s (1 + s) / 2

is 1 if that is possible, and else below s. The set then has inner points, so that t is continuous
in the pose wherever taut cables balance the load. Without a limit on tensions, d would be kept by
ever larger ones towards the poses where the cables no longer hold the body.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array

#: Largest tension that keeps other cables taut, over the largest tension without that bound.
_LARGEST_INCREASE = 2.0
#: Weight of the changes of tensions in linear programs, see `_smallest`.
_EASE = 1e-3


def nearest_balance(matrix: Array, wanted: Array, given: Array) -> Array:
    """Tensions (m,) nearest to given ones for which ``matrix @ t`` is nearest to `wanted`."""
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
    least : ndarray (m,)
        For cables the tension that each should keep, above zero or zero; for other lines the
        lower limit of the force, or -inf.
    most : ndarray (m,)
        Largest forces, or inf.
    cables : ndarray of bool (m,)
        The lines that cannot push.
    """

    least: Array
    most: Array
    cables: Array

    def contain(self, tensions: Array) -> bool:
        """Whether all tensions (m,) are within the bounds."""
        return bool((tensions >= self.least).all() and (tensions <= self.most).all())

    def over(self, size: float) -> Bounds:
        """The same as shares of a tension."""
        return Bounds(self.least / size, self.most / size, self.cables)

    def limits(self) -> tuple[Array, Array, Array]:
        """Limits that may be exceeded: ``R t <= b + v c`` with rows R (r, m), b and c (r,)."""
        rows = np.eye(len(self.most))
        upper = np.isfinite(self.most)
        lower = np.isfinite(self.least) & ~self.cables
        R = np.vstack([rows[upper], -rows[lower]])
        b = np.concatenate([self.most[upper], -self.least[lower]])
        finite = (
            np.where(np.isfinite(x), np.abs(x), 0.0) for x in (self.least, self.most)
        )
        sizes = np.maximum(*finite)
        return R, b, np.concatenate([sizes[upper], sizes[lower]])


def within_bounds(
    matrix: Array, tensions: Array, bounds: Bounds, largest: float = 0.0
) -> Array | None:
    """Balanced tensions (m,) nearest to balanced ones in which all cables are taut.

    Parameters
    ----------
    matrix : ndarray (6, m)
        Wrenches of unit tensions.
    tensions : ndarray (m,)
        Those nearest to the given ones, without a bound.
    bounds : Bounds
        Of their tensions.
    largest : float
        Largest given tension.

    Returns
    -------
    ndarray (m,) or None
        None if a cable would have to push.
    """
    if bounds.contain(tensions):
        return tensions
    cables = bounds.cables
    size = max(
        float(np.abs(tensions).max()), float(bounds.least[cables].max(initial=0.0))
    )
    _, values, Vt = np.linalg.svd(matrix)
    N = Vt[numerics.rank(values) :].T  # changes that need no wrench
    found = tensions
    if N.shape[1]:
        own = tensions / size
        found = size * (own + N @ _nearest(N, own, bounds.over(size), largest / size))
    if found[cables].min(initial=0.0) < -numerics.BALANCE_TOLERANCE * size:
        return None
    if np.abs(found).max() <= numerics.NEGLIGIBLE_FORCE * size:
        return np.zeros(len(found))  # no load, and no set of tensions balances itself
    # A cable at its bound has no tension, and not its round-off.
    return np.where(cables & (found <= numerics.ROUNDOFF * size), 0.0, found)


def _nearest(N: Array, own: Array, bounds: Bounds, largest: float) -> Array:
    """Shortest y (d,) with which ``own + N y`` keeps the bounds, see the module."""
    cables, least = bounds.cables, bounds.least[bounds.cables]
    pull = N[cables]
    edge = _edge(pull, own[cables])
    R, b, c = bounds.limits()
    above = np.isinf(bounds.most)
    largest = _LARGEST_INCREASE * max(largest, float((own + N @ edge).max()))
    G, g = np.vstack([pull, -R @ N]), np.concatenate([-own[cables], R @ own - b])
    if len(R) and _shortest(G, g) is None:
        excess, _ = _smallest(G, np.append(np.zeros(len(pull)), c), g)
        b = b + 2.0 * excess * c

    def shortest(share: float) -> Array | None:
        return _shortest(G, np.concatenate([share * least - own[cables], R @ own - b]))

    y = shortest(1.0)
    if y is not None and (own + N @ y)[above].max(initial=0.0) <= largest:
        return y
    rows = np.vstack([R, np.eye(len(own))[above]])
    most = np.concatenate([b, np.full(np.count_nonzero(above), largest)])
    lost, inner = _smallest(
        np.vstack([pull, -rows @ N]),
        np.append(least, np.zeros(len(rows))),
        np.concatenate([least - own[cables], rows @ own - most]),
    )
    share = 1.0 - lost
    if not share > 0.0:
        y = shortest(0.0) if len(R) else edge
        return edge if y is None else y
    y = shortest(0.5 * share * (1.0 + share))
    return inner if y is None else y


def _edge(N: Array, own: Array) -> Array:
    """Shortest y (d,) with which no cable pushes, or the one with which they push least."""
    if not len(N):
        return np.zeros(N.shape[1])
    # Where not all cables can pull, the set has no inner points.
    y = _shortest(N, -own - 0.5 * numerics.BALANCE_TOLERANCE)
    if y is None:
        _, y = _smallest(N, np.ones(len(N)), -own)
    return y


def _smallest(G: Array, eased: Array, g: Array) -> tuple[float, Array]:
    """Smallest u from 0, and y (d,), with ``G y + u eased >= g``.

    This linear program is the limit of ``min u^2 + e^2 |y|^2`` for small e. Its vertices are
    exact for finite e already, unless u is about e^2.
    """
    d = G.shape[1]
    rows = np.vstack([np.column_stack([G / _EASE, eased]), np.append(np.zeros(d), 1.0)])
    found = _shortest(rows, np.append(g, 0.0))
    if found is None:
        return 0.0, np.zeros(d)
    return max(float(found[-1]), 0.0), found[:-1] / _EASE


def _shortest(N: Array, short: Array) -> Array | None:
    """Shortest y (d,) with ``N y >= short``; None if there is none.

    By non-negative least squares ([LawsonHanson]_, chapter 23).
    """
    from scipy.optimize import nnls

    u, _ = nnls(np.vstack([N.T, short]), np.append(np.zeros(N.shape[1]), 1.0))
    r = np.append(N.T @ u, short @ u - 1.0)
    if not -r[-1] > numerics.BALANCE_TOLERANCE:
        return None
    y = np.asarray(-r[:-1] / r[-1])
    # The same from the bounds that are reached, without the round-off of that quotient.
    reached = u > 0.0
    exact = np.linalg.lstsq(N[reached], short[reached], rcond=None)[0]
    is_nearer = (N @ exact - short).min() >= min((N @ y - short).min(), 0.0)
    y = exact if is_nearer else y
    return y if (N @ y - short).min() >= -numerics.BALANCE_TOLERANCE else None
