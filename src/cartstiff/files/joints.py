"""Passes over one robot: from its description to the tree of the joints that act.

Each takes a `Part` and returns it changed, with its notes. At the end stand the notes on
joints beside the chain to the frame of interest. A tree that a drawing program exports
from a parallel machine has its loops cut: the chain to one frame is then one leg, and its
answer is that of a serial arm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import filterfalse
from typing import Any

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.errors import InputError, check_name, listed
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.tree import KinematicTree
from cartstiff.core.notes import Note
from cartstiff.files.assembly import Part, placed_frame
from cartstiff.files.description import (
    POSITION_ACTUATORS,
    FileSpring,
    Followers,
    Obstacle,
    on_leaders,
)
from cartstiff.files.frames import (
    FEET,
    default_frame,
    hand_joints,
    is_finger,
    joints_that_move,
    joints_to,
    named_elsewhere,
)
from cartstiff.files.postures import default_posture
from cartstiff.files.tree_building import extended, find_frame, plain_tree


def named_frame(part: Part) -> Part:
    """Take the named frame, or the default one with a note on what was assumed."""
    frame = part.entry.frame
    if frame is None:
        try:
            frame, words = default_frame(part.robot)
        except InputError as error:
            raise error.moved_to(part.place) from None
        note = Note("default-frame", part.says(words), {"frame": frame})
        return part.noting([note], frame=frame)
    notes = []
    if named_elsewhere(part.robot.model, frame, part.place):
        words = f"a link and a joint elsewhere are named {frame!r}: the link is taken"
        notes.append(Note("ambiguous-frame", part.says(words), {"frame": frame}))
    return part.noting(notes, frame=frame)


def acting_lines(part: Part) -> Part:
    """Add the tendons of the robot's own file that act on the joints to the frame."""
    moving = joints_that_move(part.robot, part.frame)
    own = [line for line, joints in part.robot.lines if joints & moving]
    return replace(part, lines=(*part.lines, *own))


def held_base(part: Part) -> Part:
    """Hold the free-flying joint that carries the frame, unless something acts on it."""
    robot, moving = part.robot, joints_that_move(part.robot, part.frame)
    free = robot.loose & moving
    named = {name for n in part.entry.springs for name in (n, n.rpartition(".")[0])}
    named = named.union(*(o.joints for o in robot.obstacles))
    is_free = bool(part.lines) or getattr(part.entry, "floating", False)
    if is_free or not free or free == moving or free & named:
        return part
    name = min(min(free).rsplit(".", 1)[0], min(free))
    words = (
        f"the free-flying joint {name!r} is held; floating: true in a mechanism file of "
        "kind closed-chain lets it move"
    )
    held = replace(robot, held=robot.held | free)
    return part.noting([Note("root-held", words)], robot=held)


def actuator_springs(part: Part) -> Part:
    """Add the springs of position actuators to those of the joints,
    where they are asked for.

    Raises
    ------
    InputError
        For a robot without such actuators, and where one acts on a joint with a curved
        spring.
    """
    robot = part.robot
    if not part.entry.actuator_springs:
        return part
    if not robot.actuators:
        raise InputError(
            "no actuator holds a position",
            where="springs of actuators",
            expected="<position> actuators of joints in an MJCF file",
        )
    springs = dict(robot.springs)
    for name, k in robot.actuators.items():
        own = springs[name].coefficients if name in springs else (0.0,)
        if len(own) > 1:
            raise InputError(f"joint {name!r} has a curved spring beside its actuator's")
        springs[name] = FileSpring((own[0] + k,), math.nan)
    springs, _ = on_leaders(springs, robot.followers)
    words = ", ".join(f"{name} {k:g}" for name, k in robot.actuators.items())
    message = (
        f"springs of position actuators, kp times gear squared [N m/rad, N/m]: {words}; "
        "their rest positions balance the load at the posture"
    )
    ignored = tuple(w for w in robot.ignored if not w.startswith(POSITION_ACTUATORS))
    return part.noting(
        [Note("actuator-springs", message, {"stiffness": robot.actuators})],
        robot=replace(robot, springs=springs, ignored=ignored),
    )


def leaders(part: Part) -> Part:
    """Take the joints that others follow by <mimic> where the file names these others.

    A follower has no coordinate of its own: it is driven, or moves freely, where its
    leader does, and its place is that of its leader.

    Raises
    ------
    InputError
        For a spring or a zero of a follower, and for places that do not agree.
    """
    entry, rules = part.entry, led_joints(part)
    _check_followers(part, rules)
    lists = [*filter(partial(hasattr, entry), ("actuated", "passive"))]
    named = [name for key in (*lists, "q") for name in getattr(entry, key)]
    if not (led := {name: rules[name][0] for name in named if name in rules}):
        return part
    changed = {key: [led.get(n, n) for n in getattr(entry, key)] for key in lists}
    changed = {key: [*dict.fromkeys(names)] for key, names in changed.items()}
    entry = entry.model_copy(update={**changed, "q": _of_leaders(part, rules)})
    return part.noting([leaders_note(led)], entry=entry)


def _check_followers(part: Part, rules: Followers) -> None:
    """Refuse springs and zeros of followers."""
    for key in ("springs", "zeros", "effort"):
        for name in rules.keys() & getattr(part.entry, key, {}).keys():
            leader, factor, offset = rules[name]
            raise InputError(
                f"joint {name!r} has no coordinate of its own: it follows {leader!r} by "
                "<mimic>",
                where=part.key(key),
                expected=f"{leader}, of which it is {factor:g} times the position, "
                f"plus {offset:g}",
            )


def _of_leaders(part: Part, rules: Followers) -> dict[str, float]:
    """Positions of an entry's `q` with those of followers as their leaders'."""
    given = part.entry.q
    q = {name: value for name, value in given.items() if name not in rules}
    for name in given.keys() & rules.keys():
        leader, factor, offset = rules[name]
        _agreed(q, name, leader, (given[name] - offset) / factor, part.key("q"))
    return q


def _agreed(
    places: dict[str, float], follower: str, leader: str, place: float, where: str
) -> None:
    """Put a leader where its follower wants it; refuse another place that it has."""
    if abs(places.setdefault(leader, place) - place) > numerics.NEGLIGIBLE_SHARE:
        raise InputError(
            f"joint {follower!r} follows {leader!r}, and the places of both do not agree",
            where=where,
            expected=f"{leader} at {place:g}, or one of them",
            got=f"{places[leader]:g}",
        )


def led_joints(part: Part) -> Followers:
    """Leader, factor and offset of the joints that follow another one of the robot."""
    names = set(part.robot.model.names)
    return {f: r for f, r in part.robot.leaders.items() if r[0] in names and r[1]}


def leaders_note(led: dict[str, str]) -> Note:
    """Return a note on the followers that a file names, with their leaders."""
    each = ", ".join(f"{name} follows {leader}" for name, leader in led.items())
    words = "joints of the file follow others by <mimic>, which are taken instead: "
    return Note("followers-named", words + each, {"leaders": led})


def own_loops(part: Part) -> Part:
    """Close the loops of the robot's own file, where they are:
    alone those that move the frame.
    """
    moving = set(part.robot.model.names)
    if part.alone:
        moving = joints_that_move(part.robot, part.frame)
    ties = tuple(tie for tie in part.robot.closures if tie.joints & moving)
    if part.alone and ties:
        return replace(part, kind="closed-chain", ties=ties)
    return replace(part, ties=ties) if part.kind == "closed-chain" else part


def cut(part: Part) -> Part:
    """Keep the joints that act, as a plain tree.

    Fix the others where the file has them.
    """
    robot, entry, notes = part.robot, part.entry, list[Note]()
    names = list(robot.model.names)
    posture = {**robot.posture, **part.posture, **entry.q}
    for joint, zero in getattr(entry, "zeros", {}).items():
        posture[joint] = posture.get(joint, 0.0) + zero
    still, keep = _locked(part), _kept(part)
    keep |= {rule[0] for name, rule in robot.leaders.items() if name in keep} & {*names}
    follows: Followers = {}
    for follower, rule in robot.leaders.items():
        leader, factor, offset = rule
        if follower in still or follower not in names:
            continue
        if leader in keep and leader not in still:
            # The mass on a follower elsewhere moves with its leader, too.
            follows[follower] = rule
            keep.add(follower)
        elif leader in names:
            place = still.get(leader, posture.get(leader, 0.0))
            still[follower] = factor * place + offset
        elif follower in keep:
            words = f"joint {follower!r} mimics {leader!r}, which does not exist: "
            words += "it is taken as a joint of its own"
            notes.append(Note("mimic-ignored", words))
    if unseen := [n for n in entry.locked if n in keep and n in robot.efforts]:
        words = (
            "locked, so that their drives are not compared with their limits: "
            f"{', '.join(unseen)}; springs with stiffness 'rigid' in place of locks are"
        )
        notes.append(Note("locked-drives", words, {"joints": unseen}))
    tree = _tree(part, keep, still, posture)
    if tree.n == 0 and part.kind == "serial":
        raise InputError(
            f"no joint moves frame {part.frame!r}", expected="a frame on a moving link"
        )
    if follows:
        tree, more = _following(tree, follows)
        notes += more
    return part.noting(notes, tree=tree)


def _tree(
    part: Part,
    keep: set[str],
    still: Mapping[str, float],
    posture: Mapping[str, float],
) -> KinematicTree:
    """The plain tree of some joints; the others are held, with the masses on them.

    They are where they are `still`, else in the file's posture.
    """
    robot = part.robot
    number = {name: j for j, name in enumerate(robot.model.names)}
    others = {n: x for n, x in posture.items() if n in number and n not in keep}
    fixed = {number[name]: x for name, x in {**others, **still}.items()}
    kept = {number[name] for name in keep}
    return plain_tree(robot.model, kept, fixed, part.gives(), robot.planar_axes)


def _locked(part: Part) -> dict[str, float]:
    """Positions of joints that are held; a locked follower locks its leader."""
    names = list(part.robot.model.names)
    still = {**part.robot.locked, **part.entry.locked}
    for follower, (leader, factor, offset) in part.robot.leaders.items():
        if not (follower in still and leader in names and factor):
            continue
        place = (still[follower] - offset) / factor
        _agreed(still, follower, leader, place, part.key("locked"))
    for name in still:
        check_name("joint", name, names[1:], part.key("locked"))
    return still


def _kept(part: Part) -> set[str]:
    """Joints that move the frame and the ends of its lines,
    and those of loops that are closed.
    """
    robot, is_closed = part.robot, part.kind == "closed-chain"
    names = list(robot.model.names)[1:]
    if is_closed and not part.alone:
        return {*names} - robot.held
    keep = joints_that_move(robot, part.frame) if is_closed else set[str]()
    ends = {frame for line in part.lines for frame in line.frames} - {"world"}
    for end in {part.frame, *filter(robot.model.existFrame, ends)}:
        keep |= joints_to(robot, end)
    return (keep & {*names}) - robot.held


def _following(
    tree: KinematicTree, follows: Followers
) -> tuple[KinematicTree, list[Note]]:
    """The tree in which joints follow others, and notes on limits that contradict."""
    # The leaders are the coordinates; positions are a matrix times these, plus offsets.
    free = [c for c in tree.coordinates if c.name not in follows]
    column, notes = {c.name: i for i, c in enumerate(free)}, list[Note]()
    matrix, offsets = np.zeros((tree.n, len(free))), np.zeros(tree.n)
    for i, own in enumerate(tree.coordinates):
        leader, factor, offsets[i] = follows.get(own.name, (own.name, 1.0, 0.0))
        matrix[i, j := column[leader]] = factor
        if own.name not in follows or not factor:
            continue
        # A follower's limits are limits of its leader, too.
        limits = ((own.lower - offsets[i]) / factor, (own.upper - offsets[i]) / factor)
        low, high = max(min(limits), free[j].lower), min(max(limits), free[j].upper)
        if low < high:
            free[j] = replace(free[j], lower=low, upper=high)
            continue
        words = f"limits of joint {own.name!r} leave nothing of those of {leader!r}, "
        words += "which it follows: they do not count"
        values = {"joint": own.name, "leader": leader}
        notes.append(Note("limits-contradict", words, values))
    if tree.mimic is not None:
        matrix, offsets = tree.mimic @ matrix, tree.mimic @ offsets
    whole = KinematicTree(tree.model, tuple(free), tree.given_frames, matrix, offsets)
    return whole, notes


def without_beyond(part: Part) -> Part:
    """Leave out what the file says of joints that could move and do not
    move the frame.
    """
    robot, entry = part.robot, part.entry
    kept = {*part.tree.names, *robot.followers, *robot.locked, *entry.locked}
    pairs = zip(robot.model.names, robot.model.nvs, strict=True)
    beyond = tuple(str(name) for name, nv in pairs if nv == 1 and name not in kept)
    acting: dict[str, Any] = {"passive": [n for n in entry.passive if n not in beyond]}
    for key in {"q", "springs", "zeros", "effort"}.intersection(type(entry).model_fields):
        values = getattr(entry, key)
        acting[key] = {name: x for name, x in values.items() if name not in beyond}
    idle = tuple(filter(beyond.__contains__, entry.springs))
    entry = entry.model_copy(update=acting)
    return replace(part, entry=entry, beyond=beyond, idle=idle)


# Limits of a joint [rad] that look like degrees; larger ones mean that there is no limit.
_LIMITS_LIKE_DEGREES = (40.0, 1000.0)


def checks(part: Part) -> Part:
    """Add notes on what a robot's file has without effect, its posture,
    masses and limits.

    Raises
    ------
    InputError
        If something that cannot be expressed acts on a joint of the tree, or is wrong
        with it.
    """
    robot, notes = part.robot, [*part.robot.notes]
    ignored = [*robot.ignored, *_without_effect(part)]
    if ignored:
        words = f"parts of the robot's file play no part: {'; '.join(ignored)}"
        notes.append(Note("ignored", words))
    if robot.keyframe is not None:
        words = f"the default posture is keyframe {robot.keyframe!r} of the MJCF file"
        notes.append(Note("keyframe", words))
    if robot.weightless:
        words = f"taken as zero, since it is not known: {'; '.join(robot.weightless)}"
        notes.append(Note("masses-unknown", words))
    least, most = _LIMITS_LIKE_DEGREES
    wide = {
        c.name: [c.lower, c.upper]
        for c in part.tree.coordinates
        if not c.is_length and least < max(-c.lower, c.upper) < most
    }
    if wide:
        each = ", ".join(f"{n} {low:g} ... {high:g}" for n, (low, high) in wide.items())
        words = (
            f"limits of several turns: {each} rad. Degrees? Limits in URDF are in radians"
        )
        notes.append(Note("limits-of-turns", words, wide))
    return part.noting(notes)


def _without_effect(part: Part) -> list[str]:
    """Parts of the robot's file that act on no joint of the tree;
    refuse one that does.
    """
    robot = part.robot
    # A joint with several coordinates has become several: joint.x, joint.y, ...
    names = part.tree.model.names
    moving = {one for name in names for one in (name, name.rpartition(".")[0])}
    open_loops = [
        Obstacle(f"the {t.type} tie of bodies {t.body_a!r} and {t.body_b!r}", t.joints)
        for t in robot.closures
        if part.kind != "closed-chain" or not t.joints & moving
    ]
    obstacles = [*robot.obstacles, *open_loops]
    for obstacle in obstacles:
        if obstacle.joints & moving and part.keys.isdisjoint(obstacle.keys):
            raise obstacle.refusal(moving, robot.path)
    return [obstacle.what for obstacle in obstacles]


def posture(part: Part) -> Part:
    """Place the joints where the file says, or the robot's own file."""
    q = default_posture(part.tree, part.entry.q, part.robot, part.posture)
    return replace(part, q=q)


# Joints of contacts: those with springs, then those that are free.
_SOFT_CONTACT = (("contact.tx", "PX"), ("contact.ty", "PY"), ("contact.tz", "PZ"))
_CONTACTS = {
    "rigid": (),
    "soft-finger": (("contact.z", "RZ"),),
    "point": (("contact.x", "RX"), ("contact.y", "RY"), ("contact.z", "RZ")),
}


def contact(part: Part) -> Part:
    """Add the joints of a leg's contact with the body, those with springs first.

    They are along the contact's axes; frame "contact" is parallel to the leg's end at
    zero.
    """
    leg = part.entry
    if getattr(leg, "contact", "rigid") == "rigid":
        return part
    soft = {name: FileSpring((k,), math.nan) for name, k in leg.contact_springs.items()}
    joints = [(name, kind) for name, kind in _SOFT_CONTACT if name in soft]
    joints += _CONTACTS[leg.contact]
    given, tree = leg.contact_stiffness, part.tree
    if given is None or not any(given.rpy):
        tree = extended(tree, part.frame, joints, "contact")
    else:
        turn = se3.from_roll_pitch_yaw([0.0, 0.0, 0.0], given.rpy)
        placed_frame(tree, "contact axes", part.frame, turn)
        tree = extended(tree, "contact axes", joints, "turned contact")
        placed_frame(tree, "contact", "turned contact", se3.inverse(turn))
    q = np.append(part.q, [leg.q.get(name, 0.0) for name, _ in joints])
    free = tuple(name for name, _ in _CONTACTS[leg.contact] if name not in soft)
    springs = {**part.robot.springs, **soft}
    robot = replace(part.robot, springs=springs)
    return replace(part, tree=tree, q=q, frame="contact", free=free, robot=robot)


# -- joints beside the chain -------------------------------------------------------------

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
    names = [n for n in robot.model.names[1:] if n not in hands and not is_finger(n)]
    away = [*filterfalse({*kept, *robot.followers}.__contains__, names)]
    own = [n for n in away if n in robot.springs]
    notes = idle_springs([*dict.fromkeys([*part.idle, *own])], frame)
    if not FEET.search(frame) and "hand" not in str(robot.model.name).lower():
        notes += _open_loops(part, names, away)
    return part.noting(notes)


def _open_loops(part: Part, names: list[str], away: list[str]) -> list[Note]:
    """Return a note where the chain to the frame may be one leg of several.

    `names` are all joints that might hold the frame, `away` those off the chain.
    """
    robot, frame, kept = part.robot, part.frame, part.tree.names
    end = int(find_frame(robot.model, frame).parentJoint)
    equal = equal_chains(robot.model, end)
    chains = [c for c in equal if {*names}.issuperset(c) and c[0] not in kept]
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
        return []
    words += (
        f", and joints beside it do not act: {_listed(joints)}. If they hold the same "
        "body in the real machine, this is the answer of one leg alone: name its loops "
        "under 'closures' in a mechanism file of kind closed-chain"
    )
    return [Note("open-loops", words, {"frame": frame, "joints": joints})]


def idle_springs(joints: Sequence[str], frame: str, place: str = "") -> list[Note]:
    """Return a note that names joints with springs that do not move the frame;
    none without any.
    """
    if not joints:
        return []
    what, end = f"{len(joints)} joints with springs are", "do"
    if len(joints) == 1:
        what, end = "1 joint with a spring is", "does"
    words = f"{place}{what} not on the chain to {frame!r} and {end} not act: "
    words += _listed(joints)
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
