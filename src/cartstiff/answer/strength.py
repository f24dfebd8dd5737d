"""How strong a posture is: what its drives carry, and how much more they hold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartstiff.answer.data import Quantity, Statement, said
from cartstiff.answer.held_forces import held_forces
from cartstiff.core import numerics
from cartstiff.core.errors import CartstiffError
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.stiffness.forces import DriveForce
from cartstiff.core.units import Units

#: Accuracy of the load by the equilibrium, and difference to the first order from which
#: both are said.
_ACCURACY, _UNSAID = 1e-3, 0.02


def strength_statements(
    result: PostureStiffness, allowed: float | None = None, quickly: bool = False
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
        own = capacity_at(result, allowed, 1.0 if quickly else _ACCURACY)
    except CartstiffError:
        return found
    linear, there = own.linear, own.by_equilibrium
    first = linear if there is None else there
    if first.kind is not None:
        code = "capacity-linear" if there is None else "capacity"
        if there is not None:
            ratio = linear.factor / max(there.factor, numerics.TINY)
            code = "capacity" if abs(ratio - 1.0) <= _UNSAID else "capacity-differs"
        limit = said(f"limit-{first.kind}", names=list(first.names))
        values = {"factor": first.factor, "linear": linear.factor, "limit": limit}
        found.append(said(code, **values))
    if own.payload is not None and np.isfinite(own.payload):
        found.append(said("greatest-payload", payload=max(own.payload, 0.0)))
    return found


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
