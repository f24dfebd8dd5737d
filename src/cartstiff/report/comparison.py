"""A comparison as text for reading."""

from __future__ import annotations

import math
from collections.abc import Iterator

from cartstiff.answer.comparison import (
    DISPLACEMENT,
    SOFTEST,
    Compared,
    ComparedNumber,
    Comparison,
)
from cartstiff.errors import joined
from cartstiff.notes import DOUBTS
from cartstiff.report.layout import (
    body_frame,
    length_of,
    lengths,
    note_lines,
    number,
    percent,
    table,
    vector,
)
from cartstiff.report.sentences import share_words, title
from cartstiff.units import Units, engineering, shown_unit

_BY = {"first order": "to first order", "equilibrium": "by the equilibria"}
_NO_RATIO = {"both": "does not exist with either", "sign": "is zero or negative"}


def describe_comparison(comparison: Comparison) -> str:
    """Describe two mechanisms side by side: the answer, the numbers,
    what has no ratio.
    """
    a, b, units = comparison.first, comparison.second, comparison.units
    lines = [
        f"{b.label} compared with {a.label}",
        *(f"  {_about(x, units)}" for x in (a, b)),
        f"  body frames {length_of(comparison.distance, units)} apart",
        *(f"  {line}" for line in _loads(comparison)),
        "",
        "Answer",
        *(f"  {sentence}" for sentence in _answer(comparison)),
    ]
    # The weightiest doubts are the first sentences of every command.
    if doubts := [note for note in comparison.doubts if note.code not in DOUBTS]:
        lines += ["", "Doubts", *(f"  {note}" for note in doubts)]
    compared = [n for n in comparison.numbers if n.ratio is not None]
    if compared:
        titles = ["", a.label, b.label, "ratio"]
        lines += ["", *table(titles, [_row(n) for n in compared])]
    if missing := [n for n in comparison.numbers if n.ratio is None]:
        lines += ["", "Not compared", *_not_compared(missing, comparison)]
    of, parts = comparison.shares or ("", {})
    if any(None not in values for values in parts.values()):
        rows = [[name, *map(percent, values)] for name, values in parts.items()]
        lines += ["", *table([f"shares of the {of}", a.label, b.label], rows)]
    return joined(
        [*lines, *note_lines(n for n in comparison.notes if n not in comparison.doubts)]
    )


def _about(x: Compared, units: Units) -> str:
    """The mechanism, its frame, and its place in the room."""
    mechanism, place = x.result.elastic.mechanism, lengths(x.result.pose[:3, 3], units)
    where = f"at {vector(place, 4)} {units.shown_length} of the room"
    return f"{x.label}: {mechanism.kind}, {body_frame(mechanism)}, {where}"


def _loads(comparison: Comparison) -> list[str]:
    """The load along the axes of the room; that of each, if they differ."""
    units, found = comparison.units, list[str]()
    for x in (comparison.first, comparison.second):
        if x.load is not None:
            force = f"force {vector(x.load[3:], 4)} {units.force}"
            moment = f"moment {vector(x.load[:3], 4)} {units.moment}"
            found.append(f"{force}, {moment}, along the axes of the room")
    if len(set(found)) < 2:
        return [f"load: {words}" for words in found[:1]]
    labels = comparison.first.label, comparison.second.label
    return [f"load of {label}: {x}" for label, x in zip(labels, found, strict=True)]


def _answer(comparison: Comparison) -> Iterator[str]:
    """The displacement, with the largest shares, and the softest direction."""
    a, b = comparison.first, comparison.second
    for x in (a, b):
        if x.answer.verdict.level != "good":
            yield f"{x.label}: {title(x.answer.verdict)}"
    by_name = {n.quantity: n for n in comparison.numbers}
    moved, soft = by_name.get(DISPLACEMENT), by_name[SOFTEST]
    if moved is not None and moved.ratio is not None:
        yield (
            f"Under the load {b.label} moves {number(moved.ratio, 3)} times as far as "
            f"{a.label} ({_BY[comparison.displacement_by or 'first order']}): "
            f"{_both(moved)}"
        )
        for x in (a, b):
            if x.shares is not None:
                yield f"{x.label}: {share_words(x.shares)}"
    if soft.ratio is not None:
        yield (
            f"Along its softest direction (free to turn) {b.label} is "
            f"{number(soft.ratio, 3)} times as stiff: {_both(soft)}"
        )
    if (angle := comparison.softest_angle) is not None:
        apart = number(math.degrees(angle), 3, size=90.0)
        yield f"The softest directions are {apart} deg apart in the room"


def _both(n: ComparedNumber) -> str:
    """A number of the second, not that of the first."""
    return f"{engineering(n.second, n.unit)}, not {engineering(n.first, n.unit)}"


def _row(n: ComparedNumber) -> list[str]:
    """A number of both in the units of texts, and the ratio."""
    unit, per = shown_unit(n.unit)
    head = n.quantity + f" [{unit}]" * (unit != "1")
    values = [number(x and per * x) for x in (n.first, n.second)]
    return [head, *values, number(n.ratio, 4)]


def _not_compared(missing: list[ComparedNumber], comparison: Comparison) -> Iterator[str]:
    """What has no ratio, by the reason."""
    words = _NO_RATIO | {
        "first": f"does not exist with {comparison.first.label}",
        "second": f"does not exist with {comparison.second.label}",
    }
    for reason, text in words.items():
        names = [n.quantity for n in missing if n.because == reason]
        if names:
            yield f"  {', '.join(names)}: {text}"
