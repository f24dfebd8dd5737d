"""Eigenvalues from a matrix and its inverse, each where it has its digits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.numerics.policy import EPSILON, LOST, ZERO, Array


def eigenvalues(
    matrix: ArrayLike,
    inverse: ArrayLike | None = None,
    losses: tuple[float, float] = (1.0, 1.0),
    doubtful: bool = False,
) -> Array:
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
        Inverse of each matrix; NaN where there is none. Where the matrix is NaN the inverse alone
        is taken.
    losses : tuple of float
        Relative errors of matrix and inverse, each over `EPSILON`: what is a difference knows less.
    doubtful : bool
        Return what is known to less than `LOST`, too.

    Returns
    -------
    ndarray, shape (..., n)
        NaN where neither is known, and where one of the values is known to less than `LOST`.
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
        result[both] = _merged(a[both], c[both], losses, doubtful)
    return result


def eigenpairs(
    matrix: Array, inverse: Array | None = None, losses: tuple[float, float] = (1.0, 1.0)
) -> tuple[Array, Array]:
    """`eigenvalues` (n,) of one symmetric matrix, and its eigenvectors in columns (n, n).

    NaN where these lose what `eigenvalues` needs.
    """
    a, u = np.linalg.eigh(0.5 * (matrix + matrix.T))
    if inverse is None:
        return _cleaned(a), u
    b, v = np.linalg.eigh(0.5 * (inverse + inverse.T))
    with np.errstate(divide="ignore"):
        c = 1.0 / b
    i, j = np.argsort(-np.abs(a)), np.argsort(-np.abs(c))
    k = int(_cut(np.abs(a[i])[None], np.abs(c[j])[None], losses)[0])
    values, vectors = np.append(a[i[:k]], c[j[k:]]), np.hstack([u[:, i[:k]], v[:, j[k:]]])
    order = np.argsort(values)
    if _errors(np.abs(a[i])[None], np.abs(c[j])[None], np.array([k]), losses)[0] > LOST:
        return np.full(len(a), np.nan), u
    # From two sources, so that they are at right angles only about.
    q, r = np.linalg.qr(vectors)
    return values[order], (q * np.where(r.diagonal() < 0.0, -1.0, 1.0))[:, order]


def _of_symmetric(matrix: ArrayLike) -> Array:
    """Eigenvalues of the symmetric parts, NaN for matrices that are not finite."""
    m = np.asarray(matrix, float)
    half = 0.5 * (m + m.swapaxes(-1, -2))
    finite = np.isfinite(half).all(axis=(-1, -2))
    if finite.all():
        return np.linalg.eigvalsh(half)
    values = np.full(m.shape[:-1], np.nan)
    if finite.any():
        values[finite] = np.linalg.eigvalsh(half[finite])
    return values


def _cleaned(values: Array) -> Array:
    """Eigenvalues with what is rounding of the largest set to zero."""
    size = np.abs(values)
    return np.where(size <= ZERO * size.max(axis=-1, keepdims=True, initial=0.0), 0.0, values)


def _merged(a: Array, c: Array, losses: tuple[float, float], doubtful: bool) -> Array:
    """The large ones of a and the small ones of c, each (m, n), smallest first."""
    a = np.take_along_axis(a, np.argsort(-np.abs(a), axis=-1), -1)
    c = np.take_along_axis(c, np.argsort(-np.abs(c), axis=-1), -1)
    k = _cut(np.abs(a), np.abs(c), losses)
    merged = np.sort(np.where(np.arange(a.shape[-1]) < k[:, None], a, c), axis=-1)
    if doubtful or not a.shape[-1]:
        return merged
    # What neither knows may have any sign, and stand anywhere among the others.
    merged[_errors(np.abs(a), np.abs(c), k, losses) > LOST] = np.nan
    return merged


def _errors(a: Array, c: Array, k: NDArray[np.intp], losses: tuple[float, float]) -> Array:
    """Relative error (m,) of the worst where k are taken from a, the others from c: sizes."""
    rows = np.arange(len(a))
    with np.errstate(divide="ignore", invalid="ignore"):
        of_a = losses[0] * a[:, 0] / a[rows, np.maximum(k, 1) - 1]
        of_c = losses[1] * c[rows, np.minimum(k, a.shape[1] - 1)] / c[:, -1]
    worst = np.fmax(np.where(k > 0, of_a, 1.0), np.where(k < a.shape[1], of_c, 1.0))
    return np.asarray(EPSILON * worst)


def _cut(sizes_a: Array, sizes_c: Array, losses: tuple[float, float]) -> NDArray[np.intp]:
    """How many of the largest are taken from a (m,); both (m, n), largest first."""
    n = sizes_a.shape[-1]
    # Losses of digits if a gives the first k: in the least of those and in the largest of the rest.
    cost = np.ones((len(sizes_a), n + 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        cost[:, 1:] = losses[0] * sizes_a[:, :1] / sizes_a
        cost[:, :-1] = np.maximum(cost[:, :-1], losses[1] * sizes_c / sizes_c[:, -1:])
        # No cut between equal sizes: their order, and with it their signs, may differ in a and c.
        equal = sizes_a[:, :-1] < (1.0 + 1e-6) * sizes_c[:, 1:]
    cost[:, 1:-1][equal & (cost[:, 1:-1] < np.minimum(cost[:, :1], cost[:, -1:]))] *= 1e3
    return np.argmin(np.where(np.isnan(cost), np.inf, cost), axis=-1)


def condition(values: ArrayLike) -> Array:
    """Largest over smallest absolute eigenvalue (...); infinite if one is zero, NaN if unknown."""
    size = np.abs(np.asarray(values, float))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = size.max(axis=-1) / size.min(axis=-1)
    return np.where(np.isnan(ratio) & ~np.isnan(size).any(axis=-1), np.inf, ratio)


def pair_conditions(stiffness: Array, compliance: Array) -> Array:
    """Bounds (N,) on condition numbers of matrices (N, 6, 6) with given inverses.

    Lengths are measured so that both diagonal blocks of the stiffness are of one size. NaN where
    one of the two does not exist.
    """
    k, c = (_squared_blocks(stack) for stack in (stiffness, compliance))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        area = np.sqrt(np.where((k[0] > 0.0) & (k[2] > 0.0), k[0] / k[2], 1.0))
        size = k[0] / area / area + k[1] / area + k[2]
        return np.sqrt(size) * np.sqrt(c[0] * area * area + c[1] * area + c[2])


def _squared_blocks(stack: Array) -> tuple[Array, Array, Array]:
    """Squared sizes (N,) of the rotation, coupling and translation blocks of matrices."""
    squares = stack * stack
    turning, moving = squares[:, :3], squares[:, 3:]
    coupling = turning[:, :, 3:].sum(axis=(1, 2)) + moving[:, :, :3].sum(axis=(1, 2))
    return turning[:, :, :3].sum(axis=(1, 2)), coupling, moving[:, :, 3:].sum(axis=(1, 2))
