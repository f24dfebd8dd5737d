"""What a page reads from a pair of matrices together is what each function says on its own."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.doors import (
    ROTATION,
    TRANSLATION,
    MatrixPair,
    characteristic_length,
    compliance_ellipsoid,
    length_of_pair,
    principal_pairs,
)
from tests.support import refused

from cartstiff import UndefinedError
from cartstiff.analysis import stiffness_ellipsoid


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    spread=st.floats(0.0, 5.0),
    signs=st.lists(st.sampled_from([1.0, 1.0, 1.0, -1.0]), min_size=6, max_size=6),
)
def test_blocks_and_length_are_those_of_each_function(seed, spread, signs):
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    values = np.array(signs) * 10.0 ** rng.uniform(-spread, spread, 6)
    K = (Q * values) @ Q.T
    C = (Q / values) @ Q.T
    K, C = 0.5 * (K + K.T), 0.5 * (C + C.T)
    pair = MatrixPair(K, C)
    for freedom in ("translation", "rotation"):
        ours = pair.ellipsoid(freedom, "held")
        other = stiffness_ellipsoid(K, freedom, "held", None, C)
        np.testing.assert_allclose(ours.eigenvalues, other.eigenvalues, rtol=1e-9)
        assert ours.definiteness == other.definiteness
        np.testing.assert_allclose(np.linalg.det(ours.axes), 1.0, atol=1e-12)
        block = slice(3, 6) if freedom == "translation" else slice(0, 3)
        size = np.abs(K[block, block]).max()
        np.testing.assert_allclose(ours.matrix, K[block, block], atol=1e-9 * size)
        free = np.linalg.eigvalsh(np.linalg.inv(C[block, block]))
        ours = pair.ellipsoid(freedom, "free")
        other = stiffness_ellipsoid(K, freedom, "free", None, C)
        np.testing.assert_allclose(ours.eigenvalues, other.eigenvalues, rtol=1e-9)
        np.testing.assert_allclose(ours.eigenvalues, free, atol=1e-9 * np.abs(free).max())
        assert ours.definiteness == other.definiteness
        for others in ("held", "free"):
            ours = pair.ellipsoid(freedom, others, "compliance")
            other = compliance_ellipsoid(C, freedom, others, None, K)
            np.testing.assert_allclose(ours.eigenvalues, other.eigenvalues, rtol=1e-9)
            np.testing.assert_allclose(
                ours.matrix, other.matrix, atol=1e-9 * np.abs(other.matrix).max()
            )
            assert ours.definiteness == other.definiteness
    length, own = characteristic_length(K, C), length_of_pair(pair)
    assert (own.origin, own.reason) == (length.origin, length.reason)
    assert own.value == pytest.approx(length.value, rel=1e-9)
    alone = characteristic_length(K)  # by Cholesky's decomposition
    if spread < 2.0:
        assert own.origin == alone.origin
        assert own.value == pytest.approx(alone.value, rel=1e-9)


def test_a_compliance_is_the_inverse_of_a_stiffness():
    K = np.diag([1.0, 2.0, 3.0, 10.0, 20.0, 30.0])
    shape = compliance_ellipsoid(np.linalg.inv(K), "translation", "held", None, K)
    own = MatrixPair(K, np.linalg.inv(K)).ellipsoid("translation", "held")
    np.testing.assert_allclose(shape.eigenvalues, 1.0 / own.eigenvalues[::-1], rtol=1e-15)
    # (det S / det K_tt)^(1/6) = (6 / 6000)^(1/6)
    length = length_of_pair(MatrixPair(K, np.linalg.inv(K)))
    assert length.value == pytest.approx(10**-0.5, rel=1e-15)


def test_values_that_neither_matrix_holds_are_refused():
    """Of 1, s, s^2 one matrix holds two: to EPSILON / s, which is 2e-5 and 2e-3."""
    for s in (1e-11, 1e-13):
        sizes = np.array([1.0, 1.0, 1.0, 1.0, s, s * s])
        asked = (np.diag(sizes), "translation", "held", None, np.diag(1.0 / sizes))
        if s == 1e-13:
            refused("so far apart", stiffness_ellipsoid, *asked, kind=UndefinedError)
        else:
            found = stiffness_ellipsoid(*asked).eigenvalues
            np.testing.assert_allclose(found, sizes[:2:-1], rtol=1e-14)


def test_a_stack_is_its_matrices_one_by_one():
    """Well conditioned, singular by rounding, known by its inverse alone, and unknown."""
    rng = np.random.default_rng(7)
    A = rng.normal(size=(6, 6))
    regular = A @ A.T + np.eye(6)
    flat = np.diag([1.0, 2.0, 0.0, 4.0, 5.0, 0.0])
    spread = np.diag([1e-9, 1.0, 1e7, 1e-8, 1.0, 1e8])
    nothing = np.full((6, 6), np.nan)
    stack = np.array([regular, flat, spread, nothing])
    inverses = np.array([np.linalg.inv(regular), nothing, np.linalg.inv(spread), regular])
    for keep, is_eliminated in product((ROTATION, TRANSLATION), (False, True)):
        values, axes = principal_pairs(stack, inverses, keep, is_eliminated)
        assert np.isnan(values[3]).all()
        for i in range(3):
            one = principal_pairs(stack[i : i + 1], inverses[i : i + 1], keep, is_eliminated)
            np.testing.assert_array_equal(values[i], one[0][0])
            np.testing.assert_allclose(axes[i].T @ axes[i], np.eye(3), atol=1e-14)
        own = (
            np.linalg.inv(np.linalg.inv(regular)[keep, keep])
            if is_eliminated
            else regular[keep, keep]
        )
        np.testing.assert_allclose((axes[0] * values[0]) @ axes[0].T, own, rtol=1e-10)
        np.testing.assert_allclose(values[1], np.sort(np.diag(flat)[keep]), atol=0.0)
        np.testing.assert_allclose(values[2], np.diag(spread)[keep], rtol=1e-15)
