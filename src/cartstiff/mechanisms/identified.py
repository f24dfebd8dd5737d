"""What is known of springs that were measured: the covariance of their compliances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array, checked_array, fixed
from cartstiff.errors import InputError
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import CompliancePattern, Elements

# Relative change of the compliances between which differences are taken.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Identified:
    """Where a mechanism's stiffnesses come from, and how well they are known.

    Attributes
    ----------
    patterns : tuple of CompliancePattern
        The compliances that were found, in the mechanism's units.
    values : ndarray (P,)
        Their estimates; of a beam its share of the file's own.
    covariance : ndarray (P, P)
        Covariance of the estimates.
    degrees : float or None
        Degrees of freedom of Student's t; None for a normal distribution.
    level : float
        Probability of the intervals that are told.
    rows : int
        Measurements they rest on.
    date, source : str
        When, and from what.
    undetermined : tuple of str
        Springs whose stiffness in the file is no finding: the rows said nothing about them.
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
        size = abs(C).max(initial=0.0)
        if abs(C - C.T).max(initial=0.0) > numerics.SYMMETRY * size or (C.diagonal() < 0.0).any():
            raise InputError("covariance of compliances must be symmetric, variances not negative")
        object.__setattr__(self, "covariance", fixed(0.5 * (C + C.T)))
        values = checked_array(self.values, (P,), "compliances")
        object.__setattr__(self, "values", fixed(values))

    @cached_property
    def factor(self) -> float:
        """Half width of an interval over the standard deviation."""
        from scipy.special import ndtri, stdtrit

        tail = 0.5 + 0.5 * self.level
        return float(ndtri(tail) if self.degrees is None else stdtrit(self.degrees, tail))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the compliances."""
        return tuple(pattern.name for pattern in self.patterns)

    def scaled(self, elements: Elements, a: float) -> Identified:
        """The same with all lengths times `a`; `elements` are those of the mechanism."""
        size = dict(zip(elements.names, np.where(elements.is_length, a, 1.0), strict=True))

        def per(one: str, other: str) -> float:
            """A deflection over an effort: moments are a times as large, forces stay."""
            return float(size[one] * size[other] / a)

        factors, patterns = [], []
        for pattern in self.patterns:
            # Of a beam the value is a share of the file's own, whatever the units.
            factor = 1.0 if pattern.is_share else per(*pattern.entries[0][:2])
            factors.append(factor)
            patterns.append(CompliancePattern(pattern.name, tuple(
                (i, j, weight * per(i, j) / factor) for i, j, weight in pattern.entries
            )))  # fmt: skip
        # Ties have a name of their own, and so have axes of a link.
        of = {name: per(name, name) for name in size} | dict(zip(self.names, factors, strict=True))
        least = {name: k / of[name] for name, k in (self.at_least or {}).items()}
        return replace(
            self, patterns=tuple(patterns), values=self.values * factors,
            covariance=self.covariance * np.multiply.outer(factors, factors), at_least=least,
        )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
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


class Neighbours(NamedTuple):
    """Two mechanisms on both sides of one with measured springs.

    Attributes
    ----------
    more, less : ElasticMechanism
        With compliances to both sides along one principal direction of their covariance.
    per : float
        Change of a number for one standard deviation along it, over that between the two.
    """

    more: ElasticMechanism
    less: ElasticMechanism
    per: float


def neighbours(elastic: ElasticMechanism) -> list[Neighbours]:
    r"""Mechanisms around one with measured springs: they carry the covariance to any number.

    With ``Sigma = sum h_k h_k^T`` a number f has, to first order, the variance
    ``sum (df/dc . h_k)^2``: central differences along each h_k, so that what covaries does.

    Returns
    -------
    list of Neighbours
        None for a mechanism whose springs were not measured.
    """
    known = elastic.identified
    if known is None:
        return []
    elements = Elements(elastic)
    patterns, nominal = elements.patterns(known.patterns), elements.compliance
    own = np.sqrt(np.diag(nominal))
    variances, directions = np.linalg.eigh(known.covariance)
    pairs = []
    for variance, direction in zip(variances, directions.T, strict=True):
        if not variance > 0.0:
            continue
        change = np.tensordot(np.sqrt(variance) * direction, patterns, axes=1)
        largest = float(np.abs(change / np.multiply.outer(own, own)).max(initial=0.0))
        if not largest > 0.0:
            continue
        step = _STEP / largest * change
        more, less = (elements.with_compliance(nominal + sign * step) for sign in (1.0, -1.0))
        pairs.append(Neighbours(more, less, 0.5 * largest / _STEP))
    return pairs
