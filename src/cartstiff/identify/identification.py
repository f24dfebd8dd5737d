"""From measurements to springs: sessions, fits, checks, estimates with intervals, notes.

An interval ``c -+ t s`` of a compliance is truncated at zero; its ends are 1/k. If it reaches zero
the stiffness has no upper end: it is "at least" the lower one.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import permutations, product
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.described import described
from cartstiff.errors import (
    CartstiffError,
    ConvergenceError,
    InputError,
    check_name,
    listed,
    printable,
)
from cartstiff.figures import new_figure
from cartstiff.identify.fitting import Fit, Robust, fitted, geometry_of, robust_fit
from cartstiff.identify.measurements import (
    DISPLACEMENT,
    EARTH,
    POSITION,
    ROTATION,
    TURN,
    Measurements,
    Observations,
    field_of,
    read_measurements,
)
from cartstiff.identify.models import (
    LoadedModel,
    Model,
    model_of,
    needs_equilibrium,
)
from cartstiff.identify.unknowns import (
    ZERO,
    OffsetEstimate,
    Unknown,
    Unknowns,
    corrected,
    corrections,
    in_base,
    offsets_of,
    sessions_turned_back,
    unit_of,
    unknowns_of,
    zeros_of,
)
from cartstiff.mechanisms.contract import SI, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.identified import CompliancePattern, Identified, quantile
from cartstiff.notes import Note
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.results import LabelledResult

#: Probability under the model below which a test is significant.
_SIGNIFICANT = 0.01
# Difference of contradictory repeats, in standard deviations, and as a share of the largest number.
_CONTRADICTION, _LARGEST_SHARE = 100.0, 1.5
# Least number of other repeats from which a standard deviation is estimated if none is given.
_MIN_REPEATS = 3


@dataclass(frozen=True)
class Pattern:
    """A pattern of the residuals that a further term explains.

    Attributes
    ----------
    kind : {"backlash", "stiffening", "drift", "geometry"}
        Kind of the term.
    name : str
        Name of the spring or column; of a zero or offset that is not sought ("tool.x").
    size : float
        Its factor: half the play (rad, length); compliance per force; displacement per second; the
        error of the zero or offset.
    probability : float
        Probability of so large a t without it, by Bonferroni's rule, beside those found before.
    """

    kind: str
    name: str
    size: float
    probability: float


@dataclass(frozen=True, eq=False)
class Checks:
    """Tests of the model.

    Attributes
    ----------
    chi_squared : float or None
        Weighted sum of squares, if all deviations are known.
    freedom : float
        Numbers less fitted parameters.
    probability : float or None
        Probability of a larger one.
    repeats : int
        Numbers beyond the first at the same posture and load.
    lack_of_fit : float or None
        Probability of a larger F of the part that repeats do not explain, if there are repeats.
    left_out : ndarray (m,)
        Leave-one-posture-out residuals, in the numbers' units; NaN for indispensable postures.
    patterns : tuple of Pattern
        The significant ones.
    unexplained : float
        Root of the weighted sum of squares over that without the springs: 0 if these explain all
        that was measured beyond the rigid mechanism and its offsets, 1 if nothing.
    """

    chi_squared: float | None
    freedom: float
    probability: float | None
    repeats: int
    lack_of_fit: float | None
    left_out: Array
    patterns: tuple[Pattern, ...]
    unexplained: float


def contradictions(measured: Measurements) -> None:
    """Refuse rows of the same posture and load that cannot both be right.

    Raises
    ------
    InputError
        With the numbers of both rows.
    """
    for name, values in measured.values.items():
        is_place = name in (*POSITION, *TURN)
        largest = np.inf if is_place else float(np.nanmax(np.abs(values), initial=0.0))
        sd, known = measured.deviations[name], np.flatnonzero(~np.isnan(values))
        settings = measured.settings[known]
        repeats = [known[settings == g] for g in np.flatnonzero(np.bincount(settings) > 1)]
        squares = np.array([np.sum((values[g] - values[g].mean()) ** 2) for g in repeats])
        freedoms = np.array([len(g) - 1 for g in repeats])
        for n, mine in enumerate(repeats):
            low, high = mine[np.argmin(values[mine])], mine[np.argmax(values[mine])]
            difference, spread = values[high] - values[low], np.hypot(sd[low], sd[high])
            limit = _LARGEST_SHARE * largest if np.isnan(spread) else _CONTRADICTION * spread
            others, rest = freedoms.sum() - freedoms[n], squares.sum() - squares[n]
            if np.isnan(spread) and others >= _MIN_REPEATS and rest > 0.0:
                limit = min(limit, _CONTRADICTION * float(np.sqrt(2.0 * rest / others)))
            if difference > limit > 0.0:
                a, b = sorted((int(measured.rows[low]), int(measured.rows[high])))
                raise InputError(
                    f"rows {a} and {b} contradict each other in {name!r}: the same posture and "
                    "load",
                    expected=f"values within {limit:.3g} of each other",
                    got=f"{values[low]:.6g} and {values[high]:.6g}",
                )


def checked(model: Model, fit: Fit, kept: NDArray[np.bool_]) -> Checks:
    """Tests of a fit; `kept` are the numbers (m,) that it uses."""
    seen = model.observations
    r = fit.residual / fit.deviation
    freedom = float(np.sum(1.0 - fit.leverage[kept]))
    chi = float(np.sum(r[kept] ** 2)) if seen.is_known.all() else None
    probability = None
    if chi is not None and freedom > 0.0:
        from scipy.special import chdtrc

        probability = float(chdtrc(freedom, chi))
    per = 1.0 / fit.deviation[kept]
    rigid, N = per * fit.target[kept], per[:, None] * model.offsets.columns[kept]
    rigid = rigid - N @ np.linalg.lstsq(N, rigid, rcond=numerics.RANK)[0]
    return Checks(
        chi,
        freedom,
        probability,
        *_lack_of_fit(model, r, freedom, kept),
        _left_out(model, fit),
        () if isinstance(model, LoadedModel) else _patterns(model, fit, kept),
        float(np.linalg.norm(r[kept])) / max(float(np.linalg.norm(rigid)), numerics.TINY),
    )


def _lack_of_fit(
    model: Model, r: Array, freedom: float, kept: NDArray[np.bool_]
) -> tuple[int, float | None]:
    """Repeated numbers, and the probability of the F of the part that they do not explain."""
    seen = model.observations
    column = np.unique(seen.column, return_inverse=True)[1]
    keys = np.stack([model.measured.settings[seen.row], column])[:, kept]
    group = np.unique(keys, axis=1, return_inverse=True)[1].reshape(-1)
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


def _left_out(model: Model, fit: Fit) -> Array:
    """Leave-one-posture-out residuals (m,)."""
    r = fit.residual / fit.deviation
    group = model.measured.postures[model.observations.row]
    answer = np.full(len(r), np.nan)
    order = np.argsort(group, kind="stable")
    for mine in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        U = fit.basis[mine]
        left = np.eye(len(mine)) - U @ U.T
        if np.linalg.eigvalsh(left)[0] > numerics.ROUNDOFF**0.5:
            answer[mine] = np.linalg.solve(left, r[mine])
    return answer * fit.deviation


def _patterns(model: Model, fit: Fit, kept: NDArray[np.bool_]) -> tuple[Pattern, ...]:
    """Terms that explain more, by the t of an added column, the strongest first."""
    from scipy.linalg import orth
    from scipy.special import stdtr

    unknowns, seen, measured = model.unknowns, model.observations, model.measured
    forces, by_functional = model.forces_in(fit.theta)
    names: list[tuple[str, str]] = []
    columns: list[Array] = []
    for e, name in enumerate(unknowns.elements.names):
        force, carried = forces[:, e], np.abs(forces[:, e])
        if not carried.max(initial=0.0) > numerics.RANK * np.abs(forces).max(initial=0.0):
            continue  # it carries nothing
        sign = np.where(carried > numerics.RANK * carried.max(), np.sign(force), 0.0)
        names += [("backlash", name), ("stiffening", name)]
        columns += [by_functional[:, e] * sign, by_functional[:, e] * force * carried]
    if seen.is_absolute.any():
        elastic = unknowns.elements.elastic
        others = {*zeros_of(elastic), "tool", "base"}.difference(unknowns.geometry)
        more = replace(unknowns, geometry=tuple(sorted(others)), sessions="none")
        wrong = offsets_of(more, seen, measured)
        names += [("geometry", name) for name in wrong.names]
        columns += list(wrong.columns.T)
    time = measured.time[seen.row]
    if not np.isnan(time).any() and np.ptp(time) > 0.0:
        for name in dict.fromkeys(seen.column):
            names.append(("drift", name))
            columns.append(np.where(np.array(seen.column) == name, time - time.mean(), 0.0))
    U = orth(fit.basis[: len(kept)][kept], rcond=numerics.RANK)
    r = (fit.residual / fit.deviation)[kept]
    r = r - U @ (U.T @ r)
    freedom, found = len(r) - U.shape[1] - 1, list[Pattern]()
    if not names:
        return ()
    X = (np.stack(columns, axis=1) / fit.deviation[:, None])[kept]
    least = numerics.ROUNDOFF**0.25 * np.linalg.norm(X, axis=0)  # else one of the fitted columns
    while freedom >= 1:
        X = X - U @ (U.T @ X)
        left = np.linalg.norm(X, axis=0)
        size = X.T @ r / np.maximum(left**2, numerics.TINY)
        rest = np.linalg.norm(r[:, None] - X * size, axis=0) / np.sqrt(freedom)
        t = np.abs(size) * left / np.maximum(rest, numerics.TINY)
        is_play = np.array([kind == "backlash" for kind, _ in names])
        t[~(left > least) | ~(rest > 0.0) | (is_play & (size < 0.0))] = 0.0  # no play is negative
        i = int(np.argmax(t))
        probability = min(1.0, float(2.0 * stdtr(freedom, -t[i])) * (len(names) - len(found)))
        if probability >= _SIGNIFICANT:
            break
        found.append(Pattern(*names[i], float(size[i]), probability))
        U = np.column_stack([U, X[:, i] / left[i]])  # what it explains is no sign of the others
        r, freedom = r - U[:, -1] * (U[:, -1] @ r), freedom - 1
    return tuple(found)


Verdict = Literal["determined", "at-least", "not-identifiable", "negative"]


@dataclass(frozen=True)
class Estimate:
    """Estimate of one parameter.

    Attributes
    ----------
    unknown : Unknown
        The parameter.
    verdict : {"determined", "at-least", "not-identifiable", "negative"}
        A finite interval of the stiffness; one without an upper end; none; a compliance whose whole
        interval is below zero, which contradicts the model.
    compliance, deviation : float or None
        Estimate and standard deviation.
    interval : tuple of float or None
        Interval of the compliance.
    """

    unknown: Unknown
    verdict: Verdict
    compliance: float | None
    deviation: float | None
    interval: tuple[float, float] | None

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.unknown.name

    @property
    def stiffness(self) -> float | None:
        """1 / compliance, if that is above zero and known."""
        if self.compliance is None or not self.compliance > 0.0:
            return None
        if not self.unknown.has_stiffness or self.verdict == "negative":
            return None
        return 1.0 / self.compliance

    @property
    def stiffness_interval(self) -> tuple[float | None, float | None]:
        """Lower and upper end, or None."""
        if self.interval is None or not self.unknown.has_stiffness:
            return None, None
        low, high = self.interval
        return (1.0 / high if high > 0.0 else None), (1.0 / low if low > 0.0 else None)


def estimates(fit: Fit, unknowns: Unknowns, t: float, wider: Array) -> tuple[Estimate, ...]:
    """One estimate per parameter.

    Parameters
    ----------
    fit : Fit
        With the covariance that is used.
    unknowns : Unknowns
        The fitted parameters.
    t : float
        Half width of an interval over the standard deviation.
    wider : ndarray (P,)
        Widths added at both ends.
    """
    answer = []
    for p, unknown in enumerate(unknowns.parameters):
        if not fit.is_determined[p]:
            answer.append(Estimate(unknown, "not-identifiable", None, None, None))
            continue
        s, centre = float(np.sqrt(fit.covariance[p, p])), float(fit.unbounded[p])
        half = t * s + float(wider[p])
        low, high = centre - half, centre + half
        verdict: Verdict = "determined"
        if unknown.has_stiffness:
            if high < 0.0:
                verdict = "negative"
            elif low <= 0.0:
                verdict = "at-least"
            low, high = max(low, 0.0), max(high, 0.0)
        answer.append(Estimate(unknown, verdict, float(fit.theta[p]), s, (low, high)))
    return tuple(answer)


@dataclass(frozen=True)
class Rejected:
    """A rejected row: its number from 1, and the reason."""

    row: int
    reason: str


@dataclass(frozen=True, eq=False, repr=False)
class Identification(LabelledResult):
    """Springs found from measurements.

    Attributes
    ----------
    model : Model
        Unknowns, rows used, predictions and their derivatives.
    rows : int
        Rows of the table.
    rejected : tuple of Rejected
        Rows that were left out.
    plain : Fit
        Least squares on all rows used.
    robust : Robust
        The robust fit.
    level : float
        Probability of the intervals.
    fit : str
        Option of `identify`.
    """

    command: ClassVar = "identify"

    model: Model
    rows: int
    rejected: tuple[Rejected, ...]
    plain: Fit
    robust: Robust
    level: float
    fit: str

    @property
    def unknowns(self) -> Unknowns:
        """The parameters."""
        return self.model.unknowns

    @property
    def measured(self) -> Measurements:
        """The rows used, corrected by the zeros and offsets found."""
        return self.model.measured

    @property
    def elastic(self) -> ElasticMechanism:
        """The measured mechanism."""
        return self.unknowns.elements.elastic

    @property
    def offsets(self) -> str:
        """Unknown part of the pose of each session's frame."""
        return self.unknowns.sessions

    @property
    def loaded(self) -> bool:
        """Whether the equilibrium under load was fitted."""
        return isinstance(self.model, LoadedModel)

    @cached_property
    def chosen(self) -> Fit:
        """The fit of the estimates, whose covariance counts the inflation."""
        fit, factor = self.robust.fit if self.fit == "robust" else self.plain, self.inflation**2
        return replace(
            fit,
            covariance=fit.covariance * factor,
            offset_covariance=fit.offset_covariance * factor,
        )

    @cached_property
    def checks(self) -> Checks:
        """Checks of the model."""
        if self.fit == "robust":
            return checked(self.model, self.robust.fit, self.robust.kept)
        return checked(self.model, self.plain, np.ones(len(self.model.observations), bool))

    @property
    def inflation(self) -> float:
        """Factor on all standard deviations if the scatter is larger than those given; else 1."""
        chi, probability = self.checks.chi_squared, self.checks.probability
        if chi is None or probability is None or probability >= _SIGNIFICANT:
            return 1.0
        return float(np.sqrt(chi / self.checks.freedom))

    @property
    def covariance(self) -> Array:
        """Covariance of the compliances (P, P); NaN where not identifiable."""
        return self.chosen.covariance

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the intervals."""
        fit = self.chosen
        return fit.degrees if self.inflation == 1.0 else min(fit.degrees, fit.freedom)

    @property
    def factor(self) -> float:
        """Half width of an interval over the standard deviation."""
        return quantile(self.level, self.degrees)

    @cached_property
    def of_fit(self) -> tuple[Estimate, ...]:
        """The estimates, their intervals without the linear model's error."""
        return estimates(self.chosen, self.unknowns, self.factor, np.zeros(len(self.chosen.theta)))

    @cached_property
    def estimates(self) -> tuple[Estimate, ...]:
        """One per parameter; intervals from measured positions are wider by the model's error."""
        return estimates(self.chosen, self.unknowns, self.factor, _bias(self))

    @property
    def placed(self) -> dict[str, float]:
        """Zeros and offsets that fit the rows, also those that these do not separate."""
        steps, found = geometry_of(self.model, self.chosen), self.measured.found
        return {name: found.get(name, 0.0) + x for name, (x, _) in steps.items()}

    @property
    def geometry(self) -> list[OffsetEstimate]:
        """Joint zeros, offsets of tool and base, if they are sought."""
        steps, answer = geometry_of(self.model, self.chosen), []
        for name, x in self.placed.items():
            unit, half = unit_of(self.elastic, name), self.factor * (sd := steps[name][1])
            if np.isfinite(sd):
                answer.append(OffsetEstimate(name, unit, x, sd, (x - half, x + half)))
            else:
                answer.append(OffsetEstimate(name, unit, None, None, None))
        return answer

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """Assumptions and findings, doubts about the springs first."""
        notes = [*other_axes(self), *_assumed(self), *_found(self), *_doubts(self), *_limits(self)]
        return tuple(sorted(notes, key=lambda note: not is_doubt(note)))

    @property
    def suspects(self) -> list[int]:
        """Numbers of the rows that the robust fit suspects."""
        return [int(self.measured.rows[n]) for n in self.robust.suspects]

    @cached_property
    def mechanism(self) -> ElasticMechanism:
        """The mechanism with the springs found, and their covariance."""
        return with_result(self)

    def noise(self) -> dict[str, dict[str, Any]]:
        """Scatter of lengths and angles, each in its unit, by "length" and "angle"."""
        seen, solution = self.model.observations, self.chosen
        answer = {}
        for g, name, unit in ((False, "length", self.elastic.units.length), (True, "angle", "rad")):
            mine = seen.is_angle == g
            if not mine.any():
                continue
            left = self.checks.left_out[mine]
            answer[name] = {
                "unit": unit,
                "count": int(mine.sum()),
                "residual_rms": _rms(solution.residual[mine]),
                "sigma": _rms(solution.deviation[mine]),
                "sigma_is_estimated": not seen.is_known[int(g)],
                "leave_one_out_rms": None if np.isnan(left).all() else _rms(left[~np.isnan(left)]),
            }
        return answer

    def weak_directions(self) -> list[dict[str, Any]]:
        """Combinations of springs and offsets that the rows do not determine."""
        solution, count = self.chosen, len(self.unknowns.names)
        names = (*self.unknowns.names, *self.model.offsets.names)
        values, rank = solution.singular_values, self._rank()
        answer = []
        for value, vector in zip(values[rank:], solution.directions.T[rank:], strict=False):
            big = np.flatnonzero(np.abs(vector) > 0.05).tolist()
            springs, offsets = (
                {names[p]: float(vector[p]) for p in big if (p < count) == of_springs}
                for of_springs in (True, False)
            )
            answer.append({"singular_value": float(value), "springs": springs, "offsets": offsets})
        return answer

    def not_separable(self) -> list[list[str]]:
        """Groups of springs and offsets of which the rows determine combinations only."""
        solution = self.chosen
        lost = solution.directions[:, self._rank() : len(solution.singular_values)]
        together = np.abs(lost @ lost.T) > numerics.NEGLIGIBLE_SHARE
        names = (*self.unknowns.names, *self.model.offsets.names)
        groups: dict[int, list[str]] = {}
        from scipy.sparse.csgraph import connected_components

        for name, group in zip(names, connected_components(together)[1].tolist(), strict=True):
            groups.setdefault(group, []).append(name)
        return [group for group in groups.values() if len(group) > 1]

    def _rank(self) -> int:
        return numerics.rank(self.chosen.singular_values)

    def to_dict(self) -> dict[str, Any]:
        """The object printed by ``cartstiff identify --json``."""
        noise = self.noise()
        first = noise.get("length") or noise["angle"]
        robust = dict(zip(self.unknowns.names, self.robust.fit.theta, strict=True))
        plain = dict(zip(self.unknowns.names, self.plain.theta, strict=True))
        parameters = []
        for p, e in enumerate(self.estimates):
            known = self.chosen.is_determined[p]
            parameters.append(
                {
                    "name": e.name,
                    "stiffness": e.stiffness,
                    "unit": e.unknown.unit,
                    "compliance": e.compliance,
                    "sd": e.deviation,
                    "interval": e.stiffness_interval,
                    "compliance_interval": e.interval,
                    "identifiable": e.verdict == "determined",
                    "verdict": e.verdict,
                    "plain": plain[e.name] if known else None,
                    "robust": robust[e.name] if known else None,
                }
            )
        own = {
            "model": "loaded equilibrium" if self.loaded else "linear in the load",
            "used": self.measured.rows,
            "parameters": parameters,
            "noise": noise,
            "singular_values": self.chosen.singular_values,
            "unseen": self.weak_directions(),
            "geometry": [{**vars(g), "identifiable": g.identifiable} for g in self.geometry],
            "checks": {k: v for k, v in vars(self.checks).items() if k != "left_out"},
        }
        return described("identify", own, first, self.elastic.about(), self)

    def plot(self) -> Any:
        """Draw residuals over their standard deviation against load, posture, and time or row.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        measured, seen, chosen = self.measured, self.model.observations, self.chosen
        force = np.linalg.norm(measured.wrench[:, 3:], axis=1) * self.elastic.units.newtons
        weight = measured.mass * 9.81
        moment = np.linalg.norm(measured.wrench[:, :3], axis=1)
        load, name, unit = force + weight, "force", "N"
        if not load.any():
            load, name, unit = moment, "moment", self.elastic.units.moment
        time = measured.time
        has_time = not np.isnan(time).any() and np.ptp(time) > 0.0
        standard = chosen.residual / chosen.deviation
        suspect = np.isin(seen.row, self.robust.suspects)
        figure = new_figure(9.0, 7.2)
        axes = figure.subplots(2, 2)
        over = (
            (load[seen.row], f"{name} [{unit}]"),
            (measured.postures[seen.row] + 1, "posture, in order of appearance"),
            (
                time[seen.row] if has_time else measured.rows[seen.row],
                "time [s]" if has_time else "row",
            ),
        )
        columns = np.array(seen.column)
        for axis, (x, label) in zip(axes.flat[:3], over, strict=True):
            for column in dict.fromkeys(seen.column):
                mine = (columns == column) & ~suspect
                axis.plot(x[mine], standard[mine], ".", label=printable(column))
            if suspect.any():
                axis.plot(x[suspect], standard[suspect], "x", color="tab:red", label="suspect")
            for level in (-2.0, 0.0, 2.0):
                axis.axhline(level, color="0.7", linewidth=0.7, zorder=0)
            axis.set_xlabel(label)
            axis.set_ylabel("residual over standard deviation")
        axes.flat[0].legend(fontsize="small")
        self._draw_stiffness(axes.flat[3])
        return figure

    def _draw_stiffness(self, axis: Any) -> None:
        """Draw compliances with their intervals, relative to those of the mechanism's file."""
        names: list[str] = []
        for e, nominal in zip(self.estimates, self.unknowns.nominal, strict=True):
            if e.compliance is None or e.interval is None or not nominal:
                continue
            low, high = e.interval
            centre = e.compliance / nominal
            wings = [[max(centre - low / nominal, 0.0)], [max(high / nominal - centre, 0.0)]]
            axis.errorbar([centre], [len(names)], xerr=wings, fmt="o", color="tab:blue", capsize=3)
            names.append(printable(e.name))
        axis.set_yticks(range(len(names)), names, fontsize="small")
        axis.invert_yaxis()
        axis.axvline(0.0, color="0.7", linewidth=0.7)
        axis.set_xlabel(f"compliance over the file's, {100 * self.level:g} % interval")


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def written_values(unknowns: Unknowns, found: Sequence[Estimate]) -> Array:
    """Compliances (P,) that a mechanism can have: estimates, or the file's without one.

    For a compliance with an upper end only, and an estimate of zero, the middle of its interval.
    """
    values, least = unknowns.nominal.copy(), unknowns.least
    for p, e in enumerate(found):
        if e.compliance is None or e.verdict == "negative":
            continue
        middle = 0.5 * sum(e.interval) if e.interval is not None else 0.0
        values[p] = e.compliance if e.compliance > least[p] else max(middle, least[p])
    return values


def with_result(
    result: Identification, date: str | None = None, source: str = ""
) -> ElasticMechanism:
    """The mechanism with the springs found, and their covariance."""
    values = written_values(result.unknowns, result.estimates)
    elastic = result.unknowns.mechanism(values)
    known = [
        p
        for p, e in enumerate(result.estimates)
        if e.compliance is not None and e.verdict != "negative"
    ]
    factor = np.ones(len(values))
    patterns = []
    for p in known:
        unknown = result.estimates[p].unknown
        pattern = unknown.pattern
        if unknown.is_scale:  # the file written holds the beam that was found
            factor[p] = values[p]
            pattern = CompliancePattern(
                pattern.name, tuple((a, b, float(w * values[p])) for a, b, w in pattern.entries)
            )
        patterns.append(pattern)
    covariance = (result.covariance / np.multiply.outer(factor, factor))[np.ix_(known, known)]
    lost = [
        n
        for p, u in enumerate(result.unknowns.parameters)
        if p not in known
        for n in u.name.split(" = ")
    ]
    least = {
        e.name: e.stiffness_interval[0]
        for e in result.estimates
        if e.verdict == "at-least" and e.stiffness_interval[0] is not None
    }
    identified = Identified(
        tuple(patterns),
        (values / factor)[known],
        covariance,
        None if np.isinf(result.degrees) else result.degrees,
        result.level,
        len(result.measured),
        date or datetime.date.today().isoformat(),
        source,
        tuple(lost),
        least,
    )
    notes = tuple(n for n in elastic.notes if n.code != "stiffness-assumed" or lost)
    return replace(elastic, identified=identified, notes=notes)


#: Unknown part of the pose of a session's frame.
OFFSETS = ("none", "translation", "rigid")
# Other axes are tried if residuals exceed this share of the numbers; they are named if they reduce
# the residuals by this factor, with less than this probability by chance.
_POOR_SHARE, _REDUCTION, _CHANCE = 0.1, 3.0, 1e-4
# Bound on the rows that are examined of a long table.
_MAX_ROWS = 200
_FRAMES = ("base", "body", "world")


def other_axes(result: Identification) -> list[Note]:
    """A note on the axes along which the rows fit much better, if there are such."""
    model, target = result.model, result.model.observations.target
    few = np.linalg.norm(result.chosen.residual) <= _POOR_SHARE**2 * np.linalg.norm(target)
    if few or needs_equilibrium(result.elastic):
        return []
    measured = result.measured
    if len(measured) > _MAX_ROWS:
        measured = measured.chosen(
            np.unique(np.linspace(0, len(measured) - 1, _MAX_ROWS).astype(int))
        )
    model = Model(result.unknowns, measured)
    declared = _left(model)
    if declared is None or declared[0] < _POOR_SHARE:
        return []
    tried, count = [], 0
    for words, other in _others(model):
        count += 1
        if (misfit := _left(replace(model, measured=other), declared[0])) is not None:
            tried.append((*misfit, words))
    if not tried:
        return []
    share, rms, freedom, words = min(tried)
    ratio = declared[0] / max(share, numerics.TINY)
    if ratio < _REDUCTION or freedom < 1.0:
        return []
    from scipy.special import fdtrc

    if count * fdtrc(freedom, freedom, ratio**2) > _CHANCE:
        return []
    passage = (
        f"the rows fit much better with {words}: residuals of {rms:.3g} instead of "
        f"{declared[1]:.3g} (rms); if so they were measured, the springs above are wrong"
    )
    return [Note("other-axes", passage, {"residual_rms": declared[1], "other_rms": rms})]


def _left(model: Model, most: float = np.inf) -> tuple[float, float, float] | None:
    """Residual over measured size, residual rms of lengths (else of angles), degrees of freedom.

    None if the first linear step leaves more than the share `most`.
    """
    try:
        fit = fitted(model, once=True)
        if not model.is_linear and _share(model.observations, fit)[0] <= most:
            fit = fitted(model)
    except CartstiffError:
        return None
    share, rms = _share(model.observations, fit)
    return None if share > most else (share, rms, fit.freedom)


def _share(seen: Observations, fit: Fit) -> tuple[float, float]:
    """Residuals as a share of the numbers, and residual rms of lengths (else of angles)."""
    scaled, rms = np.zeros(len(seen)), 0.0
    for angles in (True, False):
        mine = seen.is_angle == angles
        if mine.any():
            r = fit.residual[mine]
            rms = _rms(r)
            scaled[mine] = r / max(_rms(seen.target[mine]), numerics.TINY)
    return _rms(scaled), rms


def _others(model: Model) -> Iterator[tuple[str, Measurements]]:
    """The same rows along other axes, and words for these."""
    measured = model.measured
    base = model.unknowns.elements.elastic.mechanism.base_pose[:3, :3]
    frames = [f for f in _FRAMES if f != "world" or not np.allclose(base, np.eye(3))]
    R = model.poses[:, :3, :3]
    turns = {"body": base.T @ R, "world": np.broadcast_to(base.T, R.shape)}
    declared = measured.axes if measured.axes in frames else "base"
    for load, seen in product(frames if measured.wrench.any() else [declared], frames):
        moved = _turned(measured, turns[seen]) if seen != "base" else measured
        if moved is None or (load, seen) == (declared, "base"):
            continue
        words = [f"loads along the {load}'s axes (--axes {load})"] * (load != declared)
        words += [f"displacements along the {seen}'s axes, not the base's"] * (seen != "base")
        yield " and ".join(words), replace(moved, axes=load)
    yield from _exchanged(measured)


def _turned(measured: Measurements, R: Array) -> Measurements | None:
    """Displacements (and the gauge's direction) along other axes, in those of the base."""
    values, is_turned = dict(measured.values), "d" in measured.values
    for names in (DISPLACEMENT, ROTATION):
        there = [name in values for name in names]
        if any(there) and not all(there):
            return None
        if all(there):
            vectors = np.stack([values[name] for name in names], axis=1)
            values |= dict(zip(names, np.einsum("nij,nj->in", R, vectors), strict=True))
            is_turned = True
    direction = np.einsum("nij,nj->ni", R, measured.direction)
    return replace(measured, values=values, direction=direction) if is_turned else None


def _exchanged(measured: Measurements) -> Iterator[tuple[str, Measurements]]:
    """Displacements with their axes exchanged or turned round, each way once."""
    moving = (*DISPLACEMENT, *ROTATION)
    known = set()
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        hand = float(np.linalg.det(np.eye(3)[list(order)] * np.array(signs)[:, None]))
        values = {n: v for n, v in measured.values.items() if n not in moving}
        spreads = {n: measured.deviations[n] for n in values}
        words = []
        for names, turn in ((DISPLACEMENT, 1.0), (ROTATION, hand)):
            for i, sign in enumerate(signs):
                if (name := names[i]) in measured.values:
                    to = names[order[i]]
                    values[to] = sign * turn * measured.values[name]
                    spreads[to] = measured.deviations[name]
                    if to != name or sign * turn < 0:
                        words.append(f"{name} as {'-' if sign * turn < 0 else ''}{to}")
        text = ", ".join(words)
        if text and text not in known:
            known.add(text)
            yield text, replace(measured, values=values, deviations=spreads)


# Share of what was measured, as a root of squares, above which the residuals make springs doubtful.
_POORLY_EXPLAINED = 0.5
# Notes that make the springs themselves doubtful, and the least factor of a scatter that does.
_LARGE_SCATTER = 2.0
_DOUBTS = (
    "other-axes",
    "hardly-explained",
    "scatter-larger",
    "residual-pattern",
    "lack-of-fit",
    "doubtful-springs",
    "negative-compliance",
)
# Degrees of freedom below which the estimated noise is called uncertain.
_FEW_DEGREES = 5.0
# Standard deviations of a gross error, and the bound on the rows that a message lists.
_GROSS = 20.0
# A note lists ten parts; results for programs hold all.
_some = partial(listed, most=10, between="; ")
# Error of a joint's zero [rad] whose effect is reported.
_ZERO_ERROR = 5e-4
# Deflection [rad] under its weight that no joint of an arm has; and the size [m] of a mechanism
# from which on it must not have that under 1 N at the tool.
_COLLAPSE, _TALL = np.radians(5.0), 0.3
# Number of moving joints from which on small angles in all rows are doubtful.
_SWINGING_JOINTS = 3
# Number of rows whose equilibrium is compared: those that move most.
_COMPARED_ROWS = 3


def is_doubt(note: Note) -> bool:
    """Whether a note makes the springs found doubtful: such are the first lines of an answer."""
    factor = note.values.get("factor", _LARGE_SCATTER)
    return note.code in _DOUBTS and isinstance(factor, float) and factor >= _LARGE_SCATTER


def _assumed(result: Identification) -> Iterator[Note]:
    elastic, measured = result.elastic, result.measured
    own = ("stiffness-assumed", "default-posture")
    yield from (n for n in elastic.notes if n.code not in own)
    yield from _angles(result)
    masses = bool(measured.mass.any() or measured.mass0.any())
    if masses and elastic.gravity is None:
        words = "hung masses pull with 9.81 m/s^2 along -z of F: the mechanism names no gravity"
        yield Note("gravity-assumed", words, {"gravity": list(EARTH)})
    yield from _cables(result)
    if not result.loaded:
        words = (
            "displacements are taken as linear in the load, joints at their commanded positions: "
            "--loaded fits the equilibrium itself"
        )
        yield Note("linear-model", words)
    if needs_equilibrium(elastic):
        words = (
            "nonlinear springs stand in a loop or beside lines: what each carries depends on how "
            "far all give, so the equilibrium under load is fitted, as by --loaded"
        )
        yield Note("equilibrium-needed", words)
    absolute = result.model.observations.is_absolute.any()
    in_base = not measured.session or result.offsets == "none"
    if absolute and in_base and "base" not in result.unknowns.geometry:
        words = (
            "positions are taken in the base frame B exactly: errors of geometry and of the "
            "measuring frame go into the springs (column session gives each session an offset of "
            "its own, --unknown base all rows one)"
        )
        yield Note("frame-taken-as-known", words)
    if absolute:
        yield from _zeros(result)
    if (
        absolute
        and measured.session
        and result.offsets == "translation"
        and any(name in measured.values for name in POSITION)
    ):
        yield Note("axes-taken-as-known", "the measuring frames' axes are taken as F's")
    estimated = [w for w, entry in result.noise().items() if entry["sigma_is_estimated"]]
    if estimated:
        kinds = " and of ".join(f"{kind}s" for kind in estimated)
        words = f"no standard deviation was given: that of {kinds} is estimated"
        sizes = {w: result.noise()[w]["sigma"] for w in estimated}
        yield Note("deviation-estimated", words, {"sigma": sizes})


def _zeros(result: Identification) -> Iterator[Note]:
    """Notes on geometry that was found, or on the effect of an error of a joint's zero."""
    unknowns, elastic, chosen = result.unknowns, result.elastic, result.chosen
    if sought := unknowns.geometry:
        words = (
            f"estimated together with the springs: {', '.join(sought)}; loads act where they are "
            "stated. A mechanism file written holds them: of those that the rows do not separate "
            "some that fit the rows"
        )
        yield Note("geometry-estimated", words, {"sought": list(sought)})
    slides = {c.name for c in elastic.mechanism.coordinates if c.is_length}
    zeros = [name for name in zeros_of(elastic) if name.removesuffix(ZERO) not in slides]
    if not zeros or not set(zeros).isdisjoint(sought):
        return
    more = replace(unknowns, geometry=tuple(zeros), sessions="none")
    columns = offsets_of(more, result.model.observations, result.measured).columns
    moved = chosen.moved_by(_ZERO_ERROR * columns)
    worst: tuple[float, str] | None = None
    values = {}
    for p, e in enumerate(result.estimates):
        if e.stiffness is None:
            continue
        change = float(np.abs(moved[p]).max())
        other = 1.0 / (e.stiffness**-1 - change) if change * e.stiffness < 1.0 else np.inf
        values[e.name] = other
        text = f"{e.stiffness:.5g} {e.unknown.unit} of {e.name} into {other:.5g}"
        worst = max(worst or (0.0, ""), (change * e.stiffness, text))
    if worst is not None and worst[0] > 0.0:
        words = (
            f"the joints' zeros are taken as exact: an error of {1e3 * _ZERO_ERROR:g} mrad in one "
            f"of them turns as much as {worst[1]} (--unknown zeros estimates them too)"
        )
        yield Note("zeros-taken-as-known", words, {"error": _ZERO_ERROR, "stiffness": values})


def _cables(result: Identification) -> Iterator[Note]:
    """Note on cables, which the fit takes as bars, and rows in which the load slackens them."""
    elastic = result.elastic
    names: list[str] = []
    if isinstance(elastic.springs, LineSprings) and elastic.springs.unilateral:
        own = zip(elastic.spring_names, elastic.springs.cables, strict=True)
        names += [name for name, only in own if only]
    lines = [p for p in elastic.potentials if isinstance(p, LineSprings)]
    taut_only = [only for p in lines for only in p.cables]
    names += [f"line{i + 1}" for i, only in enumerate(taut_only) if only]
    if not names:
        return
    pushed: dict[str, list[int]] = {}
    forces, _ = result.model.forces_in(written_values(result.unknowns, result.estimates))
    least = -numerics.ROUNDOFF * np.abs(forces).max(initial=0.0)
    for name in names:
        force = forces[:, result.unknowns.elements.index(name)]
        rows = np.unique(result.model.observations.row[force < least])
        if rows.size:
            pushed[name] = [int(result.measured.rows[n]) for n in rows]
    words = f"cables are taken as taut in every row: {', '.join(names)}"
    if pushed:
        shown = "; ".join(
            f"{name} in row(s) {_some([*map(str, rows)])}" for name, rows in pushed.items()
        )
        words += f". Only preload keeps them so against the load: {shown}"
    yield Note("cables-taken-as-taut", words, {"cables": names, "against_load": pushed})


def _found(result: Identification) -> Iterator[Note]:
    lost = [e.name for e in result.estimates if e.verdict == "not-identifiable"]
    lost += [g.name for g in result.geometry if not g.identifiable]
    for group in result.not_separable():
        words = (
            f"the rows do not separate {', '.join(group)}, only combinations of them show: "
            "measure other postures and loads, or leave some of them out of --unknown"
        )
        yield Note("not-separable", words, {"unknowns": group})
    if lost:
        words = f"not identifiable from these rows: {', '.join(lost)}"
        yield Note("not-identifiable", words, {"springs": lost})
    least = {e.name: e.stiffness_interval[0] for e in result.estimates if e.verdict == "at-least"}
    if least:
        shown = ", ".join(f"{name} at least {k:.5g}" for name, k in least.items())
        words = f"no upper end, the rows may come from a rigid spring: {shown}"
        yield Note("at-least", words, {"springs": least})
    wrong = [e.name for e in result.estimates if e.verdict == "negative"]
    if wrong:
        words = (
            f"the compliance of {', '.join(wrong)} comes out negative beyond its interval: the "
            "model or the signs of load and displacement are wrong"
        )
        yield Note("negative-compliance", words, {"springs": wrong})
    active = result.chosen.active
    if active.any():
        names = [result.unknowns.names[p] for p in np.flatnonzero(active)]
        words = (
            f"least squares would make {', '.join(names)} negative: zero is taken, and the others "
            "follow; intervals are those without the bound"
        )
        yield Note("bound-active", words, {"springs": names})
    if result.suspects:
        reasons = [result.robust.reason(n) for n in result.robust.suspects]
        shown = _some(
            [f"row {row} ({why})" for row, why in zip(result.suspects, reasons, strict=True)]
        )
        used = "left out by the robust fit" if result.fit == "robust" else "used all the same"
        values = {"rows": result.suspects, "reasons": reasons}
        yield Note("suspects", f"suspect, and {used}: {shown}", values)
    yield from _unseen(result)
    if result.rejected:
        shown = _some([f"row {r.row} ({r.reason})" for r in result.rejected])
        yield Note(
            "rejected",
            f"left out by --reject: {shown}",
            {"rows": [r.row for r in result.rejected]},
        )


def _unseen(result: Identification) -> Iterator[Note]:
    """Note on rows in which a gross error would not be detected for lack of other rows."""
    robust, seen = result.robust, result.model.observations
    rows: dict[int, float] = {}
    words = []
    for n in range(len(result.measured)):
        mine = np.flatnonzero((seen.row == n) & robust.kept)
        if not mine.size or robust.unseen[mine].max() < _GROSS:
            continue
        worst = mine[np.argmax(robust.unseen[mine])]
        size = float(robust.unseen[worst])
        rows[int(result.measured.rows[n])] = size
        words.append(f"row {result.measured.rows[n]} ({seen.column[worst]}: {size:.0f})")
    if not rows:
        return
    text = (
        "no other rows check these rows, so that the fit follows them and errors of fewer "
        f"standard deviations than listed may stay unseen: {_some(words)}"
    )
    yield Note("rows-unchecked", text, {"rows": list(rows), "errors": list(rows.values())})


def _limits(result: Identification) -> Iterator[Note]:
    """Notes on the validity of the linear model, and on matrices that are no stiffnesses."""
    if not needs_equilibrium(result.elastic):
        yield from _against_equilibrium(result)
    if any(not u.pattern.is_diagonal for u in result.unknowns.parameters):
        values = written_values(result.unknowns, result.estimates)
        lowest = numerics.eigenvalues(result.unknowns.compliance(values))[0]
        if lowest <= 0.0:
            words = (
                "the compliance found for a link has a negative eigenvalue: the noise is larger "
                "than its smallest entries; --unknown LINK:diagonal asks for less"
            )
            yield Note("not-definite", words, {"lowest": float(lowest)})


def _bent(result: Identification, rows: NDArray[np.intp]) -> tuple[Array, Array] | None:
    """Numbers of some rows by the equilibrium under load, and by small displacements."""
    values = written_values(result.unknowns, result.of_fit)
    some = result.unknowns, result.measured.chosen(rows)
    try:
        return LoadedModel(*some).at(values)[0], Model(*some).at(values)[0]
    except CartstiffError:
        return None


def _against_equilibrium(result: Identification) -> Iterator[Note]:
    """Compare equilibrium under load and small displacement in the rows that move most."""
    seen, values = result.model.observations, written_values(result.unknowns, result.of_fit)
    try:
        y, _ = result.model.at(values)
    except CartstiffError:
        return
    size = np.abs(y) / result.chosen.deviation
    worst = np.array(list(dict.fromkeys(seen.row[np.argsort(-size)].tolist()))[:_COMPARED_ROWS])
    worst.sort()
    if (pair := _bent(result, worst)) is None:
        return
    mine, (bent, straight) = np.flatnonzero(np.isin(seen.row, worst)), pair
    apart = np.abs(bent - straight) / result.chosen.deviation[mine]
    i = int(np.argmax(apart))
    if not (apart[i] > 1.0 or result.loaded):
        return
    row = int(result.measured.rows[seen.row[mine[i]]])
    advice = (
        "the fit without --loaded would do"
        if not apart[i] > 1.0
        else ("--loaded is needed" if result.loaded else "fit it with --loaded")
    )
    if _is_widened(result):
        advice += "; intervals are wider by what that may change"
    words = (
        f"in row {row} the equilibrium under load differs from the linear displacement by "
        f"{apart[i]:.3g} standard deviations: {advice}"
    )
    numbers = {"row": row, "linear": float(straight[i]), "loaded": float(bent[i])}
    yield Note("linear-differs", words, numbers)


def _is_widened(result: Identification) -> bool:
    """Whether intervals count the linear model's error: of positions, in tables of some rows."""
    absolute = bool(result.model.observations.is_absolute.any())
    return not result.loaded and absolute and len(result.measured) <= _MAX_ROWS


def _bias(result: Identification) -> Array:
    """Change of linear estimates (P,) by the equilibrium under load, if that differs."""
    nothing = np.zeros(len(result.of_fit))
    if not _is_widened(result) or not any(_against_equilibrium(result)):
        return nothing
    if (pair := _bent(result, np.arange(len(result.measured)))) is None:
        return nothing
    return np.abs(result.chosen.moved_by((pair[0] - pair[1])[:, None])[:, 0])


def _angles(result: Identification) -> Iterator[Note]:
    """Note on an arm whose joints stay near zero: radians that may have been read as degrees.

    Degrees that are read as radians are refused by the reader, as they exceed a turn.
    """
    mechanism, q = result.elastic.mechanism, result.measured.q
    rotary = [not c.is_length for c in mechanism.coordinates]
    largest = float(np.abs(q[:, rotary]).max(initial=0.0))
    moving = int(np.count_nonzero(np.ptp(q[:, rotary], axis=0)))
    if mechanism.kind != "serial" or moving < _SWINGING_JOINTS or largest > np.radians(np.pi):
        return
    words = (
        f"no joint is farther than {np.degrees(largest):.3g} degrees from zero in any row: "
        'if these columns are radians, say so in their heads, "NAME [rad]"'
    )
    yield Note("small-angles", words, {"largest": largest})


def _doubts(result: Identification) -> Iterator[Note]:
    checks = result.checks
    yield from _collapsed(result)
    if checks.unexplained > _POORLY_EXPLAINED and not (checks.probability or 0.0) >= _SIGNIFICANT:
        sizes = ", ".join(
            f"{entry['residual_rms']:.3g} {entry['unit']}" for entry in result.noise().values()
        )
        words = (
            f"the springs explain {100.0 * (1.0 - checks.unexplained**2):.2g} % of what was "
            f"measured beyond the rigid mechanism (squares), and leave {sizes} (rms): it is mostly "
            "something else than springs, and the intervals hold only if that is mere noise"
        )
        yield Note("hardly-explained", words, {"unexplained": checks.unexplained})
    if result.inflation > 1.0:
        words = (
            f"the scatter is {result.inflation:.3g} times what the deviations given explain "
            f"(probability {checks.probability:.2g}): all intervals are wider by that"
        )
        yield Note("scatter-larger", words, {"factor": result.inflation})
    if checks.lack_of_fit is not None and checks.lack_of_fit < 0.01:
        words = (
            "repeats agree with each other better than with the model (probability "
            f"{checks.lack_of_fit:.2g}): something that it does not know bends the rows"
        )
        yield Note("lack-of-fit", words, {"probability": checks.lack_of_fit})
    yield from _of_patterns(result)
    if result.degrees < _FEW_DEGREES:
        words = (
            f"the noise is estimated from {result.degrees:.3g} degrees of freedom: "
            "intervals are wide for that alone, more rows or known deviations help most"
        )
        yield Note("few-rows", words, {"degrees": result.degrees})
    differing = []
    for e, theta in zip(result.estimates, result.robust.fit.theta, strict=True):
        if e.interval is not None and not e.interval[0] <= theta <= e.interval[1]:
            differing.append(e.name)
    if differing and result.fit == "plain":
        words = f"the robust fit lies outside the intervals of {', '.join(differing)}"
        yield Note("robust-differs", words, {"springs": differing})


def _of_patterns(result: Identification) -> Iterator[Note]:
    """Notes on terms that the residuals look like; errors of geometry together in one."""
    meaning = {
        "backlash": "a play or friction of {}",
        "stiffening": "a compliance that changes with its torque ({})",
        "drift": "a drift of {} per second",
    }
    elements, units = result.unknowns.elements, result.elastic.units
    wrong = [p for p in result.checks.patterns if p.kind == "geometry"]
    if wrong:
        shown = _some([f"{p.name} {p.size:.3g} {unit_of(result.elastic, p.name)}" for p in wrong])
        groups = ["zeros" if p.name.endswith(ZERO) else p.name.split(".")[0] for p in wrong]
        sought = ",".join(dict.fromkeys(("joints", *groups)))
        text = (
            f"the residuals look like errors of {shown} (probability of the first "
            f"{wrong[0].probability:.2g} without; --unknown {sought} estimates them)"
        )
        sizes = {p.name: p.size for p in wrong}
        yield Note("residual-pattern", text, {"kind": "geometry", "sizes": sizes})
    for p in result.checks.patterns:
        if p.kind == "geometry":
            continue
        if p.kind == "drift":
            unit = units.angle if p.name in (*ROTATION, *TURN) else units.length
        else:
            is_length = bool(elements.is_length[elements.index(p.name)])
            unit = units.coordinate(is_length)
            if p.kind == "stiffening":
                unit += f"/({units.effort(is_length)})^2"
        what = meaning[p.kind].format(f"{p.size:.3g} {unit}")
        words = (
            f"in {p.name} the residuals look like {what} (probability {p.probability:.2g} without)"
        )
        yield Note("residual-pattern", words, vars(p))


def _collapsed(result: Identification) -> Iterator[Note]:
    """Note on springs too soft for the mechanism's own weight, or for 1 N at the tool."""
    elastic, elements = result.elastic, result.unknowns.elements
    newton = 1.0 / elastic.units.newtons
    mechanism, length = elastic.mechanism, elastic.mechanism.at(elastic.q).length
    tall = length * convert_length(elastic.units, SI)[0] > _TALL
    weight = np.zeros(len(elastic.names))
    if any(mechanism.masses().values()):
        places = np.unique(result.measured.postures, return_index=True)[1][:_MAX_ROWS]
        field = field_of(elastic)
        for q in result.measured.q[places]:
            weight = np.maximum(weight, np.abs(mechanism.at(q).gravity(field).gradient))
    doubted, words = {}, []
    for e in result.estimates:
        for name in e.name.split(" = "):
            if e.stiffness is None or name not in elements.names:
                continue
            slides = bool(elements.is_length[elements.index(name)])
            own = weight[elastic.names.index(name)] if name in elastic.names else 0.0
            size = length if slides else 1.0
            limit = 0.1 * length if slides else _COLLAPSE
            loads = [("the weight of the mechanism", own)]
            loads += [("1 N at the tool", newton * (1.0 if slides else length))] * tall
            for load, force in loads:
                deflection = force / e.stiffness
                if deflection > limit:
                    shown = (
                        f"{deflection / size:.3g} of its size"
                        if slides
                        else (f"{np.degrees(deflection):.3g} deg")
                    )
                    words.append(
                        f"{name}: {e.stiffness:.3g} {e.unknown.unit}, {load} moves it by {shown}"
                    )
                    doubted[name] = float(e.stiffness)
                    break
    if words:
        text = (
            f"hardly the springs of a mechanism: {_some(words)}. Other units of loads or lengths?"
        )
        yield Note("doubtful-springs", text, doubted)


FITS = ("plain", "robust")
# Compliances below this share of the mechanism's own, or above its inverse, are no start of a
# search.
_SMALLEST_START = 1e-2
# Shares of the compliances at which a search starts if they are too soft for the loads.
_STIFFER = (0.5, 0.25, 0.1)
# Residuals of positions, in the mechanism's sizes, that no error of geometry explains.
_FOREIGN_SHARE = 0.05
# Bound on the corrections of rows by the zeros and offsets found.
_MAX_CORRECTIONS = 20


def identify(
    elastic: ElasticMechanism,
    measured: Measurements | Any,
    *,
    sought: Sequence[str] = (),
    ties: Sequence[Sequence[str]] = (),
    known: Mapping[str, float] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    offsets: Literal["none", "translation", "rigid"] | None = None,
    loaded: bool = False,
    fit: Literal["plain", "robust"] = "plain",
    reject: float | Literal["suspects"] | None = None,
    level: float = 0.95,
    progress: Callable[[int, float], None] | None = None,
) -> Identification:
    r"""Springs of a mechanism from measured loads and deflections, with honest intervals.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its geometry is taken as known; its springs are the start of the search.
    measured : Measurements, Path, str, mapping of str to array_like, or data frame
        From `read_measurements`; or what that reads with its defaults.
    sought, ties, known, priors
        Parameters to be found, see `cartstiff.identify.unknowns.unknowns_of`.
    offsets : {"rigid", "translation", "none"}, optional
        Unknown part of the pose of the measuring frame in each session, for measured positions;
        default "rigid" if the table has sessions. Without sessions, positions are in the robot's
        own base frame B.
    loaded : bool
        Fit the equilibrium under the load itself, not displacements linear in it.
    fit : {"plain", "robust"}
        Fit whose stiffnesses are the result: least squares, or the robust fit, which is computed
        anyway.
    reject : float or "suspects", optional
        Rows left out: suspects of the robust fit, or all that are farther from it than this number
        of standard deviations.
    level : float
        Probability of the intervals.
    progress : callable, optional
        Called with the number of a step and the norm of the residuals over their deviations.

    Returns
    -------
    Identification
        Estimates with intervals, covariance, suspects, checks of the model, notes.

    Raises
    ------
    InputError
        For fewer numbers than unknowns, contradictory rows, and invalid options.
    ConvergenceError
        If the fit does not settle.
    """
    if not isinstance(measured, Measurements):
        measured = read_measurements(measured, elastic)
    _check(offsets, measured, fit, reject, level)
    unknowns = unknowns_of(elastic, sought, ties=ties, known=known, priors=priors)
    unknowns = replace(unknowns, sessions=offsets or "rigid")
    if both := set(measured.session).intersection(unknowns.geometry):
        raise InputError(
            "has the name of an offset that is sought", where="column session", got=min(both)
        )
    contradictions(measured)
    rows = measured.rows
    measured = in_base(unknowns, measured, Model(unknowns, measured).poses)
    rejected: tuple[Rejected, ...] = ()
    while True:
        model, plain, robust = _fits(unknowns, measured, loaded, progress)
        measured = model.measured
        if reject is None or rejected:
            break
        drop = robust.suspects if reject == "suspects" else robust.beyond(float(reject))
        if not len(drop):
            break
        rejected = tuple(Rejected(int(measured.rows[n]), robust.reason(n)) for n in drop)
        measured = measured.chosen(np.isin(np.arange(len(measured)), drop, invert=True))
    result = Identification(model, len(rows), rejected, plain, robust, level, fit)
    _check_frame(model, result.chosen, elastic)
    result.notes  # noqa: B018 - what is wrong with the rows is an error here
    return result


def _check_frame(model: Model, fit: Fit, elastic: ElasticMechanism) -> None:
    """Refuse positions that are far from those of the mechanism at its joint positions.

    Raises
    ------
    InputError
        If their residuals exceed a share of the mechanism's size, as in another frame.
    """
    seen, length = model.observations, elastic.mechanism.at(elastic.q).length
    rms = _rms(fit.residual[seen.is_absolute & ~seen.is_angle])
    if rms > _FOREIGN_SHARE * length:
        raise InputError(
            "measured positions are not those of the mechanism: of another frame, point or posture",
            expected="x, y, z of --point in the base frame; --unknown base finds another frame, "
            "column session one for each session",
            got=f"residuals of {rms:.3g} {elastic.units.length} (rms)",
        )


def _check(
    offsets: str | None,
    measured: Measurements,
    fit: str,
    reject: float | str | None,
    level: float,
) -> None:
    check_name("kind of offset", offsets or "none", OFFSETS, "--offsets")
    has_positions = any(name in measured.values for name in (*POSITION, *TURN))
    if offsets in ("rigid", "translation") and not (measured.session and has_positions):
        raise InputError(
            "nothing measured has an offset",
            where="--offsets",
            expected="a column session" if has_positions else "measured positions x, y, z",
            got=offsets,
        )
    check_name("fit", fit, FITS, "--fit")
    if not 0.0 < level < 1.0:
        raise InputError(
            "level cannot be used", where="--level", expected="between 0 and 1", got=level
        )
    is_limit = isinstance(reject, float | int) and reject >= 1.0
    if reject not in (None, "suspects") and not is_limit:
        raise InputError(
            "unknown rule",
            where="--reject",
            got=repr(reject),
            expected="suspects, or a number of standard deviations, at least 1",
        )


def _fits(
    unknowns: Unknowns,
    measured: Measurements,
    loaded: bool,
    progress: Callable[[int, float], None] | None,
) -> tuple[Model, Fit, Robust]:
    """The plain and the robust fit of the rows, corrected by the offsets that are found."""
    elastic = unknowns.elements.elastic
    for _ in range(_MAX_CORRECTIONS):
        model = model_of(unknowns, measured, loaded)
        _check_count(model)
        start = _at_rest(model, _near(model)) if isinstance(model, LoadedModel) else None
        plain = fitted(model, start=start, progress=progress)
        step = corrections(elastic, geometry_of(model, plain))
        turned = sessions_turned_back(
            unknowns,
            model.observations,
            measured,
            dict(zip(model.offsets.names, plain.offsets.tolist(), strict=True)),
            plain.deviation,
        )
        if not step and turned is None:
            return model, plain, robust_fit(model, plain)
        if not step:
            _check_frame(model, plain, elastic)  # rows of another frame would never settle
        measured = corrected(elastic, turned or measured, step)
    raise ConvergenceError(
        "zeros and offsets do not settle: they are too large, or the rows hardly separate them",
        iterations=_MAX_CORRECTIONS,
        residual=max(map(abs, step.values()), default=0.0),
    )


def _at_rest(model: LoadedModel, near: Array) -> Array:
    """Parameters with an equilibrium in every row: `near`, the file's own, or stiffer ones."""
    own, is_bounded = model.unknowns.nominal, model.unknowns.is_bounded
    stiffer = [np.where(is_bounded, share * own, own) for share in _STIFFER]
    for start in (near, own, *stiffer):
        try:
            model.at(start)
        except CartstiffError:
            continue
        return start
    return own  # the fit names the row without an equilibrium


def _near(model: LoadedModel) -> Array:
    """Parameters of the fit with small loads, if that is cheap, else the file's own."""
    unknowns = model.unknowns
    nominal = unknowns.nominal
    if needs_equilibrium(unknowns.elements.elastic):
        return nominal
    try:
        first = fitted(Model(unknowns, model.measured))
    except CartstiffError:  # no stiffness, or a law that does not reach so far
        return nominal
    share = first.theta / nominal
    sound = ~unknowns.is_bounded | ((share > _SMALLEST_START) & (share < 1.0 / _SMALLEST_START))
    return np.where(first.is_determined & sound, first.theta, nominal)


def _check_count(model: Model) -> None:
    parameters, offsets = len(model.unknowns.parameters), len(model.offsets.names)
    if len(model.observations) + len(model.unknowns.priors[1]) < parameters + offsets:
        raise InputError(
            "fewer numbers than unknowns",
            got=f"{len(model.observations)} measured",
            expected=f"at least {parameters + offsets} ({parameters} compliances"
            + (f", {offsets} offsets)" if offsets else ")"),
        )
