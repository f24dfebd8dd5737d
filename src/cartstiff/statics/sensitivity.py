r"""How a state of rest moves when its springs are softer.

At rest ``g(q, theta) + A^T lam = 0``. A compliance parameter with pattern S changes the elements'
forces t at fixed q by ``-K S t``, K = Gamma^-1, and so

    dq / d theta = N H_N^-1 N^T B^T K S (t - t_0)

with H_N the tangent of everything that acts. t_0 are the forces of elements whose rest positions
are chosen so that they carry what acts at the start: these follow the compliance. A polynomial
spring ``t = c_1 x + c_2 x^2 + ...`` exerts ``x^m - x_0^m k(x) / k(x_0)`` more per c_m, with the
deflection x_0 at the start where its rest position was chosen, else zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import CompliancePattern, Elements, law_of
from cartstiff.potentials.springs import JointSprings
from cartstiff.statics.balance import Balance


class Chosen(NamedTuple):
    """What springs with chosen rest positions carried at the start; zero for the others.

    Attributes
    ----------
    forces : ndarray (E,)
        Of elements.
    deflections : ndarray (n,)
        Of joints.
    """

    forces: Array
    deflections: Array


def motion_under_forces(posture: MechanismPosture, balance: Balance, forces: Array) -> Array:
    """Motion (n, k) of the coordinates at rest under small generalised forces (n, k)."""
    columns = posture.coordinate_lengths[:, None]
    right = forces * columns
    if balance.free is not None:
        right = balance.free.T @ right
    per = 1.0 / np.sqrt(balance.hardness)[:, None]
    y = per * np.linalg.lstsq(balance.scaled, per * right, rcond=numerics.ZERO)[0]
    return np.asarray(columns * balance.motion(y))


def motion_by_compliance(
    posture: MechanismPosture,
    balance: Balance,
    elements: Elements,
    parameters: Sequence[CompliancePattern],
    chosen: Chosen | None = None,
) -> Array:
    """Derivative (n, P) of the coordinates at rest by each parameter.

    Parameters
    ----------
    posture : MechanismPosture
        At rest.
    balance : Balance
        What acts there.
    elements : Elements
        Elements of the mechanism with all rest positions chosen.
    parameters : sequence of CompliancePattern
        The parameters (P,).
    chosen : Chosen, optional
        From `chosen_forces`; default zero.
    """
    t = elements.forces(posture)
    if chosen is not None:
        t = t - chosen.forces
    softer = elements.stiffness @ (elements.patterns(parameters) @ t).T
    forces = elements.rows(posture).T @ softer
    for p, parameter in enumerate(parameters):
        if parameter.law is not None:
            name, power = parameter.law
            j, law = elements.elastic.names.index(name), law_of(elements.elastic, name)
            springs = elements.elastic.springs
            x = float(posture.q[j] - getattr(springs, "rest")[j])  # noqa: B009 - it has a law
            x0 = 0.0 if chosen is None else float(chosen.deflections[j])
            lost = x**power - x0**power * law.at(x)[2] / law.at(x0)[2]
            forces[j, p] -= lost * (-(law.coefficients[0] ** 2) if power == 1 else 1.0)
    return motion_under_forces(posture, balance, forces)


def chosen_forces(
    original: ElasticMechanism, balanced: ElasticMechanism, start: MechanismPosture
) -> Chosen:
    """What the springs carry at the start whose rest positions were open."""
    elements = Elements(balanced)
    springs = original.springs
    open_ = np.zeros(len(elements.names), bool)
    if springs is not None:
        rest = springs.is_open() if isinstance(springs, JointSprings) else np.isnan(springs.rest)
        loose = [n for n, is_open in zip(original.spring_names, rest, strict=True) if is_open]
        open_ = np.array([name in loose for name in elements.names], bool)
    deflections, own = np.zeros(len(start.q)), balanced.springs
    if isinstance(springs, JointSprings) and isinstance(own, JointSprings):
        deflections = np.where(springs.is_open(), start.q - own.rest, 0.0)
    return Chosen(np.where(open_, elements.forces(start), 0.0), deflections)
