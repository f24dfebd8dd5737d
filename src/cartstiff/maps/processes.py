"""Chunks of a map on processes of this machine.

They talk through pipes that nobody else can open: no port, no address. Each writes its chunks
itself; one that dies costs the chunk that it had in hand.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from itertools import islice
from threading import Thread
from typing import Any

from cartstiff.errors import CartstiffError, InputError
from cartstiff.maps.job import MapJob
from cartstiff.maps.store import MapFile

# Chunks in the hands of each process: one that is computed, and one that waits.
_AHEAD = 2
_HERE: dict[str, Any] = {}


def packed(thing: Any) -> bytes:
    """What other processes get.

    Raises
    ------
    InputError
        If something in it cannot be sent, such as a function without a name.
    """
    try:
        return pickle.dumps(thing)
    except Exception as error:  # pickle raises what the objects in it raise
        raise InputError(
            "mechanism cannot be sent to other processes",
            got=str(error),
            expected="functions of modules in its potentials, or threads",
        ) from None


def run_in_processes(
    job: MapJob,
    file: MapFile,
    todo: Sequence[int],
    advance: Callable[[int], None],
    workers: int,
) -> None:
    """Compute chunks on processes that are started for it and end with it.

    Parameters
    ----------
    job : MapJob
        What is computed.
    file : MapFile
        Where it is kept.
    todo : sequence of int
        Chunks.
    advance : callable
        Called with the number of postures of each finished chunk.
    workers : int
        How many processes.

    Raises
    ------
    CartstiffError
        If processes die before any of them has finished a chunk.
    """
    data = packed(replace(job))  # less what it has computed for itself
    waiting = dict.fromkeys(todo)
    while waiting:
        before = len(waiting)
        try:
            for chunk in _finished(data, file, list(waiting), workers):
                del waiting[chunk]
                advance(file.count(chunk))
        except BrokenProcessPool:
            if len(waiting) == before:
                raise CartstiffError(
                    "the processes that computed the map died before they finished a part; what "
                    "is done is kept, and the same call goes on. (A script that asks for workers "
                    "needs its calls under: if __name__ == '__main__')"
                ) from None


def _finished(data: bytes, file: MapFile, todo: list[int], workers: int) -> Iterator[int]:
    """Chunks in the order in which they are done."""
    pool = ProcessPoolExecutor(
        min(workers, len(todo)),
        multiprocessing.get_context("spawn"),
        _begin,
        (data, str(file.path.resolve())),
    )
    coming = iter(todo)
    try:
        running: set[Future[int]] = {
            pool.submit(_compute, chunk) for chunk in islice(coming, _AHEAD * workers)
        }
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= {pool.submit(_compute, chunk) for chunk in islice(coming, len(done))}
            for future in done:
                yield future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin(data: bytes, path: str) -> None:
    """In a process of the pool: what all its chunks share."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the pool
    Thread(target=_end_with_parent, daemon=True).start()
    threadpool_limits(1)
    _HERE.update(job=pickle.loads(data), file=MapFile.at(path))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _compute(chunk: int) -> int:
    file: MapFile = _HERE["file"]
    file.write(chunk, _HERE["job"].compute(file.boxes[chunk]))
    return chunk
