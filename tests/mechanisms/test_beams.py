"""Beams that feel their own axial force, against textbooks, mpmath and shooting."""

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from tests.doors import Section, evaluate_together, stability_functions
from tests.mechanisms.bars import EI, SECTION, bar, load_bar
from tests.mechanisms.machines import codes
from tests.support import absolute_error, cross_matrix, relative_error

from cartstiff import (
    ConvergenceError,
    DeadForce,
    DeadWrench,
    FollowerWrench,
    InputError,
    analyse,
    equilibrium,
    load,
    load_curve,
)
from cartstiff.extend import Beam, taylor_check

# Linear algebra of condition 1e6, and sums of the same compliances.
SUM = 1e-10
# Critical loads of a bar whose axial stiffness is finite: off by P / EA and a little more.
COMPRESSED = 1e-5
# Eighth-order differences of equilibria that are solved to 1e-13.
DIFFERENCES = 1e-7


class Coordinates:
    """The part of a posture that a beam asks for."""

    def __init__(self, q):
        self.q = np.asarray(q, float)


# -- the segment ---------------------------------------------------------------------------


@pytest.mark.parametrize("x", [-39.0, -10.0, -4.01, -3.99, -1e-7, 1e-9, 3.99, 4.01, 50.0, 1e8])
def test_stability_functions(x):
    def z(x):
        m = mp.sqrt(mp.mpf(x)) / 2
        return ((m * mp.coth(m) - 1) / x).real

    with mp.workdps(50):
        expected = [mp.diff(z, mp.mpf(x), k) for k in range(3)]
        for got, value in zip(stability_functions(np.array([x])), expected, strict=True):
            assert abs(got[0] / value - 1) <= 3e-13  # next to the change of formula; else 1e-15


SECTIONS = [
    Section(7e7, 500.0, (300.0, 300.0)),
    Section(7e7, 500.0, (300.0, 200.0)),
    Section(7e4, 500.0, (300.0, 900.0), (2e3, 3e3)),
]


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize("size", [1e-3, 0.1, 0.5])
def test_derivatives_are_those_of_the_energy(section, size):
    rng = np.random.default_rng(3)
    beam = Beam(np.arange(12), 0.5, section)
    q = rng.normal(size=12) * size
    q[2::6] *= 1e-3
    got = beam.evaluate(Coordinates(q))
    assert relative_error(got.hessian.T, got.hessian) <= 1e-14
    for _ in range(3):
        d = rng.normal(size=12)
        d[2::6] *= 1e-2
        check = taylor_check(
            lambda o: beam.evaluate(Coordinates(q + o)).energy, got.gradient, got.hessian, 0.1 * d
        )
        assert check.ok, check


@pytest.mark.parametrize("strain", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("shear", [np.inf, 2.0e7])
def test_small_strains_keep_their_digits(strain, shear):
    """Of a section that yields to shear the force was wrong by 1e-7 at a strain of 1e-9."""
    beam = Beam(np.arange(6), 0.4, Section(1.4e8, 1e5, (1.4e5, 0.7e5), (shear, shear)))
    x = np.zeros((1, 6))
    x[0, 2] = 0.4 * strain
    assert beam.segments(x)[1][0, 2] == pytest.approx(1.4e8 * strain, rel=1e-14)


@pytest.mark.parametrize("section", SECTIONS)
def test_either_end_may_be_the_near_one(section):
    """Seen from its far end a segment has the same energy: coordinates backwards, z turned."""
    beam = Beam(np.arange(6), 0.5, section)
    b, g, u, t, g2, b2 = q = np.array([0.2, -0.1, 1e-3, 0.15, 0.3, -0.25])
    other = np.array([b2, -g2, u, t, -g, b])
    energies = [beam.evaluate(Coordinates(x)).energy for x in (q, other)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-13)


def test_compressed_beyond_its_buckling_load_a_segment_keeps_its_force():
    beam = Beam(np.arange(6), 0.5, SECTIONS[0])
    clamped = 4 * np.pi**2 * 300.0 / 0.25
    shortenings = np.array([0.5, 2.0, 20.0]) * clamped * 0.5 / 7e7
    forces = [beam.evaluate(Coordinates([0, 0, -u, 0, 0, 0])).gradient[2] for u in shortenings]
    assert forces == pytest.approx([-0.5 * clamped, -0.999 * clamped, -0.999 * clamped])


@pytest.mark.parametrize("i", [0, 1, 4, 5])
def test_a_segment_bent_by_half_a_turn_has_no_energy(i):
    beam = Beam(np.arange(6), 0.5, SECTIONS[0])
    assert np.isnan(beam.evaluate(Coordinates(np.pi * np.eye(6)[i])).energy)


# -- small deflections ---------------------------------------------------------------------


@pytest.mark.parametrize("segments", [None, 1, 4])
@pytest.mark.parametrize("shear", [{}, {"shear_area_y": 2e-6, "shear_area_z": 3e-6}])
def test_unloaded_a_beam_is_the_sum_of_its_slices(tmp_path, segments, shear):
    """Compliance of the tip: each slice gives under the tip's wrench moved to it."""
    s = SECTION
    nodes, weights = np.polynomial.legendre.leggauss(3)  # exact: the integrand is quadratic
    give = [1 / (s["G"] * s["J"]), 1 / (s["E"] * s["Iy"]), 1 / (s["E"] * s["Iz"])]
    slide = [1 / (s["G"] * area) for area in shear.values()] or [0.0, 0.0]
    slices = np.diag([*give, 1 / (s["E"] * s["area"]), *slide])
    C = np.zeros((6, 6))
    for x, w in zip(0.5 * (nodes + 1), 0.5 * weights, strict=True):
        carry = np.eye(6)
        carry[:3, 3:] = cross_matrix([1 - x, 0, 0])
        C += w * carry.T @ slices @ carry
    result = analyse(bar(tmp_path, segments, **shear))
    for name in "ABK":
        assert relative_error(result.compliances[name], C) <= SUM
    assert codes(result) == []


def _tangent_root():
    return brentq(lambda k: np.tan(k) - k, 4.4, 4.6, xtol=1e-15)


#: Hinges, what is held at the tip, and k l at the critical load P = k^2 EI.
ENDS = {
    "free": ((), None, np.pi / 2),
    "hinged": (("foot",), {"y": 0.0, "z": 0.0}, np.pi),
    "clamped and hinged": ((), {"y": 0.0, "z": 0.0}, _tangent_root()),
    "clamped": ((), {"y": 0.0, "z": 0.0, "ry": 0.0, "rz": 0.0}, 2 * np.pi),
}


@pytest.mark.parametrize("segments", [1, 2, 4])
@pytest.mark.parametrize("ends", ENDS)
def test_euler_columns(tmp_path, ends, segments):
    hinged, held, kl = ENDS[ends]
    if ends == "clamped" and segments == 1:
        pytest.skip("cannot be shown by one segment; see below")
    elastic = bar(tmp_path, segments, hinged=hinged, Iz=5e-9)
    euler = kl**2 * EI
    curve = load_curve(elastic, DeadForce([-euler, 0, 0]), to=1.2, held=held)
    assert [c.kind for c in curve.critical] == ["bifurcation"]
    assert curve.critical[0].factor == pytest.approx(1.0, abs=COMPRESSED)


def test_one_segment_between_clamps_says_that_it_cannot_show_its_buckling(tmp_path):
    _, held, kl = ENDS["clamped"]
    curve = load_curve(bar(tmp_path, 1), DeadForce([-(kl**2) * EI, 0, 0]), to=0.9, held=held)
    assert curve.critical == ()
    assert [n.code for n in curve.notes] == ["beam-compressed"]
    assert curve.notes[0].values["share"] == pytest.approx(0.9, rel=1e-4)
    assert (
        load_curve(bar(tmp_path, 2), DeadForce([-(kl**2) * EI, 0, 0]), to=0.9, held=held).notes
        == ()
    )


def test_column_that_yields_to_shear(tmp_path):
    """Haringx: P (1 + P / GA) = P_E, the buckling of a beam whose shear acts in its sections."""
    shear = 5e3
    elastic = bar(tmp_path, 2, hinged=("foot",), Iz=5e-9, shear_area_z=shear / SECTION["G"])
    euler = np.pi**2 * EI
    expected = 0.5 * shear * (np.sqrt(1 + 4 * euler / shear) - 1)
    held = {"y": 0.0, "z": 0.0}
    curve = load_curve(elastic, DeadForce([-expected, 0, 0]), to=1.1, held=held)
    assert curve.critical[0].factor == pytest.approx(1.0, abs=COMPRESSED)
    assert expected < 0.8 * euler


@pytest.mark.parametrize("segments", [1, 4])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, -1.0])
def test_deflection_under_thrust(tmp_path, segments, share):
    """Tip of a beam-column: F / P (tan k / k - 1), and with tanh under tension."""
    euler = np.pi**2 * EI / 4
    F, P = 1e-4, share * euler
    state = equilibrium(bar(tmp_path, segments), DeadForce([-P, 0, F]))
    k = np.sqrt(abs(P) / EI)
    expected = F / P * ((np.tan(k) if P > 0 else np.tanh(k)) / k - 1)
    assert state.stable
    assert state.displacement[5] == pytest.approx(expected, rel=COMPRESSED)


def test_beyond_its_critical_load_a_column_is_unstable(tmp_path):
    euler = np.pi**2 * EI / 4
    state = equilibrium(bar(tmp_path), DeadForce([-1.5 * euler, 0, 0]), settle=False)
    assert state.stable is False
    assert np.sum(state.eigenvalues < 0) == 1


def test_a_single_spring_says_that_it_does_not_feel_its_thrust(tmp_path):
    K = analyse(bar(tmp_path)).matrices["B"]
    K = 0.5 * (K + K.T)
    elastic = load_bar(tmp_path, {"stiffness": K.tolist(), "offset": {"xyz": [1.0, 0.0, 0.0]}})
    euler = np.pi**2 * EI / 4
    for share, expected in ((0.9, ["link-compressed"]), (0.01, []), (-2.0, [])):
        state = equilibrium(elastic, DeadForce([-share * euler, 0, 0]))
        assert [n.code for n in state.notes] == expected
        if expected:
            assert state.notes[0].values["share"] == pytest.approx(share, rel=1e-3)


# -- large deflections ---------------------------------------------------------------------


def _elastica(force):
    """Tip (x, z) of a clamped inextensible bar under a dead force across it, by shooting."""

    def tip(moment):
        def rates(_, y):
            return [y[1], -force / EI * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]

        return solve_ivp(rates, (0, 1), [0, moment, 0, 0], rtol=1e-12, atol=1e-13).y[:, -1]

    root = brentq(lambda m: tip(m)[1], 0.0, force / EI, xtol=1e-14)
    return tip(root)[2:]


def test_elastica_converges_with_the_fourth_power(tmp_path):
    force = 10 * EI
    x, z = _elastica(force)
    assert (1 - x, z) == pytest.approx((0.55500, 0.81061), abs=1e-5)  # published tables
    errors = []
    for segments in (2, 4, 8, 16):
        # In tension P reaches 2000: an axial stiffness of 2e11 makes 1e-8 of it.
        state = equilibrium(bar(tmp_path, segments, area=1.0), DeadForce([0, 0, force]))
        errors.append(np.hypot(*(state.pose[[0, 2], 3] - [x, z])))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[1] < 1e-3
    assert errors[-1] < 3e-6
    assert orders[0] > 2.5
    assert orders[-1] == pytest.approx(4.0, abs=0.3)


def test_an_end_moment_rolls_a_bar_into_a_circle(tmp_path):
    elastic = bar(tmp_path, 6, area=1e-4)
    curve = load_curve(elastic, FollowerWrench([0, -2 * np.pi * EI, 0, 0, 0, 0]))
    assert curve.reason == "factor-reached"
    for q, factor in zip(curve.q, curve.factors, strict=True):
        angle = 2 * np.pi * factor
        x, z = np.sinc(angle / np.pi), angle / 2 * np.sinc(angle / 2 / np.pi) ** 2
        tip = elastic.mechanism.at(q).pose[:3, 3]
        # The chord of a segment is taken to the fourth power of half its angle, 1/12 of the circle.
        assert absolute_error(tip, [x, 0, z]) <= (angle / 12) ** 4 / 120 * 2 + 1e-12
    assert np.abs(tip).max() <= 1e-12
    assert "beam-bent" in codes(curve)


@pytest.mark.parametrize(("area", "angle"), [(0.1, 1.0), (1.0, 0.1), (10.0, 2.0)])
def test_however_thin_a_bar_a_moment_bends_it_into_an_arc(tmp_path, area, angle):
    """EA L^2 / EI of 1e8 to 1e10: what a step bends stretches to second order."""
    state = equilibrium(bar(tmp_path, 4, area=area), DeadWrench([0, -EI * angle, 0, 0, 0, 0]))
    assert state.displacement[1] == pytest.approx(-angle, rel=1e-12)
    tip = [np.sin(angle) / angle - 1.0, (1.0 - np.cos(angle)) / angle]
    # The chord of a segment is taken to the fourth power of half its angle.
    assert state.displacement[[3, 5]] == pytest.approx(tip, abs=2.0 * (angle / 8) ** 4 / 100)


@pytest.mark.parametrize(("shear", "order", "close"), [(np.inf, 3.5, 1e-5), (2e4, 1.6, 1e-4)])
def test_bending_in_two_planes_with_twist(tmp_path, shear, order, close):
    """A round bar under a force at an arm, towards a rod integrated by shooting.

    Order four; order two where the section yields to shear, here by up to 3 %.
    """
    force, arm = np.array([-300.0, 400.0, 500.0]), np.array([0.1, 0.3, 0.2])
    section = {"Iz": 1e-9, "area": 1e-3}
    strains = np.array([SECTION["E"] * section["area"], shear, shear])
    expected = _rod(force, arm, np.array([160.0, EI, EI]), strains)
    if np.isfinite(shear):
        section |= {f"shear_area_{axis}": shear / SECTION["G"] for axis in "yz"}
    errors = []
    for segments in (2, 4, 8):
        state = equilibrium(bar(tmp_path, segments, **section), DeadForce(force, arm))
        errors.append(absolute_error(state.pose[:3, 3], expected))
    assert errors[2] < close
    assert np.log2(errors[1] / errors[2]) > order


def _rod(force, arm, stiffness, strains):
    """Tip of Reissner's rod, clamped at the origin, with a dead force at an arm."""
    from scipy.optimize import root

    def rates(_, y):
        R, moment = y[:9].reshape(3, 3), y[12:]
        kappa = (R.T @ moment) / stiffness
        along = R @ ([1.0, 0.0, 0.0] + (R.T @ force) / strains)
        return [*(R @ cross_matrix(kappa)).ravel(), *along, *-np.cross(along, force)]

    def end(m0):
        start = [*np.eye(3).ravel(), 0, 0, 0, *m0]
        return solve_ivp(rates, (0, 1), start, "DOP853", rtol=1e-10, atol=1e-11).y[:, -1]

    def missed(m0):
        y = end(m0)
        return y[12:] - np.cross(y[:9].reshape(3, 3) @ arm, force)

    # Loaded in steps, so that the search stays on the branch of the unloaded bar.
    full, m0 = force, np.zeros(3)
    for share in np.linspace(0.25, 1, 4):
        force = share * full
        found = root(missed, m0, tol=1e-11)
        m0 = found.x
    assert np.abs(missed(m0)).max() < 1e-8
    return end(m0)[9:12]


def test_lateral_buckling_of_a_strip(tmp_path):
    """A deep cantilever turns over at 4.01259934 sqrt(EI GJ) / l^2; better than order two.

    The formula is that of a strip that does not bend in its plane; here that leaves 1e-5.
    """
    weak, twist = 200.0, SECTION["G"] * 2.5e-9
    critical = 4.01259934 * np.sqrt(weak * twist)
    errors = []
    for segments in (4, 8, 16):
        strip = bar(tmp_path, segments, Iy=1e-4, Iz=1e-9, J=2.5e-9)
        curve = load_curve(strip, DeadForce([0, 0, critical]), to=1.1)
        errors.append(abs(curve.critical[0].factor - 1))
    assert errors[0] < 1e-3
    assert errors[-1] < 2e-5
    assert np.log2(errors[0] / errors[1]) > 2.0


# -- the tangent ---------------------------------------------------------------------------


@pytest.mark.parametrize("segments", [1, 3])
def test_tangent_under_load_against_differences(tmp_path, segments):
    """The compliance at a loaded state is the derivative of the state by the load."""
    elastic = bar(tmp_path, segments)
    base = np.array([-300.0, 20.0, 30.0])
    state = equilibrium(elastic, DeadForce(base))
    steps, weights = np.array([1.0, 2, 3, 4]), np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
    C = state.stiffness.compliances["K"]
    R = state.pose[:3, :3]
    for axis in np.eye(3):
        moved = np.zeros(3)
        for k, w in zip(steps, weights, strict=True):
            for sign in (1, -1):
                force = DeadForce(base + sign * k * 0.05 * axis)
                moved += sign * w * equilibrium(elastic, force).pose[:3, 3] / 0.05
        expected = R @ C[3:, 3:] @ R.T @ axis
        assert relative_error(expected, moved) <= DIFFERENCES


def test_a_wrench_given_to_analyse_deflects_the_links(tmp_path):
    """The posture analysed is the one in which the links carry the load: beam-column formulas."""
    euler = np.pi**2 * EI / 4
    F, P = 1e-3, 0.9 * euler
    k = np.sqrt(P / EI)
    tip = F / P * (np.tan(k) / k - 1)
    wrench = np.array([0.0, 0.0, 0.0, -P, 0.0, F])
    result = analyse(bar(tmp_path), wrench=wrench, load_axes="world")
    assert result.pose[2, 3] == pytest.approx(tip, rel=COMPRESSED)
    R = result.pose[:3, :3]
    assert relative_error(R @ result.wrench[3:], wrench[3:]) <= SUM
    # What the load keeps in the room decides what one more newton does: tan k / k - 1 over P.
    more = analyse(bar(tmp_path), wrench=wrench + F * np.eye(6)[5], load_axes="world")
    assert more.pose[2, 3] == pytest.approx(2 * tip, rel=COMPRESSED)


@pytest.mark.parametrize("name", ["3-rrr", "delta"])
def test_a_wrench_given_to_a_parallel_mechanism_is_in_balance(name):
    """The equilibrium under the same wrench, with the rest positions found, is the same pose."""
    W = (
        np.array([0.0, 0.0, 1.0, 10.0, -4.0, 0.0])
        if name == "3-rrr"
        else np.array([1.0, 0.0, 0.0, 5.0, 3.0, -20.0])
    )
    result = analyse(load(name), wrench=W)
    assert relative_error(result.wrench, W) <= SUM
    unloaded = analyse(load(name))
    assert absolute_error(result.pose, unloaded.pose) > 1e-7
    start = result.q + 1e-3 * (np.arange(result.q.size) % 3 - 1)
    start = result.elastic.mechanism.assembled(start)
    state = equilibrium(result.elastic, start, FollowerWrench(W))
    assert absolute_error(state.pose, result.pose) <= SUM


def test_a_wrench_is_carried_at_every_posture_of_a_way():
    """Links stretch by rounding errors only: what is left of a step is a force all the same."""
    elastic = load("3-rrr")
    q, motor = elastic.q.copy(), elastic.mechanism.actuated[0]
    for k in range(46, 62):
        q[motor] = elastic.q[motor] + 0.02 * np.sin(0.1 * k)
        q = analyse(elastic, q, wrench=[0, 0, 0, 0, 0, -100.0], load_axes="world").q.copy()


def test_beams_that_are_alike_are_evaluated_as_each_alone():
    """One call for all: the numbers of each by itself."""
    elastic = load("3-rrr")
    q = elastic.q + 1e-3 * np.sin(np.arange(elastic.q.size))
    posture, terms = elastic.mechanism.at(q), elastic.terms(springs=False)
    alone = [term.evaluate(posture) for term in load("3-rrr").terms(springs=False)]
    for one, other in zip(evaluate_together(terms, posture), alone, strict=True):
        assert one.energy == pytest.approx(other.energy, rel=SUM)
        assert relative_error(one.gradient, other.gradient) <= SUM
        assert relative_error(one.hessian, other.hessian) <= SUM


def test_a_wrench_beyond_what_the_links_carry_is_refused(tmp_path):
    arm = load_bar(tmp_path, {"beam": {**SECTION, "length": 1.0}}, hinged=("foot",))
    with pytest.raises((InputError, ConvergenceError)):
        analyse(arm, wrench=[0.0, 1.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("factor", [1.05, 2.0, 10.0])
def test_a_round_column_that_has_buckled_may_turn_about_its_load(tmp_path, factor):
    """Every plane is alike: one motion costs nothing, whatever sign rounding gives to it."""
    column = bar(tmp_path, Iz=1e-9, area=1e-4)
    rest = equilibrium(column, DeadForce([-factor * np.pi**2 * EI / 4.0, 0.0, 0.0]))
    assert np.abs(rest.displacement[:3]).max() > 0.3
    assert rest.stable is None
    assert "neutral" in codes(rest)
    assert "unstable" not in codes(rest)
