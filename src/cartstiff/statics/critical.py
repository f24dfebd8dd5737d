r"""Critical loads on a curve of equilibria: where H_N becomes singular, and what that means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartstiff import numerics
from cartstiff.errors import ConvergenceError
from cartstiff.geometry.se3 import Array
from cartstiff.statics.load_path import CurvePoint, LoadPath

# Share of f_N along the mode below which the load does not excite it: then curves cross.
_UNFELT = numerics.UNFELT
_BISECTIONS = 100

Kind = Literal["limit", "bifurcation", "flutter"]


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """A point where a motion loses its stiffness.

    Attributes
    ----------
    factor : float
        Load factor.
    q : ndarray (n,)
        Coordinates.
    kind : {"limit", "bifurcation", "flutter"}
        "limit": the load is stationary along the curve, the mechanism snaps through.
        "bifurcation": another curve of equilibria starts here, as where a load that has no
        potential leads to divergence.
        "flutter": two frequencies meet, and vibrations grow beyond.
    mode : ndarray (n,)
        The motion, in natural units, of length 1.
    eigenvalue : float
        What is left of the stiffness along it, as a share of the largest one just before; NaN for
        flutter.
    frequency : float or None
        In Hz, of the motion that flutters.
    """

    factor: float
    q: Array
    kind: Kind
    mode: Array
    eigenvalue: float
    frequency: float | None
    _state: CurvePoint

    def __repr__(self) -> str:
        swing = "" if self.frequency is None else f", {self.frequency:.4g} Hz"
        return f"<{self.kind} at factor {self.factor:.6g}{swing}>"


def _negative(state: CurvePoint) -> int:
    """Number of negative eigenvalues; without an energy the parity of the determinant."""
    if state.is_conservative:
        return int(np.sum(state.eigenvalues < 0.0))
    return int(np.linalg.slogdet(state.balance.stiffness)[0] < 0.0)


def _measure(index: int) -> Callable[[CurvePoint], float]:
    """What changes its sign at the critical point."""

    def value(state: CurvePoint) -> float:
        if state.is_conservative:
            return float(state.eigenvalues[index])
        size = max(float(np.abs(state.eigenvalues).max(initial=0.0)), numerics.TINY)
        return float(np.linalg.det(state.balance.stiffness / size))

    return value


def crossings(
    path: LoadPath, start: CurvePoint, end: CurvePoint, size: float
) -> list[CriticalPoint]:
    """Critical points between two neighbours on a curve, `size` apart along its direction."""
    before, after = _negative(start), _negative(end)
    points = []
    for index in range(min(before, after), max(before, after)):
        state = _located(path, start, end, size, _measure(index))
        points.append(_named(state, float(np.abs(start.eigenvalues).max())))
    if not _grows(start) and _grows(end):
        # A range of flutter may lie between them, and divergence at the end of it.
        onset = _onset(path, start, end, size, _grows)
        if _flutters(onset):
            points.append(_fluttering(onset))
        elif not points:
            points.append(_named(onset, float(np.abs(start.eigenvalues).max())))
    elif not _flutters(start) and _flutters(end):
        points.append(_fluttering(_onset(path, start, end, size, _flutters)))
    return sorted(points, key=lambda c: float((c.q - start.point.q) @ (c.q - start.point.q)))


def _flutters(state: CurvePoint) -> bool:
    return state.vibrations is not None and state.vibrations.growing == "flutter"


def _grows(state: CurvePoint) -> bool:
    return state.vibrations is not None and state.vibrations.growing is not None


def _onset(
    path: LoadPath,
    start: CurvePoint,
    end: CurvePoint,
    size: float,
    is_beyond: Callable[[CurvePoint], bool],
) -> CurvePoint:
    """The first state in which vibrations grow, by halving."""
    a, b = 0.0, size
    for _ in range(_BISECTIONS):
        middle = 0.5 * (a + b)
        if b - a <= numerics.FINEST * size or middle in (a, b):
            break
        try:
            state = path.step(start, middle)
        except ConvergenceError:
            break
        if is_beyond(state):
            b, end = middle, state
        else:
            a = middle
    return end


def _fluttering(state: CurvePoint) -> CriticalPoint:
    vibrations = state.vibrations
    mode = np.zeros(state.point.q.size) if vibrations is None else vibrations.mode
    frequency = None if vibrations is None else vibrations.frequency
    return CriticalPoint(state.factor, state.point.q, "flutter", mode, np.nan, frequency, state)


def _located(
    path: LoadPath,
    start: CurvePoint,
    end: CurvePoint,
    size: float,
    measure: Callable[[CurvePoint], float],
) -> CurvePoint:
    """Root by secants kept in their bracket (every third step halves it)."""
    a, b = 0.0, size
    value_a, value_b = measure(start), measure(end)
    # Of this motion's own stiffness, not of the stiffest one's: rounding is no excuse to end early.
    small = numerics.LAST_DIGITS * max(abs(value_a), abs(value_b))
    best = start if abs(value_a) < abs(value_b) else end
    for iteration in range(_BISECTIONS):
        if b - a <= numerics.FINEST * size or value_a == value_b:
            break
        middle = 0.5 * (a + b)
        if iteration % 3 != 2:
            secant = b - value_b * (b - a) / (value_b - value_a)
            margin = 1e-3 * (b - a) if iteration % 3 == 1 else 0.0
            middle = min(max(secant, a + margin), b - margin)
        try:
            state = path.step(start, middle)
        except ConvergenceError:
            break  # at a crossing of curves the way back is ambiguous; `best` is next to it
        value = measure(state)
        if abs(value) < abs(measure(best)):
            best = state
        if abs(value) <= small or middle in (a, b):
            break
        if (value < 0.0) == (value_a < 0.0):
            a, value_a = middle, value
        else:
            b, value_b = middle, value
    return best


def _named(state: CurvePoint, stiffest: float) -> CriticalPoint:
    H = state.balance.stiffness
    U, values, Vt = np.linalg.svd(H)
    left, mode = U[:, -1], Vt[-1]
    felt = abs(float(left @ state.push))
    scale = max(float(np.linalg.norm(state.push)), stiffest, numerics.TINY)
    kind: Kind = "limit" if felt > _UNFELT * scale else "bifurcation"
    motion = state.balance.motion(mode)
    return CriticalPoint(
        state.factor,
        state.point.q,
        kind,
        motion,
        float(values[-1] / max(stiffest, numerics.TINY)),
        None,
        state,
    )
