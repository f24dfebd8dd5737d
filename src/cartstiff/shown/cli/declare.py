"""Commands from declarations: a function's signature, its dataclasses,
and their docstrings.

A parameter of the function is an option, or an argument of the command line if it
precedes ``*``. Its annotation is the type of the value, its default is that of the
option, and its numpydoc paragraph is the help, with the metavar after the colon. A
parameter whose type is a dataclass contributes the fields of that class, the same on
every command; each of its base classes is a section of the help. Metadata in
``Annotated`` are a `click.ParamType`, another spelling ("--range"), or `Overrides`.

A class whose values are parameters of functions or classes of the API names these in
`API`, a command in `api`: for each the source file in the package, the name, and options
with another name than the parameter, as ``option=parameter``. A paragraph that the class
or the function does not have is then that of the parameter, read from the source, which
is not imported; names of other parameters in it become their options.

Such a class also states rules of its options: `NEEDS` (options that one requires beside
it), `EXCLUSIVE` (options that are not given together) and `RARE` (options that only
``--help-all`` shows).
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import click
from click.core import ParameterSource

from cartstiff.core.errors import InputError
from cartstiff.shown.cli.output import say


class OptionType(click.ParamType):  # type: ignore[type-arg]
    """Type of an option's value; `name` is its metavar."""

    #: Whether the option may be repeated; its mappings are merged.
    merges = False

    def __init__(self, shape: str) -> None:
        self.name = shape

    def get_metavar(
        self,
        param: click.Parameter,  # noqa: ARG002
        ctx: click.Context | None = None,  # noqa: ARG002
    ) -> str:
        """Words in --help."""
        return self.name

    def convert(
        self,
        value: Any,
        param: click.Parameter | None,
        ctx: click.Context | None,  # noqa: ARG002
    ) -> Any:
        """Parse a text; values that click passes again are unchanged."""
        where = self.name if param is None else param.opts[-1]
        return self.parsed(value, where) if isinstance(value, str) else value

    def parsed(self, text: str, where: str) -> Any:
        """The value of a text given to the option `where`."""
        raise NotImplementedError


class Overrides:
    """Fields of a dataclass that a command does not take, and its own help of others.

    `because` says why the former have no meaning for the command: they are refused with
    it. The argument `optional` may be left out, and is then empty.
    """

    def __init__(
        self, without: str = "", *, because: str = "", optional: str = "", **words: str
    ) -> None:
        self.without, self.because, self.words = without.split(), because, words
        self.optional = optional


def add_once(values: dict[str, Any], name: str, value: object, where: str) -> None:
    """Add a value by its name, or refuse a name that is there already."""
    if name in values:
        raise InputError("given twice", where=where, expected="each once", got=repr(name))
    values[name] = value


class _Option(click.Option):
    """An option in a section of the help; a single value must not be given twice."""

    section = "Options"

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        """Collect all values, so that a second one is noticed."""
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


def _merged(
    _: click.Context, parameter: click.Parameter, values: Any
) -> dict[str, Any] | None:
    merged: dict[str, Any] = {}
    for name, value in (item for mapping in values for item in mapping.items()):
        add_once(merged, name, value, parameter.opts[-1])
    return merged or None


# Default metavars of numbers.
_NUMBERS = {int: "N", float: "NUMBER"}


class Documented(NamedTuple):
    """A docstring: text before its sections, parameters (metavar, help), and examples."""

    about: str
    parameters: dict[str, tuple[str, str]]
    examples: str

    @classmethod
    @cache
    def of(cls, thing: Any, api: tuple[str, ...] = ()) -> Documented:
        """Read the numpydoc docstring of a function, or of a class and its bases."""
        about, sections = _sections(inspect.getdoc(thing) or "")
        known, of_api = dict[str, tuple[str, str]](), dict[str, str]()
        for base in getattr(thing, "__bases__", ()):
            known |= cls.of(base).parameters
        for entry in (*api, *vars(thing).get("API", ())):
            of_api |= _of_api(entry)
        if is_dataclass(thing):
            own = [f.name for f in fields(thing)]
        else:
            own = [*inspect.get_annotations(thing)]
        for name in filter(of_api.__contains__, own):
            shape, _ = known.get(name, ("", ""))
            known[name] = shape, of_api[name]
        for head, words in _entries(sections):
            name, _, shape = head.partition(" : ")
            own_words = of_api.get(name, "") if name in own else ""
            known[name] = shape, words or own_words
        return cls(about, known, sections.get("Examples", "").strip())


def _sections(text: str) -> tuple[str, dict[str, str]]:
    """Text before the sections of a numpydoc docstring, and the sections."""
    about, *parts = re.split(r"^(\w+)\n-{3,}\n", text, flags=re.M)
    return about.strip(), dict(zip(parts[::2], parts[1::2], strict=True))


def _entries(sections: dict[str, str]) -> Iterator[tuple[str, str]]:
    """Heads and paragraphs of the parameters, or of the attributes of a class."""
    listed = sections.get("Parameters") or sections.get("Attributes", "")
    for entry in re.split(r"\n(?=\S)", listed.strip()):
        head, _, words = entry.partition("\n")
        yield head.strip(), " ".join(words.split()).replace("``", "`")


@cache
def _of_api(api: str) -> dict[str, str]:
    """Options and paragraphs of the parameters that an entry of `API` names."""
    file, path, *renamed = api.split()
    source = Path(__file__).parents[2].joinpath(file).read_text(encoding="utf-8")
    for part in path.split("."):
        source = re.split(rf"^ *(?:def|class) {part}\b", source, maxsplit=1, flags=re.M)[
            1
        ]
    entries = [*_entries(_sections(inspect.cleandoc(source.split('"""', 2)[1]))[1])]
    names = {
        name: name for head, _ in entries for name in head.partition(" : ")[0].split(", ")
    }
    names |= {
        name: option for option, _, name in (pair.partition("=") for pair in renamed)
    }

    def spelled(match: re.Match[str]) -> str:
        option = names.get(match[1])
        return match[0] if option is None else f"--{option.replace('_', '-')}"

    return {
        names[name]: re.sub(r"`(\w+)`", spelled, words)
        for head, words in entries
        for name in head.partition(" : ")[0].split(", ")
    }


def _split(hint: Any) -> tuple[Any, list[Any]]:
    """A type and its metadata."""
    hint, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    return hint, marks


def _spelling(name: str, marks: Iterable[Any]) -> str:
    """Return the option of a field: its own, or that of its name."""
    own = (mark for mark in marks if isinstance(mark, str))
    return next(own, f"--{name.replace('_', '-')}")


def _meaningless(kind: type, taken: Overrides) -> dict[str, str]:
    """Options of a class that have no meaning for a command, and why;
    none without a reason.
    """
    if not taken.because:
        return {}
    hints = get_type_hints(kind, include_extras=True)
    return {
        _spelling(name, _split(hints[name])[1]): taken.because for name in taken.without
    }


def _parameter(
    name: str, hint: Any, default: Any, words: tuple[str, str], section: str | None
) -> click.Parameter:
    """Make an argument (without a section) or an option."""
    hint, marks = _split(hint)
    if get_origin(hint) in (Union, UnionType):
        hint = next(part for part in get_args(hint) if part is not NoneType)
    kind, several = _kind_of(hint, marks)
    shape, text = words
    is_needed = default in (MISSING, inspect.Parameter.empty)
    if section is None:
        count = -1 if several else 1
        return click.Argument(
            [name], type=kind, nargs=count, required=is_needed, metavar=shape or None
        )
    own = isinstance(kind, OptionType)
    merges = own and kind.merges
    spelling, is_flag = _spelling(name, marks), kind is bool
    if is_flag and default is None:
        spelling = f"{spelling}/--no-{spelling[2:]}"
    given: dict[str, Any] = {} if is_needed or merges or several else {"default": default}
    if (several or merges) and "repeat it" not in text:
        text += " Repeat it for several."
    option = _Option(
        [*["-o"] * (name == "output"), spelling, name],
        type=None if is_flag else kind,
        is_flag=is_flag or None,  # False would let the value of an option be left out
        multiple=several or merges,
        callback=_merged if merges else None,
        required=is_needed,
        show_default=default not in (None, False, 0) and "default" in given,
        metavar=shape or (None if own else _NUMBERS.get(hint)),
        help=text,
        **given,
    )
    option.section = section
    return option


def _kind_of(hint: Any, marks: list[Any]) -> tuple[Any, bool]:
    """The type that click reads, and whether an option has several of them."""
    for mark in reversed(marks):
        if isinstance(mark, click.ParamType):
            return mark, False
    several = get_origin(hint) is tuple
    if several:
        hint = get_args(hint)[0]
    if get_origin(hint) is Literal:
        return click.Choice(get_args(hint)), several
    return click.Path(path_type=Path) if hint is Path else hint, several


def _parameters(
    kind: type, taken: Iterable[Field[Any]], own: Mapping[str, str]
) -> Iterator[click.Parameter]:
    """Parameters of a class's fields; `own` are words that replace those of the class."""
    documented, hints = (
        Documented.of(kind).parameters,
        get_type_hints(kind, include_extras=True),
    )
    for f in taken:
        owner = next(
            c for c in inspect.getmro(kind) if f.name in inspect.get_annotations(c)
        )
        about = Documented.of(owner).about.partition(".")[0]
        shape, text = documented.get(f.name, ("", ""))
        words = shape, own.get(f.name, text)
        section = None if f.default is MISSING else about
        yield _parameter(f.name, hints[f.name], f.default, words, section)


#: Key in a context's meta if the whole help is shown.
HELP_ALL = "cartstiff.help_all"
# Number of lines of examples in the short help.
_SHOWN_EXAMPLES = 4


def ending(
    name: str, print_it: Callable[[click.Context], None], words: str
) -> click.Option:
    """Make a flag that prints and ends, regardless of other options."""

    def callback(ctx: click.Context, _: click.Parameter, asked: bool) -> None:
        if asked and not ctx.resilient_parsing:
            print_it(ctx)
            ctx.exit()

    return click.Option(
        [name],
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=callback,
        help=words,
    )


def _help_all(ctx: click.Context) -> None:
    """Print the whole help."""
    ctx.meta[HELP_ALL] = True
    say(ctx.get_help())


def _brief(text: str, room: int) -> str:
    """Return the first sentence of a help text, or as much as fits, with the default.

    The option that is needed beside this one is only in the whole text.
    """
    text = re.sub(r"^With --[^:]*: (.)", lambda found: found[1].upper(), text)
    words, bounds = re.fullmatch(r"(.*?)(\s*\[[^\]]*\])?", text, re.S).groups("")  # type: ignore[union-attr]
    sentence = re.split(r"(?<=\.)\s", words)[0]
    stops = re.finditer(r"[:;] |, (?![a-z]{1,2},)| \(|\.$", sentence)
    ends = [m.start() for m in stops if m.start() < room]
    if not ends:
        return f"{sentence[: room - 3].rpartition(' ')[0]}..."
    brief = f"{sentence[: ends[-1]]}."
    return brief + bounds if len(brief + bounds) <= room else brief


def _beside(needed: str, text: str) -> str:
    """Return a help text that names the option that is needed."""
    return text if needed in text else f"With {needed}: {text[:1].lower()}{text[1:]}"


class Command(click.Command):
    """A command whose options are declared by the signature of a function.

    Parameters
    ----------
    name : str
        Its name.
    function : callable
        Function of the command.
    api : tuple of str
        Functions of the API whose parameters its own options are.
    needs : mapping of str to str
        Required options, of which one must be given, by the options (separated by spaces)
        that require them; replaces the rules of the parameters' classes.
    exclusive : tuple of str
        Options of which at most one may be given, besides those of the classes.
    rare : str
        Options that only ``--help-all`` shows, besides those of the classes.
    more : iterable of click.Parameter
        Further options.
    """

    def __init__(
        self,
        name: str,
        function: Callable[..., None],
        *,
        api: tuple[str, ...] = (),
        needs: Mapping[str, str] = MappingProxyType({}),
        exclusive: tuple[str, ...] = (),
        rare: str = "",
        more: Iterable[click.Parameter] = (),
    ) -> None:
        documented = Documented.of(function, api)
        self._function = function
        self._objects = dict[str, tuple[type, list[Field[Any]]]]()
        self._exclusive, self._rare = [*exclusive], rare.split()
        self._meaningless, self._needs = dict[str, str](), dict[str, list[str]]()
        params, rules = list[click.Parameter](), dict[str, str]()
        # Each parameter of the function is an option, or a class of options.
        for key, hint in get_type_hints(function, include_extras=True).items():
            kind, marks = _split(hint)
            if is_dataclass(kind):
                params += self._add_object(key, cast(type, kind), marks, rules)
            elif key != "return":
                parameter = inspect.signature(function).parameters[key]
                section = "Options" if parameter.kind is parameter.KEYWORD_ONLY else None
                words = documented.parameters.get(key, ("", ""))
                params.append(_parameter(key, hint, parameter.default, words, section))
        self._keep_rules(params, rules | dict(needs))
        lines = f"Examples:\n{documented.examples}".replace("\n", "\n  ").split("\n  \n")
        epilog = "\n\n".join(f"\b\n{part}" for part in lines)
        super().__init__(
            name,
            callback=self._run,
            params=[*params, *more],
            help=documented.about,
            epilog=epilog if documented.examples else None,
        )
        self.params.append(ending("--help-all", _help_all, "All options, in full."))

    def _add_object(
        self, key: str, kind: type, marks: list[Any], rules: dict[str, str]
    ) -> Iterator[click.Parameter]:
        """Take the fields of a class as options, and its rules; `rules` are extended."""
        taken = next((m for m in marks if isinstance(m, Overrides)), Overrides())
        own = [f for f in fields(kind) if f.name not in taken.without]
        self._meaningless |= _meaningless(kind, taken)
        self._objects[key] = kind, own
        for part in inspect.getmro(kind)[::-1]:
            self._exclusive += vars(part).get("EXCLUSIVE", ())
            self._rare += vars(part).get("RARE", "").split()
            rules |= vars(part).get("NEEDS", {})
        for parameter in _parameters(kind, own, taken.words):
            if parameter.name == taken.optional:
                parameter.required, parameter.default = False, ""
            yield parameter

    def _keep_rules(
        self, params: Iterable[click.Parameter], needs: Mapping[str, str]
    ) -> None:
        """Keep the rules of the options that there are; helps name what is needed."""
        there = {str(p.name): p for p in params}
        for names, words in needs.items():
            known = list(filter(there.__contains__, words.split()))
            for name in filter(there.__contains__, names.split()):
                self._needs[name] = known
        self._needs = {name: known for name, known in self._needs.items() if known}
        for name, known in self._needs.items():
            option = there[name]
            if isinstance(option, click.Option) and len(known) == 1:
                option.help = _beside(there[known[0]].opts[-1], option.help or "")
        self._exclusive = [x for x in self._exclusive if there.keys() >= {*x.split()}]
        self._rare = list(filter(there.__contains__, self._rare))

    def _run(self, **values: Any) -> None:
        """Call the function with its objects."""
        for key, (kind, taken) in self._objects.items():
            unknown = {f.name: "" for f in fields(kind) if f.default is MISSING}
            values[key] = kind(**unknown | {f.name: values.pop(f.name) for f in taken})
        self._function(**values)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, and keep the words, which maps and reports contain."""
        ctx.meta["words"] = ["cartstiff", str(self.name), *args]
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            option = error.option_name
            if option in self._meaningless:
                reason = self._meaningless[option]
                what = f"has no meaning for 'cartstiff {self.name}': {reason}"
                raise InputError(what, where=option) from None
            if option[1:2].isdigit():
                raise InputError(
                    "numbers of an option are joined by commas, without spaces",
                    expected="numbers such as 0,0,0,0,0,-100",
                    got=next(
                        word for word in ctx.meta["words"] if word.startswith(option)
                    ),
                ) from None
            raise

    def invoke(self, ctx: click.Context) -> Any:
        """Check the rules of the options, and run."""
        spelled = {p.name: p.opts[-1] for p in self.params if isinstance(p, click.Option)}

        def given(*names: str) -> list[str]:
            command_line = ParameterSource.COMMANDLINE
            return [n for n in names if ctx.get_parameter_source(n) is command_line]

        for name, needed in self._needs.items():
            if given(name) and not given(*needed):
                others = " or ".join(spelled[n] for n in needed)
                raise InputError(f"is for {others}", where=spelled[name])
        for names in self._exclusive:
            if len(both := given(*names.split())) > 1:
                one, other, *_ = (spelled[name] for name in both)
                raise InputError(f"give {one} or {other}, not both")
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options of each class as a section.

        Without --help-all one line each.
        """
        sections: dict[str, list[tuple[str, str]]] = {}
        is_whole = HELP_ALL in ctx.meta
        hidden = () if is_whole else self._rare
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None or parameter.name in hidden:
                continue
            if not isinstance(parameter, click.Argument):
                section = getattr(parameter, "section", "Options")
                sections.setdefault(section, []).append(record)
        left = max(len(name) for records in sections.values() for name, _ in records)
        room = formatter.width - left - 4
        for title in sorted(sections, key=("Output", "Options").count):
            records = sections[title]
            if not is_whole:
                records = [
                    (name.ljust(left), _brief(words, room)) for name, words in records
                ]
            with formatter.section(title):
                formatter.write_dl(records, col_max=30 if is_whole else left)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples; without --help-all only the first ones."""
        whole = self.epilog
        if whole and HELP_ALL not in ctx.meta:
            lines = whole.split("\n")
            last = 2 + _SHOWN_EXAMPLES
            while lines[:last][-1].endswith("\\"):  # a command over several lines
                last += 1
            self.epilog = "\n".join(lines[:last])
        super().format_epilog(ctx, formatter)
        self.epilog = whole
