"""``cartstiff view``, ``export`` and ``report``: pages for a browser."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from cartstiff.cli.options import (
    LoadRequest,
    MechanismRequest,
    OutputFile,
    UnitsCommand,
    Values,
    command_option,
    count,
    file_option,
    flag,
    load_options,
    mechanism_options,
    only_with,
    option,
    option_group,
)
from cartstiff.cli.output import Progress, say, say_unused
from cartstiff.errors import InputError, MissingDependencyError, joined, one_line

#: Keywords of `source_from_options`.
page_options = option_group(
    mechanism_options(),
    load_options("--load"),
    command_option,
    file_option(
        "--map map_path",
        "Also draw the points of a stiffness map, or of the table that `cartstiff workspace "
        "--csv` writes, coloured by a quantity or by the limit that cuts.",
        metavar="FILE",
    ),
    flag(
        "--workspace with_workspace",
        "Also draw the boundary of the workspace around the posture, coloured by the limit "
        "that cuts, and the singular surface, as `cartstiff workspace` finds them.",
    ),
    file_option(
        "--trajectory trajectory_path",
        "Postures for a time slider: one a line, in joint order or under a line of names; a "
        "column `time` in seconds may come first.",
        metavar="FILE.csv",
    ),
)


def source_from_options(
    request: MechanismRequest,
    applied: LoadRequest,
    told: Values | None,
    map_path: Path | None,
    trajectory_path: Path | None,
    with_workspace: bool = False,
) -> Any:
    """The page's `Source`, with everything checked that a page would show.

    Raises
    ------
    InputError
        For what cannot be used; UndefinedError and ConvergenceError where there is no posture.
    """
    if with_workspace and map_path is not None:
        raise InputError("one cloud of points at a time", where="--workspace", expected="no --map")
    load = request.balanced_wrench
    applied.check_world(load=load)
    elastic, q = request.load()
    import numpy as np

    from cartstiff.mechanisms.other_units import shown_factors
    from cartstiff.page.source import Source, read_cloud, read_trajectory
    from cartstiff.statics.command import checked_command
    from cartstiff.stiffness.compute import analyse

    with np.errstate(all="ignore"):
        first = analyse(elastic, q, wrench=load, **applied.keywords(load))
    cloud = None if map_path is None else read_cloud(map_path, elastic)
    if with_workspace:
        cloud = _workspace_cloud(elastic, first.q, load, applied)
    command = None
    if told is not None:
        steps = request.command(told, elastic)
        checked_command(elastic, steps)
        command = [steps.get(name, 0.0) for name in elastic.spring_names]

    def reload(name: str) -> Any:
        other = request.in_frame(name)
        if other.names != elastic.names:
            return other
        stiffness = None if elastic.springs is None else elastic.springs.stiffness
        rest = (
            elastic.springs.rest
            if elastic.springs is not None and request.rest is not None
            else None
        )
        return other.with_springs(stiffness if request.stiffness is not None else None, rest)

    trajectory = None
    if trajectory_path is not None:
        trajectory = read_trajectory(
            trajectory_path, elastic.names, elastic.units, shown_factors(elastic)
        )
        say_unused(trajectory_path, trajectory.unused)
    return Source(
        elastic=elastic,
        q=first.q,
        load=None if load is None else np.array(load),
        load_kind=applied.load_kind,  # type: ignore[arg-type]
        load_at=None if applied.load_at is None else tuple(applied.load_at),  # type: ignore[arg-type]
        load_axes="inertial" if applied.world else "body",
        command=command,
        reload=reload,
        trajectory=trajectory,
        cloud=cloud,
    )


def _workspace_cloud(elastic: Any, q: Any, load: Any, applied: LoadRequest) -> Any:
    """The boundary around a posture; the load counts where forces are limited."""
    from cartstiff.page.source import cloud_of_workspace
    from cartstiff.reach.workspace import limits_forces, workspace

    loaded = {}
    if load is not None and limits_forces(elastic):
        loaded = {"wrench": load, **applied.keywords(load)}
    with Progress("poses") as bar:
        reached = workspace(elastic, q, **loaded, fits=False, progress=bar)
    return cloud_of_workspace(reached)


def needs_view(purpose: str) -> MissingDependencyError:
    """The refusal where tornado is missing."""
    return MissingDependencyError("tornado", purpose)


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
@count("--port", "Port of this machine; 0 takes a free one.", 0, 65535, default=0)
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. Any other than the default lets in other machines that know the "
    "printed address; what they exchange is not encrypted.",
)
@flag("--no-open", "Print the address, open no browser.")
def command(port: int, host: str, no_open: bool, others: tuple[str, ...], **texts: Any) -> None:
    """Serve a page on which MECHANISM moves and shows its stiffness; ends with Ctrl-C.

    Up to three OTHER mechanisms are shown beside it, with the same options: their numbers as
    ratios, their pictures at one scale and under one camera.

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
        from cartstiff.page.api import open_page
        from cartstiff.page.server import serve
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


_EXPORT_EXAMPLES = """\b
Examples:
  cartstiff export ur5 -o ur5.html
  cartstiff export hexapod --load 0,0,0,0,0,-50 -o hexapod.html
  cartstiff export ur5 --trajectory postures.csv -o path.html
"""


@click.command(name="export", cls=UnitsCommand, epilog=_EXPORT_EXAMPLES)
@page_options
@click.option(
    "-o",
    "--output",
    required=True,
    type=OutputFile("PAGE.html", ".html", ".htm"),
    help="File to write.",
)
def export_command(output: Path, **texts: Any) -> None:
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


_REPORT_EXAMPLES = """\b
Examples:
  cartstiff report ur5 --load 0,0,0,0,0,-100 --world -o ur5.html
  cartstiff map ur5 --grid shoulder_lift_joint=-2:0:41,elbow_joint=0.2:2.6:41 -o m.zarr
  cartstiff report ur5 --load 0,0,0,0,0,-100 --map m.zarr -o ur5.html
  cartstiff report kr210.urdf --tcp 0,0,0.2 --payload 12 --load 0,0,0,0,0,-300 -o spindle.html
"""


@click.command(name="report", cls=UnitsCommand, epilog=_REPORT_EXAMPLES)
@mechanism_options(
    load_help="Wrench on the body: moment about and force at the point --load-at, in the axes of "
    "the unloaded body frame; the report says what it does to the tip."
)
@load_options("--load")
@option("-o --output", OutputFile("REPORT.html", ".html", ".htm"), "File to write.", required=True)
@file_option("--map map_path", "Also show a map that `cartstiff map` computed.", metavar="FILE")
@click.option("--quantity", metavar="NAME", help="Quantity of --map; default its first.")
def report_command(
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
    if map_path is None:
        only_with("map", quantity=quantity)
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
