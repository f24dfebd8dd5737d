"""The form of the JSON output, as a JSON Schema: the reference page is made from it."""

from __future__ import annotations

from typing import Any

from cartstiff.analysis.plain import schema as schema_of_analysis
from cartstiff.choices import LOAD_KINDS
from cartstiff.matrix_names import MATRICES
from cartstiff.report.frames import FRAMES_SCHEMA
from cartstiff.report.identify_schema import identify_schema
from cartstiff.report.reach_schema import assemble_schema, workspace_schema
from cartstiff.report.studies.schema import design_schema
from cartstiff.stiffness.compute import SCHEMA
from cartstiff.vibration.mode_set import MODES_SCHEMA

__all__ = ["frames_schema", "json_schema"]

_NUMBERS: dict[str, Any] = {"type": "array", "items": {"type": "number"}}
_WRENCH: dict[str, Any] = {
    "type": ["array", "null"], "items": {"type": "number"}, "minItems": 6, "maxItems": 6
}  # fmt: skip


def _matrix(rows: int, columns: int | None, description: str, nothing: str = "") -> dict[str, Any]:
    """Schema of a list of rows; null where it may not exist."""
    row = _NUMBERS | ({} if columns is None else {"minItems": columns, "maxItems": columns})
    schema: dict[str, Any] = {"type": "array", "items": row, "minItems": rows, "maxItems": rows}
    if nothing:
        schema["type"] = ["array", "null"]
    return schema | {"description": f"{description}; null {nothing}" if nothing else description}


def _object(properties: dict[str, Any], description: str = "") -> dict[str, Any]:
    """Schema of an object with exactly these keys."""
    return {
        "type": "object",
        "description": description,
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _text(description: str) -> dict[str, Any]:
    return {"type": "string", "description": description}


def _matrices(what: str) -> dict[str, Any]:
    absent = "where it does not exist"
    return _object(
        {n: _matrix(6, 6, f"6x6, {MATRICES[n].name} connection", absent) for n in "ABKF"}, what
    )


_ANALYSIS: dict[str, Any] = {
    "schema": {"const": SCHEMA, "description": "name and version of this form"},
    "mechanism": _object(
        {
            "name": _text("for people"),
            "kind": _text("as in mechanism files"),
            "joints": {
                "type": "array", "items": {"type": "string"},
                "description": "names of the coordinates, in their order",
            },
        },
        "what was analysed",
    ),
    "frame": _text("name of the body frame M"),
    "order": {"const": "angular-linear", "description": "rotation before translation"},
    "units": _object(
        {
            "length": _text("unit of lengths"),
            "force": _text("unit of forces"),
            "angle": {"const": "rad", "description": "unit of angles"},
        },
        "units of every number",
    ),
    "q": _NUMBERS
    | {
        "description": "coordinates; for a platform x, y, z, roll, pitch, yaw. Those of a closed "
        "chain are after assembly"
    },
    "pose": _matrix(4, 4, "4x4, M in F"),
    "jacobian": _matrix(
        6, None,
        "6xn body Jacobian of the coordinates; for a platform 6x6, pose by leg lengths",
        "if there is none",
    ),
    "wrench": _WRENCH
    | {"description": "W: moment, force on the body, in M; null in an unbalanced posture"},
    "load": _object(
        {
            "kind": {
                "enum": list(LOAD_KINDS),
                "description": "what the load is taken to do while the body moves",
            },
            "at": _NUMBERS
            | {"minItems": 3, "maxItems": 3, "description": "point at which it acts, in M"},
            "meaning": _text("the kind, for people"),
            "stiffness": _matrix(
                6, 6, "6x6, K^load: the tangent under the load, in M", "where it does not exist"
            ),
            "compliance": _matrix(6, 6, "its inverse", "where it does not exist"),
        },
        "the load's behaviour and the tangent stiffness that follows from it",
    ),
    "gravity": {
        "type": ["array", "null"], "items": {"type": "number"},
        "description": "acceleration in F; null without gravity",
    },
    "weighed": {
        "type": "array",
        "description": "what gravity acts on: links that joints carry (by the first of each), the "
        "payload, and payloads among the loads, which have a weight of their own",
        "items": _object({"name": _text("link"), "mass": {"type": "number", "description": "kg"}}),
    },
    "energy": {
        "type": ["number", "null"],
        "description": "potential energy of springs, gravity and loads; null if a load has none",
    },
    "stored_energy": {
        "type": ["number", "null"],
        "description": "of that, what springs and other elastic parts hold",
    },
    "stiffness": _matrices("stiffness matrices"),
    "compliance": _matrices("their inverses"),
    "notes": {
        "type": "array",
        "description": "what was assumed, and why something does not exist",
        "items": _object(
            {
                "code": _text("for programs"),
                "message": _text("for people"),
                "values": {"type": "object", "description": "the numbers that show it"},
            }
        ),
    },
}  # fmt: skip

_EQUILIBRIUM: dict[str, Any] = {
    "residual": {"type": "number", "description": "largest unbalanced force over the "
        "forces on the same motion; 0: rounding"},
    "stable": {
        "type": ["boolean", "null"],
        "description": "verdict on the equilibrium; null where definiteness decides nothing",
    },
    "iterations": {"type": "integer", "description": "steps taken"},
    "history": _NUMBERS | {"description": "the residual before each step"},
    "eigenvalues": {
        "type": "array",
        "items": {
            "anyOf": [{"type": "number"}, _NUMBERS | {"minItems": 2, "maxItems": 2}],
        },
        "description": "what the verdict rests on: of the energy's Hessian, or "
        "omega^2 [rad^2/s^2] where a load has no potential (none without masses); pairs of real "
        "and imaginary part where complex",
    },
    "displacement": _NUMBERS
    | {
        "minItems": 6, "maxItems": 6,
        "description": "rotation vector and translation of the body frame, axes of F",
    },
    "displacement_uncertainty": {
        "anyOf": [
            {"type": "null"},
            _object(
                {
                    **{
                        key: _NUMBERS | {"minItems": 6, "maxItems": 6}
                        for key in ("sd", "lower", "upper")
                    },
                    "level": {"type": "number"},
                }
            ),
        ],
        "description": "of the displacement, from springs that were measured; else null",
    },
    "elastic_wrench": _WRENCH
    | {
        "description": "the wrench that springs and structure balance, in M; where the structure's "
        "part is not known, that of least length-scaled norm"
    },
    "reactions": _object(
        {
            "held": {"type": "object", "description": "by held component"},
            "wrench": _WRENCH | {"description": "the same as a wrench; null if nothing is held"},
            "limits": {"type": "object", "description": "by joint or leg on a limit"},
            "closures": _NUMBERS | {"description": "forces of the closures"},
            "rigid": {"type": "object", "description": "torque of each rigid joint"},
        },
        "what holds the mechanism",
    ),
}  # fmt: skip


def _or_null(type_: str, description: str) -> dict[str, Any]:
    return {"type": [type_, "null"], "description": description}


_NAMES: dict[str, Any] = {"type": "array", "items": {"type": "string"}}
_FRAMES: dict[str, Any] = {
    "schema": {"const": FRAMES_SCHEMA, "description": "name and version of this form"},
    "mechanism": _object({"name": _text("for people"), "kind": _text("as in mechanism files")}),
    "frame": _text("frame of interest M"),
    "units": _ANALYSIS["units"],
    "frames": _NAMES | {"description": "frames fixed to F"},
    "joints": {
        "type": "array",
        "description": "in the order of the tree; joints that do not move the frame are links",
        "items": _object(
            {
                "name": _text("of the joint"),
                "parent": _or_null("string", "joint that carries it; null: F"),
                "type": {"enum": ["revolute", "prismatic", "helical", "free"]},
                "lower": _or_null("number", "limit; null if there is none"),
                "upper": _or_null("number", "limit; null if there is none"),
                "q": _or_null("number", "default posture"),
                "spring": {
                    "anyOf": [
                        {"type": "null"},
                        _object(
                            {
                                "stiffness": _or_null("number", "null: rigid, or a law"),
                                "rest": _or_null("number", "null: balanced at the posture"),
                                "law": {"type": "boolean"},
                                "rigid": {"type": "boolean"},
                            }
                        ),
                    ],
                    "description": "null: passive, or a joint of a link that gives",
                },
                "follows": _or_null("string", "coordinate that it mimics"),
                "actuated": _or_null("boolean", "null where the file does not say"),
                "virtual": {"type": "boolean", "description": "of a link that gives"},
                "mass": {"type": "number", "description": "[kg] of what is fixed to it"},
                "frames": _NAMES | {"description": "frames fixed to it, for --frame"},
                "carries_body": {"type": "boolean", "description": "whether M is fixed to it"},
            }
        ),
    },
    "closures": {
        "type": "array",
        "items": _object({"frames": _NAMES, "type": {"enum": ["point", "weld"]}}),
    },
    "legs": {
        "type": "array",
        "description": "lines of a platform",
        "items": _object(
            {
                "name": _text("of the leg"),
                "frames": _NAMES | {"description": "in which its ends are given"},
                "from": _NUMBERS,
                "to": _NUMBERS,
                "stiffness": {"type": "number"},
                "rest": _or_null("number", "rest length; null: balanced at the posture"),
                "shortest": _or_null("number", "limit"),
                "longest": _or_null("number", "limit; null if there is none"),
            }
        ),
    },
    "payload": _or_null("number", "[kg]"),
    "gravity": _or_null("array", "m/s^2, in F"),
    "pose": _matrix(4, 4, "T_F_M at the posture"),
    "notes": _ANALYSIS["notes"],
}


def frames_schema() -> dict[str, Any]:
    """JSON Schema of what ``cartstiff frames --json`` prints (draft 2020-12)."""
    schema = _object(_FRAMES, "Output of cartstiff frames --json")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


_RAGGED: dict[str, Any] = {"type": "array", "items": {"type": "array"}}
_MODES: dict[str, Any] = {
    "schema": {"const": MODES_SCHEMA, "description": "name and version of this form"},
    **{key: _ANALYSIS[key] for key in ("mechanism", "frame", "order", "units", "q")},
    "frequencies": {
        "type": "array",
        "items": {"type": ["number", "null"]},
        "description": "Hz, with the load; 0 of a free motion, null where a motion grows",
    },
    "eigenvalues": {
        "type": "array",
        "description": "omega^2 in 1/s^2; [real, imaginary] where motions flutter",
    },
    "modes": _RAGGED | {"description": "coordinate rates, phi^T M phi = 1; of a platform twists"},
    "twists": _RAGGED | {"description": "body twist (angular, linear) of M for each mode"},
    "nodal_axes": {
        "type": "array",
        "description": "screw of each twist, in M",
        "items": _object(
            {
                "direction": _or_null("array", "null: M does not move"),
                "point": _or_null("array", "null: a translation along the direction"),
                "pitch": _or_null("number", "length per radian; null: a translation"),
            }
        ),
    },
    "repeated": _RAGGED | {"description": "numbers (from 1) of modes with one frequency"},
    "participation": _RAGGED
    | {"description": "share of each coordinate in the kinetic energy of each mode"},
    "effective_masses": _or_null("array", "kg along x, y, z of F that each mode moves"),
    "moving_mass": _or_null("number", "kg, of all that moves"),
    "mass_matrix": _RAGGED | {"description": "kg and the unit of length, on all coordinates"},
    "stiffness_matrix": _RAGGED | {"description": "second derivative of all energies on the basis"},
    "basis": _RAGGED | {"description": "motions that keep the closures, as coordinate rates"},
    "load": _object(
        {
            "kind": _text("dead, follower, conservative; potentials of an equilibrium"),
            "at": _or_null("array", "point at which it acts, in M"),
            "wrench": _or_null("array", "moment, force about M's origin"),
            "given": {"type": "boolean", "description": "or what the springs exert"},
            "meaning": _text("the kind, for people"),
        },
        "the load that the modes belong to",
    ),
    "weighed": _ANALYSIS["weighed"],
    "notes": _ANALYSIS["notes"],
}


def json_schema(command: str = "analyse") -> dict[str, Any]:
    """JSON Schema of what a command prints with ``--json``.

    Parameters
    ----------
    command : {"analyse", "equilibrium", "frames", "modes", "identify", "assemble", "workspace", \
"design", "analysis"}
        The command; "analysis" is the object that ``analyse`` adds under this key.

    Returns
    -------
    dict
        Draft 2020-12.
    """
    if command == "frames":
        return frames_schema()
    if command == "analysis":
        return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema_of_analysis()}
    if command == "modes":
        schema = _object(_MODES, "Output of cartstiff modes --json")
        more = {
            "unloaded": {"description": "the same without the load, where one is given"},
            "compare": {"description": "with --compare: frequencies of 6x6 matrices at the tip"},
            "sensitivities": {"description": "with --sensitivities: Hz per unit"},
            "intervals": {"description": "with --tolerance, or of measured springs"},
            "impedance": {"description": "with --impedance: a controller's gains and layouts"},
            "response": {"description": "with --response: curves as [real, imaginary]"},
            "lobes": {"description": "with --lobes: limiting depths by speed, by two theories"},
        }
        schema["properties"] = _MODES | more
        return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
    if command == "assemble":
        return assemble_schema(_ANALYSIS)
    if command == "workspace":
        return workspace_schema(_ANALYSIS)
    if command == "design":
        return design_schema(_ANALYSIS["notes"])
    if command == "identify":
        return identify_schema(_ANALYSIS["notes"], _ANALYSIS["mechanism"], _ANALYSIS["units"])
    properties = dict(_ANALYSIS)
    if command == "equilibrium":
        properties |= _EQUILIBRIUM
    schema = _object(properties, f"Output of cartstiff {command} --json")
    schema["properties"] = properties | {
        "analysis": schema_of_analysis() | {"description": "unless --analysis none"},
        "as_controller": {"description": "with --order, --axes: the matrices in these"},
    }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
