"""``cartstiff frames``."""

from __future__ import annotations

import click

from cartstiff.cli.options import MechanismRequest, UnitsCommand, mechanism_options
from cartstiff.cli.output import tell
from cartstiff.cli.types import json_option


@click.command(
    name="frames",
    cls=UnitsCommand,
    epilog="\b\nExamples:\n  cartstiff frames ur5\n  cartstiff frames my_arm.urdf --json",
)
@mechanism_options(placed=False)
@json_option
def command(request: MechanismRequest, as_json: bool) -> None:
    """Frames of MECHANISM as a tree, with joints, limits, springs and masses.

    Any of these frames can be named with --frame on the other commands.
    """
    from cartstiff.report.frames import describe_frames, frames_of

    elastic = request.at_posture()
    answer, angle = frames_of(elastic), elastic.units.shown_angle
    length = elastic.mechanism.at(elastic.q).length
    tell(as_json, answer, request.mechanism, lambda: describe_frames(answer, angle, length))
