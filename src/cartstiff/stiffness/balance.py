r"""Rest positions at which the springs of a mechanism balance a load at a posture.

Springs with the forces t on their deflections, B the rates of these, balance a wrench W
on the body together with the closures C and all other potentials, of gradient g, if

    B^T t + g + C^T lam = J^T W.                                                       (1)

A load chooses the forces of all springs; without one, springs that have no rest position
choose theirs, with W = 0. The rest position of a spring follows from its force by its
law. Springs that couple joints come first: of all their forces that (1) allows, those
with the least energy in the chosen springs. Then every spring of a joint has the force
that is left for its coordinate, after the closures have carried what coordinates without
a choice do not carry. Lines choose theirs in `cartstiff.potentials.line_springs`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.arrays import Array, checked_input
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.beams import evaluate_together
from cartstiff.potentials.contract import Evaluation, nothing, summed
from cartstiff.potentials.coupled_joints import CoupledJointSprings, balancing
from cartstiff.potentials.springs import JointSprings, unheld
from cartstiff.units import engineering


def with_rest_balancing(
    elastic: ElasticMechanism,
    at: ArrayLike | MechanismPosture,
    wrench: ArrayLike | None = None,
) -> ElasticMechanism:
    """Choose open rest positions so that a posture is an equilibrium.

    Without `wrench`, springs that have no rest position carry gravity and the other
    potentials, and the end-effector is unloaded. With it, all rest positions are chosen
    so that the springs balance it.
    """
    if not elastic.has_open_rest and wrench is None:
        return elastic
    posture = at if isinstance(at, MechanismPosture) else elastic.mechanism.at(at)
    load = None if wrench is None else checked_input(wrench, (6,), "wrench")
    return _chosen(elastic, posture, load)[0]


def balanced(
    elastic: ElasticMechanism, posture: MechanismPosture, wrench: Array | None = None
) -> tuple[ElasticMechanism, Evaluation]:
    """`with_rest_balancing` with the energy there.

    The other potentials are evaluated once.
    """
    elastic, others, exerted = _chosen(elastic, posture, wrench)
    parts = [summed(others)] if others else []
    if elastic.springs is not None:
        own = elastic.springs.evaluate(posture)
        if exerted is not None:
            # The chosen torque is exact; from the rest position of a stiff spring it is
            # rounded.
            torque = np.where(exerted == exerted, exerted, own.gradient)
            own = own._replace(gradient=torque)
        parts.insert(0, own)
    return elastic, summed(parts or [nothing(posture.motion.jacobian.shape[1])])


def _chosen(
    elastic: ElasticMechanism, posture: MechanismPosture, wrench: Array | None
) -> tuple[ElasticMechanism, list[Evaluation], Array | None]:
    """`with_rest_balancing`, all potentials but the springs there,
    and chosen torques (n,).

    Torques are NaN where they are not chosen; None if no spring of a joint chooses.
    """
    every, springs, J = wrench is not None, elastic.springs, posture.motion.jacobian
    n = J.shape[1]
    carried = np.zeros(n) if wrench is None else J.T.dot(wrench)
    terms = elastic.terms(springs=False)
    parts = evaluate_together(terms, posture)
    if any(term.rest_is_free(every).any() for term in elastic.coupled_springs):
        # Springs that couple joints, before those of the joints: these carry what is
        # left.
        left, own = carried, np.zeros(n)
        if isinstance(springs, JointSprings):
            chosen = springs.rest_is_free(every)
            given = springs.evaluate(posture)
            k = np.diag(given.hessian)
            own = np.where(chosen, np.where(k > 0.0, k, 1.0), 0.0)
            left = left - np.where(chosen, 0.0, given.gradient)
        at = [i for i, t in enumerate(terms) if isinstance(t, CoupledJointSprings)]
        others = [part.gradient for i, part in enumerate(parts) if i not in at]
        left = left - sum(others, np.zeros(n))
        found = balancing(elastic.coupled_springs, posture, left, own, every)
        potentials = list(elastic.potentials)
        for i, term in zip(at, found, strict=True):
            potentials[i], parts[i] = term, term.evaluate(posture)
        elastic = replace(elastic, potentials=tuple(potentials))

    if springs is None or (springs.is_complete and not every):
        return elastic, parts, None
    gradient, exerted = carried - sum((p.gradient for p in parts), np.zeros(n)), None
    if isinstance(springs, JointSprings):
        size = float(np.abs(carried).max(initial=0.0))
        gradient, left = springs.beside_closures(posture, gradient, size, every)
        if every and left.any():  # otherwise the result says that it is unbalanced
            j = int(np.argmax(np.abs(left)))
            unit = elastic.units.effort(elastic.mechanism.coordinates[j].is_length)
            acting = {
                type(term).__name__
                for term, part in zip(terms, parts, strict=True)
                if not term.is_external and part.hessian[j].any()
            }
            raise unheld(elastic.names[j], engineering(abs(left[j]), unit), acting)
        exerted = np.where(springs.rest_is_free(every), gradient, np.nan)
        springs = springs.with_forces(posture, exerted)
    else:
        springs = springs.with_rest_balancing(posture, gradient, every=every)
    return replace(elastic, springs=springs), parts, exerted
