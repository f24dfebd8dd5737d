"""Joints that do not give: sums over the others, limits of stiff springs, and moments by hand."""

import numpy as np
import pytest
from tests.support import (
    absolute_error,
    refused,
    relative_error,
    robot_file,
)
from tests.support.commands import answer, run

import cartstiff
from cartstiff import DeadForce, analyse_many, equilibrium

K = np.array([3e4, 3e4, 2e4, 5e3, 5e3, 4e3])
FORCE = np.array([20.0, 30.0, -100.0])


def ur5():
    robot_file("ur_description/urdf/ur5_robot.urdf")
    return cartstiff.load("ur5").with_springs(K)


def compliance(elastic, stiffness, q):
    """Sum of J_j J_j^T / k_j over the joints that give."""
    J = elastic.mechanism.at(q).motion.jacobian
    return sum(np.outer(J[:, j], J[:, j]) / k for j, k in enumerate(stiffness) if np.isfinite(k))


@pytest.mark.parametrize("rigid", [[0], [2], [1, 4]])
def test_compliance_is_the_sum_over_the_others(rigid):
    stiffness = K.copy()
    stiffness[rigid] = np.inf
    elastic = ur5().with_springs(stiffness)
    result = cartstiff.analyse(elastic)
    assert relative_error(result.compliances["B"], compliance(elastic, stiffness, result.q)) < 1e-13
    assert result.reduction.rank == 6 - len(rigid)
    assert "fewer-than-six-freedoms" in {n.code for n in result.notes}


def test_a_redundant_arm_with_one_rigid_joint_has_a_stiffness():
    # With the elbow rigid the others could not change the reach: the third joint can be spared.
    stiffness = [1e4, 2e4, np.inf, 1e4, 5e3, 4e3, 3e3]
    elastic = cartstiff.load("panda").with_springs(stiffness)
    result = cartstiff.analyse(elastic)
    expected = compliance(elastic, stiffness, result.q)
    assert relative_error(np.linalg.inv(result.matrices["B"]), expected) < 1e-9


def test_under_load_it_is_the_limit_of_stiff_springs():
    load = [1.0, -2.0, 3.0, 20.0, -30.0, 50.0]

    def at(k):
        stiffness = K.copy()
        stiffness[1] = k
        return cartstiff.analyse(ur5().with_springs(stiffness), wrench=load).compliances["A"]

    # What the joint gives goes with 1 / k.
    limit = (10.0 * at(1e9) - at(1e8)) / 9.0
    assert relative_error(at(np.inf), limit) < 1e-10


def test_a_closed_chain_with_a_rigid_motor():
    elastic = cartstiff.load("3-rrr")

    def at(k):
        return cartstiff.analyse(elastic.with_springs({"leg2/motor": k})).matrices["B"]

    limit = (10.0 * at(1e9) - at(1e8)) / 9.0
    found = at(np.inf)
    assert relative_error(found, limit) < 1e-9
    assert found[2, 2] == pytest.approx(6789.34, rel=1e-5)


@pytest.mark.parametrize("rigid", [0, 1, 2])
def test_equilibrium_and_the_torque_that_holds(rigid):
    stiffness = K.copy()
    stiffness[rigid] = np.inf
    state = equilibrium(ur5().with_springs(stiffness), DeadForce(FORCE))
    assert state.q[rigid] == pytest.approx(state.start.q[rigid], abs=1e-15)
    stiff = []
    for stiffness[rigid] in (3e11, 3e12):
        stiff.append(equilibrium(ur5().with_springs(stiffness), DeadForce(FORCE)).q)
    limit = (10.0 * stiff[1] - stiff[0]) / 9.0  # what it gives falls with the inverse
    assert absolute_error(state.q, limit) < 1e-11
    # The force's moment about the joint's axis, from the pose alone.
    J, R = state.posture.motion.jacobian, state.pose[:3, :3]
    name = state.elastic.names[rigid]
    torque = -float(J[3:, rigid] @ R.T @ FORCE)
    assert state.reactions.rigid == {name: pytest.approx(torque, rel=1e-9, abs=1e-11)}
    assert state.stable


def test_a_closed_chain_at_rest_with_a_rigid_motor():
    elastic = cartstiff.load("3-rrr")
    load = DeadForce([0.3, -0.2, 0.0])

    def at(k):
        return equilibrium(elastic.with_springs({"leg2/motor": k}), load)

    def moved(state):
        return state.pose[:3, 3] - state.start.pose[:3, 3]

    motor, state = elastic.names.index("leg2/motor"), at(np.inf)
    stiff = [at(k) for k in (1e7, 1e8)]
    limit = (10.0 * moved(stiff[1]) - moved(stiff[0])) / 9.0
    assert relative_error(moved(state), limit) < 1e-7
    # The torque is that of the stiff springs; each closure has its own reactions beside it.
    torques = [k * (s.start.q - s.q)[motor] for k, s in zip((1e7, 1e8), stiff, strict=True)]
    torque = (10.0 * torques[1] - torques[0]) / 9.0
    assert state.reactions.rigid == {"leg2/motor": pytest.approx(torque, rel=1e-6)}
    assert state.reactions.closures.shape == stiff[1].posture.residual.shape
    closures = (10.0 * stiff[1].reactions.closures - stiff[0].reactions.closures) / 9.0
    assert state.reactions.closures == pytest.approx(closures, rel=1e-6, abs=1e-7)


def test_many_postures_as_one_by_one():
    stiffness = K.copy()
    stiffness[2] = np.inf
    elastic = ur5().with_springs(stiffness)
    q = elastic.q + np.random.default_rng(0).normal(size=(3, 6)) * 0.1
    many = analyse_many(elastic, q, outputs=("compliance_B",))
    for row, C in zip(q, many["compliance_B"], strict=True):
        assert relative_error(C, compliance(elastic, stiffness, row)) < 1e-12


def test_rigid_in_text_file_and_python(tmp_path):
    robot_file("ur_description/urdf/ur5_robot.urdf")
    names = cartstiff.load("ur5").names
    expected = None
    for word in ("rigid", "inf", ".inf"):
        told = answer(f"analyse ur5 --analysis none --stiffness elbow_joint={word}")
        data = told["compliance"]["B"]
        expected = data if expected is None else expected
        assert data == expected
        path = tmp_path / "arm.yaml"
        springs = "".join(
            f"  {n}: {{stiffness: {word if n == 'elbow_joint' else 1.0e4}}}\n" for n in names
        )
        path.write_text(f"kind: serial\nmodel: ur5\nframe: tool0\nsprings:\n{springs}")
        if word != "inf":  # a plain text in YAML
            arm = cartstiff.load(path)
            k = [np.inf if n == "elbow_joint" else 1e4 for n in names]
            C = cartstiff.analyse(arm).compliances["B"]
            assert relative_error(C, compliance(arm, k, arm.q)) < 1e-13


def test_a_rigid_joint_given_a_stiffness_again():
    elastic = ur5().with_springs({"elbow_joint": np.inf}).with_springs({"elbow_joint": 2e4})
    assert not elastic.mechanism.rigid
    got, expected = cartstiff.analyse(elastic), cartstiff.analyse(ur5())
    assert relative_error(got.matrices["B"], expected.matrices["B"]) < 1e-14


def test_what_cannot_be_rigid_is_refused():
    rigid = ur5().with_springs({"elbow_joint": np.inf})
    refused(
        "'elbow_joint' is rigid and has no rest position",
        rigid.with_springs,
        rest={"elbow_joint": 1.0},
    )
    run("analyse hexapod --stiffness leg1=rigid", code=2)
    refused("finite", cartstiff.load("hexapod").with_springs, {"leg1": np.inf})
