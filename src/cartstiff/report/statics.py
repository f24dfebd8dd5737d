"""Equilibria, load-deflection curves and compensated paths as text for people,
and as figures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cartstiff.answer.equilibrium import answer_of_equilibrium
from cartstiff.answer.paths import sizes
from cartstiff.errors import joined
from cartstiff.report.analysis import describe
from cartstiff.report.answer import answer_lines, tables_lines
from cartstiff.report.layout import wide_row

if TYPE_CHECKING:
    from cartstiff.geometry.se3 import Array
    from cartstiff.statics.rest import Equilibrium

_STABLE = {
    True: "stable",
    False: "UNSTABLE",
    None: "not decided by definiteness (see the notes)",
}


def describe_equilibrium(state: Equilibrium) -> str:
    """Describe an equilibrium, and its stiffness with the loads included."""
    units, mm = state.elastic.units, state.elastic.units.shown_per_length
    answer = answer_of_equilibrium(state)
    lines = [
        f"Equilibrium: {_STABLE[state.stable]}, residual {state.residual:.2g} (relative) "
        "after "
        f"{state.iterations} step(s)",
        _softest(state),
        *answer_lines(answer),
        *tables_lines(answer.tables),
        "",
        *_displacements(state),
    ]
    if (known := state.elastic.identified) is not None and (
        s := state.displacement_deviation
    ) is not None:
        half, percent = known.factor * s, f"{100 * known.level:g} %"
        lines += [
            f"  {percent} from the measured springs:",
            f"  rotation  +- {wide_row(np.degrees(half[:3]))} deg",
            f"  transl.   +- {wide_row(mm * half[3:])} {units.shown_length}",
        ]
    elastic = state.elastic_stiffness
    if elastic.wrench is not None:
        W = elastic.shown_wrench(elastic.wrench)
        lines += [
            "",
            state.meaning_of_elastic_wrench[0].upper()
            + state.meaning_of_elastic_wrench[1:],
            f"  moment       {wide_row(W[:3])} {units.moment}",
            f"  force        {wide_row(W[3:])} {units.force}",
        ]
    lines += [*_reactions(state), "", "Stiffness there, loads included", ""]
    lines += describe(state.stiffness, at_rest=True, told=answer.doubts).split("\n")
    return joined(lines)


def _displacements(state: Equilibrium) -> list[str]:
    """Describe the displacement.

    Where it begins with a relaxation, its two parts by name.
    """
    turn, length = sizes(state.posture)
    units, mm = state.elastic.units, state.elastic.units.shown_per_length

    def rows(displacement: Array) -> list[str]:
        return [
            f"  rotation     {wide_row(np.degrees(displacement[:3]), np.degrees(turn))} "
            "deg",
            f"  translation  {wide_row(mm * displacement[3:], mm * length)} "
            f"{units.shown_length}",
        ]

    whole = "Displacement of the body frame from the start to the equilibrium, axes of F"
    before, by_load = state.before, state.displacement_by_load
    if before is None or by_load is None:
        more = "  without the load no rest was found: its own part is not known"
        return [whole, *rows(state.displacement), more]
    if before is state or not before.iterations:
        return [whole, *rows(state.displacement)]
    return [
        "Displacement of the body frame before the load, from the start to its rest, "
        "axes of F",
        *rows(before.displacement),
        "Displacement of the body frame by the load, from that rest, axes of F",
        *rows(by_load),
    ]


def _reactions(state: Equilibrium) -> list[str]:
    """List the reactions of held components, limits and rigid joints; round-off as 0."""
    units, reactions = state.elastic.units, state.reactions
    lengths = {c.name: c.is_length for c in state.elastic.mechanism.coordinates}
    held = {
        f"held {name}": (x, not name.startswith("r"))
        for name, x in reactions.held.items()
    }
    # Names that are no coordinates are legs.
    limits = {
        f"limit of {n}": (x, lengths.get(n, True)) for n, x in reactions.limits.items()
    }
    rigid = {f"rigid {n}": (x, lengths.get(n, True)) for n, x in reactions.rigid.items()}
    rows = {**held, **limits, **rigid}
    largest = max((abs(x) for x, _ in rows.values()), default=0.0)
    wrench = state.elastic_stiffness.wrench
    if wrench is not None:
        largest = max(largest, float(np.abs(wrench).max()))
    return [
        f"  {name}: reaction {wide_row([x], largest).strip()} {units.effort(is_force)}"
        for name, (x, is_force) in rows.items()
    ]


def _softest(state: Equilibrium) -> str:
    """Describe the criterion of stability in one line."""
    values = state.eigenvalues
    if not state.is_conservative:
        if values.size == 0 and state.stable is False:
            return "  the determinant of the tangent is negative (see the notes)"
        if values.size == 0:
            return (
                "  flutter and divergence are not examined: motions without mass are left"
            )
        turning = np.sqrt(np.abs(values[0])) / (2 * np.pi)
        if np.iscomplexobj(values) or values[0] < 0.0:
            return "  undamped vibrations grow (see the notes)"
        return f"  lowest undamped frequency {turning:.6g} Hz"
    if values.size == 0:
        return "  nothing can move"
    unit = state.elastic.units.moment
    return f"  smallest eigenvalue of the energy's Hessian {values[0]:.6g} {unit}"
