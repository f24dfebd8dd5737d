"""What is taken where a file names nothing: the frame of interest, and the posture."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import InputError, UnknownNameError, check_name
from cartstiff.geometry.se3 import SWAP
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.loading.robot_facts import RobotFacts
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.tree import KinematicTree
from cartstiff.mechanisms.tree_building import find_frame
from cartstiff.notes import Note
from cartstiff.numerics import NEAR, is_regular

# Last parts of the names that tools' frames have, the surest first.
_TOOLS = tuple(
    re.compile(rf"(^|[^a-z0-9])({words})$", re.IGNORECASE)
    for words in (
        "tool0",
        "tcp|hand_tcp|tcp_link|tcp_frame|link_tcp",
        "ee|eef|ee_link|ee_frame|eef_link|link_eef|ee_gripper_link|ee_arm_link|end_effector|"
        "end_effector_link|tool_frame|tool_link|tool",
        "flange|flange_link|link_flange",
    )
)
# What carries no tool: fingers by the joints on the way, sensors by the frame's own name. Names in
# small letters: a pattern that ignores case takes twice the time.
_FINGERS = re.compile(
    r"finger|thumb|knuckle|(?<![^_])(?:index|middle|ring|little|pinky)(?![^_])|jointgripper|"
    r"(?<![^_])gripper_.*(?:jaw|pad|tip|joint|inner|outer|motor)|(?<![^_])(?:jaw|claw)"
)
_SENSORS = re.compile(
    r"camera|sensor|accelerometer|gyro|"
    r"(?<![^_])(?:imu|ft|lidar|laser|range|optical|depth|rgb|led|marker)(?![^_])|optical_frame"
)


# Who loads a model again and again asks for the same names.
_remembered = lru_cache(4096)


@_remembered
def _is_finger(name: str) -> bool:
    return _FINGERS.search(name.lower()) is not None


@_remembered
def _is_sensor(name: str) -> bool:
    return _SENSORS.search(name.lower()) is not None


@_remembered
def _rank(name: str) -> int:
    """Place among `_TOOLS`; their number for other names."""
    return next((i for i, words in enumerate(_TOOLS) if words.search(name)), len(_TOOLS))


def default_frame(model: Any, facts: RobotFacts | None = None) -> tuple[str, str]:
    """Frame of interest where none is named, and the words that say so.

    A frame that is named as tools' frames are, on a chain at least half as long as the longest
    whose joints can be used; else the leaf frame at the end of the longest chain, fingers and
    sensors last. Things that only free bodies carry are left out where there is anything else.
    """
    facts = facts or RobotFacts()
    loose, barred = facts.loose, frozenset[str]().union(*(o.joints for o in facts.obstacles))
    # By joint: how many carry it, whether a finger does, and whether anything that is not loose.
    count, of_finger, carries, bars = [0], [False], [False], [False]
    names, parents = list(model.names), model.parents.tolist()
    for name, parent in zip(names[1:], parents[1:], strict=True):
        count.append(count[parent] + 1)
        of_finger.append(of_finger[parent] or _is_finger(name))
        carries.append(carries[parent] or name not in loose)
        bars.append(bars[parent] or name in barred)
    kinds = {pin.FrameType.BODY, pin.FrameType.OP_FRAME}
    every = [(count[j := f.parentJoint], f.name, j) for f in model.frames if f.type in kinds]
    moving = [end for end in every if carries[end[2]]] or every
    longest = max((n for n, *_ in moving), default=0)
    if longest == 0:
        raise InputError("robot has no movable joints")

    free = [
        (n, name, j)
        for n, name, j in moving
        if n and not of_finger[j] and not _is_finger(name) and not _is_sensor(name)
    ]
    reach = max((n for n, *_ in free), default=0)
    usable = max((n for n, _, j in free if not bars[j]), default=reach)
    named = [
        (rank, -n, i)
        for i, (n, name, _) in enumerate(free)
        if 2 * n >= usable and (rank := _rank(name)) < len(_TOOLS)
    ]
    if named:
        joints, chosen, joint = free[min(named)[2]]
        why = f"named as tools' frames are ({joints} joints)"
    else:
        # A hand is all fingers; on the last joint the frame deepest in the tree of fixed joints.
        ends, joints = (free, reach) if free else (moving, longest)
        joint = next(j for n, _, j in ends if n == joints)
        chosen = [name for _, name, j in ends if j == joint][-1]
        why = f"a frame at the end of the longest chain ({joints} joints)"
        if joints < longest:
            why += " that is no finger"
    same = [name for _, name, j in moving if j == joint]
    others = ", ".join(name for name in same if name != chosen) or "none"
    return chosen, (
        f"no frame was named: {chosen!r} is taken, {why}; others on the same link: {others}"
    )


def chosen_frame(
    description: RobotDescription, frame: str | None, where: str, notes: list[Note], who: str = ""
) -> str:
    """The frame that was named, or the default one; with a note where something was assumed."""
    model = description.model
    if frame is None:
        try:
            frame, words = default_frame(model, description.facts)
        except InputError as error:
            raise error.at(where) from None
        notes.append(Note("default-frame", f"{who}{words}", {"frame": frame}))
        return frame
    named = [f for f in model.frames if f.name == frame]
    if not named:
        raise UnknownNameError("frame", frame, [f.name for f in model.frames], where=where)
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
    values: Mapping[str, float],
    where: str,
    otherwise: Mapping[str, float] | None = None,
    facts: RobotFacts | None = None,
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
    for name, value in values.items():
        check_name("joint", name, names, f"{where}, key q")
        q[names.index(name)] = value
    return q


# A posture for an arm whose file names none: zero is singular for nearly every industrial arm.
#
# Candidates are points of a low-discrepancy sequence (Kronecker's with the generalised golden
# ratio: the same every time) around zero, in a quarter, half and all of the joints' ranges. Each
# is judged by the ratio of the smallest to the largest singular value of the body Jacobian,
# lengths in units of the characteristic length at zero.

# Candidates of each size, and the shares of the joints' ranges that they are spread over: a larger
# one only where the smaller have none that will do.
_COUNT, _SHARES = 32, (0.25, 0.5, 1.0)
# So many are looked at together, the nearest first: mostly one of the first will do.
_LOOKS = 16
# Of the candidates with twice the ratio that counts as near a singularity the one closest to zero
# is taken.
_ENOUGH = 2.0 * NEAR
# Candidates are rounded so that they can be typed (rad; lengths in shares of their range).
_STEP = 0.05


def regular_posture(chain: Chain, q: Array) -> tuple[Array, list[Note]]:
    """A regular posture (n,) in place of q where q is near a singularity, and a note that says so.

    For arms with six or more joints; q stays where none of the candidates is better.

    Parameters
    ----------
    chain : Chain
        A serial chain.
    q : ndarray (n,)
        Zero, or as near to it as the limits allow.
    """
    free = np.array([j not in chain.virtual for j in range(q.size)], bool)
    if free.sum() < 6:
        return q, []
    posture = chain.at(q)
    rows = np.repeat([1.0, 1.0 / posture.length], 3)[:, None]
    sizes = posture.coordinate_lengths

    def ratios(jacobians: Array) -> Array:
        return numerics.ratios((jacobians * rows * sizes)[..., free])

    at_zero = float(ratios(posture.motion.jacobian))
    if at_zero > NEAR:
        return q, []
    best, largest = q, max(NEAR, float(at_zero))
    for few in _candidates(chain, q, sizes, free).reshape(-1, _LOOKS, q.size):
        ratio = ratios(_jacobians(chain, few))
        i = int(np.argmax(ratio >= _ENOUGH if ratio.max() >= _ENOUGH else ratio))
        if ratio[i] > largest:
            best, largest = few[i], float(ratio[i])
        if largest >= _ENOUGH:
            break
    if best is q:
        return q, []
    conditions = {
        "condition": 1.0 / largest,
        "condition_at_zero": 1.0 / float(at_zero) if is_regular([1.0, at_zero]) else None,
    }
    zero = "singular" if conditions["condition_at_zero"] is None else "near a singularity"
    words = ", ".join(
        f"{c.name} {value:.4g}" for c, value in zip(chain.coordinates, best, strict=True)
    )
    return best, [
        Note(
            "default-posture",
            f"no posture was given, and zero is {zero}: a regular one is taken, {words} "
            f"(condition of the scaled Jacobian {conditions['condition']:.3g})",
            {"q": best.tolist(), **conditions},
        )
    ]


def _jacobians(chain: Chain, postures: Array) -> Array:
    """Body Jacobians (k, 6, n) at postures (k, n): those of `Chain.at`, and nothing else."""
    tree, body = chain.tree, chain.body
    joints = postures if tree.mimic is None else postures @ tree.mimic.T + tree.offset
    with tree.workspace() as data:
        local = [pin.computeJointJacobian(tree.model, data, row, body.joint) for row in joints]
    jacobian: Array = (pin.SE3(body.T_j_f).toActionMatrixInverse() @ np.array(local))[:, SWAP]
    return jacobian if tree.mimic is None else jacobian @ tree.mimic


@cache
def _spread(n: int) -> Array:
    """Points (`_COUNT`, n) of the sequence, from -1 to 1."""
    # The root g > 1 of g^(n+1) = g + 1: its powers are as badly approximated as can be.
    g = 2.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (n + 1))
    steps = np.outer(np.arange(1, _COUNT + 1), g ** -np.arange(1.0, n + 1))
    points: Array = 2.0 * np.mod(0.5 + steps, 1.0) - 1.0
    return points


def _candidates(chain: Chain, q: Array, sizes: Array, free: Array) -> Array:
    """Postures (k, n) within the limits, by share and distance; what gives stays where it is."""
    n = q.size
    lower, upper, lengths = map(
        np.array, zip(*((c.lower, c.upper, c.is_length) for c in chain.coordinates), strict=True)
    )
    reach = np.where(lengths, sizes, np.pi)
    low, high = np.maximum(lower, q - reach), np.minimum(upper, q + reach)
    u = _spread(n)
    sides = np.where(u < 0, q - low, high - q)
    steps = np.concatenate([share * u * sides for share in _SHARES])
    step = np.where(lengths, _STEP * (high - low), _STEP)
    rounded = np.round(steps / np.where(step > 0, step, 1.0)) * step
    # Twelve digits: 0.15, and not 0.15000000000000002.
    postures: Array = np.clip(np.round(q + rounded, 12), low, high)
    postures = np.where(free, postures, q)
    away = np.linalg.norm((postures - q) / sizes, axis=1)
    return postures[np.lexsort((away, np.repeat(_SHARES, _COUNT)))]
