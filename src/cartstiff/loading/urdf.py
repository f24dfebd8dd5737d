"""URDF: checked before Pinocchio sees it, and read for what Pinocchio drops.

What bears on statics is read or refused. A fault of a single joint, and an element that closes a
loop, holds or springs joints and cannot be read, refuse the robot only where such a joint moves the
frame of interest. Elements and attributes that neither URDF nor its known extensions define are
named in a note, and refused where they look like a slip of the pen.
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

from cartstiff import numerics
from cartstiff.errors import InputError, check_name
from cartstiff.geometry import se3
from cartstiff.loading.plausible import large_lengths, turned
from cartstiff.loading.robot_facts import (
    FileClosure,
    FileSpring,
    Followers,
    Obstacle,
    RobotFacts,
    on_leaders,
    turned_axes,
)
from cartstiff.loading.yaml_file import LARGEST_NUMBER
from cartstiff.notes import Note

_MOST_JOINTS = 2000
#: Pinocchio's workspace takes a second to set up for 200 joints in a row, an hour for 2000.
MOST_MOVING = 200
_AXIAL_TYPES = {"revolute", "continuous", "prismatic"}
_LIMITED = ("revolute", "prismatic")
_JOINT_TYPES = {*_AXIAL_TYPES, "fixed", "floating", "planar"}
#: Makes an error with the file's name in front.
Refuse = Callable[..., InputError]

_VERSIONS = ("1.0", "1.1", "1.2")


# By tag: the elements within that Pinocchio is shown (of others it might refuse what plays no part
# here), those of URDF and of what is usually written into it that do not bear on statics, and the
# attributes, some of which are met in the wild only, with how many numbers they hold.
_SHOWN = {
    "robot": "link joint",
    "link": "inertial",
    "inertial": "origin mass inertia",
    "joint": "parent child origin axis limit mimic dynamics",
}
_SILENT = {
    "robot": "material gazebo transmission ros2_control sensor group",
    "link": "visual collision material gazebo sensor contact surface gravity kinematic self_filter "
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

# Parts of a joint whose faults are the joint's own affair, as long as it does not move the frame.
_OWN = ("limit", "mimic", "dynamics")

# Where nothing but these attributes makes sense: nothing else may stand there, nor inside.
_STRICT = ("origin", "axis", "parent", "child", "mass", "mimic")

# What an attribute looks like that stands outside of a tag.
_ASSIGNMENT = re.compile(r"\w\s*=\s*[\"']")

# Likeness (difflib's ratio) from which on an unknown name is taken for a slip of the pen: one
# letter too many, too few or exchanged in a name of four gives 0.75 and more.
_ALIKE = 0.7

# Names that simulators give to the stiffness of a joint and its rest position.
_STIFFNESS = re.compile(r"spring_?stiffness", re.IGNORECASE)
_REFERENCE = re.compile(r"spring_?reference", re.IGNORECASE)
# Tags, without their namespace, of what changes the mechanics, by the key of a mechanism file that
# says the same.
_MECHANICAL = {
    "closures": re.compile(r"constraint|closure|loop|connect|equality|weld|coupling"),
    "lines": re.compile(r"force_?element|cable|tendon|muscle|linear_?spring"),
    "springs": re.compile(r"spring|stiffness|bushing|elastic|complian"),
}


#: Joints of SDF that are closures: their kind, and where their axes are written.
_JOINED: dict[str, tuple[Literal["weld", "hinge", "universal"], tuple[str, ...]]] = {
    "fixed": ("weld", ()),
    "revolute": ("hinge", ("axis",)),
    "continuous": ("hinge", ("axis",)),
    "universal": ("universal", ("axis", "axis2")),
}


class _Robot:
    """The links and joints of a URDF while it is checked.

    Attributes
    ----------
    links, joints : dict of str to Element
        By name.
    carrier : dict of str to (str, str)
        Of each link that has one: its joint and that joint's parent link.
    obstacles : list of Obstacle
        What cannot be used.
    """

    def __init__(self, root: ET.Element, refuse: Refuse) -> None:
        self.refuse = refuse
        self.links, self.joints = _names(root, "link", refuse), _names(root, "joint", refuse)
        self.carrier: dict[str, tuple[str, str]] = {}
        self.obstacles: list[Obstacle] = []

    def way(self, link: str) -> set[str]:
        """Joints between the root and a link."""
        joints: set[str] = set()
        while link in self.carrier:
            joint, link = self.carrier[link]
            joints.add(joint)
        return joints

    def between(self, links: Iterable[str]) -> frozenset[str]:
        """Joints between links; all joints where a link is not known."""
        ways = [self.way(link) for link in links if link in self.links or link == "world"]
        if len(ways) < 2:
            return frozenset(self.joints)
        return frozenset(set[str].union(*ways) - set[str].intersection(*ways))

    def at_zero(self, link: str) -> se3.Array:
        """Pose of a link in the root with all joints at zero."""
        T = np.eye(4)
        while link in self.carrier:
            joint, link = self.carrier[link]
            T = _placed(self.joints[joint].find("origin")) @ T
        return T

    def leave_out(self, joint: str, error: InputError) -> None:
        """Note what is wrong with a joint."""
        self.obstacles.append(Obstacle(error.what, frozenset({joint}), error=error))

    def attempt(self, joint: str, check: Callable[..., None], *arguments: object) -> None:
        """Run a check whose refusal is the joint's own affair."""
        try:
            check(*arguments)
        except InputError as error:
            self.leave_out(joint, error)


def _floats(element: ET.Element | None, key: str, otherwise: str) -> list[float]:
    """Numbers of an attribute that has been checked."""
    return [
        float(x) for x in (otherwise if element is None else element.get(key, otherwise)).split()
    ]


def _placed(origin: ET.Element | None) -> se3.Array:
    """Pose of an `origin` that has been checked."""
    return se3.from_roll_pitch_yaw(*(_floats(origin, key, "0 0 0") for key in ("xyz", "rpy")))


def retype_joints(root: ET.Element, kinds: Mapping[str, str], where: str) -> None:
    """Joints of a URDF as others: "fixed", "spherical", or "ujoint_xy" for two turns in a row.

    Turns are named joint.x, joint.y, joint.z, and so are the links between them.

    Raises
    ------
    UnknownNameError
        For a joint that does not exist.
    """
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for name, kind in kinds.items():
        check_name("joint", name, joints, where)
        joint, child = joints[name], joints[name].find("child")
        if kind == "fixed" or child is None:
            joint.set("type", "fixed")
            continue
        for part in [p for tag in ("axis", "limit", "mimic") for p in joint.findall(tag)]:
            joint.remove(part)
        letters = "xyz" if kind == "spherical" else kind[-2:]
        carried = [f"{name}.{letter}" for letter in letters]
        links = [*carried[:-1], child.get("link", "")]
        for i, (turn, link) in enumerate(zip(carried, links, strict=True)):
            if i:
                joint, child = ET.SubElement(root, "joint"), ET.Element("child")
                ET.SubElement(joint, "parent", link=links[i - 1])
                joint.append(child)
                ET.SubElement(root, "link", name=links[i - 1])
            joint.attrib |= {"name": turn, "type": "continuous"}
            child.set("link", link)
            ET.SubElement(joint, "axis", xyz=" ".join(str(int(a == letters[i])) for a in "xyz"))


def prepare_urdf(root: ET.Element, where: str) -> RobotFacts:
    """Check names, tree and numbers; give every inertia-less file what Pinocchio needs.

    Returns what Pinocchio does not read: followers, springs, loops, and what cannot be used.

    Raises
    ------
    InputError
        One line with the file and the element that is wrong.
    """

    def refuse(what: str, **words: object) -> InputError:
        return InputError(what, where=where, **words)  # type: ignore[arg-type]

    if any(e.tag.startswith("{") and "xacro" in e.tag for e in root.iter()):
        raise refuse("is a xacro file", expected="a URDF: expand it with the xacro command first")
    if root.get("name") is None:
        raise refuse("robot has no name", expected="<robot name=...>")
    reader = _Reader(root, refuse)
    robot, notes = _Robot(root, refuse), reader.notes()
    links, joints = robot.links, robot.joints
    if not links:
        raise refuse("robot has no links")
    moving = sum(joint.get("type") != "fixed" for joint in joints.values())
    for kind, count, most in (("", len(joints), _MOST_JOINTS), ("moving ", moving, MOST_MOVING)):
        if count > most:
            raise refuse(f"too many {kind}joints", expected=f"at most {most}", got=str(count))
    mimics: Followers = {}
    springs: dict[str, FileSpring] = {}
    planar_axes: dict[str, se3.Array] = {}
    for name, joint in joints.items():
        _hang(robot, name, joint)
        what, axis = f"joint {name!r}", joint.find("axis")
        try:
            kind = _kind(joint, axis, what, refuse)
        except InputError as error:
            if joint.get("type") == "fixed":
                raise
            robot.leave_out(name, error)
            kind = "continuous"
            joint.set("type", kind)
            if axis is not None:
                joint.remove(axis)
        if kind == "planar":
            notes += _plane(name, axis, planar_axes)
        parts = {tag: joint.find(tag) for tag in _OWN}
        for part in parts.values():
            if part is not None:
                joint.remove(part)
        if kind in _LIMITED:
            made = ET.SubElement(
                joint, "limit", effort="0", velocity="0", lower="-1e9", upper="1e9"
            )
            robot.attempt(name, _limit, made, parts["limit"], what, refuse)
        robot.attempt(name, _mimic, mimics, robot, name, joint, parts["mimic"])
        said = [*reader.extensions.get(name, ()), *reader.dynamics.get(name, ())]
        robot.attempt(name, _dynamics, robot, name, joint, parts["dynamics"], said, springs)
        for tag in reader.mechanical.get(name, ()):
            expected = f"in a mechanism file: springs: {{{name}: {{stiffness: ...}}}}"
            robot.leave_out(name, refuse(f"{what}: <{tag}> cannot be read", expected=expected))
    for name, fault in reader.faults:
        robot.leave_out(name, fault)
    notes += _doubts(joints)
    _check_tree(robot)
    _leave_out_rings(robot, mimics)
    held = _held(joints, mimics)
    for name, element in links.items():
        if not _check_inertial(element, f"link {name!r}", refuse):
            words = f"link {name!r}: no body has this inertia; none counts, which vibrations feel"
            notes.append(Note("impossible-inertia", words, {"link": name}))
    closures, actuated = _beside(robot, reader.beside, springs, mimics)
    springs, curved = on_leaders(springs, mimics)
    fixed = {name for name, joint in joints.items() if joint.get("type") == "fixed"}
    looped = {j for closure in closures for j in closure.joints}
    free = looped - springs.keys() - actuated - fixed - held.keys()
    return RobotFacts(
        springs=springs,
        passive=tuple(name for name in joints if name in free),
        actuated=tuple(name for name in joints if name in actuated),
        followers=mimics,
        locked=held,
        closures=tuple(closures),
        planar_axes=planar_axes,
        loose=frozenset(n for n, j in joints.items() if j.get("type") == "floating") - looped,
        notes=tuple(notes),
        obstacles=(*robot.obstacles, *curved),
    )


def _hang(robot: _Robot, name: str, joint: ET.Element) -> None:
    """Hang a joint's child on its parent."""
    refuse, ends = robot.refuse, []
    for end in ("parent", "child"):
        element = joint.find(end)
        link = None if element is None else element.get("link")
        if not link:
            raise refuse(f"joint {name!r} has no {end} link")
        if link not in robot.links:
            raise refuse(f"joint {name!r} names a {end} link that does not exist", got=repr(link))
        ends.append(link)
    parent, child = ends
    if child in robot.carrier:
        raise refuse(f"link {child!r} has two parent joints", got=f"the second is {name!r}")
    if parent == child:
        raise refuse(f"joint {name!r} joins link {child!r} to itself")
    robot.carrier[child] = name, parent


def _kind(joint: ET.Element, axis: ET.Element | None, what: str, refuse: Refuse) -> str:
    """Type of a joint whose axis has a direction."""
    kind = joint.get("type")
    if kind not in _JOINT_TYPES:
        raise refuse(
            f"{what} has an unknown type",
            expected=", ".join(sorted(_JOINT_TYPES)),
            got=kind or "none",
        )
    if axis is not None and kind in (*_AXIAL_TYPES, "planar"):
        if axis.get("xyz") is None:
            raise refuse(f"{what}: axis has no xyz", expected="<axis xyz=...>")
        if math.hypot(*_floats(axis, "xyz", "")) < numerics.CLOSE:
            raise refuse(f"{what} has a zero axis")
    return str(kind)


def _limit(made: ET.Element, element: ET.Element | None, what: str, refuse: Refuse) -> None:
    """Limits as Pinocchio needs them; without bounds there are none."""
    if element is not None and {"lower", "upper"} & set(element.attrib):
        ((lower,), (upper,)) = (_floats(element, key, "0") for key in ("lower", "upper"))
        if lower > upper:
            raise refuse(
                f"{what}: limits are the wrong way round",
                expected="lower <= upper",
                got=f"{lower:g}, {upper:g}",
            )
        made.attrib |= {"lower": repr(lower), "upper": repr(upper)}


def _dynamics(
    robot: _Robot,
    name: str,
    joint: ET.Element,
    element: ET.Element | None,
    extensions: list[dict[str, str]],
    springs: dict[str, FileSpring],
) -> None:
    """Damping, and the spring that simulators read beside it."""
    for values in extensions:
        _spring_of(robot, name, values, springs)
    if joint.get("type") in _AXIAL_TYPES:
        for damping in _floats(element, "damping", ""):
            if damping < 0.0:
                words = f"joint {name!r}: damping is negative"
                raise robot.refuse(words, expected="zero or more", got=f"{damping:g}")
            ET.SubElement(joint, "dynamics", damping=repr(damping))


def _spring_of(
    robot: _Robot, name: str, values: Mapping[str, str], springs: dict[str, FileSpring]
) -> None:
    """The spring of a joint that a simulator's words say, where they do."""
    what, refuse = f"joint {name!r}", robot.refuse
    found = {}
    for key, text in values.items():
        for pattern in (_STIFFNESS, _REFERENCE):
            if pattern.fullmatch(key):
                found[pattern] = _numbers(text.strip(), 1, f"{what}: {key}", refuse)[0]
        if key.lower() == "stiffness":
            raise refuse(
                f"{what}: 'stiffness' is no word of URDF",
                expected=f"in a mechanism file: springs: {{{name}: {{stiffness: {text.strip()}}}}}",
            )
    if not (k := found.get(_STIFFNESS, 0.0)):
        return
    if k < 0.0:
        raise refuse(f"{what}: stiffness is negative", expected="zero or more", got=f"{k:g}")
    if robot.joints[name].get("type") not in _AXIAL_TYPES:
        raise refuse(
            f"{what} has a spring and several coordinates",
            expected="a revolute, continuous or prismatic joint",
            got=robot.joints[name].get("type"),
        )
    spring = FileSpring((k,), found.get(_REFERENCE, 0.0))
    if springs.get(name, spring) != spring:
        raise refuse(f"{what} has two springs", expected="one")
    springs[name] = spring


def _texts(element: ET.Element) -> dict[str, str]:
    """Texts of an element's children, by tag."""
    return {child.tag: child.text or "" for child in element}


def _mimic(
    mimics: Followers, robot: _Robot, name: str, joint: ET.Element, mimic: ET.Element | None
) -> None:
    """Which joint a joint follows."""
    what, refuse, joints = f"joint {name!r}", robot.refuse, robot.joints
    if mimic is None:
        return
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
    if joint.get("type") != "fixed":
        (factor,), (offset,) = _floats(mimic, "multiplier", "1"), _floats(mimic, "offset", "0")
        mimics[name] = leader, factor, offset


def _leave_out_rings(robot: _Robot, mimics: Followers) -> None:
    """Joints that follow each other, which no joint leads."""
    rings: dict[str, list[str]] = {}
    for name in mimics:
        followed = [name]
        while (leader := mimics[followed[-1]][0]) in mimics and leader not in followed:
            followed.append(leader)
        if leader in followed:
            rings[name] = [*followed, leader]
    for name, ring in rings.items():
        error = robot.refuse("mimic joints follow each other", got=" -> ".join(ring))
        robot.leave_out(name, error)
        del mimics[name]


def _beside(
    robot: _Robot,
    elements: Iterable[ET.Element],
    springs: dict[str, FileSpring],
    mimics: Followers,
) -> tuple[list[FileClosure], set[str]]:
    """Loops that the elements beside links and joints close, and joints that they drive."""
    closures: list[FileClosure | None] = []
    actuated: set[str] = set()
    frames = {str(e.get("name")): str(e.get("link")) for e in elements if e.tag == "frame"}
    for element in elements:
        tag, whose = element.tag.rpartition("}")[2], element.get("reference")
        if tag == "joint":
            raise robot.refuse(
                f"joint {element.get('name')!r} is of another dialect than URDF",
                expected=f"<joint> of type {', '.join(sorted(_JOINT_TYPES))}",
                got=f"<{element.tag}>",
            )
        if tag in ("transmission", "ros2_control"):
            named = {str(joint.get("name")) for joint in element.iter("joint")}
            actuated |= named & robot.joints.keys()
        elif tag == "gazebo" and whose in robot.joints:
            robot.attempt(whose, _spring_of, robot, whose, _texts(element), springs)
        elif tag == "gazebo":
            for joint in element.findall("joint"):
                closures.append(_closed_by(robot, joint))
            for plugin in element.iter("plugin"):
                follower = (plugin.findtext("mimicJoint") or "").strip()
                if follower in robot.joints and follower not in mimics:
                    leader = (plugin.findtext("joint") or "").strip()
                    what = f"plugin {plugin.get('name')!r} makes joint {follower!r} follow another"
                    expected = f"<mimic joint={leader!r}/> in joint {follower!r}"
                    robot.leave_out(follower, robot.refuse(what, expected=expected))
        elif tag == "ball_constraint":
            closures.append(_ball(robot, element))
        elif (key := _mechanical(tag)) is not None:
            _leave_out_element(robot, element, key, frames)
    return [closure for closure in closures if closure is not None], actuated


def _mechanical(tag: str) -> str | None:
    """Key of a mechanism file for what an element does; None if it does not act."""
    return next((key for key, words in _MECHANICAL.items() if words.search(tag.lower())), None)


def _ball(robot: _Robot, element: ET.Element) -> FileClosure | None:
    """Drake's ball constraint as a closure."""
    parts = {child.tag.rpartition("_constraint_")[2]: child for child in element}
    bodies = [parts[key].get("name", "") for key in ("body_A", "body_B") if key in parts]
    points = [
        _numbers(
            parts[key].get("value", "") if key in parts else "0 0 0",
            3,
            f"ball constraint: {key} value",
            robot.refuse,
        )
        for key in ("p_AP", "p_BQ")
    ]
    if len(bodies) != 2 or not {"world", *robot.links} >= set(bodies):
        _leave_out_element(robot, element, "closures", {})
        return None
    return _point_closure(robot, bodies, points)


def _point_closure(
    robot: _Robot, links: Sequence[str], points: Sequence[Sequence[float]]
) -> FileClosure:
    T_a, T_b = (se3.pose(translation=np.asarray(point)) for point in points)
    return FileClosure("point", links[0], links[1], T_a, T_b, robot.between(links))


def _closed_by(robot: _Robot, joint: ET.Element) -> FileClosure | None:
    """A joint of SDF between two links as a closure; a slide is to be written as one.

    What fixes the root to the room says nothing new.
    """
    links = [(joint.findtext(end) or "").strip().rpartition("::")[2] for end in ("parent", "child")]
    kind, place = joint.get("type"), joint.find("pose")
    if links[0] == "world" and kind == "fixed" and links[1] not in robot.carrier:
        return None
    if not {"world", *robot.links} >= set(links) or (place is not None and place.attrib):
        _leave_out_element(robot, joint, "closures", {})
        return None
    text = "0 0 0 0 0 0" if place is None else (place.text or "").strip()
    numbers = _numbers(text, 6, "gazebo joint: pose", robot.refuse)
    T_a_b = se3.inverse(robot.at_zero(links[0])) @ robot.at_zero(links[1])
    points = [(T_a_b @ [*numbers[:3], 1.0])[:3].round(9).tolist(), numbers[:3]]
    if kind == "ball":
        return _point_closure(robot, links, points)
    joined, names = _JOINED.get(kind or "", ("weld", ("none",)))
    texts = [joint.findtext(f"{name}/xyz") for name in names]
    if None not in texts:
        axes = [_numbers(text or "", 3, "gazebo joint: axis", robot.refuse) for text in texts]
        turns = turned_axes(
            joined, axes and [axes[0], axes[-1]], f"gazebo joint {joint.get('name')!r}"
        )
        T = se3.from_roll_pitch_yaw(numbers[:3], numbers[3:])
        T_a, T_b = (T @ se3.pose(R) for R in turns)
        first, second = links
        return FileClosure(joined, first, second, T_a_b @ T_a, T_b, robot.between(links))
    _leave_out_closure(robot, f"<joint type={kind!r}> in <gazebo>", kind or "", links, points)
    return None


def _leave_out_closure(
    robot: _Robot, what: str, kind: str, links: list[str], points: Sequence[Sequence[float]]
) -> None:
    tied = "weld" if kind in ("fixed", "weld") else "point"
    at = "" if len(points) != 2 else f", points: [{_row(points[0])}, {_row(points[1])}]"
    _leave_out_lines(
        robot,
        what,
        links,
        "closures",
        f"kind: closed-chain, closures: [{{frames: [{', '.join(links)}], type: {tied}{at}}}]",
    )


def _leave_out_element(
    robot: _Robot, element: ET.Element, key: str, frames: Mapping[str, str]
) -> None:
    """Name an element that changes the mechanics, with the lines of YAML that say the same."""
    links: list[str] = []
    points: list[list[float]] = []
    values: dict[str, str] = {}
    for part in element.iter():
        tag = part.tag.rpartition("}")[2]
        for word, value in (*part.attrib.items(), ("text", (part.text or "").strip())):
            link = frames.get(value, value)
            if (link in robot.links or link == "world") and link not in links:
                links.append(link)
            if word in ("xyz", "value") and len(value.split()) == 3 and "axis" not in tag:
                with suppress(ValueError):
                    points.append([float(x) for x in value.split()])
            values[word if word != "value" else tag] = value
    what = f"<{element.tag.rpartition('}')[2]}>"
    frame_words = ", ".join(links[:2]) or "..."
    if key == "closures":
        _leave_out_closure(robot, what, element.get("type", ""), links[:2], points)
    elif key == "lines":
        rows = ", ".join(map(_row, points[:2])) or "..."
        k, rest = (values.get(word, "...") for word in ("stiffness", "rest_length"))
        line = f"{{frames: [{frame_words}], points: [{rows}], stiffness: {k}, rest_length: {rest}}}"
        _leave_out_lines(robot, what, links, key, f"lines: [{line}]")
    else:
        entries = [
            f"{name}: {{stiffness: {_about_axis(robot.joints[name], values)}}}"
            for name in sorted(robot.between(links))
            if robot.joints[name].get("type") in _AXIAL_TYPES
        ]
        _leave_out_lines(robot, what, links, key, f"springs: {{{', '.join(entries[:6])}}}")


def _leave_out_lines(robot: _Robot, what: str, links: list[str], key: str, lines: str) -> None:
    expected = f"in a mechanism file: {lines}"
    joints = robot.between(links)
    robot.obstacles.append(Obstacle(what, joints, expected=expected, keys=(key,)))


def _about_axis(joint: ET.Element, values: Mapping[str, str]) -> str:
    """Stiffness of a bushing about or along the axis of a joint, as far as it is known."""
    word = "force" if joint.get("type") == "prismatic" else "torque"
    text = next((v for k, v in values.items() if k.endswith(f"{word}_stiffness")), "")
    try:
        k, a = np.array(text.split(), float), np.array(_floats(joint.find("axis"), "xyz", "1 0 0"))
        return f"{float(k @ (a * a) / (a @ a)):g}"
    except ValueError:
        return "..."


def _row(values: Sequence[float]) -> str:
    return "[" + ", ".join(f"{x:.6g}" for x in values) + "]"


def _doubts(joints: Mapping[str, ET.Element]) -> list[Note]:
    """Notes of places that look like degrees or millimetres."""
    lengths, angles = (
        {
            f"{key} of joint {name}": _floats(joint.find("origin"), key, "0 0 0")
            for name, joint in joints.items()
        }
        for key in ("xyz", "rpy")
    )
    return [*turned(angles), *large_lengths(lengths)]


def _plane(name: str, element: ET.Element | None, axes: dict[str, se3.Array]) -> list[Note]:
    """Where a planar joint moves: across its axis; Pinocchio always takes z."""
    if element is None:
        words = f"planar joint {name!r} has no axis: it moves across its frame's z axis"
        return [Note("planar-axis", words, {"joint": name})]
    axis = _floats(element, "xyz", "")
    if axis[0] or axis[1] or axis[2] < 0:
        axes[name] = np.array(axis) / math.hypot(*axis)
    return []


def _held(joints: dict[str, ET.Element], mimics: Followers) -> dict[str, float]:
    """Positions of the joints that follow one which stands still: they follow no more."""
    standing = {name: 0.0 for name, joint in joints.items() if joint.get("type") == "fixed"}
    held: dict[str, float] = {}
    while ready := {n: m for n, m in mimics.items() if m[0] in standing}:
        for name, (leader, factor, offset) in ready.items():
            standing[name] = held[name] = factor * standing[leader] + offset
            del mimics[name]
    return held


def _names(root: ET.Element, tag: str, refuse: Refuse) -> dict[str, ET.Element]:
    elements: dict[str, ET.Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            raise refuse(f"a {tag} has no name")
        if name in elements:
            raise refuse(f"two {tag}s have the name {name!r}")
        elements[name] = element
    return elements


def _check_tree(robot: _Robot) -> None:
    """Every link must hang from one root."""
    links, refuse = robot.links, robot.refuse
    parent_of = {link: parent for link, (_, parent) in robot.carrier.items()}
    try:
        TopologicalSorter({link: {parent} for link, parent in parent_of.items()}).prepare()
    except CycleError as error:
        raise refuse("links form a cycle", got=" -> ".join(error.args[1])) from None
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1:
        raise refuse("robot is not one tree", expected="one root link", got=", ".join(roots[:5]))


def _check_inertial(link: ET.Element, what: str, refuse: Refuse) -> bool:
    """Whether some body has the moments of inertia, which else are taken away."""
    inertial = link.find("inertial")
    if inertial is None:
        return True
    mass = _floats(inertial.find("mass"), "value", "")
    if not mass:
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
    ET.SubElement(inertial, "inertia", dict.fromkeys(_ATTRIBUTES["inertia"].split(), "0"))
    return inertia is None or mass[0] == 0.0


def _is_possible(inertia: ET.Element) -> bool:
    """Whether six numbers are the inertia of some body: principal ones keep the triangle rule."""
    try:
        xx, xy, xz, yy, yz, zz = (
            float(inertia.get(key, "")) for key in _ATTRIBUTES["inertia"].split()
        )
    except ValueError:
        return False
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > LARGEST_NUMBER:
        return False
    small, middle, large = np.linalg.eigvalsh(matrix)
    # Printed digits: thin plates meet the rule with equality.
    return bool(small >= 0.0 and small + middle >= (1.0 - 1e-3) * large)


class _Reader:
    """Takes out of a URDF what plays no part; refuses slips of the pen, and what stands twice.

    All numbers are checked; faults within `_OWN` are the joint's own.

    Attributes
    ----------
    unknown : list of str
        What is not known.
    faults : list of (str, InputError)
        By joint, what is wrong with its own parts, which are taken out.
    mechanical : dict of str to list of str
        By joint, the tags within that act on it.
    extensions, dynamics : dict of str to list of dict
        By joint, texts of simulators' elements, and attributes of its dynamics.
    beside : list of Element
        Elements beside links and joints.
    """

    def __init__(self, root: ET.Element, refuse: Refuse) -> None:
        self.refuse, self.unknown = refuse, list[str]()
        self.faults: list[tuple[str, InputError]] = []
        self.mechanical: dict[str, list[str]] = {}
        self.extensions: dict[str, list[dict[str, str]]] = {}
        self.dynamics: dict[str, list[dict[str, str]]] = {}
        self.version = root.attrib.pop("version", "1.0").strip()
        if self.version not in _VERSIONS:
            got = repr(self.version)
            raise refuse("unknown version of URDF", expected=", ".join(_VERSIONS), got=got)
        self.beside = [child for child in root if child.tag not in ("link", "joint")]
        self._read(root, "")

    def notes(self) -> list[Note]:
        """The note that names what is not known."""
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
        shown, silent = _SHOWN.get(tag, "").split(), _SILENT.get(tag, "").split()
        for child in list(element):
            if child.tag in shown:
                continue
            element.remove(child)
            local = child.tag.rpartition("}")[2]
            if tag == "joint" and child.tag == "gazebo":
                self.extensions.setdefault(name, []).append(_texts(child))
            if tag == "robot" and (local in ("joint", "frame") or _mechanical(local)):
                continue  # read beside
            if tag == "joint" and _mechanical(child.tag) is not None:
                self.mechanical.setdefault(name, []).append(child.tag)
            elif child.tag not in silent and not child.tag.startswith("{"):
                # A tag with a namespace is an extension.
                what = f"{place}: unknown element"
                self._refuse_slip(child.tag, shown, what, f"<{child.tag}>")
                if tag in _STRICT:
                    self._refuse_inside(place, child)
                self.unknown.append(f"<{child.tag}> in <{tag}>")
        own = [child for child in element if tag == "joint" and child.tag in _OWN]
        for part in own:
            self._read_own(element, part, name)
        tags = [child.tag for child in element if child not in own]
        for twice in {t for t in tags if tag != "robot" and tags.count(t) > 1}:
            raise self.refuse(f"{place} has several <{twice}>", expected="one")
        for child in reversed(element):
            if child not in own:
                self._read(child, within)
        if element.get("quat_xyzw") is not None:
            self._to_angles(element, place)

    def _read_own(self, joint: ET.Element, part: ET.Element, name: str) -> None:
        """Check a part of a joint, and take it out where it cannot be used."""
        what = f"joint {name!r}"
        place = f"{what}: {part.tag}"
        if part.tag == "dynamics":
            self.dynamics.setdefault(name, []).append(dict(part.attrib))
        try:
            if part.tag == "limit" and joint.get("type") not in _LIMITED:
                joint.remove(part)
                return
            if len(joint.findall(part.tag)) > 1:
                raise self.refuse(f"{what} has several <{part.tag}>", expected="one")
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
        raise self.refuse(what, expected="attributes only", got=f"<{child.tag}>")

    def _refuse_slip(self, name: str, known: Sequence[str], what: str, got: str) -> None:
        if close := get_close_matches(name.lower(), known, n=1, cutoff=_ALIKE):
            raise self.refuse(what, expected=close[0], got=got)

    def _check_words(self, element: ET.Element, place: str) -> None:
        """Attributes and text: URDF says everything by attributes, the rest may be a remark."""
        tag = element.tag
        known = [word.partition("=")[0] for word in _ATTRIBUTES.get(tag, "").split()]
        strange = [key for key in element.attrib if key not in known and not key.startswith("{")]
        for key in strange:
            what = f"{place}: unknown attribute"
            if tag in _STRICT:
                raise self.refuse(what, expected=", ".join(known), got=key)
            self._refuse_slip(key, known[:4], what, key)
            self.unknown.append(f"{key}= in <{tag}>")
        if strange and tag == "limit" and not {"lower", "upper"} & set(element.attrib):
            expected, got = "lower=... upper=...", ", ".join(strange)
            raise self.refuse(f"{place}: no lower and no upper", expected=expected, got=got)
        for text in (element.text, *(child.tail for child in element)):
            if not (words := (text or "").strip()):
                continue
            if tag in _STRICT or _ASSIGNMENT.search(words):
                expected = "attributes only, within a tag"
                raise self.refuse(f"{place} holds text", expected=expected, got=repr(words[:40]))
            self.unknown.append(f"text {words[:40]!r} in <{tag}>")
        self._check_numbers(element, place)

    def _check_numbers(self, element: ET.Element, place: str) -> None:
        """Write numbers as Python does."""
        largest = math.inf if element.tag == "limit" else LARGEST_NUMBER
        for word in _ATTRIBUTES.get(element.tag, "").split():
            key, _, count = word.partition("=")
            text = element.get(key)
            if count and text is not None:
                values = _numbers(text, int(count), f"{place} {key}", self.refuse, largest)
                element.set(key, " ".join(map(repr, values)))

    def _to_angles(self, origin: ET.Element, place: str) -> None:
        """Write the rotation of an origin as roll, pitch, yaw; equal to rounding."""
        if self.version == "1.0":
            expected = '<robot version="1.1">'
            raise self.refuse(f"{place}: quat_xyzw needs URDF 1.1", expected=expected)
        if origin.get("rpy") is not None:
            raise self.refuse(f"{place} has both rpy and quat_xyzw", expected="one of them")
        quaternion = np.array(_floats(origin, "quat_xyzw", ""))
        if np.linalg.norm(quaternion) < numerics.CLOSE:
            raise self.refuse(f"{place}: quat_xyzw is zero", expected="a rotation")
        del origin.attrib["quat_xyzw"]
        R = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix()
        origin.set("rpy", " ".join(repr(float(x)) for x in se3.roll_pitch_yaw(se3.pose(R))))


def _numbers(
    text: str, count: int, what: str, refuse: Refuse, largest: float = LARGEST_NUMBER
) -> list[float]:
    """Finite numbers of a text."""
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != count or "_" in text or not all(map(math.isfinite, values)):
        raise refuse(f"{what} is not {count} finite number(s)", got=repr(text))
    if any(abs(v) > largest for v in values):
        raise refuse(f"{what} is too large", expected=f"at most {largest:g}", got=repr(text))
    return values
