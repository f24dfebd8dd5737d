"""`analyse` of a platform begins with its legs: lengths, margins and forces, by hand."""

import re

import numpy as np
import pytest
from tests.support.commands import answer, run
from tests.support.read_units import read

import cartstiff

LOAD = "--load 0,0,0,10,0,-100"


def test_lengths_margins_and_forces():
    """Ends of legs by the pose; forces by equilibrium of the body."""
    platform = cartstiff.load("hexapod")
    data = answer("analyse hexapod", LOAD)
    legs, T = data["legs"], np.array(data["pose"])
    ends = platform.mechanism.points @ T[:3, :3].T + T[:3, 3]
    along = ends - platform.mechanism.anchors
    lengths = np.linalg.norm(along, axis=1)
    assert [leg["position"] for leg in legs] == pytest.approx(lengths)
    for leg, length in zip(legs, lengths, strict=True):
        if leg["lower"] is not None:
            margin = min(length - leg["lower"], leg["upper"] - length)
            assert leg["margin"] == pytest.approx(margin)
    force = np.array([leg["force"] for leg in legs]) @ (along / lengths[:, None])
    assert force == pytest.approx(T[:3, :3] @ [10, 0, -100], abs=1e-6)


def test_they_come_before_everything_but_the_answer():
    text = run("analyse hexapod", LOAD)
    assert text.index("\nAnswer\n") < text.index("\nLegs\n") < text.index("\nK^")
    data = answer("analyse hexapod", LOAD)
    keys = list(data)
    assert keys.index("legs") < keys.index("q")
    head, *rows = text.split("\nLegs\n")[1].splitlines()[:7]
    assert head.split()[:2] == ["leg", "length"]
    cells = [re.split(r"  +", row.strip()) for row in rows]
    assert [read(row[1]) for row in cells] == pytest.approx(
        [leg["position"] for leg in data["legs"]], rel=1e-5
    )
    at = re.split(r"  +", head.strip()).index("force")
    assert [read(row[at]) for row in cells] == pytest.approx(
        [leg["force"] for leg in data["legs"]], rel=1e-3, abs=1e-3
    )


def test_drives_of_closed_chains():
    """A 6-UPS of joints: its slides, with the forces that hold the body against its weight."""
    data = answer("analyse 6-ups --gravity 0,0,-9.81 --payload 10 --load 0,0,0,0,0,0")
    assert [leg["name"] for leg in data["legs"]] == [
        name for name in data["mechanism"]["joints"] if "slide" in name or name.endswith("_p")
    ] or len(data["legs"]) == 6
    assert all(leg["is_length"] for leg in data["legs"])


def test_arms_have_no_legs():
    assert "legs" not in answer("analyse ur5")
    assert "\nLegs\n" not in run("analyse ur5")
