"""`--actuate`: what the drives are told, and the pose that results under load."""

import numpy as np
import pytest
from tests.support import absolute_error
from tests.support.commands import answer
from tests.support.oracles import exp_reference

import cartstiff
from cartstiff import InputError, after_command, commanded

EXACT = 1e-9
LOAD = np.array([3.0, -5.0, 2.0, 20.0, 40.0, -500.0])
TOLD = {"leg1/slide": 0.004, "leg4/slide": -0.003}
STEPS = np.array([0.004, 0, 0, -0.003, 0, 0])


def slides(T):
    """Where the slides of 6-pus stand at a pose: rods of 0.5 m on vertical rails."""
    found = []
    for k in range(6):
        side = 1 if k % 2 else -1
        a, b = 2 * np.pi * (k // 2) / 3 + side * np.array([0.2, np.pi / 3 - 0.2])
        base = 0.35 * np.array([np.cos(a), np.sin(a), 0])
        d = T[:3, :3] @ (0.15 * np.array([np.cos(b), np.sin(b), 0])) + T[:3, 3] - base
        found.append(d[2] - np.sqrt(0.25 - d[0] ** 2 - d[1] ** 2))
    return np.array(found)


def gradient(rest, T):
    """Wrench by differences of the springs' energy, 2e7 N/m each."""

    def energy(x):
        return 1e7 * float(((slides(T @ exp_reference(x)) - rest) ** 2).sum())

    steps = 1e-5 * np.eye(6)
    return np.array([(energy(h) - energy(-h)) / 2e-5 for h in steps])


def test_without_a_load_the_drives_go_where_they_are_told():
    machine = cartstiff.load("6-pus")
    before = slides(machine.mechanism.at(machine.q).pose)
    state = after_command(machine, TOLD)
    wanted = before + STEPS
    assert absolute_error(slides(state.pose), wanted) < EXACT
    assert "commanded" in [note.code for note in state.notes]


@pytest.mark.parametrize("kind", ["dead", "follower"])
def test_the_load_stays_and_the_springs_carry_it(kind):
    machine = cartstiff.load("6-pus")
    T = machine.mechanism.at(machine.q).pose
    state = after_command(machine, TOLD, wrench=LOAD, load_kind=kind)
    drives = [machine.names.index(f"leg{k + 1}/slide") for k in range(6)]
    rest = state.elastic.springs.rest[drives]
    # Before the command these springs held the load.
    told = rest - STEPS
    assert absolute_error(gradient(told, T), LOAD) < 1e-3
    R = state.pose[:3, :3].T @ T[:3, :3] if kind == "dead" else np.eye(3)
    now = np.concatenate([R @ LOAD[:3], R @ LOAD[3:]])
    assert absolute_error(gradient(rest, state.pose), now) < 1e-3
    assert np.abs(state.displacement).max() > 1e-4


def test_equilibrium_goes_to_the_same_place():
    """The load put on after the command: that of springs at rest before."""
    machine = cartstiff.load("6-pus")
    told, start = commanded(machine, TOLD)
    state = cartstiff.equilibrium(told, wrench=LOAD, q=start)
    T = machine.mechanism.at(machine.q).pose
    rest = slides(T) + STEPS
    R = state.pose[:3, :3].T @ T[:3, :3]
    now = np.concatenate([R @ LOAD[:3], R @ LOAD[3:]])
    assert absolute_error(gradient(rest, state.pose), now) < 1e-3


def test_lengths_of_lines():
    platform = cartstiff.load("hexapod")
    told = {"leg1": 0.01, "leg2": -0.02}
    state = after_command(platform, told)
    steps = np.array([0.01, -0.02, 0, 0, 0, 0])
    lengths = platform.mechanism.leg_lengths(platform.q) + steps
    pose = platform.mechanism.forward_kinematics(lengths, platform.q)
    assert absolute_error(platform.mechanism.pose_of(pose), state.pose) < EXACT


def test_rigid_drives_go_along():
    machine = cartstiff.load("6-pus").with_springs({"leg1/slide": np.inf, "leg2/slide": np.inf})
    before = slides(machine.mechanism.at(machine.q).pose)
    state = after_command(machine, {"leg1/slide": 0.004, "leg3/slide": 0.001})
    assert absolute_error(slides(state.pose) - before, [0.004, 0, 0.001, 0, 0, 0]) < EXACT


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"leg1/u1": 0.1}, "has no spring: nothing drives it"),
        ({"leg9/slide": 0.1}, "unknown drive"),
        ({"leg1/slide": np.nan}, "command of leg1/slide"),
        ({}, "no drive"),
    ],
)
def test_what_cannot_be_told_is_refused(told, words):
    with pytest.raises(InputError, match=words):
        commanded(cartstiff.load("6-pus"), told)


def test_on_the_command_line():
    machine = cartstiff.load("6-pus")
    load = ",".join(map(str, LOAD))
    words = f"6-pus --load {load} --actuate leg1/slide=0.004,leg4/slide=-0.003"
    state = after_command(machine, TOLD, wrench=LOAD)
    for command in ("analyse", "equilibrium"):
        found = answer(command, words)
        assert "commanded" in [note["code"] for note in found["notes"]]
        if command == "analyse":
            pose = np.array(found["pose"])
            assert absolute_error(pose[:3, 3], state.pose[:3, 3]) < 1e-9
