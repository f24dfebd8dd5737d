"""A study of designs, run: all designs, which are best, and what they cost each other."""

from __future__ import annotations

import multiprocessing
import pickle
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from cartstiff.arrays import checked_number
from cartstiff.designs.evaluation import Design, StudyEvaluator
from cartstiff.designs.reading import read_study
from cartstiff.designs.record import Record, digest_of
from cartstiff.designs.results import Designs
from cartstiff.designs.search import search
from cartstiff.errors import CartstiffError, InputError
from cartstiff.maps.cluster import shared_out
from cartstiff.mechanisms.weighed import weights_of


def design(
    study: str | Path | Mapping[str, Any],
    *,
    given: Mapping[str, Any] | None = None,
    output: str | Path | None = None,
    workers: int = 1,
    scheduler: str | None = None,
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
    scheduler : str, optional
        Address of a running Dask scheduler, whose workers look at the designs instead; they see the
        mechanism's file under the same path.
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
    if scheduler is not None and (count > 1 or asked.method.kind == "local"):
        raise InputError(
            "a scheduler has its own workers"
            if count > 1
            else "a local search looks at one design after the other",
            where="scheduler",
            expected="no workers, and another method",
        )
    evaluation = StudyEvaluator(asked, folder)
    better = {name: evaluation.better(name) for name in asked.objectives}
    record = Record(None if output is None else Path(output), digest_of(asked, folder))
    done = 0

    with ExitStack() as stack:
        pool = None
        if scheduler is not None:
            pool = stack.enter_context(shared_out(scheduler))
        elif count > 1 and asked.method.kind != "local":
            pool = stack.enter_context(_pool(min(count, asked.size)))
        one = evaluation if pool is None else partial(_one, pickle.dumps((asked, folder.resolve())))

        def evaluate(points: Sequence[Mapping[str, float]]) -> list[Design]:
            nonlocal done
            missing = [point for point in points if point not in record]
            missing = list({tuple(p.items()): p for p in missing}.values())
            done += len(points) - len(missing)
            for finished in _evaluated(missing, one, pool):
                record.add(finished)
                done += 1
                if progress is not None:
                    progress(min(done, asked.size), asked.size)
            return [record[point] for point in points]

        first = next(iter(better.values()))
        points = search(asked, evaluation.home.parameters, first, evaluate)
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
