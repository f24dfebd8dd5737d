"""Deformation of a beam segment from its six coordinates: bow, S, twist and slant.

All values have first and second derivatives (`cartstiff.geometry.jets`).
"""

from __future__ import annotations

import numpy as np

from cartstiff.geometry.jets import Jet, cosines_of, sines_of, stacked, variables
from cartstiff.geometry.se3 import Array

# Below this w, 0.6 rad, the series of asin(sqrt w) / sqrt(w (1 - w)) is exact to rounding.
SMALL_TURN = 0.09
_TURN_TERMS = np.cumprod([1.0, *((2 * k + 2) / (2 * k + 3) for k in range(18))])
# Number of terms of the sine and cosine of a slant.
_TERMS = 20


def with_derivatives(c: Array) -> Array:
    """Coefficients (terms, 3) of a power series and its first two derivatives."""
    k = np.arange(c.size)
    columns = np.zeros((c.size, 3))
    columns[:, 0], columns[:-1, 1], columns[:-2, 2] = c, (k * c)[1:], (k * (k - 1) * c)[2:]
    return columns


def power_series(coefficients: Array, x: Array) -> list[Array]:
    """The three power series at x."""
    if x.dtype == object:  # recorded numbers have no powers
        totals = [np.zeros(x.shape, object) for _ in range(3)]
        for row in coefficients[::-1]:
            totals = [total * x + c for total, c in zip(totals, row, strict=True)]
        return totals
    values = x[..., None] ** np.arange(len(coefficients)) @ coefficients
    return [values[..., k] for k in range(3)]


_STRETCH = with_derivatives(_TURN_TERMS)
# Series of sin(a) / a and cos(a) - 1 in a^2; a segment's turns stay below pi.
_FACTORIALS = np.cumprod(np.concatenate([[1.0], np.arange(1.0, 2 * _TERMS + 2)]))
_SIGNS = (-1.0) ** np.arange(_TERMS)
_SINE_RATIO = with_derivatives(_SIGNS / _FACTORIALS[1 : 2 * _TERMS : 2])
_COSINE_LESS_1 = with_derivatives(np.append(0.0, (_SIGNS / _FACTORIALS[: 2 * _TERMS : 2])[1:]))


# Coordinates that rotate about y and z at the near and at the far end, and their selections.
_TURNS = np.array([[0, 1], [5, 4]])
_OF_ENDS = np.eye(6)[_TURNS][:, None]
# From (y, z) of the near and far vectors, each times (cos, sin) of half the twist, to the bows
# about y and z and the S about y and z: the rotations against the chord are -near and far.
_ONE_Y, _ONE_Z = [-1, 0, 0, -1, 0, 0, 0, 0], [0, 1, -1, 0, 0, 0, 0, 0]
_TWO_Y, _TWO_Z = [0, 0, 0, 0, 1, 0, 0, -1], [0, 0, 0, 0, 0, 1, 1, 0]
_SECTIONS = np.array([_ONE_Y, _ONE_Z, _TWO_Y, _TWO_Z], float)
_ONLY_S = np.eye(4)[:, 2:]
_BOW_AND_S = 0.5 * np.block([[np.eye(2), -np.eye(2)], [np.eye(2), np.eye(2)]]) @ _SECTIONS


def deformations(x: Array, ratios: Array) -> tuple[Jet, Jet]:
    """Twist (m,), and bow about y and z and S about y and z (m, 4), at coordinates x (m, 6).

    `ratios` (2,) are the parts of the S about y and about z that are slant; the rest is bending.
    """
    ends = _swing(x[:, _TURNS]).among(_OF_ENDS)  # (m, 2, 3): y, z, twist of the near and far end
    along = variables(x)[3]
    phi = along + ends[:, 0, 2] - ends[:, 1, 2]
    # Each rotated by half the twist, to the axes of the middle section.
    half = stacked([(0.5 * phi).cos(), (0.5 * phi).sin()])
    turned = ends[:, :, :2, None] * half[:, None, None, :]
    count = len(x)
    turns = Jet(
        turned.value.reshape(count, 8),
        turned.gradient.reshape(count, 8, 6),
        turned.hessian.reshape(count, 8, 6, 6),
    ).combined(_BOW_AND_S)
    # Bending in two planes winds the line: this rotation is no strain. Slanted sections rotate
    # about the chord, not about themselves, which is missing.
    winding = turns[:, 2:] * (1 - 2 * ratios) * turns[:, 1::-1]
    return phi - winding[:, 0] + winding[:, 1], turns


def sheared(stretch: Jet, turns: Jet, h: float, ratios: Array) -> tuple[Jet, Jet]:
    """Elongation and turns of a segment with shear deformation, from the exact strains.

    The slant is the part of the S due to shear; it does not decrease with h:

        gamma = r theta_a ,  r = f / (1/12 + f)  (`ratios`, of the S about y and z) .

    In the axes of the middle section, the chord of length h + u has the components h + e and h S:

        S = (1 + u/h) sin|gamma| gamma / |gamma| ,  e = (h + u) cos|gamma| - h .

    With theta_a + S - gamma in place of theta_a, and e + h S^2 / 2 in place of u, the energy of
    short segments is EA (e/h)^2 / 2 + GA_s S^2 / 2 a length: E. Reissner, On one-dimensional
    finite-strain beam theory: the plane problem, J. Appl. Math. Phys. 23, 1972.
    """
    slant = turns[:, 2:] * ratios
    squares = slant * slant
    w = squares[:, 0] + squares[:, 1]
    longer = 1.0 + (1 / h) * stretch
    across = slant * stacked([longer * w.apply(*power_series(_SINE_RATIO, w.value))] * 2)
    lengths = across * across
    bent = 0.5 * (lengths[:, 0] + lengths[:, 1])
    cosine_less_1 = w.apply(*power_series(_COSINE_LESS_1, w.value))
    along = stretch * (cosine_less_1 + 1.0) + h * (cosine_less_1 + bent)
    return along, turns + (across - slant).combined(_ONLY_S)


def _swing(angles: Array) -> Jet:
    """Ry(b) Rz(g) as (y, z, twist): a rotation vector (0, y, z), after or before a turn about e_x.

    The angle of the vector is acos(cos b cos g); the twist is 2 atan(tan(b/2) tan(g/2)).
    Angles (..., 2), found (..., 3) in these two variables.
    """
    both = stacked(variables(angles))
    sine, cosine, half = sines_of(angles), cosines_of(angles), sines_of(0.5 * angles)
    squares = both.apply(half * half, 0.5 * sine, 0.5 * cosine)
    p, q = squares[..., 0], squares[..., 1]
    w = p + q - 2 * (p * q)
    stretch = w.apply(*_turn(w.value))
    sines = both.apply(sine, cosine, -sine)
    cosine_z = both[..., 1].apply(cosine[..., 1], -sine[..., 1], -cosine[..., 1])
    y = stretch * (sines[..., 0] * cosine_z)
    z = stretch * sines[..., 1]
    tangents = (0.5 * both).tan()
    return stacked([y, z, 2 * (tangents[..., 0] * tangents[..., 1]).atan()])


def _turn(w: Array) -> tuple[Array, Array, Array]:
    """Angle over sine of an angle, by w = sin^2 of its half, with two derivatives.

    Recorded numbers have the series only: up to `SMALL_TURN`.
    """
    if w.dtype == object:
        h, h1, h2 = power_series(_STRETCH, w)
        return h, h1, h2
    small = w < SMALL_TURN
    h, h1, h2 = power_series(_STRETCH, np.where(small, w, 0.0))
    if small.all():
        return h, h1, h2
    v = np.where(small, 0.5, w)
    r = 2 * v * (1 - v)
    f = np.arcsin(np.sqrt(v)) / np.sqrt(v * (1 - v))
    f1 = (1 - (1 - 2 * v) * f) / r
    f2 = (2 * f - 3 * (1 - 2 * v) * f1) / r
    return np.where(small, h, f), np.where(small, h1, f1), np.where(small, h2, f2)
