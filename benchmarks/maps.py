"""What maps cost: three of them as commands, and single quantities.

    python benchmarks/maps.py [--quick]

prints the tables of docs/howto/cluster.md.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from machine_limits import cache_size

import cartstiff
from cartstiff import analyse_many
from cartstiff.recorded.own_outputs import OwnOutputs
from cartstiff.recorded.quantities import Settings, choose_quantities
from cartstiff.recorded.readings import READINGS
from cartstiff.recorded.recording import Recording
from cartstiff.recorded.stacks import evaluate

QUANTITIES = ("translation_free_min", "condition", "deflection")
DEFLECT = (0.0, 0.0, 0.0, 0.0, 0.0, -50.0)
GRID = (
    "shoulder_lift_joint=-3.1:0.1:{0},elbow_joint=-2.7:2.7:{0},wrist_1_joint=-3:3:{1},"
    "wrist_2_joint=-3:3:20"
)
#: Quantities that share their work stand together.
GROUPS: tuple[tuple[str, ...], ...] = (
    ("deflection", "along_free"),
    ("translation_free_min", "translation_held_min"),
    ("natural_length",),
    ("condition", "isotropy", "minimum"),
    ("singular_value_ratio", "manipulability"),
    ("connection_change",),
)
ROUNDS = 5


def tree_size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def one_map(count: int, options: list[str], folder: Path) -> str:
    """Processor time, wall time, peak memory of the largest process, and size of one map."""
    target = folder / "map.zarr"
    asked = [x for name in QUANTITIES for x in ("--quantity", name)]
    command = ["map", "ur5", *options, *asked, "--added-load", ",".join(f"{x:g}" for x in DEFLECT)]
    start, before = time.perf_counter(), os.times()
    process = subprocess.Popen(
        [sys.executable, "-m", "cartstiff", *command, "--world", "-o", str(target)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(process.pid, 0)
    wall, after = time.perf_counter() - start, os.times()
    if status:
        sys.exit(f"cartstiff {' '.join(command)} failed")
    spent = after.children_user + after.children_system
    spent -= before.children_user + before.children_system
    shown = " ".join(options).replace(options[1], options[1] if len(options[1]) < 20 else "...")
    return (
        f"| `{shown}` | {count:.0e} | {spent / count * 1e6:.1f} us | {wall:.0f} s | "
        f"{usage.ru_maxrss / 1024:.0f} MB | {tree_size(target) / count:.1f} B |"
    )


def maps(quick: bool) -> None:
    grid = GRID.format(*((20, 10) if quick else (100, 50)))
    few = "100000" if quick else "2000000"
    whole = 20 * 20 * 10 * 20 if quick else 10**7
    print("| map | postures | processor time per posture | wall time | peak memory | on disk |")
    print("|---|---:|---:|---:|---:|---:|")
    for count, options in (
        (whole, ["--grid", grid]),
        (int(few), ["--random", few, "--chunk", "262144"]),
    ):
        with tempfile.TemporaryDirectory() as folder:
            print(one_map(count, options, Path(folder)), flush=True)
    print()


def single_quantities(quick: bool) -> None:
    elastic = cartstiff.load("ur5")
    count = 5000 if quick else 50_000
    q = np.random.default_rng(0).uniform(-2, 2, (count, 6))
    settings = Settings(length=0.18, direction=(0.0, 0.0, 1.0), deflect=DEFLECT, world=True)
    print(
        "| quantities | matrices, us per posture | the quantities, us per posture | "
        "both by machine code, us per posture |"
    )
    print("|---|---:|---:|---:|")
    for names in GROUPS:
        chosen = choose_quantities(names, settings, elastic)
        outputs = tuple(dict.fromkeys(o for quantity in chosen for o in quantity.outputs(settings)))
        # A path of the analysis is found posture by posture.
        rows = q[:200] if any("." in name for name in names) else q
        found = analyse_many(elastic, rows, outputs=outputs, threads=1)
        making, reading, at_once = [], [], []
        recording = None
        if set(names) <= set(READINGS):
            own = OwnOutputs(quantities=names, settings=settings)
            recording = Recording(elastic, ("pose",), own, backend="compiled")
            recording.postures(rows, None)
        for _ in range(ROUNDS):
            start = time.perf_counter()
            found = analyse_many(elastic, rows, outputs=outputs, threads=1, out=found.arrays)
            middle = time.perf_counter()
            evaluate(chosen, found.arrays, settings)
            making.append((middle - start) / len(rows) * 1e6)
            reading.append((time.perf_counter() - middle) / len(rows) * 1e6)
            start = time.perf_counter()
            if recording is not None:
                recording.postures(rows, None)
                at_once.append((time.perf_counter() - start) / len(rows) * 1e6)
        shown = ", ".join(f"`{name}`" for name in names)
        both = f"{statistics.median(at_once):.2f}" if at_once else ""
        print(
            f"| {shown} | {statistics.median(making):.2f} | "
            f"{statistics.median(reading):.1f} | {both} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer postures")
    quick = parser.parse_args().quick
    os.environ["OMP_NUM_THREADS"] = "1"
    print(f"Machine: {os.cpu_count()} processors, {cache_size()}\n")
    maps(quick)
    single_quantities(quick)


if __name__ == "__main__":
    main()
