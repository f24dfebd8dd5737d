"""Flexible members under load against OpenSees: corotational frames of many Euler-Bernoulli beams.

OpenSees' elements have no bowing of their own, so that its error falls with the square of the
element's length: two meshes are extrapolated.
"""

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.mechanisms.bars import EI, SECTION, URDF, bar
from tests.mechanisms.machines import write_file
from tests.peers.opensees import extrapolated, frame_bar, solved, space_frame
from tests.support import relative_error

from cartstiff import DeadForce, equilibrium, load, load_curve

# What is left of OpenSees' mesh after extrapolation.
MESH = 2e-5
PLAIN = {**SECTION, "area": 1e-4}
EULER = np.pi**2 * EI / 4


def cantilever(count, force, steps=10):
    """The bar in `count` elements, loaded at its tip; returns the interpreter."""
    ops = space_frame()
    for i in range(count + 1):
        ops.node(i + 1, i / count, 0.0, 0.0)
    ops.fix(1, 1, 1, 1, 1, 1, 1)
    frame_bar(ops, list(range(1, count + 2)), PLAIN, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(count + 1, *(float(f) for f in force), 0.0, 0.0, 0.0)
    solved(ops, steps)
    return ops


def tip(count, force):
    return np.array(cantilever(count, force).nodeDisp(count + 1)[:3])


@pytest.mark.parametrize("segments", [1, 4])
def test_deflection_at_nine_tenths_of_the_euler_load(tmp_path, segments):
    force = np.array([-0.9 * EULER, 0.0, 0.1])
    peer = extrapolated(tip(64, force), tip(128, force))
    state = equilibrium(bar(tmp_path, segments, area=1e-4), DeadForce(force))
    assert state.displacement[5] == pytest.approx(peer[2], rel=2e-4)  # the mesh's, times 1 / 0.1


def test_large_deflection_in_space(tmp_path):
    force = np.array([-300.0, 200.0, 500.0])
    peer = extrapolated(tip(32, force), tip(64, force))
    ours = [
        equilibrium(bar(tmp_path, n, area=1e-4), DeadForce(force)).displacement[3:] for n in (8, 16)
    ]
    assert relative_error(extrapolated(*ours), peer) <= MESH
    assert relative_error(ours[0], peer) <= 1e-3


def test_compliance_under_load(tmp_path):
    """Displacement per dead force at a bent, compressed state, by differences of OpenSees."""
    force, step = np.array([-300.0, 50.0, 80.0]), 2.0
    peer = np.empty((3, 3))
    for i, axis in enumerate(np.eye(3)):
        ends = [
            extrapolated(tip(32, f), tip(64, f)) for f in (force + step * axis, force - step * axis)
        ]
        peer[:, i] = (ends[0] - ends[1]) / (2 * step)
    state = equilibrium(bar(tmp_path, 8, area=1e-4), DeadForce(force))
    R = state.pose[:3, :3]
    ours = R @ state.stiffness.compliances["K"][3:, 3:] @ R.T
    assert relative_error(ours, peer) <= 1e-4  # central differences of second order


def test_critical_load(tmp_path):
    """The load at which the smallest eigenvalue of OpenSees' tangent is zero."""

    def smallest(load, count):
        ops = cantilever(count, (-load, 0.0, 0.0), steps=1)
        size = ops.systemSize()
        K = np.array(ops.printA("-ret")).reshape(size, size)
        return np.linalg.eigvalsh(0.5 * (K + K.T))[0]

    found = [
        brentq(smallest, 0.9 * EULER, 1.1 * EULER, args=(count,), xtol=1e-6) for count in (16, 32)
    ]
    curve = load_curve(bar(tmp_path, 4, area=1e-4), DeadForce([-EULER, 0, 0]), to=1.5)
    assert curve.critical[0].factor * EULER == pytest.approx(extrapolated(*found), rel=MESH)


#: Half the distance of the columns.
HALF = 0.4
FORCE = np.array([40.0, 15.0, -0.7 * np.pi**2 * EI])


def _portal(count):
    """Two columns clamped to the ground and to a stiff beam; displacement of the beam's middle."""
    ops = space_frame()
    ops.geomTransf("Corotational", 2, -1.0, 0.0, 0.0)
    for column, x in enumerate((-HALF, HALF)):
        for i in range(count + 1):
            ops.node(100 * (column + 1) + i, x, 0.0, i / count)
        ops.fix(100 * (column + 1), 1, 1, 1, 1, 1, 1)
        nodes = [100 * (column + 1) + i for i in range(count + 1)]
        frame_bar(ops, nodes, PLAIN, nodes[0], 2)
    ops.node(1, 0.0, 0.0, 1.0)
    rigid = {name: 1e6 * value if name in "EG" else value for name, value in PLAIN.items()}
    frame_bar(ops, [100 + count, 1, 200 + count], rigid, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(1, *FORCE.tolist(), 0.0, 0.0, 0.0)
    solved(ops)
    return np.array(ops.nodeDisp(1)[:3])


@pytest.mark.parametrize(("segments", "tolerance"), [(1, 1e-3), (4, 5e-5)])
def test_portal_of_clamped_columns(tmp_path, segments, tolerance):
    """A body on two clamped columns that sways under its load: P-delta in a closed chain."""
    (tmp_path / "bar.urdf").write_text(URDF, encoding="utf-8")
    upright = [0.0, -np.pi / 2, 0.0]
    beam = {**PLAIN, "length": 1.0, "segments": segments}
    legs = [
        {
            "model": "bar.urdf",
            "frame": "tip",
            "locked": {"foot": 0.0, "end": 0.0},
            "base": {"xyz": [x, 0.0, -1.0], "rpy": upright},
            "grip": {"xyz": [x, 0.0, 0.0], "rpy": upright},
            "flexible": {"bar": {"beam": beam}},
        }
        for x in (-HALF, HALF)
    ]
    portal = load(write_file(tmp_path, "portal", kind="parallel", legs=legs))
    state = equilibrium(portal, DeadForce(FORCE))
    peer = extrapolated(_portal(20), _portal(40))
    assert state.stable
    assert relative_error(state.displacement[3:], peer) <= tolerance
