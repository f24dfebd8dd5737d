"""Output of commands: text, and JSON that holds numbers only."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from operator import methodcaller
from pathlib import Path
from typing import Any

import click

from cartstiff.core.errors import InputError, one_line, printable


def json_text(data: Mapping[str, Any], mechanism: str) -> str:
    """Return one JSON object, with results as plain data; refuse numbers outside the
    range of double precision.
    """
    try:
        text = json.dumps(data, default=methodcaller("to_dict"), allow_nan=False)
        return text.replace("\x7f", "\\u007f")
    except ValueError:
        raise InputError(
            "the result leaves the range of double precision",
            where=one_line(mechanism),
            expected="numbers of moderate size",
        ) from None


_WAITING = "cartstiff.diagnostics"


def say(text: str = "", *, error: bool = False) -> None:
    """Print text on standard output or standard error.

    All commands print by this function.
    """
    context = click.get_current_context(silent=True)
    if context is not None and not error:
        for remark in context.meta.pop(_WAITING, ()):
            click.echo(remark, err=True)
    click.echo(printable(text), err=error)


class Progress:
    """A progress bar on standard error, by default on a terminal.

    Called with (done, total).
    """

    def __init__(self, label: str, asked: bool | None = None) -> None:
        self._label = label
        self._bar: Any = None
        self._shown = sys.stderr.isatty() if asked is None else asked
        self._stack, self._begun = ExitStack(), 0

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def __call__(self, done: int, total: int) -> None:
        """Show the progress."""
        if not self._shown:
            return
        if self._bar is None:
            self._bar = self._stack.enter_context(
                click.progressbar(length=total, label=self._label, file=sys.stderr)
            )
        self._bar.update(done - self._begun)
        self._begun = done


def say_unused(path: Path, names: Sequence[str], more: str = "") -> None:
    """Report unused columns of a table on standard error, followed by `more`.

    It is printed just before the answer: the table may still be refused, and a refusal is
    one line.
    """
    if names:
        words = one_line(", ".join(names), 300)
        remark = printable(
            f"cartstiff: {one_line(str(path))}: not needed here: {words}{more}"
        )
        click.get_current_context().meta.setdefault(_WAITING, []).append(remark)
