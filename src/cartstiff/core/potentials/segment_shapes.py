"""Deformation of a beam segment from its six coordinates: bow, S, twist and slant.

All values have first and second derivatives (`cartstiff.core.geometry.jets`).
"""

from __future__ import annotations

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.geometry.jets import Jet, cosines_of, sines_of, stacked, variables

# Below this w, 0.6 rad, the series of asin(sqrt w) / sqrt(w (1 - w)) is exact to
# rounding.
SMALL_TURN = 0.09
_TURN_TERMS = np.cumprod([1.0, *((2 * k + 2) / (2 * k + 3) for k in range(18))])
# Number of terms of the sine and cosine of a slant.
_TERMS = 20


def with_derivatives(c: Array) -> Array:
    """Coefficients (terms, 3) of a power series and its first two derivatives."""
    k = np.arange(c.size)
    columns = np.zeros((c.size, 3))
    columns[:, 0], columns[:-1, 1], columns[:-2, 2] = (
        c,
        (k * c)[1:],
        (k * (k - 1) * c)[2:],
    )
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
_COSINE_LESS_1 = with_derivatives(
    np.append(0.0, (_SIGNS / _FACTORIALS[: 2 * _TERMS : 2])[1:])
)


# Coordinates that rotate about y and z at the near and at the far end, and their
# selections.
_TURNS = np.array([[0, 1], [5, 4]])
_OF_ENDS = np.eye(6)[_TURNS][:, None]
# From (y, z) of the near and far vectors, each times (cos, sin) of half the twist, to the
# bows about y and z and the S about y and z: the rotations against the chord are -near
# and far.
_ONE_Y, _ONE_Z = [-1, 0, 0, -1, 0, 0, 0, 0], [0, 1, -1, 0, 0, 0, 0, 0]
_TWO_Y, _TWO_Z = [0, 0, 0, 0, 1, 0, 0, -1], [0, 0, 0, 0, 0, 1, 1, 0]
_SECTIONS = np.array([_ONE_Y, _ONE_Z, _TWO_Y, _TWO_Z], float)
_ONLY_S = np.eye(4)[:, 2:]
_BOW_AND_S = 0.5 * np.block([[np.eye(2), -np.eye(2)], [np.eye(2), np.eye(2)]]) @ _SECTIONS


def deformations(x: Array, ratios: Array) -> tuple[Jet, Jet]:
    """Twist (m,), and bow about y and z and S about y and z (m, 4),
    at coordinates x (m, 6).

    `ratios` (2,) are the parts of the S about y and about z that are slant; the rest is
    bending.
    """
    ends = _swing(x[:, _TURNS]).among(
        _OF_ENDS
    )  # (m, 2, 3): y, z, twist of the near and far end
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
    # Bending in two planes winds the line: this rotation is no strain. Slanted sections
    # rotate about the chord, not about themselves, which is missing.
    winding = turns[:, 2:] * (1 - 2 * ratios) * turns[:, 1::-1]
    return phi - winding[:, 0] + winding[:, 1], turns


def sheared(stretch: Jet, turns: Jet, h: float, ratios: Array) -> tuple[Jet, Jet]:
    """Elongation and turns of a segment with shear deformation, from the exact strains.

    The slant is the part of the S due to shear; it does not decrease with h:

        gamma = r theta_a ,  r = f / (1/12 + f)  (`ratios`, of the S about y and z) .

    In the axes of the middle section, the chord of length h + u has the components h + e
    and h S:

        S = (1 + u/h) sin|gamma| gamma / |gamma| ,  e = (h + u) cos|gamma| - h .

    With theta_a + S - gamma in place of theta_a, and e + h S^2 / 2 in place of u, the
    energy of short segments is EA (e/h)^2 / 2 + GA_s S^2 / 2 a length: E. Reissner, On
    one-dimensional finite-strain beam theory: the plane problem, J. Appl. Math. Phys. 23,
    1972.
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


def internal_twist(
    twist: Array, turns: Array, stiffer: float, torsion: float, ratios: Array, axis: int
) -> tuple[Array, Array, Array]:
    r"""Energy (m,) of the coupling of bending and torsion within segments,
    with derivatives.

    Where a section is bent about its soft axis s, its stiff bending p = `axis` turns with
    the section: its curvature is that of the line along the turned axis. With chi the
    turn of the sections along the segment, of xi from -1/2 to 1/2, and s = +1 for p = y
    and -1 for p = z,

        U = D / 2h int [P (k_p + s chi k_s)]^2 - k_p^2 + GJ / 2h int chi'^2 , D = EI_p -
        EI_s ,

        k = alpha + 12 beta xi ,  alpha = -2 bow ,  beta = S  (of S the part that bends).

    P is the projection on 1 and xi: any other curvature is made up for by bending between
    the ends, which costs nothing to this order. The turn chi = phi xi + further turns
    that vanish at the ends minimises U. These enter by three moments, and with their
    flexibility (``int 1, xi, xi^2`` of the turn of a bar of unit torsion stiffness under
    1, xi, xi^2)

        F = h / GJ [[alpha^2 / 12 + beta^2 / 5, 2 sqrt(3) alpha beta / 15],
                    [                      ..., alpha^2 / 60 + 3 beta^2 / 7]]

        U = 1/2 d^T (W^-1 + F)^-1 d - 1/2 k^T W k ,  W = D / h diag(1, 1 - r_p) ,
        k = (alpha_p, sqrt(12) beta_p) ,  d = k + s phi (beta_s, alpha_s / sqrt(12)) .

    Torsion is thus a spring in series with the stiff bending: support stiffness of a leaf
    spring that is bent decreases with the square of its deflection. In a straight segment
    U is zero with all derivatives.

    Parameters
    ----------
    twist, turns : ndarray (m,), (m, 4)
        phi; bows about y and z, and S about y and z.
    stiffer, torsion : float
        D / h and GJ / h.
    ratios : ndarray (2,)
        Parts of the S about y and z that are slant.
    axis : {0, 1}
        Stiff axis: y or z.

    Returns
    -------
    energy : ndarray (m,)
    slopes : ndarray (m, 5)
        By the four turns and the twist.
    curvatures : ndarray (m, 5, 5)
    """
    soft, sign = 1 - axis, 1.0 - 2.0 * axis
    root = np.sqrt(12.0)
    bends = 1.0 - float(ratios[soft])
    # Names as above, with sqrt(12) taken into k_1 and d_1.
    alpha, beta, chi = -2.0 * turns[:, soft], bends * turns[:, 2 + soft], sign * twist
    k = [-2.0 * turns[:, axis], root * turns[:, 2 + axis]]
    w = [stiffer, stiffer * (1.0 - float(ratios[axis]))]
    delta = [chi * beta, chi * alpha / root]
    d = [k[0] + delta[0], k[1] + delta[1]]
    c, mixed = 1.0 / torsion, root / 15.0
    # Flexibility of the turns that vanish at the ends.
    F00 = c * (alpha * alpha / 12.0 + beta * beta / 5.0)
    F01 = c * mixed * (alpha * beta)
    F11 = c * (alpha * alpha / 60.0 + 3.0 / 7.0 * (beta * beta))
    product = F00 * F11 - F01 * F01
    scale = 1.0 / (1.0 + w[0] * F00 + w[1] * F11 + w[0] * w[1] * product)
    # W less (W^-1 + F)^-1.
    R00 = w[0] * w[0] * scale * (F00 + w[1] * product)
    R11 = w[1] * w[1] * scale * (F11 + w[0] * product)
    R01 = w[0] * w[1] * scale * F01
    # Forces t along d; the energy as a difference, whose digits a small twist keeps.
    lost = [R00 * d[0] + R01 * d[1], R01 * d[0] + R11 * d[1]]
    t = [w[0] * d[0] - lost[0], w[1] * d[1] - lost[1]]
    stored = [w[i] * delta[i] * (2.0 * k[i] + delta[i]) - d[i] * lost[i] for i in (0, 1)]
    energy = 0.5 * (stored[0] + stored[1])
    # By alpha, beta, k_0, k_1, chi: rates of d, F t and the rest.
    zero, one = 0.0 * chi, 0.0 * chi + 1.0
    rates = [
        (zero, chi / root),
        (chi, zero),
        (one, zero),
        (zero, one),
        (beta, alpha / root),
    ]
    # How F changes, along the forces.
    bent = [
        (
            c * (alpha / 6.0 * t[0] + mixed * beta * t[1]),
            c * (mixed * beta * t[0] + alpha / 30.0 * t[1]),
        ),
        (
            c * (0.4 * beta * t[0] + mixed * alpha * t[1]),
            c * (mixed * alpha * t[0] + 6.0 / 7.0 * (beta * t[1])),
        ),
        *[(zero, zero)] * 3,
    ]
    # First derivatives; those by k are exact differences, which keep their digits near
    # zero.
    slopes = [
        r[0] * t[0] + r[1] * t[1] - 0.5 * (b[0] * t[0] + b[1] * t[1])
        for r, b in zip(rates, bent, strict=True)
    ]
    slopes[2], slopes[3] = w[0] * delta[0] - lost[0], w[1] * delta[1] - lost[1]
    # Second derivatives: of the forces, then of F and of the products in d.
    e = [(r[0] - b[0], r[1] - b[1]) for r, b in zip(rates, bent, strict=True)]
    Re = [(R00 * x + R01 * y, R01 * x + R11 * y) for x, y in e]
    curvatures = [[zero] * 5 for _ in range(5)]
    for i in range(5):
        for j in range(i + 1):
            own = -(e[i][0] * Re[j][0] + e[i][1] * Re[j][1])
            if not {i, j} <= {2, 3}:
                own = own + w[0] * (e[i][0] * e[j][0]) + w[1] * (e[i][1] * e[j][1])
            curvatures[i][j] = own
    curvatures[0][0] = curvatures[0][0] - c * (t[0] * t[0] / 12.0 + t[1] * t[1] / 60.0)
    curvatures[1][1] = curvatures[1][1] - c * (
        t[0] * t[0] / 5.0 + 3.0 / 7.0 * (t[1] * t[1])
    )
    curvatures[1][0] = curvatures[1][0] - c * mixed * (t[0] * t[1])
    curvatures[4][0] = curvatures[4][0] + t[1] / root
    curvatures[4][1] = curvatures[4][1] + t[0]
    # To the turns and the twist.
    places = [soft, 2 + soft, axis, 2 + axis, 4]
    factors = [-2.0, bends, -2.0, root, sign]
    gradient = np.zeros((len(twist), 5), twist.dtype)
    hessian = np.zeros((len(twist), 5, 5), twist.dtype)
    for i, (at, factor) in enumerate(zip(places, factors, strict=True)):
        gradient[:, at] = factor * slopes[i]
        for j in range(i + 1):
            value = factor * factors[j] * curvatures[i][j]
            hessian[:, at, places[j]] = hessian[:, places[j], at] = value
    return energy, gradient, hessian


def _swing(angles: Array) -> Jet:
    """Ry(b) Rz(g) as (y, z, twist): a rotation vector (0, y, z),
    after or before a turn about e_x.

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
    v = np.where(small, 0.5, np.where(w < 1.0, w, np.nan))  # half a turn has none
    r = 2 * v * (1 - v)
    f = np.arcsin(np.sqrt(v)) / np.sqrt(v * (1 - v))
    f1 = (1 - (1 - 2 * v) * f) / r
    f2 = (2 * f - 3 * (1 - 2 * v) * f1) / r
    return np.where(small, h, f), np.where(small, h1, f1), np.where(small, h2, f2)
