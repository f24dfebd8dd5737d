"""Run of a study: designs are chosen and evaluated.

A design is the mechanism with other parameters, evaluated at all poses of the study. The
result has the feasible designs, the best ones and the Pareto front, as tables.
"""

from __future__ import annotations

import itertools
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from cartstiff.core.arrays import Array, csv_rows
from cartstiff.core.checked_call import checked
from cartstiff.core.described import described
from cartstiff.core.errors import (
    CartstiffError,
    InputError,
    UndefinedError,
    UnknownNameError,
    check_name,
    one_line,
)
from cartstiff.core.figures import new_figure
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.differences import jacobian
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.gravity_loads import gravity_loads, with_default_gravity
from cartstiff.core.notes import Note
from cartstiff.core.results import LabelledResult
from cartstiff.core.units import ANGLES, Units, convert_length
from cartstiff.files.identity import Files
from cartstiff.files.loading import file_reader, tool_of
from cartstiff.files.other_units import in_units
from cartstiff.kinematics.at_pose import COORDINATES
from cartstiff.recorded.kernels import WORTH_COMPILING, lasting_path
from cartstiff.recorded.quantities import quantity_named
from cartstiff.wings.maps.cartesian import AtPoses
from cartstiff.wings.maps.designs.slopes import AtPose, rates_at
from cartstiff.wings.maps.designs.study import (
    Case,
    Measure,
    Study,
    StudyUnits,
    check_names,
    read_study,
)
from cartstiff.wings.maps.job import STATES, MapJob
from cartstiff.wings.maps.run import map_job
from cartstiff.wings.maps.sampling import (
    Axis,
    Grid,
    RandomPostures,
    Sampling,
    Trajectory,
)

#: Largest number of a design's poses that are analysed singly where stacks cannot decide
#: them.
MAX_SINGLE_POSES = 8
#: Number of poses that are evaluated first where each pose is analysed singly.
FIRST_POSES = 5
#: Number of poses that take as long as preparing the stacks of one design.
PREPARATION_POSES = 50
#: Share of a variable's range that steps of difference quotients refer to.
_STEP_SHARE = 0.05
_REDUCTIONS: dict[str, Callable[[Array], Array]] = {
    "min": np.min,
    "max": np.max,
    "mean": np.mean,
    "median": np.median,
}
Verdict = Literal["feasible", "infeasible", "failed"]


@dataclass(frozen=True)
class Design:
    """Parameters of a design and its result.

    Attributes
    ----------
    parameters : mapping of str to float
        Values of the variables.
    values : mapping of str to float
        Objectives and constraints by name; empty for a failed design.
    state : {"feasible", "infeasible", "failed"}
        Whether all constraints are satisfied; failed if a number does not exist.
    reason : str
        Why the design failed, or which constraints are violated.
    """

    parameters: Mapping[str, float]
    values: Mapping[str, float] = field(default_factory=dict)
    state: Verdict = "feasible"
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


class ChangedFileError(InputError):
    """A file of the mechanism was changed after the study began."""


class _NoValueError(Exception):
    """A required quantity does not exist."""


class StudyEvaluator:
    """A study with its mechanism's file read; a call evaluates one design.

    Parameters
    ----------
    study : Study
        The study.
    folder : Path
        Folder that the mechanism's path is relative to.
    files : tuple of (str, str), optional
        Files that the study was begun with, as `ElasticMechanism.files`; default the
        present ones.

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
        self._asked: dict[str, list[str]] = {}
        for measure in study.measures.values():
            if measure.quantity is not None:
                if (measure.of or "worst") in ("worst", "best"):
                    self._better(measure)
                names = self._asked.setdefault(study.case_of(measure), [])
                names += [measure.quantity] * (measure.quantity not in names)
        for name, quantities in self._asked.items():
            # Faults of the study itself are reported before any design is made.
            try:
                self._job(self.home, study.case(name), quantities)
            except UndefinedError:
                continue

    def mechanism(self, parameters: Mapping[str, float]) -> ElasticMechanism:
        """Return the mechanism of a design."""
        return self._made({"parameters": {**self.study.set, **parameters}})

    def _made(self, values: dict[str, Any]) -> ElasticMechanism:
        elastic, units = self._read({**self._tool, **values}), self.study.units
        if self._files is not None and elastic.files != self._files:
            raise ChangedFileError(
                "a file of the mechanism was changed while the study ran",
                where=one_line(self.study.mechanism),
                expected="the same files until its end",
            )
        if self.study.payload is not None and self.study.gravity is None:
            elastic = with_default_gravity(elastic, self.study.payload[0])
        return elastic if units is None else in_units(elastic, self._length)

    def _in_file_units(self, own: Units) -> tuple[dict[str, Any], str]:
        """Return tool and weight in units of the mechanism's file,
        and the study's length unit.
        """
        units = self.study.units or StudyUnits()
        length = units.length or own.length
        factor, _ = convert_length(Units(length), own)
        tcp, payload = self.study.tcp, self.study.payload
        return tool_of(
            tcp
            and [
                *(x * factor for x in tcp[:3]),
                *(x * ANGLES[units.angle] for x in tcp[3:]),
            ],
            self.study.gravity,
            payload and [payload[0], *(x * factor for x in payload[1:])],
        ), length

    def __call__(self, parameters: Mapping[str, float]) -> Design:
        """Evaluate one design; a design that fails holds the reason."""
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
            dict(parameters),
            measured,
            "infeasible" if broken else "feasible",
            ", ".join(broken),
        )

    def gradient(self, parameters: Mapping[str, float]) -> dict[str, dict[str, float]]:
        """Derivatives of objectives and constraints by each variable.

        They are exact by the mechanism's numbers, which follow the variables by the
        file's arithmetic (`cartstiff.wings.maps.designs.slopes`). The worst, best and
        median of all poses are those of the pose that decides, of equal ones the first;
        characteristic lengths stay.

        Parameters
        ----------
        parameters : mapping of str to float
            Values of the variables; those that are missing are the file's.

        Raises
        ------
        InputError
            For a design that fails, and for a share of the poses, which changes in steps.
        """
        if (design := self(parameters)).state == "failed":
            what = "the design fails, so that it has no derivatives"
            raise InputError(what, expected="a design with values", got=design.reason)
        names, of = list(self.study.variables), self.study.variables
        known = self.mechanism(parameters).parameters
        start = np.array([known[name] for name in names])
        sizes = _STEP_SHARE * np.array([of[name].size_at(known[name]) for name in names])

        @cache
        def read(*values: float) -> ElasticMechanism:
            return self.mechanism({**parameters, **dict(zip(names, values, strict=True))})

        def there(change: Array) -> ElasticMechanism:
            return read(*(start + change).tolist())

        found = {}
        for name, measure in self.study.measures.items():
            row = self._slopes(name, measure, there, sizes)
            found[name] = dict(zip(names, row.tolist(), strict=True))
        return found

    def _slopes(
        self,
        name: str,
        measure: Measure,
        there: Callable[[Array], ElasticMechanism],
        sizes: Array,
    ) -> Array:
        """Derivatives (v,) of a measure by the variables, from changes to mechanisms."""
        if measure.quantity is None:
            value = measure.arithmetic(name).value
            return jacobian(lambda change: value(there(change).parameters), sizes)
        asked = [measure.quantity]
        case = self.study.case(self.study.case_of(measure)).alone(
            quantity_named(measure.quantity).asks
        )

        def at(change: Array, pose: int) -> AtPose:
            return AtPose(self._job(there(change), case, asked), pose)

        home = self._job(there(np.zeros(sizes.size)), case, asked)
        values, _ = self._map(home)
        weights = self._weights(measure, values[measure.quantity])
        parts = [
            weights[pose] * rates_at(partial(at, pose=pose), sizes)
            for pose in np.flatnonzero(weights).tolist()
        ]
        return np.asarray(np.sum(parts, axis=0))

    def _weights(self, measure: Measure, values: Array) -> Array:
        """Derivatives (N,) of a measure by the quantity's values at the poses."""
        exists = np.flatnonzero(np.isfinite(values))
        of = self._reduction(measure)
        if of not in _REDUCTIONS:
            raise InputError(
                "a share of poses changes in steps: it has no derivative",
                expected="the worst, best, min, max, mean or median of them",
                got=of,
            )
        order, count = exists[np.argsort(values[exists], kind="stable")], len(exists)
        deciding = {
            "min": order[:1],
            "max": order[-1:],
            "mean": order,
            "median": order[(count - 1) // 2 : count // 2 + 1],
        }[of]
        weights = np.zeros(len(values))
        weights[deciding] = 1.0 / len(deciding)
        return weights

    def _reduction(self, measure: Measure) -> str:
        """What is taken of the poses; the worst and the best are an end."""
        of = measure.of or "worst"
        if of in ("worst", "best"):
            larger = self._better(measure) == "larger"
            of = "min" if (of == "worst") == larger else "max"
        return of

    def unit(self, measure: Measure) -> str:
        """Return the unit of a measure; "" for arithmetic, whose unit is unknown."""
        if measure.of in ("share", "reached"):
            return "1"
        if measure.quantity is None:
            return ""
        return quantity_named(measure.quantity).unit_in(self.home.units)

    def better(self, name: str) -> Literal["largest", "smallest"]:
        """Return which end of an objective is the better one.

        Raises
        ------
        InputError
            If neither the study nor the quantity defines it.
        """
        measure = self.study.objectives[name]
        if measure.goal is not None:
            return measure.goal
        if measure.of in ("share", "reached"):
            return "largest"
        return "largest" if self._better(measure) == "larger" else "smallest"

    def _better(self, measure: Measure) -> str:
        better = quantity_named(measure.quantity or "").better
        if better is None:
            raise InputError(
                f"neither end of {measure.quantity} is better",
                expected="a goal, and min or max, not worst or best",
            )
        return better

    def _sampling(self, elastic: ElasticMechanism) -> Sampling:
        poses, names, home = self.study.poses, elastic.names, elastic.q
        given = poses.grid or poses.ranges
        of_body = _are_poses(elastic, given)
        turns = [c.name for c in elastic.mechanism.coordinates if not c.is_length]
        if of_body:
            names, turns = COORDINATES, list(COORDINATES[3:])
            T = elastic.mechanism.at(home).pose
            home = np.concatenate([T[:3, 3], se3.roll_pitch_yaw(T)])
        ranges = self._ranges(given, dict(zip(names, home.tolist(), strict=True)), turns)
        # A grid, random postures, or the home posture alone.
        sampling: Sampling
        if poses.grid is not None:
            counts = poses.grid
            axes = {n: Axis(*ends, int(counts[n][-1])) for n, ends in ranges.items()}
            sampling = Grid(axes, names, home)
        elif poses.random is not None:
            fixed = {name: (x, x) for name, x in zip(names, home.tolist(), strict=True)}
            lower, upper = np.transpose([*(fixed | ranges).values()])
            sampling = RandomPostures(poses.random.count, poses.random.seed, lower, upper)
        else:
            return Trajectory(home[None])
        return AtPoses(sampling, ranges) if of_body else sampling

    def _ranges(
        self,
        given: Mapping[str, Sequence[float]],
        home: Mapping[str, float],
        turns: Collection[str],
    ) -> dict[str, tuple[float, float]]:
        """Ends of the given ranges in rad and length units, by coordinate."""
        angle, ranges = ANGLES[(self.study.units or StudyUnits()).angle], {}
        for name, (low, high, *_) in given.items():
            check_name("coordinate", name, list(home))
            size = angle if name in turns else 1.0
            start = home[name] if self.study.poses.about_home else 0.0
            ranges[name] = low * size + start, high * size + start
        return ranges

    def _job(
        self, elastic: ElasticMechanism, case: Case, quantities: list[str]
    ) -> MapJob:
        mechanism = elastic.mechanism
        shared = mechanism.as_one_of_many()
        if shared is not mechanism:
            elastic = replace(elastic, mechanism=shared)
        sampling = self._sampling(elastic)
        keywords = case.keywords()
        if all(quantity_named(name).asks != "length" for name in quantities):
            keywords["length"] = keywords["length"] or 1.0  # no quantity depends on it
        job = map_job(elastic, sampling, quantities, **keywords)
        total = self.study.size * max(sampling.size, PREPARATION_POSES)
        path = lasting_path(elastic, case.wrench is not None, total)
        # Only the code of platforms serves all designs; else it must pay for itself in
        # one design.
        if path == "compiled" and not shared.is_one_of_many:
            path = "portable" if sampling.size < WORTH_COMPILING else path
        # Stacks leave the choice of cables' tensions to one analysis after the other.
        is_chosen = len(mechanism.points) > 6
        return replace(job, path=path, one_by_one=None if is_chosen else MAX_SINGLE_POSES)

    def _measured(self, elastic: ElasticMechanism) -> dict[str, float]:
        """Return the objectives and constraints of a mechanism."""
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
                row = values[measure.quantity]
                if self.study.poses.outside == "refuse" and not np.isfinite(row).all():
                    raise _NoValueError(f"{name} is not finite")
                value = self._of_poses(measure, row, state)
            if not np.isfinite(value):
                raise _NoValueError(f"{name} is not finite")
            measured[name] = float(value)
        return measured

    def _map(self, job: MapJob) -> tuple[dict[str, Array], Array]:
        """Return the quantities and states (N,) of a design."""
        strict = self.study.poses.outside == "refuse"
        if strict and job.path == "engine" and job.sampling.size > FIRST_POSES:
            # A design that fails at one of a few poses need not be evaluated at all
            # poses.
            whole = job.sampling.postures(tuple(slice(0, n) for n in job.sampling.shape))
            some = whole[np.linspace(0, len(whole) - 1, FIRST_POSES).astype(int)]
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
        value: Array = _REDUCTIONS[self._reduction(measure)](values[exists])
        return float(value)


def _are_poses(elastic: ElasticMechanism, given: Iterable[str]) -> bool:
    """Whether coordinates are those of the pose of a body on legs."""
    chain, names = elastic.mechanism, set(given)
    is_closed = bool(chain.closures)
    return is_closed and bool(names) and names <= set(COORDINATES) - set(elastic.names)


def _reason(state: Array, lacking: Array) -> str:
    """Count the states of the poses at which a quantity does not exist."""

    def counted(rows: Array) -> str:
        names = Counter(STATES[i] for i in state[rows].tolist())
        reasons = [f"{words.get(name, name)} at {n}" for name, n in names.most_common()]
        return ", ".join(reasons)

    words = {"regular": "infinite or undefined", "other": "doubtful, not told apart"}
    doubtful, looked = state == STATES.index("other"), ~lacking & (state != 0)
    if doubtful.any() and looked.any():
        also = f"; looked at one by one: {counted(looked)}"
    else:
        also = ""
    return f"{counted(lacking)} of {len(state)} poses{also}"


#: Largest number of panels of a picture: pairs of four objectives.
_MAX_PANELS = 6


@dataclass(frozen=True, eq=False, repr=False)
class Designs(LabelledResult):
    """Results of a study.

    Attributes
    ----------
    study : Study
        The study.
    home : ElasticMechanism
        The mechanism with its file's own parameters.
    designs : tuple of Design
        In the order in which they were chosen.
    better : mapping of str to str
        "largest" or "smallest" for each objective.
    units : mapping of str to str
        Units of objectives and constraints.
    """

    command: ClassVar = "design"

    study: Study
    home: ElasticMechanism
    designs: tuple[Design, ...]
    better: Mapping[str, str]
    units: Mapping[str, str]

    def _lines(self) -> list[str]:
        counts = ", ".join(f"{n} {state}" for state, n in self.counts().items())
        return [
            f"{len(self.designs)} designs of {self.home.name}: {counts}",
            f"  Pareto front of {', '.join(self.better)}: {len(self.front)}",
        ]

    def __len__(self) -> int:
        return len(self.designs)

    def counts(self) -> dict[str, int]:
        """Return the number of designs in each state."""
        counted = Counter(design.state for design in self.designs)
        return {state: counted[state] for state in ("feasible", "infeasible", "failed")}

    @cached_property
    def feasible(self) -> tuple[int, ...]:
        """Indices of the designs that satisfy all constraints."""
        return tuple(i for i, d in enumerate(self.designs) if d.state == "feasible")

    def table(self, name: str) -> Array:
        """Return a variable, objective or constraint (N,) of all designs; NaN if failed.

        Raises
        ------
        UnknownNameError
            For another name.
        """
        if name in self.study.variables:
            return np.array([design.parameters[name] for design in self.designs])
        if name not in self.study.measures:
            raise UnknownNameError(
                "column", name, [*self.study.variables, *self.study.measures]
            )
        return np.array([design.values.get(name, np.nan) for design in self.designs])

    @cached_property
    def front(self) -> tuple[int, ...]:
        """Indices of the Pareto front, best first in the order of the objectives.

        A feasible design is left out if another is as good in every objective and better
        in one.
        """
        rows = np.array(self.feasible, int)
        if not len(rows):
            return ()
        signs = np.array([1.0 if b == "smallest" else -1.0 for b in self.better.values()])
        cost = np.column_stack([self.table(name)[rows] for name in self.better]) * signs
        order = np.lexsort(cost.T[::-1])
        kept: list[int] = []
        for i in order.tolist():  # no later design dominates an earlier one
            front = cost[kept]
            if not np.any((front <= cost[i]).all(axis=1) & (front < cost[i]).any(axis=1)):
                kept.append(i)
        return tuple(rows[kept].tolist())

    def best(self, name: str | None = None) -> Design:
        """Return the feasible design with the best value of an objective,
        by default the only one.

        Raises
        ------
        UndefinedError
            If no design is feasible.
        InputError
            If there are several objectives and none is named.
        """
        if name is None:
            if len(self.better) > 1:
                raise InputError(
                    "several objectives", expected=f"one of {', '.join(self.better)}"
                )
            (name,) = self.better
        check_name("objective", name, self.better)
        if not self.feasible:
            raise UndefinedError(
                "no design is feasible",
                code="no-feasible-design",
                values={**self.counts()},
            )
        values = self.table(name)[list(self.feasible)]
        which = values.argmin() if self.better[name] == "smallest" else values.argmax()
        return self.designs[self.feasible[int(which)]]

    def to_csv(self) -> str:
        """One row per design: number from 1, variables, values, state,
        whether on the front.
        """
        names = [
            f"{n} [{self.units[n]}]" if self.units[n] else n for n in self.study.measures
        ]
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

    def to_dict(self) -> dict[str, Any]:
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
            "best": None,
        }
        if self.feasible:
            own["best"] = {n: self.designs.index(self.best(n)) for n in self.better}
        frames = self.home.mechanism.frames_as_dict()
        return described("design", own, frames, gravity_loads(self.home).to_dict(), self)

    @property
    def notes(self) -> list[Note]:
        """Notes on assumptions."""
        notes = []
        lengths = [
            name
            for name, m in self.study.measures.items()
            if m.quantity in ("condition", "isotropy", "minimum")
            and self.study.case(self.study.case_of(m)).length is None
        ]
        if lengths:
            words = (
                f"{', '.join(lengths)}: every design at its own natural length; `length` "
                "of a case sets one for all"
            )
            notes.append(Note("own-length", words, {"measures": lengths}))
        if not self.feasible:
            notes.append(
                Note("no-feasible-design", "no design is feasible", {**self.counts()})
            )
        return notes

    def plot(self, ax: Any = None) -> Any:
        """Draw objectives against each other with the Pareto front,
        or one against the variables.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure
            Feasible designs dark, infeasible ones pale, the front joined by a line.

        Raises
        ------
        InputError
            If every design has failed.
        """
        names = list(self.better)
        if all(design.state == "failed" for design in self.designs):
            raise InputError("no design has values to draw", got="all have failed")
        single = len(names) == 1
        if single:
            pairs = [(v, names[0]) for v in self.study.variables]
        else:
            pairs = list(itertools.combinations(names, 2))
        pairs = pairs[:_MAX_PANELS]
        columns = min(len(pairs), 3)
        rows = -(-len(pairs) // columns)
        figure = new_figure(
            1.0 + 3.8 * columns, 0.6 + 3.2 * rows, self.home.springs_in_doubt, ax=ax
        )
        front = list(self.front)
        feasible = np.zeros(len(self), bool)
        feasible[list(self.feasible)] = True
        for i, (x, y) in enumerate(pairs):
            axis = figure.add_subplot(rows, columns, i + 1)
            a, b = self.table(x), self.table(y)
            axis.plot(
                a[~feasible], b[~feasible], "o", color="0.8", ms=4, label="infeasible"
            )
            axis.plot(a[feasible], b[feasible], "o", color="C0", ms=4, label="feasible")
            order = sorted(front, key=lambda j: a[j])
            axis.plot(
                a[order],
                b[order],
                "o-" if len(names) == 2 else "o",
                color="C1",
                ms=6,
                lw=1.2,
                label="best" if single else "Pareto front",
            )
            axis.set(xlabel=self._label(x), ylabel=self._label(y))
            for values, direction in ((a, "x"), (b, "y")):
                if _decades(values):
                    axis.set(**{f"{direction}scale": "log"})
                    own = getattr(axis, f"{direction}axis")
                    own.set_major_formatter("{x:g}")  # texts are not read as formulas
                    own.set_minor_formatter("")
        figure.axes[0].legend(fontsize="small")
        figure.suptitle(f"{len(self)} designs of {self.home.name}", fontsize="medium")
        return figure

    def _label(self, name: str) -> str:
        if name in self.study.variables:
            return name
        unit = self.units[name]
        words = self.study.measures[name].words
        return f"{name}: {words}" + (f" [{unit}]" if unit else "")


@checked
def design(
    study: str | Path | Mapping[str, Any],
    *,
    given: Mapping[str, Any] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Designs:
    """Vary the parameters of a mechanism and evaluate every design over its poses.

    Parameters
    ----------
    study : str, Path or mapping
        File or content of the study.
    given : mapping, optional
        Tool, weight, load and units instead of the study's: "tcp", "gravity", "payload",
        "units", and under "load" keys that replace those of every case.
    progress : callable, optional
        Called with (done, total) designs.

    Returns
    -------
    Designs
        All designs, those that are feasible, the best, and the Pareto front.

    Raises
    ------
    InputError
        For a study that cannot be used. A design that fails raises no error and holds the
        reason.

    Examples
    --------
    >>> import cartstiff
    >>> study = cartstiff.design({
    ...     "mechanism": "inclined-hexapod",
    ...     "variables": {"sz": {"values": [0.5, 0.577, 0.7]}},
    ...     "objectives": {"stiffness": {"quantity": "translation_held_min"}},
    ... })
    >>> study.best("stiffness").parameters
    {'sz': 0.577}
    """
    asked, folder = read_study(study, given)
    evaluation = StudyEvaluator(asked, folder)
    better = {name: evaluation.better(name) for name in asked.objectives}
    points = [*{tuple(point.values()): point for point in _chosen(asked)}.values()]
    designs = []
    for done, point in enumerate(points, 1):
        designs.append(evaluation(point))
        if progress is not None:
            progress(done, len(points))
    return Designs(
        asked,
        evaluation.home,
        tuple(designs),
        better,
        {name: evaluation.unit(measure) for name, measure in asked.measures.items()},
    )


def evaluator(
    study: str | Path | Mapping[str, Any], given: Mapping[str, Any] | None = None
) -> StudyEvaluator:
    """A function from parameters to their `Design`, as an objective for any optimiser.

    Parameters
    ----------
    study, given
        As in `design`; the method of the study is not used.

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
    """Return the parameters of all designs that the study's method chooses."""
    variables, method = study.variables, study.method
    if method.kind == "grid":
        rows = itertools.product(*(v.grid for v in variables.values()))
        return [dict(zip(variables, row, strict=True)) for row in rows]
    from scipy.stats import qmc

    generator = np.random.default_rng(method.seed or 0)
    draw = qmc.Sobol if method.kind == "sobol" else qmc.LatinHypercube
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # Sobol's balance needs powers of two; any count is allowed
        shares: Array = draw(len(variables), seed=generator).random(study.size)
    return [
        {
            name: v.at(share)
            for (name, v), share in zip(variables.items(), row, strict=True)
        }
        for row in shares.tolist()
    ]


def _decades(values: Array) -> bool:
    """Whether values span decades."""
    finite = values[np.isfinite(values)]
    return bool(finite.size and finite.min() > 0 and finite.max() > 100 * finite.min())
