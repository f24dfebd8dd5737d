"""Struts between flexures in stacks: the engine's postures, with and without a load."""

from __future__ import annotations

import numpy as np
import pytest
from tests.doors import Array, with_rest_balancing
from tests.laws.test_many_engine import assert_same
from tests.support import absolute_error

import cartstiff
from cartstiff import DeadForce, ElasticMechanism, analyse_many
from cartstiff.geometry import se3

WRENCH = np.array([0.1, -0.2, 0.3, 10.0, 20.0, -30.0])
EACH = np.random.default_rng(2).normal(size=(6, 6)) * [0.2, 0.2, 0.2, 20.0, 20.0, 20.0]
MATRICES = (*"ABKF", "compliance_A", "compliance_B", "compliance_F", "pose")


def hexapod() -> ElasticMechanism:
    return cartstiff.load("flexure-hexapod")


def postures(elastic: ElasticMechanism, away: float = 0.003, count: int = 6) -> Array:
    lengths = elastic.mechanism.at(elastic.q).coordinate_lengths
    rng = np.random.default_rng(4)
    return elastic.q + rng.uniform(-away, away, (count, 6)) * lengths


def weighed(elastic: ElasticMechanism) -> ElasticMechanism:
    return elastic.with_gravity([0.0, 0.0, -9.81]).with_payload(3.0, (0.0, 0.01, 0.02))


def pushed(elastic: ElasticMechanism) -> ElasticMechanism:
    return elastic.with_potential(DeadForce([5.0, -3.0, 10.0], [0.01, 0.0, 0.03], "body"))


CASES = {
    "nothing": ([], {}),
    "a load": ([], {"wrench": WRENCH}),
    "a load each": ([], {"wrench": EACH, "load_kind": "follower"}),
    "a load in F": ([], {"wrench": WRENCH, "load_axes": "world", "load_at": (0.0, 0.0, 0.1)}),
    "weight": ([weighed], {}),
    "weight, a force and a load": ([weighed, pushed], {"wrench": WRENCH}),
}


@pytest.mark.parametrize("case", CASES)
def test_as_by_the_engine(case):
    changes, load = CASES[case]
    elastic = hexapod()
    for change in changes:
        elastic = change(elastic)
    q = postures(elastic)
    assert_same(elastic, q, outputs=MATRICES, **load)
    engine, *answers = (
        analyse_many(elastic, q, path=path, outputs=("wrench", "B"), **load)
        for path in ("engine", "portable", "compiled")
    )
    size = max(1.0, float(np.abs(engine["wrench"]).max()))
    for found in answers:
        assert found.fallback == 0
        assert absolute_error(found["wrench"], engine["wrench"]) <= 1e-8 * size


def test_rest_lengths_that_are_given():
    held = with_rest_balancing(hexapod(), hexapod().q, WRENCH)
    assert held.springs.is_complete
    q = postures(held, 0.001)
    (found,) = assert_same(held, q, "portable", outputs=("A", "B", "compliance_B"))
    assert found.fallback == 0


@pytest.mark.parametrize("load", [None, WRENCH])
def test_far_from_where_they_were_made(load):
    """Flexures bent too far: no rest lengths balance them, in both ways; the pose is known."""
    elastic = hexapod()
    q = postures(elastic, 0.12, 12)
    engine, *answers = (
        analyse_many(elastic, q, wrench=load, outputs=("pose", "energy", "B"), path=path)
        for path in ("engine", "portable", "compiled")
    )
    states = [engine.codes[s] for s in engine.state]
    assert {"regular", "unbalanced"} <= set(states)
    for found in answers:
        assert [found.codes[s] for s in found.state] == states
        for name in ("pose", "energy", "B"):
            np.testing.assert_array_equal(np.isnan(engine[name]), np.isnan(found[name]))
        assert not np.isnan(found["pose"]).any()


def test_struts_that_take_a_load_together_come_to_rest_together():
    """Struts that had stood still before the others were left over: 'no rest lengths balance it'.

    Found by its residual: rest lengths that were 1e-12 short, of one posture in 500.
    """
    struts = hexapod().springs
    q = postures(hexapod(), 0.02, 400)
    poses = se3.from_roll_pitch_yaw(q[:, :3], q[:, 3:]) @ hexapod().mechanism.T_P_M
    gradients = np.random.default_rng(1).normal(size=(400, 6)) * [0.1, 0.1, 0.1, 10, 10, 10]
    at = struts.many(poses, gradients, True)
    assert np.asarray(at.is_found).all()
    assert absolute_error(at.wrench.sum(axis=1), gradients) <= 1e-8
