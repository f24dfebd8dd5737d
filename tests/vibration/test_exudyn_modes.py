"""Frequencies of platforms under load against Exudyn's own linearisation.

The force acts at the mass centre: Exudyn leaves out how a load's lever turns, and feels the load by
what it does to the legs.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.support import general_legs, legs_as_platform

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
