"""How often intervals of identified springs hold the truth, over synthetic campaigns.

    python benchmarks/identify_coverage.py [CAMPAIGNS] [MACHINE ...]

CAMPAIGNS in all, shared out, or of each MACHINE that is named. Three arms, a platform and a closed
chain; 12 to 60 rows; wrenches, hung weights, dial gauges; every other campaign with known standard
deviations. Arms also by their own weight alone, seen by a tracker that was set up twice. Besides,
an arm with the tilts of a bearing, and one with a counterbalance, as further unknowns. Prints the
share of 95 % intervals that hold the true compliance, of parameters called determined and of those
called "at least", and of the former by parameter, each with the share's own standard deviation; how
many springs were called not identifiable, and how many of the determined ones are off by more than
six deviations. Then the same campaigns with gross errors of 20 deviations in 5 % of the rows: how
many of these are named, how many rows are named besides, and how many robust estimates lie in the
intervals of the clean data; and how many of least squares without the wrong rows, and no others,
do. A row that is wrong cannot say what it said: what an estimate without it departs by has the
variance of that estimate less that of the clean one.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

import cartstiff
from cartstiff.identify import identify
from cartstiff.wings.identify.models import Model
from cartstiff.wings.identify.plan import candidates
from cartstiff.wings.identify.unknowns import unknowns_of

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.identify.campaigns import arm as arm_file
from tests.identify.campaigns import simulated

# Share of the campaigns and of the deflection that noise is.
_MIX = (("elbow", 0.3), ("scara", 0.2), ("seven", 0.2), ("cubic", 0.2), ("five-bar", 0.1))
# Further unknowns of the elbow arm, in a tenth of as many campaigns besides: the second joint's
# bearing across its axis, and a counterbalance.
_MORE = {
    "bearing": (
        ("joints", "l2:rx,rz"),
        """flexible:
  l2: {stiffness: [[3.0e4, 0, 0, 0, 0, 0], [0, 9.0e9, 0, 0, 0, 0], [0, 0, 2.0e4, 0, 0, 0],
                   [0, 0, 0, 9.0e9, 0, 0], [0, 0, 0, 0, 9.0e9, 0], [0, 0, 0, 0, 0, 9.0e9]]}
""",
    ),
    "counterbalance": (
        ("joints", "lines"),
        """lines:
  - {frames: [world, l2], points: [[-0.2, 0.0, 0.5], [0.0, 0.05, 0.3]], stiffness: 2.0e5}
""",
    ),
}


def _mechanism(name: str, folder: Path) -> cartstiff.ElasticMechanism:
    if name in ("cubic", "five-bar"):
        return cartstiff.load(name)
    if name in _MORE:
        return cartstiff.load(str(arm_file("elbow", folder, extra=_MORE[name][1])))
    return cartstiff.load(str(arm_file(name, folder)))


def _campaign(
    elastic: cartstiff.ElasticMechanism, seed: int, sought: tuple[str, ...] = ()
) -> Counter[str]:
    rng = np.random.default_rng(seed)
    rows, kind = int(rng.integers(12, 61)), seed % 4
    stiffest = float(elastic.springs.stiffness.max())
    columns = ("d",) if kind == 2 else ("dx", "dy", "dz")
    force = 100.0 if stiffest < 1e7 else 1e-5 * stiffest
    load = {"mass": force / 9.81} if kind == 1 else {"force": force}
    arm = elastic.mechanism.kind == "serial" and not sought
    if kind == 3 and arm:  # its own weight, by a tracker in two places
        elastic = elastic.with_gravity([0.0, 0.0, -9.81])
        columns, load = ("x", "y", "z"), {"mass": 1e-9}
    planar = elastic.mechanism.kind == "closed-chain"
    if planar:
        columns, load = ("dx", "dy"), {"force": force}
    offered = candidates(elastic, dict.fromkeys(columns, 1.0), count=rows, seed=seed, **load)
    if kind == 3 and arm:
        first = ["morning"] * (rows // 2)
        offered = replace(offered, session=(*first, *["evening"] * (rows - len(first))))
    still = simulated(elastic, offered, dict.fromkeys(columns, 1e-30), seed=seed)
    moved = np.concatenate([v[~np.isnan(v)] for v in still.values.values()])
    if kind == 3 and arm:  # how far it sags, not where it is
        model = Model(unknowns_of(elastic), still)
        moved = model.at(model.unknowns.nominal)[0]
    sd = float(np.sqrt(np.mean(moved**2))) * 0.03
    measured = simulated(
        elastic, offered, dict.fromkeys(columns, sd), seed=seed, tell_deviations=bool(seed % 2)
    )
    result = identify(elastic, measured, sought=sought)
    found: Counter[str] = Counter()
    for e, c in zip(result.estimates, result.unknowns.nominal, strict=True):
        found[e.verdict] += 1
        if e.interval is not None and e.deviation:
            held = e.interval[0] <= c <= e.interval[1]
            found[f"{e.verdict} held"] += held
            if e.verdict == "determined":
                found[f"all of {e.name}"] += 1
                found[f"held of {e.name}"] += held
            found["far off"] += abs(e.compliance - c) > 6.0 * e.deviation
    if kind != 3:
        bad = rng.choice(rows, max(1, round(0.05 * rows)), replace=False).tolist()
        values = {name: column.copy() for name, column in measured.values.items()}
        for column in values.values():
            column[bad] += 20.0 * sd * np.sign(rng.normal(size=len(bad)))
        spoilt = replace(measured, values=values)
        robust = identify(elastic, spoilt, fit="robust", sought=sought)
        named, wrong = set(robust.suspects), {n + 1 for n in bad}
        told = identify(elastic, spoilt.chosen(~np.isin(np.arange(rows), bad)), sought=sought)
        found["gross"] += len(wrong)
        found["named"] += len(wrong & named)
        found["named besides"] += len(named - wrong)
        for clean, e, best in zip(result.estimates, robust.estimates, told.estimates, strict=True):
            if clean.verdict == e.verdict == best.verdict == "determined":
                low, high = clean.interval
                found["robust"] += 1
                found["robust inside"] += low <= e.compliance <= high
                found["told inside"] += low <= best.compliance <= high
    return found


def main(campaigns: int = 1000, *machines: str) -> None:
    """Run and print."""
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        start = 0
        mix = dict((*_MIX, *((name, 0.1) for name in _MORE)))
        for name, share in dict.fromkeys(machines, 1.0).items() or mix.items():
            elastic = _mechanism(name, Path(folder))
            found: Counter[str] = Counter()
            begin, count = time.perf_counter(), max(1, round(share * campaigns))
            for seed in range(start, start + count):
                try:
                    found += _campaign(elastic, seed, _MORE.get(name, ((), ""))[0])
                except cartstiff.CartstiffError as error:
                    found["refused"] += 1
                    print(f"{name}, seed {seed}: {error}", flush=True)
            start += count
            total += found
            spent = (time.perf_counter() - begin) / count
            print(
                f"{name:>14}: {count} campaigns, {_line(found)}, {1e3 * spent:.0f} ms each",
                flush=True,
            )
            for spring in sorted(k[7:] for k in found if k.startswith("all of ")):
                held, n = found[f"held of {spring}"], found[f"all of {spring}"]
                share, error = 100 * held / n, 100 * np.sqrt(0.95 * 0.05 / n)
                print(f"{spring:>24}: {held}/{n} = {share:.1f} % +- {error:.1f}", flush=True)
    print(f"{'all':>14}: {_line(total)}")


def _line(found: Counter[str]) -> str:
    parts = []
    for verdict in ("determined", "at-least", "negative"):
        if count := found[verdict]:
            share = 100 * found[f"{verdict} held"] / count
            parts.append(f"{verdict} {found[f'{verdict} held']}/{count} = {share:.1f} %")
    parts.append(f"not identifiable {found['not-identifiable']}")
    parts.append(f"far off {found['far off']}")
    if found["refused"]:
        parts.append(f"without an answer {found['refused']}")
    if found["gross"]:
        parts.append(
            f"gross errors named {found['named']}/{found['gross']} (besides: "
            f"{found['named besides']}), robust estimates inside "
            f"{found['robust inside']}/{found['robust']}, those with the wrong "
            f"rows {found['told inside']}"
        )
    return ", ".join(parts)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000, *sys.argv[2:])
