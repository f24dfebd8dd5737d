"""Measurements in the mechanism's own units, one row each; their tables (CSV)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, csv_rows
from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import (
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
    one_line,
)
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.units import SI, Units, convert_length
from cartstiff.files.tables import (
    UNITS,
    Cells,
    cells_of,
    head_of,
    in_brackets,
    is_table,
    read_cells,
)

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
        Measured numbers and their standard deviations, by column, in the mechanism's
        units; NaN where missing.
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
    found : mapping of str to float
        Zeros and offsets in the mechanism's units, such as "tool.x", that the rows have
        been corrected by.
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
    found: Mapping[str, float] = field(default_factory=dict)

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
        """Some of the rows: `keep` says whether each is one (N,), or lists indices."""
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
        """Number (N,) of each row's posture and load; repeats have equal numbers."""
        sessions = {name: float(i) for i, name in enumerate(dict.fromkeys(self.session))}
        of_session = np.array(
            [sessions[name] for name in self.session] or [0.0] * len(self.q)
        )
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
    return np.array(
        [known.setdefault(row.tobytes(), len(known)) for row in rows], np.intp
    )


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
    is_known : ndarray of bool (2,)
        Whether the standard deviations of lengths and of angles are known.

    Raises
    ------
    InputError
        If only some standard deviations of lengths, or of angles, are given.
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
    is_known: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        known = []
        for group, word in ((~self.is_angle, "lengths"), (self.is_angle, "angles")):
            missing = np.isnan(self.deviation[group])
            if missing.any() and not missing.all():
                raise InputError(
                    f"some {word} have a standard deviation and others none",
                    expected="one for each number, or none at all",
                    got=f"{int(missing.sum())} of {len(missing)} without",
                )
            known.append(not missing.any())
        object.__setattr__(self, "is_known", np.array(known))

    def __len__(self) -> int:
        return len(self.target)

    @property
    def group(self) -> NDArray[np.intp]:
        """0 for lengths, 1 for angles (m,)."""
        return self.is_angle.astype(np.intp)

    @property
    def unit(self) -> Array:
        """Standard deviations (m,); 1 for those that are to be estimated."""
        return np.where(np.isnan(self.deviation), 1.0, self.deviation)


def field_of(elastic: ElasticMechanism) -> Array:
    """Acceleration (3,) of hung masses, in F, m/s^2."""
    return np.array(EARTH if elastic.gravity is None else elastic.gravity, float)


def wrenches(
    measured: Measurements, elastic: ElasticMechanism, poses: Array
) -> tuple[Array, Array]:
    """All loads (N, 6), moment and force at `load_at` along the axes of F, and those of
    the reference state, `mass0` alone.
    """
    axes = {"body": poses, "base": elastic.mechanism.base_pose, "world": np.eye(4)}
    R = axes[measured.axes][..., :3, :3]
    loads = measured.wrench.reshape(-1, 2, 3) @ np.swapaxes(R, -1, -2)
    per_kilogram = np.append(np.zeros(3), field_of(elastic)) / elastic.units.newtons
    weight, reference = (
        np.multiply.outer(mass, per_kilogram) for mass in (measured.mass, measured.mass0)
    )
    return loads.reshape(-1, 6) + weight, reference


def observe(
    measured: Measurements, elastic: ElasticMechanism, poses: Array
) -> Observations:
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
        return (
            np.array([*columns], float).reshape(len(names), len(R), *shape).swapaxes(0, 1)
        )

    # One number per measured cell, in the order of the rows.
    values = table(measured.values.values())
    used = ~np.isnan(values)
    row, place = np.nonzero(used)

    def measured_along(name: str, group: tuple[str, ...] | None) -> Array:
        if group is None:
            return np.asarray(measured.direction @ T_F_B[:3, :3].T)
        return np.tile(T_F_B[:3, group.index(name)], (len(R), 1))

    axis = table(map(measured_along, names, kinds), 3)[used]
    # How it depends on the twist of the body.
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


def _rigid(
    points: Array, R: Array, T_F_B: Array, measured: Measurements
) -> dict[str, Array]:
    """Positions and orientations less those of the rigid mechanism,
    in the robot's base frame.
    """
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


AXES = ("base", "body", "world")
_LARGEST_FILE = 1 << 27
# Numbers without a unit that cannot be SI: displacements beyond this share of the
# mechanism's size, positions beyond this multiple of it, small rotations and joint angles
# beyond these [rad].
_MAX_DISPLACEMENT, _MAX_POSITION, _MAX_ROTATION, _MAX_ANGLE = (
    0.2,
    20.0,
    0.5,
    4.0 * math.pi,
)
# Forces that cannot be N: 1 N moves a mechanism of this size [m] by more than this share
# of it.
_TALL, _SHARE_PER_NEWTON = 0.3, 3e-4
# Displacements that no mechanism has, with any unit, in its sizes.
_IMPOSSIBLE_DISPLACEMENT = 2.0


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
#: A column that only tables of `cartstiff path` have; their wrenches are along the body's
#: axes.
OF_PATH: Final = "singular_ratio"


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
    """Columns of the posture, and their kinds.

    Joints by name, or with "q" and an underscore before it; of a closed chain its
    actuated joints must be given, and others may. A platform's pose is "q_x" to "q_yaw".
    """
    mechanism = elastic.mechanism
    columns = {}
    for j, coordinate in enumerate(mechanism.coordinates):
        if j not in mechanism.virtual:
            kind = "length" if coordinate.is_length else "angle"
            columns[f"q_{coordinate.name}"] = kind
            if coordinate.name not in MEASURED:
                columns[coordinate.name] = kind
    return columns


def kinds_of(elastic: ElasticMechanism) -> dict[str, str]:
    """Every column that a table for this mechanism may have, and its kind."""
    own = {**posture_columns(elastic), **_OTHERS, **MEASURED}
    return own | {f"sd_{name}": kind for name, kind in MEASURED.items()}


def without_paths(
    cells: Cells, kinds: Mapping[str, str]
) -> tuple[Cells, tuple[str, ...]]:
    """A table of `cartstiff path` or `equilibrium --path` without their own columns,
    and these.

    Other tables are returned unchanged: an unknown column of theirs is an error, and so
    is a name that is nearly one of `kinds`.
    """
    names = [head.split("[")[0].strip() for head in cells.names]
    of_path, of_commands = (
        OF_PATH in names,
        any(name.startswith("command_") for name in names),
    )
    unused = [
        i
        for i, name in enumerate(names)
        if name not in kinds
        and (
            (
                of_commands
                and name.startswith(("command_", "taught_", "before_", "after_"))
            )
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
    name = in_brackets(head).split("[")[0].strip()
    if not name:
        raise InputError(
            "column head cannot be read",
            where=where,
            expected="name or name [unit]",
            got=repr(head),
        )
    if name not in kinds:
        raise UnknownNameError("column", name, _shown(kinds), where=where)
    kind = kinds[name]
    _, of, factor = head_of(head, where, kind)
    if of is None and kind in default:
        return Column(name, kind, UNITS[kind][default[kind]], True)
    return Column(name, kind, factor, of is not None)


def _shown(kinds: Iterable[str]) -> list[str]:
    """Names sorted for messages: those with q_ and sd_ last."""
    return sorted(kinds, key=lambda name: name.startswith(("q_", "sd_")))


def read_measurements(
    table: Any,
    elastic: ElasticMechanism,
    *,
    units: Mapping[str, str] | None = None,
    deviations: Mapping[str, float] | None = None,
    point: tuple[float, float, float] = (0.0, 0.0, 0.0),
    load_at: tuple[float, float, float] | None = None,
    load_axes: str | None = None,
    open_cells: bool = False,
) -> Measurements:
    """Read and check a table of measurements.

    Parameters
    ----------
    table : Path, str, mapping of str to array_like, structured array, or data frame
        CSV with a line of column names, see the how-to "Which joint stiffness do I
        enter?"; or the same columns by name, as in a data frame of pandas.
    elastic : ElasticMechanism
        The measured mechanism.
    units : mapping of str to str, optional
        Units by kind ("length": "mm") of columns without one in their head; default SI.
    deviations : mapping of str to float, optional
        Standard deviations by column, in SI, if the table has none.
    point : tuple of 3 floats
        Measured point of the body, in M; default its origin.
    load_at : tuple of 3 floats
        Point of the body, in M, at which loads act; default the measured one.
    load_axes : {"base", "body", "world"}, optional
        Axes of the columns mx, my, mz, fx, fy, fz; default base, and body in a table that
        `cartstiff path` wrote. They are turned into those of the base.
    open_cells : bool
        Whether measured columns may be missing or empty.

    Raises
    ------
    InputError
        With file, line and column.
    """
    if is_table(table):
        cells = cells_of(table, elastic.names)
    elif isinstance(table, (str, Path)):
        cells = read_cells(Path(table), "measurements", _LARGEST_FILE, elastic.names)
    else:
        raise InputError(
            "measurements have no named columns",
            expected="Measurements, the path of a CSV, a mapping of columns, a "
            "structured array, or a data frame",
            got=type(table).__name__,
        )
    # Columns, by their heads.
    kinds = kinds_of(elastic)
    cells, unused = without_paths(cells, kinds)
    columns = [
        column_of(head, kinds, units or {}, f"{cells.place}, column {i + 1}")
        for i, head in enumerate(cells.names)
    ]
    names = [column.name for column in columns]
    for name in names:
        if names.count(name) > 1 or (f"q_{name}" in names and name not in MEASURED):
            raise InputError("column named twice", where=cells.place, got=repr(name))
    numbers = {
        column.name: _numbers(cells, i, column)
        for i, column in enumerate(columns)
        if column.kind != "text"
    }
    # Postures, loads and measured numbers, in the mechanism's units.
    count = len(cells.rows)
    length, force = convert_length(SI, elastic.units)
    q = _postures(numbers, columns, elastic, cells, length)
    reach = elastic.mechanism.at(elastic.q).length / length
    _check_sizes(columns, numbers, reach, cells)
    factors = np.repeat([force * length, force], 3)
    wrench = np.stack([_loads(numbers, name, cells) for name in LOAD], axis=1) * factors
    values, sds = _measured(numbers, cells, dict(deviations or {}), length, open_cells)
    # Sessions and masses.
    session: tuple[str, ...] = ()
    if "session" in names:
        at = names.index("session")
        session = tuple(row[at] for row in cells.rows)
        for name, place in zip(session, cells.places, strict=True):
            if not name:
                raise InputError(
                    "no session", where=place, expected="a name in every row"
                )
    mass, mass0 = _loads(numbers, "mass", cells), _loads(numbers, "mass0", cells)
    least = np.minimum(mass, mass0)
    _refuse(least < 0, cells, "mass cannot be used", "zero or more", least)
    if load_axes is None and OF_PATH in unused and wrench.any():
        wrench = _in_base(elastic, q, wrench)
    measurements = Measurements(
        q,
        wrench,
        mass,
        mass0,
        load_axes or "base",
        values,
        sds,
        _directions(numbers, cells, values),
        session,
        numbers.get("time", np.full(count, np.nan)),
        point,
        point if load_at is None else load_at,
        unused=unused,
    )
    _check_loads(measurements, elastic, cells)
    return measurements


def _refuse(
    bad: Array,
    cells: Cells,
    words: str,
    expected: str | None = None,
    got: Array | None = None,
) -> None:
    """Refuse the first of the bad rows (N,)."""
    if bad.any():
        row = int(np.argmax(bad))
        shown = None if got is None else f"{got[row]:g}"
        raise InputError(words, where=cells.places[row], expected=expected, got=shown)


def _numbers(cells: Cells, i: int, column: Column) -> Array:
    """Numbers of one column in SI; NaN where a cell is empty."""
    numbers = np.full(len(cells.rows), np.nan)
    for n, row in enumerate(cells.rows):
        text = row[i]
        if not text:
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text or abs(value) > LARGEST_INPUT:
            raise InputError(
                f"column {column.name!r}: not a finite number",
                where=cells.places[n],
                expected="a number, or nothing",
                got=repr(text),
            )
        numbers[n] = value * column.factor
    return numbers


def _in_base(elastic: ElasticMechanism, q: Array, wrench: Array) -> Array:
    """Wrenches (N, 6) along the body's axes in those of the base."""
    mechanism = elastic.mechanism
    T_B_F = se3.inverse(mechanism.base_pose)
    R = np.array([(T_B_F @ mechanism.at(row).pose)[:3, :3] for row in q])
    turned: Array = np.einsum("nij,nkj->nki", R, wrench.reshape(-1, 2, 3)).reshape(-1, 6)
    return turned


def _loads(table: Mapping[str, Array], name: str, cells: Cells) -> Array:
    """A load's column; zero if it is missing, refused where it is empty."""
    values = table.get(name, np.zeros(len(cells.rows)))
    _refuse(
        np.isnan(values),
        cells,
        f"no load: column {name!r} is empty",
        "a number, 0 for none",
    )
    return values


def _postures(
    table: Mapping[str, Array],
    columns: list[Column],
    elastic: ElasticMechanism,
    cells: Cells,
    length: float,
) -> Array:
    """Coordinates (N, n), closed chains assembled."""
    mechanism = elastic.mechanism
    q = np.tile(elastic.q, (len(cells.rows), 1))
    is_given = np.zeros(len(elastic.names), bool)
    for j, coordinate in enumerate(mechanism.coordinates):
        for name in (f"q_{coordinate.name}", coordinate.name):
            if name not in table or name in MEASURED:
                continue
            values = table[name]
            _refuse(np.isnan(values), cells, f"no posture: column {name!r} is empty")
            q[:, j] = values * (length if coordinate.is_length else 1.0)
            is_given[j] = True
            column = next(c for c in columns if c.name == name)
            if not coordinate.is_length and not column.declared:
                _check_angle(name, values, coordinate.lower, coordinate.upper, cells)
    needed = [j for j in elastic.commanded if j not in mechanism.rigid]
    if mechanism.coordinates_are_pose and not is_given.any():
        needed = []  # it is at the file's pose
    if not is_given[needed].all():
        heads = [f"q_{n}" if n in MEASURED else n for n in elastic.names]
        missing = next(heads[j] for j in needed if not is_given[j])
        raise InputError(
            f"column {missing!r} is missing: the posture is not known",
            where=cells.place,
            expected=", ".join(heads[j] for j in needed),
        )
    if not mechanism.closures:
        return q
    distinct = _groups(q)
    for n in np.unique(distinct, return_index=True)[1]:
        try:
            closed, moved = assembled(elastic, q[n])
        except (ConvergenceError, UndefinedError) as error:
            raise InputError(
                str(error),
                where=cells.places[n],
                expected="a posture that closes the chain",
            ) from None
        if moved > numerics.NEGLIGIBLE_DISTANCE:  # a rounded table may be off by less
            raise InputError(
                "the chain closes only if motors or links give way",
                got=f"{moved:.3g}",
                where=cells.places[n],
                expected="a posture that the motors can take",
            )
        q[distinct == distinct[n]] = closed
    return q


def assembled(elastic: ElasticMechanism, q: Array) -> tuple[Array, float]:
    """Coordinates (n,) that close a chain, and how far its motors or links
    moved for that.

    If they had to move, the posture is not free of stress.

    Raises
    ------
    ConvergenceError, UndefinedError
        If the chain cannot be closed.
    """
    mechanism = elastic.mechanism
    if not mechanism.closures:
        return q, 0.0
    motors = elastic.commanded
    closed = mechanism.closed(q, named=motors).q
    held = [*motors, *mechanism.virtual]
    return closed, float(np.abs(closed - q)[held].max(initial=0.0))


def _check_angle(
    name: str, values: Array, lower: float, upper: float, cells: Cells
) -> None:
    """Refuse degrees that are given as radians."""
    row = int(np.argmax(np.abs(values)))
    far = abs(float(values[row])) > _MAX_ANGLE
    if np.isfinite(lower) and np.isfinite(upper):
        beyond = (values < lower - 1.0) | (values > upper + 1.0)
        row = int(np.argmax(beyond)) if beyond.any() else row
        far = far or bool(beyond.any())
    if far:
        raise InputError(
            f"column {name!r} holds degrees given as radians, it seems",
            where=cells.places[row],
            expected=f"{name!r} in rad, or the head '{name} [deg]'",
            got=f"{values[row]:g} rad",
        )


def _check_sizes(
    columns: list[Column], table: Mapping[str, Array], reach: float, cells: Cells
) -> None:
    """Refuse numbers without a unit that cannot be SI, and impossible displacements."""
    for column in columns:
        if column.declared and column.name in (*DISPLACEMENT, "d"):
            far = np.nan_to_num(np.abs(table[column.name]))
            words = f"column {column.name!r}: no mechanism of {reach:.3g} m moves so far"
            most = f"at most {_IMPOSSIBLE_DISPLACEMENT * reach:.3g} m"
            _refuse(far > _IMPOSSIBLE_DISPLACEMENT * reach, cells, words, most, far)
        if column.declared or column.name not in table:
            continue
        name = column.name.removeprefix("sd_")
        limit, unit = {
            **dict.fromkeys((*DISPLACEMENT, "d"), (_MAX_DISPLACEMENT * reach, "m")),
            **dict.fromkeys(POSITION, (_MAX_POSITION * reach, "m")),
            **dict.fromkeys(ROTATION, (_MAX_ROTATION, "rad")),
            **dict.fromkeys(TURN, (_MAX_ANGLE, "rad")),
        }.get(name, (math.inf, ""))
        size = np.nan_to_num(np.abs(table[column.name]))
        row = int(np.argmax(size))
        if size[row] > limit:
            other = "[mm]" if unit == "m" else "[deg]"
            raise InputError(
                f"column {column.name!r} declares no unit and cannot be in {unit}",
                where=cells.places[row],
                expected=f"at most {limit:.3g} {unit}, or a head such as '{column.name} "
                f"{other}'",
                got=f"{size[row]:g} {unit}",
            )
    _check_forces(columns, table, reach, cells)


def _check_forces(
    columns: list[Column], table: Mapping[str, Array], reach: float, cells: Cells
) -> None:
    """Refuse forces without a unit that are far too small for the displacements."""
    forces = [c for c in columns if c.name in LOAD[3:]]
    moved = [np.nan_to_num(table[n]) for n in (*DISPLACEMENT, "d") if n in table]
    if not forces or not moved or any(c.declared for c in forces) or reach < _TALL:
        return
    force = np.linalg.norm([np.nan_to_num(table[c.name]) for c in forces], axis=0)
    far = np.linalg.norm(moved, axis=0)
    acts = (force > 0.0) & (far > 0.0)
    if not acts.any() or np.median(far[acts] / force[acts]) <= _SHARE_PER_NEWTON * reach:
        return
    row = int(np.argmax(np.where(acts, force, 0.0)))
    raise InputError(
        f"column {forces[0].name!r} declares no unit and can hardly be in N",
        where=cells.places[row],
        expected=f"at least {far[row] / (_SHARE_PER_NEWTON * reach):.3g} N for a "
        "displacement of "
        f"{far[row]:.3g} m, or a head such as '{forces[0].name} [kN]' or "
        f"'{forces[0].name} [N]'",
        got=f"{force[row]:.3g} N",
    )


def _measured(
    table: Mapping[str, Array],
    cells: Cells,
    deviations: dict[str, float],
    length: float,
    is_open: bool,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Values and deviations by column, in the mechanism's units."""
    for name in deviations:
        if name not in table:
            raise InputError(
                f"a standard deviation for {name!r}, which is not in the table",
                where="--sd",
                expected=f"a column {name!r}",
            )
    # Each quantity with its standard deviation, in the mechanism's units.
    values, sds = {}, {}
    for name, kind in MEASURED.items():
        spread = table.get(f"sd_{name}")
        if name not in table:
            if spread is not None:
                raise InputError(
                    f"column 'sd_{name}' without its column",
                    where=cells.place,
                    expected=f"a column {name!r}",
                )
            continue
        factor = length if kind == "length" else 1.0
        if spread is None:
            spread = np.full(len(cells.rows), deviations.get(name, np.nan))
        bad = (spread <= 0) | (
            np.isnan(spread) & ~np.isnan(table[name]) & (f"sd_{name}" in table)
        )
        words = f"standard deviation of {name!r} cannot be used"
        _refuse(bad, cells, words, "above zero", spread)
        values[name], sds[name] = table[name] * factor, spread * factor
    if not values and not is_open:
        raise InputError(
            "nothing was measured: no column says what",
            where=cells.place,
            expected=f"some of {', '.join(MEASURED)}",
        )
    # Orientations are whole.
    turned = [name in values for name in TURN]
    if any(turned) and not all(turned):
        raise InputError(
            "an orientation needs all of roll, pitch, yaw", where=cells.place
        )
    for name in TURN[1:] if all(turned) else ():
        differ = np.isnan(values[name]) != np.isnan(values[TURN[0]])
        _refuse(differ, cells, "an orientation needs all of roll, pitch, yaw")
    if values and not is_open:
        nothing = np.all([np.isnan(v) for v in values.values()], axis=0)
        _refuse(nothing, cells, "nothing was measured in this row")
    return values, sds


def _directions(
    table: Mapping[str, Array], cells: Cells, values: Mapping[str, Array]
) -> Array:
    """Unit vectors of the dial gauge (N, 3)."""
    names = ("nx", "ny", "nz")
    directions = np.full((len(cells.rows), 3), np.nan)
    there = [name in table for name in names]
    if "d" not in values:
        if any(there):
            raise InputError(
                "a direction without a dial gauge",
                where=cells.place,
                expected="a column 'd'",
            )
        return directions
    if not all(there):
        raise InputError(
            "column 'd' needs its direction",
            where=cells.place,
            expected="columns nx, ny, nz",
        )
    directions = np.stack([table[name] for name in names], axis=1)
    size = np.linalg.norm(directions, axis=1)
    bad = ~np.isnan(values["d"]) & ~(size > 0.0)
    _refuse(bad, cells, "the dial gauge has no direction", "nx, ny, nz, not all zero")
    with numerics.silent():
        return directions / size[:, None]


def _check_loads(
    measurements: Measurements, elastic: ElasticMechanism, cells: Cells
) -> None:
    """Refuse tables without a load."""
    acts = measurements.wrench.any(axis=1) | (measurements.mass != measurements.mass0)
    absolute = np.zeros(len(measurements), bool)
    for name in (*POSITION, *TURN):
        if name in measurements.values:
            absolute |= ~np.isnan(measurements.values[name])
    weight = elastic.gravity is not None and any(elastic.mechanism.masses().values())
    if not acts.any() and not (absolute.any() and weight):
        words = "the load is zero everywhere: no spring is stretched"
        if absolute.any():
            words += ", and no gravity acts on the mechanism"
        raise InputError(
            words,
            where=one_line(cells.place),
            expected="columns fx, fy, fz, mx, my, mz or mass",
        )


def table_text(
    measured: Measurements, elastic: ElasticMechanism, columns: Sequence[str] = ()
) -> str:
    """Rows under a line of names: postures, loads, measured numbers, times and sessions.

    Parameters
    ----------
    measured : Measurements
        The rows.
    elastic : ElasticMechanism
        Mechanism whose joints name the columns.
    columns : sequence of str
        Empty columns, to be filled in.
    """
    own = elastic.units
    in_length = own.length if own.length in UNITS["length"] else SI.length
    length, force = convert_length(Units(in_length), own)
    mechanism = elastic.mechanism
    # Joints, loads, measured quantities, then times and sessions.
    table: dict[str, Array] = {}
    for j, c in enumerate(mechanism.coordinates):
        if j not in mechanism.virtual:
            unit, size = (in_length, length) if c.is_length else (own.angle, 1.0)
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
        unit, factor = (in_length, length) if is_length else (own.angle, 1.0)
        table[f"{name} [{unit}]"] = values / factor
        if name == "d":
            table |= dict(zip(("nx", "ny", "nz"), measured.direction.T, strict=True))
        spread = measured.deviations.get(name)
        if spread is not None and not np.isnan(spread).all() and name not in columns:
            table[f"sd_{name} [{unit}]"] = spread / factor
    if not np.isnan(measured.time).all():
        table["time [s]"] = measured.time
    rows = np.stack([*table.values()], axis=1).tolist()
    lines = [["" if np.isnan(x) else f"{x:.10g}" for x in row] for row in rows]
    if not measured.session:
        return csv_rows([*table], lines)
    named = [[*line, name] for line, name in zip(lines, measured.session, strict=True)]
    return csv_rows([*table, "session"], named)
