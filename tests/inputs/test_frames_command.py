"""``cartstiff frames``: the tree in words and as JSON, for every kind of mechanism."""

import math

import pytest
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.support.commands import answer, run
from tests.support.robots import bundled_files, example_robots

import cartstiff
from cartstiff.extend import json_schema

ROBOTS = {"ur5", "ur10", "panda", "xarm7"}


def test_a_serial_arm(tmp_path):
    write_urdf(
        tmp_path,
        joint("turn", "base", "upper"),
        joint("push", "upper", "slide", axis=(1, 0, 0), kind="prismatic"),
        joint("grip", "slide", "tool", at=(0.1, 0, 0), kind="fixed"),
    )
    file = write_file(
        tmp_path,
        "arm",
        kind="serial",
        model="machine.urdf",
        frame="tool",
        q={"turn": 0.5},
        springs={"turn": {"stiffness": 300.0, "rest": 0.4}, "push": {"stiffness": 5e4}},
        payload={"mass": 2.0},
    )
    found = answer("frames", file)
    turn, push = found["joints"]
    assert (turn["name"], turn["parent"], turn["q"]) == ("turn", None, 0.5)
    assert turn["spring"] == {"stiffness": 300.0, "rest": 0.4, "law": False, "rigid": False}
    assert (push["parent"], push["lower"], push["upper"]) == ("turn", -100.0, 100.0)
    assert {"slide", "tool"} <= set(push["frames"])
    assert push["carries_body"]
    assert not turn["carries_body"]
    assert found["payload"] == 2.0
    words = run("frames", file)
    assert "└─ turn: revolute, [-inf, inf] deg, q 28.6479, 300 N m/rad at rest at 22.9183" in words
    assert "   └─ push: prismatic, [-100000, 100000] mm, q 0, 50 N/mm, 2 kg" in words
    assert "M on slide" in words
    assert "Payload: 2 kg" in words


def test_a_closed_chain_names_its_closures():
    found = answer("frames five-bar")
    assert found["closures"] == [{"frames": ["tip", "right_tip"], "type": "point"}]
    by_name = {j["name"]: j for j in found["joints"]}
    assert by_name["left_motor"]["actuated"]
    assert by_name["left_elbow"]["spring"] is None
    assert "point: tip = right_tip" in run("frames five-bar")


def test_a_platform_names_its_legs():
    found = answer("frames cubic")
    assert [leg["name"] for leg in found["legs"]] == [f"leg{i}" for i in range(1, 7)]
    assert "leg6: (" in run("frames cubic")


@pytest.mark.parametrize("name", sorted(bundled_files()))
def test_every_kind_has_the_form(name):
    jsonschema = pytest.importorskip("jsonschema")
    if name in ROBOTS and not example_robots():
        pytest.skip("example-robot-data is not installed")
    jsonschema.validate(answer("frames", name), json_schema("frames"))
    assert run("frames", name).count("M on ") == 1


def test_a_frame_that_does_not_exist():
    assert "tipp" in run("frames five-bar --frame tipp", code=2)


def test_json_from_the_command():
    assert answer("frames delta")["schema"] == "cartstiff-frames/1"


def test_postures_in_degrees():
    words, arm = run("frames five-bar"), cartstiff.load("five-bar")
    q = float(arm.q[list(arm.names).index("left_motor")])
    assert f"deg, q {math.degrees(q):.6g}" in words


def test_tool_and_gravity_are_told():
    words = run("frames five-bar --tcp 0.1,0,0.2 --gravity 0,0,-5")
    arm = cartstiff.load("five-bar")
    pose = arm.mechanism.at(arm.q).pose
    x, y, z = 1e3 * pose[:3, 3] + pose[:3, :3] @ [100.0, 0.0, 200.0]
    assert f"M at ({x:.6g}, {y:.6g}, {z:.6g}) mm in F" in words
    assert "Gravity: (0, 0, -5) m/s^2" in words
