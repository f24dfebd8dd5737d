"""Least squares by damped steps within bounds; one linear step where a model is linear."""

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

# Steps of a search; searches, in which the scales of lengths and angles settle.
_STEPS, _ROUNDS = 100, 6
#: Relative change of the sum of squares that ends a search; of scales.
_FLAT, _SAME = numerics.FLAT, 1e-3
# Of the mean square: what a step without damping may still promise where steps have run out.
_NOTHING = 1e-3
# Factors on the damping after a step that did at least this share of what it should, and after one
# that was refused or did next to nothing of it.
_EASED, _TRUSTED, _HARDER, _POOR = 0.1, 0.5, 5.0, 0.1
#: Sizes to which a combination of parameters must be known to be moved; by how much more than the
#: hardest others are held: they would creep on else.
SLACK, _HELD = 10.0, 1e4


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
    fixed : (index, value), optional
        A parameter that is held, as for a profile.
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
    if fixed is not None:
        theta[fixed[0]] = fixed[1]
    N = np.zeros((len(model.observations), 0)) if nuisance is None else nuisance
    search = _Search(model, unknowns, noise, N, weights, fixed, progress)
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
    lost = ~(spread <= SLACK * np.maximum(sizes, np.abs(theta)))
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
        fixed: tuple[int, float] | None,
        progress: Callable[[int, float], None] | None,
    ) -> None:
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
        solution = solved(
            B,
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
        free = np.ones(len(theta), bool)
        if self._fixed is not None:
            free[self._fixed[0]] = False
        weight = 1.0 if self._weights is None else np.sqrt(self._weights)
        weight = np.broadcast_to(weight / solution.deviation, solution.deviation.shape)
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
        return whole(
            _damped(residual, jacobian, np.maximum(theta[free] / sizes[free], lower), lower)
        )


def _damped(
    residual: Callable[[Array], Array], jacobian: Callable[[Array], Array], z: Array, lower: Array
) -> Array:
    """Parameters (P,) of the least sum of squares above bounds, from z on.

    Steps of Levenberg and Marquardt, each by least squares within the bounds. The first damping
    lets a parameter of size 1 move by 1 for as much as all residuals are now. Combinations that are
    known to worse than many sizes stay where they are: along these a search runs to where nothing
    comes to rest, and the others are found without. Where a step falls short of what it promised,
    half its second derivative, which the trial shows, is answered by a second step [Transtrum]_:
    narrow valleys that bend are followed so.
    """
    from scipy.optimize import lsq_linear

    r, J = residual(z), jacobian(z)
    cost = float(r @ r)
    damping, was_refused = cost / len(r), False
    steps = 0
    while np.isfinite(cost) and steps < _STEPS:
        steps += 1
        least = numerics.EPSILON * float((J * J).sum(axis=0).max(initial=0.0))
        Q, R = np.linalg.qr(np.column_stack([J, r]))
        damping = max(damping, least)
        _, values, Vt = np.linalg.svd(R[:, :-1])
        felt = max(np.sqrt(cost / len(r)) / SLACK, numerics.RANK * float(values[0]))
        slack = Vt[int(np.count_nonzero(values > felt)) :]
        A = np.vstack([R[:, :-1], np.sqrt(damping) * np.eye(len(z)), _HELD * values[0] * slack])

        def answer(right: Array, at: Array, A: Array = A) -> Array:
            target = np.append(-right, np.zeros(len(A) - len(right)))
            optimum = lsq_linear(
                A,
                target,
                (lower - at, np.inf),
                "bvls",
                tol=numerics.LAST_DIGITS,
                max_iter=10 * A.shape[1],
            )
            return np.asarray(optimum.x)

        move = answer(R[:, -1], z)
        after = R[:, :-1] @ move + R[:, -1]
        fall = cost - float(after @ after)
        if fall <= _FLAT * cost:
            if was_refused or damping <= least:
                return z
            damping *= _EASED
            continue
        trial = residual(np.maximum(z + move, lower))
        reached = float(trial @ trial)
        if np.isfinite(reached) and cost - reached < _TRUSTED * fall:
            bent = move + answer(Q.T @ (trial - r - J @ move), np.maximum(z + move, lower))
            second = residual(np.maximum(z + bent, lower))
            if float(second @ second) < reached:
                move, trial, reached = bent, second, float(second @ second)
        share = (cost - reached) / fall if np.isfinite(reached) else -1.0
        was_refused = share <= 0.0
        if not was_refused:
            z, r, cost = np.maximum(z + move, lower), trial, reached
            J = jacobian(z)
        damping *= _EASED if share > _TRUSTED else 1.0 if share > _POOR else _HARDER
    if steps:
        move = answer(R[:, -1], z, np.vstack([R[:, :-1], _HELD * values[0] * slack]))
        after = R[:, :-1] @ move + R[:, -1]
        if cost - float(after @ after) <= _NOTHING * cost / len(r):  # far less than a deviation
            return z
    raise ConvergenceError("the fit does not settle", iterations=steps, residual=cost)
