"""The answers on identified springs, and on plans of measurements."""

from __future__ import annotations

from typing import Any

from cartstiff.answer.data import Answer, Column, Quantity, Statement, Table, said, table
from cartstiff.core.arrays import plain
from cartstiff.wings.identify.identification import Identification
from cartstiff.wings.identify.plan import Plan
from cartstiff.wings.identify.unknowns import LEVEL


def answer_of_identification(result: Identification) -> Answer:
    """Stiffnesses with their intervals, zeros and offsets, scatter, what no row sees."""
    estimates, data = result.estimates, result.to_dict()
    # The first sentence is whether everything was found.
    known = sum(e.verdict == "determined" for e in estimates)
    state = ("springs-undetermined", "springs-found")[known == len(estimates)]
    # Rows of the tables, with the words that their codes stand for.
    geometry = [
        g | {"words": "not-identifiable" * (not g["identifiable"])}
        for g in data["geometry"]
    ]
    scatter = [{"name": name, **entry} for name, entry in data["noise"].items()]
    for entry in scatter:
        entry["origin"] = ("given", "estimated")[entry["sigma_is_estimated"]]
    values, level = data["singular_values"], 100.0 * result.level
    offsets = "= name | value | from = interval.0 | to = interval.1 | unit | sd : 3"
    origins = "= name | numbers = count | residual rms = residual_rms | sd of one = sigma"
    # The springs first, then offsets, and how well all of it explains the measurements.
    return Answer.about_mechanism(
        "identify",
        result.elastic,
        result.notes,
        said(state, known=known, all=len(estimates)),
        about=[
            said(
                ("fit-not-recommended", "fit")[result.fit == result.recommended],
                rows=len(result.measured),
                numbers=len(result.model.observations),
                fit=result.fit,
                recommended=result.recommended,
                model=data["model"],
            )
        ],
        tables=[
            _springs(result),
            *[table("offsets", f"{offsets} | = words : ?", geometry, level=level)]
            * bool(geometry),
            table(
                "scatter",
                f"{origins} | = origin | left-out rms = leave_one_out_rms | unit",
                scatter,
                said("singular-values", largest=values[0], least=values[-1]),
                *(
                    said("not-seen", parts=entry["springs"] | entry["offsets"])
                    for entry in data["unseen"]
                ),
            ),
        ],
    )


def _springs(result: Identification) -> Table:
    """Each stiffness with its interval, by the fit that was chosen and by the other."""
    other, others = "plain", result.plain
    if result.fit == "plain":
        other, others = "robust", result.robust.fit
    rows = list[list[Any]]()
    for e, theta in zip(result.estimates, others.theta.tolist(), strict=True):
        unit, (low, high) = e.unknown.unit, e.stiffness_interval
        own = [e.stiffness, low, high, unit, e.compliance, e.deviation, theta, e.verdict]
        if e.unknown.has_stiffness:
            own[2], own[6] = high or "no end", 1.0 / theta if theta > 0.0 else None
        elif e.unknown.law is not None and e.interval is not None:
            own[:5], own[7] = [e.compliance, *e.interval, unit, None], "coefficient"
        if e.verdict == "not-identifiable":
            own[:7] = [None, None, None, unit, None, None, None]
        rows.append([e.name, *own])
    heads = f"compliance | sd : 3 | {other} fit | : ?"
    heads = f"spring | stiffness | from | to | unit | {heads}"
    return table("stiffnesses", heads, rows, level=100.0 * result.level)


def answer_of_plan(plan: Plan) -> Answer:
    """The chosen rows, the predicted intervals, and their decrease with more rows."""
    elastic, data = plan.unknowns.elastic, plan.to_dict()
    by_rows = [
        (entry["rows"], _half_width(factor, entry["worst_relative_sd"]))
        for factor, entry in zip(plan.factors, data["by_rows"], strict=True)
    ]
    state = said("widest", half=by_rows[-1][1], rows=len(plan.rows))
    if plan.lost:
        state = said("not-loaded", names=plan.lost)
    geometry = [g | {"sd": g["sd"] or "not-identifiable"} for g in data["geometry"]]
    heads = "spring = name | stiffness | from = interval.0 | to = interval.1 | unit"
    return Answer.about_mechanism(
        "identify",
        elastic,
        elastic.notes,
        state,
        about=[said("plan", rows=len(plan.rows), criterion=f"by {plan.criterion}")],
        tables=[
            _rows_to_measure(plan),
            table(
                "predicted",
                f"{heads} | of the compliance = half",
                [_predicted(plan, entry) for entry in data["parameters"]],
                level=100.0 * LEVEL,
            ),
            *[table("deviations", "= name | sd : 3 | unit", geometry)] * bool(geometry),
            table("by rows", " | : <", by_rows),
        ],
    )


def _half_width(factor: float, deviation: float | None) -> Statement:
    """Half of an interval, in per cent of the compliance."""
    if deviation is None:
        return said("all-not-determined")
    return said("half-width", half=100.0 * float(factor) * deviation)


def _predicted(plan: Plan, entry: dict[str, Any]) -> dict[str, Any]:
    """A stiffness with the half width of its interval, which may have no end."""
    if entry["relative_sd"] is None:
        return entry | {"half": "not-identifiable"}
    low, high = entry["interval"]
    half = _half_width(plan.factor, entry["relative_sd"])
    return entry | {"interval": [low, high or "no end"], "half": half}


def _rows_to_measure(plan: Plan) -> Table:
    """Postures and loads."""
    elastic, rows = plan.unknowns.elastic, plan.rows
    units, forces = elastic.units, plain(rows.wrench[:, 3:])
    body = (
        [i, *q, mass, Quantity(tuple(force), units.force)]
        for i, (q, mass, force) in enumerate(
            zip(rows.q.tolist(), rows.mass.tolist(), forces, strict=True), 1
        )
    )
    coordinates = elastic.mechanism.coordinates
    heads = [
        Column("row"),
        *(Column(c.name, units.coordinate(c.is_length), "4f") for c in coordinates),
        Column("mass", "kg", "4"),
        Column("force in F", form="4"),
    ]
    return table("rows", heads, body)
