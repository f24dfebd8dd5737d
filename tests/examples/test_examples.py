"""Every example runs and returns the numbers it returned when it was written."""

import importlib.util
import runpy
from pathlib import Path

import pytest
import yaml
from tests.support.robots import example_robots

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
# Six digits are kept below; rounding differs from machine to machine far behind them.
RELATIVE = 1e-4
# Numbers that vanish but for rounding are held below this, in the example's own units.
NOISE = 1e-6

ROBOTS = {
    "controller_poses",
    "deflection_compensation",
    "deflection_ellipsoids",
    "draw_in_meshcat",
    "frequencies_of_a_matrix",
    "load_and_asymmetry",
    "machining_posture",
    "path_without_collisions",
    "springs_in_parallel",
    "what_the_matrix_says",
    "workspace_map",
}
NUMBERS = yaml.safe_load(Path(__file__).with_name("numbers.yaml").read_text(encoding="utf-8"))


def check(main, expected, picture):
    """Run an example: its numbers, and its picture if it can be drawn."""
    has_plots = importlib.util.find_spec("matplotlib") is not None
    numbers = main(picture) if has_plots else main()
    if has_plots:
        importlib.import_module("matplotlib.pyplot").close("all")
    assert picture.exists() is has_plots
    assert list(numbers) == list(expected)
    for key, value in expected.items():
        if isinstance(value, dict):
            value = pytest.approx(value["about"], abs=value["within"])
        elif isinstance(value, float):
            value = pytest.approx(value, rel=RELATIVE, abs=NOISE)
        assert numbers[key] == value, key


def test_every_example_is_pinned():
    names = {path.stem for path in EXAMPLES.glob("*.py")} - {"make_gallery"}
    assert names == set(NUMBERS["examples"])


@pytest.mark.parametrize("name", NUMBERS["examples"])
def test_example_returns_its_numbers(name, tmp_path):
    if name in ROBOTS and not example_robots():
        pytest.skip("example-robot-data is not installed")
    main = runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]
    check(main, NUMBERS["examples"][name], tmp_path / f"{name}.png")
