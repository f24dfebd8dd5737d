"""Storage of maps: self-describing Zarr groups of labelled arrays.

A map is split into parts. Each array of a part is written as one object, ``state`` last,
and then the mark of the part: the checksums of these objects and their statistics for the
summary. A part without its mark or one of its objects has not been computed. An object
that differs from its checksum is refused when it is read.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from math import ceil, prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.errors import (
    CartstiffError,
    InputError,
    checked_kind,
    imported,
    one_line,
)
from cartstiff.core.writing import create_folder, remove_abandoned
from cartstiff.wings.maps.described import (
    MAX_DESCRIPTION,
    MAX_PARTS,
    check_described,
    loaded,
)
from cartstiff.wings.maps.sampling import Sampling, dimension_name

if TYPE_CHECKING:
    import xarray

SCHEMA = "cartstiff-map/6"
#: Attribute of the group that holds the checksum of its description and that of its
#: arrays.
CHECKSUM = "description_checksum"
#: Value of ``state`` where nothing has been computed yet.
NOT_COMPUTED = 255
#: Arrays of a map without statistics.
PLACES = ("position", "q", "time")
#: Largest number of postures compressed together: a few are read without the rest of a
#: part.
INNER = 2**16
# Largest number of bytes of a file: the limit of Blosc.
_MAX_FILE_BYTES = 2**31
# Group of the parts' marks, separate from the variables of the map.
_PARTS = "parts"
_MARKS = "parts/marks"
_RESERVED = ("state", "position", "q", _PARTS, "branches", "xyz", "joint")
_RESTORE = "the map as it was written; without it, the same command computes it anew"


class Kind(NamedTuple):
    """Dimensions, attributes, number type and fill value of an array of a map."""

    dims: tuple[str, ...]
    attributes: dict[str, Any]
    dtype: str = "f8"
    fill: float = np.nan


@dataclass(frozen=True)
class Parts:
    """Division of an array's shape into chunks, which are computed and
    stored one by one.
    """

    shape: tuple[int, ...]
    chunk: tuple[int, ...]

    @cached_property
    def cuts(self) -> tuple[int, ...]:
        """Number of parts along each dimension."""
        return tuple(ceil(n / c) for n, c in zip(self.shape, self.chunk, strict=True))

    def __len__(self) -> int:
        return prod(self.cuts)

    def cell(self, part: int) -> tuple[int, ...]:
        """Place of a part, which are numbered in C order, along each dimension."""
        return tuple(int(i) for i in np.unravel_index(part, self.cuts))

    def box(self, part: int) -> tuple[slice, ...]:
        """Box of a part in the array."""
        triples = zip(self.cell(part), self.chunk, self.shape, strict=True)
        return tuple(slice(i * c, min(i * c + c, n)) for i, c, n in triples)


@dataclass(frozen=True)
class Layout:
    """Description of a map before any part of it is computed.

    Attributes
    ----------
    sampling : Sampling
        Dimensions and axes.
    arrays : mapping of str to Kind
        Arrays of each part: the quantities, ``position``, ``state`` and more.
    axes : mapping of str to Kind
        Dimensions that have values.
    sizes : mapping of str to int
        Lengths of the other dimensions than those of the sampling; they are not split.
    chunk : tuple of int
        Shape of a part.
    attributes : mapping
        Attributes of the group, as values of JSON.
    """

    sampling: Sampling
    arrays: Mapping[str, Kind]
    axes: Mapping[str, Kind]
    sizes: Mapping[str, int]
    chunk: tuple[int, ...]
    attributes: Mapping[str, Any]

    def __post_init__(self) -> None:
        for name in self.sampling.dims:
            if name in (*_RESERVED, *self.arrays, *self.sizes):
                raise InputError(
                    "a dimension has the name of something else in the map", got=name
                )
        if (count := len(self.parts)) > MAX_PARTS:
            raise InputError(
                f"map of {self.sampling.size} postures has too many parts",
                expected=f"at most {MAX_PARTS}: fewer postures, or more in each",
                got=count,
            )

    @property
    def parts(self) -> Parts:
        """Parts of the map."""
        return Parts(tuple(self.sampling.shape), self.chunk)

    def lengths(self, dims: Iterable[str]) -> list[int]:
        """Lengths of dimensions."""
        known = dict(zip(self.sampling.dims, self.sampling.shape, strict=True))
        return [(known | dict(self.sizes))[dim] for dim in dims]

    def encoding(self, kind: Kind) -> dict[str, Any]:
        """The Zarr encoding of an array: one object per part, compressed in pieces."""
        from zarr.codecs import BloscCodec, Crc32cCodec

        known = dict(zip(self.sampling.dims, self.chunk, strict=True)) | dict(self.sizes)
        part = [known[dim] for dim in kind.dims]
        inner = part[0]
        while inner % 2 == 0 and inner * prod(part[1:]) > INNER * self.sizes.get(
            kind.dims[-1], 1
        ):
            inner //= 2
        return {
            "chunks": (inner, *part[1:]),
            **({} if inner == part[0] else {"shards": tuple(part)}),
            # Shuffled bytes compress better and faster; with the CRC any Zarr reader
            # notices a changed bit.
            "compressors": (
                BloscCodec(cname="lz4", clevel=1, shuffle="shuffle"),
                Crc32cCodec(),
            ),
            "fill_value": kind.fill,
        }


def fact(name: str, values: Array) -> Array:
    """Statistics of an array of a part for the summary; sizes as in `_fact_size`.

    Counts by value for ``state``, the maximum for ``branches``, and for quantities
    minimum, maximum, sum and number of the finite values.
    """
    if name == "state":
        return np.bincount(np.ravel(values), minlength=256).astype(float)
    if name == "branches":
        return np.array([np.max(values, initial=0)], float)
    is_finite = np.isfinite(values)
    values = np.asarray(values if is_finite.all() else values[is_finite], float)
    if not values.size:
        return np.array([np.inf, -np.inf, 0.0, 0.0])
    return np.array([values.min(), values.max(), values.sum(), values.size])


def _fact_size(name: str) -> int:
    return 0 if name in PLACES else {"state": 256, "branches": 1}.get(name, 4)


def zarr_library() -> Any:
    """Zarr, imported when a map is written or read; MissingDependencyError without it."""
    return imported(
        "zarr", package="zarr", purpose="keeping a map in a file", extra="maps"
    )


def _result_of(coroutine: Any) -> Any:
    """Wait for the result of a store's asynchronous method."""
    from zarr.core.sync import sync

    return sync(coroutine)


async def _listed(store: Any) -> set[str]:
    return {key async for key in store.list_prefix("")}


async def _numbers(store: Any, folder: str) -> list[int]:
    """Numbers that are names in a folder of a store."""
    keys = [key async for key in store.list_prefix(folder)]
    names = {key.removeprefix(folder).split("/", 1)[0] for key in keys}
    return [int(name) for name in names if name.isdecimal() and str(int(name)) == name]


def local_path(address: Any) -> Path | None:
    """Return the folder that an address names; None for other stores."""
    if isinstance(address, Path):
        return address
    if not isinstance(address, str):
        return None
    address = address.removeprefix("file://")
    return None if "://" in address or "::" in address else Path(address)


def _stored(address: Any) -> Any:
    """Return the Zarr store at an address."""
    storage = zarr_library().storage
    kinds = str, Path, zarr_library().abc.store.Store
    checked_kind(address, kinds, "name of a map", "a path, an address or a store")
    if (path := local_path(address)) is not None:
        return storage.LocalStore(path)
    if not isinstance(address, str):
        return address
    with reached(address):
        return storage.FsspecStore.from_url(address)


@contextmanager
def reached(
    address: Any, what: str = "store cannot be used", expected: str | None = None
) -> Iterator[None]:
    """Refuse in one line what a store raises: protocols and their packages
    raise any kind.
    """
    try:
        yield
    except CartstiffError:
        raise
    except Exception as error:
        got = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        where, got = one_line(str(address)), one_line(got.removesuffix(": "), 200)
        raise InputError(what, where=where, expected=expected, got=got) from None


def _read(store: Any, key: str) -> bytes | None:
    from zarr.core.buffer import default_buffer_prototype

    value = _result_of(store.get(key, default_buffer_prototype()))
    return None if value is None else bytes(value.to_bytes())


def _description_checksum(root: Mapping[str, Any]) -> str:
    """SHA-256 of the group's ``zarr.json``, which describes all arrays,
    without this checksum.
    """
    attributes = {
        key: value for key, value in root["attributes"].items() if key != CHECKSUM
    }
    text = json.dumps({**root, "attributes": attributes}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def is_there(address: Any) -> bool:
    """Whether something exists at an address."""
    if (path := local_path(address)) is not None:
        return path.exists()
    with reached(address):
        return _read(_stored(address), "zarr.json") is not None


def _checked_attributes(address: Any, store: Any) -> dict[str, Any]:
    """Return the attributes of a map after its description has passed its checksum."""
    where, folder, text = one_line(str(address)), local_path(address), None
    with reached(address):
        if folder is None or (folder / "zarr.json").is_file():
            if folder is not None:
                _require_plain_files(folder)
                size = (folder / "zarr.json").stat().st_size
                if size > MAX_DESCRIPTION:
                    raise InputError(
                        "description of the map is too large",
                        where=where,
                        expected=f"at most {MAX_DESCRIPTION} bytes",
                        got=size,
                    )
            text = _read(store, "zarr.json")
    if text is None:
        raise InputError(
            "is not a map", where=where, expected="a folder made by 'cartstiff map'"
        )
    try:
        root = loaded(text)
        attributes = dict(root["attributes"])
        there, is_whole = (
            attributes["schema"],
            _description_checksum(root) == attributes[CHECKSUM],
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(
            "is not a map, or its zarr.json is damaged", where=where, expected=_RESTORE
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
            expected=_RESTORE,
        )
    try:
        check_described(root)
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise InputError(
            "description of the map cannot be used",
            where=where,
            expected=_RESTORE,
            got=one_line(f"{type(error).__name__}: {error}", 100),
        ) from None
    return attributes


def _require_plain_files(folder: Path) -> None:
    """Refuse links, devices and pipes: their targets may be endless or
    belong to others.
    """
    for path in folder.rglob("*"):
        about = path.lstat()
        if not (stat.S_ISDIR(about.st_mode) or stat.S_ISREG(about.st_mode)):
            raise InputError(
                "is a link" if stat.S_ISLNK(about.st_mode) else "is no file",
                where=one_line(str(path)),
                expected="files and folders only in a map",
            )
        if about.st_size > _MAX_FILE_BYTES:
            raise InputError(
                "is too large for a map",
                where=one_line(str(path)),
                expected=f"at most {_MAX_FILE_BYTES} bytes",
                got=about.st_size,
            )


def _objects(layout: Layout) -> dict[str, bytes]:
    """Objects that describe a map, by key: the group, its arrays,
    and the values of the axes.
    """
    zarr, kept = zarr_library(), dict[str, Any]()
    from cartstiff.wings.maps.sealed import seal

    names = list(layout.arrays)
    group = zarr.create_group(
        zarr.storage.MemoryStore(kept), attributes=dict(layout.attributes), zarr_format=3
    )
    axes = layout.sampling.axes
    for name, kind in {**layout.arrays, **layout.axes}.items():
        own = layout.encoding(kind)
        array = group.create_array(
            name,
            shape=layout.lengths(kind.dims),
            chunks=own["chunks"] if name in layout.arrays else layout.lengths(kind.dims),
            shards=own.get("shards") if name in layout.arrays else None,
            dtype=kind.dtype,
            fill_value=kind.fill,
            dimension_names=kind.dims,
            attributes=kind.attributes,
            compressors=own["compressors"],
        )
        if name in layout.axes:
            array[:] = axes[name].values
    columns = 1 + len(names) + sum(map(_fact_size, names))
    group.create_array(
        _MARKS,
        shape=(len(layout.parts), columns),
        chunks=(1, columns),
        compressors=None,
        dtype="f8",
        fill_value=0,
    )
    later = ("zarr.json", f"{_PARTS}/zarr.json")
    fixed = {
        k: seal("", k, value.to_bytes()) for k, value in kept.items() if k not in later
    }
    group[_PARTS].attrs.update({"arrays": names, "objects": fixed})
    with (
        warnings.catch_warnings()
    ):  # consolidated metadata are not yet in Zarr's specification
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(group.store, zarr_format=3)
    objects = {key: bytes(value.to_bytes()) for key, value in kept.items()}
    root = json.loads(objects.pop("zarr.json"))
    root["attributes"][CHECKSUM] = _description_checksum(root)
    return objects | {"zarr.json": json.dumps(root, indent=2).encode()}


def _put(store: Any, objects: Mapping[str, bytes]) -> None:
    from zarr.core.buffer import default_buffer_prototype

    make = default_buffer_prototype().buffer.from_bytes
    for key, value in objects.items():
        _result_of(store.set(key, make(value)))


@dataclass(frozen=True)
class MapFile:
    """A map in a store, from `at`."""

    address: Any
    attributes: Mapping[str, Any]
    inner: Any

    @classmethod
    def at(cls, address: Any) -> MapFile:
        """Open an existing map.

        Raises
        ------
        InputError
            If there is no map, one of another version, or a damaged one.
        """
        store = _stored(address)
        return cls(address, _checked_attributes(address, store), store)

    @classmethod
    def create(cls, address: Any, layout: Layout) -> None:
        """Create a map without computed parts, completely or not at all."""
        objects, place = _objects(layout), local_path(address)
        with reached(address):
            if place is None:
                _put(_stored(address), objects)
                return
            create_folder(place, lambda new: _put(_stored(new), objects))

    @property
    def where(self) -> str:
        """The address, for messages."""
        return one_line(str(self.address))

    @cached_property
    def names(self) -> list[str]:
        """Names of the arrays that are split into parts."""
        return list(self._group[_PARTS].attrs["arrays"])

    @property
    def _fixed(self) -> dict[str, int]:
        """Checksums of the objects that describe the map, by key."""
        return dict(self._group[_PARTS].attrs["objects"])

    @cached_property
    def _group(self) -> Any:
        mode = "r" if self.inner.read_only else "r+"
        with reached(self.address, "description of the map cannot be used", _RESTORE):
            return zarr_library().open_group(self.inner, mode=mode, use_consolidated=True)

    @cached_property
    def described(self) -> dict[str, Any]:
        """Zarr arrays by name, without checking their contents."""
        with reached(self.address, "description of the map cannot be used", _RESTORE):
            return dict(self._group.arrays()) | {_MARKS: self._group[_MARKS]}

    @cached_property
    def parts(self) -> Parts:
        """Parts of the map."""
        state = self.described["state"]
        return Parts(tuple(state.shape), tuple(state.shards or state.chunks))

    def count(self, part: int) -> int:
        """Return the number of postures in a part."""
        return prod(s.stop - s.start for s in self.parts.box(part))

    def _keys(self, part: int) -> list[str]:
        """Return the keys of the objects of a part."""
        cell = (*self.parts.cell(part), 0)
        arrays = [self.described[name] for name in self.names]
        codes = [array.metadata.encode_chunk_key(cell[: array.ndim]) for array in arrays]
        return [f"{name}/{code}" for name, code in zip(self.names, codes, strict=True)]

    def marks(self) -> dict[int, Array]:
        """Marks of the parts that have one: checksum of the mark, of each object,
        statistics.
        """
        there = sorted(_result_of(_numbers(self.inner, f"{_MARKS}/c/")))
        return {part: self._mark(part) for part in there if part < len(self.parts)}

    def _mark(self, part: int) -> Array:
        from cartstiff.wings.maps.sealed import RECOMPUTED

        key, array = f"{_MARKS}/c/{part}/0", self.described[_MARKS]
        text = _read(self.inner, key) or b""
        row = np.frombuffer(text if len(text) == 8 * array.shape[1] else b"", "<f8")
        if not row.size or row[0] != self._sealed_row(part, row):
            raise InputError(
                f"map is damaged: {key} is not what was written there",
                where=self.where,
                expected=RECOMPUTED,
            )
        return row

    def _sealed_row(self, part: int, row: Array) -> int:
        """Return the checksum of a mark, which is never 0."""
        from cartstiff.wings.maps.sealed import seal

        return 1 + seal(self.attributes[CHECKSUM], f"{_MARKS}/{part}", row[1:].tobytes())

    def store(self, marks: Mapping[int, Array]) -> Any:
        """Return the store that reads only objects that agree with their marks."""
        from cartstiff.wings.maps.sealed import SealedStore

        names = self.names
        seals = {
            part: row[1 : 1 + len(names)].astype(np.int64) for part, row in marks.items()
        }
        about = self.attributes[CHECKSUM], self._fixed, names, self.parts.cuts, seals
        pieces = {}
        for name, a in self.described.items():
            if name != _MARKS:
                size = prod(a.chunks)
                in_shard = prod(a.shards) // size if a.shards else 0
                pieces[name] = (size * a.dtype.itemsize, in_shard)
        return SealedStore(self.inner, *about, pieces)

    @cached_property
    def _unread(self) -> Any:
        """The group as of a map without written parts."""
        return zarr_library().open_group(self.store({}), mode="r+", use_consolidated=True)

    def done(self) -> list[int]:
        """Parts that have a mark and all their objects, in order."""
        listed = _result_of(_listed(self.inner))
        return [part for part in self.marks() if listed.issuperset(self._keys(part))]

    def is_done(self, part: int) -> bool:
        """Whether a part has its mark."""
        return _read(self.inner, f"{_MARKS}/c/{part}/0") is not None

    def forget(self, parts: Iterable[int]) -> None:
        """Remove the marks of parts, so that they are computed anew."""
        for part in parts:
            _result_of(self.inner.delete(f"{_MARKS}/c/{part}/0"))

    def facts(self) -> dict[str, Array]:
        """Statistics of the completed parts for the summary, by array."""
        sizes = [_fact_size(name) for name in self.names]
        first = 1 + len(sizes) + np.concatenate([[0], np.cumsum(sizes)])
        marks = np.array([*self.marks().values()]).reshape(-1, int(first[-1]))
        found = {
            n: marks[:, i : i + k]
            for n, i, k in zip(self.names, first, sizes, strict=False)
        }
        return {name: rows for name, rows in found.items() if rows.shape[1]}

    def write(self, part: int, arrays: dict[str, Array]) -> None:
        """Write the arrays of a part, which are removed from `arrays`,
        and then its mark.
        """
        group, facts = self._unread, []
        for name in self.names:
            # Chunks that hold only the fill value are written as well.
            array = group[name].with_config({"write_empty_chunks": True})
            kept = arrays.pop(name).astype(array.dtype, copy=False)
            array[self.parts.box(part)[: array.ndim]] = kept
            if name not in PLACES:
                facts.append(fact(name, kept))
        row = np.concatenate(
            [[0.0], [group.store.written.pop(key) for key in self._keys(part)], *facts]
        )
        row[0] = self._sealed_row(part, row)
        _put(self.inner, {f"{_MARKS}/c/{part}/0": row.astype("<f8").tobytes()})

    def complete(self, layout: Layout) -> None:
        """Write what is missing of the objects that describe the map,
        and check the others.
        """
        from cartstiff.wings.maps.sealed import RECOMPUTED, seal

        fixed = self._fixed
        for key, value in _objects(layout).items():
            if key not in fixed:
                continue
            if (there := _read(self.inner, key)) is None:
                _put(self.inner, {key: value})
            elif seal("", key, there) != fixed[key]:
                raise InputError(
                    f"map is damaged: {key} is not what was written there",
                    where=self.where,
                    expected=RECOMPUTED,
                )

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes on this machine from computing the same folder.

        Other stores are not locked: several processes would write equal objects.

        Raises
        ------
        InputError
            If another process computes this map.
        """
        import fcntl

        if (folder := local_path(self.address)) is None:
            yield
            return
        handle = os.open(folder, os.O_RDONLY)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(
                    "another process or thread is computing this map", where=self.where
                ) from None
            except OSError:  # file systems without locks
                pass
            remove_abandoned(folder.absolute().parent)
            for path in folder.rglob("*.partial"):  # left by a killed process
                path.unlink(missing_ok=True)
            yield
        finally:
            os.close(handle)


def open_map(path: Any) -> xarray.Dataset:
    """Open a map as labelled arrays, which are read when they are used.

    Parameters
    ----------
    path : path, address or store
        Written by `compute_map`, complete or not.

    Returns
    -------
    xarray.Dataset
        The dataset of `xarray.open_zarr` without damaged parts, with ``q`` (..., joint)
        of grids. Variables: every quantity over the map's dimensions; ``state`` (0 is
        regular; the attribute ``flag_meanings`` names the others, 255 is not computed);
        ``position`` (..., xyz) of the body frame's origin in F. Attributes: mechanism,
        frame, units, versions, the command, and ``chunks_done`` of ``chunks``. The arrays
        are split like the store, so that reductions of a large map need little memory.

    Raises
    ------
    InputError
        If there is no map, or its description is damaged; a damaged part is refused when
        read.
    MissingDependencyError
        Without xarray, zarr or dask.
    """
    file = MapFile.at(path)
    marks = file.marks()
    dims = file.described["state"].metadata.dimension_names
    dataset = _opened(
        file.store(marks),
        file.names,
        dict(zip(dims, file.parts.chunk, strict=True)),
        path,
    )
    dataset.attrs["chunks_done"] = len(marks)
    dataset.attrs["chunks"] = len(file.parts)
    return with_postures(dataset)


def empty_dataset(layout: Layout) -> xarray.Dataset:
    """Return the dataset of a map of which nothing has been computed, without a file."""
    store = zarr_library().storage.MemoryStore()
    _put(store, _objects(layout))
    dims = layout.sampling.dims
    return _opened(store, layout.arrays, dict(zip(dims, layout.chunk, strict=True)))


class _Readable:
    """An array of a file, whose errors are one line: codecs raise any kind."""

    def __init__(self, variable: Any, address: Any) -> None:
        self.variable, self.address = variable, address
        self.shape, self.dtype, self.ndim = variable.shape, variable.dtype, variable.ndim

    def __getitem__(self, key: Any) -> Array:
        with reached(self.address, "map cannot be read", _RESTORE):
            return np.asarray(self.variable[key].values)


def _opened(
    store: Any, names: Iterable[str], chunks: dict[str, int], address: Any = "map"
) -> xarray.Dataset:
    needed = {"purpose": "reading a map", "extra": "maps"}
    open_zarr = imported("xarray", package="xarray", **needed).open_zarr
    from_array = imported("dask.array", package="dask", **needed).from_array
    with reached(address, "map cannot be read", _RESTORE):
        dataset: xarray.Dataset = open_zarr(store, chunks=None, consolidated=True)
        del dataset.attrs[CHECKSUM]
        for name in names:
            whole = dataset.variables[name]
            split = [chunks.get(str(dim), n) for dim, n in whole.sizes.items()]
            data = from_array(_Readable(whole, address), split, name=False, asarray=False)
            dataset[name] = whole.dims, data, whole.attrs, whole.encoding
    # Zarr lists arrays by name.
    return dataset[[name for name in names if name in dataset.data_vars]]


def with_postures(dataset: xarray.Dataset) -> xarray.Dataset:
    """Add names of joints and axes, and the postures of a grid, to a map."""
    import xarray

    joints = json.loads(dataset.attrs["description"])["joints"]
    if "q" not in dataset:  # lazily, from the axes and the constant coordinates
        zero = xarray.zeros_like(dataset["state"], float).drop_attrs()
        held = dataset.attrs
        names = [dimension_name(name) for name in joints]
        columns = [
            zero + dataset.coords.get(name, held.get(f"fixed_{name}")) for name in names
        ]
        q = xarray.concat(columns, "joint").transpose(..., "joint")
        dataset["q"] = q.dims, q.data, {"long_name": "coordinates of the posture"}
    # As objects they are strings of any length, as Zarr 3 stores them.
    labels = {"joint": np.array(joints, object), "xyz": np.array(["x", "y", "z"], object)}
    return dataset.assign_coords(labels)
