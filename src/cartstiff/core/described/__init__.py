"""Keys of the JSON output of each command, and of its parts: analysis and answer.

One table each, such as `analyse.yaml`, has every key with its kind and its description:
"kind | words | unit | varies". The printed object has the keys of its table, as have the
JSON schema and the reference page.

- A key with "?" may be missing, a kind with "?" may be null, and so may numbers that do
  not exist or are infinite. "is": kind of the object or list itself; "each": of its
  entries.
- Units are in {length} and {force}; a key without one has that of the keys above it, 1 is
  a pure number. What varies has an uncertainty: a number, or axes (columns) whose sign
  means nothing.
- "as analyse" is the key of that name there; "as analysis" of a table without it is all
  of it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cartstiff.core.arrays import plain

Keys = dict[str, Any]
_CONSTANT, _AS = "always ", "as "
#: Commands, and the parts of their objects that have tables of their own.
TABLES = (
    "analyse",
    "equilibrium",
    "compare",
    "frames",
    "modes",
    "identify",
    "assemble",
    "workspace",
    "design",
    "analysis",
    "answer",
)
#: Tables that have all keys of another, too.
_EXTENDED = {"equilibrium": "analyse"}
Schema = dict[str, Any]
#: Signs of a symmetric matrix.
SIGNS = (
    "positive",
    "positive semidefinite",
    "indefinite",
    "negative semidefinite",
    "negative",
    "zero",
)
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
_CHOICE = re.compile(r"one of(\?)? (.*)")
#: Kinds of lists, and their entries.
_LISTS: dict[str, Schema] = {
    "numbers": {"type": "number"},
    "numbers or null": {"type": ["number", "null"]},
    "integers": {"type": "integer"},
    "texts": {"type": "string"},
    "flags": {"type": "boolean"},
}


def object_schema(keys: Schema, own: Schema) -> Schema:
    """JSON Schema of an object with exactly these keys."""
    return {
        **own,
        "properties": {
            key.removesuffix("?"): _entry(entry) for key, entry in keys.items()
        },
        "required": [key for key in keys if not key.endswith("?")],
        "additionalProperties": False,
    }


def _entry(entry: Any) -> Schema:
    """The schema of one entry of a table."""
    if isinstance(entry, str):
        return _kind(entry)
    own = _kind(entry.get("is", "object"))
    if "each" in entry:
        is_list = entry["is"].startswith("list")
        return own | {
            "items" if is_list else "additionalProperties": _entry(entry["each"])
        }
    return object_schema({key: value for key, value in entry.items() if key != "is"}, own)


def _kind(text: str) -> Schema:
    """The schema of a kind and its words, such as ``numbers? 6 | moment, force``."""
    kind, *more = (part.strip() for part in text.split("|"))
    about = {
        k: v for k, v in zip(("description", "unit", "varies"), more, strict=False) if v
    }
    if kind == "any":
        return about
    if kind.startswith("always "):
        return {"const": kind.removeprefix("always ")} | about
    if kind.startswith("signs"):
        kind = f"one of{kind.removeprefix('signs')} {', '.join(SIGNS)}"
    if choice := _CHOICE.fullmatch(kind):
        return {"enum": [*choice[2].split(", "), *([None] if choice[1] else [])]} | about
    name, null, rows, columns = _FORM.fullmatch(kind).groups()  # type: ignore[union-attr]
    json_type: str = _KINDS.get(name, "array")
    schema: Schema = {"type": [json_type, "null"] if null else json_type} | about
    if name in _LISTS:
        schema["items"] = _LISTS[name]
    if name.startswith("matrix"):
        row = name.replace("matrix", "numbers")
        schema["items"] = _kind(row if columns == "n" else f"{row} {columns}")
    return schema | ({"minItems": int(rows), "maxItems": int(rows)} if rows else {})


@cache
def keys_of(table: str) -> Keys:
    """The keys of a table with their kinds and descriptions."""
    import yaml

    # The former is seven times as fast.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    text = (Path(__file__).parent / f"{table}.yaml").read_text(encoding="utf-8")
    keys: Keys = yaml.load(text, Loader=loader)
    return {key: _resolved(key, kind) for key, kind in keys.items()}


def _resolved(key: str, kind: Any) -> Any:
    """The kind of a key; that in another table, or all of that, if it refers there."""
    if not (isinstance(kind, str) and kind.startswith(_AS)):
        return kind
    other, _, words = kind.removeprefix(_AS).partition("|")
    keys = keys_of(other.strip())
    return keys[key] if key in keys else {"is": f"object | {words.strip()}", **keys}


@cache
def schema(table: str) -> Schema:
    """JSON Schema of a table's object (draft 2020-12), without references."""
    return object_schema(_whole(table), {"type": "object"})


def _whole(table: str) -> Keys:
    """Keys of a table, and of the one that it extends."""
    if table in _EXTENDED:
        return keys_of(_EXTENDED[table]) | keys_of(table)
    return keys_of(table)


def kinds_of(command: str) -> dict[str, tuple[str, str]]:
    """Kind and description of a command's keys, by dotted name.

    Of lists by those of an entry.
    """

    def walk(
        keys: Mapping[str, Any], before: str
    ) -> Iterator[tuple[str, tuple[str, str]]]:
        for entry, kind in keys.items():
            name = before + entry.removesuffix("?")
            inner = kind.get("each", kind) if isinstance(kind, Mapping) else kind
            if isinstance(inner, Mapping):
                yield from walk(inner, f"{name}.")
            else:
                sizes, _, words = inner.partition("|")
                yield name, (sizes.strip(), words.strip())

    return dict(walk(_whole(command), ""))


def described(command: str, *sources: object) -> dict[str, Any]:
    """The printed object of a command, as plain data in the order of its table.

    Parameters
    ----------
    command : str
        Name of the command.
    sources : mapping or object
        Each key is read from the first source that has it, as a key or an attribute;
        optional keys are read from mappings only.

    Raises
    ------
    LookupError
        For a required key that no source has.
    """
    data: dict[str, Any] = {}
    for entry, kind in keys_of(command).items():
        key = entry.removesuffix("?")
        if isinstance(kind, str) and kind.startswith(_CONSTANT):
            data[key] = kind.partition("|")[0].removeprefix(_CONSTANT).strip()
            continue
        for source in sources:
            if isinstance(source, Mapping):
                if key in source:
                    data[key] = plain(source[key])
                    break
            elif key == entry and hasattr(source, key):
                data[key] = plain(getattr(source, key))
                break
        else:
            if key == entry:
                raise LookupError(f"{command}: no {key}")
    return data
