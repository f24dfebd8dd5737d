"""Masses of a platform's legs on recording numbers: the formulas of `mechanisms.struts`.

Of a leg with line g = (b x u, u), length L, weights per kg w in M, ``P = 1 - u u^T`` and
D = [-[b]x, 1], which turns a body twist into the velocity of b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import congruence, skew, zeros
from cartstiff.many.chains.chain_twists import numbers
from cartstiff.many.tape import Scalar
from cartstiff.mechanisms.platform import Struts


@dataclass(frozen=True)
class LegMasses:
    """Masses of m legs as plain numbers; a key.

    Attributes
    ----------
    fixed, moving, fixed_com, moving_com : as of `Struts`.
    turning : moments of inertia of both bars of a leg about their own centres, across the line.
    """

    fixed: tuple[float, ...]
    moving: tuple[float, ...]
    fixed_com: tuple[float, ...]
    moving_com: tuple[float, ...]
    turning: tuple[float, ...]

    @staticmethod
    def of(struts: Struts) -> LegMasses:
        """Those of a platform's legs."""
        turning = sum(struts.turning_moments)
        return LegMasses(
            *map(
                numbers,
                (
                    struts.fixed,
                    struts.moving,
                    struts.fixed_com,
                    struts.moving_com,
                    np.asarray(turning),
                ),
            )
        )

    def weighed(
        self, points: Array, u: Array, lengths: Array, weight: Array
    ) -> tuple[Scalar, Array, Array]:
        """Energy but for what the pose of M adds, gradient and Hessian along body twists.

        Points (m, 3), directions (m, 3) and the weight (3,) per kg are in M; the energy is that in
        a frame F whose origin is M's.
        """
        energy: Scalar = 0.0
        gradient, hessian = zeros(6), zeros(6, 6)
        for k, (b, d) in enumerate(zip(points, u, strict=True)):
            fixed, moving = self.fixed[k], self.moving[k]
            share = fixed * self.fixed_com[k] - moving * self.moving_com[k]
            along = d @ weight
            across = weight - d * along
            per = 1.0 / lengths[k]
            energy = energy - (b @ weight) * (fixed + moving)
            energy = energy - along * (share - lengths[k] * fixed)
            _, alpha, H = dead_force(weight * moving + across * (share * per), b)
            gradient, hessian = gradient + alpha, hessian + H
            P = np.eye(3) - np.outer(d, d)
            second = (np.outer(d, across) + np.outer(across, d) + P * along) * (share * per * per)
            hessian = hessian + congruence(_velocity(b), second)
        return energy, gradient, hessian

    def kinetic(self, points: Array, lines: Array, lengths: Array) -> Array:
        """Masses' matrix (6, 6) on body twists."""
        total = zeros(6, 6)
        for k, (b, line, L) in enumerate(zip(points, lines, lengths, strict=True)):
            per = 1.0 / L
            beyond = 1.0 - per * self.moving_com[k]
            across = beyond * beyond * self.moving[k]
            own = self.fixed[k] * self.fixed_com[k] ** 2 + self.turning[k]
            across = across + per * per * own
            D = _velocity(b)
            total = total + np.outer(line, line) * (self.moving[k] - across)
            total = total + (D.T @ D) * across
        return total


def dead_force(force: Array, point: Array) -> tuple[Scalar, Array, Array]:
    """Energy, alpha and Hessian of a force constant in F, now along M's axes, at a point of M.

    The energy is that in a frame F whose origin is M's.
    """
    f = -force
    alpha = np.concatenate([skew(point) @ f, f])
    H = zeros(6, 6)
    H[:3, :3] = (np.outer(f, point) + np.outer(point, f)) * 0.5
    for i in range(3):
        H[i, i] = H[i, i] - f @ point
    H[3:, :3] = skew(f) * 0.5
    H[:3, 3:] = skew(f) * -0.5
    energy: Scalar = (f * point).sum()
    return energy, alpha, H


def _velocity(point: Array) -> Array:
    """Velocity of a point per body twist, (3, 6)."""
    velocity = zeros(3, 6)
    velocity[:, :3], velocity[:, 3:] = -skew(point), np.eye(3)
    return velocity
