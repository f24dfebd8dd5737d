"""Where links that give come to rest under a load, while the joints with springs stay."""

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

#: Steps after which the search is given up.
STEPS = 60
#: Natural units: the largest step taken at once, and the one that ends the search. One that is
#: somewhat longer in the last step of all is rounding.
LONGEST, LAST, ROUNDED = 0.2, numerics.EQUILIBRIUM_TOLERANCE, 1e3 * numerics.EQUILIBRIUM_TOLERANCE


def settled_coordinates(elastic: ElasticMechanism) -> Array:
    """Coordinates (k,) that come to rest under a wrench: those without springs of their own.

    None where no link gives, or where nothing says what moves the mechanism.
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
    others, virtual joints of links and joints without springs, move until all that acts on them
    and the closures balance. Without links that give the posture is returned as it is.

    Raises
    ------
    ConvergenceError
        If they find no rest: the load is beyond what the links carry.
    """
    free = settled_coordinates(elastic)
    if not free.size:
        return posture
    # Components are given at the posture that is sought: they stay what they are in their axes.
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
        solution = np.linalg.lstsq(system, right, rcond=numerics.LAST_DIGITS)[0]
        step, lam = solution[: free.size], solution[free.size :] * stiff
        largest = float(np.abs(step).max(initial=0.0))
        if not np.isfinite(largest):
            break
        move = np.zeros(sizes.size)
        move[free] = step * sizes[free] * min(1.0, LONGEST / max(largest, LAST))
        posture = elastic.mechanism.at(posture.q + move)
        if largest <= LAST:  # a step that small is a force still, where a link is stiff
            return posture
    if largest <= ROUNDED:
        return posture
    raise ConvergenceError(
        "the links find no rest under this load, which may be beyond what they carry",
        iterations=STEPS,
        residual=largest,
    )
