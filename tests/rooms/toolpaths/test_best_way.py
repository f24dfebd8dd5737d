"""Dynamic programming against trying every way; slopes of what a better posture makes less."""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.doors import LoadKind
from tests.inner import LoadedPostures, Steps, best_way
from tests.support import seeds
from tests.support.builders import paper_geometry, platform_mechanism
from tests.support.printed import better_of, words_of_better

import cartstiff
from cartstiff.core.errors import UnknownNameError

DOWN = [0, 0, 0, 0, 0, -1.0]


@given(seeds, st.sampled_from(["worst", "mean"]), st.booleans())
def test_no_way_is_better(seed, objective, sided):
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 5, size=rng.integers(1, 5))
    q = [rng.uniform(-3, 3, (n, 2)) for n in sizes]
    costs = [np.where(rng.random(n) < 0.15, np.inf, rng.uniform(0.1, 2, n)) for n in sizes]
    sides = [rng.choice([-1.0, 1.0], n) for n in sizes] if sided else None
    bounds, price, periodic = np.array([2.0, 2.5]), 0.3, np.array([True, False])
    way, reached = best_way(costs, Steps(q, periodic, bounds, price, sides), objective)

    def judged(choice):
        total = [costs[i][k] for i, k in enumerate(choice)]
        extra = 0.0
        for i, (a, b) in enumerate(pairwise(choice)):
            step = q[i + 1][b] - q[i][a]
            step[0] = (step[0] + np.pi) % (2 * np.pi) - np.pi
            if np.any(np.abs(step) > bounds) or (sided and sides[i][a] != sides[i + 1][b]):
                return np.inf, np.inf
            extra += price * np.mean((step / bounds) ** 2)
        return max(total), sum(total) + extra

    every = {choice: judged(choice) for choice in product(*map(range, sizes))}
    if way is None:
        assert all(np.isinf(total) for _, total in every.values())
        assert len(reached) <= len(sizes)
        return
    worst, total = every[tuple(way)]
    possible = {c: v for c, v in every.items() if np.isfinite(v[1])}
    if objective == "worst":
        least = min(v[0] for v in possible.values())
        assert worst == pytest.approx(least, rel=1e-9)
        possible = {c: v for c, v in possible.items() if v[0] <= least * (1 + 1e-9)}
    assert total == pytest.approx(min(v[1] for v in possible.values()), rel=1e-9)


def test_where_it_breaks():
    q = [np.zeros((1, 1)), np.array([[0.5], [9.0]]), np.array([[9.5]])]
    costs = [np.ones(1), np.ones(2), np.ones(1)]
    steps = Steps(q, np.array([False]), np.array([1.0]))
    way, reached = best_way(costs, steps)
    assert way is None
    assert [r.tolist() for r in reached] == [[0], [0], []]


def test_unknown_objective():
    with pytest.raises(UnknownNameError, match="unknown objective"):
        best_way([np.ones(1)], Steps([np.zeros((1, 1))], np.zeros(1, bool), np.ones(1)), "best")


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


def test_a_body_on_fewer_than_six_lines_is_near_a_singularity_everywhere():
    base, points, k, rest = (x[:4] for x in paper_geometry())
    held = platform_mechanism(0.01 * base, 0.01 * points, k, 0.01 * rest)
    path = cartstiff.ToolPath(held.mechanism.at(held.q).pose[None])
    found = cartstiff.optimise_path(held, path, criterion="translation_held_max", singular=0.0)
    K = cartstiff.analyse(held).matrices["B"]
    assert found.values[0] == pytest.approx(np.linalg.eigvalsh(K[3:, 3:])[-1], rel=1e-9)
    assert found.ratios.tolist() == [0.0]
    with pytest.raises(cartstiff.UndefinedError, match="only near singularities"):
        cartstiff.optimise_path(held, path, criterion="translation_held_max")
