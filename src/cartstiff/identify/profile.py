r"""Profile likelihood: intervals where the linear one misleads.

The sum of squares of a nonlinear fit with one parameter held at ``c -+ t s``, the others moved as
the linear fit says, should have grown by ``t^2 sigma^2``. Where it has not, within a tenth, the
others are fitted anew along the parameter, and the interval ends where
``S(c) - S = t^2 sigma^2`` [BatesWatts]_.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError
from cartstiff.identify.fitting import Fit, fitted
from cartstiff.identify.intervals import Estimate, quantile
from cartstiff.identify.least_squares import Noise
from cartstiff.identify.linear_model import Model
from cartstiff.identify.measurements import Measurements
from cartstiff.identify.sessions import nuisance_of
from cartstiff.identify.unknowns import Unknowns

__all__ = ["with_profiles"]

_TELLING = 0.1
# Intervals of a parameter known better than this are not looked at: nothing bends within them.
_NARROW = 0.05
_EVALUATIONS = 12
# Rows whose equilibria are found, in all, beyond which the intervals left stay linear.
_BUDGET = 4000


class _Spent(Exception):  # noqa: N818 - no error: the budget is
    """No more evaluations."""


class _Counted:
    """A model that stops when its evaluations are spent."""

    def __init__(self, model: Model, left: int) -> None:
        self._model, self._left = model, left
        self.observations, self.is_linear = model.observations, model.is_linear

    def at(self, theta: Array) -> tuple[Array, Array]:
        """As of the model."""
        self._left -= 1
        if self._left < 0:
            raise _Spent
        return self._model.at(theta)


def with_profiles(
    told: Sequence[Estimate], model: Model, unknowns: Unknowns, fit: Fit, measured: Measurements,
    offsets: str, level: float,
) -> list[Estimate]:  # fmt: skip
    """Estimates with profile intervals where the model bends within the linear ones.

    The widest are looked at first, as far as a budget of equilibria reaches.
    """
    seen, found, sizes = model.observations, fit.solved, unknowns.sizes
    model = _Counted(model, max(_BUDGET // len(measured), 4))
    nuisance = nuisance_of(seen, measured, offsets).columns
    fixed_noise = Noise(found.deviation, seen.is_angle.astype(np.intp), (True, True))
    t = quantile(level, found.degrees)
    prior = [(p, *u.prior) for p, u in enumerate(unknowns.parameters) if u.prior is not None]

    def cost(theta: Array) -> float:
        y, _ = model.at(theta)
        r = (seen.target - y) / found.deviation
        if nuisance.size:
            N = nuisance / found.deviation[:, None]
            r = r - N @ np.linalg.lstsq(N, r, rcond=None)[0]
        extra = sum(((theta[p] - value) / s) ** 2 for p, value, s in prior)
        return float(r @ r + extra)

    least = cost(fit.theta)
    answer = list(told)
    widest = sorted(range(len(told)), key=lambda p: -(told[p].deviation or 0.0) / sizes[p])
    for p in widest:
        e = told[p]
        narrow = e.deviation is not None and e.deviation < _NARROW * abs(float(fit.theta[p]))
        if e.verdict not in ("determined", "at-least") or e.deviation is None or narrow:
            continue
        try:
            answer[p] = _looked_at(
                model, unknowns, fixed_noise, nuisance, fit, p, e, t, cost, least
            )
        except _Spent:
            answer[p] = replace(e, method="linear, not looked at")
    return answer


def _looked_at(
    model: Model, unknowns: Unknowns, noise: Noise, nuisance: Array, fit: Fit, p: int, e: Estimate,
    t: float, cost: Callable[[Array], float], least: float,
) -> Estimate:  # fmt: skip
    """The estimate of one parameter, with its profile's interval where the model bends."""
    found = fit.solved
    deviation = e.deviation or 0.0
    slope = np.nan_to_num(found.covariance[:, p] / found.covariance[p, p])
    bends = False
    for side in (-1.0, 1.0):
        theta = fit.theta + side * t * deviation * slope
        if np.any(theta[unknowns.is_bounded] <= 0.0):
            continue
        try:
            grown = cost(theta) - least
        except CartstiffError:
            bends = True
            continue
        bends |= abs(grown - t * t) > _TELLING * t * t
    if not bends:
        return e
    low, high = (
        _end(model, unknowns, noise, nuisance, fit.theta, p, deviation, side, t, cost, least)
        for side in (-1.0, 1.0)
    )
    verdict = e.verdict
    if unknowns.is_bounded[p]:
        verdict = "at-least" if low <= 0.0 else "determined"
        low = max(low, 0.0)
    return replace(e, interval=(low, high), verdict=verdict, method="profile")


def _end(
    model: Model, unknowns: Unknowns, noise: Noise, nuisance: Array, theta: Array, p: int,
    deviation: float, side: float, t: float, cost: Callable[[Array], float], least: float,
) -> float:  # fmt: skip
    """Where the profile has grown by t^2: secant steps in its root, which is nearly linear."""
    start, reach, last = theta.copy(), t, (0.0, 0.0)
    for _ in range(_EVALUATIONS):
        value = float(theta[p] + side * reach * deviation)
        if unknowns.is_bounded[p] and value <= 0.0:
            if last[0] == 0.0 or last[1] < t:
                return 0.0
            value = 0.5 * float(theta[p] + side * last[0] * deviation)
            reach = abs(value - theta[p]) / deviation
        try:
            one = fitted(model, unknowns, noise, nuisance=nuisance, start=start, fixed=(p, value))
            root = np.sqrt(max(cost(one.theta) - least, 0.0))
        except CartstiffError:
            reach = 0.5 * (reach + last[0])
            continue
        start = one.theta
        if abs(root - t) < 0.005 * t:
            return value
        slope = (root - last[1]) / (reach - last[0]) if reach != last[0] else 1.0
        last = (reach, root)
        reach = reach + (t - root) / max(slope, 0.1)
    return float(theta[p] + side * last[0] * deviation)
