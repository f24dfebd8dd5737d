"""Derivatives of stiffness, pose and frequencies by each parameter of a mechanism.

The parameters are those of `cartstiff.analysis.tolerances`: stiffnesses, masses,
placements or points, rest positions, and the parameters of the mechanism's file. A held
posture keeps its place and its load, and rest positions follow. A mechanism that came to
rest by itself comes to rest again after each change: the derivatives are total, with the
motion of the equilibrium.

Every derivative is a difference quotient of the changed mechanism, analysed again. Values
below round-off are 0. Frequencies may cross, so that their derivatives follow from those
of the matrices on the left and right modes psi, phi, which are moved so that they keep
the closures: with ``psi^T M phi = 1``

    d(omega^2)/dp = d(psi^T K phi)/dp - omega^2 d(psi^T M phi)/dp

For repeated modes the derivatives are the eigenvalues of that form on the subspace, in
order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.analysis.tolerances import Tolerances, UncertainParameters, check_level
from cartstiff.arrays import Array, Result, checked_array, plain_dict
from cartstiff.errors import (
    CartstiffError,
    InputError,
    UndefinedError,
    checked_kind,
    one_line,
)
from cartstiff.figures import draw_bars, new_axes, new_figure
from cartstiff.geometry.differences import derivative_with_error
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.mechanisms.identified import CompliancePattern, Identified, quantile
from cartstiff.results import LabelledResult
from cartstiff.statics.equilibrium import again
from cartstiff.statics.rest import Equilibrium
from cartstiff.statics.small_motions import kinetic_matrix
from cartstiff.stiffness.balance import with_rest_balancing
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.stiffness.tensor import COMPONENTS
from cartstiff.vibration.modes import Modes, modes, stiffness_under_load

_ALL_PARAMETERS = Tolerances(1.0, 1.0, 1.0)
MATRICES = ("A", "B", "K", "F")


@dataclass(frozen=True, eq=False)
class Row:
    """Derivatives by one parameter, their error, and the relative effect of its
    natural size.
    """

    matrices: Array
    pose: Array
    squares: Array
    error: float
    effect: float = 1.0


class Home:
    """The nominal mechanism, which is analysed again with other parameters."""

    def __init__(
        self,
        subject: Modes | PostureStiffness | Equilibrium,
        reread: Callable[[Mapping[str, float]], ElasticMechanism] | None = None,
        tolerances: Tolerances = _ALL_PARAMETERS,
        identified: Identified | None = None,
    ) -> None:
        if isinstance(subject, Modes):
            subject = subject.state if subject.state is not None else subject.held
        self.state = subject if isinstance(subject, Equilibrium) else None
        if self.state is not None and self.state.has_free_motion:
            raise UndefinedError(
                "where it rests is not decided, as a motion of the body costs nothing: "
                "what is "
                "there has no derivatives",
                code="neutral",
            )
        result = (
            subject.elastic_stiffness if isinstance(subject, Equilibrium) else subject
        )
        if identified is not None:
            result = replace(
                result, elastic=replace(result.elastic, identified=identified)
            )
        self.parameters = UncertainParameters(
            result, tolerances, reread, self.state is not None
        )
        self.nominal: PostureStiffness | Equilibrium = subject
        #: Its stiffness, for an equilibrium with the part of its loads.
        self.result = subject.stiffness if isinstance(subject, Equilibrium) else subject
        self._here: tuple[Array, ...] | None = None
        mechanism = subject.elastic.mechanism
        #: Coordinates of a closed chain that are held, if the others can close it.
        self._held = list(mechanism.held)
        self._seen: dict[float, Array] = {}

    def at(self, name: str, change: float) -> PostureStiffness | Equilibrium:
        """Analyse with another value of a parameter."""
        value = self.parameters.value(name) + change
        result = self._at({name: value}, *self._start(change))
        self._seen[change] = result.q
        return result

    def _start(self, change: float) -> tuple[Array, bool]:
        """Extrapolate start coordinates; also return whether a chain is closed by all
        coordinates.

        The start lies on the polynomial through the coordinates at other values of the
        parameter. If the drives must move to close a chain, their steps of least change
        depend on the start, which is then the nominal posture.
        """
        home, seen = self.nominal.q, self._seen
        moved = np.array([q - home for q in seen.values()]).reshape(-1, home.size)
        if not seen or (self.state is None and moved[:, self._held].any()):
            return home, bool(seen)
        nodes = np.array([0.0, *seen])
        weights = [
            np.prod((change - (others := np.delete(nodes, i))) / (x - others))
            for i, x in enumerate(nodes)
        ]
        return np.asarray(home + weights[1:] @ moved), False

    def _at(
        self, values: Mapping[str, float], start: Array, by_all: bool
    ) -> PostureStiffness | Equilibrium:
        if self.state is None:
            return self.parameters.at(values, start, by_all)
        elastic = self.parameters.mechanism(values)
        if elastic.has_open_rest:
            chosen = self.parameters.posture_of(elastic, self.state.start.q)
            elastic = with_rest_balancing(elastic, elastic.mechanism.closed(chosen))
        return again(self.state, elastic, start)

    def row(self, name: str, modes: Modes | None) -> Row:
        """Return the derivatives by one parameter, with the first step at which two
        orders agree.

        A small effect is computed again with a wider step, if two orders agree there as
        well.
        """
        best: Row | None = None
        refused: CartstiffError | None = None
        for step in numerics.EIGHTH_ORDER_STEPS:
            try:
                row = self._row(name, step, modes)
            except CartstiffError as error:
                refused = error
                continue
            if best is not None and row.error >= best.error:
                break  # smaller steps only increase the round-off
            best = row
            if best.error <= numerics.STALLED_RESIDUAL:
                break
        if best is None:
            raise refused or InputError(f"{name} cannot be varied")
        if (
            numerics.PRINTED_AS_ZERO < best.effect < numerics.NEGLIGIBLE_CHANGE
            and best.error <= numerics.STALLED_RESIDUAL
        ):
            with suppress(CartstiffError):
                row = self._row(name, numerics.WIDEST_EIGHTH_ORDER_STEP, modes)
                best = row if row.error <= numerics.STALLED_RESIDUAL else best
        return best

    def derivatives(
        self,
        names: Sequence[str],
        modes: Modes | None,
        given: Mapping[str, Row],
        progress: Callable[[int, int], None] | None,
    ) -> Sensitivities:
        """Return the derivatives by parameters, some given, and reasons for gaps."""
        if modes is not None and modes.spectrum.is_complex:
            raise UndefinedError(
                "modes that flutter have no sensitivities", code="flutter"
            )
        rows: dict[str, Row] = {}
        missing = [] if (left_out := self.parameters.left_out) is None else [left_out]
        for done, name in enumerate(names, 1):
            try:
                rows[name] = given.get(name) or self.row(name, modes)
            except CartstiffError as error:
                missing.append(f"{name} is not varied: {one_line(str(error), 200)}")
            if progress is not None:
                progress(done, len(names))
        k = 0 if modes is None else modes.frequencies.size
        squares = np.array([r.squares for r in rows.values()]).reshape(len(rows), k)
        return Sensitivities(
            tuple(rows),
            np.array([self.parameters.value(name) for name in rows]),
            {
                letter: np.array([r.matrices[i] for r in rows.values()]).reshape(-1, 6, 6)
                for i, letter in enumerate(MATRICES)
            },
            np.array([r.pose for r in rows.values()]).reshape(-1, 6),
            squares,
            squares if modes is None else in_hertz(modes, squares),
            np.array([r.error for r in rows.values()]),
            tuple(self.parameters.is_angle(name) for name in rows),
            "; ".join(missing) or None,
        )

    def _observed(self, modes: Modes | None) -> tuple[Array, ...]:
        if self._here is None:
            self._here = _observed(self.nominal, modes)
        return self._here

    def _row(self, name: str, share: float, modes: Modes | None) -> Row:
        natural = self.parameters.size(name)
        here = self._observed(modes)
        self._seen = {}

        def seen(change: float) -> Array:
            parts = _observed(self.at(name, change), modes)
            return np.concatenate([part.ravel() for part in parts])

        ends = np.cumsum([there.size for there in here])[:-1]
        slopes, errors = (
            [
                x.reshape(there.shape)
                for x, there in zip(np.split(flat, ends), here, strict=True)
            ]
            for flat in derivative_with_error(seen, share * natural)
        )
        return self.row_of(name, slopes, errors, modes)

    def row_of(
        self,
        name: str,
        slopes: Sequence[Array],
        errors: Sequence[Array],
        modes: Modes | None,
    ) -> Row:
        """Derivatives by one parameter, what is below round-off 0.

        `slopes` are those of the matrices (4, 6, 6), of the pose (4, 4), and of K and M
        on the modes (k, k); `errors` their errors.
        """
        here, natural = self._observed(modes), self.parameters.size(name)
        dK, dT, dH, dM = slopes
        R = self.nominal.pose[:3, :3]
        turn = dT[:3, :3] @ R.T
        pose = np.array([turn[2, 1], turn[0, 2], turn[1, 0], *dT[:3, 3]])
        squares = np.zeros(0) if modes is None else change_of_squares(modes, dH, dM)
        # The error of a matrix that does not depend on the parameter is relative to the
        # matrix.
        off = effect = 0.0
        for x, e, there in zip(slopes, errors, here, strict=True):
            size = max(_largest(x), _largest(there) / natural)
            if size > 0.0:
                off, effect = (
                    max(off, _largest(e) / size),
                    max(effect, _largest(x) / size),
                )
        # Entries below the round-off of their matrix are 0.
        noise = (
            max(numerics.ROUNDOFF_OF_SUMS, min(off, numerics.NEGLIGIBLE_DIFFERENCE))
            / natural
        )
        columns = np.repeat([1.0, self.nominal.posture.length], 3)
        energies = np.outer(columns, columns)
        for x, K in zip(dK, here[0], strict=True):
            size = max(natural * _largest(x * energies), _largest(K * energies))
            x[np.abs(x) <= noise * size / energies] = 0.0
        pose[np.abs(pose) <= noise * columns] = 0.0
        if modes is not None:
            least = max(noise, numerics.PRINTED_AS_ZERO / natural)
            squares[np.abs(squares) <= least * np.abs(modes.squares)] = 0.0
        return Row(dK, pose, squares, off, effect)


def _largest(values: Array) -> float:
    """Return the size of the largest finite entry; 0 without any."""
    return float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))


def _observed(
    state: PostureStiffness | Equilibrium, modes: Modes | None
) -> tuple[Array, ...]:
    """K^A, K^B, K^K, K^F; pose; K, M on the modes (k, k),
    moved so that they keep the closures.
    """
    result = state.stiffness if isinstance(state, Equilibrium) else state
    none = np.full((6, 6), np.nan)
    each = np.array(
        [none if (K := result.matrices[name]) is None else K for name in MATRICES]
    )
    if modes is None:
        return each, state.pose, np.zeros((0, 0)), np.zeros((0, 0))
    if isinstance(state, Equilibrium):
        K, C = state.full_stiffness
    else:
        closure = state.posture.closure
        K, C = (
            stiffness_under_load(state)[0],
            None if closure is None else closure.jacobian,
        )
    M = kinetic_matrix(state.posture, result.elastic.terms(), result.elastic.units)
    M = np.zeros_like(K) if M is None else M
    right, left = modes.basis @ modes.spectrum.vectors, modes.basis @ modes.spectrum.left
    if C is not None and len(C):
        columns = state.posture.coordinate_lengths
        back = columns[:, None] * np.linalg.pinv(
            (C * columns).astype(float), rcond=numerics.RANK
        )
        right, left = right - back @ (C @ right), left - back @ (C @ left)
    return each, state.pose, left.T @ K @ right, left.T @ M @ right


def change_of_squares(modes: Modes, dK: Array, dM: Array) -> Array:
    """Return d(omega^2) (k,) in 1/s^2 for changes (k, k) of the matrices on the modes."""
    squares = modes.spectrum.squares
    rates = np.empty(squares.size)
    for group in modes.groups:
        own = np.ix_(group, group)
        form = dK[own] - squares[group] * dM[own]
        rates[group] = np.sort(np.linalg.eigvals(form).real)
    return rates / modes.elastic.units.kilogram


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Result, LabelledResult):
    """Derivatives by all parameters.

    Attributes
    ----------
    names : tuple of str
        Names as in `cartstiff.analysis.tolerances.UncertainParameters.nominal`.
    values : ndarray (p,)
        Nominal values.
    stiffness : mapping of str to ndarray (p, 6, 6)
        dK/dp of K^A, K^B, K^K, K^F at M's origin, per unit of the parameter; NaN where
        the matrix does not exist. For an equilibrium K includes the part of its loads.
    pose : ndarray (p, 6)
        Rotation vector and displacement of M's origin along the axes of F, per unit.
    squares : ndarray (p, k)
        d(omega^2)/dp in 1/s^2 per unit; no columns where nothing has a mass.
    frequencies : ndarray (p, k)
        df/dp in Hz per unit; NaN where f is 0 or does not exist.
    errors : ndarray (p,)
        Bound of the relative error of each row of the matrices K and M.
    angles : tuple of bool
        Which parameters are angles, in rad.
    left_out : str or None
        Names of missing parameters, with reasons.
    """

    names: tuple[str, ...]
    values: Array
    stiffness: Mapping[str, Array]
    pose: Array
    squares: Array
    frequencies: Array
    errors: Array
    angles: tuple[bool, ...] = ()
    left_out: str | None = None

    def of(self, name: str) -> Array:
        """Return df/dp (k,) of a named parameter.

        Raises
        ------
        InputError
            For another name.
        """
        return self.frequencies[self.index(name)]

    def index(self, name: str) -> int:
        """Return the row of a named parameter; raises InputError for another name."""
        if name not in self.names:
            raise InputError(
                "unknown parameter", expected=", ".join(self.names), got=repr(name)
            )
        return self.names.index(name)

    def rows(self) -> dict[str, Row]:
        """Return all derivatives by each parameter."""
        each = np.stack([self.stiffness[letter] for letter in MATRICES], axis=1)
        zipped = zip(each, self.pose, self.squares, self.errors.tolist(), strict=True)
        return dict(zip(self.names, (Row(*row) for row in zipped), strict=True))

    @property
    def relative(self) -> Array:
        """Change (p, k) in Hz for one per cent of each parameter.

        NaN for parameters of zero.
        """
        return (
            0.01 * np.where(self.values, self.values, np.nan)[:, None] * self.frequencies
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data: derivatives per unit of each parameter, and Hz for one per cent."""
        data = {
            "left_out": self.left_out,
            "parameters": [
                {
                    "name": name,
                    "value": self.values[i],
                    "error": self.errors[i],
                    "stiffness": {
                        letter: _matrix(dK[i]) for letter, dK in self.stiffness.items()
                    },
                    "pose": self.pose[i],
                    "frequencies": self.frequencies[i],
                    "for_one_per_cent": self.relative[i],
                }
                for i, name in enumerate(self.names)
            ],
        }
        return plain_dict(data)

    def plot(self) -> Any:
        """Draw the parameters whose change by one per cent changes a frequency most.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        UndefinedError
            Code ``"no-mass"`` if nothing has a mass.
        MissingDependencyError
            Without matplotlib.
        """
        if not self.frequencies.size:
            raise UndefinedError(
                "nothing has a mass: no frequency changes", code="no-mass"
            )
        change = np.nan_to_num(np.abs(self.relative)).max(axis=1)
        most = [
            i for i in np.argsort(-change, kind="stable")[:_MAX_BARS] if change[i] > 0.0
        ]
        figure = new_figure()
        label = "largest change of a frequency for 1 per cent [Hz]"
        draw_bars(figure.subplots(), [self.names[i] for i in most], change[most], label)
        return figure


def _matrix(values: Array) -> Array | None:
    return values if np.isfinite(values).all() else None


def modes_of(subject: PostureStiffness | Equilibrium) -> Modes | None:
    """Return the modes of a result; None if nothing that moves has a mass."""
    kinds, expected = (
        (PostureStiffness, Equilibrium),
        "what analyse or equilibrium answers",
    )
    checked_kind(subject, kinds, "posture", expected)
    try:
        return modes(subject)
    except UndefinedError:
        return None


def in_hertz(modes: Modes, squares: Array) -> Array:
    """Convert changes (p, k) of omega^2 to Hz; NaN where f is 0 or does not exist."""
    with np.errstate(divide="ignore", invalid="ignore"):
        f = modes.frequencies
        return np.where(f > 0.0, squares / (8 * np.pi**2 * f), np.nan)


# Largest number of bars in a picture.
_MAX_BARS = 16
# Largest number of contributors listed for each number.
_MAX_CONTRIBUTORS = 3


@dataclass(frozen=True, eq=False, repr=False)
class Accuracy(LabelledResult):
    """Standard deviations that follow from tolerances, and the contributing parameters.

    Attributes
    ----------
    names : tuple of str
        Parameters with a tolerance, p of them.
    spreads : ndarray (p,)
        Their standard deviations, in their units.
    nominal, deviations : mapping of str to ndarray
        By quantity, to first order: "pose" (6,) for an equilibrium, the rotation vector
        and the position of M's origin along the axes of F; "A", "B", "K", "F" (6, 6) if
        they exist; "frequencies" (k,) in Hz.
    shares : mapping of str to ndarray
        Share (p, ...) of each parameter in the variance of each number; NaN for a
        variance of zero.
    level, factor : float
        Probability of an interval of `factor` deviations to both sides.
    left_out : str or None
        Names of parameters that are not varied, with reasons.
    """

    names: tuple[str, ...]
    spreads: Array
    nominal: Mapping[str, Array]
    deviations: Mapping[str, Array]
    shares: Mapping[str, Array]
    level: float
    factor: float
    left_out: str | None = None

    def main(
        self, quantity: str, index: int | tuple[int, ...]
    ) -> list[tuple[str, float]]:
        """The largest contributors to the variance of one number, with their shares."""
        shares = self.shares[quantity].T[index if isinstance(index, int) else index[::-1]]
        order = np.argsort(-np.nan_to_num(shares), kind="stable")[:_MAX_CONTRIBUTORS]
        least = numerics.NEGLIGIBLE_SHARE
        return [(self.names[i], float(shares[i])) for i in order if shares[i] > least]

    @property
    def interval(self) -> FrequencyInterval:
        """Interval of each frequency."""
        f, deviations = self.nominal["frequencies"], self.deviations["frequencies"]
        reach = self.factor * deviations
        return FrequencyInterval(deviations, f - reach, f + reach, self.level)

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        answer: dict[str, Any] = {}
        for quantity, sd in self.deviations.items():
            diagonal = [(i, i) if sd.ndim == 2 else (i,) for i in range(len(sd))]
            answer[quantity] = {
                "nominal": self.nominal[quantity],
                "deviation": sd,
                "main": [
                    [{"name": n, "share": x} for n, x in self.main(quantity, i)]
                    for i in diagonal
                ],
            }
        pairs = zip(self.names, self.spreads, strict=True)
        data = {
            "level": self.level,
            "factor": self.factor,
            "left_out": self.left_out,
            **answer,
            "parameters": [{"name": name, "deviation": x} for name, x in pairs],
        }
        return plain_dict(data)

    def plot(self) -> Any:
        """Draw the standard deviation of each number; of the matrices that of
        the diagonal.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure = new_figure(4.0 * len(self.deviations), 4.2)
        panels = figure.subplots(1, len(self.deviations), squeeze=False)[0]
        for axis, (quantity, sd) in zip(panels, self.deviations.items(), strict=True):
            shown = sd.diagonal() if sd.ndim == 2 else sd
            names: Sequence[str] = COMPONENTS["motion"]
            if quantity == "frequencies":
                names = [f"mode {i + 1}" for i in range(len(sd))]
            draw_bars(axis, names, shown, f"standard deviation of {quantity}")
        return figure


def deviations_of(
    home: Home,
    modes: Modes | None,
    level: float | None,
    rows: Mapping[str, Row],
    progress: Callable[[int, int], None] | None = None,
) -> Accuracy:
    """Standard deviations of all parameters with a tolerance.

    `rows` are known derivatives.
    """
    if level is None:
        identified = home.parameters.result.elastic.identified
        level = 0.95 if identified is None else identified.level
    check_level(level)
    named, R = home.parameters.named, home.parameters.correlation
    known = home.derivatives(list(named), modes, rows, progress)
    if not known.names:
        raise UndefinedError(known.left_out or "", code="no-parameters")
    varied = np.array([name in known.names for name in named])
    spreads = np.array([t.deviation for t in named.values()])[varied]
    R = (np.eye(len(named)) if R is None else R)[np.ix_(varied, varied)]
    nominal, slopes = {}, {}
    if home.state is not None:
        nominal["pose"], slopes["pose"] = home.state.displacement, known.pose
    for name, rates in known.stiffness.items():
        if (K := home.result.matrices[name]) is not None:
            nominal[name], slopes[name] = K, rates
    if modes is not None:
        nominal["frequencies"], slopes["frequencies"] = (
            modes.frequencies,
            known.frequencies,
        )
    deviations, shares = {}, {}
    for quantity, rates in slopes.items():
        x = (rates.T * spreads).T
        parts = x * np.tensordot(R, x, 1)
        variance = np.maximum(parts.sum(axis=0), 0.0)
        if quantity == "frequencies" and modes is not None:
            for alike in modes.groups:  # repeated frequencies split: see `intervals`
                parts[:, alike] = parts[:, alike].sum(axis=1, keepdims=True)
                variance[alike] = variance[alike].sum()
        with np.errstate(invalid="ignore", divide="ignore"):
            shares[quantity] = parts / np.where(variance > 0.0, variance, np.nan)
        deviations[quantity] = np.sqrt(variance)
    factor = quantile(level, home.parameters.degrees)
    return Accuracy(
        known.names, spreads, nominal, deviations, shares, level, factor, known.left_out
    )


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyInterval(Result, LabelledResult):
    """Interval of each frequency from tolerances and identified springs.

    Attributes
    ----------
    deviations : ndarray (k,)
        Standard deviations in Hz, to first order.
    low, high : ndarray (k,)
        Bounds of the interval.
    level : float
        Its probability, for normal deviations.
    """

    deviations: Array
    low: Array
    high: Array
    level: float

    def plot(self) -> Any:
        """Draw the interval of each frequency.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axes = new_axes()
        axes.hlines(range(1, len(self.low) + 1), self.low, self.high, linewidth=4.0)
        axes.set(
            xlabel=f"natural frequency [Hz], {100.0 * self.level:g} % interval",
            ylabel="mode",
        )
        axes.locator_params(axis="y", integer=True)
        axes.invert_yaxis()
        return figure


def intervals(
    modes: Modes,
    tolerances: Tolerances | None = None,
    *,
    compliance_covariance: ArrayLike | None = None,
    joints: tuple[str, ...] | None = None,
    level: float | None = None,
    given: Sensitivities | None = None,
) -> FrequencyInterval:
    """Intervals of the frequencies from tolerances, and from the covariance of
    identified springs.

    Repeated frequencies split under any change: each of them gets the variances of all,
    which bound ``tr F^2`` of the form F that splits them.

    Parameters
    ----------
    modes : Modes
        The modes.
    tolerances : Tolerances, optional
        Standard deviations, as for `accuracy`.
    compliance_covariance : array_like, shape (j, j), optional
        Covariance of the joints' compliances (``1/k``), as from ``cartstiff identify``;
        default that of the mechanism's file.
    joints : tuple of str, optional
        Their names; default all springs, in order.
    level : float, optional
        Probability between 0 and 1; default that of the measured springs, else 0.95.
    given : Sensitivities, optional
        Sensitivities of `modes`, if already computed.

    Raises
    ------
    InputError
        For a covariance of another shape or beside a tolerance of the stiffness, unknown
        joints, or a level outside (0, 1).
    """
    tolerances, identified = tolerances or Tolerances(), None
    if compliance_covariance is not None:
        if tolerances.stiffness > 0.0:
            raise InputError(
                "give a tolerance of the stiffness or a covariance, not both"
            )
        names = modes.elastic.spring_names if joints is None else joints
        patterns = tuple(CompliancePattern(name, ((name, name, 1.0),)) for name in names)
        elements = Elements(modes.elastic)
        compliances = elements.compliance.diagonal()[
            [elements.index(name) for name in names]
        ]
        C = checked_array(
            compliance_covariance, (len(names),) * 2, "covariance of compliances"
        )
        identified = Identified(patterns, compliances, C)
    home = Home(modes, tolerances=tolerances, identified=identified)
    rows = {} if given is None else given.rows()
    return deviations_of(home, modes, level, rows).interval
