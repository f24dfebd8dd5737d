r"""Small vibrations on recording numbers: ``K_q x = omega^2 M x``.

With H the Lagrangian Hessian on the motions x, J their twists and D = K^load - K^B,

    K_q = H + J^T D J = L L^T,    1 / omega^2: eigenvalues of L^-1 M L^-T,

which holds the slow ones to the last digit, and with M = G G^T those of its inverse,
``L^T M^-1 L``, the quick ones. Without an energy, K_q has no such factor; nor where a motion costs
nothing, or grows: the engine decides.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.many.algebra import (
    below,
    congruence,
    is_zero,
    largest,
    positive_factor,
    symmetric_product,
    zeros,
)
from cartstiff.many.arithmetic import ENGINE, PLAIN, limited
from cartstiff.many.reading.eigenvalues import ascending, eigenvalues, largest_eigenvalue
from cartstiff.many.tape import Scalar, larger, pick, square_root

#: Loss of digits up to which an eigenvalue is taken from the one matrix, or from the other.
_DIGITS = 0.99 * numerics.PLAIN_BLOCK


def frequency_name(which: int) -> str:
    """The quantity's name, counted from 0."""
    return f"frequency_{which + 1}"


def periods(arrays: Mapping[str, Array], D: Array, number: int) -> tuple[list[Scalar], Scalar]:
    """The largest 1 / omega^2, so many or more, and the verdict on them.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        "kinetic" M, "lagrangian" H and "motion" J.
    D : ndarray (6, 6)
        What the load adds to the stiffness.
    number : int
        How many are wanted; the first alone takes less.
    """
    H, M, J = (arrays[name] for name in ("lagrangian", "kinetic", "motion"))
    verdict: Scalar = PLAIN
    skew = D - D.T
    if not all(is_zero(x) for x in skew.flat):
        least = largest(D) * numerics.ROUNDING
        verdict = pick(least, largest(skew), ENGINE, PLAIN)
    if not all(is_zero(x) for x in D.flat):
        H = H + congruence(J, (D + D.T) * 0.5)
    L, inverses, pivots = positive_factor(H)
    for pivot, entry in zip(pivots, H.diagonal(), strict=True):
        verdict = larger(verdict, pick(entry * numerics.LOST_ERROR, pivot, PLAIN, ENGINE))
    roots = np.array([square_root(x) for x in inverses], object)
    slow = below(L, below(L, M).T) * np.multiply.outer(roots, roots)
    if number == 1:
        longest, doubt = largest_eigenvalue(slow)
        return [longest], larger(verdict, doubt)
    slowest, doubt = eigenvalues(slow)
    slowest, verdict = ascending(slowest)[::-1], larger(verdict, doubt)
    quickest, doubt = eigenvalues(_inverse(M, L / roots))
    quickest = ascending(quickest)
    found = list[Scalar]()
    for x, y in list(zip(slowest, quickest, strict=True))[:number]:
        # Of motions without mass the inverse knows nothing: its verdict counts where it is asked.
        loss = slowest[0] / x
        other = larger(doubt, limited(quickest[-1] / y, _DIGITS))
        verdict = larger(verdict, pick(loss, _DIGITS, PLAIN, other))
        found.append(pick(loss, _DIGITS, x, 1.0 / y))
    return found, verdict


def _inverse(M: Array, L: Array) -> Array:
    """``L^T M^-1 L``."""
    G, inverses, _ = positive_factor(M)
    reached = below(G, L)
    return symmetric_product(reached.T, reached * inverses[:, None], zeros(*M.shape))
