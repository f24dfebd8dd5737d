"""Measurements in the mechanism's own units, one row each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cartstiff.arrays import Array
from cartstiff.geometry import se3
from cartstiff.mechanisms.elastic import ElasticMechanism

LOAD: Final = ("mx", "my", "mz", "fx", "fy", "fz")
DISPLACEMENT: Final = ("dx", "dy", "dz")
ROTATION: Final = ("drx", "dry", "drz")
POSITION: Final = ("x", "y", "z")
TURN: Final = ("roll", "pitch", "yaw")
_TRIPLES: Final = (DISPLACEMENT, ROTATION, POSITION, TURN)
#: Measurable quantities, each with its kind.
MEASURED: Final[Mapping[str, str]] = {
    **dict.fromkeys((*DISPLACEMENT, "d", *POSITION), "length"),
    **dict.fromkeys((*ROTATION, *TURN), "angle"),
}


# Replaced by the usual values of each row.
_USUAL: Any = None


@dataclass(frozen=True, eq=False)
class Measurements:
    """Postures, loads and measured numbers.

    Attributes
    ----------
    q : ndarray (N, n)
        Commanded joint positions, before the springs deflect.
    wrench : ndarray (N, 6)
        (moment, force) on the body at `load_at`; along `axes`.
    mass, mass0 : ndarray (N,)
        Hung at `load_at`, in kg; `mass0` in the reference state of differences.
    axes : {"body", "base", "world"}
        Axes of the wrench.
    values, deviations : mapping of str to ndarray (N,)
        Measured numbers and their standard deviations, by column; NaN where missing.
    direction : ndarray (N, 3)
        Direction of the dial gauge, unit vectors in base axes; NaN without one.
    session : tuple of str
        Session of each row; empty without sessions.
    time : ndarray (N,)
        In seconds; NaN if not given.
    point, load_at : tuple of 3 floats
        Measured point of the body, in M, and the point at which the loads act.
    rows : ndarray of int (N,)
        Numbers of the rows in their table, from 1.
    unused : tuple of str
        Columns of the table that other commands wrote and that are not used.
    """

    q: Array
    wrench: Array
    mass: Array = _USUAL
    mass0: Array = _USUAL
    axes: str = "world"
    values: Mapping[str, Array] = field(default_factory=dict)
    deviations: Mapping[str, Array] = field(default_factory=dict)
    direction: Array = _USUAL
    session: tuple[str, ...] = ()
    time: Array = _USUAL
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    load_at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rows: NDArray[np.intp] = _USUAL
    unused: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        N = len(self.q)
        for name, usual in {
            "mass": np.zeros(N),
            "mass0": np.zeros(N),
            "direction": np.full((N, 3), np.nan),
            "time": np.full(N, np.nan),
            "rows": np.arange(1, N + 1),
        }.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, usual)

    def __len__(self) -> int:
        return len(self.q)

    def taken(self, places: Sequence[int]) -> Measurements:
        """Rows at some places, in that order, numbered anew; a place may occur twice."""
        at = list(places)
        return replace(self.chosen(np.array(at, np.intp)), rows=np.arange(1, len(at) + 1))

    def chosen(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Measurements:
        """Some of the rows."""
        arrays = ("q", "wrench", "mass", "mass0", "direction", "time", "rows")
        chosen: dict[str, Any] = {name: getattr(self, name)[keep] for name in arrays}
        for name in ("values", "deviations"):
            chosen[name] = {n: column[keep] for n, column in getattr(self, name).items()}
        session = tuple(np.array(self.session)[keep].tolist()) if self.session else ()
        return replace(self, **chosen, session=session)

    @cached_property
    def postures(self) -> NDArray[np.intp]:
        """Number of each row's posture (N,), from 0 in order of appearance."""
        return _groups(self.q)

    @cached_property
    def settings(self) -> NDArray[np.intp]:
        """Number of each row's posture and load; repeats have equal numbers."""
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


#: Gravity [m/s^2] on hung masses if the mechanism names none.
EARTH: Final = (0.0, 0.0, -9.81)


@dataclass(frozen=True, eq=False)
class Observations:
    """All measured numbers.

    Attributes
    ----------
    row : ndarray of int (m,)
        Place of each number's row.
    column : tuple of str (m,)
        Measured quantity.
    is_angle, is_absolute : ndarray of bool (m,)
        Rotations; positions and orientations themselves, which include the arm's own sag.
    functional : ndarray (m, 6)
        On the twist of M, in its axes.
    target : ndarray (m,)
        The measured displacement; of a position, less that of the rigid mechanism.
    deviation : ndarray (m,)
        Standard deviation; NaN if it is to be estimated.
    axis, place : ndarray (m, 3)
        Unit vector in F, and the measured point in F: for the offsets of sessions.
    """

    row: NDArray[np.intp]
    column: tuple[str, ...]
    is_angle: NDArray[np.bool_]
    is_absolute: NDArray[np.bool_]
    functional: Array
    target: Array
    deviation: Array
    axis: Array
    place: Array

    def __len__(self) -> int:
        return len(self.target)


def field_of(elastic: ElasticMechanism) -> Array:
    """Acceleration (3,) of hung masses, in F, m/s^2."""
    return np.array(EARTH if elastic.gravity is None else elastic.gravity, float)


def wrenches(
    measured: Measurements, elastic: ElasticMechanism, poses: Array
) -> tuple[Array, Array, Array]:
    """Loads on M in its axes (N, 6), those of the reference state, and the forces' part in F.

    Returns
    -------
    loaded, reference : ndarray (N, 6)
        (moment, force) about the origin of M: all loads; and that of `mass0` alone.
    inertial : ndarray (N, 6)
        The load at `load_at` along the axes of F.
    """
    R = poses[:, :3, :3]
    loads = measured.wrench.reshape(-1, 2, 3)
    if measured.axes == "body":
        loads = np.einsum("nij,nkj->nki", R, loads)
    elif measured.axes == "base":
        loads = loads @ elastic.mechanism.base_pose[:3, :3].T
    weight = np.multiply.outer(measured.mass, field_of(elastic)) / elastic.units.newtons
    weight0 = np.multiply.outer(measured.mass0, field_of(elastic)) / elastic.units.newtons
    nothing = np.zeros_like(weight)
    total = loads + np.stack([nothing, weight], axis=1)
    reference = np.stack([nothing, weight0], axis=1)
    at = np.asarray(measured.load_at)

    def in_body(inertial: Array) -> Array:
        W = np.einsum("nji,nkj->nki", R, inertial).reshape(-1, 6)
        W[:, :3] += np.cross(at, W[:, 3:])
        return W

    return in_body(total), in_body(reference), total.reshape(-1, 6)


def observe(measured: Measurements, elastic: ElasticMechanism, poses: Array) -> Observations:
    """Flatten measurements, row by row.

    Parameters
    ----------
    measured : Measurements
        The rows.
    elastic : ElasticMechanism
        The measured mechanism.
    poses : ndarray (N, 4, 4)
        ``T_F_M`` of the rigid mechanism in each row.
    """
    R, p = poses[:, :3, :3], np.asarray(measured.point)
    T_F_B = elastic.mechanism.base_pose
    points = poses[:, :3, 3] + R @ p
    names = list(measured.values)
    kinds = [next((g for g in _TRIPLES if name in g), None) for name in names]
    rigid = _rigid(points, R, T_F_B, measured)

    def table(columns: Iterable[Array], *shape: int) -> Array:
        return np.array([*columns], float).reshape(len(names), len(R), *shape).swapaxes(0, 1)

    values = table(measured.values.values())
    used = ~np.isnan(values)
    row, place = np.nonzero(used)
    axis = table(
        (
            measured.direction @ T_F_B[:3, :3].T
            if group is None
            else np.tile(T_F_B[:3, group.index(name)], (len(R), 1))
            for name, group in zip(names, kinds, strict=True)
        ),
        3,
    )[used]
    along = np.einsum("nji,nj->ni", R[row], axis)
    is_angle = np.array([group in (ROTATION, TURN) for group in kinds], bool)[place]
    turning = np.where(is_angle[:, None], along, np.cross(p, along))
    return Observations(
        row,
        tuple(names[i] for i in place),
        is_angle,
        np.array([group in (POSITION, TURN) for group in kinds], bool)[place],
        np.hstack([turning, np.where(is_angle[:, None], 0.0, along)]),
        table(rigid.get(name, x) for name, x in measured.values.items())[used],
        table(measured.deviations[name] for name in names)[used],
        axis,
        points[row],
    )


def _rigid(points: Array, R: Array, T_F_B: Array, measured: Measurements) -> dict[str, Array]:
    """Positions and orientations less those of the rigid mechanism, in the robot's base frame."""
    columns: dict[str, Array] = {}
    base = T_F_B[:3, :3]
    at = (points - T_F_B[:3, 3]) @ base
    for i, name in enumerate(POSITION):
        if name in measured.values:
            columns[name] = measured.values[name] - at[:, i]
    if TURN[0] in measured.values:
        turned = np.stack([measured.values[name] for name in TURN], axis=1)
        known = np.flatnonzero(~np.isnan(turned[:, 0]))
        error = np.full((len(turned), 3), np.nan)
        for n in known:
            rotation = se3.from_roll_pitch_yaw(np.zeros(3), turned[n])[:3, :3]
            T = np.eye(4)
            T[:3, :3] = rotation @ (base.T @ R[n]).T
            error[n] = se3.log(T)[:3]
        for i, name in enumerate(TURN):
            columns[name] = error[:, i]
    return columns
