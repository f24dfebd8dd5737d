"""One assembly mode: where it is, how stiff, whether it is stable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cartstiff import numerics
from cartstiff.errors import UndefinedError
from cartstiff.geometry.se3 import Array
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note
from cartstiff.stiffness.compute import PostureStiffness
from cartstiff.vibration.modes import modes


@dataclass(frozen=True, eq=False, repr=False)
class AssemblyMode(ShownInLines):
    """One pose in which the actuator positions hold the mechanism.

    Attributes
    ----------
    result : PostureStiffness
        What `cartstiff.analyse` finds there; ``result.q`` and ``result.pose`` say where it is.
    residual : float
        Largest difference from the lengths wanted, or gap of the closures.
    multiplicity : int
        1; more at a singular pose in which several solutions meet, and which is known to a root
        of the digits.
    more_notes : tuple of Note
        Beside those of the result: that struts with flexures are not at rest here.
    """

    result: PostureStiffness
    residual: float
    multiplicity: int = 1
    more_notes: tuple[Note, ...] = ()

    def _lines(self) -> list[str]:
        return [
            f"AssemblyMode at q = {np.array2string(self.q, precision=5)}",
            f"  smallest eigenvalue {self.eigenvalue}, stable {self.stable}",
        ]

    @property
    def notes(self) -> tuple[Note, ...]:
        """All that must be known of this mode."""
        return (*self.more_notes, *self.result.notes)

    @property
    def q(self) -> Array:
        """Coordinates (n,); of a platform x, y, z, roll, pitch, yaw."""
        return self.result.q

    @property
    def pose(self) -> Array:
        """``T_F_M`` (4, 4)."""
        return self.result.pose

    @cached_property
    def eigenvalue(self) -> float | None:
        """Smallest eigenvalue of the tangent stiffness, force per length.

        Symmetric part; angles times the characteristic length. None where no K exists.
        """
        K = self.result.tangent
        if K is None:
            return None
        scale = np.repeat([1.0 / self.result.posture.length, 1.0], 3)
        scaled = 0.5 * (K + K.T) * np.outer(scale, scale)
        return float(numerics.eigenvalues(scaled)[0])

    @cached_property
    def stable(self) -> bool | None:
        """Whether every motion meets a restoring force; None where that is not decided.

        That is at singular poses, and where neither stiffness nor compliance exists.
        """
        undecided = {"type-2-singularity", "singular-stiffness", "struts-not-in-equilibrium"}
        if self.multiplicity > 1 or undecided & {note.code for note in self.notes}:
            return None
        if self.eigenvalue is not None:
            return self.eigenvalue > 0.0
        C = self.result.tangent_compliance  # of what has fewer than six free motions
        if C is None:
            return None
        scale = np.repeat([self.result.posture.length, 1.0], 3)
        values = numerics.eigenvalues(0.5 * (C + C.T) * np.outer(scale, scale))
        return bool(values[0] >= -numerics.ZERO * max(values[-1], 0.0))

    @cached_property
    def determinant(self) -> float | None:
        """Of the six legs' lines, moments over the characteristic length; None of chains.

        Its sign is that of the region between singularities.
        """
        lines = self.result.posture.actuation
        if not self.result.posture.coordinates_are_pose or lines is None or len(lines) != 6:
            return None
        return float(np.linalg.det(lines / np.repeat([self.result.posture.length, 1.0], 3)))

    @cached_property
    def frequencies(self) -> Array | None:
        """Natural frequencies [Hz] in this pose; None without masses or where there are none."""
        elastic = self.result.elastic
        if not sum(elastic.masses.values()) > 0.0:
            return None
        try:
            return modes(self.result).frequencies
        except UndefinedError:
            return None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        frequencies = self.frequencies
        return {
            "q": self.q.tolist(),
            "pose": self.pose.tolist(),
            "residual": self.residual,
            "multiplicity": self.multiplicity,
            "smallest_eigenvalue": self.eigenvalue,
            "stable": self.stable,
            "determinant": self.determinant,
            "frequencies": None
            if frequencies is None
            else [float(f) if np.isfinite(f) else None for f in frequencies],
            "notes": [note.as_dict() for note in self._own_notes],
        }

    @cached_property
    def _own_notes(self) -> list[Note]:
        """Those that are not of loading."""
        general = {note.code for note in self.result.elastic.notes}
        return [note for note in self.notes if note.code not in general]
