"""What is taken where a file names nothing: the frame of interest, and the posture."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.loading.mjcf.facts import MjcfFacts
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.mechanisms.elastic import Note
from cartstiff.mechanisms.tree import KinematicTree
from cartstiff.mechanisms.tree_building import find_frame

__all__ = ["chosen_frame", "default_frame", "default_posture"]


# Last parts of the names that tools' frames have, the surest first.
_TOOLS = tuple(
    re.compile(rf"(^|[^a-z0-9])({words})$", re.IGNORECASE)
    for words in (
        "tool0", "tcp|hand_tcp|tcp_link|tcp_frame|link_tcp",
        "ee|eef|ee_link|ee_frame|eef_link|link_eef|ee_gripper_link|ee_arm_link|end_effector|"
        "end_effector_link|tool_frame|tool_link|tool",
        "flange|flange_link|link_flange",
    )
)  # fmt: skip
# What carries no tool: fingers by the joints on the way, sensors by the frame's own name.
_FINGERS = re.compile(
    r"finger|thumb|knuckle|(^|_)(index|middle|ring|little|pinky)(_|$)|jointgripper|"
    r"(^|_)gripper_.*(jaw|pad|tip|joint)|(^|_)(jaw|claw)",
    re.IGNORECASE,
)
_SENSORS = re.compile(
    r"camera|sensor|(^|_)(imu|ft|lidar|laser|optical|depth|rgb|led|marker)(_|$)|optical_frame",
    re.IGNORECASE,
)


def default_frame(model: Any, loose: Collection[str] = ()) -> tuple[str, str]:
    """Frame of interest where none is named, and the words that say so.

    A frame that is named as tools' frames are, on a chain at least half as long as the longest;
    else the leaf frame at the end of the longest chain, fingers and sensors last. Things that only
    `loose` joints carry are left out where there is anything else.
    """
    moving = [
        (len(model.supports[int(f.parentJoint)]) - 1, f)
        for f in model.frames
        if f.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    ]
    carried = [
        (count, f)
        for count, f in moving
        if {model.names[int(j)] for j in model.supports[int(f.parentJoint)] if j} - set(loose)
    ]
    moving = carried or moving
    longest = max((count for count, _ in moving), default=0)
    if longest == 0:
        raise InputError("robot has no movable joints")

    def on_finger(frame: Any) -> bool:
        joints = [model.names[int(j)] for j in model.supports[int(frame.parentJoint)]]
        return any(map(_FINGERS.search, [*joints, frame.name]))

    free = [(n, f) for n, f in moving if n and not on_finger(f) and not _SENSORS.search(f.name)]
    reach = max((count for count, _ in free), default=0)
    named = [
        (rank, -n, i)
        for rank, pattern in enumerate(_TOOLS)
        for i, (n, f) in enumerate(free)
        if 2 * n >= reach and pattern.search(f.name)
    ]
    if named:
        count, chosen = free[min(named)[2]]
        why = f"named as tools' frames are ({count} joints)"
    else:
        # A hand is all fingers; on the last joint the frame deepest in the tree of fixed joints.
        ends, count = (free, reach) if free else (moving, longest)
        joint = next(int(f.parentJoint) for n, f in ends if n == count)
        chosen = [f for _, f in ends if int(f.parentJoint) == joint][-1]
        why = f"a frame at the end of the longest chain ({count} joints)"
        if count < longest:
            why += " that is no finger"
    same = [f.name for _, f in moving if f.parentJoint == chosen.parentJoint]
    others = ", ".join(name for name in same if name != chosen.name) or "none"
    return chosen.name, (
        f"no frame was named: {chosen.name!r} is taken, {why}; others on the same link: {others}"
    )


def chosen_frame(
    description: RobotDescription, frame: str | None, where: str, notes: list[Note], who: str = ""
) -> str:
    """The frame that was named, or the default one; with a note where something was assumed."""
    model = description.model
    if frame is None:
        try:
            frame, words = default_frame(model, description.facts.loose)
        except InputError as error:
            raise error.at(where) from None
        notes.append(Note("default-frame", f"{who}{words}", {"frame": frame}))
        return frame
    known = [f.name for f in model.frames]
    if frame not in known:
        raise UnknownNameError("frame", frame, known, where=where)
    named = [f for f in model.frames if f.name == frame]
    taken = find_frame(model, frame)
    for other in named:
        apart = not other.placement.isApprox(taken.placement)
        if other.parentJoint != taken.parentJoint or apart:
            words = f"{who}a link and a joint elsewhere are named {frame!r}: the link is taken"
            notes.append(Note("ambiguous-frame", words, {"frame": frame}))
            break
    return frame


def default_posture(
    tree: KinematicTree,
    given: Mapping[str, float],
    where: str,
    otherwise: Mapping[str, float] | None = None,
    facts: MjcfFacts | None = None,
) -> Array:
    """Given positions; the others as `otherwise`, as a keyframe, or as the file is drawn.

    A URDF is drawn at zero. Limits that exclude that position are met in their middle. Names of
    `otherwise` need not be coordinates of the tree.
    """
    names = [c.name for c in tree.coordinates]
    drawn = {} if facts is None else facts.posture
    q = np.array([drawn.get(name, 0.0) for name in names])
    if facts is None or facts.keyframe is None:
        for j, c in enumerate(tree.coordinates):
            if not c.lower <= q[j] <= c.upper:
                q[j] = float(np.clip(0.5 * (c.lower + c.upper), -1e9, 1e9))
    for name, value in (otherwise or {}).items():
        if name in names:
            q[names.index(name)] = value
    for name, value in given.items():
        if name not in names:
            raise UnknownNameError("joint", name, names, where=f"{where}, key q")
        q[names.index(name)] = value
    return q
