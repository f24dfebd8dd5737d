"""Choose the tests that `make test` leaves to `make thorough`, from the times of a whole run.

    make thorough PYTEST_ARGS="-n 2 --dist worksteal --durations=0 --durations-min=0.02" > times.txt
    python tools/slow_tests.py times.txt

A list of fewer tests serves as well: what was not run stays on the list if it is there.

Every case below `QUICK` seconds stays. A test function whose cases are all slower keeps its
quickest case, unless that one takes more than `LONG` seconds. The others are written to
`tests/thorough.txt`, one a line. `ALWAYS` names slow tests that stay because nothing else covers
what they do.
"""

from __future__ import annotations

import re
import sys
from collections import defaultdict
from pathlib import Path

LIST = Path(__file__).resolve().parents[1] / "tests" / "thorough.txt"
HEAD = """\
# Tests that `make test` leaves to `make thorough`; a file named on the command line runs whole.
# Written by tools/slow_tests.py from the times of a whole run.
"""
QUICK = 0.25
LONG = 2.5
ALWAYS = (
    "tests/browser/test_page.py::test_every_kind_of_mechanism",
    "tests/browser/test_exported_answers.py::",
    "tests/browser/test_page_hands.py::test_the_tool_follows_the_hand",
    "tests/identify/test_doubts.py::test_the_recommended_fit_contains_the_truth_beside_gross_errors",
    "tests/identify/test_known_polynomials.py::test_small_motions_under_the_load_are_too",
    "tests/identify/test_zeros.py::test_rotations_of_sessions_are_exact_on_a_soft_arm",
    "tests/inputs/test_fuzz_harness.py::test_damaged_files_are_read_or_refused",
    "tests/inputs/test_refused.py::",
    "tests/laws/test_every_answer.py::test_text_and_json_of_an_identification",
    "tests/rooms/recorded/test_gradients.py::test_the_gradient_costs_at_most_four_times_its_objective",
    "tests/maps/test_map_files.py::test_threads_that_begin_one_map_at_once",
    "tests/maps/test_stores.py::test_an_object_store",
    "tests/mechanisms/test_workspace.py::test_the_least_ratio_is_that_of_the_whole_workspace",
    "tests/packaging/test_wheel.py::test_installed_wheel_analyses_the_platform_from_elsewhere",
    "tests/view/test_better_posture.py::test_what_gets_worse_is_said",
    "tests/rooms/page/test_browser_program.py::test_a_page_without_a_server_says_what_the_library_says[ur5]",
    "tests/rooms/page/test_browser_program.py::test_a_page_without_a_server_says_what_the_library_says[delta]",
    "tests/view/test_report.py::test_the_answer_is_that_of_the_commands",
)


def times(report: str) -> dict[str, float]:
    """Seconds of each case in a report of `pytest --durations=0`, set-up included."""
    seconds: defaultdict[str, float] = defaultdict(float)
    for line in report.splitlines():
        if found := re.match(r"\s*([\d.]+)s\s+(?:setup|call|teardown)\s+(tests/\S.*)", line):
            seconds[found[2].strip()] += float(found[1])
    return dict(seconds)


def slow(seconds: dict[str, float]) -> list[str]:
    """The cases that are left out, sorted by name."""
    functions: defaultdict[str, list[str]] = defaultdict(list)
    for case in seconds:
        functions[case.partition("[")[0]].append(case)
    left_out: list[str] = []
    for cases in functions.values():
        quickest = min(cases, key=lambda case: seconds[case])
        kept = {case for case in cases if seconds[case] < QUICK or case.startswith(ALWAYS)}
        if not kept and seconds[quickest] <= LONG:
            kept = {quickest}
        left_out += [case for case in cases if case not in kept]
    return sorted(left_out)


def main() -> None:
    """Read the report and write the list."""
    seconds = times(Path(sys.argv[1]).read_text(encoding="utf-8", errors="replace"))
    known = {x for x in LIST.read_text(encoding="utf-8").splitlines() if not x.startswith("#")}
    cases = sorted({*slow(seconds), *(known - set(seconds))})
    LIST.write_text(HEAD + "\n".join(cases) + "\n", encoding="utf-8")
    rest = sum(seconds.values()) - sum(seconds.get(case, 0.0) for case in cases)
    print(f"{len(cases)} cases are left out; the others of {len(seconds)} took {rest:.0f} s")


if __name__ == "__main__":
    main()
