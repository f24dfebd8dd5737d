"""Polytopes of forces of arms against pycapacity (python -m pip install pycapacity)."""

import numpy as np
import pytest

import cartstiff as cs

ARMS = {
    "ur5": [0.3, -1.2, 1.4, -0.6, 0.9, 0.2],
    "ur10": [0.4, -0.9, 1.2, -0.3, 1.1, -0.4],
    "panda": [0.1, -0.8, 0.2, -2.4, 0.3, 1.6, 0.8],
    "kinova": [0.3, 2.9, 1.3, 0.4, 0.8, 0.2],
    "xarm7": [0.2, 0.6, -0.3, 1.1, 0.4, 0.9, 0.1],
}


@pytest.mark.parametrize("name", ARMS)
def test_vertices_are_the_same(name):
    peer = pytest.importorskip("pycapacity.robot")
    elastic = cs.load(name).with_gravity()
    q = np.array(ARMS[name])
    efforts = {n: (-20.0 - 7.0 * i, 30.0 + 5.0 * i) for i, n in enumerate(elastic.names)}
    elastic = replaced(elastic, efforts)
    own = cs.capacity(elastic, q, wrench=[0, 0, 0, 0, 0, -1.0]).polytope
    result = cs.analyse(elastic, q, wrench=np.zeros(6))
    weight = {one.name: one.force for one in result.forces}
    low, high = np.array([efforts[n] for n in elastic.names]).T
    # A force on the robot takes -J^T f of the drives, beside what the weight takes.
    J = result.pose[:3, :3] @ result.jacobian[3:]
    bias = np.array([weight[n] for n in elastic.names])
    other = peer.force_polytope(-J, high, low, bias).vertices.T
    assert len(own) == len(other)
    for one, more in ((own, other), (other, own)):
        nearest = np.linalg.norm(one[:, None] - more, axis=2).min(axis=1)
        assert nearest.max() <= 1e-6 * np.abs(own).max()


def replaced(elastic, efforts):
    from dataclasses import replace

    return replace(elastic, efforts=efforts)
