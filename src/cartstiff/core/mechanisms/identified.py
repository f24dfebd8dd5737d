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

#: Suffix of parameters that are shares of a beam's own compliance.
BEAM = " (beam)"


def quantile(level: float, degrees: float = np.inf) -> float:
    """Two-sided quantile of Student's t; of the normal distribution for infinite degrees.

    Half the width of an interval over the standard deviation.
    """
    from scipy.special import ndtri, stdtrit

    tail = 0.5 + 0.5 * level
    return float(ndtri(tail) if np.isinf(degrees) else stdtrit(degrees, tail))


def _per(size: Mapping[str, float], a: float, one: str, other: str) -> float:
    """Factor of a deflection over an effort: moments become a times as large."""
    return float(size[one] * size[other] / a)


@dataclass(frozen=True)
class CompliancePattern:
    """The elements on which a compliance parameter acts, as a symmetric matrix S.

    Attributes
    ----------
    name : str
        Name of the parameter.
    entries : tuple of (str, str, float)
        Names of two elements and S there; S is symmetric, and each pair occurs once.
    law : (str, int), optional
        Joint and power of the deflection of a polynomial spring, in place of entries. The
        value of the first power is a compliance, those of others are coefficients of the
        torque.
    """

    name: str
    entries: tuple[tuple[str, str, float], ...]
    law: tuple[str, int] | None = None

    @property
    def is_share(self) -> bool:
        """Whether the parameter is a share of a beam's own compliance:
        a number without unit.
        """
        return self.name.endswith(BEAM)

    @property
    def is_diagonal(self) -> bool:
        """Whether S is diagonal, so that the parameter cannot be negative."""
        if self.law is not None:
            return self.law[1] == 1
        return all(a == b and weight > 0 for a, b, weight in self.entries)

    def factor(self, size: Mapping[str, float], a: float) -> float:
        """Factor of the value if lengths are times `a`, and deflections times `size`."""
        if self.law is not None:
            name, power = self.law
            if power > 1:
                return float(a / size[name] ** (power + 1))
            return _per(size, a, name, name)
        # A beam's value is a share of the file's own, which has no unit.
        return 1.0 if self.is_share else _per(size, a, *self.entries[0][:2])

    def scaled(
        self, size: Mapping[str, float], a: float, factor: float
    ) -> CompliancePattern:
        """The pattern where the value is times `factor`, see `factor`."""
        entries = [(i, j, s * _per(size, a, i, j) / factor) for i, j, s in self.entries]
        return replace(self, entries=tuple(entries))


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
        """Names with their kind: "compliance.NAME", or "coefficient.NAME"."""
        return tuple(
            f"{'coefficient' if p.law and p.law[1] > 1 else 'compliance'}.{p.name}"
            for p in self.patterns
        )

    def scaled(self, lengths: Mapping[str, bool], a: float) -> Identified:
        """Return it with all lengths times `a`.

        `lengths` says which springs deflect by one.
        """
        size = {name: a if is_length else 1.0 for name, is_length in lengths.items()}
        factors = [pattern.factor(size, a) for pattern in self.patterns]
        pairs = zip(self.patterns, factors, strict=True)
        # Parameters of several springs have names of their own, and axes of a link have.
        of = {name: _per(size, a, name, name) for name in size}
        of |= zip(self.names, factors, strict=True)
        least = {name: k / of[name] for name, k in (self.at_least or {}).items()}
        return replace(
            self,
            patterns=tuple(pattern.scaled(size, a, factor) for pattern, factor in pairs),
            values=self.values * factors,
            covariance=self.covariance * np.multiply.outer(factors, factors),
            at_least=least,
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
