"""Rewrite Pinocchio models as plain trees; join and extend such trees.

Continuous joints become plain revolutes, spherical, planar and composite joints are
expanded, locked joints become links, compliant links get six virtual joints.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.contract import Coordinate
from cartstiff.core.mechanisms.tree import (
    WORLD,
    FixedFrame,
    KinematicTree,
    check_coordinates,
)
from cartstiff.files.flexible_links import (
    SEGMENT,
    UNFRAMED,
    DeflectionMass,
    Give,
    Place,
    springs_by_joint,
)
from cartstiff.files.plain_joints import (
    axis_coordinate,
    expansion,
    limits_of_joint,
    primitive,
    set_position,
    standing,
)


def find_frame(model: pin.Model, name: str) -> Any:
    """Return Pinocchio's frame of a name: a link before a site before a joint of
    the same name.

    Raises
    ------
    UnknownNameError
        With the names that exist.
    """
    return model.frames[_index_of_frame(model, name)]


def _index_of_frame(model: pin.Model, name: str) -> int:
    for kind in (
        _PREFERRED
    ):  # Pinocchio's search is faster, if one frame of the kind has the name
        with suppress(ValueError):
            if model.existFrame(name, kind):
                return int(model.getFrameId(name, kind))
    every = [f.name for f in model.frames]
    named = [i for i, other in enumerate(every) if other == name]
    if not named:
        raise UnknownNameError("frame", name, every)
    return min(named, key=lambda i: _precedence(model.frames[i].type))


_PREFERRED = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)


def _precedence(kind: Any) -> int:
    """Rank of links, sites and joints with the same name."""
    return _PREFERRED.index(kind) if kind in _PREFERRED else len(_PREFERRED)


def plain_tree(
    model: pin.Model,
    keep: Collection[int] | None = None,
    locked: Mapping[int, float] | None = None,
    flexible: Mapping[str, Give] | None = None,
    planar_axes: Mapping[str, Array] | None = None,
) -> KinematicTree:
    """Rewrite a Pinocchio model with one-coordinate joints only.

    Parameters
    ----------
    model : pinocchio.Model
        Any model; it is not modified.
    keep : collection of int, optional
        Indices of joints that stay movable; all others become links at their neutral
        position. Default: all.
    locked : mapping of int to float, optional
        Positions of one-coordinate joints that become links.
    flexible : mapping of str to Give, optional
        Compliant links by frame name: virtual joints are added there, which carry
        everything that the link carries; the link's own frame and mass stay at the near
        side.
    planar_axes : mapping of str to ndarray (3,), optional
        Unit normals of the planes in which planar joints move, by joint name; default z.

    Raises
    ------
    InputError
        For a joint type that cannot be expanded.
    """
    check_coordinates(model)
    locked = dict(locked or {})
    kept = set(range(1, model.njoints) if keep is None else keep) - set(locked)
    fixed_q = pin.neutral(model)
    for index, value in locked.items():
        set_position(model, index, value, fixed_q)
    if not flexible:
        reduced = _reduced(model, kept, fixed_q)
        if reduced is not model:
            model, kept = reduced, set(range(1, reduced.njoints))
    new = _PlainTree(model, flexible)
    # Access to one of Pinocchio's lists costs as much as the arithmetic.
    parents, names = model.parents.tolist(), list(model.names)
    placements = [T.homogeneous for T in model.jointPlacements]
    for i in range(1, model.njoints):
        place = new.side(new.frame_of.get(i, UNFRAMED), parents[i])
        if i in kept:
            normal = (planar_axes or {}).get(names[i])
            parts = expansion(model.joints[i], names[i], normal)
            new.move(i, _beyond(place, placements[i]), parts)
        else:
            new.near[i] = _beyond(place, standing(model, i, fixed_q).homogeneous)
        new.soften(i)
    return new.tree()


def _reduced(model: pin.Model, kept: Collection[int], q: Array) -> pin.Model:
    """The model with the kept joints only, where Pinocchio makes it: faster than here.

    It crashes where a joint has no frame of its own (joints from files have one), and
    refuses several frames of one name.
    """
    still = [i for i in range(1, model.njoints) if i not in kept]
    framed = (model.existFrame(name, pin.JOINT) for name in list(model.names)[1:])
    if still and all(framed):
        with suppress(ValueError):
            return pin.buildReducedModel(model, still, q)
    return model


def _beyond(place: Place, T: Array) -> Place:
    """Place at a pose in the frame of another."""
    joint, T_j = place
    return joint, T_j @ T


class _PlainTree:
    """A tree of one-coordinate joints, while it is made from a model.

    Attributes
    ----------
    near : dict
        Place of each of the model's joints that has been made.
    beyond : dict
        For joints with compliant links: the frames that each link carries, and the place
        at its far side.
    frame_of : dict
        Frame of each joint, where compliant links may carry it.
    """

    def __init__(self, model: pin.Model, flexible: Mapping[str, Give] | None) -> None:
        self.model = model
        self.plain = pin.Model()
        self.plain.name = model.name
        self.plain.gravity = model.gravity
        self.coordinates: list[Coordinate] = []
        self.near: dict[int, Place] = {0: (0, np.eye(4))}
        self.beyond: dict[int, list[tuple[frozenset[int], Place]]] = {}
        self.springs = springs_by_joint(model, flexible)
        self.rotors: list[DeflectionMass] = []
        self.frame_of: dict[int, int] = {}
        if self.springs:
            joints = enumerate(model.frames)
            kind = pin.FrameType.JOINT
            self.frame_of = {f.parentJoint: k for k, f in joints if f.type == kind}
        self.soften(0)

    def side(self, frame: int, joint: int) -> Place:
        """Place that carries a frame on a joint: the joint,
        or the last spring that carries it.
        """
        beyond = self.beyond.get(joint, [])
        carriers = [place for carried, place in beyond if frame in carried]
        if frame == UNFRAMED and len(carriers) > 1:
            raise InputError(
                "several compliant links are fixed together, and a joint has no frame "
                "that tells which of them carries it",
                expected="a frame for each joint",
            )
        return carriers[-1] if carriers else self.near[joint]

    def move(
        self, i: int, place: Place, parts: Sequence[tuple[str, str, Any, Array]]
    ) -> None:
        """Add the one-coordinate joints that replace a joint of the model."""
        model, plain, (parent, T) = self.model, self.plain, place
        limits = -np.inf, np.inf
        if len(parts) == 1:
            limits = limits_of_joint(model, i)
        for k, (name, kind, joint, T_part) in enumerate(parts, int(model.idx_vs[i])):
            unique = free_name(name, [c.name for c in self.coordinates])
            parent = plain.addJoint(parent, joint, pin.SE3(T @ T_part), unique)
            plain.armature[plain.idx_vs[parent]] = model.armature[k]
            plain.damping[plain.idx_vs[parent]] = model.damping[k]
            self.coordinates.append(Coordinate(unique, kind, *limits))  # type: ignore[arg-type]
            T = np.eye(4)
        self.near[i] = parent, T

    def soften(self, i: int) -> None:
        """Add the virtual joints of the compliant links on a joint, and its masses."""
        for spring in self.springs.get(i, ()):
            give = spring.give
            joint, T_j = _beyond(self.side(spring.frame, i), give.start)
            self.carry(joint, T_j, give.half(1.0))
            if give.mass is not None:
                first = len(self.coordinates)
                mass = DeflectionMass(spring.link, joint, T_j, first, give.mass)
                self.rotors.append(mass)
            count = len(give.joints)
            for k, (suffix, kind, along) in enumerate(give.joints, start=1):
                name = f"{spring.link}.{suffix}"
                T_j = T_j @ se3.pose(translation=(along, 0.0, 0.0))
                joint = self.plain.addJoint(joint, primitive(kind), pin.SE3(T_j), name)
                self.coordinates.append(axis_coordinate(name, kind))
                T_j = np.eye(4)
                if k % len(SEGMENT) == 0:  # a node of the beam
                    self.carry(joint, T_j, give.half(-1.0))
                    self.carry(joint, T_j, give.half(1.0) if k < count else None)
            place = joint, se3.inverse(give.end)
            self.beyond.setdefault(i, []).append((spring.carried, place))
        self.carry_masses(i)

    def carry(self, joint: int, T_j: Array, inertia: Any) -> None:
        """Fix a mass to a joint."""
        if inertia is not None and joint > 0:
            self.plain.appendBodyToJoint(joint, inertia, pin.SE3(T_j))

    def carry_masses(self, i: int) -> None:
        """Fix the masses on a joint of the model: on its own side,
        and beyond each spring.
        """
        # Pinocchio stores the masses of fixed links with their frames, but not that of
        # the moved link.
        own, near = self.model.inertias[i], self.near[i]
        beyond: list[tuple[Place, Any]] = []
        for k, frame in enumerate(self.model.frames if i in self.beyond else ()):
            inertia = frame.placement.act(frame.inertia)
            has_mass = inertia.mass > 0
            if int(frame.parentJoint) != i or not (has_mass or inertia.inertia.any()):
                continue
            if (place := self.side(k, i)) is not near:
                # Pinocchio's difference is NaN where neither has a mass.
                left = own.inertia - inertia.inertia
                weightless = pin.Inertia(own.mass, own.lever, left)
                own = own - inertia if has_mass else weightless
                beyond.append((place, inertia))
        for (joint, T_j), inertia in [(near, own), *beyond]:
            self.carry(joint, T_j, inertia)

    def frames(self, name: str | None = None) -> dict[str, FixedFrame]:
        """All frames of the model, or the named one, in the new tree."""
        placed, every, chosen = {"world": WORLD}, list(self.model.frames), list[int]()
        if name is None:
            kinds = [_precedence(f.type) for f in every]
            chosen = sorted(range(len(every)), key=kinds.__getitem__)
        else:
            with suppress(UnknownNameError):
                chosen = [_index_of_frame(self.model, name)]
        for k in chosen:
            frame = every[k]
            place = self.side(k, frame.parentJoint)
            at = FixedFrame(*_beyond(place, frame.placement.homogeneous))
            placed.setdefault(frame.name, at)
        return placed

    def tree(self) -> KinematicTree:
        """The tree, when all joints have been made."""
        n = len(self.coordinates)
        rows = [rotor.added(self.plain, n) for rotor in self.rotors]
        mimic = np.concatenate([np.eye(n), *rows]) if rows else None
        return KinematicTree(self.plain, tuple(self.coordinates), self.frames, mimic)


def merged(parts: Sequence[tuple[str, KinematicTree, Array]]) -> KinematicTree:
    """Join several trees, each a triple (prefix of its names, tree, ``T_F_root``)."""
    ((first, only, T_F_only), *others) = parts
    if not (others or first) and np.array_equal(T_F_only, np.eye(4)):
        return only
    model = pin.Model()
    coordinates, mimics, offsets = list[Coordinate](), [], []
    frames: dict[str, FixedFrame] = {"world": WORLD}
    # Joints, coordinates and frames of each tree, at its root.
    for prefix, tree, T_F_root in parts:
        at = {0: 0}
        for j in range(1, tree.model.njoints):
            parent = at[int(tree.model.parents[j])]
            at[j] = tree.copy_joint(j, model, parent, T_F_root, prefix)
        coordinates += [replace(c, name=prefix + c.name) for c in tree.coordinates]
        for name, p in tree.frames.items():
            T = T_F_root @ p.T_j_f if p.joint == 0 else p.T_j_f
            frames[prefix + name] = FixedFrame(at[p.joint], T)
        mimics.append((tree.mimic, tree.n))
        offsets.append(tree.offset)
    frames["world"] = WORLD  # that of a tree without a prefix is its root
    offset = np.concatenate(offsets)
    return KinematicTree(model, tuple(coordinates), frames, _mimics(mimics), offset)


def _mimics(parts: Sequence[tuple[Array | None, int]]) -> Array | None:
    """Matrix of joints that follow coordinates, of trees beside each other: each with its
    own matrix, if any, and its number of coordinates.
    """
    if all(mimic is None for mimic, _ in parts):
        return None
    from scipy.linalg import block_diag

    each = [np.eye(n) if mimic is None else mimic for mimic, n in parts]
    return np.asarray(block_diag(*each))


def extended(
    tree: KinematicTree, frame: str, joints: Sequence[tuple[str, str]], end: str
) -> KinematicTree:
    """Return the tree with more joints (name, kind as "RX") from a frame to a new
    frame `end`.
    """
    at = tree.placement(frame)
    model = tree.model.copy()
    joint, T = at.joint, at.T_j_f
    new = []
    for name, kind in joints:
        joint = model.addJoint(joint, primitive(kind), pin.SE3(T), name)
        new.append(axis_coordinate(name, kind))
        T = np.eye(4)
    frames = {**tree.frames, end: FixedFrame(joint, T)}
    # Pinocchio keeps joints in the order of their addition: the new ones are last.
    mimic = _mimics([(tree.mimic, tree.n), (None, len(new))])
    offset = np.append(tree.offset, np.zeros(len(new)))
    return KinematicTree(model, (*tree.coordinates, *new), frames, mimic, offset)


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, with a number behind it if it is taken."""
    if name not in taken:
        return name
    k = 2
    while f"{name}_{k}" in taken:
        k += 1
    return f"{name}_{k}"
