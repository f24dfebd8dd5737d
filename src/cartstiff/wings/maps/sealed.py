"""A Zarr store that compares its objects with checksums of their bytes and keys."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np
from zarr.storage import WrapperStore

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, one_line

#: What to do about a damaged object of a map.
RECOMPUTED = "the file as it was written; without it, the same command computes it anew"
# Instead of the checksum of objects that do not exist.
_NOT_WRITTEN = -1


def seal(salt: str, key: str, value: bytes | memoryview) -> int:
    """Return the checksum of an object, its key, and the map that it belongs to."""
    return zlib.crc32(value, zlib.crc32(f"{salt}/{key}".encode()))


class SealedStore(WrapperStore):  # type: ignore[type-arg]
    """A Zarr store that computes a checksum of what it writes and checks what it reads.

    Parameters
    ----------
    store : zarr.abc.store.Store
        Store of the objects.
    salt : str
        Checksum of the map's description, which distinguishes it from other maps.
    fixed : mapping of str to int
        Checksums of objects that do not belong to parts, by key.
    names : list of str
        Arrays that are split into parts, in the order of the columns of `seals`.
    cuts : tuple of int
        Number of parts along each dimension.
    seals : mapping of int to ndarray (arrays,)
        Checksums of the parts that have been written; the objects of the others do not
        exist.
    pieces : mapping of str to (int, int)
        Bytes of each compressed piece of an array, and number of pieces of a part; 0
        where a part is one piece.
    """

    def __init__(
        self,
        store: Any,
        salt: str,
        fixed: dict[str, int],
        names: list[str],
        cuts: tuple[int, ...],
        seals: Mapping[int, Array],
        pieces: Mapping[str, tuple[int, int]],
    ) -> None:
        super().__init__(store)
        self.about = salt, fixed, names, cuts, seals
        self.pieces = pieces
        self.written: dict[str, int] = {}

    def _with_store(self, store: Any) -> SealedStore:
        return SealedStore(store, *self.about, self.pieces)

    async def set(self, key: str, value: Any) -> None:
        """Write an object and keep its checksum."""
        self.written[key] = seal(self.about[0], key, value.as_numpy_array().data)
        await super().set(key, value)

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        """Read an object, or a byte range of it after the whole object has
        been checked.
        """
        expected, salt, place = self._expected(key)
        if expected is None:
            return await super().get(key, prototype, byte_range)
        if expected == _NOT_WRITTEN:
            return None
        value = await super().get(key, prototype)
        if value is None or seal(salt, key, value.as_numpy_array().data) != expected:
            raise InputError(
                f"{place} is damaged: {one_line(key)} is missing, or not what was "
                "written there",
                where=one_line(str(self._store)),
                expected=RECOMPUTED,
            )
        name, is_chunk, _ = key.partition("/c/")
        if is_chunk and name in self.pieces:
            size, count = self.pieces[name]
            if (claimed := _largest_piece(value.as_numpy_array(), count)) > size:
                raise InputError(
                    f"{place} cannot be used: {one_line(key)} is larger than its array",
                    where=one_line(str(self._store)),
                    expected=f"at most {size} bytes",
                    got=claimed,
                )
        if byte_range is None:
            return value
        first = getattr(byte_range, "start", getattr(byte_range, "offset", None))
        if first is None:
            first = max(0, len(value) - byte_range.suffix)
        return value[first : getattr(byte_range, "end", len(value))]

    def _expected(self, key: str) -> tuple[int | None, str, str]:
        """Return the checksum of an object (None: it has none), salt and place."""
        salt, fixed, names, cuts, seals = self.about
        name, _, cell = key.partition("/c/")
        if name not in names or not cell:
            return fixed.get(key), "", "map"
        index = (*map(int, cell.split("/")), *[0] * len(cuts))[: len(cuts)]
        part = int(np.ravel_multi_index(index, cuts))
        own = int(seals[part][names.index(name)]) if part in seals else _NOT_WRITTEN
        return own, salt, f"part {part + 1} of {prod(cuts)}"


# Header of compressed bytes: the size that a reader allocates for them is its second
# word.
_HEADER = 16


def _largest_piece(value: Array, count: int) -> int:
    """Bytes to which the largest of `count` compressed pieces expands; 0:
    the object is one.

    The places of pieces are at the end of the object, each with its length; then a
    checksum.
    """
    starts = np.zeros(1, np.uint64)
    if count and len(value) >= 16 * count + 4:
        starts = value[len(value) - 16 * count - 4 : -4].copy().view("<u8")[::2]
    known = starts[starts <= max(0, len(value) - _HEADER)].astype(np.int64)
    if len(value) < _HEADER or not len(known):
        return 0
    return int(value[known[:, None] + np.arange(4, 8)].copy().view("<u4").max())
