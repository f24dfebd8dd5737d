"""Recorded programs have torques, margins and the largest load, with their derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from tests.support import refused

import cartstiff as cs

W = np.array([2.0, -3.0, 5.0, 10.0, 20.0, -60.0])
OUTPUTS = ["effort_margin", "largest_load"]


def arm() -> tuple[cs.ElasticMechanism, np.ndarray, str]:
    elastic = cs.load("ur5").with_gravity()
    return elastic, elastic.q + 0.1 * np.arange(1, 7), "torques"


def platform() -> tuple[cs.ElasticMechanism, np.ndarray, str]:
    elastic = cs.load("hexapod")
    limits = {name: (-300.0, 250.0 + 10.0 * i) for i, name in enumerate(elastic.spring_names)}
    return replace(elastic, efforts=limits), np.array(elastic.q), "tensions"


@pytest.mark.parametrize("made", [arm, platform])
def test_numbers_are_those_of_one_posture(made):
    elastic, q, forces = made()
    program = cs.record(elastic, [forces, *OUTPUTS], loaded=True)
    assert program.path == "compiled"
    found, result = program(q, wrench=W), cs.analyse(elastic, q, wrench=W)
    own = result.torques if forces == "torques" else result.tensions
    assert found[forces] == pytest.approx(own, rel=1e-9, abs=1e-9)
    least = 1.0 - max(one.used for one in result.forces)
    assert float(found["effort_margin"]) == pytest.approx(least, rel=1e-9)
    linear = min(
        (one for one in [cs.capacity(elastic, q, wrench=W).linear] if one.kind == "force"),
        key=lambda one: one.factor,
    )
    assert float(found["largest_load"]) == pytest.approx(linear.factor, rel=1e-9)


@pytest.mark.parametrize("of", OUTPUTS)
def test_derivatives_are_those_of_differences(of):
    elastic, q, _ = arm()
    program = cs.record(elastic, OUTPUTS, loaded=True)
    exact = program.gradient(of, q, wrench=W)["q"]
    found = approx_fprime(q, lambda x: float(program(x, wrench=W)[of]), 1e-7)
    assert exact == pytest.approx(found, abs=1e-5 * np.abs(exact).max())


@pytest.mark.parametrize("of", OUTPUTS)
@pytest.mark.parametrize("made", [arm, platform])
def test_gradients_of_one_posture_are_those_of_the_program(made, of):
    elastic, q, _ = made()
    found = cs.gradient(elastic, q, of=of, by="q", wrench=W)
    program = cs.record(elastic, OUTPUTS, loaded=True)
    assert found.value == pytest.approx(float(program(q, wrench=W)[of]), rel=1e-9)
    slopes = approx_fprime(q, lambda x: float(program(x, wrench=W)[of]), 1e-7)
    size = np.abs(slopes).max()
    exact = np.array([found[f"q.{name}"] for name in elastic.names])
    assert exact == pytest.approx(slopes, abs=1e-5 * size)


@pytest.mark.parametrize(("made", "legs"), [(arm, False), (platform, True)])
def test_a_single_force_has_its_derivatives_too(made, legs):
    """By coordinates and by the load, beside differences of one posture."""
    elastic, q, forces = made()

    def third(given):
        return given[forces][2]

    program = cs.record(elastic, [third], loaded=True)
    found = program.gradient("third", q, wrench=W)

    def force(x: np.ndarray) -> float:
        result = cs.analyse(elastic, x[:6], wrench=x[6:])
        return float((result.tensions if legs else result.torques)[2])

    slopes = approx_fprime(np.concatenate([q, W]), force, 1e-6)
    exact = np.concatenate([found["q"], found["wrench"]])
    assert found["third"] == pytest.approx(force(np.concatenate([q, W])), rel=1e-9)
    for part in (slice(0, 6), slice(6, 12)):
        size = np.abs(exact[part]).max()
        assert exact[part] == pytest.approx(slopes[part], abs=1e-4 * size)


@pytest.mark.parametrize("name", ["five-bar", "6-pus", "3-prs", "tricept"])
def test_loops_hold_the_load_at_which_a_drive_is_at_its_limit(name):
    """By the forces under the load that is found, and by the capacity of one posture."""
    elastic = cs.load(name)
    elastic = replace(elastic, efforts=dict.fromkeys(elastic.spring_names, (-40.0, 50.0)))
    rng, load = np.random.default_rng(3), [0.3, -0.2, 0.4, 10.0, 20.0, -30.0]
    size = elastic.mechanism.at(elastic.q).coordinate_lengths
    q = elastic.q + 0.05 * size * rng.uniform(-1.0, 1.0, (4, len(elastic.q)))
    program = cs.record(elastic, OUTPUTS, loaded=True)
    found = program.many(q, wrench=load)
    assert np.isfinite(found["largest_load"]).all()
    for there, factor in zip(found.q, found["largest_load"], strict=True):
        one = program(there, wrench=load)["largest_load"]
        assert float(one) == pytest.approx(factor, rel=1e-9)
        held = cs.capacity(elastic, there, wrench=load).linear
        assert held.kind == "force"
        assert factor == pytest.approx(held.factor, rel=1e-8)
        result = cs.analyse(elastic, there, wrench=factor * np.array(load))
        assert result.forces[0].used == pytest.approx(1.0, rel=1e-8)
        assert result.forces[0].name in held.names


def test_loops_without_one_answer_are_refused():
    elastic = cs.load("delta")  # whose links give
    elastic = replace(elastic, efforts=dict.fromkeys(elastic.spring_names, (-40.0, 50.0)))
    refused("as many drives as motions", cs.record, elastic, ["largest_load"], loaded=True)
    loop = cs.load("five-bar")
    loop = replace(loop, efforts=dict.fromkeys(loop.spring_names, (-40.0, 50.0)))
    refused(
        "has no derivatives", cs.gradient, loop, of="largest_load", wrench=[0, 0, 0, 10.0, 20.0, 0]
    )


def test_quantities_need_a_limit_and_a_load():
    elastic, *_ = arm()
    refused("needs a load", cs.record, elastic, ["largest_load"])
    refused(
        "needs the limit of a drive's force",
        cs.record,
        replace(elastic, efforts={}),
        ["effort_margin"],
    )
