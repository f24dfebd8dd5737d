"""``cartstiff identify``."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from cartstiff.cli.options import (
    FILE,
    PICTURE,
    POINT,
    WRENCH,
    Axes,
    JointValues,
    MechanismRequest,
    Number,
    OutputFile,
    TableUnits,
    UnitsCommand,
    Values,
    choice,
    file_options,
    flag,
    frame_option,
    gathered,
    given_length,
    json_option,
    option,
    option_group,
    repeated_option,
    tool_options,
)
from cartstiff.cli.output import say, say_unused, tell
from cartstiff.errors import InputError, check_name, one_line
from cartstiff.parsing import parse_numbers

_VALUE = re.compile(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\[?([A-Za-z][^\[\]]*)?\]?")


def _pairs(texts: Iterable[str], option: str) -> dict[str, str]:
    """``NAME=TEXT`` of an option that may be given several times."""
    pairs: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise InputError("cannot be used", where=option, expected="NAME=VALUE", got=repr(text))
        if name.strip() in pairs:
            raise InputError("given twice", where=option, got=repr(name.strip()))
        pairs[name.strip()] = value.strip()
    return pairs


def deviations_of(texts: Iterable[str], units: Mapping[str, str]) -> dict[str, float]:
    """Standard deviations by column in SI, from "dx=0.02 mm"."""
    from cartstiff.identify.measurements import MEASURED
    from cartstiff.loading.tables import UNITS

    deviations = {}
    for name, text in _pairs(texts, "--sd").items():
        check_name("column", name, MEASURED, "--sd")
        kind = MEASURED[name]
        match = _VALUE.fullmatch(text)
        number, unit = (match[1], match[2]) if match else (text, None)
        known = UNITS[kind]
        if unit is None and kind not in units:
            raise InputError(
                f"--sd of {name!r} declares no unit",
                where="--sd",
                got=text,
                expected=f"a number with one of {', '.join(known)}",
            )
        unit = (unit or units[kind]).strip()
        check_name("unit", unit, known, f"--sd {name}")
        value = parse_numbers(number, f"--sd {name}", 1)[0] * known[unit]
        if not value > 0.0:
            raise InputError(
                "cannot be used", where=f"--sd {name}", expected="above zero", got=text
            )
        deviations[name] = value
    return deviations


def stiffnesses_of(texts: Iterable[str], option: str, count: int) -> dict[str, list[float]]:
    """Numbers by spring, from "NAME=K" or "NAME=K,DEVIATION"."""
    return {
        name: parse_numbers(text, f"{option} {name}", count)
        for name, text in _pairs(texts, option).items()
    }


def in_own_units(
    springs: Mapping[str, list[float]], a: float, elastic: Any
) -> dict[str, list[float]]:
    """Stiffnesses by spring where lengths of `elastic` are a times as large in number."""
    from cartstiff.mechanisms.elements import Elements

    elements = Elements(elastic)
    slides = dict(zip(elements.names, elements.is_length, strict=True))
    slides |= {c.name: c.is_length for c in elastic.mechanism.coordinates}
    return {
        name: [k / a if slides.get(name) else k * a for k in numbers]
        for name, numbers in springs.items()
    }


def ties_of(texts: Iterable[str]) -> list[list[str]]:
    """Springs that are equal, from "A=B=C"."""
    return [[name.strip() for name in text.split("=")] for text in texts]


def reject_of(text: str | None) -> float | str | None:
    """A rule: "suspects", or a number of standard deviations."""
    if text is None or text == "suspects":
        return text
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(
            "unknown rule",
            where="--reject",
            got=repr(text),
            expected="suspects, or a number of standard deviations",
        )
    return number


_Answer = tuple[dict[str, Any], Callable[[], str]]


def say_read(table: str, measured: Any, axes: str | None) -> None:
    """On standard error, what of a table plays no part, and along which axes its loads are."""
    words = "" if axes else "; its loads, if any, are along the body's axes"
    say_unused(Path(table), measured.unused, words)


@dataclass(frozen=True)
class PlanRequest:
    """The options about a plan and a simulation."""

    count: int | None
    criterion: str | None
    q: Values | None
    load: list[float] | None
    mass: float | None
    force: float | None
    ranges: dict[str, tuple[float, ...]]
    within: dict[str, tuple[float, ...]]
    candidates: int | None
    have: Path | None
    simulate: int | None
    outliers: int | None
    csv: Path | None

    def check(self, table: str | None) -> None:
        """Refuse options that do not go together."""
        if self.count is None:
            for name in (
                "criterion",
                "q",
                "load",
                "mass",
                "force",
                "ranges",
                "within",
                "candidates",
                "have",
            ):
                if getattr(self, name):
                    option = {"ranges": "range"}.get(name, name)
                    raise InputError("is for --plan", where=f"--{option}")
            if table is None:
                raise InputError("no measurements", expected="DATA.csv, or --plan N")
        elif table is not None:
            raise InputError(
                "give DATA.csv or --plan, not both: --have names rows that are measured already"
            )
        if self.simulate is None and self.outliers is not None:
            raise InputError("is for --simulate", where="--outliers")
        if self.count is None and self.simulate is None and self.csv is not None:
            raise InputError("is for --plan and --simulate", where="--csv")
        if self.count is not None and self.simulate is not None:
            raise InputError("give --plan or --simulate, not both")
        if self.mass is not None and self.force is not None:
            raise InputError("give --mass or --force, not both")
        if self.criterion != "posture" and (self.q is not None or self.load is not None):
            raise InputError("--q and --load are for --criterion posture")

    def run_plan(self, elastic: Any, of_table: dict[str, Any], request: Any) -> _Answer:
        """Rows to be measured."""
        import numpy as np

        from cartstiff.identify.plan import beside, candidates, plan
        from cartstiff.identify.table import read_measurements, table_text
        from cartstiff.identify.unknowns import unknowns_of
        from cartstiff.report.identification import describe_plan
        from cartstiff.report.output import write_files

        spreads = _deviations(of_table["deviations"], elastic)
        unknowns = unknowns_of(elastic, **request.of_unknowns(elastic))
        point = of_table["point"]
        quick = elastic.mechanism.kind == "serial" and self.criterion in (None, "worst")
        offered = candidates(
            elastic,
            spreads,
            count=self.candidates or (10_000 if quick else 1000),
            mass=self.mass or 0.0,
            force=(self.force or 0.0) / elastic.units.newtons,
            ranges=self.ranges,
            within=self.within,
            point=point,
            load_at=of_table["load_at"],
        )
        near = partial(beside, elastic, ranges=self.ranges, within=self.within)
        have = None
        if self.have is not None:
            have = read_measurements(self.have, elastic, **of_table)
        test = None
        if self.criterion == "posture":
            if self.load is None:
                raise InputError(
                    "the criterion needs a load", where="--criterion posture", expected="--load"
                )
            given = None if self.q is None else self.q.of(elastic.names)
            test = elastic.placed(given, "--q")[1].q, np.array(self.load)
        chosen = plan(
            unknowns,
            offered,
            self.count or 1,
            criterion=self.criterion or "worst",  # type: ignore[arg-type]
            test=test,
            have=have,
            beside=near,
            level=request.level,
        )
        write_files((self.csv, lambda: table_text(chosen.rows, elastic, tuple(spreads))))
        return chosen.as_dict(), lambda: describe_plan(chosen)

    def run_simulation(
        self, elastic: Any, table: str, of_table: dict[str, Any], request: Any
    ) -> _Answer:
        """Measurements as the mechanism would show them."""
        import numpy as np

        from cartstiff.identify.plan import simulated
        from cartstiff.identify.table import read_measurements, table_text
        from cartstiff.report.output import write_files

        if self.csv is None:
            raise InputError(
                "simulated measurements need a file", where="--simulate", expected="--csv FILE.csv"
            )
        reading = {**of_table, "deviations": None}
        settings = read_measurements(Path(table), elastic, **reading, open_cells=True)
        say_read(table, settings, of_table["axes"])
        if self.outliers is not None and self.outliers > len(settings):
            raise InputError(
                "more outliers than rows",
                where="--outliers",
                expected=f"at most {len(settings)}",
                got=self.outliers,
            )
        spreads = _deviations(of_table["deviations"], elastic)
        rng = np.random.default_rng(self.simulate)
        bad = rng.choice(len(settings), self.outliers or 0, replace=False).tolist()
        campaign = simulated(
            elastic, settings, spreads, seed=self.simulate or 0, outliers=bad, loaded=request.loaded
        )
        write_files((self.csv, lambda: table_text(campaign, elastic)))
        rows = sorted(int(n) + 1 for n in bad)
        data = {
            "schema": "cartstiff-identify-simulation/1",
            "rows": len(campaign),
            "outliers": rows,
        }
        words = f"{len(campaign)} rows" + (f", gross errors in rows {rows}" if rows else "")
        return data, lambda: words


def _deviations(spreads: dict[str, float], elastic: Any) -> dict[str, float]:
    """Standard deviations of --sd in the mechanism's units."""
    from cartstiff.identify.measurements import MEASURED
    from cartstiff.mechanisms.contract import SI, convert_length

    if not spreads:
        raise InputError(
            "no measured column is named",
            where="--sd",
            expected="COLUMN=VALUE for each column, such as d=0.005mm",
        )
    length, _ = convert_length(SI, elastic.units)
    return {n: s * (length if MEASURED[n] == "length" else 1.0) for n, s in spreads.items()}


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
        "--point", POINT, "Point of the body, in its frame, that was measured; default its origin."
    ),
    option(
        "--load-at",
        POINT,
        "Point of the body, in its frame, at which loads act; default the measured one.",
    ),
    choice(
        "--axes",
        ["base", "body", "world"],
        "Axes of the columns mx,my,mz,fx,fy,fz; default base, and body in a table "
        "of `cartstiff path`.",
    ),
    option(
        "--units",
        TableUnits("UNITS"),
        "Units of numbers given and shown, such as mm,deg, and "
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
        help="Unknown stiffness: a spring, leg or line by name; joints (the default), lines, "
        "links; a compliant link: LINK (its 6x6), LINK:diagonal, LINK:rx,ry.",
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
    choice(
        "--offsets",
        ["rigid", "translation", "none"],
        "Unknown placement of the measuring frame in each session of a table with "
        "positions: position and rotation (rigid, the default), position alone, or none.",
    ),
    flag(
        "--loaded", "Fit equilibria under the load instead of displacements that are linear in it."
    ),
    choice("--fit", ["plain", "robust"], "Fit whose estimates come first.", default="plain"),
    option(
        "--reject",
        None,
        "Leave rows out: the suspects of the robust fit, or all that are farther from it "
        "than this number of standard deviations.",
        metavar="RULE",
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
        "--plan count",
        click.IntRange(1, 10_000),
        "Choose N rows to measure instead; DATA.csv is not needed.",
        metavar="N",
    ),
    option(
        "--criterion",
        click.Choice(["worst", "all", "posture"]),
        "Quantity that the plan minimises: the widest interval (worst, the default), the "
        "determinant of all compliances (D-optimal), or the deflection at the posture --q under "
        "--load.",
    ),
    option("--q", JointValues(), "Posture of --criterion posture; default the file's."),
    option("--load", WRENCH, "Load of --criterion posture, along F."),
    option("--mass", Number("KG", above_zero=True), "Mass hung on the body in the plan."),
    option(
        "--force",
        Number("N", above_zero=True),
        "Force on the body in the plan, along an axis of F.",
    ),
    repeated_option(
        "--range ranges", Axes("JOINT=LOW:HIGH"), "Range of a joint in the plan, rad or m."
    ),
    repeated_option(
        "--within",
        Axes("AXIS=LOW:HIGH", frame=True),
        "Volume of the measured point in the plan: x, y, z in F; z keeps it off the floor.",
    ),
    option(
        "--candidates",
        click.IntRange(1, 100_000),
        "Random postures that the plan chooses from; default 10000 for the widest interval "
        "of an open arm, else 1000.",
        metavar="N",
    ),
    option(
        "--have", FILE, "Rows that are measured already; the plan adds to them.", metavar="FILE.csv"
    ),
    option(
        "--simulate",
        click.IntRange(min=0),
        "Fill the columns of --sd into the rows of DATA.csv, with noise of that size, as "
        "MECHANISM would show them.",
        metavar="SEED",
    ),
    option(
        "--outliers",
        click.IntRange(min=1),
        "Rows of --simulate with an error of 20 standard deviations.",
        metavar="N",
    ),
    option(
        "--csv",
        OutputFile("FILE.csv", ".csv"),
        "Write the rows of --plan, to be filled in, or of --simulate.",
    ),
)


@dataclass(frozen=True)
class _Request:
    """Values of the options for table and fit."""

    point: list[float] | None
    load_at: list[float] | None
    axes: str | None
    units: dict[str, str] | None
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
        units = self.units or {}
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
        return {k: u for k, u in (self.units or {}).items() if k in kinds} or None

    def of_unknowns(self, elastic: Any) -> dict[str, Any]:
        """Keywords for the unknowns."""
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
    "-o --output",
    OutputFile("FILE.yaml", ".yaml", ".yml"),
    "Write a mechanism file with the stiffnesses and their covariance.",
)
@option("--plot", PICTURE, "Draw the residuals against load, posture and time.")
@json_option
@gathered(option_group(frame_option, tool_options, file_options), "robot", MechanismRequest)
def command(
    table: str | None,
    robot: MechanismRequest,
    output: Path | None,
    plot: Path | None,
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
        tell(data, robot.mechanism, text)
        return
    if output is not None:
        _check_written(robot)
    elastic = robot.in_frame(robot.frame)

    import numpy as np

    from cartstiff.identify.identification import identify
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

    tell(result.as_dict(), robot.mechanism, lambda: describe_identification(result))


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
    """Write the requested files."""
    from cartstiff.identify.result import mechanism_file
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
