"""``cartstiff export``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from cartstiff.cli.options import UnitsCommand
from cartstiff.cli.output import say
from cartstiff.cli.types import OutputFile
from cartstiff.cli.view import needs_view, page_options, source_from_options
from cartstiff.errors import one_line

_EPILOG = """\b
Examples:
  cartstiff export ur5 -o ur5.html
  cartstiff export hexapod --load 0,0,0,0,0,-50 -o hexapod.html
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
def command(output: Path, **texts: Any) -> None:
    """Write the page of `cartstiff view` as one HTML file that opens anywhere, without a network.

    The file of an arm, or of a body on line legs, computes any posture, load, springs and point.
    The browser cannot compute other mechanisms: their file shows one posture, and says so.
    """
    source = source_from_options(**texts)
    try:
        from cartstiff.page.export import export_page
    except ImportError as error:
        if (error.name or "").startswith("cartstiff"):
            raise
        raise needs_view("a page as a file") from None
    from cartstiff.report.output import write_whole

    text = export_page(source).encode()
    write_whole(output, text)
    say(f"{one_line(str(output))}: {len(text) / 1e6:.1f} MB")
