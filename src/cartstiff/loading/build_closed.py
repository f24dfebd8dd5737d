"""Elastic mechanisms with loops: a body carried by several chains, a tree with closures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from cartstiff.arrays import fixed
from cartstiff.errors import ConvergenceError, InputError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.assembly import leg_at_pose
from cartstiff.loading.defaults import chosen_frame, default_posture
from cartstiff.loading.key_types import pose_of
from cartstiff.loading.parts import (
    add_payload,
    described,
    description_notes,
    gravity_left_out,
    joints_that_move,
    put_together,
    tree_to,
)
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.loading.robot_facts import FileClosure, FileSpring, Lifted, RobotFacts
from cartstiff.loading.springs import link_springs, springs_of, virtual_joints
from cartstiff.mechanisms.chain import Chain, Closure, Description
from cartstiff.mechanisms.closures import ReferencePosture
from cartstiff.mechanisms.elastic import ElasticMechanism, adjusted
from cartstiff.mechanisms.leg_shapes import PlacedLeg
from cartstiff.mechanisms.tree import FixedFrame, KinematicTree
from cartstiff.mechanisms.tree_building import extended, merged
from cartstiff.notes import Note

if TYPE_CHECKING:
    from cartstiff.loading.schema import (
        ClosedChainFile,
        ClosureModel,
        JointSpringModel,
        LegModel,
        ParallelFile,
    )

_CONTACTS = {
    "rigid": (),
    "soft-finger": (("contact.z", "RZ"),),
    "point": (("contact.x", "RX"), ("contact.y", "RY"), ("contact.z", "RZ")),
}


def _with_frame(tree: KinematicTree, name: str, base: str, T: Array) -> None:
    at = tree.placement(base)
    tree.frames[name] = FixedFrame(at.joint, at.T_j_f @ T)


def _actuated(names: Sequence[str], tree: KinematicTree, where: str) -> list[int] | None:
    known = [c.name for c in tree.coordinates]
    for name in names:
        if name not in known:
            raise UnknownNameError("joint", name, known, where=f"{where}, key actuated")
    if len(set(names)) != len(names):
        raise InputError("a joint stands twice under actuated", where=where)
    return [known.index(name) for name in names] or None


def _indices(names: Sequence[str], tree: KinematicTree) -> list[int]:
    known = [c.name for c in tree.coordinates]
    return [known.index(name) for name in names]


def _assembled(
    chain: Chain, q: Array, posture: Mapping[str, float], where: str, notes: list[Note]
) -> Array:
    """Closed coordinates near q; where no joint is actuated, those that the file names are held."""
    named = [] if chain.actuated else [chain.names.index(name) for name in posture]
    try:
        at = chain.closed(q, named=named)
    except ConvergenceError as error:
        raise InputError(f"{error}", where=where, expected="a posture near a closed one") from None
    chain.home = ReferencePosture(at.q, chain.held, at.coordinate_lengths)
    if len(named) < len(q):  # else they are where the search starts
        notes += adjusted(chain, q, at.q, named)
    return at.q


def build_parallel(
    file: ParallelFile, beside: Path | None, where: str, name: str
) -> ElasticMechanism:
    """One body carried by several chains: the end frames of all chains are welded together.

    The body frame hangs on the first chain; every other chain's end is welded to it.
    """
    from cartstiff.loading.legs import drawn_legs

    notes: list[Note] = []
    parts: list[tuple[str, KinematicTree, Array]] = []
    ends: list[str] = []
    springs: dict[str, JointSpringModel] = {}
    passive: list[str] = []
    virtual: list[str] = []
    contacts: list[str] = []
    driven: list[str] = []
    posture: dict[str, float] = {}
    soft: list[tuple[int, LegModel]] = []
    descriptions: list[Description] = []
    file_springs: dict[str, FileSpring] = {}
    file_passive: list[str] = []
    drawn: dict[str, float] = {}
    lifted: list[Lifted] = []
    legs = drawn_legs(file)
    for i, leg in enumerate(legs):
        prefix, place = f"leg{i + 1}/", f"{where}, leg {i + 1}"
        drawing = leg.drawing
        description = described(leg, beside) if drawing is None else drawing.description
        end = chosen_frame(description, leg.frame, place, notes, f"leg {i + 1}: ")
        tree = tree_to(description, [end], leg.locked, place, notes, leg.flexible)
        notes += description_notes(description, tree, leg.model_fields_set)
        if leg.contact != "rigid":
            tree = extended(tree, end, _CONTACTS[leg.contact], "contact")
            end = "contact"
            contacts += [f"{prefix}{joint}" for joint, _ in _CONTACTS[leg.contact]]
        names = [c.name for c in tree.coordinates]
        for entries, key in ((leg.springs, "springs"), (leg.passive, "passive"), (leg.q, "q")):
            for joint in entries:
                if joint not in names:
                    raise UnknownNameError("joint", joint, names, where=f"{place}, key {key}")
        springs |= {prefix + joint: entry for joint, entry in leg.springs.items()}
        passive += [prefix + joint for joint in leg.passive]
        posture |= {prefix + joint: value for joint, value in leg.q.items()}
        virtual += virtual_joints(leg.flexible, prefix)
        soft.append((i, leg))
        parts.append((prefix, tree, pose_of(leg.base)))
        facts = description.facts
        file_springs |= {prefix + joint: spring for joint, spring in facts.springs.items()}
        file_passive += [prefix + joint for joint in facts.passive]
        drawn |= {prefix + joint: value for joint, value in facts.posture.items()}
        driven += [prefix + joint for joint in facts.actuated if joint in names]
        lifted += [replace(part, body=prefix + part.body) for part in facts.lifted]
        descriptions.append(description.shown(prefix))
        ends.append(prefix + end)
    tree = merged(parts)
    body = [f"body of leg {i + 1}" for i in range(len(ends))]
    offset = pose_of(file.offset)
    grips = [se3.inverse(offset) @ pose_of(leg.grip) for leg in legs]  # in M
    for frame, end, grip in zip(body, ends, grips, strict=True):
        _with_frame(tree, frame, end, se3.inverse(grip))
    chain = Chain(
        tree,
        body[0],
        closures=[Closure(body[0], other, "weld") for other in body[1:]],
        actuated=_actuated(file.actuated, tree, where),
        virtual=_indices(virtual, tree),
        kind="parallel",
        descriptions=descriptions,
    )
    chain.frame, chain.frame_offset = "body", fixed(offset)
    chain.legs = _placed(legs, grips, [c.name for c in tree.coordinates])
    add_payload(tree, chain, file.payload)
    facts = RobotFacts(file_springs, tuple(file_passive), posture=drawn)
    q = default_posture(tree, posture, where, facts=facts)
    if file.pose is not None:
        start = 0
        for i, (leg, (prefix, part, T_F_root)) in enumerate(zip(legs, parts, strict=True)):
            own = slice(start, start + part.n)
            start += part.n
            if leg.drawing is not None:
                continue  # it was drawn there
            q[own] = leg_at_pose(
                part,
                ends[i].removeprefix(prefix),
                se3.inverse(grips[i]),
                se3.inverse(T_F_root) @ pose_of(file.pose) @ offset,
                q[own],
                [j for j, c in enumerate(part.coordinates) if prefix + c.name in virtual],
                where,
                f"leg {i + 1}",
            )
    q = _assembled(chain, q, posture, where, notes)
    joint_springs, assumed = springs_of(
        springs,
        passive,
        tree,
        facts,
        where,
        virtual=[*virtual, *contacts],
        actuated=file.actuated or driven,
    )
    links = [
        spring
        for i, leg in soft
        for spring in link_springs(leg.flexible, tree, where, f"leg{i + 1}/")
    ]
    notes += assumed
    return put_together(file, name, chain, q, joint_springs, links, notes, where, lifted, springs)


def _placed(
    legs: Sequence[LegModel], grips: Sequence[Array], names: Sequence[str]
) -> tuple[PlacedLeg, ...]:
    """The legs that have been drawn from their names, among a chain's coordinates."""
    placed = []
    for i, leg in enumerate(legs):
        if (drawing := leg.drawing) is not None:
            at = {name: names.index(f"leg{i + 1}/{name}") for name in drawing.joints}
            placed.append(
                PlacedLeg(
                    drawing.shape,
                    tuple(at.values()),
                    at[drawing.driven],
                    grips[i],
                    drawing.diameter,
                )
            )
    return tuple(placed)


def build_closed_chain(
    file: ClosedChainFile, beside: Path | None, where: str, name: str
) -> ElasticMechanism:
    """A tree whose frames are tied by closures, from a file or from MJCF equalities."""
    description = described(file, beside, floating=file.floating)
    notes = gravity_left_out(file, description)
    return closed_chain_of(description, file, where, name, said=notes)


def closed_chain_of(
    description: RobotDescription,
    file: ClosedChainFile,
    where: str,
    name: str,
    posture: Mapping[str, float] | None = None,
    said: Sequence[Note] = (),
    alone: bool = False,
) -> ElasticMechanism:
    """`build_closed_chain` for a robot description that has been read; see `serial_of`.

    With `alone` there is only the description: joints that do not move the frame are left out, and
    its own actuators drive the chain.
    """
    notes, facts = [*said], description.facts
    frame = chosen_frame(description, file.frame, where, notes)
    moving = joints_that_move(description, frame) if alone else set(description.model.names)
    ends = [frame] if alone else None
    tree = tree_to(description, ends, file.locked, where, notes, file.flexible, moving)
    left = {c.name for c in tree.coordinates}
    ties = [tie for tie in facts.closures if tie.joints & moving]
    closures = [_mjcf_closure(tie, i, tree) for i, tie in enumerate(ties)]
    driven = [n for n in facts.actuated if n in left]
    actuated = driven if alone else file.actuated
    q = default_posture(tree, file.q, where, posture, facts)
    closures += [_closure(entry, i, tree, q, where) for i, entry in enumerate(file.closures)]
    virtual = virtual_joints(file.flexible)
    chain = Chain(
        tree,
        frame,
        offset=pose_of(file.offset),
        closures=closures,
        actuated=_actuated(actuated, tree, where),
        virtual=_indices(virtual, tree),
        kind="closed-chain",
        descriptions=[description.shown()],
    )
    add_payload(tree, chain, file.payload)
    q = _assembled(chain, q, file.q, where, notes)
    springs, assumed = springs_of(
        file.springs,
        file.passive,
        tree,
        facts,
        where,
        virtual=virtual,
        actuated=None if alone else file.actuated or driven,
    )
    links = link_springs(file.flexible, tree, where)
    notes += description_notes(description, tree, file.model_fields_set, closed=True)
    notes += assumed
    return put_together(
        file, name, chain, q, springs, links, notes, where, facts.lifted, file.springs
    )


def _closure(entry: ClosureModel, i: int, tree: KinematicTree, q: Array, where: str) -> Closure:
    """Closure of a file's entry; without points a frame is tied to "world" where it is at q."""
    place = f"{where}, closure {i + 1}"
    for frame in entry.frames:
        if frame not in tree.frames:
            raise UnknownNameError("frame", frame, tree.frames, where=place)
    a, b = entry.frames
    if a == b:
        raise InputError("a closure ties a frame to itself", where=place, got=repr(a))
    if entry.points is not None:
        names = []
        for frame, point in zip((a, b), entry.points, strict=True):
            tied = f"{frame} (closure {i + 1})"
            _with_frame(tree, tied, frame, se3.pose(translation=point))
            names.append(tied)
        a, b = names
    elif "world" in (a, b):
        other = b if a == "world" else a
        T_F_other = tree.at(q).pose(tree.placement(other))
        tied = f"world (closure {i + 1})"
        tree.frames[tied] = FixedFrame(0, T_F_other)
        a, b = (tied, other) if a == "world" else (other, tied)
    return Closure(a, b, entry.type)


def _mjcf_closure(tie: FileClosure, i: int, tree: KinematicTree) -> Closure:
    a, b = f"{tie.body_a} (equality {i + 1})", f"{tie.body_b} (equality {i + 1})"
    _with_frame(tree, a, tie.body_a, tie.T_a)
    _with_frame(tree, b, tie.body_b, tie.T_b)
    return Closure(a, b, tie.type)
