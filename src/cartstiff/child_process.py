"""What a worker answers that reads a stranger's file in a process of its own.

A worker is a script of the standard library and the one package that reads such files. It limits
its own time and memory and prints one JSON object; under "error" stands what is wrong.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from cartstiff.errors import InputError

# Seconds until a process that does not even use the processor is given up.
_LONGEST = 120.0


def answer_of(
    worker: str,
    arguments: Sequence[str],
    where: str,
    who: str,
    more: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The JSON object that a worker prints.

    Parameters
    ----------
    worker : str
        Its file.
    arguments : sequence of str
        What it is told.
    where, who : str
        Where messages say that something is wrong, and who found it ("MuJoCo").
    more : mapping of str to str, optional
        Further variables of its environment.

    Raises
    ------
    InputError
        If it does not come to an end, or breaks down.
    """
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    environment |= {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p), **(more or {})}
    command = [sys.executable, "-P", worker, *arguments]
    try:
        # In the root folder nobody finds a place for log files.
        done = subprocess.run(
            command,
            env=environment,
            cwd="/",
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_LONGEST,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{who} does not come to an end with it", where=where) from None
    except (OSError, ValueError) as error:
        got = getattr(error, "strerror", None) or str(error)
        raise InputError("no process could be started to read it", where=where, got=got) from None
    try:
        data: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        raise InputError(f"{who} broke down on it", where=where, got=_end_of(done)) from None
    return data


def _end_of(done: subprocess.CompletedProcess[bytes]) -> str:
    if done.returncode == -signal.SIGXCPU:
        return "it took too long"
    if done.returncode < 0:
        return f"signal {signal.Signals(-done.returncode).name}"
    lines = done.stderr.decode("utf-8", "replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), f"exit {done.returncode}")
