"""What a user may get wrong with robots, units, ranges, collisions, maps: one clear line each."""

import numpy as np
import pytest
from tests.mechanisms.machines import joint, write_urdf
from tests.support.commands import run

import cartstiff
from cartstiff import InputError, commanded
from cartstiff.maps import Grid, compute_map

TOO_LARGE = {
    "q of a platform": lambda: cartstiff.analyse(cartstiff.load("stewart-gough"), [1e300] * 6),
    "q of an arm": lambda: cartstiff.analyse(cartstiff.load("ur5"), [1e300] * 6),
    "q by name": lambda: cartstiff.analyse(cartstiff.load("ur5"), {"elbow_joint": 1e300}),
    "q of many": lambda: cartstiff.analyse_many(cartstiff.load("ur5"), [[1e300] * 6]),
    "wrench": lambda: cartstiff.analyse(cartstiff.load("ur5"), wrench=[1e300] * 6),
    "wrench of many": lambda: cartstiff.analyse_many(
        cartstiff.load("ur5"), [[0.1] * 6], wrench=[1e300] * 6
    ),
    "wrench of modes": lambda: cartstiff.modes(cartstiff.load("ur5"), wrench=[1e300] * 6),
    "wrench of a rest": lambda: cartstiff.equilibrium(cartstiff.load("ur5"), wrench=[1e300] * 6),
    "springs": lambda: cartstiff.load("ur5").with_springs([1e300] * 6),
}


@pytest.mark.parametrize("case", TOO_LARGE.values(), ids=TOO_LARGE)
def test_numbers_whose_products_overflow_are_refused(case):
    """The command line refuses them; Python must not answer NaN."""
    with pytest.raises(InputError, match=r"too large.*1e\+30"):
        case()


def test_a_number_for_all_joints_is_no_posture():
    with pytest.raises(InputError, match="6 numbers"):
        commanded(cartstiff.load("ur5"), {"elbow_joint": 0.1}, q=0.3)


def test_postures_of_many_are_a_copy():
    q = np.full((3, 6), 0.3)
    found = cartstiff.analyse_many(cartstiff.load("ur5"), q)
    assert np.array_equal(found.q, q)
    assert not np.shares_memory(found.q, q)


def test_a_port_that_does_not_exist_is_refused():
    with pytest.raises(InputError, match=r"99999999.*port"):
        cartstiff.show(cartstiff.load("ur5"), port=99999999)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"damping": 0.02}, "damping.*damping_1"),
        ({"direction": [0, 0, 1]}, "direction.*along_free"),
        ({"deflect": [0, 0, 0, 0, 0, 1]}, "deflection.*deflection"),
    ],
)
def test_what_no_quantity_of_a_map_needs_is_refused(tmp_path, asked, words):
    elastic = cartstiff.load("ur5")
    grid = Grid({"elbow_joint": (0.5, 1.0, 3)}, elastic.names, elastic.q)
    with pytest.raises(InputError, match=words):
        compute_map(elastic, grid, ["condition"], tmp_path / "m.zarr", **asked)


def test_sensitivities_of_what_does_not_exist_are_no_table_of_nan(tmp_path):
    """An arm of two joints without masses: no K, no frequencies."""
    file = write_urdf(tmp_path, joint("j1", "base", "b"), joint("j2", "b", "c", (1, 0, 0)))
    out = run("analyse", file, "--sensitivities")
    assert "Sensitivities: none, as no stiffness matrix" in out
    assert "nan" not in out
