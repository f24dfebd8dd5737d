"""A study of designs, run: designs are chosen, evaluated, and kept in a file of JSON lines.

The result has the feasible designs, the best, and the Pareto front, as tables.

One design: the mechanism with its parameters, looked at in all poses, and its numbers.
"""

from __future__ import annotations

import itertools
import json
import multiprocessing
import pickle
import signal
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cartstiff.arrays import checked_number, csv_rows
from cartstiff.batch.kernels import lasting_path
from cartstiff.batch.quantities import QUANTITIES
from cartstiff.checked_call import checked
from cartstiff.described import described
from cartstiff.designs.study import Case, Measure, Study, StudyUnits, check_names, read_study
from cartstiff.errors import (
    CartstiffError,
    InputError,
    UndefinedError,
    UnknownNameError,
    check_name,
    one_line,
)
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.at_pose import COORDINATES
from cartstiff.lazily import cached_property
from cartstiff.loading import file_reader, tool_of
from cartstiff.maps.cartesian import AtPoses
from cartstiff.maps.job import STATES, MapJob
from cartstiff.maps.quantities import quantity_named
from cartstiff.maps.run import map_job
from cartstiff.maps.sampling import Axis, Grid, RandomPostures, Sampling, Trajectory
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Units, convert_length
from cartstiff.mechanisms.elastic import (
    ElasticMechanism,
    gravity_loads,
    with_default_gravity,
)
from cartstiff.mechanisms.identity import Files, identity_of, require_same
from cartstiff.mechanisms.other_units import in_units, shown_factors
from cartstiff.mechanisms.platform import Platform
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note

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
        return asdict(self)


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
        if both := study.quantities.keys() & QUANTITIES.keys():
            raise InputError("is a quantity already", where="quantities", got=min(both))
        self._asked: dict[str, list[str]] = {}
        for measure in study.measures.values():
            if measure.quantity is not None:
                if (measure.of or "worst") in ("worst", "best"):
                    self._better(measure)
                names = self._asked.setdefault(study.case_of(measure), [])
                names += [name for name in study.of_maps(measure) if name not in names]
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
        if measure.quantity is None or measure.quantity in self.study.quantities:
            return ""
        return quantity_named(measure.quantity).unit_in(self.home.units)

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
        own = measure.quantity in self.study.quantities
        better = None if own else quantity_named(measure.quantity or "").better
        if better is None:
            raise InputError(
                f"neither end of {measure.quantity} is better",
                expected="a goal, and min or max, not worst or best",
            )
        return better

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
        if all(quantity_named(name).asks != "length" for name in quantities):
            keywords["length"] = keywords["length"] or 1.0  # nothing depends on it
        job = map_job(elastic, sampling, quantities, **keywords)
        kind: Literal["none", "shared", "each"]
        kind = "none" if case.wrench is None else "shared"
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
                value = measure.arithmetic(name).value(elastic.parameters)
            else:
                values, state = maps[self.study.case_of(measure)]
                formula = self.study.formula(measure)
                row = (
                    values[measure.quantity]
                    if formula is None
                    else np.array(formula.of_rows(values))
                )
                if self.study.poses.outside == "refuse" and not np.isfinite(row).all():
                    raise _NoValueError(f"{name} is not finite")
                value = self._of_poses(measure, row, state)
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


@dataclass(frozen=True, repr=False)
class Designs(ShownInLines):
    """What became of a study.

    Attributes
    ----------
    study : Study
        What was asked.
    home : ElasticMechanism
        The mechanism with its file's own parameters.
    designs : tuple of Design
        In the order in which they were chosen.
    better : mapping of str to str
        "largest" or "smallest" for each objective.
    units : mapping of str to str
        Of objectives and constraints.
    damaged : int
        Lines of the output that could not be read again.
    """

    study: Study
    home: ElasticMechanism
    designs: tuple[Design, ...]
    better: Mapping[str, str]
    units: Mapping[str, str]
    damaged: int = 0

    def _lines(self) -> list[str]:
        counts = ", ".join(f"{n} {state}" for state, n in self.counts().items())
        return [
            f"{len(self.designs)} designs of {self.home.name}: {counts}",
            f"  Pareto front of {', '.join(self.better)}: {len(self.front)}",
        ]

    def __len__(self) -> int:
        return len(self.designs)

    def counts(self) -> dict[str, int]:
        """How many designs are in each state."""
        counted = Counter(design.state for design in self.designs)
        return {state: counted[state] for state in ("feasible", "infeasible", "failed")}

    @cached_property
    def feasible(self) -> tuple[int, ...]:
        """Indices of the designs that keep all constraints."""
        return tuple(i for i, d in enumerate(self.designs) if d.state == "feasible")

    def table(self, name: str) -> Array:
        """One column (N,) over all designs: a variable, objective or constraint; NaN if failed.

        Raises
        ------
        UnknownNameError
            For another name.
        """
        if name in self.study.variables:
            return np.array([design.parameters[name] for design in self.designs])
        if name not in self.study.measures:
            raise UnknownNameError("column", name, [*self.study.variables, *self.study.measures])
        return np.array([design.values.get(name, np.nan) for design in self.designs])

    @cached_property
    def front(self) -> tuple[int, ...]:
        """Indices of the feasible designs than which none is better in everything, best first.

        One is left out if another is as good in every objective and better in one.
        """
        rows = np.array(self.feasible, int)
        if not len(rows):
            return ()
        signs = np.array([1.0 if b == "smallest" else -1.0 for b in self.better.values()])
        cost = np.column_stack([self.table(name)[rows] for name in self.better]) * signs
        order = np.lexsort(cost.T[::-1])
        kept: list[int] = []
        for i in order.tolist():  # who comes later is not better than all before in the first
            front = cost[kept]
            if not np.any((front <= cost[i]).all(axis=1) & (front < cost[i]).any(axis=1)):
                kept.append(i)
        return tuple(rows[kept].tolist())

    def best(self, name: str | None = None) -> Design:
        """The feasible design with the best value of an objective; without a name the only one.

        Raises
        ------
        UndefinedError
            If no design is feasible.
        InputError
            If there are several objectives and none is named.
        """
        if name is None:
            if len(self.better) > 1:
                raise InputError("several objectives", expected=f"one of {', '.join(self.better)}")
            (name,) = self.better
        check_name("objective", name, self.better)
        if not self.feasible:
            raise UndefinedError(
                "no design is feasible", code="no-feasible-design", values={**self.counts()}
            )
        values = self.table(name)[list(self.feasible)]
        which = values.argmin() if self.better[name] == "smallest" else values.argmax()
        return self.designs[self.feasible[int(which)]]

    def to_csv(self) -> str:
        """A row a design: its number from 1, variables, values, state, whether on the front."""
        names = [f"{n} [{self.units[n]}]" if self.units[n] else n for n in self.study.measures]
        head = ["design", *self.study.variables, *names, "state", "front", "reason"]
        rows, front = [], set(self.front)
        for i, design in enumerate(self.designs):
            values = [design.values.get(name) for name in self.study.measures]
            rows.append(
                [
                    i + 1,
                    *design.parameters.values(),
                    *values,
                    design.state,
                    "yes" if i in front else "no",
                    design.reason,
                ]
            )
        return csv_rows(head, rows)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        study = self.study

        def named(name: str, measure: Measure) -> dict[str, Any]:
            return {"name": name, "of": measure.words, "case": measure.case}

        own = {
            "mechanism": self.home.name,
            "method": study.method.kind,
            "variables": list(study.variables),
            "set": study.set,
            "poses": study.poses.count,
            "objectives": [
                {**named(name, m), "goal": self.better[name], "unit": self.units[name]}
                for name, m in study.objectives.items()
            ],
            "constraints": [
                {
                    **named(name, m),
                    "at_least": m.at_least,
                    "at_most": m.at_most,
                    "unit": self.units[name],
                }
                for name, m in study.constraints.items()
            ],
            "counts": self.counts(),
            "best": {name: self.designs.index(self.best(name)) for name in self.better}
            if self.feasible
            else None,
        }
        frames = self.home.mechanism.frames_as_dict()
        return described("design", own, frames, gravity_loads(self.home).as_dict(), self)

    @property
    def notes(self) -> list[Note]:
        """What was assumed, and what is damaged."""
        notes = []
        lengths = [
            name
            for name, m in self.study.measures.items()
            if {"condition", "isotropy", "minimum"} & {*self.study.of_maps(m)}
            and self.study.case(self.study.case_of(m)).length is None
        ]
        if lengths:
            words = (
                f"{', '.join(lengths)}: every design at its own natural length; `length` of a case "
                "sets one for all"
            )
            notes.append(Note("own-length", words, {"measures": lengths}))
        if not self.feasible:
            notes.append(Note("no-feasible-design", "no design is feasible", {**self.counts()}))
        if self.damaged:
            words = f"{self.damaged} damaged line(s) of the output: those designs were made again"
            notes.append(Note("damaged-lines", words, {"lines": self.damaged}))
        return notes


SCHEMA = "cartstiff-designs/2"
#: Bytes of the file: ten million designs.
LARGEST = 1 << 32


@checked
def design(
    study: str | Path | Mapping[str, Any],
    *,
    given: Mapping[str, Any] | None = None,
    output: str | Path | None = None,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Designs:
    """Vary the parameters of a mechanism and judge every design over its poses.

    Parameters
    ----------
    study : str, Path or mapping
        A study's file, or its content.
    given : mapping, optional
        Tool, weight, load and units instead of the study's: "tcp", "gravity", "payload", "units",
        and under "load" keys that replace those of every case.
    output : path, optional
        File of JSON lines that keeps every finished design; one that exists is gone on with.
    workers : int
        Processes. Each looks at whole designs; the result does not depend on it.
    progress : callable, optional
        Called with the number of designs that are done, and of all.

    Returns
    -------
    Designs
        All designs, those that are feasible, the best, and the Pareto front.

    Raises
    ------
    InputError
        For a study that cannot be used. A design that fails is no error: it says why.

    Examples
    --------
    >>> import cartstiff
    >>> study = cartstiff.design({
    ...     "mechanism": "inclined-hexapod", "variables": {"sz": {"values": [0.5, 0.577, 0.7]}},
    ...     "objectives": {"stiffness": {"quantity": "translation_held_min"}},
    ... })
    >>> study.best("stiffness").parameters
    {'sz': 0.577}
    """
    asked, folder = read_study(study, given)
    count = int(checked_number(workers, "number of workers"))
    if count < 1:
        raise InputError("number of workers cannot be used", expected="1 or more", got=count)
    evaluation = StudyEvaluator(asked, folder)
    better = {name: evaluation.better(name) for name in asked.objectives}
    identity = identity_of_study(asked, evaluation.home)
    record = Record(None if output is None else Path(output), identity)
    every = {tuple(point.values()): point for point in _chosen(asked)}
    points = list(every.values())
    missing = [point for point in points if point not in record]
    with ExitStack() as stack:
        pool = stack.enter_context(_pool(min(count, len(points)))) if count > 1 else None
        one: Callable[[Mapping[str, float]], Design] = evaluation
        if pool is not None:
            own = asked, folder.resolve(), evaluation.home.files
            one = partial(_one, pickle.dumps(own))
        for done, finished in enumerate(_evaluated(missing, one, pool), 1):
            record.add(finished)
            if progress is not None:
                progress(len(points) - len(missing) + done, len(points))
    designs = tuple(record[point] for point in points)
    return Designs(
        asked,
        evaluation.home,
        designs,
        better,
        {name: evaluation.unit(measure) for name, measure in asked.measures.items()},
        record.damaged,
    )


def evaluator(
    study: str | Path | Mapping[str, Any], given: Mapping[str, Any] | None = None
) -> StudyEvaluator:
    """What gives the `Design` of parameters: the objective function for any optimiser.

    Parameters
    ----------
    study, given
        As in `design`; the method of the study plays no part.

    Raises
    ------
    InputError
        For a study that cannot be used.

    Examples
    --------
    >>> evaluate = evaluator({
    ...     "mechanism": "inclined-hexapod", "variables": {"sz": [0.3, 0.9]},
    ...     "objectives": {"radius": {"value": "=a + sz", "goal": "smallest"}},
    ... })
    >>> evaluate({"sz": 0.5}).state
    'feasible'
    """
    return StudyEvaluator(*read_study(study, given))


def _chosen(study: Study) -> list[dict[str, float]]:
    """Parameters of all designs, as the study's method chooses them."""
    variables, method = study.variables, study.method
    if method.kind == "grid":
        rows = itertools.product(*(v.grid for v in variables.values()))
        return [dict(zip(variables, row, strict=True)) for row in rows]
    from scipy.stats import qmc

    generator = np.random.default_rng(method.seed or 0)
    draw = qmc.Sobol if method.kind == "sobol" else qmc.LatinHypercube
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # balance needs powers of two: any count is taken
        shares: Array = draw(len(variables), seed=generator).random(study.size)
    return [
        {name: v.at(share) for (name, v), share in zip(variables.items(), row, strict=True)}
        for row in shares.tolist()
    ]


def _evaluated(
    points: Sequence[Mapping[str, float]], one: Callable[[Mapping[str, float]], Design], pool: Any
) -> Iterator[Design]:
    try:
        yield from (map if pool is None else pool.map)(one, points)
    except BrokenProcessPool:
        raise CartstiffError(
            "the processes that looked at the designs died; what is done is kept in the output, "
            "and the same call goes on. (A script that asks for workers needs its calls under: "
            "if __name__ == '__main__')"
        ) from None


def _pool(workers: int) -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")
    # The parent ends the pool.
    return ProcessPoolExecutor(workers, context, signal.signal, (signal.SIGINT, signal.SIG_IGN))


@lru_cache(maxsize=2)
def _evaluation(job: bytes) -> StudyEvaluator:
    """Of a study and its folder, once in each process."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    return StudyEvaluator(*pickle.loads(job))


def _one(job: bytes, parameters: Mapping[str, float]) -> Design:
    """One design, in another process."""
    return _evaluation(job)(parameters)


def identity_of_study(study: Study, elastic: ElasticMechanism) -> dict[str, Any]:
    """What a study's numbers depend on: all but how designs are chosen and named."""
    data = study.model_dump(mode="json", exclude={"method", "description", "mechanism"})
    if not study.quantities:  # files of studies from before there were any go on
        del data["quantities"]
    data = {key: value for key, value in data.items() if value is not None}
    # Ends of a range do not change the numbers of a design within it.
    data["variables"] = sorted(data["variables"])
    return identity_of(elastic, data)


def key_of(parameters: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Parameters as what a design is found by."""
    return tuple(sorted(parameters.items()))


class Record:
    """Designs by their parameters, in memory and, with a path, in a file.

    Parameters
    ----------
    path : Path, optional
        Where they are kept; one that exists is gone on with.
    identity : mapping
        Of the study, from `identity_of_study`.

    Attributes
    ----------
    damaged : int
        Lines of the file that could not be read; their designs are computed again.

    Raises
    ------
    InputError
        If the file belongs to another study or cannot be used.
    """

    def __init__(self, path: Path | None, identity: Mapping[str, Any]) -> None:
        self.path, self.damaged = path, 0
        self._known: dict[tuple[tuple[str, float], ...], Design] = {}
        head = {"schema": SCHEMA, "study": identity}
        if path is None:
            return
        if path.exists():
            self._read(path, head)
        else:
            self._append(head)

    def _read(self, path: Path, head: Mapping[str, Any]) -> None:
        where = one_line(str(path))
        try:
            first, *lines = path.read_bytes().split(b"\n")
        except OSError as error:
            raise InputError("file cannot be read", where=where, got=error.strerror) from None
        try:
            there = json.loads(first)
        except ValueError:
            there = None
        if not isinstance(there, dict) or there.get("schema") != SCHEMA:
            raise InputError("file holds no designs", where=where, expected=f"schema {SCHEMA}")
        if not isinstance(there.get("study"), dict):
            raise InputError("file does not say whose designs it holds", where=where)
        require_same(there["study"], head["study"], path, "study")
        for line in lines:
            if not line:
                continue
            try:
                entry = json.loads(line)
                if entry.pop("sum") != _sum(entry):
                    raise ValueError("damaged")
                design = Design(**entry)
            except (ValueError, TypeError, KeyError, AttributeError):
                self.damaged += 1
                continue
            self._known[key_of(design.parameters)] = design
        if lines and lines[-1]:  # a line that was not finished
            self._write(b"\n")

    def __contains__(self, parameters: Mapping[str, float]) -> bool:
        return key_of(parameters) in self._known

    def __getitem__(self, parameters: Mapping[str, float]) -> Design:
        return self._known[key_of(parameters)]

    def add(self, design: Design) -> None:
        """Keep a design."""
        self._known[key_of(design.parameters)] = design
        entry = design.as_dict()
        self._append({**entry, "sum": _sum(entry)})

    def _append(self, entry: Mapping[str, Any]) -> None:
        self._write(json.dumps(entry, allow_nan=False).encode() + b"\n")

    def _write(self, data: bytes) -> None:
        if self.path is None:
            return
        try:
            with self.path.open("ab") as file:
                file.write(data)
        except OSError as error:
            raise InputError(
                "file cannot be written", where=one_line(str(self.path)), got=error.strerror
            ) from None


def _sum(entry: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(entry, sort_keys=True).encode())
