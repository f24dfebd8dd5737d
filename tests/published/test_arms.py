"""Three industrial arms against matrices from 50-digit differences of their energy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from tests.doors import Chain, plain_tree
from tests.support import reference, relative_error, robot_file

from cartstiff import ElasticMechanism, JointSprings, analyse

ARMS = reference("arms.json")

# Condition numbers up to 1e3 and springs of 3e5 N m/rad stretched by 1e-4 rad cost four digits.
MATRIX = 1e-11
# Sums of a few products of numbers near one.
KINEMATIC = 1e-13
# The load follows from differences q - rest, whose last digit is 1e-16 / 1e-4 of them.
LOAD = 1e-11


def _arm(name: str) -> tuple[dict, ElasticMechanism]:
    d = ARMS[name]
    model = pin.buildModelFromUrdf(robot_file(d["urdf"]))
    keep = [model.getJointId(j) for j in d["joints"]]
    chain = Chain(plain_tree(model, keep=keep), d["tip"])
    springs = JointSprings(np.array(d["joint_stiffness"]), np.array(d["rest"]))
    return d, ElasticMechanism(name, chain, np.array(d["q"]), springs)


@pytest.mark.parametrize("name", ARMS)
def test_arm(name):
    d, elastic = _arm(name)
    assert elastic.names == tuple(d["joints"])
    result = analyse(elastic)
    assert relative_error(result.jacobian, d["J"]) <= KINEMATIC
    assert relative_error(result.pose, d["pose"]) <= KINEMATIC
    assert relative_error(result.wrench, d["wrench"]) <= LOAD
    names = "ABKF" if len(d["joints"]) == 6 else "ABK"
    for connection in names:
        error = relative_error(result.matrices[connection], d[connection])
        assert error <= MATRIX, (connection, error)


@pytest.mark.parametrize("name", ARMS)
def test_arm_with_load_given(name):
    d, elastic = _arm(name)
    result = analyse(elastic, d["q"], wrench=d["wrench"])
    for connection in "ABK":
        assert relative_error(result.matrices[connection], d[connection]) <= MATRIX
    assert relative_error(result.elastic.springs.rest, d["rest"]) <= KINEMATIC


def test_seven_joints_have_no_flat_connection():
    _, elastic = _arm("panda")
    result = analyse(elastic)
    assert result.matrices["F"] is None
    assert result.compliances["F"] is None
    assert [n.code for n in result.notes] == ["kf-undefined"]
