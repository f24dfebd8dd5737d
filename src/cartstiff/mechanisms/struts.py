r"""Masses of a platform's legs: each a bar on the base's joint and a bar on the platform's joint.

The line from the base point a to the platform point b has length L and direction u; the platform
point moves with v, so that the line turns with ``u' = P v / L``, ``P = 1 - u u^T``. The bar on the
base has its centre at ``a + c_f u``, the one on the platform at ``b - c_m u``. Both are straight
cylinders from their joint to twice that distance, so that a turn of the line meets
``J = m (c^2 / 3 + r^2 / 4)`` about each centre; a spin about the line itself is left out, since
joints of platforms leave it open. Their kinetic energy is ``1/2 v^T A v`` with

    A = m_m u u^T + ( m_m (1 - c_m/L)^2 + (m_f c_f^2 + J_f + J_m) / L^2 ) P
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from cartstiff.arrays import checked_array
from cartstiff.errors import InputError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.potentials.contract import Evaluation
from cartstiff.potentials.line_springs import LineGeometry
from cartstiff.potentials.loads import DeadForce

if TYPE_CHECKING:
    from cartstiff.mechanisms.platform import PlatformPosture


@dataclass(frozen=True, eq=False)
class Struts:
    """Masses of m legs.

    Attributes
    ----------
    fixed, moving : ndarray (m,)
        Masses [kg] on the base's joint and on the platform's joint.
    fixed_com, moving_com : ndarray (m,)
        Distances of their centres from their own joints.
    radius : ndarray (m,)
        Radius of both; 0 for slender bars.

    Raises
    ------
    InputError
        For negative numbers or lengths that differ.
    """

    fixed: Array
    moving: Array
    fixed_com: Array
    moving_com: Array
    radius: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            value = checked_array(getattr(self, field.name), ("m",), f"legs' {field.name}")
            if value.shape != np.shape(self.fixed) or (value < 0.0).any():
                raise InputError(
                    f"legs' {field.name} cannot be used",
                    got=value.tolist(),
                    expected="one number from zero per leg",
                )
            value.flags.writeable = False
            object.__setattr__(self, field.name, value)

    @property
    def mass(self) -> float:
        """Of all legs [kg]."""
        return float(self.fixed.sum() + self.moving.sum())

    @property
    def turning_moments(self) -> tuple[Array, Array]:
        """Moments of inertia (m,) of the bars about their own centres, across the line."""
        about = [
            mass * (com * com / 3 + self.radius**2 / 4)
            for mass, com in ((self.fixed, self.fixed_com), (self.moving, self.moving_com))
        ]
        return about[0], about[1]

    def mass_matrix(self, lines: LineGeometry, points: Array) -> Array:
        """Their part (..., 6, 6) of the platform's mass matrix, on body twists."""
        L = lines.lengths
        fixed, moving = self.turning_moments
        across = self.moving * (1 - self.moving_com / L) ** 2
        across = across + (self.fixed * self.fixed_com**2 + fixed + moving) / L**2
        D = np.array([_velocity(point) for point in points])
        along = (lines.lines * (self.moving - across)[..., None]).swapaxes(-1, -2) @ lines.lines
        total: Array = along + np.tensordot(across, D.swapaxes(-1, -2) @ D, 1)
        return total

    def momentum(self, lines: LineGeometry, points: Array, pose: Array) -> Array:
        """Momentum (moment about F's origin, linear; axes of F) per body twist, (6, 6)."""
        R, p = pose[:3, :3], pose[:3, 3]
        total = np.zeros((6, 6))
        turning = self.turning_moments
        for k, point in enumerate(points):
            u, L = R @ lines.directions[k], lines.lengths[k]
            b = R @ point + p
            v = R @ _velocity(point)
            turn = (v - np.outer(u, u @ v)) / L  # of the direction
            spin = se3.skew(u) @ turn
            for mass, J, at, velocity in (
                (
                    self.fixed[k],
                    turning[0][k],
                    b + (self.fixed_com[k] - L) * u,
                    self.fixed_com[k] * turn,
                ),
                (
                    self.moving[k],
                    turning[1][k],
                    b - self.moving_com[k] * u,
                    v - self.moving_com[k] * turn,
                ),
            ):
                total[:3] += mass * se3.skew(at) @ velocity + J * spin
                total[3:] += mass * velocity
        return total

    def centre(self, lines: LineGeometry, points: Array, pose: Array) -> tuple[float, Array]:
        """Mass of the legs and the sum (3,) of mass times position in F."""
        u, b = lines.directions @ pose[:3, :3].T, points @ pose[:3, :3].T + pose[:3, 3]
        fixed = b + (self.fixed_com - lines.lengths)[:, None] * u
        moving = b - self.moving_com[:, None] * u
        return self.mass, self.fixed @ fixed + self.moving @ moving

    def gravity(self, posture: PlatformPosture, points: Array, weight: Array) -> Evaluation:
        """Energy of their weights, `weight` (3,) per kg in F, with derivatives on body twists."""
        R = posture.pose[:3, :3]
        lines = posture.lines
        _, first = self.centre(lines, points, posture.pose)
        gradient, hessian = np.zeros(6), np.zeros((6, 6))
        in_body = R.T @ weight
        share = self.fixed * self.fixed_com - self.moving * self.moving_com
        for k, point in enumerate(points):
            u, L = lines.directions[k], lines.lengths[k]
            across = in_body - (u @ in_body) * u
            force = self.moving[k] * in_body + share[k] / L * across
            held = DeadForce(R @ force, point).evaluate(posture)
            gradient += held.gradient
            # Along the motion of b the share of the weight that u carries changes as well.
            P = np.eye(3) - np.outer(u, u)
            second = np.outer(u, across) + np.outer(across, u) + (u @ in_body) * P
            D = _velocity(point)
            hessian += held.hessian + share[k] / L**2 * D.T @ second @ D
        return Evaluation(-float(weight @ first), gradient, hessian)


def _velocity(point: Array) -> Array:
    """Velocity of a point per body twist, (3, 6)."""
    return np.concatenate([-se3.skew(point), np.eye(3)], axis=1)
