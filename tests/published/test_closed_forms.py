"""Small systems whose stiffness is known in closed form."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import Chain, plain_tree
from tests.support import (
    absolute_error,
    add_frame,
    cross_matrix,
    platform_mechanism,
    translation,
)

from cartstiff import ElasticMechanism, JointSprings, PoseFunction, analyse
from cartstiff.geometry import BI_INVARIANT, KINEMATIC

# Printed to 15 digits; a handful of operations.
PRINTED = 1e-12
# Closed form against a few operations in double precision.
ROUNDING = 1e-13

LINKS, STIFFNESS, POSTURE = (0.5, 0.4), np.array([100.0, 80.0]), np.deg2rad([30.0, 60.0])
FORCE = np.array([5.0, -8.0, 0.0])
UNLOADED = np.array([[500.0, 750.555349946514], [750.555349946514, 1660.0]])
LOADED = np.array([[480.0, 739.008344562721], [739.008344562721, 1654.21367205046]])


def _planar(lengths, q, stiffness, rest=None) -> ElasticMechanism:
    model = pin.Model()
    parent, T = 0, np.eye(4)
    for i, length in enumerate(lengths):
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(T), f"j{i}")
        T = translation(length, 0, 0)
    add_frame(model, "tip", parent, T)
    chain = Chain(plain_tree(model), "tip")
    springs = JointSprings(stiffness, q if rest is None else rest)
    return ElasticMechanism("planar", chain, q, springs)


def _dead_force(force: np.ndarray) -> PoseFunction:
    def wrench(T):
        return np.concatenate([np.zeros(3), -T[:3, :3].T @ force])

    def stiffness(T):
        # Force -R^T f in the turning body axes: its change along a rotation is a cross product.
        K = np.zeros((6, 6))
        K[3:, :3] = -cross_matrix(T[:3, :3].T @ force)
        return K

    return PoseFunction(
        energy=lambda T: -float(force @ T[:3, 3]), wrench=wrench, stiffness=stiffness
    )


def _at_tip(elastic: ElasticMechanism, joint_stiffness: np.ndarray) -> np.ndarray:
    """Joint stiffness carried to the tip's translations, in base axes."""
    posture = elastic.mechanism.at(elastic.q)
    J = (posture.pose[:3, :3] @ posture.motion.jacobian[3:])[:2]
    return np.linalg.inv(J).T @ joint_stiffness @ np.linalg.inv(J)


def test_planar_arm_unloaded():
    elastic = _planar(LINKS, POSTURE, STIFFNESS)
    result = analyse(elastic)
    K = _at_tip(elastic, result.evaluation.hessian)
    assert absolute_error(K, UNLOADED) <= PRINTED * UNLOADED.max()


def test_planar_arm_with_a_dead_force_in_the_energy():
    elastic = _planar(LINKS, POSTURE, STIFFNESS, np.full(2, np.nan))
    result = analyse(elastic.with_potential(_dead_force(FORCE)))
    assert np.abs(result.evaluation.gradient).max() <= ROUNDING * 10
    K = _at_tip(elastic, result.evaluation.hessian)
    assert absolute_error(K, LOADED) <= PRINTED * LOADED.max()


def test_planar_arm_with_the_force_as_load():
    """The kinematic connection compares forces in inertial directions: the same matrix."""
    elastic = _planar(LINKS, POSTURE, STIFFNESS)
    R = elastic.mechanism.at(POSTURE).pose[:3, :3]
    W = np.concatenate([np.zeros(3), R.T @ FORCE])
    result = analyse(elastic, wrench=W)
    assert absolute_error(result.wrench, W) <= ROUNDING * 10
    reduction = result.reduction
    J = result.jacobian
    Y = np.linalg.pinv(reduction.reachable) @ J  # joint rates to the reachable basis
    H_B = Y.T @ reduction.reachable_stiffness @ Y
    change = BI_INVARIANT.wrench_term(W) - KINEMATIC.wrench_term(W)
    K = _at_tip(elastic, H_B + J.T @ change @ J)
    assert absolute_error(K, LOADED) <= PRINTED * LOADED.max()


def test_buckling_of_two_links():
    """Two equal links, a spring in each hinge, a load along them: P l / k = (3 - sqrt 5) / 2."""
    k, length = 37.0, 0.6
    critical = (3 - np.sqrt(5)) / 2 * k / length
    elastic = _planar((length, length), np.zeros(2), np.array([k, k]), np.zeros(2))
    for share, sign in ((0.999, 1), (1.001, -1)):
        push = np.array([-share * critical, 0, 0])
        result = analyse(elastic.with_potential(_dead_force(push)))
        smallest = np.linalg.eigvalsh(result.evaluation.hessian)[0]
        assert np.sign(smallest) == sign
    push = np.array([-critical, 0, 0])
    H = analyse(elastic.with_potential(_dead_force(push))).evaluation.hessian
    assert abs(np.linalg.eigvalsh(H)[0]) <= ROUNDING * k


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_four_diagonal_cables(turn):
    """Meeting in a point, stiffness k, tension t, length l: K = (2k + 2t/l) I in their plane."""
    k, t, length = 700.0, 40.0, 1.3
    angles = turn + np.pi / 4 + np.arange(4) * np.pi / 2
    anchors = length * np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1)
    elastic = platform_mechanism(
        anchors, np.zeros((4, 3)), np.full(4, k), np.full(4, length - t / k)
    )
    result = analyse(elastic)
    assert np.abs(result.wrench).max() <= ROUNDING * t
    K = result.matrices["K"][3:, 3:]
    assert absolute_error(K[:2, :2], (2 * k + 2 * t / length) * np.eye(2)) <= ROUNDING * k * 4
    assert abs(K[2, 2] - 4 * t / length) <= ROUNDING * k
    assert np.abs(result.matrices["K"][:3]).max() <= ROUNDING * k


def test_single_spring_along_x():
    """A straight spring: k along it, t / l across it."""
    elastic = platform_mechanism(
        np.array([[-2.0, 0, 0]]), np.zeros((1, 3)), np.array([10.0]), np.array([1.5])
    )
    result = analyse(elastic)
    assert np.allclose(result.wrench, [0, 0, 0, 5, 0, 0], rtol=0, atol=ROUNDING)
    expected = np.diag([10.0, 2.5, 2.5])
    assert absolute_error(result.matrices["A"][3:, 3:], expected) <= ROUNDING * 10
