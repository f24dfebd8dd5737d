"""Pictures of maps: heat maps, slices, lines, histograms, violins by region, points in space.

Colours come from a map that is readable without colour vision. Cells without a number are grey and
hatched, and the legend names their state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.errors import UnknownNameError
from cartstiff.maps.drawing.distributions import histogram, points, violin
from cartstiff.maps.drawing.grids import heat_map, line, slices
from cartstiff.maps.reading import quantity_of

if TYPE_CHECKING:
    import xarray


def draw_map(
    dataset: xarray.Dataset,
    quantity: str,
    kind: str = "auto",
    *,
    by: str | None = None,
    level: float | None = None,
    angle: str = "rad",
) -> Any:
    """Draw a map in the way that suits its dimensions, or in a given one.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `open_map`, or a slice of it.
    quantity : str
        What is shown.
    kind : str
        One of `KINDS`, or "auto": a line, heat map or slices for one, two or three dimensions, a
        histogram for more and for random postures.
    by : str, optional
        For "violin" and "slices": the axis, joint or direction along which the map is cut.
    level : float, optional
        For heat maps: a value of the quantity, in its unit, at which a line is drawn.
    angle : str
        What joints stand in along the axes: "rad" or "deg".

    Returns
    -------
    matplotlib.figure.Figure
        See `cartstiff.report.output.save_figure`.

    Raises
    ------
    UnknownNameError
        For an unknown kind or quantity.
    InputError
        If the kind does not fit the dimensions.
    """
    if angle == "deg":
        dataset = _in_degrees(dataset)
    array = quantity_of(dataset, quantity)
    if kind == "auto":
        if by is not None:
            kind = "violin"
        elif "posture" in array.dims:
            kind = "histogram" if array.size > 2000 else "line"
        else:
            wide = sum(n > 1 for d, n in array.sizes.items() if d != "branch")
            kind = {0: "histogram", 1: "line", 2: "heat", 3: "slices"}.get(wide, "histogram")
    if kind not in KINDS:
        raise UnknownNameError("kind of picture", kind, KINDS)
    if by is not None and kind in ("violin", "slices"):
        return KINDS[kind](dataset, quantity, by)
    if level is not None and kind == "heat":
        return heat_map(dataset, quantity, level)
    return KINDS[kind](dataset, quantity)


def _in_degrees(dataset: xarray.Dataset) -> xarray.Dataset:
    """The map with the angles along its axes in degrees."""
    shown = {}
    for name, axis in dataset.coords.items():
        if axis.attrs.get("units") == "rad":
            shown[name] = (axis.dims, np.degrees(axis.values), axis.attrs | {"units": "deg"})
    return dataset.assign_coords(shown)


#: Pictures by name.
KINDS: dict[str, Callable[..., Any]] = {
    "heat": heat_map,
    "slices": slices,
    "line": line,
    "histogram": histogram,
    "violin": violin,
    "points": points,
}
