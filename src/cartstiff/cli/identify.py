"""``cartstiff identify``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import click

from cartstiff import choices
from cartstiff.cli.declare import OptionType, Overrides
from cartstiff.cli.options import (
    Amount,
    Axis,
    ByName,
    JointValues,
    Number,
    Output,
    OutputFile,
    Pairs,
    Point,
    Setup,
    Springs,
    Stiffnesses,
    TableUnits,
    Values,
    Wrench,
    declared,
    given_length,
)
from cartstiff.cli.output import say, say_unused
from cartstiff.errors import InputError, check_name, one_line
from cartstiff.parsing import parse_numbers


def deviations_of(
    amounts: Mapping[str, tuple[float, str]], units: Mapping[str, str]
) -> dict[str, float]:
    """Return the standard deviations by column in SI, from --sd and --units."""
    from cartstiff.identify.measurements import MEASURED
    from cartstiff.loading.tables import UNITS

    deviations = {}
    for name, (number, unit) in amounts.items():
        check_name("column", name, MEASURED, "--sd")
        kind = MEASURED[name]
        known, unit = UNITS[kind], unit or units.get(kind, "")
        if not unit:
            raise InputError(
                f"{name!r} declares no unit",
                where="--sd",
                got=f"{number:g}",
                expected=f"a number with one of {', '.join(known)}",
            )
        check_name("unit", unit, known, f"--sd {name}")
        if not number > 0.0:
            raise InputError(
                "cannot be used", where=f"--sd {name}", expected="above zero", got=f"{number:g}"
            )
        deviations[name] = number * known[unit]
    return deviations


class Rule(OptionType):
    """The word "suspects", or a number of standard deviations."""

    def parsed(self, text: str, where: str) -> float | str:
        """The word or the number."""
        if text == "suspects":
            return text
        try:
            return parse_numbers(text, where, 1)[0]
        except InputError:
            expected = "suspects, or a number of standard deviations"
            raise InputError(
                "unknown rule", where=where, expected=expected, got=repr(text)
            ) from None


#: Probability of the intervals.
_LEVEL = 0.95


@dataclass(frozen=True)
class Table:
    """Table of measurements.

    Parameters
    ----------
    units
        Units of numbers given and shown, such as mm,deg, and of columns without one in their head;
        there SI otherwise.
    sd
        Standard deviation of a column, such as dx=0.02mm; else estimated.
    """

    API: ClassVar = ("identify/measurements.py read_measurements",)

    point: Point = None
    load_at: Point = None
    axes: choices.Axes | None = None
    units: Annotated[dict[str, str] | None, TableUnits("UNITS")] = None
    sd: Annotated[
        dict[str, tuple[float, str]] | None, ByName("COLUMN=VALUE[UNIT]", Amount("VALUE[UNIT]"))
    ] = None

    @property
    def keywords(self) -> dict[str, Any]:
        """Arguments for reading the table."""
        units = self.units or {}
        return {
            "axes": self.axes,
            "units": units,
            "deviations": deviations_of(self.sd or {}, units),
            "point": tuple(self.point or (0.0, 0.0, 0.0)),
            "load_at": None if self.load_at is None else tuple(self.load_at),
        }

    @property
    def shown(self) -> dict[str, str] | None:
        """Units in which the mechanism's numbers are given and shown."""
        kinds = ("length", "angle") if given_length() == 1.0 else ("angle",)
        return {k: u for k, u in (self.units or {}).items() if k in kinds} or None

    def read(self, path: Path, elastic: Any, **settings: Any) -> Any:
        """Read the measurements, and report unused columns on standard error."""
        from cartstiff.identify.measurements import read_measurements

        measured = read_measurements(path, elastic, **{**self.keywords, **settings})
        words = "" if self.axes else "; its loads, if any, are along the body's axes"
        say_unused(path, measured.unused, words)
        return measured

    def deviations(self, elastic: Any) -> dict[str, float]:
        """Return the standard deviations of --sd in the mechanism's units."""
        from cartstiff.identify.measurements import MEASURED
        from cartstiff.mechanisms.contract import SI, convert_length

        spreads = self.keywords["deviations"]
        if not spreads:
            raise InputError(
                "no measured column is named",
                where="--sd",
                expected="COLUMN=VALUE for each column, such as d=0.005mm",
            )
        length, _ = convert_length(SI, elastic.units)
        return {n: s * (length if MEASURED[n] == "length" else 1.0) for n, s in spreads.items()}


_Stiffnesses = dict[str, list[float]] | None


@dataclass(frozen=True)
class Fit:
    """Fit.

    Parameters
    ----------
    unknown : NAME
        Spring, leg or line to be found, by name; joints (the default), lines, links; a compliant
        link: LINK (its 6x6), LINK:diagonal, LINK:rx,ry. Beside springs, for measured positions:
        zeros (of joints; or JOINT.zero), tool, base.
    tie : A=B
    """

    API: ClassVar = (
        "identify/identification.py identify",
        "identify/unknowns.py unknowns_of tie=ties prior=priors",
    )
    RARE: ClassVar = "tie known prior offsets level"

    unknown: tuple[str, ...] = ()
    tie: tuple[str, ...] = ()
    known: Annotated[_Stiffnesses, Springs("NAME=K", Stiffnesses("K", 1))] = None
    prior: Annotated[_Stiffnesses, Springs("NAME=K,SD", Stiffnesses("K,SD", 2))] = None
    offsets: Literal["rigid", "translation", "none"] | None = None
    loaded: bool = False
    fit: Literal["plain", "robust"] = "plain"
    reject: Annotated[float | str | None, Rule("RULE")] = None
    level: float = _LEVEL

    @property
    def unknowns(self) -> dict[str, Any]:
        """Arguments for the unknowns."""
        return {
            # The axes of a link stay with it.
            "sought": [
                name.strip()
                for text in self.unknown
                for name in ([text] if ":" in text else text.split(","))
            ],
            "ties": [[name.strip() for name in text.split("=")] for text in self.tie],
            "known": {name: values[0] for name, values in (self.known or {}).items()},
            "priors": {name: (k, sd) for name, (k, sd) in (self.prior or {}).items()},
        }

    def check_unused(self, does: str) -> None:
        """Refuse options that only a fit uses, and for a simulation those of the unknowns."""
        is_plan = does == "planned"
        idle = ["fit", "reject", "offsets", *(["loaded"] if is_plan else [])]
        for name in idle if is_plan else [*idle, "unknown", "tie", "known", "prior", "level"]:
            if getattr(self, name) != getattr(Fit, name):
                raise InputError(
                    f"changes nothing of what is {does}",
                    where=f"--{name}",
                    expected="DATA.csv, measured",
                )

    @property
    def keywords(self) -> dict[str, Any]:
        """Arguments for the fit."""
        names = "offsets", "loaded", "fit", "level", "reject"
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True)
class Plan:
    """Plan and simulation.

    Parameters
    ----------
    plan : N
        Choose N rows to measure instead; DATA.csv is not needed.
    q
        Posture of --criterion posture; default the file's.
    load
        Load of --criterion posture, along F.
    candidates : N
        Random postures that the plan chooses from; default 4000 for an open arm, else 1000.
    have : FILE.csv
    simulate : SEED
        Simulate measurements, not a fit: fill the columns of --sd into the rows of DATA.csv, as
        MECHANISM would show them, with noise of that size.
    outliers : N
        Rows of --simulate with an error of 20 standard deviations.
    """

    API: ClassVar = ("identify/plan.py plan", "identify/plan.py candidates")
    NEEDS: ClassVar = {
        "criterion q load mass force ranges within candidates have": "plan",
        "outliers": "simulate",
    }
    EXCLUSIVE: ClassVar = ("plan simulate", "mass force")
    RARE: ClassVar = "q load ranges within candidates have outliers"

    plan: Annotated[int | None, click.IntRange(1, 10_000)] = None
    criterion: Literal["worst", "all", "posture"] | None = None
    q: Annotated[Values | None, JointValues()] = None
    load: Wrench = None
    mass: Annotated[float | None, Number("KG", above_zero=True)] = None
    force: Annotated[float | None, Number("N", above_zero=True)] = None
    ranges: Annotated[Axis, Pairs("JOINT=LOW:HIGH", axes=True), "--range"] = None
    within: Annotated[Axis, Pairs("AXIS=LOW:HIGH", frame=True)] = None
    candidates: Annotated[int | None, click.IntRange(1, 100_000)] = None
    have: Path | None = None
    simulate: Annotated[int | None, click.IntRange(min=0)] = None
    outliers: Annotated[int | None, click.IntRange(min=1)] = None

    def run(self, elastic: Any, table: Table, fit: Fit, out: Output, mechanism: str) -> None:
        """Choose and print the rows to be measured."""
        import numpy as np

        from cartstiff.identify.measurements import read_measurements, table_text
        from cartstiff.identify.plan import beside, candidates, plan
        from cartstiff.identify.unknowns import unknowns_of
        from cartstiff.report.identification import describe_plan

        spreads = table.deviations(elastic)
        unknowns = unknowns_of(elastic, **fit.unknowns)
        where: dict[str, Any] = {"ranges": self.ranges or {}, "within": self.within or {}}
        offered = candidates(
            elastic,
            spreads,
            count=self.candidates or (4000 if elastic.mechanism.kind == "serial" else 1000),
            mass=self.mass or 0.0,
            force=(self.force or 0.0) / elastic.units.newtons,
            **where,
            point=table.keywords["point"],
            load_at=table.keywords["load_at"],
        )
        have = None
        if self.have is not None:
            have = read_measurements(self.have, elastic, **table.keywords)
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
            self.plan or 1,
            criterion=self.criterion or "worst",
            test=test,
            have=have,
            beside=partial(beside, elastic, **where),
            level=fit.level,
        )
        out.show(
            chosen.to_dict(),
            mechanism,
            lambda: describe_plan(chosen),
            csv=lambda: table_text(chosen.rows, elastic, tuple(spreads)),
        )

    def run_simulation(
        self, elastic: Any, path: Path, table: Table, fit: Fit, out: Output, mechanism: str
    ) -> None:
        """Simulate and write measurements of the mechanism."""
        import numpy as np

        from cartstiff.identify.measurements import table_text
        from cartstiff.identify.plan import simulated

        if out.csv is None:
            raise InputError(
                "simulated measurements need a file", where="--simulate", expected="--csv FILE.csv"
            )
        settings = table.read(path, elastic, deviations=None, open_cells=True)
        if self.outliers is not None and self.outliers > len(settings):
            raise InputError(
                "more outliers than rows",
                where="--outliers",
                expected=f"at most {len(settings)}",
                got=self.outliers,
            )
        spreads, seed = table.deviations(elastic), self.simulate or 0
        rng = np.random.default_rng(seed)
        bad = rng.choice(len(settings), self.outliers or 0, replace=False).tolist()
        campaign = simulated(elastic, settings, spreads, seed=seed, outliers=bad, loaded=fit.loaded)
        rows = sorted(int(n) + 1 for n in bad)
        data = {
            "schema": "cartstiff-identify-simulation/1",
            "rows": len(campaign),
            "outliers": rows,
        }
        words = f"{len(campaign)} rows" + (f", gross errors in rows {rows}" if rows else "")
        out.show(data, mechanism, lambda: words, csv=lambda: table_text(campaign, elastic))


@declared(
    "identify",
    needs={"csv": "plan simulate"},
)
def command(
    setup: Annotated[
        Setup,
        Overrides(
            "q pose pose_of lengths units springs stiffness rest actuate load load_at world "
            "load_kind",
            because="the data have postures and loads, and the springs are what is sought",
        ),
    ],
    table: Table,
    fit: Fit,
    plan: Plan,
    out: Annotated[
        Output,
        Overrides(
            csv="Write the rows of --plan, to be filled in, or of --simulate.",
            plot="Draw the residuals against load, posture and time.",
        ),
    ],
    data: Path | None = None,
    *,
    output: Annotated[Path | None, OutputFile("FILE.yaml", ".yaml", ".yml")] = None,
) -> None:
    """Joint stiffness of MECHANISM from the loads and deflections in DATA.csv.

    DATA.csv has a line of column names, then one measurement a row. The columns are the joints
    (rad, or "name [deg]"); the load (fx,fy,fz, mx,my,mz, or mass); the measured numbers (any of
    dx,dy,dz, drx,dry,drz, x,y,z, roll,pitch,yaw, or d along nx,ny,nz); and, if wanted, standard
    deviations (sd_NAME), session and time. The page "Which joint stiffness do I enter?" of the
    documentation says how to measure.

    Parameters
    ----------
    setup
        The mechanism.
    table
        How the table is read.
    fit
        Estimated stiffnesses and method.
    plan
        Plan of measurements.
    out
        Output.
    data : [DATA.csv]
        The measurements.
    output
        Write a mechanism file, with the stiffnesses and their covariance.

    Examples
    --------
    cartstiff identify ur5 measured.csv
    cartstiff identify arm.yaml measured.csv --sd d=0.005mm -o known.yaml
    cartstiff identify arm.yaml measured.csv --units mm,deg --reject suspects --plot residuals.png
    cartstiff identify ur5 measured.csv --tie wrist_1_joint=wrist_2_joint --known wrist_3_joint=8000
    cartstiff identify ur5 --plan 12 --mass 5 --sd d=0.005mm --csv to_do.csv
    cartstiff identify ur5 --plan 6 --force 100 --sd dx=0.02mm --have measured.csv --criterion all
    cartstiff identify ur5 to_do.csv --simulate 1 --sd d=0.005mm --csv measured.csv
    """
    if data is None and plan.plan is None:
        raise InputError("no measurements", expected="DATA.csv, or --plan N")
    if data is not None and plan.plan is not None:
        raise InputError(
            "give DATA.csv or --plan, not both: --have names rows that are measured already"
        )
    if plan.criterion != "posture" and (plan.q is not None or plan.load is not None):
        raise InputError("--q and --load are for --criterion posture")
    if data is None or plan.simulate is not None:
        if output is not None or out.plot is not None:
            raise InputError("-o and --plot need measurements", expected="DATA.csv, measured")
        fit.check_unused("planned" if data is None else "simulated")
    if output is not None:
        _check_written(setup)
    setup = replace(setup, units=table.shown)
    elastic = setup.in_frame(setup.frame)
    if data is None:
        plan.run(elastic, table, fit, out, setup.mechanism)
        return
    if plan.simulate is not None:
        plan.run_simulation(elastic, data, table, fit, out, setup.mechanism)
        return

    import numpy as np

    from cartstiff.identify.identification import identify
    from cartstiff.identify.unknowns import unknowns_of
    from cartstiff.identify.written_file import keys_to_write, mechanism_file
    from cartstiff.report.identification import describe_identification
    from cartstiff.writing import write_whole

    measured = table.read(data, elastic)
    keys: dict[str, Any] = {}
    if output is not None:  # what cannot be written is refused before the fit
        unknowns = unknowns_of(elastic, **fit.unknowns)
        keys = keys_to_write(unknowns, setup.mechanism, setup.frame, output)
    with np.errstate(all="ignore"):
        result = identify(elastic, measured, **fit.unknowns, **fit.keywords, progress=_progress)

    if output is not None:
        name = one_line(data.name)
        write_whole(output, mechanism_file(result, keys, name))
    out.show(
        result.to_dict(),
        setup.mechanism,
        lambda: describe_identification(result),
        plot=result.plot,
    )


def _check_written(setup: Setup) -> None:
    """Refuse to write a mechanism file that would not contain options of the setup."""
    options = {
        "--tcp": setup.tcp,
        "--payload": setup.payload,
        "--xacro-arg": setup.xacro_args,
        "--package-path": setup.package_path,
    }
    if names := [name for name, value in options.items() if value]:
        raise InputError(
            f"the file written would not hold what {', '.join(names)} say",
            where="-o",
            expected="a mechanism file that says it, as MECHANISM",
        )


def _progress(step: int, size: float) -> None:
    """Print a line on a terminal for each step of a long fit."""
    if sys.stderr.isatty():
        say(f"step {step}: residuals of {size:.6g} standard deviations in all", error=True)
