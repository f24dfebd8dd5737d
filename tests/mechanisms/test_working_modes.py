"""Bodies carried by legs: all combinations of the legs' solutions, against elbows by hand."""

from itertools import product

import numpy as np
import pytest
from tests.mechanisms.machines import joint, write_file, write_urdf
from tests.mechanisms.test_pose_of_a_parallel_machine import (
    cosine_and_sine,
    cranks,
    six_rus,
    wrapped,
)
from tests.support import absolute_error

import cartstiff
from cartstiff import inverse_kinematics

# Solutions of each leg are good to rounding.
EXACT = 1e-10


def same_rows(found, wanted):
    """Each wanted row of angles stands once among those found."""
    assert found.shape == wanted.shape
    for row in wanted:
        assert (np.abs(wrapped(found - row)).max(axis=1) < EXACT).sum() == 1


def solutions(machine, T, count, free="none"):
    """The postures found at a pose, as many as are wanted, all of which have it."""
    found = inverse_kinematics(machine, T, free=free)
    assert len(found) == count
    for q in found:
        posture = machine.mechanism.at(q)
        assert np.abs(posture.residual).max() < EXACT
        reached = posture.pose if free == "none" else posture.pose[:3, 3]
        assert absolute_error(reached, T if free == "none" else T[:3, 3]) < EXACT
    return found


@pytest.mark.parametrize("rpy", [(0.05, -0.1, 0.15), (-0.08, 0.02, -0.2)])
def test_six_rus_has_sixty_four(rpy, tmp_path):
    machine = cartstiff.load(six_rus(tmp_path, pose={"xyz": [0.02, -0.01, 0.33], "rpy": list(rpy)}))
    T = machine.mechanism.at(machine.q).pose
    found = solutions(machine, T, 64)
    own = [machine.names.index(f"leg{k + 1}/crank") for k in range(6)]
    same_rows(found[:, own], np.array(list(product(*cranks(T)))))
    assert found.search.legs == (2,) * 6
    assert (found.search.found, found.search.listed) == (64, 64)
    assert str(found.search).startswith("64 found: 2 x 2 x 2 x 2 x 2 x 2")
    assert found[:3].search is None


def test_of_many_combinations_the_nearest_are_listed(tmp_path):
    machine = cartstiff.load(six_rus(tmp_path, pose={"xyz": [0.02, -0.01, 0.33]}))
    T = machine.mechanism.at(machine.q).pose
    every = inverse_kinematics(machine, T)
    few = inverse_kinematics(machine, T, most=5)
    away = np.linalg.norm(wrapped(every - machine.q), axis=1)
    nearest = every[np.sort(np.argsort(away)[:5])]
    np.testing.assert_allclose(few, nearest, atol=EXACT)
    assert (few.search.found, few.search.listed) == (64, 5)
    assert "nearest 5 are listed" in str(few.search)


def test_planar_three_rrr_has_eight():
    machine = cartstiff.load("3-rrr")
    T = machine.mechanism.at(machine.q).pose
    found = solutions(machine, T, 8)
    # Crank and coupler are 0.3 m long; the motors stand on a ring of 0.4 m.
    grips = [
        (-0.04114773689465417, 0.1127247255416855),
        (-0.07704860750640112, -0.09199734822985144),
        (0.1181963444010552, -0.02072737731183413),
    ]
    motors = []
    for k, grip in enumerate(grips):
        a = np.pi / 2 + 2 * np.pi * k / 3
        d = T[:2, :2] @ grip + T[:2, 3] - 0.4 * np.array([np.cos(a), np.sin(a)])
        motors.append(cosine_and_sine(*d, d @ d / 0.6))
    own = [machine.names.index(f"leg{k + 1}/motor") for k in range(3)]
    # The file's own numbers have sixteen digits.
    same_rows(found[:, own], np.array(list(product(*motors))))


def test_delta_has_eight_and_six_ups_one():
    for name, count in (("delta", 8), ("6-ups", 1)):
        machine = cartstiff.load(name)
        solutions(machine, machine.mechanism.at(machine.q).pose, count)


def test_five_bar_with_its_body_free_to_turn_has_four():
    machine = cartstiff.load("five-bar")
    found = solutions(machine, machine.mechanism.at(machine.q).pose, 4, "rotation")
    motors = found[:, [machine.names.index(n) for n in ("left_motor", "right_motor")]]
    assert len(np.unique(np.round(motors, 6), axis=0)) == 4


def test_a_leg_out_of_reach_leaves_none(tmp_path):
    machine = cartstiff.load(six_rus(tmp_path, pose={"xyz": [0.02, -0.01, 0.33]}))
    T = np.eye(4)
    T[2, 3] = 0.9
    found = inverse_kinematics(machine, T)
    assert found.shape == (0, 36)
    assert found.search.found == 0


def test_legs_that_hang_on_the_body(tmp_path):
    """A body on an arm of two sliders and a turn, with a leg from it to a point of the base."""
    write_urdf(
        tmp_path,
        joint("x", "base", "carriage", axis=(1, 0, 0), kind="prismatic"),
        joint("y", "carriage", "slide", axis=(0, 1, 0), kind="prismatic"),
        joint("turn", "slide", "body", axis=(0, 0, 1)),
        joint("hip", "body", "thigh", axis=(0, 0, 1)),
        joint("knee", "thigh", "shank", at=(0.5, 0, 0), axis=(0, 0, 1)),
        joint("foot", "shank", "toe", at=(0.6, 0, 0), kind="fixed"),
        name="hanging",
    )
    file = write_file(
        tmp_path,
        "hanging",
        kind="closed-chain",
        model="hanging.urdf",
        frame="body",
        closures=[
            {"frames": ["toe", "world"], "type": "point", "points": [[0, 0, 0], [0.3, -0.2, 0]]}
        ],
        actuated=["knee"],
        springs={"knee": {"stiffness": 100.0}},
        q={"x": 0.1, "y": 0.5, "turn": 0.2, "hip": -2.0, "knee": 0.9},
    )
    machine = cartstiff.load(file)
    T = machine.mechanism.at(machine.q).pose
    found = solutions(machine, T, 2)
    d = np.array([0.3, -0.2]) - T[:2, 3]
    knee = np.arccos((d @ d - 0.5**2 - 0.6**2) / (2 * 0.5 * 0.6))
    own = np.sort(found[:, machine.names.index("knee")])
    np.testing.assert_allclose(own, [-knee, knee], atol=EXACT)


@pytest.mark.parametrize(
    ("base", "platform", "link"),
    [(0.25, 0.1, 0.15), (0.2, 0.05, 0.2), (0.2, 0.12, 0.12), (0.3, 0.1, 0.12), (0.35, 0.12, 0.15)],
)
def test_alike_legs_of_a_symmetric_machine_take_one_working_mode(base, platform, link):
    """At the centre both elbows of every leg are equally near: round-off does not choose."""
    k = 500.0
    legs = {"chain": "RRR", "crank": link, "rod": link, "stiffness": k}
    legs |= {"base": {"radius": base}, "platform": {"radius": platform}}
    machine = cartstiff.parallel(legs, [0.0] * 6)
    angle = np.pi - np.arccos((base - platform) / 2 / link)  # of an isosceles triangle
    motors = [leg.driven for leg in machine.mechanism.legs]
    np.testing.assert_allclose(machine.q[motors], angle, atol=EXACT)
    (note,) = (note for note in machine.notes if note.code == "working-mode")
    assert "mode: plus" in note.message
    np.testing.assert_allclose(list(note.values["other"].values()), -angle, atol=EXACT)
    # A rod carries t along its line n, and t n . (crank across) holds its motor's torque.
    C, total = cartstiff.analyse(machine).compliances["B"], np.zeros((3, 3))
    for turn in 2 * np.pi * np.arange(3) / 3:
        across, n = (np.array([np.cos(x), np.sin(x)]) for x in (turn + angle + np.pi / 2, turn))
        elbow = link * np.array([np.cos(turn + angle), np.sin(turn + angle)])
        grip = platform * n
        n = grip - base * n - elbow
        g = np.array([grip[0] * n[1] - grip[1] * n[0], *n]) / (link * (n @ across))
        total += k * np.outer(g, g)
    np.testing.assert_allclose(C[2:5, 2:5], np.linalg.inv(total), rtol=1e-8, atol=1e-12)
    for mode, sign in (("plus", 1), ("minus", -1)):
        named = cartstiff.parallel({**legs, "mode": mode}, [0.0] * 6)
        np.testing.assert_allclose(named.q[motors], sign * angle, atol=EXACT)
        assert "working-mode" not in {note.code for note in named.notes}
