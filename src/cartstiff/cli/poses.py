"""``cartstiff poses``."""

from __future__ import annotations

from pathlib import Path

import click

from cartstiff.cli.options import MechanismRequest, UnitsCommand, mechanism_options
from cartstiff.cli.output import say, say_unused
from cartstiff.cli.types import OutputFile, choice, option

_EPILOG = """\b
Examples:
  cartstiff poses ur5 commands.csv --for kuka
  cartstiff poses kr210.urdf commands.csv --tcp 0,0,0.2 --for kuka -o program.csv
"""


@click.command(name="poses", cls=UnitsCommand, epilog=_EPILOG)
@mechanism_options(placed=False, gives=False)
@click.argument("table", metavar="TABLE.csv", type=click.Path(path_type=Path))
@choice(
    "--for controller",
    ["kuka", "fanuc", "abb", "ur"],
    "kuka: X,Y,Z,A,B,C. fanuc: X,Y,Z,W,P,R. abb: quaternion q1..q4. ur: rotation vector.",
    required=True,
)
@option("-o --output", OutputFile("FILE.csv", ".csv"), "Write the table there.")
def command(request: MechanismRequest, table: Path, controller: str, output: Path | None) -> None:
    """Postures of a table as a robot controller shows them: joints and poses in mm and degrees.

    TABLE.csv is what `path` or `equilibrium --path` wrote, or one posture a line. Commands that
    compensate the deflection (columns command_JOINT) are taken where the table has them. Poses are
    those of M in the robot's own base frame, as the controller computes them, without deflection.
    """
    elastic = request.at_posture()

    from cartstiff.loading.tables import read_rows
    from cartstiff.mechanisms.other_units import shown_factors
    from cartstiff.report.layout import body_frame
    from cartstiff.report.output import write_whole
    from cartstiff.report.robot_table import robot_table

    rows = read_rows(
        table, "postures", units=elastic.units, factors=shown_factors(elastic), joints=elastic.names
    )
    commands = tuple(f"command_{name}" for name in elastic.names)
    commanded = rows.names is not None and set(commands) <= set(rows.names)
    _, q, unused = rows.arranged(commands if commanded else elastic.names)
    text = robot_table(elastic, q, controller)
    known = ("before_", "after_", *elastic.names)  # written beside commands, and said below
    say_unused(table, [name for name in unused if not (commanded and name.startswith(known))])
    where = f"{body_frame(elastic.mechanism)}, in the robot's base"
    if output is None:
        say(f"cartstiff: poses of the {where}", error=True)
        say(text.rstrip("\n"))
        return
    write_whole(output, text.encode())
    what = "commands that compensate the deflection" if commanded else "postures"
    say(f"{output}: {len(q)} {what}; poses of the {where}")
