"""How results show themselves: lines in Python, a table in a notebook, plain data for JSON."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.notebook import html_table
from cartstiff.notes import Note

if TYPE_CHECKING:
    pass

SCHEMA = "cartstiff/1"

BlockUnits = tuple[tuple[str, str], tuple[str, str]]


def numbers_text(values: Array) -> str:
    """A few numbers on one line, to four digits; what is rounding of the largest is 0."""
    least = numerics.BLANK * np.abs(values).max(initial=0.0)
    return ", ".join(f"{x if abs(x) > least else 0.0:.4g}" for x in values.tolist())


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
