"""Eigenvalues from a matrix and its inverse, each from the more accurate one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core.numerics.criteria import LARGEST_BLOCK_CONDITION
from cartstiff.core.numerics.policy import (
    EPSILON,
    LOST_ERROR,
    TINY,
    ZERO_SHARE,
    Array,
    silent,
)


def eigenvalues(
    matrix: ArrayLike,
    inverse: ArrayLike | None = None,
    losses: tuple[float, float] = (1.0, 1.0),
    doubtful: bool = False,
) -> Array:
    r"""Eigenvalues of symmetric matrices with their signs, smallest first.

    A matrix M of doubles determines its eigenvalues to about ``EPSILON |M|``, its inverse
    C their inverses to ``EPSILON |C|``: the k largest (by size) are taken from M, the
    others from C, with the k that makes the largest error least. A well-conditioned
    matrix needs no inverse. Without an inverse, eigenvalues below `ZERO_SHARE` times the
    largest become exactly zero.

    Parameters
    ----------
    matrix : array_like, shape (..., n, n)
        Only the symmetric part counts.
    inverse : array_like, shape (..., n, n), optional
        Inverse of each matrix; NaN if there is none. If the matrix is NaN, the inverse
        alone is used.
    losses : tuple of float
        Relative errors of matrix and inverse, divided by `EPSILON`; more than 1 for
        differences.
    doubtful : bool
        Whether to return eigenvalues with an error above `LOST_ERROR`, too.

    Returns
    -------
    ndarray, shape (..., n)
        NaN if neither matrix is known, or if one of the values has an error above
        `LOST_ERROR`.
    """
    a = _of_symmetric(matrix)
    n = a.shape[-1]
    if inverse is None or n == 0:
        return _cleaned(a)
    result = _cleaned(a).reshape(-1, n)
    is_lossy = losses[0] != 1.0
    # Small eigenvalues that the matrix has lost are those of its inverse.
    todo = np.flatnonzero(is_lossy | ~(condition(result) < LARGEST_BLOCK_CONDITION))
    if not todo.size:
        return result.reshape(a.shape)
    others = np.broadcast_to(np.asarray(inverse, float), (*a.shape, n)).reshape(-1, n, n)[
        todo
    ]
    rows, c = a.reshape(-1, n)[todo], _of_symmetric(others)
    with silent():
        found = np.where(
            np.isnan(rows), np.sort(1.0 / _cleaned(c), axis=-1), result[todo]
        )
        c = 1.0 / c
    both = ~np.isnan(rows).any(axis=-1) & ~np.isnan(c).any(axis=-1)
    if both.any():
        found[both] = _merged(rows[both], c[both], losses, doubtful)
    result[todo] = found
    return result.reshape(a.shape)


def is_positive(matrix: Array) -> bool:
    """Whether the symmetric part of one matrix is plainly positive definite: it has a
    Cholesky factor, which takes a fourth of the time of eigenvalues.
    """
    try:
        np.linalg.cholesky(0.5 * (matrix + matrix.T))
    except np.linalg.LinAlgError:
        return False
    return True


def is_never_negative(matrix: Array) -> bool:
    """Whether one symmetric matrix has no negative one of its `eigenvalues`."""
    # The least eigenvalue is not above any entry of the diagonal, and none is larger than
    # the sum of all sizes: this takes a tenth of the time of a decomposition.
    lowest = min(matrix.diagonal().tolist())
    if lowest < 0.0 and -lowest > ZERO_SHARE * float(np.abs(matrix).sum()):
        return False
    if is_positive(matrix):
        return True
    least, *_, most = np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).tolist()
    return bool(least >= -ZERO_SHARE * max(-least, most))


def eigenpairs(
    matrix: Array, inverse: Array | None = None, losses: tuple[float, float] = (1.0, 1.0)
) -> tuple[Array, Array]:
    """`eigenvalues` (n,) of one symmetric matrix, and its eigenvectors in columns (n, n).

    NaN if one of the values has an error above `LOST_ERROR`.
    """
    a, u = np.linalg.eigh(0.5 * (matrix + matrix.T))
    if inverse is None:
        return _cleaned(a), u
    if losses[0] == 1.0 and hold_all_digits(a):
        return a, u
    b, v = np.linalg.eigh(0.5 * (inverse + inverse.T))
    with np.errstate(divide="ignore"):
        c = 1.0 / b
    i, j = (np.argsort(-np.abs(values), kind="stable") for values in (a, c))
    sizes = np.abs(a[i])[None], np.abs(c[j])[None]
    cut = _cut(*sizes, losses)
    if _errors(*sizes, cut, losses)[0] > LOST_ERROR:
        return np.full(len(a), np.nan), u
    i, j = i[: cut[0]], j[cut[0] :]
    # The vectors of two matrices are not exactly orthogonal: the first keep their
    # directions.
    q, r = np.linalg.qr(np.concatenate((u[:, i], v[:, j]), axis=1))
    vectors = np.where(r.diagonal() < 0.0, -q, q)
    values = np.concatenate((a[i], c[j]))
    order = np.argsort(values, kind="stable")
    return values[order], vectors[:, order]


def hold_all_digits(values: Array | list[float]) -> bool:
    """Whether a matrix with these eigenvalues (n,) alone determines all of them."""
    return condition_of(values) < LARGEST_BLOCK_CONDITION


def number_of_large(a: Array, c: Array) -> tuple[int, float]:
    """Number of eigenvalues to take from a matrix, and the largest relative error.

    Parameters
    ----------
    a, c : ndarray, shape (n,)
        Sizes of the eigenvalues, the largest first, from the matrix and from its inverse.
    """
    cut = _cut(a[None], c[None], (1.0, 1.0))
    return int(cut[0]), float(_errors(a[None], c[None], cut, (1.0, 1.0))[0])


def _of_symmetric(matrix: ArrayLike) -> Array:
    """Eigenvalues of the symmetric parts, NaN for matrices that are not finite."""
    half, finite = _symmetric_parts(matrix)
    values = np.asarray(np.linalg.eigvalsh(half), float)
    if not finite.all():
        values[~finite] = np.nan
    return values


def decomposed(matrix: ArrayLike) -> tuple[Array, Array]:
    """Eigenvalues (..., n), smallest first, and vectors in columns (..., n, n)
    of symmetric parts, NaN values for matrices that are not finite.
    """
    half, finite = _symmetric_parts(matrix)
    values, vectors = np.linalg.eigh(half)
    if not finite.all():
        values[~finite] = np.nan
    return values, vectors


def _symmetric_parts(matrix: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
    """Symmetric parts, zero for matrices that are not finite, and which these are not."""
    m = np.asarray(matrix, float)
    half = 0.5 * (m + m.swapaxes(-1, -2))
    finite = np.asarray(np.isfinite(half).all(axis=(-1, -2)))
    if not finite.all():
        half = np.where(finite[..., None, None], half, 0.0)
    return half, finite


def without_roundoff(values: Array, size: float | Array) -> Array:
    """Eigenvalues of a matrix whose terms have a size.

    Those that are its round-off are zero.
    """
    return np.where(np.abs(values) <= ZERO_SHARE * size, 0.0, values)


def _cleaned(values: Array) -> Array:
    """Eigenvalues with round-off of the largest set to zero."""
    return without_roundoff(
        values, np.abs(values).max(axis=-1, keepdims=True, initial=0.0)
    )


def _merged(a: Array, c: Array, losses: tuple[float, float], doubtful: bool) -> Array:
    """The large ones of a and the small ones of c, each (m, n), smallest first."""
    a = np.take_along_axis(a, np.argsort(-np.abs(a), axis=-1), -1)
    c = np.take_along_axis(c, np.argsort(-np.abs(c), axis=-1), -1)
    k = _cut(np.abs(a), np.abs(c), losses)
    merged = np.sort(np.where(np.arange(a.shape[-1]) < k[:, None], a, c), axis=-1)
    if doubtful or not a.shape[-1]:
        return merged
    # Inaccurate values may have any sign and any place in the order.
    merged[_errors(np.abs(a), np.abs(c), k, losses) > LOST_ERROR] = np.nan
    return merged


def _errors(
    a: Array, c: Array, k: NDArray[np.intp], losses: tuple[float, float]
) -> Array:
    """Largest relative error (m,) if k are taken from a, the others from c,
    both sizes (m, n).
    """
    rows = np.arange(len(a))
    with silent():
        of_a = losses[0] * a[:, 0] / a[rows, np.maximum(k, 1) - 1]
        of_c = losses[1] * c[rows, np.minimum(k, a.shape[1] - 1)] / c[:, -1]
    worst = np.fmax(np.where(k > 0, of_a, 1.0), np.where(k < a.shape[1], of_c, 1.0))
    return np.asarray(EPSILON * worst)


def _cut(sizes_a: Array, sizes_c: Array, losses: tuple[float, float]) -> NDArray[np.intp]:
    """Number (m,) of the largest values to take from a; both (m, n), largest first."""
    n = sizes_a.shape[-1]
    # Loss with the first k from a: in the least of those and in the largest of the rest.
    cost = np.ones((len(sizes_a), n + 1))
    with silent():
        cost[:, 1:] = losses[0] * sizes_a[:, :1] / sizes_a
        cost[:, :-1] = np.maximum(cost[:, :-1], losses[1] * sizes_c / sizes_c[:, -1:])
        # No cut between equal sizes: their order, and with it their signs, may differ in
        # a and c.
        equal = sizes_a[:, :-1] < (1.0 + 1e-6) * sizes_c[:, 1:]
    cost[:, 1:-1][equal & (cost[:, 1:-1] < np.minimum(cost[:, :1], cost[:, -1:]))] *= 1e3
    return np.argmin(np.where(np.isnan(cost), np.inf, cost), axis=-1)


def condition(values: ArrayLike) -> Array:
    """Largest over smallest absolute eigenvalue (N,) of each row (N, n).

    Infinite if one is zero, NaN if unknown.
    """
    size = np.abs(np.asarray(values, float))
    least = size.min(axis=1)
    with silent():
        return np.where(least == 0.0, np.inf, size.max(axis=1) / least)


def condition_of(values: Array | list[float]) -> float:
    """`condition` of eigenvalues (n,), for which NumPy takes ten times as long."""
    sizes = [*map(abs, values if isinstance(values, list) else values.tolist())]
    if (whole := sum(sizes)) != whole:
        return float("nan")
    least = min(sizes, default=0.0)
    return max(sizes) / least if least > 0.0 else float("inf")


def singular_values(matrix: Array) -> Array:
    """Singular values of matrices (..., m, n), the largest first."""
    return np.asarray(np.linalg.svd(matrix, compute_uv=False), float)


def ratios(matrices: Array) -> Array:
    """Smallest over largest singular value of each matrix of a stack;
    0 where all vanish.
    """
    values = singular_values(matrices)
    return np.asarray(values[..., -1] / np.maximum(values[..., 0], TINY))


def determinants(matrices: Array) -> Array:
    """Determinants of matrices (..., n, n), without NumPy's warning for singular ones."""
    with silent():
        return np.asarray(np.linalg.det(matrices))
