"""K(X, Y) = (Y X - nabla_Y X) Phi on fields that vary, straight from the definition."""

import numpy as np
import pytest
from tests.doors import Field
from tests.laws.test_connections import covariant_derivative
from tests.laws.test_tensor import CONNECTIONS
from tests.support import exp_reference, general_legs, legs_as_platform, slope

from cartstiff import analyse

# Two nested eighth-order differences at step 0.01.
NESTED = 1e-9


def _fields():
    """Two vector fields whose components vary from pose to pose."""
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(6, 16)), rng.normal(size=(6, 16))
    x = Field(lambda T: np.sin(0.4 * a @ T.ravel()))
    y = Field(lambda T: 0.4 * b @ T.ravel() + (T[0, 3] * T[1, 2]))
    return x, y


@pytest.fixture(scope="module")
def loaded():
    legs = general_legs()
    elastic = legs_as_platform(legs)
    return analyse(elastic), legs.energy


def along(f, T, twist):
    """Derivative of f at T along a twist, stepping a hundredth of a natural unit."""
    step = 0.01 / max(1.0, float(np.linalg.norm(twist)))
    return slope(lambda s: f(T @ exp_reference(s * twist)), step)


@pytest.mark.parametrize("name", ["A", "B", "K", "+", "metric", "user"])
def test_on_fields(loaded, name):
    result, energy = loaded
    T0 = result.pose
    connection = CONNECTIONS[name]
    x, y = _fields()

    second = along(lambda T: along(energy, T, x.at(T)), T0, y.at(T0))
    first = along(energy, T0, covariant_derivative(connection, y, x, T0))
    tensor = result.tensor(connection)
    size = float(np.abs(tensor.matrix).max()) * np.linalg.norm(y.at(T0)) * np.linalg.norm(x.at(T0))
    assert abs(tensor(x, y) - (second - first)) <= NESTED * size
    # Components count, not fields: the tensor at a pose knows only values there.
    assert tensor(x, y) == tensor(x.at(T0), y.at(T0))


@pytest.mark.parametrize("name", ["A", "B", "K", "+", "metric", "user"])
def test_on_the_basis(loaded, name):
    """K[i, j]: column j the motion, row i the component of the wrench."""
    result, energy = loaded
    T0 = result.pose
    connection = CONNECTIONS[name]
    K = result.tensor(connection).matrix
    W = result.wrench
    basis = np.eye(6)
    for i, j in [(0, 1), (1, 0), (0, 4), (4, 0), (3, 5), (2, 2), (5, 3), (2, 3), (3, 2)]:

        def x_phi(t, i=i, j=j):
            T = T0 @ exp_reference(t * basis[j])
            return slope(lambda s: energy(T @ exp_reference(s * basis[i])), 0.01)

        expected = slope(x_phi, 0.01) - W @ connection(basis[j], basis[i])
        assert abs(K[i, j] - expected) <= NESTED * np.abs(K).max(), (i, j)
