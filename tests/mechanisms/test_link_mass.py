"""A link's 6x6 stiffness and mass against finite elements of the same bar, assembled here."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from tests.mechanisms.beams import element
from tests.mechanisms.machines import joint, write_file, write_urdf

import cartstiff
from cartstiff import InputError
from cartstiff.extend import in_units

SECTION = {"E": 2e11, "G": 8e10, "area": 1e-4, "Iy": 1e-9, "Iz": 2e-9, "J": 2e-9}
NODES = np.array([0.0, 0.2, 0.35, 0.6])
DENSITY, HUNG = 7800.0, 0.02
SWAP = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])


def _mass(length):
    """Consistent mass of an Euler-Bernoulli beam along x: ux uy uz rx ry rz of both ends."""
    m, M = DENSITY * SECTION["area"] * length, np.zeros((12, 12))
    turning = DENSITY * (SECTION["Iy"] + SECTION["Iz"]) * length
    for k, size in ((0, m), (3, turning)):
        M[np.ix_([k, k + 6], [k, k + 6])] = size / 6 * np.array([[2, 1], [1, 2]])
    for rows, s in (([1, 5, 7, 11], length), ([2, 4, 8, 10], -length)):
        M[np.ix_(rows, rows)] = (
            m
            / 420
            * np.array(
                [
                    [156, 22 * s, 54, -13 * s],
                    [22 * s, 4 * s * s, 13 * s, -3 * s * s],
                    [54, 13 * s, 156, -22 * s],
                    [-13 * s, -3 * s * s, -22 * s, 4 * s * s],
                ]
            )
        )
    return M


def _whole(of):
    K = np.zeros((24, 24))
    for i, length in enumerate(np.diff(NODES)):
        K[6 * i : 6 * i + 12, 6 * i : 6 * i + 12] += of(length)
    return K


@pytest.fixture(scope="module")
def reduced():
    """Stiffness and mass (6, 6) of the tip, the base clamped: the other nodes follow statically."""
    K, M = _whole(lambda length: element(SECTION, length)), _whole(_mass)
    T = np.vstack([np.zeros((6, 6)), -np.linalg.solve(K[6:18, 6:18], K[6:18, 18:]), np.eye(6)])
    return T.T @ K @ T, T.T @ M @ T


@pytest.fixture
def arm(tmp_path, reduced):
    """Build: the bar on the wall or on a joint, with a weight at its end."""

    def build(turned=None, link=None, **keys):
        R = np.eye(3) if turned is None else Rotation.from_rotvec(turned).as_matrix()
        big = np.kron(np.eye(2), R)
        K, M = (((m + m.T) / 2)[SWAP] for m in (big @ m @ big.T for m in reduced))
        tip = (R @ [0.6, 0, 0]).tolist()
        end = joint("end", "bar", "tool", kind="fixed", at=tip)
        write_urdf(tmp_path, joint("wall", "base", "bar", kind="fixed"), end, name="arm")
        own = {"stiffness": K.tolist(), "mass": M.tolist(), "offset": {"xyz": tip}} | (link or {})
        own = {key: value for key, value in own.items() if value is not None}
        file = {"kind": "serial", "model": "arm.urdf", "frame": "tool", "payload": {"mass": HUNG}}
        return cartstiff.load(write_file(tmp_path, "arm", **file, flexible={"bar": own}, **keys))

    return build


@pytest.mark.parametrize("turned", [None, [0.3, -0.8, 0.5]])
def test_modes_on_a_wall_are_those_of_the_reduced_beam(arm, reduced, turned):
    K, M = reduced
    hung = M + HUNG * np.diag([1, 1, 1, 0, 0, 0])
    expected = np.sqrt(eigh(K, hung, eigvals_only=True)) / (2 * np.pi)
    assert cartstiff.modes(arm(turned=turned)).frequencies == pytest.approx(expected, rel=1e-9)
    bare = cartstiff.modes(arm(turned=turned, link={"mass": None})).frequencies
    assert bare[0] > 1.5 * expected[0]


def test_other_units_swing_alike(arm):
    elastic = arm()
    other = cartstiff.modes(in_units(elastic, "mm")).frequencies
    assert other == pytest.approx(cartstiff.modes(elastic).frequencies, rel=1e-9)


def test_compliances_of_a_link_have_the_units_of_deflections_over_efforts(arm):
    """By the powers of their units the numbers in mm follow from those in m."""
    elastic = arm(link={"mass": None})
    here, there = elastic.compliances, in_units(elastic, "mm").compliances
    assert len(here) == 21
    assert {(one.length, one.force) for one in here.values()} == {(-1, -1), (0, -1), (1, -1)}
    for name, one in here.items():
        converted = one.value * 1e3**one.length
        assert there[name].value == pytest.approx(converted, rel=1e-9, abs=1e-16), name


@pytest.mark.parametrize(
    ("link", "words"),
    [
        ({"mass": np.triu(np.ones((6, 6))).tolist()}, "mass must be symmetric"),
        ({"mass": (-np.eye(6)).tolist()}, "no negative eigenvalue"),
        ({"mass": np.eye(5).tolist()}, "mass"),
        ({"stiffness": None, "beam": {**SECTION, "length": 0.6}}, "a beam has density"),
    ],
)
def test_masses_that_are_refused(arm, link, words):
    with pytest.raises(InputError, match=words):
        arm(link=link)
