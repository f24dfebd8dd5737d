"""The messages of a page as JavaScript: ``python tools/page_messages.py`` writes them.

They are those that `cartstiff.page.messages` reads: the page sends nothing else, and a test holds
the file to the models.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from cartstiff.page import messages

TARGET = Path(__file__).resolve().parents[1] / "src/cartstiff/page/static/messages.js"

_HEAD = """\
// Written by `python tools/page_messages.py` from the models of `cartstiff.page.messages`, which
// read what a page sends: not to be changed by hand.
"""
_WORDS = {int: "number", float: "number", bool: "boolean", str: "string", type(None): "null"}


def javascript() -> str:
    """The models as JSDoc types, and their fields for whoever sends a message."""
    kinds: tuple[type[BaseModel], ...] = get_args(messages.Message)
    models: dict[str, type[BaseModel]] = {}
    for kind in kinds:
        _collect(kind, models)
    parts = [_HEAD, *(_typedef(model) for model in models.values())]
    names = {get_args(kind.model_fields["do"].annotation)[0]: kind.__name__ for kind in kinds}
    fields, needed = dict[str, Any](), dict[str, Any]()
    for name, model in models.items():
        fields[name] = {key: _content(x.annotation) for key, x in model.model_fields.items()}
        needed[name] = [key for key, x in model.model_fields.items() if x.is_required()]
    parts += [
        f"/** Model of each message, by its `do`. */\n{_constant('MESSAGES', names)}",
        "/** Fields of each model: their model, the words that they may be, or null. */\n"
        + _constant("FIELDS", fields),
        f"/** Fields that may not be left out. */\n{_constant('NEEDED', needed)}",
    ]
    return "\n".join(parts).rstrip() + "\n"


def _collect(model: type[BaseModel], models: dict[str, type[BaseModel]]) -> None:
    """Add a model, behind those that its fields hold."""
    for field in model.model_fields.values():
        for held in _held(field.annotation):
            _collect(held, models)
    models[model.__name__] = model


def _held(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _held(inner)]


def _type(annotation: Any) -> str:
    """A type of Python as one of JSDoc."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(inner[0])
    if origin is Literal:
        return " | ".join(json.dumps(word) for word in inner)
    if origin in (UnionType, Union):
        return " | ".join(_type(one) for one in inner)
    if origin is list:
        held = _type(inner[0])
        return f"({held})[]" if "|" in held else f"{held}[]"
    if origin is tuple:
        return f"[{', '.join(_type(one) for one in inner)}]"
    if origin is dict:
        return f"Record<{_type(inner[0])}, {_type(inner[1])}>"
    return annotation.__name__ if issubclass(annotation, BaseModel) else _WORDS[annotation]


def _content(annotation: Any) -> str | list[str] | None:
    """The model that a field holds, one or several, or the words that it may be."""
    if get_origin(annotation) is Literal:
        return list(get_args(annotation))
    held = _held(annotation)
    return held[0].__name__ if held else None


def _typedef(model: type[BaseModel]) -> str:
    lines = [f"@typedef {{object}} {model.__name__} {(model.__doc__ or '').splitlines()[0]}"]
    for name, field in model.model_fields.items():
        called = name if field.is_required() else f"[{name}]"
        lines += _rows(f"@property {{{_type(field.annotation)}}} {called}".split(" "), "  ")
    return "\n".join(["/**", *(f" * {line}" for line in lines), " */"])


def _rows(words: Iterable[str], begin: str, first: str = "") -> list[str]:
    """Words in lines of at most 110 letters; those after the first begin with blanks."""
    rows = [first]
    for word in words:
        if len(rows[-1]) + len(word) > 110:
            rows.append(begin)
        rows[-1] += f"{' ' * (rows[-1].strip() != '')}{word}"
    return rows


def _constant(name: str, values: dict[str, Any]) -> str:
    lines = [row for key, value in values.items() for row in _rows_of(key, value)]
    return "\n".join([f"export const {name} = {{", *lines, "};", ""])


def _rows_of(key: str, value: Any) -> list[str]:
    """A constant's entry."""
    if not isinstance(value, dict):
        return [f"  {key}: {json.dumps(value)},"]
    held = [f"{name}: {json.dumps(one)}," for name, one in value.items()]
    return _rows([*held[:-1], *(word[:-1] for word in held[-1:]), "},"], "    ", f"  {key}: {{")


if __name__ == "__main__":
    TARGET.write_text(javascript(), encoding="utf-8")
    print(f"Wrote {TARGET}")
