"""Platforms by radii and angles: points of published machines, closed forms of their stiffness."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import absolute_error

import cartstiff

CASES = Path(__file__).parents[2] / "cases"
SIMSCAPE = {
    "base": {"radius": 0.115, "half_angle": np.pi / 18, "height": 0.015},
    "platform": {"radius": 0.09, "half_angle": np.pi / 18, "height": -0.015},
    "height": 0.09,
    "frame": {"xyz": [0, 0, 0.045]},
    "legs": 20e6,
}
# Case: cube's size and centre, the platform's height, the point over it.
CUBES = {
    "cubic-centred": (0.1, 0.05, 0.1, -0.05),
    "cubic-point-above": (0.1, 0.05, 0.1, 0.02),
    "cubic-platform-off-centre": (0.1, 0.05, 0.08, -0.03),
    "cubic-both-off-centre": (0.15, 0.06, 0.1, -0.05),
    "cubic-small-above": (0.04, 0.12, 0.1, 0.02),
    "cubic-medium-above": (0.15, 0.12, 0.1, 0.02),
    "cubic-large-above": (0.25, 0.12, 0.1, 0.02),
}


def stiffness(elastic):
    """The unloaded matrix at the file's pose."""
    return cartstiff.analyse(elastic).matrices["B"]


def test_the_points_of_stewart_simscape():
    """Its documentation prints them; the strokes of its kinematic study follow."""
    elastic, published = (
        cartstiff.hexapod(**SIMSCAPE),
        cartstiff.load(CASES / "simscape-stroke" / "mechanism.yaml"),
    )
    for name in ("anchors", "points", "T_P_M"):
        a, b = (getattr(e.mechanism, name) for e in (elastic, published))
        assert absolute_error(a, b) < 1e-14
    rates = np.linalg.inv(cartstiff.analyse(elastic).jacobian)
    strokes = rates @ np.diag([30e-6, 30e-6, 0, 50e-6, 50e-6, 50e-6])
    assert 1e6 * (strokes.max() - strokes.min()) == pytest.approx(76.1, abs=0.05)


@pytest.mark.parametrize("case", CUBES)
def test_cubic_platforms_of_stewart_simscape(case, tmp_path):
    """Each published table from a file of at most 15 lines."""
    size, centre, height, above = CUBES[case]
    text = (
        f"kind: stewart-gough\nlayout:\n  cubic: {{size: {size}, centre: {centre}}}\n"
        f"  base: {{height: 0}}\n  platform: {{height: 0}}\n  height: {height}\n"
        f"frame: {{xyz: [0, 0, {above}]}}\nlegs: {{stiffness: 1}}\n"
    )
    assert len(text.splitlines()) <= 15
    (tmp_path / "cube.yaml").write_text(text)
    elastic = cartstiff.load(tmp_path / "cube.yaml")
    published = cartstiff.load(CASES / case / "mechanism.yaml")
    assert absolute_error(stiffness(elastic), stiffness(published)) < 1e-14
    # The published files begin with the leg that is the last here.
    order = np.roll(range(6), 1)
    for name in ("anchors", "points"):
        a, b = (getattr(e.mechanism, name) for e in (elastic, published))
        assert absolute_error(a[order], b) < 1e-14


def test_a_cube_by_its_edge_is_the_bundled_one():
    found = stiffness(cartstiff.hexapod(cubic={"edge": 0.5}, legs=1e6))
    assert absolute_error(found, stiffness(cartstiff.load("cubic"))) < 1e-8
    moved = cartstiff.hexapod(cubic={"edge": 0.5, "centre": [0.1, 0.2, 0.3]}, legs=1e6)
    shift = np.array([0.1, 0.2, 0.3])
    own = cartstiff.hexapod(cubic={"edge": 0.5}, legs=1e6)
    assert absolute_error(moved.mechanism.anchors - own.mechanism.anchors, shift) < 1e-15


@settings(max_examples=25)
@given(
    radii=st.tuples(st.floats(0.2, 2.0), st.floats(0.2, 2.0)),
    halves=st.tuples(st.floats(0.0, 0.5), st.floats(0.0, 0.5)),
)
def test_rotations_of_an_isotropic_platform_are_one_to_four(radii, halves):
    """Where each leg rises by 1/sqrt 3, K about x and z are in the ratio 1 to 4.

    By hand, with n the unit vector of a leg at a point where rotation and translation do not
    couple: the moments' sum over six legs turned and mirrored is 3 sum(m_x^2 + m_y^2) and
    6 m_z^2; both follow from |b x n|.
    """
    a, b = radii
    half = np.pi / 3 - halves[0] - halves[1]
    across = np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(half))
    height = across / np.sqrt(2)  # s_z^2 = 1/3
    if across < 0.05:
        return
    elastic = cartstiff.hexapod(
        base={"radius": a, "half_angle": halves[0]},
        height=height,
        legs=1.0,
        platform={"radius": b, "half_angle": halves[1]},
    )
    K = stiffness(elastic)
    assert absolute_error(K[3:, 3:], 2 * np.eye(3)) < 1e-12
    # To the point of the axis where the coupling vanishes, by hand: K_rr - c^2 K_tt.
    coupling = K[0, 4] / K[4, 4]
    about_x = K[0, 0] - coupling**2 * K[4, 4]
    assert K[2, 2] == pytest.approx(4.0 * about_x, rel=1e-9, abs=1e-12)


def joints(**keys):
    """How many different joints base and platform have."""
    found = cartstiff.hexapod(height=0.5, legs=1.0, **keys).mechanism
    return tuple(len(np.unique(p.round(9), axis=0)) for p in (found.anchors, found.points_P))


def test_half_angles_say_how_many_joints_there_are():
    ring, pairs = {"radius": 1.0}, {"radius": 1.0, "half_angle": 0.2}
    assert joints(base=ring, platform=ring) == (3, 3)
    assert joints(base=pairs, platform=ring) == (6, 3)
    assert joints(base=pairs, platform=pairs) == (6, 6)


def test_angles_with_and_without_symmetry_say_the_same_as_pairs():
    base, platform = {"radius": 1.0, "half_angle": 0.2}, {"radius": 0.7, "half_angle": 0.3}
    pairs = cartstiff.hexapod(base=base, platform=platform, height=0.5, turn=0.9, legs=1.0)
    third = 2 * np.pi / 3
    lower, upper = [-0.2, 0.2], [0.9 - third + 0.3, 0.9 - 0.3]
    thirds = cartstiff.hexapod(
        base={"radius": 1.0, "angles": lower},
        platform={"radius": 0.7, "angles": upper},
        symmetry=3,
        height=0.5,
        legs=1.0,
    )
    every = cartstiff.hexapod(
        base={"radius": 1.0, "angles": [x + i * third for i in range(3) for x in lower]},
        platform={"radius": 0.7, "angles": [x + i * third for i in range(3) for x in upper]},
        height=0.5,
        legs=1.0,
    )
    for other in (thirds, every):
        assert absolute_error(other.mechanism.points, pairs.mechanism.points) < 1e-15
        assert absolute_error(other.mechanism.anchors, pairs.mechanism.anchors) < 1e-15


def test_units_are_those_of_the_file():
    ring = {"radius": 300, "half_angle": 0.2}
    keys = {"base": ring, "platform": ring, "height": 400}
    small = cartstiff.hexapod(**keys, legs=1e3, units={"length": "mm"})
    ring = {"radius": 0.3, "half_angle": 0.2}
    large = cartstiff.hexapod(base=ring, platform=ring, height=0.4, legs=1e6)
    in_metres = cartstiff.analyse(small).B.to_units("m", "N").matrix
    assert absolute_error(in_metres, stiffness(large)) < 1e-6
