"""Gauss-Newton steps on a model; one step where it is linear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cartstiff.arrays import Array
from cartstiff.errors import ConvergenceError
from cartstiff.identify.least_squares import Noise, Solved, solved
from cartstiff.identify.linear_model import Model
from cartstiff.identify.unknowns import Unknowns

__all__ = ["Fit", "fitted"]

_STEPS, _HALVINGS = 50, 12
#: Relative change of every parameter, in standard deviations, that ends the iteration.
_SMALL = 1e-6


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
        Of the last linear problem: what is measured less what does not depend on the parameters.
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
        Of the observations.
    nuisance : ndarray (m, S), optional
        Columns of the nuisances.
    weights : ndarray (m,), optional
        As in `solved`.
    start : ndarray (P,), optional
        Default: the mechanism's own.
    fixed : (index, value), optional
        A parameter that is held, as for a profile.
    progress : callable, optional
        Called with the number of a step and the size of its change.

    Raises
    ------
    ConvergenceError
        If the steps do not end.
    """
    theta = unknowns.nominal if start is None else start.copy()
    if fixed is not None:
        theta[fixed[0]] = fixed[1]
    bounded, sizes = unknowns.is_bounded, unknowns.sizes
    priors = [(p, *u.prior) for p, u in enumerate(unknowns.parameters) if u.prior is not None]
    seen = model.observations
    y, A = model.at(theta)
    size = np.inf
    for step in range(1, _STEPS + 1):
        B, target = A, seen.target - y + A @ theta
        if fixed is not None:
            B = A.copy()
            B[:, fixed[0]] = 0.0
            target = seen.target - y + B @ theta
        found = solved(B, target, noise, sizes=sizes, bounded=bounded, nuisance=nuisance,
                       priors=priors, weights=weights)  # fmt: skip
        if model.is_linear:
            return Fit(found, found.theta, A, target, 1)
        new = np.where(found.is_determined, found.theta, theta)
        if fixed is not None:
            new[fixed[0]] = fixed[1]
        change = new - theta
        spread = np.sqrt(np.nan_to_num(np.diag(found.covariance)))
        moved = np.abs(change) > _SMALL * spread + 1e-12 * sizes
        size = float(np.max(np.abs(change) / sizes, initial=0.0))
        if progress is not None:
            progress(step, size)
        if not moved.any():
            return Fit(found, theta, A, target, step)
        theta, y, A = _accepted(model, found, theta, change, y, nuisance, weights)
    raise ConvergenceError("the fit does not settle", iterations=_STEPS, residual=size)


def _accepted(
    model: Model, found: Solved, theta: Array, change: Array, y: Array,
    nuisance: Array | None, weights: Array | None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """The step, halved until the sum of squares falls, or hardly changes."""
    target = model.observations.target
    root = 1.0 if weights is None else np.sqrt(weights)

    def cost(y: Array) -> float:
        r = target - y
        if nuisance is not None and nuisance.size:
            w = np.broadcast_to(root / found.deviation, r.shape)
            eta = np.linalg.lstsq(nuisance * w[:, None], r * w, rcond=None)[0]
            r = r - nuisance @ eta
        return float(np.sum((root * r / found.deviation) ** 2))

    before, share = cost(y), 1.0
    for _ in range(_HALVINGS):
        try:
            new_y, new_A = model.at(theta + share * change)
        except ConvergenceError:
            share *= 0.5
            continue
        if cost(new_y) <= before * (1.0 + 1e-9) + 1e-12:
            return theta + share * change, new_y, new_A
        share *= 0.5
    return theta + share * change, *model.at(theta + share * change)
