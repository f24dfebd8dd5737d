"""Nonlinear least squares within bounds by SciPy; one linear step where a model is linear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError, ConvergenceError
from cartstiff.identify.least_squares import Noise, Solved, solved
from cartstiff.identify.linear_model import Model
from cartstiff.identify.unknowns import Unknowns

# Evaluations of a search; searches, in which the scales of lengths and angles settle.
_STEPS, _ROUNDS = 200, 6
#: Relative change of the scales that ends the searches.
_SAME = 1e-3
#: Sizes beyond which a parameter is not determined; and the standard deviation, in sizes, with
#: which each is held where the search starts, so that what the rows do not show stays there.
_SLACK, _FAR = 10.0, 100.0


@dataclass(frozen=True, eq=False)
class Fit:
    """Where the iteration ended.

    Attributes
    ----------
    solved : Solved
        The last linear step, about `theta`.
    theta : ndarray (P,)
        Parameters.
    regressor : ndarray (m, P)
        Derivatives there.
    target : ndarray (m,)
        Right-hand side of the last linear problem: what is measured less what does not depend on
        the parameters.
    steps : int
        Taken.
    """

    solved: Solved
    theta: Array
    regressor: Array
    target: Array
    steps: int


def fitted(
    model: Model,
    unknowns: Unknowns,
    noise: Noise,
    *,
    nuisance: Array | None = None,
    weights: Array | None = None,
    start: Array | None = None,
    once: bool = False,
    progress: Callable[[int, float], None] | None = None,
) -> Fit:
    """Fit a model's parameters to its observations.

    Parameters
    ----------
    model : Model
        Predictions and derivatives.
    unknowns : Unknowns
        Bounds, sizes, priors.
    noise : Noise
        Noise of the observations.
    nuisance : ndarray (m, S), optional
        Columns of the nuisances.
    weights : ndarray (m,), optional
        As in `solved`.
    start : ndarray (P,), optional
        Default: the mechanism's own.
    once : bool
        Take the first linear step alone, also where the model is not linear.
    progress : callable, optional
        Called with the number of a step and the norm of the residuals over their deviations.

    Raises
    ------
    ConvergenceError
        If the steps do not end.
    """
    theta = unknowns.nominal if start is None else start.copy()
    N = np.zeros((len(model.observations), 0)) if nuisance is None else nuisance
    search = _Search(model, unknowns, noise, N, weights, progress)
    solution, A, target = search.linear(theta)
    if model.is_linear or once:
        return Fit(solution, solution.theta, A, target, 1)
    for _ in range(_ROUNDS):
        theta, before = search.descended(theta, solution), np.array(solution.scales)
        solution, A, target = search.linear(theta)
        if np.all(np.abs(solution.scales - before) <= _SAME * before):
            break
    return Fit(_without_slack(solution, theta, unknowns.sizes), theta, A, target, search.steps)


def _without_slack(solution: Solved, theta: Array, sizes: Array) -> Solved:
    """The linear solution, parameters known to worse than many sizes called not determined.

    Nothing is linear over such an interval, and a search has left them where they were.
    """
    spread = np.sqrt(np.maximum(solution.covariance.diagonal(), 0.0))
    lost = ~(spread <= _SLACK * np.maximum(sizes, np.abs(theta)))
    C = solution.covariance.copy()
    C[lost], C[:, lost] = np.nan, np.nan
    return replace(solution, covariance=C, is_determined=solution.is_determined & ~lost)


class _Search:
    """A nonlinear fit on its way."""

    def __init__(
        self,
        model: Model,
        unknowns: Unknowns,
        noise: Noise,
        nuisance: Array,
        weights: Array | None,
        progress: Callable[[int, float], None] | None,
    ) -> None:
        self._model, self._unknowns, self._noise = model, unknowns, noise
        self._nuisance, self._weights = nuisance, weights
        self._progress = progress
        self._priors = [
            (p, *u.prior) for p, u in enumerate(unknowns.parameters) if u.prior is not None
        ]
        self._sizes, self._bounded = unknowns.sizes, unknowns.is_bounded
        self._known: tuple[Array, tuple[Array, Array]] | None = None
        self.steps = 0

    def _at(self, theta: Array) -> tuple[Array, Array]:
        """Predictions and derivatives, evaluated once."""
        if self._known is None or not np.array_equal(self._known[0], theta):
            self._known = theta.copy(), self._model.at(theta)
        return self._known[1]

    def linear(self, theta: Array) -> tuple[Solved, Array, Array]:
        """The linear problem about a point: its solution, regressor and target."""
        y, A = self._at(theta)
        target = self._model.observations.target - y + A @ theta
        solution = solved(
            A,
            target,
            self._noise,
            sizes=self._sizes,
            bounded=self._bounded,
            nuisance=self._nuisance,
            priors=self._priors,
            weights=self._weights,
        )
        return solution, A, target

    def descended(self, theta: Array, solution: Solved) -> Array:
        """The least sum of squares with the standard deviations of a linear solution.

        What the rows do not determine stays where it is; nuisances are eliminated, which is exact
        since they enter linearly.
        """
        weight = 1.0 if self._weights is None else np.sqrt(self._weights)
        weight = np.broadcast_to(weight / solution.deviation, solution.deviation.shape)
        U, values, _ = np.linalg.svd(self._nuisance * weight[:, None], full_matrices=False)
        Q = U[:, : numerics.rank(values)] if values.size else U
        sizes, seen = self._sizes, self._model.observations
        start = np.where(self._bounded, np.maximum(theta / sizes, numerics.TINY), theta / sizes)
        prior = np.array([s for _, _, s in self._priors])

        def whole(z: Array) -> Array:
            return z * sizes

        def residual(z: Array) -> Array:
            full = whole(z)
            try:
                y, _ = self._at(full)
            except CartstiffError:  # no equilibrium, or no stiffness: not so far
                return np.full(len(seen) + len(prior) + len(z), np.nan)
            r = (y - seen.target) * weight
            extra = [(full[p] - value) / s for p, value, s in self._priors]
            return np.concatenate([r - Q @ (Q.T @ r), extra, (z - start) / _FAR])

        def jacobian(z: Array) -> Array:
            _, A = self._at(whole(z))
            self.steps += 1
            if self._progress is not None:
                self._progress(self.steps, float(np.linalg.norm(residual(z))))
            J = A * weight[:, None]
            extra = np.zeros((len(prior), len(theta)))
            for row, (p, _, s) in enumerate(self._priors):
                extra[row, p] = 1.0 / s
            data = np.vstack([J - Q @ (Q.T @ J), extra]) * sizes
            return np.vstack([data, np.eye(len(z)) / _FAR])

        from scipy.optimize import least_squares

        lower = np.where(self._bounded, 0.0, -np.inf)
        found = least_squares(
            residual,
            start,
            jacobian,
            bounds=(lower, np.inf),
            ftol=numerics.FLAT,
            xtol=numerics.FLAT,
            gtol=numerics.FLAT,
            max_nfev=_STEPS,
        )
        if found.status <= 0:
            raise ConvergenceError(
                "the fit does not settle", iterations=found.nfev, residual=2.0 * float(found.cost)
            )
        return whole(found.x)
