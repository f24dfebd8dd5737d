"""``cartstiff view`` and ``cartstiff export`` as processes and in this one."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from tests.support.pages import stated

import cartstiff
from cartstiff.__main__ import main

SOURCE = str(Path(cartstiff.__file__).parents[1])


def run(*arguments: str) -> int:
    """Exit code of the command line in this process."""
    with pytest.raises(SystemExit) as exit_:
        main(list(arguments))
    assert isinstance(exit_.value.code, int)
    return exit_.value.code


@pytest.mark.parametrize("interrupt", [signal.SIGINT, signal.SIGTERM])
def test_view_serves_until_it_is_told_to_end(interrupt):
    process = subprocess.Popen(
        [sys.executable, "-m", "cartstiff", "view", "stewart-gough", "--no-open"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": SOURCE, "PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", line)
        assert found, line
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(found.group(), timeout=120) as answer:
            assert b"cartstiff" in answer.read()
        process.send_signal(interrupt)
        out, errors = process.communicate(timeout=120)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0
    assert errors == ""
    assert out == ""


def test_export_writes_a_page(tmp_path, capfd):
    path = tmp_path / "page.html"
    assert run("export", "stewart-gough", "-o", str(path)) == 0
    out, errors = capfd.readouterr()
    assert "MB" in out
    assert errors == ""
    text = path.read_text(encoding="utf-8")
    assert text.startswith("<!doctype html>")
    assert "<title>stewart-gough · cartstiff</title>" in text


def test_a_page_with_the_workspace_is_that_of_the_workspace(tmp_path):
    """The load counts where forces are limited; without, the page alone has it."""
    legs = {"stiffness": 1e7, "limits": [0.4, 0.8]}
    layout = {
        "base": {"radius": 0.35, "half_angle": 0.2},
        "height": 0.5,
        "platform": {"radius": 0.2, "half_angle": 0.2},
    }
    load = [0.0, 0.0, 0.0, 0.0, 0.0, -1000.0]
    for forces in ({}, {"force": [-260, 400]}):
        written = {"kind": "stewart-gough", "layout": layout, "legs": legs | forces}
        (tmp_path / "machine.yaml").write_text(json.dumps(written))
        elastic = cartstiff.load(tmp_path / "machine.yaml")
        reached = cartstiff.workspace(elastic, wrench=load if forces else None, fits=False)
        cloud = stated(str(tmp_path / "machine.yaml"), {"workspace": True}, load=load).cloud
        assert np.array_equal(cloud.positions[: len(reached.boundary)], reached.boundary)
        assert np.array_equal(cloud.positions[len(reached.boundary) :], reached.singular.surface)
        words = " ".join(cloud.values["limit that cuts"])
        assert ("force of legs" in words) is bool(forces)
