r"""Inverse kinematics: all postures at wanted poses that a number of starts lead to."""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args, overload

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_array,
    checked_flag,
    checked_pose,
    checked_seed,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.kinematics.joint_poses import Free, JointPoses, PlatformPoses
from cartstiff.kinematics.legs import Branches, Search, legs_of, searched, working_modes

#: Bound on the listed combinations of the legs' solutions, the nearest to the first
#: start.
MOST_LISTED = 4096
# Bound on those whose cost is minimised along their self-motions.
_MAX_MINIMISED = 256


@overload
def inverse_kinematics(
    elastic: ElasticMechanism,
    T_F_M: ArrayLike,
    starts: int | ArrayLike = ...,
    *,
    seed: int = ...,
    free: Free = ...,
    tolerance: float = ...,
    limits: bool = ...,
    cost: Callable[[Array], Array] | None = ...,
    most: int = ...,
    solver: JointPoses | None = ...,
) -> Branches: ...
@overload
def inverse_kinematics(
    elastic: ElasticMechanism,
    T_F_M: list[Array],
    starts: int | ArrayLike = ...,
    *,
    seed: int = ...,
    free: Free = ...,
    tolerance: float = ...,
    limits: bool = ...,
    cost: Callable[[Array], Array] | None = ...,
    most: int = ...,
    solver: JointPoses | None = ...,
) -> list[Branches]: ...


@checked
def inverse_kinematics(
    elastic: ElasticMechanism,
    T_F_M: ArrayLike | list[Array],
    starts: int | ArrayLike = 64,
    *,
    seed: int = 0,
    free: Free = "none",
    tolerance: float = numerics.CONSTRAINT_TOLERANCE,
    limits: bool = True,
    cost: Callable[[Array], Array] | None = None,
    most: int = MOST_LISTED,
    solver: JointPoses | None = None,
) -> Branches | list[Branches]:
    """All different postures at a pose that the starts lead to.

    Parameters
    ----------
    elastic : ElasticMechanism
        A chain of any number of joints, or a platform, whose pose is its coordinate.
    T_F_M : array_like, shape (4, 4) or (N, 4, 4)
        Wanted pose of the body frame, or N of them.
    starts : int or array_like, shape (k, n)
        Number of random starts within the limits, or the starts themselves. The default
        posture is always tried as well. Where a body is carried by legs, each leg has so
        many.
    seed : int
        Seed of the random starts; the same seed gives the same answer.
    free : {"none", "x", "y", "z", "rotation"}
        The body's rotation about one of its own axes is left free; or all of its
        rotation.
    tolerance : float
        Largest error of a solution, in rad and characteristic lengths.
    limits : bool
        Whether the joints' limits (a platform's leg limits) hold.
    cost : callable, optional
        For arms with self-motions: (k, n) postures to (k,) numbers of any unit, NaN where
        there is none; each solution is moved along its self-motion to where the number is
        smallest nearby. Its method ``slopes``, if it has one, gives the derivatives (k,
        n). Without a cost a solution is near its start: the steps there are the least
        ones.
    most : int
        Bound on the listed combinations of solutions of a body's legs, those nearest to
        the first start. `Search.found` counts all of them.
    solver : JointPoses, optional
        A solver made before for this mechanism of joints, whose limits hold instead.

    Returns
    -------
    Branches (k, n), or a list of N of them
        Different solutions within the limits, sorted by their coordinates; joints that
        can turn all the way are given in (-pi, pi] and count as equal modulo 2 pi. None
        found: k = 0. Its `search` says how many starts were made and what they found.
        Where a body is carried by legs, each leg is searched by itself and the postures
        are all combinations of what was found (`cartstiff.kinematics.legs`); any other
        closed chain is searched as a whole, and each start finds at most one posture.
        That the starts have found all of them is likely for an arm and for legs with many
        starts, and not proven.

    Raises
    ------
    InputError
        For poses that are no rigid motions, wrong shapes, or an unknown freedom.
    """
    check_name("free rotation", free, get_args(Free))
    limits = checked_flag(limits, "limits")
    wanted = checked_array(T_F_M, [(4, 4), ("N", 4, 4)], "array of poses")
    single = wanted.ndim == 2
    wanted = checked_pose(wanted.reshape(-1, 4, 4))
    if checked_elastic(elastic).mechanism.coordinates_are_pose:
        branches = _of_platform(PlatformPoses(elastic, limits), wanted)
        return branches[0] if single else branches
    solver = JointPoses(elastic, limits) if solver is None else solver
    begin, near = _starts(solver, starts, seed)
    # Legs are searched by themselves, other chains as a whole.
    legs = legs_of(elastic, limits)
    modes = legs and working_modes(legs, near, wanted, begin, free, tolerance, most)
    if not modes:
        every = searched(solver, wanted, begin, free, tolerance, cost)
        branches = [Branches(q, Search(len(begin), (), len(q), len(q))) for q in every]
    elif cost is not None and solver.redundancy(free):
        branches = []
        for T, q in zip(wanted, modes, strict=True):
            few = q[:_MAX_MINIMISED]
            (best,) = searched(solver, T[None], few, free, tolerance, cost)
            branches.append(Branches(best, q.search))
    else:
        branches = modes
    return branches[0] if single else branches


def _of_platform(solver: PlatformPoses, wanted: Array) -> list[Branches]:
    """The pose itself, where the legs' limits allow it."""
    q, good = solver.solve(wanted, np.empty((len(wanted), 6)))
    each = zip(q, good.tolist(), strict=True)
    return [Branches(x[None][:ok], Search(1, (), int(ok), int(ok))) for x, ok in each]


# Largest number of random starts: each is a posture in memory, with its search.
_MOST_STARTS = 10**6


def _starts(
    solver: JointPoses, starts: int | ArrayLike, seed: int
) -> tuple[Array, Array]:
    """The default posture and the starts, (k, n), and the first that was given."""
    n, first = solver.kinematics.n, 0
    if isinstance(starts, (int, np.integer)) and not isinstance(starts, bool):
        if starts < 0:
            raise InputError("number of starts must not be negative", got=int(starts))
        if starts > _MOST_STARTS:
            raise InputError("too many starts", expected=f"at most {_MOST_STARTS}")
        rng = np.random.default_rng(checked_seed(seed))
        begin = solver.random_starts(int(starts), rng)
    else:
        begin = checked_array(starts, ("N", n), "array of starts")
        first = min(1, len(begin))
    begin = np.clip(np.vstack([solver.start, begin]), solver.lower, solver.upper)
    return begin, begin[first]
