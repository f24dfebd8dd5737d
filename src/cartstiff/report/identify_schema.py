"""The form of ``cartstiff identify --json``, as a JSON Schema."""

from __future__ import annotations

from typing import Any

from cartstiff.identify.result import IDENTIFY_SCHEMA

__all__ = ["identify_schema", "list_of", "number", "object_with", "text"]


def object_with(properties: dict[str, Any], description: str = "") -> dict[str, Any]:
    """An object with exactly these keys."""
    return {
        "type": "object", "description": description, "properties": properties,
        "required": list(properties), "additionalProperties": False,
    }  # fmt: skip


def number(description: str, *, null: bool = False) -> dict[str, Any]:
    """A number, or null where it may not exist."""
    return {"type": ["number", "null"] if null else "number", "description": description}


def text(description: str) -> dict[str, Any]:
    """A text."""
    return {"type": "string", "description": description}


def list_of(items: dict[str, Any], description: str, *, null: bool = False) -> dict[str, Any]:
    """A list, or null where it may not exist."""
    kind: Any = ["array", "null"] if null else "array"
    return {"type": kind, "items": items, "description": description}


_PARAMETER = object_with(
    {
        "name": text("of the spring; springs that are tied: A = B"),
        "stiffness": number("1 / compliance; null where that is zero or not known", null=True),
        "unit": text("of the stiffness"),
        "compliance": number("estimate; null where not identifiable", null=True),
        "sd": number("standard deviation of the compliance", null=True),
        "interval": list_of(
            {"type": ["number", "null"]},
            "lower and upper end of the stiffness; null: no upper end, or not known",
        ),
        "compliance_interval": list_of({"type": "number"}, "of the compliance, not below zero",
                                     null=True),
        "identifiable": {"type": "boolean", "description": "whether the interval is finite"},
        "verdict": {"enum": ["determined", "at-least", "not-identifiable", "negative"]},
        "method": {"enum": ["linear", "profile", "linear, not looked at"]},
        "plain": number("compliance by least squares on all rows used", null=True),
        "robust": number("compliance by the robust fit", null=True),
    }
)  # fmt: skip
_NOISE = object_with(
    {
        "unit": text("of the numbers"),
        "count": {"type": "integer"},
        "residual_rms": number("root mean square of measured less predicted"),
        "sigma": number("standard deviation of one number, mean square"),
        "sigma_is_estimated": {"type": "boolean"},
        "leave_one_out_rms": number("of predictions from the other postures", null=True),
    }
)
_CHECKS = object_with(
    {
        "chi_squared": number("of the residuals, where deviations are given", null=True),
        "freedom": number("numbers less what was fitted"),
        "probability": number("of a larger one", null=True),
        "repeats": {"type": "integer", "description": "numbers beyond the first in one setting"},
        "lack_of_fit": number("probability of what repeats do not show", null=True),
        "patterns": list_of(
            object_with(
                {
                    "kind": {"enum": ["backlash", "stiffening", "drift"]},
                    "name": text("spring or column"),
                    "size": number("half the play; compliance per force; per second"),
                    "probability": number("without it"),
                }
            ),
            "in the residuals",
        ),
    }
)


def identify_schema(
    notes: dict[str, Any], mechanism: dict[str, Any], units: dict[str, Any]
) -> dict[str, Any]:
    """JSON Schema (draft 2020-12), with the parts that it shares with other commands."""
    properties = {
        "schema": {"const": IDENTIFY_SCHEMA, "description": "name and version of this form"},
        "mechanism": mechanism,
        "frame": text("name of the body frame M"),
        "units": units,
        "model": {"enum": ["linear in the load", "loaded equilibrium"]},
        "fit": {"enum": ["plain", "robust"]},
        "level": number("probability of the intervals"),
        "rows": {"type": "integer", "description": "of the table"},
        "used": list_of({"type": "integer"}, "numbers of the rows used, from 1"),
        "rejected": list_of(
            object_with({"row": {"type": "integer"}, "reason": text("in words")}), "rows left out"
        ),
        "parameters": list_of(_PARAMETER, "what was found"),
        "covariance": list_of(
            list_of({"type": ["number", "null"]}, "row"),
            "of the compliances, in the order of the parameters; null where not identifiable",
        ),
        "degrees": number("of freedom of Student's t; null: normal", null=True),
        "residual_rms": number("of lengths; of angles where there are no lengths"),
        "sigma": number("standard deviation of one of them"),
        "leave_one_out_rms": number("of predictions from the other postures", null=True),
        "noise": {
            "type": "object", "additionalProperties": _NOISE,
            "description": "the same by kind: length, angle",
        },
        "inflation": number("factor on all deviations, as the scatter is larger; else 1"),
        "suspects": list_of({"type": "integer"}, "numbers of rows that the robust fit suspects"),
        "singular_values": list_of({"type": "number"}, "of the regressor with unit columns"),
        "unseen": list_of(
            object_with({"singular_value": {"type": "number"}, "springs": {"type": "object"}}),
            "combinations of springs that no row sees",
        ),
        "checks": _CHECKS,
        "notes": notes,
    }  # fmt: skip
    schema = object_with(properties, "Output of cartstiff identify --json")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
