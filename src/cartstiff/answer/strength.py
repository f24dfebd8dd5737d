"""How strong a posture is: what its drives carry, and how much more they hold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cartstiff.answer.data import Quantity, Statement, said
from cartstiff.answer.held_forces import held_forces
from cartstiff.core import numerics
from cartstiff.core.errors import CartstiffError
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.forces import DriveForce
from cartstiff.core.units import Units

if TYPE_CHECKING:
    from cartstiff.answer.capacity import FirstLimit
    from cartstiff.core.statics.rest import Equilibrium

#: Accuracy of the load by the equilibrium, and difference to the first order from which
#: both are said.
_ACCURACY, _UNSAID = 1e-3, 0.02


def strength_statements(
    result: PostureStiffness, allowed: float | None
) -> list[Statement]:
    """Which drive is loaded most, and how many times the load is held."""
    found = force_statements(result.forces, result.units)
    if not result._load_is_given:
        return found
    held = held_forces(result)
    if held is None or not (held.is_limited or allowed is not None):
        return found
    # Few answers need the search.
    from cartstiff.answer.capacity import capacity_at

    try:
        own = capacity_at(result, allowed, _ACCURACY)
    except CartstiffError:
        return found
    linear, there = own.linear, own.by_equilibrium
    first = linear if there is None else there
    if first.kind is not None:
        code = "capacity-linear" if there is None else "capacity"
        if there is not None:
            ratio = linear.factor / max(there.factor, numerics.TINY)
            code = "capacity" if abs(ratio - 1.0) <= _UNSAID else "capacity-differs"
        found.append(_held(code, first, linear=linear.factor))
    return [*found, *_greatest(own.payload)]


def strength_at_rest(state: Equilibrium) -> list[Statement]:
    """Which drive is loaded most at rest, and how many times all loads are held."""
    there = state.stiffness
    found = force_statements(there.forces, there.units)
    if not state.loads:
        return found
    from cartstiff.answer.capacity import capacity_of_rest, payload_at

    first, before = capacity_of_rest(state, _ACCURACY), state.before
    if first is None or before is None:
        return found
    if first.kind is not None:
        found.append(_held("capacity", first))
    held = held_forces(before.stiffness)
    payload = None if held is None else payload_at(before.stiffness, held)
    return [*found, *_greatest(payload)]


def _held(code: str, first: FirstLimit, **more: float) -> Statement:
    """How many times a load is held, until which limit."""
    limit = said(f"limit-{first.kind}", names=list(first.names))
    return said(code, factor=first.factor, **more, limit=limit)


def _greatest(payload: float | None) -> list[Statement]:
    """The mass that is held in place of a load, where drives limit one."""
    if payload is None or not np.isfinite(payload):
        return []
    return [said("greatest-payload", payload=max(payload, 0.0))]


def force_statements(forces: Sequence[DriveForce], units: Units) -> list[Statement]:
    """Which drive is loaded most; without limits the largest torque and force."""
    acting = [one for one in forces if one.force and one.force == one.force]
    if not acting:
        return []
    worst = forces[0]
    if worst.used == worst.used:
        force = Quantity(abs(worst.force), units.effort(worst.is_length))
        used = Quantity(worst.used, "1")
        return [said("most-loaded", name=worst.name, force=force, used=used)]
    acting.sort(key=lambda one: -abs(one.force))
    largest = {one.is_length: one for one in reversed(acting)}
    each = [
        said("force-of", name=x.name, force=Quantity(abs(x.force), units.effort(slides)))
        for slides, x in largest.items()
    ]
    return [said("largest-forces", each=each)]
