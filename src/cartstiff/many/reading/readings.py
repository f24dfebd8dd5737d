"""What is read at every posture, and what it refers to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from cartstiff.geometry.se3 import Array
from cartstiff.many.reading.vibration_arithmetic import frequency_name
from cartstiff.stiffness.applied_load import LoadKind

#: Readings that need the masses.
FREQUENCIES = frozenset(map(frequency_name, range(6)))


@dataclass(frozen=True)
class Readings:
    """Numbers to read at every posture, and what they refer to; a key.

    Attributes
    ----------
    names : tuple of str
        Of `cartstiff.many.reading.reading_arithmetic.READINGS`.
    connection : {"A", "B", "K", "F", "load"}
        The matrix that is read.
    length : float
        Characteristic length.
    direction : tuple of float, optional
        Direction of stiffness along and about it.
    deflect : tuple of float, optional
        Wrench whose deflection is asked for; None for the posture's own.
    deflect_at : tuple of float
        Where it acts, in M.
    world : bool
        Whether both are in the axes of F.
    load : LoadKind
        What the load does while the body moves.
    hertz : float
        Frequency whose square goes with a stiffness of 1 over a mass of 1 in the mechanism's units.
    """

    names: tuple[str, ...]
    connection: str = "B"
    length: float = 1.0
    direction: tuple[float, ...] | None = None
    deflect: tuple[float, ...] | None = None
    deflect_at: tuple[float, ...] = (0.0, 0.0, 0.0)
    world: bool = False
    load: LoadKind = field(default_factory=LoadKind)
    hertz: float = 0.5 / math.pi

    @property
    def needs(self) -> tuple[str, ...]:
        """Outputs that are read."""
        own = {"B", self.connection} - {"load"}
        names = [f"{kind}_{c}" for c in sorted(own) for kind in ("stiffness", "compliance")]
        if not FREQUENCIES.isdisjoint(self.names):
            names += ["kinetic", "lagrangian", "motion"]
        return (*names, "stiffness_A", "pose", "jacobian", "wrench", "energy")

    def exist_beside(self, arrays: Mapping[str, Array]) -> bool:
        """Whether a mechanism has all that is read."""
        of_jacobian = not {"singular_value_ratio", "manipulability"}.isdisjoint(self.names)
        return all(name in arrays for name in self.needs if name != "jacobian" or of_jacobian)
