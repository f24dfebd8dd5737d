"""Frequencies over many postures equal those of one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.doors import poles
from tests.inner import ManyModes, vibrations
from tests.support.read import frequencies
from tests.vibration.test_modes import column

from cartstiff import (
    ConvergenceError,
    InputError,
    ToolPath,
    analyse,
    analyse_many,
    load,
    modes,
    optimise_path,
    record,
)
from cartstiff.extend import in_units
from cartstiff.maps import Trajectory, compute_map, map_of
from cartstiff.vibration import Damping


def test_arrays_equal_single_postures():
    elastic = load("ur5")
    q = np.random.default_rng(0).uniform(-2, 2, (7, 6))
    found = frequencies(elastic, q)
    one = np.array([modes(elastic, x).frequencies for x in q])
    assert found == pytest.approx(one, rel=1e-10)
    W = np.array([0, 0, 0, 100.0, 0, -400.0])
    loaded = frequencies(elastic, q[:2], W, {"load_axes": "world"})
    assert loaded[1] == pytest.approx(
        modes(elastic, q[1], wrench=W, load_axes="world").frequencies, rel=1e-12
    )
    each = frequencies(elastic, q[:2], np.stack([W, 0 * W]), count=3)
    assert each.shape == (2, 3)
    assert each[1] == pytest.approx(one[1, :3], rel=1e-10)


def test_motions_without_mass_have_none():
    bare = column(masses=(2.0, 0.0))
    found = frequencies(bare, np.zeros((1, 2)), count=3)
    assert found[0, 0] == pytest.approx(modes(bare).frequencies[0])
    assert np.isnan(found[0, 1:]).all()


@pytest.mark.parametrize("least", [-1e3, -1e-3, 0.0])
def test_matrices_that_are_not_positive_are_left_to_the_modes_of_one_posture(least):
    elastic, zeros = column(), np.zeros((2, 6, 2))
    H = np.array([np.diag([2e3, 1e3]), [[1e3, 1e3], [1e3, least]]])
    arrays = {"kinetic": np.array([[[3.0, 1.0], [1.0, 2.0]]] * 2), "lagrangian": H}
    arrays |= {"motion": zeros, "wrench": zeros[:, :, 0]}
    found, known = ManyModes(elastic, np.zeros((2, 2)))._of_matrices(arrays)
    squares = np.linalg.eigvals(np.linalg.solve(arrays["kinetic"][0], H[0]))
    assert known.tolist() == [True, False]
    assert found[0, :2] == pytest.approx(np.sqrt(np.sort(squares)) / (2 * np.pi))
    assert np.isnan(found[1]).all()


def test_without_masses_and_damping_without_its_criterion_are_refused():
    bare, hexapod = column(masses=(0.0, 0.0)), load("stewart-gough")
    where = Trajectory(np.zeros((1, 2)))
    here = ToolPath(hexapod.mechanism.at(hexapod.q).pose[None])
    for ask in (
        lambda: map_of(bare, where, ["frequency_1"]),
        lambda: map_of(bare, where, ["damping_1"], damping=0.1),
        lambda: record(bare, ["frequency_2"]),
        lambda: optimise_path(hexapod, here, criterion="frequency_1"),
    ):
        with pytest.raises(InputError, match=r"needs masses.*nothing that moves"):
            ask()
    with pytest.raises(InputError, match=r"damping.*criterion does not need it"):
        optimise_path(hexapod, here, criterion="condition", damping=0.1)


def test_a_body_that_carries_all_mass_swings_by_its_compliance(tmp_path, monkeypatch):
    """Hexapods between flexures, and bodies on legs: frequencies of arrays are those one by one."""
    folder = Path(__file__).parents[2] / "robots"
    text = (folder / "flexure-hexapod.yaml").read_text("utf-8")
    body = "body: {mass: 1, com: [0, 0, 0.01], inertia: [[3e-3, 0, 0], [0, 3e-3, 0], [0, 0, 5e-3]]}"
    struts, legs = tmp_path / "struts.yaml", tmp_path / "legs.yaml"
    struts.write_text(f"{text}\n{body}\n", "utf-8")
    text = (folder / "3-prs.yaml").read_text("utf-8")
    legs.write_text(f"{text}\npayload: {{mass: 5, com: [0.02, 0, 0.1]}}\n", "utf-8")
    for path, step in ((struts, 1e-4), (legs, 0.02)):
        elastic = load(path)
        columns = list(getattr(elastic.mechanism, "held", range(6)))
        q = np.tile(elastic.q, (4, 1))
        q[:, columns] += step * np.random.default_rng(1).standard_normal((4, len(columns)))
        data = compute_map(
            elastic, Trajectory(q), ["frequency_1", "frequency_3"], tmp_path / f"{path.stem}.zarr"
        )
        found = analyse_many(elastic, q).q
        with monkeypatch.context() as left:
            left.setattr(vibrations, "modes", None)  # nothing is left to it
            quick = frequencies(elastic, found, count=3)
        slow = np.array([modes(elastic, x).frequencies[:3] for x in found])
        assert quick == pytest.approx(slow, rel=1e-10)
        assert data["frequency_3"].values == pytest.approx(slow[:, 2], rel=1e-10)


def test_of_postures_that_are_not_decided_so_many_are_looked_at():
    """Postures of a stretched arm are those that the recorded arithmetic does not decide."""
    elastic = load("ur5")
    q = np.array([*[np.zeros(6)] * 3, *[elastic.q] * 3])
    found = frequencies(elastic, q, count=1, one_by_one=1)
    assert np.isfinite(found).ravel().tolist() == [True, False, False, True, True, True]
    found = frequencies(elastic, q[:3], count=1, one_by_one=1)
    assert np.isfinite(found).ravel().tolist() == [True, False, False]


def test_criterion_of_a_path():
    """The working mode with the highest first frequency."""
    elastic = load("ur5")
    arm = elastic.mechanism
    poses = np.stack([arm.at(elastic.q + 0.02 * i).pose for i in range(2)])
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
            acting = {
                "wrench": size * rng.normal(size=6),
                "load_kind": kind,
                "load_at": (0.0, 0.0, 0.1),
                "load_axes": "world",
            }
            quick, whole = modes(elastic, q, **acting), modes(analyse(elastic, q, **acting))
            assert quick.squares == pytest.approx(whole.squares, rel=1e-12)
            assert quick.to_dict()["notes"] == whole.to_dict()["notes"]
            assert quick.load["words"] == whole.load["words"]
            assert quick.elastic.springs.rest == pytest.approx(
                whole.elastic.springs.rest, rel=1e-12, nan_ok=True
            )


def test_maps_and_paths_of_damping(tmp_path):
    elastic = load("ur5")
    how = Damping(0.02, stiffness=1e-4)
    columns = {"elbow_joint": [1.0, 1.6]}
    sampling = Trajectory.from_table(columns, elastic, elastic.q)
    names = ["damping_1", "damping_6"]
    file = tmp_path / "d.zarr"
    data = compute_map(elastic, sampling, names, file, damping=how)
    for i, angle in enumerate(columns["elbow_joint"]):
        found = modes(elastic, {"elbow_joint": angle})
        ratios = 0.02 + 0.5e-4 * 2 * np.pi * found.frequencies
        assert float(data["damping_1"].values[i]) == pytest.approx(ratios[0], rel=1e-6)
        assert float(data["damping_6"].values[i]) == pytest.approx(ratios[5], rel=1e-6)
    with pytest.raises(InputError, match="needs damping"):
        compute_map(elastic, sampling, names, tmp_path / "e.zarr")
    poses = np.stack([elastic.mechanism.at(elastic.q + 0.02 * i).pose for i in range(2)])
    best = optimise_path(elastic, ToolPath(poses), criterion="damping_1", damping=how)
    ratios = [how.of_modes(modes(elastic, q))[0] for q in best.q]
    assert best.values == pytest.approx(ratios, rel=1e-6)


def test_dampers_make_the_ratios_of_the_poles():
    elastic = replace(load("ur5"), damping=np.linspace(1.0, 6.0, 6))
    many = ManyModes(elastic, elastic.q[None])
    assert many.damping_ratios(Damping())[0] == pytest.approx(poles(modes(elastic), Damping())[1])


@pytest.mark.parametrize("units", ["m", "mm"])
def test_platforms_equal_single_postures(units):
    """With masses in the legs; among the postures Fichter's singular one, a quarter turn."""
    elastic = in_units(load("stewart-simscape"), units)
    at = elastic.q
    size = at[2]
    rng = np.random.default_rng(1)
    q = at + rng.normal(size=(5, 6)) * [*[0.1 * size] * 3, 0.3, 0.3, 0.3]
    q[3, :5], q[3, 5] = at[:5], np.pi / 2
    found = frequencies(elastic, q)
    one = np.array([modes(elastic, x).frequencies for x in q])
    assert found == pytest.approx(one, rel=1e-10)
    assert found[3, 0] == 0.0 < found[3, 1]


def test_a_platform_whose_mass_is_a_point_is_asked_one_by_one():
    elastic = load("inclined-hexapod").with_payload(2.0, [0.0, 0.0, 0.1])
    found = frequencies(elastic, elastic.q[None])[0]
    one = modes(elastic).frequencies
    assert found[: len(one)] == pytest.approx(one, rel=1e-10)
    assert np.isnan(found[len(one) :]).all()


def test_postures_that_cannot_carry_the_load_have_no_frequencies():
    """Cables cannot push, and links have no rest under too much: other postures have theirs."""
    elastic = load("cable-robot", payload=[2, 0, 0, 0.1])
    W = np.array([-6.553, 5.795, 7.334, -34.07, -55.54, 92.76])
    q = np.array([elastic.q, elastic.q])
    q[1, 5] = 0.3
    with pytest.raises(InputError, match="cannot balance"):
        analyse(elastic, q[1], wrench=W)
    found = frequencies(elastic, q, W)
    one = modes(elastic, q[0], wrench=W).frequencies
    assert found[0, : one.size] == pytest.approx(one, rel=1e-10)
    assert np.isnan(found[1]).all()
    assert np.isnan(ManyModes(elastic, q, W).damping_ratios(Damping(0.02)))[1].all()


def test_postures_whose_links_find_no_rest_have_no_frequencies(monkeypatch):
    def without_rest(*args, **kwargs):
        raise ConvergenceError("no rest", iterations=60, residual=1.0)

    monkeypatch.setattr(vibrations, "modes", without_rest)
    elastic = load("delta")
    found = frequencies(elastic, elastic.q[None], np.array([0, 0, 0, 0, 3e5, 0]), count=2)
    assert np.isnan(found).all()
