r"""What the model does not explain: scatter against deviations and repeats, patterns in residuals.

* chi^2 of the residuals, where all deviations are known; F of what repeats do not show themselves.
* Leave-one-posture-out: the residuals of all rows of a posture from a fit to the others,
  ``(1 - H_gg)^-1 r_g`` for the block H_gg of the hat matrix.
* Columns that would be added to the regressor: a backlash of each joint, ``sign`` of its torque; a
  stiffening, torque times its size; a drift with time. Each with its t and, over all of them,
  Holm's limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import InputError
from cartstiff.identify.fitting import Fit
from cartstiff.identify.linear_model import LinearModel, Model
from cartstiff.identify.measurements import POSITION, TURN, Measurements
from cartstiff.identify.unknowns import Unknowns

#: A test speaks where its probability under the model is below this.
_SIGNIFICANT = 0.01
# Repeats further apart than this many standard deviations, or this share of all that was measured.
_APART, _OPPOSITE = 100.0, 1.5
# Other repeats that tell a standard deviation where none is given.
_ENOUGH = 3


@dataclass(frozen=True)
class Pattern:
    """Something in the residuals that another term would explain.

    Attributes
    ----------
    kind : {"backlash", "stiffening", "drift"}
        Kind of the term.
    name : str
        Name of the spring or column.
    size : float
        Its factor: half the play (rad, length); compliance per force; displacement per second.
    probability : float
        Probability of so large a t under the model, by Holm's rule.
    """

    kind: str
    name: str
    size: float
    probability: float


@dataclass(frozen=True, eq=False)
class Checks:
    """What speaks for the model and against it.

    Attributes
    ----------
    chi_squared : float or None
        Weighted sum of squares, where all deviations are known.
    freedom : float
        Numbers less what was fitted.
    probability : float or None
        Probability of a larger one.
    repeats : int
        Numbers beyond the first at the same posture and load.
    lack_of_fit : float or None
        Probability of a larger F of what repeats do not show, where there are repeats.
    left_out : ndarray (m,)
        Leave-one-posture-out residuals, in the numbers' units; NaN where a posture is needed.
    patterns : tuple of Pattern
        That are significant.
    """

    chi_squared: float | None
    freedom: float
    probability: float | None
    repeats: int
    lack_of_fit: float | None
    left_out: Array
    patterns: tuple[Pattern, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "chi_squared": self.chi_squared,
            "freedom": self.freedom,
            "probability": self.probability,
            "repeats": self.repeats,
            "lack_of_fit": self.lack_of_fit,
            "patterns": [vars(p) for p in self.patterns],
        }


def inflation_of(checks: Checks) -> float:
    """Factor on the deviations where the scatter is more than they can explain; 1 elsewhere."""
    if checks.probability is None or checks.chi_squared is None:
        return 1.0
    if checks.probability >= _SIGNIFICANT or not checks.freedom > 0.0:
        return 1.0
    return float(np.sqrt(checks.chi_squared / checks.freedom))


def contradictions(measured: Measurements) -> None:
    """Refuse rows of the same posture and load that cannot both be right.

    Raises
    ------
    InputError
        With the numbers of both rows.
    """
    order = np.argsort(measured.settings, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(measured.settings[order])) + 1)
    several = [g for g in groups if len(g) > 1]
    for name, values in measured.values.items():
        if name in (*POSITION, *TURN):
            largest = np.inf
        else:
            largest = float(np.nanmax(np.abs(values), initial=0.0))
        sd = measured.deviations[name]
        repeats = [mine for g in several if len(mine := g[~np.isnan(values[g])]) > 1]
        squares = np.array([np.sum((values[g] - values[g].mean()) ** 2) for g in repeats])
        freedoms = np.array([len(g) - 1 for g in repeats])
        for n, mine in enumerate(repeats):
            low, high = mine[np.argmin(values[mine])], mine[np.argmax(values[mine])]
            apart = values[high] - values[low]
            spread = np.hypot(sd[low], sd[high])
            limit = _OPPOSITE * largest if np.isnan(spread) else _APART * spread
            others = freedoms.sum() - freedoms[n]
            if np.isnan(spread) and others >= _ENOUGH and squares.sum() > squares[n]:
                of_others = np.sqrt(2.0 * (squares.sum() - squares[n]) / others)
                limit = min(limit, _APART * float(of_others))
            if apart > limit > 0.0:
                a, b = sorted((int(measured.rows[low]), int(measured.rows[high])))
                raise InputError(
                    f"rows {a} and {b} contradict each other in {name!r}: the same posture and "
                    "load",
                    expected=f"values within {limit:.3g} of each other",
                    got=f"{values[low]:.6g} and {values[high]:.6g}",
                )


def checked(
    model: Model, fit: Fit, unknowns: Unknowns, measured: Measurements, kept: NDArray[np.bool_]
) -> Checks:
    """Tests of a fit; `kept` are the numbers (m,) that it rests on."""
    solution, seen = fit.solved, model.observations
    r = solution.residual / solution.deviation
    freedom = float(np.sum(1.0 - solution.leverage[kept]))
    groups = np.unique(seen.is_angle)
    known = all(not np.isnan(seen.deviation[seen.is_angle == g]).any() for g in groups)
    chi = float(np.sum(r[kept] ** 2)) if known else None
    probability = None
    if chi is not None and freedom > 0.0:
        from scipy.special import chdtrc

        probability = float(chdtrc(freedom, chi))
    repeats, lack = _lack_of_fit(seen.column, seen.row, r, freedom, measured, kept)
    patterns: tuple[Pattern, ...] = ()
    if isinstance(model, LinearModel):
        patterns = _patterns(model, fit, unknowns, measured, kept)
    return Checks(
        chi,
        freedom,
        probability,
        repeats,
        lack,
        _left_out(fit, seen.row, measured.postures),
        patterns,
    )


def _lack_of_fit(
    column: tuple[str, ...],
    row: NDArray[np.intp],
    r: Array,
    freedom: float,
    measured: Measurements,
    kept: NDArray[np.bool_],
) -> tuple[int, float | None]:
    """Repeated numbers, and the probability of the F of what they do not show."""
    names = {name: i for i, name in enumerate(dict.fromkeys(column))}
    key = measured.settings[row] * len(names) + np.array([names[name] for name in column])
    _, group = np.unique(key[kept], return_inverse=True)
    inside = r[kept]
    size = np.bincount(group)
    pure = float(np.sum((inside - (np.bincount(group, inside) / size)[group]) ** 2))
    repeats = len(inside) - len(size)
    rest = freedom - repeats
    if repeats < 2 or rest < 1.0 or not pure > 0.0:
        return repeats, None
    from scipy.special import fdtrc

    total = float(np.sum(r[kept] ** 2))
    return repeats, float(fdtrc(rest, repeats, max(total - pure, 0.0) / rest / (pure / repeats)))


def _left_out(fit: Fit, row: NDArray[np.intp], postures: NDArray[np.intp]) -> Array:
    """Leave-one-posture-out residuals (m,)."""
    solution = fit.solved
    m = len(solution.residual)
    whole = solution.whitened
    used = np.abs(whole).any(axis=0)
    U, values, _ = np.linalg.svd(
        whole[:, used] / np.linalg.norm(whole[:, used], axis=0), full_matrices=False
    )
    U = U[:m, : numerics.rank(values)]
    r = solution.residual / solution.deviation
    answer = np.full(m, np.nan)
    group = postures[row]
    order = np.argsort(group, kind="stable")
    blocks = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    for size in {len(b) for b in blocks}:
        these = np.array([b for b in blocks if len(b) == size])
        V = U[these]
        left = np.eye(size) - V @ V.swapaxes(1, 2)
        least = np.linalg.eigvalsh(left)[:, 0]
        fine = least > numerics.ROUNDING**0.5
        if fine.any():
            solved = np.linalg.solve(left[fine], r[these[fine]][..., None])[..., 0]
            answer[these[fine]] = solved
    return np.asarray(answer * solution.deviation)


def _patterns(
    model: LinearModel,
    fit: Fit,
    unknowns: Unknowns,
    measured: Measurements,
    kept: NDArray[np.bool_],
) -> tuple[Pattern, ...]:
    """Terms that would explain more, by the t of each column added."""
    from scipy.special import stdtr

    felt, seen_by = model.forces_in(fit.theta)
    names = unknowns.elements.names
    candidates: list[tuple[str, str, Array]] = []
    for e, name in enumerate(names):
        largest = float(np.abs(felt[:, e]).max(initial=0.0))
        sign = np.where(np.abs(felt[:, e]) > numerics.RANK * largest, np.sign(felt[:, e]), 0.0)
        candidates.append(("backlash", name, seen_by[:, e] * sign))
        bent = felt[:, e] * np.abs(felt[:, e])
        candidates.append(("stiffening", name, seen_by[:, e] * bent))
    time = measured.time[model.observations.row]
    if not np.isnan(time).any() and np.ptp(time) > 0.0:
        columns = np.array(model.observations.column)
        for name in dict.fromkeys(model.observations.column):
            candidates.append(("drift", name, np.where(columns == name, time - time.mean(), 0.0)))
    solution = fit.solved
    m = len(solution.residual)
    B = (solution.whitened[:m])[kept]
    used = np.abs(B).any(axis=0)
    scaled = B[:, used] / np.linalg.norm(B[:, used], axis=0)
    U, values, _ = np.linalg.svd(scaled, full_matrices=False)
    U = U[:, : numerics.rank(values)]
    r = (solution.residual / solution.deviation)[kept]
    r = r - U @ (U.T @ r)
    freedom = len(r) - U.shape[1] - 1
    if freedom < 1:
        return ()
    tested: list[Pattern] = []
    for kind, name, column in candidates:
        x = (column / solution.deviation)[kept]
        own = float(x @ x)
        x = x - U @ (U.T @ x)
        left = float(x @ x)
        if not left > numerics.ROUNDING**0.5 * own:
            continue  # the same as what is fitted
        size = float(x @ r) / left
        rest = float(np.sum((r - size * x) ** 2)) / freedom
        if not rest > 0.0:
            continue
        t = abs(size) * np.sqrt(left / rest)
        tested.append(Pattern(kind, name, size, float(2.0 * stdtr(freedom, -t))))
    tested.sort(key=lambda p: p.probability)
    answer = []
    for i, p in enumerate(tested):
        probability = min(1.0, p.probability * (len(tested) - i))
        if probability >= _SIGNIFICANT:
            break
        answer.append(Pattern(p.kind, p.name, p.size, probability))
    return tuple(answer)
