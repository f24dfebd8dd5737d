"""Files of comma-separated numbers, one row a line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cartstiff.errors import InputError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.loading.yaml_file import LARGEST, read_text
from cartstiff.parsing import parse_numbers

__all__ = ["Cells", "Rows", "read_cells", "read_rows"]


class Rows(NamedTuple):
    """What such a file holds.

    Attributes
    ----------
    values : ndarray (N, m)
        The numbers, N at least 1.
    names : tuple of str or None
        The columns', where the file begins with a line of words.
    place : str
        File and line of the names, or else of the first row.
    """

    values: Array
    names: tuple[str, ...] | None
    place: str

    def arranged(self, *layouts: tuple[str, ...]) -> tuple[tuple[str, ...], Array]:
        """The layout that fits, and the columns in its order.

        Named columns may stand in any order; others are told by their number.

        Raises
        ------
        InputError
            If none fits.
        """
        width = self.values.shape[1]
        for layout in layouts:
            if self.names is None and len(layout) == width:
                return layout, self.values
            if self.names is not None and sorted(self.names) == sorted(layout):
                return layout, self.values[:, [self.names.index(name) for name in layout]]
        if self.names is not None:
            expected = " or ".join(", ".join(layout) for layout in layouts)
            raise InputError("columns do not fit", where=self.place, expected=expected,
                             got=", ".join(self.names))  # fmt: skip
        expected = ", or ".join(
            f"{len(layout)} numbers ({', '.join(layout)})" for layout in layouts
        )
        raise InputError("wrong count", where=self.place, expected=expected, got=str(width))


class Cells(NamedTuple):
    """What a file of named columns holds, as text; cells may be empty.

    Attributes
    ----------
    names : tuple of str
        The columns'.
    rows : list of list of str
        One per line, each as long as `names`.
    places : list of str
        File and line of each row.
    place : str
        File and line of the names.
    """

    names: tuple[str, ...]
    rows: list[list[str]]
    places: list[str]
    place: str


def read_cells(path: Path, what: str, largest: int = LARGEST) -> Cells:
    """Rows of text under a line of names; for tables in which not every cell is a number.

    Parameters
    ----------
    path, what, largest
        As in `read_rows`.

    Raises
    ------
    InputError
        With file and line: no line of names, no rows, a row of another length.
    """
    lines = _lines(path, largest)
    begin, first = next(lines, (one_line(str(path)), ""))
    names = _names(first, begin)
    if names is None:
        raise InputError("no line of names", where=begin, expected="names of the columns first")
    rows, places = list[list[str]](), list[str]()
    for place, line in lines:
        cells = [cell.strip().strip('"') for cell in line.split(",")]
        if len(cells) != len(names):
            raise InputError("wrong count", where=place, expected=f"{len(names)} cells",
                             got=str(len(cells)))  # fmt: skip
        rows.append(cells)
        places.append(place)
    if not rows:
        raise InputError(f"no {what}", where=one_line(str(path)),
                         expected="one a line, comma-separated")  # fmt: skip
    return Cells(names, rows, places, begin)


def _lines(path: Path, largest: int) -> Iterator[tuple[str, str]]:
    """Place and text of each line; empty ones and those that start with # are left out."""
    where = one_line(str(path))
    for number, line in enumerate(read_text(path, largest).splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield f"{where}, line {number}", line


def _names(line: str, place: str) -> tuple[str, ...] | None:
    """Names of columns, or None for a line of numbers."""
    cells = tuple(cell.strip().strip('"') for cell in line.split(","))
    if not any(map(_is_word, cells)):
        return None
    twice = [name for name in cells if cells.count(name) > 1]
    if twice:
        raise InputError("column named twice", where=place, got=repr(twice[0]))
    return cells


def read_rows(path: Path, what: str, largest: int = LARGEST) -> Rows:
    """Rows of numbers from a file.

    Words in the first line are the names of the columns. Empty lines and lines that start with #
    are left out.

    Parameters
    ----------
    path : Path
        UTF-8 text.
    what : str
        What a row is, in the plural.
    largest : int
        Bytes that are read at most.

    Raises
    ------
    InputError
        With file and line.
    """
    where = one_line(str(path))
    names: tuple[str, ...] | None = None
    begin, rows = where, list[list[float]]()
    for place, line in _lines(path, largest):
        if names is None and not rows:
            begin, names = place, _names(line, place)
            if names is not None:
                continue
        width = len(names) if names else len(rows[0]) if rows else None
        rows.append(parse_numbers(line, place, width))
    if not rows:
        raise InputError(f"no {what}", where=where, expected="one a line, comma-separated")
    return Rows(np.array(rows), names, begin)


def _is_word(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return True
    return False
