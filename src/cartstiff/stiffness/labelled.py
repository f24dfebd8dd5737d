"""Matrices with names and units on their rows and columns: as text, for xarray, for pandas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.choices import Order
from cartstiff.errors import imported
from cartstiff.geometry import se3
from cartstiff.geometry.connections import Connection
from cartstiff.mechanisms.contract import Units
from cartstiff.stiffness.showing import BlockUnits, matrix_html

#: Names along the axes of matrices: components of wrenches, and of motions.
AXES = {"wrench": ("mx", "my", "mz", "fx", "fy", "fz"), "motion": ("rx", "ry", "rz", "x", "y", "z")}


def with_labels(
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


def format_matrix(matrix: Array, row_units: Sequence[str], title: str = "", digits: int = 6) -> str:
    """Matrix as aligned text, one row a line, each row followed by its unit."""
    # One format for the whole matrix, so that columns can be compared at a glance.
    width = digits + 8
    lines = [title] if title else []
    size = float(np.abs(matrix).max(initial=0.0))
    for row, unit in zip(matrix, row_units, strict=True):
        cells = "".join(
            f"{0.0 if abs(x) < numerics.LAST_DIGITS * size else x:>{width}.{digits}g}" for x in row
        )
        lines.append(f"{cells}   {unit}".rstrip())
    return "\n".join(lines)


class LabelledMatrix:
    """A 6x6 matrix in one of the two orders; NumPy, xarray and pandas see it."""

    matrix: Array
    connection: Connection
    frame: str
    units: Units
    order: Order
    #: Letter of the matrix, and what its rows and columns are.
    _letter = "K"
    _axes = ("wrench", "motion")

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """NumPy sees the matrix."""
        return np.array(self.matrix, dtype=dtype)

    def __getitem__(self, index: Any) -> Any:
        """Entries of the matrix: ``K[3:, 3:]``."""
        return self.matrix[index]

    @property
    def T(self) -> Array:  # noqa: N802
        """The transposed matrix."""
        return self.matrix.T

    def to_xarray(self) -> Any:
        """`xarray.DataArray` with the components' names; MissingDependencyError without xarray."""
        angular = self.order == se3.ANGULAR_LINEAR
        axes = {n: v if angular else (*v[3:], *v[:3]) for n, v in AXES.items()}
        return with_labels({self._letter: (self._axes, self.matrix)}, axes)[self._letter]

    def to_pandas(self) -> Any:
        """`pandas.DataFrame` with the components' names on rows and columns."""
        return self.to_xarray().to_pandas()

    @property
    def block_units(self) -> BlockUnits:
        """Units of the four 3x3 blocks, in the matrix's order."""
        names = self.units.blocks if self._letter == "K" else self.units.blocks_of_compliance
        a, b = "rt" if self.order == se3.ANGULAR_LINEAR else "tr"
        return (names[a + a], names[a + b]), (names[b + a], names[b + b])

    def __str__(self) -> str:
        (a, b), (c, d) = self.block_units
        title = f"{self._title}, order {self.order}"
        return format_matrix(self.matrix, [f"[{a} | {b}]"] * 3 + [f"[{c} | {d}]"] * 3, title)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return matrix_html(self.matrix, self.block_units, self._title, self.order)

    @property
    def _title(self) -> str:
        return f"{self._letter}^{self.connection.name} in {self.frame}"


@dataclass(frozen=True, eq=False, repr=False)
class Compliance(LabelledMatrix):
    """A compliance matrix: twist (rows) per wrench (columns); the inverse of a stiffness matrix."""

    _letter = "C"
    _axes = ("motion", "wrench")

    matrix: Array
    connection: Connection
    pose: Array
    frame: str
    units: Units
    order: Order = "angular-linear"

    def to_order(self, order: Order) -> Compliance:
        """Components in another order."""
        if order == self.order:
            return self
        return replace(self, matrix=self.matrix[se3.SWAP][:, se3.SWAP], order=order)
