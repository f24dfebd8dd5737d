"""The Pinocchio model of an MJCF file: kinematics and masses as MuJoCo compiled them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.mjcf.compiled import Compiled, free_name, named, pose


def mjcf_model(compiled: Compiled) -> pin.Model:
    """Pinocchio model with one joint per coordinate; bodies and sites are frames."""
    data = compiled.data
    model = pin.Model()
    model.name = data["name"]
    lower, upper = [], []
    at: list[tuple[int, Array]] = [(0, np.eye(4))]
    for b in range(1, len(compiled.bodies)):
        joint, T = at[data["body_parentid"][b]]
        T = T @ pose(data["body_pos"][b], data["body_quat"][b])
        for j in compiled.of_body[b]:
            for name, part, T_part, limits in _parts(compiled, j, T):
                joint = model.addJoint(joint, part, pin.SE3(T_part), name)
                lower.append(limits[0])
                upper.append(limits[1])
            scalar = compiled.types[j] in ("mjJNT_HINGE", "mjJNT_BALL")
            back = -np.array(data["jnt_pos"][j]) if scalar else np.zeros(3)
            T = se3.pose(translation=back)
        at.append((joint, T))
        inertia = pin.Inertia.Zero()
        if (mass := data["body_mass"][b]) > data["no_mass"]:
            T_b_c = pose(data["body_ipos"][b], data["body_iquat"][b])
            central = pin.Inertia(mass, np.zeros(3), np.diag(data["body_inertia"][b]))
            inertia = central.se3Action(pin.SE3(T_b_c))
        model.addFrame(
            pin.Frame(compiled.bodies[b], joint, pin.SE3(T), pin.FrameType.BODY, inertia)
        )
    damped = not compiled.is_off("DAMPER", "PASSIVE")
    for own, start in zip(compiled.coordinates, data["jnt_dofadr"], strict=True):
        for i, name in enumerate(own):
            at_v = model.idx_vs[model.getJointId(name)]
            # Of a ball or free body it would not stay diagonal in turns about successive axes.
            if len(own) == 1:
                model.armature[at_v] = data["dof_armature"][start]
            if damped:
                model.damping[at_v] = data["dof_damping"][start + i]
    model.lowerPositionLimit = np.array(lower)
    model.upperPositionLimit = np.array(upper)
    taken = {*compiled.bodies, "world"}
    for i, name in enumerate(named(data["site_names"], "site")):
        unique = name if name not in taken else free_name(f"{name} (site)", taken)
        taken.add(unique)
        joint, T = at[data["site_bodyid"][i]]
        T = T @ pose(data["site_pos"][i], data["site_quat"][i])
        model.addFrame(pin.Frame(unique, joint, pin.SE3(T), pin.FrameType.OP_FRAME))
    return model


def _parts(
    compiled: Compiled, j: int, T: Array
) -> list[tuple[str, Any, Array, tuple[float, float]]]:
    """One-coordinate joints of joint j of a body at T: name, model, placement, limits."""
    data, kind, names = compiled.data, compiled.types[j], compiled.coordinates[j]
    free = (-np.inf, np.inf)
    turns = (pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ())
    if kind == "mjJNT_FREE":
        shifts = (pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ())
        # The body stands at its reference; shifts are along F, so that the first place is F.
        home = pose(np.zeros(3), data["qpos0"][data["jnt_qposadr"][j] :][3:7])
        places = [np.eye(4), np.eye(4), np.eye(4), home, np.eye(4), np.eye(4)]
        return [(n, m, P, free) for n, m, P in zip(names, (*shifts, *turns), places, strict=True)]
    T = T @ se3.pose(translation=data["jnt_pos"][j])
    if kind == "mjJNT_BALL":
        places = [T, np.eye(4), np.eye(4)]
        return [(n, m, P, free) for n, m, P in zip(names, turns, places, strict=True)]
    axis = np.array(data["jnt_axis"][j])
    step = np.zeros(6)
    slide = kind == "mjJNT_SLIDE"
    step[3 if slide else 0 :][:3] = -axis * data["qpos0"][data["jnt_qposadr"][j]]
    if slide:
        T = T @ se3.pose(translation=-np.array(data["jnt_pos"][j]))
    make = pin.JointModelPrismaticUnaligned if slide else pin.JointModelRevoluteUnaligned
    limits = free
    if data["jnt_limited"][j] and not compiled.is_off("LIMIT", "CONSTRAINT"):
        limits = tuple(data["jnt_range"][j])
    return [(names[0], make(axis), T @ se3.exp(step), limits)]
