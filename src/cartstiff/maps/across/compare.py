"""Two maps of the same places: their ratio or their difference, place by place.

Two arms, two mountings, two sets of springs: whatever the maps are of, they are compared where both
looked, each with its own best branch. What else differs between them is said.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from cartstiff import numerics
from cartstiff.errors import InputError, UnknownNameError
from cartstiff.maps.quantities import QUANTITIES
from cartstiff.maps.reading import best_branch, quantity_of, state_names

if TYPE_CHECKING:
    import xarray

#: The first over the second, or the first less the second.
How = Literal["ratio", "difference"]

# Values of axes that two commands have computed from the same ends.
_SAME_PLACE = numerics.CLOSE
_ASKED = {
    "length": (("length", "characteristic length"),),
    "direction": (("direction", "direction"), ("world", "in the room")),
    "deflect": (
        ("deflect", "deflecting load"),
        ("deflect_at", "acting at"),
        ("world", "in the room"),
    ),
    "damping": (("damping", "damping"),),
    "milling": (("milling", "cut"),),
}
_TOLD = (
    "mechanism",
    "frame",
    "frame_offset",
    "base_pose",
    "connection",
    "load_kind",
    "load_at",
    "wrench",
    "gravity",
)


def compare_maps(
    first: xarray.Dataset, second: xarray.Dataset, quantity: str, how: How = "ratio"
) -> xarray.Dataset:
    """A map of one quantity of two maps: the first over (or less) the second.

    Parameters
    ----------
    first, second : xarray.Dataset
        From `open_map`, over the same axes; with branches each place's best one is taken.
    quantity : str
        What is compared; both maps hold it, in the same unit.
    how : {"ratio", "difference"}
        What is told: a ratio is a pure number, and does not exist where the second is zero.

    Returns
    -------
    xarray.Dataset
        The quantity over the axes, NaN where one of the maps has no number; ``state`` says why, of
        the first map if it has none. The attribute "differs" lists what else differs.

    Raises
    ------
    UnknownNameError
        For a quantity that a map does not hold, or another word.
    InputError
        If axes, units, or names of states differ, or the maps have no places in common.
    """
    if how not in get_args(How):
        raise UnknownNameError("comparison", str(how), get_args(How))
    a, b = (best_branch(data, quantity) for data in (first, second))
    x, y = quantity_of(a, quantity), quantity_of(b, quantity)
    _check_axes(x, y)
    if (ux := x.attrs.get("units")) != (uy := y.attrs.get("units")):
        raise InputError(f"units of {quantity} differ between the maps", expected=ux, got=uy)
    if state_names(a) != state_names(b):
        raise InputError("names of states differ between the maps", expected="maps of one version")
    u, v = np.asarray(x.values, float), np.asarray(y.values, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = u / v if how == "ratio" else u - v
    values = np.where(np.isfinite(values), values, np.nan)
    state = np.where(np.isfinite(u), b["state"].values, a["state"].values)
    words = str(x.attrs.get("long_name", quantity))
    names = _names(first, second)
    title = f"{words}: {names[0]} {'over' if how == 'ratio' else 'less'} {names[1]}"
    difference = a[[quantity, "state"]].copy()
    difference[quantity] = (
        x.dims,
        values,
        {
            "units": "1" if how == "ratio" else ux,
            "long_name": title,
            "comparison": how,
            **({"better": x.attrs["better"]} if "better" in x.attrs else {}),
        },
    )
    difference["state"] = x.dims, state, a["state"].attrs
    ours, theirs = _said(first, quantity), _said(second, quantity)
    difference.attrs = {
        **first.attrs,
        "mechanism": f"{names[0]} and {names[1]}",
        "differs": [
            f"{key}: {ours[key]} and {theirs[key]}" for key in ours if ours[key] != theirs[key]
        ],
    }
    return difference


def _said(data: xarray.Dataset, quantity: str) -> dict[str, str]:
    """What a map says that its numbers rest on, and what the quantity asks for."""
    known = QUANTITIES.get(quantity)
    asked = _ASKED[known.asks] if known is not None and known.asks is not None else ()
    settings = json.loads(data.attrs.get("description", "{}"))
    return {key: str(data.attrs.get(key)) for key in _TOLD} | {
        words: str(settings.get(key)) for key, words in (*asked, ("told", "command of drives"))
    }


def compared(result: xarray.Dataset, quantity: str) -> dict[str, Any]:
    """What a comparison says in a few numbers.

    Returns
    -------
    dict
        "places" with a number in both maps, "unit", "smallest", "mean" and "largest", "mean_kind"
        ("geometric" for ratios above zero, else "arithmetic"), and the share of places at which the
        first map is "better".
    """
    array = result[quantity]
    values = np.asarray(array.values, float)
    known = values[np.isfinite(values)]
    unit, better = array.attrs["units"], array.attrs.get("better")
    is_ratio = array.attrs["comparison"] == "ratio"
    is_geometric = is_ratio and bool((known > 0).all())
    mean = None
    if known.size:
        mean = float(np.exp(np.log(known).mean()) if is_geometric else known.mean())
    even = 1.0 if is_ratio else 0.0
    first = known < even if better == "smaller" else known > even
    return {
        "places": int(known.size),
        "of": int(values.size),
        "unit": unit,
        "smallest": float(known.min()) if known.size else None,
        "mean": mean,
        "mean_kind": "geometric" if is_geometric else "arithmetic",
        "largest": float(known.max()) if known.size else None,
        "first_is_better": float(first.mean()) if known.size and better is not None else None,
        "differs": list(result.attrs["differs"]),
    }


def _names(first: xarray.Dataset, second: xarray.Dataset) -> tuple[str, str]:
    names = [str(data.attrs.get("mechanism", "")) for data in (first, second)]
    if names[0] == names[1]:
        return f"{names[0]} (first map)", f"{names[1]} (second map)"
    return names[0], names[1]


def _check_axes(x: xarray.DataArray, y: xarray.DataArray) -> None:
    if x.dims != y.dims:
        raise InputError(
            "axes differ between the maps",
            expected=", ".join(map(str, x.dims)),
            got=", ".join(map(str, y.dims)),
        )
    for dim in map(str, x.dims):
        if dim not in x.coords or dim not in y.coords:
            raise InputError("maps without axes cannot be compared", expected="grids")
        a, b = (np.asarray(array[dim].values, float) for array in (x, y))
        units = [str(array[dim].attrs.get("units", "")) for array in (x, y)]
        size = max(float(np.abs(a).max(initial=0.0)), numerics.TINY)
        if units[0] != units[1] or len(a) != len(b) or np.abs(a - b).max() > _SAME_PLACE * size:
            both = zip((a, b), units, strict=True)
            axes = [f"{v[0]:g} to {v[-1]:g} {u} in {len(v)}" for v, u in both]
            raise InputError(f"axis {dim} differs between the maps", expected=axes[0], got=axes[1])
