"""Tolerances carried through a mechanism, against closed forms and random draws."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.doors import Parameters, Uncertain, shares_of
from tests.support import loaded_arm
from tests.support.printed import text_of

import cartstiff
from cartstiff import ElasticMechanism, JointSprings, PostureStiffness, analyse_posture
from cartstiff.analysis import Tolerances

HELD = "ellipsoids.stiffness.translation.held.eigenvalues"


def uncertain(result: PostureStiffness, tolerances: Tolerances, progress: Any = None) -> dict:
    return analyse_posture(result, tolerances=tolerances, progress=progress)["uncertainty"]


def test_entries_of_the_matrix_follow_each_spring() -> None:
    """K = sum k_i g_i g_i^T: the variance of an entry is the sum of (sigma_i g g^T)^2."""
    seen: list[tuple[int, int]] = []
    result = cartstiff.analyse(cartstiff.load("cubic"))
    found = uncertain(result, Tolerances(0.05), lambda *told: seen.append(told))
    assert seen == [(done, 6) for done in range(1, 7)]
    lines = result.posture.lines.lines
    parts = np.array([np.outer(g, g) for g in lines]) * 1e6
    expected = 0.05 * np.sqrt((parts**2).sum(axis=0))
    for i in range(6):
        for j in range(6):
            entry = found["numbers"][f"stiffness[{i}, {j}]"]
            assert entry["deviation"] == pytest.approx(expected[i, j], rel=1e-9, abs=1e-4)
    assert list(found["parameters"]) == [f"stiffness.leg{i}" for i in range(1, 7)]


def test_one_common_factor_scales_everything() -> None:
    """K is proportional to k when all springs change together: the same relative deviation."""
    result = cartstiff.analyse(cartstiff.load("cubic"))
    parameters = Parameters(result)
    springs = Uncertain.of(parameters, Tolerances(0.03))
    together = springs._replace(correlation=np.ones((6, 6)))
    slopes = [
        parameters.quotient(name, lambda r: [r.B.matrix], [result.B.matrix]).slopes[0]
        for name in springs.names
    ]
    deviations, _ = shares_of(together.variances(np.array(slopes)))
    # Entries that are zero by symmetry keep the rounding of the others.
    assert np.allclose(deviations, 0.03 * np.abs(result.B.matrix), rtol=1e-9, atol=1e-6)


def planar(lengths: tuple[float, float]) -> ElasticMechanism:
    """A 2R arm in the xy plane."""
    import pinocchio as pin
    from tests.doors import Chain, plain_tree
    from tests.support import add_frame, translation

    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "shoulder")
    second = model.addJoint(
        first, pin.JointModelRZ(), pin.SE3(translation(lengths[0], 0, 0)), "elbow"
    )
    add_frame(model, "tip", second, translation(lengths[1], 0, 0))
    springs = JointSprings(np.array([100.0, 80.0]), np.full(2, np.nan))
    chain = Chain(plain_tree(model), "tip")
    return ElasticMechanism("2R", chain, np.array([0.5, 1.0]), springs)


def test_link_lengths_of_a_planar_arm() -> None:
    """Stretched sideways: C_yy = (l1 + l2)^2 / k1 + l2^2 / k2 at q = 0."""
    elastic = replace(planar((0.5, 0.4)), q=np.zeros(2))
    result = cartstiff.analyse(elastic)
    sigma = 1e-3
    entry = uncertain(result, Tolerances(length=sigma))["numbers"]["compliance[4, 4]"]
    assert entry["nominal"] == pytest.approx(0.9**2 / 100 + 0.4**2 / 80)
    by_l1, by_l2 = 2 * 0.9 / 100, 2 * 0.9 / 100 + 2 * 0.4 / 80
    assert entry["deviation"] == pytest.approx(sigma * np.hypot(by_l1, by_l2), rel=1e-8)
    assert entry["main_parameter"] == "frame.x"


def test_stiffness_of_an_arm_under_load() -> None:
    """The load is kept: K^B = J^-T (k - S_W) J^-1 is linear in the springs with S_W fixed."""
    built = loaded_arm("RRRRRR", 5)
    result = cartstiff.analyse(built.elastic)
    J_inverse = np.linalg.inv(result.jacobian)
    k = result.elastic.springs.stiffness
    parts = np.array([ki * np.outer(row, row) for ki, row in zip(k, J_inverse, strict=True)])
    expected = 0.04 * np.sqrt((parts**2).sum(axis=0))
    numbers = uncertain(result, Tolerances(0.04))["numbers"]
    got = [[numbers[f"stiffness[{i}, {j}]"]["deviation"] for j in range(6)] for i in range(6)]
    assert np.allclose(got, expected, rtol=1e-7)


def test_text_of_the_uncertainty() -> None:
    result = cartstiff.analyse(cartstiff.load("cubic"))
    found = analyse_posture(result, tolerances=Tolerances(0.05, 1e-3))
    short, full = text_of(result, analysis=found, level="short"), text_of(found)
    assert "Uncertainty from stiffness 5 %, lengths 1 mm" in short
    assert "principal values meet here" in short
    assert "modes.eigenvalues[0]" in full
    assert "modes.eigenvalues[0]" not in short


def test_links_that_must_bend_are_assembled_in_few_steps(monkeypatch):
    """What is kept while a loop is closed is let go as soon as the gap gets no smaller."""
    elastic = cartstiff.load("3-rrr")
    chain = elastic.mechanism
    placements = dict(enumerate(chain.tree.placements(), 1))
    placements[3] = placements[3].copy()
    placements[3][2, 3] += 1e-3  # out of the plane in which the others move
    moved = chain.with_placements(placements, chain.body.T_j_f)
    steps, at = [0], type(moved).at
    monkeypatch.setattr(type(moved), "at", lambda *a: steps.__setitem__(0, steps[0] + 1) or at(*a))
    posture = moved.closed(elastic.q)
    assert np.abs(posture.residual).max() < 1e-12
    assert steps[0] < 30
