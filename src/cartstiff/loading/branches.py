"""Joints beside the chain to the frame of interest: what does not act,
and loops left open.

A tree that a drawing program exports from a parallel machine has its loops cut. The chain
to one frame is then one leg, and its answer is that of a serial arm.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.errors import listed
from cartstiff.loading.assembly import Part
from cartstiff.loading.frames import FEET, hand_joints, is_finger
from cartstiff.mechanisms.tree_building import find_frame
from cartstiff.notes import Note

# A note lists six names and counts the rest.
_listed = partial(listed, most=6)
#: Two equal chains of more joints are arms of one body.
_MOST_OF_PAIR = 3
#: Fewest joints that make chains comparable; so many without a distance between them are
#: one, too.
_FEWEST_JOINTS, _FEWEST_WITHOUT_LENGTH = 2, 4


def beside(part: Part) -> Part:
    """Add notes on joints that do not act on the frame and might be expected to."""
    if part.number:
        return part.noting(idle_springs(part.idle, part.frame, part.says("")))
    robot, frame, kept = part.robot, part.frame, part.tree.names
    # Nobody expects of a hand's joints that they hold the frame.
    hands = hand_joints(robot)
    names = [
        n for n in list(robot.model.names)[1:] if n not in hands and not is_finger(n)
    ]
    away = [n for n in names if n not in kept and n not in robot.followers]
    own = (n for n in away if n in robot.springs and n not in part.idle)
    notes = idle_springs([*part.idle, *own], frame)
    if FEET.search(frame) or "hand" in str(robot.model.name).lower():
        return part.noting(notes)
    chains = [
        chain
        for chain in equal_chains(
            robot.model, int(find_frame(robot.model, frame).parentJoint)
        )
        if {*names}.issuperset(chain) and chain[0] not in kept
    ]
    joints = [name for chain in chains for name in chain]
    is_short_pair = len(chains) == 1 and len(joints) <= _MOST_OF_PAIR
    driven = [name for name in away if name in robot.actuated]
    undriven = [n for n in kept if n in names and n not in robot.actuated]
    if len(chains) >= 2 or (is_short_pair and {*away} == {*joints}):
        words = f"{frame!r} is at the end of one of {len(chains) + 1} equal chains"
    elif 0 < len(driven) <= len(undriven):
        joints = driven
        words = f"no actuator drives {_listed(undriven)} on the chain to {frame!r}"
    else:
        return part.noting(notes)
    words += (
        f", and joints beside it do not act: {_listed(joints)}. If they hold the same "
        "body in "
        "the real machine, this is the answer of one leg alone: name its loops under "
        "'closures' in a mechanism file of kind closed-chain"
    )
    values = {"frame": frame, "joints": joints}
    return part.noting([*notes, Note("open-loops", words, values)])


def idle_springs(joints: Sequence[str], frame: str, place: str = "") -> list[Note]:
    """Return a note that names joints with springs that do not move the frame;
    none without any.
    """
    if not joints:
        return []
    message = (
        f"{len(joints)} joints with springs are not on the chain to {frame!r} and "
        "do not act"
    )
    if len(joints) == 1:
        message = (
            f"1 joint with a spring is not on the chain to {frame!r} and does not act"
        )
    words = f"{place}{message}: {_listed(joints)}"
    return [Note("idle-springs", words, {"joints": list(joints)})]


def equal_chains(model: Any, joint: int) -> list[list[str]]:
    """Return the chains beside the one to a joint that are equal to it, joint by joint.

    They begin on one link. Chains are equal if hinges and slides follow each other in the
    same order at the same distances, as far as the shorter one goes. Where several links
    have equal chains, those of the link with the most of them are returned.

    Parameters
    ----------
    model : pinocchio.Model
        The robot.
    joint : int
        The joint at the end of the chain.
    """
    support = [int(j) for j in model.supports[joint]]
    best: list[list[str]] = []
    for place, start in enumerate(support[:-1]):
        own = support[place + 1 :]
        found = []
        for child in (int(j) for j in model.children[start]):
            if child == own[0]:
                continue
            paths = [
                [int(j) for j in model.supports[end] if j >= child]
                for end in range(child, model.njoints)
                if child in model.supports[end] and not len(model.children[end])
            ]
            if equal := [path for path in paths if _are_equal(model, own, path)]:
                found.append([str(model.names[j]) for j in max(equal, key=len)])
        best = max(best, found, key=len)
    return best


def _are_equal(model: Any, one: Sequence[int], other: Sequence[int]) -> bool:
    """Whether the joints of two chains are of the same kinds at the same distances."""
    count = min(len(one), len(other))
    if count < _FEWEST_JOINTS:
        return False
    kinds = [[_kind(model.joints[j]) for j in chain[:count]] for chain in (one, other)]
    sizes = np.array(
        [
            [np.linalg.norm(model.jointPlacements[j].translation) for j in chain[1:count]]
            for chain in (one, other)
        ]
    )
    largest = float(sizes.max())
    differ = np.abs(sizes[0] - sizes[1]) > numerics.LOST_ERROR * largest
    has_shape = (
        largest > numerics.NEGLIGIBLE_DIFFERENCE or count >= _FEWEST_WITHOUT_LENGTH
    )
    return kinds[0] == kinds[1] and has_shape and not differ.any()


def _kind(joint: Any) -> str:
    """Kind of a joint, without the direction of its axis."""
    name = str(joint.shortname()).removeprefix("JointModel")
    return re.sub(
        "^(R|P)((UB)?[XYZ]|(evolute|rismatic)(Unbounded)?Unaligned)$", r"\1", name
    )
