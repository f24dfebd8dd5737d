"""What is refused, and with which words: the tables of `refusals.yaml`."""

import shlex
from functools import cache
from pathlib import Path

import yaml


@cache
def _tables():
    text = Path(__file__).with_name("refusals.yaml").read_text(encoding="utf-8")
    tables = yaml.safe_load(text)
    return tables


def commands(section):
    """By name: the words of a command, and the words of its answer."""
    table = _tables()[section]
    return {n: (shlex.split(case["run"]), tuple(case["says"])) for n, case in table.items()}


def texts(section, changed):
    """By name: a whole text, or one by a change of a good one; and the words of the answer."""
    return {
        name: (
            changed(*case["change"]) if "change" in case else case["text"],
            tuple(case["says"]),
        )
        for name, case in _tables()[section].items()
    }


def rows(section):
    """The words of each command, and what its answer says."""
    return [(shlex.split(run), says) for run, says in _tables()[section]]
