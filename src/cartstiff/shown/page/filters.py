"""Meshes of a page as a file, in an order that compresses to half.

Neighbouring corners and triangles of a mesh are alike: the differences of their numbers,
byte by byte, have far less to say than the numbers. ``static/filters.js`` restores them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.core.errors import imported

# Commands that are shorter stay as they are.
_LEAST = 4096
#: Types of meshcat's typed arrays by their extension code, and numbers of each entry.
_TYPES: dict[int, tuple[type[np.generic], int]] = {
    0x11: (np.int8, 3),  # normals
    0x12: (np.uint8, 3),  # colours
    0x14: (np.uint16, 1),  # triangles
    0x16: (np.uint32, 1),
    0x17: (np.float32, 3),  # positions
}
# Halvings of a mesh's size that make its grid, at most.
_FINEST = 16

#: Command, first byte, how many numbers, bytes of each, numbers of an entry, grid or 0.
Filter = tuple[int, int, int, int, int, float]


def filtered(commands: list[bytes]) -> tuple[list[bytes], list[Filter]]:
    """Commands with the numbers of their arrays as differences, and what was changed."""
    unpack = imported("msgpack", "msgpack", "a picture in a page").unpackb
    changed, filters = list(commands), list[Filter]()
    for k, command in enumerate(commands):
        if len(command) < _LEAST or command.startswith(b"{"):
            continue
        arrays: list[tuple[int, bytes]] = []

        def keep(code: int, data: bytes, held: Any = arrays) -> None:
            held.append((code, data))

        unpack(command, ext_hook=keep, strict_map_key=False)
        for code, data in arrays:
            kind, stride = _TYPES.get(code, (np.uint8, 0))
            values = np.frombuffer(data, kind)
            if not stride or not len(values) or len(values) % stride:
                continue
            if (found := _whole(values, stride)) is None:
                continue
            at, (numbers, grid) = command.index(data), found
            own = _differences(numbers, stride)
            changed[k] = changed[k][:at] + own + changed[k][at + len(own) :]
            filters.append((k, at, len(values), values.itemsize, stride, grid))
    return changed, filters


def _whole(values: Any, stride: int) -> tuple[Any, float] | None:
    """Whole numbers and their grid; 0 for what is whole, None where there is no grid."""
    if values.dtype != np.float32:
        return values, 0.0
    size = float(np.ptp(values.reshape(-1, stride), axis=0).max())
    if not 0.0 < size < np.inf:
        return None
    for halvings in range(10, _FINEST):
        grid = 2.0 ** (np.floor(np.log2(size)) - halvings)
        whole = np.round(values / grid)
        if np.abs(whole).max() < 2**30 and np.array_equal(whole * grid, values):
            return whole.astype(np.int32), float(grid)
    return None


def _differences(values: Any, stride: int) -> bytes:
    """Differences of the numbers one after the other, signs last, in planes of bytes."""
    bits = 8 * values.itemsize
    columns = values.reshape(-1, stride).T.astype(np.int64)
    steps = np.diff(columns, axis=1, prepend=0).ravel()
    # As signed numbers of the same size.
    steps = (steps + (1 << (bits - 1))) % (1 << bits) - (1 << (bits - 1))
    signless = (steps << 1) ^ (steps >> 63)
    planes = [(signless >> shift) & 255 for shift in range(0, bits, 8)]
    return b"".join(plane.astype(np.uint8).tobytes() for plane in planes)
