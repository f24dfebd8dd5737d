"""An answer as text: its sentences, its doubts, its tables."""

from __future__ import annotations

import math

import numpy as np

from cartstiff.answer.data import Answer, Quantity, Table
from cartstiff.answer.posture import answer_at
from cartstiff.notes import DOUBTS
from cartstiff.report.layout import table
from cartstiff.report.sentences import answer_sentences, percent
from cartstiff.stiffness.posture import PostureStiffness
from cartstiff.units import engineering


def answer_lines(answer: Answer) -> list[str]:
    """The answer in sentences, then the reasons to doubt it."""
    # The weightiest doubts are the first sentences of every command.
    doubts = [str(note) for note in answer.doubts if note.code not in DOUBTS]
    parts = {"Answer": answer_sentences(answer), "Doubts": doubts}
    return [
        line
        for title, lines in parts.items()
        if lines
        for line in ("", title, *(f"  {line}" for line in lines))
    ]


def displayed(result: PostureStiffness) -> list[str]:
    """A posture's answer in a notebook, under its name."""
    with np.errstate(all="ignore"):
        answer = answer_at(result)
    name = f"Stiffness of {answer.subject} ({answer.kind}) at {answer.frame}"
    return [name, *answer_lines(answer)]


def table_lines(shown: Table) -> list[str]:
    """A table without its empty columns, under its name."""
    kept = [
        i
        for i in range(len(shown.columns))
        if any(row[i] is not None for row in shown.rows)
    ]
    heads = [shown.columns[i] for i in kept]
    rows = [
        [cell_text(row[i], heads[k]) for k, i in enumerate(kept)] for row in shown.rows
    ]
    return ["", shown.name.capitalize(), *table(heads, rows)]


#: Digits of places, which people type again.
_DIGITS = {"position": 6, "length": 6}


def cell_text(cell: str | Quantity | None, head: str) -> str:
    """A cell in the unit that people read; positions that are angles in both units."""
    if cell is None or isinstance(cell, str):
        return cell or ""
    if cell.unit == "1":
        return percent(cell.value)
    if cell.unit == "rad":
        both = f"{cell.value:.6g} rad " if head == "position" else ""
        return f"{both}{math.degrees(cell.value):.4g} deg"
    return engineering(cell.value, cell.unit, _DIGITS.get(head, 4))
