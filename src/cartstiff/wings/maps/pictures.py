"""Pictures of maps: heat maps, slices, lines, histograms.

Colours come from a map that is readable without colour vision. Cells without a number are
grey and hatched, and the legend names their state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import prod
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError
from cartstiff.core.figures import new_axes, new_figure
from cartstiff.wings.maps.reading import (
    best_branch,
    each_block,
    quantity_of,
    state_names,
    unit_label,
)
from cartstiff.wings.maps.store import fact

if TYPE_CHECKING:
    import xarray

#: Colour map, readable without colour vision.
COLOURS = "cividis"
#: Ratio of the largest to the smallest value from which on scales are logarithmic.
DECADES = 100.0
# Largest number of slices, and number of bins of a histogram.
_SLICES, _BINS = 6, 60
# Largest number of cells that are drawn, all of which are in memory.
_MOST_CELLS = 10**7
# Largest number of postures that are counted for a histogram.
_MOST_COUNTED = 10**10
# Largest number of random postures that are drawn as a line.
_MOST_OF_LINE = 2000
_HATCHES = ("////", "....", "xxxx", "\\\\\\\\", "oooo", "----")


@checked
def draw_map(
    dataset: xarray.Dataset, quantity: str, *, angle: str = "rad", ax: Any = None
) -> Any:
    """Draw a map: a line, heat map or slices for one, two or three dimensions,
    else a histogram.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `open_map`, or a slice of it.
    quantity : str
        Quantity to draw.
    angle : str
        Unit of joint angles along the axes: "rad" or "deg".
    ax : matplotlib.axes.Axes, optional
        Whose place the picture takes; default a figure of its own.

    Returns
    -------
    matplotlib.figure.Figure
        See `cartstiff.shown.report.output.save_figure`.

    Raises
    ------
    UnknownNameError
        For an unknown quantity.
    """
    quantity_of(dataset, quantity)
    if angle == "deg":
        dataset = _rescaled(dataset, "rad", "deg", np.degrees(1.0))
    draw = _suited(quantity_of(dataset, quantity).sizes)
    cells = prod(quantity_of(dataset, quantity).shape)
    if draw is not histogram and cells > _MOST_CELLS:
        raise InputError(
            "map is too large for a picture of all its cells",
            expected=f"at most {_MOST_CELLS}, such as those of a slice",
            got=cells,
        )
    if draw is not histogram:  # one branch, and no dimensions of one value
        dataset = best_branch(dataset, quantity)
        dataset = dataset.isel(
            {d: 0 for d, n in dataset[quantity].sizes.items() if n == 1}
        )
    return draw(dataset, quantity, ax)


def _suited(sizes: Mapping[Any, int]) -> Callable[[xarray.Dataset, str, Any], Any]:
    """Return what draws a map of dimensions with these lengths."""
    if sizes.get("posture", 0) > _MOST_OF_LINE:
        return histogram
    wide = [dim for dim, n in sizes.items() if n > 1 and dim != "branch"]
    return {1: line, 2: heat_map, 3: slices}.get(len(wide), histogram)


def _rescaled(
    dataset: xarray.Dataset, unit: str, shown: str, factor: float
) -> xarray.Dataset:
    """The map with the values along its axes in another unit."""
    axes = {
        name: (axis.dims, factor * axis.values, axis.attrs | {"units": shown})
        for name, axis in dataset.coords.items()
        if axis.attrs.get("units") == unit
    }
    return dataset.assign_coords(axes)


def title_of(dataset: xarray.Dataset) -> str:
    """Name of the mechanism, with the values at which the map is cut."""
    parts = []
    for name, value in dataset.coords.items():
        if value.ndim == 0 and name not in ("joint", "xyz", "branch", "rank"):
            parts.append(
                f"{name} = {float(value):.4g} {value.attrs.get('units', '')}".rstrip()
            )
    branch = ", best branch" if "branches" in dataset else ""
    fixed = f"\nat {', '.join(parts)}" if parts else ""
    return f"{dataset.attrs.get('mechanism', '')}{branch}{fixed}"


def wrapped(array: xarray.DataArray) -> str:
    """Label of a quantity with its unit, wrapped into short lines."""
    return fill(unit_label(array), 40)


def colour_norm(values: Array) -> Any:
    """Return the colour scale of the finite values, logarithmic if they span decades."""
    from matplotlib.colors import LogNorm, Normalize

    finite = values[np.isfinite(values)]
    if not finite.size:
        return Normalize(0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    if low > 0 and high > DECADES * low:
        return LogNorm(low, high)
    return Normalize(low, high if high > low else low + (abs(low) or 1.0))


def reasons_of(dataset: xarray.Dataset, values: Array) -> Array:
    """Return the state of each cell that has no number; "" for the others."""
    names = state_names(dataset)
    state = np.asarray(dataset["state"].values)
    reasons = np.full(values.shape, "", dtype=object)
    for code in np.unique(state):
        name = names.get(int(code), str(code))
        reasons[(state == code) & ~np.isfinite(values)] = name
    reasons[(state == 0) & np.isnan(values)] = "undefined"
    reasons[np.isinf(values)] = "infinite"
    return reasons


def style_of(name: str) -> tuple[str, str]:
    """Return hatch and grey of a state, the same in every picture."""
    order = (
        "undefined",
        "infinite",
        "serial-singularity",
        "unreachable",
        "not-assembled",
        "not-computed",
        "fewer-than-six-freedoms",
        "unbalanced",
        "buckled",
    )
    i = order.index(name) if name in order else len(order)
    return _HATCHES[i % len(_HATCHES)], f"{0.92 - 0.06 * (i % 6):.2f}"


def add_legend(figure: Any, reasons: set[str]) -> None:
    """Add a legend of the hatches."""
    from matplotlib.patches import Patch

    handles = []
    for name in sorted(reasons):
        hatch, grey = style_of(name)
        handles.append(Patch(facecolor=grey, edgecolor="0.3", hatch=hatch, label=name))
    if handles:
        figure.legend(
            handles=handles, loc="outside lower center", ncols=min(4, len(handles))
        )


def _borders(values: Array) -> Array:
    """Both borders of the cells around equally spaced values,
    so that hatching follows them.
    """
    step = (values[-1] - values[0]) / (len(values) - 1) if len(values) > 1 else 1.0
    return np.repeat(np.append(values - step / 2, values[-1] + step / 2), 2)[1:-1]


def _axis_label(coordinate: xarray.DataArray) -> str:
    unit = coordinate.attrs.get("units")
    return f"{coordinate.name} [{unit}]" if unit else str(coordinate.name)


def _cells(
    axis: Any, dataset: xarray.Dataset, quantity: str, norm: Any
) -> tuple[Any, set[str]]:
    """Draw coloured cells over two dimensions; return them and the states of
    hatched cells.

    Positions are drawn as in the room: x to the right, z up, equal scales, in mm.
    """
    dims = [str(d) for d in dataset[quantity].dims]
    spatial = set(dims) <= set("xyz")
    if spatial:
        dims = sorted(dims, reverse=True)
        dataset = _rescaled(dataset, "m", "mm", 1e3).transpose(*dims, ...)
    y, x = dims
    array = dataset[quantity].astype(float).compute()
    values = array.values
    shown = array.where(np.isfinite(array))
    mesh = shown.plot.pcolormesh(
        ax=axis, x=x, y=y, cmap=COLOURS, norm=norm, add_colorbar=False, rasterized=True
    )
    if spatial:
        axis.set_aspect("equal")
    # Cells without a value are hatched by their reason.
    reasons = reasons_of(dataset, values)
    names = set(reasons[reasons != ""].tolist())
    borders = [_borders(dataset[d].values) for d in (x, y)]
    for name in sorted(names):
        hatch, grey = style_of(name)
        where = np.repeat(np.repeat(reasons == name, 2, axis=0), 2, axis=1).astype(float)
        axis.contourf(*borders, where, levels=[0.5, 1.5], colors=[grey], hatches=[hatch])
    return mesh, names


def heat_map(dataset: xarray.Dataset, quantity: str, ax: Any = None) -> Any:
    """Draw a map over its two dimensions in colours."""
    figure, axis = new_axes(dataset.attrs.get("springs_in_doubt", ""), ax=ax)
    _draw_parts(figure, [axis], [dataset], quantity)
    axis.set_title(title_of(dataset))
    return figure


def slices(dataset: xarray.Dataset, quantity: str, ax: Any = None) -> Any:
    """Draw heat maps at up to six values of the shortest dimension,
    with one colour scale.
    """
    array = dataset[quantity]
    cut = str(min(array.dims, key=lambda d: array.sizes[d]))
    length = array.sizes[cut]
    chosen = np.unique(
        np.linspace(0, length - 1, min(_SLICES, length)).round().astype(int)
    )
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = new_figure(
        3.0 * columns + 1.4,
        2.8 * rows + 0.8,
        dataset.attrs.get("springs_in_doubt", ""),
        ax,
    )
    axes = list(
        figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).flat
    )
    parts = [dataset.isel({cut: int(i)}) for i in chosen]
    _draw_parts(figure, axes, parts, quantity)
    for axis, part in zip(axes, parts, strict=False):
        value = part[cut]
        axis.set_title(
            f"{cut} = {float(value):.4g} {value.attrs.get('units', '')}", fontsize=9
        )
        axis.label_outer()
    for axis in axes[len(parts) :]:
        axis.set_visible(False)
    figure.suptitle(title_of(dataset))
    return figure


def _draw_parts(
    figure: Any, axes: Sequence[Any], parts: Sequence[xarray.Dataset], quantity: str
) -> None:
    """Draw heat maps with one colour scale and one legend."""
    norm = colour_norm(np.stack([np.asarray(p[quantity].values, float) for p in parts]))
    pairs = zip(axes, parts, strict=False)
    drawn = [_cells(axis, part, quantity, norm) for axis, part in pairs]
    figure.colorbar(drawn[0][0], ax=axes, label=wrapped(parts[0][quantity]))
    add_legend(figure, set[str]().union(*(reasons for _, reasons in drawn)))


def line(dataset: xarray.Dataset, quantity: str, ax: Any = None) -> Any:
    """Draw a curve along the only dimension of a map; grey where there is no number."""
    array = dataset[quantity]
    dim = str(array.dims[0])
    name = "time" if "time" in dataset.coords else dim
    x = np.asarray(
        dataset[name].values if name in dataset.coords else np.arange(array.size), float
    )
    values = np.asarray(array.values, float)
    figure, axis = new_axes(dataset.attrs.get("springs_in_doubt", ""), ax=ax)
    marker = "." if np.isfinite(values).sum() < 200 else ""
    axis.plot(x, np.where(np.isfinite(values), values, np.nan), marker=marker)
    reasons = reasons_of(dataset, values)
    borders = _borders(x)
    present = set(reasons[reasons != ""].tolist())
    for reason in sorted(present):
        hatch, grey = style_of(reason)
        axis.fill_between(
            borders,
            0.0,
            1.0,
            where=np.repeat(reasons == reason, 2),
            transform=axis.get_xaxis_transform(),
            facecolor=grey,
            edgecolor="0.3",
            hatch=hatch,
            linewidth=0,
        )
    axis.set(xlabel=_axis_label(dataset[name]) if name in dataset.coords else name)
    axis.set_ylabel(wrapped(array))
    axis.set_title(title_of(dataset))
    add_legend(figure, present)
    return figure


def histogram(dataset: xarray.Dataset, quantity: str, ax: Any = None) -> Any:
    """Draw the distribution of the values, on a logarithmic axis if they span decades."""
    array = quantity_of(dataset, quantity)
    if array.size > _MOST_COUNTED:
        raise InputError(
            "map is too large for a picture of the distribution of its values",
            expected=f"at most {_MOST_COUNTED} postures, such as those of a slice",
            got=array.size,
        )
    facts = np.array(each_block(dataset, {quantity: partial(fact, quantity)})[quantity])
    low, high, known = facts[:, 0].min(), facts[:, 1].max(), facts[:, 3].sum()
    figure, axis = new_axes(dataset.attrs.get("springs_in_doubt", ""), ax=ax)
    if known:
        logarithmic = low > 0 and high > DECADES * low
        wide = high if high > low else low + (abs(low) or 1.0)
        spaced = np.geomspace if logarithmic else np.linspace
        edges = spaced(low, wide, _BINS + 1)
        edges[0], edges[-1] = low, wide  # exact ends: rounding must not exclude a value

        def counted(values: Array) -> Array:
            return np.histogram(values[np.isfinite(values)], edges)[0]

        counts = np.sum(each_block(dataset, {quantity: counted})[quantity], axis=0)
        axis.stairs(counts, edges, fill=True, color="#4c6ca0")
        if logarithmic:
            axis.set_xscale("log")
    axis.set(xlabel=unit_label(array), ylabel="postures")
    axis.set_title(f"{title_of(dataset)}: {known:.0f} of {array.size} postures")
    return figure
