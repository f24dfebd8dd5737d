"""The free choices at a point of a path: a turn about the tool's axis, a spare joint's position.

A *cell* is one value of each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.joint_poses import JointPoses
from cartstiff.kinematics.platform_poses import Free, PlatformPoses
from cartstiff.mechanisms.contract import named_values
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform

#: What finds postures at poses: for joints, or for platforms.
PathSolver = JointPoses | PlatformPoses
#: Joints that turn stay so near to a posture that is asked for (rad).
NEARBY = 0.5 * np.pi


@dataclass(frozen=True, eq=False)
class Choices:
    """The grid of free choices.

    Attributes
    ----------
    free : {"none", "x", "y", "z", "rotation"}
        Rotation left free.
    angles : ndarray (a,), or None
        Turns about the tool's axis from the path's own pose (rad).
    joint : int or None
        The joint whose position is chosen.
    positions : ndarray (b,), or None
        Its positions.
    dimension : int
        Dimension of the self-motions, all choices together.
    size : float
        Natural size of the joint's coordinate.
    """

    free: Free
    angles: Array | None
    joint: int | None
    positions: Array | None
    dimension: int
    size: float = 1.0

    @property
    def shape(self) -> tuple[int, int]:
        """Number of angles and of positions, 1 where there is no choice."""
        return _size(self.angles), _size(self.positions)

    @property
    def count(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    @property
    def is_grid(self) -> bool:
        """Whether the cells are values of every free choice, and a constant choice means one."""
        count = (self.angles is not None) + (self.positions is not None)
        return count == self.dimension > 0

    def at(self, cell: int) -> dict[str, float]:
        """The choices of a cell: "angle" and "position", as far as they exist."""
        a, b = divmod(cell, _size(self.positions))
        values = {}
        if self.angles is not None:
            values["angle"] = float(self.angles[a])
        if self.positions is not None:
            values["position"] = float(self.positions[b])
        return values

    @property
    def task(self) -> Free:
        """Rotation that is free in a cell."""
        return "none" if self.angles is not None else self.free

    def targets(self, pose: Array) -> Array:
        """Wanted poses (cells, 4, 4) at a point."""
        if self.angles is None:
            return np.broadcast_to(pose, (self.count, 4, 4))
        turned = _turned_about(pose, self.free, self.angles)
        return np.repeat(turned, _size(self.positions), axis=0)

    @property
    def position_spacing(self) -> float:
        """Distance of neighbouring positions, in natural sizes."""
        v = self.positions
        return 0.2 if v is None else float(v[1] - v[0]) / self.size

    @property
    def spacing(self) -> float:
        """Distance of neighbouring cells, the larger of both; in rad and natural sizes."""
        steps = [] if self.angles is None else [float(self.angles[1] - self.angles[0])]
        if self.positions is not None:
            steps.append(self.position_spacing)
        return max(steps, default=0.2)


def _size(values: Array | None) -> int:
    return 1 if values is None else len(values)


def _turned_about(poses: Array, axis: str, angle: Array) -> Array:
    """Poses turned about one of their own axes by angles, all broadcast together."""
    twist = np.zeros((*np.shape(angle), 6))
    twist[..., "xyz".index(axis)] = angle
    turned: Array = poses @ se3.exp(twist)
    return turned


def choices_of(
    solver: PathSolver, free: Free, redundant: str | None, samples: int, names: list[str]
) -> Choices:
    """The grid for a mechanism and a freedom.

    Raises
    ------
    InputError
        If a redundant joint is named where there is none to choose, or too few samples.
    """
    if samples < 3:
        raise InputError("too few samples of a free choice", expected="3 or more", got=samples)
    dimension, left = solver.redundancy(free), solver.redundancy("none")
    if redundant is not None and redundant not in names:
        raise UnknownNameError("joint", redundant, names)
    if redundant is not None and left < 1:
        raise InputError(f"no joint is left over here: {redundant!r} cannot be chosen")
    angles = positions = joint = None
    if free in ("x", "y", "z") and dimension > left:
        angles = -np.pi + 2 * np.pi * np.arange(samples) / samples
    if left > 0 and free != "rotation" and isinstance(solver, JointPoses):
        joint = _most_idle(solver) if redundant is None else names.index(redundant)
        low, high = (bound[joint] for bound in solver.region())
        if solver.periodic[joint]:
            positions = low + (high - low) * np.arange(samples) / samples
        else:
            positions = np.linspace(low, high, samples)
    size = 1.0 if joint is None else float(solver.sizes[joint])
    return Choices(free, angles, joint, positions, dimension, size)


def _most_idle(solver: JointPoses) -> int:
    """The joint that moves most with the self-motion, even where it moves little.

    Where a joint stands still while the others move, its position tells nothing about theirs.
    """
    q = solver.random_starts(200, np.random.default_rng(0))
    moving = solver.self_motions(q, "none", solver.redundancy("none")) / solver.sizes[:, None]
    least = np.quantile(np.linalg.norm(moving, axis=2), 0.1, axis=0)
    return int(np.argmax(np.round(least, 6)))


class Counter:
    """Counts the steps of a search for who wants to see them."""

    def __init__(self, progress: Callable[[int, int], None] | None, total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def __call__(self) -> None:
        """One step more."""
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)


def path_solver(
    elastic: ElasticMechanism,
    ranges: Mapping[str, tuple[float, float]] | None,
    near: Mapping[str, float] | ArrayLike | None,
) -> PathSolver:
    """What finds postures, within the ranges that were asked for."""
    if isinstance(elastic.mechanism, Platform):
        if ranges or near is not None:
            raise InputError(
                "ranges and a posture nearby are for joints",
                got="a platform, whose pose the path says",
            )
        return PlatformPoses(elastic)
    solver = JointPoses(elastic)
    if ranges:
        solver = solver.narrowed(ranges)
    if near is not None:
        q = named_values(near, elastic.names, elastic.q, "posture nearby")
        turning = [
            (c.name, float(x))
            for c, x in zip(elastic.mechanism.coordinates, q, strict=True)
            if not c.is_length
        ]
        solver = solver.narrowed(
            {name: (x - NEARBY, x + NEARBY) for name, x in turning}, "neighbourhood"
        )
    return solver
