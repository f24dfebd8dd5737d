"""Mutants of mechanism files are refused or right; tools/mutants.py tries 40 files by itself."""

import runpy

import pytest
from tests.docs.blocks import ROOT

TOOL = runpy.run_path(str(ROOT / "tools" / "mutants.py"))
FILES = ("stewart-gough", "cable-robot", "hexapod", "fanuc-r2000ic", "five-bar")


@pytest.mark.parametrize("name", FILES)
def test_each_is_refused_or_right(name):
    found = list(TOOL["judged"](ROOT / "robots" / f"{name}.yaml", 3, 7))
    assert {m.kind for m, _ in found} >= {"dropped", "doubled", "misspelled", "wrong unit"}
    assert [(m.kind, m.at, wrong) for m, wrong in found if wrong] == []


def test_the_judge_sees_what_is_wrong(tmp_path, monkeypatch):
    """Files that are right are faults where a mutant should have been refused."""
    monkeypatch.chdir(tmp_path)
    data = TOOL["read"](ROOT / "robots" / "stewart-gough.yaml")
    make, fault = TOOL["Mutant"], TOOL["fault"]
    for kind in ("doubled", "misspelled", "wrong unit", "wrong length"):
        assert fault(make(kind, ("legs", "stiffness"), data), "m.yaml") == "accepted"
    energy, code = (
        TOOL["_against_energy"],
        TOOL["answer"](TOOL["written"](make("", (), data)), "m.yaml"),
    )
    assert energy(data, code[1]) == ""
    data["legs"]["rest_length"][0] += 1.0
    assert "differs from the energy" in energy(data, code[1])
