"""Options that several commands share, and how their text becomes numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from cartstiff.errors import InputError, UnknownNameError, one_line

__all__ = ["load_with_options", "mechanism_options", "once", "parse_numbers", "parse_values"]

# As in mechanism files: beyond this the products leave the range of double precision.
_LARGEST = 1e30
_Command = TypeVar("_Command", bound=Callable[..., Any])


def parse_numbers(text: str, option: str, count: int | None = None) -> list[float]:
    """Comma-separated finite numbers.

    Raises
    ------
    InputError
        Naming the option, what was expected, and what was given.
    """
    parts = [part.strip() for part in text.split(",")]
    numbers = []
    for part in parts:
        try:
            number = float(part)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or "_" in part:
            expected = (
                "numbers separated by commas" if count is None
                else "a number" if count == 1
                else f"{count} numbers separated by commas"
            )  # fmt: skip
            raise InputError("not a finite number", where=option, expected=expected, got=repr(part))
        if abs(number) > _LARGEST:
            raise InputError(
                "number is too large", where=option, expected=f"at most {_LARGEST:g}", got=part
            )
        numbers.append(number)
    if count is not None and len(numbers) != count:
        raise InputError(
            "wrong count", where=option, expected=f"{count} numbers", got=str(len(numbers))
        )
    return numbers


def parse_values(
    text: str, option: str, names: tuple[str, ...], broadcast: bool = False
) -> float | list[float] | dict[str, float]:
    """Values for joints: numbers in joint order, ``name=value`` pairs, or one number for all."""
    if "=" not in text:
        numbers = parse_numbers(text, option)
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
        values[name] = parse_numbers(number, f"{option} {name}", 1)[0]
    return values


def once(context: click.Context, option: click.Parameter, values: tuple[Any, ...]) -> Any:
    """Callback of options (``multiple=True``) that must not be given twice."""
    if len(values) > 1:
        raise click.BadParameter("given more than once", ctx=context, param=option)
    return values[0] if values else None


def mechanism_options(command: _Command) -> _Command:
    """Argument MECHANISM and the options that place and load it."""
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
            help="Joint (or leg) stiffnesses: one number for all, one each, or name=value pairs.",
        ),
        click.option(
            "--rest", "rest_text", metavar="VALUES", multiple=True, callback=once,
            help="Rest positions of the joints (rest lengths of legs), as for --q.",
        ),
    ]  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


def load_with_options(
    mechanism: str,
    frame: str | None,
    q_text: str | None,
    pose_text: str | None,
    stiffness_text: str | None,
    rest_text: str | None,
    lengths_text: str | None = None,
) -> tuple[Any, Any]:
    """The elastic mechanism and its coordinates (None for the default) from the options."""
    from cartstiff.mechanisms.loading import load

    try:
        Path(mechanism).expanduser()
    except RuntimeError:
        raise InputError("the home directory is not known", where=one_line(mechanism)) from None
    if frame is not None and not 0 < len(one_line(frame, 4000)) < 4000:
        raise InputError("unknown frame", where="--frame", expected="a name", got=repr(frame))
    elastic = load(mechanism, frame=frame)
    is_platform = elastic.mechanism.kind in ("stewart-gough", "springs")
    if pose_text is not None:
        if not is_platform:
            raise InputError(
                "is for platforms", where="--pose", expected=f"--q for {elastic.mechanism.kind}"
            )
        if q_text is not None:
            raise InputError("give --q or --pose, not both")
    if lengths_text is not None and (q_text is not None or pose_text is not None):
        raise InputError("give --lengths or a pose, not both")
    q: Any = None
    if lengths_text is not None:
        from cartstiff.mechanisms.platform import Platform

        if not isinstance(elastic.mechanism, Platform):
            raise InputError("is for platforms", where="--lengths", expected="--q")
        lengths = parse_numbers(lengths_text, "--lengths", len(elastic.spring_names))
        q = elastic.mechanism.forward_kinematics(lengths, elastic.q)
    elif pose_text is not None:
        q = parse_numbers(pose_text, "--pose", 6)
    elif q_text is not None:
        q = parse_values(q_text, "--q", elastic.names)
    names = elastic.spring_names
    are_lines = names != elastic.names
    stiffness = rest = None
    if stiffness_text is not None:
        stiffness = parse_values(stiffness_text, "--stiffness", names, broadcast=True)
        _check_range(stiffness, "--stiffness", "above zero" if are_lines else "zero or more")
    if rest_text is not None:
        rest = parse_values(rest_text, "--rest", names)
        if are_lines:
            _check_range(rest, "--rest", "zero or more")
    return elastic.with_springs(stiffness, rest), q


def _check_range(
    values: float | list[float] | dict[str, float], option: str, expected: str
) -> None:
    """Refuse numbers below zero, and zero itself where `expected` is "above zero"."""
    if isinstance(values, dict):
        values = list(values.values())
    for value in values if isinstance(values, list) else [values]:
        if value < 0 or (value == 0 and expected == "above zero"):
            raise InputError("cannot be used", where=option, expected=expected, got=f"{value:g}")
        if 0 < value < 1 / _LARGEST:
            raise InputError("number is too small", where=option,
                             expected=f"{expected}, at least {1 / _LARGEST:g}",
                             got=f"{value:g}")  # fmt: skip
