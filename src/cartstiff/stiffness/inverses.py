"""Compliances under the four connections: from the matrices where these are plain, else without."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.stiffness.free_motions import FreeMotions
from cartstiff.stiffness.reduction import Reduction
from cartstiff.stiffness.rounding import without_cancelled


class Compliances(NamedTuple):
    """C^A, C^B, C^K, C^F (6, 6), None where one does not exist, and the relative error of C^B.

    `load` is the inverse of K^load where it is plainly known, too.
    """

    matrices: dict[str, Array | None]
    error: float = 0.0
    load: Array | None = None

    @property
    def has_load(self) -> bool:
        """Whether the inverse of K^load is known."""
        return self.load is not None

    @property
    def B(self) -> numerics.Inverse | None:  # noqa: N802
        """C^B with its error."""
        C = self.matrices["B"]
        return None if C is None else numerics.Inverse(C, self.error)


def every_matrix(
    reduction: Reduction, changes: Array, K_F: Array | None, length: float
) -> Array | None:
    """K^B, K^A, K^K, K^load and, where it exists, K^F (4 or 5, 6, 6); None without K^B.

    With the changes (3, 6, 6) of the middle ones by the load, and the characteristic length.
    """
    K = reduction.stiffness
    if K is None or reduction.force is None:
        return None
    every = np.empty((4 if K_F is None else 5, 6, 6))
    every[0] = K
    np.add(changes, K, out=every[1:4])
    if any(changes.ravel().tolist()):
        rows = np.repeat([1.0, 1 / length], 3)
        every[1:4] = without_cancelled(every[1:4], K, changes, rows)
    if K_F is not None:
        every[4] = K_F
    every.flags.writeable = False
    return every


def compliance_under(reduction: Reduction, change: Array) -> Array | None:
    """Inverse (6, 6) of K^B + D for a change D by the load, found without K; None without one."""
    if reduction.force is None or reduction.free is None:
        return None
    inverse = reduction.free.compliance(change)
    return None if inverse is None else inverse.matrix


def plain_inverses(
    reduction: Reduction, matrices: Array | None, chart: Array | None
) -> Compliances | None:
    """`inverses` from the matrices themselves where these are well conditioned, else None.

    That needs a posture plainly regular, in which no terms cancel. The matrices are those of
    `every_matrix`.
    """
    free, values = reduction.free, reduction.singular_values
    if (
        free is None
        or matrices is None
        or reduction.force is None
        or not free.is_symmetric
        or not values[-1] * numerics.WELL_CONDITIONED > values[0]
        or not free.is_far_from_idle
    ):
        return None
    inverses = numerics.plain_inverses(matrices)
    if inverses is None:
        return None
    each, errors = inverses
    # Without a load the first four are one.
    symmetric = each[::4] if any(reduction.force.tolist()) else each
    symmetric[:] = 0.5 * (symmetric + symmetric.swapaxes(1, 2))
    if len(symmetric) < len(each) and numerics.is_symmetric(matrices[3]):
        each[3] = 0.5 * (each[3] + each[3].T)
    each.flags.writeable = False
    known: dict[str, Array | None] = {"A": each[1], "B": each[0], "K": each[2], "F": None}
    if len(errors) > 4:
        known["F"] = each[4] if errors[4] < inf else _of_chart(matrices[4:], chart, free)
    if not max(errors[:3]) < inf:
        return None
    return Compliances(known, errors[0], each[3] if errors[3] < inf else None)


def _of_chart(K_F: Array, chart: Array | None, free: FreeMotions) -> Array | None:
    """C^F where legs are nearly dependent while their load holds the body: its sizes are others."""
    (C,), (error,) = numerics.invert_each(K_F)
    if error <= numerics.REPORTED_ERROR:
        return np.asarray(0.5 * (C + C.T))
    other = free.compliances(other=chart)[-1]
    return None if other is None else other.matrix


def inverses(
    reduction: Reduction, changes: Array, chart: Array | None, chart_is_own: bool
) -> Compliances:
    """All inverses, from one stack, for K^X - K^B (2, 6, 6) of X = A, K.

    `chart` is the Hessian (n, n) that makes K^F, `chart_is_own` says that it is the energy's.
    """
    free = reduction.free
    if free is None or reduction.force is None:
        return Compliances(dict.fromkeys("ABKF"))
    if any(reduction.force.tolist()):
        B, A, K, *F = free.compliances(changes, chart)
    else:  # then one Hessian serves all, but for a chart that is not the coordinates themselves
        B, *F = free.compliances(other=None if chart_is_own else chart)
        A = K = B
        F = F or [B] * chart_is_own
    each = {"A": A, "B": B, "K": K, "F": F[0] if F else None}
    matrices = {name: None if C is None else C.matrix for name, C in each.items()}
    return Compliances(matrices, 0.0 if B is None else B.error)
