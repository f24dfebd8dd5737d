"""The command line, in this process, as it is typed."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from typing import Any

import pytest

from cartstiff import InputError
from cartstiff.__main__ import main
from tests import surface

#: The group of commands, for those who ask click.
command = surface.group
#: Names of the commands.
COMMANDS = tuple(surface.options())


def words(*parts: object) -> list[str]:
    """The words of a command of which parts are strings, paths, numbers or lists."""
    split = (p.split() if isinstance(p, str) else p if isinstance(p, list) else [p] for p in parts)
    return [str(word) for part in split for word in part]


def outcome(command: str, *more: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error.

    Blanks separate the words of a string; a path is one word, and so are those of a list.
    """
    out, error = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(error), pytest.raises(SystemExit) as exit_:
        main(words(command, *more))
    return int(exit_.value.code or 0), out.getvalue(), error.getvalue()


def run(command: str, *more: object, code: int = 0, said: str = "") -> str:
    """What a command prints that works, or the one line of one that is refused with that code.

    Beside an answer nothing is said on standard error, but a line that holds the words `said`.
    """
    found, out, error = outcome(command, *more)
    assert found == code, error
    if code == 0:
        assert error.count("\n") == bool(said), error
        assert said in error
        return out
    assert out == ""
    assert error.startswith("cartstiff: ")
    assert error.count("\n") == 1
    assert "Traceback" not in error
    return error


def answer(command: str, *more: object, said: str = "") -> Any:
    """The JSON that a command prints, which holds no NaN."""
    return json.loads(run(command, *more, "--json", said=said), parse_constant=_no_number)


def _no_number(name: str) -> None:
    pytest.fail(f"{name} in JSON")


def refuses(words: str, call: Callable[..., object], /, *arguments: Any, **named: Any) -> None:
    """Check that a call is refused with words that match."""
    with pytest.raises(InputError, match=words):
        call(*arguments, **named)
