"""Shortest vectors above bounds, against non-negative least squares of one system at a time."""

import numpy as np
import pytest
from scipy.optimize import nnls
from tests.doors import shortest_above


def by_least_squares(G, g):
    """Lawson and Hanson, chapter 23: the residual of a problem of least squares points along y."""
    u, _ = nnls(np.vstack([G.T, g]), np.append(np.zeros(G.shape[1]), 1.0))
    r = np.append(G.T @ u, g @ u - 1.0)
    return -r[:-1] / r[-1] if -r[-1] > 1e-8 else None


def drawn(kind, rng):
    p, r, d = 30, int(rng.integers(1, 16)), int(rng.integers(1, 6))
    G, g = rng.normal(size=(p, r, d)), rng.normal(size=(p, r)) - rng.uniform(0.0, 1.5)
    if kind == "many rows meet in one point":
        G, g = np.round(2.0 * G), np.round(2.0 * g)
    if kind == "columns of other sizes":
        G[:, :, 0] *= 0.05
    if kind == "rows without entries":
        G[:, ::3] = 0.0
    return G, g


@pytest.mark.parametrize(
    "kind",
    ["any", "many rows meet in one point", "columns of other sizes", "rows without entries"],
)
def test_the_same_as_by_least_squares(kind):
    rng, none = np.random.default_rng(5), 0
    for _ in range(12):
        G, g = drawn(kind, rng)
        y, exists = shortest_above(G, g)
        for rows, least, found, is_found in zip(G, g, y, exists, strict=True):
            expected = by_least_squares(rows, least)
            assert is_found == (expected is not None)
            none += expected is None
            if expected is not None:
                assert found == pytest.approx(expected, abs=1e-8 * (1.0 + np.abs(expected).max()))
                assert (rows @ found - least).min() > -1e-12
    assert 0 < none < 300


def test_nothing_to_reach_and_nothing_to_change():
    y, exists = shortest_above(np.zeros((2, 0, 3)), np.zeros((2, 0)))
    assert exists.all()
    assert not y.any()
    _, exists = shortest_above(np.zeros((2, 1, 0)), np.array([[1.0], [-1.0]]))
    assert exists.tolist() == [False, True]
