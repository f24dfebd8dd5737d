"""URDF and MJCF files: checked before Pinocchio sees them, and read for what Pinocchio drops.

Pinocchio's parsers answer some malformed files with messages on the terminal, silence, or worse.
Every file is therefore checked here first; what is returned is a Pinocchio model and the facts
beside it: mimic joints of a URDF, springs and loop closures of an MJCF file.
"""

from __future__ import annotations

import math
import os
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.errors import InputError, one_line
from cartstiff.geometry import se3
from cartstiff.loading.mjcf import MjcfFacts, prepare_mjcf
from cartstiff.loading.yaml_file import LARGEST_NUMBER, read_text

__all__ = ["Mimic", "RobotDescription", "parse_xml", "quiet", "read_robot_description"]

_LARGEST = 64 * 1024 * 1024
_MOST_JOINTS = 2000
# Pinocchio's workspace takes a second to set up for 200 joints in a row, an hour for 2000.
_MOST_MOVING = 200
_AXIAL_TYPES = {"revolute", "continuous", "prismatic"}
_JOINT_TYPES = {*_AXIAL_TYPES, "fixed", "floating", "planar"}
# What Pinocchio is shown of a URDF; of the rest it might refuse what plays no part here.
_SHOWN = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
}


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: position = multiplier * leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class RobotDescription:
    """A Pinocchio model and what its file says beside it.

    Attributes
    ----------
    path : Path
        The file.
    model : pinocchio.Model
        As Pinocchio reads it, all joints free.
    mimics : dict of str to Mimic
        Following joints by name.
    mjcf : MjcfFacts or None
        Springs, closures and composite joint names of an MJCF file.
    """

    path: Path
    model: Any
    mimics: dict[str, Mimic] = field(default_factory=dict)
    mjcf: MjcfFacts | None = None


def read_robot_description(path: Path, floating: bool = False) -> RobotDescription:
    """Read a URDF or MJCF file; with `floating` the root of a URDF is free in F.

    Raises
    ------
    InputError
        One line with the file and the element that is wrong.
    """
    where = one_line(str(path))
    root = parse_xml(path)
    if root.tag == "robot":
        mimics = _check_urdf(root, where)
        text = ET.tostring(root, encoding="unicode")
        with quiet():
            try:
                root_joint = (pin.JointModelFreeFlyer(), "root") if floating else ()
                model = pin.buildModelFromXML(text, *root_joint)
            except Exception as error:
                raise InputError("not a usable URDF", where=where, got=str(error)) from None
        return RobotDescription(path, model, mimics)
    if root.tag == "mujoco":
        facts = prepare_mjcf(root, where)
        if facts.joint_count > _MOST_MOVING:
            raise InputError(
                "too many joints", where=where, expected=f"at most {_MOST_MOVING}",
                got=str(facts.joint_count),
            )  # fmt: skip
        # Pinocchio reads MJCF from a file only; beside the original, so that includes resolve.
        try:
            handle, name = tempfile.mkstemp(suffix=".xml", prefix="cartstiff-")
        except OSError as error:
            raise InputError(
                "MJCF needs a temporary file", where=where, got=error.strerror
            ) from None
        try:
            with os.fdopen(handle, "wb") as file:
                ET.ElementTree(root).write(file)
            with quiet():
                try:
                    model = pin.buildModelFromMJCF(name)
                except Exception as error:
                    message = str(error).split("message:\n")[-1].replace(name, where)
                    raise InputError("not a usable MJCF", where=where, got=message) from None
        finally:
            Path(name).unlink(missing_ok=True)
        return RobotDescription(path, model, {}, facts)
    hint = " (SDF is not supported: convert it to URDF)" if root.tag == "sdf" else ""
    raise InputError(
        f"not a robot description{hint}", where=where, expected="<robot> (URDF) or <mujoco> (MJCF)",
        got=f"<{one_line(root.tag, 40)}>",
    )  # fmt: skip


def parse_xml(path: Path) -> ET.Element:
    """Root element of an XML file without document type (no entities, no outside files)."""
    where = one_line(str(path))
    text = read_text(path, _LARGEST)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("XML document types and entities are not supported", where=where)
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise InputError("not valid XML", where=where, got=str(error)) from None
    except (ValueError, RecursionError) as error:
        raise InputError("not valid XML", where=where, got=str(error)) from None
    return root


def _check_urdf(root: ET.Element, where: str) -> dict[str, Mimic]:
    """Check names, tree and numbers; give every inertia-less file what Pinocchio needs."""

    def refuse(what: str, **words: Any) -> InputError:
        return InputError(what, where=where, **words)

    if any(e.tag.startswith("{") and "xacro" in e.tag for e in root.iter()):
        raise refuse("is a xacro file", expected="a URDF: expand it with the xacro command first")
    if root.get("name") is None:
        raise refuse("robot has no name", expected="<robot name=...>")
    _strip(root, refuse)
    links = _names(root, "link", refuse)
    if not links:
        raise refuse("robot has no links")
    joints = _names(root, "joint", refuse)
    if len(joints) > _MOST_JOINTS:
        raise refuse("too many joints", expected=f"at most {_MOST_JOINTS}", got=str(len(joints)))
    moving = sum(joint.get("type") != "fixed" for joint in joints.values())
    if moving > _MOST_MOVING:
        raise refuse("too many moving joints", expected=f"at most {_MOST_MOVING}", got=str(moving))
    parent_of: dict[str, str] = {}
    mimics: dict[str, Mimic] = {}
    for name, joint in joints.items():
        what = f"joint {name!r}"
        kind = joint.get("type")
        if kind not in _JOINT_TYPES:
            raise refuse(f"{what} has an unknown type", expected=", ".join(sorted(_JOINT_TYPES)),
                         got=kind or "none")  # fmt: skip
        ends = []
        for end in ("parent", "child"):
            element = joint.find(end)
            link = None if element is None else element.get("link")
            if not link:
                raise refuse(f"{what} has no {end} link")
            if link not in links:
                raise refuse(f"{what} names a {end} link that does not exist", got=repr(link))
            ends.append(link)
        parent, child = ends
        if child in parent_of:
            raise refuse(f"link {child!r} has two parent joints", got=f"the second is {name!r}")
        if parent == child:
            raise refuse(f"{what} joins link {child!r} to itself")
        parent_of[child] = parent
        _numbers(joint.find("origin"), ("xyz", "rpy"), 3, what, refuse)
        axis = _numbers(joint.find("axis"), ("xyz",), 3, what, refuse)
        if axis is not None and kind in ("revolute", "continuous", "prismatic", "planar"):
            size = math.sqrt(sum(x * x for x in axis))
            if size < 1e-9:
                raise refuse(f"{what} has a zero axis")
        limit = joint.find("limit")
        if kind in ("revolute", "prismatic"):
            if limit is None:
                limit = ET.SubElement(joint, "limit", effort="0", velocity="0")
                limit.set("lower", "-1e9")
                limit.set("upper", "1e9")
            for key, default in (("effort", "0"), ("velocity", "0")):
                limit.set(key, limit.get(key, default))
        if limit is not None:
            lower, upper, *_ = (
                (_numbers(limit, (key,), 1, what, refuse, math.inf) or [0.0])[0]
                for key in ("lower", "upper", "effort", "velocity")
            )
            if lower > upper and kind in ("revolute", "prismatic"):
                raise refuse(f"{what}: limits are the wrong way round", expected="lower <= upper",
                             got=f"{lower:g}, {upper:g}")  # fmt: skip
        mimic = joint.find("mimic")
        if mimic is not None:
            joint.remove(mimic)
            # A leader that does not exist matters only if the joint does: judged by the user.
            leader = mimic.get("joint")
            if not leader:
                raise refuse(f"{what}: mimic names no joint", expected="<mimic joint=...>")
            for follower in (name, leader):
                if follower in joints and joints[follower].get("type") in ("floating", "planar"):
                    raise refuse(f"{what} cannot mimic", expected="two joints with one coordinate",
                                 got=f"joint {follower!r} of type "
                                 f"{joints[follower].get('type')}")  # fmt: skip
            factor = _numbers(mimic, ("multiplier",), 1, what, refuse) or [1.0]
            offset = _numbers(mimic, ("offset",), 1, what, refuse) or [0.0]
            if kind != "fixed":
                mimics[name] = Mimic(leader, factor[0], offset[0])
    _check_tree(links, parent_of, refuse)
    for name in mimics:
        _check_mimic(name, mimics, refuse)
    _fix_followers(joints, mimics)
    for name, part in links.items():
        _check_inertial(part, f"link {name!r}", refuse)
    return mimics


def _strip(root: ET.Element, refuse: Any) -> None:
    """Remove what plays no part (shapes, materials, damping, ...); refuse parts given twice."""
    for element in list(root.iter()):
        shown = _SHOWN.get(element.tag, ())
        for child in list(element):
            if child.tag not in shown:
                element.remove(child)
        tags = [child.tag for child in element]
        for tag in set(tags):
            if element is not root and tags.count(tag) > 1:
                raise refuse(f"{element.tag} {element.get('name')!r} has several <{tag}>",
                             expected="one")  # fmt: skip
    root.attrib.pop("version", None)


def _fix_followers(joints: dict[str, ET.Element], mimics: dict[str, Mimic]) -> None:
    """Followers of a joint that stands still stand still at their offset."""
    standing = {name: 0.0 for name, joint in joints.items() if joint.get("type") == "fixed"}
    pending = dict(mimics)
    while found := {n: m for n, m in pending.items() if m.leader in standing}:
        for name, mimic in found.items():
            standing[name] = mimic.multiplier * standing[mimic.leader] + mimic.offset
            _fix(joints[name], standing[name])
            del pending[name], mimics[name]


def _fix(joint: ET.Element, position: float) -> None:
    """Make a joint fixed at a position."""
    origin, axis = joint.find("origin"), joint.find("axis")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    xyz, rpy, along = (
        np.array([float(x) for x in default.split()])
        for default in (
            origin.get("xyz", "0 0 0"),
            origin.get("rpy", "0 0 0"),
            "1 0 0" if axis is None else axis.get("xyz", "1 0 0"),
        )
    )
    step = np.zeros(6)
    step[3 * (joint.get("type") == "prismatic") :][:3] = along / np.linalg.norm(along) * position
    T = se3.from_roll_pitch_yaw(xyz, rpy) @ se3.exp(step)
    origin.set("xyz", " ".join(repr(float(x)) for x in T[:3, 3]))
    origin.set("rpy", " ".join(repr(float(x)) for x in se3.roll_pitch_yaw(T)))
    joint.set("type", "fixed")


def _names(root: ET.Element, tag: str, refuse: Any) -> dict[str, ET.Element]:
    found: dict[str, ET.Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise refuse(f"a {tag} has no name")
        if name in found:
            raise refuse(f"two {tag}s have the name {name!r}")
        found[name] = element
    return found


def _numbers(
    element: ET.Element | None,
    keys: tuple[str, ...],
    count: int,
    what: str,
    refuse: Any,
    largest: float = LARGEST_NUMBER,
) -> list[float] | None:
    """Finite numbers of the last of some attributes; all that are present are checked."""
    values = None
    for key in keys:
        text = None if element is None else element.get(key)
        if text is None or element is None:
            continue
        try:
            values = [float(part) for part in text.split()]
        except ValueError:
            values = []
        if len(values) != count or "_" in text or not all(math.isfinite(v) for v in values):
            raise refuse(
                f"{what}: {element.tag} {key} is not {count} finite number(s)", got=repr(text)
            )
        if any(abs(v) > largest for v in values):
            raise refuse(f"{what}: {element.tag} {key} is too large",
                         expected=f"at most {largest:g}", got=repr(text))  # fmt: skip
        element.set(key, " ".join(repr(v) for v in values))
    return values


def _check_tree(links: dict[str, ET.Element], parent_of: dict[str, str], refuse: Any) -> None:
    """Every link must hang from one root."""
    roots = [link for link in links if link not in parent_of]
    if not roots:
        raise refuse("links form a cycle: there is no root link", got=next(iter(parent_of)))
    settled: set[str] = set(roots)
    for link in links:
        trail: list[str] = []
        while link not in settled:
            trail.append(link)
            link = parent_of[link]
            if link in trail:
                raise refuse("links form a cycle", got=" -> ".join([*trail, link]))
        settled.update(trail)
    if len(roots) > 1:
        raise refuse("robot is not one tree", expected="one root link", got=", ".join(roots[:5]))


def _check_mimic(name: str, mimics: dict[str, Mimic], refuse: Any) -> None:
    seen = [name]
    while (leader := mimics[seen[-1]].leader) in mimics:
        if leader in seen:
            raise refuse("mimic joints follow each other", got=" -> ".join([*seen, leader]))
        seen.append(leader)


def _check_inertial(link: ET.Element, what: str, refuse: Any) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    _numbers(inertial.find("origin"), ("xyz", "rpy"), 3, what, refuse)
    mass = _numbers(inertial.find("mass"), ("value",), 1, what, refuse)
    if mass is None:
        raise refuse(f"{what}: inertial has no mass")
    if mass[0] < 0:
        raise refuse(f"{what}: mass is negative", got=f"{mass[0]:g}")
    # Statics needs masses and centres only; rotational inertia is set to zero so that files
    # without it, or with an impossible one, serve as well.
    zero = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0")
    ET.SubElement(inertial, "inertia", zero)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep the C++ parsers' own messages off the terminal; errors come as exceptions."""
    saved: list[tuple[int, int]] = []
    for target in (1, 2):
        with suppress(OSError):  # a stream that the caller has closed
            saved.append((target, os.dup(target)))
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for target, _ in saved:
            os.dup2(null, target)
        yield
    finally:
        for target, copy in saved:
            os.dup2(copy, target)
            os.close(copy)
        os.close(null)
