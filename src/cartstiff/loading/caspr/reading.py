"""Cable robots of CASPR: a file of cables and one of bodies.

A body that moves freely (SPATIAL_EULER_XYZ, SPATIAL_QUATERNION) on cables from the room becomes a
body held by straight cables; bodies on joints, with cables between any two of them, a chain. A
linear spring's K_cable is its stiffness times its length, taken at the pose of the file; cables
that CASPR calls ideal have no stiffness of their own. What the form has besides (cables led over
other points, pulleys, springs of other laws, muscles) is refused by name. [Lau]_
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
from cartstiff.loading.build import build_platform, with_overrides
from cartstiff.loading.caspr.chain import read_chain
from cartstiff.loading.caspr.parts import ASSUMED, cable_of, joint_of, mass_of, numbers
from cartstiff.loading.robot_description import parse_text
from cartstiff.loading.schema import SpringsFile
from cartstiff.loading.yaml_file import read_text
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notes import Note

_FREE = ("SPATIAL_EULER_XYZ", "SPATIAL_QUATERNION")
# A document type as these files have: attributes' types, or the name of a file that has them, which
# is not read; and nothing that is replaced.
_DOCUMENT_TYPE = re.compile(
    r"""<!DOCTYPE\s+\w+\s*((SYSTEM|PUBLIC\s*"[^"]*")\s*("[^"]*"|'[^']*'))?\s*(\[(?:(?!<!ENTITY)[^\]])*\])?\s*>"""
)


def is_caspr(path: Path) -> bool:
    """Whether a file is one of cables or bodies of CASPR."""
    if path.suffix.lower() != ".xml" or not path.is_file():
        return False
    with path.open("rb") as file:
        begin = file.read(4096).decode("utf-8", errors="replace")
    begin = re.sub(
        r"<!--.*?-->", "", _DOCUMENT_TYPE.sub("", begin.lstrip("\ufeff")), flags=re.DOTALL
    )
    return re.match(r"\s*(<\?xml[^>]*\?>)?\s*<(cables|links|bodies_system)\b", begin) is not None


def read_caspr(path: Path, overrides: dict[str, Any]) -> ElasticMechanism:
    """The elastic mechanism of a CASPR robot; `path` is its file of cables or of bodies.

    Raises
    ------
    InputError
        With file and cable, for anything that is not served.
    """
    root = _root(path)
    other = _sibling(path, root.tag)
    cables, bodies = (root, _root(other)) if root.tag == "cables" else (_root(other), root)
    where, of_bodies = (
        one_line(str(p)) for p in ((path, other) if cables is root else (other, path))
    )
    notes: list[Note] = []
    links = _links(bodies, of_bodies)
    centres = {
        str(i + 1): mass_of(link, f"{of_bodies}, body {i + 1}")[1] for i, link in enumerate(links)
    }
    lines = [cable_of(c, centres, where) for c in _cable_set(cables, where, notes)]
    name = re.sub(r"_?(cables|bodies)$", "", path.stem) or path.stem
    ideal = [c.name for c in lines if c.product is None and c.rest_length is None]
    if ideal:
        words = f"{len(ideal)} cable(s) are ideal: {ASSUMED:g} N/m is taken for {', '.join(ideal)}"
        notes.append(Note("stiffness-assumed", words, {"stiffness": ASSUMED, "cables": ideal}))
    alone = len(links) == 1 and joint_of(links[0], of_bodies).kind in _FREE
    if not alone or any(c.rest_length is not None or "0" not in c.links for c in lines):
        return read_chain(links, lines, overrides, of_bodies, name, notes)
    body, T = _body(links[0], of_bodies, notes)
    ends = np.array([c.points if c.links[0] == "0" else c.points[::-1] for c in lines])
    base, platform = ends[:, 0], ends[:, 1]
    lengths = np.linalg.norm(platform @ T[:3, :3].T + T[:3, 3] - base, axis=1)
    if not lengths.all():
        raise InputError("a cable has no length at the pose of the file", where=where)
    stiffness = [
        ASSUMED if c.product is None else c.product / float(size)
        for c, size in zip(lines, lengths, strict=True)
    ]
    if len(ideal) < len(lines):
        words = "the stiffness of cables that are springs is that at the length of the file's pose"
        notes.append(Note("stiffness-at-pose", words, {"stiffness": stiffness}))
    file = SpringsFile.model_validate(
        {
            "kind": "springs",
            "unilateral": True,
            "base": base.tolist(),
            "platform": platform.tolist(),
            "body": body,
            "pose": {"xyz": T[:3, 3].tolist(), "rpy": se3.roll_pitch_yaw(T).tolist()},
            "legs": {"stiffness": stiffness},
        }
    )
    elastic = build_platform(with_overrides(file, overrides, where), where, name)
    return replace(elastic, notes=(*notes, *elastic.notes))


def _links(root: ET.Element, where: str) -> list[ET.Element]:
    """The rigid bodies."""
    if root.tag == "bodies_system":  # as newer files have it
        inner = root.find("links")
        root = root if inner is None else inner
    others = sorted({e.tag for e in root} - {"link_rigid", "operational_spaces"})
    links = root.findall("link_rigid")
    if others or not links:
        raise InputError(
            "only rigid bodies are supported",
            where=where,
            got=", ".join([f"{len(links)} rigid bodies", *others]),
        )
    return links


def _body(link: ET.Element, where: str, notes: list[Note]) -> tuple[dict[str, Any], Array]:
    """Masses of a body that moves freely, and the pose of the file."""
    joint = joint_of(link, where)
    at = numbers(link.findtext("parent/location", "0 0 0"), 3, "location in the parent", where)
    T = se3.pose(translation=at)
    if joint.said.get("q_initial") and joint.kind == _FREE[0]:
        q = joint.values("initial", 6, where)
        R = np.eye(3)
        for axis, angle in zip(np.eye(3), q[3:], strict=True):
            R = R @ se3.exp(np.concatenate([axis * angle, np.zeros(3)]))[:3, :3]
        T = se3.pose(R, at + q[:3])
    else:
        words = "the pose is that of the coordinates zero"
        words += ": the first pose of a quaternion is not read" * bool(joint.said.get("q_initial"))
        notes.append(Note("default-posture", words, {"xyz": at.tolist()}))
    mass, com, inertia = mass_of(link, where)
    body: dict[str, Any] = {"mass": mass, "com": com.tolist()}
    if inertia is not None:
        body["inertia"] = inertia.tolist()
    return body, T


def _root(path: Path) -> ET.Element:
    return parse_text(_DOCUMENT_TYPE.sub("", read_text(path).lstrip("\ufeff")), one_line(str(path)))


def _sibling(path: Path, tag: str) -> Path:
    own, wanted = ("cables", "bodies") if tag == "cables" else ("bodies", "cables")
    other = path.with_name(path.name.replace(own, wanted))
    if other == path or not other.is_file():
        raise InputError(
            f"the file of {wanted} is missing",
            where=one_line(str(path)),
            expected=f"NAME_{own}.xml beside NAME_{wanted}.xml",
            got=one_line(other.name),
        )
    return other


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
