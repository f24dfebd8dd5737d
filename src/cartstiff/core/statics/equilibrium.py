r"""Static equilibrium of any elastic mechanism under load, and its stability.

The energy of springs, gravity and loads is minimised over all coordinates that keep the
closures, the held components of the end-effector's displacement and the limits; forces
that have no energy are balanced directly. See `cartstiff.core.statics.problem` for the
equations, `cartstiff.core.statics.newton` for the method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_flag
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import ConvergenceError, InputError, UndefinedError
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.potentials.loads import Scaled
from cartstiff.core.statics.continuation import Start, load_curve, start_and_loads
from cartstiff.core.statics.held import Held
from cartstiff.core.statics.newton import Solution, solve
from cartstiff.core.statics.problem import (
    Contact,
    ExhaustedError,
    System,
    bounded,
    contact_limits,
)
from cartstiff.core.statics.rest import MAX_CURVE_POINTS, Equilibrium, state_of_rest
from cartstiff.core.statics.small_motions import divergence
from cartstiff.core.stiffness.applied_load import (
    DEAD_AT_ORIGIN,
    Axes,
    Behaviour,
    checked_load,
)


def relaxed(elastic: ElasticMechanism, q: ArrayLike | None = None) -> Array:
    """Coordinates (n,) of least energy along the self-motion, at a fixed pose of the
    end-effector.

    Under arbitrary joint torques a redundant arm is not in equilibrium with any wrench at
    its end-effector: it moves along its self-motion until the energy has a minimum over
    it. There ``Z^T grad Phi = 0`` with Z the null space of the Jacobian, and a wrench
    exists.

    Parameters
    ----------
    elastic : ElasticMechanism
        With the rest positions that cause the torques.
    q : array_like (n,), optional
        Start; default the file's posture.

    Raises
    ------
    ConvergenceError
        If no minimum is found.
    """
    start = elastic.mechanism.closed(elastic.q if q is None else q)
    held = Held.from_pose(start.pose)
    return equilibrium(elastic, q=start.q, held=held, limits=False).q


# Steps by which loads and displacements are increased if no equilibrium is found at once.
_STAGES = 8


@checked
def equilibrium(
    elastic: ElasticMechanism,
    q: ArrayLike | Mapping[str, float] | Potential | None = None,
    *loads: Potential,
    wrench: ArrayLike | None = None,
    load_kind: Behaviour = "dead",
    load_at: ArrayLike = DEAD_AT_ORIGIN.at,
    load_axes: Axes = "body",
    held: Held | Mapping[str, float] | None = None,
    against_gravity: ArrayLike | None = None,
    limits: bool = True,
    settle: bool = True,
    iterations: int = 200,
) -> Equilibrium:
    r"""Equilibrium of a mechanism under load.

    Before the load the mechanism carries its weight and payload. With springs without
    rest positions it is then at rest at `q`; with given ones it first moves from there to
    its rest, which is the `Equilibrium.relaxation`, and
    `Equilibrium.displacement_by_load` counts from it.

    Parameters
    ----------
    elastic : ElasticMechanism
        Mechanism and potentials, from `cartstiff.load`. Springs without a rest position
        carry weight and payload at `q`, as in `cartstiff.analyse`.
    q : array_like (n,) or mapping, optional
        Start, in rad and length units, in joint order or by name; default the file's
        posture. A potential in its place is the first of `loads`.
    *loads : Potential
        Added loads: `DeadForce`, `DeadWrench`, `FollowerWrench`, `payload` (the weight of
        a mass that comes with the load; one of ``load(payload=)`` acts before it), or any
        energy.
    wrench, load_kind, load_at, load_axes
        Load (moment, force) on the body, its behaviour while the body moves, the point of
        the body, in M, at which it acts, and the axes of its components, those of M at
        the start or of F: as in `cartstiff.analyse`.
    held : Held or mapping, optional
        Displacement of a frame prescribed partly or wholly. A mapping such as ``{"z":
        -0.005}`` counts from the pose at the start, along the body's axes there.
    against_gravity : array_like (3,), optional
        Gravity before the load, in F [m/s^2], if it was another: springs without a rest
        position carry that one at `q`, and the displacement counts from the rest under
        it.
    limits : bool
        Keep joint (or leg) limits, as contacts.
    settle : bool
        Continue from an unstable equilibrium to a stable one, if the loads have a
        potential; if they have none, from a saddle whose stability only masses decide:
        the search then starts at the equilibrium under similar loads with a potential.
        Without it the equilibrium found first is returned, stable or not.
    iterations : int
        Bound on the number of Newton steps, for each stage of loading.

    Returns
    -------
    Equilibrium
        Coordinates, residual, stability, reactions, stiffness.

    Raises
    ------
    InputError
        For a wrong count, an unknown name, numbers that are not finite, or a load of a
        wrong type.
    ConvergenceError
        If no equilibrium is found, neither at once nor with the loads increased in
        stages; beside stiff springs, nor along the curve of equilibria that ends at the
        load.
    UndefinedError
        If a force does not exist at the start (a line of zero length).

    Examples
    --------
    >>> import cartstiff
    >>> from cartstiff import DeadForce
    >>> state = equilibrium(cartstiff.load("stewart-gough"), DeadForce([0.0, 0.0, -50.0]))
    >>> state.stable
    True
    """
    if not (isinstance(iterations, Integral) and iterations >= 1):
        raise InputError(
            "bound on the steps cannot be used", expected="1 or more", got=iterations
        )
    limits, settle = checked_flag(limits, "limits"), checked_flag(settle, "settle")
    q, loads = start_and_loads(q, loads)
    given = checked_elastic(elastic)
    if against_gravity is not None:
        elastic, q = _before_turning(given, q, against_gravity, limits)
    kind = checked_load(load_kind, load_at, load_axes, wrench is not None)
    start = Start.of(elastic, q, loads, held, wrench, kind, load_axes)
    # What acts, from where; then the search, and its result.
    original, elastic, posture, loads, held = start
    chosen = None
    if elastic.identified is not None:
        chosen = original.chosen_forces(elastic, posture)
    acting = contact_limits(original, posture) if limits else None
    system = System(elastic, loads, held, acting)
    with bounded(elastic):
        solution, stages = _at_once_or_in_stages(system, posture.q, iterations, settle)
    facts = {"_chosen": chosen, "_before_load": given.before_load}
    return state_of_rest(system, solution, posture, stages, **facts)


def _at_once_or_in_stages(
    system: System, q: Array, iterations: int, settle: bool
) -> tuple[Solution, int]:
    """The equilibrium found from q, and the number of stages in which loads and
    displacements were put on.
    """
    try:
        solution = solve(system, q, iterations=iterations, settle=settle)
        if settle and solution.is_saddle and divergence(solution.balance) is None:
            solution = _from_rest(system, q, iterations) or solution
        return solution, 1
    except ConvergenceError:
        if not system.loads and system.held is None:
            raise
        staged = in_stages(system, q, iterations, settle)
        if staged is None:
            staged = _along_its_curve(system, q, iterations, settle)
        if staged is None:
            raise
        return replace(staged, is_far=True), _STAGES


def _before_turning(
    elastic: ElasticMechanism, q: Any, gravity: ArrayLike, limits: bool
) -> tuple[ElasticMechanism, Array]:
    """The mechanism with the rest positions of another gravity, and its rest there."""
    before = equilibrium(
        elastic.with_gravity(gravity, where="--against-gravity"), q, limits=limits
    )
    place = before.posture.pose[:3, 3].tolist()
    shown = [
        ", ".join(f"{x:.6g}" for x in row) for row in (np.asarray(gravity, float), place)
    ]
    words = (
        f"the displacement counts from the rest under gravity ({shown[0]}) m/s^2, with "
        f"the body frame at ({shown[1]})"
    )
    values = {"gravity": np.asarray(gravity, float).tolist(), "q": before.q.tolist()}
    unstable = (note for note in before.notes if note.code == "unstable-start")
    turned = before.elastic.with_gravity(elastic.gravity)
    return turned.with_notes(Note("against-gravity", words, values), *unstable), before.q


def again(
    state: Equilibrium, elastic: ElasticMechanism, loads: Sequence[Potential]
) -> Equilibrium:
    """Equilibrium of a mechanism that differs a little, under similar loads.

    The displacement is measured from the same pose as before. Held components and touched
    limits are the same.

    Raises
    ------
    ConvergenceError
        If no equilibrium is found nearby.
    UndefinedError
        If it rests on other limits.
    """
    touched, system = state._solution.contacts, state._system.of(elastic, loads)
    solution = solve(system, state.q, contacts=touched, settle=False)
    if solution.contacts != touched:
        raise UndefinedError("it rests on other limits", code="limit-contact")
    return state_of_rest(system, solution, state.start, 1)


def in_stages(system: System, q: Array, iterations: int, settle: bool) -> Solution | None:
    """Equilibrium with loads and held displacements increased in steps;
    None if that fails.
    """
    solution = None
    contacts: tuple[Contact, ...] = ()
    try:
        for stage in range(1, _STAGES + 1):
            share = stage / _STAGES
            loads: Sequence[Potential] = system.loads
            if stage < _STAGES:
                loads = [Scaled(f, share) for f in loads]
            held = None if system.held is None else system.held.scaled(share)
            part = System(system.elastic, loads, held, system.limits)
            solution = solve(
                part, q, contacts=contacts, iterations=min(iterations, 40), settle=settle
            )
            q, contacts = solution.point.q, solution.contacts
    except (ConvergenceError, ExhaustedError):
        return None
    return solution


def _from_rest(system: System, q: Array, iterations: int) -> Solution | None:
    """Equilibrium under loads without a potential, from that under similar ones
    that have one.

    Newton's steps towards a balance of such loads do not distinguish a minimum from a
    saddle. None if all loads have a potential, or this leads to a saddle, too.
    """
    start = system.at(q).posture
    is_kept = [not np.isnan(load.evaluate(start).energy) for load in system.loads]
    if all(is_kept):
        return None
    similar: list[Potential] = []
    for load, kept in zip(system.loads, is_kept, strict=True):
        if kept:
            similar.append(load)
        elif (like := load.conservative(start)) is not None:
            similar.append(like)
    try:
        rest = solve(
            System(system.elastic, similar, system.held, system.limits),
            q,
            iterations=iterations,
        )
        found = solve(system, rest.point.q, contacts=rest.contacts, iterations=iterations)
    except ConvergenceError:
        return None
    return None if found.is_saddle else found


def _along_its_curve(
    system: System, q: Array, iterations: int, settle: bool
) -> Solution | None:
    """Equilibrium at the end of the load curve, for soft motions beside stiff springs.

    The tangent at one point predicts the next: soft motions follow it, stiff ones nearly
    stay. None if that fails, or the curve passes a critical load: beyond, another
    equilibrium may be meant.
    """
    try:
        _, ratio = system.own_stiffness(system.at(q).posture)
        if not (system.loads and ratio > numerics.SLOWING_STIFFNESS_RATIO):
            return None
        curve = load_curve(
            system.elastic, q, *system.loads, held=system.held, points=MAX_CURVE_POINTS
        )
        if curve.reason != "factor-reached" or curve.critical:
            return None
        return solve(system, curve.q[-1], iterations=iterations, settle=settle)
    except (ConvergenceError, UndefinedError, ExhaustedError):
        return None
