"""Mutants of mechanism files are refused or right; tools/mutants.py tries 40 files by itself."""

import json
import runpy
import shutil

import pytest
from tests.docs.blocks import ROOT

TOOL = runpy.run_path(str(ROOT / "tools" / "mutants.py"))
FILES = ("stewart-gough", "cable-robot", "hexapod", "fanuc-r2000ic", "five-bar")


@pytest.mark.parametrize("name", FILES)
def test_each_is_refused_or_right(name):
    found = list(TOOL["judged"](ROOT / "robots" / f"{name}.yaml", 3, 7))
    assert {m.kind for m, _ in found} >= {"dropped", "doubled", "misspelled", "wrong unit"}
    assert [(m.kind, m.at, wrong) for m, wrong in found if wrong] == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda data: data["legs"].pop(), "unknown joint"),
        (lambda data: data.update(actuated=["leg1/motr"]), "closest: leg1/motor"),
        (lambda data: data["actuated"].append("leg1/motor"), "stands twice"),
    ],
)
def test_drives_of_a_parallel_machine_are_joints_of_its_legs(tmp_path, monkeypatch, change, words):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "robots" / "rrr-leg.urdf", tmp_path)
    data = TOOL["read"](ROOT / "robots" / "3-rrr.yaml")
    change(data)
    code, _, error = TOOL["answer"](json.dumps(data), "m.yaml")
    assert code == 2
    assert words in error
    assert "key actuated" in error


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
