"""Tensions of a platform's legs at many postures, by the arithmetic that finds its stiffness."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cartstiff.geometry.se3 import Array
from cartstiff.many.arithmetic import PLAIN
from cartstiff.many.kernels import has_package, kernel_for, run
from cartstiff.many.plans import given_as, plan
from cartstiff.many.platform_arithmetic import PlatformCase
from cartstiff.many.postures import loads_in_body
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.stiffness.applied_load import LoadKind


def tensions_of_many(
    elastic: ElasticMechanism,
    q: Array,
    wrench: Array | None,
    kind: LoadKind,
    axes: Literal["body", "world"],
) -> tuple[Array, NDArray[np.bool_]]:
    """Tensions (N, m) at postures q (N, 6), and at which of these they are known.

    Under a wrench (6,), given as to `cartstiff.analyse`; where they are not known, the engine is to
    be asked.
    """
    taken, count = plan(elastic, given_as(wrench, axes)), len(q)
    legs = getattr(elastic.mechanism, "anchors", np.zeros((0, 3)))
    tensions = np.full((count, len(legs)), np.nan)
    served = type(elastic.springs) is LineSprings and count > 0
    if isinstance(taken, str) or not isinstance(taken.case, PlatformCase) or not served:
        return tensions, np.zeros(count, bool)
    loads = wrench
    if loads is not None:
        loads = loads_in_body(elastic, q, loads, kind, axes, "auto", 1)
    is_compiled = has_package("llvmlite") and len(legs) % 2 == 0  # records are written by pairs
    kernel = kernel_for(taken.case, ("tensions",), count, is_compiled)
    verdicts = np.zeros(count, np.uint8)
    run(taken, kernel, q, loads, {"tensions": tensions}, verdicts, 1, None)
    return tensions, (verdicts == PLAIN) & np.isfinite(tensions).all(axis=1)
