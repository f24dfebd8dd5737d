r"""Uncertainty of results from tolerances of their parameters.

Two independent ways, to be compared: *first order*, with variances ``sum_p (df/dp sigma_p)^2``
[GUM]_, and *Monte Carlo*, which draws the parameters and looks at what comes out [GUM1]_. They
differ where the function bends within the tolerances; then Monte Carlo is the one to trust.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.arrays import checked_array, checked_number, checked_seed, read_only
from cartstiff.errors import CartstiffError, InputError, UndefinedError, UnknownNameError
from cartstiff.geometry.se3 import Array

Results = Mapping[str, ArrayLike] | ArrayLike

# Step of the differences, in standard deviations: far enough for rounding not to matter.
_STEP = 0.2


@dataclass(frozen=True)
class Tolerance:
    """A parameter known up to a standard deviation.

    Attributes
    ----------
    nominal : float
        Expected value.
    deviation : float
        Standard deviation, not negative, in the parameter's unit.
    distribution : {"normal", "uniform"}
        Used by Monte Carlo.
    lower : float
        Values from here down do not exist, as of a compliance: differences stay above.
    """

    nominal: float
    deviation: float
    distribution: Literal["normal", "uniform"] = "normal"
    lower: float = -np.inf

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not np.isfinite(self.nominal):
            raise InputError("nominal value must be finite", got=self.nominal)
        if not (np.isfinite(self.deviation) and self.deviation >= 0):
            raise InputError(
                "standard deviation cannot be used", expected="zero or more", got=self.deviation
            )
        if self.distribution not in ("normal", "uniform"):
            raise UnknownNameError("distribution", self.distribution, ("normal", "uniform"))

    @property
    def step(self) -> float:
        """Step of differences, in standard deviations: twice it stays above `lower`."""
        room = self.nominal - self.lower
        return min(_STEP, 0.25 * room / self.deviation) if self.deviation > 0.0 else _STEP

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """Independent values, shape (count,)."""
        if self.distribution == "uniform":
            half = np.sqrt(3.0) * self.deviation
            return rng.uniform(self.nominal - half, self.nominal + half, count)
        return rng.normal(self.nominal, self.deviation, count)


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations for whole groups of parameters.

    Attributes
    ----------
    stiffness : float
        Standard deviation of every spring stiffness, relative to it (0.05: five per cent).
    length : float
        Standard deviation of every coordinate of a joint placement or an attachment point, in
        units of length; of every rest length, where a mechanism finds its rest by itself.
    angle : float
        Standard deviation of every small rotation of a joint placement, in radians; of every rest
        angle, where a mechanism finds its rest by itself.
    """

    stiffness: float = 0.0
    length: float = 0.0
    angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("stiffness", "length", "angle"):
            value = checked_number(getattr(self, name), f"tolerance of the {name}")
            if value < 0:
                raise InputError(
                    f"tolerance of the {name} cannot be used", expected="zero or more", got=value
                )

    @property
    def any(self) -> bool:
        """Whether one of them is above zero."""
        return max(self.stiffness, self.length, self.angle) > 0.0


@dataclass(frozen=True, eq=False)
class Propagation:
    """Uncertainty of every number that a function returns.

    Attributes
    ----------
    method : {"first order", "Monte Carlo"}
        How it was found.
    names : tuple of str
        One per number: "key", or "key[i, j]" for entries of arrays.
    nominal : ndarray, shape (m,), or None
        Values at the nominal parameters: first order only.
    mean : ndarray, shape (m,), or None
        Mean of the draws: Monte Carlo only. To first order there is none.
    deviation : ndarray, shape (m,)
        Standard deviation.
    lower, upper : ndarray, shape (m,)
        Interval of the given level: nominal value -+ z deviation, or quantiles of the draws.
    level : float
        Probability of the interval.
    contributions : dict of str to ndarray (m,), or None
        First order only: each parameter's share of the variance; NaN where that is zero.
    samples : int
        Draws that gave numbers; 0 for first order.
    failures : dict of str to int
        Draws for which the function refused, by code or error name: they are not in the mean, and
        many of them mean that the tolerance reaches a singularity.
    """

    method: Literal["first order", "Monte Carlo"]
    names: tuple[str, ...]
    nominal: Array | None
    mean: Array | None
    deviation: Array
    lower: Array
    upper: Array
    level: float
    contributions: dict[str, Array] | None
    samples: int
    failures: dict[str, int]

    @property
    def centre(self) -> Array:
        """What the deviations are about (m,): the nominal values, or the mean of the draws."""
        if self.mean is not None:
            return self.mean
        return np.full(len(self.names), np.nan) if self.nominal is None else self.nominal

    def of(self, name: str) -> tuple[float, float, float, float]:
        """Centre, standard deviation, lower and upper end of one number; UnknownNameError."""
        if name not in self.names:
            raise UnknownNameError("result", name, self.names)
        i = self.names.index(name)
        columns = (self.centre, self.deviation, self.lower, self.upper)
        centre, deviation, lower, upper = (float(c[i]) for c in columns)
        return centre, deviation, lower, upper


def _flatten(results: Results) -> tuple[tuple[str, ...], Array]:
    """Names and values of all numbers, in the order of the mapping."""
    items = results.items() if isinstance(results, Mapping) else [("result", results)]
    names: list[str] = []
    values: list[float] = []
    for key, value in items:
        array = checked_array(value, None, f"result {key}", copy=False, finite=False)
        for index in np.ndindex(array.shape):
            names.append(f"{key}[{', '.join(map(str, index))}]" if index else str(key))
            values.append(float(array[index]))
    return tuple(names), np.array(values)


def _factor(level: float, degrees: float) -> float:
    """Half width of an interval over the standard deviation."""
    if np.isinf(degrees):
        return NormalDist().inv_cdf(0.5 + 0.5 * level)
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 0.5 + 0.5 * level))


def _draws(
    tolerances: Mapping[str, Tolerance],
    rng: np.random.Generator,
    samples: int,
    correlation: ArrayLike | None,
) -> dict[str, Array]:
    """Values of each parameter (samples,); those that are correlated are normal."""
    draws = {name: t.draw(rng, samples) for name, t in tolerances.items()}
    if correlation is None:
        return draws
    R = checked_array(correlation, (len(tolerances),) * 2, "correlation")
    values, vectors = np.linalg.eigh(R)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    together = rng.standard_normal((samples, len(R))) @ root.T
    for i, (name, t) in enumerate(tolerances.items()):
        if np.count_nonzero(R[i]) > 1:
            draws[name] = t.nominal + t.deviation * together[:, i]
    return draws


def _check(tolerances: Mapping[str, Tolerance], level: float) -> None:
    if not tolerances:
        raise InputError("no tolerances given", expected="at least one parameter")
    if not 0.0 < level < 1.0:
        raise InputError("level cannot be used", expected="between 0 and 1", got=level)


def propagate_first_order(
    function: Callable[[dict[str, float]], Results],
    tolerances: Mapping[str, Tolerance],
    *,
    level: float = 0.95,
    correlation: ArrayLike | None = None,
    degrees: float = np.inf,
) -> Propagation:
    r"""Propagate standard deviations through the function's derivatives.

    Derivatives are fourth-order differences: the function is evaluated four times per parameter,
    within 0.4 standard deviations of the nominal values, and must be smooth there. Sorted
    eigenvalues are not where two of them meet (symmetric mechanisms): prefer Monte Carlo there.

    Parameters
    ----------
    function : callable
        From a dict of parameter values to a dict of numbers or arrays, or to one array; NaN entries
        stay NaN.
    tolerances : mapping of str to Tolerance
        Parameters.
    level : float
        Probability of the interval, normal distribution assumed.
    correlation : array_like (n, n), optional
        Correlation of the parameters, in their order; default: independent. A parameter's share of
        the variance then holds half of what it has in common with each other one, and may be
        negative.
    degrees : float
        Degrees of freedom of Student's t, where the deviations are estimates themselves.

    Raises
    ------
    InputError
        If there are no tolerances or the level is not between 0 and 1.
    """
    _check(tolerances, level)
    nominal = {name: float(t.nominal) for name, t in tolerances.items()}
    names, values_there = _flatten(function(dict(nominal)))
    moving = [name for name, t in tolerances.items() if t.deviation > 0]
    sigma = np.array([tolerances[name].deviation for name in moving])

    def at(offsets: Array) -> Array:
        shifted = dict(nominal)
        for name, offset in zip(moving, offsets, strict=True):
            shifted[name] += float(offset)
        labels, values = _flatten(function(shifted))
        if labels != names:
            raise InputError("the function returns other numbers from one call to the next")
        return values

    effects = np.zeros((len(names), len(moving)))
    for i, deviation in enumerate(sigma):
        step, share = np.zeros(len(moving)), tolerances[moving[i]].step
        step[i] = share * deviation
        near, far = at(step) - at(-step), at(2.0 * step) - at(-2.0 * step)
        effects[:, i] = (8.0 * near - far) / (12.0 * share)
    R = np.eye(len(moving))
    if correlation is not None:
        among = [i for i, t in enumerate(tolerances.values()) if t.deviation > 0]
        R = checked_array(correlation, (len(tolerances),) * 2, "correlation")[np.ix_(among, among)]
    parts = effects * (effects @ R)
    variance = np.maximum(np.sum(parts, axis=1), 0.0)
    total = np.sqrt(variance)
    z = _factor(level, degrees)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = parts.T / variance
    contributions = {name: read_only(np.where(variance > 0, 0.0, np.nan)) for name in tolerances}
    contributions |= {name: read_only(s) for name, s in zip(moving, shares, strict=True)}
    return Propagation(
        "first order",
        names,
        read_only(values_there),
        None,
        read_only(total),
        read_only(values_there - z * total),
        read_only(values_there + z * total),
        level,
        contributions,
        0,
        {},
    )


def propagate_monte_carlo(
    function: Callable[[dict[str, float]], Results],
    tolerances: Mapping[str, Tolerance],
    *,
    samples: int = 1000,
    seed: int = 0,
    level: float = 0.95,
    correlation: ArrayLike | None = None,
) -> Propagation:
    r"""Mean, standard deviation and quantiles over draws of the parameters.

    Nothing is clipped: a draw below a parameter's `lower`, or for which the function raises a
    `CartstiffError`, is counted under `failures` and left out.

    Parameters
    ----------
    function, tolerances, level, correlation
        As in `propagate_first_order`.
    samples : int
        Number of draws, at least 2. Quantiles at 95 % need some hundred.
    seed : int
        Seed of the generator that belongs to this call.

    Raises
    ------
    InputError
        If there are no tolerances, too few samples, or the level is not between 0 and 1.
    UndefinedError
        Code ``"no-samples"`` if fewer than two draws gave numbers.
    """
    _check(tolerances, level)
    if samples < 2:
        raise InputError("too few samples", expected="at least 2", got=samples)
    rng = np.random.default_rng(checked_seed(seed))
    draws = _draws(tolerances, rng, samples, correlation)
    names: tuple[str, ...] | None = None
    rows: list[Array] = []
    failures: dict[str, int] = {}
    for s in range(samples):
        if any(draws[name][s] <= t.lower for name, t in tolerances.items()):
            failures["below-zero"] = failures.get("below-zero", 0) + 1
            continue
        try:
            labels, values = _flatten(function({name: float(d[s]) for name, d in draws.items()}))
        except CartstiffError as error:
            code = error.code if isinstance(error, UndefinedError) else type(error).__name__
            failures[code] = failures.get(code, 0) + 1
            continue
        if names is not None and labels != names:
            raise InputError("the function returns other numbers from one call to the next")
        names = labels
        rows.append(values)
    if names is None or len(rows) < 2:
        raise UndefinedError(
            f"only {len(rows)} of {samples} draws gave numbers",
            code="no-samples",
            values={"failures": dict(failures)},
        )
    table = np.array(rows)
    tail = 0.5 * (1.0 - level)
    return Propagation(
        "Monte Carlo",
        names,
        None,
        read_only(table.mean(axis=0)),
        read_only(table.std(axis=0, ddof=1)),
        read_only(np.quantile(table, tail, axis=0)),
        read_only(np.quantile(table, 1.0 - tail, axis=0)),
        level,
        None,
        len(rows),
        failures,
    )
