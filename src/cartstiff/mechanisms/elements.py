r"""The elastic parts of a mechanism as one list of springs, with their compliance matrix.

Each *element* is one scalar deflection x_e with its force: a joint on its spring, a leg, a line, a
virtual joint of a compliant link. With B = dx/dq and Gamma the compliances, block by block,

    forces  t = Gamma^-1 x,      Phi'' = B^T Gamma^-1 B + (geometric stiffness of the forces)

A compliance parameter is a symmetric pattern S on the elements: Gamma = ... + theta S. Polynomial
springs, which are no elements, have their coefficients as parameters. Under a constant load the
torque ``t = c_1 x + c_2 x^2 + ...`` of such a spring is constant. With its tangent stiffness k and
the derivative k' of k by the deflection, its compliance there changes by
``d(1/k)/dc_m = -(m x^(m-1) - k' x^m / k) / k^2``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from cartstiff.arrays import Array
from cartstiff.errors import UnknownNameError, check_name
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.identified import LINK, CompliancePattern
from cartstiff.potentials.beams import Beam
from cartstiff.potentials.flexure_struts import ideal_joints_only
from cartstiff.potentials.line_springs import LineSprings, line_geometry
from cartstiff.potentials.springs import CoupledSprings, JointSprings, PolynomialLaw


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
        #: Index of each potential (-1: the springs), potential, its own indices, its elements.
        self._parts: list[tuple[int, Any, Array, slice]] = []
        coordinates = elastic.mechanism.coordinates
        springs = elastic.springs
        ideal_joints_only(springs, "sensitivities to springs")
        lines = 0
        for part, potential in enumerate((springs, *elastic.potentials), start=-1):
            if isinstance(potential, LineSprings):
                own = np.arange(len(potential.stiffness))
                of_lines = [f"line{lines + k + 1}" for k in own]
                lines += 0 if part < 0 else len(own)
                each, slides = (
                    elastic.spring_names if part < 0 else of_lines,
                    [True] * len(own),
                )
            elif isinstance(potential, (JointSprings, CoupledSprings, Beam)):
                if isinstance(potential, JointSprings):
                    own = np.flatnonzero(~potential.is_passive)
                    held = potential.laws.keys() | potential.rigid
                    own = own[[j not in held for j in own.tolist()]]
                else:
                    own = np.asarray(potential.indices, int).reshape(-1)
                each = [coordinates[j].name for j in own]
                slides = [coordinates[j].is_length for j in own]
            else:
                continue
            self._parts.append(
                (part, potential, own, slice(len(names), len(names) + len(own)))
            )
            names += each
            lengths += slides
        self.names = tuple(names)
        self.is_length = np.array(lengths, bool)

    @property
    def deflect_by_length(self) -> dict[str, bool]:
        """Whether each spring deflects by a distance; those with polynomials, no elements, too."""
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
        for _, potential, own, block in self._parts:
            if isinstance(potential, LineSprings):
                K[block, block] = np.diag(potential.stiffness)
            else:
                q = self.elastic.q.copy()
                q[own] = 0.0
                H = potential.evaluate(self.elastic.mechanism.at(q)).hessian
                K[block, block] = H[np.ix_(own, own)]
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
        n = posture.motion.jacobian.shape[1]
        B = np.zeros((len(self.names), n))
        for _, potential, own, block in self._parts:
            if isinstance(potential, LineSprings):
                T, to_pose = posture.relative(potential.frame_a, potential.frame_b)
                lines = line_geometry(T, potential.anchors, potential.points).lines
                B[block] = lines @ to_pose.jacobian
            else:
                B[block] = np.eye(n)[own]
        return B

    def forces(self, posture: MechanismPosture) -> Array:
        """Return the force (E,) of each element at a posture; zero with an open rest position."""
        t = np.zeros(len(self.names))
        for _, potential, own, block in self._parts:
            if isinstance(potential, LineSprings):
                T, _ = posture.relative(potential.frame_a, potential.frame_b)
                t[block] = potential.tensions(potential.lengths_at(T))
            else:
                t[block] = potential.evaluate(posture).gradient[own]
        return np.nan_to_num(t)

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
        """Return the mechanism with another Gamma (E, E); a beam's is a multiple of its own."""
        springs, potentials = self.elastic.springs, list(self.elastic.potentials)
        for part, potential, own, block in self._parts:
            C, other = compliance[block, block], potential
            if isinstance(potential, JointSprings):
                k = potential.stiffness.copy()
                k[own] = 1.0 / np.diag(C)
                k[list(potential.rigid)] = np.inf
                other = JointSprings(k, _rest(potential), potential.laws)
            elif isinstance(potential, LineSprings):
                other = potential.replaced(1.0 / np.diag(C), potential.rest_length)
            elif isinstance(potential, CoupledSprings):
                K = np.linalg.inv(C)
                other = replace(potential, matrix=0.5 * (K + K.T))
            elif isinstance(potential, Beam):
                factor = float(np.trace(self.compliance[block, block]) / np.trace(C))
                other = replace(potential, section=potential.section.times(factor))
            if part < 0:
                springs = other
            else:
                potentials[part] = other
        return replace(self.elastic, springs=springs, potentials=tuple(potentials))


def law_of(
    elastic: ElasticMechanism, name: str, where: str | None = None
) -> PolynomialLaw:
    """Return the polynomial spring of a joint; UnknownNameError where it has none."""
    laws = elastic.springs.laws if isinstance(elastic.springs, JointSprings) else {}
    polynomials = {
        elastic.names[j]: law for j, law in laws.items() if isinstance(law, PolynomialLaw)
    }
    if name not in polynomials:
        raise UnknownNameError("polynomial spring", name, list(polynomials), where=where)
    return polynomials[name]


def coefficient(elastic: ElasticMechanism, law: tuple[str, int]) -> float:
    """Return a polynomial spring's parameter: a coefficient, for the first power its inverse."""
    name, power = law
    c = (*law_of(elastic, name).coefficients, *[0.0] * power)[power - 1]
    return 1.0 / c if power == 1 else c


def with_coefficients(
    elastic: ElasticMechanism, values: Mapping[tuple[str, int], float]
) -> ElasticMechanism:
    """Return the mechanism with other values of parameters of polynomial springs."""
    springs = elastic.springs
    if not values or not isinstance(springs, JointSprings):
        return elastic
    laws = dict(springs.laws)
    for (name, power), value in values.items():
        j = elastic.names.index(name)
        c = list(getattr(laws[j], "coefficients"))  # noqa: B009 - checked where parameters are made
        c[power - 1] = 1.0 / value if power == 1 else value
        laws[j] = PolynomialLaw(tuple(c))
    springs = JointSprings(springs.stiffness, springs.rest, laws, springs.rigid)
    return replace(elastic, springs=springs)


def stiffnesses_beside(elastic: ElasticMechanism) -> dict[str, float]:
    """Return the stiffness of each line, and for each compliant link the factor 1 on its own."""
    stiffnesses: dict[str, float] = {}
    for names, potential in _beside(elastic):
        values = potential.stiffness if isinstance(potential, LineSprings) else [1.0]
        stiffnesses |= dict(zip(names, map(float, values), strict=True))
    return stiffnesses


def with_stiffnesses_beside(
    elastic: ElasticMechanism, values: Mapping[str, float]
) -> ElasticMechanism:
    """Return the mechanism with some of `stiffnesses_beside` changed."""
    named = {id(potential): names for names, potential in _beside(elastic)}
    potentials = []
    for potential in elastic.potentials:
        names = named.get(id(potential), [])
        if not values.keys().isdisjoint(names):
            if isinstance(potential, LineSprings):
                k = [
                    values.get(n, x)
                    for n, x in zip(names, potential.stiffness, strict=True)
                ]
                potential = potential.replaced(np.array(k, float), potential.rest_length)
            elif isinstance(potential, CoupledSprings):
                potential = replace(potential, matrix=values[names[0]] * potential.matrix)
            elif isinstance(potential, Beam):
                potential = replace(
                    potential, section=potential.section.times(values[names[0]])
                )
        potentials.append(potential)
    return replace(elastic, potentials=tuple(potentials))


def _beside(
    elastic: ElasticMechanism,
) -> Iterator[tuple[list[str], LineSprings | CoupledSprings | Beam]]:
    """Yield the names of the lines ("line1") or link ("forearm (link)") of each potential."""
    lines = links = 0
    for potential in elastic.potentials:
        if isinstance(potential, LineSprings):
            first, lines = lines, lines + len(potential.stiffness)
            yield [f"line{k + 1}" for k in range(first, lines)], potential
        elif isinstance(potential, (CoupledSprings, Beam)):
            links += 1
            yield [f"{potential.link or f'coupled springs {links}'}{LINK}"], potential


def _rest(springs: JointSprings) -> Array:
    """Rest positions, none for rigid joints."""
    rest = springs.rest.copy()
    rest[list(springs.rigid)] = np.nan
    return rest
