"""What users hold on to: options, names in Python, keys of files and of JSON, codes of notes.

python tests/surface.py --write     the committed table again; what is new shows in its diff
"""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import yaml

import cartstiff
from cartstiff.core.lazily import HOMES
from cartstiff.shown.cli.main import _COMMANDS
from cartstiff.shown.cli.main import command as group

ROOT = Path(__file__).resolve().parents[1]
TABLE = Path(__file__).with_name("surface.yaml")

#: Options that prepare the question, the same on every command, and the form of the output.
_SETUP = """--frame --tcp --payload --gravity --set --xacro-arg --package-path --q --pose --pose-of
 --lengths --springs --stiffness --rest --actuate --load --load-at --load-kind --world --json"""
SETUP = frozenset(_SETUP.split())


def options() -> dict[str, list[str]]:
    """Options of each command, without those that print its help."""
    context = click.Context(group)
    found = {}
    for name in _COMMANDS:
        one = group.get_command(context, name)
        assert one is not None
        shown = [p.opts[-1] for p in one.params if isinstance(p, click.Option)]
        found[name] = sorted(set(shown) - {"--help", "--help-all"})
    return found


def _models() -> Iterator[type]:
    """Pydantic models of mechanism files and studies."""
    from cartstiff.files import leg_schema, platform_schema, schema
    from cartstiff.wings.maps.designs import study

    for module in (schema, platform_schema, leg_schema, study):
        for thing in vars(module).values():
            own = isinstance(thing, type) and thing.__module__ == module.__name__
            if own and hasattr(thing, "model_fields"):
                yield thing


def file_keys() -> list[str]:
    """Keys of files, each once a section that declares it."""
    return sorted(
        f"{model.__name__}.{field.alias or name}"
        for model in _models()
        for name, field in model.model_fields.items()
        if name in inspect.get_annotations(model)
    )


def json_keys() -> dict[str, list[str]]:
    """Keys of the JSON of each command, by dotted name."""
    from cartstiff.core.described import TABLES, kinds_of

    parts = ("analysis.", "answer.")  # tables of their own
    return {
        table: sorted(key for key in kinds_of(table) if not key.startswith(parts))
        for table in TABLES
    }


def names() -> list[str]:
    """Public names, those of `cartstiff` itself without a dot."""
    found = list(cartstiff.__all__)
    for home in HOMES:
        found += [f"{home}.{name}" for name in getattr(cartstiff, home).__all__]
    return sorted(found)


def note_codes() -> list[str]:
    """Codes of notes and of undefined states."""
    path = ROOT / "docs" / "_ext" / "codes.py"
    spec = importlib.util.spec_from_file_location("codes", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["codes"] = module
    spec.loader.exec_module(module)
    return sorted({code.code for code in module.codes()})


#: Everything that the committed table has.
SURFACE: dict[str, Callable[[], Any]] = {
    "options": options,
    "names": names,
    "file keys": file_keys,
    "json keys": json_keys,
    "note codes": note_codes,
}


def pairs(count: int) -> int:
    """Pairs among so many options."""
    return count * (count - 1) // 2


def counted(by_command: dict[str, list[str]]) -> dict[str, int]:
    """Different options, occurrences, and pairs within a command: all, and outside the set-up."""
    lists = list(by_command.values())
    return {
        "different": len({option for some in lists for option in some}),
        "occurrences": sum(map(len, lists)),
        "pairs": sum(pairs(len(some)) for some in lists),
        "pairs outside the set-up": sum(pairs(len(set(some) - SETUP)) for some in lists),
    }


if __name__ == "__main__" and sys.argv[1:] == ["--write"]:
    found = {kind: read() for kind, read in SURFACE.items()}
    text = yaml.safe_dump(found, sort_keys=False, width=100, default_flow_style=None)
    TABLE.write_text(text, encoding="utf-8")
