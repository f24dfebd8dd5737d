"""The analysis of a posture as tables: one or two for each section of its dict."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from cartstiff.answer.analysis.matrices import PURE
from cartstiff.answer.analysis.sections import unit_of
from cartstiff.answer.data import (
    COSINES,
    Column,
    Quantity,
    Statement,
    Table,
    rounded,
    said,
    table,
    wrench_parts,
)
from cartstiff.core import numerics
from cartstiff.core.units import Units

Section = Mapping[str, Any]

_FREEDOMS = {"translation": "rotation", "rotation": "translation"}
_LINES = {"along": "translation", "about": "rotation"}
_OTHERS = ("held", "free")
# Ratio of squared sizes below which principal values are round-off.
_SQUARED_ROUNDOFF = numerics.ZERO_SHARE**2 / numerics.PRINTED_AS_ZERO


def analysis_tables(
    summary: Section, units: Units, level: Literal["full", "short", "asked"] = "full"
) -> Iterator[Table]:
    """The sections of an analysis.

    Parameters
    ----------
    summary : mapping
        From `cartstiff.answer.analysis.posture.summarise` or
        `cartstiff.answer.analysis.posture`.
    units : Units
        Units of its numbers.
    level : {"full", "short", "asked"}
        short: principal values, the choice of connection, and what does not exist; asked:
        a direction, a target and tolerances, where they are given.
    """
    for part in _PARTS[level]:
        yield from part(summary, units, level == "full")


def _list(values: Any, unit: str, size: float = 0.0) -> Quantity | None:
    """Numbers of one kind, without the round-off of the largest, or of a size."""
    if values is None:
        return None
    known = [abs(x) for x in values if x is not None]
    size = max([size, *known])
    own = [None if x is None else rounded([x], size)[0] for x in values]
    return Quantity(own[0] if len(own) == 1 else tuple(own), unit)


def _one(value: float | None, unit: str) -> Quantity | None:
    return None if value is None else Quantity(value, unit)


def _column(matrix: Any, i: int, size: float = COSINES) -> Quantity | None:
    return _list([row[i] for row in matrix], PURE, size)


def _heading(s: Section, u: Units, _: bool) -> Iterator[Table]:
    """The matrix, its load and its length."""
    name, length = s["connection"], s["length"]
    if name is None and s["compliance"] is None:
        yield table("no analysis", (), ())
        return
    what = said("the-compliance")
    if name is not None:
        code = ("the-matrix", "its-symmetric-part")[bool(s["symmetrised"])]
        what = said(code, name=name, sign=s["definiteness"])
    # Where, and along which axes.
    origin = [row[3] for row in s["frame"][:3]]
    is_turned = not np.array_equal(np.array(s["frame"])[:3, :3], np.eye(3))
    at = said("at-the-frame")
    if any(origin) or is_turned:
        code = ("at-a-point", "in-other-axes")[is_turned]
        at = said(code, point=_list(origin, u.length))
    below = []
    if (load := s.get("load")) is not None:
        code = ("no-tangent-under", "tangent-under")[load["is_tangent"]]
        place = _list(load["at"], u.length)
        below.append(said(code, kind=load["kind"], at=place, meaning=load["meaning"]))
    below += [said("free-of-asymmetric")] * bool(s["symmetrised"])
    own = Quantity(length["value"], u.length)
    below.append(said("characteristic-length", length=own, reason=length["reason"]))
    yield table("analysis", (), (), *below, what=what, at=at)


def _principal(s: Section, u: Units, full: bool) -> Iterator[Table]:
    """Principal values with their signs, if not all are positive; in full with axes."""
    ellipsoids = s["ellipsoids"]
    has_stiffness = ellipsoids["stiffness"]["translation"]["held"] is not None
    kinds = ("stiffness", "compliance")[not has_stiffness :]
    for quantity in kinds if full else kinds[:1]:
        shapes = ellipsoids[quantity]
        if shapes["translation"]["free"] is None:
            continue
        rows = []
        for freedom, other in _FREEDOMS.items():
            unit, own = getattr(u, quantity)[freedom], shapes[freedom]
            power = (2, -2)[(freedom == "rotation") != (quantity == "stiffness")]
            cells, axes = list[Any](), list[Any]()
            for others in _OTHERS:
                # Round-off beside the values of the other freedom is 0.
                beside = shapes[other][others] or {"eigenvalues": [0.0]}
                largest = max(map(abs, beside["eigenvalues"]))
                size = _SQUARED_ROUNDOFF * largest * s["length"]["value"] ** power
                e = own[others] or {"eigenvalues": None, "definiteness": "positive"}
                values = _list(e["eigenvalues"], unit, size)
                sign = e["definiteness"]
                cells.append(values if sign == "positive" else [values, sign])
                axes.append(e.get("axes"))
            rows.append((freedom, *cells))
            for i in range(3 * full):
                ends = (axis and _column(axis, i) for axis in axes)
                rows.append((f"  axis {i + 1}", *ends))
        heads = " : < | others held | others free"
        yield table(f"principal {quantity}", heads, rows)


def _directions(s: Section, u: Units, full: bool) -> Iterator[Table]:
    shown = [r for r in s["directions"] if full or r["name"] == "given"]
    kinds = [(line, others) for line in _LINES for others in _OTHERS]
    if not any(r[line][others] is not None for r in shown for line, others in kinds):
        return
    heads = [Column(""), Column("direction", form="3")]
    for line, others in kinds:
        heads.append(Column(f"{line}, {others}", u.stiffness[_LINES[line]]))
    rows = [
        (r["name"], _list(r["direction"], PURE), *(r[line][o] for line, o in kinds))
        for r in shown
    ]
    yield table("directions", heads, rows)


def _centres(s: Section, u: Units, _: bool) -> Iterator[Table]:
    """Centres, and the frames in which rotation and translation couple least."""
    if s["centres"] is None:
        return
    size, rows, below = s["length"]["value"], list[Any](), list[Statement]()
    for name, point in s["centres"].items():
        label = f"centre of {name}".replace("centre of least_", "point of least ")
        rows.append((label, _list(point, u.length, size)))
    # Axes of both frames, and how much is coupled there.
    frame, form = s["decoupling_frame"], s["normal_form"]
    for what, place in (("normal form", form), ("decoupling frame", frame)):
        if place is not None:
            axes = (_column(place["T_m_n"][:3], i) for i in range(3))
            rows += ((f"{what}, axis {i}", axis) for i, axis in enumerate(axes, 1))
    if form is not None:
        blocks = np.abs(s["stiffness"])
        largest = float(np.sqrt(blocks[:3, :3].max() * blocks[3:, 3:].max()))
        coupling = _list(form["coupling"], u.blocks["tr"], largest)
        rows.append(("normal form, coupling", coupling))
    if frame is not None:
        is_bounded = s["definiteness"] in ("positive", "positive semidefinite")
        here, there = rounded([frame["coupling_before"], frame["coupling"]], 1.0)
        code = ("coupling-without-bound", "coupling")[is_bounded]
        below.append(said(code, here=here, there=there))
    code = ("from-the-origin", "from-the-point")[any(r[3] for r in s["frame"][:3])]
    yield table("centres", " : < | ", rows, *below, place=said(code))


def _indices(s: Section, u: Units, _: bool) -> Iterator[Table]:
    if (n := s["indices"]) is None:
        return
    exponent = n["condition_exponent"]
    rows = [
        ("condition number", n["condition_number"] or "infinite: singular"),
        ("  its exponent of the length", exponent and round(exponent, 2)),
        ("minimum stiffness", _one(n["minimum_stiffness"], u.stiffness["translation"])),
        ("isotropy, 1: alike in all directions", n["isotropy"]),
        ("determinant, for any length", _one(n["determinant"], u.determinant)),
        ("condition of the translations", n["translational_condition"]),
        ("condition of the rotations", n["rotational_condition"]),
        ("length of the least condition number", _one(n["best_length"], u.length)),
        ("  condition number there", n["condition_at_best_length"]),
    ]
    own = (row for row in rows if row[1] is not None)
    yield table("indices", " : < | : 5", own, length=Quantity(n["length"], u.length))


def _axis(a: Section, u: Units, size: float) -> tuple[Any, ...]:
    """Pitch, direction and point of a screw."""
    pitch: Any = "infinite"
    if a["pitch"] is not None:
        (own,) = rounded([a["pitch"]], size)
        pitch = Quantity(own, u.pitch)
    return (
        pitch,
        _list(a["direction"], PURE, COSINES),
        _list(a["point"], u.length, size),
    )


_SCREW = "pitch : 5 | direction : 4 | point : 4"


def _screws(s: Section, u: Units, _: bool) -> Iterator[Table]:
    """Eigenscrews and compliant axes."""
    size, stiff = s["length"]["value"], u.stiffness
    keys = ("eigenvalue", "rotational_stiffness", "translational_stiffness")
    if (found := s["eigenscrews"]) is not None:
        own = found["screws"]
        below = [said("few-screws", count=len(own))] * (not found["complete"])
        below += (
            said("complex-eigenvalue", real=x, imaginary=y)
            for x, y in found["complex_eigenvalues"]
        )
        rows = [(*(e[key] for key in keys), *_axis(e, u, size)) for e in own]
        heads = f"eigenvalue [{u.blocks['tr']}] | about [{stiff['rotation']}]"
        heads += f" | along [{stiff['translation']}] | {_SCREW}"
        yield table("eigenscrews", heads, rows, *below)
    for kind, freedom in (("wrench", "translation"), ("twist", "rotation")):
        if (axes := s[f"{kind}_compliant_axes"]) is not None:
            rows = [(a["stiffness"], *_axis(a, u, size)) for a in axes]
            heads = f"stiffness [{stiff[freedom]}] | {_SCREW}"
            yield table(f"{kind}-compliant axes", heads, rows)


def _modes(s: Section, u: Units, _: bool) -> Iterator[Table]:
    """Eigenvalues and twists with respect to the metric."""
    if (m := s["modes"]) is None:
        return
    name, values = "modes by length", m["eigenvalues"]
    head = f"stiffness [{u.stiffness['translation']}]"
    if m["metric"] == "inertia":
        name, head = "modes by inertia", "frequency [Hz]"
        values = [
            said("grows", rate=math.sqrt(-x)) if f is None else f
            for f, x in zip(m["frequencies"], values, strict=True)
        ]
    rows, length = [], s["length"]["value"]
    for x, t in zip(values, zip(*m["twists"], strict=True), strict=True):
        turn = _list(t[:3], PURE, max(map(abs, t[3:])) / length)
        rows.append((x, turn, _list(t[3:], PURE, max(map(abs, t[:3])) * length)))
    heads = f"{head} | rotation in {u.angle} : 4 | translation in {u.length} : 4"
    yield table(name, heads, rows)


def _connections(s: Section, u: Units, full: bool) -> Iterator[Table]:
    """Whether the choice of connection matters."""
    if (compared := s["connections"]) is None:
        return
    words, rows = compared["verdict"], list[Any]()
    if not full:
        own = said("as-said", words=words[:1].upper() + words[1:])
        yield table("choice of connection", (), (), own)
        return
    # Differences by block, those that are round-off of it as zero.
    for r in compared["rows"]:
        cells: list[Any] = [None] * len(u.blocks)
        if r["change"] is not None:
            cells = [
                said(
                    "difference",
                    size=r["largest"][b] * bool(rounded([x], 1.0)[0]),
                    share=x,
                )
                for b, x in ((b, r["relative"][b]) for b in u.blocks)
            ]
        rows.append((f"K^{r['name']}", *cells, r["change"]))
    heads = [Column(""), *(Column(f"{b} [{unit}]") for b, unit in u.blocks.items())]
    below = [said("noted", note=words)]
    if (a := s["asymmetry"]) is not None:
        code = ("asymmetry-unexplained", "asymmetry")[a["agrees"]]
        below.append(said(code, size=a["size"], residual=a["residual"]))
    heads.append(Column("change", form="%"))
    name = compared["reference"]
    yield table("connections", heads if rows else (), rows, *below, reference=name)


def _deflection(s: Section, u: Units, _: bool) -> Iterator[Table]:
    """Deflection of the point, and each joint's or leg's share."""
    if (d := s.get("deflection")) is None:
        return
    moves, turns = _list(d["displacement"], u.length), _list(d["twist"][:3], u.angle)
    size = numerics.norm(d["displacement"])
    yield table(
        "deflection",
        (),
        (),
        said(
            "point-moves",
            point=_list(d["point"], u.length),
            size=Quantity(size, u.length),
            moves=moves,
        ),
        said("body-turns", turns=turns, energy=Quantity(d["energy"], u.moment)),
        connection=d["connection"],
        wrench=wrench_parts(d["wrench"][3:], d["wrench"][:3], u),
        at=_list(d["acts_at"], u.length),
    )
    if not (shares := d["shares"]):
        return
    # Joints move by their motion; springs are elongated, and change their force.
    name, first = "shares of energy", "elongation"
    heads = f"spring | {first} : 4e | share : % | change of force : ?"
    if d["kind"] == "joints":
        name, first = "shares of displacement", "motion"
        heads = "joint | turns or slides : 4e | share : % | displacement : 4"
    largest = {
        kind: max((abs(x[first]) for x in shares if x["is_length"] is kind), default=0.0)
        for kind in (False, True, None)
    }
    rows = []
    for x in shares:
        kind = x["is_length"]
        (own,) = rounded([x[first]], largest[kind])
        # A compliant link turns and moves: its elongation has no single unit.
        moved, force = Quantity(own, PURE), None
        if kind is not None:
            moved = Quantity(own, u.coordinate(kind))
            force = Quantity(x.get("force", 0.0) * (own != 0.0), u.effort(kind))
        last = force
        if d["kind"] == "joints":
            last = _list(x["displacement"], u.length, size)
        rows.append((x["name"], moved, x["share"], last))
    rest = d["load_share"] or 0.0
    is_said = d["kind"] == "springs" and abs(rest) > numerics.NEGLIGIBLE_DIFFERENCE
    yield table(name, heads, rows, *[said("share-of-load", share=rest)] * is_said)


def wrench_tables(s: Section, u: Units, _: bool = True) -> Iterator[Table]:
    """Wrenches in joints, closures, links and lines, without round-off."""
    if not (wrenches := s.get("wrenches")):
        return
    sizes = np.abs([one["wrench"] for one in wrenches]).reshape(-1, 2, 3).max(axis=(0, 2))
    if sizes[0] <= numerics.PRINTED_AS_ZERO * sizes[1]:  # of lines: the force's round-off
        sizes[0] = sizes[1]
    rows = [
        (
            one["name"] + " *" * (not one["is_determined"]),
            one["frame"],
            _list(one["wrench"][:3], PURE, sizes[0]),
            _list(one["wrench"][3:], PURE, sizes[1]),
            one["stress"],
        )
        for one in wrenches
    ]
    heads = f"part : < | frame : < | moment in {u.moment} | force in {u.force}"
    heads += f" | stress [{u.force}/{u.length}^2] : 4?"
    is_open = any(not one["is_determined"] for one in wrenches)
    yield table("wrenches", heads, rows, *[said("left-open")] * is_open)


def _target(s: Section, u: Units, full: bool) -> Iterator[Table]:
    """The joint stiffness that produces a desired Cartesian stiffness."""
    if (t := (s.get("synthesis") or {}).get("target")) is None:
        return
    fit, name = t["diagonal_fit"], t["connection"]
    below = [said("antisymmetric-by-load", name=name)] * (not t["is_symmetric"])
    if t["is_feasible"]:
        below.append(said("springs-give-it"))
    else:
        code = ("coupled-actively", "coupled")[t["definiteness"] == "positive"]
        below.append(said(code, share=t["off_diagonal"]))
        if fit is not None:
            own = Quantity(fit["length"], u.length)
            below.append(said("springs-miss-it", share=fit["residual"], length=own))
    below += [said("unstable-target")] * (not t["stable"])
    by = {key: t.get(key) for key in ("order", "order_from")}
    order = [said("order-from", **by)] * ("order" in t)
    yield table("target", (), (), *below, connection=name, order=order)
    # What independent springs have to be, and the matrix that gives it exactly.
    if fit is not None:
        torques = rounded(t["torque"], max(map(abs, t["torque"])))
        columns = t["joints"], fit["stiffness"], torques, t["are_lengths"]
        rows = [
            (
                joint,
                "locked" if k is None else Quantity(k, u.spring(slides)),
                _one(torque, u.effort(slides)),
            )
            for joint, k, torque, slides in zip(*columns, strict=True)
        ]
        yield table("target springs", "joint | stiffness : 5 | carries : 5", rows)
    if full and not t["is_diagonal"]:
        heads = [Column("")] * len(t["matrix"])
        yield table("target matrix", heads, t["matrix"])


# Numbers whose spread is said, with their labels.
_SPREADS = {
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
_SOFTEST = "ellipsoids.stiffness.translation.free.eigenvalues[0]"


def _uncertainty(summary: Section, u: Units, full: bool) -> Iterator[Table]:
    """Standard deviations of the main numbers, or of all of them."""
    if (s := summary.get("uncertainty")) is None:
        return
    spreads, t = s["numbers"], s["tolerances"]
    of = list[Statement]()
    if any(name.startswith(("compliance.", "coefficient.")) for name in s["parameters"]):
        of.append(said("measured-springs"))
    for key, unit in (("stiffness", ""), ("length", u.length), ("angle", u.angle)):
        if t[key]:
            own = Quantity(t[key], unit) if unit else t[key]
            of.append(said(f"tolerance-of-{key}", size=own))
    below = [said("noted", note=s["left_out"])] * bool(s["left_out"])
    rows = []
    for prefix, label in _SPREADS.items():
        names = [n for n in spreads if n == prefix or n.startswith(prefix + "[")]
        if not names:
            continue
        unit = _unit(prefix, u) or PURE
        means, spread = (
            [spreads[n][key] for n in names] for key in ("nominal", "deviation")
        )
        size, deviations = 0.0, list[Any]()
        if prefix.startswith(("centres", "deflection")):
            size = max((d for d in spread if d is not None), default=0.0)
            deviations = [_list(spread, unit)]
        else:
            for d, m in zip(spread, means, strict=True):  # one may not exist
                deviations.append(d / abs(m) if m and d is not None else None)
        rows.append((label, _list(means, unit, size), deviations))
    if any(_are_repeated(spreads, prefix) for prefix in _SPREADS):
        below.append(said("principal-values-meet"))
    if "main_parameter" in (softest := spreads.get(_SOFTEST, {})):
        name, share = softest["main_parameter"], softest["main_share"]
        below.append(said("main-parameter", name=name, share=share))
    heads = " : < | : 5 | +- : 2%"
    yield table("uncertainty", heads, rows, *below, of=of)
    if full:
        yield _every_spread(s, u)


def _every_spread(s: Section, u: Units) -> Table:
    """Every number, with its interval."""
    rows = []
    for name, e in s["numbers"].items():
        size = _size(name, s["numbers"])
        keys = ("nominal", "deviation", "lower", "upper")
        own = (e[k] if e[k] is None else rounded([e[k]], size)[0] for k in keys)
        rows.append((name, _unit(name, u), *own))
    heads = " | unit | nominal | deviation : 3 | lower | upper"
    return table("every spread", heads, rows, level=s["level"])


def _unit(name: str, u: Units) -> str:
    """Unit of a number such as "stiffness[0, 3]"; "" for none."""
    path = name.replace(", ", ".").replace("[", ".").rstrip("]")
    unit = unit_of(path)
    return unit.format(length=u.length, force=u.force) * (unit != PURE)


def _are_repeated(numbers: Section, prefix: str) -> bool:
    """Whether two sorted principal values are equal, so that they have no derivative."""
    if not prefix.endswith("eigenvalues"):
        return False
    a, b, c = (
        numbers.get(f"{prefix}[{i}]", {}).get("nominal", math.nan) for i in range(3)
    )
    return bool(min(b - a, c - b) <= numerics.NEGLIGIBLE_DISTANCE * max(abs(a), abs(c)))


def _size(name: str, spreads: Section) -> float:
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


def _missing(s: Section, u: Units, _: bool) -> Iterator[Table]:  # noqa: ARG001
    """What does not exist."""
    notes = (f"{note['message']} [{note['code']}]" for note in s["notes"])
    if below := [said("noted", note=note) for note in notes]:
        yield table("what does not exist", (), (), *below)


_PARTS: dict[str, Sequence[Callable[[Section, Units, bool], Iterator[Table]]]] = {
    "full": (
        *(_heading, _principal, _directions, _centres, _indices, _screws, _modes),
        *(_connections, _target, _deflection, wrench_tables, _uncertainty, _missing),
    ),
    "short": (_principal, _connections, _missing),
    "asked": (_directions, _target, _uncertainty),
}
