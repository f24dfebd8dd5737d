r"""Links that give, at rest under a load: the steps of `stiffness.settled_links`, recorded.

In the coordinates x of the motions that stay closed (`closed_chain`; of an open chain, its own),
those f without springs of their own take the step

    dx_f = -(H_L + J^T D J)_ff^-1 (g - J^T W)_f,    D = K^load - K^B,    dq = N_f dx_f + c,

c on the dependent coordinates shutting what the step before has left open of the closures, and
K^load that of a load which keeps its components in M (a follower, K^A) or in F (a dead one).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    above,
    below,
    congruence,
    cross,
    in_pairs,
    largest,
    positive_factor,
    solution,
    zeros,
)
from cartstiff.many.arguments import aligned_empty
from cartstiff.many.arithmetic import ENGINE, PLAIN
from cartstiff.many.chains.chain_numbers import ChainCase, ChainNumbers
from cartstiff.many.chains.closed_chain import ClosedCase, ClosedChainNumbers
from cartstiff.many.chains.closing import weld_residual
from cartstiff.many.tape import Scalar, Tape, larger, pick
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.stiffness.applied_load import LoadKind
from cartstiff.stiffness.settled_links import (
    LAST,
    LONGEST,
    ROUNDED,
    settled_coordinates,
)

#: Steps within which both ways of stepping end alike: of 2293 postures of robots with flexible
#: links, under loads up to all that they carry, those 23 that did not took nine and more.
_FEW = 8
#: Evaluates what is beside the program at postures (N, n): inputs, and verdicts.
Evaluate = Callable[[Array], tuple[dict[str, Array], Array]]


def settles(elastic: ElasticMechanism, wrench: str) -> tuple[int, ...]:
    """`settled_coordinates` where there is a wrench; `wrench` as in `ChainCase`."""
    return () if wrench == "none" else tuple(settled_coordinates(elastic).tolist())


def _shutting(chain: ClosedChainNumbers, case: ClosedCase, sizes: Array) -> tuple[Array, Scalar]:
    """What shuts the closures, on the dependent coordinates (n,), and the verdict on it."""
    tree, missed = chain.kinematics, list[Array]()
    verdict: Scalar = PLAIN
    for tie, rows in zip(case.constants.ties, case.rows, strict=True):
        p_b = tree.placed(tie.joint_b, tie.T_b)[1]
        if tie.is_weld:
            xi, _, doubt = weld_residual(tree, tie)
            verdict = larger(verdict, doubt)
            # About the origin of F, as the twists of the closures are.
            gap = np.concatenate([xi[:3], xi[3:] + cross(p_b, xi[:3])])
        else:
            gap = np.concatenate([zeros(3), p_b - tree.placed(tie.joint_a, tie.T_a)[1]])
        missed.append(gap[list(rows)])
    D, shut = case.dependent, zeros(len(chain.q))
    shut[D] = solution(chain.C[:, D] * sizes[D], -np.concatenate(missed)[:, None])[:, 0] * sizes[D]
    return shut, verdict


def settling_arrays(tape: Tape, case: ChainCase) -> dict[str, Array]:
    """The coordinates after a step, "settled", and how it "moved": longest part, verdict."""
    chain: Any
    verdict: Scalar = PLAIN
    if isinstance(case, ClosedCase):
        chain, names = ClosedChainNumbers(tape, case), case.independent
        N = chain.N
    else:
        chain = ChainNumbers(tape, case, len(case.constants.screws) // 6)
        names, N = tuple(range(chain.n)), np.eye(chain.n)
    W, load = chain.W, LoadKind("follower")
    if case.dead_load_at is not None:
        load, R = LoadKind("dead", case.dead_load_at), chain.pose()[:3, :3].T
        moment, force = R @ W[:3], R @ W[3:]
        W = np.concatenate([moment + cross(np.array(case.dead_load_at), force), force])
    sizes = np.array([chain.length if d else 1.0 for d in case.constants.is_length], object)
    left, shut = chain.gradient - chain.J.T @ W, zeros(len(chain.q))
    if isinstance(case, ClosedCase):
        shut, verdict = _shutting(chain, case, sizes)
        left = left + N.T @ (chain.of_joints(W) @ shut)
    free = [i for i, name in enumerate(names) if name in case.settled]
    H, J = chain.lagrangian(W)[np.ix_(free, free)], chain.J[:, free]
    L, inverses, pivots = positive_factor(H)
    for a, pivot in enumerate(pivots):
        verdict = larger(verdict, pick(H[a, a] * numerics.LOST_ERROR, pivot, PLAIN, ENGINE))
    reached = below(L, np.column_stack([-left[free], J.T]))
    y, reach = reached[:, 0], reached[:, 1:]
    # With C = J H^-1 J^T it is (H + J^T D J)^-1 = (1 - H^-1 J^T D (1 + C D)^-1 J) H^-1.
    D = load.change(W)
    C = congruence(reach, np.diag(inverses))
    changed = D @ solution(np.eye(6) + C @ D, (reach.T @ (y * inverses))[:, None])[:, 0]
    step = N[:, free] @ above(L, (y - reach @ changed) * inverses) + shut
    verdict = larger(verdict, chain.verdict)
    moved = largest(step / sizes)
    settled = chain.q + step * pick(moved, LONGEST, 1.0, LONGEST / moved)
    return {
        "settled": in_pairs(settled),
        "moved": np.array([moved, verdict], object),
        "load": W,
    }


def settle(
    workspace: Any,
    evaluate: Evaluate,
    inputs: Mapping[str, Array],
    q: Array,
    which: NDArray[np.intp],
) -> tuple[NDArray[np.intp], Array]:
    """Take steps from some postures q[which], in place; those that come to rest, and their loads.

    `inputs` are the program's, "wrench" with one row or one for each of q. What finds no rest by
    a few of these steps is the engine's: how it ends there is not looked into, and its steps, which
    are others on the way, may end elsewhere. The loads (N, 6) are in M.
    """
    n, rest = q.shape[1], list[NDArray[np.intp]]()
    loads, moved = np.full((len(q), 6), np.nan), np.zeros(0)
    for _ in range(_FEW):
        at = np.ascontiguousarray(q[which])
        more, doubts = evaluate(at)
        own = {**inputs, "q": at, **more}
        if len(inputs["wrench"]) > 1:
            own["wrench"] = np.ascontiguousarray(inputs["wrench"][which])
        outputs = {
            "settled": aligned_empty(len(at), n + n % 2),
            "moved": aligned_empty(len(at), 2),
            "load": aligned_empty(len(at), 6),
        }
        workspace.run(own, outputs, len(at))
        moved, verdict = outputs["moved"].T
        stands = (verdict == PLAIN) & np.isfinite(moved) & (doubts == PLAIN)
        q[which[stands]] = outputs["settled"][stands, :n]
        loads[which] = outputs["load"]
        is_last = moved <= LAST
        rest.append(which[stands & is_last])
        which, moved = which[stands & ~is_last], moved[stands & ~is_last]
        if not which.size:
            break
    rest.append(which[moved <= ROUNDED])
    return np.concatenate(rest), loads
