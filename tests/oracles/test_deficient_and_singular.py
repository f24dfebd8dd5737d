"""Fewer than six freedoms, and postures where the Jacobian loses rank.

With W the load, F(q) = Phi(q) - W . log(T_0^-1 T(q)) is stationary at the posture, so its Hessian
needs no connection; the compliance is what a small extra load does: C^B = J (Hess F)^-1 J^T.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import Chain, Closure, plain_tree
from tests.support import (
    absolute_error,
    add_frame,
    body_jacobian,
    frame_pose,
    gradient_of,
    hessian_of,
    loaded_arm,
    log_reference,
    matrices_from,
    refused,
    relative_error,
    spring_energy,
    translation,
)

from cartstiff import ElasticMechanism, JointSprings, UndefinedError, analyse

# Second differences of an energy of size 10 at step 0.01, through a matrix logarithm.
DIFFERENCES = 1e-8
ROUNDING = 1e-12
# The limit is approached with step 1e-4 from both sides: the error is its square.
LIMIT = 1e-6


def _oracle(model, q, springs, W, tip="tip"):
    energy, _ = spring_energy(springs.stiffness, springs.rest)
    inverse = np.linalg.inv(frame_pose(model, q, tip))

    def stationary(d):
        return energy(q + d) - W @ log_reference(inverse @ frame_pose(model, q + d, tip))

    J = body_jacobian(model, q, tip)
    H = hessian_of(stationary, np.ones(q.size))
    return J, H, J @ np.linalg.inv(H) @ J.T


@pytest.mark.parametrize(
    ("kinds", "given"),
    [("R", True), ("RR", False), ("RPR", True), ("RRRRR", True), ("RRRRR", False)],
)
def test_deficient_arm(kinds, given):
    arm = loaded_arm(kinds, 50 + len(kinds))
    n = len(kinds)
    result = analyse(arm.elastic, wrench=arm.wrench if given else None)
    W = result.wrench
    J = body_jacobian(arm.model, arm.q, "tip")
    springs = arm.elastic.springs
    torque = springs.stiffness * (arm.q - springs.rest)
    assert absolute_error(J.T @ W, torque) <= ROUNDING * np.abs(torque).max() * 10
    if given:
        assert relative_error(W, arm.wrench) <= ROUNDING
    else:  # the load of least norm, lengths measured in the characteristic length
        scale = np.array([1.0] * 3 + [1 / result.posture.length] * 3)
        least = scale * np.linalg.lstsq((J * scale[:, None]).T, torque, rcond=None)[0]
        assert relative_error(W, least) <= 1e-9
    assert all(K is None for K in result.matrices.values())
    _, H, C = _oracle(arm.model, arm.q, springs, W)
    assert relative_error(result.reduction.compliance, C) <= DIFFERENCES
    assert np.linalg.matrix_rank(C, tol=1e-9 * np.abs(C).max()) == n
    # The stiffness on the reachable motions, by its action on joint rates.
    Y = np.linalg.pinv(result.reduction.reachable) @ J
    assert relative_error(Y.T @ result.reduction.reachable_stiffness @ Y, H) <= DIFFERENCES
    note = next(s for s in result.notes if s.code == "fewer-than-six-freedoms")
    assert note.values["rank"] == n
    structural = np.array(note.values["structural_wrenches"])
    assert structural.shape == (6 - n, 6)
    assert np.abs(structural @ J).max() <= ROUNDING
    assert result.compliances["F"] is None


def test_compliances_of_a_deficient_arm():
    """C^X = C^B (I + (K^X - K^B) C^B)^-1 with the differences of the connections by hand."""
    arm = loaded_arm("RRRR", 61)
    result = analyse(arm.elastic, wrench=arm.wrench)
    C = result.compliances["B"]
    by_hand = matrices_from(np.zeros((6, 6)), arm.wrench)
    for name in "ABK":
        D = by_hand[name] - by_hand["B"]
        expected = C @ np.linalg.inv(np.eye(6) + D @ C)
        assert relative_error(result.compliances[name], expected) <= ROUNDING, name


def _wrist(bend: float, seed: int = 70):
    """Six joints; axes 4 and 6 coincide where the fifth joint is at zero."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    parent = 0
    joints = [
        (pin.JointModelRZ(), translation(0.05, 0, 0.3)),
        (pin.JointModelRY(), translation(0.1, 0.02, 0.1)),
        (pin.JointModelRY(), translation(0.45, 0.0, 0.03)),
        (pin.JointModelRX(), translation(0.4, 0.0, 0.06)),
        (pin.JointModelRY(), np.eye(4)),
        (pin.JointModelRX(), np.eye(4)),
    ]
    for i, (joint, T) in enumerate(joints, start=1):
        parent = model.addJoint(parent, joint, pin.SE3(T), f"j{i}")
    add_frame(model, "tip", parent, translation(0.1, 0.02, -0.03))
    q = np.array([0.3, -0.7, 1.2, 0.4, bend, -0.5])
    k = rng.uniform(50, 150, 6)
    W = np.array([1.0, -2.0, 0.5, 8.0, -5.0, 6.0])
    chain = Chain(plain_tree(model), "tip")
    springs = JointSprings(k, np.full(6, np.nan))
    return model, ElasticMechanism("wrist", chain, q, springs), q, W


def test_singular_posture_keeps_its_compliance():
    model, elastic, q, W = _wrist(0.0)
    result = analyse(elastic, wrench=W)
    assert [n.code for n in result.notes] == ["serial-singularity"]
    assert result.notes[0].values["rank"] == 5
    assert all(K is None for K in result.matrices.values())
    assert relative_error(result.wrench, W) <= ROUNDING
    _, _, C = _oracle(model, q, result.elastic.springs, W)
    assert relative_error(result.compliances["B"], C) <= DIFFERENCES
    lost = np.array(result.notes[0].values["structural_wrenches"])
    assert np.abs(lost @ body_jacobian(model, q, "tip")).max() <= ROUNDING


def test_singular_posture_is_the_limit_of_regular_ones():
    """K^-1 on both sides of the singularity closes in on the compliance there."""
    step = 1e-4
    at = analyse(_wrist(0.0)[1], wrench=_wrist(0.0)[3])
    beside = [analyse(_wrist(s * step)[1], wrench=at.wrench) for s in (-1, 1)]
    for name in "ABK":
        mean = 0.5 * sum(np.linalg.inv(r.matrices[name]) for r in beside)
        assert relative_error(at.compliances[name], mean) <= LIMIT, name
        assert (
            relative_error(beside[0].compliances[name], np.linalg.inv(beside[0].matrices[name]))
            <= LIMIT
        )


def test_strict_raises_at_a_singularity():
    _, elastic, _, W = _wrist(0.0)
    caught = refused(
        "cannot move in 1 of 6", analyse, elastic, wrench=W, strict=True, kind=UndefinedError
    )
    assert caught.code == "serial-singularity"
    refused("cannot move in 1 of 6", analyse(elastic, wrench=W).tensor, "A", kind=UndefinedError)


def test_regular_posture_by_both_routes():
    """Six joints: the square route and the general one give the same."""
    arm = loaded_arm("RRRRRR", 80)
    a, b = analyse(arm.elastic), analyse(arm.elastic, wrench=arm.wrench)
    for name in "ABKF":
        assert relative_error(a.matrices[name], b.matrices[name]) <= 1e-11, name
    assert relative_error(a.wrench, b.wrench) <= 1e-11


# -- planar five-bar ----------------------------------------------------------------------------

FIVE_BAR = np.array([0.5, 0.6, 0.45, 0.65, 0.6])  # proximal, distal left, right; ground


def _five_bar(q1=1.9, q3=1.1, load=True):
    """Two arms of two links whose tips meet; the frame sits on the left distal link's tip."""
    a, b, c, d, ground = FIVE_BAR
    p1 = a * np.array([np.cos(q1), np.sin(q1)])
    p3 = np.array([ground, 0]) + c * np.array([np.cos(q3), np.sin(q3)])
    # The upper intersection of two circles.
    along = p3 - p1
    dist = float(np.linalg.norm(along))
    x = (b**2 - d**2 + dist**2) / (2 * dist)
    y = np.sqrt(b**2 - x**2)
    u = along / dist
    meet = p1 + x * u + y * np.array([-u[1], u[0]])
    q2 = np.arctan2(*(meet - p1)[::-1]) - q1
    q4 = np.arctan2(*(meet - p3)[::-1]) - q3
    q = np.array([q1, q2, q3, q4])
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "left")
    second = model.addJoint(first, pin.JointModelRZ(), pin.SE3(translation(a, 0, 0)), "elbow")
    third = model.addJoint(0, pin.JointModelRZ(), pin.SE3(translation(ground, 0, 0)), "right")
    fourth = model.addJoint(third, pin.JointModelRZ(), pin.SE3(translation(c, 0, 0)), "elbow2")
    add_frame(model, "tip", second, translation(b, 0, 0))
    add_frame(model, "tip2", fourth, translation(d, 0, 0))
    closures = [Closure("tip", "tip2", "point")]
    chain = Chain(plain_tree(model), "tip", closures=closures, actuated=(0, 2), kind="closed-chain")
    rng = np.random.default_rng(90)
    k = np.array([120.0, 15.0, 150.0, 20.0])
    rest = q - (rng.uniform(-4, 4, 4) / k if load else 0.0)
    return model, ElasticMechanism("five-bar", chain, q, JointSprings(k, rest)), q


def test_planar_five_bar():
    """Reduced to its two cranks: stationary energy, load and compliance against differences."""
    model, elastic, q = _five_bar()
    result = analyse(elastic)
    assert np.abs(elastic.mechanism.at(q).residual).max() <= ROUNDING
    # A planar mechanism closed at a point: the third row of the closure says nothing, harmlessly.
    assert [n.code for n in result.notes] == ["fewer-than-six-freedoms"]
    assert result.reduction.freedoms == 2
    springs, W = elastic.springs, result.wrench
    energy, _ = spring_energy(springs.stiffness, springs.rest)
    inverse = np.linalg.inv(frame_pose(model, q, "tip"))

    def closed(d):
        return _five_bar(q[0] + d[0], q[2] + d[1])[2]

    def displacement(d):
        return log_reference(inverse @ frame_pose(model, closed(d), "tip"))

    J = gradient_of(displacement, np.ones(2))
    slope = gradient_of(lambda d: energy(closed(d)), np.ones(2))
    assert absolute_error(J.T @ W, slope) <= DIFFERENCES
    H = hessian_of(lambda d: energy(closed(d)) - W @ displacement(d), np.ones(2))
    C = J @ np.linalg.inv(H) @ J.T
    assert relative_error(result.compliances["B"], C) <= DIFFERENCES
    Y = np.linalg.pinv(result.reduction.reachable) @ J
    assert relative_error(Y.T @ result.reduction.reachable_stiffness @ Y, H) <= DIFFERENCES
    # The load matters here: without its term the answer is another one.
    plain = hessian_of(lambda d: energy(closed(d)), np.ones(2))
    assert relative_error(plain, H) > 1e-3


def test_five_bar_has_no_flat_connection():
    _, elastic, _ = _five_bar()
    result = analyse(elastic)
    assert result.matrices["F"] is None
    assert elastic.mechanism.at(elastic.q).chart() == (
        "K^F needs six actuated coordinates: this mechanism has 2"
    )
