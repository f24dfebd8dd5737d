"""The frame of interest of a robot for which none is named,
and the joints that move it.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from functools import lru_cache
from typing import Any

import pinocchio as pin

from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.files.description import RobotDescription
from cartstiff.files.tree_building import find_frame

#: Legs of walking machines, as fingers of hands, are alike and hold no common body.
FEET = re.compile("foot|toe", re.IGNORECASE)
# Endings of names of tool frames, the most reliable first.
_TOOL_NAMES = tuple(
    re.compile(rf"(^|[^a-z0-9])({words})$", re.IGNORECASE)
    for words in (
        "tool0",
        "tcp|hand_tcp|tcp_link|tcp_frame|link_tcp",
        "ee|eef|ee_link|ee_frame|eef_link|link_eef|ee_gripper_link|ee_arm_link|effector|end_effector_link|tool_frame|tool_link|tool",
        "flange|flange_link|link_flange",
    )
)
# Frames that carry no tool: fingers are found by the joints on the way, sensors and rods
# of linkages by the frame's own name. Names are matched in lower case: a pattern that
# ignores case takes twice the time.
_FINGERS = re.compile(
    r"finger|thumb|knuckle|pinky|(?<![^_])(?:index|middle|ring|little)(?![^_])|jointgripper|"
    r"(?<![^_])gripper_.*(?:jaw|pad|tip|joint|inner|outer|motor)|(?<![^_])(?:jaw|claw)"
)
_SENSORS = re.compile(
    r"camera|sensor|collision|accelerometer|gyro|force_?torque|realsense|kinect|closed_?loop|"
    r"(?<![^_])(?:imu|ft|lidar|laser|range|optical|depth|rgb|led|marker|rod|crank)(?![^_])|"
    r"optical_frame|constraint"
)


# The results are cached: a model that is loaded repeatedly has the same names.
@lru_cache(4096)
def is_finger(name: str) -> bool:
    """Whether a joint or frame has the name of a part of a hand."""
    return _FINGERS.search(name.lower()) is not None


@lru_cache(4096)
def _is_sensor(name: str) -> bool:
    return _SENSORS.search(name.lower().replace("-", "_")) is not None


@lru_cache(4096)
def _tool_rank(name: str) -> int:
    """Index of a name in `_TOOL_NAMES`; their number for other names."""
    return next(
        (i for i, words in enumerate(_TOOL_NAMES) if words.search(name)), len(_TOOL_NAMES)
    )


# A link with at least so many joints before it is a hand if it branches into chains that
# are all at most so long and have no foot's name.
_MIN_WRIST_DEPTH, _MAX_FINGER_JOINTS = 4, 4


def hand_joints(robot: RobotDescription) -> set[str]:
    """Joints of fingers by the tree alone: all chains from one link at an arm's
    end are short.
    """
    model, names = robot.model, list(robot.model.names)
    supports = [set(support) for support in model.supports]
    called = names.__getitem__
    depths = [len({*map(called, some)} - robot.loose) - 1 for some in supports]
    found: set[str] = set()
    for wrist, depth in enumerate(depths):
        beyond = [j for j in range(wrist + 1, len(names)) if wrist in supports[j]]
        branches = [*map(model.parents.__getitem__, beyond)].count(wrist)
        if branches < 2 or depth < _MIN_WRIST_DEPTH:
            continue
        ends = {*map(called, beyond)}
        longest = max(map(depths.__getitem__, beyond)) - depth
        if longest <= _MAX_FINGER_JOINTS and not any(map(FEET.search, ends)):
            found |= ends
    return found


#: Name of a frame, and the joints on the way to it.
_End = tuple[str, list[str]]


def default_frame(robot: RobotDescription) -> tuple[str, str]:
    """The frame of interest of a robot for which none is named, and the words of a note.

    The first choice is a frame with the name of a tool frame, on a chain at least half as
    long as the longest whose joints can be used; the second the leaf frame at the end of
    the longest chain, fingers and sensors last. Frames that only free bodies carry are
    the last choice.
    """
    model = robot.model
    names, kinds = list(model.names), {pin.FrameType.BODY, pin.FrameType.OP_FRAME}
    chains = [[names[int(j)] for j in support if j] for support in model.supports]
    every = [(f.name, chains[f.parentJoint]) for f in model.frames if f.type in kinds]
    moving = [end for end in every if not robot.loose.issuperset(end[1])] or every
    if not (longest := _longest(moving)):
        raise InputError("robot has no movable joints")
    hands = hand_joints(robot)
    arms = [end for end in moving if _is_arm(*end, hands)]
    if (tool := _tool(arms, robot)) is not None:
        chosen, end = tool
        why = f"named as tools' frames are ({len(end)} joints)"
    else:
        # A hand alone has nothing but fingers.
        chosen, end = _last_leaf(arms or moving)
        why = f"a frame at the end of the longest chain ({len(end)} joints)"
        if len(end) < longest:
            why += " that is no finger"
    others = [name for name, chain in moving if chain == end and name != chosen]
    return chosen, (
        f"no frame was named: {chosen!r} is taken, {why}; others on the same link: "
        f"{', '.join(others) or 'none'}"
    )


def _longest(ends: Collection[_End]) -> int:
    return max((len(chain) for _, chain in ends), default=0)


def _is_arm(name: str, chain: list[str], hands: set[str]) -> bool:
    """Whether a frame is carried by joints, and belongs neither to a hand nor
    to a sensor.
    """
    is_hand = not hands.isdisjoint(chain) or any(map(is_finger, [*chain, name]))
    return bool(chain) and not is_hand and not _is_sensor(name)


def _tool(arms: list[_End], robot: RobotDescription) -> _End | None:
    """Frame with the most reliable name of a tool frame.

    Of several the one farthest out.
    """
    barred = frozenset[str]().union(*(o.joints for o in robot.obstacles))
    usable = _longest([end for end in arms if barred.isdisjoint(end[1])])
    least = (usable or _longest(arms)) / 2
    ranks = [
        (_tool_rank(name), -len(chain), i)
        for i, (name, chain) in enumerate(arms)
        if len(chain) >= least
    ]
    rank, _, i = min(ranks, default=(len(_TOOL_NAMES), 0, 0))
    return arms[i] if rank < len(_TOOL_NAMES) else None


def _last_leaf(ends: list[_End]) -> _End:
    """Last frame on the last joint of the longest chain: the deepest in the fixed joints.

    A foot on the same joints is preferred.
    """
    longest = _longest(ends)
    end = next(chain for _, chain in ends if len(chain) == longest)
    beside = [e for e in ends if len(e[1]) == longest and e[1][:-1] == end[:-1]]
    end = next((chain for name, chain in beside if FEET.search(name)), end)
    return [name for name, chain in ends if chain == end][-1], end


def named_elsewhere(model: Any, frame: str, where: str) -> bool:
    """Whether a joint elsewhere has the name of a link.

    Refuse a frame that does not exist.
    """
    named = [f for f in model.frames if f.name == frame]
    if not named:
        raise UnknownNameError(
            "frame", frame, [f.name for f in model.frames], where=where
        )
    taken = find_frame(model, frame)
    return any(
        f.parentJoint != taken.parentJoint or not f.placement.isApprox(taken.placement)
        for f in named
    )


def joints_to(robot: RobotDescription, frame: str) -> set[str]:
    """Return the joints between the root and a frame."""
    support = robot.model.supports[int(find_frame(robot.model, frame).parentJoint)]
    return {robot.model.names[int(j)] for j in support if j}


def joints_that_move(robot: RobotDescription, frame: str) -> set[str]:
    """Return the joints on the way to a frame, and those that loops and couplings
    tie to them.
    """
    moving = joints_to(robot, frame)
    groups = [closure.joints for closure in robot.closures]
    groups += [frozenset({name, rule[0]}) for name, rule in robot.followers.items()]
    while more := {j for group in groups if group & moving for j in group} - moving:
        moving |= more
    return moving
