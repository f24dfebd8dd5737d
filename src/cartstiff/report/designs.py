"""A study of designs in words and as a picture."""

from __future__ import annotations

from collections import Counter

import numpy as np

from cartstiff.designs.run import Designs
from cartstiff.errors import joined
from cartstiff.mechanisms.gravity_loads import gravity_loads
from cartstiff.report.layout import body_frame, note_lines, number, table

#: Largest number of reasons listed.
_MAX_REASONS = 5


def describe_designs(designs: Designs, best: int = 10) -> str:
    """Describe a study as ``cartstiff design`` prints it.

    Parameters
    ----------
    designs : Designs
        The study's designs.
    best : int
        Largest number of designs of the front that are listed.
    """
    study, counts = designs.study, designs.counts()
    lines = [
        f"{designs.home.name}, {body_frame(designs.home.mechanism)}: "
        f"{len(designs)} designs by {study.method.kind}, "
        f"{study.poses.count} pose(s) each",
        ", ".join(f"{n} {state}" for state, n in counts.items()),
        *(
            f"Load{f' of {name}' * (name != 'load')}: {case.words}"
            for name, case in study.cases.items()
            if case.wrench is not None
        ),
        gravity_loads(designs.home).text,
        "",
        "Objectives and constraints",
        *table(("name", "what", "unit", "wanted", "from", "to"), _measure_rows(designs)),
    ]
    if designs.front:
        shown = designs.front[:best]
        names = [*study.variables, *study.measures]
        title = (
            "Best design"
            if len(designs.better) == 1
            else (
                f"Pareto front: {len(designs.front)} designs, of which none is better in "
                "everything"
            )
        )
        lines += [
            "",
            title,
            *table(("design", *names), [_row(designs, i) for i in shown]),
        ]
        if len(designs.front) > len(shown):
            lines.append(
                f"  ... {len(designs.front) - len(shown)} more; -o FILE.csv and --json "
                "have all"
            )
    for state in ("failed", "infeasible"):
        if counts[state]:
            lines += [
                "",
                f"Why designs are {state}"
                if state == "infeasible"
                else "Why designs fail",
            ]
            lines += _reasons(designs, state)
    return joined([*lines, *note_lines(designs.notes)])


def _measure_rows(designs: Designs) -> list[tuple[str, ...]]:
    rows = []
    for name, measure in designs.study.measures.items():
        values = designs.table(name)
        finite = values[np.isfinite(values)]
        ends = {
            ">=": getattr(measure, "at_least", None),
            "<=": getattr(measure, "at_most", None),
        }
        bounds = [f"{sign} {number(x)}" for sign, x in ends.items() if x is not None]
        case = f" ({measure.case})" if measure.case else ""
        reach = [
            number(float(f(finite))) if finite.size else "-" for f in (np.min, np.max)
        ]
        wanted = designs.better.get(name) or " and ".join(bounds)
        rows.append((name, measure.words + case, designs.units[name], wanted, *reach))
    return rows


def _row(designs: Designs, index: int) -> tuple[str, ...]:
    design = designs.designs[index]
    values = [
        *design.parameters.values(),
        *(design.values[n] for n in designs.study.measures),
    ]
    return (str(index + 1), *(number(value, 6) for value in values))


def _reasons(answer: Designs, state: str) -> list[str]:
    """List the most frequent reasons, with a design for each."""
    designs = [(i, d) for i, d in enumerate(answer.designs) if d.state == state]
    if state == "infeasible":  # the constraints' names, without their values
        words = [
            ", ".join(p.partition(" = ")[0] for p in d.reason.split(", "))
            for _, d in designs
        ]
    else:
        words = [d.reason for _, d in designs]
    first: dict[str, int] = {}
    for (i, _), reason in zip(designs, words, strict=True):
        first.setdefault(reason, i)
    reasons = Counter(words).most_common(_MAX_REASONS)
    lines = [f"  {n:>5}  {reason} (design {first[reason] + 1})" for reason, n in reasons]
    more = len(first) - len(reasons)
    return [*lines, *([f"         ... {more} other reasons"] if more > 0 else [])]
