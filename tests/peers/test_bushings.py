"""Six-number springs of other programs, turned and loaded: their wrenches, and which have energies.

Where a law has an energy, cartstiff derives wrench and K^A from the energy alone; the programs'
K^A are differences of the wrenches that they compute.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.support import relative_error

from cartstiff import analyse, load
from cartstiff.geometry import se3

# Differences of eighth order, of energies and of wrenches; and two ways through the same angles.
DIFFERENCES, ROUNDING = 1e-8, 1e-12
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def bushings():
    path = ROOT / "benchmarks" / "bushings.py"
    spec = importlib.util.spec_from_file_location("bushings", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["bushings"] = module
    spec.loader.exec_module(module)
    return module


def _law(make):
    try:
        return make()
    except (ImportError, RuntimeError) as missing:
        pytest.skip(str(missing))


def _scaled(bushings, K):
    size = np.sqrt(np.concatenate([bushings.ROTATIONAL, bushings.TRANSLATIONAL]))
    return K / np.outer(size, size)


@pytest.mark.parametrize("which", ["three hinges", "a ball"])
def test_mujoco_has_the_energy_of_its_coordinates(bushings, which):
    (element,) = (e for e in bushings.ELEMENTS if which in e.name)
    law = _law(element.law)
    W, K = bushings.tangent(law)
    expected_W, expected_K = bushings.derived(element.energy)
    assert relative_error(W, expected_W) <= DIFFERENCES
    assert relative_error(_scaled(bushings, K), _scaled(bushings, expected_K)) <= DIFFERENCES
    assert bushings.without_energy(W, K) <= DIFFERENCES
    assert abs(bushings.work_of_a_loop(law)) <= 1e-6


def test_a_link_that_gives_is_three_slides_and_three_hinges(bushings, tmp_path):
    bolts = joint("bolts", "base", "body", kind="revolute")
    write_urdf(tmp_path, bolts, joint("end", "body", "tool", kind="fixed"), name="bushing")
    k = np.concatenate([bushings.ROTATIONAL, bushings.TRANSLATIONAL])
    elastic = load(
        write_file(
            tmp_path,
            "bushing",
            kind="closed-chain",
            model="bushing.urdf",
            frame="tool",
            locked={"bolts": 0},
            flexible={"body": {"stiffness": np.diag(k).tolist()}},
        )
    )
    turn = bushings.hinges(Rotation.from_matrix(bushings.POSE[:3, :3]))
    result = analyse(elastic, np.concatenate([bushings.POSE[:3, 3], turn]))
    assert np.abs(result.pose - bushings.POSE).max() <= ROUNDING
    law = _law(lambda: bushings.mujoco(ball=False))
    W, K = bushings.tangent(law)
    assert relative_error(result.wrench, W) <= ROUNDING
    assert relative_error(_scaled(bushings, result.A.matrix), _scaled(bushings, K)) <= DIFFERENCES


def test_drake_has_an_energy_for_turns_alone_and_for_equal_stiffnesses(bushings, monkeypatch):
    pytest.importorskip("pydrake")
    W, K = bushings.tangent(bushings.drake())
    assert bushings.without_energy(W, K) > 1e-3
    monkeypatch.setattr(bushings, "TRANSLATIONAL", np.full(3, 3e5))
    W, K = bushings.tangent(bushings.drake())
    expected_W, expected_K = bushings.derived(bushings.energy(bushings.roll_pitch_yaw))
    assert relative_error(W, expected_W) <= DIFFERENCES
    assert relative_error(_scaled(bushings, K), _scaled(bushings, expected_K)) <= DIFFERENCES


def test_exudyn_takes_the_angles_as_a_vector_of_moments(bushings):
    """Angles of three hinges times their stiffnesses, along the room's axes: no energy."""
    law = _law(bushings.exudyn)
    T = bushings.POSE
    moment = bushings.ROTATIONAL * bushings.hinges(Rotation.from_matrix(T[:3, :3]))
    force = bushings.TRANSLATIONAL * T[:3, 3]
    expected = np.concatenate([T[:3, :3].T @ moment, T[:3, :3].T @ force])
    W, K = bushings.tangent(law)
    assert relative_error(W, expected) <= ROUNDING
    assert bushings.without_energy(W, K) > 0.1
    assert bushings.work_of_a_loop(law) < -0.1


def test_exudyn_at_the_middle_is_close_to_an_energy(bushings):
    """Its intrinsic form: stiffness times the screw, along the axes of the frame half-way."""
    law = _law(lambda: bushings.exudyn(intrinsic=True))
    T = bushings.POSE
    screw = se3.log(T)
    to_body = T[:3, :3].T @ se3.exp(screw / 2)[:3, :3]
    force = bushings.TRANSLATIONAL * screw[3:]
    moment = bushings.ROTATIONAL * screw[:3] - 0.5 * np.cross(screw[3:], force)
    W, K = bushings.tangent(law)
    assert relative_error(W, np.concatenate([to_body @ moment, to_body @ force])) <= ROUNDING
    assert 1e-3 < bushings.without_energy(W, K) < 0.05


def test_opensees_is_linear_however_far_its_node_turns(bushings):
    law = _law(bushings.opensees)
    turn = bushings.rotation_vector(Rotation.from_matrix(bushings.POSE[:3, :3]))
    R = bushings.POSE[:3, :3]
    W, K = bushings.tangent(law)
    assert relative_error(W[:3], R.T @ (bushings.ROTATIONAL * turn)) <= ROUNDING
    assert bushings.without_energy(W, K) > 0.1
    assert abs(bushings.work_of_a_loop(law)) > 0.01


def test_all_agree_at_rest(bushings):
    k = np.concatenate([bushings.ROTATIONAL, bushings.TRANSLATIONAL])
    ran = 0
    for element in bushings.ELEMENTS:
        if element.law is None or "ball" in element.name:
            continue
        try:
            law = element.law()
        except (ImportError, RuntimeError):
            continue
        W, K = bushings.tangent(law, se3.pose())
        assert np.abs(_scaled(bushings, K - np.diag(k))).max() <= DIFFERENCES
        assert np.abs(W).max() <= ROUNDING
        ran += 1
    if not ran:
        pytest.skip("no other program is installed")
