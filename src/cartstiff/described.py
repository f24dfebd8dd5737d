"""Results for programs, described once: the keys of what each command prints with ``--json``.

The table `output_keys.yaml` holds each key with its kind and its words. The object that is printed
has the keys of its table, so that it cannot differ from the JSON schema
(`cartstiff.report.json_schema`) and the reference page, which are made from the same lines.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cartstiff.arrays import plain

Keys = dict[str, Any]
_CONSTANT = "always "


def read_keys(path: Path) -> dict[str, Keys]:
    """A table of keys."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # seven times as fast
    table: dict[str, Keys] = yaml.load(path.read_text(encoding="utf-8"), Loader=loader)
    return table


@cache
def output_keys() -> dict[str, Keys]:
    """Keys of what each command prints, with their kinds and words."""
    table = read_keys(Path(__file__).with_name("output_keys.yaml"))
    for keys in table.values():
        keys |= {key: table["analyse"][key] for key, kind in keys.items() if kind == "as analyse"}
    return table


def described(command: str, *sources: object) -> dict[str, Any]:
    """The object that a command prints, as plain data in the order of its table.

    Parameters
    ----------
    command : str
        Whose table.
    sources : mapping or object
        Each key is taken from the first of them that has it, as a key or an attribute; keys that
        may be missing are taken from mappings alone.

    Raises
    ------
    LookupError
        For a key that none has.
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
