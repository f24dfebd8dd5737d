"""What is taken where a file names nothing: the frame of interest, and the posture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.loading.mjcf_facts import MjcfFacts
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.mechanisms.elastic import Note
from cartstiff.mechanisms.tree import KinematicTree
from cartstiff.mechanisms.tree_building import find_frame

__all__ = ["chosen_frame", "default_frame", "default_posture"]


def default_frame(model: Any) -> tuple[str, str]:
    """Leaf frame at the end of the longest chain, and the words that say so."""
    supports = {j: len(model.supports[j]) - 1 for j in range(model.njoints)}
    bodies = [f for f in model.frames if f.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME)]
    longest = max((supports[int(f.parentJoint)] for f in bodies), default=0)
    if longest == 0:
        raise InputError("robot has no movable joints")
    ends = [f for f in bodies if supports[int(f.parentJoint)] == longest]
    # Among the frames on the last joint, the one deepest in the file's tree of fixed joints.
    joint = int(ends[0].parentJoint)
    same = [f for f in ends if int(f.parentJoint) == joint]
    names = [f.name for f in same]
    chosen = same[-1]
    others = ", ".join(n for n in names if n != chosen.name) or "none"
    return chosen.name, (
        f"no frame was named: {chosen.name!r} is taken, a frame at the end of the longest chain "
        f"({longest} joints); others on the same link: {others}"
    )


def chosen_frame(
    description: RobotDescription, frame: str | None, where: str, notes: list[Note], who: str = ""
) -> str:
    """The frame that was named, or the default one; with a note where something was assumed."""
    model = description.model
    if frame is None:
        frame, words = default_frame(model)
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
