"""``--units`` beside ``--json``: numbers are given in these units, the answer is in the file's."""

from __future__ import annotations

from typing import Any

import click

from cartstiff.cli.types import OptionType

_FACTOR = "cartstiff.given_length"


class JsonUnitsCommand(click.Command):
    """A command whose JSON is in the units of the mechanism's file, whatever --units says.

    The options' numbers are converted before the command sees them.
    """

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        units = ctx.params.get("units")
        if isinstance(units, str):  # of identify, which has forces as well
            from cartstiff.cli.requests.identify import units_of

            units = units_of(units)
        given = (units or {}).get("length")
        if given is not None and ctx.params.get("as_json"):
            _convert(ctx, given)
        return super().invoke(ctx)


def given_length() -> float:
    """The unit of length of numbers that are given, in the one that is computed in."""
    context = click.get_current_context(silent=True)
    return 1.0 if context is None else float(context.meta.get(_FACTOR, 1.0))


def column_factors(elastic: Any) -> dict[str, float]:
    """Factors of columns whose head names no unit: angles, and what has lengths in its unit."""
    from cartstiff.mechanisms.other_units import shown_factors

    a = given_length()
    lengths = [*(c.name for c in elastic.mechanism.coordinates if c.is_length),
               "x", "y", "z", "mx", "my", "mz"]  # fmt: skip
    return {**({} if a == 1.0 else dict.fromkeys(lengths, a)), **shown_factors(elastic)}


def _convert(ctx: click.Context, given: str) -> None:
    from cartstiff.cli.options import MechanismRequest
    from cartstiff.mechanisms.contract import Units, convert_length

    read = ("mechanism", "frame", "xacro_args", "package_path", "parameters")
    request = MechanismRequest(**{k: v for k, v in ctx.params.items() if k in read})
    elastic = request.in_frame(request.frame)
    a, _ = convert_length(Units(given), elastic.units)
    for option in ctx.command.params:
        value = ctx.params.get(option.name or "")
        if value is not None and isinstance(option.type, OptionType):
            ctx.params[str(option.name)] = option.type.converted(value, a, elastic)
    if isinstance(ctx.params["units"], dict):
        ctx.params["units"]["length"] = elastic.units.length
    ctx.meta[_FACTOR] = a
