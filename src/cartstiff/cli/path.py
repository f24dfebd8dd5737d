"""``cartstiff path``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from cartstiff.cli.options import (
    DIRECTION,
    PICTURE,
    WRENCH,
    Axes,
    JointValues,
    LoadRequest,
    MechanismRequest,
    OutputFile,
    UnitsCommand,
    Values,
    choice,
    column_factors,
    count,
    flag,
    json_option,
    load_options,
    mechanism_options,
    option,
    option_group,
    progress_option,
    repeated_option,
    vibration_options,
)
from cartstiff.cli.output import Progress, tell
from cartstiff.errors import InputError, check_name
from cartstiff.matrix_names import OF_MANY

_EPILOG = """\b
Examples:
  cartstiff path ur5 seam.csv --free-axis x --load 0,0,0,-120,0,30
  cartstiff path panda seam.csv --criterion translation_free_min --csv commands.csv
  cartstiff path ur5 seam.csv --free-axis x --criterion along_free --direction 1,0,0 --plot k.png
  cartstiff path ur5 seam.csv --free-axis x --load 0,0,0,-120,0,30 --loaded --load-kind follower
  cartstiff path ur5 seam.csv --free-axis x --load 0,0,0,-120,0,0 --range elbow_joint=0:2.6 \\
      --near 0,-1.2,1.5,0,1,0 --collisions
  cartstiff path ur5 part.csv --free-axis x --load 0,0,0,-120,0,0 --place x=0.4:0.6:3,y=-0.2:0.2:5
"""
# A finer grid of places would take days.
_MOST_PLACES = 10_000


_options = option_group(
    option(
        "--free-axis",
        click.Choice(["x", "y", "z"]),
        "The body may turn about this axis of its own frame, the tool's axis.",
    ),
    flag("--free-rotation", "The body may turn in any way."),
    option(
        "--redundant",
        None,
        "The spare joint whose position is sampled; default: the one that moves most.",
        metavar="JOINT",
    ),
    option(
        "--load wrench",
        WRENCH,
        "Wrench on the body, the same at all points: moment about and force at the point "
        "--load-at.",
    ),
    load_options("loads and directions"),
    option(
        "--direction", DIRECTION, "Direction along which stiffness counts, the same at all points."
    ),
    option(
        "--axes",
        click.Choice(["path", "world", "body"]),
        "Axes of loads and directions: those of the file's poses (the default), of F (as "
        "--world), or of the body, which turns by the free rotation as well.",
    ),
    click.option(
        "--criterion",
        default="deflection",
        show_default=True,
        metavar="NAME",
        help="Quantity to optimise: deflection, along_free, translation_free_min, isotropy, ...: "
        "those of `cartstiff map`.",
    ),
    choice(
        "--connection",
        OF_MANY,
        "Stiffness that the criterion is read from; default with --loaded: load, the "
        "tangent under the load "
        "(see --load-kind, --load-at). Without a load all but F are the same.",
    ),
    flag("--loaded", "Read the stiffness under the load, which the springs balance."),
    choice(
        "--objective",
        ["worst", "mean"],
        "Improve the worst point of the path, or the mean of all points.",
        default="worst",
    ),
    option(
        "--max-step",
        JointValues(broadcast=True),
        "Largest step of the joints from point to point: one number for all, one each, or "
        "name=value pairs; default 0.5 rad or half the characteristic length.",
    ),
    option(
        "--singular",
        float,
        "Leave out postures whose smallest singular value is below this share of the "
        "largest; default 0.05.",
        metavar="RATIO",
    ),
    count("--samples", "Values of each free choice.", 3, 720, default=36),
    count("--seed", "Seed of the random starts.", 0, default=0),
    repeated_option(
        "--range ranges",
        Axes("NAME=LOW:HIGH"),
        "Keep a joint within this range, besides its limits.",
    ),
    option(
        "--near",
        JointValues(),
        "Stay in the configuration of this posture: every joint that turns stays within 90 "
        "degrees of it (numbers or name=value pairs; the others as in --q or the file).",
    ),
    flag(
        "--collisions excluded",
        "Leave out postures in which links collide with each other, by the <collision> "
        "shapes of the URDF; without it collisions are not checked.",
    ),
    repeated_option(
        "--place",
        Axes("NAME=LOW:HIGH:COUNT", frame=True),
        "Find the best place of the workpiece: on this grid of x, y, z, yaw, then around the "
        "grid's best point. The file's poses are then those in the workpiece's frame.",
    ),
    option("--csv", OutputFile("FILE.csv", ".csv"), "Write the postures, one line a point."),
    option(
        "--plot",
        PICTURE,
        "Draw the criterion along the path, optimised and with the best constant choice.",
    ),
    option("--plot-places", PICTURE, "Draw the criterion over the places of --place."),
    vibration_options,
    json_option,
    progress_option,
)


@click.command(name="path", cls=UnitsCommand, epilog=_EPILOG)
@mechanism_options(placed=False)
@click.argument("path_file", metavar="PATH.csv", type=click.Path(path_type=Path))
@_options
def command(
    request: MechanismRequest,
    path_file: Path,
    free_axis: str | None,
    free_rotation: bool,
    applied: LoadRequest,
    direction: list[float] | None,
    axes: str | None,
    loaded: bool,
    max_step: Values | None,
    singular: float | None,
    place: dict[str, tuple[float, ...]],
    csv: Path | None,
    plot: Path | None,
    plot_places: Path | None,
    vibration: dict[str, Any],
    ranges: dict[str, tuple[float, ...]],
    near: Values | None,
    excluded: bool,
    progress: bool | None,
    **options: Any,
) -> None:
    """The postures in which MECHANISM is stiffest along a path, and where to put the workpiece.

    PATH.csv has one pose of the body frame a line: x, y, z, roll, pitch, yaw and, if wanted, a
    wrench mx, my, mz, fx, fy, fz; a first line may name the columns, also ax, ay, az for the tool's
    axis alone and dx, dy, dz for a direction.
    """
    if free_rotation and free_axis is not None:
        raise InputError("give --free-axis or --free-rotation, not both")
    if plot_places is not None and not place:
        raise InputError("--plot-places goes with --place")
    if applied.world:
        if axes not in (None, "world"):
            raise InputError("give --world or --axes, not both")
        axes = "world"
    if applied.load_kind != "dead" and not loaded:
        raise InputError(
            "is for the stiffness under load", where="--load-kind", expected="--loaded as well"
        )
    free = "rotation" if free_rotation else free_axis or "none"
    region = _region(place)
    elastic = request.at_posture()

    from cartstiff.cli.tables import read_path_file
    from cartstiff.report.output import write_files
    from cartstiff.report.statics import (
        describe_optimised_path,
        describe_placement,
        draw_path,
        draw_placement,
    )
    from cartstiff.toolpaths.optimise import optimise_path
    from cartstiff.toolpaths.placement import best_placement

    path = read_path_file(
        path_file,
        free=free,
        wrench=request.wrench,
        direction=direction,
        axes=axes,
        units=elastic.units,
        factors=column_factors(elastic),
    )
    options |= {
        "free": free,
        "loaded": loaded,
        "load_kind": applied.load_kind,
        "load_at": applied.acts_at,
        **vibration,
    }
    if max_step is not None:
        options["max_step"] = max_step.of(elastic.names, broadcast=True)
    if singular is not None:
        options["singular"] = singular
    for name, (low, high) in ranges.items():
        check_name("joint", name, elastic.names, "--range")
        if not low <= high:
            raise InputError(
                "values must rise",
                where=f"--range {name}",
                expected="LOW at most HIGH",
                got=f"{low:g}:{high:g}",
            )
    options["ranges"] = ranges
    if near is not None:
        options["near"] = near.of(elastic.names)
    if excluded:
        from cartstiff.loading.collisions import Collisions

        options["collisions"] = Collisions(elastic)
    if not region:
        with Progress("path", progress) as advance:
            result = optimise_path(elastic, path, progress=advance, **options)
        write_files((csv, result.as_csv), (plot, lambda: draw_path(result)))
        tell(
            result.as_dict(),
            elastic.name,
            lambda: describe_optimised_path(result, is_written=csv is not None),
        )
        return
    with Progress("places", progress) as advance:
        placement = best_placement(elastic, path, region, progress=advance, **options)
    write_files(
        (csv, placement.path.as_csv),
        (plot, lambda: draw_path(placement.path)),
        (plot_places, lambda: draw_placement(placement)),
    )
    tell(
        placement.as_dict(),
        elastic.name,
        lambda: describe_placement(placement, is_written=csv is not None),
    )


def _region(axes: dict[str, tuple[float, ...]]) -> dict[str, Any]:
    """Values of the workpiece's coordinates from --place."""
    if not axes:
        return {}
    import numpy as np

    from cartstiff.toolpaths.placement import COORDINATES

    for name, (low, high, steps) in axes.items():
        check_name("coordinate", name, COORDINATES, "--place")
        if not (high > low or (high == low and steps == 1)):
            raise InputError(
                "values must rise",
                where=f"--place {name}",
                expected="LOW below HIGH",
                got=f"{low:g}:{high:g}",
            )
    total = math.prod(int(count) for _, _, count in axes.values())
    if total > _MOST_PLACES:
        raise InputError(
            "too many places", where="--place", expected=f"at most {_MOST_PLACES}", got=total
        )
    return {name: np.linspace(low, high, int(n)) for name, (low, high, n) in axes.items()}
