"""What pictures of maps share: figures, colours, titles, and why a cell has no number."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.maps.reading import state_names, unit_label

if TYPE_CHECKING:
    import xarray

#: Readable without colour vision.
COLOURS = "cividis"
#: A logarithmic scale from this ratio on.
DECADES = 100.0
_HATCHES = ("////", "....", "xxxx", "\\\\\\\\", "oooo", "----")


def title_of(dataset: xarray.Dataset) -> str:
    """The mechanism, and where the map is cut."""
    parts = []
    for name, value in dataset.coords.items():
        if value.ndim == 0 and name not in ("joint", "xyz", "branch", "rank"):
            parts.append(f"{name} = {float(value):.4g} {value.attrs.get('units', '')}".rstrip())
    branch = ", best branch" if "branches" in dataset else ""
    fixed = f"\nat {', '.join(parts)}" if parts else ""
    return f"{dataset.attrs.get('mechanism', '')}{branch}{fixed}"


def wrapped(array: xarray.DataArray) -> str:
    """Words and unit of a quantity in short lines."""
    return fill(unit_label(array), 40)


def colour_norm(values: Array) -> Any:
    """Scale of the finite values, logarithmic where they span decades."""
    from matplotlib.colors import LogNorm, Normalize

    finite = values[np.isfinite(values)]
    if not finite.size:
        return Normalize(0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    if low > 0 and high > DECADES * low:
        return LogNorm(low, high)
    return Normalize(low, high if high > low else low + (abs(low) or 1.0))


def reasons_of(dataset: xarray.Dataset, values: Array) -> Array:
    """Why each cell has no number; "" where it has one."""
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
    """Hatch and grey of a reason, the same in every picture."""
    order = (
        "undefined",
        "infinite",
        "serial-singularity",
        "unreachable",
        "not-assembled",
        "not-computed",
        "deficient",
        "unbalanced",
        "buckled",
    )
    i = order.index(name) if name in order else len(order)
    return _HATCHES[i % len(_HATCHES)], f"{0.92 - 0.06 * (i % 6):.2f}"


def add_legend(figure: Any, reasons: set[str]) -> None:
    """Name the hatches."""
    from matplotlib.patches import Patch

    handles = []
    for name in sorted(reasons):
        hatch, grey = style_of(name)
        handles.append(Patch(facecolor=grey, edgecolor="0.3", hatch=hatch, label=name))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=min(4, len(handles)))
