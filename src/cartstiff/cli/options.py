"""Options that several commands share, and how their text becomes numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Any

import click

from cartstiff.errors import InputError, UnknownNameError, one_line
from cartstiff.parsing import LARGEST, parse_numbers

__all__ = ["LoadRequest", "MechanismRequest", "load_options", "mechanism_options", "once",
           "parse_values"]  # fmt: skip

#: As `cartstiff.stiffness.applied_load.LOAD_KINDS`, which would load NumPy for --help.
LOAD_KINDS = ("dead", "follower", "conservative")

_BALANCED = (
    "Wrench on the body in its own frame; rest positions are chosen so that the springs balance it."
)


def parse_values(
    text: str, option: str, names: tuple[str, ...], broadcast: bool = False, rigid: bool = False
) -> float | list[float] | dict[str, float]:
    """Values for joints: numbers in joint order, ``name=value`` pairs, or one number for all."""
    if "=" not in text:
        numbers = parse_numbers(text, option, rigid=rigid)
        if broadcast and len(numbers) == 1:
            return numbers[0]
        if len(numbers) != len(names):
            raise InputError(
                "wrong count", where=option,
                expected=f"{len(names)} numbers ({', '.join(names)})", got=str(len(numbers)),
            )  # fmt: skip
        return numbers
    values: dict[str, float] = {}
    for part in text.split(","):
        name, equals, number = part.partition("=")
        name = name.strip()
        if not equals:
            raise InputError(
                "mixes numbers and name=value pairs", where=option, expected="one of the two forms",
                got=repr(part),
            )  # fmt: skip
        if name not in names:
            raise UnknownNameError("joint", name, names, where=option)
        if name in values:
            raise InputError("joint given twice", where=option, got=repr(name))
        values[name] = parse_numbers(number, f"{option} {name}", 1, rigid=rigid)[0]
    return values


def once(context: click.Context, option: click.Parameter, values: tuple[Any, ...]) -> Any:
    """Callback of options (``multiple=True``) that must not be given twice."""
    if len(values) > 1:
        raise click.BadParameter("given more than once", ctx=context, param=option)
    return values[0] if values else None


def mechanism_options(load_help: str = _BALANCED) -> Callable[..., Callable[..., Any]]:
    """Argument MECHANISM and the options that place and load it, as one `MechanismRequest`.

    The command gets it as its keyword ``request``.
    """
    options = [
        click.argument("mechanism"),
        click.option(
            "--q", "q_text", metavar="VALUES", multiple=True, callback=once,
            help="Posture: numbers in joint order or name=value pairs, rad and m.",
        ),
        click.option(
            "--pose", "pose_text", metavar="X,Y,Z,R,P,Y", multiple=True, callback=once,
            help="Posture of a platform: position and roll, pitch, yaw about fixed axes.",
        ),
        click.option(
            "--lengths", "lengths_text", metavar="L1,...,L6", multiple=True, callback=once,
            help="Posture of a six-legged platform by its leg lengths, near the file's pose.",
        ),
        click.option(
            "--frame", metavar="NAME", multiple=True, callback=once,
            help="Body frame M: a link or site.",
        ),
        click.option(
            "--stiffness", "stiffness_text", metavar="VALUES", multiple=True, callback=once,
            help="Joint (or leg) stiffnesses: one number for all, one each, or name=value pairs; "
            "joints may be rigid.",
        ),
        click.option(
            "--rest", "rest_text", metavar="VALUES", multiple=True, callback=once,
            help="Rest positions of the joints (rest lengths of legs), as for --q.",
        ),
        click.option(
            "--load", "load_text", metavar="MX,MY,MZ,FX,FY,FZ", multiple=True, callback=once,
            help=load_help,
        ),
    ]  # fmt: skip

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def with_request(*arguments: Any, **texts: Any) -> Any:
            own = {f.name: texts.pop(f.name) for f in fields(MechanismRequest)}
            return command(*arguments, request=MechanismRequest(**own), **texts)

        for option in reversed(options):
            with_request = option(with_request)
        return with_request

    return decorate


def load_options(*, kinds: bool, world: str = "--load") -> Callable[..., Callable[..., Any]]:
    """Where the load acts and along which axes, as a `LoadRequest` in the keyword ``applied``.

    With `kinds` also what it does while the body moves; `world` names the options whose
    components --world is about.
    """
    options = [
        click.option(
            "--load-at", "load_at_text", metavar="X,Y,Z", multiple=True, callback=once,
            help="Point of the body, in its frame, at which the load acts; default its origin.",
        ),
        click.option(
            "--world", is_flag=True,
            help=f"The components of {world} are along the inertial axes, not those of the body.",
        ),
    ]  # fmt: skip
    if kinds:
        options.append(
            click.option(
                "--load-kind", type=click.Choice(LOAD_KINDS), default="dead", show_default=True,
                help="What the load does while the body moves. dead: force and moment keep their "
                "direction in the room; follower: they turn with the body; conservative: the force "
                "keeps its direction, the moment turns by half.",
            )
        )  # fmt: skip

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def with_load(*arguments: Any, **texts: Any) -> Any:
            at, world = texts.pop("load_at_text"), texts.pop("world")
            applied = LoadRequest(
                (0.0, 0.0, 0.0) if at is None else tuple(parse_numbers(at, "--load-at", 3)),
                "world" if world else "body",
                texts.pop("load_kind", "dead"),
            )
            return command(*arguments, applied=applied, **texts)

        for option in reversed(options):
            with_load = option(with_load)
        return with_load

    return decorate


@dataclass(frozen=True)
class LoadRequest:
    """The texts of `load_options`: point in M, axes "body" or "world", kind."""

    at: tuple[float, ...]
    axes: str
    kind: str


@dataclass(frozen=True)
class MechanismRequest:
    """The texts of `mechanism_options`."""

    mechanism: str
    q_text: str | None = None
    pose_text: str | None = None
    lengths_text: str | None = None
    frame: str | None = None
    stiffness_text: str | None = None
    rest_text: str | None = None
    load_text: str | None = None

    @property
    def wrench(self) -> list[float] | None:
        """The six numbers of --load."""
        return None if self.load_text is None else parse_numbers(self.load_text, "--load", 6)

    @property
    def balanced_wrench(self) -> list[float] | None:
        """The same, where rest positions follow from it and cannot be given as well."""
        if self.load_text is not None and self.rest_text is not None:
            raise InputError("give --load or --rest, not both: one follows from the other")
        return self.wrench

    def load(self) -> tuple[Any, Any]:
        """The elastic mechanism, and its coordinates or None for the default posture."""
        from cartstiff.loading import load

        try:
            Path(self.mechanism).expanduser()
        except RuntimeError:
            raise InputError(
                "the home directory is not known", where=one_line(self.mechanism)
            ) from None
        frame = self.frame
        if frame is not None and not 0 < len(one_line(frame, 4000)) < 4000:
            raise InputError("unknown frame", where="--frame", expected="a name", got=repr(frame))
        elastic = load(self.mechanism, frame=frame)
        q = self._coordinates(elastic)
        names = elastic.spring_names
        are_lines = names != elastic.names
        stiffness = rest = None
        if self.stiffness_text is not None:
            stiffness = parse_values(
                self.stiffness_text, "--stiffness", names, broadcast=True, rigid=not are_lines
            )
            _check_range(stiffness, "--stiffness", "above zero" if are_lines else "zero or more")
        if self.rest_text is not None:
            rest = parse_values(self.rest_text, "--rest", names)
            if are_lines:
                _check_range(rest, "--rest", "zero or more")
        return elastic.with_springs(stiffness, rest), q

    def _coordinates(self, elastic: Any) -> Any:
        """Coordinates from --q, --pose or --lengths; None without any."""
        kind = elastic.mechanism.kind
        if self.pose_text is not None:
            if kind not in ("stewart-gough", "springs"):
                raise InputError("is for platforms", where="--pose", expected=f"--q for {kind}")
            if self.q_text is not None:
                raise InputError("give --q or --pose, not both")
        if self.lengths_text is not None:
            from cartstiff.mechanisms.platform import Platform

            if self.q_text is not None or self.pose_text is not None:
                raise InputError("give --lengths or a pose, not both")
            if not isinstance(elastic.mechanism, Platform):
                raise InputError("is for platforms", where="--lengths", expected="--q")
            lengths = parse_numbers(self.lengths_text, "--lengths", len(elastic.spring_names))
            return elastic.mechanism.forward_kinematics(lengths, elastic.q)
        if self.pose_text is not None:
            return parse_numbers(self.pose_text, "--pose", 6)
        if self.q_text is not None:
            return parse_values(self.q_text, "--q", elastic.names)
        return None


def _check_range(
    values: float | list[float] | dict[str, float], option: str, expected: str
) -> None:
    """Refuse numbers below zero, and zero itself where `expected` is "above zero"."""
    if isinstance(values, dict):
        values = list(values.values())
    for value in values if isinstance(values, list) else [values]:
        if value < 0 or (value == 0 and expected == "above zero"):
            raise InputError("cannot be used", where=option, expected=expected, got=f"{value:g}")
        if 0 < value < 1 / LARGEST:
            raise InputError("number is too small", where=option,
                             expected=f"{expected}, at least {1 / LARGEST:g}",
                             got=f"{value:g}")  # fmt: skip
