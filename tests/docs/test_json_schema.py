"""What the commands print has the form that the JSON Schema states, and the page shows."""

from __future__ import annotations

import copy
import json
import re

import pytest

import cartstiff
from cartstiff.loading.catalogue import bundled_files, example_robots
from cartstiff.potentials.loads import DeadForce, FollowerWrench
from cartstiff.report.json_schema import json_schema
from cartstiff.statics.equilibrium import equilibrium

jsonschema = pytest.importorskip("jsonschema")
ROBOTS = {"ur5", "ur10", "panda", "xarm7"}


def _valid(data: dict[str, object], command: str) -> None:
    # Through text, as another program sees it.
    jsonschema.validate(json.loads(json.dumps(data)), json_schema(command))


@pytest.mark.parametrize("name", sorted(bundled_files()))
def test_output_of_analyse_has_the_form(name):
    if name in ROBOTS and not example_robots():
        pytest.skip("example-robot-data is not installed")
    _valid(cartstiff.analyse(cartstiff.load(name)).as_dict(), "analyse")


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
    _valid(equilibrium(start, load, held=held or None).as_dict(), "equilibrium")


@pytest.mark.parametrize("name", ["stewart-simscape", "five-bar", "grasp", "3-rrr"])
def test_output_of_modes_has_the_form(name):
    _valid(cartstiff.modes(cartstiff.load(name)).as_dict(), "modes")


def test_the_schema_is_one_and_refuses_what_is_wrong():
    jsonschema.Draft202012Validator.check_schema(json_schema())
    jsonschema.Draft202012Validator.check_schema(json_schema("equilibrium"))
    data = cartstiff.analyse(cartstiff.load("cubic")).as_dict()
    for change in ({"wrench": [0.0] * 5}, {"order": "linear-angular"}, {"more": 1}):
        with pytest.raises(jsonschema.ValidationError):
            _valid(copy.deepcopy(data) | change, "analyse")
    del data["pose"]
    with pytest.raises(jsonschema.ValidationError):
        _valid(data, "analyse")


def test_the_page_shows_every_key(built):
    page = next(p for path, p in built.items() if path.as_posix().endswith("reference/json.html"))
    text = re.sub(r"<[^>]+>", "", page.text)
    for key in [*json_schema("equilibrium")["properties"], "stiffness.F", "reactions.held"]:
        assert key in text, key
