"""Every notebook runs in a fresh kernel, prints what is stored in it, and returns its numbers."""

import importlib.util
import json
from pathlib import Path

import pytest
from tests.docs.blocks import agree
from tests.examples.test_examples import NOISE, RELATIVE

from cartstiff.loading.catalogue import example_robots

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "examples" / "notebooks"
# A notebook that grows past this has pictures or tables stored in it.
LARGEST = 30_000

ROBOTS = {"which_joint"}
NUMBERS = {
    "energy_to_matrices": {
        "first moment, N cm": 945.102,
        "last force, N": 505.963,
        "asymmetry of K^A, N": 2376.39,
        # Differences of differences keep nine digits.
        "largest distance from the library": pytest.approx(0, abs=1e-6),
        "second derivative along the screw, N cm": 5803.79,
        "straight ahead, N cm": 6717.75,
        "with the legs, N cm": 2074.72,
        "largest distance from x' K x": pytest.approx(0, abs=1e-6),
    },
    "which_joint": {
        "deflection, mm": 4.15975,
        "most to blame": "shoulder_lift_joint",
        "its share, %": 52.2549,
        "best joint to stiffen": "shoulder_lift_joint",
        "deflection then, mm": 3.09623,
        "at rest under 150 N, mm": 4.17059,
        "at rest under 3 kN, mm": 86.9218,
        "K^K against the load inside": 0.0,
        "K^F against the load inside": 191.627,
    },
}


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
    picture = tmp_path / f"{name}.png"
    has_plots = importlib.util.find_spec("matplotlib") is not None
    main = _module(ROOT / "examples" / "make_gallery.py").load(name)["main"]
    numbers = main(picture) if has_plots else main()
    assert picture.exists() is has_plots
    assert list(numbers) == list(NUMBERS[name])
    for key, expected in NUMBERS[name].items():
        if isinstance(expected, float):
            assert numbers[key] == pytest.approx(expected, rel=RELATIVE, abs=NOISE), key
        else:
            assert numbers[key] == expected, key


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
