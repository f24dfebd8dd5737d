r"""A fit that gross errors do not bend, and the rows that it suspects.

SciPy's least squares with Cauchy's loss ``log(1 + (r / 2.385 s)^2)`` [Huber]_, begun at a smoothed
least sum of absolute residuals, with s from the median absolute residual. A number is suspect if
its residual over ``s sqrt(1 - h)`` is beyond what one of all numbers reaches once in a hundred
campaigns. The robust estimates are then least squares without the suspect rows. Where few rows
bear much, a gross error hides in the scale that it makes larger itself: of the rows left, the one
that departs most is compared with the scale without it, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.identify.fitting import Fit, Noise, Solved, quantile, solved
from cartstiff.identify.linear_model import Model
from cartstiff.identify.measurements import Measurements
from cartstiff.identify.observations import Observations
from cartstiff.identify.unknowns import Unknowns

#: Tuning constants for 95 % efficiency, and sd over median absolute deviation, of the normal law.
_CAUCHY, _MAD = 2.385, 1.4826
#: A campaign without gross errors names a suspect with this probability, by each of two tests.
_FALSE_ALARM = 0.01
#: Standard deviations that noise takes off an error in one of 1000 cases.
_SURE = 3.1
_ROUNDS = 6


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
        Beyond which a number is suspect.
    kept : ndarray of bool (m,)
        Numbers of rows that are not suspect.
    suspects : ndarray of int
        Places of the suspect rows.
    row : ndarray of int (m,)
        Place of each number's row.
    shown : ndarray (m,)
        Share of an error of each number that its own residual shows: the fit follows the rest.
    """

    fit: Fit
    standardised: Array
    limit: float
    kept: NDArray[np.bool_]
    suspects: NDArray[np.intp]
    row: NDArray[np.intp]
    shown: Array

    @property
    def unseen(self) -> Array:
        """Error (m,) of each number, in standard deviations, up to which it may stay unseen.

        ``(limit + 3.1) / sqrt(1 - h)``: errors beyond it are found in 999 of 1000 cases [Baarda]_.
        """
        return (self.limit + _SURE) / np.sqrt(self.shown)

    def beyond(self, limit: float) -> NDArray[np.intp]:
        """Places of rows with a number beyond this many standard deviations."""
        return np.unique(self.row[np.abs(self.standardised) > limit])

    def reasons(self, seen: Observations, measured: Measurements) -> dict[int, str]:
        """In words, the worst number of each row."""
        by_row = {}
        for n in range(len(measured)):
            mine = np.flatnonzero(seen.row == n)
            if mine.size:
                worst = mine[np.argmax(np.abs(self.standardised[mine]))]
                by_row[n] = (
                    f"{seen.column[worst]}: residual of {self.standardised[worst]:+.1f} standard "
                    "deviations from the robust fit"
                )
        return by_row


def robust_fit(
    model: Model, unknowns: Unknowns, noise: Noise, nuisance: Array, plain: Fit
) -> Robust:
    """Fit about a plain fit's regressor; for a nonlinear model that regressor is kept."""
    seen = model.observations
    A, target = plain.regressor, plain.target
    priors = [(p, *u.prior) for p, u in enumerate(unknowns.parameters) if u.prior is not None]
    unit, scales = _starting_units(noise, plain)
    divided = np.hstack([A, nuisance]) / unit[:, None]
    right = target / unit
    rank = int(np.count_nonzero(plain.solved.is_determined)) + nuisance.shape[1]
    residual, scales = _residuals(divided, right, noise, rank)
    m = len(seen)
    shown = np.ones(m)
    bad = np.zeros(m, bool)
    limit = _limit(bad, rank)
    fit = plain.solved
    for round_ in range(_ROUNDS):
        size = np.abs(residual) / scales[noise.group]
        flagged = size > limit
        if round_:
            flagged |= _hidden(size, fit, noise, bad)
        rows = np.unique(seen.row[flagged])
        new = np.isin(seen.row, rows)
        if int(np.sum(~new)) < rank + 1:  # nothing would be left to fit
            break
        weights = (~new).astype(float)
        fit = solved(
            A,
            target,
            noise,
            sizes=unknowns.sizes,
            bounded=unknowns.is_bounded,
            nuisance=nuisance,
            priors=priors,
            weights=weights,
        )
        # Rows that were left out have no part in the fit: their residual is wider, not narrower.
        whole = fit.whitened[:m]
        spread = np.where(new, 1.0 + _leverage(whole, weights), 1.0 - fit.leverage)
        raw = target - np.hstack([A, nuisance]) @ np.append(fit.unbounded, fit.offsets)
        spread = np.maximum(spread, numerics.ROUNDING**0.5)
        shown = np.where(new, 1.0, spread)
        residual = raw / (noise.deviation * np.sqrt(spread))
        scales = np.array(fit.scales)
        same = bool(np.all(new == bad))
        bad = new
        limit = _limit(bad, rank)
        if same and round_:
            break
    standardised = residual / scales[noise.group]
    suspects = np.unique(seen.row[bad])
    whole_fit = Fit(fit, fit.theta, A, target, plain.steps) if bad.any() else plain
    return Robust(whole_fit, standardised, limit, ~bad, suspects, seen.row, shown)


def _limit(bad: NDArray[np.bool_], rank: int) -> float:
    """What one of all residuals reaches by chance, over a scale from those that are left."""
    left = int(np.count_nonzero(~bad)) - rank
    return quantile(1.0 - _FALSE_ALARM / len(bad), max(left, 1))


def _hidden(size: Array, fit: Solved, noise: Noise, bad: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The number (m,) that departs most from the others, if they would not produce that by chance.

    ``t = z sqrt((f - 1) / (f - z^2))`` for a residual z over the scale of f degrees of freedom in
    which it has a part itself: Student's t of f - 1 degrees.
    """
    flagged, kept = np.zeros(len(size), bool), ~bad
    for g in np.flatnonzero(~np.array(noise.is_known)):
        mine = np.flatnonzero(kept & (noise.group == g))
        f = float(np.sum(1.0 - fit.leverage[mine]))
        if not mine.size or f < 2.0:
            continue
        z = size[mine]
        t = z * np.sqrt((f - 1.0) / np.maximum(f - z**2, numerics.TINY))
        if t.max() > quantile(1.0 - _FALSE_ALARM / mine.size, f - 1.0):
            flagged[mine[np.argmax(t)]] = True
    return flagged


def _starting_units(noise: Noise, plain: Fit) -> tuple[Array, Array]:
    """Deviations that make lengths and angles comparable."""
    scales = np.array(plain.solved.scales)
    return noise.deviation * scales[noise.group], scales


def _leverage(whole: Array, weights: Array) -> Array:
    """``a^T (A_kept^T A_kept)^-1 a`` for all rows (m,)."""
    kept = whole * np.sqrt(weights)[:, None]
    used = np.abs(whole).any(axis=0)
    _, values, Vt = np.linalg.svd(kept[:, used], full_matrices=False)
    good = values > numerics.RANK * values.max(initial=0.0)
    half = whole[:, used] @ (Vt[good].T / values[good])
    return np.einsum("ij,ij->i", half, half)


def _residuals(divided: Array, right: Array, noise: Noise, rank: int) -> tuple[Array, Array]:
    """Residuals over the given deviations, and the scale of each group, by robust losses."""
    from scipy.optimize import least_squares

    norms = np.linalg.norm(divided, axis=0)
    B = divided / np.where(norms > 0.0, norms, 1.0)
    m = len(right)
    # What no row sees stays where it is.
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
            numerics.ROUNDING * float(np.abs(right).max(initial=numerics.TINY)),
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
        mine = noise.group == g
        if mine.any():
            s = max(_MAD * float(np.median(np.abs(r[mine]))) * correction, numerics.TINY)
            scales[g] = max(s, 1.0) if noise.is_known[g] else s
    return r, scales
