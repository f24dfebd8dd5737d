r"""What measurements say about springs: estimates with intervals in compliance space.

An interval ``c -+ t s`` is cut at zero; its ends are 1/k. Where it reaches zero the stiffness has
no upper end: it is "at least" the lower one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from cartstiff.arrays import Array
from cartstiff.identify.checks import Checks
from cartstiff.identify.fitting import Fit, Solved, quantile
from cartstiff.identify.linear_model import Model
from cartstiff.identify.measurements import Measurements
from cartstiff.identify.robust import Robust
from cartstiff.identify.unknowns import Unknown, Unknowns
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notes import Note

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


IDENTIFY_SCHEMA = "cartstiff-identify/1"


@dataclass(frozen=True)
class Rejected:
    """A row that was left out: its number from 1, and why."""

    row: int
    reason: str


@dataclass(frozen=True, eq=False)
class Identification:
    """Springs found from measurements.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism that was measured.
    unknowns : Unknowns
        What was sought.
    measured : Measurements
        The rows that were used.
    rows : int
        Rows of the table.
    rejected : tuple of Rejected
        Rows that were left out.
    model : Model
        Predictions and their derivatives.
    chosen, plain : Fit
        The fit whose estimates are told, and least squares on all rows used.
    robust : Robust
        The robust fit.
    estimates : tuple of Estimate
        One per parameter.
    checks : Checks
        Checks of the model.
    level : float
        Probability of the intervals.
    fit, offsets : str
        As asked for.
    loaded : bool
        Whether the equilibrium under load was fitted.
    inflation : float
        Factor on all standard deviations, as the scatter is larger than those given; else 1.
    notes : tuple of Note
        What was assumed and found.
    """

    elastic: ElasticMechanism
    unknowns: Unknowns
    measured: Measurements
    rows: int
    rejected: tuple[Rejected, ...]
    model: Model
    chosen: Fit
    plain: Fit
    robust: Robust
    estimates: tuple[Estimate, ...]
    checks: Checks
    level: float
    fit: str
    offsets: str
    loaded: bool
    inflation: float
    notes: tuple[Note, ...] = field(default=())

    @property
    def covariance(self) -> Array:
        """Covariance of the compliances (P, P); NaN where not identifiable."""
        return np.asarray(self.chosen.solved.covariance * self.inflation**2)

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the intervals."""
        solution = self.chosen.solved
        return (
            solution.degrees if self.inflation == 1.0 else min(solution.degrees, solution.freedom)
        )

    @property
    def suspects(self) -> list[int]:
        """Numbers of the rows that the robust fit suspects."""
        return [int(self.measured.rows[n]) for n in self.robust.suspects]

    @cached_property
    def mechanism(self) -> ElasticMechanism:
        """The mechanism with the springs found, and their covariance."""
        from cartstiff.identify.writing import with_result

        return with_result(self)

    def noise(self) -> dict[str, dict[str, Any]]:
        """Scatter of lengths and angles, each in its unit, by "length" and "angle"."""
        seen, solution = self.model.observations, self.chosen.solved
        answer = {}
        for g, name, unit in ((False, "length", self.elastic.units.length), (True, "angle", "rad")):
            mine = seen.is_angle == g
            if not mine.any():
                continue
            left = self.checks.left_out[mine]
            answer[name] = {
                "unit": unit,
                "count": int(mine.sum()),
                "residual_rms": _rms(solution.residual[mine]),
                "sigma": _rms(solution.deviation[mine]),
                "sigma_is_estimated": bool(np.isnan(seen.deviation[mine]).any()),
                "leave_one_out_rms": None if np.isnan(left).all() else _rms(left[~np.isnan(left)]),
            }
        return answer

    def weak_directions(self) -> list[dict[str, Any]]:
        """Combinations of springs that the rows do not see."""
        solution, names = self.chosen.solved, self.unknowns.names
        directions, count = solution.directions, len(solution.singular_values)
        lost = directions[:, self._rank() : count] if count else directions
        answer = []
        for i, vector in enumerate(lost.T):
            shares = vector[: len(names)]
            big = np.abs(shares) > 0.05
            answer.append(
                {
                    "singular_value": float(solution.singular_values[self._rank() + i]),
                    "springs": {names[p]: float(shares[p]) for p in np.flatnonzero(big)},
                }
            )
        return answer

    def _rank(self) -> int:
        from cartstiff import numerics

        return numerics.rank(self.chosen.solved.singular_values)

    def as_dict(self) -> dict[str, Any]:
        """The object printed by ``cartstiff identify --json``."""
        noise = self.noise()
        first = noise.get("length") or noise["angle"]
        C = self.covariance
        mechanism, units = self.elastic.mechanism, self.elastic.units
        robust = dict(zip(self.unknowns.names, self.robust.fit.theta, strict=True))
        plain = dict(zip(self.unknowns.names, self.plain.theta, strict=True))
        parameters = []
        for p, e in enumerate(self.estimates):
            known = self.chosen.solved.is_determined[p]
            parameters.append(
                {
                    "name": e.name,
                    "stiffness": e.stiffness,
                    "unit": e.unknown.unit,
                    "compliance": e.compliance,
                    "sd": e.deviation,
                    "interval": list(e.stiffness_interval),
                    "compliance_interval": None if e.interval is None else list(e.interval),
                    "identifiable": e.verdict == "determined",
                    "verdict": e.verdict,
                    "plain": float(plain[e.name]) if known else None,
                    "robust": float(robust[e.name]) if known else None,
                }
            )
        return {
            "schema": IDENTIFY_SCHEMA,
            "mechanism": {
                "name": self.elastic.name,
                "kind": mechanism.kind,
                "joints": list(self.elastic.names),
            },
            **mechanism.frames_as_dict(),
            "units": units.as_dict(),
            "model": "loaded equilibrium" if self.loaded else "linear in the load",
            "fit": self.fit,
            "level": self.level,
            "rows": self.rows,
            "used": [int(n) for n in self.measured.rows],
            "rejected": [vars(r) for r in self.rejected],
            "parameters": parameters,
            "covariance": [[None if np.isnan(x) else float(x) for x in row] for row in C],
            "degrees": None if np.isinf(self.degrees) else self.degrees,
            "residual_rms": first["residual_rms"],
            "sigma": first["sigma"],
            "leave_one_out_rms": first["leave_one_out_rms"],
            "noise": noise,
            "inflation": self.inflation,
            "suspects": self.suspects,
            "singular_values": self.chosen.solved.singular_values.tolist(),
            "unseen": self.weak_directions(),
            "checks": self.checks.as_dict(),
            "notes": [note.as_dict() for note in self.notes],
        }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
