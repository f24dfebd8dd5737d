"""What the legs of a platform, or the drives of a closed chain, do at a posture."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import plain
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.elastic import ElasticMechanism


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
        Of its spring: tension, or torque, above zero where it is longer than at rest; NaN
        if unknown.
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
    tensions: Array | None,
) -> tuple[Drive, ...]:
    """The legs of a platform, or the drives of a closed chain; none for other mechanisms.

    Parameters
    ----------
    elastic, posture
        The mechanism with its final rest positions, and its posture.
    lengths, tensions : ndarray (m,) or None
        Of the legs of a platform; None for other mechanisms, and for unknown tensions.
    """
    mechanism, stiffness = elastic.mechanism, elastic.stiffnesses
    bounds, none = mechanism.bounds, (-np.inf, np.inf)
    if lengths is not None:
        forces = np.full(len(lengths), np.nan) if tensions is None else tensions
        forces = _without_noise(forces, _products(stiffness, lengths))
        names = [f"leg{i}" for i in range(1, len(lengths) + 1)]
        return tuple(
            Drive(name, True, x, *bounds.get(name, none), f)
            for name, x, f in zip(names, lengths.tolist(), forces.tolist(), strict=True)
        )
    if not mechanism.closures or elastic.springs is None:
        return ()
    sizes = np.array(posture.coordinate_lengths)
    torques = np.asarray(elastic.springs.evaluate(posture).gradient)
    torques = _without_noise(torques, _products(stiffness, sizes))
    q = _without_noise(posture.q, sizes)
    return tuple(
        Drive(c.name, c.is_length, float(q[j]), c.lower, c.upper, float(torques[j]))
        for j, c in ((j, mechanism.coordinates[j]) for j in elastic.commanded)
    )


def _products(stiffness: list[float], sizes: Array) -> Array:
    """Forces of springs that are elongated by their sizes.

    Zero where springs are others.
    """
    if len(stiffness) != len(sizes):
        return np.zeros(len(sizes))
    return np.array(stiffness) * sizes


def _without_noise(values: Array, sizes: Array) -> Array:
    """Values with zeros for what closures leave of sizes.

    Of infinite ones nothing is known.
    """
    finite = np.where(np.isfinite(sizes), sizes, 0.0)
    return np.where(np.abs(values) <= numerics.STALLED_RESIDUAL * finite, 0.0, values)
