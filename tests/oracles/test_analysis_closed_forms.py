"""The analysis against cases that can be worked out by hand."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pytest
from tests.doors import (
    PostureMatrices,
    Reading,
    Uncertain,
    Units,
    characteristic_length,
    compliance_deflection,
    isotropy,
    joint_shares,
    length_from_inertia,
    plain,
    product_of_exponentials,
    screw_of_twist,
    screw_of_wrench,
    shares_of,
    stiffness_block,
    summarise,
    twist_compliant_axes,
    wrench_compliant_axes,
)
from tests.support.printed import text_of

from cartstiff.analysis import (
    best_conditioned_length,
    cartesian_stiffness,
    centres_of,
    eigenscrews,
    indices_of,
    natural_length,
    stiffness_ellipsoid,
)
from cartstiff.geometry import se3

EXACT = 1e-12  # a handful of operations in double precision


# -- the cubic platform: six legs along the cube's edges that join its two rings of vertices -----


def cubic_platform(edge: float, k: float, offset: float) -> np.ndarray:
    """Stiffness in a frame on the cube's diagonal (z), the cube's centre at z = offset."""
    z = np.ones(3) / np.sqrt(3.0)
    x = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    axes = np.array([x, np.cross(z, x), z])
    corners = [np.array(c, float) for c in itertools.product((0, 1), repeat=3)]
    springs = []
    for low, high in itertools.product(corners, corners):
        if low.sum() == 1 and high.sum() == 2 and np.isclose(np.linalg.norm(high - low), 1.0):
            point = axes @ (edge * (high - 0.5)) + [0.0, 0.0, offset]
            along = axes @ (high - low)
            springs.append(np.concatenate([np.cross(point, along), along]))
    assert len(springs) == 6
    return k * np.array(springs).T @ np.array(springs)


@pytest.mark.parametrize(("edge", "k", "d"), [(1.0, 1.0, 0.0), (0.3, 2e5, 0.1), (0.7, 30.0, -0.4)])
def test_cubic_platform(edge: float, k: float, d: float) -> None:
    H = edge / np.sqrt(3.0)
    K = cubic_platform(edge, k, d)
    size = np.abs(K).max()
    across = 1.5 * k * H**2 + 2.0 * k * d**2
    assert np.allclose(K[3:, 3:], 2.0 * k * np.eye(3), atol=EXACT * size)
    assert np.allclose(K[:3, :3], np.diag([across, across, 6.0 * k * H**2]), atol=EXACT * size)
    coupling = 2.0 * k * d * se3.skew([0.0, 0.0, 1.0])
    assert np.allclose(K[:3, 3:], coupling, atol=EXACT * size)
    found = centres_of(K)
    for point in (found.stiffness, found.compliance, found.elasticity, found.least_coupling):
        assert point is not None
        assert np.allclose(point, [0.0, 0.0, d], atol=1e-12)
    e = stiffness_ellipsoid(K, "translation", "held")
    assert np.allclose(e.eigenvalues, 2.0 * k)
    free = stiffness_block(K, "rotation", "free")
    expected = k * H**2 * np.diag([1.5, 1.5, 6.0])
    assert np.allclose(free, expected, atol=1e-10 * size)
    # (1.5 * 1.5 * 6 / 8)^(1/6) H
    assert np.isclose(natural_length(K), H * (13.5 / 8.0) ** (1 / 6))
    pitches = sorted(s.screw.pitch for s in eigenscrews(K).screws)
    root, long = np.sqrt(0.75) * H, np.sqrt(3.0) * H
    assert np.allclose(pitches, [-long, -root, -root, root, root, long])


# -- springs that can be added up on paper ---------------------------------------------------------


def test_one_line_spring() -> None:
    u, p, k = np.array([0.0, 0.6, 0.8]), np.array([0.3, -0.2, 0.5]), 70.0
    g = np.concatenate([np.cross(p, u), u])
    K = k * np.outer(g, g)
    missing = centres_of(K)
    assert missing.stiffness is None
    assert missing.reasons["stiffness"].code == "no-centre-of-stiffness"
    assert missing.reasons["compliance"].code == "singular"


def test_decoupled_stiffness_has_square_root_pitches() -> None:
    a, b = np.array([1.0, 2.0, 3.0]), np.array([40.0, 50.0, 60.0])
    K = np.diag(np.concatenate([a, b]))
    found = eigenscrews(K).screws
    assert np.allclose([e.eigenvalue for e in found], np.sort([*-np.sqrt(a * b), *np.sqrt(a * b)]))
    for e in found:
        i = int(np.argmax(np.abs(e.screw.direction)))
        assert np.isclose(abs(e.screw.pitch), np.sqrt(a[i] / b[i]))
        assert np.isclose(e.rotational_stiffness, a[i])
        assert np.isclose(e.translational_stiffness, b[i])
    assert np.isclose(natural_length(K), (6.0 / 120000.0) ** (1 / 6))
    assert [x.stiffness for x in wrench_compliant_axes(K)] == pytest.approx(list(b))
    assert [x.stiffness for x in twist_compliant_axes(K)] == pytest.approx(list(a))


def test_screws_of_simple_twists_and_wrenches() -> None:
    # Rotation about z through (1, 2, 0), rising by 0.5 per radian; the same line as a wrench.
    u, p = np.array([0.0, 0.0, 1.0]), np.array([1.0, 2.0, 0.0])
    lever = np.cross(p, u) + 0.5 * u
    for screw in (
        screw_of_twist(np.concatenate([u, lever])),
        screw_of_wrench(np.concatenate([-3.0 * lever, -3.0 * u])),
    ):
        assert np.allclose(screw.direction, u)
        assert np.allclose(screw.point, p)
        assert np.isclose(screw.pitch, 0.5)
    sliding = screw_of_twist([0, 0, 0, 0, -2.0, 0])
    assert sliding.pitch == float("inf")
    assert np.allclose(sliding.direction, [0, 1, 0])
    assert np.isnan(screw_of_twist(np.zeros(6)).pitch)
    # A pitch that is rounding of the turn about an axis elsewhere is none.
    assert screw_of_twist([3.0, 0.1, 0.2, 1e-17, 0.2, -0.1], 0.5).pitch == 0.0


def test_indices_of_a_diagonal_matrix() -> None:
    K = np.diag([1.0, 2.0, 4.0, 100.0, 200.0, 400.0])
    n = indices_of(K, 0.1)  # rotation becomes 100, 200, 400
    assert np.allclose(n.eigenvalues, [100, 100, 200, 200, 400, 400])
    assert np.isclose(n.condition_number, 4.0)
    assert np.isclose(n.determinant, 8.0 * 8e6)
    assert np.isclose(n.isotropy, 200.0 / (1400.0 / 6.0))
    assert np.isclose(n.translational_condition, 4.0)
    assert np.isclose(n.rotational_condition, 4.0)
    assert np.isclose(indices_of(K, 0.2).condition_number, 16.0)
    # Smallest is rotational (exponent -2 of its own), largest translational: 2.
    assert np.isclose(indices_of(K, 0.2).condition_exponent, 2.0)
    assert best_conditioned_length(K) == pytest.approx((0.1, 4.0), rel=1e-6)
    singular = indices_of(np.diag([0.0, 2.0, 4.0, 100.0, 200.0, 400.0]), 0.1)
    assert singular.condition_number == float("inf")
    assert singular.isotropy == 0.0
    assert np.isnan(singular.condition_exponent)
    indefinite = indices_of(np.diag([-1.0, 2.0, 4.0, 100.0, 200.0, 400.0]), 0.1)
    assert indefinite.minimum_stiffness == pytest.approx(-100.0)
    assert indefinite.definiteness == "indefinite"
    assert np.isnan(indefinite.isotropy)
    assert isotropy(3.0 * np.eye(4)) == pytest.approx(1.0)


def test_lengths() -> None:
    ball = 0.4 * 5.0 * 0.3**2 * np.eye(3)  # m = 5, r = 0.3: I = 2/5 m r^2
    assert np.isclose(length_from_inertia(5.0, ball), np.sqrt(0.4) * 0.3)
    K = np.diag([4.0, 4.0, 4.0, 100.0, 100.0, 100.0])
    assert characteristic_length(K).origin == "natural"
    assert np.isclose(characteristic_length(K).value, 0.2)
    assert characteristic_length(K, given=3.0).origin == "given"
    assert characteristic_length(K, mass=5.0, inertia=ball).origin == "inertia"
    unit = characteristic_length(np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]))
    assert (unit.origin, unit.value) == ("unit", 1.0)
    assert "none is natural" in unit.reason


# -- a chain whose second derivatives are known from its chart -------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_congruence_is_the_symmetric_part_of_the_tangent_stiffness(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chain = product_of_exponentials(rng.standard_normal((6, 6)), "random 6R")
    q, springs, torque = rng.standard_normal(6), rng.uniform(10, 20, 6), rng.standard_normal(6)
    W, first, second = chain.stiffness_terms(q, torque, np.diag(springs))
    K_A = first + second
    K_B = cartesian_stiffness(chain.basis(q), springs, W)
    assert np.allclose(K_B, 0.5 * (K_A + K_A.T), rtol=1e-9, atol=1e-9 * np.abs(K_A).max())


def test_planar_two_link_arm_under_a_tip_force() -> None:
    # Links 0.5 and 0.4 along x, springs 100 and 80: a force along y bends both joints.
    J = np.zeros((6, 2))
    J[2], J[4] = 1.0, [0.9, 0.4]
    found = joint_shares(J, np.diag([100.0, 80.0]), [0, 0, 0, 0, 2.0, 0])
    assert np.allclose(found.motion, [2.0 * 0.9 / 100.0, 2.0 * 0.4 / 80.0])
    tip = 2.0 * (0.81 / 100.0 + 0.16 / 80.0)
    assert np.allclose(found.deflection.displacement, [0.0, tip, 0.0])
    assert np.allclose(found.share, [0.81 / 100.0 / (tip / 2.0), 0.16 / 80.0 / (tip / 2.0)])
    elbow = joint_shares(J, np.diag([100.0, 80.0]), [0, 0, 0, 0, 2.0, 0], [-0.4, 0, 0])
    assert np.allclose(elbow.deflection.displacement, [0.0, 0.5 * 0.018, 0.0])


def test_deflection_of_a_point() -> None:
    K = np.diag([10.0, 10.0, 10.0, 1000.0, 1000.0, 1000.0])
    found = compliance_deflection(np.linalg.inv(K), [0, 0, 2.0, 5.0, 0, 0], [0.1, 0.0, 0.0])
    assert np.allclose(found.displacement, [0.005, 0.02, 0.0])
    assert np.isclose(found.energy, 0.5 * (2.0 * 0.2 + 5.0 * 0.005))


# -- uncertainty -----------------------------------------------------------------------------------


def test_first_order_of_a_product() -> None:
    """x y at (3, 4), and x: each number's part of the variance."""
    numbers = Uncertain(("x", "y", "z"), np.array([0.1, 0.2, 0.0]), np.eye(3), np.inf)
    slopes = np.array([[4.0, 1.0], [3.0, 0.0], [1.0, 1.0]])
    deviations, shares = shares_of(numbers.variances(slopes))
    assert np.allclose(deviations, [np.hypot(0.4, 0.6), 0.1], rtol=1e-14)
    assert np.allclose(shares, [[0.16 / 0.52, 1.0], [0.36 / 0.52, 0.0], [0.0, 0.0]])
    assert np.isclose(numbers.factor(0.95), 1.959963985)


# -- the summary -----------------------------------------------------------------------------------


def loaded_cube() -> tuple[dict[str, Any], np.ndarray]:
    K, W = cubic_platform(0.3, 2e5, 0.1), np.array([1.0, 2.0, 3.0, 400.0, 500.0, 600.0])
    return {"A": K - 0.5 * se3.bracket_form(W), "B": K, "F": None}, W


def test_summary_holds_the_cube_in_plain_values() -> None:
    matrices, W = loaded_cube()
    s = summarise(PostureMatrices(matrices, W))
    assert json.loads(json.dumps(s, allow_nan=False)) == s
    assert s["connection"] == "B"
    assert not s["symmetrised"]
    assert s["centres"]["elasticity"] == pytest.approx([0.0, 0.0, 0.1], abs=1e-12)
    held = s["ellipsoids"]["stiffness"]["translation"]["held"]
    assert held["eigenvalues"] == pytest.approx([4e5] * 3)
    assert s["length"]["origin"] == "natural"
    assert s["asymmetry"]["agrees"]
    assert s["notes"] == []
    moved = summarise(
        PostureMatrices(matrices, W), Reading(T_m_n=se3.pose(translation=[0.0, 0.0, 0.1]))
    )
    assert moved["centres"]["elasticity"] == pytest.approx([0.0] * 3, abs=1e-12)
    assert moved["connections"]["rows"][0]["largest"] == s["connections"]["rows"][0]["largest"]


def test_summary_of_an_asymmetric_matrix_says_so() -> None:
    matrices, W = loaded_cube()
    s = summarise(PostureMatrices(matrices, W, "A"), Reading(0.25))
    assert s["symmetrised"]
    assert s["length"] == {"value": 0.25, "origin": "given", "reason": "given by the user"}
    assert s["eigenscrews"]["complete"]
    assert "the symmetric part of K^A" in text_of(s)


def test_text_has_units() -> None:
    matrices, W = loaded_cube()
    s = summarise(PostureMatrices(matrices, W))
    text = text_of(s)
    for words in ("[N m/rad]", "[N/mm]", "Eigenscrews", "asymmetry of K^A"):
        assert words in text
    assert s["connections"]["verdict"] in text
    centimetres = text_of(s, Units(length="cm"))
    assert "[N cm/rad]" in centimetres
    assert "N/m]" not in centimetres


def test_summary_without_stiffness_uses_the_compliance() -> None:
    C = np.zeros((6, 6))
    C[2, 2], C[4, 4] = 0.1, 0.2
    s = summarise(PostureMatrices({"B": None, "F": None}, np.zeros(6), compliance=C))
    assert s["connection"] is None
    assert s["indices"] is None
    free = s["ellipsoids"]["compliance"]["translation"]["free"]
    assert free["eigenvalues"] == pytest.approx([0.0, 0.0, 0.2])
    assert [n["code"] for n in s["notes"]] == ["no-stiffness"]
    assert "Principal compliance" in text_of(s)
    # A rotation about z moves a point on x along y as well.
    moved = summarise(
        PostureMatrices({"B": None}, np.zeros(6), compliance=C),
        Reading(T_m_n=se3.pose(translation=[3.0, 0.0, 0.0])),
    )
    free = moved["ellipsoids"]["compliance"]["translation"]["free"]
    assert free["eigenvalues"] == pytest.approx([0.0, 0.0, 0.2 + 9.0 * 0.1])


@pytest.mark.parametrize("values", [(1, 0, 0, 0, 0, 1), (1, -1, 2, 3, 4, -2), (0,) * 6])
def test_summary_of_singular_and_indefinite_matrices_gives_reasons(values: tuple[int, ...]) -> None:
    s = summarise(PostureMatrices({"B": np.diag(np.array(values, float))}, np.zeros(6)))
    json.dumps(s, allow_nan=False)
    assert s["definiteness"] != "positive"
    codes = {note["code"] for note in s["notes"]}
    assert codes & {"no-centre-of-compliance", "no-centre-of-stiffness"}
    text = text_of(s)
    assert "Does not exist here" in text
    assert "nan" not in text.replace("determinant", "").split()


def test_plain_values() -> None:
    got = plain({"a": np.array([1.0, np.inf]), "b": (np.int64(3), np.bool_(True), None, "x")})
    assert got == {"a": [1.0, None], "b": [3, True, None, "x"]}
