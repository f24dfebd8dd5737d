"""How designs are chosen: grids, low-discrepancy points, and scipy's optimisers."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.designs.evaluation import Design
from cartstiff.designs.study import Study
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array

Many = Callable[[Sequence[Mapping[str, float]]], list[Design]]
#: Where merits of feasible, infeasible and failed designs stand, one above the other.
_INFEASIBLE, _FAILED = 2.0, 4.0
#: Members of a population, for each variable, as scipy has it.
_MEMBERS = 15
#: Size of the local search's simplex, in shares of the ranges: at first, and where it ends.
_FIRST_STEP, _LAST_STEP = 0.1, 0.005


def search(
    study: Study, home: Mapping[str, float], better: str, evaluate: Many
) -> list[Mapping[str, float]]:
    """Evaluate designs as the study's method chooses them; their parameters, each once.

    Parameters
    ----------
    study : Study
        With its method.
    home : mapping of str to float
        Parameters of the mechanism file.
    better : {"largest", "smallest"}
        The better end of the objective, where there is one.
    evaluate : callable
        Designs of a list of parameters.
    """
    kind, count = study.method.kind, study.size
    asked: dict[tuple[float, ...], Mapping[str, float]] = {}

    def look(shares: Array) -> list[Design]:
        return looked([_point(study, row) for row in np.clip(shares, 0.0, 1.0)])

    def looked(points: Sequence[Mapping[str, float]]) -> list[Design]:
        asked.update({tuple(point.values()): point for point in points})
        return evaluate(points)

    if kind == "grid":
        values = itertools.product(*(v.grid for v in study.variables.values()))
        looked([dict(zip(study.variables, row, strict=True)) for row in values])
    elif kind in ("sobol", "latin-hypercube"):
        look(_drawn(kind, len(study.variables), count, study.method.seed or 0))
    else:
        merit = _Merit(study, better)
        if kind == "local":
            _local(study, home, lambda x: merit(look(x[None]))[0], count)
        else:
            _evolution(study, lambda X: np.array(merit(look(X.T))), count)
    return list(asked.values())


def _point(study: Study, shares: Array) -> dict[str, float]:
    pairs = zip(study.variables.items(), shares.tolist(), strict=True)
    return {name: variable.at(share) for (name, variable), share in pairs}


def _drawn(kind: str, dimensions: int, count: int, seed: int) -> Array:
    """Points (count, dimensions) of the unit cube."""
    from scipy.stats import qmc

    generator = np.random.default_rng(seed)
    if kind == "latin-hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, seed=generator).random(count))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # balance needs powers of two: any count is taken
        return np.asarray(qmc.Sobol(dimensions, seed=generator).random(count))


class _Merit:
    """One number for each design, less is better: feasible before infeasible before failed."""

    def __init__(self, study: Study, better: str) -> None:
        self._study, self._sign = study, 1.0 if better == "smallest" else -1.0
        (self._name,) = study.objectives
        self._size: float | None = None

    def __call__(self, designs: list[Design]) -> list[float]:
        return [self._of(design) for design in designs]

    def _of(self, design: Design) -> float:
        if design.state == "failed":
            return _FAILED
        if design.state == "infeasible":
            limits = self._study.constraints.items()
            beyond = sum(limit.violation(design.values[name]) for name, limit in limits)
            return _INFEASIBLE + beyond / (1.0 + beyond)
        value = self._sign * design.values[self._name]
        if self._size is None:
            self._size = abs(value) or 1.0
        value /= self._size  # of size one, then squeezed between -1 and 1
        return value / (1.0 + abs(value))


def _local(
    study: Study, home: Mapping[str, float], merit: Callable[[Array], float], count: int
) -> None:
    """Nelder and Mead's simplex: it needs no derivatives, and goes round designs that fail."""
    from scipy.optimize import minimize

    start_at = {**home, **study.set, **(study.method.start or {})}
    start = []
    for name, variable in study.variables.items():
        low, high = variable.low or 0.0, variable.high or 0.0
        if not low <= start_at[name] <= high:
            raise InputError(
                f"start of {name!r} is not in its range",
                where="method.start",
                expected=f"{low:g} to {high:g}",
                got=f"{start_at[name]:g}",
            )
        start.append(variable.share(start_at[name]))
    n, left, step = len(start), count, _FIRST_STEP
    best, x = np.inf, np.array(start)
    # A simplex that meets a bound or a constraint may fall flat: it is made anew at the best point
    # until that no longer helps.
    while left > n and step > _LAST_STEP:
        corners = x + np.diag(np.where(x > 0.5, -step, step))
        options: dict[str, Any] = {
            "maxfev": left,
            "xatol": numerics.DESIGNED,
            "fatol": numerics.SHARP,
            "initial_simplex": np.vstack([x, corners]),
            "adaptive": n > 2,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the count is reached: that is what it is for
            minimum = minimize(
                merit, x, method="Nelder-Mead", bounds=[(0.0, 1.0)] * n, options=options
            )
        left -= minimum.nfev
        if not minimum.fun < best - numerics.CONVERGED:
            step *= 0.3
        best, x = minimum.fun, minimum.x


def _evolution(study: Study, merits: Callable[[Array], Array], count: int) -> None:
    """Differential evolution, a whole generation at a time."""
    from scipy.optimize import differential_evolution

    n = len(study.variables)
    members = max(5, min(_MEMBERS * n, count // 4))
    points = _drawn("sobol", n, members, study.method.seed or 0)
    if count < 2 * members:
        raise InputError(
            "too few designs for an evolution",
            where="method.designs",
            got=count,
            expected=f"at least {2 * members}",
        )
    differential_evolution(
        merits,
        [(0.0, 1.0)] * n,
        init=points,
        maxiter=count // members - 1,
        polish=False,
        updating="deferred",
        vectorized=True,
        seed=np.random.default_rng(study.method.seed or 0),
        tol=0.0,
        atol=numerics.ALIKE,
    )
