"""Laws of springs: polynomials, and tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, real_array
from cartstiff.core.errors import InputError, check_name
from cartstiff.core.lazily import cached_property
from cartstiff.core.potentials.springs import Corner, SpringLaw


@dataclass(frozen=True)
class PolynomialLaw(SpringLaw):
    """Torque ``c_1 x + c_2 x^2 + ... + c_m x^m``.

    Attributes
    ----------
    coefficients : tuple of float
        c_1, c_2, ...: N m/rad, N m/rad^2, ... (N/m, ... for a prismatic joint).
    """

    coefficients: tuple[float, ...]

    @property
    def powers(self) -> tuple[float, ...]:  # type: ignore[override]
        """The coefficients."""
        return self.coefficients

    def __post_init__(self) -> None:
        if not self.coefficients or not np.all(np.isfinite(self.coefficients)):
            raise InputError(
                "polynomial spring needs finite coefficients", got=list(self.coefficients)
            )

    def evaluate(self, x: Any) -> tuple[Any, Any, Any]:
        """Energy, torque and tangent stiffness at a deflection, each of (N,),
        or a number.
        """
        energy = torque = stiffness = 0.0
        for power, c in reversed(list(enumerate(self.coefficients, start=1))):
            energy, torque = (energy + c / (power + 1)) * x, (torque + c) * x
            stiffness = stiffness * x + c * power
        return energy * x, torque, stiffness

    def in_units(self, size: float, effort: float) -> PolynomialLaw:
        """The same law in other units."""
        c = enumerate(self.coefficients, start=1)
        return PolynomialLaw(tuple(x * effort / size**k for k, x in c))

    def deflection_for(self, torque: float) -> float:
        """Real root of smallest size of ``law(x) = torque``."""
        roots = np.polynomial.polynomial.Polynomial([-torque, *self.coefficients]).roots()
        size = 1.0 + numerics.largest(roots)
        real = roots.real[np.abs(roots.imag) < numerics.NEGLIGIBLE_DIFFERENCE * size]
        if real.size == 0:
            raise InputError(
                "polynomial spring never reaches the torque", got=f"{torque:.6g}"
            )
        x = float(real[np.argmin(np.abs(real))])
        for _ in range(3):  # roots of a companion matrix keep about half the digits
            _, t, k = self.evaluate(x)
            if k != 0.0:
                x -= (t - torque) / k
        return x


@dataclass(frozen=True)
class TabulatedLaw(SpringLaw):
    """Torque through points: straight between them, or a smooth curve;
    straight beyond them.

    Attributes
    ----------
    deflections, torques : tuple of float
        At least two points; deflections strictly increasing.
    pieces : {"linear", "smooth"}
        Straight pieces, as a catalogue means them: the stiffness jumps at the points, and
        that of the piece above is taken there. Or a shape-preserving cubic (PCHIP):
        energy, torque and stiffness are continuous.
    """

    deflections: tuple[float, ...]
    torques: tuple[float, ...]
    pieces: Literal["linear", "smooth"] = "linear"

    def __post_init__(self) -> None:
        x, y = real_array(self.deflections), real_array(self.torques)
        if x.size < 2 or x.shape != y.shape or not np.all(np.isfinite(np.append(x, y))):
            raise InputError(
                "spring table needs two or more finite points", got=f"{x.size} points"
            )
        if np.any(np.diff(x) <= 0):
            raise InputError(
                "deflections of a spring table must increase strictly", got=x.tolist()
            )
        check_name("kind of pieces", self.pieces, ["linear", "smooth"])

    @cached_property
    def corners(self) -> tuple[Corner, ...]:  # type: ignore[override]
        """Points at which the stiffness jumps; none of a smooth curve."""
        slopes = self._rows[:, 3]
        jumps = (
            np.abs(np.diff(slopes))
            > numerics.NEGLIGIBLE_DIFFERENCE * np.abs(slopes).max()
        )
        sides = zip(self.deflections, slopes[:-1], slopes[1:], jumps, strict=True)
        is_linear = self.pieces == "linear"
        return tuple(
            Corner(float(x), float(below), float(above))
            for x, below, above, jumps_here in sides
            if is_linear and jumps_here
        )

    @cached_property
    def corner_width(self) -> float:  # type: ignore[override]
        """Distance to a corner below which the deflection counts as that
        of the corner.
        """
        return numerics.NEGLIGIBLE_DIFFERENCE * (
            self.deflections[-1] - self.deflections[0]
        )

    def corner_at(self, x: float) -> Corner | None:
        """Return the corner at a deflection, if there is one."""
        near = (c for c in self.corners if abs(c.deflection - x) <= self.corner_width)
        return next(near, None)

    @cached_property
    def _rows(self) -> Array:
        """A row for each piece: knot, energy, torque, slope,
        two more coefficients of the torque.

        The first and the last piece are straight. The energy is that without a
        deflection.
        """
        x, y = np.asarray(self.deflections, float), np.asarray(self.torques, float)
        h, secants = np.diff(x), np.diff(y) / np.diff(x)
        rows = np.zeros((len(x) + 1, 6))
        rows[0, 0], rows[1:, 0], rows[0, 2], rows[1:, 2] = x[0], x, y[0], y
        # Slopes, and for cubic pieces two more coefficients, that the knots determine.
        if self.pieces == "linear":
            energies = h * (y[1:] + y[:-1]) / 2
            rows[:, 3] = [secants[0], *secants, secants[-1]]
        else:
            from scipy.interpolate import PchipInterpolator

            slopes = PchipInterpolator(x, y).derivative()(x)
            energies = h * (y[1:] + y[:-1]) / 2 + h * h * (slopes[:-1] - slopes[1:]) / 12
            rows[0, 3], rows[1:, 3] = slopes[0], slopes
            rows[1:-1, 4] = (3 * secants - 2 * slopes[:-1] - slopes[1:]) / h
            rows[1:-1, 5] = (slopes[:-1] + slopes[1:] - 2 * secants) / (h * h)
        # Energies from knot to knot; zero at deflection 0.
        rows[2:, 1] = np.cumsum(energies)
        rows[:, 1] -= self.on_piece(rows[np.searchsorted(x, 0.0, side="right")], 0.0)[0]
        return rows

    @cached_property
    def _ends(self) -> Array:
        """Ascending deflections at which the pieces end.

        A corner belongs to the piece above.
        """
        x = np.asarray(self.deflections, float)
        return x - numerics.ROUNDOFF * (x[-1] - x[0]) * (self.pieces == "linear")

    def evaluate(self, x: Any) -> tuple[Any, Any, Any]:
        """Energy, torque and tangent stiffness at a deflection, or at each of (N,).

        The energy is zero without a deflection.
        """
        return self.on_piece(
            self._rows[np.searchsorted(self._ends, x, side="right")].T, x
        )

    @staticmethod
    def on_piece(piece: Any, x: Any) -> tuple[Any, Any, Any]:
        """`evaluate` on one piece: knot, energy, torque, slope and two
        coefficients there.
        """
        knot, energy, torque, slope, second, third = piece
        d = x - knot
        return (
            energy + d * (torque + d * (slope / 2 + d * (second / 3 + d * (third / 4)))),
            torque + d * (slope + d * (second + d * third)),
            slope + d * (2 * second + 3 * d * third),
        )

    def in_units(self, size: float, effort: float) -> TabulatedLaw:
        """The same law in other units."""
        deflections, torques = (x * size for x in self.deflections), self.torques
        return replace(
            self,
            deflections=tuple(deflections),
            torques=tuple(t * effort for t in torques),
        )

    def deflection_for(self, torque: float) -> float:
        """Deflection of smallest size that carries a torque."""
        each = (self._on_piece_at(i, torque) for i in range(len(self._rows)))
        found = [x for x in each if x is not None]
        if not found:
            raise InputError("spring table never reaches the torque", got=f"{torque:.6g}")
        return min(found, key=abs)

    def _on_piece_at(self, i: int, torque: float) -> float | None:
        """Deflection of smallest size on one piece that carries a torque;
        None if none does.
        """
        ends = (-np.inf, *self.deflections, np.inf)
        knot, _, at_knot, slope, *_ = self._rows[i].tolist()
        low, high = ends[i], ends[i + 1]
        is_outside, far = i in (0, len(self.deflections)), at_knot
        if not is_outside:
            far = self.torques[i]
        elif slope:
            far = at_knot + (high if i else low) * slope
        if not min(at_knot, far) <= torque <= max(at_knot, far):
            return None
        if at_knot == far:  # flat, as a play is
            return float(np.clip(0.0, low, high))
        if is_outside or self.pieces == "linear":
            return float(np.clip(knot + (torque - at_knot) / slope, low, high))
        for _ in range(200):
            middle = 0.5 * (low + high)
            if middle in (low, high):
                break
            if (self.on_piece(self._rows[i], middle)[1] > torque) == (far > at_knot):
                high = middle
            else:
                low = middle
        return 0.5 * (low + high)
