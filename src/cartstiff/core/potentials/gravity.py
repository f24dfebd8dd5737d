"""Gravity on all masses of a mechanism."""

from __future__ import annotations

from dataclasses import dataclass

from cartstiff.core.arrays import Array
from cartstiff.core.potentials.contract import Evaluation, Posture, Potential


@dataclass(frozen=True, eq=False)
class Gravity(Potential):
    """Phi = -sum m_i g . c_i for a uniform acceleration g in F.

    Attributes
    ----------
    acceleration : ndarray (3,)
        For example (0, 0, -9.81) m/s^2.
    """

    is_external = True

    acceleration: Array

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian at a posture."""
        return posture.gravity(self.acceleration)
