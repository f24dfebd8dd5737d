"""Chunks of a map on the workers of a Dask scheduler.

A chunk's result does not depend on who computes it or how often. Each worker writes its chunks
itself; a worker that dies costs the chunks that it had in hand.
"""

from __future__ import annotations

import pickle
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from functools import lru_cache
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any

from cartstiff.errors import CartstiffError, InputError, imported, one_line
from cartstiff.maps.job import MapJob
from cartstiff.maps.processes import packed
from cartstiff.maps.store import MapFile
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.identity import require_versions, versions

# Chunks that are handed out for each thread of the cluster before one of them comes back.
_AHEAD = 3
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
    return _AHEAD * max(1, sum(client.nthreads().values()))


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
