"""JSON Schema of what commands print with ``--json``, from the tables of
`cartstiff.core.described`.
"""

from __future__ import annotations

from cartstiff.core.described import TABLES, Schema, schema
from cartstiff.core.errors import check_name

_DRAFT = {"$schema": "https://json-schema.org/draft/2020-12/schema"}


def json_schema(command: str = "analyse") -> Schema:
    """JSON Schema of what a command prints with ``--json``.

    Parameters
    ----------
    command : {"analyse", "equilibrium", "frames", "modes", "identify", "assemble", "workspace", \
"design", "compare", "analysis", "answer"}
        The command; "analysis" and "answer" are the objects that ``analyse`` has under
        these keys.

    Returns
    -------
    dict
        Draft 2020-12.

    Raises
    ------
    UnknownNameError
        For another command.
    """  # noqa: E501
    check_name("command", command, TABLES)
    return (
        _DRAFT
        | schema(command)
        | {"description": f"Output of cartstiff {command} --json"}
    )
