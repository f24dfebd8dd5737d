"""Assembly modes and workspaces as text and as tables."""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import csv_rows
from cartstiff.errors import joined
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism, gravity_loads
from cartstiff.mechanisms.other_units import shown, shown_factors
from cartstiff.mechanisms.platform import Platform
from cartstiff.notes import Note
from cartstiff.reach.assembly import AssemblyMode, AssemblyModes
from cartstiff.report.layout import body_frame, note_lines, number, numbers, table
from cartstiff.report.posture import load_lines

_STABLE = {True: "yes", False: "NO", None: "-"}


def describe_assembly(modes: AssemblyModes) -> str:
    """How many modes there are, how completely they are known, and each on a line."""
    elastic, units = modes.elastic, modes.elastic.units
    held = ", ".join(_held(elastic, name, x) for name, x in modes.given.items())
    count = len(modes)
    lines = [
        f"{elastic.name}: {elastic.mechanism.kind}, {body_frame(elastic.mechanism)}",
        f"Held: {held}",
        *(load_lines(modes[0].result) if count and modes[0].result.is_loaded else []),
        gravity_loads(elastic).text,
        f"Assembly modes: {count}; searched: {modes.search or 'not, see the notes'}",
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
            f"min K: smallest eigenvalue of the tangent stiffness, angles times the body's length "
            f"[{units.stiffness['translation']}]",
        ]
        if isinstance(elastic.mechanism, Platform):
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
        str(i + 1) for i, mode in enumerate(modes) if any(note.code == code for note in mode.notes)
    )


def _table(modes: AssemblyModes) -> list[str]:
    of_legs = isinstance(modes.elastic.mechanism, Platform)
    swing = any(mode.frequencies is not None for mode in modes)
    names = modes.elastic.names_with_units if of_legs else _pose_names(modes.elastic)
    titles = ["", *names, "residual", "min K", "stable"]
    titles += ["det"] * of_legs + ["first frequencies [Hz]"] * swing
    rows = []
    for i, mode in enumerate(modes):
        row = [
            str(i + 1),
            *(number(x) for x in _place(mode, modes.elastic)),
            number(mode.residual if mode.residual > numerics.ATTAINABLE_PRECISION else 0.0, 2),
        ]
        row += [number(mode.eigenvalue), _STABLE[mode.stable]]
        row += [number(mode.determinant, 4)] * of_legs
        if swing:
            first = mode.frequencies
            row.append("-" if first is None else numbers(_first(first)[:3]))
        rows.append(row)
    return table(titles, rows)


def _held(elastic: ElasticMechanism, name: str, value: float) -> str:
    """A leg's length, or an actuator's coordinate, with its unit."""
    coordinates = {c.name: c for c in elastic.mechanism.coordinates}
    if name not in coordinates or coordinates[name].is_length:
        return f"{name} {number(value, 6)} {elastic.units.length}"
    value /= shown_factors(elastic).get(name, 1.0)
    return f"{name} {number(value, 6)} {elastic.units.shown_angle}"


def _first(frequencies: Array) -> list[float | None]:
    return [float(f) if np.isfinite(f) else None for f in frequencies]


def _pose_names(elastic: ElasticMechanism) -> list[str]:
    length, angle = elastic.units.length, elastic.units.shown_angle
    turns = [f"{name} [{angle}]" for name in ("roll", "pitch", "yaw")]
    return [f"{name} [{length}]" for name in "xyz"] + turns


def _place(mode: AssemblyMode, elastic: ElasticMechanism) -> list[float]:
    """Coordinates of a platform, or the pose of M of a chain, as people read it; rounding is 0."""
    if isinstance(elastic.mechanism, Platform):
        q = mode.q
    else:
        q = np.append(mode.pose[:3, 3], se3.roll_pitch_yaw(mode.pose))
    sizes = np.repeat([elastic.mechanism.at(mode.q).length, 1.0], 3)
    q = np.where(np.abs(q) < numerics.BLANK * sizes, 0.0, q)
    if isinstance(elastic.mechanism, Platform):
        return shown(elastic, q).tolist()
    if elastic.units.shown_angle == "deg":
        q[3:] = np.degrees(q[3:])
    return q.tolist()


def assembly_csv(modes: AssemblyModes) -> str:
    """A row a mode: coordinates, residual, smallest eigenvalue, stable, determinant, frequencies.

    A cell is empty where a number does not exist.
    """
    most = max((0 if m.frequencies is None else len(m.frequencies) for m in modes), default=0)
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
        own = [] if mode.frequencies is None else _first(mode.frequencies)
        rows.append(
            [
                *shown(modes.elastic, mode.q).tolist(),
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
