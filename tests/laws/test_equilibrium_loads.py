"""Laws of equilibria: convergence, loads of every kind, verdicts, agreement of connections."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import Scaled, with_rest_balancing
from tests.support import (
    absolute_error,
    links,
    refused,
    relative_error,
    robot_file,
)

import cartstiff
from cartstiff import (
    ConvergenceError,
    DeadForce,
    DeadWrench,
    FollowerWrench,
    equilibrium,
    payload,
)
from cartstiff.extend import jacobian
from cartstiff.geometry import se3

ROBOTS = ("ur5", "panda")


def mechanism(name: str):
    if name in ROBOTS:
        robot_file("ur_description/urdf/ur5_robot.urdf")
    elastic = cartstiff.load(name)
    return with_rest_balancing(elastic, elastic.q)


def unloaded_platform():
    """The paper's platform with legs that carry nothing at its pose."""
    elastic = cartstiff.load("stewart-gough")
    return with_rest_balancing(elastic, elastic.q, np.zeros(6))


def unbalanced(elastic, loads, q) -> float:
    """Largest generalised force left, over the largest of any one term, closures projected out."""
    posture = elastic.mechanism.at(q)
    columns = posture.coordinate_lengths
    gradients = [t.evaluate(posture).gradient * columns for t in (*elastic.terms(), *loads)]
    total = sum(gradients)
    if posture.closure is not None:
        C = posture.closure.jacobian * columns
        total = total + C.T @ np.linalg.lstsq(C.T, -total, rcond=1e-10)[0]
    return float(np.abs(total).max() / max(np.abs(g).max() for g in gradients))


@pytest.mark.parametrize(("name", "size"), [("ur5", 300.0), ("panda", 60.0), ("platform", 0.3)])
def test_loads_within_the_elastic_range(name, size):
    elastic = unloaded_platform() if name == "platform" else mechanism(name)
    rng = np.random.default_rng(7)
    length = elastic.mechanism.at(elastic.q).length
    for _ in range(60):
        load = DeadForce(size * rng.normal(size=3), 0.2 * length * rng.normal(size=3))
        state = equilibrium(elastic, load)
        assert state.residual < 1e-9
        assert state.stable is True
        assert unbalanced(elastic, [load], state.q) < 1e-9


def test_loads_under_which_the_preloaded_platform_snaps():
    elastic = mechanism("stewart-gough")
    rng = np.random.default_rng(7)
    for _ in range(40):
        load = DeadForce(30 * rng.normal(size=3), 4 * rng.normal(size=3))
        state = equilibrium(elastic, load)
        assert state.stable is True
        assert unbalanced(elastic, [load], state.q) < 1e-9


def test_follower_loads_within_the_elastic_range():
    elastic = mechanism("ur5")
    rng = np.random.default_rng(8)
    for _ in range(40):
        wrench = np.concatenate([10 * rng.normal(size=3), 100 * rng.normal(size=3)])
        state = equilibrium(elastic, FollowerWrench(wrench))
        assert state.residual < 1e-9
        assert state.stable is None
        assert "non-conservative" in [n.code for n in state.notes]
        assert relative_error(state.elastic_stiffness.wrench, wrench) < 1e-9


def test_loads_that_must_be_put_on_in_stages():
    elastic = mechanism("panda")
    rng = np.random.default_rng(5)
    staged = 0
    for _ in range(12):
        wrench = 8000.0 * rng.normal(size=6) * [0.1, 0.1, 0.1, 1.0, 1.0, 1.0]
        try:
            state = equilibrium(elastic, DeadWrench(wrench))
        except ConvergenceError:
            continue
        assert unbalanced(elastic, [DeadWrench(wrench)], state.q) < 1e-9 or state.reactions.limits
        staged += "load-stages" in [n.code for n in state.notes]
    assert staged > 0


@pytest.mark.parametrize(
    ("name", "wrench", "stiffness", "words"),
    [
        ("ur5", [0, 0, 0, 0, 0, -1e9], None, "the load may be beyond"),
        ("delta", [1e4, 0, 0, 0, 2e3, 0], None, "the load may be beyond"),
        ("ur5", [0, 0, 5, 0, 0, 0], {"wrist_3_joint": 0.0}, "nothing holds 'wrist_3_joint'"),
    ],
)
def test_a_search_that_fails_blames_the_load_or_the_joint_that_nothing_holds(
    name, wrench, stiffness, words
):
    elastic = cartstiff.load(name, **({} if stiffness is None else {"stiffness": stiffness}))
    refused(words, equilibrium, elastic, wrench=wrench, kind=ConvergenceError)


KINDS = (
    "force",
    "wrench",
    "moment",
    "follower",
    "payload",
    "scaled",
    "elbow",
    "elbow-follower",
)


def elbow(name: str) -> str:
    """A frame on the way to the body, where the mechanism has one."""
    return "forearm_link" if name == "ur5" else "body"


@pytest.mark.parametrize("name", ["ur5", "stewart-gough", "five-bar"])
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_loads(name, kind):
    elastic = mechanism(name)
    rng = np.random.default_rng(3)
    load = {
        "force": DeadForce(rng.normal(size=3), rng.normal(size=3)),
        "wrench": DeadWrench(rng.normal(size=6)),
        "moment": DeadWrench([*rng.normal(size=3), 0.0, 0.0, 0.0]),
        "follower": FollowerWrench(rng.normal(size=6)),
        "payload": payload(2.0, [0.0, 0.0, -9.81], [0.1, 0.2, 0.3]),
        "scaled": Scaled(DeadForce(rng.normal(size=3)), -2.5),
        "elbow": DeadForce(rng.normal(size=3), rng.normal(size=3), elbow(name)),
        "elbow-follower": FollowerWrench(rng.normal(size=6), elbow(name)),
    }[kind]
    at = elastic.mechanism.at(elastic.q)
    here = load.evaluate(at)
    free = at.coordinates_are_pose

    def gradient(step):
        g = load.evaluate(
            elastic.mechanism.at(elastic.mechanism.displaced(elastic.q, step))
        ).gradient
        return se3.right_jacobian(step).T @ g if free else g

    def energy(step):
        return load.evaluate(
            elastic.mechanism.at(elastic.mechanism.displaced(elastic.q, step))
        ).energy

    sizes = 0.1 * at.coordinate_lengths
    assert relative_error(here.hessian, jacobian(gradient, sizes)) < 1e-10
    is_planar = name == "five-bar"  # where a dead moment has the potential of an angle
    if "follower" in kind or (kind in ("wrench", "moment") and not is_planar):
        assert np.isnan(here.energy)
        assert absolute_error(here.hessian, here.hessian.T) > 1e-3 or is_planar
    else:
        assert relative_error(here.gradient, jacobian(energy, sizes)) < 1e-10
        assert relative_error(here.hessian.T, here.hessian) <= 1e-12


def test_a_dead_wrench_without_moment_is_a_dead_force():
    elastic = mechanism("ur5")
    force = np.array([40.0, -30.0, 20.0])
    one = equilibrium(elastic, DeadForce(force))
    two = equilibrium(elastic, DeadWrench([0.0, 0.0, 0.0, *force]))
    assert np.array_equal(one.q, two.q)
    assert two.is_conservative


@pytest.mark.parametrize("name", ["ur5", "stewart-gough"])
def test_under_dead_loads_no_wrench_is_left_and_connections_agree(name):
    elastic = mechanism(name)
    state = equilibrium(elastic, DeadForce([5.0, -7.0, 9.0], [0.0, 0.1, 0.05]))
    matrices = state.stiffness.matrices
    size = np.abs(state.elastic_stiffness.wrench).max()
    assert np.abs(state.stiffness.wrench).max() < 1e-9 * size
    for connection in "AKF":
        assert relative_error(matrices[connection], matrices["B"]) < 1e-10
    # The springs alone carry the load, and there connections differ.
    own = state.elastic_stiffness
    assert relative_error(own.matrices["A"], matrices["B"]) > 1e-7
    R = state.pose[:3, :3]
    assert np.allclose(R @ own.wrench[3:], [5.0, -7.0, 9.0], rtol=1e-9)


def test_under_a_follower_wrench_the_tangent_is_that_of_the_moving_frame():
    elastic = mechanism("ur5")
    wrench = np.array([3.0, -5.0, 2.0, 60.0, -30.0, 45.0])
    state = equilibrium(elastic, FollowerWrench(wrench))
    J = state.posture.motion.jacobian
    tangent = elastic.with_potential(FollowerWrench(wrench)).evaluate(state.posture).hessian
    A = np.linalg.inv(J)
    K_A = state.elastic_stiffness.matrices["A"]
    assert relative_error(A.T @ tangent @ A, K_A) < 1e-11
    # A load constant in the body adds nothing to K^A.
    assert relative_error(state.stiffness.matrices["A"], K_A) < 1e-11
    # Squares of angular frequencies, with Pinocchio's own reading of the masses.
    model = pin.buildModelFromUrdf(str(robot_file("ur_description/urdf/ur5_robot.urdf")))
    half = np.triu(pin.crba(model, model.createData(), state.q))
    mass = half + np.triu(half, 1).T
    expected = np.sort(np.linalg.eigvals(np.linalg.solve(mass, tangent)).real)
    assert state.eigenvalues == pytest.approx(expected, rel=1e-8)


def test_vibrations_under_a_follower_wrench_by_inverse_dynamics():
    elastic = mechanism("panda")
    load = FollowerWrench([3.0, -5.0, 2.0, 20.0, -10.0, 15.0])
    state = equilibrium(elastic, load)
    model, none = elastic.mechanism.tree.model, np.zeros(7)
    data = model.createData()
    torques = [pin.rnea(model, data, state.q, none, a) for a in np.eye(7)]
    mass = np.column_stack(torques) - pin.rnea(model, data, state.q, none, none)[:, None]
    tangent = state.elastic.with_potential(load).evaluate(state.posture).hessian
    expected = np.sort_complex(np.linalg.eigvals(np.linalg.solve(mass, tangent)))
    assert np.sort_complex(state.eigenvalues) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("name", ["five-bar", "delta"])
def test_closures_are_kept(name):
    elastic = mechanism(name)
    rng = np.random.default_rng(4)
    for _ in range(4):
        load = DeadForce(rng.normal(size=3) * [1.0, 1.0, 1.0])
        state = equilibrium(elastic, load)
        assert np.abs(state.posture.residual).max() < 1e-12
        assert unbalanced(elastic, [load], state.q) < 1e-9
        assert state.reactions.closures.size == state.posture.residual.size


def test_a_large_motion_beside_stiff_legs():
    """A whole step that is refused is followed before it is shortened: half steps alone creep."""
    stiffness = [1800.0, 34.0, 2.9e7, 0.53, 31.0, 4.1e5]
    elastic = cartstiff.load("hexapod").with_springs(
        {f"leg{i}": k for i, k in enumerate(stiffness, 1)}
    )
    load = DeadForce([-0.64, -0.11, -0.48])
    state = equilibrium(elastic, load, limits=False)
    assert state.stable is True
    assert unbalanced(state.elastic, [load], state.q) < 1e-8


def test_springs_without_rest_position_carry_gravity_first():
    robot_file("ur_description/urdf/ur5_robot.urdf")
    elastic = replace(cartstiff.load("ur5"), gravity=np.array([0.0, 0.0, -9.81]))
    state = equilibrium(elastic)
    assert absolute_error(state.q, elastic.q) < 1e-12
    heavy = equilibrium(elastic, payload(5.0, elastic.gravity, [0.0, 0.0, 0.1]))
    assert heavy.displacement[5] < -1e-4
    assert heavy.stable


def test_result_is_plain_data():
    state = equilibrium(mechanism("ur5"), FollowerWrench([0.0, 0.0, 2.0, 10.0, 0.0, 0.0]))
    data = json.loads(json.dumps(state.to_dict(), allow_nan=False))
    assert data["stable"] is None
    assert data["energy"] is None
    assert data["iterations"] == state.iterations
    assert len(data["history"]) == state.iterations + 1
    assert data["residual"] < 1e-9
    with pytest.raises(ValueError, match="read-only"):
        state.q[0] = 0.0


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: DeadForce([1.0, 2.0]), "force has the wrong count; expected 3 numbers"),
        (lambda: DeadForce([1.0, 2.0, np.nan]), "force must be finite"),
        (lambda: DeadForce("down"), "force is not numeric"),
        (lambda: DeadForce([1, 2, 3], [0.0]), "point of application"),
        (lambda: DeadWrench(np.ones(3)), "wrench has the wrong count; expected 6"),
        (lambda: FollowerWrench([np.inf] * 6), "wrench must be finite"),
        (lambda: payload(-1.0, [0, 0, -9.81]), "payload mass"),
        (lambda: payload(1.0, [0, -9.81]), "acceleration has the wrong count"),
        (lambda: equilibrium(mechanism("ur5"), q=[0.0]), "q has the wrong count"),
        (lambda: equilibrium(mechanism("ur5"), None, np.ones(6)), "a load is not a potential"),
        (lambda: equilibrium(mechanism("ur5"), iterations=0), "bound on the steps"),
    ],
)
def test_bad_input_is_refused(call, match):
    refused(match, call)


def test_an_equilibrium_that_gradual_loads_reach_is_not_called_another_one():
    """Far from the first step's prediction, where the way there is looked at."""
    looked_at = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        elastic = links(rng.uniform(1.5, 6.0, 3), length=0.7)
        force = np.array([*rng.normal(size=2), 0.0])
        state = equilibrium(elastic, DeadForce(5.0 * force / np.linalg.norm(force)))
        curve = cartstiff.load_curve(elastic, elastic.q, *state.loads)
        assert curve.q[-1] == pytest.approx(state.q, abs=1e-7)
        assert "other-equilibrium" not in [note.code for note in state.notes]
        looked_at += "notes" in vars(state) and state.stable
    assert looked_at == 12
