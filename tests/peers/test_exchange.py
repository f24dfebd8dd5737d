"""MuJoCo computes the same stiffness from a file of the same machine."""

import numpy as np
import pytest
from tests.peers.test_exchange_load import jacobian_of, mechanism, model_of
from tests.support import relative_error

import cartstiff

LOAD = [5.0, -3.0, 2.0, 100.0, -50.0, -300.0]


def test_mujoco_has_the_stiffness(tmp_path):
    """Forces of its tendons at small motions, in millimetres and under a load."""
    legs = {"stiffness": 2e3, "preload": [100.0, -50.0, 30.0, 20.0, 10.0, -70.0]}
    platform = mechanism("hexapod", legs)
    q = platform.q + np.array([5.0, -3.0, 4.0, 0.1, 0.05, -0.2])
    result = cartstiff.analyse(platform, q)
    mujoco, model, data = model_of(result, tmp_path)

    def wrench(x):
        """Of the springs on the body's coordinates: force in the room, moment in the body."""
        data.qpos[:] = model.qpos0
        mujoco.mj_integratePos(model, data.qpos, np.concatenate([x[3:], x[:3]]), 1.0)
        mujoco.mj_forward(model, data)
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, data.qpos[3:])
        force = R.reshape(3, 3).T @ data.qfrc_spring[:3]
        return -np.concatenate([data.qfrc_spring[3:], force])

    h = 1e-5
    R = result.pose[:3, :3]
    rates = []
    for i in range(6):
        x = np.zeros(6)
        x[i] = h
        x[3:] = R @ x[3:]  # its translations are along the room's axes
        rates.append((wrench(x) - wrench(-x)) / (2 * h))
    sizes = np.repeat([1e-3, 1.0], 3)
    W = result.wrench * sizes
    assert relative_error(wrench(np.zeros(6)), W) <= 1e-9
    K = result.A.matrix * np.outer(sizes, np.repeat([1.0, 1e3], 3))
    assert relative_error(np.array(rates).T, K) <= 1e-8
    assert model.body("platform").mass[0] == 3.0


@pytest.mark.parametrize("name", ["6-pus", "3-rps", "tricept", "five-bar", "ur5"])
def test_mujoco_moves_a_chain_as_we_do(tmp_path, name):
    """Its poses, and the compliance by its own Jacobians: springs under its closures.

    The posture is a little off the file's.
    """
    elastic = cartstiff.load(name)
    if elastic.mechanism.kind != "serial":
        drives = [elastic.names.index(n) for n in elastic.spring_names if n in elastic.names]
        q = elastic.q.copy()
        q[drives] += 0.02 * np.arange(len(drives)) / len(drives)
        result = cartstiff.analyse(elastic, elastic.mechanism.closed(q).q)
    else:
        result = cartstiff.analyse(elastic, elastic.q + 0.1)
    mujoco, model, data = model_of(result, tmp_path)
    mujoco.mj_forward(model, data)
    assert np.allclose(data.qpos, result.q, atol=1e-12)
    site = data.site("M")
    assert np.allclose(site.xpos, result.pose[:3, 3], atol=1e-9)
    R = site.xmat.reshape(3, 3)
    assert np.allclose(R, result.pose[:3, :3], atol=1e-9)
    J = np.vstack([R.T @ rows for rows in jacobian_of(mujoco, model, data, "M")])
    ties = data.efc_J.reshape(-1, model.nv)[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    free = np.eye(model.nv)
    if len(ties):
        _, s, V = np.linalg.svd(ties)
        free = V[np.sum(s > 1e-9 * s[0]) :].T
    k = free.T @ np.diag(model.jnt_stiffness) @ free
    C = J @ free @ np.linalg.solve(k, (J @ free).T)
    assert relative_error(C, result.compliances["B"]) <= 1e-7
    assert np.abs(data.qfrc_spring).max() <= 1e-9 * model.jnt_stiffness.max()
    again = cartstiff.analyse(cartstiff.load(tmp_path / "machine.xml", frame="M"))
    assert np.allclose(again.pose, result.pose, atol=1e-9)
    assert relative_error(again.compliances["B"], result.compliances["B"]) <= 1e-7


def test_springs_in_mujoco_carry_the_load(tmp_path):
    elastic = cartstiff.load("ur5")
    result = cartstiff.analyse(elastic, elastic.q + 0.1, wrench=LOAD)
    mujoco, model, data = model_of(result, tmp_path)
    mujoco.mj_forward(model, data)
    assert np.allclose(-data.qfrc_spring, result.jacobian.T @ result.wrench, rtol=1e-9)


def test_a_rigid_joint_is_rigid_in_mujoco(tmp_path):
    """MuJoCo holds the joint where its file begins."""
    arm = cartstiff.load("ur5").with_springs({"elbow_joint": np.inf})
    result = cartstiff.analyse(arm, wrench=LOAD)
    mujoco, model, data = model_of(result, tmp_path)
    mujoco.mj_forward(model, data)
    assert model.joint("elbow_joint").stiffness[0] == 0.0
    assert np.abs(data.efc_pos) == pytest.approx([0.0], abs=1e-12)
