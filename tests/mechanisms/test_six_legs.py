"""A platform on six chains is that on six line springs, and its springs are those of its file."""

import numpy as np
import pytest
from tests.mechanisms.machines import six_chains
from tests.mechanisms.oracle import natural_error
from tests.support import relative_error

from cartstiff import analyse, load

# Two exact routes through different coordinates; condition numbers of 1e3 stand between.
SAME = 1e-9
WRENCH = np.array([300.0, -250.0, 180.0, 2000.0, -3000.0, -5000.0])


def _same(a, b):
    assert relative_error(a.pose, b.pose) <= SAME
    size = max(np.abs(b.wrench).max(), 1e-6 * np.abs(b.matrices["B"]).max())
    assert np.abs(a.wrench - b.wrench).max() <= SAME * size
    for name in "ABKF":
        assert natural_error(a.matrices[name], b.matrices[name], b.posture.length) <= SAME, name


@pytest.mark.parametrize("tilt", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("wrench", [None, WRENCH])
def test_chains_equal_lines(tmp_path, wrench, tilt):
    """How a leg's base is turned is a choice of coordinates."""
    chains = analyse(six_chains(tmp_path, tilt), wrench=wrench)
    lines = analyse(load("hexapod"), wrench=wrench)
    _same(chains, lines)


def test_springs_given_in_the_file(tmp_path):
    """Rest positions in a file and rest positions given later are the same springs."""
    in_file = analyse(six_chains(tmp_path, 0.2, passive=400.0))
    elastic = six_chains(tmp_path, 0.2)
    k = {f"leg{i + 1}/{n}": 400.0 * (j + 1) for i in range(6) for j, n in enumerate(("u1", "u2"))}
    rest = {
        f"leg{i + 1}/{n}": elastic.q[elastic.names.index(f"leg{i + 1}/{n}")] - 0.1 * (j + 1)
        for i in range(6)
        for j, n in enumerate(("u1", "u2"))
    }
    later = analyse(elastic.with_springs(k, rest))
    assert np.abs(in_file.wrench).max() < SAME * np.abs(in_file.closure_forces).max()
    assert np.abs(later.wrench).max() < SAME * np.abs(later.closure_forces).max()
    for name in "ABKF":
        assert relative_error(in_file.matrices[name], later.matrices[name]) <= SAME
