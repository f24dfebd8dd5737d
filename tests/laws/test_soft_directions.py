"""What a stiffness alone does not hold, and inverses of either sign: decided as the engine does."""

from __future__ import annotations

import numpy as np
import pytest

import cartstiff
from cartstiff import analyse_many

COUNT = 40


def near_singular(name: str) -> tuple[cartstiff.ElasticMechanism, np.ndarray]:
    """Postures that come nearer to a singularity, from plainly regular to hardly resolved."""
    elastic = cartstiff.load(name)
    q = np.random.default_rng(5).uniform(-1.2, 1.2, (COUNT, 6))
    near = 10.0 ** -np.linspace(1.0, 6.5, COUNT)
    if name == "ur5":
        q[:, 4] = near  # the wrist is singular at 0
    else:
        q[:] = [*elastic.q[:3], 0.0, 0.0, np.pi / 2]
        q[:, 5] -= near
        q[:, :2] = 0.0
    return elastic, q


@pytest.mark.parametrize("path", ["portable", "compiled"])
@pytest.mark.parametrize(
    ("name", "wrench"),
    [("ur5", None), ("ur5", [1.0, 2.0, -3.0, 20.0, -10.0, 40.0]), ("cubic", None)],
)
def test_a_stiffness_alone_is_called_without_digits_where_the_engine_does(name, wrench, path):
    elastic, q = near_singular(name)
    outputs = ("stiffness_B", "stiffness_A")
    engine = analyse_many(elastic, q, wrench=wrench, outputs=outputs, path="engine")
    fast = analyse_many(elastic, q, wrench=wrench, outputs=outputs, path=path)
    assert [fast.codes[s] for s in fast.state] == [engine.codes[s] for s in engine.state]
    assert {"regular", "ill-conditioned"} <= set(engine.counts())
    assert fast.fallback <= engine.counts()["ill-conditioned"] + COUNT // 5
    for letter in "AB":
        size = np.abs(engine[letter]).max(axis=(1, 2), keepdims=True)
        loss = np.linalg.cond(analyse_many(elastic, q, outputs=["jacobian"])["jacobian"])
        assert np.all(np.abs(fast[letter] - engine[letter]) < 1e-12 * loss[:, None, None] * size)


@pytest.mark.parametrize("path", ["portable", "compiled"])
def test_springs_far_from_rest_leave_inverses_of_either_sign_to_the_tape(path):
    """Preload far above the springs' own stiffness: one Hessian in ten has small pivots."""
    elastic = cartstiff.load("ur5").with_springs(rest=[0.1, -0.4, 0.3, 0.2, 0.5, -0.6])
    q = np.random.default_rng(3).uniform(-2.0, 2.0, (400, 6))
    outputs = ("compliance_B", "compliance_F", "stiffness_B")
    fast = analyse_many(elastic, q, outputs=outputs, path=path)
    assert fast.fallback <= 4
    assert np.count_nonzero(np.linalg.eigvalsh(fast["B"])[:, 0] < 0.0) > 200
    engine = analyse_many(elastic, q, outputs=outputs, path="engine")
    loss = np.linalg.cond(engine["B"]) ** 0.5
    for output in outputs[:2]:
        size = np.abs(engine[output]).max(axis=(1, 2))
        error = np.abs(fast[output] - engine[output]).max(axis=(1, 2)) / size
        assert np.all(error < 1e-12 * loss)


def test_pivots_of_both_signs_do_not_leave_a_plain_posture_to_the_engine():
    """Postures whose factors grow a thousandfold, as they come among 100,000 random ones."""
    elastic = cartstiff.load("ur5").with_springs(rest=[0.1, -0.4, 0.3, 0.2, 0.5, -0.6])
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (10**5, 6))[[49096, 60933, 67039, 73673]]
    outputs = ("stiffness_B",)
    fast, engine = (analyse_many(elastic, q, outputs=outputs, path=p) for p in ("auto", "engine"))
    assert engine.counts() == fast.counts() == {"regular": 4}
    assert fast.fallback == 0
    size = np.abs(engine["B"]).max(axis=(1, 2), keepdims=True)
    assert np.all(np.abs(fast["B"] - engine["B"]) < 1e-10 * size)


@pytest.mark.parametrize("path", ["portable", "compiled"])
def test_an_unsymmetric_compliance_is_answered_where_the_load_makes_it_large(path):
    """K^A of springs far from rest is nearly singular in one of eight postures: C^A is known."""
    elastic = cartstiff.load("fanuc-r2000ic")
    away = np.array([0.02, -0.07, 0.04, 0.09, -0.03, 0.05])
    elastic = elastic.with_springs(rest=elastic.q + away)
    q = elastic.q + np.random.default_rng(4).uniform(-3.0, 3.0, (400, 6))
    fast, engine = (
        analyse_many(elastic, q, outputs=["compliance_A"], path=p) for p in (path, "engine")
    )
    assert fast.counts() == engine.counts() == {"regular": 400}
    C = engine["compliance_A"]
    condition = np.linalg.cond(C)
    assert np.count_nonzero(condition > 1e8) > 40
    assert fast.fallback <= 30
    error = np.abs(fast["compliance_A"] - C).max(axis=(1, 2)) / np.abs(C).max(axis=(1, 2))
    assert np.all(error < 1e-12 * condition)
