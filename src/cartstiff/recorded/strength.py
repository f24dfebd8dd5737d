"""Margins of drives' forces, and the load that they hold, on numbers or recorded ones.

With forces t under the load W and rates ``r = J^T W`` of the legs' tensions, or ``r =
-J^T W`` of the joints' torques, the drives hold s times the load while ``low <= t + (s -
1) r <= high``, so that

    1 / s = max_i max( r_i / (high_i - t_i + r_i), r_i / (low_i - t_i + r_i) ),

which has no zero in a denominator unless a drive is at its limit without the load.
"""

from __future__ import annotations

from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.forces import drive_limits
from cartstiff.recorded.tape import absolute, larger, pick

#: Quantities that read the forces of drives.
OF_STRENGTH = "effort_margin", "largest_load"


class Drives(NamedTuple):
    """Drives whose forces have limits.

    Attributes
    ----------
    rows : tuple of (int, float, float)
        Place of each among the forces, its least and its largest force.
    of_legs : bool
        Whether these are tensions of legs, else torques of joints.
    """

    rows: tuple[tuple[int, float, float], ...] = ()
    of_legs: bool = False

    @classmethod
    def of(cls, elastic: ElasticMechanism) -> Drives:
        """Those of a mechanism."""
        of_legs = len(elastic.mechanism.points) > 0
        names = elastic.spring_names if of_legs else elastic.names
        low, high = drive_limits(elastic, names)
        known = np.flatnonzero(np.isfinite(low) | np.isfinite(high)).tolist()
        return cls(tuple((i, float(low[i]), float(high[i])) for i in known), of_legs)

    @property
    def output(self) -> str:
        """Output of `analyse_many` with their forces."""
        return "tensions" if self.of_legs else "torques"


def effort_margin(source: Any) -> Any:
    """One less the largest share of a limit that is used."""
    drives = source.settings.drives
    forces, each = source.entries(drives.output), list[Any]()
    for i, low, high in drives.rows:
        x = forces[i]
        if np.isfinite(low + high) and (low > 0.0 or high < 0.0):
            used = absolute(x - 0.5 * (low + high)) * (2.0 / (high - low))
        else:
            ends = [x / end for end in (low, high) if np.isfinite(end) and end]
            # A cable may pull as hard as it likes: nothing is used of no limit.
            used = reduce(larger, ends) if ends else 0.0 * x
        each.append(used)
    return 1.0 - reduce(larger, each)


def largest_load(source: Any) -> Any:
    """Multiple of the load that the drives hold; zero if they do not hold the weight."""
    drives = source.settings.drives
    forces, W = source.entries(drives.output), source.entries("wrench")
    J = np.moveaxis(source.arrays["jacobian"], (-2, -1), (0, 1))
    sign, shares, beyond = 1.0 if drives.of_legs else -1.0, list[Any](), list[Any]()
    for i, low, high in drives.rows:
        rate = sum(J[k, i] * W[k] for k in range(6)) * sign
        before = forces[i] - rate
        for end, over in ((high, before - high), (low, low - before)):
            if np.isfinite(end):
                shares.append(rate / (end - before))
                beyond.append(over)
    used = larger(reduce(larger, shares), numerics.TINY)
    return pick(0.0, reduce(larger, beyond), 0.0, 1.0 / used)
