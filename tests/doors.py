"""Which names of the core are used outside it; imports inside functions count.

Tests of its laws use it by the same doors: `from tests.doors import Chain`.

python tests/doors.py --write     the allow-list again; it may only become shorter
"""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

TABLE = Path(__file__).with_name("doors.yaml")
PACKAGE = Path(__file__).resolve().parents[1] / "src" / "cartstiff"
HEAD = TABLE.read_text(encoding="utf-8").partition("\ncore:")[0] + "\n"


def imported(path: Path) -> Iterator[tuple[str, str]]:
    """Module and name of each import of this package in a file."""
    is_inside = path.is_relative_to(PACKAGE)
    inside = ["cartstiff", *path.relative_to(PACKAGE).with_suffix("").parts] if is_inside else []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            base = inside[: len(inside) - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "*") for alias in node.names)


def uses(core: set[str]) -> dict[str, set[str]]:
    """Names of the core, as `module.name`, by the file outside that imports them."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        if place.parts[0].removesuffix(".py") in core | {"__init__"}:
            continue
        for module, name in imported(path):
            whole = f"{module}.{name}".removeprefix("cartstiff.")
            if module.partition(".")[0] == "cartstiff" and whole.partition(".")[0] in core:
                found[str(place)].add(whole)
    return dict(found)


def table() -> dict[str, Any]:
    """The committed lists."""
    read: dict[str, Any] = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    return read


def doors(known: dict[str, Any]) -> set[str]:
    """Names that any other package may use."""
    listed = {f"{module}.{name}" for module, names in known["doors"].items() for name in names}
    return {door.removeprefix("cartstiff.") for door in listed}


def strangers(known: dict[str, Any]) -> dict[str, list[str]]:
    """Imports that pass no door, by file."""
    found = {file: sorted(names - doors(known)) for file, names in uses(set(known["core"])).items()}
    return {file: names for file, names in found.items() if names}


@cache
def _homes() -> dict[str, str]:
    """Module of each door by its name."""
    return {name: module for module, names in table()["doors"].items() for name in names}


def __getattr__(name: str) -> object:
    """The thing behind a door."""
    if name.startswith("_") or name not in _homes():
        raise AttributeError(name)
    module = f"cartstiff.{_homes()[name]}".replace("cartstiff.cartstiff", "cartstiff")
    home = import_module(module)
    return getattr(home, name) if hasattr(home, name) else import_module(f"{module}.{name}")


if __name__ == "__main__" and sys.argv[1:] == ["--write"]:
    known = table() | {"allowed": strangers(table())}
    text = yaml.safe_dump(known, sort_keys=False, width=100, default_flow_style=None)
    TABLE.write_text(HEAD + text, encoding="utf-8")
