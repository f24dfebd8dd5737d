r"""A closed chain as recording numbers: the numbers of an open one on the motions that stay closed.

With closures C dq = 0, dependent coordinates D and independent ones I, all motions are
``dq = N dx``, N = 1 on I and ``-C_D^-1 C_I`` on D. In the coordinates x of these motions

    J = J_q N,    g = N^T g_q,    H = N^T (H_q + lam c'') N,    C_D^T lam = -(g_q)_D,
    S_W = N^T (S_q,W - mu c'') N,    C_D^T mu = (J_q^T W)_D

and everything goes on as for an open chain. The reduction of `cartstiff.stiffness` is the same with
a basis from the singular value decomposition. I are the coordinates that are held while the chain
is closed, or a choice of as many as there are motions; without any, N is orthonormal, from
reflections of C^T.

Springs c whose rest positions are chosen exert the torques t nearest to ``(J_q^T W)_c`` with
``N_c^T t = J^T W - N_s^T g_s``, g_s being what all else exerts.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    below,
    congruence,
    inverse,
    is_zero,
    largest,
    norm_squared,
    positive_factor,
    reflections,
    solution,
    upper_inverse,
    zeros,
)
from cartstiff.many.arithmetic import ENGINE, JACOBIAN_CONDITION, PLAIN, limited, noteworthy
from cartstiff.many.chains.chain_arithmetic import arrays_of
from cartstiff.many.chains.chain_numbers import ChainCase, ChainNumbers, curvature_of
from cartstiff.many.chains.spring_laws import JointSpringNumbers
from cartstiff.many.chains.tree_twists import TreeConstants, TreeKinematics
from cartstiff.many.tape import Scalar, Tape, absolute, larger, pick, square_root

#: Condition of the closures up to which their motions are known to all but four digits.
_CLOSED = 1.0 / numerics.LOST_ERROR


@dataclass(frozen=True)
class ClosedCase(ChainCase):
    """What acts on a closed chain; `open` are those of `springs` whose rest position is chosen.

    Attributes
    ----------
    balance : {"given", "chosen", "idle"}
        Whether springs exert what their rest positions say, those that are open carry all that
        acts, or nothing acts and nothing is stretched.
    springs : coordinates with a spring of their own.
    held : coordinates that stay where they are while the chain is closed, besides the rigid ones.
    independent : coordinates I, as many as closures leave, or none.
    rows : of each tie, rows of its relative twist that are independent of all others' (0 to 5).
    shut : of each tie, rows that are independent while `held` is held.
    length : characteristic length of the chain somewhere, for scales that decide nothing else.
    still : coordinates that are zero, and Hessian of their springs there: elsewhere the engine
        decides.
    has_chart : whether the independent coordinates are the chart of K^F.
    is_driven : whether the independent coordinates are the actuated ones.
    """

    constants: TreeConstants
    held: tuple[int, ...] = ()
    independent: tuple[int, ...] = ()
    rows: tuple[tuple[int, ...], ...] = ()
    shut: tuple[tuple[int, ...], ...] = ()
    length: float = 1.0
    balance: str = "idle"
    springs: tuple[int, ...] = ()
    still: tuple[tuple[tuple[int, ...], tuple[float, ...]], ...] = ()
    has_chart: bool = False
    is_driven: bool = False

    @property
    def dependent(self) -> list[int]:
        """Coordinates D."""
        return [j for j in self.moving if j not in self.independent]

    @property
    def freedoms(self) -> int:
        """How many motions stay closed."""
        return len(self.moving) - sum(map(len, self.rows))

    @property
    def ways(self) -> tuple[ClosedCase, ...]:
        """Whose steps close the chain, one after the other as long as they end in vain.

        More coordinates than there are motions can be held in few postures; in others none is.
        """
        if len(self.held) <= self.freedoms:
            return (self,)
        return self, replace(self, held=(), shut=self.rows)


class ClosedChainNumbers(ChainNumbers):
    """One closed chain under one case; coordinates are those of the motions N."""

    is_closed = True

    def __init__(self, tape: Tape, case: ClosedCase) -> None:  # its own way
        constants = case.constants
        self.case, self.n, self.has_chart = case, case.freedoms, case.has_chart
        self.q = self.position = tape.vector("q", len(constants.is_length))
        self.mimic: Array | None = None
        self.kinematics = TreeKinematics(constants, self.q, case.fields)
        doubt = self._motions(case)
        way = constants.support(constants.carrier)
        J_M = zeros(6, len(self.q))
        J_M[:, way] = self.kinematics.in_body(self.kinematics.J[:, way])
        self.J_q, self._way = J_M, way
        self.J = J_M[:, way] @ self.N[way]
        self.W = tape.vector("wrench", 6) if case.wrench != "none" else None
        kinds = np.reshape(constants.screws, (-1, 6))[way]
        turning = [1.0 if np.any(k[:3]) else 0.0 for k in kinds]
        distances = [constants.is_length[j] for j in case.independent] or [False] * self.n
        self._measure(J_M[:, way], turning, distances)
        self.verdict = larger(self.verdict, doubt)
        for j in (j for indices, _ in case.still for j in indices):
            is_still = pick(absolute(self.q[j]), numerics.TINY, PLAIN, ENGINE)
            self.verdict = larger(self.verdict, is_still)
        self._evaluate(tape)
        self.verdict = larger(self.verdict, self.of_springs)
        self.mimic = self.N

    def _motions(self, case: ClosedCase) -> Scalar:
        """N, and the verdict on it."""
        constants, tree = case.constants, self.kinematics
        kept, left = list[Array](), list[Array]()
        self._ties: list[tuple[Array, list[int]]] = []
        for tie, rows in zip(constants.ties, case.rows, strict=True):
            about = None if tie.is_weld else tree.placed(tie.joint_b, tie.T_b)[1]
            twists = tree.tied(tie, about)
            self._ties.append((twists, list(rows)))
            kept.append(twists[list(rows)])
            others = set(range(0 if tie.is_weld else 3, 6)) - set(rows)
            left.append(twists[sorted(others)])
        self.C, n = np.concatenate(kept), len(self.q)
        sizes = np.array([case.length if d else 1.0 for d in constants.is_length])
        scale = np.concatenate(
            [[1.0 if i < 3 else 1.0 / case.length for i in rows] for rows in case.rows]
        )
        scaled = self.C * scale[:, None] * sizes
        if case.independent:
            D, free = case.dependent, list(case.independent)
            # A vector in no particular direction tells how large the inverse is.
            probe = np.cos(np.arange(1.0, 1.0 + len(D)))
            solved = solution(scaled[:, D], np.column_stack([scaled[:, free], probe]))
            self.N = zeros(n, len(free))
            self.N[free] = np.eye(len(free))
            self.N[D] = solved[:, :-1] * -(sizes[D][:, None] / sizes[free])
            size = norm_squared(solved) / len(D) * norm_squared(scaled[:, D])
            limit = _CLOSED**2
        else:
            moving = case.moving
            Q = reflections(scaled[:, moving].T)
            inverse_R = upper_inverse(Q.R)
            self._solved = Q, inverse_R, scale, sizes
            last = zeros(len(moving), self.n)
            last[len(Q.R) :] = np.eye(self.n)
            self.N = zeros(n, self.n)
            self.N[moving] = Q.apply(last) * sizes[moving][:, None]
            size, limit = norm_squared(Q.R) * norm_squared(inverse_R), JACOBIAN_CONDITION**2
        verdict = limited(size, limit)
        missed = (np.concatenate(left) * sizes) @ (self.N / sizes[:, None])
        if not all(is_zero(x) for x in missed.flat):
            least = largest(self.N / sizes[:, None]) * (numerics.CLOSE * case.length)
            verdict = larger(verdict, pick(largest(missed), least, PLAIN, ENGINE))
        return verdict

    def _multipliers(self, right: Array) -> Array:
        """Closure forces that balance generalised forces (n,) on what depends on others."""
        if all(is_zero(x) for x in right.flat):
            return zeros(len(self.C))
        if self.case.independent:
            D = self.case.dependent
            return solution(self.C[:, D].T, right[D, None])[:, 0]
        Q, inverse_R, scale, sizes = self._solved
        turned = Q.apply_transposed((right * sizes)[self.case.moving])
        return (inverse_R @ turned[: len(inverse_R)]) * scale

    def _turning(self, multipliers: Array) -> Array:
        """``lam c''``."""
        n, start = len(self.q), 0
        S = zeros(n, n)
        for tie, (twists, rows) in zip(self.case.constants.ties, self._ties, strict=True):
            force = zeros(6)
            force[rows] = multipliers[start : start + len(rows)]
            start += len(rows)
            if all(is_zero(x) for x in force):
                continue
            way = [j for j, _ in self.case.constants.way(tie)]
            S[np.ix_(way, way)] = S[np.ix_(way, way)] + curvature_of(twists[:, way], force)
        return S

    def _evaluate(self, tape: Tape) -> None:
        """Energy, gradient and Hessian of everything on the motions; springs are balanced."""
        case = self.case
        energy, gradient, hessian = self._others(tape)
        for indices, flat in case.still:
            hessian[np.ix_(indices, indices)] = np.reshape(flat, (len(indices), -1))
        springs = JointSpringNumbers(tape, len(self.q), case.laws)
        chosen = [
            a for a in case.springs if case.balance == "chosen" and case.open and case.open[a]
        ]
        for a in (a for a in case.springs if a not in chosen):
            if case.balance == "idle":  # nothing is stretched
                own, stiffness = springs.under(a, 0.0)
            else:
                own, torque, stiffness = springs.at(a, self.q[a])
                gradient[a] = gradient[a] + torque
            energy, hessian[a, a] = energy + own, hessian[a, a] + stiffness
        if case.balance == "chosen":
            # The springs carry what the closures pass on to them.
            settled = [a for a in range(len(self.q)) if a not in chosen]
            wanted = -(self.N[settled].T @ gradient[settled])
            if self.W is not None:
                wanted = wanted + self.J.T @ self.W
            if case.settled:  # what the other motions feel is nothing
                wanted = wanted[[case.independent.index(a) for a in chosen]]
            elif chosen != list(case.independent):
                wanted = self._nearest(chosen, wanted)
            for a, torque in zip(chosen, wanted, strict=True):
                own, stiffness = springs.under(a, torque - gradient[a])
                energy, hessian[a, a] = energy + own, hessian[a, a] + stiffness
                gradient[a] = torque
        self.of_springs = larger(self.of_springs, springs.verdict)
        self.energy = energy
        self.gradient = self.N.T @ gradient
        self._of_joints = gradient, hessian
        turning = self._turning(self._multipliers(-gradient))
        self.hessian = congruence(self.N, hessian + turning)

    def _nearest(self, chosen: list[int], wanted: Array) -> Array:
        """The torques (c,) nearest to those of the wrench with ``N_c^T t = wanted``."""
        sizes = np.array(
            [self.case.length if self.case.constants.is_length[a] else 1.0 for a in chosen]
        )
        own = zeros(len(chosen)) if self.W is None else self.J_q[:, chosen].T @ self.W
        N = self.N[chosen] / sizes[:, None]
        gram = congruence(N, np.eye(len(chosen)))
        L, inverses, _ = positive_factor(gram)
        inverse_gram = congruence(below(L, np.eye(self.n)), np.diag(inverses))
        condition = norm_squared(gram) * norm_squared(inverse_gram)
        self.verdict = larger(self.verdict, limited(condition, JACOBIAN_CONDITION**2))
        return own + N @ (inverse_gram @ (wanted - self.N[chosen].T @ own)) / sizes

    def load(self) -> Array | None:
        """The wrench where it is known beforehand."""
        return zeros(6) if self.W is None and self.case.balance != "given" else self.W

    def lagrangian(self, W: Array) -> Array:
        """H_L on the motions: what the load turns and what the closures do meet before them."""
        return self.hessian if all(map(is_zero, W)) else congruence(self.N, self.of_joints(W))

    def of_joints(self, W: Array) -> Array:
        """H_L in all coordinates."""
        (gradient, hessian), way = self._of_joints, self._way
        H = hessian + self._turning(self._multipliers(self.J_q.T @ W - gradient))
        S = curvature_of(self.kinematics.J[:, way], self.kinematics.from_body(W))
        H[np.ix_(way, way)] = H[np.ix_(way, way)] - S
        return H

    def inverse(self) -> Array:
        """J^-1 of six motions, and the verdict on it."""
        scale = np.repeat([1.0, 1.0 / self.case.length], 3)
        A = inverse(self.J * scale[:, None]) * scale
        condition = self.condition((self.J * self.columns).T, (A / self.columns[:, None]).T)
        self.verdict = larger(self.verdict, limited(condition, JACOBIAN_CONDITION**2))
        self.squared_condition = condition
        return A

    def condition(self, forward: Array, backward: Array) -> Scalar:
        """Bound on the squared condition number of the scaled Jacobian."""
        size = norm_squared(forward[:, :3]) + norm_squared(forward[:, 3:]) / self.area
        return size * (norm_squared(backward[:3]) + norm_squared(backward[3:]) * self.area)

    def noteworthy(self, own: tuple[Array, Array], outer: tuple[Array, Array]) -> Array:
        """As of an open chain, on whatever orthonormal motions that stay closed.

        With N and x in natural sizes they are ``N (N^T N)^(-1/2)``, of which the independent
        coordinates, which the actuators are, move as much as ``(N^T N)^(-1/2)``; what moves the
        body by a twist, ``N H^-1 J^T K^B``, tells how small the Jacobian can be.
        """
        sizes = np.array([self.length if d else 1.0 for d in self.case.constants.is_length], object)
        N = self.N / sizes[:, None] * self.columns
        (H, softness), (K, _) = own, outer
        forward = (self.J * self.columns).T
        back = N @ ((softness @ (self.J.T @ K)) / self.columns[:, None])
        if self.n > 6:  # (N^T N)^(-1/2) is at most 1
            if not self.case.independent:
                return np.array([1.0, 1.0], object)
            spread = norm_squared(N) * square_root(float(self.n)) if self.case.is_driven else 1.0
            serial = self.condition(forward, back.T)
            return noteworthy(larger(serial, spread), own, outer, margin=100.0)
        gram = congruence(N, np.eye(len(N)))
        L, inverses, _ = positive_factor(gram)
        forward = below(L, forward)
        for row, inverse_pivot in zip(forward, inverses, strict=True):
            row *= square_root(inverse_pivot)
        inverse_gram = congruence(below(L, np.eye(self.n)), np.diag(inverses))
        spread = square_root(norm_squared(gram) * norm_squared(inverse_gram))
        serial = self.condition(forward, back.T)
        near, lost = noteworthy(larger(serial, spread), outer, margin=100.0)
        both = self.columns * self.columns[:, None]
        size = norm_squared(H * both) * norm_squared(softness / both) * (spread * spread)
        lost = larger(lost, size * (self.n * numerics.EPSILON / numerics.REPORTED_ERROR) ** 2)
        return np.array([near, lost], object)

    def pose(self) -> Array:
        """``T_F_M``."""
        T = zeros(4, 4)
        T[:3, :3], T[:3, 3], T[3, 3] = self.kinematics.R, self.kinematics.p, 1.0
        return T


def length_of(tree: TreeKinematics) -> Scalar:
    """Root mean square distance of the axes of joints on the way to the body from its origin."""
    way = [j for j in tree.constants.support(tree.constants.carrier) if tree.links.turning[j]]
    moments = tree.in_body(tree.J[:, way])[3:]
    return square_root(norm_squared(moments) / len(way)) if way else 1.0


def closed_arrays(tape: Tape, case: ClosedCase, wanted: Collection[str]) -> dict[str, Array]:
    """What of the outputs exists, among it all that is wanted, and "verdict" on the posture."""
    return arrays_of(ClosedChainNumbers(tape, case), wanted)
