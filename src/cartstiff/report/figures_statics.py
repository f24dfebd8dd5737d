"""Pictures of deflections: load-deflection curve, error along a path."""

from __future__ import annotations

from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.figures import new_figure
from cartstiff.statics.continuation import LoadCurve
from cartstiff.statics.toolpath import CompensatedPath


def draw_load_curve(curve: LoadCurve, *, rotation: bool = False) -> Any:
    """Load factor over displacement, unstable parts dashed, critical loads and linear prediction.

    Parameters
    ----------
    curve : LoadCurve
        From `load_curve`.
    rotation : bool
        Show the rotation angle instead of the distance.

    Returns
    -------
    matplotlib.figure.Figure
        See `cartstiff.report.output.save_figure`.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure = new_figure()
    axes = figure.subplots()
    part = slice(0, 3) if rotation else slice(3, 6)
    size = np.linalg.norm(curve.displacement[:, part], axis=1)
    unit = curve.elastic.units.length
    if rotation:
        unit = curve.elastic.units.shown_angle
        size = np.degrees(size) if unit == "deg" else size
    kinds = ((True, "-", "stable"), (False, "--", "unstable"), (None, "-.", "not decided"))
    for verdict, style, label in kinds:
        shown = np.array([s is verdict for s in curve.stable])
        # A stretch includes the points next to it, so that the line has no gaps.
        near = shown.copy()
        near[1:] |= shown[:-1]
        near[:-1] |= shown[1:]
        if shown.any():
            axes.plot(
                np.where(near, size, np.nan),
                np.where(near, curve.factors, np.nan),
                style,
                color="C0",
                label=label,
            )
    last = int(np.argmax(np.abs(curve.factors)))
    linear = float(np.linalg.norm(curve.linear[last, part]))
    linear = np.degrees(linear) if unit == "deg" else linear
    if np.isfinite(linear):
        # As far as the curve goes: beyond it the prediction says nothing.
        share = min(1.0, 1.1 * float(size.max()) / max(linear, numerics.TINY))
        axes.plot(
            [0.0, share * linear],
            [0.0, share * curve.factors[last]],
            ":",
            color="0.4",
            label="linear",
        )
    for point in curve.critical:
        axes.axhline(point.factor, color="C3", linewidth=0.8)
        axes.annotate(
            f"{point.kind} {point.factor:.6g}",
            (0.02, point.factor),
            xycoords=("axes fraction", "data"),
            va="bottom",
            color="C3",
        )
    axes.set_xlabel(f"{'rotation' if rotation else 'displacement'} of the body frame [{unit}]")
    axes.set_ylabel("load factor")
    axes.set_title(curve.elastic.name)
    axes.legend()
    return figure


def draw_error_along_path(path: CompensatedPath) -> Any:
    """Translation and rotation error of the loaded end-effector, before and after compensation.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure = new_figure(6.4, 7.2)
    axes = figure.subplots(2, 1, sharex=True)
    points = np.arange(1, len(path.q) + 1)
    units, size = path.elastic.units, path.elastic.mechanism.at(path.q[0]).length
    parts = (
        (slice(3, 6), units.length, "translation"),
        (slice(0, 3), units.shown_angle, "rotation"),
    )
    for axis, (part, unit, name) in zip(axes, parts, strict=True):
        for errors, label in ((path.before, "before"), (path.after, "after")):
            # A logarithmic axis has no zero: the rounding of poses stands for it.
            least = numerics.ROUNDING * (size if unit == units.length else 1.0)
            error = np.maximum(np.linalg.norm(errors[:, part], axis=1), least)
            error = np.degrees(error) if unit == "deg" else error
            axis.semilogy(points, error, "o-", markersize=3, label=label)
        axis.set_ylabel(f"{name} error [{unit}]")
        axis.legend()
    axes[-1].set_xlabel("point of the path")
    axes[0].set_title(path.elastic.name)
    return figure
