"""Loops written in MJCF: what its parser drops must be there all the same."""

import json
import math

import numpy as np
import pytest
from tests.mechanisms.machines import codes, joint, masses, note, write_file, write_urdf
from tests.mechanisms.oracle import GRAVITY
from tests.support import relative_error

from cartstiff import analyse, load

# The same numbers through two formats.
SAME = 1e-10
ASSEMBLED = 1e-12

XML = """
<mujoco>
  <compiler angle="{angle}" autolimits="true"/>
  <default>
    <joint type="hinge" axis="0 0 1"/>
    <default class="held"><joint stiffness="35" springref="{held}"/></default>
  </default>
  <worldbody>
    <body name="left_crank" pos="-0.15 0 0">
      <inertial pos="0.1 0.02 0" mass="0.4" diaginertia="1e-3 1e-3 1e-3"/>
      <joint name="left_motor" class="held"/>
      <body name="left_coupler" pos="0.25 0 0">
        <inertial pos="0.15 0 0.01" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/>
        <joint name="left_elbow" stiffness="4" springref="{elbow}"/>
      </body>
    </body>
    <body name="right_crank" pos="0.15 0 0">
      <inertial pos="0.1 0 0" mass="0.4" diaginertia="1e-3 1e-3 1e-3"/>
      <joint name="right_motor" stiffness="50" springref="{right}"/>
      <body name="right_coupler" pos="0.25 0 0" quat="1 0 0 0">
        <inertial pos="0.15 0 0" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/>
        <joint name="right_elbow"/>
      </body>
    </body>
    <body name="aside" pos="3 0 0">
      <inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
      <joint name="aside" stiffness="{aside}"/>
    </body>
  </worldbody>
  <equality>
    {equality}
  </equality>
</mujoco>
"""
# The right coupler in the left: 0.55 m ahead, 0.2 m aside, turned by 1.9 rad.
WELD = (
    '<weld body1="left_coupler" body2="right_coupler" '
    f'relpose="0.55 0.2 0 {math.cos(0.95)} 0 0 {math.sin(0.95)}"/>'
)
REST = {"held": 2.0, "elbow": -1.1, "right": 1.2}
Q = {"left_motor": 2.2, "left_elbow": -1.35, "right_motor": 0.95, "right_elbow": 1.35}
# The point shared at q = 0 is where MuJoCo puts it on both bodies: at (x, 0, 0) of the world.
CONNECT = '<connect body1="left_coupler" body2="right_coupler" anchor="0.5 0 0"/>'
OTHER = '<connect active="false" body1="left_crank" body2="right_coupler" anchor="0.1 0.2 0"/>'


def _xml(folder, equality, angle="radian", name="loop", aside=1.0):
    rest = {k: np.rad2deg(v) if angle == "degree" else v for k, v in REST.items()}
    path = folder / f"{name}.xml"
    path.write_text(XML.format(equality=equality, angle=angle, aside=aside, **rest))
    return path


def _urdf(folder, *more):
    text = write_urdf(
        folder,
        joint("left_motor", "base", "left_crank", at=(-0.15, 0, 0)),
        joint("left_elbow", "left_crank", "left_coupler", at=(0.25, 0, 0)),
        joint("right_motor", "base", "right_crank", at=(0.15, 0, 0)),
        joint("right_elbow", "right_crank", "right_coupler", at=(0.25, 0, 0)),
        joint("aside_joint", "base", "aside", at=(3, 0, 0)),
        *more,
        name="twin",
    )
    bodies = {
        "left_crank": (0.4, "0.1 0.02 0"),
        "left_coupler": (0.3, "0.15 0 0.01"),
        "right_crank": (0.4, "0.1 0 0"),
        "right_coupler": (0.3, "0.15 0 0"),
    }
    urdf = text.read_text()
    for link, (mass, at) in bodies.items():
        urdf = masses(urdf, **{link: mass}).replace(
            f'<link name="{link}"><inertial><origin xyz="0.05 0.02 0.01"/>',
            f'<link name="{link}"><inertial><origin xyz="{at}"/>',
        )
    text.write_text(urdf)
    return text


SPRINGS = {
    "left_motor": {"stiffness": 35.0, "rest": REST["held"]},
    "left_elbow": {"stiffness": 4.0, "rest": REST["elbow"]},
    "right_motor": {"stiffness": 50.0, "rest": REST["right"]},
    "aside_joint": {"stiffness": 1.0, "rest": 0.0},
}


def _compare(a, b):
    """Two results of one mechanism with its joints in whatever order."""
    names_a = [n.removesuffix("_joint") for n in a.elastic.names]
    names_b = [n.removesuffix("_joint") for n in b.elastic.names]
    assert sorted(names_a) == sorted(names_b)
    order = [names_b.index(n) for n in names_a]
    assert np.abs(a.q - b.q[order]).max() <= SAME
    assert relative_error(a.pose, b.pose) <= SAME
    assert relative_error(a.energy, b.energy) <= SAME
    assert relative_error(a.evaluation.gradient, b.evaluation.gradient[order]) <= SAME
    assert relative_error(a.wrench, b.wrench) <= SAME
    assert (
        relative_error(
            a.reduction.reachable @ a.reduction.reachable_stiffness @ a.reduction.reachable.T,
            b.reduction.reachable @ b.reduction.reachable_stiffness @ b.reduction.reachable.T,
        )
        <= SAME
    )


def _files(tmp_path, xml, closures, gravity=None, *more):
    extra = {} if gravity is None else {"gravity": gravity}
    # The bystander has its own spring, so its place is balanced on its own.
    mjcf = write_file(
        tmp_path,
        "from-mjcf",
        kind="closed-chain",
        model=xml.name,
        frame="left_coupler",
        q=Q,
        locked={"aside": 0.0},
        **extra,
    )
    springs = {k: v for k, v in SPRINGS.items() if k != "aside_joint"}
    urdf = write_file(
        tmp_path,
        "from-urdf",
        kind="closed-chain",
        model=_urdf(tmp_path, *more).name,
        frame="left_coupler",
        q=Q,
        locked={"aside_joint": 0.0},
        springs=springs,
        passive=["right_elbow"],
        closures=closures,
        **extra,
    )
    return load(mjcf), load(urdf)


TIP = {"frames": ["left_coupler", "right_coupler"], "type": "point"}


@pytest.mark.parametrize("angle", ["radian", "degree"])
@pytest.mark.parametrize("gravity", [None, GRAVITY])
def test_connect(tmp_path, angle, gravity):
    """connect with joint springs, defaults, springref, an inactive equality, several bodies."""
    xml = _xml(tmp_path, OTHER + CONNECT, angle)
    # MuJoCo takes the anchor on body 1; at q = 0 that is (0.6, 0, 0), 0.2 from the right coupler.
    closures = [{**TIP, "points": [[0.5, 0, 0], [0.2, 0, 0]]}]
    mjcf, urdf = _files(tmp_path, xml, closures, gravity)
    assert len(mjcf.mechanism.closures) == 1
    a, b = analyse(mjcf), analyse(urdf)
    assert np.abs(a.posture.residual).max() <= ASSEMBLED
    assert np.abs(a.wrench).max() > 1.0
    _compare(a, b)


def test_weld(tmp_path):
    """weld with a relative pose: one freedom is left of the two."""
    xml = _xml(tmp_path, WELD)
    mount = joint("mount", "left_coupler", "pad", at=(0.55, 0.2, 0), rpy=(0, 0, 1.9), kind="fixed")
    closures = [{"frames": ["pad", "right_coupler"], "type": "weld"}]
    a, b = map(analyse, _files(tmp_path, xml, closures, None, mount))
    assert a.reduction.freedoms == 1
    _compare(a, b)


def test_without_springs_named_the_bystander_is_left_out(tmp_path):
    """Four joints move the frame, each spring where it was written; a fifth is not on the way."""
    elastic = load(_xml(tmp_path, CONNECT), frame="left_coupler")
    assert set(elastic.names) == {*Q}
    k = dict(zip(elastic.names, elastic.springs.stiffness, strict=True))
    rest = dict(zip(elastic.names, elastic.springs.rest, strict=True))
    assert k == {"left_motor": 35, "left_elbow": 4, "right_motor": 50, "right_elbow": 0}
    assert rest["left_motor"] == pytest.approx(2.0, abs=1e-15)
    assert rest["left_elbow"] == pytest.approx(-1.1, abs=1e-15)


@pytest.mark.parametrize("equality", [CONNECT, WELD])
def test_assembled_loops_are_closed_for_mujoco(tmp_path, equality):
    """The posture found here, given to MuJoCo: its own measure of the violation is zero."""
    mujoco = pytest.importorskip("mujoco")
    path = _xml(tmp_path, equality)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    elastic = load(path, frame="left_coupler")
    q = elastic.mechanism.assembled([Q.get(n, 0.0) for n in elastic.names])
    order = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, n) for n in elastic.names]
    data.qpos[order] = q
    mujoco.mj_forward(model, data)
    rows = 3 if equality == CONNECT else 6
    assert np.abs(data.efc_pos[:rows]).max() <= SAME
    data.qpos[order] = q + 0.01
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[:rows]).max() > 1e-4


IDLE = """<mujoco><compiler angle="degree" eulerseq="zyx"/>
<default><joint axis="0 0 1"/><geom size=".02"/></default><worldbody>
<body name="crank" pos="-.15 0 0"><joint name="m1" stiffness="35" springref="20"/><geom/>
<body name="coupler" pos=".25 0 0"><joint name="e1" pos=".1 .2 .3"/><geom/>
<site name="tip" pos=".3 0 0"/></body></body>
<body name="rocker" pos=".15 0 0" euler="0 0 10"><joint name="m2" stiffness="50"/><geom/>
<body name="link" pos=".25 0 0"><joint name="e2"/><geom/></body></body></worldbody>
<equality><connect body1="coupler" body2="link" anchor=".3 0 0"/></equality></mujoco>"""


def test_a_loop_whose_only_motion_leaves_the_end_effector_where_it_is(tmp_path):
    """What the sums for the end-effector leave of zero is no motion of it."""
    (tmp_path / "loop.xml").write_text(IDLE)
    result = analyse(load(tmp_path / "loop.xml"))
    assert {"fewer-than-six-freedoms", "idle-self-motion"} <= set(codes(result))
    assert "6 of 6 directions" in note(result, "fewer-than-six-freedoms").message


LEG = """<mujoco><option gravity="0 0 -9.81"/><worldbody><site name="foot" pos=".1 0 0"/>
<body name="a"><joint name="j1" axis="0 1 0" stiffness="500"/><geom size=".1" pos="0 0 .2"/>
<body name="b" pos="0 0 .4"><joint name="j2" axis="0 1 0" stiffness="300"/>
<geom size=".05" pos=".1 0 .1"/><site name="mid" pos=".1 0 .1"/><site name="tip" pos=".3 0 .2"/>
</body></body></worldbody><tendon><spatial stiffness="4000" springlength=".3">
<site site="foot"/><site site="mid"/></spatial></tendon></mujoco>"""


@pytest.mark.parametrize("count", [1, 2])
def test_tendons_of_legs_act_as_those_of_arms(tmp_path, count):
    """Equal legs beside each other are as stiff as their number of arms, tendons included."""
    (tmp_path / "leg.xml").write_text(LEG)
    (tmp_path / "arm.yaml").write_text("kind: serial\nmodel: leg.xml\nframe: tip\n")
    aside = ({"xyz": [0.0, 0.2 * k, 0.0]} for k in range(count))
    legs = [{"model": "leg.xml", "frame": "tip", "base": at, "grip": at} for at in aside]
    (tmp_path / "legs.yaml").write_text(json.dumps({"kind": "parallel", "legs": legs}))
    arm = analyse(load(tmp_path / "arm.yaml"), [0.1, 0.2])
    several = analyse(load(tmp_path / "legs.yaml"), [0.1, 0.2] * count)
    assert np.allclose(
        several.compliances["B"], arm.compliances["B"] / count, rtol=1e-9, atol=1e-12
    )
    assert np.allclose(several.wrench, arm.wrench * count, rtol=1e-9, atol=1e-9)
    left_out = [note for note in several.notes if note.code == "gravity-left-out"]
    assert [note.message.partition(":")[0] for note in left_out] == ["leg 1", "leg 2"][:count]
