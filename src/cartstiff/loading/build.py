"""From a mechanism file's model, or a robot description alone, to an elastic mechanism."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Array, fixed
from cartstiff.errors import (
    ConvergenceError,
    InputError,
    UndefinedError,
    UnknownNameError,
    check_name,
)
from cartstiff.geometry import se3
from cartstiff.kinematics.joint_poses import JointPoses
from cartstiff.loading.defaults import chosen_frame, default_posture, regular_posture
from cartstiff.loading.parts import (
    add_payload,
    described,
    description_notes,
    gravity_left_out,
    joints_that_move,
    link_springs,
    put_together,
    springs_of,
    tree_to,
    virtual_joints,
)
from cartstiff.loading.plausible import stretched
from cartstiff.loading.robot_description import RobotDescription
from cartstiff.loading.robot_facts import FileClosure, FileSpring, Lifted, RobotFacts
from cartstiff.loading.schema import PayloadModel, PoseModel, pose_of
from cartstiff.mechanisms.chain import Chain, Closure, Description
from cartstiff.mechanisms.closures import ReferencePosture
from cartstiff.mechanisms.contract import SI, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism, adjusted
from cartstiff.mechanisms.leg_shapes import PlacedLeg
from cartstiff.mechanisms.platform import LegLimits, Platform, Struts
from cartstiff.mechanisms.tree import FixedFrame, KinematicTree
from cartstiff.mechanisms.tree_building import extended, merged
from cartstiff.notes import Note
from cartstiff.potentials.flexure_struts import Flexure, FlexureStruts
from cartstiff.potentials.line_springs import LineSprings, line_geometry
from cartstiff.potentials.mounted_struts import Mount, MountedStruts

if TYPE_CHECKING:
    from cartstiff.loading.schema import (
        ClosedChainFile,
        ClosureModel,
        FlexibleModel,
        JointSpringModel,
        LegJointsModel,
        LegModel,
        ParallelFile,
        PlatformFile,
        SerialFile,
        SpringsFile,
    )


def on_springs(
    springs: LineSprings, file: PlatformFile | SpringsFile, T_F_M: Array, where: str
) -> MountedStruts:
    """The legs between what the file's `flexible` says of base and platform.

    Raises
    ------
    InputError
        For cables, and for springs that are not symmetric and positive definite, are beams, or have
        a mass.
    """
    where = f"{where}, key flexible"
    if springs.unilateral:
        raise InputError(
            "cables hang from what does not give", where=where, expected="no key flexible"
        )
    if not isinstance(springs, FlexureStruts):
        ball = Flexure(math.inf, math.inf, 0.0, 0.0)
        springs = FlexureStruts.between(
            springs.anchors,
            springs.points,
            T_F_M,
            springs.stiffness,
            ball,
            ball._replace(torsion=math.inf),
            springs.rest_length,
        )
    to_body = se3.inverse(pose_of(file.frame))
    base = _mount(file.flexible.get("base"), np.eye(4), f"{where}.base")
    tip = _mount(file.flexible.get("platform"), to_body, f"{where}.platform")
    return MountedStruts.of(springs, base, tip)


def _mount(entry: FlexibleModel | None, T: Array, where: str) -> Mount | None:
    """A spring, its place moved by T; None where nothing gives."""
    if entry is None:
        return None
    if entry.stiffness is None or entry.mass is not None:
        got = "a beam" if entry.stiffness is None else "a superelement with M"
        raise InputError(
            "base and platform give as a spring without mass",
            where=where,
            expected="stiffness, or superelement without M",
            got=got,
        )
    K = np.array(entry.stiffness, float)
    sizes = np.sqrt(np.abs(np.diag(K)))
    if np.any(np.abs(K - K.T) > numerics.SYMMETRY * np.outer(sizes, sizes)):
        raise InputError("stiffness must be symmetric", where=where)
    least = float(np.linalg.eigvalsh(K / np.outer(sizes, sizes))[0]) if sizes.all() else 0.0
    if not least > numerics.RANK:
        raise InputError(
            "stiffness must hold the body in every direction",
            where=where,
            expected="a positive definite matrix",
            got=f"eigenvalue {least:.2g} of the diagonal's",
        )
    return Mount(T @ pose_of(entry.offset), K[np.ix_(se3.SWAP, se3.SWAP)])


def leg_limits_of(file: PlatformFile | SpringsFile, T_P_M: Array, where: str) -> LegLimits | None:
    """Limits of joint angles, distances and forces; None without any.

    Raises
    ------
    InputError
        For counts that differ from that of the legs, axes without a direction, and force limits
        the wrong way round.
    """
    legs, m = file.legs, len(file.base)
    base_axes, base_angles = _joints(legs.base_joints, m, f"{where}, key legs.base_joints")
    axes, angles = _joints(legs.platform_joints, m, f"{where}, key legs.platform_joints")
    diameters = None
    if legs.diameter is not None:
        diameters = _each(legs.diameter, m, f"{where}, key legs.diameter")
    place = f"{where}, key legs.force"
    forces = pair_per_leg(legs.force, m, place, "[least, largest]")
    if forces is not None and np.any(forces[:, 1] < 0.0) and getattr(file, "unilateral", False):
        raise InputError("cables cannot push", where=place, expected="0 or more", got=legs.force)
    if all(part is None for part in (base_axes, axes, diameters, forces)):
        return None
    in_body = None if axes is None else axes @ T_P_M[:3, :3]
    return LegLimits(base_axes, base_angles, in_body, angles, diameters, forces)


def pair_per_leg(value: Any, m: int, where: str, meaning: str) -> Array | None:
    """Limits (m, 2) from one pair for all legs or one each; None without any.

    Raises
    ------
    InputError
        For another number of pairs than legs, and for a pair the wrong way round.
    """
    if value is None:
        return None
    numbers = np.array(value, float)
    pairs = np.broadcast_to(numbers, (m, 2)) if numbers.ndim == 1 else numbers
    if len(pairs) != m:
        raise InputError(
            "wrong count", where=where, expected=f"{m} pairs, one per leg", got=len(pairs)
        )
    for i in np.flatnonzero(pairs[:, 0] > pairs[:, 1])[:1]:
        raise InputError(
            "limits are the wrong way round",
            where=f"{where}.{i + 1}",
            expected=meaning,
            got=pairs[i].tolist(),
        )
    return pairs


def _each(value: Any, m: int, where: str) -> Array:
    values = np.asarray(value, float)
    if values.ndim == 1 and len(values) != m:
        raise InputError(
            "wrong count", where=where, expected=f"{m} numbers, one per leg", got=len(values)
        )
    return np.broadcast_to(values, (m,)).copy()


def _joints(model: LegJointsModel | None, m: int, where: str) -> tuple[Array | None, Array | None]:
    """Unit axes (m, 3) and largest angles (m,)."""
    if model is None:
        return None, None
    axes = np.array(model.axis, float)
    if axes.ndim == 2 and len(axes) != m:
        raise InputError(
            "wrong count", where=f"{where}.axis", expected=f"{m} axes, one per leg", got=len(axes)
        )
    axes = np.broadcast_to(axes, (m, 3))
    sizes = np.linalg.norm(axes, axis=1)
    if not sizes.min() > 0.0:
        raise InputError("an axis has no direction", where=f"{where}.axis", got=model.axis)
    return axes / sizes[:, None], _each(model.angle, m, f"{where}.angle")


# Starts of a leg besides the file's posture, and the seed that makes them the same every time.
_STARTS, _SEED = 16, 0


def leg_at_pose(
    tree: KinematicTree,
    end: str,
    T_end_B: Array,
    T_root_B: Array,
    q: Array,
    virtual: Sequence[int],
    where: str,
    leg: str,
) -> Array:
    """Coordinates (n,) of one leg at which the body has a pose.

    Looked for from `q` and then from postures spread over the limits; the first solution within the
    limits is taken, or the first at all. Virtual joints of links that give stay where they are.

    Parameters
    ----------
    tree : KinematicTree
        The leg.
    end : str
        Its last frame.
    T_end_B, T_root_B : ndarray (4, 4)
        Pose of the body in that frame, and where it shall be in the leg's root.
    q : ndarray (n,)
        Posture to start from.
    virtual : sequence of int
        Indices of virtual joints.
    where, leg : str
        File and leg, for messages.

    Raises
    ------
    InputError
        If the leg does not reach the pose.
    """
    elastic = ElasticMechanism(leg, Chain(tree, end, offset=T_end_B, virtual=virtual), q)
    limited, free = JointPoses(elastic), JointPoses(elastic, limits=False)
    spread = limited.random_starts(_STARTS, np.random.default_rng(_SEED))
    starts = np.concatenate([q[None], spread])
    poses = np.broadcast_to(T_root_B, (len(starts), 4, 4))
    for solver in (limited, free):
        postures, reached = solver.unwound().solve(poses, starts)
        if reached.any():
            return solver.within(postures[reached][:1])[0]
    left = np.abs(free.task(postures, poses, "none")[0]).max(axis=1).min()
    raise InputError(
        "the pose cannot be reached",
        where=f"{where}, key pose",
        expected="a pose that every leg reaches",
        got=f"{leg}, which stays {left:.3g} (rad or characteristic lengths) away",
    )


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


_CONTACTS = {
    "rigid": (),
    "soft-finger": (("contact.z", "RZ"),),
    "point": (("contact.x", "RX"), ("contact.y", "RY"), ("contact.z", "RZ")),
}


def _add_frame(tree: KinematicTree, name: str, base: str, T: Array) -> None:
    at = tree.placement(base)
    tree.frames[name] = FixedFrame(at.joint, at.T_j_f @ T)


def _actuated(names: Sequence[str], tree: KinematicTree, where: str) -> list[int] | None:
    known = [c.name for c in tree.coordinates]
    for name in names:
        check_name("joint", name, known, f"{where}, key actuated")
    if len(set(names)) != len(names):
        raise InputError("a joint stands twice under actuated", where=where)
    return [known.index(name) for name in names] or None


def _indices(names: Sequence[str], tree: KinematicTree) -> list[int]:
    known = [c.name for c in tree.coordinates]
    return [known.index(name) for name in names]


def _assembled(
    chain: Chain, q: Array, posture: Mapping[str, float], where: str, notes: list[Note]
) -> Array:
    """Closed coordinates near q; where no joint is actuated, those that the file names are held."""
    named = [] if chain.actuated else [chain.names.index(name) for name in posture]
    try:
        at = chain.closed(q, named=named)
    except ConvergenceError as error:
        raise InputError(f"{error}", where=where, expected="a posture near a closed one") from None
    chain.home = ReferencePosture(at.q, chain.held, at.coordinate_lengths)
    if len(named) < len(q):  # else they are where the search starts
        notes += adjusted(chain, q, at.q, named)
    return at.q


def build_parallel(
    file: ParallelFile, beside: Path | None, where: str, name: str
) -> ElasticMechanism:
    """One body carried by several chains: the end frames of all chains are welded together.

    The body frame hangs on the first chain; every other chain's end is welded to it.
    """
    from cartstiff.loading.legs import drawn_legs

    notes: list[Note] = []
    parts: list[tuple[str, KinematicTree, Array]] = []
    ends: list[str] = []
    springs: dict[str, JointSpringModel] = {}
    passive: list[str] = []
    virtual: list[str] = []
    contacts: list[str] = []
    driven: list[str] = []
    posture: dict[str, float] = {}
    soft: list[tuple[int, LegModel]] = []
    descriptions: list[Description] = []
    file_springs: dict[str, FileSpring] = {}
    file_passive: list[str] = []
    drawn: dict[str, float] = {}
    lifted: list[Lifted] = []
    legs = drawn_legs(file)
    for i, leg in enumerate(legs):
        prefix, place = f"leg{i + 1}/", f"{where}, leg {i + 1}"
        drawing = leg.drawing
        description = described(leg, beside) if drawing is None else drawing.description
        end = chosen_frame(description, leg.frame, place, notes, f"leg {i + 1}: ")
        tree = tree_to(description, [end], leg.locked, place, notes, leg.flexible)
        notes += description_notes(description, tree, leg.model_fields_set)
        if leg.contact != "rigid":
            tree = extended(tree, end, _CONTACTS[leg.contact], "contact")
            end = "contact"
            contacts += [f"{prefix}{joint}" for joint, _ in _CONTACTS[leg.contact]]
        names = [c.name for c in tree.coordinates]
        for entries, key in ((leg.springs, "springs"), (leg.passive, "passive"), (leg.q, "q")):
            for joint in entries:
                check_name("joint", joint, names, f"{place}, key {key}")
        springs |= {prefix + joint: entry for joint, entry in leg.springs.items()}
        passive += [prefix + joint for joint in leg.passive]
        posture |= {prefix + joint: value for joint, value in leg.q.items()}
        virtual += virtual_joints(leg.flexible, prefix)
        soft.append((i, leg))
        parts.append((prefix, tree, pose_of(leg.base)))
        facts = description.facts
        file_springs |= {prefix + joint: spring for joint, spring in facts.springs.items()}
        file_passive += [prefix + joint for joint in facts.passive]
        drawn |= {prefix + joint: value for joint, value in facts.posture.items()}
        driven += [prefix + joint for joint in facts.actuated if joint in names]
        lifted += [replace(part, body=prefix + part.body) for part in facts.lifted]
        descriptions.append(description.shown(prefix))
        ends.append(prefix + end)
    tree = merged(parts)
    body = [f"body of leg {i + 1}" for i in range(len(ends))]
    offset = pose_of(file.offset)
    grips = [se3.inverse(offset) @ pose_of(leg.grip) for leg in legs]  # in M
    for frame, end, grip in zip(body, ends, grips, strict=True):
        _add_frame(tree, frame, end, se3.inverse(grip))
    chain = Chain(
        tree,
        body[0],
        closures=[Closure(body[0], other, "weld") for other in body[1:]],
        actuated=_actuated(file.actuated, tree, where),
        virtual=_indices(virtual, tree),
        kind="parallel",
        descriptions=descriptions,
    )
    chain.frame, chain.frame_offset = "body", fixed(offset)
    chain.legs = _placed(legs, grips, [c.name for c in tree.coordinates])
    add_payload(tree, chain, file.payload)
    facts = RobotFacts(file_springs, tuple(file_passive), posture=drawn)
    q = default_posture(tree, posture, where, facts=facts)
    if file.pose is not None:
        start = 0
        for i, (leg, (prefix, part, T_F_root)) in enumerate(zip(legs, parts, strict=True)):
            own = slice(start, start + part.n)
            start += part.n
            if leg.drawing is not None:
                continue  # it was drawn there
            q[own] = leg_at_pose(
                part,
                ends[i].removeprefix(prefix),
                se3.inverse(grips[i]),
                se3.inverse(T_F_root) @ pose_of(file.pose) @ offset,
                q[own],
                [j for j, c in enumerate(part.coordinates) if prefix + c.name in virtual],
                where,
                f"leg {i + 1}",
            )
    q = _assembled(chain, q, posture, where, notes)
    joint_springs, assumed = springs_of(
        springs,
        passive,
        tree,
        facts,
        where,
        virtual=[*virtual, *contacts],
        actuated=file.actuated or driven,
    )
    links = [
        spring
        for i, leg in soft
        for spring in link_springs(leg.flexible, tree, where, f"leg{i + 1}/")
    ]
    notes += assumed
    return put_together(file, name, chain, q, joint_springs, links, notes, where, lifted, springs)


def _placed(
    legs: Sequence[LegModel], grips: Sequence[Array], names: Sequence[str]
) -> tuple[PlacedLeg, ...]:
    """The legs that have been drawn from their names, among a chain's coordinates."""
    placed = []
    for i, leg in enumerate(legs):
        if (drawing := leg.drawing) is not None:
            at = {name: names.index(f"leg{i + 1}/{name}") for name in drawing.joints}
            placed.append(
                PlacedLeg(
                    drawing.shape,
                    tuple(at.values()),
                    at[drawing.driven],
                    grips[i],
                    drawing.diameter,
                )
            )
    return tuple(placed)


def build_closed_chain(
    file: ClosedChainFile, beside: Path | None, where: str, name: str
) -> ElasticMechanism:
    """A tree whose frames are tied by closures, from a file or from MJCF equalities."""
    description = described(file, beside, floating=file.floating)
    notes = gravity_left_out(file, description)
    return closed_chain_of(description, file, where, name, said=notes)


def closed_chain_of(
    description: RobotDescription,
    file: ClosedChainFile,
    where: str,
    name: str,
    posture: Mapping[str, float] | None = None,
    said: Sequence[Note] = (),
    alone: bool = False,
) -> ElasticMechanism:
    """`build_closed_chain` for a robot description that has been read; see `serial_of`.

    With `alone` there is only the description: joints that do not move the frame are left out, and
    its own actuators drive the chain.
    """
    notes, facts = [*said], description.facts
    frame = chosen_frame(description, file.frame, where, notes)
    moving = joints_that_move(description, frame) if alone else set(description.model.names)
    ends = [frame] if alone else None
    tree = tree_to(description, ends, file.locked, where, notes, file.flexible, moving)
    left = {c.name for c in tree.coordinates}
    ties = [tie for tie in facts.closures if tie.joints & moving]
    closures = [_mjcf_closure(tie, i, tree) for i, tie in enumerate(ties)]
    driven = [n for n in facts.actuated if n in left]
    actuated = driven if alone else file.actuated
    q = default_posture(tree, file.q, where, posture, facts)
    closures += [_closure(entry, i, tree, q, where) for i, entry in enumerate(file.closures)]
    virtual = virtual_joints(file.flexible)
    chain = Chain(
        tree,
        frame,
        offset=pose_of(file.offset),
        closures=closures,
        actuated=_actuated(actuated, tree, where),
        virtual=_indices(virtual, tree),
        kind="closed-chain",
        descriptions=[description.shown()],
    )
    add_payload(tree, chain, file.payload)
    q = _assembled(chain, q, file.q, where, notes)
    springs, assumed = springs_of(
        file.springs,
        file.passive,
        tree,
        facts,
        where,
        virtual=virtual,
        actuated=None if alone else file.actuated or driven,
    )
    links = link_springs(file.flexible, tree, where)
    notes += description_notes(description, tree, file.model_fields_set, closed=True)
    notes += assumed
    return put_together(
        file, name, chain, q, springs, links, notes, where, facts.lifted, file.springs
    )


def _closure(entry: ClosureModel, i: int, tree: KinematicTree, q: Array, where: str) -> Closure:
    """Closure of a file's entry; without points a frame is tied to "world" where it is at q."""
    place = f"{where}, closure {i + 1}"
    for frame in entry.frames:
        check_name("frame", frame, tree.frames, place)
    a, b = entry.frames
    if a == b:
        raise InputError("a closure ties a frame to itself", where=place, got=repr(a))
    if entry.points is not None:
        names = []
        for frame, point in zip((a, b), entry.points, strict=True):
            tied = f"{frame} (closure {i + 1})"
            _add_frame(tree, tied, frame, se3.pose(translation=point))
            names.append(tied)
        a, b = names
    elif "world" in (a, b):
        other = b if a == "world" else a
        T_F_other = tree.at(q).pose(tree.placement(other))
        tied = f"world (closure {i + 1})"
        tree.frames[tied] = FixedFrame(0, T_F_other)
        a, b = (tied, other) if a == "world" else (other, tied)
    return Closure(a, b, entry.type)


def _mjcf_closure(tie: FileClosure, i: int, tree: KinematicTree) -> Closure:
    a, b = f"{tie.body_a} (equality {i + 1})", f"{tie.body_b} (equality {i + 1})"
    _add_frame(tree, a, tie.body_a, tie.T_a)
    _add_frame(tree, b, tie.body_b, tie.T_b)
    return Closure(a, b, tie.type)
