r"""A kinematic tree on recording numbers: poses and twists of its joints in F, ties between frames.

Twists are taken about the origin of F, along its axes: those of joints on the ground are constant.
A tie of frames a and b has the twists of the joints on the way from a to b, those on the way up
with the sign -1, as rows about the origin of F (a weld) or about the tied point.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import cross, zeros
from cartstiff.many.chains.chain_twists import ChainConstants, ForceField, Links, Walk


class Tie(NamedTuple):
    """Frame b tied to frame a: their joints (0: the ground) and flat placements on these."""

    joint_a: int
    T_a: tuple[float, ...]
    joint_b: int
    T_b: tuple[float, ...]
    is_weld: bool


@dataclass(frozen=True)
class TreeConstants(ChainConstants):
    """Geometry of a tree with ties; `body` is placed on the joint `carrier`.

    Attributes
    ----------
    parents : joint that each joint hangs on, counted from 1; 0 is the ground.
    carrier : joint of the body.
    ties : tuple of Tie
    """

    parents: tuple[int, ...] = ()
    carrier: int = 0
    ties: tuple[Tie, ...] = ()

    def __hash__(self) -> int:
        return self._hash

    def support(self, joint: int) -> list[int]:
        """Joints from the ground to one, counted from 0."""
        joints: list[int] = []
        while joint:
            joints.append(joint - 1)
            joint = self.parents[joint - 1]
        return joints[::-1]

    def way(self, tie: Tie) -> list[tuple[int, float]]:
        """Joints from a to b, counted from 0, with their signs."""
        up, down = self.support(tie.joint_a), self.support(tie.joint_b)
        while up and down and up[0] == down[0]:
            up, down = up[1:], down[1:]
        return [*((j, -1.0) for j in reversed(up)), *((j, 1.0) for j in down)]


class TreeKinematics:
    """A tree at recorded coordinates.

    Attributes
    ----------
    J : twists of the joints in F (6, joints).
    R, p : pose of M in F.
    size : sum of the links' lengths to the body.
    roots, outward, beyond, R_C_F, p_C_F : as in `ChainKinematics`, C being F.
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
        self.R, self.p = body.R, body.p
        self.size = sum(links.lengths[j] for j in constants.support(constants.carrier))
        self.size += links.lengths[joints]
        self.R_C_F, self.p_C_F = np.eye(3), np.zeros(3)
        supports = [constants.support(j + 1) for j in range(joints)]
        self.roots = [j for j, support in enumerate(supports) if len(support) == 1]
        self.outward = [[b for b in range(joints) if a in supports[b]] for a in range(joints)]
        self.beyond = [self._beyond(field) for field in fields]

    def _beyond(self, field: ForceField) -> tuple[Array, Array]:
        """Mass and first moment in F of each joint's body and of all that hang on it."""
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
        """R and p in F of a joint's frame behind its motion, joints counted from 0."""
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
        """Twists (6, k) in F as twists in M."""
        turned = zeros(*twists.shape)
        for a, twist in enumerate(twists.T):
            turned[:3, a] = self.R.T @ twist[:3]
            turned[3:, a] = self.R.T @ (twist[3:] + cross(twist[:3], self.p))
        return turned

    def from_body(self, W: Array) -> Array:
        """A wrench given in M, in F."""
        force = self.R @ W[3:]
        return np.concatenate([self.R @ W[:3] + cross(self.p, force), force])

    def tied(self, tie: Tie, about: Array | None) -> Array:
        """Relative twist of b against a (6, joints), about the origin of F or a point."""
        tied = zeros(*self.J.shape)
        for j, sign in self.constants.way(tie):
            tied[:, j] = self.J[:, j] * sign
            if about is not None:
                tied[3:, j] = tied[3:, j] + cross(tied[:3, j], about)
        return tied
