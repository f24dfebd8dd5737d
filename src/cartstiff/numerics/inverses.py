"""Inverses of matrices of stiffnesses, each with the error that is to be expected in it."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.numerics.policy import (
    EPSILON,
    INVERTIBLE,
    REPORTED_ERROR,
    WELL_CONDITIONED,
    Array,
    is_symmetric,
)
from cartstiff.numerics.small import inverted

# Entries that are one or two digits larger than the diagonal cost no more digits than that.
_EVEN = 10.0
# Square of the condition up to which a sum is inverted as it is.
_NO_LOSS = (1e-3 * REPORTED_ERROR / EPSILON) ** 2


def equilibration(matrix: ArrayLike) -> Array:
    r"""Sizes s (n,) so that the largest entries of ``M[i, j] / (s_i s_j)`` are about 1.

    The sizes come from the diagonal; where entries beside it are larger, from these. A row of zeros
    has size 1.
    """
    size = np.abs(np.asarray(matrix, float))
    s: Array = np.sqrt(size.diagonal())
    if not s.all():
        s = np.where(s > 0.0, s, np.sqrt(np.maximum(size, size.T).max(axis=0, initial=0.0)))
        s = np.where(s > 0.0, s, 1.0)
    for _ in range(20):
        scaled = size / np.multiply.outer(s, s)
        if not scaled.max(initial=0.0) > _EVEN:
            break
        largest = np.maximum(scaled.max(axis=0), scaled.max(axis=1))
        s = s * np.where(largest > 0.0, np.sqrt(largest), 1.0)
    return s


class Inverse(NamedTuple):
    """An inverse matrix (n, n) and the relative error that is to be expected in it."""

    matrix: Array
    error: float


def invert(matrix: ArrayLike, sizes_of_motions: ArrayLike | None = None) -> Inverse | None:
    """Inverse of a square matrix by way of the equilibrated one; None if that is singular.

    The inverse of a symmetric matrix is exactly symmetric.

    Parameters
    ----------
    matrix : array_like, shape (n, n)
        Finite.
    sizes_of_motions : array_like, shape (n,), optional
        Sizes s by which rows and columns are divided; default `equilibration`.
    """
    m = np.asarray(matrix, float)
    s = equilibration(m) if sizes_of_motions is None else np.asarray(sizes_of_motions, float)
    sizes = np.multiply.outer(s, s)
    scaled = m / sizes
    inverse = inverted(scaled)
    # The product of norms bounds the condition number; it is much cheaper than an SVD.
    bound = float(np.vdot(scaled, scaled) * np.vdot(inverse, inverse)) ** 0.5
    if not bound < INVERTIBLE:
        return None
    if is_symmetric(m):
        inverse = 0.5 * (inverse + inverse.T)
    return Inverse(inverse / sizes, EPSILON * bound)


def invert_each(matrices: Array) -> tuple[Array, list[float]]:
    """`invert` for each of a stack of square matrices, at little more than the cost of one.

    Of a symmetric matrix the inverse is symmetric to rounding only.

    Returns
    -------
    inverses : ndarray, shape (k, n, n)
        NaN where a matrix is singular.
    errors : list of k floats
        Relative errors to be expected; infinite where a matrix is singular.
    """
    # Of the few numbers looked at here lists are several times as fast as NumPy.
    s = np.sqrt(np.abs(matrices.diagonal(0, 1, 2)))
    if not all(s.ravel().tolist()):
        return _inverted_one_by_one(matrices)
    sizes = s[:, :, None] * s[:, None, :]
    scaled = matrices / sizes
    flat = scaled.reshape(len(s), -1)
    squares = np.vecdot(flat, flat)
    # Else the diagonal alone may not give the sizes.
    if not (max(squares.tolist()) <= _EVEN**2 or np.abs(flat).max(initial=0.0) <= _EVEN):
        return _inverted_one_by_one(matrices)
    inverses = inverted(scaled)
    flat = inverses.reshape(len(s), -1)
    errors = (EPSILON * np.sqrt(squares * np.vecdot(flat, flat))).tolist()
    if not all(error < EPSILON * INVERTIBLE for error in errors):
        return _inverted_one_by_one(matrices)
    return inverses / sizes, errors


def plain_inverses(matrices: Array) -> tuple[Array, list[float]] | None:
    """Inverses of a stack (k, n, n) and their errors, infinite where one is not well conditioned.

    All are measured by the diagonal of the first: what is lost by adding to it shows, too. None if
    that diagonal is not positive.
    """
    diagonal = matrices[0].diagonal()
    if not min(diagonal.tolist()) > 0.0:
        return None
    s = np.sqrt(diagonal)
    sizes = s[:, None] * s
    both = np.empty((2, *matrices.shape))
    np.divide(matrices, sizes, out=both[0])
    both[1] = inverted(both[0])
    flat = both.reshape(2, len(matrices), -1)
    squares = np.vecdot(flat, flat).tolist()  # of norms
    # Those of the inverses alone bound what is lost by adding.
    return both[1] / sizes, [
        EPSILON * sqrt(a * b)
        if a * b < WELL_CONDITIONED**2 and b < WELL_CONDITIONED**2
        else float("inf")
        for a, b in zip(*squares, strict=True)
    ]


def error_of_inverting(matrix: Array, inverse: Array) -> float:
    """The error that `invert` would give, by way of a known inverse.

    NaN where it may be told (`REPORTED_ERROR`), or where the diagonal alone may not give the sizes.
    """
    s = np.sqrt(np.abs(matrix.diagonal()))
    if not all(s.tolist()):
        return float("nan")
    sizes = s[:, None] * s
    scaled, other = matrix / sizes, inverse * sizes
    squares = float(np.vdot(scaled, scaled))
    error = EPSILON * float(squares * np.vdot(other, other)) ** 0.5
    return error if squares <= _EVEN**2 and error < 0.5 * REPORTED_ERROR else float("nan")


def _inverted_one_by_one(matrices: Array) -> tuple[Array, list[float]]:
    nothing = Inverse(np.full(matrices.shape[1:], np.nan), np.inf)
    results = [invert(m) or nothing for m in matrices]
    return np.array([C for C, _ in results]), [error for _, error in results]


def inverse_of_sum(inverse: Array, change: Array) -> Array | None:
    r"""``(M + D)^-1 = C (1 + D C)^-1`` from ``C = M^-1``, without M; None if there is none."""
    if not change.any():
        return inverse
    if (plain := plain_inverse_of_sum(inverse, change)) is not None:
        return plain
    factor = invert(np.eye(len(inverse)) + change @ inverse)
    return None if factor is None else np.asarray(inverse @ factor.matrix)


def plain_inverse_of_sum(inverse: Array, change: Array) -> Array | None:
    """`inverse_of_sum` where no digits are lost, else None."""
    factor = np.eye(len(inverse)) + change.dot(inverse)
    turned = inverted(factor)
    bound = np.vdot(factor, factor) * np.vdot(turned, turned)
    return np.asarray(inverse.dot(turned)) if bound < _NO_LOSS else None


def inverses_of_sums(inverses: Array, changes: Array) -> tuple[Array, NDArray[np.bool_]]:
    """`inverse_of_sum` of stacks (N, n, n), NaN where there is none; and which lose no digits."""
    better: Array = np.full_like(inverses, np.nan)
    plain = np.zeros(len(better), bool)
    exists = np.flatnonzero(np.isfinite(inverses + changes).all(axis=(1, 2)))
    factors = np.eye(inverses.shape[2]) + changes[exists] @ inverses[exists]
    turned = inverted(factors)  # NaN where one is singular
    entries = inverses.shape[1] * inverses.shape[2]
    flat, inverse = (stack.reshape(len(exists), entries) for stack in (factors, turned))
    bounds = np.vecdot(flat, flat) * np.vecdot(inverse, inverse)
    plain[exists] = bounds < _NO_LOSS
    better[plain] = inverses[plain] @ turned[plain[exists]]
    for i in exists[~plain[exists]]:
        if (one := inverse_of_sum(inverses[i], changes[i])) is not None:
            better[i] = one
    return better, plain
