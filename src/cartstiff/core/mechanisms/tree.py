r"""Kinematic trees of one-degree-of-freedom joints, computed by Pinocchio.

Every joint has one coordinate and a constant axis (`cartstiff.files.tree_building`
rewrites any Pinocchio model so). The second derivative of every pose is then a Lie
bracket,

    d J[:, a] / d q_b = [J_a, J_b] for joint a before joint b on the way to the frame,
    else 0,

exact, with no tensor; Pinocchio's own second derivatives are not used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from cartstiff.core.arrays import Array
from cartstiff.core.errors import InputError, UnknownNameError
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.se3 import SWAP
from cartstiff.core.lazily import cached_property
from cartstiff.core.mechanisms.contract import Coordinate
from cartstiff.core.potentials.contract import (
    POSE,
    Evaluation,
    SecondOrderMap,
    rescaled,
)

#: Largest number for a tree. Pinocchio's workspace grows with its cube: 200 take 0.3 GB,
#: 600 7 GB.
MOST_COORDINATES = 200


def check_coordinates(model: pin.Model) -> None:
    """Refuse a model with more than `MOST_COORDINATES` before memory is allocated for it.

    Raises
    ------
    InputError
        With their number.
    """
    if model.nv > MOST_COORDINATES:
        raise InputError(
            "too many coordinates", expected=f"at most {MOST_COORDINATES}", got=model.nv
        )


def add_joint(
    model: pin.Model, parent: int, joint: Any, T: Array, name: str, limits: ArrayLike
) -> int:
    """Add a joint with one coordinate to a Pinocchio model, and return its index.

    It turns or slides in the frame at the pose T (4, 4) of its `parent`, the index of a
    joint; `limits` (2,) are in its unit.
    """
    unbounded = np.full(1, np.inf)  # efforts and velocities
    lower, upper = np.array(limits, float)[:, None]
    added = model.addJoint(
        parent, joint, pin.SE3(T), name, unbounded, unbounded, lower, upper
    )
    return int(added)


@dataclass(frozen=True, eq=False)
class FixedFrame:
    """A frame fixed to a joint of the tree: ``T_j_f`` with the joint's index."""

    joint: int
    T_j_f: Array

    length_powers: ClassVar = {"T_j_f": POSE}


#: The inertial frame F.
WORLD = FixedFrame(0, np.eye(4))


@dataclass(frozen=True, eq=False)
class Route:
    """Joints on the path from one frame to another, in order.

    Attributes
    ----------
    order : ndarray of int
        Joints (counted from 0) in the order of the path: from frame a up to the common
        ancestor, then down to frame b.
    signs : ndarray
        For every joint of the tree: -1 on the path up, +1 on the path down, 0 elsewhere.
    """

    order: NDArray[np.intp]
    signs: Array


class KinematicTree:
    """A plain tree with named frames.

    Attributes
    ----------
    model : pinocchio.Model
        Every joint has one coordinate; never modified after construction.
    coordinates : tuple of Coordinate
        One per joint, in Pinocchio's order.
    mimic : ndarray (joints, n) or None
        Matrix of joints that follow others: joint positions are ``mimic @ q + offset``.

    Raises
    ------
    InputError
        For more than `MOST_COORDINATES`.
    """

    def __init__(
        self,
        model: pin.Model,
        coordinates: tuple[Coordinate, ...],
        frames: Mapping[str, FixedFrame] | Callable[..., dict[str, FixedFrame]],
        mimic: Array | None = None,
        offset: Array | None = None,
    ) -> None:
        check_coordinates(model)
        self.model, self.coordinates = model, coordinates
        #: Frames, or a function that returns all of them, or the named one.
        self.given_frames = frames if callable(frames) else dict(frames)
        self.mimic, self.offset = (
            mimic,
            np.zeros(model.nv) + (0.0 if offset is None else offset),
        )
        self._parents = [int(p) for p in model.parents]
        self._paths: dict[tuple[int, int], Route] = {}
        self._workspaces: list[Any] = []

    def __getstate__(self) -> dict[str, Any]:
        """State without caches and workspaces."""
        emptied: dict[str, Any] = {"given_frames": {}, "_paths": {}, "_workspaces": []}
        return {**vars(self), "frames": self.frames, **emptied}

    @cached_property
    def frames(self) -> dict[str, FixedFrame]:
        """All named frames."""
        frames = self.given_frames
        return frames() if callable(frames) else frames

    @contextmanager
    def workspace(self) -> Iterator[Any]:
        """Provide Pinocchio's workspace of the model, one for each simultaneous use.

        Workspaces cost more to make than to use, and grow with the cube of the
        coordinates.
        """
        try:
            data = self._workspaces.pop()
        except IndexError:
            data = pin.Data(self.model)  # `createData` would hand over a copy
        try:
            yield data
        finally:
            self._workspaces.append(data)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @cached_property
    def names(self) -> list[str]:
        """Names of the coordinates."""
        return [c.name for c in self.coordinates]

    @cached_property
    def depth_first(self) -> tuple[KinematicTree, NDArray[np.intp]]:
        """Tree in depth-first order of the joints, and the indices of its coordinates
        in this one.

        Pinocchio's mass matrix and derivatives of gravity require this order. The tree
        itself is returned where it has this order.
        """
        here = np.arange(self.model.nv)
        supports = [{0, *self.support(j)} for j in range(self.model.njoints)]
        if all(self._parents[j] in supports[j - 1] for j in range(1, self.model.njoints)):
            return self, here
        order: list[int] = []
        left = [0]
        while left:
            joint = left.pop()
            order.append(joint)
            left += [
                j
                for j in range(self.model.njoints - 1, 0, -1)
                if self._parents[j] == joint
            ]
        order.remove(0)
        model, at = pin.Model(), {0: 0}
        for j in order:
            at[j] = self.copy_joint(j, model, at[self._parents[j]])
        places = np.array(order, np.intp) - 1
        return KinematicTree(
            model, tuple(self.coordinates[k] for k in places), {}
        ), places

    def placement(self, name: str) -> FixedFrame:
        """Return a named frame, with the joint that carries it.

        Raises
        ------
        UnknownNameError
            With the names that exist.
        """
        frames = self.frames if "frames" in vars(self) else self.given_frames
        try:
            return (frames(name) if callable(frames) else frames)[name]
        except KeyError:
            raise UnknownNameError("frame", name, self.frames) from None

    def support(self, joint: int) -> list[int]:
        """Return the joints from the root to `joint`, in order, without the universe."""
        chain: list[int] = []
        while joint > 0:
            chain.append(joint)
            joint = self._parents[joint]
        return chain[::-1]

    def path(self, joint_a: int, joint_b: int) -> Route:
        """Return the path between two joints; joint j has coordinate j - 1."""
        key = (joint_a, joint_b)
        if key not in self._paths:
            up, down = self.support(joint_a), self.support(joint_b)
            shared = 0
            while shared < min(len(up), len(down)) and up[shared] == down[shared]:
                shared += 1
            order = np.array(up[shared:][::-1] + down[shared:], dtype=np.intp) - 1
            signs = np.zeros(self.model.nv)
            signs[np.array(up[shared:], dtype=np.intp) - 1] = -1.0
            signs[np.array(down[shared:], dtype=np.intp) - 1] = 1.0
            self._paths[key] = Route(order, signs)
        return self._paths[key]

    def _with_model(self, model: pin.Model) -> KinematicTree:
        """The tree with another model of the same joints, which shares its workspaces."""
        other = KinematicTree(
            model, self.coordinates, self.frames, self.mimic, self.offset
        )
        other._paths, other._workspaces = self._paths, self._workspaces
        return other

    def copy_joint(
        self,
        joint: int,
        model: pin.Model,
        parent: int,
        T_root: Array | None = None,
        prefix: str = "",
    ) -> int:
        """Add a joint with its masses to another model; return its index there.

        The joint keeps its placement in its parent; one on the ground is placed from
        ``T_root``.
        """
        own = self.model
        placement = own.jointPlacements[joint]
        if T_root is not None and self._parents[joint] == 0:
            placement = pin.SE3(T_root) * placement
        new = int(
            model.addJoint(
                parent, own.joints[joint], placement, prefix + own.names[joint]
            )
        )
        model.armature[model.idx_vs[new]] = own.armature[own.idx_vs[joint]]
        model.damping[model.idx_vs[new]] = own.damping[own.idx_vs[joint]]
        model.appendBodyToJoint(new, own.inertias[joint], pin.SE3.Identity())
        return new

    def changed(
        self,
        placements: Mapping[int, Array] | None = None,
        masses: Mapping[int, float] | None = None,
        frames: Mapping[str, FixedFrame] | None = None,
    ) -> KinematicTree:
        """The tree with other poses ``T_parent_joint``, masses [kg] of joints, or frames.

        Joints are counted from 1. Mass centres, and moments of inertia about them, do not
        change.
        """
        model = self.model.copy()
        for joint, T in (placements or {}).items():
            model.jointPlacements[joint] = pin.SE3(T)
        for joint, mass in (masses or {}).items():
            body = model.inertias[joint]
            model.inertias[joint] = pin.Inertia(mass, body.lever, body.inertia)
        other = self._with_model(model)
        other.frames = {**self.frames, **(frames or {})}
        return other

    def with_zeros(self, zeros: Mapping[str, float]) -> KinematicTree:
        """Return the tree whose joints stand at these positions by name where
        they are 0 here.
        """
        if not zeros:
            return self
        z = np.array([zeros.get(name, 0.0) for name in self.names])
        z = z if self.mimic is None else self.mimic @ z
        moved = [
            T @ se3.exp(x)
            for T, x in zip(self.placements(), self.screws() * z[:, None], strict=True)
        ]
        return self.changed(dict(enumerate(moved, start=1)))

    def in_units(self, a: float) -> KinematicTree:
        """Return the tree with all lengths times `a`; masses stay in kg."""
        model = self.model.copy()
        slides = np.zeros(model.njoints, bool)
        for j in range(1, model.njoints):
            slides[j] = model.joints[j].shortname().startswith("JointModelP")
            model.jointPlacements[j].translation *= a
            body = model.inertias[j]
            model.inertias[j] = pin.Inertia(
                body.mass, a * body.lever, a * a * body.inertia
            )
        sizes = np.where(slides[1:], a, 1.0)
        model.armature = np.asarray(model.armature) * np.where(slides[1:], 1.0, a * a)
        mimic, offset = self.mimic, None
        if mimic is not None:
            own = np.array([a if c.is_length else 1.0 for c in self.coordinates])
            mimic, offset = mimic * sizes[:, None] / own, self.offset * sizes
        coordinates = tuple(c.times(a) for c in self.coordinates)
        frames = {name: rescaled(p, a) for name, p in self.frames.items()}
        return KinematicTree(model, coordinates, frames, mimic, offset)

    def with_mass(self, at: FixedFrame, mass: float, point: Array) -> KinematicTree:
        """Return the tree with a point mass [kg] at a point (3,) of a frame."""
        model = self.model.copy()
        if at.joint > 0:
            centre = (at.T_j_f @ np.append(point, 1.0))[:3]
            inertia = pin.Inertia(mass, centre, np.zeros((3, 3)))
            model.appendBodyToJoint(at.joint, inertia, pin.SE3.Identity())
        return self._with_model(model)

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix (n, n) at one posture, without mimics."""
        tree, places = self.depth_first
        with tree.workspace() as data:
            ordered = np.triu(
                pin.crba(tree.model, data, q[places])
            )  # Pinocchio fills this part
        full = np.empty_like(ordered)
        full[places[:, None], places] = ordered + np.triu(ordered, 1).T
        return full

    def placements(self) -> list[Array]:
        """The poses ``T_parent_joint`` of all joints, in their order from joint 1."""
        return [np.array(T.homogeneous) for T in list(self.model.jointPlacements)[1:]]

    def screws(self) -> Array:
        """Return the constant twists (joints, 6) of the joints, each in its own frame."""
        model = self.model
        screws = np.empty((model.nv, 6))
        with self.workspace() as data:
            pin.computeJointJacobians(model, data, np.zeros(model.nq))
            for joint in range(1, model.njoints):
                local = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
                screws[joint - 1] = np.asarray(local).reshape(6, -1)[SWAP, joint - 1]
        return screws

    def masses(self) -> tuple[Array, Array]:
        """Return masses (joints,) that the joints carry, and their centres
        (joints, 3) there.
        """
        inertias = list(self.model.inertias)[1:]
        centres = np.array([body.lever for body in inertias]).reshape(-1, 3)
        return np.array([body.mass for body in inertias]), centres

    def links(self) -> dict[int, str]:
        """Return the name of the first link or site on each joint,
        by the joint's index from 1.
        """
        names: dict[int, str] = {}
        for name, placement in self.frames.items():
            if placement.joint > 0:
                names.setdefault(placement.joint, name)
        return names

    def at(self, q: Array) -> TreeState:
        """Return the kinematics at coordinates q (n,)."""
        return TreeState(self, q)


class TreeState:
    """The tree at one posture; frames and Jacobians are computed when they are needed."""

    def __init__(self, tree: KinematicTree, q: Array) -> None:
        self.tree = tree
        self.q = q if tree.mimic is None else tree.mimic @ q + tree.offset
        with tree.workspace() as data:
            pin.computeJointJacobians(tree.model, data, self.q)
            self._poses = data.oMi.copy()
            # In Pinocchio's order; eigenpy converts a matrix with one column to a vector.
            self._twists = np.array(data.J).reshape(6, -1)

    @cached_property
    def world_jacobian(self) -> Array:
        """Twists (6, joints) of the joints about F's origin, along F's axes."""
        return self._twists.take(SWAP, axis=0)

    def pose(self, frame: FixedFrame) -> Array:
        """Return the pose ``T_F_f``."""
        return np.asarray(self._poses[frame.joint].homogeneous @ frame.T_j_f)

    def joint_poses(self, joints: Sequence[int]) -> Array:
        """Return the poses ``T_F_j`` (m, 4, 4) of some joints."""
        poses = {joint: self._poses[joint].homogeneous for joint in set(joints)}
        return np.array([poses[joint] for joint in joints])

    def relative(self, a: FixedFrame, b: FixedFrame) -> tuple[Array, SecondOrderMap]:
        """Return the pose ``T_a_b`` and its map: body twist of b against a,
        in components of b.
        """
        T_F_b, path = self.pose(b), self.tree.path(a.joint, b.joint)
        J = pin.SE3(T_F_b).toActionMatrixInverse().dot(self._twists).take(SWAP, axis=0)
        J *= path.signs
        mimic = self.tree.mimic
        curvature = partial(_bracket_curvature, J, path.order, mimic)
        own = J if mimic is None else J @ mimic
        return se3.inverse(self.pose(a)) @ T_F_b, SecondOrderMap(own, curvature)

    def gravity(self, acceleration: Array) -> Evaluation:
        """Return the energy of all masses in a uniform field, with derivatives."""
        tree, places = self.tree.depth_first
        model = _with_gravity(tree.model, acceleration)
        q = self.q[places]
        gradient, hessian = np.empty(model.nv), np.empty((model.nv, model.nv))
        with tree.workspace() as data:
            energy = pin.computePotentialEnergy(model, data, q)
            gradient[places] = pin.computeGeneralizedGravity(model, data, q)
            ordered = np.array(pin.computeGeneralizedGravityDerivatives(model, data, q))
        hessian[places[:, None], places] = 0.5 * (ordered + ordered.T)
        if (M := self.tree.mimic) is not None:
            gradient, hessian = M.T @ gradient, M.T @ hessian @ M
        return Evaluation(float(energy), gradient, hessian)

    def mass_matrix(self) -> Array:
        """Mass matrix (n, n): kinetic energy ``1/2 dq^T M dq``."""
        full = self.tree.mass_matrix(self.q)
        return full if (M := self.tree.mimic) is None else np.asarray(M.T @ full @ M)

    def momentum(self) -> tuple[Array, float]:
        """Linear momentum (3, n) in F per coordinate rate, and the mass of the tree."""
        model = self.tree.model
        with self.tree.workspace() as data:
            pin.ccrba(model, data, self.q, np.zeros(model.nv))
            # Pinocchio's first rows are linear.
            full = np.asarray(data.Ag)[:3].reshape(3, -1).copy()
        mass = float(self.tree.masses()[0].sum())
        return (full if (M := self.tree.mimic) is None else full @ M), mass


def _bracket_curvature(
    jacobian: Array, order: NDArray[np.intp], mimic: Array | None, wrench: Array
) -> Array:
    """``S[a, b] = 1/2 w . [J_a, J_b]`` for a before b on the path, symmetric."""
    n = jacobian.shape[1]
    full = np.zeros((n, n))
    if any(wrench.tolist()):
        full[order[:, None], order] = se3.chain_curvature(jacobian[:, order], wrench)
    return full if mimic is None else np.asarray(mimic.T @ full @ mimic)


def _with_gravity(model: pin.Model, acceleration: Array) -> Any:
    if not np.array_equal(model.gravity.linear, acceleration):
        model = model.copy()
        model.gravity = pin.Motion(np.concatenate([acceleration, np.zeros(3)]))
    return model


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
