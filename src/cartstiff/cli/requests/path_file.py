"""Path files: comma-separated poses, with what acts at each of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from cartstiff.errors import InputError, UnknownNameError, one_line

if TYPE_CHECKING:
    from cartstiff.mechanisms.contract import Units
    from cartstiff.toolpaths.tool_path import ToolPath

_POSITION = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")
_AXIS = ("ax", "ay", "az")
WRENCH = ("mx", "my", "mz", "fx", "fy", "fz")
_DIRECTION = ("dx", "dy", "dz")
_GROUPS = (_POSITION, _ANGLES, _AXIS, WRENCH, _DIRECTION)


def read_path_file(
    file: Path,
    *,
    free: str = "none",
    wrench: list[float] | None = None,
    direction: list[float] | None = None,
    axes: str | None = None,
    units: Units | None = None,
    factors: Mapping[str, float] = MappingProxyType({}),
) -> ToolPath:
    """A path from a file.

    The first line may name the columns, with units (``x [mm]``, ``yaw [deg]``): x, y, z with roll,
    pitch, yaw (about fixed axes) or with ax, ay, az (the tool's axis), and mx, my, mz, fx, fy, fz
    (wrench), dx, dy, dz (direction) if wanted. Without names: x, y, z, roll, pitch, yaw, and a
    wrench if there are twelve columns.
    Lines that start with # are left out.

    Parameters
    ----------
    file : Path
        UTF-8 text.
    free : str
        Axis of the body that ax, ay, az are the direction of.
    wrench, direction : list of float, optional
        The same at all points, instead of columns.
    axes : {"path", "world", "body"}, optional
        Axes of wrenches and directions; default "path".
    units : Units, optional
        What lengths and forces come in; default SI.
    factors : mapping of str to float
        What numbers of columns are multiplied by whose head names no unit.

    Raises
    ------
    InputError
        With the line, for anything that cannot be used.
    """
    import numpy as np

    from cartstiff.geometry import se3
    from cartstiff.loading.tables import read_rows
    from cartstiff.mechanisms.contract import SI
    from cartstiff.toolpaths.tool_path import ToolPath

    where = one_line(str(file))
    degree = np.pi / 180.0 if units is not None and units.shown_angle == "deg" else 1.0
    factors = {**factors, **dict.fromkeys(_ANGLES, degree)}
    rows = read_rows(file, "points", units=units or SI, factors=factors)
    if rows.names is None:
        names, values, _ = rows.arranged((*_POSITION, *_ANGLES), (*_POSITION, *_ANGLES, *WRENCH))
    else:
        names, values = tuple(name.lower() for name in rows.names), rows.values
        _check_names(names, rows.place)
    table = dict(zip(names, values.T, strict=True))

    def columns(group: tuple[str, ...]) -> Any:
        return np.column_stack([table[n] for n in group]) if group[0] in table else None

    wrenches, directions = columns(WRENCH), columns(_DIRECTION)
    for option, value, column in (
        ("--load", wrench, wrenches),
        ("--direction", direction, directions),
    ):
        if value is not None and column is not None:
            raise InputError(f"give {option} or columns of {where}, not both")
    wrenches = wrench if wrenches is None else wrenches
    directions = direction if directions is None else directions
    tool_axes = columns(_AXIS)
    try:
        if tool_axes is None:
            poses = se3.from_roll_pitch_yaw(columns(_POSITION), columns(_ANGLES))
            return ToolPath(poses, wrenches, directions, axes or "path")  # type: ignore[arg-type]
        if free not in ("x", "y", "z"):
            raise InputError(
                "the tool's axis alone gives no pose", expected="--free-axis x, y or z"
            )
        return ToolPath.from_axes(
            columns(_POSITION),
            tool_axes,
            free,  # type: ignore[arg-type]
            wrenches=wrenches,
            directions=directions,
            axes=axes or "path",  # type: ignore[arg-type]
        )
    except InputError as error:
        raise error.at(where) from None


def _check_names(names: tuple[str, ...], where: str) -> None:
    known = [name for group in _GROUPS for name in group]
    for name in names:
        if name not in known:
            raise UnknownNameError("column", name, known, where=where)
        if names.count(name) > 1:
            raise InputError("column named twice", where=where, got=repr(name))
    for group in _GROUPS:
        if 0 < len(set(group) & set(names)) < len(group):
            raise InputError("columns are missing", where=where, expected=", ".join(group))
    if "x" not in names or ("roll" in names) == ("ax" in names):
        raise InputError(
            "columns give no pose",
            where=where,
            expected="x, y, z and either roll, pitch, yaw or ax, ay, az",
        )
