"""How long the springs of a closed chain take to be found from equilibria under large loads.

    python benchmarks/identify_many_unknowns.py [ROWS]

A planar 3-RRR whose six links give by a 6x6 each: 33 compliances (three motors, five axes of each
link) and the third power of one motor's spring, from poses under forces and moments that bend it
far. The search starts from motors that are off by up to a factor of two and links by a fifth.
Prints each step, the time, and how the estimates lie beside the truth.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from cartstiff.identify import identify
from cartstiff.wings.identify.unknowns import unknowns_of


def main(rows: int = 100) -> None:
    """Run and print."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from tests.identify.campaigns import LOOP_UNKNOWNS, bent_loop

    with tempfile.TemporaryDirectory() as folder:
        guess, true, measured = bent_loop(Path(folder), rows)
    begin, cpu = time.perf_counter(), time.process_time()

    def tell(step: int, size: float) -> None:
        spent = time.perf_counter() - begin
        print(f"step {step}: {size:.6g} deviations after {spent:.1f} s", flush=True)

    result = identify(guess, measured, sought=LOOP_UNKNOWNS, loaded=True, progress=tell)
    spent, cpu = time.perf_counter() - begin, time.process_time() - cpu
    truth = unknowns_of(true, LOOP_UNKNOWNS).nominal
    kinds: dict[str, int] = {}
    held = 0
    for e, c in zip(result.estimates, truth, strict=True):
        kinds[e.verdict] = kinds.get(e.verdict, 0) + 1
        held += e.interval is not None and e.interval[0] <= c <= e.interval[1]
    print(
        f"{len(truth)} unknowns, {rows} rows, {len(result.model.observations)} numbers: "
        f"{spent:.1f} s, {cpu:.1f} s of processor time"
    )
    print(
        f"{kinds}; intervals that hold the truth: {held}; "
        f"residual {result.checks.chi_squared:.5g} at {result.checks.freedom:.4g} degrees"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
