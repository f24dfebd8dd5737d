r"""The elastic parts of a mechanism as one list of springs, with their compliance matrix.

Each *element* is one scalar deflection x_e with its force: a joint on its spring, a leg,
a line, a virtual joint of a compliant link. With B = dx/dq and Gamma the compliances,
block by block,

    forces  t = Gamma^-1 x,  Phi'' = B^T Gamma^-1 B + (geometric stiffness of the forces)

A compliance parameter is a symmetric pattern S on the elements: Gamma = ... + theta S.
Polynomial springs, which are no elements, have their coefficients as parameters. Under a
constant load the torque ``t = c_1 x + c_2 x^2 + ...`` of such a spring is constant. With
its tangent stiffness k and the derivative k' of k by the deflection, its compliance there
changes by ``d(1/k)/dc_m = -(m x^(m-1) - k' x^m / k) / k^2``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.errors import UnknownNameError, check_name
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.identified import CompliancePattern
from cartstiff.core.potentials.contract import Parts, Potential
from cartstiff.core.potentials.spring_laws import PolynomialLaw
from cartstiff.core.potentials.springs import SpringLaw


class Elements:
    """The elements of an elastic mechanism.

    Parameters
    ----------
    elastic : ElasticMechanism
        Rigid and passive joints, and those with a nonlinear law, are no elements.

    Attributes
    ----------
    names : tuple of str
        Names of joints, legs ("leg1"), lines ("line1") and virtual joints ("forearm.px").
    is_length : ndarray of bool (E,)
        Whether the deflection is a distance.
    """

    def __init__(self, elastic: ElasticMechanism) -> None:
        self.elastic = elastic
        names: list[str] = []
        lengths: list[bool] = []
        #: Index of each potential (-1: the springs), potential, names, its elements among
        #: its parts and among all.
        self._parts: list[tuple[int, Potential, Sequence[str], list[int], slice]] = []
        springs, posture = elastic.springs, elastic.mechanism.at(elastic.q)
        bent: set[str] = set()
        every = list(enumerate(elastic.labelled()))
        if springs is not None:
            springs.require_ideal_joints("sensitivities to springs")
            bent = {elastic.spring_names[j] for j in springs.laws}
            every.insert(0, (-1, (springs, elastic.spring_names)))
        for part, (potential, given) in every:
            if potential.own_stiffness is None:
                continue
            parts = potential.parts(posture, elastic.mechanism.coordinates, given)
            if parts is None:
                continue
            own = [i for i, name in enumerate(parts.names) if name not in bent]
            block = slice(len(names), len(names) + len(own))
            self._parts.append((part, potential, given, own, block))
            names += [parts.names[i] for i in own]
            lengths += [parts.slides[i] for i in own]
        self.names = tuple(names)
        self.is_length = np.array(lengths, bool)

    @property
    def deflect_by_length(self) -> dict[str, bool]:
        """Whether each spring deflects by a distance.

        Those with polynomials, no elements, too.
        """
        coordinates = self.elastic.mechanism.coordinates
        joints = {c.name: c.is_length for c in coordinates}
        return joints | dict(zip(self.names, self.is_length.tolist(), strict=True))

    def index(self, name: str, where: str | None = None) -> int:
        """Return the index of an element; UnknownNameError."""
        check_name("spring", name, self.names, where)
        return self.names.index(name)

    @cached_property
    def stiffness(self) -> Array:
        """Gamma^-1 (E, E), beams undeflected."""
        K = np.zeros((len(self.names),) * 2)
        for _, potential, _, _, block in self._parts:
            K[block, block] = potential.own_stiffness
        return K

    @cached_property
    def compliance(self) -> Array:
        """Gamma (E, E)."""
        C = np.zeros_like(self.stiffness)
        for *_, block in self._parts:
            C[block, block] = np.linalg.inv(self.stiffness[block, block])
        return C

    def rows(self, posture: MechanismPosture) -> Array:
        """Return B (E, n): deflection of each element per coordinate rate."""
        each = [own.rows[rows] for own, rows in self._at(posture)]
        n = posture.motion.jacobian.shape[1]
        return np.concatenate([np.zeros((0, n)), *each])

    def forces(self, posture: MechanismPosture) -> Array:
        """Return the force (E,) of each element at a posture.

        Zero with an open rest position.
        """
        each = [own.forces[rows] for own, rows in self._at(posture)]
        return np.nan_to_num(np.concatenate([np.zeros(0), *each]))

    def _at(self, posture: MechanismPosture) -> Iterator[tuple[Parts, list[int]]]:
        """Yield the parts of each potential at a posture, and its elements among them."""
        coordinates = self.elastic.mechanism.coordinates
        for _, potential, names, rows, _ in self._parts:
            if (own := potential.parts(posture, coordinates, names)) is not None:
                yield own, rows

    def patterns(self, patterns: Sequence[CompliancePattern]) -> Array:
        """Return S of each parameter (P, E, E)."""
        weights = np.zeros((len(patterns), len(self.names), len(self.names)))
        for p, pattern in enumerate(patterns):
            for a, b, weight in pattern.entries:
                i, j = self.index(a, pattern.name), self.index(b, pattern.name)
                weights[p, i, j] = weights[p, j, i] = weight
        return weights

    def with_parameters(
        self, patterns: Sequence[CompliancePattern], change: Array
    ) -> ElasticMechanism:
        """Return the mechanism with parameters changed by (P,)."""
        S = np.tensordot(change, self.patterns(patterns), axes=1)
        laws = {
            p.law: coefficient(self.elastic, p.law) + float(step)
            for p, step in zip(patterns, change, strict=True)
            if p.law is not None
        }
        return with_coefficients(self.with_compliance(self.compliance + S), laws)

    def with_compliance(self, compliance: Array) -> ElasticMechanism:
        """The mechanism with another Gamma (E, E); a beam's is a multiple of its own."""
        springs, potentials = self.elastic.springs, list(self.elastic.potentials)
        for part, potential, _, _, block in self._parts:
            C = compliance[block, block]
            if part >= 0:
                potentials[part] = potential.with_compliance(C)
            elif springs is not None:
                springs = springs.with_compliance(C)
        return replace(self.elastic, springs=springs, potentials=tuple(potentials))


def laws_of(elastic: ElasticMechanism) -> Mapping[int, SpringLaw]:
    """Return the nonlinear springs by joint."""
    return {} if elastic.springs is None else elastic.springs.laws


def law_of(elastic: ElasticMechanism, name: str, where: str | None = None) -> SpringLaw:
    """Return the polynomial spring of a joint; UnknownNameError where it has none."""
    polynomials = {elastic.names[j]: x for j, x in laws_of(elastic).items() if x.powers}
    if name not in polynomials:
        raise UnknownNameError("polynomial spring", name, list(polynomials), where=where)
    return polynomials[name]


def coefficient(elastic: ElasticMechanism, law: tuple[str, int]) -> float:
    """A polynomial spring's parameter: a coefficient, for the first power its inverse."""
    name, power = law
    c = (*law_of(elastic, name).powers, *[0.0] * power)[power - 1]
    return 1.0 / c if power == 1 else c


def with_coefficients(
    elastic: ElasticMechanism, values: Mapping[tuple[str, int], float]
) -> ElasticMechanism:
    """Return the mechanism with other values of parameters of polynomial springs."""
    springs = elastic.springs
    if not values or springs is None:
        return elastic
    laws = dict(springs.laws)
    for (name, power), value in values.items():
        j = elastic.names.index(name)
        c = list(laws[j].powers)
        c[power - 1] = 1.0 / value if power == 1 else value
        laws[j] = PolynomialLaw(tuple(c))
    return replace(elastic, springs=springs.with_laws(laws))
