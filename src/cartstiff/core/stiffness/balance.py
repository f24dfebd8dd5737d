r"""Rest positions at which the springs of a mechanism balance a load at a posture.

Springs with the forces t on their deflections, B the rates of these, balance a wrench W
on the body together with the closures C and all other potentials, of gradient g, if

    B^T t + g + C^T lam = J^T W.                                                       (1)

A load chooses the forces of all springs; without one, springs that have no rest position
choose theirs, with W = 0. The rest position of a spring follows from its force by its
law. Springs that couple joints come first: of all their forces that (1) allows, those
with the least energy in the chosen springs. Then every spring of a joint has the force
that is left for its coordinate, after the closures have carried what coordinates without
a choice do not carry. Lines choose theirs in `cartstiff.core.potentials.line_springs`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_input
from cartstiff.core.errors import InputError
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.potentials.contract import (
    Evaluation,
    evaluate_together,
    nothing,
    summed,
)
from cartstiff.core.units import engineering


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
    carried = np.zeros(J.shape[1]) if wrench is None else J.T.dot(wrench)
    parts = evaluate_together(elastic.terms(springs=False), posture)
    if any(term.rest_is_free(every).any() for term in elastic.coupled_springs):
        elastic, parts = _coupled(elastic, posture, carried, parts, every)
    if springs is None or (springs.is_complete and not every):
        return elastic, parts, None
    gradient = carried - sum((p.gradient for p in parts), np.zeros(J.shape[1]))
    size = numerics.largest(carried)
    chosen = springs.balancing(posture, gradient, size, every)
    if chosen.left is not None:
        raise _unheld(elastic, chosen.left, parts)
    return replace(elastic, springs=chosen.springs), parts, chosen.forces


def _unheld(
    elastic: ElasticMechanism, left: Array, parts: list[Evaluation]
) -> InputError:
    """Refusal of a load that needs torques `left` (n,) of joints where no rest position
    can be chosen.
    """
    j = int(np.argmax(np.abs(left)))
    unit = elastic.units.effort(elastic.mechanism.coordinates[j].is_length)
    joint, needed = elastic.names[j], engineering(abs(left[j]), unit)
    acting = {
        type(term).__name__
        for term, part in zip(elastic.terms(springs=False), parts, strict=True)
        if not term.is_external and part.hessian[j].any()
    }
    if not acting:
        return InputError(
            f"{joint} has no spring, but the wrench needs {needed} from it",
            expected="a stiffness above zero there, or a wrench that does not load it",
        )
    words = ", ".join(sorted(acting))
    return InputError(
        f"{joint} has no spring whose rest position could be chosen, but the wrench "
        f"needs {needed} from it; the energy that acts there ({words}) keeps its own "
        "rest",
        expected="equilibrium (cartstiff equilibrium), which deflects it, or springs "
        "whose rest may be chosen: springs or coupled_springs in the file",
    )


def _coupled(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    carried: Array,
    parts: list[Evaluation],
    every: bool,
) -> tuple[ElasticMechanism, list[Evaluation]]:
    """Choose rest positions of springs that couple joints, before those of the joints:
    these carry what is left.

    Parameters
    ----------
    elastic, posture
        The mechanism and its posture.
    carried : ndarray (n,)
        Gradient of the load.
    parts : list of Evaluation
        Of all potentials but the springs.
    every : bool
        Whether all rest positions are chosen, or those that are not given.
    """
    springs, terms, n = elastic.springs, elastic.coupled_springs, len(carried)
    at = [i for i, term in enumerate(elastic.potentials) if term.sums is not None]
    # What they, the chosen springs of joints and the closures have to balance.
    own, gradient = np.zeros(n), carried
    if springs is not None:
        own, given = springs.shared(posture, every)
        gradient = gradient - given
    others = [part.gradient for i, part in enumerate(parts) if i not in at]
    gradient = gradient - sum(others, np.zeros(n))
    free = [term.rest_is_free(every) for term in terms]
    for sums, is_free in zip(elastic.sums, free, strict=True):
        known = np.where(is_free, 0.0, sums.forces(posture.q))
        gradient = gradient - sums.factors.T @ known
    closure, chosen = posture.closure, [*zip(elastic.sums, free, strict=True)]
    forces = _least_forces(
        np.concatenate([sums.factors[is_free] for sums, is_free in chosen]),
        np.concatenate([sums.stiffness[is_free] for sums, is_free in chosen]),
        gradient,
        own,
        np.zeros((n, 0)) if closure is None else closure.jacobian.T,
        posture.coordinate_lengths,
    )
    # Each has the forces that were found for its sums.
    potentials, parts, start = list(elastic.potentials), list(parts), 0
    for i, term, is_free in zip(at, terms, free, strict=True):
        each = np.full(len(is_free), np.nan)
        each[is_free] = forces[start : start + is_free.sum()]
        start += int(is_free.sum())
        potentials[i] = term.with_forces(posture, each)
        parts[i] = potentials[i].evaluate(posture)
    return replace(elastic, potentials=tuple(potentials)), parts


def _least_forces(
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
