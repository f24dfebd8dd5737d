"""Read robots: each format has a reader, which returns a `RobotDescription`.

Pinocchio's parsers answer some malformed files with messages on the terminal, silence, or
worse. A URDF is therefore checked before Pinocchio reads it (`urdf`); MuJoCo reads MJCF
(`mjcf`), and xacro is expanded first (`ros`).
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from cartstiff.core.errors import InputError, one_line
from cartstiff.core.notes import Note
from cartstiff.files.catalogue import example_robot
from cartstiff.files.description import RobotDescription
from cartstiff.files.identity import was_read
from cartstiff.files.ros import (
    Ros,
    described_robot,
    expanded_xacro,
    is_description_name,
    is_xacro,
)
from cartstiff.files.urdf import read_urdf
from cartstiff.files.yaml_file import read_text

#: Endings of the formats in XML, which are told apart by their first tag.
XML_FILES = (".urdf", ".xacro", ".xml", ".mjcf", ".sdf")
#: Readers of other formats by the ending in lower case: they take the path, and its name
#: for messages.
FORMATS: dict[str, Callable[[Path, str], RobotDescription]] = {}

_MAX_BYTES = 64 * 1024 * 1024
# Largest number of elements: each takes a hundred bytes or more of memory; robots have
# thousands.
_MAX_TAGS = 1_000_000


def robot_files() -> tuple[str, ...]:
    """Return the endings of the files that hold a robot."""
    return (*XML_FILES, *FORMATS)


def read_robot_description(
    path: Path,
    floating: bool = False,
    ros: Ros | None = None,
    where: str | None = None,
    joint_types: Mapping[str, str] = MappingProxyType({}),
) -> RobotDescription:
    """Read a robot's file; with `floating` the root of a URDF is free in F.

    Parameters
    ----------
    path : Path
        The file.
    floating : bool
        Whether the root of a URDF moves.
    ros : Ros, optional
        Arguments of xacro, and folders of packages.
    where : str, optional
        Name of the file in messages; default its path.
    joint_types : mapping of str to str
        Types that replace those of joints of a URDF, see `urdf.retype_joints`.

    Raises
    ------
    InputError
        One line with the file and the element that is wrong.
    """
    ros, where = ros or Ros(), where or one_line(str(path))
    if (read := FORMATS.get(path.suffix.lower())) is not None:
        return _of_format(read(path, where), where, floating, joint_types, ros)
    text = read_text(path, _MAX_BYTES)
    root = parse_text(text, where)
    expanded, notes = None, list[Note]()
    if root.tag in ("robot", "mujoco") and is_xacro(path, text):
        expanded, notes = expanded_xacro(path, ros, where)
        if "<link" not in expanded and "<xacro:macro" in text:
            raise InputError(
                "defines macros and no robot",
                where=where,
                expected="the file that includes it and calls them",
            )
        was_read(f"{path.name} with all that it includes", expanded.encode())
        root = parse_text(expanded, where)
    elif ros.arguments:
        raise InputError(
            "is no xacro file",
            where=where,
            expected="no --xacro-arg",
            got=", ".join(ros.arguments),
        )
    if root.tag == "robot":
        robot = read_urdf(root, where, floating, joint_types)
        notes = [*robot.notes, *notes]
        return replace(
            robot, path=path, notes=tuple(notes), text=expanded, packages=ros.packages
        )
    # What is no URDF is MJCF as it is written.
    if root.tag == "sdf":
        raise InputError(
            "SDF files are not read",
            where=where,
            expected="URDF or MJCF, as the robot's maker offers it or a converter writes "
            "it",
        )
    got = f"<{one_line(root.tag, 40)}>"
    if joint_types:
        raise InputError("joint_types are of a URDF", where=where, got=got)
    if root.tag == "mujoco" and expanded is None:
        from cartstiff.files.mjcf.reading import read_mjcf

        return read_mjcf(path, where)
    raise InputError(
        "not a robot description",
        where=where,
        expected="<robot> (URDF) or <mujoco> (MJCF)",
        got=got,
    )


def _of_format(
    robot: RobotDescription,
    where: str,
    floating: bool,
    joint_types: Mapping[str, str],
    ros: Ros,
) -> RobotDescription:
    """Return the robot of a reader of one's own; refuse what only XML files have."""
    for what, given in (
        ("joint_types", joint_types),
        ("xacro arguments", ros.arguments),
    ):
        if given:
            raise InputError(f"{what} are of a URDF", where=where, got=", ".join(given))
    if floating and not robot.loose:
        raise InputError("has no free root", where=where, expected="no key floating")
    return robot


def robot_of(entry: Any, beside: Path | None, floating: bool = False) -> RobotDescription:
    """Read the robot of a `model:` or `dh:` entry.

    Paths are relative to the mechanism file.
    """
    folder = beside or Path()
    if entry.dh is not None:
        if entry.xacro or entry.package_path:
            raise InputError(
                "xacro arguments and package paths belong to robots by model"
            )
        from cartstiff.files.dh import dh_description

        return dh_description(entry.dh, folder, floating)
    packages = _folders(entry.package_path, folder)
    named = tuple(map(Path, entry.named_folders))
    model, ros = entry.model or "", Ros(packages, dict(entry.xacro), named)
    if model.lstrip().startswith("<"):
        return described_text(model, floating, ros)
    path = folder / Path(model).expanduser()
    types = getattr(entry, "joint_types", {})
    if path.suffix.lower() in robot_files() or path.is_file():
        return read_robot_description(path, floating, ros, joint_types=types)
    if is_description_name(model):
        path, own = described_robot(model)
        arguments = {**own.arguments, **ros.arguments}
        ros = Ros((*packages, *own.packages), arguments, (*named, *own.packages))
    else:
        path = example_robot(model)
    return read_robot_description(path, floating, ros, joint_types=types)


def _folders(names: Sequence[str], beside: Path) -> tuple[Path, ...]:
    """Folders of a file's key, which exist."""
    folders = {name: beside / Path(name).expanduser() for name in names}
    for name, folder in folders.items():
        if not folder.is_dir():
            raise InputError(
                "no such folder", where="key package_path", got=one_line(name)
            )
    return tuple(folders.values())


def described_text(text: str, floating: bool, ros: Ros) -> RobotDescription:
    """Read a robot description from XML text.

    Names of its meshes are relative to no file.
    """
    from tempfile import TemporaryDirectory  # slow to import

    with TemporaryDirectory() as folder:
        path = Path(folder, "text.xml")
        path.write_text(text, encoding="utf-8")
        description = read_robot_description(path, floating, ros, "XML text")
    return replace(
        description,
        path=None,
        text=(description.text or text) if description.pieces is None else None,
    )


# Blank lines and comments before an XML declaration, which other readers of URDF accept.
_DECLARATION = re.compile(r"\A(\s*(?:<!--(?:(?!-->).)*-->\s*)*)<\?xml[^>]*\?>", re.DOTALL)


def parse_xml(path: Path) -> ET.Element:
    """Parse an XML file without document type (no entities, no outside files)."""
    return parse_text(read_text(path, _MAX_BYTES), one_line(str(path)))


def parse_text(text: str, where: str) -> ET.Element:
    """Parse XML text without document type (no entities, no outside files)."""
    if text.startswith("version https://git-lfs"):
        raise InputError(
            "this is a Git LFS pointer, not the file",
            where=where,
            expected="the file itself: git lfs pull",
        )
    if text[:200].lstrip().lower().startswith(("<!doctype html", "<html")):
        raise InputError(
            "this is a web page, not a robot",
            where=where,
            expected="URDF or MJCF as it is in the repository (raw)",
        )
    if "<cable_set" in text or "<link_rigid" in text:
        raise InputError(
            "files of CASPR are not read",
            where=where,
            expected="a mechanism file of kind springs with 'unilateral: true' for a "
            "body on "
            "cables, or of kind serial with 'lines' for bodies on joints",
        )
    if text.count("<") > _MAX_TAGS:
        raise InputError(
            "too many elements",
            where=where,
            expected=f"at most {_MAX_TAGS}",
            got=text.count("<"),
        )
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("XML document types and entities are not supported", where=where)
    try:
        root = ET.fromstring(_DECLARATION.sub(r"\1", text))
    except (ET.ParseError, ValueError, RecursionError) as error:
        raise InputError("not valid XML", where=where, got=str(error)) from None
    return root
