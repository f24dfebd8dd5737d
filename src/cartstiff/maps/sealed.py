"""A Zarr store that compares its objects with checksums of their bytes and keys."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from zarr.storage import WrapperStore

from cartstiff.arrays import Array
from cartstiff.errors import InputError, one_line


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
    seals : ndarray (parts, arrays)
        Checksums of the parts; -1 for parts that have not been written, whose objects do not
        exist; -2 where the checksum is unknown.
    """

    def __init__(
        self,
        store: Any,
        salt: str,
        fixed: dict[str, int],
        names: list[str],
        cuts: tuple[int, ...],
        seals: Array,
    ) -> None:
        super().__init__(store)
        self.about = salt, fixed, names, cuts, seals
        self.written: dict[str, int] = {}

    def _with_store(self, store: Any) -> SealedStore:
        return SealedStore(store, *self.about)

    async def set(self, key: str, value: Any) -> None:
        """Write an object and keep its checksum."""
        self.written[key] = seal(self.about[0], key, value.as_numpy_array().data)
        await super().set(key, value)

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        """Read an object, or a byte range of it after the whole object has been checked."""
        expected, salt, place = self._expected(key)
        if expected is None:
            return await super().get(key, prototype, byte_range)
        if expected == -1:
            return None
        value = await super().get(key, prototype)
        if value is None or seal(salt, key, value.as_numpy_array().data) != expected:
            raise InputError(
                f"{place} is damaged: {one_line(key)} is missing, or not what was written there",
                where=one_line(str(self._store)),
                expected="to be computed anew by the same command with --verify",
            )
        if byte_range is None:
            return value
        first = getattr(byte_range, "start", getattr(byte_range, "offset", None))
        if first is None:
            first = max(0, len(value) - byte_range.suffix)
        return value[first : getattr(byte_range, "end", len(value))]

    def _expected(self, key: str) -> tuple[int | None, str, str]:
        """Return the checksum of an object (-1: does not exist, None: no checksum), salt, place."""
        salt, fixed, names, cuts, seals = self.about
        name, _, cell = key.partition("/c/")
        if name not in names or not cell:
            return fixed.get(key), "", "map"
        index = (*map(int, cell.split("/")), *[0] * len(cuts))[: len(cuts)]
        part = int(np.ravel_multi_index(index, cuts))
        return int(seals[part, names.index(name)]), salt, f"part {part + 1} of {len(seals)}"
