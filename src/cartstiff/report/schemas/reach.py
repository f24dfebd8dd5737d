"""The forms of ``cartstiff assemble --json`` and ``workspace --json``, as JSON Schemas."""

from __future__ import annotations

from typing import Any

from cartstiff.choices import TENSIONS
from cartstiff.reach.assembly import ASSEMBLE_SCHEMA
from cartstiff.reach.workspace import WORKSPACE_SCHEMA
from cartstiff.report.schemas import words as js


def assemble_schema(parts: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of what ``cartstiff assemble --json`` prints (draft 2020-12).

    `parts` are those that other commands print too: "mechanism", "frame", "units", "notes".
    """
    mode = js.object_with(
        {
            "q": js.numbers("coordinates; of a platform x, y, z, roll, pitch, yaw"),
            "pose": {"type": "array", "description": "4x4, of M in F"},
            "residual": js.number("largest difference from the lengths, or gap of the closures"),
            "multiplicity": js.integer("solutions that meet there"),
            "smallest_eigenvalue": js.number(
                "of the tangent stiffness, angles times the characteristic length; force/length",
                null=True,
            ),
            "stable": js.flag("null: singular, or unknown", null=True),
            "determinant": js.number("of the legs' lines, moments over that length", null=True),
            "frequencies": js.list_of(
                js.number(null=True), "Hz; null where there is no mass", null=True
            ),
            "notes": parts["notes"],
        }
    )
    search = {
        "type": ["object", "null"],
        "description": "null where nothing was searched, for the reason in the notes",
        "properties": {
            "method": js.one_of("homotopy", "starts"),
            "complete": js.flag("whether no isolated mode can be missing"),
            "total": js.integer("homotopy: paths, 40"),
            "single": js.integer("that ended at solutions of their own"),
            "real": js.integer("of these"),
            "multiple": js.integer("that ended where others do"),
            "moving": js.integer("that ended on curves of solutions"),
            "nowhere": js.integer("that ended at infinity"),
            "lost": js.integer("whose end is not known"),
            "starts": js.integer("starts: how many"),
            "found": js.integer("starts: different modes"),
        },
        "required": ["method", "complete"],
        "additionalProperties": False,
    }
    return js.document(
        {
            "schema": js.form(ASSEMBLE_SCHEMA),
            "mechanism": parts["mechanism"],
            **{key: parts[key] for key in ("frame", "frame_offset", "base_pose")},
            "units": parts["units"],
            "given": {"type": "object", "description": "leg lengths, or actuated joints, by name"},
            "gravity": parts["gravity"],
            "weighed": parts["weighed"],
            "search": search,
            "modes": js.list_of(mode, "the nearest to the default posture first"),
            "notes": parts["notes"],
        },
        "assemble",
    )


def workspace_schema(parts: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of what ``cartstiff workspace --json`` prints; `parts` as there."""
    by = "by limit, or the state that ends a ray: share of the directions"
    centre = js.numbers("x, y, z of M in F")
    return js.document(
        {
            "schema": js.form(WORKSPACE_SCHEMA),
            "mechanism": parts["mechanism"],
            **{key: parts[key] for key in ("frame", "frame_offset", "base_pose")},
            "units": parts["units"],
            "pose": {"type": "array", "description": "4x4, M in F: its orientation is kept"},
            "gravity": parts["gravity"],
            "weighed": parts["weighed"],
            "load": js.object_with(
                {
                    "wrench": js.numbers("moment, force", 6),
                    "kind": js.one_of("dead", "follower"),
                    "at": js.numbers("point of the body, in M", 3),
                    "axes": js.one_of("body", "world"),
                },
                "what is carried besides the weight; null: nothing",
                null=True,
            ),
            "axes": js.strings(
                "coordinates of the pose that are followed; x, y, z if it takes them"
            ),
            "volume": js.number(
                "of the positions with it, in the units of the axes; null where none was followed",
                null=True,
            ),
            "volume_error": js.number(
                "estimate of its error: the larger of three standard errors of the columns and "
                "the difference from the volume by rays",
                null=True,
            ),
            "cut_by": js.BY_NAME | {"description": by},
            "slices": js.list_of(
                js.object_with(
                    {"z": js.number("height in F"), "area": js.number("length squared")}
                ),
                "of the volume",
            ),
            "poses": js.integer("poses that were tried"),
            "sphere": js.object_with(
                {"centre": centre, "radius": js.number("length")},
                "the largest that was found inside",
                null=True,
            ),
            "cube": js.object_with(
                {"centre": centre, "edge": js.number("length")},
                "the same, along the axes of F",
                null=True,
            ),
            "rotations": js.object_with(
                {
                    "share": js.number("of all rotations, that can be reached at the position"),
                    "every_axis": js.number("rad: about every axis at least"),
                    "cut_by": js.BY_NAME | {"description": by},
                },
                "at the pose's position",
                null=True,
            ),
            "singularity": js.object_with(
                {
                    "least_ratio": js.number(
                        "smallest over largest singular value of six legs' lines, or of passive "
                        "joints' twists that meet in the body"
                    ),
                    "position": centre,
                },
                "the nearest to one that was met; moments over the body's length",
                null=True,
            ),
            "singular": js.object_with(
                {
                    "metric": {
                        "type": "string",
                        "description": "distances and angles in one number",
                    },
                    "length": js.number("of the metric: the body's"),
                    "distance": js.number("to the nearest singular pose found", null=True),
                    "pose": {"type": ["array", "null"], "description": "4x4, that pose of M"},
                    "shift": js.number("to the nearest with the orientation kept", null=True),
                    "surface": js.list_of(
                        js.numbers("along the axes"), "changes of sign on the rays"
                    ),
                },
                "where the determinant changes its sign, with or without limits",
                null=True,
            ),
            "tensions": js.object_with(
                {
                    "distribution": js.one_of(*TENSIONS),
                    "at_centre": js.numbers(
                        "nearest to the middle of the limits; null without an upper limit, or "
                        "where none carry the load",
                        null=True,
                    ),
                },
                "which tensions count, where they are limited",
                null=True,
            ),
            "boundary": js.list_of(
                js.numbers("along the axes"), "boundaries: last ones within the limits"
            ),
            "limits": js.strings("what ends each of these"),
            "notes": parts["notes"],
        },
        "workspace",
    )
