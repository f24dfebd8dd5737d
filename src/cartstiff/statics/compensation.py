"""Commands along a path as a value, with the errors before and after compensation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cartstiff.arrays import csv_text
from cartstiff.geometry.se3 import Array
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.other_units import shown
from cartstiff.mechanisms.weighed import Weighed
from cartstiff.notes import Note
from cartstiff.statics.held import shown_displacements
from cartstiff.stiffness.compute import SCHEMA


@dataclass(frozen=True, eq=False)
class CompensatedPath:
    """Commands along a path, and the errors without and with them.

    Attributes
    ----------
    poses : ndarray (m, 4, 4)
        ``T_F_M`` wanted.
    q : ndarray (m, n)
        Postures that have these poses.
    commands : ndarray (m, k)
        Rest positions to command, in spring order (joints; legs of a platform).
    naive : ndarray (m, k)
        Rest positions without compensation: those at which the mechanism is at rest at the posture
        without the loads, as for `equilibrium`; of springs whose rest position the file gives,
        those at which they carry nothing.
    before, after : ndarray (m, 6)
        Error of the loaded end-effector, rotation vector and translation in axes of F, with the
        naive and with the compensated commands; NaN where no equilibrium was found.
    deviation : ndarray (m, 6) or None
        Standard deviation of `after` that measured springs leave; None without such.
    stable : tuple of bool or None
        Whether the compensated equilibrium is stable.
    weighed : Weighed
        What gravity acts on, and payloads among the loads of the first point.
    notes : tuple of Note
        Commands beyond limits, points without an equilibrium or with an unstable one.
    """

    elastic: ElasticMechanism
    poses: Array
    q: Array
    commands: Array
    naive: Array
    before: Array
    after: Array
    deviation: Array | None
    stable: tuple[bool | None, ...]
    weighed: Weighed
    notes: tuple[Note, ...]

    @property
    def offsets(self) -> Array:
        """Change of the command by the compensation, (m, k)."""
        return self.commands - self.naive

    def summary(self) -> dict[str, dict[str, float]]:
        """Largest and root-mean-square errors, in rad and length units, before and after."""
        report = {}
        for name, errors in (("before", self.before), ("after", self.after)):
            turned = np.linalg.norm(errors[:, :3], axis=1)
            moved = np.linalg.norm(errors[:, 3:], axis=1)
            known = ~np.isnan(moved)
            report[name] = {
                "points": float(known.sum()),
                "rotation_max": float(turned[known].max(initial=0.0)),
                "rotation_rms": float(np.sqrt(np.mean(turned[known] ** 2))) if known.any() else 0.0,
                "translation_max": float(moved[known].max(initial=0.0)),
                "translation_rms": float(np.sqrt(np.mean(moved[known] ** 2)))
                if known.any()
                else 0.0,
            }
        return report

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""

        def rows(errors: Array) -> list[list[float] | None]:
            return [None if np.isnan(e).any() else e.tolist() for e in errors]

        return {
            "schema": SCHEMA,
            "units": self.elastic.units.as_dict(),
            **self.weighed.as_dict(),
            "springs": list(self.elastic.spring_names),
            "poses": self.poses.tolist(),
            "q": self.q.tolist(),
            "commands": self.commands.tolist(),
            "error_before": rows(self.before),
            "error_after": rows(self.after),
            "error_after_sd": None if self.deviation is None else rows(self.deviation),
            "stable": list(self.stable),
            "summary": self.summary(),
            "notes": [note.as_dict() for note in self.notes],
        }

    def as_csv(self) -> str:
        """Commands, errors and the postures that are wanted, one line a point."""
        elastic, commands = self.elastic, self.commands
        heads = [f"{name} [{elastic.units.length}]" for name in elastic.spring_names]
        if elastic.spring_names == elastic.names:
            heads, commands = elastic.names_with_units, shown(elastic, commands)
        names, columns = [f"command_{name}" for name in heads], [commands]
        for when, values in (("before_", self.before), ("after_", self.after)):
            heads, values = shown_displacements(elastic.units, values, when)
            names, columns = [*names, *heads], [*columns, values]
        names, columns = [*names, *elastic.names_with_units], [*columns, shown(elastic, self.q)]
        if self.deviation is not None:
            heads, values = shown_displacements(elastic.units, self.deviation, "after_sd_")
            names, columns = [*names, *heads], [*columns, values]
        return csv_text(np.column_stack(columns), names)
