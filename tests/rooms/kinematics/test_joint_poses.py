"""Poses, errors and solutions of many postures of joints."""

import numpy as np
import pytest
from tests.inner import distinct, pose_errors
from tests.inner import joint_poses_Kinematics as Kinematics
from tests.machining.test_inverse_kinematics import needs_robots

import cartstiff


@needs_robots
@pytest.mark.parametrize("name", ["ur5", "panda", "xarm7"])
def test_kinematics_of_many_postures(name):
    mechanism = cartstiff.load(name).mechanism
    q = np.random.default_rng(1).uniform(-2, 2, (5, len(mechanism.coordinates)))
    many = Kinematics(mechanism).at(q)
    for row, T, J in zip(q, many.pose, many.jacobian, strict=True):
        posture = mechanism.at(row)
        # Constants of a URDF have twelve digits.
        np.testing.assert_allclose(T, posture.pose, atol=1e-12)
        np.testing.assert_allclose(J, posture.motion.jacobian, atol=1e-12)


def test_opposite_axis_is_no_solution():
    """Where the axis is exactly reversed the error must be half a turn, not zero."""
    flipped = np.diag([1.0, -1.0, -1.0, 1.0])[None]  # exactly: no rounding gives a direction
    for free in ("z", "y"):
        e = pose_errors(flipped, np.eye(4)[None], free, 1.0)
        assert np.linalg.norm(e) == pytest.approx(np.pi)


def test_postures_on_both_sides_of_half_a_turn_are_one():
    q = np.array([[np.pi - 1e-8, 0.1], [-np.pi + 1e-8, 0.1], [0.2, 0.1]])
    both = np.array([True, True])
    assert len(distinct(q, both, np.ones(2))) == 2
    assert len(distinct(q, ~both, np.ones(2))) == 3
