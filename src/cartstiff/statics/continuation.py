r"""Load-deflection curves through limit points, critical loads, and the branches that start there.

The loads are multiplied by a factor p that the curve is free to lower again; see
`cartstiff.statics.load_path`. The linear prediction that the curve is compared with is the one of
the compliance at its start, u = p C W.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff import numerics
from cartstiff.errors import ConvergenceError, InputError, UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import named_values
from cartstiff.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.mechanisms.limits import limit_notes, limits_of
from cartstiff.mechanisms.weighed import weights_of
from cartstiff.numerics import IDLE
from cartstiff.potentials.contract import Potential
from cartstiff.statics.critical import CriticalPoint, crossings
from cartstiff.statics.curves import LoadCurve, Reason
from cartstiff.statics.flutter import MASSLESS, UNDAMPED, divergence
from cartstiff.statics.held import Held, displacement_between
from cartstiff.statics.load_path import CurvePoint, LoadPath
from cartstiff.statics.newton import solve
from cartstiff.statics.problem import System
from cartstiff.stiffness.applied_load import checked_load

_SMALLEST = numerics.SETTLED
_START = "at the start: "
# Neighbouring directions must agree to this cosine, or the step is halved.
_COSINE = 0.9


def load_curve(
    elastic: ElasticMechanism,
    *loads: Potential,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower", "conservative"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Literal["body", "world"] = "body",
    to: float = 1.0,
    fixed: Sequence[Potential] = (),
    held: Held | Mapping[str, float] | None = None,
    q0: ArrayLike | Mapping[str, float] | None = None,
    resolution: float = 0.05,
    points: int = 400,
    back: float = 1.0,
) -> LoadCurve:
    """Trace the equilibria of a mechanism whose loads grow by a common factor.

    Parameters
    ----------
    elastic : ElasticMechanism
        From `cartstiff.load`.
    *loads : Potential
        What the factor multiplies; factor 1 is the load as given.
    wrench, load_kind, load_at, load_axes
        A load that the factor multiplies too, as in `equilibrium`.
    to : float
        Factor at which to stop; not zero, negative to reverse the load.
    fixed : sequence of Potential
        What acts besides, whatever the factor.
    held : Held or mapping, optional
        Displacement prescribed partly; see `equilibrium`.
    q0 : array_like or mapping, optional
        Where the search for the unloaded equilibrium starts; default the file's posture.
    resolution : float
        Largest distance of neighbouring points, in rad and characteristic lengths and in shares of
        `to`.
    points : int
        Bound on the number of points.
    back : float
        Past limit points the load may fall, and change its sign: as far as ``-back * to``.

    Raises
    ------
    InputError
        Without a load, for a zero or infinite `to`, or bad coordinates.
    ConvergenceError
        If there is no equilibrium without the load.
    """
    checked_elastic(elastic)
    if not loads and wrench is None:
        raise InputError("a load-deflection curve needs a load")
    if not (np.isfinite(to) and to != 0.0):
        raise InputError("last load factor cannot be used", expected="a number not 0", got=to)
    if not (np.isfinite(resolution) and resolution > 0.0):
        raise InputError("resolution cannot be used", expected="a positive number", got=resolution)
    if isinstance(q0, Mapping):
        q = named_values(q0, elastic.names, elastic.q, "q0")
    else:
        q = elastic.q if q0 is None else elastic.mechanism.checked(q0, "q0")
    elastic = elastic.balanced(q)
    posture = elastic.mechanism.at(q)
    kind = checked_load(load_kind, load_at, load_axes, wrench is not None)
    if wrench is not None:
        loads = (*loads, kind.acting(wrench, posture.pose, load_axes))
    if held is not None:
        held = (held if isinstance(held, Held) else Held(held)).at_start(posture)
    limits = limits_of(elastic.mechanism, contacts=True)
    start = solve(System(elastic, fixed, held), q)
    path = LoadPath(elastic, loads, fixed, held, abs(to))
    upwards = np.zeros(start.point.posture.coordinate_lengths.size + 1)
    upwards[-1] = np.sign(to)
    origin = path.state(start.point.q, 0.0, upwards)
    notes = (
        *elastic.notes,
        *limit_notes(elastic.mechanism, posture, _START),
        *weights_of(elastic).notes,
    )
    seed = LoadCurve(
        elastic,
        np.zeros(1),
        origin.point.q[None],
        np.zeros((1, 6)),
        np.zeros((1, 6)),
        np.zeros(1),
        (None,),
        (),
        "lost",
        notes,
        path,
        limits,
        origin.point.posture.pose,
        _linear_rate(origin, path),
        to,
        back,
        resolution,
    )
    return _trace(seed, [origin], points)


def branch(curve: LoadCurve, index: int = 0, direction: int = 1, points: int = 200) -> LoadCurve:
    """The curve that starts at a bifurcation, along its mode or against it.

    Parameters
    ----------
    curve : LoadCurve
        From `load_curve`.
    index : int
        Which of its `critical` points.
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
    if not 0 <= index < len(curve.critical):
        raise InputError(
            "no such critical point", expected=f"below {len(curve.critical)}", got=index
        )
    critical = curve.critical[index]
    if critical.kind != "bifurcation":
        raise UndefinedError(
            "no branch starts at a limit point or the onset of flutter: the curve itself goes on",
            code="no-branch",
            values={"factor": critical.factor},
        )
    along = np.append(np.sign(direction) * critical.mode, 0.0)
    size = curve._resolution
    while True:
        try:
            first = curve._path.step(critical._state, size, along)
            break
        except ConvergenceError:
            size *= 0.5
            if size < _SMALLEST:
                raise
    return _trace(curve, [critical._state, first], points)


def _linear_rate(origin: CurvePoint, path: LoadPath) -> Array:
    """Displacement (6,) per unit of the factor, by the compliance at the start."""
    posture, balance = origin.point.posture, origin.balance
    values = np.linalg.svd(balance.scaled, compute_uv=False)
    if values.size and not values[-1] > numerics.ROUNDING * values[0]:
        return np.full(6, np.nan)
    y = -balance.solved(origin.push / path.span, numerics.ROUNDING)
    twist = posture.motion.jacobian @ (origin.balance.motion(y) * posture.coordinate_lengths)
    R = posture.pose[:3, :3]
    return np.concatenate([R @ twist[:3], R @ twist[3:]])


def _trace(seed: LoadCurve, states: list[CurvePoint], points: int) -> LoadCurve:
    """Go on from the last of `states` until a reason to stop."""
    path, goal = seed._path, seed._goal
    critical: list[CriticalPoint] = []
    reason: Reason = "points-reached"
    size = seed._resolution
    while len(states) < points:
        here = states[-1]
        taken = _advance(path, here, size)
        if taken is None:
            reason = "lost"
            break
        there, size_taken = taken
        last = (there.factor - goal) * np.sign(goal) >= 0.0
        if last:
            landed = _land(path, here, there, goal, size_taken)
            if landed is not None:
                there = landed
        limits = seed._limits
        at = there.point.posture
        if limits.side(limits.values(at.q, at.pose)).any():
            reason = "limit-contact"
            break
        if len(states) > 1 or not _is_singular(here):
            critical += [
                c
                for c in crossings(path, here, there, size_taken)
                if not last or (c.factor - goal) * np.sign(goal) <= 0.0
            ]
        states.append(there)
        if last:
            reason = "factor-reached"
            break
        if there.factor * np.sign(goal) < -seed._back * abs(goal):
            reason = "factor-left"
            break
        grow = 1.5 if there.corrections <= 3 else 0.7 if there.corrections > 6 else 1.0
        size = min(size_taken * grow, seed._resolution)
    return _collected(seed, states, critical, reason)


def _is_singular(state: CurvePoint) -> bool:
    values = np.abs(state.eigenvalues)
    return bool(values.size and values.min() <= numerics.CLOSE * values.max())


def _advance(path: LoadPath, here: CurvePoint, size: float) -> tuple[CurvePoint, float] | None:
    """The next point, with the step halved until the curve turns gently."""
    while size >= _SMALLEST:
        try:
            there = path.step(here, size)
        except (ConvergenceError, UndefinedError, np.linalg.LinAlgError):
            size *= 0.5
            continue
        if float(there.direction @ here.direction) >= _COSINE or size < 4 * _SMALLEST:
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
    except (ConvergenceError, UndefinedError, np.linalg.LinAlgError):
        return None
    if float(landed.direction @ here.direction) < 0.0:
        landed.direction *= -1.0
    return landed


def _verdict(state: CurvePoint) -> bool | None:
    """Whether an equilibrium is stable; None where that is not decided."""
    if not state.is_conservative:
        moving = state.vibrations
        grows = moving is not None and moving.growing
        return False if grows or divergence(state.balance) is not None else None
    scaled = state.balance.modes[0]
    if np.abs(scaled).min(initial=np.inf) <= IDLE:
        return None
    return bool(np.all(scaled > 0.0))


def _collected(
    seed: LoadCurve, states: list[CurvePoint], critical: list[CriticalPoint], reason: Reason
) -> LoadCurve:
    factors = np.array([s.factor for s in states])
    conservative = all(s.is_conservative for s in states)
    new = seed.elastic.remarks(max(states, key=lambda s: abs(s.factor)).point.posture)
    if not conservative:
        new = [*new, UNDAMPED if all(s.vibrations for s in states) else MASSLESS]
    notes = [*(n for n in seed.notes if n.code not in {m.code for m in new}), *new]
    return LoadCurve(
        seed.elastic,
        factors,
        np.array([s.point.q for s in states]),
        np.array([displacement_between(seed._origin, s.point.posture.pose) for s in states]),
        factors[:, None] * seed._rate,
        np.array(
            [s.eigenvalues.min(initial=np.inf) if s.is_conservative else np.nan for s in states]
        ),
        tuple(_verdict(s) for s in states),
        tuple(critical),
        reason,
        tuple(notes),
        seed._path,
        seed._limits,
        seed._origin,
        seed._rate,
        seed._goal,
        seed._back,
        seed._resolution,
    )
