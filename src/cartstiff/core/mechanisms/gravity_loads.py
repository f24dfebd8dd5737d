"""The masses on which gravity acts, for every report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from cartstiff.core.mechanisms.contract import Mechanism
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import Note
from cartstiff.core.potentials.contract import Potential
from cartstiff.core.units import EARTH

# How the springs take the weight before any load, in words.
_BEFORE_LOAD = {
    "balanced": "before the load the springs balance it at the posture",
    "given": "before the load it acts on the springs' given rest positions",
    "partly": "before the load springs without a rest position balance it at the posture",
}


@dataclass(frozen=True)
class GravityLoads:
    """Gravity, and the masses on which it acts.

    Attributes
    ----------
    acceleration : tuple of float or None
        Acceleration of the uniform field, in F; None without gravity.
    bodies : mapping of str to float
        Mass [kg] that each joint carries, by the name of its (first) link; the payload of
        the mechanism's file under "payload". Empty without gravity.
    massless : tuple of str
        Moving links without mass, if there is gravity.
    payload, weight : float
        Mass [kg] of the payloads among the loads, and their weight, which the loads
        contain.
    unit : str
        The mechanism's unit of force.
    before : {"balanced", "given", "partly"} or None
        State before any load, see `ElasticMechanism.before_load`.
    """

    acceleration: tuple[float, ...] | None
    bodies: Mapping[str, float]
    massless: tuple[str, ...]
    payload: float
    weight: float
    unit: str
    before: Literal["balanced", "given", "partly"] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: keys "gravity", "weighed" and "before_load"."""
        parts = [{"name": name, "mass": mass} for name, mass in self.bodies.items()]
        if self.payload:
            parts.append({"name": "payload among the loads", "mass": self.payload})
        return {
            "gravity": None if self.acceleration is None else list(self.acceleration),
            "weighed": parts,
            "before_load": self.before,
        }

    @property
    def text(self) -> str:
        """One line of text for people."""
        if self.acceleration is None:
            words = "Gravity: none"
        else:
            field = ", ".join(f"{a:g}" for a in self.acceleration)
            each = ", ".join(f"{name} {mass:.6g}" for name, mass in self.bodies.items())
            total = sum(self.bodies.values())
            words = f"Gravity: ({field}) on {total:.6g} kg" + (
                f" ({each})" if each else ""
            )
            words += f"; {_BEFORE_LOAD[self.before]}" if self.before and total else ""
        if self.payload:
            words += (
                f"; load: payload of {self.payload:.6g} kg, {self.weight:.6g} {self.unit}"
            )
        return words

    @property
    def notes(self) -> list[Note]:
        """Note on links without mass, where gravity acts."""
        if not self.massless:
            return []
        words = f"gravity acts, and these have no mass: {', '.join(self.massless)}"
        return [Note("massless", words, {"links": list(self.massless)})]


def without_mass(mechanism: Mechanism, masses: Mapping[str, float]) -> tuple[str, ...]:
    """Links without mass; ends of the joints that closures and contacts have
    are no links.
    """
    parts = [c.name.rpartition(".") for c in mechanism.coordinates]
    joints = {frame for frame, _, axis in parts if axis in ("x", "y", "z")}
    return tuple(
        name for name, mass in masses.items() if not mass > 0.0 and name not in joints
    )


def gravity_loads(
    elastic: ElasticMechanism, loads: Sequence[Potential] = ()
) -> GravityLoads:
    """Return the masses on which gravity acts in a mechanism,
    and the payloads among its loads.
    """
    acting = (*elastic.potentials, *loads)
    # A load's mass, as its weight, is in the unit of force.
    hung = [own for load in acting if (own := load.dead) is not None and own.mass]
    payload = sum(load.mass for load in hung) * elastic.units.newtons
    weight = float(np.linalg.norm(sum((load.force for load in hung), np.zeros(3))))
    field = None if elastic.gravity is None else tuple(map(float, elastic.gravity))
    masses = {} if field is None else elastic.mechanism.masses()
    bodies = {name: mass for name, mass in masses.items() if mass > 0.0}
    massless = without_mass(elastic.mechanism, masses)
    unit = elastic.units.force
    return GravityLoads(
        field, bodies, massless, payload, weight, unit, elastic.before_load
    )


def with_default_gravity(elastic: ElasticMechanism, hung: float) -> ElasticMechanism:
    """Return the mechanism with gravity for a payload of `hung` kg that was added to it.

    Without any gravity that of the earth is assumed, along -z of F, and a note says so.
    """
    if elastic.gravity is None:
        words = f"a payload was given and no gravity: (0, 0, -{EARTH:g}) m/s^2 acts"
        note = Note("gravity-assumed", words, {"gravity": [0.0, 0.0, -EARTH]})
        elastic = elastic.with_notes(note).with_gravity()
    notes = [note for note in elastic.notes if note.code != "weightless" or not hung]
    return replace(elastic, notes=tuple(notes))
