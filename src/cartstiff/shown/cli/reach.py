"""``cartstiff assemble`` and ``workspace``."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Annotated, ClassVar

import click

from cartstiff.core.choices import Distribution
from cartstiff.core.errors import InputError, UndefinedError
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    PICTURES,
    Files,
    Metres,
    Number,
    OutputFiles,
    Printed,
    Setup,
    declared,
)
from cartstiff.shown.cli.output import Progress


@dataclass(frozen=True)
class Modes:
    """Search for modes."""

    API: ClassVar = ("wings/reach/assembly.py assemble",)

    every: Annotated[bool, "--all"] = False


@declared("assemble", needs={"load_at load_kind world": "load"})
def assemble_command(
    setup: Annotated[
        Setup,
        Overrides(
            "rest actuate",
            because="actuators are held where the posture has them",
            pose="Pose of a platform: its leg lengths are taken, and the modes nearest "
            "to it come "
            "first. Position and roll, pitch, yaw about fixed axes; default the file's.",
            lengths="Leg lengths of a platform; default those at its pose.",
            load="Wrench on the body in its own frame. The held legs or actuators carry "
            "it in every mode, and the stiffness is the one under this load.",
        ),
    ],
    search: Modes,
    out: Printed,
    *,
    output: Annotated[Files, OutputFiles(".csv")] = None,
    strict: bool = False,
) -> None:
    """Assembly modes of MECHANISM: all poses with the same leg lengths,
    or actuator positions.

    For a six-legged platform all modes are found: the 40 complex solutions of a general
    platform are followed to those of this one, and the answer says where each of them
    ended. For a closed chain the actuated joints stay where --q puts them, and the chain
    is closed from random starts.

    Parameters
    ----------
    setup
        The mechanism, with tool, weight and load.
    search
        How modes are looked for.
    out
        Output.
    output
        Write the answer (.json) or a table of the modes (.csv).
    strict
        Exit with code 3 if modes may be missing, or none exists.

    Examples
    --------
    cartstiff assemble hexapod --all
    cartstiff assemble stewart-simscape --all --lengths 0.085,0.085,0.085,0.085,0.085,0.086 --json
    cartstiff assemble hexapod --all --load 0,0,0,0,0,-500 --world
    cartstiff assemble five-bar --all -o modes.csv
    """  # noqa: E501
    elastic, q = replace(setup, lengths=None).read()
    from cartstiff.shown.report.reach import assembly_csv
    from cartstiff.wings.reach.answer import answer_of_assembly
    from cartstiff.wings.reach.assembly import assemble

    if setup.lengths is not None and not len(elastic.mechanism.points):
        raise InputError("is for platforms", where="--lengths", expected="--q")
    with Progress("starts") as bar:
        modes = assemble(
            elastic, setup.lengths, q=q, **asdict(search), progress=bar, **setup.keywords
        )
    out.answer(
        modes.to_dict(),
        answer_of_assembly(modes),
        output,
        csv=lambda: assembly_csv(modes),
    )
    if strict and (
        not modes.modes or any(note.code == "paths-lost" for note in modes.notes)
    ):
        note = modes.notes[-1] if modes.notes else None
        raise UndefinedError(
            "no assembly mode exists" if note is None else note.message,
            code="no-assembly" if note is None else note.code,
        )


@dataclass(frozen=True)
class Search:
    """Search for the boundary."""

    API: ClassVar = ("wings/reach/workspace.py workspace",)

    directions: Annotated[int | None, click.IntRange(8, 1_000_000)] = None
    scan: Annotated[int, click.IntRange(2, 100_000)] = 48
    radius: Annotated[float | None, Number("LENGTH", above_zero=True, kind="length")] = (
        None
    )
    tensions: Distribution = "any"


@declared("workspace", needs={"load_at load_kind world": "load"})
def workspace_command(
    setup: Annotated[
        Setup,
        Overrides(
            "lengths rest actuate springs stiffness",
            because="limits decide what is reached, not springs and drives",
            pose="Orientation that is kept, and position around which rotations are "
            "tried: position and roll, pitch, yaw about fixed axes; default the file's.",
            load="Wrench on the body, in its own frame at the pose from which the rays "
            "start; only for limited forces or tensions.",
        ),
    ],
    search: Search,
    out: Printed,
    *,
    output: Annotated[Files, OutputFiles(".csv", *PICTURES)] = None,
    progress: bool | None = None,
    strict: bool = False,
) -> None:
    """Poses that MECHANISM (a platform, cable robot or body on legs) reaches
    within its limits.

    The answer has the volume and its slices for one orientation, the rotations at one
    position, the share of the boundary that is due to each limit, the largest sphere and
    cube inside, and the distance to singular poses.

    Parameters
    ----------
    setup
        The mechanism, with tool, weight and load.
    search
        How the boundary is looked for.
    out
        Output.
    output
        Write the answer (.json), the boundary as positions, each with its limit (.csv),
        or a picture of it in space, from above and from two sides. `cartstiff view
        MECHANISM --workspace` draws the table on the page.
    progress
        Bar on standard error; default on a terminal.
    strict
        Exit with code 3 if it is singular: architecture or orientation.

    Examples
    --------
    cartstiff workspace hexapod
    cartstiff workspace hexapod --pose 0,0,0.7,0.1,0,0 -o workspace.png -o boundary.csv
    cartstiff workspace cable-robot --radius 2 --load 0,0,0,0,0,-50 --world --json
    """
    elastic, q = setup.read()

    from cartstiff.shown.report.reach import boundary_csv
    from cartstiff.wings.reach.answer import answer_of_workspace
    from cartstiff.wings.reach.workspace import workspace

    with Progress("poses", progress) as bar:
        asked = asdict(search) | {"radius": Metres.in_units(search.radius, elastic.units)}
        reached = workspace(elastic, q, **setup.keywords, **asked, progress=bar)
    out.answer(
        reached.to_dict(),
        answer_of_workspace(reached),
        output,
        csv=lambda: boundary_csv(reached),
        picture=reached.plot,
    )
    if strict and reached.positions is None:
        note = reached.notes[-1]
        raise UndefinedError(note.message, code=note.code, values=dict(note.values))
