"""A mill: its teeth, its immersion and its linear law of force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import checked_number, checked_unit, checked_vector
from cartstiff.errors import InputError
from cartstiff.geometry.se3 import Array

#: Decimals of pi as people type it.
_DIGITS = 4


@dataclass(frozen=True)
class Milling:
    """A cutter and its force law.

    Attributes
    ----------
    tangential : float
        K_t, force per area.
    radial : float
        K_r: radial over tangential force.
    teeth : int
        N.
    entry, exit : float
        Angles [rad] at which a tooth enters and leaves, from the normal in the direction of the
        cutter's turn, ``0 <= entry < exit <= pi``. Half immersion: 0 to pi/2 up-milling, pi/2 to pi
        down-milling; a slot: 0 to pi, which may be typed as 3.1416.
    feed, normal : tuple of float
        Directions of the feed and of the normal to it, in M; at right angles.
    at : tuple of float
        The tool's tip, in M.

    Raises
    ------
    InputError
        For numbers that cannot be used.
    """

    tangential: float
    radial: float
    teeth: int
    entry: float
    exit: float
    feed: tuple[float, float, float] = (1.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 1.0, 0.0)
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not checked_number(self.tangential, "cutting coefficient") > 0.0:
            raise InputError(
                "cutting coefficient cannot be used", expected="above zero", got=self.tangential
            )
        checked_number(self.radial, "radial coefficient")
        if not (self.teeth == int(self.teeth) and self.teeth >= 1):
            raise InputError(
                "number of teeth cannot be used", expected="a whole number from 1", got=self.teeth
            )
        if np.pi < self.exit <= round(np.pi, _DIGITS):
            object.__setattr__(self, "exit", np.pi)
        if not 0.0 <= self.entry < self.exit <= np.pi:
            raise InputError(
                "immersion cannot be used",
                expected="0 <= entry < exit <= pi",
                got=[self.entry, self.exit],
            )
        u, v = checked_unit(self.feed, "feed"), checked_unit(self.normal, "normal")
        if abs(u @ v) > numerics.NEARBY:
            raise InputError("feed and normal are not at right angles", got=float(u @ v))
        checked_vector(self.at, 3, "tool's tip")

    @property
    def directions(self) -> Array:
        """Feed and normal as rows (2, 3)."""
        return np.stack([checked_unit(self.feed), checked_unit(self.normal)])

    @property
    def mean(self) -> Array:
        """Alpha (2, 2), which ``N / (2 pi)`` makes the mean of A."""
        r = self.radial

        def at(p: float) -> Array:
            s, c = np.sin(2 * p), np.cos(2 * p)
            return 0.5 * np.array(
                [
                    [c - 2 * r * p + r * s, -s - 2 * p + r * c],
                    [-s + 2 * p + r * c, -c - 2 * r * p - r * s],
                ]
            )

        return at(self.exit) - at(self.entry)
