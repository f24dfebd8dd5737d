"""Tensions of a platform's legs at many postures, by the arithmetic that finds its stiffness."""

from __future__ import annotations

from typing import Literal

import numpy as np

from cartstiff.errors import CartstiffError
from cartstiff.geometry.se3 import Array
from cartstiff.many.arithmetic import PLAIN
from cartstiff.many.kernels import has_package, kernel_for, run
from cartstiff.many.plans import BoundCase, given_as, plan
from cartstiff.many.platform_arithmetic import PlatformCase
from cartstiff.many.postures import loads_in_body
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.limits import tensions_of
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.stiffness.applied_load import LoadKind
from cartstiff.stiffness.compute import analyse


def tensions_of_many(
    elastic: ElasticMechanism,
    q: Array,
    wrench: Array | None,
    kind: LoadKind,
    axes: Literal["body", "world"],
) -> Array:
    """Tensions (N, m) at postures q (N, 6), as `cartstiff.analyse` has them under a wrench (6,).

    NaN where no tensions balance the load, and of mechanisms without legs.
    """
    taken, count = plan(elastic, given_as(wrench, axes)), len(q)
    legs = getattr(elastic.mechanism, "anchors", np.zeros((0, 3)))
    tensions = np.full((count, len(legs)), np.nan)
    served = type(elastic.springs) is LineSprings and count > 0
    known = np.zeros(count, bool)
    if isinstance(taken, BoundCase) and isinstance(taken.case, PlatformCase) and served:
        loads = wrench
        if loads is not None:
            loads = loads_in_body(elastic, q, loads, kind, axes, "auto", 1)
        is_compiled = has_package("llvmlite") and len(legs) % 2 == 0  # records are written by pairs
        kernel = kernel_for(taken.case, ("tensions",), count, is_compiled)
        verdicts = np.zeros(count, np.uint8)
        run(taken, kernel, q, loads, {"tensions": tensions}, verdicts, 1, None)
        known = (verdicts == PLAIN) & np.isfinite(tensions).all(axis=1)
    for i in np.flatnonzero(~known):
        tensions[i] = np.nan
        try:
            result = analyse(
                elastic,
                q[i],
                wrench=wrench,
                load_kind=kind.kind,
                load_at=kind.at,
                load_axes=axes,
            )
        except CartstiffError:
            continue
        if (found := tensions_of(result.elastic, result.posture)) is not None:
            tensions[i] = found
    return tensions
