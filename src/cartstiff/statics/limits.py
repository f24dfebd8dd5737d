r"""Limits as contacts: constraints that join where a bound is met."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import MechanismPosture
from cartstiff.mechanisms.limits import Limits
from cartstiff.mechanisms.platform import PlatformPosture
from cartstiff.potentials.contract import Map
from cartstiff.potentials.line_springs import second_derivative


class Contact(NamedTuple):
    """A limit that is touched: which quantity, and on which side (-1 lower, +1 upper)."""

    quantity: int
    side: int


def sizes(limits: Limits, posture: MechanismPosture) -> Array:
    """Natural sizes (m,) of the limited quantities."""
    if limits.legs is not None:
        return np.full(len(limits), posture.length)
    return posture.coordinate_lengths[limits.columns]


def bound(limits: Limits, contact: Contact) -> float:
    """The bound that is touched."""
    return float((limits.lower if contact.side < 0 else limits.upper)[contact.quantity])


def constraint(
    limits: Limits, posture: MechanismPosture, contacts: Sequence[Contact]
) -> tuple[Array, Map]:
    """Distances (k,) from the touched bounds, and their map of the coordinates."""
    where = [c.quantity for c in contacts]
    values = limits.values(posture.q, posture.pose)[where]
    residual = values - np.array([bound(limits, c) for c in contacts])
    columns = limits.columns[where]
    if isinstance(posture, PlatformPosture) and limits.legs is not None:
        lines, points = posture.lines, limits.legs.points

        def curvature(multipliers: Array) -> Array:
            weights = np.zeros(len(points))
            np.add.at(weights, columns, multipliers)
            return second_derivative(lines, points, weights)

        return residual, Map(lines.lines[columns], curvature)
    n = posture.motion.jacobian.shape[1]
    rows = np.zeros((len(where), n))
    rows[np.arange(len(where)), columns] = 1.0
    return residual, Map(rows, lambda _: np.zeros((n, n)))
