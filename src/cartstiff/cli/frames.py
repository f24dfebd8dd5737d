"""``cartstiff frames``."""

from __future__ import annotations

import click

from cartstiff.cli.options import MechanismRequest, frame_option
from cartstiff.cli.output import tell
from cartstiff.cli.types import json_option

__all__ = ["command"]


@click.command(
    name="frames",
    epilog="\b\nExamples:\n  cartstiff frames ur5\n  cartstiff frames my_arm.urdf --json",
)
@click.argument("mechanism")
@frame_option
@json_option
def command(mechanism: str, frame: str | None, as_json: bool) -> None:
    """Frames of MECHANISM as a tree, with joints, limits, springs and masses.

    Any of these frames can be named with --frame on the other commands.
    """
    from cartstiff.report.frames import describe_frames, frames_of

    elastic, _ = MechanismRequest(mechanism, frame=frame).load()
    answer = frames_of(elastic)
    tell(as_json, answer, mechanism, lambda: describe_frames(answer))
