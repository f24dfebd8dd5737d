"""Read robot descriptions: a Pinocchio model and the facts beside it.

Pinocchio's parsers answer some malformed files with messages on the terminal, silence, or worse.
A URDF is therefore checked before Pinocchio reads it (`urdf`); MuJoCo reads MJCF (`mjcf`), and
xacro is expanded first (`ros`).
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import pinocchio as pin

from cartstiff.errors import InputError, one_line
from cartstiff.loading.robot_facts import RobotFacts
from cartstiff.loading.ros import Ros, expanded_xacro, is_xacro
from cartstiff.loading.urdf import prepare_urdf, retype_joints
from cartstiff.loading.yaml_file import read_text
from cartstiff.mechanisms.chain import Description
from cartstiff.mechanisms.identity import was_read
from cartstiff.notes import Note

if TYPE_CHECKING:
    from cartstiff.mechanisms.shapes import Piece

_MAX_BYTES = 64 * 1024 * 1024
# Largest number of elements: each takes a hundred bytes or more of memory; robots have thousands.
_MAX_TAGS = 1_000_000


@dataclass(frozen=True)
class RobotDescription:
    """A Pinocchio model and the other facts of its file.

    Attributes
    ----------
    path : Path or None
        The file, if there is one.
    model : pinocchio.Model
        As Pinocchio reads it, all joints free.
    facts : RobotFacts
        Springs, closures, couplings, gravity, posture.
    pieces : tuple of Piece or None
        Shapes of the links, where they are not read from the file.
    held : frozenset of str
        Joints that stay at their neutral position.
    text : str or None
        The XML, where it differs from the file's contents.
    packages : tuple of Path
        Folders in which package:// names are searched first.
    """

    path: Path | None
    model: Any
    facts: RobotFacts = field(default_factory=RobotFacts)
    pieces: tuple[Piece, ...] | None = None
    held: frozenset[str] = frozenset()
    text: str | None = None
    packages: tuple[Path, ...] = ()

    def shown(self, prefix: str = "") -> Description:
        """Return how its links look; `prefix` precedes their names."""
        return Description(self.path, prefix, self.pieces, self.text, self.packages)


def read_robot_description(
    path: Path,
    floating: bool = False,
    ros: Ros | None = None,
    where: str | None = None,
    joint_types: Mapping[str, str] = MappingProxyType({}),
) -> RobotDescription:
    """Read a URDF, xacro or MJCF file; with `floating` the root of a URDF is free in F.

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
    if root.tag == "sdf":
        raise InputError(
            "SDF files are not read",
            where=where,
            expected="URDF or MJCF, as the robot's maker offers it or a converter writes it",
        )
    if root.tag == "robot":
        retype_joints(root, joint_types, where)
        facts = prepare_urdf(root, where)
        facts = replace(facts, notes=(*facts.notes, *notes))
        try:
            root_joint = (
                (pin.JointModelFreeFlyer(), "root")
                if floating and not facts.loose
                else ()
            )
            model = pin.buildModelFromXML(_moving_parts(root), *root_joint)
        except Exception as error:
            raise InputError("not a usable URDF", where=where, got=str(error)) from None
        return RobotDescription(path, model, facts, text=expanded, packages=ros.packages)
    if joint_types:
        raise InputError(
            "joint_types are of a URDF", where=where, got=f"<{one_line(root.tag, 40)}>"
        )
    if root.tag == "mujoco" and expanded is None:
        from cartstiff.loading.mjcf.reading import read_mjcf

        model, facts, pieces = read_mjcf(path, where)
        return RobotDescription(path, model, facts, pieces)
    raise InputError(
        "not a robot description",
        where=where,
        expected="<robot> (URDF) or <mujoco> (MJCF)",
        got=f"<{one_line(root.tag, 40)}>",
    )


def _moving_parts(root: ET.Element) -> str:
    """URDF of links with their masses and of joints: the C++ parser may complain about the rest."""
    kept = ET.Element("robot", root.attrib)
    for part in root:
        if part.tag == "joint":
            kept.append(part)
        elif part.tag == "link":
            ET.SubElement(kept, "link", part.attrib).extend(part.findall("inertial"))
    return ET.tostring(kept, encoding="unicode")


def described_text(
    text: str, floating: bool = False, ros: Ros | None = None
) -> RobotDescription:
    """Read a robot description from XML text; names of its meshes are relative to no file."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "text.xml")
        path.write_text(text, encoding="utf-8")
        description = read_robot_description(path, floating, ros, "XML text")
    return replace(
        description,
        path=None,
        text=description.text or text if description.pieces is None else None,
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
            expected="a mechanism file of kind springs with 'unilateral: true' for a body on "
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
