"""MJCF files: what is refused, and kinematics and springs against MuJoCo itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartstiff import load
from cartstiff.loading.robot_description import read_robot_description

Refused = Callable[..., str]
Accepted = Callable[..., dict[str, Any]]

ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <default>
    <joint stiffness="5"/>
    <default class="soft"><joint stiffness="7" axis="0 1 0"/></default>
  </default>
  <worldbody>
    <body name="a" pos="0 0 1">
      <joint name="j1" axis="0 0 1" range="-1 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="b" pos="1 0 0">
        <joint name="j2" class="soft"/>
        <geom type="sphere" size=".1"/>
        <site name="tip" pos="0 0 1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def changed(old: str, new: str, count: int = 1) -> str:
    assert old in ARM
    return ARM.replace(old, new, count)


def place(text: str | bytes, name: str = "arm.xml") -> str:
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return name


NUMBERS = ["a b c", "0 0", "0 0 0 0", "nan 0 0", "0 inf 0", "", "0 0 1e200", "0x1 0 0", "0,0,1"]
PLACES = {
    "body pos": ('<body name="a" pos="0 0 1">', '<body name="a" pos="{}">', "body 'a': pos"),
    "body euler": ('<body name="a"', '<body name="a" euler="{}"', "body 'a': euler"),
    "body zaxis": ('<body name="a"', '<body name="a" zaxis="{}"', "body 'a': zaxis"),
    "joint axis": ('axis="0 0 1" range', 'axis="{}" range', "joint 'j1': axis"),
    "joint pos": ('name="j1"', 'name="j1" pos="{}"', "joint 'j1': pos"),
    "default axis": ('stiffness="7" axis="0 1 0"', 'axis="{}"', "joint: axis"),
    "site pos": ('name="tip" pos="0 0 1"', 'name="tip" pos="{}"', "site 'tip': pos"),
    "inertial pos": ('inertial pos="0 0 0"', 'inertial pos="{}"', "inertial: pos"),
    "inertia": ('diaginertia="1 1 1"', 'diaginertia="{}"', "inertial: diaginertia"),
}


@pytest.mark.parametrize("text", NUMBERS)
@pytest.mark.parametrize("where", PLACES)
def test_bad_numbers_are_refused(where: str, text: str, refused: Refused) -> None:
    # Pinocchio itself takes all of them, and goes on with what happens to stand in memory.
    old, new, words = PLACES[where]
    refused(
        "analyse",
        place(changed(old, new.format(text))),
        words=("arm.xml", words, "3 finite number", repr(text)),
    )


BODY_A, JOINT_1, TIP = '<body name="a" pos="0 0 1"', 'name="j1"', '<site name="tip" pos="0 0 1"/>'
END = "</worldbody>"
BAD: dict[str, tuple[str | bytes, tuple[str, ...]]] = {
    "empty": ("", ("file is empty",)),
    "nothing in it": ("<mujoco/>", ("no bodies",)),
    "no bodies": ("<mujoco><worldbody/></mujoco>", ("no bodies",)),
    "only a floor": (
        '<mujoco><worldbody><geom type="plane"/></worldbody></mujoco>',
        ("no bodies",),
    ),
    "no joints": (
        '<mujoco><worldbody><body name="a"/></worldbody></mujoco>',
        ("no movable joints",),
    ),
    "include": (changed("<worldbody>", '<include file="x.xml"/><worldbody>'), ("includes",)),
    "include of itself": (changed(TIP, '<include file="arm.xml"/>'), ("includes",)),
    "DOCTYPE": ("<!DOCTYPE mujoco>" + ARM, ("document types",)),
    "namespace": (changed("<mujoco ", '<mujoco xmlns="http://x" '), ("not a robot description",)),
    "cut off": (ARM[:200], ("not valid XML", "line")),
    "zero quaternion": (changed(BODY_A, BODY_A + ' quat="0 0 0 0"'), ("'a'", "zero quat")),
    "quaternion of three": (changed(BODY_A, BODY_A + ' quat="1 0 0"'), ("quat is not 4",)),
    "zero axis": (changed('axis="0 0 1"', 'axis="0 0 0"'), ("'j1'", "zero axis")),
    "zero z axis": (changed(BODY_A, BODY_A + ' zaxis="0 0 0"'), ("'a'", "zero zaxis")),
    "axis of no angle": (changed(BODY_A, BODY_A + ' axisangle="0 0 0 1"'), ("'a'", "zero axis")),
    "parallel axes": (changed(BODY_A, BODY_A + ' xyaxes="1 0 0 2 0 0"'), ("'a'", "parallel")),
    "two orientations": (changed(BODY_A, BODY_A + ' euler="1 0 0" zaxis="1 0 0"'), ("several",)),
    "range of one": (changed('"-1 1"', '"1"'), ("'j1': range is not 2", "'1'")),
    "range NaN": (changed('"-1 1"', '"nan 1"'), ("'j1': range",)),
    "range reversed": (changed('"-1 1"', '"1 -1"'), ("'j1': range is the wrong way round",)),
    "unknown joint type": (
        changed(JOINT_1, JOINT_1 + ' type="screw"'),
        ("'j1'", "hinge", "'screw'"),
    ),
    "stiffness text": (
        changed(JOINT_1, JOINT_1 + ' stiffness="soft"'),
        ("'j1': stiffness", "'soft'"),
    ),
    "stiffness NaN": (changed(JOINT_1, JOINT_1 + ' stiffness="nan"'), ("'j1': stiffness",)),
    "stiffness negative": (
        changed(JOINT_1, JOINT_1 + ' stiffness="-1"'),
        ("stiffness is negative",),
    ),
    "stiffness too large": (changed(JOINT_1, JOINT_1 + ' stiffness="1e300"'), ("stiffness",)),
    "default stiffness text": (changed('"7"', '"soft"'), ("stiffness", "'soft'")),
    "springref text": (changed(JOINT_1, JOINT_1 + ' springref="x"'), ("'j1': springref", "'x'")),
    "springref of two": (changed(JOINT_1, JOINT_1 + ' springref="1 2"'), ("'j1': springref",)),
    "ref infinite": (changed(JOINT_1, JOINT_1 + ' ref="inf"'), ("'j1': ref",)),
    "ref of several joints": (
        changed('<joint name="j1"', '<joint name="j0" ref="1"/><joint name="j1"'),
        ("'j0'", "ref"),
    ),
    "unknown class": (changed('class="soft"/>', 'class="hard"/>'), ("default class", "'hard'")),
    "unknown childclass": (changed(BODY_A, BODY_A + ' childclass="hard"'), ("class", "'hard'")),
    "class without name": (changed('<default class="soft">', "<default>"), ("class has no name",)),
    "two bodies of a name": (changed('name="b"', 'name="a"'), ("two bodies", "'a'")),
    "body named world": (changed('name="b"', 'name="world"'), ("two bodies", "'world'")),
    "two joints of a name": (changed('"j2"', '"j1"'), ("two joints", "'j1'")),
    "joint of the world": (changed("<worldbody>", '<worldbody><joint name="w"/>'), ("worldbody",)),
    "free and hinged": (
        changed('<joint name="j1"', '<freejoint/><joint name="j1"'),
        ("free joint",),
    ),
    "mass negative": (changed('mass="1"', 'mass="-1"'), ("mass is negative",)),
    "mass NaN": (changed('mass="1"', 'mass="nan"'), ("mass", "'nan'")),
    "mass missing": (changed(' mass="1"', ""), ("body a", "no mass")),
    "size text": (changed('size=".1"', 'size="big"'), ("geom: size", "'big'")),
    "frames": (changed(TIP, '<frame pos="1 0 0"><body/></frame>'), ("<frame> is not supported",)),
    "replicate": (changed(TIP, '<replicate count="3"><body/></replicate>'), ("<replicate>",)),
    "composite": (changed(TIP, '<composite type="cable"/>'), ("<composite>",)),
    "attach": (changed(TIP, '<attach model="x" body="y" prefix="z"/>'), ("<attach>",)),
    "unknown angle": (changed('"radian"', '"gon"'), ("compiler angle", "'gon'")),
    "global coordinates": (changed('"radian"', '"radian" coordinate="global"'), ("coordinate",)),
    "unknown sequence": (changed('"radian"', '"radian" eulerseq="xyw"'), ("eulerseq", "'xyw'")),
    "tie to nobody": (
        changed(END, END + '<equality><weld body1="a" body2="x"/></equality>'),
        ("weld", "body", "'x'"),
    ),
    "tie at two numbers": (
        changed(END, END + '<equality><connect body1="a" body2="b" anchor="0 0"/></equality>'),
        ("connect", "anchor"),
    ),
    "deep classes": (
        changed(
            END, END + "".join(f'<default class="c{i}">' for i in range(2000)) + "</default>" * 2000
        ),
        ("classes are nested too deeply",),
    ),
    "deep bodies": (
        changed(TIP, "<body>" * 3000 + "</body>" * 3000),
        ("bodies are nested too deeply",),
    ),
    "5000 joints": (
        changed(TIP, "".join(f'<body><joint name="q{i}"/></body>' for i in range(5000))),
        ("too many joints", "5002"),
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_mjcf_is_refused(case: str, refused: Refused) -> None:
    text, words = BAD[case]
    refused("analyse", place(text), words=words)


# -- what must not be refused ---------------------------------------------------------------------

SAME: dict[str, str | bytes] = {
    "byte order mark": b"\xef\xbb\xbf" + ARM.encode(),
    "carriage returns": ARM.replace("\n", "\r\n").encode(),
    "no names of bodies": changed(' name="a"', ""),
    "meshes that are not there": changed(END, END + '<asset><mesh file="none.stl"/></asset>'),
    "mesh shape": changed('type="sphere" size=".1"', 'type="mesh" mesh="none"'),
    "texture that is not there": changed(END, END + '<asset><texture file="x.png"/></asset>'),
    "keyframe of another model": changed(END, END + '<keyframe><key qpos="1 2 3"/></keyframe>'),
    "actuators and sensors": changed(END, END + '<actuator><motor joint="x"/></actuator><sensor/>'),
    "damping text": changed(JOINT_1, JOINT_1 + ' damping="some" armature="x"'),
    "two worldbodies": changed(BODY_A, "</worldbody><worldbody>" + BODY_A.replace("\n", "")),
    "options": changed(END, END + '<option gravity="0 0"/><size/><visual/><statistic/>'),
    "lights and cameras": changed(
        "<worldbody>", "<worldbody><light/><camera/><geom type='plane'/>"
    ),
    "deep and strange": changed(TIP, TIP + "<x>" * 3000 + "</x>" * 3000),
    "inactive tie": changed(
        END, END + '<equality><weld body1="a" body2="b" active="false"/></equality>'
    ),
    "quaternion not of unit length": changed(BODY_A, BODY_A + ' quat="3 0 0 0"'),
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_arm_in_other_words(case: str, accepted: Accepted) -> None:
    options = ("--q", "0.3,-0.2", "--frame", "tip")
    place(ARM, "plain.xml")
    got, expected = accepted(place(SAME[case]), *options), accepted("plain.xml", *options)
    assert np.allclose(got["pose"], expected["pose"], atol=1e-14)
    assert np.allclose(got["compliance"]["B"], expected["compliance"]["B"], rtol=1e-12, atol=1e-14)


def test_joints_without_names_get_some(accepted: Accepted) -> None:
    text = changed(' name="j2"', "").replace('"j1"', '"joint2"')
    assert accepted(place(text))["mechanism"]["joints"] == ["joint2", "joint3"]


def test_default_classes_and_childclass() -> None:
    text = changed(BODY_A, BODY_A + ' childclass="soft"').replace(
        '<joint name="j2" class="soft"/>', '<joint name="j2"/><joint name="j3" class="main"/>'
    )
    elastic = load(place(text))
    assert elastic.names == ("j1", "j2", "j3")
    assert elastic.springs.stiffness.tolist() == [7.0, 7.0, 5.0]


# -- against MuJoCo -------------------------------------------------------------------------------

TWO = """<mujoco><compiler {compiler}/>{default}<worldbody>
<body name="a" pos="0.1 0.2 1" {orientation}>{joints}<geom size=".1"/>
<body name="e" pos="1 0 .5"><joint name="last" axis="0 1 0.3" pos=".1 .2 .3"/><geom size=".1"/>
</body></body></worldbody></mujoco>"""

JOINTS = {
    "hinge": '<joint name="j" axis="0 0 1"/>',
    "hinge askew": '<joint name="j" axis="1 2 -3" pos="0.3 -0.1 0.2"/>',
    "hinge with springref": '<joint name="j" axis="0 1 1" stiffness="3" springref="0.4"/>',
    "hinge with ref": '<joint name="j" axis="0 1 1" ref="0.3" stiffness="3" springref="0.4"/>',
    "slide": '<joint name="j" type="slide" axis="1 0 2"/>',
    "slide with ref": '<joint name="j" type="slide" ref="0.3" stiffness="3" springref="0.4"/>',
    "two hinges": '<joint name="j" axis="0 0 1" pos="1 0 0"/>'
    '<joint name="k" axis="0 1 0" pos="0 1 0"/>',
    "slide and hinge": '<joint name="j" type="slide" axis="0 1 1"/><joint name="k" pos="0 1 0"/>',
    "three hinges": '<joint name="j"/><joint name="k" axis="1 0 0"/><joint name="l" axis="0 1 0"/>',
    "springs in several": '<joint name="j" stiffness="2" springref="0.2"/><joint name="k" '
    'axis="1 0 0" stiffness="4"/>',
}
ORIENTATIONS = {
    "degrees": ('angle="degree"', 'euler="10 20 30"'),
    "radians": ('angle="radian"', 'euler="0.1 0.2 0.3"'),
    "sequence": ('angle="radian" eulerseq="ZYX"', 'euler="0.1 0.2 0.3"'),
    "quaternion": ("", 'quat="1 2 0.5 -1"'),
    "axis and angle": ("", 'axisangle="1 2 3 40"'),
    "two axes": ("", 'xyaxes="1 1 0 0 1 1"'),
    "z axis": ("", 'zaxis="1 2 3"'),
}


def in_mujoco(text: str) -> tuple[Any, Any, Any]:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    return mujoco, model, mujoco.MjData(model)


@pytest.mark.parametrize("joints", JOINTS)
@pytest.mark.parametrize("orientation", ["degrees", "radians"])
def test_kinematics_and_springs_as_in_mujoco(joints: str, orientation: str) -> None:
    compiler, turned = ORIENTATIONS[orientation]
    text = TWO.format(compiler=compiler, default="", orientation=turned, joints=JOINTS[joints])
    mujoco, model, data = in_mujoco(text)
    q = np.random.default_rng(3).uniform(-1, 1, model.nq)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    elastic = load(place(text), frame="e")
    posture = elastic.mechanism.at(q)
    assert np.allclose(posture.pose[:3, 3], data.body("e").xpos, atol=1e-14)
    assert np.allclose(posture.pose[:3, :3].ravel(), data.body("e").xmat, atol=1e-14)
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacBody(model, data, linear, angular, model.body("e").id)
    R = posture.pose[:3, :3]
    expected = np.vstack([R.T @ angular, R.T @ linear])
    assert np.allclose(posture.motion.jacobian, expected, atol=1e-14)
    if "stiffness" in JOINTS[joints]:
        torque = elastic.balanced(q).springs.evaluate(posture).gradient
        assert np.allclose(torque, -data.qfrc_spring, atol=1e-13)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_orientations_as_in_mujoco(orientation: str) -> None:
    compiler, turned = ORIENTATIONS[orientation]
    text = TWO.format(compiler=compiler, default="", orientation=turned, joints=JOINTS["hinge"])
    mujoco, model, data = in_mujoco(text)
    mujoco.mj_forward(model, data)
    posture = load(place(text), frame="e").mechanism.at([0, 0])
    assert np.allclose(posture.pose[:3, :3].ravel(), data.body("e").xmat, atol=1e-14)


@pytest.mark.parametrize("kind", ["ball", "free"])
def test_ball_and_free_joints_reach_what_mujoco_reaches(kind: str) -> None:
    text = TWO.format(
        compiler="", default="", orientation="", joints=f'<joint name="j" type="{kind}"/>'
    )
    mujoco, model, data = in_mujoco(text)
    elastic = load(place(text), frame="e")
    names = [f"j.{axis}" for axis in ("x", "y", "z")]
    if kind == "free":
        names += ["j.rx", "j.ry", "j.rz"]
    assert list(elastic.names) == [*names, "last"]
    q = np.random.default_rng(4).uniform(-1, 1, len(names) + 1)
    turns = q[-4:-1]
    # Turns about x, then the new y, then the new z, as one quaternion.
    quaternion = np.array([1.0, 0, 0, 0])
    for axis, angle in enumerate(turns):
        step = np.zeros(4)
        step[0], step[axis + 1] = np.cos(angle / 2), np.sin(angle / 2)
        product = np.zeros(4)
        mujoco.mju_mulQuat(product, quaternion, step)
        quaternion = product
    data.qpos[-5:-1], data.qpos[-1] = quaternion, q[-1]
    posture = elastic.mechanism.at(q)
    if kind == "free":
        # MuJoCo counts a free body's position from the world's origin.
        zero = elastic.mechanism.at(np.zeros(len(q)))
        offset = np.array([0.1, 0.2, 1.0])
        if np.allclose(zero.pose[:3, 3], [1, 0, 0.5], atol=1e-12):
            offset = np.zeros(3)
        data.qpos[:3] = q[:3] + offset
    mujoco.mj_forward(model, data)
    assert np.allclose(posture.pose[:3, :3].ravel(), data.body("e").xmat, atol=1e-14)
    assert np.allclose(posture.pose[:3, 3], data.body("e").xpos, atol=1e-14)


def test_spring_of_a_ball_joint_is_said_to_play_no_part() -> None:
    text = TWO.format(
        compiler="",
        default="",
        orientation="",
        joints='<joint name="j" type="ball" stiffness="3"/>',
    )
    facts = read_robot_description(Path(place(text))).mjcf
    assert facts is not None
    assert facts.ignored == ("stiffness of the ball joint 'j'",)


def test_springref_is_in_degrees_unless_the_file_says_radians() -> None:
    joints = '<joint name="j" stiffness="3" springref="60"/>'
    for compiler, expected in (
        ("", np.pi / 3),
        ('angle="degree"', np.pi / 3),
        ('angle="radian"', 60),
    ):
        text = TWO.format(compiler=compiler, default="", orientation="", joints=joints)
        assert load(place(text)).springs.rest[0] == pytest.approx(expected, rel=1e-15)


def test_springref_of_a_slide_is_a_length() -> None:
    joints = '<joint name="j" type="slide" stiffness="3" springref="0.25"/>'
    text = TWO.format(compiler="", default="", orientation="", joints=joints)
    assert load(place(text)).springs.rest[0] == 0.25
