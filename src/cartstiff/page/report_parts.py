"""Fragments of a report in HTML: lists, an answer's tables, matrices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from itertools import product

import numpy as np

from cartstiff import numerics
from cartstiff.answer.data import Answer
from cartstiff.errors import printable
from cartstiff.geometry.se3 import Array
from cartstiff.report.answer import table_cells, table_head, table_title
from cartstiff.stiffness.posture import PostureStiffness
from cartstiff.units import sized

# Components of motions, and of the wrenches beside them.
_SIX = ("rx", "ry", "rz", "x", "y", "z")
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


def answer_tables(answer: Answer) -> str:
    """The tables of an answer under their titles.

    Rows of joints of which nothing but the position is known, as of passive ones in
    loops, are counted below; a table that says nothing more than one before is left out.
    """
    found, told = [], set[str]()
    for shown in answer.tables:
        rows = [row for row in shown.rows if any(cell is not None for cell in row[2:])]
        names = {str(row[0]) for row in rows}
        if names <= told:
            continue
        told |= names
        columns, cells = table_cells(replace(shown, rows=tuple(rows)))
        left = len(shown.rows) - len(rows)
        below = f"<p>{left} without spring, limits and share are not listed.</p>"
        body = table(cells, [table_head(column) for column in columns])
        found.append(section(table_title(shown), body + below * bool(left)))
    return "".join(found)


def vector(values: Array, unit: str) -> str:
    """Components with four digits, in the unit in which people read the largest."""
    size, unit = sized(float(np.abs(values).max()), unit)
    least = numerics.PRINTED_AS_ZERO * np.abs(values).max()
    return f"({_row(np.where(np.abs(values) < least, 0.0, values) / size)}) {unit}"


def _row(values: Array) -> str:
    return ", ".join(f"{x + 0.0:.{_DIGITS}g}" for x in values)


def matrix(result: PostureStiffness, what: str) -> str:
    """The stiffness, in task axes where the body has fewer than six freedoms;
    or the compliance. `what` names the stiffness.
    """
    units, connection = result.units, ("B", "load")[result.is_loaded]
    here = result.at()
    if (K := here.matrices[connection]) is not None:
        return f"<p>{what}, along the axes of M.</p>{_block_table(K, _SIX, units.blocks)}"
    parts = []
    if (task := result.task_axes) is not None:
        name = f"{what}, along the motions that the body has, in axes of {task.axes}"
        parts.append(
            f"<p>{name}.</p>{_block_table(task.tangent, task.names, units.blocks)}"
        )
    if (C := here.compliances[connection]) is not None:
        name = "The stiffness does not exist here; the compliance C, along the axes of M"
        parts.append(f"<p>{name}.</p>{_block_table(C, _SIX, units.blocks_of_compliance)}")
    return "".join(parts) or (
        "<p>Neither stiffness nor compliance exists here; see what is assumed.</p>"
    )


def _block_table(matrix: Array, names: Sequence[str], blocks: Mapping[str, str]) -> str:
    """A matrix with four digits, each block in the unit in which people read its
    largest entry.
    """
    kinds = np.array(["rt"[name in ("x", "y", "z")] for name in names])
    small = numerics.PRINTED_AS_ZERO * np.abs(matrix).max()
    shown, units = np.where(np.abs(matrix) < small, 0.0, matrix), {}
    for row, column in product("rt", repeat=2):
        block = np.ix_(kinds == row, kinds == column)
        if matrix[block].size:
            size, units[row, column] = sized(
                float(np.abs(shown[block]).max()), blocks[row + column]
            )
            shown[block] /= size
    rows = [
        [
            name,
            *(f"{x + 0.0:.{_DIGITS}g}" for x in line),
            " | ".join(units[kind, c].removeprefix("1") or "1" for c in sorted({*kinds})),
        ]
        for name, kind, line in zip(names, kinds, shown, strict=True)
    ]
    of = " | ".join({"r": "turns", "t": "translations"}[c] for c in sorted({*kinds}))
    return table(rows, ["", *names, f"units: columns of {of}"])
