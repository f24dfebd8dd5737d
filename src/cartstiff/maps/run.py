"""Computing a map: new or gone on with, in this process or on a cluster."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from os import cpu_count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.checked_call import checked
from cartstiff.errors import InputError, imported
from cartstiff.many.work import timed
from cartstiff.maps.cartesian import CartesianGrid
from cartstiff.maps.job import MapJob, Solved
from cartstiff.maps.opening import open_map
from cartstiff.maps.prepare import prepare_map
from cartstiff.maps.sampling import Sampling
from cartstiff.maps.store import MapFile
from cartstiff.maps.totals import facts_of
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic

if TYPE_CHECKING:
    import xarray
from cartstiff.vibration.chatter import Milling
from cartstiff.vibration.response import Damping


class Run(NamedTuple):
    """What was done for a map.

    Attributes
    ----------
    computed : int
        Chunks that were computed.
    damaged : tuple of str
        Files that were missing or did not agree with their checksums; they were made anew.
    """

    computed: int
    damaged: tuple[str, ...]


@checked
def compute_map(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
    file: str | Path,
    *,
    connection: str | None = None,
    length: float | None = None,
    direction: ArrayLike | None = None,
    deflect: ArrayLike | None = None,
    deflect_at: ArrayLike = (0.0, 0.0, 0.0),
    world: bool = False,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
    damping: Damping | float = 0.0,
    milling: Milling | None = None,
    told: Mapping[str, float] | None = None,
    single: bool = False,
    chunk: int | None = None,
    threads: int | None = None,
    workers: int = 0,
    scheduler: str | None = None,
    progress: bool | None = False,
    command: str = "",
) -> xarray.Dataset:
    """Quantities of the stiffness at many postures, in a file.

    Where the file exists and holds the same map, what is missing in it is computed.

    Parameters
    ----------
    elastic : ElasticMechanism
        From `cartstiff.load`.
    sampling : Sampling
        `Grid`, `RandomPostures`, `Trajectory`, `CartesianGrid` or `CommandGrid`.
    quantities : str or sequence of str
        Names in `cartstiff.maps.quantities.QUANTITIES`, or paths of the analysis.
    file : path
        A folder that ends in ``.zarr``.
    connection : {"load", "B", "A", "K", "F"}, optional
        The matrix that is read; default "load", the tangent under the load, where one can act, as
        in the analysis of one posture; without a load all but F are the same.
    length : float, optional
        Characteristic length for all postures; see `default_length`.
    direction : array_like (3,), optional
        For stiffness along and about a direction.
    deflect : array_like (6,), optional
        Wrench (moment, force) added to the load, whose deflection is asked for; default the load.
    deflect_at : array_like (3,)
        Point of the body, in M, at which that wrench acts; the deflection is that of M's origin.
    world : bool
        Whether direction and added wrench are in the axes of F, not of the body.
    wrench, load_kind, load_at, load_axes
        Load at every posture: wrench, what it does while the body moves, where it acts, and along
        whose axes it is given; as in `cartstiff.analyse`.
    damping : Damping or float
        For ``damping_1`` ... and ``limiting_depth``: what damps beside the mechanism's dampers.
    milling : Milling, optional
        For ``limiting_depth``: the cutter and its force law.
    told : mapping of str to float, optional
        How far drives are told to move on from each posture, as in `cartstiff.after_command`; what
        is kept is read where the mechanism comes to rest. A `CommandGrid` maps over commands.
    single : bool
        Keep results in single precision: half the size.
    chunk : int, optional
        Most postures of a chunk.
    threads : int, optional
        In this process; default one for every core.
    workers : int
        Processes on this machine instead; they talk through pipes.
    scheduler : str, optional
        Address of a running Dask scheduler, whose workers see the file under the same path.
    progress : bool or None
        Bar on standard error; None shows it on a terminal only.
    command : str
        Kept in the file.

    Returns
    -------
    xarray.Dataset
        As `open_map`.

    Raises
    ------
    InputError
        If the file holds another map (what differs is said), or for bad input.
    KeyboardInterrupt
        After Ctrl-C; the file is valid and the same call goes on with it.
    """
    job, map_file = prepare_map(
        checked_elastic(elastic),
        sampling,
        quantities,
        file,
        connection=connection,
        length=length,
        direction=direction,
        deflect=deflect,
        deflect_at=deflect_at,
        world=world,
        wrench=wrench,
        load_kind=load_kind,
        load_at=load_at,
        load_axes=load_axes,
        damping=damping,
        milling=milling,
        told=told,
        single=single,
        chunk=chunk,
        command=command,
    )
    run_map(job, map_file, threads=threads, workers=workers, scheduler=scheduler, progress=progress)
    return open_map(file)


def run_map(
    job: MapJob,
    file: MapFile,
    *,
    threads: int | None = None,
    workers: int = 0,
    scheduler: str | None = None,
    progress: bool | None = False,
    facts: dict[int, dict[str, Any]] | None = None,
) -> Run:
    """Compute the chunks that are missing or damaged.

    Arguments as in `compute_map`; into `facts` goes what this process knows of the chunks that it
    has written, for `cartstiff.maps.totals.summary_of_file`.
    """
    if workers < 0 or (threads is not None and threads < 1):
        raise InputError("number of workers or threads cannot be used", got=(workers, threads))
    if workers and scheduler is not None:
        raise InputError("give workers or a scheduler, not both")
    with file.locked():
        file.remove_leftovers()
        damaged = file.damaged()
        for chunk in damaged:
            file.forget(chunk)
        axes = file.mend_axes(job.sampling)
        todo = file.missing()
        total = int(np.prod(file.shape, dtype=object))
        done = total - sum(file.count(i) for i in todo)
        with _bar(total, done, progress) as advance:
            if todo and scheduler is not None:
                from cartstiff.maps.cluster import run_on_cluster

                run_on_cluster(job, file, todo, advance, scheduler)
            elif todo and workers:
                from cartstiff.maps.processes import run_in_processes

                run_in_processes(job, file, todo, advance, workers)
            else:
                with numerics.one_thread():
                    written = _run_here(job, file, todo, threads or cpu_count() or 1, advance)
                if facts is not None:
                    facts |= written
    mended = tuple(damaged.values()) + tuple(f"axis {name}" for name in axes)
    return Run(len(todo), mended)


def _run_here(
    job: MapJob,
    file: MapFile,
    todo: Sequence[int],
    threads: int,
    advance: Callable[[int], None],
) -> dict[int, dict[str, Any]]:
    """In this process: while a chunk is written, which mostly waits, the next one is computed."""
    boxes, facts = [file.boxes[chunk] for chunk in todo], dict[int, dict[str, Any]]()
    with ThreadPoolExecutor(1) as pool:
        writing: Future[None] | None = None
        every = job.solved(boxes)
        every = every if isinstance(job.sampling, CartesianGrid) else _ahead(every)
        for chunk, solved in zip(todo, every, strict=True):
            arrays = job.compute(file.boxes[chunk], threads, advance, solved)
            if writing is not None:
                writing.result()
            writing = pool.submit(_write, file, chunk, arrays, facts)
        if writing is not None:
            writing.result()
    return facts


def _ahead(items: Iterator[Solved]) -> Iterator[Solved]:
    """Each item is made while the one before is used."""
    with ThreadPoolExecutor(1) as pool:
        made = pool.submit(next, items, None)
        while (item := made.result()) is not None:
            made = pool.submit(next, items, None)
            yield item


def _write(
    file: MapFile, chunk: int, arrays: Mapping[str, NDArray[Any]], facts: dict[int, dict[str, Any]]
) -> None:
    with timed("writing the file"):
        file.write(chunk, arrays)
    facts[chunk] = facts_of(
        {n: a.astype(file.arrays[n].dtype, copy=False) for n, a in arrays.items()}
    )


def _bar(
    total: int, done: int, progress: bool | None
) -> AbstractContextManager[Callable[[int], None]]:
    """A bar that counts postures, or nothing."""
    if progress is False or (progress is None and not sys.stderr.isatty()):
        return nullcontext(lambda _: None)
    tqdm = imported("tqdm", package="tqdm", purpose="a progress bar", extra="maps").tqdm

    class Bar(AbstractContextManager[Callable[[int], None]]):
        def __enter__(self) -> Callable[[int], None]:
            self.bar = tqdm(
                total=total, initial=done, unit=" postures", unit_scale=True, file=sys.stderr
            )
            return lambda count: self.bar.update(count) and None

        def __exit__(self, *_: object) -> None:
            self.bar.close()

    return Bar()
