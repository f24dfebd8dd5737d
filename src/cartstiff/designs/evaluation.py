"""One design: the mechanism with its parameters, looked at in all poses, and its numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cartstiff.designs.study import Case, Measure, Study, StudyUnits, check_names
from cartstiff.errors import (
    CartstiffError,
    InputError,
    UndefinedError,
    UnknownNameError,
    one_line,
)
from cartstiff.expressions import Expression
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.at_pose import COORDINATES
from cartstiff.loading import file_reader, tool_of
from cartstiff.many.kernels import lasting_path
from cartstiff.maps.cartesian import AtPoses
from cartstiff.maps.job import STATES, MapJob
from cartstiff.maps.prepare import map_job
from cartstiff.maps.quantities import QUANTITIES
from cartstiff.maps.sampling import Axis, Grid, RandomPostures, Sampling, Trajectory
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism, with_default_gravity
from cartstiff.mechanisms.identity import Files
from cartstiff.mechanisms.other_units import in_units, shown_factors
from cartstiff.mechanisms.platform import Platform

#: Poses of a design that are looked at one by one where the fast arithmetic cannot decide them.
ONE_BY_ONE = 8
#: Poses of a mechanism without fast arithmetic that are looked at before all the others.
FIRST = 5
#: Poses that take as long as making arrays of NumPy ready for one design.
PREPARING = 50
_REDUCED: dict[str, Callable[[Array], Array]] = {
    "min": np.min,
    "max": np.max,
    "mean": np.mean,
    "median": np.median,
}
Verdict = Literal["feasible", "infeasible", "failed"]


@dataclass(frozen=True)
class Design:
    """Parameters and what became of them.

    Attributes
    ----------
    parameters : mapping of str to float
        Values of the variables.
    values : mapping of str to float
        Objectives and constraints by name; none of a design that has failed.
    state : {"feasible", "infeasible", "failed"}
        Whether all constraints are kept, or the numbers do not exist.
    reason : str
        Why it has failed, or which constraints are not kept.
    """

    parameters: Mapping[str, float]
    values: Mapping[str, float] = field(default_factory=dict)
    state: Verdict = "feasible"
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "parameters": dict(self.parameters),
            "values": dict(self.values),
            "state": self.state,
            "reason": self.reason,
        }


class ChangedFileError(InputError):
    """A file is not the one that the study was begun with."""


class _NoValueError(Exception):
    """A quantity does not exist where it must."""


class StudyEvaluator:
    """A study with its mechanism's file read: gives the `Design` of parameters.

    Parameters
    ----------
    study : Study
        The study.
    folder : Path
        Where its mechanism's path begins.
    files : tuple of (str, str), optional
        What the study was begun with, as `ElasticMechanism.files`; default what is read now.

    Attributes
    ----------
    home : ElasticMechanism
        The mechanism with the file's own parameters.

    Raises
    ------
    InputError
        If the mechanism has no such parameters or quantities.
    """

    def __init__(self, study: Study, folder: Path, files: Files | None = None) -> None:
        self.study = study
        beside = folder / study.mechanism
        source = beside if beside.is_file() else study.mechanism
        read = file_reader(source)
        if read is None:
            raise InputError(
                "a study needs the parameters of a mechanism file",
                where="mechanism",
                expected="a .yaml file",
                got=one_line(study.mechanism),
            )
        self._read: Callable[[dict[str, Any]], ElasticMechanism] = read
        self._tool, self._length = self._in_file_units(read({}).units)
        self._files = files
        self.home = self._made({})
        self._files = self.home.files
        check_names(study, self.home.parameters)
        self._formulas = {
            name: Expression(measure.value[1:], name)
            for name, measure in study.measures.items()
            if measure.value is not None
        }
        self._asked: dict[str, list[str]] = {}
        for measure in study.measures.values():
            if measure.quantity is not None:
                if (measure.of or "worst") in ("worst", "best"):
                    self._better(measure)
                names = self._asked.setdefault(study.case_of(measure), [])
                if measure.quantity not in names:
                    names.append(measure.quantity)
        for name, quantities in self._asked.items():
            # What can be wrong with the study itself is said before any design is made.
            try:
                self._job(self.home, study.case(name), quantities)
            except UndefinedError:
                continue

    def mechanism(self, parameters: Mapping[str, float]) -> ElasticMechanism:
        """The mechanism of a design."""
        return self._made({"parameters": {**self.study.set, **parameters}})

    def _made(self, values: dict[str, Any]) -> ElasticMechanism:
        elastic, units = self._read({**self._tool, **values}), self.study.units
        if self._files is not None and elastic.files != self._files:
            raise ChangedFileError(
                "a file of the mechanism was changed while the study ran",
                where=one_line(self.study.mechanism),
                expected="the same files until its end; what is done is kept in the output",
            )
        if self.study.payload is not None and self.study.gravity is None:
            elastic = with_default_gravity(elastic, self.study.payload[0])
        return elastic if units is None else in_units(elastic, self._length, units.angle)

    def _in_file_units(self, own: Units) -> tuple[dict[str, Any], str]:
        """Tool and weight in the units of the mechanism's file, and the study's unit of length."""
        units = self.study.units or StudyUnits()
        length = units.length or own.length
        factor, _ = convert_length(Units(length), own)
        tcp, payload = self.study.tcp, self.study.payload
        turn = np.pi / 180.0 if units.angle == "deg" else 1.0
        return tool_of(
            tcp and [*(x * factor for x in tcp[:3]), *(x * turn for x in tcp[3:])],
            self.study.gravity,
            payload and [payload[0], *(x * factor for x in payload[1:])],
        ), length

    def __call__(self, parameters: Mapping[str, float]) -> Design:
        """Evaluate one design; what it lacks is its reason, and no error."""
        try:
            with np.errstate(all="ignore"):
                elastic = self.mechanism(parameters)
                measured = self._measured(elastic)
        except ChangedFileError:
            raise
        except (CartstiffError, _NoValueError) as error:
            return Design(dict(parameters), {}, "failed", one_line(str(error), 300))
        broken = [
            f"{name} = {measured[name]:.6g}"
            for name, limit in self.study.constraints.items()
            if not limit.is_kept(measured[name])
        ]
        return Design(
            dict(parameters), measured, "infeasible" if broken else "feasible", ", ".join(broken)
        )

    def unit(self, measure: Measure) -> str:
        """Unit of a measure; "" for arithmetic, of which nobody has said it."""
        if measure.of in ("share", "reached"):
            return "1"
        if measure.quantity is None:
            return ""
        known = QUANTITIES.get(measure.quantity)
        return "" if known is None else known.unit_in(self.home.units)

    def better(self, name: str) -> Literal["largest", "smallest"]:
        """Which end of an objective is the better one.

        Raises
        ------
        InputError
            If nothing says it.
        """
        measure = self.study.objectives[name]
        if measure.goal is not None:
            return measure.goal
        if measure.of in ("share", "reached"):
            return "largest"
        return "largest" if self._better(measure) == "larger" else "smallest"

    def _better(self, measure: Measure) -> str:
        name = measure.quantity or ""
        known = QUANTITIES.get(name)
        if known is None and "." not in name:
            raise UnknownNameError("quantity", name, QUANTITIES)
        if known is None or known.better is None:
            raise InputError(
                f"neither end of {measure.quantity} is better",
                expected="a goal, and min or max, not worst or best",
            )
        return known.better

    def _sampling(self, elastic: ElasticMechanism) -> Sampling:
        poses, names, home = self.study.poses, elastic.names, elastic.q
        given = poses.grid or (poses.random.ranges if poses.random else {})
        of_body = _are_poses(elastic, given)
        if of_body:
            names = COORDINATES
            T = elastic.mechanism.at(home).pose
            home = np.concatenate([T[:3, 3], se3.roll_pitch_yaw(T)])
        shift = dict(zip(names, home.tolist(), strict=True)) if poses.about_home else {}
        angles = shown_factors(elastic)
        if of_body and elastic.units.shown_angle == "deg":
            angles = dict.fromkeys(COORDINATES[3:], np.pi / 180.0)

        def ends(name: str, low: float, high: float) -> tuple[float, float]:
            size, start = angles.get(name, 1.0), shift.get(name, 0.0)
            return low * size + start, high * size + start

        sampling: Sampling
        if poses.grid is not None:
            axes = {
                name: Axis(*ends(name, low, high), int(count))
                for name, (low, high, count) in poses.grid.items()
            }
            sampling = Grid(axes, names, home)
        elif poses.random is not None:
            ranges = {name: (x, x) for name, x in zip(names, home.tolist(), strict=True)}
            for name, (low, high) in poses.random.ranges.items():
                if name not in ranges:
                    raise UnknownNameError("coordinate", name, names)
                ranges[name] = ends(name, low, high)
            drawn = poses.random
            sampling = RandomPostures(drawn.count, drawn.seed, *np.transpose([*ranges.values()]))
        else:
            return Trajectory(home[None])
        return AtPoses(sampling) if of_body else sampling

    def _job(self, elastic: ElasticMechanism, case: Case, quantities: list[str]) -> MapJob:
        mechanism = elastic.mechanism
        if isinstance(mechanism, Platform):
            elastic = replace(elastic, mechanism=mechanism.as_one_of_many())
        sampling = self._sampling(elastic)
        keywords = case.keywords()
        known = [QUANTITIES.get(name) for name in quantities]
        if all(q is not None and q.asks != "length" for q in known):
            keywords["length"] = keywords["length"] or 1.0  # nothing depends on it
        job = map_job(elastic, sampling, quantities, **keywords)
        kind: Literal["none", "shared", "each"]
        kind = "none" if case.wrench is None else "shared" if case.load_axes == "body" else "each"
        total = self.study.size * max(sampling.size, PREPARING)
        path = lasting_path(elastic, kind, job.outputs, total)
        # Machine code is worth its time where it serves all designs.
        if path == "compiled" and not isinstance(mechanism, Platform):
            path = "portable" if sampling.size < 5000 else path
        return replace(job, path=path, one_by_one=ONE_BY_ONE)

    def _measured(self, elastic: ElasticMechanism) -> dict[str, float]:
        """Objectives and constraints of a mechanism."""
        maps = {
            name: self._map(self._job(elastic, self.study.case(name), quantities))
            for name, quantities in self._asked.items()
        }
        measured = {}
        for name, measure in self.study.measures.items():
            if measure.quantity is None:
                value = self._formulas[name].value(elastic.parameters)
            else:
                values, state = maps[self.study.case_of(measure)]
                value = self._of_poses(measure, values[measure.quantity], state)
            if not np.isfinite(value):
                raise _NoValueError(f"{name} is not finite")
            measured[name] = float(value)
        return measured

    def _map(self, job: MapJob) -> tuple[dict[str, Array], Array]:
        """Quantities and states (N,) of a design."""
        strict = self.study.poses.outside == "refuse"
        if strict and job.path == "engine" and job.sampling.size > FIRST:
            # One by one: a design that fails at one of a few poses need not be looked at further.
            whole = job.sampling.postures(tuple(slice(0, n) for n in job.sampling.shape))
            some = whole[np.linspace(0, len(whole) - 1, FIRST).astype(int)]
            self._arrays(replace(job, sampling=Trajectory(some)), strict)
        return self._arrays(job, strict)

    def _arrays(self, job: MapJob, strict: bool) -> tuple[dict[str, Array], Array]:
        computed = job.compute(tuple(slice(0, n) for n in job.sampling.shape))
        values = {name: computed[name].ravel() for name in job.names}
        state = computed["state"].ravel()
        lacking = np.any([~np.isfinite(v) for v in values.values()], axis=0)
        if strict and lacking.any():
            raise _NoValueError(_reason(state, lacking))
        return values, state

    def _of_poses(self, measure: Measure, values: Array, state: Array) -> float:
        exists = np.isfinite(values)
        if measure.of == "reached":
            return float(exists.mean())
        if measure.of == "share":
            within = exists
            with np.errstate(invalid="ignore"):
                if measure.above is not None:
                    within = within & (values >= measure.above)
                if measure.below is not None:
                    within = within & (values <= measure.below)
            return float(within.mean())
        if not exists.any():
            raise _NoValueError(_reason(state, ~exists))
        there, of = values[exists], measure.of or "worst"
        if of in ("worst", "best"):
            larger = self._better(measure) == "larger"
            of = "min" if (of == "worst") == larger else "max"
        value: Array = _REDUCED[of](there)
        return float(value)


def _are_poses(elastic: ElasticMechanism, given: Iterable[str]) -> bool:
    """Whether coordinates are those of the pose of a body that legs carry."""
    chain, names = elastic.mechanism, set(given)
    is_closed = isinstance(chain, Chain) and bool(chain.closures)
    return is_closed and bool(names) and names <= set(COORDINATES) - set(elastic.names)


def _reason(state: Array, lacking: Array) -> str:
    """States of the poses at which something does not exist."""

    def counted(rows: Array) -> str:
        names = Counter(STATES[i] for i in state[rows].tolist())
        reasons = [f"{words.get(name, name)} at {n}" for name, n in names.most_common()]
        return ", ".join(reasons)

    words = {"regular": "infinite or undefined", "other": "doubtful, not told apart"}
    doubtful, looked = state == STATES.index("other"), ~lacking & (state != 0)
    also = f"; looked at one by one: {counted(looked)}" if doubtful.any() and looked.any() else ""
    return f"{counted(lacking)} of {len(state)} poses{also}"
