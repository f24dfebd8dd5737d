"""From robots, and what a mechanism file says of them, to a mechanism:
one list of passes.

A pass is a small function that returns a `Part` or an `Assembly` changed, with its notes.
A new key of the mechanism file is one more pass, or one more line of the pass whose
subject it belongs to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, fixed
from cartstiff.core.errors import InputError, UndefinedError, check_name
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain, Closure
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.given_springs import rest_of_turns
from cartstiff.core.mechanisms.tree import FixedFrame, KinematicTree
from cartstiff.core.notes import Note, assumed_stiffness, held_by_lines, table_as_read
from cartstiff.core.potentials.beams import Beam, Section
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.potentials.coupled_joints import CoupledJointSprings
from cartstiff.core.potentials.joint_springs import JointSprings
from cartstiff.core.potentials.link_springs import CoupledSprings
from cartstiff.core.potentials.spring_laws import PolynomialLaw, TabulatedLaw
from cartstiff.core.potentials.springs import SpringLaw
from cartstiff.core.units import Units, own_stiffness
from cartstiff.files.assembly import Assembly, Part, give_of, placed_frame
from cartstiff.files.bare import both_ways, pose_of
from cartstiff.files.description import (
    FileClosure,
    FileSpring,
    RobotDescription,
    turned_axes,
)
from cartstiff.files.frames import default_frame
from cartstiff.files.joints import (
    acting_lines,
    actuator_springs,
    beside,
    checks,
    contact,
    cut,
    held_base,
    leaders,
    leaders_note,
    led_joints,
    named_frame,
    own_loops,
    posture,
    without_beyond,
)
from cartstiff.files.plausible import large_strains
from cartstiff.files.postures import assembled, leg_at_pose, regular_posture
from cartstiff.files.readers import robot_of
from cartstiff.files.tree_building import extended, merged

if TYPE_CHECKING:
    from cartstiff.files.schema import BeamModel, ClosureModel, JointSpringModel
    from cartstiff.kinematics.leg_shapes import PlacedLeg

# -- where robots stand, and what ties them ----------------------------------------------


def joined(whole: Assembly) -> Assembly:
    """Put the robots where they stand in F, with the lines of their own files."""
    parts, lines = whole.parts, [*whole.lines]
    for part in parts:
        check_joints(part, "zeros", part.tree)
        for line in part.lines:
            frames = [part.called(name) for name in line.frames]
            lines.append(line.model_copy(update={"frames": frames}))
    tree = merged(
        [
            (p.prefix, p.tree.with_zeros(getattr(p.entry, "zeros", {})), p.base)
            for p in parts
        ]
    )
    q = np.concatenate([part.q for part in parts])
    free = tuple(whole.names(lambda part: part.free))
    frame = parts[0].frame
    return replace(whole, tree=tree, q=q, lines=tuple(lines), free=free, frame=frame)


def check_joints(part: Part, key: str, tree: KinematicTree) -> None:
    """Refuse a name under a key that is no joint of a tree."""
    names = [n.removeprefix(part.prefix) for n in tree.names if n.startswith(part.prefix)]
    for name in getattr(part.entry, key, ()):
        check_name("joint", name, names, part.key(key))


def grips(whole: Assembly) -> list[Array]:
    """Poses in M of the ends of the legs."""
    to_M = se3.inverse(pose_of(whole.file.offset))
    return [to_M @ pose_of(part.entry.grip) for part in whole.parts]


def legs_at_pose(whole: Assembly) -> Assembly:
    """Move the joints of legs to where the file's pose is.

    A leg by name is drawn there.
    """
    if whole.kind != "parallel" or whole.file.pose is None:
        return whole
    T_F_M = pose_of(whole.file.pose) @ pose_of(whole.file.offset)
    q = [
        part.q if part.entry.drawing else leg_at_pose(part, se3.inverse(grip), T_F_M)
        for part, grip in zip(whole.parts, grips(whole), strict=True)
    ]
    return replace(whole, q=np.concatenate(q))


def welded(whole: Assembly) -> Assembly:
    """Weld the ends of all legs to the body, which is fixed to the first of them."""
    if whole.kind != "parallel":
        return whole
    bodies = [f"body of leg {part.number}" for part in whole.parts]
    for body, part, grip in zip(bodies, whole.parts, grips(whole), strict=True):
        placed_frame(whole.tree, body, part.called(part.frame), se3.inverse(grip))
    leaders = whole.named(led_joints)
    led = {
        name: whole.leg_of(name).called(leaders[name][0])
        for name in whole.file.actuated
        if name in leaders
    }
    return whole.noting(
        [leaders_note(led)] if led else [],
        frame=bodies[0],
        closures=tuple(Closure(bodies[0], other, "weld") for other in bodies[1:]),
        actuated=tuple(dict.fromkeys(led.get(n, n) for n in whole.file.actuated)),
    )


def placed_legs(whole: Assembly) -> tuple[PlacedLeg, ...]:
    """Legs by name with the indices of their joints among the coordinates."""
    from cartstiff.kinematics.leg_shapes import PlacedLeg

    placed = []
    for part, grip in zip(whole.parts, grips(whole), strict=True):
        if (drawing := part.entry.drawing) is not None:
            at = {n: whole.tree.names.index(part.called(n)) for n in drawing.joints}
            columns, driven = tuple(at.values()), at[drawing.driven]
            placed.append(
                PlacedLeg(drawing.shape, columns, driven, grip, drawing.diameter)
            )
    return tuple(placed)


def closed(whole: Assembly) -> Assembly:
    """Close the loops of a closed chain: those of the robot's own file,
    then the entries.
    """
    if whole.kind != "closed-chain":
        return whole
    (part,) = whole.parts
    closing = _Closing(whole.tree, whole.q, part.entry.q)
    for i, tie in enumerate(part.ties):
        closing.add_tie(tie, i)
    for i, entry in enumerate(getattr(part.entry, "closures", ())):
        closing.add_entry(entry, i)
    actuated = tuple(getattr(part.entry, "actuated", ()))
    if part.alone:
        actuated = tuple(n for n in part.robot.actuated if n in part.tree.names)
    return replace(
        whole,
        tree=closing.tree,
        q=closing.q,
        closures=tuple(closing.closures),
        free=tuple(closing.joints),
        actuated=actuated,
    )


#: Axes of frame a about which a closure leaves joints free; synonyms of the other
#: closures.
_FREE_AXES = {"hinge": ("RX",), "universal": ("RX", "RY")}
_SYNONYMS = {"ball": "point", "rigid": "weld"}


class _Closing:
    """Adds closures to a tree, with the joints of hinges and universal joints.

    A hinge is a weld at the end of one more joint about x of frame a, a universal joint
    of two more, about x of frame a and y of frame b: five and four conditions on the
    other joints.

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
        """Tie frame b to frame a by a joint.

        Its own coordinates are named after the closure.
        """
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
        """Add a file's entry; without points a frame is tied to "world"
        where it is at q.
        """
        place, tree = f"key closures.{i + 1}", self.tree
        for frame in entry.frames:
            check_name("frame", frame, tree.frames, place)
        a, b = entry.frames
        if a == b:
            raise InputError("a closure ties a frame to itself", where=place, got=repr(a))
        if entry.points is None and "world" in (a, b):
            a, b = self._at_q(entry, i)
        if entry.points is not None or entry.type in _FREE_AXES:
            names = []
            points = entry.points or [[0.0] * 3] * 2
            turns = turned_axes(entry.type, entry.axes, place)
            for frame, point, R in zip((a, b), points, turns, strict=True):
                tied = f"{frame} (closure {i + 1})"
                placed_frame(tree, tied, frame, se3.pose(R, point))
                names.append(tied)
            a, b = names
        self.add(f"closure{i + 1}", a, b, entry.type)

    def _at_q(self, entry: ClosureModel, i: int) -> list[str]:
        """Frames of an entry with a frame of F at the other one in place of "world"."""
        tied, tree = f"world (closure {i + 1})", self.tree
        (other,) = {*entry.frames} - {"world"}
        T = tree.at(self.q).pose(tree.placement(other))
        if entry.axes is not None:  # these are along the axes of F
            T = se3.pose(translation=T[:3, 3])
        tree.frames[tied] = FixedFrame(0, T)
        return [tied if frame == "world" else frame for frame in entry.frames]

    def add_tie(self, tie: FileClosure, i: int) -> None:
        """Add a closure of the robot's own file."""
        a, b = f"{tie.body_a} (equality {i + 1})", f"{tie.body_b} (equality {i + 1})"
        placed_frame(self.tree, a, tie.body_a, tie.T_a)
        placed_frame(self.tree, b, tie.body_b, tie.T_b)
        self.add(f"equality{i + 1}", a, b, tie.type)


# -- springs in joints and links, and lines between frames -------------------------------

#: N m/rad (N/m): the joint stiffness that is assumed where none was given; a note says
#: so.
ASSUMED_STIFFNESS = 1.0e4


class _Spring(NamedTuple):
    """Spring in one joint; without stiffness and law the joint moves freely."""

    stiffness: float = 0.0
    rest: float = np.nan
    law: SpringLaw | None = None


def _given(entry: JointSpringModel, units: Units, slides: bool, where: str) -> _Spring:
    """Spring of an entry of a mechanism file."""
    k = 0.0
    law: SpringLaw | None = None
    if entry.stiffness is not None:
        k = own_stiffness(entry.stiffness, units, slides, f"{where}.stiffness")
    elif entry.polynomial is not None:
        first, *more = entry.polynomial
        first = own_stiffness(first, units, slides, f"{where}.polynomial")
        law = PolynomialLaw((first, *more))
    elif (table := entry.points) is not None:
        x, y = np.array(table.points).T
        law = TabulatedLaw(tuple(x.tolist()), tuple(y.tolist()), table.pieces)
    is_spring = k != 0.0 or law is not None
    open_rest = np.nan if is_spring else 0.0
    return _Spring(k, open_rest if entry.rest is None else entry.rest, law)


def _own(spring: FileSpring) -> _Spring:
    """Spring of the robot's own file."""
    if len(spring.coefficients) > 1:
        return _Spring(rest=spring.rest, law=PolynomialLaw(spring.coefficients))
    return _Spring(spring.coefficients[0], spring.rest)


def joint_springs(whole: Assembly) -> Assembly:
    """Put a spring into each joint that has an entry, a spring of its own file,
    or is driven.

    Of the joints without either the driven ones get an assumed spring, which a note
    before all others says; the others move freely.
    """
    entries = whole.named(lambda part: part.entry.springs)
    own = whole.named(lambda part: part.robot.springs)
    roles = _roles(whole, {*entries}, {*own})
    of = {role: [n for n, r in roles.items() if r == role] for role in roles.values()}
    if entries and whole.kind == "serial" and "assumed" in of:
        raise InputError(
            f"joint {of['assumed'][0]!r} has no spring",
            expected="an entry under springs, passive or locked",
        )
    # A spring, or none, for each coordinate.
    sprung = list[_Spring]()
    for c in whole.tree.coordinates:
        role = roles[c.name]
        if role == "given":
            where = whole.key("springs", c.name)
            sprung.append(_given(entries[c.name], whole.units, c.is_length, where))
        elif role == "own":
            sprung.append(_own(own[c.name]))
        else:
            assumed = _Spring(ASSUMED_STIFFNESS)
            sprung.append(assumed if role == "assumed" else _Spring(rest=0.0))
    springs = JointSprings(
        np.array([spring.stiffness for spring in sprung]),
        np.array([spring.rest for spring in sprung]),
        {j: spring.law for j, spring in enumerate(sprung) if spring.law is not None},
    )
    # What was assumed is said before all other notes.
    doubts = list[Note]()
    if joints := of.get("assumed"):
        doubts.append(assumed_stiffness(ASSUMED_STIFFNESS, joints, whole.tree.names))
    if joints := of.get("on lines"):
        doubts.append(held_by_lines(joints))
    notes = _spring_notes(whole, springs, entries)
    if joints := of.get("unsprung"):
        words = f"joints without a spring in the file move freely: {', '.join(joints)}"
        notes.append(Note("passive-joints", words, {"joints": joints}))
    return replace(whole, springs=springs, notes=(*doubts, *whole.notes, *notes))


def _roles(whole: Assembly, given: set[str], own: set[str]) -> dict[str, str]:
    """What is in each joint: a spring that is "given", its "own", or "assumed";
    or nothing.

    In a serial arm all joints but the passive ones are driven; in a closed chain, and
    where legs carry the body, those that are named, or all but the passive ones where
    only these are named. What line springs hold, and no joint is named as passive, has
    assumed springs only where an actuator of the robot's own file drives a joint.
    """
    # Joints without springs: those that the file names, and those of ties.
    passive = {*whole.names(lambda part: part.entry.passive)}
    free = {*whole.virtual(), *(n for n in whole.free if n not in given)}
    for name in sorted(given & (passive | free)):
        where = whole.key("passive", name)
        raise InputError(f"joint {name!r} is passive and has a spring", where=where)
    unsprung = {*whole.names(lambda part: part.robot.passive)} - passive - free
    unsprung -= (coupled := _coupled(whole))
    # Joints that a drive holds, where the file has no spring for them.
    driven = {*whole.tree.names} - passive - free - unsprung - coupled
    actuated = {*whole.names(lambda part: part.robot.actuated)} & {*whole.tree.names}
    on_lines, is_open = set[str](), not given and not passive - free
    if whole.kind != "serial" and not whole.parts[0].alone:
        named = {*whole.actuated} or actuated
        driven = driven & named if named or is_open or given else driven
    elif whole.lines and is_open:
        on_lines = driven - actuated
        driven -= on_lines
    sets = {
        "given": given,
        "own": own - passive - free,
        "assumed": driven,
        "on lines": on_lines,
        "unsprung": unsprung,
    }
    return {
        name: next((role for role, some in sets.items() if name in some), "free")
        for name in whole.tree.names
    }


def _spring_notes(
    whole: Assembly, springs: JointSprings, entries: Mapping[str, JointSpringModel]
) -> list[Note]:
    """Return notes on rest positions, tables, and torques that decrease."""
    notes, names = rest_of_turns(whole.tree.coordinates, springs.rest), whole.tree.names
    for pieces in ("linear", "smooth"):
        some = [
            names[j]
            for j, law in springs.laws.items()
            if getattr(law, "pieces", None) == pieces
        ]
        notes += [table_as_read(some, pieces)] if some else []
    soft = []
    for name, entry in entries.items():
        falls = entry.polynomial is not None and entry.polynomial[0] < 0.0
        if (table := entry.points) is not None:
            x, y = np.diff(table.points, axis=0).T
            falls = bool(np.any(y < 0.0) and np.all(x > 0.0))
        soft += [name] if falls else []
    return [*notes, *_negative(soft)]


def _negative(names: Sequence[str]) -> list[Note]:
    if not names:
        return []
    words = f"springs whose stiffness is negative, at rest or farther: {', '.join(names)}"
    return [Note("negative-stiffness", words, {"springs": list(names)})]


def links(whole: Assembly) -> Assembly:
    """Add the springs over the virtual joints of compliant links, and beams."""
    names, springs = whole.tree.names, list[Potential]()
    for part in whole.parts:
        for link, entry in part.entry.flexible.items():
            own = [
                part.called(f"{link}.{suffix}") for suffix, _, _ in give_of(entry).joints
            ]
            indices = np.array([names.index(name) for name in own])
            if entry.beam is not None:
                springs.append(_beam(entry.beam, indices, part.called(link)))
                continue
            K = np.array(entry.stiffness, float)
            K = K[se3.SWAP][:, se3.SWAP]
            springs.append(CoupledSprings(indices, K, part.called(link)))
    return replace(whole, potentials=(*whole.potentials, *springs))


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
    outline = None if beam.outline is None else (beam.E, beam.G, *beam.outline)
    step = beam.length / beam.segments
    return Beam(indices, step, section, link, mass, outline)  # type: ignore[arg-type]


def coupled(whole: Assembly) -> Assembly:
    """Add springs on sums of joint positions: those of entries,
    and fixed tendons of robots.
    """
    names = whole.tree.names
    # Springs of entries come first, then tendons that act on a joint of the tree.
    entries = [(part, one) for part in whole.parts for one in part.entry.coupled_springs]
    entries += [
        (part, one)
        for part in whole.parts
        for one in part.robot.coupled
        if not {*names}.isdisjoint(map(part.called, one.joints))
    ]
    called = [
        part.called(entry.name or f"coupled{i}")
        for i, (part, entry) in enumerate(entries, start=1)
    ]
    if len({*called, *names}) < len(called) + len(names):
        what = "a coupled spring has the name of another, or of a joint"
        where = entries[0][0].key("coupled_springs")
        raise InputError(what, where=where, expected="different names")
    # A joint that is held moves the rest position.
    rows, rests = [], []
    for part, entry in entries:
        held = {**part.robot.locked, **part.entry.locked}
        row, rest = np.zeros(len(names)), np.nan if entry.rest is None else entry.rest
        for name, factor in entry.joints.items():
            if name in held:
                rest -= factor * held[name]
                continue
            check_name("joint", part.called(name), names, part.key("coupled_springs"))
            row[names.index(part.called(name))] = factor
        rows.append(row)
        rests.append(rest)
    acting = [i for i, row in enumerate(rows) if row.any()]
    if not acting:
        return whole
    together = CoupledJointSprings(
        np.array(rows)[acting],
        np.array([entry.stiffness for _, entry in entries])[acting],
        np.array(rests)[acting],
        tuple(called[i] for i in acting),
    )
    return replace(whole, potentials=(*whole.potentials, together))


def _coupled(whole: Assembly) -> set[str]:
    """Joints that coupled springs hold."""
    terms = [p.factors for p in whole.potentials if isinstance(p, CoupledJointSprings)]
    columns = np.flatnonzero(np.concatenate(terms).any(axis=0)) if terms else ()
    return {whole.tree.names[j] for j in columns}


def link_checks(whole: Assembly) -> Assembly:
    """Add notes on links that are soft where nobody expects it, or without effect."""
    notes, negative, chain = list[Note](), list[str](), whole.chain
    for spring in whole.potentials:
        if isinstance(spring, Beam):
            notes += _ends_elsewhere(spring, chain)
        elif isinstance(spring, CoupledSprings):
            values = np.linalg.eigvalsh(spring.matrix)
            if values[0] < -numerics.ZERO_SHARE * abs(values).max():
                negative.append(f"link {spring.link}")
    return whole.noting([*notes, *_negative(negative), *_without_effect(whole)])


def _without_effect(whole: Assembly) -> list[Note]:
    """Return a note on compliant links that carry neither the body nor anything
    that holds it.
    """
    chain, tree = whole.chain, whole.chain.tree
    frames = set[str]().union(*(line.frames for line in whole.lines))
    frames.update(*((tie.frame_a, tie.frame_b) for tie in chain.closures))
    ends = {chain.body.joint, *(tree.placement(frame).joint for frame in frames)}
    carrying = {tree.model.names[j] for j in set().union(*map(tree.support, ends))}
    without = [
        spring.link
        for spring in whole.potentials
        if isinstance(spring, (Beam, CoupledSprings))
        and carrying.isdisjoint(tree.names[i] for i in np.ravel(spring.indices))
    ]
    if not without:
        return []
    words = (
        f"compliant links that do not move frame {chain.frame!r}: {', '.join(without)} "
        "(the "
        "spring of such a link moves what hangs on it, but not the link's own frame)"
    )
    return [Note("idle-link", words, {"links": without})]


def _ends_elsewhere(beam: Beam, chain: Chain) -> list[Note]:
    """A note on a beam with nothing at its far end: its link may not lie along its x."""
    model = chain.tree.model
    last = list(model.idx_vs).index(int(beam.indices[-1, -1]))
    hung = [
        model.jointPlacements[j].translation
        for j in range(1, model.njoints)
        if model.parents[j] == last
    ]
    hung += [f.T_j_f[:3, 3] for f in chain.tree.frames.values() if f.joint == last]
    length = beam.length * len(beam.indices)
    nearest = min(hung, key=np.linalg.norm, default=np.zeros(3))
    if np.linalg.norm(nearest) <= numerics.NEGLIGIBLE_DISTANCE * length:
        return []
    begins = (nearest + np.array([length, 0.0, 0.0])).tolist()
    words = (
        f"the beam of link {beam.link!r} runs along the x axis of the link or its "
        f"offset, to ({length:.6g}, 0, 0); what hangs on it begins at "
        f"({', '.join(f'{x:.6g}' for x in begins)}), joined rigidly"
    )
    values = {"link": beam.link, "length": length, "begins": begins}
    return [Note("beam-elsewhere", words, values)]


def lines(whole: Assembly) -> Assembly:
    """Add line springs and cables between frames, with a note on large strains."""
    if not whole.lines:
        return whole
    from cartstiff.core.potentials.line_springs import LineSprings, line_geometry

    springs, strains = list[LineSprings](), dict[str, float]()
    at, place = whole.chain.at(whole.q), whole.chain.tree.placement
    for i, line in enumerate(whole.lines, start=1):
        (a, b), where = line.frames, f"key lines.{i}"
        if place(a).joint == place(b).joint:
            raise InputError(
                "a line between two points of one link never changes its length",
                where=where,
                got=f"{a!r} and {b!r}",
            )
        anchors, points = (np.array([point], float) for point in line.points)
        # The rest length is given, or follows from the tension at q.
        try:
            (length,) = line_geometry(at.relative(a, b)[0], anchors, points).lengths
        except UndefinedError:
            raise InputError(
                f"the line between {a!r} and {b!r} has zero length at q",
                where=where,
            ) from None
        rest = line.rest_length
        if rest is None:
            rest = length - (line.preload or 0.0) / line.stiffness
        if rest and not (line.unilateral and rest > length):
            strains[f"stretch of line {i}"] = float((length - rest) / length)
        springs.append(
            LineSprings(
                frame_a=a,
                frame_b=b,
                anchors=anchors,
                points=points,
                stiffness=np.array([line.stiffness]),
                rest_length=np.array([rest]),
                unilateral=line.unilateral,
            )
        )
    potentials = (*whole.potentials, *springs)
    return whole.noting(large_strains(strains), potentials=potentials)


# -- chain, home, dampers; the list ------------------------------------------------------


def names_of_keys(whole: Assembly) -> Assembly:
    """Refuse names of joints that do not exist, of each tree."""
    for part in whole.parts:
        for key in ("q", "springs", "passive", "effort"):
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
    if not any(part.robot.lifted for part in whole.parts):
        return whole
    from cartstiff.core.potentials.loads import DeadForce

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
    chain.undriven = springs.undriven
    if whole.potentials or len(chain.undriven) < whole.tree.n:
        return whole
    words = (
        "no joint has a spring, and none is named as actuated, so all move freely: "
        f"{', '.join(chain.names)}. Which are actuated? Give --stiffness joint=value, or "
        "'actuated' or 'springs' in the mechanism file"
    )
    return whole.noting([Note("springs-missing", words, {"joints": list(chain.names)})])


def efforts(whole: Assembly) -> Assembly:
    """Limit the torques of the drives: as the file says, else as the robots' own files.

    Raises
    ------
    InputError
        For an entry of a joint that has no drive.
    """
    given, names = whole.named(lambda part: part.entry.effort), whole.tree.names
    passive = {names[j] for j in whole.springs.undriven}
    for name in sorted(given.keys() & passive):
        where = whole.key("effort", name)
        raise InputError(f"joint {name!r} moves freely: it has no drive", where=where)
    found = whole.named(lambda part: part.robot.efforts)
    found |= {name: both_ways(effort) for name, effort in given.items()}
    driven = [name for name in names if name not in passive]
    return replace(whole, efforts={n: found[n] for n in driven if n in found})


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
    efforts,
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
        efforts=whole.efforts,
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
        "planar loops of hinges: the motions do not change, but the forces and moments "
        "in the loop that answer to them are not determined between rigid links"
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
    robot: RobotDescription, file: Any, name: str, notes: Sequence[Note], **how: Any
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
    from cartstiff.files.legs import drawn_legs, mode_notes

    legs, parts = drawn_legs(file), []
    for number, leg in enumerate(legs, start=1):
        drawing = leg.drawing
        robot = robot_of(leg, beside) if drawing is None else drawing.description
        part = Part.of(leg, robot, kind="parallel", number=number)
        parts.append(part.noting(gravity_left_out(file, part)))
    whole = Assembly(file, name, tuple(parts), lines=tuple(file.lines))
    return mechanism(whole.noting(mode_notes(legs)))
