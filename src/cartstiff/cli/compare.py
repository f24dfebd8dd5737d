"""``cartstiff compare``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from cartstiff.cli.output import say
from cartstiff.cli.types import PICTURE, Pairs, flag, json_option, option, repeated_option

_EPILOG = """\b
Examples:
  cartstiff compare wall.zarr ceiling.zarr --picture ratio.png
  cartstiff compare ur10.zarr kr210.zarr --quantity deflection --difference --json
"""


@click.command(name="compare", epilog=_EPILOG)
@click.argument("first", metavar="FIRST.zarr", type=click.Path(path_type=Path))
@click.argument("second", metavar="SECOND.zarr", type=click.Path(path_type=Path))
@click.option(
    "--quantity", metavar="NAME", help="Quantity to compare; default the first that both maps hold."
)
@flag("--difference", "The first map minus the second, instead of the first over the second.")
@repeated_option(
    "--slice cuts", Pairs("NAME=VALUE"), "Only the part of both maps at this value of an axis."
)
@option("--picture", PICTURE, "Draw it to a .png, .svg or .pdf file.")
@json_option
def command(
    first: Path,
    second: Path,
    quantity: str | None,
    difference: bool,
    cuts: dict[str, float],
    picture: Path | None,
    as_json: bool,
) -> None:
    """Ratio or difference of two maps of the same places: two arms, two mountings.

    FIRST and SECOND are maps of `cartstiff map`, over the same axes. At a place with several
    branches each map's best one counts.
    """
    from cartstiff.maps.across import compare_maps, compared
    from cartstiff.maps.reading import places_of, quantities_of, slice_map
    from cartstiff.maps.store import open_map

    a, b = (open_map(path) for path in (first, second))
    if quantity is None:
        both = [name for name in quantities_of(a) if name in quantities_of(b)]
        quantity = both[0] if both else quantities_of(a)[0]
    cuts = {name.replace("/", "."): value for name, value in cuts.items()}
    a, b = (slice_map(data, **cuts) if cuts else data for data in (a, b))
    result = compare_maps(a, b, quantity, "difference" if difference else "ratio")
    answer = {
        "schema": "cartstiff-compare/1",
        "quantity": quantity,
        "how": "difference" if difference else "ratio",
        "first": str(first),
        "second": str(second),
        **compared(result, quantity),
        "slice": places_of(a, cuts),
    }
    if picture is not None:
        from cartstiff.maps.pictures import draw_map
        from cartstiff.report.output import save_figure

        save_figure(draw_map(result, quantity), picture)
    if as_json:
        say(json.dumps(answer, allow_nan=False))
        return
    from cartstiff.report.maps import describe_comparison

    say(describe_comparison(answer, str(result[quantity].attrs["long_name"])))
