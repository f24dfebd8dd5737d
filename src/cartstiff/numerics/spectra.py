"""Eigenvalues from a matrix and its inverse, each where it has its digits."""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.numerics.criteria import PLAIN_BLOCK
from cartstiff.numerics.policy import EPSILON, LOST_ERROR, ZERO, Array
from cartstiff.numerics.small import right_angled, symmetric_values, symmetric_vectors

# Sums over the components of turning, and of moving.
_HALVES = np.repeat(np.eye(2), 3, axis=1)


def eigenvalues(
    matrix: ArrayLike,
    inverse: ArrayLike | None = None,
    losses: tuple[float, float] = (1.0, 1.0),
    doubtful: bool = False,
) -> Array:
    r"""Eigenvalues of symmetric matrices with their signs, smallest first.

    A matrix M of doubles knows its eigenvalues to about ``EPSILON |M|``, its inverse C their
    inverses to ``EPSILON |C|``: the k largest (by size) are taken from M, the others from C, with k
    so that the worst of them has most digits. One matrix that is well conditioned needs no inverse.
    Without an inverse what is below `ZERO` times the largest is exactly zero.

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
        Return what is known to less than `LOST_ERROR`, too.

    Returns
    -------
    ndarray, shape (..., n)
        NaN where neither is known, and where one of the values is known to less than `LOST_ERROR`.
    """
    a = _of_symmetric(matrix)
    if inverse is None:
        return _cleaned(a)
    if losses[0] == 1.0 and a.ndim == 1 and hold_all_digits(a):
        return a
    b = _of_symmetric(inverse)
    if a.ndim == 1 and a.size and not np.isnan(a).any() and not np.isnan(b).any():
        of_one = _parted(a, b, losses)
        if of_one.error > LOST_ERROR and not doubtful:
            return np.full(len(a), np.nan)
        return np.array(sorted(of_one.values))
    alone = _cleaned(a)
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
    a, u = symmetric_vectors(0.5 * (matrix + matrix.T))
    if inverse is None:
        return _cleaned(a), u
    if losses[0] == 1.0 and hold_all_digits(a):
        return a, u
    b, v = symmetric_vectors(0.5 * (inverse + inverse.T))
    parts = _parted(a, b, losses)
    if parts.error > LOST_ERROR:
        return np.full(len(a), np.nan), u
    # From two sources, so that they are at right angles only about.
    vectors = right_angled(np.concatenate((u[:, parts.of_a], v[:, parts.of_c]), axis=1))
    order = sorted(range(len(a)), key=parts.values.__getitem__)
    return np.array(parts.values)[order], vectors[:, order]


def hold_all_digits(values: Array) -> bool:
    """Whether a matrix with these eigenvalues (n,) alone has digits enough for all of them."""
    sizes = [abs(x) for x in values.tolist()]
    return max(sizes, default=0.0) < PLAIN_BLOCK * min(sizes, default=0.0)


class _Parts(NamedTuple):
    """Which eigenvalues of one matrix come from itself and which from its inverse.

    The values, those of the matrix first, their places in both, and the worst relative error.
    """

    values: list[float]
    of_a: list[int]
    of_c: list[int]
    error: float


def _parted(a: Array, b: Array, losses: tuple[float, float]) -> _Parts:
    """`_merged` for one matrix with the eigenvalues a and its inverse with b, each (n,)."""
    own = a.tolist()
    others = [1.0 / x if x else inf for x in b.tolist()]
    i, j = _by_size(own), _by_size(others)
    large, small = [abs(own[k]) for k in i], [abs(others[k]) for k in j]
    if not (large[-1] > 0.0 and small[-1] > 0.0 and max(large[0], small[0]) < inf):
        rows = np.array([large]), np.array([small])
        cut = _cut(*rows, losses)
        k, error = int(cut[0]), float(_errors(*rows, cut, losses)[0])
    else:
        k, error = _cut_of_one(large, small, losses)
    return _Parts([own[x] for x in i[:k]] + [others[x] for x in j[k:]], i[:k], j[k:], error)


def _by_size(values: list[float]) -> list[int]:
    """Places of the values, the largest first."""
    return sorted(range(len(values)), key=lambda k: -abs(values[k]))


def _cut_of_one(a: list[float], c: list[float], losses: tuple[float, float]) -> tuple[int, float]:
    """`_cut` and `_errors` of positive sizes: on so few numbers NumPy takes ten times as long."""
    of_a = [1.0, *(losses[0] * a[0] / x for x in a)]
    of_c = [*(losses[1] * x / c[-1] for x in c), 1.0]
    cost = list(map(max, of_a, of_c))
    ends = min(cost[0], cost[-1])
    for k in range(1, len(a)):
        if a[k - 1] < (1.0 + 1e-6) * c[k] and cost[k] < ends:
            cost[k] *= 1e3
    k = cost.index(min(cost))
    return k, EPSILON * max(of_a[k], of_c[k])


def number_of_large(a: Array, c: Array) -> tuple[int, float]:
    """How many eigenvalues to take from a matrix, and the relative error of the worst.

    Parameters
    ----------
    a, c : ndarray, shape (n,)
        Sizes of the eigenvalues, the largest first, by the matrix itself and by its inverse.
    """
    cut = _cut(a[None], c[None], (1.0, 1.0))
    return int(cut[0]), float(_errors(a[None], c[None], cut, (1.0, 1.0))[0])


def _of_symmetric(matrix: ArrayLike) -> Array:
    """Eigenvalues of the symmetric parts, NaN for matrices that are not finite."""
    m = np.asarray(matrix, float)
    half = 0.5 * (m + m.swapaxes(-1, -2))
    if m.ndim == 2 and np.isfinite(half).all():
        return symmetric_values(half)
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
    merged[_errors(np.abs(a), np.abs(c), k, losses) > LOST_ERROR] = np.nan
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


def pair_condition(stiffness: Array, compliance: Array) -> float:
    """`pair_conditions` of one matrix (6, 6): of so few numbers lists are several times as fast."""
    k, c = (
        (_HALVES @ (matrix * matrix) @ _HALVES.T).ravel().tolist()
        for matrix in (stiffness, compliance)
    )
    with np.errstate(over="ignore"):
        area = sqrt(k[0] / k[3]) if k[0] > 0.0 and k[3] > 0.0 else 1.0
        if not 0.0 < area < inf:
            return float(pair_conditions(stiffness[None], compliance[None])[0])
        size = k[0] / area / area + (k[1] + k[2]) / area + k[3]
        return sqrt(size) * sqrt(c[0] * area * area + (c[1] + c[2]) * area + c[3])


def _squared_blocks(stack: Array) -> tuple[Array, Array, Array]:
    """Squared sizes (N,) of the rotation, coupling and translation blocks of matrices."""
    squares = stack * stack
    turning, moving = squares[:, :3], squares[:, 3:]
    coupling = turning[:, :, 3:].sum(axis=(1, 2)) + moving[:, :, :3].sum(axis=(1, 2))
    return turning[:, :, :3].sum(axis=(1, 2)), coupling, moving[:, :, 3:].sum(axis=(1, 2))
