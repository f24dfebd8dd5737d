"""A chain at a posture with all of its joints cut, so that each body moves by itself.

Its 6 N coordinates are the twists of the N bodies about F's origin along F's axes. The
gradient of an energy in them is what the energy exerts on each body, while its gradient
in the chain's own coordinates has only what the joints let through.
"""

from __future__ import annotations

from typing import Any, Protocol, cast

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.potentials.contract import Evaluation, SecondOrderMap


class Carried(Protocol):
    """A frame that a joint carries, or none."""

    @property
    def joint(self) -> int:
        """The joint, counted from 1; 0 for a frame fixed in F."""


class CutPosture:
    """A posture of a chain whose joints are cut, as potentials need it."""

    closure = None

    def __init__(self, chain: Any, posture: Any) -> None:
        self.chain, self.posture = chain, posture
        self.q, self.coordinate_lengths = posture.q, posture.coordinate_lengths
        self._count = 6 * chain.tree.model.nv

    def on_bodies(self, wrench: Array, at: Carried) -> Array:
        """Wrenches (N, 6) on the bodies, of one (6,) on a frame in its components."""
        found = np.zeros((self._count // 6, 6))
        if at.joint:
            to_b = se3.adjoint_of_inverse(self.posture.pose_at(at))
            found[at.joint - 1] = to_b.T @ wrench
        return found

    def relative(self, frame_a: str, frame_b: str) -> tuple[Array, SecondOrderMap]:
        """The pose ``T_a_b`` and its first derivative."""
        ends = self.chain.placement(frame_a), self.chain.placement(frame_b)
        T_F_a, T_F_b = (self.posture.pose_at(end) for end in ends)
        J, to_b = np.zeros((6, self._count)), se3.adjoint_of_inverse(T_F_b)
        for end, sign in zip(ends, (-1.0, 1.0), strict=True):
            if end.joint:
                J[:, 6 * end.joint - 6 : 6 * end.joint] += sign * to_b
        none = np.zeros((self._count, self._count))
        return se3.inverse(T_F_a) @ T_F_b, SecondOrderMap(J, lambda _: none)

    def pose_of_frame(self, name: str) -> Array:
        """Return the pose ``T_F_b`` of a frame."""
        return cast(Array, self.posture.pose_of_frame(name))

    def legs(self, anchors: Array, points: Array) -> None:
        """None are known."""

    def gravity(self, acceleration: Array) -> Evaluation:
        """The weights of the bodies; no energy."""
        masses, centres = self.chain.tree.masses()
        T = self.posture.joint_poses(range(1, len(masses) + 1))
        at = (T[:, :3, :3] @ centres[:, :, None])[:, :, 0] + T[:, :3, 3]
        weights = masses[:, None] * acceleration
        gradient = -np.hstack([np.cross(at, weights), weights]).ravel()
        return Evaluation(0.0, gradient, np.zeros((0, 0)))
