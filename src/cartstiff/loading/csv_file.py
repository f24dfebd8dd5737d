"""Tables of numbers in text files, one row a line, with units in the head."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from cartstiff.arrays import unsafe_cell
from cartstiff.errors import InputError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.loading.yaml_file import LARGEST, read_text
from cartstiff.mechanisms.contract import FORCES, LENGTHS, SI, Units, convert_length
from cartstiff.parsing import parse_numbers


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
    factors : mapping of str to float
        Of columns without names of their own, by the names that a layout gives them.
    """

    values: Array
    names: tuple[str, ...] | None
    place: str
    factors: Mapping[str, float] = MappingProxyType({})

    def arranged(self, *layouts: tuple[str, ...]) -> tuple[tuple[str, ...], Array, tuple[str, ...]]:
        """The layout that fits, the columns in its order, and the names of what is not needed.

        Named columns may stand in any order, and others beside them that belong to no layout, nor
        look like a slip of the pen; columns without names are told by their number.

        Raises
        ------
        InputError
            If none fits.
        """
        width = self.values.shape[1]
        wanted = {name for layout in layouts for name in layout}
        for layout in sorted(layouts, key=len, reverse=True):
            if self.names is None and len(layout) == width:
                return layout, self.values * [self.factors.get(n, 1.0) for n in layout], ()
            if self.names is not None and set(layout) <= set(self.names):
                more = tuple(name for name in self.names if name not in layout)
                if not any(n in wanted or get_close_matches(n, wanted - {*layout}) for n in more):
                    columns = [self.names.index(name) for name in layout]
                    return layout, self.values[:, columns], more
        if self.names is not None:
            expected = " or ".join(", ".join(layout) for layout in layouts)
            raise InputError(
                "columns do not fit", where=self.place, expected=expected, got=", ".join(self.names)
            )
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


def read_cells(
    path: Path, what: str, largest: int = LARGEST, joints: tuple[str, ...] = ()
) -> Cells:
    """Rows of text under a line of names; for tables in which not every cell is a number.

    Cells are separated as in `read_rows`; decimal commas of numbers come back as points.

    Parameters
    ----------
    path, what, largest, joints
        As in `read_rows`.

    Raises
    ------
    InputError
        With file and line: no line of names, no rows, a row of another length.
    """
    lines = _lines(path, largest)
    begin, first = next(lines, (one_line(str(path)), ""))
    separator = _separator(first)
    names = _names(first, begin, separator)
    if names is None:
        raise InputError("no line of names", where=begin, expected="names of the columns first")
    rows, places = list[list[str]](), list[str]()
    for place, line in lines:
        cells = _cells(line, separator)
        if separator != ",":
            cells = _with_points(cells, place)
        _refuse_doubled(line, separator, place, len(names))
        if len(cells) != len(names):
            raise InputError(
                "wrong count", where=place, expected=f"{len(names)} cells", got=str(len(cells))
            )
        rows.append(cells)
        places.append(place)
    if not rows:
        raise InputError(
            f"no {what}", where=one_line(str(path)), expected="one a line, comma-separated"
        )
    return Cells(_numbered(names, joints), rows, places, begin)


def _lines(path: Path, largest: int) -> Iterator[tuple[str, str]]:
    """Place and text of each line; empty ones and those that start with # are left out.

    So is a first line ``sep=;``, by which spreadsheets tell each other what stands between cells.
    """
    where = one_line(str(path))
    for number, line in enumerate(read_text(path, largest).splitlines(), start=1):
        if number == 1 and _SEPARATOR.fullmatch(line.strip()):
            continue
        if line.strip() and not line.lstrip().startswith("#"):
            yield f"{where}, line {number}", line


def _cells(line: str, separator: str) -> list[str]:
    """Cells of a line; what stands between separators in quotes is one."""
    parts = line.split(separator)
    if '"' in line and len(line) < csv.field_size_limit():
        parts = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [unsafe_cell(cell.strip().strip('"')) for cell in parts]


def _numbered(heads: tuple[str, ...], joints: tuple[str, ...]) -> tuple[str, ...]:
    """Heads by the joints' names, where all joints are q1, q2, ... in joint order."""
    bare = [head.split("[")[0].strip() for head in heads]
    called = {f"q{i}": name for i, name in enumerate(joints, start=1)}
    if not called or not called.keys() <= set(bare) or set(joints) & set(bare):
        return heads
    pairs = zip(heads, bare, strict=True)
    return tuple(head.replace(name, called.get(name, name), 1) for head, name in pairs)


def _refuse_doubled(line: str, separator: str, place: str, width: int | None) -> None:
    """Refuse twice as many commas as there can be."""
    if separator == "," and width is not None and line.count(",") == 2 * width - 1:
        raise InputError(
            "commas between numbers and in them, it seems",
            where=place,
            expected="semicolons between numbers with decimal commas",
            got=repr(line),
        )


def _separator(line: str) -> str:
    """What stands between the cells of a table, by its first line."""
    return next((mark for mark in ";\t" if mark in line), ",")


def _with_points(cells: list[str], place: str) -> list[str]:
    """Decimal commas of numbers as points; a line has one or the other."""
    changed = [
        cell.replace(",", ".") if not _is_word(cell.replace(",", ".")) else cell for cell in cells
    ]
    if changed != cells and any("." in cell and not _is_word(cell) for cell in cells):
        raise InputError(
            "decimal commas and points in one line",
            where=place,
            expected="one of them",
            got=repr("; ".join(cells)),
        )
    return changed


def _names(line: str, place: str, separator: str = ",") -> tuple[str, ...] | None:
    """Names of columns, or None for a line of numbers."""
    cells = tuple(map(in_brackets, _cells(line, separator)))
    points = cells if separator == "," else [cell.replace(",", ".") for cell in cells]
    if not any(map(_is_word, points)):
        return None
    _refuse_twice(cells, place)
    return cells


def read_rows(
    path: Path,
    what: str,
    largest: int = LARGEST,
    units: Units = SI,
    factors: Mapping[str, float] = MappingProxyType({}),
    joints: tuple[str, ...] = (),
) -> Rows:
    """Rows of numbers from a file.

    Words in the first line are the names of the columns, with units in square brackets where they
    are not rad and those of `units`: ``elbow [deg]``, ``x [mm]``. Cells are separated by commas,
    semicolons or tabs; between semicolons and tabs a comma is the decimal one. Empty lines and
    lines that start with # are left out.

    Parameters
    ----------
    path : Path
        UTF-8 text.
    what : str
        What a row is, in the plural.
    largest : int
        Bytes that are read at most.
    units : Units
        What lengths and forces come in.
    factors : mapping of str to float
        By name, of columns whose head has no unit: pi/180 for angles that are in degrees.
    joints : tuple of str
        Names of the joints in order: heads may call all of them q1, q2, ... instead.

    Raises
    ------
    InputError
        With file and line.
    """
    where = one_line(str(path))
    names: tuple[str, ...] | None = None
    begin, rows, sizes, separator = where, list[list[float]](), list[float](), ","
    for place, line in _lines(path, largest):
        if names is None and not rows:
            separator = _separator(line)
            begin, names = place, _names(line, place, separator)
            if names is not None:
                heads = _numbered(names, joints)
                both = [named_unit(cell, units, place) for cell in heads]
                names = tuple(n for n, _ in both)
                sizes = [factors.get(n, 1.0) if f is None else f for n, f in both]
                _refuse_twice(names, place)
                continue
        width = len(names) if names else len(rows[0]) if rows else None
        rows.append(_numbers(line, separator, place, width))
    if not rows:
        raise InputError(f"no {what}", where=where, expected="one a line, comma-separated")
    return Rows(np.array(rows) * (sizes or 1.0), names, begin, factors)


def _numbers(line: str, separator: str, place: str, width: int | None) -> list[float]:
    if separator != ",":
        if "," in line and "." in line:
            raise InputError(
                "decimal commas and points in one line",
                where=place,
                expected="one of them",
                got=repr(line),
            )
        line = line.replace(",", ".").replace(separator, ",")
    _refuse_doubled(line, separator, place, width)
    return parse_numbers(line, place, width)


_ROUND = re.compile(
    r"\(\s*((?:[mcdu\u00b5\u03bc]?m|in|ft|k?N(?:[ *]?[mcd]?m)?|kg|g|m?s|m?rad|deg|\u00b0))\s*\)\s*$"
)
# The first line of some spreadsheets' tables.
_SEPARATOR = re.compile(r"sep=[;,\t]?", re.IGNORECASE)
#: Signs in units: of degrees, and two that stand for micro.
SIGNS = str.maketrans({"\u00b0": "deg", "\u00b5": "u", "\u03bc": "u"})
_PLAIN = {
    "": 1.0,
    "1": 1.0,
    "-": 1.0,
    "rad": 1.0,
    "mrad": 1e-3,
    "deg": np.pi / 180,
    "s": 1.0,
    "ms": 1e-3,
}


def in_brackets(head: str) -> str:
    """A head with its unit in square brackets, where that stands in round ones: ``x (mm)``."""
    return _ROUND.sub(r"[\1]", head)


def named_unit(cell: str, units: Units, place: str) -> tuple[str, float | None]:
    """Name of a column, and the factor that takes its numbers to radians, seconds and `units`.

    None where the cell names no unit.
    """
    match = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]", cell)
    if match is None:
        return cell, None
    name, unit = match[1], " ".join(match[2].translate(SIGNS).split())
    if unit in _PLAIN:
        return name, float(_PLAIN[unit])
    length, force = convert_length(SI, units)
    known = {u: size * length for u, size in LENGTHS.items()}
    known |= {u: size * force for u, size in FORCES.items()}
    known |= {
        f"{f}{gap}{u}": a * force * b * length
        for f, a in FORCES.items()
        for u, b in LENGTHS.items()
        for gap in ("", " ", "*")
    }
    if unit not in known:
        raise InputError(
            f"column {name!r} has an unknown unit",
            where=place,
            got=repr(unit),
            expected=f"{', '.join([*LENGTHS, *FORCES])}, N m, deg, rad, s",
        )
    return name, known[unit]


def _refuse_twice(names: tuple[str, ...], place: str) -> None:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError("column named twice", where=place, got=repr(twice[0]))


def _is_word(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return True
    return False
