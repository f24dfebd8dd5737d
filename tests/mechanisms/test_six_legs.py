"""One platform on six legs, four ways: line springs, a tree with closures, six chains, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from tests.mechanisms.machines import six_chains
from tests.mechanisms.oracle import Held, missed, natural_error
from tests.support import relative_error

from cartstiff import analyse, load

# Two exact routes through different coordinates; condition numbers of 1e3 stand between.
SAME = 1e-9
# Differences of the reduced energy and of the load, step 0.005.
DIFFERENCES = 1e-9
# Springs in the joints change the matrices by more than this share.
VISIBLE = 1e-5
WRENCH = np.array([300.0, -250.0, 180.0, 2000.0, -3000.0, -5000.0])


def _same(a, b):
    assert relative_error(a.pose, b.pose) <= SAME
    size = max(np.abs(b.wrench).max(), 1e-6 * np.abs(b.matrices["B"]).max())
    assert np.abs(a.wrench - b.wrench).max() <= SAME * size
    for name in "ABKF":
        if a.matrices[name] is None or b.matrices[name] is None:
            assert name == "F"
            continue
        assert natural_error(a.matrices[name], b.matrices[name], b.posture.length) <= SAME, name


@pytest.mark.parametrize("wrench", [None, WRENCH, -20 * WRENCH])
def test_tree_equals_lines(wrench):
    tree, lines = (analyse(load(n), wrench=wrench) for n in ("6-ups", "hexapod"))
    _same(tree, lines)
    assert tree.matrices["F"] is not None
    # The tree's URDF has fifteen digits: the poses meet to that.
    assert relative_error(tree.compliances["F"], lines.compliances["F"]) <= SAME


def test_tree_equals_lines_away_from_home():
    """Fixed rest lengths, and slides displaced: the tree is assembled, the platform follows."""
    home = analyse(load("6-ups"), wrench=WRENCH)
    q = dict(zip(home.elastic.names, home.q, strict=True))
    for i, d in enumerate([0.02, -0.01, 0.03, 0.015, -0.02, 0.01]):
        q[f"leg{i + 1}_slide"] += d
    tree = analyse(home.elastic, q)
    lines = analyse(load("hexapod"), wrench=WRENCH).elastic
    moved = analyse(lines, lines.mechanism.coordinates_of(tree.pose))
    assert relative_error(tree.pose, home.pose) > VISIBLE
    _same(tree, moved)


@pytest.mark.parametrize("tilt", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("wrench", [None, WRENCH])
def test_chains_equal_lines(tmp_path, wrench, tilt):
    """How a leg's base is turned is a choice of coordinates."""
    chains = analyse(six_chains(tmp_path, tilt), wrench=wrench)
    lines = analyse(load("hexapod"), wrench=wrench)
    assert chains.matrices["F"] is not None
    _same(chains, lines)


def test_springs_in_the_joints(tmp_path):
    """Springs in the universal joints: stiffer, and by what the reduced energy says."""
    elastic = analyse(six_chains(tmp_path, 0.2), wrench=WRENCH).elastic
    plain = analyse(elastic)
    hinges = {f"leg{i + 1}/{n}": 800.0 for i in range(6) for n in ("u1", "u2")}
    rest = {n: elastic.q[elastic.names.index(n)] - 0.05 * (-1) ** i for i, n in enumerate(hinges)}
    sprung = analyse(elastic.with_springs(hinges, rest))
    change = np.abs(sprung.matrices["B"] - plain.matrices["B"]).max()
    assert change > VISIBLE * np.abs(plain.matrices["B"]).max()
    assert max(missed(sprung, Held(sprung.elastic, sprung.q), 0.005)[:2]) <= DIFFERENCES
    # The load is what the legs exert and what the hinges add to it.
    assert np.abs(sprung.wrench - plain.wrench).max() > 1.0


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


def test_gravity_on_the_tree():
    """Weights of legs and platform: carried by the slides, and W = 0 makes all matrices one."""
    elastic = replace(load("6-ups"), gravity=np.array([0.0, 0.0, -9.81]))
    result = analyse(elastic)
    size = np.abs(result.evaluation.gradient).max() + np.abs(result.closure_forces).max()
    assert np.abs(result.wrench).max() <= SAME * size
    for name in "AK":
        assert relative_error(result.matrices[name], result.matrices["B"]) <= SAME
    light = analyse(load("6-ups"))
    assert relative_error(result.matrices["B"], light.matrices["B"]) > 1e-7
