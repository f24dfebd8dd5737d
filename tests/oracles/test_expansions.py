"""Joints with several coordinates, rewritten as one-coordinate joints, against Pinocchio's FK."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from tests.doors import Chain, plain_tree
from tests.support import (
    absolute_error,
    add_frame,
    body_jacobian,
    frame_pose,
    random_pose,
    relative_error,
    robot_file,
)

# Products of a few rotation matrices.
ROUNDING = 1e-13


@dataclass
class Case:
    """A joint, values of the expanded coordinates, and Pinocchio's configuration for them."""

    joint: object
    values: list[float]
    configuration: list[float]
    names: list[str]
    types: list[str]


def _quaternion(sequence: str, angles: list[float]) -> list[float]:
    return Rotation.from_euler(sequence, angles).as_quat().tolist()


def _cases() -> dict[str, Case]:
    a, b, c = 0.4, -0.7, 1.1
    x, y, z = 0.2, -0.3, 0.5
    axis1 = np.array([0.6, 0.0, 0.8])
    axis2 = np.array([0.0, 1.0, 0.0])
    skewed = np.array([1.0, 2.0, 2.0]) / 3
    rev, pri = "revolute", "prismatic"
    turn = [np.cos(a), np.sin(a)]
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX(), pin.SE3(random_pose(np.random.default_rng(1), 0.3)))
    composite.addJoint(pin.JointModelPY(), pin.SE3(random_pose(np.random.default_rng(2), 0.3)))
    composite.addJoint(
        pin.JointModelSpherical(), pin.SE3(random_pose(np.random.default_rng(3), 0.3))
    )
    ball = _quaternion("XYZ", [a, b, c])
    return {
        "universal": Case(
            pin.JointModelUniversal(axis1, axis2), [a, b], [a, b], ["m.1", "m.2"], [rev] * 2
        ),
        "spherical": Case(
            pin.JointModelSpherical(), [a, b, c], ball, ["m.x", "m.y", "m.z"], [rev] * 3
        ),
        "spherical zyx": Case(
            pin.JointModelSphericalZYX(), [a, b, c], [a, b, c], ["m.z", "m.y", "m.x"], [rev] * 3
        ),
        "translation": Case(
            pin.JointModelTranslation(), [x, y, z], [x, y, z], ["m.x", "m.y", "m.z"], [pri] * 3
        ),
        "planar": Case(
            pin.JointModelPlanar(),
            [x, y, a],
            [x, y, *turn],
            ["m.x", "m.y", "m.angle"],
            [pri, pri, rev],
        ),
        "free flyer": Case(
            pin.JointModelFreeFlyer(),
            [x, y, z, a, b, c],
            [x, y, z, *ball],
            ["m.x", "m.y", "m.z", "m.rx", "m.ry", "m.rz"],
            [pri] * 3 + [rev] * 3,
        ),
        "unbounded x": Case(pin.JointModelRUBX(), [a], turn, ["m"], [rev]),
        "unbounded y": Case(pin.JointModelRUBY(), [a], turn, ["m"], [rev]),
        "unbounded z": Case(pin.JointModelRUBZ(), [a], turn, ["m"], [rev]),
        "helical": Case(pin.JointModelHZ(0.2), [a], [a], ["m"], ["helical"]),
        "helical unaligned": Case(
            pin.JointModelHelicalUnaligned(skewed, -0.3), [a], [a], ["m"], ["helical"]
        ),
        "prismatic": Case(pin.JointModelPrismaticUnaligned(skewed), [x], [x], ["m"], [pri]),
        "composite": Case(
            composite,
            [a, y, a, b, c],
            [a, y, *ball],
            ["m.1", "m.2", "m.3.x", "m.3.y", "m.3.z"],
            [rev, pri, rev, rev, rev],
        ),
    }


CASES = list(_cases())


def _model(joint) -> pin.Model:
    """The joint between two revolutes, with a branch, masses and frames on every link."""
    rng = np.random.default_rng(4)
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRY(), pin.SE3(random_pose(rng, 0.4)), "first_hinge")
    middle = model.addJoint(first, joint, pin.SE3(random_pose(rng, 0.4)), "m")
    last = model.addJoint(middle, pin.JointModelRX(), pin.SE3(random_pose(rng, 0.4)), "last_hinge")
    for name, parent in (("on_first", first), ("on_middle", middle), ("tip", last)):
        add_frame(model, name, parent, random_pose(rng, 0.3))
        inertia = pin.Inertia(rng.uniform(1, 2), rng.uniform(-0.2, 0.2, 3), 0.01 * np.eye(3))
        model.appendBodyToJoint(parent, inertia, pin.SE3(random_pose(rng, 0.2)))
    return model


@pytest.mark.parametrize("name", CASES)
def test_kinematics(name):
    case = _cases()[name]
    model = _model(case.joint)
    tree = plain_tree(model)
    assert [c.name for c in tree.coordinates] == ["first_hinge", *case.names, "last_hinge"]
    assert [c.type for c in tree.coordinates] == ["revolute", *case.types, "revolute"]
    q_pin = np.array([0.3, *case.configuration, -0.6])
    q = np.array([0.3, *case.values, -0.6])
    state = tree.at(q)
    for frame in ("on_first", "on_middle", "tip"):
        got = state.pose(tree.placement(frame))
        assert absolute_error(got, frame_pose(model, q_pin, frame)) <= ROUNDING
    data = model.createData()
    centre = pin.centerOfMass(model, data, q_pin)
    g = np.array([0.3, 1.0, -2.0])
    energy = state.gravity(g).energy
    assert abs(energy + pin.computeTotalMass(model) * g @ centre) <= ROUNDING * 100


@pytest.mark.parametrize("name", CASES)
def test_locked_and_left_out(name):
    """Joints that are not kept become links at their neutral position."""
    case = _cases()[name]
    model = _model(case.joint)
    tree = plain_tree(model, keep=[1, 3], locked={1: 0.8})
    assert [c.name for c in tree.coordinates] == ["last_hinge"]
    q_pin = pin.neutral(model)
    q_pin[0], q_pin[-1] = 0.8, -0.6
    got = tree.at(np.array([-0.6])).pose(tree.placement("tip"))
    assert absolute_error(got, frame_pose(model, q_pin, "tip")) <= ROUNDING


@pytest.mark.parametrize("name", CASES)
def test_masses_of_links_left_out(name):
    """What a joint carried hangs on the joint before it, at its place."""
    model = _model(_cases()[name].joint)
    tree = plain_tree(model, keep=[1, 3])
    q_pin = pin.neutral(model)
    q_pin[0], q_pin[-1] = 0.8, -0.6
    g = np.array([0.3, 1.0, -2.0])
    centre = pin.centerOfMass(model, model.createData(), q_pin)
    energy = tree.at(np.array([0.8, -0.6])).gravity(g).energy
    assert abs(energy + pin.computeTotalMass(model) * g @ centre) <= ROUNDING * 100


def test_locked_continuous_joint():
    model = _model(pin.JointModelRUBX())
    tree = plain_tree(model, locked={2: 2.5})
    q = np.array([0.3, np.cos(2.5), np.sin(2.5), -0.6])
    got = tree.at(np.array([0.3, -0.6])).pose(tree.placement("tip"))
    assert absolute_error(got, frame_pose(model, q, "tip")) <= ROUNDING


@pytest.mark.parametrize("axis", ["1 2 2", "-0.6 0 0.8", "0 0 1", "0 -1 0"])
def test_continuous_joints_of_a_urdf(axis):
    """Pinocchio holds them by cosine and sine, whatever their axis."""
    model = pin.buildModelFromXML(CONTINUOUS.format(axis=axis))
    tree = plain_tree(model)
    assert [(c.name, c.type) for c in tree.coordinates] == [("turn", "revolute")]
    for angle in (0.0, 0.7, -2.0, 4.0):
        q = np.array([np.cos(angle), np.sin(angle)])
        got = tree.at(np.array([angle])).pose(tree.placement("hand"))
        assert absolute_error(got, frame_pose(model, q, "hand")) <= ROUNDING


def test_jacobian_of_plain_joints():
    """Where Pinocchio's own joint is plain, its Jacobian must come back."""
    model = _model(pin.JointModelHZ(0.2))
    q = np.array([0.3, 0.4, -0.6])
    J = Chain(plain_tree(model), "tip").at(q).motion.jacobian
    assert relative_error(J, body_jacobian(model, q, "tip")) <= ROUNDING


def test_limits():
    model = pin.Model()
    bounds = [np.array([v]) for v in (10.0, 2.0, -1.5, 1.0)]
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "a", *bounds)
    joint = model.addJoint(joint, pin.JointModelRUBX(), pin.SE3.Identity(), "b")
    joint = model.addJoint(joint, pin.JointModelPX(), pin.SE3.Identity(), "c")
    model.addJoint(joint, pin.JointModelSpherical(), pin.SE3.Identity(), "d")
    a, b, c, *d = plain_tree(model).coordinates
    assert (a.lower, a.upper) == (-1.5, 1.0)
    for free in (b, c, *d):
        assert (free.lower, free.upper) == (-np.inf, np.inf)
    assert [x.is_length for x in (a, b, c)] == [False, False, True]


def test_names_met_twice_are_kept_apart():
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX())
    composite.addJoint(pin.JointModelRY())
    model = _model(composite)
    model.names[1] = "m.1"
    names = [c.name for c in plain_tree(model).coordinates]
    assert names == ["m.1", "m.1_2", "m.2", "last_hinge"]


def test_the_model_given_is_not_modified():
    model = _model(pin.JointModelSpherical())
    before = model.saveToString()
    plain_tree(model, keep=[2, 3], locked={1: 0.4}).at(np.zeros(4)).gravity(np.ones(3))
    assert model.saveToString() == before


CONTINUOUS = """
<robot name="one">
  <link name="base"/>
  <link name="hand"/>
  <joint name="turn" type="continuous">
    <parent link="base"/>
    <child link="hand"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>
    <axis xyz="{axis}"/>
  </joint>
</robot>
"""

MJCF = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="arm" pos="0.1 0 0.2" euler="0.1 0.2 0.3">
      <joint name="lift" type="slide" axis="0 0 1"/>
      <joint name="pan" type="hinge" axis="0 0 1" pos="0.05 0 0"/>
      <joint name="tilt" type="hinge" axis="0 1 0" pos="0 0.04 0.02"/>
      <geom type="sphere" size="0.1" mass="1"/>
      <body name="hand" pos="0.3 0.1 0">
        <joint name="grip" type="hinge" axis="1 0 0"/>
        <joint name="wag" type="hinge" axis="0 0.6 0.8"/>
        <geom type="sphere" size="0.1" mass="2"/>
        <body name="finger" pos="0.1 0 0">
          <joint name="curl" type="hinge" axis="0 1 0"/>
          <geom type="sphere" size="0.05" mass="0.5"/>
          <site name="tip" pos="0.1 0.02 0.03"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_mjcf_bodies_with_several_joints(tmp_path):
    """Pinocchio makes composite joints of them; every part must move the frame."""
    path = tmp_path / "arm.xml"
    path.write_text(MJCF, encoding="utf-8")
    model = pin.buildModelFromMJCF(str(path))
    tree = plain_tree(model)
    # Compared with the model as Pinocchio built it, whichever joints that has.
    q = np.random.default_rng(5).uniform(-1, 1, model.nq)
    assert tree.n == model.nv == model.nq
    state = tree.at(q)
    for frame in model.frames:
        if frame.name != "universe":
            got = state.pose(tree.placement(frame.name))
            assert absolute_error(got, frame_pose(model, q, frame.name)) <= ROUNDING, frame.name
    J = state.relative(tree.placement("world"), tree.placement("tip"))[1].jacobian
    assert np.all(np.linalg.norm(J, axis=0) > 0.1)


@pytest.mark.parametrize(
    "relative", ["ur_description/urdf/ur5_robot.urdf", "panda_description/urdf/panda.urdf"]
)
def test_every_frame_of_a_robot(relative):
    model = pin.buildModelFromUrdf(robot_file(relative))
    tree = plain_tree(model)
    q = np.random.default_rng(6).uniform(-1, 1, model.nq)
    state = tree.at(q)
    for frame in model.frames:
        if frame.name != "universe":
            got = state.pose(tree.placement(frame.name))
            same = [f for f in model.frames if f.name == frame.name]
            if len(same) == 1:
                assert absolute_error(got, frame_pose(model, q, frame.name)) <= ROUNDING
