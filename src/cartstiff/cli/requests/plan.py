"""What ``cartstiff identify`` does without measurements: plan them, or simulate them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from cartstiff.cli.output import say_unused
from cartstiff.cli.types import Values
from cartstiff.errors import InputError

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

        from cartstiff.identify.candidates import beside, candidates
        from cartstiff.identify.plan import plan
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

        from cartstiff.identify.candidates import simulated
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
            "what is to be measured, and how well?",
            where="--sd",
            expected="COLUMN=VALUE for each column, such as d=0.005mm",
        )
    length, _ = convert_length(SI, elastic.units)
    return {n: s * (length if MEASURED[n] == "length" else 1.0) for n, s in spreads.items()}
