"""Motions without mass follow the others: fifty digits, and a cantilever by hand."""

from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from tests.doors import spectrum_of
from tests.support import adjoint_reference, tip_compliance

import cartstiff
from cartstiff.vibration import frequency_response

URDF = """<robot name="boom">
  <link name="base"/>
  <link name="boom"/>
  <link name="tip"><inertial><origin xyz="0.05 0.02 -0.03"/><mass value="3.0"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0" iyz="0"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="boom"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="boom"/><child link="tip"/>
    <origin xyz="0.8 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>
"""
BEAM = {"E": 7e10, "G": 2.6e10, "length": 0.8, "area": 5e-4, "Iy": 3e-8, "Iz": 5e-8, "J": 8e-8}


def _mechanism(tmp_path, segments):
    (tmp_path / "boom.urdf").write_text(URDF)
    beam = ", ".join(f"{name}: {value}" for name, value in BEAM.items())
    path = tmp_path / f"boom{segments}.yaml"
    path.write_text(
        "kind: serial\nmodel: boom.urdf\nframe: tip\nq: {j1: 0.3, j2: 0.4}\n"
        "springs: {j1: {stiffness: 4.0e4}, j2: {stiffness: 1.0e4}}\n"
        f"flexible: {{boom: {{beam: {{{beam}, segments: {segments}}}}}}}\n"
    )
    return cartstiff.load(path)


def _by_hand():
    """Hz from the compliance of the tip: joint, clamped-free beam by the textbook, joint."""
    C = tip_compliance(BEAM)
    first = np.array([0, 0, 1.0, 0, BEAM["length"], 0])  # the first joint turns the end of the beam
    C += np.outer(first, first) / 4e4
    C[1, 1] += 1 / 1e4
    # The tip's masses about the end of the beam, turned by the second joint.
    turn = np.eye(4)
    turn[:3, :3] = [[np.cos(0.4), 0, np.sin(0.4)], [0, 1, 0], [-np.sin(0.4), 0, np.cos(0.4)]]
    c = np.array([0.05, 0.02, -0.03])
    cross = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    inertia = np.array([[0.02, 0.001, 0], [0.001, 0.03, 0], [0, 0, 0.04]])
    M = np.block([[inertia - 3 * cross @ cross, 3 * cross], [-3 * cross, 3 * np.eye(3)]])
    back = adjoint_reference(np.linalg.inv(turn))
    mu = np.sort(np.linalg.eigvals(C @ back.T @ M @ back).real)[::-1]
    return 1 / (2 * np.pi * np.sqrt(mu))


@pytest.mark.parametrize("segments", [1, 2, 3, 5])
def test_a_body_on_a_beam_without_mass_has_six_modes(tmp_path, segments):
    elastic = _mechanism(tmp_path, segments)
    expected = _by_hand()
    assert cartstiff.modes(elastic).frequencies == pytest.approx(expected, rel=1e-9)
    rest = cartstiff.equilibrium(elastic, wrench=[0, 0, 0, 0, 0, -1e-6])
    found = cartstiff.modes(rest)
    assert found.frequencies == pytest.approx(expected, rel=1e-7)
    assert found.spectrum.following.shape[1] == rest.q.size - 6
    # Static: the response at frequency zero is the compliance, massless motions with it.
    H = frequency_response(found, [0.0]).matrix[0].real
    C = rest.stiffness.compliances["B"]
    assert np.abs(H - C).max() <= 1e-9 * np.abs(C).max()


def test_an_arm_whose_links_alone_have_mass(tmp_path):
    """Segments of exact elements change nothing: one segment has two massless motions only."""
    text = (
        "kind: serial\nmodel: ur5\nframe: tool0\n"
        "q: {shoulder_lift_joint: -1.1, elbow_joint: 1.4, wrist_2_joint: 0.9}\n"
        "springs: {shoulder_pan_joint: {stiffness: 2e4}, shoulder_lift_joint: {stiffness: 2e4},\n"
        "  elbow_joint: {stiffness: 2e4}, wrist_1_joint: {stiffness: 2e4},\n"
        "  wrist_2_joint: {stiffness: 2e4}, wrist_3_joint: {stiffness: 2e4}}\n"
        "flexible: {upper_arm_link: {beam: {E: 7e10, G: 2.6e10, length: 0.425, area: 2e-3,\n"
        "  Iy: 2e-6, Iz: 2e-6, J: 4e-6, segments: %d}},\n"
        "  forearm_link: {beam: {E: 7e10, G: 2.6e10, length: 0.392, area: 1.5e-3,\n"
        "  Iy: 1e-6, Iz: 1e-6, J: 2e-6, segments: %d}}}\n"
    )
    found = []
    for n in (1, 2, 4):
        path = tmp_path / f"arm{n}.yaml"
        path.write_text(text % (n, n))
        load = {"wrench": [0, 0, 0, 0, 0, -100], "load_axes": "world"}
        rest = cartstiff.equilibrium(cartstiff.load(path), **load)
        found.append(cartstiff.modes(rest).frequencies)
    assert len({x.size for x in found}) == 1
    # Lengths of segments differ by how far the load bends the link.
    assert found[1] == pytest.approx(found[0], rel=1e-3)
    assert found[2] == pytest.approx(found[0], rel=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_static_condensation_in_fifty_digits(seed):
    """K of springs over four decades; M of a few bodies that most motions hardly move."""
    rng = np.random.default_rng(seed)
    f, bodies = 24, 4
    rates = rng.normal(size=(bodies, f)) * 10 ** rng.uniform(-1, 1, (1, f))
    masses = 10 ** rng.uniform(-3, 2, bodies)
    springs = rng.normal(size=(f, f)) + 3 * np.eye(f)
    k = 10 ** rng.uniform(4, 8, f)
    # Coordinates along which almost nothing moves: their inertia is a rounded difference.
    turn = np.linalg.svd(rates)[2].T + rng.normal(size=(f, f)) * 10 ** rng.uniform(-9, -4, f)
    K, J = turn.T @ (springs.T * k @ springs) @ turn, rates @ turn
    K, M = 0.5 * (K + K.T), J.T * masses @ J
    with mp.workdps(50):
        R = mp.matrix(np.diag(np.sqrt(masses)).tolist()) * mp.matrix(J.tolist())
        mu = mp.eigsy(R * mp.inverse(mp.matrix(K.tolist())) * R.T, eigvals_only=True)
        expected = np.array(sorted(float(1 / x) for x in mu))
    found = spectrum_of(K, 0.5 * (M + M.T), np.abs(K))
    assert found.squares == pytest.approx(expected, rel=1e-7)
    assert found.following.shape[1] == f - bodies
    X = found.vectors
    assert np.abs(X.T @ M @ X - np.eye(bodies)).max() <= 1e-9


def test_massless_motions_of_an_unsymmetric_tangent_may_be_singular():
    """det K = 0 although its symmetric part has an inverse: a load that turns with the body."""
    K = np.array([[1.0, 2.0], [0.0, 0.0]])
    found = spectrum_of(K, np.zeros((2, 2)), np.abs(K) + np.eye(2))
    assert found.squares.size == 0
    assert np.abs(K @ found.loose).max() < 1e-14
    assert found.following.shape == found.loose.shape == (2, 1)
    assert not found.coupled
    # The second row leaves the third motion no force without mass that could turn it: no modes.
    K = np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 3.0]])
    assert spectrum_of(K, np.diag([0.0, 0.0, 2.0]), np.abs(K) + np.eye(3)).coupled
    K[1, 2] = 0.0
    free = spectrum_of(K, np.diag([0.0, 0.0, 2.0]), np.abs(K) + np.eye(3))
    assert not free.coupled
    assert free.squares == pytest.approx([1.5])


def test_bending_modes_of_a_floating_bar_come_in_equal_pairs():
    """A square section bends about y as about z; six free motions take no digit of the others.

    The rotary inertia of the section is so small that the largest square is 1e9 times these.
    """
    bar = Path(cartstiff.__file__).parents[2] / "cases" / "free-beam" / "mechanism.yaml"
    squares = cartstiff.modes(cartstiff.load(bar)).squares
    assert (squares[:6] == 0.0).all()
    bending = squares[6:12]
    assert bending[::2] == pytest.approx(bending[1::2], rel=1e-11)
