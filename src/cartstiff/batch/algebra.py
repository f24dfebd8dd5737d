r"""Linear algebra on small arrays of recording numbers (object arrays, or floats).

Elimination would need pivots chosen posture by posture. Householder reflections need none, lose no
digits whatever the order of rows and columns, and do not care how the columns are scaled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cartstiff.batch.tape import Scalar, absolute, copysign, larger, square_root
from cartstiff.geometry.se3 import Array

__all__ = ["Reflections", "congruence", "cross", "inverse", "norm_squared", "positive_factor",
           "reflections", "skew", "upper_inverse", "zeros"]  # fmt: skip


def zeros(*shape: int) -> Array:
    """Array of zeros that can hold numbers of a tape."""
    return np.full(shape, 0.0, object)


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors."""
    found = np.empty(3, object)
    found[:] = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    return found


def skew(a: Array) -> Array:
    """Cross-product matrix."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]], object)


def norm_squared(a: Array) -> Scalar:
    """Sum of the squares of all entries."""
    flat = np.ravel(a)
    return flat @ flat


def congruence(left: Array, middle: Array) -> Array:
    """``left^T middle left`` for a symmetric middle; one triangle is computed and mirrored."""
    half = middle @ left
    n = left.shape[1]
    found = zeros(n, n)
    for i in range(n):
        for j in range(i, n):
            found[i, j] = found[j, i] = left[:, i] @ half[:, j]
    return found


class Reflections(NamedTuple):
    """M = Q R: vectors v and factors b of the reflections I - b v v^T, first to last, and R."""

    vectors: list[Array]
    factors: list[Any]
    R: Array

    def apply(self, columns: Array) -> Array:
        """``Q columns``."""
        return self._through(columns, range(len(self.vectors) - 1, -1, -1))

    def apply_transposed(self, columns: Array) -> Array:
        """``Q^T columns``."""
        return self._through(columns, range(len(self.vectors)))

    def _through(self, columns: Array, order: range) -> Array:
        found = columns.astype(object)
        for k in order:
            v = self.vectors[k]
            found[k:] = found[k:] - _times(v, (v @ found[k:]) * self.factors[k])
        return found

    def conjugate(self, symmetric: Array) -> Array:
        """``Q^T symmetric Q``, by updates of rank two."""
        n = len(symmetric)
        found = symmetric.astype(object)
        for k, (v, factor) in enumerate(zip(self.vectors, self.factors, strict=True)):
            p = (found[:, k:] @ v) * factor
            p[k:] = p[k:] - v * ((v @ p[k:]) * factor * 0.5)
            for i in range(n):
                for j in range(max(i, k), n):
                    change = p[i] * v[j - k]
                    if i >= k:
                        change = change + v[i - k] * p[j]
                    found[i, j] = found[j, i] = found[i, j] - change
        return found


def _times(v: Array, row: Array) -> Array:
    return v * row if np.ndim(row) == 0 else np.outer(v, row)


def reflections(matrix: Array) -> Reflections:
    """Householder decomposition of a matrix (n, m), n not less than m."""
    work = matrix.astype(object)
    n, m = work.shape
    vectors, factors = [], []
    for k in range(min(m, n - 1)):
        x = work[k:, k].copy()
        size = copysign(square_root(norm_squared(x)), x[0])
        x[0] = x[0] + size
        factor = 1.0 / (size * x[0])
        work[k, k] = -size
        work[k + 1 :, k] = 0.0
        if k + 1 < m:
            row = (x @ work[k:, k + 1 :]) * factor
            work[k:, k + 1 :] = work[k:, k + 1 :] - np.outer(x, row)
        vectors.append(x)
        factors.append(factor)
    return Reflections(vectors, factors, work[:m])


def upper_inverse(R: Array) -> Array:
    """Inverse of an upper triangular matrix."""
    n = len(R)
    found = zeros(n, n)
    for j in range(n):
        found[j, j] = 1.0 / R[j, j]
    for j in range(n):
        for i in range(j - 1, -1, -1):
            found[i, j] = -((R[i, i + 1 : j + 1] @ found[i + 1 : j + 1, j]) * found[i, i])
    return found


def inverse(matrix: Array) -> Array:
    """Inverse of any matrix."""
    found = reflections(matrix)
    # M^T = (Q R)^T has the inverse Q R^-T.
    return found.apply(upper_inverse(found.R).T).T


def positive_factor(matrix: Array) -> tuple[Array, Array, Scalar]:
    """L (unit lower), 1 / d and the least d of ``matrix = L diag(d) L^T``, symmetric."""
    n = len(matrix)
    L, inverses, pivots = zeros(n, n), zeros(n), zeros(n)
    for j in range(n):
        scaled = L[j, :j] * pivots[:j]
        pivots[j] = matrix[j, j] - (scaled @ L[j, :j] if j else 0.0)
        inverses[j] = 1.0 / pivots[j]
        L[j, j] = 1.0
        for i in range(j + 1, n):
            rest = matrix[i, j] - (L[i, :j] @ scaled if j else 0.0)
            L[i, j] = rest * inverses[j]
    least = pivots[0]
    for pivot in pivots[1:]:
        least = -larger(-least, -pivot)
    return L, inverses, least


def largest(values: Array) -> Scalar:
    """Largest absolute value."""
    flat = np.ravel(values)
    found = absolute(flat[0])
    for value in flat[1:]:
        found = larger(found, absolute(value))
    return found
