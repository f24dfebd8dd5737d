"""States of the reduction, singular matrices in a stack, and threads of BLAS."""

from __future__ import annotations

import numpy as np
import pytest
from tests.doors import numerics
from tests.inner import compute, reduction, threads

import cartstiff


def test_a_redundant_arm_that_moves_by_itself_is_named():
    """Rest positions that nothing balances; a self-motion that the load makes unstable."""
    arm = cartstiff.load("panda")
    unbalanced = compute.analyse(arm.with_springs(rest=arm.q + 0.1))
    assert unbalanced.reduction.states[-1].code == "unbalanced"
    codes = [
        [state.code for state in compute.analyse(arm, wrench=load).reduction.states]
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


def _threads():
    return [library.get_num_threads() for library in threads._blas()]


def test_one_thread_of_blas_in_the_reduction_of_many_coordinates(monkeypatch):
    """Those of the process are as before once the last has come out, in whatever order."""
    import scipy.linalg  # noqa: F401 - with the BLAS that it brings

    before, seen = _threads(), list[int]()
    inner = reduction._reduced

    def watched(*given):
        seen.extend(_threads())
        return inner(*given)

    monkeypatch.setattr(reduction, "_reduced", watched)
    try:
        for library in threads._blas():
            library.set_num_threads(2)
        usual = _threads()
        compute.analyse(cartstiff.load("6-ups"))
        assert set(seen) == {1}
        assert _threads() == usual
        first, second, few = (numerics.one_thread(rows) for rows in (45, 45, 6))
        with few:
            assert _threads() == usual
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert set(_threads()) == {1}
        second.__exit__(None, None, None)
        assert _threads() == usual
        # Many small matrices in a row, whatever their size.
        with numerics.one_thread(), numerics.one_thread(6), numerics.one_thread():
            assert set(_threads()) == {1}
        assert _threads() == usual
    finally:
        for library, count in zip(threads._blas(), before, strict=True):
            library.set_num_threads(count)
