r"""Singular poses around a pose: where a determinant changes its sign, and how far that is.

Poses around (R, p) are ``(R exp(x_1..3 / L), p + x_4..6)`` with L the body's length: \|x\| is then
the distance in the metric ``d^2 = |dp|^2 + (L angle)^2``. The nearest x with det(x) = 0 solves

    x <- g (g . x - det) / |g|^2,    g = grad det,

from the nearest changes of sign on rays: the shortest x that a linear determinant would ask for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.reach.margins import LegMargins, Margins
from cartstiff.reach.regions import Moved, Rays, narrowed

#: Determinants (N,) at poses (N, 4, 4), NaN where there is none.
Determinant = Callable[[Array], Array]
_HALVINGS, _STEPS, _STARTS = 40, 60, 48
# Of the determinant's change over a length, for its slope.
_STEP = numerics.DIFFERENCE


@dataclass(frozen=True, eq=False)
class Singular:
    """The singular poses around a pose.

    Attributes
    ----------
    surface : ndarray (k, 3)
        Values of the workspace's axes at which the determinant changes its sign, on the rays, with
        or without limits.
    distance : float or None
        To the nearest singular pose found, turned or not, in the metric above; a length. None
        where none was found.
    pose : ndarray (4, 4) or None
        That pose of M.
    shift : float or None
        To the nearest singular position found with the orientation kept.
    length : float
        L of the metric.
    """

    surface: Array
    distance: float | None = None
    pose: Array | None = None
    shift: float | None = None
    length: float = 1.0

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "metric": "sqrt(distance^2 + (length angle)^2)",
            "length": self.length,
            "distance": self.distance,
            "pose": None if self.pose is None else self.pose.tolist(),
            "shift": self.shift,
            "surface": self.surface.tolist(),
        }


def singular_around(
    margins: Margins | LegMargins, pose: Array, moved: Moved, rays: Rays, scan: int
) -> Singular | None:
    """Singular poses around a pose, the surface on rays; None where no determinant tells.

    The surface is given in offsets.
    """
    if not margins.sign:
        return None
    signed = margins.determinants
    length = margins.length
    surface = crossings(signed, moved, rays.directions, rays.reach, scan)
    if isinstance(margins, LegMargins) and len(margins.free) < 6:
        return Singular(surface, length=length)
    few = 10 if margins.is_slow else 200
    x = nearest_singular(signed, pose, length, np.pi * length, range(6), few)
    shift = nearest_singular(signed, pose, length, np.pi * length, range(3, 6), few)
    return Singular(
        surface,
        None if x is None else float(np.linalg.norm(x)),
        None if x is None else around(pose, x[None], length)[0],
        None if shift is None else float(np.linalg.norm(shift)),
        length,
    )


def least_ratio(
    margins: Margins | LegMargins, moved: Moved, rays: Rays
) -> tuple[float, Array] | None:
    """The least ratio of singular values on the part of each ray that hangs on the centre."""
    shares = np.linspace(0.0, 1.0, 9)
    offsets = (shares[:, None, None] * rays.first[:, None] * rays.directions).reshape(-1, 3)
    ratio = margins.ratios(moved(offsets))
    if ratio is None:
        return None
    k = int(ratio.argmin())
    return float(ratio[k]), offsets[k]


def crossings(
    signed: Determinant, moved: Moved, directions: Array, reach: float | Array, scan: int
) -> Array:
    """Offsets (k, d) along rays, up to `reach` (of each), where a determinant changes its sign."""
    steps = np.linspace(np.zeros(len(directions)), reach, scan + 1, axis=-1)
    offsets = (directions[:, None] * steps[:, :, None]).reshape(-1, directions.shape[1])
    sign = np.sign(signed(moved(offsets))).reshape(len(directions), -1)
    ray, step = np.nonzero(sign[:, 1:] * sign[:, :-1] < 0.0)

    def stays(rows: NDArray[np.intp], places: Array) -> NDArray[np.bool_]:
        values = signed(moved(places[:, None] * directions[ray[rows]]))
        return np.asarray(np.sign(values) == sign[ray[rows], step[rows]])

    near, far, _ = narrowed(stays, steps[ray, step], steps[ray, step + 1], _HALVINGS)
    points: Array = near[:, None] * directions[ray]
    # Where a determinant jumps it has no root: legs fold over, or change their branch.
    if len(points):
        low, high = (np.abs(signed(moved(x[:, None] * directions[ray]))) for x in (near, far))
        there = np.abs(signed(moved(steps[ray, step][:, None] * directions[ray])))
        points = points[np.maximum(low, high) <= numerics.LOST_ERROR * there]
    return points


def nearest_singular(
    signed: Determinant,
    pose: Array,
    length: float,
    reach: float,
    axes: Sequence[int],
    rays: int = 200,
) -> Array | None:
    """Shortest x (6,) found of the module's metric at which a determinant vanishes.

    Only the components `axes` of x, of which there are six, are moved. It is looked for on so many
    rays per component, up to `reach`; None where it vanishes on none.
    """
    rng = np.random.default_rng(6)
    n = len(axes)

    def at(x: Array) -> Array:
        full = np.zeros((len(x), 6))
        full[:, list(axes)] = x
        return around(pose, full, length)

    directions = rng.normal(size=(rays * n, n))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    starts = crossings(signed, at, directions, reach, 32)
    if not len(starts):
        return None
    x = starts[np.argsort(np.linalg.norm(starts, axis=1))[:_STARTS]]
    best, h = x.copy(), _STEP * length
    for _ in range(_STEPS):
        tried = x[:, None] + h * np.vstack([np.zeros((1, n)), np.eye(n), -np.eye(n)])
        values = signed(at(tried.reshape(-1, n))).reshape(len(x), -1)
        value, g = values[:, 0], (values[:, 1 : n + 1] - values[:, n + 1 :]) / (2.0 * h)
        with np.errstate(all="ignore"):
            new = g * ((g * x).sum(axis=1) - value)[:, None] / (g * g).sum(axis=1)[:, None]
        known = np.isfinite(new).all(axis=1)
        step = np.where(known[:, None], new - x, 0.0)
        # Long steps leave what is linear.
        size = np.linalg.norm(step, axis=1)
        x = x + step * np.minimum(1.0, 0.2 * length / np.maximum(size, h))[:, None]
        best = np.where((size <= h)[:, None], x, best)
        if (size <= numerics.REPORTED_ERROR * length).all():
            break
    size = np.linalg.norm(best, axis=1)
    ends = crossings(signed, at, best / size[:, None], 1.05 * size, 64)
    if not len(ends):
        return None
    nearest = np.zeros(6)
    nearest[list(axes)] = min(ends, key=np.linalg.norm)
    return nearest


def around(pose: Array, x: Array, length: float) -> Array:
    """Poses (N, 4, 4) at x (N, 6) of the module's metric."""
    turns = np.hstack([x[:, :3] / length, np.zeros((len(x), 3))])
    poses = np.tile(pose, (len(x), 1, 1))
    poses[:, :3, :3] = pose[:3, :3] @ se3.exp(turns)[:, :3, :3]
    poses[:, :3, 3] += x[:, 3:]
    return poses
