"""Small mechanisms for the tests of maps, the values of a map found one by one, and commands."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from tests.support import loaded_arm, paper_platform
from tests.support.commands import words

import cartstiff
from cartstiff import ElasticMechanism
from cartstiff.maps import Axis, Grid, RandomPostures


def arm(kinds: str = "RRRRRR", seed: int = 3) -> ElasticMechanism:
    return loaded_arm(kinds, seed).elastic


def platform() -> ElasticMechanism:
    return paper_platform()


def softest(elastic: ElasticMechanism, q: np.ndarray, wrench: object = None) -> float:
    """Smallest principal translational stiffness, rotation free: force over deflection along it."""
    C = np.linalg.inv(cartstiff.analyse(elastic, q, wrench=wrench).tangent)
    return float((1.0 / np.linalg.eigvalsh(0.5 * (C + C.T)[3:, 3:])).min())


# -- maps in processes of their own -------------------------------------------------------------

# A mechanism that is computed posture by posture: in six parts.
COMMAND = words(
    "map delta --grid leg1/motor=0.3:0.5:2,leg2/motor=0.3:0.5:3,leg3/motor=0.3:0.5:4 --chunk 4 "
    "--quantity compliance_translation_free_max --length 0.1 --json"
)


def start(*arguments: str, **environment: str) -> subprocess.Popen[str]:
    """Start Python with the library that is tested."""
    source = str(Path(cartstiff.__file__).parents[1])
    return subprocess.Popen(
        [sys.executable, *arguments],
        env={**os.environ, "PYTHONPATH": source, "OMP_NUM_THREADS": "1", **environment},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def start_map(file: Path, *more: str, **environment: str) -> subprocess.Popen[str]:
    """Start to compute the map of `COMMAND`."""
    return start("-m", "cartstiff", *COMMAND, "-o", str(file), *more, **environment)


# The command, held before the mark of the N-th part, or where a scheduler's workers compute at the
# N-th that is counted: it says so, and waits for a line before it goes on.
_HELD = """
import signal, sys
from contextlib import contextmanager
from cartstiff.wings.maps import run, store
from cartstiff.shown.cli.main import main

# A shell starts what runs in the background with interrupts ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
seen = []

def held(function):
    def hold(*arguments):
        seen.append(arguments)
        if len(seen) == PARTS:
            print("held", file=sys.stderr, flush=True)
            sys.stdin.readline()
        return function(*arguments)

    return hold

if "--dask" in sys.argv:
    bar = run._bar

    @contextmanager
    def held_bar(*arguments):
        with bar(*arguments) as advance:
            yield held(advance)

    run._bar = held_bar
else:
    store.MapFile._sealed_row = held(store.MapFile._sealed_row)
if __name__ == "__main__":
    main(sys.argv[1:])
"""


def start_held_map(file: Path, parts: int, *more: str, **environment: str) -> subprocess.Popen[str]:
    """Start to compute the map of `COMMAND`, and wait until it stands still at a part."""
    script = file.parent / "held.py"
    script.write_text(_HELD.replace("PARTS", str(parts)), encoding="utf-8")
    process = start(str(script), *COMMAND, "-o", str(file), *more, **environment)
    assert process.stderr is not None
    for line in process.stderr:
        if line == "held\n":
            return process
    raise AssertionError(f"it ended before part {parts}: {process.communicate()}")


def marks(file: Path) -> dict[str, tuple[int, int]]:
    """The parts of a map that are done, with the identity and time of their marks."""
    found = (file / "parts" / "marks" / "c").glob("*/0")
    return {p.parent.name: (p.stat().st_ino, p.stat().st_mtime_ns) for p in found}


def grid_of(elastic):
    """Twenty postures over two joints."""
    a, b = elastic.names[1], elastic.names[3]
    return Grid({a: Axis(-0.5, 0.7, 4), b: Axis(0.0, 1.1, 5)}, elastic.names, elastic.q)


def drawn(elastic, count=20):
    """Postures drawn about the default one."""
    return RandomPostures(count, 5, elastic.q - 0.3, elastic.q + 0.3)
