"""How results show themselves: lines in Python, a table in a notebook, plain data for JSON."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.arrays import Array
from cartstiff.errors import joined, printable
from cartstiff.geometry import se3
from cartstiff.mechanisms.weighed import weighed

if TYPE_CHECKING:
    from cartstiff.stiffness.posture import PostureStiffness

__all__ = [
    "SCHEMA",
    "matrix_html",
    "numbers_text",
    "posture_dict",
    "posture_html",
    "posture_text",
]

SCHEMA = "cartstiff/1"

BlockUnits = tuple[tuple[str, str], tuple[str, str]]


def numbers_text(values: Array) -> str:
    """A few numbers on one line, to four digits."""
    return ", ".join(f"{x:.4g}" for x in values.tolist())


def posture_text(result: PostureStiffness) -> str:
    """Mechanism, posture, load, what exists, and codes of notes, a line each."""
    elastic, W = result.elastic, result.wrench
    exists = [name for name, K in result.matrices.items() if K is not None]
    lines = [
        f"Stiffness of {elastic.name} ({elastic.mechanism.kind}) at {elastic.mechanism.frame}",
        f"  q        {numbers_text(result.q)}",
        "  load     "
        + ("none that balances" if W is None else f"{numbers_text(W)} (moment, force; body axes)"),
        "  matrices "
        + (", ".join(f"K^{name}" for name in exists) or "none exists here")
        + f" in {elastic.units.force} and {elastic.units.length}: .A .B .K .F, .matrices",
    ]
    if codes := list(dict.fromkeys(note.code for note in result.notes)):
        lines.append(f"  notes    {', '.join(codes)}")
    return joined(lines)


def matrix_html(matrix: Array, block_units: BlockUnits, title: str, order: str) -> str:
    """A 6x6 matrix as a table, the unit of each 3x3 block beside its rows and over its columns."""
    parts = ("rotation", "translation")
    names = parts if order == "angular-linear" else parts[::-1]
    size = float(np.abs(matrix).max(initial=0.0))
    (a, b), (c, d) = block_units
    head = "".join(f"<th colspan=3>{name}</th>" for name in names)
    rows = [f"<tr><th></th>{head}<th>units</th></tr>"]
    for i, row in enumerate(matrix.tolist()):
        cells = "".join(
            f"<td style='text-align:right'>{0.0 if abs(x) < 1e-14 * size else x:.6g}</td>"
            for x in row
        )
        units = f"{a} | {b}" if i < 3 else f"{c} | {d}"
        rows.append(f"<tr><th>{names[i // 3]}</th>{cells}<td>{escape(units)}</td></tr>")
    caption = f"<caption style='text-align:left'>{escape(printable(title))}</caption>"
    return f"<table>{caption}{''.join(rows)}</table>"


def posture_html(result: PostureStiffness, matrices: Mapping[str, Array | None]) -> str:
    """The lines of `posture_text`, and K^B as a table."""
    text = f"<pre>{escape(posture_text(result))}</pre>"
    return text if matrices["B"] is None else text + result.B._repr_html_()


def posture_dict(result: PostureStiffness) -> dict[str, Any]:
    """What ``cartstiff analyse --json`` prints, as plain data."""

    def plain(array: Array | None) -> list[Any] | None:
        return None if array is None else array.tolist()

    return {
        "schema": SCHEMA,
        "mechanism": {
            "name": result.elastic.name,
            "kind": result.elastic.mechanism.kind,
            "joints": list(result.elastic.names),
        },
        "frame": result.elastic.mechanism.frame,
        "order": se3.ANGULAR_LINEAR,
        "units": result.elastic.units.as_dict(),
        "q": result.q.tolist(),
        "pose": result.pose.tolist(),
        "jacobian": plain(result.jacobian),
        "wrench": plain(result.wrench),
        "load": result.load_as_dict(),
        **weighed(result.elastic).as_dict(),
        "energy": None if np.isnan(result.energy) else result.energy,
        "stored_energy": None if np.isnan(result.stored_energy) else result.stored_energy,
        "stiffness": {name: plain(K) for name, K in result.matrices.items()},
        "compliance": {name: plain(C) for name, C in result.compliances.items()},
        "notes": [note.as_dict() for note in result.notes],
    }
