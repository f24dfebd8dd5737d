"""Torques, forces of loops and the wrench in each joint against MuJoCo, for connect and weld.

MuJoCo's own solver keeps a loop softly. Here the Jacobian of its constraints gives the forces that
keep it exactly, and its sensors read every joint under these.
"""

from __future__ import annotations

import numpy as np
import pytest

import cartstiff as cs

#: Joints of each branch, and how many of both are driven, so that the drives have no choice.
KINDS = {"connect": (3, 3), "weld": (5, 4)}


def model_of(kind: str, seed: int) -> tuple[str, list[str]]:
    """Two branches of random hinges whose last bodies are tied where they are at home."""
    rng, (n, _) = np.random.default_rng([seed, n_of(kind)]), KINDS[kind]
    bodies, sensors, names = "", "", []
    for branch in "ab":
        ends = ""
        for i in range(n):
            name = f"{branch}{i}"
            place, turn = rng.uniform([-0.2, -0.4, -0.4], [0.6, 0.4, 0.4]), rng.uniform(-1, 1, 3)
            centre, mass = rng.uniform(-0.1, 0.1, 3), rng.uniform(0.5, 3.0)
            at, turned, axis, com = (
                " ".join(map(repr, np.ravel(x).tolist()))
                for x in (place, turn, rng.normal(size=3), centre)
            )
            bodies += f'<body name="{name}" pos="{at}" euler="{turned}">'
            bodies += f'<joint name="j{name}" axis="{axis}"/><site name="s{name}"/>'
            bodies += f'<inertial pos="{com}" mass="{mass!r}" diaginertia="1 1 1"/>'
            sensors += f'<torque site="s{name}"/><force site="s{name}"/>'
            ends += "</body>"
            names.append(name)
        bodies += ends
    last = f'body1="a{n - 1}" body2="b{n - 1}"'
    anchor = ' anchor="0.1 0.05 -0.1"' if kind == "connect" else ""
    return (
        '<mujoco><compiler angle="radian"/><option gravity="0.4 -0.3 -9.7"/>'
        f"<worldbody>{bodies}</worldbody><equality><{kind} {last}{anchor}/></equality>"
        f"<sensor>{sensors}</sensor></mujoco>"
    ), names


def n_of(kind: str) -> int:
    return KINDS[kind][0]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_mujoco_has_the_same_forces_in_loops(kind, seed, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    xml, names = model_of(kind, seed)
    (tmp_path / "loop.xml").write_text(xml)
    n, count = KINDS[kind]
    driven = [f"j{name}" for name in names[:count]]
    springs = {f"j{name}": 2e4 if f"j{name}" in driven else 0.0 for name in names}
    elastic = cs.load(str(tmp_path / "loop.xml"), frame=f"a{n - 1}", stiffness=springs)
    rng = np.random.default_rng(seed)
    q = elastic.mechanism.closed(elastic.q + rng.uniform(-0.1, 0.1, elastic.q.size)).q
    W = rng.uniform(-50.0, 50.0, 6)
    result = cs.analyse(elastic, q, wrench=W)
    torques = {one.name: one.force for one in result.forces}
    assert set(torques) == set(driven)

    # The same posture in MuJoCo, under the motors' torques, the weights and the load.
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    for name, x in zip(elastic.names, result.q, strict=True):
        data.qpos[model.joint(name).qposadr] = x
    mujoco.mj_forward(model, data)
    body = model.body(f"a{n - 1}").id
    R, at = data.xmat[body].reshape(3, 3), data.xpos[body]
    force, moment = R @ W[3:], R @ W[:3]
    data.xfrc_applied[body] = [*force, *(moment - np.cross(data.xipos[body] - at, force))]
    given = np.zeros(model.nv)
    mujoco.mj_applyFT(model, data, force, moment, at, body, given)
    for name, torque in torques.items():
        given[model.joint(name).dofadr] += torque
    # Its constraints' forces without their softness: they leave no acceleration.
    J = data.efc_J.reshape(-1, model.nv)[: data.ne]
    needed = data.qfrc_bias - given
    multipliers = np.linalg.lstsq(J.T, needed, rcond=None)[0]
    largest = np.abs(needed).max()
    assert np.abs(J.T @ multipliers - needed).max() <= 1e-8 * largest

    # The closure's wrench on its second body, and its opposite on the first.
    (closure,) = (one for one in result.wrenches if one.kind == "closure")
    own, point = np.zeros(model.nv), closure.pose[:3, 3]
    for name, sign in ((f"b{n - 1}", 1.0), (f"a{n - 1}", -1.0)):
        wrench = sign * closure.in_room
        which = model.body(name).id
        mujoco.mj_applyFT(model, data, wrench[3:], wrench[:3], point, which, own)
    assert own == pytest.approx(needed, rel=0, abs=1e-8 * largest)

    # Its sensors, with these forces and nothing that accelerates.
    data.efc_force[: data.ne], data.qacc[:] = multipliers, 0.0
    mujoco.mj_rnePostConstraint(model, data)
    mujoco.mj_sensorAcc(model, data)
    measured = dict(zip(names, data.sensordata.reshape(-1, 6), strict=True))
    joints = {one.name: one.wrench for one in result.wrenches if one.kind == "joint"}
    assert set(joints) == {f"j{name}" for name in names}
    size = max(np.abs(one).max() for one in measured.values())
    for name, wrench in measured.items():
        assert joints[f"j{name}"] == pytest.approx(wrench, rel=0, abs=1e-8 * size)
