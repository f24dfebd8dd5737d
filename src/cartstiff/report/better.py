"""A better posture in words, for the report and the page."""

from __future__ import annotations

import numpy as np

from cartstiff.answer.posture import parts_of_links
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.toolpaths.better import USEFUL_GAIN, BetterPosture, Change
from cartstiff.units import Units, engineering

#: What is said where none is offered.
NONE_FOUND = (
    "No better posture was found: with the tip where it is, none moves "
    f"{100 * USEFUL_GAIN:.0f} % less."
)


def better_sentences(found: BetterPosture, elastic: ElasticMechanism) -> list[str]:
    """The gain and the joint that moves most; the coordinates; what gets worse."""
    units = elastic.units
    here, there = (engineering(x, units.length) for x in found.displacement)
    kept = "the tip stays where it is"
    if round(np.degrees(found.turn), 1):
        kept += f", the tool turns by {np.degrees(found.turn):.1f} deg about its z axis"
    lead = (
        f"Better posture ({kept}): {100 * found.gain:.0f} % less displacement, "
        f"{there} instead of {here} (by the equilibrium)"
    )
    if (j := found.moves_most) is not None:
        coordinate = elastic.mechanism.coordinates[j]
        far = place(abs(found.q[j] - found.start[j]), coordinate.is_length, units)
        lead += f"; {coordinate.name} moves most, by {far}"
    sentences = [f"{lead}."]
    if not found.is_near:
        sentences.append("It is another configuration of the arm.")
    links = parts_of_links(elastic)
    places = ", ".join(
        f"{c.name} {place(float(x), c.is_length, units)}"
        for c, x in zip(elastic.mechanism.coordinates, found.q, strict=True)
        if c.name not in links
    )
    worse = "; ".join(_worse(change, elastic) for change in found.worse)
    sentences.append(f"It is at {places}.")
    sentences.append(f"Worse there: {worse}." if worse else "Nothing else gets worse.")
    if found.reason:
        sentences.append(f"The search followed difference quotients: {found.reason}.")
    return [*sentences, "Collisions and the floor were not checked."]


def place(value: float, is_length: bool, units: Units) -> str:
    """A coordinate: degrees, or a length."""
    if is_length:
        return engineering(round(value, 9), units.length)
    return f"{round(np.degrees(value), 1) + 0.0:.1f} deg"


def _worse(change: Change, elastic: ElasticMechanism) -> str:
    """A measure at both postures."""
    units = elastic.units
    if change.measure == "margin":
        far = [place(x, not change.is_angle, units) for x in (change.there, change.here)]
        return f"{change.of} is {far[0]} from its limit ({far[1]} here)"
    what, unit = {
        "stiffness": ("the softest direction has", units.stiffness["translation"]),
        "condition": ("the condition number is", ""),
        "rotation": ("the body turns by", "rad"),
    }[change.measure]
    here, there = (engineering(x, unit) for x in (change.here, change.there))
    return f"{what} {there} ({here} here)"
