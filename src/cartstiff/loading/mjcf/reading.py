"""MJCF files, as MuJoCo's own compiler reads them.

What MuJoCo says is what a file means: includes, defaults, frames, masses of shapes, references. A
process of its own compiles the file (`worker`) and hands the model over as data; a Pinocchio
model with one-coordinate joints is made of it, and beside it stand springs, closures, gravity, the
posture, and what the engine cannot express.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin

from cartstiff.errors import one_line
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.mjcf.compiled import Compiled, compile_mjcf, pose
from cartstiff.loading.mjcf.model import mjcf_model
from cartstiff.loading.mjcf.ties import equalities, flex_joints, tendon_joints
from cartstiff.loading.robot_facts import FileSpring, Lifted, Obstacle, RobotFacts, on_leaders
from cartstiff.mechanisms.shapes import (
    Box,
    Capsule,
    Cylinder,
    MeshFile,
    Piece,
    Shape,
    Sphere,
)


def read_mjcf(
    path: Path, where: str | None = None
) -> tuple[pin.Model, RobotFacts, tuple[Piece, ...]]:
    """Pinocchio model of an MJCF file, the facts beside it, and what its bodies look like.

    A hinge or slide has MuJoCo's own position as its coordinate. A free body has the position of
    its origin in F and three successive turns x, y, z from its orientation in the file; a ball
    joint the turns alone.

    Raises
    ------
    InputError
        For what MuJoCo refuses, or what is too large.
    MissingDependencyError
        Without the package mujoco.
    """
    where = where or one_line(str(path))
    compiled = Compiled(compile_mjcf(path, where), where)
    return mjcf_model(compiled), _facts(compiled), tuple(_pieces(compiled))


def _facts(compiled: Compiled) -> RobotFacts:
    """Everything beside the model."""
    data = compiled.data
    closures, followers, locked, tied, handles = equalities(compiled)
    springs, stiff = _springs(compiled, followers)
    gravity = np.array(data["opt.gravity"], float)
    weighs = bool(gravity.any()) and not compiled.is_off("GRAVITY")
    posture, keyframe = _posture(compiled)
    actuated, actuators = _actuators(compiled)
    held = {*springs, *actuated}
    looped = {c for tie in closures for c in tie.joints}
    floating = {c for own in compiled.coordinates if len(own) == 6 for c in own}
    ignored = [*actuators, *handles, *_ignored(compiled)]
    return RobotFacts(
        springs=springs,
        passive=tuple(
            c for own in compiled.coordinates for c in own if c in (floating | looped) - held
        ),
        loose=frozenset(floating - looped),
        actuated=tuple(actuated),
        followers=followers,
        locked=locked,
        closures=closures,
        posture=posture,
        keyframe=keyframe,
        gravity=gravity if weighs else None,
        lifted=_lifted(compiled),
        obstacles=(
            *compiled.obstacles,
            *stiff,
            *tied,
            *_tendons(compiled),
            *_elastic_bodies(compiled),
        ),
        ignored=tuple(ignored),
        weightless=_weightless(compiled),
    )


def _springs(
    compiled: Compiled, followers: dict[str, tuple[str, float, float]]
) -> tuple[dict[str, FileSpring], list[Obstacle]]:
    """Springs of hinges and slides, those of followers moved to their leaders; the others."""
    data = compiled.data
    springs: dict[str, FileSpring] = {}
    others: list[Obstacle] = []
    if compiled.is_off("SPRING", "PASSIVE"):
        return springs, others
    further = data["jnt_stiffnesspoly"] or [[]] * len(compiled.joints)
    for j, (name, own) in enumerate(zip(compiled.joints, compiled.coordinates, strict=True)):
        coefficients = [data["jnt_stiffness"][j], *further[j]]
        while coefficients and coefficients[-1] == 0.0:
            coefficients.pop()
        if not coefficients:
            continue
        if len(own) > 1:
            kind = "ball" if len(own) == 3 else "free"
            others.append(Obstacle(f"spring of the {kind} joint {name!r}", frozenset(own)))
            continue
        if len(coefficients) == 1 and coefficients[0] < 0:
            continue  # `compiled` has named it
        rest = data["qpos_spring"][data["jnt_qposadr"][j]]
        springs[own[0]] = FileSpring(tuple(coefficients), rest)
    springs, curved = on_leaders(springs, followers)
    return springs, [*others, *curved]


def _posture(compiled: Compiled) -> tuple[dict[str, float], str | None]:
    """Positions of the keyframe "home", else of the first one, else the file's own."""
    data = compiled.data
    keys = data["key_names"]
    chosen, q = None, data["qpos0"]
    if keys:
        index = keys.index("home") if "home" in keys else 0
        chosen, q = keys[index] or f"{index + 1}", data["key_qpos"][index]
    posture: dict[str, float] = {}
    for own, kind, start in zip(
        compiled.coordinates, compiled.types, data["jnt_qposadr"], strict=True
    ):
        if kind == "mjJNT_BALL":
            values = _turns(pose(np.zeros(3), q[start : start + 4])[:3, :3])
        elif kind == "mjJNT_FREE":
            home = pose(np.zeros(3), data["qpos0"][start + 3 : start + 7])[:3, :3]
            R = pose(np.zeros(3), q[start + 3 : start + 7])[:3, :3]
            values = np.concatenate([q[start : start + 3], _turns(home.T @ R)])
        else:
            values = np.array([q[start]])
        posture |= zip(own, values.tolist(), strict=True)
    return posture, chosen


def _lifted(compiled: Compiled) -> tuple[Lifted, ...]:
    data = compiled.data
    return tuple(
        Lifted(compiled.bodies[b], share * data["body_mass"][b], np.array(data["body_ipos"][b]))
        for b, share in enumerate(data["body_gravcomp"])
        if share and data["body_mass"][b] > data["no_mass"]
    )


def _actuators(compiled: Compiled) -> tuple[list[str], list[str]]:
    """Coordinates that actuators drive, and the actuators in words."""
    names = [n or f"{i + 1}" for i, n in enumerate(compiled.data["actuator_names"])]
    driven = []
    for kind, (target, _) in zip(
        compiled.data["actuator_trntype"], compiled.data["actuator_trnid"], strict=True
    ):
        if kind in (0, 1) and len(compiled.coordinates[target]) == 1:  # joint, joint in parent
            driven.append(compiled.coordinates[target][0])
    return list(dict.fromkeys(driven)), [f"actuators ({_listed(names)})"] if names else []


def _tendons(compiled: Compiled) -> list[Obstacle]:
    data = compiled.data
    further = data["tendon_stiffnesspoly"] or [[]] * len(data["tendon_names"])
    return [
        Obstacle(f"stiffness of tendon {name or t + 1!r}", tendon_joints(compiled, t))
        for t, name in enumerate(data["tendon_names"])
        if (data["tendon_stiffness"][t] or any(further[t]))
        and not compiled.is_off("SPRING", "PASSIVE")
    ]


def _elastic_bodies(compiled: Compiled) -> list[Obstacle]:
    """Bodies whose plugin exerts forces, and flexible objects."""
    bodies = [
        Obstacle(f"plugin of body {name!r}", compiled.names_of(compiled.above(b)))
        for b, (name, plugin) in enumerate(
            zip(compiled.bodies, compiled.data["body_plugin"], strict=True)
        )
        if plugin >= 0
    ]
    for i, name in enumerate(compiled.data["flex_names"]):
        bodies.append(Obstacle(f"flex {name!r}", flex_joints(compiled, i)))
    return bodies


def _ignored(compiled: Compiled) -> list[str]:
    data = compiled.data
    ignored = []
    loose = [
        name or f"{t + 1}"
        for t, name in enumerate(data["tendon_names"])
        if not data["tendon_stiffness"][t]
    ]
    if loose:
        ignored.append(f"tendons without stiffness ({_listed(loose)})")
    if data["pair_names"]:
        ignored.append(f"contact pairs ({len(data['pair_names'])})")
    parts = zip(compiled.joints, compiled.coordinates, data["jnt_limited"], strict=True)
    balls = [name for name, own, limited in parts if limited and len(own) > 1]
    if balls:
        ignored.append(f"ranges of ball joints ({_listed(balls)})")
    for what, words in (
        ("armature", "armature"),
        ("damping", "how turns away from the file's orientation couple the dampers"),
    ):
        named = [
            name
            for name, own, start in zip(
                compiled.joints, compiled.coordinates, data["jnt_dofadr"], strict=True
            )
            if len(own) > 1 and data[f"dof_{what}"][start]
        ]
        if named:
            ignored.append(f"{words} of ball and free joints ({_listed(named)})")
    if any(data["opt.wind"]) and (data["opt.density"] or data["opt.viscosity"]):
        ignored.append("wind")
    if compiled.is_off("SPRING", "PASSIVE") and any(data["jnt_stiffness"]):
        ignored.append("springs, which the file switches off")
    return ignored


def _weightless(compiled: Compiled) -> tuple[str, ...]:
    data = compiled.data
    weightless = [
        f"mass of body {', '.join(repr(b) for b in bodies)} (mesh {file} is missing)"
        for file, bodies in data["lost_meshes"].items()
    ]
    if data["no_mass"]:
        bare = [
            name
            for b, name in enumerate(compiled.bodies)
            if data["body_mass"][b] <= data["no_mass"] and compiled.of_body[b]
        ]
        if bare:
            weightless.append(f"mass of moving bodies that the file gives none ({_listed(bare)})")
    return tuple(weightless)


def _pieces(compiled: Compiled) -> Iterator[Piece]:
    """What bodies look like: geoms of the groups that MuJoCo shows, or all if there are none."""
    data = compiled.data
    groups = data["geom_group"]
    for g in [g for g, group in enumerate(groups) if group < 3] or range(len(groups)):
        kind = data["enums"]["mjtGeom"][str(data["geom_type"][g])].removeprefix("mjGEOM_")
        T = pose(data["geom_pos"][g], data["geom_quat"][g])
        shape: Shape
        if kind in ("MESH", "SDF"):
            index = data["geom_dataid"][g]
            mesh = data["meshes"].get(data["mesh_names"][index]) if index >= 0 else None
            if mesh is None:
                continue  # made in the file itself: there is nothing to read
            x, y, z = mesh["scale"]
            shape = MeshFile(Path(mesh["file"]), (x, y, z))
            # The mesh stands where its own centre and axes are; the file's origin is elsewhere.
            T = T @ se3.inverse(pose(data["mesh_pos"][index], data["mesh_quat"][index]))
            moved = -np.array(mesh["scale"]) * np.array(mesh["refpos"])
            T = T @ pose(np.zeros(3), mesh["refquat"]).T @ se3.pose(translation=moved)
        elif kind in _SHAPES:
            shape = _SHAPES[kind](*data["geom_size"][g])
        else:
            continue
        material = data["geom_matid"][g]
        r, gr, b, a = data["geom_rgba"][g] if material < 0 else data["mat_rgba"][material]
        yield Piece(compiled.bodies[data["geom_bodyid"][g]], T, shape, (r, gr, b, a))


_SHAPES: dict[str, Callable[[float, float, float], Shape]] = {
    "BOX": lambda a, b, c: Box((2 * a, 2 * b, 2 * c)),
    "CYLINDER": lambda a, b, _: Cylinder(a, 2 * b),
    "CAPSULE": lambda a, b, _: Capsule(a, 2 * b),
    "SPHERE": lambda a, *_: Sphere((a, a, a)),
    "ELLIPSOID": lambda a, b, c: Sphere((a, b, c)),
}


def _turns(R: Array) -> Array:
    """Angles of the turns about x, the new y, the new z that make R."""
    y = np.arcsin(np.clip(R[0, 2], -1.0, 1.0))
    if abs(R[0, 2]) >= 1.0:
        return np.array([np.arctan2(R[1, 0], R[1, 1]), y, 0.0])
    return np.array([np.arctan2(-R[1, 2], R[2, 2]), y, np.arctan2(-R[0, 1], R[0, 0])])


def _listed(names: list[str], most: int = 12) -> str:
    return ", ".join(names[:most]) + (
        f", and {len(names) - most} more" if len(names) > most else ""
    )
