"""JSON Schema of what the commands print with ``--json``, from the table `output_keys.yaml`.

The table holds each key once, with its kind and its words; the reference page is made from it, and
the analysis adds its own description (`cartstiff.analysis.sections`).
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from cartstiff.analysis.sections import Schema, object_schema, read_keys
from cartstiff.analysis.sections import schema as schema_of_analysis
from cartstiff.errors import UnknownNameError

_DRAFT = {"$schema": "https://json-schema.org/draft/2020-12/schema"}


def json_schema(command: str = "analyse") -> Schema:
    """JSON Schema of what a command prints with ``--json``.

    Parameters
    ----------
    command : {"analyse", "equilibrium", "frames", "modes", "identify", "assemble", "workspace", \
"design", "analysis"}
        The command; "analysis" is the object that ``analyse`` adds under this key.

    Returns
    -------
    dict
        Draft 2020-12.

    Raises
    ------
    UnknownNameError
        For another command.
    """
    if command == "analysis":
        return _DRAFT | schema_of_analysis()
    if command not in _table():
        raise UnknownNameError("command", command, [*_table(), "analysis"])
    keys = _table()[command]
    if command == "equilibrium":
        keys = _table()["analyse"] | keys
    schema = object_schema(keys, {"type": "object"}) | {
        "description": f"Output of cartstiff {command} --json"
    }
    if command in ("analyse", "equilibrium"):
        words = {"description": "unless --analysis none"}
        schema["properties"]["analysis"] = schema_of_analysis() | words
    return _DRAFT | schema


@cache
def _table() -> dict[str, Schema]:
    table = read_keys(Path(__file__).with_name("output_keys.yaml"))
    for keys in table.values():
        keys |= {key: table["analyse"][key] for key, kind in keys.items() if kind == "as analyse"}
    return table
