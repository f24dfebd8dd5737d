r"""Frames of the measuring device: unknown in each session, and estimated with the springs.

A position of a session is ``T_s x`` of the one in F. A first T_s comes from the positions of the
rigid mechanism [Arun]_; what is left of it, a small translation t and turn w, stands in the
regressor as ``u . (t + w x (p - c))`` for the direction u of a number and its place p.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.identify.columns import POSITION, TURN
from cartstiff.identify.measurements import Measurements
from cartstiff.identify.observations import Observations

#: What is unknown of a session's frame.
OFFSETS = ("none", "translation", "rigid")


@dataclass(frozen=True, eq=False)
class Offsets:
    """Columns of the sessions' offsets.

    Attributes
    ----------
    columns : ndarray (m, S)
        In the regressor.
    names : tuple of str (S,)
        "session.tx" and so on.
    """

    columns: Array
    names: tuple[str, ...]


def nuisance_of(seen: Observations, measured: Measurements, kind: str) -> Offsets:
    """Columns of small offsets of all sessions; those that nothing feels are left out."""
    if not measured.session or kind == "none" or not seen.is_absolute.any():
        return Offsets(np.zeros((len(seen), 0)), ())
    sessions = np.array(measured.session)[seen.row]
    columns, names = [], []
    for name in dict.fromkeys(measured.session):
        mine = (sessions == name) & seen.is_absolute
        centre = seen.place[mine & ~seen.is_angle].mean(axis=0) if np.any(
            mine & ~seen.is_angle
        ) else np.zeros(3)  # fmt: skip
        shift = np.where((mine & ~seen.is_angle)[:, None], seen.axis, 0.0)
        about = np.cross(seen.place - centre, seen.axis)
        turn = np.where(mine[:, None], np.where(seen.is_angle[:, None], seen.axis, about), 0.0)
        both = [shift, turn] if kind == "rigid" else [shift]
        for part, letter in zip(both, "tr", strict=False):
            for i, axis in enumerate("xyz"):
                if part[:, i].any():
                    columns.append(part[:, i])
                    names.append(f"{name}.{letter}{axis}")
    if not columns:
        return Offsets(np.zeros((len(seen), 0)), ())
    return Offsets(np.stack(columns, axis=1), tuple(names))


def aligned(measured: Measurements, points: Array) -> Measurements:
    """Positions and orientations of each session moved into F, as well as a rigid arm says.

    Parameters
    ----------
    measured : Measurements
        With whole positions, or they are left as they are.
    points : ndarray (N, 3)
        The measured point of the rigid mechanism along base axes.

    Raises
    ------
    InputError
        For a session of fewer than three places.
    """
    if not measured.session or not all(name in measured.values for name in POSITION):
        return measured
    x = np.stack([measured.values[name] for name in POSITION], axis=1)
    has_turn = all(name in measured.values for name in TURN)
    turned = np.stack([measured.values[n] for n in TURN], axis=1) if has_turn else None
    sessions = np.array(measured.session)
    x = x.copy()
    for name in dict.fromkeys(measured.session):
        rows = np.flatnonzero((sessions == name) & ~np.isnan(x).any(axis=1))
        if not rows.size:
            continue
        T = _fit(x[rows], points[rows], name)
        x[rows] = x[rows] @ T[:3, :3].T + T[:3, 3]
        if turned is None:
            continue
        for n in rows[~np.isnan(turned[rows, 0])]:
            R = T[:3, :3] @ se3.from_roll_pitch_yaw(np.zeros(3), turned[n])[:3, :3]
            turned[n] = se3.roll_pitch_yaw(se3.pose(R))
    values = {**measured.values, **{name: x[:, i] for i, name in enumerate(POSITION)}}
    if turned is not None:
        values |= {name: turned[:, i] for i, name in enumerate(TURN)}
    return replace(measured, values=values)


def _fit(seen: Array, there: Array, session: str) -> Array:
    """Pose that moves points onto others with the least squares of distances."""
    a, b = seen.mean(axis=0), there.mean(axis=0)
    U, values, Vt = np.linalg.svd((seen - a).T @ (there - b))
    if not values[1] > numerics.RANK * max(values[0], numerics.TINY):
        raise InputError(
            f"the points of session {session!r} stand in one line: its frame is not known",
            where="column session", expected="three points that are not in line, or "
            "--offsets translation",
        )  # fmt: skip
    D = np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])
    R = Vt.T @ D @ U.T
    return se3.pose(R, b - R @ a)
