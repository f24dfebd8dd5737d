"""What the legs of a platform, or the drives of a closed chain, do at a posture."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, plain
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.stiffness.forces import DriveForce


class Drive(NamedTuple):
    """A leg on a line, or an actuated joint of a closed chain.

    Attributes
    ----------
    name : str
        Of the leg or of the joint.
    is_length : bool
        Whether its position is a length, else an angle in rad.
    position, lower, upper : float
        Length of the leg, or coordinate, and its limits; infinite where there is none.
    force : float
        As in `cartstiff.core.stiffness.forces`: tension of a leg, or what a joint exerts
        on the link that it moves; NaN if unknown.
    """

    name: str
    is_length: bool
    position: float
    lower: float
    upper: float
    force: float

    @property
    def margin(self) -> float:
        """Distance to the nearest limit, below zero beyond it.

        Infinite without limits.
        """
        return min(self.position - self.lower, self.upper - self.position)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; None for what is infinite or unknown."""
        own = {**self._asdict(), "margin": self.margin}
        return {key: plain(x) if isinstance(x, float) else x for key, x in own.items()}


def drives_of(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    lengths: Array | None,
    forces: tuple[DriveForce, ...],
) -> tuple[Drive, ...]:
    """The legs of a platform, or the drives of a closed chain; none for other mechanisms.

    Parameters
    ----------
    elastic, posture
        The mechanism with its final rest positions, and its posture.
    lengths : ndarray (m,) or None
        Of the legs of a platform; None for other mechanisms.
    forces : tuple of DriveForce
        What they carry.
    """
    mechanism, none = elastic.mechanism, (-np.inf, np.inf)
    carried = {one.name: one.force for one in forces}
    bounds = mechanism.bounds
    if lengths is not None:
        names = [f"leg{i}" for i in range(1, len(lengths) + 1)]
        return tuple(
            Drive(name, True, x, *bounds.get(name, none), carried.get(name, np.nan))
            for name, x in zip(names, lengths.tolist(), strict=True)
        )
    if not mechanism.closures or elastic.springs is None:
        return ()
    q = _without_noise(posture.q, np.array(posture.coordinate_lengths))
    driven = [(float(q[j]), mechanism.coordinates[j]) for j in elastic.commanded]
    return tuple(
        Drive(c.name, c.is_length, x, c.lower, c.upper, carried.get(c.name, 0.0))
        for x, c in driven
    )


def _without_noise(values: Array, sizes: Array) -> Array:
    """Values with zeros for what closures leave of sizes."""
    return np.where(np.abs(values) <= numerics.STALLED_RESIDUAL * sizes, 0.0, values)
