r"""Convert mechanisms to another unit of length; the only place that does so.

Lengths are multiplied by a, such as 1000 from m to mm, forces stay. A moment, the
stiffness of a joint that turns, and an energy are then a times as large in number (N mm),
the stiffness of one that slides 1/a (N/mm); masses stay in kg and accelerations in m/s^2,
which gives forces in N.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartstiff.core.arrays import Array
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.units import Units, convert_length


def in_units(elastic: ElasticMechanism, length: str) -> ElasticMechanism:
    """Return the mechanism with its numbers in another unit of length.

    Parameters
    ----------
    elastic : ElasticMechanism
        An arm, a closed chain, or a platform.
    length : str
        A name of `cartstiff.core.units.LENGTHS`.

    Raises
    ------
    InputError
        For an unknown unit, another kind of mechanism, or energies that cannot be
        converted: functions of the user's, and loads.
    """
    units = Units(length, elastic.units.force)
    a, _ = convert_length(elastic.units, units)
    known = elastic.identified
    mechanism = elastic.mechanism.in_units(a, units)
    is_length = mechanism.is_length
    sizes = np.where(is_length, a, 1.0)
    efforts = np.where(is_length, 1.0, a)
    springs, damping = elastic.springs, elastic.damping
    if damping is not None and springs is not None:
        slides = np.array(springs.slides_in(mechanism.coordinates), bool)
        damping = damping * np.where(slides, 1.0 / a, a)
    return replace(
        elastic,
        mechanism=mechanism,
        q=elastic.q * sizes,
        springs=None if springs is None else springs.in_units(a, sizes, efforts),
        damping=damping,
        efforts={
            c.name: tuple(x * efforts[j] for x in elastic.efforts[c.name])
            for j, c in enumerate(mechanism.coordinates)
            if c.name in elastic.efforts
        },
        potentials=tuple(p.in_units(a, sizes, efforts) for p in elastic.potentials),
        identified=known and known.scaled(elastic.compliances, a),
    )


def shown(elastic: ElasticMechanism, q: Array) -> Array:
    """Return coordinates (..., n) in the units of texts and pictures,
    as `shown_heads`.
    """
    units = elastic.units
    sizes = (units.shown_per_radian, units.shown_per_length)
    return q * np.array([sizes[c.is_length] for c in elastic.mechanism.coordinates])


def shown_heads(elastic: ElasticMechanism) -> list[str]:
    """Return heads of a table of coordinates for people: "elbow [deg]", "slide [mm]"."""
    names = (elastic.units.shown_angle, elastic.units.shown_length)
    return [f"{c.name} [{names[c.is_length]}]" for c in elastic.mechanism.coordinates]
