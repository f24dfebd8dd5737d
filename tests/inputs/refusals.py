"""What is refused, and with which words: the tables of `refusals.yaml`."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import yaml


@cache
def _tables() -> dict[str, Any]:
    text = Path(__file__).with_name("refusals.yaml").read_text(encoding="utf-8")
    tables: dict[str, Any] = yaml.safe_load(text)
    return tables


def commands(section: str) -> dict[str, tuple[list[str], tuple[str, ...]]]:
    """By name: the words of a command, and the words of its answer."""
    table = _tables()[section]
    return {n: (shlex.split(case["run"]), tuple(case["says"])) for n, case in table.items()}


def texts(
    section: str, changed: Callable[..., str]
) -> dict[str, tuple[str | bytes, tuple[str, ...]]]:
    """By name: a whole text, or one by a change of a good one; and the words of the answer."""
    return {
        name: (
            changed(*case["change"]) if "change" in case else case["text"],
            tuple(case["says"]),
        )
        for name, case in _tables()[section].items()
    }


def rows(section: str) -> list[tuple[list[str], Any]]:
    """The words of each command, and what its answer says."""
    return [(shlex.split(run), says) for run, says in _tables()[section]]
