r"""The arithmetic of a serial chain, any number of joints, on recording numbers.

Twists J_C of the joints are found in C, the frame of a joint, from it outward and inward. For six
coordinates C stands in the middle of the chain: the axes beside it are constant, the next ones
depend on one angle each, and the outermost on half of the angles, so that much of J_C is zero
whatever the posture and is never computed. Else C is the body frame M. In coordinates of one kind,
with L[a, b] = W . [J_a, J_b] for a behind b, else 0, which does not depend on the frame, and with
H_L = H - S_W, S_W = -1/2 (L + L^T),

    n = 6:  J_C A = Ad(T_C_M),  W = A^T g,  K^F = A^T H A,  K^B = K^F + A^T L A - 1/2 Omega
    n > 6:  J^T = Q R,  Q^T H_L Q = [[a, b], [b^T, c]],
            K^B = R^-1 (a - b c^-1 b^T) R^-T,  W = R^-1 (Q^T g)_6
    n < 6:  J = Q R with lengths scaled,  W = Q R^-T g
    any n:  C^B = J H_L^-1 J^T

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

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    below,
    congruence,
    cross,
    is_zero,
    largest,
    norm_squared,
    positive_factor,
    reflections,
    solution,
    symmetric_product,
    upper_inverse,
    zeros,
)
from cartstiff.many.arithmetic import (
    ENGINE,
    JACOBIAN_CONDITION,
    LARGEST_ANGLE,
    PLAIN,
    UNBALANCED,
    changed_compliance,
    connections,
    holds_soft_directions,
    limited,
    noteworthy,
    unsymmetric_part,
)
from cartstiff.many.chain_twists import ChainConstants, ChainKinematics, Field
from cartstiff.many.tape import Scalar, Tape, larger, pick, square_root
from cartstiff.numerics import BALANCE, ROUNDING

__all__ = ["ChainCase", "chain_arrays", "chain_motion"]

#: Where all axes meet within this share of the chain's size the engine chooses the length.
_MEETING = numerics.NEARBY
#: Least pivot of the Hessian, as a share of its diagonal entry: what is lost is four digits.
_SHARE = numerics.LOST
#: Least pivot of the self-motion's stiffness, and least size of what it leaves, as shares of the
#: largest entry, that are trusted.
_PIVOT = numerics.LOST


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


@lru_cache(maxsize=64)
def _middle(constants: ChainConstants) -> int:
    """The joint in whose frame the Jacobian of six coordinates is inverted with least effort."""
    counts = {}
    for joint in range(1, len(constants.screws) // 6 + 1):
        tape = Tape()
        chain = _Chain(tape, ChainCase(constants, None), joint)
        chain.inverse()
        counts[joint] = len(tape.operations)
    return min(counts, key=lambda joint: counts[joint])


def _field_terms(
    force: Array, kinematics: ChainKinematics, beyond: tuple[Array, Array]
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


def _against(twist: Array, W: Array) -> Array:
    """What gives ``-W . [twist, X]`` with any X."""
    turn, shift = twist[:3], twist[3:]
    return np.concatenate([cross(turn, W[:3]) + cross(shift, W[3:]), cross(turn, W[3:])])


def _curvature(J: Array, W: Array) -> Array:
    """``S[a, b] = 1/2 W . [J_a, J_b]`` for a before b, symmetric."""
    joints = J.shape[1]
    S = zeros(joints, joints)
    half = W * 0.5
    # Of a pair the twist with more zeros makes the row, which then has zeros too.
    order = sorted(range(joints), key=lambda a: sum(not is_zero(x) for x in J[:, a]))
    for i, b in enumerate(order):
        row = _against(J[:, b], half)
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
        self.kinematics = ChainKinematics(constants, self.position, case.fields, middle)
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
            area = sum(moments[1:], moments[0]) / total
            if not is_zero(area):  # else the engine chooses
                self.area, self.length = area, square_root(area)
            least = _MEETING * self.kinematics.size
            self.verdict = pick(least**2, area, PLAIN, ENGINE)
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

    def pose(self) -> Array:
        """``T_F_M``."""
        found, T = self.kinematics, zeros(4, 4)
        T[:3, :3] = found.R_C_F.T @ found.R_C_M
        T[:3, 3] = found.R_C_F.T @ (found.p_C_M - found.p_C_F)
        T[3, 3] = 1.0
        return T


def _six(chain: _Chain) -> tuple[Array, Array, Array]:
    """W, K^B and K^F of six coordinates."""
    A = chain.inverse()
    W = chain.load()
    if W is None:
        W = A.T @ chain.gradient
    K_F = congruence(A, chain.hessian)
    if chain.mimic is not None:
        return W, congruence(A, chain.lagrangian(W)), K_F
    return W, symmetric_product(A.T, -_curved(chain, A, W), K_F + unsymmetric_part(W)), K_F


def _curved(chain: _Chain, A: Array, W: Array) -> Array:
    """``-L A`` with L the lower triangle of J^T Omega J, without diagonal, and ``A = J^-1``.

    As J^T Omega J A = J^T Omega = N, row a of L A is sum_(b < a) L[a, b] A_b as well as
    N_a - sum_(b >= a) (N J)[a, b] A_b. Joints near the body have sparse twists in M: their half of
    the rows takes the second form, and of all pairs of joints only those within a half are needed,
    in C those of the first.
    """
    half = 3
    curved = zeros(6, 6)
    J, found = chain.J, chain.kinematics
    S = _curvature(found.J[:, :half], found.wrench(W * 2.0))
    for a in range(half):
        for b in range(a):
            curved[a] = curved[a] + A[b] * S[a, b]
    for a in range(half, 6):
        curved[a] = minus_N = _against(J[:, a], W)
        for b in range(a + 1, 6):
            curved[a] = curved[a] - A[b] * (minus_N @ J[:, b])
    return curved


def _redundant(chain: _Chain) -> tuple[Array, Array]:
    """W and K^B of more than six joints, the energy least over the self-motion."""
    n, columns = chain.n, chain.columns
    Q = reflections((chain.J * columns).T)
    inverse_R = upper_inverse(Q.R)
    chain.squared_condition = chain.condition(Q.R, inverse_R)
    regular = limited(chain.squared_condition, JACOBIAN_CONDITION**2)
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
    L, inverses, pivots = positive_factor(turned_H[6:, 6:])
    reached = below(L, turned_H[6:, :6])
    S = turned_H[:6, :6] - congruence(reached, np.diag(inverses))
    limit = largest(H) * _PIVOT
    stable: Scalar = PLAIN
    for pivot in pivots:
        stable = larger(stable, pick(limit, pivot, PLAIN, ENGINE))
    stable = larger(stable, pick(limit * limit, norm_squared(S), PLAIN, ENGINE))
    # An unbalanced posture has no H_L; whatever else is doubtful goes to the engine.
    verdict = pick(balanced, 0.5, larger(balanced, stable), balanced)
    verdict = pick(regular, 0.5, verdict, ENGINE)
    chain.verdict = pick(chain.verdict, 0.5, verdict, ENGINE)
    return W, congruence(inverse_R.T, S)


def _deficient(chain: _Chain) -> Array:
    """W of least norm of fewer than six joints."""
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
    chain.verdict = larger(chain.verdict, verdict)
    chain.squared_condition = condition
    return W


def _compliances(
    chain: _Chain, W: Array, found: dict[str, Array], wanted: Collection[str]
) -> Scalar:
    """Put ``C^X = J (H_L + J^T D J)^-1 J^T`` into `found`, D = K^X - K^B; the verdict on them."""
    names = [name for name in "ABKF" if f"compliance_{name}" in wanted]
    verdict: Scalar = PLAIN
    if not names:
        return verdict
    unloaded = all(is_zero(w) for w in W)
    C, verdict = _softness(chain, chain.hessian if unloaded else chain.lagrangian(W))
    for name in names:
        if name == "F":
            if chain.n != 6:
                continue
            C_F, doubt = (C, PLAIN) if unloaded else _softness(chain, chain.hessian)
            found["compliance_F"], verdict = C_F, larger(verdict, doubt)
        elif name == "B" or unloaded:
            found[f"compliance_{name}"] = C
        else:
            D = connections(zeros(6, 6), W)[name]
            found[f"compliance_{name}"], doubt = changed_compliance(C, D, chain.length)
            verdict = larger(verdict, doubt)
    return verdict


def _softness(chain: _Chain, H: Array) -> tuple[Array, Scalar]:
    """``J H^-1 J^T`` and the verdict on it."""
    L, inverses, pivots = positive_factor(H)
    verdict: Scalar = PLAIN
    for a, pivot in enumerate(pivots):
        verdict = larger(verdict, pick(H[a, a] * _SHARE, pivot, PLAIN, ENGINE))
    return congruence(below(L, chain.J.T), np.diag(inverses)), verdict


def chain_motion(tape: Tape, constants: ChainConstants) -> tuple[Array, Array]:
    """Pose (4, 4) and body Jacobian (6, n)."""
    chain = _Chain(tape, ChainCase(constants, None), len(constants.screws) // 6)
    return chain.pose(), chain.J


def chain_arrays(tape: Tape, case: ChainCase, wanted: Collection[str]) -> dict[str, Array]:
    """What of the outputs exists, among it all that is wanted, and "verdict" on the posture."""
    joints, n = len(case.constants.screws) // 6, len(case.constants.is_length)
    chain = _Chain(tape, case, _middle(case.constants) if n == 6 else joints)
    found: dict[str, Array] = {
        "pose": chain.pose(),
        "jacobian": chain.J,
        "energy": np.array([chain.energy], object),
    }
    stiffness: dict[str, Array] = {}
    if chain.n < 6:
        W = _deficient(chain)
    elif chain.n == 6:
        W, K_B, K_F = _six(chain)
        stiffness = {**connections(K_B, W), "F": K_F}
    else:
        W, K_B = _redundant(chain)
        stiffness = connections(K_B, W)
    found["wrench"] = W
    found.update({f"stiffness_{name}": K for name, K in stiffness.items()})
    verdict = _compliances(chain, W, found, wanted)
    if stiffness:
        verdict = larger(verdict, holds_soft_directions(stiffness["B"], wanted))
    # What does not balance stays so, whatever its stiffness would be.
    both = larger(chain.verdict, verdict)
    found["verdict"] = np.array([pick(chain.verdict, 1.5, both, chain.verdict)], object)
    if "noteworthy" in wanted and stiffness and "compliance_B" in found:
        H = chain.lagrangian(W)
        L, inverses, _ = positive_factor(H)
        softness = congruence(below(L, np.eye(n)), np.diag(inverses))
        pairs = (H, softness), (stiffness["B"], found["compliance_B"])
        margin = 2.0 if n == 6 else 100.0
        found["noteworthy"] = noteworthy(chain.squared_condition, *pairs, margin=margin)
    return found
