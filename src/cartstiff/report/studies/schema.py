"""The form of ``cartstiff design --json``, as a JSON Schema."""

from __future__ import annotations

from typing import Any

from cartstiff.designs.results import DESIGN_SCHEMA
from cartstiff.report.identify_schema import list_of, number, object_with, text

__all__ = ["design_schema"]


def design_schema(notes: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of what ``cartstiff design --json`` prints (draft 2020-12)."""
    by_name = {"type": "object", "additionalProperties": {"type": ["number", "null"]}}
    measure = {
        "name": text("of the measure"),
        "of": text("what it is, for people"),
        "case": {"type": ["string", "null"], "description": "load and poses it belongs to"},
        "unit": text("of its values"),
    }
    counts = {state: {"type": "integer"} for state in ("feasible", "infeasible", "failed")}
    schema = object_with(
        {
            "schema": {"const": DESIGN_SCHEMA, "description": "name and version of this form"},
            "mechanism": text("as the study names it"),
            "method": text("how designs were chosen"),
            "variables": list_of({"type": "string"}, "parameters that vary"),
            "set": by_name | {"description": "parameters that do not, where the study gives them"},
            "poses": {"type": "integer", "description": "poses of each design"},
            "objectives": list_of(
                object_with(measure | {"goal": {"enum": ["largest", "smallest"]}}), "what is wanted"
            ),
            "constraints": list_of(
                object_with(
                    measure | {"at_least": number("bound", null=True),
                               "at_most": number("bound", null=True)}
                ),
                "what must hold",
            ),
            "counts": object_with(counts, "designs by their state"),
            "best": {
                "type": ["object", "null"], "additionalProperties": {"type": "integer"},
                "description": "place in designs of the best for each objective; null if none is "
                "feasible",
            },
            "front": list_of({"type": "integer"}, "places in designs of the Pareto front"),
            "designs": list_of(
                object_with(
                    {
                        "parameters": by_name | {"description": "of the file, as they were"},
                        "values": by_name | {"description": "of the measures"},
                        "state": {"enum": ["feasible", "infeasible", "failed"]},
                        "reason": text("why it is not feasible; else empty"),
                    }
                ),
                "in the order in which they were chosen",
            ),
            "notes": notes,
        },
        "Output of cartstiff design --json",
    )  # fmt: skip
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
