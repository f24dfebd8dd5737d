"""``cartstiff frames``, ``models`` and ``poses``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import click

from cartstiff.cli.declare import Overrides
from cartstiff.cli.options import (
    Csv,
    Printed,
    Setup,
    declared,
)
from cartstiff.cli.output import say, say_unused
from cartstiff.errors import InputError


@declared("frames")
def frames_command(
    setup: Annotated[
        Setup,
        Overrides(
            "pose pose_of lengths rest actuate load load_at world load_kind",
            because="frames are listed, and nothing moves or loads them",
        ),
    ],
    out: Printed,
) -> None:
    """Frames of MECHANISM as a tree, with joints, limits, springs and masses.

    Any of these frames can be named with --frame on the other commands.

    Parameters
    ----------
    setup
        The mechanism.
    out
        Output.

    Examples
    --------
    cartstiff frames ur5
    cartstiff frames my_arm.urdf --json
    """
    from cartstiff.report.frames import describe_frames, frames_of

    elastic = setup.at_posture()
    answer, angle = frames_of(elastic), elastic.units.shown_angle
    length = elastic.mechanism.at(elastic.q).length
    out.show(answer, setup.mechanism, lambda: describe_frames(answer, angle, length))


@declared("models")
def models_command(out: Printed) -> None:
    """List what can be named: mechanisms, example robots, and published joint springs.

    Parameters
    ----------
    out
        Output.

    Examples
    --------
    cartstiff models
    cartstiff models --json
    """
    from cartstiff.loading.catalogue import bundled_files, example_robots
    from cartstiff.loading.published import GRADES, published_springs
    from cartstiff.loading.yaml_file import read_yaml

    bundled = {name: read_yaml(path)[0] for name, path in bundled_files().items()}
    robots = example_robots()
    names = [name for name, urdf in robots.items() if urdf is not None]
    data = {
        "bundled": {
            name: {"kind": file.get("kind"), "description": file.get("description")}
            for name, file in bundled.items()
        },
        "example_robots": names,
        "springs": published_springs(),
    }
    lines = [
        f"  {name:<16} {file.get('kind', ''):<14} {file.get('description', '')}"
        for name, file in bundled.items()
    ]
    listed = (
        "\n" + click.wrap_text(", ".join(names), 98, "  ", "  ", preserve_paragraphs=False)
        if robots
        else " none; pip install 'cartstiff[robots]' adds them."
    )
    text = [
        "Bundled mechanisms:",
        *lines,
        f"\nRobots of example-robot-data:{listed}\n",
        "Or a path: a mechanism file (.yaml), .urdf, .xacro, MJCF .xml.",
        "\nPublished joint springs, for --springs:",
        *(
            f"  {name:<32} {s['grade']}  {s['robot']}, joints {', '.join(s['stiffness'])}"
            + (": not to be used" if "refused" in s else "")
            for name, s in published_springs().items()
        ),
        *(f"  {grade}: {words}" for grade, words in GRADES.items()),
    ]
    out.show(data, "models", lambda: "\n".join(text))


@declared("poses", api=("report/robot_table.py robot_table",))
def poses_command(
    setup: Annotated[
        Setup,
        Overrides(
            "q pose pose_of lengths gravity payload springs stiffness rest actuate load load_at "
            "world load_kind",
            because="the table has the postures, and they are shown without deflection",
        ),
    ],
    table: Path,
    *,
    controller: Annotated[Literal["kuka", "fanuc", "abb", "ur"], "--for"],
    before: bool = False,
    output: Csv = None,
) -> None:
    """Postures of a table as a robot controller shows them: joints and poses in mm and degrees.

    TABLE.csv is what `path` or `equilibrium --path` wrote, or one posture a line. Commands that
    compensate the deflection (columns command_JOINT) are taken where the table has them. Poses are
    those of M in the robot's own base frame, as the controller computes them, without deflection.

    Parameters
    ----------
    setup
        The mechanism.
    table : TABLE.csv
        The postures.
    before
        The program before compensation (columns taught_JOINT), row by row as that after it.
    output
        Write the table there.

    Examples
    --------
    cartstiff poses ur5 commands.csv --for kuka
    cartstiff poses kr210.urdf commands.csv --tcp 0,0,0.2 --for kuka -o program.csv
    """
    elastic = setup.at_posture()

    from cartstiff.loading.tables import read_rows
    from cartstiff.mechanisms.other_units import shown_factors
    from cartstiff.report.layout import body_frame
    from cartstiff.report.robot_table import robot_table
    from cartstiff.writing import write_whole

    rows = read_rows(
        table, "postures", units=elastic.units, factors=shown_factors(elastic), joints=elastic.names
    )
    word = "taught" if before else "command"
    joints = elastic.mechanism.joint_names
    commands = tuple(f"{word}_{name}" for name in joints)
    commanded = rows.names is not None and set(commands) <= set(rows.names)
    if before and not commanded:
        raise InputError("the table has no columns taught_JOINT", where="--before", got=table.name)
    _, q, unused = rows.arranged(*((commands,) if commanded else (elastic.names, joints)))
    text = robot_table(elastic, elastic.mechanism.undeflected(q), controller)
    # Columns that are written beside the commands; the last line says which are used.
    known = ("taught_", "command_", "before_", "after_", *elastic.names)
    say_unused(table, [name for name in unused if not (commanded and name.startswith(known))])
    where = f"{body_frame(elastic.mechanism)}, in the robot's base"
    if output is None:
        say(f"cartstiff: poses of the {where}", error=True)
        say(text.rstrip("\n"))
        return
    write_whole(output, text.encode())
    what = "commands that compensate the deflection" if commanded else "postures"
    what = "commands before compensation" if before else what
    say(f"{output}: {len(q)} {what}; poses of the {where}")
