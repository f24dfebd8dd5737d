"""``cartstiff design``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    PICTURES,
    Files,
    OutputFiles,
    Printed,
    Setup,
    declared,
)
from cartstiff.shown.cli.output import Progress

_NOT_OF_STUDIES = (
    "mechanism q pose pose_of lengths frame parameters xacro_args package_path springs "
    "stiffness rest actuate"
)


@declared(
    "design",
    api=("wings/maps/designs/run.py design",),
    needs={"load_at load_kind world": "load"},
)
def command(
    study: Path,
    setup: Annotated[
        Setup,
        Overrides(
            _NOT_OF_STUDIES,
            because="the study says it",
            load="Wrench on the body in its own frame. Every design carries it, instead "
            "of the loads that the study names.",
        ),
    ],
    out: Printed,
    *,
    output: Annotated[Files, OutputFiles(".csv", *PICTURES)] = None,
    best: Annotated[int, click.IntRange(1, 1000)] = 10,
    progress: bool | None = None,
) -> None:
    """Sweep the parameters of a mechanism file, as STUDY.yaml says.

    Every design is evaluated at all its poses and judged by quantities of maps (see
    `cartstiff models --quantities`). A design that is singular at one of them, or cannot
    be assembled, counts as failed; the answer gives the reason. Tool, weight and load may
    be given instead of the study's.

    Parameters
    ----------
    study : STUDY.yaml
        The study.
    setup
        Tool, weight and load instead of the study's.
    out
        Output.
    output
        Write the answer (.json), all designs as a table (.csv), or a picture of the
        designs and their Pareto front.
    best : N
        Number of designs of the front that are printed.
    progress
        Bar on standard error; default on a terminal.

    Examples
    --------
    cartstiff design study.yaml
    cartstiff design study.yaml --tcp 0,0,0.05 --load 0,0,0,0,0,-100
    cartstiff design study.yaml -o designs.csv -o front.png

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
        **{name: getattr(setup, name) for name in ("tcp", "gravity", "payload")},
        "load": None if setup.load is None else setup.keywords,
    }

    from cartstiff.wings.maps.designs.run import design

    with Progress("designs", progress) as bar:
        designs = design(study, given=given, progress=bar)

    from cartstiff.wings.maps.designs.answer import answer_of_designs

    out.answer(
        designs.to_dict(),
        answer_of_designs(designs, best),
        output,
        csv=designs.to_csv,
        picture=designs.plot,
    )
