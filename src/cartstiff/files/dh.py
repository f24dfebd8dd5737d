r"""Build robots from Denavit-Hartenberg tables, standard and modified.

Row i places frame i in frame i-1 by turns R about, and displacements T along, the axes x
and z:

    standard:         R_z(theta) T_z(d) T_x(a) R_x(alpha), joint i on z of frame i-1
    modified (Craig): R_x(alpha) T_x(a) R_z(theta) T_z(d), joint i on z of frame i

where q is added to theta of a revolute joint and to d of a prismatic one. The a and alpha
of a modified row are those that Craig numbers i-1.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from pydantic import ValidationError

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.tree import add_joint
from cartstiff.files.description import RobotDescription
from cartstiff.files.parsing import parse_numbers
from cartstiff.files.schema import DHJoint, DHModel, first_error
from cartstiff.files.tables import UNITS, head_of, read_cells

#: Columns of a table, and the kinds of their units.
_COLUMNS: dict[str, tuple[str, ...]] = {
    "joint": (),
    "type": (),
    "a": ("length",),
    "alpha": ("angle",),
    "d": ("length",),
    "theta": ("angle",),
    "lower": ("angle", "length"),
    "upper": ("angle", "length"),
}


def read_dh_table(path: Path) -> list[DHJoint]:
    """Read the rows of a table, in m and rad.

    Columns are joint, type, a, alpha, d, theta, lower and upper, with their units in the
    heads; lower and upper may occur twice, in degrees for revolute and in mm for
    prismatic joints. An empty cell of a number is zero, an empty cell of a limit is no
    limit.

    Raises
    ------
    InputError
        With file and line.
    """
    cells = read_cells(path, "rows of the DH table")
    heads = [_column(cell, cells.place) for cell in cells.names]
    rows = []
    for line, place in zip(cells.rows, cells.places, strict=True):
        row: dict[str, Any] = {}
        limits: dict[str, tuple[str, float]] = {}
        for (name, kind, size), text in zip(heads, line, strict=True):
            if not text:
                continue
            if kind is None:
                row["name" if name == "joint" else name] = text
                continue
            value = parse_numbers(text, f"{place}, column {name}", 1)[0] * size
            if name in ("lower", "upper"):
                limits[name] = kind, value
            else:
                row[name] = value
        if limits:
            row["limits"] = _limits(limits, row.get("type") == "prismatic", place)
        try:
            rows.append(DHJoint.model_validate(row))
        except ValidationError as error:
            raise first_error(error, row, {}, place) from None
    return rows


def _column(cell: str, place: str) -> tuple[str, str | None, float]:
    """Name of a column, kind of its unit, and its factor to m or rad."""
    name, kind, size = head_of(cell, place)
    check_name("column", name, _COLUMNS, place)
    kinds = _COLUMNS[name]
    if kind not in (kinds or (None,)):
        expected = name
        if kinds:
            units = ", ".join(unit for k in kinds for unit in UNITS[k])
            expected = f"{name} [unit], one of {units}"
        raise InputError(
            f"column {cell!r} cannot be used", where=place, expected=expected
        )
    return name, kind, size


def _limits(
    given: Mapping[str, tuple[str, float]], slides: bool, place: str
) -> list[float]:
    """Limits of a joint by column: kinds of their units, and numbers."""
    kind, words = ("length", "a length") if slides else ("angle", "an angle")
    if len(given) != 2 or {own for own, _ in given.values()} != {kind}:
        raise InputError(
            "limits do not fit the joint",
            where=place,
            expected=f"lower and upper, {words} each",
        )
    return [given["lower"][1], given["upper"][1]]


def dh_description(table: DHModel, folder: Path, floating: bool) -> RobotDescription:
    """Build a table's robot: joints j1, j2, ... and links link1, ...
    unless they have names.

    Raises
    ------
    InputError
        For a name that two rows have, and a table without joints.
    """
    rows = table.joints
    if rows is None:
        rows = read_dh_table(folder / Path(table.table or "").expanduser())
    model, joint = pin.Model(), 0
    model.name = "DH table"
    if floating:
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.addFrame(_frame("base", joint, np.eye(4)))
    T, links = np.eye(4), ["world", "base"]
    length, angle = UNITS["length"][table.units.length], UNITS["angle"][table.units.angle]
    for i, row in enumerate(rows, start=1):
        moves, slides = row.type != "fixed", row.type == "prismatic"
        link = f"link{i}" if moves else row.name or f"link{i}"
        name = row.name or (f"j{i}" if moves else link)
        if link in links or name in model.names:
            raise InputError(
                "two rows have one name", where=f"key dh.joints.{i}", got=repr(name)
            )
        links.append(link)
        across = se3.from_roll_pitch_yaw(
            [row.a * length, 0, 0], [row.alpha * angle, 0, 0]
        )
        along = se3.from_roll_pitch_yaw([0, 0, row.d * length], [0, 0, row.theta * angle])
        # A joint is along z between what comes before and after it.
        parts = [along, across]
        if table.convention == "modified":
            parts = [across @ along, np.eye(4)]
        T = T @ parts[0]
        if moves:
            kind = pin.JointModelPZ() if slides else pin.JointModelRZ()
            limits = np.array(row.limits or [-np.inf, np.inf])
            limits *= length if slides else angle
            joint = add_joint(model, joint, kind, T, name, limits)
            T = np.eye(4)
        T = T @ parts[1]
        model.addFrame(_frame(link, joint, T))
    if model.njoints == 1 + floating:
        raise InputError("robot has no movable joints", where="key dh.joints")
    weightless = ("masses of the links, which a DH table does not have",)
    return RobotDescription(model, pieces=(), weightless=weightless)


def _frame(name: str, joint: int, T: Array) -> Any:
    return pin.Frame(name, joint, pin.SE3(T), pin.FrameType.BODY, pin.Inertia.Zero())
