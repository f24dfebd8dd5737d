"""Samplings of poses of the body: grids of positions, and samplings of whole poses."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from math import prod
from threading import Lock
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, checked_seed, is_pose
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.kinematics.at_pose import COORDINATES, at_poses
from cartstiff.kinematics.inverse import inverse_kinematics
from cartstiff.kinematics.joint_poses import Free, JointPoses
from cartstiff.kinematics.legs import legs_of
from cartstiff.recorded.kernels import WORTH_COMPILING
from cartstiff.recorded.quick_poses import QuickPoses
from cartstiff.wings.maps.sampling import (
    Axis,
    RandomPostures,
    Sampling,
    checked_axes,
    grid_indices,
)

#: Choice of the posture on a self-motion: nearest to the base posture, or best in the
#: map's first quantity.
Redundancy = Literal["nearest", "best"]

_AXIS_NAMES = ("x", "y", "z")
#: Number of places whose inverse kinematics is solved at once.
PLACES_AT_ONCE = 200
# Largest number of combinations of the legs' solutions among which the branches are
# chosen.
_MAX_CANDIDATES = 64
# Machine code of a search uses one shared work space: one search at a time.
_SEARCH_LOCK = Lock()


class CartesianGrid(Sampling):
    """Positions of the body frame's origin in F, at one orientation, by inverse
    kinematics.

    The last dimension numbers the branches found at a place, nearest to the base posture
    first. Places that no start reaches have no posture.

    Parameters
    ----------
    axes : mapping of {"x", "y", "z"} to Axis or (low, high, count)
        In the mechanism's length unit; those left out stay where the base posture is.
    elastic : ElasticMechanism
        The mechanism.
    base : array_like (n,)
        Posture that supplies the rest of the pose, and the first start of the inverse
        kinematics.
    orientation : array_like (3, 3), optional
        Rotation of the body frame in F; default that of the base posture.
    branches : int
        Largest number of branches that are kept at a place.
    starts : int
        Random starts of the inverse kinematics besides the base posture; for a body on
        legs, of each leg.
    seed : int
        Seed of the random starts.
    free : {"none", "x", "y", "z", "rotation"}
        Rotation of the body that is left free, about one of its axes or any.
    redundancy : {"nearest", "best"}
        Choice among the postures of a self-motion: each start's solution moves along it
        to the local minimum of the distance from the base posture, or to the local
        optimum of the map's first quantity.

    Raises
    ------
    InputError
        For other axes, words or numbers than these.
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
        own = checked_axes(axes, _AXIS_NAMES, "axis")
        if branches < 1 or starts < 0 or branches % 1 or starts % 1:
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
            name: own.get(name, Axis(place[i], place[i], 1))
            for i, name in enumerate(_AXIS_NAMES)
        }
        self.orientation = np.array(
            posture.pose[:3, :3] if orientation is None else orientation, float
        )
        if not is_pose(se3.pose(self.orientation)):
            raise InputError(
                "orientation is not a rotation", got=self.orientation.tolist()
            )
        self.base, self.names = np.array(posture.q), elastic.names
        self.free, self.redundancy = free, redundancy
        self.branches, self.count, self.seed = (
            int(branches),
            int(starts),
            checked_seed(seed),
        )
        #: Number of legs that are searched separately; 0 if the mechanism is searched as
        #: a whole.
        self.legs = len(legs_of(elastic) or ())
        self.dims = (*_AXIS_NAMES, "branch")
        self.shape = (*(axis.count for axis in self.axes.values()), self.branches)
        self._starts: Array | None = None
        self._quick: tuple[ElasticMechanism, JointPoses | None] | None = None

    def starts(self, elastic: ElasticMechanism) -> Array:
        """Return the coordinates (1 + starts, n) from which the inverse kinematics
        starts, the base posture first.
        """
        if self._starts is None:
            random = []
            if self.count:
                near = {
                    c.name: (self.base[i] - 1.0, self.base[i] + 1.0)
                    for i, c in enumerate(elastic.mechanism.coordinates)
                    if c.is_length and not np.isfinite([c.lower, c.upper]).all()
                }
                within = RandomPostures.within_limits(
                    elastic, self.count, self.seed, near
                )
                random = list(within.postures((slice(0, self.count),)))
            self._starts = np.array([self.base, *random])
        return self._starts

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the compiled search, which belongs to its process."""
        return {**vars(self), "_quick": None}

    def _solver(self, elastic: ElasticMechanism) -> JointPoses | None:
        """The solver: compiled for large maps, and the same for all parts of a map."""
        if self._quick is None or self._quick[0] is not elastic:
            solver = None
            if not (self.legs or elastic.mechanism.coordinates_are_pose):
                every = prod(self.shape[:3]) * (1 + self.count)
                solver = (QuickPoses if every >= WORTH_COMPILING else JointPoses)(elastic)
            self._quick = elastic, solver
        return self._quick[1]

    def solve(
        self,
        box: tuple[slice, ...],
        elastic: ElasticMechanism,
        cost: Callable[[Array], Array] | None = None,
    ) -> tuple[Array, Array]:
        """The coordinates of a box (cells * branches, n) and their number at each place
        (cells,).

        Rows without a posture are NaN. The postures do not depend on how many places are
        solved at once. `cost`, of (k, n) coordinates to (k,) numbers of any unit, is
        minimised along self-motions for "best".
        """
        values = [axis.values for axis in self.axes.values()]
        places = np.stack(
            [v[i] for v, i in zip(values, grid_indices(box[:3]), strict=True)], axis=1
        )
        poses = np.tile(se3.pose(self.orientation), (len(places), 1, 1))
        poses[:, :3, 3] = places
        q = np.full((len(places), self.branches, len(self.base)), np.nan)
        counts = np.zeros(len(places), int)
        angle = ~elastic.mechanism.is_length

        def away(postures: Array) -> Array:
            """Return the distance from the base posture, angles modulo whole turns."""
            d = postures - self.base
            d = np.where(angle, (d + np.pi) % (2 * np.pi) - np.pi, d)
            size: Array = np.linalg.norm(d, axis=-1)
            return size

        for first in range(0, len(places), PLACES_AT_ONCE):
            some = list(poses[first : first + PLACES_AT_ONCE])
            with _SEARCH_LOCK:
                part = inverse_kinematics(
                    elastic,
                    some,
                    self.starts(elastic),
                    free=self.free,
                    cost=cost if self.redundancy == "best" else away,
                    most=max(self.branches, _MAX_CANDIDATES),
                    solver=self._solver(elastic),
                )
            for cell, solutions in enumerate(part, start=first):
                # Sorted by distance; equally distant solutions keep their order.
                order = np.argsort(np.round(away(solutions), 9), kind="stable")[
                    : self.branches
                ]
                counts[cell] = (
                    len(solutions) if solutions.search is None else solutions.search.found
                )
                q[cell, : len(order)] = solutions[order]
        return q.reshape(-1, len(self.base)), counts

    def postures(
        self, box: tuple[slice, ...], elastic: ElasticMechanism | None = None
    ) -> Array:
        """Coordinates (m, n) of a box; NaN rows where there is no such branch.

        Raises
        ------
        InputError
            Without the mechanism.
        """
        if elastic is None:
            raise InputError("a Cartesian grid has no postures without its mechanism")
        return self.solve(box, elastic)[0]

    def to_dict(self) -> dict[str, Any]:
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
    """Postures at poses of the body, in the working mode of the mechanism's
    default posture.

    For a body with fewer than six freedoms the other coordinates of the pose follow, as
    in `cartstiff.at_pose`. Poses that a leg does not reach have no posture.

    Parameters
    ----------
    poses : Sampling
        Samples of x, y, z, roll, pitch, yaw (lengths, rad) of the body in F.
    given : collection of str
        Coordinates of the pose that a body with fewer than six freedoms takes first.
    """

    stores_q = is_closed = True

    def __init__(self, poses: Sampling, given: Collection[str] = ()) -> None:
        self.given = [i for i, name in enumerate(COORDINATES) if name in given]
        self.poses, self.dims, self.shape, self.axes = (
            poses,
            poses.dims,
            poses.shape,
            poses.axes,
        )

    def postures(
        self, box: tuple[slice, ...], elastic: ElasticMechanism | None = None
    ) -> Array:
        """Coordinates (m, n) of a box; NaN rows for poses that are not reached."""
        if elastic is None:
            raise InputError("poses have no postures without their mechanism")
        return np.asarray(at_poses(elastic, self.poses.postures(box), self.given)[0])

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"kind": "poses", "of": self.poses.to_dict()}
