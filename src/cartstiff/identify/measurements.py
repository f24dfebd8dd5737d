"""Measurements in the mechanism's own units, one row each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cartstiff.arrays import Array, csv_line
from cartstiff.identify.columns import LOAD, MEASURED, UNITS
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import SI, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism


@dataclass(frozen=True, eq=False)
class Measurements:
    """Postures, loads and what was measured.

    Attributes
    ----------
    q : ndarray (N, n)
        What the joints are told: positions before the springs give.
    wrench : ndarray (N, 6)
        (moment, force) on the body at `load_at`; along `axes`.
    mass, mass0 : ndarray (N,)
        Hung at `load_at`, in kg; `mass0` in the state that differences are counted from.
    axes : {"body", "base", "world"}
        Axes of the wrench.
    values, deviations : mapping of str to ndarray (N,)
        What was measured and its standard deviation, by column; NaN where not.
    direction : ndarray (N, 3)
        Direction of the dial gauge, unit vectors in base axes; NaN where there is none.
    session : tuple of str
        Session of each row; empty without sessions.
    time : ndarray (N,)
        In seconds; NaN where not given.
    point, load_at : tuple of 3 floats
        Point of the body, in M, that was measured; and at which the loads act.
    rows : ndarray of int (N,)
        Numbers of the rows in their table, from 1.
    unused : tuple of str
        Columns of the table that other commands wrote and that play no part.
    """

    q: Array
    wrench: Array
    mass: Array
    mass0: Array
    axes: str
    values: Mapping[str, Array]
    deviations: Mapping[str, Array]
    direction: Array
    session: tuple[str, ...]
    time: Array
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    load_at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rows: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    unused: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.rows.size:
            object.__setattr__(self, "rows", np.arange(1, len(self.q) + 1))

    def __len__(self) -> int:
        return len(self.q)

    def taken(self, places: Sequence[int]) -> Measurements:
        """Rows at some places, in that order, numbered anew; a place may stand twice."""
        at = list(places)
        return replace(self.chosen(np.array(at, np.intp)), rows=np.arange(1, len(at) + 1))

    def chosen(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Measurements:
        """Some of the rows."""
        return replace(
            self,
            q=self.q[keep],
            wrench=self.wrench[keep],
            mass=self.mass[keep],
            mass0=self.mass0[keep],
            values={n: v[keep] for n, v in self.values.items()},
            deviations={n: v[keep] for n, v in self.deviations.items()},
            direction=self.direction[keep],
            time=self.time[keep],
            rows=self.rows[keep],
            session=tuple(np.array(self.session)[keep].tolist()) if self.session else (),
        )

    @cached_property
    def postures(self) -> NDArray[np.intp]:
        """Number of each row's posture (N,), from 0 in order of appearance."""
        return _groups(self.q)

    @cached_property
    def settings(self) -> NDArray[np.intp]:
        """Number of each row's posture and load, by which repeats are known."""
        sessions = {name: float(i) for i, name in enumerate(dict.fromkeys(self.session))}
        of_session = np.array([sessions[name] for name in self.session] or [0.0] * len(self.q))
        columns = [
            self.q,
            self.wrench,
            self.mass[:, None],
            self.mass0[:, None],
            np.nan_to_num(self.direction),
            of_session[:, None],
        ]
        return _groups(np.hstack(columns))


def _groups(table: Array) -> NDArray[np.intp]:
    """Equal rows have equal numbers, from 0 in order of appearance."""
    known: dict[bytes, int] = {}
    rows = np.ascontiguousarray(table) + 0.0  # -0.0 becomes 0.0
    return np.array([known.setdefault(row.tobytes(), len(known)) for row in rows], np.intp)


def table_text(
    measured: Measurements, elastic: ElasticMechanism, columns: Sequence[str] = ()
) -> str:
    """Rows under a line of names: postures, loads, and what was measured.

    Parameters
    ----------
    measured : Measurements
        The rows.
    elastic : ElasticMechanism
        Whose joints name the columns.
    columns : sequence of str
        Columns that stand empty, to be filled in.
    """
    own = elastic.units
    in_length = own.length if own.length in UNITS["length"] else SI.length
    in_angle, turn = own.shown_angle, np.pi / 180.0 if own.shown_angle == "deg" else 1.0
    length, force = convert_length(Units(in_length), own)
    mechanism = elastic.mechanism
    table: dict[str, Array] = {}
    hidden = mechanism.virtual if isinstance(mechanism, Chain) else frozenset()
    for j, c in enumerate(mechanism.coordinates):
        if j not in hidden:
            unit, size = (in_length, length) if c.is_length else (in_angle, turn)
            name = f"q_{c.name}" if c.name in MEASURED else c.name
            table[f"{name} [{unit}]"] = measured.q[:, j] / size
    moment = "N mm" if in_length == "mm" else "N m"
    lever = length if moment == "N mm" else convert_length(SI, own)[0]
    loads = measured.wrench / np.repeat([force * lever, force], 3)
    units = (moment, "N")
    for i, name in enumerate(LOAD):
        if loads[:, i].any():
            table[f"{name} [{units[i // 3]}]"] = loads[:, i]
    if measured.mass.any():
        table["mass [kg]"] = measured.mass
    if measured.mass0.any():
        table["mass0 [kg]"] = measured.mass0
    empty = np.full(len(measured), np.nan)
    for name in MEASURED:
        values = empty if name in columns else measured.values.get(name)
        if values is None:
            continue
        is_length = MEASURED[name] == "length"
        unit, factor = (in_length, length) if is_length else (in_angle, turn)
        table[f"{name} [{unit}]"] = values / factor
        if name == "d":
            table |= dict(zip(("nx", "ny", "nz"), measured.direction.T, strict=True))
        spread = measured.deviations.get(name)
        if spread is not None and not np.isnan(spread).all() and name not in columns:
            table[f"sd_{name} [{unit}]"] = spread / factor
    lines = [
        ",".join("" if np.isnan(x) else f"{x:.10g}" for x in row)
        for row in zip(*table.values(), strict=True)
    ]
    return csv_line(table) + "\n".join(lines) + "\n"
