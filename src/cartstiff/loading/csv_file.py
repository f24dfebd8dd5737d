"""Files of comma-separated numbers, one row a line."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from cartstiff.errors import InputError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.loading.yaml_file import LARGEST, read_text
from cartstiff.parsing import parse_numbers

__all__ = ["Rows", "read_rows"]


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
    for number, line in enumerate(read_text(path, largest).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        place = f"{where}, line {number}"
        if names is None and not rows:
            begin = place
            cells = tuple(cell.strip().strip('"') for cell in line.split(","))
            if any(map(_is_word, cells)):
                names = cells
                twice = [name for name in names if names.count(name) > 1]
                if twice:
                    raise InputError("column named twice", where=place, got=repr(twice[0]))
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
