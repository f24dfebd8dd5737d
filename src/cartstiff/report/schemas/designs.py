"""The form of ``cartstiff design --json``, as a JSON Schema."""

from __future__ import annotations

from typing import Any

from cartstiff.designs.run import DESIGN_SCHEMA
from cartstiff.report.schemas import words as js


def design_schema(parts: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of what ``cartstiff design --json`` prints (draft 2020-12)."""
    by_name = {"type": "object", "additionalProperties": js.number(null=True)}
    measure = {
        "name": js.text("of the measure"),
        "of": js.text("what it is, for people"),
        "case": js.text("load and poses it belongs to", null=True),
        "unit": js.text("of its values"),
    }
    counts = {state: js.integer() for state in ("feasible", "infeasible", "failed")}
    return js.document(
        {
            "schema": js.form(DESIGN_SCHEMA),
            "mechanism": js.text("as the study names it"),
            "method": js.text("how designs were chosen"),
            "variables": js.strings("parameters that vary"),
            "set": by_name | {"description": "parameters that do not, where the study gives them"},
            "poses": js.integer("poses of each design"),
            "gravity": parts["gravity"],
            "weighed": parts["weighed"],
            "objectives": js.list_of(
                js.object_with(measure | {"goal": js.one_of("largest", "smallest")}),
                "what is wanted",
            ),
            "constraints": js.list_of(
                js.object_with(
                    measure
                    | {
                        "at_least": js.number("bound", null=True),
                        "at_most": js.number("bound", null=True),
                    }
                ),
                "what must hold",
            ),
            "counts": js.object_with(counts, "designs by their state"),
            "best": {
                "type": ["object", "null"],
                "additionalProperties": js.integer(),
                "description": "place in designs of the best for each objective; null if none is "
                "feasible",
            },
            "front": js.list_of(js.integer(), "places in designs of the Pareto front"),
            "designs": js.list_of(
                js.object_with(
                    {
                        "parameters": by_name | {"description": "of the file, as they were"},
                        "values": by_name | {"description": "of the measures"},
                        "state": js.one_of("feasible", "infeasible", "failed"),
                        "reason": js.text("why it is not feasible; else empty"),
                    }
                ),
                "in the order in which they were chosen",
            ),
            "notes": parts["notes"],
        },
        "design",
    )
