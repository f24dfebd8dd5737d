r"""Joint and leg limits as contacts: quantities that must stay between two bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.contract import Mechanism, MechanismPosture
from cartstiff.mechanisms.platform import Platform, PlatformPosture
from cartstiff.potentials.contract import Map
from cartstiff.potentials.line_springs import second_derivative

__all__ = ["Contact", "Limits"]


class Contact(NamedTuple):
    """A limit that is touched: which quantity, and on which side (-1 lower, +1 upper)."""

    quantity: int
    side: int


class Limits:
    """The limits of a mechanism: of its coordinates, or of a platform's leg lengths.

    Parameters
    ----------
    mechanism : Mechanism
        Its infinite limits are left out.
    ignore : bool
        Leave all limits out.

    Attributes
    ----------
    names : tuple of str
        What is limited.
    lower, upper : ndarray (m,)
        Bounds, in rad or length units.
    """

    def __init__(self, mechanism: Mechanism, ignore: bool = False) -> None:
        self._points: Array | None = None  # a platform's legs are limited, not its pose
        if isinstance(mechanism, Platform):
            self._points = mechanism.points
            bounds = mechanism.limits
            pairs = np.empty((0, 2)) if bounds is None else np.asarray(bounds, float)
            names = [f"leg{s + 1}" for s in range(len(pairs))]
        else:
            pairs = np.array([(c.lower, c.upper) for c in mechanism.coordinates], float)
            names = list(mechanism.names)
        finite = np.isfinite(pairs).any(axis=1)
        self._columns = np.flatnonzero(finite & (not ignore))
        self.names = tuple(names[j] for j in self._columns)
        self.lower = pairs[self._columns, 0]
        self.upper = pairs[self._columns, 1]

    def __len__(self) -> int:
        return len(self.names)

    def values(self, posture: MechanismPosture) -> Array:
        """The limited quantities (m,)."""
        if isinstance(posture, PlatformPosture):
            return posture.lines.lengths[self._columns]
        return posture.q[self._columns]

    def sizes(self, posture: MechanismPosture) -> Array:
        """Natural sizes of the limited quantities."""
        if self._points is not None:
            return np.full(len(self), posture.length)
        return posture.coordinate_lengths[self._columns]

    def bound(self, contact: Contact) -> float:
        """The bound that is touched."""
        return float((self.lower if contact.side < 0 else self.upper)[contact.quantity])

    def constraint(
        self, posture: MechanismPosture, contacts: Sequence[Contact]
    ) -> tuple[Array, Map]:
        """Distances (k,) from the touched bounds, and their map of the coordinates."""
        where = [c.quantity for c in contacts]
        residual = self.values(posture)[where] - np.array([self.bound(c) for c in contacts])
        columns = self._columns[where]
        if isinstance(posture, PlatformPosture) and self._points is not None:
            lines, points = posture.lines, self._points

            def curvature(multipliers: Array) -> Array:
                weights = np.zeros(len(points))
                np.add.at(weights, columns, multipliers)
                return second_derivative(lines, points, weights)

            return residual, Map(lines.lines[columns], curvature)
        n = posture.motion.jacobian.shape[1]
        rows = np.zeros((len(where), n))
        rows[np.arange(len(where)), columns] = 1.0
        return residual, Map(rows, lambda _: np.zeros((n, n)))
