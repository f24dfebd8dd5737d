"""Pictures of optimised paths and of placements."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff.figures import new_figure
from cartstiff.toolpaths.optimised import OptimisedPath
from cartstiff.toolpaths.placement import Placement


def draw_path(result: OptimisedPath) -> Any:
    """Criterion along the path, optimised and with the best constant choice; the free choice below.

    Returns
    -------
    matplotlib.figure.Figure
        See `cartstiff.report.output.save_figure`.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    chosen = _choice(result)
    figure = new_figure(6.4, 4.2 if chosen is None else 6.0)
    axes = np.atleast_1d(figure.subplots(1 if chosen is None else 2, 1, sharex=True))
    points = np.arange(1, len(result.q) + 1)
    if result.constant is not None:
        axes[0].plot(
            points,
            result.constant.values,
            "s--",
            color="0.5",
            markersize=3,
            label="best constant choice",
        )
    axes[0].plot(points, result.values, "o-", color="C0", markersize=3, label="optimised")
    better = result.criterion.better
    axes[0].set_ylabel(f"{result.criterion.name} [{result.unit}], {better} is better")
    axes[0].set_ylim(bottom=0)
    axes[0].legend()
    axes[0].set_title(f"{result.elastic.name}: {result.criterion.description}", fontsize="medium")
    if chosen is not None:
        label, values, constant = chosen
        if constant is not None:
            axes[1].axhline(constant, linestyle="--", color="0.5")
        axes[1].plot(points, values, "o-", color="C0", markersize=3)
        axes[1].set_ylabel(label)
    axes[-1].set_xlabel("point of the path")
    axes[-1].locator_params(axis="x", integer=True)
    return figure


def _choice(result: OptimisedPath) -> tuple[str, np.ndarray[Any, Any], float | None] | None:
    """What was free along the path: label, values, and its best constant value."""
    constant = {} if result.constant is None else result.constant.choice
    if result.angles is not None:
        angle = constant.get("angle")
        if angle is not None:  # in the turn in which the path is
            angle += 2 * np.pi * np.round((result.angles.mean() - angle) / (2 * np.pi))
        return (
            f"turn about the tool's {result.free} axis [deg]",
            np.degrees(result.angles),
            None if angle is None else float(np.degrees(angle)),
        )
    if result.joint is not None:
        j = result.elastic.names.index(result.joint)
        is_length = result.elastic.mechanism.coordinates[j].is_length
        unit = result.elastic.units.coordinate(is_length)
        return f"{result.joint} [{unit}]", result.q[:, j], constant.get("position")
    return None


def draw_placement(placement: Placement) -> Any:
    """Worst value of the criterion over the places, where one or two coordinates vary.

    Of more, the slice of the grid nearest to the best place. Places from which the path cannot be
    followed are crosses.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    names = [n for n, values in placement.axes.items() if len(values) > 1]
    shown, units = names[:2], placement.path.elastic.units
    index = tuple(
        slice(None) if n in shown else int(np.argmin(np.abs(v - placement.place[n])))
        for n, v in placement.axes.items()
    )
    worst = placement.worst[index]
    label = f"worst {placement.path.criterion.name} [{placement.path.unit}]"
    titles = [f"workpiece {n} [{'rad' if n == 'yaw' else units.length}]" for n in shown]
    figure = new_figure(6.4, 4.6)
    axes = figure.subplots()
    if len(shown) < 2:
        values = placement.axes[shown[0]] if shown else np.zeros(1)
        axes.plot(values, np.atleast_1d(worst), "o-")
        for value in values[np.isnan(np.atleast_1d(worst))]:
            axes.axvline(value, color="0.8")
        axes.set_ylabel(label)
    else:
        x, y = (placement.axes[n] for n in shown)
        mesh = axes.pcolormesh(
            x, y, np.ma.masked_invalid(worst.T), shading="nearest", cmap="cividis"
        )
        figure.colorbar(mesh, ax=axes, label=label)
        i, j = np.nonzero(np.isnan(worst))
        axes.plot(x[i], y[j], "x", color="0.4", label="cannot be followed")
        axes.plot(
            placement.place[shown[0]],
            placement.place[shown[1]],
            "*",
            color="C3",
            markersize=14,
            label="best place",
        )
        axes.set_ylabel(titles[1])
        figure.legend(loc="outside lower center", ncols=2)
    axes.set_xlabel(titles[0] if titles else "workpiece")
    axes.set_title(placement.path.elastic.name)
    return figure
