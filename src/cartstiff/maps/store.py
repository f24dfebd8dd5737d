"""Maps in files: Zarr folders of labelled arrays that say what they are.

A map is cut into chunks. A chunk's arrays are written one file each, whole or not at all, and last
a mark that it is done. Every file carries a checksum; the mark repeats those of its chunk, and says
which chunk of which map it belongs to. Whoever computes the map later begins where marks are
missing or files are not the ones that were written.

What tells a whole map from a damaged one: a checksum of every file, and no links.

Zarr's codec appends the CRC-32C of each chunk to its file; which one belongs there stands in the
chunk's mark, and for axes in the folder's attributes. What describes the arrays (the ``zarr.json``
of the folder and of each array) has one checksum in the folder's attributes.

A map as labelled arrays; nothing is read that does not agree with its checksum.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import stat
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from math import ceil, prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.errors import InputError, MissingDependencyError, checked_kind, imported, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.maps.sampling import Axis, Sampling, chunk_shape, from_dict

if TYPE_CHECKING:
    import xarray

#: Attribute of the folder that holds the checksum of its descriptions.
CHECKSUM = "description_checksum"
# Larger than the description of any map; what is larger is not read.
_LARGEST_DESCRIPTION = 1 << 26
_ANEW = "the map as it was written; without the folder, the same command computes it anew"


def _entries(folder: Path) -> Iterator[tuple[Path, int]]:
    for path in sorted(folder.iterdir()):
        mode = path.lstat().st_mode
        yield path, mode
        if stat.S_ISDIR(mode):
            yield from _entries(path)


def require_plain_files(folder: Path) -> None:
    """Refuse a map with a link, a device or a pipe in it: what it leads to has no end, or an owner.

    Raises
    ------
    InputError
        With the first of them.
    """
    for path, mode in _entries(folder):
        if not (stat.S_ISDIR(mode) or stat.S_ISREG(mode)):
            raise InputError(
                "is a link" if stat.S_ISLNK(mode) else "is no file",
                where=one_line(str(path)),
                expected="files and folders only in a map",
            )


def description_checksum(folder: Path) -> str:
    """SHA-256 of what describes the folder (less this checksum itself) and its arrays."""
    digest = hashlib.sha256()
    root = json.loads(_text(folder / "zarr.json"))
    root["attributes"].pop(CHECKSUM, None)
    digest.update(json.dumps(root, sort_keys=True).encode())
    for path in sorted(folder.glob("*/zarr.json")):
        digest.update(path.parent.name.encode() + b"\0" + _text(path).encode() + b"\0")
    return digest.hexdigest()


def described(folder: Path, schema: str) -> dict[str, Any]:
    """The attributes of a map's folder, once everything that describes it agrees with its checksum.

    Raises
    ------
    InputError
        If it is no map, one of another version, or a damaged one.
    """
    where = one_line(str(folder))
    try:
        attributes = json.loads(_text(folder / "zarr.json"))["attributes"]
        there = attributes["schema"]
    except OSError as error:
        raise InputError("map cannot be read", where=where, got=error.strerror) from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            "is not a map, or its zarr.json is damaged", where=where, expected=_ANEW
        ) from None
    if there != schema:
        raise InputError(
            "is a map of another version",
            where=where,
            expected=f"schema {schema}, or another file name",
            got=there,
        )
    try:
        whole = attributes[CHECKSUM] == description_checksum(folder)
    except (OSError, ValueError, KeyError, TypeError):
        whole = False
    if not whole:
        raise InputError(
            "map is damaged: a zarr.json in it does not agree with its checksum",
            where=where,
            expected=_ANEW,
        )
    return dict(attributes)


def _text(path: Path) -> str:
    if path.stat().st_size > _LARGEST_DESCRIPTION:
        raise ValueError("too large")
    return path.read_text(encoding="utf-8")


class DamageError(Exception):
    """A file of a map that is not the one that was written; says which, and what is wrong."""


def crc32c(data: bytes) -> int:
    """CRC-32C (Castagnoli) of some bytes.

    Raises
    ------
    MissingDependencyError
        Without google-crc32c.
    """
    value = imported(
        "google_crc32c", package="google-crc32c", purpose="verifying a map", extra="maps"
    ).value
    return int(value(data))


def checksum_of(path: Path) -> int:
    """The checksum at the end of a file that has just been written."""
    with path.open("rb") as file:
        file.seek(-4, os.SEEK_END)
        return int.from_bytes(file.read(), "little")


def checked_file(path: Path, folder: Path, largest: int, checksum: int | None = None) -> bytes:
    """The bytes of a file in a map's folder, less the checksum at its end.

    Parameters
    ----------
    path, folder : Path
        The file, and what its name is told from.
    largest : int
        Bytes of its content.
    checksum : int, optional
        The one that it was written with; without it, only its own counts.

    Raises
    ------
    DamageError
        If it is not what was written.
    """
    name = path.relative_to(folder).as_posix()
    try:
        # A compressor adds a little to what it cannot compress.
        if path.stat().st_size > largest + largest // 8 + 1024:
            raise DamageError(f"{name} is too large")
        data = path.read_bytes()
    except FileNotFoundError:
        raise DamageError(f"{name} is missing") from None
    except OSError as error:
        raise DamageError(f"{name} cannot be read ({error.strerror})") from None
    own = int.from_bytes(data[-4:], "little")
    if len(data) < 4 or own != crc32c(data[:-4]):
        raise DamageError(f"{name} does not agree with its checksum")
    if checksum is not None and own != checksum:
        raise DamageError(f"{name} is not the one that was written there")
    return data[:-4]


SCHEMA = "cartstiff-map/3"

#: Value of ``state`` where nothing has been computed yet.
NOT_COMPUTED = 255
# Most chunks of a map: each is some files, and all of them are listed.
_MOST_CHUNKS = 10**6
_RESERVED = ("state", "position", "q", "done", "branches", "xyz", "joint", "chunk")


def _zarr() -> Any:
    zarr = imported("zarr", package="zarr", purpose="keeping a map in a file", extra="maps")
    return zarr


@dataclass(frozen=True)
class MapFile:
    """A map's folder.

    Attributes
    ----------
    path : Path
        The folder.
    shape, chunk : tuple of int
        Shapes of the map and of a chunk.
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
        place = Path(checked_kind(path, (str, Path), "name of a map", "a path"))
        where = one_line(str(path))
        try:
            if not (place / "zarr.json").is_file():
                raise InputError(
                    "is not a map", where=where, expected="a folder made by 'cartstiff map'"
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
            raise InputError("is not a map that can be read", where=where, got=str(error)) from None
        return cls(place, tuple(shape), tuple(chunk))

    @classmethod
    def create(
        cls,
        path: str | Path,
        sampling: Sampling,
        variables: Mapping[str, Mapping[str, Any]],
        attributes: Mapping[str, Any],
        *,
        units: Mapping[str, str],
        coordinates: int,
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
            Attributes of each array: the quantities, ``state``, ``position``, and where they are
            kept ``q`` and ``branches``.
        attributes : mapping
            Attributes of the whole; values that JSON can hold.
        units : mapping of str to str
            Unit of every dimension with an axis.
        coordinates : int
            Number of coordinates of a posture.
        single : bool
            Keep numbers in single precision.
        postures_per_chunk : int, optional
            See `chunk_shape`.
        """
        zarr, place = _zarr(), Path(path)
        for name in sampling.dims:
            if name in _RESERVED or name in variables:
                raise InputError("a dimension has the name of something else in the map", got=name)
        chunk, shape, dims = (
            chunk_shape(sampling, postures_per_chunk),
            sampling.shape,
            sampling.dims,
        )
        count = prod(ceil(n / c) for n, c in zip(shape, chunk, strict=True))
        if count > _MOST_CHUNKS:
            raise InputError(
                f"map of {prod(shape)} postures has too many parts",
                expected=f"at most {_MOST_CHUNKS}: fewer postures, or more in each",
                got=count,
            )
        kind = np.float32 if single else np.float64
        own: dict[str, tuple[Any, float, tuple[int, ...], tuple[str, ...]]] = {
            "state": (np.uint8, NOT_COMPUTED, (), ()),
            "position": (kind, np.nan, (3,), ("xyz",)),
            "q": (np.float64, np.nan, (coordinates,), ("joint",)),
            "branches": (np.uint32, 0, (), ()),
        }
        new = place.with_name(f".{place.name}.{os.getpid()}.new")
        try:
            shutil.rmtree(new, ignore_errors=True)
            new.mkdir()
            group = zarr.create_group(new, attributes=dict(attributes), zarr_format=3)
            for name, about in variables.items():
                dtype, fill, tail, names = own.get(name, (kind, np.nan, (), ()))
                places = len(dims) - (name == "branches")
                group.create_array(
                    name,
                    shape=(*shape[:places], *tail),
                    chunks=(*chunk[:places], *tail),
                    dtype=dtype,
                    fill_value=fill,
                    dimension_names=(*dims[:places], *names),
                    attributes=dict(about),
                    compressors=_compressors(),
                )
            for name, (values, dim) in _whole(sampling).items():
                axis = group.create_array(
                    name,
                    shape=values.shape,
                    chunks=values.shape,
                    dtype=values.dtype,
                    dimension_names=(dim,),
                    compressors=_compressors(plain=True),
                    attributes={"units": units.get(name, "s")},
                )
                _writeable(axis)[:] = values
            group.create_array(
                "done",
                shape=(count * (1 + len(variables)),),
                chunks=(1 + len(variables),),
                dtype=np.uint32,
                fill_value=0,
                dimension_names=("checksum",),
                attributes={
                    "long_name": "for each chunk that is done: whose it is, and the "
                    "checksums of its files in the order of parts"
                },
                compressors=_compressors(plain=True),
            )
            group.attrs["parts"] = list(variables)
            group.attrs["axes"] = {
                n: checksum_of(_file(group[n], new, (0,))) for n in _whole(sampling)
            }
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
            numbers = {int(p.name) for p in folder.iterdir() if p.name.isdecimal()}
        except FileNotFoundError:
            return set()
        return {i for i in numbers if i < count}

    def is_done(self, chunk: int) -> bool:
        """Whether a chunk is complete."""
        return (self.path / "done" / "c" / str(chunk)).is_file()

    def missing(self) -> list[int]:
        """Chunks that are not, in order."""
        done = self.done()
        return [i for i in range(len(self.boxes)) if i not in done]

    def damaged(self) -> dict[int, str]:
        """Complete chunks of which a file is missing, or is not the one that was written."""
        damages = ((i, self.damage(i, *self.attributes["parts"])) for i in sorted(self.done()))
        return {i: what for i, what in damages if what is not None}

    def damage(self, chunk: int, *names: str) -> str | None:
        """What is wrong with a complete chunk, its mark and its files of some arrays: the first."""
        try:
            mark = self._checked("done", (chunk,))
            own = self._identity(chunk).to_bytes(4, "little")
            if mark[:4] != own or len(mark) != 4 * (1 + len(self.attributes["parts"])):
                return f"done/c/{chunk} is not the mark of this part"
            checksums = np.frombuffer(mark[4:], "<u4").tolist()
            of = dict(zip(self.attributes["parts"], checksums, strict=True))
            for name in names:
                self._checked(name, self._place(name, chunk), of[name])
        except DamageError as damage:
            return str(damage)
        return None

    def _identity(self, chunk: int) -> int:
        """What tells the mark of a chunk from those of others, and of other maps."""
        return crc32c(f"{self.attributes[CHECKSUM]} {chunk}".encode())

    def _place(self, name: str, chunk: int) -> tuple[int, ...]:
        """Where the file of a chunk stands in an array."""
        ndim = self.arrays[name].ndim
        place = [int(k) for k in np.unravel_index(chunk, self.cuts)]  # as `boxes` are
        return (*place, *[0] * ndim)[:ndim]

    def chunk_at(self, place: tuple[int, ...]) -> int:
        """Number of the chunk that a file of an array, by its place in it, belongs to."""
        cell = (*place, *[0] * len(self.cuts))[: len(self.cuts)]
        return int(np.ravel_multi_index(cell, self.cuts))

    def block(self, name: str, chunk: int) -> Array:
        """The part of an array that a chunk holds: the fill value while it is not done.

        Raises
        ------
        InputError
            If its file is not the one that was written.
        """
        array, place = self.arrays[name], self._place(name, chunk)
        if self.is_done(chunk):
            if (what := self.damage(chunk, name)) is not None:
                raise self.refused(chunk, what)
            return np.asarray(array.get_block_selection(place))
        each = zip(place, array.chunks, array.shape, strict=True)
        return np.full([min(c, n - i * c) for i, c, n in each], array.fill_value, array.dtype)

    def _checked(self, name: str, key: tuple[int, ...], checksum: int | None = None) -> bytes:
        """The content of one file of an array."""
        array = self.arrays[name]
        largest = int(np.prod(array.chunks, dtype=object)) * array.dtype.itemsize
        return checked_file(_file(array, self.path, key), self.path, largest, checksum)

    def axis_damage(self, name: str) -> str | None:
        """What is wrong with the file of an array in one piece."""
        try:
            self._checked(name, (0,), self.attributes["axes"][name])
        except DamageError as damage:
            return str(damage)
        return None

    def refused(self, chunk: int, what: str) -> InputError:
        """The line about a damaged chunk."""
        return InputError(
            f"part {chunk + 1} of {len(self.boxes)} is damaged: {what}",
            where=one_line(str(self.path)),
            expected="to be computed anew by the same command",
        )

    def forget(self, chunk: int) -> None:
        """Take away the mark of a chunk, so that it is computed anew."""
        (self.path / "done" / "c" / str(chunk)).unlink(missing_ok=True)

    def mend_axes(self, sampling: Sampling) -> list[str]:
        """Write the axes anew whose files are damaged; their names."""
        damaged = [n for n in self.attributes["axes"] if self.axis_damage(n) is not None]
        # Bit by bit what was written; those of `sampling` may differ by rounding.
        written = json.loads(self.attributes["description"])["sampling"].get("axes", {})
        for name in damaged:
            values = Axis(*written[name]).values if name in written else _whole(sampling)[name][0]
            _writeable(self.arrays[name])[:] = values
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

    @cached_property
    def _group(self) -> Any:
        return _zarr().open_group(self.path, mode="r+")

    def write(self, chunk: int, arrays: Mapping[str, Array]) -> None:
        """Put the arrays of a chunk in the file and mark it as done."""
        box = self.boxes[chunk]
        for name, values in arrays.items():
            array = _writeable(self.arrays[name])
            array[box[: values.ndim] if values.ndim < len(box) else box] = values
        files = [
            _file(self.arrays[n], self.path, self._place(n, chunk))
            for n in self.attributes["parts"]
        ]
        mark, width = [self._identity(chunk), *map(checksum_of, files)], 1 + len(files)
        self.arrays["done"][chunk * width : (chunk + 1) * width] = mark

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


def _file(array: Any, folder: Path, key: tuple[int, ...]) -> Path:
    """The file of an array at a place."""
    return folder / array.basename / str(array.metadata.encode_chunk_key(key))


def _compressors(plain: bool = False) -> tuple[Any, ...]:
    """What the bytes of a chunk go through; the checksum is of what is stored.

    Where it is kept elsewhere, nothing is compressed: other releases may do it in other bytes.
    """
    from zarr.codecs import BloscCodec, Crc32cCodec

    # Bytes of like significance together: smaller than what is compressed as it stands, and sooner.
    shuffled = BloscCodec(cname="lz4", clevel=1, shuffle="shuffle")
    return (Crc32cCodec(),) if plain else (shuffled, Crc32cCodec())


def _writeable(array: Any) -> Any:
    """An array that writes chunks of nothing but its fill value too: their absence is damage."""
    return array.with_config({"write_empty_chunks": True})


def _whole(sampling: Sampling) -> dict[str, tuple[Array, str]]:
    """Arrays in one piece, by name: values, and the dimension they belong to."""
    coordinates = {name: (axis.values, name) for name, axis in sampling.axes.items()}
    if (time := getattr(sampling, "time", None)) is not None:
        coordinates["time"] = (time, "posture")
    return coordinates


def _postures(file: MapFile, sampling: Sampling, chunk: int) -> Array:
    """The coordinates of a part of a sampling, computed."""
    box = file.boxes[chunk]
    q = sampling.postures(box, None)
    return q.reshape(*(s.stop - s.start for s in box), -1)


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
        If there is no map, or its description is damaged; a damaged part is refused when read.
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
    attributes = dict(file.attributes)
    parts, axes, _ = (attributes.pop(name) for name in ("parts", "axes", CHECKSUM))
    description = json.loads(attributes["description"])
    joints = description["joints"]
    sampling = from_dict(description["sampling"])

    def lazy(
        read: Callable[[int], Array], shape: tuple[int, ...], chunks: tuple[int, ...], kind: Any
    ) -> Any:
        def part(block_id: tuple[int, ...]) -> Array:
            return read(file.chunk_at(block_id))

        sizes = dask.array.core.normalize_chunks(chunks, shape)  # type: ignore[no-untyped-call]
        empty = np.empty((0,) * len(shape), kind)
        name = f"map-{uuid.uuid4().hex}"
        return dask.array.map_blocks(part, chunks=sizes, dtype=kind, meta=empty, name=name)  # type: ignore[no-untyped-call]

    variables = {}
    own = ("state", "position", "q", "branches")
    for name in (*(part for part in parts if part not in own), *own):
        if name in parts:
            array = file.arrays[name]
            variables[name] = (
                array.metadata.dimension_names,
                lazy(partial(file.block, name), array.shape, array.chunks, array.dtype),
                dict(array.attrs),
            )
    if "q" not in parts:
        if sampling is None:
            raise InputError("the map does not say where it looked", where=one_line(str(path)))
        variables["q"] = (
            (*sampling.dims, "joint"),
            lazy(
                partial(_postures, file, sampling),
                (*file.shape, len(joints)),
                (*file.chunk, len(joints)),
                np.dtype(float),
            ),
            {"long_name": "coordinates of the posture"},
        )
    coordinates: dict[str, Any] = {"joint": joints, "xyz": ["x", "y", "z"]}
    for name in axes:
        if (what := file.axis_damage(name)) is not None:
            raise InputError(
                f"an axis is damaged: {what}",
                where=one_line(str(path)),
                expected="to be computed anew by the same command",
            )
        array = file.arrays[name]
        coordinates[name] = (array.metadata.dimension_names, array[:], dict(array.attrs))
    dataset = xarray.Dataset(variables, coordinates, attributes)
    dataset.attrs["chunks_done"], dataset.attrs["chunks"] = len(file.done()), len(file.boxes)
    return dataset
