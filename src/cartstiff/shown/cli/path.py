"""``cartstiff path``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import click

from cartstiff.core import choices
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.matrix_names import OF_MANY
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    PICTURES,
    Axis,
    Direction,
    Files,
    JointValues,
    OutputFiles,
    Printed,
    Setup,
    Values,
    Vibration,
    declared,
)
from cartstiff.shown.cli.output import Progress


@dataclass(frozen=True)
class Search:
    """Optimisation.

    Parameters
    ----------
    redundant : JOINT
    criterion : NAME
        Quantity to optimise: deflection, along_free, translation_free_min, isotropy, ...:
        those of `cartstiff map`.
    """

    API: ClassVar = ("wings/toolpaths/optimise.py optimise_path",)
    RARE: ClassVar = "redundant connection objective samples"

    redundant: str | None = None
    criterion: str = "deflection"
    connection: Annotated[str | None, click.Choice(OF_MANY)] = None
    loaded: bool = False
    objective: Literal["worst", "mean"] = "worst"
    samples: Annotated[int, click.IntRange(3, 720)] = 36


@declared(
    "path",
    needs={"load_kind": "loaded", "world": ""},
    exclusive=("free_axis free_rotation",),
    rare="damping ranges near progress",
)
def command(
    setup: Annotated[
        Setup,
        Overrides(
            "pose pose_of lengths rest actuate",
            because="the path has the poses, and its commands follow from them",
            load="Wrench on the body, the same at all points: moment about and force at "
            "the point --load-at.",
        ),
    ],
    path_file: Path,
    search: Search,
    vibration: Vibration,
    out: Printed,
    *,
    output: Annotated[Files, OutputFiles(".csv", *PICTURES)] = None,
    free_axis: Literal["x", "y", "z"] | None = None,
    free_rotation: bool = False,
    direction: Direction = None,
    axes: choices.Axes | None = None,
    ranges: Annotated[Axis, "--range"] = None,
    near: Annotated[Values | None, JointValues()] = None,
    progress: bool | None = None,
) -> None:
    r"""The postures in which MECHANISM is stiffest along a path.

    PATH.csv has one pose of the body frame a line: x, y, z, roll, pitch, yaw and, if
    wanted, a wrench mx, my, mz, fx, fy, fz; a first line may name the columns, also ax,
    ay, az for the tool's axis alone and dx, dy, dz for a direction.

    Parameters
    ----------
    setup
        The mechanism, with tool, weight, and the load at every point.
    path_file : PATH.csv
        The path.
    search
        Optimisation.
    vibration
        Damping.
    out
        Output.
    output
        Write the answer (.json), the postures, one line a point (.csv), or a picture of
        the criterion along the path, optimised and with the best constant choice.
    free_axis
        Axis of the body about which it may turn, the tool's axis.
    free_rotation
        The body may turn in any way.
    direction
        Direction along which stiffness counts, the same at all points.
    axes
        Axes of loads and directions. Those of the robot's own base, of the body, which
        turns by the free rotation as well, or of the room (as --world); default those of
        the file's poses.
    ranges
        Keep a joint within this range, besides its limits; or effort_margin, the least
        share of its limit that a drive leaves under weight and load, or largest_load.
    near
        Stay in the configuration of this posture: every joint that turns stays within 90
        degrees of it (numbers or name=value pairs; the others as in --q or the file).
    progress
        Bar on standard error; default on a terminal.

    Examples
    --------
    cartstiff path ur5 seam.csv --free-axis x --load 0,0,0,-120,0,30
    cartstiff path panda seam.csv --criterion translation_free_min -o commands.csv
    cartstiff path ur5 seam.csv --free-axis x --criterion along_free --direction 1,0,0 -o k.png
    cartstiff path ur5 seam.csv --free-axis x --load 0,0,0,-120,0,30 --loaded --load-kind follower
    cartstiff path ur5 seam.csv --free-axis x --load 0,0,0,-120,0,0 --range elbow_joint=0:2.6 \
        --near 0,-1.2,1.5,0,1,0
    """  # noqa: E501
    # The axes may be given by either option.
    if setup.world:
        if axes not in (None, "world"):
            raise InputError("give --world or --axes, not both")
        axes = "world"
    elastic = setup.at_posture()

    from cartstiff.recorded.strength import OF_STRENGTH
    from cartstiff.shown.cli.tables import read_path_file
    from cartstiff.wings.toolpaths.answer import answer_of_path
    from cartstiff.wings.toolpaths.optimise import optimise_path

    # The path with what may be chosen on it.
    free = "rotation" if free_rotation else free_axis or "none"
    path = read_path_file(
        path_file,
        free=free,
        wrench=setup.load,
        direction=direction,
        axes=axes,
        base=elastic.mechanism.base_pose,
        units=elastic.units,
    )
    # Ranges of joints, then the search.
    for name, (low, high) in (ranges or {}).items():
        check_name("joint", name, [*elastic.names, *OF_STRENGTH], "--range")
        if not low <= high:
            raise InputError(
                "values must rise",
                where=f"--range {name}",
                expected="LOW at most HIGH",
                got=f"{low:g}:{high:g}",
            )
    options: dict[str, Any] = {
        **asdict(search),
        **setup.manner,
        "free": free,
        "ranges": ranges,
        "near": None if near is None else near.of(elastic.names),
        "damping": vibration.damped,
    }
    with Progress("path", progress) as advance:
        result = optimise_path(elastic, path, progress=advance, **options)
    out.answer(
        result.to_dict(),
        answer_of_path(result),
        output,
        csv=result.to_csv,
        picture=result.plot,
    )
