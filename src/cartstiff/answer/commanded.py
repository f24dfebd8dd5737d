"""Commanded displacements of the drives: shifted rest positions,
and the resulting pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_number
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import InputError, check_name, checked_kind
from cartstiff.core.mechanisms.elastic import ElasticMechanism, checked_elastic
from cartstiff.core.notes import Note
from cartstiff.core.statics.equilibrium import equilibrium
from cartstiff.core.statics.rest import Equilibrium
from cartstiff.core.stiffness.applied_load import Axes, checked_load
from cartstiff.core.stiffness.balance import with_rest_balancing
from cartstiff.core.stiffness.compute import PostureStiffness, analyse


@checked
def commanded(
    elastic: ElasticMechanism,
    command: Mapping[str, float],
    q: ArrayLike | Mapping[str, float] | None = None,
) -> tuple[ElasticMechanism, Array]:
    """The mechanism with its drives commanded to move by given steps.

    Open rest positions are first chosen so that the mechanism is at rest at the posture;
    then those of the drives are shifted. Rigid drives move by their steps themselves.

    Parameters
    ----------
    elastic : ElasticMechanism
        The mechanism.
    command : mapping of str to float
        Step of each drive (rad, lengths), by the name of its joint, or leg1, ... of a
        platform on lines.
    q : array_like (n,) or mapping, optional
        Posture before the command; default the file's.

    Returns
    -------
    elastic : ElasticMechanism
        With the shifted springs, and a note ``commanded``.
    q : ndarray (n,)
        Start of the search for its equilibrium.

    Raises
    ------
    UnknownNameError
        For a name that is no spring's.
    InputError
        For a joint without a spring, which has no drive, numbers that are not finite, or
        rigid drives that cannot move so far.
    """
    mechanism, names = checked_elastic(elastic).mechanism, elastic.spring_names
    elastic, posture = elastic.placed(q)
    at = posture.q
    steps = checked_command(elastic, command)
    elastic = with_rest_balancing(elastic, at)
    springs = elastic.springs
    if springs is None:
        raise InputError(f"{elastic.name} has no springs to command", where="command")
    shifts, rigid_steps, each = dict[str, float](), dict[int, float](), []
    for name, x in steps.items():
        j = names.index(name)
        each.append(f"{name} by {x:+g} {elastic.units.coordinate(elastic.slides[j])}")
        if j in springs.rigid:
            rigid_steps[j] = x
        else:
            shifts[name] = float(springs.rest[j]) + x
    moved = elastic.with_springs(rest=shifts or None)
    words = f"drives are told to move on: {', '.join(each)}"
    note = Note("commanded", words, {"command": steps})
    return moved.with_notes(note), _driven(mechanism, at, rigid_steps)


@checked
def after_command(
    elastic: ElasticMechanism,
    command: Mapping[str, float],
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
    limits: bool = True,
) -> Equilibrium:
    """Equilibrium after a command, under the load that the mechanism carried before.

    Parameters
    ----------
    elastic, command, q
        As in `commanded`.
    wrench, load_kind, load_at, load_axes
        As in `analyse`: at `q` the springs balance it, and it continues to act.
    limits : bool
        Whether joint and leg limits stop the motion.

    Returns
    -------
    Equilibrium
        Its `elastic` has the shifted springs, its `displacement` is the effect of the
        command.

    Raises
    ------
    InputError
        As `commanded`; ConvergenceError if no equilibrium is found from there.
    """
    kind = checked_load(load_kind, load_at, load_axes, wrench is not None)
    before = analyse(
        elastic,
        q,
        wrench=wrench,
        load_kind=load_kind,
        load_at=load_at,
        load_axes=load_axes,
    )
    loads = () if wrench is None else (kind.acting(wrench, before.pose, load_axes),)
    shifted, start = commanded(before.elastic, command, before.q)
    return equilibrium(shifted, start, *loads, limits=limits)


def analyse_commanded(
    elastic: ElasticMechanism,
    command: Mapping[str, float],
    q: ArrayLike | Mapping[str, float] | None = None,
    *,
    wrench: ArrayLike | None = None,
    load_kind: Literal["dead", "follower"] = "dead",
    load_at: ArrayLike = (0.0, 0.0, 0.0),
    load_axes: Axes = "body",
) -> PostureStiffness:
    """Stiffness at the equilibrium after a command, see `after_command`.

    Parameters
    ----------
    elastic, command, q
        As of `commanded`.
    wrench, load_kind, load_at, load_axes
        As of `after_command`. Without a wrench, kind and point are those of the springs'
        forces.

    Raises
    ------
    InputError
        As `after_command`; ConvergenceError if no equilibrium is found from there.
    """
    if wrench is None:
        state = after_command(elastic, command, q)
    else:
        state = after_command(
            elastic,
            command,
            q,
            wrench=wrench,
            load_kind=load_kind,
            load_at=load_at,
            load_axes=load_axes,
        )
    return analyse(state.elastic, state.q, load_kind=load_kind, load_at=load_at)


def drives(elastic: ElasticMechanism) -> tuple[str, ...]:
    """Names of the drives: joints with a spring, or the legs of a platform on lines."""
    names, springs = elastic.spring_names, elastic.springs
    undriven = frozenset[int]() if springs is None else springs.undriven
    return tuple(n for j, n in enumerate(names) if j not in undriven)


def checked_command(
    elastic: ElasticMechanism, command: Mapping[str, float]
) -> dict[str, float]:
    """The steps of drives by name.

    Raises
    ------
    UnknownNameError, InputError
        As `commanded`.
    """
    names, driven = elastic.spring_names, drives(elastic)
    steps = {}
    checked_kind(command, Mapping, "command", "names of drives and how far they move")
    for name, value in command.items():
        check_name("drive", name, names, "command")
        if name not in driven:
            some = (
                "one of " + ", ".join(driven[:12]) + (", ..." if len(driven) > 12 else "")
            )
            raise InputError(
                f"joint {name!r} has no spring: nothing drives it",
                where="command",
                expected=some,
                got=name,
            )
        steps[name] = checked_number(value, f"command of {name}")
    if not steps:
        raise InputError("commands no drive", where="command", expected="name=value")
    return steps


def _driven(mechanism: Any, q: Array, steps: Mapping[int, float]) -> Array:
    """Coordinates with rigid drives moved; the others satisfy the closures."""
    if not steps:
        return q
    wanted = np.array(q)
    for j, x in steps.items():
        wanted[j] += x
    if not mechanism.closures:
        return wanted
    held = sorted(mechanism.rigid | mechanism.virtual)
    assembled = mechanism.closed(wanted, hold=held).q
    gap = float(np.abs(assembled - wanted)[list(steps)].max())
    if gap > numerics.NEGLIGIBLE_DIFFERENCE:
        raise InputError(
            "the machine cannot follow its rigid drives there",
            where="command",
            expected="a smaller command",
            got=f"{gap:.3g} away",
        )
    return assembled
