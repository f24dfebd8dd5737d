"""Check a URDF before Pinocchio reads it, and read the parts that Pinocchio drops.

Everything that affects statics is read or refused. A fault of a single joint, and an
element that closes a loop, holds or springs joints and cannot be read, refuse the robot
only where such a joint moves the frame of interest. Elements and attributes that neither
URDF nor its known extensions define are named in a note, and refused where they look like
a typing error.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from graphlib import CycleError, TopologicalSorter
from typing import Literal

import numpy as np
import pinocchio as pin

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.geometry import se3
from cartstiff.core.notes import Note
from cartstiff.files.description import (
    FileClosure,
    FileSpring,
    Followers,
    Obstacle,
    RobotDescription,
    on_leaders,
    to_root,
    turned_axes,
)
from cartstiff.files.plausible import is_inertia, large_angles, large_lengths

_MAX_JOINTS = 2000
#: Pinocchio's workspace takes a second to set up for 200 joints in a row, an hour for
#: 2000.
MOST_MOVING = 200
_AXIAL_TYPES = {"revolute", "continuous", "prismatic"}
_LIMITED_TYPES = ("revolute", "prismatic")
_JOINT_TYPES = {*_AXIAL_TYPES, "fixed", "floating", "planar"}
_VERSIONS = ("1.0", "1.1", "1.2")


# By tag: the child elements that are passed on to Pinocchio (of others it might refuse
# some that have no effect here), the known ones without effect on statics, and the
# attributes with the count of their numbers, some of which are not in URDF but in many
# files.
_USED_CHILDREN = {
    "robot": "link joint",
    "link": "inertial",
    "inertial": "origin mass inertia",
    "joint": "parent child origin axis limit mimic dynamics",
}
_IGNORED_CHILDREN = {
    "robot": "material gazebo transmission ros2_control sensor group",
    "link": "visual collision material gazebo sensor contact surface gravity kinematic "
    "self_filter "
    "self_collision_checking collision_checking",
    "joint": "calibration safety_controller gazebo",
}
_ATTRIBUTES = {
    "robot": "name version",
    "link": "name type",
    "joint": "name type dont_collapse",
    "origin": "xyz=3 rpy=3 quat_xyzw=4",
    "axis": "xyz=3",
    "parent": "link",
    "child": "link",
    "mass": "value=1",
    "inertia": "ixx ixy ixz iyy iyz izz",
    "mimic": "joint multiplier=1 offset=1",
    "dynamics": "damping=1 friction spring_stiffness spring_reference",
    "limit": "lower=1 upper=1 effort=1 velocity=1 acceleration deceleration jerk current "
    "gear_velocity command_effort",
}

# Parts of a joint whose faults concern the joint alone, as long as it does not move the
# frame.
_JOINT_PARTS = ("limit", "mimic", "dynamics")

# Elements that may have these attributes only, and no content.
_STRICT_TAGS = ("origin", "axis", "parent", "child", "mass", "mimic")

# An attribute that was written outside of a tag.
_ASSIGNMENT = re.compile(r"\w\s*=\s*[\"']")

# Similarity (difflib's ratio) from which on an unknown name is taken for a typing error:
# one letter too many, too few or exchanged in a name of four has 0.75 or more.
_TYPO_SIMILARITY = 0.7

# Simulators' names of the stiffness of a joint and its rest position.
_STIFFNESS = re.compile(r"spring_?stiffness", re.IGNORECASE)
_REFERENCE = re.compile(r"spring_?reference", re.IGNORECASE)
# Tags, without their namespace, of elements that change the mechanics, by the key of a
# mechanism file that replaces them.
_MECHANICAL = {
    "closures": re.compile(r"constraint|closure|loop|connect|equality|weld|coupling"),
    "lines": re.compile(r"force_?element|cable|tendon|muscle|linear_?spring"),
    "springs": re.compile(r"spring|stiffness|bushing|elastic|complian"),
}


#: SDF joint types that are closures: the kind of closure, and the elements of its axes.
_SDF_CLOSURES: dict[
    str, tuple[Literal["weld", "hinge", "universal"], tuple[str, ...]]
] = {
    "fixed": ("weld", ()),
    "revolute": ("hinge", ("axis",)),
    "continuous": ("hinge", ("axis",)),
    "universal": ("universal", ("axis", "axis2")),
}
#: Elements of such joints that put the axes into another frame, or a spring on them.
_SDF_WITHOUT_MEANING = ("use_parent_model_frame", "spring_stiffness")


class _Robot:
    """The links and joints of a URDF while it is checked.

    Attributes
    ----------
    links, joints : dict of str to Element
        By name.
    carrier : dict of str to (str, str)
        Joint and parent link of each link that has them.
    springs, efforts, mimics, planar_axes, closures, obstacles, notes
        As in `RobotDescription`.
    actuated : set of str
        Joints that an actuator drives.
    """

    def __init__(self, root: ET.Element, where: str) -> None:
        self.where = where
        self.links, self.joints = (_named(root, tag) for tag in ("link", "joint"))
        self.carrier: dict[str, tuple[str, str]] = {}
        self.springs: dict[str, FileSpring] = {}
        self.mimics: Followers = {}
        self.planar_axes: dict[str, Array] = {}
        self.closures: list[FileClosure] = []
        self.actuated: set[str] = set()
        self.efforts: dict[str, tuple[float, float]] = {}
        self.obstacles: list[Obstacle] = []
        self.notes: list[Note] = []

    def joints_to(self, link: str) -> set[str]:
        """Joints between the root and a link."""
        joints: set[str] = set()
        while link in self.carrier:
            joint, link = self.carrier[link]
            joints.add(joint)
        return joints

    def between(self, links: Iterable[str]) -> frozenset[str]:
        """Joints between links; all joints where fewer than two of them are known."""
        paths = [
            self.joints_to(link)
            for link in links
            if link in self.links or link == "world"
        ]
        if len(paths) < 2:
            return frozenset(self.joints)
        return frozenset(set[str].union(*paths) - set[str].intersection(*paths))

    def at_zero(self, link: str) -> Array:
        """Pose of a link in the root with all joints at zero."""
        T = np.eye(4)
        while link in self.carrier:
            joint, link = self.carrier[link]
            T = _placed(self.joints[joint].find("origin")) @ T
        return T

    def leave_out(self, joint: str, error: InputError) -> None:
        """Record the fault of a joint."""
        at = error.at(self.where)
        self.obstacles.append(Obstacle(error.what, frozenset({joint}), error=at))

    def attempt(self, joint: str, read: Callable[..., None], *arguments: object) -> None:
        """Read a part of a joint; a refusal becomes the joint's own fault."""
        try:
            read(joint, *arguments)
        except InputError as error:
            self.leave_out(joint, error)

    def read_joint(self, name: str, reader: _Reader) -> None:
        """Read a joint; replace its parts by those that Pinocchio needs."""
        joint, what = self.joints[name], f"joint {name!r}"
        self._attach(name)
        axis = joint.find("axis")
        try:
            kind = self._type_of(name, axis)
        except InputError as error:
            self.leave_out(name, error)
            kind = "continuous"
            joint.set("type", kind)
            if axis is not None:
                joint.remove(axis)
        if kind == "planar":
            self._read_plane(name, axis)
        limit, mimic, dynamics = parts = [joint.find(tag) for tag in _JOINT_PARTS]
        for part in parts:
            if part is not None:
                joint.remove(part)
        if kind in _LIMITED_TYPES:
            made = ET.SubElement(
                joint, "limit", effort="0", velocity="0", lower="-1e9", upper="1e9"
            )
            self.attempt(name, self._read_limit, made, limit)
        self.attempt(name, self._read_effort, limit)
        self.attempt(name, self._read_mimic, mimic)
        texts = [*reader.extensions.get(name, ()), *reader.dynamics.get(name, ())]
        self.attempt(name, self._read_dynamics, dynamics, texts)
        for tag in reader.mechanical.get(name, ()):
            expected = f"in a mechanism file: springs: {{{name}: {{stiffness: ...}}}}"
            self.leave_out(
                name, InputError(f"{what}: <{tag}> cannot be read", expected=expected)
            )

    def _attach(self, name: str) -> None:
        """Attach a joint's child to its parent."""
        ends = []
        for end in ("parent", "child"):
            element = self.joints[name].find(end)
            link = None if element is None else element.get("link")
            if not link:
                raise InputError(f"joint {name!r} has no {end} link")
            if link not in self.links:
                what = f"joint {name!r} names a {end} link that does not exist"
                raise InputError(what, got=repr(link))
            ends.append(link)
        parent, child = ends
        if child in self.carrier:
            raise InputError(
                f"link {child!r} has two parent joints",
                expected="a tree: leave one of both out, give its side a link of its own "
                "at that "
                "place, and join it to the other under 'closures' in a mechanism file of "
                "kind "
                "closed-chain",
                got=f"the second is {name!r}",
            )
        if parent == child:
            raise InputError(f"joint {name!r} joins link {child!r} to itself")
        self.carrier[child] = name, parent

    def _type_of(self, name: str, axis: ET.Element | None) -> str:
        """Type of a joint; its axis must have a direction."""
        kind, what = self.joints[name].get("type"), f"joint {name!r}"
        if kind not in _JOINT_TYPES:
            expected = ", ".join(sorted(_JOINT_TYPES))
            raise InputError(
                f"{what} has an unknown type", expected=expected, got=kind or "none"
            )
        if axis is not None and kind in (*_AXIAL_TYPES, "planar"):
            if axis.get("xyz") is None:
                raise InputError(f"{what}: axis has no xyz", expected="<axis xyz=...>")
            if math.hypot(*_floats(axis, "xyz", "")) < numerics.NEGLIGIBLE_DIFFERENCE:
                raise InputError(f"{what} has a zero axis")
        return str(kind)

    def _read_plane(self, name: str, element: ET.Element | None) -> None:
        """Read the normal of a planar joint's plane,
        where it is not z as for Pinocchio.
        """
        if element is None:
            words = (
                f"planar joint {name!r} has no axis: it moves across its frame's z axis"
            )
            self.notes.append(Note("planar-axis", words, {"joint": name}))
            return
        axis = _floats(element, "xyz", "")
        if axis[0] or axis[1] or axis[2] < 0:
            self.planar_axes[name] = np.array(axis) / math.hypot(*axis)

    def _read_limit(
        self, name: str, made: ET.Element, element: ET.Element | None
    ) -> None:
        """Write limits as Pinocchio needs them; without bounds there are none."""
        if element is not None and {"lower", "upper"} & set(element.attrib):
            ((lower,), (upper,)) = (
                _floats(element, key, "0") for key in ("lower", "upper")
            )
            if lower > upper:
                raise InputError(
                    f"joint {name!r}: limits are the wrong way round",
                    expected="lower <= upper",
                    got=f"{lower:g}, {upper:g}",
                )
            made.attrib |= {"lower": repr(lower), "upper": repr(upper)}

    def _read_effort(self, name: str, element: ET.Element | None) -> None:
        """Read the largest torque of a drive; zero says that it is not known."""
        for effort in _floats(element, "effort", ""):
            if effort > 0.0:
                self.efforts[name] = -effort, effort

    def _read_dynamics(
        self, name: str, element: ET.Element | None, texts: list[dict[str, str]]
    ) -> None:
        """Read damping, and the spring that simulators read beside it."""
        for values in texts:
            self._read_spring(name, values)
        joint = self.joints[name]
        if joint.get("type") in _AXIAL_TYPES:
            for damping in _floats(element, "damping", ""):
                if damping < 0.0:
                    words = f"joint {name!r}: damping is negative"
                    raise InputError(words, expected="zero or more", got=f"{damping:g}")
                ET.SubElement(joint, "dynamics", damping=repr(damping))

    def _read_spring(self, name: str, values: Mapping[str, str]) -> None:
        """Read the spring of a joint from a simulator's extension, where it has one."""
        what, found = f"joint {name!r}", {}
        for key, text in values.items():
            for pattern in (_STIFFNESS, _REFERENCE):
                if pattern.fullmatch(key):
                    (found[pattern],) = numbers_in(text, 1, f"{what}: {key}")
            if key.lower() == "stiffness":
                entry = f"{{{name}: {{stiffness: {text.strip()}}}}}"
                raise InputError(
                    f"{what}: 'stiffness' is no word of URDF",
                    expected=f"in a mechanism file: springs: {entry}",
                )
        if not (k := found.get(_STIFFNESS, 0.0)):
            return
        if k < 0.0:
            raise InputError(
                f"{what}: stiffness is negative", expected="zero or more", got=f"{k:g}"
            )
        if (kind := self.joints[name].get("type")) not in _AXIAL_TYPES:
            raise InputError(
                f"{what} has a spring and several coordinates",
                expected="a revolute, continuous or prismatic joint",
                got=kind,
            )
        spring = FileSpring((k,), found.get(_REFERENCE, 0.0))
        if self.springs.setdefault(name, spring) != spring:
            raise InputError(f"{what} has two springs", expected="one")

    def _read_mimic(self, name: str, mimic: ET.Element | None) -> None:
        """Read which joint a joint follows."""
        if mimic is None:
            return
        what, joints = f"joint {name!r}", self.joints
        # A leader that does not exist matters only where the follower is used.
        leader = mimic.get("joint")
        if not leader:
            raise InputError(
                f"{what}: mimic names no joint", expected="<mimic joint=...>"
            )
        for other in (name, leader):
            kind = joints[other].get("type") if other in joints else None
            if kind in ("floating", "planar"):
                raise InputError(
                    f"{what} cannot mimic",
                    expected="two joints with one coordinate",
                    got=f"joint {other!r} of type {kind}",
                )
        if joints[name].get("type") != "fixed":
            (factor,), (offset,) = (
                _floats(mimic, "multiplier", "1"),
                _floats(mimic, "offset", "0"),
            )
            self.mimics[name] = leader, factor, offset

    def read_joints(self, reader: _Reader) -> None:
        """Read all joints, and check that they make a tree."""
        for name in self.joints:
            self.read_joint(name, reader)
        for name, fault in reader.faults:
            self.leave_out(name, fault)
        self.check_places()
        self.check_tree()
        self.leave_out_rings()

    def check_masses(self) -> None:
        """Check the masses of the links, with notes on impossible ones."""
        for name, element in self.links.items():
            if not _check_inertial(element, f"link {name!r}"):
                words = f"link {name!r}: no body has this inertia; none counts, which "
                words += "vibrations feel"
                self.notes.append(Note("impossible-inertia", words, {"link": name}))

    def leave_out_rings(self) -> None:
        """Leave out joints that follow each other, which no joint leads."""
        rings: dict[str, list[str]] = {}
        for name in self.mimics:
            followed = [name]
            while (leader := self.mimics[followed[-1]][0]) in self.mimics:
                followed.append(leader)
                if leader in followed[:-1]:
                    rings[name] = followed
                    break
        for name, ring in rings.items():
            error = InputError("mimic joints follow each other", got=" -> ".join(ring))
            self.leave_out(name, error)
            del self.mimics[name]

    def hold_followers(self) -> dict[str, float]:
        """Positions of the joints that follow a fixed one,
        which are no followers any more.
        """
        held = {}
        for name in self.mimics:
            leader, _, offset = to_root(name, self.mimics)
            if leader in self.joints and self.joints[leader].get("type") == "fixed":
                held[name] = offset
        for name in held:
            del self.mimics[name]
        return held

    def read_extensions(self, elements: Sequence[ET.Element]) -> None:
        """Read the elements beside links and joints: loops, actuators, springs."""
        named = [*filter(lambda element: element.tag == "frame", elements)]
        frames = {str(e.get("name")): str(e.get("link")) for e in named}
        for element in elements:
            tag, joint = _local(element.tag), element.get("reference")
            if tag == "joint":
                raise InputError(
                    f"joint {element.get('name')!r} is of another dialect than URDF",
                    expected=f"<joint> of type {', '.join(sorted(_JOINT_TYPES))}",
                    got=f"<{element.tag}>",
                )
            if tag in ("transmission", "ros2_control"):
                self._read_actuators(element)
            elif tag == "gazebo" and joint in self.joints:
                self.attempt(joint, self._read_spring, _texts(element))
            elif tag == "gazebo":
                self._read_gazebo(element)
            elif tag == "ball_constraint":
                self._read_ball(element)
            elif (key := _mechanical(tag)) is not None:
                self._leave_out_element(element, key, frames)

    def _read_actuators(self, element: ET.Element) -> None:
        """Read which joints are driven."""
        driven = {str(joint.get("name")) for joint in element.iter("joint")}
        self.actuated |= driven & self.joints.keys()

    def _read_gazebo(self, element: ET.Element) -> None:
        """Read closures, and plugins that couple joints."""
        for joint in element.findall("joint"):
            self._read_sdf_joint(joint)
        for plugin in element.iter("plugin"):
            self._leave_out_follower(plugin)

    def _leave_out_follower(self, plugin: ET.Element) -> None:
        """Leave out a joint that follows another by a plugin."""
        follower = (plugin.findtext("mimicJoint") or "").strip()
        if follower in self.joints and follower not in self.mimics:
            leader = (plugin.findtext("joint") or "").strip()
            what = (
                f"plugin {plugin.get('name')!r} makes joint {follower!r} follow another"
            )
            expected = f"<mimic joint={leader!r}/> in joint {follower!r}"
            self.leave_out(follower, InputError(what, expected=expected))

    def _read_ball(self, element: ET.Element) -> None:
        """Read Drake's ball constraint."""
        parts = {child.tag.rpartition("_constraint_")[2]: child for child in element}
        bodies = [parts[k].get("name", "") for k in ("body_A", "body_B") if k in parts]
        if len(bodies) != 2 or not {"world", *self.links} >= set(bodies):
            self._leave_out_element(element, "closures", {})
            return
        points = []
        for key in ("p_AP", "p_BQ"):
            text = parts[key].get("value", "") if key in parts else "0 0 0"
            points.append(numbers_in(text, 3, f"ball constraint: {key} value"))
        self._close("point", bodies, *map(_shift, points))

    def _close(
        self,
        kind: Literal["point", "weld", "hinge", "universal"],
        links: Sequence[str],
        T_a: Array,
        T_b: Array,
    ) -> None:
        a, b = links
        self.closures.append(FileClosure(kind, a, b, T_a, T_b, self.between(links)))

    def _read_sdf_joint(self, joint: ET.Element) -> None:
        """Read a joint of SDF between two links as a closure;
        a slide has to be written as one.

        A joint that fixes the root to the room adds nothing.
        """
        links = [
            (joint.findtext(end) or "").strip().rpartition("::")[2]
            for end in ("parent", "child")
        ]
        kind = joint.get("type", "")
        if links[0] == "world" and kind == "fixed" and links[1] not in self.carrier:
            return
        if not {"world", *self.links} >= set(links) or _has_more(joint):
            self._leave_out_element(joint, "closures", {})
            return
        # The joint is at a pose in its child, which is seen from the parent as well.
        text = joint.findtext("pose", "0 0 0 0 0 0")
        numbers = numbers_in(text, 6, "gazebo joint: pose")
        T_a_b = se3.inverse(self.at_zero(links[0])) @ self.at_zero(links[1])
        points = [(T_a_b @ [*numbers[:3], 1.0])[:3].round(9).tolist(), numbers[:3]]
        if kind == "ball":
            self._close("point", links, *map(_shift, points))
            return
        closure, names = _SDF_CLOSURES.get(kind, ("weld", ("none",)))
        texts = [joint.findtext(f"{name}/xyz") for name in names]
        if None in texts:
            what = f"<joint type={kind!r}> in <gazebo>"
            self._leave_out_closure(what, kind, links, points)
            return
        # Both frames are turned so that the axes are those of the closure.
        axes = [numbers_in(text or "", 3, "gazebo joint: axis") for text in texts]
        where = f"gazebo joint {joint.get('name')!r}"
        turns = turned_axes(closure, axes and [axes[0], axes[-1]], where)
        T = se3.from_roll_pitch_yaw(numbers[:3], numbers[3:])
        T_a, T_b = (T @ se3.pose(R) for R in turns)
        self._close(closure, links, T_a_b @ T_a, T_b)

    def _leave_out_element(
        self, element: ET.Element, key: str, frames: Mapping[str, str]
    ) -> None:
        """Leave out an element that changes the mechanics.

        Show the YAML that replaces it.
        """
        links, points, values = self._words_of(element, frames)
        what = f"<{_local(element.tag)}>"
        if key == "closures":
            self._leave_out_closure(what, element.get("type", ""), links[:2], points)
        elif key == "lines":
            k, rest = (values.get(word, "...") for word in ("stiffness", "rest_length"))
            line = (
                f"frames: [{', '.join(links[:2]) or '...'}], "
                f"points: [{', '.join(map(_row, points[:2])) or '...'}], "
                f"stiffness: {k}, rest_length: {rest}"
            )
            self._leave_out_acting(what, links, key, f"lines: [{{{line}}}]")
        else:
            entries = [
                f"{name}: {{stiffness: {_about_axis(self.joints[name], values)}}}"
                for name in sorted(self.between(links))
                if self.joints[name].get("type") in _AXIAL_TYPES
            ]
            yaml = f"springs: {{{', '.join(entries[:6])}}}"
            self._leave_out_acting(what, links, key, yaml)

    def _words_of(
        self, element: ET.Element, frames: Mapping[str, str]
    ) -> tuple[list[str], list[list[float]], dict[str, str]]:
        """Links, points and values by name in an element of another format."""
        links, points, values = list[str](), list[list[float]](), dict[str, str]()
        for part in element.iter():
            tag, text = _local(part.tag), (part.text or "").strip()
            for word, value in (*part.attrib.items(), ("text", text)):
                link = frames.get(value, value)
                if link in (*self.links, "world") and link not in links:
                    links.append(link)
                is_place = word in ("xyz", "value") and "axis" not in tag
                if is_place and len(value.split()) == 3:
                    with suppress(ValueError):
                        points.append([float(x) for x in value.split()])
                values[{"value": tag}.get(word, word)] = value
        return links, points, values

    def _leave_out_closure(
        self, what: str, kind: str, links: list[str], points: Sequence[Sequence[float]]
    ) -> None:
        tied = "weld" if kind in ("fixed", "weld") else "point"
        at = ""
        if len(points) == 2:
            at = f", points: [{', '.join(map(_row, points))}]"
        closure = f"{{frames: [{', '.join(links)}], type: {tied}{at}}}"
        yaml = f"kind: closed-chain, closures: [{closure}]"
        self._leave_out_acting(what, links, "closures", yaml)

    def _leave_out_acting(self, what: str, links: list[str], key: str, yaml: str) -> None:
        expected, joints = f"in a mechanism file: {yaml}", self.between(links)
        self.obstacles.append(Obstacle(what, joints, expected=expected, keys=(key,)))

    def check_tree(self) -> None:
        """Refuse links that do not all hang from one root."""
        parent_of = {link: parent for link, (_, parent) in self.carrier.items()}
        try:
            TopologicalSorter(
                {link: {parent} for link, parent in parent_of.items()}
            ).prepare()
        except CycleError as error:
            raise InputError(
                "links form a cycle", got=" -> ".join(error.args[1])
            ) from None
        roots = [link for link in self.links if link not in parent_of]
        if len(roots) > 1:
            got = ", ".join(roots[:5])
            raise InputError("robot is not one tree", expected="one root link", got=got)

    def check_places(self) -> None:
        """Add notes on places that look like degrees or millimetres."""
        lengths, angles = (
            {
                f"{key} of joint {name}": _floats(joint.find("origin"), key, "0 0 0")
                for name, joint in self.joints.items()
            }
            for key in ("xyz", "rpy")
        )
        self.notes += [*large_angles(angles), *large_lengths(lengths)]


def _has_more(joint: ET.Element) -> bool:
    """Whether a joint of SDF is placed in another frame, or has a spring."""
    places = (part for tag in ("pose", "xyz") for part in joint.iter(tag))
    more = (e.text or "0" for tag in _SDF_WITHOUT_MEANING for e in joint.iter(tag))
    return any(part.attrib for part in places) or any(
        text.strip().lower() not in ("0", "0.0", "false") for text in more
    )


def _local(tag: str) -> str:
    """A tag without its namespace."""
    return tag.rpartition("}")[2]


def _shift(point: Sequence[float]) -> Array:
    return se3.pose(translation=point)


def _floats(element: ET.Element | None, key: str, otherwise: str) -> list[float]:
    """Numbers of an attribute that has been checked."""
    return [
        float(x)
        for x in (otherwise if element is None else element.get(key, otherwise)).split()
    ]


def _placed(origin: ET.Element | None) -> Array:
    """Pose of an `origin` that has been checked."""
    return se3.from_roll_pitch_yaw(
        *(_floats(origin, key, "0 0 0") for key in ("xyz", "rpy"))
    )


def retype_joints(root: ET.Element, kinds: Mapping[str, str]) -> None:
    """Change types of joints: "fixed", "spherical", or "ujoint_xy" for turns about x,
    then y.

    Turns are named joint.x, joint.y, joint.z, and so are the links between them.

    Raises
    ------
    UnknownNameError
        For a joint that does not exist.
    """
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for name, kind in kinds.items():
        check_name("joint", name, joints)
        joint, child = joints[name], joints[name].find("child")
        if kind == "fixed" or child is None:
            joint.set("type", "fixed")
            continue
        for part in [p for tag in ("axis", "limit", "mimic") for p in joint.findall(tag)]:
            joint.remove(part)
        letters, end = "xyz" if kind == "spherical" else kind[-2:], child.get("link", "")
        # The first turn is the joint; the others follow, each on a link of its own.
        for letter, following in zip(letters, (*letters[1:], ""), strict=True):
            turn = f"{name}.{letter}"
            joint.attrib |= {"name": turn, "type": "continuous"}
            child.set("link", turn if following else end)
            axis = " ".join("1" if own == letter else "0" for own in "xyz")
            ET.SubElement(joint, "axis", xyz=axis)
            if following:
                ET.SubElement(root, "link", name=turn)
                joint = ET.SubElement(root, "joint")
                ET.SubElement(joint, "parent", link=turn)
                child = ET.SubElement(joint, "child")


def read_urdf(
    root: ET.Element, where: str, floating: bool, joint_types: Mapping[str, str]
) -> RobotDescription:
    """Check a URDF, change it to what Pinocchio needs, and read it.

    With `floating` the root is free in F; `joint_types` are those of `retype_joints`.

    Raises
    ------
    InputError
        One line with the file and the element that is wrong.
    """
    try:
        # First types and words are checked, then joints, then the tree and its masses.
        retype_joints(root, joint_types)
        _check_root(root)
        reader = _Reader(root)
        robot = _Robot(root, where)
        robot.notes += reader.notes()
        robot.read_joints(reader)
        held = robot.hold_followers()
        robot.check_masses()
        robot.read_extensions(reader.beside)
        return _description(root, robot, held, floating)
    except InputError as error:
        raise error.at(where) from None


def _check_root(root: ET.Element) -> None:
    """Refuse a file without links, or with too many joints."""
    if any(e.tag.startswith("{") and "xacro" in e.tag for e in root.iter()):
        raise InputError(
            "is a xacro file", expected="a URDF: expand it with the xacro command first"
        )
    if root.get("name") is None:
        raise InputError("robot has no name", expected="<robot name=...>")
    if root.find("link") is None:
        raise InputError("robot has no links")
    kinds = [joint.get("type") for joint in root.findall("joint")]
    moving = len(kinds) - kinds.count("fixed")
    for kind, count, most in (
        ("", len(kinds), _MAX_JOINTS),
        ("moving ", moving, MOST_MOVING),
    ):
        if count > most:
            raise InputError(
                f"too many {kind}joints", expected=f"at most {most}", got=count
            )


def _description(
    root: ET.Element, robot: _Robot, held: dict[str, float], floating: bool
) -> RobotDescription:
    """Return Pinocchio's model of a robot that has been checked, and all beside it."""
    joints = robot.joints
    springs, curved = on_leaders(robot.springs, robot.mimics)
    types = {name: joint.get("type") for name, joint in joints.items()}
    looped = {j for closure in robot.closures for j in closure.joints}
    # Joints of loops that nothing holds or drives move freely.
    free = looped - springs.keys() - robot.actuated - held.keys()
    loose = frozenset(n for n, kind in types.items() if kind == "floating") - looped
    free_root = (pin.JointModelFreeFlyer(), "root") if floating and not loose else ()
    try:
        model = pin.buildModelFromXML(_moving_parts(root), *free_root)
    except Exception as error:
        raise InputError("not a usable URDF", got=str(error)) from None
    return RobotDescription(
        model,
        springs=springs,
        passive=tuple(n for n in joints if n in free and types[n] != "fixed"),
        actuated=tuple(name for name in joints if name in robot.actuated),
        efforts=robot.efforts,
        followers=robot.mimics,
        locked=held,
        closures=tuple(robot.closures),
        planar_axes=robot.planar_axes,
        loose=loose,
        notes=tuple(robot.notes),
        obstacles=(*robot.obstacles, *curved),
    )


def _moving_parts(root: ET.Element) -> str:
    """URDF of links with their masses and of joints: the C++ parser may complain
    about the rest.
    """
    kept = ET.Element("robot", root.attrib)
    for part in root:
        if part.tag == "joint":
            kept.append(part)
        elif part.tag == "link":
            ET.SubElement(kept, "link", part.attrib).extend(part.findall("inertial"))
    return ET.tostring(kept, encoding="unicode")


def _texts(element: ET.Element) -> dict[str, str]:
    """Texts of an element's children, by tag."""
    return {child.tag: child.text or "" for child in element}


def _mechanical(tag: str) -> str | None:
    """Key of a mechanism file that replaces an element.

    None for elements without effect.
    """
    return next(
        (key for key, words in _MECHANICAL.items() if words.search(tag.lower())), None
    )


def _about_axis(joint: ET.Element, values: Mapping[str, str]) -> str:
    """Stiffness of a bushing about or along the axis of a joint,
    as far as it is known.
    """
    word = "force" if joint.get("type") == "prismatic" else "torque"
    text = next((v for k, v in values.items() if k.endswith(f"{word}_stiffness")), "")
    try:
        k, a = (
            np.array(text.split(), float),
            np.array(_floats(joint.find("axis"), "xyz", "1 0 0")),
        )
        return f"{float(k @ (a * a) / (a @ a)):g}"
    except ValueError:
        return "..."


def _row(values: Sequence[float]) -> str:
    return "[" + ", ".join(f"{x:.6g}" for x in values) + "]"


def _named(root: ET.Element, tag: str) -> dict[str, ET.Element]:
    elements: dict[str, ET.Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise InputError(f"a {tag} has no name")
        if name in elements:
            raise InputError(f"two {tag}s have the name {name!r}")
        elements[name] = element
    return elements


def _check_inertial(link: ET.Element, what: str) -> bool:
    """Whether some body has these moments of inertia, which are removed otherwise."""
    inertial = link.find("inertial")
    if inertial is None:
        return True
    mass = _floats(inertial.find("mass"), "value", "")
    if not mass:
        raise InputError(f"{what}: inertial has no mass")
    if mass[0] < 0:
        raise InputError(f"{what}: mass is negative", got=f"{mass[0]:g}")
    # Statics needs masses and centres only: a missing or impossible rotational inertia
    # becomes zero.
    inertia = inertial.find("inertia")
    if inertia is not None and _is_possible(inertia):
        return True
    if inertia is not None:
        inertial.remove(inertia)
    ET.SubElement(inertial, "inertia", dict.fromkeys(_ATTRIBUTES["inertia"].split(), "0"))
    return inertia is None or mass[0] == 0.0


def _is_possible(inertia: ET.Element) -> bool:
    """Whether six numbers are the inertia of some body: its principal moments
    form a triangle.
    """
    try:
        xx, xy, xz, yy, yz, zz = (
            float(inertia.get(key, "")) for key in _ATTRIBUTES["inertia"].split()
        )
    except ValueError:
        return False
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > LARGEST_INPUT:
        return False
    return is_inertia(matrix, 1e-3)  # to the digits that are printed


class _Reader:
    """Removes elements without effect from a URDF; refuses typing errors and
    repeated elements.

    All numbers are checked; faults within `_JOINT_PARTS` are the joint's own.

    Attributes
    ----------
    unknown : list of str
        Unknown elements, attributes and texts.
    faults : list of (str, InputError)
        Names of joints with faults of their own parts, which are removed.
    mechanical : dict of str to list of str
        By joint, the tags in it that act on it.
    extensions, dynamics : dict of str to list of dict
        By joint, texts of simulators' elements, and attributes of its dynamics.
    beside : list of Element
        Elements beside links and joints.
    """

    def __init__(self, root: ET.Element) -> None:
        self.unknown = list[str]()
        self.faults: list[tuple[str, InputError]] = []
        self.mechanical: dict[str, list[str]] = {}
        self.extensions: dict[str, list[dict[str, str]]] = {}
        self.dynamics: dict[str, list[dict[str, str]]] = {}
        self.version = root.attrib.pop("version", "1.0").strip()
        if self.version not in _VERSIONS:
            got = repr(self.version)
            raise InputError(
                "unknown version of URDF", expected=", ".join(_VERSIONS), got=got
            )
        self.beside = [child for child in root if child.tag not in ("link", "joint")]
        self._read(root, "")

    def notes(self) -> list[Note]:
        """Return a note on unknown elements, attributes and texts."""
        if not self.unknown:
            return []
        names = list(dict.fromkeys(self.unknown))
        shown_names = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
        words = f"what is not URDF plays no part: {shown_names}"
        return [Note("ignored", words, {"elements": names})]

    def _read(self, element: ET.Element, inside: str) -> None:
        tag, name = element.tag, element.get("name", "")
        place = f"{tag} {name!r}" if name else f"{inside}{tag}"
        within = "" if tag == "robot" else f"{place}: "
        self._check_words(element, place)
        for child in list(element):
            if child.tag not in _USED_CHILDREN.get(tag, "").split():
                element.remove(child)
                self._read_other(element, child, place)
        own = [child for child in element if tag == "joint" and child.tag in _JOINT_PARTS]
        for part in own:
            self._read_own(element, part, name)
        tags = [child.tag for child in element if child not in own]
        for twice in {t for t in tags if tag != "robot" and tags.count(t) > 1}:
            raise InputError(f"{place} has several <{twice}>", expected="one")
        for child in reversed(element):
            if child not in own:
                self._read(child, within)
        if element.get("quat_xyzw") is not None:
            self._to_angles(element, place)

    def _read_other(self, element: ET.Element, child: ET.Element, place: str) -> None:
        """Read an element that Pinocchio does not get."""
        tag, name, local = element.tag, element.get("name", ""), _local(child.tag)
        if tag == "joint":
            if child.tag == "gazebo":
                self.extensions.setdefault(name, []).append(_texts(child))
            elif _mechanical(child.tag) is not None:
                self.mechanical.setdefault(name, []).append(child.tag)
                return
        elif tag == "robot" and (local in ("joint", "frame") or _mechanical(local)):
            return  # read as an element beside links and joints
        # A tag with a namespace is an extension.
        ignored = _IGNORED_CHILDREN.get(tag, "").split()
        if child.tag not in ignored and not child.tag.startswith("{"):
            used = _USED_CHILDREN.get(tag, "").split()
            what = f"{place}: unknown element"
            self._refuse_typo(child.tag, used, what, f"<{child.tag}>")
            if tag in _STRICT_TAGS:
                self._refuse_inside(place, child)
            self.unknown.append(f"<{child.tag}> in <{tag}>")

    def _read_own(self, joint: ET.Element, part: ET.Element, name: str) -> None:
        """Check a part of a joint; remove it where it cannot be used."""
        what = f"joint {name!r}"
        place = f"{what}: {part.tag}"
        if part.tag == "dynamics":
            self.dynamics.setdefault(name, []).append(dict(part.attrib))
        try:
            if part.tag == "limit" and (kind := joint.get("type")) not in _LIMITED_TYPES:
                effort = part.attrib.pop("effort", None)
                part.attrib.clear()
                if kind not in _AXIAL_TYPES or effort is None:
                    joint.remove(part)
                    return
                part.set("effort", effort)
            if len(joint.findall(part.tag)) > 1:
                raise InputError(f"{what} has several <{part.tag}>", expected="one")
            if part.tag == "dynamics":
                self._check_numbers(part, place)
                return
            unknown, self.unknown = self.unknown, []
            try:
                self._check_words(part, place)
            finally:
                self.unknown = unknown
            for child in part:
                self._refuse_inside(place, child)
        except InputError as error:
            self.faults.append((name, error))
            joint.remove(part)

    def _refuse_inside(self, place: str, child: ET.Element) -> None:
        what = f"{place} holds an element"
        raise InputError(what, expected="attributes only", got=f"<{child.tag}>")

    def _refuse_typo(self, name: str, known: Sequence[str], what: str, got: str) -> None:
        if close := get_close_matches(name.lower(), known, n=1, cutoff=_TYPO_SIMILARITY):
            raise InputError(what, expected=close[0], got=got)

    def _check_words(self, element: ET.Element, place: str) -> None:
        """Check attributes and texts: URDF has attributes only, texts may be remarks."""
        tag = element.tag
        known = [word.partition("=")[0] for word in _ATTRIBUTES.get(tag, "").split()]
        strange = [
            key for key in element.attrib if key not in known and not key.startswith("{")
        ]
        for key in strange:
            what = f"{place}: unknown attribute"
            if tag in _STRICT_TAGS:
                raise InputError(what, expected=", ".join(known), got=key)
            self._refuse_typo(key, known[:4], what, key)
            self.unknown.append(f"{key}= in <{tag}>")
        if strange and tag == "limit" and not {"lower", "upper"} & set(element.attrib):
            expected, got = "lower=... upper=...", ", ".join(strange)
            raise InputError(
                f"{place}: no lower and no upper", expected=expected, got=got
            )
        for text in (element.text, *(child.tail for child in element)):
            if not (words := (text or "").strip()):
                continue
            if tag in _STRICT_TAGS or _ASSIGNMENT.search(words):
                expected = "attributes only, within a tag"
                raise InputError(
                    f"{place} holds text", expected=expected, got=repr(words[:40])
                )
            self.unknown.append(f"text {words[:40]!r} in <{tag}>")
        self._check_numbers(element, place)

    def _check_numbers(self, element: ET.Element, place: str) -> None:
        """Check numbers, and write them as Python does."""
        largest = math.inf if element.tag == "limit" else LARGEST_INPUT
        for word in _ATTRIBUTES.get(element.tag, "").split():
            key, _, count = word.partition("=")
            text = element.get(key)
            if count and text is not None:
                values = numbers_in(text, int(count), f"{place} {key}", largest)
                element.set(key, " ".join(map(repr, values)))

    def _to_angles(self, origin: ET.Element, place: str) -> None:
        """Write the quaternion of an origin as roll, pitch, yaw."""
        if self.version == "1.0":
            expected = '<robot version="1.1">'
            raise InputError(f"{place}: quat_xyzw needs URDF 1.1", expected=expected)
        if origin.get("rpy") is not None:
            raise InputError(
                f"{place} has both rpy and quat_xyzw", expected="one of them"
            )
        quaternion = np.array(_floats(origin, "quat_xyzw", ""))
        if np.linalg.norm(quaternion) < numerics.NEGLIGIBLE_DIFFERENCE:
            raise InputError(f"{place}: quat_xyzw is zero", expected="a rotation")
        del origin.attrib["quat_xyzw"]
        R = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix()
        origin.set(
            "rpy", " ".join(repr(float(x)) for x in se3.roll_pitch_yaw(se3.pose(R)))
        )


def numbers_in(
    text: str, count: int, what: str, largest: float = LARGEST_INPUT
) -> list[float]:
    """Return the finite numbers of a text; refuse another count of them."""
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != count or "_" in text or not all(map(math.isfinite, values)):
        raise InputError(f"{what} is not {count} finite number(s)", got=repr(text))
    if any(abs(v) > largest for v in values):
        raise InputError(
            f"{what} is too large", expected=f"at most {largest:g}", got=repr(text)
        )
    return values
