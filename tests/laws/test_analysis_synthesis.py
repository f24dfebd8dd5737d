"""What is synthesised gives back what was asked for: springs, joint stiffness, deflections."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartstiff.analysis.congruence import cartesian_stiffness, fit_diagonal, joint_stiffness
from cartstiff.analysis.deflection import (
    compliance_deflection,
    displacement_of_point,
    joint_shares,
)
from cartstiff.analysis.matrices import move_stiffness
from cartstiff.analysis.synthesis import Spring, parallel_stiffness, realisability, realise
from cartstiff.geometry import se3

# The promise made to users: the springs give the matrix to ten digits of each block.
REPRODUCED = 1e-10

seeds = st.integers(0, 2**32 - 1)


def stiffness(rng: np.random.Generator, rank: int = 6) -> np.ndarray:
    F = rng.standard_normal((6, rank)) * np.repeat([0.3, 1.0], 3)[:, None]
    return np.asarray(1e4 * F @ F.T)


def from_lines(rng: np.random.Generator, count: int) -> np.ndarray:
    return parallel_stiffness(
        Spring("line", k, u / np.linalg.norm(u), 0.5 * p, 0.0)
        for k, p, u in zip(
            rng.uniform(1e3, 1e4, count),
            rng.standard_normal((count, 3)),
            rng.standard_normal((count, 3)),
            strict=True,
        )
    )


@given(seeds, st.integers(1, 9))
def test_line_springs_are_realised_by_as_many_line_springs_as_the_rank(seed: int, n: int) -> None:
    K = from_lines(np.random.default_rng(seed), n)
    found = realise(K)
    assert found.judgement.by_line_springs
    assert found.residual < REPRODUCED
    assert len(found.springs) == found.judgement.rank == min(n, 6)
    assert np.allclose(found.stiffness, K, rtol=0, atol=REPRODUCED * np.abs(K).max())
    assert all(s.stiffness > 0 for s in found.springs)
    if n >= 6:
        assert {s.kind for s in found.springs} == {"line"}


@given(seeds, st.integers(1, 6))
def test_any_semidefinite_stiffness_is_realised_with_the_fewest_screw_springs(
    seed: int, rank: int
) -> None:
    K = stiffness(np.random.default_rng(seed), rank)
    found = realise(K)
    assert found.residual < REPRODUCED
    assert len(found.springs) == rank
    screws = [s for s in found.springs if s.kind == "screw"]
    assert len(screws) == found.judgement.screw_springs >= 1
    carried = sum(s.stiffness * s.pitch for s in screws)
    assert np.isclose(carried, np.trace(K[:3, 3:]), rtol=1e-8)


@pytest.mark.parametrize(("b", "screws"), [(0.0, 0), (0.15, 1), (0.25, 2), (0.4, 2), (0.9, 3)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_number_of_screw_springs_of_an_isotropic_screw_stiffness(
    b: float, screws: int, sign: float
) -> None:
    # Eigenvalues of Delta K are b + 1 and b - 1, each thrice: s springs carry s (b + 1) of 6 b.
    eye = np.eye(3)
    K = np.block([[eye, sign * b * eye], [sign * b * eye, eye]])
    found = realise(K)
    assert found.judgement.screw_springs == screws
    assert sum(s.kind == "screw" for s in found.springs) == screws
    assert found.residual < REPRODUCED


@given(seeds)
def test_realisability_does_not_depend_on_the_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = se3.exp(0.5 * rng.standard_normal(6))
    for K in (from_lines(rng, 7), stiffness(rng)):
        here, there = realisability(K), realisability(move_stiffness(K, T))
        assert here.by_line_springs == there.by_line_springs
        assert here.screw_springs == there.screw_springs
        assert np.isclose(here.trace, there.trace, atol=1e-7)


def test_a_pure_rotational_stiffness_needs_torsional_springs() -> None:
    K = np.diag([2.0, 3.0, 0.0, 0.0, 0.0, 0.0])
    found = realise(K)
    assert [s.kind for s in found.springs] == ["torsional", "torsional"]
    assert found.judgement.by_line_springs
    assert np.allclose(found.stiffness, K)


def test_no_stiffness_needs_no_springs() -> None:
    assert realise(np.zeros((6, 6))).springs == ()


def test_a_diagonal_stiffness_is_realised_by_line_springs_alone() -> None:
    K = np.diag([1.0, 2.0, 3.0, 10.0, 20.0, 30.0])
    found = realise(K)
    assert {s.kind for s in found.springs} == {"line"}
    assert found.residual < REPRODUCED


@given(seeds, st.integers(6, 8), st.booleans())
def test_joint_stiffness_gives_the_desired_stiffness(seed: int, n: int, loaded: bool) -> None:
    rng = np.random.default_rng(seed)
    K = stiffness(rng) + 2e3 * np.diag(np.repeat([0.09, 1.0], 3))
    J = rng.standard_normal((6, n))
    W = 20.0 * rng.standard_normal(6) * loaded
    found = joint_stiffness(K, J, W)
    back = cartesian_stiffness(J, found.matrix, W)
    size = np.linalg.cond(J) ** 2 * np.abs(K).max()
    assert np.allclose(back, K, rtol=0, atol=1e-12 * size)
    assert np.allclose(found.torque, J.T @ W)
    assert np.array_equal(found.matrix, found.matrix.T)
    assert found.stable
    assert np.any(found.load_term) == loaded
    assert not found.is_diagonal


@given(seeds, st.integers(6, 8), st.booleans())
def test_fit_finds_the_independent_springs_that_exist(seed: int, n: int, loaded: bool) -> None:
    rng = np.random.default_rng(seed)
    springs = rng.uniform(1e3, 1e4, n)
    J = rng.standard_normal((6, n))
    W = 20.0 * rng.standard_normal(6) * loaded
    K = cartesian_stiffness(J, springs, W)
    found = fit_diagonal(0.5 * (K + K.T), J, W)
    assert found.residual < 1e-8
    assert np.allclose(found.stiffness, springs, rtol=1e-4)
    assert found.cartesian is not None
    full = joint_stiffness(0.5 * (K + K.T), J, W)
    assert full.is_feasible
    if n == 6:
        assert full.is_diagonal
        assert full.definiteness == "positive"


@given(seeds)
def test_no_other_springs_fit_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    K, J, W = stiffness(rng), rng.standard_normal((6, 6)), 20.0 * rng.standard_normal(6)
    found = fit_diagonal(K, J, W, length=0.3)
    assert np.all(found.stiffness >= 0)
    d = np.repeat([0.3, 1.0], 3)

    def residual(springs: np.ndarray) -> float:
        error = (cartesian_stiffness(J, springs, W) - K) / np.outer(d, d)
        return float(np.linalg.norm(error) / np.linalg.norm(K / np.outer(d, d)))

    assert np.isclose(residual(found.stiffness), found.residual)
    for _ in range(5):
        step = 0.02 * rng.standard_normal(6) * (found.stiffness + 1e-2 * found.stiffness.max())
        assert residual(np.maximum(found.stiffness + step, 0.0)) >= found.residual * (1 - 1e-9)


def test_an_infeasible_wish_is_told() -> None:
    rng = np.random.default_rng(2)
    found = joint_stiffness(stiffness(rng), rng.standard_normal((6, 6)))
    assert not found.is_feasible
    assert found.diagonal_fit is not None
    assert found.diagonal_fit.residual > 0.01
    assert found.off_diagonal > 0.01


def test_a_wish_that_is_soft_in_one_direction_has_joint_stiffness_too() -> None:
    rng = np.random.default_rng(6)
    K, J = stiffness(rng, rank=5), rng.standard_normal((6, 7))
    found = joint_stiffness(K, J)
    assert found.diagonal_fit is None
    assert found.is_feasible is None
    assert not found.stable
    assert np.allclose(J @ np.linalg.pinv(J) @ K, K)
    assert np.allclose(np.linalg.pinv(J).T @ found.matrix @ np.linalg.pinv(J), K, atol=1e-7)
    six = joint_stiffness(K, J[:, :6])
    assert six.definiteness == "positive semidefinite"


@pytest.mark.parametrize("unit", [1e-9, 1e9])
@pytest.mark.parametrize("n", [6, 7])
def test_fit_does_not_depend_on_the_unit_of_force(unit: float, n: int) -> None:
    rng = np.random.default_rng(n)
    K = stiffness(rng) + 2e3 * np.diag(np.repeat([0.09, 1.0], 3))
    J, W = rng.standard_normal((6, n)), 20.0 * rng.standard_normal(6)
    here, there = fit_diagonal(K, J, W), fit_diagonal(unit * K, J, unit * W)
    assert np.isclose(here.residual, there.residual, rtol=1e-6)
    assert here.cartesian is not None or n > 6


@given(seeds)
def test_moving_the_redundant_fit_does_not_improve_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    K = stiffness(rng) + 2e3 * np.diag(np.repeat([0.09, 1.0], 3))
    J, W = rng.standard_normal((6, 7)), 20.0 * rng.standard_normal(6)
    found = fit_diagonal(K, J, W, length=0.3)
    d = np.repeat([0.3, 1.0], 3)
    S, C = se3.chain_curvature(J, W), np.linalg.inv(K) * np.outer(d, d)
    x = 1.0 / found.stiffness

    def residual(x: np.ndarray) -> float:
        inverse = np.linalg.solve(np.eye(7) - x[:, None] * S, np.diag(x))
        error = np.outer(d, d) * (J @ inverse @ J.T) - C
        return float(np.linalg.norm(error) / np.linalg.norm(C))

    assert np.isclose(residual(x), found.residual, rtol=1e-6)
    for _ in range(5):
        step = 1e-3 * rng.standard_normal(7) * x.max()
        assert residual(np.maximum(x + step, 0.0)) >= found.residual * (1 - 1e-6)


def test_null_space_stiffness_is_free_to_choose() -> None:
    rng = np.random.default_rng(4)
    K, J = stiffness(rng), rng.standard_normal((6, 8))
    Kz = np.array([[500.0, 100.0], [100.0, 900.0]])
    for choice in (10.0, Kz):
        found = joint_stiffness(K, J, null_space_stiffness=choice)
        assert np.allclose(cartesian_stiffness(J, found.matrix, np.zeros(6)), K, rtol=1e-7)


@given(seeds)
def test_load_stiffness_changes_sign_with_the_load_and_is_symmetric(seed: int) -> None:
    rng = np.random.default_rng(seed)
    J, W = rng.standard_normal((6, 7)), rng.standard_normal(6)
    S = se3.chain_curvature(J, W)
    assert np.array_equal(S, S.T)
    assert np.allclose(se3.chain_curvature(J, -W), -S)
    assert not np.any(np.diag(S))
    for a in range(7):
        for b in range(a + 1, 7):
            assert np.isclose(S[a, b], 0.5 * W @ se3.bracket(J[:, a], J[:, b]))


@given(seeds, st.integers(1, 8))
def test_joint_shares_add_up(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    J, W, p = rng.standard_normal((6, n)), rng.standard_normal(6), rng.standard_normal(3)
    A = rng.standard_normal((n, n))
    H = A @ A.T + np.eye(n)
    found = joint_shares(J, H, W, p)
    C = J @ np.linalg.inv(H) @ J.T
    whole = compliance_deflection(C, W, p)
    assert np.allclose(found.deflection.twist, whole.twist)
    assert np.allclose(found.twists.sum(axis=1), whole.twist)
    assert np.allclose(found.displacements.sum(axis=1), whole.displacement)
    assert np.isclose(found.share.sum(), 1.0)
    assert np.isclose(found.energy.sum(), whole.energy)
    assert np.isclose(whole.energy, found.motion @ H @ found.motion / 2)


@given(seeds)
def test_deflection_does_not_depend_on_the_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    K = stiffness(rng) + 1e3 * np.diag(np.repeat([0.09, 1.0], 3))
    T, W, p = se3.exp(rng.standard_normal(6)), rng.standard_normal(6), rng.standard_normal(3)
    R = T[:3, :3]
    here = compliance_deflection(np.linalg.inv(K), W, p)
    there = compliance_deflection(
        np.linalg.inv(move_stiffness(K, T)),
        se3.adjoint(T).T @ W,
        R.T @ (p - T[:3, 3]),
    )
    assert np.allclose(R @ there.displacement, here.displacement, rtol=1e-6, atol=1e-9)
    assert np.isclose(here.energy, there.energy, rtol=1e-7)
    assert np.allclose(displacement_of_point(here.twist, np.zeros(3)), here.twist[3:])
