"""The posture nearest to a wanted pose that is reached from the present one,
as for dragging.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.limits import Limits
from cartstiff.kinematics.joint_poses import Free, JointPoses, pose_errors

# Halvings of the distance to a pose that a platform's legs do not reach.
_HALVINGS = 12


@dataclass(frozen=True, eq=False)
class Followed(Result):
    """Posture of a mechanism that has followed a wanted pose.

    Attributes
    ----------
    q : ndarray (n,)
        Coordinates; those of a closed chain are assembled.
    distance, angle : float
        Remaining errors of the pose: of the origin of M, and of its rotation [rad].
    reached : bool
        Whether both are zero.
    stopped : tuple of str
        Joints or legs at a limit, if the pose is not reached.
    """

    q: Array
    distance: float
    angle: float
    reached: bool
    stopped: tuple[str, ...]


class Follower:
    """Follows wanted poses of M with one mechanism, step by step from the posture before.

    Parameters
    ----------
    elastic : ElasticMechanism
        A chain, closed or not, or a platform.
    """

    def __init__(self, elastic: ElasticMechanism) -> None:
        self._elastic = elastic
        self._mechanism = elastic.mechanism
        self._limits = Limits(self._mechanism)

    @cached_property
    def _solver(self) -> JointPoses:
        return JointPoses(self._elastic)

    @cached_property
    def _deficient(self) -> bool:
        return self._solver.rank("none") < 6

    def follow(self, q: Array, T_wanted: Array, turning: bool = True) -> Followed:
        """Move from coordinates q (n,) towards a pose (4, 4) of M.

        Beyond reach, arms end at the least error; so do arms of fewer than six freedoms,
        which without `turning` follow the position of M alone. A platform stops on the
        screw motion to the pose as soon as a leg reaches its limit.

        Raises
        ------
        InputError
            For a mechanism that is neither.
        CartstiffError
            If a closed chain does not assemble.
        """
        stopped: tuple[str, ...]
        if self._mechanism.coordinates_are_pose:
            coordinates, stopped = self._platform(q, T_wanted)
        else:
            coordinates = self._joints(q, T_wanted, turning)
            stopped = self._beyond(coordinates, np.eye(4), numerics.NEGLIGIBLE_DISTANCE)
        posture = self._mechanism.at(coordinates)
        e = pose_errors(posture.pose[None], T_wanted[None], "none", 1.0)[0]
        distance, angle = numerics.norm(e[3:]), numerics.norm(e[:3])
        reached = max(distance / posture.length, angle) <= numerics.NEGLIGIBLE_DISTANCE
        return Followed(coordinates, distance, angle, reached, () if reached else stopped)

    def _joints(self, q: Array, T: Array, turning: bool) -> Array:
        free: Free = "rotation" if not turning and self._deficient else "none"
        q_new: Array = self._solver.solve(T[None], q[None], free)[0][0]
        if self._mechanism.closures:
            q_new = np.array(self._mechanism.closed(q_new).q)
        return q_new

    def _platform(self, q: Array, T: Array) -> tuple[Array, tuple[str, ...]]:
        platform = self._mechanism

        def near(pose: Array) -> Array:
            """Coordinates of a pose, its angles on the turn of q."""
            coordinates = np.array(platform.coordinates_of(pose))
            coordinates[3:] -= (
                2 * np.pi * np.round((coordinates[3:] - q[3:]) / (2 * np.pi))
            )
            return coordinates

        start = platform.at(q).pose
        best, stopped = near(T), self._beyond(q, start, 0.0)
        if stopped:  # from beyond a limit it may return
            return best, stopped
        stopped = self._beyond(best, T, 0.0)
        if not stopped:
            return best, ()
        step = se3.log(se3.inverse(start) @ T)
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            pose = start @ se3.exp(middle * step)
            beyond = self._beyond(near(pose), pose, 0.0)
            if beyond:
                high, stopped = middle, beyond
            else:
                low = middle
        return near(start @ se3.exp(low * step)), stopped

    def _beyond(self, q: Array, T: Array, near: float) -> tuple[str, ...]:
        """Joints or legs that are beyond a limit, or within a distance `near` of it."""
        limits = self._limits
        values = limits.values(q, T)
        at = (values < limits.lower + near) | (values > limits.upper - near)
        return tuple(name for name, is_at in zip(limits.names, at, strict=True) if is_at)
