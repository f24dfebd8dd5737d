"""Broken, odd and hostile input of every kind, in processes that are watched.

    python tools/fuzz.py [--count N] [--seed N] [--families A,B] [--only INDEX]
                         [--seconds S] [--mib M] [--jobs N]

Each input is made from the seed and its number alone. It passes if it is answered or refused as the
contract says, and where a reference exists the answer agrees with it. A fault is a crash, a signal,
an "internal error", more time or memory than allowed, a refusal that is not one line, or an answer
that the reference contradicts. `--only` makes one input
again, in this process, and keeps its files.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

# Of processor time: beside other work an input may take longer by the clock.
SECONDS = 10.0
# By the clock, after which a process that says nothing is taken for one that hangs.
PATIENCE = 300.0
MIB = 1024
# A child is made anew after so many inputs: what one leaves behind must not look like another's.
_PER_CHILD = 1000


def run(
    count: int,
    seed: int = 1,
    families: list[str] | None = None,
    *,
    seconds: float = SECONDS,
    mib: int = MIB,
    patience: float = PATIENCE,
    jobs: int = 1,
) -> list[dict[str, Any]]:
    """The faults among some inputs; `jobs` children work at once."""

    def part(first: int) -> tuple[list[dict[str, Any]], Counter[str]]:
        faults: list[dict[str, Any]] = []
        tally: Counter[str] = Counter()
        index, end = first, min(first + _PER_CHILD, count)
        with tempfile.TemporaryDirectory() as folder:
            while index < end:
                index = _watch(
                    index,
                    end,
                    seed,
                    families or [],
                    Path(folder),
                    seconds,
                    mib,
                    patience,
                    faults,
                    tally,
                )
        return faults, tally

    faults: list[dict[str, Any]] = []
    tally: Counter[str] = Counter()
    firsts = range(0, count, _PER_CHILD)
    with ThreadPoolExecutor(jobs) as pool:
        for first, (bad, outcomes) in zip(firsts, pool.map(part, firsts), strict=True):
            faults += bad
            tally += outcomes
            done = min(first + _PER_CHILD, count)
            print(f"{done} inputs, {len(faults)} faults", file=sys.stderr, flush=True)
    for kind, number in sorted(tally.items()):
        print(f"{kind}: {number}")
    return faults


def _watch(
    first: int,
    end: int,
    seed: int,
    families: list[str],
    folder: Path,
    seconds: float,
    mib: int,
    patience: float,
    faults: list[dict[str, Any]],
    tally: Counter[str],
) -> int:
    """Run inputs in one child; returns the number of the next one."""
    command = [
        sys.executable,
        __file__,
        "--child",
        str(first),
        "--end",
        str(end),
        "--seed",
        str(seed),
        "--families",
        ",".join(families),
        "--mib",
        str(mib),
        "--seconds",
        str(seconds),
    ]
    # Into a file: a pipe that nobody empties would stop the child.
    with (
        (folder / "errors").open("w+b") as errors,
        subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=errors,
            cwd=folder,
            env={**os.environ, "OMP_NUM_THREADS": "1", "CARTSTIFF_TRACEBACK": ""},
        ) as child,
    ):
        return _followed(child, errors, first, end, patience, faults, tally)


def _followed(
    child: subprocess.Popen[bytes],
    stderr: IO[bytes],
    first: int,
    end: int,
    patience: float,
    faults: list[dict[str, Any]],
    tally: Counter[str],
) -> int:
    """Read what a child tells until it ends; returns the number of the next input."""
    assert child.stdout is not None
    index, buffer, begun = first, b"", time.monotonic() + 60.0  # its start is not the input's
    while True:
        left = begun + patience - time.monotonic()
        ready = select.select([child.stdout], [], [], max(left, 0.0))[0]
        if not ready:
            child.kill()
            child.wait()
            faults.append({"index": index, "fault": f"no answer for {patience:g} s"})
            print(f"input {index}: no answer for {patience:g} s", flush=True)
            return index + 1
        piece = os.read(child.stdout.fileno(), 65536)
        if not piece:
            break
        buffer += piece
        *lines, buffer = buffer.split(b"\n")
        for line in lines:
            told = json.loads(line)
            if "fault" in told:
                faults.append(told)
                print(f"input {told['index']}: {told['fault']}", flush=True)
            if "done" in told:
                tally[told["done"]] += 1
                index = told["index"] + 1
            begun = time.monotonic()
    code = child.wait()
    if code == 0:
        return index if index > first else end
    stderr.seek(0)
    errors = stderr.read().decode("utf-8", "replace")
    what = f"signal {-code}" if code < 0 else f"exit {code}"
    faults.append({"index": index, "fault": f"{what}: {errors[-300:]}"})
    print(f"input {index}: {what} {errors[-300:]}", flush=True)
    return index + 1


def _taken() -> float:
    """Seconds of processor time of this process and of those it has waited for."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in both)


def _most() -> int:
    """The most memory in KiB that this process, or one that it has waited for, has held."""
    # Not `ru_maxrss` of this process: that begins with what its parent has held.
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    own = int(status.partition("VmHWM:")[2].split()[0])
    return max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)


def _child(first: int, end: int, seed: int, families: list[str], seconds: float, mib: int) -> None:
    """Inputs one after the other, told on standard output."""
    from tools.fuzz_common import FaultError
    from tools.fuzz_inputs import FAMILIES, PLANTED

    known = {**FAMILIES, **PLANTED}
    names = families or list(FAMILIES)
    told = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    # What is asked for beyond this is refused by the system, and shows as a fault.
    resource.setrlimit(resource.RLIMIT_AS, (8 * mib * 2**20, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def tell(**facts: Any) -> None:
        told.write(json.dumps(facts) + "\n")
        told.flush()

    tell(ready=True)
    for index in range(first, end):
        rng = random.Random(f"{seed} {index}")
        name = names[index % len(names)]
        with tempfile.TemporaryDirectory(dir=".") as folder:
            here = os.getcwd()  # noqa: PTH109
            os.chdir(folder)
            before, begun = _most(), _taken()
            try:
                outcome = known[name](rng)
            except FaultError as fault:
                outcome = "fault"
                tell(index=index, family=name, fault=f"{name}: {fault}")
            except BaseException as error:
                outcome = "fault"
                tell(
                    index=index,
                    family=name,
                    fault=f"{name}: {type(error).__name__}: {str(error)[:300]}",
                )
            finally:
                os.chdir(here)
        most, taken = _most(), _taken() - begun
        if taken > seconds:
            tell(index=index, family=name, fault=f"{name}: more than {seconds:g} s: {taken:.1f} s")
        if most > before and most > 1024 * mib:
            tell(index=index, family=name, fault=f"{name}: {most // 1024} MiB")
            tell(index=index, done=f"{name} fault")
            break  # the next child has not taken it
        tell(index=index, done=f"{name} {outcome}")
    told.close()


def main() -> None:
    """Parse, run, say."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000, help="inputs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--families", default="", help="some of the kinds, by comma")
    parser.add_argument("--only", type=int, help="one input again, in this process")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, help="of processor time that an input may take"
    )
    parser.add_argument("--mib", type=int, default=MIB, help="of memory that a process may take")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="processes at once (all cores)"
    )
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--end", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    families = [name for name in options.families.split(",") if name]
    if options.child is not None:
        _child(options.child, options.end, options.seed, families, options.seconds, options.mib)
        return
    if options.only is not None:
        from tools.fuzz_inputs import FAMILIES

        names = families or [name for name in FAMILIES if not families or name in families]
        folder = tempfile.mkdtemp(prefix="cartstiff-fuzz-")
        os.chdir(folder)
        print(folder)
        print(
            FAMILIES[names[options.only % len(names)]](
                random.Random(f"{options.seed} {options.only}")
            )
        )
        return
    begin = time.monotonic()
    faults = run(
        options.count,
        options.seed,
        families,
        seconds=options.seconds,
        mib=options.mib,
        jobs=options.jobs,
    )
    print(f"{options.count} inputs, {len(faults)} faults, {time.monotonic() - begin:.0f} s")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
