"""Line springs that hold a mechanism alone: no joint spring is assumed beside them."""

import numpy as np
import pytest

from cartstiff import analyse, load

PLATE = """<mujoco><worldbody><site name="p1" pos="-1 0 2"/><site name="p2" pos="1 0 2"/>
<body name="plate" pos="0 0 1"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="z" type="slide" axis="0 0 1"/><geom type="box" size=".1 .05 .02" mass="2"/>
<site name="a" pos="-.1 0 .02"/><site name="b" pos=".1 0 .02"/></body></worldbody>
<tendon><spatial name="c1" stiffness="5000" springlength="1.3"><site site="p1"/><site site="a"/>
</spatial><spatial name="c2" stiffness="5000" springlength="1.3"><site site="p2"/><site site="b"/>
</spatial></tendon>{actuator}</mujoco>"""

URDF = """<robot name="plate"><link name="base"/><link name="cart"/><link name="plate"/>
<joint name="x" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<origin xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="z" type="prismatic"><parent link="cart"/><child link="plate"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""

SERIAL = """kind: serial
model: plate.urdf
frame: plate
{more}
lines:
  - {{frames: [base, plate], points: [[-1, 0, 2], [-0.1, 0, 0.02]], stiffness: 5000,
      rest_length: 1.3}}
  - {{frames: [base, plate], points: [[1, 0, 2], [0.1, 0, 0.02]], stiffness: 5000,
      rest_length: 1.3}}
"""


def stiffness_by_hand():
    """K along x and z of the two springs, k u u^T + t / L (I - u u^T) each."""
    K = np.zeros((2, 2))
    for side in (-1.0, 1.0):
        along = np.array([0.9 * side, 0.98])
        length = np.linalg.norm(along)
        u = along / length
        tension = 5000.0 * (length - 1.3)
        K += 5000.0 * np.outer(u, u) + tension / length * (np.eye(2) - np.outer(u, u))
    return K


def along_x_and_z(elastic):
    result = analyse(elastic)
    return np.linalg.inv(result.compliance.matrix[np.ix_([3, 5], [3, 5])])


def codes(elastic):
    return {note.code: note for note in elastic.notes}


@pytest.fixture
def mjcf(tmp_path):
    def written(actuator=""):
        path = tmp_path / "plate.xml"
        path.write_text(PLATE.format(actuator=actuator), encoding="utf-8")
        return load(path, frame="plate")

    return written


@pytest.fixture
def serial(tmp_path):
    def written(more=""):
        (tmp_path / "plate.urdf").write_text(URDF, encoding="utf-8")
        path = tmp_path / "plate.yaml"
        path.write_text(SERIAL.format(more=more), encoding="utf-8")
        return load(path)

    return written


@pytest.mark.parametrize("door", ["mjcf", "serial"])
def test_nothing_is_assumed_beside_line_springs(door, request):
    elastic = request.getfixturevalue(door)()
    np.testing.assert_allclose(along_x_and_z(elastic), stiffness_by_hand(), rtol=1e-9, atol=1e-6)
    assert "stiffness-assumed" not in codes(elastic)
    note = codes(elastic)["held-by-lines"]
    assert note is elastic.notes[0]
    assert note.values["joints"] == ["x", "z"]
    assert "--stiffness" in note.message


def test_an_actuated_joint_keeps_its_assumed_spring(mjcf):
    elastic = mjcf('<actuator><motor joint="z"/></actuator>')
    expected = stiffness_by_hand() + np.diag([0.0, 1e4])
    np.testing.assert_allclose(along_x_and_z(elastic), expected, rtol=1e-9, atol=1e-6)
    assert codes(elastic)["stiffness-assumed"].values["joints"] == ["z"]
    assert codes(elastic)["held-by-lines"].values["joints"] == ["x"]


def test_joints_that_are_named_passive_need_no_note(serial):
    elastic = serial("passive: [x, z]")
    np.testing.assert_allclose(along_x_and_z(elastic), stiffness_by_hand(), rtol=1e-9, atol=1e-6)
    assert not {"held-by-lines", "stiffness-assumed"} & codes(elastic).keys()


def test_where_some_are_named_passive_the_others_are_driven(serial):
    elastic = serial("passive: [x]")
    expected = stiffness_by_hand() + np.diag([0.0, 1e4])
    np.testing.assert_allclose(along_x_and_z(elastic), expected, rtol=1e-9, atol=1e-6)
    assert codes(elastic)["stiffness-assumed"].values["joints"] == ["z"]


def test_springs_that_are_given_end_the_note(mjcf):
    elastic = mjcf().with_springs({"x": 700.0})
    expected = stiffness_by_hand() + np.diag([700.0, 0.0])
    np.testing.assert_allclose(along_x_and_z(elastic), expected, rtol=1e-9, atol=1e-6)
    assert codes(elastic)["held-by-lines"].values["joints"] == ["z"]
    assert "held-by-lines" not in codes(elastic.with_springs({"z": 1.0}))
