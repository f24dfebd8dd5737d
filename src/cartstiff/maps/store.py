"""Maps in files: Zarr folders of labelled arrays that say what they are.

A map is cut into chunks. A chunk's arrays are written one file each, whole or not at all, and last
a mark that it is done. Every file carries a checksum. Whoever computes the map later begins where
marks are missing or files are damaged.
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
from math import ceil, prod
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff.errors import InputError, MissingDependencyError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.maps.damage import (
    CHECKSUM,
    described,
    description_checksum,
    file_damage,
    require_plain_files,
)
from cartstiff.maps.sampling import Sampling

__all__ = ["NOT_COMPUTED", "SCHEMA", "MapFile", "chunk_shape"]

SCHEMA = "cartstiff-map/2"

#: Value of ``state`` where nothing has been computed yet.
NOT_COMPUTED = 255
# Smallest and largest number of postures in a chunk, and how many chunks are aimed at.
_LEAST, _MOST, _CHUNKS = 64, 2**18, 128
# Most chunks of a map: each is some files, and all of them are listed.
_MOST_CHUNKS = 10**6
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
        place, where = Path(path), one_line(str(path))
        try:
            if not (place / "zarr.json").is_file():
                raise InputError(
                    "is no map", where=where, expected="a folder made by 'cartstiff map'"
                )
            require_plain_files(place)
            described(place, SCHEMA)
            state = json.loads((place / "state" / "zarr.json").read_text(encoding="utf-8"))
            shape, chunk = state["shape"], state["chunk_grid"]["configuration"]["chunk_shape"]
        except OSError as error:
            raise InputError("map cannot be read", where=where, got=error.strerror) from None
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError("is no map that can be read", where=where, got=str(error)) from None
        return cls(place, tuple(shape), tuple(chunk))

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
        count = prod(ceil(n / c) for n, c in zip(sampling.shape, chunk, strict=True))
        if count > _MOST_CHUNKS:
            raise InputError(f"map of {prod(sampling.shape)} postures has too many parts",
                             expected=f"at most {_MOST_CHUNKS}: fewer postures, or more in each",
                             got=count)  # fmt: skip
        new = place.with_name(f".{place.name}.{os.getpid()}.new")
        shape, dims = sampling.shape, sampling.dims
        kind = np.float32 if single else np.float64
        try:
            parts: list[str] = []
            shutil.rmtree(new, ignore_errors=True)
            new.mkdir()
            group = zarr.create_group(new, attributes=dict(attributes), zarr_format=3)

            def array(name: str, tail: tuple[int, ...], names: tuple[str, ...], dtype: Any,
                      fill: float, **more: Any) -> None:  # fmt: skip
                parts.append(name)
                group.create_array(
                    name, shape=(*shape, *tail), chunks=(*chunk, *tail), dtype=dtype,
                    fill_value=fill, dimension_names=(*dims, *names), attributes=more,
                    compressors=_compressors(),
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
                parts.append("branches")
                group.create_array(
                    "branches", shape=shape[:-1], chunks=chunk[:-1], dtype=np.uint32,
                    fill_value=0, dimension_names=dims[:-1], compressors=_compressors(),
                    attributes={"long_name": "number of branches found at the place"},
                )  # fmt: skip
            for name, (values, dim) in _whole(sampling).items():
                array_of_axis = group.create_array(
                    name, shape=values.shape, chunks=values.shape, dtype=values.dtype,
                    dimension_names=(dim,), compressors=_compressors(),
                    attributes={"units": units.get(name, "s")},
                )  # fmt: skip
                _writeable(array_of_axis)[:] = values
            if sampling.stores_q and "branch" not in dims:
                box = tuple(slice(0, n) for n in shape)
                _writeable(group["q"])[:] = sampling.postures(box, None)
            group.create_array(
                "done", shape=(count,), chunks=(1,), dtype=np.uint8, fill_value=0,
                dimension_names=("chunk",), attributes={"long_name": "whether a chunk is done"},
                compressors=_compressors(),
            )  # fmt: skip
            group.attrs["parts"] = parts
            group.attrs[CHECKSUM] = description_checksum(new)
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
        folder, count = self.path / "done" / "c", len(self.boxes)
        try:
            found = {int(p.name) for p in folder.iterdir() if p.name.isdecimal()}
        except FileNotFoundError:
            return set()
        return {i for i in found if i < count}

    def is_done(self, chunk: int) -> bool:
        """Whether a chunk is complete."""
        return (self.path / "done" / "c" / str(chunk)).is_file()

    def missing(self) -> list[int]:
        """Chunks that are not, in order."""
        done = self.done()
        return [i for i in range(len(self.boxes)) if i not in done]

    def damaged(self) -> dict[int, str]:
        """Complete chunks of which a file is missing or does not agree with its checksum."""
        found = ((i, self.damage(i)) for i in sorted(self.done()))
        return {i: what for i, what in found if what is not None}

    def damage(self, chunk: int) -> str | None:
        """What is wrong with a complete chunk: the first such file, and what it is."""
        files: list[tuple[str, tuple[int, ...]]] = [("done", (chunk,))]
        place = tuple(int(k) for k in np.unravel_index(chunk, self.cuts))  # as `boxes` are
        for name in self.attributes["parts"]:
            ndim = self.arrays[name].ndim
            files.append((name, (*place, *[0] * ndim)[:ndim]))
        return next(filter(None, (self.damage_of(name, key) for name, key in files)), None)

    def chunk_at(self, place: tuple[int, ...]) -> int:
        """Number of the chunk that a file of an array, by its place in it, belongs to."""
        cell = (*place, *[0] * len(self.cuts))[: len(self.cuts)]
        return int(np.ravel_multi_index(cell, self.cuts))

    def damage_of(self, name: str, key: tuple[int, ...]) -> str | None:
        """What is wrong with one file of an array."""
        array = self.arrays[name]
        file = f"{name}/{array.metadata.encode_chunk_key(key)}"
        largest = int(np.prod(array.chunks, dtype=object)) * array.dtype.itemsize
        what = file_damage(self.path / file, largest)
        return None if what is None else f"{file} {what}"

    def refused(self, chunk: int, what: str) -> InputError:
        """The line about a damaged chunk."""
        return InputError(
            f"part {chunk + 1} of {len(self.boxes)} is damaged: {what}",
            where=one_line(str(self.path)), expected="to be computed anew by the same command",
        )  # fmt: skip

    def forget(self, chunk: int) -> None:
        """Take away the mark of a chunk, so that it is computed anew."""
        (self.path / "done" / "c" / str(chunk)).unlink(missing_ok=True)

    def mend_axes(self, sampling: Sampling) -> list[str]:
        """Write the axes anew whose files are damaged; their names."""
        damaged = [n for n in _whole(sampling) if self.damage_of(n, (0,)) is not None]
        for name in damaged:
            _writeable(self.arrays[name])[:] = _whole(sampling)[name][0]
        return damaged

    @cached_property
    def cuts(self) -> tuple[int, ...]:
        """Number of chunks along each dimension."""
        return tuple(ceil(n / c) for n, c in zip(self.shape, self.chunk, strict=True))

    @cached_property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the whole map."""
        return dict(self._group.attrs)

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """The arrays by name, as Zarr reads them."""
        return dict(self._group.arrays())

    @property
    def axes(self) -> list[str]:
        """Names of the arrays in one piece."""
        return [n for n in self.arrays if n != "done" and n not in self.attributes["parts"]]

    @cached_property
    def _group(self) -> Any:
        return _zarr().open_group(self.path, mode="r+")

    def write(self, chunk: int, arrays: Mapping[str, Array]) -> None:
        """Put the arrays of a chunk in the file and mark it as done."""
        box = self.boxes[chunk]
        for name, values in arrays.items():
            array = _writeable(self.arrays[name])
            array[box[: values.ndim] if values.ndim < len(box) else box] = values
        self.arrays["done"][chunk] = 1

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


def _compressors() -> tuple[Any, ...]:
    """What the bytes of a chunk go through; the checksum is of what is stored."""
    from zarr.codecs import Crc32cCodec, ZstdCodec

    return ZstdCodec(level=0), Crc32cCodec()


def _writeable(array: Any) -> Any:
    """An array that writes chunks of nothing but its fill value too: their absence is damage."""
    return array.with_config({"write_empty_chunks": True})


def _whole(sampling: Sampling) -> dict[str, tuple[Array, str]]:
    """Arrays in one piece, by name: values, and the dimension they belong to."""
    found = {name: (axis.values, name) for name, axis in sampling.axes.items()}
    if (time := getattr(sampling, "time", None)) is not None:
        found["time"] = (time, "posture")
    return found
