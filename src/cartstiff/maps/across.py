"""Comparison of two maps, and the best single branch of a Cartesian map.

Two maps with the same axes (two arms, two mountings, two sets of springs) are compared place by
place as a ratio or a difference, each map with its own best branch. The comparison lists what else
differs between the maps.

The branches of a Cartesian map form *configurations*: branches of neighbouring places belong to
one configuration if they are nearest to each other and no joint steps further than `STEP`. An arm
moves through all places of a configuration without a flip.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.batch.quantities import QUANTITIES
from cartstiff.errors import InputError, UnknownNameError
from cartstiff.maps.reading import (
    best_branch,
    is_smaller_better,
    quantities_of,
    quantity_of,
    state_names,
)
from cartstiff.mechanisms.identity import differing_parts

if TYPE_CHECKING:
    import xarray

#: The first over the second, or the first less the second.
How = Literal["ratio", "difference"]

# Relative difference of the values of two axes that are the same up to rounding.
_AXIS_TOLERANCE = numerics.NEGLIGIBLE_DIFFERENCE
# Settings of a map, by what its quantity needs: key in the description, and words.
_SETTINGS_BY_NEED = {
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
_COMPARED_ATTRIBUTES = (
    "mechanism",
    "frame",
    "frame_offset",
    "base_pose",
    "connection",
    "load_kind",
    "load_at",
)
# Settings of every map: key in the description, and words.
_SETTINGS = (("load", "load"), ("load_axes", "axes of the load"), ("told", "command of drives"))


def compare_maps(
    first: xarray.Dataset, second: xarray.Dataset, quantity: str, how: How = "ratio"
) -> xarray.Dataset:
    """Divide a quantity of the first map by that of the second, or subtract the second.

    Parameters
    ----------
    first, second : xarray.Dataset
        From `open_map`, over the same axes; with branches each place's best one is taken.
    quantity : str
        Compared quantity; both maps hold it, in the same unit.
    how : {"ratio", "difference"}
        A ratio is a pure number, and does not exist where the second map is zero.

    Returns
    -------
    xarray.Dataset
        The quantity over the axes, NaN where one of the maps has no number; ``state`` gives the
        reason, that of the first map if it has no number. The attribute "differs" lists what else
        differs.

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
    words = str(x.attrs.get("long_name", quantity))
    if state_names(a) != state_names(b):
        raise InputError("names of states differ between the maps", expected="maps of one version")
    import xarray

    # Axes are those of the first map, and of the second to rounding.
    u, v = x.astype(float), y.astype(float).variable
    values = u / v if how == "ratio" else u - v
    names = _names(first, second)
    title = f"{words}: {names[0]} {'over' if how == 'ratio' else 'less'} {names[1]}"
    about = {"units": "1" if how == "ratio" else ux, "long_name": title, "comparison": how}
    about |= {key: x.attrs[key] for key in ("better",) if key in x.attrs}
    state = a["state"].where(~np.isfinite(u), b["state"].variable).assign_attrs(a["state"].attrs)
    values = values.where(np.isfinite(values)).assign_attrs(about)
    difference = xarray.Dataset({quantity: values, "state": state}).load()
    ours, theirs = _conditions(first, quantity), _conditions(second, quantity)
    differs = [
        f"{key}: {ours.get(key)} and {theirs.get(key)}"
        for key in {**ours, **theirs}
        if ours.get(key) != theirs.get(key)
    ]
    if first.attrs.get("mechanism") == second.attrs.get("mechanism"):
        differs += differing_parts(_description(first), _description(second))
    difference.attrs = {
        **first.attrs,
        "mechanism": f"{names[0]} and {names[1]}",
        "differs": differs,
    }
    return difference


def _description(data: xarray.Dataset) -> dict[str, Any]:
    return dict(json.loads(data.attrs.get("description", "{}")))


def _conditions(data: xarray.Dataset, quantity: str) -> dict[str, str]:
    """Conditions under which a map was computed, and the settings that the quantity needs."""
    known = QUANTITIES.get(quantity)
    asked = _SETTINGS_BY_NEED[known.asks] if known is not None and known.asks is not None else ()
    settings = _description(data)
    where = settings.get("sampling", {})
    return {
        **{key: str(data.attrs.get(key)) for key in _COMPARED_ATTRIBUTES},
        **{words: str(settings.get(key)) for key, words in (*asked, *_SETTINGS)},
        **{key: str(where.get(key)) for key in ("orientation", "free", "redundancy")},
        **{key: str(x) for key, x in data.attrs.items() if key.startswith("fixed_")},
    }


def compared(result: xarray.Dataset, quantity: str) -> dict[str, Any]:
    """Summarise a comparison of maps in a few numbers.

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
    for dim in x.dims:
        if dim not in x.coords or dim not in y.coords:
            raise InputError("maps without axes cannot be compared", expected="grids")
        pair = x[dim], y[dim]
        one, other = (axis.attrs.get("units", "") for axis in pair)
        size = _AXIS_TOLERANCE * float(np.abs(pair[0]).max())
        is_same = one == other and pair[0].size == pair[1].size
        if not is_same or not np.allclose(*pair, rtol=0.0, atol=size):
            ends = [f"{float(a[0]):g} to {float(a[-1]):g} {a.attrs.get('units', '')}" for a in pair]
            axes = [f"{end} in {axis.size}" for end, axis in zip(ends, pair, strict=True)]
            raise InputError(f"axis {dim} differs between the maps", expected=axes[0], got=axes[1])


#: Largest step of a joint between neighbouring places (rad, or length units).
STEP = 0.7
#: Number of the state of places that the configuration does not reach and others do.
_OTHER_BRANCH = 254


def single_branch(
    dataset: xarray.Dataset, quantity: str, limit: float | None = None, below: bool = True
) -> xarray.Dataset:
    """The map of the best single configuration: one branch at every place that it reaches.

    Parameters
    ----------
    dataset : xarray.Dataset
        A Cartesian map from `open_map`; one without branches comes back as it is.
    quantity : str
        Where a configuration reaches a place twice, the branch with the better value is taken.
    limit : float, optional
        The best configuration keeps the quantity on the better side of the limit at the most
        places; without a limit it is the one that reaches the most places.
    below : bool
        Whether below the limit is better, for a quantity of which neither end is.

    Returns
    -------
    xarray.Dataset
        Without the dimension ``branch``; the state "other-branch" marks places that only other
        configurations reach.

    Raises
    ------
    UnknownNameError
        For a quantity that the map does not hold.
    """
    array = quantity_of(dataset, quantity)
    if "branch" not in array.dims:
        return dataset
    import xarray

    places = [str(d) for d in array.dims if d != "branch"]
    values = np.asarray(array.transpose(*places, "branch").values, float)
    q = np.asarray(dataset["q"].transpose(*places, "branch", "joint").values, float)
    labels = _labels(values, q)
    below = is_smaller_better(array, below)
    chosen = _largest_configuration(labels, values, limit, below)
    sign = 1.0 if below else -1.0
    mine = labels == chosen
    pick = np.where(mine, sign * values, np.inf).argmin(axis=-1)
    picked = dataset.isel(branch=xarray.DataArray(pick, dims=places)).copy()
    there, anywhere = mine.any(axis=-1), np.isfinite(values).any(axis=-1)
    for name in quantities_of(dataset):
        picked[name] = picked[name].where(xarray.DataArray(there, dims=places))
    about = dict(dataset["state"].attrs)
    about["flag_values"] = [*about["flag_values"], _OTHER_BRANCH]
    about["flag_meanings"] = f"{about['flag_meanings']} other-branch"
    state = picked["state"].transpose(*places).values
    picked["state"] = places, np.where(anywhere & ~there, _OTHER_BRANCH, state), about
    return picked


def _labels(values: Array, q: Array) -> Array:
    """Return the number of the configuration of every branch, -1 where there is none."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    known = np.isfinite(values)
    total = int(known.sum())
    number = np.full(values.shape, -1)
    number[known] = np.arange(total)
    q = np.where(known[..., None], q, np.nan)
    ends = [np.empty((2, 0), int)]
    for axis in range(values.ndim - 1):
        at, of = np.moveaxis(q, axis, 0), np.moveaxis(number, axis, 0)
        step = np.abs(at[:-1, ..., :, None, :] - at[1:, ..., None, :, :]).max(axis=-1)
        step[np.isnan(step)] = np.inf
        near = step <= np.minimum(STEP, step.min(axis=-1, keepdims=True))
        near &= step <= step.min(axis=-2, keepdims=True)
        both = np.broadcast_arrays(of[:-1, ..., :, None], of[1:, ..., None, :])
        ends.append(np.array([numbers[near] for numbers in both]))
    i, j = np.concatenate(ends, axis=1)
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(total, total))
    labels = np.full(values.shape, -1)
    labels[known] = connected_components(graph, directed=False)[1]
    return labels


def _largest_configuration(labels: Array, values: Array, limit: float | None, below: bool) -> int:
    """Return the configuration with the most places: within the limit, then of all."""
    within = np.isfinite(values)
    if limit is not None:
        within &= values <= limit if below else values >= limit

    def places(counted: Any) -> Array:
        """Return the number of places of each configuration, each place counted once."""
        rows = np.sort(np.where(counted, labels, -1), axis=-1)
        is_new = np.diff(rows, axis=-1, prepend=-1) != 0
        counts: Array = np.bincount(rows[is_new], minlength=int(labels.max()) + 1)
        return counts

    if not (labels >= 0).any():
        return 0
    return int(np.lexsort((-places(True), -places(within)))[0])
