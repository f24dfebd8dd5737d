"""Passes over a mechanism: the springs in its joints and links,
and lines between its frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import InputError, UndefinedError, check_name
from cartstiff.geometry import se3
from cartstiff.loading.assembly import Assembly, give_of
from cartstiff.loading.description import FileSpring
from cartstiff.loading.plausible import large_strains
from cartstiff.loading.schema import BeamModel, JointSpringModel
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.given_springs import rest_of_turns
from cartstiff.notes import Note, assumed_stiffness, held_by_lines, table_as_read
from cartstiff.potentials.beams import Beam, Section
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.coupled_joints import CoupledJointSprings
from cartstiff.potentials.line_springs import LineSprings, line_geometry
from cartstiff.potentials.springs import (
    CoupledSprings,
    JointSprings,
    PolynomialLaw,
    SpringLaw,
    TabulatedLaw,
)
from cartstiff.units import Units, own_stiffness

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
    passive = {*whole.names(lambda part: part.entry.passive)}
    free = {*whole.virtual(), *(n for n in whole.free if n not in given)}
    for name in sorted(given & (passive | free)):
        where = whole.key("passive", name)
        raise InputError(f"joint {name!r} is passive and has a spring", where=where)
    unsprung = {*whole.names(lambda part: part.robot.passive)} - passive - free
    unsprung -= (coupled := _coupled(whole))
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
    return Beam(indices, beam.length / beam.segments, section, link, mass)


def coupled(whole: Assembly) -> Assembly:
    """Add springs on sums of joint positions: those of entries,
    and fixed tendons of robots.
    """
    names = whole.tree.names
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
    frames = {frame for line in whole.lines for frame in line.frames}
    frames |= {f for tie in chain.closures for f in (tie.frame_a, tie.frame_b)}
    ends = {chain.body.joint, *(tree.placement(frame).joint for frame in frames)}
    carrying = {tree.model.names[j] for end in ends for j in tree.support(end)}
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
        "offset, to "
        f"({length:.6g}, 0, 0); what hangs on it begins at "
        f"({', '.join(f'{x:.6g}' for x in begins)}), joined rigidly"
    )
    values = {"link": beam.link, "length": length, "begins": begins}
    return [Note("beam-elsewhere", words, values)]


def lines(whole: Assembly) -> Assembly:
    """Add line springs and cables between frames, with a note on large strains."""
    springs, strains = list[LineSprings](), dict[str, float]()
    at = whole.chain.at(whole.q)
    for i, line in enumerate(whole.lines, start=1):
        a, b = line.frames
        tree = whole.chain.tree
        if tree.placement(a).joint == tree.placement(b).joint:
            raise InputError(
                "a line between two points of one link never changes its length",
                where=f"key lines.{i}",
                got=f"{a!r} and {b!r}",
            )
        anchors, points = (np.array([point], float) for point in line.points)
        try:
            (length,) = line_geometry(at.relative(a, b)[0], anchors, points).lengths
        except UndefinedError:
            raise InputError(
                f"the line between {a!r} and {b!r} has zero length at q",
                where=f"key lines.{i}",
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
