r"""Working modes: a body carried by legs, each of which has its own solutions at a pose.

At a given pose of the body the closed chain separates at the base and at the body: each
connected part between these two is a leg, whose coordinates depend on the pose only. The
postures at the pose are all combinations of the legs' solutions,

    number of postures = k_1 k_2 ... k_m        (six legs with two each: 64).

Two solutions of a leg are the same if its springs and actuators have equal coordinates
and every joint is at the same place: turning passive universal and spherical joints over
has no effect.

If self-motions make a family of postures, the best one is found by quasi-Newton steps
(BFGS) in the natural sizes of the coordinates: the part of the cost's slope along the
self-motions is followed, and each step is brought back to its pose. The change of that
part from one posture to the next gives the curvature of the cost along the family.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.chain import Chain, Closure
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.tree import FixedFrame, part_of
from cartstiff.kinematics.joint_poses import SAME, Free, JointPoses, distinct
from cartstiff.kinematics.leg_shapes import PlacedLeg


@dataclass(frozen=True)
class Search:
    """Method and number of postures of the search at a pose.

    Attributes
    ----------
    starts : int
        Starts of the search, for each leg if legs were searched one by one; 0 if all of
        them were known in closed form.
    legs : tuple of int
        Solutions found of each leg; empty if the mechanism was searched as a whole.
    found : int
        Different postures: all combinations of the legs' solutions, whether listed or
        not.
    listed : int
        Number of them in the result; those nearest to the default posture are listed.
    """

    starts: int
    legs: tuple[int, ...]
    found: int
    listed: int

    def __str__(self) -> str:
        legs = " x ".join(map(str, self.legs))
        how = f"{self.starts} starts a leg" if self.starts else "in closed form"
        whole = f"{self.found} found, {self.starts} starts"
        if legs:
            equal = prod(self.legs) == self.found
            combined = f"{legs} solutions of the legs" + (
                "" if equal else ", by pose of the body"
            )
            whole = f"{self.found} found: {combined}, {how}"
        return whole + (
            f"; the nearest {self.listed} are listed" if self.listed < self.found else ""
        )


class Branches(np.ndarray):
    """Postures (k, n) as an array, with the `Search` that found them.

    Attributes
    ----------
    search : Search or None
        None for parts of the array and what is computed from it.
    """

    search: Search | None

    def __new__(cls, q: Array, search: Search | None = None) -> Branches:
        """Array of postures."""
        branches = np.array(q, float).view(cls)
        branches.search = search
        return branches

    def __array_finalize__(self, other: object) -> None:
        """Parts of the array have no search."""
        self.search = None


# Steps along a self-motion, in the natural sizes of the coordinates: the first, the
# longest, and the largest at which the search ends; and the bound on their number.
_FIRST_STEP, _LONGEST_STEP, _LAST_STEP, _MAX_STEPS = (
    0.2,
    0.5,
    numerics.NEGLIGIBLE_STEP,
    200,
)
# Shares of the first slope, and of the cost, below which a slope counts as zero; and the
# bound on restarts at a slope that remains.
_FLAT, _NO_SLOPE, _MAX_RESTARTS = 1e-3, numerics.NEGLIGIBLE_SLOPE, 3
# Half the distance of the postures whose difference of costs gives a slope.
_DIFFERENCE = numerics.DIFFERENCE_STEP


def of_least_cost(
    solver: JointPoses,
    q: Array,
    T: Array,
    free: Free,
    tolerance: float,
    cost: Callable[[Array], Array],
) -> Array:
    """Postures (N, n) of locally least cost along the self-motions.

    Parameters
    ----------
    solver : JointPoses
        Brings postures back to their poses.
    q, T : ndarray, shapes (N, n) and (N, 4, 4)
        Postures and their poses.
    free : {"none", "x", "y", "z", "rotation"}
        Free part of the body's rotation.
    tolerance : float
        Largest error of the poses.
    cost : callable
        (k, n) postures to (k,) numbers, NaN where there is none. A method ``slopes`` has
        their derivatives (k, n), NaN where these are not known.
    """
    result, rows, sizes = q.copy(), np.arange(len(q)), solver.sizes
    if not len(q):
        return result
    value = _values(cost, q)
    J, slope = solver.task(q, T, free)[1], _slopes(cost, q, value, sizes)
    reach, moved, tries = np.ones(len(q)), np.zeros_like(q), np.zeros(len(q), int)
    before, unit = solver.along_self_motions(q, J, slope), np.eye(q.shape[1])
    first = _length(before)
    begin = np.where(np.isfinite(value), _FIRST_STEP, _LONGEST_STEP)
    inverse = _ratio(begin, first)[:, None, None] * unit
    for _ in range(_MAX_STEPS):
        along = solver.along_self_motions(q, J, slope)
        inverse = _updated(inverse, moved, along - before)
        step = solver.along_self_motions(q, J, slope, inverse)
        step *= (reach * np.minimum(1.0, _ratio(_LONGEST_STEP, _length(step))))[:, None]
        # At an edge of the cost the steps end on a slope, and restart along the steepest
        # descent.
        steep = _length(along)
        flat = steep <= np.where(np.isfinite(value), _NO_SLOPE * np.abs(value), 0.0)
        spent = flat | (_length(step) <= _LAST_STEP)
        again = spent & ~flat & (steep > _FLAT * first) & (tries < _MAX_RESTARTS)
        inverse[again] = _ratio(0.1 * _FIRST_STEP, steep[again])[:, None, None] * unit
        reach[again], tries[again] = 1.0, tries[again] + 1
        keep = ~spent | again
        result[rows] = q
        here = rows, q, T, J, value, slope, reach, inverse, along, step, first, tries
        kept: tuple[Any, ...] = tuple(array[keep] for array in here)
        rows, q, T, J, value, slope, reach, inverse, before, step, first, tries = kept
        if not rows.size:
            break
        trial = np.clip(q - step * sizes, solver.lower, solver.upper)
        trial, good = solver.solve(T, trial, free, tolerance)
        reached = np.where(good, _values(cost, trial), np.inf)
        better = reached < value - numerics.SUFFICIENT_DECREASE * (slope * step).sum(
            axis=1
        )
        # Without a cost, both senses are tried.
        reach = np.where(better, 1.0, np.where(np.isfinite(value), 0.3, -0.8) * reach)
        moved = np.where(better[:, None], trial - q, 0.0) / sizes
        q[better], value[better] = trial[better], reached[better]
        if better.any():
            J[better] = solver.task(q[better], T[better], free)[1]
            slope[better] = _slopes(cost, q[better], value[better], sizes)
    return result


def _values(cost: Callable[[Array], Array], q: Array) -> Array:
    return np.nan_to_num(cost(q), nan=np.inf)


def _slopes(
    cost: Callable[[Array], Array], q: Array, value: Array, sizes: Array
) -> Array:
    """Derivatives of the cost (N, n) in natural sizes: its own ``slopes``, and where
    there are none, differences.

    1, an arbitrary way out, without a cost.
    """
    own = getattr(cost, "slopes", None)
    slopes = np.full_like(q, np.nan) if own is None else own(q) * sizes
    rows = np.flatnonzero(~np.isfinite(slopes).all(axis=1))
    steps = _DIFFERENCE * np.vstack([np.diag(sizes), -np.diag(sizes)])
    around = (q[rows, None] + steps).reshape(-1, q.shape[1])
    if len(around):
        values = cost(around).reshape(len(rows), 2, -1)
        values = np.where(np.isfinite(values), values, value[rows, None, None])
        with np.errstate(invalid="ignore"):
            slopes[rows] = (values[:, 0] - values[:, 1]) / (2 * _DIFFERENCE)
    return np.where(np.isfinite(slopes), slopes, 1.0)


def _updated(inverse: Array, moved: Array, change: Array) -> Array:
    """Inverse Hessians that explain how the slopes have changed,
    where the cost curves upwards.
    """
    curved = np.einsum("ni,ni->n", moved, change)
    upwards = curved > numerics.SADDLE_STIFFNESS * _length(moved) * _length(change)
    scale = np.where(upwards, _ratio(1.0, curved), 0.0)
    left = (
        np.eye(moved.shape[1])
        - scale[:, None, None] * moved[:, :, None] * change[:, None, :]
    )
    return left @ inverse @ left.swapaxes(1, 2) + scale[:, None, None] * (
        moved[:, :, None] * moved[:, None, :]
    )


def _length(rows: Array) -> Array:
    return np.sqrt((rows * rows).sum(axis=1))


def _ratio(number: float | Array, array: Array) -> Array:
    quotient: Array = number / np.where(array == 0.0, np.inf, array)
    return quotient


# Postures that are optimised at once: the cost is computed at all of them and around
# each.
_ROWS = 5000
# Members of one family that reach the same posture of least cost differ by less than
# this.
_SAME_OPTIMUM = 1e-3
_END = "end of the leg"


def searched(
    solver: JointPoses,
    wanted: Array,
    begin: Array,
    free: Free,
    tolerance: float,
    cost: Callable[[Array], Array] | None,
) -> list[Array]:
    """For each of the poses (N, 4, 4) the different postures (k, n) that starts
    (m, n) lead to.
    """
    k, unwound = len(begin), solver.unwound()
    T = np.repeat(wanted, k, axis=0)
    q, good = unwound.solve(T, np.tile(begin, (len(wanted), 1)), free, tolerance)
    if cost is not None and solver.redundancy(free):
        rows = np.flatnonzero(good)
        for i in range(0, len(rows), _ROWS):
            block = rows[i : i + _ROWS]
            q[block] = of_least_cost(unwound, q[block], T[block], free, tolerance, cost)
    same, solutions = SAME if cost is None else _SAME_OPTIMUM, []
    q = solver.within(q)
    for cell in range(len(wanted)):
        part = slice(cell * k, (cell + 1) * k)
        own = q[part][good[part]]
        solutions.append(own[distinct(own, solver.periodic, solver.sizes, same)])
    return solutions


class Leg(NamedTuple):
    """A part of a closed chain that depends on the body's pose only.

    Its end must be at ``before @ T_F_M @ after``, or with the inverse of T_F_M for a leg
    that is rooted on the body; `columns` are its coordinates, `compared` those that
    distinguish solutions, besides the joints' places.
    """

    solver: JointPoses
    chain: Chain
    columns: NDArray[np.intp]
    compared: NDArray[np.intp]
    before: Array
    after: Array
    hangs: bool
    free: Free
    closed: PlacedLeg | None = None

    def is_known(self, near: Array) -> bool:
        """Whether the solutions with undeformed links follow from a closed form."""
        return self.closed is not None and not any(
            near[sorted(self.chain.virtual)].tolist()
        )

    def target(self, T_F_M: Array) -> Array:
        """Poses of the leg's end for poses (N, 4, 4) of the body."""
        return self.before @ (np.linalg.inv(T_F_M) if self.hangs else T_F_M) @ self.after

    def in_closed_form(self, poses: Array, near: Array, tolerance: float) -> list[Array]:
        """Solutions at poses of M, within the limits."""
        if self.closed is None:
            return []
        solver, shape = self.solver, self.closed.shape
        rows = np.array([j for j in range(len(near)) if j not in self.chain.virtual])
        solutions: list[list[Array]] = [[] for _ in poses]
        for mode in shape.modes:
            own, errors = shape.inverse(poses @ self.closed.T_M_end, mode)
            for i in np.flatnonzero(errors <= tolerance):
                q = near.copy()
                q[rows] = own[i]
                q = np.where(solver.periodic, solver.within(q[None])[0], q)
                if np.all((q >= solver.lower) & (q <= solver.upper)):
                    solutions[i].append(q)
        return [np.array(own).reshape(-1, len(near)) for own in solutions]

    def solutions(
        self, T_F_M: Array, begin: Array, near: Array, free: Free, tolerance: float
    ) -> list[Array]:
        """Different solutions (k, n) at each pose, the nearest to `near` first."""
        if not len(T_F_M):
            return []
        target, solver = self.target(T_F_M), self.solver

        def away(q: Array) -> Array:
            return self.squared_distances(q, near) ** 0.5

        if free == "none" and self.is_known(near):
            known = self.in_closed_form(T_F_M, near, tolerance)
            return [q[np.argsort(away(q), kind="stable")] for q in known]
        cost = away if solver.redundancy(free) else None
        by_pose = searched(
            solver,
            target,
            np.clip(begin, solver.lower, solver.upper),
            free,
            tolerance,
            cost,
        )
        same = 10 * SAME if cost is None else 10 * _SAME_OPTIMUM
        return [
            self._distinct(q[np.argsort(away(q), kind="stable")], same) for q in by_pose
        ]

    def squared_distances(self, q: Array, near: Array) -> Array:
        """Squared distances (k,) of solutions from one, in the coordinates'
        natural sizes.
        """
        d = (q - near) / self.solver.sizes
        d = np.where(self.chain.is_length, d, (d + np.pi) % (2 * np.pi) - np.pi)
        return np.asarray((d * d).sum(axis=-1))

    def _distinct(self, q: Array, same: float) -> Array:
        kept: list[int] = []
        keys = [self._key(row) for row in q]
        for i, key in enumerate(keys):
            if all(numerics.largest(key - keys[j]) > same for j in kept):
                kept.append(i)
        return q[kept]

    def _key(self, q: Array) -> Array:
        """Numbers that distinguish solutions: compared coordinates,
        and the joints' places.
        """
        posture, chain = self.chain.at(q), self.chain
        joints = range(1, chain.tree.model.njoints)
        places = [posture.pose_at(FixedFrame(j, np.eye(4)))[:3, 3] for j in joints]
        own = q[self.compared] / self.solver.sizes[self.compared]
        angles = own[~chain.is_length[self.compared]]
        return np.concatenate(
            [
                own[chain.is_length[self.compared]],
                np.cos(angles),
                np.sin(angles),
                np.ravel(places) / self.solver.length,
            ]
        )


def legs_of(
    elastic: ElasticMechanism, limits: bool = True, poses: type[JointPoses] = JointPoses
) -> list[Leg] | None:
    """The legs of a closed chain, that which carries the body frame first;
    None if it has none.

    `poses` is the class of their solvers.

    A chain of another shape, as if two legs share a joint or a leg holds the body twice,
    has to be searched as a whole.
    """
    chain = elastic.mechanism
    if not isinstance(chain, Chain) or not chain.closures or chain.body.joint == 0:
        return None
    legs, taken = [], set[int]()
    for part in _parts(chain):
        if not (part.carries or part.ties):
            continue  # an open branch, as a finger: it does not move
        leg = _leg(elastic, chain, part, limits, poses)
        if leg is None or taken & set(leg.columns.tolist()):
            return None
        taken |= set(leg.columns.tolist())
        legs.append(leg)
    return legs if len(legs) > 1 else None


#: A closure with its two ends.
_Tie = tuple[Closure, FixedFrame, FixedFrame]


class _Part(NamedTuple):
    """Joints of a leg, counted from 1.

    Attributes
    ----------
    joints : list of int
        Of the tree, ascending.
    ties : list of _Tie
        Closures that hold them.
    carries : bool
        Whether the body frame is on one of them.
    """

    joints: list[int]
    ties: list[_Tie]
    carries: bool

    def split(self, far: int) -> tuple[list[_Tie], list[_Tie]]:
        """Closures that hold a leg on a joint `far`, and those within it."""
        outer, inner = list[_Tie](), list[_Tie]()
        for tie in self.ties:
            is_end = not self.carries and far in (tie[1].joint, tie[2].joint)
            (outer if is_end else inner).append(tie)
        return outer, inner


def _parts(chain: Chain) -> list[_Part]:
    """Joints that are connected without base and body, the one with the body first."""
    tree, body = chain.tree, chain.body.joint
    parents = tree.model.parents.tolist()
    ties = [
        (c, chain.placement(c.frame_a), chain.placement(c.frame_b))
        for c in chain.closures
    ]
    ends = {0, body}
    pairs = [*enumerate(parents), *((a.joint, b.joint) for _, a, b in ties)]
    group = _groups(len(parents), [pair for pair in pairs if not ends & {*pair}])
    # The body itself where one joint carries it.
    first = group[body] = group[tree.support(body)[0]]
    parts = {first: _Part([], [], True)}
    for j in range(1, len(parents)):
        parts.setdefault(group[j], _Part([], [], False)).joints.append(j)
    for tie in ties:
        free = [group[place.joint] for place in tie[1:] if place.joint not in ends]
        parts[free[0] if free else first].ties.append(tie)
    return list(parts.values())


def _groups(n: int, pairs: list[tuple[int, int]]) -> list[int]:
    """The group, a number below n, of each of n things some of which are connected."""
    group = list(range(n))
    for i, k in pairs:
        old, new = group[i], group[k]
        group = [new if g == old else g for g in group]
    return group


def _leg(
    elastic: ElasticMechanism,
    chain: Chain,
    part: _Part,
    limits: bool,
    poses: type[JointPoses],
) -> Leg | None:
    """One leg as a chain of its own."""
    body, parents, (joints, _, carries) = chain.body, chain.tree.model.parents, part
    roots = {int(parents[j]) for j in joints} - set(joints)
    if len(roots) != 1:
        return None  # on the base and on the body
    (root,) = roots
    hangs = root == body.joint and not carries
    far = 0 if hangs else body.joint
    outer, inner = part.split(far)
    if len(outer) + carries != 1:
        return None  # holds the body twice, or not at all
    tree, columns = part_of(chain.tree, joints, root)
    local = {root: 0} | {j: i for i, j in enumerate(joints, start=1)}
    end, before, after, free = _end_of(body, outer, far)
    tree.frames[_END] = FixedFrame(local[end.joint], end.T_j_f)
    closures = []
    for i, (closure, a, b) in enumerate(inner, start=1):
        one, other = f"{_END}, closure {i}a", f"{_END}, closure {i}b"
        tree.frames[one] = FixedFrame(local[a.joint], a.T_j_f)
        tree.frames[other] = FixedFrame(local[b.joint], b.T_j_f)
        closures.append(Closure(one, other, closure.type))
    index = {int(c): i for i, c in enumerate(columns)}
    own = Chain(
        tree,
        _END,
        closures=closures,
        virtual=[index[v] for v in index.keys() & chain.virtual],
        kind=chain.kind,
    )
    solver = poses(ElasticMechanism(elastic.name, own, elastic.q[columns]), limits)
    compared = [index[c] for c in index.keys() & _distinguishing(elastic, chain)]
    return Leg(
        solver,
        own,
        columns,
        np.array(sorted(compared), int),
        before,
        after,
        hangs,
        free,
        _known(chain, columns),
    )


def _end_of(
    body: FixedFrame, outer: list[_Tie], far: int
) -> tuple[FixedFrame, Array, Array, Free]:
    """Frame at the end of a leg, the body before and behind it, and what is free there.

    The body frame, if the leg carries it; else where a closure holds the leg on the joint
    `far`: the body's, or the base of a leg that hangs on the body.
    """
    unit = np.eye(4)
    if not outer:
        return body, unit, unit, "none"
    ((closure, a, b),) = outer
    end, theirs = (b, a) if a.joint == far else (a, b)
    free: Free = "none" if closure.type == "weld" else "rotation"
    if far == body.joint:
        return end, unit, se3.inverse(body.T_j_f) @ theirs.T_j_f, free
    return end, body.T_j_f, theirs.T_j_f, free


def _known(chain: Chain, columns: NDArray[np.intp]) -> PlacedLeg | None:
    """The leg's kinematics in closed form, if they are known."""
    real = tuple(c for c in columns.tolist() if c not in chain.virtual)
    return next((known for known in chain.legs if known.columns == real), None)


def _distinguishing(elastic: ElasticMechanism, chain: Chain) -> set[int]:
    """Coordinates that distinguish solutions: those with drives or springs."""
    driven, springs = set(chain.actuated or ()), elastic.springs
    if springs is None:
        return driven
    sprung = np.flatnonzero(springs.has_coordinate(len(chain.coordinates)))
    return driven | set(sprung.tolist()) | springs.rigid


def working_modes(
    legs: list[Leg],
    near: Array,
    wanted: Array,
    begin: Array,
    free: Free,
    tolerance: float,
    most: int,
) -> list[Branches] | None:
    """Postures at poses (N, 4, 4): all combinations of the legs' solutions,
    at most `most` of them.

    Parameters
    ----------
    legs : list of Leg
        From `legs_of`.
    near : ndarray (n,)
        Coordinates that no leg moves; of too many combinations the nearest ones are
        listed.
    wanted, begin : ndarray, shapes (N, 4, 4) and (m, n)
        Poses of the body, and starts.
    free, tolerance, most
        As of `cartstiff.kinematics.inverse.inverse_kinematics`.

    Returns
    -------
    list of N Branches, or None
        None if the body has a free rotation for which its first leg is redundant.
    """
    first = legs[0]
    if free != "none" and first.solver.redundancy(free):
        return None

    def solved(leg: Leg, T: Array, free: Free) -> list[Array]:
        return leg.solutions(T, begin[:, leg.columns], near[leg.columns], free, tolerance)

    solutions = solved(first, wanted, free)
    cases = _cases(first.chain, solutions, wanted, free)
    poses = np.concatenate([wanted[:0], *(T for _, T in cases)])
    others = [iter(solved(leg, poses, leg.free)) for leg in legs[1:]]
    known = free == "none" and all(leg.is_known(near[leg.columns]) for leg in legs)
    starts, result = 0 if known else len(begin), []
    for owns, _ in cases:
        sets = [[own, *map(next, others)] for own in owns]
        result.append(_combined(legs, sets, near, starts, most))
    return result


def _cases(
    chain: Chain, solutions: list[Array], wanted: Array, free: Free
) -> list[tuple[list[Array], Array]]:
    """Solutions of the first leg by poses of the body, and these (k, 4, 4), for each
    wanted pose: with a free rotation one pose per solution.
    """
    if free == "none":
        return [([q], T[None]) for q, T in zip(solutions, wanted, strict=True)]
    cases = []
    for q in solutions:
        poses = np.array([chain.at(row).pose for row in q]).reshape(-1, 4, 4)
        cases.append((list(q[:, None]), poses))
    return cases


def _combined(
    legs: list[Leg], sets: list[list[Array]], near: Array, starts: int, most: int
) -> Branches:
    """The nearest combinations of the legs' solutions, sorted by their coordinates."""
    total, rows, distances = 0, [near[None][:0]], [np.empty(0)]
    for solutions in sets:
        total += prod(map(len, solutions))
        if not all(map(len, solutions)):
            continue
        q, distance = near[None].copy(), np.zeros(1)
        for leg, own in zip(legs, solutions, strict=True):
            of_leg = leg.squared_distances(own, near[leg.columns])
            both = (distance[:, None] + of_leg).ravel()
            # Nothing that is left out here can be among the nearest combinations.
            keep = np.argsort(both, kind="stable")[:most]
            i, k = np.unravel_index(keep, (len(distance), len(own)))
            q, distance = q[i], both[keep]
            q[:, leg.columns] = own[k]
        rows.append(q)
        distances.append(distance)
    q = np.vstack(rows)[np.argsort(np.concatenate(distances), kind="stable")[:most]]
    q = q[np.lexsort(np.round(q / (10 * SAME)).T[::-1])]
    each = tuple(sum(len(s[i]) for s in sets) for i in range(len(legs)))
    return Branches(q, Search(starts, each, total, len(q)))
