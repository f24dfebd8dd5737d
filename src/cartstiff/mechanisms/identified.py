r"""What is known of springs that were measured: the covariance of their compliances.

The torque t of a polynomial spring ``t = c_1 x + c_2 x^2 + ...`` stays where a load stays. With its
tangent stiffness k and that one's slope k' over the deflection, its compliance there changes by
``d(1/k)/dc_m = -(m x^(m-1) - k' x^m / k) / k^2``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array, checked_array, fixed
from cartstiff.errors import InputError, UndefinedError
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import CompliancePattern, Elements, law_of
from cartstiff.potentials.springs import JointSprings


@dataclass(frozen=True, eq=False)
class Identified:
    """Where a mechanism's stiffnesses come from, and how well they are known.

    Attributes
    ----------
    patterns : tuple of CompliancePattern
        The compliances, and coefficients of polynomial springs, that were found, in the mechanism's
        units.
    values : ndarray (P,)
        Their estimates; of a beam its share of the file's own.
    covariance : ndarray (P, P)
        Covariance of the estimates.
    degrees : float or None
        Degrees of freedom of Student's t; None for a normal distribution.
    level : float
        Probability of the intervals.
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

    @cached_property
    def roots(self) -> Array:
        """Columns h (P, k) with ``Sigma = sum h h^T``; found in shares of each deviation.

        Compliances and coefficients of polynomials differ by many powers of ten.
        """
        s = np.sqrt(self.covariance.diagonal())
        per = np.where(s > 0.0, 1.0 / np.where(s > 0.0, s, 1.0), 0.0)
        variances, axes = np.linalg.eigh(self.covariance * np.multiply.outer(per, per))
        there = variances > 0.0
        return fixed(s[:, None] * axes[:, there] * np.sqrt(variances[there]))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the compliances."""
        return tuple(pattern.name for pattern in self.patterns)

    @property
    def labels(self) -> tuple[str, ...]:
        """The same with what each of them is: "compliance.NAME", or "coefficient.NAME"."""
        return tuple(
            f"{'coefficient' if p.law and p.law[1] > 1 else 'compliance'}.{p.name}"
            for p in self.patterns
        )

    def scaled(self, elements: Elements, a: float) -> Identified:
        """The same with all lengths times `a`; `elements` are those of the mechanism."""
        size = dict(zip(elements.names, np.where(elements.is_length, a, 1.0), strict=True))
        for c in elements.elastic.mechanism.coordinates:  # those with polynomials are no elements
            size.setdefault(c.name, a if c.is_length else 1.0)

        def per(one: str, other: str) -> float:
            """A deflection over an effort: moments are a times as large, forces stay."""
            return float(size[one] * size[other] / a)

        factors, patterns = [], []
        for pattern in self.patterns:
            # Of a beam the value is a share of the file's own, whatever the units.
            if pattern.law is not None:
                name, power = pattern.law
                factor = per(name, name) if power == 1 else float(a / size[name] ** (power + 1))
            else:
                factor = 1.0 if pattern.is_share else per(*pattern.entries[0][:2])
            factors.append(factor)
            patterns.append(
                replace(
                    pattern,
                    entries=tuple(
                        (i, j, weight * per(i, j) / factor) for i, j, weight in pattern.entries
                    ),
                )
            )
        # Ties have a name of their own, and so have axes of a link.
        of = {name: per(name, name) for name in size} | dict(zip(self.names, factors, strict=True))
        least = {name: k / of[name] for name, k in (self.at_least or {}).items()}
        return replace(
            self,
            patterns=tuple(patterns),
            values=self.values * factors,
            covariance=self.covariance * np.multiply.outer(factors, factors),
            at_least=least,
        )

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


def linearised(elastic: ElasticMechanism, q: Array) -> ElasticMechanism:
    """The mechanism with polynomial springs that were measured linear about coordinates q (n,).

    What is known of their coefficients becomes what is known of their compliances there, under
    torques that stay.

    Raises
    ------
    UndefinedError
        Where such a spring does not resist.
    """
    known, springs = elastic.identified, elastic.springs
    laws = {} if known is None else {p.law: i for i, p in enumerate(known.patterns) if p.law}
    if known is None or not laws or not isinstance(springs, JointSprings):
        return elastic
    k, rest, left = springs.stiffness.copy(), springs.rest.copy(), dict(springs.laws)
    others = [i for i in range(len(known.patterns)) if i not in laws.values()]
    patterns, rows = (
        [known.patterns[i] for i in others],
        [np.eye(len(known.patterns))[i] for i in others],
    )
    for name in dict.fromkeys(name for name, _ in laws):
        j, law = elastic.names.index(name), law_of(elastic, name)
        x = 0.0 if np.isnan(rest[j]) else float(q[j] - rest[j])
        _, torque, k[j] = law.at(x)
        if not k[j] > 0.0:
            raise UndefinedError(
                f"the measured spring of {name!r} does not resist here: no interval",
                code="no-compliance",
            )
        rest[j] -= torque / k[j] - x  # the same torque here
        del left[j]
        row = np.zeros(len(known.patterns))
        for (joint, power), i in laws.items():
            if joint == name:
                by = law.change_at_torque(power, x)
                row[i] = -by / k[j] ** 2 * (-(law.coefficients[0] ** 2) if power == 1 else 1.0)
        patterns.append(CompliancePattern(name, ((name, name, 1.0),)))
        rows.append(row)
    T = np.array(rows)
    values = np.append(
        known.values[others],
        [1.0 / k[elastic.names.index(p.name)] for p in patterns[len(others) :]],
    )
    tangent = replace(
        known, patterns=tuple(patterns), values=values, covariance=T @ known.covariance @ T.T
    )
    springs = JointSprings(k, rest, left, springs.rigid)
    return replace(elastic, springs=springs, identified=tangent)
