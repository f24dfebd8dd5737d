r"""Quantities of the table `cartstiff.recorded.quantities` on stacks of matrices (N, 6,
6).

They are equal row by row to `cartstiff.analysis` of one posture. An asymmetric matrix
(K^A, a tangent under load) is read by its symmetric part, as there. A quantity that does
not exist at a posture is NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cartstiff.answer.analysis.asymmetry import relative_changes, roots_of_compliances
from cartstiff.answer.analysis.ellipsoids import (
    Freedom,
    Others,
    is_direct,
    principal_pairs,
    stiffnesses_on_axes,
)
from cartstiff.answer.analysis.matrices import symmetric_part, with_angles_times
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.applied_load import Axes
from cartstiff.recorded.arguments import OF_VIBRATIONS
from cartstiff.recorded.quantities import (
    ASYMMETRIC,
    BLOCKS,
    FREQUENCIES,
    Numbers,
    Quantity,
    Rows,
    Settings,
    Source,
)
from cartstiff.recorded.strength import rates_in_loops
from cartstiff.recorded.tape import Arrays
from cartstiff.recorded.vibrations import ManyModes


def on_finite(
    function: Callable[..., Array], *stacks: Array, shape: tuple[int, ...] = ()
) -> Array:
    """Apply a function of stacks to the rows in which all are finite.

    NaN (N, *shape) elsewhere.
    """
    finite = np.ones(len(stacks[0]), bool)
    for stack in stacks:
        finite &= np.isfinite(stack).all(axis=tuple(range(1, stack.ndim)))
    if finite.all():
        return function(*stacks)
    result = np.full((len(finite), *shape), np.nan)
    if finite.any():
        result[finite] = function(*(stack[finite] for stack in stacks))
    return result


def eigenvalues(K: Array, C: Array, length: float | Array) -> Array:
    """Eigenvalues (N, 6) of length-scaled stiffness,
    as in `cartstiff.answer.analysis.indices`.
    """
    scaled = with_angles_times(K, 1.0 / np.asarray(length))
    values = numerics.eigenvalues(scaled, with_angles_times(C, length))
    values[~np.isfinite(K).all(axis=(1, 2))] = np.nan
    return values


class Stacks(Source):
    """Arrays of many postures by output name, with intermediate results of
    the quantities.
    """

    def __init__(
        self,
        arrays: Arrays,
        settings: Settings,
        lengths: Array | None = None,
        swing: ManyModes | None = None,
    ) -> None:
        super().__init__(arrays, settings)
        #: Which coordinates are distances (n,).
        self.lengths = lengths
        #: Small vibrations at the postures, computed when first used.
        self.swing = swing

    def entries(self, name: str) -> Rows:
        """Entries (N,) of an output."""
        array = self.arrays[name]
        return array.T if array.ndim > 1 else array[None]

    @property
    def K(self) -> Array:  # noqa: N802
        """Stiffness (N, 6, 6) that is read: the symmetric part."""
        K = self.arrays[f"stiffness_{self.settings.matrix}"]
        if self.settings.matrix != "load":
            return K
        return self.once("K", lambda: symmetric_part(K))

    @property
    def C(self) -> Array:  # noqa: N802
        """Inverse (N, 6, 6) of `K`, as in
        `StiffnessInFrame.inverse_of_symmetric_part`.
        """
        if self.settings.matrix != "load":
            return self.arrays[f"compliance_{self.settings.matrix}"]

        def make() -> Array:
            D = symmetric_part(self.settings.load.change(self.arrays["wrench"]))
            C = self.arrays["compliance_B"]
            return numerics.inverses_of_sums(C, D)[0] if D.any() else C

        return self.once("C", make)

    @property
    def own_C(self) -> Array:  # type: ignore[override] # noqa: N802
        """Compliance (N, 6, 6) of the connection itself."""
        return self.arrays[f"compliance_{self.settings.connection}"]

    def pair(self, others: str) -> tuple[Array, Array]:
        """Stiffness and compliance (N, 6, 6), as in `StiffnessInFrame.pair`."""
        if others == "held" or self.settings.connection not in ASYMMETRIC:
            return self.K, self.C

        def make() -> tuple[Array, Array]:
            K, C = self.arrays[f"stiffness_{self.settings.connection}"], self.own_C
            even = numerics.is_about_symmetric(K) & numerics.is_about_symmetric(C)
            stiff, flexible = symmetric_part(K), symmetric_part(C)
            rows = np.flatnonzero(~even & np.isfinite(K + C).all(axis=(1, 2)))
            if rows.size:
                stiff[rows] = numerics.invert_each(flexible[rows])[0]
            return stiff, flexible

        return self.once("free", make)

    def principal(
        self, kind: str, freedom: Freedom, others: Others, of_held: bool = False
    ) -> Rows:
        """Principal values (3, N) of stiffness or compliance,
        the other freedoms held or free.
        """

        def make() -> Array:
            own, inverse = self.pair("held" if of_held else others)
            if kind == "compliance":
                own, inverse = inverse, own
            is_eliminated = not is_direct(kind, others)
            return principal_pairs(own, inverse, BLOCKS[freedom], is_eliminated)[0].T

        values: Array = self.once(f"{kind} {freedom} {others} {of_held}", make)
        return values

    def spectrum(self) -> Array:
        """Eigenvalues (6, N) of the stiffness with lengths scaled."""
        values: Array = self.once(
            "spectrum", lambda: eigenvalues(self.K, self.C, self.settings.length).T
        )
        return values

    ends = spectrum

    def ratio(self, values: Rows) -> Numbers:
        """Condition number (N,) from eigenvalues (n, N)."""
        return numerics.condition(np.asarray(values).T)

    def sixth_root(self, value: Numbers) -> Numbers:
        """The sixth root (N,)."""
        return value ** (1.0 / 6.0)

    def where_positive(
        self, value: Numbers, least: Numbers, at_zero: float = np.nan
    ) -> Numbers:
        """The value (N,), NaN where another is negative."""
        return np.where(least > 0.0, value, np.where(least == 0.0, at_zero, np.nan))

    def unstable(self) -> Numbers:
        """Number (N,) of negative eigenvalues."""
        values = self.spectrum()
        return np.where(np.isnan(values).any(axis=0), np.nan, (values < 0.0).sum(axis=0))

    def on_axis(self, freedom: Freedom, others: Others) -> Numbers:
        """Stiffness (N,) along or about the direction through the frame's origin."""
        stiff, flexible = self.pair(others)
        u = np.broadcast_to(self.direction(), (len(stiff), 3))
        return stiffnesses_on_axes(stiff, flexible, u, freedom, others)

    def connection_change(self) -> Numbers:
        """Largest change that
        `cartstiff.answer.analysis.asymmetry.compare_connections` finds.
        """
        own, scale = self.settings.connection, 1.0 / self.settings.length
        reference = self.arrays[f"stiffness_{own}"]
        scaled = with_angles_times(reference, scale)
        roots = roots_of_compliances(
            scaled, with_angles_times(self.C, self.settings.length)
        )
        worst = np.full(len(reference), np.nan)
        for name in OF_MANY:
            d = self.arrays[f"stiffness_{name}"] - reference
            if name != own:
                change = on_finite(
                    relative_changes, scaled, roots, with_angles_times(d, scale)
                )
                worst = np.fmax(worst, change)
        return worst

    def singular_value_ratio(self) -> Numbers:
        """Ratio (N,) of the extreme singular values of the length-scaled Jacobian."""
        J, length = self.arrays["jacobian"], self.settings.length
        is_length = np.zeros(J.shape[2], bool) if self.lengths is None else self.lengths
        values = self._singular_values(length, np.where(is_length, length, 1.0))
        return values[:, -1] / values[:, 0]

    def manipulability(self) -> Numbers:
        """Product of the Jacobian's singular values."""
        return np.prod(self._singular_values(1.0, 1.0), axis=1)

    def _singular_values(self, length: float, columns: float | Array) -> Array:
        J = self.arrays["jacobian"]
        scale = np.repeat([length, 1.0], 3)[:, None] * columns
        return on_finite(
            lambda m: np.linalg.svd(m * scale, compute_uv=False),
            J,
            shape=(min(J.shape[1:]),),
        )

    def rates_of_load(self) -> Callable[[int], Numbers]:
        """Rate (N,) of the force of each drive by the load."""
        if not self.settings.drives.of_loops or self.swing is None:
            return super().rates_of_load()
        at, W = self.swing, self.arrays["wrench"]
        rates = self.once("rates of load", lambda: rates_in_loops(at.elastic, at.q, W))
        return lambda i: rates[i]

    @property
    def vibrations(self) -> ManyModes:
        """Small vibrations at the postures."""
        if self.swing is None:
            raise InputError(
                "a quantity of vibrations has no gradient here",
                expected="cartstiff.sensitivities, which has those of the frequencies",
            )
        return self.swing

    def frequency(self, i: int) -> Numbers:
        """One of the six lowest frequencies (N,) in Hz."""
        values: Array = self.once(
            "frequencies", lambda: self.vibrations.frequencies(self.arrays)
        )
        return values[:, i]

    def damping_ratio(self, i: int) -> Numbers:
        """Damping ratio (N,) of one of the six slowest modes."""
        damping = self.settings.damping
        values: Array = self.once(
            "damping", lambda: self.vibrations.damping_ratios(damping)
        )
        return values[:, i]


def needed_outputs(quantities: Sequence[Quantity], settings: Settings) -> tuple[str, ...]:
    """Outputs that the quantities need, and the pose: of `analyse_many`, and for
    frequencies those that only recordings have.
    """
    needed = {"pose"}
    for quantity in quantities:
        needed.update(quantity.outputs(settings))
    if any(quantity.name in FREQUENCIES for quantity in quantities):
        needed.update(("wrench", *OF_VIBRATIONS))
    return tuple(sorted(needed))


def evaluate(
    quantities: Sequence[Quantity],
    arrays: Arrays,
    settings: Settings,
    lengths: Array | None = None,
    swing: ManyModes | None = None,
) -> dict[str, Array]:
    """Values (N,) of quantities by name, from the arrays of `analyse_many`.

    Parameters
    ----------
    quantities : sequence of Quantity
        From `choose_quantities`.
    arrays : mapping of str to ndarray
        Outputs by name, with NaN where one does not exist.
    settings : Settings
        Matrix, length, direction and load that the quantities refer to.
    lengths : ndarray of bool, shape (n,), optional
        Which coordinates are distances; default none.
    swing : ManyModes, optional
        Small vibrations at the postures, if a quantity may need them.
    """
    source, values = Stacks(arrays, settings, lengths, swing), dict[str, Array]()
    for quantity in quantities:
        with np.errstate(all="ignore"):
            value = np.asarray(quantity.function(source), float)
        if value.ndim > 1:
            raise InputError(
                f"the quantity {quantity.name} is not one number for each posture",
                expected="shape (N,)",
                got=value.shape,
            )
        values[quantity.name] = value
    return values


def quantities_of(
    elastic: ElasticMechanism,
    quantities: Sequence[Quantity],
    settings: Settings,
    arrays: Arrays,
    q: Array,
    wrench: Array | None,
    load_axes: Axes,
) -> dict[str, Array]:
    """Values (N,) of quantities of a mechanism at postures q (N, n).

    Parameters
    ----------
    elastic : ElasticMechanism
    quantities, settings, arrays
        As of `evaluate`.
    q, wrench, load_axes
        Closed coordinates, and the load (6,) or (N, 6) with its axes.
    """
    swing = ManyModes(elastic, q, wrench, settings.load, load_axes)
    lengths = distances(elastic.mechanism)
    return evaluate(quantities, arrays, settings, lengths, swing)


def distances(mechanism: Mechanism) -> NDArray[np.bool_]:
    """Which columns (n,) of the Jacobian are of distances: of a platform all, its
    legs.
    """
    return np.ones(6, bool) if mechanism.coordinates_are_pose else mechanism.is_length
