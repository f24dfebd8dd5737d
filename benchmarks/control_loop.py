"""50,000 calls of a program one after the other, beside a lean Pinocchio function and its C source.

    python benchmarks/control_loop.py
    python benchmarks/control_loop.py million    a million postures as an xarray data set
    python benchmarks/control_loop.py links      closed chains whose links the load bends

Program and function take turns, 500 calls each, at the same regular postures of a UR5 under a
load; every call is timed. Before anything is timed, their matrices are compared, and no call may
leave the recorded postures. The C function runs in a loop of its own, compiled by `cc -O2`.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from posture import Arm, machine

import cartstiff
from cartstiff.files.catalogue import example_robot

CALLS, TURN, POSTURES = 50_000, 500, 1000
#: Allowed: median, and slowest call of a thousand, as shares of the lean function's own.
MEDIAN, SLOWEST = 1.0, 1.5
LOAD = np.array([4.0, -3.0, 2.0, 20.0, 30.0, -40.0])
#: Axes, point and kind of the load.
ACTING: dict[str, dict[str, Any]] = {
    "dead, at M, axes of M": {},
    "dead, at a point, axes of F": {"load_axes": "world", "load_at": [0.05, -0.02, 0.1]},
    "follower, at a point, axes of M": {"load_kind": "follower", "load_at": [0.0, 0.0, 0.2]},
    "conservative, at a point, axes of F": {
        "load_kind": "conservative",
        "load_axes": "world",
        "load_at": [0.0, 0.1, 0.0],
    },
}
OUTPUTS = ["A", "B", "K", "F"]
_LOOP = """
void loop(const double *q, double wrench[6], double out[144], int n, int postures, int rounds)
{
  double at[64];
  int i, j, r;
  for (r = 0; r < rounds; r++)
    for (i = 0; i < postures; i++) {
      for (j = 0; j < n; j++) at[j] = q[n*i + j];
      stiffness(at, wrench, out);
    }
}
"""


def timed(function: Callable[[np.ndarray], Any], postures: np.ndarray, into: list[int]) -> None:
    """Nanoseconds of each call."""
    clock = time.perf_counter_ns
    for q in postures:
        start = clock()
        function(q)
        into.append(clock() - start)


def compiled(
    program: cartstiff.Program, postures: np.ndarray, load: np.ndarray = LOAD, level: str = "-O2"
) -> float:
    """Microseconds of a call of the C function from C."""
    doubles = ctypes.POINTER(ctypes.c_double)
    with tempfile.TemporaryDirectory() as folder:
        file, library = Path(folder) / "stiffness.c", Path(folder) / "stiffness.so"
        file.write_text(program.source("c", "stiffness") + _LOOP, encoding="utf-8")
        words = ["cc", "-std=c99", level, "-shared", "-fPIC", str(file), "-o", str(library), "-lm"]
        subprocess.run(words, check=True)
        loop = ctypes.CDLL(str(library)).loop
    out, q = np.zeros(144), np.ascontiguousarray(postures)
    arrays = [array.ctypes.data_as(doubles) for array in (q, load, out)]
    times = []
    for _ in range(9):
        start = time.perf_counter()
        loop(*arrays, q.shape[1], len(q), 20)
        times.append((time.perf_counter() - start) / (20 * len(q)))
    return float(np.median(times)) * 1e6


def main() -> bool:
    """Print the tables; whether both bounds hold for every load."""
    arm = cartstiff.load("ur5")
    assert arm.springs is not None
    hand = Arm(example_robot("ur5"), arm.mechanism.frame, arm.names, arm.springs.stiffness, None)
    postures = arm.q + np.random.default_rng(0).uniform(-0.3, 0.3, (POSTURES, 6))
    print(f"Machine: {machine()}\n")
    print(
        "| load | program, median us | lean function | ratio | program, 99.9th | lean | ratio | C |"
    )
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    is_met = True
    for title, acting in ACTING.items():
        program = cartstiff.record(arm, OUTPUTS, loaded=True, **acting)
        if not acting:  # the lean function knows no other loads
            by_hand, ours = hand.contracted(postures[0], LOAD), program(postures[0], LOAD)
            for letter in OUTPUTS:
                size = np.abs(by_hand[letter]).max()
                assert np.abs(by_hand[letter] - ours[letter]).max() < 1e-9 * size
        assert all(program(q, LOAD).is_plain for q in postures)
        contenders = [
            (lambda q, program=program: program(q, LOAD), list[int]()),
            (lambda q: hand.contracted(q, LOAD), list[int]()),
        ]
        for start in range(0, CALLS, TURN):
            some = postures[np.arange(start, start + TURN) % POSTURES]
            for function, into in contenders:
                timed(function, some, into)
        rows = [np.percentile(into, [50.0, 99.9]) / 1e3 for _, into in contenders]
        (median, slow), (lean, lean_slow) = rows
        is_met = is_met and median <= MEDIAN * lean and slow <= SLOWEST * lean_slow
        in_c = compiled(program, postures)
        print(
            f"| {title} | {median:.1f} | {lean:.1f} | {median / lean:.2f} | {slow:.1f} |"
            f" {lean_slow:.1f} | {slow / lean_slow:.2f} | {in_c:.2f} ({lean / in_c:.0f} times) |"
        )
    words = "met" if is_met else "NOT met"
    print(f"\nRequired: median at most {MEDIAN:g}, 99.9th percentile {SLOWEST:g}: {words}.")
    return is_met


def million() -> None:
    """Print what a million postures of a UR5 under a load take."""
    arm = cartstiff.load("ur5")
    outputs = ["B", "translation_free_min", "along_free"]
    program = cartstiff.record(arm, outputs, loaded=True, direction=[0, 0, 1])
    Q = arm.q + np.random.default_rng(0).uniform(-0.3, 0.3, (1_000_000, 6))
    program.many(Q[:10], LOAD)
    start, clock = time.process_time(), time.perf_counter()
    data = program.many(Q, LOAD).to_xarray()
    seconds = time.process_time() - start
    print(f"Machine: {machine()}; {data.nbytes / 1e9:.2f} GB")
    print(f"{seconds:.1f} s of processor time, {time.perf_counter() - clock:.1f} s in all")


def links() -> None:
    """Print milliseconds of C, program and core for robots with flexible links."""
    for name in ("five-bar", "delta", "3-rrr"):
        robot = cartstiff.load(name)
        program = cartstiff.record(robot, ["pose", "wrench"], loaded=True)
        chain, rng = robot.mechanism, np.random.default_rng(0)
        driven, Q = sorted({*chain.held} - {*chain.virtual}), np.tile(robot.q, (20, 1))
        Q[:, driven] += rng.uniform(-0.05, 0.05, (20, len(driven)))
        load = 0.1 * LOAD
        in_c = compiled(program, Q, load, "-O0" if name == "3-rrr" else "-O2") / 1e3
        ways: list[Callable[[np.ndarray], Any]] = [
            lambda q, program=program, load=load: program(q, load),
            lambda q, robot=robot, load=load: cartstiff.analyse(robot, q, wrench=load),
        ]
        each = [list[int](), list[int]()]
        for function, into in zip(ways, each, strict=True):
            timed(function, Q, into)
        by, core = (float(np.median(into)) / 1e6 for into in each)
        print(f"{name}: C {in_c:.3f} ms, program {by:.2f} ms, analyse {core:.1f} ms")


if __name__ == "__main__":
    asked = sys.argv[1:]
    if asked:
        {"million": million, "links": links}[asked[0]]()
        raise SystemExit(0)
    raise SystemExit(0 if main() else 1)
