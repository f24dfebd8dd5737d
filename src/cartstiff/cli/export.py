"""``cartstiff export``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from cartstiff.cli.output import say
from cartstiff.cli.requests.units import UnitsCommand
from cartstiff.cli.requests.view import needs_view, page_options, source_from_options
from cartstiff.cli.types import OutputFile
from cartstiff.errors import one_line

_EPILOG = """\b
Examples:
  cartstiff export ur5 -o ur5.html
  cartstiff export delta --load 0,0,0,0,0,-50 --frames 41 -o delta.html
  cartstiff export ur5 --trajectory postures.csv -o path.html
"""


@click.command(name="export", cls=UnitsCommand, epilog=_EPILOG)
@page_options
@click.option(
    "-o",
    "--output",
    required=True,
    type=OutputFile("PAGE.html", ".html", ".htm"),
    help="File to write.",
)
@click.option(
    "--frames",
    type=click.IntRange(2, 201),
    help="Store this many postures along each coordinate instead of the formulas (a file without "
    "formulas: 25).",
)
def command(output: Path, frames: int | None, **texts: Any) -> None:
    """Write the page of `cartstiff view` as one HTML file that opens anywhere, without a network.

    For an arm, or a body on line legs, the file computes any posture, load, springs and point.
    Other files, and those asked for with --frames, hold the posture given and a sweep of every
    coordinate through it, or the postures of a trajectory.
    """
    source = source_from_options(**texts)
    try:
        from cartstiff.page.export import export_page
    except ImportError as error:
        if (error.name or "").startswith("cartstiff"):
            raise
        raise needs_view("a page as a file") from None
    from cartstiff.report.output import write_whole

    text = export_page(source, frames=frames).encode()
    write_whole(output, text)
    say(f"{one_line(str(output))}: {len(text) / 1e6:.1f} MB")
