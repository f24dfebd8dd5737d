"""Functions of rigid motions refuse other shapes in one line."""

import numpy as np
import pytest
from tests.support import refused

from cartstiff.geometry import se3

TWISTS = [
    se3.exp,
    se3.hat,
    se3.ad,
    se3.bracket_form,
    se3.right_jacobian,
    se3.right_jacobian_inverse,
]
POSES = [se3.log, se3.inverse, se3.adjoint, se3.adjoint_of_inverse, se3.vee, se3.roll_pitch_yaw]


@pytest.mark.parametrize("shape", [(), (0,), (3,), (5,), (7,), (6, 1), (4, 4)])
@pytest.mark.parametrize("function", TWISTS)
def test_twists(function, shape):
    refused(r"has another shape; expected \(\.\.\., 6\)", function, np.ones(shape))
    assert function(np.ones((2, 6))).shape[0] == 2


@pytest.mark.parametrize("shape", [(), (6,), (4,), (3, 3), (3, 4), (8, 4), (4, 5)])
@pytest.mark.parametrize("function", POSES)
def test_poses(function, shape):
    refused(r"has another shape; expected \(\.\.\., 4, 4\)", function, np.ones(shape))
    assert function(np.tile(np.eye(4), (2, 1, 1))).shape[0] == 2


@pytest.mark.parametrize(
    "call",
    [
        lambda: se3.skew(np.ones(6)),
        lambda: se3.unskew(np.ones((4, 4))),
        lambda: se3.bracket(np.ones(6), np.ones(3)),
        lambda: se3.pose(np.eye(4)),
        lambda: se3.pose(None, np.ones(4)),
        lambda: se3.from_roll_pitch_yaw(angles=np.ones(2)),
        lambda: se3.to_linear_angular(np.ones(5)),
        lambda: se3.to_linear_angular(np.ones(6), axis=1),
        lambda: se3.chain_curvature(np.ones(6), np.ones(6)),
        lambda: se3.chain_curvature(np.ones((6, 2)), np.ones(3)),
    ],
)
def test_others(call):
    refused("another shape", call)
