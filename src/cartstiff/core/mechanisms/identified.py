r"""Uncertainty of measured springs: the covariance of their compliances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_array, fixed
from cartstiff.core.errors import InputError
from cartstiff.core.potentials.contract import BEAM, Number


def quantile(level: float, degrees: float) -> float:
    """Two-sided quantile of Student's t; of the normal distribution for infinite degrees.

    Half the width of an interval over the standard deviation.
    """
    from scipy.special import ndtri, stdtrit

    tail = 0.5 + 0.5 * level
    return float(ndtri(tail) if np.isinf(degrees) else stdtrit(degrees, tail))


def size_of_compliance(key: str, numbers: Mapping[str, Number]) -> float:
    """Natural size of one of a mechanism's compliances.

    Of one beside the diagonal the root of the product of those on it.
    """
    one, _, axis = key.partition("*")
    other = f"{one.rpartition('.')[0]}.{axis}" if axis else one
    return float(np.sqrt(abs(numbers[one].value * numbers[other].value)))


@dataclass(frozen=True)
class CompliancePattern:
    """A parameter that acts on some of `ElasticMechanism.compliances`.

    Attributes
    ----------
    name : str
        Name of the parameter.
    keys : tuple of (str, float)
        Names of compliances, and the change of each per unit of the parameter.
    """

    name: str
    keys: tuple[tuple[str, float], ...]

    @property
    def is_share(self) -> bool:
        """Whether the parameter is a share of a beam's own compliance:
        a number without unit.
        """
        return self.name.endswith(BEAM)

    @property
    def label(self) -> str:
        """Name with its kind: "compliance.NAME", or "coefficient.NAME"."""
        is_law = self.keys[0][0].rpartition(" x^")[0]
        return f"{'coefficient' if is_law else 'compliance'}.{self.name}"

    def changed(self, numbers: Mapping[str, Number], change: float) -> dict[str, float]:
        """The compliances that a change of the parameter changes."""
        return {key: numbers[key].value + weight * change for key, weight in self.keys}


@dataclass(frozen=True, eq=False)
class Identified:
    """Origin and uncertainty of a mechanism's measured stiffnesses.

    Attributes
    ----------
    patterns : tuple of CompliancePattern
        The measured compliances and coefficients of polynomial springs, in the
        mechanism's units.
    values : ndarray (P,)
        Their estimates; for a beam its share of the file's own compliance.
    covariance : ndarray (P, P)
        Covariance of the estimates.
    degrees : float or None
        Degrees of freedom of Student's t; None for a normal distribution.
    level : float
        Probability of the intervals.
    rows : int
        Number of measurements.
    date, source : str
        Date and source of the measurements.
    undetermined : tuple of str
        Springs whose stiffness the measurements do not determine.
    at_least : mapping of str to float
        Springs whose interval has no upper end, with its lower one.
    """

    patterns: tuple[CompliancePattern, ...]
    values: Array
    covariance: Array
    degrees: float | None = None
    level: float = 0.95
    rows: int = 0
    date: str = ""
    source: str = ""
    undetermined: tuple[str, ...] = ()
    at_least: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        P = len(self.patterns)
        C = checked_array(self.covariance, (P, P), "covariance of compliances")
        if numerics.asymmetry(C) or (C.diagonal() < 0.0).any():
            raise InputError(
                "covariance of compliances must be symmetric, variances not negative"
            )
        object.__setattr__(self, "covariance", fixed(0.5 * (C + C.T)))
        values = checked_array(self.values, (P,), "compliances")
        object.__setattr__(self, "values", fixed(values))

    @cached_property
    def factor(self) -> float:
        """Half width of an interval over the standard deviation."""
        return quantile(self.level, np.inf if self.degrees is None else self.degrees)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the compliances."""
        return tuple(pattern.name for pattern in self.patterns)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names with their kind."""
        return tuple(pattern.label for pattern in self.patterns)

    def scaled(self, numbers: Mapping[str, Number], a: float) -> Identified:
        """The same with all lengths times `a`, of compliances with these units."""
        size = {p.name: a ** numbers[p.keys[0][0]].length for p in self.patterns}
        factors = np.array([*size.values()])
        size |= {name: a**number.length for name, number in numbers.items()}
        return replace(
            self,
            values=self.values * factors,
            covariance=self.covariance * np.multiply.outer(factors, factors),
            at_least={name: k / size[name] for name, k in (self.at_least or {}).items()},
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "compliances": dict(zip(self.names, self.values.tolist(), strict=True)),
            "covariance": self.covariance.tolist(),
            "degrees": self.degrees,
            "level": self.level,
            "rows": self.rows,
            "date": self.date,
            "source": self.source,
            "undetermined": list(self.undetermined),
            "at_least": dict(self.at_least or {}),
        }
