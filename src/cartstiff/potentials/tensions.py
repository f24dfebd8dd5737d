r"""Tensions of lines that balance a load: nearest to given ones, with every cable taut.

The tensions t of m lines balance a load w where ``A t = w``, with a column of A for each line. Of
more lines than motions many t do. The set that is chosen is

    min |t - t_0|^2    with    A t = w,    t_c >= kept(s) d_c for every cable c,

where t_0 are the given tensions and d_c > 0 the tension that a cable should keep. s is the largest
share, at most 1, of d that all cables can have at once without any tension above twice the largest
one of t_0 and of the set with kept = 0 (a linear program), and

    kept(s) = s (1 + s) / 2

is 1 if that is possible, and else below s. The set then has inner points, so that t is continuous
in the pose wherever tensions balance the load. Without the limit on tensions, d would be kept by
ever larger ones towards the poses where the cables no longer hold the body.
"""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array

#: Largest tension that keeps other cables taut, over the largest tension without that bound.
_LARGEST_INCREASE = 2.0


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


def kept_taut(
    matrix: Array, tensions: Array, cables: Array, least: Array, largest: float = 0.0
) -> Array | None:
    """Balanced tensions (m,) nearest to balanced ones in which all cables are taut.

    Parameters
    ----------
    matrix : ndarray (6, m)
        Wrenches of unit tensions.
    tensions : ndarray (m,)
        Those nearest to the given ones, without a bound.
    cables : ndarray of bool (m,)
        The lines that cannot push.
    least : ndarray
        Tension that each cable should keep.
    largest : float
        Largest given tension.

    Returns
    -------
    ndarray (m,) or None
        None if a cable would have to push.
    """
    own = tensions[cables]
    if (own >= least).all():
        return tensions
    size = max(float(np.abs(tensions).max()), float(least.max()))
    _, values, Vt = np.linalg.svd(matrix)
    N = Vt[numerics.rank(values) :].T  # changes that need no wrench
    own, found = tensions / size, tensions
    if N.shape[1]:
        found = size * (own + N @ _kept(N, own, cables, least / size, largest / size))
    if found[cables].min() < -numerics.BALANCE_TOLERANCE * size:
        return None
    if found.max() <= numerics.NEGLIGIBLE_FORCE * size:
        return np.zeros(len(found))  # no load, and no set of tensions balances itself
    return np.where(cables, np.maximum(found, 0.0), found)


def _kept(N: Array, own: Array, cables: Array, least: Array, largest: float) -> Array:
    """Shortest y (d,) with which ``own + N y`` keeps the cables taut, see the module."""
    edge = _edge(N[cables], own[cables])
    most = _LARGEST_INCREASE * max(largest, float((own + N @ edge).max()))
    y = _shortest(N[cables], least - own[cables])
    if y is not None and (own + N @ y).max() <= most:
        return y
    share, inner = _largest_share(N, own, cables, least, most)
    if not share > 0.0:
        return edge
    y = _shortest(N[cables], 0.5 * share * (1.0 + share) * least - own[cables])
    return inner if y is None else y


def _edge(N: Array, own: Array) -> Array:
    """Shortest y (d,) with which no cable pushes, or the one with which they push least."""
    from scipy.optimize import linprog

    # Where not all cables can pull, the set has no inner points.
    y = _shortest(N, -own - 0.5 * numerics.BALANCE_TOLERANCE)
    if y is not None:
        return y
    d = N.shape[1]
    goal, ones = np.append(np.zeros(d), -1.0), np.ones(len(N))
    bounds = [(None, None)] * d + [(None, 1.0)]
    found = linprog(goal, A_ub=np.column_stack([-N, ones]), b_ub=own, bounds=bounds)
    return np.zeros(d) if found.x is None else np.asarray(found.x[:-1])


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


def _largest_share(
    N: Array, own: Array, cables: Array, least: Array, most: float
) -> tuple[float, Array]:
    """Largest s up to 1 for which y (d,) has ``s least <= own + N y <= most``, and this y."""
    from scipy.optimize import linprog

    above = np.column_stack([-N[cables], least])
    below = np.column_stack([N, np.zeros(len(N))])
    found = linprog(
        np.append(np.zeros(N.shape[1]), -1.0),
        A_ub=np.vstack([above, below]),
        b_ub=np.concatenate([own[cables], most - own]),
        bounds=[(None, None)] * N.shape[1] + [(None, 1.0)],
    )
    if found.x is None:
        return 0.0, np.zeros(N.shape[1])
    return float(found.x[-1]), found.x[:-1]
