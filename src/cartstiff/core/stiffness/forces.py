r"""What joints, legs and lines carry at a posture, and what their drives can carry.

With the springs' forces t, which balance everything else that acts along their
deflections (`cartstiff.core.stiffness.balance`, equation (1)), the drive of a joint
exerts the torque ``-t`` on the link that it moves, positive about the joint's axis; of a
leg or a line t is the tension. A drive moves a coordinate: joints that follow it by a
gear, a mimic or a coupling add to its torque by their factors. A rigid joint has no
spring: its torque is the multiplier of its constraint.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import compress
from typing import Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.arrays import Array, plain
from cartstiff.core.mechanisms.contract import MechanismPosture
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.mechanisms.limits import note_beyond
from cartstiff.core.notes import Note


class DriveForce(NamedTuple):
    """The force that a drive carries, and its limits.

    Attributes
    ----------
    name : str
        Of the joint, the leg, the line or the coupling.
    is_length : bool
        Whether it is a force, else a torque.
    force : float
        Of a joint on the link that it moves, along its axis; else the tension. NaN if
        unknown.
    least, most : float
        Its limits; infinite where none is known.
    """

    name: str
    is_length: bool
    force: float
    least: float = -np.inf
    most: float = np.inf

    @property
    def called(self) -> str:
        """With what it is, as a limit's note calls it."""
        return f"{('torque', 'force')[self.is_length]} of {self.name}"

    @property
    def margin(self) -> float:
        """Distance to the nearest limit, below zero beyond; infinite without limits."""
        return min(self.force - self.least, self.most - self.force)

    @property
    def used(self) -> float:
        """Share of its limit that is used, 1 at a limit; NaN without limits."""
        return float(used_shares(np.array(self.force), self.least, self.most))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; None for what is infinite or unknown."""
        own = {**self._asdict(), "margin": self.margin, "used": self.used}
        return {key: plain(x) if isinstance(x, float) else x for key, x in own.items()}


def used_shares(forces: Any, least: Any, most: Any) -> Any:
    """Shares of limits that forces (...) use: 0 without force, or, where the limits have
    one sign, in their middle; 1 at a limit; NaN without limits.
    """
    low, high = np.broadcast_arrays(least, most)
    with numerics.silent():
        # Limits of one sign, as of a cable with a least tension, have a middle.
        has_middle = np.isfinite(low + high) & ((low > 0.0) | (high < 0.0))
        middle = np.where(has_middle, 0.5 * (low + high), 0.0)
        x, low, high = forces - middle, low - middle, high - middle
        each = np.where(x > 0.0, x / high, np.where(x < 0.0, x / low, 0.0))
    return np.where(np.isfinite(low) | np.isfinite(high), each, np.nan)


def forces_of(
    elastic: ElasticMechanism,
    posture: MechanismPosture,
    rigid: Mapping[str, float] | None = None,
) -> tuple[DriveForce, ...]:
    """What each joint with a spring, each leg and line carries, the most loaded first.

    Parameters
    ----------
    elastic, posture
        The mechanism with its final rest positions, and its posture.
    rigid : mapping of str to float, optional
        Torques of the rigid joints on the links that they move.
    """
    sizes = dict(zip(elastic.names, posture.coordinate_lengths.tolist(), strict=True))
    is_length = {c.name: c.is_length for c in elastic.mechanism.coordinates}
    forces, noise = dict(rigid or {}), [0.0]
    share = numerics.PRINTED_AS_ZERO
    if posture.closure is not None:
        share = numerics.STALLED_RESIDUAL
    for name, slides, force, k in _springs(elastic, posture):
        forces[name] = -force if name in is_length else force
        is_length.setdefault(name, slides)
        noise.append(share * k * sizes.get(name, posture.length if slides else 1.0))
    largest = max((abs(x) for x in forces.values() if x == x), default=0.0)
    # Without a load, springs have what rounding leaves of their own sizes.
    least = largest if largest <= max(noise) else numerics.PRINTED_AS_ZERO * largest
    limits, none = elastic.force_limits, (-np.inf, np.inf)
    found = [
        DriveForce(n, is_length[n], 0.0 if abs(x) <= least else x, *limits.get(n, none))
        for n, x in forces.items()
    ]
    used = used_shares(*np.array([one[2:] for one in found]).reshape(-1, 3).T)
    order = np.argsort(-np.nan_to_num(used, nan=-1.0), kind="stable")
    return tuple(found[i] for i in order.tolist())


def may_be_beyond(elastic: ElasticMechanism, posture: MechanismPosture) -> bool:
    """Whether `forces_of` may be beyond limits: asked at every rest, where seldom one
    is.
    """
    limits, springs = elastic.force_limits, elastic.springs
    if not limits or springs is None or elastic.mechanism.rigid:
        return bool(limits)
    return not (np.abs(springs.pull(posture)) < elastic.held_either_way).all()


def _springs(
    elastic: ElasticMechanism, posture: MechanismPosture
) -> Iterator[tuple[str, bool, float, float]]:
    """Name, whether it slides, force and stiffness of each spring that is no link."""
    springs, coordinates = elastic.springs, elastic.mechanism.coordinates
    if springs is not None:
        numbers = springs.pull(posture).tolist(), springs.stiffness.tolist()
        rows = zip(elastic.spring_names, elastic.slides, *numbers, strict=True)
        yield from compress(rows, ~springs.is_passive)
    for term, names in elastic.labelled():
        parts = term.parts(posture, coordinates, names)
        if parts is not None and not parts.whole:
            numbers = parts.forces.tolist(), np.diag(parts.stiffness).tolist()
            yield from zip(parts.names, parts.slides, *numbers, strict=True)


def force_notes(forces: tuple[DriveForce, ...], elastic: ElasticMechanism) -> list[Note]:
    """Return a note on drives whose forces are beyond their limits."""
    largest = max((abs(one.force) for one in forces if one.force == one.force), default=0)
    beyond = [
        (
            one.called,
            one.force,
            elastic.units.effort(one.is_length),
            one.least,
            one.most,
        )
        for one in forces
        if one.margin < -numerics.LIMIT_SLACK * largest
    ]
    return [note_beyond("", beyond, code="force-limits")] if beyond else []


def rigid_torques(
    elastic: ElasticMechanism, posture: MechanismPosture, multipliers: Array
) -> dict[str, float]:
    """Torques of the rigid joints on the links that they move, from the forces of the
    constraints, in the order of the posture's residual.
    """
    names = [elastic.names[j] for j in sorted(elastic.mechanism.rigid)]
    if not names or posture.residual is None:
        return {}
    end = len(posture.residual)
    return dict(zip(names, (-multipliers[end - len(names) : end]).tolist(), strict=True))


def drive_limits(elastic: ElasticMechanism, names: Sequence[str]) -> tuple[Array, Array]:
    """Least and largest force (m,) of drives by name; cables cannot push."""
    limits, springs = elastic.force_limits, elastic.springs
    pairs = [limits.get(name, (-np.inf, np.inf)) for name in names]
    low, high = np.array(pairs, float).reshape(-1, 2).T
    cables = set[str]()
    if springs is not None:
        cables = {*compress(elastic.spring_names, springs.cables)}
    is_cable = np.array([name in cables for name in names], bool)
    return np.where(is_cable, np.maximum(low, 0.0), low), high
