"""A solution's verdict: is it stable, what holds it, what was assumed."""

from __future__ import annotations

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import read_only
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.limits import force_notes, limit_notes, limits_of
from cartstiff.mechanisms.weighed import weights_of
from cartstiff.notes import Note
from cartstiff.numerics import EPSILON, IDLE
from cartstiff.potentials.springs import JointSprings
from cartstiff.statics.balance import Balance, spectrum
from cartstiff.statics.flutter import MASSLESS, UNDAMPED, divergence, vibrations
from cartstiff.statics.newton import Solution
from cartstiff.statics.point import Point
from cartstiff.statics.problem import System
from cartstiff.statics.rest import Equilibrium, Reactions

# A force that is unsure by more than this share of the largest one is named.
_COUNTS = numerics.UNFELT
_NEUTRAL = (
    "a motion costs no energy to second order, or too little to be seen beside the stiffest "
    "spring: definiteness does not decide stability here"
)


def state_of_rest(
    system: System, solution: Solution, start: MechanismPosture, stages: int
) -> Equilibrium:
    """The result of a solution: verdict on its stability, reactions, notes."""
    point, balance = solution.point, solution.balance
    notes = list(system.elastic.notes)
    conservative = not np.isnan(point.evaluation.energy)
    unresolved = _unresolved(point, balance, start)
    known = [n.values.get("largest") for n in unresolved]
    is_anywhere = any(isinstance(x, float) and x >= 1.0 for x in known)
    stable, squares, remarks = (
        _by_energy(balance, is_anywhere) if conservative else _by_vibrations(system, point, balance)
    )
    notes += remarks
    if stages > 1:
        notes.append(
            Note(
                "load-stages",
                f"the load was put on in {stages} stages: at once, no equilibrium was found",
                {"stages": stages},
            )
        )
    beyond = limit_notes(system.elastic.mechanism, start, "at the start: ")
    if beyond and len(system.limits):
        words = ". The limits act from there on: the displacement begins with the way back to them"
        beyond = [Note(n.code, n.message + words, n.values) for n in beyond]
    notes += beyond
    beside = limits_of(system.elastic.mechanism)
    if not len(system.limits) or len(beside) > len(system.limits):
        notes += limit_notes(system.elastic.mechanism, point.posture, "at rest: ")
    notes += force_notes(system.elastic, point.posture)
    notes += system.elastic.remarks(point.posture)
    if system.elastic.gravity is not None:
        notes += weights_of(system.elastic).notes
    notes += _drowned(system.elastic, point)
    if stable is not False:  # at an unstable one nothing stays
        notes += unresolved
    reactions = _reactions(system, solution)
    for name, force in reactions.limits.items():
        side = "lower" if force > 0 else "upper"
        notes.append(Note("limit-contact", f"{name} rests on its {side} limit", {name: force}))
    return Equilibrium(
        system.elastic,
        system.loads,
        read_only(point.q),
        point.posture,
        start,
        point.evaluation.energy,
        0.0 if balance.is_rounding else balance.residual,
        solution.iterations,
        tuple(solution.history),
        stable,
        reactions,
        tuple(notes),
        system,
        solution,
        squares,
    )


def _by_energy(balance: Balance, is_anywhere: bool) -> tuple[bool | None, None, list[Note]]:
    """Verdict by the energy's second derivative, no vibrations, and notes.

    There is none of a posture that may be anywhere.
    """
    scaled, modes = balance.modes
    zero = max(IDLE, balance.unsure)
    if not is_anywhere and (scaled > zero).all():
        return True, None, []
    facts: dict[str, object] = {"eigenvalues": spectrum(balance, conservative=True).tolist()}
    if is_anywhere or (scaled >= -zero).all():
        return None, None, [Note("neutral", _NEUTRAL, facts)]
    direction = balance.motion(modes[:, 0])
    facts["direction"] = (direction / np.linalg.norm(direction)).tolist()
    words = "the equilibrium is unstable: the mechanism leaves it by itself"
    return False, None, [Note("unstable", words, facts)]


def _by_vibrations(
    system: System, point: Point, balance: Balance
) -> tuple[bool | None, Array, list[Note]]:
    """Verdict by small vibrations, where a load has no potential."""
    vibration = vibrations(point, balance, system.elastic.units, system.terms)
    words = "a load has no potential: the definiteness of its tangent proves nothing"
    notes = [Note("non-conservative", words)]
    squares = np.empty(0) if vibration is None else vibration.squares
    if vibration is not None and vibration.growing == "flutter":
        facts = {"frequency": vibration.frequency, "mode": vibration.mode.tolist()}
        words = "vibrations about the equilibrium grow (flutter)"
        return False, squares, [*notes, Note("flutter", words, facts)]
    is_growing = vibration is not None and vibration.growing == "divergence"
    mode = vibration.mode if vibration is not None and is_growing else divergence(balance)
    if mode is None:
        return None, squares, [*notes, MASSLESS if vibration is None else UNDAMPED]
    words = "the mechanism leaves the equilibrium in one sense (divergence)"
    if vibration is None:
        words += ", whatever its masses are: the determinant of the tangent is negative"
    facts = {"frequency": None, "mode": mode.tolist()}
    return False, squares, [*notes, Note("divergence", words, facts)]


def _drowned(elastic: ElasticMechanism, point: Point) -> list[Note]:
    """Springs so stiff that the rounding of their joint's coordinate is a force that counts."""
    springs = elastic.springs
    if not isinstance(springs, JointSprings):
        return []
    lengths = point.posture.coordinate_lengths
    size = np.maximum(np.abs(point.q), lengths) * lengths
    unsure = EPSILON * springs.stiffness * size
    acting = float(point.forces.max(initial=0.0))
    blurred = {
        elastic.names[j]: float(unsure[j] / lengths[j])
        for j in np.flatnonzero(unsure > _COUNTS * acting)
        if point.forces[j] > 0.0
    }
    if not blurred:
        return []
    return [
        Note(
            "force-unresolved",
            f"the springs of {', '.join(blurred)} are so stiff that double precision does not "
            "resolve their deflection: their forces, and the wrench that follows from them, are "
            "known to the values given here; the posture does not suffer. A rigid joint has "
            "no such limit (stiffness: rigid)",
            {"uncertainty": blurred},
        )
    ]


def _unresolved(point: Point, balance: Balance, start: MechanismPosture) -> list[Note]:
    """A posture that stiff springs leave open: their rounding moves soft motions."""
    per = 1 / np.sqrt(balance.hardness)
    if np.isnan(point.evaluation.energy) and numerics.invert(balance.scaled, per / per) is None:
        return [Note("neutral", _NEUTRAL)]  # with a potential it is said elsewhere
    inverse = np.abs(numerics.inverted(balance.scaled))
    give = per * (inverse @ (per * (balance.rounding + np.abs(balance.unbalanced))))
    if not len(per) or not np.isfinite(give).all():
        return []  # neutral, which is said
    unsure = give if balance.free is None else np.abs(balance.free) @ give
    most = float(unsure.max())
    away = np.abs(point.q - start.q) / point.posture.coordinate_lengths
    if most <= max(numerics.ROUNDING, numerics.LOST * float(away.max())):
        return []
    known = "are not known at all"
    if most < 1.0:
        known = f"are known to {most:.1g} (rad, or shares of the characteristic length)"
    words = f"the rounding of stiff springs' forces moves soft motions: coordinates {known}"
    each = unsure * point.posture.coordinate_lengths
    return [Note("posture-unresolved", words, {"largest": most, "uncertainty": each.tolist()})]


def _reactions(system: System, solution: Solution) -> Reactions:
    posture, lam = solution.point.posture, solution.balance.multipliers
    touched = len(solution.contacts)
    rows = 0 if system.held is None else len(system.held.rows)
    stiff = sorted(system.elastic.mechanism.rigid)
    loops = len(lam) - rows - touched
    closures = read_only(lam[: loops - len(stiff)])
    names = system.elastic.names
    torques = (-lam[loops - len(stiff) : loops]).tolist()
    rigid = {names[j]: torque for j, torque in zip(stiff, torques, strict=True)}
    stops = -lam[len(lam) - touched :]
    limits = {
        system.limits.names[c.quantity]: float(force)
        for c, force in zip(solution.contacts, stops, strict=True)
    }
    if system.held is None:
        return Reactions({}, None, limits, closures, rigid)
    forces = -lam[loops : loops + rows]
    _, _, to_components = system.held.constraint(posture)
    return Reactions(
        dict(zip(system.held.names, forces.tolist(), strict=True)),
        read_only(to_components.T @ forces),
        limits,
        closures,
        rigid,
    )
