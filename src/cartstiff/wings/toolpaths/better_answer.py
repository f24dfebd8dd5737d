"""What is said about a better posture, for the report and the page."""

from __future__ import annotations

from math import degrees

from cartstiff.answer.data import Quantity, Statement, said
from cartstiff.answer.posture import parts_of_links
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.units import Units
from cartstiff.wings.toolpaths.better import USEFUL_GAIN, BetterPosture, Change


def better_statements(
    found: BetterPosture | None, elastic: ElasticMechanism
) -> list[Statement]:
    """The gain and the joint that moves most; the coordinates; what gets worse."""
    if found is None:
        return [said("none-better", gain=Quantity(USEFUL_GAIN, "1"))]
    units, coordinates = elastic.units, elastic.mechanism.coordinates
    turned: Statement | str = ""
    moved: Statement | str = ""
    if round(degrees(found.turn), 1):
        turned = said("tool-turns", turn=Quantity(found.turn, units.angle))
    if (j := found.moves_most) is not None:
        way = abs(found.q[j] - found.start[j])
        far = Quantity(float(way), units.coordinate(coordinates[j].is_length))
        moved = said("moves-most", name=coordinates[j].name, far=far)
    here, there = (Quantity(x, units.length) for x in found.displacement)
    gain = Quantity(found.gain, "1")
    about = {"gain": gain, "here": here, "there": there}
    statements = [said("better", turned=turned, moved=moved, **about)]
    if not found.is_near:
        statements.append(said("other-configuration"))
    # Where it is, without what bends by itself, and what that costs.
    links = parts_of_links(elastic)
    places = {
        c.name: Quantity(float(x), units.coordinate(c.is_length))
        for c, x in zip(coordinates, found.q, strict=True)
        if c.name not in links
    }
    statements.append(said("better-at", places=places))
    worse = [_worse(change, units) for change in found.worse]
    statements.append(said("worse", worse=worse) if worse else said("nothing-worse"))
    if found.reason:
        statements.append(said("by-quotients", reason=found.reason))
    return [*statements, said("not-checked")]


def _worse(change: Change, units: Units) -> Statement:
    """A measure at both postures."""
    unit = {
        "margin": units.coordinate(not change.is_angle),
        "stiffness": units.stiffness["translation"],
        "condition": "",
        "rotation": units.angle,
    }[change.measure]
    here, there = (Quantity(x, unit) for x in (change.here, change.there))
    return said(f"worse-{change.measure}", of=change.of, here=here, there=there)
