"""The answer to a study of designs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from cartstiff.answer.data import Answer, Column, Table, Value, columns, said
from cartstiff.answer.verdict import Verdict
from cartstiff.designs.run import Design, Designs
from cartstiff.mechanisms.gravity_loads import gravity_loads

#: Largest number of reasons listed.
_MAX_REASONS = 5


def answer_of_designs(designs: Designs, best: int = 10) -> Answer:
    """The measures, the designs of the front, at most `best`, and why others fail."""
    study, counts = designs.study, designs.counts()
    verdict = Verdict("bad", "no-feasible-design")
    if designs.front:
        verdict = Verdict("good", "feasible")
    return Answer.about_mechanism(
        "design",
        designs.home,
        verdict,
        designs.notes,
        about=[
            said(
                "study",
                designs=len(designs),
                method=study.method.kind,
                poses=study.poses.count,
            ),
            *(
                said("case", of=f" of {name}" * (name != "load"), load=case.words)
                for name, case in study.cases.items()
                if case.wrench is not None
            ),
            said("gravity", weight=gravity_loads(designs.home)),
        ],
        statements=[said(verdict.code, **counts)],
        tables=[_measures(designs), *_front(designs, best), *_reasons(designs)],
    )


def _measures(designs: Designs) -> Table:
    """What is wanted, and the range of each measure."""
    rows: list[tuple[Value, ...]] = []
    for name, measure in designs.study.measures.items():
        values = designs.table(name)
        finite = values[np.isfinite(values)].tolist()
        ends = {">=": "at_least", "<=": "at_most"}  # of constraints alone
        bounds = [
            f"{sign} {end:.5g}"
            for sign, key in ends.items()
            if (end := getattr(measure, key, None)) is not None
        ]
        case = f" ({measure.case})" * bool(measure.case)
        wanted = designs.better.get(name) or " and ".join(bounds)
        reach = min(finite, default=None), max(finite, default=None)
        words, unit = f"{measure.words}{case}", designs.units[name]
        rows.append((name, words, unit, wanted, *reach))
    heads = columns("name", "what", "unit", "wanted", "from", "to")
    return Table("measures", heads, rows)


def _front(designs: Designs, best: int) -> Iterator[Table]:
    """The best designs, with their parameters and measures."""
    if not designs.front:
        return
    names = [*designs.study.variables, *designs.study.measures]
    rows: list[list[Value]] = [
        [str(i + 1), *designs.designs[i].parameters.values(), *_values(designs, i)]
        for i in designs.front[:best]
    ]
    left = len(designs.front) - len(rows)
    yield Table(
        "best design" if len(designs.better) == 1 else "front",
        columns("design", *names, form="6"),
        rows,
        {"count": len(designs.front)},
        [said("more-designs", count=left)] * (left > 0),
    )


def _values(designs: Designs, index: int) -> list[float]:
    values = designs.designs[index].values
    return [values[name] for name in designs.study.measures]


def _reasons(designs: Designs) -> Iterator[Table]:
    """The most frequent reasons, with the first design of each."""
    for state in ("failed", "infeasible"):
        reasons = [
            _reason(design) if design.state == state else None
            for design in designs.designs
        ]
        counts = Counter(reason for reason in reasons if reason is not None)
        rows = [
            (count, f"{reason} (design {1 + reasons.index(reason)})")
            for reason, count in counts.most_common(_MAX_REASONS)
        ]
        left = len(counts) - len(rows)
        if rows:
            heads = (Column(""), Column("", form="<"))
            yield Table(
                state, heads, rows, below=[said("more-reasons", count=left)] * (left > 0)
            )


def _reason(design: Design) -> str:
    """Why a design fails; of an infeasible one the constraints, without their values."""
    if design.state == "failed":
        return design.reason
    return ", ".join(part.partition(" = ")[0] for part in design.reason.split(", "))
