"""Held displacements with their reactions, joint and leg limits as contacts."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from tests.doors import displacement_between, with_rest_balancing
from tests.support import (
    absolute_error,
    general_legs,
    legs_as_platform,
    refused,
    relative_error,
    robot_file,
)

import cartstiff
from cartstiff import ConvergenceError, DeadForce, DeadWrench, Held, InputError, equilibrium
from cartstiff.core.errors import UnknownNameError
from cartstiff.extend import jacobian
from cartstiff.geometry import se3


def ur5():
    robot_file("ur_description/urdf/ur5_robot.urdf")
    elastic = cartstiff.load("ur5")
    return with_rest_balancing(elastic, elastic.q)


def limited(elastic, **bounds):
    """The same mechanism with other joint limits."""
    mechanism = copy.copy(elastic.mechanism)
    mechanism.coordinates = tuple(
        replace(
            c,
            lower=bounds.get(c.name, (c.lower, c.upper))[0],
            upper=bounds.get(c.name, (c.lower, c.upper))[1],
        )
        for c in mechanism.coordinates
    )
    return replace(elastic, mechanism=mechanism)


@pytest.mark.parametrize("axes", ["body", "world"])
@pytest.mark.parametrize("turned", [0.0, 1e-4, 0.7, 0.99, 1.01, 2.8])
def test_derivatives_of_a_held_displacement(axes, turned):
    elastic = ur5()
    rng = np.random.default_rng(6)
    away = se3.exp(np.concatenate([turned * np.array([0.6, 0.0, -0.8]), rng.normal(size=3)]))
    T = elastic.mechanism.at(elastic.q).pose @ away
    held = Held({"rx": 0.1, "rz": 0.2, "x": 0.0, "y": 0.1}, T, axes)
    mu = rng.normal(size=4)

    def at(step):
        return held.constraint(elastic.mechanism.at(elastic.q + step))

    _, to_held, _ = at(np.zeros(6))
    assert relative_error(to_held.jacobian, jacobian(lambda d: at(d)[0], np.ones(6))) < 1e-11
    second = jacobian(lambda d: at(d)[1].jacobian.T @ mu, np.ones(6))
    assert relative_error(to_held.curvature(mu), second) < 1e-11


@pytest.mark.parametrize("axes", ["body", "world"])
def test_the_force_that_holds_does_what_holding_does(axes):
    elastic = ur5()
    held = Held({"x": 0.004, "z": -0.006}, axes=axes)
    state = equilibrium(elastic, held=held)
    moved = displacement_between(state.start.pose, state.pose)[3:]
    R_0 = state.start.pose[:3, :3] if axes == "body" else np.eye(3)
    assert np.allclose((R_0.T @ moved)[[0, 2]], [0.004, -0.006], rtol=0, atol=1e-13)
    assert set(state.reactions.held) == {"x", "z"}
    force = R_0 @ np.array([state.reactions.held["x"], 0.0, state.reactions.held["z"]])
    pushed = equilibrium(elastic, DeadForce(force))
    assert absolute_error(pushed.q, state.q) < 1e-12
    assert relative_error(state.reactions.wrench, state.elastic_stiffness.wrench) < 1e-9
    assert state.stable


@pytest.mark.parametrize("name", ["ur5", "panda", "stewart-gough"])
def test_a_pose_held_wholly(name):
    if name != "stewart-gough":
        ur5()
    elastic = cartstiff.load(name)
    elastic = with_rest_balancing(elastic, elastic.q)
    length = elastic.mechanism.at(elastic.q).length
    twist = np.array([0.02, -0.01, 0.03, 0.01 * length, 0.02 * length, -0.01 * length])
    T = elastic.mechanism.at(elastic.q).pose @ se3.exp(twist)
    state = equilibrium(elastic, held=Held.from_pose(T))
    assert absolute_error(state.pose, T) < 1e-12 * max(1.0, length)
    assert relative_error(state.reactions.wrench, state.elastic_stiffness.wrench) < 1e-9
    # The environment's wrench is what the springs need to be in balance there.
    free = equilibrium(elastic, state.q, DeadWrench(_in_world(state)))
    assert absolute_error(free.q, state.q) < 1e-9


def test_what_holds_a_body_beside_a_leg_much_stiffer_than_others():
    """The legs' forces are those of their lengths, whatever the others can take."""
    legs = cartstiff.load("stewart-simscape")
    k = np.array([1e6, 1.0, 1.2, 0.9, 1.1, 1.3]) * 1e5
    elastic = with_rest_balancing(legs.with_springs(k), legs.q)
    state = equilibrium(elastic, held={"z": 1e-3})
    start, end = (s.lines.lengths for s in (state.start, state.posture))
    pulls = k * (end - start) + elastic.springs.pull_at(state.start.q, state.start.pose)
    W = state.posture.lines.lines.T @ pulls
    assert relative_error(state.elastic_stiffness.wrench, W) < 1e-6
    assert relative_error(state.reactions.wrench, W) < 1e-6


def _in_world(state):
    R = state.pose[:3, :3]
    W = state.reactions.wrench
    return np.concatenate([R @ W[:3], R @ W[3:]])


def test_a_held_closed_chain():
    elastic = cartstiff.load("five-bar")
    state = equilibrium(elastic, DeadForce([1.0, 0.5, 0.0]), held={"x": 0.01})
    assert np.abs(state.posture.residual).max() < 1e-12
    R_0 = state.start.pose[:3, :3]
    assert (R_0.T @ state.displacement[3:])[0] == pytest.approx(0.01, abs=1e-13)
    assert state.residual < 1e-9


def test_a_pose_out_of_reach_is_refused():
    refused(
        "held displacement cannot be met",
        equilibrium,
        ur5(),
        held={"x": 5.0},
        kind=ConvergenceError,
    )


@pytest.mark.parametrize(
    ("values", "options", "error", "match"),
    [
        ({"q": 0.1}, {}, UnknownNameError, "unknown displacement component"),
        ({}, {}, InputError, "nothing is held"),
        ({"x": np.nan}, {}, InputError, "held displacement x must be finite"),
        ({"rx": 3.2}, {}, InputError, "held rotation is too large"),
        ({"x": 0.0}, {"axes": "tool"}, InputError, "unknown axes"),
        ({"x": 0.0}, {"reference": np.ones((4, 4))}, InputError, "not a rigid motion"),
    ],
)
def test_bad_held_displacements(values, options, error, match):
    refused(match, Held, values, **options, kind=error)


# -- limits --------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_a_joint_that_meets_its_stop(side):
    elastic = ur5()
    free = equilibrium(elastic, DeadForce([0.0, 0.0, -300.0]))
    name = "shoulder_lift_joint"
    j = elastic.names.index(name)
    moved = free.q[j] - elastic.q[j]
    stop = elastic.q[j] + 0.4 * moved
    # The load moves the joint one way: the stop is in that way.
    reverse = (moved > 0) != (side == "upper")
    force = np.array([0.0, 0.0, 300.0 if reverse else -300.0])
    if reverse:
        moved = equilibrium(elastic, DeadForce(force)).q[j] - elastic.q[j]
        stop = elastic.q[j] + 0.4 * moved
    bounds = (stop, np.inf) if side == "lower" else (-np.inf, stop)
    state = equilibrium(limited(elastic, **{name: bounds}), DeadForce(force))
    assert state.q[j] == pytest.approx(stop, abs=1e-13)
    reaction = state.reactions.limits[name]
    assert reaction > 0 if side == "lower" else reaction < 0
    assert "limit-contact" in [n.code for n in state.notes]
    assert state.residual < 1e-9
    # The stop's torque is what is missing in the joint's balance; all others balance.
    posture = state.posture
    total = sum(t.evaluate(posture).gradient for t in (*elastic.terms(), *state.loads))
    expected = np.zeros(6)
    expected[j] = reaction
    assert np.allclose(total, expected, rtol=0, atol=1e-9 * abs(reaction))
    # Locked at the stop the end-effector has five freedoms: a compliance, no stiffness.
    assert state.stiffness.matrices["B"] is None
    assert np.linalg.matrix_rank(state.stiffness.compliances["B"], tol=1e-12) == 5


def test_a_stop_that_is_left_again():
    elastic = limited(ur5(), elbow_joint=(1.0, 1.41))
    q = elastic.q.copy()
    q[2] = 1.6  # beyond the stop: put back onto it, and then released
    state = equilibrium(elastic, q, DeadForce([0.0, 0.0, 50.0]))
    assert state.reactions.limits == {}
    assert 1.0 < state.q[2] < 1.41
    free = equilibrium(ur5(), DeadForce([0.0, 0.0, 50.0]))
    assert absolute_error(state.q, free.q) < 1e-11
    assert free.reactions.closures.size == 0


def test_many_loads_against_narrow_limits():
    elastic = ur5()
    bounds = {n: (a - 0.004, a + 0.003) for n, a in zip(elastic.names, elastic.q, strict=True)}
    narrow = limited(elastic, **bounds)
    rng = np.random.default_rng(12)
    touched = 0
    for _ in range(60):
        load = DeadForce(400 * rng.normal(size=3), 0.1 * rng.normal(size=3))
        state = equilibrium(narrow, load)
        assert np.all(state.q >= elastic.q - 0.004 - 1e-12)
        assert np.all(state.q <= elastic.q + 0.003 + 1e-12)
        for name, force in state.reactions.limits.items():
            j = elastic.names.index(name)
            at_upper = state.q[j] > elastic.q[j]
            assert force < 1e-9 if at_upper else force > -1e-9
        touched += len(state.reactions.limits)
        free = equilibrium(narrow, load, limits=False)
        assert free.energy <= state.energy + 1e-12
        assert free.reactions.limits == {}
    assert touched > 50


def test_leg_limits_of_a_platform():
    legs = general_legs()
    free = legs_as_platform(legs)
    load = DeadForce([0.0, 0.0, -150.0])
    lengths = free.mechanism.leg_lengths(equilibrium(free, load).q)
    unloaded = free.mechanism.leg_lengths(equilibrium(free).q)
    bounds = [(0.5 * (a + b), 5.0) for a, b in zip(lengths, unloaded, strict=True)]
    elastic = legs_as_platform(legs, limits=bounds)
    state = equilibrium(elastic, load)
    got = elastic.mechanism.leg_lengths(state.q)
    assert np.all(got >= np.array([b[0] for b in bounds]) - 1e-12)
    assert len(state.reactions.limits) >= 1
    assert all(force > 0 for force in state.reactions.limits.values())
    assert state.residual < 1e-9
    # Legs' stops, springs and load balance on the body.
    posture = state.posture
    total = sum(t.evaluate(posture).gradient for t in (*elastic.terms(), load))
    for name, force in state.reactions.limits.items():
        total = total - force * posture.lines.lines[int(name[3:]) - 1]
    assert np.abs(total).max() < 1e-9 * 150.0
