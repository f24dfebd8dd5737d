"""Modes against printed tables, closed forms and kinetic energies found from positions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.mechanisms.machines import write_file
from tests.support import exp_reference, links, loaded_arm, relative_error

import cartstiff
from cartstiff import (
    DeadForce,
    FollowerWrench,
    InputError,
    UndefinedError,
    analyse,
    equilibrium,
    load,
    modes,
    payload,
)
from cartstiff.extend import in_units

#: Hz, as the simulator's documentation prints them, to a tenth.
PRINTED = [780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.6]
MASSLESS_STRUTS = [935.1, 935.1, 1098.5, 1428.6, 1428.6, 1722.6]


def test_printed_modes_of_a_stewart_platform():
    elastic = load("stewart-simscape")
    found = modes(elastic)
    assert np.abs(found.frequencies - PRINTED).max() < 0.1
    assert [note.code for note in found.notes].count("repeated-modes") == 2
    bare = replace(elastic, mechanism=_without_struts(elastic.mechanism))
    light = modes(bare)
    assert np.abs(light.frequencies - MASSLESS_STRUTS).max() < 0.1
    assert "massless-struts" in [note.code for note in light.notes]


def _without_struts(platform):
    from copy import copy

    other = copy(platform)
    other.struts = None
    return other


def _hexapod(tmp_path, **more):
    rng = np.random.default_rng(3)
    legs = {
        "mass": {
            "fixed": 0.4,
            "moving": [0.2, 0.3, 0.2, 0.1, 0.2, 0.25],
            "fixed_com": 0.15,
            "moving_com": 0.1,
            "radius": 0.02,
        }
    }
    angles = np.deg2rad([0, 20, 120, 140, 240, 260])
    base = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1) + rng.uniform(
        -0.1, 0.1, (6, 3)
    )
    top = 0.5 * np.stack([np.cos(angles + 1), np.sin(angles + 1), 0 * angles], 1)
    return load(
        write_file(
            tmp_path,
            "hexapod",
            kind="stewart-gough",
            base=base.tolist(),
            platform=top.tolist(),
            pose={"xyz": [0.05, -0.1, 0.8], "rpy": [0.1, 0.2, -0.1]},
            frame={"xyz": [0.02, 0, 0.1], "rpy": [0.3, 0, 0]},
            body={
                "mass": 3.0,
                "com": [0.01, 0.02, 0.03],
                "inertia": [[0.2, 0.01, 0], [0.01, 0.3, 0], [0, 0, 0.4]],
            },
            legs={"stiffness": 2e5, **legs},
            **more,
        )
    )


def _masses(platform, pose):
    """Positions (k, 3) and masses (k,) of points that stand for the platform and its legs."""
    points, weights = [], []
    T_F_P = pose @ np.linalg.inv(platform.T_P_M)
    b = (platform.points_P @ T_F_P[:3, :3].T) + T_F_P[:3, 3]
    struts = platform.struts
    x, w = np.polynomial.legendre.leggauss(6)
    for k, (a, end) in enumerate(zip(platform.anchors, b, strict=True)):
        u = (end - a) / np.linalg.norm(end - a)
        for mass, com, root, sign in (
            (struts.fixed[k], struts.fixed_com[k], a, 1.0),
            (struts.moving[k], struts.moving_com[k], end, -1.0),
        ):
            for s, share in zip(x, w / 2, strict=True):
                points.append(root + sign * com * (1 + s) * u)
                weights.append(mass * share)
    return np.array(points), np.array(weights)


def test_kinetic_energy_of_legs_is_that_of_their_points(tmp_path):
    """Slender bars as points on the lines, moved by differences of poses."""
    elastic = _hexapod(tmp_path)
    platform = elastic.mechanism
    slender = replace(platform.struts, radius=np.zeros(6))
    posture = platform.at(elastic.q)
    M = slender.mass_matrix(posture.lines, platform.points)
    P = slender.momentum(posture.lines, platform.points, posture.pose)
    h = 1e-5
    weights = _masses(platform, posture.pose)[1]
    rates = np.stack(
        [
            (
                _masses(platform, posture.pose @ exp_reference(h * e))[0]
                - _masses(platform, posture.pose @ exp_reference(-h * e))[0]
            )
            / (2 * h)
            for e in np.eye(6)
        ],
        axis=-1,
    )
    assert relative_error(np.einsum("kia,kib,k->ab", rates, rates, weights), M) < 1e-8
    linear = np.einsum("kia,k->ia", rates, weights)
    assert relative_error(linear, P) < 1e-8
    assert slender.mass == pytest.approx(weights.sum())


def test_weight_of_legs_is_a_potential(tmp_path):
    elastic = _hexapod(tmp_path, gravity=[1.0, -2.0, -9.81])
    platform, g = elastic.mechanism, np.array([1.0, -2.0, -9.81])
    pose = platform.pose_of(elastic.q)

    def energy(x):
        q = platform.coordinates_of(pose @ exp_reference(x))
        return platform.at(q).gravity(g).energy

    found = platform.at(elastic.q).gravity(g)
    h = 1e-4
    E = np.eye(6)
    gradient = [(energy(h * e) - energy(-h * e)) / (2 * h) for e in E]
    assert relative_error(found.gradient, gradient) < 1e-7
    H = [
        [
            (energy(h * (a + b)) - energy(h * (a - b)) - energy(h * (b - a)) + energy(-h * (a + b)))
            / (4 * h * h)
            for b in E
        ]
        for a in E
    ]
    assert relative_error(found.hessian, H) < 1e-6


# Two links of length l with springs k, masses m_1, m_2 at the knee and the tip.
K, LENGTH, M_1, M_2 = 3.0, 0.7, 2.5, 1.25


def column(masses=(M_1, M_2), stiffness=(K, K), inertia=0.0):
    return links(stiffness, length=LENGTH, masses=masses, inertia=inertia)


def by_hand(p):
    """omega^2 under a dead force of p k / l along the links, absolute angles."""
    M = LENGTH**2 * np.array([[M_1 + M_2, M_2], [M_2, M_2]])
    stiffness = K * np.array([[2.0 - p, -1.0], [-1.0, 1.0 - p]])
    return np.sort(np.linalg.eigvals(np.linalg.solve(M, stiffness)).real)


@pytest.mark.parametrize("p", [0.0, 0.2, -0.7, 0.38, 0.6])
def test_dead_axial_force_moves_the_frequencies(p):
    """Beyond P l / k = (3 - sqrt 5) / 2 = 0.382 the column has left."""
    W = np.array([0.0, 0.0, 0.0, -p * K / LENGTH, 0.0, 0.0])
    for found in (
        modes(column(), wrench=W),
        modes(equilibrium(column(), DeadForce(W[3:]), settle=False)),
    ):
        assert found.squares == pytest.approx(by_hand(p), rel=1e-12)
        codes = [note.code for note in found.notes]
        assert ("unstable" in codes) == (p == 0.6)
        assert np.isnan(found.frequencies).tolist() == [p == 0.6, False]


def test_follower_force_flutters():
    W = [0.0, 0.0, 0.0, -3.0 * K / LENGTH, 0.0, 0.0]
    found = modes(column(), wrench=W, load_kind="follower")
    codes = [note.code for note in found.notes]
    assert "flutter" in codes
    assert "repeated-modes" not in codes  # a conjugate pair is no subspace of modes
    assert np.isnan(found.frequencies).all()
    state = modes(equilibrium(column(), FollowerWrench(W), settle=False))
    assert found.squares == pytest.approx(state.squares, rel=1e-9)


def test_modes_are_orthonormal_and_shares_are_whole():
    arm = loaded_arm("RRPRRR", seed=4)
    found = modes(arm.elastic, arm.q, load_kind="conservative")
    phi = found.shapes
    assert phi.T @ found.full_mass @ phi == pytest.approx(np.eye(6), abs=1e-11)
    assert found.participation.sum(axis=1) == pytest.approx(np.ones(6))
    assert found.twists == pytest.approx(found.posture.motion.jacobian @ phi)
    # One free motion more than joints: all that moves, moved by its base as a whole.
    assert (found.effective_masses.sum(axis=0) <= found._momentum[1] + 1e-9).all()
    alone = column(masses=(M_1,), stiffness=(K,))
    one = modes(alone)
    assert one.effective_masses[0] == pytest.approx([0.0, M_1, 0.0], abs=1e-12)
    assert one.nodal_axes[0].point == pytest.approx([-LENGTH, 0.0, 0.0])


def test_effective_masses_of_a_turned_platform(tmp_path):
    """By the motion of the body's mass centre in each mode, along the axes of F."""
    elastic = _hexapod(tmp_path)
    bare = modes(replace(elastic, mechanism=_without_struts(elastic.mechanism)))
    turn, R = Rotation.from_euler("x", 0.3).as_matrix(), bare.posture.pose[:3, :3]
    centre = turn.T @ (np.array([0.01, 0.02, 0.03]) - [0.02, 0.0, 0.1])
    velocity = R @ (bare.twists[3:] - np.cross(centre, bare.twists[:3], axisb=0).T)
    assert bare.effective_masses == pytest.approx((3.0 * velocity.T) ** 2, rel=1e-9, abs=1e-9)
    assert bare.effective_masses.sum(axis=0) == pytest.approx(np.full(3, 3.0))
    weights = _masses(elastic.mechanism, bare.posture.pose)[1]
    assert modes(elastic).to_dict()["moving_mass"] == pytest.approx(3.0 + weights.sum())


def test_zero_repeated_and_massless_motions_are_named():
    free = modes(column(stiffness=(0.0, K)))
    assert free.frequencies[0] == 0.0
    assert "free-motion" in [note.code for note in free.notes]
    follows = modes(column(masses=(M_1, 0.0)))
    assert follows.frequencies.size == 1
    assert follows.squares[0] == pytest.approx(K / (M_1 * LENGTH**2))
    assert {"massless-motion", "massless-links"} <= {note.code for note in follows.notes}
    loose = modes(column(masses=(M_1, 0.0), stiffness=(K, 0.0)))
    assert loose.squares[0] == pytest.approx(K / (M_1 * LENGTH**2))
    assert "massless-free-motion" in [note.code for note in loose.notes]
    with pytest.raises(UndefinedError, match="nothing that moves in column has a mass"):
        modes(column(masses=(0.0, 0.0)))


def test_absurd_masses_are_named():
    codes = {note.code for note in modes(column(masses=(5e3, 5e3), inertia=1.0)).notes}
    assert codes == {"implausible-mass"}
    codes = {note.code for note in modes(column(inertia=50.0)).notes}
    assert codes == {"inertia-absurd"}
    assert not modes(in_units(load("ur5"), "mm")).notes


def test_springs_far_apart_keep_their_digits():
    found = modes(column(stiffness=(1e13, 1e-3)))
    soft = 1e-3 / (M_2 * LENGTH**2)
    assert found.squares[0] == pytest.approx(soft, rel=1e-6)


def test_payload_has_inertia_wherever_it_comes_from():
    given = modes(column().with_payload(0.8, [0.1, 0.2, 0.0]))
    hung = equilibrium(column(), payload(0.8, [0.0, 0.0, 0.0], [0.1, 0.2, 0.0]))
    assert modes(hung).squares == pytest.approx(given.squares, rel=1e-12)
    assert given.squares[0] < modes(column()).squares[0]
    heavier = load("stewart-simscape").with_payload(0.5, [0.0, 0.0, 0.02])
    assert modes(heavier).to_dict()["weighed"][0]["mass"] == 1.5
    with pytest.raises(InputError, match="payload mass"):
        column().with_payload(-1.0)


def test_results_have_their_own_load():
    result = analyse(column(), wrench=[0.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    assert modes(result).load["wrench"][3] == -1.0
    with pytest.raises(InputError, match="has its posture and its load"):
        modes(result, q=[0.0, 0.0])


def test_free_beam_of_lumped_segments_converges(tmp_path):
    """beta L = 4.730041, 7.853205, 10.995608; the error goes with the square of the length."""
    (tmp_path / "rod.urdf").write_text(
        '<robot name="rod"><link name="bar"/><link name="tip"/><joint name="end" type="fixed">'
        '<parent link="bar"/><child link="tip"/><origin xyz="1 0 0"/></joint></robot>'
    )
    E, area, inertia, density = 2e11, 1e-4, 1e-10, 8000.0
    errors = []
    for segments in (6, 12):
        beam = {
            "E": E,
            "G": 8e10,
            "length": 1.0,
            "area": area,
            "Iy": inertia,
            "Iz": inertia,
            "J": 2e-10,
            "density": density,
            "segments": segments,
        }
        rod = write_file(
            tmp_path,
            "rod",
            kind="closed-chain",
            model="rod.urdf",
            frame="tip",
            floating=True,
            flexible={"bar": {"beam": beam}},
        )
        found = modes(load(rod))
        assert (found.squares[:6] == 0.0).all()
        beta = (density * area * found.squares[6:12:2] / (E * inertia)) ** 0.25
        errors.append(beta / [4.730041, 7.853205, 10.995608] - 1)
        assert found._momentum[1] == pytest.approx(density * area)
    assert np.abs(errors[1]).max() < 0.015
    assert np.log2(errors[0] / errors[1]) == pytest.approx([2.0, 2.0, 2.0], abs=0.15)


def test_what_is_exported():
    assert cartstiff.modes is modes
    data = modes(load("stewart-simscape"), wrench=[0, 0, 0, 0, 0, -100.0]).to_dict()
    assert data["schema"] == "cartstiff-modes/1"
    assert np.array(data["mass_matrix"]).shape == (6, 6)
    assert data["load"]["given"]
