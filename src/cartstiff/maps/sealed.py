"""A store of Zarr whose objects are compared with checksums of their bytes and places."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from zarr.storage import WrapperStore

from cartstiff.errors import InputError, one_line
from cartstiff.geometry.se3 import Array


def seal(salt: str, key: str, value: bytes | memoryview) -> int:
    """Checksum of an object, of its key, and of the map that it belongs to."""
    return zlib.crc32(value, zlib.crc32(f"{salt}/{key}".encode()))


class SealedStore(WrapperStore):  # type: ignore[type-arg]
    """What is written is sealed; nothing is read that does not agree with its seal.

    Parameters
    ----------
    store : zarr.abc.store.Store
        Where the objects are.
    salt : str
        What distinguishes the map from others.
    fixed : mapping of str to int
        Seals of objects that do not belong to parts, by key.
    names : list of str
        Arrays that are cut into parts, in the order of the columns of `seals`.
    cuts : tuple of int
        Number of parts along each dimension.
    seals : ndarray (parts, arrays)
        Seals of the parts; -1 where a part has not been written: such objects do not exist; -2
        where that is not known.
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
        """Write an object, and remember its seal."""
        self.written[key] = seal(self.about[0], key, value.as_numpy_array().data)
        await super().set(key, value)

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        """An object, or a part of one that is whole."""
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
        """Seal of an object (-1: it does not exist, None: it has none), its salt, and its place."""
        salt, fixed, names, cuts, seals = self.about
        name, _, cell = key.partition("/c/")
        if name not in names or not cell:
            return fixed.get(key), "", "map"
        index = (*map(int, cell.split("/")), *[0] * len(cuts))[: len(cuts)]
        part = int(np.ravel_multi_index(index, cuts))
        return int(seals[part, names.index(name)]), salt, f"part {part + 1} of {len(seals)}"
