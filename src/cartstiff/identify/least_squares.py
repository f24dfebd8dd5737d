r"""Weighted least squares with positive compliances, scales of noise, and what is not determined.

Numbers y = A theta + N eta + e with nuisances eta (offsets of sessions). Rows are divided by their
standard deviations; where these are not given, one for lengths and one for angles is estimated
with the parameters, ``s^2 = sum r^2 / sum (1 - h)`` with the leverages h. The covariance is that of
the unconstrained solution, ``(A^T A)^-1`` of the divided rows; the bound theta >= 0 moves the
estimate and cuts the interval, which keeps its coverage [BatesWatts]_.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import InputError

# Share of a direction that no row sees, from which on a parameter is not determined.
_UNSEEN = numerics.ROUNDING**0.5
_ROUNDS = 60


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of numbers, known or up to a scale per group.

    Attributes
    ----------
    deviation : ndarray (m,)
        Given; 1 where it is to be estimated.
    group : ndarray of int (m,)
        0 for lengths, 1 for angles.
    is_known : tuple of bool
        Whether the deviation is known of each of the two groups.
    """

    deviation: Array
    group: NDArray[np.intp]
    is_known: tuple[bool, bool]

    @classmethod
    def of(cls, deviation: Array, is_angle: NDArray[np.bool_]) -> Noise:
        """From deviations that are NaN where unknown; all of a group are given, or none.

        Raises
        ------
        InputError
            If some are.
        """
        known = []
        for group, word in ((~is_angle, "lengths"), (is_angle, "angles")):
            missing = np.isnan(deviation[group])
            if missing.any() and not missing.all():
                raise InputError(
                    f"some {word} have a standard deviation and others none",
                    expected="one for each number, or none at all",
                    got=f"{int(missing.sum())} of {len(missing)} without",
                )
            known.append(not missing.any())
        return cls(
            np.where(np.isnan(deviation), 1.0, deviation),
            is_angle.astype(np.intp),
            (known[0], known[1]),
        )


@dataclass(frozen=True, eq=False)
class Solved:
    """A weighted linear fit.

    Attributes
    ----------
    theta : ndarray (P,)
        With the bounds; meaningless where not determined.
    unbounded : ndarray (P,)
        Without them: what intervals are about.
    offsets : ndarray (S,)
        Nuisances.
    covariance : ndarray (P, P)
        NaN where not determined.
    is_determined : ndarray of bool (P,)
        Whether the rows say anything about each parameter by itself.
    singular_values : ndarray
        Singular values of the divided rows with columns of unit length.
    directions : ndarray (P + S, k)
        Combinations of scaled columns that belong to them.
    residual : ndarray (m,)
        Measured less predicted, with the bounds, in the numbers' units.
    deviation : ndarray (m,)
        Standard deviations that were used.
    scales : tuple of float
        By which those given were multiplied, for lengths and angles: estimated where unknown.
    degrees : float
        Degrees of freedom of the t distribution; infinite where all deviations are known.
    whitened : ndarray (m + priors, P + S)
        Columns over the deviations, undetermined ones left out as zeros.
    leverage : ndarray (m,)
        Diagonal of the hat matrix.
    active : ndarray of bool (P,)
        Whose bound holds.
    """

    theta: Array
    unbounded: Array
    offsets: Array
    covariance: Array
    is_determined: NDArray[np.bool_]
    singular_values: Array
    directions: Array
    residual: Array
    deviation: Array
    scales: tuple[float, float]
    degrees: float
    whitened: Array
    leverage: Array
    active: NDArray[np.bool_]

    @property
    def freedom(self) -> float:
        """Numbers less what was fitted to them."""
        return float(np.sum(1.0 - self.leverage))


def solved(
    A: Array,
    target: Array,
    noise: Noise,
    *,
    sizes: Array,
    bounded: NDArray[np.bool_],
    nuisance: Array | None = None,
    priors: list[tuple[int, float, float]] | None = None,
    weights: Array | None = None,
) -> Solved:
    """Fit parameters and nuisances to numbers.

    Parameters
    ----------
    A : ndarray (m, P)
        Regressor.
    target : ndarray (m,)
        Measured.
    noise : Noise
        Noise of the numbers.
    sizes : ndarray (P,)
        Natural sizes of the parameters.
    bounded : ndarray of bool (P,)
        Which are not negative.
    nuisance : ndarray (m, S), optional
        Columns of the nuisances.
    priors : list of (index, value, deviation), optional
        What is known of parameters beforehand.
    weights : ndarray (m,), optional
        Factors from 0 on the weights, as of a robust fit.
    """
    m, P = A.shape
    N = np.zeros((m, 0)) if nuisance is None else nuisance
    extra = np.zeros((len(priors or []), P + N.shape[1]))
    extra_target = np.zeros(len(extra))
    for row, (p, value, spread) in enumerate(priors or []):
        extra[row, p], extra_target[row] = 1.0 / spread, value / spread
    full = np.hstack([A * 1.0, N])
    root = np.ones(m) if weights is None else np.sqrt(weights)
    scales: Array = np.ones(2, float)
    known = np.array(noise.is_known)
    floor = np.full(2, numerics.TINY)
    for g in np.flatnonzero(~known):
        largest = float(np.abs(target[noise.group == g]).max(initial=0.0))
        scales[g] = max(largest, numerics.TINY)
        floor[g] = max(numerics.EPSILON * largest, numerics.TINY)  # what fits exactly
    h = np.zeros(m)
    for _ in range(_ROUNDS):
        deviation = noise.deviation * scales[noise.group]
        divided = np.vstack([full * (root / deviation)[:, None], extra])
        right = np.append(target * root / deviation, extra_target)
        basis = _Basis(divided, P, sizes)
        x = basis.solution(right)
        r = target - full @ x
        h = basis.leverage[:m]
        before = scales.copy()
        for g in np.flatnonzero(~known):
            mine = (noise.group == g) & (root > 0)
            if mine.any():
                left = float(np.sum(1.0 - h[mine]))
                square = float(np.sum((root * r / noise.deviation)[mine] ** 2))
                scales[g] = max(np.sqrt(square / left) if left > _UNSEEN else np.nan, floor[g])
        if np.isnan(scales).any() or np.all(np.abs(scales - before) <= numerics.REACHED * scales):
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
    covariance = basis.covariance()[:P, :P]
    return Solved(
        theta[:P],
        x[:P],
        theta[P:],
        covariance,
        basis.is_determined[:P],
        basis.values,
        basis.directions,
        target - full @ theta,
        noise.deviation * scales[noise.group],
        (float(scales[0]), float(scales[1])),
        _degrees(noise, h, root),
        basis.kept,
        h,
        active,
    )


def _degrees(noise: Noise, h: Array, root: Array) -> float:
    """Degrees of freedom of the least well known scale."""
    degrees = [
        float(np.sum((1.0 - h)[(noise.group == g) & (root > 0)]))
        for g in (0, 1)
        if not noise.is_known[g] and (noise.group == g).any()
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
        is_seen[parameters:] = norms[parameters:] > 0.0
        self.scale = np.where(is_seen, natural / np.where(is_seen, norms, 1.0), 0.0)
        self.kept = np.where(is_seen, divided, 0.0)
        self._U, self.values, Vt = np.linalg.svd(divided * self.scale, full_matrices=False)
        self.directions = Vt.T
        self.rank = numerics.rank(self.values)
        lost = Vt[self.rank :].T
        self.is_determined = is_seen & (np.linalg.norm(lost, axis=1) <= _UNSEEN)
        if lost.shape[1] + self.rank < len(
            is_seen
        ):  # fewer rows than columns: the rest is lost too
            inside = np.linalg.norm(Vt[: self.rank], axis=0)
            self.is_determined = is_seen & (np.abs(1.0 - inside) <= _UNSEEN)
        self.leverage = np.einsum("ij,ij->i", self._U[:, : self.rank], self._U[:, : self.rank])

    def solution(self, right: Array) -> Array:
        """Least squares, of least norm where not determined."""
        inner = (self._U.T @ right)[: self.rank] / self.values[: self.rank]
        return np.asarray(self.scale * (self.directions[:, : self.rank] @ inner))

    def covariance(self) -> Array:
        """Covariance of all columns; NaN where not determined."""
        half = self.scale[:, None] * (self.directions[:, : self.rank] / self.values[: self.rank])
        C = half @ half.T
        lost = ~self.is_determined
        C[lost], C[:, lost] = np.nan, np.nan
        return C

    def bounded(self, right: Array, bounded: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        """Least squares with lower bounds at zero, and whose bound holds."""
        from scipy.optimize import lsq_linear

        use = self.scale > 0.0
        lower = np.full(len(use), -np.inf)
        lower[: self._P] = np.where(bounded, 0.0, -np.inf)
        solution = lsq_linear(
            self.kept[:, use] * self.scale[use],
            right,
            bounds=(lower[use], np.inf),
            method="bvls",
            tol=numerics.LAST_DIGITS,
            max_iter=10 * len(use),
        )
        x = np.zeros(len(use))
        x[use] = self.scale[use] * solution.x
        active = np.zeros(self._P, bool)
        active[use[: self._P]] = solution.active_mask[: int(use[: self._P].sum())] != 0
        return x, active & self.is_determined[: self._P]
