"""Commands of many frames in little room: transforms as single-precision numbers, labels as text.

Only pictures lose digits (five are left); the page's numbers are never touched.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from cartstiff.errors import imported
from cartstiff.page.recording import Key

__all__ = ["compacted"]

_MATRIX = struct.Struct(">" + "Bd" * 16)
# Columns of T without their last entries, which are 0, 0, 0, 1.
_KEPT = [0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14]
# Bits of a float32 that a picture of a thousand dots does not need.
_MASK = np.uint32(0xFFFFFF80)


def compacted(
    commands: Mapping[int, tuple[Key, bytes]], lists: Iterable[list[int]]
) -> tuple[dict[str, Any], list[bytes]]:
    """A table of commands, and its binary parts; the numbers in `lists` are rewritten to it.

    Parameters
    ----------
    commands : mapping
        Key and packed command by number.
    lists : iterable of list of int
        Every list of numbers there is; changed in place.

    Returns
    -------
    dict
        "transforms": path of each; "labels": text, colours, size and path of each.
    list of bytes
        The transforms' numbers, byte planes one after the other (they zip better so), and the
        commands that are neither.
    """
    lists = list(lists)
    used = sorted({number for numbers in lists for number in numbers})
    transforms, labels, others = [], [], []
    for number in used:
        (kind, path, _), packed = commands[number]
        if kind == "set_transform" and len(packed) > _MATRIX.size:
            transforms.append((path, number, _MATRIX.unpack(packed[-_MATRIX.size :])[1::2]))
        elif kind == "set_object" and (label := _label(packed, path)) is not None:
            labels.append((label, number))
        else:
            others.append((packed, number))
    transforms.sort(key=lambda entry: entry[:2])
    order = [n for _, n, _ in transforms] + [n for _, n in labels] + [n for _, n in others]
    renamed = {number: i for i, number in enumerate(order)}
    for numbers in lists:
        numbers[:] = [renamed[number] for number in numbers]
    matrices = np.array([m for _, _, m in transforms]).reshape(-1, 16)[:, _KEPT]
    single = (np.ascontiguousarray(matrices, "<f4").view("<u4") & _MASK).view(np.uint8)
    paths = sorted({path for path, _, _ in transforms})
    table = {
        "paths": paths,
        "transforms": [paths.index(path) for path, _, _ in transforms],
        "labels": [label for label, _ in labels],
    }
    return table, [np.ascontiguousarray(single.T).tobytes(), *(packed for packed, _ in others)]


def _label(packed: bytes, path: str) -> dict[str, Any] | None:
    """What a label says, if that is all it is."""
    if b"SpriteMaterial" not in packed or b"userData" not in packed:
        return None
    msgpack = imported("msgpack", "msgpack", "a picture in a page")
    sprite = msgpack.unpackb(packed)["object"]["object"]
    return {"path": path, "height": sprite["scale"][1], **sprite["userData"]}
