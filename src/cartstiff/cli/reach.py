"""``cartstiff assemble`` and ``workspace``: where a mechanism can be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from cartstiff.choices import TENSIONS, Distribution
from cartstiff.cli.options import (
    PICTURE,
    POSE,
    LoadRequest,
    MechanismRequest,
    Number,
    Numbers,
    OutputFile,
    UnitsCommand,
    choice,
    count,
    flag,
    json_option,
    load_options,
    mechanism_options,
    option,
    option_group,
    progress_option,
)
from cartstiff.cli.output import Progress, tell
from cartstiff.errors import InputError, UndefinedError

_ASSEMBLE_EXAMPLES = """\b
Examples:
  cartstiff assemble hexapod --all
  cartstiff assemble stewart-simscape --all --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --json
  cartstiff assemble hexapod --all --load 0,0,0,0,0,-500 --world
  cartstiff assemble five-bar --all --csv modes.csv
"""

_assemble_options = option_group(
    option(
        "--pose",
        POSE,
        "Pose of a platform: its leg lengths are taken, and the modes nearest to it "
        "come first. Position and roll, pitch, yaw about fixed axes; default the file's.",
    ),
    option(
        "--lengths",
        Numbers("L1,...,L6", 6, powers=(1,), above_zero=True),
        "Leg lengths of a platform; default those at its pose.",
    ),
    flag("--all every", "All assembly modes; without it the one nearest to the pose."),
    option(
        "--starts",
        click.IntRange(0, 100_000),
        "Random starts, for closed chains; default 64. Platforms need none.",
    ),
    option("--seed", click.IntRange(0), "Seed of the starts; default 0."),
    option("--csv", OutputFile("FILE.csv", ".csv"), "Write a table of the modes."),
    json_option,
    flag("--strict", "Exit with code 3 where no mode exists, or some may be missing."),
)


@click.command(name="assemble", cls=UnitsCommand, epilog=_ASSEMBLE_EXAMPLES)
@mechanism_options(
    "Wrench on the body in its own frame. The held legs or actuators carry it in every mode, and "
    "the stiffness is the one under this load.",
    placed=False,
    loaded=True,
)
@load_options("--load")
@_assemble_options
def assemble_command(
    request: MechanismRequest,
    applied: LoadRequest,
    every: bool,
    starts: int | None,
    seed: int | None,
    csv: Path | None,
    strict: bool,
) -> None:
    """Assembly modes of MECHANISM: all poses with the same leg lengths, or actuator positions.

    For a six-legged platform all modes are found: the 40 complex solutions of a general platform
    are followed to those of this one, and the answer says where each of them ended. For a closed
    chain the actuated joints stay where --q puts them, and the chain is closed from random starts.
    """
    applied.check_load(request.wrench is not None)
    applied.check_world(load=request.wrench)
    lengths = request.lengths
    elastic, q = replace(request, lengths=None).load()
    from cartstiff.mechanisms.platform import Platform
    from cartstiff.reach.assembly import assemble
    from cartstiff.report.output import write_whole
    from cartstiff.report.reach import assembly_csv, describe_assembly

    if lengths is not None and not isinstance(elastic.mechanism, Platform):
        raise InputError("is for platforms", where="--lengths", expected="--q")
    with Progress("starts") as bar:
        modes = assemble(
            elastic,
            lengths,
            q=q,
            starts=starts,
            seed=seed,
            every=every,
            progress=bar,
            wrench=request.wrench,
            **applied.keywords(request.wrench),
        )
    if csv is not None:
        write_whole(csv, assembly_csv(modes).encode())
    tell(modes.as_dict(), request.mechanism, lambda: describe_assembly(modes))
    if strict and (not modes.modes or any(note.code == "paths-lost" for note in modes.notes)):
        note = modes.notes[-1] if modes.notes else None
        raise UndefinedError(
            "no assembly mode exists" if note is None else note.message,
            code="no-assembly" if note is None else note.code,
        )


_WORKSPACE_EXAMPLES = """\b
Examples:
  cartstiff workspace hexapod
  cartstiff workspace hexapod --pose 0,0,0.7,0.1,0,0 --plot workspace.png --csv boundary.csv
  cartstiff workspace cable-robot --radius 2 --load 0,0,0,0,0,-50 --world --json
"""

_workspace_options = option_group(
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


@click.command(name="workspace", cls=UnitsCommand, epilog=_WORKSPACE_EXAMPLES)
@mechanism_options(
    "Wrench on the body in its own frame at the pose the rays start from, where forces or "
    "tensions are limited.",
    placed=False,
    loaded=True,
)
@load_options("--load")
@_workspace_options
def workspace_command(
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
    tell(reached.as_dict(), request.mechanism, lambda: describe_workspace(reached))
    if strict and reached.positions is None:
        note = reached.notes[-1]
        raise UndefinedError(note.message, code=note.code, values=dict(note.values))
