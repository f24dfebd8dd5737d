"""50,000 calls of a program one after the other, beside a lean Pinocchio function and its C source.

    python benchmarks/control_loop.py
    python benchmarks/control_loop.py million    a million postures as an xarray data set
    python benchmarks/control_loop.py links      closed chains whose links the load bends, a grasp
    python benchmarks/control_loop.py jax        the same as functions of JAX, which has to be there

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
from typing import Any, NamedTuple

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


class InC(NamedTuple):
    """Microseconds of a call from C, seconds of its compilation, and megabytes of its source."""

    call: float
    compilation: float
    size: float


def compiled(
    program: cartstiff.Program,
    postures: np.ndarray,
    load: np.ndarray | None = LOAD,
    level: str = "-O2",
) -> InC:
    """The C function, called from C."""
    doubles = ctypes.POINTER(ctypes.c_double)
    source = program.source("c", "stiffness")
    loop = _LOOP if load is not None else _LOOP.replace("(at, wrench, out)", "(at, out)")
    with tempfile.TemporaryDirectory() as folder:
        file, library = Path(folder) / "stiffness.c", Path(folder) / "stiffness.so"
        file.write_text(source + loop, encoding="utf-8")
        words = ["cc", "-std=c99", level, "-shared", "-fPIC", str(file), "-o", str(library), "-lm"]
        start = time.perf_counter()
        subprocess.run(words, check=True)
        compilation = time.perf_counter() - start
        function = ctypes.CDLL(str(library)).loop
    out, q = np.zeros(144), np.ascontiguousarray(postures)
    given = np.zeros(6) if load is None else load
    arrays = [array.ctypes.data_as(doubles) for array in (q, given, out)]
    times = []
    for _ in range(9):
        start = time.perf_counter()
        function(*arrays, q.shape[1], len(q), 20)
        times.append((time.perf_counter() - start) / (20 * len(q)))
    return InC(float(np.median(times)) * 1e6, compilation, len(source) / 1e6)


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
        in_c = compiled(program, postures).call
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


def moved(robot: cartstiff.ElasticMechanism, count: int = 20) -> np.ndarray:
    """Postures near the default one; a closed chain is moved by its motors, if it has some."""
    mechanism, rng = robot.mechanism, np.random.default_rng(0)
    driven = sorted({*mechanism.held} - {*mechanism.virtual}) or range(len(robot.q))
    Q = np.tile(robot.q, (count, 1))
    Q[:, list(driven)] += rng.uniform(-0.05, 0.05, (count, len(driven)))
    return Q


def recorded(name: str) -> tuple[cartstiff.Program, np.ndarray, list[np.ndarray]]:
    """The program of a robot, postures, and the load, if it takes one."""
    robot = cartstiff.load(name)
    if name == "grasp":  # its springs squeeze
        return cartstiff.record(robot, ["B", "wrench"]), moved(robot), []
    program = cartstiff.record(robot, ["pose", "wrench"], loaded=True)
    return program, moved(robot), [0.1 * LOAD]


def links() -> None:
    """Print milliseconds of C, program and core for closed chains."""
    print(f"Machine: {machine()}")
    for name in ("five-bar", "delta", "3-rrr", "grasp"):
        program, Q, load = recorded(name)
        level = "-O0" if name == "3-rrr" else "-O2"
        in_c = compiled(program, Q, load[0] if load else None, level)
        given = {"wrench": load[0]} if load else {}
        ways: list[Callable[[np.ndarray], Any]] = [
            lambda q, program=program, load=load: program(q, *load),
            lambda q, program=program, given=given: cartstiff.analyse(program.elastic, q, **given),
        ]
        each = [list[int](), list[int]()]
        for function, into in zip(ways, each, strict=True):
            timed(function, Q, into)
        by, core = (float(np.median(into)) / 1e6 for into in each)
        print(
            f"{name}: C {in_c.call / 1e3:.3f} ms ({in_c.size:.1f} MB, cc {level} in "
            f"{in_c.compilation:.1f} s), program {by:.2f} ms, analyse {core:.1f} ms"
        )


def jax() -> None:
    """Print what the functions of JAX take."""
    import jax

    jax.config.update("jax_enable_x64", True)
    print(f"Machine: {machine()}; jax {jax.__version__}")
    for name in ("ur5", "five-bar", "delta", "3-rrr"):
        program, Q, load = recorded(name)
        known: dict[str, Any] = {}
        exec(program.source("jax", "stiffness"), known)

        def energy(q: Any, known: Any = known, load: Any = load) -> Any:
            return known["stiffness"](q, *load)[1]["pose"].sum()

        ways = {"call": jax.jit(known["stiffness"]), "gradient": jax.jit(jax.grad(energy))}
        for what, function in ways.items() if name == "ur5" else [("call", ways["call"])]:
            given = load if what == "call" else []
            start = time.perf_counter()
            jax.block_until_ready(function(Q[0], *given))
            first, times = time.perf_counter() - start, list[float]()
            for q in Q:
                start = time.perf_counter()
                jax.block_until_ready(function(q, *given))
                times.append(time.perf_counter() - start)
            print(f"{name}: {what} {np.median(times) * 1e3:.2f} ms, compiled in {first:.1f} s")


if __name__ == "__main__":
    asked = sys.argv[1:]
    if asked:
        {"million": million, "links": links, "jax": jax}[asked[0]]()
        raise SystemExit(0)
    raise SystemExit(0 if main() else 1)
