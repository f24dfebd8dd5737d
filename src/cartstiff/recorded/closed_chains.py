r"""Closed chains on recorded numbers: closing them, deflecting their links,
and their stiffness.

The stiffness is that of an open chain on the motions that keep the closures. With
closures ``C dq = 0``, dependent coordinates D and independent ones I, all motions are
``dq = N dx``, N = 1 on I and ``-C_D^-1 C_I`` on D. In the coordinates x of these motions

    J = J_q N,    g = N^T g_q,    H = N^T (H_q + lam c'') N,    C_D^T lam = -(g_q)_D,
    S_W = N^T (S_q,W - mu c'') N,    C_D^T mu = (J_q^T W)_D

and the rest is as for an open chain (`cartstiff.recorded.chains`).
`cartstiff.core.stiffness.reduction` is the same with a basis from the singular value
decomposition. I are the coordinates that are held while the chain is closed, or a choice
of as many as there are motions; without such a choice, N is orthonormal, from reflections
of C^T.

Springs c whose rest positions are chosen exert the torques t nearest to ``(J_q^T W)_c``
with ``N_c^T t = J^T W - N_s^T g_s``, g_s being the torques of all else.

The steps that close a chain are those of `Chain.closed`. Along the axes of F, with ``w =
log(R_b R_a^T)``, x = w.w and d from a to b, the residual of a weld is ``xi = (w, d + w x
d / 2 + c w x (w x d))`` and its rates are those of the twist about b times

    J_r^-1(xi) = 1 + ad / 2 + A ad^2 + B ad^4,

c, A and B being power series in x with the coefficients of ``(t / 2) cot(t / 2)``, t^2 =
x. The rates for a joined point are those of the twist about a. The length of each step is
limited.

The steps that deflect compliant links under a load are those of
`stiffness.settled_links`. In the coordinates x of the motions above (of an open chain:
its coordinates), those f without springs of their own take the step

    dx_f = -(H_L + J^T D J)_ff^-1 (g - J^T W)_f,  D = K^load - K^B,  dq = N_f dx_f + c,

c being the correction of the dependent coordinates for the remaining closure residual,
and K^load that of a load which keeps its components in M (a follower, K^A) or in F (a
dead one).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.errors import ConvergenceError
from cartstiff.core.geometry.se3 import skew_of
from cartstiff.core.mechanisms.chain import Chain
from cartstiff.core.mechanisms.closures import LONGEST_STEP
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.stiffness.applied_load import LoadKind
from cartstiff.core.stiffness.settled_links import (
    LAST,
    LONGEST,
    ROUNDED,
    settled_coordinates,
)
from cartstiff.recorded.algebra import (
    JACOBIAN_CONDITION,
    PLAIN,
    above,
    acting,
    below,
    congruence,
    cross,
    inverse,
    largest,
    limited,
    norm_squared,
    noteworthy,
    positive_factor,
    positive_inverse,
    reflections,
    require_pivots,
    rotation_vector,
    solution,
    solution_with_condition,
    upper_inverse,
    vanishes,
    zeros,
)
from cartstiff.recorded.chains import (
    ChainCase,
    ChainNumbers,
    LinkSpring,
    arrays_of,
    curvature_of,
)
from cartstiff.recorded.tape import (
    Arrays,
    Scalar,
    Tape,
    absolute,
    larger,
    pick,
    square_root,
)
from cartstiff.recorded.twists import (
    Kinematics,
    Tie,
    TreeConstants,
    numbers,
    tree_constants,
)

#: Largest condition number of the closures: their motions lose four digits.
_MAX_CLOSURE_CONDITION = 1.0 / numerics.LOST_ERROR


class ClosedChainNumbers(ChainNumbers):
    """A closed chain under a case, recorded.

    The coordinates are those of the motions N.
    """

    def _motions(self) -> Array:
        case = self.case
        constants, tree = case.constants, self.kinematics
        # Rates of the closures, in rows that shut them and rows that then shut by
        # themselves.
        kept, left = list[Array](), list[Array]()
        self._ties: list[tuple[Array, list[int]]] = []
        for tie, rows in zip(constants.ties, case.rows, strict=True):
            twists = tree.tied(tie)
            self._ties.append((twists, list(rows)))
            kept.append(twists[list(rows)])
            others = set(range(0 if tie.is_weld else 3, 6)) - set(rows)
            left.append(twists[sorted(others)])
        self.C, n = np.concatenate(kept), len(self.q)
        # In sizes of the joints, so that angles and lengths can be compared.
        sizes = constants.sizes(case.length)
        scale = np.concatenate(
            [[1.0 if i < 3 else 1.0 / case.length for i in rows] for rows in case.rows]
        )
        scaled = self.C * scale[:, None] * sizes
        # Motors lead: the others follow by one solution.
        if case.independent:
            D, free = case.dependent, list(case.independent)
            # A right-hand side in a generic direction estimates the norm of the inverse.
            probe = np.cos(np.arange(1.0, 1.0 + len(D)))
            solved = solution(scaled[:, D], np.column_stack([scaled[:, free], probe]))
            N = zeros(n, len(free))
            N[free] = np.eye(len(free))
            N[D] = solved[:, :-1] * -(sizes[D][:, None] / sizes[free])
            size = norm_squared(solved) / len(D) * norm_squared(scaled[:, D])
            limit = _MAX_CLOSURE_CONDITION**2
        else:
            # No motors: free motions are what the closures leave, by reflections.
            moving = case.moving
            Q = reflections(scaled[:, moving].T)
            inverse_R = upper_inverse(Q.R)
            self._solved = Q, inverse_R, scale, sizes
            last = zeros(len(moving), self.n)
            last[len(Q.R) :] = np.eye(self.n)
            N = zeros(n, self.n)
            N[moving] = Q.apply(last) * sizes[moving][:, None]
            size, limit = (
                norm_squared(Q.R) * norm_squared(inverse_R),
                JACOBIAN_CONDITION**2,
            )
        verdict = limited(size, limit)
        # Rows that were left out must stay shut too, and joints that are still must stand
        # at zero.
        missed = (np.concatenate(left) * sizes) @ (N / sizes[:, None])
        if not vanishes(missed):
            least = largest(N / sizes[:, None]) * (
                numerics.NEGLIGIBLE_DIFFERENCE * case.length
            )
            verdict = larger(verdict, limited(largest(missed), least))
        for j in (j for indices, _ in case.still for j in indices):
            is_still = limited(absolute(self.q[j]), numerics.TINY)
            verdict = larger(verdict, is_still)
        self.require(verdict)
        return N

    def _multipliers(self, right: Array) -> Array:
        """Closure forces that balance generalised forces (n,) on the dependent
        coordinates.
        """
        if vanishes(right):
            return zeros(len(self.C))
        if self.case.independent:
            D = self.case.dependent
            return solution(self.C[:, D].T, right[D, None])[:, 0]
        Q, inverse_R, scale, sizes = self._solved
        turned = Q.apply_transposed((right * sizes)[self.case.moving])
        return (inverse_R @ turned[: len(inverse_R)]) * scale

    def _turning(self, right: Array) -> Array:
        """Curvature ``lam c''`` (n, n) of the closures."""
        n, start, multipliers = len(self.q), 0, self._multipliers(right)
        S = zeros(n, n)
        for tie, (twists, rows) in zip(self.case.constants.ties, self._ties, strict=True):
            force = zeros(6)
            force[rows] = multipliers[start : start + len(rows)]
            start += len(rows)
            if vanishes(force):
                continue
            way = [j for j, _ in self.case.constants.way(tie)]
            S[np.ix_(way, way)] = S[np.ix_(way, way)] + curvature_of(
                twists[:, way], force
            )
        return S

    def _torques(self, chosen: list[int], gradient: Array) -> Array:
        """As for an open chain; without a load, and beside springs with rest positions,
        those that the closures leave, which carry as far as they can what other
        coordinates do not.
        """
        if self.case.is_balancing or not chosen:
            return super()._torques(chosen, gradient)
        scaled = self.C * self._solved[2][:, None]
        others = [a for a in self.case.moving if a not in chosen]
        forces = self._inverse_gram(scaled[:, others].T) @ (
            scaled[:, others] @ gradient[others]
        )
        return np.asarray(scaled[:, chosen].T @ forces)

    def _inverse_gram(self, columns: Array) -> Array:
        """``(columns^T columns)^-1``; adds the verdict on it."""
        gram = congruence(columns, np.eye(len(columns)))
        inverse_gram = positive_inverse(gram)
        condition = norm_squared(gram) * norm_squared(inverse_gram)
        self.require(limited(condition, JACOBIAN_CONDITION**2))
        return inverse_gram

    def resists(self, K: Array) -> Scalar:
        """As for an open chain; beside springs with rest positions a motion may cost
        nothing, such as the spin of a body that two fingers hold.
        """
        if self.case.is_balancing or not self.case.chosen:
            return PLAIN
        scale = np.repeat([1.0 / self.length, 1.0], 3)
        scaled = K * scale * scale[:, None]
        largest_one = np.array([largest(scaled.diagonal())] * 6, object)
        pivots = np.array([absolute(x) for x in positive_factor(scaled)[2]], object)
        return require_pivots(PLAIN, pivots, largest_one, numerics.ROUNDOFF)

    def _shared(self, chosen: list[int], wanted: Array) -> Array:
        """Of more springs than motions, or others, the torques nearest to those
        of the wrench.

        They fulfil ``N_c^T t = wanted``.
        """
        if self.case.settled or chosen == self.case.names:
            return super()._shared(chosen, wanted)
        if vanishes(wanted):
            return zeros(len(chosen))
        sizes = self.case.constants.sizes(self.case.length)[chosen]
        own = zeros(len(chosen)) if self.W is None else self.J_q[:, chosen].T @ self.W
        N = self.N[chosen] / sizes[:, None]
        wanted = wanted - self.N[chosen].T @ own
        return own + N @ (self._inverse_gram(N) @ wanted) / sizes

    def inverse(self) -> Array:
        """J^-1 of six motions; adds the verdict on it."""
        scale = np.repeat([1.0, 1.0 / self.case.length], 3)
        A = inverse(self.J * scale[:, None]) * scale
        self.require_condition(A, JACOBIAN_CONDITION**2)
        return A

    def noteworthy(
        self, tangent: Array, own: tuple[Array, Array], outer: tuple[Array, Array]
    ) -> Array:
        """As for an open chain, on orthonormal motions.

        With N and x in natural sizes these are ``N (N^T N)^(-1/2)``, along which the
        independent coordinates, the actuators, move by ``(N^T N)^(-1/2)``; the motion per
        twist of the body, ``N H^-1 J^T K^B``, bounds the inverse Jacobian.
        """
        sizes = self.case.constants.sizes(self.length)
        N = self.N / sizes[:, None] * self.columns
        (H, softness), (K, _) = own, outer
        forward = (self.J * self.columns).T
        back = N @ ((softness @ (self.J.T @ K)) / self.columns[:, None])
        if self.n > 6:  # (N^T N)^(-1/2) is at most 1
            if not self.case.independent:
                return np.array([1.0, 1.0, 1.0], object)
            if self.case.is_driven:
                spread = norm_squared(N) * square_root(float(self.n))
            else:
                spread = 1.0
            serial = self.condition(forward, back.T)
            condition = larger(serial, spread)
            return noteworthy(condition, tangent, own, outer, margin=100.0)
        gram = congruence(N, np.eye(len(N)))
        L, inverses, _ = positive_factor(gram)
        forward = below(L, forward)
        for row, inverse_pivot in zip(forward, inverses, strict=True):
            row *= square_root(inverse_pivot)
        inverse_gram = congruence(below(L, np.eye(self.n)), np.diag(inverses))
        spread = square_root(norm_squared(gram) * norm_squared(inverse_gram))
        serial = self.condition(forward, back.T)
        near, lost, unstable = noteworthy(
            larger(serial, spread), tangent, outer, margin=100.0
        )
        both = self.columns * self.columns[:, None]
        size = norm_squared(H * both) * norm_squared(softness / both) * (spread * spread)
        lost = larger(
            lost, size * (self.n * numerics.EPSILON / numerics.REPORTED_ERROR) ** 2
        )
        return np.array([near, lost, unstable], object)


def characteristic_length(tree: Kinematics) -> Scalar:
    """Root mean square distance of the axes of joints on the way to the body
    from its origin.
    """
    way = [
        j for j in tree.constants.support(tree.constants.carrier) if tree.links.turning[j]
    ]
    return square_root(norm_squared(tree.J_M[3:, way]) / len(way)) if way else 1.0


def closed_arrays(
    tape: Tape, case: ChainCase, wanted: Collection[str]
) -> dict[str, Array]:
    """Outputs that exist, among them all that are wanted, and the "verdict" on the
    posture; the `gaps` as well, if these are wanted.
    """
    chain = ClosedChainNumbers(tape, case)
    arrays = arrays_of(chain, wanted)
    if "gaps" in wanted:
        arrays["gaps"] = gaps(chain.kinematics)
    return arrays


#: Bernoulli numbers over factorials: coefficients of ``(t / 2) cot(t / 2)`` in t^2, but
#: for the 1.
_COTANGENT = (
    -1 / 12,
    -1 / 720,
    -1 / 30240,
    -1 / 1209600,
    -1 / 47900160,
    -691 / 1307674368000,
    -1 / 74724249600,
    -3617 / 10670622842880000,
    -43867 / 5109094217170944000,
    -174611 / 802857662698291200000,
)
#: Number of steps after which round-off may decide the assembly mode, and after which
#: `cartstiff.analyse` gives up. `ChainCase.ways` has the alternatives: more held
#: coordinates than motions do not close by chance; as many may, in another assembly mode,
#: which is left to `cartstiff.analyse`.
STEPS, LAST_STEP = 40, 100


def cotangent_series(x: Any) -> Any:
    """``(1 - (t / 2) cot(t / 2)) / t^2`` at x = t^2."""
    return -_series(x, list(_COTANGENT))


def _series(x: Any, coefficients: list[float]) -> Any:
    total: Any = 0.0
    for c in reversed(coefficients):
        total = total * x + c
    return total


def residual_of(tree: Kinematics, tie: Tie) -> tuple[Array, Array, Scalar]:
    """Residual (6,), its rates (6, joints), and the verdict."""
    (R_a, p_a), (R_b, p_b) = (tree.end(tie, side) for side in (0, 1))
    if not tie.is_weld:
        return np.concatenate([zeros(3), p_b - p_a]), tree.tied(tie, p_a), PLAIN
    # Rotation vector and translation of one end in the other: the logarithm.
    w, verdict = rotation_vector(R_b @ R_a.T)
    x, d = w @ w, p_b - p_a
    c = cotangent_series(x)
    across = cross(w, d)
    xi = np.concatenate([w, d + across * 0.5 + cross(w, across) * c])
    # Its derivative is the inverse of the left Jacobian, by series in the angle's square.
    A = _series(x, [(k - 1.0) * c_k for k, c_k in enumerate(_COTANGENT)])
    B = _series(x, [(k + 1.0) * c_k for k, c_k in enumerate(_COTANGENT[1:])])
    ad = zeros(6, 6)
    ad[:3, :3] = ad[3:, 3:] = skew_of(xi[:3])
    ad[3:, :3] = skew_of(xi[3:])
    twice = ad @ ad
    turned = np.eye(6) + ad * 0.5 + twice * A + (twice @ twice) * B
    # Only the joints between the two ends move them apart.
    J = tree.tied(tie, p_b)
    rates = zeros(*J.shape)
    for j, _ in tree.constants.way(tie):
        rates[:, j] = turned @ J[:, j]
    return xi, rates, verdict


def closing_arrays(tape: Tape, case: ChainCase) -> dict[str, Array]:
    """The "next" coordinates, and what is "left": residual, step, length, verdict."""
    constants = case.constants
    n = len(constants.is_length)
    q = tape.vector("q", n)
    tree = Kinematics(constants, q)
    length = characteristic_length(tree)
    columns = constants.sizes(length)
    verdict: Scalar = PLAIN
    # Gaps of all closures, and the rows that are to be shut with their rates.
    residuals, every, rates = list[Array](), list[Array](), list[Array]()
    for tie, rows in zip(constants.ties, case.shut, strict=True):
        xi, J, doubt = residual_of(tree, tie)
        verdict = larger(verdict, doubt)
        every.append(xi)
        residuals.append(xi[list(rows)])
        rates.append(J[list(rows)])
    residual, C = np.concatenate(residuals), np.concatenate(rates)
    # One Newton step of the joints that are not held: the shortest that shuts the rows,
    # in sizes of the joints.
    step = zeros(n)
    D = [j for j in case.moving if j not in case.held]
    sizes = columns[D]
    scaled = C[:, D] * sizes
    if len(D) == len(C):
        step[D], condition = solution_with_condition(scaled, -residual)
    else:
        Q = reflections(scaled.T)
        inverse_R = upper_inverse(Q.R)
        y = zeros(len(D))
        y[: len(Q.R)] = inverse_R.T @ -residual
        condition = norm_squared(Q.R) * norm_squared(inverse_R)
        step[D] = Q.apply(y)
    # A step that is too long may leave the branch: it is shortened.
    verdict = larger(verdict, limited(condition, JACOBIAN_CONDITION**2))
    size = largest(step)
    step = step * columns * pick(size, LONGEST_STEP, 1.0, LONGEST_STEP / size)
    left = np.array([largest(np.concatenate(every)), size, length, verdict], object)
    return {"next": q + step, "left": left}


#: Coordinates (N, n), where they close the chain, and where no steps can.
Closings = tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]
#: Runs a program over rows: inputs by name to outputs by name.
Step = Callable[[Arrays], dict[str, Array]]


def close(ways: Sequence[Callable[[], Step]], q: Array) -> Closings:
    """Coordinates that close the chain from q (N, n), where they do,
    and where no steps can.

    `ways` make the kernels for `closing_arrays` of `ChainCase.ways`. Where
    `cartstiff.analyse` would take more steps, or find another solution, the given
    coordinates stay.
    """
    closed, is_closed, which = q.copy(), np.zeros(len(q), bool), np.arange(len(q))
    for way in ways:
        if not which.size:
            break
        at, done, is_vain = (
            q[which],
            np.zeros(len(which), bool),
            np.zeros(len(which), bool),
        )
        _close(way(), at, done, is_vain)
        closed[which[done]], is_closed[which[done]] = at[done], True
        which = which[is_vain]
    return closed, is_closed, np.isin(np.arange(len(q)), which) & bool(ways)


def is_shut(size: Any, step: Any, length: Any, before: Any) -> Any:
    """Whether closures are met: to round-off, or within tolerance once steps
    bring no more.

    From the numbers in "left" and the residual of the step `before`.
    """
    unit = np.maximum(1.0, length)
    return (size <= numerics.ATTAINABLE_PRECISION * unit) | (
        (size <= numerics.ROUNDOFF * unit)
        & ((size > 0.1 * before) | (step <= numerics.SMALLEST_STEP))
    )


def _close(
    step_on: Step, q: Array, is_closed: NDArray[np.bool_], is_vain: NDArray[np.bool_]
) -> None:
    """Take steps from q in place.

    Set where they close the chain, and where they cannot.
    """
    which, before = np.arange(len(q)), np.full(len(q), np.inf)
    best, futile = before, np.zeros(len(q), int)
    for taken in range(LAST_STEP):
        moved = step_on({"q": q if len(which) == len(q) else q[which]})
        size, step, length, doubt = moved["left"].T
        done = is_shut(size, step, length, before)
        is_closed[which[done]] = taken < STEPS
        futile = np.where(size < 0.9 * best, 0, futile + 1)
        goes_on = ~done & (doubt == PLAIN) & np.isfinite(step)
        vain = goes_on & (
            (step <= numerics.SMALLEST_STEP)
            | (futile >= numerics.MAX_FUTILE_STEPS) & (step < LONGEST_STEP)
        )
        is_vain[which[vain]] = True
        goes_on &= ~vain
        which, before, futile = which[goes_on], size[goes_on], futile[goes_on]
        best = np.minimum(best[goes_on], before)
        if not which.size:
            return
        q[which] = moved["next"][goes_on]
    is_vain[which] = True


#: Number of steps within which these steps and those of `settled_links` find the same
#: rest: of 2293 postures of robots with flexible links, under loads up to the largest
#: that they carry, 23 did not, all with nine steps or more.
MAX_SETTLING_STEPS = 8
#: Evaluates the terms outside the program at postures (N, n): inputs, and verdicts.
Evaluate = Callable[[Array], tuple[dict[str, Array], Array]]


def settles(elastic: ElasticMechanism, is_loaded: bool) -> tuple[int, ...]:
    """`settled_coordinates` where there is a wrench."""
    return tuple(settled_coordinates(elastic).tolist()) if is_loaded else ()


def _closing_step(
    chain: ClosedChainNumbers, case: ChainCase, sizes: Array
) -> tuple[Array, Scalar]:
    """Step (n,) of the dependent coordinates that closes the chain,
    and the verdict on it.
    """
    tree, residual = chain.kinematics, list[Array]()
    verdict: Scalar = PLAIN
    for tie, rows in zip(case.constants.ties, case.rows, strict=True):
        xi, _, doubt = residual_of(tree, tie)
        verdict = larger(verdict, doubt)
        # About the origin of F, like the twists of the closures.
        gap = np.concatenate([xi[:3], xi[3:] + cross(tree.end(tie, 1)[1], xi[:3])])
        residual.append(gap[list(rows)])
    D, step = case.dependent, zeros(len(chain.q))
    right = -np.concatenate(residual)[:, None]
    step[D] = solution(chain.C[:, D] * sizes[D], right)[:, 0] * sizes[D]
    return step, verdict


def settling_arrays(tape: Tape, case: ChainCase) -> dict[str, Array]:
    """Coordinates after a step, "settled", and its largest part and verdict, "moved"."""
    chain: ChainNumbers
    verdict: Scalar = PLAIN
    if case.is_closed:
        chain = ClosedChainNumbers(tape, case)
    else:
        chain = ChainNumbers(tape, case, len(case.constants.parents) + 1)
    closing = zeros(len(chain.q))
    kind: Literal["dead", "follower"] = "dead" if case.axes == "world" else "follower"
    W = chain.W
    load = acting(tape, replace(case, load=LoadKind(kind, case.load.at)))
    assert W is not None  # links are deflected by a wrench
    sizes = case.constants.sizes(chain.length)
    left, N, names = chain.gradient - chain.J.T @ W, chain.N, case.names
    if isinstance(chain, ClosedChainNumbers):
        closing, verdict = _closing_step(chain, case, sizes)
        left = left + N.T @ (chain.coordinate_lagrangian(W) @ closing)
    free = [i for i, name in enumerate(names) if name in case.settled]
    H, J = chain.lagrangian(W)[np.ix_(free, free)], chain.J[:, free]
    L, inverses, pivots = positive_factor(H)
    verdict = require_pivots(verdict, pivots, H.diagonal(), numerics.LOST_ERROR)
    reached = below(L, np.column_stack([-left[free], J.T]))
    y, reach = reached[:, 0], reached[:, 1:]
    # With C = J H^-1 J^T it is (H + J^T D J)^-1 = (1 - H^-1 J^T D (1 + C D)^-1 J) H^-1.
    D = load.change(W)
    C = congruence(reach, np.diag(inverses))
    changed = D @ solution(np.eye(6) + C @ D, (reach.T @ (y * inverses))[:, None])[:, 0]
    step = N[:, free] @ above(L, (y - reach @ changed) * inverses) + closing
    verdict = larger(verdict, chain.verdict)
    moved = largest(step / sizes)
    settled = chain.q + step * pick(moved, LONGEST, 1.0, LONGEST / moved)
    return {"settled": settled, "moved": np.array([moved, verdict], object)}


def settle(
    step: Step,
    evaluate: Evaluate,
    inputs: Arrays,
    q: Array,
    which: NDArray[np.intp],
) -> NDArray[np.intp]:
    """Take steps from the postures q[which], in place; return those that come to rest.

    `inputs` are the program's, "wrench" with a row for each of q. Postures that
    do not come to rest within a few steps are left to `cartstiff.analyse`, whose steps
    differ and may find another rest.
    """
    rest, moved = list[NDArray[np.intp]](), np.zeros(0)
    for _ in range(MAX_SETTLING_STEPS):
        if not which.size:  # none closed, or all at rest
            break
        at = np.ascontiguousarray(q[which])
        more, doubts = evaluate(at)
        own = {**inputs, "q": at, **more}
        own["wrench"] = np.ascontiguousarray(inputs["wrench"][which])
        outputs = step(own)
        moved, verdict = outputs["moved"].T
        stands = (verdict == PLAIN) & np.isfinite(moved) & (doubts == PLAIN)
        q[which[stands]] = outputs["settled"][stands]
        is_last = moved <= LAST
        rest.append(which[stands & is_last])
        which, moved = which[stands & ~is_last], moved[stands & ~is_last]
    rest.append(which[moved <= ROUNDED])
    return np.concatenate(rest)


#: Number of postures at which the rank of the closures is sampled, and their largest
#: distance from the reference posture (rad, or shares of the characteristic length).
_SAMPLES, _SAMPLE_DISTANCE = 4, 0.1


def _samples(chain: Chain, q: Array) -> list[Array]:
    """Coordinates of a few closed postures near q."""
    samples, n = list[Array](), q.size
    for i in range(3 * _SAMPLES):
        # Uneven shares of the distance; numpy.random alone would take 20 ms to import.
        shares = np.sin(np.arange(i * n + 1.0, (i + 1) * n + 1.0) ** 2)
        away = _SAMPLE_DISTANCE * chain.at(q).coordinate_lengths * shares
        away[list(chain.virtual)] = 0.0
        try:
            samples.append(chain.closed(q if i == 0 else q + away).q)
        except ConvergenceError:
            continue
        if len(samples) == _SAMPLES:
            break
    return samples


def _rows(
    constants: TreeConstants, trees: Sequence[Kinematics], held: Sequence[int]
) -> tuple[tuple[tuple[int, ...], ...], list[Array], int] | None:
    """Rows of each closure that make all closures independent; None if the rank differs.

    Also the matrix of these rows of each tree, without columns of held coordinates, and
    the number of rows that are not zero.
    """
    every, names = list[Array](), list[tuple[int, int]]()
    for tree in trees:
        rows = list[Array]()
        names = []
        for k, tie in enumerate(constants.ties):
            own = range(0 if tie.is_weld else 3, 6)
            twists = np.delete(tree.tied(tie), held, axis=1)
            rows += list(twists[list(own)].astype(float))
            names += [(k, i) for i in own]
        every.append(np.array(rows))
    ranks = {numerics.rank(numerics.singular_values(C)) for C in every}
    if len(ranks) != 1:
        return None
    together = np.concatenate(every, axis=1)
    # The first independent rows are kept; rows that are zero at all samples come last.
    kept = sorted(numerics.first_independent(_reduced(together, ranks.pop()).T).tolist())
    sizes = np.abs(together).max(axis=1, initial=0.0)
    acting = int(np.count_nonzero(sizes > numerics.RANK * sizes.max(initial=0.0)))
    every = [C[kept] for C in every]
    if not all(numerics.is_regular(numerics.singular_values(C)) for C in every):
        return None
    return (
        tuple(
            tuple(i for j in kept for t, i in [names[j]] if t == k)
            for k in range(len(constants.ties))
        ),
        every,
        acting,
    )


def _independent(
    chain: Chain, moving: Array, closures: Sequence[Array], freedoms: int
) -> tuple[int, ...]:
    """Coordinates that determine all motions: the held ones, or as many others;
    else none.

    With more actuators than motions there are none, as no actuator may be left out. The
    closures' columns are the `moving` coordinates.
    """
    held = [j for j in chain.held if j not in chain.rigid]
    driven = [j for j in chain.actuated or () if j not in chain.rigid]
    if len(held) in (0, freedoms) or len(driven) > freedoms:
        return tuple(held) if len(held) == freedoms else ()
    # Choose dependent coordinates among those that are not held, if possible.
    weights = np.where(np.isin(moving, held), 1e-3, 1.0)
    dependent = numerics.first_independent(closures[0] * weights)
    free = np.delete(np.arange(len(moving)), dependent)
    each = (C[:, dependent] for C in closures)
    is_regular = all(numerics.is_regular(numerics.singular_values(C)) for C in each)
    return tuple(moving[free].tolist()) if is_regular else ()


def _reduced(rows: Array, rank: int) -> Array:
    """Columns, as many as the rank of one posture, that span the columns of `rows`."""
    U, values, _ = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(U[:, :rank] * values[:rank])


def closed_case(
    elastic: ElasticMechanism, chain: Chain, is_loaded: bool, is_open: Array
) -> tuple[ChainCase, tuple[Potential, ...]] | str:
    """Case of a closed chain and the potentials outside it,
    or the reason why there is none.

    `is_open` says which coordinates (n,) have a spring whose rest position is chosen.
    """
    if chain.tree.mimic is not None:
        return "joints that follow others in a closed chain"
    constants = tree_constants(chain)
    way = constants.support(constants.carrier)
    if not any(np.any(np.reshape(constants.screws, (-1, 6))[j, :3]) for j in way):
        return "no joint on the way to the frame turns"
    if not chain.rigid <= set(chain.held):
        return "a rigid joint that is no motor moves while a closed chain is assembled"
    samples = _samples(chain, elastic.q)
    rigid = tuple(sorted(chain.rigid))
    held = tuple(j for j in chain.held if j not in rigid)
    trees = [Kinematics(constants, at.astype(object)) for at in samples]
    free, shut = (
        _rows(constants, trees, some) if trees else None
        for some in (rigid, (*held, *rigid))
    )
    if free is None or shut is None:
        return "the closures have no rank that most postures share"
    rows, closures, acting = free
    n, rank = len(constants.is_length), sum(map(len, rows))
    moving = np.delete(np.arange(n), rigid)
    freedoms = len(moving) - rank
    if not freedoms:
        return "no joint gives"
    is_freed = not held or len(held) > freedoms
    if is_freed and acting > rank:
        return (
            "redundant closures without actuated coordinates are closed posture by "
            "posture"
        )
    actuated = chain.actuated
    if actuated is not None and not set(actuated) <= {*held, *rigid}:
        return "the actuated coordinates are not those that are held"

    settled = settles(elastic, is_loaded)
    still, others = list[LinkSpring](), list[Potential]()
    for potential in elastic.potentials:
        if settled:
            others.append(potential)
        elif (K := potential.own_stiffness) is not None and (at := potential.members):
            size = 6 if potential.is_scaled else len(at)  # segments of beams
            cuts = [slice(i, i + size) for i in range(0, len(at), size)]
            still += [(at[cut], numbers(K[cut, cut])) for cut in cuts]
        else:
            others.append(potential)
    springs = elastic.springs
    own = np.zeros(n, bool) if springs is None else springs.has_coordinate(n)
    springy = {
        *np.flatnonzero(own).tolist(),
        *(j for at, _ in still for j in at),
        *settled,
    }
    if springy < set(held) and not others and elastic.gravity is None:
        return "coordinates that are held without a spring are judged posture by posture"
    acts = bool(others) or elastic.gravity is not None or bool((own & ~is_open).any())
    # `_shared` would weigh torques against forces by a length that `cartstiff.analyse`
    # has not.
    kinds = {constants.is_length[a] for a in np.flatnonzero(is_open)}
    independent = _independent(chain, moving, closures, freedoms)
    chosen = set(np.flatnonzero(is_open).tolist())
    # Without chosen rest positions compliant links alone carry a load.
    is_balancing = bool(chosen or settled or not (acts or is_loaded))
    if settled:
        if not chosen <= set(independent):
            return "what springs carry beside links that give is found posture by posture"
    elif (
        chosen
        and chosen != set(independent)
        and (is_loaded or acts)
        and (independent or len(chosen) < freedoms or len(kinds) > 1)
    ):
        # Without a load the closures leave each spring its torque, where only angles are
        # weighed.
        if is_loaded or independent or rigid or any(constants.is_length):
            return "what springs carry beside closures is found posture by posture"
        is_balancing = False
    if freedoms > 6 and not is_balancing:
        return "whether self-motions of a closed chain balance is seen posture by posture"
    return ChainCase(
        constants,
        is_loaded,
        springs=tuple(np.flatnonzero(own).tolist()),
        chosen=tuple(sorted(chosen)),
        is_balancing=is_balancing,
        held=held,
        independent=independent,
        rows=rows,
        shut=shut[0],
        length=float(chain.at(samples[0]).length),
        still=tuple(still),
        settled=settled,
        rigid=rigid,
        has_chart=actuated is not None and len(actuated) == 6 == freedoms,
        is_driven=actuated is not None and set(actuated) == set(independent),
    ), tuple(others)


def gaps(tree: Kinematics) -> Array:
    """Small twists from frame a to frame b of each closure, in C, that have to vanish.

    To first order they are the residuals of `closing_arrays`; six numbers of a weld,
    three of a point.
    """
    parts = list[Array]()
    for tie in tree.constants.ties:
        (R_a, p_a), (R_b, p_b) = tree.end(tie, 0), tree.end(tie, 1)
        if tie.is_weld:
            turned = R_b @ R_a.T
            skew = (turned - turned.T) * 0.5
            parts.append(np.array([skew[2, 1], skew[0, 2], skew[1, 0]], object))
        parts.append(p_b - p_a)
    return np.concatenate(parts)
