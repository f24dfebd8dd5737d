"""An answer as text: what was asked, its sentences, its doubts, its tables."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from cartstiff.answer.data import Answer, Column, Quantity, Table, said
from cartstiff.errors import joined
from cartstiff.notes import DOUBTS
from cartstiff.report.layout import note_lines, table
from cartstiff.report.sentences import (
    SENTENCES,
    TITLES,
    answer_sentences,
    sentence,
    statement_sentences,
    value_words,
)
from cartstiff.units import shown_unit


def answer_text(answer: Answer) -> str:
    """An answer as its command prints it."""
    is_loaded = answer.load is not None and answer.load.given
    return joined(
        [
            *statement_sentences(answer, answer.about),
            *statement_sentences(answer, [said("load")] * is_loaded),
            *(weight.text for weight in (answer.weight,) if weight),
            *answer_lines(answer),
            *tables_lines(answer.tables),
            *note_lines(answer.notes),
        ]
    )


def tables_lines(tables: Iterable[Table]) -> list[str]:
    """Tables below each other."""
    return [line for shown in tables for line in table_lines(shown)]


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


def table_lines(shown: Table) -> list[str]:
    """A table under its title, without empty columns, and what it needs to be read."""
    title, (columns, texts) = table_title(shown), table_cells(shown)
    left = [i for i, column in enumerate(columns) if column.form.endswith("<")]
    body = table([table_head(column) for column in columns], texts, left)
    if not columns:
        body = ["  none"] * bool(shown.columns)
    return [
        "",
        *([title] * bool(title)),
        *body,
        *(sentence(SENTENCES[x.code], x.values) for x in shown.below),
    ]


def table_title(shown: Table) -> str:
    """What a table is headed by; its name with a capital, unless it has other words."""
    title = TITLES.get(shown.name, shown.name.capitalize())
    return sentence(title, shown.values)


def table_cells(shown: Table) -> tuple[list[Column], list[list[str]]]:
    """Columns of a table that are not empty, and their rows of cells."""
    cells = zip(*shown.rows, strict=True)
    kept = [
        (column, [cell_text(cell, column) for cell in own])
        for column, own in zip(shown.columns, cells, strict=False)
        if any(cell is not None for cell in own)
    ]
    rows = zip(*(texts for _, texts in kept), strict=True)
    return [column for column, _ in kept], [list(row) for row in rows]


def table_head(column: Column) -> str:
    """Name of a column with the unit that people read."""
    return f"{column.head}{f' [{shown_unit(column.unit)[0]}]' * bool(column.unit)}"


def cell_text(cell: Any, column: Column) -> str:
    """A cell as people read it: in the unit of its column, or in its own."""
    form = column.form.rstrip("<?")
    if cell is None:
        return "-" * (not column.form.endswith("?"))
    if isinstance(cell, Quantity):
        return value_words(cell, form or "4e")
    if isinstance(cell, float):
        cell *= shown_unit(column.unit)[1]
    return value_words(cell, form)
