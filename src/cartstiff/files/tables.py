"""Read tables in text files: one row a line, with units in the head.

Cells are separated by commas, semicolons or tabs; a comma between semicolons or tabs is a
decimal comma. Units are in square or round brackets: ``elbow [deg]``, ``x (mm)``. Empty
lines and lines that start with # are ignored.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import numpy as np

from cartstiff.core.arrays import Array, unsafe_cell
from cartstiff.core.choices import AXES, Axes
from cartstiff.core.errors import InputError, one_line
from cartstiff.core.units import (
    ANGLES,
    FORCES,
    LENGTHS,
    LINEAR,
    SI,
    TORSIONAL,
    Units,
    convert_length,
    plain_unit,
)
from cartstiff.files.parsing import parse_numbers
from cartstiff.files.yaml_file import LARGEST, read_text


class Rows(NamedTuple):
    """Numbers of a table.

    Attributes
    ----------
    values : ndarray (N, m)
        The numbers, N at least 1.
    names : tuple of str or None
        Names of the columns, where the file begins with a line of words.
    place : str
        File and line of the names, or else of the first row.
    """

    values: Array
    names: tuple[str, ...] | None
    place: str

    def arranged(
        self, *layouts: tuple[str, ...]
    ) -> tuple[tuple[str, ...], Array, tuple[str, ...]]:
        """The layout that fits, its columns in order, and the names of other columns.

        Named columns may be in any order. Other columns must not belong to another
        layout, nor look like a typing error. For columns without names their number
        decides.

        Raises
        ------
        InputError
            If none fits.
        """
        width, names = self.values.shape[1], self.names
        if names is None:
            fitting = [own for own in {*layouts} if len(own) == width]
            if len(fitting) > 1:
                raise InputError(
                    "numbers without names fit two layouts",
                    where=self.place,
                    expected="a line of names",
                )
            if fitting:
                return fitting[0], self.values, ()
            shapes = (f"{len(own)} numbers ({', '.join(own)})" for own in layouts)
            expected = ", or ".join(dict.fromkeys(shapes))
            raise InputError(
                "wrong count", where=self.place, expected=expected, got=str(width)
            )
        wanted = {name for layout in layouts for name in layout}
        # The longest layout is tried first, so that no column of it is left over.
        for layout in sorted(layouts, key=len, reverse=True):
            more = tuple(name for name in names if name not in layout)
            others = wanted - {*layout}
            if {*layout} <= {*names} and not any(
                n in wanted or get_close_matches(n, others) for n in more
            ):
                columns = [names.index(name) for name in layout]
                return layout, self.values[:, columns], more
        raise InputError(
            "columns do not fit",
            where=self.place,
            expected=" or ".join(dict.fromkeys(", ".join(own) for own in layouts)),
            got=", ".join(names),
        )


MOMENT, FORCE, DIRECTION = ("mx", "my", "mz"), ("fx", "fy", "fz"), ("dx", "dy", "dz")
WRENCH = (*MOMENT, *FORCE)
_ALONG = re.compile(rf"([mfd][xyz])_({'|'.join(AXES)})")


def along_axes(names: tuple[str, ...], place: str) -> tuple[tuple[str, ...], Axes | None]:
    """Names of columns without the axes that loads and directions name, as ``fx_world``;
    the axes.

    Raises
    ------
    InputError
        If two of them name other axes, or only some name them.
    """
    named = [_ALONG.fullmatch(name) for name in names]
    bare = tuple(m[1] if m else name for m, name in zip(named, names, strict=True))
    along = {
        name: m and m[2]
        for name, own, m in zip(names, bare, named, strict=True)
        if own in (*WRENCH, *DIRECTION)
    }
    axes = {*along.values()}
    if len(axes) > 1:
        raise InputError(
            "loads and directions are along different axes",
            where=place,
            expected="the same axes for all",
            got=", ".join(along),
        )
    _refuse_twice(bare, place)
    return bare, cast("Axes | None", next(iter(axes), None))


class Cells(NamedTuple):
    """Texts of a table with named columns; cells may be empty.

    Attributes
    ----------
    names : tuple of str
        Names of the columns.
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

    def numbers(self) -> Array:
        """Return the cells as numbers; InputError with file and line."""
        pairs = zip(self.rows, self.places, strict=True)
        return np.array(
            [parse_numbers(",".join(row), place, len(row)) for row, place in pairs]
        )


def read_cells(
    path: Path,
    what: str,
    largest: int = LARGEST,
    joints: tuple[str, ...] = (),
    *,
    nameless: bool = False,
) -> Cells:
    """Read rows of text under a line of names; decimal commas become points.

    Parameters
    ----------
    path : Path
        UTF-8 text.
    what : str
        Name of the rows, for messages.
    largest : int
        Largest size of the file in bytes.
    joints : tuple of str
        Names of the joints in order, for which heads may have q1, q2, ... instead.
    nameless : bool
        Whether the line of names may be missing; rows are rows of numbers then.

    Raises
    ------
    InputError
        With file and line: no line of names, no rows, a row of another length.
    """
    where = one_line(str(path))
    lines = [*_lines(path, largest)]
    begin, first = lines[0] if lines else (where, "")
    separator = _separator(first)
    # The first line has the names, or is the first row.
    names = _names(first, begin, separator) if lines else ()
    if names is None and not nameless:
        raise InputError(
            "no line of names", where=begin, expected="names of the columns first"
        )
    rows, places = list[list[str]](), list[str]()
    for place, line in lines[1:] if names else lines:
        cells = _cells(line, separator)
        if separator != ",":
            cells = _with_points(cells, place)
        width = len(names or (rows or [cells])[0])
        if separator == "," and line.count(",") == 2 * width - 1 > 1:
            raise InputError(
                "commas between numbers and in them, it seems",
                where=place,
                expected="semicolons between numbers with decimal commas",
                got=repr(line),
            )
        if len(cells) != width:
            kind = "numbers" if nameless else "cells"
            expected, got = f"{width} {kind}", str(len(cells))
            raise InputError("wrong count", where=place, expected=expected, got=got)
        rows.append(cells)
        places.append(place)
    if not rows:
        raise InputError(
            f"no {what}", where=where, expected="one a line, comma-separated"
        )
    return Cells(_numbered(names or (), joints), rows, places, begin)


def is_table(value: Any) -> bool:
    """Whether a value has named columns: a mapping of columns, a structured array,
    or a data frame.
    """
    return (
        isinstance(value, Mapping)
        or (isinstance(value, np.ndarray) and value.dtype.names is not None)
        or (hasattr(value, "columns") and hasattr(value, "to_numpy"))
    )


def cells_of(table: Any, joints: tuple[str, ...]) -> Cells:
    """Return the cells of a table of measurements with named columns, in memory.

    Parameters
    ----------
    table : mapping of str to sequence, structured array, or data frame
        Columns by name; a data frame has ``columns`` and ``to_numpy()``, as that of
        pandas. Cells that are None or NaN are empty.
    joints
        As of `read_cells`.

    Raises
    ------
    InputError
        For columns of different lengths, without names, or without rows.
    """
    where = f"{type(table).__name__} of measurements"
    if isinstance(table, np.ndarray):
        table = {name: table[name] for name in table.dtype.names or ()}
    # Columns by name, or a data frame's rows; then texts, as a file has them.
    if isinstance(table, Mapping):
        names, columns = [*table], [np.asarray(c, object) for c in table.values()]
        lengths = [len(c) if c.ndim == 1 else -1 for c in columns]
        if -1 in lengths or len({*lengths}) > 1:
            raise InputError(
                "columns do not fit",
                where=where,
                expected="columns of one length",
                got=dict(zip(names, lengths, strict=True)),
            )
        rows = [*zip(*columns, strict=True)]
    else:
        names, rows = [*table.columns], np.asarray(table.to_numpy(), object).tolist()
    for name in names:
        if not isinstance(name, str) or not name.strip():
            raise InputError(
                "a column has no name",
                where=where,
                expected="names of the columns, such as 'fz [N]'",
                got=repr(name),
            )
    if not rows:
        raise InputError("no measurements", where=where, expected="at least one row")
    heads = _numbered(tuple(name.strip() for name in names), joints)
    places = [f"{where}, row {i}" for i in range(1, len(rows) + 1)]
    return Cells(heads, [[*map(_cell, row)] for row in rows], places, where)


def _cell(value: Any) -> str:
    """Text of a cell; empty for None and what is not a number."""
    is_missing = value is None or (isinstance(value, float) and np.isnan(value))
    if is_missing or type(value).__name__ in ("NAType", "NaTType"):
        return ""
    is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return repr(float(value)) if is_number else str(value).strip()


def _lines(path: Path, largest: int) -> Iterator[tuple[str, str]]:
    """Place and text of each line but empty ones and those that start with #.

    A first line ``sep=;``, with which spreadsheets declare their separator, is ignored.
    """
    where = one_line(str(path))
    for number, line in enumerate(read_text(path, largest).splitlines(), start=1):
        if number == 1 and _SEPARATOR.fullmatch(line.strip()):
            continue
        if line.strip() and not line.lstrip().startswith("#"):
            yield f"{where}, line {number}", line


def _cells(line: str, separator: str) -> list[str]:
    """Cells of a line; a separator in quotes does not separate."""
    parts = line.split(separator)
    if '"' in line and len(line) < csv.field_size_limit():
        parts = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [unsafe_cell(cell.strip().strip('"')) for cell in parts]


def _numbered(heads: tuple[str, ...], joints: tuple[str, ...]) -> tuple[str, ...]:
    """Heads with the joints' names in place of q1, q2, ..."""
    bare = [head.split("[")[0].strip() for head in heads]
    called = {f"q{i}": name for i, name in enumerate(joints, start=1)}
    if not called or not called.keys() <= set(bare) or set(joints) & set(bare):
        return heads
    pairs = zip(heads, bare, strict=True)
    return tuple(head.replace(name, called.get(name, name), 1) for head, name in pairs)


def _separator(line: str) -> str:
    """Separator of the cells of a table, by its first line."""
    return next((mark for mark in ";\t" if mark in line), ",")


def _with_points(cells: list[str], place: str) -> list[str]:
    """Replace decimal commas of numbers by points; refuse a line with both."""
    changed = [
        cell.replace(",", ".") if not _is_word(cell.replace(",", ".")) else cell
        for cell in cells
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
    words = [cell for cell in points if _is_word(cell)]
    if not words:
        return None
    if 2 * len(words) < len(points):
        raise InputError(
            "not a number",
            where=place,
            expected="numbers alone, or names alone",
            got=repr(words[0]),
        )
    _refuse_twice(cells, place)
    return cells


def read_rows(
    path: Path,
    what: str,
    largest: int = LARGEST,
    units: Units = SI,
    joints: tuple[str, ...] = (),
) -> Rows:
    """Read rows of numbers from a file; words in the first line are the names of
    the columns.

    Parameters
    ----------
    path, what, largest, joints
        As in `read_cells`.
    units : Units
        Units of the returned lengths and forces.

    Raises
    ------
    InputError
        With file and line.
    """
    cells = read_cells(path, what, largest, joints, nameless=True)
    heads = [named_unit(head, units, cells.place) for head in cells.names]
    names = tuple(name for name, _ in heads)
    _refuse_twice(names, cells.place)
    sizes = [1.0 if factor is None else factor for _, factor in heads] or 1.0
    return Rows(cells.numbers() * sizes, names or None, cells.place)


_ROUND = re.compile(
    r"\(\s*((?:[mcdu\u00b5\u03bc]?m|in|ft|k?N(?:[ "
    r"*]?[mcd]?m)?(?:/\w+)?|kg|g|m?s|m?rad|deg|\u00b0))"
    r"\s*\)\s*$"
)
# First line of some spreadsheets' tables.
_SEPARATOR = re.compile(r"sep=[;,\t]?", re.IGNORECASE)
_HEAD = re.compile(r"\s*([^\[\]]*?)\s*(?:\[([^\[\]]*)\])?\s*")
#: Factors to SI, by kind of quantity.
UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "number": {"": 1.0, "1": 1.0, "-": 1.0},
    "angle": ANGLES,
    "length": LENGTHS,
    "force": FORCES,
    "moment": {
        f"{f}{gap}{u}": a * b
        for gap in (" ", "", "*")
        for f, a in FORCES.items()
        for u, b in LENGTHS.items()
    },
    "torsional stiffness": TORSIONAL,
    "stiffness": LINEAR,
    "mass": {"kg": 1.0, "g": 1e-3, "lb": 0.45359237},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "text": {},
}


def in_brackets(head: str) -> str:
    """A head with its unit in square brackets in place of round ones: ``x (mm)``."""
    return _ROUND.sub(r"[\1]", head)


def head_of(
    cell: str, place: str, kind: str | None = None
) -> tuple[str, str | None, float]:
    """Return the name of a column, the kind of its unit (None without one),
    and the factor to SI.

    Parameters
    ----------
    cell : str
        "name" or "name [unit]".
    place : str
        File and line, for messages.
    kind : str, optional
        Key of `UNITS` to which the unit must belong; default any.

    Raises
    ------
    InputError
        For a head that cannot be read, or another unit.
    """
    match = _HEAD.fullmatch(in_brackets(cell))
    if match is None:
        raise InputError(
            "column head cannot be read",
            where=place,
            expected="name or name [unit]",
            got=repr(cell),
        )
    name = match[1]
    if match[2] is None:
        return name, None, 1.0
    unit = plain_unit(match[2])
    for of, sizes in UNITS.items():
        if unit in sizes and kind in (None, of):
            return name, of, sizes[unit]
    some = [*LENGTHS, *FORCES, "N m", "deg", "rad", "s"]
    raise InputError(
        f"column {name!r} has an unknown unit",
        where=place,
        got=repr(match[2]),
        expected=", ".join(some if kind is None else list(UNITS[kind])[:12]) or "no unit",
    )


def named_unit(cell: str, units: Units, place: str) -> tuple[str, float | None]:
    """Return the name of a column, and the factor of its numbers to radians,
    seconds and `units`.

    None for a column without a unit.
    """
    name, kind, size = head_of(cell, place)
    if kind is None:
        return name, None
    length, force = convert_length(SI, units)
    return name, size * {"length": length, "force": force, "moment": force * length}.get(
        kind, 1.0
    )


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
