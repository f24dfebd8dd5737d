"""Frequencies over many postures equal those of one."""

from __future__ import annotations

import numpy as np
import pytest
from tests.vibration.test_modes import column

from cartstiff import ToolPath, Trajectory, analyse, compute_map, load, modes, optimise_path
from cartstiff.toolpaths.cost import criteria
from cartstiff.vibration.many_modes import frequencies_of_many


def test_arrays_equal_single_postures():
    elastic = load("ur5")
    q = np.random.default_rng(0).uniform(-2, 2, (7, 6))
    found = frequencies_of_many(elastic, q)
    one = np.array([modes(elastic, x).frequencies for x in q])
    assert found == pytest.approx(one, rel=1e-10)
    W = np.array([0, 0, 0, 100.0, 0, -400.0])
    loaded = frequencies_of_many(elastic, q[:2], 6, W, load_axes="world")
    assert loaded[1] == pytest.approx(
        modes(elastic, q[1], wrench=W, load_axes="world").frequencies, rel=1e-12
    )
    each = frequencies_of_many(elastic, q[:2], 3, np.stack([W, 0 * W]))
    assert each.shape == (2, 3)
    assert each[1] == pytest.approx(one[1, :3], rel=1e-10)


def test_motions_without_mass_have_none():
    bare = column(masses=(2.0, 0.0))
    found = frequencies_of_many(bare, np.zeros((1, 2)), 3)
    assert found[0, 0] == pytest.approx(modes(bare).frequencies[0])
    assert np.isnan(found[0, 1:]).all()


def test_a_map_of_frequencies(tmp_path):
    elastic = load("ur5")
    columns = {"elbow_joint": [1.0, 1.2, 1.6]}
    sampling = Trajectory.from_table(columns, elastic, elastic.q)
    data = compute_map(elastic, sampling, ["frequency_1", "frequency_6"], tmp_path / "f.zarr")
    for i, angle in enumerate(columns["elbow_joint"]):
        one = modes(elastic, {"elbow_joint": angle}).frequencies
        assert float(data["frequency_1"].values[i]) == pytest.approx(one[0], rel=1e-6)
        assert float(data["frequency_6"].values[i]) == pytest.approx(one[5], rel=1e-6)


def test_criterion_of_a_path():
    """The working mode with the highest first frequency."""
    elastic = load("ur5")
    arm = elastic.mechanism
    poses = np.stack([arm.at(elastic.q + 0.02 * i).pose for i in range(2)])
    assert "frequency_1" in criteria()
    found = optimise_path(elastic, ToolPath(poses), criterion="frequency_1")
    for q, value in zip(found.q, found.values, strict=True):
        assert value == pytest.approx(modes(elastic, q).frequencies[0], rel=1e-6)


@pytest.mark.parametrize("name", ["ur5", "panda"])
@pytest.mark.parametrize("kind", ["dead", "follower", "conservative"])
def test_springs_alone_need_no_stiffness_at_the_body(name, kind):
    """The same as through `analyse`, at any posture and load, stretched arms included."""
    elastic, rng = load(name), np.random.default_rng(3)
    n = len(elastic.q)
    for q in [*rng.uniform(-2, 2, (3, n)), np.zeros(n)]:
        for size in (0.0, 200.0):
            acting = {"wrench": size * rng.normal(size=6), "load_kind": kind,
                      "load_at": (0.0, 0.0, 0.1), "load_axes": "world"}  # fmt: skip
            quick, whole = modes(elastic, q, **acting), modes(analyse(elastic, q, **acting))
            assert quick.squares == pytest.approx(whole.squares, rel=1e-12)
            assert quick.as_dict()["notes"] == whole.as_dict()["notes"]
            assert quick.load["words"] == whole.load["words"]
            assert quick.elastic.springs.rest == pytest.approx(
                whole.elastic.springs.rest, rel=1e-12, nan_ok=True
            )
