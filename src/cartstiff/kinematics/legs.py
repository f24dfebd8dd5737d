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

from cartstiff import numerics
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.joint_poses import SAME, Free, JointPoses, distinct
from cartstiff.mechanisms.chain import Chain, Closure
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.leg_shapes import PlacedLeg
from cartstiff.mechanisms.tree import FixedFrame
from cartstiff.mechanisms.tree_building import part_of


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
        (k, n) postures to (k,) numbers, NaN where there is none.
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
    """Derivatives of the cost (N, n) by differences.

    1, an arbitrary way out, without a cost.
    """
    steps = _DIFFERENCE * np.vstack([np.diag(sizes), -np.diag(sizes)])
    around = cost((q[:, None] + steps).reshape(-1, q.shape[1])).reshape(len(q), 2, -1)
    around = np.where(np.isfinite(around), around, value[:, None, None])
    with np.errstate(invalid="ignore"):
        slopes = (around[:, 0] - around[:, 1]) / (2 * _DIFFERENCE)
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
            if all(np.abs(key - keys[j]).max(initial=0.0) > same for j in kept):
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
    tree, body = chain.tree, chain.body.joint
    parents = [int(p) for p in tree.model.parents]
    ties = [
        (c, chain.placement(c.frame_a), chain.placement(c.frame_b))
        for c in chain.closures
    ]
    group = list(range(len(parents)))

    def leader(link: int) -> int:
        while group[link] != link:
            link = group[link]
        return link

    ends = {0, body}
    pairs = [(p, j) for j, p in enumerate(parents) if j > 0]
    for i, k in [*pairs, *((a.joint, b.joint) for _, a, b in ties)]:
        if i not in ends and k not in ends:
            group[leader(i)] = leader(k)
    path = tree.support(body)
    first = leader(path[0])  # the body itself where one joint carries it
    parts: dict[int, list[int]] = {first: []}
    for j in range(1, len(parents)):
        parts.setdefault(first if j == body else leader(j), []).append(j)
    held: dict[int, list[tuple[Closure, FixedFrame, FixedFrame]]] = {k: [] for k in parts}
    for tie in ties:
        _, a, b = tie
        free_ends = [leader(p.joint) for p in (a, b) if p.joint not in ends]
        held[free_ends[0] if free_ends else first].append(tie)
    legs = []
    columns_taken: set[int] = set()
    for key, joints in parts.items():
        if key != first and not held[key]:
            continue  # an open branch, as a finger: it does not move
        leg = _leg(elastic, chain, joints, held[key], key == first, limits, poses)
        if leg is None or columns_taken & set(leg.columns.tolist()):
            return None
        columns_taken |= set(leg.columns.tolist())
        legs.append(leg)
    return legs if len(legs) > 1 else None


def _leg(
    elastic: ElasticMechanism,
    chain: Chain,
    joints: list[int],
    ties: list[tuple[Closure, FixedFrame, FixedFrame]],
    carries: bool,
    limits: bool,
    poses: type[JointPoses],
) -> Leg | None:
    """One leg as a chain of its own."""
    body, parents = chain.body, chain.tree.model.parents
    roots = {int(parents[j]) for j in joints} - set(joints)
    if len(roots) != 1:
        return None  # on the base and on the body
    (root,) = roots
    hangs = root == body.joint and not carries
    far = 0 if hangs else body.joint
    tree, columns = part_of(chain.tree, joints, root)
    own = {0 if j == root else 1 + joints.index(j): j for j in [root, *joints]}
    local = {j: i for i, j in own.items()}
    before = after = np.eye(4)
    free: Free = "none"
    end = FixedFrame(local[body.joint], body.T_j_f) if carries else None
    closures = []
    for i, (closure, a, b) in enumerate(ties):
        if not carries and far in (a.joint, b.joint):
            if end is not None:
                return None  # holds the body twice
            ours, theirs = (b, a) if a.joint == far else (a, b)
            end = FixedFrame(local[ours.joint], ours.T_j_f)
            free = "none" if closure.type == "weld" else "rotation"
            if hangs:
                before, after = body.T_j_f, theirs.T_j_f
            else:
                after = se3.inverse(body.T_j_f) @ theirs.T_j_f
            continue
        names = [f"{_END}, closure {i + 1}{side}" for side in "ab"]
        for name, place in zip(names, (a, b), strict=True):
            tree.frames[name] = FixedFrame(local[place.joint], place.T_j_f)
        closures.append(Closure(names[0], names[1], closure.type))
    if end is None:
        return None
    tree.frames[_END] = end
    index = {int(c): i for i, c in enumerate(columns)}
    part = Chain(
        tree,
        _END,
        closures=closures,
        virtual=[index[v] for v in chain.virtual if v in index],
        kind=chain.kind,
    )
    solver = poses(ElasticMechanism(elastic.name, part, elastic.q[columns]), limits)
    distinguishing = set(chain.actuated or ())
    if (springs := elastic.springs) is not None:
        sprung = np.flatnonzero(springs.has_coordinate(len(chain.coordinates)))
        distinguishing |= set(sprung.tolist()) | springs.rigid
    compared = np.array([i for c, i in index.items() if c in distinguishing], int)
    real = tuple(c for c in columns.tolist() if c not in chain.virtual)
    closed = next((known for known in chain.legs if known.columns == real), None)
    return Leg(solver, part, columns, compared, before, after, hangs, free, closed)


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
        if not len(T):
            return []
        return leg.solutions(T, begin[:, leg.columns], near[leg.columns], free, tolerance)

    solutions = solved(first, wanted, free)
    # One case is one pose of the body: with a free rotation, one per solution of the
    # first leg.
    if free == "none":
        cases = [
            (i, own, T) for i, (own, T) in enumerate(zip(solutions, wanted, strict=True))
        ]
    else:
        cases = [
            (i, row[None], first.chain.at(row).pose)
            for i, own in enumerate(solutions)
            for row in own
        ]
    poses = np.array([T for _, _, T in cases]).reshape(-1, 4, 4)
    others = [solved(leg, poses, leg.free) for leg in legs[1:]]
    known = free == "none" and all(leg.is_known(near[leg.columns]) for leg in legs)
    starts = 0 if known else len(begin)
    result = []
    for i in range(len(wanted)):
        own = [k for k, case in enumerate(cases) if case[0] == i]
        sets = [[cases[k][1], *(part[k] for part in others)] for k in own]
        result.append(_combined(legs, sets, near, starts, most))
    return result


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
