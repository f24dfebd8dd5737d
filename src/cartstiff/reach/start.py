"""What a workspace starts from: how far it goes, what is carried, whether it is singular."""

from __future__ import annotations

from typing import Literal

import numpy as np

from cartstiff.arrays import checked_length
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.kinematics.architecture import architecture_of, orientation_rank
from cartstiff.mechanisms.platform import Platform
from cartstiff.notes import Note
from cartstiff.reach.margins import CarriedLoad, Margins
from cartstiff.stiffness.applied_load import LoadKind


def carried(
    kind: LoadKind, wrench: Array, axes: Literal["body", "world"], start: Array
) -> CarriedLoad:
    """The load along the axes in which it is the same at all poses, from those at the start."""
    if kind.kind == "conservative":
        raise InputError(
            "a moment that turns by half depends on where the body comes from",
            where="load_kind",
            expected="dead or follower",
            got=kind.kind,
        )
    parts, R = wrench.reshape(2, 3), start[:3, :3]
    if kind.kind == "follower":
        return kind, (parts @ R if axes == "world" else parts).reshape(6), "body"
    return kind, (parts @ R.T if axes == "body" else parts).reshape(6), "world"


def singular_note(platform: Platform, pose: Array, margins: Margins) -> Note | None:
    """The note on an architecture, or an orientation, that is singular everywhere."""
    note = architecture_of(platform).note()
    if note is not None or margins.is_spread:
        return note
    rank = orientation_rank(platform, pose[:3, :3])
    if rank == 6:
        return None
    message = (
        f"with this orientation the legs' lines have rank {rank} at every position, though the "
        "architecture is regular (as Fichter's platform turned by a right angle)"
    )
    return Note("orientation-singularity", message, {"rank": rank})


def reach_of_lines(platform: Platform, pose: Array, radius: float | None) -> float:
    """How far from the centre any position can be: where the legs' longest lengths end."""
    if radius is not None:
        return checked_length(radius, "radius")
    longest = np.inf if platform.limits is None else platform.limits[:, 1]
    ends = platform.points @ pose[:3, :3].T + pose[:3, 3] - platform.anchors
    farthest = float(np.min(np.linalg.norm(ends, axis=1) + longest))
    if not np.isfinite(farthest):
        raise InputError(
            "the lengths of the legs have no upper limit, so that the workspace has no bound",
            expected="legs.limits, or a radius",
        )
    return farthest
