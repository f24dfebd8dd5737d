"""Files of ROS: xacro, packages, and the names of robot_descriptions."""

from __future__ import annotations

import importlib.util
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cartstiff.core.errors import (
    InputError,
    MissingDependencyError,
    UnknownNameError,
    one_line,
)
from cartstiff.core.notes import Note
from cartstiff.files.child_process import answer_of
from cartstiff.files.ros_packages import own_folder, search_path

_SPACE = re.compile(r"""xmlns:\w+\s*=\s*["'][^"']*xacro/?["']""")
_ELEMENT = re.compile(r"<xacro:|\$[({]")


def _worker(name: str) -> str:
    """File of the script that does the work in a process of its own."""
    return str(Path(__file__).with_name(f"{name}_worker.py"))


@dataclass(frozen=True)
class Ros:
    """Arguments of xacro files, and folders of packages.

    Attributes
    ----------
    packages : tuple of Path
        Folders in or under which packages are searched first.
    arguments : mapping of str to str
        Values of xacro's arguments.
    named : tuple of Path
        Those of `packages` that the user has named: every file below them may be read.
    """

    packages: tuple[Path, ...] = ()
    arguments: Mapping[str, str] = field(default_factory=dict)
    named: tuple[Path, ...] = ()


def is_xacro(path: Path, text: str) -> bool:
    """Whether a robot description is xacro."""
    return path.suffix.lower() == ".xacro" or bool(
        _SPACE.search(text) and _ELEMENT.search(text)
    )


def expanded_xacro(path: Path, ros: Ros, where: str) -> tuple[str, list[Note]]:
    """Expand a xacro file to a robot description, with notes.

    Raises
    ------
    MissingDependencyError
        Without the package xacro.
    InputError
        For text that xacro or its guard refuses, a missing package, and an unknown
        argument.
    """
    if importlib.util.find_spec("xacro") is None:
        raise MissingDependencyError("xacro", f"reading {where}", "xacro")
    path, searched = path.resolve(), search_path(ros.packages)
    folders = [str(own_folder(path)), *map(str, ros.named)]
    answer = answer_of(
        _worker("xacro"),
        [str(path), dict(ros.arguments), folders, searched],
        where,
        "xacro",
    )
    if "missing" in answer:
        raise MissingDependencyError(str(answer["missing"]), f"reading {where}", "xacro")
    asked = answer.get("asked", [])
    for name in answer.get("unread", ()):
        if "error" not in answer or name not in asked:
            raise UnknownNameError("xacro argument", name, asked, where=where)
    if "error" in answer:
        words = str(answer["error"])
        for folder, shown in ((path.parent, "."), (path.parent.parent, "..")):
            words = words.replace(
                f"{folder}/", f"{shown}/"
            )  # the end of a path is what matters
        file = Path(answer.get("file", path)).name
        inside = "" if file == path.name else f", in {file}"
        what, expected = f"xacro: {one_line(words, 300)}{inside}", answer.get("expected")
        raise InputError(what, where=where, expected=expected)
    twice = [
        Note(
            "package-twice",
            f"several packages are called {name}: {folders[0]} is read, not "
            + ", ".join(folders[1:]),
            {"package": name, "folders": folders},
        )
        for name, folders in answer.get("twice", {}).items()
    ]
    return str(answer["xml"]), twice


def is_description_name(name: str) -> bool:
    """Whether a name has the form of those of robot_descriptions."""
    return bool(re.fullmatch(r"[a-z0-9_]+_description", name))


def described_robot(name: str) -> tuple[Path, Ros]:
    """Find the file of a robot of robot_descriptions; nothing is downloaded.

    Raises
    ------
    MissingDependencyError
        Without that package.
    InputError
        For a robot whose repository is not in its cache; UnknownNameError for an unknown
        name.
    """
    if importlib.util.find_spec("robot_descriptions") is None:
        raise MissingDependencyError(
            "robot_descriptions", f"the robot {name!r}", "descriptions"
        )
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    answer = answer_of(
        _worker("descriptions"), [name], name, "robot_descriptions", environment
    )
    if "unknown" in answer:
        raise UnknownNameError("robot description", name, answer["unknown"])
    if "not_cached" in answer:
        raise InputError(
            "is not in the cache of robot_descriptions, and nothing is downloaded by "
            "itself",
            where=name,
            expected=f"'python -m robot_descriptions pull {name}' before",
            got=f"no folder {answer['not_cached']}",
        )
    if "missing" in answer or "error" in answer:
        got = answer.get("error") or f"no module {answer['missing']!r}"
        raise InputError("cannot be loaded from robot_descriptions", where=name, got=got)
    packages = tuple(Path(p) for p in answer["packages"])
    return Path(answer["path"]), Ros(packages, answer["arguments"])
