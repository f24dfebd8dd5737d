"""What the parameters of a mechanism do, for every command that asks it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from cartstiff.cli.output import Progress
from cartstiff.cli.types import TOLERANCE, option
from cartstiff.errors import InputError

if TYPE_CHECKING:
    from cartstiff.cli.options import MechanismRequest
    from cartstiff.vibration.mode_set import Modes
    from cartstiff.vibration.sensitivities import Sensitivities

_LABEL = "parameters"

sensitivities_option = click.option(
    "--sensitivities",
    is_flag=True,
    help="Also print the derivatives of the stiffness, of the frequencies and of the pose at rest, "
    "by each stiffness, mass, length and parameter of the file.",
)


def tolerance_option(gives: str) -> Any:
    """Standard deviations of the parameters."""
    return option(
        "--tolerance",
        type=TOLERANCE,
        help="Standard deviations: relative of every spring stiffness, absolute of every length "
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
    """Adds what the tolerances leave to the JSON object, and gives it as lines."""
    from cartstiff.analysis.tolerances import Tolerances
    from cartstiff.report.modes import describe_accuracy
    from cartstiff.vibration.accuracy import accuracy

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
    from cartstiff.vibration.accuracy import intervals
    from cartstiff.vibration.sensitivities import sensitivities

    t = Tolerances(*(numbers or ()))
    if given is None and t.any:
        with Progress(_LABEL) as bar:
            given = sensitivities(modes, geometry=bool(t.length or t.angle), progress=bar)
    band = intervals(modes, t, given=given)
    data["intervals"] = band.as_dict()
    return describe_intervals(modes, band), given
