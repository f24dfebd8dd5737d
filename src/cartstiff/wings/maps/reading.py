"""Reading of a map: summary, best postures, slices. Large maps are read in parts.

The summary (number of postures in each state, range of every quantity) is added up from
statistics of the parts. A map file stores these statistics, so that its summary needs
neither its arrays nor xarray.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.core.arrays import Array, plain
from cartstiff.core.errors import InputError, UnknownNameError, one_line
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.files.identity import differing_parts, identity_of
from cartstiff.files.other_units import in_units
from cartstiff.wings.maps.store import NOT_COMPUTED, PLACES, MapFile, fact, open_map

if TYPE_CHECKING:
    import xarray

#: Variables of a map that are not quantities.
OTHERS = ("state", "position", "q", "time", "branches")


def state_names(dataset: xarray.Dataset) -> dict[int, str]:
    """Return the names of the numbers in ``state``."""
    return named_states(dataset["state"].attrs)


def map_of_mechanism(
    path: Any, elastic: ElasticMechanism
) -> tuple[xarray.Dataset, list[str]]:
    """Open a map as one of a mechanism: the check of all that shows a map beside
    a mechanism.

    Parameters
    ----------
    path : path, address or store
        The map.
    elastic : ElasticMechanism
        The mechanism that it has to be of.

    Returns
    -------
    xarray.Dataset
        From `open_map`.
    list of str
        What differs between the map's mechanism and this one: "other springs", ...

    Raises
    ------
    InputError
        For the map of another mechanism, or one that cannot be read.
    """
    dataset = open_map(path)
    about = dataset.attrs
    length = about["length_unit"]
    same = elastic if length == elastic.units.length else in_units(elastic, length)
    differs = differing_parts(json.loads(about["description"]), identity_of(same, {}))
    names = json.loads(about["description"])["joints"]
    if about["mechanism"] != elastic.name or names != list(elastic.names):
        raise InputError(
            "is the map of another mechanism",
            where="--map",
            expected=elastic.name,
            got=one_line(about["mechanism"]),
        )
    return dataset, differs


def named_states(attributes: Mapping[str, Any]) -> dict[int, str]:
    """Return the names of the numbers in ``state`` from its attributes."""
    names = attributes["flag_meanings"].split()
    return dict(zip((int(v) for v in attributes["flag_values"]), names, strict=True))


def each_block(
    dataset: xarray.Dataset, functions: Mapping[str, Callable[[Array], Any]]
) -> dict[str, list[Any]]:
    """Apply one function to every part of each named array; results in C order.

    One Dask graph serves all parts, since a graph for each part takes longer than reading
    the part.
    """
    from dask.delayed import delayed

    parts = [
        [
            delayed(function)(part)
            for part in dataset[name].chunk().data.to_delayed().ravel()
        ]
        for name, function in functions.items()
    ]
    return dict(zip(functions, computed(*parts), strict=True))


def computed(*lazy: Any) -> tuple[Any, ...]:
    """Compute several things in one pass over the parts of a map, by threads."""
    from dask.base import compute
    from dask.threaded import get

    # Given by name or by default, the scheduler would make Dask import `distributed`.
    return tuple(compute(*lazy, scheduler=get))  # type: ignore[no-untyped-call]


def quantity_of(dataset: xarray.Dataset, name: str) -> xarray.DataArray:
    """Return a quantity of a map.

    Raises
    ------
    UnknownNameError
        If the map has no such quantity.
    """
    known = quantities_of(dataset)
    if not isinstance(name, str) or name not in known:
        raise UnknownNameError("quantity of the map", name, known)
    return dataset[name]


def quantities_of(dataset: xarray.Dataset) -> list[str]:
    """Names of the quantities of a map."""
    if not hasattr(dataset, "data_vars"):
        raise InputError(
            "map cannot be used",
            expected="what open_map answers",
            got=type(dataset).__name__,
        )
    return [str(v) for v in dataset.data_vars if v not in OTHERS]


def best(dataset: xarray.Dataset, quantity: str, count: int = 1) -> xarray.Dataset:
    """Return the postures at which a quantity is best, along a new dimension ``rank``.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `open_map`, or a slice of it.
    quantity : str
        A stiffness is best where it is largest, a deflection where it is smallest; see
        the attribute ``better``.
    count : int
        Number of postures; fewer are returned if fewer exist.

    Raises
    ------
    InputError
        If neither end of the quantity is better.
    """
    array = quantity_of(dataset, quantity)
    if count < 1:
        raise InputError(
            "number of postures cannot be used", expected="1 or more", got=count
        )
    # Only a quantity with a better end has best postures.
    better = array.attrs.get("better")
    if better is None:
        raise InputError(
            f"neither end of {quantity} is better", expected="another quantity"
        )
    sign = 1.0 if better == "smaller" else -1.0

    def least(values: Array) -> list[tuple[float, tuple[int, ...]]]:
        """Return the smallest signed values of a part with their indices in it."""
        flat = sign * np.asarray(values, float).ravel()
        valid = np.flatnonzero(~np.isnan(flat))
        if valid.size > count:
            valid = valid[np.argpartition(flat[valid], count - 1)[:count]]
        places = np.transpose(np.unravel_index(valid, values.shape)).tolist()
        return list(zip(flat[valid].tolist(), map(tuple, places), strict=True))

    # Block by block: each offers its own best, and only those are compared.
    from dask.array.core import slices_from_chunks

    found: list[tuple[float, tuple[int, ...]]] = []
    parts = each_block(dataset, {quantity: least})[quantity]
    for box, own in zip(slices_from_chunks(array.chunk().chunks), parts, strict=True):  # type: ignore[no-untyped-call]
        starts = [s.start for s in box]
        found += [(x, tuple(np.add(cell, starts).tolist())) for x, cell in own]
        found = heapq.nsmallest(count, found)
    import xarray

    # The coordinates and all other quantities there.
    picks = {
        str(dim): xarray.DataArray([cell[i] for _, cell in found], dims="rank")
        for i, dim in enumerate(array.dims)
    }
    return dataset.isel(picks).compute()


def slice_map(dataset: xarray.Dataset, **at: float) -> xarray.Dataset:
    """Return the part of a map, `dataset`, at the values of its axes nearest to the given
    ones, in the units of the axes.

    Raises
    ------
    UnknownNameError
        For a name that is no axis.
    InputError
        For a value outside the axis.
    """
    axes = [
        str(d) for d in dataset.dims if d in dataset.coords and d not in ("joint", "xyz")
    ]
    for name, value in at.items():
        if name not in axes:
            raise UnknownNameError("axis of the map", name, axes)
        values = np.asarray(dataset[name].values, float)
        step = values[1] - values[0] if len(values) > 1 else abs(values[0]) or 1.0
        try:
            dataset = dataset.sel({name: value}, method="nearest", tolerance=step / 2)
        except KeyError:
            raise InputError(
                f"value of {name} is outside the map",
                expected=f"{values[0]:g} to {values[-1]:g}",
                got=f"{value:g}",
            ) from None
    return dataset


def places_of(dataset: xarray.Dataset, names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Value and unit of a slice on its axes: the grid values nearest to the
    requested ones.
    """
    return {
        name: {
            "value": float(dataset[name]),
            "unit": dataset[name].attrs.get("units", ""),
        }
        for name in names
    }


def best_branch(dataset: xarray.Dataset, quantity: str) -> xarray.Dataset:
    """Return the map with the best branch of a quantity at every place.

    Where neither end is better, the largest is taken; where no branch has a value, the
    first branch, with its state.
    """
    array = quantity_of(dataset, quantity)
    if "branch" not in array.dims:
        return dataset
    sign = 1.0 if array.attrs.get("better") == "smaller" else -1.0
    return dataset.isel(branch=(sign * array).fillna(np.inf).argmin("branch").compute())


def unit_label(array: xarray.DataArray) -> str:
    """Return the label of a quantity with its unit."""
    attributes: Mapping[str, Any] = array.attrs
    unit = attributes.get("units", "1")
    words = str(attributes.get("long_name", array.name))
    return words if unit == "1" else f"{words} [{unit}]"


def summary(dataset: xarray.Dataset | MapFile) -> dict[str, Any]:
    """Summarise a map: number of postures in each state, and range of every quantity.

    Parameters
    ----------
    dataset : xarray.Dataset or MapFile
        A whole map, or a part of one; from a file only the statistics of its parts are
        read.

    Returns
    -------
    dict
        "states": counts by name; "quantities": by name, "unit", "smallest", "mean",
        "largest" over the finite values (None if there are none), and "undefined", the
        number of the others; for a Cartesian map "branches": "starts" of each search,
        number of "legs" searched separately (0: the mechanism as a whole), largest number
        of branches "found" at a place, and number "kept".
    """
    arrays: Any
    facts: Mapping[str, Any]
    if isinstance(dataset, MapFile):
        arrays, attributes, facts = dataset.described, dataset.attributes, dataset.facts()
    else:
        arrays, attributes = dataset.data_vars, dataset.attrs
        own = [str(name) for name in arrays if name not in PLACES]
        facts = each_block(dataset, {name: partial(fact, name) for name in own})
    names, every = named_states(arrays["state"].attrs), np.sum(facts["state"], axis=0)
    every[NOT_COMPUTED] += (
        math.prod(arrays["state"].shape) - every.sum()
    )  # parts without facts
    states = {names.get(c, str(c)): int(every[c]) for c in np.flatnonzero(every).tolist()}
    ranges = {}
    for name in (n for n in facts if n not in OTHERS):
        lows, highs, totals, numbers = np.transpose(facts[name])
        number = int(numbers.sum())
        found = (
            (lows.min(), totals.sum() / number, highs.max()) if number else (None,) * 3
        )
        ranges[name] = {
            "unit": arrays[name].attrs.get("units", ""),
            **dict(zip(("smallest", "mean", "largest"), plain(found), strict=True)),
            "undefined": arrays[name].size - number,
        }
    branches = {}
    if "branches" in facts:
        sampling = json.loads(attributes["description"])["sampling"]
        branches["branches"] = {
            "starts": 1 + sampling["starts"],
            "legs": sampling.get("legs", 0),
            "found": int(np.max(facts["branches"], initial=0)),
            "kept": sampling["branches"],
        }
    return {"states": states, "quantities": ranges, **branches}
