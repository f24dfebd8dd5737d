r"""Platforms whose legs are dependent in every pose, and the names of such architectures.

If the lines of the legs have a rank below six at general poses, no lengths hold the
platform ([MaAngeles]_; [HustyKarger]_).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.platform import Platform
from cartstiff.core.notes import Note

# General poses at which the rank is computed, and their seed: no two random ones are
# singular.
_POSES, _SEED = 4, 6


@dataclass(frozen=True)
class Architecture:
    """How many of a platform's legs are independent in a general pose.

    Attributes
    ----------
    rank : int
        Rank of the lines of the legs.
    legs : int
        Number of legs.
    name : str
        Description of a singular architecture; empty for a regular one.
    """

    rank: int
    legs: int
    name: str

    @property
    def is_singular(self) -> bool:
        """Whether six or more legs hold the platform in no pose."""
        return self.legs >= 6 and self.rank < 6

    def note(self) -> Note | None:
        """Note on the singularity of all poses; None for a regular architecture."""
        if not self.is_singular:
            return None
        message = (
            f"architecture singularity: the {self.legs} legs' lines have rank "
            f"{self.rank} in every pose, {self.name}: no lengths hold the platform, and "
            "with those of a pose it moves"
        )
        values: dict[str, Any] = {"rank": self.rank, "legs": self.legs, "name": self.name}
        return Note("architecture-singularity", message, values)


def architecture_of(platform: Platform) -> Architecture:
    """Rank of a platform's legs at general poses, and the name of a singular
    architecture.
    """
    rank = max(_ranks(platform, None))
    legs = len(platform.points)
    name = _name(platform) if legs >= 6 and rank < 6 else ""
    return Architecture(rank, legs, name)


def orientation_rank(platform: Platform, R: Array) -> int:
    """Rank of the legs' lines at general positions with one orientation R (3, 3) of M.

    Below six with a regular architecture, the orientation is singular at every position:
    Fichter's platform turned by a right angle ([Fichter]_).
    """
    return max(_ranks(platform, R))


def _ranks(platform: Platform, R: Array | None) -> list[int]:
    rng = np.random.default_rng(_SEED)
    at, of = platform.anchors.mean(axis=0), platform.points.mean(axis=0)
    size = max(
        float(np.abs(platform.anchors - at).max()),
        float(np.abs(platform.points - of).max()),
    )
    ranks = []
    for _ in range(_POSES):
        turn = se3.exp(np.append(rng.normal(size=3), np.zeros(3)))[:3, :3]
        turn = turn if R is None else R
        b = (platform.points - of) @ turn.T
        along = rng.normal(size=3) * 3.0 * size + b - (platform.anchors - at)
        along /= np.linalg.norm(along, axis=1)[:, None]
        lines = np.hstack([np.cross(b / size, along), along])
        ranks.append(numerics.rank(np.linalg.svd(lines, compute_uv=False)))
    return ranks


def _flat(points: Array) -> Array | None:
    """Coordinates (m, 2) of points in their plane.

    None if they are in none, or on a line.
    """
    about = points - points.mean(axis=0)
    values, axes = np.linalg.svd(about)[1:]
    if numerics.rank(values) != 2:
        return None
    return np.asarray(about @ axes[:2].T)


def _rank_of(rows: Array) -> int:
    scaled = rows / np.maximum(np.abs(rows).max(axis=0), numerics.TINY)
    return numerics.rank(np.linalg.svd(scaled, compute_uv=False))


def _name(platform: Platform) -> str:
    """Description of a singular architecture."""
    anchors, points = platform.anchors, platform.points
    for where, rows in (("base", anchors), ("platform", points)):
        spread = np.linalg.svd(rows - rows.mean(axis=0), compute_uv=False)
        if numerics.rank(spread) == 1:
            return f"all points of the {where} are on a line"
        fours = (rows[list(four)] for four in combinations(range(len(rows)), 4))
        least = min((np.ptp(four, axis=0).max() for four in fours), default=np.inf)
        if least <= numerics.NEGLIGIBLE_DISTANCE * spread[0]:
            return f"four legs meet in a point of the {where}"
    a, b = _flat(anchors), _flat(points)
    if a is None or b is None:
        return "of no type with a name here"
    return _planar_type(a, b)


def _planar_type(a: Array, b: Array) -> str:
    """Description of a singular architecture with base and platform in planes."""
    one = np.ones((len(a), 1))
    if _rank_of(np.hstack([a, one, b])) == 3:
        scale, about = (
            np.linalg.svd(np.linalg.lstsq(a, b, rcond=None)[0])[1],
            "affine images",
        )
        if abs(scale[0] - scale[1]) <= numerics.NEGLIGIBLE_DISTANCE * scale[0]:
            about = "similar"
        return f"of Ma and Angeles' type: base and platform are {about}, on a conic"
    if not (_is_griffis_duffy(a, b) or _is_griffis_duffy(b, a)):
        return "a planar one of no type with a name here"
    return (
        "of Griffis and Duffy's type: the corners of each triangle are joined to "
        "sides of the other"
    )


def _is_griffis_duffy(a: Array, b: Array) -> bool:
    """Whether legs join three corners in `a` to sides in `b`,
    and three sides in `a` to corners.
    """
    if len(a) != 6:
        return False
    for corners in combinations(range(6), 3):
        others = [i for i in range(6) if i not in corners]
        if _on_sides(a, list(corners), others) and _on_sides(b, others, list(corners)):
            return True
    return False


def _on_sides(points: Array, corners: list[int], others: list[int]) -> bool:
    """Whether each of three points is on a side of its own of a triangle."""
    triangle = np.hstack([points[corners], np.ones((3, 1))])
    if numerics.rank(np.linalg.svd(triangle, compute_uv=False)) < 3:
        return False
    shares = np.linalg.solve(triangle.T, np.hstack([points[others], np.ones((3, 1))]).T)
    zero = np.abs(shares) <= numerics.NEGLIGIBLE_DISTANCE
    return bool((zero.sum(axis=0) == 1).all() and (zero.sum(axis=1) == 1).all())
