"""Postures of a platform at poses: the pose is the coordinate, and the legs have limits."""

from __future__ import annotations

from typing import Literal

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.chain_kinematics import Kinematics
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.limits import Limits
from cartstiff.mechanisms.platform import Platform

#: What of the body's rotation is left free: nothing, the turn about one of its axes, or all of it.
Free = Literal["none", "x", "y", "z", "rotation"]


class PlatformPoses:
    """What `cartstiff.kinematics.joint_poses.JointPoses` is for joints, for a platform.

    Parameters
    ----------
    elastic : ElasticMechanism
        A platform; its coordinates are x, y, z, roll, pitch, yaw.
    limits : bool
        Whether the legs' limits hold.
    """

    def __init__(self, elastic: ElasticMechanism, limits: bool = True) -> None:
        if not isinstance(elastic.mechanism, Platform):
            raise InputError("not a platform", got=elastic.mechanism.kind)
        self.platform = elastic.mechanism
        self.kinematics = Kinematics(self.platform)
        self.length = self.platform.length
        self.sizes = np.array([self.length] * 3 + [1.0] * 3)
        self.start = np.array(elastic.q, float)
        self.lower, self.upper = np.full(6, -np.inf), np.full(6, np.inf)
        self.movable = np.ones(len(self.platform.points), bool)  # columns of its Jacobian: legs
        self.periodic = np.array([False] * 3 + [True] * 3)
        self.limits = Limits(self.platform, ignore=not limits)

    def region(self) -> tuple[Array, Array]:
        """No bounds."""
        return self.lower, self.upper

    def random_starts(self, count: int, rng: np.random.Generator) -> Array:  # noqa: ARG002
        """None: a pose has one posture, whatever the start."""
        return np.empty((0, 6))

    def within(self, q: Array) -> Array:
        """Coordinates as they are."""
        return q

    def solve(
        self,
        T_wanted: Array,
        starts: Array,
        free: Free = "none",
        tolerance: float = 0.0,  # noqa: ARG002
        held: Array | None = None,  # noqa: ARG002
    ) -> tuple[Array, Array]:
        """Coordinates (N, 6) at poses (N, 4, 4), and which of them the legs' limits allow.

        Where a turn is free, the one nearest to the start's.
        """
        poses = np.array(T_wanted)
        if free != "none":
            axis = "xyz".index(free)
            for i, q in enumerate(starts):
                turn = poses[i, :3, :3].T @ self.platform.pose_of(q)[:3, :3]
                angle = _turn_about(turn, axis)
                poses[i] = poses[i] @ se3.exp(angle * se3.basis_twist(axis))
        q = np.array([self.platform.coordinates_of(T) for T in poses]).reshape(-1, 6)
        return q, np.array([self._excess(row)[1] <= 0.0 for row in q], bool)

    def _excess(self, q: Array) -> tuple[int, float]:
        """Number of the limit that is broken most, and by how much."""
        if not len(self.limits):
            return 0, 0.0
        beyond = self.limits.excess(self.limits.values(q, self.platform.pose_of(q)))
        worst = int(np.argmax(beyond))
        return worst, float(beyond[worst])

    def beyond_limits(self, poses: Array, free: Free) -> tuple[str, float] | None:
        """The leg that is beyond its limits most, at the pose where that is least."""
        starts = np.tile(self.start, (len(poses), 1))
        worst = [self._excess(q) for q in self.solve(poses, starts, free)[0]]
        limit, amount = min(worst, key=lambda excess: excess[1])
        return self.limits.names[limit], amount

    def self_motions(self, q: Array, free: Free, dimension: int) -> Array:
        """Changes of the coordinates (N, 6, d) with the free turn, to first order."""
        motions = np.zeros((len(q), 6, dimension))
        if dimension:
            step = numerics.WIDE_DIFFERENCE * se3.basis_twist("xyz".index(free))
            for i, row in enumerate(q):
                change = self.platform.moved(row, step) - row
                motions[i, :, 0] = change - 2 * np.pi * np.round(change / (2 * np.pi))
        return motions / numerics.WIDE_DIFFERENCE

    def rank(self, free: Free) -> int:
        """Number of conditions that the legs fulfil independently."""
        return 6 - self.redundancy(free)

    def redundancy(self, free: Free) -> int:
        """Dimension of the motions that are left free."""
        if free == "rotation":
            raise InputError("a platform's rotation cannot all be free", expected="x, y or z")
        return 0 if free == "none" else 1


def _turn_about(R: Array, axis: int) -> float:
    """Angle of the rotation about an axis that is nearest to R."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    return float(np.arctan2(R[k, j] - R[j, k], R[j, j] + R[k, k]))
