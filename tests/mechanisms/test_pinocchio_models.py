"""A Pinocchio model in hand: the same robot as its file, its joints where Pinocchio has them."""

import pickle
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from tests.doors import TreeState, plain_tree
from tests.support import (
    absolute_error,
    refused,
    relative_error,
)
from tests.support.commands import refuses
from tests.support.robots import example_robot, visuals_of

import cartstiff
from cartstiff.core.errors import UnknownNameError
from cartstiff.extend import jacobian

ROBOTS = Path(__file__).resolve().parents[2] / "robots"
POINTS = {
    2: [0.23823, 0.259469, -0.0028],
    3: [0.098573, 0.330142, 0.0091],
    4: [-0.348704, 0.081173, -0.0056],
    5: [-0.333304, -0.093073, 0.0042],
    6: [0.093673, -0.331542, -0.0077],
}


def _urdf(body, count):
    links = "".join(f'<link name="l{i}"/>' for i in range(count))
    return f'<robot name="r">{links}{body}</robot>'


def _joint(i, kind="revolute", more="", axis="0 0 1"):
    return (
        f'<joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
        f'<origin xyz="0.3 0.1 0.2" rpy="0.4 {0.3 * i} -0.2"/><axis xyz="{axis}"/>'
        f'<limit lower="-2" upper="2" effort="0" velocity="0"/>{more}</joint>'
    )


@pytest.mark.parametrize("name", ["ur3_limited", "talos_arm", "kinova", "panda_collision"])
def test_the_model_and_its_file_give_the_same_matrices(name):
    path = example_robot(name)
    from_file = cartstiff.load(path)
    frame = from_file.mechanism.frame
    in_hand = cartstiff.load(pin.buildModelFromUrdf(str(path)), frame=frame)
    assert in_hand.names == from_file.names
    q = np.random.default_rng(5).uniform(-1.5, 1.5, len(from_file.names))
    load = [1.0, -2.0, 3.0, 40.0, -50.0, 60.0] if len(q) == 6 else None
    a, b = (cartstiff.analyse(arm, q, wrench=load) for arm in (from_file, in_hand))
    assert np.array_equal(a.pose, b.pose)
    for connection in "ABK":
        K = a.tensor(connection).matrix
        assert relative_error(b.tensor(connection).matrix, K) <= 1e-15


def test_joints_beyond_the_frame_are_held_in_the_configuration():
    model = pin.buildModelFromUrdf(str(example_robot("ur5")))
    q, g = np.array([0.1, -1.0, 1.0, 0.7, 0.9, 0.3]), np.array([0.0, 0.0, -9.81])
    arm = cartstiff.from_pinocchio(model, frame="forearm_link", q=q)
    expected = pin.computeGeneralizedGravity(model, model.createData(), q)[:3]
    gradient = arm.mechanism.at(arm.q).gravity(g).gradient
    np.testing.assert_allclose(gradient, expected, atol=1e-12)


def test_the_model_is_not_changed():
    model = pin.buildModelFromUrdf(str(example_robot("ur5")))
    before = model.copy()
    arm = cartstiff.load(model, frame="tool0", stiffness=3e4)
    cartstiff.analyse(arm, [0.1, -0.9, 1.2, 0.3, 0.4, 0.5])
    assert model == before
    assert arm.springs.stiffness.tolist() == [3e4] * 6


def test_a_wrapper_brings_posture_and_pictures():
    path = example_robot("ur5")
    wrapper = pin.RobotWrapper(
        pin.buildModelFromUrdf(str(path)), None, None
    )  # no meshes are read here
    wrapper.q0 = np.array([0.1, -1.0, 1.3, 0.4, 0.5, 0.6])
    arm = cartstiff.load(wrapper)
    assert np.array_equal(arm.q, wrapper.q0)
    assert "default-posture" in [note.code for note in arm.notes]


def test_a_tuple_brings_what_the_links_look_like():
    model = pin.buildModelFromXML(_urdf("".join(_joint(i) for i in range(1, 4)), 4))
    geometry = pin.GeometryModel()
    box = coal.Box(0.1, 0.2, 0.3)
    frame = model.getFrameId("l2")
    T = pin.SE3(Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix(), np.array([0.4, 0.5, 0.6]))
    at = model.frames[frame].placement * T
    geometry.addGeometryObject(
        pin.GeometryObject("box", model.frames[frame].parentJoint, frame, at, box)
    )
    arm = cartstiff.load((model, None, geometry), frame="l3")
    ((piece,), missing) = visuals_of(arm.mechanism)
    assert missing == []
    assert piece.link == "l2"
    assert piece.shape.sides == pytest.approx((0.1, 0.2, 0.3))
    q = np.array([0.3, -0.4, 0.5])
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    seen = arm.mechanism.at(q).pose_at(piece.at)
    np.testing.assert_allclose(seen, (data.oMf[frame] * T).homogeneous, atol=1e-14)
    again = pickle.loads(pickle.dumps(arm))
    assert len(visuals_of(again.mechanism)[0]) == 1


def test_configurations_of_every_kind_of_joint():
    """The default posture puts the frame where Pinocchio's own kinematics has it."""
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX(), pin.SE3.Identity())
    composite.addJoint(pin.JointModelPY(), pin.SE3.Random())
    model = pin.Model()
    model.name = "zoo"
    parent = 0
    for i, joint in enumerate(
        [
            pin.JointModelRUBZ(),
            pin.JointModelSpherical(),
            pin.JointModelPlanar(),
            pin.JointModelTranslation(),
            pin.JointModelSphericalZYX(),
            composite,
            pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])),
        ]
    ):
        parent = model.addJoint(parent, joint, pin.SE3.Random(), f"joint{i}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
    frame = model.addFrame(pin.Frame("tip", parent, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    high = np.full(model.nq, 2.0)
    q = pin.randomConfiguration(model, -high, high)
    q[:2] = np.cos(2.0), np.sin(2.0)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    arm = cartstiff.load(model, frame="tip", q=q)
    pose = arm.mechanism.at(arm.q).pose
    np.testing.assert_allclose(pose, data.oMf[frame].homogeneous, atol=1e-13)


def test_following_joints():
    """A model with mimic joints and the URDF that it was read from agree."""
    mimic = '<mimic joint="j1" multiplier="-1.5" offset="0.2"/>'
    slide = '<mimic joint="j2" multiplier="0.1" offset="0.05"/>'
    text = _urdf(
        _joint(1)
        + _joint(2, "revolute", "", "1 0 0")
        + _joint(3, "revolute", mimic, "0 0.6 0.8")
        + _joint(4, "prismatic", slide, "0 1 0"),
        5,
    )
    model = pin.buildModelFromXML(text, True)
    assert model.nq == 2
    arm = cartstiff.load(model, frame="l4")
    assert arm.names == ("j1", "j2")
    q = np.array([0.7, -0.3])
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    seen = arm.mechanism.at(q).pose
    np.testing.assert_allclose(seen, data.oMf[model.getFrameId("l4")].homogeneous, atol=1e-13)


def test_a_free_root_is_held_unless_it_is_let_go():
    text = _urdf("".join(_joint(i) for i in range(1, 3)), 3)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    q = pin.randomConfiguration(model, np.full(model.nq, -1.0), np.full(model.nq, 1.0))
    held = cartstiff.load(model, frame="l2", q=q)
    assert held.names == ("j1", "j2")
    assert "root-held" in [note.code for note in held.notes]
    free = cartstiff.load(model, frame="l2", q=q, floating=True)
    assert len(free.names) == 8
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    pose = data.oMf[model.getFrameId("l2")].homogeneous
    for arm in (held, free):
        np.testing.assert_allclose(arm.mechanism.at(arm.q).pose, pose, atol=1e-13)


def test_loops_as_pinocchio_names_them():
    """The bundled 6-UPS, its closures as constraint models instead of a mechanism file."""
    model = pin.buildModelFromUrdf(str(ROBOTS / "6-ups.urdf"))
    platform = model.frames[model.getFrameId("platform")]
    closures = []
    for leg, point in POINTS.items():
        rod = model.frames[model.getFrameId(f"rod{leg}")]
        closures.append(
            pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D,
                model,
                platform.parentJoint,
                platform.placement * pin.SE3(np.eye(3), np.array(point)),
                rod.parentJoint,
                rod.placement,
            )
        )
    motors = [f"leg{i}_slide" for i in range(1, 7)]
    passive = {name: 0.0 for name in list(model.names)[1:] if name not in motors}
    machine = cartstiff.load(
        model,
        frame="platform",
        closures=closures,
        actuated=motors,
        stiffness=passive | dict.fromkeys(motors, 2e6),
    )
    K = cartstiff.analyse(machine).B.matrix
    expected = cartstiff.analyse(cartstiff.load("6-ups")).B.matrix
    np.testing.assert_allclose(K, expected, atol=1e-12 * np.abs(expected).max())


def test_locked_joints_and_files():
    path = example_robot("panda_collision")
    model = pin.buildModelFromUrdf(str(path))
    locked = {"panda_joint3": 0.4}
    a = cartstiff.load(model, frame="panda_link8", locked=locked)
    b = cartstiff.load(path, frame="panda_link8", locked=locked)
    assert len(a.names) == 6
    q = [0.1, 0.2, -1.2, 0.4, 1.3, 0.6]
    assert np.array_equal(cartstiff.analyse(a, q).B.matrix, cartstiff.analyse(b, q).B.matrix)


def test_what_cannot_be_used():
    model = pin.buildModelFromXML(_urdf(_joint(1) + _joint(2), 3))
    refused("neither a name nor a path nor a Pinocchio model", cartstiff.load, 42)
    refused("unknown frame", cartstiff.load, model, frame="hand", kind=UnknownNameError)
    refused("joint", cartstiff.load, model, locked={"elbow": 1.0}, kind=UnknownNameError)
    refuses("configuration of the Pinocchio model", cartstiff.load, model, q=[0.0] * 7)
    refuses("there are no closures", cartstiff.load, model, actuated=["j1"])
    refuses("closure 1 cannot be used", cartstiff.load, model, closures=["j1"])
    refuses("'closures' belongs to Pinocchio's models", cartstiff.load, "ur5", closures=[])
    refuses("not a geometry model", cartstiff.load, model, visual=3)
    refuses("no joints to lock", cartstiff.load, "stewart-gough", locked={"x": 1.0})


def test_joints_of_a_subtree_that_stand_apart():
    """Pinocchio's own mass matrix and derivatives of gravity want each subtree in one piece."""
    rng = np.random.default_rng(4)
    model = pin.Model()
    for i, parent in enumerate((0, 1, 1, 2, 3, 2), start=1):
        model.addJoint(
            parent, pin.JointModelRY() if i % 2 else pin.JointModelRX(), pin.SE3.Random(), f"j{i}"
        )
        model.appendBodyToJoint(
            i, pin.Inertia(i, rng.normal(size=3), np.eye(3)), pin.SE3.Identity()
        )
    tree = plain_tree(model)
    q, down = rng.normal(size=6), np.array([0.5, -1.0, -9.0])
    posture = TreeState(tree, q)

    def gradient(step):
        return TreeState(tree, q + step).gravity(down).gradient

    found = posture.gravity(down).hessian
    assert absolute_error(jacobian(gradient, np.ones(6)), found) <= 1e-9
    data, v = model.createData(), rng.normal(size=6)
    pin.forwardKinematics(model, data, q, v)
    energy = pin.computeKineticEnergy(model, data)
    assert 0.5 * v @ posture.mass_matrix() @ v == pytest.approx(energy, rel=1e-12)
    alone = tree.mass_matrix(q)
    assert absolute_error(np.triu(alone), np.triu(posture.mass_matrix())) <= 1e-12
