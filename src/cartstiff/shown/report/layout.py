"""Numbers, units and tables of the text reports."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.notes import Note
from cartstiff.core.units import Units


def note_lines(notes: Iterable[Note]) -> list[str]:
    """Return the notes under their title, after an empty line; nothing without notes."""
    lines = [f"  {note}" for note in notes]
    return ["", "Notes", *lines] if lines else []


def number(
    x: float | None, digits: int = 5, missing: str = "-", size: float = 0.0
) -> str:
    """Format a number, "-" if it does not exist; 0 if it is round-off of a size."""
    if x is None:
        return missing
    return (
        f"{0.0 if x == 0 or abs(x) < numerics.PRINTED_AS_ZERO * size else x:.{digits}g}"
    )


def percent(x: float | None) -> str:
    """Format a share in per cent; 0 if it is round-off, "-" if it does not exist."""
    if x is None or not math.isfinite(x):
        return "-"
    shown = f"{0.0 if abs(x) < numerics.PRINTED_AS_ZERO else 100.0 * x:.2g}"
    return f"{float(shown):g} %"


def _each(values: Iterable[float | None], digits: int, size: float) -> list[str]:
    """Format numbers; 0 for round-off of the largest number or of a size."""
    entries = list(values)
    largest = max(max((abs(x) for x in entries if x is not None), default=0.0), size)
    return [number(x, digits, size=largest) for x in entries]


def vector(values: Iterable[float | None], digits: int = 3, size: float = 0.0) -> str:
    """A short vector in brackets."""
    return f"({', '.join(_each(values, digits, size))})"


def lengths(values: Any, units: Units) -> Any:
    """Lengths in the unit of texts, `Units.shown_length`."""
    return np.asarray(values, float) * units.shown_per_length


def table(
    titles: Sequence[str], rows: Iterable[Sequence[str]], left: Collection[int] = ()
) -> list[str]:
    """Right-aligned cells under their titles, if there are any; those of the columns
    `left` are left-aligned.
    """
    cells = [titles, *rows]
    widths = [max(len(r[i]) for r in cells) for i in range(len(titles))]
    align = [(str.rjust, str.ljust)[i in left] for i in range(len(titles))]
    lines = [
        "  ".join(put(c, w) for put, c, w in zip(align, r, widths, strict=True))
        for r in cells[not any(titles) :]
    ]
    return [f"  {line}".rstrip() for line in lines]


def placed(T: Array, units: Units) -> str:
    """Describe the pose of a frame in another by point and angles;
    "" for the identity.
    """
    place = lengths(T[:3, 3], units)
    size = float(np.abs(place).max())
    turned = np.degrees(se3.roll_pitch_yaw(T))
    parts = []
    if size > 0.0:
        parts.append(f"at {vector(place, 6, size)} {units.shown_length}")
    if np.abs(turned).max() > numerics.PRINTED_AS_ZERO:
        parts.append(f"turned by roll, pitch, yaw {vector(turned, 6, 1.0)} deg")
    return ", ".join(parts)


def body_frame(frames: Mapping[str, Any], units: Units) -> str:
    """Describe the body frame M and its pose in its link's frame.

    Parameters
    ----------
    frames : mapping
        As `Mechanism.frames_as_dict`.
    units : Units
        Units of its lengths.
    """
    where = placed(np.array(frames["frame_offset"]), units)
    return f"body frame {f'M {where} in ' if where else ''}{frames['frame']!r}"
