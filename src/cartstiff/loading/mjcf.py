"""What Pinocchio leaves out of an MJCF file: joint springs, loop closures, further bodies.

Pinocchio reads the first child of the worldbody only, keeps no joint stiffness, and drops equality
constraints. Here the worldbody's children are put under one fixed body, defaults are resolved, and
the dropped facts are returned.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.yaml_file import LARGEST_NUMBER

__all__ = ["MjcfClosure", "MjcfFacts", "MjcfJoint", "merged_worldbody", "prepare_mjcf"]

#: Name of the fixed body put around the worldbody's children.
ROOT = "cartstiff_root"


@dataclass(frozen=True)
class MjcfJoint:
    """Spring of a joint: stiffness (N m/rad, N/m) and rest position."""

    name: str
    type: str
    stiffness: float
    rest: float


@dataclass(frozen=True)
class MjcfClosure:
    """A ``connect`` (point) or ``weld`` equality between two bodies.

    Attributes
    ----------
    anchor : tuple of float
        ``connect``: the point in body a; ``weld``: the point in body b.
    relative_pose : tuple of float or None
        ``weld``: position and quaternion of body b in body a, if given.
    """

    type: str
    body_a: str
    body_b: str
    anchor: tuple[float, ...]
    relative_pose: tuple[float, ...] | None


@dataclass(frozen=True)
class MjcfFacts:
    """Everything read beside Pinocchio.

    Attributes
    ----------
    joints : dict of str to MjcfJoint
        By joint name.
    closures : tuple of MjcfClosure
        Active equality constraints.
    body_joints : dict of str to list of str
        Names of the joints of each body, in order: Pinocchio makes one composite of them.
    ignored : tuple of str
        Things in the file that play no part, in words.
    """

    joints: dict[str, MjcfJoint] = field(default_factory=dict)
    closures: tuple[MjcfClosure, ...] = ()
    body_joints: dict[str, list[str]] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()

    @property
    def joint_count(self) -> int:
        """Number of joints."""
        return len(self.joints)


def prepare_mjcf(root: ET.Element, where: str) -> MjcfFacts:
    """Rewrite the XML for Pinocchio in place and return what it drops.

    Raises
    ------
    InputError
        For a file without bodies, includes, or values that are not numbers.
    """
    if next(root.iter("include"), None) is not None:
        raise InputError("MJCF includes are not supported", where=where, expected="one whole file")
    worldbody = merged_worldbody(root)
    if worldbody is None or worldbody.find("body") is None:
        raise InputError("MJCF has no bodies", where=where, expected="<worldbody> with <body>")
    degrees, sequence = True, "xyz"
    for compiler in root.findall("compiler"):
        _check_compiler(compiler, where)
        degrees = compiler.get("angle", "degree" if degrees else "radian") != "radian"
        sequence = compiler.get("eulerseq", sequence)
    angles = _Angles(math.pi / 180 if degrees else 1.0, sequence)
    defaults = _Defaults(root, angles, where)
    joints: dict[str, MjcfJoint] = {}
    body_joints: dict[str, list[str]] = {}
    soft = _walk(worldbody, None, defaults, angles, joints, body_joints, where)
    bodies = worldbody.findall("body")
    wrapper = ET.Element("body", name=ROOT)
    for body in bodies:
        worldbody.remove(body)
        wrapper.append(body)
    worldbody.append(wrapper)
    closures, ignored = _closures(root, where)
    _strip(root)
    return MjcfFacts(joints, closures, body_joints, (*ignored, *soft))


#: What Pinocchio is shown of an MJCF file, and the attributes of each element: number of numbers,
#: 0 for one or more, None for text. It reads what is malformed as anything at all.
_ORIENTATIONS = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}
_PLACE = {"name": None, "class": None, "pos": 3, **_ORIENTATIONS}
_SHOWN: dict[str, dict[str, int | None]] = {
    "body": {**_PLACE, "childclass": None},
    "joint": {
        "name": None, "class": None, "type": None, "pos": 3, "axis": 3, "range": 2, "ref": 1,
        "limited": None, "stiffness": 1, "springref": 1,
    },
    "freejoint": {"name": None},
    "inertial": {**_PLACE, "mass": 1, "diaginertia": 3, "fullinertia": 6},
    "geom": {**_PLACE, "type": None, "size": 0, "fromto": 6, "mass": 1, "density": 1},
    "site": _PLACE,
}  # fmt: skip
_COMPILER = {
    "angle": ("degree", "radian"),
    "coordinate": ("local",),
    "autolimits": ("true", "false"),
    "inertiafromgeom": ("true", "false", "auto"),
}
_MASSIVE = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
_BODIES_ELSEWHERE = ("frame", "replicate", "attach", "composite", "flexcomp")


def merged_worldbody(root: ET.Element) -> ET.Element | None:
    """The worldbody; MuJoCo joins several into one."""
    found = root.findall("worldbody")
    for further in found[1:]:
        found[0].extend(list(further))
        root.remove(further)
    return found[0] if found else None


def _check_compiler(compiler: ET.Element, where: str) -> None:
    for key, valid in _COMPILER.items():
        text = compiler.get(key, valid[0])
        if text not in valid:
            raise InputError(f"compiler {key} is not supported", where=where,
                             expected=" or ".join(valid), got=repr(text))  # fmt: skip
    sequence = compiler.get("eulerseq", "xyz")
    if len(sequence) != 3 or not set(sequence) <= set("xyzXYZ"):
        raise InputError("compiler eulerseq is not supported", where=where,
                         expected="three of x, y, z, X, Y, Z", got=repr(sequence))  # fmt: skip


@dataclass(frozen=True)
class _Angles:
    """How the file writes angles: its unit in radians, and the sequence of Euler's."""

    unit: float
    sequence: str

    def quaternion(self, kind: str, v: list[float]) -> Array:
        """Unit quaternion (w, x, y, z) of an orientation, as MuJoCo reads it."""
        if kind == "quat":
            return np.array(v) / np.linalg.norm(v)
        if kind == "axisangle":
            return _turn(np.array(v[:3]), v[3] * self.unit)
        if kind == "zaxis":
            axis = np.array([-v[1], v[0], 0.0])
            sine = float(np.linalg.norm(axis))
            upright = sine <= 1e-12 * float(np.linalg.norm(v))
            return _turn(np.eye(3)[0] if upright else axis, math.atan2(sine, v[2]))
        if kind == "xyaxes":
            x = np.array(v[:3]) / np.linalg.norm(v[:3])
            y = np.array(v[3:]) - x * (x @ v[3:])
            y /= np.linalg.norm(y)
            turn = se3.log(se3.pose(np.stack([x, y, np.cross(x, y)], axis=1)))[:3]
            return _turn(turn, float(np.linalg.norm(turn)))
        found = np.array([1.0, 0.0, 0.0, 0.0])
        for axis_name, angle in zip(self.sequence, v, strict=True):
            step = _turn(np.eye(3)["xyz".index(axis_name.lower())], angle * self.unit)
            # Small letters turn about the axes that were turned already, capitals about fixed ones.
            found = _product(found, step) if axis_name.islower() else _product(step, found)
        return found


def _turn(axis: Array, angle: float) -> Array:
    size = float(np.linalg.norm(axis)) or 1.0
    return np.concatenate([[math.cos(angle / 2)], math.sin(angle / 2) * axis / size])


def _product(a: Array, b: Array) -> Array:
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], vector])


def _check_numbers(element: ET.Element, angles: _Angles, where: str) -> None:
    """Refuse attributes that are not the right count of finite numbers, and lost directions.

    Orientations become unit quaternions: Pinocchio takes other axes than those of unit length,
    and capital Euler sequences, for something else.
    """
    name = element.get("name")
    what = f"{element.tag} {name!r}" if name else element.tag
    given: dict[str, list[float]] = {}
    for key, count in _SHOWN[element.tag].items():
        text = element.get(key)
        if text is None or count is None:
            continue
        values = _floats(text)
        if not values or (count and len(values) != count):
            count_text = f"{count} " if count else ""
            raise InputError(
                f"{what}: {key} is not {count_text}finite number(s)", where=where, got=repr(text)
            )
        given[key] = values
        element.set(key, " ".join(repr(v) for v in values))
    for key in ("axis", "quat", "zaxis"):
        if key in given and not any(abs(v) > 1e-9 for v in given[key]):
            raise InputError(f"{what} has a zero {key}", where=where)
    if "axisangle" in given and not any(abs(v) > 1e-9 for v in given["axisangle"][:3]):
        raise InputError(f"{what} has a zero axis", where=where)
    if "xyaxes" in given:
        (a, b, c), (d, e, f) = given["xyaxes"][:3], given["xyaxes"][3:]
        if not any(abs(v) > 1e-9 for v in (b * f - c * e, c * d - a * f, a * e - b * d)):
            raise InputError(f"{what}: xyaxes are parallel", where=where)
    if len(given.keys() & _ORIENTATIONS.keys()) > 1:
        raise InputError(f"{what} has several orientations", where=where, expected="one")
    for key in given.keys() & _ORIENTATIONS.keys():
        del element.attrib[key]
        values = angles.quaternion(key, given[key]).tolist()
        element.set("quat", " ".join(repr(v) for v in values))
    if "range" in given and given["range"][0] > given["range"][1]:
        raise InputError(f"{what}: range is the wrong way round", where=where,
                         expected="lower upper", got=element.get("range"))  # fmt: skip
    for key in ("mass", "density", "stiffness"):
        if given.get(key, [0.0])[0] < 0:
            raise InputError(f"{what}: {key} is negative", where=where, got=element.get(key))


def _floats(text: str) -> list[float]:
    """Finite numbers of moderate size, or nothing at all."""
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        return []
    usable = "_" not in text and all(abs(v) <= LARGEST_NUMBER for v in values)
    return values if usable else []


def _strip(root: ET.Element) -> None:
    """Remove everything that plays no part, and that Pinocchio could stumble over."""
    for element in list(root):
        if element.tag not in ("compiler", "default", "worldbody"):
            root.remove(element)
    keep = {"angle", "autolimits", "inertiafromgeom", "eulerseq"}
    for element in root.iter():
        if element.tag == "compiler":
            attributes: Any = keep
        elif element.tag == "default":
            attributes = {"class"}
        else:
            attributes = _SHOWN.get(element.tag, {})
        for key in [k for k in element.attrib if k not in attributes]:
            del element.attrib[key]
        nests = element.tag in ("mujoco", "default", "worldbody", "body")
        for child in list(element):
            massless = child.tag == "geom" and (
                element.tag == "worldbody" or child.get("type", "sphere") not in _MASSIVE
            )
            known = child.tag in _SHOWN or child.tag in ("compiler", "default", "worldbody")
            if not nests or not known or massless:
                element.remove(child)


class _Defaults:
    """Joint attributes by default class, inherited from the enclosing classes."""

    def __init__(self, root: ET.Element, angles: _Angles, where: str) -> None:
        self._angles, self._where = angles, where
        self._by_class: dict[str, dict[str, str]] = {"main": {}}
        for top in root.findall("default"):
            top.set("class", top.get("class", "main"))
            self._read(top, {}, 0)

    def _read(self, element: ET.Element, inherited: dict[str, str], depth: int) -> None:
        if depth > 100:
            raise InputError("default classes are nested too deeply", where=self._where)
        name = element.get("class")
        if not name:
            raise InputError("a default class has no name", where=self._where)
        own = dict(inherited)
        for child in element:
            if child.tag in _SHOWN:
                _check_numbers(child, self._angles, self._where)
        joint = element.find("joint")
        if joint is not None:
            own.update(joint.attrib)
        self._by_class[name] = own
        for child in element.findall("default"):
            self._read(child, own, depth + 1)

    def of(self, joint: ET.Element, childclass: str | None) -> dict[str, str]:
        name = joint.get("class") or childclass or "main"
        return {**self._by_class[self.checked(name)], **joint.attrib}

    def checked(self, name: str) -> str:
        if name not in self._by_class:
            raise UnknownNameError("default class", name, self._by_class, where=self._where)
        return name


def _walk(
    body: ET.Element,
    childclass: str | None,
    defaults: _Defaults,
    angles: _Angles,
    joints: dict[str, MjcfJoint],
    body_joints: dict[str, list[str]],
    where: str,
) -> list[str]:
    """Check all bodies and read their joints; returns springs that play no part, in words."""
    if body.find("joint") is not None or body.find("freejoint") is not None:
        raise InputError("joint in the worldbody", where=where, expected="joints in bodies only")
    taken = {str(j.get("name")) for j in body.iter("joint") if j.get("name")}
    bodies: set[str] = {ROOT, "world", "universe"}
    soft: list[str] = []
    stack = [(body, childclass, 0)]
    while stack:
        element, inherited, depth = stack.pop()
        if depth > 200:
            raise InputError("bodies are nested too deeply", where=where, expected="at most 200")
        own = element.get("childclass", inherited)
        if own is not None:
            defaults.checked(own)
        _check_body(element, defaults, angles, where)
        if element is not body:
            # Without a name Pinocchio gives all bodies the same one.
            name = element.get("name") or _unused("body", len(bodies) - 2, bodies)
            if name in bodies:
                raise InputError(f"two bodies have the name {name!r}", where=where)
            element.set("name", name)
            bodies.add(name)
            shapes = [g.get("type") for g in element.findall("geom")]
            if element.find("inertial") is None and "mesh" in shapes:
                soft.append(f"mass of the meshes of body {name!r}")
        several = len(element.findall("joint")) > 1
        for joint in element.findall("joint"):
            attributes = defaults.of(joint, own)
            kind = attributes.get("type", "hinge")
            name = joint.get("name") or _unused("joint", len(joints) + 1, taken)
            taken.add(name)
            joint.set("name", name)
            if name in joints:
                raise InputError(f"two joints have the name {name!r}", where=where)
            if kind not in ("hinge", "slide", "ball", "free"):
                raise InputError(f"joint {name!r} has an unknown type", where=where,
                                 expected="hinge, slide, ball, free", got=repr(kind))  # fmt: skip
            stiffness = float(attributes.get("stiffness", "0"))
            factor = angles.unit if kind == "hinge" else 1.0
            # As in MuJoCo the position is `ref` in the file's own posture; so is the spring's.
            rest = float(attributes.get("springref", "0")) * factor
            if several and float(attributes.get("ref", "0")) != 0.0:
                raise InputError(f"joint {name!r}: ref is not supported in a body with several "
                                 "joints", where=where, expected="no ref")  # fmt: skip
            if stiffness > 0 and kind in ("ball", "free"):
                soft.append(f"stiffness of the {kind} joint {name!r}")
            if "springdamper" in attributes:
                soft.append(f"springdamper of the joint {name!r}")
            joints[name] = MjcfJoint(name, kind, stiffness, rest)
            body_joints.setdefault(element.get("name", ""), []).append(name)
        stack.extend((child, own, depth + 1) for child in element.findall("body"))
    return soft


def _check_body(body: ET.Element, defaults: _Defaults, angles: _Angles, where: str) -> None:
    if body.tag == "body":
        _check_numbers(body, angles, where)
    for child in body:
        if child.tag in _BODIES_ELSEWHERE:
            raise InputError(f"MJCF element <{child.tag}> is not supported", where=where,
                             expected="plain bodies")  # fmt: skip
        if child.tag not in _SHOWN or child.tag == "body":
            continue
        _check_numbers(child, angles, where)
        if child.get("class"):
            defaults.checked(str(child.get("class")))
        if child.tag == "inertial" and child.get("mass") is None:
            name = body.get("name", "without a name")
            raise InputError(f"body {name}: inertial has no mass", where=where)
    free = body.find("freejoint")
    if free is not None and (body.find("joint") is not None or len(body.findall("freejoint")) > 1):
        raise InputError("a free joint stands beside other joints", where=where)


def _unused(stem: str, number: int, taken: set[str]) -> str:
    while f"{stem}{number}" in taken:
        number += 1
    return f"{stem}{number}"


def _closures(root: ET.Element, where: str) -> tuple[tuple[MjcfClosure, ...], tuple[str, ...]]:
    found: list[MjcfClosure] = []
    ignored: list[str] = []
    for equality in root.findall("equality"):
        for element in equality:
            if element.get("active", "true") == "false":
                continue
            if element.tag not in ("connect", "weld"):
                ignored.append(f"equality {element.tag}")
                continue
            a, b = element.get("body1"), element.get("body2", "world")
            if a is None:
                ignored.append(f"equality {element.tag} between sites")
                continue
            known = ["world", *(str(e.get("name")) for e in root.iter("body") if e.get("name"))]
            for name in (a, b):
                if name not in known:
                    raise UnknownNameError(
                        "body", name, known, where=f"{where}: equality {element.tag}"
                    )
            anchor = _tuple(element, "anchor", 3, where) or (0.0, 0.0, 0.0)
            pose = _tuple(element, "relpose", 7, where)
            found.append(MjcfClosure("point" if element.tag == "connect" else "weld", a, b,
                                     anchor, pose))  # fmt: skip
    ignored += [tag for tag in ("tendon", "contact", "keyframe") if root.find(tag) is not None]
    return tuple(found), tuple(ignored)


def _tuple(element: Any, key: str, count: int, where: str) -> tuple[float, ...] | None:
    text = element.get(key)
    if text is None:
        return None
    try:
        values = tuple(float(v) for v in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not all(math.isfinite(v) for v in values):
        raise InputError(
            f"equality {element.tag}: {key} is not {count} finite numbers", where=where, got=text
        )
    return values
