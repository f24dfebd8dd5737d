"""Build elastic mechanisms from checked mechanism files and from robot descriptions.

This module chooses the frame of interest and the posture where a file names none, and makes the
parts that every kind of mechanism has: trees, springs, lines, payloads, postures.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from cartstiff import numerics
from cartstiff.arrays import Array, fixed
from cartstiff.errors import (
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
    check_name,
    one_line,
)
from cartstiff.geometry import se3
from cartstiff.loading.branches import FEET, idle_springs, notes_on_branches
from cartstiff.loading.catalogue import example_robot
from cartstiff.loading.plausible import large_strains
from cartstiff.loading.robot_description import (
    RobotDescription,
    described_text,
    read_robot_description,
)
from cartstiff.loading.robot_facts import (
    POSITION_ACTUATORS,
    FileClosure,
    FileSpring,
    Followers,
    Obstacle,
    RobotFacts,
    on_leaders,
    to_root,
    turned_axes,
)
from cartstiff.loading.ros import ROBOT_FILES, Ros, described_robot, is_description_name
from cartstiff.loading.schema import (
    BeamModel,
    ClosedChainFile,
    ClosureModel,
    FlexibleModel,
    JointSpringModel,
    LineModel,
    PoseModel,
    SerialFile,
    check_limits,
    one_each,
    pose_of,
)
from cartstiff.mechanisms.chain import Chain, Closure
from cartstiff.mechanisms.closures import ReferencePosture
from cartstiff.mechanisms.contract import Coordinate
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.flexible_links import Give
from cartstiff.mechanisms.given_springs import rest_of_turns
from cartstiff.mechanisms.leg_shapes import PlacedLeg
from cartstiff.mechanisms.platform import LegLimits, Platform, Struts
from cartstiff.mechanisms.tree import FixedFrame, KinematicTree
from cartstiff.mechanisms.tree_building import extended, find_frame, merged, plain_tree
from cartstiff.notes import Note, assumed_stiffness, held_by_lines, table_as_read
from cartstiff.numerics import NEAR_SINGULARITY, ZERO_SHARE, is_regular
from cartstiff.potentials.beams import Beam, Section
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.coupled_joints import CoupledJointSprings
from cartstiff.potentials.flexure_struts import Flexure, FlexureStruts
from cartstiff.potentials.line_springs import LineSprings, line_geometry
from cartstiff.potentials.loads import DeadForce
from cartstiff.potentials.mounted_struts import Mount, MountedStruts
from cartstiff.potentials.springs import (
    CoupledSprings,
    JointSprings,
    PolynomialLaw,
    SpringLaw,
    TabulatedLaw,
)
from cartstiff.units import SI, Units, convert_length, own_stiffness

if TYPE_CHECKING:
    from cartstiff.loading.leg_schema import LegModel, ParallelFile
    from cartstiff.loading.platform_schema import (
        LegJointsModel,
        PlatformFile,
        SpringsFile,
    )

# Endings of names of tool frames, the most reliable first.
_TOOL_NAMES = tuple(
    re.compile(rf"(^|[^a-z0-9])({words})$", re.IGNORECASE)
    for words in (
        "tool0",
        "tcp|hand_tcp|tcp_link|tcp_frame|link_tcp",
        "ee|eef|ee_link|ee_frame|eef_link|link_eef|ee_gripper_link|ee_arm_link|effector|"
        "end_effector_link|tool_frame|tool_link|tool",
        "flange|flange_link|link_flange",
    )
)
# Frames that carry no tool: fingers are found by the joints on the way, sensors and rods of
# linkages by the frame's own name. Names are matched in lower case: a pattern that ignores case
# takes twice the time.
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
def _is_finger(name: str) -> bool:
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


# A link with at least so many joints before it is a hand if it branches into chains that are all at
# most so long and have no foot's name.
_MIN_WRIST_DEPTH, _MAX_FINGER_JOINTS = 4, 4


def _hand_joints(model: Any, free_joints: Collection[str]) -> set[str]:
    """Joints of fingers by the tree alone: all chains from one link at an arm's end are short."""
    names = list(model.names)
    depths = [
        sum(names[j] not in free_joints for j in support) - 1
        for support in model.supports
    ]
    found: set[str] = set()
    for wrist, depth in enumerate(depths):
        beyond = [
            j
            for j, support in enumerate(model.supports)
            if j > wrist and wrist in support
        ]
        branches = sum(model.parents[j] == wrist for j in beyond)
        if branches < 2 or depth < _MIN_WRIST_DEPTH:
            continue
        ends = {names[j] for j in beyond}
        is_short = max(depths[j] for j in beyond) - depth <= _MAX_FINGER_JOINTS
        if is_short and not any(map(FEET.search, ends)):
            found |= ends
    return found


def default_frame(model: Any, facts: RobotFacts | None = None) -> tuple[str, str]:
    """Return the frame of interest of a robot for which none is named, and the words of a note.

    The first choice is a frame with the name of a tool frame, on a chain at least half as long as
    the longest whose joints can be used; the second the leaf frame at the end of the longest chain,
    fingers and sensors last. Frames that only free bodies carry are the last choice.
    """
    facts = facts or RobotFacts()
    free_joints, barred = (
        facts.loose,
        frozenset[str]().union(*(o.joints for o in facts.obstacles)),
    )
    names, kinds = list(model.names), {pin.FrameType.BODY, pin.FrameType.OP_FRAME}
    chains = [[names[int(j)] for j in support if j] for support in model.supports]
    every = [(f.name, chains[f.parentJoint]) for f in model.frames if f.type in kinds]
    moving = [end for end in every if not free_joints.issuperset(end[1])] or every
    longest = max((len(chain) for _, chain in moving), default=0)
    if longest == 0:
        raise InputError("robot has no movable joints")

    hands = _hand_joints(model, free_joints)
    arms = [
        (name, chain)
        for name, chain in moving
        if chain
        and hands.isdisjoint(chain)
        and not any(map(_is_finger, [*chain, name]))
        and not _is_sensor(name)
    ]
    longest_arm = max((len(chain) for _, chain in arms), default=0)
    usable = max(
        (len(chain) for _, chain in arms if barred.isdisjoint(chain)), default=longest_arm
    )
    tools = [
        (rank, -len(chain), i)
        for i, (name, chain) in enumerate(arms)
        if 2 * len(chain) >= usable and (rank := _tool_rank(name)) < len(_TOOL_NAMES)
    ]
    if tools:
        chosen, end = arms[min(tools)[2]]
        why = f"named as tools' frames are ({len(end)} joints)"
    else:
        # A hand alone has nothing but fingers. Of the frames on the last joint the last is taken:
        # it is the deepest in the tree of fixed joints.
        ends, joints = (arms, longest_arm) if arms else (moving, longest)
        end = next(chain for _, chain in ends if len(chain) == joints)
        feet = (
            chain for name, chain in ends if chain[:-1] == end[:-1] and FEET.search(name)
        )
        end = next(feet, end)
        chosen = [name for name, chain in ends if chain == end][-1]
        why = f"a frame at the end of the longest chain ({joints} joints)"
        if joints < longest:
            why += " that is no finger"
    others = (
        ", ".join(name for name, chain in moving if chain == end and name != chosen)
        or "none"
    )
    return chosen, (
        f"no frame was named: {chosen!r} is taken, {why}; others on the same link: {others}"
    )


def chosen_frame(
    description: RobotDescription, frame: str | None, notes: list[Note], leg: str = ""
) -> str:
    """Return the named frame or the default one, and add a note on what was assumed."""
    model, prefix = description.model, f"{leg}: " if leg else ""
    if frame is None:
        try:
            frame, words = default_frame(model, description.facts)
        except InputError as error:
            raise error.moved_to(leg) from None
        notes.append(Note("default-frame", f"{prefix}{words}", {"frame": frame}))
        return frame
    named = [f for f in model.frames if f.name == frame]
    if not named:
        raise UnknownNameError("frame", frame, [f.name for f in model.frames], where=leg)
    taken = find_frame(model, frame)
    for other in named:
        is_elsewhere = not other.placement.isApprox(taken.placement)
        if other.parentJoint != taken.parentJoint or is_elsewhere:
            words = f"{prefix}a link and a joint elsewhere are named {frame!r}: the link is taken"
            notes.append(Note("ambiguous-frame", words, {"frame": frame}))
            break
    return frame


def default_posture(
    tree: KinematicTree,
    values: Mapping[str, float],
    facts: RobotFacts,
    otherwise: Mapping[str, float] | None = None,
) -> Array:
    """Default coordinates (n,): given values, then `otherwise`, a keyframe, the file's own posture.

    The own posture of a URDF is zero; where the limits exclude it, the middle of the limits is
    taken. Names in `otherwise` need not be coordinates of the tree.
    """
    _check_joints(values, tree.names, "key q")
    q, given = np.zeros(tree.n), {**(otherwise or {}), **values}
    for j, c in enumerate(tree.coordinates):
        q[j] = facts.posture.get(c.name, 0.0)
        if facts.keyframe is None and not c.lower <= q[j] <= c.upper:
            q[j] = np.clip(0.5 * (c.lower + c.upper), -1e9, 1e9)
        q[j] = given.get(c.name, q[j])
    return q


# An arm whose file names no posture needs a regular one: zero is singular for nearly every
# industrial arm.
#
# The candidates are points of a low-discrepancy sequence (Kronecker's with the generalised golden
# ratio: the same every time) around zero, in a quarter, half and all of the joints' ranges. The
# measure is the ratio of the smallest to the largest singular value of the body Jacobian, lengths
# in units of the characteristic length at zero.

# Number of candidates per share of the joints' ranges. A larger share is searched only where the
# smaller ones have no candidate that is regular enough.
_CANDIDATES_PER_SHARE, _RANGE_SHARES = 32, (0.25, 0.5, 1.0)
# Number of candidates that are computed at once, the nearest to zero first.
_CANDIDATES_AT_ONCE = 16
# The candidate closest to zero with at least this ratio is taken: twice the ratio that counts as
# near a singularity.
_REGULAR_RATIO = 2.0 * NEAR_SINGULARITY
# An arm that at zero is at most this far below its base, in characteristic lengths, is taken to
# stand on a floor.
_MAX_DEPTH_ON_FLOOR = 0.1
# Candidates are rounded so that they can be typed (rad; lengths in shares of their range).
_ROUNDING_STEP = 0.05


def regular_posture(chain: Chain, q: Array, *, alone: bool) -> tuple[Array, list[Note]]:
    """Return a regular posture (n,) in place of a nearly singular q, with a note that says so.

    q is returned where no candidate is better, and for arms with fewer than six joints: the note
    names a regular posture then. An arm that is not below its base at q, or whose joints rise from
    the base before they are below it, stays above the base.

    Parameters
    ----------
    chain : Chain
        A serial chain.
    q : ndarray (n,)
        Zero, or as near to it as the limits allow.
    alone : bool
        Whether the robot has no other arm, so that its base is on the floor and not on a torso.
    """
    free = np.array([j not in chain.virtual for j in range(q.size)], bool)
    if free.sum() < 2:
        return q, []
    posture = chain.at(q)
    rows = np.repeat([1.0, 1.0 / posture.length], 3)[:, None]
    sizes = posture.coordinate_lengths

    def ratios(jacobians: Array) -> Array:
        return numerics.ratios((jacobians * rows * sizes)[..., free])

    at_zero = float(ratios(posture.motion.jacobian))
    if at_zero > NEAR_SINGULARITY:
        return q, []
    candidates = _candidates(chain, q, sizes, free).reshape(
        -1, _CANDIDATES_AT_ONCE, q.size
    )

    def search(floor: float) -> tuple[Array, float]:
        best, largest = q, max(NEAR_SINGULARITY, at_zero)
        for few in candidates:
            ratio = ratios(np.array([chain.at(one).motion.jacobian for one in few]))
            if np.isfinite(floor):
                ratio = ratio * [_heights(chain, one).min() > floor for one in few]
            enough = ratio >= _REGULAR_RATIO
            i = int(np.argmax(enough if enough.any() else ratio))
            if ratio[i] > largest:
                best, largest = few[i], float(ratio[i])
            if largest >= _REGULAR_RATIO:
                break
        return best, largest

    best, largest = q, NEAR_SINGULARITY
    heights, depth = _heights(chain, q), _MAX_DEPTH_ON_FLOOR * posture.length
    lowest, first = heights.min(), next((z for z in heights if abs(z) > depth), 0.0)
    if lowest > -depth or (alone and first > 0.0):  # the arm stands on a floor
        floor = min(lowest, 0.0) if lowest > -depth else 0.0
        best, largest = search(floor - numerics.NEGLIGIBLE_DIFFERENCE)
    if best is q:
        best, largest = search(-np.inf)
    if best is q:
        return q, []
    words = ", ".join(
        f"{c.name} {value:.4g}" for c, value in zip(chain.coordinates, best, strict=True)
    )
    if free.sum() < 6:
        words = f"no posture was given, and zero is singular: a regular one is {words}"
        note = Note("zero-singular", words, {"q": best.tolist()})
        return q, [] if is_regular([1.0, at_zero]) else [note]
    conditions = {
        "condition": 1.0 / largest,
        "condition_at_zero": 1.0 / at_zero if is_regular([1.0, at_zero]) else None,
    }
    zero = "singular" if conditions["condition_at_zero"] is None else "near a singularity"
    return best, [
        Note(
            "default-posture",
            f"no posture was given, and zero is {zero}: a regular one is taken, {words} "
            f"(condition of the scaled Jacobian {conditions['condition']:.3g})",
            {"q": best.tolist(), **conditions},
        )
    ]


def _heights(chain: Chain, q: Array) -> Array:
    """Heights of the joints on the way to the body, and of the body, over the base."""
    state, joints = chain.tree.at(q), chain.tree.support(chain.body.joint)
    return np.append(state.joint_poses(joints)[:, 2, 3], state.pose(chain.body)[2, 3])


@cache
def _sequence(n: int) -> Array:
    """Points (`_CANDIDATES_PER_SHARE`, n) of the sequence, from -1 to 1."""
    # The root g > 1 of g^(n+1) = g + 1: its powers are the hardest to approximate by fractions.
    g = 2.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (n + 1))
    steps = np.outer(np.arange(1, _CANDIDATES_PER_SHARE + 1), g ** -np.arange(1.0, n + 1))
    points: Array = 2.0 * np.mod(0.5 + steps, 1.0) - 1.0
    return points


def _candidates(chain: Chain, q: Array, sizes: Array, free: Array) -> Array:
    """Postures (k, n) within the limits, by share and distance; virtual joints do not move."""
    n = q.size
    lower, upper, lengths = map(
        np.array,
        zip(*((c.lower, c.upper, c.is_length) for c in chain.coordinates), strict=True),
    )
    reach = np.where(lengths, sizes, np.pi)
    low, high = np.maximum(lower, q - reach), np.minimum(upper, q + reach)
    u = _sequence(n)
    sides = np.where(u < 0, q - low, high - q)
    steps = np.concatenate([share * u * sides for share in _RANGE_SHARES])
    step = np.where(lengths, _ROUNDING_STEP * (high - low), _ROUNDING_STEP)
    rounded = np.round(steps / np.where(step > 0, step, 1.0)) * step
    # Rounding to twelve digits makes 0.15 of 0.15000000000000002.
    postures: Array = np.clip(np.round(q + rounded, 12), low, high)
    postures = np.where(free, postures, q)
    distances = np.linalg.norm((postures - q) / sizes, axis=1)
    return postures[
        np.lexsort((distances, np.repeat(_RANGE_SHARES, _CANDIDATES_PER_SHARE)))
    ]


#: N m/rad (N/m): the joint stiffness that is assumed where none was given; a note says so.
ASSUMED_STIFFNESS = 1.0e4


def springs_of(
    springs: Mapping[str, JointSpringModel],
    passive: Sequence[str],
    tree: KinematicTree,
    facts: RobotFacts,
    *,
    virtual: Sequence[str] = (),
    actuated: Sequence[str] | None = None,
    on_lines: bool = False,
    coupled: Collection[str] = (),
) -> tuple[JointSprings, list[Note], list[Note]]:
    """Return the joint springs of a file's entries, doubts that come first, and other notes.

    A joint without an entry has the spring of the robot's own file. Of the other joints the
    actuated ones get an assumed spring: in a serial arm all but the `passive` ones, in a closed
    chain (`actuated` is a sequence) those that are named there, or all but the passive ones where
    only these are named. Joints without a spring are free, as virtual joints of links are, and
    those that `coupled` springs hold.

    A mechanism that line springs hold (`on_lines`) and whose file names no passive joints has
    assumed springs only where an actuator of the robot's own file drives a joint.
    """
    names = tree.names
    named = set(passive) - set(virtual)
    passive = [*passive, *(n for n in virtual if n not in passive)]
    driven = set(names) - set(passive) - set(facts.passive) - set(coupled)
    held: set[str] = set()
    if actuated is not None:
        if actuated or springs or not named:
            driven &= set(actuated)
    elif on_lines and not named and not springs:
        held = driven - set(facts.actuated)
        driven -= held
    for entries, key in ((springs, "springs"), (passive, "passive")):
        _check_joints(entries, names, f"key {key}")
    both = set(springs) & set(passive)
    if both:
        raise InputError(f"joint {min(both)!r} is passive and has a spring")
    stiffness, rest = np.zeros(len(names)), np.full(len(names), np.nan)
    laws: dict[int, SpringLaw] = {}
    assumed: list[str] = []
    unsprung: list[str] = []
    on_lines_alone: list[str] = []
    for j, name in enumerate(names):
        entry = springs.get(name)
        if entry is not None:
            if entry.rest is not None:
                rest[j] = entry.rest
            slides, where = tree.coordinates[j].is_length, f"key springs.{name}"
            if entry.stiffness is not None:
                stiffness[j] = own_stiffness(
                    entry.stiffness, SI, slides, f"{where}.stiffness"
                )
            elif entry.polynomial is not None:
                first, *more = entry.polynomial
                first = own_stiffness(first, SI, slides, f"{where}.polynomial")
                laws[j] = PolynomialLaw((first, *more))
            elif (table := entry.points) is not None:
                x, y = np.array(table.points).T
                laws[j] = TabulatedLaw(tuple(x.tolist()), tuple(y.tolist()), table.pieces)
            if stiffness[j] == 0.0 and j not in laws:
                rest[j] = 0.0 if entry.rest is None else entry.rest
        elif name in facts.springs and name not in passive:
            spring = facts.springs[name]
            rest[j] = spring.rest
            if len(spring.coefficients) > 1:
                laws[j] = PolynomialLaw(spring.coefficients)
            else:
                stiffness[j] = spring.coefficients[0]
        elif name in driven:
            if springs and actuated is None:
                raise InputError(
                    f"joint {name!r} has no spring",
                    expected="an entry under springs, passive or locked",
                )
            stiffness[j] = ASSUMED_STIFFNESS
            assumed.append(name)
        else:
            rest[j] = 0.0
            if name in held:
                on_lines_alone.append(name)
            elif name in facts.passive and name not in {*passive, *coupled}:
                unsprung.append(name)
    doubts = [assumed_stiffness(ASSUMED_STIFFNESS, assumed, names)] if assumed else []
    doubts += [held_by_lines(on_lines_alone)] if on_lines_alone else []
    notes = list[Note]()
    notes += rest_of_turns(tree.coordinates, rest)
    for pieces in ("linear", "smooth"):
        tables = [j for j, law in laws.items() if getattr(law, "pieces", None) == pieces]
        notes += [table_as_read([names[j] for j in tables], pieces)] if tables else []
    notes += softening(
        {name: entry for name, entry in springs.items() if not entry.stiffness}
    )
    if unsprung:
        words = f"joints without a spring in the file move freely: {', '.join(unsprung)}"
        notes.append(Note("passive-joints", words, {"joints": unsprung}))
    return JointSprings(stiffness, rest, laws), doubts, notes


def softening(springs: Mapping[str, JointSpringModel]) -> list[Note]:
    """Return a note on the springs whose torque decreases while their joints turn."""
    soft = []
    for name, entry in springs.items():
        if (table := entry.points) is not None:
            x, y = np.array(table.points).T
            falls = bool(np.any(np.diff(y) < 0.0)) and bool(np.all(np.diff(x) > 0.0))
        else:
            falls = entry.polynomial is not None and entry.polynomial[0] < 0.0
        if falls:
            soft.append(name)
    return _negative(soft)


def _negative(names: Sequence[str]) -> list[Note]:
    if not names:
        return []
    words = f"springs whose stiffness is negative, at rest or farther: {', '.join(names)}"
    return [Note("negative-stiffness", words, {"springs": list(names)})]


def negative_links(springs: Sequence[Potential]) -> list[Note]:
    """Return a note on the links whose 6x6 spring has a negative eigenvalue."""
    notes = []
    for spring in springs:
        if isinstance(spring, CoupledSprings):
            values = np.linalg.eigvalsh(spring.matrix)
            if values[0] < -ZERO_SHARE * abs(values).max():
                notes.append(f"link {spring.link}")
    return _negative(notes)


def link_joints(entry: FlexibleModel) -> Give:
    """Virtual joints of a compliant link."""
    start = pose_of(entry.offset)
    if entry.beam is None:
        return Give(start, mass=None if entry.mass is None else np.array(entry.mass))
    beam = entry.beam
    own = None
    if beam.density > 0.0:
        own = beam.density * beam.area, beam.density * beam.Iy, beam.density * beam.Iz
    return Give(start, beam.length, beam.segments, own)


def virtual_joints(flexible: Mapping[str, FlexibleModel], prefix: str = "") -> list[str]:
    """Names of the virtual joints of compliant links."""
    return [
        f"{prefix}{link}.{suffix}"
        for link, entry in flexible.items()
        for suffix, _, _ in link_joints(entry).joints
    ]


def link_springs(
    flexible: Mapping[str, FlexibleModel], tree: KinematicTree, prefix: str = ""
) -> list[Potential]:
    """Springs over the virtual joints of compliant links, and beams."""
    springs: list[Potential] = []
    for link, entry in flexible.items():
        virtual = virtual_joints({link: entry}, prefix)
        indices = np.array([tree.names.index(name) for name in virtual])
        if entry.beam is not None:
            springs.append(_beam(entry.beam, indices, prefix + link))
            continue
        K = np.array(entry.stiffness, float)
        if numerics.asymmetry(K):
            raise InputError(
                "stiffness of a link must be symmetric", where=f"key flexible.{link}"
            )
        springs.append(CoupledSprings(indices, K[se3.SWAP][:, se3.SWAP], prefix + link))
    return springs


def _beam(beam: BeamModel, indices: Array, link: str) -> Beam:
    along_y, along_z = (
        np.inf if area is None else beam.G * area
        for area in (beam.shear_area_y, beam.shear_area_z)
    )
    section = Section(
        beam.E * beam.area,
        beam.G * beam.J,
        (beam.E * beam.Iy, beam.E * beam.Iz),
        (along_z, along_y),
    )
    mass = beam.density * beam.area * beam.length
    return Beam(indices, beam.length / beam.segments, section, link, mass)


def coupled_springs(
    parts: Sequence[_Part], tree: KinematicTree
) -> list[CoupledJointSprings]:
    """Springs on sums of joint positions: those of the files' keys, and fixed tendons of robots."""
    entries = [(part, entry) for part in parts for entry in part.entry.coupled_springs]
    for part in parts:
        for entry in part.description.facts.coupled:
            if not {part.prefix + n for n in entry.joints}.isdisjoint(tree.names):
                entries.append((part, entry))
    if not entries:
        return []
    factors, rest = np.zeros((len(entries), tree.n)), np.zeros(len(entries))
    for i, (part, entry) in enumerate(entries):
        held = {**part.description.facts.locked, **part.entry.locked}
        rest[i] = np.nan if entry.rest is None else entry.rest
        for name, factor in entry.joints.items():
            if name in held:
                rest[i] -= factor * held[name]
                continue
            _check_joints([part.prefix + name], tree.names, "key coupled_springs")
            factors[i, tree.names.index(part.prefix + name)] = factor
    names = tuple(
        part.prefix + (entry.name or f"coupled{i}")
        for i, (part, entry) in enumerate(entries, 1)
    )
    if len({*names, *tree.names}) < len(names) + tree.n:
        raise InputError(
            "a coupled spring has the name of another, or of a joint",
            where="key coupled_springs",
            expected="different names",
        )
    k = np.array([entry.stiffness for _, entry in entries])
    acting = np.flatnonzero(factors.any(axis=1))
    together = CoupledJointSprings(
        factors[acting], k[acting], rest[acting], tuple(names[i] for i in acting)
    )
    return [together] if acting.size else []


def extra_lines(
    lines: Sequence[LineModel], mechanism: Chain, q: Array, notes: list[Note]
) -> list[LineSprings]:
    """Return line springs and cables between named frames; add a note on large strains."""
    springs, strains = list[LineSprings](), dict[str, float]()
    for i, line in enumerate(lines, start=1):
        a, b = line.frames
        if mechanism.tree.placement(a).joint == mechanism.tree.placement(b).joint:
            raise InputError(
                "a line between two points of one link never changes its length",
                where="lines",
                got=f"{a!r} and {b!r}",
            )
        T, _ = mechanism.at(q).relative(a, b)
        ends = np.array([line.points[0]], float), np.array([line.points[1]], float)
        try:
            length = float(line_geometry(T, *ends).lengths[0])
        except UndefinedError:
            raise InputError(
                f"the line between {a!r} and {b!r} has zero length at q"
            ) from None
        rest = line.rest_length
        if rest is None:
            rest = length - (line.preload or 0.0) / line.stiffness
        if rest and not (line.unilateral and rest > length):
            strains[f"stretch of line {i}"] = (length - rest) / length
        springs.append(
            LineSprings(
                frame_a=a,
                frame_b=b,
                anchors=ends[0],
                points=ends[1],
                stiffness=np.array([line.stiffness]),
                rest_length=np.array([rest]),
                unilateral=line.unilateral,
            )
        )
    notes += large_strains(strains)
    return springs


def described(
    file: SerialFile | LegModel | ClosedChainFile,
    beside: Path | None,
    floating: bool = False,
) -> RobotDescription:
    """Read the robot of a `model:` or `dh:` entry; paths are relative to the mechanism file."""
    if file.dh is not None:
        if file.xacro or file.package_path:
            raise InputError(
                "xacro arguments and package paths belong to robots by model"
            )
        from cartstiff.loading.dh import dh_description

        return dh_description(file.dh, beside or Path(), floating)
    packages = tuple(_resolved(beside, folder) for folder in file.package_path)
    for folder, package in zip(file.package_path, packages, strict=True):
        if not package.is_dir():
            raise InputError("no such folder", where="package_path", got=one_line(folder))
    named = tuple(map(Path, file.named_folders))
    model, ros = file.model or "", Ros(packages, dict(file.xacro), named)
    if model.lstrip().startswith("<"):
        return described_text(model, floating, ros)
    path = _resolved(beside, model)
    if path.suffix.lower() not in ROBOT_FILES and not path.is_file():
        if is_description_name(model):
            path, more = described_robot(model)
            ros = Ros(
                (*ros.packages, *more.packages),
                {**more.arguments, **ros.arguments},
                (*named, *more.packages),
            )
        else:
            path = example_robot(model)
    return read_robot_description(
        path, floating, ros, joint_types=getattr(file, "joint_types", {})
    )


def _resolved(beside: Path | None, name: str) -> Path:
    return (beside or Path()) / Path(name).expanduser()


class _Part(NamedTuple):
    """One of the robots that a chain is built from, with the prefix of its names in the chain."""

    prefix: str
    entry: SerialFile | ClosedChainFile | LegModel
    description: RobotDescription


def _prefixed(parts: Sequence[_Part], key: str) -> dict[str, Any]:
    """Values (or names alone) of all parts at a key, by the joints' names in the chain."""
    prefixed: dict[str, Any] = {}
    for part in parts:
        own = attrgetter(key)(part)
        pairs = own if isinstance(own, Mapping) else dict.fromkeys(own)
        prefixed |= {part.prefix + name: value for name, value in pairs.items()}
    return prefixed


def _elastic_chain(
    file: SerialFile | ParallelFile | ClosedChainFile,
    name: str,
    notes: list[Note],
    tree: KinematicTree,
    frame: str,
    parts: Sequence[_Part],
    facts: RobotFacts,
    q: Array,
    *,
    offset: Array | None = None,
    closures: Sequence[Closure] = (),
    actuated: Sequence[str] = (),
    driven: Sequence[str] | None = None,
    is_given: bool = True,
    contacts: Sequence[str] = (),
    carrier: FixedFrame | None = None,
    edit: Callable[[Chain], None],
) -> ElasticMechanism:
    """Build the chain of some robots' joints, with its springs, loads, dampers and notes.

    Parameters
    ----------
    file, name
        The mechanism file's model, and the mechanism's name.
    notes : list of Note
        Notes of the reader; more are added.
    tree, frame : KinematicTree, str
        All joints, and the frame to which M is fixed, with M at `offset`.
    parts : sequence of _Part
        The robots.
    facts : RobotFacts
        Facts of the robots' files.
    q : ndarray (n,)
        Posture from which closures are closed; without closures a regular one replaces it, unless
        it `is_given`.
    closures, actuated
        Loops, and the joints that drive them.
    driven : sequence of str, optional
        Joints that get an assumed spring in a closed chain.
    contacts : sequence of str
        Joints that are free unless they have a spring.
    carrier : FixedFrame, optional
        Frame of the payload; default M.
    edit : callable
        Changes the chain before it is used.
    """
    entries: dict[str, JointSpringModel] = _prefixed(parts, "entry.springs")
    passive = list(_prefixed(parts, "entry.passive"))
    posture = _prefixed(parts, "entry.q")
    virtual = [
        n for part in parts for n in virtual_joints(part.entry.flexible, part.prefix)
    ]
    chain = Chain(
        tree,
        frame,
        offset=offset,
        closures=closures,
        actuated=_actuated(actuated, tree),
        virtual=[c for c, n in enumerate(tree.names) if n in virtual],
        kind=file.kind,
        descriptions=[part.description.shown(part.prefix) for part in parts],
    )
    edit(chain)
    if (payload := file.payload) is not None and payload.mass > 0:
        chain = chain.with_mass(payload.mass, np.array(payload.com), carrier)
        tree = chain.tree
    if chain.kind != "serial":
        q = _assembled(chain, q, posture, notes)
    elif not is_given:
        supports = parts[0].description.model.supports
        alone = len({int(support[1]) for support in supports if len(support) > 1}) == 1
        q, chosen = regular_posture(chain, q, alone=alone)
        notes += chosen
    together = coupled_springs(parts, tree)
    springs, doubts, more = springs_of(
        entries,
        passive,
        tree,
        facts,
        virtual=[*virtual, *(name for name in contacts if name not in entries)],
        actuated=driven,
        on_lines=bool(file.lines),
        coupled=[
            n
            for term in together
            for n, c in zip(tree.names, term.factors.T, strict=True)
            if c.any()
        ],
    )
    soft = [
        spring
        for part in parts
        for spring in link_springs(part.entry.flexible, tree, part.prefix)
    ]
    notes[:0] = doubts
    notes += [*more, *beams_that_end_elsewhere(soft, chain), *negative_links(soft)]
    notes += _links_without_effect(soft, chain, file.lines)
    potentials = [*soft, *together, *extra_lines(file.lines, chain, q, notes)]
    elastic = ElasticMechanism(name, chain, q, springs, notes=tuple(notes))
    chain.undriven = (
        frozenset(np.flatnonzero(springs.is_passive).tolist()) - springs.rigid
    )
    if not potentials and len(chain.undriven) == tree.n:
        names = ", ".join(chain.names)
        words = (
            f"no joint has a spring, and none is named as actuated, so all move freely: {names}. "
            "Which are actuated? Give --stiffness joint=value, or 'actuated' or 'springs' in the "
            "mechanism file"
        )
        elastic = elastic.with_notes(
            Note("springs-missing", words, {"joints": list(chain.names)})
        )
    potentials += [
        DeadForce(np.zeros(3), part.point, part.body, lifted=part.mass)
        for part in facts.lifted
        if tree.placement(part.body).joint > 0
    ]
    M, damping = tree.mimic, np.array(tree.model.damping, float).reshape(-1)
    if M is not None:
        damping = np.asarray((M * M).T @ damping)  # followers turn by their factor
    for i, n in enumerate(chain.names):
        if n in entries and entries[n].damping is not None:
            damping[i] = entries[n].damping
    elastic = replace(elastic, damping=damping if damping.any() else None)
    elastic = elastic.with_potential(*potentials)
    return elastic.with_gravity(file.gravity, where="key gravity")


def _links_without_effect(
    soft: Sequence[Potential], chain: Chain, lines: Sequence[LineModel]
) -> list[Note]:
    """Return a note on compliant links that carry neither the body nor anything that holds it."""
    frames = [f for line in lines for f in line.frames]
    frames += [
        f for closure in chain.closures for f in (closure.frame_a, closure.frame_b)
    ]
    model, tree = chain.tree.model, chain.tree
    ends = {chain.body.joint, *(tree.placement(f).joint for f in frames)}
    carrying = {model.names[int(j)] for end in ends for j in model.supports[end] if j}
    without = [
        spring.link
        for spring in soft
        if isinstance(spring, (Beam, CoupledSprings))
        and carrying.isdisjoint(tree.names[i] for i in np.ravel(spring.indices))
    ]
    if not without:
        return []
    words = (
        f"compliant links that do not move frame {chain.frame!r}: {', '.join(without)} (the spring "
        "of such a link moves what hangs on it, but not the link's own frame)"
    )
    return [Note("idle-link", words, {"links": without})]


# Limits of a joint [rad] that look like degrees; larger ones mean that there is no limit.
_LIMITS_LIKE_DEGREES = (40.0, 1000.0)


def beams_that_end_elsewhere(soft: Sequence[Potential], chain: Chain) -> list[Note]:
    """Return notes on beams with nothing at their far end: their link may not lie along its x."""
    model, notes = chain.tree.model, []
    for beam in soft:
        if not isinstance(beam, Beam):
            continue
        frames = chain.tree.frames
        last = list(model.idx_vs).index(int(beam.indices[-1, -1]))
        hung = [
            model.jointPlacements[j].translation
            for j in range(model.njoints)
            if j and model.parents[j] == last
        ]
        hung += [place.T_j_f[:3, 3] for place in frames.values() if place.joint == last]
        length = beam.length * len(beam.indices)
        nearest = min(hung, key=np.linalg.norm, default=np.zeros(3))
        if np.linalg.norm(nearest) <= numerics.NEGLIGIBLE_DISTANCE * length:
            continue
        x, y, z = nearest + np.array([length, 0.0, 0.0])
        notes.append(
            Note(
                "beam-elsewhere",
                f"the beam of link {beam.link!r} runs along the x axis of the link or its offset, "
                f"to ({length:.6g}, 0, 0); what hangs on it begins at ({x:.6g}, {y:.6g}, {z:.6g}), "
                "joined rigidly",
                {
                    "link": beam.link,
                    "length": length,
                    "begins": [float(x), float(y), float(z)],
                },
            )
        )
    return notes


def joints_that_move(description: RobotDescription, frame: str) -> set[str]:
    """Return the joints on the way to a frame, and those that loops and couplings tie to them."""
    model, facts = description.model, description.facts
    names = list(model.names)
    joint = int(find_frame(model, frame).parentJoint)
    moving = {names[int(j)] for j in model.supports[joint]} - {names[0]}
    groups = [closure.joints for closure in facts.closures]
    groups += [
        frozenset({follower, rule[0]}) for follower, rule in facts.followers.items()
    ]
    while any(group & moving and not group <= moving for group in groups):
        for group in groups:
            if group & moving:
                moving |= group
    return moving


def with_base_held(
    description: RobotDescription, frame: str, notes: list[Note], springs: Collection[str]
) -> RobotDescription:
    """Hold the free-flying joint that carries the frame, unless it has springs."""
    moving = joints_that_move(description, frame)
    free = description.facts.loose & moving
    named = {part for n in springs for part in (n, n.rpartition(".")[0])}
    named = named.union(*(o.joints for o in description.facts.obstacles))
    if not free or free == moving or free & named:
        return description
    name = min(min(free).rsplit(".", 1)[0], min(free))
    words = (
        f"the free-flying joint {name!r} is held; floating: true in a mechanism file of kind "
        "closed-chain lets it move"
    )
    notes.append(Note("root-held", words))
    return replace(description, held=description.held | free)


def with_actuator_springs(
    description: RobotDescription, notes: list[Note]
) -> RobotDescription:
    """Add the springs of a robot's position actuators to those of its joints.

    Raises
    ------
    InputError
        For a robot without such actuators, and where one acts on a joint with a curved spring.
    """
    facts, springs = description.facts, dict(description.facts.springs)
    if not facts.actuators:
        raise InputError(
            "no actuator holds a position",
            where="springs of actuators",
            expected="<position> actuators of joints in an MJCF file",
        )
    for name, k in facts.actuators.items():
        own = springs[name].coefficients if name in springs else (0.0,)
        if len(own) > 1:
            raise InputError(f"joint {name!r} has a curved spring beside its actuator's")
        springs[name] = FileSpring((own[0] + k,), math.nan)
    springs, _ = on_leaders(springs, facts.followers)
    words = ", ".join(f"{name} {k:g}" for name, k in facts.actuators.items())
    message = (
        f"springs of position actuators, kp times gear squared [N m/rad, N/m]: {words}; their "
        "rest positions balance the load at the posture"
    )
    notes.append(Note("actuator-springs", message, {"stiffness": facts.actuators}))
    ignored = tuple(
        words for words in facts.ignored if not words.startswith(POSITION_ACTUATORS)
    )
    return replace(description, facts=replace(facts, springs=springs, ignored=ignored))


def description_notes(
    description: RobotDescription,
    tree: KinematicTree,
    keys: Collection[str],
    closed: bool = False,
) -> list[Note]:
    """Return notes on what a robot's file has without effect, its posture, masses and limits.

    Parameters
    ----------
    description : RobotDescription
        The robot as its file says.
    tree : KinematicTree
        The joints of it that were kept.
    keys : collection of str
        Keys of the mechanism file.
    closed : bool
        Whether the closures of the robot's file are kept.

    Raises
    ------
    InputError
        If something that cannot be expressed acts on a joint of the tree, or is wrong with it.
    """
    facts = description.facts
    notes = [*facts.notes]
    # A joint with several coordinates has become several: joint.x, joint.y, ...
    moving = {
        part for name in tree.model.names for part in (name, name.rpartition(".")[0])
    }
    obstacles = list(facts.obstacles)
    for tie in facts.closures:
        if not (closed and tie.joints & moving):
            words = f"the {tie.type} tie of bodies {tie.body_a!r} and {tie.body_b!r}"
            obstacles.append(Obstacle(words, tie.joints))
    for obstacle in obstacles:
        affected = sorted(obstacle.joints & moving)
        if not affected or not set(keys).isdisjoint(obstacle.keys):
            continue
        if obstacle.error is not None:
            raise obstacle.error
        raise InputError(
            f"{obstacle.what} acts on joint {affected[0]!r} and cannot be expressed here",
            where="XML text"
            if description.path is None
            else one_line(str(description.path)),
            expected=obstacle.expected,
        )
    ignored = [*facts.ignored, *(o.what for o in obstacles)]
    if ignored:
        words = "; ".join(ignored)
        notes.append(Note("ignored", f"parts of the robot's file play no part: {words}"))
    if facts.keyframe is not None:
        words = f"the default posture is keyframe {facts.keyframe!r} of the MJCF file"
        notes.append(Note("keyframe", words))
    if facts.weightless:
        words = "; ".join(facts.weightless)
        notes.append(
            Note("masses-unknown", f"taken as zero, since it is not known: {words}")
        )
    wide = {
        c.name: [c.lower, c.upper]
        for c in tree.coordinates
        if not c.is_length
        and _LIMITS_LIKE_DEGREES[0] < max(-c.lower, c.upper) < _LIMITS_LIKE_DEGREES[1]
    }
    if wide:
        words = ", ".join(
            f"{name} {low:g} ... {high:g}" for name, (low, high) in wide.items()
        )
        message = f"limits of several turns: {words} rad. Degrees? Limits in URDF are in radians"
        notes.append(Note("limits-of-turns", message, wide))
    return notes


def gravity_left_out(
    file: SerialFile | ClosedChainFile | ParallelFile,
    description: RobotDescription,
    place: str = "",
) -> list[Note]:
    """Return a note where a mechanism file has no gravity and its MJCF file has one."""
    gravity = description.facts.gravity
    if gravity is None or file.gravity is not None:
        return []
    shown = ", ".join(f"{g:g}" for g in gravity)
    words = "the mechanism file names no gravity: that of the MJCF file"
    words = f"{place}{words} ({shown}) is left out"
    return [Note("gravity-left-out", words, {"gravity": gravity.tolist()})]


def joint_indices(model: Any, names: Mapping[str, float], where: str) -> dict[int, float]:
    """Values by Pinocchio's indices of the named joints."""
    known = list(model.names)[1:]
    indices = {}
    for name, value in names.items():
        check_name("joint", name, known, where)
        indices[known.index(name) + 1] = value
    return indices


def tree_to(
    description: RobotDescription,
    frames: Sequence[str] | None,
    locked: Mapping[str, float],
    where: str,
    notes: list[Note],
    flexible: Mapping[str, FlexibleModel] | None = None,
    joints: Collection[str] = (),
) -> KinematicTree:
    """Return the plain tree of the joints that move some frames (all if None), mimics resolved.

    The named `joints` are kept as well.
    """
    model, facts = description.model, description.facts
    names, still = list(model.names), facts.locked | dict(locked)
    leaders = {
        follower: to_root(follower, facts.followers) for follower in facts.followers
    }
    for follower, (leader, factor, offset) in leaders.items():
        if (
            follower in still and leader in names and factor
        ):  # a locked follower locks its leader
            position = (still[follower] - offset) / factor
            if (
                abs(still.setdefault(leader, position) - position)
                > numerics.NEGLIGIBLE_SHARE
            ):
                raise InputError(
                    f"joint {follower!r} follows {leader!r}, and both are locked elsewhere",
                    where=f"{where}key locked",
                    expected=f"{leader} at {position:g}, or one of them",
                    got=f"{still[leader]:g}",
                )
    fixed = joint_indices(model, still, f"{where}key locked")
    if frames is None:
        keep = set(range(1, model.njoints))
    else:
        keep = {j for j, name in enumerate(model.names) if j and name in joints}
        for name in frames:
            frame = find_frame(model, name)
            keep |= {int(j) for j in model.supports[int(frame.parentJoint)]} - {0}
    keep -= {names.index(name) for name in description.held}
    numbers = {name: j for j, name in enumerate(names)}
    for follower, (leader, _, _) in leaders.items():
        if numbers.get(follower) in keep and leader in numbers:
            keep.add(numbers[leader])
    follows: Followers = {}
    for follower, rule in leaders.items():
        index, (leader, factor, offset) = numbers.get(follower, 0), rule
        if not index or index in fixed:
            continue
        if (at := numbers.get(leader, 0)) in keep and at not in fixed:
            # The mass on a follower elsewhere moves with its leader, too.
            follows[follower] = rule
            keep.add(index)
        elif at:
            place = fixed.get(at, facts.posture.get(leader, 0.0))
            fixed[index] = factor * place + offset
        elif index in keep:
            notes.append(
                Note(
                    "mimic-ignored",
                    f"joint {follower!r} mimics {leader!r}, which does not exist: it is taken as a "
                    "joint of its own",
                )
            )
    # Other joints are fixed where the file's posture has them: their masses are carried.
    for index, joint in enumerate(names):
        if index not in keep and joint in facts.posture:
            fixed.setdefault(index, facts.posture[joint])
    soft = {name: link_joints(entry) for name, entry in (flexible or {}).items()}
    tree = plain_tree(model, keep, fixed, soft, facts.planar_axes)
    if not follows:
        return tree
    free = [c for c in tree.coordinates if c.name not in follows]
    column = {c.name: i for i, c in enumerate(free)}
    matrix, offsets = np.zeros((tree.n, len(free))), np.zeros(tree.n)
    for i, own in enumerate(tree.coordinates):
        leader, factor, offsets[i] = follows.get(own.name, (own.name, 1.0, 0.0))
        matrix[i, j := column[leader]] = factor
        if own.name in follows and factor:
            free[j] = _within_limits_of(own, free[j], factor, offsets[i], notes)
    if tree.mimic is not None:
        matrix, offsets = tree.mimic @ matrix, tree.mimic @ offsets
    return KinematicTree(tree.model, tuple(free), tree.given_frames, matrix, offsets)


def _within_limits_of(
    follower: Coordinate,
    leader: Coordinate,
    factor: float,
    offset: float,
    notes: list[Note],
) -> Coordinate:
    """Return the leader with the limits that its follower, at factor q + offset, leaves to it."""
    low, high = sorted(
        ((follower.lower - offset) / factor, (follower.upper - offset) / factor)
    )
    low, high = max(low, leader.lower), min(high, leader.upper)
    if low < high:
        return replace(leader, lower=low, upper=high)
    words = f"limits of joint {follower.name!r} leave nothing of those of {leader.name!r}, which "
    words += "it follows: they do not count"
    notes.append(
        Note("limits-contradict", words, {"joint": follower.name, "leader": leader.name})
    )
    return leader


def mounted_on_springs(
    springs: LineSprings, file: PlatformFile | SpringsFile, T_F_M: Array
) -> MountedStruts:
    """Mount the legs on the compliant base and platform of the file's `flexible`.

    Raises
    ------
    InputError
        For cables, and for springs that are not symmetric and positive definite, are beams, or have
        a mass.
    """
    where = "key flexible"
    if springs.unilateral:
        raise InputError(
            "cables need a rigid mounting", where=where, expected="no key flexible"
        )
    if not isinstance(springs, FlexureStruts):
        ball = Flexure(math.inf, math.inf, 0.0, 0.0)
        springs = FlexureStruts.between(
            springs.anchors,
            springs.points,
            T_F_M,
            springs.stiffness,
            ball,
            ball._replace(torsion=math.inf),
            springs.rest_length,
        )
    to_body = se3.inverse(pose_of(file.frame))
    base = _mount(file.flexible.get("base"), np.eye(4), f"{where}.base")
    tip = _mount(file.flexible.get("platform"), to_body, f"{where}.platform")
    return MountedStruts.of(springs, base, tip)


def _mount(entry: FlexibleModel | None, T: Array, where: str) -> Mount | None:
    """Spring of a mounting with its place moved by T; None for a rigid mounting."""
    if entry is None:
        return None
    if entry.stiffness is None or entry.mass is not None:
        got = "a beam" if entry.stiffness is None else "a mass"
        raise InputError(
            "base and platform are mounted on springs without mass",
            where=where,
            expected="stiffness alone",
            got=got,
        )
    K = np.array(entry.stiffness, float)
    sizes = np.sqrt(np.abs(np.diag(K)))
    if np.any(np.abs(K - K.T) > numerics.SYMMETRY * np.outer(sizes, sizes)):
        raise InputError("stiffness must be symmetric", where=where)
    least = (
        float(np.linalg.eigvalsh(K / np.outer(sizes, sizes))[0]) if sizes.all() else 0.0
    )
    if not least > numerics.RANK:
        raise InputError(
            "stiffness must hold the body in every direction",
            where=where,
            expected="a positive definite matrix",
            got=f"eigenvalue {least:.2g} of the diagonal's",
        )
    return Mount(T @ pose_of(entry.offset), K[np.ix_(se3.SWAP, se3.SWAP)])


def leg_limits_of(file: PlatformFile | SpringsFile, T_P_M: Array) -> LegLimits | None:
    """Return the limits of joint angles, distances and forces; None without any.

    Raises
    ------
    InputError
        For counts that differ from that of the legs, axes without a direction, and force limits
        the wrong way round.
    """
    legs, m = file.legs, len(file.base)
    base_axes, base_angles = _joints(legs.base_joints, m, "key legs.base_joints")
    axes, angles = _joints(legs.platform_joints, m, "key legs.platform_joints")
    diameters = _per_leg(legs.diameter, m, "key legs.diameter")
    place = "key legs.force"
    forces = pair_per_leg(legs.force, m, place, "[least, largest]")
    cables = one_each(getattr(file, "unilateral", False), m, "key unilateral")
    if forces is not None:
        if np.any(forces[cables, 1] < 0.0):
            raise InputError(
                "cables cannot push", where=place, expected="0 or more", got=legs.force
            )
        forces[cables, 0] = np.maximum(forces[cables, 0], 0.0)
    if all(part is None for part in (base_axes, axes, diameters, forces)):
        return None
    in_body = None if axes is None else axes @ T_P_M[:3, :3]
    return LegLimits(base_axes, base_angles, in_body, angles, diameters, forces)


def pair_per_leg(value: Any, m: int, where: str, meaning: str) -> Array | None:
    """Return limits (m, 2) from one pair for all legs or one each; None without any.

    Raises
    ------
    InputError
        For another number of pairs than legs, and for a pair the wrong way round.
    """
    if value is None:
        return None
    pairs = np.array(one_each(value, m, where, row=True), float)
    for i, pair in enumerate(pairs, start=1):
        check_limits(pair.tolist(), f"{where}.{i}", meaning)
    return pairs


def _per_leg(value: float | list[float] | None, m: int, where: str) -> Array | None:
    """Numbers (m,) from one for all legs or one each; None without any."""
    return None if value is None else np.array(one_each(value, m, where), float)


def _joints(
    model: LegJointsModel | None, m: int, where: str
) -> tuple[Array | None, Array | None]:
    """Unit axes (m, 3) and largest angles (m,)."""
    if model is None:
        return None, None
    axes = np.array(one_each(model.axis, m, f"{where}.axis", row=True), float)
    sizes = np.linalg.norm(axes, axis=1)
    if not sizes.min() > 0.0:
        raise InputError(
            "an axis has no direction", where=f"{where}.axis", got=model.axis
        )
    return axes / sizes[:, None], _per_leg(model.angle, m, f"{where}.angle")


# Number of random start postures of a leg, and the seed that makes them the same every time.
_RANDOM_STARTS, _SEED = 16, 0


def leg_at_pose(
    tree: KinematicTree,
    end: str,
    T_end_B: Array,
    T_root_B: Array,
    q: Array,
    virtual: Sequence[int],
    leg: str,
) -> Array:
    """Return the coordinates (n,) of one leg at which the body has a pose.

    The search starts from `q` and then from random postures within the limits; the first solution
    within the limits is taken, else the first of all. Virtual joints of compliant links are held.

    Parameters
    ----------
    tree : KinematicTree
        The leg.
    end : str
        Its last frame.
    T_end_B, T_root_B : ndarray (4, 4)
        Pose of the body in that frame, and the wanted pose of the body in the leg's root.
    q : ndarray (n,)
        Posture to start from.
    virtual : sequence of int
        Indices of virtual joints.
    leg : str
        For messages.

    Raises
    ------
    InputError
        If the leg does not reach the pose.
    """
    from cartstiff.kinematics.joint_poses import JointPoses

    elastic = ElasticMechanism(leg, Chain(tree, end, offset=T_end_B, virtual=virtual), q)
    limited, free = JointPoses(elastic), JointPoses(elastic, limits=False)
    random = limited.random_starts(_RANDOM_STARTS, np.random.default_rng(_SEED))
    starts = np.concatenate([q[None], random])
    poses = np.broadcast_to(T_root_B, (len(starts), 4, 4))
    for solver in (limited, free):
        postures, reached = solver.unwound().solve(poses, starts)
        if reached.any():
            return solver.within(postures[reached][:1])[0]
    left = np.abs(free.task(postures, poses, "none")[0]).max(axis=1).min()
    raise InputError(
        "the pose cannot be reached",
        where="key pose",
        expected="a pose that every leg reaches",
        got=f"{leg}, which stays {left:.3g} (rad or characteristic lengths) away",
    )


def as_closed_chain(file: SerialFile, **keys: Any) -> ClosedChainFile:
    """Return the file of a serial arm as that of a closed chain, with more keys."""
    shared = SerialFile.model_fields.keys() & ClosedChainFile.model_fields.keys()
    own = {key: getattr(file, key) for key in shared} | {"kind": "closed-chain"}
    return ClosedChainFile.model_construct(**(own | keys))


def build_chain(
    file: SerialFile | ClosedChainFile, beside: Path | None, name: str
) -> ElasticMechanism:
    """Build a serial arm, or a tree whose frames are tied by closures, from a mechanism file."""
    description = described(
        file, beside, floating=file.kind == "closed-chain" and file.floating
    )
    notes = gravity_left_out(file, description)
    return chain_of(description, file, name, reader_notes=notes)


def chain_of(
    description: RobotDescription,
    file: SerialFile | ClosedChainFile,
    name: str,
    posture: Mapping[str, float] | None = None,
    reader_notes: Sequence[Note] = (),
    alone: bool = False,
) -> ElasticMechanism:
    """Build a serial arm or a closed chain from a robot description that has been read.

    Parameters
    ----------
    description : RobotDescription
        The robot.
    file : SerialFile or ClosedChainFile
        Its frame, springs, loads and so on.
    name : str
        The mechanism's name.
    posture : mapping of str to float, optional
        Default positions by coordinate, for those that are not in `file`; other names are ignored.
    reader_notes : sequence of Note
        Notes that come before all others.
    alone : bool
        Whether there is no mechanism file: the description's loops are closed where they move the
        frame, joints that do not move it are left out, and its own actuators drive the chain.
    """
    notes, facts, given = [*reader_notes], description.facts, file.model_fields_set
    frame = chosen_frame(description, file.frame, notes)
    moved = joints_that_move(description, frame)
    lines = [*file.lines, *(line for line, joints in facts.lines if joints & moved)]
    if not (lines or getattr(file, "floating", False)):
        description = with_base_held(description, frame, notes, file.springs)
    has_rest = bool(facts.springs) or any(
        e.rest is not None for e in file.springs.values()
    )
    if file.actuator_springs:
        description = with_actuator_springs(description, notes)
        facts = description.facts
    moving = (
        joints_that_move(description, frame) if alone else set(description.model.names)
    )
    ties = [tie for tie in facts.closures if tie.joints & moving]
    if alone and ties and isinstance(file, SerialFile):
        file = as_closed_chain(file)
    file = naming_leaders(
        file.model_copy(update={"lines": lines}), description, notes, ""
    )
    closed = isinstance(file, ClosedChainFile)
    held_at = {**facts.posture, **(posture or {}), **file.q}
    for joint, zero in getattr(file, "zeros", {}).items():
        held_at[joint] = held_at.get(joint, 0.0) + zero
    held = replace(description, facts=replace(facts, posture=held_at))
    held_by = [f for line in file.lines for f in line.frames if f != "world"]
    ends = [frame, *(f for f in held_by if description.model.existFrame(f))]
    tree = tree_to(
        held,
        None if closed and not alone else ends,
        file.locked,
        "",
        notes,
        file.flexible,
        moving if closed else (),
    )
    if tree.n == 0 and not closed:
        raise InputError(
            f"no joint moves frame {frame!r}", expected="a frame on a moving link"
        )
    beyond = _joints_beyond(description, tree, file.locked)
    idle = [name for name in file.springs if name in beyond]
    file = _without_joints(file, beyond)
    actuated: Sequence[str] = ()
    driven = None
    base = np.eye(4)
    if isinstance(file, ClosedChainFile):
        own = [n for n in facts.actuated if n in tree.names]
        actuated, driven = (own, None) if alone else (file.actuated, file.actuated or own)
    else:
        base = pose_of(file.base)
        _check_joints(file.zeros, tree.names, "key zeros")
        tree = merged([("", tree.with_zeros(file.zeros), base)])
    in_closures = {
        name: x
        for name, x in file.q.items()
        if closed and _CLOSURE_COORDINATE.fullmatch(name)
    }
    named = {name: x for name, x in file.q.items() if name not in in_closures}
    closing = _ClosureBuilder(
        tree, default_posture(tree, named, facts, posture), in_closures
    )
    if isinstance(file, ClosedChainFile):
        for i, tie in enumerate(ties):
            closing.add_tie(tie, i)
        for i, entry in enumerate(file.closures):
            closing.add_entry(entry, i)
    tree = closing.tree
    _check_joints(in_closures, tree.names, "key q")
    notes += description_notes(description, tree, given, closed)
    fingers = _hand_joints(description.model, facts.loose)
    fingers |= {n for n in description.model.names if _is_finger(n)}
    notes += notes_on_branches(description.model, facts, tree.names, frame, fingers, idle)

    carrier = None
    if file.payload is not None and file.payload.carrier is not None:
        carried, offset = file.payload.carrier
        at = tree.placement(carried or default_frame(description.model, facts)[0])
        carrier = FixedFrame(at.joint, at.T_j_f @ pose_of(offset))

    def at_base(chain: Chain) -> None:
        chain.base_pose = fixed(base)

    elastic = _elastic_chain(
        file,
        name,
        notes,
        tree,
        frame,
        [_Part("", file, description)],
        facts,
        closing.q,
        offset=pose_of(file.offset),
        closures=closing.closures,
        actuated=actuated,
        driven=driven,
        contacts=closing.joints,
        carrier=carrier,
        is_given=bool(file.q or posture or facts.keyframe is not None or has_rest),
        edit=at_base,
    )
    elastic = replace(elastic, beyond=tuple(beyond))
    return elastic.with_notes(*_repeated_conditions(elastic, len(closing.joints)))


def _joints_beyond(
    description: RobotDescription, tree: KinematicTree, locked: Collection[str]
) -> list[str]:
    """Joints of a robot that could move and do not move the frame, in the file's order."""
    model, facts = description.model, description.facts
    kept = {*tree.names, *facts.followers, *facts.locked, *locked}
    pairs = zip(model.names, model.nvs, strict=True)
    return [str(name) for name, nv in pairs if nv == 1 and name not in kept]


def _without_joints(entry: Any, beyond: Collection[str]) -> Any:
    """Return a file or leg without what it says of joints beyond the frame."""
    acting: dict[str, Any] = {
        "passive": [name for name in entry.passive if name not in beyond]
    }
    for key in {"q", "springs", "zeros"}.intersection(type(entry).model_fields):
        acting[key] = {
            name: x for name, x in getattr(entry, key).items() if name not in beyond
        }
    return entry.model_copy(update=acting)


def _repeated_conditions(elastic: ElasticMechanism, own: int) -> list[Note]:
    """Return a note where closures with `own` coordinates have dependent conditions."""
    at = elastic.mechanism.at(elastic.q)
    closure, residual = at.closure, at.residual
    if not own or closure is None or residual is None or closure.sizes is None:
        return []
    rows = closure.jacobian * at.coordinate_lengths / closure.sizes[:, None]
    m = len(residual)
    more = m - numerics.rank(numerics.singular_values(rows[:m]))
    if not more:
        return []
    words = (
        f"{more} of the {m - own} conditions of the closures repeat others here, as in planar "
        "loops of hinges: the motions do not change, but the forces and moments in the loop that "
        "answer to them are not determined between rigid links"
    )
    return [Note("repeated-closures", words, {"conditions": m - own, "repeated": more})]


def build_platform(file: PlatformFile | SpringsFile, name: str) -> ElasticMechanism:
    """Build the elastic mechanism of a body held by lines."""
    m, notes = len(one_each(file.platform, len(file.base), "key platform")), list[Note]()
    limits = pair_per_leg(file.legs.limits, m, "key legs.limits", "[shortest, longest]")
    from cartstiff.loading.platform_schema import BodyModel

    T_P_M = pose_of(file.frame)
    body, payload = file.body or BodyModel(mass=0.0), file.payload
    platform = Platform(
        file.base,
        file.platform,
        T_P_M=T_P_M,
        units=Units(file.units.length, file.units.force),
        kind=file.kind,
        limits=None if limits is None else [(a, b) for a, b in limits],
        mass=body.mass,
        mass_centre=body.com,
        inertia=_checked_inertia(body.inertia),
        struts=_struts(file, m, notes),
        leg_limits=leg_limits_of(file, T_P_M),
    )
    if payload is not None:
        platform = platform.with_mass(payload.mass, np.array(payload.com))
    T_F_M = pose_of(file.pose) @ T_P_M
    try:
        geometry = line_geometry(T_F_M, platform.anchors, platform.points)
    except UndefinedError as error:
        raise InputError(
            f"leg {error.values['line']} has zero length at the file's pose"
        ) from None
    if platform.struts is not None:
        _check_bars(platform.struts, geometry.lengths)
    springs = _legs(file, platform, T_F_M, geometry.lengths)
    q = np.concatenate([file.pose.xyz, file.pose.rpy])
    dampers = _per_leg(file.legs.damping, m, "key legs.damping")
    damping = dampers if dampers is not None and dampers.any() else None
    stretches = geometry.lengths - springs.rest_length
    if springs.preload is not None:
        wound = np.isnan(stretches)
        stretches = np.where(wound, springs.preload / springs.stiffness, stretches)
    # A rest length of zero is intended: such springs balance weights.
    notes += large_strains(
        {
            f"stretch of leg {i + 1}": float(x)
            for i, x in enumerate(np.nan_to_num(stretches / geometry.lengths))
            if springs.rest_length[i] != 0.0
        }
    )
    elastic = ElasticMechanism(
        name, platform, q, springs, notes=tuple(notes), damping=damping
    )
    return elastic.with_gravity(file.gravity, where="key gravity")


def _legs(
    file: PlatformFile | SpringsFile, platform: Platform, T_F_M: Array, lengths: Array
) -> LineSprings:
    """Return the springs of the legs: lines, or struts between flexures."""
    legs, m = file.legs, len(lengths)
    strut = legs.strut
    value, key = (
        (legs.stiffness, "stiffness") if strut is None else (strut.axial, "strut.axial")
    )
    place = "key legs."
    stiffness = _per_leg(value, m, place + key)
    rest = _per_leg(legs.rest_length, m, f"{place}rest_length")
    preload = _per_leg(legs.preload, m, f"{place}preload")
    if stiffness is None:  # the schema requires it
        raise InputError("legs have no stiffness")
    rests = np.full(m, np.nan) if rest is None else rest
    cables = one_each(getattr(file, "unilateral", False), m, "key unilateral")
    drives = cables if legs.driven is None else one_each(legs.driven, m, f"{place}driven")
    if legs.driven is None and file.kind == "stewart-gough":
        drives = [True] * m
    if strut is None:
        springs = LineSprings(
            anchors=platform.anchors,
            points=platform.points,
            stiffness=stiffness,
            rest_length=rests,
            unilateral=tuple(cables),
        )
    else:
        a, f = convert_length(
            SI, platform.units
        )  # moments are in N m, whatever the units
        lower, upper = (
            Flexure(e.axial, e.shear, e.bending * f * a, e.torsion * f * a, e.offset)
            for e in (strut.lower, strut.upper)
        )
        springs = FlexureStruts.between(
            platform.anchors, platform.points, T_F_M, stiffness, lower, upper, rests
        )
    if file.flexible:
        springs = mounted_on_springs(springs, file, T_F_M)
    limits = None if platform.leg_limits is None else platform.leg_limits.forces
    least, most = (None, None) if limits is None else limits.T
    springs = replace(springs, driven=tuple(drives), least=least, most=most)
    if preload is None:
        return springs
    # A passive spring was made with its rest length; a drive winds its leg to the tension.
    own = lengths - preload / springs.stiffness
    if isinstance(springs, FlexureStruts):
        own = springs.wound(T_F_M[None], preload)[0]
    rests = np.where(drives, np.nan, own)
    wound = np.where(drives, preload, np.nan) if any(drives) else None
    return replace(springs, rest_length=rests, preload=wound)


def _checked_inertia(rows: list[list[float]] | None) -> Array:
    """Return the 3x3 inertia of a body, zero by default; refuse one that no body has."""
    inertia = np.zeros((3, 3)) if rows is None else np.array(rows, float)
    if numerics.asymmetry(inertia):
        raise InputError(
            "inertia is not symmetric", where="key body.inertia", got=inertia.tolist()
        )
    moments = np.linalg.eigvalsh(inertia)
    if (
        moments[0] < -numerics.NEGLIGIBLE_DIFFERENCE * moments[2]
        or moments[0] + moments[1] < (1 - numerics.NEGLIGIBLE_DIFFERENCE) * moments[2]
    ):
        raise InputError(
            "no body has these moments of inertia",
            where="key body.inertia",
            expected="each at most the sum of the other two",
            got=moments.tolist(),
        )
    return inertia


def _struts(file: PlatformFile | SpringsFile, m: int, notes: list[Note]) -> Struts | None:
    """Return the masses of the legs, and add a note on assumed ones; None without any."""
    from cartstiff.loading.platform_schema import LegMassModel

    strut = file.legs.strut
    mass = file.legs.mass if strut is None or strut.mass is None else strut.mass
    if mass is None:
        return None
    if not isinstance(mass, LegMassModel):
        feet, heads = np.array(file.base), np.array(file.platform)
        T = pose_of(file.pose)
        quarter = np.linalg.norm(heads @ T[:3, :3].T + T[:3, 3] - feet, axis=1) / 4.0
        half = np.array(one_each(mass, m, "key legs.mass"), float) / 2.0
        words = (
            "legs.mass is one number for a leg: a uniform bar of the leg's length at the file's "
            "pose, half of it on either joint; fixed, moving, fixed_com and moving_com state "
            "another distribution"
        )
        notes.append(Note("leg-mass-spread", words, {"mass": (2.0 * half).tolist()}))
        return Struts(half, half, quarter, quarter, np.zeros(m))
    keys = ("fixed", "moving", "fixed_com", "moving_com", "radius")
    values = [_per_leg(getattr(mass, key), m, f"key legs.mass.{key}") for key in keys]
    return Struts(*(np.zeros(m) if value is None else value for value in values))


def _check_bars(struts: Struts, lengths: np.ndarray) -> None:
    """Refuse bars of legs whose mass centre lies beyond the leg's other end."""
    for key, masses in (("fixed_com", struts.fixed), ("moving_com", struts.moving)):
        for i in np.flatnonzero((masses > 0.0) & (getattr(struts, key) > lengths)):
            raise InputError(
                f"the mass centre of leg {i + 1} is beyond its other end",
                where=f"key legs.mass.{key}",
                got=f"{getattr(struts, key)[i]:g}",
                expected=f"a distance up to the leg's length, {lengths[i]:g}",
            )


def with_overrides(file: Any, overrides: Mapping[str, Any]) -> Any:
    """Return the file with overrides, which replace its own values.

    Parameters
    ----------
    file : a model of the schema
        The mechanism file.
    overrides : mapping
        Any of "frame", "locked", "tcp" (pose of M in that frame), "gravity", "actuator_springs",
        "xacro", "package_path". The file's payload stays where it is.

    Raises
    ------
    InputError
        For what the file's kind does not have.
    """
    keys: dict[str, Any] = {}
    if (frame := overrides.get("frame")) is not None:
        file = _with_frame(file, frame)
    if locked := overrides.get("locked"):
        if file.kind not in ("serial", "closed-chain"):
            raise InputError(
                f"kind {file.kind} has no joints to lock",
                expected="kind serial or closed-chain",
            )
        keys["locked"] = {**file.locked, **locked}
    if overrides.get("xacro") or overrides.get("package_path"):
        file = _with_ros(file, overrides)
    if overrides.get("actuator_springs"):
        if not hasattr(file, "actuator_springs"):
            raise InputError(f"kind {file.kind} has no actuators", where="--springs")
        keys["actuator_springs"] = True
    payload = file.payload
    if (T := overrides.get("tcp")) is not None:
        back = se3.inverse(T)
        key = "frame" if file.kind in ("stewart-gough", "springs") else "offset"
        keys[key] = _model_of(pose_of(getattr(file, key)) @ T)
        if payload is not None and payload.carrier is None:
            centre = (back @ np.append(payload.com, 1.0))[:3]
            payload = payload.model_copy(update={"com": centre.tolist()})
    if (gravity := overrides.get("gravity")) is not None:
        keys["gravity"] = list(gravity)
    if payload is not file.payload:
        keys["payload"] = payload
    return file.model_copy(update=keys) if keys else file


def _model_of(T: Array) -> PoseModel:
    xyz, rpy = T[:3, 3].tolist(), se3.roll_pitch_yaw(T).tolist()
    return PoseModel.model_construct(xyz=xyz, rpy=rpy)


def _with_ros(file: Any, overrides: Mapping[str, Any]) -> Any:
    """Return the file with more xacro arguments and package folders for its robots."""
    if hasattr(file, "model"):
        return file.with_ros(
            overrides.get("xacro", {}), overrides.get("package_path", ())
        )
    if isinstance(file.legs, list) and any(leg.drawing is None for leg in file.legs):
        legs = [
            _with_ros(leg, overrides) if leg.drawing is None else leg for leg in file.legs
        ]
        return file.model_copy(update={"legs": legs})
    raise InputError(
        f"kind {file.kind} has no robot description",
        expected="no xacro arguments and no package path",
    )


def _with_frame(file: Any, frame: str) -> Any:
    """Return the file with another frame of interest."""
    only = {"stewart-gough": "platform", "springs": "platform", "parallel": "body"}.get(
        file.kind
    )
    if only is not None:
        check_name("frame", frame, [only])
        return file
    payload = file.payload and file.payload.carried_by(file.frame, file.offset)
    other = {"frame": frame, "offset": _model_of(np.eye(4)), "payload": payload}
    return file.model_copy(update=other)


# Joints of contacts: those with springs, then those that are free.
_SOFT_CONTACT = (("contact.tx", "PX"), ("contact.ty", "PY"), ("contact.tz", "PZ"))
_CONTACTS = {
    "rigid": (),
    "soft-finger": (("contact.z", "RZ"),),
    "point": (("contact.x", "RX"), ("contact.y", "RY"), ("contact.z", "RZ")),
}


def _with_contact(
    tree: KinematicTree, end: str, leg: LegModel, soft: Collection[str]
) -> KinematicTree:
    """Return a leg's tree with the joints of its contact, those with springs first.

    They are along the contact's axes; frame "contact" is parallel to the frame `end` at zero.
    """
    joints = [(name, kind) for name, kind in _SOFT_CONTACT if name in soft]
    joints += _CONTACTS[leg.contact]
    given = leg.contact_stiffness
    if given is None or not any(given.rpy):
        return extended(tree, end, joints, "contact")
    turn = se3.from_roll_pitch_yaw([0.0, 0.0, 0.0], given.rpy)
    _add_frame(tree, "contact axes", end, turn)
    tree = extended(tree, "contact axes", joints, "turned contact")
    _add_frame(tree, "contact", "turned contact", se3.inverse(turn))
    return tree


def rules_of_followers(
    description: RobotDescription,
) -> dict[str, tuple[str, float, float]]:
    """Leader, factor and offset of the joints that follow another one of the robot."""
    followers, names = description.facts.followers, set(description.model.names)
    rules = {name: to_root(name, followers) for name in followers}
    return {name: rule for name, rule in rules.items() if rule[0] in names and rule[1]}


def _leaders_note(leaders: dict[str, str]) -> Note:
    each = ", ".join(f"{name} follows {leader}" for name, leader in leaders.items())
    words = (
        f"joints of the file follow others by <mimic>, which are taken instead: {each}"
    )
    return Note("followers-named", words, {"leaders": leaders})


def naming_leaders(
    file: Any, description: RobotDescription, notes: list[Note], where: str
) -> Any:
    """Return a file, or leg, in which joints that follow others by <mimic> are these others.

    A follower has no coordinate of its own: it is driven, or moves freely, where its leader does,
    and its place is that of its leader.

    Raises
    ------
    InputError
        For a spring or a zero of a follower, and for places that do not agree.
    """
    rules = rules_of_followers(description)
    named = dict.fromkeys((*getattr(file, "actuated", ()), *file.passive, *file.q))
    for key in ("springs", "zeros"):
        for name in rules.keys() & getattr(file, key, {}).keys():
            leader, factor, offset = rules[name]
            raise InputError(
                f"joint {name!r} has no coordinate of its own: it follows {leader!r} by <mimic>",
                where=f"{where}key {key}",
                expected=f"{leader}, of which it is {factor:g} times the position, plus {offset:g}",
            )
    if not (led := {name: rules[name][0] for name in named if name in rules}):
        return file
    q = {name: value for name, value in file.q.items() if name not in led}
    for name in file.q.keys() & led.keys():
        leader, factor, offset = rules[name]
        place = (file.q[name] - offset) / factor
        if abs(q.setdefault(leader, place) - place) > numerics.NEGLIGIBLE_SHARE:
            raise InputError(
                f"joint {name!r} follows {leader!r}, and the places of both do not agree",
                where=f"{where}key q",
                expected=f"{leader} at {place:g}, or one of them",
                got=f"{q[leader]:g}",
            )
    changed: dict[str, Any] = {
        key: list(dict.fromkeys(led.get(name, name) for name in getattr(file, key)))
        for key in ("actuated", "passive")
        if key in file.model_fields_set
    }
    notes.append(_leaders_note(led))
    if file.q:
        changed["q"] = q
    return file.model_copy(update=changed)


def _check_joints(names: Iterable[str], known: Collection[str], where: str) -> None:
    for name in names:
        check_name("joint", name, known, where)


def _add_frame(tree: KinematicTree, name: str, base: str, T: Array) -> None:
    at = tree.placement(base)
    tree.frames[name] = FixedFrame(at.joint, at.T_j_f @ T)


def _actuated(names: Sequence[str], tree: KinematicTree) -> list[int] | None:
    _check_joints(names, tree.names, "key actuated")
    if len(set(names)) != len(names):
        raise InputError("a joint stands twice under actuated")
    return [tree.names.index(name) for name in names] or None


def _assembled(
    chain: Chain, q: Array, posture: Mapping[str, float], notes: list[Note]
) -> Array:
    """Closed coordinates near q; without actuated joints, those of `posture` are held."""
    named = [] if chain.actuated else [chain.names.index(name) for name in posture]
    try:
        at = chain.closed(q, named=named)
    except ConvergenceError as error:
        raise InputError(f"{error}", expected="a posture near a closed one") from None
    chain.home = ReferencePosture(at.q, chain.held, at.coordinate_lengths)
    if len(named) < len(q):  # else they are where the search starts
        notes += chain.adjusted(q, at.q, named)
    return at.q


def build_parallel(
    file: ParallelFile, beside: Path | None, name: str
) -> ElasticMechanism:
    """Build a body carried by several chains: the end frames of all chains are welded together.

    The body frame is fixed to the first chain's end; every other chain's end is welded to it.
    """
    notes: list[Note] = []
    trees: list[tuple[str, KinematicTree, Array]] = []
    parts: list[_Part] = []
    ends: list[str] = []
    contacts: list[str] = []
    driven: list[str] = []
    leaders: dict[str, str] = {}
    lines = [*file.lines]
    from cartstiff.loading.legs import drawn_legs, mode_notes

    legs = [*drawn_legs(file)]
    notes += mode_notes(legs)
    for i, leg in enumerate(legs):
        prefix, place = f"leg{i + 1}/", f"leg {i + 1}"
        drawing = leg.drawing
        description = described(leg, beside) if drawing is None else drawing.description
        notes += gravity_left_out(file, description, f"{place}: ")
        end = chosen_frame(description, leg.frame, notes, place)
        description = with_base_held(description, end, notes, leg.springs)
        if leg.actuator_springs:
            description = with_actuator_springs(description, notes)
        leg = legs[i] = naming_leaders(leg, description, notes, f"{place}, ")
        leaders |= {
            prefix + follower: prefix + leader
            for follower, (leader, _, _) in rules_of_followers(description).items()
        }
        at = {**description.facts.posture, **leg.q}
        description = replace(description, facts=replace(description.facts, posture=at))
        tree = tree_to(description, [end], leg.locked, f"{place}, ", notes, leg.flexible)
        beyond = _joints_beyond(description, tree, leg.locked)
        notes += idle_springs([n for n in leg.springs if n in beyond], end, f"{place}: ")
        leg = legs[i] = _without_joints(leg, beyond)
        notes += description_notes(description, tree, leg.model_fields_set)
        if leg.contact != "rigid":
            soft = {
                name: FileSpring(
                    (own_stiffness(k, SI, name != "contact.z", place),), math.nan
                )
                for name, k in leg.contact_springs.items()
            }
            tree = _with_contact(tree, end, leg, soft)
            end = "contact"
            contacts += [
                f"{prefix}{joint}"
                for joint, _ in _CONTACTS[leg.contact]
                if joint not in soft
            ]
            springs = {**description.facts.springs, **soft}
            description = replace(
                description, facts=replace(description.facts, springs=springs)
            )
        names = tree.names
        for entries, key in (
            (leg.springs, "springs"),
            (leg.passive, "passive"),
            (leg.q, "q"),
        ):
            _check_joints(entries, names, f"{place}, key {key}")
        driven += [
            prefix + joint for joint in description.facts.actuated if joint in names
        ]
        lines += [
            line.model_copy(update={"frames": [prefix + frame for frame in line.frames]})
            for line, joints in description.facts.lines
            if not joints.isdisjoint(names)
        ]
        trees.append((prefix, tree, pose_of(leg.base)))
        parts.append(_Part(prefix, leg, description))
        ends.append(end)
    named = {joint: leaders[joint] for joint in file.actuated if joint in leaders}
    if named:
        actuated = [*dict.fromkeys(named.get(joint, joint) for joint in file.actuated)]
        file = file.model_copy(update={"actuated": actuated})
        notes.append(_leaders_note(named))
    facts = RobotFacts(
        _prefixed(parts, "description.facts.springs"),
        tuple(_prefixed(parts, "description.facts.passive")),
        posture=_prefixed(parts, "description.facts.posture"),
        lifted=tuple(
            replace(lifted, body=part.prefix + lifted.body)
            for part in parts
            for lifted in part.description.facts.lifted
        ),
    )
    tree = merged(trees)
    offset = pose_of(file.offset)
    grips = [se3.inverse(offset) @ pose_of(leg.grip) for leg in legs]  # in M
    body = [f"body of leg {i + 1}" for i in range(len(ends))]
    for frame, part, end, grip in zip(body, parts, ends, grips, strict=True):
        _add_frame(tree, frame, part.prefix + end, se3.inverse(grip))
    q = default_posture(tree, _prefixed(parts, "entry.q"), facts)
    start = 0
    for i, (leg, (_, arm, T_F_root)) in enumerate(zip(legs, trees, strict=True)):
        own = slice(start, start + arm.n)
        start += arm.n
        if file.pose is None or leg.drawing is not None:
            continue  # a leg by name is drawn at the pose
        virtual = [*virtual_joints(leg.flexible), *leg.contact_springs]
        q[own] = leg_at_pose(
            arm,
            ends[i],
            se3.inverse(grips[i]),
            se3.inverse(T_F_root) @ pose_of(file.pose) @ offset,
            q[own],
            [j for j, n in enumerate(arm.names) if n in virtual],
            f"leg {i + 1}",
        )

    def with_body(chain: Chain) -> None:
        chain.frame, chain.frame_offset = "body", fixed(offset)
        chain.legs = _placed_legs(legs, grips, tree.names)

    return _elastic_chain(
        file.model_copy(update={"lines": lines}),
        name,
        notes,
        tree,
        body[0],
        parts,
        facts,
        q,
        closures=[Closure(body[0], other, "weld") for other in body[1:]],
        actuated=file.actuated,
        driven=file.actuated or driven,
        contacts=contacts,
        edit=with_body,
    )


def _placed_legs(
    legs: Sequence[LegModel], grips: Sequence[Array], names: Sequence[str]
) -> tuple[PlacedLeg, ...]:
    """Legs by name with the indices of their joints among a chain's coordinates."""
    placed = []
    for i, leg in enumerate(legs):
        if (drawing := leg.drawing) is not None:
            at = {name: names.index(f"leg{i + 1}/{name}") for name in drawing.joints}
            columns, driven = tuple(at.values()), at[drawing.driven]
            placed.append(
                PlacedLeg(drawing.shape, columns, driven, grips[i], drawing.diameter)
            )
    return tuple(placed)


_CLOSURE_COORDINATE = re.compile(r"(closure|equality)\d+\.[xy]")
#: Axes of frame a about which a closure leaves joints free; synonyms of the other closures.
_FREE_AXES = {"hinge": ("RX",), "universal": ("RX", "RY")}
_SYNONYMS = {"ball": "point", "rigid": "weld"}


class _ClosureBuilder:
    """Adds closures to a tree, with the joints of hinges and universal joints.

    A hinge is a weld at the end of one more joint about x of frame a, a universal joint of two
    more, about x of frame a and y of frame b: five and four conditions on the other joints.

    Attributes
    ----------
    tree, q : KinematicTree, ndarray (n,)
        The tree with the joints added so far, and coordinates at which they nearly close.
    closures : list of Closure
    joints : list of str
        Names of the added joints.
    """

    def __init__(
        self, tree: KinematicTree, q: Array, positions: Mapping[str, float]
    ) -> None:
        self.tree, self.q, self._positions = tree, q, positions
        self.closures: list[Closure] = []
        self.joints: list[str] = []

    def add(self, name: str, a: str, b: str, kind: str) -> None:
        """Tie frame b to frame a by a joint; its own coordinates are named after the closure."""
        if kind in _FREE_AXES:
            tree = self.tree
            joints = [(f"{name}.{axis[1].lower()}", axis) for axis in _FREE_AXES[kind]]
            R = tree.at(self.q).relative(tree.placement(a), tree.placement(b))[0]
            turns = math.atan2(R[2, 1], R[1, 1]), math.atan2(R[0, 2], R[0, 0])
            self.tree = extended(tree, a, joints, name)
            for (joint, _), turn in zip(joints, turns, strict=False):
                self.q = np.append(self.q, self._positions.get(joint, turn))
                self.joints.append(joint)
            a, kind = name, "weld"
        self.closures.append(Closure(a, b, _SYNONYMS.get(kind, kind)))  # type: ignore[arg-type]

    def add_entry(self, entry: ClosureModel, i: int) -> None:
        """Add a file's entry; without points a frame is tied to "world" where it is at q."""
        place, tree = f"closure {i + 1}", self.tree
        for frame in entry.frames:
            check_name("frame", frame, tree.frames, place)
        a, b = entry.frames
        if a == b:
            raise InputError("a closure ties a frame to itself", where=place, got=repr(a))
        if entry.points is None and "world" in (a, b):
            other = b if a == "world" else a
            tied = f"world (closure {i + 1})"
            T = tree.at(self.q).pose(tree.placement(other))
            if entry.axes is not None:  # these are along the axes of F
                T = se3.pose(translation=T[:3, 3])
            tree.frames[tied] = FixedFrame(0, T)
            a, b = (tied, other) if a == "world" else (other, tied)
        if entry.points is not None or entry.type in _FREE_AXES:
            names = []
            points = entry.points or [[0.0] * 3] * 2
            turns = turned_axes(entry.type, entry.axes, place)
            for frame, point, R in zip((a, b), points, turns, strict=True):
                tied = f"{frame} (closure {i + 1})"
                _add_frame(tree, tied, frame, se3.pose(R, point))
                names.append(tied)
            a, b = names
        self.add(f"closure{i + 1}", a, b, entry.type)

    def add_tie(self, tie: FileClosure, i: int) -> None:
        """Add a closure of the robot's own file."""
        a, b = f"{tie.body_a} (equality {i + 1})", f"{tie.body_b} (equality {i + 1})"
        _add_frame(self.tree, a, tie.body_a, tie.T_a)
        _add_frame(self.tree, b, tie.body_b, tie.T_b)
        self.add(f"equality{i + 1}", a, b, tie.type)
