"""Results as lines in Python and notebooks, as plain data, and as labelled arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from cartstiff.core.arrays import Array, plain
from cartstiff.core.described import kinds_of
from cartstiff.core.errors import imported
from cartstiff.core.notebook import ShownInLines

#: Dimensions by the sizes of a described kind; rotation before translation, x before y
#: before z.
_DIMENSIONS = {
    "6 6": ("row", "column"),
    "6": ("row",),
    "3": ("axis",),
    "4 4": ("pose_row", "pose_column"),
    "6 n": ("row", "joint"),
}


class LabelledResult(ShownInLines):
    """Base of results; dataclasses need `repr=False`.

    Each result has a method `plot`, which returns its picture as a figure.
    """

    #: Command that prints the result, whose keys are described; "" for none.
    command: ClassVar[str] = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: each field; None if it does not exist."""
        data: dict[str, Any] = plain(self)
        return data

    def to_dataset(self) -> Any:
        """All numbers of `to_dict` as labelled arrays, and its texts as attributes.

        Numbers within others have dotted names, such as ``stiffness.K``. A list of
        objects is a table: its numbers have the list's name as their first dimension. Of
        points along a curve or a path that dimension is ``point``. A number that does not
        exist is NaN. Lists of lists of objects, whose lengths differ, are left out.

        Returns
        -------
        xarray.Dataset
            The units of lengths, forces and angles are the attributes ``units.length``,
            ``units.force`` and ``units.angle``.

        Raises
        ------
        MissingDependencyError
            Without xarray.
        """
        xarray = imported("xarray", "xarray", "labelled arrays", "maps")
        data = self.to_dict()
        kinds = kinds_of(self.command) if self.command else {}
        q = np.array(data.get("q", ()), object)
        points = len(q) if q.ndim == 2 else None  # along a curve or a path
        variables = {}
        for name, table, values in _numbers(data):
            kind, words = kinds.get(name, ("", ""))
            if name in ("joints", "mechanism.joints"):
                name = "joint"
            first = [table] if table else []
            if not first and values.shape[:1] == (points,) and name != "joint":
                first = ["point"]
            rest = _dimensions(name, kind, values.ndim - len(first))
            variables[name] = (
                (*first, *rest),
                values,
                {"long_name": words} if words else {},
            )
        texts = {name: value for name, value in _leaves(data) if isinstance(value, str)}
        return xarray.Dataset(variables, attrs=texts)

    def _lines(self) -> Iterable[str]:
        yield f"{type(self).__name__}, numbers by .to_dict() or .to_dataset():"
        for name, _, values in _numbers(self.to_dict()):
            size = " x ".join(map(str, values.shape))
            if size or values == values:  # what does not exist is NaN
                yield f"  {name}  {f'({size})' if size else values.item()}"


def _leaves(data: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Values that are no mappings, by their dotted names.

    Of notes the messages, one a line.
    """
    for key, value in data.items():
        if key == "notes":
            yield f"{before}{key}", "\n".join(note["message"] for note in value)
        elif isinstance(value, Mapping):
            yield from _leaves(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _numbers(data: Mapping[str, Any]) -> Iterator[tuple[str, str, Array]]:
    """Dotted name, name of the table that it is a column of or "",
    and values of each number.
    """
    for name, value in _leaves(data):
        if (
            isinstance(value, list)
            and value
            and all(isinstance(v, Mapping) for v in value)
        ):
            rows = [dict(_leaves(row)) for row in value]
            for key in dict.fromkeys(key for row in rows for key in row):
                if (values := _array([row.get(key) for row in rows])) is not None:
                    yield f"{name}.{key}", name, values
        elif (
            not isinstance(value, str)
            and (values := _array(value)) is not None
            and values.size
        ):
            yield name, "", values


def _array(value: object) -> Array | None:
    """Numbers or texts as an array, NaN where a number or a whole row is None;
    None for others.
    """
    if isinstance(value, list) and (
        row := next((v for v in value if isinstance(v, list)), None)
    ):
        value = [np.full(np.shape(row), np.nan) if v is None else v for v in value]
    for kind in (None, float):
        try:
            values = np.array(value, kind)
        except (TypeError, ValueError):
            continue
        if values.dtype.kind in "biufU":
            return values
    return None


def _dimensions(name: str, kind: str, count: int) -> tuple[str, ...]:
    """Names of the dimensions of an array of a described kind,
    such as ``matrix? 6 6``.
    """
    named: tuple[str, ...] = _DIMENSIONS.get(kind.partition(" ")[2], ())
    if name in ("q", "joint"):
        named = ("joint",)
    return named if len(named) == count else tuple(f"{name}_{i}" for i in range(count))
