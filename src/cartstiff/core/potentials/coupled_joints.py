r"""Springs that couple joints: each on a sum of coordinates,
as a tendon or a differential has it.

Energy Phi = 1/2 sum_i k_i (c_i . q - r_i)^2 with factors c_i of the coordinates and rest
positions r_i of the sums; MuJoCo calls such a spring a fixed tendon.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from cartstiff.core.arrays import Array, checked_array
from cartstiff.core.errors import InputError
from cartstiff.core.lazily import cached_property
from cartstiff.core.potentials.contract import (
    Evaluation,
    Named,
    Parts,
    Posture,
    Potential,
    Sums,
)


@dataclass(frozen=True, eq=False)
class CoupledJointSprings(Potential):
    """Springs on sums of coordinates.

    Attributes
    ----------
    factors : ndarray, shape (m, n)
        Factors c of the coordinates in the sum of each spring.
    stiffness : ndarray, shape (m,)
        Force (in the sum's unit: of angles N m/rad, of lengths N/m) per change of the
        sum.
    rest : ndarray, shape (m,)
        Rest positions of the sums; NaN where they are to be chosen so that the springs
        balance the load at the posture.
    names : tuple of str
        Names for people.
    """

    factors: Array
    stiffness: Array
    rest: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in ("factors", "stiffness", "rest"):
            array = checked_array(getattr(self, name), None, name, finite=name != "rest")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        m = len(self.names)
        if self.factors.shape[:1] != (m,) or self.factors.ndim != 2:
            raise InputError(
                "one row of factors for each coupled spring", expected=f"{m} rows"
            )
        if self.stiffness.shape != (m,) or self.rest.shape != (m,):
            what = "one stiffness and rest position for each coupled spring"
            raise InputError(what, expected=f"{m} of both")
        if np.any(self.stiffness <= 0.0):
            raise InputError("stiffness of a coupled spring must be above zero")

    @cached_property
    def sums(self) -> Sums:  # type: ignore[override]
        """The sums."""
        return Sums(self.names, self.factors, self.stiffness, self.rest)

    def labels(self, first: int) -> tuple[str, ...]:  # noqa: ARG002
        """The names."""
        return self.names

    def parts(
        self, posture: Posture, coordinates: Sequence[Named], names: Sequence[str]
    ) -> Parts:
        """The sums."""
        slides = [
            all(c.is_length for c, f in zip(coordinates, row, strict=True) if f)
            for row in self.factors
        ]
        forces = self.sums.forces(posture.q)
        return Parts(names, slides, self.factors, np.diag(self.stiffness), forces)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian."""
        x = self.factors @ posture.q - self.rest
        forces = self.stiffness * x
        hessian = self.factors.T @ (self.stiffness[:, None] * self.factors)
        return Evaluation(0.5 * float(forces @ x), self.factors.T @ forces, hessian)

    def member_forces(self, posture: Posture, gradient: Array) -> Array:  # noqa: ARG002
        """Sum (n,) of the absolute generalised forces of the springs."""
        x = self.factors @ posture.q - self.rest
        return np.abs(self.factors).T @ np.abs(self.stiffness * x)

    def in_units(self, a: float, sizes: Array, efforts: Array) -> Self:  # noqa: ARG002
        """The same springs in other units: a sum of slides alone is a length,
        any other none.
        """
        slides = ~np.any((self.factors != 0.0) & (sizes == 1.0), axis=1) & (a != 1.0)
        own = np.where(slides, a, 1.0)
        return replace(
            self,
            factors=self.factors * own[:, None] / sizes,
            stiffness=self.stiffness * a / own**2,
            rest=self.rest * own,
        )

    def rest_is_free(self, every: bool = False) -> Array:
        """Rest positions to be chosen (m,): those not given, or all."""
        return np.isnan(self.rest) | every

    def with_open_rest(self) -> CoupledJointSprings:
        """The same springs, all of whose rest positions are to be chosen."""
        return replace(self, rest=self.rest + np.nan)

    def with_forces(self, posture: Posture, forces: Array) -> CoupledJointSprings:
        """The same springs with rest positions at which they exert forces (m,)
        at a posture.

        Where a force is NaN the rest position stays.
        """
        rest = self.factors @ posture.q - forces / self.stiffness
        return replace(self, rest=np.where(np.isnan(forces), self.rest, rest))
