"""Searches in vain end after a bounded number of postures, whatever the machine."""

import numpy as np
import pytest
from tests.inner import problem
from tests.laws.test_equilibrium_loads import mechanism
from tests.support import refused

import cartstiff
from cartstiff import (
    ConvergenceError,
    DeadForce,
    DeadWrench,
    FollowerWrench,
    UndefinedError,
    equilibrium,
)


@pytest.mark.parametrize(
    ("name", "count"), [("ur5", 12), ("panda", 9), ("stewart-gough", 12), ("five-bar", 9)]
)
@pytest.mark.usefixtures("_short_searches")
def test_absurd_loads_end_in_an_answer_or_a_refusal(name, count):
    elastic = mechanism(name)
    rng = np.random.default_rng(9)
    answers = 0
    for i in range(count):
        f = 10.0 ** rng.uniform(3, 15) * rng.normal(size=6)
        load = (DeadForce(f[3:]), FollowerWrench(f), DeadWrench(f))[i % 3]
        try:
            state = equilibrium(elastic, load)
        except (ConvergenceError, UndefinedError):
            continue
        answers += 1
        assert state.residual < 1e-9
        assert state.iterations <= 200
    assert answers > 0


@pytest.fixture
def _short_searches(monkeypatch):
    """A tenth of the postures that a search in vain looks at, still more than one that succeeds."""
    monkeypatch.setattr(problem, "_MAX_SEARCH_COST", 15_000)


@pytest.mark.parametrize("scale", [1e120, 1e305])
@pytest.mark.usefixtures("_short_searches")
def test_loads_that_overflow_are_refused(scale):
    refused(
        r"overflow|no equilibrium",
        equilibrium,
        mechanism("stewart-gough"),
        DeadForce(scale * np.ones(3)),
        kind=ConvergenceError,
    )


def test_a_search_in_vain_ends_after_so_many_postures(monkeypatch):
    """Seconds would depend on the machine; the whole of what is tried shares one bound."""
    from tests.doors import System
    from tests.inner import problem as effort

    elastic = cartstiff.load("3-rrr")
    k = np.array([3e3 * 10.0 ** (3.5 * (i % 3)) for i in range(len(elastic.names))])
    elastic, load = elastic.with_springs(k), DeadForce([3e9, -2e9, 0.0])
    seen, at = [0], System.at

    def counted(self, q):
        seen[0] += 1
        return at(self, q)

    monkeypatch.setattr(System, "at", counted)
    monkeypatch.setattr(effort, "_MIN_POSTURES", 0)
    taken = []
    for most in (70 * effort.cost(elastic), 140 * effort.cost(elastic)):
        monkeypatch.setattr(effort, "_MAX_SEARCH_COST", most)
        bound = most // effort.cost(elastic)
        seen[0] = 0
        caught = refused(
            f"given up after {bound} postures", equilibrium, elastic, load, kind=ConvergenceError
        )
        assert seen[0] <= bound + 1  # the last is refused
        assert np.isfinite(caught.residual)
        taken.append(caught.iterations)
    assert 0 < taken[0] < taken[1]
    monkeypatch.setattr(effort, "_MAX_SEARCH_COST", 1)
    refused("given up after 0 postures", equilibrium, elastic, kind=ConvergenceError)
