"""The answer to the question where a mechanism comes to rest."""

from __future__ import annotations

from cartstiff.answer.data import Answer, Displacement, Motion
from cartstiff.answer.posture import (
    extremes_of,
    force_statements,
    force_tables,
    load_of,
    vector,
)
from cartstiff.answer.verdict import Level, Verdict
from cartstiff.statics.rest import Equilibrium

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
        state.notes,
        verdict=Verdict(level, code),
        load=load_of(state.elastic_stiffness),
        displacement=moved,
        extremes=tuple(extremes_of(there, there.at(), "load")),
        statements=force_statements(there.forces, there.units),
        tables=tuple(force_tables(there)),
    )
