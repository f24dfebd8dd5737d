r"""Quantities of the table `cartstiff.recorded.quantities` on recorded numbers.

A program with quantities does not store the matrices that they are read from. Eigenvalues
come from a matrix if it has the digits, else from its inverse; a posture that needs more
than that has the verdict `FALLBACK` and is read from stored matrices
(`cartstiff.recorded.stacks`).

Eigenvalues of symmetric matrices take a fixed number of steps. All of them come from
Jacobi rotations: a sweep rotates every pair of rows once, and the off-diagonal part
finally converges quadratically. The largest alone takes a quarter of the work, by
Laguerre's iteration on the characteristic polynomial of a tridiagonal matrix, from a
bound downwards, with cubic convergence. The remaining error decides the verdict.

Small vibrations ``K_q x = omega^2 M x``: with H the Lagrangian Hessian on the motions x,
J their twists and D = K^load - K^B,

    K_q = H + J^T D J = L L^T,    1 / omega^2: eigenvalues of L^-1 M L^-T,

which resolves the slow ones to the last digit, and with M = G G^T those of its inverse,
``L^T M^-1 L``, the fast ones. K_q has no such factor without an energy, nor where a
motion costs nothing or is unstable.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from cartstiff.answer.analysis.ellipsoids import Freedom, Others, is_direct
from cartstiff.answer.vibration.response import Damping
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.platform import Platform
from cartstiff.core.stiffness.applied_load import LoadKind
from cartstiff.recorded.algebra import (
    FALLBACK,
    PLAIN,
    Judged,
    LoadAtInput,
    below,
    changed_compliance,
    congruence,
    eliminated,
    is_zero,
    largest,
    limited,
    norm_squared,
    positive_factor,
    reflections,
    require_pivots,
    symmetric_product,
    upper_inverse,
    vanishes,
    zeros,
)
from cartstiff.recorded.chains import Bodies, ChainCase
from cartstiff.recorded.platforms import PlatformCase
from cartstiff.recorded.quantities import (
    ASYMMETRIC,
    BLOCKS,
    BUILT_IN,
    FREQUENCIES,
    QUANTITIES,
    Rows,
    Settings,
    Source,
    frequency_name,
    is_own,
    product_of,
)
from cartstiff.recorded.strength import OF_STRENGTH
from cartstiff.recorded.tape import (
    Arrays,
    Scalar,
    absolute,
    copysign,
    larger,
    pick,
    square_root,
)
from cartstiff.recorded.twists import numbers

#: Largest number of rows for which all eigenvalues are recorded.
LARGEST = 8
#: Number of sweeps after which nearly every matrix of a size is diagonal.
_SWEEPS = {1: 0, 2: 1, 3: 4, 4: 5, 5: 6, 6: 6, 7: 7, 8: 7}
#: Number of steps after which Laguerre's iteration has nearly always converged.
_LAGUERRE_STEPS = 6


def _rounds(n: int) -> tuple[tuple[int, int], ...]:
    """All pairs of n rows, in an order in which consecutive pairs share no row:
    none waits.

    It is that of a round-robin tournament.
    """
    seats: list[int] = [*range(n), *[n] * (n % 2)]  # an odd number has a bye
    pairs = list[tuple[int, int]]()
    for _ in range(len(seats) - 1):
        met = zip(seats[: len(seats) // 2], reversed(seats), strict=False)
        pairs += [(min(pair), max(pair)) for pair in met if n not in pair]
        seats = [seats[0], seats[-1], *seats[1:-1]]
    return tuple(pairs)


_PAIRS = {n: _rounds(n) for n in _SWEEPS}
#: Fourth roots, and steps, that find cube roots of numbers from 1e-100 to 1e100.
_QUARTERS, _HALLEY_STEPS = 6, 2
#: Largest off-diagonal part, as a share of the whole matrix: round-off.
_MAX_OFF_DIAGONAL = 4.0 * numerics.EPSILON
#: Largest last step, as a share: round-off where two eigenvalues are near each other.
_MAX_LAST_STEP = 64.0 * numerics.EPSILON
#: Largest condition number of a block that alone determines all its eigenvalues, with a
#: margin for two ways to compute it.
_MAX_BLOCK_CONDITION = 0.99 * numerics.LARGEST_BLOCK_CONDITION


def eigenvalues(matrix: Array) -> tuple[list[Scalar], Scalar]:
    """Unordered eigenvalues of a symmetric matrix, and the verdict on them.

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
        verdict = limited(left, whole * _MAX_OFF_DIAGONAL**2)
    return list(work.diagonal()), larger(verdict, limited(whole, np.inf))


def _turn(work: Array, p: int, q: int) -> None:
    """Rotate rows and columns p and q so that their common entry vanishes.

    With d the difference of the two on the diagonal, b between them, h^2 = d^2 + 4 b^2
    and u = |d| + h, the rotation by less than an eighth of a turn has (c, s) in the ratio
    u : 2 b.
    """
    b, d = work[p, q], work[q, q] - work[p, p]
    twice = b + b
    square = twice * twice
    # `TINY` keeps two equal entries with 0 between them unchanged.
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
    """The largest eigenvalue of a symmetric matrix that has a positive one,
    and the verdict on it.

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
    for _ in range(_LAGUERRE_STEPS):
        values: list[tuple[Scalar, Scalar, Scalar]] = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
        for d, square in zip(diagonal, [0.0, *squares], strict=True):
            (q, q1, q2), (p, p1, p2) = values
            t = x - d
            values = [
                (p, p1, p2),
                (
                    t * p - square * q,
                    p + t * p1 - square * q1,
                    p1 + p1 + t * p2 - square * q2,
                ),
            ]
        p, p1, p2 = values[1]
        root = (p1 * p1) * float((n - 1) ** 2) - (p * p2) * float(n * (n - 1))
        step = p * float(n) / (p1 + square_root(larger(root, 0.0)))
        x = x - step
    return x * whole, limited(absolute(step), x * _MAX_LAST_STEP)


def _tridiagonal(matrix: Array) -> tuple[list[Scalar], list[Scalar]]:
    """Diagonal and squared off-diagonal of a tridiagonal matrix with the same
    eigenvalues.
    """
    work, squares = matrix.astype(object), list[Scalar]()
    for k in range(len(work) - 2):
        v = work[k + 1 :, k].copy()
        square = norm_squared(v)
        squares.append(square)
        if vanishes(v[1:]):
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


#: Exchanges of neighbours, in turns, that sort n numbers.
_EXCHANGES = {
    n: tuple((i, i + 1) for k in range(n) for i in range(k % 2, n - 1, 2))
    for n in _SWEEPS
}


def ascending(values: Sequence[Scalar]) -> list[Scalar]:
    """The numbers in ascending order."""
    ordered = list(values)
    for i, j in _EXCHANGES[len(ordered)]:
        x, y = ordered[i], ordered[j]
        ordered[i], ordered[j] = pick(x, y, x, y), larger(x, y)
    return ordered


def principal_values(
    matrix: Array, inverse: Array | None = None, growth: Scalar = 1.0
) -> tuple[list[Scalar], Scalar]:
    """Eigenvalues of a positive matrix, smallest first, and the verdict on them.

    If the matrix alone does not determine them, each is taken from the matrix or from its
    inverse, like `cartstiff.core.numerics.eigenpairs`: from the one in which it is nearer
    to the largest eigenvalue. The error of the inverse counts `growth` times.
    """
    values, doubt = eigenvalues(matrix)
    ordered = ascending(values)
    alone = limited(ordered[-1], ordered[0] * _MAX_BLOCK_CONDITION)
    if inverse is None:
        return ordered, larger(doubt, alone)
    others, verdict = eigenvalues(inverse)
    others = ascending(others)
    for least in (ordered[0], others[0]):
        verdict = larger(verdict, limited(0.0, least))
    merged = []
    for x, y in zip(ordered, reversed(others), strict=True):
        direct, around = ordered[-1] / x, growth * others[-1] / y
        of_inverse = limited(around, _MAX_BLOCK_CONDITION)
        verdict = larger(verdict, pick(direct, _MAX_BLOCK_CONDITION, PLAIN, of_inverse))
        merged.append(pick(alone, FALLBACK, x, pick(direct, around, x, 1.0 / y)))
    return ascending(merged), larger(doubt, pick(alone, FALLBACK, PLAIN, verdict))


def cube_root(x: Scalar) -> tuple[Scalar, Scalar]:
    """The cube root of a positive number, and the verdict on it.

    As ``1/3 = 1/4 + 1/16 + ...``, square roots come near it, and each of Halley's steps

        y (y^3 + 2 x) / (2 y^3 + x)

    trebles the number of digits.
    """
    y: Scalar = 1.0
    part = x
    for _ in range(_QUARTERS):
        part = square_root(square_root(part))
        y = y * part
    cube = y * y * y
    for _ in range(_HALLEY_STEPS):
        y = y * (cube + x + x) / (cube + cube + x)
        cube = y * y * y
    return y, limited(absolute(cube - x), x * numerics.ROUNDOFF)


def periods(arrays: Arrays, D: Array, number: int) -> tuple[list[Scalar], Scalar]:
    """The largest 1 / omega^2, and the verdict on them.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        "kinetic" M, "lagrangian" H and "motion" J.
    D : ndarray (6, 6)
        K^load - K^B.
    number : int
        How many; the first alone takes fewer operations.
    """
    H, M, J = (arrays[name] for name in ("lagrangian", "kinetic", "motion"))
    verdict: Scalar = PLAIN
    skew = D - D.T
    if not vanishes(skew):
        least = largest(D) * numerics.ROUNDOFF
        verdict = pick(least, largest(skew), FALLBACK, PLAIN)
    if not vanishes(D):
        H = H + congruence(J, (D + D.T) * 0.5)
    L, inverses, pivots = positive_factor(H)
    verdict = require_pivots(verdict, pivots, H.diagonal(), numerics.LOST_ERROR)
    roots = np.array([square_root(x) for x in inverses], object)
    slow = below(L, below(L, M).T) * np.multiply.outer(roots, roots)
    if number == 1:
        longest, doubt = largest_eigenvalue(slow)
        return [longest], larger(verdict, doubt)
    slowest, doubt = eigenvalues(slow)
    slowest, verdict = ascending(slowest)[::-1], larger(verdict, doubt)
    quickest, doubt = eigenvalues(_inverse(M, L / roots))
    quickest = ascending(quickest)
    found = list[Scalar]()
    for x, y in list(zip(slowest, quickest, strict=True))[:number]:
        # The inverse does not determine motions without mass: its verdict counts where it
        # is used.
        loss = slowest[0] / x
        other = larger(doubt, limited(quickest[-1] / y, _MAX_BLOCK_CONDITION))
        verdict = larger(verdict, pick(loss, _MAX_BLOCK_CONDITION, PLAIN, other))
        found.append(pick(loss, _MAX_BLOCK_CONDITION, x, 1.0 / y))
    return found, verdict


def _inverse(M: Array, L: Array) -> Array:
    """``L^T M^-1 L``."""
    G, inverses, _ = positive_factor(M)
    reached = below(G, L)
    return symmetric_product(reached.T, reached * inverses[:, None], zeros(*M.shape))


@dataclass(frozen=True)
class Readings:
    """Quantities to read at every posture, with their settings; hashable.

    Attributes
    ----------
    names : tuple of str
        Names in `READINGS`.
    settings : Settings
        Settings of the quantities.
    hertz : float
        Frequency [Hz] of a mass of 1 on a stiffness of 1 in the mechanism's units.
    """

    names: tuple[str, ...]
    settings: Settings = field(default_factory=Settings)
    hertz: float = 0.5 / math.pi

    @classmethod
    def of(
        cls, elastic: ElasticMechanism, names: tuple[str, ...], settings: Settings
    ) -> Readings:
        """With the frequencies of a mechanism's units."""
        hertz = float(1.0 / np.sqrt(elastic.units.kilogram)) / (2.0 * np.pi)
        return cls(names, settings, hertz)

    def __post_init__(self) -> None:
        """Remove settings that no recorded quantity uses, and that are not hashable."""
        settings = replace(self.settings, damping=Damping())
        object.__setattr__(self, "settings", settings)

    @property
    def needs(self) -> tuple[str, ...]:
        """Required outputs."""
        own = {"B", self.settings.connection} - {"load"}
        names = [
            f"{kind}_{c}" for c in sorted(own) for kind in ("stiffness", "compliance")
        ]
        if not FREQUENCIES.isdisjoint(self.names):
            names += ["kinetic", "lagrangian", "motion"]
        if not set(OF_STRENGTH).isdisjoint(self.names):
            names.append(self.settings.drives.output)
        return (*names, "stiffness_A", "pose", "jacobian", "wrench", "energy")

    def exist_beside(self, arrays: Arrays) -> bool:
        """Whether all required outputs exist."""
        of_jacobian = any("jacobian" in QUANTITIES[name].needs for name in self.names)
        return all(
            name in arrays for name in self.needs if name != "jacobian" or of_jacobian
        )


#: Largest condition number of a pair, with a margin for two ways to compute it.
_MAX_PAIR_CONDITION = 0.99 * numerics.LARGEST_PAIRED_CONDITION
#: Least pivot of a positive matrix of such a condition number that is not round-off, as a
#: share of its diagonal entry.
_LEAST_PIVOT_SHARE = 0.1 / numerics.LARGEST_PAIRED_CONDITION


class RecordedSource(Source, Judged):
    """Recorded matrices of one posture."""

    def __init__(
        self,
        arrays: Arrays,
        asked: Readings,
        load: LoadKind | LoadAtInput | None = None,
    ) -> None:
        super().__init__(arrays, asked.settings)
        self.load = load or asked.settings.load
        self.asked = asked
        own = asked.settings.connection
        if own == "load":
            D = self.load.change(arrays["wrench"])
            even = (D + D.T) * 0.5
            self.K = arrays["stiffness_B"] + even
            self.C = self._changed(even)
            self.own_C = self._changed(D)
        else:
            self.K = arrays[f"stiffness_{asked.settings.matrix}"]
            self.C = arrays[f"compliance_{asked.settings.matrix}"]
            self.own_C = arrays[f"compliance_{own}"]
        self.free_C = self.C
        if own in ASYMMETRIC:
            self.free_C = (self.own_C + self.own_C.T) * 0.5
        self._require_digits()

    def _changed(self, D: Array) -> Array:
        C = self.arrays["compliance_B"]
        if vanishes(D):
            return C
        changed, doubt = changed_compliance(C, D, self.settings.length)
        self.require(doubt)
        return changed

    def _require_digits(self) -> None:
        """Require that stiffness and compliance determine all principal values.

        See `numerics.pair_conditions`.
        """
        k, c = _squared_blocks(self.arrays["stiffness_B"]), _squared_blocks(self.C)
        area = square_root(k[0] / k[2])
        size = k[0] / area / area + k[1] / area + k[2]
        self.require(
            limited(
                size * (c[0] * area * area + c[1] * area + c[2]), _MAX_PAIR_CONDITION**2
            )
        )

    def principal(
        self, kind: str, freedom: Freedom, others: Others, of_held: bool = False
    ) -> list[Scalar]:
        """Principal values of a block of K (others held) or of C (others free),
        or inverses.
        """

        def make() -> list[Scalar]:
            keep = BLOCKS[freedom]
            C = self.C if of_held else self.free_C
            if others == "held":
                values, doubt = principal_values(
                    self.K[keep, keep], *eliminated(self.C, keep)
                )
            else:
                values, doubt = principal_values(C[keep, keep])
            self.require(doubt)
            return values

        values: list[Scalar] = self.once(f"{freedom} {others} {of_held}", make)
        if is_direct(kind, others):
            return values
        return [1.0 / x for x in reversed(values)]

    def spectrum(self) -> list[Scalar]:
        """Eigenvalues of a positive K with lengths scaled, smallest first."""

        def make() -> list[Scalar]:
            a, doubt = eigenvalues(_scaled(self.K, 1.0 / self.settings.length))
            b, other = eigenvalues(_scaled(self.C, self.settings.length))
            a, b = ascending(a), ascending(b)
            self.require(larger(doubt, other))
            for least in (a[0], b[0]):
                self.require(limited(0.0, least))
            values = []
            for x, y in zip(a, reversed(b), strict=True):
                # From the matrix in which it is nearer to the largest one.
                values.append(pick(a[5] * y, b[5] * x, x, 1.0 / y))
            return ascending(values)

        found: list[Scalar] = self.once("spectrum", make)
        return found

    def ends(self) -> list[Scalar]:
        """Smallest and largest eigenvalue of a positive K with lengths scaled."""

        def make() -> list[Scalar]:
            values, length = [], self.settings.length
            for matrix, by in ((self.C, length), (self.K, 1.0 / length)):
                scaled = _scaled(matrix, by)
                largest, doubt = largest_eigenvalue(scaled)
                self.require(doubt)
                values.append(largest)
            pivots, sizes = positive_factor(scaled)[2], scaled.diagonal()
            self.verdict = require_pivots(self.verdict, pivots, sizes, _LEAST_PIVOT_SHARE)
            return [1.0 / values[0], values[1]]

        found: list[Scalar] = self.once("ends", make)
        return found

    def ratio(self, values: Rows) -> Scalar:
        """Largest over smallest of positive eigenvalues."""
        return values[-1] / values[0]

    def sixth_root(self, value: Scalar) -> Scalar:
        """The cube root of the square root."""
        root, doubt = cube_root(square_root(value))
        self.require(doubt)
        return root

    def where_positive(
        self,
        value: Scalar,
        least: Scalar,
        at_zero: float = np.nan,  # noqa: ARG002
    ) -> Scalar:
        """The value; requires that `least` is positive."""
        self.require(limited(0.0, least))
        return value

    def unstable(self) -> Scalar:
        """Zero; `ends` requires that K is positive."""
        return self.ends()[0] * 0.0

    def on_axis(self, freedom: Freedom, others: Others) -> Scalar:
        """Stiffness along or about the direction through the frame's origin."""
        u, keep = self.direction(), BLOCKS[freedom]
        block = (self.K if others == "held" else self.free_C)[keep, keep]
        on_axis: Any = u @ (block @ u)
        if others == "free":
            return 1.0 / on_axis
        terms: Any = sum(absolute(x) for x in (block * np.outer(u, u)).ravel())
        rounding = absolute(on_axis) * (numerics.REPORTED_ERROR / numerics.EPSILON)
        self.require(limited(terms, rounding))
        return on_axis

    def singular_value_ratio(self) -> Scalar:
        """From the largest eigenvalues of ``J J^T`` and of its inverse,
        without loss of digits.
        """
        R = self._root_of_jacobian(self.settings.length)
        product: Scalar = 1.0
        for factor in (R, upper_inverse(R).T):
            largest, doubt = largest_eigenvalue(
                symmetric_product(factor.T, factor, zeros(6, 6))
            )
            self.require(doubt)
            product = product * largest
        return 1.0 / square_root(product)

    def manipulability(self) -> Scalar:
        """Product of the Jacobian's singular values."""
        return absolute(product_of(self._root_of_jacobian(1.0).diagonal().tolist()))

    def _root_of_jacobian(self, length: float) -> Array:
        """R (6, 6) of the QR decomposition of a Jacobian's transpose, lengths scaled."""
        scale = np.repeat([length, 1.0], 3)[:, None]
        columns = np.where(self.arrays["lengths"].astype(bool), length, 1.0)
        return reflections((self.arrays["jacobian"] * scale * columns).T).R

    def frequency(self, i: int) -> Scalar:
        """One of the lowest frequencies in Hz."""
        most = max(i for i in range(6) if frequency_name(i) in self.asked.names)

        def make() -> list[Scalar]:
            D = self.load.change(self.arrays["wrench"])
            found, doubt = periods(self.arrays, D, most + 1)
            self.require(doubt)
            return found

        return square_root(self.asked.hertz**2 / self.once("periods", make)[i])


def _scaled(matrix: Array, length: float) -> Array:
    """The matrix with its first three rows and columns multiplied."""
    scale = np.repeat([length, 1.0], 3)
    return matrix * np.outer(scale, scale)


def _squared_blocks(matrix: Array) -> tuple[Scalar, Scalar, Scalar]:
    """Squared sizes of the rotation, coupling and translation blocks."""
    coupling = norm_squared(matrix[:3, 3:]) + norm_squared(matrix[3:, :3])
    return norm_squared(matrix[:3, :3]), coupling, norm_squared(matrix[3:, 3:])


#: Quantities that can be recorded, by name.
READINGS = {name: quantity for name, quantity in BUILT_IN.items() if quantity.is_recorded}


def read(
    arrays: Arrays,
    asked: Readings,
    load: LoadKind | LoadAtInput | None = None,
) -> tuple[Array, Scalar]:
    """Quantities of one posture in the order of their names, and the verdict on them.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Recorded outputs of `analyse_many`; "lengths" (n,) says which coordinates of the
        Jacobian are distances.
    asked : Readings
        The quantities.
    load : LoadKind or LoadAtInput, optional
        Default that of the settings.
    """
    source = RecordedSource(arrays, asked, load)
    values = zeros(len(asked.names))
    values[:] = [READINGS[name].function(source) for name in asked.names]
    for value in values:
        source.require(limited(absolute(value), np.inf))
    return values, source.verdict


_Case = ChainCase | PlatformCase


def with_masses(elastic: ElasticMechanism, case: _Case) -> _Case | None:
    """The case with all masses; None if some are not recorded, or if there are none."""
    if any(p.dead is not None and p.dead.mass for p in elastic.potentials):
        return None
    mechanism = elastic.mechanism
    if isinstance(case, PlatformCase):
        mechanism = cast(Platform, mechanism)
        legs = mechanism.struts
        if legs is None and not mechanism.body_inertia.any():
            return None
        return replace(case, inertia=numbers(mechanism.body_inertia), legs=legs)
    if isinstance(case, ChainCase):
        mechanism = cast(Chain, mechanism)
        is_whole = len(case.constants.screws) == 6 * mechanism.tree.model.nv
        if not (is_whole and mechanism.tree.masses()[0].any()):
            return None
        return replace(case, bodies=Bodies.of(mechanism.tree))
    return None


def frequencies_of(case: _Case) -> int:
    """Number of recorded frequencies: all, or the lowest one of many motions."""
    motions = case.freedoms if isinstance(case, ChainCase) else 6
    return motions if motions <= LARGEST else 1


def recordable(
    elastic: ElasticMechanism, case: _Case, names: Iterable[str]
) -> tuple[str, ...]:
    """Names of the quantities that can be recorded for a case."""
    frequencies = 0 if with_masses(elastic, case) is None else frequencies_of(case)
    left = FREQUENCIES.difference(map(frequency_name, range(frequencies)))
    if elastic.mechanism.closures:
        left |= {"largest_load"}
    return tuple(n for n in names if n in READINGS and n not in left and not is_own(n))
