"""Line springs against 50-digit differences of their energy along exponential maps."""

import mpmath as mp
import numpy as np
import pytest
from tests.support import (
    absolute_error,
    general_legs,
    gradient_of,
    legs_as_platform,
    matrices_from,
    paper_platform,
    random_pose,
    relative_error,
    twist_matrix,
)

from cartstiff import LineSprings, analyse

# The oracle is good to 25 digits; what is left is double precision over some dozen operations.
ROUNDING = 2e-14
# Differences in double precision: the eighth-order stencil of step 0.01 leaves about 1e-12.
DIFFERENCES = 1e-10


def _exact(T, anchors, points, k, rest):
    """K^A and W by central differences of step 1e-12 in 50-digit arithmetic."""
    with mp.workdps(50):
        h = mp.mpf(10) ** -12
        T, a, b = mp.matrix(T.tolist()), mp.matrix(anchors.tolist()), mp.matrix(points.tolist())
        k, rest = [mp.mpf(float(x)) for x in k], [mp.mpf(float(x)) for x in rest]

        def flow(i, t):
            X = mp.matrix(twist_matrix(np.eye(6)[i]).tolist()) * t
            M, term = mp.eye(4), mp.eye(4)
            for n in range(1, 6):  # the next term is below 1e-70
                term = term * X / n
                M += term
            return M

        flows = {(i, s): flow(i, s * h) for i in range(6) for s in (-1, 1)}

        def energy(M):
            total = mp.mpf(0)
            for s in range(len(k)):
                p = [sum(M[r, c] * b[s, c] for c in range(3)) + M[r, 3] - a[s, r] for r in range(3)]
                total += k[s] * (mp.sqrt(sum(x * x for x in p)) - rest[s]) ** 2 / 2
            return total

        W = [(energy(T * flows[i, 1]) - energy(T * flows[i, -1])) / (2 * h) for i in range(6)]
        K = np.zeros((6, 6))
        for j in range(6):
            before = {s: T * flows[j, s] for s in (-1, 1)}
            for i in range(6):
                mixed = sum(
                    s * r * energy(before[s] * flows[i, r]) for s in (-1, 1) for r in (-1, 1)
                )
                K[i, j] = float(mixed / (4 * h * h))
        return K, np.array([float(w) for w in W])


@pytest.mark.parametrize("case", ["paper", "general"])
def test_platform_matrices(case):
    elastic = paper_platform() if case == "paper" else legs_as_platform(general_legs())
    result = analyse(elastic)
    springs = elastic.springs
    K_A, W = _exact(
        result.pose, springs.anchors, springs.points, springs.stiffness, springs.rest_length
    )
    assert relative_error(result.wrench, W) <= ROUNDING
    for name, K in matrices_from(K_A, W).items():
        assert relative_error(result.tensor(name).matrix, K) <= ROUNDING, name


def test_random_springs_at_random_poses():
    rng = np.random.default_rng(11)
    T = random_pose(rng)
    anchors, points = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    k, rest = rng.uniform(1, 9, 3), rng.uniform(0.2, 2.5, 3)
    springs = LineSprings(anchors=anchors, points=points, stiffness=k, rest_length=rest)
    energy, wrench, K_B = springs.on_pose(T)
    K_A, W = _exact(T, anchors, points, k, rest)
    lengths = np.linalg.norm(points @ T[:3, :3].T + T[:3, 3] - anchors, axis=1)
    assert abs(energy - 0.5 * k @ (lengths - rest) ** 2) <= ROUNDING * energy
    assert relative_error(wrench, W) <= ROUNDING
    assert relative_error(K_B, matrices_from(K_A, W)["B"]) <= ROUNDING


def test_flat_connection_is_the_hessian_in_leg_lengths():
    """K^F = sum k g g^T whatever the preload."""
    legs = general_legs()
    result = analyse(legs_as_platform(legs))
    g = np.linalg.inv(result.jacobian)
    assert relative_error(result.matrices["F"], g.T @ np.diag(legs.stiffness) @ g) <= ROUNDING


def test_lines_are_the_gradients_of_the_lengths():
    legs = general_legs()
    elastic = legs_as_platform(legs)
    platform = elastic.mechanism
    rows = gradient_of(lambda x: platform.leg_lengths(platform.displaced(legs.q, x)), np.ones(6))
    assert absolute_error(platform.at(legs.q).lines.lines, rows) <= DIFFERENCES
    assert relative_error(np.linalg.inv(analyse(elastic).jacobian), rows) <= 1e-9


def test_cables_cannot_push():
    """A cable shorter than its rest length carries nothing; a taut one is a spring."""
    rng = np.random.default_rng(3)
    T = random_pose(rng)
    anchors, points = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    lengths = np.linalg.norm(points @ T[:3, :3].T + T[:3, 3] - anchors, axis=1)
    rest = lengths + np.array([0.1, -0.1, 0.2, -0.3])
    k = rng.uniform(1, 9, 4)
    cables = LineSprings(
        anchors=anchors, points=points, stiffness=k, rest_length=rest, unilateral=True
    )
    taut = np.array([False, True, False, True])
    assert np.array_equal(cables.is_taut(lengths), taut)
    assert np.all(cables.tensions(lengths)[~taut] == 0)
    springs = LineSprings(
        anchors=anchors[taut], points=points[taut], stiffness=k[taut], rest_length=rest[taut]
    )
    assert np.all(springs.is_taut(lengths[taut] - 1.0))
    for got, expected in zip(cables.on_pose(T), springs.on_pose(T), strict=True):
        assert relative_error(got, expected) <= ROUNDING
