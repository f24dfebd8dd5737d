r"""Kinematics of chains and trees on recorded numbers: geometry, poses and twists of the joints.

A serial chain has its twists in the frame of a middle joint. Two walks, outward and inward, start
there. The axes beside that joint are constant and the next ones depend on one angle each; entries
that are zero at every posture are not recorded.

A tree has its twists about the origin of F, along its axes, so that those of joints on the ground
are constant. The loop closure of frames a and b has the twists of the joints on the path from a to
b, those towards the ground with the sign -1, about the origin of F (a weld) or about the joined
point.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.batch.algebra import cross, zeros
from cartstiff.batch.tape import cosine, sine
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.tree import KinematicTree

#: Largest difference of an entry of a rotation from 0, 1 or -1 that counts as round-off.
_ENTRY_ROUNDOFF = numerics.TWO_UNITS_IN_LAST_PLACE


@dataclass(frozen=True)
class ForceField:
    """Points at which a constant vector in F acts: gravity on masses, or a dead force on a point.

    Attributes
    ----------
    weights : factor of the vector for the body of each joint; a mass, or 1.
    points : point of application on each body, in its joint's frame (joints, 3).
    """

    weights: tuple[float, ...]
    points: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class ChainConstants:
    """Geometry of a chain as plain numbers, hashable.

    Attributes
    ----------
    placements : ``T_parent_joint`` (joints, 4, 4), flat.
    screws : twists of the joints in their own frames (joints, 6), flat.
    body : ``T_last_M`` (4, 4), flat.
    mimic, offset : joint positions are ``mimic q + offset``; None where these are q.
    is_length : whether each coordinate is a distance.
    """

    placements: tuple[float, ...]
    screws: tuple[float, ...]
    body: tuple[float, ...]
    mimic: tuple[float, ...] | None
    offset: tuple[float, ...] | None
    is_length: tuple[bool, ...]

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:  # computed once: every call looks up a kernel by it
        return hash((self.placements, self.screws, self.body))


def numbers(array: Array) -> tuple[float, ...]:
    """All entries of an array, row by row."""
    return tuple(np.ravel(array).tolist())


def read_chain(chain: Chain) -> ChainConstants | str:
    """Geometry of a serial chain, or the reason why it has no recorded arithmetic."""
    tree = chain.tree
    if chain.closures:
        return "a closed chain has arithmetic of its own"
    if chain.actuated is not None:
        return "a chain with chosen actuated joints has no arithmetic of its own"
    path = tree.path(0, chain.body.joint).order
    if not tree.model.nv or not _only_masses_beside(tree, path):
        return "some joints are not on the way to the frame"
    screws = tree.screws()[path]
    for screw in screws:
        turning = np.linalg.norm(screw[:3])
        if abs((turning or np.linalg.norm(screw[3:])) - 1.0) > numerics.ROUNDOFF or (
            turning and np.abs(np.cross(screw[:3], screw[3:])).max() > numerics.ROUNDOFF_OF_SUMS
        ):
            return "a joint's axis does not pass through its own frame"
    mimic = offset = None
    if tree.mimic is not None and not np.array_equal(tree.mimic[path], np.eye(tree.n)):
        mimic, offset = numbers(tree.mimic[path]), numbers(tree.offset[path])
    return ChainConstants(
        numbers(np.array(tree.placements())[path]),
        numbers(screws),
        numbers(chain.body.T_j_f),
        mimic,
        offset,
        tuple(bool(x) for x in chain.is_length),
    )


def _only_masses_beside(tree: KinematicTree, path: NDArray[np.intp]) -> bool:
    """Whether each coordinate moves a joint of the path, and the path's joints come first."""
    mimic = np.eye(tree.n) if tree.mimic is None else tree.mimic
    comes_first = np.array_equal(path, np.arange(len(path)))
    return comes_first and bool(np.abs(mimic[path]).sum(axis=0).all())


class Links:
    """Links of a chain or a tree in joint frames turned so that every axis is z.

    The last placement is that of the body. In a tree `parents` are the joints that carry each link,
    counted from 1; in a chain the joint before carries it.
    """

    def __init__(
        self, constants: ChainConstants, position: Array, parents: Sequence[int] | None = None
    ) -> None:
        placements = np.reshape([*constants.placements, *constants.body], (-1, 4, 4))
        screws = np.reshape(constants.screws, (-1, 6))
        self.turning = [bool(np.any(screw[:3])) for screw in screws]
        self.pitches, self.turns = list[float](), list[Array]()
        for screw, turning in zip(screws, self.turning, strict=True):
            axis = screw[:3] if turning else screw[3:]
            self.pitches.append(float(axis @ screw[3:]) if turning else 0.0)
            self.turns.append(_turn(axis))
        self.placements = []
        turns = [np.eye(3), *self.turns, np.eye(3)]
        befores = [turns[p] for p in parents or range(len(placements))]
        for T, before, after in zip(placements, befores, turns[1:], strict=True):
            turned = np.eye(4)
            turned[:3, :3] = _snapped(before.T @ T[:3, :3] @ after)
            turned[:3, 3] = before.T @ T[:3, 3]
            self.placements.append(turned)
        self.position = position
        # Consecutively, so that the vector code computes several at a time.
        self.sines = [sine(x) if t else 0.0 for x, t in zip(position, self.turning, strict=True)]
        self.cosines = [
            cosine(x) if t else 1.0 for x, t in zip(position, self.turning, strict=True)
        ]
        self.lengths = [float(np.linalg.norm(T[:3, 3])) for T in placements]


def _turn(axis: Array) -> Array:
    """Rotation that takes z to `axis`; a permutation where that is possible."""
    for shift, unit in enumerate(np.eye(3)):
        if np.array_equal(axis, unit):
            return np.roll(np.eye(3), shift + 1, axis=0)
    u, _, vt = np.linalg.svd(axis[:, None])
    turn = np.column_stack([u[:, 1], u[:, 2], u[:, 0] * vt[0, 0]])
    if np.linalg.det(turn) < 0:
        turn[:, 0] *= -1
    return turn


def _snapped(rotation: Array) -> Array:
    for value in (-1.0, 0.0, 1.0):
        rotation = np.where(np.abs(rotation - value) <= _ENTRY_ROUNDOFF, value, rotation)
    return rotation


class Walk:
    """A walk along a chain: pose of the current frame in the frame where the walk began."""

    def __init__(self, links: Links) -> None:
        self.links = links
        self.R, self.p = np.eye(3).astype(object), zeros(3)

    def twist(self, joint: int) -> Array:
        """Unit twist of a joint, at its frame before or after its motion."""
        axis = self.R[:, 2]
        if not self.links.turning[joint]:
            return np.concatenate([zeros(3), axis])
        return np.concatenate([axis, cross(self.p, axis) + axis * self.links.pitches[joint]])

    def move(self, joint: int, sign: float) -> None:
        """Move through the motion of a joint; with sign -1 backwards."""
        links, axis = self.links, self.R[:, 2]
        x = links.position[joint] * sign
        if not links.turning[joint]:
            self.p = self.p + axis * x
            return
        s, c = links.sines[joint] * sign, links.cosines[joint]
        self.p = self.p + axis * (x * links.pitches[joint])
        x_axis, y_axis = self.R[:, 0], self.R[:, 1]
        self.R = np.column_stack([x_axis * c + y_axis * s, y_axis * c - x_axis * s, axis])

    def outward(self, link: int) -> None:
        """Move from a joint, after its motion, to the frame placed on its link."""
        T = self.links.placements[link]
        self.p = self.p + self.R @ T[:3, 3]
        self.R = self.R @ T[:3, :3]

    def inward(self, link: int) -> None:
        """Move back from the frame placed on a link."""
        T = self.links.placements[link]
        self.R = self.R @ T[:3, :3].T
        self.p = self.p - self.R @ T[:3, 3]


class Kinematics:
    """Kinematics of a mechanism at recorded coordinates, in a frame C.

    Attributes
    ----------
    J : twists of the joints in C (6, joints).
    R_C_M, p_C_M, R_C_F, p_C_F : poses of M and F in C.
    beyond : mass and first moment in C that each joint carries, for each field.
    roots : joints on the ground.
    outward : of each joint, itself and the joints that it carries.
    """

    J: Array
    R_C_M: Array
    p_C_M: Array
    R_C_F: Array
    p_C_F: Array
    beyond: list[tuple[Array, Array]]
    roots: Sequence[int]
    outward: list[Sequence[int]]

    def behind(self, joint: int) -> tuple[Array, Array]:
        """R and p in C of a joint's frame after its motion, joints counted from 0."""
        raise NotImplementedError

    def pose(self) -> Array:
        """``T_F_M``."""
        T = zeros(4, 4)
        T[:3, :3] = self.R_C_F.T @ self.R_C_M
        T[:3, 3] = self.R_C_F.T @ (self.p_C_M - self.p_C_F)
        T[3, 3] = 1.0
        return T

    def frames(self) -> Array:
        """``T_F_joint`` after each joint's motion, without the last row (joints, 3, 4)."""
        frames = zeros(self.J.shape[1], 3, 4)
        for joint, frame in enumerate(frames):
            R, p = self.behind(joint)
            frame[:, :3] = self.R_C_F.T @ R
            frame[:, 3] = self.R_C_F.T @ (p - self.p_C_F)
        return frames

    def wrench(self, W: Array) -> Array:
        """Transform a wrench from M to C."""
        force = self.R_C_M @ W[3:]
        return np.concatenate([self.R_C_M @ W[:3] + cross(self.p_C_M, force), force])

    def adjoint(self) -> Array:
        """``Ad(T_C_M)``."""
        adjoint = zeros(6, 6)
        adjoint[:3, :3] = adjoint[3:, 3:] = self.R_C_M
        for i in range(3):
            adjoint[3:, i] = cross(self.p_C_M, self.R_C_M[:, i])
        return adjoint


class ChainKinematics(Kinematics):
    """A chain in C, the frame of joint `middle` before its motion, or M if that is past the last.

    Attributes
    ----------
    J_M : twists of the joints in M (6, joints).
    size, reach : sum of the links' lengths up to M, from F and from the first axis.
    """

    def __init__(
        self,
        constants: ChainConstants,
        position: Array,
        fields: tuple[ForceField, ...],
        middle: int,
    ) -> None:
        links = Links(constants, position)
        joints = len(links.turning)
        self.roots, self.outward = (0,), [range(a, joints) for a in range(joints)]
        self.size, self.reach = sum(links.lengths), sum(links.lengths[1:])
        self.J, self.J_M = zeros(6, joints), zeros(6, joints)
        centres = [zeros(joints, 3) for _ in fields]
        places: list[tuple[Array, Array]] = [(np.eye(3), zeros(3))] * joints

        def keep(walk: Walk, j: int) -> None:
            places[j] = walk.R, walk.p
            for centre, field in zip(centres, fields, strict=True):
                centre[j] = walk.R @ (links.turns[j].T @ np.array(field.points[j])) + walk.p

        walk = Walk(links)
        for j in range(middle, joints):
            self.J[:, j] = walk.twist(j)
            walk.move(j, 1.0)
            keep(walk, j)
            walk.outward(j + 1)
        self.R_C_M, self.p_C_M = walk.R, walk.p
        walk = Walk(links)
        for j in range(middle - 1, -1, -1):
            walk.inward(j + 1)
            keep(walk, j)
            self.J[:, j] = walk.twist(j)
            walk.move(j, -1.0)
        walk.inward(0)
        self.R_C_F, self.p_C_F = walk.R, walk.p
        self._places, self._turns = places, links.turns
        # Twists near the body take fewer operations from there.
        walk = Walk(links)
        for j in range(joints - 1, middle - 1, -1):
            walk.inward(j + 1)
            self.J_M[:, j] = walk.twist(j)
            walk.move(j, -1.0)
        for j in range(middle):
            axis = self.J[:3, j]
            self.J_M[:3, j] = self.R_C_M.T @ axis
            self.J_M[3:, j] = self.R_C_M.T @ (self.J[3:, j] + cross(axis, self.p_C_M))
        self.beyond = []
        for centre, field in zip(centres, fields, strict=True):
            weights = np.array(field.weights)
            both = weights, centre * weights[:, None]
            mass, first = (np.cumsum(each[::-1], axis=0)[::-1] for each in both)
            self.beyond.append((mass, first))

    def behind(self, joint: int) -> tuple[Array, Array]:
        """R and p in C of a joint's frame after its motion."""
        R, p = self._places[joint]
        return R @ self._turns[joint].T, p


class Tie(NamedTuple):
    """Loop closure of frames a and b: their joints (0: the ground) and flat placements on these."""

    joint_a: int
    T_a: tuple[float, ...]
    joint_b: int
    T_b: tuple[float, ...]
    is_weld: bool


@dataclass(frozen=True)
class TreeConstants(ChainConstants):
    """Geometry of a tree with loop closures; `body` is placed on the joint `carrier`.

    Attributes
    ----------
    parents : joint that carries each joint, counted from 1; 0 is the ground.
    carrier : joint of the body.
    ties : tuple of Tie
    """

    parents: tuple[int, ...] = ()
    carrier: int = 0
    ties: tuple[Tie, ...] = ()

    def __hash__(self) -> int:
        return self._hash

    def support(self, joint: int) -> list[int]:
        """Joints on the path from the ground to one (counted from 1), counted from 0."""
        joints: list[int] = []
        while joint:
            joints.append(joint - 1)
            joint = self.parents[joint - 1]
        return joints[::-1]

    def way(self, tie: Tie) -> list[tuple[int, float]]:
        """Joints on the path from a to b, counted from 0, with their signs."""
        up, down = self.support(tie.joint_a), self.support(tie.joint_b)
        while up and down and up[0] == down[0]:
            up, down = up[1:], down[1:]
        return [*((j, -1.0) for j in reversed(up)), *((j, 1.0) for j in down)]


class TreeKinematics(Kinematics):
    """A tree at recorded coordinates; C is F.

    Attributes
    ----------
    size : sum of the links' lengths to the body.
    """

    def __init__(
        self, constants: TreeConstants, position: Array, fields: tuple[ForceField, ...] = ()
    ) -> None:
        self.constants = constants
        self.links = links = Links(constants, position, (*constants.parents, constants.carrier))
        joints = len(links.turning)
        self.J = zeros(6, joints)
        self._behind = [Walk(links)]
        for j in range(joints):
            walk = copy(self._behind[constants.parents[j]])
            walk.outward(j)
            self.J[:, j] = walk.twist(j)
            walk.move(j, 1.0)
            self._behind.append(walk)
        body = copy(self._behind[constants.carrier])
        body.outward(joints)
        self.R_C_M, self.p_C_M = body.R, body.p
        self.size = sum(links.lengths[j] for j in constants.support(constants.carrier))
        self.size += links.lengths[joints]
        self.R_C_F, self.p_C_F = np.eye(3), np.zeros(3)
        supports = [constants.support(j + 1) for j in range(joints)]
        self.roots = [j for j, support in enumerate(supports) if len(support) == 1]
        self.outward = [[b for b in range(joints) if a in supports[b]] for a in range(joints)]
        self.beyond = [self._beyond(field) for field in fields]

    def _beyond(self, field: ForceField) -> tuple[Array, Array]:
        """Mass and first moment in F of all bodies that each joint carries."""
        mass, first = zeros(len(self.outward)), zeros(len(self.outward), 3)
        for j, (weight, point) in enumerate(zip(field.weights, field.points, strict=True)):
            if weight:
                T = np.eye(4)
                T[:3, 3] = point
                own = self.placed(j + 1, tuple(T.ravel()))[1] * weight
                for a, behind in enumerate(self.outward):
                    if j in behind:
                        mass[a], first[a] = mass[a] + weight, first[a] + own
        return mass, first

    def behind(self, joint: int) -> tuple[Array, Array]:
        """R and p in F of a joint's frame after its motion, joints counted from 0."""
        walk = self._behind[joint + 1]
        return walk.R @ self.links.turns[joint].T, walk.p

    def placed(self, joint: int, T: tuple[float, ...]) -> tuple[Array, Array]:
        """R and p in F of a frame placed on a joint."""
        walk, placement = self._behind[joint], np.reshape(T, (4, 4))
        turned = placement[:3]
        if joint:
            turned = self.links.turns[joint - 1].T @ turned
        return walk.R @ turned[:3, :3], walk.R @ turned[:3, 3] + walk.p

    def in_body(self, twists: Array) -> Array:
        """Transform twists (6, k) from F to M."""
        turned = zeros(*twists.shape)
        for a, twist in enumerate(twists.T):
            turned[:3, a] = self.R_C_M.T @ twist[:3]
            turned[3:, a] = self.R_C_M.T @ (twist[3:] + cross(twist[:3], self.p_C_M))
        return turned

    def tied(self, tie: Tie, about: Array | None = None) -> Array:
        """Twist of b relative to a per joint rate (6, joints).

        It is about a given point, or else the origin of F for a weld, the joined point otherwise.
        """
        if about is None and not tie.is_weld:
            about = self.placed(tie.joint_b, tie.T_b)[1]
        tied = zeros(*self.J.shape)
        for j, sign in self.constants.way(tie):
            tied[:, j] = self.J[:, j] * sign
            if about is not None:
                tied[3:, j] = tied[3:, j] + cross(tied[:3, j], about)
        return tied
