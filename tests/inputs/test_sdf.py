"""SDF files: springs, frames of all kinds, and what is refused.

Poses are compared with chains of SciPy's rotations written by hand, and with rod's own resolution
of the same file.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cartstiff
from cartstiff.errors import CartstiffError, InputError

rod = pytest.importorskip("rod")

MASS = (
    "<inertial><mass>2</mass><pose>0 0 0.1 0 0 0</pose><inertia><ixx>0.1</ixx><iyy>0.2</iyy>"
    "<izz>0.15</izz></inertia></inertial>"
)
ARM = f"""<?xml version="1.0"?>
<sdf version="1.9"><model name="arm">
  <pose>0.5 0 0 0 0 0.25</pose>
  <link name="base">{MASS}</link>
  <joint name="foot" type="fixed"><parent>world</parent><child>base</child></joint>
  <link name="upper"><pose relative_to="shoulder">0 0 0.2 0 0.5 0.3</pose>{MASS}
    <visual name="v"><geometry><box><size>0.1 0.1 0.4</size></box></geometry></visual></link>
  <joint name="shoulder" type="revolute"><pose relative_to="base">0 0 0.1 0.2 0 0</pose>
    <parent>base</parent><child>upper</child>
    <axis><xyz>0 0 1</xyz><limit><lower>-3</lower><upper>2.5</upper></limit>
      <dynamics><spring_stiffness>1000</spring_stiffness><spring_reference>0.2</spring_reference>
        <damping>0.5</damping></dynamics></axis></joint>
  <link name="slide"><pose relative_to="rail"/>{MASS}</link>
  <joint name="rail" type="prismatic">
    <pose relative_to="upper">0.3 0 0.1 0 1.5707963267948966 0</pose>
    <parent>upper</parent><child>slide</child>
    <axis><xyz expressed_in="base">0 1 0</xyz><dynamics><spring_stiffness>5e4</spring_stiffness>
      <spring_reference>0</spring_reference></dynamics></axis></joint>
  <frame name="tool" attached_to="slide"><pose degrees="true">0 0 0.2 90 0 0</pose></frame>
</model></sdf>
"""


def at(x: float, y: float, z: float, r: float = 0.0, p: float = 0.0, w: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("xyz", [r, p, w]).as_matrix(), (x, y, z)
    return T


def test_an_arm_with_springs(tmp_path):
    path = tmp_path / "arm.sdf"
    path.write_text(ARM)
    arm = cartstiff.load(path)
    assert arm.names == ("shoulder", "rail")
    assert arm.mechanism.frame == "tool"
    assert arm.springs.stiffness.tolist() == [1000.0, 5e4]
    assert arm.springs.rest.tolist() == [0.2, 0.0]
    assert arm.limits["shoulder"] == (-3.0, 2.5)
    assert arm.damping.tolist() == [0.5, 0.0]
    turn, slide = 0.7, 0.05
    base = at(0.5, 0, 0, 0, 0, 0.25)
    shoulder = base @ at(0, 0, 0.1, 0.2)
    upper = shoulder @ at(0, 0, 0, 0, 0, turn) @ at(0, 0, 0.2, 0, 0.5, 0.3)
    rail = upper @ at(0.3, 0, 0.1, 0, np.pi / 2, 0)
    # Along y of the base as it stood at zero, in the rail's own components.
    at_zero = shoulder @ at(0, 0, 0.2, 0, 0.5, 0.3) @ at(0.3, 0, 0.1, 0, np.pi / 2, 0)
    along = at_zero[:3, :3].T @ base[:3, 1]
    tool = rail @ at(*(slide * along)) @ at(0, 0, 0.2, np.pi / 2)
    posture = arm.mechanism.at([turn, slide])
    assert np.abs(posture.pose - tool).max() < 1e-14
    placed = posture.pose_at(arm.mechanism.placement("upper"))
    assert np.abs(placed - upper).max() < 1e-14


def test_frames_stand_where_rod_has_them(tmp_path):
    from rod.kinematics.tree_transforms import TreeTransforms

    path = tmp_path / "arm.sdf"
    path.write_text(ARM.replace('"rail"/>', '"rail">0 0.1 0 0 0 1</pose>'))
    arm = cartstiff.load(path)
    theirs = TreeTransforms.build(model=rod.Sdf.load(path, is_urdf=False).models()[0])
    posture = arm.mechanism.at([0.0, 0.0])
    for name in ("base", "upper", "slide"):
        ours = posture.pose_at(arm.mechanism.placement(name))
        assert np.abs(ours - theirs.transform(name)).max() < 1e-12, name


def test_what_an_axis_leaves_out_or_says_in_old_words():
    spring = "<spring_stiffness>1000</spring_stiffness><spring_reference>0.2</spring_reference>"
    damped = cartstiff.load(ARM.replace(spring, ""))
    assert damped.damping.tolist() == [0.5, 0.0]
    assert "stiffness-assumed" in [note.code for note in damped.notes]
    old = "<xyz>0 1 0</xyz><use_parent_model_frame>{}</use_parent_model_frame>"
    new = '<xyz expressed_in="base">0 1 0</xyz>'
    for flag, said in (
        ("1", '<xyz expressed_in="__model__">0 1 0</xyz>'),
        ("false", "<xyz>0 1 0</xyz>"),
    ):
        a, b = (cartstiff.load(ARM.replace(new, text)) for text in (old.format(flag), said))
        assert np.abs(a.mechanism.at([0.3, 0.1]).pose - b.mechanism.at([0.3, 0.1]).pose).max() == 0


def test_a_world_brings_its_gravity():
    body = ARM[ARM.index("<model") : ARM.index("</sdf>")]
    arm = cartstiff.load(
        f'<sdf version="1.9"><world name="w"><gravity>0 0 -3.7</gravity>{body}</world></sdf>'
    )
    assert arm.gravity.tolist() == [0.0, 0.0, -3.7]


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('version="1.9"', 'version="1.4"', "this version of SDF .*expected 1.5 or newer, got 1.4"),
        ("<sdf version", "<model/><sdf version", "not valid XML"),
        ("<parent>world</parent>", "<parent>wall</parent>", "not in the model, or itself.*wall"),
        ('attached_to="slide"', 'attached_to="tool"', "not in the model, or itself.*tool"),
        ('relative_to="base"', 'relative_to="rail"', "not in the model, or itself"),
        ('type="prismatic"', 'type="ball"', "'rail' has 1 axes; expected 0 for ball"),
        ('type="prismatic"', 'type="universal"', "'rail' has 1 axes; expected 2 for universal"),
        ('type="prismatic"', 'type="gearbox"', "'rail' has a type that is not supported"),
        ('type="prismatic"', 'type="screw"', "expected revolute, .*got screw"),
        ("<child>slide</child>", "<child>world</child>", "the world is no child of a joint"),
        ("<parent>upper</parent>", "", "<joint name='rail'> is not usable SDF.*parent"),
        ("<mass>2</mass>", "<mass>two</mass>", "<link name='base'> is not usable SDF.*'two'$"),
        ("<damping>0.5", "<damping>soft", "'shoulder'> is not usable SDF, got.*float: 'soft'"),
        ("<mass>2</mass>", "<mass>-2</mass>", "mass"),
        ("0.5 0 0 0 0 0.25", "0.5 0 0 0 0 inf", "pose is not finite; expected 6 finite"),
        ("<xyz>0 0 1</xyz>", "<xyz>0 0 0</xyz>", "axis"),
        ("<xyz>0 0 1</xyz>", "", "<joint name='shoulder'> is not usable SDF"),
        ('<frame name="tool"', "<frame", "<frame> is not usable SDF.*it has no name"),
        ('name="slide"', 'name="upper"', "two elements have one name, got upper"),
        ("<lower>-3</lower>", "<lower>3</lower>", "limits are the wrong way round"),
        (
            '<frame name="tool"',
            '<include><uri>model://a</uri></include><frame name="tool"',
            "an <include> in SDF is not supported",
        ),
        ('<frame name="tool"', '<model name="hand"/><frame name="tool"', "a model within"),
        (
            '<pose degrees="true">',
            '<pose rotation_format="quat_xyzw">',
            "rotation is not supported; expected euler_rpy",
        ),
        (
            "</axis></joint>\n  <link",
            "</axis><axis2/></joint>\n  <link",
            "<joint name='shoulder'> is not usable SDF",
        ),
        ("</model>", '</model><model name="b"/>', "holds one robot; expected one <model>, got 2"),
    ],
)
def test_what_cannot_be_used(before, after, words):
    assert before in ARM
    with pytest.raises(InputError, match=words) as error:
        cartstiff.load(ARM.replace(before, after))
    assert "\n" not in str(error.value)


def test_without_rod_it_says_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "rod", None)
    with pytest.raises(CartstiffError, match=r"SDF file needs the package rod.*cartstiff\[sdf\]"):
        cartstiff.load(ARM)


def test_balls_and_joints_with_two_axes(tmp_path):
    """They turn about one axis after the other; balls are passive, springs stand on their axes."""
    axes = (
        "<axis><xyz>0 1 0</xyz><dynamics><spring_stiffness>70</spring_stiffness></dynamics></axis>"
        '<axis2><xyz expressed_in="base">0 0 1</xyz><limit><lower>-1</lower><upper>2</upper>'
        "</limit></axis2>"
    )
    rail = ARM[ARM.index('<axis><xyz expressed_in="base"') : ARM.index("</joint>\n  <frame")]
    two = ARM.replace(rail, axes).replace('type="prismatic"', 'type="universal"')
    arm = cartstiff.load(two)
    assert arm.names == ("shoulder", "rail.1", "rail.2")
    assert arm.springs.stiffness[1] == 70.0
    assert arm.limits["rail.2"] == (-1.0, 2.0)
    shoulder = at(0.5, 0, 0, 0, 0, 0.25) @ at(0, 0, 0.1, 0.2)
    rail_at = shoulder @ at(0, 0, 0.2, 0, 0.5, 0.3) @ at(0.3, 0, 0.1, 0, np.pi / 2, 0)
    second = rail_at[:3, :3].T @ at(0, 0, 0, 0, 0, 0.25)[:3, 2]  # the base's z at zero
    q, tool = (0.0, 0.6, -0.4), at(0, 0, 0.2, np.pi / 2)
    turn = np.eye(4)
    turn[:3, :3] = (
        Rotation.from_rotvec([0, q[1], 0]) * Rotation.from_rotvec(q[2] * second)
    ).as_matrix()
    assert np.abs(arm.mechanism.at(q).pose - rail_at @ turn @ tool).max() < 1e-14

    arm = cartstiff.load(ARM.replace(rail, "").replace('type="prismatic"', 'type="ball"'))
    assert arm.names == ("shoulder", "rail.x", "rail.y", "rail.z")
    assert arm.springs.stiffness.tolist() == [1000.0, 0.0, 0.0, 0.0]
    turn[:3, :3] = Rotation.from_euler("XYZ", [0.3, -0.5, 0.7]).as_matrix()
    assert np.abs(arm.mechanism.at([0, 0.3, -0.5, 0.7]).pose - rail_at @ turn @ tool).max() < 1e-14


FOUR_BAR = """<sdf version="1.9"><model name="four"><link name="base"/>
<joint name="foot" type="fixed"><parent>world</parent><child>base</child></joint>
<link name="a"/><link name="b"><pose>0.1 0 1 0 0 0</pose></link>
<link name="c"><pose>1.2 0 0 0 0 0</pose></link>
<joint name="j1" type="revolute"><parent>base</parent><child>a</child><axis><xyz>0 1 0</xyz>
<dynamics><spring_stiffness>1000</spring_stiffness></dynamics></axis></joint>
<joint name="j2" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 1 0</xyz></axis>
</joint>
<joint name="j3" type="revolute"><parent>base</parent><child>c</child><axis><xyz>0 1 0</xyz></axis>
</joint>
<joint name="j4" type="revolute"><pose relative_to="c">0.2 0 0.7 0 0 0</pose><parent>c</parent>
<child>b</child><axis><xyz>0 1 0</xyz></axis></joint>
<frame name="tool" attached_to="b"><pose>0.5 0 0.3 0 0 0</pose></frame></model></sdf>"""


def test_a_link_on_two_joints_closes_a_loop():
    """A four-bar: the compliance at the tool from circles that meet, by differences."""
    from scipy.optimize import brentq

    four = cartstiff.load(FOUR_BAR)
    assert four.names == ("j1", "j2", "j3", "j4")
    assert four.springs.stiffness.tolist() == [1000.0, 0.0, 0.0, 0.0]
    A, B = np.array([0.1, 1.0]), np.array([1.4, 0.7])  # x and z of the pins
    O, coupler = np.array([1.2, 0.0]), B - A  # noqa: E741

    def spun(x, z, angle):  # about y
        return np.array(
            [np.cos(angle) * x + np.sin(angle) * z, np.cos(angle) * z - np.sin(angle) * x]
        )

    def tool(angle):
        at_a = spun(*A, angle)

        def gap(turn):
            return np.linalg.norm(at_a + spun(*coupler, turn) - O) - np.linalg.norm(B - O)

        turn = brentq(gap, -0.3, 0.3, xtol=1e-15)
        return np.append(turn, at_a + spun(0.5, 0.3, turn))

    h = 1e-4
    turn, x, z = (tool(h) - tool(-h)) / (2 * h)
    result = cartstiff.analyse(four)
    J = np.array([0, turn, 0, x, 0, z])
    assert np.allclose(result.compliances["B"], np.outer(J, J) / 1000, rtol=0, atol=1e-10)
    spring = "<dynamics><spring_stiffness>1000</spring_stiffness></dynamics>"
    assumed = cartstiff.load(FOUR_BAR.replace(spring, ""))
    assert assumed.springs.stiffness.tolist() == [1e4, 1e4, 1e4, 0.0]
