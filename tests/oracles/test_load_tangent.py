"""The tangent under a load against differences of the equilibrium under that load, and MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support import (
    absolute_error,
    adjoint_reference,
    exp_reference,
    loads_of,
    log_reference,
    relative_error,
    robot_file,
    slope,
)

import cartstiff
from cartstiff import DeadForce, DeadWrench, InputError, LineSprings, equilibrium
from cartstiff.core.errors import UnknownNameError

#: A load about the point, along the body's axes, as a share of what the mechanism bears.
WRENCHES = {
    "dead force": ("dead", [0.0, 0.0, 0.0, 0.6, -0.4, -1.0]),
    "dead moment": ("dead", [0.5, -0.8, 0.3, 0.0, 0.0, 0.0]),
    "dead wrench": ("dead", [0.5, -0.8, 0.3, 0.6, -0.4, -1.0]),
    "follower": ("follower", [0.5, -0.8, 0.3, 0.6, -0.4, -1.0]),
    "conservative": ("conservative", [0.5, -0.8, 0.3, 0.6, -0.4, -1.0]),
}
#: Mechanism, a length of its size, and a force that it bears: serial, redundant, platform, chains.
MECHANISMS = {
    "ur5": (0.1, 100.0),
    "panda": (0.1, 20.0),
    "cubic": (0.1, 200.0),
    "hexapod": (0.1, 20.0),
    "6-ups": (0.1, 20.0),
}
HEXAPOD = ("dead wrench", "conservative")


def _motion_per_wrench(elastic, loads, state, T, size):
    """d(twist of frame N) / d(wrench added there), by differences; N = M T."""
    pose = state.pose @ T
    R, n = pose[:3, :3], T[:3, 3]
    columns = []
    for i in range(6):
        unit = np.eye(6)[i]

        def motion(t, unit=unit):
            # To first order it does not matter what the small added wrench does.
            added = [DeadForce(R @ unit[3:] * t, n), DeadWrench([*(R @ unit[:3] * t), 0, 0, 0])]
            there = equilibrium(elastic, state.q, *loads, *added, limits=False, settle=False)
            return log_reference(np.linalg.inv(pose) @ there.pose @ T)

        columns.append(slope(motion, size if i > 2 else size * 0.1))
    return np.column_stack(columns)


@pytest.mark.parametrize(
    ("name", "load"),
    # A second platform under what differs most.
    [(n, w) for n in MECHANISMS for w in WRENCHES if n != "hexapod" or w in HEXAPOD],
)
def test_the_tangent_is_the_derivative_of_the_equilibrium(name, load):
    if name in ("ur5", "panda"):
        robot_file("ur_description/urdf/ur5_robot.urdf")
    length, force = MECHANISMS[name]
    kind, shares = WRENCHES[load]
    elastic = cartstiff.load(name)
    unit = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}[elastic.units.length]
    length /= unit
    p = length * np.array([0.7, -0.4, 1.1])
    w = np.array(shares) * force * np.repeat([length, 1.0], 3)
    result = cartstiff.analyse(elastic, wrench=w, load_kind=kind, load_at=p)
    loads = loads_of(kind, w, p, result.pose[:3, :3], length)
    state = equilibrium(result.elastic, result.q, *loads, limits=False, settle=False)
    assert absolute_error(state.q, result.q) < 1e-9
    sizes = np.repeat([length, 1.0], 3)
    for point in (np.zeros(3), length * np.array([-0.2, 0.5, 0.3])):
        T = np.eye(4)
        T[:3, 3] = point
        here = result.at(T)
        C = _motion_per_wrench(result.elastic, loads, state, T, 0.02 * force)
        scaled = C * sizes * sizes[:, None]
        missed = (here.compliances["load"] - C) * sizes * sizes[:, None]
        assert np.abs(missed).max() < 1e-8 * np.abs(scaled).max()
        assert np.allclose(
            here.matrices["load"] @ here.compliances["load"], np.eye(6), rtol=0, atol=1e-6
        )
    # No letter fits but where the words say so.
    missed = absolute_error(result.tangent, result.matrices["A"])
    assert (missed < 1e-12 * np.abs(result.tangent).max()) == (kind == "follower")


def test_kinds_that_are_letters():
    arm, w = cartstiff.load("cubic"), np.array([0.3, -0.2, 0.4, 20.0, -30.0, -60.0])
    by_kind = {
        kind: cartstiff.analyse(arm, wrench=w, load_kind=kind)
        for kind in ("dead", "follower", "conservative")
    }
    scale = np.abs(by_kind["dead"].tangent).max()
    assert (
        absolute_error(by_kind["follower"].tangent, by_kind["dead"].matrices["A"]) < 1e-14 * scale
    )
    there = by_kind["conservative"]
    assert absolute_error(there.tangent, there.matrices["K"]) < 1e-14 * scale
    assert absolute_error(there.tangent, there.tangent.T) < 1e-14 * scale
    dead = by_kind["dead"].tangent
    assert absolute_error(dead, dead.T) == pytest.approx(np.abs(w[:3]).max(), rel=1e-9)
    force = cartstiff.analyse(arm, wrench=[0, 0, 0, *w[3:]])
    assert absolute_error(force.tangent, force.matrices["K"]) < 1e-14 * scale


def test_a_load_that_is_a_spring_in_the_room_belongs_to_the_mechanism():
    """Then nothing is left for the environment to hold: every connection gives the tangent."""
    arm = cartstiff.load("cubic")
    R, p = cartstiff.analyse(arm).pose[:3, :3], np.array([0.02, 0.01, 0.05])
    origin = cartstiff.analyse(arm).pose[:3, 3]
    away = np.array([0.3, -0.2, 1.5])
    spring = LineSprings(
        anchors=np.array([origin + R @ p + away]),
        points=np.array([p]),
        stiffness=np.array([400.0]),
        rest_length=np.array([np.linalg.norm(away) - 0.25]),
    )
    result = cartstiff.analyse(arm.with_potential(spring))
    assert not result.is_loaded
    for name in ("A", "K"):
        difference = absolute_error(result.matrices[name], result.tangent)
        assert difference < 1e-9 * np.abs(result.tangent).max()
    state = equilibrium(result.elastic, q=result.q, limits=False)
    C = _motion_per_wrench(result.elastic, [], state, np.eye(4), 5.0)
    assert relative_error(result.tangent_compliance, C) < 1e-8


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_the_compliance_exists_at_singular_postures(name):
    robot_file("ur_description/urdf/ur5_robot.urdf")
    elastic = cartstiff.load(name)
    q = np.zeros(len(elastic.q)) if name == "ur5" else np.array([0, 0, 0, -1.5, 0, 0, 0.0])
    w, p = np.array([1.0, -2.0, 0.5, 30.0, -20.0, -50.0]), np.array([0.05, -0.02, 0.1])
    result = cartstiff.analyse(elastic, q, wrench=w, load_at=p)
    if result.tangent is not None:
        pytest.skip("regular")
    loads = loads_of("dead", w, p, result.pose[:3, :3], 0.1)
    state = equilibrium(result.elastic, result.q, *loads, limits=False, settle=False)
    C = _motion_per_wrench(result.elastic, loads, state, np.eye(4), 2.0)
    assert relative_error(result.tangent_compliance, C) < 1e-8


def test_world_axes_and_the_point_make_the_wrench():
    arm = cartstiff.load("cubic")
    R, p = cartstiff.analyse(arm).pose[:3, :3], np.array([0.02, 0.01, 0.05])
    turned = replace(arm, q=arm.q + np.array([0, 0, 0, 0.1, -0.2, 0.3]))
    R = cartstiff.analyse(turned).pose[:3, :3]
    w = np.array([0.3, -0.2, 0.4, 20.0, -30.0, -60.0])
    found = cartstiff.analyse(turned, wrench=w, load_at=p, load_axes="world").wrench
    moment, force = R.T @ w[:3], R.T @ w[3:]
    assert found == pytest.approx([*(moment + np.cross(p, force)), *force], rel=1e-9)


def test_the_tangent_moves_as_a_tensor_with_its_point():
    arm, rng = cartstiff.load("cubic"), np.random.default_rng(3)
    w, p = rng.normal(size=6) * 20.0, rng.normal(size=3) * 0.1
    T = exp_reference(rng.normal(size=6) * np.repeat([0.5, 0.1], 3))
    result = cartstiff.analyse(arm, wrench=w, load_at=p)
    Ad = adjoint_reference(T)
    there = result.at(T)
    scale = np.abs(there.matrices["load"]).max()
    assert absolute_error(there.matrices["load"], Ad.T @ result.tangent @ Ad) < 1e-13 * scale
    assert np.allclose(result.pose @ T, there.pose)
    assert np.allclose(T @ [*there.load.at, 1.0], [*p, 1.0])
    moved = result.tensor("load").to_frame(T).matrix
    assert absolute_error(there.matrices["load"], moved) < 1e-12 * scale
    with pytest.raises(ValueError, match="read-only"):
        there.matrices["load"][0, 0] = 1.0


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"load_kind": "soft"}, UnknownNameError, "kind of load"),
        ({"load_at": [0, 0]}, InputError, "point of the load"),
        ({"load_at": [0, 0, np.nan]}, InputError, "point of the load"),
        ({"wrench": [0] * 6, "load_axes": "tool"}, UnknownNameError, "axes"),
    ],
)
def test_refusals(options, error, words):
    with pytest.raises(error, match=words):
        cartstiff.analyse(cartstiff.load("cubic"), **options)


def test_mujoco_gives_the_same_motion_under_a_force_off_the_origin(tmp_path):
    """MuJoCo's own kinematics, point Jacobians and joint springs, solved by Newton's method."""
    mujoco = pytest.importorskip("mujoco")
    axes = ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "1 0 0")
    text = ""
    for i, axis in enumerate(axes):
        text += (
            f'<body name="b{i}" pos="0.02 {0.03 * (i % 2)} {0.1 + 0.02 * i}">'
            f'<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
            f'<joint name="j{i}" type="hinge" axis="{axis}" stiffness="{60 + 10 * i}"/>'
        )
    text += '<site name="tip" pos="0.05 0.02 0.1"/>' + "</body>" * 6
    xml = f'<mujoco><option gravity="0 0 0"/><worldbody>{text}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    q0 = np.array([0.3, -0.5, 0.7, 0.6, -0.4, 0.5])
    p_tip, force = np.array([0.04, -0.03, 0.08]), np.array([9.0, -6.0, -12.0])
    site = model.site("tip").id

    def tip(q):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return data.site_xmat[site].reshape(3, 3).copy(), data.site_xpos[site].copy()

    def torque(q, forces, moment):
        """Generalised force of dead forces at body points and of a moment in the room."""
        R, x = tip(q)
        total = np.zeros(6)
        Jp, Jr = np.zeros((3, 6)), np.zeros((3, 6))
        for f, c in forces:
            mujoco.mj_jac(model, data, Jp, Jr, x + R @ c, model.body("b5").id)
            total += Jp.T @ f
        return total + Jr.T @ moment

    k = np.array(model.jnt_stiffness).ravel()[:6]
    R, x = tip(q0)
    rest = q0 - torque(q0, [(force, p_tip)], np.zeros(3)) / k

    def settled(extra_force, extra_moment, point):
        q = q0.copy()

        def left(q):
            loads = [(force, p_tip), (extra_force, point)]
            return k * (q - rest) - torque(q, loads, extra_moment)

        for _ in range(30):
            J = np.column_stack(
                [slope(lambda t, e=e, q=q: left(q + t * e), 1e-3) for e in np.eye(6)]
            )
            step = np.linalg.solve(J, left(q))
            q = q - step
            if np.abs(step).max() < 1e-14:
                break
        return tip(q)

    point = np.array([-0.02, 0.05, 0.03])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, x + R @ point
    C = np.empty((6, 6))
    for i in range(6):
        unit = np.eye(6)[i]

        def motion(t, unit=unit):
            there, at = settled(R @ unit[3:] * t, R @ unit[:3] * t, point)
            moved = np.eye(4)
            moved[:3, :3], moved[:3, 3] = there, at + there @ point
            return log_reference(np.linalg.inv(pose) @ moved)

        C[:, i] = slope(motion, 0.05)

    file = tmp_path / "arm.xml"
    file.write_text(xml, encoding="utf-8")
    arm = cartstiff.load(file, frame="tip")
    assert np.allclose(arm.springs.stiffness, k)
    result = cartstiff.analyse(arm, q0, wrench=[0, 0, 0, *force], load_at=p_tip, load_axes="world")
    T = np.eye(4)
    T[:3, 3] = point
    assert np.allclose(result.pose[:3, 3], x, atol=1e-12)
    got = result.at(T).compliances["load"]
    assert relative_error(got, C) < 1e-8
    off = result.at(T).compliances["K"]  # K^K belongs to the force at M's origin only
    assert absolute_error(off, C) > 1e-3 * np.abs(C).max()
