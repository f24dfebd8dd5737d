r"""Springs in the joints: linear, or with any torque-deflection law.

Energy Phi = sum_j U_j(q_j - r_j) with rest positions r; torque U_j', stiffness U_j''.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_array, read_only
from cartstiff.core.errors import InputError
from cartstiff.core.lazily import cached_property
from cartstiff.core.potentials.contract import Evaluation, Number, Posture, key_of_law
from cartstiff.core.potentials.spring_laws import PolynomialLaw
from cartstiff.core.potentials.springs import Chosen, SpringLaw, Springs

# Share of a coefficient between which a difference is taken.
_COEFFICIENT_STEP = 2.0**-12


@dataclass(frozen=True, eq=False)
class JointSprings(Springs):
    """One spring per coordinate.

    Attributes
    ----------
    stiffness : ndarray, shape (n,)
        N m/rad (N/m for a prismatic joint); 0 for a joint without a spring. Not used for
        a joint with a nonlinear law.
    rest : ndarray, shape (n,)
        Rest positions; NaN where they are to be chosen so that the springs balance the
        load at the posture.
    laws : mapping of int to SpringLaw
        Nonlinear springs by coordinate index.
    rigid : frozenset of int
        Coordinates with infinite stiffness. They store no energy, and `stiffness` is 0
        there; the mechanism does not move them.

    Raises
    ------
    InputError
        For arrays of different length, a negative stiffness, or a rest position of a
        rigid joint.
    """

    stiffness: Array
    rest: Array
    laws: Mapping[int, SpringLaw] = field(default_factory=dict)
    rigid: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        k = checked_array(self.stiffness, None, "joint stiffness", finite=False)
        r = checked_array(self.rest, None, "rest position", finite=False)
        if k.ndim != 1 or k.shape != r.shape:
            raise InputError(
                "joint stiffnesses and rest positions differ in number",
                expected=f"{k.shape}",
                got=f"{r.shape}",
            )
        if np.isnan(k).any() or np.any(k < 0):
            raise InputError("joint stiffness must be a number from zero", got=k.tolist())
        rigid = self.rigid | frozenset(np.flatnonzero(np.isinf(k)).tolist())
        if any(np.isfinite(r[j]) and np.isinf(k[j]) for j in rigid):
            raise InputError(
                "a rigid joint stays where it is", expected="no rest position for it"
            )
        k[list(rigid)], r[list(rigid)] = 0.0, 0.0
        object.__setattr__(self, "rigid", rigid)
        passive = k == 0.0
        passive[list(self.laws)] = False
        r[passive & np.isnan(r)] = 0.0  # a joint without a spring is at rest anywhere
        k.flags.writeable = r.flags.writeable = False
        object.__setattr__(self, "stiffness", k)
        object.__setattr__(self, "rest", r)

    @cached_property
    def is_complete(self) -> bool:
        """Whether every spring has a rest position."""
        return not np.any(np.isnan(self.rest))

    @cached_property
    def is_passive(self) -> Array:
        """Whether each joint has no spring (n,)."""
        passive = self.stiffness == 0.0
        passive[list(self.laws)] = False
        passive.flags.writeable = False
        return passive

    def tangent(self, posture: Posture) -> Array:
        """Diagonal of the Hessian."""
        return self.evaluate(posture).hessian.diagonal()

    def linear(self, which: Container[int]) -> JointSprings:
        """The same without the laws of some joints, and with none rigid."""
        laws = {j: law for j, law in self.laws.items() if j not in which}
        return replace(self, laws=laws, rigid=frozenset())

    def with_laws(self, laws: Mapping[int, SpringLaw]) -> JointSprings:
        """The same with other laws."""
        return replace(self, laws=laws)

    def compliances(
        self, names: Sequence[str], slides: Sequence[bool]
    ) -> dict[str, Number]:
        """Those of linear springs, and the coefficients of polynomials.

        The first coefficient counts by its inverse.
        """
        found = super().compliances(names, slides)
        for j, law in self.laws.items() if names else ():
            for power, c in enumerate(law.powers, start=1):
                # An effort over a deflection to that power.
                length = -float(power) if slides[j] else 1.0
                number = Number(c, length, 1.0)
                if power == 1:
                    number = Number(1.0 / c if c else np.inf, -length, -1.0, True)
                found[key_of_law(names[j], power)] = number
        return found

    def with_compliances(
        self, values: Mapping[str, float], names: Sequence[str]
    ) -> JointSprings:
        """The same with other linear springs, and other coefficients."""
        laws = dict(self.laws)
        for j, law in self.laws.items() if names else ():
            c = list(law.powers)
            for i in range(len(c)):
                if (x := values.get(key_of_law(names[j], i + 1))) is not None:
                    c[i] = x if i else 1.0 / x
            if c != list(law.powers):
                laws[j] = PolynomialLaw(tuple(c))
        return replace(super().with_compliances(values, names), laws=laws)

    def softened(
        self, key: str, names: Sequence[str]
    ) -> tuple[JointSprings, JointSprings, float]:
        """A linear spring, or one coefficient of a polynomial a little to both sides."""
        name, _, power = key.partition(" x^")
        j, i = names.index(name), int(power or 1) - 1
        if j not in self.laws:
            return super().softened(key, names)
        c = self.laws[j].powers
        step = _COEFFICIENT_STEP * abs(c[i] or c[0] or 1.0)
        more, less = (
            self.with_laws(
                {**self.laws, j: PolynomialLaw((*c[:i], c[i] + s, *c[i + 1 :]))}
            )
            for s in (step, -step)
        )
        return more, less, (1.0 if i else -(c[0] ** 2)) / (2.0 * step)

    def at_rest(self, q: Array) -> JointSprings:
        """The same at rest at q (n,)."""
        return replace(self, rest=q)

    def rest_is_free(self, every: bool = False) -> Array:
        """Rest positions to be chosen (n,): those not given, or all."""
        return ~self.is_passive if every else ~self.is_passive & np.isnan(self.rest)

    def torque(self, q: Array) -> Array:
        """Torques of the springs whose rest position is given; zero for the others."""
        x = np.where(np.isnan(self.rest), 0.0, q - self.rest)
        torque = self.stiffness * x
        for j, law in self.laws.items():
            torque[j] = 0.0 if np.isnan(self.rest[j]) else law.evaluate(float(x[j]))[1]
        return torque

    def shared(self, posture: Posture, every: bool) -> tuple[Array, Array]:
        """Stiffness of the springs whose rest positions are chosen, where it is none 1,
        and gradient of the others.
        """
        chosen, given = self.rest_is_free(every), self.evaluate(posture)
        k = np.diag(given.hessian)
        own = np.where(chosen, np.where(k > 0.0, k, 1.0), 0.0)
        return own, np.where(chosen, 0.0, given.gradient)

    def balancing(
        self, posture: Posture, gradient: Array, size: float, every: bool
    ) -> Chosen:
        """Choose rest positions so that the springs exert a gradient (n,) at a posture,
        beside the closures.
        """
        gradient, left = self._beside_closures(posture, gradient, size, every)
        if every and left.any():  # otherwise the result says that it is unbalanced
            return Chosen(self, left=left)
        forces = np.where(self.rest_is_free(every), gradient, np.nan)
        return Chosen(self.with_forces(posture, forces), forces)

    def _beside_closures(
        self, posture: Posture, gradient: Array, size: float, every: bool
    ) -> tuple[Array, Array]:
        """The part of a gradient that closures leave to the springs,
        and what no spring has of it.

        Closures carry, as far as they can, what joints with a known torque do not carry:
        those that are passive, or whose rest position is not to be chosen.

        Returns
        -------
        gradient, left : ndarray, shape (n,) each
            What is left is zero where it is negligible beside the largest gradient and
            `size`.
        """
        chosen, closure = self.rest_is_free(every), posture.closure
        left = np.zeros(len(gradient))
        if not chosen.all():
            left = np.where(chosen, 0.0, gradient - self.torque(posture.q))
        if not left.any():
            return gradient, left
        if closure is not None:
            known, sizes = ~chosen, posture.coordinate_lengths
            _, values, Vt = np.linalg.svd(closure.jacobian * sizes)
            V, N = np.split(Vt.T, [numerics.rank(values)], axis=1)
            # The small singular values of V[known] and N[chosen] are the same: one
            # threshold, relative to the largest of N[chosen], decides on both.
            largest = [
                numerics.singular_values(m).max(initial=0.0)
                for m in (N[chosen], V[known])
            ]
            smallest = numerics.RANK * float(largest[0] / max(largest[1], numerics.TINY))
            forces = np.linalg.lstsq(V[known], (left * sizes)[known], rcond=smallest)[0]
            carried = V @ forces / sizes
            gradient, left = gradient - carried, np.where(known, left - carried, 0.0)
        size = max(size, float(np.abs(gradient).max()))
        least = numerics.BALANCE_TOLERANCE * size + numerics.ROUNDOFF
        return gradient, np.where(np.abs(left) > least, left, 0.0)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, torques and tangent stiffnesses."""
        x = posture.q - self.rest
        torque = self.stiffness * x
        energies, diagonal = 0.5 * torque * x, self.stiffness.copy()
        for j, law in self.laws.items():
            energies[j], torque[j], diagonal[j] = law.evaluate(float(x[j]))
        return Evaluation(float(energies.sum()), torque, read_only(np.diag(diagonal)))

    def in_units(self, a: float, sizes: Array, efforts: Array) -> Self:  # noqa: ARG002
        """The same springs in other units: coordinates times `sizes` (n,), torques times
        `efforts` (n,).
        """
        own = {
            j: law.in_units(float(sizes[j]), float(efforts[j]))
            for j, law in self.laws.items()
        }
        k, rest = self.stiffness * efforts / sizes, self.rest * sizes
        return replace(self, stiffness=k, rest=rest, laws=own)

    def replaced(self, stiffness: Array, rest: Array) -> JointSprings:
        """The same springs with other stiffnesses, `stiffness` (n,), and rest positions,
        `rest` (n,).
        """
        return replace(self, stiffness=stiffness, rest=rest)

    def with_forces(self, posture: Posture, forces: Array) -> JointSprings:
        """The same springs with rest positions at which they exert torques (n,)
        at a posture.

        Where a torque is NaN the rest position stays; those of joints without a spring
        are ignored.

        Raises
        ------
        InputError
            If a spring's law never reaches its torque.
        """
        chosen = ~self.is_passive & ~np.isnan(forces)
        rest = self.rest.copy()
        for j, law in self.laws.items():
            if chosen[j]:
                rest[j] = posture.q[j] - law.deflection_for(float(forces[j]))
                chosen[j] = False
        rest[chosen] = posture.q[chosen] - forces[chosen] / self.stiffness[chosen]
        rest.flags.writeable = False
        # All else has been checked, and every posture of an arm comes here.
        own = object.__new__(JointSprings)
        vars(own).update(vars(self), rest=rest)
        vars(own).pop("is_complete", None)
        return own
