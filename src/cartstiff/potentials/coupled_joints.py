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

from cartstiff import numerics
from cartstiff.arrays import checked_array
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.potentials.contract import Evaluation, Named, Parts, Posture, Potential


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
        forces = self.stiffness * (self.factors @ posture.q - self.rest)
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


def balancing(
    coupled: Sequence[CoupledJointSprings],
    posture: Posture,
    gradient: Array,
    own: Array,
    every: bool,
) -> list[CoupledJointSprings]:
    """The springs with the rest positions that balance a gradient with joints
    and closures.

    Parameters
    ----------
    coupled : sequence of CoupledJointSprings
        All of a mechanism.
    posture, every
        As of `JointSprings.with_rest_balancing`.
    gradient, own : ndarray, shape (n,)
        What they, the springs of joints and the closures have to balance, and the
        stiffness of the springs of joints, see `least_forces`.
    """
    free = [term.rest_is_free(every) for term in coupled]
    for term, is_free in zip(coupled, free, strict=True):
        x = term.factors @ posture.q - term.rest
        known = np.where(is_free, 0.0, term.stiffness * x)
        gradient = gradient - term.factors.T @ known
    closure = posture.closure
    forces = least_forces(
        np.concatenate([term.factors[f] for term, f in zip(coupled, free, strict=True)]),
        np.concatenate(
            [term.stiffness[f] for term, f in zip(coupled, free, strict=True)]
        ),
        gradient,
        own,
        np.zeros((len(own), 0)) if closure is None else closure.jacobian.T,
        posture.coordinate_lengths,
    )
    found, start = list[CoupledJointSprings](), 0
    for term, is_free in zip(coupled, free, strict=True):
        each = np.full(len(is_free), np.nan)
        each[is_free] = forces[start : start + is_free.sum()]
        start += int(is_free.sum())
        found.append(term.with_forces(posture, each))
    return found


def least_forces(
    factors: Array,
    stiffness: Array,
    wanted: Array,
    own: Array,
    carried: Array,
    sizes: Array,
) -> Array:
    """Forces (m,) of coupled springs that balance a gradient together with joints
    and closures.

    Parameters
    ----------
    factors, stiffness : ndarray, shape (m, n) and (m,)
        The springs whose rest positions are chosen.
    wanted : ndarray, shape (n,)
        Gradient that these springs, the springs of joints and the closures have to
        balance.
    own : ndarray, shape (n,)
        Stiffness of the springs of joints whose rest positions are chosen as well; 0
        elsewhere.
    carried : ndarray, shape (n, c)
        Directions of the closures' forces.
    sizes : ndarray, shape (n,)
        Natural sizes of the coordinates.

    Returns
    -------
    ndarray, shape (m,)
        Of the forces that balance the coordinates without a spring of their own, those
        with the least energy in all chosen springs: springs that were free of force
        before the load share it so.
    """
    m, is_own = len(factors), own > 0.0
    both = np.concatenate([factors.T, carried], axis=1)
    held = (both * sizes[:, None])[~is_own]
    start = np.linalg.lstsq(held, (wanted * sizes)[~is_own], rcond=numerics.RANK)[0]
    _, values, Vt = np.linalg.svd(held, full_matrices=True)
    N = Vt[numerics.rank(values) :].T if values.size else np.eye(both.shape[1])
    soft = 1.0 / np.sqrt(own[is_own])
    rows = np.concatenate([both[is_own] * soft[:, None], np.eye(m, both.shape[1])])
    rows[len(soft) :] /= np.sqrt(stiffness)[:, None]
    right = np.concatenate([wanted[is_own] * soft, np.zeros(m)]) - rows @ start
    forces = start + N @ np.linalg.lstsq(rows @ N, right, rcond=numerics.RANK)[0]
    return np.asarray(forces[:m])
