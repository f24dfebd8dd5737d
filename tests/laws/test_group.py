"""SE(3) and se(3): group axioms, adjoint, bracket, exponential, transport."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from scipy.linalg import expm
from tests.support import (
    ROTATION_ANGLES,
    absolute_error,
    adjoint_reference,
    bracket_reference,
    exp_reference,
    plain_twists,
    poses,
    rotation,
    seeds,
    twist_matrix,
    twists,
    wrenches,
)

from cartstiff.geometry import se3

# A handful of products of numbers of size up to ten.
ROUNDING = 1e-13
# scipy's matrix exponential is good to about 1e-14 of its result, of size up to ten here.
REFERENCE = 1e-12
# The logarithm loses digits within a distance e of the angle pi where the axis turns over;
# through the quaternion it loses none.
ROUND_TRIP = 1e-13
# Close to the identity absolute errors scale with the twist; relative errors stay at this.
TINY = 1e-9


@given(poses(), poses(), poses())
def test_group_axioms(a, b, c):
    assert absolute_error((a @ b) @ c, a @ (b @ c)) <= ROUNDING * 10
    for T in (a, b, c):
        assert absolute_error(se3.inverse(T) @ T, np.eye(4)) <= ROUNDING
        assert absolute_error(T @ se3.inverse(T), np.eye(4)) <= ROUNDING
        assert absolute_error(se3.inverse(se3.inverse(T)), T) <= ROUNDING
    assert absolute_error(se3.inverse(a @ b), se3.inverse(b) @ se3.inverse(a)) <= ROUNDING * 10
    assert se3.is_pose(a @ b @ c)


@given(poses(), poses())
def test_adjoint_homomorphism(a, b):
    assert absolute_error(se3.adjoint(a @ b), se3.adjoint(a) @ se3.adjoint(b)) <= ROUNDING * 10
    assert absolute_error(se3.adjoint_of_inverse(a), se3.adjoint(se3.inverse(a))) <= ROUNDING
    assert absolute_error(se3.adjoint(a) @ se3.adjoint_of_inverse(a), np.eye(6)) <= ROUNDING * 10
    assert absolute_error(se3.adjoint(a), adjoint_reference(a)) <= ROUNDING * 10


@given(poses(), plain_twists, plain_twists)
def test_adjoint_keeps_the_bracket(T, x, y):
    a = se3.adjoint(T)
    assert absolute_error(a @ se3.bracket(x, y), se3.bracket(a @ x, a @ y)) <= ROUNDING * 1000


@given(plain_twists, plain_twists, plain_twists)
def test_bracket_laws(x, y, z):
    xy = se3.bracket(x, y)
    assert absolute_error(xy, bracket_reference(x, y)) <= ROUNDING
    assert (
        np.array_equal(xy, -se3.bracket(y, x)) or np.abs(xy + se3.bracket(y, x)).max() <= ROUNDING
    )
    jacobi = (
        se3.bracket(x, se3.bracket(y, z))
        + se3.bracket(y, se3.bracket(z, x))
        + se3.bracket(z, se3.bracket(x, y))
    )
    assert np.abs(jacobi).max() <= ROUNDING * 100
    assert absolute_error(se3.ad(x) @ y, xy) <= ROUNDING
    ad_of_bracket = se3.ad(x) @ se3.ad(y) - se3.ad(y) @ se3.ad(x)
    assert absolute_error(se3.ad(xy), ad_of_bracket) <= ROUNDING * 10


def test_structure_constants_of_the_paper():
    """Eq. 7, entry by entry; all others vanish."""
    plus = ["123", "312", "231", "156", "264", "345", "426", "534", "615"]
    minus = ["213", "132", "321", "516", "624", "435", "246", "354", "165"]
    C = np.zeros((6, 6, 6))
    for sign, entries in ((1.0, plus), (-1.0, minus)):
        for i, j, k in entries:
            C[int(i) - 1, int(j) - 1, int(k) - 1] = sign
    assert np.array_equal(se3.STRUCTURE_CONSTANTS, C)
    assert not se3.STRUCTURE_CONSTANTS.flags.writeable


def test_basis_of_the_paper():
    """Eq. 4: three rotations, three translations."""
    for i in range(6):
        e = se3.basis_twist(i)
        assert np.array_equal(e, np.eye(6)[i])
        assert np.array_equal(se3.hat(e), twist_matrix(e))


@given(wrenches, plain_twists, plain_twists)
def test_bracket_form(w, x, y):
    expected = w @ bracket_reference(x, y)
    assert abs(x @ se3.bracket_form(w) @ y - expected) <= ROUNDING * 100
    assert np.array_equal(se3.bracket_form(w), -se3.bracket_form(w).T)


@given(seeds)
def test_chain_curvature(seed):
    """Entry by entry: half the load on the bracket of an earlier with a later axis."""
    rng = np.random.default_rng(seed)
    J, w = rng.normal(size=(6, 5)), rng.normal(size=6)
    S = se3.chain_curvature(J, w)
    for a in range(5):
        assert S[a, a] == 0
        for b in range(a + 1, 5):
            expected = 0.5 * w @ bracket_reference(J[:, a], J[:, b])
            assert abs(S[a, b] - expected) <= ROUNDING
            assert S[b, a] == S[a, b]


@given(plain_twists)
def test_hat_and_vee(x):
    assert np.array_equal(se3.hat(x), twist_matrix(x))
    assert np.array_equal(se3.vee(se3.hat(x)), x)
    assert np.array_equal(se3.unskew(se3.skew(x[:3])), x[:3])
    assert absolute_error(se3.skew(x[:3]) @ x[3:], np.cross(x[:3], x[3:])) <= ROUNDING


@given(twists())
def test_exponential(x):
    T = se3.exp(x)
    assert absolute_error(T, exp_reference(x)) <= REFERENCE
    assert se3.is_pose(T, tolerance=1e-12)
    assert absolute_error(se3.exp(-x) @ T, np.eye(4)) <= ROUNDING * 10
    assert absolute_error(se3.exp(0.3 * x) @ se3.exp(0.7 * x), T) <= ROUNDING * 10


@given(twists())
def test_adjoint_of_exponential(x):
    assert absolute_error(se3.adjoint(se3.exp(x)), expm(se3.ad(x))) <= REFERENCE * 10


@given(poses())
def test_exp_of_log(T):
    x = se3.log(T)
    assert np.linalg.norm(x[:3]) <= np.pi + 1e-15 * 10
    assert absolute_error(se3.exp(x), T) <= ROUND_TRIP * 10


@given(twists(["generic", "small", "near identity", "zero"]))
def test_log_of_exp(x):
    difference = np.abs(se3.log(se3.exp(x)) - x)
    assert difference.max() <= ROUND_TRIP * 10
    if np.abs(x).max() < 1e-3:  # digits must survive near the identity
        assert difference.max() <= max(TINY * np.abs(x).max(), 1e-16 * np.abs(x[3:]).max())


@given(twists(["near pi"]))
def test_log_of_exp_near_pi(x):
    """The axis stays as long as the angle is below pi by more than rounding."""
    if np.pi - np.linalg.norm(x[:3]) > 1e-7:
        assert absolute_error(se3.log(se3.exp(x)), x) <= ROUND_TRIP * 100


@given(seeds)
def test_log_at_pi(seed):
    """Exactly half a turn: either sign of the axis is right, the motion is the same."""
    rng = np.random.default_rng(seed)
    Q, p = rotation(rng), rng.uniform(-2, 2, 3)
    T = np.eye(4)
    T[:3, :3] = Q @ np.diag([1.0, -1.0, -1.0]) @ Q.T
    T[:3, 3] = p
    x = se3.log(T)
    assert abs(np.linalg.norm(x[:3]) - np.pi) <= 1e-7
    assert absolute_error(se3.exp(x), T) <= ROUND_TRIP * 10
    assert np.abs(np.cross(x[:3] / np.pi, Q[:, 0])).max() <= 1e-7


@pytest.mark.parametrize("axis", range(3))
def test_log_at_pi_about_the_axes(axis):
    R = -np.eye(3)
    R[axis, axis] = 1.0
    x = se3.log(se3.pose(R))
    assert absolute_error(np.abs(x[:3]), np.pi * np.eye(3)[axis]) <= ROUNDING


def _right_jacobian_exact(x):
    """Sum of (-ad x)^k / (k + 1)! in 60 digits."""
    with mp.workdps(60):
        a = -mp.matrix(se3.ad(x).tolist())
        total, term, k = mp.eye(6), mp.eye(6), 1
        while True:
            term = term * a / (k + 1)
            total += term
            k += 1
            if mp.mnorm(term, 1) < mp.mpf(10) ** -40:
                return np.array(total.tolist(), float)


@pytest.mark.parametrize(
    "angle", [0.0, 1e-8, 1e-4, 0.01, 0.1, 0.1499, 0.1501, 0.3, 1.0, 3.0, np.pi, 6.0]
)
def test_right_jacobian(angle):
    rng = np.random.default_rng(4)
    for _ in range(2):
        w = rng.normal(size=3)
        x = np.concatenate([angle * w / np.linalg.norm(w), rng.uniform(-2, 2, 3)])
        D = se3.right_jacobian(x)
        assert absolute_error(D, _right_jacobian_exact(x)) <= ROUNDING
        inverse = se3.right_jacobian_inverse(x)
        assert absolute_error(inverse @ D, np.eye(6)) <= ROUNDING * 100


@given(twists(["generic", "small", "near identity", "near pi", "zero"]), plain_twists)
def test_right_jacobian_is_the_derivative(x, d):
    """exp(x)^-1 d exp(x) by the block exponential: no differences."""
    X, Y = twist_matrix(x), twist_matrix(d)
    derivative = expm(np.block([[X, Y], [np.zeros((4, 4)), X]]))[:4, 4:]
    left = np.linalg.inv(exp_reference(x)) @ derivative
    assert absolute_error(left, twist_matrix(se3.right_jacobian(x) @ d)) <= REFERENCE * 10


@given(poses(), plain_twists, wrenches)
def test_transport_keeps_power(T, x, w):
    twist = se3.adjoint(T) @ x
    assert abs(se3.adjoint_of_inverse(T).T @ w @ twist - w @ x) <= ROUNDING * 1000
    assert absolute_error(twist, adjoint_reference(T) @ x) <= ROUNDING * 100


@given(seeds)
def test_functions_broadcast(seed):
    """Leading axes are carried along: same numbers as one by one."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(2, 3, 6)) * np.array([1e-4, 1.0, 3.0])[:, None]
    y = rng.normal(size=(2, 3, 6))
    T = se3.exp(x)
    single = {
        "exp": (T, se3.exp),
        "right_jacobian": (se3.right_jacobian(x), se3.right_jacobian),
        "ad": (se3.ad(x), se3.ad),
        "bracket_form": (se3.bracket_form(x), se3.bracket_form),
    }
    for got, f in single.values():
        for index in np.ndindex(2, 3):
            assert absolute_error(got[index], f(x[index])) <= ROUNDING
    on_poses = (se3.log, se3.inverse, se3.adjoint, se3.adjoint_of_inverse, se3.roll_pitch_yaw)
    for f in on_poses:
        got = f(T)
        for index in np.ndindex(2, 3):
            assert absolute_error(got[index], f(T[index])) <= ROUNDING
    got = se3.bracket(x, y)
    for index in np.ndindex(2, 3):
        assert absolute_error(got[index], se3.bracket(x[index], y[index])) <= ROUNDING


@given(plain_twists)
def test_orders(x):
    swapped = se3.to_linear_angular(x)
    assert np.array_equal(swapped, np.concatenate([x[3:], x[:3]]))
    assert np.array_equal(se3.to_linear_angular(swapped), x)  # its own inverse
    M = np.outer(x, x + 1)
    both = se3.to_linear_angular(se3.to_linear_angular(M, axis=0), axis=1)
    assert np.array_equal(both, np.outer(swapped, swapped + 1))


@given(seeds)
def test_roll_pitch_yaw(seed):
    rng = np.random.default_rng(seed)
    angles = rng.uniform([-np.pi, -np.pi / 2, -np.pi], [np.pi, np.pi / 2, np.pi])
    p = rng.normal(size=3)
    T = se3.from_roll_pitch_yaw(p, angles)
    x, y, z = (exp_reference([*(a * e), 0, 0, 0]) for a, e in zip(angles, np.eye(3), strict=True))
    expected = z @ y @ x
    expected[:3, 3] = p
    assert absolute_error(T, expected) <= ROUNDING
    again = se3.from_roll_pitch_yaw(p, se3.roll_pitch_yaw(T))
    assert absolute_error(again, T) <= ROUNDING * 10


@pytest.mark.parametrize("distance", [0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("side", [-1, 1])
def test_roll_pitch_yaw_near_the_lock(side, distance):
    """Angles may be ill-defined next to pitch = +-pi/2; the pose they give back is not."""
    rng = np.random.default_rng(9)
    for _ in range(5):
        roll, yaw = rng.uniform(-3, 3, 2)
        T = se3.from_roll_pitch_yaw((0, 0, 0), (roll, side * (np.pi / 2 - distance), yaw))
        # The entries of a pose that was computed carry rounding of their own.
        turn = exp_reference(rng.normal(size=6))
        T = np.linalg.inv(turn) @ (turn @ T)
        angles = se3.roll_pitch_yaw(T)
        again = se3.from_roll_pitch_yaw(T[:3, 3], angles)
        assert absolute_error(again, T) <= ROUNDING * 10


def test_is_pose():
    rng = np.random.default_rng(3)
    T = se3.pose(rotation(rng), rng.normal(size=3))
    assert se3.is_pose(T)
    assert se3.is_pose(np.stack([T, np.eye(4)]))
    mirrored, scaled, bent, wrong = T.copy(), T.copy(), T.copy(), T.copy()
    mirrored[:3, 0] *= -1
    scaled[:3, :3] *= 1.001
    bent[3, 0] = 1e-3
    wrong[0, 3] = np.nan
    for bad in (mirrored, scaled, bent, wrong, np.eye(3), 1.0, np.stack([T, mirrored])):
        assert not se3.is_pose(bad)
    assert np.array_equal(se3.pose(), np.eye(4))


def test_samplers_reach_every_kind():
    """The laws above mean little if the samples are all alike."""
    assert set(ROTATION_ANGLES) == {"generic", "small", "near identity", "near pi", "at pi", "zero"}
