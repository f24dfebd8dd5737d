"""Cable robots of CASPR that are chains: bodies on joints, straight cables between any two of them.

Joints carry nothing unless the file calls them actuated; cables hold them. The tensions at the pose
of the file are those with the least sum that balance there, within the file's limits.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import linprog

from cartstiff.errors import InputError, UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.loading.build import serial_of, with_overrides
from cartstiff.loading.caspr.parts import Cable, body_of, numbers
from cartstiff.loading.keys.springs import LineModel
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.loading.schema import SerialFile
from cartstiff.loading.springs import extra_lines
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notes import Note
from cartstiff.potentials.line_springs import LineSprings, line_geometry
from cartstiff.potentials.springs import JointSprings

# Joints one after another that make CASPR's, in the order of its coordinates ("k": an axis named).
_EULER, _FREE = ("RX", "RY", "RZ"), ("PX", "PY", "PZ")
_JOINTS: dict[str, tuple[str, ...]] = {
    "R_AXIS": ("Rk",),
    "P_AXIS": ("Pk",),
    "S_EULER_XYZ": _EULER,
    "SPATIAL_EULER_XYZ": (*_FREE, *_EULER),
    "P_XYZ": _FREE,
    "PLANAR_XY": ("PX", "PY", "RZ"),
    "PLANAR_YZ": ("PY", "PZ", "RX"),
    "PLANAR_XZ": ("PX", "PZ", "RY"),
    **{f"{kind}_{axis}": (f"{kind}{axis}",) for kind in "RP" for axis in "XYZ"},
    **{
        f"{name}_{a}{b}": (f"{kind}{a}", f"{kind}{b}")
        for name, kind in (("U", "R"), ("P", "P"))
        for a, b in ("XY", "XZ", "YZ")
    },
}
# Coordinates of S_FIXED_XYZ turn about fixed axes: the last of them stands first in the chain.
_FIXED = ("S_FIXED_XYZ", tuple(reversed(_EULER)))


def read_chain(
    links: Sequence[ET.Element],
    cables: Sequence[Cable],
    overrides: dict[str, Any],
    where: str,
    name: str,
    notes: list[Note],
) -> ElasticMechanism:
    """The elastic mechanism of bodies on joints, and cables between them."""
    model, posture, driven = _model(links, where)
    bodies = {"0": "world"} | {str(i + 1): _name(link, i) for i, link in enumerate(links)}
    lines = [_line(cable, bodies) for cable in cables]
    passive = [n for n in list(model.names)[1:] if n not in driven]
    frame = f"{bodies[str(len(links))]} end"
    notes.append(Note("default-frame", f"the end of the last body is taken: {frame!r}"))
    file = with_overrides(
        SerialFile.model_construct(kind="serial", model=name, frame=frame, lines=lines),
        overrides,
        where,
    )
    description = RobotDescription(None, model, pieces=())
    bare = serial_of(
        description, file.model_copy(update={"passive": passive}), where, name, posture, notes
    )
    springs = [p for p in bare.potentials if isinstance(p, LineSprings)]
    outside = tuple(p for p in bare.potentials if not isinstance(p, LineSprings))
    try:
        along, lengths = _lengths(bare, springs)
    except UndefinedError as error:
        raise InputError(str(error), where=where) from None
    products = [c.product for c in cables]
    if any(product is not None for product in products):
        words = "the stiffness of cables that are springs is that at the length of the file's pose"
        notes.append(Note("stiffness-at-pose", words))
    tensions = _tensions(replace(bare, potentials=outside), cables, along, lengths)
    if tensions is None:
        words = "no tensions within the file's limits balance at its pose: cables are without any"
        notes.append(Note("cables-not-balanced", words))
        tensions = np.zeros(len(cables))
    pulled = {c.name: round(float(t), 12) for c, t in zip(cables, tensions, strict=True) if t}
    if pulled:
        words = "cables are tensioned so that they balance at the file's pose, with the least sum"
        notes.append(Note("tensions-assumed", words, {"tensions": pulled}))
    taut = [
        line
        if line.rest_length is not None
        else line.model_copy(
            update={
                "preload": float(t),
                "stiffness": c.product / size if c.product else line.stiffness,
            }
        )
        for line, c, t, size in zip(lines, cables, tensions, lengths.tolist(), strict=True)
    ]
    read = tuple(n for n in bare.notes if n not in notes)
    held = replace(bare, potentials=outside, notes=(*notes, *read))
    return held.with_potential(*extra_lines(taut, held.mechanism, held.q))  # type: ignore[arg-type]


def _name(link: ET.Element, index: int) -> str:
    """Of a body, as people can write it in options."""
    return re.sub(r"[^\w.-]+", "_", (link.get("name") or "").strip()) or f"body_{index + 1}"


def _model(links: Sequence[ET.Element], where: str) -> tuple[pin.Model, dict[str, float], set[str]]:
    """Pinocchio's model, the file's posture, and the joints that have motors."""
    model, posture, driven = pin.Model(), dict[str, float](), set[str]()
    ends = [0]
    for i, link in enumerate(links):
        name, place = _name(link, i), f"{where}, body {i + 1}"
        if model.existFrame(name):
            raise InputError("two bodies have one name", where=where, got=name)
        joint, inertia = body_of(link, place)
        parent = str(link.findtext("parent/num", "0")).strip()
        if not (parent.isdecimal() and int(parent) <= i):
            raise InputError("parent is no earlier body", where=place, got=parent)
        at = numbers(link.findtext("parent/location", "0 0 0"), 3, "location in the parent", place)
        kinds = _FIXED[1] if joint.kind == _FIXED[0] else _JOINTS.get(joint.kind)
        if kinds is None:
            raise InputError(
                "this kind of joint is not supported",
                where=place,
                expected=", ".join([*_JOINTS, _FIXED[0]]),
                got=joint.kind,
            )
        q, low, high = (joint.values(key, len(kinds), place) for key in ("initial", "min", "max"))
        if joint.kind == _FIXED[0]:
            q, low, high = q[::-1], low[::-1], high[::-1]
        T, on = pin.SE3(np.eye(3), at), ends[int(parent)]
        for kind, start, least, most in zip(kinds, q, low, high, strict=True):
            own = name if len(kinds) == 1 else f"{name}.{kind[0]}{kind[1].lower()}"
            made = joint.axis(place) if kind[1] == "k" else kind
            one = (
                getattr(pin, f"JointModel{made}")()
                if isinstance(made, str)
                else (
                    pin.JointModelRevoluteUnaligned(made)
                    if kind[0] == "R"
                    else pin.JointModelPrismaticUnaligned(made)
                )
            )
            wide = least < most
            most, least = (most, least) if wide else (np.inf, -np.inf)
            free = np.array([np.inf])
            on = model.addJoint(on, one, T, own, free, free, np.array([least]), np.array([most]))
            T = pin.SE3.Identity()
            posture[own] = float(start)
            if joint.actuated:
                driven.add(own)
        model.appendBodyToJoint(on, inertia, pin.SE3.Identity())
        end = numbers(link.findtext("physical/end_location", "0 0 0"), 3, "end_location", place)
        for label, point in ((name, np.zeros(3)), (f"{name} end", end)):
            frame = pin.Frame(label, on, 0, pin.SE3(np.eye(3), point), pin.FrameType.OP_FRAME)
            model.addFrame(frame, False)
        ends.append(on)
    return model, posture, driven


def _line(cable: Cable, bodies: dict[str, str]) -> LineModel:
    frames = [bodies[link] for link in cable.links]
    return LineModel.model_construct(
        frames=frames,
        points=[p.tolist() for p in cable.points],
        stiffness=cable.stiffness,
        rest_length=cable.rest_length,
        preload=None,
        unilateral=cable.rest_length is None,
    )


def _lengths(bare: ElasticMechanism, springs: Sequence[LineSprings]) -> tuple[Array, Array]:
    """Lengths (m,) at the posture, and their gradients (m, n)."""
    at = bare.mechanism.at(bare.q)
    along, lengths = [], []
    for line in springs:
        T, to_pose = at.relative(line.frame_a, line.frame_b)
        geometry = line_geometry(T, line.anchors, line.points)
        along.append(geometry.lines[0] @ to_pose.jacobian)
        lengths.append(geometry.lengths[0])
    return np.array(along), np.array(lengths)


def _tensions(
    outside: ElasticMechanism, cables: Sequence[Cable], along: Array, lengths: Array
) -> Array | None:
    """Tensions of least sum that balance all else at the posture; None where there are none."""
    at = outside.mechanism.at(outside.q)
    pull = np.zeros(len(outside.q))
    for potential in outside.potentials:
        pull = pull + potential.evaluate(at).gradient
    limits = [c.tensions for c in cables]
    for i, c in enumerate(cables):
        if c.rest_length is not None:
            pull = pull + c.stiffness * (lengths[i] - c.rest_length) * along[i]
            limits[i] = (0.0, 0.0)
    held = outside.springs
    free = np.ones(len(pull), bool)
    if isinstance(held, JointSprings):
        free = np.asarray(held.stiffness) == 0.0
    size = np.abs(along).max(initial=0.0) or 1.0
    done = linprog(
        np.ones(len(cables)),
        A_eq=along.T[free] / size,
        b_eq=-pull[free] / size,
        bounds=limits,
        method="highs",
    )
    return np.asarray(done.x) if done.status == 0 else None
