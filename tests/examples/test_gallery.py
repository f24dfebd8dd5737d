"""The scripts of the gallery: short, they run, and print what stands beside them."""

import importlib.util
import runpy

import pytest
from tests.docs.blocks import ROOT, agree
from tests.support.robots import example_robots

GALLERY = ROOT / "docs" / "gallery"
SCRIPTS = {path.stem: path for path in GALLERY.glob("*.py") if path.stem != "__main__"}
MOST_LINES = 39


def test_there_are_fourteen():
    assert len(SCRIPTS) == 14
    assert {path.stem for path in GALLERY.glob("*.txt")} == set(SCRIPTS)


@pytest.mark.skipif(not importlib.util.find_spec("matplotlib"), reason="draws with matplotlib")
@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_a_script_prints_what_stands_beside_it_and_draws(name, tmp_path, monkeypatch, capsys):
    text = SCRIPTS[name].read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    if any(f'load("{robot}"' in text for robot in ("ur5", "panda")) and not example_robots():
        pytest.skip("example-robot-data is not installed")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(SCRIPTS[name]))
    importlib.import_module("matplotlib.pyplot").close("all")
    expected, got = (GALLERY / f"{name}.txt").read_text(encoding="utf-8"), capsys.readouterr().out
    assert agree(expected, got), f"python docs/gallery {name} prints\n{got}"
    assert (tmp_path / f"{name}.png").stat().st_size > 5000
    assert (ROOT / "docs" / "images" / f"{name}.png").exists()
