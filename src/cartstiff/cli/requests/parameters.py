"""What the parameters of a mechanism do, for every command that asks it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from cartstiff.cli.types import Numbers, option
from cartstiff.errors import InputError

if TYPE_CHECKING:
    from cartstiff.cli.options import MechanismRequest

__all__ = ["add_accuracy", "add_sensitivities", "checked_tolerance", "sensitivities_option",
           "tolerance_option"]  # fmt: skip

sensitivities_option = click.option(
    "--sensitivities", is_flag=True,
    help="Also print the derivatives of the stiffness, of the frequencies and of the pose at rest, "
    "by each stiffness, mass, length and parameter of the file.",
)  # fmt: skip


def tolerance_option(gives: str) -> Any:
    """Standard deviations of the parameters."""
    return option(
        "--tolerance", type=Numbers("REL[,LENGTH[,ANGLE]]", 1, 2, 3),
        help="Standard deviations: relative of every spring stiffness, absolute of every length "
        f"and rotation (rad) of the geometry. The answer has {gives}.",
    )  # fmt: skip


def checked_tolerance(numbers: list[float] | None) -> None:
    """Refuse numbers below zero, and zeros alone."""
    if numbers is not None and (min(numbers) < 0.0 or not any(numbers)):
        raise InputError("cannot be used", where="--tolerance",
                         expected="zero or more, not all zero", got=numbers)  # fmt: skip


def add_sensitivities(
    subject: Any, request: MechanismRequest, data: dict[str, Any],
    finish: Callable[[Any], Any] = lambda elastic: elastic,
) -> list[str]:  # fmt: skip
    """Adds the derivatives to the JSON object, and gives them as lines.

    `finish` is what becomes of the mechanism after its file was read.
    """
    from cartstiff.report.modes import describe_sensitivities
    from cartstiff.vibration.sensitivities import sensitivities

    def reread(values: Any) -> Any:
        told = {**(request.parameters or {}), **values}
        return finish(replace(request, parameters=told).load()[0])

    elastic = subject.elastic
    known = sensitivities(subject, reread=reread if elastic.parameters else None)
    data["sensitivities"] = known.as_dict()
    return describe_sensitivities(known, elastic.units)


def add_accuracy(subject: Any, numbers: list[float], data: dict[str, Any]) -> list[str]:
    """Adds what the tolerances leave to the JSON object, and gives it as lines."""
    from cartstiff.analysis.tolerances import Tolerances
    from cartstiff.report.modes import describe_accuracy
    from cartstiff.vibration.accuracy import accuracy

    known = accuracy(subject, Tolerances(*numbers))
    data["accuracy"] = known.as_dict()
    return describe_accuracy(known, subject.elastic.units)
