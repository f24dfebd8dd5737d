r"""Postures of best stiffness along a path, by choice of a free rotation or a
redundant joint.

A tool that is symmetric about its axis, or an arm with more joints than it needs, leaves
a choice at every point of a path. The candidates of a point are all branches of the
inverse kinematics on a grid of the free choices. Candidates near singularities are
dropped, and steps of a joint beyond its bound are forbidden. Dynamic programming finds
the best sequence of candidates exactly. Then each point moves along its self-motion by
steps that are halved, and at last by Newton's along exact slopes of its cost where these
are recorded, again with dynamic programming.

*Cost*: a named quantity of the stiffness at a posture, or one over it, so that smaller is
better.

*Candidates*: a cell is one value of each free choice, a turn about the tool's axis or the
position of a redundant joint. From point to point the branches found are followed, and a
few random starts search for new ones. Every solution of a cell is a start in the
neighbouring cells.

*Dynamic programming*: first the sequence whose worst candidate costs least, then among
all sequences that are no worse the one of least sum. Costs are not negative; candidates
of infinite cost are never taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count, product
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.answer.vibration.response import Damping
from cartstiff.core import numerics
from cartstiff.core.arrays import (
    Array,
    checked_flag,
    checked_seed,
    csv_text,
    named_values,
    plain_dict,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, UndefinedError, check_name, checked_kind
from cartstiff.core.figures import new_figure
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.mechanisms.limits import Limits
from cartstiff.core.notes import Note
from cartstiff.core.numerics import NEAR_SINGULARITY
from cartstiff.core.potentials.line_springs import line_geometry
from cartstiff.core.results import LabelledResult
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    Behaviour,
    LoadKind,
    checked_load,
)
from cartstiff.core.stiffness.compute import SCHEMA, analyse
from cartstiff.core.stiffness.tensor import COMPONENTS
from cartstiff.files.other_units import shown
from cartstiff.kinematics.joint_poses import SAME, Free, JointPoses, PlatformPoses
from cartstiff.recorded.own_outputs import OwnOutputs
from cartstiff.recorded.quantities import (
    QUANTITIES,
    Quantity,
    Settings,
    check_masses,
    choose_quantities,
)
from cartstiff.recorded.recording import Recording, arrays_of_many
from cartstiff.recorded.stacks import needed_outputs, quantities_of
from cartstiff.recorded.strength import OF_STRENGTH, Drives
from cartstiff.wings.toolpaths.tool_path import ToolPath

#: What is minimised: the worst cost (and after it the sum), or the sum alone.
Objective = Literal["worst", "mean"]

# Factor within which costs are equal, so that rounding does not exclude the worst
# candidate itself.
_ROUNDING_FACTOR = 1.0 + numerics.ROUNDOFF
# Number of candidates of a layer in the first trial; each further trial takes four times
# as many.
_FIRST_CANDIDATES = 100


def best_way(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    objective: Objective = "worst",
) -> tuple[list[int] | None, list[Array]]:
    """Find the best sequence of one candidate of each layer.

    Parameters
    ----------
    costs : sequence of ndarray (c_i,)
        Costs of the candidates of each layer.
    steps : callable
        ``steps(i, a, b)`` returns the costs (len(a), len(b)) of steps from candidates a
        (indices in layer i) to candidates b (in layer i + 1), infinite for forbidden
        steps.
    objective : {"worst", "mean"}
        See `Objective`.

    Returns
    -------
    way : list of int, or None
        Indices; None if no sequence passes through all layers.
    reached : list of ndarray
        Candidates of each layer that can be reached from the first layer, up to the last
        layer that is reached.
    """
    check_name("objective", objective, get_args(Objective))
    usable = [np.flatnonzero(np.isfinite(c)) for c in costs]
    if objective == "worst":
        total, reached, _ = _cheapest(costs, steps, usable, worst=True)
        if total is None:
            return None, reached
        bound = float(total.min()) * _ROUNDING_FACTOR
        usable = [rows[c[rows] <= bound] for c, rows in zip(costs, usable, strict=True)]
    total, reached, origins = _cheapest(costs, steps, usable, worst=False)
    if total is None:
        return None, reached
    k = int(np.argmin(total))
    way = [int(reached[-1][k])]
    for origin, layer in zip(reversed(origins), reversed(reached[:-1]), strict=True):
        k = int(origin[k])
        way.append(int(layer[k]))
    return way[::-1], reached


_Ways = tuple[Array | None, list[Array], list[Array]]


def _cheapest(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    usable: Sequence[Array],
    worst: bool,
) -> _Ways:
    """Run `_forward` on the candidates that can be part of an optimal sequence.

    A sequence through the cheapest candidates of each layer bounds the optimum. The
    number of these candidates is increased until a sequence exists or all candidates are
    used.
    """
    count, most = _FIRST_CANDIDATES, max(map(len, usable))
    while count < most:
        few = [
            np.sort(rows[np.argsort(c[rows], kind="stable")[:count]])
            for c, rows in zip(costs, usable, strict=True)
        ]
        total, *_ = _forward(costs, steps, few, worst)
        if total is not None:
            # Lower bound of a sequence: its candidate and the cheapest ones of all other
            # layers.
            least = [float(c[rows].min()) for c, rows in zip(costs, usable, strict=True)]
            bound = float(total.min()) * _ROUNDING_FACTOR
            bounds = [bound - (0.0 if worst else sum(least) - own) for own in least]
            usable = [
                rows[c[rows] <= most_of]
                for c, rows, most_of in zip(costs, usable, bounds, strict=True)
            ]
            break
        count *= 4
    return _forward(costs, steps, usable, worst)


def _forward(
    costs: Sequence[Array],
    steps: Callable[[int, Array, Array], Array],
    usable: Sequence[Array],
    worst: bool,
) -> _Ways:
    """Return the least costs to the last layer, the candidates reached,
    and their predecessors.
    """
    reached, origins = [usable[0]], []
    total = costs[0][usable[0]]
    for i in range(1, len(costs)):
        a, b = reached[-1], usable[i]
        if not a.size:
            break
        step = steps(i - 1, a, b)
        # For the worst candidate a step has no cost: it is allowed or forbidden.
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


@dataclass(eq=False)
class Steps:
    """Costs of steps of the coordinates: they grow with the step and are infinite
    beyond a bound.

    Parameters
    ----------
    q : sequence of ndarray (c_i, n)
        Coordinates of the candidates.
    periodic : ndarray of bool (n,)
        Coordinates whose steps are taken modulo whole turns.
    bounds : ndarray (n,)
        Largest step of each coordinate.
    price : float
        Cost of a step in which every coordinate reaches its bound; the cost of other
        steps is proportional to the mean square.
    sides : sequence of ndarray (c_i,), optional
        Side of a singularity of each candidate; steps between sides are forbidden.
    """

    q: Sequence[Array]
    periodic: Array
    bounds: Array
    price: float = 0.0
    sides: Sequence[Array] | None = None

    def shares(self, i: int, a: Array, b: Array) -> tuple[Array, Array]:
        """Return mean square and maximum of step over bound of all coordinates
        (len(a), len(b)).

        The maximum is infinite between sides of a singularity.
        """
        square, worst = np.zeros((2, len(a), len(b)))
        for j, bound in enumerate(self.bounds):
            step = self.q[i + 1][b, j] - self.q[i][a, j][:, None]
            if self.periodic[j]:
                step = step - 2 * np.pi * np.round(step / (2 * np.pi))
            share = np.abs(step / bound)
            square += share * share
            np.maximum(worst, share, out=worst)
        if self.sides is not None:
            worst[self.sides[i][a][:, None] != self.sides[i + 1][b]] = np.inf
        return square / len(self.bounds), worst

    def __call__(self, i: int, a: Array, b: Array) -> Array:
        """The costs of steps from candidates a of layer i to candidates b of the next."""
        square, worst = self.shares(i, a, b)
        return np.where(worst <= 1.0, self.price * square, np.inf)


#: Solvers of postures at poses, for joints and for platforms.
PathSolver = JointPoses | PlatformPoses
#: Largest distance of revolute joints from a required posture (rad).
NEARBY = 0.5 * np.pi
# Where the first point has no such posture, so many times as far as the nearest is near.
_LITTLE_FARTHER = 1.25


@dataclass(frozen=True, eq=False)
class Choices:
    """The grid of free choices.

    Attributes
    ----------
    free : {"none", "x", "y", "z", "rotation"}
        Rotation left free.
    angles : ndarray (a,)
        Turns about the tool's axis from the path's own pose (rad); one value without a
        choice.
    joint : int or None
        The joint whose position is chosen.
    positions : ndarray (b,)
        Its positions; one value without a choice.
    dimension : int
        Dimension of the self-motions, all choices together.
    size : float
        Natural size of the joint's coordinate.
    """

    free: Free
    angles: Array
    joint: int | None
    positions: Array
    dimension: int
    size: float = 1.0

    @property
    def shape(self) -> tuple[int, int]:
        """Number of angles and of positions, 1 where there is no choice."""
        return len(self.angles), len(self.positions)

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.angles) * len(self.positions)

    @property
    def turns(self) -> bool:
        """Whether angles are a choice."""
        return len(self.angles) > 1

    @property
    def is_grid(self) -> bool:
        """Whether the cells are values of every free choice,
        and a constant choice means one.
        """
        return self.turns + (self.joint is not None) == self.dimension > 0

    def at(self, cell: int) -> dict[str, float]:
        """Return the choices of a cell: "angle" and "position", as far as they exist."""
        a, b = divmod(cell, len(self.positions))
        values = {"angle": float(self.angles[a])} if self.turns else {}
        if self.joint is None:
            return values
        return {**values, "position": float(self.positions[b])}

    @property
    def task(self) -> Free:
        """Rotation that is free in a cell."""
        return "none" if self.turns else self.free

    def targets(self, pose: Array) -> Array:
        """Return the required poses (cells, 4, 4) at a point."""
        twists = np.zeros((len(self.angles), 6))
        if self.turns:
            twists[:, "xyz".index(self.free)] = self.angles
        return np.repeat(pose @ se3.exp(twists), len(self.positions), axis=0)

    @property
    def position_spacing(self) -> float:
        """Distance of neighbouring positions, in natural sizes."""
        if self.joint is None:
            return 0.2
        return float(self.positions[1] - self.positions[0]) / self.size

    @property
    def spacing(self) -> float:
        """Distance of neighbouring cells, the larger of both.

        In rad and natural sizes.
        """
        steps = [float(self.angles[1] - self.angles[0])] if self.turns else []
        if self.joint is not None or not steps:
            steps.append(self.position_spacing)
        return max(steps)


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
        raise InputError(
            "too few samples of a free choice", expected="3 or more", got=samples
        )
    dimension, left = solver.redundancy(free), solver.redundancy("none")
    if redundant is not None:
        check_name("joint", redundant, names)
        if left < 1:
            raise InputError(
                f"no joint is left over here: {redundant!r} cannot be chosen"
            )
    angles, positions, joint, size = np.zeros(1), np.zeros(1), None, 1.0
    if free in ("x", "y", "z") and dimension > left:
        angles = -np.pi + 2 * np.pi * np.arange(samples) / samples
    if left > 0 and free != "rotation" and isinstance(solver, JointPoses):
        joint = names.index(redundant) if redundant else _most_moving_joint(solver)
        size = float(solver.sizes[joint])
        low, high = np.transpose(solver.region())[joint]
        if solver.periodic[joint]:
            positions = low + (high - low) * np.arange(samples) / samples
        else:
            positions = np.linspace(low, high, samples)
    return Choices(free, angles, joint, positions, dimension, size)


def _most_moving_joint(solver: JointPoses) -> int:
    """Return the joint whose motion in the self-motion has the largest lower decile.

    The position of a joint that stands still while the others move does not determine
    theirs.
    """
    q = solver.random_starts(200, np.random.default_rng(0))
    moving = (
        solver.self_motions(q, "none", solver.redundancy("none")) / solver.sizes[:, None]
    )
    least = np.quantile(np.linalg.norm(moving, axis=2), 0.1, axis=0)
    return int(np.argmax(np.round(least, 6)))


def path_solver(
    elastic: ElasticMechanism,
    ranges: Mapping[str, tuple[float, float]] | None,
    near: Mapping[str, float] | ArrayLike | None,
) -> PathSolver:
    """Return the solver of postures within the given ranges."""
    if elastic.mechanism.coordinates_are_pose:
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


# Number of random starts of a cell at each point but the first.
_LATER_STARTS = 2
# Among the cells that differ only in the sampled joint's position one in so many has
# random starts. These are solved with that joint free, and their solutions are followed
# through the other cells.
_START_SPACING = 6
_NO_CELLS = np.empty(0, int)


class Layer(NamedTuple):
    """Candidates of one point: coordinates (c, n) and the cell (c,) of each.

    A candidate between the positions of the sampled joint is in no cell: its number is -1
    minus the index of its angle.
    """

    q: Array
    cell: Array


def layers(
    solver: PathSolver,
    poses: Array,
    grid: Choices,
    starts: int,
    seed: int,
    advance: Callable[[], None] | None = None,
) -> list[Layer]:
    """Candidates within the limits for each pose (m, 4, 4),
    up to the first pose without any.

    At the first point each cell has `starts` random starts. `advance` is called after
    each point.
    """
    rng = np.random.default_rng(checked_seed(seed))
    layers: list[Layer] = []
    for pose in poses:
        cells = _Cells(solver, grid, grid.targets(pose))
        more = starts if not layers or not grid.is_grid else _LATER_STARTS
        before = layers[-1] if layers else Layer(solver.start[None][:0], _NO_CELLS)
        inside = before.cell >= 0
        begin = Layer(before.q[inside], before.cell[inside])
        layer = cells.solved(
            _joined(begin, cells.random(more, rng)), Layer(before.q[:0], _NO_CELLS)
        )
        # At the first point all solutions are tried in the neighbouring cells, later only
        # those of cells with more solutions than their neighbour.
        frontier = cells.spread(
            layer, cells.richer_than_neighbours(layer) if layers else None
        )
        while len(frontier.q):
            new = cells.solved(frontier, layer)
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
    """The cells of one point, whose solutions are starts in the neighbouring cells."""

    def __init__(self, solver: PathSolver, grid: Choices, targets: Array) -> None:
        self.solver, self.grid, self.targets = solver, grid, targets
        self.shape = grid.shape

    def random(self, count: int, rng: np.random.Generator) -> Layer:
        """Random starts, and the default posture.

        For a sampled joint, postures at the pose are solved with that joint free; they
        are starts in the cells on both sides of its solution.
        """
        solver, grid = self.solver, self.grid
        every = min(_START_SPACING, len(grid.positions))
        cells = np.repeat(np.arange(0, grid.count, every), count + 1)
        q = solver.random_starts(len(cells), rng)
        if not len(q):  # a platform: one posture at every pose
            return Layer(np.tile(solver.start, (grid.count, 1)), np.arange(grid.count))
        q[:: count + 1] = np.clip(solver.start, solver.lower, solver.upper)
        if grid.joint is None:
            return Layer(q, cells)
        q, good = solver.solve(self.targets[cells], q, grid.task)
        q, cells = solver.within(q[good]), cells[good]
        b = len(grid.positions)
        after = np.searchsorted(grid.positions, q[:, grid.joint])
        sides = [np.clip(after + side, 0, b - 1) for side in (-1, 0)]
        return Layer(
            np.vstack([q, q]), np.concatenate([cells // b * b + side for side in sides])
        )

    def solved(self, begin: Layer, known: Layer) -> Layer:
        """Solve from the starts; return the solutions that differ from known ones
        of their cell.
        """
        solver, grid = self.solver, self.grid
        q, cells, held = np.clip(begin.q, solver.lower, solver.upper), begin.cell, None
        if grid.joint is not None:
            held = np.arange(q.shape[1]) == grid.joint
            q[:, grid.joint] = grid.positions[cells % len(grid.positions)]
        q, good = solver.solve(self.targets[cells], q, grid.task, held=held)
        q, cells = solver.within(q[good]), cells[good]
        return self.apart(known, Layer(q, cells), SAME, np.inf)

    def traced(self, layer: Layer, more: Layer) -> Layer:
        """Add candidates between the cells, one spacing from each other along each
        self-motion.

        Where the sampled joint reverses its direction on a self-motion, its positions
        alone leave wide gaps.
        """
        solver, grid = self.solver, self.grid
        if grid.joint is None or solver.redundancy("none") != 1:
            return layer
        b = len(grid.positions)
        spacing = grid.position_spacing
        angle = np.where(layer.cell >= 0, -1 - layer.cell // b, layer.cell)
        known = frontier = Layer(layer.q, angle)
        begin = more  # first the candidates between the cells of the previous point
        while True:
            targets = self.targets[(-1 - begin.cell) * b]
            q, good = solver.solve(targets, begin.q, grid.task)
            q, good = solver.within(q), good & self._inside(q)
            apart = self.apart(
                known, Layer(q[good], begin.cell[good]), 0.5 * spacing, 2.0
            )
            known, frontier = _joined(known, apart), _joined(frontier, apart)
            if not len(frontier.q):
                break
            motion = spacing * solver.self_motions(frontier.q, "none", 1)[:, :, 0]
            moved = np.vstack([frontier.q + motion, frontier.q - motion])
            begin = Layer(
                np.clip(moved, solver.lower, solver.upper), np.tile(frontier.cell, 2)
            )
            frontier = Layer(layer.q[:0], _NO_CELLS)
        rest = slice(len(layer.q), None)
        return _joined(layer, Layer(known.q[rest], known.cell[rest]))

    def _inside(self, q: Array) -> Array:
        """Which postures are in the region: without limits a self-motion may not end."""
        low, high = self.solver.region()
        return np.asarray(((q >= low) & (q <= high) | self.solver.periodic).all(axis=1))

    def apart(self, known: Layer, more: Layer, radius: float, norm: float) -> Layer:
        """Return the new candidates farther than `radius` from known and from
        earlier new ones.
        """
        from scipy.spatial import cKDTree

        both, first = _joined(known, more), len(known.q)
        turns = np.where(self.solver.periodic, 2 * np.pi / self.solver.sizes, 0.0)
        places = both.q / self.solver.sizes
        places = np.where(turns > 0, places % np.where(turns > 0, turns, 1.0), places)
        places = np.where(
            (turns > 0) & (places >= turns), 0.0, places
        )  # rounding of the modulo
        # Postures of different cells are far from each other.
        places = np.column_stack([places, 2.0 * (1.0 + radius) * both.cell])
        tree = cKDTree(places, boxsize=np.append(turns, 0.0))
        before: dict[int, list[int]] = {}
        for i, j in tree.query_pairs(radius, norm, output_type="ndarray").tolist():
            before.setdefault(j, []).append(i)
        taken = np.ones(len(both.q), bool)
        for j in range(first, len(taken)):
            taken[j] = not any(taken[i] for i in before.get(j, ()))
        rows = first + np.flatnonzero(taken[first:])
        return Layer(both.q[rows], both.cell[rows])

    def richer_than_neighbours(self, layer: Layer) -> list[Array]:
        """For each direction, the solutions in cells that have more than
        their neighbour.
        """
        counts = np.bincount(layer.cell, minlength=self.grid.count)
        return [counts[to] < counts[layer.cell] for to in self._neighbours(layer.cell)]

    def spread(self, layer: Layer, chosen: list[Array] | None = None) -> Layer:
        """Return all solutions, or those chosen by direction,
        as starts in neighbouring cells.
        """
        q, cells = [layer.q[:0]], [_NO_CELLS]
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


class Judged(NamedTuple):
    """Costs of N postures.

    Attributes
    ----------
    q : ndarray (N, n)
        Coordinates.
    value : ndarray (N,)
        The quantity, NaN where it does not exist.
    cost : ndarray (N,)
        The value, or one over it where larger is better; infinite where there is none.
    ratio : ndarray (N,)
        Smallest over largest singular value of the length-scaled Jacobian (of a
        platform's lines); as many singular values are counted as the Jacobian has at most
        postures.
    side : ndarray (N,)
        Sign of the Jacobian's determinant among these postures, which changes only
        through a singularity; 0 where the Jacobian is not square (or not on the motions
        that the mechanism has).
    """

    q: Array
    value: Array
    cost: Array
    ratio: Array
    side: Array

    def taken(self, rows: Array | int) -> Judged:
        """Select rows, or one row."""
        return Judged(*(each[rows] for each in self))


def criteria() -> dict[str, Quantity]:
    """Return the quantities that can be a criterion, by name: those with a better end."""
    return {name: q for name, q in QUANTITIES.items() if q.better is not None}


@dataclass(frozen=True, eq=False)
class PathCost:
    """The criterion of a path.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism, with springs.
    path : ToolPath
        The path, with wrenches or directions if the quantity needs them.
    quantity : Quantity
        One of `criteria`.
    connection : {"A", "B", "K", "F", "load"}
        The stiffness that is read.
    loaded : bool
        Whether that stiffness is the one under the path's wrenches, balanced by the
        springs.
    load : LoadKind
        Behaviour of the wrenches while the body moves, and the point at which they act.
    solver : JointPoses or PlatformPoses
        Solver of postures.
    damping : Damping
        Damping of the vibrations.
    kept : mapping of str to (low, high)
        Ranges of quantities of the drives' strength (`OF_STRENGTH`).
    """

    elastic: ElasticMechanism
    path: ToolPath
    quantity: Quantity
    connection: str
    loaded: bool
    load: LoadKind
    solver: PathSolver
    damping: Damping
    kept: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.quantity.better is None:
            raise InputError(
                f"{self.quantity.name} is not a criterion: neither end is better",
                expected=", ".join(criteria()),
            )
        if self.loaded and self.path.wrenches is None:
            raise InputError("a stiffness under load needs the path's wrenches")
        choose_quantities([self.quantity.name], self._settings(0), self.elastic)
        check_masses([self.quantity], self.elastic)
        if self.damping != Damping() and self.quantity.asks != "damping":
            raise InputError(
                "is given, and the criterion does not need it",
                where="damping",
                expected="a criterion such as damping_1",
                got=self.quantity.name,
            )
        if self.kept:
            choose_quantities([*self.kept], self._under_load, self.elastic)

    def _settings(self, point: int) -> Settings:
        direction, wrench = self.path.direction(point), self.path.wrench(point)
        return Settings(
            connection=self.connection,
            length=self.solver.length,
            direction=None if direction is None else tuple(direction.tolist()),
            deflect=None if wrench is None else tuple(wrench.tolist()),
            world=not self.path.turns_with_body,
            load=self.load,
            deflect_at=self.load.at,
            damping=self.damping,
            is_loaded=self.loaded,
            drives=self.drives,
        )

    @cached_property
    def drives(self) -> Drives:
        """Drives whose forces have limits."""
        return Drives.of(self.elastic)

    @property
    def _under_load(self) -> Settings:
        """Settings under the path's wrenches, whichever the criterion counts."""
        return replace(self._settings(0), is_loaded=self.path.wrenches is not None)

    def strength(self, q: Array, points: Array, names: Sequence[str]) -> dict[str, Array]:
        """Quantities of `OF_STRENGTH` (N,) of postures under the path's wrenches."""
        if not len(names) or not len(q):
            return {}
        settings, wrenches = self._under_load, None
        if settings.is_loaded:
            poses = self.solver.kinematics.at(q).pose
            wrenches = self.path.wrenches_in_body(points, poses)
        asked = [QUANTITIES[name] for name in names]
        outputs = needed_outputs(asked, settings)
        found = self._arrays(outputs, q, wrenches)
        return quantities_of(self.elastic, asked, settings, found, q, wrenches, "body")

    def _arrays(
        self, outputs: tuple[str, ...], q: Array, load: Array | None
    ) -> dict[str, Array]:
        """Outputs of postures (N, n) under wrenches (N, 6), if any."""
        kind = DEAD_AT_ORIGIN if load is None else self.load
        return arrays_of_many(self.elastic, outputs, q, load, kind, "body").arrays

    def __call__(self, q: Array, points: Array) -> Judged:
        """Return the costs of postures (N, n) at points (N,) of the path."""
        count = len(q)
        value, ratio = np.full(count, np.nan), np.full(count, np.nan)
        if not count:
            return Judged(q, value, value, ratio, ratio)
        poses = self.solver.kinematics.at(q).pose
        outputs = needed_outputs([self.quantity], self._settings(0))
        outputs = tuple(dict.fromkeys((*outputs, "jacobian")))
        load = self.path.wrenches_in_body(points, poses) if self.loaded else None
        answers, mechanism = self._arrays(outputs, q, load), self.elastic.mechanism
        for point in np.unique(points):
            rows = points == point
            value[rows] = quantities_of(
                self.elastic,
                [self.quantity],
                self._settings(int(point)),
                {name: answers[name][rows] for name in outputs},
                q[rows],
                None if load is None else load[rows],
                "body",
            )[self.quantity.name]
        jacobian = answers["jacobian"]
        lengths, legs = mechanism.is_length, len(mechanism.points)
        if legs:  # the Jacobian's columns are the legs'
            lengths = np.ones(legs, bool)
        if legs not in (0, 6):  # no square one
            each = (line_geometry(T, mechanism.anchors, mechanism.points) for T in poses)
            jacobian = np.linalg.pinv(np.array([of_legs.lines for of_legs in each]))
        ratio, side = self._regularity(jacobian, lengths)
        smaller = self.quantity.better == "smaller"
        with numerics.silent():
            cost = value if smaller else np.where(value > 0, 1.0 / value, np.inf)
        cost = np.where(np.isfinite(cost) & (value >= 0), cost, np.inf)
        for name, x in self.strength(q, points, [*self.kept]).items():
            low, high = self.kept[name]
            cost = np.where((x >= low) & (x <= high), cost, np.inf)
        return Judged(q, value, cost, ratio, side)

    @cached_property
    def recorded(self) -> Recording | None:
        """The criterion as recorded arithmetic, if it is one for all points."""
        settings = {self._settings(point) for point in range(len(self.path))}
        if len(settings) > 1:
            return None
        own = OwnOutputs(quantities=(self.quantity.name,), settings=settings.pop())
        axes: Axes = "body" if self.path.turns_with_body else "world"
        found = Recording(self.elastic, (), own, self.loaded, self.load, axes)
        return found if found.has_slopes and not found.from_matrices else None

    def slopes(self, q: Array, points: Array) -> Array:
        """Exact derivatives (N, n) of the costs by the coordinates.

        NaN where they are not recorded.
        """
        if self.recorded is None:
            return np.full_like(q, np.nan)
        loads: Array | None = None
        if self.loaded:
            loads = np.array([self.path.wrench(point) for point in points.tolist()])
        found = self.recorded.slopes(self.quantity.name, q, loads)
        if self.quantity.better == "smaller":
            return found["by_q"]
        return -found["by_q"] / found[self.quantity.name] ** 2

    def _regularity(self, jacobian: Array, lengths: Array) -> tuple[Array, Array]:
        length, rank = self.solver.length, self.solver.rank("none")
        scaled = jacobian * np.repeat([1.0, 1.0 / length], 3)[:, None]
        # Deflections of compliant links are no motions of joints.
        scaled = (scaled * np.where(lengths, length, 1.0))[:, :, self.solver.movable]
        finite = np.isfinite(scaled).all(axis=(1, 2))
        scaled = np.where(finite[:, None, None], scaled, 0.0)
        values = np.linalg.svd(scaled, compute_uv=False)
        # Fewer lines than motions leave the body free everywhere.
        ratio, side = np.zeros(len(values)), np.zeros(len(values))
        if rank <= values.shape[1]:
            with numerics.silent():
                ratio = np.where(finite, values[:, rank - 1] / values[:, 0], 0.0)
        if scaled.shape[2] == rank and rank > 0:
            # A basis of the body's motions, if they are the same at all postures.
            sizes, vectors = np.linalg.eigh(np.einsum("nij,nkj->ik", scaled, scaled))
            if (sizes[:-rank] < numerics.ROUNDOFF * sizes[-1]).all():
                side = np.sign(np.linalg.det(vectors[:, -rank:].T @ scaled))
        return ratio, side


@dataclass(frozen=True, eq=False)
class ConstantChoice:
    """Best path with constant values of the free choices.

    Attributes
    ----------
    choice : dict of str to float
        "angle": turn about the tool's axis from the path's own poses (rad); "position":
        that of the redundant joint (rad or length).
    q : ndarray (m, n)
        Coordinates.
    values : ndarray (m,)
        The criterion along the path.
    """

    choice: dict[str, float]
    q: Array
    values: Array


@dataclass(frozen=True, eq=False, repr=False)
class OptimisedPath(LabelledResult):
    """Postures along a path, and the stiffness they have there.

    Attributes
    ----------
    elastic : ElasticMechanism
        The mechanism.
    path : ToolPath
        The required path.
    q : ndarray (m, n)
        Coordinates, continuous through whole turns of joints whose limits allow them.
    poses : ndarray (m, 4, 4)
        ``T_F_M`` of the body at the points.
    angles : ndarray (m,), or None
        Turn about the tool's axis from the path's own poses (rad), if it is free.
    values : ndarray (m,)
        The criterion along the path.
    ratios : ndarray (m,)
        Smallest over largest singular value of the length-scaled Jacobian.
    criterion : Quantity
        Quantity of `values`.
    connection, loaded
        The stiffness that is read, and whether under the path's load.
    load : LoadKind
        Behaviour of that load while the body moves, and its point.
    free : str
        Rotation that was left free.
    joint : str or None
        Redundant joint that was sampled.
    constant : ConstantChoice or None
        None if nothing is free, or no constant choice can follow the path.
    candidates : int
        Number of postures compared before the refinement.
    notes : tuple of Note
        Notes of the mechanism.
    off_singular : bool or None
        Whether steps through singularities were forbidden; None for redundant mechanisms,
        whose configurations are connected without a singularity.
    nearby : float or None
        Largest distance (rad) of revolute joints from the required posture.
    length : float
        Characteristic length by which the criterion and `ratios` count angles.
    margins : ndarray (m,) or None
        Least share of its limit that the force of a drive leaves, under weight and the
        path's wrenches; None without limits.
    """

    #: Links are not tested for collisions.
    collisions: ClassVar = (
        "collisions are not checked: "
        "neither of links with each other nor with anything else"
    )

    elastic: ElasticMechanism
    path: ToolPath
    q: Array
    poses: Array
    angles: Array | None
    values: Array
    ratios: Array
    criterion: Quantity
    connection: str
    loaded: bool
    load: LoadKind
    free: str
    joint: str | None
    constant: ConstantChoice | None
    candidates: int
    notes: tuple[Note, ...] = field(default=())
    off_singular: bool | None = True
    nearby: float | None = None
    length: float = np.nan
    margins: Array | None = None

    @property
    def unit(self) -> str:
        """Unit of the criterion."""
        return self.criterion.unit_in(self.elastic.units)

    @property
    def worst(self) -> float:
        """The worst value along the path, in the criterion's unit."""
        return self._worst(self.values)

    def _worst(self, values: Array) -> float:
        return float(values.max() if self.criterion.better == "smaller" else values.min())

    @property
    def steps(self) -> Array:
        """Change of the coordinates from each point to the next, (m - 1, n)."""
        return np.diff(self.q, axis=0)

    @property
    def nearest_limit(self) -> dict[str, Any] | None:
        """The joint, or quantity of a leg, that comes nearest to a limit,
        relative to its range.

        Keys "name", "distance" to the limit (below zero beyond it), "is_angle", "value"
        and "point", from 1; None without limits.
        """
        limits = Limits(self.elastic.mechanism)
        if not len(limits):
            return None
        values = limits.values(self.q, self.poses)
        distances = np.minimum(values - limits.lower, limits.upper - values)
        ranges = limits.upper - limits.lower
        sizes = np.where(
            np.isfinite(ranges), ranges, np.where(limits.are_angles, np.pi, self.length)
        )
        point, j = np.unravel_index(np.argmin(distances / sizes), distances.shape)
        return {
            "name": limits.names[j],
            "distance": float(distances[point, j]),
            "value": float(values[point, j]),
            "is_angle": bool(limits.are_angles[j]),
            "point": int(point) + 1,
        }

    @property
    def least_margin(self) -> dict[str, Any] | None:
        """Where the drives' forces come nearest to a limit, or are farthest beyond.

        Keys "name" of the drive, "margin" that it leaves, as a share of its limit, and
        "point", from 1; None without limits.
        """
        if self.margins is None or not np.isfinite(self.margins).any():
            return None
        point, wrenches = int(np.nanargmin(self.margins)), self.wrenches
        W = None if wrenches is None else wrenches[point]
        worst = analyse(self.elastic, self.q[point], wrench=W).forces[0]
        margin = float(self.margins[point])
        return {"name": worst.name, "margin": margin, "point": point + 1}

    @property
    def begins_at(self) -> float:
        """Largest distance [rad] of a turning joint of the first posture from the
        mechanism's.
        """
        turning = ~self.elastic.mechanism.is_length
        return float(np.abs(self.q[0] - self.elastic.q)[turning].max(initial=0.0))

    def summary(self) -> dict[str, Any]:
        """Worst and mean of the criterion, optimised and with a constant choice;
        largest steps.
        """
        largest = np.abs(self.steps).max(axis=0, initial=0.0)
        values: dict[str, Any] = {
            "worst": self.worst,
            "worst_point": int(np.flatnonzero(self.values == self.worst)[0]) + 1,
            "mean": float(self.values.mean()),
            "smallest_ratio": float(self.ratios.min()),
            "largest_step": dict(zip(self.elastic.names, largest.tolist(), strict=True)),
            "nearest_limit": self.nearest_limit,
            "least_margin": self.least_margin,
            "constant": None,
        }
        if self.constant is not None:
            values["constant"] = {
                **self.constant.choice,
                "worst": self._worst(self.constant.values),
                "mean": float(self.constant.values.mean()),
            }
        return values

    @property
    def configuration(self) -> str:
        """Largest step and whether the configuration is kept, in words."""
        largest = np.abs(self.steps).max(axis=0, initial=0.0)
        j = int(np.argmax(largest))
        step, units = shown(self.elastic, largest)[j], self.elastic.units
        slides = self.elastic.mechanism.coordinates[j].is_length
        unit = units.shown_length if slides else units.shown_angle
        words = (
            f"largest step from point to point {step:.3g} {unit} "
            f"({self.elastic.names[j]})"
        )
        if self.off_singular:
            words += "; the configuration is kept: no step passes through a singularity"
        elif self.off_singular is None:
            words += "; with joints left over, configurations go over into each other"
        else:
            words += (
                "; steps through singularities, where configurations meet, were allowed"
            )
        is_pose = self.elastic.mechanism.coordinates_are_pose
        if not is_pose and self.nearby is None:
            words += (
                f"; it begins within {np.degrees(self.begins_at):.3g} deg of the posture "
                "before the path"
            )
        if self.nearby is not None:
            words += (
                f"; all joints within {np.degrees(self.nearby):.3g} deg of the "
                "given posture"
            )
        return words

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        constant = self.constant
        # What was asked, the postures, and what is said of them.
        data = {
            "schema": SCHEMA,
            "mechanism": self.elastic.name,
            "joints": self.elastic.names,
            **self.elastic.mechanism.frames_as_dict(),
            "units": self.elastic.units.to_dict(),
            "criterion": {
                "name": self.criterion.name,
                "description": self.criterion.description,
                "unit": self.unit,
                "better": self.criterion.better,
                "length": self.length,
                "connection": self.connection,
                "loaded": self.loaded,
                "load": {
                    "kind": self.load.kind,
                    "at": self.load.at,
                    "meaning": self.load.words,
                },
            },
            "load_axes": self.load_axes,
            "free": self.free,
            "redundant_joint": self.joint,
            "q": self.q,
            "poses": self.poses,
            "angles": self.angles,
            "values": self.values,
            "ratios": self.ratios,
            "margins": self.margins,
            "constant": constant
            and {**constant.choice, "q": constant.q, "values": constant.values},
            "summary": self.summary(),
            "configuration": {
                "kept": self.off_singular,
                "largest_step": numerics.largest(self.steps),
                "near": self.nearby,
                "message": self.configuration,
            },
            "collisions": {"checked": False, "message": self.collisions},
            "notes": self.notes,
        }
        return plain_dict(data)

    @property
    def load_axes(self) -> Literal["path", "world", "body"] | None:
        """Axes of the path's loads and directions, see `ToolPath`; None without any."""
        nothing = self.path.wrenches is None and self.path.directions is None
        return None if nothing else self.path.axes

    @property
    def wrenches(self) -> Array | None:
        """The path's wrenches (m, 6) about M's origin, along M's axes at each posture."""
        if self.path.wrenches is None:
            return None
        return self.path.wrenches_in_body(
            np.arange(len(self.path)), self.poses, self.load.at
        )

    def to_csv(self) -> str:
        """One line per point: coordinates, wrench, free angle, criterion,
        singular value ratio.

        `cartstiff equilibrium --path`, `view --trajectory`, `map --trajectory` and
        `poses` read it.
        """
        units, columns = self.elastic.units, [self.q]
        names = self.elastic.names_with_units
        if (W := self.wrenches) is not None:
            columns.append(W)
            names += [
                f"{c} [{u}]"
                for c, u in zip(COMPONENTS["wrench"], units.wrench, strict=True)
            ]
        if self.angles is not None:
            columns.append(self.angles[:, None])
            names.append(f"free_angle [{units.angle}]")
        columns.append(np.column_stack([self.values, self.ratios]))
        unit = f" [{self.unit}]" if self.unit not in ("", "1") else ""
        names += [f"{self.criterion.name}{unit}", "singular_ratio"]
        if self.margins is not None and self.criterion.name != "effort_margin":
            columns.append(self.margins[:, None])
            names.append("effort_margin")
        if self.constant is not None:
            columns.append(self.constant.values[:, None])
            names.append(f"{self.criterion.name}_constant{unit}")
        return csv_text(np.hstack(columns), names)

    def plot(self, ax: Any = None) -> Any:
        """Draw the criterion along the path, optimised and with a constant choice,
        and the choice.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure
            See `cartstiff.shown.report.output.save_figure`.

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        chosen = self._choice()
        figure = new_figure(
            6.4, 4.2 if chosen is None else 6.0, self.elastic.springs_in_doubt, ax=ax
        )
        axes = np.atleast_1d(figure.subplots(1 if chosen is None else 2, 1, sharex=True))
        points = np.arange(1, len(self.q) + 1)
        if self.constant is not None:
            axes[0].plot(
                points,
                self.constant.values,
                "s--",
                color="0.5",
                markersize=3,
                label="best constant choice",
            )
        axes[0].plot(
            points, self.values, "o-", color="C0", markersize=3, label="optimised"
        )
        better = self.criterion.better
        axes[0].set_ylabel(f"{self.criterion.name} [{self.unit}], {better} is better")
        axes[0].set_ylim(bottom=0)
        axes[0].legend()
        axes[0].set_title(
            f"{self.elastic.name}: {self.criterion.description}", fontsize="medium"
        )
        if chosen is not None:
            label, values, constant = chosen
            if constant is not None:
                axes[1].axhline(constant, linestyle="--", color="0.5")
            axes[1].plot(points, values, "o-", color="C0", markersize=3)
            axes[1].set_ylabel(label)
        axes[-1].set_xlabel("point of the path")
        axes[-1].locator_params(axis="x", integer=True)
        return figure

    def _choice(self) -> tuple[str, np.ndarray[Any, Any], float | None] | None:
        """Return label, values and best constant value of the free choice
        along the path.
        """
        constant = {} if self.constant is None else self.constant.choice
        if self.angles is not None:
            angle = constant.get("angle")
            if angle is not None:  # in the turn in which the path is
                angle += 2 * np.pi * np.round((self.angles.mean() - angle) / (2 * np.pi))
            return (
                f"turn about the tool's {self.free} axis [deg]",
                np.degrees(self.angles),
                None if angle is None else float(np.degrees(angle)),
            )
        if self.joint is not None:
            j = self.elastic.names.index(self.joint)
            is_length = self.elastic.mechanism.coordinates[j].is_length
            unit = self.elastic.units.coordinate(is_length)
            return f"{self.joint} [{unit}]", self.q[:, j], constant.get("position")
        return None


#: Distance in characteristic lengths beyond which a point suggests another unit of
#: length.
_FAR_LENGTHS = 50.0


def broken(
    costs: list[Array], steps: Steps, reached: list[Array], wound: Sequence[str]
) -> UndefinedError:
    """Return the error for a path without a continuous sequence through its candidates.

    `reached` are the candidates that the first points lead to, see `best_way`; `wound`
    are joints that would have to turn on beyond their limits.
    """
    # No candidate of the last reached layer leads to the next one.
    i = len(reached) - 2
    _, share = steps.shares(i, reached[i], np.flatnonzero(np.isfinite(costs[i + 1])))
    factor = float(share.min())
    if wound:
        reason = f"{', '.join(wound)} would have to turn on beyond the limits"
    elif not np.isfinite(factor):
        reason = "every step would pass through a singularity"
    else:
        reason = (
            f"a joint would have to make a step {factor:.3g} times as large as allowed; "
            "a finer path or a larger step may help"
        )
    return UndefinedError(
        f"no continuous way leads from point {i + 1} of the path to point {i + 2}: "
        f"{reason}",
        code="path-discontinuous",
        values={
            "point": i + 2,
            "factor": factor if np.isfinite(factor) else None,
            "largest_step": steps.bounds.tolist(),
            "wound": list(wound),
        },
    )


#: Largest step of a joint from point to point (rad, or characteristic lengths).
MAX_STEP = 0.5
# Number of refinements, each with half the step of the previous one.
_REFINEMENTS = 12
# The first of them that follows exact slopes, where these exist.
_FIRST_NEWTON = 10


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
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    objective: Objective = "worst",
    max_step: float | Mapping[str, float] | ArrayLike | None = None,
    singular: float = NEAR_SINGULARITY,
    smoothness: float = 1e-3,
    samples: int = 36,
    starts: int = 16,
    seed: int = 0,
    refine: bool = True,
    damping: Damping | float = 0.0,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    near: Mapping[str, float] | ArrayLike | Literal["anywhere"] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> OptimisedPath:
    r"""Postures of best stiffness along a path.

    Parameters
    ----------
    elastic : ElasticMechanism
        A serial arm or a platform with springs. As in `cartstiff.analyse`, those rest
        positions that are not given are commanded, so that at each posture the springs
        carry gravity, and with `loaded` all that are driven, so that they carry the
        path's wrench as well.
    path : ToolPath
        Poses of the body frame M, with wrenches or directions if the criterion needs
        them.
    free : {"none", "x", "y", "z", "rotation"}
        Free rotation of the body: about one of its axes (a spindle, a welding wire), or
        any rotation, which is sampled at random.
    redundant : str, optional
        The joint of a redundant arm whose position is sampled; default the one that moves
        most with the self-motion.
    criterion : str
        A quantity of `cartstiff.wings.toolpaths.optimise.criteria`: "deflection" under
        the path's wrench, "along_free" for the stiffness along the path's directions,
        "translation_free_min", ...
    connection : {"load", "A", "B", "K", "F"}, optional
        Stiffness that the criterion is read from; default "load", the tangent under the
        path's wrench, with `loaded`, and "B" without.
    loaded : bool
        Read the stiffness under the path's wrench, which the springs balance.
    load_kind : {"dead", "follower", "conservative"}
        Behaviour of that wrench while the body moves, as in `cartstiff.analyse`.
    load_at : array_like (3,)
        The point of the body, in M, about which the path's wrenches are given and at
        which they act.
    objective : {"worst", "mean"}
        Minimise the cost of the worst point, then the sum of costs; or the sum alone. The
        cost is the value, or one over it where larger is better.
    max_step : float, mapping or array_like (n,), optional
        Largest step of each joint from one point to the next; default 0.5 rad, or half a
        characteristic length.
    singular : float
        Postures are excluded whose smallest singular value of the length-scaled Jacobian
        is below this share of the largest, and so are steps through a singularity. 0
        allows all.
    smoothness : float
        Cost of a step in which every joint moves as far as allowed, as a share of a
        point's typical cost; the cost of other steps follows the mean square. It decides
        between equally stiff postures.
    samples : int
        Number of values of each free choice.
    starts : int
        Random starts of the inverse kinematics for each value at the first point.
    seed : int
        Seed of the random starts.
    refine : bool
        Refine the free choices continuously from the best samples.
    damping
        For the criteria ``damping_1`` ..., a share of critical damping, as in
        `compute_map`.
    ranges : mapping of str to (low, high), optional
        Ranges of joints besides their limits; of "effort_margin", the least share of its
        limit that the force of a drive leaves under weight and the path's wrench; of
        "largest_load", how many times that wrench the drives hold.
    near : mapping or array_like (n,) or "anywhere", optional
        A posture near which the path stays: all revolute joints within `NEARBY` of it.
        Without it the path of an arm begins so near to `elastic.q`, or at the nearest
        postures that there are, if it can be followed from there; with "anywhere" it
        begins at the best.
    progress : callable, optional
        Called with (done, total) steps of the search.

    Returns
    -------
    OptimisedPath
        Coordinates and criterion along the path, and those of the best constant choice.

    Raises
    ------
    InputError
        For a mechanism with closures or without springs, an unknown criterion, or one
        without the wrench or direction it needs.
    UndefinedError
        If the path cannot be followed, with the first point where it breaks (from 1):
        codes ``"path-unreachable"``, ``"path-beyond-limits"``, ``"path-near-singular"``,
        ``"path-beyond-strength"``, ``"path-without-stiffness"``,
        ``"path-discontinuous"``.
    """
    _check_mechanism(checked_elastic(elastic))
    checked_kind(path, ToolPath, "path", "a ToolPath")
    connection = connection or ("load" if loaded else "B")
    check_name("free rotation", free, get_args(Free))
    check_name("criterion", criterion, criteria())
    for name, flag in (("loaded", loaded), ("refine", refine)):
        checked_flag(flag, name)
    if starts < 0:
        raise InputError("starts cannot be used", expected="0 or more", got=starts)
    _check_shares(singular, smoothness)
    for name, pair in (ranges or {}).items():
        if np.shape(pair) != (2,):
            raise InputError("range", where=name, expected="(low, high)", got=pair)
    # The posture near which the path begins, and the choices that are left along it.
    near, start = _nearby(elastic, near)
    kept = {name: (ranges or {})[name] for name in OF_STRENGTH if name in (ranges or {})}
    of_joints = {n: own for n, own in (ranges or {}).items() if n not in kept}
    solver = path_solver(elastic, of_joints, near)
    grid = choices_of(solver, free, redundant, samples, list(elastic.names))
    # The cost of a posture: a criterion of the stiffness, of which load and damping are
    # parts.
    load = checked_load(load_kind, load_at, "body", given=path.wrenches is not None)
    if load.kind != "dead" and not loaded:
        raise InputError(
            "is for the stiffness under load",
            where="load_kind",
            expected="loaded as well",
        )
    cost = PathCost(
        elastic,
        path,
        criteria()[criterion],
        connection,
        loaded,
        load,
        solver,
        damping if isinstance(damping, Damping) else Damping(damping),
        kept,
    )
    # Search on the grid of choices, then on finer grids around the best path.
    levels = _REFINEMENTS if refine and grid.dimension else 0
    done, total = count(1), 2 * len(path) + levels

    def advance() -> None:
        if progress is not None:
            progress(next(done), total)

    search = _Search(
        cost,
        grid,
        objective,
        _bounds(elastic, solver, max_step),
        singular,
        smoothness,
        advance,
        start,
    )
    candidates = layers(solver, path.poses, grid, starts, seed, advance=advance)
    q, constant = search.among(candidates)
    if levels:
        q = search.refined(q)
    points, poses = np.arange(len(path)), solver.kinematics.at(q).pose
    judged, margins = cost(q, points), None
    if cost.drives.rows:
        margins = cost.strength(q, points, OF_STRENGTH[:1])["effort_margin"]
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
        singular > 0.0 if solver.rank("none") == solver.movable.sum() else None,
        None if near is None else NEARBY,
        solver.length,
        margins,
    )


def _check_mechanism(elastic: ElasticMechanism) -> None:
    """Refuse a mechanism with closures or without springs."""
    mechanism = elastic.mechanism
    if mechanism.closures:
        raise InputError("paths are for serial arms and platforms", got=mechanism.kind)
    if elastic.springs is None:
        raise InputError(f"{elastic.name} has no springs, whose stiffness could be best")


def _check_shares(singular: float, smoothness: float) -> None:
    """Refuse a threshold or a cost of steps that is out of its range."""
    if not 0.0 <= singular < 1.0:
        raise InputError(
            "singularity threshold cannot be used", expected="0 to below 1", got=singular
        )
    if not 0.0 <= smoothness < np.inf:
        raise InputError(
            "smoothness cannot be used", expected="0 or more", got=smoothness
        )


def _nearby(
    elastic: ElasticMechanism,
    near: Mapping[str, float] | ArrayLike | Literal["anywhere"] | None,
) -> tuple[Mapping[str, float] | ArrayLike | None, Array | None]:
    """The posture near which the path stays, and that near which it begins, if any."""
    if isinstance(near, str):
        check_name("posture nearby", near, ("anywhere",))
        return None, None
    begins = near is None and not elastic.mechanism.coordinates_are_pose
    return near, elastic.q if begins else None


def _bounds(
    elastic: ElasticMechanism,
    solver: PathSolver,
    max_step: float | Mapping[str, float] | ArrayLike | None,
) -> Array:
    default = MAX_STEP * solver.sizes
    if max_step is None:
        bounds = default
    else:
        bounds = named_values(max_step, elastic.names, default, "largest step")
    if not np.all(bounds > 0):
        raise InputError("largest step must be above zero", got=bounds.tolist())
    return np.array(bounds)


def _angles(path: ToolPath, poses: Array, free: Free) -> Array | None:
    if free not in ("x", "y", "z"):
        return None
    relative = path.poses[:, :3, :3].swapaxes(1, 2) @ poses[:, :3, :3]
    turn = se3.log(se3.pose(relative))[:, "xyz".index(free)]
    return np.unwrap(turn)


@dataclass(eq=False)
class _Search:
    """The search for one path: costs of candidates, and the best sequence of them."""

    cost: PathCost
    grid: Choices
    objective: Objective
    bounds: Array
    singular: float
    smoothness: float
    advance: Callable[[], None]
    start: Array | None
    price: float = 0.0
    reach: float = np.inf

    @property
    def solver(self) -> PathSolver:
        """The solver of postures."""
        return self.cost.solver

    def _layers(self, q: list[Array]) -> list[Judged]:
        """Return the costs of each layer, infinite near singularities."""
        counts = [len(rows) for rows in q]
        whole = self.cost(np.vstack(q), np.repeat(np.arange(len(q)), counts))
        whole = whole._replace(
            cost=np.where(whole.ratio < self.singular, np.inf, whole.cost)
        )
        ends = np.cumsum(counts)[:-1]
        return [
            Judged(*parts)
            for parts in zip(*(np.split(a, ends) for a in whole), strict=True)
        ]

    def among(self, candidates: list[Layer]) -> tuple[Array, ConstantChoice | None]:
        """The best postures (m, n) among candidates, and the best constant choice."""
        layers = self._layers([c.q for c in candidates])
        for point, layer in enumerate(layers):
            if not np.isfinite(layer.cost).any():
                raise self._impossible(point, layer)
            self.advance()
        self.price = self.smoothness * float(
            np.mean([layer.cost.min() for layer in layers])
        )
        # Near are postures within `NEARBY`; else those that are little farther than the
        # nearest.
        away = self._away(layers[0], self.solver.periodic)[np.isfinite(layers[0].cost)]
        self.reach = max(NEARBY, _LITTLE_FARTHER * float(away.min()))
        begun = [self._begun(layers[0], self.solver.periodic), *layers[1:]]
        way = self._way(begun)
        if isinstance(way, UndefinedError) and self.start is not None:
            self.start = None  # the path cannot be followed from near there
            begun, way = layers, self._way(layers)
        if isinstance(way, UndefinedError):
            raise way
        return way[0], self._constant(begun, [c.cell for c in candidates])

    def _impossible(self, point: int, layer: Judged) -> UndefinedError:
        """Return the error for a point (counted from 0) without any usable candidate."""
        ratios = layer.ratio
        values: dict[str, Any] = {"point": point + 1, "candidates": len(ratios)}
        here, elastic = f"point {point + 1} of the path", self.cost.elastic
        # Out of reach, or beyond limits.
        if not len(ratios):
            pose = self.cost.path.poses[point]
            excess = self.solver.beyond_limits(self.grid.targets(pose), self.grid.task)
            if excess is None:
                away = numerics.norm(pose[:3, 3])
                far = f": it is {away:.4g} away. Millimetres? Say x [mm] in the head"
                words = far if away > _FAR_LENGTHS * self.solver.length else ""
                return UndefinedError(
                    f"{here} is out of reach{words}",
                    code="path-unreachable",
                    values=values,
                )
            name, amount = excess
            units = dict(zip(elastic.names, elastic.names_with_units, strict=True))
            label = units.get(name, f"{name} [{elastic.units.length}]")
            return UndefinedError(
                f"{here} is reached only beyond the limits: {label} by {amount:.3g}",
                code="path-beyond-limits",
                values={**values, "limit_of": name, "beyond": amount},
            )
        # Near singularities only.
        best = float(ratios.max())
        if best < self.singular:
            return UndefinedError(
                f"{here} is reached only near singularities: smallest over largest "
                f"singular value {best:.3g}, and {self.singular:g} is required",
                code="path-near-singular",
                values={**values, "ratio": best, "threshold": self.singular},
            )
        # Beyond the drives' strength, or without the criterion.
        rows = layer.q[ratios >= self.singular]
        strength = self.cost.strength(rows, np.full(len(rows), point), [*self.cost.kept])
        for name, x in strength.items():
            low, high = self.cost.kept[name]
            if not ((x >= low) & (x <= high)).any():
                most = float(np.nanmax(x, initial=-np.inf))
                return UndefinedError(
                    f"{here} is reached only with {name} outside {low:g} to {high:g}: "
                    f"at most {most:.3g}",
                    code="path-beyond-strength",
                    values={**values, "name": name, "most": most},
                )
        springs = elastic.springs
        is_given = springs is not None and not springs.rest_is_free().any()
        words = (
            "; rest positions that are left out of the file are commanded at each point"
        )
        return UndefinedError(
            f"{here}: the criterion exists in no posture that reaches it"
            + words * (is_given and not self.cost.loaded),
            code="path-without-stiffness",
            values={**values, "ratio": best},
        )

    def _constant(
        self, layers: list[Judged], cells: list[Array]
    ) -> ConstantChoice | None:
        if not self.grid.is_grid:
            return None
        smallest, choice = np.inf, None
        least = np.full((len(layers), self.grid.count), np.inf)
        for row, layer, cell in zip(least, layers, cells, strict=True):
            np.minimum.at(row, cell[cell >= 0], layer.cost[cell >= 0])
        # Lower bound of a cell: the costs of its cheapest candidates.
        size_of = np.max if self.objective == "worst" else np.sum
        bounds = size_of(least, axis=0)
        for cell in np.argsort(bounds, kind="stable"):
            if not bounds[cell] < smallest:
                break
            own = [layer.taken(c == cell) for layer, c in zip(layers, cells, strict=True)]
            way = self._way(own)
            if isinstance(way, UndefinedError):
                continue
            q, judged = way
            costs, values = np.array([(one.cost, one.value) for one in judged]).T
            size = float(size_of(costs))
            if size < smallest:
                smallest, choice = (
                    size,
                    ConstantChoice(self.grid.at(int(cell)), q, values),
                )
        return choice

    def _way(self, layers: list[Judged]) -> tuple[Array, list[Judged]] | UndefinedError:
        """Return postures and candidates of the best sequence,
        or the error if there is none.

        At first postures are compared modulo whole turns, and joints are then unwrapped
        within their limits. For a joint whose limits forbid that, each turn becomes a
        candidate of its own, and the search is repeated.
        """
        periodic = self.solver.periodic.copy()
        while True:
            layers = [self._begun(layers[0], periodic), *layers[1:]]
            costs, steps = [layer.cost for layer in layers], self.steps(layers, periodic)
            way, reached = best_way(costs, steps, self.objective)
            if way is None:
                wound = self.solver.periodic & ~periodic
                names = [self.cost.elastic.names[j] for j in wound.nonzero()[0]]
                return broken(costs, steps, reached, names)
            taken = [layer.taken(k) for layer, k in zip(layers, way, strict=True)]
            followed, wound = self._turned_on(
                np.array([one.q for one in taken]), periodic
            )
            if not wound.any():
                return followed, taken
            periodic = periodic & ~wound
            layers = [self._all_turns(layer, wound) for layer in layers]

    def _away(self, layer: Judged, periodic: Array) -> Array:
        """Largest distance (c,) of a turning joint from the start; zero without one."""
        if self.start is None:
            return np.zeros(len(layer.q))
        turning = ~self.cost.elastic.mechanism.is_length & self.solver.movable
        away = layer.q - self.start
        away = np.where(periodic, away - 2 * np.pi * np.round(away / (2 * np.pi)), away)
        return np.asarray(np.abs(away[:, turning]).max(axis=1, initial=0.0))

    def _begun(self, layer: Judged, periodic: Array) -> Judged:
        """The first layer, with infinite costs of postures that are not
        near the start.
        """
        is_near = self._away(layer, periodic) <= self.reach
        return layer._replace(cost=np.where(is_near, layer.cost, np.inf))

    def _turned_on(self, q: Array, periodic: Array) -> tuple[Array, Array]:
        """Unwrap the coordinates; also return the joints whose limits forbid that."""
        q = np.where(periodic, np.unwrap(q, axis=0), q)
        wound = np.zeros(q.shape[1], bool)
        for j in np.flatnonzero(periodic):
            low, high = self.solver.lower[j], self.solver.upper[j]
            least = np.ceil((low - q[:, j].min()) / (2 * np.pi) - numerics.ROUNDOFF)
            most = np.floor((high - q[:, j].max()) / (2 * np.pi) + numerics.ROUNDOFF)
            wound[j] = least > most
            if not wound[j]:
                back = 0.0 if self.start is None else self.start[j] - q[0, j]
                turns = np.clip(np.round(back / (2 * np.pi)), least, most)
                q[:, j] += 2 * np.pi * turns
        return q, wound

    def _all_turns(self, layer: Judged, joints: Array) -> Judged:
        """Return the postures with all turns of some joints within their limits."""
        for j in np.flatnonzero(joints):
            low, high = self.solver.lower[j], self.solver.upper[j]
            turns = np.arange(
                np.ceil((low - high) / (2 * np.pi)), (high - low) / (2 * np.pi) + 1
            )
            more = layer.taken(np.repeat(np.arange(len(layer.q)), len(turns)))
            more.q[:, j] += 2 * np.pi * np.tile(turns, len(layer.q))
            layer = more.taken((more.q[:, j] >= low) & (more.q[:, j] <= high))
        return layer

    def steps(self, layers: list[Judged], periodic: Array) -> Steps:
        """Return the costs of steps from layer to layer."""
        sides = [layer.side for layer in layers] if self.singular > 0 else None
        return Steps(
            [layer.q for layer in layers], periodic, self.bounds, self.price, sides
        )

    def refined(self, q: Array) -> Array:
        """Move the postures along their self-motions, by steps that are
        halved repeatedly, and at last by Newton's along exact slopes of their costs.
        """
        m, d = len(q), self.grid.dimension
        shifts = _shifts(d)
        never = np.zeros(q.shape[1], bool)
        step = 0.5 * self.grid.spacing
        for level in range(_REFINEMENTS):
            motions = self.solver.self_motions(q, self.grid.free, d)
            newton = self._newton(q, motions) if level >= _FIRST_NEWTON else None
            moves = np.tile(step * shifts.T, (m, 1, 1)) if newton is None else newton
            points = np.repeat(np.arange(m), moves.shape[2])
            moved = (motions @ moves).swapaxes(1, 2).reshape(-1, q.shape[1])
            solved, good = self._at_poses(q[points] + moved, points)
            around = [np.vstack([q[i], solved[good & (points == i)]]) for i in range(m)]
            layers = self._layers(around)
            costs = [layer.cost for layer in layers]
            way, _ = best_way(costs, self.steps(layers, never), self.objective)
            if way is not None:  # the present postures are among the candidates
                q = np.array([rows[k] for rows, k in zip(around, way, strict=True)])
            step *= 0.5
            self.advance()
        return q

    def _at_poses(self, q: Array, points: Array) -> tuple[Array, Array]:
        """Postures at their points of the path, and whether they are there."""
        begin = np.clip(q, self.solver.lower, self.solver.upper)
        return self.solver.solve(self.cost.path.poses[points], begin, self.grid.free)

    def _newton(self, q: Array, motions: Array) -> Array | None:
        """Newton's steps (m, d, 1) along the self-motions (m, n, d); None without exact
        slopes.

        Zero where the cost does not curve upwards.
        """
        if self.cost.recorded is None:
            return None
        sizes, d = self.solver.sizes[:, None], motions.shape[2]
        points, h = np.arange(len(q)), numerics.DIFFERENCE_STEP
        # Slopes here, and on the self-motions a little further along each of them: their
        # change is the curvature of the cost.
        here = np.einsum("mi,mid->md", self.cost.slopes(q, points), motions)
        H = np.empty((len(q), d, d))
        for k in range(d):
            there, _ = self._at_poses(q + h * motions[:, :, k], points)
            own = self.solver.self_motions(there, self.grid.free, d)
            own = own @ ((own / sizes).swapaxes(1, 2) @ (motions / sizes))
            slopes = np.einsum("mi,mid->md", self.cost.slopes(there, points), own)
            H[:, :, k] = (slopes - here) / h
        # Only where the curvature is known and upwards is there a least cost nearby.
        known = np.isfinite(H).all(axis=(1, 2)) & np.isfinite(here).all(axis=1)
        H = np.where(known[:, None, None], 0.5 * (H + H.swapaxes(1, 2)), -np.eye(d))
        up, steps = np.linalg.eigvalsh(H)[:, 0] > 0.0, np.zeros((len(q), d, 1))
        steps[up] = -np.linalg.solve(H[up], here[up, :, None])
        return steps


def _shifts(d: int) -> Array:
    """Directions (k, d) in which postures are moved along d self-motions."""
    reach = (-2.0, -1.0, 1.0, 2.0) if d == 1 else (-1.0, 1.0)
    if d > 2:
        return np.array([s * e for e in np.eye(d) for s in reach])
    return np.array([s for s in product((0.0, *reach), repeat=d) if any(s)])
