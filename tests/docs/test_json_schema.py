"""What the commands print has the form that the JSON Schema states, and the page shows."""

import copy
import json
import re

import pytest
from tests.doors import LOAD_KINDS
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
