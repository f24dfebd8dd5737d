"""The answers along paths: of loads, of compensated postures, and of optimised ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from cartstiff.answer.data import (
    Answer,
    Column,
    Quantity,
    Statement,
    Table,
    rounded,
    said,
    table,
)
from cartstiff.answer.posture import sizes
from cartstiff.core.arrays import plain
from cartstiff.core.choices import AXES_WORDS
from cartstiff.core.notes import Note
from cartstiff.core.statics.continuation import LoadCurve
from cartstiff.wings.toolpaths.compensation import CompensatedPath
from cartstiff.wings.toolpaths.optimise import OptimisedPath

# Largest number of points of a curve, and of a path, that are listed.
_MAX_EQUILIBRIA, _MAX_POINTS = 16, 24


def answer_of_curve(curve: LoadCurve) -> Answer:
    """Critical loads of a curve, the range of the linear prediction, and its points."""
    linear = {p: curve.linear_up_to(part=p) for p in ("translation", "rotation")}
    return Answer.about_mechanism(
        "equilibrium",
        curve.elastic,
        curve.notes,
        *_critical(curve),
        said("linear-range", **linear),
        weight=curve.weighed,
        about=[said("curve", count=len(curve.factors), reason=curve.reason)],
        tables=[_equilibria(curve)],
    )


def _critical(curve: LoadCurve) -> Iterator[Statement]:
    """Each critical load once, or why there is none."""
    points = [
        (point.kind, float(f"{point.factor:.10g}"), point.frequency)
        for point in curve.critical
    ]
    for (kind, factor, frequency), times in Counter(points).items():
        what: list[Any] = [said("at-factor", kind=kind, factor=factor)]
        what += [Quantity(frequency, "Hz")] * (frequency is not None)
        what += [said("times", count=times)] * (times > 1)
        yield said("critical-load", what=what)
    if not points and False in curve.stable:
        first = float(curve.factors[curve.stable.index(False)])
        yield said("unstable-from", factor=first)
    elif not points:
        massless = any(note.code == "masses-missing" for note in curve.notes)
        yield said(("no-critical-load", "no-limit-point")[massless])


def _equilibria(curve: LoadCurve) -> Table:
    """Some points of a curve."""
    turn, size = sizes(curve.elastic.mechanism.at(curve.q[0]))
    last, length, rows = len(curve.factors) - 1, curve.elastic.units.length, []
    for i in np.unique(np.linspace(0, last, _MAX_EQUILIBRIA).astype(int)).tolist():
        moved = curve.displacement[i]
        off_turn, off = plain(100.0 * curve.deviation[i])
        (turned,) = rounded([float(np.linalg.norm(moved[:3]))], turn)
        state = {True: "stable", False: "unstable", None: None}[curve.stable[i]]
        own = rounded(moved[3:], size), off, turned, off_turn
        rows.append((float(curve.factors[i]), *own[0], *own[1:], state))
    places = " | ".join(f"{axis} [{length}] : 6" for axis in "xyz")
    off_linear = "translation off linear [%] : 2f | rotation [rad] : 4"
    heads = f"factor | {places} | {off_linear} | rotation off linear [%] : 2f | stability"
    return table("points", heads, rows)


def answer_of_compensation(path: CompensatedPath) -> Answer:
    """Errors before and after compensation, and the largest changes of commands."""
    elastic, units, summary = path.elastic, path.elastic.units, path.summary()
    turn, length = sizes(elastic.mechanism.at(path.q[0]))
    # Largest and mean error, before and after; round-off of the robot's size counts as
    # zero.
    errors = list[tuple[Any, ...]]()
    for what, unit, size in (
        ("translation", units.length, length),
        ("rotation", units.angle, turn),
    ):
        for label, key in (("largest", "max"), ("rms", "rms")):
            pair = (summary[when][f"{what}_{key}"] for when in ("before", "after"))
            own = (Quantity(x, unit) for x in rounded(pair, size))
            errors.append((f"{what}, {label}", *own))
    before, after = errors[0][1:]
    # Which loads were compensated, and in which axes they are.
    about = [said("compensation", count=len(path.q))]
    if path.weighed.acceleration is not None:
        about.append(said(f"weight-against-{path.against}"))
    if path.load_axes is not None:
        about.append(said("axes-of-loads", what="Loads", axes=AXES_WORDS[path.load_axes]))
    return Answer.about_mechanism(
        "equilibrium",
        elastic,
        _notes_by_point(path.notes),
        said("compensated", before=before, after=after),
        *_spread(path),
        weight=replace(path.weighed, before=None),
        about=about,
        tables=[
            table("errors", " | before : 6 | after : 6", errors),
            _commands(path, turn, length),
        ],
    )


def _spread(path: CompensatedPath) -> Iterator[Statement]:
    """The interval of the errors that comes from measured springs."""
    known, deviation = path.elastic.identified, path.deviation
    if known is None or deviation is None or not np.isfinite(deviation).any():
        return
    half = known.factor * np.nanmax(deviation, axis=0)
    moved = Quantity(float(half[3:].max()), path.elastic.units.length)
    turned = Quantity(float(half[:3].max()), path.elastic.units.angle)
    yield said("from-springs", level=100.0 * known.level, moved=moved, turned=turned)


def _commands(path: CompensatedPath, turn: float, length: float) -> Table:
    """The largest change of each command, and the weight's part of it."""
    turning = {c.name for c in path.elastic.mechanism.coordinates if not c.is_length}
    parts = [path.offsets, path.weight][: 1 + bool(path.weight.any())]
    heads = " | change : 6 | of it the weight's : 6"
    if path.against == "load":
        heads = " | change : 6 | weight's, taught : 6"
    rows = list[list[Any]]()
    largest = (np.abs(part).max(axis=0) for part in parts)
    for name, *values in zip(path.springs, *largest, strict=True):
        unit = path.elastic.units.coordinate(name not in turning)
        own = rounded(values, (length, turn)[name in turning])
        rows.append([name, *(Quantity(x, unit) for x in own), None][:3])
    return table("commands", heads, rows, said("commands-in-file"))


def _notes_by_point(notes: Iterable[Note]) -> Iterator[Note]:
    """The notes, equal ones of several points once with all points."""
    passages: dict[tuple[str, str], list[Note]] = {}
    for note in notes:
        place, _, words = note.message.partition(": ")
        is_of_point = bool(words) and place == f"point {note.values.get('point')}"
        key = note.code, (note.message, words)[is_of_point]
        passages.setdefault(key, []).append(note)
    for (code, words), same in passages.items():
        points: list[Any] = [note.values.get("point") for note in same]
        is_own = same[0].message == words
        yield same[0] if is_own else Note(code, f"{_spans(points)}: {words}")


def _spans(points: list[int]) -> str:
    """Format ascending numbers as "points 1-3, 7"."""
    spans: list[list[int]] = []
    for point in points:
        if spans and point == spans[-1][1] + 1:
            spans[-1][1] = point
        else:
            spans.append([point, point])
    shown = ", ".join("-".join(map(str, dict.fromkeys(span))) for span in spans)
    return f"point{'s' * (len(points) > 1)} {shown}"


def answer_of_path(result: OptimisedPath) -> Answer:
    """The criterion along an optimised path, what limits it, and each point."""
    facts, units, criterion = result.summary(), result.elastic.units, result.criterion
    under = said("unloaded")
    if result.loaded:
        under = said("under-path-load", load=result.load)
    tables = _criterion(result, facts), _postures(result)
    return Answer.about_mechanism(
        "path",
        result.elastic,
        result.notes,
        said("worst-point", point=facts["worst_point"], ratio=facts["smallest_ratio"]),
        _nearest_limit(result),
        *_least_margin(facts["least_margin"]),
        said("as-said", words=result.configuration),
        said("as-said", words=result.collisions),
        about=[
            said("path", points=len(result.q), candidates=result.candidates),
            said(
                "criterion",
                what=criterion.description,
                better=criterion.better,
                connection=result.connection,
                under=under,
            ),
            said("length-of-angles", length=Quantity(result.length, units.length)),
            said("free", what=list(_free(result)) or [said("only-branch")]),
            *_axes_of_loads(result),
        ],
        tables=tables,
    )


def _criterion(result: OptimisedPath, facts: dict[str, Any]) -> Table:
    """Worst and mean of the criterion, also with the best constant choice."""
    rows: list[tuple[Any, ...]] = [("optimised", facts["worst"], facts["mean"], None)]
    constant = facts["constant"]
    if constant is not None and result.constant is not None:
        units = {"angle": result.elastic.units.angle, "position": ""}
        choice = [Quantity(v, units[k]) for k, v in result.constant.choice.items()]
        rows[0] = (*rows[0][:3], "varies")
        rows.append(("best constant", constant["worst"], constant["mean"], choice))
    is_missing = result.constant is None and result.angles is not None
    heads = f"worst [{result.unit}] | mean [{result.unit}] | choice : 4"
    below = [said("no-constant-choice")] * is_missing
    return table("", f" | {heads}".replace("[]", ""), rows, *below)


def _postures(result: OptimisedPath) -> Table:
    """The first points of a path."""
    units, count = result.elastic.units, len(result.q)
    coordinates = result.elastic.mechanism.coordinates
    heads = [
        Column("point"),
        *(Column(c.name, units.coordinate(c.is_length), "3f") for c in coordinates),
        Column("angle", units.angle, "2f"),
        Column(result.criterion.name, result.unit),
    ]
    angles = [None] * count if result.angles is None else result.angles.tolist()
    own = zip(result.q.tolist(), angles, result.values.tolist(), strict=True)
    rows = [(i, *q, angle, x) for i, (q, angle, x) in enumerate(own, 1)]
    more = [said("more-points", count=count - _MAX_POINTS)] * (count > _MAX_POINTS)
    return table("postures", heads, rows[:_MAX_POINTS], *more)


def _nearest_limit(result: OptimisedPath) -> Statement:
    """The joint or leg that comes nearest to a limit along the path."""
    found = result.nearest_limit
    if found is None:
        return said("no-limits")
    unit = result.elastic.units.coordinate(not found["is_angle"])
    far, at = (Quantity(found[key], unit) for key in ("distance", "value"))
    own = {key: found[key] for key in ("name", "point")}
    return said("nearest-limit", distance=far, value=at, **own)


def _least_margin(found: dict[str, Any] | None) -> list[Statement]:
    """The drive that comes nearest to its limit along the path, if any is loaded."""
    if found is None or found["margin"] == 1.0:
        return []
    return [said("least-margin", **found)]


def _axes_of_loads(result: OptimisedPath) -> list[Statement]:
    """The axes of a path's loads and directions, if it has any."""
    given = {"loads": result.path.wrenches, "directions": result.path.directions}
    named = " and ".join(name for name, rows in given.items() if rows is not None)
    axes = (AXES_WORDS | {"path": "axes of the path's poses"}).get(result.load_axes or "")
    return [said("axes-of-loads", what=named.capitalize(), axes=axes)] * bool(axes)


def _free(result: OptimisedPath) -> Iterator[Statement]:
    """What is free along the path."""
    if result.free in ("x", "y", "z"):
        yield said("turn-about", axis=result.free)
    elif result.free == "rotation":
        yield said("every-turn")
    if result.joint is not None:
        yield said("sampled-joint", joint=result.joint)
