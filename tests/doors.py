"""Which names of the core are used outside it; imports inside functions count.

Tests of its laws use it by the same doors: `from tests.doors import Chain`.

python tests/doors.py     what is used and not listed, and listed and not used outside
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

TABLE = Path(__file__).with_name("doors.yaml")
PACKAGE = Path(__file__).resolve().parents[1] / "src" / "cartstiff"


@cache
def tree(path: Path) -> ast.Module:
    """A file of the package as it is parsed, once for all tests that read it."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported(path: Path) -> tuple[tuple[str, str], ...]:
    """Module and name of each import of this package in a file."""
    return tuple(_imported(path))


def _imported(path: Path) -> Iterator[tuple[str, str]]:
    is_inside = path.is_relative_to(PACKAGE)
    inside = ["cartstiff", *path.relative_to(PACKAGE).with_suffix("").parts] if is_inside else []
    parsed = tree(path) if is_inside else ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(parsed):
        if isinstance(node, ast.ImportFrom):
            base = inside[: len(inside) - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "*") for alias in node.names)


def uses(core: str = "core") -> dict[str, set[str]]:
    """Names of the core, as `module.name`, by the file outside that imports them."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        if len(place.parts) == 1 or place.parts[0] == core:
            continue
        for module, name in imported(path):
            whole = f"{module}.{name}".removeprefix("cartstiff.")
            if module.partition(".")[0] == "cartstiff" and whole.partition(".")[0] == core:
                found[str(place)].add(whole)
    return dict(found)


def table() -> dict[str, list[str]]:
    """The committed list: names by module."""
    read: dict[str, Any] = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    return dict(read["doors"])


def doors() -> set[str]:
    """Names that any other room may use, as `module.name`."""
    return {f"{module}.{name}" for module, names in table().items() for name in names}


def strangers() -> dict[str, list[str]]:
    """Imports that pass no door, by file."""
    listed = doors()
    found = {file: sorted(names - listed) for file, names in uses().items()}
    return {file: names for file, names in found.items() if names}


@cache
def _homes() -> dict[str, str]:
    """Module of each door by its name."""
    return {name: module for module, names in table().items() for name in names}


def __getattr__(name: str) -> object:
    """The thing behind a door."""
    if name.startswith("_") or name not in _homes():
        raise AttributeError(name)
    module = f"cartstiff.{_homes()[name]}"
    home = import_module(module)
    return getattr(home, name) if hasattr(home, name) else import_module(f"{module}.{name}")


if __name__ == "__main__":
    for file, names in strangers().items():
        print(f"{file}: {', '.join(names)} is no door")
    used = set().union(*uses().values())
    print("used by tests alone:", *sorted(doors() - used))
