r"""The arithmetic of a serial chain, any number of joints, on recording numbers.

Twists J_C of the joints are found in C, the frame of a joint, from it outward and inward. For six
coordinates C stands in the middle of the chain: the axes beside it are constant, the next ones
depend on one angle each, and the outermost on half of the angles, so that much of J_C is zero
whatever the posture and is never computed. Else C is the body frame M. In coordinates of one kind,
and with H_L = H - S_W, S_W[a, b] = 1/2 W . [J_a, J_b] for a before b, which does not depend on the
frame,

    n = 6:  J_C A = Ad(T_C_M),  W = A^T g,  K^F = A^T H A,  K^B = K^F - A^T S_W A
    n > 6:  J^T = Q R,  Q^T H_L Q = [[a, b], [b^T, c]],
            K^B = R^-1 (a - b c^-1 b^T) R^-T,  W = R^-1 (Q^T g)_6
    n < 6:  J = Q R with lengths scaled,  W = Q R^-T g,  C^B = J H_L^-1 J^T

which is the reduction of `cartstiff.stiffness.reduction` without its singular value decomposition.
Gravity and dead forces enter through the bodies beyond each joint: with m, m c their mass and first
moment and S_b = omega_b x m c + m v_b,

    dPhi/dq_b = -g . S_b,     d2Phi/dq_a dq_b = -(g x omega_a) . S_b    for a not after b.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from cartstiff.batch.algebra import (
    congruence,
    cross,
    inverse,
    is_zero,
    largest,
    norm_squared,
    positive_factor,
    product,
    reflections,
    solution,
    upper_inverse,
    zeros,
)
from cartstiff.batch.arithmetic import (
    ENGINE,
    JACOBIAN_CONDITION,
    LARGEST_ANGLE,
    PLAIN,
    UNBALANCED,
    add_compliances,
    connections,
    limited,
)
from cartstiff.batch.tape import Program, Scalar, Tape, cosine, larger, pick, sine, square_root
from cartstiff.geometry.se3 import Array
from cartstiff.stiffness.reduction import BALANCE, ROUNDING

__all__ = ["ChainCase", "ChainConstants", "Field", "chain_program"]

#: Entries of a rotation this near to 0 or 1 are that: they are known to rounding only.
_ROUNDED = 4e-16
#: Where all axes meet within this share of the chain's size the engine chooses the length.
_MEETING = 1e-6
#: Least pivot of the self-motion's stiffness, as a share of the largest entry, that is trusted.
_PIVOT = 1e-7


@dataclass(frozen=True)
class Field:
    """Where a constant vector in F acts: gravity on masses, or a dead force on a point.

    Attributes
    ----------
    weights : factor of the vector for each joint's body; a mass, or 1.
    points : where it acts, in the joints' frames (joints, 3).
    """

    weights: tuple[float, ...]
    points: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class ChainConstants:
    """Geometry of a chain as plain numbers; tuples, so that it can be a key.

    Attributes
    ----------
    placements : ``T_parent_joint`` (joints, 4, 4), flat.
    screws : twists of the joints in their own frames (joints, 6), flat.
    body : ``T_last_M`` (4, 4), flat.
    mimic, offset : joint positions are ``mimic q + offset``; None where they are q.
    is_length : which coordinates are distances.
    """

    placements: tuple[float, ...]
    screws: tuple[float, ...]
    body: tuple[float, ...]
    mimic: tuple[float, ...] | None
    offset: tuple[float, ...] | None
    is_length: tuple[bool, ...]


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
    fields : tuple of Field
    coupled : tuple of (indices, flat matrix)
        Springs over several coordinates.
    derivatives : bool
        Whether energy, gradient and Hessian of further potentials are given as arrays.
    """

    constants: ChainConstants
    open: tuple[bool, ...] | None
    wrench: str = "none"
    fields: tuple[Field, ...] = ()
    coupled: tuple[tuple[tuple[int, ...], tuple[float, ...]], ...] = ()
    derivatives: bool = False


class _Links:
    """The links of a chain with frames turned so that every axis is z, and their joints.

    The last of the placements is that of the body.
    """

    def __init__(self, constants: ChainConstants, position: Array) -> None:
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
        for T, before, after in zip(placements, turns[:-1], turns[1:], strict=True):
            turned = np.eye(4)
            turned[:3, :3] = _snapped(before.T @ T[:3, :3] @ after)
            turned[:3, 3] = before.T @ T[:3, 3]
            self.placements.append(turned)
        self.position = position
        # All at once: they are found side by side.
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
        rotation = np.where(np.abs(rotation - value) <= _ROUNDED, value, rotation)
    return rotation


class _Walk:
    """A walk along a chain: pose of the frame that it has reached in the one where it began."""

    def __init__(self, links: _Links) -> None:
        self.links = links
        self.R, self.p = np.eye(3).astype(object), zeros(3)

    def twist(self, joint: int) -> Array:
        """Unit twist of a joint whose frame is reached, before or behind its motion."""
        axis = self.R[:, 2]
        if not self.links.turning[joint]:
            return np.concatenate([zeros(3), axis])
        return np.concatenate([axis, cross(self.p, axis) + axis * self.links.pitches[joint]])

    def move(self, joint: int, sign: float) -> None:
        """Through the motion of a joint; with sign -1 back."""
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
        """From a joint behind its motion to the frame placed on its link."""
        T = self.links.placements[link]
        self.p = self.p + self.R @ T[:3, 3]
        self.R = self.R @ T[:3, :3]

    def inward(self, link: int) -> None:
        """Back from the frame placed on a link."""
        T = self.links.placements[link]
        self.R = self.R @ T[:3, :3].T
        self.p = self.p - self.R @ T[:3, 3]


class _Kinematics:
    """A chain in C, the frame of joint `middle` before its motion, or M where no joint is left.

    Attributes
    ----------
    J, J_M : twists of the joints in C and in M (6, joints).
    R_C_M, p_C_M, R_C_F, p_C_F : poses of M and F in C.
    size, reach : longest way along the links to M, from F and from the first axis.
    beyond : mass and first moment in C beyond each joint, for each field.
    """

    def __init__(
        self, constants: ChainConstants, position: Array, fields: tuple[Field, ...], middle: int
    ) -> None:
        links = _Links(constants, position)
        joints = len(links.turning)
        self.size, self.reach = sum(links.lengths), sum(links.lengths[1:])
        self.J, self.J_M = zeros(6, joints), zeros(6, joints)
        centres = [zeros(joints, 3) for _ in fields]

        def see(walk: _Walk, j: int) -> None:
            for centre, field in zip(centres, fields, strict=True):
                centre[j] = walk.R @ (links.turns[j].T @ np.array(field.points[j])) + walk.p

        walk = _Walk(links)
        for j in range(middle, joints):
            self.J[:, j] = walk.twist(j)
            walk.move(j, 1.0)
            see(walk, j)
            walk.outward(j + 1)
        self.R_C_M, self.p_C_M = walk.R, walk.p
        walk = _Walk(links)
        for j in range(middle - 1, -1, -1):
            walk.inward(j + 1)
            see(walk, j)
            self.J[:, j] = walk.twist(j)
            walk.move(j, -1.0)
        walk.inward(0)
        self.R_C_F, self.p_C_F = walk.R, walk.p
        # What is near the body is found from there with fewer operations.
        walk = _Walk(links)
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
            first = centre * weights[:, None]
            self.beyond.append((_sums_to_the_end(weights), _sums_to_the_end(first)))

    def wrench(self, W: Array) -> Array:
        """A wrench given in M, in C."""
        force = self.R_C_M @ W[3:]
        return np.concatenate([self.R_C_M @ W[:3] + cross(self.p_C_M, force), force])

    def adjoint(self) -> Array:
        """``Ad(T_C_M)``."""
        found = zeros(6, 6)
        found[:3, :3] = found[3:, 3:] = self.R_C_M
        for i in range(3):
            found[3:, i] = cross(self.p_C_M, self.R_C_M[:, i])
        return found


def _sums_to_the_end(rows: Array) -> Array:
    return np.cumsum(rows[::-1], axis=0)[::-1]


@lru_cache(maxsize=64)
def _middle(constants: ChainConstants) -> int:
    """The joint in whose frame the Jacobian of six coordinates is inverted with least effort."""
    counts = {}
    for joint in range(1, len(constants.screws) // 6 + 1):
        tape = Tape()
        chain = _Chain(tape, ChainCase(constants, None), joint)
        chain.inverse()
        chain.curvature(tape.vector("wrench", 6))
        counts[joint] = len(tape.operations)
    return min(counts, key=lambda joint: counts[joint])


def _field_terms(
    force: Array, kinematics: _Kinematics, beyond: tuple[Array, Array]
) -> tuple[Scalar, Array, Array]:
    """Energy, gradient and Hessian in the joint positions."""
    mass, first = beyond
    J, joints = kinematics.J, kinematics.J.shape[1]
    g = kinematics.R_C_F @ force
    energy = -(g @ (first[0] - kinematics.p_C_F * mass[0]))
    gradient, hessian = zeros(joints), zeros(joints, joints)
    S = [cross(J[:3, b], first[b]) + J[3:, b] * mass[b] for b in range(joints)]
    for a in range(joints):
        gradient[a] = -(g @ S[a])
        across = cross(g, J[:3, a])
        for b in range(a, joints):
            hessian[a, b] = hessian[b, a] = -(across @ S[b])
    return energy, gradient, hessian


def _curvature(J: Array, W: Array) -> Array:
    """``S[a, b] = 1/2 W . [J_a, J_b]`` for a before b, symmetric."""
    joints = J.shape[1]
    S = zeros(joints, joints)
    half = W * 0.5
    # Of a pair the twist with more zeros makes the row, which then has zeros too.
    order = sorted(range(joints), key=lambda a: sum(not is_zero(x) for x in J[:, a]))
    for i, b in enumerate(order):
        turn, shift = J[:3, b], J[3:, b]
        row = np.concatenate([cross(turn, half[:3]) + cross(shift, half[3:]),
                              cross(turn, half[3:])])  # fmt: skip
        for a in order[i + 1 :]:
            S[a, b] = S[b, a] = J[:, a] @ (row if a < b else -row)
    return S


class _Chain:
    """One chain under one case, as numbers on a tape."""

    def __init__(self, tape: Tape, case: ChainCase, middle: int) -> None:
        constants = case.constants
        self.n = n = len(constants.is_length)
        self.case = case
        self.q = tape.vector("q", n)
        self.position, self.mimic = self.q, None
        if constants.mimic is not None:
            self.mimic = np.reshape(constants.mimic, (-1, n))
            offset = np.zeros(len(self.mimic)) if constants.offset is None else constants.offset
            self.position = self.mimic @ self.q + np.asarray(offset, object)
        self.kinematics = _Kinematics(constants, self.position, case.fields, middle)
        self.J = self._of_coordinates(self.kinematics.J_M)
        self.W: Array | None = None
        if case.wrench != "none":
            self.W = tape.vector("wrench", 6)
        self._evaluate(tape)
        self._measure()

    def _of_coordinates(self, J: Array) -> Array:
        """A Jacobian of the coordinates from that of the joints."""
        return J if self.mimic is None else J @ self.mimic

    def _evaluate(self, tape: Tape) -> None:
        """Energy, gradient, Hessian of everything, springs balanced as the engine does."""
        case, n = self.case, self.n
        energy: Any = 0.0
        gradient, hessian = zeros(n), zeros(n, n)
        if case.derivatives:
            energy = tape.input("energies", 0)
            gradient = tape.vector("gradients", n)
            hessian = tape.vector("hessians", n * n).reshape(n, n)
            hessian = np.where(np.tri(n, dtype=bool), hessian, hessian.T)
        forces = tape.vector("forces", 3 * len(case.fields)).reshape(-1, 3)
        for force, beyond in zip(forces, self.kinematics.beyond, strict=True):
            E, g, H = _field_terms(force, self.kinematics, beyond)
            if (M := self.mimic) is not None:
                g, H = M.T @ g, congruence(M, H)
            energy, gradient, hessian = energy + E, gradient + g, hessian + H
        for indices, flat in case.coupled:
            matrix = np.reshape(flat, (len(indices), -1))
            force = matrix @ self.q[list(indices)]
            energy = energy + (force @ self.q[list(indices)]) * 0.5
            gradient[list(indices)] = gradient[list(indices)] + force
            hessian[np.ix_(indices, indices)] = hessian[np.ix_(indices, indices)] + matrix
        if case.open is not None:
            stiffness = tape.vector("stiffness", n)
            rest = tape.vector("rest", n)
            wanted = zeros(n) if self.W is None else self.J.T @ self.W
            for a in range(n):
                hessian[a, a] = hessian[a, a] + stiffness[a]
                if self.W is not None or case.open[a]:
                    torque = wanted[a] - gradient[a]
                    energy = energy + torque * torque / stiffness[a] * 0.5
                    gradient[a] = wanted[a]
                else:
                    stretch = self.q[a] - rest[a]
                    energy = energy + stiffness[a] * stretch * stretch * 0.5
                    gradient[a] = gradient[a] + stiffness[a] * stretch
        self.energy, self.gradient, self.hessian = energy, gradient, hessian

    def _measure(self) -> None:
        """Characteristic length, natural sizes of the coordinates, and the first verdict."""
        self.verdict: Scalar = PLAIN
        if self.mimic is None:  # axes are unit vectors
            kinds = np.reshape(self.case.constants.screws, (-1, 6))
            turning: list[Scalar] = [1.0 if np.any(k[:3]) else 0.0 for k in kinds]
        else:
            turning = [norm_squared(self.J[:3, a]) for a in range(self.n)]
        total = sum(turning[1:], turning[0])
        self.length: Scalar = 1.0
        self.area: Scalar = 1.0
        if not (isinstance(total, float) and total == 0.0):
            moments = [
                norm_squared(self.J[3:, a])
                for a in range(self.n)
                if not (isinstance(turning[a], float) and turning[a] == 0.0)
            ]
            self.area = sum(moments[1:], moments[0]) / total
            self.length = square_root(self.area)
            least = _MEETING * self.kinematics.size
            self.verdict = pick(least**2, self.area, PLAIN, ENGINE)
            far = limited(norm_squared(self.position), LARGEST_ANGLE**2)
            self.verdict = larger(self.verdict, far)
        self.columns = zeros(self.n)
        for a, is_length in enumerate(self.case.constants.is_length):
            self.columns[a] = self.length if is_length else 1.0

    def load(self) -> Array | None:
        """The wrench where it is known beforehand."""
        if self.W is None and self.case.open is not None and all(self.case.open):
            return zeros(6)
        return self.W

    def lagrangian(self, W: Array) -> Array:
        """H_L in the coordinates."""
        return self.hessian - self.curvature(W)

    def curvature(self, W: Array) -> Array:
        """S_W in the coordinates."""
        S = _curvature(self.kinematics.J, self.kinematics.wrench(W))
        return S if self.mimic is None else congruence(self.mimic, S)

    def inverse(self) -> Array:
        """J^-1 of six coordinates, and the verdict on it."""
        found = self.kinematics
        # So that turns and shifts are of one size any length near the reach serves; 1 is free.
        length = 4.0 ** round(math.log(found.reach or 1.0, 4.0))
        scale = np.repeat([length, 1.0], 3)[:, None]
        A = solution(self._of_coordinates(found.J) * scale, found.adjoint() * scale)
        # Where the characteristic length is small beside that, C knows less than M would.
        limit = self.area * (JACOBIAN_CONDITION / max(length, found.reach)) ** 2
        condition = self.condition((self.J * self.columns).T, (A / self.columns[:, None]).T)
        self.verdict = larger(self.verdict, pick(condition, limit, PLAIN, ENGINE))
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

    def pose(self) -> Array:
        """``T_F_M``."""
        found, T = self.kinematics, zeros(4, 4)
        T[:3, :3] = found.R_C_F.T @ found.R_C_M
        T[:3, 3] = found.R_C_F.T @ (found.p_C_M - found.p_C_F)
        T[3, 3] = 1.0
        return T


def _six(chain: _Chain, wanted: Collection[str]) -> tuple[Array, Array, Array]:
    """W, K^B and K^F of six coordinates."""
    A = chain.inverse()
    W = chain.load()
    if W is None:
        W = A.T @ chain.gradient
    if not {"stiffness_F", "compliance_F"} & set(wanted):
        return W, congruence(A, chain.lagrangian(W)), zeros(6, 6)
    K_F = congruence(A, chain.hessian)
    # A^T S A as the symmetric part of a triangular form: half the products.
    upper = chain.curvature(W) * (np.triu(np.ones((6, 6)), 1) + 0.5 * np.eye(6))
    half = product(upper, A)
    K_B = zeros(6, 6)
    for i in range(6):
        row = K_F[i, i:]
        for a in range(6):
            row = row - half[a, i:] * A[a, i]
            row = row - A[a, i:] * half[a, i]
        K_B[i, i:] = K_B[i:, i] = row
    return W, K_B, K_F


def _redundant(chain: _Chain) -> tuple[Array, Array]:
    """W and K^B of more than six joints, the energy least over the self-motion."""
    n, columns = chain.n, chain.columns
    Q = reflections((chain.J * columns).T)
    inverse_R = upper_inverse(Q.R)
    regular = limited(chain.condition(Q.R, inverse_R), JACOBIAN_CONDITION**2)
    W = chain.load()
    balanced: Scalar = PLAIN
    if W is None:
        gradient = chain.gradient * columns
        turned = Q.apply_transposed(gradient)
        W = inverse_R @ turned[:6]
        noise = largest(chain.hessian * columns * columns[:, None]) * ROUNDING
        limit = largest(gradient) * BALANCE + noise
        felt = square_root(norm_squared(turned[6:]))
        # The engine's basis of the self-motion is another: its largest entry is only bounded.
        balanced = pick(felt, limit * 0.5, PLAIN,
                        pick(limit * (2.0 * n), felt, UNBALANCED, ENGINE))  # fmt: skip
    H = chain.lagrangian(W) * columns * columns[:, None]
    turned_H = Q.conjugate(H)
    L, inverses, least = positive_factor(turned_H[6:, 6:])
    reached = turned_H[6:, :6].astype(object)
    for i in range(1, n - 6):
        reached[i] = reached[i] - L[i, :i] @ reached[:i]
    S = turned_H[:6, :6] - congruence(reached, np.diag(inverses))
    stable = pick(largest(H) * _PIVOT, least, PLAIN, ENGINE)
    # An unbalanced posture has no H_L; whatever else is doubtful goes to the engine.
    verdict = pick(balanced, 0.5, larger(balanced, stable), balanced)
    verdict = pick(regular, 0.5, verdict, ENGINE)
    chain.verdict = pick(chain.verdict, 0.5, verdict, ENGINE)
    return W, congruence(inverse_R.T, S)


def _deficient(chain: _Chain, found: dict[str, Array], wanted: Collection[str]) -> Array:
    """W of least norm, and the compliances, of fewer than six joints."""
    columns, length = chain.columns, chain.length
    scaled = chain.J * columns
    scaled[3:] = scaled[3:] / length
    Q = reflections(scaled)
    inverse_R = upper_inverse(Q.R)
    condition = norm_squared(Q.R) * norm_squared(inverse_R)
    verdict = limited(condition, JACOBIAN_CONDITION**2)
    W = chain.load()
    if W is None:
        w = zeros(6)
        w[: chain.n] = inverse_R.T @ (chain.gradient * columns)
        W = Q.apply(w)
        W[3:] = W[3:] / length
    if any(f"compliance_{name}" in wanted for name in "ABK"):
        H = chain.lagrangian(W) * columns * columns[:, None]
        inverse_H = inverse(H)
        condition = norm_squared(H) * norm_squared(inverse_H)
        verdict = larger(verdict, limited(condition, 1e24))
        C = congruence((chain.J * columns).T, inverse_H)
        changes = connections(zeros(6, 6), W)
        for name, D in changes.items():
            if f"compliance_{name}" in wanted:
                factor = D @ C
                factor[range(6), range(6)] = factor.diagonal() + 1.0
                turned = inverse(factor)
                condition = norm_squared(factor) * norm_squared(turned)
                verdict = larger(verdict, limited(condition, 1e24))
                found[f"compliance_{name}"] = C if name == "B" else C @ turned
    chain.verdict = larger(chain.verdict, verdict)
    return W


def chain_program(case: ChainCase, wanted: Collection[str]) -> Program:
    """Tape of the outputs that are wanted and exist, and of the verdict on the posture."""
    tape = Tape()
    joints, n = len(case.constants.screws) // 6, len(case.constants.is_length)
    chain = _Chain(tape, case, _middle(case.constants) if n == 6 else joints)
    found: dict[str, Array] = {
        "pose": chain.pose(),
        "jacobian": chain.J,
        "energy": np.array([chain.energy], object),
    }
    stiffness: dict[str, Array] = {}
    if chain.n < 6:
        W = _deficient(chain, found, wanted)
    elif chain.n == 6:
        W, K_B, K_F = _six(chain, wanted)
        stiffness = {**connections(K_B, W), "F": K_F}
    else:
        W, K_B = _redundant(chain)
        stiffness = connections(K_B, W)
    found["wrench"] = W
    found.update({f"stiffness_{name}": K for name, K in stiffness.items()})
    verdict = add_compliances(found, stiffness, wanted, chain.length)
    # What does not balance stays so, whatever its stiffness would be.
    both = larger(chain.verdict, verdict)
    found["verdict"] = np.array([pick(chain.verdict, 1.5, both, chain.verdict)], object)
    outputs = {name: found[name] for name in (*wanted, "verdict") if name in found}
    shared = ["stiffness", "rest", "forces"] + (["wrench"] if case.wrench == "shared" else [])
    return tape.program(outputs, shared)
