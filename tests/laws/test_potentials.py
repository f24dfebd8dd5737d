"""Spring laws, users' functions, the Taylor check."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.doors import PolynomialLaw, TabulatedLaw, TaylorCheck
from tests.support import (
    absolute_error,
    bend,
    hessian_of,
    refused,
    seeds,
    slope,
)

from cartstiff import InputError, JointFunction, JointSprings, PoseFunction
from cartstiff.extend import taylor_check

ROUNDING = 1e-12
# Eighth-order differences at step 0.01 of a polynomial of low degree.
DIFFERENCES = 1e-9
# A slope fitted to a handful of points on a log-log plot.
SLOPE = 0.2

LAWS = {
    "linear": PolynomialLaw((7.0,)),
    "hardening": PolynomialLaw((7.0, 0.0, 2.0)),
    "lopsided": PolynomialLaw((7.0, 1.5, 2.0)),
    "fifth order": PolynomialLaw((3.0, -0.2, 0.5, 0.1, 0.3)),
    "table": TabulatedLaw((-2.0, -0.5, 0.0, 0.7, 2.5), (-30.0, -4.0, 0.0, 9.0, 60.0), "smooth"),
    "two points": TabulatedLaw((-1.0, 1.0), (-5.0, 5.0)),
    "falling table": TabulatedLaw((-1.0, 0.0, 2.0), (8.0, 1.0, -9.0), "smooth"),
    "straight pieces": TabulatedLaw((-2.0, -0.5, 0.0, 0.7, 2.5), (-30.0, -4.0, 0.0, 9.0, 60.0)),
}
EVERY = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())


class _At:
    """A posture that knows its coordinates only."""

    def __init__(self, q):
        self.q = np.asarray(q, float)


@EVERY
@pytest.mark.parametrize("x", [-2.9, -1.3, -0.25, 0.3, 1.2, 3.1])
def test_torque_and_stiffness_are_derivatives(law, x):
    energy, torque, stiffness = law.evaluate(x)
    assert torque == pytest.approx(slope(lambda t: law.evaluate(x + t)[0], 0.005), rel=DIFFERENCES)
    assert stiffness == pytest.approx(
        slope(lambda t: law.evaluate(x + t)[1], 0.005), rel=DIFFERENCES
    )
    assert stiffness == pytest.approx(bend(lambda t: law.evaluate(x + t)[0], 0.01), rel=1e-8)
    assert np.isfinite(energy)


@pytest.mark.parametrize("name", ["table", "two points", "falling table"])
def test_tables_pass_through_their_points(name):
    law = LAWS[name]
    for x, y in zip(law.deflections, law.torques, strict=True):
        assert law.evaluate(x)[1] == pytest.approx(y, abs=ROUNDING)
        # Energy, torque and stiffness are continuous there.
        left, right = law.evaluate(x - 1e-9), law.evaluate(x + 1e-9)
        for a, b in zip(left, right, strict=True):
            assert a == pytest.approx(b, abs=1e-6)


@pytest.mark.parametrize("pieces", ["linear", "smooth"])
def test_a_table_stores_the_work_from_its_rest(pieces):
    """Energy is zero without a deflection, and elsewhere the integral of the torque from there."""
    law = TabulatedLaw((-0.3, -0.1, 0.2, 0.5), (-9.0, -1.0, 1.0, 6.0), pieces)
    assert law.evaluate(0.0)[0] == pytest.approx(0.0, abs=1e-15)
    for x in (-0.4, -0.2, 0.1, 0.35, 0.7):
        middles = (np.arange(20000) + 0.5) / 20000 * x
        work = law.evaluate(middles)[1].mean() * x
        assert law.evaluate(x)[0] == pytest.approx(work, rel=1e-6)
    if pieces == "linear":
        np.testing.assert_allclose(
            law.evaluate(np.array([-0.4, -0.2, 0.1, 0.35, 0.7]))[1],
            [-13.0, -5.0, 1 / 3, 3.5, 6.0 + 0.2 * 5 / 0.3],
        )


def test_corners_are_where_straight_pieces_meet():
    law = TabulatedLaw((-0.1, -0.012, 0.012, 0.1), (-264.0, 0.0, 0.0, 264.0))
    rise = 264.0 / 0.088
    got = [tuple(corner) for corner in law.corners]
    expected = [(-0.012, rise, 0.0), (0.012, 0.0, rise)]
    np.testing.assert_allclose(got, expected, rtol=1e-12)
    assert law.corner_at(0.012) == law.corners[1]
    assert law.corner_at(0.2) is None
    assert replace(law, pieces="smooth").corners == ()
    # A torque of zero is carried anywhere in the play: that without a deflection is taken.
    assert law.deflection_for(0.0) == 0.0
    assert law.deflection_for(150.0) == pytest.approx(0.012 + 150.0 / rise, rel=1e-12)
    assert TabulatedLaw((-1.0, 0.0, 1.0), (-5.0, 0.0, 5.0)).corners == ()


def test_table_does_not_overshoot():
    """Shape-preserving: monotone points give a monotone torque."""
    law = TabulatedLaw((0.0, 1.0, 1.1, 2.0), (0.0, 0.1, 5.0, 5.1), "smooth")
    torques = [law.evaluate(x)[1] for x in np.linspace(0, 2, 401)]
    assert np.all(np.diff(torques) >= -ROUNDING)
    assert min(torques) >= -ROUNDING
    assert max(torques) <= 5.1 + ROUNDING


def test_table_goes_on_in_a_straight_line():
    law = LAWS["table"]
    for x, outward in ((2.5, 1.0), (-2.0, -1.0)):
        near, far = law.evaluate(x + 0.5 * outward), law.evaluate(x + 1.5 * outward)
        assert near[2] == far[2]
        assert (far[1] - near[1]) * outward == pytest.approx(near[2], rel=ROUNDING)


@EVERY
@given(x=st.floats(-3, 3))
def test_a_law_in_other_units_is_the_same(law, x):
    """Deflections a thousand times as many, torques twice."""
    found = law.in_units(1000.0, 2.0).evaluate(1000.0 * x)
    expected = np.array(law.evaluate(x)) * [2000.0, 2.0, 0.002]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@EVERY
@given(x=st.floats(-3, 3))
def test_deflection_for_inverts(law, x):
    """Every law here is monotone: its deflection comes back."""
    torque = law.evaluate(x)[1]
    found = law.deflection_for(torque)
    assert law.evaluate(found)[1] == pytest.approx(torque, abs=1e-9)
    assert found == pytest.approx(x, abs=1e-7)


def test_smallest_deflection_is_chosen():
    """A softening spring reaches the torque twice: the nearer deflection counts."""
    law = PolynomialLaw((10.0, 0.0, -1.0))
    x = law.deflection_for(9.0)
    assert x == pytest.approx(1.0, abs=ROUNDING)
    assert law.evaluate(x)[2] > 0


@given(seeds)
def test_joint_springs(seed):
    rng = np.random.default_rng(seed)
    k, r, q = rng.uniform(0, 9, 4), rng.normal(size=4), rng.normal(size=4)
    got = JointSprings(k, r).evaluate(_At(q))
    assert got.energy == pytest.approx(0.5 * k @ (q - r) ** 2, rel=ROUNDING)
    assert absolute_error(got.gradient, k * (q - r)) <= ROUNDING * 10
    assert np.array_equal(got.hessian, np.diag(k))


@given(seeds)
def test_linear_laws_equal_plain_springs(seed):
    rng = np.random.default_rng(seed)
    k, r, q = rng.uniform(1, 9, 3), rng.normal(size=3), rng.normal(size=3)
    plain = JointSprings(k, r).evaluate(_At(q))
    laws = {j: PolynomialLaw((float(k[j]),)) for j in range(3)}
    # The stiffness of a joint with a law is not used.
    got = JointSprings(np.full(3, 1e6), r, laws).evaluate(_At(q))
    for a, b in zip(got, plain, strict=True):
        assert absolute_error(np.asarray(a), b) <= ROUNDING * 10


def test_balanced_rest_positions():
    """Open rest positions carry the torque; with `every`, all do."""
    q, torque = np.array([0.3, -0.2, 0.5, 0.1]), np.array([2.0, -3.0, 1.0, 0.0])
    laws = {1: LAWS["table"], 2: LAWS["lopsided"]}
    springs = JointSprings([4.0, 0.0, 0.0, 0.0], [np.nan, np.nan, 0.7, np.nan], laws)
    assert not springs.is_complete
    assert springs.is_passive.tolist() == [False, False, False, True]
    assert springs.rest_is_free().tolist() == [True, True, False, False]
    assert springs.rest_is_free(every=True).tolist() == [True, True, True, False]
    chosen = np.where(springs.rest_is_free(), torque, np.nan)
    some = springs.with_forces(_At(q), chosen)
    assert some.is_complete
    assert some.rest[2] == 0.7
    exerted = some.evaluate(_At(q)).gradient
    assert np.abs(exerted - torque)[[0, 1, 3]].max() <= 1e-9
    assert abs(exerted[2] - torque[2]) > 0.1
    every = springs.with_forces(_At(q), torque)
    assert absolute_error(every.evaluate(_At(q)).gradient, torque) <= 1e-9
    assert np.isnan(springs.rest[0])  # the springs themselves are as they were


def test_joint_springs_are_read_only():
    springs = JointSprings([1.0, 2.0], [0.0, 0.0])
    for array in (springs.stiffness, springs.rest, springs.evaluate(_At([1.0, 1.0])).hessian):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 3.0


# -- users' functions ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "energy",
    [
        lambda q: float(np.abs(q[0])),
        lambda q: float(np.abs(q[0] - 0.01) * 5 + q @ q),
        lambda q: float(np.sign(q[0])),
        lambda q: float(np.floor(30 * q[0] + 0.5)),
        lambda q: float(np.abs(q[0]) ** 1.5),
        lambda q: float(np.nan),
        lambda q: float(np.sin(500 * q[0])),  # smooth, on another scale than told
    ],
    ids=["kink", "kink aside", "step", "stairs", "half power", "nan", "too fast"],
)
def test_energy_that_is_not_smooth_is_refused(energy):
    caught = refused(
        "cannot be differentiated numerically", JointFunction(energy).evaluate, _At([0.0, 0.0])
    )
    assert "two step sizes" in str(caught)
    refused(
        "cannot be differentiated numerically",
        PoseFunction(energy=lambda T: energy(T[:2, 3])).on_pose,
        np.eye(4),
    )


def test_the_right_scale_helps():
    fast = JointFunction(lambda q: float(np.sin(500 * q[0])), scale=1e-3)
    got = fast.evaluate(_At([1e-3]))
    assert got.gradient[0] == pytest.approx(500 * np.cos(0.5), rel=1e-9)
    assert got.hessian[0, 0] == pytest.approx(-(500**2) * np.sin(0.5), rel=1e-8)


@pytest.mark.parametrize("offset", [0.0, 1.0, 100.0])
@pytest.mark.parametrize(
    ("energy", "curvature"),
    [(lambda q: 0.0, 0.0), (lambda q: 3 * q[0], 0.0), (lambda q: q[0] * q[1], 1.0)],
    ids=["constant", "plane", "saddle"],
)
def test_smooth_energies_are_served(energy, curvature, offset):
    """A constant is as smooth as energies come, wherever its zero is."""
    got = JointFunction(lambda q: offset + energy(q)).evaluate(_At([0.4, 0.7]))
    assert got.hessian[0, 1] == pytest.approx(curvature, abs=1e-8)
    assert abs(got.hessian[0, 0]) <= 1e-8


@given(seeds)
def test_numerical_derivatives(seed):
    rng = np.random.default_rng(seed)
    a, q = rng.uniform(-1, 1, (3, 3)), rng.uniform(-1, 1, 3)

    def energy(x):
        return float(np.exp(a[0] @ x) + np.sin(a[1] @ x) * (a[2] @ x))

    got = JointFunction(energy).evaluate(_At(q))
    s, c, z = np.sin(a[1] @ q), np.cos(a[1] @ q), a[2] @ q
    gradient = np.exp(a[0] @ q) * a[0] + c * z * a[1] + s * a[2]
    cross = np.outer(a[1], a[2])
    hessian = (
        np.exp(a[0] @ q) * np.outer(a[0], a[0])
        - s * z * np.outer(a[1], a[1])
        + c * (cross + cross.T)
    )
    assert absolute_error(got.gradient, gradient) <= 1e-11
    assert absolute_error(got.hessian, hessian) <= 1e-9


# -- the Taylor check ---------------------------------------------------------------------------


def _smooth(seed):
    """Energy with a clear third derivative, its derivatives at 0, a direction."""
    rng = np.random.default_rng(seed)
    a, d = rng.uniform(0.5, 1.0, (2, 4)), rng.uniform(0.5, 1.0, 4)
    d = d / np.linalg.norm(d)

    def energy(x):
        return float(np.exp(a[0] @ x) + 0.5 * np.sin(a[1] @ x))

    gradient = a[0] + 0.5 * a[1]
    hessian = np.outer(a[0], a[0])
    return energy, gradient, hessian, d


@given(seeds)
def test_taylor_slopes(seed):
    energy, gradient, hessian, d = _smooth(seed)
    right = taylor_check(energy, gradient, hessian, d)
    assert right.ok
    assert right.slope == pytest.approx(3, abs=SLOPE)
    assert 0 < right.window[0] < right.window[1] <= 1
    wrong_hessian = taylor_check(energy, gradient, hessian + 0.1 * np.eye(4), d)
    assert not wrong_hessian.ok
    assert wrong_hessian.slope == pytest.approx(2, abs=SLOPE)
    wrong_gradient = taylor_check(energy, gradient * 1.1, hessian, d)
    assert not wrong_gradient.ok
    assert wrong_gradient.slope == pytest.approx(1, abs=SLOPE)


@pytest.mark.parametrize("error", [1e-1, 1e-3, 1e-5])
def test_taylor_check_sees_small_errors(error):
    energy, gradient, hessian, d = _smooth(1)
    assert not taylor_check(energy, gradient + error, hessian, d).ok
    if error >= 1e-3:
        assert not taylor_check(energy, gradient, hessian * (1 + error), d).ok


def test_taylor_check_of_a_quadratic_energy():
    """Nothing is left to fit: that is right, too, and a wrong one is still found."""
    H = np.array([[2.0, 0.5], [0.5, 1.0]])
    g, d = np.array([0.3, -0.2]), np.array([0.6, 0.8])

    def energy(x):
        return float(g @ x + 0.5 * x @ H @ x)

    right = taylor_check(energy, g, H, d)
    assert isinstance(right, TaylorCheck)
    assert right.ok
    assert right.slope > 2.7
    assert not taylor_check(energy, g, 1.01 * H, d).ok
    assert not taylor_check(energy, 1.01 * g, H, d).ok


def test_taylor_check_with_a_large_constant():
    """A constant of a million leaves ten digits for everything else."""
    energy, gradient, hessian, d = _smooth(2)
    right = taylor_check(lambda x: 1e6 + energy(x), gradient, hessian, d)
    assert right.ok
    wrong = taylor_check(lambda x: 1e6 + energy(x), gradient, 2 * hessian, d)
    assert not wrong.ok


def test_taylor_check_agrees_with_numerical_derivatives():
    energy, gradient, _, d = _smooth(3)
    assert taylor_check(energy, gradient, hessian_of(energy, np.ones(4)), d).ok


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_taylor_check_refuses_what_is_no_number(bad):
    """x^2 / 2 has the derivatives 0 and 1 at 0; nothing that is not finite passes for them."""

    def energy(x):
        return 0.5 * float(x[0]) ** 2

    assert taylor_check(energy, [0.0], [[1.0]], [1.0]).ok
    for gradient, hessian, direction in (
        ([bad], [[1.0]], [1.0]),
        ([0.0], [[bad]], [1.0]),
        ([0.0], [[1.0]], [bad]),
        ([0.0], [[1.0]], [0.0]),
        ([0.0, 0.0], [[1.0]], [1.0]),
    ):
        with pytest.raises(InputError):
            taylor_check(energy, gradient, hessian, direction)
    refused("offset 0", taylor_check, lambda _: bad, [0.0], [[1.0]], [1.0])
    found = taylor_check(lambda x: bad if x[0] else 0.0, [0.0], [[1.0]], [1.0])
    assert not found.ok
    assert not taylor_check(
        lambda x: energy(x) if x[0] > 1e-4 or not x[0] else bad, [0], [[1]], [1]
    ).ok
    # Beyond its own domain an energy may be anything.
    assert taylor_check(lambda x: energy(x) if abs(x[0]) < 0.5 else bad, [0], [[1]], [1]).ok
