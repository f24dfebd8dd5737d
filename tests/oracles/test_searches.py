"""A place where a function changes its sign, beside SciPy's search by Brent's method."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.doors import least_change, numerics, zero_between

CASES = {
    "cubic": (lambda x: x**3 - 2 * x - 5, 2.0, 3.0),
    "cosine": (lambda x: math.cos(x) - x, 0.0, 1.0),
    "steep": (lambda x: math.exp(-50 * x) - 1e-3, 0.0, 1.0),
    "flat": (lambda x: (x - 0.3) ** 9, 0.0, 1.0),
    "tiny": (lambda x: 1e-9 * (x - 0.7), 0.0, 1.0),
    "jump": (lambda x: -1.0 if x < 0.123 else 2.0, 0.0, 1.0),
    "at an end": (lambda x: x, 0.0, 1.0),
}


@pytest.mark.parametrize("name", CASES)
def test_a_zero_is_that_of_brents_method(name):
    function, start, end = CASES[name]
    seen = []

    def counted(x):
        seen.append(x)
        return function(x)

    found = zero_between(counted, start, end, 1e-10, 100)
    assert found == pytest.approx(brentq(function, start, end, xtol=1e-12, maxiter=500), abs=2e-10)
    assert min(seen) >= start
    assert max(seen) <= end
    assert len(seen) <= 60


@pytest.mark.parametrize("name", ["cubic", "cosine"])
def test_smooth_functions_are_interpolated(name):
    """Halves alone would take 34 evaluations to an interval of 1e-10."""
    function, start, end = CASES[name]
    seen = []
    zero_between(lambda x: seen.append(x) or function(x), start, end, 1e-10, 100)
    assert len(seen) <= 10


def test_the_bound_on_evaluations_is_kept():
    """The best place so far is returned."""
    seen = []

    def counted(x):
        seen.append(x)
        return x - 1 / math.pi

    found = zero_between(counted, 0.0, 1.0, 0.0, 6)
    assert len(seen) <= 6
    assert found == min(seen, key=lambda x: abs(x - 1 / math.pi))


def test_a_search_without_progress_ends_after_so_many_whole_steps():
    """The residual stays 1 whatever the step; the first point is the best."""
    found = least_change(
        5.0,
        lambda _: (np.ones(1), np.ones((1, 1))),
        lambda x, step: x + step[0],
        evaluations=50,
        longest_step=2.0,
    )
    assert found == (5.0, 1.0, 1 + numerics.MAX_FUTILE_STEPS)
