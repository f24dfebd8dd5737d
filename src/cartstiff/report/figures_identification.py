"""Residuals of identified springs against load, posture and time."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.errors import printable
from cartstiff.figures import new_figure
from cartstiff.identify.result import Identification

_SUSPECT = "tab:red"


def draw_residuals(result: Identification) -> Any:
    """Residuals over their standard deviation, against load, posture, and time or row.

    Parameters
    ----------
    result : Identification
        From `cartstiff.identify.campaign.identify`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    measured, seen, solved = result.measured, result.model.observations, result.chosen.solved
    force = np.linalg.norm(measured.wrench[:, 3:], axis=1) / result.elastic.units.newtons
    weight = measured.mass * 9.81
    moment = np.linalg.norm(measured.wrench[:, :3], axis=1)
    load, unit = force + weight, "N" if result.elastic.units.force == "N" else "SI"
    name = "force"
    if not load.any():
        load, name, unit = moment, "moment", result.elastic.units.moment
    time = measured.time
    has_time = not np.isnan(time).any() and np.ptp(time) > 0.0
    standard = solved.residual / solved.deviation
    suspect = np.isin(seen.row, result.robust.suspects)
    figure = new_figure(9.0, 7.2)
    axes = figure.subplots(2, 2)
    over = (
        (load[seen.row], f"{name} [{unit}]"),
        (measured.postures[seen.row] + 1, "posture, in order of appearance"),
        (
            time[seen.row] if has_time else measured.rows[seen.row],
            "time [s]" if has_time else "row",
        ),
    )
    columns = np.array(seen.column)
    for axis, (x, label) in zip(axes.flat[:3], over, strict=True):
        for column in dict.fromkeys(seen.column):
            mine = (columns == column) & ~suspect
            axis.plot(x[mine], standard[mine], ".", label=printable(column))
        if suspect.any():
            axis.plot(x[suspect], standard[suspect], "x", color=_SUSPECT, label="suspect")
        for level in (-2.0, 0.0, 2.0):
            axis.axhline(level, color="0.7", linewidth=0.7, zorder=0)
        axis.set_xlabel(label)
        axis.set_ylabel("residual over standard deviation")
    axes.flat[0].legend(fontsize="small")
    _draw_stiffness(axes.flat[3], result)
    return figure


def _draw_stiffness(axis: Any, result: Identification) -> None:
    """Compliances with their intervals, over those of the mechanism at the start."""
    names: list[str] = []
    for e, nominal in zip(result.estimates, result.unknowns.nominal, strict=True):
        if e.compliance is None or e.interval is None or not nominal:
            continue
        low, high = e.interval
        centre = e.compliance / nominal
        wings = [[max(centre - low / nominal, 0.0)], [max(high / nominal - centre, 0.0)]]
        axis.errorbar([centre], [len(names)], xerr=wings, fmt="o", color="tab:blue", capsize=3)
        names.append(printable(e.name))
    axis.set_yticks(range(len(names)), names, fontsize="small")
    axis.invert_yaxis()
    axis.axvline(0.0, color="0.7", linewidth=0.7)
    axis.set_xlabel(f"compliance over the file's, {100 * result.level:g} % interval")
