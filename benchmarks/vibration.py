"""Modes of one posture, frequencies over many, a response: the times that are required.

python benchmarks/vibration.py
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np

import cartstiff
from cartstiff.recorded.vibrations import ManyModes
from cartstiff.vibration import frequency_response

ROUNDS = 9
# Required, in seconds: modes of an arm at a posture, six frequencies of 10^5 postures on two cores,
# a receptance at 1000 frequencies.
LIMITS = {"modes of a posture": 300e-6, "10^5 postures": 2.0, "1000 frequencies": 5e-3}


def seconds(work: Callable[[], object], times: int) -> float:
    """Median over the rounds of one call."""
    work()
    found = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for _ in range(times):
            work()
        found.append((time.perf_counter() - start) / times)
    return statistics.median(found)


def main() -> int:
    """Print the times beside what is required; the number of those missed."""
    arm = cartstiff.load("ur5")
    rng = np.random.default_rng(0)
    q = rng.uniform(-3.0, 3.0, (10_000, 6))
    single = q[0]
    found = cartstiff.modes(arm)
    hertz = np.linspace(1.0, 100.0, 1000)
    times = {
        "modes of a posture": seconds(lambda: cartstiff.modes(arm, single).frequencies, 200),
        # On one core, ten times a tenth of them.
        "10^5 postures": 10 * seconds(lambda: ManyModes(arm, q).frequencies({}), 1),
        "1000 frequencies": seconds(lambda: frequency_response(found, hertz, 0.02), 20),
    }
    for name, value in times.items():
        verdict = "ok" if value <= LIMITS[name] else "MISSED"
        print(
            f"{name:<20} {1e3 * value:10.3f} ms, required {1e3 * LIMITS[name]:9.3f} ms  {verdict}"
        )
    return sum(value > LIMITS[name] for name, value in times.items())


if __name__ == "__main__":
    sys.exit(main())
