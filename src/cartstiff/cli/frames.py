"""``cartstiff frames``."""

from __future__ import annotations

import json

import click

from cartstiff.cli.options import MechanismRequest, once
from cartstiff.cli.output import say

__all__ = ["command"]


@click.command(
    name="frames",
    epilog="\b\nExamples:\n  cartstiff frames ur5\n  cartstiff frames my_arm.urdf --json",
)
@click.argument("mechanism")
@click.option(
    "--frame", metavar="NAME", multiple=True, callback=once, help="Body frame M: a link or site."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def command(mechanism: str, frame: str | None, as_json: bool) -> None:
    """Frames of MECHANISM as a tree, with joints, limits, springs and masses.

    Any of these frames can be named with --frame on the other commands.
    """
    from cartstiff.report.frames import describe_frames, frames_of

    elastic, _ = MechanismRequest(mechanism, frame=frame).load()
    answer = frames_of(elastic)
    say(json.dumps(answer, allow_nan=False) if as_json else describe_frames(answer))
