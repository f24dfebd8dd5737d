"""Stiffnesses and rest positions as users give them: by name, for all at once,
with units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import Array, named_values
from cartstiff.core.errors import InputError
from cartstiff.core.mechanisms.contract import Coordinate
from cartstiff.core.notes import Note
from cartstiff.core.potentials.springs import Springs
from cartstiff.core.units import Units, own_stiffness


def with_values(
    springs: Springs,
    names: tuple[str, ...],
    stiffness: float | Mapping[str, float] | ArrayLike | None,
    rest: float | Mapping[str, float] | ArrayLike | None,
    undriven: frozenset[int] = frozenset(),
) -> Springs:
    """Return the springs with other stiffness and rest, see
    `ElasticMechanism.with_springs`.

    A single stiffness for all joints does not apply to `undriven` coordinates without a
    spring.
    """
    k, passive = springs.stiffness, []
    if stiffness is not None:
        passive = np.flatnonzero(springs.is_passive).tolist()
        springs, k = _with_stiffness(springs, names, stiffness, undriven)
    rests, given = springs.rest, set[str]()
    if rest is not None:
        rests = named_values(rest, names, rests, "rest")
        given = set(rest if isinstance(rest, Mapping) else names)
        if np.any(rests < springs.least_rest):
            raise InputError(
                "rest length is negative",
                expected="zero or more",
                got=float(np.nanmin(rests)),
            )
        for j in springs.rigid:
            if names[j] in given:
                raise InputError(
                    f"joint {names[j]!r} is rigid and has no rest position",
                    expected="rest positions by name, of the others",
                )
    # Joints that were passive or rigid have no rest position yet.
    rests = np.where(np.isinf(k), np.nan, rests)
    rests[[j for j in passive if 0.0 < k[j] < np.inf and names[j] not in given]] = np.nan
    return springs.replaced(k, rests)


def _with_stiffness(
    springs: Springs, names: Sequence[str], stiffness: Any, undriven: frozenset[int]
) -> tuple[Springs, Array]:
    """Springs without the laws of joints that get a number; the stiffnesses of all."""
    k = springs.stiffness.copy()
    k[list(springs.rigid)] = np.inf
    if not isinstance(stiffness, (Mapping, list, tuple)) and np.ndim(stiffness) == 0:
        # One number, for joints that are driven or have a spring.
        undriven = undriven - set(np.flatnonzero(k).tolist()) - set(springs.laws)
        stiffness = {n: stiffness for j, n in enumerate(names) if j not in undriven}
        if not stiffness:
            raise InputError(
                "no joint is actuated or has a spring, so one stiffness is for none",
                where="stiffness",
                expected="name=value for the actuated joints, or their names under "
                "'actuated' in the file",
                got=", ".join(names),
            )
    # A number for a joint replaces its nonlinear law as well.
    named = set(stiffness if isinstance(stiffness, Mapping) else names)
    springs = springs.linear([j for j, name in enumerate(names) if name in named])
    k = named_values(stiffness, names, k, "stiffness", infinite=True)
    if np.any(k < 0):
        raise InputError("stiffness must not be negative", got=k.tolist())
    return springs, k


def in_own_units(
    given: Any, slides: Mapping[str, bool], undriven: frozenset[int], units: Units
) -> Any:
    """Return stiffnesses, some with units, as numbers in the mechanism's own units.

    `slides` says of each spring whether it slides or turns. One stiffness for all has the
    unit of the springs of driven coordinates.
    """
    if isinstance(given, Mapping):
        return {
            n: own_stiffness(k, units, slides.get(n, False), f"stiffness of {n!r}")
            for n, k in given.items()
        }
    if isinstance(given, (list, tuple)) and len(given) == len(slides):
        return [
            own_stiffness(k, units, s, f"stiffness of {n!r}")
            for k, (n, s) in zip(given, slides.items(), strict=True)
        ]
    driven = {s for j, s in enumerate(slides.values()) if j not in undriven}
    plain = given
    for is_length in driven or set(slides.values()):
        plain = own_stiffness(given, units, is_length, "stiffness of every joint")
    return plain


def rest_of_turns(coordinates: Sequence[Coordinate], rest: Array) -> list[Note]:
    """Return a note on rest positions of more than a turn, which look like degrees."""
    turns = {
        c.name: float(x)
        for c, x in zip(coordinates, rest, strict=True)
        if not c.is_length and abs(x) > 2.0 * np.pi
    }
    if not turns:
        return []
    words = "; ".join(f"{name} at {x:g} rad" for name, x in turns.items())
    words = (
        f"springs at rest after several turns: {words}. Degrees? Angles are in radians"
    )
    return [Note("rest-of-turns", words, dict(turns))]
