r"""Poses and Jacobians of many postures at once, for solvers that ask for them again and again.

A chain of joints with constant axes is a product of exponentials of the joints' screws at q = 0,

    T_F_M(q) = exp(S_1 q_1) ... exp(S_n q_n) T_F_M(0),    S_i = Ad(T_F_M(0)) J_i(0)

in the coordinates' order, because a joint stands after those it is carried by, and one that does
not carry the body has S = 0 [MLS]_. Mechanisms of any other kind are asked posture by posture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Mechanism

__all__ = ["Kinematics", "ManyPoses"]


class ManyPoses(NamedTuple):
    """Kinematics of N postures: pose (N, 4, 4), body Jacobian (N, 6, n), closures (N, m) and rates.

    Without closures m = 0.
    """

    pose: Array
    jacobian: Array
    residual: Array
    closure: Array


class Kinematics:
    """Kinematics of one mechanism, prepared for many postures.

    Parameters
    ----------
    mechanism : Mechanism
        Any kind whose coordinates are those of joints.

    Attributes
    ----------
    n : int
        Number of coordinates.
    is_product : bool
        Whether the formula above holds; else postures are evaluated one by one.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.n = len(mechanism.coordinates)
        self.is_product = (
            isinstance(mechanism, Chain) and not mechanism.closures and mechanism.tree.mimic is None
        )
        if self.is_product:
            at_zero = mechanism.at(np.zeros(self.n))
            self._T_0 = at_zero.pose
            screws = (se3.adjoint(at_zero.pose) @ at_zero.motion.jacobian).T
            self._omega = np.ascontiguousarray(screws[:, :3])
            self._v = np.ascontiguousarray(screws[:, 3:])
            # Axes are unit vectors or zero: anything else on the way is rounding.
            turning = np.linalg.norm(self._omega, axis=1) > 0.5
            self._omega[~turning] = 0.0
            self._hat = se3.skew(self._omega)
            self._hat2 = self._hat @ self._hat
            self._hat_v = (self._hat @ self._v[..., None])[..., 0]
            self._hat2_v = (self._hat2 @ self._v[..., None])[..., 0]

    def at(self, q: Array) -> ManyPoses:
        """Kinematics at coordinates (N, n)."""
        return self._product(q) if self.is_product else self._one_by_one(q)

    def _one_by_one(self, q: Array) -> ManyPoses:
        postures = [self.mechanism.at(row) for row in q]
        pose = np.array([p.pose for p in postures]).reshape(-1, 4, 4)
        jacobian = np.array([p.motion.jacobian for p in postures]).reshape(len(q), 6, self.n)
        if not postures or postures[0].closure is None:
            return ManyPoses(
                pose, jacobian, np.empty((len(q), 0)), np.empty((len(q), 0, jacobian.shape[2]))
            )
        residual = np.array([p.residual for p in postures])
        closure = np.array([p.closure.jacobian for p in postures if p.closure is not None])
        return ManyPoses(pose, jacobian, residual, closure)

    def _product(self, q: Array) -> ManyPoses:
        count, n = q.shape
        # exp of each joint's screw: sums of 1, sin q, 1 - cos q with constant matrices.
        sine, versine = np.sin(q), 2.0 * np.sin(0.5 * q) ** 2
        rotations = (
            np.eye(3) + sine[..., None, None] * self._hat + versine[..., None, None] * self._hat2
        )
        shifts = (
            q[..., None] * self._v
            + versine[..., None] * self._hat_v
            + (q - sine)[..., None] * self._hat2_v
        )
        R = np.broadcast_to(np.eye(3), (count, 3, 3))
        p = np.zeros((count, 3))
        columns = np.empty((count, 6, n))
        for j in range(n):
            omega = R @ self._omega[j]
            columns[:, :3, j] = omega
            columns[:, 3:, j] = R @ self._v[j] + _cross(p, omega)
            p = p + (R @ shifts[:, j, :, None])[..., 0]
            R = R @ rotations[:, j]
        T = se3.pose(R, p) @ self._T_0
        jacobian = se3.adjoint_of_inverse(T) @ columns
        return ManyPoses(T, jacobian, np.empty((count, 0)), np.empty((count, 0, n)))


_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


def _cross(a: Array, b: Array) -> Array:
    """Cross products of rows; on few rows several times as fast as NumPy's own."""
    product: Array = a[:, _NEXT] * b[:, _AFTER] - a[:, _AFTER] * b[:, _NEXT]
    return product
