"""Charts: the paper's, exponential coordinates, a user's; what does not depend on them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from tests.doors import Chart, exponential, product_of_exponentials
from tests.support import (
    absolute_error,
    exp_reference,
    general_legs,
    gradient_of,
    hessian_of,
    legs_as_platform,
    log_reference,
    refused,
    relative_error,
    rotation,
    seeds,
    twist_of,
)

from cartstiff import ConvergenceError, UndefinedError
from cartstiff.geometry import from_pose_function, paper

ROUNDING = 1e-12
# Eighth-order differences at step 0.01 of poses of unit size.
DIFFERENCES = 1e-10
# Charts whose second derivatives are themselves differences.
NUMERICAL = 1e-7


def _axis(i: int, value: float) -> np.ndarray:
    return exp_reference(value * np.eye(6)[i])


def _user() -> Chart:
    """Rodrigues-like coordinates: position first, then a turn about a scaled axis."""

    def pose(xi):
        T = np.eye(4)
        T[:3, 3] = xi[3:] + 0.1 * xi[:3] ** 2
        w = xi[:3]
        S = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        T[:3, :3] = np.linalg.solve(np.eye(3) - S, np.eye(3) + S)  # Cayley's map
        return T

    return from_pose_function(pose, "Cayley")


def _screws() -> Chart:
    rng = np.random.default_rng(3)
    return product_of_exponentials(np.eye(6) + 0.2 * rng.normal(size=(6, 6)), "screws")


CHARTS = {"paper": paper, "exponential": exponential, "Cayley": _user(), "screws": _screws()}
EVERY = pytest.mark.parametrize("chart", CHARTS.values(), ids=CHARTS.keys())


@given(seeds)
def test_paper_pose(seed):
    """Section 2.4: Rot(x) Rot(y) Rot(z) Trans(x) Trans(y) Trans(z)."""
    xi = np.random.default_rng(seed).uniform(-3, 3, 6)
    expected = np.eye(4)
    for i in range(6):
        expected = expected @ _axis(i, xi[i])
    assert absolute_error(paper.pose(xi), expected) <= ROUNDING


@given(seeds)
def test_paper_coordinate_fields(seed):
    """Eq. 19, with the L_4 coefficient of E_1 as it should read, -(xi_5 S_2 + xi_6 C_2 S_3)."""
    xi = np.random.default_rng(seed).uniform(-3, 3, 6)
    _, x2, x3, x4, x5, x6 = xi
    S2, C2, S3, C3 = np.sin(x2), np.cos(x2), np.sin(x3), np.cos(x3)
    expected = np.eye(6)
    expected[:, 0] = [
        C2 * C3,
        -C2 * S3,
        S2,
        -(x5 * S2 + x6 * C2 * S3),
        x4 * S2 - x6 * C2 * C3,
        x5 * C2 * C3 + x4 * C2 * S3,
    ]
    expected[:, 1] = [S3, C3, 0, x6 * C3, -x6 * S3, x5 * S3 - x4 * C3]
    expected[:, 2] = [0, 0, 1, -x5, x4, 0]
    assert absolute_error(paper.basis(xi), expected) <= ROUNDING
    # Eq. 20 with its errata: wrench components of a form are the dual relation.
    F = np.random.default_rng(seed + 1).normal(size=6)
    assert absolute_error(paper.to_form(xi, F), expected.T @ F) <= ROUNDING * 10


def test_paper_chart_at_the_identity():
    """Eq. 51: coordinate fields and left-invariant fields coincide there."""
    assert np.array_equal(paper.pose(np.zeros(6)), np.eye(4))
    assert np.array_equal(paper.basis(np.zeros(6)), np.eye(6))


@EVERY
def test_basis_against_differences(chart):
    xi = np.random.default_rng(1).uniform(-0.8, 0.8, 6)
    inverse = np.linalg.inv(chart.pose(xi))
    dT = gradient_of(lambda d: chart.pose(xi + d), np.ones(6))
    expected = np.stack([twist_of(inverse @ dT[..., i]) for i in range(6)], axis=1)
    assert absolute_error(chart.basis(xi), expected) <= DIFFERENCES
    second = gradient_of(lambda d: chart.basis(xi + d), np.ones(6))
    assert absolute_error(chart.basis_derivative(xi), second) <= NUMERICAL


@EVERY
def test_changes_of_basis(chart):
    rng = np.random.default_rng(2)
    xi = rng.uniform(-0.8, 0.8, 6)
    rates, force = rng.normal(size=(2, 6))
    twist, wrench = chart.to_twist(xi, rates), chart.to_wrench(xi, force)
    assert abs(wrench @ twist - force @ rates) <= ROUNDING * 100  # power
    assert absolute_error(chart.to_form(xi, wrench), force) <= ROUNDING * 100
    assert absolute_error(chart.inverse_basis(xi) @ chart.basis(xi), np.eye(6)) <= ROUNDING * 10


@EVERY
def test_coordinates_of_a_pose(chart):
    rng = np.random.default_rng(4)
    for _ in range(3):
        xi = rng.uniform(-0.8, 0.8, 6)
        T = chart.pose(xi)
        found = chart.coordinates(T, xi + rng.uniform(-0.1, 0.1, 6))
        assert absolute_error(found, xi) <= 1e-9
        assert absolute_error(chart.pose(chart.coordinates(T)), T) <= ROUNDING * 10


@pytest.mark.parametrize("second", [np.pi / 2, -np.pi / 2, 3 * np.pi / 2])
def test_paper_singularity_is_named(second):
    xi = np.array([0.3, second, -0.2, 0.1, 0.2, 0.3])
    e = refused(
        r"singular at these coordinates \(cos\(xi_2\) = 0\)",
        paper.inverse_basis,
        xi,
        kind=UndefinedError,
    )
    assert e.code == "singular-chart"
    assert e.values["coordinates"] == xi.tolist()
    values = e.values["singular_values"]
    assert values[-1] <= 1e-15 * values[0] * 10
    for use in (paper.connection, lambda x: paper.to_wrench(x, np.ones(6))):
        refused("singular", use, xi, kind=UndefinedError)


def test_next_to_the_singularity_the_chart_works():
    xi = np.array([0.3, np.pi / 2 - 1e-4, -0.2, 0.1, 0.2, 0.3])
    assert np.isfinite(paper.inverse_basis(xi)).all()


def test_exponential_singularity_is_named():
    xi = np.array([2 * np.pi, 0, 0, 0.1, 0.2, 0.3])
    refused("rotation angle 2 pi", exponential.inverse_basis, xi, kind=UndefinedError)


def test_user_chart_without_words_for_its_singularity():
    flat_screws = np.eye(6)
    flat_screws[:, 0] = flat_screws[:, 2]
    chart = product_of_exponentials(flat_screws, "bad")
    refused("its basis matrix loses rank", chart.inverse_basis, np.zeros(6), kind=UndefinedError)


def test_no_convergence_is_told():
    """A map that does not move however its coordinates change."""
    still = Chart("still", lambda xi: np.eye(4), lambda xi: np.eye(6), paper.basis_derivative)
    caught = refused(
        "no coordinates found in chart 'still'",
        still.coordinates,
        exp_reference([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
        kind=ConvergenceError,
    )
    assert caught.iterations == 50
    assert caught.residual > 0


@pytest.fixture(scope="module")
def loaded():
    legs = general_legs()

    elastic = legs_as_platform(legs)
    T = elastic.mechanism.pose_of(legs.q)
    _, W, K_B = elastic.springs.on_pose(T)
    return T, legs.energy, W, K_B


@EVERY
def test_stiffness_does_not_depend_on_the_chart(loaded, chart):
    """Proposition 3.2: K_I and K_II differ from chart to chart, their sum does not."""
    T, energy, W, K_B = loaded
    xi = chart.coordinates(T)
    sizes = np.full(6, 0.5)
    gradient = gradient_of(lambda d: energy(chart.pose(xi + d)), sizes)
    hessian = hessian_of(lambda d: energy(chart.pose(xi + d)), sizes)
    wrench, first, second = chart.stiffness_terms(xi, gradient, hessian)
    K_A = first + second
    assert relative_error(wrench, W) <= 1e-9
    assert relative_error(0.5 * (K_A + K_A.T), K_B) <= 1e-7
    assert relative_error(first.T, first) <= 1e-9
    # K^A has the asymmetry that the load dictates, whatever the chart.
    t, f = W[:3], W[3:]
    S = [np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]]) for a in (t, f)]
    asymmetry = np.block([[S[0], S[1]], [S[1], np.zeros((3, 3))]])
    assert absolute_error(K_A - K_A.T, asymmetry) <= 1e-7 * np.abs(K_A).max()


def test_terms_do_differ_from_chart_to_chart(loaded):
    T, energy, _, _ = loaded
    firsts = []
    for chart in (paper, exponential):
        xi = chart.coordinates(T)
        sizes = np.full(6, 0.5)
        gradient = gradient_of(lambda d, c=chart, x=xi: energy(c.pose(x + d)), sizes)
        hessian = hessian_of(lambda d, c=chart, x=xi: energy(c.pose(x + d)), sizes)
        firsts.append(chart.stiffness_terms(xi, gradient, hessian)[1])
    assert relative_error(firsts[0], firsts[1]) > 1e-3


def test_exponential_chart_is_the_logarithm():
    rng = np.random.default_rng(5)
    for _ in range(3):
        T = np.eye(4)
        T[:3, :3] = rotation(rng)
        T[:3, 3] = rng.normal(size=3)
        if np.linalg.norm(log_reference(T)[:3]) < 2.5:
            assert absolute_error(exponential.coordinates(T), log_reference(T)) <= 1e-10
