"""Commands from declarations: a function's signature, its dataclasses, and their docstrings.

A parameter of the function is an option (or, where it stands before ``*``, an argument of the
command line): its annotation says what text becomes a value, its default is that of the option,
and its numpydoc paragraph is the help, with the word for the value behind the colon. A parameter
whose type is a dataclass stands for the fields of that class: one section of the help, the same on
every command. Metadata in ``Annotated`` are a `click.ParamType`, another spelling ("--range"), or
`Overrides`.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import click
from click.core import ParameterSource

from cartstiff.errors import InputError


class Factors(NamedTuple):
    """What lengths and angles are multiplied by, to be in the units that are computed in."""

    length: float = 1.0
    angle: float = 1.0


class OptionType(click.ParamType):  # type: ignore[type-arg]
    """Text that becomes a value; `name` stands for it in --help."""

    #: Whether the option may be given several times: mappings, put together.
    merges = False

    def __init__(self, shape: str) -> None:
        self.name = shape

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:  # noqa: ARG002
        """Words in --help."""
        return self.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ARG002
        """The value; what click hands over twice stays as it is."""
        where = self.name if param is None else param.opts[-1]
        return self.parsed(value, where) if isinstance(value, str) else value

    def parsed(self, text: str, where: str) -> Any:
        """The value of a text given to the option `where`."""
        raise NotImplementedError

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:  # noqa: ARG002
        """The value in other units."""
        return value


class Overrides:
    """Which fields of a dataclass a command does not take, and its own words for others."""

    def __init__(self, without: str = "", **words: str) -> None:
        self.without, self.words = without.split(), words


def add_once(values: dict[str, Any], name: str, value: object, where: str) -> None:
    """Add a value by its name, or refuse a name that is there already."""
    if name in values:
        raise InputError("given twice", where=where, expected="each once", got=repr(name))
    values[name] = value


class _Option(click.Option):
    """An option in its section of the help; one value must not be given twice."""

    section = "Options"

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        """Collect the values, so that a second one is noticed."""
        several, self.multiple = self.multiple, self.multiple or not self.is_flag
        super().add_to_parser(parser, ctx)
        self.multiple = several

    def consume_value(self, ctx: click.Context, opts: Mapping[str, Any]) -> Any:
        """The one value."""
        values = opts.get(self.name or "")
        if isinstance(values, list) and not self.multiple:
            if len(values) > 1:
                raise click.BadParameter("given more than once", ctx=ctx, param=self)
            opts = {**opts, str(self.name): values[0]}
        return super().consume_value(ctx, opts)


def _merged(_: click.Context, parameter: click.Parameter, values: Any) -> dict[str, Any] | None:
    merged: dict[str, Any] = {}
    for name, value in (item for mapping in values for item in mapping.items()):
        add_once(merged, name, value, parameter.opts[-1])
    return merged or None


# What stands in the help for a number whose parameter says nothing else.
_NUMBERS = {int: "N", float: "NUMBER"}


class Documented(NamedTuple):
    """A docstring: what stands before its sections, parameters (value, words), and examples."""

    about: str
    parameters: dict[str, tuple[str, str]]
    examples: str

    @classmethod
    def of(cls, thing: object) -> Documented:
        """The numpydoc docstring of a function, or of a class and those that it comes from."""
        about, *parts = re.split(r"^(\w+)\n-{3,}\n", inspect.getdoc(thing) or "", flags=re.M)
        sections = dict(zip(parts[::2], parts[1::2], strict=True))
        bases = getattr(thing, "__bases__", ())
        known = {n: w for base in bases for n, w in cls.of(base).parameters.items()}
        for entry in re.split(r"\n(?=\S)", sections.get("Parameters", "").strip()):
            head, _, words = entry.partition("\n")
            name, _, shape = head.partition(" : ")
            known[name.strip()] = shape, " ".join(words.split())
        return cls(about.strip(), known, sections.get("Examples", "").strip())


def _split(hint: Any) -> tuple[Any, list[Any]]:
    """A type and its metadata."""
    hint, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    return hint, marks


def _parameter(
    name: str, hint: Any, default: Any, words: tuple[str, str], section: str | None
) -> click.Parameter:
    """An argument (without a section), or an option, of one value."""
    hint, marks = _split(hint)
    kind = next((mark for mark in marks if isinstance(mark, click.ParamType)), None)
    shape, text = words
    if get_origin(hint) in (Union, UnionType):
        hint = next(part for part in get_args(hint) if part is not NoneType)
    several = kind is None and get_origin(hint) is tuple
    if several:
        hint = get_args(hint)[0]
    if kind is None and get_origin(hint) is Literal:
        kind = click.Choice(get_args(hint))
    if hint is Path and kind is None:
        kind = click.Path(path_type=Path)
    is_needed = default in (MISSING, inspect.Parameter.empty)
    if section is None:
        count = -1 if several else 1
        return click.Argument(
            [name], type=kind or hint, nargs=count, required=is_needed, metavar=shape or None
        )
    spelling = next((m for m in marks if isinstance(m, str)), f"--{name.replace('_', '-')}")
    is_flag = hint is bool and kind is None
    if is_flag and default is None:
        spelling = f"{spelling}/--no-{spelling[2:]}"
    merges = isinstance(kind, OptionType) and kind.merges
    given: dict[str, Any] = {} if is_needed or merges or several else {"default": default}
    option = _Option(
        [*(["-o"] if name == "output" else []), spelling, name],
        type=None if is_flag else kind or hint,
        is_flag=is_flag,
        multiple=several or merges,
        callback=_merged if merges else None,
        required=is_needed,
        show_default=default not in (None, False, 0) and "default" in given,
        metavar=shape or (None if isinstance(kind, OptionType) else _NUMBERS.get(hint)),
        hidden=shape == "hidden",
        help=text,
        **given,
    )
    option.section = section
    return option


class Command(click.Command):
    """A command whose options are declared by the signature of a function.

    Parameters
    ----------
    name : str
        Its name.
    function : callable
        What it does.
    needs : mapping of str to str
        Options (separated by spaces) of which one must be given, by those that mean something only
        beside them.
    exclusive : tuple of str
        Options of which at most one may be given.
    json_of_file : bool
        Whether lengths of the JSON are in the unit of the mechanism's file.
    more : iterable of click.Parameter
        Further options.
    """

    def __init__(
        self,
        name: str,
        function: Callable[..., None],
        needs: Mapping[str, str],
        exclusive: tuple[str, ...],
        json_of_file: bool,
        more: Iterable[click.Parameter],
    ) -> None:
        documented, hints = Documented.of(function), get_type_hints(function, include_extras=True)
        self._function, self._objects = function, dict[str, tuple[Any, list[str]]]()
        self._needs, self._exclusive, self.json_of_file = needs, exclusive, json_of_file
        params: list[click.Parameter] = []
        for key, parameter in inspect.signature(function).parameters.items():
            kind, marks = _split(hints[key])
            if not is_dataclass(kind):
                section = "Options" if parameter.kind is parameter.KEYWORD_ONLY else None
                words = documented.parameters.get(key, ("", ""))
                params.append(_parameter(key, hints[key], parameter.default, words, section))
                continue
            taken = next((m for m in marks if isinstance(m, Overrides)), Overrides())
            own = get_type_hints(kind, include_extras=True)
            of_class = Documented.of(kind)
            names = [f for f in fields(kind) if f.name not in taken.without]
            self._objects[key] = kind, [f.name for f in names]
            for f in names:
                shape, text = of_class.parameters.get(f.name, ("", ""))
                text = taken.words.get(f.name, text)
                section = None if f.default is MISSING else of_class.about.partition(".")[0]
                params.append(_parameter(f.name, own[f.name], f.default, (shape, text), section))
        lines = f"Examples:\n{documented.examples}".replace("\n", "\n  ").split("\n  \n")
        super().__init__(
            name,
            callback=self._run,
            params=[*params, *more],
            help=documented.about,
            epilog="\n\n".join(f"\b\n{part}" for part in lines) if documented.examples else None,
        )

    def _run(self, **values: Any) -> None:
        """Call the function with its objects."""
        for key, (kind, names) in self._objects.items():
            unknown = {f.name: "" for f in fields(kind) if f.default is MISSING}
            values[key] = kind(**unknown | {name: values.pop(name) for name in names})
        self._function(**values)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep the words, too: a map and a report say how they were made."""
        ctx.meta["words"] = ["cartstiff", str(self.name), *args]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Check what goes together, convert, and run."""
        spelled = {p.name: p.opts[-1] for p in self.params if isinstance(p, click.Option)}

        def given(names: str) -> list[str]:
            command_line = ParameterSource.COMMANDLINE
            return [n for n in names.split() if ctx.get_parameter_source(n) is command_line]

        for needed, names in self._needs.items():
            for name in [] if given(needed) else given(names):
                others = " or ".join(spelled[n] for n in needed.split() if n in spelled)
                raise InputError(f"is for {others}", where=spelled[name])
        for names in self._exclusive:
            if len(both := given(names)) > 1:
                one, other, *_ = (spelled[name] for name in both)
                raise InputError(f"give {one} or {other}, not both")
        self.convert(ctx)
        return super().invoke(ctx)

    def convert(self, ctx: click.Context) -> None:
        """Convert the values to the units that are computed in."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Each object's options in a section of its own."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and not isinstance(parameter, click.Argument):
                sections.setdefault(getattr(parameter, "section", "Options"), []).append(record)
        for title in sorted(sections, key="Options".__eq__):
            with formatter.section(title):
                formatter.write_dl(sections[title])
