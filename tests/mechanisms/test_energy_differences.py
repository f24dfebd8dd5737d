"""Bundled mechanisms, loaded: every stiffness matrix against differences of the reduced energy."""

from dataclasses import replace

import numpy as np
import pytest
from tests.mechanisms.oracle import (
    DISPLACED,
    GRAVITY,
    Held,
    bundled_lines,
    displaced,
    missed,
)
from tests.support import relative_error

from cartstiff import analyse, load

# Eighth-order second differences of an energy, step 0.005: 4e-12 or better is reached, on the
# paper's platform 4e-10, whose energy is large.
ENERGY = 1e-9
# First differences of the load are better conditioned: 1e-11 or better is reached.
LOAD = 1e-10
# First differences of the energy against the size of the forces that cancel in the body: truncation
# of the step, 1.5e-9 on the Delta's slender forearms, 1e-11 elsewhere.
SLOPE = 1e-8
# The load makes the matrices differ by more than this share: the comparison can tell.
VISIBLE = 1e-4
# A load that was asked for, through least squares and back.
GIVEN = 1e-9
# What is left of the load of a body that was let go: rounding of forces inside, see the test.
BALANCED = 1e-9
# Forces of the closures on each other, N and N m: far above rounding.
INSIDE = 0.1
STEP = 0.005
# Cables stretched by 4 mm must stay taut.
CABLE_STEP = 0.001

WRENCH = np.array([4.0, -3.0, 5.0, 30.0, -20.0, 25.0])


def _check(result, held, step=STEP):
    """Load, K^A, K^B, K^K against the oracle `held` at the same pose."""
    assert relative_error(result.pose, held.pose0) <= LOAD
    wrong, bent, pulled = missed(result, held, step, seed=1)
    assert wrong <= LOAD
    assert bent <= ENERGY
    assert pulled <= SLOPE


def _given(name, factor=1.0):
    elastic = replace(load(name), gravity=GRAVITY)
    result = analyse(elastic, wrench=factor * WRENCH)
    assert relative_error(result.wrench, factor * WRENCH) <= GIVEN
    return result


def _displaced(name, spread, springs=None, by=DISPLACED):
    elastic, q = displaced(load(name), by, spread, springs, seed=3)
    return analyse(elastic, q)


LOADED = {
    "ur5": lambda: _given("ur5", 3.0),
    "panda": lambda: _given("panda"),
    "6-ups": lambda: _given("6-ups", 100.0),
    "6-ups, springs everywhere": lambda: _displaced("6-ups", 0.01, 2e3),
    "delta": lambda: _displaced("delta", 0.02),
    "grasp": lambda: _displaced("grasp", 0.05),
    "grasp, springs everywhere": lambda: _displaced("grasp", 0.1, 0.05),
}


@pytest.mark.parametrize("case", LOADED)
def test_loaded(case):
    result = LOADED[case]()
    A = result.matrices["A"]
    assert np.abs(A - A.T).max() > VISIBLE * np.abs(A).max()
    _check(result, Held(result.elastic, result.q))


# The body is free and at rest; what springs, gravity and closures exert on each other remains.
INTERNAL = {
    "6-ups": lambda: _displaced("6-ups", 0.01, 2e3, None),
    "3-rrr": lambda: _displaced("3-rrr", 0.01, 200.0, None),
    "grasp as bundled": lambda: analyse(load("grasp")),
    "grasp": lambda: _displaced("grasp", 0.01, 0.5, None),
}


@pytest.mark.parametrize("case", INTERNAL)
def test_preloaded_inside(case):
    result = INTERNAL[case]()
    inside = np.abs(result.closure_forces).max()
    assert inside > INSIDE
    assert np.abs(result.wrench).max() <= BALANCED * inside
    _check(result, Held(result.elastic, result.q))


PLATFORMS = {"hexapod": 100.0, "cubic": 100.0, "stewart-gough": 10.0}


@pytest.mark.parametrize("name", PLATFORMS)
def test_loaded_platform(name):
    """Lines with the rest lengths that were chosen, their energy written out by hand."""
    wrench = PLATFORMS[name] * WRENCH
    result = analyse(load(name), wrench=wrench)
    assert relative_error(result.wrench, wrench) <= GIVEN
    _check(result, bundled_lines(name, result.elastic.springs.rest))


def test_paper_platform_as_bundled():
    result = analyse(load("stewart-gough"))
    _check(result, bundled_lines("stewart-gough", result.elastic.springs.rest))


@pytest.mark.parametrize("moved", [0.0, 1e-3])
def test_preloaded_cables(moved):
    """The cable robot under its own preload, and moved off so that the cables pull it back."""
    elastic = load("cable-robot")
    elastic = analyse(elastic).elastic
    q = elastic.q + moved * np.array([1.0, -0.6, 0.5, 1.5, -2.0, 3.0])
    result = analyse(elastic, q)
    held = bundled_lines("cable-robot", elastic.springs.rest)
    held.pose0 = elastic.mechanism.pose_of(q)
    assert (np.abs(result.wrench).max() > 10.0) == (moved > 0.0)
    _check(result, held, CABLE_STEP)
