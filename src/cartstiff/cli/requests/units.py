"""``--units``: numbers of options become those of the mechanism's units, and radians."""

from __future__ import annotations

import math
from typing import Any

import click

from cartstiff.cli.types import Factors, OptionType

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
        if isinstance(units, str):  # of identify, which has forces as well
            from cartstiff.cli.requests.identify import units_of

            units = units_of(units)
        is_json = self.has_json_of_file and ctx.params.get("as_json")
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
    from cartstiff.cli.options import MechanismRequest
    from cartstiff.mechanisms.contract import Units, convert_length

    read = ("mechanism", "frame", "gravity", "xacro_args", "package_path", "parameters")
    request = MechanismRequest(**{k: v for k, v in ctx.params.items() if k in read})
    elastic = request.bare(request.frame)
    a = 1.0 if length is None else convert_length(Units(length), elastic.units)[0]
    for option in ctx.command.params:
        value = ctx.params.get(option.name or "")
        if value is not None and isinstance(option.type, OptionType):
            converted = option.type.converted(value, Factors(a, angle), elastic)
            ctx.params[str(option.name)] = converted
    if length is not None:
        if isinstance(ctx.params["units"], dict):
            ctx.params["units"]["length"] = elastic.units.length
        ctx.meta[_FACTOR] = a
