"""Inverses of stiffness matrices, each with its expected relative error."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core.numerics.policy import (
    EPSILON,
    LARGEST_INVERTIBLE_CONDITION,
    REPORTED_ERROR,
    Array,
    is_symmetric,
)

# Largest entry beside a unit diagonal: it costs no more than one or two digits.
_LARGEST_OFF_DIAGONAL = 10.0
# Squared condition number up to which a sum is inverted without equilibration.
_PLAIN_SQUARED_CONDITION = (1e-3 * REPORTED_ERROR / EPSILON) ** 2


def inverted(matrices: Array) -> Array:
    """Inverses of square matrices (..., n, n); NaN for one with a pivot of zero."""
    try:
        return np.asarray(np.linalg.inv(matrices), float)
    except np.linalg.LinAlgError:
        if matrices.ndim == 2:
            return np.full(matrices.shape, np.nan)
        return np.array([inverted(matrix) for matrix in matrices])


def equilibration(matrix: ArrayLike) -> Array:
    r"""Sizes s (..., n) so that the largest entries of ``M[i,
    j] / (s_i s_j)`` are about 1.

    The sizes come from the diagonal, or from larger entries beside it. A row of zeros has
    size 1.
    """
    size = np.abs(np.asarray(matrix, float))
    s: Array = np.sqrt(size.diagonal(0, -2, -1))
    if s.all() and (size <= _LARGEST_OFF_DIAGONAL * s[..., None] * s[..., None, :]).all():
        return s
    if not s.all():
        s = np.where(s > 0.0, s, np.sqrt(_largest(size)))
        s = np.where(s > 0.0, s, 1.0)
    for _ in range(20):
        largest = _largest(size / (s[..., None] * s[..., None, :]))
        uneven = (largest > _LARGEST_OFF_DIAGONAL).any(axis=-1, keepdims=True)
        if not uneven.any():
            break
        s = s * np.where(uneven & (largest > 0.0), np.sqrt(largest), 1.0)
    return s


def _largest(sizes: Array) -> Array:
    """Largest entry (..., n) in each row and the column of the same index."""
    return np.maximum(sizes.max(axis=-1, initial=0.0), sizes.max(axis=-2, initial=0.0))


class Inverse(NamedTuple):
    """An inverse matrix (n, n) and its expected relative error."""

    matrix: Array
    error: float


def invert(
    matrix: ArrayLike, sizes_of_motions: ArrayLike | None = None
) -> Inverse | None:
    """Inverse of a square matrix, from the equilibrated one; None if that is singular.

    The inverse of a symmetric matrix is exactly symmetric.

    Parameters
    ----------
    matrix : array_like, shape (n, n)
        Finite.
    sizes_of_motions : array_like, shape (n,), optional
        Sizes s by which rows and columns are divided; default `equilibration`.
    """
    m = np.asarray(matrix, float)
    (inverse,), (error,) = invert_each(m[None], sizes_of_motions)
    if not error < np.inf:
        return None
    return Inverse(
        0.5 * (inverse + inverse.T) if is_symmetric(m) else inverse, float(error)
    )


def invert_each(matrices: Array, sizes: ArrayLike | None = None) -> tuple[Array, Array]:
    """`invert` for each of a stack of square matrices; symmetric inverses to
    round-off only.

    Returns
    -------
    inverses : ndarray, shape (k, n, n)
        NaN where a matrix is singular.
    errors : ndarray, shape (k,)
        Expected relative errors; infinite where a matrix is singular.
    """
    s = equilibration(matrices) if sizes is None else np.asarray(sizes, float)
    both = s[..., None] * s[..., None, :]
    scaled = matrices / both
    inverses = inverted(scaled)
    # The product of norms bounds the condition number; it is much cheaper than an SVD.
    bound = np.sqrt(_squares(scaled) * _squares(inverses))
    known = bound < LARGEST_INVERTIBLE_CONDITION
    inverses[~known] = np.nan
    return inverses / both, np.where(known, EPSILON * bound, np.inf)


def _squares(matrices: Array) -> Array:
    """Sums (k,) of the squares of all entries."""
    return np.asarray(np.einsum("kij,kij->k", matrices, matrices))


def inverse_of_sum(inverse: Array, change: Array) -> Array | None:
    r"""``(M + D)^-1 = C (1 + D C)^-1`` from ``C = M^-1``, without M;
    None if there is none.
    """
    (one,), _ = inverses_of_sums(inverse[None], change[None])
    return None if np.isnan(one).any() else np.asarray(one)


def inverses_of_sums(inverses: Array, changes: Array) -> tuple[Array, NDArray[np.bool_]]:
    """`inverse_of_sum` of stacks (N, n, n), NaN where there is none.

    Where no digits are lost.
    """
    exists = np.isfinite(inverses + changes).all(axis=(1, 2))
    factors = np.eye(inverses.shape[2]) + changes @ inverses
    factors[~exists] = 0.0
    turned = inverted(factors)  # NaN where one is singular
    plain = _squares(factors) * _squares(turned) < _PLAIN_SQUARED_CONDITION
    if (lost := exists & ~plain).any():
        turned[lost] = invert_each(factors[lost])[0]
    return inverses @ turned, plain
