"""What a report states, read from its HTML and compared with an answer's JSON."""

import html
import re

import numpy as np
import pytest

from tests.support.printed import TITLES, VERDICTS
from tests.support.read_units import si


def words(text):
    text = re.sub(r"<(style|svg|iframe).*?</\1>", " ", text, flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]+>", " ", text))


def table_after(text, head):
    """Cells of the first table after a heading, as floats where they are numbers."""
    rows = re.search(f"<h2>{head}</h2>.*?<table>(.*?)</table>", text, re.DOTALL).group(1)
    rows = [re.findall(r"<t[hd]>(.*?)</t[hd]>", row) for row in rows.split("</tr>")]
    return [[html.unescape(cell) for cell in row] for row in rows if row]


def matrix_after(text, elastic):
    """The first matrix of the report in the mechanism's units, and its blocks."""
    head, *rows = table_after(text, "Stiffness")
    names = head[1:-1]
    kinds = np.array([name in "xyz" for name in names])
    values = np.array([[float(x) for x in row[1:-1]] for row in rows])
    u = elastic.units
    own = {**u.blocks}
    blocks = []
    for row in sorted({*kinds}):
        units = next(r[-1] for r, kind in zip(rows, kinds, strict=True) if kind == row).split(" | ")
        for column, unit in zip(sorted({*kinds}), units, strict=True):
            block = np.flatnonzero(kinds == row), np.flatnonzero(kinds == column)
            key = "rt"[int(row)] + "rt"[int(column)]
            values[np.ix_(*block)] *= si(unit) / si(own[key])
            blocks.append(block)
    return values, blocks


METRES = {"m": 1.0, "cm": 0.01, "mm": 1e-3}


def said_under(text):
    """The answer of a report, without what is said of another posture."""
    return words(text).partition("Better posture")[0]


def si_length(shown):
    """A length in m."""
    number, unit = shown.split()
    return float(number) * si(unit)


def states_what_is_said(text, result, answer):
    """A report has the numbers, verdict and doubts of an answer's JSON, and no others."""
    said, units = said_under(text), result.units
    verdict = answer["verdict"]
    assert VERDICTS[verdict["code"]] in said
    assert [title for title in VERDICTS.values() if title in said] == [VERDICTS[verdict["code"]]]
    for doubt in answer["doubts"]:
        assert doubt["message"].lower() in said.lower()
    moved = answer["displacement"]
    shown = re.search(r"The body frame moves (\S+ \S+) under", said)
    is_far = moved is not None and (moved["difference"] or 0.0) > 0.02
    motion = moved and moved["equilibrium" if is_far else "first_order"]
    if motion is None or not np.any(motion["translation"]):
        assert shown is None
    elif moved["by"] != "preload":
        far = np.linalg.norm(motion["translation"]) * METRES[units.length]
        assert si_length(shown.group(1)) == pytest.approx(far, rel=6e-4)
        drawn = re.search(r"the tip moves (\S+ \S+)\)", words(text))
        assert drawn is None or drawn.group(1) == shown.group(1)
    # Softest and stiffest directions, against forces and moments.
    for extreme in answer["extremes"]:
        own = "turn" if extreme["freedom"] == "translation" else "move"
        if extreme["others"] == "held" or extreme["stiffness"] is None:
            continue
        found = re.search(
            rf"{extreme['end'].capitalize()} \(free to {own}\): (\S+) (\S+(?: m/rad)?) "
            r"(?:along|about) (\(.*?\)|more)",
            said,
        )
        unit = units.stiffness[extreme["freedom"]]
        size = float(found.group(1)) * si(found.group(2)) / si(unit)
        assert size == pytest.approx(extreme["stiffness"], rel=6e-4)
        if extreme["direction"] is None:
            assert found.group(3) == "more"
        else:
            named = [float(x) for x in found.group(3).strip("()").split(",")]
            assert named == pytest.approx(extreme["direction"], abs=6e-3)
    if answer["shares"] is not None:
        first = answer["shares"]["parts"][0]
        assert f"{round(100 * first['share'])} % of" in said
    # Tables: every cell that has a number.
    told = {}
    for table in answer["tables"]:
        heads, full = [column["head"] for column in table["columns"]], []
        for row in table["rows"]:
            # A row that has a position alone is counted; drives are no joints again.
            own = [x for x in zip(heads[1:], row[1:], strict=True) if x[1] is not None]
            before = told.setdefault(row[0], [])
            is_new = any(x not in before for x in own)
            full += [row] * (is_new and any(cell is not None for cell in row[2:]))
            before += own
        if not full:
            continue
        rows = table_after(text, TITLES.get(table["name"], table["name"].capitalize()))
        assert len(rows) == 1 + len(full)
        for cells, row in zip(rows[1:], full, strict=True):
            for head, cell in zip(rows[0], cells, strict=True):
                value = row[heads.index(head)]
                assert_same_cell(cell, value, (table["name"], row[0], head))
    # The matrix, each block to four digits.
    K = result.tangent if result.is_loaded else result.matrices["B"]
    if K is None:
        K = result.tangent_compliance if result.is_loaded else result.compliances["B"]
        assert result.task_axes is not None or "the compliance" in said
    matrix, blocks = matrix_after(text, result)
    if (task := result.task_axes) is not None:
        assert len(matrix) == len(task.names)
        K = task.tangent
    for rows, columns in blocks:
        block = K[np.ix_(rows, columns)]
        miss = matrix[np.ix_(rows, columns)] - block
        assert np.abs(miss).max() <= 6e-4 * np.abs(block).max() + 1e-12 * np.abs(K).max()


def assert_same_cell(cell, value, what):
    """A cell of the report, and of the answer: words, or a value with its unit."""
    if not isinstance(value, dict):
        assert cell == (value or ""), what
        return
    number, unit = value["value"], value["unit"]
    if unit == "1":
        assert cell == f"{round(100 * number) + 0} %", what
        return
    shown, own = cell.split(" ", 1)
    if unit == "rad":
        assert float(cell.split()[-2]) == pytest.approx(np.degrees(number), rel=6e-4, abs=1e-3), (
            what
        )
        return
    assert float(shown) * si(own) == pytest.approx(number * si(unit), rel=6e-4, abs=1e-12), what
