"""Deflection of compliant links to rest under a load, while the joints with springs stay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from cartstiff import numerics
from cartstiff.errors import ConvergenceError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.beams import evaluate_together
from cartstiff.potentials.springs import JointSprings
from cartstiff.stiffness.applied_load import LoadKind

#: Largest number of steps.
STEPS = 60
#: In natural units: the longest step, and the step that ends the search. A somewhat longer step is
#: accepted as round-off after all steps.
LONGEST, LAST, ROUNDED = 0.2, numerics.EQUILIBRIUM_TOLERANCE, 1e3 * numerics.EQUILIBRIUM_TOLERANCE


def settled_coordinates(elastic: ElasticMechanism) -> Array:
    """Coordinates (k,) that a wrench deflects to rest: those without springs of their own.

    Empty if no link is compliant, or if a closed chain has neither actuators nor joint springs.
    """
    chain, springs = elastic.mechanism, elastic.springs
    if not isinstance(chain, Chain) or not chain.virtual or not isinstance(springs, JointSprings):
        return np.zeros(0, int)
    free = np.flatnonzero(springs.is_passive)
    if chain.closures and chain.actuated is None and free.size == chain.tree.n:
        return np.zeros(0, int)
    return free


def settled(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    wrench: Array,
    at: Sequence[float],
    axes: Literal["body", "world"],
) -> MechanismPosture:
    """The posture with its links deflected so that they carry a wrench.

    Coordinates with springs stay where they are: their rest positions are chosen afterwards. The
    others, virtual joints of links and joints without springs, move until the forces on them and
    the closures balance. Without compliant links the posture is returned unchanged.

    Raises
    ------
    ConvergenceError
        If there is no equilibrium: the links cannot carry the load.
    """
    free = settled_coordinates(elastic)
    if not free.size:
        return posture
    # The components refer to the deflected posture, so that they are constant in their axes.
    kind = LoadKind("dead" if axes == "world" else "follower", tuple(at))  # type: ignore[arg-type]
    load = kind.acting(wrench, posture.pose, axes)
    lam = np.zeros(0)
    for _ in range(STEPS):
        parts = evaluate_together((*elastic.terms(springs=False), load), posture)
        sizes = posture.coordinate_lengths
        gradient = sum(p.gradient for p in parts) * sizes
        H = sum(p.hessian for p in parts) * np.outer(sizes, sizes)
        closure, missed = posture.closure, posture.residual
        C, r = np.zeros((0, sizes.size)), np.zeros(0)
        if closure is not None and missed is not None:
            C, r = closure.jacobian * sizes, missed
            if lam.size:
                H = H + closure.curvature(lam) * np.outer(sizes, sizes)
        stiff = max(float(np.abs(H).max()), numerics.TINY)
        C_f, H_f = C[:, free], H[np.ix_(free, free)] / stiff
        system = np.block([[H_f, C_f.T], [C_f, np.zeros((r.size, r.size))]])
        right = -np.concatenate([gradient[free] / stiff, r])
        solution = np.linalg.lstsq(system, right, rcond=numerics.ROUNDOFF_OF_SUMS)[0]
        step, lam = solution[: free.size], solution[free.size :] * stiff
        largest = float(np.abs(step).max(initial=0.0))
        if not np.isfinite(largest):
            break
        move = np.zeros(sizes.size)
        move[free] = step * sizes[free] * min(1.0, LONGEST / max(largest, LAST))
        posture = elastic.mechanism.at(posture.q + move)
        if largest <= LAST:  # the step is taken: on a stiff link it still changes the force
            return posture
    if largest <= ROUNDED:
        return posture
    raise ConvergenceError(
        "the links find no rest under this load, which may be beyond what they carry",
        iterations=STEPS,
        residual=largest,
    )
