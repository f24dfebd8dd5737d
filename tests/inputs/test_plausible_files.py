"""What a file says that a person can hardly mean is named; what cannot act is refused."""

import numpy as np
import pytest

import cartstiff
from cartstiff import InputError

ARM = """kind: serial
model: ur5
frame: tool0
springs:
  shoulder_pan_joint: {stiffness: 3.0e4}
  shoulder_lift_joint: {stiffness: 3.0e4}
  elbow_joint: {stiffness: 2.0e4}
  wrist_1_joint: {stiffness: 5.0e3}
  wrist_2_joint: {stiffness: 5.0e3}
  wrist_3_joint: {stiffness: 4.0e3}
"""
ELBOW = "elbow_joint: {stiffness: 2.0e4}"
BODY = """kind: stewart-gough
base: [[5,0,0],[4,3,0],[-2,4.5,0],[-4.5,2,0],[-2,-4.5,0],[3,-4,0]]
platform: [[2,0.5,0],[1.5,1.5,0],[-1.5,1.5,0],[-2,0.5,0],[-0.5,-2,0],[0.5,-2,0]]
pose: {xyz: [0,0,6]}
legs: {stiffness: 20}
"""
SOFT = f"stiffness: {np.diag([1e4] * 3 + [1e6] * 3).tolist()}"
BEAM = "{E: 2.1e11, G: 8.0e10, length: 0.4, area: 0.001, Iy: 1.0e-6, Iz: 1.0e-6, J: 2.0e-6}"
ON_FOREARM = f"flexible: {{forearm_link: {{beam: {BEAM}}}}}\n"


def notes(folder, text):
    path = folder / "made.yaml"
    path.write_text(text, encoding="utf-8")
    return {note.code: note.message for note in cartstiff.load(path).notes}


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (ARM + "offset: {rpy: [0, 90, 0]}\n", "many-turns", "offset.rpy is (0, 90, 0) rad"),
        (ARM + "base: {rpy: [0, 0, -45]}\n", "many-turns", "base.rpy"),
        (BODY.replace("6]}", "6], rpy: [10, 0, 0]}"), "many-turns", "pose.rpy"),
        (ARM.replace(ELBOW, ELBOW[:-1] + ", rest: 80}"), "rest-of-turns", "elbow_joint at 80"),
        (ARM + "offset: {xyz: [0, 0, 150]}\n", "doubtful-units", "offset.xyz"),
        (
            ARM + "gravity: [0, 0, -9.81]\npayload: {mass: 1, com: [0, 0, 60]}\n",
            "doubtful-units",
            "payload.com",
        ),
        (ARM + ON_FOREARM.replace("0.4", "400"), "doubtful-units", "forearm_link.beam.length"),
        (ARM + ON_FOREARM.replace("2.1e11", "210"), "doubtful-units", "Gigapascals"),
        (BODY.replace("[5,0,0]", "[500,0,0]"), "doubtful-units", "base.1 is (500, 0, 0) m"),
        (BODY.replace("20}", "20, rest_length: 0.006}"), "doubtful-units", "stretch of leg 1"),
        (
            ARM + "lines: [{frames: [world, forearm_link], points: [[0, 0, 2], [0, 0, 0]], "
            "stiffness: 9, preload: 400}]\n",
            "doubtful-units",
            "stretch of line 1",
        ),
        (ARM + "payload: {mass: 5}\n", "weightless", "weighs nothing"),
        (BODY + "payload: {mass: 5}\n", "weightless", "weighs nothing"),
        (ARM.replace(ELBOW, "elbow_joint: {polynomial: [-2.0e4]}"), "negative-stiffness", "elbow"),
        (
            ARM.replace(ELBOW, "elbow_joint: {table: [[-1, 1.0e4], [0, 0], [1, -1.0e4]]}"),
            "negative-stiffness",
            "elbow",
        ),
        (
            ARM + f"flexible: {{forearm_link: {{{SOFT.replace('10000', '-10000', 1)}}}}}\n",
            "negative-stiffness",
            "forearm_link",
        ),
        (ARM + f"flexible: {{tool0: {{{SOFT}}}}}\n", "idle-link", "frame 'tool0': tool0"),
    ],
)
def test_what_is_hardly_meant_is_named(tmp_path, text, code, words):
    assert words in notes(tmp_path, text)[code]


DOUBTS = {"many-turns", "rest-of-turns", "doubtful-units", "negative-stiffness", "weightless"}


@pytest.mark.parametrize(
    "text",
    [
        ARM + "offset: {rpy: [0, 1.57, 0]}\n",
        ARM.replace(ELBOW, ELBOW[:-1] + ", rest: 1.4}"),
        ARM + f"flexible: {{forearm_link: {{{SOFT}}}}}\n",
        ARM + ON_FOREARM,
        BODY,
        BODY.replace("20}", "20, rest_length: 0}"),
        BODY + "payload: {mass: 5}\ngravity: [0, 0, -9.81]\n",
        ("units: {length: mm, force: N}\n" + BODY).replace("[5,0,0]", "[500,0,0]"),
    ],
)
def test_what_is_meant_is_not(tmp_path, text):
    assert not DOUBTS & set(notes(tmp_path, text))


def test_a_payload_weighs_where_gravity_is_added(tmp_path):
    path = tmp_path / "made.yaml"
    path.write_text(ARM + "payload: {mass: 5}\n", encoding="utf-8")
    arm = cartstiff.load(path).with_gravity()
    assert "weightless" not in {note.code for note in arm.notes}
    assert arm.masses["payload"] == 5.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            ARM + "lines: [{frames: [tool0, wrist_3_link], points: [[0,0,1],[0,0,0]], "
            "stiffness: 1000}]\n",
            "never changes its length",
        ),
    ],
)
def test_what_cannot_act_is_refused(tmp_path, text, words):
    with pytest.raises(InputError, match=words):
        notes(tmp_path, text)


URDF = """<robot name="r"><link name="w"/><link name="a"/><joint name="j" type="continuous">
<parent link="w"/><child link="a"/><origin xyz="0 0 0.4" rpy="0 0 0"/><axis xyz="0 0 1"/></joint>
</robot>"""
GAZEBO = '<gazebo reference="j"><springStiffness>100</springStiffness></gazebo></robot>'


@pytest.mark.parametrize(
    ("changed", "code", "words"),
    [
        (URDF.replace('rpy="0 0 0"', 'rpy="0 90 0"'), "many-turns", "rpy of joint j"),
        (URDF.replace("0 0 0.4", "0 0 400"), "doubtful-units", "xyz of joint j"),
    ],
)
def test_urdf_that_is_hardly_meant_is_named(changed, code, words):
    assert DOUBTS.isdisjoint(note.code for note in cartstiff.load(URDF).notes)
    found = {note.code: note.message for note in cartstiff.load(changed).notes}
    assert words in found[code]


def test_springs_beside_the_joints_of_a_urdf_act():
    assert cartstiff.load(URDF.replace("</robot>", GAZEBO)).springs.stiffness == [100.0]
    dynamics = '<dynamics spring_stiffness="5"/></joint>'
    assert cartstiff.load(URDF.replace("</joint>", dynamics)).springs.stiffness == [5.0]


def test_degrees_beside_the_file_are_named():
    arm = cartstiff.load("ur5", tcp=[0, 0, 0.1, 0, 90, 0], rest={"elbow_joint": 80.0})
    found = {note.code: note.message for note in arm.notes}
    assert "(0, 90, 0) rad" in found["many-turns"]
    assert "elbow_joint at 80 rad" in found["rest-of-turns"]
    assert "rest-of-turns" not in {note.code for note in arm.with_springs(rest=arm.q).notes}
    pose = [0, 0, 0.75, np.pi / 6, 0, 30.0]
    turned = cartstiff.analyse(cartstiff.load("hexapod"), pose)
    assert "yaw is at 30 rad" in {n.code: n.message for n in turned.notes}["many-turns"]
