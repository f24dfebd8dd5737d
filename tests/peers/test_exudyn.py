"""Flexible members under load against Exudyn: geometrically exact beams that stretch and shear.

Exudyn's two-node elements converge with the square of their length: two meshes are extrapolated.
"""

from itertools import pairwise

import numpy as np
import pytest
from tests.mechanisms.bars import EI, SECTION, bar
from tests.peers.opensees import extrapolated
from tests.support import relative_error

from cartstiff import DeadForce, FollowerWrench, equilibrium

# What is left of Exudyn's mesh after extrapolation, and of its Newton iterations.
MESH = 3e-6
AXIAL, SHEAR = 2e7, 1e6
STEPS = 10


def tip(count, force=(0.0, 0.0), moment=0.0, shear=SHEAR):
    """Tip (x, y) of a bar of length 1 clamped at the origin, under dead loads in its plane."""
    exu = pytest.importorskip("exudyn")
    items = pytest.importorskip("exudyn.itemInterface")
    system = exu.SystemContainer().AddSystem()
    nodes = [
        system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[i / count, 0.0, 0.0]))
        for i in range(count + 1)
    ]
    for a, b in pairwise(nodes):
        system.AddObject(
            items.ObjectBeamGeometricallyExact2D(
                nodeNumbers=[a, b],
                length=1 / count,
                massPerLength=1.0,
                crossSectionInertia=1.0,
                bendingStiffness=EI,
                axialStiffness=AXIAL,
                shearStiffness=shear,
            )
        )
    ground = system.AddMarker(
        items.MarkerNodeCoordinate(nodeNumber=system.AddNode(items.NodePointGround()), coordinate=0)
    )
    for coordinate in range(3):
        foot = system.AddMarker(
            items.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=coordinate)
        )
        system.AddObject(items.CoordinateConstraint(markerNumbers=[ground, foot]))
    end = system.AddMarker(items.MarkerNodeRigid(nodeNumber=nodes[-1]))
    system.AddLoad(items.LoadForceVector(markerNumber=end, loadVector=[*map(float, force), 0.0]))
    system.AddLoad(items.LoadTorqueVector(markerNumber=end, loadVector=[0.0, 0.0, float(moment)]))
    system.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.verboseMode = 0
    settings.staticSolver.numberOfLoadSteps = STEPS
    settings.staticSolver.newton.relativeTolerance = 1e-7
    settings.staticSolver.newton.absoluteTolerance = 1e-6
    settings.staticSolver.newton.maxIterations = 100
    system.SolveStatic(settings)
    return np.array(system.GetNodeOutput(nodes[-1], exu.OutputVariableType.Position)[:2])


def ours(folder, segments, load):
    """The same bar, bending about y in the x-z plane: the tip's (x, z)."""
    area = SHEAR / SECTION["G"]
    elastic = bar(folder, segments, area=1e-4, shear_area_y=area, shear_area_z=area)
    return equilibrium(elastic, load).pose[[0, 2], 3]


def test_large_deflection_with_shear(tmp_path):
    force = np.array([-300.0, 1000.0])
    peer = extrapolated(tip(64, force), tip(128, force))
    load = DeadForce([force[0], 0.0, force[1]])
    errors = [relative_error(ours(tmp_path, n, load), peer) for n in (4, 8, 32)]
    assert errors[0] <= 3e-4
    assert errors[1] <= 3e-5
    assert errors[2] <= MESH


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_short_column_near_its_critical_load(tmp_path, share):
    """Haringx's load of a cantilever, P (1 + P / GA) = pi^2 EI / 4, with shear that matters."""
    shear = 2e3
    euler = np.pi**2 * EI / 4
    critical = 0.5 * shear * (np.sqrt(1 + 4 * euler / shear) - 1)
    force = np.array([-share * critical, 0.1])
    peer = extrapolated(tip(64, force, shear=shear), tip(128, force, shear=shear))
    area = shear / SECTION["G"]
    elastic = bar(tmp_path, 1, area=1e-4, shear_area_y=area, shear_area_z=area)
    state = equilibrium(elastic, DeadForce([force[0], 0.0, force[1]]))
    # The finite mesh's error times the amplification 1 / (1 - share).
    assert state.displacement[5] == pytest.approx(peer[1], rel=2e-4)


def test_moment_that_turns_the_end_by_a_right_angle(tmp_path):
    moment = np.pi / 2 * EI
    peer = extrapolated(tip(64, moment=moment), tip(128, moment=moment))
    load = FollowerWrench([0.0, -moment, 0.0, 0.0, 0.0, 0.0])
    assert relative_error(ours(tmp_path, 8, load), peer) <= MESH
