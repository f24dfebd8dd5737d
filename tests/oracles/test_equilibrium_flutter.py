"""Columns under a force that turns with them, against the small vibrations written out by hand.

Two equal rigid links (length l, springs k), masses m_1 at the knee and m_2 at the tip, and a force
P along the second link. With absolute angles a, b of the links from the axis:

    M = l^2 [[m_1 + m_2, m_2], [m_2, m_2]],    K = [[2 k - P l, P l - k], [-k, k]]

For m_1 = 2 m_2 the frequencies meet at P l / k = 7/2 - sqrt 2.
"""

import json

import numpy as np
import pytest
from tests.support import links
from tests.support.printed import text_of

from cartstiff import DeadForce, FollowerWrench, equilibrium, load_curve

K, LENGTH, MASS = 3.0, 0.7, 2.5
PUSH = FollowerWrench([0.0, 0.0, 0.0, -K / LENGTH, 0.0, 0.0])  # factor P l / k


def column(masses):
    """Links along x that turn about z."""
    return links(np.full(len(masses), K), length=LENGTH, masses=masses)


def by_hand(p, m_1, m_2):
    """omega^2 at P l / k = p."""
    M = LENGTH**2 * np.array([[m_1 + m_2, m_2], [m_2, m_2]])
    stiffness = K * np.array([[2.0 - p, p - 1.0], [-1.0, 1.0]])
    return np.linalg.eigvals(np.linalg.solve(M, stiffness))


def onset(m_1, m_2):
    """Smallest p at which the roots of det(K - omega^2 M) meet: a quadratic in p."""
    # With x = omega^2 l^2 / k: m_1 m_2 x^2 - (m_1 + m_2 (5 - 2 p) ) x + 1, from the matrices above.
    root = 2.0 * np.sqrt(m_1 * m_2)
    return (m_1 + 5.0 * m_2 - root) / (2.0 * m_2)


def test_the_two_ways_by_hand_agree():
    assert onset(2.0, 1.0) == pytest.approx(3.5 - np.sqrt(2.0), rel=1e-15)
    for m_1, m_2 in ((2.0, 1.0), (1.0, 1.0), (0.3, 2.0)):
        p = onset(m_1, m_2)
        assert np.abs(by_hand(p - 1e-6, m_1, m_2).imag).max() == 0.0
        assert np.abs(by_hand(p + 1e-6, m_1, m_2).imag).max() > 0.0


def test_flutter_is_found_in_one_step_beyond_it():
    """At five hundred times its load both roots are real and negative: divergence."""
    curve = load_curve(column((2.0, 1.0)), PUSH, to=1000.0)
    (critical,) = curve.critical
    assert critical.kind == "flutter"
    assert critical.factor == pytest.approx(onset(2.0, 1.0), rel=1e-10)
    assert "No critical load" not in text_of(curve)


@pytest.mark.parametrize("masses", [(2.0, 1.0), (1.0, 1.0), (0.3, 2.0)])
def test_flutter_load_of_two_links(masses):
    m_1, m_2 = MASS * np.array(masses)
    curve = load_curve(column((m_1, m_2)), PUSH, to=1.2 * onset(m_1, m_2))
    (critical,) = curve.critical
    assert critical.kind == "flutter"
    assert critical.factor == pytest.approx(onset(m_1, m_2), rel=1e-10)
    # The roots meet at x = 1 / sqrt(m_1 m_2).
    omega = np.sqrt(K / LENGTH**2 / np.sqrt(m_1 * m_2))
    assert critical.frequency == pytest.approx(omega / (2 * np.pi), rel=1e-5)
    for factor, stable in zip(curve.factors, curve.stable, strict=True):
        assert stable is (None if factor < critical.factor else False)
    assert [n.code for n in curve.notes] == ["undamped"]


def test_zieglers_column_far_beyond_its_load():
    curve = load_curve(column((2.0, 1.0)), PUSH, to=12.5, resolution=0.01)
    assert curve.critical[0].factor == pytest.approx(3.5 - np.sqrt(2.0), rel=1e-9)
    text = text_of(curve)
    assert "Critical load: flutter at factor 2.08578643" in text
    data = json.loads(json.dumps(curve.to_dict(), allow_nan=False))
    # Eigenvalues of an unsymmetric tangent depend on the coordinates: none is given.
    assert set(data["eigenvalue"]) == {None}
    assert data["critical"][0]["frequency"] > 0.0
    assert np.isnan(curve.eigenvalue).all()


@pytest.mark.parametrize("factor", [0.5, 2.0, 2.2, 4.5])
def test_verdict_and_frequencies_at_one_load(factor):
    push = FollowerWrench(factor * PUSH.wrench)
    state = equilibrium(column((2 * MASS, MASS)), push)
    expected = np.sort_complex(by_hand(factor, 2 * MASS, MASS))
    assert np.sort_complex(state.eigenvalues) == pytest.approx(expected, rel=1e-9)
    flutters = factor > 3.5 - np.sqrt(2.0)
    assert state.stable is (False if flutters else None)
    codes = {n.code for n in state.notes}
    assert ("flutter" in codes) == flutters
    assert ("undamped" in codes) != flutters
    assert "non-conservative" in codes
    assert "eigenvalue" not in text_of(state)


def test_divergence_under_a_force_that_turns_and_one_that_stays():
    """A dead force beside the follower: det K = 0 is found by static means."""
    dead = DeadForce([-K / LENGTH, 0.0, 0.0])
    small = FollowerWrench(0.01 * PUSH.wrench)
    curve = load_curve(column((2.0, 1.0)), dead, small, to=0.6)
    kinds = [c.kind for c in curve.critical]
    assert kinds == ["bifurcation"]
    assert curve.critical[0].factor == pytest.approx((3 - np.sqrt(5)) / 2, rel=0.02)
    assert curve.stable[-1] is False
    assert curve.stable[1] is None


@pytest.mark.parametrize("masses", [(0.0, 0.0), (2.0, 0.0)])
def test_without_masses_nothing_is_said_about_flutter(masses):
    curve = load_curve(column(masses), PUSH, to=12.5)
    assert curve.critical == ()
    assert set(curve.stable) == {None}
    assert [n.code for n in curve.notes] == ["masses-missing"]
    text = text_of(curve)
    assert "flutter is not examined" in text
    assert "No critical load" not in text
    state = equilibrium(column(masses), PUSH)
    assert state.eigenvalues.size == 0
    assert "masses-missing" in {n.code for n in state.notes}
