"""JSON Schema of what the commands print with ``--json``, from the table `output_keys.yaml`.

The table holds each key once, with its kind and its words; the reference page is made from it, and
the analysis adds its own description (`cartstiff.analysis.sections`).
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from cartstiff.analysis.sections import schema as schema_of_analysis
from cartstiff.errors import UnknownNameError

Schema = dict[str, Any]
_DRAFT = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
_KINDS = {
    "number": "number",
    "integer": "integer",
    "flag": "boolean",
    "text": "string",
    "list": "array",
    "object": "object",
    "by name": "object",
}
_FORM = re.compile(r"([a-z ]+?)(\?)?(?: (\d+))?(?: (\d+|n))?")
#: Kinds of lists, and what their entries are.
_LISTS: dict[str, Schema] = {
    "numbers": {"type": "number"},
    "numbers or null": {"type": ["number", "null"]},
    "integers": {"type": "integer"},
    "texts": {"type": "string"},
}


def json_schema(command: str = "analyse") -> Schema:
    """JSON Schema of what a command prints with ``--json``.

    Parameters
    ----------
    command : {"analyse", "equilibrium", "frames", "modes", "identify", "assemble", "workspace", \
"design", "analysis"}
        The command; "analysis" is the object that ``analyse`` adds under this key.

    Returns
    -------
    dict
        Draft 2020-12.

    Raises
    ------
    UnknownNameError
        For another command.
    """
    if command == "analysis":
        return _DRAFT | schema_of_analysis()
    if command not in _table():
        raise UnknownNameError("command", command, [*_table(), "analysis"])
    keys = _table()[command]
    if command == "equilibrium":
        keys = _table()["analyse"] | keys
    schema = _object(keys, {"type": "object"}) | {
        "description": f"Output of cartstiff {command} --json"
    }
    if command in ("analyse", "equilibrium"):
        words = {"description": "unless --analysis none"}
        schema["properties"]["analysis"] = schema_of_analysis() | words
    return _DRAFT | schema


@cache
def _table() -> dict[str, Schema]:
    path = Path(__file__).with_name("output_keys.yaml")
    table: dict[str, Schema] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return table


def _object(keys: Schema, own: Schema) -> Schema:
    """An object with exactly these keys."""
    properties = {}
    for key, entry in keys.items():
        name = key.removesuffix("?")
        properties[name] = _entry(_table()["analyse"][key] if entry == "as analyse" else entry)
    return {
        **own,
        "properties": properties,
        "required": [key for key in keys if not key.endswith("?")],
        "additionalProperties": False,
    }


def _entry(entry: Any) -> Schema:
    """The schema of one entry of the table."""
    if isinstance(entry, str):
        return _kind(entry)
    own = _kind(entry.get("is", "object"))
    if "each" in entry:
        is_list = entry["is"].startswith("list")
        return own | {"items" if is_list else "additionalProperties": _entry(entry["each"])}
    return _object({key: value for key, value in entry.items() if key != "is"}, own)


def _kind(text: str) -> Schema:
    """The schema of a kind and its words, such as ``numbers? 6 | moment, force``."""
    kind, bar, words = text.partition(" | ")
    described = {"description": words} if bar else {}
    if kind == "any":
        return described
    if kind.startswith("one of "):
        return {"enum": kind.removeprefix("one of ").split(", ")} | described
    if kind.startswith("always "):
        return {"const": kind.removeprefix("always ")} | described
    name, null, rows, columns = _FORM.fullmatch(kind).groups()  # type: ignore[union-attr]
    json_type: str = _KINDS.get(name, "array")
    schema: Schema = {"type": [json_type, "null"] if null else json_type} | described
    if name in _LISTS:
        schema["items"] = _LISTS[name]
    if name == "matrix":
        schema["items"] = _kind("numbers" if columns == "n" else f"numbers {columns}")
    return schema | ({"minItems": int(rows), "maxItems": int(rows)} if rows else {})
