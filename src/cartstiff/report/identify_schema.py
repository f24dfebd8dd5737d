"""The form of ``cartstiff identify --json``, as a JSON Schema."""

from __future__ import annotations

from typing import Any

from cartstiff.identify.result import IDENTIFY_SCHEMA

__all__ = ["identify_schema"]


def _object(properties: dict[str, Any], description: str = "") -> dict[str, Any]:
    return {
        "type": "object", "description": description, "properties": properties,
        "required": list(properties), "additionalProperties": False,
    }  # fmt: skip


def _number(description: str, *, null: bool = False) -> dict[str, Any]:
    return {"type": ["number", "null"] if null else "number", "description": description}


def _text(description: str) -> dict[str, Any]:
    return {"type": "string", "description": description}


def _list(items: dict[str, Any], description: str, *, null: bool = False) -> dict[str, Any]:
    kind: Any = ["array", "null"] if null else "array"
    return {"type": kind, "items": items, "description": description}


_PARAMETER = _object(
    {
        "name": _text("of the spring; springs that are tied: A = B"),
        "stiffness": _number("1 / compliance; null where that is zero or not known", null=True),
        "unit": _text("of the stiffness"),
        "compliance": _number("estimate; null where not identifiable", null=True),
        "sd": _number("standard deviation of the compliance", null=True),
        "interval": _list(
            {"type": ["number", "null"]},
            "lower and upper end of the stiffness; null: no upper end, or not known",
        ),
        "compliance_interval": _list({"type": "number"}, "of the compliance, not below zero",
                                     null=True),
        "identifiable": {"type": "boolean", "description": "whether the interval is finite"},
        "verdict": {"enum": ["determined", "at-least", "not-identifiable", "negative"]},
        "method": {"enum": ["linear", "profile", "linear, not looked at"]},
        "plain": _number("compliance by least squares on all rows used", null=True),
        "robust": _number("compliance by the robust fit", null=True),
    }
)  # fmt: skip
_NOISE = _object(
    {
        "unit": _text("of the numbers"),
        "count": {"type": "integer"},
        "residual_rms": _number("root mean square of measured less predicted"),
        "sigma": _number("standard deviation of one number, mean square"),
        "sigma_is_estimated": {"type": "boolean"},
        "leave_one_out_rms": _number("of predictions from the other postures", null=True),
    }
)
_CHECKS = _object(
    {
        "chi_squared": _number("of the residuals, where deviations are given", null=True),
        "freedom": _number("numbers less what was fitted"),
        "probability": _number("of a larger one", null=True),
        "repeats": {"type": "integer", "description": "numbers beyond the first in one setting"},
        "lack_of_fit": _number("probability of what repeats do not show", null=True),
        "patterns": _list(
            _object(
                {
                    "kind": {"enum": ["backlash", "stiffening", "drift"]},
                    "name": _text("spring or column"),
                    "size": _number("half the play; compliance per force; per second"),
                    "probability": _number("without it"),
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
        "frame": _text("name of the body frame M"),
        "units": units,
        "model": {"enum": ["linear in the load", "loaded equilibrium"]},
        "fit": {"enum": ["plain", "robust"]},
        "level": _number("probability of the intervals"),
        "rows": {"type": "integer", "description": "of the table"},
        "used": _list({"type": "integer"}, "numbers of the rows used, from 1"),
        "rejected": _list(
            _object({"row": {"type": "integer"}, "reason": _text("in words")}), "rows left out"
        ),
        "parameters": _list(_PARAMETER, "what was found"),
        "covariance": _list(
            _list({"type": ["number", "null"]}, "row"),
            "of the compliances, in the order of the parameters; null where not identifiable",
        ),
        "degrees": _number("of freedom of Student's t; null: normal", null=True),
        "residual_rms": _number("of lengths; of angles where there are no lengths"),
        "sigma": _number("standard deviation of one of them"),
        "leave_one_out_rms": _number("of predictions from the other postures", null=True),
        "noise": {
            "type": "object", "additionalProperties": _NOISE,
            "description": "the same by kind: length, angle",
        },
        "inflation": _number("factor on all deviations, as the scatter is larger; else 1"),
        "suspects": _list({"type": "integer"}, "numbers of rows that the robust fit suspects"),
        "singular_values": _list({"type": "number"}, "of the regressor with unit columns"),
        "unseen": _list(
            _object({"singular_value": {"type": "number"}, "springs": {"type": "object"}}),
            "combinations of springs that no row sees",
        ),
        "checks": _CHECKS,
        "notes": notes,
    }  # fmt: skip
    schema = _object(properties, "Output of cartstiff identify --json")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
