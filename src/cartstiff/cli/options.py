"""Options that several commands share: which mechanism, in which posture, under which load.

Types of options, and their declaration: the same way on every command.

Text that cannot be used is an `InputError` that names the option.

Options about damping and milling: of ``modes --lobes``, of maps and of paths.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click

from cartstiff.choices import LARGEST_INPUT, LOAD_KINDS
from cartstiff.cli.output import JSON, Progress
from cartstiff.errors import InputError, check_name, one_line
from cartstiff.parsing import parse_numbers

if TYPE_CHECKING:
    from cartstiff.vibration.chatter import Milling
    from cartstiff.vibration.modes import Modes
    from cartstiff.vibration.response import Damping
    from cartstiff.vibration.sensitivities import Sensitivities


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


_FACTOR = "cartstiff.given_length"


class UnitsCommand(click.Command):
    """A command with --units; it sees the options' numbers converted.

    Angles become radians. With --json, lengths become those of the mechanism's file, as does all
    that comes out; without, the mechanism is put into the unit that was given.
    """

    #: Whether the JSON is in the units of the mechanism's file.
    has_json_of_file = True

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        units = ctx.params.get("units") or {}
        is_json = self.has_json_of_file and ctx.meta.get(JSON)
        length = units.get("length") if is_json else None
        if length is not None or units.get("angle") == "deg":
            _convert(ctx, length, math.pi / 180.0 if units.get("angle") == "deg" else 1.0)
        return super().invoke(ctx)


def given_length() -> float:
    """The unit of length of numbers that are given, in the one that is computed in."""
    context = click.get_current_context(silent=True)
    return 1.0 if context is None else float(context.meta.get(_FACTOR, 1.0))


def column_factors(elastic: Any) -> dict[str, float]:
    """Factors of columns whose head names no unit: angles, and what has lengths in its unit."""
    from cartstiff.mechanisms.other_units import shown_factors

    a = given_length()
    lengths = [
        *(c.name for c in elastic.mechanism.coordinates if c.is_length),
        "x",
        "y",
        "z",
        "mx",
        "my",
        "mz",
    ]
    return {**({} if a == 1.0 else dict.fromkeys(lengths, a)), **shown_factors(elastic)}


def _convert(ctx: click.Context, length: str | None, angle: float) -> None:
    from cartstiff.mechanisms.contract import Units, convert_length

    read = ("mechanism", "frame", "gravity", "xacro_args", "package_path", "parameters")
    request = MechanismRequest(**{k: v for k, v in ctx.params.items() if k in read})
    elastic = request.bare(request.frame)
    a = 1.0 if length is None else convert_length(Units(length), elastic.units)[0]
    for one in ctx.command.params:
        value = ctx.params.get(one.name or "")
        if value is not None and isinstance(one.type, OptionType):
            ctx.params[str(one.name)] = one.type.converted(value, Factors(a, angle), elastic)
    if length is not None:
        ctx.meta[_FACTOR] = a


_BALANCED = (
    "Wrench on the body in its own frame; rest positions are chosen so that the springs balance it."
)
frame_option = option("--frame", None, "Body frame M: a link or site.", metavar="NAME")
parameters_option = repeated_option(
    "--set parameters",
    Pairs("NAME=VALUE"),
    "A parameter of the mechanism file, in its units, instead of the value there; repeat it "
    "for several.",
)
stiffness_option = option(
    "--stiffness",
    JointValues(stiffness=True, springs=True, broadcast=True),
    "Joint (or leg) stiffnesses: one number for all, one each, or name=value pairs; joints "
    "may be rigid.",
)


#: Commanded actuator positions, for `MechanismRequest.command`.
command_option = option(
    "--actuate told",
    JointValues(springs=True),
    "How far drives move from the posture (rad or lengths), such as leg1/slide=0.001, or "
    "leg1=0.001 of a platform. The rest positions of their springs shift by so much, and "
    "the pose of the new rest is found.",
)


@dataclass(frozen=True)
class LoadRequest:
    """Values of `load_options`."""

    load_at: list[float] | None
    world: bool
    load_kind: str

    def keywords(self, wrench: object) -> dict[str, Any]:
        """Arguments of `cartstiff.analyse` beside a wrench; --world may be about other options."""
        return {
            "load_at": self.acts_at,
            "load_kind": self.load_kind,
            "load_axes": "body" if wrench is None else self.axes,
        }

    @property
    def acts_at(self) -> Any:
        """The point of the body at which the load acts."""
        return self.load_at or (0.0, 0.0, 0.0)

    @property
    def axes(self) -> Any:
        """Axes of the load's components: "body" or "world"."""
        return "world" if self.world else "body"

    def check_load(self, is_given: bool) -> None:
        """Refuse options of a load where there is none."""
        for name, is_said in (
            ("--load-at", self.load_at is not None),
            ("--load-kind", self.load_kind != "dead"),
        ):
            if is_said and not is_given:
                raise InputError("is for --load", where=name)

    def check_world(self, **given: object) -> None:
        """Refuse --world where none of the options is given whose components it is about."""
        if self.world and all(value is None for value in given.values()):
            names = ", ".join(f"--{name.replace('_', '-')}" for name in given)
            raise InputError(f"is for {names}", where="--world")


@dataclass(frozen=True)
class MechanismRequest:
    """Values of `mechanism_options`."""

    mechanism: str
    q: Values | None = None
    pose: list[float] | None = None
    lengths: list[float] | None = None
    frame: str | None = None
    stiffness: Values | None = None
    rest: Values | None = None
    wrench: list[float] | None = None
    tcp: list[float] | None = None
    gravity: list[float] | None = None
    payload: list[float] | None = None
    xacro_args: dict[str, str] | None = None
    package_path: tuple[Path, ...] = ()
    units: dict[str, str] | None = None
    parameters: dict[str, float] | None = None

    @property
    def balanced_wrench(self) -> list[float] | None:
        """The wrench, where rest positions follow from it and cannot be given as well."""
        if self.wrench is not None and self.rest is not None:
            raise InputError("give --load or --rest, not both: one follows from the other")
        return self.wrench

    def load(self) -> tuple[Any, Any]:
        """The elastic mechanism, and its coordinates or None for the default posture."""
        elastic = self.in_frame(self.frame)
        q, notes = self._coordinates(elastic)
        elastic = elastic.with_notes(*notes)
        names = elastic.spring_names
        are_lines = names != elastic.names
        stiffness = rest = None
        if self.stiffness is not None:
            _check_range(self.stiffness, "above zero" if are_lines else "zero or more", are_lines)
            stiffness = self.stiffness.of(names, broadcast=True)
        if self.rest is not None:
            if are_lines:
                _check_range(self.rest, "zero or more")
            rest = self.rest.of(names)
        return elastic.with_springs(stiffness, rest), q

    def command(self, told: Values, elastic: Any) -> dict[str, float]:
        """Commanded displacement of each drive by --actuate."""
        values = told.of(elastic.spring_names)
        if isinstance(values, dict):
            return values
        return {n: x for n, x in zip(elastic.spring_names, values, strict=True) if x}

    def at_posture(self) -> Any:
        """The elastic mechanism with the posture that was given as its own."""
        from dataclasses import replace

        elastic, q = self.load()
        if q is None:
            return elastic
        noted, posture = elastic.placed(q, "--q")
        return replace(noted, q=posture.q)

    def in_frame(self, frame: str | None) -> Any:
        """The mechanism as its file has it, with tool and weight, and another frame of interest."""
        tool: dict[str, Any] = {"tcp": self.tcp, "payload": self.payload}
        if self.units is None:
            return self._loaded(frame, **tool)
        from cartstiff.mechanisms.contract import Units, convert_length
        from cartstiff.mechanisms.other_units import in_units

        bare = self.bare(frame)
        length = self.units.get("length", bare.units.length)
        factor, _ = convert_length(Units(length), bare.units)
        for name, kind in (("tcp", TCP), ("payload", PAYLOAD)):  # of the file, in its units
            if (numbers := tool[name]) is not None:
                tool[name] = kind.converted(numbers, Factors(factor), bare)
        if any(numbers is not None for numbers in tool.values()):
            bare = self._loaded(frame, **tool)
        return in_units(bare, length, self.units.get("angle", "rad"))

    def bare(self, frame: str | None) -> Any:
        """The mechanism in its file's units, without the tool; read once a command."""
        context = click.get_current_context(silent=True)
        kept = {} if context is None else context.meta
        key = f"cartstiff.bare {frame!r}"
        if key not in kept:
            kept[key] = self._loaded(frame)
        return kept[key]

    def _loaded(self, frame: str | None, **tool: Any) -> Any:
        from cartstiff.loading import load

        try:
            Path(self.mechanism).expanduser()
        except RuntimeError:
            raise InputError(
                "the home directory is not known", where=one_line(self.mechanism)
            ) from None
        if frame is not None and not 0 < len(one_line(frame, 4000)) < 4000:
            raise InputError("unknown frame", where="--frame", expected="a name", got=repr(frame))
        return load(
            self.mechanism,
            frame=frame,
            gravity=self.gravity,
            xacro_args=self.xacro_args,
            package_path=self.package_path,
            parameters=self.parameters,
            **tool,
        )

    def _coordinates(self, elastic: Any) -> tuple[Any, tuple[Any, ...]]:
        """Coordinates from --q, --pose or --lengths, None without any; and notes on them."""
        mechanism = elastic.mechanism
        if self.pose is not None and self.q is not None:
            raise InputError("give --q or --pose, not both")
        if self.lengths is not None:
            from cartstiff.mechanisms.platform import Platform

            if self.q is not None or self.pose is not None:
                raise InputError("give --lengths or a pose, not both")
            if not isinstance(mechanism, Platform):
                raise InputError("is for platforms", where="--lengths", expected="--q")
            if len(self.lengths) != len(elastic.spring_names):
                raise InputError(
                    "wrong count",
                    where="--lengths",
                    got=len(self.lengths),
                    expected=f"{len(elastic.spring_names)} numbers",
                )
            return mechanism.forward_kinematics(self.lengths, elastic.q), ()
        if self.pose is not None:
            from cartstiff.geometry import se3
            from cartstiff.kinematics.at_pose import at_pose

            x = (*(self.tcp or ()), *[0.0] * 6)[:6]
            try:
                return at_pose(elastic, self.pose, se3.from_roll_pitch_yaw(x[:3], x[3:]))
            except InputError as error:
                raise error.moved_to("--pose") from None
        return None if self.q is None else self.q.of(elastic.names), ()


def _check_range(values: Values, expected: str, finite: bool = False) -> None:
    """Refuse numbers below zero, zero itself where `expected` is "above zero", and tiny ones."""
    for value in values.all:
        if finite and value == math.inf:
            raise InputError(
                "not a finite number", where=values.option, expected=expected, got="rigid"
            )
        if value < 0 or (value == 0 and expected == "above zero"):
            raise InputError(
                "cannot be used", where=values.option, expected=expected, got=f"{value:g}"
            )
        if 0 < value < 1 / LARGEST_INPUT:
            raise InputError(
                "number is too small",
                where=values.option,
                got=f"{value:g}",
                expected=f"{expected}, at least {1 / LARGEST_INPUT:g}",
            )


_tcp_option = option(
    "--tcp", TCP, "M in the frame: position, and roll, pitch, yaw about fixed axes."
)
#: Tool, gravity and what is carried.
tool_options = option_group(
    _tcp_option,
    option(
        "--gravity",
        DIRECTION,
        "Acceleration of gravity in F in m/s^2, such as 0,0,-9.81; it replaces the file's.",
    ),
    option(
        "--payload",
        PAYLOAD,
        "Mass on the body, always in kg, and its centre in M. It has weight under the "
        "gravity of --gravity or the file; without either under 9.81 m/s^2 along -z.",
    ),
)
#: How a file is read.
file_options = option_group(
    parameters_option,
    repeated_option(
        "--xacro-arg xacro_args",
        Arguments("NAME:=VALUE"),
        "Argument of a xacro file; repeat it for several.",
    ),
    file_option(
        "--package-path",
        "Folder in or under which ROS packages are looked for.",
        metavar="FOLDER",
        multiple=True,
    ),
)
units_option = option(
    "--units",
    UnitList("UNITS"),
    "Units of numbers given and shown, such as mm,deg. Lengths in m, cm, mm, um or in: "
    "with mm, moments are in N mm, stiffnesses in N mm/rad and N/mm. The head of a CSV "
    "file may name others. deg is for every angle that is given, and for joints, roll, pitch, "
    "yaw and tables of postures that are shown; stiffnesses stay per radian. "
    "With --json, numbers come out in the units of MECHANISM's file and in radians; the "
    "JSON of `map` and `design` keeps the unit of length given here, and names it.",
)
#: Which robot it is, and what it carries: the same on every command, for `MechanismRequest`.
robot_options = option_group(
    frame_option,
    tool_options,
    units_option,
    file_options,
    stiffness_option,
)


def mechanism_options(
    load_help: str = _BALANCED, *, placed: bool = True, gives: bool = True, loaded: bool = False
) -> Callable[..., Callable[..., Any]]:
    """Argument MECHANISM and the options that place and load it.

    The command gets a `MechanismRequest` as its keyword ``request``; without `placed` there are
    only those that say which robot it is, its posture among them, and `loaded` adds its load;
    without `gives` neither its posture nor what it weighs nor its springs.
    """
    posture = option(
        "--q", JointValues(), "Posture: numbers in joint order or name=value pairs, rad and m."
    )
    load = option("--load wrench", WRENCH, load_help)
    options = (
        option_group(
            click.argument("mechanism"),
            posture,
            option(
                "--pose",
                POSE,
                "Posture of a platform, or of a body on legs: position and roll, pitch, yaw "
                "about fixed axes.",
            ),
            option(
                "--lengths",
                Numbers("L1,...,L6", powers=(1,)),
                "Posture of a six-legged platform by its leg lengths, near the file's pose.",
            ),
            robot_options,
            option(
                "--rest",
                JointValues(springs=True),
                "Rest positions of the joints, or rest lengths of the legs; written as for --q.",
            ),
            load,
        )
        if placed
        else option_group(
            click.argument("mechanism"),
            *(
                [posture, robot_options]
                if gives
                else [frame_option, _tcp_option, units_option, file_options]
            ),
            *([load] if loaded else []),
        )
    )
    return gathered(options, "request", MechanismRequest)


def load_options(world: str) -> Callable[..., Callable[..., Any]]:
    """Where the load acts, along which axes and what it does, as `LoadRequest` in ``applied``.

    `world` names the options whose components --world is about.
    """
    options = option_group(
        option(
            "--load-at",
            POINT,
            "Point of the body, in its frame, at which the load acts; default its origin.",
        ),
        flag(
            "--world",
            f"Components (of {world}) are along the "
            "inertial axes, not those of the body. Points stay in the body's frame.",
        ),
        choice(
            "--load-kind",
            list(LOAD_KINDS),
            "Behaviour of the load while the body moves. dead: force and moment keep "
            "their direction in the room; follower: they turn with the body; "
            "conservative: the force keeps its direction, the moment turns by half.",
            default="dead",
        ),
    )
    return gathered(options, "applied", LoadRequest)


_LABEL = "parameters"

sensitivities_option = flag(
    "--sensitivities",
    "Also print the derivatives of the stiffness, of the frequencies and of the pose at rest, "
    "by each stiffness, mass, length and parameter of the file.",
)


def tolerance_option(gives: str) -> Any:
    """Standard deviations of the parameters."""
    return option(
        "--tolerance",
        TOLERANCE,
        "Standard deviations: relative of every spring stiffness, absolute of every length "
        f"and rotation (rad) of the geometry. The answer has {gives}.",
    )


def checked_tolerance(numbers: list[float] | None) -> None:
    """Refuse numbers below zero, and zeros alone."""
    if numbers is not None and (min(numbers) < 0.0 or not any(numbers)):
        raise InputError(
            "cannot be used",
            where="--tolerance",
            expected="zero or more, not all zero",
            got=numbers,
        )


def add_sensitivities(
    subject: Any,
    request: MechanismRequest,
    data: dict[str, Any],
    finish: Callable[[Any], Any] = lambda elastic: elastic,
) -> tuple[list[str], Sensitivities]:
    """Adds the derivatives to the JSON object, and gives them as lines and as they are.

    `finish` is what becomes of the mechanism after its file was read.
    """
    from cartstiff.report.modes import describe_sensitivities
    from cartstiff.vibration.sensitivities import sensitivities

    def reread(values: Any) -> Any:
        told = {**(request.parameters or {}), **values}
        return finish(replace(request, parameters=told).load()[0])

    elastic = subject.elastic
    with Progress(_LABEL) as bar:
        known = sensitivities(subject, reread=reread if elastic.parameters else None, progress=bar)
    data["sensitivities"] = known.as_dict()
    return describe_sensitivities(known, elastic.units), known


def add_accuracy(
    subject: Any, numbers: list[float], data: dict[str, Any], given: Sensitivities | None = None
) -> list[str]:
    """Adds the deviations from the tolerances to the JSON object, and returns them as lines."""
    from cartstiff.analysis.tolerances import Tolerances
    from cartstiff.report.modes import describe_accuracy
    from cartstiff.vibration.sensitivities import accuracy

    with Progress(_LABEL) as bar:
        known = accuracy(subject, Tolerances(*numbers), given=given, progress=bar)
    data["accuracy"] = known.as_dict()
    return describe_accuracy(known, subject.elastic.units)


def add_intervals(
    modes: Modes, numbers: list[float] | None, data: dict[str, Any], given: Sensitivities | None
) -> tuple[list[str], Sensitivities | None]:
    """Adds the intervals of the frequencies to the JSON object.

    Gives them as lines, and the derivatives that they took.
    """
    from cartstiff.analysis.tolerances import Tolerances
    from cartstiff.report.modes import describe_intervals
    from cartstiff.vibration.sensitivities import intervals, sensitivities

    t = Tolerances(*(numbers or ()))
    if given is None and t.any:
        with Progress(_LABEL) as bar:
            given = sensitivities(modes, geometry=bool(t.length or t.angle), progress=bar)
    band = intervals(modes, t, given=given)
    data["intervals"] = band.as_dict()
    return describe_intervals(modes, band), given


cutting_options = option_group(
    option(
        "--milling",
        Numbers("KT,KR,TEETH,ENTRY,EXIT", 5, powers=(-2, 0, 0, ANGLE)),
        "Force law of a mill: tangential force per area, radial over tangential, teeth, and "
        "angles (rad) at which a tooth enters and leaves (slot 0,3.1416; half up 0,1.5708).",
    ),
    option("--feed", DIRECTION, "Direction of the feed of --milling, in M; default x."),
    option("--normal", DIRECTION, "Normal to the feed, in M; default y."),
    option("--tip", POINT, "Tip of the mill, in M; default its origin."),
)

_damping_options = option_group(
    option(
        "--damping", Numbers("RATIO[,RATIO...]"), "Damping ratio of every mode, or one for each."
    ),
    option(
        "--rayleigh",
        Numbers("ALPHA,BETA", 2),
        "Damping alpha M + beta K [1/s, s]. Dampers of the mechanism always act.",
    ),
)


def vibration_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options about damping and milling, given to a command as one mapping `vibration`."""

    @wraps(command)
    def run(*arguments: Any, **given: Any) -> Any:
        taken = {name: given.pop(name) for name in ("milling", "feed", "normal", "tip")}
        damping = damping_of(given.pop("damping"), given.pop("rayleigh"))
        vibration = {"damping": damping, "milling": cutter(**taken)}
        return command(*arguments, **given, vibration=vibration)

    return cutting_options(_damping_options(run))


# Number of speeds by default, and at most.
_SPEEDS, _LIMIT = 12, 2000


def damping_of(damping: list[float] | None, rayleigh: list[float] | None) -> Damping:
    """What damps.

    Raises
    ------
    InputError
        For negative numbers.
    """
    from cartstiff.vibration.response import Damping

    for name, value in (("damping", damping), ("rayleigh", rayleigh)):
        if value is not None and min(value) < 0.0:
            raise InputError(
                "cannot be used", where=f"--{name}", expected="zero or more", got=value
            )
    alpha, beta = rayleigh or (0.0, 0.0)
    ratios = 0.0 if damping is None else damping[0] if len(damping) == 1 else tuple(damping)
    return Damping(ratios, alpha, beta)


def cutter(
    milling: list[float] | None,
    feed: list[float] | None,
    normal: list[float] | None,
    tip: list[float] | None,
) -> Milling | None:
    """The cutter of --milling; None without it.

    Raises
    ------
    InputError
        For numbers that cannot be used, or other options without --milling.
    """
    if milling is None:
        only_with("milling", feed=feed, normal=normal, tip=tip)
        return None
    from cartstiff.vibration.chatter import Milling

    kt, kr, teeth, entry, exit_ = milling
    more: dict[str, Any] = {"feed": feed, "normal": normal, "at": tip}
    more = {key: tuple(value) for key, value in more.items() if value is not None}
    count = int(teeth) if teeth == int(teeth) else teeth
    return Milling(kt, kr, count, entry, exit_, **more)  # type: ignore[arg-type]


@dataclass(frozen=True)
class LobesRequest:
    """``--lobes`` of ``cartstiff modes``, checked."""

    lobes: str | None
    milling: list[float] | None
    feed: list[float] | None
    normal: list[float] | None
    tip: list[float] | None
    csv: Path | None = None
    plot: Path | None = None

    def __post_init__(self) -> None:
        if self.lobes is None:
            of_milling = {"feed": self.feed, "normal": self.normal, "tip": self.tip}
            only_with("lobes", milling=self.milling, **of_milling)
            return
        if self.milling is None:
            raise InputError("needs a force law", where="--lobes", expected="--milling")
        self._speeds()

    def _speeds(self) -> tuple[float, float, int]:
        parts = (self.lobes or "").split(":")
        numbers = [parse_numbers(part, "--lobes", 1)[0] for part in parts if len(parts) in (2, 3)]
        low, high, count = [*numbers, _SPEEDS][:3] if numbers else (0.0, 0.0, 0.0)
        if not (0.0 < low < high and count == int(count) and 2 <= count <= _LIMIT):
            raise InputError(
                "speeds cannot be used",
                where="--lobes",
                got=self.lobes,
                expected=f"LOW:HIGH[:COUNT], 0 < LOW < HIGH in rev/min, COUNT from 2 to {_LIMIT}",
            )
        return low, high, int(count)

    def run(self, modes: Modes, damping: Damping, data: dict[str, Any]) -> list[str]:
        """Computes, adds to the JSON object; lines for people."""
        milling = cutter(self.milling, self.feed, self.normal, self.tip)
        if self.lobes is None or milling is None:
            return []
        from dataclasses import asdict

        import numpy as np

        from cartstiff.report.modes import describe_lobes, lobes_csv
        from cartstiff.vibration.chatter import lobes

        if not damping.acts_on(modes.elastic):
            raise InputError("needs damping", where="--lobes", expected="--damping or --rayleigh")
        low, high, count = self._speeds()
        curve = lobes(modes, milling, np.linspace(low, high, count), damping)
        data["lobes"] = {
            **curve.as_dict(),
            "milling": asdict(milling),
            "unit": modes.elastic.units.length,
        }
        from cartstiff.report.modes import draw_lobes
        from cartstiff.report.output import write_files

        unit = modes.elastic.units.length
        write_files(
            (self.csv, lambda: lobes_csv(curve, unit)),
            (self.plot, lambda: draw_lobes(curve, unit)),
        )
        return describe_lobes(curve, modes.elastic.units)
