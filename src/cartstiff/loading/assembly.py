"""Where a body carried by several chains is put together: at the pose that its file asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.joint_poses import JointPoses
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.tree import KinematicTree

# Starts of a leg besides the file's posture, and the seed that makes them the same every time.
_STARTS, _SEED = 16, 0


def leg_at_pose(
    tree: KinematicTree,
    end: str,
    T_end_B: Array,
    T_root_B: Array,
    q: Array,
    virtual: Sequence[int],
    where: str,
    leg: str,
) -> Array:
    """Coordinates (n,) of one leg at which the body has a pose.

    Looked for from `q` and then from postures spread over the limits; the first solution within the
    limits is taken, or the first at all. Virtual joints of links that give stay where they are.

    Parameters
    ----------
    tree : KinematicTree
        The leg.
    end : str
        Its last frame.
    T_end_B, T_root_B : ndarray (4, 4)
        Pose of the body in that frame, and where it shall be in the leg's root.
    q : ndarray (n,)
        Posture to start from.
    virtual : sequence of int
        Indices of virtual joints.
    where, leg : str
        File and leg, for messages.

    Raises
    ------
    InputError
        If the leg does not reach the pose.
    """
    elastic = ElasticMechanism(leg, Chain(tree, end, offset=T_end_B, virtual=virtual), q)
    limited, free = JointPoses(elastic), JointPoses(elastic, limits=False)
    spread = limited.random_starts(_STARTS, np.random.default_rng(_SEED))
    starts = np.concatenate([q[None], spread])
    poses = np.broadcast_to(T_root_B, (len(starts), 4, 4))
    for solver in (limited, free):
        postures, reached = solver.unwound().solve(poses, starts)
        if reached.any():
            return solver.within(postures[reached][:1])[0]
    left = np.abs(free.task(postures, poses, "none")[0]).max(axis=1).min()
    raise InputError(
        "the pose cannot be reached",
        where=f"{where}, key pose",
        expected="a pose that every leg reaches",
        got=f"{leg}, which stays {left:.3g} (rad or characteristic lengths) away",
    )
