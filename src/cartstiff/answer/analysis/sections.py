"""The form of an analysis: content of each key, with unit, frame and meaning.

It is defined by the table `described/analysis.yaml` (`cartstiff.core.described`): the
numbers that have an uncertainty and the units of numbers in maps follow from there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from cartstiff.answer.analysis.matrices import BY_BLOCK, BY_SOFT_BLOCK, UNITS
from cartstiff.core.arrays import Array
from cartstiff.core.described import schema
from cartstiff.core.errors import UndefinedError
from cartstiff.core.notes import Note


class Notes:
    """Collects the reasons for results that do not exist."""

    def __init__(self) -> None:
        self.entries: list[dict[str, Any]] = []

    def add(self, error: UndefinedError, what: str) -> None:
        """Note an error once."""
        note = Note.of(error, what).to_dict()
        if note not in self.entries:
            self.entries.append(note)

    def attempt(self, what: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call the function; None, with a note, if its result does not exist."""
        try:
            return function(*arguments)
        except UndefinedError as error:
            self.add(error, what)
            return None


def section(path: str, *sources: object) -> dict[str, Any] | None:
    """The section at a dotted path: each key from the first source with an attribute
    of its name.

    None without the first source; a key that no source has is None.
    """
    if sources[0] is None:
        return None
    node = schema("analysis")
    for key in path.split("."):
        node = node["properties"][key]
    keys = node.get("items", node)["properties"]
    return {
        key: next((getattr(x, key) for x in sources if hasattr(x, key)), None)
        for key in keys
    }


@cache
def varying() -> tuple[tuple[str, bool, bool], ...]:
    """Paths of values with an uncertainty; whether they are axes, and in rows."""

    def walk(
        node: dict[str, Any], path: str, rows: bool
    ) -> Iterator[tuple[str, bool, bool]]:
        for key, value in node.get("properties", {}).items():
            here = f"{path}.{key}".lstrip(".")
            if value.get("varies"):
                yield here, value["varies"] == "axes", rows
            else:
                yield from walk(value, here, rows)
                yield from walk(value.get("items", {}), here, True)

    return tuple(walk(schema("analysis"), "", False))


def unit_of(path: str) -> str:
    """Unit of the number at a dotted path of an analysis, with {length} and {force};
    "1" for none.

    Entries of matrices have the unit of their block; a value without a single unit is
    "mixed".
    """
    node, unit, keys = schema("analysis"), "", path.split(".")
    for i, key in enumerate(keys):
        rows = node.get("items", {})
        if key.isdigit():
            node = rows
            continue
        node = node.get("properties", rows.get("properties", {})).get(key, {})
        unit = node.get("unit") or unit
        blocks = {BY_BLOCK: UNITS.blocks, BY_SOFT_BLOCK: UNITS.blocks_of_compliance}.get(
            unit
        )
        if blocks is not None and len(keys) > i + 2:
            return blocks["".join("rt"[int(k) >= 3] for k in keys[i + 1 : i + 3])]
        if blocks is not None and key in blocks:
            return blocks[key]
    return "mixed" if unit in (BY_BLOCK, BY_SOFT_BLOCK) else unit


def look_up(tree: Any, path: str) -> Any:
    """Value at a dotted path of keys and positions.

    A list for a key of rows, None for nothing.
    """
    for i, key in enumerate(keys := path.split(".")):
        if isinstance(tree, list) and key.isdigit():
            tree = tree[int(key)] if int(key) < len(tree) else None
        elif isinstance(tree, list):
            return [look_up(row, ".".join(keys[i:])) for row in tree] or None
        else:
            tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree


def numbers(
    analysis: Mapping[str, Any], like: Mapping[str, Any] | None = None
) -> dict[str, Array]:
    """All numbers of an analysis that depend on the parameters, by dotted name.

    A value that does not exist is NaN or missing. Principal values are sorted, with axes
    and screws in the same order and with the signs of `like`: if two principal values
    cross, these vectors change places, which their spread shows.

    Parameters
    ----------
    analysis : mapping
        From `cartstiff.answer.analysis.posture.summarise` or
        `cartstiff.answer.analysis.posture`.
    like : mapping, optional
        The analysis whose signs of axes are taken.
    """
    values: dict[str, Any] = {}
    like = analysis if like is None else like
    for path, are_axes, in_rows in varying():
        value = look_up(analysis, path)
        if value is not None:
            along = 1 if in_rows else 0
            values[path] = (
                _signed(value, look_up(like, path), along) if are_axes else value
            )
    return {name: np.array(value, dtype=float) for name, value in values.items()}


def _signed(value: Any, model: Any, along: int) -> Array:
    """Vectors with the signs of their models."""
    vectors = np.array(value, dtype=float)
    if model is None or np.shape(model) != vectors.shape:
        return vectors
    products = np.sum(vectors * np.array(model, dtype=float), axis=along, keepdims=True)
    return np.where(products < 0.0, -vectors, vectors)
