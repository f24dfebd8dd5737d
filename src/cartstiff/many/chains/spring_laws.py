"""Nonlinear joint springs on recording numbers: the laws of `potentials.springs`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff import numerics
from cartstiff.many.arithmetic import ENGINE, PLAIN
from cartstiff.many.tape import Scalar, Tape, absolute, larger, pick
from cartstiff.potentials.springs import PolynomialLaw, SpringLaw, TabulatedLaw

#: Points of a table that is recorded: every piece is a choice of six numbers.
_POINTS = 33
#: Newton steps to a deflection, and what the last of them may change, as a share of it.
_STEPS, _CHANGED = 8, numerics.LAST_DIGITS**0.5
#: Share of the way to where a law no longer rises that is trusted.
_RISING = 0.99


def is_recorded(law: SpringLaw) -> bool:
    """Whether a law is recorded here."""
    small = type(law) is TabulatedLaw and len(law.deflections) <= _POINTS
    return small or type(law) is PolynomialLaw


def stretched(law: SpringLaw, x: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Energy, torque and tangent stiffness at a deflection."""
    if isinstance(law, TabulatedLaw):
        return law._on(_piece(law, x, law.deflections), x)
    energy: Scalar = 0.0
    torque: Scalar = 0.0
    stiffness: Scalar = 0.0
    for power, c in reversed(list(enumerate(_coefficients(law), start=1))):
        energy, torque = (energy + c / (power + 1)) * x, (torque + c) * x
        stiffness = stiffness * x + c * power
    return energy * x, torque, stiffness


def deflection_for(law: SpringLaw, torque: Scalar) -> tuple[Scalar, Scalar]:
    """Deflection that carries a torque, and the verdict on it.

    On the part of a polynomial that rises through zero it is the root of smallest size; of a table,
    where it rises or falls everywhere, there is one.
    """
    if isinstance(law, TabulatedLaw):
        return _in_table(law, torque)
    c = np.array(_coefficients(law))
    turning = np.polynomial.polynomial.Polynomial(c * np.arange(1, len(c) + 1)).roots()
    real = np.abs(turning[np.abs(turning.imag) <= numerics.CLOSE * (1.0 + np.abs(turning))])
    x, verdict = _found(law, torque, torque * (1.0 / c[0]) if c[0] else np.nan)
    if real.size:
        verdict = larger(verdict, pick(absolute(x), _RISING * float(real.min()), PLAIN, ENGINE))
    return x, verdict


def _coefficients(law: SpringLaw) -> tuple[float, ...]:
    if not isinstance(law, PolynomialLaw):
        raise TypeError(law)
    return tuple(map(float, law.coefficients))


def _piece(law: TabulatedLaw, x: Scalar, knots: tuple[float, ...]) -> list[Scalar]:
    """The row of a table's pieces in which x lies, behind how many of the ascending knots."""
    rows = law._pieces.tolist()
    found: list[Scalar] = list(rows[-1])
    for row, knot in reversed(list(zip(rows[:-1], knots, strict=True))):
        found = [pick(x, knot, here, behind) for here, behind in zip(row, found, strict=True)]
    return found


def _in_table(law: TabulatedLaw, torque: Scalar) -> tuple[Scalar, Scalar]:
    y = np.array(law.torques)
    if not ((np.diff(y) > 0.0).all() and law._pieces[[0, -1], 3].all()):
        return 0.0, ENGINE
    start, verdict = _piece(law, torque, law.torques), PLAIN
    # The piece is known: its cubic alone is solved, from the straight line through its ends.
    secants = np.diff(y) / np.diff(law.deflections)
    slopes = [law._pieces[0, 3], *secants.tolist(), law._pieces[-1, 3]]
    slope: Scalar = slopes[-1]
    for own, knot in reversed(list(zip(slopes[:-1], law.torques, strict=True))):
        slope = pick(torque, knot, own, slope)
    knot, _, at_knot, *rest = start
    d = (torque - at_knot) / slope
    step: Scalar = 0.0
    for _ in range(_STEPS):
        value = d * (rest[0] + d * (rest[1] + d * rest[2]))
        step = (torque - at_knot - value) / (rest[0] + d * (2.0 * rest[1] + 3.0 * d * rest[2]))
        d = d + step
    return knot + d, larger(verdict, _settled(step, absolute(d)))


def _found(law: SpringLaw, torque: Scalar, x: Scalar) -> tuple[Scalar, Scalar]:
    """The deflection after Newton steps from x."""
    step: Scalar = 0.0
    for _ in range(_STEPS):
        _, own, stiffness = stretched(law, x)
        step = (torque - own) / stiffness
        x = x + step
    return x, _settled(step, absolute(x))


def _settled(step: Scalar, size: Scalar) -> Scalar:
    """Whether the last step has changed little; what is left is its square."""
    return pick(absolute(step), size * _CHANGED + numerics.TINY, PLAIN, ENGINE)


class JointSpringNumbers:
    """Springs of the coordinates, linear and not, as numbers on a tape.

    Attributes
    ----------
    verdict : the verdict on the deflections that were found.
    """

    def __init__(self, tape: Tape, n: int, laws: Sequence[tuple[int, SpringLaw]]) -> None:
        self._stiffness, self._rest = tape.vector("stiffness", n), tape.vector("rest", n)
        self._laws = dict(laws)
        self.verdict: Scalar = PLAIN

    def at(self, a: int, q: Scalar) -> tuple[Scalar, Scalar, Scalar]:
        """Energy, torque and stiffness of a spring whose rest position is given."""
        stretch = q - self._rest[a]
        if a in self._laws:
            return stretched(self._laws[a], stretch)
        k = self._stiffness[a]
        return k * stretch * stretch * 0.5, k * stretch, k

    def under(self, a: int, torque: Scalar) -> tuple[Scalar, Scalar]:
        """Energy and stiffness of a spring whose rest position is chosen: it exerts the torque."""
        if a not in self._laws:
            k = self._stiffness[a]
            return torque * torque / k * 0.5, k
        x, verdict = deflection_for(self._laws[a], torque)
        self.verdict = larger(self.verdict, verdict)
        energy, _, k = stretched(self._laws[a], x)
        return energy, k
