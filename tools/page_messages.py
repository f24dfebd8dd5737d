"""The messages of a page as JavaScript: ``python tools/page_messages.py`` writes them.

They are those that `cartstiff.page.messages` reads: the page sends nothing else, and a test holds
the file to the models.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel

from cartstiff.page import messages

TARGET = Path(__file__).resolve().parents[1] / "src/cartstiff/page/static/messages.js"

_HEAD = """\
// Written by `python tools/page_messages.py` from the models of `cartstiff.page.messages`, which
// read what a page sends: not to be changed by hand.
"""
#: Fields of every message.
_EVERY = ("id", "state", "do")


def javascript() -> str:
    """The fields of messages, and of what they hold, for whoever sends one."""
    kinds: tuple[type[BaseModel], ...] = get_args(messages.Message)
    models: dict[str, type[BaseModel]] = {}
    for kind in kinds:
        _collect(kind, models)
        del models[kind.__name__]
    of_messages = {get_args(k.model_fields["do"].annotation)[0]: k for k in kinds}
    needed = {
        name: [key for key, x in model.model_fields.items() if x.is_required()]
        for name, model in {**models, **of_messages}.items()
    }
    needed = {name: [key for key in keys if key not in _EVERY] for name, keys in needed.items()}
    parts = [
        _HEAD,
        "/** Fields of each message, by its `do`, beside those of every message: the model that a\n"
        " * field holds, the words that it may be, or null. */\n"
        + _constant("MESSAGES", {name: _fields(kind) for name, kind in of_messages.items()}),
        "/** The same of each model that a message holds. */\n"
        + _constant("FIELDS", {name: _fields(model) for name, model in models.items()}),
        "/** Fields that may not be left out. */\n"
        + _constant("NEEDED", {name: keys for name, keys in needed.items() if keys}),
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


def _fields(model: type[BaseModel]) -> dict[str, str | list[str] | None]:
    """What each field of a model holds, those of every message left out."""
    own = {key: x for key, x in model.model_fields.items() if key not in _EVERY}
    return {key: _content(x.annotation) for key, x in own.items()}


def _content(annotation: Any) -> str | list[str] | None:
    """The model that a field holds, one or several, or the words that it may be."""
    if get_origin(annotation) is Literal:
        return list(get_args(annotation))
    held = _held(annotation)
    return held[0].__name__ if held else None


def _rows(words: Iterable[str], first: str) -> list[str]:
    """Words in lines of at most 110 letters; those after the first begin with blanks."""
    rows = [first]
    for word in words:
        if len(rows[-1]) + len(word) > 110:
            rows.append("   ")
        rows[-1] += f" {word}"
    return rows


def _constant(name: str, values: dict[str, Any]) -> str:
    lines = [row for key, value in values.items() for row in _rows_of(key, value)]
    return "\n".join([f"export const {name} = {{", *lines, "};", ""])


def _rows_of(key: str, value: Any) -> list[str]:
    """A constant's entry."""
    if not isinstance(value, dict) or not value:
        return [f"  {key}: {json.dumps(value)},"]
    held = [f"{name}: {json.dumps(one)}," for name, one in value.items()]
    return _rows([*held[:-1], held[-1][:-1], "},"], f"  {key}: {{")


if __name__ == "__main__":
    TARGET.write_text(javascript(), encoding="utf-8")
    print(f"Wrote {TARGET}")
