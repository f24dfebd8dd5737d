"""A mechanism at some coordinates, with everything that acts there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.potentials.contract import Evaluation


@dataclass(slots=True, eq=False)
class Point:
    """The mechanism at coordinates q, with all forces that act there.

    Attributes
    ----------
    energies : float
        Sum of the terms' absolute energies.
    forces : ndarray (n,)
        Sum of the absolute generalised forces of the terms' members, in natural units.
    hardness : ndarray (n, n)
        Sum of the terms' absolute stiffnesses, in natural units.
    """

    q: Array
    posture: MechanismPosture
    evaluation: Evaluation
    energies: float
    forces: Array
    hardness: Array
    limited: Array

    @property
    def stiffness_ratio(self) -> float:
        """Largest over smallest stiffness of the coordinates that feel one."""
        stiff = np.diag(self.hardness)
        return float(stiff.max(initial=0.0)) / float(stiff.min(initial=np.inf, where=stiff > 0.0))

    def add(self, term: Evaluation, members: Array) -> None:
        """One more term that acts here, with the absolute forces (n,) of its members."""
        e, g, h = self.evaluation
        self.evaluation = Evaluation(e + term.energy, g + term.gradient, h + term.hessian)
        columns = self.posture.coordinate_lengths
        self.energies += abs(term.energy)
        self.forces += members * columns
        self.hardness += np.abs(term.hessian * columns[:, None] * columns)
