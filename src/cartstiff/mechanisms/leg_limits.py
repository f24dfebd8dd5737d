r"""What besides their lengths limits the legs of a platform: joint angles, each other, forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.leg_shapes import PlacedLeg


@dataclass(frozen=True, eq=False)
class LegLimits:
    """Limits of m legs, besides their lengths; None where there is none.

    Attributes
    ----------
    base_axes, platform_axes : ndarray (m, 3) or None
        Unit vectors in F, and in M: middle directions of the joints, from the joint along the leg.
    base_angles, platform_angles : ndarray (m,) or None
        Largest angle of each leg from the axis of its joint, in rad.
    diameters : ndarray (m,) or None
        Of the legs as cylinders: two come no nearer than the mean of theirs.
    forces : ndarray (m, 2) or None
        Least and largest tension of each leg; compression is negative.
    """

    base_axes: Array | None = None
    base_angles: Array | None = None
    platform_axes: Array | None = None
    platform_angles: Array | None = None
    diameters: Array | None = None
    forces: Array | None = None

    def in_units(self, a: float) -> LegLimits:
        """The same with lengths a times as many."""
        if self.diameters is None:
            return self
        return replace(self, diameters=self.diameters * a)

    def pairs(self, anchors: Array, points: Array) -> list[tuple[int, int]]:
        """Legs that may come near each other: all that share no joint."""
        if self.diameters is None:
            return []
        size = max(float(np.abs(anchors).max()), float(np.abs(points).max()))
        return [
            (i, j)
            for i, j in combinations(range(len(anchors)), 2)
            if min(np.abs(p[i] - p[j]).max() for p in (anchors, points)) > numerics.NEARBY * size
        ]

    def rows(self, anchors: Array, points: Array) -> list[tuple[str, float, float, bool]]:
        """Name, lower and upper limit, and whether it is an angle, of each limited quantity."""
        limits: list[tuple[str, float, float, bool]] = []
        for where, angles in (("base", self.base_angles), ("platform", self.platform_angles)):
            if angles is not None:
                limits += [
                    (f"angle of leg{i + 1} at the {where}", 0.0, float(angle), True)
                    for i, angle in enumerate(angles)
                ]
        if self.diameters is not None:
            limits += [
                (
                    f"distance of leg{i + 1} and leg{j + 1}",
                    0.5 * float(self.diameters[i] + self.diameters[j]),
                    np.inf,
                    False,
                )
                for i, j in self.pairs(anchors, points)
            ]
        return limits

    def values(self, anchors: Array, points: Array, pose: Array) -> Array:
        """The quantities of `rows` (..., k) at poses (..., 4, 4) of M."""
        R, p = pose[..., :3, :3], pose[..., None, :3, 3]
        ends = points @ R.swapaxes(-1, -2) + p
        along = ends - anchors
        along = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), numerics.TINY)
        parts = []
        if self.base_axes is not None:
            parts.append(_angles(along, self.base_axes))
        if self.platform_axes is not None:
            parts.append(_angles(-along, self.platform_axes @ R.swapaxes(-1, -2)))
        pairs = np.array(self.pairs(anchors, points), np.intp).reshape(-1, 2)
        if len(pairs):
            starts = np.broadcast_to(anchors, ends.shape)
            first, second = pairs.T
            parts.append(
                distances_of_segments(
                    starts[..., first, :],
                    ends[..., first, :],
                    starts[..., second, :],
                    ends[..., second, :],
                )
            )
        return np.concatenate(parts, axis=-1) if parts else np.empty((*pose.shape[:-2], 0))


class RodLimits:
    """Rods of legs made of joints come no nearer to each other than the mean of their diameters.

    Rods that end at one point of the body, or struts that start at one point, are no such pair.
    """

    def __init__(self, legs: Sequence[PlacedLeg]) -> None:
        places = [place for leg in legs for place in (leg.shape.anchor, leg.T_M_end[:3, 3])]
        near = numerics.NEARBY * float(np.abs(places).max())
        self._pairs = []
        for (i, a), (j, b) in combinations(enumerate(legs, start=1), 2):
            ends = np.abs(a.T_M_end[:3, 3] - b.T_M_end[:3, 3]).max()
            fixed = a.shape.family == b.shape.family == "strut"
            start = np.abs(a.shape.anchor - b.shape.anchor).max() if fixed else np.inf
            if a.diameter and b.diameter and min(ends, start) > near:
                self._pairs.append((f"distance of leg{i} and leg{j}", a, b))

    def rows(self) -> list[tuple[str, float, float, bool]]:
        """As of `LegLimits`."""
        return [
            (name, 0.5 * ((a.diameter or 0.0) + (b.diameter or 0.0)), np.inf, False)
            for name, a, b in self._pairs
        ]

    def values(self, q: Array, pose: Array) -> Array:
        """Distances (..., k) at coordinates q (..., n) and poses (..., 4, 4) of M."""
        distances = [
            distances_of_segments(*a.rod(q, pose), *b.rod(q, pose)) for _, a, b in self._pairs
        ]
        return np.stack(distances, axis=-1) if distances else np.empty((*pose.shape[:-2], 0))


def _angles(u: Array, axes: Array) -> Array:
    """Angles (...) between unit vectors (..., 3), exact for small ones too."""
    across = np.linalg.norm(np.cross(u, axes), axis=-1)
    return np.asarray(np.arctan2(across, (u * axes).sum(axis=-1)))


def distances_of_segments(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Least distances (...) between segments from a to b and from c to d, arrays (..., 3).

    The least distance of the lines, where it is within both segments; else one of an end.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1)
    uw, vw = (u * w).sum(-1), (v * w).sum(-1)
    across = uu * vv - uv * uv
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (uv * vw - vv * uw) / across
        t = (uu * vw - uv * uw) / across
        inside = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1) & (across > 0)
        lines = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    ends = [_to_segment(a, c, v), _to_segment(b, c, v), _to_segment(c, a, u), _to_segment(d, a, u)]
    least = np.minimum.reduce(ends)
    return np.where(inside, np.minimum(np.where(inside, lines, np.inf), least), least)


def _to_segment(point: Array, start: Array, along: Array) -> Array:
    away = point - start
    square = np.maximum((along * along).sum(-1), numerics.TINY)
    share = np.clip((away * along).sum(-1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - share[..., None] * along, axis=-1))
