"""From a mechanism file's model, or a robot description alone, to an elastic mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.loading.defaults import chosen_frame, default_posture
from cartstiff.loading.parts import (
    add_payload,
    described,
    description_notes,
    gravity_left_out,
    gravity_of,
    link_springs,
    pose_of,
    put_together,
    springs_of,
    tree_to,
    virtual_joints,
    weightless,
)
from cartstiff.loading.regular_posture import regular_posture
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.loading.schema import (
    ParallelFile,
    PayloadModel,
    PlatformFile,
    PoseModel,
    SerialFile,
    SpringsFile,
)
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Units
from cartstiff.mechanisms.elastic import ElasticMechanism, Note
from cartstiff.mechanisms.platform import Platform
from cartstiff.mechanisms.tree_building import merged
from cartstiff.potentials.line_springs import LineSprings, line_geometry

__all__ = ["build_platform", "build_serial", "serial_of", "with_frame"]


def build_serial(file: SerialFile, beside: Path | None, where: str, name: str) -> ElasticMechanism:
    """Elastic mechanism of a serial arm."""
    description = described(file, beside)
    said = gravity_left_out(file, description)
    return serial_of(description, file, where, name, said=said)


def serial_of(
    description: RobotDescription,
    file: SerialFile,
    where: str,
    name: str,
    posture: Mapping[str, float] | None = None,
    said: Sequence[Note] = (),
) -> ElasticMechanism:
    """Elastic mechanism of a serial arm whose robot description has been read.

    Parameters
    ----------
    description : RobotDescription
        The robot.
    file : SerialFile
        What else is known about it.
    where, name : str
        Where messages say that something stands, and the mechanism's name.
    posture : mapping of str to float, optional
        Default positions by coordinate, for those that `file` does not give; names that are no
        coordinates of the chain play no part.
    said : sequence of Note
        Notes of the reader.
    """
    notes, facts = [*said], description.facts
    frame = chosen_frame(description, file.frame, where, notes)
    tree = tree_to(description, [frame], file.locked, where, notes, file.flexible)
    if tree.n == 0:
        raise InputError(
            f"no joint moves frame {frame!r}", where=where, expected="a frame on a moving link"
        )
    tree = merged([("", tree, pose_of(file.base))])
    names = [c.name for c in tree.coordinates]
    chain = Chain(
        tree,
        frame,
        offset=pose_of(file.offset),
        virtual=[names.index(name) for name in virtual_joints(file.flexible)],
        descriptions=[description.shown()],
    )
    add_payload(tree, chain, file.payload)
    soft = link_springs(file.flexible, tree, where)
    springs, assumed = springs_of(
        file.springs, file.passive, tree, facts, where, virtual=virtual_joints(file.flexible)
    )
    q = default_posture(tree, file.q, where, posture, facts)
    # Springs with rest positions are at home where these are.
    homed = facts.springs or any(entry.rest is not None for entry in file.springs.values())
    if not (file.q or posture or facts.keyframe is not None or homed):
        q, chosen = regular_posture(chain, q)
        notes += chosen
    notes += [*description_notes(description, tree), *assumed]
    return put_together(file, name, chain, q, springs, soft, notes, where, facts.lifted)


def _per_leg(value: float | list[float] | None, m: int, key: str, where: str) -> Array | None:
    if value is None:
        return None
    if isinstance(value, list) and len(value) != m:
        raise InputError(
            "wrong count", where=f"{where}, key legs.{key}", expected=f"{m} numbers, one per leg",
            got=str(len(value)),
        )  # fmt: skip
    return np.broadcast_to(np.asarray(value, float), (m,)).copy()


def build_platform(file: PlatformFile | SpringsFile, where: str, name: str) -> ElasticMechanism:
    """Elastic mechanism of a body held by lines."""
    m = len(file.base)
    if len(file.platform) != m:
        raise InputError(
            "base and platform differ in number", where=f"{where}, key platform",
            expected=f"{m} points", got=str(len(file.platform)),
        )  # fmt: skip
    limits = file.legs.limits
    if limits is not None:
        if len(limits) != m:
            raise InputError("wrong count", where=f"{where}, legs.limits",
                             expected=f"{m} pairs", got=str(len(limits)))  # fmt: skip
        for pair in limits:
            if pair[0] > pair[1]:
                raise InputError("limits are the wrong way round", where=f"{where}, legs.limits",
                                 expected="[shortest, longest]", got=pair)  # fmt: skip
    T_F_P = pose_of(file.pose)
    payload = file.payload or PayloadModel(mass=0.0)
    T_P_M = pose_of(file.frame)
    centre = T_P_M @ np.append(payload.com, 1.0)
    platform = Platform(
        file.base,
        file.platform,
        T_P_M=T_P_M,
        units=Units(file.units.length, file.units.force),
        kind=file.kind,
        limits=None if limits is None else [(a, b) for a, b in limits],
        mass=payload.mass,
        mass_centre=centre[:3],
    )
    T_F_M = T_F_P @ T_P_M
    try:
        geometry = line_geometry(T_F_M, platform.anchors, platform.points)
    except UndefinedError as error:
        raise InputError(
            f"leg {error.values['line']} has zero length at the file's pose", where=where
        ) from None
    stiffness = _per_leg(file.legs.stiffness, m, "stiffness", where)
    rest = _per_leg(file.legs.rest_length, m, "rest_length", where)
    preload = _per_leg(file.legs.preload, m, "preload", where)
    if stiffness is None:  # the schema requires it
        raise InputError("legs have no stiffness", where=where)
    if preload is not None:
        rest = geometry.lengths - preload / stiffness
    springs = LineSprings(
        anchors=platform.anchors,
        points=platform.points,
        stiffness=stiffness,
        rest_length=np.full(m, np.nan) if rest is None else rest,
        unilateral=isinstance(file, SpringsFile) and file.unilateral,
    )
    q = np.concatenate([file.pose.xyz, file.pose.rpy])
    gravity = gravity_of(file.gravity, where, platform.units)
    notes = tuple(weightless(gravity, platform.mass))
    return ElasticMechanism(name, platform, q, springs, gravity=gravity, notes=notes)


def with_frame(file: Any, frame: str | None, where: str) -> Any:
    """File with another frame of interest, from the command line."""
    if frame is None:
        return file
    if isinstance(file, (PlatformFile, SpringsFile)):
        if frame == "platform":
            return file
        raise UnknownNameError("frame", frame, ["platform"], where=where)
    if isinstance(file, ParallelFile):
        if frame == "body":
            return file
        raise UnknownNameError("frame", frame, ["body"], where=where)
    return file.model_copy(update={"frame": frame, "offset": PoseModel()})
