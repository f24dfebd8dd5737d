"""From measurements to springs: sessions, fits, checks, estimates with intervals, notes.

An interval ``c -+ t s`` of a compliance is truncated at zero; its ends are 1/k. If it
reaches zero the stiffness has no upper end: it is "at least" the lower one.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.described import described
from cartstiff.core.errors import (
    CartstiffError,
    ConvergenceError,
    InputError,
    check_name,
    listed,
    printable,
)
from cartstiff.core.figures import new_figure
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.identified import Identified, quantile
from cartstiff.core.notes import Note
from cartstiff.core.results import LabelledResult
from cartstiff.wings.identify.fitting import (
    Fit,
    Robust,
    fitted,
    geometry_of,
    robust_fit,
)
from cartstiff.wings.identify.measurements import (
    EARTH,
    POSITION,
    TURN,
    Measurements,
    read_measurements,
)
from cartstiff.wings.identify.models import (
    LoadedModel,
    Model,
    model_of,
    needs_equilibrium,
)
from cartstiff.wings.identify.unknowns import (
    LEVEL,
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

#: Probability under the model below which a test is significant.
_SIGNIFICANT = 0.01
# Difference of contradictory repeats, in standard deviations, and as a share of the
# largest number.
_CONTRADICTION, _LARGEST_SHARE = 100.0, 1.5
# Least number of other repeats from which a standard deviation is estimated if none is
# given.
_MIN_REPEATS = 3


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
    unexplained : float
        Root of the weighted sum of squares over that without the springs: 0 if these
        explain all that was measured beyond the rigid mechanism and its offsets, 1 if
        nothing.
    """

    chi_squared: float | None
    freedom: float
    probability: float | None
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
        repeats = [
            known[settings == g] for g in np.flatnonzero(np.bincount(settings) > 1)
        ]
        # The spread of rows that repeat a setting, against what was stated.
        squares = np.array([np.sum((values[g] - values[g].mean()) ** 2) for g in repeats])
        freedoms = np.array([len(g) - 1 for g in repeats])
        for n, mine in enumerate(repeats):
            low, high = mine[np.argmin(values[mine])], mine[np.argmax(values[mine])]
            difference, spread = values[high] - values[low], np.hypot(sd[low], sd[high])
            limit = (
                _LARGEST_SHARE * largest if np.isnan(spread) else _CONTRADICTION * spread
            )
            others, rest = freedoms.sum() - freedoms[n], squares.sum() - squares[n]
            if np.isnan(spread) and others >= _MIN_REPEATS and rest > 0.0:
                limit = min(limit, _CONTRADICTION * float(np.sqrt(2.0 * rest / others)))
            if difference > limit > 0.0:
                a, b = sorted((int(measured.rows[low]), int(measured.rows[high])))
                raise InputError(
                    f"rows {a} and {b} contradict each other in {name!r}: the same "
                    "posture and "
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
        numerics.norm(r[kept]) / max(numerics.norm(rigid), numerics.TINY),
    )


Verdict = Literal["determined", "at-least", "not-identifiable", "negative"]


@dataclass(frozen=True)
class Estimate:
    """Estimate of one parameter.

    Attributes
    ----------
    unknown : Unknown
        The parameter.
    verdict : {"determined", "at-least", "not-identifiable", "negative"}
        A finite interval of the stiffness; one without an upper end; none; a compliance
        whose whole interval is below zero, which contradicts the model.
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


def estimates(
    fit: Fit, unknowns: Unknowns, t: float, wider: Array
) -> tuple[Estimate, ...]:
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


@dataclass(frozen=True, eq=False, repr=False)
class Identification(LabelledResult):
    """Springs found from measurements.

    Attributes
    ----------
    model : Model
        Unknowns, rows used, predictions and their derivatives.
    plain : Fit
        Least squares.
    robust : Robust
        The robust fit.
    asked : {"plain", "robust"} or None
        The fit of the estimates, if it is not to be the recommended one.
    """

    command: ClassVar = "identify"

    #: Probability of the intervals.
    level: ClassVar[float] = LEVEL

    model: Model
    plain: Fit
    robust: Robust
    asked: Literal["plain", "robust"] | None = None

    @property
    def unknowns(self) -> Unknowns:
        """The parameters."""
        return self.model.unknowns

    @property
    def measured(self) -> Measurements:
        """The rows, corrected by the zeros and offsets found."""
        return self.model.measured

    @property
    def elastic(self) -> ElasticMechanism:
        """The measured mechanism."""
        return self.unknowns.elastic

    @property
    def offsets(self) -> str:
        """Unknown part of the pose of each session's frame."""
        return self.unknowns.sessions

    @property
    def loaded(self) -> bool:
        """Whether the equilibrium under load was fitted."""
        return isinstance(self.model, LoadedModel)

    @property
    def recommended(self) -> Literal["plain", "robust"]:
        """The robust fit if there are suspect rows, or it leaves an interval of
        the plain one.
        """
        return "robust" if self.suspects or self.robust_outside else "plain"

    @cached_property
    def robust_outside(self) -> list[str]:
        """Parameters of the robust fit outside the intervals of the plain one."""
        plain, robust = (replace(self, asked=fit) for fit in FITS)
        half = plain.factor * np.sqrt(np.diag(plain.covariance))
        apart = np.abs(robust.chosen.unbounded - plain.chosen.unbounded)
        return [
            n for n, far in zip(self.unknowns.names, apart > half, strict=True) if far
        ]

    @property
    def fit(self) -> Literal["plain", "robust"]:
        """The fit of the estimates."""
        return self.asked or self.recommended

    @cached_property
    def chosen(self) -> Fit:
        """The fit of the estimates, whose covariance counts the inflation."""
        fit, factor = (
            self.robust.fit if self.fit == "robust" else self.plain,
            self.inflation**2,
        )
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
        return checked(
            self.model, self.plain, np.ones(len(self.model.observations), bool)
        )

    @cached_property
    def left_out(self) -> Array:
        """Leave-one-posture-out residuals (m,), in the units of the measured numbers; NaN
        for indispensable postures.
        """
        fit = self.chosen
        per = fit.root / fit.deviation
        r = fit.residual * per
        group = self.measured.postures[self.model.observations.row]
        answer = np.full(len(r), np.nan)
        order = np.argsort(group, kind="stable")
        for mine in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
            U = fit.basis[mine]
            left = np.eye(len(mine)) - U @ U.T
            if np.linalg.eigvalsh(left)[0] > numerics.ROUNDOFF**0.5:
                answer[mine] = np.linalg.solve(left, r[mine])
        return answer / per

    @property
    def inflation(self) -> float:
        """Factor on all standard deviations if the scatter is larger than those given;
        else 1.
        """
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
        """Number of degrees of freedom of the intervals."""
        fit = self.chosen
        return fit.degrees if self.inflation == 1.0 else min(fit.degrees, fit.freedom)

    @property
    def factor(self) -> float:
        """Half width of an interval over the standard deviation, a factor."""
        return quantile(self.level, self.degrees)

    @cached_property
    def of_fit(self) -> tuple[Estimate, ...]:
        """The estimates, their intervals without the linear model's error."""
        return estimates(
            self.chosen, self.unknowns, self.factor, np.zeros(len(self.chosen.theta))
        )

    @cached_property
    def estimates(self) -> tuple[Estimate, ...]:
        """One per parameter; intervals from measured positions are wider by the
        model's error.
        """
        return estimates(self.chosen, self.unknowns, self.factor, _bias(self))

    @property
    def placed(self) -> dict[str, float]:
        """Zeros and offsets that fit the rows, in the mechanism's units, also those that
        these do not separate.
        """
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
        notes = [*_assumed(self), *_found(self), *_doubts(self)]
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
        for g, name, unit in (
            (False, "length", self.elastic.units.length),
            (True, "angle", "rad"),
        ):
            mine = seen.is_angle == g
            if not mine.any():
                continue
            left = self.left_out[mine]
            left = left[~np.isnan(left)]
            answer[name] = {
                "unit": unit,
                "count": int(mine.sum()),
                "residual_rms": _rms(solution.residual[mine]),
                "sigma": _rms(solution.deviation[mine]),
                "sigma_is_estimated": not seen.is_known[int(g)],
                "leave_one_out_rms": _rms(left) if left.size else None,
            }
        return answer

    def weak_directions(self) -> list[dict[str, Any]]:
        """Combinations of springs and offsets that the rows do not determine."""
        solution, count = self.chosen, len(self.unknowns.names)
        names = (*self.unknowns.names, *self.model.offsets.names)
        values, rank = solution.singular_values, self._rank()
        answer = []
        for value, vector in zip(
            values[rank:], solution.directions.T[rank:], strict=False
        ):
            big = np.flatnonzero(np.abs(vector) > 0.05).tolist()
            springs, offsets = (
                {names[p]: float(vector[p]) for p in big if (p < count) == of_springs}
                for of_springs in (True, False)
            )
            answer.append(
                {"singular_value": float(value), "springs": springs, "offsets": offsets}
            )
        return answer

    def not_separable(self) -> list[list[str]]:
        """Groups of springs and offsets of which the rows determine combinations only."""
        solution = self.chosen
        lost = solution.directions[:, self._rank() : len(solution.singular_values)]
        together = np.abs(lost @ lost.T) > numerics.NEGLIGIBLE_SHARE
        names = (*self.unknowns.names, *self.model.offsets.names)
        groups: dict[int, list[str]] = {}
        from scipy.sparse.csgraph import connected_components

        for name, group in zip(
            names, connected_components(together)[1].tolist(), strict=True
        ):
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
            "rows": len(self.measured),
            "parameters": parameters,
            "noise": noise,
            "singular_values": self.chosen.singular_values,
            "unseen": self.weak_directions(),
            "geometry": [
                {**vars(g), "identifiable": g.identifiable} for g in self.geometry
            ],
            "checks": vars(self.checks),
        }
        return described("identify", own, first, self.elastic.about(), self)

    def plot(self, ax: Any = None) -> Any:
        """Draw residuals over their standard deviation against load, posture,
        and time or row.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        measured, seen, chosen = self.measured, self.model.observations, self.chosen
        force = (
            np.linalg.norm(measured.wrench[:, 3:], axis=1) * self.elastic.units.newtons
        )
        weight = measured.mass * 9.81
        moment = np.linalg.norm(measured.wrench[:, :3], axis=1)
        # Residuals against the load, the posture and the time.
        load, name, unit = force + weight, "force", "N"
        if not load.any():
            load, name, unit = moment, "moment", self.elastic.units.moment
        time = measured.time
        has_time = not np.isnan(time).any() and np.ptp(time) > 0.0
        standard = chosen.residual / chosen.deviation
        suspect = np.isin(seen.row, self.robust.suspects)
        figure = new_figure(9.0, 7.2, ax=ax)
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
                axis.plot(
                    x[suspect], standard[suspect], "x", color="tab:red", label="suspect"
                )
            for level in (-2.0, 0.0, 2.0):
                axis.axhline(level, color="0.7", linewidth=0.7, zorder=0)
            axis.set_xlabel(label)
            axis.set_ylabel("residual over standard deviation")
        axes.flat[0].legend(fontsize="small")
        self._draw_stiffness(axes.flat[3])
        return figure

    def _draw_stiffness(self, axis: Any) -> None:
        """Draw compliances with their intervals, relative to those of the
        mechanism's file.
        """
        names: list[str] = []
        for e, nominal in zip(self.estimates, self.unknowns.nominal, strict=True):
            if e.compliance is None or e.interval is None or not nominal:
                continue
            low, high = e.interval
            centre = e.compliance / nominal
            wings = [
                [max(centre - low / nominal, 0.0)],
                [max(high / nominal - centre, 0.0)],
            ]
            axis.errorbar(
                [centre], [len(names)], xerr=wings, fmt="o", color="tab:blue", capsize=3
            )
            names.append(printable(e.name))
        axis.set_yticks(range(len(names)), names, fontsize="small")
        axis.invert_yaxis()
        axis.axvline(0.0, color="0.7", linewidth=0.7)
        axis.set_xlabel(f"compliance over the file's, {100 * self.level:g} % interval")


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def written_values(unknowns: Unknowns, found: Sequence[Estimate]) -> Array:
    """Compliances (P,) that a mechanism can have: estimates, or the file's without one.

    For a compliance with an upper end only, and an estimate of zero, the middle of its
    interval.
    """
    values, least = unknowns.nominal.copy(), unknowns.least
    for p, e in enumerate(found):
        if e.compliance is None or e.verdict == "negative":
            continue
        middle = 0.5 * sum(e.interval) if e.interval is not None else 0.0
        values[p] = e.compliance if e.compliance > least[p] else max(middle, least[p])
    return values


def with_result(result: Identification, source: str = "") -> ElasticMechanism:
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
        if unknown.is_scale:  # the file written holds the beam that was found
            factor[p] = values[p]
        patterns.append(unknown.pattern)
    covariance = (result.covariance / np.multiply.outer(factor, factor))[
        np.ix_(known, known)
    ]
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
        datetime.date.today().isoformat(),
        source,
        tuple(lost),
        least,
    )
    notes = tuple(n for n in elastic.notes if n.code != "stiffness-assumed" or lost)
    return replace(elastic, identified=identified, notes=notes)


#: Unknown part of the pose of a session's frame.
OFFSETS = ("none", "translation", "rigid")
# Bound on the rows of a table in which positions are compared with equilibria.
_MAX_ROWS = 200
# Share of what was measured, as a root of squares, above which the residuals make springs
# doubtful.
_POORLY_EXPLAINED = 0.5
# The notes of doubt: gross errors, what springs do not explain, loads too large for the
# model.
_DOUBTS = ("suspects", "hardly-explained", "linear-differs")
# A note lists ten parts; results for programs hold all.
_some = partial(listed, most=10, between="; ")
# Error of a joint's zero [rad] whose effect is reported.
_ZERO_ERROR = 5e-4
# Number of rows whose equilibrium is compared: those that move most.
_COMPARED_ROWS = 3


def is_doubt(note: Note) -> bool:
    """Whether a note makes the springs found doubtful: such are the first lines
    of an answer.
    """
    return note.code in _DOUBTS


def _assumed(result: Identification) -> Iterator[Note]:
    elastic, measured = result.elastic, result.measured
    own = ("stiffness-assumed", "default-posture")
    yield from (n for n in elastic.notes if n.code not in own)
    # Weight and cables.
    masses = bool(measured.mass.any() or measured.mass0.any())
    if masses and elastic.gravity is None:
        words = (
            "hung masses pull with 9.81 m/s^2 along -z of F: the mechanism names no "
            "gravity"
        )
        yield Note("gravity-assumed", words, {"gravity": list(EARTH)})
    yield from _cables(result)
    # The model of the deflection.
    if not result.loaded:
        words = (
            "displacements are taken as linear in the load, joints at their commanded "
            "positions: "
            "--loaded fits the equilibrium itself"
        )
        names = result.unknowns.names
        tensioned = [names[p] for p in result.model.by_differences]
        if tensioned:
            words += (
                f"; derivatives by {', '.join(tensioned)} are central differences, as "
                "forces in the closures follow the tension of such a line"
            )
        yield Note("linear-model", words, {"by_differences": tensioned})
    if needs_equilibrium(elastic):
        words = (
            "nonlinear springs stand in a loop or beside lines: what each carries "
            "depends on how "
            "far all give, so the equilibrium under load is fitted, as by --loaded"
        )
        yield Note("equilibrium-needed", words)
    # Frames in which positions were measured.
    absolute = result.model.observations.is_absolute.any()
    in_base = not measured.session or result.offsets == "none"
    if absolute and in_base and "base" not in result.unknowns.geometry:
        words = (
            "positions are taken in the base frame B exactly: errors of geometry and of "
            "the "
            "measuring frame go into the springs (column session gives each session an "
            "offset of "
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
    """Notes on geometry that was found, or on the effect of an error of a
    joint's zero.
    """
    unknowns, elastic, chosen = result.unknowns, result.elastic, result.chosen
    if sought := unknowns.geometry:
        words = (
            f"estimated together with the springs: {', '.join(sought)}; loads act where "
            "they are "
            "stated. A mechanism file written holds them: of those that the rows do not "
            "separate "
            "some that fit the rows"
        )
        yield Note("geometry-estimated", words, {"sought": list(sought)})
    # How far an error of the zeros of joints moves each stiffness.
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
            f"the joints' zeros are taken as exact: an error of {1e3 * _ZERO_ERROR:g} "
            "mrad in one "
            f"of them turns as much as {worst[1]} (--unknown zeros estimates them too)"
        )
        yield Note(
            "zeros-taken-as-known", words, {"error": _ZERO_ERROR, "stiffness": values}
        )


def _cables(result: Identification) -> Iterator[Note]:
    """Note on cables, which the fit takes as bars, and rows in which the load
    slackens them.
    """
    elastic = result.elastic
    names: list[str] = []
    if elastic.springs is not None and elastic.springs.unilateral:
        own = zip(elastic.spring_names, elastic.springs.cables, strict=True)
        names += [name for name, only in own if only]
    for term, own_names in elastic.labelled():
        if (lines := term.drawn(elastic.mechanism.at(elastic.q))) is not None:
            both = zip(own_names, lines.are_cables, strict=True)
            names += [name for name, only in both if only]
    if not names:
        return
    # Rows in which the load pushes a cable.
    pushed: dict[str, list[int]] = {}
    values = written_values(result.unknowns, result.estimates)
    forces = result.model.forces_in_lines(values)
    least = -numerics.ROUNDOFF * max(float(np.abs(x).max()) for x in forces.values())
    for name in names:
        rows = np.unique(result.model.observations.row[forces[name] < least])
        if rows.size:
            pushed[name] = [int(result.measured.rows[n]) for n in rows]
    words = f"cables are taken as taut in every row: {', '.join(names)}"
    if pushed:
        shown = "; ".join(
            f"{name} in row(s) {_some([*map(str, rows)])}"
            for name, rows in pushed.items()
        )
        words += f". Only preload keeps them so against the load: {shown}"
    yield Note("cables-taken-as-taut", words, {"cables": names, "against_load": pushed})


def _found(result: Identification) -> Iterator[Note]:
    lost = [e.name for e in result.estimates if e.verdict == "not-identifiable"]
    lost += [g.name for g in result.geometry if not g.identifiable]
    for group in result.not_separable():
        words = (
            f"the rows do not separate {', '.join(group)}, only combinations of them "
            "show: "
            "measure other postures and loads, or leave some of them out of --unknown"
        )
        yield Note("not-separable", words, {"unknowns": group})
    if lost:
        words = f"not identifiable from these rows: {', '.join(lost)}"
        yield Note("not-identifiable", words, {"springs": lost})
    least = {
        e.name: e.stiffness_interval[0]
        for e in result.estimates
        if e.verdict == "at-least"
    }
    if least:
        shown = ", ".join(f"{name} at least {k:.5g}" for name, k in least.items())
        words = f"no upper end, the rows may come from a rigid spring: {shown}"
        yield Note("at-least", words, {"springs": least})
    wrong = [e.name for e in result.estimates if e.verdict == "negative"]
    if wrong:
        words = (
            f"the compliance of {', '.join(wrong)} comes out negative beyond its "
            "interval: the "
            "model or the signs of load and displacement are wrong"
        )
        yield Note("negative-compliance", words, {"springs": wrong})
    lowest = _lowest_of_links(result)
    if lowest <= 0.0:
        words = (
            "the compliance found for a link has a negative eigenvalue: the noise is "
            "larger "
            "than its smallest entries; --unknown LINK:diagonal asks for less"
        )
        yield Note("not-definite", words, {"lowest": lowest})


def _lowest_of_links(result: Identification) -> float:
    """Least eigenvalue of the compliances that were found for links."""
    if not any("*" in name for name in result.unknowns.names):
        return np.inf
    found = result.unknowns.mechanism(written_values(result.unknowns, result.estimates))
    links = [K for p in found.potentials if (K := p.own_stiffness) is not None]
    return min(float(numerics.eigenvalues(np.linalg.inv(K))[0]) for K in links)


def _bent(result: Identification, rows: NDArray[np.intp]) -> tuple[Array, Array] | None:
    """Numbers of some rows by the equilibrium under load, and by small displacements."""
    values = written_values(result.unknowns, result.of_fit)
    some = result.unknowns, result.measured.chosen(rows)
    try:
        return LoadedModel(*some).at(values)[0], Model(*some).at(values)[0]
    except CartstiffError:
        return None


def _against_equilibrium(result: Identification) -> Iterator[Note]:
    """Compare equilibrium under load and small displacement in the rows
    that move most.
    """
    seen, values = (
        result.model.observations,
        written_values(result.unknowns, result.of_fit),
    )
    try:
        y, _ = result.model.at(values)
    except CartstiffError:
        return
    size = np.abs(y) / result.chosen.deviation
    worst = np.array(
        list(dict.fromkeys(seen.row[np.argsort(-size)].tolist()))[:_COMPARED_ROWS]
    )
    worst.sort()
    if (pair := _bent(result, worst)) is None:
        return
    mine, (bent, straight) = np.flatnonzero(np.isin(seen.row, worst)), pair
    apart = np.abs(bent - straight) / result.chosen.deviation[mine]
    i = int(np.argmax(apart))
    if not apart[i] > 1.0:
        return
    row = int(result.measured.rows[seen.row[mine[i]]])
    advice = "fit it with --loaded"
    if _is_widened(result):
        advice += "; intervals are wider by what that may change"
    words = (
        f"in row {row} the equilibrium under load differs from the linear displacement "
        "by "
        f"{apart[i]:.3g} standard deviations: {advice}"
    )
    numbers = {"row": row, "linear": float(straight[i]), "loaded": float(bent[i])}
    yield Note("linear-differs", words, numbers)


def _is_widened(result: Identification) -> bool:
    """Whether intervals count the linear model's error: of positions,
    in tables of some rows.
    """
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


def _doubts(result: Identification) -> Iterator[Note]:
    yield from _suspects(result)
    checks = result.checks
    is_noise = checks.probability is not None and checks.probability >= _SIGNIFICANT
    if result.inflation > 1.0 or (
        checks.unexplained > _POORLY_EXPLAINED and not is_noise
    ):
        sizes = ", ".join(
            f"{entry['residual_rms']:.3g} {entry['unit']}"
            for entry in result.noise().values()
        )
        words = (
            f"the springs explain {100.0 * (1.0 - checks.unexplained**2):.3g} % of what "
            "was "
            f"measured beyond the rigid mechanism (squares), and leave {sizes} (rms)"
        )
        if result.inflation > 1.0:
            words += (
                f": {result.inflation:.3g} times what the deviations given explain "
                "(probability "
                f"{checks.probability:.2g}), and all intervals are wider by that"
            )
        words += (
            ". Other axes or units of the table, play, friction, "
            "or errors of zeros, tool and base?"
        )
        numbers = {"unexplained": checks.unexplained, "factor": result.inflation}
        yield Note("hardly-explained", words, numbers)
    if not result.loaded:
        yield from _against_equilibrium(result)


def _suspects(result: Identification) -> Iterator[Note]:
    """Note on gross errors, and on the fit that is recommended for them."""
    if result.recommended == "plain":
        return
    reasons = [result.robust.reason(n) for n in result.robust.suspects]
    words = []
    if reasons:
        rows = zip(result.suspects, reasons, strict=True)
        words.append(
            f"suspect rows: {_some([f'row {row} ({why})' for row, why in rows])}"
        )
    if outside := result.robust_outside:
        words.append(
            f"the robust fit is outside the plain fit's intervals of {', '.join(outside)}"
        )
    advice = "the robust fit is recommended"
    if result.fit == "robust":
        advice += ", and is the answer"
    else:
        advice += "; the answer is the plain one"
    numbers = {"rows": result.suspects, "reasons": reasons, "springs": outside}
    yield Note("suspects", f"{'; '.join(words)}: {advice}", numbers)


FITS: tuple[Literal["plain", "robust"], ...] = ("plain", "robust")
# Compliances below this share of the mechanism's own, or above its inverse, are no start
# of a search.
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
    offsets: Literal["none", "translation", "rigid"] | None = None,
    loaded: bool = False,
    fit: Literal["plain", "robust"] | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Identification:
    r"""Springs of a mechanism from measured loads and deflections, with honest intervals.

    Parameters
    ----------
    elastic : ElasticMechanism
        Its geometry is taken as known; its springs are the start of the search.
    measured : Measurements, Path, str, mapping, structured array, or data frame
        From `read_measurements`; or what that reads with its defaults.
    sought, ties
        Parameters to be found, and those with one value, as of the options ``--unknown``
        and ``--tie`` of the command.
    offsets : {"rigid", "translation", "none"}, optional
        Unknown part of the pose of the measuring frame in each session, for measured
        positions; default "rigid" if the table has sessions. Without sessions, positions
        are in the robot's own base frame B.
    loaded : bool
        Fit the equilibrium under the load itself, not displacements linear in it.
    fit : {"plain", "robust"}, optional
        Fit whose stiffnesses are the result: least squares, or the robust fit. Default:
        the one that is recommended; both are computed anyway.
    progress : callable, optional
        Called with the number of a step and the norm of the residuals over their
        deviations.

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
    _check(offsets, measured, fit)
    unknowns = replace(
        unknowns_of(elastic, sought, ties=ties), sessions=offsets or "rigid"
    )
    if both := set(measured.session).intersection(unknowns.geometry):
        raise InputError(
            "has the name of an offset that is sought",
            where="column session",
            got=min(both),
        )
    contradictions(measured)
    measured = in_base(unknowns, measured, Model(unknowns, measured).poses)
    model, plain, robust = _fits(unknowns, measured, loaded, progress)
    result = Identification(model, plain, robust, fit)
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
            "measured positions are not those of the mechanism: of another frame, point "
            "or posture",
            expected="x, y, z of --point in the base frame; --unknown base finds another "
            "frame, "
            "column session one for each session",
            got=f"residuals of {rms:.3g} {elastic.units.length} (rms)",
        )


def _check(offsets: str | None, measured: Measurements, fit: str | None) -> None:
    check_name("kind of offset", offsets or "none", OFFSETS, "--offsets")
    has_positions = any(name in measured.values for name in (*POSITION, *TURN))
    if offsets in ("rigid", "translation") and not (measured.session and has_positions):
        lacking = "a column session" if has_positions else "measured positions x, y, z"
        raise InputError(
            "nothing measured has an offset",
            where="--offsets",
            expected=lacking,
            got=offsets,
        )
    if fit is not None:
        check_name("fit", fit, FITS, "--fit")


def _fits(
    unknowns: Unknowns,
    measured: Measurements,
    loaded: bool,
    progress: Callable[[int, float], None] | None,
) -> tuple[Model, Fit, Robust]:
    """The plain and the robust fit of the rows, corrected by the offsets
    that are found.
    """
    elastic = unknowns.elastic
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
            _check_frame(
                model, plain, elastic
            )  # rows of another frame would never settle
        measured = corrected(elastic, turned or measured, step)
    raise ConvergenceError(
        "zeros and offsets do not settle: they are too large, or the rows hardly "
        "separate them",
        iterations=_MAX_CORRECTIONS,
        residual=max(map(abs, step.values()), default=0.0),
    )


def _at_rest(model: LoadedModel, near: Array) -> Array:
    """Parameters with an equilibrium in every row: `near`, the file's own,
    or stiffer ones.
    """
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
    if needs_equilibrium(unknowns.elastic):
        return nominal
    try:
        first = fitted(Model(unknowns, model.measured))
    except CartstiffError:  # no stiffness, or a law that does not reach so far
        return nominal
    share = first.theta / nominal
    sound = ~unknowns.is_bounded | (
        (share > _SMALLEST_START) & (share < 1.0 / _SMALLEST_START)
    )
    return np.where(first.is_determined & sound, first.theta, nominal)


def _check_count(model: Model) -> None:
    parameters, offsets = len(model.unknowns.parameters), len(model.offsets.names)
    if len(model.observations) < parameters + offsets:
        raise InputError(
            "fewer numbers than unknowns",
            got=f"{len(model.observations)} measured",
            expected=f"at least {parameters + offsets} ({parameters} compliances"
            + (f", {offsets} offsets)" if offsets else ")"),
        )
