"""``cartstiff view``."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import click

from cartstiff.cli.output import say
from cartstiff.cli.requests.units import UnitsCommand
from cartstiff.cli.requests.view import needs_view, page_options, source_from_options
from cartstiff.errors import InputError, joined

_MOST_OTHERS = 3

_EPILOG = """\b
Examples:
  cartstiff view ur5
  cartstiff view ur5 --load 0,0,0,0,0,-100 --trajectory postures.csv
  cartstiff view stewart-gough --port 8080 --no-open
  cartstiff view my_arm.urdf --frame tool --map workspace.zarr
  cartstiff view arm.yaml stiffer_arm.yaml
"""


@click.command(name="view", cls=UnitsCommand, epilog=_EPILOG)
@page_options
@click.argument("others", nargs=-1, metavar="[OTHER]...")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default=True,
    help="Port of this machine; 0 takes a free one.",
)
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. Any other than the default lets in other machines that know the "
    "printed address; what they exchange is not encrypted.",
)
@click.option("--no-open", is_flag=True, help="Print the address, open no browser.")
def command(port: int, host: str, no_open: bool, others: tuple[str, ...], **texts: Any) -> None:
    """Serve a page on which MECHANISM moves and shows its stiffness; ends with Ctrl-C.

    Up to three OTHER mechanisms stand beside it, with the same options: their numbers as ratios,
    their pictures at one scale and under one camera.

    The page needs no network and loads nothing from outside. The address that is printed holds a
    secret, without which nothing is answered. MECHANISM is a bundled name (see
    `cartstiff models`), a mechanism file (.yaml), a URDF, xacro or MJCF file, or
    an example robot's name.
    """
    if len(others) > _MOST_OTHERS:
        raise InputError(
            "too many mechanisms",
            where="view",
            got=1 + len(others),
            expected=f"at most {1 + _MOST_OTHERS}",
        )
    source = source_from_options(**texts)
    request = texts.pop("request")
    beside = [source_from_options(replace(request, mechanism=name), **texts) for name in others]
    try:
        from cartstiff.page.opening import open_page
        from cartstiff.page.run import serve
    except ImportError as error:
        if (error.name or "").startswith("cartstiff"):
            raise
        raise needs_view("a page in the browser") from None

    def ready(url: str) -> None:
        names = ", ".join(one.elastic.name for one in (source, *beside))
        say(joined([f"{names}: {url}  (Ctrl-C ends)"]))
        if not no_open:
            open_page(url)

    serve(source, host=host, port=port, ready=ready, last=True, beside=beside)
