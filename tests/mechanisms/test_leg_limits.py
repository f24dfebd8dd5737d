"""Limits of legs besides their lengths: angles of joints, distances, forces; in one place."""

import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from tests.doors import Limits, distances_of_segments
from tests.inputs.test_every_key import PLATFORM
from tests.mechanisms.machines import write_file
from tests.mechanisms.test_chains_by_letters import CHAINS

import cartstiff

POSE = [0.05, 0.02, 0.8, 0.05, 0.02, 0.1]


def _load(tmp_path, legs, base=PLATFORM):
    given = base["legs"] | legs
    kept = {key: value for key, value in given.items() if value is not None}
    return cartstiff.load(write_file(tmp_path, **(base | {"legs": kept})))


def _notes(elastic, code, q=POSE):
    return [n for n in cartstiff.analyse(elastic, q).notes if n.code == code]


@given(st.integers(0, 10_000))
@settings(max_examples=20)
def test_distance_of_segments_is_the_least_of_all_pairs_of_points(seed):
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.normal(size=(4, 3))
    if seed % 4 == 0:
        d = c + 2.0 * (b - a)  # parallel
    s = np.linspace(0, 1, 201)
    first = a + s[:, None] * (b - a)
    second = c + s[:, None] * (d - c)
    sampled = np.linalg.norm(first[:, None] - second[None], axis=2).min()
    found = distances_of_segments(a, b, c, d)
    assert found <= sampled + 1e-12
    assert sampled <= found + 0.01 * (np.linalg.norm(b - a) + np.linalg.norm(d - c))


def test_angles_are_those_of_the_legs_from_their_axes(tmp_path):
    elastic = _load(
        tmp_path,
        {
            "base_joints": {"axis": [0, 0, 2.0], "angle": 0.1},
            "platform_joints": {"axis": [0, 0, -1.0], "angle": [1.2] * 5 + [0.01]},
        },
    )
    (note,) = _notes(elastic, "beyond-limits")
    platform = elastic.mechanism
    T = platform.pose_of(np.array(POSE))
    along = platform.points @ T[:3, :3].T + T[:3, 3] - platform.anchors
    along /= np.linalg.norm(along, axis=1)[:, None]
    for i in range(6):
        assert np.isclose(
            note.values[f"angle of leg{i + 1} at the base"]["value"], np.arccos(along[i, 2])
        )
    down = T[:3, :3] @ [0, 0, -1.0]
    last = note.values["angle of leg6 at the platform"]
    assert np.isclose(last["value"], np.arccos(-along[5] @ down))
    assert last["upper"] == 0.01
    assert "rad" in note.message
    assert "angle of leg1 at the platform" not in note.values


def test_axes_of_the_platform_do_not_depend_on_the_frame_of_interest(tmp_path):
    legs = {"platform_joints": {"axis": [0.1, 0.2, -1.0], "angle": 0.0}}
    turned = PLATFORM | {"frame": {"xyz": [0.1, 0, 0.2], "rpy": [0.4, -1.0, 2.0]}}
    (here,) = _notes(_load(tmp_path, legs), "beyond-limits")
    (there,) = _notes(_load(tmp_path, legs, turned), "beyond-limits")
    for name, found in here.values.items():
        assert np.isclose(found["value"], there.values[name]["value"], atol=1e-12)


def test_legs_that_touch_are_named_but_not_those_that_share_a_joint(tmp_path):
    (note,) = _notes(_load(tmp_path, {"diameter": 0.18}), "beyond-limits")
    assert "distance of leg1 and leg2" in note.values  # their base joints are 0.174 apart
    assert note.values["distance of leg1 and leg2"]["upper"] is None
    shared = PLATFORM | {"base": [PLATFORM["base"][i] for i in (0, 0, 2, 2, 4, 4)]}
    names = Limits(_load(tmp_path, {"diameter": 0.1}, shared).mechanism).names
    assert "distance of leg1 and leg2" not in names
    assert len(names) == 12


def test_forces_beyond_limits_are_named(tmp_path):
    legs = {"rest_length": 0.9, "force": [-1e4, 2e4]}
    elastic = _load(tmp_path, legs)
    lengths = elastic.mechanism.leg_lengths(POSE)
    tensions = 1e5 * (lengths - 0.9)
    beyond = {f"force of leg{i + 1}" for i in np.flatnonzero((tensions < -1e4) | (tensions > 2e4))}
    (note,) = _notes(elastic, "force-limits")
    assert beyond == set(note.values)
    assert beyond
    for name, found in note.values.items():
        assert np.isclose(found["value"], tensions[int(name[-1]) - 1])
    balanced = _load(tmp_path, legs | {"rest_length": None})
    assert not _notes(balanced, "force-limits")
    loaded = cartstiff.analyse(balanced, POSE, wrench=[0, 0, 0, 0, 0, 3e5])
    assert "force-limits" in {n.code for n in loaded.notes}


def test_units_change_distances_and_leave_angles(tmp_path):
    from cartstiff.extend import in_units

    elastic = _load(tmp_path, {"diameter": 0.18, "base_joints": {"axis": [0, 0, 1], "angle": 0.1}})
    here = Limits(elastic.mechanism)
    there = Limits(in_units(elastic, "mm").mechanism)
    factor = np.where(here.are_angles, 1.0, 1000.0)
    assert here.names == there.names
    assert np.allclose(here.lower * factor, there.lower)


def test_an_equilibrium_names_them_and_stops_at_lengths_only(tmp_path):
    legs = {
        "rest_length": 0.9,
        "limits": [[0.1, 5.0]] * 6,
        "base_joints": {"axis": [0, 0, 1], "angle": 0.1},
    }
    found = cartstiff.equilibrium(_load(tmp_path, legs), wrench=[0, 0, 0, 0, 0, -10.0])
    assert "beyond-limits" in {note.code for note in found.notes}


def test_a_map_leaves_out_what_is_beyond(tmp_path):
    legs = {"base_joints": {"axis": [0, 0, 1], "angle": 0.9}}
    elastic = _load(tmp_path, legs)
    path = tmp_path / "map.zarr"
    grid = cartstiff.maps.Grid({"x": cartstiff.maps.Axis(-0.4, 0.4, 9)}, elastic.names, elastic.q)
    cartstiff.maps.compute_map(elastic, grid, ["translation_free_min"], path)
    states = cartstiff.maps.open_map(path).load()["state"].values.ravel()
    assert set(states[[0, -1]]) != {0}
    expected = [
        Limits(elastic.mechanism).holds(q, elastic.mechanism.pose_of(q))
        for q in (np.array([x, *elastic.q[1:]]) for x in np.linspace(-0.4, 0.4, 9))
    ]
    assert [state == 0 for state in states] == expected
    assert 0 < sum(expected) < 9
    forces = _load(
        tmp_path, {"rest_length": None, "preload": 0.0, "driven": False, "force": [-2e4, 2e4]}
    )
    path = tmp_path / "forces.zarr"
    cartstiff.maps.compute_map(forces, grid, ["translation_free_min"], path)
    states = cartstiff.maps.open_map(path).load()["state"].values.ravel()
    expected = [
        not _notes(forces, "force-limits", q)
        for q in (np.array([x, *elastic.q[1:]]) for x in np.linspace(-0.4, 0.4, 9))
    ]
    assert [state == 0 for state in states] == expected
    assert 0 < sum(expected) < 9


def test_one_pair_of_lengths_stands_for_all_legs(tmp_path):
    both = [
        _load(tmp_path, {"limits": given}).mechanism.limits
        for given in ([0.5, 1.2], [[0.5, 1.2]] * 6)
    ]
    np.testing.assert_array_equal(*both)
    assert both[0].shape == (6, 2)


@pytest.mark.parametrize("chain", ["PUS", "RUS", "UPS", "PRS"])
def test_distances_of_rods_are_those_of_their_joints(chain):
    """Ends by the model's own kinematics, least distances by a bounded search."""
    legs = {**CHAINS[chain][0], "chain": chain, "diameter": 0.02}
    machine = cartstiff.parallel(legs, [0, 0, CHAINS[chain][1], 0, 0, 0])
    m = machine.mechanism
    rng = np.random.default_rng(3)
    q = m.closed(machine.q + 0.03 * rng.standard_normal(machine.q.size), hold=[]).q
    model, posture = m.tree.model, m.at(q)
    placed = model.createData()
    pin.forwardKinematics(model, placed, q)

    def place(i, *names):
        known = [n for n in (f"leg{i}/{name}" for name in names) if model.existJointName(n)]
        return placed.oMi[model.getJointId(known[0])].translation

    limits = Limits(m)
    named = [n for n in limits.names if n.startswith("distance")]
    values = dict(zip(limits.names, limits.values(q, posture.pose), strict=True))
    assert named
    for name in named:
        i, j = (int(x) for x in re.findall(r"leg(\d+)", name))
        ends = []
        for leg in (i, j):
            B = (posture.pose @ m.legs[leg - 1].T_M_end)[:3, 3]
            ends.append((place(leg, "u1", "s1", "r1"), B))
        (a, b), (c, d) = ends

        def square(x, a=a, b=b, c=c, d=d):
            return float(((a + x[0] * (b - a) - c - x[1] * (d - c)) ** 2).sum())

        found = minimize(square, [0.5, 0.5], bounds=[(0, 1), (0, 1)], tol=1e-16)
        assert values[name] == pytest.approx(np.sqrt(found.fun), abs=1e-6)
