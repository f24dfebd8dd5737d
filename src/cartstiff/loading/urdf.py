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
from functools import partial

import numpy as np
import pinocchio as pin

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.loading.plausible import large_lengths, turned
from cartstiff.loading.robot_facts import (
    FileClosure,
    FileSpring,
    Followers,
    Obstacle,
    RobotFacts,
    on_leaders,
)
from cartstiff.loading.yaml_file import LARGEST_NUMBER
from cartstiff.notes import Note

_MOST_JOINTS = 2000
#: Pinocchio's workspace takes a second to set up for 200 joints in a row, an hour for 2000.
MOST_MOVING = 200
_AXIAL_TYPES = {"revolute", "continuous", "prismatic"}
_JOINT_TYPES = {*_AXIAL_TYPES, "fixed", "floating", "planar"}
#: Makes an error with the file's name in front.
Refuse = Callable[..., InputError]

_VERSIONS = ("1.0", "1.1", "1.2")

# What Pinocchio is shown of a URDF; of the rest it might refuse what plays no part here.
_SHOWN = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic", "dynamics"),
}

INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

# Parts of a joint whose faults are the joint's own affair, as long as it does not move the frame.
_OWN = ("limit", "mimic", "dynamics")

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
    "joint": ("calibration", "safety_controller", "gazebo"),
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
    "dynamics": ("damping", "friction", "spring_stiffness", "spring_reference"),
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


def _placed(origin: ET.Element | None) -> se3.Array:
    """Pose of an `origin` that has been checked."""
    xyz, rpy = (
        [float(x) for x in ("0 0 0" if origin is None else origin.get(key, "0 0 0")).split()]
        for key in ("xyz", "rpy")
    )
    return se3.from_roll_pitch_yaw(xyz, rpy)


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
    beside = [child for child in root if child.tag not in _SHOWN["robot"]]
    of_joints = {joint.get("name"): joint.findall("gazebo") for joint in root.iter("joint")}
    notes, mechanical = _understood(root, refuse)
    robot = _Robot(root, refuse)
    links, joints = robot.links, robot.joints
    if not links:
        raise refuse("robot has no links")
    if len(joints) > _MOST_JOINTS:
        raise refuse("too many joints", expected=f"at most {_MOST_JOINTS}", got=str(len(joints)))
    moving = sum(joint.get("type") != "fixed" for joint in joints.values())
    if moving > MOST_MOVING:
        raise refuse("too many moving joints", expected=f"at most {MOST_MOVING}", got=str(moving))
    mimics: Followers = {}
    springs: dict[str, FileSpring] = {}
    planar_axes: dict[str, se3.Array] = {}
    for name, joint in joints.items():
        _hang(robot, name, joint)
        what = f"joint {name!r}"
        numbers_of(joint.find("origin"), ("xyz", "rpy"), 3, what, refuse)
        axis = numbers_of(joint.find("axis"), ("xyz",), 3, what, refuse)
        try:
            kind = _kind(joint, axis, what, refuse)
        except InputError as error:
            if joint.get("type") == "fixed":
                raise
            robot.leave_out(name, error)
            kind = "continuous"
            joint.set("type", kind)
            if (element := joint.find("axis")) is not None:
                joint.remove(element)
        if kind == "planar":
            notes += _plane(name, axis, planar_axes)
        parts = {tag: joint.findall(tag) for tag in _OWN}
        for part in (*parts["limit"], *parts["mimic"], *parts["dynamics"]):
            joint.remove(part)
        _limit(robot, name, joint, [])
        for tag, check in (("limit", _limit), ("mimic", partial(_mimic, mimics))):
            robot.attempt(name, check, robot, name, joint, parts[tag])
        extensions = [_texts(element) for element in of_joints.get(name, [])]
        robot.attempt(name, _dynamics, robot, name, joint, parts["dynamics"], extensions, springs)
        for tag in mechanical.get(name, ()):
            expected = f"in a mechanism file: springs: {{{name}: {{stiffness: ...}}}}"
            robot.leave_out(name, refuse(f"{what}: <{tag}> cannot be read", expected=expected))
    notes += _doubts(joints)
    _check_tree(robot)
    _leave_out_rings(robot, mimics)
    _fix_followers(joints, mimics)
    for name, element in links.items():
        if not _check_inertial(element, f"link {name!r}", refuse):
            words = f"link {name!r}: no body has this inertia; none counts, which vibrations feel"
            notes.append(Note("impossible-inertia", words, {"link": name}))
    closures, actuated = _beside(robot, beside, springs, mimics)
    springs, curved = on_leaders(springs, mimics)
    looped = {j for closure in closures for j in closure.joints if joints[j].get("type") != "fixed"}
    free = looped - springs.keys() - actuated
    return RobotFacts(
        springs=springs,
        passive=tuple(name for name in joints if name in free),
        actuated=tuple(name for name in joints if name in actuated),
        followers=mimics,
        closures=tuple(closures),
        planar_axes=planar_axes,
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


def _kind(joint: ET.Element, axis: list[float] | None, what: str, refuse: Refuse) -> str:
    """Type of a joint whose axis has a direction."""
    kind = joint.get("type")
    if kind not in _JOINT_TYPES:
        raise refuse(
            f"{what} has an unknown type",
            expected=", ".join(sorted(_JOINT_TYPES)),
            got=kind or "none",
        )
    if kind in (*_AXIAL_TYPES, "planar"):
        if axis is None and joint.find("axis") is not None:
            raise refuse(f"{what}: axis has no xyz", expected="<axis xyz=...>")
        if axis is not None and math.hypot(*axis) < numerics.CLOSE:
            raise refuse(f"{what} has a zero axis")
    return str(kind)


def _one(elements: list[ET.Element], what: str, refuse: Refuse) -> ET.Element | None:
    """The only one of some elements of a joint, its words checked; None where there is none."""
    if len(elements) > 1:
        raise refuse(f"{what} has several <{elements[0].tag}>", expected="one")
    for element in elements:
        _check_attributes(element, what, [], refuse)
        _check_text(element, f"{what}: {element.tag}", [], refuse)
        if len(element):
            got = f"<{element[0].tag}>"
            raise refuse(f"{what}: {element.tag} holds an element", expected="attributes", got=got)
    return elements[0] if elements else None


def _limit(robot: _Robot, name: str, joint: ET.Element, elements: list[ET.Element]) -> None:
    """Limits as Pinocchio needs them; without bounds there are none."""
    what, refuse = f"joint {name!r}", robot.refuse
    if joint.get("type") not in ("revolute", "prismatic"):
        return
    if (made := joint.find("limit")) is None:
        made = ET.SubElement(joint, "limit", effort="0", velocity="0", lower="-1e9", upper="1e9")
    element = _one(elements, what, refuse)
    given = {
        key: values[0]
        for key in ("lower", "upper", "effort", "velocity")
        if (values := numbers_of(element, (key,), 1, what, refuse, math.inf)) is not None
    }
    if given.keys() & {"lower", "upper"}:
        lower, upper = given.get("lower", 0.0), given.get("upper", 0.0)
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
    elements: list[ET.Element],
    extensions: list[dict[str, str]],
    springs: dict[str, FileSpring],
) -> None:
    """Damping, and the spring that simulators read beside it."""
    what, refuse = f"joint {name!r}", robot.refuse
    for values in (*extensions, *(element.attrib for element in elements)):
        _spring_of(robot, name, values, springs)
    if len(elements) > 1:
        raise refuse(f"{what} has several <dynamics>", expected="one")
    for element in elements:
        damping = numbers_of(element, ("damping",), 1, what, refuse)
        if damping is None or joint.get("type") not in _AXIAL_TYPES:
            continue
        if damping[0] < 0.0:
            raise refuse(
                f"{what}: damping is negative", expected="zero or more", got=f"{damping[0]:g}"
            )
        ET.SubElement(joint, "dynamics", damping=repr(damping[0]))


def _spring_of(
    robot: _Robot, name: str, values: Mapping[str, str], springs: dict[str, FileSpring]
) -> None:
    """The spring of a joint that a simulator's words say, where they do."""
    what, refuse = f"joint {name!r}", robot.refuse
    found = {}
    for key, text in values.items():
        for pattern in (_STIFFNESS, _REFERENCE):
            if pattern.fullmatch(key):
                holder = ET.Element(key, value=text.strip())
                numbers = numbers_of(holder, ("value",), 1, what, refuse)
                found[pattern] = 0.0 if numbers is None else numbers[0]
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
    mimics: Followers, robot: _Robot, name: str, joint: ET.Element, elements: list[ET.Element]
) -> None:
    """Which joint a joint follows."""
    what, refuse, joints = f"joint {name!r}", robot.refuse, robot.joints
    mimic = _one(elements, what, refuse)
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
    factor = numbers_of(mimic, ("multiplier",), 1, what, refuse) or [1.0]
    offset = numbers_of(mimic, ("offset",), 1, what, refuse) or [0.0]
    if joint.get("type") != "fixed":
        mimics[name] = leader, factor[0], offset[0]


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
        numbers_of(parts.get(key), ("value",), 3, "ball constraint", robot.refuse) or [0.0] * 3
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
    """A joint of SDF between two links: a ball is a closure, others are to be written as one.

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
    holder = ET.Element("pose", value=text)
    numbers = numbers_of(holder, ("value",), 6, "gazebo joint", robot.refuse) or [0.0] * 6
    T_a_b = se3.inverse(robot.at_zero(links[0])) @ robot.at_zero(links[1])
    points = [(T_a_b @ [*numbers[:3], 1.0])[:3].round(9).tolist(), numbers[:3]]
    if kind == "ball":
        return _point_closure(robot, links, points)
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
        k, a = (np.array([float(x) for x in row.split()]) for row in (text, _axis_of(joint)))
        return f"{float(k @ (a * a) / (a @ a)):g}"
    except ValueError:
        return "..."


def _row(values: Sequence[float]) -> str:
    return "[" + ", ".join(f"{x:.6g}" for x in values) + "]"


def _doubts(joints: Mapping[str, ET.Element]) -> list[Note]:
    """Notes of places that look like degrees or millimetres."""
    placed: dict[str, dict[str, list[float]]] = {"xyz": {}, "rpy": {}}
    for name, joint in joints.items():
        origin = joint.find("origin")
        for key, values in placed.items():
            if origin is not None and (text := origin.get(key)):
                values[f"{key} of joint {name}"] = [float(x) for x in text.split()]
    return [*turned(placed["rpy"]), *large_lengths(placed["xyz"])]


def _plane(name: str, axis: list[float] | None, axes: dict[str, se3.Array]) -> list[Note]:
    """Where a planar joint moves: across its axis; Pinocchio always takes z."""
    if axis is None:
        words = f"planar joint {name!r} has no axis: it moves across its frame's z axis"
        return [Note("planar-axis", words, {"joint": name})]
    if axis[0] or axis[1] or axis[2] < 0:
        axes[name] = np.array(axis) / math.hypot(*axis)
    return []


def _fix_followers(joints: dict[str, ET.Element], mimics: Followers) -> None:
    """Followers of a joint that stands still stand still at their offset."""
    standing = {name: 0.0 for name, joint in joints.items() if joint.get("type") == "fixed"}
    pending = dict(mimics)
    while ready := {n: m for n, m in pending.items() if m[0] in standing}:
        for name, (leader, factor, offset) in ready.items():
            standing[name] = factor * standing[leader] + offset
            _fix(joints[name], standing[name])
            del pending[name], mimics[name]


def _fix(joint: ET.Element, position: float) -> None:
    """Make a joint fixed at a position."""
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    along = np.array([float(x) for x in _axis_of(joint).split()])
    step = np.zeros(6)
    step[3 * (joint.get("type") == "prismatic") :][:3] = along / np.linalg.norm(along) * position
    T = _placed(origin) @ se3.exp(step)
    origin.set("xyz", " ".join(repr(float(x)) for x in T[:3, 3]))
    origin.set("rpy", " ".join(repr(float(x)) for x in se3.roll_pitch_yaw(T)))
    joint.set("type", "fixed")


def _axis_of(joint: ET.Element) -> str:
    axis = joint.find("axis")
    return "1 0 0" if axis is None else axis.get("xyz", "1 0 0")


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


def _check_inertial(link: ET.Element, what: str, refuse: Refuse) -> bool:
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


def _understood(root: ET.Element, refuse: Refuse) -> tuple[list[Note], dict[str, list[str]]]:
    """Take out what plays no part; refuse what looks like a slip of the pen, or stands twice.

    Returns the note that names what is not known, and by joint the elements that act on it.
    """
    version = root.attrib.pop("version", "1.0").strip()
    if version not in _VERSIONS:
        raise refuse("unknown version of URDF", expected=", ".join(_VERSIONS), got=repr(version))
    unknown: list[str] = []
    mechanical: dict[str, list[str]] = {}
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
                if element.tag != "joint" or child.tag not in _OWN:
                    pending.append((child, "" if element is root else f"{place}: "))
                continue
            element.remove(child)
            if element is root and _is_read_beside(child.tag):
                continue
            if element.tag == "joint" and _mechanical(child.tag) is not None:
                mechanical.setdefault(element.get("name", ""), []).append(child.tag)
                continue
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
            if element is not root and tag not in _OWN and tags.count(tag) > 1:
                raise refuse(f"{place} has several <{tag}>", expected="one")
        if element.tag == "origin" and element.get("quat_xyzw") is not None:
            _quaternion_to_angles(element, version, place, refuse)
    if not unknown:
        return [], mechanical
    names = list(dict.fromkeys(unknown))
    shown_names = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
    words = f"what is not URDF plays no part: {shown_names}"
    return [Note("ignored", words, {"elements": names})], mechanical


def _is_read_beside(tag: str) -> bool:
    """Whether an element beside links and joints is one that `_beside` looks at."""
    return tag.rpartition("}")[2] in ("joint", "frame") or _mechanical(tag) is not None


def _check_attributes(element: ET.Element, place: str, unknown: list[str], refuse: Refuse) -> None:
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


def _check_text(element: ET.Element, place: str, unknown: list[str], refuse: Refuse) -> None:
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


def _refuse_slip(name: str, known: tuple[str, ...], what: str, got: str, refuse: Refuse) -> None:
    close = get_close_matches(name.lower(), known, n=1, cutoff=_ALIKE)
    if close:
        raise refuse(what, expected=close[0], got=got)


def _quaternion_to_angles(origin: ET.Element, version: str, place: str, refuse: Refuse) -> None:
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
    refuse: Refuse,
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
