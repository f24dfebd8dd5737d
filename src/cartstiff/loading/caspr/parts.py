"""Elements of CASPR's files: bodies with their joints, and cables."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.errors import InputError, one_line
from cartstiff.geometry.se3 import Array

#: Stiffness [N/m] of cables that have none in the file.
ASSUMED = 1e5
_PASSIVE = "cable_passive_linear_spring"
_KINDS = ("cable_ideal", "cable_linear_spring", _PASSIVE)


def numbers(text: str | None, count: int, what: str, where: str) -> Array:
    """As many numbers as there must be.

    Raises
    ------
    InputError
        For any other text.
    """
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.empty(0)
    if values.size != count or not np.isfinite(values).all():
        raise InputError(
            f"{what} cannot be used",
            where=where,
            expected=f"{count} numbers",
            got=repr(one_line((text or "").strip(), 80)),
        )
    return values


@dataclass(frozen=True)
class JointOf:
    """The joint of a body: its kind, and what the file says of it."""

    kind: str
    said: dict[str, str]

    @property
    def actuated(self) -> bool:
        """Whether a motor moves it, and no cable."""
        return self.said.get("actuated", "").strip().lower() == "true"

    def values(self, key: str, count: int, where: str) -> Array:
        """Coordinates of the pose of the file ("initial"), or their limits ("min", "max")."""
        text = self.said.get(f"q_{key}")
        if text is None:
            return np.full(count, {"initial": 0.0, "min": -np.inf, "max": np.inf}[key])
        return numbers(text, count, f"q_{key}", where)

    def axis(self, where: str) -> Array:
        """Unit vector of a joint about or along an axis of its own."""
        direction = numbers(self.said.get("axis"), 3, "axis", where)
        if not direction.any():
            raise InputError("axis is zero", where=where)
        return np.asarray(direction / np.linalg.norm(direction))


def joint_of(link: ET.Element, where: str) -> JointOf:
    """The joint of a body."""
    joint = link.find("joint")
    declared = None if joint is None else joint.get("type")
    kind = (link.findtext("joint_type") or declared or "").strip()
    if not kind:
        raise InputError("a body without a joint type", where=where)
    return JointOf(kind, {} if joint is None else dict(joint.attrib))


def mass_of(link: ET.Element, where: str) -> tuple[float, Array, Array | None]:
    """Mass, its centre in the joint's frame, and the inertia about it where that is given."""
    physical = "physical/"
    com = numbers(link.findtext(physical + "com_location", "0 0 0"), 3, "com_location", where)
    mass = float(numbers(link.findtext(physical + "mass", "0"), 1, "mass", where)[0])
    inertia = np.zeros((3, 3))
    for i, a in enumerate("xyz"):
        for j, b in enumerate("xyz"):
            name = f"I{min(a, b)}{max(a, b)}"
            text = link.findtext(f"{physical}inertia/{name}", "0")
            inertia[i, j] = numbers(text, 1, name, where)[0]
    about = link.find(physical + "inertia")
    known = about is not None and about.get("ref", "com") == "com" and mass > 0
    return mass, com, inertia if known else None


def body_of(link: ET.Element, where: str) -> tuple[JointOf, Any]:
    """Its joint, and Pinocchio's inertia."""
    mass, com, inertia = mass_of(link, where)
    if mass < 0:
        raise InputError("mass is negative", where=where, got=f"{mass:g}")
    about = np.zeros((3, 3)) if inertia is None else inertia
    return joint_of(link, where), pin.Inertia(mass, com, about)


@dataclass(frozen=True)
class Cable:
    """A straight cable: the bodies and points that it joins, and how stiff it is.

    Attributes
    ----------
    name : str
        For messages.
    links : tuple of str
        Numbers of its two bodies; "0" is the room.
    points : tuple of ndarray (3,)
        In the frames of their joints.
    product : float or None
        Stiffness times length; None of cables that are ideal.
    stiffness : float
        Force per length, of a passive spring; else what is assumed until the length is known.
    rest_length : float or None
        Of a passive spring.
    tensions : tuple of two floats
        Least and largest tension.
    """

    name: str
    links: tuple[str, str]
    points: tuple[Array, Array]
    product: float | None
    stiffness: float
    rest_length: float | None
    tensions: tuple[float, float]


def cable_of(cable: ET.Element, centres: dict[str, Array], where: str) -> Cable:
    """A cable, where `centres` are the mass centres of the bodies by number.

    Raises
    ------
    InputError
        For what is not modelled, by name.
    """
    name = cable.get("name", "") or "without a name"
    place = f"{where}, cable {one_line(name)}"
    if cable.tag not in _KINDS:
        raise InputError(
            "this kind of cable is not modelled",
            where=place,
            expected=" or ".join(_KINDS),
            got=cable.tag,
        )
    for element in cable.iter():
        if any("pulley" in word.lower() for word in (element.tag, *map(str, element.attrib))):
            raise InputError(
                "pulleys are not modelled: cables are straight between two points",
                where=place,
                got=element.tag,
            )
    ends = cable.findall("attachments/attachment")
    if len(ends) != 2:
        raise InputError(
            "cables are straight: led over no other point",
            where=place,
            expected="2 attachments",
            got=len(ends),
        )
    reference = cable.get("attachment_reference", "joint")
    if reference not in ("joint", "com"):
        raise InputError(
            "unknown attachment_reference", where=place, expected="joint or com", got=reference
        )
    links, points = [], []
    for end in ends:
        link = (end.findtext("link") or "").strip()
        point = numbers(end.findtext("location"), 3, "location", place)
        if link != "0" and link not in centres:
            raise InputError(
                "a cable ends on no body of the file",
                where=place,
                expected=f"link 0 to {len(centres)}",
                got=link or "none",
            )
        links.append(link)
        points.append(point + centres[link] * (reference == "com") if link != "0" else point)
    if links[0] == links[1]:
        raise InputError(
            "a cable joins two different bodies", where=place, got=f"{links[0]}, {links[1]}"
        )

    def above_zero(key: str, *others: str) -> float:
        text = next((t for k in (key, *others) if (t := cable.findtext(f"properties/{k}"))), None)
        size = float(numbers(text, 1, key, place)[0])
        if not size > 0:
            raise InputError(
                f"{key} cannot be used", where=place, expected="above zero", got=f"{size:g}"
            )
        return size

    limits = []
    for key, default in (("force_min", "0"), ("force_max", "inf")):
        text = cable.findtext(f"properties/{key}", default)
        limits.append(np.inf if text == "inf" else float(numbers(text, 1, key, place)[0]))
    product = stiffness = rest = None
    if cable.tag == "cable_linear_spring":
        product = above_zero("K_cable", "K")
    if cable.tag == _PASSIVE:
        stiffness, rest = above_zero("K", "K_cable"), above_zero("l0", "l_0")
    return Cable(
        name,
        (links[0], links[1]),
        (points[0], points[1]),
        product,
        stiffness or ASSUMED,
        rest,
        (max(limits[0], 0.0), limits[1]),
    )
