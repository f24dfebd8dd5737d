"""Energy, gradient and Hessian of every potential against differences of its energy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import Chain, KinematicTree, PolynomialLaw, TabulatedLaw, plain_tree
from tests.support import (
    absolute_error,
    add_frame,
    exp_reference,
    frame_pose,
    gradient_of,
    hessian_of,
    loaded_arm,
    mass_energy,
    random_pose,
    relative_error,
)

from cartstiff import JointFunction, JointSprings, LineSprings, PoseFunction
from cartstiff.extend import Gravity, Platform

# Eighth-order differences at step 0.01 of energies near one; second differences lose four digits.
GRADIENT = 1e-10
HESSIAN = 1e-9
ROUNDING = 1e-13
# Derivatives that the library itself takes by differences.
NUMERICAL = 1e-8

GRAVITY = np.array([1.0, -2.0, -9.81])


def check(potential, mechanism, q, gradient=GRADIENT, hessian=HESSIAN):
    """Derivatives in the coordinates that the mechanism differentiates in."""
    sizes = np.ones(len(mechanism.at(q).coordinate_lengths))

    def energy(d):
        posture = mechanism.at(mechanism.displaced(q, d))
        if isinstance(potential, PoseFunction):  # the energy alone: derivatives cost more
            return potential.energy(posture.relative(potential.frame_a, potential.frame_b)[0])
        return potential.evaluate(posture).energy

    got = potential.evaluate(mechanism.at(q))
    assert relative_error(got.gradient, gradient_of(energy, sizes)) <= gradient
    H = hessian_of(energy, sizes)
    assert relative_error(got.hessian, H) <= hessian
    return got


def _branched() -> tuple[pin.Model, Chain, np.ndarray]:
    """An arm with a second branch from its second joint: frames "tip" and "other"."""
    rng = np.random.default_rng(33)
    arm = loaded_arm("RRPR", 33)
    parent = arm.model.getJointId("j2")
    for name in ("k1", "k2"):
        axis = rng.normal(size=3)
        joint = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
        parent = arm.model.addJoint(parent, joint, pin.SE3(random_pose(rng, 0.4)), name)
    add_frame(arm.model, "other", parent, random_pose(rng, 0.2))
    return arm.model, Chain(plain_tree(arm.model), "tip"), rng.uniform(-1, 1, 6)


def test_gravity_of_a_chain():
    model, chain, q = _branched()
    got = check(Gravity(GRAVITY), chain, q)
    assert abs(got.energy - mass_energy(model, GRAVITY)(q)) <= ROUNDING * abs(got.energy) * 10
    # The model given is left as it was: its own field is the standard one.
    assert np.array_equal(model.gravity.linear, [0, 0, -9.81])


def test_gravity_of_a_platform():
    rng = np.random.default_rng(14)
    base, points = rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    T_P_M, centre = random_pose(rng), np.array([0.2, -0.1, 0.3])
    platform = Platform(base, points, T_P_M=T_P_M, mass=3.0, mass_centre=centre)
    q = np.array([0.1, 0.2, 1.0, 0.3, -0.2, 0.4])
    got = check(Gravity(GRAVITY), platform, q)
    T_F_P = platform.pose_of(q) @ np.linalg.inv(T_P_M)
    position = T_F_P[:3, :3] @ centre + T_F_P[:3, 3]
    assert abs(got.energy + 3.0 * GRAVITY @ position) <= ROUNDING * 30
    massless = Platform(base, points)
    empty = Gravity(GRAVITY).evaluate(massless.at(q))
    assert empty.energy == 0
    assert not empty.gradient.any()
    assert not empty.hessian.any()


@pytest.mark.parametrize(
    "ends", [("world", "body"), ("other", "body"), ("body", "other"), ("body", "world")]
)
def test_line_springs_between_frames(ends):
    rng = np.random.default_rng(15)
    _, chain, q = _branched()
    springs = LineSprings(
        frame_a=ends[0],
        frame_b=ends[1],
        anchors=rng.normal(size=(3, 3)),
        points=rng.normal(size=(3, 3)),
        stiffness=rng.uniform(1, 5, 3),
        rest_length=rng.uniform(0.5, 2, 3),
    )
    got = check(springs, chain, q)
    # The same springs seen from the other end.
    turned = LineSprings(
        frame_a=ends[1],
        frame_b=ends[0],
        anchors=springs.points,
        points=springs.anchors,
        stiffness=springs.stiffness,
        rest_length=springs.rest_length,
    ).evaluate(chain.at(q))
    assert abs(turned.energy - got.energy) <= ROUNDING * got.energy * 10
    assert relative_error(turned.gradient, got.gradient) <= 10 * ROUNDING
    assert relative_error(turned.hessian, got.hessian) <= 10 * ROUNDING


@pytest.mark.parametrize("ends", [("world", "body"), ("body", "world")])
def test_line_springs_on_a_platform(ends):
    rng = np.random.default_rng(16)
    platform = Platform(rng.normal(size=(6, 3)), rng.normal(size=(6, 3)))
    springs = LineSprings(
        frame_a=ends[0],
        frame_b=ends[1],
        anchors=rng.normal(size=(4, 3)),
        points=rng.normal(size=(4, 3)),
        stiffness=rng.uniform(1, 5, 4),
        rest_length=rng.uniform(0.5, 2, 4),
    )
    check(springs, platform, np.array([0.1, 0.2, 2.0, 0.3, -0.2, 0.4]))


def _pose_energy(T):
    """Smooth, neither symmetric nor quadratic."""
    return float(np.sin(T[0, 3]) * T[1, 0] + T[2, 3] ** 2 * T[0, 1] + T[2, 2] * np.cos(T[1, 3]))


def _pose_derivatives(T):
    """dPhi and K^A of `_pose_energy` by this module's own differences."""

    def wrench(x):
        return gradient_of(
            lambda y: _pose_energy(T @ exp_reference(x) @ exp_reference(y)), np.ones(6)
        )

    return wrench(np.zeros(6)), gradient_of(wrench, np.ones(6))


@pytest.mark.parametrize("ends", [("world", "body"), ("other", "body")])
def test_pose_functions_with_and_without_derivatives(ends):
    _, chain, q = _branched()
    derived = PoseFunction(frame_a=ends[0], frame_b=ends[1], energy=_pose_energy)
    W, K_A = _pose_derivatives(chain.at(q).relative(*ends)[0])
    assert absolute_error(K_A, K_A.T) > 0.01  # K^A: its symmetric part must count
    given = PoseFunction(
        frame_a=ends[0],
        frame_b=ends[1],
        energy=_pose_energy,
        wrench=lambda T: W,
        stiffness=lambda T: K_A,
    )
    a = check(derived, chain, q, gradient=NUMERICAL, hessian=NUMERICAL)
    b = given.evaluate(chain.at(q))
    assert a.energy == b.energy
    assert relative_error(a.gradient, b.gradient) <= NUMERICAL
    assert relative_error(a.hessian, b.hessian) <= NUMERICAL


def test_pose_function_length_scale():
    """The same energy in millimetres: the natural length is told."""
    T = random_pose(np.random.default_rng(17))
    millimetres = T.copy()
    millimetres[:3, 3] *= 1000

    def scaled(M):
        N = M.copy()
        N[:3, 3] /= 1000
        return _pose_energy(N)

    _, w, K = PoseFunction(energy=_pose_energy).on_pose(T)
    _, w_mm, K_mm = PoseFunction(energy=scaled, length=1000.0).on_pose(millimetres)
    d = np.array([1.0] * 3 + [1e-3] * 3)
    assert relative_error(w_mm / d, w) <= NUMERICAL
    assert relative_error(K_mm / d / d[:, None], K) <= NUMERICAL


def test_joint_functions_with_and_without_derivatives():
    rng = np.random.default_rng(18)
    _, chain, q = _branched()
    M = rng.normal(size=(6, 6))

    def energy(x):
        return float(np.sin(M[0] @ x) + (M[1] @ x) ** 3 / 6 + 0.5 * x @ (M.T @ M) @ x)

    def gradient(x):
        return np.cos(M[0] @ x) * M[0] + (M[1] @ x) ** 2 / 2 * M[1] + M.T @ M @ x

    def hessian(x):
        return (
            -np.sin(M[0] @ x) * np.outer(M[0], M[0]) + (M[1] @ x) * np.outer(M[1], M[1]) + M.T @ M
        )

    given = check(JointFunction(energy, gradient, hessian), chain, q)
    derived = JointFunction(energy, scale=0.3).evaluate(chain.at(q))
    assert given.energy == derived.energy
    assert relative_error(derived.gradient, given.gradient) <= NUMERICAL
    assert relative_error(derived.hessian, given.hessian) <= NUMERICAL


def test_nonlinear_joint_springs():
    rng = np.random.default_rng(19)
    _, chain, q = _branched()
    laws = {
        1: PolynomialLaw((20.0, -3.0, 8.0)),
        4: TabulatedLaw((-2.0, -0.5, 0.0, 0.7, 2.5), (-30.0, -4.0, 0.0, 9.0, 60.0)),
    }
    springs = JointSprings(rng.uniform(1, 9, 6), q - rng.uniform(0.05, 0.3, 6), laws)
    check(springs, chain, q)


def test_followers_of_a_mimic_matrix():
    """Joints that follow others: kinematics, curvature, gravity, between frames too."""
    model, plain, _ = _branched()
    rng = np.random.default_rng(20)
    tree = plain.tree
    M, offset = np.zeros((6, 4)), rng.uniform(-0.3, 0.3, 6)
    M[:4, :4] = np.eye(4)
    M[4, 1], M[5, 3] = -1.5, 0.4
    mimic = KinematicTree(tree.model, tree.coordinates[:4], tree.frames, M, offset)
    chain = Chain(mimic, "other")
    q = rng.uniform(-1, 1, 4)
    posture = chain.at(q)
    assert mimic.n == 4
    assert relative_error(posture.pose, frame_pose(model, M @ q + offset, "other")) <= ROUNDING

    def motion(d):
        return np.linalg.inv(posture.pose) @ frame_pose(model, M @ (q + d) + offset, "other")

    dT = gradient_of(motion, np.ones(4))
    J = np.stack([[m[2, 1], m[0, 2], m[1, 0], *m[:3, 3]] for m in np.moveaxis(dT, -1, 0)], axis=1)
    assert absolute_error(posture.motion.jacobian, J) <= GRADIENT
    check(Gravity(GRAVITY), chain, q)
    check(JointSprings(rng.uniform(1, 9, 4), rng.uniform(-1, 1, 4)), chain, q)
    for ends in (("world", "body"), ("tip", "body"), ("body", "tip")):
        check(
            PoseFunction(frame_a=ends[0], frame_b=ends[1], energy=_pose_energy),
            chain,
            q,
            gradient=NUMERICAL,
            hessian=NUMERICAL,
        )


def test_one_joint():
    """The smallest chain of all."""
    arm = loaded_arm("R", 60)
    got = check(Gravity(GRAVITY), arm.elastic.mechanism, arm.q)
    assert got.gradient.shape == (1,)
    assert got.hessian.shape == (1, 1)
    check(
        PoseFunction(energy=_pose_energy),
        arm.elastic.mechanism,
        arm.q,
        gradient=NUMERICAL,
        hessian=NUMERICAL,
    )
