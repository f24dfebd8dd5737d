"""From a mechanism file's model, or a robot description alone, to an elastic mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import fixed
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.loading.defaults import chosen_frame, default_posture, regular_posture
from cartstiff.loading.key_types import PoseModel, pose_of
from cartstiff.loading.parts import (
    add_payload,
    described,
    description_notes,
    gravity_left_out,
    put_together,
    tree_to,
)
from cartstiff.loading.platforms import leg_limits_of, on_springs, pair_per_leg
from cartstiff.loading.plausible import stretched
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.loading.schema import PayloadModel
from cartstiff.loading.springs import link_springs, springs_of, virtual_joints
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import SI, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform, Struts
from cartstiff.mechanisms.tree_building import merged
from cartstiff.notes import Note
from cartstiff.potentials.flexure_struts import Flexure, FlexureStruts
from cartstiff.potentials.line_springs import LineSprings, line_geometry

if TYPE_CHECKING:
    from cartstiff.loading.schema import PlatformFile, SerialFile, SpringsFile


#: Kinds of files with joints, and with lines from the ground to a body.
_OF_JOINTS, _OF_LINES = ("serial", "closed-chain"), ("stewart-gough", "springs")


def build_serial(file: SerialFile, beside: Path | None, where: str, name: str) -> ElasticMechanism:
    """Elastic mechanism of a serial arm."""
    description = described(file, beside)
    notes = gravity_left_out(file, description)
    return serial_of(description, file, where, name, said=notes)


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
    held_by = [f for line in file.lines for f in line.frames if f != "world"]
    ends = [frame, *(f for f in held_by if description.model.existFrame(f))]
    tree = tree_to(description, ends, file.locked, where, notes, file.flexible)
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
    chain.base_pose = fixed(pose_of(file.base))
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
    notes += [*description_notes(description, tree, file.model_fields_set), *assumed]
    return put_together(
        file, name, chain, q, springs, soft, notes, where, facts.lifted, file.springs
    )


def _per_leg(value: float | list[float] | None, m: int, key: str, where: str) -> Array | None:
    if value is None:
        return None
    if isinstance(value, list) and len(value) != m:
        raise InputError(
            "wrong count",
            where=f"{where}, key legs.{key}",
            expected=f"{m} numbers, one per leg",
            got=str(len(value)),
        )
    return np.broadcast_to(np.asarray(value, float), (m,)).copy()


def build_platform(file: PlatformFile | SpringsFile, where: str, name: str) -> ElasticMechanism:
    """Elastic mechanism of a body held by lines."""
    m = len(file.base)
    if len(file.platform) != m:
        raise InputError(
            "base and platform differ in number",
            where=f"{where}, key platform",
            expected=f"{m} points",
            got=str(len(file.platform)),
        )
    limits = pair_per_leg(file.legs.limits, m, f"{where}, key legs.limits", "[shortest, longest]")
    T_F_P = pose_of(file.pose)
    T_P_M = pose_of(file.frame)
    mass, centre, inertia = _body(file, T_P_M, where)
    platform = Platform(
        file.base,
        file.platform,
        T_P_M=T_P_M,
        units=Units(file.units.length, file.units.force),
        kind=file.kind,
        limits=None if limits is None else [(a, b) for a, b in limits],
        mass=mass,
        mass_centre=centre,
        inertia=inertia,
        struts=_struts(file, m, where),
        leg_limits=leg_limits_of(file, T_P_M, where),
    )
    T_F_M = T_F_P @ T_P_M
    try:
        geometry = line_geometry(T_F_M, platform.anchors, platform.points)
    except UndefinedError as error:
        raise InputError(
            f"leg {error.values['line']} has zero length at the file's pose", where=where
        ) from None
    if platform.struts is not None:
        _check_bars(platform.struts, geometry.lengths, where)
    springs = _legs(file, platform, T_F_M, geometry.lengths, where)
    rest = None if np.isnan(springs.rest_length).all() else springs.rest_length
    q = np.concatenate([file.pose.xyz, file.pose.rpy])
    dampers = _per_leg(file.legs.damping, m, "damping", where)
    damping = dampers if dampers is not None and dampers.any() else None
    notes = []
    if rest is not None:
        strains = (geometry.lengths - rest) / geometry.lengths
        # A rest length of nought is meant: such springs balance weights.
        notes = stretched(
            {f"stretch of leg {i + 1}": float(x) for i, x in enumerate(strains) if rest[i]}
        )
    elastic = ElasticMechanism(name, platform, q, springs, notes=tuple(notes), damping=damping)
    return elastic.with_gravity(file.gravity, where=f"{where}, key gravity")


def _legs(
    file: PlatformFile | SpringsFile, platform: Platform, T_F_M: Array, lengths: Array, where: str
) -> LineSprings:
    """Springs of the legs: lines, or struts between flexures."""
    legs, m = file.legs, len(lengths)
    strut = legs.strut
    value, key = (legs.stiffness, "stiffness") if strut is None else (strut.axial, "strut.axial")
    stiffness = _per_leg(value, m, key, where)
    rest = _per_leg(legs.rest_length, m, "rest_length", where)
    preload = _per_leg(legs.preload, m, "preload", where)
    if stiffness is None:  # the schema requires it
        raise InputError("legs have no stiffness", where=where)
    rests = np.full(m, np.nan) if rest is None else rest
    if strut is None:
        springs = LineSprings(
            anchors=platform.anchors,
            points=platform.points,
            stiffness=stiffness,
            rest_length=rests,
            unilateral=getattr(file, "unilateral", False),
        )
    else:
        a, f = convert_length(SI, platform.units)  # moments are in N m, whatever the units
        lower, upper = (
            Flexure(e.axial, e.shear, e.bending * f * a, e.torsion * f * a, e.offset)
            for e in (strut.lower, strut.upper)
        )
        springs = FlexureStruts.between(
            platform.anchors, platform.points, T_F_M, stiffness, lower, upper, rests
        )
    if file.flexible:
        springs = on_springs(springs, file, T_F_M, where)
    if preload is None:
        return springs
    return springs.replaced(springs.stiffness, lengths - preload / springs.stiffness)


def _body(file: PlatformFile | SpringsFile, T_P_M: Array, where: str) -> tuple[float, Array, Array]:
    """Mass, centre and inertia about it, in P, of the body with its payload."""
    body, payload = file.body, file.payload
    inertia = np.zeros((3, 3))
    if body is not None and body.inertia is not None:
        inertia = np.array(body.inertia, float)
    if np.abs(inertia - inertia.T).max() > numerics.SYMMETRY * np.abs(inertia).max():
        raise InputError(
            "inertia is not symmetric", where=f"{where}, key body.inertia", got=inertia.tolist()
        )
    moments = np.linalg.eigvalsh(inertia)
    if (
        moments[0] < -numerics.CLOSE * moments[2]
        or moments[0] + moments[1] < (1 - numerics.CLOSE) * moments[2]
    ):
        raise InputError(
            "no body has these moments of inertia",
            where=f"{where}, key body.inertia",
            expected="each at most the sum of the other two",
            got=moments.tolist(),
        )
    mass, com = (0.0, [0.0] * 3) if body is None else (body.mass, body.com)
    hung, at = (0.0, [0.0] * 3) if payload is None else (payload.mass, payload.com)
    parts = [(mass, np.array(com)), (hung, (T_P_M @ [*at, 1.0])[:3])]
    mass = sum(m for m, _ in parts)
    if not mass:
        return 0.0, parts[1][1], inertia
    centre = np.sum([m * c for m, c in parts], axis=0) / mass
    for m, c in parts:
        arm = se3.skew(c - centre)
        inertia = inertia - m * arm @ arm
    return mass, centre, inertia


def _struts(file: PlatformFile | SpringsFile, m: int, where: str) -> Struts | None:
    """Masses of the legs, checked."""
    strut = file.legs.strut
    mass = file.legs.mass if strut is None or strut.mass is None else strut.mass
    if mass is None:
        return None
    keys = ("fixed", "moving", "fixed_com", "moving_com", "radius")
    values = [_per_leg(getattr(mass, key), m, f"mass.{key}", where) for key in keys]
    return Struts(*(np.zeros(m) if value is None else value for value in values))


def _check_bars(struts: Struts, lengths: np.ndarray, where: str) -> None:
    """Refuse bars of legs whose centre lies beyond the leg's other end."""
    for key, masses in (("fixed_com", struts.fixed), ("moving_com", struts.moving)):
        for i in np.flatnonzero((masses > 0.0) & (getattr(struts, key) > lengths)):
            raise InputError(
                f"the mass centre of leg {i + 1} is beyond its other end",
                where=f"{where}, legs.mass.{key}",
                got=f"{getattr(struts, key)[i]:g}",
                expected=f"a distance up to the leg's length, {lengths[i]:g}",
            )


def with_overrides(file: Any, overrides: Mapping[str, Any], where: str) -> Any:
    """A file with what was given beside it, which counts before what it says itself.

    Parameters
    ----------
    file : a model of the schema
        What the file says.
    overrides : mapping
        "frame", "locked", "tcp" (pose of M in that frame), "gravity", "payload" (mass, centre in
        M; added to the file's), "xacro", "package_path"; as many as there are.
    where : str
        The file, for messages.

    Raises
    ------
    InputError
        For what the file's kind does not have.
    """
    keys: dict[str, Any] = {}
    if (frame := overrides.get("frame")) is not None:
        file = _with_frame(file, frame, where)
    if locked := overrides.get("locked"):
        if file.kind not in _OF_JOINTS:
            raise InputError(
                f"kind {file.kind} has no joints to lock",
                where=where,
                expected="kind serial or closed-chain",
            )
        keys["locked"] = {**file.locked, **locked}
    if overrides.get("xacro") or overrides.get("package_path"):
        file = _with_ros(file, overrides, where)
    payload = file.payload
    if (T := overrides.get("tcp")) is not None:
        back = se3.inverse(T)
        key = "frame" if file.kind in _OF_LINES else "offset"
        keys[key] = _model_of(pose_of(getattr(file, key)) @ T)
        if payload is not None:
            centre = (back @ np.append(payload.com, 1.0))[:3]
            payload = payload.model_copy(update={"com": centre.tolist()})
    if (more := overrides.get("payload")) is not None:
        mass, centre = more
        own, at = (0.0, centre) if payload is None else (payload.mass, payload.com)
        total = own + mass
        com = (
            np.array(centre)
            if total == 0
            else ((own * np.array(at) + mass * np.array(centre)) / total)
        )
        payload = PayloadModel.model_construct(mass=total, com=com.tolist())
    if (gravity := overrides.get("gravity")) is not None:
        keys["gravity"] = list(gravity)
    if payload is not file.payload:
        keys["payload"] = payload
    return file.model_copy(update=keys) if keys else file


def _model_of(T: Array) -> PoseModel:
    xyz, rpy = T[:3, 3].tolist(), se3.roll_pitch_yaw(T).tolist()
    return PoseModel.model_construct(xyz=xyz, rpy=rpy)


def _with_ros(file: Any, overrides: Mapping[str, Any], where: str) -> Any:
    """A file whose robots get more xacro arguments, and more folders for packages."""
    if hasattr(file, "model"):
        return file.with_ros(overrides.get("xacro", {}), overrides.get("package_path", ()))
    if isinstance(file.legs, list) and any(leg.drawing is None for leg in file.legs):
        legs = [
            _with_ros(leg, overrides, where) if leg.drawing is None else leg for leg in file.legs
        ]
        return file.model_copy(update={"legs": legs})
    raise InputError(
        f"kind {file.kind} has no robot description",
        where=where,
        expected="no xacro arguments and no package path",
    )


def _with_frame(file: Any, frame: str, where: str) -> Any:
    """File with another frame of interest."""
    if file.kind in _OF_LINES:
        if frame == "platform":
            return file
        raise UnknownNameError("frame", frame, ["platform"], where=where)
    if file.kind == "parallel":
        if frame == "body":
            return file
        raise UnknownNameError("frame", frame, ["body"], where=where)
    return file.model_copy(update={"frame": frame, "offset": _model_of(np.eye(4))})
