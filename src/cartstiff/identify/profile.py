r"""Profile likelihood: intervals where the linear one misleads.

The sum of squares of a nonlinear fit with one parameter held at ``c -+ t s``, the others moved as
the linear fit says within their bounds, should have grown as it says, too. Where it has not, within
a tenth, the others are fitted anew along the parameter, and the interval ends where
``S(c) - S = t^2 sigma^2`` [BatesWatts]_.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError
from cartstiff.identify.fitting import SLACK, Fit, fitted
from cartstiff.identify.intervals import Estimate, quantile
from cartstiff.identify.least_squares import Noise
from cartstiff.identify.linear_model import Model
from cartstiff.identify.measurements import Measurements
from cartstiff.identify.sessions import nuisance_of
from cartstiff.identify.unknowns import Unknowns

_TELLING = 0.1
# Intervals of a parameter known better than this are not looked at: nothing bends within them.
_NARROW = 0.05
_EVALUATIONS = 12
# Rows whose equilibria are found, in all, beyond which the intervals left stay linear: so many
# rows times coordinates, and what a row costs besides in coordinates.
_BUDGET, _LEAST = 100_000, 20


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
    told: Sequence[Estimate],
    model: Model,
    unknowns: Unknowns,
    fit: Fit,
    measured: Measurements,
    offsets: str,
    level: float,
) -> list[Estimate]:
    """Estimates with profile intervals where the model bends within the linear ones.

    The widest are looked at first, as far as a budget of equilibria reaches. Where the model bends
    and no budget is left for the profile, no interval is told.
    """
    seen, solution, sizes = model.observations, fit.solved, unknowns.sizes
    cost_of_all = len(measured) * (_LEAST + measured.q.shape[1])
    model = _Counted(model, max(_BUDGET // cost_of_all, len(told)))
    nuisance = nuisance_of(seen, measured, offsets).columns
    fixed_noise = Noise(solution.deviation, seen.is_angle.astype(np.intp), (True, True))
    t = quantile(level, solution.degrees)
    prior = [(p, *u.prior) for p, u in enumerate(unknowns.parameters) if u.prior is not None]

    N = nuisance / solution.deviation[:, None]

    def apart(of: Array, theta: Array) -> Array:
        """Residuals and deviations from priors, without what nuisances explain."""
        r = of / solution.deviation
        if N.size:
            r = r - N @ np.linalg.lstsq(N, r, rcond=None)[0]
        return np.append(r, [(theta[p] - value) / s for p, value, s in prior])

    def cost(theta: Array) -> float:
        r = apart(model.at(theta)[0] - seen.target, theta)
        return float(r @ r)

    start = apart(model.at(fit.theta)[0] - seen.target, fit.theta)
    none = np.zeros(len(fit.theta))
    rates = np.column_stack(
        [apart(column, none) - apart(np.zeros(len(seen)), none) for column in fit.regressor.T]
    )
    for row, (p, _, s) in enumerate(prior):
        rates[len(seen) + row, p] = 1.0 / s
    least = float(start @ start)
    linear = _Linear(fit.theta, start, rates, unknowns.is_bounded, sizes)
    answer, bent = list(told), []
    widest = sorted(range(len(told)), key=lambda p: -(told[p].deviation or 0.0) / sizes[p])
    for p in widest:
        e = told[p]
        narrow = e.deviation is not None and e.deviation < _NARROW * abs(float(fit.theta[p]))
        if e.verdict not in ("determined", "at-least") or e.deviation is None or narrow:
            continue
        try:
            if _bends(linear, p, t * e.deviation, t * t, cost):
                bent.append(p)
        except _Spent:
            answer[p] = replace(e, method="linear, not looked at")
    for p in reversed(bent):  # the narrowest take least
        e = told[p]
        try:
            low, high = (
                _end(
                    model,
                    unknowns,
                    fixed_noise,
                    nuisance,
                    fit.theta,
                    p,
                    e.deviation or 0.0,
                    side,
                    t,
                    cost,
                    least,
                )
                for side in (-1.0, 1.0)
            )
        except _Spent:
            answer[p] = Estimate(
                e.unknown, "not-identifiable", None, None, None, "profile, too long"
            )
            continue
        verdict = e.verdict
        if unknowns.is_bounded[p]:
            verdict = "at-least" if low <= 0.0 else "determined"
            low = max(low, 0.0)
        answer[p] = replace(e, interval=(low, high), verdict=verdict, method="profile")
    return answer


@dataclass(frozen=True, eq=False)
class _Linear:
    """The linear model about a fit: residuals `start` there, and their derivatives `rates`."""

    theta: Array
    start: Array
    rates: Array
    bounded: NDArray[np.bool_]
    sizes: Array

    def beside(self, p: int, value: float) -> tuple[Array, float]:
        """Parameters of the least sum of squares with one held, within bounds; that sum."""
        from scipy.optimize import lsq_linear

        others = np.arange(len(self.theta)) != p
        scaled = self.rates * self.sizes
        r = self.start + self.rates[:, p] * (value - self.theta[p])
        R: Array = np.asarray(np.linalg.qr(np.column_stack([scaled[:, others], r]), mode="r"))
        count = int(others.sum())
        A = np.vstack([R[:, :-1], np.eye(count) / SLACK])
        z = (self.theta / self.sizes)[others]
        lower = np.where(self.bounded[others], np.minimum(-z, -numerics.TINY), -np.inf)
        move = lsq_linear(
            A,
            np.append(-R[:, -1], np.zeros(count)),
            (lower, np.inf),
            "bvls",
            tol=numerics.LAST_DIGITS,
            max_iter=10 * A.shape[1],
        ).x
        theta = self.theta.copy()
        theta[p] = value
        theta[others] = np.maximum(z + move, lower + z) * self.sizes[others]
        after = r + scaled[:, others] @ move
        return theta, float(after @ after)


def _bends(
    linear: _Linear, p: int, half: float, square: float, cost: Callable[[Array], float]
) -> bool:
    """Whether the sum of squares grows otherwise than a linear model says, up to the interval."""
    least = float(linear.start @ linear.start)
    for side in (1.0, -1.0):
        value = float(linear.theta[p]) + side * half
        if linear.bounded[p] and value <= 0.0:
            continue
        theta, expected = linear.beside(p, value)
        try:
            actual = cost(theta)
        except CartstiffError:
            return True
        if abs(actual - expected) > _TELLING * max(square, expected - least):
            return True
    return False


def _end(
    model: Model,
    unknowns: Unknowns,
    noise: Noise,
    nuisance: Array,
    theta: Array,
    p: int,
    deviation: float,
    side: float,
    t: float,
    cost: Callable[[Array], float],
    least: float,
) -> float:
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
