"""Inverse kinematics by machine code takes the steps of NumPy, which is the oracle here."""

import pickle

import numpy as np
import pytest
from tests.doors import JointPoses
from tests.inner import QuickPoses, cartesian

import cartstiff
from cartstiff.geometry import se3
from cartstiff.maps import Axis, CartesianGrid

COUNT = 300


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_errors_steps_and_solutions_are_those_of_numpy(robot):
    elastic = cartstiff.load(robot)
    plain, quick = JointPoses(elastic), QuickPoses(elastic)
    rng = np.random.default_rng(0)
    q = plain.random_starts(COUNT, rng)
    T = plain.kinematics.at(plain.random_starts(COUNT, rng)).pose
    here = plain.kinematics.at(q).pose
    # Near no turn, and near half a turn, where the rotation vector has no derivative.
    T[:20] = here[:20] @ se3.exp(rng.normal(scale=1e-8, size=(20, 6)))
    half = np.zeros((20, 6))
    short_of_half = np.pi - 10.0 ** rng.uniform(-9, -1, (20, 1))
    half[:, :3] = short_of_half * np.eye(3)[rng.integers(3, size=20)]
    T[20:40] = here[20:40] @ se3.exp(half)
    (e, J), (e_quick, J_quick) = (solver._errors(q, T, "none") for solver in (plain, quick))
    assert np.abs(e - e_quick).max() < 1e-11
    assert np.abs(J - J_quick).max() < 1e-14
    mu = rng.uniform(0.01, 1.0, COUNT)
    edge = np.clip(q + rng.normal(scale=2.0, size=q.shape), plain.lower, plain.upper)
    assert (edge == plain.lower).any()
    assert (edge == plain.upper).any()
    for solver in ((plain, quick), (plain.unwound(), quick.unwound())):
        first, second = (each._step(edge, e, J, mu) for each in solver)
        # At the end of a search little damping is left to hold joints apart that do the same.
        assert np.abs(first - second)[20:].max() < 1e-10
    (found, good), (found_quick, good_quick) = (s.solve(T, q) for s in (plain, quick))
    assert good.any()
    assert (good == good_quick).all()
    assert np.abs(found - found_quick)[good].max() < 1e-6


def test_other_searches_are_left_to_numpy():
    elastic = cartstiff.load("panda")
    plain, quick = JointPoses(elastic), QuickPoses(elastic)
    q = plain.random_starts(20, np.random.default_rng(0))
    T = plain.kinematics.at(q[::-1]).pose
    for options in ({"free": "z"}, {"held": np.arange(7) == 2}):
        for a, b in zip(plain.solve(T, q, **options), quick.solve(T, q, **options), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-8)


def test_a_map_has_the_same_branches_either_way(monkeypatch):
    elastic = cartstiff.load("ur5")

    def grid():
        return CartesianGrid({"x": Axis(0.2, 0.6, 3), "z": Axis(0.1, 0.9, 3)}, elastic, elastic.q)

    box = tuple(slice(0, n) for n in grid().shape)
    expected, count = grid().solve(box, elastic)
    monkeypatch.setattr(cartesian, "_COMPILED_FROM", 1)
    quick = grid()
    found, count_quick = quick.solve(box, elastic)
    assert (count == count_quick).all()
    assert count.max() >= 4
    np.testing.assert_allclose(found, expected, atol=1e-8)
    # Machine code stays behind where the sampling goes to another process.
    assert pickle.loads(pickle.dumps(quick)).to_dict() == quick.to_dict()
