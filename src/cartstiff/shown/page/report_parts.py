"""Fragments of a report in HTML: lists, an answer's tables, matrices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from cartstiff.answer.data import Table
from cartstiff.core.errors import printable
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.shown.report.answer import (
    lines_below,
    table_cells,
    table_head,
    table_title,
)
from cartstiff.shown.report.matrices import matrices_of

# Digits of matrices.
_DIGITS = 4


def text(words: str) -> str:
    """Words as HTML."""
    return escape(printable(words))


def section(title: str, body: str) -> str:
    """A part of a report under its title; nothing without a body."""
    return f"<section><h2>{text(title)}</h2>{body}</section>" * bool(body)


def items(lines: Sequence[str]) -> str:
    """A list of sentences."""
    return "".join(f"<li>{text(line)}</li>" for line in lines)


def table(rows: Sequence[Sequence[str]], heads: Sequence[str] = ()) -> str:
    """A table."""
    lines = ["".join(f"<td>{text(cell)}</td>" for cell in row) for row in rows]
    cells = "".join(f"<th>{text(head)}</th>" for head in heads)
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in (cells, *lines) if line)}</table>"  # noqa: E501


def tables(shown: Iterable[Table]) -> str:
    """Tables of an answer under their titles."""
    found = []
    for one in shown:
        columns, cells = table_cells(one)
        below = "".join(f"<p>{text(line)}</p>" for line in lines_below(one))
        body = table(cells, [table_head(column) for column in columns])
        found.append(section(table_title(one), body + below))
    return "".join(found)


def matrix(result: PostureStiffness) -> str:
    """The stiffness, in task axes where the body has fewer than six freedoms;
    or the compliance.
    """
    connection = ("B", "load")[result.is_loaded]
    parts = [
        f"<p>{text(shown.caption)}</p>{table(shown.rows, shown.heads)}"
        for shown in matrices_of(result, _DIGITS, only=connection)
    ]
    return "".join(parts) or (
        "<p>Neither stiffness nor compliance exists here; see what is assumed.</p>"
    )
