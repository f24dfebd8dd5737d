"""What a stiffness matrix says does not depend on the frame it was written in."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.doors import (
    SWAP_FORM,
    Freedom,
    Others,
    asymmetry_of,
    centre_of_compliance,
    centre_of_elasticity,
    centre_of_stiffness,
    compliance_block,
    ellipsoid,
    inertia_metric,
    length_metric,
    move_compliance,
    move_stiffness,
    normal_form,
    point_of_least_coupling,
    scale_lengths,
    stiffness_block,
    twist_compliant_axes,
    wrench_compliant_axes,
)

import cartstiff
from cartstiff import UndefinedError, analyse_posture
from cartstiff.analysis import (
    best_conditioned_length,
    centres_of,
    compare_connections,
    condition_numbers,
    decoupling_frame,
    eigenscrews,
    indices_of,
    natural_length,
    stiffness_about,
    stiffness_along,
    stiffness_ellipsoid,
)
from cartstiff.extend import in_units
from cartstiff.geometry import BI_INVARIANT, CARTAN_MINUS, CARTAN_PLUS, KINEMATIC, se3

# Condition numbers of the samples stay below 1e4: sixteen digits less four, less a factor for
# the chain of operations.
CLOSE = 1e-9

seeds = st.integers(0, 2**32 - 1)


def stiffness(rng: np.random.Generator, rank: int = 6) -> np.ndarray:
    """Positive (semi)definite matrix of a body some 0.3 long, 1e4 stiff."""
    F = rng.standard_normal((6, rank)) * np.repeat([0.3, 1.0], 3)[:, None]
    ridge = 0.3 * np.diag(np.repeat([0.09, 1.0], 3)) if rank == 6 else 0.0
    return np.asarray(1e4 * (F @ F.T + ridge))


def frame(rng: np.random.Generator) -> np.ndarray:
    return se3.exp(rng.standard_normal(6) * np.repeat([1.0, 0.4], 3))


def pair(seed: int) -> tuple[np.random.Generator, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    K, T = stiffness(rng), frame(rng)
    return rng, K, T, move_stiffness(K, T)


def carry(T: np.ndarray, point: np.ndarray) -> np.ndarray:
    return np.asarray(T[:3, :3] @ point + T[:3, 3])


@given(seeds)
def test_centres_move_with_the_frame(seed: int) -> None:
    _, K, T, moved = pair(seed)
    for centre in (centre_of_stiffness, centre_of_elasticity, point_of_least_coupling):
        assert np.allclose(carry(T, centre(moved)), centre(K), atol=CLOSE)
    C, C_moved = np.linalg.inv(K), np.linalg.inv(moved)
    assert np.allclose(carry(T, centre_of_compliance(C_moved)), centre_of_compliance(C), atol=CLOSE)


@given(seeds)
def test_coupling_is_symmetric_at_its_centre(seed: int) -> None:
    _, K, _, _ = pair(seed)
    C = np.linalg.inv(K)
    at = move_stiffness(K, se3.pose(translation=centre_of_stiffness(K)))
    assert np.allclose(at[:3, 3:], at[:3, 3:].T, atol=CLOSE * 1e4)
    at = move_compliance(C, se3.pose(translation=centre_of_compliance(C)))
    assert np.allclose(at[3:, :3], at[3:, :3].T, atol=CLOSE * np.abs(C).max())
    T = se3.pose(translation=centre_of_elasticity(K))
    at, C_at = move_stiffness(K, T), move_compliance(C, T)
    G = at[:3, 3:] @ np.linalg.inv(at[3:, 3:])
    assert np.allclose(G, G.T, atol=CLOSE)
    dual = C_at[3:, :3] @ np.linalg.inv(C_at[:3, :3])
    assert np.allclose(dual, -G.T, atol=CLOSE)


@given(seeds)
def test_feet_of_compliant_axes_add_to_zero_at_the_centre_of_elasticity(seed: int) -> None:
    _, K, _, _ = pair(seed)
    at = move_stiffness(K, se3.pose(translation=centre_of_elasticity(K)))
    for axes in (wrench_compliant_axes(at), twist_compliant_axes(at)):
        assert np.allclose(sum(a.screw.point for a in axes), 0.0, atol=CLOSE)


@given(seeds)
def test_all_centres_are_the_decoupling_point_where_one_exists(seed: int) -> None:
    rng = np.random.default_rng(seed)
    K = stiffness(rng)
    K[:3, 3:] = K[3:, :3] = 0.0
    T = frame(rng)
    moved = move_stiffness(K, se3.inverse(T))
    found = centres_of(moved)
    for point in (found.stiffness, found.compliance, found.elasticity, found.least_coupling):
        assert point is not None
        assert np.allclose(point, T[:3, 3], atol=CLOSE)
    assert decoupling_frame(moved).coupling < CLOSE
    assert not found.reasons


@given(seeds)
def test_no_nearby_point_is_coupled_less(seed: int) -> None:
    rng, K, _, _ = pair(seed)
    found = decoupling_frame(K)
    least = np.linalg.norm(found.matrix[:3, 3:])
    for _ in range(5):
        T = se3.pose(translation=0.01 * rng.standard_normal(3))
        assert np.linalg.norm(move_stiffness(found.matrix, T)[:3, 3:]) > least
    assert found.coupling <= 1.0
    assert se3.is_pose(found.T_m_n)
    assert np.allclose(found.matrix[3:, 3:], np.diag(np.diag(found.matrix[3:, 3:])), atol=1e-7)


@given(seeds)
def test_normal_forms_have_diagonal_coupling_and_belong_to_the_body(seed: int) -> None:
    _, K, _, moved = pair(seed)
    form, other = normal_form(K), normal_form(moved)
    off = form.matrix[:3, 3:] - np.diag(form.coupling)
    assert np.abs(off).max() < CLOSE * 1e4
    assert np.allclose(form.matrix, move_stiffness(K, form.T_m_n), atol=1e-7)
    assert np.allclose(form.coupling, other.coupling, atol=CLOSE * 1e4)
    assert np.isclose(form.coupling.sum(), np.trace(K[:3, 3:]), atol=CLOSE * 1e4)


def test_normal_form_of_a_decoupled_stiffness_takes_the_translational_axes() -> None:
    rng = np.random.default_rng(5)
    R = frame(rng)[:3, :3]
    K = np.zeros((6, 6))
    K[:3, :3] = np.diag([1.0, 2.0, 3.0])
    K[3:, 3:] = R @ np.diag([10.0, 20.0, 30.0]) @ R.T
    form = normal_form(move_stiffness(K, se3.pose(translation=[0.1, 0.2, 0.3])))
    D = form.matrix[3:, 3:]
    assert np.allclose(D, np.diag([10.0, 20.0, 30.0]), atol=1e-10)


@given(seeds)
def test_eigenscrews_are_frame_independent(seed: int) -> None:
    _, K, T, moved = pair(seed)
    here, there = eigenscrews(K), eigenscrews(moved)
    assert here.complete
    assert there.complete
    Ad = se3.adjoint(T)
    for a, b in zip(here.screws, there.screws, strict=True):
        assert np.isclose(a.eigenvalue, b.eigenvalue, rtol=1e-8)
        assert np.isclose(a.screw.pitch, b.screw.pitch, rtol=1e-6)
        carried = Ad @ b.twist
        sign = np.sign(carried @ a.twist)
        assert np.allclose(sign * carried, a.twist, atol=1e-5)


@given(seeds)
def test_eigenscrews_answer_on_the_same_screw(seed: int) -> None:
    _, K, _, _ = pair(seed)
    found = eigenscrews(K).screws
    for e in found:
        assert np.allclose(K @ e.twist, e.eigenvalue * SWAP_FORM @ e.twist, atol=1e-6)
        assert e.eigenvalue * e.screw.pitch > 0
        assert np.isclose(e.twist @ K @ e.twist, 2.0 * e.rotational_stiffness, rtol=1e-8)
        along = e.twist[3:] - np.cross(e.screw.point, e.twist[:3])
        assert np.allclose(along, e.screw.pitch * e.twist[:3], atol=CLOSE)
    assert sum(e.eigenvalue > 0 for e in found) == 3
    assert np.isclose(sum(e.eigenvalue for e in found), 2.0 * np.trace(K[:3, 3:]), atol=1e-6)


@pytest.mark.parametrize("rank", range(1, 6))
def test_eigenscrews_of_a_singular_stiffness_solve_its_equation(rank: int) -> None:
    K = stiffness(np.random.default_rng(rank), rank)
    found = eigenscrews(K)
    assert found.definiteness == "positive semidefinite"
    assert sum(e.eigenvalue == 0.0 for e in found.screws) == 6 - rank
    for e in found.screws:
        assert np.allclose(K @ e.twist, e.eigenvalue * SWAP_FORM @ e.twist, atol=1e-6)


def test_eigenscrews_of_an_indefinite_stiffness_report_complex_pairs() -> None:
    found = eigenscrews(np.diag([1.0, -1.0, 2.0, 3.0, 4.0, -2.0]))
    assert found.definiteness == "indefinite"
    assert not found.complete
    # lambda^2 = a_i d_i: 3, -4, -4
    assert np.allclose([e.eigenvalue for e in found.screws], [-np.sqrt(3.0), np.sqrt(3.0)])
    assert np.allclose(sorted(z.imag for z in found.complex_eigenvalues), [-2.0, -2.0, 2.0, 2.0])


@given(seeds)
def test_negative_definite_stiffness_has_the_opposite_eigenvalues(seed: int) -> None:
    _, K, _, _ = pair(seed)
    plus = [e.eigenvalue for e in eigenscrews(K).screws]
    minus = [e.eigenvalue for e in eigenscrews(-K).screws]
    assert np.allclose(np.negative(plus)[::-1], minus)


@given(seeds)
def test_compliant_axes_are_frame_independent_and_rebuild_the_matrix(seed: int) -> None:
    _, K, _, moved = pair(seed)
    axes = (*wrench_compliant_axes(K), *twist_compliant_axes(K))
    others = (*wrench_compliant_axes(moved), *twist_compliant_axes(moved))
    rotations = np.repeat([1.0, 0.0], 3)  # of a twist-compliant axis its direction alone
    shares = [a.components * (rotations if a.kind == "twist" else 1.0) for a in axes]
    rebuilt = sum(a.stiffness * np.outer(w, w) for a, w in zip(axes, shares, strict=True))
    assert np.allclose(rebuilt, K, atol=CLOSE * 1e4)
    for a, b in zip(axes, others, strict=True):
        assert np.isclose(a.stiffness, b.stiffness, rtol=1e-8)
        assert np.isclose(a.screw.pitch, b.screw.pitch, atol=1e-6)


@given(seeds)
def test_compliant_axes_do_what_their_name_says(seed: int) -> None:
    _, K, _, _ = pair(seed)
    for a in wrench_compliant_axes(K):
        wrench = K @ np.concatenate([np.zeros(3), a.screw.direction])
        assert np.allclose(wrench, a.stiffness * a.components, atol=1e-7)
    for a in twist_compliant_axes(K):
        moment = np.concatenate([a.stiffness * a.screw.direction, np.zeros(3)])
        assert np.allclose(K @ a.components, moment, atol=1e-7)


@given(seeds)
def test_ellipsoid_of_a_rotated_matrix_rotates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    M = rng.standard_normal((3, 3))
    M = M + M.T
    R = frame(rng)[:3, :3]
    here, there = ellipsoid(M), ellipsoid(R.T @ M @ R)
    assert np.allclose(here.eigenvalues, there.eigenvalues)
    assert np.array_equal(here.radii, np.abs(here.eigenvalues))
    assert np.allclose(R @ there.matrix @ R.T, here.matrix)
    assert np.allclose(here.matrix, M)
    for e in (here, there):
        assert np.isclose(np.linalg.det(e.axes), 1.0)
    for i in range(3):
        assert np.isclose(abs(here.axes[:, i] @ R @ there.axes[:, i]), 1.0, atol=1e-5)


@given(seeds)
def test_held_translation_and_free_rotation_are_the_same_at_every_point(seed: int) -> None:
    rng, K, _, _ = pair(seed)
    T = se3.pose(translation=rng.standard_normal(3))
    for here, there in (
        (stiffness_block(K, "translation", "held"), stiffness_block(K, "translation", "held", T)),
        (stiffness_block(K, "rotation", "free"), stiffness_block(K, "rotation", "free", T)),
    ):
        assert np.allclose(here, there, rtol=1e-7, atol=1e-6)


@given(seeds)
def test_free_is_never_stiffer_than_held(seed: int) -> None:
    _, K, T, _ = pair(seed)
    for freedom in get_args(Freedom):
        held = stiffness_block(K, freedom, "held", T)
        free = stiffness_block(K, freedom, "free", T)
        assert np.linalg.eigvalsh(held - free)[0] > -1e-7


@given(seeds)
def test_stiffness_and_compliance_blocks_are_inverse(seed: int) -> None:
    _, K, T, _ = pair(seed)
    C = np.linalg.inv(K)
    for freedom in get_args(Freedom):
        for others in get_args(Others):
            S = stiffness_block(K, freedom, others, T)
            assert np.allclose(S @ compliance_block(C, freedom, others, T), np.eye(3), atol=1e-8)


@given(seeds)
def test_directional_stiffness_is_what_a_force_feels(seed: int) -> None:
    rng, K, T, moved = pair(seed)
    C = np.linalg.inv(K)
    u, p = rng.standard_normal(3), rng.standard_normal(3)
    u /= np.linalg.norm(u)
    line, moment = np.concatenate([np.cross(p, u), u]), np.concatenate([u, np.zeros(3)])
    hinge = np.concatenate([u, np.cross(p, u)])
    expected = {
        "along free": 1.0 / (line @ C @ line),
        "along held": u @ K[3:, 3:] @ u,
        "about free": 1.0 / (moment @ C @ moment),
        "about held": hinge @ K @ hinge,
    }
    found = {
        "along free": stiffness_along(K, u, p, "free"),
        "along held": stiffness_along(K, 7.0 * u, p, "held"),
        "about free": stiffness_about(K, u, p, "free"),
        "about held": stiffness_about(K, u, p, "held"),
    }
    for key, value in expected.items():
        assert np.isclose(found[key], value, rtol=1e-8), key
    u_n, p_n = T[:3, :3].T @ u, T[:3, :3].T @ (p - T[:3, 3])
    assert np.isclose(stiffness_along(moved, u_n, p_n, "free"), expected["along free"], rtol=1e-7)


@given(seeds)
def test_natural_length_and_determinant_are_frame_independent(seed: int) -> None:
    _, K, _, moved = pair(seed)
    assert np.isclose(natural_length(K), natural_length(moved), rtol=1e-8)
    a, b = indices_of(K, 0.2), indices_of(moved, 0.5)
    assert np.isclose(a.determinant, b.determinant, rtol=1e-7)
    assert a.definiteness == b.definiteness == "positive"


@given(seeds)
def test_natural_length_scales_with_the_unit_of_length(seed: int) -> None:
    _, K, _, _ = pair(seed)
    d = np.repeat([100.0, 1.0], 3)  # N m/rad to N cm/rad; N/m to N/cm is 1/100, a common factor
    assert np.isclose(natural_length(K * np.outer(d, d)), 100.0 * natural_length(K))


@given(seeds)
def test_condition_exponent_is_its_derivative(seed: int) -> None:
    _, K, _, _ = pair(seed)
    step = 1e-5
    low, high = condition_numbers(K, [0.3 * np.exp(-step), 0.3 * np.exp(step)])
    slope = (np.log(high) - np.log(low)) / (2 * step)
    assert np.isclose(indices_of(K, 0.3).condition_exponent, slope, atol=1e-4)


@given(seeds)
def test_no_length_conditions_better_than_the_best(seed: int) -> None:
    _, K, _, _ = pair(seed)
    length, condition = best_conditioned_length(K)
    others = condition_numbers(K, length * np.geomspace(0.01, 100.0, 41))
    assert np.all(others >= condition * (1.0 - 1e-9))
    assert np.isclose(condition_numbers(K, [length])[0], condition)


@given(seeds)
def test_minimum_stiffness_belongs_to_its_twist(seed: int) -> None:
    _, K, _, _ = pair(seed)
    n = indices_of(K, 0.25)
    t = n.minimum_twist
    assert np.isclose(t @ length_metric(0.25) @ t, 1.0)
    assert np.isclose(t @ K @ t, n.minimum_stiffness)
    assert np.allclose(n.eigenvalues, np.linalg.eigvalsh(scale_lengths(K, 0.25)))


@given(seeds)
def test_inertia_metric_is_the_kinetic_energy_of_a_cloud_of_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    masses, points = rng.uniform(0.1, 1.0, 7), rng.standard_normal((7, 3))
    centre = masses @ points / masses.sum()
    arms = points - centre
    inertia = sum(
        m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(masses, arms, strict=True)
    )
    twist = rng.standard_normal(6)
    velocities = twist[3:] + np.cross(twist[:3], points)
    energy = masses @ np.sum(velocities**2, axis=1)
    M = inertia_metric(masses.sum(), inertia, centre)
    assert np.isclose(twist @ M @ twist, energy)


def loaded(seed: int) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(seed)
    K_B, W = stiffness(rng), rng.standard_normal(6) * np.repeat([10.0, 30.0], 3)
    K_A = K_B - 0.5 * se3.bracket_form(W)
    named = (CARTAN_MINUS, BI_INVARIANT, KINEMATIC, CARTAN_PLUS)
    return K_B, W, {c.name: K_A - c.wrench_term(W) for c in named}


@given(seeds)
def test_asymmetry_is_that_of_the_wrench(seed: int) -> None:
    _, W, matrices = loaded(seed)
    found = asymmetry_of(matrices["A"], W)
    assert found.agrees
    assert not asymmetry_of(matrices["A"], 1.1 * W).agrees
    assert not asymmetry_of(matrices["+"], W).agrees
    assert asymmetry_of(matrices["B"], W).size < 1e-12


@given(seeds)
def test_relative_change_is_the_same_in_every_frame_and_for_every_length(seed: int) -> None:
    _, _, matrices = loaded(seed)
    T = frame(np.random.default_rng(seed + 1))
    tensors = {name: matrices[name] for name in ("A", "B", "+")}
    here = compare_connections(tensors, length=0.1)
    there = compare_connections({n: move_stiffness(K, T) for n, K in tensors.items()}, length=2.0)
    assert here.measure == "energy"
    for a, b in zip(here.rows, there.rows, strict=True):
        assert a.change is not None
        assert b.change is not None
        assert np.isclose(a.change, b.change, rtol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_relative_change_of_springs_far_apart_is_measured_by_energy(seed: int) -> None:
    """K alone knows its soft directions to 1e-3 only: whether it is positive, its inverse says."""
    rng = np.random.default_rng(seed)
    U = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    values = np.array([1e-2, 1.0, 2.0, 3.0, 4.0, 1e12])
    K, C = (U * values) @ U.T, (U / values) @ U.T
    soft, d = U[:, :5], np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    within = (soft.T @ d @ soft) / np.sqrt(np.outer(values[:5], values[:5]))
    for length in (0.1, 1.0):
        table = compare_connections({"B": K, "A": K + d}, length=length, compliance=C)
        assert table.measure == "energy"
        assert table.rows[0].change == pytest.approx(np.linalg.norm(within, 2), rel=1e-4)


@given(seeds)
def test_differences_sit_in_the_blocks_that_the_wrench_names(seed: int) -> None:
    _, W, matrices = loaded(seed)
    rows = {row.name: row.largest for row in compare_connections(matrices).rows}
    moment, force = np.abs(W[:3]).max(), np.abs(W[3:]).max()
    for name in ("A", "+"):
        assert rows[name] == pytest.approx(
            {"rr": moment / 2, "rt": force / 2, "tr": force / 2, "tt": 0.0}, abs=1e-9
        )
    assert rows["K"] == pytest.approx(
        {"rr": 0.0, "rt": force / 2, "tr": force / 2, "tt": 0.0}, abs=1e-9
    )


def test_without_load_the_choice_of_connection_does_not_matter() -> None:
    K = stiffness(np.random.default_rng(0))
    table = compare_connections({"A": K, "B": K, "K": K.copy(), "F": None})
    assert not table.matters
    assert "does not matter" in table.verdict
    assert "below 1 %" in table.verdict
    assert [row.matters for row in table.rows] == [False, False, None]


def test_the_threshold_decides_the_verdict() -> None:
    _, _, matrices = loaded(3)
    worst = max(row.change or 0.0 for row in compare_connections(matrices).rows)
    assert compare_connections(matrices, threshold=0.99 * worst).matters
    assert not compare_connections(matrices, threshold=1.01 * worst).matters


def test_ellipsoids_name_their_definiteness() -> None:
    cases = {
        "positive": (1, 2, 3),
        "positive semidefinite": (0, 2, 3),
        "indefinite": (-1, 0, 3),
        "negative semidefinite": (-1, 0, -3),
        "negative": (-1, -2, -3),
        "zero": (0, 0, 0),
    }
    for word, values in cases.items():
        found = ellipsoid(np.diag(np.array(values, float)))
        assert found.definiteness == word
        assert np.allclose(found.eigenvalues, sorted(values))
    K = np.diag([1.0, 1.0, 1.0, -1.0, 2.0, 3.0])
    assert stiffness_ellipsoid(K, "translation", "free").definiteness == "indefinite"
    assert ellipsoid([[1, 1, 0], [0, 1, 0], [0, 0, 1]]).asymmetry == 0.5


@pytest.mark.parametrize("name", ["orthoglide", "tricept", "3-rps", "4-rrr", "6-rus", "grasp"])
def test_no_answer_on_closed_chains_hangs_on_the_unit_of_length(name: str) -> None:
    """Ranks, rotations that are forbidden, principal values: in metres as in micrometres."""
    machine = cartstiff.load(name)
    found = []
    for length, factor in (("m", 1.0), ("um", 1e6)):
        result = cartstiff.analyse(in_units(machine, length))
        units = {"translation": factor, "rotation": 1 / factor}
        shapes = {
            (a, b): e
            for a, both in analyse_posture(result)["ellipsoids"]["compliance"].items()
            for b, e in both.items()
            if e is not None
        }
        values = [np.array(e["eigenvalues"]) / units[a] for (a, _), e in shapes.items()]
        signs = {key: e["definiteness"] for key, e in shapes.items()}
        closures = result.reduction.closures
        found.append((values, signs, closures, [note.code for note in result.notes]))
    (values, signs, closures, codes), other = found
    assert (signs, codes) == (other[1], other[3])
    for ours, theirs in zip(values, other[0], strict=True):
        assert theirs == pytest.approx(ours, rel=1e-9, abs=1e-9 * np.abs(ours).max())
    assert other[2] == pytest.approx(closures, rel=1e-9, abs=1e-12 * closures.max())


def test_a_motion_that_no_spring_holds_leaves_no_noise():
    """K_tt has a null vector but K has an inverse: zero, no centre of elasticity, no far point."""
    rng = np.random.default_rng(3)
    u = rng.normal(size=3) / np.linalg.norm(rng.normal(size=3))
    across = np.eye(3) - np.outer(u, u) / (u @ u)
    coupling = rng.normal(size=(3, 3))
    K = np.block(
        [
            [np.diag([50.0, 60.0, 70.0]), 100.0 * coupling],
            [100.0 * coupling.T, across @ np.diag([4e4, 3e3, 5e3]) @ across],
        ]
    )
    K = 0.5 * (K + K.T)
    C = np.linalg.inv(K)
    for known in (C, None):
        assert wrench_compliant_axes(K, known)[0].stiffness == 0.0
        found = centres_of(K, known)
        assert found.elasticity is None
        assert found.reasons["elasticity"].code == "no-centre-of-elasticity"
        with pytest.raises(UndefinedError, match="translational stiffness is singular"):
            twist_compliant_axes(K, known)
