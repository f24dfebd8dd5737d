"""Compliances under the four connections: from the matrices where these are plain, else without."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cartstiff import numerics
from cartstiff.geometry.se3 import Array
from cartstiff.stiffness.reduction import Reduction

__all__ = ["has_all_digits", "inverses", "plain_inverses"]

Inverses = dict[str, numerics.Inverse | None]


def plain_inverses(
    reduction: Reduction, matrices: Mapping[str, Array | None], changes: Array, chart: Array | None
) -> Inverses | None:
    """`inverses` from the matrices themselves where these are well conditioned, else None.

    That needs a posture plainly regular, in which no terms cancel.
    """
    free, values = reduction.free, reduction.singular_values.tolist()
    if (
        free is None or reduction.stiffness is None or not free.is_symmetric
        or not values[-1] * numerics.WELL_CONDITIONED > values[0] or not free.is_far_from_idle
    ):  # fmt: skip
        return None
    names = [name for name in "BAKF" if matrices[name] is not None]
    if not any(changes.ravel().tolist()):
        names = [name for name in names if name in "BF"]
    found = numerics.plain_inverses(np.array([matrices[name] for name in names]))
    if found is None:
        return None
    known: Inverses = dict.fromkeys("ABKF")
    for name, C, error in zip(names, *found, strict=True):
        if error < np.inf:
            known[name] = numerics.Inverse(0.5 * (C + C.T) if name in "BF" else C, error)
        elif name == "F":  # legs may be nearly dependent where the body is held by their load
            known[name] = free.compliances(other=chart)[-1]
        else:
            return None
    if "A" not in names:
        known["A"] = known["K"] = known["B"]
    return known


def inverses(
    reduction: Reduction, changes: Array, chart: Array | None, chart_is_own: bool
) -> Inverses:
    """All inverses with their errors, from one stack, for K^X - K^B (2, 6, 6) of X = A, K.

    `chart` is the Hessian (n, n) that makes K^F, `chart_is_own` says that it is the energy's.
    """
    free = reduction.free
    if free is None or reduction.force is None:
        return dict.fromkeys("ABKF")
    if any(reduction.force.tolist()):
        B, A, K, *F = free.compliances(changes, chart)
        return {"A": A, "B": B, "K": K, "F": F[0] if F else None}
    # Then one Hessian serves all, but for a chart that is not the coordinates themselves.
    B, *F = free.compliances(other=None if chart_is_own else chart)
    return {**dict.fromkeys("ABK", B), "F": F[0] if F else B if chart_is_own else None}


def has_all_digits(K: Array | None, change: Array | None) -> bool:
    """Whether K, and with a change D of it K + D, are plainly known with their inverses."""
    if K is None or change is None:
        return K is not None
    found = numerics.plain_inverses(np.array([K, K + change]))
    return found is not None and max(found[1]) < np.inf
