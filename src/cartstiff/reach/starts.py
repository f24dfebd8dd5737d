"""Closed chains from random starts: postures in which the actuators stay where they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cartstiff import numerics
from cartstiff.errors import ConvergenceError
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.joint_poses import JointPoses
from cartstiff.many.kernels import Closer
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism

# Starts that the engine tries one by one; more are given up where recorded steps leave them open.
_BY_ENGINE = 100


def closed_from(
    elastic: ElasticMechanism,
    chain: Chain,
    q: Array,
    starts: int,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[list[Array], list[Array]]:
    """Coordinates (n,) that differ, first those of `q`, and where all joints and the body are then.

    `q` is closed; its actuated and virtual joints stay. `progress` is called with how many starts
    are done, and of how many.
    """
    held = list(chain.actuated or ())
    solver = JointPoses(elastic, limits=False)
    begin = solver.random_starts(starts, np.random.default_rng(seed))
    begin = np.vstack([q, begin])
    begin[:, chain.held] = q[chain.held]
    fixed = chain.with_rigid(chain.rigid | frozenset(chain.held))
    # Most starts lead to no closed chain, and their steps take the time: all at once.
    begin, is_closed, _ = Closer(elastic, "portable", len(begin))(begin)
    first = _BY_ENGINE if is_closed.any() else len(begin)
    closed: list[Array] = []
    places: list[Array] = []
    for done, row in enumerate(begin, 1):
        if progress is not None:
            progress(done, len(begin))
        if done > first and not is_closed[done - 1]:
            continue
        try:
            posture = fixed.closed(row, hold=())
        except ConvergenceError:
            continue
        if np.abs(posture.q[held] - q[held]).max() > numerics.NEARBY:
            continue  # closed only by leaving the actuators' positions
        place = chain.tree.at(posture.q).joint_poses([*range(1, chain.tree.model.njoints)])
        where = np.append(place[:, :3, 3].ravel(), posture.pose[:3].ravel())
        unit = numerics.NEARBY * max(1.0, posture.length)
        if all(np.abs(where - other).max() > unit for other in places):
            places.append(where)
            closed.append(np.array(posture.q))
    return closed, places
