"""What is beyond limits is said by every command, and decided once."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from tests.doors import Limits
from tests.support import robot_file
from tests.support.printed import text_of

import cartstiff
from cartstiff import DeadForce, compensate, equilibrium, load_curve
from cartstiff.maps import Axis, Grid, compute_map

ROBOTS = Path(__file__).parents[2] / "robots"
DEGREES = [0.0, -60.0, 90.0, 0.0, 45.0, 0.0]


def notes_of(result):
    return {note.code: note for note in result.notes}


def ur5():
    robot_file("ur_description/urdf/ur5_robot.urdf")
    return cartstiff.load("ur5")


def leg_lengths(q):
    """Lengths of the hexapod's legs, from the points of its file."""
    points = cartstiff.load("hexapod").mechanism
    R = Rotation.from_euler("xyz", q[3:]).as_matrix()
    return np.linalg.norm(points.points_P @ R.T + q[:3] - points.anchors, axis=1)


def test_sides_are_minus_one_zero_and_one():
    limits = Limits(ur5().mechanism)
    beyond = np.array([-0.1, 0.0, 0.1])
    for column, (low, high) in enumerate(zip(limits.lower, limits.upper, strict=True)):
        values = np.tile(0.5 * (limits.lower + limits.upper), (3, 1))
        values[:, column] = np.array([low, values[1, column], high]) + beyond
        assert limits.side(values)[:, column].tolist() == [-1, 0, 1]


def test_degrees_typed_for_radians_are_named():
    note = notes_of(cartstiff.analyse(ur5(), DEGREES))["beyond-limits"]
    assert set(note.values) == {"shoulder_lift_joint", "elbow_joint", "wrist_2_joint"}
    found = note.values["elbow_joint"]
    assert found["value"] == 90.0
    assert found["upper"] == pytest.approx(np.pi, abs=1e-4)
    assert "Degrees?" in note.message
    inside = cartstiff.analyse(ur5(), np.radians(DEGREES))
    assert not {"beyond-limits", "many-turns"} & set(notes_of(inside))
    # A little beyond is no confusion of units.
    close = notes_of(cartstiff.analyse(ur5(), [0.0, 0.0, 3.3, 0.0, 1.0, 0.0]))["beyond-limits"]
    assert "Degrees?" not in close.message


def test_angles_without_limits_that_look_like_degrees():
    elastic = cartstiff.load("five-bar")
    assert all(np.isinf(c.upper) for c in elastic.mechanism.coordinates)
    start = elastic.q.copy()
    start[elastic.mechanism.actuated[0]] += 10 * np.pi
    found = notes_of(cartstiff.analyse(elastic, start))
    assert "Degrees?" in found["many-turns"].message


def test_legs_out_of_reach_are_named_by_every_command(tmp_path):
    elastic = cartstiff.load("hexapod")
    shared = yaml.safe_load((ROBOTS / "hexapod.yaml").read_text())["legs"]["limits"]
    far = [0.0, 0.0, 2.5, 0.0, 0.0, 0.0]
    lengths = leg_lengths(np.array(far))
    note = notes_of(cartstiff.analyse(elastic, far))["beyond-limits"]
    assert list(note.values) == [f"leg{i + 1}" for i in range(6)]
    for i, (name, found) in enumerate(note.values.items()):
        assert found["value"] == pytest.approx(lengths[i], rel=1e-14), name
        assert [found["lower"], found["upper"]] == shared
    start = notes_of(equilibrium(elastic, q=far))["beyond-limits"]
    assert start.message.startswith("at the start: ")
    free = equilibrium(elastic, q=far, limits=False)
    assert [n.message[:8] for n in free.notes if n.code == "beyond-limits"] == [
        "at the s",
        "at rest:",
    ]
    load = DeadForce([0.0, 0.0, -1.0])
    curve = load_curve(elastic, [0.0, 0.0, 1.25, 0.0, 0.0, 0.0], load, to=0.01)
    assert "beyond-limits" in notes_of(curve)
    path = compensate(elastic, [far, far, elastic.q, far], [load] * 4)
    assert {"beyond-limits", "command-beyond-limit"} <= set(notes_of(path))
    told = [line for line in text_of(path).splitlines() if "the command of leg2" in line]
    assert told == [
        "  [command-beyond-limit] points 1-2, 4: the command of leg2 is beyond its limit"
    ]


def states_of(data):
    """The state of each posture of a map, by its name."""
    names = data["state"].attrs["flag_meanings"].split()
    return [names[int(s)] for s in data["state"].values.ravel()]


def test_a_grid_of_poses_agrees_with_inverse_kinematics(tmp_path):
    elastic = cartstiff.load("hexapod")
    heights = np.linspace(0.3, 1.6, 14)
    grid = Grid({"z": Axis(0.3, 1.6, 14)}, elastic.names, elastic.q)
    data = compute_map(elastic, grid, ["condition"], tmp_path / "map.zarr")
    states = states_of(data)
    poses = np.array(
        [elastic.mechanism.pose_of(np.array([*elastic.q[:2], z, *elastic.q[3:]])) for z in heights]
    )
    good = np.array([len(each) > 0 for each in cartstiff.inverse_kinematics(elastic, [*poses])])
    assert 0 < good.sum() < 14
    assert [s == "regular" for s in states] == good.tolist()
    assert {s for s, g in zip(states, good, strict=True) if not g} == {"beyond-limits"}
    assert np.isfinite(data["condition"].values.ravel()).tolist() == good.tolist()


def test_joints_of_a_grid_beyond_limits(tmp_path):
    elastic = ur5()
    grid = Grid({"elbow_joint": Axis(2.9, 3.2, 4)}, elastic.names, elastic.q)
    data = compute_map(elastic, grid, ["condition"], tmp_path / "map.zarr")
    states = states_of(data)
    assert states == ["regular", "regular", "regular", "beyond-limits"]


def test_many_postures_at_once_as_one_by_one():
    elastic = cartstiff.load("hexapod")
    rng = np.random.default_rng(0)
    q = elastic.q + rng.normal(size=(50, 6)) * 0.2
    limits = Limits(elastic.mechanism)
    poses = np.array([elastic.mechanism.at(row).pose for row in q])
    expected = np.array([leg_lengths(row) for row in q])
    assert np.abs(limits.values(q, poses) - expected).max() < 1e-14
    assert limits.values(q[3], poses[3]) == pytest.approx(expected[3], rel=1e-14)


def test_a_posture_on_its_limit_is_within_to_rounding():
    elastic = ur5()
    limits = Limits(elastic.mechanism)
    on = limits.upper * (1.0 + 1e-15)
    assert not limits.side(on).any()
    assert limits.excess(on).max() == 0.0
    assert limits.side(limits.upper + 1e-9).tolist() == [1] * 6
