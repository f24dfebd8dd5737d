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
from numpy.typing import NDArray

from cartstiff.errors import InputError, UnknownNameError
from cartstiff.geometry import se3
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import Coordinate
from cartstiff.mechanisms.flexible_links import (
    SEGMENT,
    UNFRAMED,
    DeflectionMass,
    Give,
    Place,
    masses_by_side,
    springs_by_joint,
)
from cartstiff.mechanisms.tree import (
    PLAIN,
    WORLD,
    FixedFrame,
    KinematicTree,
    axis_coordinate,
    check_coordinates,
    expansion,
    limits_of_joint,
    planar,
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
    still = [i for i in range(1, model.njoints) if i not in kept]
    # Pinocchio joins links faster than the loop below. It crashes where a joint has no
    # frame of its own (joints from files have one), and refuses several frames of one
    # name.
    joints = list(model.names)[1:]
    if (
        still
        and not flexible
        and all(model.existFrame(name, pin.JOINT) for name in joints)
    ):
        with suppress(ValueError):
            model = pin.buildReducedModel(model, still, fixed_q)
            kept, locked = set(range(1, model.njoints)), {}
    # Access to one of Pinocchio's lists costs as much as the arithmetic.
    parents, names = model.parents.tolist(), list(model.names)
    placements = [T.homogeneous for T in model.jointPlacements]

    plain = pin.Model()
    plain.name = model.name
    plain.gravity = model.gravity
    coordinates: list[Coordinate] = []
    near: dict[int, Place] = {0: (0, np.eye(4))}
    beyond: dict[int, list[tuple[frozenset[int], Place]]] = {}
    springs = springs_by_joint(model, flexible or {})
    rotors: list[DeflectionMass] = []

    def side(frame: int, joint: int) -> Place:
        """Place that carries a frame on a joint: the joint,
        or the last spring that carries it.
        """
        if joint not in beyond:
            return near[joint]
        carriers = [place for carried, place in beyond[joint] if frame in carried]
        if frame == UNFRAMED and len(carriers) > 1:
            raise InputError(
                "several compliant links are fixed together, and a joint has no frame "
                "that tells "
                "which of them carries it",
                expected="a frame for each joint",
            )
        return carriers[-1] if carriers else near[joint]

    def carry(joint: int, T_j: Array, inertia: Any) -> None:
        """Fix a mass to a joint."""
        if inertia is not None and joint > 0:
            plain.appendBodyToJoint(joint, inertia, pin.SE3(T_j))

    def soften(i: int) -> None:
        for spring in springs.get(i, ()):
            give = spring.give
            joint, T_j = side(spring.frame, i)
            T_j = T_j @ give.start
            carry(joint, T_j, give.half(1.0))
            if give.mass is not None:
                first = len(coordinates)
                rotors.append(DeflectionMass(spring.link, joint, T_j, first, give.mass))
            count = len(give.joints)
            for k, (suffix, kind, along) in enumerate(give.joints, start=1):
                full = f"{spring.link}.{suffix}"
                T_j = T_j @ se3.pose(translation=(along, 0.0, 0.0))
                joint = plain.addJoint(joint, primitive(kind), pin.SE3(T_j), full)
                coordinates.append(axis_coordinate(full, kind))
                T_j = np.eye(4)
                if k % len(SEGMENT) == 0:  # a node of the beam
                    carry(joint, T_j, give.half(-1.0))
                    carry(joint, T_j, give.half(1.0) if k < count else None)
            place = joint, se3.inverse(give.end)
            beyond.setdefault(i, []).append((spring.carried, place))
        for (joint, T_j), inertia in masses_by_side(model, i, side, near[i], i in beyond):
            carry(joint, T_j, inertia)

    soften(0)
    frame_of: dict[int, int] = {}
    if beyond or springs:
        frame_of = {
            f.parentJoint: k
            for k, f in enumerate(model.frames)
            if f.type == pin.FrameType.JOINT
        }
    for i in range(1, model.njoints):
        parent, T_p = side(frame_of.get(i, UNFRAMED), parents[i])
        if i not in kept:
            is_at_zero = i not in locked and model.joints[i].shortname() in PLAIN
            T = placements[i] if is_at_zero else standing(model, i, fixed_q).homogeneous
            near[i] = (parent, T_p @ T)
        else:
            T = T_p @ placements[i]
            parts = expansion(model.joints[i], names[i])
            if names[i] in (planar_axes or {}):
                parts = planar(names[i], (planar_axes or {})[names[i]])
            for k, (name, kind, joint, T_part) in enumerate(
                parts, start=int(model.idx_vs[i])
            ):
                lower, upper = (
                    limits_of_joint(model, i) if len(parts) == 1 else (-np.inf, np.inf)
                )
                unique = free_name(name, [c.name for c in coordinates])
                parent = plain.addJoint(parent, joint, pin.SE3(T @ T_part), unique)
                plain.armature[plain.idx_vs[parent]] = model.armature[k]
                plain.damping[plain.idx_vs[parent]] = model.damping[k]
                coordinates.append(Coordinate(unique, kind, lower, upper))  # type: ignore[arg-type]
                T = np.eye(4)
            near[i] = (parent, T)
        soften(i)

    def placed(k: int, frame: Any) -> FixedFrame:
        joint, T_j = side(k, frame.parentJoint)
        return FixedFrame(joint, T_j @ frame.placement.homogeneous)

    def frames(name: str | None = None) -> dict[str, FixedFrame]:
        places_of = {"world": WORLD}
        if name is not None:
            with suppress(UnknownNameError):
                k = _index_of_frame(model, name)
                places_of.setdefault(name, placed(k, model.frames[k]))
            return places_of
        every = list(model.frames)
        kinds = {k: _precedence(f.type) for k, f in enumerate(every)}
        for k in sorted(kinds, key=kinds.__getitem__):
            places_of.setdefault(every[k].name, placed(k, every[k]))
        return places_of

    n = len(coordinates)
    rows = [rotor.added(plain, n) for rotor in rotors]
    mimic = np.concatenate([np.eye(n), *rows]) if rows else None
    return KinematicTree(plain, tuple(coordinates), frames, mimic)


def merged(parts: Sequence[tuple[str, KinematicTree, Array]]) -> KinematicTree:
    """Join several trees, each a triple (prefix of its names, tree, ``T_F_root``)."""
    ((first, only, T_F_only), *others) = parts
    if not (others or first) and np.array_equal(T_F_only, np.eye(4)):
        return only
    model = pin.Model()
    coordinates: list[Coordinate] = []
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
            if prefix or name != "world":
                frames[prefix + name] = FixedFrame(at[p.joint], T)
    # Coordinates that several joints follow.
    mimic = None
    if any(tree.mimic is not None for _, tree, _ in parts):
        every = [
            np.eye(tree.n) if tree.mimic is None else tree.mimic for _, tree, _ in parts
        ]
        mimic = _block_diagonal(every)
    offset = np.concatenate([tree.offset for _, tree, _ in parts])
    return KinematicTree(model, tuple(coordinates), frames, mimic, offset)


def _block_diagonal(blocks: Sequence[Array]) -> Array:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))


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
    mimic = tree.mimic
    if mimic is not None:
        mimic = _block_diagonal([mimic, np.eye(len(new))])
    offset = np.append(tree.offset, np.zeros(len(new)))
    return KinematicTree(model, (*tree.coordinates, *new), frames, mimic, offset)


def part_of(
    tree: KinematicTree, joints: Sequence[int], root: int = 0
) -> tuple[KinematicTree, NDArray[np.intp]]:
    """Return some joints as a tree of their own, and the indices of their coordinates.

    Parameters
    ----------
    tree : KinematicTree
        The whole.
    joints : sequence of int
        Joints counted from 1, ascending, each carried by one of them or by `root`.
    root : int
        Joint in whose frame the part is placed.

    Notes
    -----
    Joint k + 1 of the part is ``joints[k]``. It has no named frames but "world".
    """
    model, at = pin.Model(), {root: 0}
    for j in joints:
        at[j] = tree.copy_joint(j, model, at[int(tree.model.parents[j])])
    rows = np.asarray(joints, np.intp) - 1
    mimic, columns = tree.mimic, rows
    if mimic is not None:
        columns = np.flatnonzero(np.abs(mimic[rows]).sum(axis=0))
        mimic = mimic[np.ix_(rows, columns)]
    coordinates = tuple(tree.coordinates[c] for c in columns)
    return KinematicTree(
        model, coordinates, {"world": WORLD}, mimic, tree.offset[rows]
    ), columns


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, with a number behind it if it is taken."""
    if name not in taken:
        return name
    k = 2
    while f"{name}_{k}" in taken:
        k += 1
    return f"{name}_{k}"
