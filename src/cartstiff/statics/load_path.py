r"""One point after another on a curve of equilibria: predictor, corrector, arc length.

The loads have a factor p. With g_N and H_N as in `cartstiff.statics.problem` and f_N = dg_N/dp, a
point and the direction (t, t_p) of its curve satisfy

    g_N(q, p) = 0,      H_N t + f_N t_p = 0,    |t|^2 + (t_p / range)^2 = 1

A step goes along the direction and comes back at right angles to it [Keller]_, which passes points
where the load is stationary. Where H_N is singular the curve has a limit point (f_N is not in its
range) or meets another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cartstiff import numerics
from cartstiff.errors import ConvergenceError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.contract import Evaluation, Potential
from cartstiff.statics.balance import Balance, spectrum
from cartstiff.statics.flutter import Vibrations, vibrations
from cartstiff.statics.held import Held
from cartstiff.statics.newton import ENOUGH, SHARP
from cartstiff.statics.point import Point
from cartstiff.statics.problem import System

_CORRECTIONS = 25
_LARGEST = 0.5


@dataclass(slots=True, eq=False)
class CurvePoint:
    """A point of the curve.

    Attributes
    ----------
    factor : float
        p.
    direction : ndarray (n + 1,)
        (t, t_p / range), a unit vector, in natural units.
    eigenvalues : ndarray
        Of H_N; where it is unsymmetric they depend on the choice of coordinates.
    vibrations : Vibrations or None
        Where the loads have no potential and every motion has a mass.
    push : ndarray (f,)
        f_N times the range.
    corrections : int
        Newton steps that led here.
    """

    point: Point
    balance: Balance
    factor: float
    direction: Array
    eigenvalues: Array
    vibrations: Vibrations | None
    push: Array
    corrections: int

    @property
    def is_conservative(self) -> bool:
        """Whether everything that acts has a potential."""
        return not np.isnan(self.point.evaluation.energy)


class LoadPath:
    """Equilibria of a mechanism whose loads have a common factor.

    Parameters
    ----------
    elastic : ElasticMechanism
        With all rest positions chosen.
    loads : sequence of Potential
        What the factor multiplies.
    fixed : sequence of Potential
        What acts besides.
    held : Held, optional
        Held displacement, with its reference.
    span : float
        Size of the factors of interest: the unit that p is measured in along the curve.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        loads: Sequence[Potential],
        fixed: Sequence[Potential],
        held: Held | None,
        span: float,
    ) -> None:
        self.loads = System(elastic, loads).loads
        self.system = System(elastic, fixed, held)
        self.span = span

    def _at(self, q: Array, factor: float) -> tuple[Point, Array]:
        """Everything that acts, and the loads' gradient times the range, in natural units."""
        point = self.system.at(q)
        columns = point.posture.coordinate_lengths
        pushed = np.zeros(columns.size)
        for load in self.loads:
            e, g, h = load.evaluate(point.posture)
            members = abs(factor) * load.member_forces(point.posture, g)
            point.add(Evaluation(factor * e, factor * g, factor * h), members)
            pushed += g
        return point, pushed * columns * self.span

    def state(self, q: Array, factor: float, direction: Array, corrections: int = 0) -> CurvePoint:
        """The state at given coordinates, its direction along that of a neighbour."""
        point, push = self._at(q, factor)
        balance = self.system.balance(point)
        if balance.free is not None:
            push = balance.free.T @ push
        conservative = not np.isnan(point.evaluation.energy)
        values = spectrum(balance, conservative)
        right = np.append(np.zeros_like(push), 1.0)
        solved = self._solved(balance, push, direction, right)
        along = np.append(balance.motion(solved[:-1]), solved[-1])
        along /= np.linalg.norm(along)
        moving = None
        if not conservative:
            units = self.system.elastic.units
            moving = vibrations(point, balance, units, self.system.terms)
        return CurvePoint(point, balance, factor, along, values, moving, push, corrections)

    @staticmethod
    def _solved(balance: Balance, push: Array, direction: Array, right: Array) -> Array:
        """Motions and load factor from the stiffness, bordered by the push and the direction.

        Each motion is counted in units of its own stiffness, and the border in units of 1, so that
        a stiff spring hides no soft motion when the rank is judged.
        """
        t = direction[:-1] if balance.free is None else balance.free.T @ direction[:-1]
        per = 1.0 / np.sqrt(balance.hardness)
        pushed, along = per * push, np.append(per * t, direction[-1])
        column = float(np.abs(pushed).max(initial=0.0)) or 1.0
        along[-1] /= column
        row = float(np.abs(along).max()) or 1.0
        matrix = np.block([[balance.scaled, (pushed / column)[:, None]], [along / row]])
        scaled = np.append(per * right[:-1], right[-1] / row)
        solved = np.linalg.lstsq(matrix, scaled, rcond=numerics.LAST_DIGITS)[0]
        return np.append(per * solved[:-1], solved[-1] / column)

    def step(self, start: CurvePoint, size: float, direction: Array | None = None) -> CurvePoint:
        """The point at a distance `size` along a direction (default: the curve's own).

        Raises
        ------
        ConvergenceError
            If the way back to the curve is not found.
        """
        direction = start.direction if direction is None else direction
        q = self.system.moved(start.point, size * direction[:-1])
        factor = start.factor + size * direction[-1] * self.span
        return self.corrected(q, factor, direction)

    def corrected(self, q: Array, factor: float, direction: Array) -> CurvePoint:
        """Newton's method at right angles to a direction; (0, 1) holds the load."""
        system = self.system
        q = system.retracted(q)
        best, kept, stalled = np.inf, (q, factor), 0
        for iteration in range(_CORRECTIONS):
            point, push = self._at(q, factor)
            balance = system.balance(point)
            if not np.isfinite(balance.residual):
                break
            if balance.residual < best:
                stalled = 0 if balance.residual < 0.5 * best else stalled + 1
                best, kept = balance.residual, (q, factor)
            else:
                stalled += 1
            if best <= SHARP or (best <= ENOUGH and stalled):
                return self.state(*kept, direction, iteration)
            if balance.free is not None:
                push = balance.free.T @ push
            right = -np.append(balance.force, 0.0)
            solved = self._solved(balance, push, direction, right)
            motion = balance.motion(solved[:-1])
            largest = max(float(np.abs(motion).max(initial=0.0)), abs(float(solved[-1])))
            share = min(1.0, _LARGEST / max(largest, numerics.TINY))
            q = system.retracted(system.moved(point, share * motion))
            factor = factor + share * float(solved[-1]) * self.span
        raise ConvergenceError(
            "the curve of equilibria is lost", iterations=_CORRECTIONS, residual=best
        )
