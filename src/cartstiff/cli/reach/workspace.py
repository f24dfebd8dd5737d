"""``cartstiff workspace``."""

from __future__ import annotations

from pathlib import Path

import click

from cartstiff.choices import TENSIONS, Distribution
from cartstiff.cli.options import (
    LoadRequest,
    MechanismRequest,
    UnitsCommand,
    load_options,
    mechanism_options,
)
from cartstiff.cli.output import Progress, tell
from cartstiff.cli.types import (
    PICTURE,
    POSE,
    Number,
    OutputFile,
    choice,
    count,
    flag,
    json_option,
    option,
    option_group,
    progress_option,
)
from cartstiff.errors import InputError, UndefinedError

_EPILOG = """\b
Examples:
  cartstiff workspace hexapod
  cartstiff workspace hexapod --pose 0,0,0.7,0.1,0,0 --plot workspace.png --csv boundary.csv
  cartstiff workspace cable-robot --radius 2 --load 0,0,0,0,0,-50 --world --json
"""

_options = option_group(
    option(
        "--pose",
        POSE,
        "Orientation that is kept, and position around which rotations are tried: "
        "position and roll, pitch, yaw about fixed axes; default the file's.",
    ),
    count(
        "--directions",
        "Number of rays and columns, roughly; default 1000, or 200 for tensions "
        "and for legs made of joints.",
        8,
        1_000_000,
    ),
    count(
        "--scan",
        "Poses along each ray; parts that are thinner than a step may be missed.",
        2,
        100_000,
        default=48,
    ),
    option(
        "--radius",
        Number("LENGTH", power=1, above_zero=True),
        "Farthest position that is tried; default as far as the longest lengths allow.",
    ),
    choice(
        "--tensions",
        TENSIONS,
        "Which tensions of cables count: any within their limits, or those in closed "
        "form that are nearest to the middle of the limits.",
        default="any",
    ),
    flag("--through-singularities", "Also count poses beyond singular ones."),
    option(
        "--csv",
        OutputFile("FILE.csv", ".csv"),
        "Write the boundary: positions, and the limit that cuts each. `cartstiff view "
        "MECHANISM --workspace` draws it on the page.",
    ),
    option("--plot", PICTURE, "Draw the boundary in space, from above and from two sides."),
    progress_option,
    json_option,
    flag("--strict", "Exit with code 3 where architecture or orientation is singular."),
)


@click.command(name="workspace", cls=UnitsCommand, epilog=_EPILOG)
@mechanism_options(
    "Wrench on the body in its own frame at the pose the rays start from, where forces or "
    "tensions are limited.",
    placed=False,
    loaded=True,
)
@load_options("--load")
@_options
def command(
    request: MechanismRequest,
    applied: LoadRequest,
    directions: int | None,
    scan: int,
    radius: float | None,
    tensions: Distribution,
    through_singularities: bool,
    csv: Path | None,
    plot: Path | None,
    progress: bool | None,
    as_json: bool,
    strict: bool,
) -> None:
    """Workspace of MECHANISM (a platform, cable robot or body on legs) within all its limits.

    The answer has the volume and its slices for one orientation, the rotations at one position,
    the share of the boundary that each limit cuts, the largest sphere and cube inside, and the
    distance to singular poses.
    """
    if request.stiffness is not None:
        raise InputError(
            "stiffness does not bear on where a body can be",
            where="--stiffness",
            expected="no stiffness",
        )
    applied.check_load(request.wrench is not None)
    applied.check_world(load=request.wrench)
    elastic, q = request.load()

    from cartstiff.reach.workspace import workspace
    from cartstiff.report.output import write_files
    from cartstiff.report.reach import boundary_csv, describe_workspace, draw_workspace

    with Progress("poses", progress) as bar:
        reached = workspace(
            elastic,
            q,
            wrench=request.wrench,
            **applied.keywords(request.wrench),
            directions=directions,
            scan=scan,
            radius=radius,
            through_singularities=through_singularities,
            tensions=tensions,
            progress=bar,
        )
    write_files((csv, lambda: boundary_csv(reached)), (plot, lambda: draw_workspace(reached)))
    tell(as_json, reached.as_dict(), request.mechanism, lambda: describe_workspace(reached))
    if strict and reached.positions is None:
        note = reached.notes[-1]
        raise UndefinedError(note.message, code=note.code, values=dict(note.values))
