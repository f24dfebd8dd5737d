"""What of a compensation is weight, by Pinocchio's gravity and Jacobian and springs of one line."""

import csv
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from tests.support import refused
from tests.support.commands import answer, run
from tests.support.printed import text_of

import cartstiff
from cartstiff import ConvergenceError, compensate

FORCE = np.array([20.0, -30.0, -80.0])


@pytest.fixture(scope="module")
def arm():
    return cartstiff.load("ur5").with_gravity([0.0, 0.0, -9.81])


@pytest.fixture(scope="module")
def postures(arm):
    return arm.q + np.linspace(0.0, 0.4, 3)[:, None] * [1.0, 0.5, -0.7, 0.3, 0.2, 0.1]


@pytest.fixture(scope="module")
def winds(arm, postures):
    """Windup of each joint under the weight, and under the force at the tool: torque over k."""
    from example_robot_data import load

    model = load("ur5").model
    data, frame = model.createData(), model.getFrameId("tool0")
    weight, pushed = [], []
    for q in postures:
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        weight.append(pin.computeGeneralizedGravity(model, data, q) / arm.springs.stiffness)
        pushed.append(-J[:3].T @ FORCE / arm.springs.stiffness)
    return np.array(weight), np.array(pushed)


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("against", ["load", "all"])
def test_the_shares(arm, postures, winds, against, stated):
    """Open rest positions and those of a file: the same, by the word alone."""
    weight, pushed = winds
    if stated:
        springs = arm.springs.replaced(arm.springs.stiffness, arm.q)
        arm = replace(arm, springs=springs)
    path = compensate(arm, postures, np.r_[0, 0, 0, FORCE], load_axes="world", against=against)
    np.testing.assert_allclose(path.weight, weight, atol=1e-9)
    np.testing.assert_allclose(path.commands, postures + weight + pushed, atol=1e-9)
    own = weight if against == "all" else 0.0 * weight
    np.testing.assert_allclose(path.offsets, pushed + own, atol=1e-9)
    moved = path.summary()["before"]["translation_max"]
    assert path.summary()["after"]["translation_max"] < 1e-9 < moved
    text = text_of(path)
    assert f"--against {against}" in text
    assert f"{np.degrees(np.abs(weight).max(axis=0)[1]):.6g}" in text


def test_the_programs_before_and_after_subtract(tmp_path, arm, postures, winds):
    """The same rows and units; `poses` writes either program."""
    weight, pushed = winds
    table = tmp_path / "path.csv"
    table.write_text("\n".join(",".join(map(repr, map(float, q))) for q in postures), "utf-8")
    force = ",".join(map(str, [0, 0, 0, *FORCE]))
    words = ("equilibrium", "ur5", "--gravity", "0,0,-9.81", "--load", force, "--world")
    found = tmp_path / "commands.csv"
    run(*words, "--path", table, "-o", found)
    rows = list(csv.DictReader(found.read_text("utf-8").splitlines()))
    names = [f"{name} [rad]" for name in arm.names]
    after, before = (
        np.array([[float(row[f"{word}_{n}"]) for n in names] for row in rows])
        for word in ("command", "taught")
    )
    np.testing.assert_allclose(after - before, pushed, atol=1e-9)
    np.testing.assert_allclose(before - postures, weight, atol=1e-9)
    data = answer(*words, "--path", table, "--against", "all")
    np.testing.assert_allclose(np.array(data["taught"]), postures, atol=1e-12)
    np.testing.assert_allclose(data["weight"], weight, atol=1e-9)


def test_weight_alone(tmp_path, arm, postures, winds):
    """Without any load there is the weight to compensate, if that is asked for."""
    table = tmp_path / "path.csv"
    table.write_text("\n".join(",".join(map(repr, map(float, q))) for q in postures), "utf-8")
    words = ("equilibrium", "ur5", "--gravity", "0,0,-9.81", "--path", table)
    data = answer(*words, "--against", "all")
    np.testing.assert_allclose(np.array(data["commands"]) - postures, winds[0], atol=1e-9)
    assert "--against all" in run(*words, code=2)
    refused("against", compensate, arm, postures, np.r_[0, 0, 0, FORCE], against="weight")


def test_links_that_find_no_rest_are_refused_with_the_numbers_once():
    elastic = cartstiff.load("delta")
    caught = refused(
        r"^point 1: the links find no rest",
        compensate,
        elastic,
        [elastic.q],
        [3e5, 0.0, 0.0, 0.0, 0.0, 0.0],
        kind=ConvergenceError,
    )
    assert str(caught).count("iterations") == 1
