"""What tells a whole map from a damaged one: a checksum of every file, and no links.

Zarr's codec appends the CRC-32C of each chunk to its file; which one belongs there stands in the
chunk's mark, and for axes in the folder's attributes. What describes the arrays (the ``zarr.json``
of the folder and of each array) has one checksum in the folder's attributes.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cartstiff.errors import InputError, imported, one_line

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
                "is a link" if stat.S_ISLNK(mode) else "is no file",
                where=one_line(str(path)),
                expected="files and folders only in a map",
            )


def description_checksum(folder: Path) -> str:
    """SHA-256 of what describes the folder (less this checksum itself) and its arrays."""
    digest = hashlib.sha256()
    root = json.loads(_text(folder / "zarr.json"))
    root["attributes"].pop(CHECKSUM, None)
    digest.update(json.dumps(root, sort_keys=True).encode())
    for path in sorted(folder.glob("*/zarr.json")):
        digest.update(path.parent.name.encode() + b"\0" + _text(path).encode() + b"\0")
    return digest.hexdigest()


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
        there = attributes["schema"]
    except OSError as error:
        raise InputError("map cannot be read", where=where, got=error.strerror) from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            "is not a map, or its zarr.json is damaged", where=where, expected=_ANEW
        ) from None
    if there != schema:
        raise InputError(
            "is a map of another version",
            where=where,
            expected=f"schema {schema}, or another file name",
            got=there,
        )
    try:
        whole = attributes[CHECKSUM] == description_checksum(folder)
    except (OSError, ValueError, KeyError, TypeError):
        whole = False
    if not whole:
        raise InputError(
            "map is damaged: a zarr.json in it does not agree with its checksum",
            where=where,
            expected=_ANEW,
        )
    return dict(attributes)


def _text(path: Path) -> str:
    if path.stat().st_size > _LARGEST_DESCRIPTION:
        raise ValueError("too large")
    return path.read_text(encoding="utf-8")


class DamageError(Exception):
    """A file of a map that is not the one that was written; says which, and what is wrong."""


def crc32c(data: bytes) -> int:
    """CRC-32C (Castagnoli) of some bytes.

    Raises
    ------
    MissingDependencyError
        Without google-crc32c.
    """
    value = imported(
        "google_crc32c", package="google-crc32c", purpose="verifying a map", extra="maps"
    ).value
    return int(value(data))


def checksum_of(path: Path) -> int:
    """The checksum at the end of a file that has just been written."""
    with path.open("rb") as file:
        file.seek(-4, os.SEEK_END)
        return int.from_bytes(file.read(), "little")


def checked_file(path: Path, folder: Path, largest: int, checksum: int | None = None) -> bytes:
    """The bytes of a file in a map's folder, less the checksum at its end.

    Parameters
    ----------
    path, folder : Path
        The file, and what its name is told from.
    largest : int
        Bytes of its content.
    checksum : int, optional
        The one that it was written with; without it, only its own counts.

    Raises
    ------
    DamageError
        If it is not what was written.
    """
    name = path.relative_to(folder).as_posix()
    try:
        # A compressor adds a little to what it cannot compress.
        if path.stat().st_size > largest + largest // 8 + 1024:
            raise DamageError(f"{name} is too large")
        data = path.read_bytes()
    except FileNotFoundError:
        raise DamageError(f"{name} is missing") from None
    except OSError as error:
        raise DamageError(f"{name} cannot be read ({error.strerror})") from None
    own = int.from_bytes(data[-4:], "little")
    if len(data) < 4 or own != crc32c(data[:-4]):
        raise DamageError(f"{name} does not agree with its checksum")
    if checksum is not None and own != checksum:
        raise DamageError(f"{name} is not the one that was written there")
    return data[:-4]
