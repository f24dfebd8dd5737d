"""Pictures of maps over their dimensions: heat maps, slices, lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.figures import new_figure
from cartstiff.geometry.se3 import Array
from cartstiff.maps.drawing.parts import (
    COLOURS,
    add_legend,
    colour_norm,
    reasons_of,
    style_of,
    title_of,
    wrapped,
)
from cartstiff.maps.reading import best_branch

if TYPE_CHECKING:
    import xarray


def squeezed(dataset: xarray.Dataset, quantity: str, count: int, kind: str) -> xarray.Dataset:
    """One branch, and exactly `count` dimensions."""
    chosen = best_branch(dataset, quantity)
    array = chosen[quantity]
    narrow = {d: 0 for d, n in array.sizes.items() if n == 1}
    wide = [str(d) for d in array.dims if d not in narrow]
    if len(wide) != count:
        raise InputError(
            f"a {kind} shows {count} dimension(s)",
            expected="slices of the map" if len(wide) > count else "more dimensions",
            got=", ".join(wide) or "none",
        )
    return chosen.isel(narrow)


def _edges(values: Array) -> Array:
    """Cell borders around equally spaced values."""
    step = (values[-1] - values[0]) / (len(values) - 1)
    edges: Array = np.concatenate([values - step / 2, values[-1:] + step / 2])
    return edges


def _axis_label(coordinate: xarray.DataArray) -> str:
    unit = coordinate.attrs.get("units")
    return f"{coordinate.name} [{unit}]" if unit else str(coordinate.name)


def _in_millimetres(coordinate: xarray.DataArray) -> xarray.DataArray:
    """A position as drawings have it, where the mechanism has it in metres."""
    if coordinate.attrs.get("units") != "m":
        return coordinate
    shown: xarray.DataArray = coordinate.copy(data=1e3 * np.asarray(coordinate.values, float))
    shown.attrs["units"] = "mm"
    return shown


def _cells(
    axis: Any, dataset: xarray.Dataset, quantity: str, norm: Any, level: float | None = None
) -> tuple[Any, set[str]]:
    """Coloured cells of two dimensions, and the reasons of those that have no number.

    Positions stand as in the room: x to the right, z up, as long as wide, in mm. At a `level` of
    the quantity there is a line.
    """
    dims = [str(d) for d in dataset[quantity].dims]
    spatial = set(dims) <= set("xyz")
    if spatial:
        dims = sorted(dims, reverse=True)
        dataset = dataset.transpose(*dims, ...)
    array = dataset[quantity]
    y, x = (_in_millimetres(dataset[d]) if spatial else dataset[d] for d in dims)
    values = np.asarray(array.values, float)
    shown = np.ma.masked_invalid(values)
    mesh = axis.pcolormesh(
        _edges(x.values), _edges(y.values), shown, cmap=COLOURS, norm=norm, rasterized=True
    )
    if level is not None and min(values.shape) > 1 and np.isfinite(values).any():
        low, high = np.nanmin(values), np.nanmax(values)
        if low < level < high:
            axis.contour(x.values, y.values, shown, levels=[level], colors="black", linewidths=1.5)
    if spatial:
        axis.set_aspect("equal")
    reasons = reasons_of(dataset, values)
    for name in sorted(set(reasons[reasons != ""].tolist())):
        _hatch(axis, x.values, y.values, reasons == name, name)
    axis.set(xlabel=_axis_label(x), ylabel=_axis_label(y))
    return mesh, set(reasons[reasons != ""].tolist())


def _hatch(axis: Any, x: Array, y: Array, where: Array, name: str) -> None:
    hatch, grey = style_of(name)
    axis.pcolormesh(
        _edges(x),
        _edges(y),
        np.ma.masked_where(~where, np.ones(where.shape)),
        cmap=_one_colour(grey),
        vmin=0.0,
        vmax=1.0,
        rasterized=True,
    )
    # Hatching follows the cells' borders: every cell is drawn as two points on each side.
    xx, yy = np.repeat(_edges(x), 2)[1:-1], np.repeat(_edges(y), 2)[1:-1]
    fine = np.repeat(np.repeat(where, 2, axis=0), 2, axis=1).astype(float)
    axis.contourf(xx, yy, fine, levels=[0.5, 1.5], colors="none", hatches=[hatch])


def _one_colour(colour: str) -> Any:
    from matplotlib.colors import ListedColormap

    return ListedColormap([colour])


def heat_map(dataset: xarray.Dataset, quantity: str, level: float | None = None) -> Any:
    """Colours over the two dimensions of a map, with a line at a level of the quantity."""
    flat = squeezed(dataset, quantity, 2, "heat map")
    figure = new_figure()
    axis = figure.subplots()
    mesh, reasons = _cells(
        axis, flat, quantity, colour_norm(np.asarray(flat[quantity].values, float)), level
    )
    figure.colorbar(mesh, ax=axis, label=wrapped(flat[quantity]))
    axis.set_title(title_of(flat))
    add_legend(figure, reasons)
    return figure


def slices(dataset: xarray.Dataset, quantity: str, by: str | None = None, count: int = 6) -> Any:
    """Heat maps at up to six values of the third dimension, with one scale.

    Parameters
    ----------
    dataset, quantity
        As in `draw_map`.
    by : str, optional
        The dimension that is cut; default the one with the fewest values.
    count : int
        Most heat maps.
    """
    flat = squeezed(dataset, quantity, 3, "picture of slices")
    array = flat[quantity]
    cut = by if by is not None else str(min(array.dims, key=lambda d: array.sizes[d]))
    if cut not in array.dims:
        raise UnknownNameError("axis of the map", cut, [str(d) for d in array.dims])
    length = array.sizes[cut]
    chosen = np.unique(np.linspace(0, length - 1, min(count, length)).round().astype(int))
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = new_figure(3.0 * columns + 1.4, 2.8 * rows + 0.8)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    parts = [flat.isel({cut: int(i)}) for i in chosen]
    norm = colour_norm(np.stack([np.asarray(p[quantity].values, float) for p in parts]))
    reasons: set[str] = set()
    mesh = None
    for i, part in enumerate(parts):
        axis = axes.flat[i]
        mesh, why = _cells(axis, part, quantity, norm)
        reasons |= why
        value = part[cut]
        axis.set_title(f"{cut} = {float(value):.4g} {value.attrs.get('units', '')}", fontsize=9)
        axis.label_outer()
    for axis in list(axes.flat)[len(parts) :]:
        axis.set_visible(False)
    figure.colorbar(mesh, ax=axes, label=wrapped(array))
    figure.suptitle(title_of(dataset))
    add_legend(figure, reasons)
    return figure


def line(dataset: xarray.Dataset, quantity: str) -> Any:
    """A curve along the only dimension of a map; grey where there is no number."""
    flat = squeezed(dataset, quantity, 1, "line")
    array = flat[quantity]
    dim = str(array.dims[0])
    name = "time" if "time" in flat.coords else dim
    x = np.asarray(flat[name].values if name in flat.coords else np.arange(array.size), float)
    values = np.asarray(array.values, float)
    figure = new_figure()
    axis = figure.subplots()
    marker = "." if np.isfinite(values).sum() < 200 else ""
    axis.plot(x, np.where(np.isfinite(values), values, np.nan), marker=marker)
    reasons = reasons_of(flat, values)
    edges = _edges(x) if len(x) > 1 else np.array([-0.5, 0.5])
    present = set(reasons[reasons != ""].tolist())
    for reason in sorted(present):
        hatch, grey = style_of(reason)
        rows = np.flatnonzero(reasons == reason)
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            axis.axvspan(
                edges[run[0]],
                edges[run[-1] + 1],
                facecolor=grey,
                edgecolor="0.3",
                hatch=hatch,
                linewidth=0,
            )
    axis.set(xlabel=_axis_label(flat[name]) if name in flat.coords else name)
    axis.set_ylabel(wrapped(array))
    axis.set_title(title_of(flat))
    add_legend(figure, present)
    return figure
