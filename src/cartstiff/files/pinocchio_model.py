"""Build elastic mechanisms from Pinocchio models.

The model is copied and not changed; the order of its joints and their names are kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, checked_vector
from cartstiff.core.errors import InputError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import Note
from cartstiff.files.bare import Bare, places_in, with_overrides
from cartstiff.files.description import Followers, RobotDescription, successive_turns
from cartstiff.files.passes import one_robot
from cartstiff.files.plain_joints import expansion, standing
from cartstiff.files.visuals import geometry_pieces

_TYPES = {pin.ContactType.CONTACT_3D: "point", pin.ContactType.CONTACT_6D: "weld"}
#: Reference configurations that are the default posture, in this order of preference.
_HOME_NAMES = ("home", "half_sitting", "standing", "default")
#: Largest deviation of a quaternion's norm from 1, and of a follower's turn from zero.
_TOLERANCE = numerics.NEGLIGIBLE_DISTANCE


def is_pinocchio(source: object) -> bool:
    """Whether `from_pinocchio` accepts an object as its first argument."""
    if isinstance(source, tuple):
        return bool(source) and isinstance(source[0], pin.Model)
    return isinstance(source, (pin.Model, pin.RobotWrapper))


def of_pinocchio(
    model: Any,
    overrides: Mapping[str, Any],
    visual: Any = None,
    q: ArrayLike | None = None,
    closures: Sequence[Any] = (),
    actuated: Sequence[str] = (),
    floating: bool = False,
    name: str | None = None,
) -> ElasticMechanism:
    """Build the mechanism of an object of Pinocchio with overrides.

    The other parameters are those of `cartstiff.files.loading.ModelSetup`.
    """
    wrapper = None
    if isinstance(model, pin.RobotWrapper):
        wrapper, model, visual = model, model.model, visual or model.visual_model
    elif isinstance(model, tuple):
        model, visual = model[0], visual or (model[-1] if len(model) > 1 else None)
    if visual is not None and not isinstance(visual, pin.GeometryModel):
        raise InputError(
            "not a geometry model",
            expected="pinocchio.GeometryModel",
            got=type(visual).__name__,
        )
    name = name or model.name or "pinocchio model"
    where = f"Pinocchio model {name!r}"
    # The model becomes the description that the readers of files return.
    configuration, notes = _configuration(model, wrapper, q)
    own, mimics = _with_plain_joints(model)
    ties = [_tie(own, closure, i, where) for i, closure in enumerate(closures)]
    pieces, words = ([], []) if visual is None else geometry_pieces(model, visual, name)
    notes += [Note("not-shown", word) for word in words]
    held = frozenset() if floating else _hold_root(own, model, configuration, notes)
    description = RobotDescription(
        own,
        pieces=tuple(pieces),
        held=held,
        efforts=_efforts(model),
        followers=mimics,
    )
    posture = {} if configuration is None else _positions(model, configuration, mimics)
    posture = {n: x for n, x in posture.items() if n not in overrides["locked"]}
    if not ties and actuated:
        raise InputError(
            "actuated joints are named, but there are no closures",
            where=where,
            expected="closures=[pinocchio.RigidConstraintModel(...)]",
        )
    with places_in(where):
        says: dict[str, Any] = {"model": name}
        if ties:
            says |= {"closures": ties, "actuated": list(actuated)}
            says["kind"] = "closed-chain"
        file = with_overrides(Bare(**says), overrides)
        return one_robot(description, file, name, notes, posture=posture)


def _efforts(model: Any) -> dict[str, tuple[float, float]]:
    """Least and largest torques of joints with one coordinate; zero says that they are
    not known.
    """
    found = dict[str, tuple[float, float]]()
    for i in range(1, model.njoints):
        v = model.idx_vs[i]
        pair = float(model.lowerEffortLimit[v]), float(model.upperEffortLimit[v])
        # Pinocchio's largest float is no limit.
        if model.nvs[i] == 1 and any(0.0 < abs(x) < 1e300 for x in pair):
            found[str(model.names[i])] = pair
    return found


def _configuration(
    model: Any, wrapper: Any, q: ArrayLike | None
) -> tuple[Array | None, list[Note]]:
    """The given posture, or that of the model with a note on it."""
    if q is not None:
        what = "q (a configuration of the Pinocchio model)"
        return checked_vector(q, model.nq, what), []
    if wrapper is not None and np.asarray(wrapper.q0).shape == (model.nq,):
        note = Note("default-posture", "no posture was given: the wrapper's q0 is taken")
        return np.array(wrapper.q0, float), [note]
    kept = {
        entry.key(): np.array(entry.data(), float)
        for entry in model.referenceConfigurations
    }
    # The best of the usual names, or the only one.
    named = [*filter(kept.__contains__, _HOME_NAMES)] or [*kept] * (len(kept) == 1)
    if not named or kept[named[0]].shape != (model.nq,):
        return None, []
    chosen = named[0]
    words = (
        f"no posture was given: the model's reference configuration {chosen!r} is taken"
    )
    return kept[chosen], [Note("default-posture", words)]


def _hold_root(
    own: Any, model: Any, q: Array | None, notes: list[Note]
) -> frozenset[str]:
    """Place a free-flying root as in the configuration.

    Return its name among the held joints.
    """
    roots = [
        i
        for i, parent in enumerate(model.parents)
        if i and parent == 0 and model.joints[i].shortname() == "JointModelFreeFlyer"
    ]
    for i in roots:
        pose = standing(model, i, pin.neutral(model) if q is None else q)
        own.jointPlacements[i] = pose
        words = (
            f"the free-flying joint {model.names[i]!r} is held; floating=True lets "
            "it move"
        )
        notes.append(Note("root-held", words, {"pose": pose.homogeneous.tolist()}))
    return frozenset(model.names[i] for i in roots)


def _with_plain_joints(model: Any) -> tuple[Any, Followers]:
    """Copy of a model with plain joints in place of mimic joints,
    and the couplings of these.
    """
    followers = [int(j) for j in model.mimicking_joints]
    if not followers:
        return model.copy(), {}
    leaders = [int(j) for j in model.mimicked_joints]
    plain = pin.Model()
    plain.name, plain.gravity = model.name, model.gravity
    mimics: Followers = {}
    data = pin.Data(model)
    for i in range(1, model.njoints):
        joint = model.joints[i]
        limits: list[Array] = []
        if i in followers:
            concrete = joint.extract()
            leader = leaders[followers.index(i)]
            factor, offset = float(concrete.scaling), float(concrete.offset)
            joint = _follower(model, data, i, leader, factor, offset)
            mimics[model.names[i]] = model.names[leader], factor, offset
        else:
            own = slice(joint.idx_q, joint.idx_q + joint.nq)
            limits = [np.full(joint.nv, np.inf)] * 2  # of efforts and velocities
            limits += [model.lowerPositionLimit[own], model.upperPositionLimit[own]]
        parent, placement = int(model.parents[i]), model.jointPlacements[i]
        index = plain.addJoint(parent, joint, placement, model.names[i], *limits)
        plain.appendBodyToJoint(index, model.inertias[i], pin.SE3.Identity())
    for entry in list(model.frames)[1:]:
        plain.addFrame(entry, False)
    return plain, mimics


def _follower(
    model: Any, data: Any, i: int, leader: int, factor: float, offset: float
) -> Any:
    """Joint inside a mimic joint, which has no attribute for it, from its motion."""
    if factor == 0.0:
        raise InputError(
            f"joint {model.names[i]!r} follows {model.names[leader]!r} with the factor "
            "zero",
            expected="a fixed joint",
        )
    q = pin.neutral(model)
    poses = []
    for position in (0.0, 1.0):
        q[model.joints[leader].idx_q] = (position - offset) / factor
        pin.forwardKinematics(model, data, q)
        poses.append((model.jointPlacements[i].inverse() * data.liMi[i]).homogeneous)
    twist = se3.log(se3.inverse(poses[0]) @ poses[1])
    if np.abs(twist[:3]).max() > _TOLERANCE:
        return pin.JointModelRevoluteUnaligned(twist[:3] / np.linalg.norm(twist[:3]))
    return pin.JointModelPrismaticUnaligned(twist[3:] / np.linalg.norm(twist[3:]))


def _tie(model: Any, closure: Any, i: int, where: str) -> SimpleNamespace:
    """Closure of two frames that are added to the model for a constraint."""
    if not isinstance(closure, pin.RigidConstraintModel) or closure.type not in _TYPES:
        raise InputError(
            f"closure {i + 1} cannot be used",
            where=where,
            expected="pinocchio.RigidConstraintModel of type CONTACT_3D or CONTACT_6D",
            got=type(closure).__name__,
        )
    names: list[str] = []
    for joint, T in (
        (closure.joint1_id, closure.joint1_placement),
        (closure.joint2_id, closure.joint2_placement),
    ):
        if not 0 <= joint < model.njoints:
            raise InputError(
                f"closure {i + 1} names a joint that does not exist",
                where=where,
                expected=f"0 to {model.njoints - 1}",
                got=joint,
            )
        name = f"{model.names[joint]} (closure {i + 1}, side {len(names) + 1})"
        model.addFrame(pin.Frame(name, joint, T, pin.FrameType.OP_FRAME))
        names.append(name)
    kind = _TYPES[closure.type]
    return SimpleNamespace(frames=names, type=kind, points=None, axes=None)


def _positions(model: Any, q: Array, mimics: Followers) -> dict[str, float]:
    """Positions in a configuration by the names of the coordinates."""
    positions: dict[str, float] = {}
    for i in range(1, model.njoints):
        joint, name = model.joints[i], model.names[i]
        if name in mimics:
            continue
        part = q[joint.idx_q : joint.idx_q + joint.nq]
        for (coordinate, *_), value in zip(
            expansion(joint, name), _split(joint, part), strict=True
        ):
            positions[coordinate] = float(value)
    return positions


def _split(joint: Any, q: Array) -> list[float]:
    """Positions in a configuration of the one-coordinate joints that replace a joint."""
    kind = joint.shortname()
    if kind == "JointModelComposite":
        values = []
        for part in joint.extract().joints:
            start = part.idx_q - joint.idx_q
            values += _split(part, q[start : start + part.nq])
        return values
    if kind == "JointModelPlanar":
        return [q[0], q[1], np.arctan2(q[3], q[2])]
    if kind in ("JointModelSpherical", "JointModelFreeFlyer"):
        if abs(np.linalg.norm(q[-4:]) - 1.0) > _TOLERANCE:
            raise InputError(
                "the configuration's quaternion is not of unit length",
                where=f"joint {kind}",
                got=q[-4:].tolist(),
            )
        return [
            *q[:-4],
            *successive_turns(pin.XYZQUATToSE3(np.r_[0.0, 0.0, 0.0, q[-4:]]).homogeneous),
        ]
    if joint.nq == 2 and joint.nv == 1:  # cosine and sine of an unbounded angle
        return [np.arctan2(q[1], q[0])]
    return list(q)
