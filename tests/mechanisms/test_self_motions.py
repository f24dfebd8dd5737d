"""Motions that leave the end-effector where it is: idle, unstable, or pushed by the springs."""

import numpy as np
import pytest
from scipy.linalg import null_space
from tests.mechanisms.machines import codes, joint, note, six_chains, write_file, write_urdf
from tests.mechanisms.oracle import natural_error
from tests.support import body_jacobian, frame_pose, loaded_arm, refused, relative_error, slope

from cartstiff import UndefinedError, analyse, load

SAME = 1e-9
ROUNDING = 1e-10
# Difference of a Jacobian along the self-motion, step 0.01.
DIFFERENCES = 1e-8


def test_legs_that_spin(tmp_path):
    """Six spins cost nothing and move nothing; the platform is the one of line springs."""
    wrench = np.array([300.0, -250.0, 180.0, 2000.0, -3000.0, -5000.0])
    result = analyse(six_chains(tmp_path, spins=True), wrench=wrench)
    found = note(result, "idle-self-motion")
    directions = np.array(found.values["directions"])
    assert directions.shape == (6, result.q.size)
    # The load of the slides is what a spin could feel at most; it does not.
    assert found.values["coupling"] <= 1e-7 * np.abs(result.evaluation.hessian).max()
    assert np.abs(result.posture.motion.jacobian @ directions.T).max() <= ROUNDING
    assert np.abs(result.posture.closure.jacobian @ directions.T).max() <= ROUNDING
    names = result.elastic.names
    spins = directions[:, [i for i, n in enumerate(names) if n.endswith("spin")]]
    assert np.linalg.matrix_rank(spins, tol=1e-6) == 6
    lines = analyse(load("hexapod"), wrench=wrench)
    for name in "ABKF":  # K^F, too: what is idle is no motion that the slides would have to hold
        error = natural_error(result.matrices[name], lines.matrices[name], lines.posture.length)
        assert error <= SAME
    assert codes(result) == ["idle-self-motion"]
    C, expected = result.compliances["F"], lines.compliances["F"]
    assert relative_error(C, expected) <= SAME


def test_springs_against_the_spin(tmp_path):
    """Springs at rest hold the spins: nothing idle is left, the platform does not feel them."""
    result = analyse(six_chains(tmp_path, spins=True, spin={"stiffness": 3.0}))
    assert codes(result) == []
    lines = analyse(load("hexapod"))
    K = result.matrices["B"]
    assert relative_error(K, lines.matrices["B"]) <= 1e-4
    # A ball of three revolutes is not free of moments: springs of 3 N m/rad can add that much.
    added = np.linalg.eigvalsh(K - lines.matrices["B"])
    assert added.min() >= -1e-6


def test_unbalanced_spin(tmp_path):
    """A spin wound up by 0.2 rad is not in balance: its torque is reported and nothing else."""
    result = analyse(six_chains(tmp_path, spins=True, spin={"stiffness": 3.0, "rest": -0.2}))
    found = note(result, "unbalanced")
    assert result.wrench is None
    assert {*result.matrices.values(), *result.compliances.values()} == {None}
    assert found.values["largest"] > 0.01
    torque = np.array(found.values["unbalanced_torque"])
    assert found.values["largest"] == pytest.approx(np.abs(torque).max(), rel=1e-9)
    words = "no wrench at the end-effector balances"
    caught = refused(words, analyse, result.elastic, strict=True, kind=UndefinedError)
    assert caught.code == "unbalanced"
    refused("no wrench", result.tensor, "F", kind=UndefinedError)
    # What is reported is the springs' torque along the self-motion, joint by joint.
    tied = np.concatenate([result.posture.motion.jacobian, result.posture.closure.jacobian])
    scaled = tied * result.posture.coordinate_lengths
    Z = null_space(scaled, rcond=1e-10)
    g = result.evaluation.gradient * result.posture.coordinate_lengths
    expected = (Z @ (Z.T @ g)) / result.posture.coordinate_lengths
    assert relative_error(torque, expected) <= SAME


def _buckling(seed):
    """An arm, a load per unit, and the factor at which its self-motion stops being stable."""
    arm = loaded_arm("RRRRRRR", seed)
    z = np.linalg.svd(body_jacobian(arm.model, arm.q, "tip"))[2][-1]
    W = np.random.default_rng(seed).normal(size=6)
    # z . d(J^T W)/dz: what the load takes off the springs' z . k z.
    bend = z @ slope(lambda t: body_jacobian(arm.model, arm.q + t * z, "tip").T @ W, 0.01)
    W = W * np.sign(bend)
    critical = (z @ (arm.elastic.springs.stiffness * z)) / abs(bend)
    return arm, z, W, critical


@pytest.mark.parametrize("seed", [21, 22])
def test_buckled_arm(seed):
    """Under enough load the springs hold the end-effector but not the elbow."""
    arm, z, W, critical = _buckling(seed)
    stable = z @ (arm.elastic.springs.stiffness * z)
    for factor in (0.5, 0.99, 1.01, 2.0):
        result = analyse(arm.elastic, wrench=factor * critical * W)
        if factor < 1:
            assert "buckled" not in codes(result)
            assert result.matrices["B"] is not None
            continue
        found = note(result, "buckled")
        assert result.matrices["B"] is None
        refused("self-motion is unstable", result.tensor, "B", kind=UndefinedError)
        (eigenvalue,) = found.values["self_motion_stiffness"]
        assert eigenvalue == pytest.approx(stable * (1 - factor), rel=DIFFERENCES)
        direction = np.array(found.values["direction"])
        assert abs(direction @ z) == pytest.approx(1.0, abs=ROUNDING)


def test_at_the_point_of_buckling():
    """Exactly there the self-motion costs nothing, yet the body's motions feel it: no minimum."""
    arm, z, W, critical = _buckling(21)
    # The factor is known to the accuracy of differences: look on both sides of it.
    below = analyse(arm.elastic, wrench=(1 - 1e-6) * critical * W)
    K = np.abs(below.matrices["B"]).max()
    unloaded = np.abs(analyse(arm.elastic, wrench=0.5 * critical * W).matrices["B"]).max()
    assert 100 * unloaded < K
    above = analyse(arm.elastic, wrench=(1 + 1e-6) * critical * W)
    assert "buckled" in codes(above)
    assert frame_pose(arm.model, arm.q, "tip") == pytest.approx(below.pose)
    assert z.size == 7


def test_axes_that_meet_in_the_body(tmp_path):
    """A wrist seen from its centre: forces along what it cannot do stay zero, not rounding's."""
    wrist = write_urdf(
        tmp_path,
        joint("a", "base", "one", at=(0.3, 0.1, 0.7)),
        joint("b", "one", "two", axis=(0, 1, 0)),
        joint("c", "two", "tip"),
    )
    path = write_file(
        tmp_path,
        kind="serial",
        model=wrist.name,
        frame="tip",
        springs={n: {"stiffness": 2.0, "rest": 0.0} for n in "abc"},
    )
    for q in ([0.3, 0.4, 0.5], [0.1, 1.0, -0.7], [1.0, -0.5, 0.3]):
        result = analyse(load(path), q)
        assert result.posture.length == 1.0
        assert np.abs(result.wrench[3:]).max() <= ROUNDING
        assert result.reduction.rank == 3
        assert np.abs(
            result.posture.motion.jacobian.T @ result.wrench - 2.0 * np.array(q)
        ).max() <= (ROUNDING)
