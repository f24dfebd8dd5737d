"""Springs of joints and links, beams, and lines between frames, from the entries of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.key_types import pose_of
from cartstiff.loading.robot_facts import RobotFacts
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import rest_of_turns
from cartstiff.mechanisms.flexible_links import Give
from cartstiff.mechanisms.tree import KinematicTree
from cartstiff.notes import Note, assumed_stiffness
from cartstiff.numerics import ZERO
from cartstiff.potentials.beams import Beam, Section
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.line_springs import LineSprings, line_geometry
from cartstiff.potentials.springs import (
    CoupledSprings,
    JointSprings,
    PolynomialLaw,
    SpringLaw,
    TabulatedLaw,
)

if TYPE_CHECKING:
    from cartstiff.loading.schema import (
        BeamModel,
        FlexibleModel,
        JointSpringModel,
        LineModel,
    )


#: N m/rad (N/m) taken where nobody gave a joint stiffness; said in the notes.
ASSUMED_STIFFNESS = 1.0e4


def springs_of(
    springs: Mapping[str, JointSpringModel],
    passive: Sequence[str],
    tree: KinematicTree,
    facts: RobotFacts,
    where: str,
    *,
    virtual: Sequence[str] = (),
    actuated: Sequence[str] | None = None,
) -> tuple[JointSprings, list[Note]]:
    """Joint springs of a file's entries, and notes on what was assumed.

    A joint without an entry has the spring that the robot's own file gives it. Of the others those
    that are actuated get an assumed one: in a serial arm all but the `passive` ones, in a closed
    chain (`actuated` is a sequence) those that are named there, or all but the passive ones where
    only these are named. Joints without a spring are free, as virtual joints of links are.
    """
    names = [c.name for c in tree.coordinates]
    passive = [*passive, *(n for n in virtual if n not in passive)]
    driven = set(names) - set(passive) - set(facts.passive)
    if actuated is not None and (actuated or springs or not set(passive) - set(virtual)):
        driven &= set(actuated)
    for entries, key in ((springs, "springs"), (passive, "passive")):
        for name in entries:
            if name not in names:
                raise UnknownNameError("joint", name, names, where=f"{where}, key {key}")
    both = set(springs) & set(passive)
    if both:
        raise InputError(f"joint {min(both)!r} is passive and has a spring", where=where)
    stiffness, rest = np.zeros(len(names)), np.full(len(names), np.nan)
    laws: dict[int, SpringLaw] = {}
    assumed: list[str] = []
    unsprung: list[str] = []
    for j, name in enumerate(names):
        entry = springs.get(name)
        if entry is not None:
            if entry.rest is not None:
                rest[j] = entry.rest
            if entry.stiffness is not None:
                stiffness[j] = entry.stiffness
            elif entry.polynomial is not None:
                laws[j] = PolynomialLaw(tuple(entry.polynomial))
            elif entry.table is not None:
                x, y = np.array(entry.table).T
                laws[j] = TabulatedLaw(tuple(x.tolist()), tuple(y.tolist()))
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
                    where=where,
                    expected="an entry under springs, passive or locked",
                )
            stiffness[j] = ASSUMED_STIFFNESS
            assumed.append(name)
        else:
            rest[j] = 0.0
            if name in facts.passive and name not in passive:
                unsprung.append(name)
    notes = [assumed_stiffness(ASSUMED_STIFFNESS, assumed, names)] if assumed else []
    notes += rest_of_turns(tree.coordinates, rest)
    notes += softening({name: entry for name, entry in springs.items() if not entry.stiffness})
    if unsprung:
        words = f"joints without a spring in the file move freely: {', '.join(unsprung)}"
        notes.append(Note("passive-joints", words, {"joints": unsprung}))
    return JointSprings(stiffness, rest, laws), notes


def softening(springs: Mapping[str, JointSpringModel]) -> list[Note]:
    """Names springs of joints whose torque falls while they turn."""
    soft = []
    for name, entry in springs.items():
        if entry.table is not None:
            x, y = np.array(entry.table).T
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
    """Names links whose 6x6 spring has a motion along which it pushes on."""
    notes = []
    for spring in springs:
        if isinstance(spring, CoupledSprings):
            values = np.linalg.eigvalsh(spring.matrix)
            if values[0] < -ZERO * abs(values).max():
                notes.append(f"link {spring.link}")
    return _negative(notes)


def give_of(entry: FlexibleModel) -> Give:
    """Virtual joints of a flexible link."""
    start = pose_of(entry.offset)
    if entry.beam is None:
        return Give(start, mass=entry.mass)
    beam = entry.beam
    own = None
    if beam.density > 0.0:
        own = beam.density * beam.area, beam.density * beam.Iy, beam.density * beam.Iz
    return Give(start, beam.length, beam.segments, own)


def virtual_joints(flexible: Mapping[str, FlexibleModel], prefix: str = "") -> list[str]:
    """Names of the virtual joints of flexible links."""
    return [
        f"{prefix}{link}.{suffix}"
        for link, entry in flexible.items()
        for suffix, _, _ in give_of(entry).joints
    ]


def link_springs(
    flexible: Mapping[str, FlexibleModel], tree: KinematicTree, where: str, prefix: str = ""
) -> list[Potential]:
    """Springs over the virtual joints of flexible links, and beams."""
    names = [c.name for c in tree.coordinates]
    springs: list[Potential] = []
    for link, entry in flexible.items():
        indices = np.array([names.index(name) for name in virtual_joints({link: entry}, prefix)])
        if entry.beam is not None:
            springs.append(_beam(entry.beam, indices, prefix + link))
            continue
        K = np.array(entry.stiffness, float)
        if np.abs(K - K.T).max() > numerics.SYMMETRY * np.abs(K).max():
            raise InputError(
                "stiffness of a link must be symmetric", where=f"{where}, flexible {link}"
            )
        springs.append(CoupledSprings(indices, K[se3.SWAP][:, se3.SWAP], prefix + link))
    return springs


def _beam(beam: BeamModel, indices: Array, link: str) -> Beam:
    along_y, along_z = (
        np.inf if area is None else beam.G * area for area in (beam.shear_area_y, beam.shear_area_z)
    )
    section = Section(
        beam.E * beam.area,
        beam.G * beam.J,
        (beam.E * beam.Iy, beam.E * beam.Iz),
        (along_z, along_y),
    )
    mass = beam.density * beam.area * beam.length
    return Beam(indices, beam.length / beam.segments, section, link, mass)


def extra_lines(lines: Sequence[LineModel], mechanism: Chain, q: Array) -> list[LineSprings]:
    """Line springs and cables between points of named frames."""
    springs = []
    for line in lines:
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
            raise InputError(f"the line between {a!r} and {b!r} has zero length at q") from None
        rest = line.rest_length
        if rest is None:
            rest = length - (line.preload or 0.0) / line.stiffness
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
    return springs
