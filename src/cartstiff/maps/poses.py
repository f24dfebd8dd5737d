"""Poses of a body carried by legs, in place of the coordinates of its joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.at_pose import at_poses
from cartstiff.maps.sampling import Axis, Sampling
from cartstiff.mechanisms.elastic import ElasticMechanism

__all__ = ["AtPoses"]


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
        self.poses, self.dims, self.shape = poses, poses.dims, poses.shape

    @property
    def axes(self) -> Mapping[str, Axis]:
        """Values along the dimensions that have some."""
        return self.poses.axes

    def postures(self, box: tuple[slice, ...], elastic: ElasticMechanism | None = None) -> Array:
        """Coordinates (m, n) of a box; NaN rows where the body does not get."""
        if elastic is None:
            raise InputError("poses have no postures without their mechanism")
        return np.asarray(at_poses(elastic, self.poses.postures(box))[0])

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"kind": "poses", "of": self.poses.as_dict()}
