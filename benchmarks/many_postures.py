"""Many postures at once, beside what others would write, and beside what the machine can do.

    python benchmarks/many_postures.py [--quick]

The contenders take turns in every round on the same postures; medians over the rounds are
printed, with the ratios that are required. Before anything is timed their matrices are compared. A
peer whose package is missing is listed as such; benchmarks/requirements.txt has all of them.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import many_postures_peers as peers
import numpy as np
import pinocchio as pin
from machine_limits import Machine, cache_size

import cartstiff
from cartstiff import ElasticMechanism, JointSprings, analyse_many
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.files.catalogue import example_robot
from cartstiff.files.tree_building import plain_tree
from cartstiff.recorded.plans import plan, program_for

Array = np.ndarray
OUTPUTS = ("jacobian", "wrench", "stiffness_A", "stiffness_B", "stiffness_K", "stiffness_F")
BYTES = 8 * (36 + 6 + 4 * 36)
#: Admitted difference, relative to the largest entry, per condition number of the Jacobian.
CLOSED_FORM, DIFFERENCES = 1e-13, 1e-6
#: Loops take so long that they get the first of the postures only.
LOOP_POSTURES = 1000
REST = np.array([0.1, -0.4, 0.3, 0.2, 0.5, -0.6])

# Required ratios.
PORTABLE_TO_PLAIN, FAST_TO_PORTABLE, FAST_TO_LEAN, OF_MEMORY = 15.0, 12.0, 120.0, 0.45
MEMORY_LIMIT = 1 << 30


@dataclass
class Contender:
    """A way to compute the matrices; `slow` ones get fewer postures."""

    name: str
    run: Callable[[Array], dict[str, Array]]
    slow: bool = False
    tolerance: float = CLOSED_FORM
    times: list[float] = field(default_factory=list)

    @property
    def median(self) -> float:
        """Seconds per posture."""
        return statistics.median(self.times)


def ur5() -> tuple[ElasticMechanism, peers.Arm]:
    """The mechanism here, and the same in plain Pinocchio."""
    elastic = cartstiff.load("ur5").with_springs(rest=REST)
    model = pin.buildModelFromUrdf(str(example_robot("ur5")))
    frame = model.getFrameId(elastic.mechanism.frame)
    return elastic, peers.Arm(model, frame, elastic.springs.stiffness, REST)


def ours(elastic: ElasticMechanism, path: str, threads: int) -> Callable[[Array], dict[str, Array]]:
    """`analyse_many` into buffers that are used again."""
    kept: dict[int, dict[str, Array]] = {}

    def run(q: Array) -> dict[str, Array]:
        found = analyse_many(
            elastic, q, outputs=OUTPUTS, path=path, threads=threads, out=kept.get(len(q))
        )
        kept.clear()
        kept[len(q)] = found.arrays
        return {name.removeprefix("stiffness_"): array for name, array in found.arrays.items()}

    return run


def contenders(elastic: ElasticMechanism, arm: peers.Arm) -> tuple[list[Contender], list[str]]:
    """All that can run here, and why the others cannot."""
    tasks: list[tuple[str, Callable[[], Any], bool, float]] = [
        ("plain Pinocchio loop", lambda: peers.plain_loop(arm), True, CLOSED_FORM),
        ("lean Pinocchio loop", lambda: peers.lean_loop(arm), True, CLOSED_FORM),
        ("finite differences of the Jacobian", lambda: peers.differences(arm), True, DIFFERENCES),
        ("roboticstoolbox-python (J, H, K^A)", lambda: peers.roboticstoolbox(arm), True, 0.0),
        ("batched NumPy", lambda: peers.batched_numpy(arm), False, CLOSED_FORM),
        ("JAX, jitted, all cores", lambda: peers.jax_closed_form(arm), False, CLOSED_FORM),
        ("numba, 1 thread", lambda: peers.numba_kernel(arm, 1), False, CLOSED_FORM),
        ("numba, 2 threads", lambda: peers.numba_kernel(arm, 2), False, CLOSED_FORM),
        ("cartstiff.analyse, one by one", lambda: ours(elastic, "engine", 1), True, CLOSED_FORM),
        ("cartstiff portable, 1 thread", lambda: ours(elastic, "portable", 1), False, CLOSED_FORM),
        ("cartstiff portable, 2 threads", lambda: ours(elastic, "portable", 2), False, CLOSED_FORM),
        ("cartstiff compiled, 1 thread", lambda: ours(elastic, "compiled", 1), False, CLOSED_FORM),
        ("cartstiff compiled, 2 threads", lambda: ours(elastic, "compiled", 2), False, CLOSED_FORM),
    ]
    found, missing = [], []
    for name, make, slow, tolerance in tasks:
        try:
            found.append(Contender(name, make(), slow, tolerance))
        except ImportError as error:
            missing.append(f"{name}: not installed ({error.name})")
    return found, missing


def compare(found: list[Contender], q: Array) -> dict[str, float]:
    """Largest difference of each from the engine, per condition number; stops where it is large."""
    reference = next(c for c in found if "one by one" in c.name).run(q)
    condition = np.linalg.cond(reference["jacobian"])
    differs = {}
    for contender in found:
        answer = contender.run(q)
        if "timing only" in answer:
            continue
        worst = 0.0
        for name, expected in reference.items():
            axes = tuple(range(1, expected.ndim))
            size = np.abs(expected).max(axis=axes)
            error = np.abs(answer[name] - expected).max(axis=axes) / size / condition
            worst = max(worst, float(error.max()))
        differs[contender.name] = worst
        if not worst < contender.tolerance:
            sys.exit(f"{contender.name} differs by {worst:.1e} times the condition number")
    return differs


def measure(found: list[Contender], q: Array, rounds: int, machine: Machine) -> Array:
    """Seconds per posture, all contenders in turn; the machine's limits in the same rounds.

    Returned are medians, for one thread and for two: operations, numbers and zeros written.
    """
    limits = []
    for contender in found:
        contender.times.clear()
        contender.run(q[:LOOP_POSTURES] if contender.slow else q)  # compiled, touched
    for _ in range(rounds):
        for contender in found:
            rows = q[:LOOP_POSTURES] if contender.slow else q
            start = time.perf_counter()
            contender.run(rows)
            contender.times.append((time.perf_counter() - start) / len(rows))
        limits.append(
            [
                [machine.flops(n), machine.bytes_written(n), machine.bytes_written(n, zeros=True)]
                for n in (1, 2)
            ]
        )
    return np.median(limits, axis=0)


def judged(what: str, value: float, required: float, unit: str = "x") -> str:
    verdict = "met" if value >= required else "NOT met"
    return f"- {what}: {value:.3g}{unit}, required {required:g}{unit}: {verdict}"


def table(found: list[Contender], missing: list[str], differs: dict[str, float]) -> None:
    by_name = {c.name: c.median for c in found}
    plain, lean = by_name["plain Pinocchio loop"], by_name["lean Pinocchio loop"]
    print("| | us per posture | plain loop / this | lean loop / this | differs by |")
    print("|---|---:|---:|---:|---:|")
    for contender in found:
        t = contender.median
        difference = differs.get(contender.name)
        shown = "timing only" if difference is None else f"{difference:.0e}"
        print(f"| {contender.name} | {t * 1e6:.3g} | {plain / t:.3g} | {lean / t:.3g} | {shown} |")
    for line in missing:
        print(f"| {line} | | | | |")
    print()


def requirements(found: list[Contender], limits: Array, flops: int) -> None:
    """The ratios, and the machine's own limits."""
    by_name = {c.name: c.median for c in found}
    arithmetic, written, zeros = limits.T
    fast = by_name["cartstiff compiled, 1 thread"]
    both = by_name["cartstiff compiled, 2 threads"]
    slow = by_name["cartstiff portable, 1 thread"]
    print(
        f"The machine: {arithmetic[0] / 1e9:.0f} / {arithmetic[1] / 1e9:.0f} Gflop/s and "
        f"{written[0] / 1e9:.0f} / {written[1] / 1e9:.0f} GB/s written on one / two threads "
        f"(zeros: {zeros[0] / 1e9:.0f} / {zeros[1] / 1e9:.0f}). "
        f"{flops} operations and {BYTES} bytes a posture: not below "
        f"{flops / arithmetic[1] * 1e9:.0f} ns and {BYTES / max(written) * 1e9:.0f} ns on two; the "
        f"compiled path takes {both * 1e9:.0f} ns.\n"
    )
    print(
        judged(
            "portable to the plain loop", by_name["plain Pinocchio loop"] / slow, PORTABLE_TO_PLAIN
        )
    )
    print(judged("compiled to portable", slow / fast, FAST_TO_PORTABLE))
    print(judged("compiled to the lean loop", by_name["lean Pinocchio loop"] / fast, FAST_TO_LEAN))
    share = BYTES / both / max(written)
    print(judged("of the write bandwidth, on two threads", 100 * share, 100 * OF_MEMORY, " %"))
    print()


def arm_of(joints: int) -> ElasticMechanism:
    """A chain of revolute joints with any axes."""
    rng = np.random.default_rng(joints)
    model, parent = pin.Model(), 0
    for i in range(joints):
        axis = rng.normal(size=3)
        at = pin.SE3(pin.SE3.Random().rotation, rng.uniform(-0.2, 0.2, 3))
        joint = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        parent = model.addJoint(parent, joint, at, f"joint{i + 1}")
    model.addFrame(pin.Frame("tip", parent, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    springs = JointSprings(rng.uniform(1e3, 1e4, joints), np.full(joints, np.nan))
    return ElasticMechanism(
        f"{joints}R", Chain(plain_tree(model), "tip"), np.zeros(joints), springs
    )


def timed(
    elastic: ElasticMechanism,
    wrench: Array,
    outputs: list[str],
    path: str,
    rows: Array,
    out: Any = None,
) -> tuple[float, Any]:
    start = time.perf_counter()
    found = analyse_many(
        elastic, rows, wrench=wrench, outputs=outputs, path=path, threads=1, out=out
    )
    return time.perf_counter() - start, found.arrays


def grow_with_joints(quick: bool, rounds: int) -> None:
    pin.seed(1)
    count = 2000 if quick else 20_000
    print(
        "| joints | operations | traced and compiled, s | compiled, us | portable, us | "
        "analyse, us |\n|---:|---:|---:|---:|---:|---:|"
    )
    for joints in (6, 30) if quick else (6, 7, 10, 15, 20, 30):
        elastic = arm_of(joints)
        q = np.random.default_rng(0).uniform(-2, 2, (count, joints))
        wrench = np.array([1.0, -2.0, 0.5, 10.0, 5.0, -8.0])
        outputs = [o for o in OUTPUTS if joints == 6 or o != "stiffness_F"]

        once = partial(timed, elastic, wrench, outputs)
        making, _ = once("compiled", q[:8])
        times = {}
        for path, rows in (("compiled", q), ("portable", q), ("engine", q[:200])):
            _, out = once(path, rows)
            spent = [once(path, rows, out)[0] / len(rows) for _ in range(rounds)]
            times[path] = statistics.median(spent) * 1e6
        order = tuple(o for o in ("jacobian", "wrench", *OUTPUTS[2:]) if o in outputs)
        size = program_for(plan(elastic, True).case, order).size
        print(
            f"| {joints} | {size} | {making:.2f} | {times['compiled']:.3g} "
            f"| {times['portable']:.3g} | {times['engine']:.3g} |"
        )
    print()


def grow_with_postures(elastic: ElasticMechanism, quick: bool, rounds: int) -> None:
    print("| postures | compiled, ns per posture, 1 thread | 2 threads | portable, ns, 1 thread |")
    print("|---:|---:|---:|---:|")
    rng = np.random.default_rng(1)
    for count in [10**i for i in range(0, 5 if quick else 7)]:
        q = rng.uniform(-2, 2, (count, 6))
        row = []
        for path, threads in (("compiled", 1), ("compiled", 2), ("portable", 1)):
            if path == "portable" and count > 10**5:
                row.append("")
                continue
            run = ours(elastic, path, threads)
            run(q)
            spent = []
            for _ in range(rounds):
                start = time.perf_counter()
                run(q)
                spent.append((time.perf_counter() - start) / count * 1e9)
            row.append(f"{statistics.median(spent):.4g}")
        print(f"| {count} | {' | '.join(row)} |")
    print()


def to_a_file(elastic: ElasticMechanism, quick: bool) -> None:
    """Ten million postures, their K^B in a file, in buffers for a hundred thousand."""
    count, step = (10**6 if quick else 10**7), 10**5
    rng = np.random.default_rng(2)
    out, computing = {"stiffness_B": np.empty((step, 6, 6))}, 0.0
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "stiffness.bin"
        with target.open("wb") as file:
            for _ in range(0, count, step):
                q = rng.uniform(-2, 2, (step, 6))
                begun = time.perf_counter()
                analyse_many(elastic, q, outputs=("stiffness_B",), out=out)
                computing += time.perf_counter() - begun
                out["stiffness_B"].tofile(file)
        size = target.stat().st_size
    spent = time.perf_counter() - start
    print(
        f"{count:.0e} postures, K^B to a file of {size / 1e9:.2f} GB: {spent:.1f} s, of which "
        f"{computing:.1f} s computing."
    )


def peak_memory() -> int:
    """Bytes, of this process alone: the system's own count includes the parent's at its start."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def to_a_file_alone(quick: bool) -> None:
    """The same in a process of its own, for the memory it takes."""
    import subprocess

    command = [sys.executable, __file__, "--file-only", *(["--quick"] if quick else [])]
    print(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def describe() -> None:
    packages = ("numpy", "pin", "llvmlite", "numba", "jax", "roboticstoolbox-python", "cartstiff")
    found = []
    for package in packages:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} {cartstiff.__version__ if package == 'cartstiff' else '-'}")
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    print(
        f"Machine: {os.cpu_count()} processors, {cache_size()}, {platform.system()}, Python "
        f"{platform.python_version()}, {', '.join(found)}; "
        f"load average before {load}\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer postures and rounds")
    parser.add_argument("--file-only", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    elastic, arm = ur5()
    if options.file_only:
        to_a_file(elastic, options.quick)
        peak = peak_memory()
        verdict = "met" if peak < MEMORY_LIMIT else "NOT met"
        print(f"Peak memory {peak / 2**20:.0f} MiB, required below 1024 MiB: {verdict}.")
        return
    rounds = 3 if options.quick else 9
    describe()
    found, missing = contenders(elastic, arm)
    rng = np.random.default_rng(0)
    differs = compare(found, rng.uniform(-2, 2, (LOOP_POSTURES, 6)))
    machine = Machine()
    sizes = (10_000,) if options.quick else (10_000, 100_000)
    case = plan(elastic).case
    flops = program_for(case, OUTPUTS).size
    for count in sizes:
        print(f"### UR5, {count} postures\n")
        limits = measure(found, rng.uniform(-2, 2, (count, 6)), rounds, machine)
        table(found, missing, differs)
        requirements(found, limits, flops)
    print("### Cost over joints and postures\n")
    grow_with_joints(options.quick, rounds)
    grow_with_postures(elastic, options.quick, rounds)
    to_a_file_alone(options.quick)
    print(f"Medians of {rounds} interleaved rounds.")


if __name__ == "__main__":
    main()
