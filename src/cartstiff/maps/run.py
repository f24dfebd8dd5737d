"""Computing a map: new or gone on with, in this process or on a cluster.

A map before it is computed: everything checked, the file made or recognised.

Chunks of a map on processes of this machine.

They talk through pipes that nobody else can open: no port, no address. Each writes its chunks
itself; one that dies costs the chunk that it had in hand.

Chunks of a map on the workers of a Dask scheduler.

A chunk's result does not depend on who computes it or how often. Each worker writes its chunks
itself; a worker that dies costs the chunks that it had in hand.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import platform
import signal
import sys
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, fields, replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from os import cpu_count
from pathlib import Path
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff import numerics
from cartstiff.analysis.metrics import characteristic_length
from cartstiff.arrays import checked_input, checked_unit, checked_vector
from cartstiff.checked_call import checked
from cartstiff.errors import (
    CartstiffError,
    InputError,
    UnknownNameError,
    checked_kind,
    imported,
    one_line,
)
from cartstiff.geometry.se3 import Array
from cartstiff.many.kernels import WORTH_READING, Backend, lasting_path
from cartstiff.many.work import timed
from cartstiff.maps.cartesian import CartesianGrid
from cartstiff.maps.job import STATES, CommandedJob, CommandGrid, MapJob, Solved
from cartstiff.maps.quantities import QUANTITIES, Quantity, Settings, choose_quantities
from cartstiff.maps.reading import facts_of
from cartstiff.maps.sampling import Sampling, dimension_name
from cartstiff.maps.store import NOT_COMPUTED, SCHEMA, MapFile, open_map
from cartstiff.matrix_names import OF_MANY
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.mechanisms.identity import identity_of, require_same, require_versions, versions
from cartstiff.statics.command import checked_command
from cartstiff.stiffness.applied_load import checked_load
from cartstiff.stiffness.compute import analyse
from cartstiff.version import __version__
from cartstiff.vibration.chatter import Milling
from cartstiff.vibration.response import Damping

if TYPE_CHECKING:
    import xarray


def default_connection(elastic: ElasticMechanism, wrench: Array | None = None) -> str:
    """The matrix that is read: "load", the tangent under the load, where one can act; else "B"."""
    if wrench is not None:
        return "load" if wrench.any() else "B"
    springs = elastic.springs
    if springs is None or elastic.potentials:
        return "load"
    return "load" if np.any(~np.isnan(springs.rest) & (springs.stiffness > 0.0)) else "B"


def default_length(elastic: ElasticMechanism, connection: str = "B", **load: Any) -> float:
    """Characteristic length of a map: the natural length at the default posture, or one unit.

    `load` as `wrench` and its kind in `cartstiff.analyse`.
    """
    here = analyse(elastic, **load).at()
    length = characteristic_length(*here.pair(connection, "held")).value
    return float(f"{length:.6g}")  # the same digits on every processor


def map_job(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
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
) -> MapJob:
    """What is computed for a map, checked; without any file.

    Arguments as in `compute_map`.

    Raises
    ------
    InputError
        For what cannot be used.
    """
    load = None if wrench is None else checked_input(wrench, (6,), "wrench")
    kind = checked_load(load_kind, load_at, load_axes, load is not None, elastic.may_be_loaded)
    asked = None if deflect is None else checked_vector(deflect, 6, "wrench of the deflection")
    if connection is None:
        connection = default_connection(elastic, load)
    if connection not in OF_MANY:
        raise UnknownNameError("connection", connection, OF_MANY)
    acting: dict[str, Any] = {
        "wrench": load,
        "load_kind": kind.kind,
        "load_at": kind.at,
        "load_axes": load_axes,
    }
    settings = Settings(
        connection,
        default_length(elastic, connection, **acting) if length is None else _positive(length),
        None if direction is None else _direction(direction),
        None if asked is None else tuple(asked.tolist()),
        world,
        kind,
        tuple(checked_vector(deflect_at, 3, "point of the deflection").tolist()),
        load is not None,
        damping if isinstance(damping, Damping) else Damping(damping),
        milling,
    )
    names = [quantities] if isinstance(quantities, str) else list(quantities)
    chosen = choose_quantities(names, settings, elastic)
    _check_used(settings, chosen)
    row = None if load is None else tuple(load.tolist())
    own = elastic, sampling, tuple(q.name for q in chosen), settings, row, load_axes
    if not told and not isinstance(sampling, CommandGrid):
        return MapJob(*own)
    if isinstance(sampling, CartesianGrid) and sampling.redundancy == "best":
        raise InputError(
            "is chosen before drives are told",
            where="redundancy",
            expected="the nearest posture",
            got="best",
        )
    steps = checked_command(elastic, told) if told else {}
    if isinstance(sampling, CommandGrid) and (both := set(steps) & set(sampling.names)):
        raise InputError("is told twice", where="command", got=", ".join(sorted(both)))
    return CommandedJob(*own, told=steps)


def _check_used(settings: Settings, chosen: Sequence[Quantity]) -> None:
    """Refuse what is given for quantities that are not among those of the map."""
    asked = {quantity.asks for quantity in chosen}
    for what, is_given, of in (
        ("direction", settings.direction is not None, ("direction",)),
        ("wrench of the deflection", settings.deflect is not None, ("deflect",)),
        ("milling", settings.milling is not None, ("milling",)),
        ("damping", settings.damping != Damping(), ("damping", "milling")),
    ):
        if is_given and asked.isdisjoint(of):
            names = [q.name for q in QUANTITIES.values() if q.asks in of]
            raise InputError(
                "is given, and no quantity needs it",
                where=what,
                expected="one of " + ", ".join(names[:4]) + ", ..." * (len(names) > 4),
                got=", ".join(q.name for q in chosen),
            )


def prepare_map(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
    file: str | Path,
    *,
    single: bool = False,
    chunk: int | None = None,
    command: str = "",
    **asked: Any,
) -> tuple[MapJob, MapFile]:
    """Check everything and make the file, or open the one that holds the same map.

    Arguments as in `compute_map`; `asked` goes to `map_job`.
    """
    if not isinstance(sampling, Sampling):
        raise InputError(
            "not a choice of postures",
            where="sampling",
            got=type(sampling).__name__,
            expected="a Grid, RandomPostures, Trajectory or CartesianGrid",
        )
    path = Path(checked_kind(file, (str, Path), "name of a map", "a path"))
    if path.suffix != ".zarr":
        raise InputError("unknown file ending", where=one_line(str(file)), expected=".zarr")
    if not path.absolute().parent.is_dir():
        raise InputError("map cannot be written", where=one_line(str(file)), got="no such folder")
    if path.exists() and not path.is_dir():
        raise InputError("is a file", where=one_line(str(file)), expected="a map, or nothing")
    if chunk is not None and chunk < 1:
        raise InputError("size of chunks cannot be used", expected="1 or more", got=chunk)
    job = map_job(elastic, sampling, quantities, **asked)
    settings, kind, chosen = job.settings, job.settings.load, job.quantities
    cartesian = sampling if isinstance(sampling, CartesianGrid) else None
    if cartesian and cartesian.redundancy == "best" and chosen[0].better is None:
        raise InputError(
            f"neither end of {chosen[0].name} is better",
            where="redundancy",
            expected="another first quantity, or the nearest posture",
        )
    options = {
        "joints": list(elastic.names),
        "sampling": sampling.as_dict(),
        "quantities": list(job.names),
        "connection": settings.connection,
        "length": settings.length,
        "direction": settings.direction,
        "deflect": settings.deflect,
        "deflect_at": settings.deflect_at,
        "world": settings.world,
        "load": job.wrench,
        "load_kind": kind.kind,
        "load_at": kind.at,
        "load_axes": job.load_axes,
        **_vibration(settings),
        "told": job.told if isinstance(job, CommandedJob) and job.told else None,
        "single": single,
        "states": list(STATES),
    }
    if elastic.identified is not None:
        options["identified"] = elastic.identified.as_dict()
    description = identity_of(elastic, options)
    if path.exists():
        existing = MapFile.at(path)
        there = json.loads(existing.attributes["description"])
        require_same(there, description, path, "map")
        return replace(job, path=there["path"], by_kernel=there.get("by_kernel", False)), existing
    postures = int(np.prod(sampling.shape, dtype=object))
    load: Literal["none", "shared", "each"]
    load = "none" if job.wrench is None else "shared" if job.load_axes == "body" else "each"
    path_taken: Backend = "engine"
    if not isinstance(job, CommandedJob):
        path_taken = lasting_path(elastic, load, job.outputs, postures)
    reads = path_taken == "compiled" and postures >= WORTH_READING
    job = replace(job, path=path_taken, by_kernel=reads)
    description |= {"path": job.path, "by_kernel": reads}
    units, mechanism = elastic.units, elastic.mechanism
    attributes = {
        "schema": SCHEMA,
        "title": f"stiffness map of {elastic.name}",
        "mechanism": elastic.name,
        "kind": mechanism.kind,
        "frame": mechanism.frame,
        # Row after row: attributes of netCDF have one dimension.
        "frame_offset": mechanism.frame_offset.ravel().tolist(),
        "base_pose": mechanism.base_pose.ravel().tolist(),
        "connection": settings.connection,
        "load_kind": kind.kind,
        "load_at": list(kind.at),
        "load_meaning": kind.words,
        "characteristic_length": settings.length,
        "length_unit": units.length,
        "force_unit": units.force,
        "angle_unit": "rad",
        "order": "angular-linear",
        "numerical_path": job.path,
        "command": command,
        **_about_command(job),
        **_versions(),
        "description": json.dumps(description),
    }
    variables: dict[str, dict[str, Any]] = {
        q.name: {"units": q.unit_in(units), "long_name": q.description}
        | ({} if q.better is None else {"better": q.better})
        for q in chosen
    }
    variables["state"] = {
        "long_name": "state of the mechanism",
        "flag_values": [*range(len(STATES)), NOT_COMPUTED],
        "flag_meanings": " ".join([*STATES, "not-computed"]),
    }
    variables["position"] = {
        "units": units.length,
        "long_name": "position of the body frame's origin in F",
    }
    if job.stores_q:
        variables["q"] = {"long_name": "coordinates of the posture"}
    if cartesian:
        variables["branches"] = {"long_name": "number of branches found at the place"}
    axis_units = {
        dimension_name(c.name): units.coordinate(c.is_length) for c in mechanism.coordinates
    } | dict.fromkeys(cartesian.axes if cartesian else (), units.length)
    if isinstance(sampling, CommandGrid):
        axis_units = {
            name: axis_units.get(name.removeprefix("command_"), units.length)
            for name in sampling.dims
        }
    return job, MapFile.create(
        path,
        sampling,
        variables,
        attributes,
        units=axis_units,
        coordinates=len(elastic.names),
        single=single,
        postures_per_chunk=chunk or job.usual_chunk,
    )


def _about_command(job: MapJob) -> dict[str, str]:
    """What is said of drives that are told the same everywhere."""
    if not isinstance(job, CommandedJob) or not job.told:
        return {}
    return {"told": ", ".join(f"{name} by {x:+g}" for name, x in job.told.items())}


def _vibration(settings: Settings) -> dict[str, Any]:
    """What the vibrations depend on, as plain data; None where nothing was said."""
    own, milling = settings.damping, settings.milling
    damping = None
    if own != Damping():
        ratios = np.ravel(np.asarray(own.ratios, float)).tolist()
        damping = [*ratios, own.mass, own.stiffness, float(own.dampers)]
    return {"damping": damping, "milling": None if milling is None else asdict(milling)}


def _positive(length: float) -> float:
    return characteristic_length(given=length).value


def _direction(direction: ArrayLike) -> tuple[float, ...]:
    checked_unit(direction)
    return tuple(checked_vector(direction, 3, "direction").tolist())


def _versions() -> dict[str, str]:
    versions = {"cartstiff_version": __version__, "python_version": platform.python_version()}
    for package in ("numpy", "pin", "zarr"):
        try:
            versions[f"{package}_version"] = version(package)
        except PackageNotFoundError:
            continue
    return versions


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


# Chunks that are handed out for each thread of the cluster before one of them comes back.
_AHEAD_OF_CLUSTER = 3
# Seconds after which workers are counted again: some may have come.
_LOOK = 10.0
_LOADING = Lock()


def run_on_cluster(
    job: MapJob,
    file: MapFile,
    todo: Sequence[int],
    advance: Callable[[int], None],
    scheduler: str,
) -> None:
    """Compute chunks on a running scheduler's workers.

    Parameters
    ----------
    job : MapJob
        What is computed.
    file : MapFile
        The workers must see its folder under the same path.
    todo : sequence of int
        Chunks.
    advance : callable
        Called with the number of postures of each finished chunk.
    scheduler : str
        Its address, such as "tls://10.0.0.5:8786". Certificates are those of Dask's configuration.

    Raises
    ------
    InputError
        If the scheduler does not answer, or a worker does not see the folder.
    CartstiffError
        If one chunk's workers die again and again.
    """
    path = file.path.resolve()
    elastic, known = packed(job.elastic), tuple(versions().items())
    rest = {f.name: getattr(job, f.name) for f in fields(job) if f.name != "elastic"}
    with _client(scheduler) as client, client.as_current():
        distributed = _distributed()
        _require_folder(client, path)
        run, waiting = uuid.uuid4().hex, iter(todo)

        def submit(chunk: int) -> Any:
            # A trajectory's postures go to the workers chunk by chunk.
            part, box = job.sampling.part(file.boxes[chunk])
            return client.submit(
                _compute_chunk,
                type(job),
                elastic,
                known,
                {**rest, "sampling": part},
                str(path),
                chunk,
                box,
                key=f"cartstiff-map-{run}-{chunk}",
                pure=False,
            )

        wanted, looked = _wanted(client), time.monotonic()
        finished = distributed.as_completed([submit(c) for c in islice(waiting, wanted)])
        for future in finished:
            try:
                chunk = future.result()
            except (AttributeError, ImportError) as error:
                raise InputError(
                    "a worker has another version of cartstiff",
                    expected=dict(known)["cartstiff"],
                    got=one_line(str(error), 100),
                ) from None
            except distributed.KilledWorker as error:
                raise CartstiffError(
                    "the workers that computed a chunk died one after the other: "
                    + one_line(str(error), 200)
                ) from None
            advance(file.count(chunk))
            future.release()
            if time.monotonic() - looked > _LOOK:
                wanted, looked = _wanted(client), time.monotonic()
            for following in islice(waiting, max(0, wanted - finished.count())):
                finished.add(submit(following))


def _wanted(client: Any) -> int:
    """How many chunks are to be in the workers' hands."""
    return _AHEAD_OF_CLUSTER * max(1, sum(client.nthreads().values()))


@lru_cache(maxsize=4)
def _elastic_from(data: bytes, versions: tuple[tuple[str, str], ...]) -> ElasticMechanism:
    """The mechanism, once for each worker: what was compiled for it stays with it."""
    require_versions(dict(versions))  # another Pinocchio does not read it, or not as it was
    elastic = pickle.loads(data)
    if not isinstance(elastic, ElasticMechanism):
        raise TypeError("not a mechanism")
    return elastic


@lru_cache(maxsize=4)
def _file(path: str) -> MapFile:
    """The map, checked once for each worker."""
    return MapFile.at(path)


def _compute_chunk(
    kind: type[MapJob],
    elastic: bytes,
    versions: tuple[tuple[str, str], ...],
    rest: dict[str, Any],
    path: str,
    chunk: int,
    box: tuple[slice, ...],
) -> int:
    """On a worker: compute a chunk and write it; returns its number."""
    file = _file(path)
    if file.is_done(chunk):  # by a worker that died before it could say so
        return chunk
    with _LOADING:
        mechanism = _elastic_from(elastic, versions)
    arrays = kind(elastic=mechanism, **rest).compute(box)
    file.write(chunk, arrays)
    return chunk


def _distributed() -> Any:
    return imported("distributed", "distributed", "computing a map with several processes", "maps")


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    """A client of a running scheduler."""
    try:
        client = _distributed().Client(scheduler, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            "no scheduler answers",
            where=one_line(scheduler),
            expected="the address of a running Dask scheduler, such as tls://10.0.0.5:8786",
            got=type(error).__name__,
        ) from None
    with client:
        if not client.nthreads():
            raise InputError(
                "the scheduler has no workers", where=one_line(scheduler), expected="at least one"
            )
        yield client


def _require_folder(client: Any, path: Path) -> None:
    """Refuse workers that would write somewhere else."""
    answers = client.run(_sees, str(path))
    blind = [str(worker) for worker, sees in answers.items() if not sees]
    if blind:
        raise InputError(
            "a worker does not see the map's folder",
            where=one_line(str(path)),
            expected="a folder that all machines share, under the same path",
            got=", ".join(blind),
        )


def _sees(path: str) -> bool:
    return (Path(path) / "zarr.json").is_file()


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
    has written, for `cartstiff.maps.reading.summary_of_file`.
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
                run_on_cluster(job, file, todo, advance, scheduler)
            elif todo and workers:
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
