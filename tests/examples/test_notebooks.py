"""Every notebook runs in a fresh kernel, prints what is stored in it, and returns its numbers."""

import importlib.util
import json
from pathlib import Path

import pytest
from tests.docs.blocks import agree
from tests.examples.test_examples import NUMBERS as ALL
from tests.examples.test_examples import check
from tests.support.robots import example_robots

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples" / "notebooks"
# A notebook that grows past this has pictures or tables stored in it.
LARGEST = 30_000

ROBOTS = {"which_joint"}
NUMBERS = ALL["notebooks"]


def _module(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _skip_without_robots(name):
    if name in ROBOTS and not example_robots():
        pytest.skip("example-robot-data is not installed")


def test_every_notebook_is_pinned():
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == set(NUMBERS)


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_notebook_returns_its_numbers_and_makes_its_picture(name, tmp_path):
    _skip_without_robots(name)
    main = _module(ROOT / "examples" / "make_gallery.py").load(name)["main"]
    check(main, NUMBERS[name], tmp_path / f"{name}.png")


# The kernel is another process; what its client leaves behind is no fault of the notebook.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_notebook_prints_what_is_stored(name):
    _skip_without_robots(name)
    for package in ("nbclient", "nbformat", "ipykernel"):
        pytest.importorskip(package, reason="the notebook tools are not installed")
    tool = _module(ROOT / "tools" / "notebooks.py")
    path = FOLDER / f"{name}.ipynb"
    stored = json.loads(path.read_text(encoding="utf-8"))
    fresh = tool.run(path)
    assert fresh["metadata"] == stored["metadata"]
    for number, (expected, got) in enumerate(
        zip(tool.printed(stored), tool.printed(fresh), strict=True), start=1
    ):
        assert agree(expected, got), f"code cell {number} stores\n{expected}\nand prints\n{got}"


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_notebook_stores_text_alone(name):
    path = FOLDER / f"{name}.ipynb"
    assert path.stat().st_size < LARGEST
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        for output in cell.get("outputs", []):
            assert output["output_type"] == "stream"
            assert output["name"] == "stdout"
