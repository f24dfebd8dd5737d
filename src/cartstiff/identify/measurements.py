"""Measurements in the mechanism's own units, one row each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cartstiff.arrays import Array

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
