"""Least squares by SciPy's trust region; one linear step where a model is linear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError, ConvergenceError
from cartstiff.identify.least_squares import Noise, Solved, solved
from cartstiff.identify.linear_model import Model
from cartstiff.identify.unknowns import Unknowns

__all__ = ["Fit", "fitted"]

# Evaluations of a search; searches, in which the scales of lengths and angles settle.
_STEPS, _ROUNDS = 60, 6
#: Relative changes of parameters and of the sum of squares that end a search; of scales.
_SMALL, _FLAT, _SAME = numerics.CLOSE, numerics.FLAT, 1e-3


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
    fixed: tuple[int, float] | None = None,
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
    fixed : (index, value), optional
        A parameter that is held, as for a profile.
    progress : callable, optional
        Called with the number of a step and the norm of the residuals over their deviations.

    Raises
    ------
    ConvergenceError
        If the steps do not end.
    """
    theta = unknowns.nominal if start is None else start.copy()
    if fixed is not None:
        theta[fixed[0]] = fixed[1]
    N = np.zeros((len(model.observations), 0)) if nuisance is None else nuisance
    search = _Search(model, unknowns, noise, N, weights, fixed, progress)
    found, A, target = search.linear(theta)
    if model.is_linear:
        return Fit(found, found.theta, A, target, 1)
    for _ in range(_ROUNDS):
        theta, before = search.descended(theta, found), np.array(found.scales)
        found, A, target = search.linear(theta)
        if np.all(np.abs(found.scales - before) <= _SAME * before):
            break
    return Fit(found, theta, A, target, search.steps)


class _Search:
    """A nonlinear fit on its way."""

    def __init__(
        self, model: Model, unknowns: Unknowns, noise: Noise, nuisance: Array,
        weights: Array | None, fixed: tuple[int, float] | None,
        progress: Callable[[int, float], None] | None,
    ) -> None:  # fmt: skip
        self._model, self._unknowns, self._noise = model, unknowns, noise
        self._nuisance, self._weights, self._fixed = nuisance, weights, fixed
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
        B = A
        if self._fixed is not None:
            B = A.copy()
            B[:, self._fixed[0]] = 0.0
        target = self._model.observations.target - y + B @ theta
        found = solved(B, target, self._noise, sizes=self._sizes, bounded=self._bounded,
                       nuisance=self._nuisance, priors=self._priors,
                       weights=self._weights)  # fmt: skip
        return found, A, target

    def descended(self, theta: Array, found: Solved) -> Array:
        """The least sum of squares with the standard deviations of a linear solution.

        What the rows do not determine stays where it is; nuisances are eliminated, which is exact
        since they enter linearly.
        """
        from scipy.optimize import least_squares

        free = found.is_determined.copy()
        if self._fixed is not None:
            free[self._fixed[0]] = False
        weight = 1.0 if self._weights is None else np.sqrt(self._weights)
        weight = np.broadcast_to(weight / found.deviation, found.deviation.shape)
        U, values, _ = np.linalg.svd(self._nuisance * weight[:, None], full_matrices=False)
        Q = U[:, : numerics.rank(values)] if values.size else U
        sizes, seen = self._sizes, self._model.observations
        prior = np.array([s for _, _, s in self._priors])

        def whole(z: Array) -> Array:
            full = theta.copy()
            full[free] = z * sizes[free]
            return full

        def residual(z: Array) -> Array:
            full = whole(z)
            try:
                y, _ = self._at(full)
            except CartstiffError:  # no equilibrium, or no stiffness: not so far
                return np.full(len(seen) + len(prior), np.nan)
            r = (y - seen.target) * weight
            extra = [(full[p] - value) / s for p, value, s in self._priors]
            return np.append(r - Q @ (Q.T @ r), extra)

        def jacobian(z: Array) -> Array:
            _, A = self._at(whole(z))
            self.steps += 1
            if self._progress is not None:
                self._progress(self.steps, float(np.linalg.norm(residual(z))))
            J = A * weight[:, None]
            extra = np.zeros((len(prior), len(theta)))
            for row, (p, _, s) in enumerate(self._priors):
                extra[row, p] = 1.0 / s
            return np.vstack([J - Q @ (Q.T @ J), extra])[:, free] * sizes[free]

        if not free.any():
            return theta
        lower = np.where(self._bounded[free], 0.0, -np.inf)
        start = np.maximum(theta[free] / sizes[free], lower)
        best = least_squares(
            residual, start, jacobian, bounds=(lower, np.inf), xtol=_SMALL, ftol=_FLAT,
            gtol=numerics.EPSILON, max_nfev=_STEPS, method="dogbox",
        )  # fmt: skip
        if not best.success:
            raise ConvergenceError("the fit does not settle", iterations=best.nfev,
                                   residual=float(best.optimality))  # fmt: skip
        return whole(best.x)
