"""The codes of notes and states that the code can produce, read from its syntax trees."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[2] / "src" / "cartstiff"
# Calls whose first argument is a code and whose second is the message.
_BY_POSITION = {"Note"}


@dataclass(frozen=True)
class Code:
    """A code, the words that go with it ("..." for what is filled in), and its module."""

    code: str
    message: str
    module: str


def _strings(node: ast.expr, tree: ast.Module) -> Iterator[str]:
    """String constants an expression can become; names are looked up in their module."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.IfExp):
        yield from _strings(node.body, tree)
        yield from _strings(node.orelse, tree)
    elif isinstance(node, ast.Name):
        for other in ast.walk(tree):
            targets = other.targets if isinstance(other, ast.Assign) else []
            named = any(isinstance(t, ast.Name) and t.id == node.id for t in targets)
            if named and not isinstance(other.value, ast.Name):
                yield from _strings(other.value, tree)


def _words(node: ast.expr | None) -> str:
    """Text of a message; what is computed is shown as "..."."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(v.value if isinstance(v, ast.Constant) else "..." for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _words(node.left) + _words(node.right)
    if isinstance(node, ast.IfExp):
        return f"{_words(node.body)}; or: {_words(node.orelse)}"
    return "..."


def codes(package: str = "") -> list[Code]:
    """Every code of a package (all of them by default), in the order of the modules."""
    found = []
    for path in sorted((SOURCES / package).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        module = ".".join(path.relative_to(SOURCES).with_suffix("").parts)
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            places = [
                (k.value, node.args[0] if node.args else None)
                for k in node.keywords
                if k.arg == "code"
            ]
            if name in _BY_POSITION and len(node.args) > 1:
                places.append((node.args[0], node.args[1]))
            for place, message in places:
                found += [Code(code, _words(message), module) for code in _strings(place, tree)]
    return found
