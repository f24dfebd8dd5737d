"""The dict of an analysis as text for reading, with units on every number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from cartstiff.answer.data import Answer, Quantity, said
from cartstiff.answer.equilibrium import answer_of_equilibrium
from cartstiff.answer.full_analysis import analysis_tables
from cartstiff.core import numerics
from cartstiff.core.choices import Level
from cartstiff.core.errors import joined
from cartstiff.core.stiffness.compute import PostureStiffness
from cartstiff.core.units import Units
from cartstiff.shown.report.answer import Block, answer_text, table_lines, tables_lines
from cartstiff.shown.report.layout import table
from cartstiff.shown.report.matrices import matrices_of
from cartstiff.shown.report.sentences import statement_sentences

if TYPE_CHECKING:
    from cartstiff.core.statics.rest import Equilibrium

#: Where everything is that a screen does not hold.
ELSEWHERE = "--analysis full or --json has all"


def describe(
    result: PostureStiffness,
    answer: Answer,
    analysis: Mapping[str, Any] | None = None,
    level: Level = "full",
    *,
    at_rest: bool = False,
    whole: Iterable[str] = (),
) -> str:
    """The text of a posture: its answer, tables, matrices and analysis.

    Parameters
    ----------
    result : PostureStiffness
        The posture.
    answer : Answer
        Its answer.
    analysis : mapping, optional
        From `cartstiff.answer.analysis.posture.summarise`.
    level : {"full", "short", "none"}
        full: everything. Else what fits on a screen: one matrix, principal stiffnesses,
        the choice of connection; and what was asked for beside the posture.
    at_rest : bool
        Whether the stiffness includes the loads.
    whole : iterable of str
        Further lines that were asked for.
    """
    units = result.units
    energy: Block = ("energy", ["", *_energy(result, answer)])
    if level == "full":
        blocks = [_matrices(result, None, at_rest), energy]
        if analysis is not None:
            blocks.append(("analysis", tables_lines(analysis_tables(analysis, units))))
        return answer_text(answer, blocks, whole=whole)
    blocks = [_matrices(result, answer.verdict.connection, at_rest), energy]
    if analysis is not None:
        only = analysis["connection"]
        blocks[0] = _matrices(result, only, at_rest)
        asked, short = (analysis_tables(analysis, units, x) for x in ("asked", "short"))
        whole = [*whole, *tables_lines(asked)]
        blocks[1:1] = [(shown.name, table_lines(shown)) for shown in short]
    return answer_text(answer, blocks, whole=whole, elsewhere=ELSEWHERE)


def describe_equilibrium(state: Equilibrium) -> str:
    """The text of an equilibrium, with the stiffness there, loads included."""
    return describe(state.stiffness, answer_of_equilibrium(state), at_rest=True)


def _matrices(result: PostureStiffness, only: str | None, at_rest: bool) -> Block:
    """The matrices, or one of them."""
    lines = list[str]()
    for shown in matrices_of(result, _DIGITS, only=only, at_rest=at_rest):
        lines += ["", shown.caption, *table(shown.heads, shown.rows)]
    return "stiffness", lines


# Digits of matrices.
_DIGITS = 6


def _energy(result: PostureStiffness, answer: Answer) -> list[str]:
    """The stored energy, and the potential of gravity and loads, if there is one."""
    outside = _potential_of_loads(result)
    energies = {"stored-energy": result.stored_energy, "potential": outside or math.nan}
    of = result.units.moment
    statements = (said(code, energy=Quantity(x, of)) for code, x in energies.items())
    return statement_sentences(
        answer, [s for s in statements if math.isfinite(s.values["energy"].value)]
    )


def _potential_of_loads(result: PostureStiffness) -> float:
    """Return the potential of gravity and loads; 0 if it is round-off of their work.

    The work is that over natural sizes; a weight over the origin of F has such a
    potential.
    """
    total, works = 0.0, 0.0
    for term in result.elastic.parted_terms()[1]:
        energy, gradient, _ = term.evaluate(result.posture)
        total += energy
        works += numerics.largest(gradient * result.posture.coordinate_lengths)
    return total * (abs(total) > numerics.PRINTED_AS_ZERO * works)


def summary_text(summary: Mapping[str, Any], units: Units) -> str:
    """Text of an analysis.

    Parameters
    ----------
    summary : mapping
        Analysis from `cartstiff.answer.analysis.posture.summarise` or
        `cartstiff.answer.analysis.posture`.
    units : Units
        Units of its numbers.
    """
    lines = tables_lines(analysis_tables(summary, units))
    return joined(lines[1:]) + "\n"
