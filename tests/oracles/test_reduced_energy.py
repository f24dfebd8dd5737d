"""Redundant arms and closed chains against differences of their reduced energy.

The reduced energy of a pose is the least energy among all coordinates that reach it; it is found
here by direct constrained minimisation on Pinocchio's own kinematics. Its derivative is the load,
its second derivative along screw motions K^B; the load's derivative in the moving frame is K^A.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import null_space
from tests.doors import Chain, Closure, plain_tree
from tests.support import (
    LegGeometry,
    ReducedEnergy,
    absolute_error,
    add_chain,
    add_frame,
    body_jacobian,
    exp_reference,
    frame_pose,
    general_legs,
    gradient_of,
    hessian_of,
    legs_as_platform,
    legs_as_tree,
    loaded_arm,
    mass_energy,
    mass_gradient,
    matrices_from,
    paper_geometry,
    random_pose,
    relative_error,
    spring_energy,
)

from cartstiff import ElasticMechanism, JointSprings, PostureStiffness, analyse

# Required of the engine; the differences themselves reach about 1e-10.
ENERGY = 1e-8
# First differences of the load are better conditioned.
LOAD_FIELD = 1e-9
# Two exact routes to the same matrix through different coordinates.
EQUIVALENT = 1e-9
# Eighth-order differences of maps of unit size at step 0.01.
FIRST_DIFFERENCES = 1e-11
SECOND_DIFFERENCES = 1e-10
# Closures met to rounding.
ASSEMBLED = 1e-12

GRAVITY = np.array([0.6, -0.4, -9.81])
# Natural sizes of the six displacements: the steps of the differences are 0.01 of them.
SIZES = np.array([0.6, 0.6, 0.6, 0.3, 0.3, 0.3])


def check(result: PostureStiffness, reduced: ReducedEnergy) -> None:
    """W, K^A, K^B, K^K, K^+ of the engine against the reduced energy."""
    assert relative_error(result.pose, reduced.pose0) <= ASSEMBLED
    W = gradient_of(reduced.at, SIZES)
    assert relative_error(result.wrench, W) <= ENERGY
    K_B = hessian_of(reduced.at, SIZES)
    assert relative_error(result.matrices["B"], K_B) <= ENERGY
    K_A = gradient_of(reduced.wrench, SIZES)
    for name, K in matrices_from(K_A, reduced.wrench(np.zeros(6))).items():
        assert relative_error(result.tensor(name).matrix, K) <= LOAD_FIELD, name
    # The differences must be able to tell: the load changes K visibly.
    assert absolute_error(K_A, K_A.T) > 1e-3 * np.abs(K_A).max()


def reduced_energy(model, elastic: ElasticMechanism, frame: str, q, **ties) -> ReducedEnergy:
    k, rest = elastic.springs.stiffness, elastic.springs.rest
    energy, gradient = spring_energy(k, rest)
    if elastic.gravity is None:
        return ReducedEnergy(
            model, frame, q, energy, gradient, np.diag(k) @ np.ones(len(k)), **ties
        )
    mass, force = mass_energy(model, elastic.gravity), mass_gradient(model, elastic.gravity)
    return ReducedEnergy(
        model,
        frame,
        q,
        lambda x: energy(x) + mass(x),
        lambda x: gradient(x) + force(x),
        k,
        **ties,
    )


@pytest.mark.parametrize(("kinds", "seed"), [("RRRRRRR", 1), ("RRRRPRRRR", 3)])
def test_redundant_arm(kinds, seed):
    arm = loaded_arm(kinds, seed)
    result = analyse(arm.elastic)
    assert relative_error(result.wrench, arm.wrench) <= 1e-11
    check(result, reduced_energy(arm.model, arm.elastic, "tip", arm.q))


def test_redundant_arm_under_gravity():
    arm = loaded_arm("RRRRRRR", 4)
    springs = JointSprings(arm.elastic.springs.stiffness, np.full(7, np.nan))
    elastic = replace(arm.elastic, springs=springs, gravity=GRAVITY)
    result = analyse(elastic, wrench=arm.wrench)
    assert relative_error(result.wrench, arm.wrench) <= 1e-11
    check(result, reduced_energy(arm.model, result.elastic, "tip", arm.q))


def test_six_joints_under_gravity():
    arm = loaded_arm("RRRRRR", 6)
    result = analyse(replace(arm.elastic, gravity=GRAVITY))
    check(result, reduced_energy(arm.model, replace(arm.elastic, gravity=GRAVITY), "tip", arm.q))


def _ties() -> dict[str, list[tuple[str, str]]]:
    return {"points": [(f"point{s}", f"tip{s}") for s in range(1, 6)]}


@pytest.mark.parametrize("case", ["springs in the legs", "springs everywhere and gravity"])
def test_six_ups_tree(case):
    options = {
        "springs in the legs": {},
        "springs everywhere and gravity": {
            "passive": 60.0,
            "passive_torque": 3.0,
            "gravity": GRAVITY,
        },
    }[case]
    model, elastic = legs_as_tree(general_legs(), **options)
    posture = elastic.mechanism.at(elastic.q)
    assert np.abs(posture.residual).max() <= ASSEMBLED
    result = analyse(elastic)
    assert result.notes == ()
    check(result, reduced_energy(model, elastic, "platform", elastic.q, **_ties()))


@pytest.mark.parametrize("which", ["general", "paper"])
def test_tree_with_closures_equals_line_springs(which):
    """Six UPS legs with springs in the prismatic joints are six line springs."""
    base, platform, k, rest = paper_geometry()
    paper = LegGeometry(base, platform, np.zeros(6), k, rest)
    legs = general_legs() if which == "general" else paper
    _, tree = legs_as_tree(legs)
    a, b = analyse(tree), analyse(legs_as_platform(legs))
    assert relative_error(a.pose, b.pose) <= ASSEMBLED
    assert relative_error(a.wrench, b.wrench) <= EQUIVALENT
    assert abs(a.energy - b.energy) <= EQUIVALENT * b.energy
    for name in "ABKF":
        assert relative_error(a.matrices[name], b.matrices[name]) <= EQUIVALENT, name
        assert relative_error(a.compliances[name], b.compliances[name]) <= EQUIVALENT, name
    assert relative_error(a.F.connection.symbols, b.F.connection.symbols) <= EQUIVALENT


def test_flat_connection_of_actuated_joints():
    """K^F of a closed chain with passive springs: the Hessian in the actuated coordinates."""
    model, elastic = legs_as_tree(general_legs(), passive=60.0, passive_torque=3.0)
    result = analyse(elastic)
    chain = elastic.mechanism
    actuated = list(chain.actuated)
    reduced = reduced_energy(model, elastic, "platform", elastic.q, **_ties())
    start = elastic.q[actuated]

    def at(d):
        """Coordinates with the legs at given lengths: Newton on the closures and the lengths."""
        q = elastic.q.copy()
        for _ in range(30):
            residual, D = reduced.conditions(q, None)
            D = np.vstack([D, np.eye(q.size)[actuated]])
            residual = np.concatenate([residual, q[actuated] - start - d])
            step = np.linalg.solve(D, -residual)
            q = q + step
            if np.abs(step).max() < 1e-14:
                break
        return q

    hessian = hessian_of(lambda d: reduced.energy(at(d)), np.full(6, 0.5))
    inverse = np.linalg.inv(reduced.pose0)

    def displacement(d):
        m = inverse @ frame_pose(model, at(d), "platform")
        return m

    dT = gradient_of(displacement, np.full(6, 0.5))
    J_a = np.stack([[m[2, 1], m[0, 2], m[1, 0], *m[:3, 3]] for m in np.moveaxis(dT, -1, 0)], axis=1)
    A = np.linalg.inv(J_a)
    assert relative_error(result.matrices["F"], A.T @ hessian @ A) <= ENERGY


def _two_arms(kinds: tuple[str, str], seed: int):
    """Two arms welded to one body, in one model and as separate arms with the same springs."""
    rng = np.random.default_rng(seed)
    separate = [loaded_arm(k, seed + i) for i, k in enumerate(kinds)]
    model = pin.Model()
    last = add_chain(model, kinds[0], np.random.default_rng(seed), "a")
    grip = random_pose(np.random.default_rng(seed + 100), 0.3)
    tip = separate[0].model.frames[separate[0].model.getFrameId("tip")].placement.homogeneous
    add_frame(model, "body", last, tip)
    # The second arm's base is put where its tip meets the grip on the first arm's body.
    T_1 = frame_pose(separate[0].model, separate[0].q, "tip")
    T_2 = frame_pose(separate[1].model, separate[1].q, "tip")
    root = T_1 @ grip @ np.linalg.inv(T_2)
    other = add_chain(model, kinds[1], np.random.default_rng(seed + 1), "b", root=root)
    tip_2 = separate[1].model.frames[separate[1].model.getFrameId("tip")].placement.homogeneous
    add_frame(model, "grip", last, tip @ grip)
    add_frame(model, "hand", other, tip_2)
    q = np.concatenate([a.q for a in separate])
    k = np.concatenate([a.elastic.springs.stiffness for a in separate])
    rest = np.concatenate([a.elastic.springs.rest for a in separate])
    del rng
    chain = Chain(plain_tree(model), "body", closures=[Closure("grip", "hand", "weld")])
    return model, ElasticMechanism("two arms", chain, q, JointSprings(k, rest)), separate, grip


@pytest.mark.parametrize("kinds", [("RRRRRR", "RRRPRR"), ("RRRRRRR", "RRRRRR")])
def test_two_arms_on_one_body(kinds):
    """Chains that share only the body: loads and matrices of invariant connections add."""
    model, elastic, separate, grip = _two_arms(kinds, 40)
    result = analyse(elastic)
    first = analyse(separate[0].elastic)
    second = analyse(separate[1].elastic)
    at_body = [first.A, second.A.to_frame(np.linalg.inv(grip))]
    W = sum(t.wrench for t in at_body)
    assert relative_error(result.wrench, W) <= EQUIVALENT
    for name, K in matrices_from(sum(t.matrix for t in at_body), W).items():
        assert relative_error(result.tensor(name).matrix, K) <= EQUIVALENT, name
    check(result, reduced_energy(model, elastic, "body", elastic.q, welds=[("grip", "hand")]))


def test_assembled_from_a_nearby_guess():
    rng = np.random.default_rng(7)
    model, elastic = legs_as_tree(general_legs())
    chain = elastic.mechanism
    guess = elastic.q + 0.05 * rng.uniform(-1, 1, elastic.q.size)
    assert np.abs(chain.at(guess).residual).max() > 1e-3
    q = chain.assembled(guess)
    for s in range(1, 6):
        a, b = (frame_pose(model, q, f"{n}{s}")[:3, 3] for n in ("point", "tip"))
        assert absolute_error(a, b) <= ASSEMBLED
    assert absolute_error(q, guess) < 0.3
    arm = loaded_arm("RRR", 1)
    assert np.array_equal(arm.elastic.mechanism.assembled(arm.q), arm.q)


@pytest.mark.parametrize("case", ["points", "welds"])
def test_closure_maps_against_differences(case):
    """Jacobian of the residual, and its second derivative on the motions that keep the closures.

    Off those motions the second derivative depends on how the residual is written down; on them it
    must be that of the residual whose Jacobian is given, multiplier by multiplier.
    """
    rng = np.random.default_rng(12)
    if case == "points":
        elastic = legs_as_tree(general_legs())[1]
    else:
        elastic = _two_arms(("RRRRRR", "RRRPRR"), 40)[1]
    chain, q = elastic.mechanism, elastic.q
    sizes = np.ones(q.size)
    closure = chain.at(q).closure
    residual = gradient_of(lambda d: chain.at(q + d).residual, sizes)
    assert absolute_error(closure.jacobian, residual) <= FIRST_DIFFERENCES
    N = null_space(closure.jacobian)
    dJ = gradient_of(lambda d: chain.at(q + d).closure.jacobian, sizes)
    for _ in range(3):
        lam = rng.normal(size=len(residual))
        second = N.T @ np.einsum("k,kab->ab", lam, dJ) @ N
        assert absolute_error(N.T @ closure.curvature(lam) @ N, second) <= SECOND_DIFFERENCES


def test_reduced_energy_is_least():
    """The minimiser of these tests: any other posture with the same pose stores more energy."""
    arm = loaded_arm("RRRRRRR", 1)
    reduced = reduced_energy(arm.model, arm.elastic, "tip", arm.q)
    x = np.array([0.03, -0.02, 0.01, 0.02, 0.01, -0.03])
    target = reduced.pose0 @ exp_reference(x)
    q, _ = reduced.solve(target)
    assert absolute_error(frame_pose(arm.model, q, "tip"), target) <= ASSEMBLED
    z = np.linalg.svd(body_jacobian(arm.model, q, "tip"))[2][-1]
    for t in (-0.05, 0.05):
        other = q + t * z
        for _ in range(20):  # back to the pose, leaving the self-motion alone
            residual, D = reduced.conditions(other, target)
            other = other - np.linalg.lstsq(D, residual, rcond=None)[0]
        assert reduced.energy(other) > reduced.energy(q)
