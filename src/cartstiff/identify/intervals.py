r"""Intervals in compliance space, and what they say about stiffness.

An interval ``c -+ t s`` is cut at zero; its ends are 1/k. Where it reaches zero the stiffness has
no upper end: it is "at least" the lower one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartstiff.identify.least_squares import Solved
from cartstiff.identify.unknowns import Unknown, Unknowns

Verdict = Literal["determined", "at-least", "not-identifiable", "negative"]


@dataclass(frozen=True)
class Estimate:
    """What the rows say about one parameter.

    Attributes
    ----------
    unknown : Unknown
        The parameter.
    verdict : {"determined", "at-least", "not-identifiable", "negative"}
        A finite interval of the stiffness; one without an upper end; nothing; a compliance whose
        whole interval is below zero, which contradicts the model.
    compliance, deviation : float or None
        Estimate and standard deviation.
    interval : tuple of float or None
        Interval of the compliance.
    """

    unknown: Unknown
    verdict: Verdict
    compliance: float | None
    deviation: float | None
    interval: tuple[float, float] | None

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.unknown.name

    @property
    def stiffness(self) -> float | None:
        """1 / compliance, where that is above zero and known."""
        if self.compliance is None or not self.compliance > 0.0:
            return None
        if not self.unknown.has_stiffness or self.verdict == "negative":
            return None
        return 1.0 / self.compliance

    @property
    def stiffness_interval(self) -> tuple[float | None, float | None]:
        """Lower and upper end; None where there is none."""
        if self.interval is None or not self.unknown.has_stiffness:
            return None, None
        low, high = self.interval
        return (1.0 / high if high > 0.0 else None), (1.0 / low if low > 0.0 else None)


def quantile(level: float, degrees: float) -> float:
    """Two-sided quantile of Student's t; of the normal distribution for infinite degrees."""
    from scipy.special import ndtri, stdtrit

    tail = 0.5 + 0.5 * level
    return float(ndtri(tail) if np.isinf(degrees) else stdtrit(degrees, tail))


def estimates(
    solution: Solved, unknowns: Unknowns, level: float, inflation: float
) -> list[Estimate]:
    """One estimate per parameter.

    Parameters
    ----------
    solution : Solved
        The fit.
    unknowns : Unknowns
        What was fitted.
    level : float
        Probability of the intervals.
    inflation : float
        Factor on standard deviations where the scatter is larger than those given.
    """
    degrees = solution.degrees if inflation == 1.0 else min(solution.degrees, solution.freedom)
    t = quantile(level, degrees)
    answer = []
    for p, unknown in enumerate(unknowns.parameters):
        if not solution.is_determined[p]:
            answer.append(Estimate(unknown, "not-identifiable", None, None, None))
            continue
        s = float(np.sqrt(solution.covariance[p, p])) * inflation
        centre = float(solution.unbounded[p])
        low, high = centre - t * s, centre + t * s
        verdict: Verdict = "determined"
        if unknown.has_stiffness:
            if high < 0.0:
                verdict = "negative"
            elif low <= 0.0:
                verdict = "at-least"
            low, high = max(low, 0.0), max(high, 0.0)
        answer.append(Estimate(unknown, verdict, float(solution.theta[p]), s, (low, high)))
    return answer
