r"""Postures of arms that have lost rank, in stacks: ``C = J H^-1 J^T`` needs no inverse of J.

What the engine calls them is decided here only where there is no doubt about it: the rank by
singular values far from the limit, a stiffness that is positive along every motion, so that no
self-motion is idle or buckles, and a self-motion that either feels nothing, because the springs
carry a load that is known, or plainly a torque. All else stays with the engine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cartstiff.geometry.se3 import Array
from cartstiff.many.arguments import aligned_empty
from cartstiff.many.arithmetic import PLAIN
from cartstiff.many.chains.chain_numbers import ChainCase
from cartstiff.many.kernels import kernel_for, run
from cartstiff.many.plans import BoundCase
from cartstiff.numerics import BALANCE, RANK, ROUNDING

#: How far from a limit there is no doubt.
_MARGIN = 10.0


def lost_ranks(
    taken: BoundCase,
    q: Array,
    loads: Array | None,
    arrays: Mapping[str, Array],
    which: NDArray[np.intp],
    compiled: bool,
    threads: int,
    size: int | None,
) -> tuple[str, NDArray[np.intp], NDArray[np.intp]]:
    """Fill those of some postures that have plainly lost rank.

    Returns
    -------
    state : str
        Of those that are filled.
    filled, unbalanced : ndarray of int
        Some of `which`; of the latter nothing but pose, Jacobian and energy is filled.
    """
    case = taken.case
    if type(case) is not ChainCase or case.settled:
        return "", which[:0], which[:0]
    n = case.freedoms
    state = "fewer-than-six-freedoms" if n < 6 else "serial-singularity"
    other = replace(taken, case=replace(case, singular=True))
    names = tuple(name for name in arrays if not name.startswith("stiffness"))
    kernel = kernel_for(other.case, (*names, "looked_at"), len(which), compiled)
    rows = {name: aligned_empty(len(which), *arrays[name].shape[1:]) for name in names}
    looked_at = aligned_empty(len(which), len(kernel.program.outputs["looked_at"]))
    verdicts = np.zeros(len(which), np.uint8)
    own = loads[which] if loads is not None and loads.ndim == 2 else loads
    run(other, kernel, q[which], own, {**rows, "looked_at": looked_at}, verdicts, threads, size)

    J = looked_at[:, : 6 * n].reshape(-1, 6, n)
    is_known = (verdicts == PLAIN) & np.isfinite(looked_at).all(axis=1)
    J = np.where(is_known[:, None, None], J, 0.0)
    values = np.linalg.svd(J, compute_uv=False)
    least = RANK * values[:, :1]
    is_known &= ~((values > least / _MARGIN) & (values < least * _MARGIN)).any(axis=1)
    ranks = (values > least).sum(axis=1)
    is_lost = is_known & (ranks < min(6, n))
    unbalanced = np.zeros(len(which), bool)
    if loads is None and not (case.open and all(case.open[a] for a in case.moving)):
        # Springs exert what they do: whether the self-motions feel it.
        g, stiffest = looked_at[:, 6 * n : 7 * n], looked_at[:, 7 * n]
        free, motions = np.arange(n) >= ranks[:, None], np.linalg.svd(J)[2]
        felt = np.linalg.norm((motions @ g[:, :, None])[:, :, 0] * free, axis=1)
        most = BALANCE * np.abs(g).max(axis=1) + ROUNDING * stiffest
        unbalanced = is_lost & (felt > most * (_MARGIN * n))
        is_lost[:] = False
    for chosen in (is_lost, unbalanced):
        for name, array in arrays.items():
            array[which[chosen]] = rows[name][chosen] if name in rows else np.nan
    return state, which[is_lost], which[unbalanced]
