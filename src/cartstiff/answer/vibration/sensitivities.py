"""Derivatives of stiffness, pose and frequencies by each number of a mechanism,
and standard deviations that follow from them.

Frequencies may cross, so that their derivatives follow from those of the matrices on the
left and right modes psi, phi, which are moved so that they keep the closures: with
``psi^T M phi = 1``

    d(omega^2)/dp = d(psi^T K phi)/dp - omega^2 d(psi^T M phi)/dp

For repeated modes the derivatives are the eigenvalues of that form on the subspace, in
order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cartstiff.answer.vibration.modes import Modes, modes
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result, plain_dict
from cartstiff.core.errors import InputError, UndefinedError, checked_kind
from cartstiff.core.figures import draw_bars, new_axes, new_figure
from cartstiff.core.results import LabelledResult
from cartstiff.core.statics.rest import Equilibrium
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.tensor import COMPONENTS

MATRICES = ("A", "B", "K", "F")


def change_of_squares(modes: Modes, dK: Array, dM: Array) -> Array:
    """Return d(omega^2) (..., k) in 1/s^2 for changes (..., k, k) of the matrices on the
    modes.
    """
    squares = modes.spectrum.squares
    rates = np.empty(dK.shape[:-1])
    for group in modes.groups:
        own = np.array(group)
        of_K, of_M = (x[..., own[:, None], own] for x in (dK, dM))
        form = of_K - squares[group] * of_M
        rates[..., group] = np.sort(np.linalg.eigvals(form).real)
    return rates / modes.elastic.units.kilogram


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Result, LabelledResult):
    """Derivatives by all parameters.

    Attributes
    ----------
    names : tuple of str
        Names as in `cartstiff.answer.analysis.parameters`.
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
        """Derivatives df/dp (k,) of the k natural frequencies by a named parameter, in Hz
        per its unit.

        Raises
        ------
        InputError
            For another name, or without frequencies, as of a posture: the derivatives
            of its matrices are in `stiffness`.
        """
        if not self.frequencies.size:
            raise InputError(
                "these derivatives are not of frequencies",
                expected="those of cartstiff.modes; of a posture read `stiffness`",
            )
        return self.frequencies[self.index(name)]

    def index(self, name: str) -> int:
        """Return the row of a named parameter; raises InputError for another name."""
        if name not in self.names:
            raise InputError(
                "unknown parameter", expected=", ".join(self.names), got=repr(name)
            )
        return self.names.index(name)

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

    def plot(self, ax: Any = None) -> Any:
        """Draw the parameters whose change by one per cent changes a frequency most.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

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
        figure, axis = new_axes(ax=ax)
        label = "largest change of a frequency for 1 per cent [Hz]"
        draw_bars(axis, [self.names[i] for i in most], change[most], label)
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
    with numerics.silent():
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

    def plot(self, ax: Any = None) -> Any:
        """Draw the standard deviation of each number; of the matrices that of
        the diagonal.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure = new_figure(4.0 * len(self.deviations), 4.2, ax=ax)
        panels = figure.subplots(1, len(self.deviations), squeeze=False)[0]
        for axis, (quantity, sd) in zip(panels, self.deviations.items(), strict=True):
            shown = sd.diagonal() if sd.ndim == 2 else sd
            names: Sequence[str] = COMPONENTS["motion"]
            if quantity == "frequencies":
                names = [f"mode {i + 1}" for i in range(len(sd))]
            draw_bars(axis, names, shown, f"standard deviation of {quantity}")
        return figure


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

    def plot(self, ax: Any = None) -> Any:
        """Draw the interval of each frequency.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axes = new_axes(ax=ax)
        axes.hlines(range(1, len(self.low) + 1), self.low, self.high, linewidth=4.0)
        axes.set(
            xlabel=f"natural frequency [Hz], {100.0 * self.level:g} % interval",
            ylabel="mode",
        )
        axes.locator_params(axis="y", integer=True)
        axes.invert_yaxis()
        return figure
