"""Pictures of how numbers are distributed: histograms, violins by region, points in space."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError, UnknownNameError
from cartstiff.figures import new_figure
from cartstiff.geometry.se3 import Array
from cartstiff.maps.drawing.parts import (
    COLOURS,
    DECADES,
    colour_norm,
    title_of,
    wrapped,
)
from cartstiff.maps.reading import each_block, quantity_of, unit_label
from cartstiff.maps.sampling import dimension_name
from cartstiff.maps.totals import finite_range

if TYPE_CHECKING:
    import xarray

# Violins and points show this many postures at most, evenly spread over the map.
_MOST = 100_000


def histogram(dataset: xarray.Dataset, quantity: str, bins: int = 60) -> Any:
    """How often each value occurs; on a logarithmic axis where it spans decades."""
    array = quantity_of(dataset, quantity)
    lows, highs, _, numbers = zip(
        *each_block(dataset, {quantity: finite_range})[quantity], strict=True
    )
    low, high, missing = min(lows), max(highs), array.size - sum(numbers)
    figure = new_figure()
    axis = figure.subplots()
    if np.isfinite(low):
        logarithmic = low > 0 and high > DECADES * low
        wide = high if high > low else low + (abs(low) or 1.0)
        spaced = np.geomspace if logarithmic else np.linspace
        edges = spaced(low, wide, bins + 1)
        edges[0], edges[-1] = low, wide  # no value is lost to rounding

        def counted(values: Array) -> Array:
            return np.histogram(values[np.isfinite(values)].astype(float), edges)[0]

        counts = np.sum(each_block(dataset, {quantity: counted})[quantity], axis=0)
        axis.stairs(counts, edges, fill=True, color="#4c6ca0")
        if logarithmic:
            axis.set_xscale("log")
    axis.set(xlabel=unit_label(array), ylabel="postures")
    axis.set_title(f"{title_of(dataset)}: {array.size - missing} of {array.size} postures")
    return figure


def _sample(dataset: xarray.Dataset, quantity: str) -> xarray.Dataset:
    """A map of one dimension with at most `_MOST` postures, evenly spread."""
    import xarray

    array = quantity_of(dataset, quantity)
    if not array.dims:
        return dataset.expand_dims("sample")
    count = min(array.size, _MOST)
    flat = np.linspace(0, array.size - 1, count).round().astype(np.int64)
    places = np.unravel_index(flat, array.shape)
    pairs = zip(array.dims, places, strict=True)
    picks = {dim: xarray.DataArray(i, dims="sample") for dim, i in pairs}
    wanted = [quantity, "state", "position", "q"]
    return dataset[wanted].isel(picks).compute()


def violin(dataset: xarray.Dataset, quantity: str, by: str = "radius", bins: int = 8) -> Any:
    """Distributions in regions of the workspace or of a coordinate, side by side.

    Parameters
    ----------
    dataset, quantity
        As in `draw_map`.
    by : str
        "x", "y" or "z" of the body frame's origin, "radius" (its distance from F's origin), an
        axis of the map, or a coordinate of the mechanism.
    bins : int
        Number of regions of equal width.
    """
    sample = _sample(dataset, quantity)
    joints = [str(j) for j in dataset["joint"].values]
    length = str(dataset.attrs.get("length_unit", ""))
    if by in ("x", "y", "z"):
        key = sample["position"].sel(xyz=by).values
        label = f"{by} of the body frame's origin [{length}]"
    elif by == "radius":
        key = np.linalg.norm(sample["position"].values, axis=-1)
        label = f"distance of the body frame's origin from F's [{length}]"
    elif by in joints:
        key = sample["q"].sel(joint=by).values
        axis_name = dimension_name(by)
        unit = dataset[axis_name].attrs.get("units", "") if axis_name in dataset.coords else ""
        label = f"{by} [{unit}]" if unit else by
    else:
        raise UnknownNameError("region", by, ["x", "y", "z", "radius", *joints])
    values, key = np.asarray(sample[quantity].values, float), np.asarray(key, float)
    valid = np.isfinite(values) & np.isfinite(key)
    if not valid.any():
        raise InputError(f"{quantity} has no number in this map")
    shown, key = values[valid], key[valid]
    high = key.max() if key.max() > key.min() else key.min() + 1.0
    edges = np.linspace(key.min(), high, bins + 1)
    region = np.clip(np.searchsorted(edges, key, side="right") - 1, 0, bins - 1)
    logarithmic = shown.min() > 0 and shown.max() > DECADES * shown.min()
    plotted = np.log10(shown) if logarithmic else shown
    centres = (edges[:-1] + edges[1:]) / 2
    groups = [(c, plotted[region == i]) for i, c in enumerate(centres)]
    # A density needs some spread.
    groups = [
        (c, g) for c, g in groups if g.size > 2 and np.ptp(g) > numerics.CLOSE * np.abs(g).max()
    ]
    figure = new_figure()
    axis = figure.subplots()
    if groups:
        width = 0.9 * (edges[1] - edges[0])
        axis.violinplot(
            [g for _, g in groups],
            [c for c, _ in groups],
            widths=width,
            showmedians=True,
            showextrema=False,
        )
    if logarithmic:
        axis.yaxis.set_major_formatter(lambda v, _: f"{10**v:.3g}")
    axis.set(xlabel=label, ylabel=wrapped(dataset[quantity]), xlim=(edges[0], edges[-1]))
    axis.set_title(f"{title_of(dataset)}: {shown.size} postures")
    return figure


def points(dataset: xarray.Dataset, quantity: str) -> Any:
    """The places that the body frame's origin reaches, from above and from the side."""
    sample = _sample(dataset, quantity)
    values = np.asarray(sample[quantity].values, float)
    place = np.asarray(sample["position"].values, float)
    valid = np.isfinite(values) & np.isfinite(place).all(axis=1)
    # The stiffest last would hide the others: the order is that of the values, worst on top.
    sign = -1.0 if dataset[quantity].attrs.get("better") == "larger" else 1.0
    order = np.flatnonzero(valid)[np.argsort(sign * values[valid])]
    figure = new_figure(9.0, 4.2)
    axes = figure.subplots(1, 2)
    length = str(dataset.attrs.get("length_unit", ""))
    norm = colour_norm(values)
    size = float(np.clip(2e4 / max(len(order), 1), 1.0, 30.0))
    shown = None
    for axis, (i, j) in zip(axes, ((0, 1), (0, 2)), strict=True):
        shown = axis.scatter(
            place[order, i],
            place[order, j],
            c=values[order],
            s=size,
            norm=norm,
            cmap=COLOURS,
            linewidths=0,
            rasterized=True,
        )
        axis.set(xlabel=f"{'xyz'[i]} [{length}]", ylabel=f"{'xyz'[j]} [{length}]", aspect="equal")
    figure.colorbar(shown, ax=axes, label=wrapped(dataset[quantity]))
    figure.suptitle(f"{title_of(dataset)}: {len(order)} postures, the worst on top")
    return figure
