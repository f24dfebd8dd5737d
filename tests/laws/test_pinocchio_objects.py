"""Pinocchio's Force, Motion, SE3 and Inertia are taken as what they are, wherever numbers enter."""

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import displacement_of_point, move_stiffness, screw_of_twist, screw_of_wrench
from tests.support import refused

import cartstiff
from cartstiff import DeadWrench, FollowerWrench, inverse_kinematics
from cartstiff.analysis import cartesian_stiffness
from cartstiff.geometry import se3

W = np.array([1.0, -2.0, 3.0, 40.0, 50.0, -60.0])
FORCE = pin.Force(W[3:], W[:3])
MOTION = pin.Motion(W[3:], W[:3])
T = pin.SE3(pin.utils.rotate("y", 0.4), np.array([0.1, -0.2, 0.3]))


@pytest.fixture(scope="module")
def arm():
    return cartstiff.load("ur5")


def test_a_force_is_a_wrench(arm):
    """Power of the object's own product is that of our six numbers."""
    assert FORCE.dot(MOTION) == pytest.approx(W @ W)
    plain, of_object = (cartstiff.analyse(arm, wrench=w) for w in (W, FORCE))
    assert of_object.wrench == pytest.approx(W)
    assert of_object.B.matrix == pytest.approx(plain.B.matrix)
    assert of_object.motion_under(FORCE) == pytest.approx(plain.motion_under(W))
    assert np.asarray(cartstiff.analyse(arm, wrench=FORCE, load_axes="world").wrench) == (
        pytest.approx(cartstiff.analyse(arm, wrench=W, load_axes="world").wrench)
    )
    for load in (DeadWrench, FollowerWrench):
        assert load(FORCE).wrench == pytest.approx(W)
    rests = [cartstiff.equilibrium(arm, wrench=w) for w in (W, FORCE)]
    assert rests[1].q == pytest.approx(rests[0].q, abs=1e-12)
    rests = [cartstiff.equilibrium(arm, DeadWrench(w)) for w in (W, FORCE)]
    assert rests[1].q == pytest.approx(rests[0].q, abs=1e-12)
    a, b = (cartstiff.modes(arm, wrench=w) for w in (W, FORCE))
    assert b.frequencies == pytest.approx(a.frequencies)


def test_one_force_for_each_posture(arm):
    Q = np.stack([arm.q, arm.q + 0.1])
    forces = pin.StdVec_Force()
    for f in (FORCE, -1.0 * FORCE):
        forces.append(f)
    for given in ([FORCE, -1.0 * FORCE], forces):
        found = cartstiff.analyse_many(arm, Q, wrench=given, outputs=["wrench", "B"])
        plain = cartstiff.analyse_many(arm, Q, wrench=np.stack([W, -W]), outputs=["wrench", "B"])
        assert found.wrench == pytest.approx(plain.wrench)
    assert cartstiff.analyse_many(arm, Q, wrench=FORCE, outputs=["wrench"]).wrench[1] == (
        pytest.approx(W)
    )


def test_geometry(arm):
    M = T.homogeneous
    assert se3.exp(MOTION) == pytest.approx(pin.exp6(MOTION).homogeneous)
    assert se3.log(T) == pytest.approx(np.r_[pin.log6(T).angular, pin.log6(T).linear])
    assert se3.adjoint(T) @ W == pytest.approx(np.r_[T.act(MOTION).angular, T.act(MOTION).linear])
    assert se3.hat(MOTION) == pytest.approx(
        np.block([[pin.skew(MOTION.angular), MOTION.linear[:, None]], [np.zeros((1, 4))]])
    )
    assert se3.to_linear_angular(FORCE) == pytest.approx(FORCE.vector)
    K = np.diag([1.0, 2, 3, 4, 5, 6])
    assert move_stiffness(K, T) == pytest.approx(move_stiffness(K, M))
    result = cartstiff.analyse(arm)
    assert result.B.to_frame(T).matrix == pytest.approx(result.B.to_frame(M).matrix)
    assert cartstiff.load("ur5", tcp=T).mechanism.frame_offset == pytest.approx(M)
    assert displacement_of_point(MOTION, [0, 0, 1]) == pytest.approx(
        displacement_of_point(W, [0, 0, 1])
    )
    assert screw_of_twist(MOTION).pitch == pytest.approx(screw_of_twist(W).pitch)
    assert screw_of_wrench(FORCE).pitch == pytest.approx(screw_of_wrench(W).pitch)
    J = np.eye(6)
    assert cartesian_stiffness(J, K, FORCE) == pytest.approx(cartesian_stiffness(J, K, W))


def test_poses_of_inverse_kinematics(arm):
    target = cartstiff.analyse(arm, arm.q + 0.05).pose
    found = inverse_kinematics(arm, pin.SE3(target), arm.q[None])
    assert arm.mechanism.at(found[0]).pose == pytest.approx(target, abs=1e-6)
    both = inverse_kinematics(arm, [pin.SE3(target), pin.SE3(target)], arm.q[None])
    assert len(both) == 2


def test_what_holds_other_numbers_is_refused(arm):
    inertia = pin.Inertia(2.0, np.array([0.0, 0.0, 0.1]), 0.01 * np.eye(3))
    refused("payload", cartstiff.load, "ur5", payload=inertia)
    refused("wrong", cartstiff.analyse, arm, wrench=T)
    from tests.doors import real_array

    spatial = real_array(inertia)
    twist = np.r_[MOTION.angular, MOTION.linear]
    assert twist @ spatial @ twist == pytest.approx(2 * inertia.vtiv(MOTION) / 2)
