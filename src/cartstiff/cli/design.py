"""``cartstiff design``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import click

from cartstiff.cli.declare import Overrides
from cartstiff.cli.options import (
    Output,
    OutputFile,
    Setup,
    declared,
)
from cartstiff.cli.output import Progress, say

_NOT_OF_STUDIES = (
    "mechanism q pose pose_of lengths frame parameters xacro_args package_path springs stiffness "
    "rest actuate"
)


@declared("design", api=("designs/run.py design",), needs={"load_at load_kind world": "load"})
def command(
    study: Path,
    setup: Annotated[
        Setup,
        Overrides(
            _NOT_OF_STUDIES,
            because="the study says it",
            load="Wrench on the body in its own frame. Every design carries it, instead of the "
            "loads that the study names.",
        ),
    ],
    out: Annotated[Output, Overrides(plot="Draw the designs and their Pareto front.")],
    *,
    output: Annotated[Path | None, OutputFile("FILE.jsonl", ".jsonl")] = None,
    best: Annotated[int, click.IntRange(1, 1000)] = 10,
    workers: Annotated[int, click.IntRange(1, 1024)] = 1,
    progress: bool | None = None,
) -> None:
    """Sweep the parameters of a mechanism file, as STUDY.yaml says.

    Every design is evaluated at all its poses and judged by quantities of maps (see `cartstiff map
    --list-quantities`). A design that is singular at one of them, or cannot be assembled, counts
    as failed; the answer gives the reason. Tool, weight, load and units may be given instead of the
    study's. After an interruption, the same command with the same -o goes on where it stopped.

    Parameters
    ----------
    study : STUDY.yaml
        The study.
    setup
        Tool, weight, units and load instead of the study's.
    out
        Output.
    best : N
        Number of designs of the front that are printed.
    workers : N
    progress
        Bar on standard error; default on a terminal.

    Examples
    --------
    cartstiff design study.yaml
    cartstiff design study.yaml --tcp 0,0,50 --load 0,0,0,0,0,-100 --units mm,deg
    cartstiff design study.yaml -o designs.jsonl --csv designs.csv --plot front.png --workers 2

    Here study.yaml holds
    mechanism: inclined-hexapod
    variables: {sz: [0.3, 0.9], a: {low: 0.2, high: 0.4, count: 3}}
    poses: {grid: {x: [-0.05, 0.05, 5], z: [-0.05, 0.05, 5]}, about_home: true}
    objectives:
      softest: {quantity: translation_held_min}
      turning: {quantity: rotation_held_min}
    constraints: {width: {value: =2*a, at_most: 0.7}}
    """
    given = {
        **{name: getattr(setup, name) for name in ("tcp", "gravity", "payload", "units")},
        "load": None if setup.load is None else setup.keywords,
    }

    from cartstiff.designs.run import design

    try:
        with Progress("designs", progress) as bar:
            designs = design(study, given=given, output=output, workers=workers, progress=bar)
    except KeyboardInterrupt:
        kept = "" if output is None else f"; what is done is in {output}"
        say(f"cartstiff: interrupted{kept}", error=True)
        sys.stdout.flush()
        raise click.exceptions.Exit(130) from None

    from cartstiff.report.designs import describe_designs

    out.show(
        designs.to_dict(),
        str(study),
        lambda: describe_designs(designs, best),
        csv=designs.to_csv,
        plot=designs.plot,
    )
