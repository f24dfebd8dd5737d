"""Files as ROS people have them: xacro, packages, and the names of robot_descriptions."""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from cartstiff.errors import InputError, MissingDependencyError, UnknownNameError, one_line
from cartstiff.loading import ros_worker

#: Endings of robot descriptions.
ROBOT_FILES = (".urdf", ".xacro", ".xml", ".mjcf", ".sdf")
_SPACE = re.compile(r"""xmlns:\w+\s*=\s*["'][^"']*xacro/?["']""")
_ELEMENT = re.compile(r"<xacro:|\$[({]")


@dataclass(frozen=True)
class Ros:
    """What xacro files and package:// names need besides the file.

    Attributes
    ----------
    packages : sequence of Path
        Folders in or under which packages are looked for first.
    arguments : mapping of str to str
        Values of xacro's arguments.
    """

    packages: Sequence[Path] = ()
    arguments: Mapping[str, str] = field(default_factory=dict)


def is_xacro(path: Path, text: str) -> bool:
    """Whether a robot description has to be expanded first."""
    return path.suffix.lower() == ".xacro" or bool(_SPACE.search(text) and _ELEMENT.search(text))


def expanded_xacro(path: Path, ros: Ros, where: str) -> str:
    """The robot description that a xacro file stands for.

    Raises
    ------
    MissingDependencyError
        Without the package xacro.
    InputError
        For what xacro refuses, a package that is not found, an argument that the file lacks.
    """
    if importlib.util.find_spec("xacro") is None:
        raise MissingDependencyError("xacro", f"reading {where}", "xacro")
    from cartstiff.child_process import answer_of

    arguments = [str(path.resolve()), dict(ros.arguments), [str(p) for p in ros.packages]]
    answer = answer_of(ros_worker.__file__, ["expanded", json.dumps(arguments)], where, "xacro")
    if "missing" in answer:
        raise MissingDependencyError(str(answer["missing"]), f"reading {where}", "xacro")
    asked = answer.get("asked", {})
    for name in answer.get("unread", ()):
        if "error" not in answer or name not in asked:
            raise UnknownNameError("xacro argument", name, asked, where=where)
    if answer.get("package"):
        raise InputError(
            answer["error"],
            where=where,
            expected="--package-path FOLDER, ROS_PACKAGE_PATH, AMENT_PREFIX_PATH, or a folder "
            "above the file that holds it",
        )
    if "error" in answer:
        words = str(answer["error"])
        for folder, shown in ((path.resolve().parent, "."), (path.resolve().parent.parent, "..")):
            words = words.replace(f"{folder}/", f"{shown}/")  # the end of a path tells most
        words = one_line(words, 300)
        file = Path(answer.get("file", path)).name
        raise InputError(
            "not a usable xacro file",
            where=where,
            expected=f"its arguments as --xacro-arg NAME:=VALUE (it has {', '.join(asked)})"
            if asked
            else None,
            got=words if file == path.name else f"{words} (in {file})",
        )
    return str(answer["xml"])


@cache
def _has_descriptions() -> bool:
    return importlib.util.find_spec("robot_descriptions") is not None


def is_description_name(name: str) -> bool:
    """Whether a name is one of robot_descriptions' kind."""
    return bool(re.fullmatch(r"[a-z0-9_]+_description", name))


def described_robot(name: str) -> tuple[Path, Ros]:
    """File of a robot by its name in robot_descriptions; nothing is downloaded.

    Raises
    ------
    MissingDependencyError
        Without that package.
    InputError
        For a robot whose repository is not in its cache; UnknownNameError for a name it lacks.
    """
    if not _has_descriptions():
        raise MissingDependencyError("robot_descriptions", f"the robot {name!r}", "descriptions")
    from cartstiff.child_process import answer_of

    arguments = ["described", json.dumps([name])]
    answer = answer_of(ros_worker.__file__, arguments, name, "robot_descriptions")
    if "unknown" in answer:
        raise UnknownNameError("robot description", name, answer["unknown"])
    if "not_cached" in answer:
        raise InputError(
            "is not in the cache of robot_descriptions, and nothing is downloaded by itself",
            where=name,
            expected=f"'python -m robot_descriptions pull {name}' before",
            got=f"no folder {answer['not_cached']}",
        )
    if "missing" in answer or "error" in answer:
        got = answer.get("error") or f"no module {answer['missing']!r}"
        raise InputError("cannot be loaded from robot_descriptions", where=name, got=got)
    packages = tuple(Path(p) for p in answer["packages"])
    return Path(answer["path"]), Ros(packages, answer["arguments"])
