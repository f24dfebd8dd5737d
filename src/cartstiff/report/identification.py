"""Identified springs and plans of measurements, as text and figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cartstiff.errors import joined
from cartstiff.identify.identification import Identification, is_doubt
from cartstiff.identify.unknowns import LEVEL
from cartstiff.mechanisms.other_units import shown, shown_heads
from cartstiff.report.layout import body_frame, note_lines, number, table

if TYPE_CHECKING:
    from cartstiff.identify.identification import Estimate
    from cartstiff.identify.plan import Plan


def describe_identification(result: Identification) -> str:
    """Describe stiffnesses with their intervals, noise, checks and notes."""
    model = (
        "the equilibrium under load"
        if result.loaded
        else "displacements linear in the load"
    )
    other = (
        "" if result.fit == result.recommended else f"the {result.recommended} one is "
    )
    lines = [
        f"{result.elastic.name}, {body_frame(result.elastic.mechanism)}: "
        f"{len(result.measured)} "
        f"rows, {len(result.model.observations)} numbers; {result.fit} fit "
        f"({other}recommended) of "
        f"{model}",
        *(f"  DOUBTFUL, {n.code}: {n.message}" for n in result.notes if is_doubt(n)),
        "",
        f"Stiffness, {100 * result.level:g} % intervals",
    ]
    other_fit = "plain" if result.fit == "robust" else "robust"
    others = result.plain if result.fit == "robust" else result.robust.fit
    titles = (
        "spring",
        "stiffness",
        "from",
        "to",
        "unit",
        "compliance",
        "sd",
        f"{other_fit} fit",
        "",
    )
    pairs = zip(result.estimates, others.theta.tolist(), strict=True)
    lines += table(titles, [_row(e, theta) for e, theta in pairs])
    if result.geometry:
        lines += ["", f"Zeros and offsets, {100 * result.level:g} % intervals"]
        body = []
        for g in result.geometry:
            ends = g.interval or (None, None)
            words = "" if g.identifiable else "not identifiable"
            body.append(
                (g.name, *map(number, (g.value, *ends)), g.unit, number(g.sd, 3), words)
            )
        lines += table(("", "value", "from", "to", "unit", "sd", ""), body)
    lines += ["", "Scatter"]
    body = []
    for name, entry in result.noise().items():
        origin = "estimated" if entry["sigma_is_estimated"] else "given"
        body.append(
            (
                name,
                str(entry["count"]),
                number(entry["residual_rms"]),
                number(entry["sigma"]),
                origin,
                number(entry["leave_one_out_rms"]),
                entry["unit"],
            )
        )
    heads = ("", "numbers", "residual rms", "sd of one", "", "left-out rms", "unit")
    lines += table(heads, body)
    values = result.chosen.singular_values
    lines += [
        "",
        f"Singular values of the scaled regressor: {number(values[0], 3)} to "
        f"{number(values[-1], 3)}",
    ]
    for entry in result.weak_directions():
        both = {**entry["springs"], **entry["offsets"]}
        shares = " ".join(f"{share:+.2f} {name}" for name, share in both.items())
        lines.append(f"  not seen: {shares}")
    if notes := [note for note in result.notes if not is_doubt(note)]:
        lines += ["", "Notes"]
        lines += [f"  {note.code}: {note.message}" for note in notes]
    return joined(lines)


def _row(e: Estimate, other: float) -> tuple[str, ...]:
    low, high = e.stiffness_interval
    words = {
        "determined": "",
        "at-least": "at least",
        "not-identifiable": "not identifiable",
        "negative": "negative",
    }[e.verdict]
    if e.verdict == "not-identifiable":
        return (e.name, "-", "-", "-", e.unknown.unit, "-", "-", "-", words)
    if (
        e.unknown.law is not None
        and not e.unknown.has_stiffness
        and e.interval is not None
    ):
        low, high = e.interval
        return (
            e.name,
            number(e.compliance),
            number(low),
            number(high),
            e.unknown.unit,
            "-",
            number(e.deviation, 3),
            number(other),
            "coefficient",
        )
    k = other if not e.unknown.has_stiffness else 1.0 / other if other > 0.0 else None
    return (
        e.name,
        number(e.stiffness),
        number(low),
        number(high, missing="no end" if e.unknown.has_stiffness else "-"),
        e.unknown.unit,
        number(e.compliance),
        number(e.deviation, 3),
        number(k),
        words,
    )


def describe_plan(plan: Plan) -> str:
    """Describe the chosen rows, the predicted intervals,
    and their decrease with more rows.
    """
    data, rows = plan.to_dict(), plan.rows
    elastic = plan.unknowns.elements.elastic
    what = {
        "all": "all compliances (D-optimal)",
        "worst": "the widest interval",
        "posture": "the deflection at the test posture",
    }[plan.criterion]
    lines = [f"{elastic.name}: {len(rows)} rows chosen for {what}", "", "Rows"]
    heads = [
        "row",
        *shown_heads(elastic),
        "mass [kg]",
        f"force in F [{elastic.units.force}]",
    ]
    body = []
    for i, (q, mass, W) in enumerate(
        zip(shown(elastic, rows.q), rows.mass, rows.wrench, strict=True)
    ):
        force = ", ".join(number(float(x), 4) for x in W[3:])
        body.append(
            [str(i + 1), *(f"{x:.4f}" for x in q), number(float(mass), 4), f"({force})"]
        )
    lines += table(heads, body)
    lines += ["", f"Predicted {100 * LEVEL:g} % intervals of the file's stiffnesses"]
    body = []
    for entry in data["parameters"]:
        low, high = entry["interval"]
        lost = entry["relative_sd"] is None
        body.append(
            [
                entry["name"],
                number(entry["stiffness"]),
                number(low),
                "-" if lost else number(high, missing="no end"),
                entry["unit"],
                "not identifiable"
                if lost
                else f"+- {100 * plan.factor * entry['relative_sd']:.3g} %",
            ]
        )
    lines += table(
        ("spring", "stiffness", "from", "to", "unit", "of the compliance"), body
    )
    if plan.geometry:
        lines += ["", "Predicted standard deviations of zeros and offsets"]
        body = [
            [g.name, number(g.sd, 3, missing="not identifiable"), g.unit]
            for g in plan.geometry
        ]
        lines += table(("", "sd", "unit"), body)
    lines += ["", "Widest interval with the number of rows"]
    for factor, entry in zip(plan.factors, data["by_rows"], strict=True):
        worst = entry["worst_relative_sd"]
        widest = (
            "not all are determined"
            if worst is None
            else f"+- {100 * factor * worst:.3g} %"
        )
        lines.append(f"  {entry['rows']:>4}  {widest}")
    if plan.lost:
        lines.append(f"no candidate row loads {', '.join(plan.lost)}")
    return joined([*lines, *note_lines(elastic.notes)])
