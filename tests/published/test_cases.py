"""The published cases, the tools that answer them, and cases that are wrong on purpose."""

import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cases.__main__ import main
from cases.case import json_schema, read_case, read_cases
from cases.run import run_case, table, tool
from click.testing import CliRunner
from tests.support import refused

from cartstiff import InputError

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "cases"
CASES = {path.name: (path, case) for path, case in read_cases(FOLDER)}
PLAIN = {"plain_numpy": tool(FOLDER / "plain_numpy.py")}


@pytest.mark.parametrize("name", CASES)
def test_case(name):
    path, case = CASES[name]
    outcomes = run_case(path, case, PLAIN)
    assert not [(o.tool, o.asked.name, o.value) for o in outcomes if not o.as_said]
    assert all(o.value is not None for o in outcomes if o.tool == "cartstiff")
    assert {o.asked.name for o in outcomes if o.tool == "cartstiff"} == {a.name for a in case.asked}
    if (path / "derivation.py").is_file():
        code = (path / "derivation.py").read_text(encoding="utf-8")
        assert "cartstiff" not in code
        assert len(code.splitlines()) <= 60


def test_there_are_thirty_and_the_second_tool_answers_some():
    verdicts = [case.verdict for _, case in CASES.values()]
    assert len(verdicts) >= 30
    # To the last printed digit, every value of the case; the others say why not.
    assert sum(case.to_the_digit for _, case in CASES.values()) >= 40
    # What asks nothing says what is missing.
    assert all("missing" in case.inputs for _, case in CASES.values() if not case.asked)
    assert "contradicts itself" in verdicts
    names = ("cubic-centred", "puma-manipulability", "simscape-compliance")
    for name in names:
        assert any(o.tool == "plain_numpy" and o.meets for o in run_case(*CASES[name], PLAIN))


def test_the_schema_in_the_folder_is_that_of_the_code():
    assert (FOLDER / "case.schema.json").read_text(encoding="utf-8") == json_schema()


def test_the_short_reader_judges_alike():
    short = runpy.run_path(str(FOLDER / "read.py"))
    assert {name for name, _, _ in short["cases"]()} == set(CASES)
    assert len((FOLDER / "read.py").read_text(encoding="utf-8").splitlines()) <= 30
    for name, _, data in short["cases"]():
        for asked, own in zip(data["asked"], CASES[name][1].asked, strict=True):
            assert short["met"](asked, own.ours) == own.meets(own.ours) == own.agrees
            beside = np.array(own.printed, float) + 1.01 * own.tolerances()
            assert not short["met"](asked, beside)
            assert not own.meets(beside)


def _changed(tmp_path, name, old, new, file="case.yaml"):
    folder = tmp_path / name
    shutil.copytree(FOLDER / name, folder)
    home = CASES[name][1].answered_as
    if home:
        shutil.copytree(FOLDER / home, tmp_path / home, dirs_exist_ok=True)
    text = (folder / file).read_text(encoding="utf-8")
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("name", "old", "new", "file"),
    [
        # a sign, a unit, an order; of the inputs, of what is printed, of the answer
        (
            "cubic-point-above",
            "[-0.14, 0.0, 0.0, 0.0, 0.025, 0.0]",
            "[0.14, 0.0, 0.0, 0.0, 0.025, 0.0]",
            "case.yaml",
        ),
        ("simscape-compliance", "stiffness: 2.0e7", "stiffness: 2.0e4", "mechanism.yaml"),
        ("simscape-compliance", "[3, 4, 5, 0, 1, 2]", "[0, 1, 2, 3, 4, 5]", "answer.py"),
        ("simscape-stroke", "last_digit: 0.1", "last_digit: 0.0001", "case.yaml"),
        ("zefran-kumar-printed-coordinates", "printed:", "printed: &p", "case.yaml"),
    ],
)
def test_wrong_cases_fail(tmp_path, name, old, new, file):
    folder = _changed(tmp_path, name, old, new, file)
    outcomes = run_case(folder, read_case(folder))
    harmless = new.endswith("&p")  # an anchor changes nothing: the run must not fail either
    assert all(o.as_said for o in outcomes) is harmless


def test_command_tells_and_fails(tmp_path):
    run = CliRunner().invoke(
        main, [str(FOLDER / "cubic-centred"), "--with", str(FOLDER / "plain_numpy.py")]
    )
    assert run.exit_code == 0
    assert "printed digits  printed digits" in run.output
    folder = _changed(tmp_path, "cubic-centred", "0.015, 0.0, 0.0]", "0.016, 0.0, 0.0]")
    run = CliRunner().invoke(main, [str(folder)])
    assert run.exit_code == 1
    assert "WRONG" in run.output


def test_a_case_without_inputs_is_told_and_says_what_is_missing(tmp_path):
    run = CliRunner().invoke(main, [str(FOLDER / "milling-robot-kr240")])
    assert run.exit_code == 0
    assert "milling-robot-kr240: inputs incomplete" in run.output
    folder = _changed(tmp_path, "milling-robot-kr240", "missing:", "wanted:")
    refused("what would be needed", read_case, folder)


def test_as_a_program():
    done = subprocess.run(
        [sys.executable, "-m", "cases", "--only", "no-such-case"],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(ROOT / "src")},
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == "Error: --only: no such case, got no-such-case\n"


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("verdict: reproduced", "verdict: right", "verdict"),
        ("verdict: reproduced", "verdict: contradicts itself\nreason: none", "everything agrees"),
        ("    digits: 2\n", "", "exactly one of last_digit, digits"),
        ("    digits: 2\n", "    digits: 2\n    agrees: false\n", "because"),
        ("    digits: 2\n", "    digits: 2\n    tolerance: 1.0\n", "because"),
        ("title:", "titel:", "titel"),
        ("ours:", "ours: [1.0]\n    printed_too:", "printed_too"),
    ],
)
def test_bad_cases_are_refused_in_one_line(tmp_path, old, new, word):
    folder = _changed(tmp_path, "cubic-centred", old, new)
    with pytest.raises(InputError) as refusal:
        read_case(folder)
    assert word in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_case_without_an_answer_is_refused(tmp_path):
    folder = _changed(
        tmp_path, "cubic-centred", "import cartstiff", "import cartstiff", "answer.py"
    )
    (folder / "answer.py").unlink()
    refused("case has no answer", run_case, folder, read_case(folder))
    bad = _changed(
        tmp_path, "cubic-small-above", "answered_as: cubic-centred", "answered_as: ../elsewhere"
    )
    refused("answered_as", read_case, bad)


def test_tools_that_are_none(tmp_path):
    refused("not a Python file", tool, tmp_path / "none.py")
    (tmp_path / "empty.py").write_text("x = 1\n")
    refused("no function answers", tool, tmp_path / "empty.py")
    (tmp_path / "broken.py").write_text("x = \n")
    refused("cannot be imported", tool, tmp_path / "broken.py")
    refused("no cases", list, read_cases(tmp_path))
    (tmp_path / "raises.py").write_text("def answers(inputs, folder):\n    raise KeyError('a')\n")
    path, case = CASES["cubic-centred"]
    outcomes = run_case(path, case, {"other": tool(tmp_path / "raises.py")})
    (bad,) = (o for o in outcomes if not o.as_said)
    assert bad.words == "error: KeyError('a')"
    assert "error: KeyError" in table([(path, case)], outcomes)
