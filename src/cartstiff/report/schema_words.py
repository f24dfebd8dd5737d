"""The words of which the JSON Schemas of the output are made."""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]

#: A number for each name.
BY_NAME: Schema = {"type": "object", "additionalProperties": {"type": "number"}}


def _of_type(kind: str, description: str, null: bool) -> Schema:
    schema: Schema = {"type": [kind, "null"] if null else kind}
    return schema | ({"description": description} if description else {})


def number(description: str = "", *, null: bool = False) -> Schema:
    """A number, or null where it may not exist."""
    return _of_type("number", description, null)


def integer(description: str = "") -> Schema:
    """A whole number."""
    return _of_type("integer", description, False)


def flag(description: str = "", *, null: bool = False) -> Schema:
    """True or false, or null where that is not known."""
    return _of_type("boolean", description, null)


def text(description: str = "", *, null: bool = False) -> Schema:
    """A text, or null where there may be none."""
    return _of_type("string", description, null)


def one_of(*choices: str) -> Schema:
    """One of some words."""
    return {"enum": list(choices)}


def list_of(items: Schema, description: str = "", *, null: bool = False) -> Schema:
    """A list, or null where it may not exist."""
    return _of_type("array", description, null) | {"items": items}


def numbers(description: str = "", size: int | None = None, *, null: bool = False) -> Schema:
    """A list of numbers, of a size where one is given; or null where it may not exist."""
    schema = list_of({"type": "number"}, description, null=null)
    return schema if size is None else schema | {"minItems": size, "maxItems": size}


def strings(description: str = "") -> Schema:
    """A list of texts."""
    return list_of({"type": "string"}, description)


def matrix(rows: int, columns: int | None, description: str, nothing: str = "") -> Schema:
    """A list of rows, or null where `nothing` says."""
    whole = f"{description}; null {nothing}" if nothing else description
    schema = list_of(numbers(size=columns), whole, null=bool(nothing))
    return schema | {"minItems": rows, "maxItems": rows}


def object_with(properties: Schema, description: str = "", *, null: bool = False) -> Schema:
    """An object with exactly these keys, or null where it may not exist."""
    return {
        "type": ["object", "null"] if null else "object",
        "description": description,
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def form(name: str) -> Schema:
    """The first key of each document: its form and version, such as "cartstiff/1"."""
    return {"const": name, "description": "name and version of this form"}


def document(properties: Schema, command: str, optional: Schema | None = None) -> Schema:
    """What a command prints with ``--json``, with keys that are there on request only."""
    schema = object_with(properties, f"Output of cartstiff {command} --json")
    schema["properties"] = properties | (optional or {})
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
