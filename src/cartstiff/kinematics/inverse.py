r"""Inverse kinematics: all postures at wanted poses that a number of starts lead to."""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.arrays import checked_array, is_pose
from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.joint_poses import SAME, JointPoses, distinct
from cartstiff.kinematics.platform_poses import Free, PlatformPoses
from cartstiff.kinematics.settling import settled
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform

__all__ = ["Free", "inverse_kinematics"]

# Postures that are settled at once: the cost is asked for at all of them and around each.
_ROWS = 5000


@overload
def inverse_kinematics(
    elastic: ElasticMechanism, T_F_M: ArrayLike, starts: int | ArrayLike = ..., *, seed: int = ...,
    free: Free = ..., tolerance: float = ..., limits: bool = ...,
    cost: Callable[[Array], Array] | None = ...,
) -> Array: ...  # fmt: skip
@overload
def inverse_kinematics(
    elastic: ElasticMechanism, T_F_M: list[Array], starts: int | ArrayLike = ..., *,
    seed: int = ..., free: Free = ..., tolerance: float = ..., limits: bool = ...,
    cost: Callable[[Array], Array] | None = ...,
) -> list[Array]: ...  # fmt: skip


def inverse_kinematics(
    elastic: ElasticMechanism,
    T_F_M: ArrayLike | list[Array],
    starts: int | ArrayLike = 64,
    *,
    seed: int = 0,
    free: Free = "none",
    tolerance: float = 1e-10,
    limits: bool = True,
    cost: Callable[[Array], Array] | None = None,
) -> Array | list[Array]:
    """All different postures at a pose that the starts lead to.

    Parameters
    ----------
    elastic : ElasticMechanism
        A chain of any number of joints, or a platform, whose pose is its coordinate.
    T_F_M : array_like, shape (4, 4) or (N, 4, 4)
        Wanted pose of the body frame, or N of them.
    starts : int or array_like, shape (k, n)
        How many random starts within the limits, or the starts themselves. The default posture
        is always tried as well.
    seed : int
        Of the random starts; the same seed gives the same answer.
    free : {"none", "x", "y", "z", "rotation"}
        The body's rotation about one of its own axes is left free; or all of its rotation.
    tolerance : float
        Largest error of a solution, in rad and characteristic lengths.
    limits : bool
        Whether the joints' limits (a platform's leg limits) hold.
    cost : callable, optional
        For arms with self-motions: (k, n) postures to (k,) numbers, NaN where there is none; each
        solution is moved along its self-motion to where the number is smallest nearby. Without
        it a solution is near its start: the steps there are the least ones.

    Returns
    -------
    ndarray (k, n), or a list of N of them
        Different solutions within the limits, sorted by their coordinates; joints that can turn
        all the way are given in (-pi, pi] and count as equal modulo 2 pi. None found: k = 0. That
        the starts have found all of them is likely for an arm with many starts, and not proven;
        for a closed chain, whose legs' own solutions combine, each start finds at most one.

    Raises
    ------
    InputError
        For poses that are no rigid motions, wrong shapes, or an unknown freedom.
    """
    if free not in get_args(Free):
        raise UnknownNameError("free rotation", str(free), get_args(Free))
    wanted = checked_array(T_F_M, [(4, 4), ("N", 4, 4)], "array of poses")
    single = wanted.ndim == 2
    wanted = wanted[None] if single else wanted
    for index, T in enumerate(wanted):
        if not is_pose(T):
            raise InputError(f"pose {index + 1} is not a rigid motion", got=T.tolist())
    if isinstance(elastic.mechanism, Platform):
        q, good = PlatformPoses(elastic, limits).solve(wanted, np.empty((len(wanted), 6)))
        found = [q[i : i + 1][good[i : i + 1]] for i in range(len(wanted))]
        return found[0] if single else found
    solver = JointPoses(elastic, limits)
    begin = _starts(solver, starts, seed)
    k = len(begin)
    unwound = solver.unwound()
    q, good = unwound.solve(
        np.repeat(wanted, k, axis=0), np.tile(begin, (len(wanted), 1)), free, tolerance
    )
    if cost is not None and solver.redundancy(free):
        T, rows = np.repeat(wanted, k, axis=0), np.flatnonzero(good)
        for i in range(0, len(rows), _ROWS):
            block = rows[i : i + _ROWS]
            q[block] = settled(unwound, q[block], T[block], free, tolerance, cost)
    same = SAME if cost is None else 1e-3
    found = []
    for cell in range(len(wanted)):
        part = slice(cell * k, (cell + 1) * k)
        own = solver.within(q[part][good[part]])
        found.append(own[distinct(own, solver.periodic, solver.sizes, same)])
    return found[0] if single else found


def _starts(solver: JointPoses, starts: int | ArrayLike, seed: int) -> Array:
    n = solver.kinematics.n
    if isinstance(starts, (int, np.integer)) and not isinstance(starts, bool):
        if starts < 0:
            raise InputError("number of starts must not be negative", got=int(starts))
        begin = solver.random_starts(int(starts), np.random.default_rng(seed))
    else:
        begin = checked_array(starts, ("N", n), "array of starts")
    begin = np.vstack([solver.start, begin])
    return np.clip(begin, solver.lower, solver.upper)
