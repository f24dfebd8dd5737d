"""Equilibria, load-deflection curves and compensated paths as text for people,
and as figures.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cartstiff.answer.equilibrium import answer_of_equilibrium
from cartstiff.choices import AXES_WORDS
from cartstiff.errors import joined
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.gravity_loads import gravity_loads
from cartstiff.mechanisms.limits import beyond_limits
from cartstiff.mechanisms.other_units import shown
from cartstiff.notes import Note
from cartstiff.report.analysis import describe
from cartstiff.report.answer import answer_lines
from cartstiff.report.layout import body_frame, length_of, number, row, table, wide_row

if TYPE_CHECKING:
    from cartstiff.geometry.se3 import Array
    from cartstiff.statics.continuation import LoadCurve
    from cartstiff.statics.rest import Equilibrium
    from cartstiff.statics.toolpath import CompensatedPath
    from cartstiff.toolpaths.optimise import OptimisedPath

_STABLE = {
    True: "stable",
    False: "UNSTABLE",
    None: "not decided by definiteness (see the notes)",
}


def _sizes(posture: MechanismPosture) -> tuple[float, float]:
    """Sizes of turns (rad) and lengths, of which `numerics.PRINTED_AS_ZERO` is round-off.

    Closures are satisfied to more digits than single coordinates.
    """
    share = 1e-2 if posture.closure is None else 1.0
    return share, share * posture.length


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
    turn, length = _sizes(state.posture)
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


def describe_curve(curve: LoadCurve) -> str:
    """Describe a load-deflection curve in at most twenty lines,
    with its critical points.
    """
    units = curve.elastic.units
    length, mm = units.shown_length, units.shown_per_length
    turn, size = _sizes(curve.elastic.mechanism.at(curve.q[0]))
    lines = [
        f"Load-deflection curve of {curve.elastic.name}: {len(curve.factors)} "
        "equilibria, "
        f"ended: {curve.reason}",
        curve.weighed.text,
        *beyond_limits(curve.notes),
        "",
        f"  {'factor':>10} {'x ' + length:>12} {'y ' + length:>12} {'z ' + length:>12} "
        f"{'off linear':>11} {'rotation':>11} {'off linear':>11}  stability",
        f"  {'':>10} {'':>12} {'':>12} {'':>12} {'translation':>11} {'deg':>11} "
        f"{'rotation':>11}",
    ]
    shown = np.unique(np.linspace(0, len(curve.factors) - 1, 16).astype(int))
    for i in shown:
        place = wide_row(mm * curve.displacement[i, 3:], mm * size)
        turned = np.degrees(np.linalg.norm(curve.displacement[i, :3]))
        off = ["-" if np.isnan(x) else f"{100 * x:.2f} %" for x in curve.deviation[i]]
        word = {True: "stable", False: "unstable", None: "-"}[curve.stable[i]]
        lines.append(
            f"  {curve.factors[i]:>10.5g} {place} "
            f"{off[1]:>11} {row([turned], 4, np.degrees(turn))} {off[0]:>11}  {word}"
        )
    lines.append("")
    points = []
    for point in curve.critical:
        beating = "" if point.frequency is None else f", {point.frequency:.6g} Hz"
        points.append(
            f"Critical load: {point.kind} at factor {point.factor:.10g}{beating}"
        )
    for line, times in Counter(points).items():
        lines.append(line + (f" ({times} modes)" if times > 1 else ""))
    if not curve.critical and False in curve.stable:
        first = curve.factors[curve.stable.index(False)]
        lines.append(
            f"Unstable at factor {first:.5g}; where it becomes so was not found."
        )
    elif not curve.critical:
        massless = any(note.code == "masses-missing" for note in curve.notes)
        lines.append(
            "No limit point and no branch up to the end of the curve; flutter is not "
            "examined."
            if massless
            else "No critical load up to the end of the curve."
        )
    lines.append(
        f"The linear prediction stays within 5 % up to factor {curve.linear_up_to():.4g} "
        "for the "
        f"translation, {curve.linear_up_to(part='rotation'):.4g} for the rotation."
    )
    lines += [f"  {note}" for note in curve.notes]
    return joined(lines)


def _carried(path: CompensatedPath) -> str:
    """State whether the weight is compensated."""
    if path.weighed.acceleration is None:
        return ""
    return (
        "; weight compensated as well (--against all)"
        if path.against == "all"
        else "; weight not compensated: the program was taught under it (--against load)"
    )


def describe_path(path: CompensatedPath, *, is_written: bool = False) -> str:
    """Describe errors before and after compensation,
    and the largest changes of commands.
    """
    units = path.elastic.units
    mm = units.shown_per_length
    summary = path.summary()
    turn, length = _sizes(path.elastic.mechanism.at(path.q[0]))
    lines = [
        f"Deflection compensation of {path.elastic.name} along {len(path.q)} postures",
        replace(path.weighed, before=None).text + _carried(path),
        *(
            []
            if path.load_axes is None
            else [f"Loads along the {AXES_WORDS[path.load_axes]}"]
        ),
        "",
        f"  {'':<22} {'before':>12} {'after':>12}",
    ]
    for what, unit, factor, size in (
        ("translation", units.shown_length, mm, mm * length),
        ("rotation", "deg", 180 / np.pi, np.degrees(turn)),
    ):
        for label, key in (("largest", "max"), ("rms", "rms")):
            pair = [
                summary[when][f"{what}_{key}"] * factor for when in ("before", "after")
            ]
            lines.append(f"  {what + ', ' + label:<22} {wide_row(pair, size)} {unit}")
    known = path.elastic.identified
    if (
        known is not None
        and path.deviation is not None
        and np.isfinite(path.deviation).any()
    ):
        half = known.factor * np.nanmax(path.deviation, axis=0)
        lines.append(
            f"  {100 * known.level:g} % from the measured springs, at most, along an "
            "axis: "
            f"{mm * half[3:].max():.3g} {units.shown_length}, "
            f"{np.degrees(half[:3].max()):.3g} deg"
        )
    weighs = bool(path.weight.any())
    lines += ["", "Largest change of a command"]
    if weighs:
        part = "of it the weight's" if path.against == "all" else "weight's, taught"
        lines[-1] = f"{lines[-1]:<30} {'':>12} {part:>18}"
    largest = [np.abs(part).max(axis=0) for part in (path.offsets, path.weight)]
    turning = {c.name for c in path.elastic.mechanism.coordinates if not c.is_length}
    for name, *values in zip(path.springs, *largest, strict=True):
        is_length = name not in turning
        size, unit, per = (
            (length, units.shown_length, mm)
            if is_length
            else (turn, units.shown_angle, units.shown_per_radian)
        )
        shown = [wide_row([per * value], per * size) for value in values[: 1 + weighs]]
        lines.append(f"  {name:<28} {'      '.join(shown)} {unit}")
    if not is_written:
        lines.append("(-o FILE.csv writes the commands.)")
    return joined([*lines, *_notes_by_point(path.notes)])


def _notes_by_point(notes: Iterable[Note]) -> list[str]:
    """Return the notes, equal ones of several points once with all points."""
    passages: dict[tuple[str, str], list[int]] = {}
    for note in notes:
        place, _, words = note.message.partition(": ")
        number = note.values.get("point")
        of_point = words and place == f"point {number}"
        points = passages.setdefault((note.code, words if of_point else note.message), [])
        if of_point:
            points.append(int(place.removeprefix("point ")))
    return [
        f"  {Note(code, f'{_spans(points)}: {words}' if points else words)}"
        for (code, words), points in passages.items()
    ]


def _spans(points: list[int]) -> str:
    """Format ascending numbers as "points 1-3, 7"."""
    spans: list[list[int]] = []
    for point in points:
        if spans and point == spans[-1][1] + 1:
            spans[-1][1] = point
        else:
            spans.append([point, point])
    shown = ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in spans)
    return f"points {shown}" if len(points) > 1 else f"point {shown}"


# Largest number of points and of places in a list.
_MAX_LISTED_POINTS = 24


def describe_optimised_path(result: OptimisedPath, *, is_written: bool = False) -> str:
    """Describe an optimised path: criterion, improvement and each point."""
    facts, units = result.summary(), result.elastic.units
    under = "unloaded"
    if result.loaded:
        at = ", ".join(number(x) for x in result.load.at)
        under = (
            f"under the path's load, {result.load.kind} at ({at}): {result.load.words}"
        )
    lines = [
        f"{result.elastic.name}, {body_frame(result.elastic.mechanism)}: {len(result.q)} "
        "points, "
        f"{result.candidates} postures compared",
        f"{result.criterion.description} [{result.unit}], {result.criterion.better} is "
        "better; "
        f"K^{result.connection} {under}",
        f"angles count by the characteristic length {length_of(result.length, units)}",
        f"free: {_free(result)}",
        gravity_loads(result.elastic).text,
        *_axes_of_loads(result),
        "",
    ]
    of_criterion = f" [{result.unit}]" if result.unit else ""
    titles = ("", f"worst{of_criterion}", f"mean{of_criterion}", "choice")
    rows = [("optimised", number(facts["worst"]), number(facts["mean"]), "varies")]
    if (constant := facts["constant"]) is not None and result.constant is not None:
        words = {"angle": units.shown_angle, "position": result.joint or ""}
        choice = ", ".join(
            f"{v * (units.shown_per_radian if k == 'angle' else 1.0):.4g} {words[k]}"
            for k, v in result.constant.choice.items()
        )
        rows.append(
            ("best constant", number(constant["worst"]), number(constant["mean"]), choice)
        )
    lines += table(titles, rows if len(rows) > 1 else [(*rows[0][:3], "")])
    if result.constant is None and result.angles is not None:
        lines.append("  no constant choice follows the path")
    lines += [
        "",
        f"worst at point {facts['worst_point']}; smallest over largest singular value at "
        "least "
        f"{facts['smallest_ratio']:.3g}",
        _nearest_limit(result),
        result.configuration,
        result.collisions,
        "",
        "Postures",
    ]
    heads = ["point", *result.elastic.names]
    if result.angles is not None:
        heads.append("angle [deg]")
    heads.append(result.criterion.name + of_criterion)
    body = []
    for i, q in enumerate(shown(result.elastic, result.q[:_MAX_LISTED_POINTS])):
        row = [str(i + 1), *(f"{round(v, 3) + 0.0:.3f}" for v in q)]  # never -0.000
        if result.angles is not None:
            row.append(f"{np.degrees(result.angles[i]):.2f}")
        row.append(number(float(result.values[i])))
        body.append(tuple(row))
    lines += table(heads, body)
    if len(result.q) > _MAX_LISTED_POINTS:
        hint = "" if is_written else " (-o FILE.csv has all)"
        lines.append(f"  ... and {len(result.q) - _MAX_LISTED_POINTS} more points{hint}")
    slides = [c.name for c in result.elastic.mechanism.coordinates if c.is_length]
    angle = units.shown_angle
    of_slides = f"; {units.shown_length} for {', '.join(slides)}" if slides else ""
    return joined([*lines, f"  coordinates in {angle}{of_slides}"])


def _nearest_limit(result: OptimisedPath) -> str:
    """The joint or leg that comes nearest to a limit along the path."""
    found, units = result.nearest_limit, result.elastic.units
    if found is None:
        return "no limits are known"
    per, unit = units.shown_per_length, units.shown_length
    if found["is_angle"]:
        per, unit = units.shown_per_radian, units.shown_angle
    return (
        f"nearest to a limit: {found['name']} at point {found['point']}, "
        f"{per * found['distance']:.4g} {unit} from it, at {per * found['value']:.4g} "
        f"{unit}"
    )


def _axes_of_loads(result: OptimisedPath) -> list[str]:
    """State the axes of a path's loads and directions, if it has any."""
    path, axes = result.path, result.load_axes
    given = {"Loads": path.wrenches, "directions": path.directions}
    named = " and ".join(name for name, rows in given.items() if rows is not None)
    of = (
        "axes of the path's poses" if axes == "path" else AXES_WORDS[axes] if axes else ""
    )
    return [f"{named[0].upper()}{named[1:]} along the {of}"] if of else []


def _free(result: OptimisedPath) -> str:
    words = []
    if result.free in ("x", "y", "z"):
        words.append(f"rotation about the body's {result.free} axis")
    elif result.free == "rotation":
        words.append("all of the body's rotation")
    if result.joint is not None:
        words.append(f"a self-motion of the joints, sampled by {result.joint}")
    return " and ".join(words) or "only the branch of the inverse kinematics"
