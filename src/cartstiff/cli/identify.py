"""``cartstiff identify``."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from cartstiff.cli.options import MechanismRequest, file_options, frame_option, tool_options
from cartstiff.cli.output import say, tell
from cartstiff.cli.requests.identify import (
    deviations_of,
    in_own_units,
    reject_of,
    stiffnesses_of,
    ties_of,
    units_of,
)
from cartstiff.cli.requests.plan import PlanRequest, say_read
from cartstiff.cli.requests.units import UnitsCommand, given_length
from cartstiff.cli.types import (
    PICTURE,
    POINT,
    WRENCH,
    Axes,
    JointValues,
    Number,
    OutputFile,
    gathered,
    json_option,
    option,
    option_group,
    repeated_option,
)
from cartstiff.errors import InputError, one_line

#: Probability of the intervals.
_LEVEL = 0.95

_EPILOG = """\b
Examples:
  cartstiff identify ur5 measured.csv
  cartstiff identify arm.yaml measured.csv --sd d=0.005mm -o known.yaml
  cartstiff identify arm.yaml measured.csv --units mm,deg --reject suspects --plot residuals.png
  cartstiff identify ur5 measured.csv --tie wrist_1_joint=wrist_2_joint --known wrist_3_joint=8000
  cartstiff identify ur5 --plan 12 --mass 5 --sd d=0.005mm --csv to_do.csv
  cartstiff identify ur5 --plan 6 --force 100 --sd dx=0.02mm --have measured.csv --criterion all
  cartstiff identify ur5 to_do.csv --simulate 1 --sd d=0.005mm --csv measured.csv
"""

_about_the_table = option_group(
    option(
        "--point",
        type=POINT,
        help="Point of the body, in its frame, that was measured; default its origin.",
    ),
    option(
        "--load-at",
        type=POINT,
        help="Point of the body, in its frame, at which loads act; default the measured one.",
    ),
    click.option(
        "--axes",
        type=click.Choice(["base", "body", "world"]),
        help="Axes of the columns mx,my,mz,fx,fy,fz; default base, and body in a table "
        "of `cartstiff path`.",
    ),
    option(
        "--units",
        metavar="UNITS",
        help="Units of numbers given and shown, such as mm,deg, and "
        "of columns without one in their head; there SI otherwise.",
    ),
    click.option(
        "--sd",
        metavar="COLUMN=VALUE[UNIT]",
        multiple=True,
        help="Standard deviation of a column, such as dx=0.02mm; else estimated.",
    ),
)
_about_the_fit = option_group(
    click.option(
        "--unknown",
        metavar="NAME",
        multiple=True,
        help="What is to be found: a spring, leg or line by name; joints (the default), lines, "
        "links; a link that gives: LINK (its 6x6), LINK:diagonal, LINK:rx,ry.",
    ),
    click.option("--tie", metavar="A=B", multiple=True, help="Springs that are equal."),
    click.option(
        "--known", metavar="NAME=K", multiple=True, help="A stiffness that is known and kept."
    ),
    click.option(
        "--prior",
        metavar="NAME=K,SD",
        multiple=True,
        help="A stiffness that is known with this standard deviation.",
    ),
    click.option(
        "--offsets",
        type=click.Choice(["rigid", "translation", "none"]),
        help="What is unknown of the measuring frame in each session of a table with positions: "
        "position and rotation (rigid, the default), position alone, or nothing.",
    ),
    click.option(
        "--loaded",
        is_flag=True,
        help="Fit equilibria under the load instead of displacements that are linear in it.",
    ),
    click.option(
        "--fit",
        type=click.Choice(["plain", "robust"]),
        default="plain",
        show_default=True,
        help="Which fit's estimates come first.",
    ),
    option(
        "--reject",
        metavar="RULE",
        help="Leave rows out: the suspects of the robust fit, or all that are farther from it "
        "than this number of standard deviations.",
    ),
    click.option(
        "--level",
        type=float,
        default=_LEVEL,
        show_default=True,
        help="Probability of the intervals.",
    ),
)


_about_a_plan = option_group(
    option(
        "--plan",
        "count",
        type=click.IntRange(1, 10_000),
        metavar="N",
        help="Choose N rows to measure instead; DATA.csv is not needed.",
    ),
    option(
        "--criterion",
        type=click.Choice(["worst", "all", "posture"]),
        help="What the plan makes best: the widest interval (worst, the default), the "
        "determinant of all compliances (D-optimal), or the deflection at the posture --q under "
        "--load.",
    ),
    option("--q", type=JointValues(), help="Posture of --criterion posture; default the file's."),
    option("--load", type=WRENCH, help="Load of --criterion posture, along F."),
    option("--mass", type=Number("KG", above_zero=True), help="Mass hung on the body in the plan."),
    option(
        "--force",
        type=Number("N", above_zero=True),
        help="Force on the body in the plan, along an axis of F.",
    ),
    repeated_option(
        "--range",
        "ranges",
        type=Axes("JOINT=LOW:HIGH"),
        help="Range of a joint in the plan, rad or m.",
    ),
    repeated_option(
        "--within",
        type=Axes("AXIS=LOW:HIGH", frame=True),
        help="Volume of the measured point in the plan: x, y, z in F; z keeps it off the floor.",
    ),
    option(
        "--candidates",
        type=click.IntRange(1, 100_000),
        metavar="N",
        help="Random postures that the plan chooses from; default 10000 for the widest interval "
        "of an open arm, else 1000.",
    ),
    option(
        "--have",
        type=click.Path(path_type=Path),
        metavar="FILE.csv",
        help="Rows that are measured already; the plan adds to them.",
    ),
    option(
        "--simulate",
        type=click.IntRange(min=0),
        metavar="SEED",
        help="Fill the columns of --sd into the rows of DATA.csv, with noise of that size, as "
        "MECHANISM would show them.",
    ),
    option(
        "--outliers",
        type=click.IntRange(min=1),
        metavar="N",
        help="Rows of --simulate with an error of 20 standard deviations.",
    ),
    option(
        "--csv",
        type=OutputFile("FILE.csv", ".csv"),
        help="Write the rows of --plan, to be filled in, or of --simulate.",
    ),
)


@dataclass(frozen=True)
class _Request:
    """What the options about table and fit say."""

    point: list[float] | None
    load_at: list[float] | None
    axes: str | None
    units: str | None
    sd: tuple[str, ...]
    unknown: tuple[str, ...]
    tie: tuple[str, ...]
    known: tuple[str, ...]
    prior: tuple[str, ...]
    offsets: str | None
    loaded: bool
    fit: str
    reject: str | None
    level: float

    @property
    def of_table(self) -> dict[str, Any]:
        """Keywords for reading the table."""
        units = units_of(self.units)
        return {
            "axes": self.axes,
            "units": units,
            "deviations": deviations_of(self.sd, units),
            "point": tuple(self.point or (0.0, 0.0, 0.0)),
            "load_at": None if self.load_at is None else tuple(self.load_at),
        }

    @property
    def shown(self) -> dict[str, str] | None:
        """Units in which the mechanism's numbers are given and shown."""
        kinds = ("length", "angle") if given_length() == 1.0 else ("angle",)
        return {k: u for k, u in units_of(self.units).items() if k in kinds} or None

    def of_unknowns(self, elastic: Any) -> dict[str, Any]:
        """Keywords about what is to be found."""
        known = in_own_units(stiffnesses_of(self.known, "--known", 1), given_length(), elastic)
        priors = in_own_units(stiffnesses_of(self.prior, "--prior", 2), given_length(), elastic)
        return {
            "sought": [part for text in self.unknown for part in _words(text)],
            "ties": ties_of(self.tie),
            "known": {name: values[0] for name, values in known.items()},
            "priors": {name: (values[0], values[1]) for name, values in priors.items()},
        }

    def check_without_fit(self, *, is_plan: bool) -> None:
        """Refuse what only a fit, or only what precedes it, could take into account."""
        idle = {
            "fit": self.fit != "plain",
            "reject": self.reject is not None,
            "offsets": self.offsets is not None,
        }
        if is_plan:
            idle["loaded"] = self.loaded
        else:
            idle |= {
                name: bool(getattr(self, name)) for name in ("unknown", "tie", "known", "prior")
            }
            idle["level"] = self.level != _LEVEL
        for name, is_given in idle.items():
            if is_given:
                does = "planned" if is_plan else "simulated"
                raise InputError(
                    f"changes nothing of what is {does}",
                    where=f"--{name}",
                    expected="DATA.csv, measured",
                )

    @property
    def of_fit(self) -> dict[str, Any]:
        """Keywords for the fit."""
        return {
            "offsets": self.offsets,
            "loaded": self.loaded,
            "fit": self.fit,
            "reject": reject_of(self.reject),
            "level": self.level,
        }


@click.command(name="identify", cls=UnitsCommand, epilog=_EPILOG)
@click.argument("mechanism")
@click.argument("table", metavar="[DATA.csv]", required=False)
@gathered(option_group(_about_the_table, _about_the_fit), "request", _Request)
@gathered(_about_a_plan, "asked", PlanRequest)
@option(
    "-o",
    "--output",
    type=OutputFile("FILE.yaml", ".yaml", ".yml"),
    help="Write a mechanism file with the stiffnesses and their covariance.",
)
@option("--plot", type=PICTURE, help="Draw the residuals against load, posture and time.")
@json_option
@gathered(option_group(frame_option, tool_options, file_options), "robot", MechanismRequest)
def command(
    table: str | None,
    robot: MechanismRequest,
    output: Path | None,
    plot: Path | None,
    as_json: bool,
    request: _Request,
    asked: PlanRequest,
) -> None:
    """Joint stiffness of MECHANISM from the loads and deflections in DATA.csv.

    One row a measurement under a line of names: joints (rad, or "name [deg]"); the load fx,fy,fz,
    mx,my,mz, or mass; what was measured, any of dx,dy,dz, drx,dry,drz, d along nx,ny,nz, x,y,z,
    roll,pitch,yaw; standard deviations sd_NAME; session; time. The page "Which joint stiffness do
    I enter?" says how to measure.
    """
    of_table, of_fit = request.of_table, request.of_fit
    robot = replace(robot, units=request.shown)
    asked.check(table)
    if table is None or asked.simulate is not None:
        if output is not None or plot is not None:
            raise InputError("-o and --plot need measurements", expected="DATA.csv, measured")
        request.check_without_fit(is_plan=table is None)
        elastic = robot.in_frame(robot.frame)
        if table is None:
            data, text = asked.run_plan(elastic, of_table, request)
        else:
            data, text = asked.run_simulation(elastic, table, of_table, request)
        tell(as_json, data, robot.mechanism, text)
        return
    if output is not None:
        _check_written(robot)
    elastic = robot.in_frame(robot.frame)

    import numpy as np

    from cartstiff.identify.campaign import identify
    from cartstiff.identify.table import read_measurements

    measured = read_measurements(Path(table), elastic, **of_table)
    say_read(table, measured, request.axes)
    with np.errstate(all="ignore"):
        result = identify(
            elastic,
            measured,
            **request.of_unknowns(elastic),
            **of_fit,
            progress=_progress,
        )
    _write(result, robot, Path(table), output, plot)

    from cartstiff.report.identification import describe_identification

    tell(as_json, result.as_dict(), robot.mechanism, lambda: describe_identification(result))


def _check_written(robot: MechanismRequest) -> None:
    """Refuse to write a file that would not hold what options say of the robot."""
    options = {
        "--tcp": robot.tcp,
        "--payload": robot.payload,
        "--xacro-arg": robot.xacro_args,
        "--package-path": robot.package_path,
    }
    if names := [name for name, value in options.items() if value]:
        raise InputError(
            f"the file written would not hold what {', '.join(names)} say",
            where="-o",
            expected="a mechanism file that says it, as MECHANISM",
        )


def _write(
    result: Any, robot: MechanismRequest, table: Path, output: Path | None, plot: Path | None
) -> None:
    """The files that were asked for."""
    from cartstiff.identify.writing import mechanism_file
    from cartstiff.report.output import write_files

    def identified_file() -> str:
        if output is None:
            raise TypeError("no file was asked for")
        return mechanism_file(
            result, robot.mechanism, robot.frame, output, one_line(table.name)
        ).decode()

    def drawn() -> Any:
        from cartstiff.report.identification import draw_residuals

        return draw_residuals(result)

    write_files((output, identified_file), (plot, drawn))


def _words(text: str) -> list[str]:
    """Names separated by commas; the axes of a link stay with it."""
    return [text.strip()] if ":" in text else [part.strip() for part in text.split(",")]


def _progress(step: int, size: float) -> None:
    """A line on a terminal for each step of a long fit."""
    if sys.stderr.isatty():
        say(f"step {step}: residuals of {size:.6g} standard deviations in all", error=True)
