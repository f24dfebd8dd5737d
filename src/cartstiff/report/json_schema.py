"""JSON Schema of what the commands print with ``--json``, from the table of `cartstiff.described`.

The analysis adds its own description (`cartstiff.analysis.sections`).
"""

from __future__ import annotations

from cartstiff.analysis.sections import Schema, object_schema
from cartstiff.analysis.sections import schema as schema_of_analysis
from cartstiff.described import output_keys
from cartstiff.errors import UnknownNameError

_DRAFT = {"$schema": "https://json-schema.org/draft/2020-12/schema"}


def json_schema(command: str = "analyse") -> Schema:
    """JSON Schema of what a command prints with ``--json``.

    Parameters
    ----------
    command : {"analyse", "equilibrium", "frames", "modes", "identify", "assemble", "workspace", \
"design", "compare", "analysis"}
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
    table = output_keys()
    if command not in table:
        raise UnknownNameError("command", command, [*table, "analysis"])
    keys = table[command]
    if command == "equilibrium":
        keys = table["analyse"] | keys
    schema = object_schema(keys, {"type": "object"}) | {
        "description": f"Output of cartstiff {command} --json"
    }
    if command in ("analyse", "equilibrium"):
        words = {"description": "unless --analysis none"}
        schema["properties"]["analysis"] = schema_of_analysis() | words
    return _DRAFT | schema
