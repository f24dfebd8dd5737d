"""The points of a part of which a report has pages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cartstiff.core.errors import InputError, one_line

if TYPE_CHECKING:
    from cartstiff.core.mechanisms.elastic import ElasticMechanism
    from cartstiff.shown.page.html_report import ReportPoint

# Random starts of the inverse kinematics at each point.
_STARTS = 32


def read_points(path: Path, elastic: ElasticMechanism, q: Any) -> list[ReportPoint]:
    """The points of a file, each with its posture.

    Parameters
    ----------
    path : Path
        Joint positions under their names, one posture a line; or poses of the body frame,
        as in a path file, which are reached next to the posture, with wrenches if there
        are any.
    elastic : ElasticMechanism
        The mechanism.
    q : array_like (n,) or mapping, optional
        The posture next to which poses are reached; default the mechanism's.

    Raises
    ------
    InputError
        With the line for anything that cannot be used, and for a point that is out of
        reach.
    """
    import numpy as np

    from cartstiff.files.tables import read_cells
    from cartstiff.kinematics.inverse import inverse_kinematics
    from cartstiff.shown.cli.tables import read_path_file
    from cartstiff.shown.page.html_report import ReportPoint
    from cartstiff.shown.page.source import read_trajectory
    from cartstiff.wings.toolpaths.better import next_to

    names = [f"point {i} of {path.name}" for i in range(1, 1 + _MOST)]
    heads = read_cells(path, "points", joints=elastic.names, nameless=True).names
    columns = {head.partition(" ")[0] for head in heads}
    if columns & ({*elastic.names} - _POSE):
        postures = read_trajectory(path, elastic.names, elastic.units).q
        _few_enough(len(postures), path)
        return [ReportPoint(name, x) for name, x in zip(names, postures, strict=False)]
    # Poses with wrenches.
    mechanism = elastic.mechanism
    parts = read_path_file(path, base=mechanism.base_pose, units=elastic.units)
    _few_enough(len(parts), path)
    near = replace(elastic, q=elastic.placed(q)[1].q)
    wrenches: list[Any] = [None] * len(parts)
    if parts.wrenches is not None:
        own = parts.wrenches_in_body(np.arange(len(parts)), parts.poses)
        turned = [np.kron(np.eye(2), T[:3, :3]) for T in parts.poses]
        wrenches = [R @ W for R, W in zip(turned, own, strict=True)]
    points = []
    for name, T, wrench in zip(names, parts.poses, wrenches, strict=False):
        found = next_to(near, np.asarray(inverse_kinematics(near, T, _STARTS)))
        if not len(found):
            raise InputError(f"{name} is out of reach", where="--at-points")
        nearest = np.abs(found - near.q).max(axis=1).argmin()
        points.append(ReportPoint(name, found[nearest], wrench))
    return points


_POSE = {"x", "y", "z", "roll", "pitch", "yaw"}
# Largest number of points: each is a page to print.
_MOST = 200


def _few_enough(count: int, path: Path) -> None:
    if not 0 < count <= _MOST:
        raise InputError(
            "points cannot all have a page",
            where=one_line(str(path)),
            expected=f"1 to {_MOST}",
            got=count,
        )
