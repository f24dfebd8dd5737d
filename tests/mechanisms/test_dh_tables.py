"""Arms by Denavit-Hartenberg tables against products of matrices, a published pose and URDFs."""

from functools import reduce
from math import cos, pi, sin

import numpy as np
import pinocchio as pin
import pytest
from tests.mechanisms.machines import write_file
from tests.support import absolute_error
from tests.support.robots import example_robot

import cartstiff

# a, alpha, d, theta. Puma 560: Corke, Robotics, Vision and Control (2011), without the height of
# the shoulder. UR5: the maker's page on DH parameters. Panda: Franka's documentation (modified).
PUMA = [
    (0.0, pi / 2, 0.0, 0.0),
    (0.4318, 0.0, 0.0, 0.0),
    (0.0203, -pi / 2, 0.15005, 0.0),
    (0.0, pi / 2, 0.4318, 0.0),
    (0.0, -pi / 2, 0.0, 0.0),
    (0.0, 0.0, 0.0, 0.0),
]
UR5 = [
    (0.0, pi / 2, 0.089159, 0.0),
    (-0.425, 0.0, 0.0, 0.0),
    (-0.39225, 0.0, 0.0, 0.0),
    (0.0, pi / 2, 0.10915, 0.0),
    (0.0, -pi / 2, 0.09465, 0.0),
    (0.0, 0.0, 0.0823, 0.0),
]
PANDA = [
    (0.0, 0.0, 0.333, 0.0),
    (0.0, -pi / 2, 0.0, 0.0),
    (0.0, pi / 2, 0.316, 0.0),
    (0.0825, pi / 2, 0.0, 0.0),
    (-0.0825, -pi / 2, 0.384, 0.0),
    (0.0, pi / 2, 0.0, 0.0),
    (0.088, pi / 2, 0.0, 0.0),
    (0.0, 0.0, 0.107, 0.0),
]
Q = np.array([0.3, -1.1, 1.4, -0.7, 0.9, 0.2, 0.5])


def standard(a, alpha, d, theta):
    c, s, ca, sa = cos(theta), sin(theta), cos(alpha), sin(alpha)
    return np.array(
        [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    )


def modified(a, alpha, d, theta):
    c, s, ca, sa = cos(theta), sin(theta), cos(alpha), sin(alpha)
    return np.array(
        [
            [c, -s, 0, a],
            [s * ca, c * ca, -sa, -d * sa],
            [s * sa, c * sa, ca, d * ca],
            [0, 0, 0, 1],
        ]
    )


def rows(table, fixed=0):
    keys = ("a", "alpha", "d", "theta")
    listed = [dict(zip(keys, row, strict=True)) for row in table]
    for row in listed[len(listed) - fixed :]:
        row |= {"type": "fixed", "name": "flange"}
    return listed


def arm(folder, convention, joints, **more):
    dh = {"convention": convention, "joints": joints}
    return cartstiff.load(write_file(folder, "arm", kind="serial", dh=dh, **more))


def product(form, table, q):
    """Pose of the last row's frame, revolute joints only; rows beyond q are fixed."""
    q = [*q, *[0.0] * (len(table) - len(q))]
    turned = [
        form(a, alpha, d, theta + x) for (a, alpha, d, theta), x in zip(table, q, strict=True)
    ]
    return reduce(np.matmul, turned)


@pytest.mark.parametrize(
    ("convention", "form", "table", "fixed"),
    [
        ("standard", standard, PUMA, 0),
        ("standard", standard, UR5, 0),
        ("modified", modified, PANDA, 1),
        ("modified", modified, [(0.1, 0.3, 0.2, 0.4), (-0.2, 1.1, 0.3, -0.5)], 0),
    ],
)
def test_against_the_product_of_matrices(tmp_path, convention, form, table, fixed):
    elastic = arm(tmp_path, convention, rows(table, fixed))
    q = Q[: len(table) - fixed]
    assert list(elastic.names) == [f"j{i + 1}" for i in range(q.size)]
    assert absolute_error(elastic.mechanism.at(q).pose, product(form, table, q)) <= 1e-14


def test_published_pose_of_the_puma(tmp_path):
    """Corke's nominal posture: q = (0, pi/4, pi, 0, pi/4, 0), the tool points along x."""
    elastic = arm(tmp_path, "standard", rows(PUMA))
    published = [[0, 0, 1, 0.5963], [0, 1, 0, -0.1501], [-1, 0, 0, -0.01435]]
    pose = elastic.mechanism.at(np.array([0, pi / 4, pi, 0, pi / 4, 0])).pose
    assert absolute_error(pose[:3], published) <= 5.1e-5


@pytest.mark.parametrize(
    ("robot", "convention", "table", "fixed", "base", "tip"),
    [
        ("ur5", "standard", UR5, 0, "base", "tool0"),
        ("panda", "modified", PANDA, 1, "panda_link0", "panda_link8"),
    ],
)
def test_against_the_makers_urdf(tmp_path, robot, convention, table, fixed, base, tip):
    model = pin.buildModelFromUrdf(str(example_robot(robot)))
    data, n = model.createData(), len(table) - fixed
    q = np.append(Q[:n], np.zeros(model.nq - n))
    pin.framesForwardKinematics(model, data, q)
    T_base, T_tip = (data.oMf[model.getFrameId(name)] for name in (base, tip))
    pose = arm(tmp_path, convention, rows(table, fixed)).mechanism.at(Q[:n]).pose
    assert absolute_error(pose, (T_base.inverse() * T_tip).homogeneous) <= 1e-6


def test_prismatic_joints_base_and_tool(tmp_path):
    """A SCARA by hand: l1, l2 along x, q3 down, tool 20 mm below; the base stands at 1 m."""
    elastic = cartstiff.load(
        write_file(
            tmp_path,
            "scara",
            kind="serial",
            dh={
                "convention": "standard",
                "units": {"length": "mm", "angle": "deg"},
                "joints": [
                    {"name": "shoulder", "a": 350, "limits": [-150, 150]},
                    {"name": "elbow", "a": 300, "alpha": 180},
                    {"name": "lift", "type": "prismatic", "d": 50, "limits": [0, 200]},
                    {"name": "wrist", "theta": 90},
                ],
            },
            base={"xyz": [0, 0, 1]},
            offset={"xyz": [0, 0, 0.02]},
        )
    )
    a, b, lift, wrist = 0.4, -0.9, 0.08, 0.2
    pose = elastic.mechanism.at(np.array([a, b, lift, wrist])).pose
    x, y = 0.35 * cos(a) + 0.3 * cos(a + b), 0.35 * sin(a) + 0.3 * sin(a + b)
    np.testing.assert_allclose(pose[:3, 3], [x, y, 1 - (0.05 + lift + 0.02)], atol=1e-14)
    turn = a + b - wrist - pi / 2  # below the turned elbow angles count downwards
    np.testing.assert_allclose(pose[:2, 0], [cos(turn), sin(turn)], atol=1e-14)
    limits = [(c.lower, c.upper) for c in elastic.mechanism.coordinates]
    np.testing.assert_allclose(limits[0], np.deg2rad([-150, 150]))
    np.testing.assert_allclose(limits[2], [0.0, 0.2])
    assert [c.is_length for c in elastic.mechanism.coordinates] == [False, False, True, False]


CSV = """joint;type;a [mm];alpha [deg];d [mm];lower [deg];upper [deg];lower [mm];upper [mm]
base;;0;90;89,159;-360;360;;
shoulder;revolute;-425;;;-360;360;;
elbow;revolute;-392,25;;;-180;180;;
wrist 1;revolute;;90;109,15;;;;
wrist 2;revolute;;-90;94,65;;;;
wrist 3;revolute;;;82,3;;;;
slide;prismatic;;;;;;-50;50
"""


def test_table_of_a_catalogue(tmp_path):
    (tmp_path / "ur5.csv").write_text(CSV, encoding="utf-8")
    dh = {"convention": "standard", "table": "ur5.csv"}
    elastic = cartstiff.load(write_file(tmp_path, "ur5", kind="serial", dh=dh))
    assert list(elastic.names[:3]) == ["base", "shoulder", "elbow"]
    q = np.append(Q[:6], 0.01)
    shifted = product(standard, UR5, Q[:6]) @ standard(0, 0, 0.01, 0)
    assert absolute_error(elastic.mechanism.at(q).pose, shifted) <= 1e-14
    lower = [c.lower for c in elastic.mechanism.coordinates]
    np.testing.assert_allclose(lower, [-2 * pi, -2 * pi, -pi, *[-np.inf] * 3, -0.05])
    assert {"masses-unknown", "stiffness-assumed"} <= {note.code for note in elastic.notes}


def test_engine_and_recorded_program_agree(tmp_path):
    elastic = arm(tmp_path, "modified", rows(PANDA, 1))
    q = Q + 0.1 * np.random.default_rng(0).normal(size=(4, 7))
    recorded, engine = (
        cartstiff.analyse_many(elastic, q, outputs=("pose", "compliance_B"), path=path)
        for path in ("portable", "engine")
    )
    assert recorded.fallback == 0
    for name in ("pose", "compliance_B"):
        np.testing.assert_allclose(recorded[name], engine[name], rtol=1e-10, atol=1e-14)
