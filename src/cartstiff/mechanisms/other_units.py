r"""Convert mechanisms to another unit of length; the only place that does so.

Lengths are multiplied by a, such as 1000 from m to mm, forces stay. A moment, the stiffness of a
joint that turns, and an energy are then a times as large in number (N mm), the stiffness of one
that slides 1/a (N/mm); masses stay in kg and accelerations in m/s^2, which gives forces in N.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Coordinate, Mechanism
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.mechanisms.platform import Platform
from cartstiff.mechanisms.tree import KinematicTree
from cartstiff.potentials.contract import rescaled
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.units import Units, convert_length


def in_units(elastic: ElasticMechanism, length: str) -> ElasticMechanism:
    """Return the mechanism with its numbers in another unit of length.

    Parameters
    ----------
    elastic : ElasticMechanism
        An arm, a closed chain, or a platform.
    length : str
        A name of `cartstiff.units.LENGTHS`.

    Raises
    ------
    InputError
        For an unknown unit, another kind of mechanism, or energies that cannot be converted:
        functions of the user's, and loads.
    """
    units = Units(length, elastic.units.force)
    a, _ = convert_length(elastic.units, units)
    known = elastic.identified
    mechanism = _mechanism(elastic.mechanism, a, units)
    is_length = np.array([c.is_length for c in mechanism.coordinates], bool)
    sizes = np.where(is_length, a, 1.0)
    efforts = np.where(is_length, 1.0, a)
    springs, damping = elastic.springs, elastic.damping
    if damping is not None:
        of_lines = isinstance(springs, LineSprings)
        damping = damping * (1.0 / a if of_lines else efforts / sizes)
    return replace(
        elastic,
        mechanism=mechanism,
        q=elastic.q * sizes,
        springs=None if springs is None else springs.in_units(a, sizes, efforts),
        damping=damping,
        potentials=tuple(p.in_units(a, sizes, efforts) for p in elastic.potentials),
        identified=None
        if known is None
        else known.scaled(Elements(elastic).deflect_by_length, a),
    )


def shown(elastic: ElasticMechanism, q: Array) -> Array:
    """Return coordinates (..., n) in the units of texts and pictures, as `shown_heads`."""
    units = elastic.units
    sizes = (units.shown_per_radian, units.shown_per_length)
    return q * np.array([sizes[c.is_length] for c in elastic.mechanism.coordinates])


def shown_heads(elastic: ElasticMechanism) -> list[str]:
    """Return heads of a table of coordinates for people: "elbow [deg]", "slide [mm]"."""
    names = (elastic.units.shown_angle, elastic.units.shown_length)
    return [f"{c.name} [{names[c.is_length]}]" for c in elastic.mechanism.coordinates]


def _mechanism(mechanism: Mechanism, a: float, units: Units) -> Mechanism:
    if not isinstance(mechanism, Chain | Platform):
        raise InputError(
            "is not converted to other units", where="units", got=mechanism.kind
        )
    other: Chain | Platform = rescaled(mechanism, a)
    other.units = units
    if isinstance(other, Platform):
        other.close()
        return other
    vars(other).pop("ties", None)
    other.tree = _tree(other.tree, a)
    other.coordinates = other.tree.coordinates
    return other


def _tree(tree: KinematicTree, a: float) -> KinematicTree:
    model = tree.model.copy()
    slides = np.zeros(model.njoints, bool)
    for j in range(1, model.njoints):
        slides[j] = model.joints[j].shortname().startswith("JointModelP")
        model.jointPlacements[j].translation *= a
        body = model.inertias[j]
        model.inertias[j] = pin.Inertia(body.mass, a * body.lever, a * a * body.inertia)
    sizes = np.where(slides[1:], a, 1.0)
    model.armature = np.asarray(model.armature) * np.where(slides[1:], 1.0, a * a)
    mimic, offset = tree.mimic, None
    own = np.array([a if c.is_length else 1.0 for c in tree.coordinates])
    if mimic is not None:
        mimic, offset = mimic * sizes[:, None] / own, tree.offset * sizes
    coordinates: list[Coordinate] = [
        replace(c, lower=c.lower * s, upper=c.upper * s)
        for c, s in zip(tree.coordinates, own.tolist(), strict=True)
    ]
    frames = {name: rescaled(p, a) for name, p in tree.frames.items()}
    return KinematicTree(model, tuple(coordinates), frames, mimic, offset)
