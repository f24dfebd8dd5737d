"""Optimised paths and placements as text for people, and as figures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.errors import joined
from cartstiff.figures import new_figure
from cartstiff.mechanisms.elastic import gravity_loads
from cartstiff.mechanisms.other_units import shown
from cartstiff.report.layout import body_frame, number, table
from cartstiff.toolpaths.optimised import OptimisedPath
from cartstiff.toolpaths.placement import Placement

if TYPE_CHECKING:
    from cartstiff.toolpaths.optimised import OptimisedPath
    from cartstiff.toolpaths.placement import Placement

# Points and places that are listed one by one.
_MOST = 24


def describe_optimised_path(result: OptimisedPath, *, is_written: bool = False) -> str:
    """What was optimised, what it gained, and each point; whether a file has all of them."""
    facts, units = result.summary(), result.elastic.units
    under = "unloaded"
    if result.loaded:
        at = ", ".join(number(x) for x in result.load.at)
        under = f"under the path's load, {result.load.kind} at ({at}): {result.load.words}"
    lines = [
        f"{result.elastic.name}, {body_frame(result.elastic.mechanism)}: {len(result.q)} points, "
        f"{result.candidates} postures compared",
        f"{result.criterion.description} [{result.unit}], {result.criterion.better} is better; "
        f"K^{result.connection} {under}",
        f"free: {_free(result)}",
        gravity_loads(result.elastic).text,
        "",
    ]
    of_criterion = f" [{result.unit}]" if result.unit else ""
    titles = ("", f"worst{of_criterion}", f"mean{of_criterion}", "choice")
    rows = [("optimised", number(facts["worst"]), number(facts["mean"]), "varies")]
    if (constant := facts["constant"]) is not None and result.constant is not None:
        words = {"angle": units.shown_angle, "position": result.joint or ""}
        size = 180 / np.pi if units.shown_angle == "deg" else 1.0
        choice = ", ".join(
            f"{v * (size if k == 'angle' else 1.0):.4g} {words[k]}"
            for k, v in result.constant.choice.items()
        )
        rows.append(("best constant", number(constant["worst"]), number(constant["mean"]), choice))
    lines += table(titles, rows if len(rows) > 1 else [(*rows[0][:3], "")])
    if result.constant is None and result.angles is not None:
        lines.append("  no constant choice follows the path")
    lines += [
        "",
        f"worst at point {facts['worst_point']}; smallest over largest singular value at least "
        f"{facts['smallest_ratio']:.3g}",
        result.configuration,
        result.collisions if isinstance(result.collisions, str) else result.collisions["message"],
        "",
        "Postures",
    ]
    heads = ["point", *result.elastic.names]
    if result.angles is not None:
        heads.append("angle [deg]")
    heads.append(result.criterion.name + of_criterion)
    body = []
    for i, q in enumerate(shown(result.elastic, result.q[:_MOST])):
        row = [str(i + 1), *(f"{v:.5f}" for v in q)]
        if result.angles is not None:
            row.append(f"{np.degrees(result.angles[i]):.2f}")
        row.append(number(float(result.values[i])))
        body.append(tuple(row))
    lines += table(heads, body)
    if len(result.q) > _MOST:
        hint = "" if is_written else " (--csv writes all)"
        lines.append(f"  ... and {len(result.q) - _MOST} more points{hint}")
    lengths = [c.name for c in result.elastic.mechanism.coordinates if c.is_length]
    angle = units.shown_angle
    of_ranges = f"{angle}; {units.length} for {', '.join(lengths)}" if lengths else angle
    return joined([*lines, f"  coordinates in {of_ranges}"])


def _free(result: OptimisedPath) -> str:
    words = []
    if result.free in ("x", "y", "z"):
        words.append(f"rotation about the body's {result.free} axis")
    elif result.free == "rotation":
        words.append("all of the body's rotation")
    if result.joint is not None:
        words.append(f"a self-motion of the joints, sampled by {result.joint}")
    return " and ".join(words) or "only the branch of the inverse kinematics"


def describe_placement(placement: Placement, *, is_written: bool = False) -> str:
    """The best place, the places compared, and the path at the best one."""
    units = placement.path.elastic.units
    unit = {name: "rad" if name == "yaw" else units.length for name in placement.axes}
    shown = ", ".join(f"{n} = {v:.6g} {unit[n]}" for n, v in placement.place.items())
    lines = [f"Best place of the workpiece: {shown}", ""]
    heads = [*(f"{n} [{unit[n]}]" for n in placement.axes), f"worst [{placement.path.unit}]", ""]
    values = list(placement.axes.values())
    body = []
    for index in np.ndindex(placement.worst.shape):
        code, point = str(placement.codes[index]), int(placement.points[index])
        worst = "" if code else number(float(placement.worst[index]))
        row = [*(number(float(v[i])) for v, i in zip(values, index, strict=True)), worst]
        body.append((*row, f"{code} at point {point}" if code else ""))
    lines += table(heads, body[:_MOST])
    if len(body) > _MOST:
        lines.append(f"  ... and {len(body) - _MOST} more places (--json has all)")
    unusable = placement.counts()
    if unusable:
        counts = ", ".join(f"{n} {code}" for code, n in unusable.items())
        lines.append(f"  {sum(unusable.values())} of {len(body)} places cannot be used: {counts}")
    path = describe_optimised_path(placement.path, is_written=is_written).split("\n")
    return joined([*lines, "", "The path there", "", *path])


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
