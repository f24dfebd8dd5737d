"""The angles of robot controllers in the example lead back to the rotation, by SciPy."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "controller_poses.py"
ORIENTATION = runpy.run_path(str(EXAMPLE))["orientation"]


def about(axis, angle):
    """Elementary rotations by degrees."""
    return Rotation.from_euler(axis, angle, degrees=True)


@pytest.mark.parametrize("controller", ["kuka", "fanuc", "abb", "ur"])
def test_controllers_numbers_lead_back_to_the_rotation(controller):
    """Composed as each maker's manual says, from elementary rotations."""
    R = Rotation.random(50, rng=np.random.default_rng(1))
    for one, wanted in zip(ORIENTATION(controller, R.as_matrix()), R, strict=True):
        if controller == "kuka":
            found = about("z", one[0]) * about("y", one[1]) * about("x", one[2])
        elif controller == "fanuc":
            found = about("z", one[2]) * about("y", one[1]) * about("x", one[0])
        elif controller == "abb":
            found = Rotation.from_quat(np.roll(one, -1))
            assert one[0] >= 0
        else:
            found = Rotation.from_rotvec(one)
        assert (found * wanted.inv()).magnitude() < 1e-12
