"""The words of URDF: what is understood, what plays no part, what looks like a slip of the pen."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from difflib import get_close_matches
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff import numerics
from cartstiff.geometry import se3
from cartstiff.loading.yaml_file import LARGEST_NUMBER
from cartstiff.notes import Note

_VERSIONS = ("1.0", "1.1", "1.2")


# What Pinocchio is shown of a URDF; of the rest it might refuse what plays no part here.
_SHOWN = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
}


INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


# Further elements of URDF and of what is usually written into it: none bears on statics.
_SILENT = {
    "robot": ("material", "gazebo", "transmission", "ros2_control", "sensor", "group"),
    "link": (
        "visual",
        "collision",
        "material",
        "gazebo",
        "sensor",
        "contact",
        "surface",
        "gravity",
        "kinematic",
        "self_filter",
        "self_collision_checking",
        "collision_checking",
    ),
    "joint": ("dynamics", "calibration", "safety_controller", "gazebo"),
}


# All attributes of the elements that are shown, and such as are met in the wild.
_ATTRIBUTES = {
    "robot": ("name", "version"),
    "link": ("name", "type"),
    "joint": ("name", "type", "dont_collapse"),
    "origin": ("xyz", "rpy", "quat_xyzw"),
    "axis": ("xyz",),
    "parent": ("link",),
    "child": ("link",),
    "mass": ("value",),
    "inertia": INERTIA,
    "mimic": ("joint", "multiplier", "offset"),
    "limit": (
        "lower",
        "upper",
        "effort",
        "velocity",
        "acceleration",
        "deceleration",
        "jerk",
        "current",
        "gear_velocity",
        "command_effort",
    ),
}


# Where nothing but these attributes makes sense: nothing else may stand there, nor inside.
_STRICT = ("origin", "axis", "parent", "child", "mass", "mimic")


# Names that simulators give to the stiffness of a joint and its rest position.
_SPRING = re.compile(r"spring_?(stiffness|reference)|^stiffness$", re.IGNORECASE)


# What an attribute looks like that stands outside of a tag.
_ASSIGNMENT = re.compile(r"\w\s*=\s*[\"']")


# Likeness (difflib's ratio) from which on an unknown name is taken for a slip of the pen: one
# letter too many, too few or exchanged in a name of four gives 0.75 and more.
_ALIKE = 0.7


def understood(root: ET.Element, refuse: Any) -> list[Note]:
    """Take out what plays no part; refuse what looks like a slip of the pen, or stands twice.

    Returns the note that names what is not known.
    """
    version = root.attrib.pop("version", "1.0").strip()
    if version not in _VERSIONS:
        raise refuse("unknown version of URDF", expected=", ".join(_VERSIONS), got=repr(version))
    unknown: list[str] = []
    pending = [(root, "")]
    while pending:
        element, inside = pending.pop()
        place = f"{element.tag} {element.get('name')!r}" if element.get("name") else element.tag
        place = place if element.get("name") else f"{inside}{place}"
        _check_attributes(element, place, unknown, refuse)
        _check_text(element, place, unknown, refuse)
        shown = _SHOWN.get(element.tag, ())
        for child in list(element):
            if child.tag in shown:
                pending.append((child, "" if element is root else f"{place}: "))
                continue
            element.remove(child)
            unknown += _springs_within(child, place)
            if child.tag in _SILENT.get(element.tag, ()) or child.tag.startswith("{"):
                continue  # a tag with a namespace is an extension
            _refuse_slip(child.tag, shown, f"{place}: unknown element", f"<{child.tag}>", refuse)
            if element.tag in _STRICT:
                raise refuse(
                    f"{place} holds an element", expected="attributes only", got=f"<{child.tag}>"
                )
            unknown.append(f"<{child.tag}> in <{element.tag}>")
        tags = [child.tag for child in element]
        for tag in set(tags):
            if element is not root and tags.count(tag) > 1:
                raise refuse(f"{place} has several <{tag}>", expected="one")
        if element.tag == "origin" and element.get("quat_xyzw") is not None:
            _quaternion_to_angles(element, version, place, refuse)
    if not unknown:
        return []
    names = list(dict.fromkeys(unknown))
    shown_names = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    words = f"what is not URDF plays no part: {shown_names}"
    return [Note("ignored", words, {"elements": names})]


def _springs_within(element: ET.Element, place: str) -> list[str]:
    """Springs of joints, which simulators take from elements and attributes of their own."""
    whose = element.get("reference") or place
    words = [part.tag for part in element.iter() if _SPRING.search(part.tag)]
    words += [key for part in element.iter() for key in part.attrib if _SPRING.search(key)]
    return [f"{word} of {whose}" for word in dict.fromkeys(words)]


def _check_attributes(element: ET.Element, place: str, unknown: list[str], refuse: Any) -> None:
    known = _ATTRIBUTES.get(element.tag, ())
    strange = [key for key in element.attrib if key not in known and not key.startswith("{")]
    for key in strange:
        what = f"{place}: unknown attribute"
        if element.tag in _STRICT:
            raise refuse(what, expected=", ".join(known), got=key)
        _refuse_slip(key, known[:4], what, key, refuse)
        unknown.append(f"{key}= in <{element.tag}>")
    if strange and element.tag == "limit" and not {"lower", "upper"} & set(element.attrib):
        raise refuse(
            f"{place}: no lower and no upper",
            expected="lower=... upper=...",
            got=", ".join(strange),
        )


def _check_text(element: ET.Element, place: str, unknown: list[str], refuse: Any) -> None:
    """URDF says everything by attributes: text is one that has lost its tag, or a remark."""
    for text in (element.text, *(child.tail for child in element)):
        words = (text or "").strip()
        if not words:
            continue
        if element.tag in _STRICT or _ASSIGNMENT.search(words):
            raise refuse(
                f"{place} holds text",
                expected="attributes only, within a tag",
                got=repr(words[:40]),
            )
        unknown.append(f"text {words[:40]!r} in <{element.tag}>")


def _refuse_slip(name: str, known: tuple[str, ...], what: str, got: str, refuse: Any) -> None:
    close = get_close_matches(name.lower(), known, n=1, cutoff=_ALIKE)
    if close:
        raise refuse(what, expected=close[0], got=got)


def _quaternion_to_angles(origin: ET.Element, version: str, place: str, refuse: Any) -> None:
    """Write the rotation of an origin as roll, pitch, yaw; equal to rounding."""
    if version == "1.0":
        raise refuse(f"{place}: quat_xyzw needs URDF 1.1", expected='<robot version="1.1">')
    if origin.get("rpy") is not None:
        raise refuse(f"{place} has both rpy and quat_xyzw", expected="one of them")
    quaternion = np.array(
        numbers_of(origin, ("quat_xyzw",), 4, place.removesuffix(": origin"), refuse)
    )
    if np.linalg.norm(quaternion) < numerics.CLOSE:
        raise refuse(f"{place}: quat_xyzw is zero", expected="a rotation")
    del origin.attrib["quat_xyzw"]
    R = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix()
    angles = se3.roll_pitch_yaw(se3.pose(R))
    origin.set("rpy", " ".join(repr(float(x)) for x in angles))


def numbers_of(
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
            raise refuse(
                f"{what}: {element.tag} {key} is too large",
                expected=f"at most {largest:g}",
                got=repr(text),
            )
        element.set(key, " ".join(repr(v) for v in values))
    return values
