"""The mass of a superelement against finite elements of the same beam, assembled here."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.mechanisms.test_superelement import AREA, IY, IZ, NODES, J, beam_matrix

import cartstiff
from cartstiff.errors import InputError
from cartstiff.mechanisms.other_units import in_units
from cartstiff.mechanisms.superelement import superelement_mass

DENSITY = 7800.0
HUNG = 0.02  # kg at the tip, beside 0.468 kg of the beam
#: Two ways that are exact, through matrices of condition 1e7.
ROUNDING = 1e-9


def _element(length):
    """Consistent mass of an Euler-Bernoulli beam along x: ux uy uz rx ry rz of both ends."""
    m, M = DENSITY * AREA * length, np.zeros((12, 12))
    for k, size in ((0, m), (3, DENSITY * (IY + IZ) * length)):
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


def beam_mass(places):
    """Of a beam along x with nodes at some places."""
    return beam_matrix(places, _element)


@pytest.fixture(scope="module")
def matrices():
    return beam_matrix(NODES[:, 0]), beam_mass(NODES[:, 0])


@pytest.fixture
def arm(tmp_path, matrices):
    """Build: a bar of finite elements on the wall or on a joint, with a weight at its end."""

    def build(wall="fixed", turned=None, **keys):
        K, M = matrices
        R = np.eye(3) if turned is None else Rotation.from_rotvec(turned).as_matrix()
        big = np.kron(np.eye(8), R)
        np.savetxt(tmp_path / "K.txt", big @ K @ big.T)
        np.savetxt(tmp_path / "M.txt", big @ M @ big.T)
        tip = (R @ [0.6, 0, 0]).tolist()
        end = joint("end", "bar", "tool", kind="fixed", at=tip)
        write_urdf(tmp_path, joint("wall", "base", "bar", kind=wall), end, name="arm")
        element = {"K": "K.txt", "M": "M.txt", "nodes": (NODES @ R.T).tolist()}
        return cartstiff.load(
            write_file(
                tmp_path,
                "arm",
                kind="serial",
                model="arm.urdf",
                frame="tool",
                payload={"mass": HUNG},
                flexible={"bar": {"superelement": element}},
                **keys,
            )
        )

    return build


def _reduced(K, M, free):
    """Guyan's reduction of the rows `free` and the tip's, all others of them without inertia."""
    tip = np.arange(len(K) - 6, len(K))
    rest = np.setdiff1d(free, tip)
    T = np.zeros((len(K), 6))
    T[tip] = np.eye(6)
    T[rest] = -np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, tip)])
    return T


def _hertz(K, M):
    return np.sqrt(np.abs(eigh(K, M, eigvals_only=True))) / (2 * np.pi)


@pytest.mark.parametrize("turned", [None, [0.3, -0.8, 0.5]])
def test_modes_on_a_wall_are_those_of_the_reduced_beam(arm, matrices, turned):
    K, M = matrices
    T = _reduced(K, M, np.arange(6, 24))
    hung = M.copy()
    hung[18:21, 18:21] += HUNG * np.eye(3)
    expected = _hertz(T.T @ K @ T, T.T @ hung @ T)
    found = cartstiff.modes(arm(turned=turned)).frequencies
    assert found == pytest.approx(expected, rel=ROUNDING)
    # The whole beam's first bending: one element's worth of error.
    whole = _hertz(K[6:, 6:], hung[6:, 6:])[0]
    assert found[0] == pytest.approx(whole, rel=0.005)


def test_modes_on_a_joint_have_the_mass_between_joint_and_bar(arm, matrices):
    k = 900.0
    elastic = arm(wall="continuous", springs={"wall": {"stiffness": k}})
    K, M = matrices
    tip = _reduced(K, M, np.arange(6, 24))
    swing = np.concatenate([[0, x, 0, 0, 0, 1] for x in NODES[:, 0]])[:, None]
    T = np.hstack([swing, tip])
    hung = M.copy()
    hung[18:21, 18:21] += HUNG * np.eye(3)
    stiff = T.T @ K @ T
    stiff[0, 0] += k
    found = cartstiff.modes(elastic).frequencies
    assert found == pytest.approx(_hertz(stiff, T.T @ hung @ T), rel=ROUNDING)


def test_tip_under_its_own_weight_stands_where_the_whole_beam_has_it(arm, matrices):
    K, M = matrices
    g = 0.01  # m/s^2: so small that the beam stays straight to the digits compared
    hung = M.copy()
    hung[18:21, 18:21] += HUNG * np.eye(3)
    weight = hung @ np.tile([0, 0, -g, 0, 0, 0], 4)
    expected = np.linalg.solve(K[6:, 6:], weight[6:])[-6:]
    rested = cartstiff.equilibrium(arm(gravity=[0, 0, -g]), wrench=np.zeros(6))
    assert rested.pose[2, 3] == pytest.approx(expected[2], rel=1e-6)
    assert -rested.pose[2, 0] == pytest.approx(expected[4], rel=1e-6)


def test_other_units_weigh_and_swing_alike(arm):
    elastic = arm(wall="continuous", springs={"wall": {"stiffness": 900.0}}, gravity=[0, 0, -9.81])
    other = in_units(elastic, "mm")
    assert cartstiff.modes(other).frequencies == pytest.approx(
        cartstiff.modes(elastic).frequencies, rel=ROUNDING
    )
    assert sum(elastic.masses.values()) == pytest.approx(DENSITY * AREA * 0.6 + HUNG)
    assert "bar.mass" in elastic.masses


def test_the_whole_is_a_rigid_bar(matrices):
    K, M = matrices
    found = superelement_mass(M, K, NODES)
    assert found.mass == pytest.approx(DENSITY * AREA * 0.6)
    assert found.centre == pytest.approx([-0.3, 0, 0])
    about = DENSITY * AREA * 0.6**3 / 12
    assert np.diag(found.inertia) == pytest.approx([DENSITY * (IY + IZ) * 0.6, about, about])
    assert J > 0


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda M: M * 0.0, "no mass"),
        (lambda M: M + np.diag(np.tile([0.1, 0, 0, 0, 0, 0], 4)), "of no body"),
        (lambda M: M + np.eye(24)[::-1][:, ::-1] * np.arange(24), "of no body"),
        (lambda M: M + np.triu(0.1 * np.ones((24, 24)), 1), "must be symmetric"),
        (lambda M: M[:6, :6], "mass of the superelement"),
        (lambda M: M * np.where(np.isin(np.arange(24), range(6, 18)), -1, 1), "must be symmetric"),
    ],
)
def test_what_is_no_mass_is_refused(matrices, change, match):
    K, M = matrices
    with pytest.raises(InputError, match=match):
        superelement_mass(change(M), K, NODES)


def test_negative_energy_is_refused(matrices):
    K, M = matrices
    wrong = M.copy()
    bent = np.zeros(24)
    bent[[7, 13]] = [1, -0.8]  # as a whole it stays the same body
    rigid = np.concatenate(
        [
            np.vstack(
                [
                    np.hstack([np.eye(3), [[0, 0, 0], [0, 0, -x], [0, x, 0]]]),
                    np.hstack([np.zeros((3, 3)), np.eye(3)]),
                ]
            )
            for x in NODES[:, 0]
        ]
    )
    bent -= rigid @ np.linalg.lstsq(rigid, bent, rcond=None)[0]
    wrong -= 5.0 * np.outer(bent, bent)
    with pytest.raises(InputError, match="negative energy"):
        superelement_mass(wrong, K, NODES)


def test_many_postures_go_by_recorded_arithmetic_until_the_mass_weighs(arm):
    springs = {"wall": {"stiffness": 900.0}}
    elastic = arm(wall="continuous", springs=springs)
    q = np.zeros((5, 7))
    q[:, 0] = np.linspace(-1, 1, 5)
    recorded = cartstiff.analyse_many(elastic, q, path="portable")
    by_engine = cartstiff.analyse_many(elastic, q, path="engine")
    (K,), (expected,) = recorded.arrays.values(), by_engine.arrays.values()
    assert np.abs(K - expected).max() <= ROUNDING * np.abs(expected).max()
    weighing = arm(wall="continuous", springs=springs, gravity=[0, 0, -9.81])
    with pytest.raises(InputError, match="beside the way"):
        cartstiff.analyse_many(weighing, q, path="portable")
    assert cartstiff.analyse_many(weighing, q).path == "engine"
