"""The form of ``cartstiff assemble --json``, as a JSON Schema."""

from __future__ import annotations

from typing import Any

from cartstiff.reach.assembly import ASSEMBLE_SCHEMA
from cartstiff.report.identify_schema import list_of, number, object_with

__all__ = ["assemble_schema"]

_DRAFT = "https://json-schema.org/draft/2020-12/schema"


def _numbers(description: str, *, null: bool = False) -> dict[str, Any]:
    return list_of({"type": "number"}, description, null=null)


def assemble_schema(parts: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of what ``cartstiff assemble --json`` prints (draft 2020-12).

    `parts` are those that other commands print too: "mechanism", "frame", "units", "notes".
    """
    mode = object_with(
        {
            "q": _numbers("coordinates; of a platform x, y, z, roll, pitch, yaw"),
            "pose": {"type": "array", "description": "4x4, of M in F"},
            "residual": number("largest difference from the lengths, or gap of the closures"),
            "multiplicity": {"type": "integer", "description": "solutions that meet there"},
            "smallest_eigenvalue": number(
                "of the tangent stiffness, angles times the characteristic length; force/length",
                null=True,
            ),
            "stable": {"type": ["boolean", "null"], "description": "null: singular, or unknown"},
            "determinant": number("of the legs' lines, moments over that length", null=True),
            "frequencies": list_of(
                {"type": ["number", "null"]}, "Hz; null where there is no mass", null=True
            ),
            "notes": parts["notes"],
        }
    )
    search = {
        "type": ["object", "null"],
        "description": "null where nothing was searched, for the reason in the notes",
        "properties": {
            "method": {"enum": ["homotopy", "starts"]},
            "complete": {
                "type": "boolean", "description": "whether no isolated mode can be missing"
            },
            "total": {"type": "integer", "description": "homotopy: paths, 40"},
            "single": {"type": "integer", "description": "that ended at solutions of their own"},
            "real": {"type": "integer", "description": "of these"},
            "multiple": {"type": "integer", "description": "that ended where others do"},
            "moving": {"type": "integer", "description": "that ended on curves of solutions"},
            "nowhere": {"type": "integer", "description": "that ended at infinity"},
            "lost": {"type": "integer", "description": "whose end is not known"},
            "starts": {"type": "integer", "description": "starts: how many"},
            "found": {"type": "integer", "description": "starts: different modes"},
        },
        "required": ["method", "complete"],
        "additionalProperties": False,
    }  # fmt: skip
    schema = object_with(
        {
            "schema": {"const": ASSEMBLE_SCHEMA, "description": "name and version of this form"},
            "mechanism": parts["mechanism"],
            "frame": parts["frame"],
            "units": parts["units"],
            "given": {"type": "object", "description": "leg lengths, or actuated joints, by name"},
            "search": search,
            "modes": list_of(mode, "the nearest to the default posture first"),
            "notes": parts["notes"],
        },
        "Output of cartstiff assemble --json",
    )
    return {"$schema": _DRAFT, **schema}
