"""Energies add: so do loads and K^A of springs, legs and fields on one body."""

from dataclasses import replace

import numpy as np
import pytest
from tests.mechanisms.oracle import GRAVITY, Held, displaced
from tests.support import gradient_of, relative_error

from cartstiff import ElasticMechanism, JointSprings, LineSprings, analyse, load
from cartstiff.mechanisms.elements import Elements

# Sums of the same numbers in another order.
SUM = 1e-12
# Through minimisations over passive joints, leg by leg.
LEGS = 1e-9
# Eighth-order first differences of an energy along joints, step 0.01.
SLOPE = 1e-9

POINTS = [[0.1, 0.0, 0.05], [-0.04, 0.08, 0.0], [0.02, -0.1, 0.03]]
ANCHORS = [[0.9, 0.4, 0.2], [-0.5, 0.9, 0.8], [0.1, -0.8, 1.1]]


def _springs(rows):
    return LineSprings(
        anchors=np.array(ANCHORS)[rows],
        points=np.array(POINTS)[rows],
        stiffness=np.array([900.0, 400.0, 1300.0])[rows],
        rest_length=np.array([0.5, 1.4, 0.7])[rows],
    )


@pytest.mark.parametrize("name", ["stewart-gough", "ur5", "6-ups"])
def test_springs_on_the_body_add(name):
    """Line springs added one by one and all at once; on platform, arm and closed chain."""
    base = analyse(replace(load(name)), wrench=np.arange(1.0, 7.0)).elastic
    alone = analyse(base)
    added = [analyse(base.with_potential(_springs([i]))) for i in range(3)]
    together = analyse(base.with_potential(*(_springs([i]) for i in range(3))))
    as_one = analyse(base.with_potential(_springs([0, 1, 2])))
    W = alone.wrench + sum(a.wrench - alone.wrench for a in added)
    assert relative_error(together.wrench, W) <= SUM * 10
    assert relative_error(as_one.wrench, W) <= SUM * 10
    for connection in "ABK":
        K = alone.matrices[connection]
        total = K + sum(a.matrices[connection] - K for a in added)
        assert relative_error(together.matrices[connection], total) <= SUM * 10
        assert relative_error(as_one.matrices[connection], total) <= SUM * 10


def test_loaded_legs_add():
    """3-RRR held away from rest: each leg's springs alone, the others' switched off.

    A leg without springs is carried along for nothing, so that its weight and its beams are the
    only thing that must be taken out: gravity off, beams of one leg at a time.
    """
    elastic, q = displaced(load("3-rrr"), [0.0, 0.0, 0.04, 0.005, -0.004, 0.0], 0.01, seed=8)
    elastic = replace(elastic, gravity=None)
    held = Held(elastic)
    target = elastic.mechanism.at(q).pose
    q, _ = held.solve(target, q)
    whole = analyse(elastic, q)
    W, A = np.zeros(6), np.zeros((6, 6))
    for leg in range(3):
        names = [n.startswith(f"leg{leg + 1}/") for n in elastic.names]
        mine = np.flatnonzero(names)
        k = np.where(names, elastic.springs.stiffness, 0.0)
        beams = tuple(p for p in elastic.potentials if np.isin(p.indices, mine).all())
        assert len(beams) == 2
        # The other legs' coordinates are held where they are by springs that exert nothing there.
        rest = np.where(names, elastic.springs.rest, q)
        alone = ElasticMechanism("leg", elastic.mechanism, q, JointSprings(k, rest), beams, None)
        result = analyse(alone, q)
        assert "idle-self-motion" in [n.code for n in result.notes]
        W += result.wrench
        A += result.matrices["A"]
    assert relative_error(W, whole.wrench) <= LEGS
    assert relative_error(A, whole.matrices["A"]) <= LEGS


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
    elements = Elements(elastic)
    same = elements.with_compliance(elements.compliance)
    hessian = same.evaluate(same.mechanism.at(same.q)).hessian
    np.testing.assert_allclose(hessian, 1.3e4 * np.eye(6), rtol=0, atol=1e-8)
    np.testing.assert_array_equal(same.springs.stiffness, np.full(6, 1e4))
