"""Trees of parallel machines: what does not act on the chosen frame is named before the answer."""

from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest
from tests.support.commands import answer, run

import cartstiff

CRANK, ROD = 0.2, 0.4


def joint(name, parent, child, xyz, axis, yaw=0.0):
    return (
        f'<link name="{child}"/><joint name="{name}" type="continuous"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}" rpy="0 0 {yaw}"/><axis xyz="{axis}"/></joint>'
    )


def delta(extra="", rods=(ROD, ROD, ROD)):
    """A delta as drawing programs export it: the platform hangs on the first leg alone."""
    parts = ['<robot name="machine"><link name="base"/>']
    for i, rod in enumerate(rods):
        a = 2 * pi * i / 3
        parts += [
            joint(f"motor_{i}", "base", f"crank_{i}", f"{cos(a) / 9} {sin(a) / 9} 0", "0 1 0", a),
            joint(f"elbow_{i}", f"crank_{i}", f"rod_{i}", f"{CRANK} 0 0", "0 1 0"),
            joint(f"swing_{i}", f"rod_{i}", f"end_{i}", f"{rod} 0 0", "0 0 1"),
        ]
    parts += [joint("wrist", "end_0", "platform", "0.1 0 0", "0 1 0"), extra, "</robot>"]
    return "".join(parts)


def transmissions(*names):
    return "".join(
        f'<transmission name="of_{n}"><type>x</type><joint name="{n}"/></transmission>'
        for n in names
    )


def springs(*names):
    return "".join(
        f'<gazebo reference="{n}"><springStiffness>900</springStiffness></gazebo>' for n in names
    )


def notes_of(text, code, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return [note for note in cartstiff.load(path).notes if note.code == code]


def test_legs_beside_that_of_the_frame_are_named(tmp_path):
    (note,) = notes_of(delta(), "open-loops", tmp_path)
    beside = [f"{kind}_{leg}" for leg in (1, 2) for kind in ("motor", "elbow", "swing")]
    assert note.values == {"frame": "platform", "joints": beside}
    assert note.message.startswith(
        "'platform' is at the end of one of 3 equal chains, and joints beside it do not act: "
        "motor_1, elbow_1, swing_1, motor_2, elbow_2, swing_2. If they hold the same body"
    )


def test_springs_beside_the_chain_are_counted(tmp_path):
    text = delta(springs("motor_0", "motor_1", "motor_2"))
    (note,) = notes_of(text, "idle-springs", tmp_path)
    assert note.message == (
        "2 joints with springs are not on the chain to 'platform' and do not act: motor_1, motor_2"
    )
    text = delta(springs("motor_0", "elbow_2"))
    (note,) = notes_of(text, "idle-springs", tmp_path)
    assert note.message == (
        "1 joint with a spring is not on the chain to 'platform' and does not act: elbow_2"
    )
    assert not notes_of(delta(springs("motor_0")), "idle-springs", tmp_path)


@pytest.mark.parametrize("driven", [["motor_1"], ["motor_0", "motor_1"]])
def test_actuators_beside_a_chain_that_has_too_few_are_named(driven, tmp_path):
    # Rods of different lengths: nothing but the actuators tells.
    unequal = delta(transmissions(*driven), rods=(0.4, 0.5))
    (note,) = notes_of(unequal, "open-loops", tmp_path)
    assert note.message.startswith("no actuator drives ")
    assert note.values["joints"] == ["motor_1"]
    assert not notes_of(delta(rods=(0.4, 0.5)), "open-loops", tmp_path)


ARM = "".join(
    joint(f"a{i}", "base" if i == 0 else f"l{i - 1}", f"l{i}", f"0 0 {0.1 + i / 9}", "0 1 0")
    for i in range(4)
)
MOTORS = transmissions("a0", "a1", "a2", "a3")
GRIPPER = "".join(
    joint(f"g{i}", "l3", f"g{i}", f"0.1 0 {0.05 * i}", "0 1 0")
    + joint(f"h{i}", f"g{i}", f"h{i}", "0.1 0 0", "0 1 0")
    for i in range(3)
)
HEAD = joint("pan", "base", "pan", "0 0 1", "0 0 1") + joint("tilt", "pan", "t", "0 0 0.1", "0 1 0")
WHEELS = "".join(
    joint(f"steer{i}", "base", f"s{i}", f"{i} 1 0", "0 0 1")
    + joint(f"wheel{i}", f"s{i}", f"w{i}", "0 0 -0.2", "0 1 0")
    for i in range(4)
)
SECOND_ARM = "".join(
    joint(f"b{i}", "base" if i == 0 else f"m{i - 1}", f"m{i}", f"0 0 {0.1 + i / 9}", "0 1 0")
    for i in range(4)
)


@pytest.mark.parametrize(
    "beside",
    [
        GRIPPER + MOTORS + transmissions("g0", "g1", "g2"),
        HEAD + MOTORS + transmissions("pan", "tilt"),
        WHEELS + MOTORS,
        SECOND_ARM + MOTORS + transmissions("b0", "b1", "b2", "b3"),
        # A differential's transmissions name no joint.
        SECOND_ARM + transmissions("a0", "a1", "a2", "b0", "b1"),
    ],
    ids=["gripper", "head", "wheels", "second arm", "differential"],
)
def test_arms_are_not_doubted(beside, tmp_path):
    text = f'<robot name="arm"><link name="base"/>{ARM}<link name="tool0"/><joint name="f" '
    text += 'type="fixed"><parent link="l3"/><child link="tool0"/></joint>' + beside + "</robot>"
    for code in ("open-loops", "idle-springs"):
        assert not notes_of(text, code, tmp_path)


def test_a_tree_with_open_loops_answers_for_one_leg_and_says_so():
    """Of a five-bar linkage: the tip on both cranks, and on two sprung hinges of one arm."""
    robots = Path(cartstiff.__file__).parents[2] / "robots"
    closed = answer("analyse", robots / "five-bar.yaml")
    assert "open-loops" not in [note["code"] for note in closed["notes"]]
    q = dict(zip(closed["mechanism"]["joints"], closed["q"], strict=True))
    tip = np.array(closed["pose"])[:2, 3]
    R = np.array(closed["pose"])[:2, :2]
    rates = []
    for motor, at in zip(("left_motor", "right_motor"), (-0.15, 0.15), strict=True):
        elbow = np.array([at, 0.0]) + 0.25 * np.array([cos(q[motor]), sin(q[motor])])
        across = 0.25 * np.array([-sin(q[motor]), cos(q[motor])])
        rates.append((tip - elbow) / ((tip - elbow) @ across))
    of_both = np.linalg.inv(800.0 * np.array(rates).T @ np.array(rates))
    C = np.array(closed["compliance"]["B"])[3:5, 3:5]
    np.testing.assert_allclose(R @ C @ R.T, of_both, rtol=1e-9)

    values = f"{q['left_motor']!r},{q['left_elbow']!r}"
    words = ["analyse", robots / "five-bar.urdf", "--q", values, "--stiffness", "800"]
    alone = answer(*words)
    assert alone["notes"][0]["code"] == "open-loops"
    arms = np.array([tip - [-0.15, 0.0], tip - elbow_of(q)])
    J = np.array([[-y, x] for x, y in arms]).T
    C = np.array(alone["compliance"]["B"])[3:5, 3:5]
    np.testing.assert_allclose(R @ C @ R.T, J @ J.T / 800.0, rtol=1e-9)
    assert run(*words).startswith("'tip' is at the end of one of 2 equal chains")


def elbow_of(q):
    """The elbow of the left arm."""
    a = q["left_motor"]
    return np.array([-0.15 + 0.25 * cos(a), 0.25 * sin(a)])
