r"""Load-deflection curves through limit points, critical loads,
and the branches that start there.

The loads are multiplied by a factor p that may decrease again along the curve. The curve
is compared with the linear prediction by the compliance at its start, u = p C W. With g_N
and H_N as in `cartstiff.core.statics.problem` and f_N = dg_N/dp, a point and the
direction (t, t_p) of its curve satisfy

    g_N(q, p) = 0,      H_N t + f_N t_p = 0,    |t|^2 + (t_p / range)^2 = 1

A step follows the direction and returns to the curve at right angles to it [Keller]_,
which passes points where the load is stationary. Where H_N is singular the curve has a
limit point (f_N is not in its range) or meets another one: a critical load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, Result, csv_text, plain_dict
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import ConvergenceError, InputError, UndefinedError
from cartstiff.core.figures import new_axes
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.mechanisms.gravity_loads import GravityLoads, gravity_loads
from cartstiff.core.mechanisms.limits import Limits
from cartstiff.core.notes import Note
from cartstiff.core.numerics import FREE_MOTION_STIFFNESS
from cartstiff.core.numerics.searches import zero_between
from cartstiff.core.potentials.contract import Evaluation, Potential
from cartstiff.core.results import LabelledResult
from cartstiff.core.statics.held import Held, displacement_between, displacement_heads
from cartstiff.core.statics.newton import solve
from cartstiff.core.statics.problem import (
    Balance,
    Point,
    System,
    contact_limits,
    notes_at_start,
    refuse_springs_far_apart,
    spectrum,
)
from cartstiff.core.statics.small_motions import (
    MASSLESS,
    UNDAMPED,
    Vibrations,
    is_unstable,
    vibrations,
)
from cartstiff.core.stiffness.applied_load import Axes, Behaviour, LoadKind, checked_load
from cartstiff.core.stiffness.balance import with_rest_balancing
from cartstiff.core.stiffness.compute import SCHEMA

# Newton steps back to the curve, and the longest of them in natural units.
_CORRECTIONS, _LONGEST_CORRECTION = 25, 0.5
# Errors by which no next point is found.
_LOST = (ConvergenceError, UndefinedError, np.linalg.LinAlgError)


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
        Eigenvalues of H_N; if it is unsymmetric they depend on the choice of coordinates.
    vibrations : Vibrations or None
        If the loads have no potential and every motion has a mass.
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

    @property
    def smallest(self) -> float:
        """Smallest eigenvalue; NaN if what acts has no potential."""
        if not self.is_conservative:  # pairs of them may be complex
            return float("nan")
        return float(self.eigenvalues.min(initial=np.inf))


class LoadPath:
    """Equilibria of a mechanism whose loads have a common factor.

    Parameters
    ----------
    elastic : ElasticMechanism
        With all rest positions chosen.
    q : ndarray (n,)
        Start of the search for the equilibrium without the loads.
    loads : sequence of Potential
        Loads that the factor multiplies.
    fixed : sequence of Potential
        Further loads.
    held : Held, optional
        Held displacement, with its reference.
    limits : Limits
        Limits at which the path ends.
    goal, back, resolution : float
        As `to`, `back` and `resolution` of `load_curve`.
    settle : bool
        Begin at a stable equilibrium: not at one near q that is unstable.

    Attributes
    ----------
    span : float
        Size of the factors of interest: the unit that p is measured in along the curve.
    origin : CurvePoint
        The equilibrium at factor 0.

    Raises
    ------
    ConvergenceError
        If there is none.
    """

    def __init__(
        self,
        elastic: ElasticMechanism,
        q: Array,
        loads: Sequence[Potential],
        fixed: Sequence[Potential],
        held: Held | None,
        limits: Limits,
        goal: float,
        back: float,
        resolution: float,
        settle: bool = True,
    ) -> None:
        self.loads = System(elastic, loads).loads
        self.system = System(elastic, fixed, held)
        self.limits, self.goal, self.back, self.resolution = (
            limits,
            goal,
            back,
            resolution,
        )
        self.span = abs(goal)
        start = solve(self.system, q, settle=settle).point
        upwards = np.zeros(start.posture.coordinate_lengths.size + 1)
        upwards[-1] = np.sign(goal)
        self.origin = self.state(start.q, 0.0, upwards)

    @cached_property
    def linear_rate(self) -> Array:
        """Displacement (6,) per unit of the factor, by the compliance at the start."""
        posture, balance = self.origin.point.posture, self.origin.balance
        values = np.linalg.svd(balance.scaled, compute_uv=False)
        if values.size and not values[-1] > numerics.ROUNDOFF * values[0]:
            return np.full(6, np.nan)
        y = -balance.solved(self.origin.push / self.span, numerics.ROUNDOFF)
        twist = posture.motion.jacobian @ (balance.motion(y) * posture.coordinate_lengths)
        R = posture.pose[:3, :3]
        return np.concatenate([R @ twist[:3], R @ twist[3:]])

    def _at(self, q: Array, factor: float) -> tuple[Point, Array]:
        """Everything that acts, and the loads' gradient times the range,
        in natural units.
        """
        point = self.system.at(q)
        columns = point.posture.coordinate_lengths
        pushed = np.zeros(columns.size)
        for load in self.loads:
            e, g, h = load.evaluate(point.posture)
            members = abs(factor) * load.member_forces(point.posture, g)
            point.add(Evaluation(factor * e, factor * g, factor * h), members)
            pushed += g
        return point, pushed * columns * self.span

    def state(
        self, q: Array, factor: float, direction: Array, corrections: int = 0
    ) -> CurvePoint:
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
        size = float(np.abs(along).max())
        if not 0.0 < size < np.inf:
            raise ConvergenceError(
                "the curve of equilibria has no direction", iterations=0, residual=size
            )
        along /= size  # whose squares may be too large
        along /= np.linalg.norm(along)
        moving = None
        if not conservative:
            units = self.system.elastic.units
            moving = vibrations(point, balance, units, self.system.terms)
        return CurvePoint(
            point, balance, factor, along, values, moving, push, corrections
        )

    @staticmethod
    def _solved(balance: Balance, push: Array, direction: Array, right: Array) -> Array:
        """Motions and load factor from the stiffness, bordered by the push and
        the direction.

        Each motion is measured in units of its own stiffness, and the border in units of
        1, so that a stiff spring hides no soft motion when the rank is decided.
        """
        t = direction[:-1] if balance.free is None else balance.free.T @ direction[:-1]
        per = 1.0 / np.sqrt(balance.stiffness_scale)
        pushed, along = per * push, np.append(per * t, direction[-1])
        column = numerics.largest(pushed) or 1.0
        along[-1] /= column
        row = float(np.abs(along).max()) or 1.0
        matrix = np.block([[balance.scaled, (pushed / column)[:, None]], [along / row]])
        scaled = np.append(per * right[:-1], right[-1] / row)
        solved = np.linalg.lstsq(matrix, scaled, rcond=numerics.ROUNDOFF_OF_SUMS)[0]
        return np.append(per * solved[:-1], solved[-1] / column)

    def distance(self, start: CurvePoint, end: CurvePoint) -> float:
        """Size of the step from one point that leads to another."""
        moved = self.system.displacement(start.point, end.point)
        grown = (end.factor - start.factor) / self.span
        return float(start.direction @ np.append(moved, grown))

    def step(
        self, start: CurvePoint, size: float, direction: Array | None = None
    ) -> CurvePoint:
        """The point at a distance `size` along a direction (default: the curve's own).

        Raises
        ------
        ConvergenceError
            If the way back to the curve is not found.
        """
        direction = start.direction if direction is None else direction
        q = self.system.displaced(start.point, size * direction[:-1])
        factor = start.factor + size * direction[-1] * self.span
        return self.corrected(q, factor, direction)

    def corrected(self, q: Array, factor: float, direction: Array) -> CurvePoint:
        """The point of the curve at right angles to a direction, by Newton's method.

        The direction (0, 1) keeps the load.
        """
        system = self.system
        q = system.retracted(q)
        best, kept, stalled = np.inf, (q, factor), 0
        for iteration in range(_CORRECTIONS):
            point, push = self._at(q, factor)
            balance = system.balance(point)
            if not np.isfinite(balance.residual):
                break
            # The best point so far; it is enough, or the steps go on.
            if balance.residual < best:
                stalled = 0 if balance.residual < 0.5 * best else stalled + 1
                best, kept = balance.residual, (q, factor)
            else:
                stalled += 1
            if best <= numerics.EQUILIBRIUM_TOLERANCE or (
                best <= numerics.ACCEPTED_RESIDUAL and stalled
            ):
                return self.state(*kept, direction, iteration)
            if balance.free is not None:
                push = balance.free.T @ push
            right = -np.append(balance.force, 0.0)
            solved = self._solved(balance, push, direction, right)
            motion = balance.motion(solved[:-1])
            largest = max(numerics.largest(motion), abs(float(solved[-1])))
            share = min(1.0, _LONGEST_CORRECTION / max(largest, numerics.TINY))
            q = system.retracted(system.displaced(point, share * motion))
            factor = factor + share * float(solved[-1]) * self.span
        raise ConvergenceError(
            "the curve of equilibria is lost", iterations=_CORRECTIONS, residual=best
        )


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
        "bifurcation": another curve of equilibria starts here, as where a load that has
        no potential leads to divergence. "flutter": two frequencies meet, and vibrations
        grow beyond.
    mode : ndarray (n,)
        The motion, in natural units, of length 1.
    eigenvalue : float
        Remaining stiffness along it, as a share of the largest one just before; NaN for
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
    """Function of a state that changes its sign at the critical point."""

    def value(state: CurvePoint) -> float:
        if state.is_conservative:
            return float(state.eigenvalues[index])
        size = max(numerics.largest(state.eigenvalues), numerics.TINY)
        return float(np.linalg.det(state.balance.stiffness / size))

    return value


def crossings(
    path: LoadPath, start: CurvePoint, end: CurvePoint, size: float
) -> list[CriticalPoint]:
    """Critical points between two neighbours on a curve,
    at a distance `size` of each other.
    """
    before, after = _negative(start), _negative(end)
    points = []
    for index in range(min(before, after), max(before, after)):
        state = _located(path, start, end, size, _measure(index))
        points.append(_named(state, float(np.abs(start.eigenvalues).max())))
    if not _grows(start) and _grows(end):
        # A range of flutter may lie between them, with divergence at its end.
        onset = _onset(path, start, end, size, _grows)
        if _flutters(onset):
            points.append(_fluttering(onset))
        elif not points:
            points.append(_named(onset, float(np.abs(start.eigenvalues).max())))
    elif not _flutters(start) and _flutters(end):
        points.append(_fluttering(_onset(path, start, end, size, _flutters)))
    return sorted(
        points, key=lambda c: float((c.q - start.point.q) @ (c.q - start.point.q))
    )


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
    states = _bracketed(
        path, start, end, size, lambda state: 1.0 if is_beyond(state) else -1.0
    )
    return [state for state in states if is_beyond(state)][-1]


def _fluttering(state: CurvePoint) -> CriticalPoint:
    vibrations = state.vibrations
    mode = np.zeros(state.point.q.size) if vibrations is None else vibrations.mode
    frequency = None if vibrations is None else vibrations.frequency
    return CriticalPoint(
        state.factor, state.point.q, "flutter", mode, np.nan, frequency, state
    )


def _located(
    path: LoadPath,
    start: CurvePoint,
    end: CurvePoint,
    size: float,
    measure: Callable[[CurvePoint], float],
    precision: float = numerics.ATTAINABLE_PRECISION,
) -> CurvePoint:
    """The state between two neighbours in which a measure is nearest to zero."""
    states = _bracketed(path, start, end, size, measure, precision)
    return min(states, key=lambda state: abs(measure(state)))


def _bracketed(
    path: LoadPath,
    start: CurvePoint,
    end: CurvePoint,
    size: float,
    measure: Callable[[CurvePoint], float],
    precision: float = numerics.ATTAINABLE_PRECISION,
) -> list[CurvePoint]:
    """The states that a search visits while it brackets a change of sign,
    both ends first.
    """
    states = [start, end]
    # A share of this motion's own stiffness, not of the stiffest one's.
    zero = numerics.ROUNDOFF_OF_SUMS * max(abs(measure(start)), abs(measure(end)))

    def value(distance: float) -> float:
        if 0.0 < distance < size:
            states.append(path.step(start, distance))
        reached = measure(states[0 if distance == 0.0 else 1 if distance == size else -1])
        return reached if abs(reached) > zero else 0.0

    # At a crossing of curves the way back is ambiguous: the last state is then next to
    # it.
    with suppress(*_LOST):
        zero_between(value, 0.0, size, precision * size, _BISECTIONS)
    return states


def _named(state: CurvePoint, stiffest: float) -> CriticalPoint:
    H = state.balance.stiffness
    U, values, Vt = np.linalg.svd(H)
    left, mode = U[:, -1], Vt[-1]
    exciting = abs(float(left @ state.push))
    scale = max(numerics.norm(state.push), stiffest, numerics.TINY)
    # A load without a force along the mode does not excite it: curves cross.
    is_limit = exciting > numerics.NEGLIGIBLE_FORCE * scale
    kind: Kind = "limit" if is_limit else "bifurcation"
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


#: Why a curve ends.
Reason = Literal[
    "factor-reached", "factor-left", "points-reached", "limit-contact", "lost"
]


@dataclass(frozen=True, eq=False, repr=False)
class LoadCurve(Result, LabelledResult):
    """Equilibria along a growing (and perhaps falling) load.

    Attributes
    ----------
    factors : ndarray (m,)
        Load factors p.
    q : ndarray (m, n)
        Coordinates.
    displacement : ndarray (m, 6)
        From the unloaded pose: rotation vector and translation, axes of F.
    linear : ndarray (m, 6)
        Prediction by the compliance at the start; NaN if there is none.
    eigenvalue : ndarray (m,)
        Smallest eigenvalue of H_N; NaN without an energy, as it then depends on the
        coordinates.
    stable : tuple of bool or None
        Whether H_N is positive definite; None at a zero eigenvalue. Without an energy
        False if vibrations grow, else None.
    critical : tuple of CriticalPoint
        In the order in which the curve meets them.
    reason : str
        "factor-reached"; "factor-left": the load fell below the range wanted;
        "points-reached"; "limit-contact": a joint limit was reached; "lost": no next
        point was found.
    notes : tuple of Note
        Assumptions.
    """

    elastic: ElasticMechanism
    factors: Array
    q: Array
    displacement: Array
    linear: Array
    eigenvalue: Array
    stable: tuple[bool | None, ...]
    critical: tuple[CriticalPoint, ...]
    reason: Reason
    notes: tuple[Note, ...]
    _path: LoadPath
    #: See `ElasticMechanism.before_load`, of the mechanism as it was given.
    _before_load: Literal["balanced", "given", "partly"] | None = None

    @property
    def weighed(self) -> GravityLoads:
        """Bodies under gravity, and payloads among the loads (at factor 1)."""
        found = gravity_loads(self.elastic, (*self._path.system.loads, *self._path.loads))
        return replace(found, before=self._before_load)

    @cached_property
    def deviation(self) -> Array:
        """Distance of the linear prediction from the curve over the displacement, (m, 2).

        The first column is for the rotation vectors, the second for the translations:
        they are never added. 0 without a motion.
        """
        length = self.elastic.mechanism.at(self.q[0]).length
        columns = []
        for part, smallest in (
            (slice(0, 3), numerics.PRINTED_AS_ZERO),
            (slice(3, 6), numerics.PRINTED_AS_ZERO * length),
        ):
            off = np.linalg.norm((self.linear - self.displacement)[:, part], axis=1)
            size = np.linalg.norm(self.displacement[:, part], axis=1)
            columns.append(
                np.divide(off, size, out=np.zeros(len(off)), where=size > smallest)
            )
        return np.column_stack(columns)

    def branch(self, index: int = 0, direction: int = 1, points: int = 200) -> LoadCurve:
        """The curve that starts at a bifurcation, along its mode or against it.

        Parameters
        ----------
        index : int
            Which of the `critical` points.
        direction : {1, -1}
            Sense of the mode.
        points : int
            Bound on the number of points.

        Raises
        ------
        InputError
            If there is no such critical point.
        UndefinedError
            Code ``"no-branch"`` at a limit point or the onset of flutter.
        ConvergenceError
            If the branch cannot be entered.
        """
        if not 0 <= index < len(self.critical):
            raise InputError(
                "no such critical point",
                expected=f"below {len(self.critical)}",
                got=index,
            )
        critical = self.critical[index]
        if critical.kind != "bifurcation":
            raise UndefinedError(
                "no branch starts at a limit point or the onset of flutter: the curve "
                "itself goes on",
                code="no-branch",
                values={"factor": critical.factor},
            )
        along = np.append(np.sign(direction) * critical.mode, 0.0)
        size = self._path.resolution
        while True:
            try:
                first = self._path.step(critical._state, size, along)
                break
            except _LOST as error:
                size *= 0.5
                if size < _SMALLEST_STEP:
                    raise ConvergenceError(
                        "no branch can be entered here", iterations=0, residual=np.inf
                    ) from error
        return _trace(self._path, self.notes, [critical._state, first], points)

    def linear_up_to(
        self,
        tolerance: float = 0.05,
        part: Literal["rotation", "translation"] = "translation",
    ) -> float:
        """Factor up to which the linear prediction of a part, "rotation" or
        "translation", stays within a relative deviation, the `tolerance`.
        """
        off = self.deviation[:, 0 if part == "rotation" else 1]
        factors = np.abs(self.factors)
        bad = np.flatnonzero(~(off <= tolerance))
        if bad.size == 0:
            return float(factors.max())
        i = int(bad[0])
        if i == 0 or np.isnan(off[i]):
            return 0.0
        share = (tolerance - off[i - 1]) / (off[i] - off[i - 1])
        return float(factors[i - 1] + share * (factors[i] - factors[i - 1]))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        of_critical = ("factor", "kind", "q", "mode", "frequency")
        data = {
            "schema": SCHEMA,
            "units": self.elastic.units.to_dict(),
            "joints": self.elastic.names,
            **self.weighed.to_dict(),
            "factor": self.factors,
            "q": self.q,
            "displacement": self.displacement,
            "linear": [None if np.isnan(row).any() else row for row in self.linear],
            "eigenvalue": self.eigenvalue,
            "stable": self.stable,
            "critical": [
                {key: getattr(c, key) for key in of_critical} for c in self.critical
            ],
            "reason": self.reason,
            "notes": self.notes,
        }
        return plain_dict(data)

    def to_csv(self) -> str:
        """Factor, coordinates, displacement, linear prediction, eigenvalue:
        one line a point.
        """
        heads = [
            h for b in ("", "linear_") for h in displacement_heads(self.elastic.units, b)
        ]
        names = ["factor", *self.elastic.names_with_units, *heads, "eigenvalue"]
        columns = [self.factors, self.q, self.displacement, self.linear, self.eigenvalue]
        return csv_text(np.column_stack(columns), names)

    def plot(self, ax: Any = None, *, rotation: bool = False) -> Any:
        """Draw load factor over displacement with stability,
        critical loads and linear prediction.

        Parameters
        ----------
        rotation : bool
            Show the rotation angle instead of the distance.
        ax : matplotlib.axes.Axes, optional
            Whose place the picture takes; default a figure of its own.

        Returns
        -------
        matplotlib.figure.Figure
            See `cartstiff.shown.report.output.save_figure`.

        Raises
        ------
        MissingDependencyError
            Without matplotlib.
        """
        figure, axes = new_axes(self.elastic.springs_in_doubt, ax=ax)
        part = slice(0, 3) if rotation else slice(3, 6)
        units = self.elastic.units
        unit, per = units.shown_length, units.shown_per_length
        if rotation:
            unit, per = units.shown_angle, units.shown_per_radian
        size = per * np.linalg.norm(self.displacement[:, part], axis=1)
        kinds = (
            (True, "-", "stable"),
            (False, "--", "unstable"),
            (None, "-.", "not decided"),
        )
        for verdict, style, label in kinds:
            shown = np.array([s is verdict for s in self.stable])
            # Each part includes the neighbouring points, so that the line has no gaps.
            near = shown.copy()
            near[1:] |= shown[:-1]
            near[:-1] |= shown[1:]
            if shown.any():
                axes.plot(
                    np.where(near, size, np.nan),
                    np.where(near, self.factors, np.nan),
                    style,
                    color="C0",
                    label=label,
                )
        last = int(np.argmax(np.abs(self.factors)))
        linear = per * numerics.norm(self.linear[last, part])
        if np.isfinite(linear):
            # Only as far as the curve, to keep its scale.
            share = min(1.0, 1.1 * float(size.max()) / max(linear, numerics.TINY))
            axes.plot(
                [0.0, share * linear],
                [0.0, share * self.factors[last]],
                ":",
                color="0.4",
                label="linear",
            )
        for point in self.critical:
            axes.axhline(point.factor, color="C3", linewidth=0.8)
            axes.annotate(
                f"{point.kind} {point.factor:.6g}",
                (0.02, point.factor),
                xycoords=("axes fraction", "data"),
                va="bottom",
                color="C3",
            )
        axes.set_xlabel(
            f"{'rotation' if rotation else 'displacement'} of the body frame [{unit}]"
        )
        axes.set_ylabel("load factor")
        axes.set_title(self.elastic.name)
        axes.legend()
        return figure


# A step whose direction changes by more than this cosine is halved, down to the smallest
# step.
_SMALLEST_STEP, _COSINE = numerics.NEGLIGIBLE_STEP, 0.9


class Start(NamedTuple):
    """A mechanism where a search for its rest begins, and what acts on it.

    Attributes
    ----------
    given, elastic : ElasticMechanism
        As given, and with rest positions chosen so that it is at rest at the posture.
    posture : MechanismPosture
        The start.
    loads : tuple of Potential
        All loads.
    held : Held or None
        The prescribed displacement, from the posture.
    """

    given: ElasticMechanism
    elastic: ElasticMechanism
    posture: MechanismPosture
    loads: tuple[Potential, ...]
    held: Held | None

    @classmethod
    def of(
        cls,
        elastic: ElasticMechanism,
        q: ArrayLike | Mapping[str, float] | None,
        loads: tuple[Potential, ...],
        held: Held | Mapping[str, float] | None,
        wrench: ArrayLike | None,
        kind: LoadKind,
        axes: Axes,
    ) -> Start:
        """The start at coordinates, with the wrench among the loads."""
        given, posture = elastic.placed(q)
        refuse_springs_far_apart(given)
        if held is not None:
            held = (held if isinstance(held, Held) else Held(held)).at_start(posture)
        if wrench is not None:
            loads = (*loads, kind.acting(wrench, posture.pose, axes))
        return cls(given, with_rest_balancing(given, posture), posture, loads, held)


def start_and_loads(
    q: ArrayLike | Mapping[str, float] | Potential | None, loads: tuple[Potential, ...]
) -> tuple[ArrayLike | Mapping[str, float] | None, tuple[Potential, ...]]:
    """Coordinates and loads of a call that may have a load in the place of
    coordinates.
    """
    return (None, (q, *loads)) if isinstance(q, Potential) else (q, loads)


@checked
def load_curve(
    elastic: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | Potential | None = None,
    *loads: Potential,
    wrench: ArrayLike | None = None,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
    to: float = 1.0,
    fixed: Sequence[Potential] = (),
    held: Held | Mapping[str, float] | None = None,
    resolution: float = 0.05,
    points: int = 400,
    back: float = 1.0,
) -> LoadCurve:
    """Trace the equilibria of a mechanism whose loads grow by a common factor.

    Parameters
    ----------
    elastic : ElasticMechanism
        From `cartstiff.load`.
    q : array_like or mapping, optional
        Start of the search for the unloaded equilibrium; default the file's posture. A
        potential in its place is the first of `loads`.
    *loads : Potential
        Loads that the factor multiplies; factor 1 is the load as given.
    wrench, load_kind, load_at, load_axes
        One more load that the factor multiplies, as in `equilibrium`.
    to : float
        Trace the load-deflection curve: up to this multiple of the load, with its
        critical loads; not zero, negative to reverse the load.
    fixed : sequence of Potential
        Further loads, which do not depend on the factor.
    held : Held or mapping, optional
        Displacement prescribed partly; see `equilibrium`.
    resolution : float
        Largest distance of neighbouring points, in rad and characteristic lengths and in
        shares of `to`.
    points : int
        Bound on the number of points.
    back : float
        Past limit points the load may decrease and change its sign: as far as ``-back *
        to``.

    Raises
    ------
    InputError
        Without a load, for a zero or infinite `to`, or bad coordinates.
    ConvergenceError
        If there is no equilibrium without the load.
    """
    checked_elastic(elastic)
    q, loads = start_and_loads(q, loads)
    if not loads and wrench is None:
        raise InputError("a load-deflection curve needs a load")
    if not (np.isfinite(to) and to != 0.0):
        raise InputError(
            "last load factor cannot be used", expected="a number not 0", got=to
        )
    if not (np.isfinite(resolution) and resolution > 0.0):
        raise InputError(
            "resolution cannot be used", expected="a positive number", got=resolution
        )
    # The mechanism before the load, and what acts on it.
    kind = checked_load(load_kind, load_at, load_axes, wrench is not None)
    start = Start.of(elastic, q, loads, held, wrench, kind, load_axes)
    given, elastic, posture, loads, held = start
    limits = contact_limits(given, posture)
    # The curve from there.
    path = LoadPath(elastic, posture.q, loads, fixed, held, limits, to, back, resolution)
    notes = (
        *elastic.notes,
        *notes_at_start(elastic.mechanism, posture, limits),
        *gravity_loads(elastic).notes,
    )
    curve = _trace(path, notes, [path.origin], points)
    return replace(curve, _before_load=given.before_load)


def _trace(
    path: LoadPath, notes: tuple[Note, ...], states: list[CurvePoint], points: int
) -> LoadCurve:
    """Continue from the last of `states` until a reason to stop."""
    goal, limits, sign = path.goal, path.limits, np.sign(path.goal)
    critical: list[CriticalPoint] = []
    reason: Reason = "points-reached"
    size = path.resolution
    while len(states) < points:
        here = states[-1]
        # One step along the curve; the last one ends at the goal.
        taken = _advance(path, here, size)
        if taken is None:
            reason = "lost"
            break
        there, size_taken = taken
        last = (there.factor - goal) * sign >= 0.0
        if last:
            there = _land(path, here, there, goal, size_taken) or there
        # Critical points on the way; a step that jumped to another curve is taken again,
        # shorter.
        found: list[CriticalPoint] = []
        if len(states) > 1 or not _is_singular(here):
            found = crossings(path, here, there, size_taken)
            if _is_elsewhere(here, there, found) and size_taken >= 4 * _SMALLEST_STEP:
                size = 0.25 * size_taken
                continue
        # A limit, the goal, or the way back end the curve.
        at = there.point.posture
        if limits.side(limits.values(at.q, at.pose)).any():
            reason = "limit-contact"
            break
        if last:
            found = [c for c in found if (c.factor - goal) * sign <= 0.0]
        critical += found
        states.append(there)
        if last:
            reason = "factor-reached"
            break
        if there.factor * sign < -path.back * abs(goal):
            reason = "factor-left"
            break
        size = min(size_taken * _growth(there.corrections), path.resolution)
    return _collected(path, notes, states, critical, reason)


# The first step to where a measure falls, and the largest turn, as a cosine, of any.
_FIRST_STEP, _LEAST_TURN = 0.5, 0.99


def where_it_falls(
    path: LoadPath,
    measure: Callable[[CurvePoint], float],
    most: float,
    precision: float,
) -> tuple[CurvePoint, bool] | None:
    """The first state of a growing load whose measure is no longer positive.

    Parameters
    ----------
    path : LoadPath
        Traced from its origin.
    measure : callable
        Positive while the load may grow.
    most : float
        Factor at which the search ends.
    precision : float
        Error of the state, as a share of a step.

    Returns
    -------
    state : CurvePoint
        There; or where a motion loses its stiffness, or the curve is lost, before.
    is_held : bool
        False in the latter cases.
        None in place of both if neither is met up to `most`.
    """

    def falls(state: CurvePoint) -> float:
        # A measure that stays at zero has no sign to bracket.
        return measure(state) or -1.0

    here, size = path.origin, _FIRST_STEP
    if _verdict(here) is False or falls(here) < 0.0:
        return here, _verdict(here) is not False
    while here.factor < most:
        taken = _advance(path, here, size, _LEAST_TURN)
        if taken is None:
            return here, False
        there, size = taken
        passed = crossings(path, here, there, size)
        if _is_elsewhere(here, there, passed) and size >= 4 * _SMALLEST_STEP:
            size *= 0.25
            continue
        end = passed[0]._state if passed else there
        if falls(end) < 0.0:
            size = path.distance(here, end)
            return _located(path, here, end, size, falls, precision), True
        if passed or _verdict(there) is False:
            return end, False
        here, size = there, size * _growth(there.corrections)
    return None


def _growth(corrections: int) -> float:
    """Factor of the next step after one that took so many Newton steps."""
    if corrections <= 3:
        return 1.5
    return 0.7 if corrections > 6 else 1.0


def _is_elsewhere(
    here: CurvePoint, there: CurvePoint, found: list[CriticalPoint]
) -> bool:
    """Whether a step has led to another curve, as where an imperfection splits a
    bifurcation.

    Then there are no true limit points between, or they do not turn the load: by Cramer's
    rule det H_N = t_p det B, B the bordered matrix, whose determinant keeps its sign
    along one curve.
    """
    limits = [c for c in found if c.kind == "limit"]
    turns = here.direction[-1] * there.direction[-1] < 0.0
    is_none = any(abs(c.eigenvalue) > numerics.NEGLIGIBLE_DISTANCE for c in limits)
    return bool(limits) and (is_none or turns != bool(len(limits) % 2))


def _is_singular(state: CurvePoint) -> bool:
    values = np.abs(state.eigenvalues)
    return bool(
        values.size and values.min() <= numerics.NEGLIGIBLE_DIFFERENCE * values.max()
    )


def _advance(
    path: LoadPath, here: CurvePoint, size: float, cosine: float = _COSINE
) -> tuple[CurvePoint, float] | None:
    """The next point and its distance.

    The step is halved until the direction changes little.
    """
    while size >= _SMALLEST_STEP:
        try:
            there = path.step(here, size)
        except _LOST:
            size *= 0.5
            continue
        if float(there.direction @ here.direction) >= cosine or size < 4 * _SMALLEST_STEP:
            return there, size
        size *= 0.5
    return None


def _land(
    path: LoadPath, here: CurvePoint, there: CurvePoint, goal: float, size: float
) -> CurvePoint | None:
    """The point of the curve at a given factor, between two neighbours."""
    hold = np.zeros(here.direction.size)
    hold[-1] = 1.0
    share = (goal - here.factor) / (there.factor - here.factor)
    try:
        near = path.step(here, share * size)
        landed = path.corrected(near.point.q, goal, hold)
    except _LOST:
        return None
    if float(landed.direction @ here.direction) < 0.0:
        landed.direction *= -1.0
    return landed


def _verdict(state: CurvePoint) -> bool | None:
    """Whether an equilibrium is stable; None if that is not decided."""
    if not state.is_conservative:
        return False if is_unstable(state.balance, state.vibrations) else None
    scaled = state.balance.modes[0]
    if np.abs(scaled).min(initial=np.inf) <= FREE_MOTION_STIFFNESS:
        return None
    return bool(np.all(scaled > 0.0))


def _collected(
    path: LoadPath,
    notes: tuple[Note, ...],
    states: list[CurvePoint],
    critical: list[CriticalPoint],
    reason: Reason,
) -> LoadCurve:
    elastic, factors = path.system.elastic, np.array([s.factor for s in states])
    origin = path.origin.point.posture.pose
    new = elastic.diagnostics(max(states, key=lambda s: abs(s.factor)).point.posture)
    if not all(s.is_conservative for s in states):
        new = [*new, UNDAMPED if all(s.vibrations for s in states) else MASSLESS]
    codes = {note.code for note in new}
    kept = [note for note in notes if note.code not in codes]
    return LoadCurve(
        elastic,
        factors,
        np.array([s.point.q for s in states]),
        np.array([displacement_between(origin, s.point.posture.pose) for s in states]),
        factors[:, None] * path.linear_rate,
        np.array([s.smallest for s in states]),
        tuple(map(_verdict, states)),
        tuple(critical),
        reason,
        (*kept, *new),
        path,
    )
