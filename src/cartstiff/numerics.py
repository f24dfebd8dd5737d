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

from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "BALANCE",
    "EPSILON",
    "IDLE",
    "INVERTIBLE",
    "LOST",
    "NEAR",
    "PAIRED",
    "RANK",
    "REPEATED",
    "ROUNDING",
    "SYMMETRY",
    "TELLING",
    "ZERO",
    "Inverse",
    "condition",
    "eigenpairs",
    "eigenvalues",
    "equilibration",
    "error_of_inverting",
    "first_independent",
    "graded_basis",
    "inverse_of_sum",
    "inverses_of_sums",
    "invert",
    "invert_each",
    "is_about_symmetric",
    "is_regular",
    "is_symmetric",
    "pair_conditions",
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
#: A relative error above this is told to the reader: it is more than a few digits.
TELLING: Final = 1e-9
#: Squares of frequencies nearer to each other than this share are those of one subspace: within it
#: any motion has the same frequency to six digits, and single directions are chance.
REPEATED: Final = 1e-6
#: A number with a relative error above this is none: four digits are the fewest that tell.
LOST: Final = 1e-4
#: Up to this condition number a stiffness and its inverse together hold all principal values: the
#: worst stand in the middle and lose its root, 3e5 of 4e15.
PAIRED: Final = 1e11
#: An asymmetry below this share of the block's size is taken for rounding.
SYMMETRY: Final = 1e-9

_TINY = 1e-300
# Entries that are one or two digits larger than the diagonal cost no more digits than that.
_EVEN = 10.0


def rank(values: ArrayLike) -> int:
    """How many of the singular values of a length-scaled Jacobian (descending) are not zero."""
    v = np.asarray(values, float).tolist()
    least = RANK * max(max(v, default=0.0), _TINY)
    return sum(x > least for x in v)


def ratio(values: ArrayLike) -> float:
    """Smallest over largest of some singular values; 0 if there are none or all vanish."""
    v = np.asarray(values, float).tolist()
    largest = max(v, default=0.0)
    return min(v) / largest if largest > 0.0 else 0.0


def is_regular(values: ArrayLike) -> bool:
    """Whether none of the singular values of a length-scaled Jacobian counts as zero."""
    return ratio(values) > RANK


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


def graded_basis(
    motions: Array, stiffness: Array, across: Array | None = None
) -> tuple[Array, NDArray[np.intp]]:
    r"""Basis of given motions in which springs of any stiffness do not disturb each other.

    Each motion moves one of the stiffest coordinates that determine them by 1 and the others of
    these not at all; softer coordinates follow. A stiffness on such motions is graded like its
    diagonal: a stiff spring stands in its own row and column only. What is stiffer than the
    coordinate that leads and moves less than `RANK` with it does not move.

    Parameters
    ----------
    motions : ndarray, shape (n, f)
        Independent columns.
    stiffness : ndarray, shape (n,)
        Stiffness of each coordinate, not negative.
    across : ndarray, shape (n, n - f), optional
        Independent columns at right angles to the motions: with them the work goes with the lesser
        of f and n - f.

    Returns
    -------
    basis : ndarray, shape (n, f)
    leading : ndarray of int, shape (f,)
        The coordinates that lead; ``basis[leading]`` is the identity.
    """
    n, f = motions.shape
    if f == 0:
        return motions, np.empty(0, np.intp)
    # What has no spring leads last; among itself it needs an order too.
    known = stiffness.tolist()
    softest = min((k for k in known if k > 0.0), default=1e300)
    weights = np.sqrt([k if k > 0.0 else 1e-4 * softest for k in known])
    if across is None or f <= n - f:
        leading = first_independent(motions.T * weights)
    else:
        leading = np.delete(np.arange(n), first_independent(across.T / weights))
    basis = motions @ np.linalg.inv(motions[leading])
    size = np.abs(basis)
    basis[(size <= RANK * size.max(axis=0)) & (stiffness[:, None] > stiffness[leading])] = 0.0
    basis[leading] = np.eye(f)
    return basis, leading


def first_independent(columns: Array) -> NDArray[np.intp]:
    """Indices (m,) of independent columns of a matrix (m, n) of rank m, the largest first."""
    m = len(columns)
    found = np.empty(m, np.intp)
    size = np.einsum("ij,ij->j", columns, columns)
    least = RANK**2 * size
    for i in range(m):
        found[i] = at = int(size.argmax())
        direction = columns[:, at]
        direction = direction / sqrt(direction.dot(direction))
        columns = columns - direction[:, None] * direction.dot(columns)
        size = np.einsum("ij,ij->j", columns, columns)
        size[size <= least] = 0.0
        size[found[: i + 1]] = -1.0
    return found


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
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        return None
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
    try:
        inverses = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        return _inverted_one_by_one(matrices)
    flat = inverses.reshape(len(s), -1)
    errors = (EPSILON * np.sqrt(squares * np.vecdot(flat, flat))).tolist()
    if not max(errors) < EPSILON * INVERTIBLE:
        return _inverted_one_by_one(matrices)
    return inverses / sizes, errors


def error_of_inverting(matrix: Array, inverse: Array) -> float:
    """The error that `invert` would give, by way of a known inverse.

    NaN where it may be told (`TELLING`), or where the diagonal alone may not give the sizes.
    """
    s = np.sqrt(np.abs(matrix.diagonal()))
    if not all(s.tolist()):
        return float("nan")
    sizes = s[:, None] * s
    scaled, other = matrix / sizes, inverse * sizes
    squares = float(np.vdot(scaled, scaled))
    error = EPSILON * float(squares * np.vdot(other, other)) ** 0.5
    return error if squares <= _EVEN**2 and error < 0.5 * TELLING else float("nan")


def _inverted_one_by_one(matrices: Array) -> tuple[Array, list[float]]:
    nothing = Inverse(np.full(matrices.shape[1:], np.nan), np.inf)
    found = [invert(m) or nothing for m in matrices]
    return np.array([C for C, _ in found]), [error for _, error in found]


def is_symmetric(matrix: Array) -> bool:
    """Whether a square matrix is its own transpose, to the last digit."""
    return bool((matrix == matrix.T).all())


def is_about_symmetric(matrix: Array) -> NDArray[np.bool_]:
    """Whether all of the asymmetry of square matrices (..., n, n) may be rounding; (...)."""
    s = np.sqrt(np.abs(np.diagonal(matrix, 0, -2, -1)))
    skew = np.abs(matrix - matrix.swapaxes(-1, -2))
    found: NDArray[np.bool_] = np.all(
        skew <= SYMMETRY * s[..., :, None] * s[..., None, :], axis=(-2, -1)
    )
    return found


def inverse_of_sum(inverse: Array, change: Array) -> Array | None:
    r"""``(M + D)^-1 = C (1 + D C)^-1`` from ``C = M^-1``, without M; None if there is none."""
    factor = invert(np.eye(len(inverse)) + change @ inverse)
    return None if factor is None else np.asarray(inverse @ factor.matrix)


def inverses_of_sums(inverses: Array, changes: Array) -> tuple[Array, NDArray[np.bool_]]:
    """`inverse_of_sum` of stacks (N, n, n), NaN where there is none; and which lose no digits."""
    found: Array = np.full_like(inverses, np.nan)
    plain = np.zeros(len(found), bool)
    exists = np.flatnonzero(np.isfinite(inverses + changes).all(axis=(1, 2)))
    factors = np.eye(inverses.shape[2]) + changes[exists] @ inverses[exists]
    try:
        turned = np.linalg.inv(factors)
    except np.linalg.LinAlgError:
        turned = np.full(factors.shape, np.inf)
    bounds = np.einsum("nij,nij->n", factors, factors) * np.einsum("nij,nij->n", turned, turned)
    plain[exists] = bounds < (1e-3 * TELLING / EPSILON) ** 2
    found[plain] = inverses[plain] @ turned[plain[exists]]
    for i in exists[~plain[exists]]:
        if (one := inverse_of_sum(inverses[i], changes[i])) is not None:
            found[i] = one
    return found, plain


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
        Of each matrix; NaN where there is none. Where the matrix is NaN the inverse alone is taken.
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


def _merged(a: Array, c: Array, losses: tuple[float, float], doubtful: bool) -> Array:
    """The large ones of a and the small ones of c, each (m, n), smallest first."""
    a = np.take_along_axis(a, np.argsort(-np.abs(a), axis=-1), -1)
    c = np.take_along_axis(c, np.argsort(-np.abs(c), axis=-1), -1)
    k = _cut(np.abs(a), np.abs(c), losses)
    found = np.sort(np.where(np.arange(a.shape[-1]) < k[:, None], a, c), axis=-1)
    if doubtful or not a.shape[-1]:
        return found
    # What neither knows may have any sign, and stand anywhere among the others.
    found[_errors(np.abs(a), np.abs(c), k, losses) > LOST] = np.nan
    return found


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


def condition(values: ArrayLike) -> Array:
    """Largest over smallest absolute eigenvalue (...); infinite if one is zero, NaN if unknown."""
    size = np.abs(np.asarray(values, float))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = size.max(axis=-1) / size.min(axis=-1)
    return np.where(np.isnan(found) & ~np.isnan(size).any(axis=-1), np.inf, found)
