"""The forms of ``cartstiff assemble --json`` and ``workspace --json``, as JSON Schemas."""

from __future__ import annotations

from typing import Any

from cartstiff.reach.assembly import ASSEMBLE_SCHEMA
from cartstiff.reach.workspace import WORKSPACE_SCHEMA
from cartstiff.report.identify_schema import list_of, number, object_with

__all__ = ["assemble_schema", "workspace_schema"]

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


def _shares(description: str) -> dict[str, Any]:
    return {"type": "object", "additionalProperties": {"type": "number"},
            "description": description}  # fmt: skip


def _nothing_or(properties: dict[str, Any], description: str) -> dict[str, Any]:
    """An object with exactly these keys, or null."""
    return object_with(properties, description) | {"type": ["object", "null"]}


def workspace_schema(parts: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of what ``cartstiff workspace --json`` prints; `parts` as there."""
    by = "by limit, or the state that ends a ray: share of the directions"
    centre = _numbers("x, y, z of M in F")
    schema = object_with(
        {
            "schema": {"const": WORKSPACE_SCHEMA, "description": "name and version of this form"},
            "mechanism": parts["mechanism"],
            "frame": parts["frame"],
            "units": parts["units"],
            "pose": {
                "type": "array",
                "description": "4x4, M in F: its orientation is kept",
            },
            "volume": number("of the positions with it; null where none was followed", null=True),
            "cut_by": _shares(by),
            "slices": list_of(
                object_with({"z": number("height in F"), "area": number("length squared")}),
                "of the volume",
            ),
            "poses": {"type": "integer", "description": "poses that were tried"},
            "sphere": _nothing_or(
                {"centre": centre, "radius": number("length")}, "the largest that was found inside"
            ),
            "cube": _nothing_or(
                {"centre": centre, "edge": number("length")}, "the same, along the axes of F"
            ),
            "rotations": _nothing_or(
                {
                    "share": number("of all rotations, that can be reached at the position"),
                    "every_axis": number("rad: about every axis at least"),
                    "cut_by": _shares(by),
                },
                "at the pose's position",
            ),
            "singularity": _nothing_or(
                {
                    "least_ratio": number("smallest over largest singular value of the lines"),
                    "position": centre,
                },
                "the nearest to one that was met; moments over the body's length",
            ),
            "boundary": list_of(_numbers("x, y, z"), "outermost positions, a direction each"),
            "limits": list_of({"type": "string"}, "what ends each of these"),
            "notes": parts["notes"],
        },
        "Output of cartstiff workspace --json",
    )
    return {"$schema": _DRAFT, **schema}
