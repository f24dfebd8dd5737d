"""The form of the JSON output, as a JSON Schema: the reference page is made from it."""

from __future__ import annotations

from typing import Any

from cartstiff.analysis.sections import schema as schema_of_analysis
from cartstiff.choices import LOAD_KINDS, TENSIONS
from cartstiff.designs.run import DESIGN_SCHEMA
from cartstiff.identify.result import IDENTIFY_SCHEMA
from cartstiff.matrix_names import MATRICES
from cartstiff.reach.assembly import ASSEMBLE_SCHEMA
from cartstiff.reach.workspace import WORKSPACE_SCHEMA
from cartstiff.report import schema_words as js
from cartstiff.report.frames import FRAMES_SCHEMA
from cartstiff.stiffness.compute import SCHEMA
from cartstiff.vibration.modes import MODES_SCHEMA


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
            **{key: parts[key] for key in ("frame", "frame_offset", "base_pose")},
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
