"""A load-deflection curve as a value: points, stability, critical loads, linear prediction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from cartstiff import numerics
from cartstiff.arrays import Result, csv_text
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.limits import Limits
from cartstiff.mechanisms.other_units import shown
from cartstiff.mechanisms.weighed import Weighed, weights_of
from cartstiff.notes import Note
from cartstiff.statics.critical import CriticalPoint
from cartstiff.statics.held import shown_displacements
from cartstiff.statics.load_path import LoadPath
from cartstiff.stiffness.compute import SCHEMA

#: Why a curve ends.
Reason = Literal["factor-reached", "factor-left", "points-reached", "limit-contact", "lost"]


@dataclass(frozen=True, eq=False)
class LoadCurve(Result):
    """Equilibria along a growing (and perhaps falling) load.

    Attributes
    ----------
    factors : ndarray (m,)
        Load factors p.
    q : ndarray (m, n)
        Coordinates.
    displacement : ndarray (m, 6)
        From the unloaded pose: rotation vector and translation, axes of F.
    linear : ndarray (m, 6)
        What the compliance at the start predicts; NaN if there is none.
    eigenvalue : ndarray (m,)
        Smallest eigenvalue of H_N; NaN without an energy, where it depends on the coordinates.
    stable : tuple of bool or None
        Whether H_N is positive definite; None at a zero eigenvalue. Without an energy False where
        vibrations grow, else None.
    critical : tuple of CriticalPoint
        In the order in which the curve meets them.
    reason : str
        "factor-reached"; "factor-left": the load fell below what was asked for; "points-reached";
        "limit-contact": a joint limit was met; "lost": no next point was found.
    notes : tuple of Note
        What was assumed.
    """

    elastic: ElasticMechanism
    factors: Array
    q: Array
    displacement: Array
    linear: Array
    eigenvalue: Array
    stable: tuple[bool | None, ...]
    critical: tuple[CriticalPoint, ...]
    reason: Reason
    notes: tuple[Note, ...]
    _path: LoadPath
    _limits: Limits
    _origin: Array
    _rate: Array
    _goal: float
    _back: float
    _resolution: float

    @property
    def weighed(self) -> Weighed:
        """What gravity acts on, and payloads among the loads (at factor 1)."""
        return weights_of(self.elastic, (*self._path.system.loads, *self._path.loads))

    @cached_property
    def deviation(self) -> Array:
        """Distance of the linear prediction from the curve over the displacement, (m, 2).

        The first column is that of the rotation vectors, the second that of the translations: they
        are never added. 0 where nothing moves.
        """
        length = self.elastic.mechanism.at(self.q[0]).length
        columns = []
        for part, smallest in (
            (slice(0, 3), numerics.BLANK),
            (slice(3, 6), numerics.BLANK * length),
        ):
            off = np.linalg.norm((self.linear - self.displacement)[:, part], axis=1)
            size = np.linalg.norm(self.displacement[:, part], axis=1)
            columns.append(np.divide(off, size, out=np.zeros(len(off)), where=size > smallest))
        return np.column_stack(columns)

    def linear_up_to(
        self, tolerance: float = 0.05, part: Literal["rotation", "translation"] = "translation"
    ) -> float:
        """Factor up to which the linear prediction of a part stays within a relative deviation."""
        off = self.deviation[:, 0 if part == "rotation" else 1]
        factors = np.abs(self.factors)
        bad = np.flatnonzero(~(off <= tolerance))
        if bad.size == 0:
            return float(factors.max())
        i = int(bad[0])
        if i == 0 or np.isnan(off[i]):
            return 0.0
        share = (tolerance - off[i - 1]) / (off[i] - off[i - 1])
        return float(factors[i - 1] + share * (factors[i] - factors[i - 1]))

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "schema": SCHEMA,
            "units": self.elastic.units.as_dict(),
            "joints": list(self.elastic.names),
            **self.weighed.as_dict(),
            "factor": self.factors.tolist(),
            "q": self.q.tolist(),
            "displacement": self.displacement.tolist(),
            "linear": [None if np.isnan(row).any() else row.tolist() for row in self.linear],
            "eigenvalue": [None if np.isnan(x) else x for x in self.eigenvalue.tolist()],
            "stable": list(self.stable),
            "critical": [
                {
                    "factor": c.factor,
                    "kind": c.kind,
                    "q": c.q.tolist(),
                    "mode": c.mode.tolist(),
                    "frequency": c.frequency,
                }
                for c in self.critical
            ],
            "reason": self.reason,
            "notes": [note.as_dict() for note in self.notes],
        }

    def as_csv(self) -> str:
        """Factor, coordinates, displacement, linear prediction, eigenvalue: one line a point."""
        heads, moved = shown_displacements(self.elastic.units, self.displacement, "")
        linear_heads, linear = shown_displacements(self.elastic.units, self.linear, "linear_")
        names = ["factor", *self.elastic.names_with_units, *heads, *linear_heads, "eigenvalue"]
        q = shown(self.elastic, self.q)
        return csv_text(np.column_stack([self.factors, q, moved, linear, self.eigenvalue]), names)
