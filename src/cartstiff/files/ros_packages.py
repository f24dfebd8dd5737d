"""Folders of ROS packages: the folder of a name, and the folders that a robot's
file may read.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from pathlib import Path

# Largest depth and number of folders below a search path in which packages are searched.
_MAX_DEPTH, _MAX_FOLDERS = 4, 20_000
_NAME = re.compile(r"<name[^>]*>\s*([^<\s]+)\s*</name>")
_OF_ROBOTS = ("urdf", "xacro", "meshes", "robots")


def search_path(folders: Iterable[Path | str]) -> list[str]:
    """These folders, then those of ROS_PACKAGE_PATH and of AMENT_PREFIX_PATH."""

    def named(variable: str) -> list[str]:
        return [text for text in os.environ.get(variable, "").split(os.pathsep) if text]

    shares = [str(Path(prefix) / "share") for prefix in named("AMENT_PREFIX_PATH")]
    return [
        str(Path(f).expanduser()) for f in (*folders, *named("ROS_PACKAGE_PATH"), *shares)
    ]


def where_packages_are(package: str) -> str:
    """Advice for a package that is not found, in words."""
    return (
        f"the folder {package} (from the maker's repository) beside the file's package, "
        "or "
        "--package-path FOLDER, ROS_PACKAGE_PATH or AMENT_PREFIX_PATH with the folder it "
        "is in"
    )


def own_folder(file: Path) -> Path:
    """Folder of the package of a file: the nearest one with a package.xml,
    or the file's own.
    """
    parents = file.resolve().parents
    return next((p for p in parents if (p / "package.xml").is_file()), parents[0])


def package_folders(name: str, file: Path, searched: Iterable[str]) -> Iterator[Path]:
    """Find folders of a ROS package, the preferred one first.

    First comes the package that contains the file, then one in or below `searched`, in
    their order; if there is none, one beside a folder above the file. A folder is a
    package by the name in its package.xml, or by its own name if it has a package.xml or
    a folder such as urdf or meshes.
    """
    if not re.fullmatch(r"[A-Za-z]\w*(?:[.-]\w+)*", name):
        return
    above = [folder for folder in file.resolve().parents if folder.parent != folder]
    own = islice((folder for folder in above if _is_package(folder, name)), 1)
    below = filter(None, (_below(Path(top), name) for top in searched))
    found = set[Path]()
    for folder in chain(own, below):
        if folder.resolve() not in found:
            found.add(folder.resolve())
            yield folder
    if not found:
        yield from islice(_beside(above, name), 1)


def _beside(above: Iterable[Path], name: str) -> Iterator[Path]:
    for folder in above:
        near = (folder / name, folder / "src" / name, *_folders(folder))
        yield from (inner for inner in near if _is_package(inner, name))


def _below(top: Path, name: str) -> Path | None:
    """The package in a folder: the folder itself, or one of those below it."""
    if _is_package(top / name, name):  # the usual case
        return top / name
    level, count = [top], 0
    for _ in range(_MAX_DEPTH):
        for folder in level:
            if _is_package(folder, name):
                return folder
        level = [inner for folder in level for inner in _folders(folder)]
        count += len(level)
        if count > _MAX_FOLDERS:
            return None
    return None


def _folders(folder: Path) -> Iterator[Path]:
    try:
        with os.scandir(folder) as entries:
            names = [e.name for e in entries if e.is_dir() and not e.name.startswith(".")]
    except OSError:
        return
    yield from (folder / name for name in sorted(names))


def _is_package(folder: Path, name: str) -> bool:
    """Whether a folder is the package of this name."""
    file = folder / "package.xml"
    try:
        if file.is_file():  # a pipe would never end
            with file.open(encoding="utf-8", errors="replace") as text:
                match = _NAME.search(text.read(20_000))
            return folder.name == name or (match is not None and match[1] == name)
        return folder.name == name and any(
            (folder / inner).is_dir() for inner in _OF_ROBOTS
        )
    except OSError:
        return False
