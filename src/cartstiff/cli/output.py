"""What commands write: files by their ending, and JSON that holds numbers only."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from cartstiff.errors import InputError, one_line, printable

__all__ = ["json_text", "output_file", "print_json", "say"]


def output_file(text: str, endings: tuple[str, ...], option: str) -> Path:
    """Path of a file to be written, with an ending that says what is written."""
    path = Path(text)
    if path.suffix not in endings:
        raise InputError("unknown file ending", where=option, expected=" or ".join(endings),
                         got=path.name)  # fmt: skip
    return path


def json_text(data: Mapping[str, Any], mechanism: str) -> str:
    """One JSON object; refused where a number has left the range of double precision."""
    try:
        return json.dumps(data, allow_nan=False).replace("\x7f", "\\u007f")
    except ValueError:
        raise InputError(
            "the result leaves the range of double precision", where=one_line(mechanism),
            expected="numbers of moderate size",
        ) from None  # fmt: skip


def print_json(data: Mapping[str, Any], mechanism: str) -> None:
    """`json_text` on standard output."""
    say(json_text(data, mechanism))


def say(text: str = "", *, error: bool = False) -> None:
    """Text on standard output, or standard error; every command writes through here."""
    click.echo(printable(text), err=error)
