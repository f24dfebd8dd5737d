"""Where a body carried by several chains is put together: at the pose that its file asks for."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from cartstiff.errors import ConvergenceError, InputError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain, Closure
from cartstiff.mechanisms.tree import KinematicTree, Placement

__all__ = ["legs_at_pose"]

_POSE = "the pose of the file"
# Starts of each leg besides the file's posture, and the seed that makes them the same every time.
_STARTS, _SEED = 40, 0


def legs_at_pose(
    tree: KinematicTree,
    ends: Sequence[str],
    T_F_B: Array,
    q: Array,
    virtual: Collection[int],
    where: str,
) -> Array:
    """Coordinates (n,) at which the end frame of every leg is at a pose.

    Each leg is solved for itself, from its part of `q` and then from postures spread over its
    limits; the first solution within the limits is taken, or the first at all. Virtual joints of
    links that give stay where they are.

    Parameters
    ----------
    tree : KinematicTree
        The legs side by side, their names beginning with "leg1/", "leg2/", ...
    ends : sequence of str
        The body's frame at the end of each leg.
    T_F_B : ndarray (4, 4)
        Where it shall be.
    q : ndarray (n,)
        Posture to start from.
    virtual : collection of int
        Indices of virtual joints.
    where : str
        The file, for messages.

    Raises
    ------
    InputError
        Naming the first leg that does not reach the pose.
    """
    target = KinematicTree(
        tree.model, tree.coordinates, {**tree.frames, _POSE: Placement(0, T_F_B)}, tree.mimic,
        None if tree.mimic is None else np.asarray(tree.offset, float),
    )  # fmt: skip
    result = np.array(q, float)
    rng = np.random.default_rng(_SEED)
    for i, end in enumerate(ends):
        own = [
            j for j, c in enumerate(tree.coordinates)
            if c.name.startswith(f"leg{i + 1}/") and j not in virtual
        ]  # fmt: skip
        chain = Chain(target, end, closures=[Closure(_POSE, end, "weld")])
        result[own] = _leg(chain, own, result, rng, f"{where}, key pose", f"leg {i + 1}")
    return result


def _leg(
    chain: Chain, own: list[int], q: Array, rng: np.random.Generator, where: str, leg: str
) -> Array:
    coordinates = [chain.coordinates[j] for j in own]
    lower, upper = (np.array([getattr(c, s) for c in coordinates]) for s in ("lower", "upper"))
    turns = np.array([c.type == "revolute" for c in coordinates])
    low = np.where(np.isfinite(lower), lower, np.where(turns, -np.pi, -1.0))
    high = np.where(np.isfinite(upper), upper, np.where(turns, np.pi, 1.0))
    others = [j for j in range(q.size) if j not in own]
    beyond, nearest = None, np.inf
    for attempt in range(_STARTS + 1):
        start = q.copy()
        if attempt:
            start[own] = rng.uniform(np.minimum(low, high), high)
        try:
            found = chain.closed(start, hold=others).q
        except ConvergenceError as error:
            nearest = min(nearest, float(error.residual))
            continue
        if not np.array_equal(found[others], q[others]):
            continue  # a link that gives was bent
        x = found[own]
        turned = x - 2 * np.pi * np.round(x / (2 * np.pi))
        x = np.where(turns & (lower <= turned) & (turned <= upper), turned, x)
        if np.all((lower <= x) & (x <= upper)):
            return x
        beyond = x if beyond is None else beyond
    if beyond is None:
        raise InputError(
            "the pose cannot be reached", where=where, expected="a pose that every leg reaches",
            got=f"{leg}, which stays {nearest:.3g} (rad or length) away",
        )  # fmt: skip
    return beyond
