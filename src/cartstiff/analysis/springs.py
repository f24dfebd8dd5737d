r"""Springs in parallel: line, screw and torsional springs as wrenches.

An unloaded spring contributes ``k w w^T`` to the stiffness, w = (m, f) its wrench per unit of load:
a line spring has f . m = 0, |f| = 1; a torsional spring f = 0, |m| = 1; a screw spring
m = r x f + h f with pitch h, |f| = 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartstiff.arrays import Result
from cartstiff.geometry.se3 import Array


@dataclass(frozen=True, eq=False)
class Spring(Result):
    """One spring of a parallel connection.

    Attributes
    ----------
    kind : {"line", "screw", "torsional"}
        Line: a force along a line. Screw: with a moment about the same line. Torsional: a moment.
    stiffness : float
        Positive; force per length, or moment per angle for a torsional spring.
    direction : ndarray, shape (3,)
        Unit vector of the force (of the moment, if torsional).
    point : ndarray, shape (3,)
        Point of the line nearest to the origin; zero for a torsional spring.
    pitch : float
        Moment over force; 0 for a line spring, infinite for a torsional one.
    """

    kind: Literal["line", "screw", "torsional"]
    stiffness: float
    direction: Array
    point: Array
    pitch: float

    @property
    def wrench(self) -> Array:
        """Wrench (moment, force) per unit of load, shape (6,)."""
        if self.kind == "torsional":
            return np.concatenate([self.direction, np.zeros(3)])
        moment = np.cross(self.point, self.direction) + self.pitch * self.direction
        return np.concatenate([moment, self.direction])


def parallel_stiffness(springs: Iterable[Spring]) -> Array:
    """Stiffness (6, 6) of unloaded springs in parallel: sum of k w w^T."""
    K = np.zeros((6, 6))
    for spring in springs:
        K += spring.stiffness * np.outer(spring.wrench, spring.wrench)
    return K
