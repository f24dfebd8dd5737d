r"""Closing chains by machine code: the steps of `Chain.closed`, recorded.

Along the axes of F, with ``w = log(R_b R_a^T)``, x = w.w and d from a to b, the residual of a weld
is ``xi = (w, d + w x d / 2 + c w x (w x d))`` and its rates are those of the twist about b times

    J_r^-1(xi) = 1 + ad / 2 + A ad^2 + B ad^4,

c, A and B being power series in x with the coefficients of ``(t / 2) cot(t / 2)``, t^2 = x; those
of a point are the twist about a. Each step is limited as there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    cross,
    in_pairs,
    largest,
    norm_squared,
    reflections,
    rotation_vector,
    skew,
    solution,
    upper_inverse,
    zeros,
)
from cartstiff.many.arguments import aligned_empty
from cartstiff.many.arithmetic import JACOBIAN_CONDITION, PLAIN, limited
from cartstiff.many.chains.closed_chain import ClosedCase, length_of
from cartstiff.many.chains.tree_twists import Tie, TreeKinematics
from cartstiff.many.tape import Scalar, Tape, larger, pick
from cartstiff.mechanisms.closures import FUTILE, LONGEST_STEP

#: Bernoulli numbers over factorials: coefficients of ``(t / 2) cot(t / 2)`` in t^2, but for the 1.
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
#: Steps after which rounding may choose the assembly, and after which the engine gives up. What
#: other way may then be taken, `ClosedCase.ways` tells: more coordinates than there are motions
#: are not held by chance; as many may be, in another assembly, which is left to the engine.
STEPS, LAST = 40, 100


def cotangent_series(x: Any) -> Any:
    """``(1 - (t / 2) cot(t / 2)) / t^2`` at x = t^2."""
    return -_series(x, list(_COTANGENT))


def _series(x: Any, coefficients: list[float]) -> Any:
    total: Any = 0.0
    for c in reversed(coefficients):
        total = total * x + c
    return total


def weld_residual(tree: TreeKinematics, tie: Tie) -> tuple[Array, Array, Scalar]:
    """Residual (6,), its rates (6, joints), and the verdict."""
    (R_a, p_a), (R_b, p_b) = tree.placed(tie.joint_a, tie.T_a), tree.placed(tie.joint_b, tie.T_b)
    w, verdict = rotation_vector(R_b @ R_a.T)
    x, d = w @ w, p_b - p_a
    c = cotangent_series(x)
    across = cross(w, d)
    xi = np.concatenate([w, d + across * 0.5 + cross(w, across) * c])
    A = _series(x, [(k - 1.0) * c_k for k, c_k in enumerate(_COTANGENT)])
    B = _series(x, [(k + 1.0) * c_k for k, c_k in enumerate(_COTANGENT[1:])])
    ad = zeros(6, 6)
    ad[:3, :3] = ad[3:, 3:] = skew(xi[:3])
    ad[3:, :3] = skew(xi[3:])
    twice = ad @ ad
    turned = np.eye(6) + ad * 0.5 + twice * A + (twice @ twice) * B
    J = tree.tied(tie, p_b)
    rates = zeros(*J.shape)
    for j, _ in tree.constants.way(tie):
        rates[:, j] = turned @ J[:, j]
    return xi, rates, verdict


def closing_arrays(tape: Tape, case: ClosedCase) -> dict[str, Array]:
    """The "next" coordinates, and what is "left": residual, step, length, verdict."""
    constants = case.constants
    n = len(constants.is_length)
    q = tape.vector("q", n)
    tree = TreeKinematics(constants, q)
    length = length_of(tree)
    columns = np.array([length if d else 1.0 for d in constants.is_length], object)
    verdict: Scalar = PLAIN
    residuals, every, rates = list[Array](), list[Array](), list[Array]()
    for tie, rows in zip(constants.ties, case.shut, strict=True):
        if tie.is_weld:
            xi, J, doubt = weld_residual(tree, tie)
            verdict = larger(verdict, doubt)
        else:
            p_a, p_b = tree.placed(tie.joint_a, tie.T_a)[1], tree.placed(tie.joint_b, tie.T_b)[1]
            xi, J = np.concatenate([zeros(3), p_b - p_a]), tree.tied(tie, p_a)
        every.append(xi)
        residuals.append(xi[list(rows)])
        rates.append(J[list(rows)])
    missed, C = np.concatenate(residuals), np.concatenate(rates)
    step = zeros(n)
    D = [j for j in case.moving if j not in case.held]
    sizes = columns[D]
    scaled = C[:, D] * sizes
    if len(D) == len(C):
        # A vector in no particular direction tells whether rounding would choose the assembly.
        probe = np.cos(np.arange(1.0, 1.0 + len(D)))
        solved = solution(scaled, np.column_stack([-missed, probe]))
        step[D] = solved[:, 0]
        size = norm_squared(solved[:, 1]) / len(D) * norm_squared(scaled)
    else:
        Q = reflections(scaled.T)
        inverse_R = upper_inverse(Q.R)
        y = zeros(len(D))
        y[: len(Q.R)] = inverse_R.T @ -missed
        size = norm_squared(Q.R) * norm_squared(inverse_R)
        step[D] = Q.apply(y)
    verdict = larger(verdict, limited(size, JACOBIAN_CONDITION**2))
    long = largest(step)
    step = step * columns * pick(long, LONGEST_STEP, 1.0, LONGEST_STEP / long)
    left = np.array([largest(np.concatenate(every)), long, length, verdict], object)
    moved = q + step
    return {"next": in_pairs(moved), "left": left}


def close(
    ways: Sequence[Callable[[], Any]], q: Array
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Coordinates that close the chain from q (N, n), where they do, and where none do.

    `ways` give what runs the programs of `closing_arrays` of `ClosedCase.ways` on as many rows.
    Where the engine would go on, or end elsewhere, the coordinates stay those given; where it would
    go on in vain, by these ways, is told.
    """
    closed, is_closed, which = q.copy(), np.zeros(len(q), bool), np.arange(len(q))
    for workspace in ways:
        if not which.size:
            break
        at, done, is_vain = q[which], np.zeros(len(which), bool), np.zeros(len(which), bool)
        _close(workspace(), at, done, is_vain)
        closed[which[done]], is_closed[which[done]] = at[done], True
        which = which[is_vain]
    return closed, is_closed, np.isin(np.arange(len(q)), which) & bool(ways)


def is_shut(size: Any, step: Any, length: Any, before: Any) -> Any:
    """Whether closures are met: at rounding level, or within tolerance once steps do not help.

    By what is "left", and the residual `before`.
    """
    unit = np.maximum(1.0, length)
    return (size <= numerics.ATTAINABLE_PRECISION * unit) | (
        (size <= numerics.ROUNDING * unit)
        & ((size > 0.1 * before) | (step <= numerics.SMALLEST_STEP))
    )


def _close(
    workspace: Any, q: Array, is_closed: NDArray[np.bool_], is_vain: NDArray[np.bool_]
) -> None:
    """Take steps from q, in place; where they close the chain, and where they end in vain."""
    n, which, before = q.shape[1], np.arange(len(q)), np.full(len(q), np.inf)
    best, futile = before, np.zeros(len(q), int)
    for taken in range(LAST):
        moved = {"next": aligned_empty(len(which), n + n % 2), "left": aligned_empty(len(which), 4)}
        at = q if len(which) == len(q) else q[which]
        workspace.run({"q": np.ascontiguousarray(at)}, moved, len(which))
        size, step, length, doubt = moved["left"].T
        done = is_shut(size, step, length, before)
        is_closed[which[done]] = taken < STEPS
        futile = np.where(size < 0.9 * best, 0, futile + 1)
        goes_on = ~done & (doubt == PLAIN) & np.isfinite(step)
        vain = goes_on & (
            (step <= numerics.SMALLEST_STEP) | (futile >= FUTILE) & (step < LONGEST_STEP)
        )
        is_vain[which[vain]] = True
        goes_on &= ~vain
        which, before, futile = which[goes_on], size[goes_on], futile[goes_on]
        best = np.minimum(best[goes_on], before)
        if not which.size:
            return
        q[which] = moved["next"][goes_on, :n]
    is_vain[which] = True
