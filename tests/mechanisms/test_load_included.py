"""With the load's own potential included, nothing is left to be held: one matrix for all."""

from dataclasses import replace

import numpy as np
import pytest
from tests.mechanisms.oracle import GRAVITY, displaced, natural_error
from tests.support import log_reference, relative_error

from cartstiff import PoseFunction, analyse, load

# Required; rounding of forces that cancel is all there is.
SAME = 1e-10
# The load that is left against the one that was there.
LEFT = 1e-11

WRENCH = np.array([4.0, -3.0, 5.0, 30.0, -20.0, 25.0])


def _with_load(result):
    """The same mechanism and posture, with the energy -W . log of the way from the pose."""
    back, W = np.linalg.inv(result.pose), result.wrench
    load_energy = PoseFunction(
        energy=lambda T: -float(W @ log_reference(back @ T)),
        wrench=lambda T: -W,
        stiffness=lambda T: np.zeros((6, 6)),
    )
    return analyse(result.elastic.with_potential(load_energy), result.q)


def _loaded(name):
    elastic = load(name)
    if name in ("3-rrr", "delta", "grasp"):
        return analyse(*displaced(elastic, [0.02, -0.01, 0.03, 0.002, 0.003, -0.002], 0.01, seed=5))
    if name == "cable-robot":
        elastic = analyse(elastic).elastic
        return analyse(elastic, elastic.q + 1e-3 * np.array([1.0, -0.6, 0.5, 1.5, -2.0, 3.0]))
    if elastic.mechanism.kind != "stewart-gough":
        elastic = replace(elastic, gravity=GRAVITY)
    return analyse(elastic, wrench=WRENCH)


NAMES = [
    "3-rrr",
    "6-ups",
    "cable-robot",
    "cubic",
    "delta",
    "grasp",
    "hexapod",
    "panda",
    "stewart-gough",
    "ur10",
    "ur5",
    "xarm7",
]


@pytest.mark.parametrize("name", NAMES)
def test_all_connections_agree(name):
    before = _loaded(name)
    assert np.abs(before.wrench).max() > 1e-2
    after = _with_load(before)
    inside = np.abs(after.evaluation.gradient).max() + np.abs(before.wrench).max()
    inside += np.abs(after.closure_forces).max(initial=0.0)
    assert np.abs(after.wrench).max() <= LEFT * inside
    length = before.posture.length
    assert (after.matrices["F"] is None) == (before.matrices["F"] is None)
    # The energy linear in exponential coordinates bends like K^B: nothing is added to it.
    for name, K in after.matrices.items():
        if K is not None:
            assert natural_error(K, before.matrices["B"], length) <= SAME, name


def test_flat_matrix_differs_before():
    """K^F and K^B of a loaded platform differ; with the load's energy they do not."""
    before = _loaded("stewart-gough")
    F, B = before.matrices["F"], before.matrices["B"]
    assert relative_error(F, B) > 1e-2


def test_five_bar():
    """Two motions: the stiffness on them does not change, the load does."""
    before = analyse(replace(load("five-bar"), gravity=GRAVITY), wrench=WRENCH)
    after = _with_load(before)
    # The part of the load that the structure carries is cancelled as well.
    assert np.abs(after.wrench).max() <= LEFT * np.abs(before.wrench).max()
    a, b = (r.reduction.reachable @ r.reduction.reachable_stiffness for r in (before, after))
    assert relative_error(b @ after.reduction.reachable.T, a @ before.reduction.reachable.T) <= SAME
