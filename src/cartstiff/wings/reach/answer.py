"""The answers on assembly modes and on workspaces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cartstiff.answer.data import (
    Answer,
    Column,
    Quantity,
    Statement,
    Table,
    rounded,
    said,
    table,
)
from cartstiff.answer.posture import load_of, room_load
from cartstiff.core import numerics
from cartstiff.core.arrays import Array, plain
from cartstiff.core.geometry import se3
from cartstiff.core.notes import Note
from cartstiff.wings.reach.assembly import AssemblyMode, AssemblyModes
from cartstiff.wings.reach.workspace import Workspace

_POSE = ("x", "y", "z", "roll", "pitch", "yaw")
# Largest number of limits listed; the others share one line.
_MAX_LISTED_LIMITS = 12


def answer_of_assembly(modes: AssemblyModes) -> Answer:
    """The number of modes, whether all are known, and each mode."""
    elastic = modes.elastic
    turning = {c.name for c in elastic.mechanism.coordinates if not c.is_length}
    held = {
        name: Quantity(x, elastic.units.coordinate(name not in turning))
        for name, x in modes.given.items()
    }
    code = ("modes-may-be-missing", "all-modes")[modes.is_complete]
    search = modes.search or "not, see the notes"
    nearest = said("nearest-mode", count=len(modes))
    return Answer.about_mechanism(
        "assemble",
        elastic,
        [*modes.notes, *_notes_of_modes(modes)],
        said(code if modes.found else "no-assembly"),
        said("modes", count=modes.found, search=search),
        *[nearest] * (len(modes) < modes.found),
        about=[said("mechanism"), said("held", held=held)],
        load=load_of(modes[0].result) if len(modes) else None,
        tables=[_modes(modes)][: len(modes)],
    )


def _notes_of_modes(modes: AssemblyModes) -> Iterator[Note]:
    """Notes of single modes, which begin with their numbers."""
    known = {note.code for note in modes.notes} | {"kf-undefined"}
    own = {note.code: note for mode in modes for note in mode.notes}
    for code, note in own.items():
        if code not in known:
            numbers = [
                str(i)
                for i, mode in enumerate(modes, 1)
                if any(other.code == code for other in mode.notes)
            ]
            words = f"modes {', '.join(numbers)}: {note.message}"
            yield Note(code, words, note.values)


def _modes(modes: AssemblyModes) -> Table:
    """Each mode with its coordinates or pose, stiffness and frequencies."""
    units, is_pose = modes.elastic.units, modes.elastic.mechanism.coordinates_are_pose
    names = (_POSE, modes.elastic.names)[is_pose]
    rows = [
        (
            i,
            *_place(mode, is_pose),
            mode.residual * (mode.residual > numerics.ATTAINABLE_PRECISION),
            mode.eigenvalue,
            mode.stable,
            mode.determinant,
            plain(mode.frequencies) and plain(mode.frequencies)[:3],
        )
        for i, mode in enumerate(modes, 1)
    ]
    heads = [
        Column(""),
        *(Column(name, units.coordinate(i < 3)) for i, name in enumerate(names)),
    ]
    heads += [
        Column("residual", form="2"),
        Column("min K", units.stiffness["translation"]),
    ]
    heads += [
        Column("stable"),
        Column("det", form="4"),
        Column("first frequencies", "Hz"),
    ]
    below = [said("least-stiffness"), *[said("determinant")] * is_pose]
    return table("assembly modes", heads, rows, *below)


def _place(mode: AssemblyMode, is_pose: bool) -> tuple[float, ...]:
    """A platform's coordinates, or a chain's pose of M; round-off is 0."""
    place = np.append(mode.pose[:3, 3], se3.roll_pitch_yaw(mode.pose))
    if is_pose:
        place = mode.q
    sizes = np.repeat([mode.result.posture.length, 1.0], 3)
    return tuple(sizes * rounded(place / sizes, 1.0))


def answer_of_workspace(reached: Workspace) -> Answer:
    """Volume, slices, limits, rotations, inscribed bodies, singularities."""
    elastic, given, R = reached.elastic, reached.load, reached.pose[:3, :3]
    where = said("freedoms", axes=reached.axes)
    if reached.axes == _POSE[:3]:
        where = said("orientation", position=_at(reached.pose[:3, 3], reached))
    load = None
    if given is not None:
        turned, W = (np.eye(3), R)[given["axes"] == "body"], np.array(given["wrench"])
        load = room_load(elastic, given["kind"], given["at"], W, turned)
    statements, tables = [said("no-workspace")], list[Table]()
    if reached.positions is not None and reached.columns is not None:
        statements, tables = list(_found(reached)), list(_tables(reached))
    return Answer.about_mechanism(
        "workspace",
        elastic,
        reached.notes,
        *statements,
        about=[said("mechanism"), where],
        load=load,
        tables=tables,
    )


def _units_of_axes(reached: Workspace) -> list[str]:
    coordinate = reached.elastic.units.coordinate
    return [coordinate(name in _POSE[:3]) for name in reached.axes]


def _at(place: Array, reached: Workspace) -> Any:
    """Values of the axes: one quantity, if they have one unit."""
    units, values = _units_of_axes(reached), tuple(plain(place))
    if len({*units}) == 1:
        return Quantity(values, units[0])
    return [Quantity(x, unit) for x, unit in zip(values, units, strict=True)]


def _product(units: list[str]) -> str:
    """A product of units: m^3, or m rad^2."""
    powers = ((unit, units.count(unit)) for unit in dict.fromkeys(units))
    return " ".join(f"{unit}^{n}".removesuffix("^1") for unit, n in powers)


def _found(reached: Workspace) -> Iterator[Statement]:
    """Size of the workspace, what fits into it, and what is singular near it."""
    mechanism, units = reached.elastic.mechanism, reached.elastic.units
    unit, length = _product(_units_of_axes(reached)), units.length
    # How much can be reached, and how far the body turns there.
    yield said(
        ("volume", "volume-at-orientation")[reached.axes == _POSE[:3]],
        volume=Quantity(reached.volume, unit),
        error=Quantity(reached.volume_error, unit),
        poses=reached.to_dict()["poses"],
    )
    if (least := reached.least_turn) is not None:
        share = Quantity(reached.share_of_rotations, "1")
        yield said("turns", least=Quantity(least, units.angle), share=share)
    # What fits into it.
    for code, fits in (("sphere", reached.sphere), ("cube", reached.cube)):
        if fits is not None:
            size = Quantity(float(fits[1]), length)
            yield said(code, size=size, centre=Quantity(tuple(plain(fits[0])), length))
    # Tensions of cables, which decide what counts as reached.
    if reached.distribution:
        yield said(f"tensions-{reached.distribution['distribution']}")
        if (tensions := reached.distribution["at_centre"]) is not None:
            yield said("tensions", tensions=Quantity(tuple(tensions), units.force))
    # The least ratio that was found, and the nearest singular place.
    if reached.singularity is not None:
        ratio, place = reached.singularity
        yield said(
            ("ratio-of-twists", "ratio-of-legs")[mechanism.coordinates_are_pose],
            ratio=ratio,
            at=_at(place, reached),
            length=Quantity(mechanism.at(reached.elastic.q).length, length),
        )
    if (near := reached.singular) is not None and near.distance is not None:
        distance, radius = Quantity(near.distance, length), Quantity(near.length, length)
        yield said("singular-pose", distance=distance, length=radius)
        if near.shift:
            yield said("singular-position", shift=Quantity(near.shift, length))


def _tables(reached: Workspace) -> Iterator[Table]:
    """Slices, and the limits that end the workspace and the rotations."""
    units = _units_of_axes(reached)
    heads = f"{reached.axes[2]} [{units[2]}] | area [{_product(units[:2])}] : 4"
    yield table("slices", heads, reached.slices[::2])
    for name, rays in (("limits", reached.positions), ("rotations", reached.turns)):
        if rays is not None:
            shares = [(share, limit) for limit, share in rays.shares().items()]
            rest = sum(share for share, _ in shares[_MAX_LISTED_LIMITS:])
            shares[_MAX_LISTED_LIMITS:] = [(rest, "others")] * (rest > 0.0)
            yield table(name, " : % | : <", shares)
