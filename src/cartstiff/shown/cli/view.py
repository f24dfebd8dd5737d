"""``cartstiff view``, ``export`` and ``report``: pages for a browser."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import click

from cartstiff.core.errors import InputError, MissingDependencyError, joined, one_line
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    ONE_POSTURE,
    BalancedSetup,
    OutputFile,
    Setup,
    declared,
)
from cartstiff.shown.cli.output import Progress, say, say_unused


@dataclass(frozen=True)
class Shown:
    """Contents of a page besides the mechanism.

    Parameters
    ----------
    map_path : FILE
        Also draw a stiffness map: its points, or those of the table that `cartstiff
        workspace -o` writes, coloured by a quantity or by the limit that cuts.
    workspace
        Also draw the workspace's boundary, around the posture, coloured by its softest
        stiffness or the limit that cuts, and the singular surface, as `cartstiff
        workspace` finds them.
    trajectory : FILE.csv
        Postures for a time slider: one a line, in joint order or under a line of names; a
        column `time` in seconds may come first.
    """

    map_path: Annotated[str | None, "--map"] = None
    workspace: bool = False
    trajectory: Path | None = None

    def source(self, setup: Setup) -> Any:
        """Return the page's `Source` after checking everything that the page shows.

        Raises
        ------
        InputError
            For options that cannot be used.
        UndefinedError, ConvergenceError
            If the posture does not exist.
        """
        if self.workspace and self.map_path is not None:
            raise InputError(
                "one cloud of points at a time", where="--workspace", expected="no --map"
            )
        elastic, q = setup.read()
        import numpy as np

        from cartstiff.answer.commanded import checked_command
        from cartstiff.core.stiffness.compute import analyse
        from cartstiff.shown.page.source import Source, read_cloud, read_trajectory

        # The first picture; a load that cannot be carried is refused before the page
        # opens.
        with np.errstate(all="ignore"):
            first = analyse(elastic, q, **setup.keywords)
        cloud = None if self.map_path is None else read_cloud(self.map_path, elastic)
        if self.workspace:
            cloud = _workspace_cloud(elastic, first.q, setup)
        command = None
        # Steps of drives in the order of the springs, as the page has them.
        if setup.actuate is not None:
            steps = setup.command(elastic)
            checked_command(elastic, steps)
            command = [steps.get(name, 0.0) for name in elastic.spring_names]

        trajectory = None
        # Commands of joints are those before flexible links bend.
        if self.trajectory is not None:
            mechanism = elastic.mechanism
            trajectory = read_trajectory(
                self.trajectory,
                elastic.names,
                elastic.units,
                joints=mechanism.joint_names,
            )
            trajectory = replace(trajectory, q=mechanism.undeflected(trajectory.q))
            say_unused(self.trajectory, trajectory.unused)
        return Source(
            elastic=elastic,
            q=first.q,
            load=None if setup.load is None else np.array(setup.load),
            load_kind=setup.load_kind,
            load_at=None if setup.load_at is None else tuple(setup.load_at),  # type: ignore[arg-type]
            load_axes=setup.axes,
            command=command,
            trajectory=trajectory,
            cloud=cloud,
        )


def _workspace_cloud(elastic: Any, q: Any, setup: Setup) -> Any:
    """Return the boundary around a posture; the load is used if forces are limited."""
    from cartstiff.shown.page.source import cloud_of_workspace
    from cartstiff.wings.reach.workspace import limits_forces, workspace

    counts = setup.load is not None and limits_forces(elastic)
    with Progress("poses") as bar:
        reached = workspace(
            elastic, q, **setup.keywords if counts else {}, fits=False, progress=bar
        )
    return cloud_of_workspace(reached)


def _needing(module: str, purpose: str) -> Any:
    """Import a module of the page; refuse if tornado is missing."""
    try:
        return import_module(f"cartstiff.shown.page.{module}")
    except ImportError as error:
        if (error.name or "").startswith("cartstiff"):
            raise
        raise MissingDependencyError("tornado", purpose) from None


def _write(output: Path, page: str) -> None:
    from cartstiff.core.writing import write_whole

    data = page.encode()
    write_whole(output, data)
    say(f"{one_line(str(output))}: {len(data) / 1e6:.1f} MB")


_MAX_OTHERS = 3


@declared("view", api=("shown/page/server.py serve",))
def command(
    setup: Annotated[BalancedSetup, Overrides(optional="mechanism")],
    shown: Shown,
    others: tuple[str, ...] = (),
    *,
    port: Annotated[int, click.IntRange(0, 65535)] = 0,
    host: str = "127.0.0.1",
    no_open: bool = False,
) -> None:
    """Serve a page on which MECHANISM moves and shows its stiffness; ends with Ctrl-C.

    Without MECHANISM the page offers three guided starts of a minute each: an arm under a
    drilling load, a hexapod under a cutting force, a cable robot.

    Up to three OTHER mechanisms are shown beside it, with the same options: their numbers
    as ratios, their pictures at one scale and under one camera.

    The page needs no network and loads nothing from outside. The address that is printed
    holds a secret, without which nothing is answered. MECHANISM is a bundled name (see
    `cartstiff models`), a mechanism file (.yaml), a URDF, xacro or MJCF file, or an
    example robot's name.

    Parameters
    ----------
    setup
        The mechanism at its posture, with tool, weight and load.
    shown
        Further contents of the page.
    others : [OTHER]...
        Other mechanisms.
    host : ADDRESS
    no_open
        Print the address, open no browser.

    Examples
    --------
    cartstiff view
    cartstiff view ur5
    cartstiff view ur5 --load 0,0,0,0,0,-100 --trajectory postures.csv
    cartstiff view stewart-gough --port 8080 --no-open
    cartstiff view my_arm.urdf --frame tool --map workspace.zarr
    cartstiff view arm.yaml stiffer_arm.yaml
    """
    if len(others) > _MAX_OTHERS:
        raise InputError(
            "too many mechanisms",
            where="view",
            got=1 + len(others),
            expected=f"at most {1 + _MAX_OTHERS}",
        )
    api, server = (_needing(name, "a page in the browser") for name in ("api", "server"))
    source, *beside = _sources(setup, shown, others)
    more: dict[str, Any] = {"beside": beside}
    names = ", ".join(one.elastic.name for one in (source, *beside))
    if not setup.mechanism:
        more["guides"] = _needing("guides", "a page in the browser").guides_in_words()
        names = "guided starts"

    def ready(url: str) -> None:
        say(joined([f"{names}: {url}  (Ctrl-C ends)"]))
        if not no_open:
            api.open_page(url)

    server.serve(source, host=host, port=port, ready=ready, last=True, **more)


def _sources(setup: Setup, shown: Shown, others: tuple[str, ...]) -> list[Any]:
    """What the page shows: mechanisms, or without one those of the guided starts."""
    if setup.mechanism:
        return [
            shown.source(replace(setup, mechanism=name))
            for name in (setup.mechanism, *others)
        ]
    if (setup, shown) != (type(setup)(""), Shown()):
        raise InputError(
            "these options are about a mechanism", where="view", expected="MECHANISM"
        )
    sources: list[Any] = _needing("guides", "a page in the browser").guided_sources()
    return sources


@declared("export")
def export_command(
    setup: BalancedSetup,
    shown: Shown,
    *,
    output: Annotated[Path, OutputFile("PAGE.html", ".html", ".htm")],
) -> None:
    """Write the page of `cartstiff view` as one HTML file that opens anywhere,
    without a network.

    The file of an arm, a closed chain or a body on straight legs computes any posture,
    load, springs and point. The browser cannot compute other mechanisms: their file shows
    one posture, and says so.

    Parameters
    ----------
    setup
        The mechanism at its posture, with tool, weight and load.
    shown
        Further contents of the page.
    output
        File to write.

    Examples
    --------
    cartstiff export ur5 -o ur5.html
    cartstiff export hexapod --load 0,0,0,0,0,-50 -o hexapod.html
    cartstiff export ur5 --trajectory postures.csv -o path.html
    """
    source = shown.source(setup)
    _write(output, _needing("export", "a page as a file").export_page(source))


@declared(
    "report",
    api=("shown/report/maps.py map_section map_path=path",),
    needs={"load_at load_kind": "load", "quantity": "map_path"},
)
def report_command(
    setup: Annotated[
        BalancedSetup,
        Overrides(
            "actuate",
            because=ONE_POSTURE,
            load="Wrench on the body: moment about and force at the point --load-at, in "
            "the axes "
            "of the unloaded body frame; the report says what it does to the tip.",
        ),
    ],
    *,
    output: Annotated[Path, OutputFile("REPORT.html", ".html", ".htm")],
    map_path: Annotated[str | None, "--map"] = None,
    quantity: str | None = None,
    at_points: Path | None = None,
) -> None:
    r"""Write a report to send on: how far the tip moves, which joints contribute,
    what is better.

    One HTML file with a picture in 3D, posture, load, weight, stiffness, a sweep and
    everything that was assumed; it opens without a network and prints on paper.

    Parameters
    ----------
    setup
        The mechanism at its posture, with tool, weight and load.
    output
        File to write.
    map_path : FILE
    quantity : NAME
    at_points : PART.csv
        A page for each point of a part instead of one posture, the worst first. One point
        a line: a pose of the body frame, as in a path file, reached next to the posture
        (with its own wrench, if the line has one), or the joints' positions under their
        names.

    Examples
    --------
    cartstiff report ur5 --load 0,0,0,0,0,-100 --world -o ur5.html
    cartstiff map ur5 --grid shoulder_lift_joint=-2:0:41,elbow_joint=0.2:2.6:41 \
      --quantity deflection --load 0,0,0,0,0,-100 --world -o m.zarr
    cartstiff report ur5 --load 0,0,0,0,0,-100 --map m.zarr -o ur5.html
    cartstiff report ur5 --load 0,0,0,0,0,-100 --world --at-points part.csv -o part.html
    cartstiff report kr210.urdf --tcp 0,0,0.2 --payload 12 --load 0,0,0,0,0,-300 -o spindle.html
    """  # noqa: E501
    elastic, q = setup.read()
    sections = []
    if map_path is not None:
        from cartstiff.shown.report.maps import map_section

        sections.append(map_section(map_path, quantity, elastic))

    from cartstiff.shown.page.html_report import report_page

    points = []
    if at_points is not None:
        from cartstiff.shown.cli.report_points import read_points

        points = read_points(at_points, elastic, q)
    typed = shlex.join(click.get_current_context().meta["words"])
    _write(
        output,
        report_page(
            elastic,
            q,
            command=typed,
            sections=sections,
            points=points,
            **setup.keywords,
        ),
    )
