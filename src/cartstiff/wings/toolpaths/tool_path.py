"""A path of the tool: poses, with the load or the direction of interest at
each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_array,
    checked_pose,
    is_pose,
    read_only,
)
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.geometry import se3
from cartstiff.core.stiffness.applied_load import wrench_in_body

#: Axes of wrenches and directions: those of the path's poses, of F, or of the body, which
#: also turns by the free rotation.
Axes = Literal["path", "world", "body"]


@dataclass(frozen=True, eq=False)
class ToolPath:
    """A sequence of poses of the body frame M, with wrenches or directions.

    Attributes
    ----------
    poses : ndarray, shape (m, 4, 4)
        ``T_F_M`` of each point, or ``T_P_M`` in a workpiece frame P (see `moved`).
    wrenches : ndarray, shape (m, 6), or None
        (moment, force) that the process exerts on the body, about the origin of M.
    directions : ndarray, shape (m, 3), or None
        Directions along which the stiffness is read; of any length but zero.
    axes : {"path", "world", "body"}
        Axes of wrenches and directions.

    Raises
    ------
    InputError
        For wrong shapes, numbers that are not finite, or poses that are no rigid motions.
    """

    poses: Array
    wrenches: Array | None = None
    directions: Array | None = None
    axes: Axes = "path"

    def __post_init__(self) -> None:
        check_name("axes", self.axes, get_args(Axes))
        poses = checked_array(self.poses, ("m", 4, 4), "path")
        for index, T in enumerate(poses):
            if not is_pose(T):
                raise InputError(
                    f"pose {index + 1} of the path is not a rigid motion", got=T.tolist()
                )
        object.__setattr__(self, "poses", read_only(poses))
        for name, width in (("wrenches", 6), ("directions", 3)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _rows(value, len(poses), width, name))
        if self.directions is not None and not self.directions.any(axis=1).all():
            raise InputError("a direction of the path is zero")

    @classmethod
    def from_axes(
        cls,
        positions: ArrayLike,
        tool_axes: ArrayLike,
        axis: Literal["x", "y", "z"] = "z",
        *,
        wrenches: ArrayLike | None = None,
        directions: ArrayLike | None = None,
        axes: Axes | None = None,
    ) -> ToolPath:
        """Make a path of positions (m, 3) and directions of the tool's axis, `tool_axes`
        (m, 3) or (3,), in F.

        The first pose is turned from F by the smallest angle that aligns the axis, and
        each later pose from the previous one. `axes` are those of wrenches and
        directions, "world" or "body". They are needed unless all of these are along the
        tool's axis: the other two axes of the poses are chosen here, and nobody can know
        them before.

        Raises
        ------
        InputError
            For wrong shapes, a direction that is zero, or loads along axes that are not
            known.
        """
        check_name("axis", axis, ("x", "y", "z"))
        p = checked_array(positions, ("N", 3), "array of positions")
        # Directions of length one.
        u = _rows(tool_axes, len(p), 3, "tool axes")
        size = np.linalg.norm(u, axis=1)
        if not np.all(size > 0):
            raise InputError("a tool axis is zero", got=u[np.argmin(size)].tolist())
        u = u / size[:, None]
        # Each rotation is the last one with the least turn: the tool does not spin along
        # the path.
        own = np.eye(3)["xyz".index(axis)]
        rotations, R = [], np.eye(3)
        for direction in u:
            R = _least_turn(R @ own, direction) @ R
            rotations.append(R)
        path = cls(se3.pose(np.array(rotations), p), wrenches, directions, axes or "path")  # type: ignore[arg-type]
        # Which way the other two axes look is nobody's choice: vectors along them mean
        # nothing.
        if path.axes == "path":
            across = ~own.astype(bool)
            for name, rows in (
                ("wrenches", path.wrenches),
                ("directions", path.directions),
            ):
                if rows is not None and rows.reshape(-1, 3)[:, across].any():
                    raise InputError(
                        f"the axes of the {name} are not known: a path by the tool's "
                        "axis alone defines no others",
                        expected="axes world or body (--world, --axes, columns such as "
                        "fx_world), or poses with roll, pitch, yaw",
                    )
        return path

    def __len__(self) -> int:
        return len(self.poses)

    def moved(self, T_F_P: ArrayLike) -> ToolPath:
        """The path of a workpiece placed at ``T_F_P``; world axes stay world axes.

        Raises
        ------
        InputError
            If ``T_F_P`` is no pose.
        """
        return replace(self, poses=checked_pose(T_F_P, "T_F_P") @ self.poses)

    @property
    def turns_with_body(self) -> bool:
        """Whether loads and directions are given in the axes of the body."""
        return self.axes == "body"

    def wrench(self, point: int) -> Array | None:
        """The wrench (6,) at a point, components in F, or in M where it turns with the
        body.
        """
        return self._at(self.wrenches, point)

    def wrenches_in_body(
        self, points: Array, poses: Array, at: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Array:
        """Return the wrenches (N, 6) of points (N,), components in M at poses (N, 4, 4).

        `at` is the point of the body at which they act; default M's origin.
        """
        wrenches = np.array([self.wrench(i) for i in range(len(self))])[points]
        return wrench_in_body(
            wrenches, poses, at, "body" if self.turns_with_body else "world"
        )

    def direction(self, point: int) -> Array | None:
        """Return the direction (3,) at a point, components in F, or in M if it turns with
        the body.
        """
        return self._at(self.directions, point)

    def _at(self, rows: Array | None, point: int) -> Array | None:
        if rows is None or self.axes != "path":
            return None if rows is None else rows[point]
        turned: Array = rows[point].reshape(-1, 3) @ self.poses[point, :3, :3].T
        return turned.ravel()


def _rows(value: ArrayLike, m: int, width: int, what: str) -> Array:
    rows = checked_array(value, [(width,), (m, width)], f"array of {what}")
    return read_only(np.broadcast_to(rows, (m, width)))


def _least_turn(a: Array, b: Array) -> Array:
    """Return the rotation by the smallest angle that takes one unit vector to another."""
    axis = np.cross(a, b)
    sine, cosine = numerics.norm(axis), float(a @ b)
    angle = np.arctan2(sine, cosine)
    if sine < numerics.ROUNDOFF:  # equal or opposite: half a turn about any normal axis
        axis = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        sine = numerics.norm(axis)
    turn: Array = se3.exp(np.concatenate([axis / sine * angle, np.zeros(3)]))[:3, :3]
    return turn
