"""How results show themselves: lines in Python, a table in a notebook, plain data for JSON."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.geometry import se3
from cartstiff.mechanisms.elastic import gravity_loads
from cartstiff.notebook import html_table
from cartstiff.notes import Note

if TYPE_CHECKING:
    from cartstiff.stiffness.posture import PostureStiffness

SCHEMA = "cartstiff/1"

BlockUnits = tuple[tuple[str, str], tuple[str, str]]


def numbers_text(values: Array) -> str:
    """A few numbers on one line, to four digits; what is rounding of the largest is 0."""
    least = numerics.BLANK * np.abs(values).max(initial=0.0)
    return ", ".join(f"{x if abs(x) > least else 0.0:.4g}" for x in values.tolist())


def posture_lines(result: PostureStiffness) -> list[str]:
    """Mechanism, posture, load, what exists, and codes of notes, a line each."""
    elastic, W = result.elastic, result.wrench
    exists = [name for name, K in result.matrices.items() if K is not None]
    return [
        f"Stiffness of {elastic.name} ({elastic.mechanism.kind}) at {elastic.mechanism.frame}",
        f"  q        {numbers_text(result.q)}",
        "  load     "
        + ("none that balances" if W is None else f"{numbers_text(W)} (moment, force; body axes)"),
        "  matrices "
        + (", ".join(f"K^{name}" for name in exists) or "none exists here")
        + f" in {elastic.units.force} and {elastic.units.length}: .A .B .K .F, .matrices",
        f"  notes    {codes_of(result.notes)}",
    ]


def load_dict(result: PostureStiffness) -> dict[str, Any]:
    """What the load does, where it acts, and the tangent that follows, as plain data."""
    K, C = result.tangent, result.tangent_compliance
    return {
        "kind": result.load.kind,
        "at": list(result.load.at),
        "meaning": result.load.words,
        "stiffness": None if K is None else K.tolist(),
        "compliance": None if C is None else C.tolist(),
    }


def codes_of(notes: Iterable[Note]) -> str:
    """The codes of notes, each once, in a line."""
    return ", ".join(dict.fromkeys(note.code for note in notes)) or "none"


def matrix_html(matrix: Array, block_units: BlockUnits, title: str, order: str) -> str:
    """A 6x6 matrix as a table, the unit of each 3x3 block beside its rows and over its columns."""
    parts = ("rotation", "translation")
    names = parts if order == "angular-linear" else parts[::-1]
    size = float(np.abs(matrix).max(initial=0.0))
    rows = [
        (
            names[i // 3],
            *(f"{0.0 if abs(x) < numerics.LAST_DIGITS * size else x:.6g}" for x in row),
            " | ".join(block_units[i // 3]),
        )
        for i, row in enumerate(matrix.tolist())
    ]
    return html_table([("", 1), *((name, 3) for name in names), ("units", 1)], rows, title)


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
        **result.elastic.mechanism.frames_as_dict(),
        "order": se3.ANGULAR_LINEAR,
        "units": result.elastic.units.as_dict(),
        "q": result.q.tolist(),
        "pose": result.pose.tolist(),
        "jacobian": plain(result.jacobian),
        "wrench": plain(result.wrench),
        "load": result.load_as_dict(),
        **gravity_loads(result.elastic).as_dict(),
        "energy": None if np.isnan(result.energy) else result.energy,
        "stored_energy": None if np.isnan(result.stored_energy) else result.stored_energy,
        "stiffness": {name: plain(K) for name, K in result.matrices.items()},
        "compliance": {name: plain(C) for name, C in result.compliances.items()},
        "notes": [note.as_dict() for note in result.notes],
    }
