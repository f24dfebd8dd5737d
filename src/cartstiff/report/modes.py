"""Modes as text for people."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff.errors import joined
from cartstiff.report.layout import number, percent, table, vector
from cartstiff.vibration.modes import Modes

__all__ = ["describe_modes"]


def describe_modes(found: Modes, unloaded: Modes | None = None, extra: Sequence[str] = ()) -> str:
    """Frequencies with their load, shapes, masses, nodal axes and notes.

    Parameters
    ----------
    found : Modes
        Under the load.
    unloaded : Modes, optional
        The same without it, which stands beside.
    extra : sequence of str
        Lines that stand before the notes.
    """
    elastic, mechanism, units = found.elastic, found.elastic.mechanism, found.elastic.units
    weighed = found.as_dict()["weighed"]
    masses = ", ".join(f"{part['name']} {part['mass']:.4g}" for part in weighed)
    lines = [
        f"{elastic.name}: {mechanism.kind}, body frame {mechanism.frame!r}, small undamped motions "
        f"about rest, {found.load['words']}",
        _load(found),
        f"Masses that move [kg]: {masses or 'none'}",
        "",
        "Frequencies in Hz",
        *_frequencies(found, unloaded),
        "",
        "What moves: share of each coordinate in the kinetic energy, in per cent",
        *_participation(found),
        "",
        f"What the body turns about, in its frame ({units.length})",
        *_axes(found),
        *extra,
    ]
    if found.notes:
        lines += ["", "Notes", *(f"  [{note.code}] {note.message}" for note in found.notes)]
    return joined(lines).rstrip()


def _load(found: Modes) -> str:
    units, W = found.elastic.units, found.load["wrench"]
    if W is None or not any(W):
        return f"Load: {found.load['meaning'] if W is None else 'none'}"
    return (
        f"Load: {found.load['kind']}, moment {vector(W[:3])} {units.moment}, force "
        f"{vector(W[3:])} {units.force} about the frame's origin, in its axes; "
        f"{found.load['meaning']}"
    )


def _hertz(value: float) -> str:
    return "unstable" if np.isnan(value) else "free" if value == 0.0 else f"{value:.6g}"


def _frequencies(found: Modes, unloaded: Modes | None) -> list[str]:
    masses, total = found.effective_masses, found._momentum
    titles = ["mode", found.load["words"]]
    if unloaded is not None:
        titles += ["unloaded", "change"]
    if masses is not None and total is not None:
        titles += [f"moved along {axis} [kg]" for axis in "xyz"]
    rows = []
    for i, f in enumerate(found.frequencies):
        cells = [str(i + 1), _hertz(f)]
        if unloaded is not None:
            bare = unloaded.frequencies[i] if i < len(unloaded.frequencies) else np.nan
            cells += [_hertz(bare), percent(f / bare - 1.0 if bare else None)]
        if masses is not None and total is not None:
            cells += [number(m, 4) for m in _clean(masses[i], total[1])]
        rows.append(cells)
    return table(titles, rows)


def _clean(masses: np.ndarray, total: float) -> list[float]:
    return [0.0 if abs(m) < 1e-9 * total else float(m) for m in masses]


#: Beyond this many coordinates only the largest shares are shown.
_COLUMNS = 8


def _participation(found: Modes) -> list[str]:
    names, shares = found.elastic.names, found.participation
    if found.posture.coordinates_are_pose:
        names = ("rx", "ry", "rz", "x", "y", "z")
    if len(names) <= _COLUMNS:
        rows = [
            [str(i + 1), *(f"{100 * s + 0.0:.1f}" for s in row)] for i, row in enumerate(shares)
        ]
        return table(["mode", *names], rows)
    lines = []
    for i, row in enumerate(shares):
        first = np.argsort(-row)[:4]
        words = ", ".join(f"{names[j]} {100 * row[j]:.0f}" for j in first if row[j] > 0.005)
        lines.append(f"  {i + 1:>3}  {words}")
    return lines


def _axes(found: Modes) -> list[str]:
    lines = []
    for i, screw in enumerate(found.nodal_axes):
        if not np.isfinite(screw.direction).all():
            words = "does not move"
        elif not np.isfinite(screw.pitch):
            words = f"moves along {vector(screw.direction)}"
        else:
            words = (
                f"about {vector(screw.direction)} through {vector(screw.point)}, pitch "
                f"{number(screw.pitch, 3)}"
            )
        lines.append(f"  {i + 1:>3}  {words}")
    return lines
