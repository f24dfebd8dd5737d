"""A map as labelled arrays; nothing is read that does not agree with its checksum."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from itertools import product
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.checked_call import checked
from cartstiff.errors import InputError, MissingDependencyError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.maps.damage import CHECKSUM
from cartstiff.maps.sampling import Sampling, from_dict
from cartstiff.maps.store import MapFile

if TYPE_CHECKING:
    import xarray


class _Lazy(ABC):
    """An array of which boxes are made when they are asked for."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @abstractmethod
    def box(self, ends: list[tuple[int, int]]) -> Array:
        """The part between two indices of each dimension."""

    def __getitem__(self, key: tuple[slice | int, ...]) -> Array:
        ends: list[tuple[int, int]] = []
        inner: list[slice | int] = []
        for k, n in zip(key, self.shape, strict=True):
            if isinstance(k, slice):
                indices = range(*k.indices(n))
                low = min(indices[0], indices[-1]) if indices else 0
                ends.append((low, max(indices[0], indices[-1]) + 1 if indices else 0))
                inner.append(slice(None, None, k.step))
            else:
                ends.append((int(k), int(k) + 1))
                inner.append(0)
        return self.box(ends)[tuple(inner)]


class StoredArray(_Lazy):
    """An array of a map's file. Parts that are not done read as the fill value."""

    def __init__(self, file: MapFile, name: str) -> None:
        self.file, self.name = file, name
        array = file.arrays[name]
        self.shape, self.dtype, self.chunks = array.shape, array.dtype, array.chunks

    def box(self, ends: list[tuple[int, int]]) -> Array:
        """Read from the chunks that the box touches, each verified."""
        file, array = self.file, self.file.arrays[self.name]
        part = np.full([b - a for a, b in ends], array.fill_value, self.dtype)
        for place in product(
            *(range(a // c, ceil(b / c)) for (a, b), c in zip(ends, self.chunks, strict=True))
        ):
            chunk = file.chunk_at(place)
            if not file.is_done(chunk):
                continue
            if (what := file.damage(chunk, self.name)) is not None:
                raise file.refused(chunk, what)
            there = [
                (max(i * c, a), min((i + 1) * c, b))
                for i, c, (a, b) in zip(place, self.chunks, ends, strict=True)
            ]
            here = tuple(slice(a - s, b - s) for (a, b), (s, _) in zip(there, ends, strict=True))
            part[here] = array[tuple(slice(*pair) for pair in there)]
        return part


class _Postures(_Lazy):
    """The coordinates of a sampling, computed."""

    def __init__(self, sampling: Sampling, n: int) -> None:
        self.sampling, self.shape = sampling, (*sampling.shape, n)
        self.dtype = np.dtype(float)

    def box(self, ends: list[tuple[int, int]]) -> Array:
        """Compute the postures of a box."""
        q = self.sampling.postures(tuple(slice(*pair) for pair in ends[:-1]), None)
        return q.reshape(*(b - a for a, b in ends[:-1]), -1)[..., slice(*ends[-1])]


@checked
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

    def lazy(array: Any, chunks: tuple[int, ...]) -> Any:
        options = {"asarray": False, "fancy": False, "meta": np.empty(0, array.dtype)}
        return dask.array.from_array(array, chunks=chunks, **options)  # type: ignore[no-untyped-call]

    variables = {}
    own = ("state", "position", "q", "branches")
    for name in (*(part for part in parts if part not in own), *own):
        if name in parts:
            stored = StoredArray(file, name)
            about = file.arrays[name].metadata
            variables[name] = (
                about.dimension_names,
                lazy(stored, stored.chunks),
                dict(about.attributes),
            )
    if "q" not in parts:
        if sampling is None:
            raise InputError("the map does not say where it looked", where=one_line(str(path)))
        variables["q"] = (
            (*sampling.dims, "joint"),
            lazy(_Postures(sampling, len(joints)), (*file.chunk, len(joints))),
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
