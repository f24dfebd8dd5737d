"""Bundled files that are kept checked give the mechanisms of the files themselves."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from tools.checked_files import checked_files

import cartstiff
from cartstiff.errors import InputError
from cartstiff.loading.catalogue import bundled_files, bundled_folder, example_robots
from cartstiff.loading.keys import checked

KEPT = sorted(set(checked._kept()) - {""})


def test_the_kept_file_is_that_of_the_mechanism_files():
    """Else: ``python -m tools.checked_files``."""
    kept = (bundled_folder() / checked.CHECKED).read_text(encoding="utf-8")
    assert kept == checked_files()


def _loaded(name, monkeypatch, kept, **given):
    with monkeypatch.context() as patch:
        if not kept:
            patch.setattr(checked, "_kept", dict)
        return cartstiff.load(name, **given)


GIVEN = (
    {},
    {"gravity": [0, 0, -9.8], "payload": [2.0, 0.1, 0.0, 0.2]},
    {"tcp": [0.1, 0, 0.2, 0, 0, 1]},
)


@pytest.mark.parametrize("given", GIVEN)
@pytest.mark.parametrize("name", KEPT)
def test_both_ways_give_the_same_mechanism(name, given, monkeypatch):
    if "model" in bundled_files()[name].read_text() and not example_robots():
        pytest.skip("example-robot-data is not installed")
    quick, full = (_loaded(name, monkeypatch, kept, **given) for kept in (True, False))
    for key in ("name", "source", "notes", "parameters"):
        assert getattr(quick, key) == getattr(full, key)
    first, second = (cartstiff.analyse(elastic).as_dict() for elastic in (quick, full))
    assert first == second


def test_both_ways_refuse_with_the_same_words(monkeypatch):
    said = []
    for kept in (True, False):
        with pytest.raises(InputError) as refused:
            _loaded("cubic", monkeypatch, kept, locked={"a": 0.0})
        said.append(str(refused.value))
    assert said[0] == said[1]


def test_a_file_that_was_changed_is_read_anew(tmp_path, monkeypatch):
    text = bundled_files()["cubic"].read_text(encoding="utf-8")
    folder = tmp_path / "robots"
    folder.mkdir()
    (folder / "cubic.yaml").write_text(text + "# another\n", encoding="utf-8")
    monkeypatch.setattr(checked, "bundled_folder", lambda: folder)
    assert checked._kept()["cubic"]["crc"]
    assert checked.checked_before(folder / "cubic.yaml") is None
    (folder / "cubic.yaml").write_text(text, encoding="utf-8")
    assert np.isclose(checked.checked_before(folder / "cubic.yaml")[0].pose.xyz, 0.0).any()


def test_an_arm_is_answered_without_pydantic():
    code = (
        "import sys, cartstiff; from cartstiff.analysis.posture import analyse_posture;"
        "analyse_posture(cartstiff.analyse(cartstiff.load('cubic')), springs=False);"
        "heavy = {'pydantic', 'ruamel.yaml', 'scipy', 'numpy.random', 'xarray', 'meshcat'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
