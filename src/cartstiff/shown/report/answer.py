"""An answer as text: what was asked, its sentences, its doubts, its tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from cartstiff.answer.data import Answer, Column, Quantity, Table, said
from cartstiff.core.errors import joined
from cartstiff.core.notes import DOUBTS
from cartstiff.core.units import shown_unit
from cartstiff.shown.report.layout import note_lines, table
from cartstiff.shown.report.sentences import (
    SENTENCES,
    TITLES,
    answer_sentences,
    sentence,
    statement_sentences,
    value_words,
)

#: Lines of a screen, and its columns.
SCREEN, COLUMNS = 42, 100
#: A part of a text: its name, and its lines.
Block = tuple[str, Sequence[str]]


def answer_text(
    answer: Answer,
    blocks: Iterable[Block] = (),
    *,
    whole: Iterable[str] = (),
    elsewhere: str = "",
) -> str:
    """An answer as its command prints it: what was asked, its sentences, its doubts;
    its tables, further blocks and notes.

    Parameters
    ----------
    answer : Answer
        The answer.
    blocks : iterable of Block
        What is printed after its tables.
    whole : iterable of str
        Lines before the tables.
    elsewhere : str
        Where the rest is: only those tables and blocks are printed that fit on a screen,
        and the last line names the others. Empty: everything is printed.
    """
    is_loaded = answer.load is not None and answer.load.given
    lines = [
        *statement_sentences(answer, answer.about),
        *statement_sentences(answer, [said("load")] * is_loaded),
        *(weight.text for weight in (answer.weight,) if weight),
        *answer_lines(answer),
        *whole,
    ]
    tables = in_short(answer.tables) if elsewhere else answer.tables
    own: list[Block] = [(table_title(shown), table_lines(shown)) for shown in tables]
    notes: Block = ("notes", note_lines(answer.notes))
    if elsewhere:
        # What is assumed comes before what only takes room.
        every = [*own, notes, *blocks]
        return joined([*lines, *_fitting(every, SCREEN - height(lines), elsewhere)])
    every = [*own, *blocks, notes]
    return joined([*lines, *(line for _, body in every for line in body)])


def height(lines: Iterable[str]) -> int:
    """Number of a screen's lines that lines take."""
    return sum(max(1, -(-len(line) // COLUMNS)) for line in lines)


def _fitting(blocks: Sequence[Block], room: int, elsewhere: str) -> list[str]:
    """The blocks that fit into a number of lines; the names of the others."""
    if sum(height(body) for _, body in blocks) <= room:
        return [line for _, body in blocks for line in body]
    # The last line takes as many lines as it needs.
    last = 1
    while True:
        kept, left, free = list[str](), list[str](), room - last
        for name, body in blocks:
            if height(body) > free:
                left.append(name[:1].lower() + name[1:])
            else:
                kept += body
                free -= height(body)
        line = f"Not shown: {', '.join(left)}; {elsewhere}"
        if height([line]) <= last:
            return [*kept, line]
        last = height([line])


def in_short(tables: Iterable[Table]) -> list[Table]:
    """Tables without the rows that say nothing more than those of the same name in one
    before, as of drives; and without those of which nothing but the position is known, as
    of passive joints in loops, which are counted below.
    """
    found, told = list[Table](), dict[Any, list[Any]]()
    for shown in tables:
        heads, rows, left = [column.head for column in shown.columns], [], 0
        for row in shown.rows:
            own = [x for x in zip(heads, row, strict=True) if x[1] is not None][1:]
            before = told.setdefault(str(row[0]), [])
            is_new = any(x not in before for x in own)
            is_known = any(cell is not None for cell in row[2:])
            rows += [row] * (is_new and is_known)
            left += is_new and not is_known
            before += own
        below = [*shown.below, *[said("rows-left-out", count=left)] * bool(left)]
        if rows:
            found.append(replace(shown, rows=rows, below=below))
    return found


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
        *lines_below(shown),
    ]


def lines_below(shown: Table) -> list[str]:
    """What a table needs to be read."""
    return [sentence(SENTENCES[one.code], one.values) for one in shown.below]


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
