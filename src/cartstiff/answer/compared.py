"""The answer to a comparison."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from cartstiff.answer.comparison import (
    DISPLACEMENT,
    SOFTEST,
    ComparedNumber,
    Comparison,
)
from cartstiff.answer.data import (
    Answer,
    Column,
    Frame,
    Quantity,
    Statement,
    Table,
    said,
    table,
    wrench_parts,
)
from cartstiff.answer.verdict import Verdict
from cartstiff.core.arrays import plain

# Difference of loads, as a share of the larger, up to which they are one.
_SAME = 1e-3
_REASONS = ("both", "sign", "first", "second")


def answer_of_comparison(comparison: Comparison) -> Answer:
    """The displacement, with the largest shares, the softest direction, the numbers,
    and what has no ratio.
    """
    first, units = comparison.first.result.elastic, comparison.units
    labels = {"first": comparison.first.label, "second": comparison.second.label}
    distance = Quantity(comparison.distance, units.length)
    about = [
        said("compared", **labels),
        *_each(comparison),
        said("frames-apart", distance=distance),
        *_loads(comparison),
    ]
    found = Answer.about_mechanism(
        "compare",
        first,
        (),
        *_statements(comparison, labels),
        verdict=Verdict("good", "compared"),
        about=about,
        weight=None,
        tables=list(_tables(comparison, labels)),
    )
    notes = [note for note in comparison.notes if note not in comparison.doubts]
    return replace(found, doubts=comparison.doubts, notes=notes)


def _each(comparison: Comparison) -> Iterator[Statement]:
    """Each mechanism, its frame, and its place in the room."""
    for x in (comparison.first, comparison.second):
        mechanism, length = x.result.elastic.mechanism, comparison.units.length
        frame = Frame(mechanism.frame, mechanism.frame_offset.tolist(), length)
        at = Quantity(tuple(plain(x.result.pose[:3, 3])), length)
        yield said("one", label=x.label, kind=mechanism.kind, of=frame, place=at)


def _loads(comparison: Comparison) -> list[Statement]:
    """The load along the axes of the room; that of each, if they differ."""
    both, units = (comparison.first, comparison.second), comparison.units
    known = [(x.label, x.load) for x in both if x.load is not None]
    each = [
        said("load-of", label=label, load=wrench_parts(plain(W[3:]), plain(W[:3]), units))
        for label, W in known
    ]
    if len(known) == 2:
        a, b = (W for _, W in known)
        if np.allclose(a, b, rtol=0.0, atol=_SAME * abs(a).max()):
            return [said("same-load", load=each[0].values["load"])]
    return each


def _statements(comparison: Comparison, labels: dict[str, str]) -> Iterator[Statement]:
    """The displacement, with the largest shares, and the softest direction."""
    both = comparison.first, comparison.second
    for x in both:
        if x.answer.verdict.level != "good":
            yield said("verdict-of", label=x.label, verdict=x.answer.verdict)
    by_name = {n.quantity: n for n in comparison.numbers}
    moved, soft = by_name.get(DISPLACEMENT), by_name[SOFTEST]
    if moved is not None and moved.ratio is not None:
        by = comparison.displacement_by or "first order"
        yield said(f"moves-by-{by}", **labels, **_pair(moved))
        for x in both:
            if x.shares is not None:
                yield said("shares-of", label=x.label, shares=x.shares)
    if soft.ratio is not None:
        yield said("times-as-stiff", **labels, **_pair(soft))
    if (angle := comparison.softest_angle) is not None:
        yield said("directions-apart", angle=Quantity(angle, comparison.units.angle))


def _pair(n: ComparedNumber) -> dict[str, Any]:
    """A number of both, and the ratio."""
    here, there = (Quantity(x, n.unit) for x in (n.first, n.second))
    return {"ratio": n.ratio, "here": here, "there": there}


def _tables(comparison: Comparison, labels: dict[str, str]) -> Iterator[Table]:
    """The numbers of both, what has no ratio, and the shares."""
    # Quantities that both have, with their ratio.
    numbers = [n for n in comparison.numbers if n.ratio is not None]
    rows = []
    for n in numbers:
        pair: list[Any] = [n.first, n.second]
        if n.unit != "1":
            pair = [Quantity(x, n.unit) for x in pair]
        rows.append((n.quantity, *pair, n.ratio))
    names = [*labels.values()]
    heads = [Column(""), *(Column(label, form="5") for label in names)]
    if rows:
        yield table("", [*heads, Column("ratio", form="4")], rows)
    # What only one has, or what is zero, by reason.
    missing = {
        reason: [n.quantity for n in comparison.numbers if n.because == reason]
        for reason in _REASONS
    }
    without = [
        (said(f"no-ratio-{reason}", names=names_of, **labels),)
        for reason, names_of in missing.items()
        if names_of
    ]
    if without:
        yield table("not compared", ": <", without)
    # Shares of joints and links, side by side.
    found = comparison.shares or {"parts": []}
    rows = [tuple(part.values()) for part in found["parts"]]
    if any(None not in row for row in rows):
        of = Column(f"shares of the {found['of']}")
        yield table("", [of, *(Column(x, form="%") for x in names)], rows)
