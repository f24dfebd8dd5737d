"""From robots, and what a mechanism file says of them, to a mechanism:
one list of passes.

A pass is a small function that returns a `Part` or an `Assembly` changed, with its notes.
A new key of the mechanism file is one more pass, or one more line of the pass whose
subject it belongs to.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import fixed
from cartstiff.errors import InputError, check_name
from cartstiff.loading.assembly import Assembly, Part
from cartstiff.loading.branches import beside
from cartstiff.loading.closing import (
    check_joints,
    closed,
    joined,
    legs_at_pose,
    placed_legs,
    welded,
)
from cartstiff.loading.description import RobotDescription
from cartstiff.loading.frames import default_frame
from cartstiff.loading.joints import (
    acting_lines,
    actuator_springs,
    checks,
    contact,
    cut,
    held_base,
    leaders,
    named_frame,
    own_loops,
    posture,
    without_beyond,
)
from cartstiff.loading.postures import assembled, regular_posture
from cartstiff.loading.readers import robot_of
from cartstiff.loading.schema import pose_of
from cartstiff.loading.springs import coupled, joint_springs, lines, link_checks, links
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.tree import FixedFrame
from cartstiff.notes import Note
from cartstiff.potentials.loads import DeadForce


def names_of_keys(whole: Assembly) -> Assembly:
    """Refuse names of joints that do not exist, of each tree."""
    for part in whole.parts:
        for key in ("q", "springs", "passive"):
            check_joints(part, key, whole.tree)
    return whole


def names_of_drives(whole: Assembly) -> Assembly:
    """Refuse actuated joints that do not exist, or stand twice in the file."""
    for name in whole.actuated:
        check_name("joint", name, whole.tree.names, "key actuated")
    named = getattr(whole.file, "actuated", ())
    if len({*named}) != len(named):
        raise InputError("a joint stands twice", where="key actuated")
    return whole


def chain(whole: Assembly) -> Assembly:
    """Make the mechanism of the joints, the frame of interest and the loops."""
    names, virtual = whole.tree.names, {*whole.virtual()}
    first, is_parallel = whole.parts[0], whole.kind == "parallel"
    offset = pose_of(whole.file.offset)
    made = Chain(
        whole.tree,
        whole.frame,
        offset=None if is_parallel else offset,
        closures=whole.closures,
        actuated=[names.index(name) for name in whole.actuated] or None,
        virtual=[c for c, name in enumerate(names) if name in virtual],
        kind=whole.kind,
        descriptions=[part.robot.shown(part.prefix) for part in whole.parts],
    )
    if is_parallel:
        made.units = whole.units
        made.frame, made.frame_offset = "body", fixed(offset)
        made.legs = placed_legs(whole)
    else:
        made.base_pose = fixed(first.base)
    return replace(whole, chain=made)


def payload(whole: Assembly) -> Assembly:
    """Hang the payload on the body, or on the file's own frame where M is elsewhere."""
    hung, carrier, first = whole.file.payload, None, whole.parts[0]
    if hung is None:
        return whole
    if hung.carrier is not None:
        frame, offset = hung.carrier
        at = whole.tree.placement(frame or default_frame(first.robot)[0])
        carrier = FixedFrame(at.joint, at.T_j_f @ pose_of(offset))
    if not hung.mass > 0:
        return whole
    chain = whole.chain.with_mass(hung.mass, np.array(hung.com), carrier)
    return replace(whole, chain=chain, tree=chain.tree)


def home(whole: Assembly) -> Assembly:
    """Close the loops near the default posture; move an arm out of a singular one."""
    if whole.kind != "serial":
        given = whole.named(lambda part: part.entry.q)
        q, notes = assembled(whole.chain, whole.q, given)
        return whole.noting(notes, q=q)
    (part,) = whole.parts
    robot, supports = part.robot, part.robot.model.supports
    if part.entry.q or part.posture or robot.keyframe is not None or part.has_rest:
        return whole
    alone = len({int(support[1]) for support in supports if len(support) > 1}) == 1
    q, chosen = regular_posture(whole.chain, whole.q, alone=alone)
    return whole.noting(chosen, q=q)


def lifted(whole: Assembly) -> Assembly:
    """Add the parts of masses that weigh nothing, by the gravity compensation of MJCF."""
    forces = [
        DeadForce(np.zeros(3), one.point, part.called(one.body), lifted=one.mass)
        for part in whole.parts
        for one in part.robot.lifted
        if whole.tree.placement(part.called(one.body)).joint > 0
    ]
    return replace(whole, potentials=(*whole.potentials, *forces))


def damping(whole: Assembly) -> Assembly:
    """Put dampers in the joints: those of entries,
    else those of the robots' own files.
    """
    M, damping = whole.tree.mimic, np.array(whole.tree.model.damping, float).reshape(-1)
    if M is not None:
        damping = np.asarray((M * M).T @ damping)  # followers turn by their factor
    entries = whole.named(lambda part: part.entry.springs)
    for i, name in enumerate(whole.tree.names):
        if name in entries and entries[name].damping is not None:
            damping[i] = entries[name].damping
    return replace(whole, damping=damping if damping.any() else None)


def free_joints(whole: Assembly) -> Assembly:
    """Name the joints without a spring.

    Add a note where none has one and nothing else holds.
    """
    chain, springs = whole.chain, whole.springs
    passive = frozenset(np.flatnonzero(springs.is_passive).tolist())
    chain.undriven = passive - springs.rigid
    if whole.potentials or len(chain.undriven) < whole.tree.n:
        return whole
    words = (
        "no joint has a spring, and none is named as actuated, so all move freely: "
        f"{', '.join(chain.names)}. Which are actuated? Give --stiffness joint=value, or "
        "'actuated' or 'springs' in the mechanism file"
    )
    return whole.noting([Note("springs-missing", words, {"joints": list(chain.names)})])


#: From a robot to the tree of the joints that act; each pass for each robot.
OF_ROBOT: tuple[Callable[[Part], Part], ...] = (
    named_frame,
    acting_lines,
    held_base,
    actuator_springs,
    leaders,
    own_loops,
    cut,
    without_beyond,
    checks,
    beside,
    posture,
    contact,
)
#: From trees to a mechanism, its springs and masses.
OF_MECHANISM: tuple[Callable[[Assembly], Assembly], ...] = (
    joined,
    closed,
    names_of_keys,
    legs_at_pose,
    welded,
    names_of_drives,
    chain,
    payload,
    home,
    links,
    coupled,
    joint_springs,
    link_checks,
    lines,
    free_joints,
    lifted,
    damping,
)


def mechanism(whole: Assembly) -> ElasticMechanism:
    """Take an assembly through all passes, and put it under the file's gravity."""
    parts = []
    for part in whole.parts:
        for step in OF_ROBOT:
            part = step(part)
        parts.append(part)
        whole = whole.noting(part.notes)
    whole = replace(whole, parts=tuple(parts))
    for one in OF_MECHANISM:
        whole = one(whole)
    elastic = ElasticMechanism(
        whole.name,
        whole.chain,
        whole.q,
        whole.springs,
        whole.potentials,
        notes=whole.notes,
        damping=whole.damping,
        beyond=() if whole.kind == "parallel" else parts[0].beyond,
    )
    elastic = elastic.with_gravity(whole.file.gravity, where="key gravity")
    return elastic.with_notes(*_repeated_conditions(elastic, len(whole.free)))


def _repeated_conditions(elastic: ElasticMechanism, own: int) -> list[Note]:
    """Return a note where closures with `own` coordinates have dependent conditions."""
    at = elastic.mechanism.at(elastic.q)
    closure, residual = at.closure, at.residual
    is_chain = elastic.mechanism.kind == "closed-chain"
    if not (own and is_chain) or closure is None or residual is None:
        return []
    if closure.sizes is None:
        return []
    rows = closure.jacobian * at.coordinate_lengths / closure.sizes[:, None]
    m = len(residual)
    more = m - numerics.rank(numerics.singular_values(rows[:m]))
    if not more:
        return []
    words = (
        f"{more} of the {m - own} conditions of the closures repeat others here, as in "
        "planar "
        "loops of hinges: the motions do not change, but the forces and moments in the "
        "loop "
        "that answer to them are not determined between rigid links"
    )
    values = {"conditions": m - own, "repeated": more}
    return [Note("repeated-closures", words, values)]


def gravity_left_out(file: Any, part: Part) -> list[Note]:
    """Return a note where a mechanism file has no gravity and its MJCF file has one."""
    gravity = part.robot.gravity
    if gravity is None or file.gravity is not None:
        return []
    shown = ", ".join(f"{g:g}" for g in gravity)
    words = (
        f"the mechanism file names no gravity: that of the MJCF file ({shown}) is "
        "left out"
    )
    values = {"gravity": gravity.tolist()}
    return [Note("gravity-left-out", part.says(words), values)]


def one_robot(
    robot: RobotDescription, file: Any, name: str, notes: Sequence[Note] = (), **how: Any
) -> ElasticMechanism:
    """Build a serial arm or a closed chain from a robot that has been read.

    Parameters
    ----------
    robot : RobotDescription
        The robot.
    file : SerialFile or ClosedChainFile
        Its frame, springs, loads and so on.
    name : str
        The mechanism's name.
    notes : sequence of Note
        Notes that come before all others.
    **how
        `alone` and `posture` of `Part`.
    """
    return mechanism(Assembly(file, name, (Part.of(file, robot, **how),), tuple(notes)))


def build(file: Any, beside: Path | None, name: str) -> ElasticMechanism:
    """Build a serial arm, a closed chain, or a body carried by legs from a
    mechanism file.
    """
    if file.kind != "parallel":
        robot = robot_of(file, beside, getattr(file, "floating", False))
        notes = gravity_left_out(file, Part(file, robot))
        return one_robot(robot, file, name, notes)
    from cartstiff.loading.legs import drawn_legs, mode_notes

    legs, parts = drawn_legs(file), []
    for number, leg in enumerate(legs, start=1):
        drawing = leg.drawing
        robot = robot_of(leg, beside) if drawing is None else drawing.description
        part = Part.of(leg, robot, kind="parallel", number=number)
        parts.append(part.noting(gravity_left_out(file, part)))
    whole = Assembly(file, name, tuple(parts), lines=tuple(file.lines))
    return mechanism(whole.noting(mode_notes(legs)))
