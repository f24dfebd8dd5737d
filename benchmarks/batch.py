"""Many postures of every kind of mechanism: ``batch.py [--count N] [--only NAME ...]``.

Four stiffness matrices (three compliances, where a mechanism has fewer than six motions) of
postures 0.05 rad, or characteristic lengths, about home (a fiftieth of that where flexures hold the
platform), into buffers that are used again. Closed chains start with their motors moved on and
everything else still at home; compliant links are not deflected yet. The engine takes some of the
same postures, its numbers are compared before anything is timed, and contenders take turns. The
lean Pinocchio loop of a UR5 says how fast the machine is: the requirements are for one on which it
takes 30 us.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from many_postures import describe, ur5
from many_postures_peers import lean_loop

import cartstiff
from cartstiff import analyse_many

LOAD = np.array([1.0, -2.0, 3.0, 20.0, 30.0, -40.0])
ENGINE = 40
AGREEMENT = 1e-9
ARM = Path(__file__).resolve().parents[1] / "examples" / "flexible_arm.yaml"
FLEXIBLE_ARM = "ur5, two compliant links"


@dataclass(frozen=True)
class Row:
    """A mechanism, the size of its load, what is required (us), how far from home, rigid joints."""

    name: str
    load: float = 0.0
    required: float | None = None
    away: float = 0.05
    rigid: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """The name, and what of it is rigid."""
        return ", ".join([self.name, *(f"{joint} rigid" for joint in self.rigid)])


ROWS = (
    Row("ur5", 1.0),
    Row("panda", 1.0),
    Row("stewart-gough", required=0.5),
    Row("stewart-gough", 1.0, 0.5),
    Row("cable-robot", required=1.0),
    Row("cable-robot", 0.2, 1.0),
    Row("6-ups", required=5.0),
    Row("6-ups", 1.0, 5.0),
    Row("3-rps", required=5.0),
    Row("3-rps", 1.0, 5.0),
    Row("delta", required=5.0),
    Row("delta", 1.0),
    Row("6-pus", 1.0),
    Row("tricept", 1.0),
    Row("five-bar", 1.0),
    Row("3-rrr"),
    Row("3-rrr", 1.0),
    Row(FLEXIBLE_ARM, 1.0),
    Row("ur5", 1.0, rigid=("elbow_joint",)),
    Row("delta", rigid=("leg1/motor", "leg2/motor")),
    Row("flexure-hexapod", required=20.0, away=0.001),
    Row("flexure-hexapod", 0.3, 20.0, away=0.001),
)


def loaded(row: Row) -> cartstiff.ElasticMechanism:
    """A bundled mechanism, or the arm whose links give."""
    elastic = cartstiff.load(ARM if row.name == FLEXIBLE_ARM else row.name)
    return elastic.with_springs(dict.fromkeys(row.rigid, np.inf)) if row.rigid else elastic


def drawn(elastic: Any, row: Row, count: int) -> np.ndarray:
    """Postures about home (count, n)."""
    chain, q = elastic.mechanism, np.tile(elastic.q, (count, 1))
    moved = [
        j
        for j in getattr(chain, "held", ()) or range(q.shape[1])
        if j not in getattr(chain, "virtual", ())
    ]
    steps = np.random.default_rng(1).uniform(-row.away, row.away, (count, len(moved)))
    q[:, moved] += steps * chain.at(elastic.q).coordinate_lengths[moved]
    return q


def measured(row: Row, count: int, rounds: int) -> str:
    """A line of the table."""
    elastic = loaded(row)
    q = drawn(elastic, row, count)
    load: dict[str, Any] = {"wrench": row.load * LOAD} if row.load else {}
    kept = np.isfinite(analyse_many(elastic, q[:1], outputs=("B",), **load)["B"]).all()
    names = [f"stiffness_{c}" for c in "ABKF"] if kept else [f"compliance_{c}" for c in "ABK"]
    out = {name: np.empty((count, 6, 6)) for name in names}
    fast = partial(analyse_many, elastic, q, outputs=names, out=out, path="compiled", **load)
    start = time.perf_counter()
    found = fast(threads=1)
    first = time.perf_counter() - start
    some = {"outputs": names, "path": "engine", **load}
    engine = analyse_many(elastic, q[:ENGINE], **some)
    for name in names:
        known = np.isfinite(engine[name]).all(axis=(1, 2))
        size = np.abs(engine[name][known]).max(initial=0.0)
        apart = np.abs(found[name][:ENGINE][known] - engine[name][known]).max(initial=0.0)
        if apart > AGREEMENT * size:
            raise SystemExit(f"{row.title}: {name} is not the engine's")
    times: dict[int, list[float]] = {0: [], 1: [], 2: []}
    for _ in range(rounds):
        for threads, taken in times.items():
            start = time.perf_counter()
            if threads:
                fast(threads=threads)
            else:
                analyse_many(elastic, q[:ENGINE], **some)
            taken.append((time.perf_counter() - start) / (count if threads else ENGINE) * 1e6)
    slow, one, two = (median(taken) for taken in times.values())
    asked = "" if row.required is None else f"{row.required:g}: {_met(min(one, two), row)}"
    under = f"{row.load:g}" if row.load else "none"
    made = first - one * count / 1e6
    return (
        f"| {row.title} | {under} | {one:.3g} | {two:.3g} | {found.fallback} | {slow:.0f} | "
        f"{slow / min(one, two):.0f} | {made:.1f} | {asked} |"
    )


def _met(taken: float, row: Row) -> str:
    return "met" if row.required is not None and taken < row.required else "NOT met"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20_000, help="postures a row")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", nargs="+", default=[row.name for row in ROWS], metavar="NAME")
    given = parser.parse_args()
    describe()
    print(
        "| mechanism | load | us, 1 thread | 2 threads | by the engine | engine, us | ratio | "
        "recorded and compiled, s | required, us |"
    )
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    for row in ROWS:
        if row.name in given.only:
            print(measured(row, given.count, given.rounds), flush=True)
    elastic, arm = ur5()
    q, lean = drawn(elastic, ROWS[0], 2000), lean_loop(arm)
    taken = []
    for _ in range(given.rounds):
        start = time.perf_counter()
        lean(q)
        taken.append((time.perf_counter() - start) / len(q) * 1e6)
    print(
        f"\nThe lean loop takes {median(taken):.1f} us a posture of a UR5. Medians of "
        f"{given.rounds} interleaved rounds."
    )


if __name__ == "__main__":
    main()
