"""The answer to a study of designs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from cartstiff.answer.data import Answer, Column, Table, said, table
from cartstiff.wings.maps.designs.run import Design, Designs

#: Largest number of reasons listed.
_MAX_REASONS = 5


def answer_of_designs(designs: Designs, best: int) -> Answer:
    """The measures, the designs of the front, at most `best`, and why others fail."""
    study, counts = designs.study, designs.counts()
    facts = {"designs": len(designs), "method": study.method.kind}
    cases = (
        said("case", of=f" of {name}" * (name != "load"), load=case.words)
        for name, case in study.cases.items()
        if case.wrench is not None
    )
    return Answer.about_mechanism(
        "design",
        designs.home,
        designs.notes,
        said(("no-feasible-design", "feasible")[bool(designs.front)], **counts),
        about=[said("study", **facts, poses=study.poses.count), *cases],
        tables=[_measures(designs), *_front(designs, best), *_reasons(designs)],
    )


def _measures(designs: Designs) -> Table:
    """What is wanted, and the range of each measure."""
    rows = []
    for name, measure in designs.study.measures.items():
        values = designs.table(name)
        finite = values[np.isfinite(values)].tolist()
        # of constraints alone
        ends = {sign: getattr(measure, key, None) for sign, key in _BOUNDS.items()}
        bounds = [f"{sign} {end:.5g}" for sign, end in ends.items() if end is not None]
        case = f" ({measure.case})" * bool(measure.case)
        wanted = designs.better.get(name) or " and ".join(bounds)
        reach = min(finite, default=None), max(finite, default=None)
        rows.append((name, measure.words + case, designs.units[name], wanted, *reach))
    return table("measures", "name | what | unit | wanted | from | to", rows)


_BOUNDS = {">=": "at_least", "<=": "at_most"}


def _front(designs: Designs, best: int) -> Iterator[Table]:
    """The best designs, with their parameters and measures."""
    if not designs.front:
        return
    names = ["design", *designs.study.variables, *designs.study.measures]
    rows = []
    for i in designs.front[:best]:
        design = designs.designs[i]
        measures = (design.values[name] for name in designs.study.measures)
        rows.append((i + 1, *design.parameters.values(), *measures))
    more = said("more-designs", count=len(designs.front) - len(rows))
    name = ("front", "best design")[len(designs.better) == 1]
    heads = [Column(name, form="6") for name in names]
    below = [more] * (len(designs.front) > len(rows))
    yield table(name, heads, rows, *below, count=len(designs.front))


def _reasons(designs: Designs) -> Iterator[Table]:
    """The most frequent reasons, with the first design of each."""
    for state in ("failed", "infeasible"):
        first = dict[str, int]()
        counts = Counter[str]()
        for i, design in enumerate(designs.designs, 1):
            if design.state == state:
                counts[_reason(design)] += 1
                first.setdefault(_reason(design), i)
        most = counts.most_common(_MAX_REASONS)
        more = said("more-reasons", count=len(counts) - len(most))
        rows = [(n, f"{reason} (design {first[reason]})") for reason, n in most]
        if rows:
            yield table(state, " | : <", rows, *[more] * (len(counts) > len(most)))


def _reason(design: Design) -> str:
    """Why a design fails; of an infeasible one the constraints, without their values."""
    if design.state == "failed":
        return design.reason
    return ", ".join(part.partition(" = ")[0] for part in design.reason.split(", "))
