"""Every option is spelled in a worked line of the documentation, and in a test.

A worked line is a line ``$ cartstiff ...`` of a console block: `test_docs` runs it.
"""

import re
import shlex
from functools import cache

import click
import pytest
from tests.docs.blocks import ROOT, blocks_of, pages
from tests.support.commands import COMMANDS, command

#: Options that no console block can hold, each with the reason and the test that holds it.
WITHOUT_A_WORKED_LINE = {
    "--dask": ("needs a running scheduler", "tests/maps/test_cluster.py"),
    "--host": ("a server that runs until Ctrl-C", "tests/inputs/refusals.yaml"),
    "--port": ("a server that runs until Ctrl-C", "tests/inputs/refusals.yaml"),
    "--no-open": ("a server that runs until Ctrl-C", "tests/view/test_commands.py"),
}
#: click's own, the same everywhere and without an effect on an answer.
_ABOUT_HELP = {"--help", "--help-all", "--version"}
_EXAMPLE = re.compile(r"(?<![\w-])--?[a-z][\w-]*")


@cache
def options():
    """Of each option all spellings, and the commands that have it."""
    found = {}
    for name in COMMANDS:
        for one in command.get_command(None, name).params:
            if isinstance(one, click.Option) and one.opts[-1] not in _ABOUT_HELP:
                spellings, commands = found.setdefault(one.opts[-1], (set(), set()))
                spellings |= {*one.opts, *one.secondary_opts}
                commands.add(name)
    return found


@cache
def worked():
    """The words that the worked lines of each command have."""
    words = {name: set() for name in COMMANDS}
    for page in pages():
        for block in blocks_of(page.read_text("utf-8")):
            if block.language == "console":
                for line in re.findall(r"^\$ cartstiff (.*)", block.text, re.M):
                    name, *rest = shlex.split(line)
                    words[name].update(rest)
    return words


@cache
def _test_files():
    """Text of the tests but this one, which names options without testing them."""
    files = [p for p in (ROOT / "tests").rglob("*") if p.suffix in (".py", ".yaml", ".js")]
    return {p: p.read_text("utf-8") for p in files if p.name != "test_worked_lines.py"}


@cache
def _spelled_in_tests():
    return {word for text in _test_files().values() for word in _EXAMPLE.findall(text)}


def test_options_are_spelled_in_worked_lines():
    lines = worked()
    missing = {
        option: sorted(commands)
        for option, (spellings, commands) in options().items()
        if not any(spellings & lines[name] for name in commands)
    }
    unexplained = set(missing) - set(WITHOUT_A_WORKED_LINE)
    assert not unexplained, (
        f"no `$ cartstiff ...` line of docs/ or README spells {sorted(unexplained)}: "
        "add one to the how-to page where the option belongs"
    )
    assert set(WITHOUT_A_WORKED_LINE) <= set(missing), "an exception that is none any more"


def test_options_are_spelled_in_tests():
    missing = {
        option
        for option, (spellings, _) in options().items()
        if not spellings & _spelled_in_tests()
    }
    assert not missing, f"no file in tests/ spells {sorted(missing)}"


@pytest.mark.parametrize("option", WITHOUT_A_WORKED_LINE)
def test_exceptions_have_their_test(option):
    _, file = WITHOUT_A_WORKED_LINE[option]
    assert option in _EXAMPLE.findall(_test_files()[ROOT / file])


def test_worked_lines_spell_options_that_exist():
    """Also lines whose output is cut by an ellipsis, which would hide a refusal."""
    known = {name: {"--help", "--help-all"} for name in COMMANDS}
    for spellings, commands in options().values():
        for name in commands:
            known[name] |= spellings
    for name, words in worked().items():
        spelled = {w.partition("=")[0] for w in words if re.match(r"--?[a-z]", w)}
        assert spelled <= known[name], f"{name}: {sorted(spelled - known[name])}"
