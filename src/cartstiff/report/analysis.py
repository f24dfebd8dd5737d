"""The dict of an analysis as text for reading, with units on every number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff import numerics
from cartstiff.analysis.matrices import PURE
from cartstiff.analysis.sections import unit_of
from cartstiff.answer.data import Answer, Quantity, said
from cartstiff.answer.equilibrium import answer_of_equilibrium
from cartstiff.answer.posture import answer_at
from cartstiff.choices import Level
from cartstiff.errors import joined
from cartstiff.report.answer import Block, answer_text
from cartstiff.report.layout import (
    COSINES,
    length_of,
    lengths,
    number,
    numbers,
    percent,
    row,
    share,
    table,
    vector,
)
from cartstiff.report.matrices import matrices_of
from cartstiff.report.sentences import statement_sentences
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.units import SI, Units, shown_unit

if TYPE_CHECKING:
    from cartstiff.statics.rest import Equilibrium

#: Where everything is that a screen does not hold.
ELSEWHERE = "--analysis full or --json has all"


def describe(
    result: PostureStiffness,
    answer: Answer | None = None,
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
    answer : Answer, optional
        Its answer; default that of `answer_at`.
    analysis : mapping, optional
        From `cartstiff.analysis.posture.summarise`.
    level : {"full", "short", "none"}
        full: everything. Else what fits on a screen: one matrix, principal stiffnesses,
        the choice of connection; and what was asked for beside the posture.
    at_rest : bool
        Whether the stiffness includes the loads.
    whole : iterable of str
        Further lines that were asked for.
    """
    units = result.units
    answer = answer_at(result) if answer is None else answer
    energy: Block = ("energy", ["", *_energy(result, answer)])
    if level == "full":
        more = [] if analysis is None else summary_text(analysis, units).split("\n")[:-1]
        blocks = [_matrices(result, None, at_rest), energy, ("analysis", ["", *more])]
        return answer_text(answer, blocks[: 2 + bool(more)], whole=whole)
    blocks = [_matrices(result, answer.verdict.connection, at_rest), energy]
    if analysis is not None:
        only = analysis["connection"]
        blocks[0] = _matrices(result, only, at_rest)
        whole = [*whole, *_asked(analysis, units)]
        blocks[1:1] = _short_blocks(analysis, units)
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
        works += float(
            np.abs(gradient * result.posture.coordinate_lengths).max(initial=0.0)
        )
    return total * (abs(total) > numerics.PRINTED_AS_ZERO * works)


def _point(position: Sequence[float], u: Units) -> str:
    """A point in brackets, with the unit of texts."""
    return f"{vector(lengths(position, u))} {u.shown_length}"


_FREEDOMS = {"translation": "rotation", "rotation": "translation"}
# Ratio of squared sizes below which principal values are round-off.
_SQUARED_ROUNDOFF = numerics.ZERO_SHARE**2 / numerics.PRINTED_AS_ZERO
_FREE_OF_ASYMMETRIC = (
    '  "free" comes from the symmetric part of its inverse: motion along a force'
)
_IS_TANGENT = {True: "the tangent", False: "NOT the tangent (that is K^load)"}
_DEFINITE = {"positive": "positive definite", "negative": "negative definite"}


def summary_text(
    summary: Mapping[str, Any], units: Units | Mapping[str, str] | None = None
) -> str:
    """Text of an analysis.

    Parameters
    ----------
    summary : mapping
        Analysis from `cartstiff.analysis.posture.summarise` or
        `cartstiff.analysis.posture`.
    units : Units, or mapping of str to str
        Keys "length", "force", "angle"; default SI.

    Raises
    ------
    InputError
        If a unit is missing.
    """
    if not isinstance(units, Units):
        units = Units.from_dict(units or SI.to_dict())
    u = units
    lines = _heading(summary, u)
    lines += _principal(summary["ellipsoids"], u, summary["length"]["value"])
    lines += _directions(summary["directions"], u, True)
    lines += _centres(summary, u)
    lines += _indices(summary, u)
    lines += screw_lines(summary, u)
    lines += mode_lines(summary["modes"], u, summary["length"]["value"])
    lines += _connections(summary, u, True)
    lines += target_lines((summary.get("synthesis") or {}).get("target"), u, True)
    lines += deflection_lines(summary.get("deflection"), u)
    lines += wrench_lines(summary.get("wrenches"), u)
    lines += uncertainty_lines(summary.get("uncertainty"), u, True)
    lines += _missing(summary)
    return joined(_capitals(lines)) + "\n"


def _missing(summary: Mapping[str, Any]) -> list[str]:
    """What does not exist."""
    lines = [f"  {note['message']} [{note['code']}]" for note in summary["notes"]]
    return ["", "does not exist here, or not to all digits", *lines] if lines else []


def _capitals(lines: Iterable[str]) -> list[str]:
    return [line[:1].upper() + line[1:] for line in lines]


def _asked(summary: Mapping[str, Any], u: Units) -> list[str]:
    """What of an analysis was asked for: a direction, a target, tolerances."""
    return _capitals(
        [
            *_directions(summary["directions"], u, False),
            *target_lines((summary.get("synthesis") or {}).get("target"), u, False),
            *uncertainty_lines(summary.get("uncertainty"), u, False),
        ]
    )


def _short_blocks(summary: Mapping[str, Any], u: Units) -> list[Block]:
    """Principal values, the choice of connection, and what does not exist."""
    length = summary["length"]["value"]
    blocks = {
        "principal values": _short_principal(summary["ellipsoids"], u, length),
        "choice of connection": _connections(summary, u, False),
        "what does not exist": _missing(summary),
    }
    return [(name, _capitals(lines)) for name, lines in blocks.items() if lines]


def _heading(s: Mapping[str, Any], u: Units) -> list[str]:
    name, length = s["connection"], s["length"]
    if name is None and s["compliance"] is None:
        return ["analysis: there is neither stiffness nor compliance here"]
    if name is None:
        what = "the compliance"
    else:
        part = "the symmetric part of " * bool(s["symmetrised"])
        what = f"{part}K^{name}, {_DEFINITE.get(s['definiteness'], s['definiteness'])}"
    origin = [r[3] for r in s["frame"][:3]]
    at = "the body frame"
    if any(origin) or _is_turned(s):
        at = f"the point {_point(origin, u)} of the body frame"
        at += (", along its axes", ", in other axes")[_is_turned(s)]
    return [
        f"analysis of {what}, at {at}",
        *_load(s, u),
        *([_FREE_OF_ASYMMETRIC] * bool(s["symmetrised"])),
        f"  characteristic length {length_of(length['value'], u)} ({length['reason']})",
    ]


def _load(s: Mapping[str, Any], u: Units) -> list[str]:
    """State the assumed behaviour of the load, and whether the matrix is the
    tangent under it.
    """
    load = s.get("load")
    if load is None:
        return []
    what = _IS_TANGENT[load["is_tangent"]]
    at = _point(load["at"], u)
    if not any(load["at"]):
        at = "the origin of the body frame"
    return [f"  {what} under a {load['kind']} load at {at}: {load['meaning']}"]


def _principal(ellipsoids: Mapping[str, Any], u: Units, length: float) -> list[str]:
    """Principal values with their axes."""
    lines = []
    for quantity in ("stiffness", "compliance")[not _has_stiffness(ellipsoids) :]:
        if ellipsoids[quantity]["translation"]["free"] is None:
            continue
        title = (
            f"principal {quantity} (held: the other three freedoms locked; free: "
            "unloaded)"
        )
        lines += ["", title]
        for freedom, other in _FREEDOMS.items():
            unit, _ = shown_unit(getattr(u, quantity)[freedom])
            for others in ("held", "free"):
                label = f"  {freedom}, {other} {others} [{unit}]"
                values = _principal_values(
                    ellipsoids, quantity, freedom, others, u, length
                )
                lines.append(f"{label:<42} {values}")
                e = ellipsoids[quantity][freedom][others]
                for column in range(3 * (e is not None)):
                    axis = [r[column] for r in e["axes"]]
                    name = f"    axis {column + 1}"
                    lines.append(f"{name:<42} {row(axis, size=COSINES)}")
    return lines


def _short_principal(ellipsoids: Mapping[str, Any], u: Units, length: float) -> list[str]:
    """Principal stiffnesses, or compliances without them, one line for each freedom."""
    quantity = ("compliance", "stiffness")[_has_stiffness(ellipsoids)]
    if ellipsoids[quantity]["translation"]["free"] is None:
        return []
    lines = ["", f"principal {quantity}: the other three freedoms held; unloaded"]
    for freedom in _FREEDOMS:
        unit, _ = shown_unit(getattr(u, quantity)[freedom])
        held, free = (
            _principal_values(ellipsoids, quantity, freedom, others, u, length)
            for others in ("held", "free")
        )
        lines.append(f"  {f'{freedom} [{unit}]':<23} {held}; {free.lstrip()}")
    return lines


def _has_stiffness(ellipsoids: Mapping[str, Any]) -> bool:
    return ellipsoids["stiffness"]["translation"]["held"] is not None


def _principal_values(
    ellipsoids: Mapping[str, Any],
    quantity: str,
    freedom: str,
    others: str,
    u: Units,
    length: float,
) -> str:
    """Three principal values, and their signs, unless all are positive;
    round-off beside those of the other freedom is 0.
    """
    e = ellipsoids[quantity][freedom][others]
    if e is None:
        return "does not exist"
    _, per = shown_unit(getattr(u, quantity)[freedom])
    beside = ellipsoids[quantity][_FREEDOMS[freedom]][others] or {"eigenvalues": [0.0]}
    power = (2, -2)[(freedom == "rotation") != (quantity == "stiffness")]
    size = _SQUARED_ROUNDOFF * max(map(abs, beside["eigenvalues"])) * length**power
    sign = f"   {e['definiteness']}" * (e["definiteness"] != "positive")
    return f"{row(per * np.array(e['eigenvalues']), size=per * size)}{sign}"


def _is_turned(s: Mapping[str, Any]) -> bool:
    """Whether the analysis is in other axes than the body's."""
    return any(abs(s["frame"][i][j] - (i == j)) > 0 for i in range(3) for j in range(3))


def _directions(rows: list[Mapping[str, Any]], u: Units, full: bool) -> list[str]:
    shown = [r for r in rows if full or r["name"] == "given"]
    values = [
        r[k][o] for r in shown for k in ("along", "about") for o in ("held", "free")
    ]
    if not any(v is not None for v in values):
        return []
    titles, per = ["", "direction"], {}
    for kind, freedom in (("along", "translation"), ("about", "rotation")):
        unit, per[kind] = shown_unit(u.stiffness[freedom])
        titles += [f"{kind}, held [{unit}]", "free"]
    cells = [
        [
            r["name"],
            vector(r["direction"]),
            *(
                number(r[k][o] and per[k] * r[k][o])
                for k in ("along", "about")
                for o in ("held", "free")
            ),
        ]
        for r in shown
    ]
    return [
        "",
        "stiffness along and about lines through this point",
        *table(titles, cells),
    ]


def _centres(s: Mapping[str, Any], u: Units) -> list[str]:
    if s["centres"] is None:
        return []
    place = "the origin of the body frame"
    if any(r[3] for r in s["frame"][:3]):
        place = "this point"
    lines = [
        "",
        f"centres [{u.shown_length}], from {place} along the axes of the analysis",
    ]
    size = s["length"]["value"] * u.shown_per_length
    for name, point in s["centres"].items():
        label = {"least_coupling": "point of least coupling"}.get(
            name, f"centre of {name}"
        )
        where = point and lengths(point, u)
        lines.append(f"  {label:<40} {row(where, size=size)}")
    frame, form = s["decoupling_frame"], s["normal_form"]
    if frame is not None:
        scale = "0 none; not bounded, as the matrix is indefinite"
        if s["definiteness"] in ("positive", "positive semidefinite"):
            scale = "0 none, 1 full"
        lines.append(
            f"  coupling of rotation and translation: {share(frame['coupling_before'])} "
            "here, "
            f"{share(frame['coupling'])} at the point of least coupling ({scale})"
        )
    for what, place in (("normal form", form), ("decoupling frame", frame)):
        if place is not None:
            lines.append(f"  {what}: axes as columns")
            lines += [f"{'':<42} {row(r[:3])}" for r in place["T_m_n"][:3]]
            if what == "normal form":
                blocks = np.abs(s["stiffness"])
                size = float(np.sqrt(blocks[:3, :3].max() * blocks[3:, 3:].max()))
                lines.append(
                    f"    coupling there [{u.blocks['tr']}] "
                    f"{numbers(place['coupling'], size=size)}"
                )
    return lines


def _indices(s: Mapping[str, Any], u: Units) -> list[str]:
    n = s["indices"]
    if n is None:
        return []
    stiff, per = shown_unit(u.stiffness["translation"])
    length = length_of(n["length"], u)
    lines = ["", f"indices, angles multiplied by the characteristic length {length}"]
    if n["condition_number"] is None:
        lines.append("  condition number infinite: the matrix is singular")
    else:
        change = f"changes as length^{number(round(n['condition_exponent'], 2))} here"
        lines.append(f"  condition number {number(n['condition_number'])} ({change})")
    lines.append(f"  minimum stiffness {number(per * n['minimum_stiffness'])} {stiff}")
    shown = number(n["isotropy"], missing="-, not positive")
    lines.append(f"  isotropy {shown} (1: equally stiff in all directions)")
    unit = u.determinant
    lines.append(
        f"  determinant {number(n['determinant'])} {unit} (for any length, frame)"
    )
    lines.append(
        f"  condition of the blocks: translation {number(n['translational_condition'])}, "
        f"rotation {number(n['rotational_condition'])} (no length enters)"
    )
    if n["best_length"] is not None:
        lines.append(
            f"  best conditioned at length {length_of(n['best_length'], u)}: "
            f"{number(n['condition_at_best_length'])}"
        )
    return lines


def _difference(value: float, share: float) -> str:
    """Format a difference; 0 if its share is round-off."""
    return number(value * (abs(share) >= numerics.PRINTED_AS_ZERO), 3)


def _connections(s: Mapping[str, Any], u: Units, full: bool) -> list[str]:
    compared = s["connections"]
    if compared is None:
        return []
    if not full:
        return ["", compared["verdict"]]
    lines = ["", "does the choice of connection matter here?", f"  {compared['verdict']}"]
    rows = []
    for r in compared["rows"]:
        if r["change"] is None:
            rows.append([f"K^{r['name']}", *["-"] * 5])
            continue
        cells = [
            f"{_difference(r['largest'][b], r['relative'][b])} "
            f"({percent(r['relative'][b])})"
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
        word = "NOT " * (not a["agrees"]) + "as the load predicts"
        size = percent(a["size"])
        lines.append(
            f"  asymmetry of K^A: {size}, {word} (residual {number(a['residual'], 2)})"
        )
    return lines


Section = Mapping[str, Any] | None


def deflection_lines(d: Section, u: Units) -> list[str]:
    """Deflection of the point, and each joint's or leg's share."""
    if d is None:
        return []
    mm, per = u.shown_length, u.shown_per_length
    moves = lengths(d["displacement"], u)
    size = float(np.linalg.norm(moves))
    angle, turn = u.shown_angle, u.shown_per_radian
    lines = [
        "",
        f"linear deflection (K^{d['connection']}) under {_wrench(d['wrench'], u)} at the "
        "point "
        f"{_point(d['acts_at'], u)}",
        f"  the point {_point(d['point'], u)} moves {number(size)} {mm}: "
        f"{vector(moves, 4)}",
        f"  the body turns {vector([turn * x for x in d['twist'][:3]], 4)} {angle} (all "
        "in the "
        f"body's axes), "
        f"energy {number(d['energy'])} {u.moment}",
    ]
    shares = d["shares"]
    if not shares:
        return lines
    if d["kind"] == "joints":
        first, meaning = "motion", "of the displacement"
        titles = ["joint", "turns or slides", "", "share", f"displacement [{mm}]"]
    else:
        first, meaning = "elongation", "of the energy"
        titles = ["spring", "elongation", "", "share", "change of force"]
    rows = []
    # A compliant link turns and moves: its elongation has no single unit.
    units = {None: ("", ""), True: (mm, u.effort(True)), False: (angle, u.effort(False))}
    sizes = [
        max((abs(s[first]) for s in shares if s["is_length"] is kind), default=0.0)
        for kind in (False, True)
    ]
    for s in shares:
        unit, effort = units[s["is_length"]]
        own = s[first]
        if (
            s["is_length"] is not None
            and abs(own) < numerics.PRINTED_AS_ZERO * sizes[s["is_length"]]
        ):
            own = 0.0
        moved = own * {angle: turn, mm: per}.get(unit, 1.0)
        if first == "motion":
            last = row(lengths(s["displacement"], u), 4, size)
        else:
            last = effort and f"{number(s['force'] * (own != 0.0))} {effort}"
        rows.append([s["name"], number(moved), unit, percent(s["share"]), last])
    lines += [f"  shares {meaning}", *table(titles, rows)]
    if (
        d["kind"] == "springs"
        and abs(d["load_share"] or 0.0) > numerics.NEGLIGIBLE_DIFFERENCE
    ):
        lines.append(
            f"  the rest, {percent(d['load_share'])}, is what the load and other "
            "potentials "
            "take or give"
        )
    return lines


def _wrench(w: list[float], u: Units) -> str:
    """Format the parts of a wrench that are not zero."""
    parts = []
    force, moment = w[3:], w[:3]
    if any(force) or not any(moment):
        parts.append(f"force {vector(force, 4)} {u.force}")
    if max(map(abs, moment)) > numerics.PRINTED_AS_ZERO * max(map(abs, force)):
        parts.append(f"moment {vector(moment, 4)} {u.moment}")
    return " and ".join(parts)


def wrench_lines(wrenches: Sequence[Mapping[str, Any]] | None, u: Units) -> list[str]:
    """Wrenches in joints, closures, links and lines, round-off as 0."""
    if not wrenches:
        return []
    sizes = np.abs([one["wrench"] for one in wrenches]).reshape(-1, 2, 3).max(axis=(0, 2))
    if sizes[0] <= numerics.PRINTED_AS_ZERO * sizes[1]:  # of lines: the force's round-off
        sizes[0] = sizes[1]
    heads = ["part", "frame", f"moment [{u.moment}]", f"force [{u.force}]"]
    rows = [
        [
            one["name"] + " *" * (not one["is_determined"]),
            one["frame"],
            *(vector(one["wrench"][3 * k : 3 * k + 3], 5, sizes[k]) for k in (0, 1)),
        ]
        for one in wrenches
    ]
    if any(one["stress"] is not None for one in wrenches):
        heads.append(f"stress [{u.force}/{u.length}^2]")
        for row_, one in zip(rows, wrenches, strict=True):
            row_.append("" if one["stress"] is None else f"{one['stress']:.4g}")
    lines = ["", "wrenches in joints, closures, links and lines, along each frame's axes"]
    lines += table(heads, rows, [0, 1])
    if any(not one["is_determined"] for one in wrenches):
        lines += ["  * redundant closures between rigid links leave these open"]
    return lines


def target_lines(t: Section, u: Units, full: bool) -> list[str]:
    """Describe the joint stiffness that produces a desired Cartesian stiffness."""
    if t is None:
        return []
    order = ""
    if "order" in t:
        order = f" ({t['order']} by {t['order_from'].replace('file', 'its file')})"
    lines = ["", f"joint stiffness for the target K^{t['connection']}{order}"]
    if not t["is_symmetric"]:
        lines.append(
            f"  the load adds an antisymmetric part to K^{t['connection']}, whatever "
            "springs"
        )
    unit = [u.spring(s) for s in t["are_lengths"]]
    fit = t["diagonal_fit"]
    if t["is_feasible"]:
        lines.append("  independent springs give it exactly:")
    else:
        made = "; not positive definite: active control" * (
            t["definiteness"] != "positive"
        )
        lines.append(
            f"  joints must be coupled, up to {percent(t['off_diagonal'])}{made}"
        )
        if fit is not None:
            lines.append(
                f"  independent springs miss it by {percent(fit['residual'])} at best "
                f"(angles times {length_of(fit['length'], u)}):"
            )
    if not t["stable"]:
        lines.append(
            "  the posture is not stable with it: the target is not positive definite"
        )
    if fit is not None:
        rows = [
            [
                name,
                number(k, 5, "locked"),
                x * (k is not None),
                number(tau),
                u.effort(s),
            ]
            for name, k, x, tau, s in zip(
                t["joints"],
                fit["stiffness"],
                unit,
                t["torque"],
                t["are_lengths"],
                strict=True,
            )
        ]
        lines += table(["joint", "stiffness", "", "carries", ""], rows)
    if full and not t["is_diagonal"]:
        lines.append(
            "  matrix of joint stiffness that gives it exactly, rows and columns in order"
        )
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
    return unit.format(length=u.length, force=u.force) * (unit != PURE)


def _are_repeated(numbers: Mapping[str, Any], prefix: str) -> bool:
    """Whether two sorted principal values are equal, so that they have no derivative."""
    if not prefix.endswith("eigenvalues"):
        return False
    a, b, c = (
        numbers.get(f"{prefix}[{i}]", {}).get("nominal", float("nan")) for i in range(3)
    )
    return min(b - a, c - b) <= numerics.NEGLIGIBLE_DISTANCE * max(abs(a), abs(c))


# Columns of a spread, and their digits.
_SPREAD = (("nominal", 5), ("deviation", 3), ("lower", 5), ("upper", 5))


def _size(name: str, spreads: Mapping[str, Any]) -> float:
    """Size for the round-off of a matrix entry: geometric mean of its two
    diagonal entries.
    """
    if ".axes[" in name:
        return COSINES
    matrix, _, entry = name.partition("[")
    i, _, j = entry.rstrip("]").partition(", ")
    ends = (spreads.get(f"{matrix}[{k}, {k}]", {}).get("nominal") for k in (i, j))
    a, b = (abs(end or 0.0) for end in ends)
    return math.sqrt(a * b)


def uncertainty_lines(s: Section, u: Units, full: bool) -> list[str]:
    """Standard deviations of the main numbers, or of all of them."""
    if s is None:
        return []
    t = s["tolerances"]
    turned = number(u.shown_per_radian * t["angle"])
    given = {
        "stiffness": f"stiffness {percent(t['stiffness'])}",
        "length": f"lengths {length_of(t['length'], u)}",
        "angle": f"rotations {turned} {u.shown_angle}",
    }
    parts = [words for key, words in given.items() if t[key]]
    if any(name.startswith(("compliance.", "coefficient.")) for name in s["parameters"]):
        parts.insert(0, "the measured springs")
    lines = [
        "",
        f"uncertainty from {', '.join(parts)} (to first order; standard deviations)",
    ]
    if s["left_out"]:
        lines.append(f"  {s['left_out']}")
    spreads = s["numbers"]
    for prefix, label in _SHOWN.items():
        names = [n for n in spreads if n == prefix or n.startswith(prefix + "[")]
        if not names:
            continue
        unit, per = shown_unit(_unit(prefix, u))
        label = f"  {label}" + f" [{unit}]" * bool(unit)
        means, spread = (
            [spreads[n][key] and per * spreads[n][key] for n in names]
            for key in ("nominal", "deviation")
        )
        if prefix.startswith(("centres", "deflection")):
            size = max((d for d in spread if d is not None), default=0.0)
            lines.append(f"{label:<42} {row(means, size=size)}  +- {numbers(spread, 2)}")
        else:
            shares = [
                percent(d / abs(m)) if m and d is not None else "-"  # one may not exist
                for d, m in zip(spread, means, strict=True)
            ]
            lines.append(f"{label:<42} {row(means)}  +- {', '.join(shares)}")
    if any(_are_repeated(spreads, prefix) for prefix in _SHOWN):
        lines.append("  principal values meet here: to first order their spread is rough")
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
                *(
                    number(e[key], digits, size=_size(name, spreads))
                    for key, digits in _SPREAD
                ),
            ]
            for name, e in spreads.items()
        ]
        level = percent(s["level"])
        lines.append(f"  every number, with the interval that holds {level}")
        lines += table(["", "unit", "nominal", "deviation", "lower", "upper"], rows)
    return lines


def _axis_cells(a: Mapping[str, Any], size: float) -> list[str]:
    pitch = a["pitch"]
    if pitch is not None and abs(pitch) < numerics.PRINTED_AS_ZERO * size:
        pitch = 0.0
    return [
        number(pitch, 5, "infinite"),
        row(a["direction"], 4, COSINES),
        row(a["point"], 4, size),
    ]


def screw_lines(s: Mapping[str, Any], u: Units) -> list[str]:
    """Eigenscrews and compliant axes."""
    lines: list[str] = []
    size = s["length"]["value"]
    where = [f"pitch [{u.pitch}]", "direction", f"point [{u.length}]"]
    screws = s["eigenscrews"]
    if screws is not None:
        lines += ["", "eigenscrews: twists answered by a wrench on the same screw"]
        lines += table(
            [
                f"eigenvalue [{u.blocks['tr']}]",
                f"about [{u.stiffness['rotation']}]",
                f"along [{u.stiffness['translation']}]",
                *where,
            ],
            [
                [
                    number(e["eigenvalue"]),
                    number(e["rotational_stiffness"]),
                    number(e["translational_stiffness"]),
                    *_axis_cells(e, size),
                ]
                for e in screws["screws"]
            ],
        )
        if not screws["complete"]:
            lines.append(f"  only {len(screws['screws'])} real, independent eigenscrews")
        for z in screws["complex_eigenvalues"]:
            lines.append(
                f"  complex eigenvalue {number(z[0])} {z[1]:+.5g}i {u.blocks['tr']}"
            )
    for kind, meaning, freedom in (
        ("wrench", "translation answered by a parallel force", "translation"),
        ("twist", "moment answered by a parallel rotation", "rotation"),
    ):
        key = f"{kind}_compliant_axes"
        if s[key] is not None:
            lines += ["", f"{kind}-compliant axes: {meaning}"]
            lines += table(
                [f"stiffness [{u.stiffness[freedom]}]", *where],
                [[number(a["stiffness"]), *_axis_cells(a, size)] for a in s[key]],
            )
    return lines


def mode_lines(m: Mapping[str, Any] | None, u: Units, length: float) -> list[str]:
    """Eigenvalues and twists with respect to the metric."""
    if m is None:
        return []
    if m["metric"] == "inertia":
        lines = ["", "modes with respect to the inertia of the body"]
        title = "frequency [Hz]"
        pairs = zip(m["frequencies"], m["eigenvalues"], strict=True)
        values = [_frequency(f, x) for f, x in pairs]
    else:
        lines = ["", "modes with respect to the metric length^2 |omega|^2 + |v|^2"]
        title = f"stiffness [{u.stiffness['translation']}]"
        values = [number(x) for x in m["eigenvalues"]]
    titles = [title, f"rotation [{u.angle}]", f"translation [{u.length}]"]
    columns = list(zip(*m["twists"], strict=True))
    return lines + table(
        titles,
        [
            [
                x,
                row(t[:3], 4, max(map(abs, t[3:])) / length),
                row(t[3:], 4, max(map(abs, t[:3])) * length),
            ]
            for x, t in zip(values, columns, strict=True)
        ],
    )


def _frequency(frequency: float | None, eigenvalue: float) -> str:
    """Format a frequency in Hz, or the growth rate of an unstable motion."""
    if frequency is None:
        return f"unstable ({number((-eigenvalue) ** 0.5)} /s)"
    return number(frequency)
