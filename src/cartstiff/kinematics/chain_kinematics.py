r"""Poses and Jacobians of many postures at once, for solvers that ask for them again and again.

A chain of joints with constant axes is a product of exponentials of the joints' screws at q = 0,

    T_F_M(q) = exp(S_1 q_1) ... exp(S_n q_n) T_F_M(0),    S_i = Ad(T_F_M(0)) J_i(0)

in the coordinates' order, because a joint stands after those it is carried by, and one that does
not carry the body has S = 0 [MLS]_. In a frame whose third axis is the joint's the exponential
mixes two columns only: the product is one of such motions and of constant ones between them.
Mechanisms of any other kind are asked posture by posture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Mechanism


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
            screws = (se3.adjoint(at_zero.pose) @ at_zero.motion.jacobian).T
            frames, self._turns, self._slides = _axis_frames(screws)
            placed = np.concatenate([np.eye(4)[None], frames, at_zero.pose[None]])
            self._between = se3.inverse(placed[:-1]) @ placed[1:]
            # Rounding of what is zero would be work.
            self._between[np.abs(self._between) < numerics.STILL] = 0.0

    def at(self, q: Array) -> ManyPoses:
        """Kinematics at coordinates (N, n)."""
        return self._product(q) if self.is_product else self._one_by_one(q)

    def _one_by_one(self, q: Array) -> ManyPoses:
        postures = [self.mechanism.at(row) for row in q]
        pose = np.array([p.pose for p in postures]).reshape(-1, 4, 4)
        jacobian = np.array([p.motion.jacobian for p in postures]).reshape(len(q), 6, self.n)
        closures = getattr(self.mechanism, "closures", ())
        if not postures or not closures:
            return ManyPoses(
                pose, jacobian, np.empty((len(q), 0)), np.empty((len(q), 0, jacobian.shape[2]))
            )
        # Rigid joints, whose rows come last, go where they are told.
        m = sum(c.rows.stop - c.rows.start for c in closures)
        residual = np.array([p.residual[:m] for p in postures if p.residual is not None])
        closure = np.array([p.closure.jacobian[:m] for p in postures if p.closure is not None])
        return ManyPoses(pose, jacobian, residual, closure)

    def _product(self, q: Array) -> ManyPoses:
        # Numbers of one kind side by side, for whole arrays at a time: columns of R are (3, N).
        count, n = q.shape
        sines, cosines = np.ascontiguousarray(np.sin(q).T), np.ascontiguousarray(np.cos(q).T)
        axes, places = np.empty((3, n, count)), np.empty((3, n, count))
        R, p = list(np.repeat(np.eye(3)[:, :, None], count, axis=2)), np.zeros((3, count))
        for j in range(n):
            R, p = _moved(R, p, self._between[j])
            x, y, z = R
            if self._slides[j]:
                p = p + self._slides[j] * q[:, j] * z
            if self._turns[j]:
                R = [cosines[j] * x + sines[j] * y, cosines[j] * y - sines[j] * x, z]
            axes[:, j], places[:, j] = z, p
        R, p = _moved(R, p, self._between[n])
        omega = axes * self._turns[:, None]
        v = _cross(omega, p[:, None] - places) + axes * self._slides[:, None]
        T, jacobian = np.zeros((count, 4, 4)), np.empty((count, 6, n))
        T[:, :3, 3], T[:, 3, 3] = p.T, 1.0
        for i, (a, b, c) in enumerate(R):
            T[:, :3, i] = R[i].T
            jacobian[:, i] = (a * omega[0] + b * omega[1] + c * omega[2]).T
            jacobian[:, 3 + i] = (a * v[0] + b * v[1] + c * v[2]).T
        return ManyPoses(T, jacobian, np.empty((count, 0)), np.empty((count, 0, n)))


def _axis_frames(screws: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Frames (n, 4, 4) whose z axes are those of joints' screws (n, 6).

    With them, whether each joint turns about its axis, and how far it slides along.
    """
    omega, v = screws[:, :3], screws[:, 3:]
    # Axes are unit vectors or zero: anything else on the way is rounding.
    turns = np.linalg.norm(omega, axis=1) > 0.5
    along = np.where(turns[:, None], omega, v)
    size = np.linalg.norm(along, axis=1)
    size_or_1 = np.where(size > 0, size, 1.0)[:, None]
    z = np.where(size[:, None] > 0, along / size_or_1, (0.0, 0.0, 1.0))
    x = _cross(np.eye(3)[(np.argmax(np.abs(z), axis=1) + 1) % 3].T, z.T)
    x /= np.sqrt((x * x).sum(axis=0))
    points = np.where(turns[:, None], _cross(omega.T, v.T).T / size_or_1**2, 0.0)
    slides = np.where(turns, (v * z).sum(axis=1), size)
    slides[np.abs(slides) < numerics.LAST_DIGITS] = 0.0
    return se3.pose(np.stack([x, _cross(z.T, x), z.T]).T, points), turns, slides


def _moved(R: list[Array], p: Array, T: Array) -> tuple[list[Array], Array]:
    """Columns and places of ``(R, p) @ T``; what is zero in T costs nothing."""
    columns = [_sum(R, T[:3, i]) for i in range(3)]
    return columns, p + _sum(R, T[:3, 3]) if T[:3, 3].any() else p


def _sum(R: list[Array], weights: Array) -> Array:
    parts = [w * column for w, column in zip(weights.tolist(), R, strict=True) if w]
    total: Array = sum(parts[1:], parts[0])
    return total


def _cross(a: Array, b: Array) -> Array:
    """Cross products along the first axis."""
    return np.stack([a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)])
