"""Files of commands: a desired stiffness with order, units and frame;
a path of the tool.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import checked_array
from cartstiff.core.choices import LARGEST_INPUT, ORDERS, Axes
from cartstiff.core.errors import InputError, check_name, one_line
from cartstiff.core.geometry import se3
from cartstiff.core.matrix_names import LETTERS
from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.units import SI, Units, convert_length
from cartstiff.files.tables import (
    DIRECTION,
    FORCE,
    MOMENT,
    WRENCH,
    along_axes,
    read_rows,
)
from cartstiff.files.yaml_file import read_bytes
from cartstiff.wings.toolpaths.tool_path import ToolPath

# In the right order, the translation block times the squared length of the mechanism is
# about as stiff as the rotation block; the other order is off by the fourth power of the
# length. If the ratio is worse by this factor than with exchanged blocks, the order must
# be named.
_EXCHANGED_BLOCKS_FACTOR = 5.0
# Largest number of bytes of a file with 36 numbers.
_LARGEST = 1 << 20
# Keys of a .json besides its matrix, and further keys of a saved `StiffnessTensor`.
_TARGET_KEYS = ("order", "units", "frame")
_TENSOR_KEYS = ("connection", "wrench", "pose", "base")


@dataclass(frozen=True)
class Target:
    """A desired stiffness, as in its file.

    Attributes
    ----------
    matrix : ndarray (6, 6)
        Symmetric, in the file's order and units.
    order : str
        One of `ORDERS`.
    order_from : {"file", "option", "default"}
        Source of the order.
    units : tuple of str, or None
        Length and force of the file; None: the units of given numbers.
    frame : str or None
        Name of the frame that the file is for.
    where : str
        For messages.
    connection : str or None
        Letter of the matrix, where a saved `StiffnessTensor` names it.
    """

    matrix: Any
    order: str
    order_from: str
    units: tuple[str, str] | None
    frame: str | None
    where: str
    connection: str | None = None

    def in_units_of(self, mechanism: Mechanism) -> Any:
        """Return the matrix in its own order, in the units of the mechanism.

        Raises
        ------
        InputError
            For another frame than the body's, or unknown units.
        """
        if self.frame not in (None, "body", mechanism.frame):
            raise InputError(
                "is for another frame",
                where=self.where,
                expected=f"{mechanism.frame} or body",
                got=self.frame,
            )
        a, f = 1.0, 1.0
        if self.units is not None:
            try:
                a, f = convert_length(Units(*self.units), mechanism.units)
            except InputError as error:
                raise error.at(self.where) from None
        by_length = np.repeat([a, 1.0] if self.order == ORDERS[0] else [1.0, a], 3)
        return self.matrix * f * np.outer(by_length, by_length / a)

    def in_body_frame(self, result: PostureStiffness) -> Any:
        """Return the matrix in the order and units of the mechanism.

        Raises
        ------
        InputError
            As `in_units_of`, and for numbers that fit only with rotation and translation
            exchanged.
        """
        mechanism = result.elastic.mechanism
        K = self.in_units_of(mechanism)
        K = K if self.order == ORDERS[0] else K[se3.SWAP][:, se3.SWAP]
        turn, move = np.trace(K[:3, :3]), np.trace(K[3:, 3:]) * result.posture.length**2
        if self.order_from == "default" and turn > 0 and move > 0:
            exchanged = (
                np.trace(K[3:, 3:]),
                np.trace(K[:3, :3]) * result.posture.length**2,
            )
            if _ratio_above_one(turn, move) > _EXCHANGED_BLOCKS_FACTOR * _ratio_above_one(
                *exchanged
            ):
                units = f"{mechanism.units.length} and {mechanism.units.force}"
                raise InputError(
                    "the matrix looks as if translation came before rotation",
                    where=self.where,
                    expected=f'a .json with "order": "{ORDERS[1]}", or a .csv that '
                    "begins with the "
                    f"line # order {ORDERS[1]} (or {ORDERS[0]} if it is meant so); a "
                    ".json names "
                    f"other units than {units}",
                )
        return K


def _ratio_above_one(a: float, b: float) -> float:
    return max(a / b, b / a)


def _of_numpy(data: bytes) -> Any:
    """Return the array of an .npy file.

    For a broken file the reader raises any exception.
    """
    try:
        return np.load(io.BytesIO(data), allow_pickle=False)
    except Exception as error:
        raise ValueError(str(error)) from None


def read_target(path: Path, order: str | None = None, option: str = "--target") -> Target:
    """Read a 6x6 matrix from a file: .json (rows, or an object with "matrix"),
    .csv or .npy.

    Messages name the option that names the file.
    """
    where = f"{option} {one_line(str(path))}"
    if path.suffix not in (".json", ".csv", ".npy"):
        raise InputError(
            "unknown file ending", where=where, expected=".json, .csv or .npy"
        )
    try:
        data = read_bytes(path, _LARGEST)
    except InputError as error:
        raise error.moved_to(where) from None
    with _matrix_in(where):
        fields, content = _contents(path, data)
    if isinstance(content, dict):
        _check_keys(content, where)
        fields, content = content, content["matrix"]
    with _matrix_in(where):
        matrix = checked_array(content, (6, 6), "matrix")
    largest = float(np.abs(matrix).max())
    if largest > LARGEST_INPUT:
        raise InputError(
            "number is too large",
            where=where,
            expected=f"at most {LARGEST_INPUT:g}",
            got=f"{largest:g}",
        )
    if np.abs(matrix - matrix.T).max() > numerics.NEGLIGIBLE_DISTANCE * largest:
        raise InputError(
            "matrix is not symmetric", where=where, expected="a symmetric stiffness (K^B)"
        )
    # Order, units and frame, by the option, the file or default.
    own = fields.get("order")
    if own is not None:
        _check_order(own, order, where)
    source = "file" if own is not None else "default"
    return Target(
        0.5 * (matrix + matrix.T),
        order or own or ORDERS[0],
        source if order is None else "option",
        _units(fields.get("units"), where),
        _frame(fields.get("frame"), where),
        where,
        _connection(fields.get("connection")),
    )


@contextmanager
def _matrix_in(where: str) -> Iterator[None]:
    """Refuse a file whose contents cannot be read as a matrix."""
    try:
        yield
    except (ValueError, TypeError, RecursionError, MemoryError) as error:
        raise InputError(
            "does not hold a matrix",
            where=where,
            expected="a 6x6 matrix of numbers",
            got=getattr(error, "got", None) or str(error),
        ) from None


def _contents(path: Path, data: bytes) -> tuple[dict[str, Any], Any]:
    """What a file says beside its matrix, and the matrix, or the object with both."""
    if path.suffix == ".npy":
        return {}, _of_numpy(data)
    if path.suffix == ".json":
        return {}, json.loads(data)
    text, fields = data.decode(), dict[str, Any]()
    # The comment that our own files begin with names the order.
    first = text.partition("\n")[0] if text.startswith("#") else ""
    named = [order for order in ORDERS if f"order {order}" in first]
    if named:
        fields["order"] = named[0]
    if head := re.match(r"# K\^(load|[ABFK+])\b", text):
        fields["connection"] = {"name": head[1]}
    return fields, read_rows(path, "rows", _LARGEST).values


def _check_order(own: Any, wanted: str | None, where: str) -> None:
    """Refuse an order of a file that is unknown, or not the one that is wanted."""
    if own not in ORDERS:
        raise InputError(
            "unknown order", where=where, expected=" or ".join(ORDERS), got=repr(own)
        )
    if wanted is not None and own != wanted:
        raise InputError(
            "the file names another order", where="--order", expected=own, got=wanted
        )


def _connection(connection: Any) -> str | None:
    """The letter of a saved tensor's connection; None for one without a letter."""
    name = connection.get("name") if isinstance(connection, dict) else None
    return name if name in LETTERS else None


def _check_keys(fields: dict[str, Any], where: str) -> None:
    if "matrix" not in fields:
        raise InputError(
            "there is no key matrix",
            where=where,
            expected='{"matrix": [6 rows]}',
            got=_listed(fields) or "no key",
        )
    if strange := fields.keys() - {"matrix", *_TARGET_KEYS, *_TENSOR_KEYS}:
        raise InputError(
            f"unknown key {_listed(strange)}",
            where=where,
            expected=f"matrix, {', '.join(_TARGET_KEYS)}",
        )


def _listed(keys: Iterable[str]) -> str:
    return ", ".join(one_line(key, 30) for key in sorted(keys)[:6])


def _units(units: Any, where: str) -> tuple[str, str] | None:
    if units is None:
        return None
    if not isinstance(units, dict) or not set(units) <= {"length", "force", "angle"}:
        raise InputError(
            "units cannot be used",
            where=where,
            expected='{"length": "m", "force": "N"}',
            got=repr(units),
        )
    if units.get("angle", "rad") != "rad":
        raise InputError(
            "unknown unit of angles",
            where=where,
            expected="rad",
            got=repr(units["angle"]),
        )
    return str(units.get("length", "m")), str(units.get("force", "N"))


def _frame(frame: Any, where: str) -> str | None:
    if frame is not None and not isinstance(frame, str):
        raise InputError("frame is not a name", where=where, got=repr(frame))
    return frame


_POSITION = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")
_AXIS = ("ax", "ay", "az")


def read_path_file(
    file: Path,
    *,
    free: str = "none",
    wrench: list[float] | None = None,
    direction: list[float] | None = None,
    axes: Axes | None = None,
    base: Any = None,
    units: Units = SI,
) -> ToolPath:
    """Read a path of the tool from a file.

    The first line may name the columns, with units (``x [mm]``, ``yaw [deg]``): x, y, z
    with roll, pitch, yaw (about fixed axes) or with ax, ay, az (the tool's axis), and
    optionally mx, my, mz, fx, fy, fz (wrench, of which one half may be missing) and dx,
    dy, dz (direction). These may name their axes, as fx_world, fx_base, fx_body. Without
    names the columns are x, y, z, roll, pitch, yaw, and a wrench if there are twelve.
    Lines that start with # are ignored.

    Parameters
    ----------
    file : Path
        UTF-8 text.
    free : str
        Axis of the body that ax, ay, az are the direction of.
    wrench, direction : list of float, optional
        Constant values at all points, instead of columns.
    axes : {"base", "body", "world"}, optional
        Axes of wrenches and directions; default those of the file's poses.
    base : ndarray (4, 4), optional
        Pose of the robot's own base B in F; default F itself.
    units : Units
        Units of lengths and forces.

    Raises
    ------
    InputError
        With the line, for anything that cannot be used.
    """
    # Columns by their names, or in the order of poses and wrenches.
    where = one_line(str(file))
    rows = read_rows(file, "points", units=units)
    if rows.names is None:
        names, values, _ = rows.arranged(
            (*_POSITION, *_ANGLES), (*_POSITION, *_ANGLES, *WRENCH)
        )
    else:
        lower, values = tuple(name.lower() for name in rows.names), rows.values
        names, own = along_axes(lower, rows.place)
        _check_names(names, rows.place)
        axes = one_of_axes(axes, own, rows.place)
    table = dict(zip(names, values.T, strict=True))

    def columns(group: tuple[str, ...]) -> Any:
        return np.column_stack([table[n] for n in group]) if group[0] in table else None

    # What is the same at all points may be an option instead of columns.
    wrenches = once("--load", wrench, wrench_columns(table), where)
    directions = once("--direction", direction, columns(DIRECTION), where)
    of: Any = axes or "path"
    # The robot's base is fixed in the room: from here on the room's axes serve.
    if axes == "base":
        of = "world"
        T = np.eye(4) if base is None else base
        wrenches, directions = along_world(wrenches, T), along_world(directions, T)
    tool_axes = columns(_AXIS)
    try:
        # Poses, or places with the tool's axis alone, whose turn is then free.
        if tool_axes is None:
            poses = se3.from_roll_pitch_yaw(columns(_POSITION), columns(_ANGLES))
            return ToolPath(poses, wrenches, directions, of)
        if free not in ("x", "y", "z"):
            raise InputError(
                "the tool's axis alone does not define a pose",
                expected="--free-axis x, y or z",
            )
        return ToolPath.from_axes(
            columns(_POSITION),
            tool_axes,
            free,  # type: ignore[arg-type]
            wrenches=wrenches,
            directions=directions,
            axes=of,
        )
    except InputError as error:
        raise error.at(where) from None


def once(option: str, value: Any, columns: Any, where: str) -> Any:
    """What an option or the columns of a file say; refused if both do."""
    if value is not None and columns is not None:
        raise InputError(f"give {option} or columns of {where}, not both")
    return value if columns is None else columns


def along_world(rows: Any, base: Any) -> Any:
    """Vectors along the axes of the base at a pose, as wrenches (m, 6), in the room;
    None for none.
    """
    if rows is None:
        return None
    return (np.reshape(rows, (-1, 3)) @ base[:3, :3].T).reshape(np.shape(rows))


def wrench_columns(table: Mapping[str, Any]) -> Any:
    """Wrenches (m, 6) of a table's columns by name, None without any.

    A missing half is zero.
    """
    there = [name for name in WRENCH if name in table]
    if not there:
        return None
    zero = np.zeros(len(table[there[0]]))
    return np.column_stack([table.get(name, zero) for name in WRENCH])


def one_of_axes(option: Axes | None, named: Axes | None, place: str) -> Axes | None:
    """Axes of loads by an option or by the columns' names; refused if they differ."""
    if option is not None and named is not None and option != named:
        raise InputError(
            "the columns name other axes", where=place, expected=option, got=named
        )
    return named or option


def _check_names(names: tuple[str, ...], where: str) -> None:
    groups = (_POSITION, _ANGLES, _AXIS, MOMENT, FORCE, DIRECTION)
    known = [name for group in groups for name in group]
    for name in names:
        check_name("column", name, known, where)
        if names.count(name) > 1:
            raise InputError("column named twice", where=where, got=repr(name))
    for group in groups:
        if 0 < len(set(group) & set(names)) < len(group):
            raise InputError(
                "columns are missing", where=where, expected=", ".join(group)
            )
    if "x" not in names or ("roll" in names) == ("ax" in names):
        raise InputError(
            "columns define no pose",
            where=where,
            expected="x, y, z and either roll, pitch, yaw or ax, ay, az",
        )
