"""Options that several commands share: which mechanism, in which posture, under which load."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cartstiff.choices import LARGEST_INPUT, LOAD_KINDS
from cartstiff.cli.output import JSON, Progress
from cartstiff.cli.types import (
    DIRECTION,
    PAYLOAD,
    POINT,
    POSE,
    TCP,
    TOLERANCE,
    WRENCH,
    Arguments,
    Factors,
    JointValues,
    Numbers,
    OptionType,
    Pairs,
    UnitList,
    Values,
    choice,
    file_option,
    flag,
    gathered,
    option,
    option_group,
    repeated_option,
)
from cartstiff.errors import InputError, one_line

if TYPE_CHECKING:
    from cartstiff.vibration.modes import Modes
    from cartstiff.vibration.sensitivities import Sensitivities


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
