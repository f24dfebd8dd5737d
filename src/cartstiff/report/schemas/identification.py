"""The form of ``cartstiff identify --json``, as a JSON Schema."""

from __future__ import annotations

from typing import Any

from cartstiff.identify.result import IDENTIFY_SCHEMA
from cartstiff.report.schemas import words as js

_PARAMETER = js.object_with(
    {
        "name": js.text("of the spring; springs that are tied: A = B"),
        "stiffness": js.number("1 / compliance; null where that is zero or not known", null=True),
        "unit": js.text("of the stiffness"),
        "compliance": js.number("estimate; null where not identifiable", null=True),
        "sd": js.number("standard deviation of the compliance", null=True),
        "interval": js.list_of(
            js.number(null=True),
            "lower and upper end of the stiffness; null: no upper end, or not known",
        ),
        "compliance_interval": js.numbers("of the compliance, not below zero", null=True),
        "identifiable": js.flag("whether the interval is finite"),
        "verdict": js.one_of("determined", "at-least", "not-identifiable", "negative"),
        "plain": js.number("compliance by least squares on all rows used", null=True),
        "robust": js.number("compliance by the robust fit", null=True),
    }
)
_NOISE = js.object_with(
    {
        "unit": js.text("of the numbers"),
        "count": js.integer(),
        "residual_rms": js.number("root mean square of measured less predicted"),
        "sigma": js.number("standard deviation of one number, mean square"),
        "sigma_is_estimated": js.flag(),
        "leave_one_out_rms": js.number("of predictions from the other postures", null=True),
    }
)
_CHECKS = js.object_with(
    {
        "chi_squared": js.number("of the residuals, where deviations are given", null=True),
        "freedom": js.number("numbers less what was fitted"),
        "probability": js.number("of a larger one", null=True),
        "repeats": js.integer("numbers beyond the first in one setting"),
        "lack_of_fit": js.number("probability of what repeats do not show", null=True),
        "patterns": js.list_of(
            js.object_with(
                {
                    "kind": js.one_of("backlash", "stiffening", "drift"),
                    "name": js.text("spring or column"),
                    "size": js.number("half the play; compliance per force; per second"),
                    "probability": js.number("without it"),
                }
            ),
            "in the residuals",
        ),
    }
)


def identify_schema(
    notes: dict[str, Any],
    mechanism: dict[str, Any],
    units: dict[str, Any],
    frames: dict[str, Any],
) -> dict[str, Any]:
    """JSON Schema (draft 2020-12), with the parts that it shares with other commands."""
    properties = {
        "schema": js.form(IDENTIFY_SCHEMA),
        "mechanism": mechanism,
        **frames,
        "units": units,
        "model": js.one_of("linear in the load", "loaded equilibrium"),
        "fit": js.one_of("plain", "robust"),
        "level": js.number("probability of the intervals"),
        "rows": js.integer("of the table"),
        "used": js.list_of(js.integer(), "numbers of the rows used, from 1"),
        "rejected": js.list_of(
            js.object_with({"row": js.integer(), "reason": js.text("in words")}), "rows left out"
        ),
        "parameters": js.list_of(_PARAMETER, "what was found"),
        "covariance": js.list_of(
            js.list_of(js.number(null=True), "row"),
            "of the compliances, in the order of the parameters; null where not identifiable",
        ),
        "degrees": js.number("of freedom of Student's t; null: normal", null=True),
        "residual_rms": js.number("of lengths; of angles where there are no lengths"),
        "sigma": js.number("standard deviation of one of them"),
        "leave_one_out_rms": js.number("of predictions from the other postures", null=True),
        "noise": {
            "type": "object",
            "additionalProperties": _NOISE,
            "description": "the same by kind: length, angle",
        },
        "inflation": js.number("factor on all deviations, as the scatter is larger; else 1"),
        "suspects": js.list_of(js.integer(), "numbers of rows that the robust fit suspects"),
        "singular_values": js.numbers("of the regressor with unit columns"),
        "unseen": js.list_of(
            js.object_with({"singular_value": {"type": "number"}, "springs": {"type": "object"}}),
            "combinations of springs that no row sees",
        ),
        "checks": _CHECKS,
        "notes": notes,
    }
    return js.document(properties, "identify")
