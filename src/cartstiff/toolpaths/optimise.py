r"""The posture of best stiffness along a path: what to do with a free rotation or a spare joint.

A tool that is symmetric about its axis, or an arm with more joints than it needs, leaves a choice
at every point of a path. All branches of the inverse kinematics on a grid of the choice are
candidates; those near singularities are dropped, steps larger than a joint may make from point to
point are forbidden, and the best way through is found exactly among them by dynamic programming.
Then each point moves along its self-motion by ever smaller steps, again with the best way through
all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.checked_call import checked
from cartstiff.errors import InputError, UndefinedError, UnknownNameError, checked_kind
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.joint_poses import Free
from cartstiff.loading.collisions import NOT_CHECKED, Collisions
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import named_values
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.mechanisms.other_units import shown_factors
from cartstiff.numerics import NEAR
from cartstiff.stiffness.applied_load import checked_load
from cartstiff.toolpaths.candidates import (
    NEARBY,
    Choices,
    Counter,
    Layer,
    PathSolver,
    choices_of,
    layers,
    path_solver,
)
from cartstiff.toolpaths.cost import Judged, PathCost, criteria, ready
from cartstiff.toolpaths.dynamic_programming import Objective, Steps, best_way
from cartstiff.toolpaths.optimised import ConstantChoice, OptimisedPath
from cartstiff.toolpaths.tool_path import ToolPath
from cartstiff.vibration.chatter import Milling
from cartstiff.vibration.response import Damping

#: Characteristic lengths beyond which no robot reaches: the unit is another.
_FAR = 50.0


def colliding(point: int, count: int) -> UndefinedError:
    """The error for a point (counted from 0) that is reached in colliding postures only."""
    return UndefinedError(
        f"point {point + 1} of the path is reached only in postures in which links collide "
        f"({count} were compared)",
        code="path-colliding",
        values={"point": point + 1, "candidates": count},
    )


def impossible(
    elastic: ElasticMechanism,
    solver: PathSolver,
    point: int,
    pose: Array,
    grid: Choices,
    ratios: Array,
    singular: float,
) -> UndefinedError:
    """The error for a point (counted from 0) without any usable candidate."""
    values: dict[str, Any] = {"point": point + 1, "candidates": len(ratios)}
    here = f"point {point + 1} of the path"
    if not len(ratios):
        excess = solver.beyond_limits(grid.targets(pose), grid.task)
        if excess is None:
            away = float(np.linalg.norm(pose[:3, 3]))
            far = f": it is {away:.4g} away. Millimetres? Say --units mm, or x [mm] in the head"
            words = far if away > _FAR * solver.length else ""
            return UndefinedError(
                f"{here} is out of reach{words}", code="path-unreachable", values=values
            )
        name, amount = excess
        size = shown_factors(elastic).get(name, 1.0)
        units = dict(zip(elastic.names, elastic.names_with_units, strict=True))
        label = units.get(name, f"{name} [{elastic.units.length}]")
        return UndefinedError(
            f"{here} is reached only beyond the limits: {label} by {amount / size:.3g}",
            code="path-beyond-limits",
            values={**values, "limit_of": name, "beyond": amount},
        )
    best = float(ratios.max())
    if best < singular:
        return UndefinedError(
            f"{here} is reached only near singularities: smallest over largest singular value "
            f"{best:.3g}, and {singular:g} is required",
            code="path-near-singular",
            values={**values, "ratio": best, "threshold": singular},
        )
    return UndefinedError(
        f"{here}: the criterion exists in no posture that reaches it",
        code="path-without-stiffness",
        values={**values, "ratio": best},
    )


def broken(
    costs: list[Array], steps: Steps, bounds: Array, wound: Sequence[str] = ()
) -> UndefinedError:
    """The error for a path whose points all have candidates, but no continuous way through them.

    `wound` are joints that would follow if they could turn on beyond their limits.
    """
    _, reached = best_way(costs, steps, "mean")
    # The last layer that a way leads to; the next is reached by none of its candidates.
    i = len(reached) - 2
    a, b = reached[i], np.flatnonzero(np.isfinite(costs[i + 1]))
    share = np.where(steps.crosses(i, a, b), np.inf, steps.share(i, a, b))
    factor = float(share.min())
    if wound:
        reason = f"{', '.join(wound)} would have to turn on beyond the limits"
    elif not np.isfinite(factor):
        reason = "every step would pass through a singularity"
    else:
        reason = (
            f"a joint would have to make a step {factor:.3g} times as large as allowed; a finer "
            "path or a larger step may help"
        )
    return UndefinedError(
        f"no continuous way leads from point {i + 1} of the path to point {i + 2}: {reason}",
        code="path-discontinuous",
        values={
            "point": i + 2,
            "factor": factor if np.isfinite(factor) else None,
            "largest_step": bounds.tolist(),
            "wound": list(wound),
        },
    )


#: Largest step of a joint from point to point (rad, or characteristic lengths).
MAX_STEP = 0.5
# Refinements, each with half the step of the one before.
_LEVELS = 12


@checked
def optimise_path(
    elastic: ElasticMechanism,
    path: ToolPath,
    *,
    free: Free = "none",
    redundant: str | None = None,
    criterion: str = "deflection",
    connection: str | None = None,
    loaded: bool = False,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    objective: Objective = "worst",
    max_step: float | Mapping[str, float] | ArrayLike | None = None,
    singular: float = NEAR,
    smoothness: float = 1e-3,
    samples: int = 36,
    starts: int = 16,
    seed: int = 0,
    refine: bool = True,
    damping: Damping | float = 0.0,
    milling: Milling | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    near: Mapping[str, float] | ArrayLike | None = None,
    collisions: Collisions | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> OptimisedPath:
    r"""Postures of best stiffness along a path.

    Parameters
    ----------
    elastic : ElasticMechanism
        A serial arm or a platform with springs. Its rest positions are taken to be commanded: at
        each posture they carry gravity, and with `loaded` the path's wrench as well.
    path : ToolPath
        Poses of the body frame M, with wrenches or directions as the criterion asks.
    free : {"none", "x", "y", "z", "rotation"}
        The body's rotation about one of its axes (a spindle, a welding wire) is free; or all of
        its rotation is, which is sampled at random.
    redundant : str, optional
        The joint whose position is sampled where joints are left over; default the one without
        which the others move the body best.
    criterion : str
        A quantity of `cartstiff.toolpaths.cost.criteria`: "deflection" under the path's wrench,
        "along_free" for the stiffness along the path's directions, "translation_free_min", ...
    connection : {"load", "A", "B", "K", "F"}, optional
        The stiffness that is read; default "load", the tangent under the path's wrench, with
        `loaded`, and "B" without.
    loaded : bool
        Whether it is the stiffness under the path's wrench.
    load_kind : {"dead", "follower", "conservative"}
        What that wrench does while the body moves, as in `cartstiff.analyse`.
    load_at : array_like (3,)
        The point of the body, in M, about and at which the path's wrenches are given.
    objective : {"worst", "mean"}
        Make the worst point as good as possible, then the sum; or the sum alone. Where larger
        is better, what is added up is one over the value.
    max_step : float, mapping or array_like (n,), optional
        Largest step of each joint from one point to the next; default 0.5 rad, or half a
        characteristic length.
    singular : float
        Postures are left out whose smallest singular value of the length-scaled Jacobian is
        below this share of the largest, and steps through a singularity. 0 allows all.
    smoothness : float
        What a step adds to the sum in which every joint moves as far as it may, as a share of a
        point's typical cost; others add by the mean square. It decides where stiffness does not.
    samples : int
        Values of each free choice.
    starts, seed : int
        Random starts of the inverse kinematics for each value at the first point.
    refine : bool
        Move on continuously from the best of the samples.
    damping, milling
        For the criteria ``damping_1`` ... and ``limiting_depth``, as in `compute_map`.
    ranges : mapping of str to (low, high), optional
        Joints kept within ranges of their own, besides their limits.
    near : mapping or array_like (n,), optional
        A posture near which the path stays: all joints that turn within `NEARBY` of it.
    collisions : Collisions, optional
        Leaves out postures in which links collide; without it nothing is said of collisions.
    progress : callable, optional
        Called with (done, total) steps of the search.

    Returns
    -------
    OptimisedPath
        Coordinates and criterion along the path, and what the best constant choice gives.

    Raises
    ------
    InputError
        For a mechanism with closures or without springs, an unknown criterion, or one without
        the wrench or direction it needs.
    UndefinedError
        If the path cannot be followed, with the first point where it breaks (from 1): codes
        ``"path-unreachable"``, ``"path-beyond-limits"``, ``"path-near-singular"``,
        ``"path-without-stiffness"``, ``"path-discontinuous"``.
    """
    mechanism = checked_elastic(elastic).mechanism
    checked_kind(path, ToolPath, "path", "a ToolPath")
    connection = connection or ("load" if loaded else "B")
    if isinstance(mechanism, Chain) and mechanism.closures:
        raise InputError("paths are for serial arms and platforms", got=mechanism.kind)
    if free not in get_args(Free):
        raise UnknownNameError("free rotation", str(free), get_args(Free))
    if criterion not in criteria():
        raise UnknownNameError("criterion", criterion, criteria())
    if not 0.0 <= singular < 1.0:
        raise InputError(
            "singularity threshold cannot be used", expected="0 to below 1", got=singular
        )
    if not 0.0 <= smoothness < np.inf:
        raise InputError("smoothness cannot be used", expected="0 or more", got=smoothness)
    solver = path_solver(elastic, ranges, near)
    grid = choices_of(solver, free, redundant, samples, list(elastic.names))
    connection = connection or ("load" if loaded else "B")
    load = checked_load(load_kind, load_at, "body", given=path.wrenches is not None)
    if load.kind != "dead" and not loaded:
        raise InputError(
            "is for the stiffness under load", where="load_kind", expected="loaded as well"
        )
    cost = PathCost(
        ready(elastic),
        path,
        criteria()[criterion],
        connection,
        loaded,
        load,
        solver.length,
        solver.rank("none"),
        solver.movable,
        damping if isinstance(damping, Damping) else Damping(damping),
        milling,
    )
    levels = _LEVELS if refine and grid.dimension else 0
    advance = Counter(progress, 2 * len(path) + levels)
    search = _Search(
        solver,
        path,
        grid,
        cost,
        objective,
        _bounds(elastic, solver, max_step),
        singular,
        smoothness,
        collisions,
        advance,
    )
    candidates = layers(solver, path.poses, grid, starts, seed, advance=advance)
    q, constant = search.among(candidates)
    if levels:
        q = search.refined(q)
    judged, poses = search.judged(q, np.arange(len(path)))
    return OptimisedPath(
        elastic,
        path,
        q,
        poses,
        _angles(path, poses, free),
        judged.value,
        judged.ratio,
        cost.quantity,
        connection,
        loaded,
        load,
        free,
        None if grid.joint is None else elastic.names[grid.joint],
        constant,
        sum(len(layer.q) for layer in candidates),
        elastic.notes,
        NOT_CHECKED if collisions is None else collisions.as_dict(),
        singular > 0.0 if cost.rank == solver.movable.sum() else None,
        None if near is None else NEARBY,
    )


def _bounds(
    elastic: ElasticMechanism,
    solver: PathSolver,
    max_step: float | Mapping[str, float] | ArrayLike | None,
) -> Array:
    default = MAX_STEP * solver.sizes
    bounds = (
        default
        if max_step is None
        else named_values(max_step, elastic.names, default, "largest step")
    )
    if not np.all(bounds > 0):
        raise InputError("largest step must be above zero", got=bounds.tolist())
    return np.array(bounds)


def _angles(path: ToolPath, poses: Array, free: Free) -> Array | None:
    if free not in ("x", "y", "z"):
        return None
    relative = path.poses[:, :3, :3].swapaxes(1, 2) @ poses[:, :3, :3]
    turn = se3.log(se3.pose(relative))[:, "xyz".index(free)]
    return np.unwrap(turn)


class _Search:
    """The search for one path: judging candidates, and ways through them."""

    def __init__(
        self,
        solver: PathSolver,
        path: ToolPath,
        grid: Choices,
        cost: PathCost,
        objective: Objective,
        bounds: Array,
        singular: float,
        smoothness: float,
        collisions: Collisions | None,
        advance: Callable[[], None],
    ) -> None:
        self.solver, self.path, self.grid, self.cost = solver, path, grid, cost
        self.objective, self.bounds, self.singular = objective, bounds, singular
        self.smoothness, self.price = smoothness, 0.0
        self.collisions, self.advance = collisions, advance
        self.names = cost.elastic.names

    def judged(self, q: Array, points: Array) -> tuple[Judged, Array]:
        """Judgement of postures (N, n) at points (N,), and their poses."""
        poses = self.solver.kinematics.at(q).pose
        return self.cost(q, points, poses), poses

    def _costs(self, q: list[Array]) -> tuple[list[Judged], list[Array]]:
        """Judgement of each layer, and costs with what is near singularities ruled out."""
        counts = [len(rows) for rows in q]
        points = np.repeat(np.arange(len(q)), counts)
        whole, _ = self.judged(np.vstack(q), points)
        ends = np.cumsum(counts)[:-1]
        split = [Judged(*parts) for parts in zip(*(np.split(a, ends) for a in whole), strict=True)]
        costs = [np.where(j.ratio < self.singular, np.inf, j.cost) for j in split]
        return split, costs

    def _free_of_collisions(self, q: list[Array], costs: list[Array]) -> list[Array]:
        """Costs with what collides ruled out as well."""
        free = []
        for point, (rows, cost) in enumerate(zip(q, costs, strict=True)):
            self.advance()
            if self.collisions is not None:
                usable = np.flatnonzero(np.isfinite(cost))
                cost = cost.copy()
                cost[usable[self.collisions(rows[usable])]] = np.inf
                if usable.size and not np.isfinite(cost).any():
                    raise colliding(point, len(usable))
            free.append(cost)
        return free

    def among(self, candidates: list[Layer]) -> tuple[Array, ConstantChoice | None]:
        """Best postures (m, n) among candidates, and the best constant choice."""
        q, cells = [c.q for c in candidates], [c.cell for c in candidates]
        judged, costs = self._costs(q)
        for point, cost in enumerate(costs):
            if not np.isfinite(cost).any():
                pose, ratios = self.path.poses[point], judged[point].ratio
                raise impossible(
                    self.cost.elastic, self.solver, point, pose, self.grid, ratios, self.singular
                )
        costs = self._free_of_collisions(q, costs)
        self.price = self.smoothness * float(np.mean([cost.min() for cost in costs]))
        sides = [j.side for j in judged]
        way = self._way(q, costs, sides)
        if isinstance(way, UndefinedError):
            raise way
        return way[0], self._constant(q, cells, costs, judged)

    def _constant(
        self, q: list[Array], cells: list[Array], costs: list[Array], judged: list[Judged]
    ) -> ConstantChoice | None:
        if not self.grid.is_grid:
            return None
        best: tuple[float, ConstantChoice] | None = None
        least = np.full((len(costs), self.grid.count), np.inf)
        for row, cost, cell in zip(least, costs, cells, strict=True):
            np.minimum.at(row, cell[cell >= 0], cost[cell >= 0])
        # No way through a cell costs less than its cheapest candidates.
        bounds = least.max(axis=0) if self.objective == "worst" else least.sum(axis=0)
        sides = [j.side for j in judged]
        for cell in np.argsort(bounds, kind="stable"):
            if not bounds[cell] < (np.inf if best is None else best[0]):
                break
            own = [np.flatnonzero(c == cell) for c in cells]
            way = self._way(
                *(
                    [a[rows] for a, rows in zip(every, own, strict=True)]
                    for every in (q, costs, sides)
                )
            )
            if isinstance(way, UndefinedError):
                continue
            rows = [r[k] for r, k in zip(own, way[1], strict=True)]
            taken = np.array([c[k] for c, k in zip(costs, rows, strict=True)])
            size = float(taken.max() if self.objective == "worst" else taken.sum())
            if best is None or size < best[0]:
                values = np.array([j.value[k] for j, k in zip(judged, rows, strict=True)])
                best = size, ConstantChoice(self.grid.at(int(cell)), way[0], values)
        return None if best is None else best[1]

    def _way(
        self, q: list[Array], costs: list[Array], sides: list[Array]
    ) -> tuple[Array, list[int]] | UndefinedError:
        """Postures and indices of the best way, or the reason why there is none.

        Whole turns are left out of the comparison first: joints turn on as far as their limits let
        them. If they do not let one follow the way that was found, its turns become candidates of
        their own, and the way is sought anew.
        """
        periodic, index = self.solver.periodic.copy(), [np.arange(len(rows)) for rows in q]
        while True:
            costs_now = [c[rows] for c, rows in zip(costs, index, strict=True)]
            sides_now = [s[rows] for s, rows in zip(sides, index, strict=True)]
            steps = self.steps(q, periodic, sides_now)
            way, _ = best_way(costs_now, steps, self.objective)
            if way is None:
                wound = self.solver.periodic & ~periodic
                return broken(
                    costs_now, steps, self.bounds, [self.names[j] for j in wound.nonzero()[0]]
                )
            picked = np.array([rows[k] for rows, k in zip(q, way, strict=True)])
            followed, wound = self._turned_on(picked, periodic)
            if not wound.any():
                return followed, [int(rows[k]) for rows, k in zip(index, way, strict=True)]
            periodic = periodic & ~wound
            expanded = [self._all_turns(rows, wound) for rows in q]
            q = [rows for rows, _ in expanded]
            index = [old[rows] for old, (_, rows) in zip(index, expanded, strict=True)]

    def _turned_on(self, q: Array, periodic: Array) -> tuple[Array, Array]:
        """Coordinates without jumps of whole turns, and the joints whose limits forbid that."""
        q = np.where(periodic, np.unwrap(q, axis=0), q)
        wound = np.zeros(q.shape[1], bool)
        for j in np.flatnonzero(periodic):
            low, high = self.solver.lower[j], self.solver.upper[j]
            least = np.ceil((low - q[:, j].min()) / (2 * np.pi) - numerics.ROUNDING)
            most = np.floor((high - q[:, j].max()) / (2 * np.pi) + numerics.ROUNDING)
            wound[j] = least > most
            if not wound[j]:
                q[:, j] += 2 * np.pi * np.clip(0.0, least, most)
        return q, wound

    def _all_turns(self, q: Array, joints: Array) -> tuple[Array, Array]:
        """Postures with all turns of some joints within their limits, and the rows they are of."""
        rows = np.arange(len(q))
        for j in np.flatnonzero(joints):
            low, high = self.solver.lower[j], self.solver.upper[j]
            turns = np.arange(np.ceil((low - high) / (2 * np.pi)), (high - low) / (2 * np.pi) + 1)
            more = np.repeat(q, len(turns), axis=0)
            more[:, j] += 2 * np.pi * np.tile(turns, len(q))
            inside = (more[:, j] >= low) & (more[:, j] <= high)
            rows = np.repeat(rows, len(turns))[inside]
            q = more[inside]
        return q, rows

    def steps(self, q: list[Array], periodic: Array, sides: list[Array]) -> Steps:
        """What steps from layer to layer cost."""
        return Steps(q, periodic, self.bounds, self.price, sides if self.singular > 0 else None)

    def refined(self, q: Array) -> Array:
        """Postures moved along their self-motions, by steps that are halved again and again."""
        m, d = len(q), self.grid.dimension
        reach = (-2.0, -1.0, 1.0, 2.0) if d == 1 else (-1.0, 1.0)
        shifts = np.array(
            [s for s in product((0.0, *reach), repeat=d) if any(s)]
            if d <= 2
            else [s * e for e in np.eye(d) for s in reach]
        )
        points = np.repeat(np.arange(m), len(shifts))
        never = np.zeros(q.shape[1], bool)
        step = 0.5 * self.grid.spacing
        for _ in range(_LEVELS):
            motions = self.solver.self_motions(q, self.grid.free, d)
            begin = q[points] + step * (motions @ shifts.T).swapaxes(1, 2).reshape(-1, q.shape[1])
            begin = np.clip(begin, self.solver.lower, self.solver.upper)
            solved, good = self.solver.solve(self.path.poses[points], begin, self.grid.free)
            around = [np.vstack([q[i], solved[good & (points == i)]]) for i in range(m)]
            judged, costs = self._costs(around)
            if self.collisions is not None:
                for rows, cost in zip(around, costs, strict=True):
                    cost[self.collisions(rows)] = np.inf
            steps = self.steps(around, never, [j.side for j in judged])
            way, _ = best_way(costs, steps, self.objective)
            if way is not None:  # the present postures are among them, so there is one
                q = np.array([rows[k] for rows, k in zip(around, way, strict=True)])
            step *= 0.5
            self.advance()
        return q
