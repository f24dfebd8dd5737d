"""The fuzz harness sees what it must; a few inputs of every kind pass (`make fuzz`: many)."""

import pytest
from tools.fuzz import run
from tools.fuzz_inputs import FAMILIES

#: Seconds that no input takes even on a busy machine; what takes longer hangs.
PATIENCE = 300.0


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("abort", "signal 6"),
        ("wrong", "planted"),
        ("large", "MiB"),
        ("endless", "no answer for 1 s"),
        ("busy", "more than 1 s"),
    ],
)
def test_what_is_wrong_is_seen(kind, words):
    faults = run(
        1,
        families=[kind],
        seconds=1.0 if kind == "busy" else PATIENCE,
        patience=1.0 if kind == "endless" else PATIENCE,
    )
    assert [words in fault["fault"] for fault in faults] == [True]


def test_inputs_of_every_kind_are_answered_or_refused():
    assert run(len(FAMILIES), seed=20, seconds=PATIENCE) == []


def test_damaged_files_are_read_or_refused():
    assert (
        run(36, families=["urdf", "mjcf", "mechanism", "mechanism"], seed=4, seconds=PATIENCE) == []
    )
