"""``cartstiff assemble``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from cartstiff.cli.options import (
    LoadRequest,
    MechanismRequest,
    UnitsCommand,
    load_options,
    mechanism_options,
)
from cartstiff.cli.output import Progress, tell
from cartstiff.cli.types import POSE, Numbers, OutputFile, flag, json_option, option, option_group
from cartstiff.errors import InputError, UndefinedError

_EPILOG = """\b
Examples:
  cartstiff assemble hexapod --all
  cartstiff assemble stewart-simscape --all --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --json
  cartstiff assemble hexapod --all --load 0,0,0,0,0,-500 --world
  cartstiff assemble five-bar --all --csv modes.csv
"""

_options = option_group(
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


@click.command(name="assemble", cls=UnitsCommand, epilog=_EPILOG)
@mechanism_options(
    "Wrench on the body in its own frame. The held legs or actuators carry it in every mode, and "
    "the stiffness is the one under this load.",
    placed=False,
    loaded=True,
)
@load_options("--load")
@_options
def command(
    request: MechanismRequest,
    applied: LoadRequest,
    every: bool,
    starts: int | None,
    seed: int | None,
    csv: Path | None,
    as_json: bool,
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
    tell(as_json, modes.as_dict(), request.mechanism, lambda: describe_assembly(modes))
    if strict and (not modes.modes or any(note.code == "paths-lost" for note in modes.notes)):
        note = modes.notes[-1] if modes.notes else None
        raise UndefinedError(
            "no assembly mode exists" if note is None else note.message,
            code="no-assembly" if note is None else note.code,
        )
