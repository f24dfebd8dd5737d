"""Of the branches of a Cartesian map, those that go over into each other without a flip.

Branches of neighbouring places belong together if they are nearest to each other and no joint
steps further than `STEP`. What hangs together so is a *configuration*: an arm reaches all its
places without leaving them in between.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.maps.reading import quantities_of, quantity_of

if TYPE_CHECKING:
    import xarray

#: Largest step of a joint between neighbouring places (rad, or length units).
STEP = 0.7
#: Number of the state of places that the configuration does not reach and others do.
_OTHER = 254


def single_branch(
    dataset: xarray.Dataset, quantity: str, limit: float | None = None, below: bool = True
) -> xarray.Dataset:
    """The map of the best single configuration: one branch at every place that it reaches.

    Parameters
    ----------
    dataset : xarray.Dataset
        A Cartesian map from `open_map`; one without branches comes back as it is.
    quantity : str
        At a place that a configuration reaches twice its better branch stands.
    limit : float, optional
        The configuration that keeps the quantity on one side of it at the most places is the best;
        without a limit the one that reaches the most places.
    below : bool
        Whether below the limit counts.

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
    chosen = _best(labels, values, limit, below)
    sign = 1.0 if array.attrs.get("better") == "smaller" else -1.0
    mine = labels == chosen
    pick = np.where(mine, sign * values, np.inf).argmin(axis=-1)
    picked = dataset.isel(branch=xarray.DataArray(pick, dims=places)).copy()
    there, anywhere = mine.any(axis=-1), np.isfinite(values).any(axis=-1)
    for name in quantities_of(dataset):
        picked[name] = picked[name].where(xarray.DataArray(there, dims=places))
    about = dict(dataset["state"].attrs)
    about["flag_values"] = [*about["flag_values"], _OTHER]
    about["flag_meanings"] = f"{about['flag_meanings']} other-branch"
    state = picked["state"].transpose(*places).values
    picked["state"] = places, np.where(anywhere & ~there, _OTHER, state), about
    return picked


def _labels(values: Array, q: Array) -> Array:
    """Number of the configuration of every branch, -1 where there is none."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    known = np.isfinite(values)
    number = np.full(values.shape, -1)
    number[known] = np.arange(known.sum())
    begins, ends = [np.empty(0, int)], [np.empty(0, int)]
    for axis in range(values.ndim - 1):
        count = values.shape[axis]
        here, there = (np.arange(count - 1), np.arange(1, count))
        a, b = (np.take(q, rows, axis) for rows in (here, there))
        na, nb = (np.take(number, rows, axis) for rows in (here, there))
        step = a[..., :, None, :] - b[..., None, :, :]
        size = np.abs(step).max(axis=-1)
        size = np.where((na[..., :, None] >= 0) & (nb[..., None, :] >= 0), size, np.inf)
        size = np.where(np.isfinite(size), size, np.inf)
        near = (size <= STEP) & (size <= size.min(axis=-1, keepdims=True))
        near &= size <= size.min(axis=-2, keepdims=True)
        rows = np.broadcast_to(na[..., :, None], near.shape)[near]
        columns = np.broadcast_to(nb[..., None, :], near.shape)[near]
        begins.append(rows)
        ends.append(columns)
    i, j = np.concatenate(begins), np.concatenate(ends)
    total = int(known.sum())
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(total, total))
    labels = np.full(values.shape, -1)
    labels[known] = connected_components(graph, directed=False)[1]
    return labels


def _best(labels: Array, values: Array, limit: float | None, below: bool) -> int:
    """The configuration with the most places (within the limit, then at all)."""
    within = np.isfinite(values)
    if limit is not None:
        within &= values <= limit if below else values >= limit

    def places(counted: Any) -> Array:
        count = int(labels.max(initial=-1)) + 1
        rows = np.broadcast_to(
            np.arange(labels[..., 0].size).reshape(labels.shape[:-1])[..., None], labels.shape
        )
        pairs = np.unique(np.column_stack([labels[counted], rows[counted]]), axis=0)
        counts: Array = np.bincount(pairs[:, 0], minlength=count)
        return counts

    if not (labels >= 0).any():
        return 0
    reached = places(labels >= 0)
    kept = places((labels >= 0) & within)
    return int(np.lexsort((-reached, -kept))[0])
