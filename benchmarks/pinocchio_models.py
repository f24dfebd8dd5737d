"""A Pinocchio model in hand against its file: the same matrices, and how long loading takes.

    python benchmarks/pinocchio_models.py

For every URDF of example-robot-data that loads: the largest difference of a matrix (relative to its
largest number) between the file and the model that Pinocchio reads from it, at one posture, and the
processor time of loading the model, without pictures: the least of several, which other work on
the machine disturbs least. Exit code 1 if a difference is above 1e-15.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

import example_robot_data
import numpy as np
import pinocchio as pin

import cartstiff
from cartstiff import CartstiffError

ALIKE, ROUNDS = 1e-15, 15


def difference(path: Path) -> tuple[float, float]:
    """Largest relative difference of a matrix, and the least processor time [ms]."""
    from_file = cartstiff.load(path)
    model = pin.buildModelFromUrdf(str(path))
    frame = from_file.mechanism.frame
    times = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        in_hand = cartstiff.load(model, frame=frame)
        times.append(1e3 * (time.process_time() - begin))
    if in_hand.names != from_file.names:
        raise ValueError(f"joints {in_hand.names} and {from_file.names}")
    q = np.random.default_rng(5).uniform(-1.0, 1.0, len(from_file.names))
    q = np.clip(q, *np.array([from_file.limits[n] for n in from_file.names]).T)
    a, b = (cartstiff.analyse(arm, q) for arm in (from_file, in_hand))
    worst = float(np.abs(a.pose - b.pose).max())
    for K, L in ((a.compliances["B"], b.compliances["B"]), (a.matrices["B"], b.matrices["B"])):
        if (K is None) != (L is None):
            return np.inf, min(times)
        if K is not None and L is not None:
            worst = max(worst, float(np.abs(K - L).max() / np.abs(K).max()))
    return worst, min(times)


def main() -> int:
    """Print the differences and the times."""
    root = Path(example_robot_data.getModelPath("ur_description"))
    worst, times, count, failed = 0.0, list[float](), 0, 0
    for path in sorted(root.rglob("*.urdf")):
        try:
            cartstiff.load(path)
        except CartstiffError:
            continue
        try:
            found, milliseconds = difference(path)
        except (CartstiffError, ValueError) as error:
            failed += 1
            print(f"{path.name:40} NOT ALIKE {error}")
            continue
        count += 1
        worst, times = max(worst, found), [*times, milliseconds]
        if found > ALIKE:
            failed += 1
        print(f"{path.name:40} {found:.1e}  {milliseconds:6.2f} ms", flush=True)
    print(
        f"{count} models alike to {worst:.1e}; loading takes {statistics.median(times):.2f} ms "
        f"in the median, {max(times):.2f} ms at the most"
    )
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
