"""Poses of the body in place of coordinates: grids of positions, and samplings of whole poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import prod
from threading import Lock
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.arrays import checked_seed, is_pose
from cartstiff.batch.quick_poses import QuickPoses
from cartstiff.batch.work import timed
from cartstiff.checked_call import checked
from cartstiff.errors import InputError, UnknownNameError, checked_kind
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.at_pose import at_poses
from cartstiff.kinematics.inverse import Free, inverse_kinematics
from cartstiff.kinematics.joint_poses import JointPoses
from cartstiff.kinematics.legs import legs_of
from cartstiff.maps.sampling import Axis, RandomPostures, Sampling, as_axis, grid_indices
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic

#: Which posture of a self-motion is taken: the one nearest to the base posture, or the one at which
#: the map's first quantity is best.
Redundancy = Literal["nearest", "best"]

_NAMES = ("x", "y", "z")
#: Places that are solved for at once.
PLACES_AT_ONCE = 200
# Searches from a start from which on machine code is made for them.
_MUCH = 20_000
# Combinations of legs' solutions among which the nearest, or best, are chosen.
_LISTED = 64
# Machine code of a search works in memory of its own: one search at a time.
_SEARCH = Lock()


class CartesianGrid(Sampling):
    """Positions of the body frame's origin in F, at one orientation, by inverse kinematics.

    The last dimension counts the branches found at a place, the one nearest to the base posture
    first. Places that no start reaches have no posture.

    Parameters
    ----------
    axes : mapping of {"x", "y", "z"} to Axis or (low, high, count)
        In the mechanism's length unit; those left out stay where the base posture is.
    elastic : ElasticMechanism
        The mechanism.
    base : array_like (n,)
        Posture that gives the rest of the pose, and the first start of the inverse kinematics.
    orientation : array_like (3, 3), optional
        Rotation of the body frame in F; default that of the base posture.
    branches : int
        How many branches are kept.
    starts, seed : int
        Random starts besides the base posture, and their seed. Where a body is carried by legs,
        each leg has so many.
    free : {"none", "x", "y", "z", "rotation"}
        A rotation about an axis of the body, or all of its rotation, may be left free.
    redundancy : {"nearest", "best"}
        Where postures at a place form a family, the member that is taken: each start's solution
        moves along the self-motion to the least distance from the base posture nearby, or to where
        the map's first quantity is best.
    """

    stores_q = True
    whole = ("branch",)

    @checked
    def __init__(
        self,
        axes: Mapping[str, Axis | Sequence[float]],
        elastic: ElasticMechanism,
        base: ArrayLike,
        orientation: ArrayLike | None = None,
        *,
        branches: int = 8,
        starts: int = 24,
        seed: int = 0,
        free: Free = "none",
        redundancy: Redundancy = "nearest",
    ) -> None:
        checked_elastic(elastic)
        checked_kind(axes, Mapping, "axes of a grid", "names and (low, high, count)")
        for name in axes:
            if name not in _NAMES:
                raise UnknownNameError("axis", name, _NAMES)
        if branches < 1 or starts < 0:
            raise InputError("branches or starts cannot be used", got=(branches, starts))
        for what, value, known in (
            ("free rotation", free, get_args(Free)),
            ("choice of redundancy", redundancy, get_args(Redundancy)),
        ):
            if value not in known:
                raise UnknownNameError(what, value, known)
        posture = elastic.mechanism.closed(base)
        place = posture.pose[:3, 3]
        self.axes = {
            name: as_axis(name, axes.get(name, (place[i], place[i], 1)))
            for i, name in enumerate(_NAMES)
        }
        self.orientation = np.array(
            posture.pose[:3, :3] if orientation is None else orientation, float
        )
        if not is_pose(se3.pose(self.orientation)):
            raise InputError("orientation is not a rotation", got=self.orientation.tolist())
        self.base = np.array(posture.q)
        self.free, self.redundancy = free, redundancy
        self.branches, self.count, self.seed = int(branches), int(starts), checked_seed(seed)
        #: Legs that are searched one by one; 0 where the mechanism is searched as a whole.
        self.legs = len(legs_of(elastic) or ())
        self.dims = (*_NAMES, "branch")
        self.shape = (*(axis.count for axis in self.axes.values()), self.branches)
        self._starts: Array | None = None
        self._quick: tuple[ElasticMechanism, JointPoses | None] | None = None

    def starts(self, elastic: ElasticMechanism) -> Array:
        """Starts of the inverse kinematics (1 + starts, n): the base posture, then random ones."""
        if self._starts is None:
            random = []
            if self.count:
                near = {
                    c.name: (self.base[i] - 1.0, self.base[i] + 1.0)
                    for i, c in enumerate(elastic.mechanism.coordinates)
                    if c.is_length and not np.isfinite([c.lower, c.upper]).all()
                }
                within = RandomPostures.within_limits(elastic, self.count, self.seed, near)
                random = list(within.postures((slice(0, self.count),)))
            self._starts = np.array([self.base, *random])
        return self._starts

    def __getstate__(self) -> dict[str, Any]:
        """Machine code stays in its process."""
        return {**vars(self), "_quick": None}

    def _solver(self, elastic: ElasticMechanism) -> JointPoses | None:
        """Machine code where there is much to do: the same for all of the map, wherever it is."""
        if self._quick is None or self._quick[0] is not elastic:
            solver = None
            if isinstance(elastic.mechanism, Chain) and not self.legs:
                every = prod(self.shape[:3]) * (1 + self.count)
                solver = (QuickPoses if every >= _MUCH else JointPoses)(elastic)
            self._quick = elastic, solver
        return self._quick[1]

    def solve(
        self,
        box: tuple[slice, ...],
        elastic: ElasticMechanism,
        cost: Callable[[Array], Array] | None = None,
    ) -> tuple[Array, Array]:
        """Postures of a box (cells * branches, n), NaN where there is none, and their number.

        Many places at once are quicker, and have the same postures as one by one. `cost` gives the
        number that is to be small for "best".
        """
        values = [axis.values for axis in self.axes.values()]
        places = np.stack(
            [v[i] for v, i in zip(values, grid_indices(box[:3]), strict=True)], axis=1
        )
        poses = np.tile(se3.pose(self.orientation), (len(places), 1, 1))
        poses[:, :3, 3] = places
        q = np.full((len(places), self.branches, len(self.base)), np.nan)
        counts = np.zeros(len(places), int)
        angle = np.array([not c.is_length for c in elastic.mechanism.coordinates])

        def away(postures: Array) -> Array:
            """Distance from the base posture, angles the short way round."""
            d = postures - self.base
            d = np.where(angle, (d + np.pi) % (2 * np.pi) - np.pi, d)
            size: Array = np.linalg.norm(d, axis=-1)
            return size

        for first in range(0, len(places), PLACES_AT_ONCE):
            some = list(poses[first : first + PLACES_AT_ONCE])
            with _SEARCH, timed("inverse kinematics of the places", len(some)):
                part = inverse_kinematics(
                    elastic,
                    some,
                    self.starts(elastic),
                    free=self.free,
                    cost=cost if self.redundancy == "best" else away,
                    most=max(self.branches, _LISTED),
                    solver=self._solver(elastic),
                )
            for cell, solutions in enumerate(part, start=first):
                # The nearest first; equally near ones stay in their order.
                order = np.argsort(np.round(away(solutions), 9), kind="stable")[: self.branches]
                counts[cell] = (
                    len(solutions) if solutions.search is None else solutions.search.found
                )
                q[cell, : len(order)] = solutions[order]
        return q.reshape(-1, len(self.base)), counts

    def postures(self, box: tuple[slice, ...], elastic: ElasticMechanism | None = None) -> Array:
        """Coordinates (m, n) of a box; NaN rows where there is no such branch."""
        if elastic is None:
            raise InputError("a Cartesian grid has no postures without its mechanism")
        return self.solve(box, elastic)[0]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "kind": "cartesian",
            "axes": {name: axis.as_list() for name, axis in self.axes.items()},
            "orientation": self.orientation.tolist(),
            "base": self.base.tolist(),
            "branches": self.branches,
            "starts": self.count,
            "seed": self.seed,
            "legs": self.legs,
            "free": self.free,
            "redundancy": self.redundancy,
        }


class AtPoses(Sampling):
    """Postures at poses of the body, in the working mode of the mechanism's default posture.

    Of a body with fewer than six freedoms the other coordinates of the pose follow, as in
    `cartstiff.at_pose`. Poses that a leg does not reach have no posture.

    Parameters
    ----------
    poses : Sampling
        Of x, y, z, roll, pitch, yaw (lengths, rad) of the body in F.
    """

    stores_q = is_closed = True

    def __init__(self, poses: Sampling) -> None:
        self.poses, self.dims, self.shape, self.axes = poses, poses.dims, poses.shape, poses.axes

    def postures(self, box: tuple[slice, ...], elastic: ElasticMechanism | None = None) -> Array:
        """Coordinates (m, n) of a box; NaN rows where the body does not get."""
        if elastic is None:
            raise InputError("poses have no postures without their mechanism")
        return np.asarray(at_poses(elastic, self.poses.postures(box))[0])

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"kind": "poses", "of": self.poses.as_dict()}
