"""Frequencies under load against Exudyn: arms, platforms, closed chains.

Platforms by its own linearisation, with the force at the mass centre: it leaves out how a load's
lever turns, and feels the load by what it does to the legs.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.support import general_legs, legs_as_platform
from tests.vibration.exudyn_tree import ExudynTree
from tests.vibration.test_mujoco_modes import FIVE_BAR, TRIPOD, _loaded, arm_xml

from cartstiff import DeadForce, equilibrium, modes

#: Required.
FREQUENCIES = 1e-6
# Entries of an inertia tensor in Exudyn's order.
_ORDER = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
LOADS = [(5, [150.0, -60.0, -200.0]), (8, [-40.0, 90.0, 120.0])]


def peer(platform, springs, q, force):
    """Hz, of a rigid body with Tait-Bryan angles on spring-dampers."""
    exu = pytest.importorskip("exudyn")
    items = pytest.importorskip("exudyn.itemInterface")
    tools = pytest.importorskip("exudyn.utilities")
    system = exu.SystemContainer().AddSystem()
    centre = platform.mass_centre  # in P, which is M here
    R = Rotation.from_euler("xyz", q[3:]).as_matrix()
    c = np.array(
        [[0, -centre[2], centre[1]], [centre[2], 0, -centre[0]], [-centre[1], centre[0], 0]]
    )
    about = platform.body_inertia[:3, :3] + platform.mass * c @ c
    node = system.AddNode(
        items.NodeRigidBodyRxyz(
            referenceCoordinates=[*(R @ centre + q[:3]), *tools.RotationMatrix2RotXYZ(R)],
        )
    )
    body = system.AddObject(
        items.ObjectRigidBody(
            mass=float(platform.mass),
            inertia=[float(about[i, j]) for i, j in _ORDER],
            nodeNumber=node,
        )
    )
    ground = system.AddObject(items.ObjectGround())
    for k, rest, a, b in zip(
        springs.stiffness, springs.rest_length, platform.anchors, platform.points, strict=True
    ):
        ends = [
            system.AddMarker(items.MarkerBodyPosition(bodyNumber=n, localPosition=list(p)))
            for n, p in ((ground, a), (body, b - centre))
        ]
        system.AddObject(
            items.ObjectConnectorSpringDamper(
                markerNumbers=ends,
                referenceLength=rest,
                stiffness=k,
                damping=0.0,
            )
        )
    at = system.AddMarker(items.MarkerBodyPosition(bodyNumber=body, localPosition=[0.0, 0.0, 0.0]))
    system.AddLoad(items.LoadForceVector(markerNumber=at, loadVector=list(map(float, force))))
    system.Assemble()
    values, _ = system.ComputeODE2Eigenvalues()
    return np.sort(np.sqrt(np.maximum(values, 0.0))) / (2 * np.pi)


@pytest.mark.parametrize(("seed", "force"), LOADS)
def test_platforms(seed, force):
    elastic = legs_as_platform(
        general_legs(seed),
        mass=6.0,
        mass_centre=[0.03, -0.02, 0.05],
        inertia=np.diag([0.4, 0.5, 0.7]),
    )
    state = equilibrium(elastic, DeadForce(force, elastic.mechanism.mass_centre))
    found = modes(state).frequencies
    hertz = peer(elastic.mechanism, elastic.springs, state.q, force)
    assert np.abs(hertz / found - 1).max() < FREQUENCIES


def _against_the_tree(folder, xml, force, kind):
    """Both at the rest that the mechanism finds; Exudyn says what is not balanced there."""
    peer = ExudynTree(xml, force)
    springs = {
        name: {"stiffness": k, "rest": rest}
        for name, k, rest in zip(peer.names, peer.k, peer.rest, strict=True)
    }
    elastic = _loaded(
        folder, xml, kind=kind, springs=springs, q=dict(zip(peer.names, peer.rest, strict=True))
    )
    state = equilibrium(elastic, DeadForce(force))
    q = dict(zip(elastic.names, state.q, strict=True))
    squares, left = peer.squares(np.array([q[name] for name in peer.names]))
    assert left < 1e-9
    assert np.abs(np.sqrt(squares / modes(state).squares) - 1).max() < FREQUENCIES


@pytest.mark.parametrize(
    ("kinds", "seed"),
    [("HHHHHH", 1), ("HHHHHHH", 2), ("HHSHHH", 3), ("HHHH", 4), ("SHHHHHH", 5), ("HHHHHH", 6)],
)
def test_arms(tmp_path, kinds, seed):
    xml, _ = arm_xml(kinds, seed)
    _against_the_tree(tmp_path, xml, [20.0, -15.0, -40.0], "serial")


@pytest.mark.parametrize(
    ("xml", "force"),
    [(FIVE_BAR, [30.0, 0.0, -60.0]), (TRIPOD, [20.0, -12.0, -30.0])],
    ids=["five bar", "two legs in space"],
)
def test_closed_chains(tmp_path, xml, force):
    _against_the_tree(tmp_path, xml, force, "closed-chain")
