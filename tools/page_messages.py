"""The messages of a page as types: ``python tools/page_messages.py`` writes them.

They are those of the models that `cartstiff.shown.page.messages` reads. TypeScript checks by them
what the page's scripts send; a test holds the file to the models.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel

from cartstiff.shown.page import messages

TARGET = Path(__file__).resolve().parent / "page/messages.d.ts"

_HEAD = """\
// Written by `python tools/page_messages.py` from the models of `cartstiff.shown.page.messages`,
// which read what a page sends: not to be changed by hand.
"""
#: What the store adds to a question.
_ADDED = ("id", "state")


def typescript() -> str:
    """The types of messages, and of what they hold."""
    kinds: tuple[type[BaseModel], ...] = get_args(messages.Message)
    models: dict[str, type[BaseModel]] = {}
    for kind in kinds:
        _collect(kind, models)
    parts = [_interface(name, model, model in kinds) for name, model in models.items()]
    names = " | ".join(kind.__name__ for kind in kinds)
    parts += [
        f"/** The store adds its number, and the state that it shows where none is given. */\n"
        f"type Question =\n  {names};\n",
        "/** What is sent. */\ntype Message = Question & { id: number; state: any };\n",
    ]
    # In a namespace: the document has a type Response of its own.
    return "\n".join([_HEAD, "declare namespace Messages {", *parts, "}", ""])


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


def _interface(name: str, model: type[BaseModel], is_message: bool) -> str:
    lines = [f"interface {name} {{"]
    for key, field in model.model_fields.items():
        if key == "id":
            continue
        may_lack = not field.is_required() or (is_message and key in _ADDED)
        lines.append(f"  {key}{'?' if may_lack else ''}: {_type(field.annotation)};")
    return "\n".join([*lines, "}", ""])


def _type(annotation: Any) -> str:
    """An annotation in TypeScript."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(inner[0])
    if origin is Literal:
        return " | ".join(f'"{word}"' for word in inner)
    if origin is tuple:
        return f"[{', '.join(map(_type, inner))}]"
    if origin is list:
        return f"({_type(inner[0])})[]"
    if origin is dict:
        return f"{{ [key in {_type(inner[0])}]?: {_type(inner[1])} }}"
    if inner:
        return " | ".join(map(_type, inner))
    plain = {int: "number", float: "number", str: "string", bool: "boolean", type(None): "null"}
    return plain[annotation] if annotation in plain else str(annotation.__name__)


if __name__ == "__main__":
    TARGET.write_text(typescript(), encoding="utf-8")
    print(f"Wrote {TARGET}")
