"""Deflection of compliant links under loads to rest, while sprung joints or
the body stay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import ConvergenceError
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.potentials.contract import Potential, evaluate_together
from cartstiff.core.stiffness.motions import decompose

#: Largest number of steps.
STEPS = 60
#: In natural units: the longest step, and the step that ends the search. A somewhat
#: longer step is accepted as round-off after all steps.
LONGEST, LAST, ROUNDED = (
    0.2,
    numerics.EQUILIBRIUM_TOLERANCE,
    1e3 * numerics.EQUILIBRIUM_TOLERANCE,
)


def settled_coordinates(elastic: ElasticMechanism) -> Array:
    """Coordinates (k,) that a wrench deflects to rest: those without springs
    of their own.

    Empty if no link is compliant.
    """
    chain, springs = elastic.mechanism, elastic.springs
    if not chain.virtual or springs is None:
        return np.zeros(0, int)
    free = ~springs.has_coordinate(len(chain.coordinates))
    for sums in elastic.sums:  # their rest is chosen, as that of springs
        free[sums.factors.any(axis=0)] = False
    return np.flatnonzero(free)


def settled(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    loads: Sequence[Potential],
    away: Callable[[MechanismPosture], Array] | None = None,
) -> MechanismPosture:
    r"""The posture with its links deflected so that they carry loads.

    Coordinates with springs stay where they are: their rest positions are chosen
    afterwards. The others f, virtual joints of links and joints without springs, move
    until the forces on them and the closures C balance, by Newton's steps for ``g_f +
    C_f^T lam = 0`` and the closures. Without compliant links the posture is returned
    unchanged.

    Parameters
    ----------
    elastic, posture
        The mechanism, and where the search starts.
    loads : sequence of Potential
        They act besides the mechanism's own potentials.
    away : callable, optional
        Twist (6,) of M from its pose at a posture to that at rest. Coordinates with
        springs move as well then: the steps that keep the balance bring the body as near
        to that pose as they can, and it ends there if there are enough.

    Raises
    ------
    ConvergenceError
        If there is no equilibrium: the links cannot carry the load.
    """
    free = settled_coordinates(elastic)
    if not free.size:
        return posture
    lam = np.zeros(0)
    acting = [t for t in elastic.terms(springs=False) if t not in elastic.coupled_springs]
    for _ in range(STEPS):
        # Forces and their derivatives, in sizes of the coordinates.
        parts = evaluate_together((*acting, *loads), posture)
        sizes = posture.coordinate_lengths
        gradient = sum((p.gradient for p in parts), np.zeros(sizes.size)) * sizes
        H = sum((p.hessian for p in parts), np.zeros(2 * sizes.shape)) * np.outer(
            sizes, sizes
        )
        closure, missed = posture.closure, posture.residual
        C, r = np.zeros((0, sizes.size)), np.zeros(0)
        if closure is not None and missed is not None:
            C, r = closure.jacobian * sizes, missed
            if lam.size:
                H = H + closure.curvature(lam) * np.outer(sizes, sizes)
        # One Newton step of balance and closures together.
        stiff = max(float(np.abs(H).max()), numerics.TINY)
        moving = free if away is None else np.arange(sizes.size)
        system = np.block(
            [
                [H[np.ix_(free, moving)] / stiff, C[:, free].T],
                [C[:, moving], np.zeros((r.size, r.size))],
            ]
        )
        right = -np.concatenate([gradient[free] / stiff, r])
        solution = np.linalg.lstsq(system, right, rcond=numerics.ROUNDOFF_OF_SUMS)[0]
        # Steps that keep the balance bring the body nearer to where it shall be.
        if away is not None:
            scale = np.repeat([1.0, 1.0 / posture.length], 3)
            rates = np.zeros((6, system.shape[1]))
            rates[:, moving] = scale[:, None] * posture.motion.jacobian * sizes
            keeping = decompose(system).N
            left = scale * away(posture) - rates @ solution
            solution = (
                solution
                + keeping @ np.linalg.lstsq(rates @ keeping, left, numerics.RANK)[0]
            )
        # A long step is shortened.
        step, lam = solution[: moving.size], solution[moving.size :] * stiff
        largest = numerics.largest(step)
        if not np.isfinite(largest):
            break
        move = np.zeros(sizes.size)
        move[moving] = step * sizes[moving] * min(1.0, LONGEST / max(largest, LAST))
        posture = elastic.mechanism.at(posture.q + move)
        if largest <= LAST:  # the step is taken: on a stiff link it changes the force
            return posture
    if largest <= ROUNDED:
        return posture
    raise ConvergenceError(
        "the links find no rest under this load, which may be beyond what they carry",
        iterations=STEPS,
        residual=largest,
    )
