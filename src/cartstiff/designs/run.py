"""A study of designs, run: designs are chosen, evaluated, and kept in a file of JSON lines.

The result has the feasible designs, the best, and the Pareto front, as tables.
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
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff.arrays import checked_number, csv_rows
from cartstiff.checked_call import checked
from cartstiff.designs.evaluation import Design, StudyEvaluator
from cartstiff.designs.study import Study, read_study
from cartstiff.errors import CartstiffError, InputError, UndefinedError, UnknownNameError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.mechanisms.elastic import ElasticMechanism, GravityLoads, gravity_loads
from cartstiff.mechanisms.identity import identity_of, require_same
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note

#: Name and version of the form of the JSON output.
DESIGN_SCHEMA = "cartstiff-design/1"


@dataclass(frozen=True, repr=False)
class Designs(ShownInLines):
    """What became of a study.

    Attributes
    ----------
    study : Study
        What was asked.
    mechanism : str
        Its name.
    designs : tuple of Design
        In the order in which they were chosen.
    better : mapping of str to str
        "largest" or "smallest" for each objective.
    units : mapping of str to str
        Of objectives and constraints.
    damaged : int
        Lines of the output that could not be read again.
    weighed : GravityLoads
        What weighs in the mechanism with its file's own parameters.
    frames : mapping
        Where M sits in its link and the robot's base in F, with those parameters.
    length_unit : str
        Of these.
    """

    study: Study
    mechanism: str
    designs: tuple[Design, ...]
    better: Mapping[str, str]
    units: Mapping[str, str]
    damaged: int = 0
    weighed: GravityLoads = field(default_factory=lambda: GravityLoads(None, {}, (), 0.0, 0.0, "N"))
    frames: Mapping[str, Any] = field(default_factory=dict)
    length_unit: str = ""

    def _lines(self) -> list[str]:
        counts = ", ".join(f"{n} {state}" for state, n in self.counts().items())
        return [
            f"{len(self.designs)} designs of {self.mechanism}: {counts}",
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
        if name not in self.better:
            raise UnknownNameError("objective", name, self.better)
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
        return {
            "schema": DESIGN_SCHEMA,
            "mechanism": self.mechanism,
            **self.frames,
            "method": study.method.kind,
            "variables": list(study.variables),
            "set": dict(study.set),
            "poses": study.poses.count,
            **self.weighed.as_dict(),
            "objectives": [
                {
                    "name": name,
                    "of": m.words,
                    "case": m.case,
                    "goal": self.better[name],
                    "unit": self.units[name],
                }
                for name, m in study.objectives.items()
            ],
            "constraints": [
                {
                    "name": name,
                    "of": m.words,
                    "case": m.case,
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
            "front": list(self.front),
            "designs": [design.as_dict() for design in self.designs],
            "notes": [note.as_dict() for note in self.notes],
        }

    @property
    def notes(self) -> list[Note]:
        """What was assumed, and what is damaged."""
        notes = []
        lengths = [
            name
            for name, m in self.study.measures.items()
            if m.quantity in ("condition", "isotropy", "minimum")
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
        evaluation.home.name,
        designs,
        better,
        {name: evaluation.unit(measure) for name, measure in asked.measures.items()},
        record.damaged,
        gravity_loads(evaluation.home),
        evaluation.home.mechanism.frames_as_dict(),
        evaluation.home.units.length,
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
