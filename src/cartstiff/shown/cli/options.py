"""Options of several commands: types of their values, and the objects made of them.

The options that prepare a question are one object, `Setup`: the mechanism, its posture,
springs, tool, weight and load. A command gets them by one parameter of this type, with
one meaning. Other groups are the same on every command as well: damping (`Vibration`),
output files (`Output`).

Text that cannot be used raises an `InputError` that names the option.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import click

from cartstiff.core.choices import LARGEST_INPUT
from cartstiff.core.errors import InputError, check_name, one_line
from cartstiff.core.matrix_names import Letter
from cartstiff.core.notes import DOUBTS, Note
from cartstiff.files.parsing import parse_numbers
from cartstiff.shown.cli.declare import Command, OptionType, add_once
from cartstiff.shown.cli.output import Progress, json_text, say

if TYPE_CHECKING:
    from cartstiff.answer.data import Answer, Table
    from cartstiff.answer.vibration.response import Damping


#: Largest count of an axis, or of postures; a larger map would take years.
MAX_COUNT = 10**12


class Numbers(OptionType):
    """Comma-separated numbers, whose count is one of `counts` (default any count).

    With `some` not all of them may be zero. A number that stands alone may carry its unit
    if it is of the `kind` "mass" (result in kg), "force" (N) or "length" (a `Metres`).
    """

    def __init__(
        self,
        shape: str,
        *counts: int,
        above_zero: bool = False,
        low: float = -math.inf,
        some: bool = False,
        kind: str = "",
    ) -> None:
        super().__init__(shape)
        self.counts, self.above_zero, self.low, self.some = counts, above_zero, low, some
        self.kind = kind

    def word(self, text: str, where: str) -> float | None:
        """Return the value of a number with its unit, or None."""
        match = _AMOUNT.fullmatch(text)
        if not self.kind or match is None or match[2] is None:
            return None
        from cartstiff.files.tables import UNITS

        unit = match[2].strip()
        check_name("unit", unit, UNITS[self.kind], where)
        value = float(match[1]) * UNITS[self.kind][unit]
        return Metres(value) if self.kind == "length" else value

    def parsed(self, text: str, where: str) -> Any:
        """List of floats."""
        count = self.counts[0] if len(self.counts) == 1 else None
        words: dict[str, Any] = {} if self.kind and "," in text else {"word": self.word}
        numbers = parse_numbers(text, where, count, **words)
        if self.counts and len(numbers) not in self.counts:
            raise InputError(
                "wrong count", where=where, expected=self.name, got=len(numbers)
            )
        self._check_range(numbers, text, where)
        return numbers

    def _check_range(self, numbers: list[float], text: str, where: str) -> None:
        """Refuse numbers that are too small, or all zero."""
        if min(numbers) < self.low or (self.above_zero and min(numbers) <= 0):
            expected = "above zero" if self.above_zero else "zero or more"
            got = numbers if numbers[1:] else numbers[0]
            raise InputError("cannot be used", where=where, expected=expected, got=got)
        if self.some and not any(numbers):
            expected = "a number that is not 0" if self.counts == (1,) else "not all zero"
            raise InputError("must not be zero", where=where, expected=expected, got=text)


def stiffness_of(text: str, where: str) -> float | None:
    """Return a stiffness given as a word or with a unit ("rigid", "392 N m/arcmin"),
    else None.
    """
    if text in ("rigid", "inf", ".inf"):
        return math.inf
    if not re.search(r"^[-+.\d].*[A-Za-df-z]", text):  # an exponent has an e
        return None
    from cartstiff.core.units import GivenStiffness

    return GivenStiffness.read(text, where)


class Metres(float):
    """A length that was given with its unit."""

    @classmethod
    def in_units(cls, value: float | None, units: Any) -> float | None:
        """A length in a mechanism's units; one without a unit of its own is unchanged."""
        from cartstiff.core.units import SI, convert_length

        return value * convert_length(SI, units)[0] if isinstance(value, cls) else value


class Number(Numbers):
    """One number."""

    def __init__(self, shape: str, **settings: Any) -> None:
        super().__init__(shape, 1, **settings)

    def parsed(self, text: str, where: str) -> Any:
        """The number."""
        return super().parsed(text, where)[0]


class Amount(OptionType):
    """A number with an optional unit: "0.2mm"."""

    def parsed(self, text: str, where: str) -> tuple[float, str]:
        """The number, and the unit or ""."""
        match = _AMOUNT.fullmatch(text)
        number, unit = (match[1], match[2] or "") if match else (text, "")
        return parse_numbers(number, where, 1)[0], unit.strip()


_AMOUNT = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\[?([A-Za-z][^\[\]]*)?\]?\s*")


class ByName(OptionType):
    """``NAME=VALUE`` as a mapping; the value is of the type `kind`."""

    merges = True

    def __init__(self, shape: str, kind: OptionType) -> None:
        super().__init__(shape)
        self.kind = kind

    def parsed(self, text: str, where: str) -> dict[str, Any]:
        """Return the value by its name."""
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            raise InputError(
                "cannot be used", where=where, expected="NAME=VALUE", got=repr(text)
            )
        return {name: self.kind.parsed(value, f"{where} {name}")}


class Arguments(OptionType):
    """One ``NAME:=VALUE`` pair of texts, in the notation of ROS, as a mapping."""

    merges = True

    def parsed(self, text: str, where: str) -> dict[str, str]:
        """The value by its name."""
        name, equals, value = text.partition(":=")
        if not equals or not name.strip():
            raise InputError(
                "cannot be used", where=where, expected=self.name, got=repr(text)
            )
        return {name.strip(): value}


@dataclass(frozen=True)
class Values:
    """Numbers for joints or legs, whose names the mechanism defines."""

    option: str
    numbers: list[float] | dict[str, float]

    def of(
        self,
        names: tuple[str, ...],
        broadcast: bool = False,
        joints: tuple[str, ...] = (),
    ) -> Any:
        """The numbers for `names` (or one for all), or by name for the `joints` alone."""
        if isinstance(self.numbers, dict):
            for name in self.numbers:
                check_name("joint", name, names, self.option)
        elif broadcast and len(self.numbers) == 1:
            return self.numbers[0]
        elif len(self.numbers) == len(joints) != len(names):
            return dict(zip(joints, self.numbers, strict=True))
        elif len(self.numbers) != len(names):
            names = joints or names
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
        if isinstance(self.numbers, dict):
            return list(self.numbers.values())
        return self.numbers


class JointValues(OptionType):
    """Numbers in joint order or ``name=value`` pairs, as `Values`.

    They are values of the coordinates, or of the `springs` (legs of a platform), whose
    `stiffness` they may be ("rigid" as well); with `broadcast` one number serves for all.
    """

    def __init__(
        self, *, stiffness: bool = False, springs: bool = False, broadcast: bool = False
    ) -> None:
        super().__init__("VALUES")
        self.stiffness, self.springs, self.broadcast = stiffness, springs, broadcast

    def parsed(self, text: str, where: str) -> Values:
        """Values as given, not yet compared with the mechanism."""
        words: dict[str, Any] = {"word": stiffness_of} if self.stiffness else {}
        if "=" not in text:
            return Values(where, parse_numbers(text, where, **words))
        wrong = "mixes numbers and name=value pairs"
        named = _named(text, where, "NAME=VALUE", wrong=wrong, **words)
        return Values(where, {name: numbers[0] for name, numbers in named.items()})


def _named(
    text: str,
    where: str,
    shape: str,
    *,
    between: str = ",",
    names: tuple[str, ...] = (),
    wrong: str = "cannot be used",
    **words: Any,
) -> dict[str, list[float]]:
    """Parse numbers by name, as many as in `shape`."""
    found: dict[str, list[float]] = {}
    for item in re.split(between, text.strip()):
        name, equals, numbers = (piece.strip() for piece in item.partition("="))
        parts = numbers.split(":")
        if (
            not equals
            or len(parts) != shape.count(":") + 1
            or (names and name not in names)
        ):
            more = f" of {', '.join(names)}" if names else ""
            expected = f"{shape}{more}, each once"
            raise InputError(wrong, where=where, expected=expected, got=repr(item))
        values = [parse_numbers(part, f"{where} {name}", 1, **words)[0] for part in parts]
        add_once(found, name, values, where)
    return found


class Pairs(OptionType):
    """``NAME=VALUE`` pairs as a mapping to numbers; only for `names`, if given.

    A shape such as ``NAME=LOW:HIGH:COUNT`` maps to as many numbers. The numbers are in
    the units of the mechanism's file.
    """

    merges = True

    def __init__(self, shape: str, names: tuple[str, ...] = ()) -> None:
        super().__init__(shape)
        self.names = names

    def parsed(self, text: str, where: str) -> dict[str, Any]:
        """Numbers by name."""
        if ":" not in self.name:
            named = _named(text, where, "NAME=VALUE", names=self.names)
            return {name: numbers[0] for name, numbers in named.items()}
        named = _named(text, where, self.name, between=r"[,\s]+")
        for name, values in named.items():
            if len(values) == 3 and not (
                values[2].is_integer() and 1 <= values[2] <= MAX_COUNT
            ):
                raise InputError(
                    "count cannot be used",
                    where=f"{where} {name}",
                    expected="a whole number of 1 or more",
                    got=f"{values[2]:g}",
                )
        return {name: tuple(values) for name, values in named.items()}


class Sweep(OptionType):
    """``LOW:HIGH[:COUNT]`` as two increasing numbers and a count."""

    def __init__(self, count: int, most: int, unit: str) -> None:
        super().__init__("LOW:HIGH[:COUNT]")
        self.count, self.most, self.unit = count, most, unit

    def parsed(self, text: str, where: str) -> tuple[float, float, int]:
        """Low, high and count."""
        parts = text.split(":")
        expected = f"{self.name}, 0 <= LOW < HIGH in {self.unit}"
        numbers = [
            parse_numbers(part, where, 1)[0] for part in parts if len(parts) in (2, 3)
        ]
        low, high, count = [*numbers, self.count][:3] if numbers else (1.0, 0.0, 0)
        if not (0.0 <= low < high):
            raise InputError("cannot be used", where=where, expected=expected, got=text)
        if not (count == int(count) and 2 <= count <= self.most):
            raise InputError(
                "count cannot be used",
                where=where,
                expected=f"a whole number from 2 to {self.most}",
                got=count,
            )
        return low, high, int(count)


PICTURES = (".png", ".svg", ".pdf")


class OutputFile(OptionType):
    """A file to be written, with a known ending and an existing folder."""

    def __init__(self, shape: str, *endings: str) -> None:
        super().__init__(shape)
        self.endings = endings

    def parsed(self, text: str, where: str) -> Any:
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
            raise InputError(
                "file cannot be written", where=one_line(text), got="no such folder"
            )
        return path


class OutputFiles(OutputFile):
    """Files to be written, at most one of each of the `endings`,
    beside the .json of the answer.
    """

    merges = True

    def __init__(self, *endings: str) -> None:
        super().__init__("FILE", ".json", *endings)

    def parsed(self, text: str, where: str) -> dict[str, Path]:
        """Path of the file by its ending."""
        path: Path = super().parsed(text, where)
        return {path.suffix.lower(): path}


class MapFiles(OutputFiles):
    """A map, at a path or an address, and files of its answer."""

    def __init__(self) -> None:
        super().__init__(*PICTURES)
        self.name = "MAP.zarr"

    def parsed(self, text: str, where: str) -> dict[str, Any]:
        """Path of a file by its ending, or the map's place under ".zarr"."""
        if "://" in text or Path(text).suffix.lower() not in self.endings:
            return {".zarr": text}
        return super().parsed(text, where)


#: Values of options by their kind; None without the option.
_Numbers = list[float] | None
_Ranges = Mapping[str, tuple[float, ...]] | None
Files = Mapping[str, Path] | None
Payload = Annotated[_Numbers, Numbers("MASS[,X,Y,Z]", 1, 4, kind="mass")]
Wrench = Annotated[_Numbers, Numbers("MX,MY,MZ,FX,FY,FZ", 6)]
Point = Annotated[_Numbers, Numbers("X,Y,Z", 3)]
Vector = Annotated[_Numbers, Numbers("X,Y,Z", 3)]
Direction = Annotated[_Numbers, Numbers("X,Y,Z", 3, some=True)]
Pose = Annotated[_Numbers, Numbers("X,Y,Z,R,P,Y", 6)]
Tcp = Annotated[_Numbers, Numbers("X,Y,Z[,R,P,Y]", 3, 6)]
Tolerance = Annotated[
    _Numbers,
    Numbers("REL[,LENGTH[,ANGLE]]", 1, 2, 3, low=0, some=True),
]
Ratios = Annotated[_Numbers, Numbers("RATIO[,RATIO...]", low=0)]
Axis = Annotated[_Ranges, Pairs("NAME=LOW:HIGH")]
Grid = Annotated[_Ranges, Pairs("NAME=LOW:HIGH:COUNT")]
Count = Annotated[int | None, click.IntRange(1)]
Several = Annotated[int | None, click.IntRange(1, 1000)]


@dataclass(frozen=True)
class Load:
    """Load.

    Parameters
    ----------
    world
        Loads and directions in the room's axes. Without it in those of the body; points
        are always in the body's frame.
    load_kind : KIND
    """

    API: ClassVar = ("core/stiffness/compute.py analyse load=wrench",)
    NEEDS: ClassVar = {"world": "load added_load direction"}

    load: Wrench = None
    load_at: Point = None
    world: bool = False
    load_kind: Literal["dead", "follower", "conservative"] = "dead"

    @property
    def keywords(self) -> dict[str, Any]:
        """The load as arguments of any question: `cartstiff.analyse`, `equilibrium`,
        `modes`, ...

        Without --load, --world refers to other options.
        """
        axes = "body" if self.load is None else self.axes
        return {"wrench": self.load, **self.manner, "load_axes": axes}

    @property
    def manner(self) -> dict[str, Any]:
        """Point of the load, and its behaviour while the body moves."""
        return {"load_at": self.load_at or (0.0, 0.0, 0.0), "load_kind": self.load_kind}

    @property
    def axes(self) -> Any:
        """Axes of the load's components: "body" or "world"."""
        return "world" if self.world else "body"


@dataclass(frozen=True)
class Posture:
    """Posture and springs.

    Parameters
    ----------
    mechanism
        A name or a file.
    q
        Posture: numbers, or name=value pairs. Numbers are in joint order, rad and m.
    pose
        Posture of a platform, or of a body on legs. Position and roll, pitch, yaw about
        fixed axes.
    pose_of
        Frame of --pose: the body's own frame, or M, which --tcp and the file may put
        elsewhere. With M at a pivot, other angles are a motion about it.
    lengths
        Posture by six leg lengths, near the file's pose.
    stiffness
        Stiffness of joints or legs. One number for all, one each, or name=value pairs,
        each with its unit if that is not N m/rad or N/m: "392 N m/arcmin", 20N/um; joints
        may be rigid.
    rest
        Rest positions of joints or legs. Legs have rest lengths; written as for --q.
    actuate
        How far drives move from the posture. In rad or lengths, such as leg1/slide=0.001,
        or leg1=0.001 of a platform. The rest positions of their springs shift by the same
        amount, and the pose of the new rest is found.
    """

    API: ClassVar = ("files/loading.py Setup",)
    NEEDS: ClassVar = {"pose_of": "pose"}
    RARE: ClassVar = "pose_of"

    mechanism: str
    q: Annotated[Values | None, JointValues()] = None
    pose: Pose = None
    pose_of: Literal["body", "M"] = "body"
    lengths: Annotated[_Numbers, Numbers("L1,...,L6", above_zero=True)] = None
    springs: str | None = None
    stiffness: Annotated[
        Values | None, JointValues(stiffness=True, springs=True, broadcast=True)
    ] = None
    rest: Annotated[Values | None, JointValues(springs=True)] = None
    actuate: Annotated[Values | None, JointValues(springs=True)] = None


@dataclass(frozen=True)
class Tool:
    """Tool and weight.

    Parameters
    ----------
    frame : NAME
    """

    API: ClassVar = ("files/loading.py Setup",)
    frame: str | None = None
    tcp: Tcp = None
    payload: Payload = None
    gravity: Vector = None


@dataclass(frozen=True)
class File:
    """File of the mechanism.

    Parameters
    ----------
    package_path : FOLDER
    """

    API: ClassVar = ("files/loading.py Setup",)
    RARE: ClassVar = "parameters xacro_args package_path"

    parameters: Annotated[dict[str, float] | None, Pairs("NAME=VALUE"), "--set"] = None
    xacro_args: Annotated[
        dict[str, str] | None, Arguments("NAME:=VALUE"), "--xacro-arg"
    ] = None
    package_path: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Setup(Load, File, Tool, Posture):
    """What a question is about: a mechanism at a posture, its tool and weight,
    and its load.

    Before the load the mechanism carries its weight and the payload, of the file or typed
    (`ElasticMechanism.before_load`); the load comes then, `keywords`.
    """

    def read(self, units: Any = None) -> tuple[Any, Any]:
        """The elastic mechanism, and its coordinates or None for the default posture.

        `units` are those of every option and of the result; default those of the file.
        """
        elastic = self.in_frame(self.frame)
        if units is not None and elastic.units != units:
            elastic = self._converted(elastic.units, units)
        q, notes = self._coordinates(elastic)
        elastic = elastic.with_notes(*notes)
        names, joints = elastic.spring_names, elastic.mechanism.joint_names
        are_lines = names != elastic.names
        if are_lines:
            joints = ()
        stiffness = rest = None
        if self.stiffness is not None:
            _check_range(
                self.stiffness, "above zero" if are_lines else "zero or more", are_lines
            )
            stiffness = self.stiffness.of(names, True, joints)
        if self.rest is not None:
            if are_lines:
                _check_range(self.rest, "zero or more")
            rest = self.rest.of(names, joints=joints)
        return elastic.with_springs(stiffness, rest), q

    def _converted(self, own: Any, units: Any) -> Any:
        """Return the mechanism of a file in `own` units, with its numbers and
        options in others.
        """
        from cartstiff.core.units import convert_length
        from cartstiff.files.other_units import in_units

        if own.force != units.force:
            raise InputError(
                "forces have another unit than those of the first mechanism",
                where=one_line(self.mechanism),
                expected=units.force,
                got=own.force,
            )
        factor, _ = convert_length(units, own)
        tcp, payload = self.tcp, self.payload
        elastic = self._loaded(
            self.frame,
            tcp=tcp and [*(x * factor for x in tcp[:3]), *tcp[3:]],
            payload=payload and [payload[0], *(x * factor for x in payload[1:])],
        )
        words = f"lengths of the file in {own.length} are converted to {units.length}"
        note = Note("converted-units", words, {"from": own.length, "to": units.length})
        return in_units(elastic, units.length).with_notes(note)

    def command(self, elastic: Any) -> dict[str, float]:
        """Commanded displacement of each drive by --actuate."""
        names = elastic.spring_names
        values = {} if self.actuate is None else self.actuate.of(names)
        if isinstance(values, dict):
            return values
        return {n: x for n, x in zip(names, values, strict=True) if x}

    def at_posture(self) -> Any:
        """Return the elastic mechanism with the given posture as its default."""
        elastic, q = self.read()
        if q is None:
            return elastic
        noted, posture = elastic.placed(q, "--q")
        return replace(noted, q=posture.q)

    def in_frame(self, frame: str | None) -> Any:
        """The mechanism of the file with tool and weight, and another body frame."""
        return self._loaded(frame, tcp=self.tcp, payload=self.payload)

    def _loaded(self, frame: str | None, **tool: Any) -> Any:
        from cartstiff.files.loading import load

        try:
            Path(self.mechanism).expanduser()
        except RuntimeError:
            raise InputError(
                "the home directory is not known", where=one_line(self.mechanism)
            ) from None
        if frame is not None and not 0 < len(one_line(frame, 4000)) < 4000:
            raise InputError(
                "unknown frame", where="--frame", expected="a name", got=repr(frame)
            )
        return load(
            self.mechanism,
            frame=frame,
            gravity=self.gravity,
            xacro_args=self.xacro_args,
            package_path=self.package_path,
            parameters=self.parameters,
            springs=self.springs,
            **tool,
        )

    def _coordinates(self, elastic: Any) -> tuple[Any, tuple[Any, ...]]:
        """Return coordinates from --q, --pose or --lengths, or None,
        and notes on them.
        """
        mechanism = elastic.mechanism
        given = [x for x in (self.q, self.pose) if x is not None]
        if len(given) > 1:
            raise InputError("give --q or --pose, not both")
        if self.lengths is not None:
            if given:
                raise InputError("give --lengths or a pose, not both")
            if not len(mechanism.points):
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
            from cartstiff.core.geometry import se3
            from cartstiff.kinematics.at_pose import at_pose

            x = (*(self.tcp or ()), *[0.0] * 6)[:6]
            try:
                tool = se3.from_roll_pitch_yaw(x[:3], x[3:])
                return at_pose(elastic, self.pose, tool, self.pose_of)
            except InputError as error:
                raise error.moved_to("--pose") from None
        joints = mechanism.joint_names
        return None if self.q is None else self.q.of(elastic.names, joints=joints), ()


#: Why a command of many postures takes no --actuate.
ONE_POSTURE = "drives are commanded from one posture: analyse, equilibrium, view, export"


@dataclass(frozen=True)
class BalancedSetup(Setup):
    """A set-up whose load the springs balance at the posture, by their rest positions."""

    EXCLUSIVE: ClassVar = ("load rest",)


def _check_range(values: Values, expected: str, finite: bool = False) -> None:
    """Refuse negative and tiny numbers, and zero if `expected` is "above zero"."""
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


@dataclass(frozen=True)
class Printed:
    """Output.

    Parameters
    ----------
    json
        Print one JSON object.
    """

    json: bool = False

    def show(
        self,
        data: Mapping[str, Any],
        mechanism: str,
        text: Callable[[], str],
        output: Files = None,
        **others: Callable[[], Any],
    ) -> None:
        """Write the files, and print the result as JSON or as text.

        `others` make the contents of files, by the ending without its dot; `picture`
        makes the figure of every picture.
        """
        from cartstiff.shown.report.output import write_files

        notes = data.get("notes", ())
        doubted = [n for n in notes if n["code"] in DOUBTS]
        if doubted:
            data = {**data, "notes": sorted(notes, key=lambda n: n not in doubted)}

        def as_json() -> str:
            return json_text(data, mechanism)

        made = {".json": lambda: as_json() + "\n"}
        made |= {f".{name}": make for name, make in others.items()}
        made |= dict.fromkeys(PICTURES, others["picture"]) if "picture" in others else {}
        write_files(*((path, made[ending]) for ending, path in (output or {}).items()))
        if self.json:
            say(as_json())
            return
        for note in doubted:
            say(f"{note['message'][0].upper()}{note['message'][1:]}.\n")
        say(text())

    def answer(
        self,
        data: Mapping[str, Any],
        answer: Answer,
        output: Files = None,
        **others: Callable[[], Any],
    ) -> None:
        """Write the files, and print the answer: with the result as JSON, or as text."""
        from cartstiff.shown.report.answer import answer_text

        whole = {**data, "answer": answer.to_dict()}
        self.show(whole, answer.subject, lambda: answer_text(answer), output, **others)


def only_endings(output: Files, *endings: str, others: str) -> None:
    """Refuse files of other endings, which need the options `others`."""
    for ending, path in (output or {}).items():
        if ending not in endings:
            raise InputError(
                "there is nothing to write",
                where=f"-o {one_line(path.name)}",
                expected=f"{' or '.join(endings)}; other files need {others}",
            )


def declared(name: str, **rules: Any) -> Callable[[Callable[..., None]], Command]:
    """Return a decorator that makes a `Command` of a function, with its rules."""
    return lambda function: Command(name, function, **rules)


@dataclass(frozen=True)
class Reading:
    """Reading.

    Parameters
    ----------
    connection : LETTER
    """

    API: ClassVar = ("recorded/gradients/spread.py analyse_posture added_load=wrench",)
    RARE: ClassVar = "length"

    connection: Letter | None = None
    direction: Direction = None
    added_load: Wrench = None
    length: Annotated[float | None, Number("L", above_zero=True, kind="length")] = None


@dataclass(frozen=True)
class Parameters:
    """Parameters of the model.

    Parameters
    ----------
    sensitivities
        Also print the derivatives of the stiffness, of the frequencies and of the pose at
        rest, by each stiffness, mass, length and parameter of the file.
    """

    API: ClassVar = ("recorded/gradients/matrices.py accuracy tolerance=tolerances",)

    sensitivities: bool = False
    tolerance: Tolerance = None

    def add(
        self,
        subject: Any,
        setup: Setup,
        data: dict[str, Any],
        finish: Callable[[Any], Any] = lambda elastic: elastic,
    ) -> list[Table]:
        """Add derivatives and deviations to the JSON object, and return their tables.

        `finish` completes the mechanism after its file was read again. Modes also get
        intervals of their frequencies, for measured springs even without --tolerance.
        """
        elastic, tolerance = subject.elastic, self.tolerance
        is_uncertain = tolerance is not None or elastic.identified is not None
        if not (self.sensitivities or is_uncertain):
            return []
        from cartstiff.answer.analysis.tolerances import Tolerances
        from cartstiff.answer.vibration import answer as answers
        from cartstiff.answer.vibration.modes import Modes
        from cartstiff.recorded.gradients.matrices import accuracy, sensitivities

        def reread(values: Any) -> Any:
            told = {**(setup.parameters or {}), **values}
            return finish(replace(setup, parameters=told).read()[0])

        # Derivatives, then deviations and intervals.
        tables: list[Table] = []
        known, t = None, Tolerances(*(tolerance or ()))
        if self.sensitivities:
            again = reread if elastic.parameters else None
            with Progress("parameters") as bar:
                known = sensitivities(subject, reread=again, progress=bar)
            data["sensitivities"] = known
            tables.append(answers.sensitivity_table(known, elastic.units))
        swings = isinstance(subject, Modes)
        if tolerance is not None or (swings and is_uncertain):
            with Progress("parameters") as bar:
                deviations = accuracy(subject, t, given=known, progress=bar)
            if swings and "frequencies" in deviations.nominal:
                data["intervals"] = deviations.interval.to_dict()
                tables.append(answers.interval_table(subject, deviations.interval))
            if tolerance is not None:
                data["accuracy"] = deviations.to_dict()
                tables.append(answers.accuracy_table(deviations, elastic.units))
        return tables


@dataclass(frozen=True)
class Vibration:
    """Damping."""

    API: ClassVar = ("answer/vibration/response.py Damping damping=ratios",)

    damping: Ratios = None

    @property
    def damped(self) -> Damping:
        """The damping of the options."""
        from cartstiff.answer.vibration.response import Damping

        ratios = tuple(self.damping or (0.0,))
        return Damping(ratios[0] if len(ratios) == 1 else ratios)


@dataclass(frozen=True)
class Rayleigh(Vibration):
    """Damping.

    Parameters
    ----------
    rayleigh
        Damping alpha M + beta K [1/s, s]. Dampers of the mechanism always act.
    """

    RARE: ClassVar = "rayleigh"

    rayleigh: Annotated[_Numbers, Numbers("ALPHA,BETA", 2, low=0)] = None

    @property
    def damped(self) -> Damping:
        """The damping of the options."""
        alpha, beta = self.rayleigh or (0.0, 0.0)
        return replace(super().damped, mass=alpha, stiffness=beta)
