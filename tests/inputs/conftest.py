"""The command line in this process: what it refuses in one line, and what it accepts."""

import json
import tempfile

import pytest
from tests.support.commands import words as split

from cartstiff.__main__ import main

#: Keys of platforms, of closed chains, and of bodies with fewer than six freedoms.
OF_SOME = {"legs", "task_axes"}
KEYS = {
    "answer",
    "schema",
    "mechanism",
    "frame",
    "order",
    "units",
    "q",
    "forces",
    "pose",
    "jacobian",
    "wrench",
    "load",
    "gravity",
    "weighed",
    "before_load",
    "base_pose",
    "energy",
    "frame_offset",
    "stored_energy",
    "stiffness",
    "compliance",
    "notes",
    "analysis",
}


@pytest.fixture(autouse=True)
def workplace(tmp_path, monkeypatch):
    """An empty working folder, and another for temporary files that must be empty again after."""
    scratch, place = tmp_path / "scratch", tmp_path / "place"
    scratch.mkdir()
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    monkeypatch.delenv("CARTSTIFF_TRACEBACK", raising=False)
    monkeypatch.chdir(place)
    yield place
    assert not list(scratch.iterdir())


@pytest.fixture
def refused(capfd, workplace):
    """Run the command line, check that it refuses as promised; returns the line."""

    def check(*arguments, words=()):
        before = sorted(workplace.rglob("*"))
        capfd.readouterr()
        with pytest.raises(SystemExit) as exit_:
            main(split(*arguments))
        out, line = capfd.readouterr()
        assert exit_.value.code == 2, line
        assert out == ""
        assert line.startswith("cartstiff: ")
        assert line.count("\n") == 1
        assert line.endswith("\n")
        assert "Traceback" not in line
        assert "internal error" not in line
        assert len(line) < 800
        for word in words:
            assert word in line
        assert sorted(workplace.rglob("*")) == before
        return line

    return check


@pytest.fixture
def accepted(capfd):
    """Run `analyse --json`, check the object's keys; returns it."""

    def check(*arguments):
        capfd.readouterr()
        with pytest.raises(SystemExit) as exit_:
            main(["analyse", *(str(a) for a in arguments), "--json"])
        out, line = capfd.readouterr()
        assert exit_.value.code == 0, line
        assert line == ""
        data = json.loads(out, parse_constant=_no_constant)
        assert set(data) - OF_SOME == KEYS
        return data

    return check


def _no_constant(name):
    raise AssertionError(f"{name} in JSON")
