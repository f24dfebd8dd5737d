"""Maps in files: Zarr folders of labelled arrays that say what they are.

A map is cut into chunks. A chunk's arrays are written one file each, whole or not at all, and last
a mark that it is done. Whoever computes the map later begins where marks are missing.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.errors import InputError, MissingDependencyError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.maps.sampling import Sampling, from_dict

if TYPE_CHECKING:
    import xarray

__all__ = ["SCHEMA", "MapFile", "chunk_shape", "open_map"]

SCHEMA = "cartstiff-map/1"

#: Value of ``state`` where nothing has been computed yet.
NOT_COMPUTED = 255
# Smallest and largest number of postures in a chunk, and how many chunks are aimed at.
_LEAST, _MOST, _CHUNKS = 64, 2**18, 128
_RESERVED = ("state", "position", "q", "done", "branches", "xyz", "joint", "chunk")


def _zarr() -> Any:
    try:
        import zarr
    except ImportError:
        raise MissingDependencyError(
            package="zarr", purpose="keeping a map in a file", extra="maps"
        ) from None
    return zarr


def chunk_shape(sampling: Sampling, postures: int | None = None) -> tuple[int, ...]:
    """Shape of a chunk: near a cube, so that a slice in any direction touches few of them.

    Parameters
    ----------
    sampling : Sampling
        Its shape is cut.
    postures : int, optional
        Most postures of a chunk; default from 64 for small maps to 262144 for large ones.
    """
    if postures is None:
        postures = min(max(sampling.size // _CHUNKS, _LEAST), _MOST)
    shape = list(sampling.shape)
    if len(shape) == 1:
        return (min(shape[0], postures),)
    may_split = [i for i, name in enumerate(sampling.dims) if name not in sampling.whole]
    while int(np.prod(shape, dtype=object)) > postures:
        i = max(may_split, key=lambda i: shape[i])
        if shape[i] == 1:
            break
        shape[i] = ceil(shape[i] / 2)
    return tuple(shape)


@dataclass(frozen=True)
class MapFile:
    """A map's folder.

    Attributes
    ----------
    path : Path
        The folder.
    shape, chunk : tuple of int
        Of the map and of a chunk.
    """

    path: Path
    shape: tuple[int, ...]
    chunk: tuple[int, ...]

    @classmethod
    def at(cls, path: str | Path) -> MapFile:
        """An existing map.

        Raises
        ------
        InputError
            If there is no map.
        """
        place = Path(path)
        zarr, where = _zarr(), one_line(str(path))
        if not (place / "zarr.json").is_file():
            raise InputError("is no map", where=where, expected="a folder made by 'cartstiff map'")
        try:
            group = zarr.open_group(place, mode="r")
            schema, state = group.attrs.get("schema"), group["state"]
        except (KeyError, ValueError, OSError, zarr.errors.BaseZarrError) as error:
            raise InputError("is no map that can be read", where=where, got=str(error)) from None
        if schema != SCHEMA:
            raise InputError("is no map", where=where, expected=f"schema {SCHEMA}",
                             got=str(schema))  # fmt: skip
        return cls(place, tuple(state.shape), tuple(state.chunks))

    @classmethod
    def create(
        cls,
        path: str | Path,
        sampling: Sampling,
        variables: Mapping[str, Mapping[str, Any]],
        attributes: Mapping[str, Any],
        *,
        state: Mapping[str, Any],
        units: Mapping[str, str],
        q: tuple[int, bool],
        single: bool = False,
        postures_per_chunk: int | None = None,
    ) -> MapFile:
        """A new map with nothing computed; it appears whole or not at all.

        Parameters
        ----------
        path : path
            Must not exist.
        sampling : Sampling
            Dimensions and axes.
        variables : mapping of str to mapping
            Attributes of each quantity.
        attributes : mapping
            Of the whole; values that JSON can hold.
        state : mapping
            Attributes of ``state``.
        units : mapping of str to str
            Of every dimension with an axis, and "position".
        q : (int, bool)
            Number of coordinates of a posture, and whether they are kept in the file.
        single : bool
            Keep numbers in single precision.
        postures_per_chunk : int, optional
            See `chunk_shape`.
        """
        zarr, place = _zarr(), Path(path)
        for name in sampling.dims:
            if name in _RESERVED or name in variables:
                raise InputError("a dimension has the name of something else in the map", got=name)
        chunk = chunk_shape(sampling, postures_per_chunk)
        new = place.with_name(f".{place.name}.{os.getpid()}.new")
        shape, dims = sampling.shape, sampling.dims
        kind = np.float32 if single else np.float64
        try:
            shutil.rmtree(new, ignore_errors=True)
            new.mkdir()
            group = zarr.create_group(new, attributes=dict(attributes), zarr_format=3)

            def array(name: str, tail: tuple[int, ...], names: tuple[str, ...], dtype: Any,
                      fill: float, **more: Any) -> None:  # fmt: skip
                group.create_array(
                    name, shape=(*shape, *tail), chunks=(*chunk, *tail), dtype=dtype,
                    fill_value=fill, dimension_names=(*dims, *names), attributes=more,
                )  # fmt: skip

            for name, more in variables.items():
                array(name, (), (), kind, np.nan, **more)
            array("state", (), (), np.uint8, NOT_COMPUTED, **state)
            array("position", (3,), ("xyz",), kind, np.nan, units=units["position"],
                  long_name="position of the body frame's origin in F")  # fmt: skip
            if q[1]:
                array("q", (q[0],), ("joint",), np.float64, np.nan,
                      long_name="coordinates of the posture")  # fmt: skip
            if "branch" in dims:
                group.create_array(
                    "branches", shape=shape[:-1], chunks=chunk[:-1], dtype=np.uint16,
                    fill_value=0, dimension_names=dims[:-1],
                    attributes={"long_name": "number of branches found at the place"},
                )  # fmt: skip
            for name, axis in sampling.axes.items():
                cls._whole(group, name, axis.values, (name,), units=units[name])
            if (time := getattr(sampling, "time", None)) is not None:
                cls._whole(group, "time", time, ("posture",), units="s")
            if sampling.stores_q and "branch" not in dims:
                box = tuple(slice(0, n) for n in shape)
                group["q"][:] = sampling.postures(box, None)
            count = int(np.prod([ceil(n / c) for n, c in zip(shape, chunk, strict=True)]))
            group.create_array(
                "done", shape=(count,), chunks=(1,), dtype=np.uint8, fill_value=0,
                dimension_names=("chunk",), attributes={"long_name": "whether a chunk is done"},
            )  # fmt: skip
            new.rename(place)
        except OSError as error:
            shutil.rmtree(new, ignore_errors=True)
            raise InputError(
                "map cannot be written", where=one_line(str(path)), got=error.strerror
            ) from None
        except BaseException:
            shutil.rmtree(new, ignore_errors=True)
            raise
        return cls(place, tuple(shape), chunk)

    @staticmethod
    def _whole(group: Any, name: str, values: Array, dims: tuple[str, ...], **more: Any) -> None:
        array = group.create_array(
            name, shape=values.shape, chunks=values.shape, dtype=values.dtype,
            dimension_names=dims, attributes=more,
        )  # fmt: skip
        array[:] = values

    @cached_property
    def boxes(self) -> list[tuple[slice, ...]]:
        """The part of the map that each chunk holds."""
        cuts = [
            [slice(i, min(i + c, n)) for i in range(0, n, c)]
            for n, c in zip(self.shape, self.chunk, strict=True)
        ]
        return list(product(*cuts))

    def count(self, chunk: int) -> int:
        """Postures in a chunk."""
        return int(np.prod([s.stop - s.start for s in self.boxes[chunk]]))

    def done(self) -> set[int]:
        """Chunks that are complete."""
        folder = self.path / "done" / "c"
        try:
            return {int(p.name) for p in folder.iterdir() if p.name.isdigit()}
        except FileNotFoundError:
            return set()

    def is_done(self, chunk: int) -> bool:
        """Whether a chunk is complete."""
        return (self.path / "done" / "c" / str(chunk)).is_file()

    def missing(self) -> list[int]:
        """Chunks that are not, in order."""
        done = self.done()
        return [i for i in range(len(self.boxes)) if i not in done]

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the whole map."""
        return dict(self._group.attrs)

    @cached_property
    def _group(self) -> Any:
        return _zarr().open_group(self.path, mode="r+")

    def write(self, chunk: int, arrays: Mapping[str, Array]) -> None:
        """Put the arrays of a chunk in the file and mark it as done."""
        box = self.boxes[chunk]
        for name, values in arrays.items():
            self._group[name][box[: values.ndim] if values.ndim < len(box) else box] = values
        self._group["done"][chunk] = 1

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While this holds, no other process on this machine computes the same map.

        Raises
        ------
        InputError
            If one does.
        """
        import fcntl

        handle = os.open(self.path, os.O_RDONLY)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(
                    "another process is computing this map", where=one_line(str(self.path))
                ) from None
            except OSError:  # file systems without locks
                pass
            yield
        finally:
            os.close(handle)

    def remove_leftovers(self) -> None:
        """Delete what a killed process had begun to write."""
        for path in self.path.rglob("*.partial"):
            path.unlink(missing_ok=True)


class _Postures:
    """The coordinates of a sampling as an array that is computed when it is read."""

    def __init__(self, sampling: Sampling, n: int) -> None:
        self.sampling = sampling
        self.shape = (*sampling.shape, n)
        self.dtype = np.dtype(float)
        self.ndim = len(self.shape)

    def __getitem__(self, key: tuple[slice | int, ...]) -> Array:
        box: list[slice] = []
        inner: list[slice | int] = []
        for k, n in zip(key[:-1], self.sampling.shape, strict=True):
            if isinstance(k, slice):
                start, stop, step = k.indices(n)
                box.append(slice(start, stop))
                inner.append(slice(None, None, step))
            else:
                box.append(slice(int(k), int(k) + 1))
                inner.append(0)
        q = self.sampling.postures(tuple(box), None)
        return q.reshape(*(s.stop - s.start for s in box), -1)[(*inner, key[-1])]


def open_map(path: str | Path) -> xarray.Dataset:
    """A map as labelled arrays, read when they are used.

    Parameters
    ----------
    path : path
        Written by `compute_map`, complete or not.

    Returns
    -------
    xarray.Dataset
        Variables: every quantity over the map's dimensions; ``state`` (0 is regular; the attribute
        ``flag_meanings`` names the others, 255 is not computed); ``position`` (..., xyz) of the
        body frame's origin in F; ``q`` (..., joint). Attributes: mechanism, frame, units, versions,
        the command; ``chunks_done`` of ``chunks``. Arrays are split as the file is, so that
        reductions of a large map need little memory.

    Raises
    ------
    InputError
        If there is no map.
    MissingDependencyError
        Without xarray, zarr or dask.
    """
    file = MapFile.at(path)
    try:
        import dask.array
        import xarray
    except ImportError as error:
        raise MissingDependencyError(
            package=error.name or "xarray", purpose="reading a map", extra="maps"
        ) from None
    dataset = xarray.open_zarr(file.path, consolidated=False, chunks={})
    description = json.loads(dataset.attrs["description"])
    joints = description["joints"]
    if "q" not in dataset:
        sampling = from_dict(description["sampling"])
        if sampling is None:
            raise InputError("the map does not say where it looked", where=one_line(str(path)))
        lazy = _Postures(sampling, len(joints))
        chunks = (*file.chunk, len(joints))
        dataset["q"] = (
            (*sampling.dims, "joint"),
            dask.array.from_array(lazy, chunks=chunks, asarray=False, meta=np.empty(0)),  # type: ignore[no-untyped-call]
            {"long_name": "coordinates of the posture"},
        )
    names = [*description["quantities"], "state", "position", "q", "branches"]
    more = dataset[["time"]].variables if "time" in dataset else {}
    dataset = dataset[[name for name in names if name in dataset]].assign_coords(more)
    dataset = dataset.assign_coords(joint=joints, xyz=["x", "y", "z"])
    dataset.attrs["chunks_done"], dataset.attrs["chunks"] = len(file.done()), len(file.boxes)
    return dataset
