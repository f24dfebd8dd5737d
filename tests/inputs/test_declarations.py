"""Commands made from signatures: each option is declared once, has its words, and is given once."""

from __future__ import annotations

import ast
import inspect
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import click
import pytest
from click.testing import CliRunner
from tests.inner import (
    _COMMANDS,
    Case,
    Command,
    Overrides,
    Pairs,
    Point,
    ViewState,
    analyse,
    declare,
    declared,
    map_job,
    options,
    path,
    reach,
)
from tests.inner import cli_identify as identify
from tests.inner import cli_modes as modes
from tests.inner import command as group
from tests.inner import map as maps
from tests.inner import options_Number as Number

import cartstiff
from cartstiff import InputError


@pytest.fixture(params=list(_COMMANDS))
def command(request: pytest.FixtureRequest) -> Command:
    found = group.get_command(click.Context(group), request.param)
    assert isinstance(found, Command)
    return found


def test_every_option_has_words(command: Command) -> None:
    names = [p.name for p in command.params]
    assert len(set(names)) == len(names)
    for option in command.params:
        if isinstance(option, click.Option) and not option.hidden:
            assert (option.help or "").endswith("."), option.opts
            assert "None" not in option.make_metavar(click.Context(command)), option.opts


def test_conditions_name_options_that_exist(command: Command) -> None:
    names = {p.name for p in command.params}
    told = [*command._needs, *command._rare, *(n for ns in command._needs.values() for n in ns)]
    assert {*told, *(name for text in command._exclusive for name in text.split())} <= names


def test_every_option_is_read(command: Command) -> None:
    """An option that no line of the command line's code asks for would be without effect."""
    read = set[str]()
    for file in Path(declare.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute | ast.Name) and isinstance(node.ctx, ast.Load):
                read.add(node.attr if isinstance(node, ast.Attribute) else node.id)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                read |= {node.value} if node.value.isidentifier() else set()
    passed = {f.name for kind in (path.Search, reach.Search, reach.Modes) for f in fields(kind)}
    exposed = {str(p.name) for p in command.params if p.expose_value}
    assert exposed <= read | passed  # as `asdict` hands them on


def test_an_option_without_its_value_is_refused(command: Command) -> None:
    for option in command.params:
        if isinstance(option, click.Option) and not option.is_flag:
            needed = [p for p in command.params if isinstance(p, click.Argument) and p.required]
            words = [*["x"] * len(needed), option.opts[-1]]
            with pytest.raises(click.BadOptionUsage, match="requires an argument"):
                command.main(words, standalone_mode=False)


def test_help_is_a_line_for_each_option(command: Command) -> None:
    """The help has what is wanted often, a line each; --help-all has every option in full."""
    brief = CliRunner().invoke(command, ["--help"]).output
    whole = CliRunner().invoke(command, ["--help-all"]).output
    options = [p for p in command.params if isinstance(p, click.Option) and not p.hidden]
    for option in options:
        assert option.opts[-1] in whole
        assert "".join((option.help or "").split()) in "".join(whole.split())
        is_shown = f"\n  {', '.join(option.opts)} " in brief.replace(" / --no", "  / --no")
        assert is_shown is (option.name not in command._rare), option.opts
    lines = [line for line in brief.split("\n") if line.startswith("  -")]
    assert len(lines) == len([o for o in options if o.name not in command._rare]) + 1  # and --help
    assert len(lines) <= 25  # a screen
    if command.name == "analyse":
        titles = [line[:-1] for line in brief.split("\n") if line.endswith(":") and line[0] != " "]
        words = ["Posture and springs", "Tool and weight", "Load", "Reading", "Output", "Options"]
        assert titles == words


def test_what_holds_of_an_object_holds_on_every_command_that_takes_it() -> None:
    """A load that the springs balance excludes their rest; a path's --world needs no --load."""
    needed = {"map": "m.zarr", "export": "m.html", "report": "r.html"}
    for name in ("analyse", "map", "modes", "view", "export", "report"):
        words = f"{name} ur5 --load 0,0,0,0,0,1 --rest 0"
        words += f" -o {needed[name]}" if name in needed else ""
        with pytest.raises(InputError, match="give --load or --rest, not both"):
            group.main(words.split(), standalone_mode=False)
    for name in ("map", "modes", "path"):
        found = group.get_command(click.Context(group), name)
        assert isinstance(found, Command)
        assert ("world" in found._needs) is (name != "path")


def test_each_command_takes_the_whole_set_up_or_says_why_not() -> None:
    """One object, with the same options; an option that has no meaning is refused with a reason."""
    of_setup = {f.name for f in fields(options.Setup)} - {"mechanism", "units"}
    taking = []
    for name in group.list_commands(click.Context(group)):
        found = group.get_command(click.Context(group), name)
        if not isinstance(found, Command) or not any(
            issubclass(kind, options.Setup) for kind, _ in found._objects.values()
        ):
            continue
        taking.append(name)
        there = {str(p.name) for p in found.params}
        spelled = {word[2:].replace("-", "_") for word in found._meaningless}
        spelled |= {"parameters" for word in spelled if word == "set"}
        spelled |= {"xacro_args" for word in spelled if word == "xacro_arg"}
        assert of_setup <= there | spelled, (name, of_setup - there - spelled)
        needed = [p for p in found.params if isinstance(p, click.Argument) and p.required]
        for option in sorted({o for o in found._meaningless if o[2:].replace("-", "_") in spelled}):
            if any(option in p.opts for p in found.params):
                continue
            words = [name, *["x"] * len(needed), option, "1"]
            with pytest.raises(InputError, match=f"{option}: has no meaning for"):
                group.main(words, standalone_mode=False)
    assert len(taking) >= 10


def test_a_load_is_stated_in_the_same_words_with_the_same_defaults() -> None:
    """On commands, in Python, in a study and in the page's messages."""
    defaults: list[dict[str, Any]] = []
    for function in (
        cartstiff.analyse,
        cartstiff.equilibrium,
        cartstiff.load_curve,
        cartstiff.compensate,
        cartstiff.modes,
        cartstiff.workspace,
        cartstiff.assemble,
        map_job,
        cartstiff.analyse_many,
    ):
        parameters = inspect.signature(inspect.unwrap(function)).parameters
        names = ("load_kind", "load_at", "load_axes")
        defaults.append({name: parameters[name].default for name in names})
    for model in (Case, ViewState):
        names = ("load_kind", "load_at", "load_axes")
        defaults.append({name: model.model_fields[name].default for name in names})
    keywords = options.Setup("ur5").keywords
    defaults.append({name: keywords[name] for name in ("load_kind", "load_at", "load_axes")})
    for one in defaults:
        assert one["load_kind"] == "dead"
        assert one["load_axes"] == "body"
        assert one["load_at"] is None or not any(one["load_at"])


def test_a_value_is_given_once(command: Command) -> None:
    """A second value is never dropped silently."""
    for option in command.params:
        if isinstance(option, click.Option) and not (
            option.is_flag or option.multiple or option.hidden
        ):
            word = max(option.opts, key=len)
            with pytest.raises(click.BadParameter, match="given more than once"):
                command.main([word, "1", word, "1"], standalone_mode=False)


@dataclass(frozen=True)
class Thing:
    """A thing.

    Parameters
    ----------
    name
        Which one.
    size
        How large.
    colour
        Not for everybody.
    """

    name: str
    size: Annotated[float | None, Number("MM")] = None
    colour: Literal["red", "blue"] = "red"


SEEN: list[object] = []


@declared("make", needs={"at": "size parts"}, exclusive=("size parts",))
def make(
    thing: Annotated[Thing, Overrides("colour", size="How long.")],
    files: tuple[Path, ...] = (),
    *,
    to: Annotated[str, "--for"],
    at: Point = None,
    parts: Annotated[dict[str, float] | None, Pairs("NAME=VALUE"), "--part"] = None,
    count: Annotated[int, click.IntRange(1, 9)] = 3,
    loud: bool = False,
    bar: bool | None = None,
) -> None:
    """Make a thing.

    Parameters
    ----------
    thing
        The thing.
    files : [FILE]...
        Other files.
    to : WHOM
        For whom.
    at
        Where.
    parts
        Parts.
    count
        How many.
    loud
        With noise.
    bar
        Progress.

    Examples
    --------
    make it
    """
    SEEN[:] = [thing, files, to, at, parts, count, loud, bar]


def run(*words: str) -> list[object]:
    SEEN.clear()
    make.main(list(words), standalone_mode=False)
    return SEEN


def test_values_reach_the_function() -> None:
    assert run("it", "--for", "me") == [Thing("it"), (), "me", None, None, 3, False, None]
    words = "it a b --for me --part x=1,y=2 --part z=3 --at 1,2,3 --count 4 --loud --no-bar"
    expected = [Thing("it"), (Path("a"), Path("b")), "me", [1.0, 2.0, 3.0]]
    assert run(*words.split()) == [*expected, {"x": 1.0, "y": 2.0, "z": 3.0}, 4, True, False]
    assert run("it", "--for", "me", "--size", "2.5")[0] == Thing("it", 2.5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("it --for me --at 1,2,3", "--at: is for --size or --part"),
        ("it --for me --size 1 --part x=1", "give --size or --part, not both"),
        ("it --for me --part x=1 --part x=2", "--part: given twice; expected each once, got 'x'"),
        ("it --for me --size 1 --size 2", "given more than once"),
        ("it --for me --colour red", "No such option '--colour'"),
        ("it", "Missing option '--for'"),
        ("--for me", "Missing argument 'NAME'"),
        ("it --for me --count 10", "10 is not in the range 1<=x<=9"),
    ],
)
def test_what_is_refused(words: str, said: str) -> None:
    with pytest.raises((InputError, click.UsageError)) as caught:
        run(*words.split())
    error = caught.value
    assert said in (error.format_message() if isinstance(error, click.UsageError) else str(error))


def test_help_is_the_docstring() -> None:
    text = CliRunner().invoke(make, ["--help"]).output
    assert "A thing:\n  --size MM          How long.\n" in text
    for words in ("Make a thing.", "--for WHOM", "[FILE]...", "[default: 3;", "--bar / --no-bar"):
        assert words in text
    assert "Examples:\n    make it" in text
    assert "colour" not in text


#: Classes of options with parameters of the API, and the options that have words of their own.
OF_API = {
    options.Load: "world",
    options.Posture: "mechanism q pose pose_of lengths stiffness rest actuate",
    options.Tool: "",
    options.File: "",
    options.Reading: "",
    options.Vibration: "",
    options.Rayleigh: "rayleigh",
    options.Parameters: "sensitivities",
    analyse.Analysis: "level report_at target allowed_displacement",
    maps.Where: "grid random cartesian trajectory",
    maps.Held: "quantities",
    modes.Controller: "impedance order",
    modes.Response: "response kind direction",
    identify.Table: "sd",
    identify.Fit: "unknown",
    identify.Plan: "plan q load",
    reach.Modes: "",
    reach.Search: "",
    path.Search: "criterion",
}


@pytest.mark.parametrize("kind", OF_API)
def test_what_the_api_says_of_a_parameter_is_the_help_of_its_option(kind) -> None:
    known = declare.Documented.of(kind).parameters
    assert {f.name for f in fields(kind)} <= known.keys()
    of_api = {
        words
        for one in kind.__mro__
        for api in vars(one).get("API", ())
        for words in declare._of_api(api).values()
    }
    own = {f.name for f in fields(kind) if known[f.name][1] not in of_api}
    assert own == set(OF_API[kind].split())


def test_an_option_that_needs_another_names_it_in_its_help() -> None:
    text = CliRunner().invoke(maps.command, ["--help-all"]).output
    assert "With --cartesian: largest number of branches" in text
