"""Weighted least squares: one linear step, and a nonlinear search by SciPy within bounds.

Numbers y = A theta + N eta + e with nuisances eta (offsets of sessions). Rows are divided by their
standard deviations; if these are not given, one for lengths and one for angles is estimated
with the parameters, ``s^2 = sum r^2 / sum (1 - h)`` with the leverages h. Singular values of the
divided rows, their columns of unit length, show which parameters the rows determine. The covariance
is that of the unconstrained solution, ``(A^T A)^-1`` of the divided rows; the bound theta >= 0
moves the estimate and truncates the interval, which keeps its coverage [BatesWatts]_.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import CartstiffError, ConvergenceError, InputError
from cartstiff.geometry import se3
from cartstiff.identify.measurements import Observations
from cartstiff.identify.models import Model
from cartstiff.identify.unknowns import PARTS, Unknowns, placement_of, size_of
from cartstiff.mechanisms.identified import quantile

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
        Right-hand side: the measured numbers less the part that does not depend on the parameters.
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
    basis : ndarray (m + priors, r)
        Orthonormal basis of the range of the columns over the deviations.
    half : ndarray (P + S, r)
        The solution of least norm is ``half @ basis.T @ b``, its covariance ``half @ half.T``.
    active : ndarray of bool (P,)
        Parameters at their bound.
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
    scales: tuple[float, float]
    degrees: float
    basis: Array
    half: Array
    active: NDArray[np.bool_]

    @property
    def leverage(self) -> Array:
        """Diagonal (m,) of the hat matrix."""
        return np.asarray((self.basis[: len(self.residual)] ** 2).sum(axis=1))

    def moved_by(self, errors: Array) -> Array:
        """Changes (P + S, k) of parameters and nuisances by errors (m, k) of the numbers."""
        pushed = self.basis[: len(errors)].T @ (errors / self.deviation[:, None])
        return np.asarray(self.half @ pushed)

    def variances_of_predictions(self, columns: Array) -> Array:
        """``a^T (A^T A)^-1 a`` (m,) for the rows a of columns (m, P + S) over the deviations."""
        return np.asarray(((columns / self.deviation[:, None] @ self.half) ** 2).sum(axis=1))

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
    weights: Array | None = None,
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
        Natural sizes, bounds and prior knowledge of the parameters.
    nuisance : ndarray (m, S), optional
        Columns of the nuisances.
    weights : ndarray (m,), optional
        Factors from 0 on the weights, as of a robust fit.
    """
    m, P = A.shape
    N = np.zeros((m, 0)) if nuisance is None else nuisance
    extra, extra_target = unknowns.priors
    extra = np.hstack([extra, np.zeros((len(extra), N.shape[1]))])
    bounded = unknowns.is_bounded
    full = np.hstack([A * 1.0, N])
    root = np.ones(m) if weights is None else np.sqrt(weights)
    scales, floor = np.ones(2), np.full(2, numerics.TINY)
    group, unit = seen.group, seen.unit
    unknown = np.flatnonzero(~seen.is_known)
    for g in unknown:
        largest = float(np.abs(target[group == g]).max(initial=0.0))
        scales[g] = max(largest, numerics.TINY)
        floor[g] = max(numerics.ROUNDOFF * largest, numerics.TINY)  # of an exact fit
    h = np.zeros(m)
    for _ in range(_MAX_SCALE_STEPS):
        deviation = unit * scales[group]
        divided = np.vstack([full * (root / deviation)[:, None], extra])
        right = np.append(target * root / deviation, extra_target)
        basis = _Basis(divided, P, unknowns.sizes)
        x = basis.half @ (basis.U.T @ right)
        r = target - full @ x
        h = (basis.U[:m] ** 2).sum(axis=1)
        before = scales.copy()
        for g in unknown:
            mine = (group == g) & (root > 0)
            if mine.any():
                left = float(np.sum(1.0 - h[mine]))
                square = float(np.sum((root * r / unit)[mine] ** 2))
                scales[g] = max(
                    np.sqrt(square / left) if left > _UNOBSERVABLE else np.nan, floor[g]
                )
        if np.isnan(scales).any() or np.all(
            np.abs(scales - before) <= numerics.CONSTRAINT_TOLERANCE * scales
        ):
            break
    if np.isnan(scales).any():
        raise InputError(
            "as many parameters as numbers: no residual is left to estimate the noise from",
            expected="more rows, or standard deviations (columns sd_..., --sd)",
            got=f"{m} numbers for {P + N.shape[1]} unknowns",
        )
    theta, active = x, np.zeros(P, bool)
    if np.any(x[:P][bounded & basis.is_determined[:P]] < 0.0):
        theta, active = basis.bounded(right, bounded)
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
        (float(scales[0]), float(scales[1])),
        _degrees(seen, h, root),
        basis.U,
        basis.half,
        active,
    )


def _degrees(seen: Observations, h: Array, root: Array) -> float:
    """Degrees of freedom of the least certain scale."""
    degrees = [
        float(np.sum((1.0 - h)[(seen.group == g) & (root > 0)]))
        for g in np.flatnonzero(~seen.is_known)
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

    def bounded(self, right: Array, bounded: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        """Least squares with lower bounds at zero, and the parameters at their bound."""
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
        active = np.zeros(self._P, bool)
        active[use[: self._P]] = solution.active_mask[: int(use[: self._P].sum())] != 0
        return x, active & self.is_determined[: self._P]


# Bounds on the evaluations of a search, and on the searches with new scales of the noise; and the
# relative change of the scales that ends them.
_MAX_EVALUATIONS, _MAX_SEARCHES, _SAME_SCALES = 200, 6, 1e-3
# Standard deviation, in natural sizes, above which a parameter is not determined; and that of the
# weak prior at the start of a search, so that unobservable parameters stay there.
_MAX_DEVIATION, _START_DEVIATION = 10.0, 100.0


def fitted(
    model: Model,
    *,
    start: Array | None = None,
    once: bool = False,
    progress: Callable[[int, float], None] | None = None,
) -> Fit:
    """Fit a model's parameters and its offsets to its observations.

    Parameters
    ----------
    model : Model
        Predictions and derivatives.
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
    if model.is_linear or once:
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
    lost = ~(spread <= _MAX_DEVIATION * np.maximum(sizes, np.abs(fit.theta)))
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

    Parameters that the rows do not determine do not move; offsets are eliminated, which is exact
    since they enter linearly.
    """
    weight, target, unknowns = 1.0 / deviation, model.observations.target, model.unknowns
    U, values, _ = np.linalg.svd(model.offsets.columns * weight[:, None], full_matrices=False)
    Q = U[:, : numerics.rank(values)]
    sizes, bounded, (extra, extra_target) = unknowns.sizes, unknowns.is_bounded, unknowns.priors
    start = np.where(bounded, np.maximum(theta / sizes, numerics.TINY), theta / sizes)
    weak = np.eye(len(start)) / _START_DEVIATION

    def residual(z: Array) -> Array:
        try:
            y, _ = evaluate(z * sizes)
        except CartstiffError:  # no equilibrium, or no stiffness: a shorter step
            return np.full(len(target) + len(extra) + len(z), np.nan)
        r = (y - target) * weight
        return np.concatenate(
            [r - Q @ (Q.T @ r), extra @ (z * sizes) - extra_target, weak @ (z - start)]
        )

    def jacobian(z: Array) -> Array:
        report(float(np.linalg.norm(residual(z))))
        J = evaluate(z * sizes)[1] * weight[:, None]
        return np.vstack([np.vstack([J - Q @ (Q.T @ J), extra]) * sizes, weak])

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
            "the fit does not settle", iterations=found.nfev, residual=2.0 * float(found.cost)
        )
    return np.asarray(found.x * sizes)


# Standard deviation above which an offset is not determined: rad, and shares of the mechanism.
_MAX_OFFSET_DEVIATION = 0.1


def geometry_of(model: Model, fit: Fit) -> dict[str, tuple[float, float]]:
    """Change and standard deviation of zeros, tool and base, beyond what the rows count already.

    The deviation is NaN if the rows do not determine the number.
    """
    names, first = model.offsets.geometry, len(model.offsets.names) - len(model.offsets.geometry)
    G = np.eye(len(names))
    for word in ("base", "tool"):
        at = [i for i, name in enumerate(names) if name.startswith(f"{word}.")]
        parts = [PARTS.index(names[i][5:]) for i in at]
        G[np.ix_(at, at)] = rates_by_step(model.measured.found, word)[np.ix_(parts, parts)]
    # An undetermined number, whose covariance is NaN, spoils only those that it enters.
    near = [np.flatnonzero(np.abs(g) >= _MAX_OFFSET_DEVIATION) for g in G]
    C, changes = fit.offset_covariance[first:, first:], (G @ fit.offsets[first:]).tolist()
    answer = {}
    for name, change, g, i in zip(names, changes, G, near, strict=True):
        s = float(np.sqrt(g[i] @ C[np.ix_(i, i)] @ g[i]))
        limit = _MAX_OFFSET_DEVIATION * size_of(model.unknowns.elements.elastic, name)
        answer[name] = change, s if s <= limit else np.nan
    return answer


def rates_by_step(found: Mapping[str, float], word: str) -> Array:
    """Changes of the six numbers of a base or tool by a step (6, 6).

    A step of the base is along its turned axes, and turns before it; one of the tool is along the
    body's axes, and turns after it.
    """
    T, G = placement_of(found, word), np.eye(6)
    turning = se3.right_jacobian_inverse(se3.log(se3.pose(T[:3, :3])))[:3, :3]
    G[3:, 3:] = turning if word == "base" else turning.T
    G[:3, :3] = T[:3, :3] if word == "base" else np.eye(3)
    return G


#: Tuning constants for 95 % efficiency, and sd over median absolute deviation, of the normal law.
_CAUCHY, _MAD = 2.385, 1.4826
#: Probability that a table without gross errors has a suspect, by each of two tests.
_FALSE_ALARM = 0.01
#: Standard deviations by which noise reduces an error in one of 1000 cases.
_NOISE_IN_999_OF_1000 = 3.1
_MAX_REWEIGHTINGS = 6


@dataclass(frozen=True, eq=False)
class Robust:
    """The robust fit.

    Attributes
    ----------
    fit : Fit
        Least squares without the suspect rows.
    standardised : ndarray (m,)
        Residual of every number from it, over its own standard deviation.
    limit : float
        Standardised residual beyond which a number is suspect.
    kept : ndarray of bool (m,)
        Numbers of rows that are not suspect.
    suspects : ndarray of int
        Places of the suspect rows.
    seen : Observations
        The numbers.
    shown : ndarray (m,)
        Share of an error of each number that appears in its own residual: the fit absorbs the rest.
    """

    fit: Fit
    standardised: Array
    limit: float
    kept: NDArray[np.bool_]
    suspects: NDArray[np.intp]
    seen: Observations
    shown: Array

    @property
    def unseen(self) -> Array:
        """Largest undetected error (m,) of each number, in standard deviations.

        ``(limit + 3.1) / sqrt(1 - h)``: errors beyond it are found in 999 of 1000 cases [Baarda]_.
        """
        return (self.limit + _NOISE_IN_999_OF_1000) / np.sqrt(self.shown)

    def beyond(self, limit: float) -> NDArray[np.intp]:
        """Places of rows with a number beyond this many standard deviations."""
        return np.unique(self.seen.row[np.abs(self.standardised) > limit])

    def reason(self, n: int) -> str:
        """The largest residual of the row at a place."""
        mine = np.flatnonzero(self.seen.row == n)
        worst = mine[np.argmax(np.abs(self.standardised[mine]))]
        return (
            f"{self.seen.column[worst]}: residual of {self.standardised[worst]:+.1f} standard "
            "deviations from the robust fit"
        )


def robust_fit(model: Model, plain: Fit) -> Robust:
    """Fit about a plain fit's regressor; for a nonlinear model that regressor is kept."""
    seen, nuisance = model.observations, model.offsets.columns
    A, target = plain.regressor, plain.target
    columns, unit, m = np.hstack([A, nuisance]), plain.deviation, len(seen)
    rank = int(np.count_nonzero(plain.is_determined)) + nuisance.shape[1]
    residual, scales = _residuals(columns / unit[:, None], target / unit, seen, rank)
    shown = np.ones(m)
    bad = np.zeros(m, bool)
    limit = _limit(bad, rank)
    fit = plain
    for round_ in range(_MAX_REWEIGHTINGS):
        size = np.abs(residual) / scales[seen.group]
        flagged = size > limit
        if round_:
            flagged |= _hidden(size, fit, seen, bad)
        rows = np.unique(seen.row[flagged])
        new = np.isin(seen.row, rows)
        if int(np.sum(~new)) < rank + 1:  # too few rows would remain
            break
        kept = (~new).astype(float)
        fit = linear_fit(A, target, seen, model.unknowns, nuisance=nuisance, weights=kept)
        # Rows that were left out have no part in the fit: their residual is wider, not narrower.
        of_prediction = 1.0 + fit.variances_of_predictions(columns)
        spread = np.where(new, of_prediction, 1.0 - fit.leverage)
        raw = target - columns @ np.append(fit.unbounded, fit.offsets)
        spread = np.maximum(spread, numerics.ROUNDOFF**0.5)
        shown = np.where(new, 1.0, spread)
        residual = raw / (seen.unit * np.sqrt(spread))
        scales = np.array(fit.scales)
        same = bool(np.all(new == bad))
        bad = new
        limit = _limit(bad, rank)
        if same and round_:
            break
    standardised = residual / scales[seen.group]
    suspects = np.unique(seen.row[bad])
    return Robust(fit if bad.any() else plain, standardised, limit, ~bad, suspects, seen, shown)


def _limit(bad: NDArray[np.bool_], rank: int) -> float:
    """Largest of all standardised residuals by chance, with a scale from the kept rows."""
    left = int(np.count_nonzero(~bad)) - rank
    return quantile(1.0 - _FALSE_ALARM / len(bad), max(left, 1))


def _hidden(size: Array, fit: Fit, seen: Observations, bad: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Flag (m,) of the number with the largest residual, if that is improbable by chance.

    ``t = z sqrt((f - 1) / (f - z^2))`` for a residual z over the scale of f degrees of freedom that
    includes z itself: Student's t of f - 1 degrees.
    """
    flagged, kept = np.zeros(len(size), bool), ~bad
    for g in np.flatnonzero(~seen.is_known):
        mine = np.flatnonzero(kept & (seen.group == g))
        f = float(np.sum(1.0 - fit.leverage[mine]))
        if not mine.size or f < 2.0:
            continue
        z = size[mine]
        t = z * np.sqrt((f - 1.0) / np.maximum(f - z**2, numerics.TINY))
        if t.max() > quantile(1.0 - _FALSE_ALARM / mine.size, f - 1.0):
            flagged[mine[np.argmax(t)]] = True
    return flagged


def _residuals(divided: Array, right: Array, seen: Observations, rank: int) -> tuple[Array, Array]:
    """Residuals over the given deviations, and the scale of each group, by robust losses."""
    from scipy.optimize import least_squares

    norms = np.linalg.norm(divided, axis=0)
    B = divided / np.where(norms > 0.0, norms, 1.0)
    m = len(right)
    # Unobservable combinations do not move.
    U, values, Vt = np.linalg.svd(B, full_matrices=False)
    keep = values > numerics.RANK * values.max(initial=numerics.TINY)
    basis = (U[:, keep] * values[keep]) @ Vt[keep]
    B = basis @ Vt[keep].T
    x = np.linalg.lstsq(B, right, rcond=None)[0]
    r = right - B @ x
    correction = np.sqrt(m / max(m - rank, 1))

    def scale_of(r: Array) -> float:
        return max(
            _MAD * float(np.median(np.abs(r))) * correction,
            numerics.ROUNDOFF * float(np.abs(right).max(initial=numerics.TINY)),
        )

    for loss, factor, rounds in (("soft_l1", 0.1, 2), ("cauchy", _CAUCHY, 3)):
        for _ in range(rounds):
            s = scale_of(r)
            optimum = least_squares(
                lambda x: B @ x - right,
                x,
                jac=lambda _: B,
                loss=loss,
                f_scale=factor * s,
                x_scale="jac",
                max_nfev=200,
            )
            x = optimum.x
            r = right - B @ x
    scales = np.ones(2)
    for g in (0, 1):
        mine = seen.group == g
        if mine.any():
            s = max(_MAD * float(np.median(np.abs(r[mine]))) * correction, numerics.TINY)
            scales[g] = max(s, 1.0) if seen.is_known[g] else s
    return r, scales
