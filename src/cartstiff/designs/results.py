"""The designs of a study: the feasible ones, the best, the Pareto front, as tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cartstiff.arrays import csv_rows
from cartstiff.designs.evaluation import Design
from cartstiff.designs.study import Study
from cartstiff.errors import InputError, UndefinedError, UnknownNameError
from cartstiff.geometry.se3 import Array
from cartstiff.lazily import cached_property
from cartstiff.mechanisms.weighed import Weighed
from cartstiff.notebook import ShownInLines
from cartstiff.notes import Note

#: Name and version of the form of the JSON output.
DESIGN_SCHEMA = "cartstiff-design/1"


@dataclass(frozen=True, repr=False)
class Designs(ShownInLines):
    """What became of a study.

    Attributes
    ----------
    study : Study
        What was asked.
    mechanism : str
        Its name.
    designs : tuple of Design
        In the order in which they were chosen.
    better : mapping of str to str
        "largest" or "smallest" for each objective.
    units : mapping of str to str
        Of objectives and constraints.
    damaged : int
        Lines of the output that could not be read again.
    weighed : Weighed
        What weighs in the mechanism with its file's own parameters.
    """

    study: Study
    mechanism: str
    designs: tuple[Design, ...]
    better: Mapping[str, str]
    units: Mapping[str, str]
    damaged: int = 0
    weighed: Weighed = field(default_factory=lambda: Weighed(None, {}, (), 0.0, 0.0, "N"))

    def _lines(self) -> list[str]:
        counts = ", ".join(f"{n} {state}" for state, n in self.counts().items())
        return [
            f"{len(self.designs)} designs of {self.mechanism}: {counts}",
            f"  Pareto front of {', '.join(self.better)}: {len(self.front)}",
        ]

    def __len__(self) -> int:
        return len(self.designs)

    def counts(self) -> dict[str, int]:
        """How many designs are in each state."""
        counted = Counter(design.state for design in self.designs)
        return {state: counted[state] for state in ("feasible", "infeasible", "failed")}

    @cached_property
    def feasible(self) -> tuple[int, ...]:
        """Indices of the designs that keep all constraints."""
        return tuple(i for i, d in enumerate(self.designs) if d.state == "feasible")

    def table(self, name: str) -> Array:
        """One column (N,) over all designs: a variable, objective or constraint; NaN if failed.

        Raises
        ------
        UnknownNameError
            For another name.
        """
        if name in self.study.variables:
            return np.array([design.parameters[name] for design in self.designs])
        if name not in self.study.measures:
            raise UnknownNameError("column", name, [*self.study.variables, *self.study.measures])
        return np.array([design.values.get(name, np.nan) for design in self.designs])

    @cached_property
    def front(self) -> tuple[int, ...]:
        """Indices of the feasible designs than which none is better in everything, best first.

        One is left out if another is as good in every objective and better in one.
        """
        rows = np.array(self.feasible, int)
        if not len(rows):
            return ()
        signs = np.array([1.0 if b == "smallest" else -1.0 for b in self.better.values()])
        cost = np.column_stack([self.table(name)[rows] for name in self.better]) * signs
        order = np.lexsort(cost.T[::-1])
        kept: list[int] = []
        for i in order.tolist():  # who comes later is not better than all before in the first
            front = cost[kept]
            if not np.any((front <= cost[i]).all(axis=1) & (front < cost[i]).any(axis=1)):
                kept.append(i)
        return tuple(rows[kept].tolist())

    def best(self, name: str | None = None) -> Design:
        """The feasible design with the best value of an objective; without a name the only one.

        Raises
        ------
        UndefinedError
            If no design is feasible.
        InputError
            If there are several objectives and none is named.
        """
        if name is None:
            if len(self.better) > 1:
                raise InputError("several objectives", expected=f"one of {', '.join(self.better)}")
            (name,) = self.better
        if name not in self.better:
            raise UnknownNameError("objective", name, self.better)
        if not self.feasible:
            raise UndefinedError(
                "no design is feasible", code="no-feasible-design", values={**self.counts()}
            )
        values = self.table(name)[list(self.feasible)]
        which = values.argmin() if self.better[name] == "smallest" else values.argmax()
        return self.designs[self.feasible[int(which)]]

    def to_csv(self) -> str:
        """A row a design: its number from 1, variables, values, state, whether on the front."""
        names = [f"{n} [{self.units[n]}]" if self.units[n] else n for n in self.study.measures]
        head = ["design", *self.study.variables, *names, "state", "front", "reason"]
        rows, front = [], set(self.front)
        for i, design in enumerate(self.designs):
            values = [design.values.get(name) for name in self.study.measures]
            rows.append(
                [
                    i + 1,
                    *design.parameters.values(),
                    *values,
                    design.state,
                    "yes" if i in front else "no",
                    design.reason,
                ]
            )
        return csv_rows(head, rows)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        study = self.study
        return {
            "schema": DESIGN_SCHEMA,
            "mechanism": self.mechanism,
            "method": study.method.kind,
            "variables": list(study.variables),
            "set": dict(study.set),
            "poses": study.poses.count,
            **self.weighed.as_dict(),
            "objectives": [
                {
                    "name": name,
                    "of": m.words,
                    "case": m.case,
                    "goal": self.better[name],
                    "unit": self.units[name],
                }
                for name, m in study.objectives.items()
            ],
            "constraints": [
                {
                    "name": name,
                    "of": m.words,
                    "case": m.case,
                    "at_least": m.at_least,
                    "at_most": m.at_most,
                    "unit": self.units[name],
                }
                for name, m in study.constraints.items()
            ],
            "counts": self.counts(),
            "best": {name: self.designs.index(self.best(name)) for name in self.better}
            if self.feasible
            else None,
            "front": list(self.front),
            "designs": [design.as_dict() for design in self.designs],
            "notes": [note.as_dict() for note in self.notes],
        }

    @property
    def notes(self) -> list[Note]:
        """What was assumed, and what is damaged."""
        notes = []
        lengths = [
            name
            for name, m in self.study.measures.items()
            if m.quantity in ("condition", "isotropy", "minimum")
            and self.study.case(self.study.case_of(m)).length is None
        ]
        if lengths:
            words = (
                f"{', '.join(lengths)}: every design at its own natural length; `length` of a case "
                "sets one for all"
            )
            notes.append(Note("own-length", words, {"measures": lengths}))
        if not self.feasible:
            notes.append(Note("no-feasible-design", "no design is feasible", {**self.counts()}))
        if self.damaged:
            words = f"{self.damaged} damaged line(s) of the output: those designs were made again"
            notes.append(Note("damaged-lines", words, {"lines": self.damaged}))
        return notes
