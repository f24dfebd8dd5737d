"""What tells a whole map from a damaged one: a checksum of every file, and no links.

Zarr's codec appends the CRC-32C of each chunk to its file. What describes the arrays (the
``zarr.json`` of the folder and of each array) has one checksum in the folder's attributes.
"""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cartstiff.errors import InputError, MissingDependencyError, one_line

__all__ = ["CHECKSUM", "described", "description_checksum", "file_damage", "require_plain_files"]

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
                "is a link" if stat.S_ISLNK(mode) else "is no file", where=one_line(str(path)),
                expected="files and folders only in a map",
            )  # fmt: skip


def description_checksum(folder: Path) -> str:
    """SHA-256 of what describes the folder (less this checksum itself) and its arrays."""
    found = hashlib.sha256()
    root = json.loads(_text(folder / "zarr.json"))
    root["attributes"].pop(CHECKSUM, None)
    found.update(json.dumps(root, sort_keys=True).encode())
    for path in sorted(folder.glob("*/zarr.json")):
        found.update(path.parent.name.encode() + b"\0" + _text(path).encode() + b"\0")
    return found.hexdigest()


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
        found = attributes["schema"]
    except OSError as error:
        raise InputError("map cannot be read", where=where, got=error.strerror) from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            "is no map, or its zarr.json is damaged", where=where, expected=_ANEW
        ) from None
    if found != schema:
        raise InputError("is a map of another version", where=where, expected=f"schema {schema}",
                         got=found)  # fmt: skip
    try:
        whole = attributes[CHECKSUM] == description_checksum(folder)
    except (OSError, ValueError, KeyError, TypeError):
        whole = False
    if not whole:
        raise InputError("map is damaged: a zarr.json in it does not agree with its checksum",
                         where=where, expected=_ANEW)  # fmt: skip
    return dict(attributes)


def _text(path: Path) -> str:
    if path.stat().st_size > _LARGEST_DESCRIPTION:
        raise ValueError("too large")
    return path.read_text(encoding="utf-8")


def file_damage(path: Path, largest: int) -> str | None:
    """What is wrong with the file of a chunk, whose content has at most `largest` bytes."""
    try:
        from google_crc32c import value as crc32c
    except ImportError:
        raise MissingDependencyError(
            package="google-crc32c", purpose="verifying a map", extra="maps"
        ) from None
    try:
        # A compressor adds a little to what it cannot compress.
        if path.stat().st_size > largest + largest // 8 + 1024:
            return "is too large"
        data = path.read_bytes()
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    if len(data) < 4 or int.from_bytes(data[-4:], "little") != crc32c(data[:-4]):
        return "does not agree with its checksum"
    return None
