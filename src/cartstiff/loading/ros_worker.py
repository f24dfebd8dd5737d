"""Expands one xacro file, or asks robot_descriptions where a robot's file is; prints one object.

Run as a script in a process of its own (`cartstiff.loading.ros` starts it): a xacro file is a
program, with loops, expressions and files that it reads. Time and memory are limited; starting
programs, writing files and reaching a network are refused.
"""

from __future__ import annotations

import json
import os
import re
import resource
import sys
import types
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

_MEMORY = 1024**3
_SECONDS = 6
#: Bytes of expanded text.
LARGEST = 64 * 1024 * 1024
# Folders below a search path in which packages are looked for, as rospack does, but bounded.
_DEEPEST, _MOST_FOLDERS = 4, 20_000
_REFUSED = (
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.fork",
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.mkdir",
    "os.chmod",
    "os.kill",
    "os.symlink",
    "os.link",
    "os.truncate",
    "os.putenv",
    "subprocess.",
    "socket.",
    "ctypes.",
    "shutil.",
    "webbrowser.",
    "urllib.",
    "ftplib.",
    "smtplib.",
)
_NAME = re.compile(r"<name[^>]*>\s*([^<\s]+)\s*</name>")


def package_folder(name: str, beside: Path, searched: Sequence[str] = ()) -> Path | None:
    """Folder of a ROS package; None if there is none.

    Looked for below `searched`, below the folders of ROS_PACKAGE_PATH and AMENT_PREFIX_PATH, and
    above the file `beside`: a folder there that has the name, or whose package.xml says so, or
    that has such a folder in it or under src.
    """
    if not name or "/" in name or name in (".", ".."):
        return None
    for text in [*searched, *os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)]:
        if text and (known := _below(Path(text).expanduser(), name)) is not None:
            return known
    for text in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if (share := Path(text) / "share" / name).is_dir():
            return share
    for folder in beside.resolve().parents:
        if folder.name == name or _called(folder, name):
            return folder
        for inside in (folder / name, folder / "src" / name):
            if inside.is_dir():
                return inside
        for near in _folders(folder) if folder.parent != folder else ():
            if _called(near, name):
                return near
    return None


def _below(top: Path, name: str) -> Path | None:
    """The package in a folder: the folder itself, or one of those below it."""
    level, count = [top], 0
    for _ in range(_DEEPEST):
        for folder in level:
            if (folder.name == name and folder.is_dir()) or _called(folder, name):
                return folder
        level = [inner for folder in level for inner in _folders(folder)]
        count += len(level)
        if count > _MOST_FOLDERS:
            return None
    return None


def _folders(folder: Path) -> Iterator[Path]:
    try:
        with os.scandir(folder) as entries:
            names = [e.name for e in entries if e.is_dir() and not e.name.startswith(".")]
    except OSError:
        return
    yield from (folder / name for name in sorted(names))


def _called(folder: Path, name: str) -> bool:
    """Whether a folder's package.xml gives it this name."""
    try:
        with (folder / "package.xml").open(encoding="utf-8", errors="replace") as file:
            match = _NAME.search(file.read(20_000))
    except OSError:
        return False
    return match is not None and match[1] == name


def expanded(path: str, values: dict[str, str], searched: list[str]) -> dict[str, Any]:
    """The XML that a xacro file stands for, or what is wrong with it."""
    import xacro

    def folder(name: str) -> str:
        place = package_folder(name, Path(path), searched)
        if place is None:
            raise LookupError(f"package {name!r} is not found")
        return str(place)

    # What xacro asks for $(find ...), as ROS 2 would have it installed.
    index = types.ModuleType("ament_index_python.packages")
    vars(index)["get_package_share_directory"] = folder
    sys.modules["ament_index_python"] = types.ModuleType("ament_index_python")
    sys.modules[index.__name__] = index
    asked, arguments = _arguments(path), _Read(values)
    try:
        document = xacro.process_file(path, mappings=arguments, verbosity=0)
    except Exception as error:
        inner: Any = error
        while getattr(inner, "exc", None) is not None:
            inner = inner.exc
        text = str(error) if isinstance(inner, LookupError) or not str(inner) else str(inner)
        if type(inner).__name__ == "ArgException":
            text = f"no value for {text!r}"
        place = [name for name in getattr(xacro, "filestack", []) if name]
        missing = isinstance(inner, LookupError) and "is not found" in str(inner)
        unread = [name for name in values if name not in arguments.read]
        return {
            "error": text if not missing else str(inner.args[0]),
            "package": missing,
            "file": str(place[-1]) if place else path,
            "asked": asked,
            "unread": unread,
        }
    text = document.toxml()
    if len(text) > LARGEST:
        return {"error": f"it expands to more than {LARGEST} bytes"}
    unread = [name for name in values if name not in arguments.read]
    return {"xml": text, "asked": asked, "unread": unread}


class _Read(dict[str, str]):
    """Values of arguments, and the names that were asked for."""

    def __init__(self, values: dict[str, str]) -> None:
        super().__init__(values)
        self.read: set[object] = set()

    def __contains__(self, name: object) -> bool:
        self.read.add(name)
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.read.add(name)
        return super().__getitem__(name)


def _arguments(path: str) -> dict[str, str | None]:
    """Arguments that the file itself declares, with their defaults."""
    from xml.dom import minidom

    try:
        tags = minidom.parse(path).getElementsByTagName("xacro:arg")
    except Exception:
        return {}
    return {
        tag.getAttribute("name"): tag.getAttribute("default")
        if tag.hasAttribute("default")
        else None
        for tag in tags
    }


def described(name: str) -> dict[str, Any]:
    """Files that a module of robot_descriptions names, if its repository is in the cache."""
    import robot_descriptions
    from robot_descriptions._repositories import REPOSITORIES

    cache = os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")
    missing: list[str] = []

    def cached(repository: str, commit: str | None = None) -> str:
        inside = REPOSITORIES[repository].cache_path
        inside = inside if commit is None else f"{inside}-{commit}/{inside}"
        folder = Path(cache).expanduser() / inside
        if not folder.is_dir():
            missing.append(str(folder))
        return str(folder)

    # Its own function downloads what is not there.
    stand_in = types.ModuleType("robot_descriptions._cache")
    vars(stand_in)["clone_to_cache"] = cached
    vars(stand_in)["get_head_sha"] = lambda _: None
    sys.modules[stand_in.__name__] = stand_in
    try:
        module: Any = import_module(f"{robot_descriptions.__name__}.{name}")
    except ModuleNotFoundError as error:
        if error.name == f"robot_descriptions.{name}":
            return {
                "unknown": sorted(
                    p.stem for p in Path(robot_descriptions.__path__[0]).glob("*_description.py")
                )
            }
        raise
    if missing:
        return {"not_cached": missing[0]}
    variable = next(
        (k for k in ("URDF_PATH", "XACRO_PATH", "MJCF_PATH") if getattr(module, k, None)), None
    )
    if variable is None:
        return {"error": "it has neither a URDF nor a xacro nor an MJCF file"}
    xacro = variable == "XACRO_PATH"
    packages = getattr(module, "XACRO_PACKAGE_PATHS", {}) if xacro else {}
    return {
        "path": getattr(module, variable),
        "arguments": {k: str(v) for k, v in getattr(module, "XACRO_ARGS", {}).items()}
        if xacro
        else {},
        "packages": [str(p) for p in packages.values()],
    }


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
    opens = event == "open" and isinstance(arguments[2], int) and arguments[2] & writes
    if opens or event.startswith(_REFUSED):
        raise PermissionError(f"the file tries to do more than describe a robot ({event})")


def main() -> None:
    """Answer ``expanded`` or ``described`` (first argument) of JSON arguments (the second)."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS + 1))  # a signal, then the end
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what xacro warns of
    sys.dont_write_bytecode = True
    try:
        if sys.argv[1] == "expanded":
            import xacro
            import yaml

            del xacro, yaml
            sys.addaudithook(_refuse)
            answer = expanded(*json.loads(sys.argv[2]))
        else:
            answer = described(*json.loads(sys.argv[2]))
    except ModuleNotFoundError as error:
        answer = {"missing": error.name}
    except (MemoryError, RecursionError):
        answer = {"error": "too much memory is needed"}
    except Exception as error:
        answer = {"error": str(error) or type(error).__name__}
    with out:
        json.dump(answer, out)


if __name__ == "__main__":
    main()
