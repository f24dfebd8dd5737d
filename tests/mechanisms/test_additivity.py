"""Energies of bundled machines add up, and their derivatives are loads and stiffnesses."""

from dataclasses import replace

import numpy as np
import pytest
from tests.mechanisms.oracle import GRAVITY
from tests.support import gradient_of, log_reference, relative_error

from cartstiff import JointSprings, PoseFunction, analyse, load

# Eighth-order first differences of an energy along joints, step 0.01.
SLOPE = 1e-9
# Required; rounding of forces that cancel is all there is.
SAME = 1e-10
# The load that is left against the one that was there.
LEFT = 1e-11


@pytest.mark.parametrize("name", ["ur5", "6-ups", "five-bar", "delta", "grasp", "stewart-gough"])
def test_the_gradient_is_the_derivative_of_the_energy(name):
    """Off rest, with gravity: total energy along each coordinate by differences."""
    elastic = replace(analyse(load(name)).elastic, gravity=GRAVITY)
    rng = np.random.default_rng(9)
    mechanism = elastic.mechanism
    # Beams deform little before they buckle, where their force stays: differences over that corner
    # are no derivatives.
    sizes = np.ones(elastic.q.size)
    sizes[sorted(getattr(mechanism, "virtual", ()))] = 1e-3
    q = elastic.q + 0.05 * sizes * rng.uniform(-1, 1, elastic.q.size)
    evaluation = elastic.evaluate(mechanism.at(q))
    n = evaluation.gradient.size

    def energy(d):
        return elastic.evaluate(mechanism.at(mechanism.displaced(q, d))).energy

    assert energy(np.zeros(n)) == pytest.approx(evaluation.energy, rel=1e-12)
    slopes = gradient_of(energy, sizes if sizes.size == n else np.ones(n))
    assert relative_error(evaluation.gradient, slopes) <= SLOPE

    # For a platform the coordinates of derivatives are turned on the way: only K^A's rates differ.
    if not mechanism.at(q).coordinates_are_pose:
        rates = gradient_of(lambda d: elastic.evaluate(mechanism.at(q + d)).gradient, sizes)
        assert relative_error(evaluation.hessian, rates) <= SLOPE


def test_springs_beside_the_springs_of_joints_keep_their_stiffness_with_a_compliance():
    """10 and 3 kN m/rad in parallel are 13, also where the compliances are set anew."""
    beside = JointSprings(np.full(6, 3e3), np.zeros(6))
    elastic = load("fanuc-r2000ic", stiffness=1e4).with_potential(beside)
    own = {name: number.value for name, number in elastic.compliances.items()}
    same = elastic.with_compliances(own)
    hessian = same.evaluate(same.mechanism.at(same.q)).hessian
    np.testing.assert_allclose(hessian, 1.3e4 * np.eye(6), rtol=0, atol=1e-8)
    np.testing.assert_array_equal(same.springs.stiffness, np.full(6, 1e4))


def test_the_load_of_a_five_bar_as_an_energy():
    """With the energy -W . log, two motions keep their stiffness and no load is left."""
    wrench = np.array([4.0, -3.0, 5.0, 30.0, -20.0, 25.0])
    before = analyse(replace(load("five-bar"), gravity=GRAVITY), wrench=wrench)
    back, W = np.linalg.inv(before.pose), before.wrench
    load_energy = PoseFunction(
        energy=lambda T: -float(W @ log_reference(back @ T)),
        wrench=lambda T: -W,
        stiffness=lambda T: np.zeros((6, 6)),
    )
    after = analyse(before.elastic.with_potential(load_energy), before.q)
    # The part of the load that the structure carries is cancelled as well.
    assert np.abs(after.wrench).max() <= LEFT * np.abs(before.wrench).max()
    a, b = (r.reduction.reachable @ r.reduction.reachable_stiffness for r in (before, after))
    assert relative_error(b @ after.reduction.reachable.T, a @ before.reduction.reachable.T) <= SAME
