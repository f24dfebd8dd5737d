"""Offsets of measured positions, estimated together with the springs.

Each session of a measuring device has a frame of its own. If they are sought, joint zeros,
the measured point on the tool and the place of the base are further offsets of all rows: to first
order a position changes by ``J_j`` per zero, by ``R e_i`` per offset of the tool, and by a small
motion of the base. The rows are corrected by the offsets found until these are negligible.
Differences of positions do not depend on them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.identify.fitting import Solved
from cartstiff.identify.measurements import POSITION, TURN, Measurements, Observations
from cartstiff.identify.unknowns import ZERO, Unknowns
from cartstiff.mechanisms.elastic import ElasticMechanism

_PARTS = ("x", "y", "z", "rx", "ry", "rz")
# Standard deviation above which an offset is not determined: rad, and shares of the mechanism.
_MAX_DEVIATION = 0.1
# Share of its standard deviation below which an offset is not corrected any more.
_NEGLIGIBLE = 0.1


@dataclass(frozen=True, eq=False)
class Offsets:
    """Columns of the offsets.

    Attributes
    ----------
    columns : ndarray (m, S)
        In the regressor.
    names : tuple of str (S,)
        "session.tx" and so on; after them "JOINT.zero", "tool.x", "base.rz".
    geometry : ndarray of int
        Places of those that are sought.
    """

    columns: Array
    names: tuple[str, ...]
    geometry: NDArray[np.intp]


@dataclass(frozen=True)
class OffsetEstimate:
    """Error of a joint's zero, or offset of tool or base, with its interval; None if not known."""

    name: str
    unit: str
    value: float | None
    sd: float | None
    interval: tuple[float, float] | None

    @property
    def identifiable(self) -> bool:
        """Whether the rows determine it."""
        return self.value is not None


def offsets_of(
    unknowns: Unknowns, seen: Observations, measured: Measurements, kind: str
) -> Offsets:
    """Columns of all offsets; those without an effect are left out.

    Raises
    ------
    InputError
        If geometry is sought and no position or orientation is measured.
    """
    columns: dict[str, Array] = {}
    sessions = np.array(measured.session)[seen.row] if measured.session else np.zeros(0)
    for name in dict.fromkeys(measured.session) if kind != "none" else ():
        mine = (sessions == name) & seen.is_absolute
        points = seen.place[mine & ~seen.is_angle]
        placed = _placement(seen, mine, points.mean(axis=0) if len(points) else np.zeros(3))
        for part, column in zip(("tx", "ty", "tz", "rx", "ry", "rz"), placed, strict=True):
            if column.any() and (kind == "rigid" or part[0] == "t"):
                columns[f"{name}.{part}"] = column
    count = len(columns)
    if unknowns.geometry:
        columns |= _of_geometry(unknowns, seen, measured)
    table = np.stack(list(columns.values()), axis=1) if columns else np.zeros((len(seen), 0))
    return Offsets(table, tuple(columns), np.arange(count, len(columns)))


def _placement(
    seen: Observations, mine: NDArray[np.bool_], centre: Array, axes: Array | None = None
) -> Array:
    """Columns (6, m) of translations along three axes and small rotations about a point of F."""
    R = np.eye(3) if axes is None else axes
    shift = np.where((mine & ~seen.is_angle)[:, None], seen.axis, 0.0)
    about = np.where(seen.is_angle[:, None], seen.axis, np.cross(seen.place - centre, seen.axis))
    return np.vstack([(shift @ R).T, (np.where(mine[:, None], about, 0.0) @ R).T])


def _of_geometry(
    unknowns: Unknowns, seen: Observations, measured: Measurements
) -> dict[str, Array]:
    """Columns of zeros, tool and base."""
    absolute, elastic = seen.is_absolute, unknowns.elements.elastic
    if not absolute.any():
        raise InputError(
            f"differences do not show {', '.join(unknowns.geometry)}",
            where="--unknown",
            expected="measured positions x, y, z (or roll, pitch, yaw)",
        )
    _, first, groups = np.unique(measured.postures, return_index=True, return_inverse=True)
    postures = [elastic.mechanism.at(q) for q in measured.q[first]]
    at = groups[seen.row]
    columns = {}
    for word in unknowns.geometry:
        if word.endswith(ZERO):
            j = elastic.names.index(word.removesuffix(ZERO))
            twists = np.array([p.motion.jacobian[:, j] for p in postures])[at]
            columns[word] = np.where(absolute, np.einsum("mi,mi->m", seen.functional, twists), 0.0)
            continue
        if word == "tool":
            axes = np.array([p.pose[:3, :3] for p in postures])[at]
            along = np.einsum("mij,mi->jm", axes, np.where(absolute[:, None], seen.axis, 0.0))
            parts = np.vstack([along * ~seen.is_angle, along * seen.is_angle])
        else:
            B = elastic.mechanism.base_pose
            parts = _placement(seen, absolute, B[:3, 3], B[:3, :3])
        columns |= {f"{word}.{n}": x for n, x in zip(_PARTS, parts, strict=True) if x.any()}
    return columns


def unit_of(elastic: ElasticMechanism, name: str) -> str:
    """Unit of a joint's zero, or of an offset of tool or base."""
    if name.endswith(ZERO):
        j = elastic.names.index(name.removesuffix(ZERO))
        return elastic.units.coordinate(elastic.mechanism.coordinates[j].is_length)
    return elastic.units.length if name[-2] == "." else elastic.units.angle


def estimated(
    elastic: ElasticMechanism, offsets: Offsets, solution: Solved, found: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of each that is sought, beyond what is `found`.

    The deviation is NaN if the rows do not determine the offset.
    """
    names = [offsets.names[i] for i in offsets.geometry]
    C = solution.offset_covariance[np.ix_(offsets.geometry, offsets.geometry)]
    place = placement_of(found)
    turn = se3.log(se3.pose(place[:3, :3]))
    by_step = np.zeros((6, 6))  # of the base's six numbers, whose step is along its turned axes
    by_step[:3, :3], by_step[3:, 3:] = place[:3, :3], se3.right_jacobian_inverse(turn)[:3, :3]
    at = [i for i, name in enumerate(names) if name.startswith("base.")]
    parts = [_PARTS.index(names[i][5:]) for i in at]
    G = np.eye(len(names))
    G[np.ix_(at, at)] = by_step[np.ix_(parts, parts)]
    # An undetermined number, whose covariance is NaN, spoils only those that it enters.
    G[np.abs(G) < _MAX_DEVIATION] = 0.0
    spreads = [np.sqrt(g[g != 0] @ C[np.ix_(g != 0, g != 0)] @ g[g != 0]) for g in G]
    values = _together(found, dict(zip(names, solution.offsets[offsets.geometry], strict=True)))
    limits = {n: _MAX_DEVIATION * size_of(elastic, n) for n in names}
    return {
        n: (float(values[n]), float(s) if s <= limits[n] else np.nan)
        for n, s in zip(names, spreads, strict=True)
    }


def size_of(elastic: ElasticMechanism, name: str) -> float:
    """Natural size of an offset: 1 rad, or the mechanism's length."""
    is_angle = unit_of(elastic, name) == elastic.units.angle
    return 1.0 if is_angle else float(elastic.mechanism.at(elastic.q).length)


def corrections(
    elastic: ElasticMechanism, step: Mapping[str, tuple[float, float]]
) -> dict[str, float]:
    """Part of a step to be corrected; empty if all of it is negligible."""
    if not any(abs(x) > _NEGLIGIBLE * s for x, s in step.values()):
        return {}
    return {name: x for name, (x, _) in step.items() if abs(x) <= size_of(elastic, name)}


def placement_of(found: Mapping[str, float], word: str = "base") -> Array:
    """Pose of the base, or of the tool, from its offsets."""
    x = [found.get(f"{word}.{part}", 0.0) for part in _PARTS]
    return se3.pose(se3.exp([*x[3:], 0.0, 0.0, 0.0])[:3, :3], x[:3])


def _together(found: Mapping[str, float], step: Mapping[str, float]) -> dict[str, float]:
    """Offsets after a further step."""
    total = {name: found.get(name, 0.0) + x for name, x in step.items()}
    base, tool = (
        placement_of(found) @ placement_of(step),
        placement_of(step, "tool") @ placement_of(found, "tool"),
    )
    tool[:3, 3] = [total.get(f"tool.{part}", 0.0) for part in _PARTS[:3]]  # along the body's axes
    whole = parts_of("base", base) | parts_of("tool", tool)
    return {name: whole.get(name, x) for name, x in total.items()}


def parts_of(word: str, T: Array) -> dict[str, float]:
    """Offsets of the base, or of the tool, from its pose."""
    parts = [*T[:3, 3].tolist(), *se3.log(se3.pose(T[:3, :3]))[:3].tolist()]
    return {f"{word}.{part}": x for part, x in zip(_PARTS, parts, strict=True)}


def corrected(
    elastic: ElasticMechanism,
    measured: Measurements,
    found: Mapping[str, float],
    step: Mapping[str, float],
) -> tuple[Measurements, dict[str, float]]:
    """Rows without a step of the offsets, and all offsets found; loads keep their points."""
    table = np.stack([measured.values.get(n, np.full(len(measured), np.nan)) for n in POSITION])
    if (np.isnan(table).any(axis=0) & ~np.isnan(table).all(axis=0)).any():
        step = {n: x for n, x in step.items() if not n.startswith("base.")}  # no whole positions
    zeros = [step.get(f"{name}{ZERO}", 0.0) for name in elastic.names]
    tool = placement_of(step, "tool")
    rows = np.arange(len(measured))
    values = _moved(measured.values, rows, se3.inverse(placement_of(step)), tool[:3, :3].T)
    point = tuple((np.asarray(measured.point) + tool[:3, 3]).tolist())
    return replace(measured, q=measured.q + zeros, values=values, point=point), _together(
        found, step
    )


def _moved(
    values: Mapping[str, Array], rows: NDArray[np.intp], T: Array, turn: Array
) -> dict[str, Array]:
    """Positions and orientations of some rows in another frame; bodies turned in theirs."""
    values = dict(values)
    if all(name in values for name in POSITION):
        x = np.stack([values[name] for name in POSITION], axis=1)
        x[rows] = x[rows] @ T[:3, :3].T + T[:3, 3]
        values |= dict(zip(POSITION, x.T, strict=True))
    if all(name in values for name in TURN):
        angles = np.stack([values[name] for name in TURN], axis=1)
        R = T[:3, :3] @ se3.rotation_by_angles(angles[rows]) @ turn
        angles[rows] = se3.roll_pitch_yaw(se3.pose(R))
        values |= dict(zip(TURN, angles.T, strict=True))
    return values


def in_base(
    unknowns: Unknowns, measured: Measurements, poses: Array, kind: str
) -> tuple[Measurements, dict[str, float]]:
    """Positions and orientations near the base frame, and the offsets of a base that is sought.

    Each session's frame, or that of all rows if the base is sought, is placed so that the points
    lie next to those of the rigid mechanism.

    Parameters
    ----------
    unknowns : Unknowns
        Parameters.
    measured : Measurements
        Without all of x, y, z they are returned unchanged.
    poses : ndarray (N, 4, 4)
        ``T_F_M`` of the rigid mechanism.
    kind : str
        Offsets of sessions, as in `identify`.

    Raises
    ------
    InputError
        For a session of fewer than three places.
    """
    elastic, sessions = unknowns.elements.elastic, np.array(measured.session)
    by_session = measured.session and kind == "rigid"
    if not all(n in measured.values for n in POSITION) or not (
        by_session or "base" in unknowns.geometry
    ):
        return measured, {}
    T_F_B = elastic.mechanism.base_pose
    points = poses[:, :3, 3] + poses[:, :3, :3] @ np.asarray(measured.point)
    points = (points - T_F_B[:3, 3]) @ T_F_B[:3, :3]
    x = np.stack([measured.values[name] for name in POSITION], axis=1)
    known = ~np.isnan(x).any(axis=1)
    if not by_session:
        place = _fit(points[known], x[known])
        step = {} if place is None else parts_of("base", place)
        return corrected(elastic, measured, {}, step)
    values: Mapping[str, Array] = measured.values
    for name in dict.fromkeys(measured.session):
        rows = np.flatnonzero((sessions == name) & known)
        if not rows.size:
            continue
        if (T := _fit(x[rows], points[rows])) is None:
            raise InputError(
                f"the points of session {name!r} stand in one line: its frame is not known",
                where="column session",
                expected="three points that are not in line, or --offsets translation",
            )
        values = _moved(values, rows, T, np.eye(3))
    return replace(measured, values=values), {}


def _fit(seen: Array, there: Array) -> Array | None:
    """Pose that moves points onto others with the least squares of distances; None in one line."""
    if not len(seen):
        return None
    a, b = seen.mean(axis=0), there.mean(axis=0)
    values = np.linalg.svd((seen - a).T @ (there - b), compute_uv=False)
    if not values[1] > numerics.RANK * max(values[0], numerics.TINY):
        return None
    from scipy.spatial.transform import Rotation

    R = Rotation.align_vectors(there - b, seen - a)[0].as_matrix()
    return se3.pose(R, b - R @ a)
