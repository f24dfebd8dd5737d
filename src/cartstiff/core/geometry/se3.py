r"""Rigid motions in the conventions of Zefran & Kumar [ZK]_.

A *pose* is a 4x4 array ``T_a_b`` that maps coordinates in frame b to coordinates in frame
a, so that names cancel: ``T_a_c = T_a_b @ T_b_c``. A *twist* is a 6-vector (omega, v),
angular first, in body components; a *wrench* is (moment, force) in the same frame, and
power is ``wrench @ twist``.

Every function acts on the last axes and broadcasts over leading ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, real_array
from cartstiff.core.arrays import is_pose as is_pose
from cartstiff.core.errors import InputError

ANGULAR_LINEAR: Final = "angular-linear"
LINEAR_ANGULAR: Final = "linear-angular"

#: The permutation between our order and Pinocchio's; it is its own inverse.
SWAP: Final = np.array([3, 4, 5, 0, 1, 2])

# Below this angle the series of the exponential is used: its first neglected term is then
# below 1e-17, while the closed form would lose digits to cancellation.
_SMALL_ANGLE: Final = 1e-2


def _of_shape(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """Doubles whose last axes have a shape; InputError for others."""
    array = real_array(values, what)
    if array.shape != shape and array.shape[-len(shape) :] != shape:
        expected = f"(..., {', '.join(map(str, shape))})"
        raise InputError(f"{what} has another shape", expected=expected, got=array.shape)
    return array


def cross(a: Sequence[float] | Array, b: Sequence[float] | Array) -> Array:
    """Cross product of vectors a and b (3, ...): `numpy.cross` takes ten times as long
    for one pair.
    """
    (x, y, z), (u, v, w) = a, b
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def skew(v: ArrayLike) -> Array:
    """Cross-product matrix ``[v]x``: ``skew(a) @ b == np.cross(a, b)``.

    (..., 3) to (..., 3, 3).
    """
    return skew_of(_of_shape(v, (3,), "vector"))


def skew_of(v: Array) -> Array:
    """`skew` (..., 3, 3) of vectors v (..., 3), which may hold recorded numbers."""
    m = np.zeros((*v.shape[:-1], 3, 3), v.dtype)
    m[..., 2, 1] = v[..., 0]
    m[..., 1, 2] = -v[..., 0]
    m[..., 0, 2] = v[..., 1]
    m[..., 2, 0] = -v[..., 1]
    m[..., 1, 0] = v[..., 2]
    m[..., 0, 1] = -v[..., 2]
    return m


def unskew(m: ArrayLike) -> Array:
    """Vector (..., 3) of the antisymmetric part of matrices m (..., 3, 3); inverse of
    `skew`.
    """
    m = _of_shape(m, (3, 3), "matrix")
    return 0.5 * np.stack(
        [
            m[..., 2, 1] - m[..., 1, 2],
            m[..., 0, 2] - m[..., 2, 0],
            m[..., 1, 0] - m[..., 0, 1],
        ],
        axis=-1,
    )


def hat(twist: ArrayLike) -> Array:
    """Matrix of a twist in se(3), [ZK]_ eq. 3; (..., 6) to (..., 4, 4)."""
    twist = _of_shape(twist, (6,), "twist")
    m = np.zeros((*twist.shape[:-1], 4, 4))
    m[..., :3, :3] = skew(twist[..., :3])
    m[..., :3, 3] = twist[..., 3:]
    return m


def vee(m: ArrayLike) -> Array:
    """Twist (..., 6), (omega, v), of m (..., 4, 4) in se(3); inverse of `hat`."""
    m = _of_shape(m, (4, 4), "matrix")
    return np.concatenate([unskew(m[..., :3, :3]), m[..., :3, 3]], axis=-1)


def basis_twist(i: int) -> Array:
    """Basis twist ``L_{i+1}`` (6,) of [ZK]_ eq. 4: 0..2 rotations, 3..5 translations
    along x, y, z.
    """
    e = np.zeros(6)
    e[i] = 1.0
    return e


def pose(
    rotation: ArrayLike | None = None, translation: ArrayLike | None = None
) -> Array:
    """Pose (4, 4) from a rotation matrix (3, 3), default identity, and a translation
    (3,), default zero.
    """
    r = np.eye(3) if rotation is None else _of_shape(rotation, (3, 3), "rotation")
    if translation is None:
        p = np.zeros(3)
    else:
        p = _of_shape(translation, (3,), "translation")
    m = np.zeros((*np.broadcast_shapes(r.shape[:-2], p.shape[:-1]), 4, 4))
    m[..., 3, 3] = 1.0
    m[..., :3, :3] = r
    m[..., :3, 3] = p
    return m


def inverse(T_a_b: ArrayLike) -> Array:
    """Pose ``T_b_a`` (..., 4, 4), exactly orthogonal where the argument is."""
    T = _of_shape(T_a_b, (4, 4), "pose")
    rt = T[..., :3, :3].swapaxes(-1, -2)
    m = np.zeros(T.shape)
    m[..., 3, 3] = 1.0
    m[..., :3, :3] = rt
    m[..., :3, 3:] = -(rt @ T[..., :3, 3:])
    return m


def placed(T_a_b: Array, points: ArrayLike) -> Array:
    """Points (..., 3) of frame b, lengths, in frame a: ``R p + t``."""
    return np.asarray(points) @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def bracket(x: ArrayLike, y: ArrayLike) -> Array:
    """Lie bracket (..., 6) of twists x and y: [x, y] = (w1 x w2, w1 x v2 - w2 x v1),
    [ZK]_ eq. 5.
    """
    x, y = _of_shape(x, (6,), "twist"), _of_shape(y, (6,), "twist")
    return (ad(x) @ y[..., None])[..., 0]


def ad(x: ArrayLike) -> Array:
    """Matrix of y -> [x, y]; (..., 6) to (..., 6, 6)."""
    x = _of_shape(x, (6,), "twist")
    m = np.zeros((*x.shape[:-1], 6, 6))
    w = skew(x[..., :3])
    m[..., :3, :3] = w
    m[..., 3:, 3:] = w
    m[..., 3:, :3] = skew(x[..., 3:])
    return m


def adjoint(T_a_b: ArrayLike) -> Array:
    """Matrix ``Ad`` (..., 6, 6) that takes twists in components of frame b to components
    of frame a.
    """
    T = _of_shape(T_a_b, (4, 4), "pose")
    r, p = T[..., :3, :3], T[..., :3, 3]
    m = np.zeros((*T.shape[:-2], 6, 6))
    m[..., :3, :3] = r
    m[..., 3:, 3:] = r
    m[..., 3:, :3] = skew(p) @ r
    return m


def adjoint_of_inverse(T_a_b: ArrayLike) -> Array:
    """``adjoint(inverse(T_a_b))``: twists in components of frame a to frame b."""
    T = _of_shape(T_a_b, (4, 4), "pose")
    rt = T[..., :3, :3].swapaxes(-1, -2)
    m = np.zeros((*T.shape[:-2], 6, 6))
    m[..., :3, :3] = m[..., 3:, 3:] = rt
    m[..., 3:, :3] = rt @ skew(-T[..., :3, 3])  # rounds only once
    return m


#: ``STRUCTURE_CONSTANTS[i, j, k]``: [L_i, L_j] = sum_k C[i, j, k] L_k, [ZK]_ eq. 6 and 7.
STRUCTURE_CONSTANTS: Final[Array] = np.swapaxes(ad(np.eye(6)), -1, -2)
STRUCTURE_CONSTANTS.flags.writeable = False

_BRACKETS: Final[Array] = np.ascontiguousarray(STRUCTURE_CONSTANTS.reshape(36, 6).T)


def bracket_form(wrench: ArrayLike) -> Array:
    """Matrix ``M`` with ``x @ M @ y == wrench @ bracket(x, y)``.

    ``M = -[[ [tau]x, [f]x ], [ [f]x, 0 ]]``, hence K^A - (K^A)^T = -M, [ZK]_ eq. 50.
    """
    w = _of_shape(wrench, (6,), "wrench")
    return w.dot(_BRACKETS).reshape(*w.shape[:-1], 6, 6)


def _coefficients(angle: Array) -> tuple[Array, Array, Array]:
    """Sin t / t, (1 - cos t) / t^2, (t - sin t) / t^3, accurate for every t >= 0."""
    t2 = angle * angle
    small = angle < _SMALL_ANGLE
    t = np.where(small, 1.0, angle)
    half = np.sin(0.5 * t) / (0.5 * t)
    a = np.where(small, 1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42)), np.sin(t) / t)
    b = np.where(small, 0.5 - t2 / 24 * (1 - t2 / 30 * (1 - t2 / 56)), 0.5 * half * half)
    c = np.where(
        small, 1 / 6 - t2 / 120 * (1 - t2 / 42 * (1 - t2 / 72)), (t - np.sin(t)) / t**3
    )
    return a, b, c


def exp(twist: ArrayLike) -> Array:
    """Exponential se(3) -> SE(3): the screw motion by a constant body twist
    for unit time.
    """
    x = _of_shape(twist, (6,), "twist")
    w = x[..., :3]
    a, b, c = (k[..., None, None] for k in _coefficients(np.linalg.norm(w, axis=-1)))
    W = skew(w)
    W2 = W @ W
    eye = np.eye(3)
    return pose(eye + a * W + b * W2, ((eye + b * W + c * W2) @ x[..., 3:, None])[..., 0])


def _rotation_vector(R: Array) -> Array:
    """Rotation vector with angle in [0, pi], through the quaternion of largest pivot."""
    m = R
    tr = np.trace(m, axis1=-2, axis2=-1)
    d = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2], tr], axis=-1)
    # Rows: 4 q_i q for i = x, y, z, w; the row of the largest pivot has the least
    # rounding.
    rows = np.empty((*m.shape[:-2], 4, 4))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[..., i, i] = 1 + d[..., i] - d[..., j] - d[..., k]
        rows[..., i, j] = m[..., j, i] + m[..., i, j]
        rows[..., i, k] = m[..., k, i] + m[..., i, k]
        rows[..., i, 3] = m[..., k, j] - m[..., j, k]
        rows[..., 3, i] = rows[..., i, 3]
    rows[..., 3, 3] = 1 + tr
    best = np.argmax(d, axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q = np.where(q[..., 3:] < 0, -q, q)
    s = np.linalg.norm(q[..., :3], axis=-1)
    angle = 2 * np.arctan2(s, q[..., 3])
    tiny = s < numerics.NEGLIGIBLE_DIFFERENCE
    scale = np.where(
        tiny, 2.0 / np.where(tiny, q[..., 3], 1.0), angle / np.where(tiny, 1.0, s)
    )
    return scale[..., None] * q[..., :3]


def _cot_coefficient(angle: Array) -> Array:
    """(1 - (t/2) cot(t/2)) / t^2, accurate on [0, 2 pi)."""
    t2 = angle * angle
    small = angle < 0.05
    h = np.where(small, 1.0, 0.5 * angle)
    series = 1 / 12 + t2 / 720 * (1 + t2 / 42 * (1 + t2 / 40))
    return np.where(small, series, (1 - h / np.tan(h)) / np.where(small, 1.0, t2))


def log(T: ArrayLike) -> Array:
    """Logarithm SE(3) -> se(3) of poses T (..., 4, 4), inverse of `exp`: twists (..., 6);
    rotation angle in [0, pi].
    """
    T = _of_shape(T, (4, 4), "pose")
    w = _rotation_vector(T[..., :3, :3])
    d = _cot_coefficient(np.linalg.norm(w, axis=-1))[..., None, None]
    W = skew(w)
    v = (np.eye(3) - 0.5 * W + d * (W @ W)) @ T[..., :3, 3, None]
    return np.concatenate([w, v[..., 0]], axis=-1)


def right_jacobian(twist: ArrayLike) -> Array:
    """Matrix ``D`` (..., 6, 6) at a twist x (..., 6), with ``exp(x)^-1 d(exp x) = hat(D
    dx)``: the sum of (-ad x)^k / (k+1)!.
    """
    x = _of_shape(twist, (6,), "twist")
    a = -ad(x)
    t2 = np.sum(x[..., :3] ** 2, axis=-1)[..., None, None]
    # ad x is a root of a (a^2 + t^2)^2, so the series closes after the fourth power.
    # Below the threshold the neglected terms are under 1e-16 of the sum.
    small = t2 < 0.15**2
    t = np.where(small, 1.0, np.sqrt(t2))
    s, c = np.sin(t), np.cos(t)
    t4 = t2 * t2
    series = (
        1 / 2 - t4 / 720 * (1 - t2 / 28 * (1 - t2 / 60)),
        1 / 6 - t4 / 5040 * (1 - t2 / 36 * (1 - 3 * t2 / 220)),
        1 / 24 - t2 / 360 * (1 - 3 * t2 / 112 * (1 - 2 * t2 / 135)),
        1 / 120 - t2 / 2520 * (1 - t2 / 48 * (1 - 2 * t2 / 165)),
    )
    closed = (
        (4 - t * s - 4 * c) / (2 * t**2),
        (4 * t - 5 * s + t * c) / (2 * t**3),
        (2 - t * s - 2 * c) / (2 * t**4),
        (2 * t - 3 * s + t * c) / (2 * t**5),
    )
    c1, c2, c3, c4 = (np.where(small, u, v) for u, v in zip(series, closed, strict=True))
    a2 = a @ a
    return np.eye(6) + c1 * a + c2 * a2 + c3 * (a2 @ a) + c4 * (a2 @ a2)


def right_jacobian_inverse(twist: ArrayLike) -> Array:
    """Inverse (..., 6, 6) of `right_jacobian` at a twist (..., 6): ``d(log T) =
    right_jacobian_inverse(log(T)) @ body_twist``.
    """
    return np.linalg.inv(right_jacobian(twist))


def to_linear_angular(x: ArrayLike, axis: int = -1) -> Array:
    """Reorder components x from (omega, v) to (v, omega), as in Pinocchio: six along an
    axis of an array of any shape (...), whose unit stays.

    Raises
    ------
    InputError
        If there are not six.
    """
    array = real_array(x)
    if not -array.ndim <= axis < array.ndim or array.shape[axis] != 6:
        raise InputError(
            "components have another shape", expected="6 along the axis", got=array.shape
        )
    return np.take(array, SWAP, axis=axis)


def from_roll_pitch_yaw(
    translation: ArrayLike = (0.0, 0.0, 0.0), angles: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """Pose from a translation and angles about fixed axes:
    R = Rz(yaw) Ry(pitch) Rx(roll).
    """
    return pose(rotation_by_angles(_of_shape(angles, (3,), "angles")), translation)


def rotation_by_angles(angles: Array) -> Array:
    """Rotations (..., 3, 3) of `from_roll_pitch_yaw`.

    The angles may be recorded numbers.
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles).T, np.sin(angles).T
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.array(rows).swapaxes(0, 1).T


def roll_pitch_yaw(T: ArrayLike) -> Array:
    """Roll, pitch, yaw (..., 3) of poses T (..., 4, 4), R = Rz(yaw) Ry(pitch) Rx(roll);
    pitch in [-pi/2, pi/2].

    Roll follows after yaw has been removed: near pitch = +-pi/2, where only one
    combination of the two is determined, the three together still reproduce the rotation
    to round-off.
    """
    R = _of_shape(T, (4, 4), "pose")[..., :3, :3]
    pitch = np.arctan2(-R[..., 2, 0], np.hypot(R[..., 0, 0], R[..., 1, 0]))
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    roll = np.arctan2(
        s * R[..., 0, 2] - c * R[..., 1, 2], c * R[..., 1, 1] - s * R[..., 0, 1]
    )
    return np.stack([roll, pitch, yaw], axis=-1)


def chain_curvature(jacobian: ArrayLike, wrench: ArrayLike) -> Array:
    """``S[a, b] = 1/2 w . [J_a, J_b]`` (..., n, n) for a before b, symmetric: the
    curvature of a chain.

    Columns of the body `jacobian` (..., 6, n) are in the order of the joints from base to
    end, each with one coordinate and a constant axis; then d J_a / d q_b = [J_a, J_b] for
    b after a, and S is the second derivative of w . log(pose) at the posture.

    Raises
    ------
    InputError
        If the Jacobian has another shape.
    """
    J = real_array(jacobian)
    if J.ndim < 2 or J.shape[-2] != 6:
        raise InputError(
            "jacobian has another shape", expected="(..., 6, n)", got=J.shape
        )
    products = 0.5 * J.swapaxes(-1, -2) @ bracket_form(wrench) @ J
    upper = np.where(_above_diagonal(J.shape[-1]), products, 0.0)
    S: Array = upper + upper.swapaxes(-1, -2)
    return S


@cache
def _above_diagonal(n: int) -> NDArray[np.bool_]:
    """Which entries (n, n) are above the diagonal: `numpy.triu` makes it at each call."""
    return np.tri(n, dtype=bool).T & ~np.eye(n, dtype=bool)
