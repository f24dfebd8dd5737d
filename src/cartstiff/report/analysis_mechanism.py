"""Text of the sections that need the mechanism: target, deflection, uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from math import degrees
from typing import Any

from cartstiff import numerics
from cartstiff.analysis.matrices import PURE
from cartstiff.analysis.plain import unit_of
from cartstiff.mechanisms.contract import Units
from cartstiff.report.layout import COSINES, number, numbers, percent, row, table, vector

Section = Mapping[str, Any] | None

#: Smaller shares are not listed among the largest.
_TOLD = 1e-3


def deflection_lines(d: Section, u: Units, full: bool) -> list[str]:
    """Deflection of the point, and each joint's or leg's share."""
    if d is None:
        return []
    size = sum(x * x for x in d["displacement"]) ** 0.5
    angle, turn = (u.angle, 1.0) if u.shown_angle == "rad" else (u.shown_angle, degrees(1.0))
    lines = [
        "",
        f"linear deflection (K^{d['connection']}) under {_wrench(d['wrench'], u)} at the point "
        f"{vector(d['acts_at'])} {u.length}",
        f"  the point {vector(d['point'])} {u.length} moves {number(size)} {u.length}: "
        f"{vector(d['displacement'], 4)}",
        f"  the body turns {vector([turn * x for x in d['twist'][:3]], 4)} {angle} (all in the "
        f"body's axes), "
        f"energy {number(d['energy'])} {u.moment}",
    ]
    shares = d["shares"]
    if not shares:
        return lines
    if d["kind"] == "joints":
        first, meaning = "motion", "of the displacement"
        titles = ["joint", "turns or slides", "", "share", f"displacement [{u.length}]"]
    else:
        first, meaning = "elongation", "of the energy"
        titles = ["spring", "elongation", "", "share", "change of force"]
    ranked = sorted(shares, key=lambda s: -abs(s["share"] or 0.0))
    if not full:
        main = [s for s in ranked[:3] if abs(s["share"] or 0.0) >= _TOLD] or ranked[:1]
        parts = [f"{s['name']} {_share(s['share'])}" for s in main]
        return [*lines, f"  largest shares {meaning}: {', '.join(parts)}"]
    rows = []
    sizes = [
        max((abs(s[first]) for s in shares if s["is_length"] is kind), default=0.0)
        for kind in (False, True)
    ]
    for s in shares:
        # A link turns and moves at once: its elongation has no single unit.
        unit = "" if s["is_length"] is None else u.length if s["is_length"] else angle
        own = s[first]
        if s["is_length"] is not None and abs(own) < numerics.BLANK * sizes[s["is_length"]]:
            own = 0.0
        moved = own * (turn if unit == angle else 1.0)
        if first == "motion":
            last = row(s["displacement"], 4, size)
        else:
            effort = "" if s["is_length"] is None else u.effort(s["is_length"])
            last = effort and f"{number(0.0 if own == 0.0 else s['force'])} {effort}"
        rows.append([s["name"], number(moved), unit, _share(s["share"]), last])
    lines += [f"  shares {meaning}", *table(titles, rows)]
    if d["kind"] == "springs" and abs(d["load_share"] or 0.0) > numerics.CLOSE:
        lines.append(
            f"  the rest, {percent(d['load_share'])}, is what the load and other potentials "
            "take or give"
        )
    return lines


def _share(x: float | None) -> str:
    return "-" if x is None else percent(x)


def _wrench(w: list[float], u: Units) -> str:
    """The parts of a wrench that are not zero."""
    parts = []
    force, moment = w[3:], w[:3]
    if any(force) or not any(moment):
        parts.append(f"force {vector(force, 4)} {u.force}")
    if max(map(abs, moment)) > numerics.BLANK * max(map(abs, force)):
        parts.append(f"moment {vector(moment, 4)} {u.moment}")
    return " and ".join(parts)


def target_lines(t: Section, u: Units, full: bool) -> list[str]:
    """Joint stiffness that gives a desired Cartesian stiffness."""
    if t is None:
        return []
    order = ""
    if "order" in t:
        order = f" ({t['order']} by {t['order_from'].replace('file', 'its file')})"
    lines = ["", f"joint stiffness for the target{order}"]
    unit = [u.spring(s) for s in t["are_lengths"]]
    fit = t["diagonal_fit"]
    if t["is_feasible"]:
        lines.append("  independent springs give it exactly:")
    else:
        made = "" if t["definiteness"] == "positive" else "; not positive definite: active control"
        lines.append(f"  joints must be coupled, up to {percent(t['off_diagonal'])}{made}")
        if fit is not None:
            lines.append(
                f"  independent springs miss it by {percent(fit['residual'])} at best "
                f"(angles times {number(fit['length'])} {u.length}):"
            )
    if not t["stable"]:
        lines.append("  the posture is not stable with it: the target is not positive definite")
    if fit is not None:
        rows = [
            [name, number(k, 5, "locked"), "" if k is None else x, number(tau), u.effort(s)]
            for name, k, x, tau, s in zip(
                t["joints"], fit["stiffness"], unit, t["torque"], t["are_lengths"], strict=True
            )
        ]
        lines += table(["joint", "stiffness", "", "carries", ""], rows)
    if full and not t["is_diagonal"]:
        lines.append("  matrix of joint stiffness that gives it exactly, rows and columns in order")
        lines += [f"  {row(r)}" for r in t["matrix"]]
    return lines


_SHOWN = {
    "ellipsoids.stiffness.translation.held.eigenvalues": "translation, rotation held",
    "ellipsoids.stiffness.translation.free.eigenvalues": "translation, rotation free",
    "ellipsoids.stiffness.rotation.held.eigenvalues": "rotation, translation held",
    "ellipsoids.stiffness.rotation.free.eigenvalues": "rotation, translation free",
    "centres.stiffness": "centre of stiffness",
    "centres.compliance": "centre of compliance",
    "centres.elasticity": "centre of elasticity",
    "indices.condition_number": "condition number",
    "indices.minimum_stiffness": "minimum stiffness",
    "deflection.displacement": "displacement under the load",
}


def _unit(name: str, u: Units) -> str:
    """Unit of a number such as "stiffness[0, 3]"."""
    path = name.replace(", ", ".").replace("[", ".").rstrip("]")
    unit = unit_of(path)
    return "" if unit == PURE else unit.format(length=u.length, force=u.force)


def _meet(numbers: Mapping[str, Any], prefix: str) -> bool:
    """Whether two sorted principal values are equal, so that they have no derivative."""
    if not prefix.endswith("eigenvalues"):
        return False
    a, b, c = (numbers.get(f"{prefix}[{i}]", {}).get("nominal", float("nan")) for i in range(3))
    return min(b - a, c - b) <= numerics.NEARBY * max(abs(a), abs(c))


# What is told of a spread, and its digits.
_SPREAD = (("nominal", 5), ("mean", 5), ("deviation", 3), ("lower", 5), ("upper", 5))


def _size(name: str, spreads: Mapping[str, Any]) -> float:
    """What an entry of a matrix is rounding of: the geometric mean of its two diagonal ones."""
    if ".axes[" in name:
        return COSINES
    matrix, _, entry = name.partition("[")
    i, _, j = entry.rstrip("]").partition(", ")
    ends = [spreads.get(f"{matrix}[{k}, {k}]") for k in (i, j)] if j else []
    sizes = [abs(end["nominal"]) for end in ends if end is not None and end["nominal"] is not None]
    return math.sqrt(math.prod(sizes)) if len(sizes) == 2 else 0.0


def uncertainty_lines(s: Section, u: Units, full: bool) -> list[str]:
    """Standard deviations of the main numbers, or of all of them."""
    if s is None:
        return []
    t = s["tolerances"]
    parts = [f"stiffness {percent(t['stiffness'])}"] if t["stiffness"] else []
    parts += [f"lengths {number(t['length'])} {u.length}"] if t["length"] else []
    parts += [f"rotations {number(t['angle'])} {u.angle}"] if t["angle"] else []
    if any(name.startswith(("compliance.", "coefficient.")) for name in s["parameters"]):
        parts.insert(0, "the measured springs")
    how = "to first order" if not s["samples"] else f"{s['samples']} samples"
    lines = ["", f"uncertainty from {', '.join(parts)} ({how}; standard deviations)"]
    if s["left_out"]:
        lines.append(f"  {s['left_out']}")
    if s["failures"]:
        failed = ", ".join(f"{n} {code}" for code, n in s["failures"].items())
        lines.append(f"  draws without a result, left out: {failed}")
    spreads = s["numbers"]
    for prefix, label in _SHOWN.items():
        names = [n for n in spreads if n == prefix or n.startswith(prefix + "[")]
        if not names:
            continue
        unit = _unit(prefix, u)
        label = f"  {label} [{unit}]" if unit else f"  {label}"
        means = [spreads[n]["nominal" if spreads[n]["mean"] is None else "mean"] for n in names]
        spread = [spreads[n]["deviation"] for n in names]
        if prefix.startswith(("centres", "deflection")):
            size = max((d for d in spread if d is not None), default=0.0)
            lines.append(f"{label:<42} {row(means, size=size)}  +- {numbers(spread, 2)}")
        else:
            shares = [
                percent(d / abs(m)) if m and d is not None else "-"  # one may not exist
                for d, m in zip(spread, means, strict=True)
            ]
            lines.append(f"{label:<42} {row(means)}  +- {', '.join(shares)}")
    if not s["samples"] and any(_meet(spreads, prefix) for prefix in _SHOWN):
        lines.append(
            "  principal values meet here: to first order their spread is rough; draw "
            "samples instead"
        )
    softest = spreads.get("ellipsoids.stiffness.translation.free.eigenvalues[0]")
    if softest is not None and "main_parameter" in softest:
        lines.append(
            f"  most of the softest direction's variance: {softest['main_parameter']} "
            f"({percent(softest['main_share'])})"
        )
    if full:
        rows = [
            [
                name,
                _unit(name, u),
                *(number(e[key], digits, size=_size(name, spreads)) for key, digits in _SPREAD),
            ]
            for name, e in spreads.items()
        ]
        level = percent(s["level"])
        lines.append(f"  every number, with the interval that holds {level}")
        lines += table(["", "unit", "nominal", "mean", "deviation", "lower", "upper"], rows)
    return lines
