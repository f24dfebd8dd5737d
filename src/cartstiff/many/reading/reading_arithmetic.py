r"""What maps read from matrices, recorded behind the arithmetic that makes them.

Numbers of a posture that `cartstiff.maps.quantities` finds over arrays, as formulas on recording
numbers: what is read here is never stored. Eigenvalues come from a matrix where it has the digits
and else from its inverse, as there; a posture for which that takes more has the verdict `ENGINE`,
and is read there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    cross,
    eliminated,
    is_zero,
    norm_squared,
    positive_factor,
    reflections,
    symmetric_product,
    upper_inverse,
    zeros,
)
from cartstiff.many.arithmetic import ENGINE, PLAIN, changed_compliance, limited
from cartstiff.many.reading.eigenvalues import (
    ascending,
    eigenvalues,
    largest_eigenvalue,
    principal_values,
)
from cartstiff.many.reading.readings import Readings
from cartstiff.many.reading.vibration_arithmetic import frequency_name, periods
from cartstiff.many.tape import Scalar, absolute, larger, pick, square_root
from cartstiff.stiffness.applied_load import LoadKind

#: Less what two ways to find a condition number may differ by.
_PAIRED = 0.99 * numerics.LARGEST_PAIRED_CONDITION
#: Least pivot of a positive matrix of such a condition number, as a share of its diagonal entry,
#: that rounding does not make.
_POSITIVE = 0.1 / numerics.LARGEST_PAIRED_CONDITION
_BLOCKS = {"rotation": slice(0, 3), "translation": slice(3, 6)}


class _Reader:
    """Matrices of one posture on a tape, and what several readings derive from them."""

    def __init__(self, arrays: Mapping[str, Array], asked: Readings) -> None:
        self.arrays, self.asked = arrays, asked
        self.verdict: Scalar = PLAIN
        self._known: dict[str, list[Scalar]] = {}
        own = asked.connection
        self._matrix = "B" if own == "A" else own
        if own == "load":
            D = _change(asked.load) @ arrays["wrench"]
            even = (D + D.T) * 0.5
            self.K = arrays["stiffness_B"] + even
            self.C = self._changed(even)
            self.own_C = self._changed(D)
        else:
            self.K = arrays[f"stiffness_{self._matrix}"]
            self.C = arrays[f"compliance_{self._matrix}"]
            self.own_C = arrays[f"compliance_{own}"]
        self.free_C = self.C
        if own in ("A", "load"):
            self.free_C = (self.own_C + self.own_C.T) * 0.5
        self._require_digits()

    def _changed(self, D: Array) -> Array:
        C = self.arrays["compliance_B"]
        if all(is_zero(x) for x in D.ravel()):
            return C
        changed, doubt = changed_compliance(C, D, self.asked.length)
        self.require(doubt)
        return changed

    def require(self, verdict: Scalar) -> None:
        """Let a verdict count."""
        self.verdict = larger(self.verdict, verdict)

    def _require_digits(self) -> None:
        """That stiffness and compliance hold all principal values: `numerics.pair_conditions`."""
        k, c = _squared_blocks(self.arrays["stiffness_B"]), _squared_blocks(self.C)
        area = square_root(k[0] / k[2])
        size = k[0] / area / area + k[1] / area + k[2]
        self.require(limited(size * (c[0] * area * area + c[1] * area + c[2]), _PAIRED**2))

    def once(self, key: str, make: Callable[[], list[Scalar]]) -> list[Scalar]:
        """What `make` returned when the key was first asked for."""
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]

    def block(self, freedom: str, others: str) -> list[Scalar]:
        """Eigenvalues, smallest first, of the block of K (others held) or of C (others free)."""

        def make() -> list[Scalar]:
            keep = _BLOCKS[freedom]
            C = self.C if others == "own" else self.free_C
            if others == "held":
                values, doubt = principal_values(self.K[keep, keep], *eliminated(self.C, keep))
            else:
                values, doubt = principal_values(C[keep, keep])
            self.require(doubt)
            return values

        return self.once(f"{freedom} {others}", make)

    def principal(self, kind: str, freedom: str, others: str) -> list[Scalar]:
        """Principal values of stiffness or compliance, smallest first."""
        values = self.block(freedom, others)
        if (kind == "stiffness") == (others == "held"):
            return values
        return [1.0 / x for x in reversed(values)]

    def ratio(self, freedom: str) -> Scalar:
        """Largest over smallest eigenvalue of a block of K."""
        values = self.block(freedom, "held")
        return values[2] / values[0]

    def spectrum(self) -> list[Scalar]:
        """Eigenvalues of a positive K with lengths scaled, smallest first."""

        def make() -> list[Scalar]:
            a, doubt = eigenvalues(_scaled(self.K, 1.0 / self.asked.length))
            b, other = eigenvalues(_scaled(self.C, self.asked.length))
            a, b = ascending(a), ascending(b)
            self.require(larger(doubt, other))
            for least in (a[0], b[0]):
                self.require(pick(0.0, least, PLAIN, ENGINE))
            values = []
            for x, y in zip(a, reversed(b), strict=True):
                # The one that is nearer to the largest of its matrix.
                values.append(pick(a[5] * y, b[5] * x, x, 1.0 / y))
            return ascending(values)

        return self.once("spectrum", make)

    def ends(self) -> list[Scalar]:
        """Smallest and largest eigenvalue of a positive K with lengths scaled."""

        def make() -> list[Scalar]:
            values = []
            for matrix, length in ((self.C, self.asked.length), (self.K, 1.0 / self.asked.length)):
                scaled = _scaled(matrix, length)
                largest, doubt = largest_eigenvalue(scaled)
                self.require(doubt)
                values.append(largest)
            for pivot, entry in zip(positive_factor(scaled)[2], scaled.diagonal(), strict=True):
                self.require(pick(entry * _POSITIVE, pivot, PLAIN, ENGINE))
            return [1.0 / values[0], values[1]]

        return self.once("ends", make)

    def periods(self, number: int) -> list[Scalar]:
        """The largest 1 / omega^2, so many or more of them."""

        def make() -> list[Scalar]:
            D = _change(self.asked.load) @ self.arrays["wrench"]
            found, doubt = periods(self.arrays, D, number)
            self.require(doubt)
            return found

        return self.once(f"periods {number}", make)

    def in_body(self, force: Array) -> Array:
        """A vector in the axes of the body."""
        if not self.asked.world:
            return force
        R: Array = self.arrays["pose"][:3, :3]
        return R.T @ force

    def direction(self) -> Array:
        """The unit vector of the direction, in body axes."""
        u = np.array(self.asked.direction, float)
        return self.in_body(u / np.linalg.norm(u))

    def deflection(self) -> list[Scalar]:
        """Twist under the given wrench."""

        def make() -> list[Scalar]:
            if self.asked.deflect is None:
                W = self.arrays["wrench"]
            else:
                moment, force = (
                    self.in_body(np.array(x))
                    for x in np.split(np.array(self.asked.deflect, float), 2)
                )
                moment = moment + cross(np.array(self.asked.deflect_at, float), force)
                W = np.concatenate([moment, force])
            return list(self.own_C @ W)

        return self.once("deflection", make)


def _scaled(matrix: Array, length: float) -> Array:
    """The matrix with its first three rows and columns multiplied."""
    scale = np.repeat([length, 1.0], 3)
    return matrix * np.outer(scale, scale)


def _squared_blocks(matrix: Array) -> tuple[Scalar, Scalar, Scalar]:
    """Squared sizes of the rotation, coupling and translation blocks."""
    coupling = norm_squared(matrix[:3, 3:]) + norm_squared(matrix[3:, :3])
    return norm_squared(matrix[:3, :3]), coupling, norm_squared(matrix[3:, 3:])


@lru_cache(maxsize=16)
def _change(load: LoadKind) -> NDArray[np.float64]:
    """The tensor (6, 6, 6) that gives ``D = K^load - K^B`` from the wrench."""
    return np.moveaxis(load.change(np.eye(6)), 0, -1)


def _on_axis(r: _Reader, freedom: str, others: str) -> Scalar:
    u, keep = r.direction(), _BLOCKS[freedom]
    block = (r.K if others == "held" else r.free_C)[keep, keep]
    on_axis: Any = u @ (block @ u)
    if others == "free":
        return 1.0 / on_axis
    terms: Any = sum(absolute(x) for x in (block * np.outer(u, u)).ravel())
    rounding = absolute(on_axis) * (numerics.REPORTED_ERROR / numerics.EPSILON)
    r.require(pick(terms, rounding, PLAIN, ENGINE))
    return on_axis


def _asymmetry(r: _Reader) -> Scalar:
    K = r.arrays["stiffness_A"]
    rr, tt = square_root(norm_squared(K[:3, :3])), square_root(norm_squared(K[3:, 3:]))
    product = square_root(rr * tt)
    edge = square_root(norm_squared(K[:3, 3:]))
    worst: Scalar = 0.0
    for rows, columns, scale in (
        (0, 0, rr),
        (3, 3, tt),
        (0, 3, pick(0.0, product, product, edge)),
    ):
        size: Scalar = 0.0
        for i in range(3):
            for j in range(3):
                size = larger(size, absolute(K[rows + i, columns + j] - K[columns + j, rows + i]))
        worst = larger(worst, size / pick(0.0, scale, scale, 1.0))
    return worst


def _root_of_jacobian(r: _Reader, length: float) -> Array:
    """R (6, 6) of the QR decomposition of a Jacobian's transpose, lengths scaled."""
    J: Array = r.arrays["jacobian"]
    scale = np.repeat([length, 1.0], 3)[:, None]
    columns = np.where(r.arrays["lengths"].astype(bool), length, 1.0)
    return reflections((J * scale * columns).T).R


def _singular_value_ratio(r: _Reader) -> Scalar:
    """By the largest eigenvalues of ``J J^T`` and of its inverse, each without loss of digits."""
    R = _root_of_jacobian(r, r.asked.length)
    product: Scalar = 1.0
    for factor in (R, upper_inverse(R).T):
        largest, doubt = largest_eigenvalue(symmetric_product(factor.T, factor, zeros(6, 6)))
        r.require(doubt)
        product = product * largest
    return 1.0 / square_root(product)


def _manipulability(r: _Reader) -> Scalar:
    result: Scalar = 1.0
    for x in _root_of_jacobian(r, 1.0).diagonal():
        result = result * x
    return absolute(result)


def _norm(values: Array) -> Scalar:
    return square_root(norm_squared(values))


def _product(values: list[Scalar]) -> Scalar:
    result: Scalar = 1.0
    for x in values:
        result = result * x
    return result


def _isotropy(r: _Reader) -> Scalar:
    """The sixth power of it."""
    values = r.spectrum()
    mean = sum(values[1:], values[0]) / 6.0
    return _product([x / mean for x in values])


def _natural_length(r: _Reader) -> Scalar:
    """The sixth power of it."""
    held, free = r.block("translation", "held"), r.block("rotation", "own")
    for least in (held[0], free[0]):
        r.require(pick(0.0, least, PLAIN, ENGINE))
    return 1.0 / _product([x * y for x, y in zip(held, free, strict=True)])


def _frequency(r: _Reader, which: int) -> Scalar:
    """The square of it."""
    most = max(i for i in range(6) if frequency_name(i) in r.asked.names)
    return r.asked.hertz**2 / r.periods(most + 1)[which]


class _Reading(NamedTuple):
    """How a number is read, and the root that is taken of it at last."""

    record: Callable[[_Reader], Scalar]
    root: int = 1


def _principal_readings() -> dict[str, _Reading]:
    readings = {}
    every = product(
        ("stiffness", "compliance"), _BLOCKS, ("free", "held"), (("min", 0), ("max", 2))
    )
    for kind, freedom, others, (end, at) in every:
        prefix = "" if kind == "stiffness" else "compliance_"
        record = partial(_principal, key=(kind, freedom, others), at=at)
        readings[f"{prefix}{freedom}_{others}_{end}"] = _Reading(record)
    return readings


def _principal(r: _Reader, key: tuple[str, str, str], at: int) -> Scalar:
    return r.principal(*key)[at]


#: What can be read, by the names of `cartstiff.maps.quantities.QUANTITIES`.
READINGS: dict[str, _Reading] = {
    **_principal_readings(),
    "along_free": _Reading(lambda r: _on_axis(r, "translation", "free")),
    "along_held": _Reading(lambda r: _on_axis(r, "translation", "held")),
    "about_free": _Reading(lambda r: _on_axis(r, "rotation", "free")),
    "about_held": _Reading(lambda r: _on_axis(r, "rotation", "held")),
    "deflection": _Reading(lambda r: _norm(np.array(r.deflection()[3:], object))),
    "deflection_angle": _Reading(lambda r: _norm(np.array(r.deflection()[:3], object))),
    "condition": _Reading(lambda r: r.ends()[1] / r.ends()[0]),
    "isotropy": _Reading(_isotropy, 6),
    "minimum": _Reading(lambda r: r.ends()[0]),
    "translation_condition": _Reading(lambda r: r.ratio("translation")),
    "rotation_condition": _Reading(lambda r: r.ratio("rotation")),
    "determinant": _Reading(lambda r: _product(r.spectrum()) * r.asked.length**6),
    # Where there may be one it is read elsewhere.
    "unstable_directions": _Reading(lambda r: r.ends()[0] * 0.0),
    "natural_length": _Reading(_natural_length, 6),
    "asymmetry": _Reading(_asymmetry),
    "singular_value_ratio": _Reading(_singular_value_ratio),
    "manipulability": _Reading(_manipulability),
    "moment": _Reading(lambda r: _norm(r.arrays["wrench"][:3])),
    "force": _Reading(lambda r: _norm(r.arrays["wrench"][3:])),
    "energy": _Reading(lambda r: r.arrays["energy"][0]),
    **{frequency_name(i): _Reading(partial(_frequency, which=i), 2) for i in range(6)},
}


def read(arrays: Mapping[str, Array], asked: Readings) -> tuple[Array, Scalar]:
    """Readings of one posture in the order of their names, and the verdict on them.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Outputs of `analyse_many` on a tape; "lengths" (n,) tells which coordinates of the Jacobian
        are distances.
    asked : Readings
        What to read.
    """
    reader = _Reader(arrays, asked)
    values = zeros(len(asked.names))
    values[:] = [READINGS[name].record(reader) for name in asked.names]
    for value in values:
        reader.require(limited(absolute(value), np.inf))
    return values, reader.verdict
