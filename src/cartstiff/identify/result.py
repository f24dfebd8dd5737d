r"""Springs found from measurements: estimates with intervals in compliance space.

An interval ``c -+ t s`` is truncated at zero; its ends are 1/k. If it reaches zero the stiffness
has no upper end: it is "at least" the lower one.
"""

from __future__ import annotations

import datetime
import io
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.analysis.tolerances import quantile
from cartstiff.arrays import Array
from cartstiff.described import described
from cartstiff.errors import InputError, one_line
from cartstiff.geometry import se3
from cartstiff.identify.fitting import Fit, Robust, Solved
from cartstiff.identify.measurements import POSITION, TURN, Measurements
from cartstiff.identify.models import LinearModel, Model
from cartstiff.identify.offsets import OffsetEstimate, placement_of
from cartstiff.identify.unknowns import ZERO, Unknown, Unknowns
from cartstiff.loading.catalogue import bundled
from cartstiff.loading.mechanism_file import with_parameters
from cartstiff.loading.schema import FlexibleModel, PoseModel, place_of, pose_of
from cartstiff.loading.yaml_file import read_yaml
from cartstiff.mechanisms.contract import SI, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.mechanisms.identified import CompliancePattern, Identified
from cartstiff.mechanisms.other_units import in_units
from cartstiff.notes import Note
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.springs import CoupledSprings, JointSprings, PolynomialLaw

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
    kind : {"backlash", "stiffening", "drift"}
        Kind of the term.
    name : str
        Name of the spring or column.
    size : float
        Its factor: half the play (rad, length); compliance per force; displacement per second.
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
    """

    chi_squared: float | None
    freedom: float
    probability: float | None
    repeats: int
    lack_of_fit: float | None
    left_out: Array
    patterns: tuple[Pattern, ...]


def inflation_of(checks: Checks) -> float:
    """Factor on the deviations if the scatter is larger than they explain; else 1."""
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


def checked(
    model: Model, fit: Fit, unknowns: Unknowns, measured: Measurements, kept: NDArray[np.bool_]
) -> Checks:
    """Tests of a fit; `kept` are the numbers (m,) that it uses."""
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
    """Repeated numbers, and the probability of the F of the part that they do not explain."""
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
    r, group = solution.residual / solution.deviation, postures[row]
    answer = np.full(len(r), np.nan)
    order = np.argsort(group, kind="stable")
    for mine in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        U = solution.basis[mine]
        left = np.eye(len(mine)) - U @ U.T
        if np.linalg.eigvalsh(left)[0] > numerics.ROUNDING**0.5:
            answer[mine] = np.linalg.solve(left, r[mine])
    return answer * solution.deviation


def _patterns(
    model: LinearModel,
    fit: Fit,
    unknowns: Unknowns,
    measured: Measurements,
    kept: NDArray[np.bool_],
) -> tuple[Pattern, ...]:
    """Terms that explain more, by the t of an added column, the strongest first."""
    from scipy.linalg import orth
    from scipy.special import stdtr

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
    time = measured.time[model.observations.row]
    if not np.isnan(time).any() and np.ptp(time) > 0.0:
        seen = np.array(model.observations.column)
        for name in dict.fromkeys(model.observations.column):
            names.append(("drift", name))
            columns.append(np.where(seen == name, time - time.mean(), 0.0))
    solution = fit.solved
    U = orth(solution.basis[: len(kept)][kept], rcond=numerics.RANK)
    r = (solution.residual / solution.deviation)[kept]
    r = r - U @ (U.T @ r)
    freedom, found = len(r) - U.shape[1] - 1, list[Pattern]()
    if not names:
        return ()
    X = (np.stack(columns, axis=1) / solution.deviation[:, None])[kept]
    least = numerics.ROUNDING**0.25 * np.linalg.norm(X, axis=0)  # else one of the fitted columns
    while freedom >= 1:
        X = X - U @ (U.T @ X)
        left = np.linalg.norm(X, axis=0)
        size = X.T @ r / np.maximum(left, numerics.TINY) ** 2
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


def freedom_of(solution: Solved, inflation: float) -> float:
    """Degrees of freedom of the intervals."""
    return solution.degrees if inflation == 1.0 else min(solution.degrees, solution.freedom)


def estimates(
    solution: Solved,
    unknowns: Unknowns,
    level: float,
    inflation: float,
    bias: Array | None = None,
) -> list[Estimate]:
    """One estimate per parameter.

    Parameters
    ----------
    solution : Solved
        The fit.
    unknowns : Unknowns
        The fitted parameters.
    level : float
        Probability of the intervals.
    inflation : float
        Factor on standard deviations if the scatter is larger than those given.
    bias : ndarray (P,), optional
        Error of the linear model, by which the intervals are wider at both ends.
    """
    t = quantile(level, freedom_of(solution, inflation))
    answer = []
    for p, unknown in enumerate(unknowns.parameters):
        if not solution.is_determined[p]:
            answer.append(Estimate(unknown, "not-identifiable", None, None, None))
            continue
        s = float(np.sqrt(solution.covariance[p, p])) * inflation
        centre = float(solution.unbounded[p])
        half = t * s + (0.0 if bias is None else float(bias[p]))
        low, high = centre - half, centre + half
        verdict: Verdict = "determined"
        if unknown.has_stiffness:
            if high < 0.0:
                verdict = "negative"
            elif low <= 0.0:
                verdict = "at-least"
            low, high = max(low, 0.0), max(high, 0.0)
        answer.append(Estimate(unknown, verdict, float(solution.theta[p]), s, (low, high)))
    return answer


@dataclass(frozen=True)
class Rejected:
    """A rejected row: its number from 1, and the reason."""

    row: int
    reason: str


@dataclass(frozen=True, eq=False)
class Identification:
    """Springs found from measurements.

    Attributes
    ----------
    elastic : ElasticMechanism
        The measured mechanism.
    unknowns : Unknowns
        Parameters.
    measured : Measurements
        The rows used.
    rows : int
        Rows of the table.
    rejected : tuple of Rejected
        Rows that were left out.
    model : Model
        Predictions and their derivatives.
    chosen, plain : Fit
        The fit of the estimates, and least squares on all rows used.
    robust : Robust
        The robust fit.
    estimates : tuple of Estimate
        One per parameter.
    geometry : tuple of OffsetEstimate
        Joint zeros, offsets of tool and base, if they are sought.
    placed : mapping of str to float
        Zeros and offsets that fit the rows, also those that these do not separate.
    columns : tuple of str
        Names of all offsets in the regressor.
    checks : Checks
        Checks of the model.
    level : float
        Probability of the intervals.
    fit, offsets : str
        Options of `identify`.
    loaded : bool
        Whether the equilibrium under load was fitted.
    inflation : float
        Factor on all standard deviations if the scatter is larger than those given; else 1.
    notes : tuple of Note
        Assumptions and findings.
    """

    elastic: ElasticMechanism
    unknowns: Unknowns
    measured: Measurements
    rows: int
    rejected: tuple[Rejected, ...]
    model: Model
    chosen: Fit
    plain: Fit
    robust: Robust
    estimates: tuple[Estimate, ...]
    geometry: tuple[OffsetEstimate, ...]
    placed: Mapping[str, float]
    columns: tuple[str, ...]
    checks: Checks
    level: float
    fit: str
    offsets: str
    loaded: bool
    inflation: float
    notes: tuple[Note, ...] = field(default=())

    @property
    def covariance(self) -> Array:
        """Covariance of the compliances (P, P); NaN where not identifiable."""
        return np.asarray(self.chosen.solved.covariance * self.inflation**2)

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the intervals."""
        return freedom_of(self.chosen.solved, self.inflation)

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
        seen, solution = self.model.observations, self.chosen.solved
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
                "sigma_is_estimated": bool(np.isnan(seen.deviation[mine]).any()),
                "leave_one_out_rms": None if np.isnan(left).all() else _rms(left[~np.isnan(left)]),
            }
        return answer

    def weak_directions(self) -> list[dict[str, Any]]:
        """Combinations of springs and offsets that the rows do not determine."""
        solution, count = self.chosen.solved, len(self.unknowns.names)
        names = (*self.unknowns.names, *self.columns)
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
        solution = self.chosen.solved
        lost = solution.directions[:, self._rank() : len(solution.singular_values)]
        together = np.abs(lost @ lost.T) > numerics.NEGLIGIBLE_SHARE
        names = (*self.unknowns.names, *self.columns)
        groups: dict[int, list[str]] = {}
        from scipy.sparse.csgraph import connected_components

        for name, group in zip(names, connected_components(together)[1].tolist(), strict=True):
            groups.setdefault(group, []).append(name)
        return [group for group in groups.values() if len(group) > 1]

    def _rank(self) -> int:
        return numerics.rank(self.chosen.solved.singular_values)

    def as_dict(self) -> dict[str, Any]:
        """The object printed by ``cartstiff identify --json``."""
        noise = self.noise()
        first = noise.get("length") or noise["angle"]
        robust = dict(zip(self.unknowns.names, self.robust.fit.theta, strict=True))
        plain = dict(zip(self.unknowns.names, self.plain.theta, strict=True))
        parameters = []
        for p, e in enumerate(self.estimates):
            known = self.chosen.solved.is_determined[p]
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
            "singular_values": self.chosen.solved.singular_values,
            "unseen": self.weak_directions(),
            "geometry": [{**vars(g), "identifiable": g.identifiable} for g in self.geometry],
            "checks": {k: v for k, v in vars(self.checks).items() if k != "left_out"},
        }
        return described("identify", own, first, self.elastic.about(), self)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


# Turn [rad] of a base up to which the weight acts along the fit's axes.
_MAX_TURN = 0.05
_ROBOTS = (".urdf", ".xml", ".mjcf")


def written_values(result: Identification) -> Array:
    """Compliances (P,) that a mechanism can have: estimates, or the file's without one.

    For a compliance with an upper end only, and an estimate of zero, the middle of its interval.
    """
    values = result.unknowns.nominal.copy()
    for p, e in enumerate(result.estimates):
        if e.compliance is None or e.verdict == "negative":
            continue
        middle = 0.5 * sum(e.interval) if e.interval is not None else 0.0
        bounded = e.unknown.has_stiffness
        values[p] = e.compliance if e.compliance > 0.0 or not bounded else middle
    return values


def with_result(
    result: Identification, date: str | None = None, source: str = ""
) -> ElasticMechanism:
    """The mechanism with the springs found, and their covariance."""
    values = written_values(result)
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


def mechanism_file(
    result: Identification, mechanism: str, frame: str | None, to: Path, source: str
) -> bytes:
    """Text of a mechanism file with the springs found, their covariance, source, date and count.

    Parameters
    ----------
    result : Identification
        The springs found.
    mechanism : str
        Name or path the mechanism was loaded from.
    frame : str, optional
        The frame of interest that was named.
    to : Path
        Path of the new file, to which paths in it are relative.
    source : str
        Origin of the numbers, for readers.

    Raises
    ------
    InputError
        If the mechanism does not come from a file that could be written again.
    """
    data = _data(result, mechanism, frame, to)
    elastic = with_result(result, source=source)
    length = data.get("units", {}).get("length", SI.length)
    if elastic.units.length != length:  # --units are those of input and output
        elastic = in_units(elastic, length)
    _put_springs(data, elastic, to.parent)
    _put_geometry(data, result)
    identified = elastic.identified
    if identified is None:
        raise TypeError("a result without findings")
    entries = []
    for pattern, value in zip(identified.patterns, identified.values.tolist(), strict=True):
        entry: dict[str, Any] = {"name": pattern.name, "value": value}
        if pattern.law is not None:
            entry["polynomial"] = list(pattern.law)
        elif pattern.entries != ((pattern.name, pattern.name, 1.0),):
            entry["elements"] = [list(e) for e in pattern.entries]
        entries.append(entry)
    about = {
        "compliances": entries,
        "covariance": identified.covariance.tolist(),
        "degrees": identified.degrees,
        "level": identified.level,
        "rows": identified.rows,
        "date": identified.date,
        "source": identified.source,
        "undetermined": list(identified.undetermined),
        "at_least": dict(identified.at_least or {}),
    }
    data["identified"] = {k: v for k, v in about.items() if v not in (None, [], {}, "")}
    data["identified"]["compliances"] = entries
    data["identified"]["covariance"] = identified.covariance.tolist()
    return _yaml(data)


def _yaml(data: dict[str, Any]) -> bytes:
    from ruamel.yaml import YAML

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None
    yaml.width = 100_000  # a text that is folded at a hyphen comes back with a blank
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    out = io.StringIO()
    yaml.dump(data, out)
    return out.getvalue().encode()


def _data(result: Identification, mechanism: str, frame: str | None, to: Path) -> dict[str, Any]:
    """Keys of the mechanism's own file, its paths relative to the new file."""
    path = bundled(mechanism) or Path(mechanism).expanduser()
    elastic = result.elastic
    if path.suffix.lower() in (".yaml", ".yml"):
        read, lines = read_yaml(path)
        # Numbers are written anew: none may depend on a parameter any more.
        data, _ = with_parameters(
            read, lambda at: place_of(path, lines, at), result.elastic.parameters
        )
        data.pop("identified", None)
        if frame is not None and data["kind"] in ("serial", "closed-chain"):
            data["frame"] = frame
            data.pop("offset", None)
        for holder in (data, *(data["legs"] if data["kind"] == "parallel" else ())):
            for entry in holder.get("flexible", {}).values():
                files = entry.get("superelement", {})
                for key in {"K", "M"} & files.keys():
                    files[key] = _relative(path.parent / files[key], to)
            model = holder.get("model")
            if isinstance(model, str) and not Path(model).expanduser().is_absolute():
                beside = path.parent / model
                if beside.suffix.lower() in _ROBOTS or beside.is_file():
                    holder["model"] = _relative(beside, to)
        if elastic.gravity is not None:
            data["gravity"] = elastic.gravity.tolist()
        return data
    kind = elastic.mechanism.kind
    if kind not in ("serial", "closed-chain"):
        raise InputError(
            "the mechanism does not come from a file that could be written again",
            where=one_line(mechanism),
            expected="a mechanism file or a robot",
        )
    model = _relative(path, to) if path.suffix.lower() in _ROBOTS else mechanism
    data = {"kind": kind, "model": model, "frame": elastic.mechanism.frame}
    if elastic.gravity is not None:
        data["gravity"] = elastic.gravity.tolist()
    return data


def _relative(path: Path, to: Path) -> str:
    """A path relative to the folder of a file; absolute on another drive."""
    try:
        return Path(os.path.relpath(path.resolve(), to.resolve().parent)).as_posix()
    except ValueError:
        return str(path.resolve())


def _put_springs(data: dict[str, Any], elastic: ElasticMechanism, folder: Path) -> None:
    """Write a mechanism's numbers into the file's springs, legs, lines and flexible links."""
    springs, kind = elastic.springs, data["kind"]
    if springs is None:
        return
    if kind in ("stewart-gough", "springs"):
        data["legs"]["stiffness"] = springs.stiffness.tolist()
    elif kind == "parallel":
        for i, leg in enumerate(data["legs"]):
            _put_joints(leg, elastic, f"leg{i + 1}/")
            _put_links(leg, elastic, f"leg{i + 1}/", folder)
    else:
        _put_joints(data, elastic, "")
        _put_links(data, elastic, "", folder)
    names = Elements(elastic)
    for i, line in enumerate(data.get("lines", ())):
        at = names.index(f"line{i + 1}")
        line["stiffness"] = float(names.stiffness[at, at])


def _put_geometry(data: dict[str, Any], result: Identification) -> None:
    """Write the zeros, the tool and the base that were found.

    Raises
    ------
    InputError
        If the kind of file has no key for them, or the base is turned so far that the weight, which
        the fit takes along the stated axes, would act along others.
    """
    placed, elastic = result.placed, result.elastic
    lengths, _ = convert_length(elastic.units, SI)
    keys = {"zeros": "zeros", "tool": "offset", "base": "base"}
    words = {"zeros" if n.endswith(ZERO) else n.partition(".")[0] for n in placed}
    for word in words - (set(keys) if data["kind"] == "serial" else set()):
        raise InputError(
            f"{word} found has no place in a file of kind {data['kind']}",
            where="-o",
            expected="-o without it in --unknown",
        )
    tool, base = placement_of(placed, "tool"), placement_of(placed, "base")
    turn = float(np.linalg.norm(se3.log(se3.pose(base[:3, :3]))[:3]))
    if turn > _MAX_TURN and elastic.gravity is not None:
        raise InputError(
            "the base found is turned against the frame of the positions, along whose axes the "
            "weight acts",
            where="-o",
            expected=f"at most {_MAX_TURN} rad, or rows with a column session instead of base",
            got=f"{turn:.3g} rad",
        )
    point = np.asarray(result.measured.point) - tool[:3, 3]  # it keeps its numbers in the new M
    tool[:3, 3] += point - tool[:3, :3] @ point
    for word, T in (("tool", tool), ("base", base)):
        if word in words:
            T[:3, 3] *= lengths
            T = pose_of(PoseModel.model_validate(data.get(keys[word], {}))) @ T
            data[keys[word]] = {"xyz": T[:3, 3].tolist(), "rpy": se3.roll_pitch_yaw(T).tolist()}
    for j, name in enumerate(elastic.names):
        if f"{name}{ZERO}" in placed:
            size = lengths if elastic.mechanism.coordinates[j].is_length else 1.0
            zeros = data.setdefault("zeros", {})
            zeros[name] = zeros.get(name, 0.0) + size * placed[f"{name}{ZERO}"]


def _put_joints(holder: dict[str, Any], elastic: ElasticMechanism, prefix: str) -> None:
    elements = Elements(elastic)
    springs = holder.setdefault("springs", {})
    laws = elastic.springs.laws if isinstance(elastic.springs, JointSprings) else {}
    for j, law in laws.items():
        entry = springs.get(elastic.names[j].removeprefix(prefix))
        if isinstance(law, PolynomialLaw) and isinstance(entry, dict):
            entry["polynomial"] = list(law.coefficients)
    for j, name in enumerate(elastic.names):
        short = name.removeprefix(prefix)
        if (
            not name.startswith(prefix)
            or j in elastic.mechanism.virtual
            or name not in elements.names
        ):
            continue
        at = elements.index(name)
        entry = springs.get(short)
        if isinstance(entry, dict) and not {"polynomial", "table"} & set(entry):
            entry["stiffness"] = float(elements.stiffness[at, at])
        elif entry is None:
            springs[short] = {"stiffness": float(elements.stiffness[at, at])}
    if not springs:
        del holder["springs"]


def _put_links(
    holder: dict[str, Any], elastic: ElasticMechanism, prefix: str, folder: Path
) -> None:
    for potential in elastic.potentials:
        if not isinstance(potential, (CoupledSprings, Beam)):
            continue
        link = potential.link.removeprefix(prefix)
        entry = holder.get("flexible", {}).get(link)
        if entry is None or not potential.link.startswith(prefix):
            continue
        if isinstance(potential, CoupledSprings):
            K: Array = potential.matrix[se3.SWAP][:, se3.SWAP]
            if "superelement" in entry:
                spring = FlexibleModel.model_validate(entry, context={"folder": folder})
                if np.allclose(K, spring.stiffness or K, rtol=numerics.REPORTED_ERROR):
                    continue  # the files still hold
                if spring.mass is not None:
                    raise InputError(
                        "the stiffness found for a superelement with a mass matrix has no place in "
                        "a mechanism file",
                        where=link,
                        expected="the link given without M",
                    )
                del entry["superelement"]
                entry["offset"] = spring.offset.model_dump()
            entry["stiffness"] = K.tolist()
        else:
            beam = entry["beam"]
            factor = potential.section.torsion / (beam["G"] * beam["J"])
            beam["E"], beam["G"] = beam["E"] * factor, beam["G"] * factor
