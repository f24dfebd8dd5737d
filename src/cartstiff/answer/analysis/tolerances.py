"""Standard deviations of a mechanism's numbers, and what follows from them
to first order.

For measured springs the numbers are their compliances, with the covariance of the
measurement. Sorted eigenvalues have no derivative where two of them meet (symmetric
mechanisms).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cartstiff.answer.analysis.parameters import Parameters
from cartstiff.core.arrays import Array, checked_number
from cartstiff.core.errors import InputError, UndefinedError
from cartstiff.core.mechanisms.identified import quantile


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations for whole groups of parameters.

    Attributes
    ----------
    stiffness : float
        Standard deviation of every spring stiffness, relative to it (0.05: five per
        cent).
    length : float
        Standard deviation of every coordinate of a joint placement or an attachment
        point, in units of length; of every rest length, where a mechanism finds its rest
        by itself.
    angle : float
        Standard deviation of every small rotation of a joint placement, in radians; of
        every rest angle, where a mechanism finds its rest by itself.

    Raises
    ------
    InputError
        For negative numbers.
    """

    stiffness: float = 0.0
    length: float = 0.0
    angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("stiffness", "length", "angle"):
            value = checked_number(getattr(self, name), f"tolerance of the {name}")
            if value < 0:
                raise InputError(
                    f"tolerance of the {name} cannot be used",
                    expected="zero or more",
                    got=value,
                )

    @property
    def moves(self) -> bool:
        """Whether the geometry has any."""
        return max(self.length, self.angle) > 0.0


def check_level(level: float) -> None:
    """Refuse a level that is no probability of an interval."""
    if not 0.0 < level < 1.0:
        raise InputError("level cannot be used", expected="between 0 and 1", got=level)


class Uncertain(NamedTuple):
    """Numbers that are known up to a standard deviation.

    Attributes
    ----------
    names : tuple of str
        Names as of `cartstiff.answer.analysis.parameters`; "compliance.<spring>" where
        they were measured, with "coefficient.<joint> x^<power>" of polynomial springs.
    deviations : ndarray (p,)
        In the numbers' units.
    correlation : ndarray (p, p)
    degrees : float
        Degrees of freedom of Student's t of measured springs; infinite for given
        tolerances.
    """

    names: tuple[str, ...]
    deviations: Array
    correlation: Array
    degrees: float

    @classmethod
    def of(cls, parameters: Parameters, tolerances: Tolerances) -> Uncertain:
        """Those of a mechanism.

        Without a tolerance of the stiffness measured springs bring their own.

        Raises
        ------
        UndefinedError
            If no number has a deviation.
        """
        # Stiffnesses: a share of each, or the deviations of those that were measured.
        given, t = dict[str, float](), tolerances
        known = parameters.result.elastic.identified if t.stiffness == 0.0 else None
        for name, k in parameters.nominal.items():
            if t.stiffness > 0.0 and name.startswith("stiffness."):
                given[name] = t.stiffness * k
        C = np.zeros((0, 0)) if known is None else known.covariance
        labels = () if known is None else known.labels
        given |= dict(zip(labels, np.sqrt(C.diagonal()).tolist(), strict=True))
        # Places and angles; masses have no tolerance of their own.
        for name, number in parameters.numbers.items():
            deviation = t.angle if parameters.is_angle(name) else t.length
            if deviation > 0.0 and not number.is_positive:
                given[name] = deviation
        if not given:
            raise UndefinedError(
                "no parameter of this mechanism has a tolerance", code="no-parameters"
            )
        # Measured stiffnesses are correlated, the rest is independent.
        R, m = np.eye(len(given)), len(C)
        spread = np.sqrt(C.diagonal())
        spread[spread == 0.0] = 1.0
        R[:m, :m] = C / np.multiply.outer(spread, spread)
        np.fill_diagonal(R, 1.0)
        degrees = np.inf if known is None or known.degrees is None else known.degrees
        return cls(tuple(given), np.array([*given.values()]), R, degrees)

    def among(self, names: Sequence[str]) -> Uncertain:
        """Some of them, in their order."""
        kept = [self.names.index(name) for name in names]
        R = self.correlation[np.ix_(kept, kept)]
        return Uncertain(tuple(names), self.deviations[kept], R, self.degrees)

    def factor(self, level: float) -> float:
        """Half width of an interval over the standard deviation."""
        check_level(level)
        return quantile(level, self.degrees)

    def variances(self, slopes: Array) -> Array:
        """Part (p, ...) of each number in the variance of arrays with derivatives
        (p, ...).

        A part holds half of what the number has in common with each other one, and may be
        negative.
        """
        x = (slopes.T * self.deviations).T
        return x * np.tensordot(self.correlation, x, 1)


def shares_of(parts: Array) -> tuple[Array, Array]:
    """Standard deviation (...), and shares (p, ...) of the variance: NaN where that is
    zero.
    """
    variance = np.maximum(parts.sum(axis=0), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = parts / np.where(variance > 0.0, variance, np.nan)
    return np.sqrt(variance), shares
