"""What the commands print has the form that the JSON Schema states, and the page shows."""

import copy
import json
import re

import numpy as np
import pytest
from tests.doors import LOAD_KINDS, PostureMatrices, Reading, summarise
from tests.inner import numbers, unit_of
from tests.support.robots import bundled_files, example_robots

import cartstiff
from cartstiff import DeadForce, FollowerWrench, analyse_posture, equilibrium
from cartstiff.analysis import Tolerances
from cartstiff.core.errors import UnknownNameError
from cartstiff.extend import json_schema

jsonschema = pytest.importorskip("jsonschema")
ROBOTS = {"ur5", "ur10", "panda", "xarm7"}


def _valid(data, command):
    # Through text, as another program sees it.
    jsonschema.validate(json.loads(json.dumps(data)), json_schema(command))


@pytest.mark.parametrize("name", sorted(bundled_files()))
def test_output_of_analyse_has_the_form(name):
    if name in ROBOTS and not example_robots():
        pytest.skip("example-robot-data is not installed")
    result = cartstiff.analyse(cartstiff.load(name))
    analysis = analyse_posture(result, direction=[1.0, 2.0, 2.0], wrench=[0, 0, 0, 0, 0, 5.0])
    _valid(result.to_dict() | {"analysis": analysis}, "analyse")


def test_the_form_of_an_analysis_refuses_what_is_wrong():
    arm = cartstiff.load("cubic")
    result = cartstiff.analyse(arm, wrench=[0, 0, 0, 0, 0, -5.0])
    found = analyse_posture(result, target=result.B.matrix, tolerances=Tolerances(0.05))
    _valid(found, "analysis")
    for change in ({"frame": [0.0]}, {"more": 1}, {"centres": {"stiffness": [0.0, 0.0]}}):
        with pytest.raises(jsonschema.ValidationError):
            _valid(found | change, "analysis")


def test_units_of_an_analysis_follow_from_its_form():
    """In a unit of length that is a times longer, numbers are smaller by the powers of a."""
    K = np.diag([3.0, 2.0, 4.0, 50.0, 60.0, 70.0])
    K[0, 4] = K[4, 0] = 2.0
    a = 10.0
    S = np.diag([1.0, 1.0, 1.0, a, a, a])
    here = numbers(summarise(PostureMatrices({"B": K}, np.zeros(6)), Reading(0.2)))
    del here["indices.best_length"]  # the condition number is as small over a range of lengths
    there = numbers(summarise(PostureMatrices({"B": S @ K @ S / a}, np.zeros(6)), Reading(0.2 / a)))
    powers = {
        "1": 0,
        "{length}": 1,
        "{force}": 0,
        "{force}/{length}": -1,
        "{force}/rad": 0,
        "{force} {length}/rad": 1,
        "{length}/rad": 1,
        "{force}^6/rad^3": 0,
        "{length}/{force}": 1,
        "rad/({force} {length})": -1,
        "rad/{force}": 0,
        "{length}/({force} {length})": 0,
    }
    seen = set()
    for name, values in here.items():
        for place in np.ndindex(values.shape):
            unit = unit_of(".".join([name, *map(str, place)]))
            if unit == "mixed" or name.endswith(("axes", "direction")):
                continue
            seen.add(unit)
            expected = values[place] / a ** powers[unit]
            assert np.isclose(there[name][place], expected, rtol=1e-6, atol=1e-9), (name, unit)
    assert len(seen) > 8


@pytest.mark.parametrize(
    ("name", "load", "held"),
    [
        ("cubic", DeadForce([0, 0, -100]), {}),
        ("cubic", FollowerWrench([0, 0, 0, 0, 0, -100]), {}),
        ("five-bar", DeadForce([0, -50, 0]), {}),
        ("hexapod", DeadForce([0, 0, -10]), {"z": 0.001}),
    ],
    ids=["dead", "follower", "closed chain", "held"],
)
def test_output_of_equilibrium_has_the_form(name, load, held):
    elastic = cartstiff.load(name)
    start = cartstiff.analyse(elastic).elastic
    _valid(equilibrium(start, load, held=held or None).to_dict(), "equilibrium")


@pytest.mark.parametrize("name", ["stewart-simscape", "five-bar", "grasp", "3-rrr"])
def test_output_of_modes_has_the_form(name):
    _valid(cartstiff.modes(cartstiff.load(name)).to_dict(), "modes")


def test_the_schema_is_one_and_refuses_what_is_wrong():
    jsonschema.Draft202012Validator.check_schema(json_schema())
    jsonschema.Draft202012Validator.check_schema(json_schema("equilibrium"))
    data = cartstiff.analyse(cartstiff.load("cubic")).to_dict()
    for change in ({"wrench": [0.0] * 5}, {"order": "linear-angular"}, {"more": 1}):
        with pytest.raises(jsonschema.ValidationError):
            _valid(copy.deepcopy(data) | change, "analyse")
    del data["pose"]
    with pytest.raises(jsonschema.ValidationError):
        _valid(data, "analyse")


def test_the_table_of_keys_names_the_choices_of_the_code():
    kind = json_schema()["properties"]["load"]["properties"]["kind"]
    assert kind["enum"] == list(LOAD_KINDS)
    with pytest.raises(UnknownNameError, match=r"unknown command; .* got 'analyze'"):
        json_schema("analyze")


def test_the_page_shows_every_key(built):
    page = next(p for path, p in built.items() if path.as_posix().endswith("reference/json.html"))
    text = re.sub(r"<[^>]+>", "", page.text)
    for key in [*json_schema("equilibrium")["properties"], "stiffness.F", "reactions.held"]:
        assert key in text, key
