"""Assembly modes and workspaces as text, as tables and as figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import csv_rows, plain
from cartstiff.errors import joined
from cartstiff.geometry import se3
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.gravity_loads import gravity_loads
from cartstiff.mechanisms.other_units import shown, shown_heads
from cartstiff.notes import Note
from cartstiff.reach.assembly import AssemblyMode, AssemblyModes
from cartstiff.reach.workspace import Workspace
from cartstiff.report.analysis import load_lines
from cartstiff.report.layout import (
    body_frame,
    length_of,
    lengths,
    note_lines,
    number,
    numbers,
    percent,
    table,
    vector,
)

_STABLE = {True: "yes", False: "NO", None: "-"}


def describe_assembly(modes: AssemblyModes) -> str:
    """Describe the number of modes, whether all are known, and each mode on a line."""
    elastic, units = modes.elastic, modes.elastic.units
    held = ", ".join(_held(elastic, name, x) for name, x in modes.given.items())
    count = len(modes)
    listed = ", the nearest one listed (--all: every one)" if count < modes.found else ""
    lines = [
        f"{elastic.name}: {elastic.mechanism.kind}, {body_frame(elastic.mechanism)}",
        f"Held: {held}",
        *(load_lines(modes[0].result) if count and modes[0].result.is_loaded else []),
        gravity_loads(elastic).text,
        f"Assembly modes: {modes.found}{listed}; searched: "
        f"{modes.search or 'not, see the notes'}",
    ]
    if modes.search is not None:
        lines.append(
            "No isolated mode is missing: every path's end is known."
            if modes.is_complete
            else "There may be more."
        )
    if count:
        lines += ["", *_table(modes)]
        lines += [
            "",
            "min K: smallest eigenvalue of the tangent stiffness, angles times the "
            "body's length "
            f"[{units.stiffness['translation']}]",
        ]
        if elastic.mechanism.coordinates_are_pose:
            lines.append("det: of the legs' lines, moments over that length")
        own = {note.code: note for mode in modes for note in mode.notes}
        known = {note.code for note in modes.notes}
        states = [
            Note(code, f"modes {_with(modes, code)}: {note.message}", note.values)
            for code, note in own.items()
            if code not in known and code != "kf-undefined"
        ]
        return joined([*lines, *note_lines([*modes.notes, *states])])
    return joined([*lines, *note_lines(modes.notes)])


def _with(modes: AssemblyModes, code: str) -> str:
    return ", ".join(
        str(i + 1)
        for i, mode in enumerate(modes)
        if any(note.code == code for note in mode.notes)
    )


def _table(modes: AssemblyModes) -> list[str]:
    of_legs = modes.elastic.mechanism.coordinates_are_pose
    swing = any(mode.frequencies is not None for mode in modes)
    names = shown_heads(modes.elastic) if of_legs else _pose_names(modes.elastic)
    titles = ["", *names, "residual", "min K", "stable"]
    titles += ["det"] * of_legs + ["first frequencies [Hz]"] * swing
    rows = []
    for i, mode in enumerate(modes):
        row = [
            str(i + 1),
            *(number(x) for x in _place(mode, modes.elastic)),
            number(
                mode.residual if mode.residual > numerics.ATTAINABLE_PRECISION else 0.0, 2
            ),
        ]
        row += [number(mode.eigenvalue), _STABLE[mode.stable]]
        row += [number(mode.determinant, 4)] * of_legs
        if swing:
            first = mode.frequencies
            row.append("-" if first is None else numbers(plain(first)[:3]))
        rows.append(row)
    return table(titles, rows)


def _held(elastic: ElasticMechanism, name: str, value: float) -> str:
    """Format a leg's length or an actuator's coordinate with its unit."""
    coordinates = {c.name: c for c in elastic.mechanism.coordinates}
    if name not in coordinates or coordinates[name].is_length:
        return f"{name} {length_of(value, elastic.units, 6)}"
    value *= elastic.units.shown_per_radian
    return f"{name} {number(value, 6)} {elastic.units.shown_angle}"


def _pose_names(elastic: ElasticMechanism) -> list[str]:
    length, angle = elastic.units.shown_length, elastic.units.shown_angle
    turns = [f"{name} [{angle}]" for name in ("roll", "pitch", "yaw")]
    return [f"{name} [{length}]" for name in "xyz"] + turns


def _place(mode: AssemblyMode, elastic: ElasticMechanism) -> list[float]:
    """A platform's coordinates or a chain's pose of M in shown units; round-off is 0."""
    if elastic.mechanism.coordinates_are_pose:
        q = mode.q
    else:
        q = np.append(mode.pose[:3, 3], se3.roll_pitch_yaw(mode.pose))
    sizes = np.repeat([elastic.mechanism.at(mode.q).length, 1.0], 3)
    q = np.where(np.abs(q) < numerics.PRINTED_AS_ZERO * sizes, 0.0, q)
    if elastic.mechanism.coordinates_are_pose:
        return shown(elastic, q).tolist()
    q[:3] *= elastic.units.shown_per_length
    q[3:] *= elastic.units.shown_per_radian
    return q.tolist()


def assembly_csv(modes: AssemblyModes) -> str:
    """Write one row per mode; a cell is empty if its number does not exist."""
    most = max(
        (0 if m.frequencies is None else len(m.frequencies) for m in modes), default=0
    )
    units = modes.elastic.units
    head = [
        *modes.elastic.names_with_units,
        f"residual [{units.length}]",
        "multiplicity",
        f"smallest_eigenvalue [{units.stiffness['translation']}]",
        "stable",
        "determinant",
        *(f"frequency_{i + 1} [Hz]" for i in range(most)),
    ]
    rows = []
    for mode in modes:
        own = [] if mode.frequencies is None else plain(mode.frequencies)
        rows.append(
            [
                *mode.q.tolist(),
                mode.residual,
                mode.multiplicity,
                mode.eigenvalue,
                mode.stable,
                mode.determinant,
                *own,
                *[None] * (most - len(own)),
            ]
        )
    return csv_rows(head, rows)


# Largest number of limits listed; the others share one line.
_MAX_LISTED_LIMITS = 12


def describe_workspace(reached: Workspace) -> str:
    """Describe volume, slices, limits, rotations, inscribed bodies,
    singularities and notes.
    """
    elastic, own = reached.elastic, reached.elastic.units
    unit, turn = own.shown_length, own.shown_angle
    powers = [own.coordinate(name in ("x", "y", "z")) for name in reached.axes]
    units = [unit if name in ("x", "y", "z") else turn for name in reached.axes]
    per = [own.shown_per_length if u == unit else own.shown_per_radian for u in units]
    is_place = reached.axes == ("x", "y", "z")
    lines = [
        f"{elastic.name}: {elastic.mechanism.kind}, {body_frame(elastic.mechanism)}",
        f"Orientation of M kept; position {vector(lengths(reached.pose[:3, 3], own), 5)} "
        f"{unit}"
        if is_place
        else f"The body takes {', '.join(reached.axes)}; the rest of its pose follows",
        *([f"Load: {_load(reached.load)}"] if reached.load else []),
        gravity_loads(elastic).text,
    ]
    if reached.positions is None or reached.columns is None:
        return joined(
            [*lines, "No workspace: singular everywhere", *note_lines(reached.notes)]
        )
    poses = reached.to_dict()["poses"]
    lines += [
        "",
        f"Volume{' with this orientation' * is_place}: {number(reached.volume, 5)} "
        f"{_product(powers)}, +- {number(reached.volume_error, 2)} ({poses} poses tried)",
        *table(
            [f"{reached.axes[2]} [{units[2]}]", f"area [{_product(powers[:2])}]"],
            [(number(per[2] * z), number(area, 4)) for z, area in reached.slices[::2]],
        ),
        "",
        "Limits that end the workspace (share of directions)",
        *_shares(reached.positions.shares()),
    ]
    if (least := reached.least_turn) is not None and reached.turns is not None:
        lines += [
            "",
            "Rotations at this position",
            "  about every axis by at least "
            f"{number(least * elastic.units.shown_per_radian, 4)} "
            f"{elastic.units.shown_angle}; "
            f"{percent(reached.share_of_rotations)} of all rotations",
            *_shares(reached.turns.shares()),
        ]
    for words, fits, size in (
        ("sphere", reached.sphere, "radius"),
        ("cube", reached.cube, "edge"),
    ):
        if fits is not None:
            lines.append(
                f"Largest {words} found inside: {size} {length_of(fits[1], own, 4)} at "
                f"{vector(lengths(fits[0], own), 4)}"
            )
    if reached.distribution:
        t, how = reached.distribution["at_centre"], reached.distribution["distribution"]
        words = (
            "any within the limits"
            if how == "any"
            else "nearest to the middle of the limits"
        )
        lines.append(
            f"Tensions that count: {words}"
            + (
                ""
                if t is None
                else f"; nearest to the middle at the position: {vector(np.array(t), 5)} "
                f"{elastic.units.force}"
            )
        )
    if reached.singularity is not None:
        ratio, place = reached.singularity
        of, over = "legs' lines", "moments"
        if not elastic.mechanism.coordinates_are_pose:
            of, over = "passive joints' twists that meet in the body", "lengths"
        lines += [
            "Nearest to singular that was found: smallest over largest singular value "
            f"of the {of} "
            f"{number(ratio, 3)} at {vector(np.array(per) * place, 4)}",
            f"  ({over} over the body's length "
            f"{length_of(elastic.mechanism.at(elastic.q).length, own)}; 0 is singular)",
        ]
    if (near := reached.singular) is not None and near.distance is not None:
        lines += [
            f"Nearest singular pose found: {length_of(near.distance, own, 4)} away, by "
            f"sqrt(distance^2 + ({length_of(near.length, own)} x angle)^2)"
            + (f"; {length_of(near.shift, own, 4)} without turning" if near.shift else "")
        ]
    return joined([*lines, *note_lines(reached.notes)])


def _load(load: Mapping[str, Any]) -> str:
    """Describe the load."""
    of = "M at the start" if load["axes"] == "body" else "F"
    W = load["wrench"]
    return (
        f"{load['kind']}, moment {vector(W[:3], 6)}, force {vector(W[3:], 6)} along the "
        f"axes of {of}, at {vector(load['at'], 6)} of the body"
    )


def _product(units: Sequence[str]) -> str:
    """Format a product of units: m^3, or m rad^2."""
    powers = ((unit, units.count(unit)) for unit in dict.fromkeys(units))
    return " ".join(unit if n == 1 else f"{unit}^{n}" for unit, n in powers)


def _shares(shares: dict[str, float]) -> list[str]:
    listed = list(shares.items())
    lines = [
        f"  {percent(share):>6}  {name}" for name, share in listed[:_MAX_LISTED_LIMITS]
    ]
    rest = sum(share for _, share in listed[_MAX_LISTED_LIMITS:])
    return lines + ([f"  {percent(rest):>6}  others"] if rest else [])


def boundary_csv(reached: Workspace) -> str:
    """Write one row per boundary position: the coordinates,
    and the limit that is reached.
    """
    limits = [] if reached.positions is None else reached.positions.limit.tolist()
    rows = (
        [*xyz, limit]
        for xyz, limit in zip(reached.boundary.tolist(), limits, strict=True)
    )
    return csv_rows([*reached.axes_with_units, "limit"], rows)
