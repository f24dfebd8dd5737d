"""Two ways to a posture: the self-motion settles, or the leg lengths say where the platform is."""

import json
import math

import numpy as np
import pytest
from tests.doors import with_rest_balancing
from tests.support.commands import outcome

import cartstiff
from cartstiff import relaxed

#: The held pose is kept, and lengths are met, to the rounding of a few steps.
KEPT = 1e-11
#: Share of the largest torque that may remain along the self-motion.
BALANCED = 1e-8

LINKS = 7


def _arm():
    """Seven revolutes with alternating axes."""
    parts = ['<robot name="seven">', '<link name="l0"/>']
    for i in range(LINKS):
        axis = ("0 0 1", "0 1 0")[i % 2]
        parts.append(
            f'<link name="l{i + 1}"/><joint name="j{i + 1}" type="continuous">'
            f'<parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="0.05 0 0.2"/><axis xyz="{axis}"/></joint>'
        )
    return "".join(parts) + "</robot>"


Q = "0.1,0.5,-0.3,0.9,0.2,-0.6,0.4"
REST = "0.15,0.45,-0.2,0.95,0.1,-0.5,0.3"


def test_relax_finds_the_balanced_posture(tmp_path, capsys):
    path = tmp_path / "seven.urdf"
    path.write_text(_arm())
    command = ["analyse", str(path), "--q", Q, "--rest", REST, "--stiffness", "1000", "--json"]
    code, out, _ = outcome(*command)
    refused = json.loads(out)
    assert code == 0
    assert refused["wrench"] is None
    assert all(K is None for K in refused["stiffness"].values())
    (note,) = (n for n in refused["notes"] if n["code"] == "unbalanced")
    assert len(note["values"]["unbalanced_torque"]) == LINKS
    code, out, _ = outcome(*command, "--relax")
    settled = json.loads(out)
    assert code == 0
    assert "unbalanced" not in {n["code"] for n in settled["notes"]}
    assert np.abs(np.array(settled["pose"]) - refused["pose"]).max() < KEPT
    assert settled["q"] != refused["q"]
    # J^T W must be the torque of the springs at the new posture.
    torque = 1000 * (np.array(settled["q"]) - [float(v) for v in REST.split(",")])
    error = np.array(settled["jacobian"]).T @ settled["wrench"] - torque
    assert np.abs(error).max() < BALANCED * np.abs(torque).max()
    assert settled["energy"] < refused["energy"]


def test_relaxed_leaves_a_balanced_posture_where_it_is(tmp_path):
    path = tmp_path / "seven.urdf"
    path.write_text(_arm())
    arm = cartstiff.load(path).with_springs(stiffness=500.0)
    q = np.array([float(v) for v in Q.split(",")])
    arm = with_rest_balancing(arm, q, np.array([1.0, 2.0, -1.0, 20.0, -10.0, 5.0]))
    assert np.abs(relaxed(arm, q) - q).max() < 1e-9  # Newton stops on the residual, not on q


@pytest.mark.parametrize("load", [(), ("--load", "0,0,0,0,0,-50")])
def test_weight_along_a_self_motion_says_what_to_do(tmp_path, capsys, load):
    """Weight between the legs of a delta: rest positions are found where a load is given."""
    weighs = ["delta", "--gravity", "0,0,-9.81", *load]
    code, analysed, _ = outcome("analyse", *weighs)
    assert code == 0
    where = "--cartesian x=0:0.05:2 --branches 1 --quantity condition"
    code, mapped, _ = outcome("map", *weighs, where, "-o", str(tmp_path / "delta.zarr"))
    assert code == 0
    for text in (analysed, mapped):
        assert ("unbalanced" in text) == (load == ())
        assert ("--load 0,0,0,0,0,0" in text) == (load == ())


def test_strict_tells_the_unbalanced_posture(tmp_path, capsys):
    path = tmp_path / "seven.urdf"
    path.write_text(_arm())
    command = ["analyse", str(path), "--q", Q, "--rest", REST, "--stiffness", "1000", "--strict"]
    code, _, error = outcome(*command)
    assert code == 3
    assert error.count("\n") == 1
    assert "unbalanced" in error


def test_lengths_give_the_pose(capsys):
    platform = cartstiff.load("hexapod")
    pose = platform.q + np.array([0.02, -0.01, 0.03, 0.04, -0.05, 0.06])
    lengths = platform.mechanism.leg_lengths(pose)
    text = ",".join(repr(float(v)) for v in lengths)
    code, out, _ = outcome(f"analyse hexapod --lengths {text} --json")
    assert code == 0
    assert np.abs(np.array(json.loads(out)["q"]) - pose).max() < KEPT


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("ur5 --lengths 1,1,1,1,1,1", "--lengths: is for platforms"),
        ("hexapod --lengths 1,1,1", "expected 6 numbers"),
        (f"hexapod --lengths 1,1,1,1,1,{math.nan}", "not a finite number"),
        ("hexapod --lengths 1,1,1,1,1,-1", "--lengths: cannot be used; expected above zero"),
        ("hexapod --lengths 1,1,1,1,1,1 --pose 0,0,1,0,0,0", "not both"),
        ("hexapod --lengths 9,1,1,1,1,1", "leg lengths"),
    ],
)
def test_lengths_that_cannot_be_used(arguments, words, capsys):
    code, out, error = outcome("analyse", arguments)
    assert code in (2, 3)
    assert out == ""
    assert error.count("\n") == 1
    assert words in error
