"""Writing of files and maps, completely or not at all: one way for all that a
command writes.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

from cartstiff.core.errors import InputError, one_line

#: Name of a file or folder that is still being written, beside the one that it becomes.
_BEFORE, _AFTER = ".cartstiff-", ".part"


def write_whole(path: str | Path, data: bytes) -> None:
    """Write a file so that readers see the old or the new contents, never a part.

    A link is followed, and the file behind it keeps its permissions. What is no plain
    file (a pipe, a device) is written to as it is. Parts that an interrupted process has
    left in the folder are removed.

    Parameters
    ----------
    path : str or pathlib.Path
        Its folder must exist.
    data : bytes
        Contents.

    Raises
    ------
    InputError
        If the place cannot be written, or its file is read-only.
    """
    try:
        place = Path(path).resolve()
        found = place.stat() if place.exists() else None
        if found is None or stat.S_ISREG(found.st_mode):
            _replace(place, data, found)
        else:
            with os.fdopen(os.open(place, os.O_WRONLY | os.O_CLOEXEC), "wb") as file:
                file.write(data)
    except (OSError, RuntimeError) as error:  # RuntimeError: links in a circle
        reason = error.strerror if isinstance(error, OSError) else "links in a circle"
        raise InputError(
            "file cannot be written", where=one_line(str(path)), got=reason
        ) from None


def _replace(place: Path, data: bytes, found: os.stat_result | None) -> None:
    """Write the data beside a plain file, then put them in its place."""
    writable = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH
    if found is not None and not (found.st_mode & writable and os.access(place, os.W_OK)):
        raise PermissionError(None, "the file is read-only")
    remove_abandoned(place.parent)
    name, handle = _new_part(place.parent, _new_file)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            if found is not None:
                os.fchmod(file.fileno(), stat.S_IMODE(found.st_mode))
            name.replace(place)  # while it is locked: nobody takes it for abandoned
    except BaseException:
        name.unlink(missing_ok=True)
        raise


def create_folder(place: Path, fill: Callable[[Path], None]) -> None:
    """Create a folder with its contents, completely or not at all.

    Parts that an interrupted process has left beside it are removed.

    Parameters
    ----------
    place : pathlib.Path
        Of the new folder. One that somebody else has created in the meantime stays as it
        is.
    fill : callable
        Writes the contents into the folder that it is given.

    Raises
    ------
    OSError
        If the place cannot be written.
    """
    remove_abandoned(place.parent)
    name, handle = _new_part(place.parent, _new_folder)
    try:
        fill(name)
        name.rename(place)
    except OSError:
        if not place.exists():
            raise
    finally:
        shutil.rmtree(name, ignore_errors=True)
        os.close(handle)


def _new_file(name: Path) -> int:
    # Created by `open`, it has the permissions of the user's umask.
    return os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)


def _new_folder(name: Path) -> int:
    name.mkdir()
    return os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)


def _new_part(folder: Path, create: Callable[[Path], int]) -> tuple[Path, int]:
    """Name and handle of a new part, which is locked as long as its process writes it."""
    while True:
        name = folder / f"{_BEFORE}{secrets.token_hex(8)}{_AFTER}"
        try:
            handle = create(name)
        except FileNotFoundError:
            if not folder.is_dir():
                raise
            continue  # a folder that somebody took for abandoned before it was open
        fcntl.flock(handle, fcntl.LOCK_EX)
        if _is_at(handle, name):
            return name, handle
        os.close(handle)  # somebody took it for abandoned before it was locked


def remove_abandoned(folder: Path) -> None:
    """Remove the parts in a folder that no process is writing."""
    with os.scandir(folder) as entries:
        parts = [
            e.path
            for e in entries
            if e.name.startswith(_BEFORE) and e.name.endswith(_AFTER)
        ]
    for part in parts:
        try:
            handle = os.open(
                part, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
            )
        except OSError:  # another user's, or gone
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            mode = os.fstat(handle).st_mode
            if stat.S_ISDIR(mode) and _is_at(handle, Path(part)):
                shutil.rmtree(part)
            elif stat.S_ISREG(mode) and _is_at(handle, Path(part)):
                Path(part).unlink()
        except OSError:  # it is being written
            pass
        finally:
            os.close(handle)


def _is_at(handle: int, name: Path) -> bool:
    """Whether an open file still has this name."""
    try:
        there = name.stat(follow_symlinks=False)
    except FileNotFoundError:
        return False
    return os.path.samestat(there, os.fstat(handle))
