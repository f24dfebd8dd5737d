r"""Kinematics of chains and trees on recorded numbers: geometry,
poses and twists of the joints.

Twists are in the frame C of a joint, or in F or M. Walks inward and outward start there:
the axes beside C are constant and the next ones depend on one angle each; entries that
are zero at every posture are not recorded. A serial chain has C in its middle. A closed
chain has F, so that joints on the ground are constant. The loop closure of frames a and b
has the twists of the joints on the path from a to b, those towards the ground with the
sign -1, about the origin of C (a weld) or about the joined point.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry import se3
from cartstiff.core.geometry.se3 import skew_of
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.tree import KinematicTree
from cartstiff.recorded.algebra import cross, is_zero, zeros
from cartstiff.recorded.tape import Tape, cosine, sine

#: Largest difference of an entry of a rotation from 0, 1 or -1 that counts as round-off.
_ENTRY_ROUNDOFF = numerics.TWO_UNITS_IN_LAST_PLACE


@dataclass(frozen=True)
class ForceField:
    """Points at which a constant vector in F acts: gravity on masses,
    or a dead force on a point.

    Attributes
    ----------
    weights : factor of the vector for the body of each joint; a mass, or 1.
    points : point of application on each body, in its joint's frame (joints, 3).
    has_mass : whether the factors are masses.
    """

    weights: tuple[float, ...]
    points: tuple[tuple[float, ...], ...]
    has_mass: bool = False


class Tie(NamedTuple):
    """Loop closure of frames a and b: their joints (0: the ground) and flat
    placements on these.
    """

    joint_a: int
    T_a: tuple[float, ...]
    joint_b: int
    T_b: tuple[float, ...]
    is_weld: bool


@dataclass(frozen=True)
class Varied:
    """Numbers of the geometry that are inputs, so that a program can be
    differentiated by them.

    Attributes
    ----------
    links : of which the placements move: input "placements", three shifts along axes of
        the carrier and three rotations about their own axes for each, all of them
        nominally zero.
    ends : the same of frames of closures: for each frame the ties that it ends, with 0
        where it is their a and 1 where it is their b.
    masses : whether the masses of the joints' bodies are the input "masses".
    factors : for each spring of a link, coupled ones before still ones, the component of
        the input "factors" that multiplies its stiffness.
    """

    links: tuple[int, ...] = ()
    ends: tuple[tuple[tuple[int, int], ...], ...] = ()
    masses: bool = False
    factors: tuple[int, ...] = ()


#: The geometry of ordinary programs is constant.
NOTHING_VARIED = Varied()


@dataclass(frozen=True)
class TreeConstants:
    """Geometry of a tree of joints with loop closures as plain numbers, hashable.

    Joints are counted from 1 in `parents`, `carrier` and the closures; 0 is the ground.

    Attributes
    ----------
    placements : ``T_parent_joint`` (joints, 4, 4), flat.
    screws : twists of the joints in their own frames (joints, 6), flat.
    body : pose of M on the joint `carrier` (4, 4), flat.
    is_length : whether each coordinate is a distance.
    parents : joint that carries each joint.
    carrier : joint of the body.
    ties : tuple of Tie
    mimic, offset : joint positions are ``mimic q + offset``; None where these are q.
    """

    placements: tuple[float, ...]
    screws: tuple[float, ...]
    body: tuple[float, ...]
    is_length: tuple[bool, ...]
    parents: tuple[int, ...]
    carrier: int
    ties: tuple[Tie, ...] = ()
    mimic: tuple[float, ...] | None = None
    offset: tuple[float, ...] | None = None

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:  # computed once: every call looks up a kernel by it
        return hash((self.placements, self.screws, self.body))

    def sizes(self, length: Any) -> Array:
        """Natural sizes (n,) of the coordinates: a length, or 1 for angles."""
        return np.array([length if d else 1.0 for d in self.is_length], object)

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


def numbers(array: Array) -> tuple[float, ...]:
    """All entries of an array, row by row."""
    return tuple(np.ravel(array).tolist())


def tree_constants(chain: Chain, count: int | None = None) -> TreeConstants:
    """Geometry of a tree, or of its first few joints, with its loop closures."""
    tree = chain.tree

    def tie(closure: Any) -> Tie:
        ends = map(chain.placement, (closure.frame_a, closure.frame_b))
        a, b = ((end.joint, numbers(end.T_j_f)) for end in ends)
        return Tie(*a, *b, closure.type == "weld")

    return TreeConstants(
        numbers(np.array(tree.placements())[:count]),
        numbers(tree.screws()[:count]),
        numbers(chain.body.T_j_f),
        tuple(bool(x) for x in chain.is_length),
        tuple(int(p) for p in list(tree.model.parents)[1:][:count]),
        chain.body.joint,
        tuple(map(tie, chain.closures)),
    )


def read_chain(chain: Chain) -> TreeConstants | str:
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
            turning
            and np.abs(np.cross(screw[:3], screw[3:])).max() > numerics.ROUNDOFF_OF_SUMS
        ):
            return "a joint's axis does not pass through its own frame"
    mimic = offset = None
    if tree.mimic is not None and not np.array_equal(tree.mimic[path], np.eye(tree.n)):
        mimic, offset = numbers(tree.mimic[path]), numbers(tree.offset[path])
    count = len(path)
    return replace(
        tree_constants(chain, count), carrier=count, mimic=mimic, offset=offset
    )


def _only_masses_beside(tree: KinematicTree, path: NDArray[np.intp]) -> bool:
    """Whether each coordinate moves a joint of the path,
    and the path's joints come first.
    """
    mimic = np.eye(tree.n) if tree.mimic is None else tree.mimic
    comes_first = np.array_equal(path, np.arange(len(path)))
    return comes_first and bool(np.abs(mimic[path]).sum(axis=0).all())


class VariedNumbers(NamedTuple):
    """Recorded numbers of `Varied`: six of each link and end, masses, and factors of
    links' springs.
    """

    links: Mapping[int, Array] = {}
    ends: Mapping[tuple[int, int], Array] = {}
    masses: Array | None = None
    factors: Array | None = None
    tool: Array | None = None

    @classmethod
    def of(cls, tape: Tape, varied: Varied, joints: int) -> VariedNumbers:
        """Inputs of a tape."""
        places = (*varied.links, *varied.ends)
        numbers = iter(tape.vector("placements", 6 * len(places)).reshape(-1, 6))
        return cls(
            {link: next(numbers) for link in varied.links},
            {end: row for own in varied.ends for row in [next(numbers)] for end in own},
            tape.vector("masses", joints) if varied.masses else None,
            tape.vector("factors", 1 + max(varied.factors, default=-1)),
        )


class Links:
    """Links of a tree in joint frames turned so that every axis is z.

    The last placement is that of the body. `parents` are the joints that carry each link,
    counted from 1; 0 is the ground.
    """

    def __init__(
        self,
        constants: TreeConstants,
        position: Array,
        varied: VariedNumbers,
    ) -> None:
        self.parents = *constants.parents, constants.carrier
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
        befores = [turns[p] for p in self.parents]
        for link, (T, before, after) in enumerate(
            zip(placements, befores, turns[1:], strict=True)
        ):
            turned = np.eye(4)
            turned[:3, :3] = _snapped(before.T @ T[:3, :3] @ after)
            turned[:3, 3] = before.T @ T[:3, 3]
            if link in varied.links:
                turned = _shifted(turned, before.T, after.T, varied.links[link])
            self.placements.append(turned)
        if varied.tool is not None:
            body = self.placements[-1].astype(object)
            shift, rotation = varied.tool[:3], se3.rotation_by_angles(varied.tool[3:])
            body[:3, 3] = body[:3, 3] + body[:3, :3] @ shift
            body[:3, :3] = body[:3, :3] @ rotation
            self.placements[-1] = body
        self.position = position
        # Consecutively, so that the vector code computes several at a time.
        self.sines = [
            sine(x) if t else 0.0 for x, t in zip(position, self.turning, strict=True)
        ]
        self.cosines = [
            cosine(x) if t else 1.0 for x, t in zip(position, self.turning, strict=True)
        ]
        self.lengths = [numerics.norm(T[:3, 3]) for T in placements]


def _shifted(T: Array, outer: Array, inner: Array, small: Array) -> Array:
    """Placement with a small shift, turned by `outer`, and small rotations,
    turned by `inner`.

    To first order, which is all that a derivative where they vanish needs.
    """
    shifted = T.astype(object)
    shifted[:3, 3] = shifted[:3, 3] + outer @ small[:3]
    shifted[:3, :3] = shifted[:3, :3] + T[:3, :3] @ skew_of(inner @ small[3:])
    return shifted


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
    """A walk along a chain: pose of the current frame in the frame where
    the walk began.
    """

    def __init__(self, links: Links) -> None:
        self.links = links
        self.R, self.p = np.eye(3).astype(object), zeros(3)

    def twist(self, joint: int) -> Array:
        """Unit twist of a joint, at its frame before or after its motion."""
        axis = self.R[:, 2]
        if not self.links.turning[joint]:
            return np.concatenate([zeros(3), axis])
        return np.concatenate(
            [axis, cross(self.p, axis) + axis * self.links.pitches[joint]]
        )

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
    """A tree at recorded coordinates, with twists in a frame C.

    Parameters
    ----------
    constants : TreeConstants
    position : positions of the joints.
    fields : tuple of ForceField
    start : joint whose frame before its motion is C, from 1; C is M if that is past
        the last one, and F if it is 0.
    varied : VariedNumbers, optional
        Numbers of the geometry that are inputs; default none.

    Attributes
    ----------
    J, J_M : twists of the joints in C, and in M of those that carry the body (6, joints).
    R_C_M, p_C_M, R_C_F, p_C_F : poses of M and F in C.
    beyond : mass and first moment in C that each joint carries, for each field.
    roots : joints on the ground.
    outward : of each joint, itself and the joints that it carries.
    size, reach : sum of the links' lengths up to M, from F and from the first axis.
    """

    def __init__(
        self,
        constants: TreeConstants,
        position: Array,
        fields: tuple[ForceField, ...] = (),
        start: int = 0,
        varied: VariedNumbers | None = None,
    ) -> None:
        self.constants = constants
        self.varied = VariedNumbers() if varied is None else varied
        self.links = links = Links(constants, position, self.varied)
        joints, parents = len(links.turning), links.parents
        self.J, self.J_M = zeros(6, joints), zeros(6, joints)
        self._behind: dict[int, Walk] = {}
        walk, joint = Walk(links), start
        while joint:  # inward from C to F
            walk.inward(joint - 1)
            joint = parents[joint - 1]
            self._behind[joint] = copy(walk)
            if joint:
                self.J[:, joint - 1] = walk.twist(joint - 1)
                walk.move(joint - 1, -1.0)
        self._behind.setdefault(0, walk)
        for joint in range(1, joints + 2):  # outward; the last is the body
            if joint in self._behind:
                continue
            walk = Walk(links)
            if joint != start:
                walk = copy(self._behind[parents[joint - 1]])
                walk.outward(joint - 1)
            if joint <= joints:
                self.J[:, joint - 1] = walk.twist(joint - 1)
                walk.move(joint - 1, 1.0)
            self._behind[joint] = walk
        ground, body = self._behind[0], self._behind[joints + 1]
        self.R_C_F, self.p_C_F, self.R_C_M, self.p_C_M = (
            ground.R,
            ground.p,
            body.R,
            body.p,
        )

        way = constants.support(constants.carrier)
        lengths = [links.lengths[j] for j in (*way, joints)]
        self.size, self.reach = sum(lengths), sum(lengths[1:])
        supports = [constants.support(j + 1) for j in range(joints)]
        self.roots = [j for j, support in enumerate(supports) if len(support) == 1]
        self.outward = [
            [b for b in range(joints) if a in supports[b]] for a in range(joints)
        ]
        # Twists of joints between C and the body take fewer operations from there.
        walk = Walk(links)
        for j, link in zip(reversed(way), [joints, *reversed(way)], strict=False):
            if j + 1 < start:
                axis = self.J[:3, j]
                self.J_M[:3, j] = self.R_C_M.T @ axis
                self.J_M[3:, j] = self.R_C_M.T @ (self.J[3:, j] + cross(axis, self.p_C_M))
                continue
            walk.inward(link)
            self.J_M[:, j] = walk.twist(j)
            walk.move(j, -1.0)
        self.beyond = [self._beyond(field) for field in fields]

    def _beyond(self, field: ForceField) -> tuple[Array, Array]:
        """Mass and first moment in C of all bodies that each joint carries."""
        first = zeros(len(field.weights), 3)
        weights = np.array(field.weights, object)
        if field.has_mass and self.varied.masses is not None:
            weights = self.varied.masses
        for j, (weight, point) in enumerate(zip(weights, field.points, strict=True)):
            if not is_zero(weight):
                walk = self._behind[j + 1]
                first[j] = (
                    walk.R @ (self.links.turns[j].T @ np.array(point)) + walk.p
                ) * weight
        return self.carried(weights), self.carried(first)

    def hung(self, mass: Any, centre: Array) -> tuple[Array, Array]:
        """The same of a mass at a point of M."""
        weights, first = zeros(self.J.shape[1]), zeros(self.J.shape[1], 3)
        body = self.constants.carrier - 1
        weights[body] = mass
        first[body] = (self.R_C_M @ centre + self.p_C_M) * mass
        return self.carried(weights), self.carried(first)

    def carried(self, own: Array) -> Array:
        """Sums over the bodies that each joint carries, of numbers (joints, ...)
        of the bodies.
        """
        sums = own.astype(object)
        for j in reversed(
            range(len(sums))
        ):  # a joint comes after the one that carries it
            if parent := self.links.parents[j]:
                sums[parent - 1] = sums[parent - 1] + sums[j]
        return sums

    def behind(self, joint: int) -> tuple[Array, Array]:
        """R and p in C of a joint's frame after its motion, joints counted from 0."""
        walk = self._behind[joint + 1]
        return walk.R @ self.links.turns[joint].T, walk.p

    def end(self, tie: Tie, side: int) -> tuple[Array, Array]:
        """R and p in C of a closure's frame: a for side 0, b for 1."""
        joint, T = (tie.joint_b, tie.T_b) if side else (tie.joint_a, tie.T_a)
        walk, placement = self._behind[joint], np.reshape(T, (4, 4))
        moved = self.varied.ends.get((self.constants.ties.index(tie), side))
        if moved is not None:
            placement = _shifted(placement, np.eye(3), np.eye(3), moved)
        turned = placement[:3]
        if joint:
            turned = self.links.turns[joint - 1].T @ turned
        return walk.R @ turned[:3, :3], walk.R @ turned[:3, 3] + walk.p

    def pose(self) -> Array:
        """``T_F_M``."""
        T = zeros(4, 4)
        T[:3, :3] = self.R_C_F.T @ self.R_C_M
        T[:3, 3] = self.R_C_F.T @ (self.p_C_M - self.p_C_F)
        T[3, 3] = 1.0
        return T

    def frames(self) -> Array:
        """``T_F_joint`` after each joint's motion,
        without the last row (joints, 3, 4).
        """
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

    def tied(self, tie: Tie, about: Array | None = None) -> Array:
        """Twist of b relative to a per joint rate (6, joints).

        It is about a given point, or else the origin of C for a weld, the joined point
        otherwise.
        """
        if about is None and not tie.is_weld:
            about = self.end(tie, 1)[1]
        tied = zeros(*self.J.shape)
        for j, sign in self.constants.way(tie):
            tied[:, j] = self.J[:, j] * sign
            if about is not None:
                tied[3:, j] = tied[3:, j] + cross(tied[:3, j], about)
        return tied
