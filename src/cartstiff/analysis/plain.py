"""Results as plain values for JSON, their form, units and numbers, reasons of what is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from cartstiff.analysis.matrices import BY_BLOCK, BY_SOFT_BLOCK, UNITS
from cartstiff.arrays import plain as plain
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.notes import Note


class Notes:
    """Collects the reasons of what does not exist."""

    def __init__(self) -> None:
        self.entries: list[dict[str, Any]] = []

    def add(self, error: UndefinedError, what: str) -> None:
        """Note an error once."""
        note = Note.of(error, what).as_dict()
        if note not in self.entries:
            self.entries.append(note)

    def attempt(self, what: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call the function; None, with a note, where it says that its result does not exist."""
        try:
            return function(*arguments)
        except UndefinedError as error:
            self.add(error, what)
            return None


def section(keys: Iterable[str], *sources: object) -> dict[str, Any]:
    """The keys of a section, each from the first source that has an attribute of its name."""
    return {
        key: next(getattr(source, key) for source in sources if hasattr(source, key))
        for key in keys
    }


@cache
def schema() -> dict[str, Any]:
    """JSON Schema of an analysis (draft 2020-12), without references."""
    from cartstiff.analysis.sections import Analysis

    whole = Analysis.model_json_schema()
    definitions = whole.pop("$defs")

    def plain(node: Any) -> Any:
        if isinstance(node, list):
            return [plain(each) for each in node]
        if not isinstance(node, dict):
            return node
        if "$ref" in node:
            own = plain(definitions[node["$ref"].rpartition("/")[2]])
            return own | {k: v for k, v in node.items() if k != "$ref"}
        return {k: plain(v) for k, v in node.items() if k != "title" or not isinstance(v, str)}

    answer: dict[str, Any] = plain(whole)
    return answer


def _inner(node: dict[str, Any]) -> dict[str, Any]:
    """What stands there where it exists."""
    kinds = [kind for kind in node.get("anyOf", [node]) if kind.get("type") != "null"]
    return kinds[0] if len(kinds) == 1 else node


@cache
def varying() -> tuple[tuple[str, bool, bool], ...]:
    """Paths of what has an uncertainty; whether it is axes, and whether it stands in rows."""

    def walk(node: dict[str, Any], path: str, rows: bool) -> Iterator[tuple[str, bool, bool]]:
        for key, value in _inner(node).get("properties", {}).items():
            here, inside = f"{path}.{key}".lstrip("."), _inner(value)
            if value.get("varies"):
                yield here, value["varies"] == "axes", rows
            elif "properties" in inside:
                yield from walk(inside, here, rows)
            elif "properties" in inside.get("items", {}):
                yield from walk(inside["items"], here, True)

    return tuple(walk(schema(), "", False))


def unit_of(path: str) -> str:
    """Unit of the number at a dotted path of an analysis, with {length} and {force}; "1" for none.

    Entries of matrices have the unit of their block; what is not of one unit is "mixed".
    """
    node, unit, keys = schema(), "", path.split(".")
    for i, key in enumerate(keys):
        inside = _inner(node)
        rows = inside.get("items", {})
        if key.isdigit():
            node = rows
            continue
        node = inside.get("properties", rows.get("properties", {})).get(key, {})
        unit = node.get("unit") or unit
        blocks = {BY_BLOCK: UNITS.blocks, BY_SOFT_BLOCK: UNITS.blocks_of_compliance}.get(unit)
        if blocks is not None and len(keys) > i + 2:
            return blocks["".join("rt"[int(k) >= 3] for k in keys[i + 1 : i + 3])]
        if blocks is not None and key in blocks:
            return blocks[key]
    return "mixed" if unit in (BY_BLOCK, BY_SOFT_BLOCK) else unit


def _look_up(tree: Any, path: str) -> Any:
    """What stands at a dotted path; of rows a list."""
    for i, key in enumerate(keys := path.split(".")):
        if isinstance(tree, list):
            return [_look_up(row, ".".join(keys[i:])) for row in tree] or None
        tree = tree.get(key) if isinstance(tree, Mapping) else None
    return tree


def numbers(analysis: Mapping[str, Any], like: Mapping[str, Any] | None = None) -> dict[str, Array]:
    """All numbers of an analysis that depend on the parameters, by dotted name.

    What does not exist is NaN or missing. Principal values are sorted and their axes and screws
    stand in the same order, with the signs of `like`: where two principal values cross, these
    vectors change place, and their spread says so.

    Parameters
    ----------
    analysis : mapping
        From `cartstiff.analysis.summary.summarise` or `cartstiff.analysis.posture`.
    like : mapping, optional
        The analysis whose signs of axes are taken.
    """
    values: dict[str, Any] = {}
    like = analysis if like is None else like
    for path, are_axes, in_rows in varying():
        value = _look_up(analysis, path)
        if value is not None:
            along = 1 if in_rows else 0
            values[path] = _signed(value, _look_up(like, path), along) if are_axes else value
    return {name: np.array(value, dtype=float) for name, value in values.items()}


def _signed(value: Any, model: Any, along: int) -> Array:
    """Vectors turned to the side of their models."""
    vectors = np.array(value, dtype=float)
    if model is None or np.shape(model) != vectors.shape:
        return vectors
    products = np.sum(vectors * np.array(model, dtype=float), axis=along, keepdims=True)
    return np.where(products < 0.0, -vectors, vectors)
