"""The form of the JSON output, as a JSON Schema: the reference page is made from it."""

from __future__ import annotations

from typing import Any

from cartstiff.analysis.plain import schema as schema_of_analysis
from cartstiff.choices import LOAD_KINDS
from cartstiff.matrix_names import MATRICES
from cartstiff.report.frames import FRAMES_SCHEMA
from cartstiff.report.schemas import words as js
from cartstiff.report.schemas.designs import design_schema
from cartstiff.report.schemas.identification import identify_schema
from cartstiff.report.schemas.reach import assemble_schema, workspace_schema
from cartstiff.stiffness.compute import SCHEMA
from cartstiff.vibration.mode_set import MODES_SCHEMA

_ABSENT = "where it does not exist"


def _matrices(what: str) -> dict[str, Any]:
    named = {n: js.matrix(6, 6, f"6x6, {MATRICES[n].name} connection", _ABSENT) for n in "ABKF"}
    return js.object_with(named, what)


def _values(what: str) -> dict[str, Any]:
    return {"type": "object", "description": what}


_ANALYSIS: dict[str, Any] = {
    "schema": js.form(SCHEMA),
    "mechanism": js.object_with(
        {
            "name": js.text("for people"),
            "kind": js.text("as in mechanism files"),
            "joints": js.strings("names of the coordinates, in their order"),
        },
        "what was analysed",
    ),
    "frame": js.text("name of the link's frame that M sits in"),
    "frame_offset": js.matrix(4, 4, "4x4, M in that frame"),
    "base_pose": js.matrix(4, 4, "4x4, the robot's own base frame in F"),
    "order": {"const": "angular-linear", "description": "rotation before translation"},
    "units": js.object_with(
        {
            "length": js.text("unit of lengths"),
            "force": js.text("unit of forces"),
            "angle": {"const": "rad", "description": "unit of angles"},
        },
        "units of every number",
    ),
    "q": js.numbers(
        "coordinates; for a platform x, y, z, roll, pitch, yaw. Those of a closed chain are "
        "after assembly"
    ),
    "pose": js.matrix(4, 4, "4x4, M in F"),
    "jacobian": js.matrix(
        6,
        None,
        "6xn body Jacobian of the coordinates; for a platform 6x6, pose by leg lengths",
        "if there is none",
    ),
    "wrench": js.numbers(
        "W: moment, force on the body, in M; null in an unbalanced posture", 6, null=True
    ),
    "load": js.object_with(
        {
            "kind": js.one_of(*LOAD_KINDS)
            | {"description": "what the load is taken to do while the body moves"},
            "at": js.numbers("point at which it acts, in M", 3),
            "meaning": js.text("the kind, for people"),
            "stiffness": js.matrix(6, 6, "6x6, K^load: the tangent under the load, in M", _ABSENT),
            "compliance": js.matrix(6, 6, "its inverse", _ABSENT),
        },
        "the load's behaviour and the tangent stiffness that follows from it",
    ),
    "gravity": js.numbers("acceleration in F; null without gravity", null=True),
    "weighed": js.list_of(
        js.object_with({"name": js.text("link"), "mass": js.number("kg")}),
        "what gravity acts on: links that joints carry (by the first of each), the "
        "payload, and payloads among the loads, which have a weight of their own",
    ),
    "energy": js.number(
        "potential energy of springs, gravity and loads; null if a load has none", null=True
    ),
    "stored_energy": js.number("of that, what springs and other elastic parts hold", null=True),
    "stiffness": _matrices("stiffness matrices"),
    "compliance": _matrices("their inverses"),
    "notes": js.list_of(
        js.object_with(
            {
                "code": js.text("for programs"),
                "message": js.text("for people"),
                "values": _values("the numbers that show it"),
            }
        ),
        "what was assumed, and why something does not exist",
    ),
}

_EQUILIBRIUM: dict[str, Any] = {
    "residual": js.number(
        "largest unbalanced force over the forces on the same motion; 0: rounding"
    ),
    "stable": js.flag(
        "verdict on the equilibrium; null where definiteness decides nothing", null=True
    ),
    "iterations": js.integer("steps taken"),
    "history": js.numbers("the residual before each step"),
    "eigenvalues": js.list_of(
        {"anyOf": [js.number(), js.numbers(size=2)]},
        "what the verdict rests on: of the energy's Hessian, or omega^2 [rad^2/s^2] where a load "
        "has no potential (none without masses); pairs of real and imaginary part where complex",
    ),
    "displacement": js.numbers("rotation vector and translation of the body frame, axes of F", 6),
    "displacement_uncertainty": {
        "anyOf": [
            {"type": "null"},
            js.object_with(
                {key: js.numbers(size=6) for key in ("sd", "lower", "upper")}
                | {"level": js.number()}
            ),
        ],
        "description": "of the displacement, from springs that were measured; else null",
    },
    "elastic_wrench": js.numbers(
        "the wrench that springs and structure balance, in M; where the structure's "
        "part is not known, that of least length-scaled norm",
        6,
        null=True,
    ),
    "reactions": js.object_with(
        {
            "held": _values("by held component"),
            "wrench": js.numbers("the same as a wrench; null if nothing is held", 6, null=True),
            "limits": _values("by joint or leg on a limit"),
            "closures": js.numbers("forces of the closures"),
            "rigid": _values("torque of each rigid joint"),
        },
        "what holds the mechanism",
    ),
}


def _or_nothing(description: str) -> dict[str, Any]:
    return {"type": ["array", "null"], "description": description}


# Where M and the robot's base sit.
_PLACED = ("frame", "frame_offset", "base_pose")
_FRAMES: dict[str, Any] = {
    "schema": js.form(FRAMES_SCHEMA),
    "mechanism": js.object_with(
        {"name": js.text("for people"), "kind": js.text("as in mechanism files")}
    ),
    **{key: _ANALYSIS[key] for key in _PLACED},
    "units": _ANALYSIS["units"],
    "frames": js.strings("frames fixed to F"),
    "joints": js.list_of(
        js.object_with(
            {
                "name": js.text("of the joint"),
                "parent": js.text("joint that carries it; null: F", null=True),
                "type": js.one_of("revolute", "prismatic", "helical", "free"),
                "lower": js.number("limit; null if there is none", null=True),
                "upper": js.number("limit; null if there is none", null=True),
                "q": js.number("default posture", null=True),
                "spring": {
                    "anyOf": [
                        {"type": "null"},
                        js.object_with(
                            {
                                "stiffness": js.number("null: rigid, or a law", null=True),
                                "rest": js.number("null: balanced at the posture", null=True),
                                "law": js.flag(),
                                "rigid": js.flag(),
                            }
                        ),
                    ],
                    "description": "null: passive, or a joint of a link that gives",
                },
                "follows": js.text("coordinate that it mimics", null=True),
                "actuated": js.flag("null where the file does not say", null=True),
                "virtual": js.flag("of a link that gives"),
                "mass": js.number("[kg] of what is fixed to it"),
                "frames": js.strings("frames fixed to it, for --frame"),
                "carries_body": js.flag("whether M is fixed to it"),
            }
        ),
        "in the order of the tree; joints that do not move the frame are links",
    ),
    "closures": js.list_of(
        js.object_with({"frames": js.strings(), "type": js.one_of("point", "weld")})
    ),
    "legs": js.list_of(
        js.object_with(
            {
                "name": js.text("of the leg"),
                "frames": js.strings("in which its ends are given"),
                "from": js.numbers(),
                "to": js.numbers(),
                "stiffness": js.number(),
                "rest": js.number("rest length; null: balanced at the posture", null=True),
                "shortest": js.number("limit", null=True),
                "longest": js.number("limit; null if there is none", null=True),
            }
        ),
        "lines of a platform",
    ),
    "payload": js.number("[kg]", null=True),
    "gravity": _or_nothing("m/s^2, in F"),
    "pose": js.matrix(4, 4, "T_F_M at the posture"),
    "notes": _ANALYSIS["notes"],
}


def _rows(description: str) -> dict[str, Any]:
    return js.list_of({"type": "array"}, description)


_MODES: dict[str, Any] = {
    "schema": js.form(MODES_SCHEMA),
    **{key: _ANALYSIS[key] for key in ("mechanism", *_PLACED, "order", "units", "q")},
    "frequencies": js.list_of(
        js.number(null=True), "Hz, with the load; 0 of a free motion, null where a motion grows"
    ),
    "eigenvalues": {
        "type": "array",
        "description": "omega^2 in 1/s^2; [real, imaginary] where motions flutter",
    },
    "modes": _rows("coordinate rates, phi^T M phi = 1; of a platform twists"),
    "twists": _rows("body twist (angular, linear) of M for each mode"),
    "nodal_axes": js.list_of(
        js.object_with(
            {
                "direction": _or_nothing("null: M does not move"),
                "point": _or_nothing("null: a translation along the direction"),
                "pitch": js.number("length per radian; null: a translation", null=True),
            }
        ),
        "screw of each twist, in M",
    ),
    "repeated": _rows("numbers (from 1) of modes with one frequency"),
    "participation": _rows("share of each coordinate in the kinetic energy of each mode"),
    "effective_masses": _or_nothing("kg along x, y, z of F that each mode moves"),
    "moving_mass": js.number("kg, of all that moves", null=True),
    "mass_matrix": _rows("kg and the unit of length, on all coordinates"),
    "stiffness_matrix": _rows("second derivative of all energies on the basis"),
    "basis": _rows("motions that keep the closures, as coordinate rates"),
    "load": js.object_with(
        {
            "kind": js.text("dead, follower, conservative; potentials of an equilibrium"),
            "at": _or_nothing("point at which it acts, in M"),
            "wrench": _or_nothing("moment, force about M's origin"),
            "given": js.flag("or what the springs exert"),
            "meaning": js.text("the kind, for people"),
        },
        "the load that the modes belong to",
    ),
    "weighed": _ANALYSIS["weighed"],
    "notes": _ANALYSIS["notes"],
}
_BY_PARAMETERS = {
    "description": "with --sensitivities: of each parameter its value, and per unit of it the "
    "change of the stiffness matrices, of the pose (rotation vector and place along the axes of F) "
    "and of the frequencies [Hz], and the share by which they may be off"
}
_ACCURACY = {
    "description": "with --tolerance (modes, equilibrium): standard deviations of pose, stiffness "
    "and frequencies, with the main contributors to each variance"
}
_MODES_ON_REQUEST: dict[str, Any] = {
    "unloaded": {"description": "the same without the load, where one is given"},
    "compare": {"description": "with --compare: frequencies of 6x6 matrices at the tip"},
    "sensitivities": _BY_PARAMETERS,
    "accuracy": _ACCURACY,
    "intervals": {"description": "with --tolerance, or of measured springs"},
    "impedance": {"description": "with --impedance: a controller's gains"},
    "response": {"description": "with --response: curves as [real, imaginary]"},
    "lobes": {"description": "with --lobes: limiting depths by speed"},
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
    match command:
        case "frames":
            return js.document(_FRAMES, command)
        case "modes":
            return js.document(_MODES, command, _MODES_ON_REQUEST)
        case "assemble":
            return assemble_schema(_ANALYSIS)
        case "workspace":
            return workspace_schema(_ANALYSIS)
        case "design":
            return design_schema(_ANALYSIS)
        case "identify":
            frames = {key: _ANALYSIS[key] for key in _PLACED}
            return identify_schema(
                _ANALYSIS["notes"], _ANALYSIS["mechanism"], _ANALYSIS["units"], frames
            )
        case "analysis":
            draft = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
            return draft | schema_of_analysis()
    optional = {
        "analysis": schema_of_analysis() | {"description": "unless --analysis none"},
        "as_controller": {"description": "with --order, --axes: the matrices in these"},
        "sensitivities": _BY_PARAMETERS,
        "accuracy": _ACCURACY,
        "explained": {"description": "with --profile: what computed it, how long, what limits"},
    }
    more = _EQUILIBRIUM if command == "equilibrium" else {}
    return js.document(_ANALYSIS | more, command, optional)
