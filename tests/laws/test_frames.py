"""F is the room, B the robot's own base: how a robot is mounted changes nothing that B knows."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.support.commands import answer, run

import cartstiff
from cartstiff.geometry import se3

SPRINGS = (
    "springs: {shoulder_pan_joint: {stiffness: 3.0e4}, shoulder_lift_joint: {stiffness: 3.0e4}, "
    "elbow_joint: {stiffness: 2.0e4}, wrist_1_joint: {stiffness: 5.0e3}, "
    "wrist_2_joint: {stiffness: 5.0e3}, wrist_3_joint: {stiffness: 4.0e3}}\n"
)
MOUNTS = ("{xyz: [0, 0, 0.8], rpy: [0, 0, 0.5]}", "{xyz: [0.3, -1, 2], rpy: [3.1, 0.2, -0.7]}")
Q = "0.3,-1.1,1.3,-0.7,0.9,0.2"
JOINTS = (
    "shoulder_pan_joint,shoulder_lift_joint,elbow_joint,wrist_1_joint,wrist_2_joint,wrist_3_joint"
)


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """The same arm on the floor, on a stand, and hanging askew."""
    folder = tmp_path_factory.mktemp("mounted")
    files = []
    for i, base in enumerate(["{}", *MOUNTS]):
        files.append(folder / f"arm{i}.yaml")
        files[-1].write_text(f"kind: serial\nmodel: ur5\nframe: tool0\nbase: {base}\n{SPRINGS}")
    return files


def test_matrices_along_base_axes(robots):
    for order in ("angular-linear", "linear-angular"):
        found = [answer(f"analyse {r} --q {Q} --axes base --order {order}") for r in robots]
        K = [np.array(d["as_controller"]["stiffness"]["B"]) for d in found]
        assert K[1] == pytest.approx(K[0], rel=1e-9, abs=1e-6)
        assert K[2] == pytest.approx(K[0], rel=1e-9, abs=1e-6)
    # Along the room's axes each block turns with the mount; the first is on the floor.
    world = answer("analyse", robots[1], f"--q {Q} --axes world")
    R = np.kron(np.eye(2), Rotation.from_rotvec([0, 0, 0.5]).as_matrix())
    floor = answer("analyse", robots[0], f"--q {Q} --axes base")
    expected = R @ np.array(floor["as_controller"]["stiffness"]["A"]) @ R.T
    got = world["as_controller"]["stiffness"]["A"]
    assert np.array(got) == pytest.approx(expected, rel=1e-9, abs=1e-6)


def test_a_controller_does_not_see_the_mount(robots, tmp_path):
    wanted = tmp_path / "wanted.json"
    wanted.write_text(
        json.dumps(
            {"matrix": np.diag([1e3, 1500, 800, 30, 30, 20]).tolist(), "order": "linear-angular"}
        )
    )
    found = [answer(f"modes {r} --q {Q} --impedance {wanted} --axes base") for r in robots]
    for key in ("joint_stiffness", "joint_damping", "frequencies"):
        a, b, c = (np.array(data["impedance"][key]) for data in found)
        assert b == pytest.approx(a, rel=1e-8, abs=1e-8)
        assert c == pytest.approx(a, rel=1e-8, abs=1e-8)
    # J^T K J with J along the base's axes at M, from the floor's pose.
    state = cartstiff.analyse(cartstiff.load(robots[0]), [float(x) for x in Q.split(",")])
    J = np.kron(np.eye(2), state.pose[:3, :3]) @ state.jacobian
    K = np.diag([30.0, 30, 20, 1e3, 1500, 800])
    assert found[2]["impedance"]["joint_stiffness"] == pytest.approx(J.T @ K @ J, rel=1e-8)


def test_positions_are_measured_in_the_base(robots, tmp_path):
    """A laser tracker in the base: made by hand from C W, not by the simulation."""
    rng, k = np.random.default_rng(0), np.array([3e4, 3e4, 2e4, 5e3, 5e3, 4e3])
    floor = cartstiff.load(robots[0])
    lines = [f"{JOINTS},fx,fy,fz,x,y,z,sd_x,sd_y,sd_z"]
    for _ in range(24):
        q = floor.q + rng.uniform(-0.5, 0.5, 6)
        state = cartstiff.analyse(floor, q)
        J = np.kron(np.eye(2), state.pose[:3, :3]) @ state.jacobian
        f = rng.normal(size=3) * 150.0
        moved = (J @ np.diag(1 / k) @ J.T @ np.r_[0, 0, 0, f])[3:]
        numbers = [*q, *f, *(state.pose[:3, 3] + moved), 1e-6, 1e-6, 1e-6]
        lines.append(",".join(f"{x:.12g}" for x in numbers))
    table = tmp_path / "measured.csv"
    table.write_text("\n".join(lines) + "\n")
    for robot in robots:
        data = answer(f"identify {robot} {table}")
        found = [p["stiffness"] for p in data["parameters"]]
        assert found[:5] == pytest.approx(k[:5], rel=1e-4)
        assert found[5] is None  # forces at the tool's origin do not turn the last joint


def test_offsets_need_sessions(robots, tmp_path):
    table = tmp_path / "measured.csv"
    for columns, numbers, words in (
        ("fz,dz", "100,0.001", "expected measured positions x, y, z"),
        ("fz,x,y,z", "100,0.1,0.2,0.3", "column session"),
    ):
        table.write_text(f"{JOINTS},{columns}\n{Q},{numbers}\n")
        assert words in run("identify", robots[0], table, "--offsets rigid", code=2)


def test_every_output_says_where_m_and_the_base_are(robots):
    tool = "--tcp 0,0,0.1,0,0.5,0"
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("y", 0.5).as_matrix()
    T[2, 3] = 0.1
    base = se3.from_roll_pitch_yaw([0.3, -1, 2], [3.1, 0.2, -0.7])
    for name, *more in (
        ("analyse",),
        ("frames",),
        ("modes",),
        ("equilibrium", "--load", "0,0,0,0,0,-10"),
    ):
        data = answer(name, robots[2], tool, *more)
        assert data["frame"] == "tool0"
        assert np.array(data["frame_offset"]) == pytest.approx(T)
        assert np.array(data["base_pose"]) == pytest.approx(base)
        text = run(name, robots[2], tool, *more)
        assert "(0, 0, 100) mm, turned by roll, pitch, yaw (0, 28.6479, 0) deg in 'tool0'" in text
    platform = answer("analyse stewart-gough --tcp 0,0,5")
    assert np.array(platform["frame_offset"])[:3, 3] == pytest.approx([0, 0, 5])
    # A body on chains: M moves with the tool, and the same tool as key `offset` of the file.
    plain, moved = (
        answer("analyse orthoglide", *more) for more in ([], ["--tcp", "0,0,0.1,0,0.5,0"])
    )
    assert np.array(moved["frame_offset"]) == pytest.approx(T)
    assert np.array(moved["pose"]) == pytest.approx(np.array(plain["pose"]) @ T, abs=1e-9)
