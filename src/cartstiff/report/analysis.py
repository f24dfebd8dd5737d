"""The dict of an analysis as text for reading, with units on every number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.choices import LEVELS
from cartstiff.errors import UnknownNameError, joined
from cartstiff.mechanisms.contract import SI, Units
from cartstiff.report.analysis_mechanism import (
    deflection_lines,
    target_lines,
    uncertainty_lines,
)
from cartstiff.report.analysis_screws import mode_lines, screw_lines, synthesis_lines
from cartstiff.report.layout import COSINES, number, numbers, percent, row, share, table, vector

_FREEDOMS = {"translation": "rotation", "rotation": "translation"}
# Springs differ by more than a rounding, but not by its square.
_SQUARED = numerics.ZERO**2 / numerics.BLANK
_OF_FREE = '  "free" comes from the symmetric part of its inverse: motion along a force'
_DEFINITE = {"positive": "positive definite", "negative": "negative definite"}


def summary_text(
    summary: Mapping[str, Any],
    units: Units | Mapping[str, str] | None = None,
    level: str = "full",
) -> str:
    """Text of an analysis.

    Parameters
    ----------
    summary : mapping
        From `cartstiff.analysis.summary.summarise` or `cartstiff.analysis.posture`.
    units : Units, or mapping of str to str
        Keys "length", "force", "angle"; default SI. `Units` say what angles are shown in, too.
    level : {"full", "short", "none"}
        short: principal stiffnesses, softest direction, centres, condition, verdict on
        connections, and what was asked for. full: everything.

    Raises
    ------
    UnknownNameError
        If the level is another word.
    InputError
        If a unit is missing.
    """
    if level not in LEVELS:
        raise UnknownNameError("level", level, LEVELS)
    u = units if isinstance(units, Units) else Units.from_dict(units or SI.as_dict())
    if level == "none":
        return ""
    full = level == "full"
    lines = _heading(summary, u)
    lines += _principal(summary["ellipsoids"], u, full, summary["length"]["value"])
    lines += _softest(summary["ellipsoids"], u)
    lines += _directions(summary["directions"], u, full)
    lines += _centres(summary, u, full)
    lines += _indices(summary, u, full)
    if full:
        lines += screw_lines(summary, u)
        lines += mode_lines(summary["modes"], u, summary["length"]["value"])
    lines += synthesis_lines(summary["synthesis"], u, full, summary["length"]["value"])
    lines += _connections(summary, u, full)
    lines += target_lines((summary["synthesis"] or {}).get("target"), u, full)
    lines += deflection_lines(summary.get("deflection"), u, full)
    lines += uncertainty_lines(summary.get("uncertainty"), u, full)
    if summary["notes"]:
        lines += ["", "does not exist here, or not to all digits"]
        lines += [f"  {note['message']} [{note['code']}]" for note in summary["notes"]]
    return joined(line[:1].upper() + line[1:] for line in lines) + "\n"


def _heading(s: Mapping[str, Any], u: Units) -> list[str]:
    name, length = s["connection"], s["length"]
    if name is None and s["compliance"] is None:
        return ["analysis: there is neither stiffness nor compliance here"]
    if name is None:
        what = "the compliance"
    else:
        part = "the symmetric part of " if s["symmetrised"] else ""
        what = f"{part}K^{name}, {_DEFINITE.get(s['definiteness'], s['definiteness'])}"
    origin = [r[3] for r in s["frame"][:3]]
    turned = any(abs(s["frame"][i][j] - (i == j)) > 0 for i in range(3) for j in range(3))
    at = "the body frame"
    if any(origin) or turned:
        at = f"the point {vector(origin)} {u.length} of the body frame"
        at += ", in other axes" if turned else ", along its axes"
    return [
        f"analysis of {what}, at {at}",
        *_load(s, u),
        *([_OF_FREE] if s["symmetrised"] else []),
        f"  characteristic length {number(length['value'])} {u.length} ({length['reason']})",
    ]


def _load(s: Mapping[str, Any], u: Units) -> list[str]:
    """What the load is taken to do, and whether the analysed matrix is the tangent under it."""
    load = s.get("load")
    if load is None:
        return []
    what = "the tangent" if load["is_tangent"] else "NOT the tangent (that is K^load)"
    at = f"{vector(load['at'])} {u.length}"
    if not any(load["at"]):
        at = "the origin of the body frame"
    return [f"  {what} under a {load['kind']} load at {at}: {load['meaning']}"]


def _principal(ellipsoids: Mapping[str, Any], u: Units, full: bool, length: float) -> list[str]:
    exists = ellipsoids["stiffness"]["translation"]["held"] is not None
    if not exists and ellipsoids["compliance"]["translation"]["free"] is None:
        return []
    short = ("stiffness",) if exists else ("compliance",)
    lines = []
    for quantity in short if not (full and exists) else ("stiffness", "compliance"):
        title = f"principal {quantity} (held: the other three freedoms locked; free: unloaded)"
        lines += ["", title]
        for freedom, other in _FREEDOMS.items():
            unit = getattr(u, quantity)[freedom]
            for others in ("held", "free"):
                e = ellipsoids[quantity][freedom][others]
                label = f"  {freedom}, {other} {others} [{unit}]"
                if e is None:
                    lines.append(f"{label:<42} does not exist")
                    continue
                sign = "" if e["definiteness"] == "positive" else f"   {e['definiteness']}"
                beside = ellipsoids[quantity][other][others]
                power = 2 if (freedom == "rotation") == (quantity == "stiffness") else -2
                size = 0.0 if beside is None else _SQUARED * max(map(abs, beside["eigenvalues"]))
                lines.append(
                    f"{label:<42} {row(e['eigenvalues'], size=size * length**power)}{sign}"
                )
                if full:
                    for column in range(3):
                        axis = [r[column] for r in e["axes"]]
                        lines.append(
                            f"{'    axis ' + str(column + 1):<42} {row(axis, size=COSINES)}"
                        )
    return lines


def _softest(ellipsoids: Mapping[str, Any], u: Units) -> list[str]:
    """Where a force moves the body most: the largest principal compliance, rotations free."""
    lines = []
    for freedom, load, moves in (
        ("translation", "force along", "moves this point most"),
        ("rotation", "moment about", "turns the body most"),
    ):
        e = ellipsoids["compliance"][freedom]["free"]
        if e is None or e["definiteness"] not in ("positive", "positive semidefinite"):
            continue
        largest = e["eigenvalues"][2]
        if not largest > 0:
            continue
        if largest - e["eigenvalues"][0] <= numerics.CLOSE * largest:
            lines.append(
                f"  softest: a {load} any axis alike, {number(1 / largest)} {u.stiffness[freedom]}"
            )
            continue
        axis = vector(_upright([r[2] for r in e["axes"]]), size=COSINES)
        stiff = f"{number(1.0 / largest)} {u.stiffness[freedom]}"
        lines.append(f"  softest: a {load} {axis} {moves}, {stiff}")
    return lines


def _upright(axis: list[float]) -> list[float]:
    """The axis with its largest component positive."""
    return axis if max(axis, key=abs) > 0 else [-x for x in axis]


def _directions(rows: list[Mapping[str, Any]], u: Units, full: bool) -> list[str]:
    shown = [r for r in rows if full or r["name"] == "given"]
    values = [r[k][o] for r in shown for k in ("along", "about") for o in ("held", "free")]
    if not any(v is not None for v in values):
        return []
    titles = ["", "direction"]
    for kind, unit in (
        ("along", u.stiffness["translation"]),
        ("about", u.stiffness["rotation"]),
    ):
        titles += [f"{kind}, held [{unit}]", "free"]
    cells = [
        [
            r["name"],
            vector(r["direction"]),
            *(number(r[k][o]) for k in ("along", "about") for o in ("held", "free")),
        ]
        for r in shown
    ]
    return ["", "stiffness along and about lines through this point", *table(titles, cells)]


def _centres(s: Mapping[str, Any], u: Units, full: bool) -> list[str]:
    if s["centres"] is None:
        return []
    moved = any(r[3] for r in s["frame"][:3])
    place = "this point" if moved else "the origin of the body frame"
    lines = ["", f"centres [{u.length}], from {place} along the axes of the analysis"]
    size = s["length"]["value"]
    for name, point in s["centres"].items():
        label = {"least_coupling": "point of least coupling"}.get(name, f"centre of {name}")
        lines.append(f"  {label:<40} {row(point, size=size)}")
    frame, form = s["decoupling_frame"], s["normal_form"]
    if frame is not None:
        positive = s["definiteness"] in ("positive", "positive semidefinite")
        scale = "0 none, 1 full" if positive else "0 none; not bounded, as the matrix is indefinite"
        lines.append(
            f"  coupling of rotation and translation: {share(frame['coupling_before'])} here, "
            f"{share(frame['coupling'])} at the point of least coupling ({scale})"
        )
    for what, place in (("normal form", form), ("decoupling frame", frame)):
        if full and place is not None:
            lines.append(f"  {what}: axes as columns")
            lines += [f"{'':<42} {row(r[:3])}" for r in place["T_m_n"][:3]]
            if what == "normal form":
                blocks = np.abs(s["stiffness"])
                size = float(np.sqrt(blocks[:3, :3].max() * blocks[3:, 3:].max()))
                lines.append(
                    f"    coupling there [{u.blocks['tr']}] {numbers(place['coupling'], size=size)}"
                )
    return lines


def _indices(s: Mapping[str, Any], u: Units, full: bool) -> list[str]:
    n = s["indices"]
    if n is None:
        return []
    stiff = u.stiffness["translation"]
    length = f"{number(n['length'])} {u.length}"
    lines = ["", f"indices, angles multiplied by the characteristic length {length}"]
    if n["condition_number"] is None:
        lines.append("  condition number infinite: the matrix is singular")
    else:
        change = f"changes as length^{number(round(n['condition_exponent'], 2))} here"
        lines.append(f"  condition number {number(n['condition_number'])} ({change})")
    lines.append(f"  minimum stiffness {number(n['minimum_stiffness'])} {stiff}")
    if full:
        shown = "-, not positive" if n["isotropy"] is None else number(n["isotropy"])
        lines.append(f"  isotropy {shown} (1: equally stiff in all directions)")
        unit = u.determinant
        lines.append(f"  determinant {number(n['determinant'])} {unit} (for any length, frame)")
        lines.append(
            f"  condition of the blocks: translation {number(n['translational_condition'])}, "
            f"rotation {number(n['rotational_condition'])} (no length enters)"
        )
        if n["best_length"] is not None:
            lines.append(
                f"  best conditioned at length {number(n['best_length'])} {u.length}: "
                f"{number(n['condition_at_best_length'])}"
            )
    return lines


def _felt(value: float, share: float) -> str:
    """A difference; 0 where its share is rounding."""
    return number(0.0 if abs(share) < numerics.BLANK else value, 3)


def _connections(s: Mapping[str, Any], u: Units, full: bool) -> list[str]:
    compared = s["connections"]
    if compared is None:
        return []
    lines = ["", "does the choice of connection matter here?", f"  {compared['verdict']}"]
    if not full:
        return lines
    rows = []
    for r in compared["rows"]:
        if r["change"] is None:
            rows.append([f"K^{r['name']}", *["-"] * 5])
            continue
        cells = [
            f"{_felt(r['largest'][b], r['relative'][b])} ({percent(r['relative'][b])})"
            for b in u.blocks
        ]
        rows.append([f"K^{r['name']}", *cells, percent(r["change"])])
    if rows:
        titles = [f"{b} [{unit}]" for b, unit in u.blocks.items()]
        lines.append(
            f"  largest difference from K^{compared['reference']} by block (r rotation, "
            "t translation), and its relative size"
        )
        lines += table(["", *titles, "change"], rows)
    if s["asymmetry"] is not None:
        a = s["asymmetry"]
        word = "as the load predicts" if a["agrees"] else "NOT as the load predicts"
        size = percent(a["size"])
        lines.append(f"  asymmetry of K^A: {size}, {word} (residual {number(a['residual'], 2)})")
    return lines
