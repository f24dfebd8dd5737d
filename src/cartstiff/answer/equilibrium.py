"""The answer to the question where a mechanism comes to rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff.answer.data import (
    Answer,
    Displacement,
    Motion,
    Quantity,
    Statement,
    Table,
    rounded,
    said,
    table,
)
from cartstiff.answer.posture import (
    circumstances,
    extremes_of,
    load_of,
    sizes,
    tables_of,
    vector,
)
from cartstiff.answer.strength import strength_at_rest
from cartstiff.answer.verdict import Level, Verdict
from cartstiff.core.arrays import Array

if TYPE_CHECKING:
    from cartstiff.core.statics.rest import Equilibrium

#: Verdicts on an equilibrium by `Equilibrium.stable`.
STABILITY: dict[bool | None, tuple[Level, str]] = {
    True: ("good", "stable"),
    False: ("bad", "unstable"),
    None: ("warning", "undecided"),
}


def answer_of_equilibrium(state: Equilibrium) -> Answer:
    """Verdict, displacement by the load, stiffness with the loads included, doubts."""
    elastic, there = state.elastic, state.stiffness
    moved = None
    if (by_load := state.displacement_by_load) is not None and state.loads:
        motion = Motion(vector(by_load[3:]), vector(by_load[:3]))
        moved = Displacement("load", "load", (0.0, 0.0, 0.0), None, motion)
    level, code = STABILITY[state.stable]
    return Answer.about_mechanism(
        "equilibrium",
        elastic,
        [*state.notes, *there.notes],
        said("rest", steps=state.iterations, residual=float(state.residual)),
        _criterion(state),
        *strength_at_rest(state),
        verdict=Verdict(level, code),
        about=[said("mechanism"), *circumstances(there, at_rest=True)],
        weight=there.weighed,
        load=load_of(state.elastic_stiffness),
        displacement=moved,
        extremes=tuple(extremes_of(there, there.at(), "load")),
        tables=[_displacements(state), *_forces(state), *tables_of(there, None)],
    )


def _criterion(state: Equilibrium) -> Statement:
    """What decides whether the equilibrium is stable."""
    values = state.eigenvalues
    if state.is_conservative:
        if values.size == 0:
            return said("nothing-moves")
        least = Quantity(float(values[0]), state.elastic.units.moment)
        return said("smallest-eigenvalue", value=least)
    if values.size == 0:
        return said(("not-examined", "negative-determinant")[state.stable is False])
    if np.iscomplexobj(values) or values[0] < 0.0:
        return said("undamped-growth")
    hertz = float(np.sqrt(np.abs(values[0])) / (2 * np.pi))
    return said("lowest-undamped", frequency=Quantity(hertz, "Hz"))


def _displacements(state: Equilibrium) -> Table:
    """The displacement; where it begins with a relaxation, its two parts."""
    turn, length = sizes(state.posture)
    units, before, by_load = state.elastic.units, state.before, state.displacement_by_load

    def row(name: str, d: Array) -> tuple[str, Quantity, Quantity]:
        turned, moved = (
            Quantity(rounded(part, max(size, float(np.abs(part).max()))), unit)
            for part, size, unit in (
                (d[:3], turn, units.angle),
                (d[3:], length, units.length),
            )
        )
        return name, turned, moved

    below = []
    rows = [row("from the start to the equilibrium", state.displacement)]
    if before is None or by_load is None:
        below = [said("no-rest-before")]
    elif before is not state and before.iterations:
        rows = [
            row("before the load, from the start to its rest", before.displacement),
            row("by the load, from that rest", by_load),
        ]
    known, deviation = state.elastic.identified, state.displacement_deviation
    if known is not None and deviation is not None:
        name = f"+- {100.0 * known.level:g} %, from the measured springs"
        rows.append(row(name, known.factor * deviation))
    return table("displacement", " : < | rotation : 6 | translation : 6", rows, *below)


def _forces(state: Equilibrium) -> Iterator[Table]:
    """The wrench that the springs balance, and the reactions of held components,
    limits and rigid joints; round-off is 0.
    """
    units, elastic = state.elastic.units, state.elastic_stiffness
    W, largest = elastic.wrench, 0.0
    if W is not None:
        own = elastic.shown_wrench(W)
        largest = float(np.abs(W).max())
        cells = (
            Quantity(vector(own[:3]), units.moment),
            Quantity(vector(own[3:]), units.force),
        )
        meaning = state.meaning_of_elastic_wrench
        heads = "moment : 6 | force : 6"
        yield table("wrench", heads, [cells], what=meaning[0].upper() + meaning[1:])
    lengths = {c.name: c.is_length for c in state.elastic.mechanism.coordinates}
    found = state.reactions
    parts: list[tuple[str, bool, float]] = [
        (f"held {name}", not name.startswith("r"), x) for name, x in found.held.items()
    ]
    # Names that are no coordinates are legs.
    for what, own_parts in (("limit of", found.limits), ("rigid", found.rigid)):
        parts += [(f"{what} {n}", lengths.get(n, True), x) for n, x in own_parts.items()]
    largest = max([largest, *(abs(x) for *_, x in parts)])
    rows: list[Any] = [
        (name, Quantity(rounded([x], largest)[0], units.effort(is_force)))
        for name, is_force, x in parts
    ]
    if rows:
        yield table("reactions", " : < | reaction : 6", rows)
