"""What gravity acts on: said in one place for every report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cartstiff.mechanisms.contract import EARTH
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.notes import Note
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.loads import DeadForce


@dataclass(frozen=True)
class Weighed:
    """What was weighed.

    Attributes
    ----------
    acceleration : tuple of float or None
        Acceleration of the uniform field, in F; None without gravity.
    bodies : mapping of str to float
        Mass of what each joint carries [kg], by the name of the (first) link; the payload of the
        mechanism's file under "payload". Empty without gravity.
    massless : tuple of str
        Links that move and have no mass, if there is gravity.
    payload : float
        Mass [kg] of the payloads among the loads, which have a weight of their own,
    weight : float
        and this weight,
    unit : str
        in the mechanism's unit of force.
    """

    acceleration: tuple[float, ...] | None
    bodies: Mapping[str, float]
    massless: tuple[str, ...]
    payload: float
    weight: float
    unit: str

    def as_dict(self) -> dict[str, Any]:
        """For JSON: keys "gravity" and "weighed"."""
        parts = [{"name": name, "mass": mass} for name, mass in self.bodies.items()]
        if self.payload:
            parts.append({"name": "payload among the loads", "mass": self.payload})
        return {
            "gravity": None if self.acceleration is None else list(self.acceleration),
            "weighed": parts,
        }

    @property
    def text(self) -> str:
        """One line for people."""
        if self.acceleration is None:
            words = "Gravity: none"
        else:
            field = ", ".join(f"{a:g}" for a in self.acceleration)
            each = ", ".join(f"{name} {mass:.6g}" for name, mass in self.bodies.items())
            total = sum(self.bodies.values())
            words = f"Gravity: ({field}) on {total:.6g} kg" + (f" ({each})" if each else "")
        if self.payload:
            words += f"; load: payload of {self.payload:.6g} kg, {self.weight:.6g} {self.unit}"
        return words

    @property
    def notes(self) -> list[Note]:
        """Names links without mass, where gravity acts."""
        if not self.massless:
            return []
        words = f"gravity acts, and these have no mass: {', '.join(self.massless)}"
        return [Note("massless", words, {"links": list(self.massless)})]


def weights_of(elastic: ElasticMechanism, loads: Sequence[Potential] = ()) -> Weighed:
    """What gravity acts on in a mechanism, and the payloads among its loads."""
    acting = (*elastic.potentials, *loads)
    # Weights are in the unit of force: so is the mass that a load remembers.
    hung = [load for load in acting if isinstance(load, DeadForce) and load.mass]
    payload = sum(load.mass for load in hung) * elastic.units.newtons
    weight = float(np.linalg.norm(sum((load.force for load in hung), np.zeros(3))))
    if elastic.gravity is None:
        return Weighed(None, {}, (), payload, weight, elastic.units.force)
    masses = elastic.mechanism.masses()
    return Weighed(
        tuple(map(float, elastic.gravity)),
        {name: mass for name, mass in masses.items() if mass > 0.0},
        tuple(name for name, mass in masses.items() if not mass > 0.0),
        payload,
        weight,
        elastic.units.force,
    )


def under_earth(elastic: ElasticMechanism, hung: float) -> ElasticMechanism:
    """The mechanism from which a payload of `hung` kg is hung: it weighs, and all else with it.

    Without any gravity that of the earth is assumed, along -z of F, and a note says so.
    """
    if elastic.gravity is None:
        words = f"a payload was given and no gravity: (0, 0, -{EARTH:g}) m/s^2 acts"
        note = Note("gravity-assumed", words, {"gravity": [0.0, 0.0, -EARTH]})
        elastic = elastic.with_notes(note).with_gravity()
    notes = [note for note in elastic.notes if note.code != "weightless" or not hung]
    return replace(elastic, notes=tuple(notes))
