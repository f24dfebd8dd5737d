"""``cartstiff path``."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from cartstiff.cli.options import LoadRequest, MechanismRequest, load_options, once, parse_values
from cartstiff.cli.output import output_file, print_json, say
from cartstiff.errors import InputError, UnknownNameError, one_line
from cartstiff.parsing import parse_numbers

__all__ = ["command"]

_EPILOG = """\b
Examples:
  cartstiff path ur5 seam.csv --free-axis x --load 0,0,0,-120,0,30
  cartstiff path panda seam.csv --criterion translation_free_min --csv commands.csv
  cartstiff path ur5 seam.csv --free-axis x --criterion along_free --direction 1,0,0 --plot k.png
  cartstiff path ur5 seam.csv --free-axis x --load 0,0,0,-120,0,30 --loaded --load-kind follower
  cartstiff path ur5 part.csv --free-axis x --load 0,0,0,-120,0,0 --place x=0.4:0.6:3,y=-0.2:0.2:5
"""
_Command = TypeVar("_Command", bound=Callable[..., Any])
# A finer grid of places would take days.
_MOST_PLACES = 10_000


def _single(*names: str, **settings: Any) -> Callable[[_Command], _Command]:
    """An option that must not be given twice."""
    return click.option(*names, multiple=True, callback=once, **settings)


@click.command(name="path", epilog=_EPILOG)
@click.argument("mechanism")
@click.argument("path_file", metavar="PATH.csv")
@_single("--frame", metavar="NAME", help="Body frame M: a link or site.")
@_single(
    "--stiffness",
    "stiffness_text",
    metavar="VALUES",
    help="Joint (or leg) stiffnesses: one number for all, one each, or name=value pairs.",
)
@_single(
    "--free-axis",
    type=click.Choice(["x", "y", "z"]),
    help="The body may turn about this axis of its own: that of the tool.",
)
@click.option("--free-rotation", is_flag=True, help="The body may turn as it likes.")
@_single(
    "--redundant",
    metavar="JOINT",
    help="The spare joint whose position is sampled; default: the one that moves most.",
)
@_single(
    "--load",
    "load_text",
    metavar="MX,MY,MZ,FX,FY,FZ",
    help="Wrench on the body, the same at all points: moment about and force at the point "
    "--load-at.",
)
@load_options(kinds=True, world="loads and directions")
@_single(
    "--direction",
    "direction_text",
    metavar="X,Y,Z",
    help="Direction along which stiffness counts, the same at all points.",
)
@_single(
    "--axes",
    type=click.Choice(["path", "world", "body"]),
    help="Axes of loads and directions: those of the file's poses (the default), of F (as "
    "--world), or of the body, which turns by the free rotation as well.",
)
@click.option(
    "--criterion",
    default="deflection",
    show_default=True,
    metavar="NAME",
    help="Quantity to make best: deflection, along_free, translation_free_min, "
    "isotropy, ...: those of `cartstiff map`.",
)
@click.option(
    "--connection",
    type=click.Choice(["load", "A", "B", "K", "F"]),
    help="The stiffness that is read; default with --loaded: load, the tangent under the load (see "
    "--load-kind, --load-at). Without a load all but F are the same.",
)
@click.option("--loaded", is_flag=True, help="Read it under the load, which the springs balance.")
@click.option(
    "--objective",
    type=click.Choice(["worst", "mean"]),
    default="worst",
    show_default=True,
    help="Make the worst point best, or the mean.",
)
@_single(
    "--max-step",
    "step_text",
    metavar="VALUES",
    help="Largest step of the joints from point to point: one number for all, one each, or "
    "name=value pairs; default 0.5 rad or half the characteristic length.",
)
@_single(
    "--singular",
    type=float,
    metavar="RATIO",
    help="Leave out postures whose smallest singular value is below this share of the "
    "largest; default 0.05.",
)
@click.option(
    "--samples",
    type=click.IntRange(3, 720),
    default=36,
    show_default=True,
    help="Values of each free choice.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the random starts."
)
@click.option(
    "--place",
    "place_texts",
    metavar="NAME=LOW:HIGH:COUNT",
    multiple=True,
    help="Find the place of the workpiece, whose frame the file's poses are then in, on "
    "this grid of x, y, z, yaw and around its best.",
)
@_single("--csv", "csv_text", metavar="FILE.csv", help="Write the postures, one line a point.")
@_single(
    "--plot",
    "plot_text",
    metavar="FILE.png",
    help="Draw the criterion along the path, optimised and with the best constant choice.",
)
@_single("--plot-places", "places_text", metavar="FILE.png", help="Draw the places compared.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def command(
    mechanism: str,
    path_file: str,
    frame: str | None,
    stiffness_text: str | None,
    free_axis: str | None,
    free_rotation: bool,
    redundant: str | None,
    load_text: str | None,
    applied: LoadRequest,
    direction_text: str | None,
    axes: str | None,
    criterion: str,
    connection: str | None,
    loaded: bool,
    objective: str,
    step_text: str | None,
    singular: float | None,
    samples: int,
    seed: int,
    place_texts: tuple[str, ...],
    csv_text: str | None,
    plot_text: str | None,
    places_text: str | None,
    as_json: bool,
) -> None:
    """The postures in which MECHANISM is stiffest along a path, and where to put the workpiece.

    PATH.csv has one pose of the body frame a line: x, y, z, roll, pitch, yaw and, if wanted, a
    wrench mx, my, mz, fx, fy, fz; a first line may name the columns, also ax, ay, az for the tool's
    axis alone and dx, dy, dz for a direction.
    """
    if free_rotation and free_axis is not None:
        raise InputError("give --free-axis or --free-rotation, not both")
    if places_text is not None and not place_texts:
        raise InputError("--plot-places goes with --place")
    if applied.axes == "world":
        if axes not in (None, "world"):
            raise InputError("give --world or --axes, not both")
        axes = "world"
    if applied.kind != "dead" and not loaded:
        raise InputError("is for the stiffness under load", where="--load-kind",
                         expected="--loaded as well")  # fmt: skip
    free = "rotation" if free_rotation else free_axis or "none"
    csv = None if csv_text is None else output_file(csv_text, (".csv",), "--csv")
    pictures = (".png", ".svg", ".pdf")
    plot = None if plot_text is None else output_file(plot_text, pictures, "--plot")
    places = None if places_text is None else output_file(places_text, pictures, "--plot-places")
    wrench = None if load_text is None else parse_numbers(load_text, "--load", 6)
    direction = None if direction_text is None else parse_numbers(direction_text, "--direction", 3)
    region = _region(place_texts)
    elastic, _ = MechanismRequest(mechanism, frame=frame, stiffness_text=stiffness_text).load()

    from cartstiff.cli.path_file import read_path_file
    from cartstiff.report.toolpaths import describe_optimised_path, describe_placement
    from cartstiff.toolpaths.optimise import optimise_path
    from cartstiff.toolpaths.placement import best_placement

    path = read_path_file(Path(path_file), free=free, wrench=wrench, direction=direction, axes=axes)
    options: dict[str, Any] = {
        "free": free, "redundant": redundant, "criterion": criterion, "connection": connection,
        "loaded": loaded, "objective": objective, "samples": samples, "seed": seed,
        "load_kind": applied.kind, "load_at": applied.at,
    }  # fmt: skip
    if step_text is not None:
        options["max_step"] = parse_values(step_text, "--max-step", elastic.names, broadcast=True)
    if singular is not None:
        options["singular"] = singular
    if region is None:
        result = optimise_path(elastic, path, **options)
        _save(result, None, csv, plot, places)
        answer, text = result.as_dict(), describe_optimised_path(result)
    else:
        placement = best_placement(elastic, path, region, **options)
        _save(placement.path, placement, csv, plot, places)
        answer, text = placement.as_dict(), describe_placement(placement)
    if as_json:
        print_json(answer, elastic.name)
    else:
        say(text)


def _region(texts: tuple[str, ...]) -> dict[str, Any] | None:
    """Values of the workpiece's coordinates from --place."""
    if not texts:
        return None
    import numpy as np

    from cartstiff.cli.map_options import parse_axes
    from cartstiff.toolpaths.placement import PLACES

    axes = parse_axes(texts, "--place")
    for name, (low, high, count) in axes.items():
        if name not in PLACES:
            raise UnknownNameError("coordinate", name, PLACES, where="--place")
        if not (high > low or (high == low and count == 1)):
            raise InputError("values must rise", where=f"--place {name}", expected="LOW below HIGH",
                             got=f"{low:g}:{high:g}")  # fmt: skip
    total = math.prod(int(count) for _, _, count in axes.values())
    if total > _MOST_PLACES:
        raise InputError("too many places", where="--place", expected=f"at most {_MOST_PLACES}",
                         got=total)  # fmt: skip
    return {name: np.linspace(low, high, int(n)) for name, (low, high, n) in axes.items()}


def _save(
    result: Any, placement: Any, csv: Path | None, plot: Path | None, places: Path | None
) -> None:
    """Write what was asked for; everything is made before anything is written."""
    from cartstiff.report.figures_statics import picture
    from cartstiff.report.figures_toolpaths import draw_path, draw_placement
    from cartstiff.report.output import write_whole

    files = []
    if csv is not None:
        files.append((csv, result.as_csv().encode()))
    if plot is not None:
        files.append((plot, picture(draw_path(result), plot.suffix)))
    if places is not None:
        files.append((places, picture(draw_placement(placement), places.suffix)))
    for file, _ in files:
        if not file.parent.is_dir():
            raise InputError("file cannot be written", where=one_line(str(file)),
                             got="no such folder")  # fmt: skip
    for file, data in files:
        write_whole(file, data)
