"""Weighted least squares: one linear step, and a nonlinear search by SciPy within bounds.

Numbers y = A theta + N eta + e with nuisances eta (offsets of sessions). Rows are divided
by their standard deviations; if these are not given, one for lengths and one for angles
is estimated with the parameters, ``s^2 = sum r^2 / sum (1 - h)`` with the leverages h.
Singular values of the divided rows, their columns of unit length, show which parameters
the rows determine. The covariance is that of the unconstrained solution, ``(A^T A)^-1``
of the divided rows; the bound theta >= 0 moves the estimate and truncates the interval,
which keeps its coverage [BatesWatts]_.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import CartstiffError, ConvergenceError, InputError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.identified import quantile
from cartstiff.wings.identify.measurements import Observations
from cartstiff.wings.identify.models import Model
from cartstiff.wings.identify.unknowns import PARTS, Unknowns, placement_of, size_of

# Share of an unobservable direction above which a parameter is not determined.
_UNOBSERVABLE = numerics.ROUNDOFF**0.5
# Bound on the iterations of the scales of the noise.
_MAX_SCALE_STEPS = 60


@dataclass(frozen=True, eq=False)
class Fit:
    """A weighted linear fit; of a nonlinear model, the last one, about its parameters.

    Attributes
    ----------
    regressor : ndarray (m, P)
        Derivatives by the parameters.
    target : ndarray (m,)
        Right-hand side: the measured numbers less the part that does not depend on the
        parameters.
    theta : ndarray (P,)
        Parameters with the bounds; meaningless where not determined.
    unbounded : ndarray (P,)
        Without them: the centres of intervals.
    offsets : ndarray (S,)
        Nuisances.
    covariance : ndarray (P, P)
        NaN where not determined.
    offset_covariance : ndarray (S, S)
        That of the nuisances, NaN where not determined.
    is_determined : ndarray of bool (P,)
        Whether the rows determine each parameter by itself.
    singular_values : ndarray
        Singular values of the divided rows with columns of unit length.
    directions : ndarray (P + S, k)
        Their combinations of scaled columns.
    residual : ndarray (m,)
        Measured less predicted, with the bounds, in the numbers' units.
    deviation : ndarray (m,)
        Standard deviations that were used.
    scales : tuple of float
        Factors on the deviations of lengths and angles: estimated where unknown.
    degrees : float
        Degrees of freedom of the t distribution; infinite where all deviations are known.
    root : ndarray (m,)
        Roots of the weights beside the deviations: 1 but in the robust fit.
    basis : ndarray (m, r)
        Orthonormal basis of the range of the columns over the deviations, times `root`.
    half : ndarray (P + S, r)
        The solution of least norm is ``half @ basis.T @ b``, its covariance ``half @
        half.T``.
    """

    regressor: Array
    target: Array
    theta: Array
    unbounded: Array
    offsets: Array
    covariance: Array
    offset_covariance: Array
    is_determined: NDArray[np.bool_]
    singular_values: Array
    directions: Array
    residual: Array
    deviation: Array
    root: Array
    scales: tuple[float, float]
    degrees: float
    basis: Array
    half: Array

    @property
    def leverage(self) -> Array:
        """Diagonal (m,) of the hat matrix."""
        return np.asarray((self.basis**2).sum(axis=1))

    def moved_by(self, errors: Array) -> Array:
        """Changes (P + S, k) of parameters and nuisances by errors (m, k) of
        the numbers.
        """
        return np.asarray(
            self.half @ (self.basis.T @ (errors.T * self.root / self.deviation).T)
        )

    @property
    def freedom(self) -> float:
        """Numbers less fitted parameters."""
        return float(np.sum(1.0 - self.leverage))


def linear_fit(
    A: Array,
    target: Array,
    seen: Observations,
    unknowns: Unknowns,
    *,
    nuisance: Array | None = None,
    root: Array | None = None,
) -> Fit:
    """Fit parameters and nuisances to numbers.

    Parameters
    ----------
    A : ndarray (m, P)
        Regressor.
    target : ndarray (m,)
        Measured.
    seen : Observations
        The numbers, with their standard deviations.
    unknowns : Unknowns
        Natural sizes and bounds of the parameters.
    nuisance : ndarray (m, S), optional
        Columns of the nuisances.
    root : ndarray (m,), optional
        Roots of further weights, of numbers with known deviations.
    """
    m, P = A.shape
    N = np.zeros((m, 0)) if nuisance is None else nuisance
    bounded = unknowns.is_bounded
    full = np.hstack([A, N])
    root = np.ones(m) if root is None else root
    scales, floor = np.ones(2), np.full(2, numerics.TINY)
    # Noise of positions and of angles: what is not known is found by repeated fits.
    group, unit = seen.group, seen.unit
    unknown = np.flatnonzero(~seen.is_known)
    for g in unknown:
        floor[g] = _roundoff(target[group == g])
        scales[g] = max(numerics.largest(target[group == g]), numerics.TINY)
    h = np.zeros(m)
    for _ in range(_MAX_SCALE_STEPS):
        deviation = unit * scales[group]
        right = target * root / deviation
        basis = _Basis(full * (root / deviation)[:, None], P, unknowns.sizes)
        x = basis.half @ (basis.U.T @ right)
        r = target - full @ x
        h = (basis.U**2).sum(axis=1)
        before = scales.copy()
        for g in unknown:
            mine = group == g
            if mine.any():
                left = float(np.sum(1.0 - h[mine]))
                square = float(np.sum((r / unit)[mine] ** 2))
                scales[g] = max(
                    np.sqrt(square / left) if left > _UNOBSERVABLE else np.nan, floor[g]
                )
        if np.isnan(scales).any() or np.all(
            np.abs(scales - before) <= numerics.CONSTRAINT_TOLERANCE * scales
        ):
            break
    if np.isnan(scales).any():
        raise InputError(
            "as many parameters as numbers: no residual is left to estimate the noise "
            "from",
            expected="more rows, or standard deviations (columns sd_..., --sd)",
            got=f"{m} numbers for {P + N.shape[1]} unknowns",
        )
    # Compliances that cannot be negative, and the covariance.
    theta = x
    if np.any(x[:P][bounded & basis.is_determined[:P]] < 0.0):
        theta = basis.bounded(right, bounded)
    covariance = basis.half @ basis.half.T
    covariance[~basis.is_determined], covariance[:, ~basis.is_determined] = np.nan, np.nan
    return Fit(
        A,
        target,
        theta[:P],
        x[:P],
        theta[P:],
        covariance[:P, :P],
        covariance[P:, P:],
        basis.is_determined[:P],
        basis.values,
        basis.directions,
        target - full @ theta,
        unit * scales[group],
        root,
        (float(scales[0]), float(scales[1])),
        _degrees(seen, h),
        basis.U,
        basis.half,
    )


def _degrees(seen: Observations, h: Array) -> float:
    """Degrees of freedom of the least certain scale."""
    degrees = [
        float(np.sum((1.0 - h)[seen.group == g])) for g in np.flatnonzero(~seen.is_known)
    ]
    return min(degrees, default=np.inf)


class _Basis:
    """Singular value decomposition of divided rows with columns of unit length."""

    def __init__(self, divided: Array, parameters: int, sizes: Array) -> None:
        self._P = parameters
        natural = np.append(sizes, np.ones(divided.shape[1] - parameters))
        norms = np.linalg.norm(divided, axis=0) * natural
        largest = float(norms[:parameters].max(initial=0.0))
        is_seen = norms > numerics.RANK * largest
        others = norms[parameters:]
        is_seen[parameters:] = others > numerics.RANK * others.max(initial=0.0)
        self.scale = np.where(is_seen, natural / np.where(is_seen, norms, 1.0), 0.0)
        self._divided = divided
        U, self.values, Vt = np.linalg.svd(divided * self.scale, full_matrices=False)
        self.directions, rank = Vt.T, numerics.rank(self.values)
        inside = (Vt[:rank] ** 2).sum(axis=0)
        self.is_determined = is_seen & (1.0 - inside <= _UNOBSERVABLE**2)
        self.U = U[:, :rank]
        self.half = self.scale[:, None] * Vt[:rank].T / self.values[:rank]

    def bounded(self, right: Array, bounded: NDArray[np.bool_]) -> Array:
        """Least squares with lower bounds at zero."""
        from scipy.optimize import lsq_linear

        use = self.scale > 0.0
        lower = np.full(len(use), -np.inf)
        lower[: self._P] = np.where(bounded, 0.0, -np.inf)
        solution = lsq_linear(
            self._divided[:, use] * self.scale[use],
            right,
            bounds=(lower[use], np.inf),
            method="bvls",
            tol=numerics.ROUNDOFF_OF_SUMS,
            max_iter=10 * len(use),
        )
        x = np.zeros(len(use))
        x[use] = self.scale[use] * solution.x
        return x


# Bounds on the evaluations of a search, and on the searches with new scales of the noise;
# and the relative change of the scales that ends them.
_MAX_EVALUATIONS, _MAX_SEARCHES, _SAME_SCALES = 200, 6, 1e-3
# Standard deviation, in natural sizes, above which a parameter is not determined; and
# that of the weak prior at the start of a search, so that unobservable parameters stay
# there.
_MAX_DEVIATION, _START_DEVIATION = 10.0, 100.0


def fitted(
    model: Model,
    *,
    start: Array | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Fit:
    """Fit a model's parameters and its offsets to its observations.

    Parameters
    ----------
    model : Model
        Predictions and derivatives.
    start : ndarray (P,), optional
        Default: the mechanism's own.
    progress : callable, optional
        Called with the number of a step and the norm of the residuals over their
        deviations.

    Raises
    ------
    ConvergenceError
        If the steps do not end.
    """
    unknowns, seen = model.unknowns, model.observations
    theta = unknowns.nominal if start is None else start.copy()
    known: dict[bytes, tuple[Array, Array]] = {}
    steps = count(1)

    def evaluate(theta: Array) -> tuple[Array, Array]:
        if (key := theta.tobytes()) not in known:
            known.clear()
            known[key] = model.at(theta)
        return known[key]

    def linear(theta: Array) -> Fit:
        y, A = evaluate(theta)
        target = seen.target - y + A @ theta
        return linear_fit(A, target, seen, unknowns, nuisance=model.offsets.columns)

    def report(size: float) -> None:
        if progress is not None:
            progress(next(steps), size)

    fit = linear(theta)
    if model.is_linear:
        return fit
    for _ in range(_MAX_SEARCHES):
        before = np.array(fit.scales)
        theta = _descended(evaluate, model, theta, fit.deviation, report)
        fit = linear(theta)
        if np.all(np.abs(fit.scales - before) <= _SAME_SCALES * before):
            break
    return _without_vague(replace(fit, theta=theta), unknowns.sizes)


def _without_vague(fit: Fit, sizes: Array) -> Fit:
    """The fit; parameters with deviations of many sizes are not determined.

    Over such intervals the model is not linear, and the search has not moved them.
    """
    spread = np.sqrt(np.maximum(fit.covariance.diagonal(), 0.0))
    return _without(
        fit, ~(spread <= _MAX_DEVIATION * np.maximum(sizes, np.abs(fit.theta)))
    )


def _without(fit: Fit, lost: NDArray[np.bool_]) -> Fit:
    """The fit, with further parameters that are not determined."""
    C = fit.covariance.copy()
    C[lost], C[:, lost] = np.nan, np.nan
    return replace(fit, covariance=C, is_determined=fit.is_determined & ~lost)


def _descended(
    evaluate: Callable[[Array], tuple[Array, Array]],
    model: Model,
    theta: Array,
    deviation: Array,
    report: Callable[[float], None],
) -> Array:
    """The least sum of squares with the standard deviations of a linear fit.

    Parameters that the rows do not determine do not move; offsets are eliminated, which
    is exact since they enter linearly.
    """
    weight, target, unknowns = 1.0 / deviation, model.observations.target, model.unknowns
    U, values, _ = np.linalg.svd(
        model.offsets.columns * weight[:, None], full_matrices=False
    )
    Q = U[:, : numerics.rank(values)]
    sizes, bounded = unknowns.sizes, unknowns.is_bounded
    start = np.where(bounded, np.maximum(theta / sizes, numerics.TINY), theta / sizes)
    weak = np.eye(len(start)) / _START_DEVIATION

    def residual(z: Array) -> Array:
        try:
            y, _ = evaluate(z * sizes)
        except CartstiffError:  # no equilibrium, or no stiffness: a shorter step
            return np.full(len(target) + len(z), np.nan)
        r = (y - target) * weight
        return np.append(r - Q @ (Q.T @ r), weak @ (z - start))

    def jacobian(z: Array) -> Array:
        report(numerics.norm(residual(z)))
        J = evaluate(z * sizes)[1] * weight[:, None]
        return np.vstack([(J - Q @ (Q.T @ J)) * sizes, weak])

    from scipy.optimize import least_squares

    found = least_squares(
        residual,
        start,
        jacobian,
        bounds=(np.where(bounded, 0.0, -np.inf), np.inf),
        ftol=numerics.LEAST_DECREASE_OF_SQUARES,
        xtol=numerics.LEAST_DECREASE_OF_SQUARES,
        gtol=numerics.LEAST_DECREASE_OF_SQUARES,
        max_nfev=_MAX_EVALUATIONS,
    )
    if found.status <= 0:
        raise ConvergenceError(
            "the fit does not settle",
            iterations=found.nfev,
            residual=2.0 * float(found.cost),
        )
    return np.asarray(found.x * sizes)


# Standard deviation above which an offset is not determined: rad, and shares of the
# mechanism.
_MAX_OFFSET_DEVIATION = 0.1


def geometry_of(model: Model, fit: Fit) -> dict[str, tuple[float, float]]:
    """Change and standard deviation of zeros, tool and base,
    beyond what the rows count already.

    The deviation is NaN if the rows do not determine the number.
    """
    names, first = (
        model.offsets.geometry,
        len(model.offsets.names) - len(model.offsets.geometry),
    )
    G = np.eye(len(names))
    for word in ("base", "tool"):
        at = [i for i, name in enumerate(names) if name.startswith(f"{word}.")]
        parts = [PARTS.index(names[i][5:]) for i in at]
        G[np.ix_(at, at)] = rates_by_step(model.measured.found, word)[
            np.ix_(parts, parts)
        ]
    # An undetermined number, whose covariance is NaN, spoils only those that it enters.
    near = [np.flatnonzero(np.abs(g) >= _MAX_OFFSET_DEVIATION) for g in G]
    C, changes = fit.offset_covariance[first:, first:], (G @ fit.offsets[first:]).tolist()
    answer = {}
    for name, change, g, i in zip(names, changes, G, near, strict=True):
        s = float(np.sqrt(g[i] @ C[np.ix_(i, i)] @ g[i]))
        limit = _MAX_OFFSET_DEVIATION * size_of(model.unknowns.elastic, name)
        answer[name] = change, s if s <= limit else np.nan
    return answer


def rates_by_step(found: Mapping[str, float], word: str) -> Array:
    """Changes of the six numbers of a base or tool by a step (6, 6).

    A step of the base is along its turned axes, and turns before it; one of the tool is
    along the body's axes, and turns after it.
    """
    T, G = placement_of(found, word), np.eye(6)
    turning = se3.right_jacobian_inverse(se3.log(se3.pose(T[:3, :3])))[:3, :3]
    G[3:, 3:] = turning if word == "base" else turning.T
    G[:3, :3] = T[:3, :3] if word == "base" else np.eye(3)
    return G


# Tuning constant for 95 % efficiency; variance of a number over that of its weighted one,
# ``E w E psi^2 / (E psi')^2``; sd over median absolute deviation: of the normal law.
_CAUCHY, _WEIGHTED, _MAD = 2.385, 0.9236, 1.4826
#: Probability that a table without gross errors has a suspect.
_FALSE_ALARM = 0.01
# Bound on the fits with new scales of the loss; and the mean of psi' (0.7 for the normal
# law) below which no majority of the numbers agrees, so that the fit stays the plain one.
_MAX_SCALES, _LEAST_SLOPE = 20, 0.2


@dataclass(frozen=True, eq=False)
class Robust:
    """The robust fit.

    Attributes
    ----------
    fit : Fit
        The least Cauchy loss of all numbers.
    standardised : ndarray (m,)
        Residual of every number over its own standard deviation.
    kept : ndarray of bool (m,)
        Numbers of rows that are not suspect.
    suspects : ndarray of int
        Places of the suspect rows.
    seen : Observations
        The numbers.
    """

    fit: Fit
    standardised: Array
    kept: NDArray[np.bool_]
    suspects: NDArray[np.intp]
    seen: Observations

    def reason(self, n: int) -> str:
        """The largest residual of the row at a place."""
        mine = np.flatnonzero(self.seen.row == n)
        worst = mine[np.argmax(np.abs(self.standardised[mine]))]
        return (
            f"{self.seen.column[worst]}: residual of {self.standardised[worst]:+.1f} "
            "standard "
            "deviations from the robust fit"
        )


def robust_fit(model: Model, plain: Fit) -> Robust:
    """The least Cauchy loss ``sum log(1 + (r / c s)^2)``, by SciPy,
    about a plain fit's regressor.

    s is the median absolute deviation of lengths, and of angles; c = 2.385. It is least
    squares with the weights ``w = 1 / (1 + (r / c s)^2)`` at the solution. With ``psi = w
    r`` the variance of a weighted number is ``mean(w) sum psi^2 / sum (1 - h) /
    mean(psi')^2`` [Huber]_; a deviation that is given stays. A row is suspect if one of
    its residuals is improbable by Student's t with that variance, or the given one if it
    is larger.
    """
    seen, N, unknowns = model.observations, model.offsets.columns, model.unknowns
    columns, m = np.hstack([plain.regressor, N]), len(seen)
    x, s = _least_cauchy(plain, seen)
    r = plain.target - columns @ x
    w = 1.0 / (1.0 + (r / (_CAUCHY * s)) ** 2)
    scales, scatter = np.ones(2), np.ones(2)
    for g in (0, 1):
        if not (mine := seen.group == g).any():
            continue
        slope = float(np.mean(w[mine] * (2.0 * w[mine] - 1.0)))
        if slope < _LEAST_SLOPE:
            return Robust(
                plain, np.zeros(m), np.ones(m, bool), np.zeros(0, np.intp), seen
            )
        square = np.sum((w * r / seen.unit)[mine] ** 2) / np.sum(
            1.0 - plain.leverage[mine]
        )
        least = 1.0 if seen.is_known[g] else _roundoff(plain.target[mine])
        scatter[g] = max(
            float(np.sqrt(w[mine].mean() / _WEIGHTED * square)) / slope, least
        )
        scales[g] = 1.0 if seen.is_known[g] else scatter[g]
    known, root = (
        replace(seen, deviation=seen.unit * scales[seen.group]),
        np.sqrt(w / _WEIGHTED),
    )
    # Of exact numbers the unbounded solution is x itself, and the bounded one the nearest
    # to it.
    fit = linear_fit(plain.regressor, columns @ x, known, unknowns, nuisance=N, root=root)
    fit = replace(
        fit,
        target=plain.target,
        residual=plain.target - columns @ np.append(fit.theta, fit.offsets),
        scales=(float(scales[0]), float(scales[1])),
        degrees=plain.degrees,
    )
    left = np.maximum(1.0 - fit.leverage, numerics.ROUNDOFF**0.5)
    standardised = r / (seen.unit * scatter[seen.group] * np.sqrt(left))
    limit = quantile(1.0 - _FALSE_ALARM / m, max(plain.freedom, 1.0))
    suspects = np.unique(seen.row[np.abs(standardised) > limit])
    fit = _without(fit, ~plain.is_determined)
    return Robust(fit, standardised, ~np.isin(seen.row, suspects), suspects, seen)


def _least_cauchy(plain: Fit, seen: Observations) -> tuple[Array, Array]:
    """Parameters and offsets (P + S,), and the scale s of every number (m,)."""
    from scipy.optimize import least_squares

    U, size = plain.basis, plain.deviation
    right, rank = plain.target / size, plain.basis.shape[1]
    z, s = U.T @ right, np.zeros(len(right))
    for _ in range(_MAX_SCALES):
        r, before = np.abs(right - U @ z) * size, s.copy()
        for g in (0, 1):
            if (mine := seen.group == g).any():
                # Some residuals of a robust fit are zero whatever the scatter: one a
                # parameter.
                some = np.sort(r[mine] / seen.unit[mine])[
                    rank * int(mine.sum()) // len(r) :
                ]
                least = 1.0 if seen.is_known[g] else _roundoff(plain.target[mine])
                s[mine] = seen.unit[mine] * max(_MAD * float(np.median(some)), least)
        if np.all(np.abs(s - before) <= _SAME_SCALES * s):
            break
        W = size / s
        z = least_squares(
            lambda z, W=W: (U @ z - right) * W,
            z,
            lambda _, W=W: U * W[:, None],
            loss="cauchy",
            f_scale=_CAUCHY,
            ftol=numerics.LEAST_DECREASE_OF_SQUARES,
            xtol=numerics.LEAST_DECREASE_OF_SQUARES,
            gtol=numerics.LEAST_DECREASE_OF_SQUARES,
        ).x
    return plain.half @ z, s


def _roundoff(target: Array) -> float:
    """Least scatter of numbers: that of an exact fit."""
    return max(numerics.ROUNDOFF * numerics.largest(target), numerics.TINY)
