"""Cable robots of CASPR: a file of cables and one of bodies, as a body held by straight cables.

Served are robots of one body that moves freely (SPATIAL_EULER_XYZ, SPATIAL_QUATERNION), with cables
from a point of the room to a point of the body. A linear spring's K_cable is its stiffness times
its length, taken at the pose of the file; cables that CASPR calls ideal have no stiffness of their
own. What the form has besides (several bodies, cables led over others, pulleys, springs of other
laws, muscles) is refused by name. [Lau]_
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff.errors import InputError, one_line
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.build import build_platform, with_given
from cartstiff.loading.robot_description import parse_text
from cartstiff.loading.schema import SpringsFile
from cartstiff.loading.yaml_file import read_text
from cartstiff.mechanisms.elastic import ElasticMechanism, Note

__all__ = ["is_caspr", "read_caspr"]

#: Stiffness [N/m] of cables that have none in the file.
ASSUMED = 1e5
_FREE = ("SPATIAL_EULER_XYZ", "SPATIAL_QUATERNION")
_KINDS = ("cable_ideal", "cable_linear_spring")
# A document type as these files have: attributes' types, or the name of a file that has them, which
# is not read; and nothing that is replaced.
_DOCUMENT_TYPE = re.compile(
    r"""<!DOCTYPE\s+\w+\s*(SYSTEM\s*("[^"]*"|'[^']*'))?\s*(\[(?:(?!<!ENTITY)[^\]])*\])?\s*>"""
)


def is_caspr(path: Path) -> bool:
    """Whether a file is one of cables or bodies of CASPR."""
    if path.suffix.lower() != ".xml" or not path.is_file():
        return False
    with path.open("rb") as file:
        begin = file.read(4096).decode("utf-8", errors="replace")
    begin = re.sub(r"<!--.*?-->", "", _DOCUMENT_TYPE.sub("", begin), flags=re.DOTALL)
    return re.match(r"\s*(<\?xml[^>]*\?>)?\s*<(cables|links|bodies_system)\b", begin) is not None


def read_caspr(path: Path, given: dict[str, Any]) -> ElasticMechanism:
    """The elastic mechanism of a CASPR robot; `path` is its file of cables or of bodies.

    Raises
    ------
    InputError
        With file and cable, for anything that is not served.
    """
    root = _root(path)
    other = _sibling(path, root.tag)
    cables, bodies = (root, _root(other)) if root.tag == "cables" else (_root(other), root)
    where = one_line(str(path if root.tag == "cables" else other))
    notes: list[Note] = []
    body, T, com = _body(bodies, one_line(str(other if root.tag == "cables" else path)), notes)
    lines = [_cable(c, com, where) for c in _cable_set(cables, where, notes)]
    base, platform = np.array([c[0] for c in lines]), np.array([c[1] for c in lines])
    lengths = np.linalg.norm(platform @ T[:3, :3].T + T[:3, 3] - base, axis=1)
    if not lengths.all():
        raise InputError("a cable has no length at the pose of the file", where=where)
    ideal = [c[2] for c in lines if c[3] is None]
    stiffness = [
        ASSUMED if c[3] is None else c[3] / size for c, size in zip(lines, lengths, strict=True)
    ]
    if ideal:
        words = f"{len(ideal)} cable(s) are ideal: {ASSUMED:g} N/m is taken for {', '.join(ideal)}"
        notes.append(Note("stiffness-assumed", words, {"stiffness": ASSUMED, "cables": ideal}))
    if len(ideal) < len(lines):
        words = "the stiffness of cables that are springs is that at the length of the file's pose"
        notes.append(Note("stiffness-at-pose", words, {"stiffness": [float(k) for k in stiffness]}))
    file = SpringsFile.model_validate(
        {
            "kind": "springs", "unilateral": True, "base": base.tolist(),
            "platform": platform.tolist(), "body": body,
            "pose": {"xyz": T[:3, 3].tolist(), "rpy": se3.roll_pitch_yaw(T).tolist()},
            "legs": {"stiffness": [float(k) for k in stiffness]},
        }
    )  # fmt: skip
    name = re.sub(r"_?(cables|bodies)$", "", path.stem) or path.stem
    elastic = build_platform(with_given(file, given, where), where, name)
    return replace(elastic, notes=(*notes, *elastic.notes))


def _root(path: Path) -> ET.Element:
    return parse_text(_DOCUMENT_TYPE.sub("", read_text(path)), one_line(str(path)))


def _sibling(path: Path, tag: str) -> Path:
    own, wanted = ("cables", "bodies") if tag == "cables" else ("bodies", "cables")
    other = path.with_name(path.name.replace(own, wanted))
    if other == path or not other.is_file():
        raise InputError(
            f"the file of {wanted} is missing", where=one_line(str(path)),
            expected=f"NAME_{own}.xml beside NAME_{wanted}.xml", got=one_line(other.name),
        )  # fmt: skip
    return other


def _numbers(text: str | None, count: int, what: str, where: str) -> Array:
    try:
        numbers = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        numbers = np.empty(0)
    if numbers.size != count or not np.isfinite(numbers).all():
        raise InputError(f"{what} cannot be used", where=where, expected=f"{count} numbers",
                         got=repr(one_line((text or "").strip(), 80)))  # fmt: skip
    return numbers


def _body(root: ET.Element, where: str, notes: list[Note]) -> tuple[dict[str, Any], Array, Array]:
    """Masses, the pose of the file, and the mass centre in the body's joint frame."""
    if root.tag == "bodies_system":  # as newer files have it
        inner = root.find("links")
        root = root if inner is None else inner
    links = [element for element in root if element.tag == "link_rigid"]
    others = sorted({e.tag for e in root} - {"link_rigid", "operational_spaces"})
    if len(links) != 1 or others:
        raise InputError("only robots of one rigid body are supported", where=where,
                         got=", ".join([f"{len(links)} rigid bodies", *others]))  # fmt: skip
    (link,) = links
    joint = link.find("joint")
    declared = None if joint is None else joint.get("type")
    kind = (link.findtext("joint_type") or declared or "").strip()
    if kind not in _FREE:
        raise InputError("only bodies that move freely are supported", where=where,
                         expected=" or ".join(_FREE), got=kind or "no joint type")  # fmt: skip
    at = _numbers(link.findtext("parent/location", "0 0 0"), 3, "location in the parent", where)
    T, initial = se3.pose(translation=at), None if joint is None else joint.get("q_initial")
    if initial and kind == _FREE[0]:
        q = _numbers(initial, 6, "q_initial", where)
        R = np.eye(3)
        for axis, angle in zip(np.eye(3), q[3:], strict=True):
            R = R @ se3.exp(np.concatenate([axis * angle, np.zeros(3)]))[:3, :3]
        T = se3.pose(R, at + q[:3])
    else:
        words = "the pose is that of the coordinates zero"
        words += ": the first pose of a quaternion is not read" if initial else ""
        notes.append(Note("default-posture", words, {"xyz": at.tolist()}))
    physical = "physical/"
    com = _numbers(link.findtext(physical + "com_location", "0 0 0"), 3, "com_location", where)
    mass = _numbers(link.findtext(physical + "mass", "0"), 1, "mass", where)
    inertia = np.zeros((3, 3))
    for i, a in enumerate("xyz"):
        for j, b in enumerate("xyz"):
            name = f"I{min(a, b)}{max(a, b)}"
            text = link.findtext(f"{physical}inertia/{name}", "0")
            inertia[i, j] = _numbers(text, 1, name, where)[0]
    body: dict[str, Any] = {"mass": float(mass[0]), "com": com.tolist()}
    about = link.find(physical + "inertia")
    if about is not None and about.get("ref", "com") == "com" and mass[0] > 0:
        body["inertia"] = inertia.tolist()
    return body, T, com


def _cable_set(root: ET.Element, where: str, notes: list[Note]) -> list[ET.Element]:
    sets = {str(s.get("id")): s for s in root.findall("cable_set")}
    if not sets:
        raise InputError("no set of cables", where=where)
    name = root.get("default_cable_set") or next(iter(sets))
    if name not in sets:
        raise InputError("the default set of cables does not exist", where=where, got=repr(name))
    if len(sets) > 1:
        words = f"of the sets of cables {', '.join(sets)} the file's {name} is taken"
        notes.append(Note("cable-set", words, {"set": name, "sets": list(sets)}))
    cables = list(sets[name])
    if not cables:
        raise InputError("a set without cables", where=where, got=name)
    return cables


def _cable(cable: ET.Element, com: Array, where: str) -> tuple[Array, Array, str, float | None]:
    """Point in the room, point of the body, name, and stiffness times length if there is one."""
    name = cable.get("name", "") or "without a name"
    place = f"{where}, cable {one_line(name)}"
    if cable.tag not in _KINDS:
        raise InputError("this kind of cable is not modelled", where=place,
                         expected=" or ".join(_KINDS), got=cable.tag)  # fmt: skip
    for element in cable.iter():
        if any("pulley" in word.lower() for word in (element.tag, *map(str, element.attrib))):
            raise InputError("pulleys are not modelled: cables are straight between two points",
                             where=place, got=element.tag)  # fmt: skip
    ends = cable.findall("attachments/attachment")
    if len(ends) != 2:
        raise InputError("cables are straight: led over no other point", where=place,
                         expected="2 attachments", got=len(ends))  # fmt: skip
    points: dict[str, Array] = {}
    for end in ends:
        points[(end.findtext("link") or "").strip()] = _numbers(
            end.findtext("location"), 3, "location", place
        )
    if set(points) != {"0", "1"}:
        raise InputError("cables join the room, link 0, and the body, link 1", where=place,
                         got=", ".join(points))  # fmt: skip
    reference = cable.get("attachment_reference", "joint")
    if reference not in ("joint", "com"):
        raise InputError("unknown attachment_reference", where=place, expected="joint or com",
                         got=reference)  # fmt: skip
    product = cable.findtext("properties/K_cable")
    if cable.tag == "cable_linear_spring":
        size = float(_numbers(product, 1, "K_cable", place)[0])
        if not size > 0:
            raise InputError("K_cable cannot be used", where=place, expected="above zero",
                             got=f"{size:g}")  # fmt: skip
        return points["0"], points["1"] + com * (reference == "com"), name, size
    return points["0"], points["1"] + com * (reference == "com"), name, None
