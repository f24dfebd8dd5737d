"""What a page is started with: the mechanism, where it stands, and what else is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cartstiff.errors import InputError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.loading.yaml_file import read_text

__all__ = ["Cloud", "Source", "Trajectory", "read_cloud", "read_trajectory"]

# A page draws and sends every point: more are thinned.
_MOST_POINTS = 20_000
_MOST_POSTURES = 5_000


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Postures in order, with their times.

    Attributes
    ----------
    q : ndarray (N, n)
        Coordinates.
    time : ndarray (N,)
        Seconds, or the postures' numbers where no times are known.
    timed : bool
        Whether `time` is in seconds.
    """

    q: Array
    time: Array
    timed: bool = False


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a stiffness map with the quantities that may colour them.

    Attributes
    ----------
    positions : ndarray (N, 3)
        In F.
    values : mapping of str to ndarray (N,)
        By quantity; NaN where one does not exist.
    units : mapping of str to str
        By quantity.
    thinned : int
        Every how-manieth point of the file is here.
    """

    positions: Array
    values: Mapping[str, Array]
    units: Mapping[str, str]
    thinned: int = 1


@dataclass(frozen=True, eq=False)
class Source:
    """Everything that a page is started with; never changed by a tab.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    q : ndarray (n,) or None
        Posture shown at first; default the mechanism's.
    load : ndarray (6,) or None
        Wrench shown at first, in M.
    reload : callable or None
        Gives the mechanism with another frame of interest, by name.
    trajectory : Trajectory or None
        Postures for the time slider.
    cloud : Cloud or None
        Points of a map.
    """

    elastic: ElasticMechanism
    q: Array | None = None
    load: Array | None = None
    reload: Callable[[str], ElasticMechanism] | None = None
    trajectory: Trajectory | None = None
    cloud: Cloud | None = None


def read_trajectory(path: Path, names: tuple[str, ...]) -> Trajectory:
    """A trajectory from CSV: one posture a line, in joint order or under a line of names.

    A first column named ``t`` or ``time``, or one column more than there are coordinates, is the
    time in seconds. Lines that start with # are comments.

    Raises
    ------
    InputError
        With file and line.
    """
    where = one_line(str(path))
    text = read_text(path)
    header: list[str] | None = None
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in line.split(",")]
        place = f"{where}, line {number}"
        if header is None and not rows and any(_is_word(cell) for cell in cells):
            header = _checked_header(cells, names, place)
            continue
        rows.append(_numbers(cells, place, header, len(names), len(rows[0]) if rows else None))
    if not rows:
        raise InputError("no postures", where=where, expected="one a line, comma-separated")
    if len(rows) > _MOST_POSTURES:
        raise InputError("too many postures", where=where, expected=f"at most {_MOST_POSTURES}",
                         got=len(rows))  # fmt: skip
    table = np.array(rows)
    columns = header or [*(["time"] if table.shape[1] > len(names) else []), *names]
    q = table[:, [columns.index(name) for name in names]]
    timed = columns[0] == "time"
    time = table[:, 0] if timed else np.arange(float(len(table)))
    if np.any(np.diff(time) < 0):
        raise InputError("times must not decrease", where=where)
    return Trajectory(q, time, timed)


def _is_word(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return True
    return False


def _checked_header(cells: list[str], names: tuple[str, ...], place: str) -> list[str]:
    columns = ["time" if cell.lower() in ("t", "time") else cell for cell in cells]
    wanted = [*(["time"] if columns[0] == "time" else []), *names]
    if sorted(columns) != sorted(wanted):
        raise InputError("columns do not fit", where=place, expected=", ".join(names),
                         got=", ".join(cells))  # fmt: skip
    return columns


def _numbers(
    cells: list[str], place: str, header: list[str] | None, n: int, width: int | None
) -> list[float]:
    expected = len(header) if header else width
    if len(cells) != expected if expected is not None else len(cells) not in (n, n + 1):
        raise InputError(
            "wrong count", where=place, got=str(len(cells)),
            expected=f"{expected or n} numbers" + ("" if expected else " (or these and a time)"),
        )  # fmt: skip
    try:
        row = [float(cell) for cell in cells]
    except ValueError:
        raise InputError("not a number", where=place, got=", ".join(cells)) from None
    if not np.all(np.isfinite(row)) or max(map(abs, row)) > 1e30:
        raise InputError("must be finite numbers", where=place, got=", ".join(cells))
    return row


def read_cloud(path: Path) -> Cloud:
    """Points of a map file, thinned to what a page can show.

    Raises
    ------
    InputError
        If the file holds no positions or no quantity over them.
    """
    from cartstiff.batch.store import open_map

    data = open_map(path)
    where = one_line(str(path))
    if "position" not in data:
        raise InputError("map holds no positions", where=where, expected="a variable `position`")
    position = np.asarray(data["position"].values, float)
    shape = position.shape[:-1]
    flat = position.reshape(-1, position.shape[-1])
    values: dict[str, Array] = {}
    units: dict[str, str] = {}
    for name, variable in data.data_vars.items():
        if variable.shape == shape and variable.dtype.kind in "fiub" and name != "state":
            values[str(name)] = np.asarray(variable.values, float).reshape(-1)
            units[str(name)] = str(variable.attrs.get("units", ""))
    if position.shape[-1] != 3 or not values:
        raise InputError(
            "map cannot be shown", where=where,
            expected="positions (..., 3) and a quantity over the same postures",
        )  # fmt: skip
    reached = np.isfinite(flat).all(axis=1)  # places of a Cartesian grid that no posture reaches
    if not reached.any():
        raise InputError("map holds no posture", where=where, expected="a finite position")
    step = max(1, -(-int(reached.sum()) // _MOST_POINTS))
    shown = np.flatnonzero(reached)[::step]
    return Cloud(flat[shown], {n: v[shown] for n, v in values.items()}, units, step)
