"""A map in numbers: how many postures are in which state, and the range of every quantity.

They are added up from facts about the map's parts. Whoever has computed a part knows its facts, and
need not read it again; a map's folder is summed up without the packages for labelled arrays.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.maps.opening import StoredArray
from cartstiff.maps.reading import OTHERS, each_block, named_states, quantities_of
from cartstiff.maps.store import MapFile

if TYPE_CHECKING:
    import xarray

#: Arrays of a map about which there is nothing to add up.
_PLACES = ("position", "q")


def facts_of(arrays: Mapping[str, Array]) -> dict[str, Any]:
    """Of the arrays of a part, by name, what the summary of the map needs."""
    return {name: _fact(name, a) for name, a in arrays.items() if name not in _PLACES}


def _fact(name: str, values: Array) -> Any:
    if name == "state":
        return np.bincount(np.ravel(values), minlength=256)
    return int(np.max(values, initial=0)) if name == "branches" else finite_range(values)


def finite_range(values: Array) -> tuple[float, float, float, int]:
    """Smallest, largest, sum and number of the finite values."""
    is_finite = np.isfinite(values)
    values = np.asarray(values if is_finite.all() else values[is_finite], float)
    if not values.size:
        return np.inf, -np.inf, 0.0, 0
    return float(values.min()), float(values.max()), float(values.sum()), values.size


def summary(dataset: xarray.Dataset) -> dict[str, Any]:
    """Number of postures in each state, and the range of every quantity.

    Parameters
    ----------
    dataset : xarray.Dataset
        A whole map, or a part of one.

    Returns
    -------
    dict
        "states": counts by name; "quantities": by name, "unit", "smallest", "mean", "largest" over
        the finite values (None if there are none), and "undefined", the number of the others; where
        branches were searched for, "branches": "starts" of each search, "legs" that were searched
        one by one (0: the whole at once), the most branches "found" at a place, and how many are
        "kept".
    """
    names = ["state", *quantities_of(dataset), *({"branches"} & dataset.data_vars.keys())]
    facts = each_block(dataset, {name: partial(_fact, name) for name in names})
    about = {name: dataset[name].attrs for name in names}
    return _added_up(facts, about, {n: dataset[n].size for n in names}, dataset.attrs)


def summary_of_file(
    file: MapFile, known: Mapping[int, Mapping[str, Any]] | None = None
) -> dict[str, Any]:
    """`summary` of a whole map in its folder.

    Parameters
    ----------
    file : MapFile
        Complete or not.
    known : mapping, optional
        `facts_of` the arrays of parts that need not be read, by their number.

    Raises
    ------
    InputError
        If a part that is read is damaged.
    """
    names = [name for name in file.attributes["parts"] if name not in _PLACES]
    arrays, known = {name: StoredArray(file, name) for name in names}, known or {}

    def facts(chunk: int) -> Mapping[str, Any]:
        if chunk in known:
            return known[chunk]
        box = [(s.start, s.stop) for s in file.boxes[chunk]]
        return facts_of({name: a.box(box[: a.ndim]) for name, a in arrays.items()})

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        parts = list(pool.map(facts, range(len(file.boxes))))
    return _added_up(
        {name: [part[name] for part in parts] for name in names},
        {name: file.arrays[name].attrs for name in names},
        {name: math.prod(a.shape) for name, a in arrays.items()},
        file.attributes,
    )


def _added_up(
    facts: Mapping[str, Sequence[Any]],
    about: Mapping[str, Mapping[str, Any]],
    sizes: Mapping[str, int],
    attributes: Mapping[str, Any],
) -> dict[str, Any]:
    """The summary from facts about parts, and from attributes and sizes of the arrays, by name."""
    names, counts = named_states(about["state"]), dict[str, int]()
    every = np.sum(facts["state"], axis=0)
    for code in np.flatnonzero(every).tolist():
        name = names.get(code, str(code))
        counts[name] = counts.get(name, 0) + int(every[code])
    ranges = {}
    for name in (n for n in facts if n not in OTHERS):
        lows, highs, totals, numbers = zip(*facts[name], strict=True)
        low, high, total, number = min(lows), max(highs), sum(totals), sum(numbers)
        ranges[name] = {
            "unit": about[name].get("units", ""),
            "smallest": low if number else None,
            "mean": total / number if number else None,
            "largest": high if number else None,
            "undefined": sizes[name] - number,
        }
    branches = {}
    if "branches" in facts:
        sampling = json.loads(attributes["description"])["sampling"]
        branches["branches"] = {
            "starts": 1 + sampling["starts"],
            "legs": sampling.get("legs", 0),
            "found": max(facts["branches"]),
            "kept": sampling["branches"],
        }
    return {"states": counts, "quantities": ranges, **branches}
