"""What is refused, and with which words: the tables of `refusals.yaml`."""

import json
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


def cases():
    """Of every section of "commands", row by row: section, words of a command, words of its answer,
    and files by name.

    A row is the end of the section's command, what is said, and what it writes in place of the
    section's files: a text, [old, new] of the text, or keys of the mapping.
    """
    for name, section in _tables()["commands"].items():
        files = section.get("files", {})
        for end, says, *more in section["rows"]:
            own = {n: _changed(files.get(n), now) for n, now in (more[0] if more else {}).items()}
            run = shlex.split(f"{section.get('run', '')} {end}")
            yield name, run, [says] if isinstance(says, str) else says, files | own


def _changed(was, now):
    if isinstance(now, list):
        assert now[0] in was
        return was.replace(*now)
    return (was or {}) | now if isinstance(now, dict) else now


def write(files):
    """Write files by name here: texts, and mappings as JSON, which is YAML."""
    for name, content in files.items():
        text = content if isinstance(content, str) else json.dumps(content)
        Path(name).write_text(text, encoding="utf-8")
