r"""Parts of a space of poses that are inside: rays from a centre, columns, the largest ball.

Boundaries are bracketed by a scan, and all brackets are divided at once until they are narrow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry.se3 import Array

# A call with few poses costs as much as one with so many: few brackets are cut into more parts.
_AT_ONCE, _MOST = 512, 4


def narrowed(
    stays: Callable[[NDArray[np.intp], Array], NDArray[np.bool_]],
    near: Array,
    far: Array,
    halvings: int,
) -> tuple[Array, Array, int]:
    """Brackets (N,) as narrow as after `halvings` bisections, around where `stays` first fails.

    Parameters
    ----------
    stays : callable
        Given the numbers (K,) of brackets and places (K,) in them: which are as at `near`.
    near, far : ndarray (N,)
        Ends of the brackets.
    halvings : int
        The brackets shrink by 2^halvings. Each call of `stays` makes up for one to four of them.

    Returns
    -------
    near, far : ndarray (N,)
        Neighbouring places: as at `near` and not.
    tried : int
        Places that `stays` was asked about.
    """
    tried = 0
    while halvings > 0 and len(near):
        at_once = min(_MOST, halvings, max(1, int(np.log2(_AT_ONCE / len(near) + 1.0))))
        shares = np.linspace(0.0, 1.0, 2**at_once + 1)
        places = near[:, None] + shares * (far - near)[:, None]
        places[:, -1] = far
        rows = np.repeat(np.arange(len(near)), len(shares) - 2)
        inner = stays(rows, places[:, 1:-1].ravel()).reshape(len(near), -1)
        k = np.where(inner.all(axis=1), inner.shape[1], np.argmin(inner, axis=1))
        near, far = np.take_along_axis(places, np.stack([k, k + 1], 1), 1).T
        halvings, tried = halvings - at_once, tried + len(rows)
    return near, far, tried


# Bisections of each boundary: of a scan's step 1e-6 is left.
_HALVINGS = 20
_ROWS = 20_000
# The box of the columns is widened so often while there are poses at its sides.
_WIDENINGS = 5
# Of the search for what fits inside: directions, and in the end, poses along each, places tried.
_DIRECTIONS, _CHECKED, _SCAN, _PLACES = 50, 800, 10, 40
Progress = Callable[[int, int], None]
#: Poses (N, 4, 4) of offsets (N, 3) from the centre.
Moved = Callable[[Array], Array]


class Inside(Protocol):
    """What tells which poses are within all limits, and how far they are from each."""

    names: tuple[str, ...]

    def at(self, poses: Array) -> Array:
        """Margins (N, k) at poses (N, 4, 4)."""

    def inside(self, poses: Array) -> NDArray[np.bool_]:
        """Which poses (N,) are within all limits."""


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays from a centre to the boundaries.

    Attributes
    ----------
    directions : ndarray (d, 3)
        Unit vectors.
    weights : ndarray (d,)
        Of the rule; their sum is 1.
    first : ndarray (d,)
        Distance (or angle) to the first boundary; 0 where the centre is outside.
    edges : list of (ray, distance, enters, limit)
        Every boundary: the number of its ray, its distance, whether the ray enters there, and the
        name of the limit that cuts.
    reach : float
        How far the rays were followed.
    poses : int
        How many poses were tried.
    """

    directions: Array
    weights: Array
    first: Array
    edges: list[tuple[int, float, bool, str]]
    reach: float
    poses: int

    @property
    def is_cut_short(self) -> bool:
        """Whether a ray is still inside where it ends."""
        return any(x >= (1.0 - 0.5**_HALVINGS) * self.reach for _, x, _, _ in self.edges)

    def total(self, measure: Callable[[float], float]) -> float:
        """Sum over the rays of what a measure gives to the parts inside, weighted."""
        return float(
            sum(
                self.weights[ray] * (-1.0 if enters else 1.0) * measure(distance)
                for ray, distance, enters, _ in self.edges
            )
        )

    def shares(self) -> dict[str, float]:
        """Share of the outermost boundary, by solid angle from the centre, that each limit cuts."""
        last: dict[int, tuple[float, str]] = {}
        for ray, distance, enters, name in self.edges:
            if not enters and distance > last.get(ray, (-1.0, ""))[0]:
                last[ray] = (distance, name)
        shares: dict[str, float] = {}
        for ray, (_, name) in last.items():
            shares[name] = shares.get(name, 0.0) + float(self.weights[ray])
        total = sum(shares.values()) or 1.0
        return {n: x / total for n, x in sorted(shares.items(), key=lambda pair: -pair[1])}


def sphere_rule(count: int) -> tuple[Array, Array]:
    """About `count` directions (d, 3) and weights (d,): Gauss in height, equal steps around."""
    rows = max(2, round(np.sqrt(count / 2.0)))
    height, weight = np.polynomial.legendre.leggauss(rows)
    turns = (np.arange(2 * rows) + 0.5) * np.pi / rows
    z, angle = (part.ravel() for part in np.meshgrid(height, turns, indexing="ij"))
    radius = np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    return directions, np.repeat(weight, 2 * rows) / (4.0 * rows)


def rays_to_boundaries(
    margins: Inside,
    pose_at: Moved,
    reach: float,
    count: int,
    scan: int,
    progress: Progress | None = None,
) -> Rays:
    """Boundaries along rays; `pose_at` makes poses (N, 4, 4) of offsets (N, 3) from the centre."""
    directions, weights = sphere_rule(count)
    d = len(directions)
    steps = np.linspace(0.0, reach, scan + 1)
    inside = np.empty((d, scan + 1), bool)
    block = max(1, _ROWS // (scan + 1))
    for i in range(0, d, block):
        part = directions[i : i + block]
        offsets = (part[:, None] * steps[:, None]).reshape(-1, 3)
        inside[i : i + block] = margins.inside(pose_at(offsets)).reshape(len(part), -1)
        if progress is not None:
            progress(min(i + block, d), d)
    inside[:, -1] = False
    ray, step = np.nonzero(inside[:, 1:] != inside[:, :-1])
    near, far = steps[step].copy(), steps[step + 1].copy()
    enters = inside[ray, step + 1]

    def stays(rows: NDArray[np.intp], places: Array) -> NDArray[np.bool_]:
        within = margins.inside(pose_at(places[:, None] * directions[ray[rows]]))
        return np.asarray(within != enters[rows])

    near, far, tried = narrowed(stays, near, far, _HALVINGS)
    outside = np.where(enters, near, far)
    cuts = margins.at(pose_at(outside[:, None] * directions[ray])).argmin(axis=1)
    names = np.array(margins.names)[cuts]
    edge = np.where(enters, far, near)  # the last pose that is within
    first = np.zeros(d)
    known: set[int] = set()
    for k, r in enumerate(ray.tolist()):
        if r not in known and inside[r, 0]:
            first[r] = edge[k]
        known.add(r)
    edges = [
        (int(r), float(x), bool(e), str(n))
        for r, x, e, n in zip(ray, edge, enters, names, strict=True)
    ]
    return Rays(directions, weights, first, edges, reach, d * (scan + 1) + tried)


class Columns(NamedTuple):
    """Columns of positions inside, along z.

    Attributes
    ----------
    volume : float
        Of all of them.
    places : ndarray (k, 2)
        x and y of their middles, in F.
    ends : ndarray (k, 2)
        Lower and upper end of each part inside, in F.
    area : float
        Across a column.
    poses : int
        How many poses were tried.
    error : float
        Three standard errors of the volume: it is the mean of what four grids of every second
        column give.
    """

    volume: float
    places: Array
    ends: Array
    area: float
    poses: int
    error: float = 0.0

    def slices(self, count: int) -> list[tuple[float, float]]:
        """Height and area of so many slices across z, at equal distances."""
        if not len(self.ends):
            return []
        low, high = float(self.ends[:, 0].min()), float(self.ends[:, 1].max())
        heights = low + (np.arange(count) + 0.5) * (high - low) / count
        within = (self.ends[:, :1] <= heights) & (heights <= self.ends[:, 1:])
        areas = self.area * within.sum(axis=0)
        return list(zip(heights.tolist(), areas.tolist(), strict=True))


def columns_inside(
    margins: Inside,
    pose_at: Moved,
    centre: Array,
    boundary: Array,
    count: int,
    scan: int,
    reach: float,
) -> Columns:
    """Columns over the box around boundary positions (k, 3), widened until it holds all.

    Positions further than `reach` from the centre do not count.
    """

    def within(places: Array) -> Array:
        offsets = places - centre
        near = np.linalg.norm(offsets, axis=1) <= reach
        reached = np.zeros(len(places), bool)
        reached[near] = margins.inside(pose_at(offsets[near]))
        return reached

    if not len(boundary):
        return Columns(0.0, np.empty((0, 2)), np.empty((0, 2)), 0.0, 0)
    low, high = boundary.min(axis=0), boundary.max(axis=0)
    wide = np.maximum(high - low, numerics.NEARBY * reach)
    low, high = low - 0.03 * wide, high + 0.03 * wide
    poses = 0
    for _ in range(_WIDENINGS):
        axes = [low[i] + (np.arange(count) + 0.5) * (high[i] - low[i]) / count for i in (0, 1)]
        xy = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        z = np.linspace(low[2], high[2], scan + 1)
        inside = np.empty((len(xy), scan + 1), bool)
        block = max(1, _ROWS // (scan + 1))
        for i in range(0, len(xy), block):
            part = xy[i : i + block]
            places = np.hstack([np.repeat(part, scan + 1, 0), np.tile(z, len(part))[:, None]])
            inside[i : i + block] = within(places).reshape(len(part), -1)
        poses += inside.size
        square = inside.any(axis=1).reshape(count, count)
        ends_z = inside[:, 0].any() | inside[:, -1].any()
        if not (square[[0, -1]].any() or square[:, [0, -1]].any() or ends_z):
            break
        middle, wide = 0.5 * (low + high), 1.3 * (high - low)
        low, high = middle - 0.5 * wide, middle + 0.5 * wide
    inside[:, [0, -1]] = False
    row, step = np.nonzero(inside[:, 1:] != inside[:, :-1])
    enters = inside[row, step + 1]
    a, b = z[step].copy(), z[step + 1].copy()

    def stays(rows: NDArray[np.intp], places: Array) -> NDArray[np.bool_]:
        return np.asarray(within(np.column_stack([xy[row[rows]], places])) != enters[rows])

    a, b, tried = narrowed(stays, a, b, _HALVINGS)
    edge = 0.5 * (a + b)
    area = float(np.prod((high - low)[:2]) / count**2)
    ends = np.column_stack([edge[enters], edge[~enters]])
    heights = np.bincount(row[enters], ends[:, 1] - ends[:, 0], count * count)
    grid = heights.reshape(count, count)
    coarse = [grid[i::2, j::2].mean() * grid.size * area for i in (0, 1) for j in (0, 1)]
    error = 1.5 * float(np.std(coarse, ddof=1))
    volume = area * float(heights.sum())
    return Columns(volume, xy[row[enters]], ends, area, poses + tried, error)


def inscribed(
    margins: Inside, pose_at: Moved, centre: Array, positions: Rays
) -> tuple[tuple[Array, float], tuple[Array, float]]:
    """Largest sphere and cube inside, from the best of some starts by a direct search."""
    from scipy.optimize import minimize

    reach, scan = positions.reach, _SCAN
    corners = np.array([c for c in product((-1.0, 0.0, 1.0), repeat=3) if any(c)])
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    few, many = (np.vstack([corners, sphere_rule(n)[0]]) for n in (_DIRECTIONS, _CHECKED))
    steps = np.linspace(0.0, reach, scan + 1)

    def room(place: Array, directions: Array, size: Array) -> float | None:
        """Least of the sizes (d,) times the distances to the boundary; None outside."""
        offsets = place + (directions[:, None] * steps[:, None]).reshape(-1, 3)
        inside = margins.inside(pose_at(offsets)).reshape(len(directions), -1)
        if not inside[0, 0]:
            return None
        k = np.where(inside.all(axis=1), scan, np.argmin(inside, axis=1))
        # Directions that end farther away than another one's bracket are not looked at again.
        near = np.flatnonzero(steps[k - 1] * size <= (steps[k] * size).min())
        ways = directions[near]

        def stays(rows: NDArray[np.intp], distances: Array) -> NDArray[np.bool_]:
            return margins.inside(pose_at(place + distances[:, None] * ways[rows]))

        ends, _, _ = narrowed(stays, steps[k - 1][near], steps[k][near], _HALVINGS // 2)
        return float((ends * size[near]).min())

    def largest(size: Callable[[Array], Array]) -> tuple[Array, float]:
        sizes = size(few)

        def less(place: Array) -> float:
            margin = room(place, few, sizes)
            return float(np.linalg.norm(place)) if margin is None else -margin

        inner = positions.first.min() or 0.1 * reach
        simplex = np.vstack([np.zeros(3), np.eye(3) * max(inner, 0.02 * reach)])
        options = {
            "initial_simplex": simplex,
            "maxfev": _PLACES,
            "xatol": 0.0,
            "fatol": 0.0,
        }
        best = minimize(less, np.zeros(3), method="Nelder-Mead", options=options)
        return centre + best.x, room(best.x, many, size(many)) or 0.0

    sphere = largest(lambda directions: np.ones(len(directions)))
    cube = largest(lambda directions: np.abs(directions).max(axis=1))
    return sphere, (cube[0], 2.0 * cube[1])


def shifted(pose: Array, offsets: Array) -> Array:
    """A pose (4, 4) moved by offsets (N, 3) in F."""
    poses = np.tile(pose, (len(offsets), 1, 1))
    poses[:, :3, 3] += offsets
    return poses
