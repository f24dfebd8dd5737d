"""MuJoCo's file holds the load under which the springs' rest positions balance: nothing moves."""

import numpy as np
import pytest
from tests.support.mujoco_files import mujoco_file

import cartstiff

W = [2.0, -1.0, 3.0, 30.0, -20.0, -100.0]
AT = [0.05, -0.02, 0.1]


def mechanism(name, legs=2e3):
    if name == "ur5":
        return cartstiff.load("ur5")
    ring = {"radius": 200.0, "half_angle": 0.2}
    return cartstiff.hexapod(
        base=ring,
        platform={**ring, "radius": 120.0},
        height=250.0,
        body={"mass": 3.0, "com": [1.0, 2.0, -3.0], "inertia": np.diag([2e4, 3e4, 4e4]).tolist()},
        turn=0.8,
        legs=legs,
        units={"length": "mm", "force": "N"},
        frame={"xyz": [3.0, -2.0, 10.0]},
    )


def model_of(result, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "machine.xml").write_bytes(mujoco_file(result))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "machine.xml"))
    return mujoco, model, mujoco.MjData(model)


def jacobian_of(mujoco, model, data, site):
    """Turns (3, n) and translations (3, n) of a site along the room's axes."""
    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, linear, angular, model.site(site).id)
    return angular, linear


def on_site(mujoco, model, data):
    """Wrench (moment, force) along the room's axes about the load's site, from the actuator."""
    J = np.vstack(jacobian_of(mujoco, model, data, "load"))
    return np.linalg.lstsq(J.T, data.qfrc_actuator, rcond=None)[0]


@pytest.mark.parametrize("kind", ["dead", "follower"])
@pytest.mark.parametrize("name", ["ur5", "hexapod"])
def test_the_load_is_in_the_file(tmp_path, name, kind):
    elastic = mechanism(name)
    result = cartstiff.analyse(elastic, wrench=W, load_at=AT, load_kind=kind)
    mujoco, model, data = model_of(result, tmp_path)
    mujoco.mj_forward(model, data)
    largest = np.abs(data.qfrc_spring).max()
    assert largest > 1.0
    assert np.abs(data.qfrc_spring + data.qfrc_actuator).max() <= 1e-9 * largest
    # Moved far, a dead load keeps its direction in the room, a follower turns with the body.
    R0 = data.site("load").xmat.reshape(3, 3).copy()
    before = on_site(mujoco, model, data)
    rates = np.zeros(model.nv)
    rates[-3:] = [0.4, -0.3, 0.5]
    mujoco.mj_integratePos(model, data.qpos, rates, 1.0)
    mujoco.mj_forward(model, data)
    R1 = data.site("load").xmat.reshape(3, 3)
    assert np.abs(R1 - R0).max() > 0.1
    after = on_site(mujoco, model, data)
    turn = np.kron(np.eye(2), np.eye(3) if kind == "dead" else R1 @ R0.T)
    assert after[3:] == pytest.approx((turn @ before)[3:], rel=1e-7, abs=1e-9)
    if kind == "follower":
        assert after == pytest.approx(turn @ before, rel=1e-7, abs=1e-9)
