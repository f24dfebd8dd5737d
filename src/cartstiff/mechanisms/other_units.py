r"""A mechanism in another unit of length: the one place that converts.

Lengths are multiplied by a, such as 1000 from m to mm, forces stay. A moment, the stiffness of a
joint that turns, and an energy are then a times as large in number (N mm), the stiffness of one
that slides 1/a (N/mm); masses stay in kg and accelerations in m/s^2, which gives forces in N.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pinocchio as pin

from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import Coordinate, Mechanism, Units, convert_length
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.elements import Elements
from cartstiff.mechanisms.platform import Platform
from cartstiff.mechanisms.tree import FixedFrame, KinematicTree
from cartstiff.potentials.beams import Beam, Section
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.line_springs import LineSprings
from cartstiff.potentials.springs import (
    CoupledSprings,
    JointSprings,
    PolynomialLaw,
    SpringLaw,
    TabulatedLaw,
)


def in_units(elastic: ElasticMechanism, length: str, shown_angle: str = "rad") -> ElasticMechanism:
    """The same mechanism with its numbers in another unit of length.

    Parameters
    ----------
    elastic : ElasticMechanism
        An arm, a closed chain, or a platform.
    length : str
        A name of `cartstiff.mechanisms.contract.LENGTHS`.
    shown_angle : {"rad", "deg"}
        What tables for people show angles in; numbers stay in radians.

    Raises
    ------
    InputError
        For an unknown unit, another kind of mechanism, or energies that cannot be converted:
        functions of the user's, and loads.
    """
    units = Units(length, elastic.units.force, shown_angle)
    a, _ = convert_length(elastic.units, units)
    known = elastic.identified
    mechanism = _mechanism(elastic.mechanism, a, units)
    is_length = np.array([c.is_length for c in mechanism.coordinates], bool)
    sizes = np.where(is_length, a, 1.0)
    efforts = np.where(is_length, 1.0, a)
    springs = elastic.springs
    if isinstance(springs, LineSprings):
        sizes_of_springs, efforts_of_springs = np.array([a]), np.array([1.0])
        springs = springs.scaled(a)
    else:
        sizes_of_springs, efforts_of_springs = sizes, efforts
        springs = None if springs is None else _joints(springs, sizes, efforts)
    damping = elastic.damping
    if damping is not None:
        damping = damping * efforts_of_springs / sizes_of_springs
    return replace(
        elastic,
        mechanism=mechanism,
        q=elastic.q * sizes,
        springs=springs,
        damping=damping,
        potentials=tuple(_potential(p, a, sizes, efforts) for p in elastic.potentials),
        identified=None if known is None else known.scaled(Elements(elastic).deflect_by_length, a),
    )


def shown_factors(elastic: ElasticMechanism) -> dict[str, float]:
    """Radians of what tables for people hold, by coordinate; empty where they hold radians."""
    if elastic.units.shown_angle != "deg":
        return {}
    return {c.name: np.pi / 180.0 for c in elastic.mechanism.coordinates if not c.is_length}


def shown(elastic: ElasticMechanism, q: Array) -> Array:
    """Coordinates (..., n) as tables for people have them, under `names_with_units`."""
    factors = shown_factors(elastic)
    return q / np.array([factors.get(name, 1.0) for name in elastic.names]) if factors else q


def _moved(T: Array, a: float) -> Array:
    scaled = np.array(T, float)
    scaled[..., :3, 3] *= a
    return scaled


def _mechanism(mechanism: Mechanism, a: float, units: Units) -> Mechanism:
    if isinstance(mechanism, Chain):
        return _chain(mechanism, a, units)
    if isinstance(mechanism, Platform):
        return _platform(mechanism, a, units)
    raise InputError("is not converted to other units", where="--units", got=mechanism.kind)


def _chain(chain: Chain, a: float, units: Units) -> Chain:
    other = copy(chain)
    vars(other).pop("ties", None)
    other.units = units
    other.tree = _tree(chain.tree, a)
    other.coordinates = other.tree.coordinates
    other.body = FixedFrame(chain.body.joint, _moved(chain.body.T_j_f, a))
    other.base_pose = _moved(chain.base_pose, a)
    other.frame_offset = _moved(chain.frame_offset, a)
    other.legs = tuple(leg.scaled(a) for leg in chain.legs)
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
        mimic, offset = mimic * sizes[:, None] / own, np.asarray(tree.offset, float) * sizes
    coordinates: list[Coordinate] = [
        replace(c, lower=c.lower * s, upper=c.upper * s)
        for c, s in zip(tree.coordinates, own.tolist(), strict=True)
    ]
    frames = {name: FixedFrame(p.joint, _moved(p.T_j_f, a)) for name, p in tree.frames.items()}
    return KinematicTree(model, tuple(coordinates), frames, mimic, offset)


def _platform(platform: Platform, a: float, units: Units) -> Platform:
    other = copy(platform)
    other.units = units
    for name in ("anchors", "points", "points_P", "mass_centre"):
        setattr(other, name, getattr(platform, name) * a)
    other.T_P_M = other.frame_offset = _moved(platform.T_P_M, a)
    other.body_inertia = platform.body_inertia * np.outer(*(np.repeat([a, 1.0], 3),) * 2)
    other.limits = None if platform.limits is None else platform.limits * a
    if platform.leg_limits is not None:
        other.leg_limits = platform.leg_limits.in_units(a)
    other.length = platform.length * a
    if platform.struts is not None:
        s = platform.struts
        other.struts = replace(
            s, fixed_com=s.fixed_com * a, moving_com=s.moving_com * a, radius=s.radius * a
        )
    other._close()
    return other


def _law(law: SpringLaw, size: float, effort: float) -> SpringLaw:
    if isinstance(law, PolynomialLaw):
        return PolynomialLaw(
            tuple(c * effort / size**k for k, c in enumerate(law.coefficients, start=1))
        )
    if isinstance(law, TabulatedLaw):
        return TabulatedLaw(
            tuple(x * size for x in law.deflections), tuple(t * effort for t in law.torques)
        )
    raise InputError(
        "a spring's law is not converted to other units", where="--units", got=type(law).__name__
    )


def _joints(springs: JointSprings, sizes: Array, efforts: Array) -> JointSprings:
    laws = {j: _law(law, float(sizes[j]), float(efforts[j])) for j, law in springs.laws.items()}
    return replace(
        springs, stiffness=springs.stiffness * efforts / sizes, rest=springs.rest * sizes, laws=laws
    )


def _potential(potential: Potential, a: float, sizes: Array, efforts: Array) -> Potential:
    if isinstance(potential, LineSprings):
        return potential.scaled(a)
    if isinstance(potential, CoupledSprings):
        at = potential.indices
        return replace(potential, matrix=potential.matrix * efforts[at][:, None] / sizes[at])
    if isinstance(potential, Beam):
        s = potential.section
        section = Section(
            s.axial, s.torsion * a * a, (s.bending[0] * a * a, s.bending[1] * a * a), s.shear
        )
        return replace(potential, length=potential.length * a, section=section)
    if a == 1.0:
        return potential
    raise InputError(
        "is not converted to other units", where="--units", got=type(potential).__name__
    )
