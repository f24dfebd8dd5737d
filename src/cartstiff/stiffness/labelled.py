"""Matrices with names on their rows and columns, as xarray and pandas have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cartstiff.arrays import Array
from cartstiff.errors import imported

__all__ = ["AXES", "labelled"]

#: Names along the axes of matrices: components of wrenches, and of motions.
AXES = {"wrench": ("mx", "my", "mz", "fx", "fy", "fz"), "motion": ("rx", "ry", "rz", "x", "y", "z")}


def labelled(
    arrays: Mapping[str, tuple[Sequence[str], Array]],
    axes: Mapping[str, Sequence[Any]] = AXES,
    **about: object,
) -> Any:
    """An `xarray.Dataset` of arrays, each with the names of its axes.

    Parameters
    ----------
    arrays : mapping of str to (names of axes, ndarray)
        What it holds.
    axes : mapping of str to sequence
        Labels along the axes that have any.
    **about
        Attributes of the dataset.

    Raises
    ------
    MissingDependencyError
        Without xarray.
    """
    xarray = imported("xarray", "xarray", "a table with labels", "maps")
    used = {axis for names, _ in arrays.values() for axis in names}
    return xarray.Dataset(
        {name: (list(names), np.array(values)) for name, (names, values) in arrays.items()},
        coords={axis: list(labels) for axis, labels in axes.items() if axis in used},
        attrs=about,
    )
