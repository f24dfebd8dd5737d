"""Margins of drives' forces, and the load that they hold, on numbers or recorded ones.

With forces t under the load W and rates ``r = J^T W`` of the legs' tensions, or ``r =
-J^T W`` of the joints' torques, the drives hold s times the load while ``low <= t + (s -
1) r <= high``, so that

    1 / s = max_i max( r_i / (high_i - t_i + r_i), r_i / (low_i - t_i + r_i) ),

which has no zero in a denominator unless a drive is at its limit without the load. In
loops r follows from (1) of `cartstiff.answer.held_forces`, if there are as many drives as
motions; more of them share a load by their stiffness.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from cartstiff.answer.held_forces import drive_rows, motions_of_loops
from cartstiff.core import numerics
from cartstiff.core.arrays import Array
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
    of_loops : bool
        Whether the mechanism has closures.
    """

    rows: tuple[tuple[int, float, float], ...] = ()
    of_legs: bool = False
    of_loops: bool = False

    @classmethod
    def of(cls, elastic: ElasticMechanism) -> Drives:
        """Those of a mechanism."""
        of_legs = len(elastic.mechanism.points) > 0
        names = elastic.spring_names if of_legs else elastic.names
        low, high = drive_limits(elastic, names)
        known = np.flatnonzero(np.isfinite(low) | np.isfinite(high)).tolist()
        rows = tuple((i, float(low[i]), float(high[i])) for i in known)
        return cls(rows, of_legs, bool(elastic.mechanism.closures))

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
    forces, rates = source.entries(drives.output), source.rates_of_load()
    shares, beyond = list[Any](), list[Any]()
    for i, low, high in drives.rows:
        rate = rates(i)
        before = forces[i] - rate
        for end, over in ((high, before - high), (low, low - before)):
            if np.isfinite(end):
                shares.append(rate / (end - before))
                beyond.append(over)
    used = larger(reduce(larger, shares), numerics.TINY)
    return pick(0.0, reduce(larger, beyond), 0.0, 1.0 / used)


def along_jacobian(source: Any) -> Callable[[int], Any]:
    """Rate r_i of the force of each drive of a chain, or of six legs."""
    W, sign = source.entries("wrench"), 1.0 if source.settings.drives.of_legs else -1.0
    J = np.moveaxis(source.arrays["jacobian"], (-2, -1), (0, 1))
    return lambda i: sum(J[k, i] * W[k] for k in range(6)) * sign


def has_as_many_drives_as_motions(elastic: ElasticMechanism) -> bool:
    """Whether the drives of rigid links in loops balance a load without a choice."""
    mechanism = elastic.mechanism
    if mechanism.virtual or mechanism.rigid:
        return False
    posture = mechanism.at(elastic.q)
    names, _ = drive_rows(elastic, posture)
    return len(names) == motions_of_loops(elastic, posture).shape[1]


def rates_in_loops(elastic: ElasticMechanism, q: Array, wrenches: Array) -> Array:
    """Rates (n, N) by loads (N, 6) at closed postures (N, n); NaN where drives hold
    nothing, or a posture or load is unknown.
    """
    rates, place = np.full(q.shape, np.nan), {n: i for i, n in enumerate(elastic.names)}
    for row, at, W in zip(rates, q, wrenches, strict=True):
        if not np.isfinite([*at, *W]).all():
            continue
        posture = elastic.mechanism.at(at)
        N, (names, drives) = (
            motions_of_loops(elastic, posture),
            drive_rows(elastic, posture),
        )
        A, G = (drives @ N).T, (posture.motion.jacobian @ N).T
        values = numerics.singular_values(A)
        if A.shape[0] != A.shape[1] or numerics.rank(values) < len(A):
            continue
        row[:] = 0.0
        for name, force in zip(names, np.linalg.solve(A, G @ W), strict=True):
            if name in place:
                row[place[name]] = force
    return rates.T
