r"""The numeric policy: when a number counts as zero, a matrix as singular, a sum as balanced.

Every decision about rank, definiteness and invertibility is made here, with these rules:

* A rank is that of a *Jacobian*, on length-scaled rows and columns, at `RANK`. A stiffness goes
  with the inverse square of its singular values: a regular posture may have a stiffness matrix of
  condition ``RANK^-2 = 1e20``, and no rank is ever decided on it.
* A matrix of stiffnesses is *equilibrated* before it is inverted or judged: rows and columns are
  divided by sizes s so that the largest entries are about 1. Units cancel, and springs of 1e-3 and
  1e15 in one arm do not disturb each other.
* What counts as zero is judged against the forces and stiffnesses that act on that motion.
* Eigenvalues come from a matrix *and* its inverse: the large ones from the matrix, the small ones
  from the inverse, each where it has its digits.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "BALANCE",
    "EPSILON",
    "IDLE",
    "INVERTIBLE",
    "NEAR",
    "RANK",
    "ROUNDING",
    "SYMMETRY",
    "ZERO",
    "Inverse",
    "condition",
    "eigenvalues",
    "equilibration",
    "invert",
    "is_regular",
    "rank",
    "ratio",
]

Array = NDArray[np.float64]

#: Spacing of doubles at 1.
EPSILON: Final = float(np.finfo(float).eps)
#: Rank of a Jacobian is lost below this ratio of singular values: ten of sixteen digits are gone,
#: and the rounded constants of a URDF (twelve digits) must not make a singular posture regular.
RANK: Final = 1e-10
#: A singularity is called near below this ratio of singular values: stiffness, which goes with the
#: square, then differs by more than 400 between directions.
NEAR: Final = 0.05
#: An eigenvalue below this share of the largest cannot be told from the rounding of a matrix that
#: is the product of a few matrices of doubles.
ZERO: Final = 1e-13
#: A motion costs nothing if its stiffness is below this share of the terms whose sum it is.
IDLE: Final = 1e-11
#: An equilibrated matrix is singular above this condition number: all but two digits are gone.
INVERTIBLE: Final = 1e14
#: A motion is balanced if the force along it is below this share of the forces whose sum it is,
BALANCE: Final = 1e-8
#: or is what the springs that it moves exert over a rounding error of this size (rad, or shares of
#: the characteristic length) in the coordinates.
ROUNDING: Final = 1e-12
#: An asymmetry below this share of the block's size is taken for rounding.
SYMMETRY: Final = 1e-9

_TINY = 1e-300


def rank(values: ArrayLike) -> int:
    """How many of the singular values of a length-scaled Jacobian (descending) are not zero."""
    v = np.asarray(values, float)
    return int(np.count_nonzero(v > RANK * max(float(v.max(initial=0.0)), _TINY)))


def ratio(values: ArrayLike) -> float:
    """Smallest over largest of some singular values; 0 if there are none or all vanish."""
    v = np.asarray(values, float)
    largest = float(v.max(initial=0.0))
    return float(v.min()) / largest if largest > 0.0 else 0.0


def is_regular(values: ArrayLike) -> bool:
    """Whether none of the singular values of a length-scaled Jacobian counts as zero."""
    return ratio(values) > RANK


def equilibration(matrix: ArrayLike) -> Array:
    r"""Sizes s (n,) so that the largest entries of ``M[i, j] / (s_i s_j)`` are about 1.

    The sizes come from the diagonal; where entries beside it are larger, from these. A row of zeros
    has size 1.
    """
    size = np.abs(np.asarray(matrix, float))
    size = np.maximum(size, size.T)
    s: Array = np.sqrt(size.diagonal())
    if not s.all():
        s = np.where(s > 0.0, s, np.sqrt(size.max(axis=0, initial=0.0)))
        s = np.where(s > 0.0, s, 1.0)
    for _ in range(20):
        largest = (size / s / s[:, None]).max(axis=0, initial=0.0)
        # Ten: entries of one or two digits more than the diagonal cost no more digits than that.
        if not largest.max(initial=0.0) > 10.0:
            break
        s = s * np.where(largest > 0.0, np.sqrt(largest), 1.0)
    return s


class Inverse(NamedTuple):
    """An inverse matrix (n, n) and the relative error that is to be expected in it."""

    matrix: Array
    error: float


def invert(matrix: ArrayLike, sizes: ArrayLike | None = None) -> Inverse | None:
    """Inverse of a square matrix by way of the equilibrated one; None if that is singular.

    The inverse of a symmetric matrix is exactly symmetric.

    Parameters
    ----------
    matrix : array_like, shape (n, n)
        Finite.
    sizes : array_like, shape (n,), optional
        Sizes s by which rows and columns are divided; default `equilibration`.
    """
    m = np.asarray(matrix, float)
    s = equilibration(m) if sizes is None else np.asarray(sizes, float)
    scaled = m / s / s[:, None]
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        return None
    # The product of norms bounds the condition number; it is much cheaper than an SVD.
    bound = float(np.linalg.norm(scaled) * np.linalg.norm(inverse))
    if not bound < INVERTIBLE:
        return None
    if np.array_equal(m, m.T):
        inverse = 0.5 * (inverse + inverse.T)
    return Inverse(inverse / s / s[:, None], EPSILON * bound)


def eigenvalues(matrix: ArrayLike, inverse: ArrayLike | None = None) -> Array:
    r"""Eigenvalues of symmetric matrices with their signs, smallest first.

    A matrix M of doubles knows its eigenvalues to about ``EPSILON |M|``, its inverse C their
    inverses to ``EPSILON |C|``: the k largest (by size) are taken from M, the others from C, with k
    so that the worst of them has most digits. Without an inverse what is below `ZERO` times the
    largest is exactly zero.

    Parameters
    ----------
    matrix : array_like, shape (..., n, n)
        Only the symmetric part counts.
    inverse : array_like, shape (..., n, n), optional
        Of each matrix; NaN where there is none. Where the matrix is NaN the inverse alone is taken.

    Returns
    -------
    ndarray, shape (..., n)
        NaN where neither is known.
    """
    a = _of_symmetric(matrix)
    alone = _cleaned(a)
    if inverse is None:
        return alone
    b = _of_symmetric(inverse)
    with np.errstate(divide="ignore", invalid="ignore"):
        c = 1.0 / b
        result = np.where(np.isnan(a), np.sort(1.0 / _cleaned(b), axis=-1), alone)
    both = ~np.isnan(a).any(axis=-1) & ~np.isnan(c).any(axis=-1)
    if both.any():
        result[both] = _merged(a[both], c[both])
    return result


def _of_symmetric(matrix: ArrayLike) -> Array:
    """Eigenvalues of the symmetric parts, NaN for matrices that are not finite."""
    m = np.asarray(matrix, float)
    half = 0.5 * (m + m.swapaxes(-1, -2))
    finite = np.isfinite(half).all(axis=(-1, -2))
    if finite.all():
        return np.linalg.eigvalsh(half)
    found = np.full(m.shape[:-1], np.nan)
    if finite.any():
        found[finite] = np.linalg.eigvalsh(half[finite])
    return found


def _cleaned(values: Array) -> Array:
    """Eigenvalues with what is rounding of the largest set to zero."""
    size = np.abs(values)
    return np.where(size <= ZERO * size.max(axis=-1, keepdims=True, initial=0.0), 0.0, values)


def _merged(a: Array, c: Array) -> Array:
    """The large ones of a and the small ones of c, each (m, n), smallest first."""
    n = a.shape[-1]
    a = np.take_along_axis(a, np.argsort(-np.abs(a), axis=-1), -1)
    c = np.take_along_axis(c, np.argsort(-np.abs(c), axis=-1), -1)
    sizes_a, sizes_c = np.abs(a), np.abs(c)
    # Losses of digits if a gives the first k: in the least of those and in the largest of the rest.
    cost = np.ones((len(a), n + 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        cost[:, 1:] = sizes_a[:, :1] / sizes_a
        cost[:, :-1] = np.maximum(cost[:, :-1], sizes_c / sizes_c[:, -1:])
        # No cut between equal sizes: their order, and with it their signs, may differ in a and c.
        equal = sizes_a[:, :-1] < (1.0 + 1e-6) * sizes_c[:, 1:]
    cost[:, 1:-1][equal & (cost[:, 1:-1] < np.minimum(cost[:, :1], cost[:, -1:]))] *= 1e3
    k = np.argmin(cost, axis=-1)
    return np.sort(np.where(np.arange(n) < k[:, None], a, c), axis=-1)


def condition(values: ArrayLike) -> Array:
    """Largest over smallest absolute eigenvalue (...); infinite if one is zero, NaN if unknown."""
    size = np.abs(np.asarray(values, float))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = size.max(axis=-1) / size.min(axis=-1)
    return np.where(np.isnan(found) & ~np.isnan(size).any(axis=-1), np.inf, found)
