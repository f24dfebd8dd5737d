"""Samplings of a map: grids of coordinates, random postures, trajectories;
and its chunks.

A sampling has named dimensions with a shape, and returns the postures of any box in it.
The numbers do not depend on the boxes, so that a map can be split, interrupted and
resumed. The chunks are the parts of a map that are computed and stored one by one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, prod
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import (
    Array,
    checked_array,
    checked_number,
    checked_seed,
    checked_vector,
    named_values,
    real_array,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, UnknownNameError, checked_kind
from cartstiff.core.mechanisms.elastic import ElasticMechanism

# Number of random postures drawn from one seed.
_RANDOM_BLOCK = 1024
# Largest number of values of an axis, all of which are in memory.
_MAX_AXIS_VALUES = 10**7


@dataclass(frozen=True)
class Axis:
    """Equally spaced values.

    Attributes
    ----------
    low, high : float
        First and last value, in the unit of the coordinate.
    count : int
        Number of values.

    Raises
    ------
    InputError
        For ends that are not finite, or an axis that does not rise.
    """

    low: float
    high: float
    count: int

    def __post_init__(self) -> None:
        for name in ("low", "high", "count"):
            checked_number(getattr(self, name), f"{name} of an axis")
        if not (np.isfinite(self.low) and np.isfinite(self.high)):
            raise InputError("ends of an axis must be finite", got=(self.low, self.high))
        if not 1 <= self.count <= _MAX_AXIS_VALUES:
            raise InputError(
                "an axis cannot have so many values",
                expected=f"1 to {_MAX_AXIS_VALUES}",
                got=self.count,
            )
        if self.count > 1 and not self.high > self.low:
            raise InputError(
                "an axis must rise", expected="low < high", got=(self.low, self.high)
            )

    @property
    def values(self) -> Array:
        """The values (count,)."""
        return np.linspace(self.low, self.high, self.count)

    def as_list(self) -> list[float]:
        """Return low, high and count for JSON."""
        return [float(self.low), float(self.high), int(self.count)]


def as_axis(name: str, axis: Any) -> Axis:
    """Return an axis, which may be given by its three numbers."""
    if isinstance(axis, Axis):
        return axis
    try:
        low, high, count = (float(x) for x in axis)
        if count.is_integer():
            return Axis(low, high, int(count))
    except (TypeError, ValueError):
        pass
    raise InputError("not an axis", where=name, expected="low, high, count", got=axis)


def checked_axes(axes: Any, known: Sequence[str], what: str) -> dict[str, Axis]:
    """Return the axes of a grid by name, all of which are known."""
    checked_kind(axes, Mapping, "axes of a grid", "names and (low, high, count)")
    for name in axes:
        if name not in known:
            raise UnknownNameError(what, name, known)
    return {name: as_axis(name, axis) for name, axis in axes.items()}


class Sampling(ABC):
    """Postures in an array of one or more dimensions.

    Attributes
    ----------
    dims : tuple of str
        Names of the dimensions.
    shape : tuple of int
        Their lengths.
    whole : tuple of str
        Dimensions that are never split.
    stores_q : bool
        Whether the file keeps the coordinates of the postures, because computing them
        again takes time.
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    whole: tuple[str, ...] = ()
    stores_q: bool = False
    #: Whether the postures satisfy the loop closures.
    is_closed: bool = False
    #: Axes of the dimensions that have values.
    axes: Mapping[str, Axis] = MappingProxyType({})

    @property
    def size(self) -> int:
        """Number of postures."""
        return prod(int(n) for n in self.shape)

    @abstractmethod
    def postures(
        self, box: tuple[slice, ...], elastic: ElasticMechanism | None = None
    ) -> Array:
        """Coordinates (m, n) of the postures of a box in C order;
        NaN rows where there is none.

        Only samplings of poses need the mechanism.
        """

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Everything that determines the postures, for JSON."""


def dimension_name(coordinate: str) -> str:
    """The name of a coordinate's dimension: in a file a slash would start a folder."""
    return coordinate.replace("/", ".")


def grid_indices(box: tuple[slice, ...]) -> tuple[Array, ...]:
    """Return the indices of all cells of a box along each dimension, in C order."""
    ranges = np.meshgrid(*(np.arange(s.start, s.stop) for s in box), indexing="ij")
    return tuple(r.ravel() for r in ranges)


class Grid(Sampling):
    """All combinations of values of some coordinates; the other coordinates are constant.

    Parameters
    ----------
    axes : mapping of str to Axis or (low, high, count)
        Values by coordinate name; the first coordinate varies slowest.
    names : sequence of str
        Names of all coordinates.
    base : array_like (n,)
        Values of the other coordinates.

    Raises
    ------
    InputError
        For unknown names or no axis.
    """

    @checked
    def __init__(
        self,
        axes: Mapping[str, Axis | Sequence[float]],
        names: Sequence[str],
        base: ArrayLike,
    ) -> None:
        self.names = tuple(
            checked_kind(n, str, "name of a coordinate", "text") for n in names
        )
        own = self._own = checked_axes(axes, self.names, "coordinate")
        if not own:
            raise InputError("a grid needs an axis")
        #: Positions of the grid's coordinates in q.
        self.columns = [self.names.index(name) for name in own]
        self.axes = {dimension_name(name): axis for name, axis in own.items()}
        self.base = checked_vector(base, len(self.names), "base")
        self.dims = tuple(self.axes)
        self.shape = tuple(axis.count for axis in self.axes.values())

    @cached_property
    def values(self) -> list[Array]:
        """Values (k,) of each axis, in the units of the coordinates."""
        return [axis.values for axis in self.axes.values()]

    def postures(
        self,
        box: tuple[slice, ...],
        elastic: ElasticMechanism | None = None,  # noqa: ARG002
    ) -> Array:
        """Coordinates (m, n) of the cells of a box."""
        q = np.tile(self.base, (prod(s.stop - s.start for s in box), 1))
        for column, values, cells in zip(
            self.columns, self.values, grid_indices(box), strict=True
        ):
            q[:, column] = values[cells]
        return q

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "kind": "grid",
            "axes": {name: axis.as_list() for name, axis in self._own.items()},
            "names": list(self.names),
            "base": self.base.tolist(),
        }


class RandomPostures(Sampling):
    """Independent postures, uniform between the limits of each coordinate.

    Posture i depends only on the seed and on i. A map stores the postures for other
    readers.

    Parameters
    ----------
    count, seed : int
        Number of postures, and seed of the random numbers.
    lower, upper : array_like (n,)
        Limits; a coordinate with equal limits is constant.

    Raises
    ------
    InputError
        For no postures, or limits that do not rise.
    """

    stores_q = True

    def __init__(self, count: int, seed: int, lower: ArrayLike, upper: ArrayLike) -> None:
        number = checked_number(count, "number of postures")
        if number < 1 or number % 1:
            what = "number of postures is not whole"
            if number < 1:
                what = "no postures were asked for"
            raise InputError(what, expected="1 or more", got=count)
        self.lower = checked_array(lower, ("n",), "lower limits of random postures")
        self.upper = checked_vector(
            upper, len(self.lower), "upper limits of random postures"
        )
        if np.any(self.upper < self.lower):
            raise InputError("limits of random postures must rise")
        self.count, self.seed = int(number), checked_seed(seed)
        self.dims, self.shape = ("posture",), (self.count,)

    @classmethod
    def within_limits(
        cls,
        elastic: ElasticMechanism,
        count: int,
        seed: int = 0,
        ranges: Mapping[str, tuple[float, float]] | None = None,
    ) -> RandomPostures:
        """Draw postures within the limits of a mechanism; compliant links stay
        undeflected.

        Angles without limits are drawn within one turn.

        Parameters
        ----------
        elastic : ElasticMechanism
            Mechanism with the names and limits of the coordinates.
        count, seed : int
            As above.
        ranges : mapping of str to (low, high), optional
            Limits of coordinates instead of the mechanism's; equal ends hold a
            coordinate.

        Raises
        ------
        InputError
            If a distance has no limits and no range is given for it.
        """
        lower, upper = [], []
        for name in ranges or {}:
            if name not in elastic.names:
                raise UnknownNameError("coordinate", name, elastic.names)
        virtual = elastic.mechanism.virtual
        for j, c in enumerate(elastic.mechanism.coordinates):
            own = (elastic.q[j], elastic.q[j]) if j in virtual else (c.lower, c.upper)
            low, high = (ranges or {}).get(c.name, own)
            if not c.is_length:
                low, high = max(low, -np.pi) if np.isinf(low) else low, high
                high = min(high, np.pi) if np.isinf(high) else high
            if not (np.isfinite(low) and np.isfinite(high)):
                raise InputError(
                    f"coordinate {c.name!r} has no limits", expected="a range for it"
                )
            lower.append(low)
            upper.append(high)
        return cls(count, seed, lower, upper)

    def postures(
        self,
        box: tuple[slice, ...],
        elastic: ElasticMechanism | None = None,  # noqa: ARG002
    ) -> Array:
        """Coordinates (m, n) of a range of postures."""
        start, stop = box[0].start, box[0].stop
        first, last = start // _RANDOM_BLOCK, -(-stop // _RANDOM_BLOCK)
        n = len(self.lower)
        drawn = np.empty(((last - first) * _RANDOM_BLOCK, n))
        for i in range(first, last):
            rng = np.random.default_rng([self.seed, i])
            rng.random(
                out=drawn[(i - first) * _RANDOM_BLOCK : (i - first + 1) * _RANDOM_BLOCK]
            )
        q: Array = drawn[start - first * _RANDOM_BLOCK : stop - first * _RANDOM_BLOCK]
        q *= self.upper - self.lower
        q += self.lower
        return q

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "kind": "random",
            "count": self.count,
            "seed": self.seed,
            "lower": self.lower.tolist(),
            "upper": self.upper.tolist(),
        }


class Trajectory(Sampling):
    """A sequence of given postures.

    Parameters
    ----------
    q : array_like (N, n)
        Coordinates.
    time : array_like (N,), optional
        Times; the map keeps them as a coordinate.

    Raises
    ------
    InputError
        For wrong shapes or numbers that are not finite.
    """

    stores_q = True

    def __init__(self, q: ArrayLike, time: ArrayLike | None = None) -> None:
        self.q = checked_array(q, ("m", "n"), "trajectory")
        self.time = None if time is None else checked_vector(time, len(self.q), "time")
        self.dims, self.shape = ("posture",), (len(self.q),)

    @classmethod
    def from_table(
        cls, columns: Mapping[str, ArrayLike], elastic: ElasticMechanism, base: ArrayLike
    ) -> Trajectory:
        """Make a trajectory of columns (N,) by coordinate name, with an optional column
        ``time``.

        Coordinates without a column have the values of `base` (n,).

        Raises
        ------
        UnknownNameError
            For a column that is no coordinate.
        InputError
            If no column is a coordinate.
        """
        base = named_values(real_array(base, "base"), elastic.names, elastic.q, "base")
        names = [name for name in columns if name != "time" or "time" in elastic.names]
        for name in names:
            if name not in elastic.names:
                raise UnknownNameError("column", name, (*elastic.names, "time"))
        if not names:
            raise InputError("a trajectory has no column of a coordinate")
        length = np.size(columns[names[0]])
        q = np.tile(base, (length, 1))
        for name in names:
            q[:, elastic.names.index(name)] = checked_vector(
                columns[name], length, f"column {name}"
            )
        time = columns.get("time") if "time" not in names else None
        return cls(q, time)

    def postures(
        self,
        box: tuple[slice, ...],
        elastic: ElasticMechanism | None = None,  # noqa: ARG002
    ) -> Array:
        """Coordinates (m, n) of a range of postures."""
        return self.q[box[0]].copy()

    def to_dict(self) -> dict[str, Any]:
        """For JSON: a digest in place of the postures, which the file holds."""
        from hashlib import sha256

        digest = sha256(np.ascontiguousarray(self.q).tobytes())
        if self.time is not None:
            digest.update(b"time" + np.ascontiguousarray(self.time).tobytes())
        return {"kind": "trajectory", "count": len(self.q), "sha256": digest.hexdigest()}


# Smallest and largest number of postures in a chunk, and the number of chunks aimed at:
# the second one where the overhead of a chunk exceeds the time of a posture.
_MIN_CHUNK, _TARGET_CHUNKS, _TARGET_LARGE_CHUNKS = 64, 128, 32
MAX_CHUNK = 11 * 2**16


def usual_chunk(count: int, least: int | None = None) -> int:
    """Return the usual number of postures in a chunk: from 64 for small maps to 720896.

    `least` replaces the smallest number for postures that are computed fast.
    """
    if least is None:
        return min(max(count // _TARGET_CHUNKS, _MIN_CHUNK), MAX_CHUNK)
    return min(max(count // _TARGET_LARGE_CHUNKS, least), MAX_CHUNK)


def chunk_shape(sampling: Sampling, postures: int) -> tuple[int, ...]:
    """Return the shape of a chunk of that many postures at most: close to a cube, so that
    slices in any direction cut few chunks.
    """
    shape = list(sampling.shape)
    if len(shape) == 1:
        return (min(shape[0], postures),)
    may_split = [i for i, name in enumerate(sampling.dims) if name not in sampling.whole]
    while prod(shape) > postures:
        i = max(may_split, key=lambda i: shape[i])
        if shape[i] == 1:
            break
        shape[i] = ceil(shape[i] / 2)
    return tuple(shape)
