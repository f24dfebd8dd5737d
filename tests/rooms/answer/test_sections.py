"""Numbers of an analysis by their paths, their units, and eigenvalues by a metric."""

from __future__ import annotations

import json

import numpy as np
from hypothesis import given
from tests.doors import PostureMatrices, Reading, inertia_metric, move_stiffness, summarise
from tests.inner import modes, numbers, percent, unit_of
from tests.laws.test_analysis_invariance import CLOSE, pair
from tests.laws.test_analysis_posture import arm
from tests.laws.test_table_of_quantities import SINGLE, PathOfAnalysis
from tests.support import seeds

from cartstiff import analyse_posture
from cartstiff.extend import QUANTITIES


def test_numbers_are_finite_floats_with_stable_names() -> None:
    found = numbers(analyse_posture(arm(6)))
    assert found["stiffness"].shape == (6, 6)
    assert found["ellipsoids.stiffness.translation.free.eigenvalues"].shape == (3,)
    assert found["eigenscrews.screws.pitch"].shape == (6,)
    assert found["eigenscrews.screws.direction"].shape == (6, 3)
    assert found["wrench_compliant_axes.point"].shape == (3, 3)


def test_axes_keep_their_sides() -> None:
    """An axis and its opposite are one: numbers follow the sides of the analysis given."""
    analysis = analyse_posture(arm(6))
    flipped = json.loads(json.dumps(analysis))
    for screw in flipped["eigenscrews"]["screws"]:
        screw["direction"] = [-x for x in screw["direction"]]
    axes = flipped["ellipsoids"]["stiffness"]["translation"]["held"]["axes"]
    flipped["ellipsoids"]["stiffness"]["translation"]["held"]["axes"] = [
        [-x for x in row] for row in axes
    ]
    plain_numbers, turned_back = numbers(analysis), numbers(flipped, analysis)
    for name in ("eigenscrews.screws.direction", "ellipsoids.stiffness.translation.held.axes"):
        assert np.array_equal(numbers(flipped)[name], -plain_numbers[name])
        assert np.array_equal(turned_back[name], plain_numbers[name])


@given(seeds)
def test_modes_are_frame_independent_when_the_metric_moves_along(seed: int) -> None:
    rng, K, T, moved = pair(seed)
    A = rng.standard_normal((3, 3))
    M = inertia_metric(2.0, 0.02 * (A @ A.T + np.eye(3)), 0.1 * rng.standard_normal(3))
    here, there = modes(K, M, "inertia"), modes(moved, move_stiffness(M, T))
    assert np.allclose(here.eigenvalues, there.eigenvalues, rtol=1e-7)
    V = here.twists
    assert np.allclose(V.T @ M @ V, np.eye(6), atol=CLOSE)
    assert np.allclose(K @ V, M @ V * here.eigenvalues, atol=1e-6)
    assert here.metric == "inertia"


def test_modes_are_the_natural_frequencies_of_a_body_on_springs() -> None:
    K = np.diag([3.0, 4.0, 5.0, 60.0, 80.0, 100.0])
    found = modes(K, inertia_metric(2.0, np.diag([0.1, 0.2, 0.25])))
    assert np.allclose(found.eigenvalues, [20, 20, 30, 30, 40, 50])


def test_units_are_those_of_the_table_of_quantities() -> None:
    for name, way in SINGLE.items():
        if isinstance(way, PathOfAnalysis):
            assert unit_of(way.path) == QUANTITIES[name].unit, name


def test_a_share_that_does_not_exist_is_a_dash() -> None:
    assert percent(float("inf")) == percent(float("nan")) == "-"


def test_units_of_an_analysis_follow_from_its_form():
    """In a unit of length that is a times longer, numbers are smaller by the powers of a."""
    K = np.diag([3.0, 2.0, 4.0, 50.0, 60.0, 70.0])
    K[0, 4] = K[4, 0] = 2.0
    a = 10.0
    S = np.diag([1.0, 1.0, 1.0, a, a, a])
    here = numbers(summarise(PostureMatrices({"B": K}, np.zeros(6)), Reading(0.2)))
    del here["indices.best_length"]  # the condition number is as small over a range of lengths
    there = numbers(summarise(PostureMatrices({"B": S @ K @ S / a}, np.zeros(6)), Reading(0.2 / a)))
    powers = {
        "1": 0,
        "{length}": 1,
        "{force}": 0,
        "{force}/{length}": -1,
        "{force}/rad": 0,
        "{force} {length}/rad": 1,
        "{length}/rad": 1,
        "{force}^6/rad^3": 0,
        "{length}/{force}": 1,
        "rad/({force} {length})": -1,
        "rad/{force}": 0,
        "{length}/({force} {length})": 0,
    }
    seen = set()
    for name, values in here.items():
        for place in np.ndindex(values.shape):
            unit = unit_of(".".join([name, *map(str, place)]))
            if unit == "mixed" or name.endswith(("axes", "direction")):
                continue
            seen.add(unit)
            expected = values[place] / a ** powers[unit]
            assert np.isclose(there[name][place], expected, rtol=1e-6, atol=1e-9), (name, unit)
    assert len(seen) > 8
