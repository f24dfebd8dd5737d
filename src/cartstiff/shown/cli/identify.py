"""``cartstiff identify``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import click

from cartstiff.core import choices
from cartstiff.core.errors import InputError, check_name, one_line
from cartstiff.shown.cli.declare import Overrides
from cartstiff.shown.cli.options import (
    PICTURES,
    Amount,
    Axis,
    ByName,
    Files,
    JointValues,
    Number,
    OutputFiles,
    Pairs,
    Point,
    Printed,
    Setup,
    Values,
    Wrench,
    declared,
    only_endings,
)
from cartstiff.shown.cli.output import say, say_unused


def deviations_of(amounts: Mapping[str, tuple[float, str]]) -> dict[str, float]:
    """Return the standard deviations by column in SI, from --sd."""
    from cartstiff.files.tables import UNITS
    from cartstiff.wings.identify.measurements import MEASURED

    deviations = {}
    for name, (number, unit) in amounts.items():
        check_name("column", name, MEASURED, "--sd")
        kind = MEASURED[name]
        known = UNITS[kind]
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
                "cannot be used",
                where=f"--sd {name}",
                expected="above zero",
                got=f"{number:g}",
            )
        deviations[name] = number * known[unit]
    return deviations


@dataclass(frozen=True)
class Table:
    """Table of measurements.

    Parameters
    ----------
    sd
        Standard deviation of a column, such as dx=0.02mm; else estimated.
    """

    API: ClassVar = ("wings/identify/measurements.py read_measurements axes=load_axes",)

    point: Point = None
    load_at: Point = None
    axes: choices.Axes | None = None
    sd: Annotated[
        dict[str, tuple[float, str]] | None,
        ByName("COLUMN=VALUE[UNIT]", Amount("VALUE[UNIT]")),
    ] = None

    @property
    def keywords(self) -> dict[str, Any]:
        """Arguments for reading the table."""
        return {
            "load_axes": self.axes,
            "deviations": deviations_of(self.sd or {}),
            "point": tuple(self.point or (0.0, 0.0, 0.0)),
            "load_at": None if self.load_at is None else tuple(self.load_at),
        }

    def read(self, path: Path, elastic: Any, **settings: Any) -> Any:
        """Read the measurements, and report unused columns on standard error."""
        from cartstiff.wings.identify.measurements import read_measurements

        measured = read_measurements(path, elastic, **{**self.keywords, **settings})
        words = "" if self.axes else "; its loads, if any, are along the body's axes"
        say_unused(path, measured.unused, words)
        return measured

    def deviations(self, elastic: Any) -> dict[str, float]:
        """Return the standard deviations of --sd in the mechanism's units."""
        from cartstiff.core.units import SI, convert_length
        from cartstiff.wings.identify.measurements import MEASURED

        spreads = self.keywords["deviations"]
        if not spreads:
            raise InputError(
                "no measured column is named",
                where="--sd",
                expected="COLUMN=VALUE for each column, such as d=0.005mm",
            )
        length, _ = convert_length(SI, elastic.units)
        return {
            n: s * (length if MEASURED[n] == "length" else 1.0)
            for n, s in spreads.items()
        }


@dataclass(frozen=True)
class Fit:
    """Fit.

    Parameters
    ----------
    unknown : NAME
        Spring, leg or line to be found, by name; joints (the default), lines, links; a
        compliant link: LINK (its 6x6), LINK:diagonal, LINK:rx,ry. Beside springs, for
        measured positions: zeros (of joints; or JOINT.zero), tool, base.
    tie : A=B
    """

    API: ClassVar = (
        "wings/identify/identification.py identify",
        "wings/identify/unknowns.py unknowns_of tie=ties",
    )
    RARE: ClassVar = "tie offsets"

    unknown: tuple[str, ...] = ()
    tie: tuple[str, ...] = ()
    offsets: Literal["rigid", "translation", "none"] | None = None
    loaded: bool = False
    fit: Literal["plain", "robust"] | None = None

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
        }

    def check_unused(self) -> None:
        """Refuse options that only a fit uses."""
        for name in ("fit", "offsets", "loaded"):
            if getattr(self, name) != getattr(Fit, name):
                raise InputError(
                    "changes nothing of a plan",
                    where=f"--{name}",
                    expected="DATA.csv, measured",
                )

    @property
    def keywords(self) -> dict[str, Any]:
        """Arguments for the fit."""
        return {name: getattr(self, name) for name in ("offsets", "loaded", "fit")}


@dataclass(frozen=True)
class Plan:
    """Plan.

    Parameters
    ----------
    plan : N
        Choose N rows to measure instead; DATA.csv is not needed.
    q
        Posture of --criterion posture; default the file's.
    load
        Load of --criterion posture, along F.
    """

    API: ClassVar = ("wings/identify/plan.py plan", "wings/identify/plan.py candidates")
    NEEDS: ClassVar = {
        "criterion q load mass force ranges within": "plan",
    }
    EXCLUSIVE: ClassVar = ("mass force",)
    RARE: ClassVar = "q load ranges within"

    plan: Annotated[int | None, click.IntRange(1, 10_000)] = None
    criterion: Literal["worst", "all", "posture"] | None = None
    q: Annotated[Values | None, JointValues()] = None
    load: Wrench = None
    mass: Annotated[float | None, Number("KG", above_zero=True, kind="mass")] = None
    force: Annotated[float | None, Number("N", above_zero=True, kind="force")] = None
    ranges: Annotated[Axis, Pairs("JOINT=LOW:HIGH"), "--range"] = None
    within: Annotated[Axis, Pairs("AXIS=LOW:HIGH")] = None

    def run(
        self,
        elastic: Any,
        table: Table,
        fit: Fit,
        out: Printed,
        output: Files,
    ) -> None:
        """Choose and print the rows to be measured."""
        import numpy as np

        from cartstiff.wings.identify.answer import answer_of_plan
        from cartstiff.wings.identify.measurements import table_text
        from cartstiff.wings.identify.plan import candidates, plan
        from cartstiff.wings.identify.unknowns import unknowns_of

        spreads = table.deviations(elastic)
        unknowns = unknowns_of(elastic, **fit.unknowns)
        offered = candidates(
            elastic,
            spreads,
            mass=self.mass or 0.0,
            force=(self.force or 0.0) / elastic.units.newtons,
            ranges=self.ranges,
            within=self.within,
            point=table.keywords["point"],
            load_at=table.keywords["load_at"],
        )
        test = None
        if self.criterion == "posture":
            if self.load is None:
                raise InputError(
                    "the criterion needs a load",
                    where="--criterion posture",
                    expected="--load",
                )
            given = None if self.q is None else self.q.of(elastic.names)
            test = elastic.placed(given, "--q")[1].q, np.array(self.load)
        chosen = plan(
            unknowns,
            offered,
            self.plan or 1,
            criterion=self.criterion or "worst",
            test=test,
        )
        out.answer(
            chosen.to_dict(),
            answer_of_plan(chosen),
            output,
            csv=lambda: table_text(chosen.rows, elastic, tuple(spreads)),
        )


@declared("identify")
def command(
    setup: Annotated[
        Setup,
        Overrides(
            "q pose pose_of lengths springs stiffness rest actuate load load_at world "
            "load_kind",
            because="the data have postures and loads, and the springs are "
            "what is sought",
        ),
    ],
    table: Table,
    fit: Fit,
    plan: Plan,
    out: Printed,
    data: Path | None = None,
    *,
    output: Annotated[Files, OutputFiles(".yaml", ".csv", *PICTURES)] = None,
) -> None:
    """Joint stiffness of MECHANISM from the loads and deflections in DATA.csv.

    DATA.csv has a line of column names, then one measurement a row. The columns are the
    joints (rad, or "name [deg]"); the load (fx,fy,fz, mx,my,mz, or mass); the measured
    numbers (any of dx,dy,dz, drx,dry,drz, x,y,z, roll,pitch,yaw, or d along nx,ny,nz);
    and, if wanted, standard deviations (sd_NAME), session and time. The page "Which joint
    stiffness do I enter?" of the documentation says how to measure.

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
        Write the answer (.json); a mechanism file with the recommended stiffnesses and
        their covariance (.yaml); the residuals against load, posture and time (.png,
        .svg, .pdf); the rows of --plan, to be filled in (.csv).

    Examples
    --------
    cartstiff identify ur5 measured.csv
    cartstiff identify arm.yaml measured.csv --sd d=0.005mm -o known.yaml
    cartstiff identify arm.yaml measured.csv --fit robust -o residuals.png
    cartstiff identify ur5 measured.csv --tie wrist_1_joint=wrist_2_joint
    cartstiff identify ur5 --plan 12 --mass 5 --sd d=0.005mm -o to_do.csv
    cartstiff identify ur5 --plan 6 --force 100 --sd dx=0.02mm --criterion all
    """
    if data is None and plan.plan is None:
        raise InputError("no measurements", expected="DATA.csv, or --plan N")
    if data is not None and plan.plan is not None:
        raise InputError("give DATA.csv or --plan, not both")
    if plan.criterion != "posture" and (plan.q is not None or plan.load is not None):
        raise InputError("--q and --load are for --criterion posture")
    if data is None:
        only_endings(output, ".json", ".csv", others="DATA.csv")
        fit.check_unused()
    else:
        only_endings(output, ".json", ".yaml", *PICTURES, others="--plan")
    written = (output or {}).get(".yaml")
    if written is not None:
        _check_written(setup)
    elastic = setup.in_frame(setup.frame)
    if data is None:
        plan.run(elastic, table, fit, out, output)
        return

    import numpy as np

    from cartstiff.wings.identify.answer import answer_of_identification
    from cartstiff.wings.identify.identification import identify
    from cartstiff.wings.identify.unknowns import unknowns_of
    from cartstiff.wings.identify.written_file import keys_to_write, mechanism_file

    measured = table.read(data, elastic)
    keys: dict[str, Any] = {}
    if written is not None:  # what cannot be written is refused before the fit
        unknowns = unknowns_of(elastic, **fit.unknowns)
        keys = keys_to_write(unknowns, setup.mechanism, setup.frame, written)
    with np.errstate(all="ignore"):
        result = identify(
            elastic, measured, **fit.unknowns, **fit.keywords, progress=_progress
        )

    out.answer(
        result.to_dict(),
        answer_of_identification(result),
        output,
        yaml=lambda: mechanism_file(result, keys, one_line(data.name)),
        picture=result.plot,
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
        say(
            f"step {step}: residuals of {size:.6g} standard deviations in all", error=True
        )
