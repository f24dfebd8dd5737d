"""Computation of a map, new or resumed, by threads or by the workers of a Dask scheduler.

All arguments are checked and the file is created or recognised before anything is
computed. The result of a part does not depend on the worker that computes it. Each worker
writes its own parts, so that a worker that dies loses only the parts it was computing.
"""

from __future__ import annotations

import ctypes
import json
import pickle
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import cache, lru_cache, partial
from hashlib import sha256
from math import prod
from os import cpu_count
from threading import Lock
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.vibration.response import Damping
from cartstiff.core import numerics
from cartstiff.core.arrays import checked_input
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import (
    CartstiffError,
    InputError,
    checked_kind,
    imported,
    one_line,
)
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.stiffness.applied_load import Axes, Behaviour, checked_load
from cartstiff.files.identity import (
    fingerprint,
    identity_of,
    require_same,
    require_versions,
    versions,
)
from cartstiff.recorded.kernels import lasting_path
from cartstiff.recorded.postures import described
from cartstiff.recorded.quantities import (
    Settings,
    check_masses,
    check_used,
    choose_quantities,
    is_own,
)
from cartstiff.wings.maps.cartesian import CartesianGrid
from cartstiff.wings.maps.job import STATES, MapJob, Mapped
from cartstiff.wings.maps.sampling import (
    MAX_CHUNK,
    Grid,
    Sampling,
    chunk_shape,
    dimension_name,
)
from cartstiff.wings.maps.store import (
    CHECKSUM,
    INNER,
    NOT_COMPUTED,
    SCHEMA,
    Kind,
    Layout,
    MapFile,
    empty_dataset,
    is_there,
    local_path,
    open_map,
    reached,
    with_postures,
    zarr_library,
)

if TYPE_CHECKING:
    import xarray

#: Packages by name, and their versions.
Versions = tuple[tuple[str, str], ...]


_SEVERAL = "computing a map with several processes"
# Settings that the description of a map holds unchanged.
_DESCRIBED_SETTINGS = (
    "connection",
    "length",
    "direction",
    "deflect",
    "deflect_at",
    "world",
)


class MapQuestion(TypedDict, total=False):
    """What is asked at every posture, beside quantities: the keywords of `map_job`."""

    connection: str | None
    length: float | None
    direction: ArrayLike | None
    deflect: ArrayLike | None
    deflect_at: ArrayLike
    world: bool
    wrench: ArrayLike | None
    load_kind: Behaviour
    load_at: ArrayLike
    load_axes: Axes
    damping: Damping | float


class MapOptions(MapQuestion, total=False):
    """Keywords of whole maps; for `chunk` and `command` see `planned`."""

    chunk: int | None
    command: str


@checked
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
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
    damping: Damping | float = 0.0,
) -> MapJob:
    """Check the arguments of a map and return its computation, without any file.

    Parameters
    ----------
    elastic : ElasticMechanism
        From `cartstiff.load`.
    sampling : Sampling
        `Grid`, `RandomPostures`, `Trajectory` or `CartesianGrid`.
    quantities : str or sequence of str
        Names in `cartstiff.recorded.quantities.QUANTITIES`.
    connection : {"load", "B", "A", "K", "F"}, optional
        Matrix that is read. Default under a load: load, the tangent stiffness under it,
        as in the analysis of one posture; without a load all but F are the same.
    length : float, optional
        Characteristic length, which makes angles comparable with lengths, for all
        postures; default the natural length at the default posture.
    direction : array_like (3,), optional
        Direction for stiffness along and about it, in the body's axes.
    deflect : array_like (6,), optional
        Wrench added to the load, whose linear deflection is computed: moment and force,
        in the body's axes; default the load itself.
    deflect_at : array_like (3,)
        Point of the body, in M, at which that wrench acts; the deflection is that of M's
        origin.
    world : bool
        Whether direction and added wrench are in the axes of F, not of the body.
    wrench, load_kind, load_at, load_axes
        Load at every posture: wrench, behaviour while the body moves, point and axes, as
        in `cartstiff.analyse`.
    damping : Damping or float
        Damping besides the mechanism's dampers, for ``damping_1`` ...

    Raises
    ------
    InputError
        For arguments that cannot be used.
    """
    checked_elastic(elastic)
    if not isinstance(sampling, Sampling):
        raise InputError(
            "not a choice of postures",
            where="sampling",
            got=type(sampling).__name__,
            expected="a Grid, RandomPostures, Trajectory or CartesianGrid",
        )
    _check_postures(sampling, elastic)
    # Load and settings.
    load = None if wrench is None else checked_input(wrench, (6,), "wrench")
    kind = checked_load(
        load_kind, load_at, load_axes, load is not None, elastic.may_be_loaded
    )
    settings = Settings.of(
        elastic,
        kind,
        load,
        load_axes,
        connection=connection,
        length=length,
        direction=direction,
        deflect=deflect,
        deflect_at=deflect_at,
        world=world,
        damping=damping if isinstance(damping, Damping) else Damping(damping),
    )
    # Quantities, which have to use the settings.
    names = [quantities] if isinstance(quantities, str) else list(quantities)
    chosen = choose_quantities(names, settings, elastic)
    check_used(settings, chosen)
    check_masses(chosen, elastic)
    row = None if load is None else tuple(load.tolist())
    is_best = isinstance(sampling, CartesianGrid) and sampling.redundancy == "best"
    if is_best and chosen[0].better is None:
        raise InputError(
            f"neither end of {chosen[0].name} is better",
            where="redundancy",
            expected="another first quantity, or the nearest posture",
        )
    return MapJob(
        elastic,
        sampling,
        tuple(q.name for q in chosen),
        settings,
        row,
        load_axes=load_axes,
        own=tuple(q for q in chosen if is_own(q.name)),
    )


def planned(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
    *,
    chunk: int | None = None,
    command: str = "",
    **asked: Unpack[MapQuestion],
) -> tuple[MapJob, Layout]:
    """Check and describe a map; nothing is computed.

    Parameters
    ----------
    elastic, sampling, quantities, **asked
        As in `map_job`.
    chunk : int, optional
        Largest number of postures in a part.
    command : str
        Command line that the file keeps.

    Returns
    -------
    MapJob
        Computation of each part.
    Layout
        Arrays and attributes of the map; the attribute "description" holds its identity.
    """
    if chunk is not None and (not 1 <= chunk <= MAX_CHUNK or chunk % 1):
        raise InputError(
            "size of chunks cannot be used", expected=f"1 to {MAX_CHUNK}", got=chunk
        )
    job = map_job(elastic, sampling, quantities, **asked)
    settings, kind, chosen = job.settings, job.settings.load, job.quantities
    row = job.wrench
    path = lasting_path(elastic, row is not None, sampling.size)
    job = replace(job, path=path)
    # The identity of the map: what its numbers depend on.
    options = {
        "joints": list(elastic.names),
        "sampling": sampling.to_dict(),
        "quantities": list(job.names),
        **{name: getattr(settings, name) for name in _DESCRIBED_SETTINGS},
        "load": row,
        "load_kind": kind.kind,
        "load_at": kind.at,
        "load_axes": job.load_axes,
        **_vibration(settings),
        "states": list(STATES),
        "own quantities": fingerprint(job.own) if job.own else None,
    }
    if elastic.identified is not None:
        options["identified"] = elastic.identified.to_dict()
    description = identity_of(elastic, options) | {"path": job.path}
    units = elastic.units
    # Attributes of the file.
    attributes = {
        "schema": SCHEMA,
        "title": f"stiffness map of {elastic.name}",
        **described(elastic, kind, job.load_axes),
        "connection": settings.connection,
        "characteristic_length": settings.length,
        "numerical_path": job.path,
        "command": command,
        "python_version": platform.python_version(),
        "zarr_version": zarr_library().__version__,
        **{f"{package}_version": number for package, number in versions().items()},
        "Conventions": "CF-1.11",
        "identity": sha256(json.dumps(description).encode()).hexdigest(),
        "description": json.dumps(description),
    }
    if isinstance(sampling, Grid):
        for i, name in enumerate(elastic.names):
            if i not in sampling.columns:
                attributes[f"fixed_{dimension_name(name)}"] = float(sampling.base[i])
    # Its arrays and axes.
    dims = sampling.dims
    arrays = {q.name: Kind(dims, dict(q.words(units))) for q in chosen}
    state = {
        "long_name": "state of the mechanism",
        "flag_values": [*range(len(STATES)), NOT_COMPUTED],
        "flag_meanings": " ".join([*STATES, "not-computed"]),
    }
    place = {
        "units": units.length,
        "long_name": "position of the body frame's origin in F",
    }
    arrays["position"] = Kind((*dims, "xyz"), place)
    if job.stores_q:
        about = {
            "long_name": "coordinates of the posture",
            "joints": " ".join(elastic.names),
        }
        arrays["q"] = Kind((*dims, "joint"), about)
    if job.times is not None:
        arrays["time"] = Kind(dims, {"units": "s"})
        attributes["coordinates"] = "time"
    if cartesian := isinstance(sampling, CartesianGrid):
        found = {"long_name": "number of branches found at the place"}
        arrays["branches"] = Kind(dims[:-1], found, "u4", 0)
    arrays["state"] = Kind(dims, state, "u1", NOT_COMPUTED)
    own = [units.coordinate(c.is_length) for c in elastic.mechanism.coordinates]
    joints = dict(zip(map(dimension_name, elastic.names), own, strict=True))
    axes = {}
    for name in sampling.axes:
        unit = None if cartesian else joints.get(name)
        axes[name] = Kind((name,), {"units": unit or units.length})
    sizes = {"xyz": 3, "joint": len(elastic.names)}
    shape = chunk_shape(sampling, chunk or job.usual_chunk)
    return job, Layout(sampling, arrays, axes, sizes, shape, attributes)


def _check_postures(sampling: Sampling, elastic: ElasticMechanism) -> None:
    """Refuse postures of another mechanism."""
    own = vars(sampling)
    row = next((own[name] for name in ("base", "lower", "q") if name in own), elastic.q)
    names = own.get("names", elastic.names)
    if names != elastic.names or np.shape(row)[-1] != len(names):
        got = f"{np.shape(row)[-1]} coordinates"
        raise InputError(
            "postures are of another mechanism",
            where="sampling",
            expected=", ".join(elastic.names),
            got=got if names == elastic.names else ", ".join(names),
        )


@checked
def map_of(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
    **asked: Unpack[MapOptions],
) -> xarray.Dataset:
    """Quantities of the stiffness at many postures, as a dataset that is
    computed when used.

    Parameters
    ----------
    elastic, sampling, quantities, **asked
        As in `cartstiff.wings.maps.run.map_job`; also `chunk` and `command` of `planned`.

    Returns
    -------
    xarray.Dataset
        As `open_map` reads it from the store that `compute_map` writes; its arrays are
        Dask's. ``.compute()``, ``.to_zarr(...)``, ``.sel(...)`` and ``.plot()`` are
        xarray's own.
    """
    job, layout = planned(elastic, sampling, quantities, **asked)
    import dask.array
    import xarray

    empty, dims = empty_dataset(layout), sampling.dims
    ranges: Any = dask.array.arange  # not typed
    cells = {
        f"cell_{dim}": (dim, ranges(n, chunks=chunk))
        for dim, n, chunk in zip(dims, sampling.shape, layout.chunk, strict=True)
    }

    def computed(block: xarray.Dataset) -> xarray.Dataset:
        at = [block[name].values.tolist() for name in cells]
        arrays = job.compute(tuple(slice(cell[0], cell[-1] + 1) for cell in at))
        variables = {
            name: (kind.dims, arrays[name].astype(kind.dtype, copy=False))
            for name, kind in layout.arrays.items()
        }
        return xarray.Dataset(variables, block.coords).set_coords(set(empty.coords))

    blocks = xarray.Dataset(cells, {name: empty[name] for name in layout.axes})
    return with_postures(xarray.map_blocks(computed, blocks, template=empty))


def _vibration(settings: Settings) -> dict[str, Any]:
    """Damping as plain data; None if not given."""
    own = settings.damping
    if own == Damping():
        return {"damping": None}
    ratios = np.ravel(np.asarray(own.ratios, float)).tolist()
    return {"damping": [*ratios, own.mass, own.stiffness, float(own.dampers)]}


def prepare_map(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
    file: Any,
    **asked: Unpack[MapOptions],
) -> tuple[MapJob, MapFile]:
    """Check everything and create the file, or open one that holds the same map.

    Arguments as in `compute_map`.
    """
    where = one_line(str(file))
    if (path := local_path(file)) is not None:
        if path.suffix != ".zarr":
            raise InputError("unknown file ending", where=where, expected=".zarr")
        if not path.absolute().parent.is_dir():
            raise InputError("map cannot be written", where=where, got="no such folder")
        if path.exists() and not path.is_dir():
            raise InputError("is a file", where=where, expected="a map, or nothing")
    job, layout = planned(elastic, sampling, quantities, **asked)
    if not is_there(file):
        MapFile.create(file, layout)
    existing = MapFile.at(file)
    there = json.loads(existing.attributes["description"])
    here = json.loads(layout.attributes["description"])
    # A resumed map keeps its backend, so that its numbers do not depend on the
    # interruption.
    path = there.get("path")
    require_same(there, here | {"path": path}, file)
    if asked.get("chunk") and layout.chunk != existing.parts.chunk:
        raise InputError(
            "the file holds parts of another size",
            where=where,
            expected=f"no number of postures in a part, or {prod(existing.parts.chunk)}",
            got=asked["chunk"],
        )
    existing.complete(replace(layout, chunk=existing.parts.chunk))
    return replace(job, path=path), existing


def part_of(job: MapJob, file: MapFile, number: int, mapped: Mapped = map) -> int:
    """Compute and write a part unless it is complete; return its number."""
    if not file.is_done(number):
        _return_large_arrays()
        arrays = job.compute(file.parts.box(number), mapped)
        # Large parts are written one at a time: compression holds a second copy in
        # memory.
        one = _WRITING_LOCK if file.count(number) > INNER else nullcontext()
        go_on = "the same command to go on from the parts that are there"
        with one, reached(file.address, "map cannot be written", go_on):
            file.write(number, arrays)
    return number


@cache
def _return_large_arrays() -> None:
    """Let the C library return large arrays to the system.

    It would keep them in every thread.
    """
    if (
        set_option := getattr(ctypes.CDLL(None), "mallopt", None)
    ) is not None:  # of glibc
        set_option(_MMAP_THRESHOLD, _LARGE_BYTES)
        set_option(_ARENA_MAX, _HEAPS)


# Options of glibc: the size of arrays in bytes from which on each has memory of its own,
# and the number of heaps, which all threads share, for smaller ones.
_MMAP_THRESHOLD, _LARGE_BYTES = -3, 2**19
_ARENA_MAX, _HEAPS = -8, 4
_LOADING_LOCK, _WRITING_LOCK = Lock(), Lock()


def part_elsewhere(
    data: bytes, known: Versions, path: str, identity: str, number: int
) -> int:
    """Run `part_of` on a worker, with data from `packed`."""
    with _LOADING_LOCK:
        job, file = _received(data, known, path, identity)
    return part_of(job, file, number)


@lru_cache(maxsize=4)
def _received(
    data: bytes, known: Versions, path: str, identity: str
) -> tuple[MapJob, MapFile]:
    """Unpack a job once in each worker, so that code compiled for the
    mechanism is reused.
    """
    require_versions(
        dict(known)
    )  # another version of Pinocchio may unpickle other numbers
    job = pickle.loads(data)
    if not isinstance(job, MapJob):
        raise TypeError("not a map")
    file = MapFile.at(path) if is_there(path) else None
    if file is None or file.attributes[CHECKSUM] != identity:
        raise InputError(
            "a worker does not see the map's folder",
            where=one_line(path),
            expected="a folder that all machines share, under the same path",
            got=platform.node(),
        )
    return job, file


def packed(thing: Any) -> bytes:
    """Pickle an object for the workers.

    Raises
    ------
    InputError
        If it cannot be pickled, for example because of a lock or an open file.
    """
    # Of Dask: sends functions of a script or a notebook, too.
    cloudpickle = imported("cloudpickle", "cloudpickle", _SEVERAL, "maps")
    try:
        return bytes(cloudpickle.dumps(thing))
    except Exception as error:  # pickle raises what the objects in it raise
        raise InputError(
            "mechanism cannot be sent to other processes",
            got=str(error),
            expected="functions without such objects in its potentials, or threads",
        ) from None


@contextmanager
def _client(scheduler: Any) -> Iterator[Any]:
    """Yield a client of a running scheduler, or the given client."""
    distributed = imported("distributed", "distributed", _SEVERAL, "maps")
    with ExitStack() as ours:
        client, where = scheduler, one_line(str(scheduler))
        if isinstance(scheduler, str):
            try:
                client = ours.enter_context(
                    distributed.Client(scheduler, set_as_default=False)
                )
            except (OSError, ValueError, TypeError) as error:
                raise InputError(
                    "no scheduler answers",
                    where=where,
                    expected="the address of a running Dask scheduler, such as "
                    "tls://10.0.0.5:8786",
                    got=type(error).__name__,
                ) from None
        checked_kind(
            client, distributed.Client, "scheduler", "an address, or a client of Dask"
        )
        if not client.nthreads():
            raise InputError(
                "the scheduler has no workers", where=where, expected="at least one"
            )
        try:
            client.run(require_versions, versions())
            yield client
        except (AttributeError, ImportError) as error:
            raise InputError(
                "a worker has another version of cartstiff",
                expected=versions()["cartstiff"],
                got=one_line(str(error), 100),
            ) from None
        except distributed.KilledWorker as error:
            raise CartstiffError(
                "the workers that computed a part died one after the other: "
                + one_line(str(error), 200)
            ) from None


@contextmanager
def _workers(
    job: MapJob, file: MapFile, scheduler: Any
) -> Iterator[Callable[[int], Future[int]]]:
    """Yield a function that submits a part to threads,
    or to the workers of a scheduler.
    """
    if scheduler is None:
        # Few large parts are in memory at once; all threads compute their pieces.
        threads = (cpu_count() or 1) if job.in_stacks else 1
        parts = max(1, min(threads, MAX_CHUNK // file.count(0)))
        with (
            numerics.one_thread(),
            ThreadPoolExecutor(threads) as threads_of_pieces,
            ThreadPoolExecutor(parts) as pool,
        ):
            mapped = threads_of_pieces.map
            yield lambda number: pool.submit(part_of, job, file, number, mapped)
        return
    data = packed(replace(job))  # a copy without cached results
    known, folder = tuple(versions().items()), local_path(file.address)
    path = file.address if folder is None else str(folder.resolve())
    with _client(scheduler) as client, client.as_current():
        there = client.submit(
            bytes, data, pure=False
        )  # sent once, and again if it is lost
        pool = client.get_executor(pure=False)
        yield partial(
            pool.submit, part_elsewhere, there, known, path, file.attributes[CHECKSUM]
        )


@checked
def compute_map(
    elastic: ElasticMechanism,
    sampling: Sampling,
    quantities: Sequence[str],
    file: Any,
    *,
    dask: Any = None,
    progress: bool | None = False,
    **asked: Unpack[MapOptions],
) -> xarray.Dataset:
    """Quantities of the stiffness at many postures, in a file or another store.

    If the file holds the same map already, its missing parts are computed.

    Parameters
    ----------
    elastic, sampling, quantities, **asked
        As in `cartstiff.wings.maps.run.map_job`; also `chunk` and `command` of `planned`.
    file : path, address or store
        A folder that ends in ``.zarr``, an address that fsspec knows (``memory://``,
        ``s3://``), or a store of Zarr.
    dask : str or distributed.Client, optional
        Address or client of a running Dask scheduler, whose workers compute instead. They
        must see the file under the same path.
    progress : bool or None
        Bar on standard error; None shows it on a terminal only.

    Returns
    -------
    xarray.Dataset
        As `open_map`.

    Raises
    ------
    InputError
        If the file holds another map (the message names what differs), or for bad input.
    KeyboardInterrupt
        After Ctrl-C; the file is valid, and the same call resumes it.
    """
    job, there = prepare_map(elastic, sampling, quantities, file, **asked)
    run_map(job, there, dask=dask, progress=progress)
    return open_map(file)


def run_map(
    job: MapJob, file: MapFile, *, dask: Any = None, progress: bool | None = False
) -> int:
    """Compute the parts that are missing.

    Return their number. Arguments as in `compute_map`.
    """
    with file.locked(), _bar(job.sampling.size, progress) as advance:
        done = file.done()
        file.forget(set(file.marks()).difference(done))
        advance(sum(map(file.count, done)))
        missing = sorted(set(range(len(file.parts))).difference(done))
        if missing:
            with _workers(job, file, dask) as submit:
                futures = [submit(part) for part in missing]
                try:
                    for future in as_completed(futures):
                        advance(file.count(future.result()))
                except BaseException:
                    for future in futures:
                        future.cancel()
                    raise
    return len(missing)


@contextmanager
def _bar(total: int, progress: bool | None) -> Iterator[Callable[[int], Any]]:
    """Yield the `update` of a bar that counts postures,
    or a function that does nothing.
    """
    if progress is False or (progress is None and not sys.stderr.isatty()):
        yield lambda _: None
        return
    tqdm = imported("tqdm", package="tqdm", purpose="a progress bar", extra="maps").tqdm
    with tqdm(total=total, unit=" postures", unit_scale=True, file=sys.stderr) as bar:
        yield bar.update
