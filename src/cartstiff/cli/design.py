"""``cartstiff design``."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from cartstiff.cli.options import (
    PICTURE,
    WRENCH,
    LoadRequest,
    OutputFile,
    count,
    json_option,
    load_options,
    option,
    option_group,
    progress_option,
    tool_options,
    units_option,
)
from cartstiff.cli.output import Progress, say, tell
from cartstiff.errors import InputError

_EPILOG = """\b
Example: study.yaml holds
  mechanism: inclined-hexapod
  variables: {sz: [0.3, 0.9], a: {low: 0.2, high: 0.4, count: 3}}
  poses: {grid: {x: [-0.05, 0.05, 5], z: [-0.05, 0.05, 5]}, about_home: true}
  objectives:
    softest: {quantity: translation_held_min}
    turning: {quantity: rotation_held_min}
  constraints: {width: {value: =2*a, at_most: 0.7}}

\b
  cartstiff design study.yaml
  cartstiff design study.yaml --tcp 0,0,50 --load 0,0,0,0,0,-100 --units mm,deg
  cartstiff design study.yaml -o designs.jsonl --csv designs.csv --plot front.png --workers 2

After an interruption, the same command with the same -o goes on where it stopped.
"""


@click.command(name="design", epilog=_EPILOG)
@click.argument("study", metavar="STUDY.yaml", type=click.Path(path_type=Path))
@option_group(
    tool_options,
    units_option,
    option(
        "--load wrench",
        WRENCH,
        "Wrench on the body in its own frame. Every design carries it, instead of the loads "
        "that the study names.",
    ),
)
@load_options("--load")
@option(
    "-o --output",
    OutputFile("FILE.jsonl", ".jsonl"),
    "Keep every finished design here; go on with a file that exists.",
)
@option("--csv table", OutputFile("FILE.csv", ".csv"), "Write all designs as a table.")
@option("--plot", PICTURE, "Draw the designs and their Pareto front.")
@count(
    "--best",
    "Most designs of the Pareto front that the text lists.",
    1,
    1000,
    default=10,
    metavar="N",
)
@count("--workers", "Processes, each with whole designs.", 1, 1024, default=1, metavar="N")
@click.option("--scheduler", hidden=True)
@progress_option
@json_option
def command(
    study: Path,
    tcp: list[float] | None,
    gravity: list[float] | None,
    payload: list[float] | None,
    units: dict[str, str] | None,
    wrench: list[float] | None,
    applied: LoadRequest,
    output: Path | None,
    table: Path | None,
    plot: Path | None,
    best: int,
    workers: int,
    scheduler: str | None,
    progress: bool | None,
) -> None:
    """Sweep the parameters of a mechanism file, as STUDY.yaml says.

    Every design is evaluated at all its poses and judged by quantities of maps (see `cartstiff map
    --list-quantities`). A design that is singular at one of them, or cannot be assembled, counts
    as failed; the answer gives the reason. Tool, weight, load and units may be given instead of the
    study's.
    """
    if scheduler is not None:
        raise InputError(
            "designs have no scheduler any more", where="--scheduler", expected="--workers N"
        )
    applied.check_load(wrench is not None)
    applied.check_world(load=wrench)
    load = None if wrench is None else {"wrench": wrench, **applied.keywords(wrench)}
    given = {"tcp": tcp, "gravity": gravity, "payload": payload, "units": units, "load": load}

    from cartstiff.designs.run import design
    from cartstiff.report.output import write_files

    try:
        with Progress("designs", progress) as bar:
            designs = design(
                study,
                given=given,
                output=output,
                workers=workers,
                progress=bar,
            )
    except KeyboardInterrupt:
        kept = "" if output is None else f"; what is done is in {output}"
        say(f"cartstiff: interrupted{kept}", error=True)
        sys.stdout.flush()
        raise click.exceptions.Exit(130) from None

    from cartstiff.report.designs import describe_designs, draw_designs

    write_files((table, designs.to_csv), (plot, lambda: draw_designs(designs)))
    tell(designs.as_dict(), str(study), lambda: describe_designs(designs, best))
