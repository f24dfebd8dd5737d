"""What a page is started with: the mechanism, where it stands, and what else is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np

from cartstiff.errors import InputError, one_line
from cartstiff.geometry.se3 import Array
from cartstiff.loading.csv_file import read_rows
from cartstiff.mechanisms.contract import SI, Units
from cartstiff.mechanisms.elastic import ElasticMechanism

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
    unused : tuple of str
        Columns of the file that say something else.
    """

    q: Array
    time: Array
    timed: bool = False
    unused: tuple[str, ...] = ()


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
        How far apart in the file the points are that are kept: 1 keeps all, 2 every second.
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
        Wrench shown at first.
    load_kind, load_at, load_axes
        What it does, where and along which axes, as in `cartstiff.page.state.State`.
    command : list of float or None
        What the drives are told at first, one number a spring.
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
    load_kind: Literal["dead", "follower", "conservative"] = "dead"
    load_at: tuple[float, float, float] | None = None
    load_axes: Literal["body", "inertial"] = "body"
    command: list[float] | None = None


def changed(
    elastic: ElasticMechanism,
    stiffness: Sequence[float | None] | None,
    payload: Sequence[float] | None,
    gravity: Sequence[float] | None,
) -> ElasticMechanism:
    """The mechanism with other springs, a payload and another gravity, as a state names them."""
    if stiffness is not None:
        elastic = elastic.with_springs([np.inf if k is None else k for k in stiffness])
    if payload is not None and payload[0]:
        elastic = elastic.with_payload(payload[0], payload[1:])
        if gravity is None and elastic.gravity is None:
            elastic = elastic.with_gravity()  # it weighs
    return elastic if gravity is None else elastic.with_gravity(gravity)


def read_trajectory(
    path: Path, names: tuple[str, ...], units: Units = SI,
    factors: Mapping[str, float] = MappingProxyType({}),
) -> Trajectory:  # fmt: skip
    """A trajectory from CSV: one posture a line, in joint order or under a line of names.

    A column named ``t`` or ``time``, or a first one more than there are coordinates, is the time in
    seconds. Lines that start with # are comments.

    Raises
    ------
    InputError
        With file and line.
    """
    rows = read_rows(path, "postures", units=units, factors=factors, joints=names)
    if rows.names is not None:
        named = tuple("time" if x.lower() in ("t", "time") else x for x in rows.names)
        rows = rows._replace(names=named)
    columns, table, unused = rows.arranged(names, ("time", *names))
    where = one_line(str(path))
    if len(table) > _MOST_POSTURES:
        raise InputError("too many postures", where=where, expected=f"at most {_MOST_POSTURES}",
                         got=len(table))  # fmt: skip
    timed = len(columns) > len(names)
    time = table[:, 0] if timed else np.arange(float(len(table)))
    if np.any(np.diff(time) < 0):
        raise InputError("times must not decrease", where=where)
    return Trajectory(table[:, -len(names) :], time, timed, unused)


def read_cloud(path: Path) -> Cloud:
    """Points of a map file, thinned to what a page can show.

    Raises
    ------
    InputError
        If the file holds no positions or no quantity over them.
    """
    from cartstiff.maps.opening import open_map

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
