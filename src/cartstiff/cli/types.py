"""Types of options, and their declaration: the same way on every command.

Text that cannot be used is an `InputError` that names the option.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import click

from cartstiff.cli.output import JSON
from cartstiff.errors import InputError, check_name, one_line
from cartstiff.parsing import parse_numbers

_Command = TypeVar("_Command", bound=Callable[..., Any])
# No axis of a map has more values: it would take years.
_MOST = 10**12


#: What stands in place of a power of length: the number is an angle.
ANGLE = None
_Powers = tuple[int | None, ...]


class Factors(NamedTuple):
    """What lengths and angles are multiplied by, to be in the units that are computed in."""

    length: float = 1.0
    angle: float = 1.0


class OptionType(click.ParamType):  # type: ignore[type-arg]
    """Text that becomes a value; `name` stands for it in --help."""

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


class Numbers(OptionType):
    """Comma-separated numbers, as many as one of `counts` (any number without).

    `powers` are those of length in their units, or `ANGLE`; the last holds for all further numbers.
    """

    def __init__(
        self, shape: str, *counts: int, powers: _Powers = (0,), above_zero: bool = False
    ) -> None:
        super().__init__(shape)
        self.counts, self.powers, self.above_zero = counts, powers, above_zero

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:  # noqa: ARG002
        """Each number in its other unit."""
        powers = (*self.powers, *[self.powers[-1]] * len(value))
        return [
            x * (by.angle if power is ANGLE else by.length**power)
            for x, power in zip(value, powers, strict=False)
        ]

    def parsed(self, text: str, where: str) -> Any:
        """List of floats."""
        numbers = parse_numbers(text, where, self.counts[0] if len(self.counts) == 1 else None)
        if self.counts and len(numbers) not in self.counts:
            raise InputError("wrong count", where=where, expected=self.name, got=len(numbers))
        if self.above_zero and min(numbers) <= 0:
            raise InputError("cannot be used", where=where, expected="above zero", got=min(numbers))
        return numbers


class Number(Numbers):
    """One number."""

    def __init__(self, shape: str, *, power: int = 0, above_zero: bool = False) -> None:
        super().__init__(shape, 1, powers=(power,), above_zero=above_zero)

    def parsed(self, text: str, where: str) -> Any:
        """The number."""
        return super().parsed(text, where)[0]

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:
        """The number in its other unit."""
        return super().converted([value], by, elastic)[0]


class Amount(OptionType):
    """A number and, if wanted, its unit: "0.2mm"."""

    def parsed(self, text: str, where: str) -> tuple[float, str]:
        """The number, and the unit or ""."""
        match = re.fullmatch(r"\s*(.*?)\s*([A-Za-z]+(?:/[A-Za-z]+)?)?\s*", text)
        number = text if match is None else match[1]
        return parse_numbers(number, where, 1)[0], "" if match is None else match[2] or ""


class Arguments(OptionType):
    """One ``NAME:=VALUE`` pair of texts, as ROS people write it, as a mapping."""

    def parsed(self, text: str, where: str) -> dict[str, str]:
        """The value by its name."""
        name, equals, value = text.partition(":=")
        if not equals or not name.strip():
            raise InputError("cannot be used", where=where, expected=self.name, got=repr(text))
        return {name.strip(): value}


class UnitList(OptionType):
    """Units by their kind, such as ``mm,deg``: of lengths and angles."""

    powers = (0,)  # no length itself

    @property
    def known(self) -> dict[str, str]:
        """Kind of each unit; lengths as in `contract.LENGTHS`, without NumPy."""
        lengths = ("m", "dm", "cm", "mm", "um", "in", "ft")
        return {**dict.fromkeys(lengths, "length"), **dict.fromkeys(("rad", "deg"), "angle")}

    def parsed(self, text: str, where: str) -> dict[str, str]:
        """Units by kind, as far as they are given."""
        kinds, chosen = self.known, dict[str, str]()
        for unit in (part.strip() for part in text.split(",")):
            check_name("unit", unit, kinds, where)
            if kinds[unit] in chosen:
                raise InputError(f"two units of {kinds[unit]}", where=where, got=text)
            chosen[kinds[unit]] = unit
        return chosen

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:
        """Lengths are in the mechanism's unit where they were converted."""
        is_there = by.length == 1.0 or "length" not in value
        return value if is_there else {**value, "length": elastic.units.length}


class TableUnits(UnitList):
    """Units by kind, of columns of tables, too; the columns keep them."""

    @property
    def known(self) -> dict[str, str]:
        """Kind of each unit."""
        from cartstiff.loading.tables import UNITS

        return {unit: kind for kind, units in UNITS.items() for unit in units if unit}

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:  # noqa: ARG002
        """The same."""
        return value


PAYLOAD = Numbers("MASS[,X,Y,Z]", 1, 4, powers=(0, 1))
WRENCH = Numbers("MX,MY,MZ,FX,FY,FZ", 6, powers=(1, 1, 1, 0))
POINT = Numbers("X,Y,Z", 3, powers=(1,))
DIRECTION = Numbers("X,Y,Z", 3)
POSE = Numbers("X,Y,Z,R,P,Y", 6, powers=(1, 1, 1, ANGLE))
TCP = Numbers("X,Y,Z[,R,P,Y]", 3, 6, powers=(1, 1, 1, ANGLE))
TOLERANCE = Numbers("REL[,LENGTH[,ANGLE]]", 1, 2, 3, powers=(0, 1, ANGLE))


def _sizes(elastic: Any, by: Factors, *, frame: bool = False) -> dict[str, float]:
    """What numbers by name are multiplied by: positions of a frame, of joints, lengths of legs."""
    turns = dict.fromkeys(("yaw", "rx", "ry", "rz"), by.angle)
    sizes = {**dict.fromkeys(("x", "y", "z"), by.length), **turns}
    if not frame:
        sizes |= dict.fromkeys(elastic.spring_names, by.length)
        sizes |= {
            c.name: by.length if c.is_length else by.angle for c in elastic.mechanism.coordinates
        }
        sizes |= {f"command_{name}": size for name, size in sizes.items()}
    return sizes


@dataclass(frozen=True)
class Values:
    """Numbers for joints (or legs), whose names are known only with the mechanism."""

    option: str
    numbers: list[float] | dict[str, float]

    def of(self, names: tuple[str, ...], broadcast: bool = False) -> Any:
        """The numbers, as many as `names` (or one for all), or those of some names."""
        if isinstance(self.numbers, dict):
            for name in self.numbers:
                check_name("joint", name, names, self.option)
        elif broadcast and len(self.numbers) == 1:
            return self.numbers[0]
        elif len(self.numbers) != len(names):
            raise InputError(
                "wrong count",
                where=self.option,
                expected=f"{len(names)} numbers ({', '.join(names)})",
                got=len(self.numbers),
            )
        return self.numbers

    @property
    def all(self) -> list[float]:
        """Every number that was given."""
        return list(self.numbers.values()) if isinstance(self.numbers, dict) else self.numbers


class JointValues(OptionType):
    """Numbers in joint order or ``name=value`` pairs, as `Values`.

    They belong to the coordinates, or to the `springs` (legs of a platform), of which they may be
    the `stiffness` ("rigid" too); with `broadcast` one number may stand for all.
    """

    def __init__(
        self, *, stiffness: bool = False, springs: bool = False, broadcast: bool = False
    ) -> None:
        super().__init__("VALUES")
        self.stiffness, self.springs, self.broadcast = stiffness, springs, broadcast

    def converted(self, value: Values, by: Factors, elastic: Any) -> Values:
        """Lengths and angles; a stiffness by what its joint does: it slides or turns."""
        sizes = _sizes(elastic, by)
        if self.stiffness:
            a = by.length
            sizes = {
                n: a if size == 1.0 else 1.0 / a for n, size in _sizes(elastic, Factors(a)).items()
            }
        numbers = value.numbers
        if isinstance(numbers, dict):
            return replace(value, numbers={n: x * sizes.get(n, 1.0) for n, x in numbers.items()})
        names = elastic.spring_names if self.springs else elastic.names
        if self.broadcast and len(numbers) == 1:
            numbers = numbers * len(names)
        if len(numbers) != len(names):  # refused where it is used
            return value
        return replace(value, numbers=[x * sizes[n] for x, n in zip(numbers, names, strict=True)])

    def parsed(self, text: str, where: str) -> Values:
        """Values as given, not yet compared with the mechanism."""
        if "=" not in text:
            return Values(where, parse_numbers(text, where, rigid=self.stiffness))
        values: dict[str, float] = {}
        for part in text.split(","):
            name, equals, number = (piece.strip() for piece in part.partition("="))
            if not equals:
                raise InputError(
                    "mixes numbers and name=value pairs",
                    where=where,
                    expected="one of the two forms",
                    got=repr(part),
                )
            if name in values:
                raise InputError("joint given twice", where=where, got=repr(name))
            values[name] = parse_numbers(number, f"{where} {name}", 1, rigid=self.stiffness)[0]
        return Values(where, values)


class Pairs(OptionType):
    """``NAME=VALUE`` pairs as a mapping; of `names` only, if there are any.

    They are as the mechanism's file has them, or of a `frame`, or of axes, as those of `Axes`.
    """

    def __init__(
        self, shape: str, names: tuple[str, ...] = (), *, frame: bool = False, axes: bool = False
    ) -> None:
        super().__init__(shape)
        self.names, self.frame, self.axes = names, frame, axes

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:
        """Lengths and angles in their other units."""
        sizes = _sizes(elastic, by, frame=self.frame) if self.frame or self.axes else {}
        return {name: x * sizes.get(name, 1.0) for name, x in value.items()}

    def parsed(self, text: str, where: str) -> dict[str, float]:
        """Numbers by name."""
        values: dict[str, float] = {}
        for part in text.split(","):
            name, equals, number = (piece.strip() for piece in part.partition("="))
            if not equals or name in values or (self.names and name not in self.names):
                of = f" pairs of {', '.join(self.names)}" if self.names else ""
                raise InputError(
                    "cannot be used",
                    where=where,
                    expected=f"NAME=VALUE{of}, each once",
                    got=repr(part),
                )
            values[name] = parse_numbers(number, f"{where} {name}", 1)[0]
        return values


class Axes(OptionType):
    """``NAME=LOW:HIGH:COUNT`` (or without a count) items as a mapping to their numbers.

    With `single`, ``NAME=VALUE`` as well. They are of coordinates and legs, or of a `frame`.
    """

    def __init__(self, shape: str, *, single: bool = False, frame: bool = False) -> None:
        super().__init__(shape)
        self.single, self.frame = single, frame

    def converted(self, value: Any, by: Factors, elastic: Any) -> Any:
        """Lengths and angles in their other units."""
        sizes = _sizes(elastic, by, frame=self.frame)
        return {
            name: (*(x * sizes.get(name, 1.0) for x in numbers[:2]), *numbers[2:])
            for name, numbers in value.items()
        }

    def parsed(self, text: str, where: str) -> dict[str, tuple[float, ...]]:
        """Low, high and count by name."""
        shape = self.name
        size = shape.count(":") + 1
        axes: dict[str, tuple[float, ...]] = {}
        for item in re.split(r"[,\s]+", text.strip()):
            name, equals, numbers = item.partition("=")
            parts = numbers.split(":")
            alone = self.single and len(parts) == 1
            if not equals or not name or (len(parts) != size and not alone):
                expected = f"{shape} or NAME=VALUE" if self.single else shape
                raise InputError("cannot be used", where=where, expected=expected, got=repr(item))
            values = tuple(parse_numbers(part, f"{where} {name}", 1)[0] for part in parts)
            if len(values) == 3 and not (values[2].is_integer() and 1 <= values[2] <= _MOST):
                raise InputError(
                    "count cannot be used",
                    where=f"{where} {name}",
                    expected="a whole number of 1 or more",
                    got=parts[2],
                )
            _add(axes, name, values, where)
        return axes


class OutputFile(OptionType):
    """A file to be written: an ending that says what is written, and a folder that exists."""

    def __init__(self, shape: str, *endings: str) -> None:
        super().__init__(shape)
        self.endings = endings

    def parsed(self, text: str, where: str) -> Path:
        """Path of the file."""
        path = Path(text)
        if path.suffix.lower() not in self.endings:
            raise InputError(
                "unknown file ending",
                where=where,
                expected=" or ".join(self.endings),
                got=path.name,
            )
        if path.is_dir():
            raise InputError("is a directory", where=one_line(text), expected="a file")
        if not path.parent.is_dir():
            raise InputError("file cannot be written", where=one_line(text), got="no such folder")
        return path


PICTURE = OutputFile("FILE.png", ".png", ".svg", ".pdf")


def _add(values: dict[str, Any], name: str, value: object, where: str) -> None:
    if name in values:
        raise InputError("given twice", where=where, got=repr(name))
    values[name] = value


def _once(context: click.Context, parameter: click.Parameter, values: tuple[Any, ...]) -> Any:
    if len(values) > 1:
        raise click.BadParameter("given more than once", ctx=context, param=parameter)
    return values[0] if values else None


def _merged(
    _: click.Context, parameter: click.Parameter, values: tuple[Mapping[str, Any], ...]
) -> dict[str, Any]:
    merged: dict[str, Any] = {}
    for name, value in (item for mapping in values for item in mapping.items()):
        _add(merged, name, value, parameter.opts[-1])
    return merged


_Decorator = Callable[[Any], Any]
#: Path of a file that is read.
FILE = click.Path(path_type=Path)


def option(names: str, kind: Any, words: str, **settings: Any) -> _Decorator:
    """An option that must not be given twice; None without it."""
    return _declared(names, kind, words, multiple=True, callback=_once, **settings)


def repeated_option(names: str, kind: OptionType, words: str, **settings: Any) -> _Decorator:
    """An option of `Pairs` or `Axes` that may be given for several names: one mapping."""
    return _declared(names, kind, words, multiple=True, callback=_merged, **settings)


def flag(names: str, words: str, **settings: Any) -> _Decorator:
    """An option without a value."""
    return click.option(*names.split(), is_flag=True, help=words, **settings)


def choice(names: str, among: Iterable[str], words: str, **settings: Any) -> _Decorator:
    """One of some words; of several that are given the last counts."""
    return _declared(names, click.Choice(list(among)), words, **settings)


def count(
    names: str, words: str, low: int | None, high: int | None = None, **settings: Any
) -> _Decorator:
    """A whole number between two ends; of several that are given the last counts."""
    return _declared(names, click.IntRange(low, high), words, **settings)


def file_option(names: str, words: str, **settings: Any) -> _Decorator:
    """Path of a file; of several that are given the last counts."""
    return _declared(names, FILE, words, **settings)


def _declared(names: str, kind: Any, words: str, **settings: Any) -> _Decorator:
    """An option by its names, as click takes them but in one text; its default is shown."""
    shown = "default" in settings or None
    return click.option(*names.split(), type=kind, help=words, show_default=shown, **settings)


def option_group(*options: Callable[[Any], Any]) -> Callable[[_Command], _Command]:
    """Several options as one decorator, in the order in which --help shows them."""

    def decorate(command: _Command) -> _Command:
        for decorator in reversed(options):
            command = decorator(command)
        return command

    return decorate


def only_with(of: str, **values: object) -> None:
    """Refuse values of options that mean something only beside another one, which is not given."""
    for name, value in values.items():
        if value is not None:
            raise InputError(f"is for --{of}", where=f"--{name.replace('_', '-')}")


def gathered(options: Callable[[Any], Any], keyword: str, kind: type[Any]) -> Callable[..., Any]:
    """Decorator that adds options and hands their values over as one object."""

    def decorate(command: Callable[..., Any]) -> Any:
        @wraps(command)
        def gathered(*arguments: Any, **values: Any) -> Any:
            own = {f.name: values.pop(f.name) for f in fields(kind) if f.name in values}
            return command(*arguments, **{keyword: kind(**own)}, **values)

        return options(gathered)

    return decorate


def _keep_json(context: click.Context, _: click.Parameter, asked: bool) -> None:
    context.meta[JSON] = asked


explain_option = flag(
    "--profile",
    "Also say what computed the answer, how long each part took, and what limits it on this "
    "machine.",
)
json_option = flag("--json", "Print one JSON object.", expose_value=False, callback=_keep_json)
progress_option = click.option(
    "--progress/--no-progress",
    default=None,
    help="Bar on standard error; default on a terminal.",
)
