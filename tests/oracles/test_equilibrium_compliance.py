"""Dead-load compliance against differences of the nonlinear solution, and other solvers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from tests.doors import displacement_between, with_rest_balancing
from tests.support import absolute_error, relative_error, robot_file, slope

import cartstiff
from cartstiff import DeadForce, Held, equilibrium

# Mechanism, base load [its unit of force], and the size of the change for the differences.
CASES = {
    "ur5": ([30.0, -20.0, -80.0], 40.0),
    "panda": ([10.0, 5.0, -20.0], 10.0),
    "five-bar": ([2.0, 3.0, 0.0], 1.0),
    "delta": ([0.3, -0.4, -1.0], 0.2),
    "stewart-gough": ([3.0, -5.0, 12.0], 3.0),
}


def loaded(name: str):
    if name in ("ur5", "panda"):
        robot_file("ur_description/urdf/ur5_robot.urdf")
    elastic = cartstiff.load(name)
    return with_rest_balancing(elastic, elastic.q)


@pytest.mark.parametrize("name", CASES)
def test_dead_load_compliance_is_the_derivative_of_the_solution(name):
    elastic = loaded(name)
    force, size = np.array(CASES[name][0]), CASES[name][1]
    state = equilibrium(elastic, DeadForce(force))
    assert state.stable
    R = state.pose[:3, :3]
    C = state.stiffness.compliances["B"]
    assert C is not None
    expected = np.concatenate([R @ C[:3, 3:], R @ C[3:, 3:]]) @ R.T
    directions = np.eye(3) if name != "five-bar" else np.eye(3)[:2]
    scale = np.array([state.posture.length] * 3 + [1.0] * 3)

    def displaced(direction):
        def at(t):
            load = DeadForce(force + t * direction)
            pose = equilibrium(elastic, state.q, load).pose
            return displacement_between(state.pose, pose)

        return slope(at, 0.05 * size)

    for direction in directions:
        got = displaced(direction) * scale
        wanted = expected @ direction * scale
        assert relative_error(got, wanted) < 1e-7


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_the_same_minimum_as_a_general_optimiser(name):
    elastic = loaded(name)
    load = DeadForce(2 * np.array(CASES[name][0]), [0.0, 0.05, 0.1])
    full = elastic.with_potential(load)
    state = equilibrium(elastic, load)

    def energy(q):
        e, g, _ = full.evaluate(full.mechanism.at(q))
        return e, g

    found = minimize(energy, elastic.q, jac=True, method="BFGS", options={"gtol": 1e-9})
    assert state.energy <= found.fun + 1e-12 * abs(found.fun)
    assert absolute_error(found.x, state.q) < 1e-6


def test_reactions_of_a_held_displacement_are_the_slope_of_the_energy():
    elastic = loaded("ur5")
    reference = elastic.mechanism.at(elastic.q).pose

    def held(t):
        return Held({"z": 0.02 + t, "rx": 0.1}, reference, "world")

    state = equilibrium(elastic, held=held(0.0))

    def energy(t):
        return np.array(equilibrium(elastic, held=held(t), q=state.q).energy)

    assert slope(energy, 2e-3) == pytest.approx(state.reactions.held["z"], rel=1e-8)
