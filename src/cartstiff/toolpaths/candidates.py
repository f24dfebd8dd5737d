"""Candidates for the points of a path: every posture that a grid of the free choices leads to.

From point to point the branches found are followed, and a few random starts look for new ones. What
is found in a cell is looked for in its neighbours: a cell is one value of each free choice, a turn
about the tool's axis or a spare joint's position.

The best way through layers of candidates, one of each, where not every step is allowed.

Dynamic programming, exact: first the way whose worst candidate is least, then among all ways that
are no worse the one of least sum. Costs are not negative; what costs infinitely much is never
taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from cartstiff import numerics
from cartstiff.arrays import checked_seed
from cartstiff.errors import InputError, UnknownNameError, check_name
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.joint_poses import SAME, Free, JointPoses, PlatformPoses, distinct
from cartstiff.mechanisms.contract import named_values
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform

#: What is made small: the worst cost (and after it the sum), or the sum alone.
Objective = Literal["worst", "mean"]

# Costs are equal within this: the worst one must not exclude itself by rounding.
_EQUAL = 1.0 + numerics.ROUNDING
# Candidates of a layer that are tried at first; four times as many each time after.
_FEW = 100


def best_way(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    objective: Objective = "worst",
) -> tuple[list[int] | None, list[Array]]:
    """One candidate of each layer.

    Parameters
    ----------
    costs : sequence of ndarray (c_i,)
        Costs of the candidates of each layer.
    steps : callable
        ``steps(i, a, b)`` gives what steps from candidates a (indices in layer i) to candidates b
        (in layer i + 1) add to the sum, infinite where one is forbidden: (len(a), len(b)).
    objective : {"worst", "mean"}
        See `Objective`.

    Returns
    -------
    way : list of int, or None
        Indices; None if no way goes through all layers.
    reached : list of ndarray
        Candidates of each layer that some way from the first layer leads to, as far as any does.
    """
    check_name("objective", objective, get_args(Objective))
    usable = [np.flatnonzero(np.isfinite(c)) for c in costs]
    if objective == "worst":
        total, reached, _ = _among_few(costs, steps, usable, worst=True)
        if total is None:
            return None, reached
        bound = float(total.min())
        better = [rows[c[rows] < bound] for c, rows in zip(costs, usable, strict=True)]
        if all(map(len, better)):
            total, *_ = _forward(costs, steps, _linked(steps, better), worst=True)
            bound = bound if total is None else float(total.min())
        usable = [rows[c[rows] <= bound * _EQUAL] for c, rows in zip(costs, usable, strict=True)]
    total, reached, origins = _among_few(costs, steps, usable, worst=False)
    if total is not None:
        # A way through a candidate costs at least it and the cheapest of all other layers.
        least = [float(c[rows].min()) for c, rows in zip(costs, usable, strict=True)]
        spare = float(total.min()) * _EQUAL - sum(least)
        usable = [
            rows[c[rows] <= own + spare] for c, rows, own in zip(costs, usable, least, strict=True)
        ]
        total, reached, origins = _forward(costs, steps, _linked(steps, usable), worst=False)
    if total is None:
        return None, reached
    k = int(np.argmin(total))
    way = [int(reached[-1][k])]
    for origin, layer in zip(reversed(origins), reversed(reached[:-1]), strict=True):
        k = int(origin[k])
        way.append(int(layer[k]))
    return way[::-1], reached


_Ways = tuple[Array | None, list[Array], list[Array]]


def _among_few(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    usable: Sequence[Array],
    worst: bool,
) -> _Ways:
    """`_forward` among the cheapest of each layer: ever more, until there is a way, or all."""
    count, most = _FEW, max(map(len, usable))
    while count < most:
        few = [
            np.sort(rows[np.argsort(c[rows], kind="stable")[:count]])
            for c, rows in zip(costs, usable, strict=True)
        ]
        way = _forward(costs, steps, few, worst)
        if way[0] is not None:
            return way
        count *= 4
    return _forward(costs, steps, usable, worst)


def _linked(steps: Callable[[int, Array, Array], Array], usable: Sequence[Array]) -> list[Array]:
    """What the smallest layer can be reached from, or reaches: a way goes through nothing else."""
    linked = list(usable)
    smallest = int(np.argmin([len(rows) for rows in usable]))
    for i in range(smallest - 1, -1, -1):
        linked[i] = linked[i][np.isfinite(steps(i, linked[i], linked[i + 1])).any(axis=1)]
    for i in range(smallest + 1, len(linked)):
        linked[i] = linked[i][np.isfinite(steps(i - 1, linked[i - 1], linked[i])).any(axis=0)]
    return linked


def _forward(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    usable: Sequence[Array],
    worst: bool,
) -> _Ways:
    """Costs of the best ways to the last layer, candidates reached, and whence each is reached."""
    reached, origins = [usable[0]], []
    total = costs[0][usable[0]]
    for i in range(1, len(costs)):
        a, b = reached[-1], usable[i]
        if not a.size:
            break
        step = steps(i - 1, a, b)
        # The worst candidate is what counts: a step is free or forbidden.
        step = np.where(np.isfinite(step), 0.0, np.inf) if worst else step
        arriving = total[:, None] + step
        origin = np.argmin(arriving, axis=0)
        before = arriving[origin, np.arange(b.size)]
        reachable = np.isfinite(before)
        reached.append(b[reachable])
        origins.append(origin[reachable])
        own = costs[i][b[reachable]]
        total = np.maximum(before[reachable], own) if worst else before[reachable] + own
    complete = len(reached) == len(costs) and reached[-1].size > 0
    return (total if complete else None), reached, origins


class Steps:
    """What a step of the coordinates costs: forbidden beyond a bound, dearer the larger below it.

    Parameters
    ----------
    q : sequence of ndarray (c_i, n)
        Coordinates of the candidates.
    periodic : ndarray of bool (n,)
        Coordinates of which whole turns do not count.
    bounds : ndarray (n,)
        Largest step of each.
    price : float
        Price of a step in which every coordinate reaches its bound; others cost by the mean square.
    sides : sequence of ndarray (c_i,), optional
        A step from one number to another is forbidden.
    """

    def __init__(
        self,
        q: Sequence[Array],
        periodic: Array,
        bounds: Array,
        price: float = 0.0,
        sides: Sequence[Array] | None = None,
    ) -> None:
        self.q, self.periodic, self.bounds, self.price = q, periodic, bounds, price
        self.sides = sides

    def crosses(self, i: int, a: Array, b: Array) -> Array:
        """Which steps change sides: bool (len(a), len(b))."""
        if self.sides is None:
            return np.zeros((len(a), len(b)), bool)
        changed: Array = self.sides[i][a][:, None] != self.sides[i + 1][b]
        return changed

    def _shares(self, i: int, a: Array, b: Array) -> Iterator[Array]:
        """Step over bound, coordinate by coordinate: each (len(a), len(b))."""
        for j, bound in enumerate(self.bounds):
            step = self.q[i + 1][b, j] - self.q[i][a, j][:, None]
            if self.periodic[j]:
                step = step - 2 * np.pi * np.round(step / (2 * np.pi))
            yield step / bound

    def share(self, i: int, a: Array, b: Array) -> Array:
        """Largest step over its bound, of all coordinates: (len(a), len(b))."""
        worst = np.zeros((len(a), len(b)))
        for share in self._shares(i, a, b):
            np.maximum(worst, np.abs(share), out=worst)
        return worst

    def __call__(self, i: int, a: Array, b: Array) -> Array:
        """Cost of steps from candidates a of layer i to candidates b of the next."""
        square, worst = np.zeros((2, len(a), len(b)))
        for share in self._shares(i, a, b):
            share = share * share
            square += share
            np.maximum(worst, share, out=worst)
        allowed = (worst <= 1.0) & ~self.crosses(i, a, b)
        return np.where(allowed, self.price / len(self.bounds) * square, np.inf)


#: What finds postures at poses: for joints, or for platforms.
PathSolver = JointPoses | PlatformPoses
#: Joints that turn stay so near to a required posture (rad).
NEARBY = 0.5 * np.pi


@dataclass(frozen=True, eq=False)
class Choices:
    """The grid of free choices.

    Attributes
    ----------
    free : {"none", "x", "y", "z", "rotation"}
        Rotation left free.
    angles : ndarray (a,), or None
        Turns about the tool's axis from the path's own pose (rad).
    joint : int or None
        The joint whose position is chosen.
    positions : ndarray (b,), or None
        Its positions.
    dimension : int
        Dimension of the self-motions, all choices together.
    size : float
        Natural size of the joint's coordinate.
    """

    free: Free
    angles: Array | None
    joint: int | None
    positions: Array | None
    dimension: int
    size: float = 1.0

    @property
    def shape(self) -> tuple[int, int]:
        """Number of angles and of positions, 1 where there is no choice."""
        return _size(self.angles), _size(self.positions)

    @property
    def count(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    @property
    def is_grid(self) -> bool:
        """Whether the cells are values of every free choice, and a constant choice means one."""
        count = (self.angles is not None) + (self.positions is not None)
        return count == self.dimension > 0

    def at(self, cell: int) -> dict[str, float]:
        """The choices of a cell: "angle" and "position", as far as they exist."""
        a, b = divmod(cell, _size(self.positions))
        values = {}
        if self.angles is not None:
            values["angle"] = float(self.angles[a])
        if self.positions is not None:
            values["position"] = float(self.positions[b])
        return values

    @property
    def task(self) -> Free:
        """Rotation that is free in a cell."""
        return "none" if self.angles is not None else self.free

    def targets(self, pose: Array) -> Array:
        """Wanted poses (cells, 4, 4) at a point."""
        if self.angles is None:
            return np.broadcast_to(pose, (self.count, 4, 4))
        turned = _turned_about(pose, self.free, self.angles)
        return np.repeat(turned, _size(self.positions), axis=0)

    @property
    def position_spacing(self) -> float:
        """Distance of neighbouring positions, in natural sizes."""
        v = self.positions
        return 0.2 if v is None else float(v[1] - v[0]) / self.size

    @property
    def spacing(self) -> float:
        """Distance of neighbouring cells, the larger of both; in rad and natural sizes."""
        steps = [] if self.angles is None else [float(self.angles[1] - self.angles[0])]
        if self.positions is not None:
            steps.append(self.position_spacing)
        return max(steps, default=0.2)


def _size(values: Array | None) -> int:
    return 1 if values is None else len(values)


def _turned_about(poses: Array, axis: str, angle: Array) -> Array:
    """Poses turned about one of their own axes by angles, all broadcast together."""
    twist = np.zeros((*np.shape(angle), 6))
    twist[..., "xyz".index(axis)] = angle
    turned: Array = poses @ se3.exp(twist)
    return turned


def choices_of(
    solver: PathSolver, free: Free, redundant: str | None, samples: int, names: list[str]
) -> Choices:
    """The grid for a mechanism and a freedom.

    Raises
    ------
    InputError
        If a redundant joint is named where there is none to choose, or too few samples.
    """
    if samples < 3:
        raise InputError("too few samples of a free choice", expected="3 or more", got=samples)
    dimension, left = solver.redundancy(free), solver.redundancy("none")
    if redundant is not None and redundant not in names:
        raise UnknownNameError("joint", redundant, names)
    if redundant is not None and left < 1:
        raise InputError(f"no joint is left over here: {redundant!r} cannot be chosen")
    angles = positions = joint = None
    if free in ("x", "y", "z") and dimension > left:
        angles = -np.pi + 2 * np.pi * np.arange(samples) / samples
    if left > 0 and free != "rotation" and isinstance(solver, JointPoses):
        joint = _most_idle(solver) if redundant is None else names.index(redundant)
        low, high = (bound[joint] for bound in solver.region())
        if solver.periodic[joint]:
            positions = low + (high - low) * np.arange(samples) / samples
        else:
            positions = np.linspace(low, high, samples)
    size = 1.0 if joint is None else float(solver.sizes[joint])
    return Choices(free, angles, joint, positions, dimension, size)


def _most_idle(solver: JointPoses) -> int:
    """The joint that moves most with the self-motion, even where it moves little.

    Where a joint does not move while the others move, its position tells nothing about theirs.
    """
    q = solver.random_starts(200, np.random.default_rng(0))
    moving = solver.self_motions(q, "none", solver.redundancy("none")) / solver.sizes[:, None]
    least = np.quantile(np.linalg.norm(moving, axis=2), 0.1, axis=0)
    return int(np.argmax(np.round(least, 6)))


class Counter:
    """Counts the steps of a search for who wants to see them."""

    def __init__(self, progress: Callable[[int, int], None] | None, total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def __call__(self) -> None:
        """One step more."""
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)


def path_solver(
    elastic: ElasticMechanism,
    ranges: Mapping[str, tuple[float, float]] | None,
    near: Mapping[str, float] | ArrayLike | None,
) -> PathSolver:
    """What finds postures, within the ranges that were asked for."""
    if isinstance(elastic.mechanism, Platform):
        if ranges or near is not None:
            raise InputError(
                "ranges and a posture nearby are for joints",
                got="a platform, whose pose the path says",
            )
        return PlatformPoses(elastic)
    solver = JointPoses(elastic)
    if ranges:
        solver = solver.narrowed(ranges)
    if near is not None:
        q = named_values(near, elastic.names, elastic.q, "posture nearby")
        turning = [
            (c.name, float(x))
            for c, x in zip(elastic.mechanism.coordinates, q, strict=True)
            if not c.is_length
        ]
        solver = solver.narrowed(
            {name: (x - NEARBY, x + NEARBY) for name, x in turning}, "neighbourhood"
        )
    return solver


# Random starts a cell has at each point but the first.
_MORE = 2
# Of the cells that differ in the sampled joint's position alone one in so many has starts of its
# own: they are solved with that joint free, and what they find is followed through all of them.
_EVERY = 6
_NONE = np.empty(0, int)


class Layer(NamedTuple):
    """Candidates of one point: coordinates (c, n) and the cell (c,) of each.

    A candidate between the positions of the sampled joint is in no cell: -1 less the index of its
    angle.
    """

    q: Array
    cell: Array


def layers(
    solver: PathSolver,
    poses: Array,
    grid: Choices,
    starts: int,
    seed: int,
    tolerance: float = numerics.REACHED,
    advance: Callable[[], None] | None = None,
) -> list[Layer]:
    """Candidates for each pose (m, 4, 4), within the limits, up to the first that has none.

    At the first point each cell has `starts` random starts. `advance` is called after each point.
    """
    rng = np.random.default_rng(checked_seed(seed))
    layers: list[Layer] = []
    for pose in poses:
        cells = _Cells(solver, grid, grid.targets(pose), tolerance)
        more = starts if not layers or not grid.is_grid else _MORE
        before = layers[-1] if layers else Layer(solver.start[None][:0], _NONE)
        inside = before.cell >= 0
        begin = Layer(before.q[inside], before.cell[inside])
        layer = cells.solved(_joined(begin, cells.random(more, rng)))
        # At first everything is looked for next door; later what a neighbour seems to lack.
        frontier = cells.spread(layer, cells.lonely(layer) if layers else None)
        while len(frontier.q):
            new = cells.new(layer, cells.solved(frontier))
            layer = _joined(layer, new)
            frontier = cells.spread(new)
        layers.append(cells.traced(layer, Layer(before.q[~inside], before.cell[~inside])))
        if advance is not None:
            advance()
        if not len(layers[-1].q):
            break
    return layers


def _joined(a: Layer, b: Layer) -> Layer:
    return Layer(np.vstack([a.q, b.q]), np.concatenate([a.cell, b.cell]))


class _Cells:
    """The cells of one point. What is found in one is looked for in its neighbours."""

    def __init__(self, solver: PathSolver, grid: Choices, targets: Array, tolerance: float) -> None:
        self.solver, self.grid, self.targets, self.tolerance = solver, grid, targets, tolerance
        self.shape = grid.shape

    def random(self, count: int, rng: np.random.Generator) -> Layer:
        """Random starts, and the default posture.

        Where a joint is sampled, postures at the pose are found with that joint free, and start in
        the cells on both sides of where it came to rest.
        """
        solver, grid = self.solver, self.grid
        every = 1 if grid.positions is None else min(_EVERY, len(grid.positions))
        cells = np.repeat(np.arange(0, grid.count, every), count + 1)
        q = solver.random_starts(len(cells), rng)
        if not len(q):  # a platform: one posture at every pose
            return Layer(np.tile(solver.start, (grid.count, 1)), np.arange(grid.count))
        q[:: count + 1] = np.clip(solver.start, solver.lower, solver.upper)
        if grid.joint is None or grid.positions is None:
            return Layer(q, cells)
        q, good = solver.solve(self.targets[cells], q, grid.task, self.tolerance)
        q, cells = solver.within(q[good]), cells[good]
        b = len(grid.positions)
        after = np.searchsorted(grid.positions, q[:, grid.joint])
        sides = [np.clip(after + side, 0, b - 1) for side in (-1, 0)]
        return Layer(np.vstack([q, q]), np.concatenate([cells // b * b + side for side in sides]))

    def solved(self, begin: Layer) -> Layer:
        """Different solutions that starts lead to, each in its cell."""
        solver, grid = self.solver, self.grid
        q, cells, held = np.clip(begin.q, solver.lower, solver.upper), begin.cell, None
        if grid.joint is not None and grid.positions is not None:
            held = np.arange(q.shape[1]) == grid.joint
            q[:, grid.joint] = grid.positions[cells % len(grid.positions)]
        q, good = solver.solve(self.targets[cells], q, grid.task, self.tolerance, held)
        q, cells = solver.within(q[good]), cells[good]
        rows = [np.flatnonzero(cells == cell) for cell in np.unique(cells)]
        keep = [own[distinct(q[own], solver.periodic, solver.sizes)] for own in rows]
        kept = np.concatenate(keep) if keep else _NONE
        return Layer(q[kept], cells[kept])

    def traced(self, layer: Layer, more: Layer) -> Layer:
        """Candidates with those between, one spacing apart along each self-motion.

        Near where the sampled joint turns back on a self-motion, its positions are far apart.
        """
        solver, grid = self.solver, self.grid
        if grid.positions is None or solver.redundancy("none") != 1:
            return layer
        b = len(grid.positions)
        spacing = grid.position_spacing
        angle = np.where(layer.cell >= 0, -1 - layer.cell // b, layer.cell)
        known = frontier = Layer(layer.q, angle)
        begin = more  # what the point before had between comes first
        while True:
            targets = self.targets[(-1 - begin.cell) * b]
            q, good = solver.solve(targets, begin.q, grid.task, self.tolerance)
            q, good = solver.within(q), good & self._inside(q)
            apart = self._apart(known, Layer(q[good], begin.cell[good]), spacing)
            known, frontier = _joined(known, apart), _joined(frontier, apart)
            if not len(frontier.q):
                break
            motion = spacing * solver.self_motions(frontier.q, "none", 1)[:, :, 0]
            moved = np.vstack([frontier.q + motion, frontier.q - motion])
            begin = Layer(np.clip(moved, solver.lower, solver.upper), np.tile(frontier.cell, 2))
            frontier = Layer(layer.q[:0], _NONE)
        rest = slice(len(layer.q), None)
        return _joined(layer, Layer(known.q[rest], known.cell[rest]))

    def _inside(self, q: Array) -> Array:
        """Which postures are in the region: without limits a self-motion may have no end."""
        low, high = self.solver.region()
        return np.asarray(((q >= low) & (q <= high) | self.solver.periodic).all(axis=1))

    def _apart(self, known: Layer, more: Layer, spacing: float) -> Layer:
        """What is not near anything known, nor near what comes before it."""
        both = _joined(known, more)
        keep: list[int] = []
        first = len(known.q)
        turns = np.where(self.solver.periodic, 2 * np.pi / self.solver.sizes, 0.0)
        places = both.q / self.solver.sizes
        places = np.where(turns > 0, places % np.where(turns > 0, turns, 1.0), places)
        places = np.where((turns > 0) & (places >= turns), 0.0, places)  # by rounding
        for cell in np.unique(more.cell):
            rows = np.flatnonzero(both.cell == cell)
            tree = cKDTree(places[rows], boxsize=turns)
            near = tree.query_pairs(0.5 * spacing, output_type="ndarray")
            taken = rows < first
            before: dict[int, list[int]] = {}
            for i, j in near.tolist():
                before.setdefault(j, []).append(i)
            for j in np.flatnonzero(~taken).tolist():
                taken[j] = not any(taken[i] for i in before.get(j, ()))
            keep += rows[taken & (rows >= first)].tolist()
        rows = np.array(keep, int)
        return Layer(both.q[rows], both.cell[rows])

    def new(self, known: Layer, layer: Layer) -> Layer:
        """What was found and is not known."""
        fresh = np.ones(len(layer.q), bool)
        for cell in np.unique(layer.cell):
            own = np.flatnonzero(layer.cell == cell)
            old = known.q[known.cell == cell]
            step = (layer.q[own, None, :] - old[None, :, :]) / self.solver.sizes
            turns = np.where(self.solver.periodic, np.round(step / (2 * np.pi)), 0.0)
            near = np.abs(step - 2 * np.pi * turns).max(axis=2) < SAME
            fresh[own] = ~near.any(axis=1)
        return Layer(layer.q[fresh], layer.cell[fresh])

    def lonely(self, layer: Layer) -> list[Array]:
        """For each direction, the solutions in cells that have more than their neighbour there."""
        counts = np.bincount(layer.cell, minlength=self.grid.count)
        return [counts[to] < counts[layer.cell] for to in self._neighbours(layer.cell)]

    def spread(self, layer: Layer, chosen: list[Array] | None = None) -> Layer:
        """Solutions as starts in all neighbouring cells, or those chosen for each direction."""
        q, cells = [layer.q[:0]], [_NONE]
        for side, to in enumerate(self._neighbours(layer.cell)):
            rows = (to != layer.cell) if chosen is None else chosen[side]
            q.append(layer.q[rows])
            cells.append(to[rows])
        return Layer(np.vstack(q), np.concatenate(cells))

    def _neighbours(self, cells: Array) -> list[Array]:
        where = np.array(np.unravel_index(cells, self.shape))
        neighbours = []
        for axis in (0, 1):
            for side in (1, -1):
                to = where.copy()
                to[axis] = (to[axis] + side) % self.shape[axis]
                neighbours.append(np.ravel_multi_index(tuple(to), self.shape))
        return neighbours
