r"""Angles of legs' joints and distances of legs: limits of use,
on which nothing comes to rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.contract import Quantities

#: Ends (..., m, 3) in F of straight rods: those at the ground, and those at the body.
Ends = Callable[[Array, Array], tuple[Array, Array]]


def tilts(ends: Ends, axes: Array, where: str, q: Array, pose: Array) -> Array:
    """Angles (..., m) of lines from axes (m, 3) at their "base",
    or in M at the "platform".
    """
    starts, stops = ends(q, pose)
    along = stops - starts
    along = along / np.maximum(
        np.linalg.norm(along, axis=-1, keepdims=True), numerics.TINY
    )
    if where == "platform":
        along, axes = -along, axes @ pose[..., :3, :3].swapaxes(-1, -2)
    across = np.linalg.norm(np.cross(along, axes), axis=-1)  # exact for small angles, too
    return np.asarray(np.arctan2(across, (along * axes).sum(axis=-1)))


def clearances(
    diameters: Sequence[float | None],
    anchors: Array,
    points: Array,
    are_fixed: NDArray[np.bool_],
    ends: Ends,
) -> Quantities:
    """Distances of rods with diameters: at least the mean of the two.

    Rods that end at one point of the body, or fixed ones that start at one point, have no
    such limit. `points` (m, 3) are those of the body.
    """
    same = numerics.NEGLIGIBLE_DISTANCE * max(np.abs(anchors).max(), np.abs(points).max())
    rows, pairs = [], []
    for (i, a), (j, b) in combinations(enumerate(diameters), 2):
        meet = np.abs(points[i] - points[j]).max() <= same or (
            are_fixed[i]
            and are_fixed[j]
            and np.abs(anchors[i] - anchors[j]).max() <= same
        )
        if a and b and not meet:
            rows.append(
                (f"distance of leg{i + 1} and leg{j + 1}", 0.5 * (a + b), np.inf, False)
            )
            pairs.append((i, j))
    return Quantities(
        rows, partial(_distances, np.array(pairs, np.intp).reshape(-1, 2), ends)
    )


def _distances(pairs: NDArray[np.intp], ends: Ends, q: Array, pose: Array) -> Array:
    (first, second), (starts, ends_there) = pairs.T, ends(q, pose)
    return distances_of_segments(
        starts[..., first, :],
        ends_there[..., first, :],
        starts[..., second, :],
        ends_there[..., second, :],
    )


def distances_of_segments(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the least distances (...) of segments from a to b and from c to d,
    arrays (..., 3).

    It is the least distance of the lines, where that is within both segments; else that
    of an end.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1)
    uw, vw = (u * w).sum(-1), (v * w).sum(-1)
    across = uu * vv - uv * uv
    with numerics.silent():
        s = (uv * vw - vv * uw) / across
        t = (uu * vw - uv * uw) / across
        inside = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1) & (across > 0)
        lines = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    ends = [
        _to_segment(a, c, v),
        _to_segment(b, c, v),
        _to_segment(c, a, u),
        _to_segment(d, a, u),
    ]
    least = np.minimum.reduce(ends)
    return np.where(inside, np.minimum(np.where(inside, lines, np.inf), least), least)


def _to_segment(point: Array, start: Array, along: Array) -> Array:
    away = point - start
    square = np.maximum((along * along).sum(-1), numerics.TINY)
    share = np.clip((away * along).sum(-1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - share[..., None] * along, axis=-1))
