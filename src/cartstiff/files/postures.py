"""The posture of a mechanism whose file names none, and those that close a mechanism.

An arm whose file names no posture needs a regular one: zero is singular for nearly every
industrial arm. The candidates are points of a low-discrepancy sequence (Kronecker's with
the generalised golden ratio: the same every time) around zero, in a quarter, half and all
of the joints' ranges. The measure is the ratio of the smallest to the largest singular
value of the body Jacobian, lengths in units of the characteristic length at zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import ConvergenceError, InputError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain, ChainPosture
from cartstiff.core.mechanisms.closures import ReferencePosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.tree import KinematicTree
from cartstiff.core.notes import Note
from cartstiff.core.numerics import NEAR_SINGULARITY, is_regular
from cartstiff.files.assembly import Part
from cartstiff.files.description import RobotDescription

# Number of candidates per share of the joints' ranges. A larger share is searched only
# where the smaller ones have no candidate that is regular enough.
_CANDIDATES_PER_SHARE, _RANGE_SHARES = 32, (0.25, 0.5, 1.0)
# Number of candidates that are computed at once, the nearest to zero first.
_CANDIDATES_AT_ONCE = 16
# The candidate closest to zero with at least this ratio is taken: twice the ratio that
# counts as near a singularity.
_REGULAR_RATIO = 2.0 * NEAR_SINGULARITY
# An arm that at zero is at most this far below its base, in characteristic lengths, is
# taken to stand on a floor.
_MAX_DEPTH_ON_FLOOR = 0.1
# Candidates are rounded so that they can be typed (rad; lengths in shares of their
# range).
_ROUNDING_STEP = 0.05


def default_posture(
    tree: KinematicTree,
    values: Mapping[str, float],
    robot: RobotDescription,
    otherwise: Mapping[str, float],
) -> Array:
    """Default coordinates (n,): given values, then `otherwise`, a keyframe,
    the file's own posture.

    The own posture of a URDF is zero; where the limits exclude it, the middle of the
    limits is taken. Names need not be coordinates of the tree.
    """
    q, given = np.zeros(tree.n), {**otherwise, **values}
    for j, c in enumerate(tree.coordinates):
        q[j] = robot.posture.get(c.name, 0.0)
        if robot.keyframe is None and not c.lower <= q[j] <= c.upper:
            q[j] = np.clip(0.5 * (c.lower + c.upper), -1e9, 1e9)
        q[j] = given.get(c.name, q[j])
    return q


class _Search:
    """The search for a regular posture of an arm around q.

    Attributes
    ----------
    free : ndarray (n,)
        Which coordinates move: all but the virtual joints of compliant links.
    at_q : float
        Ratio of the singular values at q.
    """

    def __init__(self, chain: Chain, q: Array) -> None:
        self.chain, self.q = chain, q
        self.free = np.array([j not in chain.virtual for j in range(q.size)], bool)
        self.at: ChainPosture = chain.at(q)
        self._rows = np.repeat([1.0, 1.0 / self.at.length], 3)[:, None]
        self.at_q = float(self._ratios(self.at.motion.jacobian))

    def _ratios(self, jacobians: Array) -> Array:
        sized = jacobians * self._rows * self.at.coordinate_lengths
        return numerics.ratios(sized[..., self.free])

    def floor(self, alone: bool) -> float:
        """Height below which the arm must not come; -inf without a floor."""
        heights, depth = (
            _heights(self.chain, self.q),
            _MAX_DEPTH_ON_FLOOR * self.at.length,
        )
        lowest, first = heights.min(), next((z for z in heights if abs(z) > depth), 0.0)
        if lowest > -depth:
            return float(min(lowest, 0.0)) - numerics.NEGLIGIBLE_DIFFERENCE
        return -numerics.NEGLIGIBLE_DIFFERENCE if alone and first > 0.0 else -np.inf

    def best(self, floor: float) -> tuple[Array, float]:
        """The best candidate above the floor and its ratio; q where none is better."""
        best, largest = self.q, max(NEAR_SINGULARITY, self.at_q)
        few: Array
        for few in self._candidates():
            ratio = self._ratios(
                np.array([self.chain.at(q).motion.jacobian for q in few])
            )
            if np.isfinite(floor):
                ratio = ratio * [_heights(self.chain, q).min() > floor for q in few]
            enough = ratio >= _REGULAR_RATIO
            i = int(np.argmax(enough if enough.any() else ratio))
            if ratio[i] > largest:
                best, largest = few[i], float(ratio[i])
            if largest >= _REGULAR_RATIO:
                break
        return best, largest

    def _candidates(self) -> Array:
        """Postures (k, m, n) within the limits, by share and distance."""
        every, sizes, q = self.chain.coordinates, self.at.coordinate_lengths, self.q
        lower, upper = np.array([(c.lower, c.upper) for c in every]).T
        lengths = self.chain.is_length
        reach = np.where(lengths, sizes, np.pi)
        low, high = np.maximum(lower, q - reach), np.minimum(upper, q + reach)
        u = _sequence(q.size)
        sides = np.where(u < 0, q - low, high - q)
        steps = np.concatenate([share * u * sides for share in _RANGE_SHARES])
        step = np.where(lengths, _ROUNDING_STEP * (high - low), _ROUNDING_STEP)
        rounded = np.round(steps / np.where(step > 0, step, 1.0)) * step
        # Rounding to twelve digits makes 0.15 of 0.15000000000000002.
        postures = np.clip(np.round(q + rounded, 12), low, high)
        postures = np.where(self.free, postures, q)
        distances = np.linalg.norm((postures - q) / sizes, axis=1)
        shares = np.repeat(_RANGE_SHARES, _CANDIDATES_PER_SHARE)
        order = np.lexsort((distances, shares))
        ordered: Array = postures[order].reshape(-1, _CANDIDATES_AT_ONCE, q.size)
        return ordered


def regular_posture(chain: Chain, q: Array, *, alone: bool) -> tuple[Array, list[Note]]:
    """A regular posture (n,) in place of a nearly singular q, with a note that says so.

    q is returned where no candidate is better, and for arms with fewer than six joints:
    the note names a regular posture then. An arm that is not below its base at q, or
    whose joints rise from the base before they are below it, stays above the base.

    Parameters
    ----------
    chain : Chain
        A serial chain.
    q : ndarray (n,)
        Zero, or as near to it as the limits allow.
    alone : bool
        Whether the robot has no other arm, so that its base is on the floor and not on a
        torso.
    """
    if q.size - len(chain.virtual) < 2:
        return q, []
    search = _Search(chain, q)
    if search.at_q > NEAR_SINGULARITY:
        return q, []
    floor = search.floor(alone)
    best, largest = search.best(floor)
    if best is q and np.isfinite(floor):
        best, largest = search.best(-np.inf)
    if best is q:
        return q, []
    pairs = zip(chain.names, best, strict=True)
    shown = ", ".join(f"{name} {value:.4g}" for name, value in pairs)
    is_singular = not is_regular([1.0, search.at_q])
    if search.free.sum() < 6:
        words = f"no posture was given, and zero is singular: a regular one is {shown}"
        note = Note("zero-singular", words, {"q": best.tolist()})
        return q, [note] if is_singular else []
    zero, before = "singular", None
    if not is_singular:
        zero, before = "near a singularity", 1.0 / search.at_q
    words = (
        f"no posture was given, and zero is {zero}: a regular one is taken, {shown} "
        f"(condition of the scaled Jacobian {1.0 / largest:.3g})"
    )
    values = {"q": best.tolist(), "condition": 1.0 / largest, "condition_at_zero": before}
    return best, [Note("default-posture", words, values)]


def _heights(chain: Chain, q: Array) -> Array:
    """Heights of the joints on the way to the body, and of the body, over the base."""
    state, joints = chain.tree.at(q), chain.tree.support(chain.body.joint)
    return np.append(state.joint_poses(joints)[:, 2, 3], state.pose(chain.body)[2, 3])


@cache
def _sequence(n: int) -> Array:
    """Points (`_CANDIDATES_PER_SHARE`, n) of the sequence, from -1 to 1."""
    # The root g > 1 of g^(n+1) = g + 1: its powers are the hardest to approximate by
    # fractions.
    g = 2.0
    for _ in range(60):
        g = (1.0 + g) ** (1.0 / (n + 1))
    steps = np.outer(np.arange(1, _CANDIDATES_PER_SHARE + 1), g ** -np.arange(1.0, n + 1))
    points: Array = 2.0 * np.mod(0.5 + steps, 1.0) - 1.0
    return points


def assembled(
    chain: Chain, q: Array, posture: Mapping[str, float]
) -> tuple[Array, tuple[Note, ...]]:
    """Closed coordinates near q; without actuated joints, those of `posture` are held."""
    named = [] if chain.actuated else [chain.names.index(name) for name in posture]
    try:
        at = chain.closed(q, named=named)
    except ConvergenceError as error:
        raise InputError(f"{error}", expected="a posture near a closed one") from None
    chain.home = ReferencePosture(at.q, chain.held, at.coordinate_lengths)
    # If all are named, they are where the search starts.
    return at.q, chain.adjusted(q, at.q, named) if len(named) < len(q) else ()


# Number of random start postures of a leg, and the seed that makes them the same every
# time.
_RANDOM_STARTS, _SEED = 16, 0


def leg_at_pose(leg: Part, T_end_M: Array, T_F_M: Array) -> Array:
    """Return the coordinates (n,) of one leg at which the body has a pose.

    The search starts from the leg's posture and then from random ones within the limits;
    the first solution within the limits is taken, else the first of all. Virtual joints
    of compliant links, and springs of contacts, are held.

    Parameters
    ----------
    leg : Part
        The leg.
    T_end_M, T_F_M : ndarray (4, 4)
        Pose of the body in the leg's last frame, and the wanted pose of the body in F.

    Raises
    ------
    InputError
        If the leg does not reach the pose.
    """
    from cartstiff.kinematics.joint_poses import JointPoses

    held = {*leg.virtual(), *map(leg.called, leg.entry.contact_springs)}
    virtual = [j for j, n in enumerate(leg.tree.names) if leg.called(n) in held]
    chain = Chain(leg.tree, leg.frame, offset=T_end_M, virtual=virtual)
    elastic = ElasticMechanism(leg.leg, chain, leg.q)
    limited, free = JointPoses(elastic), JointPoses(elastic, limits=False)
    random = limited.random_starts(_RANDOM_STARTS, np.random.default_rng(_SEED))
    starts = np.concatenate([leg.q[None], random])
    poses = np.broadcast_to(se3.inverse(leg.base) @ T_F_M, (len(starts), 4, 4))
    for solver in (limited, free):
        postures, reached = solver.unwound().solve(poses, starts)
        if reached.any():
            return solver.within(postures[reached][:1])[0]
    left = np.abs(free.task(postures, poses, "none")[0]).max(axis=1).min()
    raise InputError(
        "the pose cannot be reached",
        where="key pose",
        expected="a pose that every leg reaches",
        got=f"{leg.leg}, which stays {left:.3g} (rad or characteristic lengths) away",
    )
