r"""Beams that feel their own axial force: segments with exact stability functions.

A segment of length h is seen from its chord, the straight line between its ends. What is
left of the motion is small: the elongation u of the chord, a twist phi, and at each end
the rotation of the section against the chord. In each plane of bending the two rotations
are taken apart into theta_s = (theta_1 - theta_2) / 2, a bow, and theta_a = (theta_1 +
theta_2) / 2, an S. The differential equation of a beam under an axial force N (tension
positive) is solved exactly:

    U = G J phi^2 / 2h + max_N [ N u - N^2 h / 2EA + sum (s_s(N) theta_s^2 + s_a(N)
    theta_a^2) ] , s_s = (2EI/h) y ,  s_a = (EI/2h) b / (b^2 z + f y) , y = m coth m ,  z
    = (y - 1) / 4m^2 ,  4 m^2 = N b h^2 / EI ,

with b = 1 - N / GA_s and f = EI / (GA_s h^2) for a section that yields to shear (b = 1, f
= 0 for one that does not). Of a section that yields, the slant is no small turn: it
enters by its sine and cosine (`cartstiff.core.potentials.segment_shapes.sheared`). What
is maximised is concave in N; at the maximum elongation and bowing together make up u. So
the energy is one of the relative pose of the ends, and the axial force, the end moments
and the tangent stiffness are its derivatives.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import Any, ClassVar, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, read_only
from cartstiff.core.geometry.jets import Jet, variables
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import (
    BEAM,
    Evaluation,
    Number,
    Posture,
    Potential,
)
from cartstiff.core.potentials.segment_shapes import (
    deformations,
    internal_twist,
    power_series,
    sheared,
    with_derivatives,
)

# Below this |x| the series of z(x) is exact to rounding with the terms kept (it converges
# up to 4 pi^2); above it the closed forms, and their derivatives by recursion, lose less
# than a digit.
SERIES = 4.0
_TERMS = 20
# Bounds of the axial force, as a share of the clamped buckling load (under tension: of
# the shear stiffness); beyond them the force is constant, as in a buckled bar. Forces
# within the relative distance _AT_BOUND of a bound are at it, as bisection has ended
# there.
_LARGEST_SHARE, _AT_BOUND = 0.999, numerics.ROUNDOFF
_MAX_STEPS = 100
# Least share of the clamped buckling load, and least turn against the chord [rad], for
# the notes that ask for more segments; and least relative error of a stiffness.
_NOTED_COMPRESSION, _NOTED_TURN, _NOTED_ERROR = 0.75, 0.4, 0.03
# Relative errors of stiffnesses as shares of the squares of turns, found beside beams of
# eight and sixteen segments: of leaf springs in an S, where torsion and bending are
# coupled, and else.
_ERROR_OF_S, _ERROR_OF_TURNS = 1.2, 0.1


def _series() -> Array:
    """Coefficients (terms, 3) of z(x) and its derivatives,
    from 2 x z' = 1/4 - 3 z - x z^2.
    """
    c = [1 / 12]
    for k in range(1, _TERMS):
        c.append(-sum(c[i] * c[k - 1 - i] for i in range(k)) / (2 * k + 3))
    return with_derivatives(np.array(c))


_Z = _series()


def stability_functions(x: Array) -> tuple[Array, Array, Array]:
    """z(x) = (m coth m - 1) / x with 4 m^2 = x, and its first two derivatives.

    x = N h^2 / EI is positive under tension, and above -4 pi^2, where a clamped segment
    buckles. Recorded numbers (an array of objects) have the series only: up to `SERIES`.
    """
    if x.dtype == object:
        z, z1, z2 = power_series(_Z, x)
        return z, z1, z2
    small = np.abs(x) < SERIES
    z, z1, z2 = power_series(_Z, np.where(small, x, 0.0))
    if small.all():
        return z, z1, z2
    far = np.where(small, SERIES, x)
    m = 0.5 * np.sqrt(np.abs(far))
    # (m / sinh m)^2, which underflows before its parts overflow.
    r = np.where(far > 0, m / np.sinh(np.minimum(m, 300.0)), m / np.sin(m)) ** 2
    y = np.where(far > 0, m / np.tanh(m), m / np.tan(m))
    f = (y - 1) / far
    f1 = (2 - y - r) / (2 * far * far)
    f2 = ((r * f - (y - r) / (2 * far)) / (2 * far) - 2 * f1) / far
    return np.where(small, z, f), np.where(small, z1, f1), np.where(small, z2, f2)


class Section(NamedTuple):
    """Stiffnesses of a beam's section.

    Attributes
    ----------
    axial, torsion : float
        EA (force) and GJ (force length^2).
    bending : tuple of float
        EI about y and about z (force length^2).
    shear : tuple of float
        GA_s for the force along z, which bends about y, and along y, which bends about z;
        infinite without shear deformation (Euler-Bernoulli).
    """

    axial: float
    torsion: float
    bending: tuple[float, float]
    shear: tuple[float, float] = (np.inf, np.inf)

    @property
    def length_powers(self) -> dict[str, int]:
        """See `cartstiff.core.potentials.contract.rescaled`."""
        return {"torsion": 2, "bending": 2}

    def times(self, factor: float) -> Section:
        """A section that is stiffer by a factor in every way."""
        (bend_y, bend_z), (shear_z, shear_y) = self.bending, self.shear
        return Section(
            factor * self.axial,
            factor * self.torsion,
            (factor * bend_y, factor * bend_z),
            (factor * shear_z, factor * shear_y),
        )


class _Segments(NamedTuple):
    """Segments of a beam: energies (m,), gradients (m, 6), Hessians (m, 6, 6),
    axial forces (m,).

    `turns` (m,) is the larger of the sections' turns against the chord and the twist
    [rad], and `errors` (m,) the estimated relative error of the stiffness.
    """

    energies: Array
    gradients: Array
    hessians: Array
    axial_forces: Array
    turns: Array
    errors: Array


@dataclass(frozen=True, eq=False)
class Beam(Potential):
    """A straight beam in equal segments, each with six coordinates.

    Per segment, in the order of the chain: rotations about y and z from the near section
    to the chord, elongation, twist, rotations about z and y from the chord to the far
    section (the joints of `cartstiff.files.tree_building.SEGMENT`).

    Attributes
    ----------
    indices : ndarray of int, shape (m, 6)
        Coordinates of the m segments.
    length : float
        Length of one segment.
    section : Section
        Stiffnesses of the section.
    link : str
        Name of the link, for diagnostics.
    mass : float
        The beam's own [kg], which is part of the joints' inertias at its nodes; 0 if not
        given.
    outline : tuple of float or None
        Young's and shear modulus, and distances along y and z of the outermost fibres.
    """

    indices: Array
    length: float
    section: Section
    link: str = ""
    mass: float = 0.0
    outline: tuple[float, float, float, float] | None = None

    length_powers: ClassVar = {"length": 1, "section": 0, "outline": (-2, -2, 1, 1)}
    stem: ClassVar = "coupled springs "
    cost = 16
    is_scaled = True

    def __post_init__(self) -> None:
        indices = np.array(self.indices, int).reshape(-1, 6)
        indices.flags.writeable = False
        object.__setattr__(self, "indices", indices)

    @cached_property
    def common(self) -> Hashable:  # type: ignore[override]
        """The segment."""
        return self.length, self.section

    @cached_property
    def _straight(self) -> Array:
        """Hessian (m, 6, 6) of the undeformed beam."""
        return read_only(self._evaluated(np.zeros(self.indices.shape)).hessians)

    @property
    def members(self) -> tuple[int, ...]:  # type: ignore[override]
        """The coordinates of all segments."""
        return tuple(self.indices.ravel().tolist())

    @property
    def own_stiffness(self) -> Array:
        """Hessian (6 m, 6 m) of the undeformed beam."""
        straight = self._straight
        K = np.zeros((len(straight), 6, len(straight), 6))
        K[range(len(straight)), :, range(len(straight))] = straight
        return K.reshape(6 * len(straight), -1)

    def _key(self, names: Sequence[str]) -> str:
        return f"{self.link or names[0].rpartition('.')[0]}{BEAM}"

    def compliances(
        self,
        names: Sequence[str],
        slides: Sequence[bool],  # noqa: ARG002
    ) -> dict[str, Number]:
        """The share of its own compliance: one axis has none of its own."""
        return {self._key(names): Number(1.0, is_positive=True)}

    def with_compliances(self, values: Mapping[str, float], names: Sequence[str]) -> Beam:
        """The same with a share of its compliance."""
        share = values.get(self._key(names), 1.0)
        return self if share == 1.0 else self.times(1.0 / share)

    def softened(self, key: str, names: Sequence[str]) -> tuple[Beam, Beam, float]:  # noqa: ARG002
        """The beam, twice as stiff."""
        return self.times(2.0), self, -1.0

    def times(self, factor: float) -> Beam:
        """The same, stiffer by a factor."""
        return replace(self, section=self.section.times(factor))

    def stress(self, wrench: Array) -> float | None:
        r"""Equivalent stress ``sqrt(sigma^2 + 3 tau^2)`` at the corner of the outline.

        ``sigma = E (|N| / EA + |M_y| z / EI_y + |M_z| y / EI_z)`` and, as of a round
        section, ``tau = G |T| r / GJ`` with the larger r of y and z.
        """
        if self.outline is None:
            return None
        E, G, y, z = self.outline
        T, M_y, M_z, N = np.abs(wrench[:4]).tolist()
        section = self.section
        bent = M_y * z / section.bending[0] + M_z * y / section.bending[1]
        sigma = E * (N / section.axial + bent)
        return float(np.hypot(sigma, np.sqrt(3.0) * G * T * max(y, z) / section.torsion))

    def in_file(self, entry: Mapping[str, Any]) -> dict[str, Any]:
        """E and G of the beam, by which its torsion is its own."""
        beam = entry["beam"]
        factor = self.section.torsion / (beam["G"] * beam["J"])
        return {"beam": {**beam, "E": beam["E"] * factor, "G": beam["G"] * factor}}

    def numbers(self, names: Sequence[str]) -> dict[str, Number]:
        """A factor on its stiffness."""
        return {f"stiffness.{names[0]}": Number(1.0, is_positive=True)}

    def with_numbers(self, values: Mapping[str, float], names: Sequence[str]) -> Beam:
        """The same, stiffer by a factor."""
        factor = values.get(f"stiffness.{names[0]}", 1.0)
        return self if factor == 1.0 else self.times(factor)

    def evaluate(self, posture: Posture) -> Evaluation:
        """Energy, gradient and Hessian."""
        x = posture.q[self.indices]
        n, at = posture.q.size, self.indices
        gradient, hessian = np.zeros(n), np.zeros((n, n))
        if not x.any():
            hessian[at[:, :, None], at[:, None, :]] = self._straight
            return Evaluation(0.0, gradient, hessian)
        energies, gradients, hessians = self._segments(x)[:3]
        gradient[at] = gradients
        hessian[at[:, :, None], at[:, None, :]] = hessians
        return Evaluation(float(energies.sum()), gradient, hessian)

    def is_bent(self, posture: Posture) -> bool:
        """Whether a segment is deflected."""
        return bool(posture.q[self.indices].any())

    def prepare(self, alike: Sequence[Beam], posture: Posture) -> None:
        """Find the segments of all at once."""
        each = [(beam, posture.q[beam.indices]) for beam in alike]
        if all(x.tobytes() in beam._last for beam, x in each):
            return
        found, start = each[0][0]._evaluated(np.concatenate([x for _, x in each])), 0
        for beam, x in each:
            beam._last.clear()
            own = slice(start, start := start + len(x))
            beam._last[x.tobytes()] = _Segments(*(part[own] for part in found))

    def axial_forces(self, q: Array) -> Array:
        """Tension (m,) of the segments."""
        return self._segments(q[self.indices]).axial_forces.copy()

    def diagnostics(self, posture: Posture) -> list[Note]:
        """Notes on segments with too much compression or bending for six coordinates."""
        x = posture.q[self.indices]
        diagnostics: list[Note] = []
        if not x.any():
            return diagnostics
        _, _, _, N, turns, errors = self._segments(x)
        bent, error = float(turns.max()), float(errors.max())
        share = -float(N.min()) / self.clamped_load
        count = len(self.indices)
        many = f"beam {self.link!r} with {count} segment{'s' if count > 1 else ''}"
        if share > _NOTED_COMPRESSION:
            message = (
                f"{many}: one carries {100 * share:.0f} % of the load at which it "
                "buckles between "
                "clamped ends, which its six coordinates do not show: give more segments"
            )
            values = {"link": self.link, "share": share, "segments": count}
            diagnostics.append(Note("beam-compressed", message, values))
        if bent > _NOTED_TURN or error > _NOTED_ERROR:
            message = (
                f"{many}: one turns by {bent:.2g} rad against its chord, so that "
                f"stiffnesses may be wrong by about {100 * error:.2g} %: give more "
                f"segments (segments: {2 * count})"
            )
            values = {"link": self.link, "turn": bent, "segments": count, "error": error}
            diagnostics.append(Note("beam-bent", message, values))
        return diagnostics

    @property
    def clamped_load(self) -> float:
        """Compression at which one segment buckles between clamped ends."""
        return -self._lowest

    @cached_property
    def _lowest(self) -> float:
        # Haringx: P (1 + P / GA_s) = 4 pi^2 EI / h^2.
        euler = 4 * (pi / self.length) ** 2 * np.array(self.section.bending)
        limits = 2 * euler / (1 + np.sqrt(1 + 4 * euler / np.array(self.section.shear)))
        return -float(limits.min())

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the axial force."""
        return _LARGEST_SHARE * self._lowest, _LARGEST_SHARE * min(self.section.shear)

    @cached_property
    def _last(self) -> dict[bytes, _Segments]:
        """The last result by coordinates, for diagnostics after the energy."""
        return {}

    def _segments(self, x: Array) -> _Segments:
        """The segments at coordinates x (m, 6)."""
        key = x.tobytes()
        segments = self._last.get(key)
        if segments is None:
            segments = self._evaluated(x)
            self._last.clear()
            self._last[key] = segments
        return segments

    def _evaluated(self, x: Array) -> _Segments:
        phi, stretch, turns = shapes = self.shapes(x)
        N, *rotational = self._axial_force(stretch.value, turns.value)
        # N is stationary, unless it is at a bound.
        low, high = self.bounds
        at_bound = ((1 - _AT_BOUND) * low >= N) | ((1 - _AT_BOUND) * high <= N)
        terms = self.terms(shapes, N, rotational, np.where(at_bound, 0.0, 1.0))
        bent = np.maximum(np.abs(phi.value), np.abs(turns.value).max(axis=-1))
        return _Segments(*terms, N, bent, self._errors(bent, turns.value))

    def _errors(self, bent: Array, turns: Array) -> Array:
        """Estimated relative errors (m,) of the stiffness of segments with
        turns (m, 4).
        """
        errors = _ERROR_OF_TURNS * bent * bent
        about_y, about_z = self.section.bending
        if about_y == about_z:
            return errors
        soft = int(about_y > about_z)
        S = (1.0 - self._slants[soft]) * turns[:, 2 + soft]
        # Flexibility of the torsion against that of the stiff bending, see
        # `internal_twist`.
        share = abs(about_z - about_y) / self.section.torsion * (3.0 / 7.0) * S * S
        return errors + _ERROR_OF_S * S * S * share / (1.0 + share)

    def segments(self, x: Array) -> tuple[Array, Array, Array]:
        """Energies (m,), gradients (m, 6), Hessians (m, 6, 6) of segments at coordinates
        x (m, 6).
        """
        return self._evaluated(x)[:3]

    def shapes(self, x: Array) -> tuple[Jet, Jet, Jet]:
        """Twist (m,), elongation (m,), turns (m, 4) of segments at
        coordinates x (m, 6).
        """
        h, ratios = self.length, self._slants
        phi, turns = deformations(x, ratios)
        stretch = variables(x)[2]
        if ratios.any():
            stretch, turns = sheared(stretch, turns, h, ratios)
        return phi, stretch, turns

    def terms(
        self,
        shapes: tuple[Jet, Jet, Jet],
        N: Array,
        rotational: Sequence[Array],
        follows: Array,
    ) -> tuple[Array, Array, Array]:
        """Energies (m,), gradients (m, 6) and Hessians (m, 6, 6) under axial
        forces N (m,).

        From `shapes`, `rotational` at N, and `follows`: 1 where N depends on the
        elongation, 0 at a bound.
        """
        (phi, stretch, turns), (s, s1, s2), h = shapes, rotational, self.length
        u, theta = stretch.value, turns.value
        squares = theta * theta
        torsion = self.section.torsion / h
        energy = N * u - N * N * h / (2 * self.section.axial) + (s * squares).sum(axis=-1)
        energy = energy + 0.5 * torsion * (phi.value * phi.value)
        moments, torque = 2 * s * theta, torsion * phi.value
        mixed = stretch.gradient.copy()  # d^2 U / dN dx
        gradient = N[:, None] * stretch.gradient
        hessian = torsion * (phi.gradient[:, :, None] * phi.gradient[:, None, :])
        hessian = hessian + N[:, None, None] * stretch.hessian
        about_y, about_z = self.section.bending
        if about_y != about_z:
            more = self._internal_twist(phi.value, theta)
            energy = energy + more[0]
            moments, torque = moments + more[1][:, :4], torque + more[1][:, 4]
            rates = np.concatenate([turns.gradient, phi.gradient[:, None]], axis=1)
            hessian = hessian + rates.swapaxes(1, 2) @ (more[2] @ rates)
        gradient = gradient + torque[:, None] * phi.gradient
        hessian = hessian + torque[:, None, None] * phi.hessian
        G = turns.gradient
        gradient = gradient + (moments[:, None] @ G)[:, 0]
        mixed = mixed + ((2 * s1 * theta)[:, None] @ G)[:, 0]
        hessian = hessian + np.einsum("mk,mkab->mab", moments, turns.hessian)
        hessian = hessian + G.swapaxes(1, 2) @ ((2 * s)[:, :, None] * G)
        answers = follows / (h / self.section.axial - (s2 * squares).sum(axis=-1))
        hessian = hessian + answers[:, None, None] * mixed[:, :, None] * mixed[:, None, :]
        return energy, gradient, hessian

    def _internal_twist(self, twist: Array, turns: Array) -> tuple[Array, Array, Array]:
        """See `internal_twist`."""
        about_y, about_z = self.section.bending
        h = self.length
        return internal_twist(
            twist,
            turns,
            abs(about_z - about_y) / h,
            self.section.torsion / h,
            self._slants,
            int(about_z > about_y),
        )

    @cached_property
    def _slants(self) -> Array:
        """Parts (2,) of the S about y and about z that are slant."""
        f = np.array(self.section.bending) / (
            np.array(self.section.shear) * self.length**2
        )
        return f / (1 / 12 + f)

    def _axial_force(self, u: Array, theta: Array) -> tuple[Array, Array, Array, Array]:
        """Tension at which elongation and bowing add up to u,
        by Newton's method in a bracket.

        Also s (m, 4) at that tension, with its first two derivatives by N.
        """
        squares, softness = theta * theta, self.length / self.section.axial
        low, high = (np.full(u.shape, bound) for bound in self.bounds)
        N = np.zeros(u.shape)
        for _ in range(_MAX_STEPS):
            s, s1, s2 = self.rotational(N)
            missing = u - N * softness + (s1 * squares).sum(axis=-1)
            low, high = np.where(missing > 0, N, low), np.where(missing < 0, N, high)
            step = missing / (softness - (s2 * squares).sum(axis=-1))
            # Round-off of the sum, and of N itself.
            if (
                np.abs(step)
                <= numerics.TWO_UNITS_IN_LAST_PLACE * (np.abs(N) + np.abs(u) / softness)
            ).all():
                break
            following = N + step
            outside = (following < low) | (following > high)
            middle = np.where(
                np.isfinite(high), 0.5 * (low + high), 2 * np.abs(low) + low
            )
            N = np.where(outside, middle, following)
        return N, s, s1, s2

    def rotational(self, N: Array) -> tuple[Array, Array, Array]:
        """Rotational stiffnesses (m, 4) under axial forces N (m,), s_s about y and z, s_a
        about y and z, and their first two derivatives by N.
        """
        h = self.length
        EI, GA = np.array(self.section.bending), np.array(self.section.shear)
        b, b1, f = 1 - N[:, None] / GA, -1 / GA, EI / (GA * h * h)
        c = h * h / EI
        x, x1, x2 = c * N[:, None] * b, c * (1 - 2 * N[:, None] / GA), -2 * c / GA
        # Bow and double bow, each with two derivatives by the normal force.
        z, dz, ddz = stability_functions(x)
        z1, z2 = dz * x1, ddz * x1 * x1 + dz * x2
        y, y1, y2 = 1 + x * z, x1 * z + x * z1, x2 * z + 2 * x1 * z1 + x * z2
        d = b * b * z + f * y
        d1 = 2 * b * b1 * z + b * b * z1 + f * y1
        d2 = 2 * b1 * b1 * z + 4 * b * b1 * z1 + b * b * z2 + f * y2
        a = b / d
        a1 = (b1 - a * d1) / d
        a2 = -(2 * a1 * d1 + a * d2) / d
        bow, double = 2 * EI / h, EI / (2 * h)
        pairs = ((bow * y, double * a), (bow * y1, double * a1), (bow * y2, double * a2))
        s, s1, s2 = (np.concatenate(pair, axis=-1) for pair in pairs)
        return s, s1, s2
