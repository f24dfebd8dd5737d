"""``cartstiff report``."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import click

from cartstiff.cli.options import (
    LoadRequest,
    MechanismRequest,
    UnitsCommand,
    load_options,
    mechanism_options,
)
from cartstiff.cli.output import say
from cartstiff.cli.types import OutputFile, file_option, option
from cartstiff.errors import InputError, one_line

_EPILOG = """\b
Examples:
  cartstiff report ur5 --load 0,0,0,0,0,-100 --world -o ur5.html
  cartstiff map ur5 --grid shoulder_lift_joint=-2:0:41,elbow_joint=0.2:2.6:41 -o m.zarr
  cartstiff report ur5 --load 0,0,0,0,0,-100 --map m.zarr -o ur5.html
  cartstiff report kr210.urdf --tcp 0,0,0.2 --payload 12 --load 0,0,0,0,0,-300 -o spindle.html
"""


@click.command(name="report", cls=UnitsCommand, epilog=_EPILOG)
@mechanism_options(
    load_help="Wrench on the body: moment about and force at the point --load-at, in the axes of "
    "the unloaded body frame; the report says what it does to the tip."
)
@load_options("--load")
@option("-o --output", OutputFile("REPORT.html", ".html", ".htm"), "File to write.", required=True)
@file_option("--map map_path", "Also show a map that `cartstiff map` computed.", metavar="FILE")
@click.option("--quantity", metavar="NAME", help="Quantity of --map; default its first.")
def command(
    request: MechanismRequest,
    applied: LoadRequest,
    output: Path,
    map_path: Path | None,
    quantity: str | None,
) -> None:
    """Write a report to send on: how far the tip moves, which joints contribute, what is better.

    One HTML file with a picture in 3D, posture, load, weight, stiffness, a sweep and everything
    that was assumed; it opens without a network and prints on paper.
    """
    wrench = request.balanced_wrench
    applied.check_world(load=wrench)
    applied.check_load(wrench is not None)
    if map_path is None and quantity is not None:
        raise InputError("is for --map", where="--quantity")
    elastic, q = request.load()
    sections = []
    if map_path is not None:
        from cartstiff.report.maps import map_section

        sections.append(map_section(map_path, quantity, elastic))

    from cartstiff.page.html_report import report_page
    from cartstiff.report.output import write_whole

    typed = shlex.join(["cartstiff", *sys.argv[1:]])
    text = report_page(
        elastic,
        q,
        wrench=wrench,
        command=typed,
        sections=sections,
        **applied.keywords(wrench),
    ).encode()
    write_whole(output, text)
    say(f"{one_line(str(output))}: {len(text) / 1e6:.1f} MB")
