"""Every example runs and returns the numbers it returned when it was written."""

import importlib.util
import runpy
from pathlib import Path

import pytest

from cartstiff.loading.catalogue import example_robots

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
# Six digits are kept below; rounding differs from machine to machine far behind them.
RELATIVE = 1e-4
# Numbers that vanish but for rounding are held below this, in the example's own units.
NOISE = 1e-6
# A slope fitted on a log-log plot between rounding and curvature differs between processors.
SLOPE = 0.02

ROBOTS = {
    "deflection_compensation",
    "deflection_ellipsoids",
    "draw_in_meshcat",
    "four_connections",
    "load_and_asymmetry",
    "machining_posture",
    "own_potential",
    "panda_nullspace",
    "ur5_drilling",
    "what_the_matrix_says",
    "workspace_map",
}
NUMBERS = {
    "buckling": {
        "two links, P l / k": 0.3819660112501051,
        "three links, P l / k": 0.19806226419516165,
        "largest distance from the closed form": 0.0,
        "the branch of two links is stable": True,
        "two links, P l / k at 0.5 m aside": 0.40534,
    },
    "cable_robot": {
        "twisting without preload (extrapolated), N m/rad": 38.2263,
        "twisting at preload 200 N, N m/rad": 319.649,
        "twisting per preload, m/rad": 1.40711,
        "sideways at preload 25 N, N/m": 176846.0,
        "sideways at preload 200 N, N/m": 177457.0,
        "slack 10 mm to the side": [3, 4, 7, 8],
        "sideways 10 mm to the side, N/m": 90451.5,
    },
    "cubic_platform": {
        "deviation from the closed form": 0.0,
        "ratio of stiffnesses at the centre": 1.0,
        "ratio 0.1 m below": 2.34094,
        "ratio 0.1 m above": 1.81282,
    },
    "deflection_compensation": {
        "before, largest, mm": 1.26308,
        "before, rms, mm": 0.939628,
        "before, largest, deg": 0.183791,
        "after, largest, mm": 0.0,
        "after, on an arm a tenth softer, largest, mm": 0.140344,
        "largest change of a command, mrad": 1.52998,
        "all points are stable": True,
    },
    "deflection_ellipsoids": {
        "reaching up, softest, mm": 2.73683,
        "reaching up, firmest, mm": 0.41315,
        "bundled posture, softest, mm": 2.77824,
        "bundled posture, firmest, mm": 0.351588,
        "stretched out, softest, mm": 2.24837,
        "stretched out, firmest, mm": 0.0477633,
    },
    "delta": {
        "vertical, forearms as in the file, N/m": 73605.7,
        "vertical, forearms 1000 times stiffer, N/m": 74173.8,
        "horizontal, forearms as in the file, N/m": 25021.2,
        "horizontal, forearms 1000 times stiffer, N/m": 25214.4,
        "twist, forearms as in the file, N m/rad": 20.9143,
        "twist, forearms 1000 times stiffer, N m/rad": 20914.3,
    },
    "draw_in_meshcat": {
        "softest direction, bent, N/m": 119762.0,
        "softest direction, stretched, N/m": 47143.4,
        "firmest direction, stretched, N/m": 2.94581e6,
        "no radius at, N/m": 1000.0,
        "radius for each factor of ten, m": 0.05,
        "commands": 225.0,
    },
    "five_bar": {
        "rank": 2,
        "softest direction, N/m": 7285.61,
        "stiffest direction, N/m": 18418.3,
        "postures": 121,
        "softest over the workspace, N/m": 124.629,
        "stiffest over the workspace, N/m": 63022.0,
    },
    "four_connections": {
        "A rotation, N m/rad": 0.0,
        "A coupling, N": 185.0,
        "A translation, N/m": 0.0,
        "K rotation, N m/rad": 0.0,
        "K coupling, N": 185.0,
        "K translation, N/m": 0.0,
        "F rotation, N m/rad": 63.9211,
        "F coupling, N": 252.849,
        "F translation, N/m": 769.044,
        "asymmetry of A, N": 370.0,
    },
    "grasp": {
        "spin about the contacts' line": 0.0,
        "rotation about x, no squeeze": 2.72948,
        "rotation about x, as in the file": 2.46236,
        "rotation about x, four times": 1.66098,
        "rotation about z, no squeeze": 0.885813,
        "rotation about z, as in the file": 0.685813,
        "rotation about z, four times": 0.0858131,
    },
    "load_and_asymmetry": {
        "asymmetry per force": 0.8,
        "largest error of the prediction, N": 0.0,
        "asymmetry of B at 500 N, N": 0.0,
        "lowest translational stiffness unloaded, N/m": 74738.6,
        "the same at 500 N, N/m": 74123.1,
    },
    "machining_posture": {
        "as drawn, worst, mm": 1.59904,
        "best constant turn, worst, mm": 1.16644,
        "best turn at each point, worst, mm": 1.16572,
        "largest step of a joint is allowed": True,
        "best place, x, m": 0.5,
        "best place, y, m": -0.025,
        "best place, worst, mm": 0.717667,
    },
    "own_connection": {
        "ball is the kinematic connection": True,
        "plate is symmetric": True,
        "plate is bi-invariant": False,
        "plate against K^K, N cm/rad": 1188.2,
        "odd: asymmetry, N": 2376.39,
        "odd: error of the prediction, N": 0.0,
        "asymmetry at share 1/2": 0.0,
    },
    "own_potential": {
        "slope, right derivatives": pytest.approx(3, abs=SLOPE),
        "slope, Hessian left out": pytest.approx(2, abs=SLOPE),
        "numerical against by hand": 0.0,
        "largest change of K^B": 4048.05,
        "unbalanced wrench": 0.0,
    },
    "panda_nullspace": {
        "lowest, default posture": 7856.31,
        "lowest, least on the way": 7856.31,
        "lowest, greatest on the way": 8149.89,
        "vertical, default posture": 8039.91,
        "vertical, least on the way": 8039.91,
        "vertical, greatest on the way": 8785.45,
    },
    "paper_tables": {
        "printed A": 39.6602,
        "printed B": 37.7639,
        "printed K": 37.7639,
        "printed F": 43.9241,
        "bundled A": 0.0492497,
        "bundled B": 0.0492497,
        "bundled K": 0.0492497,
        "bundled F": 0.0489411,
    },
    "parallel_machines": {
        "6-pus, N/mm": 120000.0,
        "hexaglide, N/mm": 292895.0,
        "6-rus, N/mm": 864.481,
        "3-rps, N/mm": 29189.2,
        "3-prs, N/mm": 150000.0,
        "delta, N/mm": 73.6057,
        "tricept, N/mm": 282353.0,
        "orthoglide, N/mm": 10000.0,
    },
    "platform_near_singularity": {
        "smallest at 0 deg, N m/rad": 125000.0,
        "smallest at 85 deg, N m/rad": 1671.47,
        "smallest at 90 deg, N m/rad": 0.0,
        "notes at 85 deg": [],
        "notes at 90 deg": ["singular-stiffness", "tensions-chosen", "type-2-singularity"],
        "K^F exists at 90 deg": False,
    },
    "six_ups": {
        "pose, largest relative difference": 0.0,
        "K^B, largest relative difference": 0.0,
        "K^F, largest relative difference": 0.0,
        "sinking under 200 kg, mm": 0.20285,
        "difference of the sinking, mm": 0.0,
        "turning under 200 kg, mrad": 0.390572,
    },
    "three_rrr": {
        "in the plane, N/m": 191243.0,
        "in the plane, the links alone, N/m": 324846.0,
        "the links' part in the plane, %": 58.8721,
        "out of the plane, N/m": 904868.0,
        "the links' part out of the plane, %": 100.0,
        "sinking under 50 N, mm": 0.0552567,
    },
    "ur5_drilling": {
        "pushed back at the first hole, mm": 0.640109,
        "wandering at the first hole, mm": 0.418314,
        "pushed back at the middle hole, mm": 0.692223,
        "wandering at the middle hole, mm": 0.233176,
        "pushed back at the last hole, mm": 0.971713,
        "wandering at the last hole, mm": 0.494167,
    },
    "vibrating_platform": {
        "first frequency, Hz": 780.602,
        "last frequency, Hz": 1269.66,
        "first frequency under 60 kN, Hz": 772.994,
        "static compliance along x, um/kN": 47.4996,
        "depth that is stable at every speed, mm": 2.97769,
        "deepest between the speeds, mm": 18.2997,
    },
    "what_the_matrix_says": {
        "softest, rotation held, N/m": 74614.3,
        "softest, rotation free, N/m": 36057.5,
        "from flange to centre of compliance, m": 0.202137,
        "smallest pitch, m/rad": 0.13705,
        "natural length, m": 0.178059,
        "condition number there": 31.4449,
        "condition number in metres": 201.88,
        "best condition number": 27.5355,
        "springs that do the same": ["line", "line", "line", "line", "line", "screw"],
        "largest change by the connection at 100 N, %": 0.572828,
        "largest change by the connection at 3 kN, %": 15.8351,
    },
    "workspace_map": {
        "postures": 1617,
        "singular": 81,
        "softest, kN/m": 21.5712,
        "elbow there, rad": 0.1,
        "stiffest, kN/m": 108.442,
        "elbow at the stiffest, rad": 2.4,
    },
}


def test_every_example_is_pinned():
    names = {path.stem for path in EXAMPLES.glob("*.py")} - {"make_gallery"}
    assert names == set(NUMBERS)


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_example_returns_its_numbers(name, tmp_path):
    if name in ROBOTS and not example_robots():
        pytest.skip("example-robot-data is not installed")
    picture = tmp_path / f"{name}.png"
    has_plots = importlib.util.find_spec("matplotlib") is not None
    main = runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]
    numbers = main(picture) if has_plots else main()
    if has_plots:
        importlib.import_module("matplotlib.pyplot").close("all")
    assert picture.exists() is has_plots
    assert list(numbers) == list(NUMBERS[name])
    for key, expected in NUMBERS[name].items():
        if isinstance(expected, float):
            assert numbers[key] == pytest.approx(expected, rel=RELATIVE, abs=NOISE), key
        else:
            assert numbers[key] == expected, key
