r"""Eigenvalues of symmetric matrices by a fixed number of steps.

All of them by Jacobi's rotations: a sweep turns every pair of rows once, and what is left beside
the diagonal shrinks with its square at last. The largest alone, for a quarter of the work, by
Laguerre's iteration on the characteristic polynomial of a tridiagonal matrix, from a bound
downwards: it converges with the third power. Nothing bounds the number of steps of either: what is
left after them is a verdict.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import is_zero, norm_squared
from cartstiff.many.arithmetic import ENGINE, PLAIN, limited
from cartstiff.many.tape import Scalar, absolute, copysign, larger, pick, square_root

#: Rows up to which all eigenvalues are found; of more the operations would be too many.
LARGEST = 8
#: Sweeps after which nearly every matrix of a size is diagonal.
_SWEEPS = {1: 0, 2: 1, 3: 4, 4: 5, 5: 6, 6: 6, 7: 7, 8: 7}
#: Steps of Laguerre's iteration after which it stands still nearly always.
_STEPS = 6


def _rounds(n: int) -> tuple[tuple[int, int], ...]:
    """Pairs of n rows, in an order in which neighbours have no row in common: none waits.

    Those of a tournament in which every row meets every other once.
    """
    seats: list[int] = [*range(n), *[n] * (n % 2)]  # with one too few, somebody rests
    pairs = list[tuple[int, int]]()
    for _ in range(len(seats) - 1):
        met = zip(seats[: len(seats) // 2], reversed(seats), strict=False)
        pairs += [(min(pair), max(pair)) for pair in met if n not in pair]
        seats = [seats[0], seats[-1], *seats[1:-1]]
    return tuple(pairs)


_PAIRS = {n: _rounds(n) for n in _SWEEPS}
#: What may be left beside the diagonal, as a share of the whole matrix: rounding.
_LEFT = 4.0 * numerics.EPSILON
#: The last step that may be left to do, as a share: rounding where two are near each other.
_STEP = 64.0 * numerics.EPSILON
#: Condition number of a block up to which it alone has digits enough for all its eigenvalues, less
#: what two ways to find it may differ by.
_PLAIN = 0.99 * numerics.PLAIN_BLOCK


def eigenvalues(matrix: Array) -> tuple[list[Scalar], Scalar]:
    """Eigenvalues of a symmetric matrix in no order, and the verdict on them.

    Their errors are those of a backward stable method: a few roundings of the largest.
    """
    n = len(matrix)
    work = matrix.astype(object)
    whole = norm_squared(work)
    for _ in range(_SWEEPS[n]):
        for p, q in _PAIRS[n]:
            if not is_zero(work[p, q]):
                _turn(work, p, q)
    left: Scalar = 0.0
    for p, q in _PAIRS[n]:
        left = left + work[p, q] * work[p, q]
    verdict: Scalar = PLAIN
    if not is_zero(left):
        verdict = pick(left, whole * _LEFT**2, PLAIN, ENGINE)
    return list(work.diagonal()), larger(verdict, limited(whole, np.inf))


def _turn(work: Array, p: int, q: int) -> None:
    """Turn rows and columns p and q so that their common entry vanishes.

    With d the difference of the two on the diagonal, b between them, h^2 = d^2 + 4 b^2 and
    u = |d| + h, the rotation by less than an eighth of a turn has (c, s) in the ratio u : 2 b.
    """
    b, d = work[p, q], work[q, q] - work[p, p]
    twice = b + b
    square = twice * twice
    # Two equal entries with nothing between them stay as they are.
    h = square_root(d * d + square + numerics.TINY)
    u = d + copysign(h, d)
    norm = 1.0 / square_root(u * u + square)
    c, s = u * norm, twice * norm
    change = s * (c * twice - s * d)
    for r in range(len(work)):
        if r not in (p, q):
            x, y = work[r, p], work[r, q]
            work[r, p] = work[p, r] = c * x - s * y
            work[r, q] = work[q, r] = s * x + c * y
    work[p, p], work[q, q] = work[p, p] - change, work[q, q] + change
    work[p, q] = work[q, p] = 0.0


def largest_eigenvalue(matrix: Array) -> tuple[Scalar, Scalar]:
    """The largest eigenvalue of a symmetric matrix that has a positive one, and the verdict on it.

    With p the characteristic polynomial, whose n roots are real, and x above all of them,

        x - n p / (p' + sqrt((n - 1)^2 p'^2 - n (n - 1) p p''))

    is nearer to the largest, and still above it.
    """
    n = len(matrix)
    if n == 1:
        return matrix[0, 0], PLAIN
    whole = square_root(norm_squared(matrix))
    diagonal, squares = _tridiagonal(matrix * (1.0 / whole))
    x: Scalar = 1.0
    step: Scalar = 0.0
    for _ in range(_STEPS):
        values: list[tuple[Scalar, Scalar, Scalar]] = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
        for d, square in zip(diagonal, [0.0, *squares], strict=True):
            (q, q1, q2), (p, p1, p2) = values
            t = x - d
            values = [
                (p, p1, p2),
                (t * p - square * q, p + t * p1 - square * q1, p1 + p1 + t * p2 - square * q2),
            ]
        p, p1, p2 = values[1]
        root = (p1 * p1) * float((n - 1) ** 2) - (p * p2) * float(n * (n - 1))
        step = p * float(n) / (p1 + square_root(larger(root, 0.0)))
        x = x - step
    return x * whole, pick(absolute(step), x * _STEP, PLAIN, ENGINE)


def _tridiagonal(matrix: Array) -> tuple[list[Scalar], list[Scalar]]:
    """Diagonal of a tridiagonal matrix with the same eigenvalues, and squares beside it."""
    work, squares = matrix.astype(object), list[Scalar]()
    for k in range(len(work) - 2):
        v = work[k + 1 :, k].copy()
        square = norm_squared(v)
        squares.append(square)
        if all(is_zero(x) for x in v[1:]):
            continue
        size = copysign(square_root(square), v[0])
        v[0] = v[0] + size
        factor = 1.0 / (size * v[0])
        p = (work[k + 1 :, k + 1 :] @ v) * factor
        p = p - v * ((v @ p) * factor * 0.5)
        for i in range(len(v)):
            for j in range(i, len(v)):
                at, to = k + 1 + i, k + 1 + j
                work[at, to] = work[to, at] = work[at, to] - v[i] * p[j] - p[i] * v[j]
    squares.append(work[-1, -2] * work[-1, -2])
    return list(work.diagonal()), squares


#: Exchanges that sort so many numbers: of neighbours in turns, or fewer where they are known.
_EXCHANGES = {
    **{n: tuple((i, i + 1) for k in range(n) for i in range(k % 2, n - 1, 2)) for n in _SWEEPS},
    2: ((0, 1),),
    3: ((0, 1), (1, 2), (0, 1)),
    6: (
        (0, 5),
        (1, 3),
        (2, 4),
        (1, 2),
        (3, 4),
        (0, 3),
        (2, 5),
        (0, 1),
        (2, 3),
        (4, 5),
        (1, 2),
        (3, 4),
    ),
}


def ascending(values: Sequence[Scalar]) -> list[Scalar]:
    """The numbers, smallest first."""
    ordered = list(values)
    for i, j in _EXCHANGES[len(ordered)]:
        x, y = ordered[i], ordered[j]
        ordered[i], ordered[j] = pick(x, y, x, y), larger(x, y)
    return ordered


def principal_values(
    matrix: Array, inverse: Array | None = None, growth: Scalar = 1.0
) -> tuple[list[Scalar], Scalar]:
    """Eigenvalues of a positive matrix, smallest first, and the verdict on them.

    Where the matrix alone has not the digits, each is taken from the matrix or from its inverse, as
    `cartstiff.numerics.eigenpairs` does: where less is lost, that is, where it is nearer to the
    largest eigenvalue. The error of the inverse counts `growth` times.
    """
    values, doubt = eigenvalues(matrix)
    ordered = ascending(values)
    alone = pick(ordered[-1], ordered[0] * _PLAIN, PLAIN, ENGINE)
    if inverse is None:
        return ordered, larger(doubt, alone)
    others, verdict = eigenvalues(inverse)
    others = ascending(others)
    for least in (ordered[0], others[0]):
        verdict = larger(verdict, pick(0.0, least, PLAIN, ENGINE))
    merged = []
    for x, y in zip(ordered, reversed(others), strict=True):
        direct, around = ordered[-1] / x, growth * others[-1] / y
        verdict = larger(verdict, pick(direct, _PLAIN, PLAIN, limited(around, _PLAIN)))
        merged.append(pick(alone, ENGINE, x, pick(direct, around, x, 1.0 / y)))
    return ascending(merged), larger(doubt, pick(alone, ENGINE, PLAIN, verdict))
