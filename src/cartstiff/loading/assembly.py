"""Where a body carried by several chains is put together: at the pose that its file asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff.errors import ConvergenceError, InputError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain, Closure
from cartstiff.mechanisms.tree import KinematicTree, Placement

__all__ = ["leg_at_pose"]

_POSE, _END = "the pose of the file", "the body at the end of the leg"
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
    at = tree.placement(end)
    own = {_POSE: Placement(0, T_root_B), _END: Placement(at.joint, at.T_j_f @ T_end_B)}
    offset = None if tree.mimic is None else np.asarray(tree.offset, float)
    tied = KinematicTree(
        tree.model, tree.coordinates, {**tree.frames, **own}, tree.mimic, offset
    )  # fmt: skip
    chain = Chain(tied, _END, closures=[Closure(_POSE, _END, "weld")])
    lower, upper = (np.array([getattr(c, s) for c in tree.coordinates]) for s in ("lower", "upper"))
    turns = np.array([c.type == "revolute" for c in tree.coordinates])
    low = np.where(np.isfinite(lower), lower, np.where(turns, -np.pi, -chain.at(q).length))
    high = np.where(np.isfinite(upper), upper, np.where(turns, np.pi, chain.at(q).length))
    low, high = np.minimum(low, high), np.maximum(low, high)
    rng = np.random.default_rng(_SEED)
    beyond, nearest = None, np.inf
    for attempt in range(_STARTS + 1):
        start = q.copy() if not attempt else rng.uniform(low, high)
        start[virtual] = q[virtual]
        try:
            x = chain.closed(start, hold=virtual).q
        except ConvergenceError as error:
            nearest = min(nearest, float(error.residual))
            continue
        if not np.array_equal(x[virtual], q[virtual]):
            continue  # a link that gives was bent
        turned = x - 2 * np.pi * np.round(x / (2 * np.pi))
        x = np.where(turns & (lower <= turned) & (turned <= upper), turned, x)
        if np.all((lower <= x) & (x <= upper)):
            return x
        beyond = x if beyond is None else beyond
    if beyond is None:
        raise InputError(
            "the pose cannot be reached", where=f"{where}, key pose",
            expected="a pose that every leg reaches",
            got=f"{leg}, which stays {nearest:.3g} (rad or length) away",
        )  # fmt: skip
    return beyond
