"""States of the reduction, singular matrices in a stack, and threads of BLAS."""

import numpy as np
import pytest
from tests.doors import numerics

import cartstiff


def test_a_redundant_arm_that_moves_by_itself_is_named():
    """Rest positions that nothing balances; a self-motion that the load makes unstable."""
    arm = cartstiff.load("panda")
    unbalanced = cartstiff.analyse(arm.with_springs(rest=arm.q + 0.1))
    assert unbalanced.reduction.states[-1].code == "unbalanced"
    codes = [
        [state.code for state in cartstiff.analyse(arm, wrench=load).reduction.states]
        for load in (1e6 * np.concatenate([np.eye(6), -np.eye(6)]))
    ]
    assert ["buckled"] in codes


def test_matrices_of_a_stack_that_are_singular_have_no_inverse():
    rng = np.random.default_rng(1)
    stack = rng.normal(size=(3, 6, 6))
    stack[1, 2] = 0.0
    found, errors = numerics.invert_each(stack)
    assert np.isnan(found[1]).all()
    assert np.isinf(errors).tolist() == [False, True, False]
    assert found[[0, 2]] @ stack[[0, 2]] == pytest.approx(np.array([np.eye(6)] * 2), abs=1e-12)
    assert numerics.invert(stack[1]) is None
