"""Arms and loops under load against MuJoCo: its kinematics, springs, weights and constraints.

MuJoCo gives the generalised forces; where they vanish is found here by Newton's method on their
differences, which knows nothing of second derivatives.
"""

import numpy as np
import pytest
from tests.mechanisms.machines import write_file
from tests.support import absolute_error, log_reference, relative_error

from cartstiff import DeadForce, FollowerWrench, equilibrium, load

mujoco = pytest.importorskip("mujoco")

# Equilibria solved by two Newton's methods, MuJoCo's to 1e-12; and differences of them.
STATE, TANGENT = 1e-10, 1e-7
STEP = 1e-6

ARM = """<mujoco><compiler angle="radian" autolimits="true"/>
<option gravity="0 0 -9.81"/><worldbody>
<body name="a" pos="0 0 0.2"><inertial pos="0 0 0.1" mass="3" diaginertia="1 1 1"/>
<joint name="a" axis="0 0 1" stiffness="900" springref="0.2"/>
<body name="b" pos="0.05 0 0.2"><inertial pos="0.1 0 0" mass="2" diaginertia="1 1 1"/>
<joint name="b" axis="0 1 0" stiffness="700" springref="-0.4"/>
<body name="c" pos="0.3 0 0"><inertial pos="0.1 0 0.02" mass="1.5" diaginertia="1 1 1"/>
<joint name="c" axis="0 1 0" stiffness="500" springref="0.7"/>
<body name="d" pos="0.25 0.02 0"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<joint name="d" axis="1 0 0" stiffness="120" springref="0.1"/>
<body name="e" pos="0.05 0 0"><inertial pos="0 0 0" mass="0.5" diaginertia="1 1 1"/>
<joint name="e" type="slide" axis="0 0.6 0.8" stiffness="9000"/>
<body name="f" pos="0.04 0 0"><inertial pos="0.03 0 0" mass="0.5" diaginertia="1 1 1"/>
<joint name="f" axis="0 1 0" stiffness="90" springref="-0.3"/>
{more}<site name="tip" pos="0.08 0.01 0.02"/></body></body></body></body></body></body>
</worldbody></mujoco>"""
SEVENTH = """<body name="g" pos="0.02 0 0"><inertial pos="0 0 0.02" mass="0.2" diaginertia="1 1 1"/>
<joint name="g" axis="0 0 1" stiffness="60"/></body>"""

LOOP = """<mujoco><compiler angle="radian" autolimits="true"/>
<option gravity="0 0 -9.81"/><worldbody>
<body name="left" pos="-0.15 0 0"><inertial pos="0.15 0 0" mass="2" diaginertia="1 1 1"/>
<joint name="left" axis="0 -1 0" stiffness="400" springref="1.9"/>
<body name="bar" pos="0.3 0 0"><inertial pos="0.2 0 0" mass="1" diaginertia="1 1 1"/>
<joint name="elbow" axis="0 -1 0" stiffness="30" springref="-1.2"/>
<site name="tip" pos="0.45 0 0.05"/></body></body>
<body name="right" pos="0.15 0 0"><inertial pos="0.15 0 0" mass="2" diaginertia="1 1 1"/>
<joint name="right" axis="0 -1 0" stiffness="300" springref="1.2"/>
<body name="rod" pos="0.3 0 0"><inertial pos="0.2 0 0" mass="1" diaginertia="1 1 1"/>
<joint name="wrist" axis="0 -1 0" stiffness="20" springref="1.0"/></body></body>
</worldbody>
<equality><connect body1="bar" body2="rod" anchor="0.4 0 0"/></equality></mujoco>"""


class Peer:
    """A model at rest under loads at the site `tip`."""

    def __init__(self, xml):
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.site = self.model.site("tip").id
        self.body = int(self.model.site_bodyid[self.site])

    def tip(self, q):
        self.data.qpos[:] = q
        mujoco.mj_forward(self.model, self.data)
        T = np.eye(4)
        T[:3, :3] = self.data.site_xmat[self.site].reshape(3, 3)
        T[:3, 3] = self.data.site_xpos[self.site]
        return T

    def forces(self, q, dead, follower):
        """Generalised forces of all but the constraints; their residual and Jacobian."""
        T = self.tip(q)
        total = self.data.qfrc_passive - self.data.qfrc_bias
        moment = T[:3, :3] @ follower[:3]
        force = T[:3, :3] @ follower[3:] + dead
        mujoco.mj_applyFT(self.model, self.data, force, moment, T[:3, 3], self.body, total)
        rows = self.data.ne
        J = self.data.efc_J.reshape(-1, self.model.nv)[:rows].copy()
        return total, self.data.efc_pos[:rows].copy(), J

    def settled(self, q, dead=(0.0, 0.0, 0.0), follower=(0.0,) * 6):
        """Coordinates at which forces and constraints balance."""
        dead, follower = np.asarray(dead, float), np.asarray(follower, float)
        _, _, J = self.forces(q, dead, follower)
        lam = np.zeros(len(J))

        def left(x):
            force, missed, J = self.forces(x[: q.size], dead, follower)
            return np.concatenate([force + J.T @ x[q.size :], missed])

        x = np.concatenate([q, lam])
        for _ in range(60):
            columns = [
                (left(x + STEP * e) - left(x - STEP * e)) / (2 * STEP) for e in np.eye(x.size)
            ]
            step = np.linalg.lstsq(np.stack(columns, axis=1), -left(x), rcond=1e-12)[0]
            size = np.abs(step[: q.size]).max()
            x = x + step * min(1.0, 0.3 / max(size, 1e-300))
            if size < 1e-13:
                break
        return x[: q.size]


def _read(folder, xml, **more):
    path = folder / "model.xml"
    path.write_text(xml, encoding="utf-8")
    return load(write_file(folder, "model", model="model.xml", frame="tip", **more))


def _start(elastic, peer):
    """Coordinates at MuJoCo's own order."""
    order = [peer.model.joint(name).qposadr[0] for name in elastic.names]
    q = np.zeros(peer.model.nq)
    q[order] = elastic.q
    return q


LOADS = {
    "dead": {"dead": [30.0, -20.0, -60.0]},
    "follower": {"follower": [4.0, -3.0, 2.0, 20.0, 15.0, -40.0]},
}


def _ours(kind):
    return DeadForce(kind["dead"]) if "dead" in kind else FollowerWrench(kind["follower"])


@pytest.mark.parametrize("more", ["", SEVENTH], ids=["six joints", "a bystander"])
@pytest.mark.parametrize("kind", LOADS)
def test_arm(tmp_path, kind, more):
    xml = ARM.format(more=more)
    peer = Peer(xml)
    names = list("abcdef")
    rest = {n: float(peer.model.qpos_spring[peer.model.joint(n).qposadr[0]]) for n in names}
    springs = {
        n: {"stiffness": float(peer.model.joint(n).stiffness[0]), "rest": rest[n]} for n in names
    }
    elastic = _read(
        tmp_path, xml, kind="serial", springs=springs, gravity=[0.0, 0.0, -9.81], q=rest
    )
    state = equilibrium(elastic, _ours(LOADS[kind]))
    q = peer.settled(_start(elastic, peer), **LOADS[kind])
    T = peer.tip(q)
    if not more:  # the bystander weighs, but its link is no part of the chain
        assert absolute_error(state.pose, T) <= STATE
        _tangent(state, peer, q, LOADS[kind])


def _tangent(state, peer, q, load):
    """K^A at M: twist of M, in its own axes, per wrench that follows it, by differences."""
    T = peer.tip(q)
    C = np.empty((6, 6))
    for i, e in enumerate(np.eye(6)):
        size = 1e-2
        ends = []
        for sign in (1.0, -1.0):
            extra = np.asarray(load.get("follower", np.zeros(6)), float) + sign * size * e
            moved = peer.settled(q, load.get("dead", np.zeros(3)), extra)
            ends.append(log_reference(np.linalg.inv(T) @ peer.tip(moved)))
        C[:, i] = (ends[0] - ends[1]) / (2 * size)
    ours = state.stiffness if "dead" in load else state.elastic_stiffness
    assert relative_error(ours.compliances["A"], C) <= TANGENT


@pytest.mark.parametrize("kind", LOADS)
def test_loop(tmp_path, kind):
    peer = Peer(LOOP)
    plane = (
        {"dead": [30.0, 0.0, -60.0]}
        if kind == "dead"
        else {"follower": [0.0, 3.0, 0.0, 20.0, 0.0, -40.0]}
    )
    names = ["left", "elbow", "right", "wrist"]
    springs = {
        n: {
            "stiffness": float(peer.model.joint(n).stiffness[0]),
            "rest": float(peer.model.qpos_spring[peer.model.joint(n).qposadr[0]]),
        }
        for n in names
    }
    elastic = _read(
        tmp_path,
        LOOP,
        kind="closed-chain",
        springs=springs,
        gravity=[0.0, 0.0, -9.81],
        q={n: s["rest"] for n, s in springs.items()},
    )
    state = equilibrium(elastic, _ours(plane))
    # From where cartstiff came to rest, and a little beside it.
    start = np.zeros(peer.model.nq)
    order = [peer.model.joint(name).qposadr[0] for name in elastic.names]
    start[order] = state.q
    q = peer.settled(start + 1e-2, **plane)
    assert absolute_error(state.pose, peer.tip(q)) <= STATE
    if kind == "follower":
        return  # two freedoms do not say which part of the load the linkage itself carries
    # The tip's displacement per force in the plane.
    T, size = peer.tip(q), 1e-2
    moved = []
    for axis in np.eye(3)[[0, 2]]:
        ends = [peer.tip(peer.settled(q, plane["dead"] + s * size * axis)) for s in (1, -1)]
        moved.append((ends[0] - ends[1])[[0, 2], 3] / (2 * size))
    C = T[:3, :3] @ state.stiffness.compliances["K"][3:, 3:] @ T[:3, :3].T
    assert relative_error(C[np.ix_([0, 2], [0, 2])], np.stack(moved, axis=1)) <= TANGENT
