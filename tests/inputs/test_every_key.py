"""Every key of the mechanism file acts: another value gives another result, or is refused.

The keys are those of the models in `cartstiff.loading.schema`; one without a case here fails.
"""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel
from tests.mechanisms.machines import joint, masses, write_file, write_urdf
from tests.mechanisms.test_superelement import beam_matrix
from tests.mechanisms.test_superelement_mass import beam_mass

import cartstiff
from cartstiff.errors import InputError
from cartstiff.loading import schema

#: Keys for people who read the file; their descriptions say so.
FOR_READERS = {"description", "source", "date", "rows"}
SUPER = {"K": "K.txt", "nodes": [[0, 0, 0], [0.2, 0, 0], [0.4, 0, 0]]}
K6 = np.diag([3e3, 4e3, 5e3, 2e5, 3e5, 4e5])
BEAM = {"E": 7e10, "G": 2.6e10, "length": 0.2, "area": 6e-4, "Iy": 4.5e-8, "Iz": 2e-8, "J": 5e-8}
HEX = [[np.cos(a), np.sin(a), 0] for a in np.deg2rad([0, 10, 120, 130, 240, 250])]
TOP = [[np.cos(a) / 2, np.sin(a) / 2, 0] for a in np.deg2rad([310, 60, 70, 180, 190, 300])]
PLATFORM = {
    "kind": "stewart-gough",
    "base": HEX,
    "platform": TOP,
    "pose": {"xyz": [0, 0, 0.8], "rpy": [0.05, 0.02, 0.1]},
    "legs": {"stiffness": 1e5, "rest_length": 0.9},
}
BODY = {"mass": 4.0, "com": [0, 0, 0.1]}
FLEXURE = {"axial": 1e6, "shear": 1e5, "bending": 30.0, "torsion": 50.0, "offset": 0.01}
STRUT = {"axial": 1e5, "lower": FLEXURE, "upper": FLEXURE | {"bending": 90.0}}
STRUTS = {"fixed": 0.3, "moving": 0.2, "fixed_com": 0.1, "moving_com": 0.2, "radius": 0.01}
SPRINGS = PLATFORM | {"kind": "springs", "legs": {"stiffness": 1e5, "rest_length": 1.1}}
POSTURE = dict(zip((f"j{i}" for i in range(1, 7)), (0.3, -1.1, 1.4, -0.7, 0.9, 0.2), strict=True))
ARM = {
    "kind": "serial",
    "model": "arm.urdf",
    "frame": "hand",
    "q": POSTURE,
    "springs": {f"j{i}": {"stiffness": 1e4 * i, "rest": 0.1 * i} for i in range(1, 7)},
}
ELASTIC = ARM | {"springs": {f"j{i}": {"stiffness": 1e4 * i} for i in range(1, 7)}}
FOUND = {
    "compliances": [{"name": "j1", "value": 1e-4}, {"name": "j2", "value": 5e-5}],
    "covariance": [[1e-12, 0.0], [0.0, 1e-12]],
}
MEASURED = ELASTIC | {"identified": FOUND}
BENT = ELASTIC | {
    "springs": ELASTIC["springs"] | {"j1": {"polynomial": [1e4, 0, 1e6]}},
    "identified": {
        "compliances": [{"name": "j1", "value": 1e-4, "polynomial": ["j1", 1]}],
        "covariance": [[1e-12]],
    },
}


def found(name: str, value: float) -> dict[str, Any]:
    """One compliance that was measured."""
    return {"compliances": [{"name": name, "value": value}], "covariance": [[1e-12]]}


BALL = {"xyz": [0.4, 0.1, 0.5], "rpy": [0, 0.1, 0]}
LEG = {
    "model": "arm.urdf",
    "frame": "hand",
    "springs": {f"j{i}": {"stiffness": 1e4 * i} for i in range(1, 7)},
    "q": POSTURE,
}
PAIR = {
    "kind": "parallel",
    "legs": [LEG, LEG | {"base": {"xyz": [0.1, 0, 0]}, "grip": {"xyz": [-0.05, 0, 0]}}],
    "pose": BALL,
}
FIVE_BAR = {
    "kind": "closed-chain",
    "model": "bars.urdf",
    "frame": "tip",
    "closures": [{"frames": ["tip", "right_tip"], "type": "point"}],
    "actuated": ["left", "right"],
    "q": {"left": 2.2, "left_elbow": -1.35, "right": 0.95, "right_elbow": 1.35},
    "springs": {"left": {"stiffness": 800}, "right": {"stiffness": 700}},
}
LINE = {"frames": ["world", "hand"], "points": [[0, 0, 1], [0, 0, 0]], "stiffness": 1e4}
TAUT = {"lines": [LINE | {"rest_length": 0.4}]}

RING = {"radius": 1.0, "half_angle": 0.1}
PAIRS = {"base": RING, "platform": {"radius": 0.6, "half_angle": 0.2}, "height": 0.8}
LAID = {"kind": "stewart-gough", "layout": PAIRS, "legs": {"stiffness": 1e5, "rest_length": 0.9}}
THIRDS = {
    "base": {"radius": 1.0, "angles": [-0.1, 0.1]},
    "platform": {"radius": 0.6, "angles": [-0.9, 0.9]},
    "height": 0.8,
    "symmetry": 3,
}
CUBE = {"cubic": {"edge": 1.0, "centre": 0.3}, "base": {"height": 0.0}}
RINGS = {
    "base": {"radius": 0.3, "half_angle": 0.25},
    "platform": {"radius": 0.12, "half_angle": 0.8},
}
RODS = {"chain": "PUS", **RINGS, "rod": 0.6, "stiffness": 1e6}
NAMED = {"kind": "parallel", "legs": RODS, "pose": {"xyz": [0, 0, 0.5]}}
CRANKS = NAMED | {"legs": RODS | {"chain": "RUS", "crank": 0.1, "axis": "radial"}}
TRIPOD = {"chain": "UPS", "base": {"radius": 0.3}, "platform": {"radius": 0.1}, "stiffness": 1e6}

KINDS = {
    "SerialFile": ARM,
    "PlatformFile": PLATFORM,
    "SpringsFile": SPRINGS,
    "ParallelFile": PAIR,
    "ClosedChainFile": FIVE_BAR,
}

# Model.key: (file, path of the key in it, another value, further keys of both files).
CASES: dict[str, tuple[dict[str, Any], tuple[Any, ...], Any, dict[str, Any]]] = {
    "FoundModel.name": (MEASURED, ("identified", "compliances", 0, "name"), "j9", {}),
    "FoundModel.value": (MEASURED, ("identified", "compliances", 0, "value"), 2e-4, {}),
    "FoundModel.elements": (
        MEASURED,
        ("identified", "compliances", 0, "elements"),
        [["j1", "j1", 2.0]],
        {},
    ),
    "FoundModel.polynomial": (BENT, ("identified", "compliances", 0, "polynomial"), ["j1", 3], {}),
    "IdentifiedModel.compliances": (
        MEASURED,
        ("identified", "compliances"),
        FOUND["compliances"][:1],
        {},
    ),
    "IdentifiedModel.covariance": (
        MEASURED,
        ("identified", "covariance"),
        [[2e-12, 0.0], [0.0, 1e-12]],
        {},
    ),
    "IdentifiedModel.degrees": (MEASURED, ("identified", "degrees"), 7.0, {}),
    "IdentifiedModel.level": (MEASURED, ("identified", "level"), 0.9, {}),
    "IdentifiedModel.undetermined": (MEASURED, ("identified", "undetermined"), ["j3"], {}),
    "IdentifiedModel.at_least": (MEASURED, ("identified", "at_least"), {"j1": 5e3}, {}),
    "SerialFile.identified": (ELASTIC, ("identified",), FOUND, {}),
    "PlatformFile.identified": (PLATFORM, ("identified",), found("leg1", 1e-5), {}),
    "SpringsFile.identified": (SPRINGS, ("identified",), found("leg2", 1e-5), {}),
    "ParallelFile.identified": (PAIR, ("identified",), found("leg1/j1", 1e-4), {}),
    "ClosedChainFile.identified": (FIVE_BAR, ("identified",), found("left_motor", 1.0), {}),
    "PoseModel.xyz": (PLATFORM, ("pose", "xyz"), [0, 0.1, 0.8], {}),
    "PoseModel.rpy": (PLATFORM, ("pose", "rpy"), [0, 0, 0], {}),
    "UnitsModel.length": (PLATFORM, ("units", "length"), "mm", {}),
    "UnitsModel.force": (PLATFORM, ("units", "force"), "kN", {}),
    "PayloadModel.mass": (ARM, ("payload", "mass"), 4, {"gravity": [0, 0, -9.81]}),
    "PayloadModel.com": (
        ARM,
        ("payload", "com"),
        [0, 0.1, 0],
        {"gravity": [0, 0, -9.81], "payload": {"mass": 4}},
    ),
    "JointSpringModel.stiffness": (ARM, ("springs", "j2", "stiffness"), 3e4, {}),
    "JointSpringModel.rest": (ARM, ("springs", "j2", "rest"), 0.3, {}),
    "JointSpringModel.damping": (ARM, ("springs", "j2", "damping"), 5.0, {}),
    "BeamModel.density": (
        ELASTIC,
        ("flexible", "upper", "beam", "density"),
        2700.0,
        {"flexible": {"upper": {"beam": BEAM}}},
    ),
    "JointSpringModel.polynomial": (ARM, ("springs", "j2"), {"polynomial": [2e4, 0, 1e5]}, {}),
    "JointSpringModel.table": (
        ARM,
        ("springs", "j2"),
        {"table": [[-4, -5e4], [0, 0], [4, 5e4]], "rest": 0.2},
        {},
    ),
    "FlexibleModel.stiffness": (
        ELASTIC,
        ("flexible", "upper", "stiffness"),
        (2 * K6).tolist(),
        {"flexible": {"upper": {"stiffness": K6.tolist()}}},
    ),
    "FlexibleModel.beam": (ELASTIC, ("flexible",), {"upper": {"beam": BEAM}}, {}),
    "FlexibleModel.superelement": (ELASTIC, ("flexible",), {"upper": {"superelement": SUPER}}, {}),
    **{
        f"SuperelementModel.{key}": (
            ELASTIC,
            ("flexible", "upper", "superelement", key),
            value,
            {"flexible": {"upper": {"superelement": SUPER}}},
        )
        for key, value in {
            "K": "other.txt",
            "M": "mass.txt",
            "base": 1,
            "tip": 1,
            "nodes": [[0, 0, 0], [0.2, 0, 0], [0.5, 0, 0]],
            "order": "angular-linear",
        }.items()
    },
    "FlexibleModel.offset": (
        ELASTIC,
        ("flexible", "upper", "offset"),
        {"xyz": [0.1, 0, 0]},
        {"flexible": {"upper": {"stiffness": K6.tolist()}}},
    ),
    **{
        f"BeamModel.{key}": (
            ELASTIC,
            ("flexible", "upper", "beam", key),
            2 * value,
            {"flexible": {"upper": {"beam": BEAM}}},
        )
        for key, value in (BEAM | {"segments": 1}).items()
    },
    **{
        f"BeamModel.shear_area_{axis}": (
            ELASTIC,
            ("flexible", "upper", "beam", f"shear_area_{axis}"),
            5e-4,
            {"flexible": {"upper": {"beam": BEAM}}},
        )
        for axis in "yz"
    },
    "LinesLegs.stiffness": (PLATFORM, ("legs", "stiffness"), [1e5, 2e5, 1e5, 1e5, 1e5, 1e5], {}),
    "LinesLegs.rest_length": (PLATFORM, ("legs", "rest_length"), 0.8, {}),
    "LinesLegs.preload": (PLATFORM, ("legs",), {"stiffness": 1e5, "preload": 300}, {}),
    "LinesLegs.damping": (PLATFORM, ("legs", "damping"), 3.0, {}),
    "LinesLegs.mass": (PLATFORM, ("legs", "mass"), STRUTS, {}),
    **{
        f"LegMassModel.{key}": (
            PLATFORM,
            ("legs", "mass", key),
            2 * value,
            {"legs": PLATFORM["legs"] | {"mass": STRUTS}},
        )
        for key, value in STRUTS.items()
    },
    **{
        f"BodyModel.{key}": (PLATFORM, ("body", key), value, {"body": BODY})
        for key, value in (
            ("mass", 9.0),
            ("com", [0, 0.1, 0]),
            ("inertia", [[0.2, 0, 0], [0, 0.3, 0], [0, 0, 0.4]]),
        )
    },
    **{
        f"LinesLegs.{key}": (PLATFORM, ("legs", key), value, {})
        for key, value in (
            ("base_joints", {"axis": [0, 0, 1], "angle": 0.1}),
            ("platform_joints", {"axis": [0, 0, -1], "angle": 0.1}),
            ("diameter", 0.5),
            ("force", [0.0, 0.1]),
        )
    },
    **{
        f"LegJointsModel.{key}": (
            PLATFORM,
            ("legs", "base_joints", key),
            value,
            {"legs": PLATFORM["legs"] | {"base_joints": {"axis": [0, 0, 1], "angle": 0.1}}},
        )
        for key, value in (("axis", [0, 1, 1]), ("angle", 0.2))
    },
    "LinesLegs.strut": (PLATFORM, ("legs",), {"strut": STRUT}, {}),
    **{
        f"StrutModel.{key}": (PLATFORM, ("legs", "strut", key), value, {"legs": {"strut": STRUT}})
        for key, value in (
            ("axial", 2e5),
            ("lower", STRUT["upper"]),
            ("upper", STRUT["lower"]),
            ("mass", STRUTS),
        )
    },
    **{
        f"FlexureModel.{key}": (
            PLATFORM,
            ("legs", "strut", "lower", key),
            1.5 * value,
            {"legs": {"strut": STRUT}},
        )
        for key, value in FLEXURE.items()
    },
    "LinesLegs.limits": (PLATFORM, ("legs", "limits"), [[0.1, 0.2]] * 6, {}),
    "LineModel.frames": (ARM, ("lines", 0, "frames"), ["world", "fore"], TAUT),
    "LineModel.points": (ARM, ("lines", 0, "points"), [[0, 0, 2], [0, 0, 0]], TAUT),
    "LineModel.stiffness": (ARM, ("lines", 0, "stiffness"), 2e4, TAUT),
    "LineModel.rest_length": (ARM, ("lines", 0, "rest_length"), 0.5, TAUT),
    "LineModel.preload": (ARM, ("lines",), [LINE | {"preload": 200}], {"lines": [LINE]}),
    "LineModel.unilateral": (
        ARM,
        ("lines", 0, "unilateral"),
        True,
        {"lines": [LINE | {"rest_length": 9}]},
    ),
    "LegModel.kind": (PAIR, ("legs", 0, "kind"), "parallel", {}),
    "LegModel.model": (PAIR, ("legs", 0, "model"), "other.urdf", {}),
    "LegModel.frame": (PAIR, ("legs", 0, "frame"), "fore", {}),
    "LegModel.base": (PAIR, ("legs", 0, "base"), {"xyz": [0, 0, 0.1]}, {}),
    "LegModel.grip": (PAIR, ("legs", 0, "grip"), {"xyz": [0, 0, 0.1]}, {}),
    "LegModel.contact": (PAIR, ("legs", 0, "contact"), "point", {}),
    "LegModel.passive": (
        PAIR,
        ("legs", 0),
        LEG | {"springs": {"j1": {"stiffness": 1e4}}, "passive": ["j2", "j3", "j4", "j5", "j6"]},
        {},
    ),
    "LegModel.locked": (PAIR, ("legs", 0, "locked"), {"j3": 1.0}, {}),
    "LegModel.q": (PAIR | {"pose": None, "legs": [LEG]}, ("legs", 0, "q", "j3"), 1.0, {}),
    "LegModel.springs": (PAIR, ("legs", 0, "springs", "j3", "stiffness"), 1e3, {}),
    "LegModel.flexible": (PAIR, ("legs", 0, "flexible"), {"upper": {"beam": BEAM}}, {}),
    "ClosureModel.frames": (FIVE_BAR, ("closures", 0, "frames"), ["tip", "right_bar"], {}),
    "ClosureModel.type": (FIVE_BAR, ("closures", 0, "type"), "weld", {}),
    "ClosureModel.points": (
        FIVE_BAR,
        ("closures", 0, "points"),
        [[0.02, 0, 0], [0, 0.01, 0]],
        {},
    ),
    **{f"{name}.name": (file, ("name",), "another", {}) for name, file in KINDS.items()},
    **{
        f"{name}.kind": (file, ("kind",), other, {})
        for name, file, other in (
            ("SerialFile", ARM, "closed-chain"),
            ("PlatformFile", PLATFORM, "springs"),
            ("SpringsFile", SPRINGS, "stewart-gough"),
            ("ParallelFile", PAIR, "serial"),
            ("ClosedChainFile", FIVE_BAR, "serial"),
        )
    },
    **{
        f"{name}.gravity": (file, ("gravity",), [0, 0.1, -9.81], {"payload": {"mass": 3}})
        for name, file in KINDS.items()
    },
    **{
        f"{name}.payload": (file, ("payload",), {"mass": 5}, {"gravity": [0.5, -3, -9.81]})
        for name, file in KINDS.items()
    },
    **{
        f"{name}.{key}": (file, (key,), value, {})
        for name, file in (("PlatformFile", PLATFORM), ("SpringsFile", SPRINGS))
        for key, value in {
            "units": {"length": "cm"},
            "base": [[1.1 * x for x in p] for p in HEX],
            "platform": [[1.1 * x for x in p] for p in TOP],
            "pose": {"xyz": [0, 0, 0.7]},
            "frame": {"xyz": [0, 0, 0.1]},
            "legs": {"stiffness": 2e5},
            "body": BODY,
            "flexible": {"platform": {"stiffness": K6.tolist()}},
        }.items()
    },
    **{
        f"{name}.parameters": (
            file,
            ("parameters", "m"),
            5.0,
            {"gravity": [0.5, -3, -9.81], "payload": {"mass": "=m"}, "parameters": {"m": 2.0}},
        )
        for name, file in KINDS.items()
    },
    "PlatformFile.layout": (LAID, ("layout",), THIRDS, {}),
    "LayoutModel.base": (LAID, ("layout", "base"), {"radius": 1.0}, {}),
    "LayoutModel.platform": (LAID, ("layout", "platform"), {"radius": 0.6}, {}),
    "LayoutModel.height": (LAID, ("layout", "height"), 0.9, {}),
    "LayoutModel.turn": (LAID, ("layout", "turn"), 0.8, {}),
    "LayoutModel.symmetry": (
        LAID,
        ("layout",),
        {**THIRDS, "symmetry": 6, "base": RING, "platform": {"radius": 0.6, "angles": [0.4]}},
        {"layout": THIRDS},
    ),
    "LayoutModel.cubic": (LAID, ("layout",), CUBE, {}),
    "RingModel.radius": (LAID, ("layout", "base", "radius"), 1.1, {}),
    "RingModel.half_angle": (LAID, ("layout", "base", "half_angle"), 0.3, {}),
    "RingModel.angles": (LAID, ("layout", "base", "angles"), [-0.1, 0.2], {"layout": THIRDS}),
    "RingModel.height": (LAID, ("layout", "platform", "height"), 0.1, {}),
    "CubicModel.edge": (LAID, ("layout", "cubic", "edge"), 1.2, {"layout": CUBE}),
    "CubicModel.size": (LAID, ("layout", "cubic"), {"size": 1.0}, {"layout": CUBE}),
    "CubicModel.centre": (LAID, ("layout", "cubic", "centre"), [0, 0, 0.4], {"layout": CUBE}),
    "SpringsFile.unilateral": (SPRINGS, ("unilateral",), True, {}),
    "SerialFile.model": (ARM, ("model",), "other.urdf", {}),
    "SerialFile.frame": (ARM, ("frame",), "fore", {}),
    "SerialFile.base": (ARM, ("base",), {"xyz": [0, 0, 1], "rpy": [0, 3.1, 0]}, {}),
    "SerialFile.offset": (ARM, ("offset",), {"xyz": [0, 0, 0.1]}, {}),
    "SerialFile.locked": (ARM, ("locked",), {"j6": 0.4}, {"springs": {}, "q": {}}),
    "SerialFile.q": (ARM, ("q", "j3"), 1.0, {}),
    "SerialFile.springs": (ARM, ("springs",), {}, {}),
    "SerialFile.passive": (ARM, ("passive",), ["j6"], {"springs": {}}),
    "SerialFile.flexible": (ELASTIC, ("flexible",), {"upper": {"beam": BEAM}}, {}),
    "SerialFile.lines": (ARM, ("lines",), [LINE], {}),
    "ParallelFile.legs": (PAIR, ("legs",), [LEG], {}),
    "ParallelFile.offset": (PAIR, ("offset",), {"xyz": [0, 0, 0.1]}, {}),
    "ParallelFile.pose": (PAIR, ("pose",), {"xyz": [0.35, 0.1, 0.5]}, {}),
    "ParallelFile.actuated": (PAIR, ("actuated",), [f"leg1/j{i}" for i in range(1, 7)], {}),
    "ParallelFile.lines": (
        PAIR,
        ("lines",),
        [LINE | {"frames": ["world", "leg1/hand"], "rest_length": 0.4}],
        {},
    ),
    "ClosedChainFile.model": (FIVE_BAR, ("model",), "arm.urdf", {}),
    "ClosedChainFile.frame": (FIVE_BAR, ("frame",), "right_bar", {}),
    "ClosedChainFile.offset": (FIVE_BAR, ("offset",), {"xyz": [0, 0.1, 0]}, {}),
    "ClosedChainFile.closures": (FIVE_BAR, ("closures",), [], {}),
    "ClosedChainFile.floating": (FIVE_BAR, ("floating",), True, {}),
    "ClosedChainFile.actuated": (
        FIVE_BAR,
        ("actuated",),
        ["left_elbow", "right"],
        {},
    ),
    "ClosedChainFile.locked": (
        FIVE_BAR,
        ("locked",),
        {"left_elbow": -1.3},
        {"q": {}, "closures": []},
    ),
    "ClosedChainFile.q": (FIVE_BAR, ("q", "left"), 2.0, {}),
    "ClosedChainFile.springs": (FIVE_BAR, ("springs", "left", "stiffness"), 900, {}),
    "ClosedChainFile.passive": (
        FIVE_BAR,
        ("passive",),
        ["left"],
        {"springs": {}, "actuated": []},
    ),
    "ClosedChainFile.flexible": (FIVE_BAR, ("flexible",), {"left_bar": {"beam": BEAM}}, {}),
    "ClosedChainFile.lines": (
        FIVE_BAR,
        ("lines",),
        [LINE | {"frames": ["world", "tip"], "rest_length": 0.4}],
        {},
    ),
    **{
        f"NamedLegs.{key}": (NAMED, ("legs", key), value, {})
        for key, value in {
            "chain": "PSU",
            "base": {"radius": 0.31, "half_angle": 0.25},
            "platform": {"radius": 0.13, "half_angle": 0.8},
            "rail": [-0.2, 0.1, 1],
            "rod": 0.55,
            "mode": "plus",
            "actuated": ["u1"],
            "stiffness": [1e6, 1e6, 1e6, 1e6, 1e6, 2e6],
            "springs": {"u1": {"stiffness": 10.0}},
            "limits": [-0.1, 0.2],
            "turns": {"u1": [-0.1, 0.1]},
            "diameter": 0.5,
            "flexible": {"rod": {"stiffness": K6.tolist()}},
            "turn": 1.2,
        }.items()
    },
    "NamedLegs.axis": (CRANKS, ("legs", "axis"), "tangential", {}),
    "NamedLegs.crank": (CRANKS, ("legs", "crank"), [0.1, 0.1, 0.1, 0.1, 0.1, 0.12], {}),
    "NamedLegs.symmetry": (NAMED, ("legs",), TRIPOD | {"symmetry": 4}, {"legs": TRIPOD}),
    "LegEndsModel.radius": (NAMED, ("legs", "base", "radius"), 0.25, {}),
    "LegEndsModel.half_angle": (NAMED, ("legs", "base", "half_angle"), 0.3, {}),
    "LegEndsModel.angles": (
        NAMED,
        ("legs", "base"),
        {"radius": 0.3, "angles": [-0.25, 0.3]},
        {"legs": RODS | {"symmetry": 3}},
    ),
    "LegEndsModel.height": (NAMED, ("legs", "base", "height"), 0.1, {}),
    "LegEndsModel.points": (
        NAMED,
        ("legs", "platform"),
        {"points": [[0.1, -0.1, 0], [0.1, 0.1, 0.02]]},
        {"legs": RODS | {"symmetry": 3}},
    ),
    "SerialFile.xacro": (ARM, ("xacro",), {"kind": "long"}, {}),
    "SerialFile.package_path": (ARM, ("package_path",), ["none"], {}),
    "LegModel.xacro": (PAIR, ("legs", 0, "xacro"), {"kind": "long"}, {}),
    "LegModel.package_path": (PAIR, ("legs", 0, "package_path"), ["none"], {}),
    "ClosedChainFile.xacro": (FIVE_BAR, ("xacro",), {"kind": "long"}, {}),
    "ClosedChainFile.package_path": (FIVE_BAR, ("package_path",), ["none"], {}),
}


def keys() -> list[str]:
    """All keys of all models that stand in files, as Model.key."""
    models: list[type[BaseModel]] = [schema.FileModel]
    found = []
    while models:
        model = models.pop()
        models += model.__subclasses__()
        if not model.__name__.startswith("_") and not model.__subclasses__():
            found += [f"{model.__name__}.{key}" for key in model.model_fields]
    return sorted(set(found))


def write_robots(folder: Path) -> None:
    arm = [
        joint("j1", "base", "shoulder", at=(0, 0, 0.2), axis=(0, 0, 1)),
        joint("j2", "shoulder", "upper", axis=(0, 1, 0)),
        joint("j3", "upper", "fore", at=(0.4, 0, 0), axis=(0, 1, 0)),
        joint("j4", "fore", "w1", at=(0.35, 0, 0), axis=(0, 1, 0)),
        joint("j5", "w1", "w2", at=(0, 0.1, 0), axis=(0, 0, 1)),
        joint("j6", "w2", "hand", at=(0.1, 0, 0), axis=(1, 0, 0)),
    ]
    for name, mass in (("arm", 2.0), ("other", 2.0)):
        path = write_urdf(folder, *arm, name=name)
        text = masses(path.read_text(encoding="utf-8"), upper=mass, fore=mass)
        path.write_text(text.replace("0.35", "0.36") if name == "other" else text)
    bars = [
        joint("left", "base", "left_bar", at=(-0.1, 0, 0)),
        joint("left_elbow", "left_bar", "left_rod", at=(0.25, 0, 0)),
        joint("left_end", "left_rod", "tip", at=(0.3, 0, 0), kind="fixed"),
        joint("right", "base", "right_bar", at=(0.1, 0, 0)),
        joint("right_elbow", "right_bar", "right_rod", at=(0.25, 0, 0)),
        joint("right_end", "right_rod", "right_tip", at=(0.3, 0, 0), kind="fixed"),
    ]
    for name, factor in (("K", 1.0), ("other", 2.0)):
        np.savetxt(folder / f"{name}.txt", factor * beam_matrix([0, 0.2, 0.4]))
    np.savetxt(folder / "mass.txt", beam_mass([0, 0.2, 0.4]))
    path = write_urdf(folder, *bars, name="bars")
    path.write_text(masses(path.read_text(encoding="utf-8"), left_rod=1, right_rod=1.5))


def answer(folder: Path, content: dict[str, Any]) -> str:
    """Everything that comes out, or the refusal."""
    content = {key: value for key, value in content.items() if value is not None}
    try:
        name = content.pop("name", None)
        file = write_file(folder, "file", **content)
        if name is not None:
            file.write_text(f"name: {name}\n{file.read_text(encoding='utf-8')}")
        elastic = cartstiff.load(file)
        result = cartstiff.analyse(elastic).as_dict()
    except InputError as error:
        return f"refused: {error}"
    limits = [(c.lower, c.upper) for c in elastic.mechanism.coordinates]
    lengths = getattr(elastic.mechanism, "limits", None)
    own = [limits, None if lengths is None else np.array(lengths).tolist()]
    own += [None if elastic.identified is None else elastic.identified.as_dict()]
    own += [None if elastic.damping is None else elastic.damping.tolist(), vibrating(elastic)]
    return json.dumps([result, own, np.array(elastic.springs.stiffness).tolist()], default=str)


def vibrating(elastic: cartstiff.ElasticMechanism) -> object:
    """Modes, or why there are none: what masses act on without gravity."""
    try:
        return cartstiff.modes(elastic).as_dict()
    except cartstiff.UndefinedError as error:
        return str(error)


def changed(content: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    content = copy.deepcopy(content)
    place: Any = content
    for step in path[:-1]:
        place = place.setdefault(step, {}) if isinstance(place, dict) else place[step]
    place[path[-1]] = value
    return content


@pytest.mark.parametrize("key", keys())
def test_every_key_acts(key: str, tmp_path: Path) -> None:
    model, _, name = key.partition(".")
    if name in FOR_READERS:
        field = getattr(schema, model).model_fields[name]
        assert "for readers" in str(field.description)
        return
    file, path, value, more = CASES[key]
    write_robots(tmp_path)
    before = file | more
    was = answer(tmp_path, before)
    if key != "PayloadModel.mass":  # a payload without a mass is refused
        assert not was.startswith("refused"), was
    now = answer(tmp_path, changed(before, path, value))
    assert now != was
    if now.startswith("refused") and name != "kind":
        assert "unknown key" not in now


def test_no_case_is_left_over() -> None:
    assert set(CASES) <= set(keys())


def test_base_of_a_serial_arm(tmp_path: Path) -> None:
    """An arm on the ceiling: as on the floor, seen in turned axes, under turned gravity."""
    write_robots(tmp_path)
    g = np.array([0.3, -0.2, -9.81])
    T = np.diag([1.0, -1.0, -1.0, 1.0])  # half a turn about x
    T[:3, 3] = 0.5, 0.4, 2.0
    base = {"xyz": T[:3, 3].tolist(), "rpy": [np.pi, 0, 0]}
    hanging = cartstiff.load(write_file(tmp_path, **ARM, base=base, gravity=g.tolist()))
    turned = (T[:3, :3] @ g).tolist()
    standing = cartstiff.load(write_file(tmp_path, **ARM, gravity=turned))
    for q in (hanging.q, hanging.q + 0.1):
        a, b = cartstiff.analyse(hanging, q), cartstiff.analyse(standing, q)
        assert np.abs(a.pose - T @ b.pose).max() < 1e-12
        assert np.abs(a.B.matrix - b.B.matrix).max() < 1e-9 * np.abs(b.B.matrix).max()
        assert np.abs(a.wrench - b.wrench).max() < 1e-9 * np.abs(b.wrench).max()
    world, _ = hanging.mechanism.at(hanging.q).relative("world", "base")
    assert np.abs(world - T).max() < 1e-12
