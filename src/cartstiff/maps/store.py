"""Maps in files: Zarr folders of labelled arrays that say what they are.

A map is cut into parts. The arrays of a part are written one file each, whole or not at all, and
last its checksums: of the numbers, together with where they stand and with all that describes the
map. What is read is what was written there for this map. All else is named, and is computed anew.

A map as labelled arrays; nothing is read that does not agree with its checksum.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import stat
import uuid
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from math import ceil, prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cartstiff.errors import InputError, MissingDependencyError, checked_kind, imported, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.maps.sampling import Axis, Sampling, chunk_shape, from_dict

if TYPE_CHECKING:
    import xarray

SCHEMA = "cartstiff-map/4"
#: Attribute of the folder that holds the checksum of what describes it and its arrays.
CHECKSUM = "description_checksum"
#: Value of ``state`` where nothing has been computed yet.
NOT_COMPUTED = 255
# Most parts of a map: each is some files, and all of them are listed.
_MOST_PARTS = 10**6
# Blosc packs no more.
_LARGEST_FILE = 2**31
# Group of the checksums, so that they are no variable of the map.
_PARTS = "parts"
_RESERVED = ("state", "position", "q", _PARTS, "branches", "array", "part")
_ANEW = "the map as it was written; without the folder, the same command computes it anew"


class Kind(NamedTuple):
    """What an array of a map is: its dimensions, attributes, numbers, and the one for nothing."""

    dims: tuple[str, ...]
    attributes: dict[str, Any]
    dtype: str = "f8"
    fill: float = np.nan


def _zarr() -> Any:
    return imported("zarr", package="zarr", purpose="keeping a map in a file", extra="maps")


def _description_checksum(root: Mapping[str, Any]) -> str:
    """SHA-256 of the folder's ``zarr.json``, which describes all arrays, less this checksum."""
    attributes = {key: value for key, value in root["attributes"].items() if key != CHECKSUM}
    text = json.dumps({**root, "attributes": attributes}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _checksum(values: Array, *where: str | int) -> int:
    """Of numbers, and of the map, array and part that they stand in."""
    return zlib.crc32(np.ascontiguousarray(values).data, zlib.crc32(repr(where).encode()))


def _checked_attributes(folder: Path) -> dict[str, Any]:
    """The attributes of a map's folder, once all that describes it agrees with its checksum."""
    where = one_line(str(folder))
    try:
        if not (folder / "zarr.json").is_file():
            raise InputError(
                "is not a map", where=where, expected="a folder made by 'cartstiff map'"
            )
        _require_plain_files(folder)
        text = (folder / "zarr.json").read_text(encoding="utf-8")
    except OSError as error:
        raise InputError("map cannot be read", where=where, got=error.strerror) from None
    except UnicodeDecodeError:
        text = ""
    try:
        root = json.loads(text)
        attributes = dict(root["attributes"])
        there, is_whole = attributes["schema"], _description_checksum(root) == attributes[CHECKSUM]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(
            "is not a map, or its zarr.json is damaged", where=where, expected=_ANEW
        ) from None
    if there != SCHEMA:
        raise InputError(
            "is a map of another version",
            where=where,
            expected=f"schema {SCHEMA}, or another file name",
            got=there,
        )
    if not is_whole:
        raise InputError(
            "map is damaged: its zarr.json does not agree with its checksum",
            where=where,
            expected=_ANEW,
        )
    return attributes


def _require_plain_files(folder: Path) -> None:
    """Refuse links, devices and pipes: what they lead to has no end, or another owner."""
    for path in folder.rglob("*"):
        about = path.lstat()
        if not (stat.S_ISDIR(about.st_mode) or stat.S_ISREG(about.st_mode)):
            raise InputError(
                "is a link" if stat.S_ISLNK(about.st_mode) else "is no file",
                where=one_line(str(path)),
                expected="files and folders only in a map",
            )
        if about.st_size > _LARGEST_FILE:
            raise InputError(
                "is too large for a map",
                where=one_line(str(path)),
                expected=f"at most {_LARGEST_FILE} bytes",
                got=about.st_size,
            )


@dataclass(frozen=True)
class MapFile:
    """A map's folder; `at` and `create` give it."""

    path: Path
    attributes: Mapping[str, Any]

    @classmethod
    def at(cls, path: str | Path) -> MapFile:
        """An existing map.

        Raises
        ------
        InputError
            If there is no map, one of another version, or a damaged one.
        """
        place = Path(checked_kind(path, (str, Path), "name of a map", "a path"))
        return cls(place, _checked_attributes(place))

    @classmethod
    def create(
        cls,
        path: str | Path,
        sampling: Sampling,
        arrays: Mapping[str, Kind],
        attributes: Mapping[str, Any],
        units: Mapping[str, str],
        sizes: Mapping[str, int],
        postures_per_chunk: int | None = None,
    ) -> MapFile:
        """A new map with nothing computed; it appears whole or not at all.

        Parameters
        ----------
        path : path
            Must not exist.
        sampling : Sampling
            Dimensions and axes.
        arrays : mapping of str to Kind
            What each part holds: the quantities, ``state``, ``position`` and more.
        attributes : mapping
            Attributes of the whole; values that JSON can hold.
        units : mapping of str to str
            Unit of every dimension with an axis.
        sizes : mapping of str to int
            Lengths of the dimensions that are not of the sampling; they are not cut.
        postures_per_chunk : int, optional
            See `chunk_shape`.
        """
        zarr, place = _zarr(), Path(path)
        for name in sampling.dims:
            if name in (*_RESERVED, *arrays, *sizes):
                raise InputError("a dimension has the name of something else in the map", got=name)
        chunk = chunk_shape(sampling, postures_per_chunk)
        count = prod(ceil(n / c) for n, c in zip(sampling.shape, chunk, strict=True))
        if count > _MOST_PARTS:
            raise InputError(
                f"map of {sampling.size} postures has too many parts",
                expected=f"at most {_MOST_PARTS}: fewer postures, or more in each",
                got=count,
            )
        lengths = {**sizes, **dict(zip(sampling.dims, sampling.shape, strict=True)), "part": count}
        cuts = {**sizes, **dict(zip(sampling.dims, chunk, strict=True)), "part": 1, "array": None}
        lengths["array"] = cuts["array"] = len(arrays)
        about = {
            **attributes,
            "parts": list(arrays),
            "axes": {name: axis.as_list() for name, axis in sampling.axes.items()},
        }
        new = place.with_name(f".{place.name}.{os.getpid()}.new")
        try:
            shutil.rmtree(new, ignore_errors=True)
            new.mkdir()
            group = zarr.create_group(new, attributes=about, zarr_format=3)

            def create(where: Any, name: str, kind: Kind) -> Any:
                return where.create_array(
                    name,
                    shape=[lengths[dim] for dim in kind.dims],
                    chunks=[cuts[dim] for dim in kind.dims],
                    dtype=kind.dtype,
                    fill_value=kind.fill,
                    dimension_names=kind.dims,
                    attributes=kind.attributes,
                    compressors=_compressors(),
                )

            for name, kind in arrays.items():
                create(group, name, kind)
            for name in sampling.axes:
                cuts[name] = lengths[name]
                create(group, name, Kind((name,), {"units": units[name]}))
            create(group.create_group(_PARTS), "checksum", Kind(("part", "array"), {}, "u4", 0))
            with warnings.catch_warnings():  # Zarr's own next version may have it elsewhere
                warnings.simplefilter("ignore")
                zarr.consolidate_metadata(new, zarr_format=3)
            root = json.loads((new / "zarr.json").read_text(encoding="utf-8"))
            root["attributes"][CHECKSUM] = _description_checksum(root)
            (new / "zarr.json").write_text(json.dumps(root, indent=2), encoding="utf-8")
            cls(new, root["attributes"]).mend_axes()
            new.rename(place)
        except OSError as error:
            raise InputError(
                "map cannot be written", where=one_line(str(path)), got=error.strerror
            ) from None
        finally:
            shutil.rmtree(new, ignore_errors=True)
        return cls(place, root["attributes"])

    @cached_property
    def group(self) -> Any:
        """The arrays by name, as Zarr reads them."""
        return _zarr().open_group(self.path, mode="r+", use_consolidated=True)

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """Those of the map's numbers and axes."""
        return dict(self.group.arrays())

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the map."""
        return tuple(self.arrays["state"].shape)

    @property
    def chunk(self) -> tuple[int, ...]:
        """Shape of a part."""
        return tuple(self.arrays["state"].chunks)

    @cached_property
    def cuts(self) -> tuple[int, ...]:
        """Number of parts along each dimension."""
        return tuple(ceil(n / c) for n, c in zip(self.shape, self.chunk, strict=True))

    @cached_property
    def boxes(self) -> list[tuple[slice, ...]]:
        """What each part holds of the map."""
        cuts = [
            [slice(i, min(i + c, n)) for i in range(0, n, c)]
            for n, c in zip(self.shape, self.chunk, strict=True)
        ]
        return list(product(*cuts))

    def count(self, part: int) -> int:
        """Postures in a part."""
        return prod(s.stop - s.start for s in self.boxes[part])

    def is_done(self, part: int) -> bool:
        """Whether a part is complete."""
        return self._mark(part).is_file()

    def done(self) -> list[int]:
        """Parts that are complete, in order."""
        return [i for i in range(len(self.boxes)) if self.is_done(i)]

    def forget(self, part: int) -> None:
        """Take away the mark of a part, so that it is computed anew."""
        self._mark(part).unlink(missing_ok=True)

    def _mark(self, part: int) -> Path:
        return self.path / _PARTS / "checksum" / "c" / str(part) / "0"

    def _checksums(self, part: int, arrays: Mapping[str, Array]) -> list[int]:
        identity = self.attributes[CHECKSUM]
        return [_checksum(arrays[n], identity, n, part) for n in self.attributes["parts"]]

    def write(self, part: int, arrays: Mapping[str, Array]) -> dict[str, Array]:
        """Put the arrays of a part in the file, and then their checksums; as they stand there."""
        kept = {}
        for name in self.attributes["parts"]:
            array = _writeable(self.arrays[name])
            kept[name] = arrays[name].astype(array.dtype, copy=False)
            array[self.boxes[part][: array.ndim]] = kept[name]
        self.group[_PARTS]["checksum"][part] = self._checksums(part, kept)
        return kept

    def read(self, name: str, part: int) -> Array:
        """What was written of an array in a part.

        Raises
        ------
        InputError
            If there is something else.
        """
        array, column = self.arrays[name], self.attributes["parts"].index(name)
        try:
            values = np.asarray(array[self.boxes[part][: array.ndim]])
            mark = int(self.group[_PARTS]["checksum"][part, column])
            if mark == _checksum(values, self.attributes[CHECKSUM], name, part):
                return values
        except Exception:  # codecs raise anything, and name neither file nor part
            pass
        key = (*(int(i) for i in np.unravel_index(part, self.cuts)), 0)[: array.ndim]
        raise InputError(
            f"part {part + 1} of {len(self.boxes)} is damaged: "
            f"{name}/{array.metadata.encode_chunk_key(key)} is missing, or not what was written "
            "there",
            where=one_line(str(self.path)),
            expected="to be computed anew by the same command",
        )

    def part(self, part: int) -> dict[str, Array]:
        """All that was written of a part."""
        return {name: self.read(name, part) for name in self.attributes["parts"]}

    def block(self, name: str, part: int) -> Array:
        """As `read`; the fill value while the part is not done."""
        if self.is_done(part):
            return self.read(name, part)
        array, box = self.arrays[name], self.boxes[part]
        shape = [s.stop - s.start for s in box[: array.ndim]]
        return np.full((*shape, *array.shape[len(box) :]), array.fill_value, array.dtype)

    @property
    def axes(self) -> dict[str, Array]:
        """Values along the dimensions that have some; those in the file are for other readers."""
        return {name: Axis(*ends).values for name, ends in self.attributes["axes"].items()}

    def mend_axes(self) -> list[str]:
        """Write the axes that are not what they should be; their names."""
        damaged = []
        for name, values in self.axes.items():
            array = _writeable(self.arrays[name])
            try:
                is_whole = np.array_equal(array[:], values)
            except Exception:  # as in `read`
                is_whole = False
            if not is_whole:
                array[:] = values
                damaged.append(f"axis {name}")
        return damaged

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
            for path in self.path.rglob("*.partial"):  # what a killed process had begun to write
                path.unlink(missing_ok=True)
            yield
        finally:
            os.close(handle)


def _compressors() -> tuple[Any, ...]:
    """What the bytes of an array go through; any reader of Zarr sees a changed bit."""
    from zarr.codecs import BloscCodec, Crc32cCodec

    # Bytes of like significance together: smaller than what is compressed as it stands, and sooner.
    return BloscCodec(cname="lz4", clevel=1, shuffle="shuffle"), Crc32cCodec()


def _writeable(array: Any) -> Any:
    """An array that writes what is nothing but its fill value, too."""
    return array.with_config({"write_empty_chunks": True})


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
    parts, _, _ = (attributes.pop(name) for name in ("parts", "axes", CHECKSUM))
    description = json.loads(attributes["description"])
    joints = description["joints"]
    sampling = from_dict(description["sampling"])

    def lazy(read: Callable[[int], Array], shape: Any, chunks: Any, kind: Any) -> Any:
        def part(block_id: tuple[int, ...]) -> Array:
            cell = (*block_id, *[0] * len(file.cuts))[: len(file.cuts)]
            return read(int(np.ravel_multi_index(cell, file.cuts)))

        sizes = dask.array.core.normalize_chunks(chunks, shape)  # type: ignore[no-untyped-call]
        empty = np.empty((0,) * len(shape), kind)
        name = f"map-{uuid.uuid4().hex}"
        return dask.array.map_blocks(part, chunks=sizes, dtype=kind, meta=empty, name=name)  # type: ignore[no-untyped-call]

    def postures(part: int) -> Array:
        assert sampling is not None
        box = file.boxes[part]
        q = sampling.postures(box, None)
        return q.reshape(*(s.stop - s.start for s in box), -1)

    variables = {}
    own = ("state", "position", "q", "branches")
    for name in (*(part for part in parts if part not in own), *own):
        if name in parts:
            array = file.arrays[name]
            data = lazy(partial(file.block, name), array.shape, array.chunks, array.dtype)
            variables[name] = array.metadata.dimension_names, data, dict(array.attrs)
    if "q" not in parts:
        if sampling is None:
            raise InputError("the map does not say where it looked", where=one_line(str(path)))
        shapes = (*file.shape, len(joints)), (*file.chunk, len(joints))
        about = {"long_name": "coordinates of the posture"}
        variables["q"] = (*sampling.dims, "joint"), lazy(postures, *shapes, np.dtype(float)), about
    coordinates: dict[str, Any] = {"joint": joints, "xyz": ["x", "y", "z"]}
    for name, values in file.axes.items():
        coordinates[name] = (name,), values, dict(file.arrays[name].attrs)
    dataset = xarray.Dataset(variables, coordinates, attributes)
    dataset = dataset.set_coords("time") if "time" in parts else dataset
    dataset.attrs["chunks_done"], dataset.attrs["chunks"] = len(file.done()), len(file.boxes)
    return dataset
