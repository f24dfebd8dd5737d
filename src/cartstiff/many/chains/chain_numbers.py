r"""A serial chain as recording numbers: twists, energy, scales, the Lagrangian Hessian.

Gravity and dead forces enter through the bodies beyond each joint: with m, m c their mass and first
moment and S_b = omega_b x m c + m v_b,

    dPhi/dq_b = -g . S_b,     d2Phi/dq_a dq_b = -(g x omega_a) . S_b    for b not before a.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import congruence, cross, is_zero, norm_squared, solution, zeros
from cartstiff.many.arithmetic import (
    ENGINE,
    JACOBIAN_CONDITION,
    LARGEST_ANGLE,
    PLAIN,
    limited,
    noteworthy,
)
from cartstiff.many.chains.chain_twists import ChainConstants, ChainKinematics, ForceField
from cartstiff.many.chains.lines import Line, line_terms
from cartstiff.many.chains.masses import Bodies, kinetic
from cartstiff.many.chains.spring_laws import JointSpringNumbers
from cartstiff.many.chains.tree_twists import TreeKinematics
from cartstiff.many.tape import Scalar, Tape, larger, pick, square_root
from cartstiff.potentials.springs import SpringLaw

#: Where all axes meet within this share of the chain's size the engine chooses the length.
_MEETING = numerics.NEARBY


@dataclass(frozen=True)
class ChainCase:
    """What acts on a chain.

    Attributes
    ----------
    constants : ChainConstants
    open : tuple of bool or None
        Coordinates whose rest position is chosen posture by posture; None without springs.
    wrench : {"none", "shared", "each"}
        Whether a wrench is given: one for all postures, or one for each.
    fields : tuple of ForceField
    stretched : tuple of Line
        Line springs and cables whose rest lengths are known.
    coupled : tuple of (indices, flat matrix)
        Springs over several coordinates.
    derivatives : bool
        Whether energy, gradient and Hessian of further potentials are given as arrays.
    segments : tuple of tuples of int
        Coordinates of segments of beams, whose derivatives are given segment by segment.
    settled : tuple of int
        Coordinates without springs of their own that are at rest under the wrench before
        anything is asked: `settling` finds where.
    dead_load_at : tuple of 3 floats, optional
        Point of M at which a dead load acts whose components are along the axes of F: `settling`
        alone reads it, and finds the load in M.
    singular : bool
        Whether it is for postures that have lost rank: what needs no inverse of the Jacobian.
    laws : tuple of (int, SpringLaw)
        Nonlinear springs among the coordinates' own.
    bodies : Bodies, optional
        All masses, where vibrations count.
    rigid : tuple of int
        Coordinates that stay where they are whatever acts.
    """

    constants: ChainConstants
    open: tuple[bool, ...] | None
    wrench: str = "none"
    fields: tuple[ForceField, ...] = ()
    stretched: tuple[Line, ...] = ()
    coupled: tuple[tuple[tuple[int, ...], tuple[float, ...]], ...] = ()
    derivatives: bool = False
    segments: tuple[tuple[int, ...], ...] = ()
    settled: tuple[int, ...] = ()
    dead_load_at: tuple[float, float, float] | None = None
    singular: bool = False
    laws: tuple[tuple[int, SpringLaw], ...] = ()
    bodies: Bodies | None = None
    rigid: tuple[int, ...] = ()

    @property
    def moving(self) -> list[int]:
        """Coordinates that give."""
        return [a for a in range(len(self.constants.is_length)) if a not in self.rigid]

    @property
    def freedoms(self) -> int:
        """How many motions there are."""
        return len(self.moving)


def _field_terms(
    force: Array, kinematics: ChainKinematics | TreeKinematics, beyond: tuple[Array, Array]
) -> tuple[Scalar, Array, Array]:
    """Energy, gradient and Hessian in the joint positions."""
    mass, first = beyond
    J, joints = kinematics.J, kinematics.J.shape[1]
    g = kinematics.R_C_F @ force
    energy = -sum(g @ (first[a] - kinematics.p_C_F * mass[a]) for a in kinematics.roots)
    gradient, hessian = zeros(joints), zeros(joints, joints)
    S = [cross(J[:3, b], first[b]) + J[3:, b] * mass[b] for b in range(joints)]
    for a in range(joints):
        gradient[a] = -(g @ S[a])
        across = cross(g, J[:3, a])
        for b in kinematics.outward[a]:
            hessian[a, b] = hessian[b, a] = -(across @ S[b])
    return energy, gradient, hessian


def _lower(matrix: Array) -> Array:
    """A symmetric matrix by its lower triangle."""
    return np.where(np.tri(len(matrix), dtype=bool), matrix, matrix.T)


def against(twist: Array, W: Array) -> Array:
    """What gives ``-W . [twist, X]`` with any X."""
    turn, shift = twist[:3], twist[3:]
    return np.concatenate([cross(turn, W[:3]) + cross(shift, W[3:]), cross(turn, W[3:])])


def curvature_of(J: Array, W: Array) -> Array:
    """``S[a, b] = 1/2 W . [J_a, J_b]`` for a before b, symmetric."""
    joints = J.shape[1]
    S = zeros(joints, joints)
    half = W * 0.5
    # Of a pair the twist with more zeros makes the row, which then has zeros too.
    order = sorted(range(joints), key=lambda a: sum(not is_zero(x) for x in J[:, a]))
    for i, b in enumerate(order):
        row = against(J[:, b], half)
        for a in order[i + 1 :]:
            S[a, b] = S[b, a] = J[:, a] @ (row if a < b else -row)
    return S


class ChainNumbers:
    """One chain under one case, as numbers on a tape."""

    is_closed = False
    #: The verdict on deflections of springs and lengths of lines.
    of_springs: Scalar = PLAIN
    # Of a closed chain they are other ones.
    case: Any
    kinematics: Any
    columns: Array
    gradient: Array
    hessian: Array

    def __init__(self, tape: Tape, case: ChainCase, middle: int) -> None:
        constants, n = case.constants, len(case.constants.is_length)
        self.n, self.has_chart = case.freedoms, n == case.freedoms == 6
        self.case = case
        self.q = tape.vector("q", n)
        self.position, self.mimic = self.q, None
        if constants.mimic is not None:
            self.mimic = np.reshape(constants.mimic, (-1, n))
            offset = np.zeros(len(self.mimic)) if constants.offset is None else constants.offset
            self.position = self.mimic @ self.q + np.asarray(offset, object)
        self.kinematics = ChainKinematics(constants, self.position, case.fields, middle)
        self.J = self.J_q = self._of_coordinates(self.kinematics.J_M)
        self.W: Array | None = None
        if case.wrench != "none":
            self.W = tape.vector("wrench", 6)
        self._evaluate(tape)
        turning: list[Scalar]
        if self.mimic is None:  # axes are unit vectors
            kinds = np.reshape(constants.screws, (-1, 6))
            turning = [1.0 if np.any(k[:3]) else 0.0 for k in kinds]
        else:
            turning = [norm_squared(column) for column in self.J[:3].T]
        self._measure(self.J, turning, constants.is_length)
        if case.rigid:
            self._hold(case.moving)

    def _hold(self, moving: list[int]) -> None:
        """Leave the motions of some coordinates only: the others are rigid."""
        own = np.eye(len(self.q)) if self.mimic is None else self.mimic
        self.mimic, self.J = own[:, moving], self.J_q[:, moving]
        self.columns = self.columns[moving]
        self.gradient, self.hessian = self.gradient[moving], self.hessian[np.ix_(moving, moving)]

    def _of_coordinates(self, J: Array) -> Array:
        """A Jacobian of the coordinates from that of the joints."""
        return J if self.mimic is None else J @ self.mimic

    def _others(self, tape: Tape) -> tuple[Any, Array, Array]:
        """Energy, gradient, Hessian of everything but the springs."""
        case, n = self.case, len(self.q)
        energy: Any = 0.0
        gradient, hessian = zeros(n), zeros(n, n)
        if case.derivatives or case.segments:
            energy = tape.input("energies", 0)
        if case.derivatives:
            gradient = tape.vector("gradients", n)
            hessian = _lower(tape.vector("hessians", n * n).reshape(n, n))
        own = tape.vector("segment_gradients", 6 * len(case.segments)).reshape(-1, 6)
        each = tape.vector("segment_hessians", 36 * len(case.segments)).reshape(-1, 6, 6)
        for indices, g, H in zip(map(list, case.segments), own, each, strict=True):
            gradient[indices] = gradient[indices] + g
            hessian[np.ix_(indices, indices)] = hessian[np.ix_(indices, indices)] + _lower(H)
        for E, g, H in self._on_bodies(tape):
            if (M := self.mimic) is not None:
                g, H = M.T @ g, congruence(M, H)
            energy, gradient, hessian = energy + E, gradient + g, hessian + H
        for indices, flat in case.coupled:
            matrix = np.reshape(flat, (len(indices), -1))
            force = matrix @ self.q[list(indices)]
            energy = energy + (force @ self.q[list(indices)]) * 0.5
            gradient[list(indices)] = gradient[list(indices)] + force
            hessian[np.ix_(indices, indices)] = hessian[np.ix_(indices, indices)] + matrix
        return energy, gradient, hessian

    def _on_bodies(self, tape: Tape) -> Iterator[tuple[Scalar, Array, Array]]:
        """Energy, gradient, Hessian in the joint positions of each force and line on the bodies."""
        case = self.case
        forces = tape.vector("forces", 3 * len(case.fields)).reshape(-1, 3)
        for force, beyond in zip(forces, self.kinematics.beyond, strict=True):
            yield _field_terms(force, self.kinematics, beyond)
        lines = tape.vector("lines", 2 * len(case.stretched)).reshape(-1, 2)
        for line, (stiffness, rest) in zip(case.stretched, lines, strict=True):
            E, g, H, doubt = line_terms(line, stiffness, rest, self.kinematics)
            self.of_springs = larger(self.of_springs, doubt)
            yield E, g, H

    def _evaluate(self, tape: Tape) -> None:
        """Energy, gradient, Hessian of everything, springs balanced as the engine does."""
        case, n = self.case, len(self.q)
        energy, gradient, hessian = self._others(tape)
        if case.open is not None:
            springs = JointSpringNumbers(tape, n, case.laws)
            wanted = zeros(n) if self.W is None else self.J.T @ self.W
            for a in (a for a in case.moving if a not in case.settled):
                if self.W is not None or case.open[a]:
                    own, stiffness = springs.under(a, wanted[a] - gradient[a])
                    gradient[a] = wanted[a]
                else:
                    own, torque, stiffness = springs.at(a, self.q[a])
                    gradient[a] = gradient[a] + torque
                energy, hessian[a, a] = energy + own, hessian[a, a] + stiffness
            self.of_springs = larger(self.of_springs, springs.verdict)
        self.energy, self.gradient, self.hessian = energy, gradient, hessian

    def _measure(self, J: Array, turning: Sequence[Scalar], is_length: Sequence[bool]) -> None:
        """Characteristic length, natural sizes of the coordinates, and the first verdict.

        From twists J (6, k) in M, and how much each of them turns.
        """
        self.verdict: Scalar = self.of_springs
        total = sum(turning[1:], turning[0])
        self.length: Scalar = 1.0
        self.area: Scalar = 1.0
        if not (isinstance(total, float) and total == 0.0):
            moments = [
                norm_squared(J[3:, a])
                for a in range(J.shape[1])
                if not (isinstance(turning[a], float) and turning[a] == 0.0)
            ]
            area = sum(moments[1:], moments[0]) / total
            if not is_zero(area):  # else the engine chooses
                self.area, self.length = area, square_root(area)
            least = _MEETING * self.kinematics.size
            self.verdict = larger(self.verdict, pick(least**2, area, PLAIN, ENGINE))
            far = limited(norm_squared(self.position), LARGEST_ANGLE**2)
            self.verdict = larger(self.verdict, far)
        self.columns = zeros(len(is_length))
        for a, is_distance in enumerate(is_length):
            self.columns[a] = self.length if is_distance else 1.0

    def load(self) -> Array | None:
        """The wrench where it is known beforehand."""
        is_open = self.case.open
        if self.W is None and is_open is not None and all(is_open[a] for a in self.case.moving):
            return zeros(6)
        return self.W

    def lagrangian(self, W: Array) -> Array:
        """H_L in the coordinates."""
        return self.hessian - self.curvature(W)

    def curvature(self, W: Array) -> Array:
        """S_W in the coordinates."""
        S = curvature_of(self.kinematics.J, self.kinematics.wrench(W))
        return S if self.mimic is None else congruence(self.mimic, S)

    def inverse(self) -> Array:
        """J^-1 of six coordinates, and the verdict on it."""
        kinematics = self.kinematics
        # So that turns and shifts are of one size any length near the reach serves; 1 is free.
        length = 4.0 ** round(math.log(kinematics.reach or 1.0, 4.0))
        scale = np.repeat([length, 1.0], 3)[:, None]
        A = solution(self._of_coordinates(kinematics.J) * scale, kinematics.adjoint() * scale)
        # Where the characteristic length is small beside that, C knows less than M would.
        limit = self.area * (JACOBIAN_CONDITION / max(length, kinematics.reach)) ** 2
        condition = self.condition((self.J * self.columns).T, (A / self.columns[:, None]).T)
        self.verdict = larger(self.verdict, pick(condition, limit, PLAIN, ENGINE))
        self.squared_condition = condition
        return A

    def condition(self, forward: Array, backward: Array) -> Scalar:
        """Bound on the squared condition number of the scaled Jacobian.

        From its transpose and its transposed inverse, or what differs from them by a rotation of
        the coordinates.
        """
        if self.mimic is None and not any(self.case.constants.is_length):
            size: Scalar = 2.0 * self.n  # by the choice of the length
        else:
            size = norm_squared(forward[:, :3]) + norm_squared(forward[:, 3:]) / self.area
        return size * (norm_squared(backward[:3]) + norm_squared(backward[3:]) * self.area)

    def noteworthy(self, own: tuple[Array, Array], outer: tuple[Array, Array]) -> Array:
        """Whether notes may tell of something near, and of digits: `arithmetic.noteworthy`.

        From H_L in the coordinates and K^B, each with its inverse.
        """
        margin = 2.0 if self.n == 6 else 100.0
        return noteworthy(self.squared_condition, own, outer, margin=margin)

    def kinetic(self, bodies: Bodies) -> Array:
        """Masses' matrix in the coordinates."""
        M = kinetic(bodies, self.kinematics)
        return M if self.mimic is None else congruence(self.mimic, M)

    def pose(self) -> Array:
        """``T_F_M``."""
        kinematics, T = self.kinematics, zeros(4, 4)
        T[:3, :3] = kinematics.R_C_F.T @ kinematics.R_C_M
        T[:3, 3] = kinematics.R_C_F.T @ (kinematics.p_C_M - kinematics.p_C_F)
        T[3, 3] = 1.0
        return T
