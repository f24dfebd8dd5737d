"""Derivatives of a study's objectives and constraints by its variables.

A quantity at a pose has exact derivatives by the numbers x of the mechanism and by its
coordinates; these follow the variables v through the file's arithmetic:

    dy/dv = sum of dy/dx dx/dv,

with difference quotients of eighth order of the numbers that the file is read to. A
quantity has such a quotient itself where it is not recorded or at a kink, such as equal
principal values, and where it depends on something else of the file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array
from cartstiff.core.geometry.differences import jacobian
from cartstiff.core.stiffness.compute import PostureStiffness, analyse
from cartstiff.recorded.gradients.gradient import exact_slopes
from cartstiff.recorded.gradients.objectives import OfQuantity
from cartstiff.wings.maps.job import MapJob

#: Share of the variables' sizes by which the design that is compared differs.
_OTHER_DESIGN = 0.02


class AtPose:
    """A design at one pose of the map of one quantity.

    Parameters
    ----------
    job : MapJob
        The map.
    pose : int
        Number of the pose.
    """

    def __init__(self, job: MapJob, pose: int) -> None:
        self.elastic, self._kind = job.elastic, job.settings.load
        self.asked = OfQuantity(job.quantities[0], job.settings, job.elastic)
        box = tuple(slice(0, n) for n in job.sampling.shape)
        q = job.sampling.postures(box, job.elastic)[pose]
        self.q = np.asarray(job.elastic.mechanism.closed(q).q)
        self.load: dict[str, Any] = {
            "wrench": job.wrench,
            "load_kind": self._kind.kind,
            "load_at": self._kind.at,
            "load_axes": job.load_axes,
        }

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers of the mechanism, and the coordinates, by name."""
        own = {name: x.value for name, x in self.elastic.numbers().items()}
        q = zip(self.elastic.names, self.q.tolist(), strict=True)
        return own | {f"q.{name}": value for name, value in q}

    @property
    def result(self) -> PostureStiffness:
        """The analysis under the load."""
        return analyse(self.elastic, self.q, **self.load)

    def is_like(self, other: AtPose) -> bool:
        """Whether the numbers alone make this design the other one."""
        names, numbers = self.elastic.numbers(), other.numbers
        if numbers.keys() != self.numbers.keys():
            return False
        moved = self.elastic.with_numbers({name: numbers[name] for name in names})
        found = self.asked.seen(analyse(moved, other.q, **self.load))
        wanted = self.asked.seen(other.result)
        return abs(found - wanted) <= numerics.NEGLIGIBLE_DIFFERENCE * abs(wanted)

    def slopes(self) -> dict[str, float]:
        """Exact derivatives by the numbers; empty where there are none."""
        return exact_slopes(self.result, self.asked, self.load, self._kind)


def rates_at(there: Callable[[Array], AtPose], sizes: Array) -> Array:
    """Derivatives (v,) of a quantity by variables of natural sizes, from their changes
    to the design. The characteristic length stays.

    Raises
    ------
    CartstiffError
        Where the quantity does not exist.
    """
    here = there(np.zeros(sizes.size))
    names, slopes = [*here.numbers], here.slopes()

    def numbers(change: Array) -> list[float]:
        at = there(change).numbers
        return [at[name] for name in names]

    if slopes and here.is_like(there(_OTHER_DESIGN * sizes)):
        rates = jacobian(numbers, sizes)
        moving = [i for i, row in enumerate(rates) if row.any()]
        if all(names[i] in slopes for i in moving):
            return np.asarray([slopes[names[i]] for i in moving] @ rates[moving])
    return jacobian(lambda change: here.asked.seen(there(change).result), sizes)
