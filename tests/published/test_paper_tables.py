"""The numerical example of the paper: four stiffness tables and the inverse Jacobian."""

import numpy as np
import pytest
from tests.support import absolute_error, paper_platform, reference, relative_error

from cartstiff import analyse

TABLES = reference("paper_tables.json")

# The tables are printed to one decimal, the coordinates to three.
PRINTED = 0.05
# J^-1 is printed to two decimals.
PRINTED_JACOBIAN = 0.005
# The load was recomputed to ten figures after the decimal point.
RECOMPUTED = 1e-8
# Two ways through the same arithmetic.
SAME = 1e-13

LOAD = np.array(
    [945.10201381, -2376.391269224, -369.605133874, 304.65310187, 59.284337961, 505.963020609]
)


@pytest.fixture(scope="module")
def result():
    return analyse(paper_platform())


@pytest.mark.parametrize("name", ["A", "K", "B", "F"])
def test_table(result, name):
    difference = np.abs(result.matrices[name] - np.array(TABLES[name]))
    assert difference.max() <= PRINTED, np.unravel_index(difference.argmax(), (6, 6))
    # The tensors are the same numbers with their meaning attached.
    tensor = result.tensor(name)
    assert relative_error(tensor.matrix, result.matrices[name]) <= SAME
    assert tensor.connection.name == name
    assert (tensor.units.length, tensor.units.force) == ("cm", "N")


def test_inverse_jacobian(result):
    inverse = np.linalg.inv(result.jacobian)
    assert absolute_error(inverse, np.array(TABLES["J_inverse"])) <= PRINTED_JACOBIAN


def test_load(result):
    assert absolute_error(result.wrench, LOAD) <= RECOMPUTED


def test_frame_at_identity(result):
    assert np.array_equal(result.pose, np.eye(4))
    # The printed platform is ill-conditioned: its legs are close to a linear complex.
    assert {note.code for note in result.notes} <= {"near-type-2-singularity"}


def test_symmetry_as_printed(result):
    for name in "KBF":
        K = result.matrices[name]
        assert relative_error(K.T, K) <= SAME
    A = result.matrices["A"]
    assert absolute_error(A, A.T) > 100  # the load makes K^A visibly asymmetric
