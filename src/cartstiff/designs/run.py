"""A study of designs, run: designs are chosen, evaluated, and kept in a file of JSON lines."""

from __future__ import annotations

import itertools
import json
import multiprocessing
import pickle
import signal
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff.arrays import checked_number
from cartstiff.designs.evaluation import Design, StudyEvaluator
from cartstiff.designs.results import Designs
from cartstiff.designs.study import Study, read_study
from cartstiff.errors import CartstiffError, InputError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.loading.catalogue import bundled
from cartstiff.loading.yaml_file import read_yaml
from cartstiff.mechanisms.weighed import weights_of

SCHEMA = "cartstiff-designs/1"
#: Bytes of the file: ten million designs.
LARGEST = 1 << 32


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
        A study's file, or what would stand in it.
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
    record = Record(None if output is None else Path(output), digest_of(asked, folder))
    every = {tuple(point.values()): point for point in _chosen(asked)}
    points = list(every.values())
    missing = [point for point in points if point not in record]
    with ExitStack() as stack:
        pool = stack.enter_context(_pool(min(count, len(points)))) if count > 1 else None
        one = evaluation if pool is None else partial(_one, pickle.dumps((asked, folder.resolve())))
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
        weights_of(evaluation.home),
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


def digest_of(study: Study, folder: Path) -> str:
    """What tells a study's numbers from another's: all but how designs are chosen and named."""
    beside = folder / study.mechanism
    path = beside if beside.is_file() else bundled(study.mechanism) or beside
    digest = sha256(path.read_bytes())
    for model in _models(read_yaml(path)[0]):
        file = path.parent / model
        digest.update(file.read_bytes() if file.is_file() else model.encode())
    data = study.model_dump(mode="json", exclude={"method", "description", "mechanism"})
    data = {key: value for key, value in data.items() if value is not None}
    # Ends of a range do not change the numbers of a design within it.
    data["variables"] = sorted(data["variables"])
    digest.update(json.dumps(data, sort_keys=True).encode())
    return digest.hexdigest()


def _models(data: Any) -> list[str]:
    if isinstance(data, dict):
        own = [data["model"]] if isinstance(data.get("model"), str) else []
        return own + [name for value in data.values() for name in _models(value)]
    return [name for value in data for name in _models(value)] if isinstance(data, list) else []


def key_of(parameters: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Parameters as what a design is found by."""
    return tuple(sorted(parameters.items()))


class Record:
    """Designs by their parameters, in memory and, with a path, in a file.

    Parameters
    ----------
    path : Path, optional
        Where they are kept; one that exists is gone on with.
    digest : str
        Of the study, from `digest_of`.

    Attributes
    ----------
    damaged : int
        Lines of the file that could not be read; their designs are computed again.

    Raises
    ------
    InputError
        If the file belongs to another study or cannot be used.
    """

    def __init__(self, path: Path | None, digest: str) -> None:
        self.path, self.damaged = path, 0
        self._known: dict[tuple[tuple[str, float], ...], Design] = {}
        head = {"schema": SCHEMA, "study": digest}
        if path is None:
            return
        if path.exists():
            self._read(path, head)
        else:
            self._append(head)

    def _read(self, path: Path, head: Mapping[str, str]) -> None:
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
        if there != head:
            raise InputError(
                "the file holds the designs of another study",
                where=where,
                expected="the same mechanism, poses, cases, objectives and constraints, or another "
                "file name",
            )
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
