"""Equilibria of parallel mechanisms, springs over nine decades: found, and the linear ones."""

import numpy as np
import pytest
from tests.support import log_reference

import cartstiff
from cartstiff import DeadForce, equilibrium


@pytest.mark.parametrize("seed", range(8))
def test_small_loads_move_a_hexapod_linearly(seed):
    """The compliance knows no line search; a stiff leg must not stop what the soft ones do."""
    rng = np.random.default_rng(seed)
    elastic = cartstiff.load("hexapod")
    given = elastic.springs.stiffness
    k = np.where(given > 0.0, 10.0 ** rng.uniform(-1, 8, given.size), 0.0)
    names = [name for name, x in zip(elastic.spring_names, k, strict=True) if x > 0.0]
    elastic = elastic.with_springs(dict(zip(names, k[k > 0.0], strict=True)))
    result = cartstiff.analyse(elastic)
    F = 1e-3 * k[k > 0.0].min() * rng.normal(size=3)
    state = equilibrium(elastic, DeadForce(F), limits=False)
    assert state.stable
    moved = log_reference(np.linalg.inv(result.pose) @ state.pose)
    expected = result.compliances["B"] @ np.append(np.zeros(3), result.pose[:3, :3].T @ F)
    assert np.abs(moved - expected).max() <= 0.05 * np.abs(expected).max()
