"""URDF: checked before Pinocchio sees it, and read for what Pinocchio drops.

What bears on statics is understood or refused; elements and attributes that neither URDF nor its
known extensions define are named in a note, and refused where they look like a slip of the pen.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.loading.plausible import large_lengths, turned
from cartstiff.loading.urdf_words import INERTIA, numbers_of, understood
from cartstiff.loading.yaml_file import LARGEST_NUMBER
from cartstiff.notes import Note

_MOST_JOINTS = 2000
#: Pinocchio's workspace takes a second to set up for 200 joints in a row, an hour for 2000.
MOST_MOVING = 200
_AXIAL_TYPES = {"revolute", "continuous", "prismatic"}
_JOINT_TYPES = {*_AXIAL_TYPES, "fixed", "floating", "planar"}


@dataclass(frozen=True)
class UrdfFacts:
    """What a URDF says beside what Pinocchio reads.

    Attributes
    ----------
    mimics : dict of str to Mimic
        Following joints by name.
    planar_axes : dict of str to ndarray (3,)
        Normals of the planes in which planar joints move, where they are not z.
    notes : list of Note
        What plays no part, and what was assumed.
    """

    mimics: dict[str, Mimic] = field(default_factory=dict)
    planar_axes: dict[str, se3.Array] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: position = multiplier * leader + offset."""

    leader: str
    multiplier: float
    offset: float


def prepare_urdf(root: ET.Element, where: str) -> UrdfFacts:
    """Check names, tree and numbers; give every inertia-less file what Pinocchio needs.

    Raises
    ------
    InputError
        One line with the file and the element that is wrong.
    """

    def refuse(what: str, **words: Any) -> InputError:
        return InputError(what, where=where, **words)

    if any(e.tag.startswith("{") and "xacro" in e.tag for e in root.iter()):
        raise refuse("is a xacro file", expected="a URDF: expand it with the xacro command first")
    if root.get("name") is None:
        raise refuse("robot has no name", expected="<robot name=...>")
    facts = UrdfFacts()
    dynamics = {joint.get("name"): joint.find("dynamics") for joint in root.iter("joint")}
    facts.notes.extend(understood(root, refuse))
    links = _names(root, "link", refuse)
    if not links:
        raise refuse("robot has no links")
    joints = _names(root, "joint", refuse)
    if len(joints) > _MOST_JOINTS:
        raise refuse("too many joints", expected=f"at most {_MOST_JOINTS}", got=str(len(joints)))
    moving = sum(joint.get("type") != "fixed" for joint in joints.values())
    if moving > MOST_MOVING:
        raise refuse("too many moving joints", expected=f"at most {MOST_MOVING}", got=str(moving))
    parent_of: dict[str, str] = {}
    mimics = facts.mimics
    for name, joint in joints.items():
        what = f"joint {name!r}"
        kind = joint.get("type")
        if kind not in _JOINT_TYPES:
            raise refuse(
                f"{what} has an unknown type",
                expected=", ".join(sorted(_JOINT_TYPES)),
                got=kind or "none",
            )
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
        numbers_of(joint.find("origin"), ("xyz", "rpy"), 3, what, refuse)
        axis = numbers_of(joint.find("axis"), ("xyz",), 3, what, refuse)
        if kind in (*_AXIAL_TYPES, "planar"):
            if axis is None and joint.find("axis") is not None:
                raise refuse(f"{what}: axis has no xyz", expected="<axis xyz=...>")
            if axis is not None and math.hypot(*axis) < numerics.CLOSE:
                raise refuse(f"{what} has a zero axis")
        if kind == "planar":
            _plane(name, axis, facts)
        damping = numbers_of(dynamics.get(name), ("damping",), 1, what, refuse)
        if damping is not None and kind in _AXIAL_TYPES:
            if damping[0] < 0.0:
                raise refuse(
                    f"{what}: damping is negative", expected="zero or more", got=f"{damping[0]:g}"
                )
            ET.SubElement(joint, "dynamics", damping=repr(damping[0]))
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
                (numbers_of(limit, (key,), 1, what, refuse, math.inf) or [0.0])[0]
                for key in ("lower", "upper", "effort", "velocity")
            )
            if lower > upper and kind in ("revolute", "prismatic"):
                raise refuse(
                    f"{what}: limits are the wrong way round",
                    expected="lower <= upper",
                    got=f"{lower:g}, {upper:g}",
                )
        mimic = joint.find("mimic")
        if mimic is not None:
            joint.remove(mimic)
            # A leader that does not exist matters only if the joint does: judged by the user.
            leader = mimic.get("joint")
            if not leader:
                raise refuse(f"{what}: mimic names no joint", expected="<mimic joint=...>")
            for follower in (name, leader):
                if follower in joints and joints[follower].get("type") in ("floating", "planar"):
                    raise refuse(
                        f"{what} cannot mimic",
                        expected="two joints with one coordinate",
                        got=f"joint {follower!r} of type {joints[follower].get('type')}",
                    )
            factor = numbers_of(mimic, ("multiplier",), 1, what, refuse) or [1.0]
            offset = numbers_of(mimic, ("offset",), 1, what, refuse) or [0.0]
            if kind != "fixed":
                mimics[name] = Mimic(leader, factor[0], offset[0])
    facts.notes.extend(_doubts(joints))
    _check_tree(links, parent_of, refuse)
    for name in mimics:
        _check_mimic(name, mimics, refuse)
    _fix_followers(joints, mimics)
    for name, part in links.items():
        if not _check_inertial(part, f"link {name!r}", refuse):
            words = f"link {name!r}: no body has this inertia; none counts, which vibrations feel"
            facts.notes.append(Note("impossible-inertia", words, {"link": name}))
    return facts


def _doubts(joints: Mapping[str, ET.Element]) -> list[Note]:
    """Notes of places that look like degrees or millimetres."""
    placed: dict[str, dict[str, list[float]]] = {"xyz": {}, "rpy": {}}
    for name, joint in joints.items():
        origin = joint.find("origin")
        for key, values in placed.items():
            if origin is not None and (text := origin.get(key)):
                values[f"{key} of joint {name}"] = [float(x) for x in text.split()]
    return [*turned(placed["rpy"]), *large_lengths(placed["xyz"])]


def _plane(name: str, axis: list[float] | None, facts: UrdfFacts) -> None:
    """Where a planar joint moves: across its axis; Pinocchio always takes z."""
    if axis is None:
        words = f"planar joint {name!r} has no axis: it moves across its frame's z axis"
        facts.notes.append(Note("planar-axis", words, {"joint": name}))
    elif axis[0] or axis[1] or axis[2] < 0:
        facts.planar_axes[name] = np.array(axis) / math.hypot(*axis)


def _fix_followers(joints: dict[str, ET.Element], mimics: dict[str, Mimic]) -> None:
    """Followers of a joint that stands still stand still at their offset."""
    standing = {name: 0.0 for name, joint in joints.items() if joint.get("type") == "fixed"}
    pending = dict(mimics)
    while ready := {n: m for n, m in pending.items() if m.leader in standing}:
        for name, mimic in ready.items():
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
    elements: dict[str, ET.Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise refuse(f"a {tag} has no name")
        if name in elements:
            raise refuse(f"two {tag}s have the name {name!r}")
        elements[name] = element
    return elements


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
    followed = [name]
    while (leader := mimics[followed[-1]].leader) in mimics:
        if leader in followed:
            raise refuse("mimic joints follow each other", got=" -> ".join([*followed, leader]))
        followed.append(leader)


def _check_inertial(link: ET.Element, what: str, refuse: Any) -> bool:
    """Whether some body has the moments of inertia, which else are taken away."""
    inertial = link.find("inertial")
    if inertial is None:
        return True
    numbers_of(inertial.find("origin"), ("xyz", "rpy"), 3, what, refuse)
    mass = numbers_of(inertial.find("mass"), ("value",), 1, what, refuse)
    if mass is None:
        raise refuse(f"{what}: inertial has no mass")
    if mass[0] < 0:
        raise refuse(f"{what}: mass is negative", got=f"{mass[0]:g}")
    # Statics needs masses and centres only: a file without rotational inertia, or with an
    # impossible one, serves as well, with none.
    inertia = inertial.find("inertia")
    if inertia is not None and _is_possible(inertia):
        return True
    if inertia is not None:
        inertial.remove(inertia)
    ET.SubElement(inertial, "inertia", dict.fromkeys(INERTIA, "0"))
    return inertia is None or mass[0] == 0.0


def _is_possible(inertia: ET.Element) -> bool:
    """Whether six numbers are the inertia of some body: principal ones keep the triangle rule."""
    try:
        xx, xy, xz, yy, yz, zz = (float(inertia.get(key, "")) for key in INERTIA)
    except ValueError:
        return False
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > LARGEST_NUMBER:
        return False
    small, middle, large = np.linalg.eigvalsh(matrix)
    # Printed digits: thin plates meet the rule with equality.
    return bool(small >= 0.0 and small + middle >= (1.0 - 1e-3) * large)
