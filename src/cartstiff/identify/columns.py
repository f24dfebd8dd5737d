"""Names and units of the columns of a table of measurements."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import pi
from typing import Final

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.loading.csv_file import SIGNS, Cells, in_brackets
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism

#: Factors to SI, by kind of quantity.
UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "angle": {
        "rad": 1.0,
        "mrad": 1e-3,
        "urad": 1e-6,
        "deg": pi / 180.0,
        "arcmin": pi / 10800.0,
        "arcsec": pi / 648000.0,
    },
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "kgf": 9.80665, "lbf": 4.4482216152605},
    "moment": {"N m": 1.0, "Nm": 1.0, "kN m": 1e3, "kNm": 1e3, "N mm": 1e-3, "Nmm": 1e-3},
    "mass": {"kg": 1.0, "g": 1e-3, "lb": 0.45359237},
    "time": {"s": 1.0, "min": 60.0, "h": 3600.0},
    "number": {"1": 1.0},
    "text": {},
}

LOAD: Final = ("mx", "my", "mz", "fx", "fy", "fz")
DISPLACEMENT: Final = ("dx", "dy", "dz")
ROTATION: Final = ("drx", "dry", "drz")
POSITION: Final = ("x", "y", "z")
TURN: Final = ("roll", "pitch", "yaw")
#: What can be measured, with its kind.
MEASURED: Final[Mapping[str, str]] = {
    **dict.fromkeys((*DISPLACEMENT, "d", *POSITION), "length"),
    **dict.fromkeys((*ROTATION, *TURN), "angle"),
}
_OTHERS: Final[Mapping[str, str]] = {
    **dict.fromkeys(LOAD[:3], "moment"),
    **dict.fromkeys(LOAD[3:], "force"),
    "mass": "mass",
    "mass0": "mass",
    **dict.fromkeys(("nx", "ny", "nz"), "number"),
    "session": "text",
    "time": "time",
    "comment": "text",
}
#: A column that only tables of `cartstiff path` have; their wrenches are along the body's axes.
OF_PATH: Final = "singular_ratio"
_HEAD = re.compile(r"\s*([^\[\]]*?)\s*(?:\[([^\[\]]*)\])?\s*")


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    name : str
        Without its unit.
    kind : str
        A key of `UNITS`.
    factor : float
        To SI.
    declared : bool
        Whether the header or an option names the unit.
    """

    name: str
    kind: str
    factor: float
    declared: bool


def posture_columns(elastic: ElasticMechanism) -> dict[str, str]:
    """Columns that say where the mechanism stands, and their kinds.

    Joints by name, or with "q" and an underscore before it; of a closed chain its actuated joints
    must be given, and others may. A platform's pose is "q_x" to "q_yaw".
    """
    mechanism = elastic.mechanism
    columns = {}
    virtual = mechanism.virtual if isinstance(mechanism, Chain) else frozenset()
    for j, coordinate in enumerate(mechanism.coordinates):
        if j not in virtual:
            kind = "length" if coordinate.is_length else "angle"
            columns[f"q_{coordinate.name}"] = kind
            if coordinate.name not in MEASURED:
                columns[coordinate.name] = kind
    return columns


def kinds_of(elastic: ElasticMechanism) -> dict[str, str]:
    """Every column that a table for this mechanism may have, and its kind."""
    own = {**posture_columns(elastic), **_OTHERS, **MEASURED}
    return own | {f"sd_{name}": kind for name, kind in MEASURED.items()}


def without_paths(cells: Cells, kinds: Mapping[str, str]) -> tuple[Cells, tuple[str, ...]]:
    """A table of `cartstiff path` or `equilibrium --path` without what only they know, and that.

    Other tables stay as they are: an unknown column of theirs is a slip, and so is a name that is
    nearly one of `kinds`.
    """
    names = [head.split("[")[0].strip() for head in cells.names]
    of_path, of_commands = OF_PATH in names, any(name.startswith("command_") for name in names)
    unused = [
        i
        for i, name in enumerate(names)
        if name not in kinds
        and (
            (of_commands and name.startswith(("command_", "before_", "after_")))
            or (of_path and not get_close_matches(name, kinds))
        )
    ]
    if not unused:
        return cells, ()
    kept = [i for i in range(len(names)) if i not in unused]
    rows = [[row[i] for i in kept] for row in cells.rows]
    left = cells._replace(names=tuple(cells.names[i] for i in kept), rows=rows)
    return left, tuple(names[i] for i in unused)


def column_of(
    head: str, kinds: Mapping[str, str], default: Mapping[str, str], where: str
) -> Column:
    """Name and unit of one column from its head, "name" or "name [unit]".

    Parameters
    ----------
    head : str
        The cell of the first line.
    kinds : mapping of str to str
        From `kinds_of`.
    default : mapping of str to str
        Units by kind, for heads without one.
    where : str
        For messages.

    Raises
    ------
    UnknownNameError
        For a name that is no column.
    InputError
        For a unit that does not fit it.
    """
    match = _HEAD.fullmatch(in_brackets(head))
    if match is None or not match[1]:
        raise InputError(
            "column head cannot be read",
            where=where,
            expected="name or name [unit]",
            got=repr(head),
        )
    name, unit = match[1], match[2]
    unit = None if unit is None else unit.translate(SIGNS).strip()
    if name not in kinds:
        raise UnknownNameError("column", name, _shown(kinds), where=where)
    kind = kinds[name]
    units = UNITS[kind]
    if unit is not None and unit not in units:
        raise InputError(
            f"column {name!r} has an unknown unit",
            where=where,
            got=repr(unit),
            expected=", ".join(units) or "no unit",
        )
    if unit is not None:
        return Column(name, kind, units[unit], True)
    if kind in default:
        return Column(name, kind, units[default[kind]], True)
    return Column(name, kind, 1.0, False)


def _shown(kinds: Iterable[str]) -> list[str]:
    """Names as users know them: those with q_ and sd_ last."""
    return sorted(kinds, key=lambda name: name.startswith(("q_", "sd_")))
