"""SDF as URDF: the file's elements are read by rod, its frames are resolved here.

Every joint of an SDF file may stand anywhere in its child link. In the URDF that is made of it a
joint moves a link of its own name at its frame, where that is not the child link's, and the child
link is fixed to it. So every link, joint and frame of the file stands where the file has it.

A ball joint becomes three that turn about x, y and z, one with two axes becomes two. A joint whose
child another joint carries already carries a link of its own, which is tied to that child: a loop.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cartstiff.errors import InputError, imported, one_line
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.mjcf.facts import MjcfClosure, MjcfFacts, MjcfSpring

_TYPES = ("revolute", "continuous", "prismatic", "fixed", "ball", "universal", "revolute2")
_TWO_AXES = ("universal", "revolute2")
# What rod leaves out without a word, or what says where things are in ways of old versions.
_REFUSED = {
    "include": "an <include>",
    "model/model": "a model within the model",
    "joint/axis/mimic": "a joint that mimics another",
    "link/pose[@frame]": "<pose frame=...>",
}
# What SDF takes where a file says nothing, and rod asks for.
_DYNAMICS = ("spring_stiffness", "spring_reference")
_OLDEST = (1, 5)
#: SDF's own number for no limit.
_NO_LIMIT = 1e16


def read_sdf(root: ET.Element, where: str) -> tuple[str, MjcfFacts]:
    """URDF of the one model of an SDF file, and the springs of its joints.

    Parameters
    ----------
    root : xml.etree.ElementTree.Element
        The file's.
    where : str
        What messages call it.

    Returns
    -------
    str
        The same robot as URDF; its base is the world's frame.
    MjcfFacts
        Springs with their references, and the world's gravity.

    Raises
    ------
    InputError
        For what cannot be expressed, in one line.
    MissingDependencyError
        Without rod.
    """
    rod = imported("rod", "rod", "an SDF file", "sdf")
    version = tuple(int(x) for x in root.get("version", "0").split(".") if x.isdecimal())
    if version < _OLDEST:
        raise InputError(
            "this version of SDF is not supported",
            where=where,
            expected="1.5 or newer",
            got=root.get("version", "none"),
        )
    models = [*root.findall("model"), *root.findall("world/model")]
    if len(models) != 1:
        raise InputError(
            "an SDF file holds one robot",
            where=where,
            expected="one <model>",
            got=f"{len(models)} models",
        )
    for what, words in _REFUSED.items():
        if models[0].find(what.removeprefix("model/")) is not None or (
            what == "include" and root.find("world/include") is not None
        ):
            raise InputError(
                f"{words} in SDF is not supported",
                where=where,
                expected="links, joints and frames of one model",
            )
    axes: dict[str, list[Any]] = {}
    for joint in models[0].iterfind("joint"):
        tags = [part for tag in ("axis", "axis2") if (part := joint.find(tag)) is not None]
        for axis in tags:
            _complete(axis)
        name = joint.get("name", "")
        axes[name] = [_element(rod, "Axis", axis, where, name) for axis in tags]
    parts = {
        tag: [_element(rod, kind, part, where) for part in models[0].findall(tag)]
        for tag, kind in (("link", "Link"), ("joint", "Joint"), ("frame", "Frame"))
    }
    pose = models[0].find("pose")
    stands = None if pose is None else _element(rod, "Pose", pose, where)
    model = _Model(models[0].get("name", "robot"), stands, parts, axes, where)
    return model.as_urdf(), _facts(model, root, where)


def _complete(axis: ET.Element) -> None:
    """Write out what SDF means by what an axis leaves out, or says in the words of old versions."""
    for dynamics in axis.iterfind("dynamics"):
        for tag in _DYNAMICS:
            if dynamics.find(tag) is None:
                ET.SubElement(dynamics, tag).text = "0"
    xyz = axis.find("xyz")
    if axis.findtext("use_parent_model_frame", "0").strip() in ("1", "true") and xyz is not None:
        xyz.set("expressed_in", "__model__")


def _element(rod: Any, kind: str, part: ET.Element, where: str, of: str = "") -> Any:
    """An element as rod reads it. By itself: in a list rod drops what it cannot read."""
    import xmltodict

    try:
        name = {"Pose": "<pose>", "Axis": f"<joint name={of!r}>"}.get(kind)
        name = name or f"<{part.tag} name={part.attrib['name']!r}>"
        kinds = rod.sdf.joint if kind == "Axis" else rod
        return getattr(kinds, kind).from_dict(xmltodict.parse(ET.tostring(part))[part.tag])
    except Exception as error:  # in the words of rod's own reader
        if isinstance(error, KeyError):
            name, error = f"<{part.tag}>", ValueError("it has no name")
        while isinstance(error.__context__, ValueError | LookupError) and not isinstance(
            error.__context__, KeyError
        ):
            error = error.__context__  # what is wrong stands innermost
        words = one_line(f"{type(error).__name__}: {error}")
        raise InputError(f"{name} is not usable SDF", where=where, got=words) from None


def _facts(model: _Model, root: ET.Element, where: str) -> MjcfFacts:
    springs = {}
    for name, axis in model.moving.items():
        dynamics = None if axis is None else axis.dynamics
        if dynamics is not None and float(dynamics.spring_stiffness or 0.0):
            reference = float(dynamics.spring_reference or 0.0)
            springs[name] = MjcfSpring((float(dynamics.spring_stiffness),), reference)
    # Balls and joints that close a loop have no motor; in a loop with springs nothing else has.
    sprung = [tie.joints for tie in model.closures if tie.joints & springs.keys()]
    free = {name for joint in model.closing for name in joint}.union(*sprung)
    free |= {name for name, axis in model.moving.items() if axis is None}
    passive = tuple(name for name in model.moving if name in free - springs.keys())
    gravity = root.findtext("world/gravity")
    acts = None if gravity is None else np.array(_floats(gravity, 3, where, "world/gravity"))
    return MjcfFacts(springs=springs, gravity=acts, passive=passive, closures=tuple(model.closures))


def _floats(text: str, count: int, where: str, what: str) -> list[float]:
    try:
        numbers = [float(x) for x in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(
            f"{what} is not usable", where=where, expected=f"{count} numbers", got=one_line(text)
        )
    return numbers


class _Model:
    """The elements of a model by their names, and where each stands in the model.

    `as_urdf` finds its coordinates with their axes (None: of a ball), those of joints that close a
    loop, and what these tie.
    """

    def __init__(
        self,
        name: str,
        pose: Any,
        parts: Mapping[str, Sequence[Any]],
        axes: Mapping[str, Sequence[Any]],
        where: str,
    ) -> None:
        self.name, self.where, self.axes = name, where, axes
        self.moving: dict[str, Any] = {}
        self.closing: list[tuple[str, ...]] = []
        self.closures: list[MjcfClosure] = []
        named = [part.name for of_kind in parts.values() for part in of_kind]
        if again := [name for name in named if named.count(name) > 1]:
            raise InputError("two elements have one name", where=where, got=again[0])
        self.links, self.joints, self.frames = (
            {part.name: part for part in parts[tag]} for tag in ("link", "joint", "frame")
        )
        self.T_world_model = _matrix(pose)

    def _unknown(self, name: str) -> InputError:
        return InputError("names what is not in the model, or itself", where=self.where, got=name)

    def link_of(self, name: str, seen: tuple[str, ...] = ()) -> str:
        """The link that an element is fixed to; "world" for what is not."""
        if name in self.links or name == "world":
            return name
        if name in seen:
            raise self._unknown(name)
        if name in self.joints:
            return self.link_of(self.joints[name].child, (*seen, name))
        if name in self.frames:
            attached = self.frames[name].attached_to
            return self.link_of(attached, (*seen, name)) if attached else "world"
        raise self._unknown(name)

    def pose(self, name: str | None, seen: tuple[str, ...] = ()) -> Array:
        """Pose of an element in the world."""
        if not name or name == "__model__":
            return self.T_world_model
        if name == "world":
            return np.eye(4)
        if name in seen:
            raise self._unknown(name)
        if name in self.links:
            element, base = self.links[name], None
        elif name in self.joints:
            element, base = self.joints[name], self.joints[name].child
        elif name in self.frames:
            element, base = self.frames[name], self.frames[name].attached_to
        else:
            raise self._unknown(name)
        frame = None if element.pose is None else element.pose.relative_to
        return self.pose(frame or base, (*seen, name)) @ _matrix(element.pose)

    def as_urdf(self) -> str:
        """The model as URDF."""
        robot = ET.Element("robot", name=self.name)
        ET.SubElement(robot, "link", name="world")
        for name, link in self.links.items():
            self._add_link(robot, name, link)
        carried: dict[str, tuple[str, list[str]]] = {}
        loops = []
        for name, joint in self.joints.items():
            child, parent = self.link_of(joint.child), self.link_of(joint.parent)
            if child == "world":
                raise InputError(
                    "the world is no child of a joint",
                    where=self.where,
                    expected="the world as <parent>",
                    got=name,
                )
            end = child
            if child in carried:
                end = f"{child} of {name}"
                ET.SubElement(robot, "link", name=end)
            moves = self._add_joint(robot, name, joint, child, end)
            if child in carried:
                loops.append((parent, child, end, moves))
            else:
                carried[child] = parent, moves

        def way(link: str) -> set[str]:
            seen, moving = set[str](), set[str]()
            while link in carried and link not in seen:
                seen.add(link)
                link, moves = carried[link]
                moving.update(moves)
            return moving

        for parent, child, end, moves in loops:
            joints = frozenset((way(parent) ^ way(child)) | set(moves))
            self.closing.append(tuple(moves))
            self.closures.append(MjcfClosure("weld", child, end, np.eye(4), np.eye(4), joints))
        for name in self.links.keys() - carried.keys():
            _fixed(robot, f"world to {name}", "world", name, self.pose(name))
        for name in self.frames:
            ET.SubElement(robot, "link", name=name)
            on = self.link_of(name)
            T = se3.inverse(self.pose(on)) @ self.pose(name)
            _fixed(robot, f"{on} to {name}", on, name, T)
        return ET.tostring(robot, encoding="unicode")

    def _add_joint(
        self, robot: ET.Element, name: str, joint: Any, child: str, end: str
    ) -> list[str]:
        """Add a joint that carries `end`, where the child stands; the names of its coordinates."""
        if joint.type not in _TYPES:
            raise InputError(
                f"joint {name!r} has a type that is not supported",
                where=self.where,
                expected=", ".join(_TYPES),
                got=joint.type,
            )
        parent, T = self.link_of(joint.parent), self.pose(name)
        T_j_c, carrier = se3.inverse(T) @ self.pose(child), end
        if not np.array_equal(np.round(T_j_c, 12), np.eye(4)):
            carrier = name
            ET.SubElement(robot, "link", name=name)
            _fixed(robot, f"{name} to {end}", name, end, T_j_c)
        start = se3.inverse(self.pose(parent)) @ T
        if joint.type == "fixed":
            _fixed(robot, name, parent, carrier, start)
            return []
        axes = self.axes[name]
        wanted = {"ball": 0, **dict.fromkeys(_TWO_AXES, 2)}.get(joint.type, 1)
        if len(axes) != wanted:
            raise InputError(
                f"joint {name!r} has {len(axes)} axes",
                where=self.where,
                expected=f"{wanted} for {joint.type}",
            )
        steps = [(f".{x}", "revolute", e, None) for x, e in zip("xyz", np.eye(3), strict=True)]
        if axes:
            kind = "revolute" if wanted == 2 else joint.type
            suffixes = (".1", ".2") if wanted == 2 else ("",)
            steps = [
                (suffix, kind, self._along(axis, T), axis)
                for suffix, axis in zip(suffixes, axes, strict=True)
            ]
        for i, (suffix, kind, along, axis) in enumerate(steps, start=1):
            on = carrier if i == len(steps) else f"{name}{suffix} link"
            if on != carrier:
                ET.SubElement(robot, "link", name=on)
            self._move(_fixed(robot, name + suffix, parent, on, start), kind, along, axis)
            self.moving[name + suffix] = axis
            parent, start = on, np.eye(4)
        return [name + suffix for suffix, *_ in steps]

    def _along(self, axis: Any, T: Array) -> Array:
        """Direction of an axis in the frame of its joint."""
        frame = axis.xyz.expressed_in
        R = np.eye(3) if not frame else (se3.inverse(T) @ self.pose(frame))[:3, :3]
        return np.asarray(R @ np.array(axis.xyz.xyz, float))

    def _move(self, made: ET.Element, kind: str, along: Array, axis: Any) -> None:
        """Let a joint of the URDF move about or along an axis, within its limits."""
        ET.SubElement(made, "axis", xyz=_numbers(along))
        bounds = {
            key: repr(float(value))
            for key in ("lower", "upper")
            if axis is not None
            and axis.limit is not None
            and (value := getattr(axis.limit, key)) is not None
            and abs(float(value)) < _NO_LIMIT
        }
        turns_on = kind == "continuous" or (kind == "revolute" and not bounds)
        made.set("type", "continuous" if turns_on else kind)
        if bounds and not turns_on:
            rest = {"lower": "-1e9", "upper": "1e9", "effort": "0", "velocity": "0"}
            ET.SubElement(made, "limit", rest | bounds)
        if axis is not None and axis.dynamics is not None and axis.dynamics.damping is not None:
            ET.SubElement(made, "dynamics", damping=repr(float(axis.dynamics.damping)))

    def _add_link(self, robot: ET.Element, name: str, link: Any) -> None:
        made = ET.SubElement(robot, "link", name=name)
        if link.inertial is not None:
            body = ET.SubElement(made, "inertial")
            _origin(body, self._local(name, link.inertial.pose))
            ET.SubElement(body, "mass", value=repr(float(link.inertial.mass)))
            about = np.array(link.inertial.inertia.matrix(), float)
            keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            values = map(repr, about[np.triu_indices(3)].tolist())
            ET.SubElement(body, "inertia", dict(zip(keys, values, strict=True)))
        for visual in _listed(link.visual):
            shape = _shape(visual.geometry)
            if shape is not None:
                shown = ET.SubElement(made, "visual")
                _origin(shown, self._local(name, visual.pose))
                ET.SubElement(shown, "geometry").append(shape)

    def _local(self, link: str, pose: Any) -> Array:
        """Pose in a link of something that belongs to it."""
        if pose is None or not pose.relative_to:
            return _matrix(pose)
        return se3.inverse(self.pose(link)) @ self.pose(pose.relative_to) @ _matrix(pose)


def _listed(value: Any) -> Iterable[Any]:
    if value is None:
        return []
    return value if isinstance(value, list) else [value]


def _shape(geometry: Any) -> ET.Element | None:
    """A shape as URDF has it; None for those that it has not."""
    if geometry.box is not None:
        return ET.Element("box", size=_numbers(geometry.box.size))
    if geometry.cylinder is not None:
        body = geometry.cylinder
        return ET.Element("cylinder", radius=repr(body.radius), length=repr(body.length))
    if geometry.sphere is not None:
        return ET.Element("sphere", radius=repr(geometry.sphere.radius))
    if geometry.mesh is not None:
        file = str(geometry.mesh.uri).replace("model://", "package://")
        scale = geometry.mesh.scale or (1.0, 1.0, 1.0)
        return ET.Element("mesh", filename=file, scale=_numbers(scale))
    return None


def _matrix(pose: Any) -> Array:
    """Pose of six numbers: x y z, then turns about fixed axes, in degrees if so said."""
    if pose is None or pose.pose is None:
        return np.eye(4)
    if pose.rotation_format not in (None, "euler_rpy"):
        raise InputError(
            "a pose's rotation is not supported", expected="euler_rpy", got=pose.rotation_format
        )
    numbers = np.array(pose.pose, float)
    if not np.isfinite(numbers).all():
        raise InputError("a pose is not finite", expected="6 finite numbers", got=pose.pose)
    if str(pose.degrees).lower() in ("true", "1"):
        numbers[3:] = np.deg2rad(numbers[3:])
    return se3.from_roll_pitch_yaw(numbers[:3], numbers[3:])


def _numbers(values: Any) -> str:
    return " ".join(repr(float(x)) for x in values)


def _origin(element: ET.Element, T: Array) -> None:
    xyz, rpy = T[:3, 3], se3.roll_pitch_yaw(T)
    ET.SubElement(element, "origin", xyz=_numbers(xyz), rpy=_numbers(rpy))


def _fixed(robot: ET.Element, name: str, parent: str, child: str, T: Array) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    _origin(joint, T)
    return joint
