"""What the search of a better posture makes less: its slopes, and where it has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from tests.doors import LoadKind
from tests.inner import LoadedPostures
from tests.support.printed import better_of, words_of_better

import cartstiff

DOWN = [0, 0, 0, 0, 0, -1.0]


def test_slopes_are_those_of_the_cost():
    """Exact derivatives of what the search makes less, against its differences."""
    arm, W = cartstiff.load("panda"), np.array([0.1, -0.2, 0.3, 20.0, -10.0, -50.0])
    cost = LoadedPostures.of(arm, arm.q, W, LoadKind("dead", (0.01, 0.0, 0.05)), [0.0, 0.1, 0.02])
    Q = arm.q + np.random.default_rng(0).uniform(-0.05, 0.05, (3, 7))
    for q, exact in zip(Q, cost.slopes(Q), strict=True):
        around = [q + h * e for e in np.eye(7) for h in (2e-3, 1e-3, -1e-3, -2e-3)]
        values = cost(np.array(around)).reshape(7, 4)
        wanted = values @ np.array([-1.0, 8.0, -8.0, 1.0]) / 12e-3
        np.testing.assert_allclose(exact, wanted, rtol=1e-7, atol=1e-9 * np.abs(wanted).max())


def test_difference_quotients_are_said():
    """Compliant links move with the load, so that no displacement follows from q alone."""
    arm = cartstiff.load("examples/flexible_arm.yaml")
    cost = LoadedPostures.of(arm, arm.q, 100 * np.array(DOWN), LoadKind())
    assert np.isnan(cost.slopes(arm.q[None])).all()
    panda = cartstiff.load("panda")
    found = better_of(panda, wrench=50 * np.array(DOWN), load_axes="world")
    assert found.reason == ""
    said = words_of_better(replace(found, reason=cost.why_quotients), panda)
    assert "difference quotients: " in " ".join(said)
