"""Which mechanisms' masses recorded arithmetic knows, so that it finds their vibrations."""

from __future__ import annotations

from dataclasses import replace

from cartstiff.many.chains.chain_numbers import ChainCase
from cartstiff.many.chains.chain_twists import numbers
from cartstiff.many.chains.masses import Bodies
from cartstiff.many.leg_masses import LegMasses
from cartstiff.many.platform_arithmetic import PlatformCase
from cartstiff.many.reading.eigenvalues import LARGEST
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.platform import Platform
from cartstiff.potentials.loads import DeadForce, Scaled

_Case = ChainCase | PlatformCase


def with_masses(elastic: ElasticMechanism, case: _Case) -> _Case | None:
    """The case with all masses; None where some are not on the tape, or there are none."""
    if any(
        isinstance(p, Scaled) or (isinstance(p, DeadForce) and p.mass) for p in elastic.potentials
    ):
        return None
    mechanism = elastic.mechanism
    if isinstance(mechanism, Platform) and isinstance(case, PlatformCase):
        legs = None if mechanism.struts is None else LegMasses.of(mechanism.struts)
        if legs is None and not mechanism.body_inertia.any():
            return None
        return replace(case, inertia=numbers(mechanism.body_inertia), legs=legs)
    if isinstance(mechanism, Chain) and isinstance(case, ChainCase):
        is_whole = len(case.constants.screws) == 6 * mechanism.tree.model.nv
        if not (is_whole and mechanism.tree.masses()[0].any()):
            return None
        return replace(case, bodies=Bodies.of(mechanism.tree))
    return None


def frequencies_of(case: _Case) -> int:
    """How many of the lowest frequencies are found: all, or the first of many motions."""
    motions = case.freedoms if isinstance(case, ChainCase) else 6
    return motions if motions <= LARGEST else 1
