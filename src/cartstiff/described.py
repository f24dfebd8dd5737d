"""Keys of the JSON output of each command.

The table `output_keys.yaml` has each key with its kind and its description. The printed object has
the keys of this table, as have the JSON schema (`cartstiff.report.json_schema`) and the reference
page.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cartstiff.arrays import plain

Keys = dict[str, Any]
_CONSTANT = "always "


def read_keys(path: Path) -> dict[str, Keys]:
    """Read a table of keys."""
    import yaml

    loader = getattr(
        yaml, "CSafeLoader", yaml.SafeLoader
    )  # the former is seven times as fast
    table: dict[str, Keys] = yaml.load(path.read_text(encoding="utf-8"), Loader=loader)
    return table


@cache
def output_keys() -> dict[str, Keys]:
    """Keys of each command's output, with their kinds and descriptions."""
    table = read_keys(Path(__file__).with_name("output_keys.yaml"))
    for keys in table.values():
        keys |= {
            key: table["analyse"][key]
            for key, kind in keys.items()
            if kind == "as analyse"
        }
    return table


def kinds_of(command: str) -> dict[str, tuple[str, str]]:
    """Kind and description of a command's keys, by dotted name; of lists by those of an entry."""

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

    table = output_keys()
    return dict(
        walk(table[command] | (table["analyse"] if command == "equilibrium" else {}), "")
    )


def described(command: str, *sources: object) -> dict[str, Any]:
    """The printed object of a command, as plain data in the order of its table.

    Parameters
    ----------
    command : str
        Name of the command.
    sources : mapping or object
        Each key is read from the first source that has it, as a key or an attribute; optional keys
        are read from mappings only.

    Raises
    ------
    LookupError
        For a required key that no source has.
    """
    data: dict[str, Any] = {}
    for entry, kind in output_keys()[command].items():
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
