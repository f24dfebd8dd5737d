"""Closed chains by recorded arithmetic are the engine's postures: coordinates, states, numbers."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from tests.doors import Array
from tests.laws.test_many_engine import OUTPUTS, assert_same
from tests.support import (
    absolute_error,
    refused,
)

import cartstiff
from cartstiff import DeadForce, ElasticMechanism, analyse_many

COUNT = 5
WRENCH = np.array([1.0, -2.0, 0.5, 30.0, -20.0, 40.0])
#: Two ways to closure end within the rounding of their residuals, over the least singular value.
ASSEMBLED = 1e-13


def starts(elastic: ElasticMechanism, away: float = 0.05, count: int = COUNT) -> Array:
    """Home, with what is held elsewhere: the other coordinates are still to be found."""
    chain = elastic.mechanism
    q = np.tile(elastic.q, (count, 1))
    moved = [j for j in chain.held or range(elastic.q.size) if j not in chain.virtual]
    steps = np.random.default_rng(1).uniform(-away, away, (count, len(moved)))
    q[:, moved] += steps * chain.at(elastic.q).coordinate_lengths[moved]
    return q


def with_rests(elastic: ElasticMechanism, **more: float) -> ElasticMechanism:
    rest = elastic.q + 0.002 * np.sin(np.arange(elastic.q.size))
    sprung = np.flatnonzero(elastic.springs.stiffness)
    return elastic.with_springs(rest={elastic.names[j]: rest[j] for j in sprung}, **more)


def weighed(elastic: ElasticMechanism) -> ElasticMechanism:
    return elastic.with_gravity([0.0, 0.0, -9.81])


def sprung_everywhere(elastic: ElasticMechanism) -> ElasticMechanism:
    k = np.where(elastic.springs.stiffness > 0.0, elastic.springs.stiffness, 50.0)
    return elastic.with_springs(k.tolist(), (elastic.q + 0.01).tolist())


def without_motors(elastic: ElasticMechanism) -> ElasticMechanism:
    chain = copy(elastic.mechanism)
    chain.actuated, chain.selection, chain.held = None, None, []
    return replace(elastic, mechanism=chain)


def pushed(elastic: ElasticMechanism) -> ElasticMechanism:
    return elastic.with_potential(DeadForce([5.0, -3.0, 10.0], [0.01, 0.02, 0.03], "body"))


EACH = np.random.default_rng(3).normal(size=(COUNT, 6)) * 10.0
CASES = {
    "six legs": ("6-ups", [], {}),
    "six legs under a load each": ("6-ups", [weighed], {"wrench": EACH}),
    "six legs with rests": ("6-ups", [weighed, with_rests], {}),
    "six legs without motors": ("6-ups", [without_motors], {}),
    "six legs with springs everywhere": ("6-ups", [without_motors, sprung_everywhere], {}),
    "welds": ("3-rps", [], {}),
    "welds under a load in F": (
        "3-rps",
        [],
        {"wrench": WRENCH, "load_axes": "world", "load_at": (0.1, 0.0, 0.2)},
    ),
    "welds with gravity and a force": ("tricept", [weighed, pushed], {}),
    "welds with rests": ("3-rps", [weighed, with_rests], {}),
    "sliders": ("orthoglide", [weighed], {"wrench": WRENCH}),
    "closures that repeat others": ("five-bar", [weighed], {"wrench": WRENCH}),
    "closures that repeat others without motors": (
        "five-bar",
        [without_motors, weighed],
        {"wrench": WRENCH},
    ),
    "forearms that give": ("delta", [], {}),
    "bars that give in a plane": ("3-rrr", [], {}),
    "more motors than motions": ("4-rrr", [], {}),
    "more motors than motions under a load": ("4-rrr", [], {"wrench": WRENCH}),
}


@pytest.mark.parametrize("case", CASES)
def test_every_kind_of_closure_and_load(case):
    name, changes, load = CASES[case]
    elastic = cartstiff.load(name)
    for change in changes:
        elastic = change(elastic)
    q = starts(elastic, 0.02)
    (found,) = assert_same(elastic, q, "portable", outputs=OUTPUTS, **load)
    assert found.fallback == 0
    for given, at in zip(q, found.q, strict=True):
        assert absolute_error(at, elastic.mechanism.closed(given).q) <= ASSEMBLED


@pytest.mark.parametrize("change", [None, weighed, pushed])
def test_fingers_that_squeeze_while_some_of_their_springs_choose(change):
    """Closures carry what the others do not."""
    elastic = cartstiff.load("grasp")
    elastic = change(elastic) if change else elastic
    stiff = tuple(name for name in OUTPUTS if not name.startswith("compliance"))
    (found,) = assert_same(elastic, starts(elastic, 0.02), "portable", outputs=stiff)
    assert found.fallback == 0
    for away in (0.0, 1e-7, 1e-4):  # where they squeeze alone, the spin costs nothing
        assert_same(elastic, starts(elastic, away), "portable", outputs=stiff)
    for name in ("compliance_A", "compliance_B"):
        assert_same(elastic, starts(elastic, 0.02), "portable", outputs=(name,))


def test_machine_code():
    elastic = cartstiff.load("3-rps")
    q = starts(elastic, count=11)
    assert_same(elastic, q, "compiled", outputs=("jacobian", "compliance_A"), wrench=WRENCH)
    again = analyse_many(elastic, q, outputs=("pose",), path="compiled", threads=2)
    np.testing.assert_array_equal(
        again["pose"], analyse_many(elastic, again.q, outputs=("pose",), path="compiled")["pose"]
    )


@pytest.mark.parametrize(("name", "count"), [("five-bar", 24), ("3-prs", 6)])
def test_far_from_home(name, count):
    """Some starts end where the motors cannot be kept, and some nowhere: the engine says so."""
    elastic = cartstiff.load(name)
    q = starts(elastic, 1.0, count)
    assert_same(elastic, q, "portable", outputs=("pose", "compliance_B"))
    found, engine = (analyse_many(elastic, q, path=path) for path in ("portable", "engine"))
    assert 0 < found.fallback < len(q)
    assert absolute_error(found.q, engine.q) <= 100 * ASSEMBLED


def test_near_type_2():
    """The arms of a five-bar stretched, and nearly: the motors lose it."""
    elastic = cartstiff.load("five-bar")
    q = np.tile(elastic.q, (12, 1))
    q[:, 0] += np.linspace(-0.9, 0.9, 12)
    assert_same(elastic, q, "portable", outputs=("compliance_B",))


def test_links_that_are_bent_go_to_the_engine():
    elastic = cartstiff.load("delta")
    q = starts(elastic, 0.02, 3)
    q[1, sorted(elastic.mechanism.virtual)[0]] = 1e-4
    found = analyse_many(elastic, q, path="portable")
    assert found.fallback == 1


def test_a_start_from_which_rounding_chooses_the_assembly_goes_to_the_engine():
    """Legs stretched level: the plate can fall or rise, both alike.

    What the engine does hangs on the processor's rounding: it stays between them, or takes one.
    """
    elastic = cartstiff.load("delta")
    q = np.zeros((2, elastic.q.size))
    q[1] = elastic.q
    found, engine = (
        analyse_many(elastic, q, path=path, outputs=("pose",)) for path in ("portable", "engine")
    )
    assert found.fallback == 1
    assert absolute_error(found["pose"], engine["pose"]) <= 100 * ASSEMBLED
    assert found.codes[found.state[0]] == engine.codes[engine.state[0]]


def test_coordinates_are_the_closed_ones_whatever_the_state():
    """Also where springs cannot carry the load: joints of the fingers have none."""
    elastic = cartstiff.load("grasp")
    q = np.tile(elastic.q, (2, 1))
    q[1, 0] += 0.05
    found = analyse_many(elastic, q, wrench=[1.0, -2.0, 3.0, 20.0, 30.0, -40.0])
    assert found.counts() == {"unbalanced": 2}
    closed = np.array([elastic.mechanism.closed(start).q for start in q])
    np.testing.assert_array_equal(found.q, closed)
    assert absolute_error(found.q, q) > 1e-3


def test_what_has_no_arithmetic_says_why():
    elastic = weighed(cartstiff.load("delta"))
    refused("beside closures", analyse_many, elastic, [elastic.q], path="portable")


def test_few_postures_are_not_worth_recording():
    elastic = cartstiff.load("five-bar")  # of four coordinates
    q = starts(elastic, 0.02, 120)
    few = analyse_many(elastic, q[:7])
    assert (few.path, few.fallback) == ("engine", 7)
    assert few.reason == "such a closed chain is recorded from 8 postures on"
    assert analyse_many(elastic, q[:8]).path == "portable"
    found = analyse_many(elastic, q)
    assert (found.path, found.fallback) == ("portable", 0)


def test_a_motor_without_a_spring_is_left_to_the_engine():
    elastic = cartstiff.load("five-bar").with_springs({"left_motor": 0.0})
    refused("without a spring", analyse_many, elastic, starts(elastic), path="portable")
    assert analyse_many(elastic, starts(elastic, count=200)).path == "engine"


@pytest.mark.parametrize("path", ["portable", "compiled"])
def test_recorded_steps_give_up_where_the_engine_does(path):
    """After steps in vain the engine lets the held joints go; the recorded ones went on alone.

    Of 12,000 postures up to 0.5 off, this one ended in another assembly (coordinates 3.8 apart).
    """
    elastic = cartstiff.load("6-ups")
    rng = np.random.default_rng(5)
    q = (elastic.q + rng.uniform(-0.5, 0.5, (8265, elastic.q.size)))[-1:]
    found = cartstiff.analyse_many(elastic, q, path=path, outputs=["pose"])
    at = elastic.mechanism.closed(q[0])
    assert absolute_error(found.q[0], at.q) <= 1e-9
    assert absolute_error(found["pose"][0], at.pose) <= 1e-9
