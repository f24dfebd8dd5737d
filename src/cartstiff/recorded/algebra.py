r"""Linear algebra on small arrays of recorded numbers (object arrays, or floats).

Gaussian elimination would need pivots chosen posture by posture. Householder reflections
need none, are stable for any order of rows and columns, and do not depend on the scales
of the columns. The sums of a row are accumulated in parallel, so that no addition waits
for the one before.

The second half has the formulas of `cartstiff.core.stiffness` that chains and platforms
share, on recorded numbers. Where `cartstiff.core.stiffness` decides about rank by
singular values, products of norms bound them here. A posture that is not well inside the
regular ones gets the verdict `FALLBACK` and is computed by `cartstiff.analyse` itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry.se3 import skew_of
from cartstiff.core.numerics import EPSILON, NEAR_SINGULARITY, REPORTED_ERROR
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    LoadKind,
    wrench_in_body,
)
from cartstiff.recorded.tape import (
    Number,
    Scalar,
    Tape,
    absolute,
    copysign,
    larger,
    pick,
    square_root,
)


def zeros(*shape: int) -> Array:
    """Array of zeros that can hold recorded numbers."""
    return np.full(shape, 0.0, object)


def cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors."""
    crossed = np.empty(3, object)
    crossed[:] = [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
    return crossed


def norm_squared(a: Array) -> Scalar:
    """Sum of the squares of all entries."""
    flat = np.ravel(a)
    return flat @ flat


def is_zero(x: Scalar) -> bool:
    """Whether a number is zero for all inputs."""
    return not isinstance(x, Number) and x == 0


def vanishes(values: Any) -> bool:
    """Whether all numbers are zero for all inputs."""
    return all(map(is_zero, np.ravel(values)))


def from_lower(matrix: Array) -> Array:
    """Symmetric matrix from its lower triangle."""
    return np.where(np.tri(len(matrix), dtype=bool), matrix, matrix.T)


def product(left: Array, right: Array) -> Array:
    """``left right``."""
    result = zeros(len(left), right.shape[1])
    for i, row in enumerate(left):
        for a, x in enumerate(row):
            result[i] = result[i] + right[a] * x
    return result


def symmetric_product(columns: Iterable[Array], rows: Array, base: Array) -> Array:
    """``base + left^T rows`` where that is symmetric: its upper triangle, mirrored.

    `columns` are those of `left`; a generator may compute each when it is needed.
    """
    changed = base.copy()
    for i, column in enumerate(columns):
        row = changed[i, i:]
        for a, x in enumerate(column):
            row = row + rows[a, i:] * x
        changed[i, i:] = changed[i:, i] = row
    return changed


def congruence(left: Array, middle: Array) -> Array:
    """``left^T middle left`` for a symmetric middle."""
    n = left.shape[1]
    return symmetric_product((middle @ column for column in left.T), left, zeros(n, n))


class Reflections(NamedTuple):
    """M = Q R: vectors v and factors b of the reflections ``I - b v v^T``, first to last,
    and R.
    """

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
        copied = columns.astype(object)
        for k in order:
            v = self.vectors[k]
            copied[k:] = copied[k:] - np.multiply.outer(
                v, (v @ copied[k:]) * self.factors[k]
            )
        return copied

    def conjugate(self, symmetric: Array) -> Array:
        """``Q^T symmetric Q``, by updates of rank two."""
        n = len(symmetric)
        copied = symmetric.astype(object)
        for k, (v, factor) in enumerate(zip(self.vectors, self.factors, strict=True)):
            p = (copied[:, k:] @ v) * factor
            p[k:] = p[k:] - v * ((v @ p[k:]) * factor * 0.5)
            for i in range(n):
                for j in range(max(i, k), n):
                    change = p[i] * v[j - k]
                    if i >= k:
                        change = change + v[i - k] * p[j]
                    copied[i, j] = copied[j, i] = copied[i, j] - change
        return copied


def _undefined(matrix: Array) -> Scalar:
    """NaN, recorded if the matrix is: the result for a matrix that is singular at
    every posture.
    """
    undefined: Scalar = math.nan
    for x in np.ravel(matrix):
        if isinstance(x, Number):
            undefined = pick(x, x, 0.0, math.nan)
    return undefined


def reflections(matrix: Array) -> Reflections:
    """Householder decomposition of a matrix (n, m), n not less than m.

    It is NaN where columns are linearly dependent at every posture.
    """
    work = matrix.astype(object)
    n, m = work.shape
    vectors, factors = [], []
    for k in range(min(m, n - 1)):
        x = work[k:, k].copy()
        size = copysign(square_root(norm_squared(x)), x[0])
        if is_zero(size):
            size = _undefined(matrix)
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
    inverted = zeros(n, n)
    for j in range(n):
        inverted[j, j] = 1.0 / R[j, j]
    for j in range(n):
        for i in range(j - 1, -1, -1):
            inverted[i, j] = -(
                (R[i, i + 1 : j + 1] @ inverted[i + 1 : j + 1, j]) * inverted[i, i]
            )
    return inverted


def inverse(matrix: Array) -> Array:
    """Inverse of any matrix."""
    return solution(matrix, np.eye(len(matrix)))


def solution(matrix: Array, right: Array) -> Array:
    """``matrix^-1 right`` of a square matrix, without operations on entries that are
    always zero.

    Each step takes the column with fewest varying entries and reflects the rows of its
    nonzero entries. A column of constants is eliminated instead, as its largest entry is
    known. Two columns whose nonzero entries lie in the same two rows are solved by
    Cramer's rule, which needs no pivots either. The result for a matrix that is singular
    at every posture is NaN.
    """
    n = len(matrix)
    undefined = _undefined(matrix)
    work = np.concatenate([matrix, right], axis=1).astype(object)
    rows, columns = list(range(n)), list(range(n))
    steps: list[tuple[list[int], list[int], Array]] = []

    # The column with the fewest recorded entries first: it costs the fewest operations.
    def size(column: int) -> tuple[int, int, int]:
        taken = filled[column]
        varying = sum(isinstance(x, Number) for x in work[taken, column])
        return varying, len(taken), -list(filled.values()).count(taken)

    while columns:
        # Two columns that only the same two rows fill are taken together: a pivot may
        # vanish.
        filled = {c: [i for i in rows if not is_zero(work[i, c])] for c in columns}
        column = min(columns, key=size)
        taken = filled[column]
        inner = [c for c in columns if filled[c] == taken]
        if len(taken) == len(inner) == 2:
            block = _inverse_of_two(work[np.ix_(taken, inner)], undefined)
        else:
            inner = [column]
            others = [*(c for c in columns if c != column), *range(n, work.shape[1])]
            row, pivot_inverse = rows[0], undefined
            if taken:
                row, pivot_inverse = _clear_column(work, taken, column, others)
            taken, block = [row], np.array([[pivot_inverse]], object)
        steps.append((taken, inner, block))
        rows = [i for i in rows if i not in taken]
        columns = [c for c in columns if c not in inner]
    # Backwards, from the last pivot to the first.
    solved = zeros(n, right.shape[1])
    known: list[int] = []
    for taken, inner, block in reversed(steps):
        rest = work[taken, n:]
        for column in known:
            rest = rest - np.outer(work[taken, column], solved[column])
        solved[inner] = product(block, rest)
        known += inner
    return solved


def solution_with_condition(matrix: Array, right: Array) -> tuple[Array, Scalar]:
    """``matrix^-1 right`` of one column, and an estimate of the matrix's squared
    condition number.

    The solution for a second column in a generic direction estimates the norm of the
    inverse.
    """
    n = len(matrix)
    solved = solution(matrix, np.column_stack([right, np.cos(np.arange(1.0, n + 1.0))]))
    return solved[:, 0], norm_squared(solved[:, 1]) / n * norm_squared(matrix)


def _inverse_of_two(matrix: Array, undefined: Scalar) -> Array:
    """Inverse of a matrix (2, 2).

    Made of `undefined` if it is singular at every posture.
    """
    (a, b), (c, d) = matrix
    determinant = a * d - b * c
    factor = undefined if is_zero(determinant) else 1.0 / determinant
    return np.array([[d * factor, -(b * factor)], [-(c * factor), a * factor]], object)


def _clear_column(
    work: Array, filled: list[int], column: int, others: list[int]
) -> tuple[int, Scalar]:
    """Clear a column in all rows but one.

    That row, and the inverse of the entry that stays.
    """
    x = work[filled, column]
    if not any(isinstance(entry, Number) for entry in x):
        at = int(np.argmax(np.abs(x.astype(float))))
        row, reciprocal = filled[at], 1.0 / x[at]
        for i, entry in zip(filled, x, strict=True):
            if i != row:
                work[i, others] = work[i, others] - work[row, others] * (
                    entry * reciprocal
                )
        return row, reciprocal
    if len(filled) == 1:
        return filled[0], 1.0 / x[0]
    if len(filled) == 2:
        row, other = filled
        reciprocal = 1.0 / square_root(norm_squared(x))
        c, s = x * reciprocal
        first, second = work[row, others], work[other, others]
        work[row, others] = first * c + second * s
        work[other, others] = second * c - first * s
        return row, reciprocal
    # I - b v v^T with v = (1, ...): one division serves 1 / size, 1 / top and b = top /
    # size.
    size = copysign(square_root(norm_squared(x)), x[0])
    top = x[0] + size
    common = 1.0 / (size * top)
    v = x * (common * size)
    v[0] = 1.0
    reciprocal = common * top
    block = np.ix_(filled, others)
    work[block] = work[block] - np.outer(
        v, product((v * (top * reciprocal))[None], work[block])[0]
    )
    return filled[0], -reciprocal


def positive_factor(matrix: Array) -> tuple[Array, Array, Array]:
    """L (unit lower triangular), 1 / d and d of a symmetric ``matrix = L diag(d) L^T``.

    Scaling rows and columns alike does not change the relative error, which is small as
    long as no pivot is much less than its diagonal entry.
    """
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
    return L, inverses, pivots


def positive_inverse(matrix: Array) -> Array:
    """Inverse of a positive matrix."""
    L, inverses, _ = positive_factor(matrix)
    return congruence(below(L, np.eye(len(L))), np.diag(inverses))


def require_pivots(verdict: Scalar, pivots: Array, sizes: Array, share: float) -> Scalar:
    """The verdict, or `FALLBACK` if a pivot is below a share of its size."""
    for size, pivot in zip(sizes, pivots, strict=True):
        verdict = larger(verdict, limited(size * share, pivot))
    return verdict


def below(L: Array, right: Array) -> Array:
    """``L^-1 right`` for a unit lower triangular L."""
    solved = right.astype(object)
    for i in range(1, len(L)):
        solved[i] = solved[i] - L[i, :i] @ solved[:i]
    return solved


def above(L: Array, right: Array) -> Array:
    """``L^-T right`` for a unit lower triangular L."""
    solved = right.astype(object)
    for i in reversed(range(len(L) - 1)):
        solved[i] = solved[i] - L[i + 1 :, i] @ solved[i + 1 :]
    return solved


def eliminated(matrix: Array, keep: slice) -> tuple[Array, Scalar]:
    """Schur complement ``M_aa - M_ab M_bb^-1 M_ba`` of a positive matrix,
    and its loss of digits.

    It is the inverse of the block a of M^-1. The loss is the factor by which the relative
    error of M grows in it, as `cartstiff.answer.analysis.matrices.loss_of_elimination`;
    infinite where M_bb is not positive.
    """
    rest = np.delete(np.arange(len(matrix)), keep)
    whole, inner = matrix[keep, keep], matrix[np.ix_(rest, rest)]
    L, inverses, pivots = positive_factor(inner)
    solved = below(L, np.hstack([matrix[rest, keep], np.eye(len(rest))]))
    coupling, back = np.hsplit(solved, [len(whole)])
    left = whole - coupling.T @ (coupling * inverses[:, None])
    # Norms of the equilibrated M_bb and of its inverse are at most their traces.
    growth = (inverses @ (back * back)) @ inner.diagonal() * float(len(rest))
    for pivot in pivots:
        growth = pick(0.0, pivot, growth, np.inf)
    return left, growth * largest(whole) / largest(left)


def largest(values: Array) -> Scalar:
    """Largest absolute value."""
    flat = np.ravel(values)
    top = absolute(flat[0])
    for value in flat[1:]:
        top = larger(top, absolute(value))
    return top


#: Number of halvings of the angle, and number of terms of the series of asin(y) / y.
_HALVINGS, _TERMS = 4, 11
#: Cosine of half the angle below which the sine of the angle has lost its digits.
_LEAST_HALF_ANGLE_COSINE = 0.02


def rotation_vector(R: Array) -> tuple[Array, Scalar]:
    r"""W of ``R = exp([w])``, and the verdict: `FALLBACK` near half a turn.

    The skew part of R has the vector ``s = w sin(t) / t``, t = |w|. With the cosines c_k
    of t / 2^k, found by halving from ``c_1 = sqrt((1 + tr R) / 4)``,

        t / sin t = asin(y) / (y c_1 c_2 c_3 c_4), y = sin(t / 16) = sin t / (16 c_1 c_2
        c_3 c_4)

    and the series of asin(y) / y ends soon.
    """
    s = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]], object) * 0.5
    cosine: Scalar = square_root(larger((R[0, 0] + R[1, 1] + R[2, 2] + 1.0) * 0.25, 0.0))
    verdict = limited(_LEAST_HALF_ANGLE_COSINE, cosine)
    cosines = cosine
    for _ in range(_HALVINGS - 1):
        cosine = square_root((cosine + 1.0) * 0.5)
        cosines = cosines * cosine
    inverse = 1.0 / cosines
    y = norm_squared(s) * inverse * inverse * 0.25**_HALVINGS
    series: Any = 0.0
    for k in reversed(range(_TERMS)):
        series = series * y + math.comb(2 * k, k) / (4.0**k * (2 * k + 1))
    return s * (series * inverse), verdict


#: Verdicts on a posture: its numbers are valid; `cartstiff.analyse` must compute it; no
#: wrench balances it.
PLAIN, FALLBACK, UNBALANCED = 0.0, 1.0, 2.0

#: Largest condition numbers for the verdict `PLAIN`: of Jacobians (`cartstiff.analyse`
#: calls them singular at 1 / `cartstiff.core.numerics.RANK`) and of matrices that are
#: inverted to a compliance (beyond it, `cartstiff.analyse` equilibrates or reports the
#: loss of digits).
JACOBIAN_CONDITION, STIFFNESS_CONDITION = (
    numerics.LARGEST_JACOBIAN_CONDITION,
    numerics.LARGEST_STIFFNESS_CONDITION,
)


#: Relative accuracy of the norm of an inverse that has lost nearly all digits;
#: `cartstiff.analyse` may scale it by slightly different sizes.
_NORM_ACCURACY = 0.7
#: Relative change of an inverse that factors without pivoting may cause: 3 % was the
#: largest in millions of indefinite matrices.
_MAX_PIVOT_LOSS = 0.1
#: Squared norm of an equilibrated matrix beyond which the diagonal is a poor choice of
#: sizes.
_MAX_SQUARED_NORM = 1e2

#: Largest angle [rad] whose sine the vector code computes to the last digit.
LARGEST_ANGLE = 1e6


def limited(value: Scalar, limit: Scalar) -> Scalar:
    """`PLAIN` where a value is below a limit, else (and for NaN) `FALLBACK`."""
    return pick(value, limit, PLAIN, FALLBACK)


class Judged:
    """Recorded numbers with the verdict on all of them."""

    verdict: Scalar = PLAIN

    def require(self, verdict: Scalar) -> None:
        """Add a verdict."""
        self.verdict = larger(self.verdict, verdict)


def _in_length(matrix: Array, rows: Scalar, columns: Scalar) -> Array:
    """Multiply the lower rows and the right columns of a matrix (6, 6) by factors."""
    scaled = matrix.copy()
    scaled[3:] = scaled[3:] * rows
    scaled[:, 3:] = scaled[:, 3:] * columns
    return scaled


def scaled_inverse(K: Array, length: Scalar) -> tuple[Array, Scalar]:
    """Inverse of a stiffness, and its squared condition with lengths measured
    in `length`.
    """
    scaled = _in_length(K, length, length)
    inverted = inverse(scaled)
    return _in_length(inverted, length, length), norm_squared(scaled) * norm_squared(
        inverted
    )


def holds_soft_directions(K: Array, wanted: Collection[str]) -> Scalar:
    r"""Verdict on whether K^B (6, 6) resolves its softest direction,
    where no compliance is wanted.

    `cartstiff.analyse` judges that by ``|K| |K^-1|`` in the sizes of the diagonal. With
    ``K = L d L^T`` and ``X = L^-1`` the second norm is that of ``X^T d^-1 X``. Where
    pivots of both signs have cancelled its digits (the norm of ``L |d| L^T`` beside that
    of K says so), the diagonal of ``X^T |d|^-1 X`` bounds it.
    """
    kinds = {name.partition("_")[0] for name in wanted}
    if "stiffness" not in kinds or "compliance" in kinds:
        return PLAIN
    # About an axis that springs neither hold nor push, the diagonal is round-off, or 0.
    sizes = _absolute(K.diagonal())
    for block in (sizes[:3], sizes[3:]):
        least = largest(block) * EPSILON
        block[:] = [larger(size, least) for size in block]
    L, inverses, pivots = positive_factor(K)
    X = below(L, np.eye(6))
    most: Scalar = _absolute(inverses) @ ((X * X) @ sizes)
    grown: Scalar = (1.0 / sizes) @ ((L * L) @ _absolute(pivots))
    known = squares_over(congruence(X, np.diag(inverses)), 1.0 / sizes)
    softest = pick(
        grown * grown * known, (_MAX_PIVOT_LOSS / EPSILON) ** 2, known, most * most
    )
    limit = (_NORM_ACCURACY * numerics.LOST_ERROR / EPSILON) ** 2
    return limited(squares_over(K, sizes) * softest, limit)


def _absolute(values: Array) -> Array:
    return np.array([absolute(x) for x in values], object)


def squares_over(matrix: Array, sizes: Array) -> Scalar:
    """Squared norm of a matrix divided by the sizes of its rows and columns."""
    return (matrix * matrix / np.multiply.outer(sizes, sizes)).sum()


def equilibrated_squares(matrix: Array, inverse: Array) -> tuple[Scalar, Scalar]:
    """Squared norms of a matrix and its inverse, scaled by the sizes of the diagonal."""
    sizes = _absolute(matrix.diagonal())
    return squares_over(matrix, sizes), squares_over(inverse, 1.0 / sizes)


#: Numbers besides those of the springs that may be inputs: the load's point in M, mass
#: and centre in M of a payload, and a chain's tool, whose pose in the present M (x, y, z;
#: roll, pitch, yaw) is the M of all others.
CASE_INPUTS = {"load_at": 3, "payload": 4, "tcp": 6}


def taut_stiffness(stiffness: Scalar, stretch: Scalar) -> Scalar:
    """Stiffness of a cable: zero where it is slack."""
    return stiffness * pick(stretch, 0.0, 0.0, 1.0)


def off_edge(length: Scalar, stretch: Scalar) -> Scalar:
    """Verdict on a cable: with its rest length, its stiffness has two values."""
    return limited(length * numerics.NEGLIGIBLE_DIFFERENCE, absolute(stretch))


def given_wrench(tape: Tape, case: Any, pose: Callable[[], Array]) -> Array | None:
    """The given wrench about M's origin in the axes of M; None without one."""
    if not case.is_loaded:
        return None
    W, load = tape.vector("wrench", 6), acting(tape, case)
    turn = pose() if case.axes == "world" else np.eye(4)
    if isinstance(load, LoadAtInput):
        W = wrench_in_body(W, turn, DEAD_AT_ORIGIN.at, case.axes)
        return np.concatenate([W[:3] + cross(load.at, W[3:]), W[3:]])
    if case.axes == "body" and not any(load.at):
        return W
    return wrench_in_body(W, turn, load.at, case.axes)


#: ``K^A - K^B`` (6, 6) of each basis wrench, on the last axis.
FROM_B_TO_A = np.moveaxis(DEAD_AT_ORIGIN.changes(np.eye(6)), 0, -1)[0]


@dataclass(frozen=True)
class LoadAtInput:
    """A kind of load at a point in M that is an input."""

    kind: LoadKind
    at: Array

    def changes(self, wrench: Array) -> Array:
        """As `LoadKind.changes`: the tangent about the point, in the axes of M there."""
        changes = self.kind.changes(wrench).astype(object)
        changes[2] = self.change(wrench)
        return changes

    def change(self, wrench: Array) -> Array:
        """As `LoadKind.change`."""
        there = np.concatenate([wrench[:3] - cross(self.at, wrench[3:]), wrench[3:]])
        moved = np.eye(6).astype(object)
        moved[3:, :3] = -skew_of(self.at)
        changed: Array = moved.T @ self.kind.change(there) @ moved
        return changed


def acting(tape: Tape, case: Any) -> LoadKind | LoadAtInput:
    """Kind and point of the load of a case."""
    kind: LoadKind = case.load
    if "load_at" not in case.inputs:
        return kind
    return LoadAtInput(LoadKind(kind.kind), tape.vector("load_at", 3))


def connections(K_B: Array, W: Array, load: LoadKind | LoadAtInput) -> dict[str, Array]:
    """K^A, K^B, K^K and the tangent under a load from K^B and the wrench."""
    changes = zip(("A", "K", "load"), load.changes(W), strict=True)
    return {"B": K_B, **{name: K_B + change for name, change in changes}}


def add_compliances(
    arrays: dict[str, Array],
    stiffness: dict[str, Array],
    wanted: Collection[str],
    length: Scalar,
) -> Scalar:
    """Add the wanted compliances to `arrays`; return their largest squared condition."""
    largest: Scalar = 0.0
    for name, K in stiffness.items():
        output = f"compliance_{name}"
        if output in wanted:
            arrays[output], condition = scaled_inverse(K, length)
            largest = larger(largest, condition)
    return largest


def noteworthy(
    squared_condition: Scalar,
    tangent: Array,
    *pairs: tuple[Array, Array],
    margin: float = 2.0,
) -> Array:
    """Three numbers, at least 1 where notes on a near singularity, on lost digits, and on
    motions that lower the energy are possible.

    The first two bound the squared condition of the scaled Jacobian, and that of matrices
    given in pairs with their inverses, equilibrated; with a margin, as
    `cartstiff.analyse` evaluates them in another order, or along other motions. The last
    is 0 where all pivots of the tangent's symmetric part are positive.
    """
    lost: Scalar = 0.0
    for pair in pairs:
        squares, others = equilibrated_squares(*pair)
        lost = larger(lost, squares * others * (margin * EPSILON / REPORTED_ERROR) ** 2)
        lost = larger(lost, squares / _MAX_SQUARED_NORM)
    near = squared_condition * (1.01 * NEAR_SINGULARITY) ** 2
    unstable: Scalar = 0.0
    for pivot in positive_factor((tangent + tangent.T) * 0.5)[2]:
        unstable = pick(0.0, pivot, unstable, 2.0)
    return np.array([near, lost, unstable], object)


def changed_compliance(
    C: Array, D: Array, length: Scalar, most: float = STIFFNESS_CONDITION
) -> tuple[Array, Scalar]:
    """``C (1 + D C)^-1``, the inverse of K + D from C = K^-1, and the verdict on it."""
    factor = _in_length(D @ C, length, 1.0 / length)
    factor[range(6), range(6)] = factor.diagonal() + 1.0
    turned = inverse(factor)
    condition = norm_squared(factor) * norm_squared(turned)
    back = _in_length(turned, 1.0 / length, length)
    return C @ back, limited(condition, most**2)


#: Names of inputs with one row for all postures.
SHARED = (
    *("stiffness", "rest", "preload", "least", "most", "forces", "weight", "lines"),
    *("anchors", "points", "length", *CASE_INPUTS),
)
