"""`--pose` for bodies on legs: there in closed form, or as far as the freedoms go, and said so."""

import json
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.doors import COORDINATES
from tests.mechanisms.test_working_modes import solutions
from tests.support import absolute_error
from tests.support.commands import outcome

import cartstiff
from cartstiff import InputError, at_pose

EXACT = 1e-10
#: What of a pose is free, by machine.
FREE = {
    "6-pus": "x y z roll pitch yaw",
    "hexaglide": "x y z roll pitch yaw",
    "6-rus": "x y z roll pitch yaw",
    "3-rps": "z roll pitch",
    "3-prs": "z roll pitch",
    "tricept": "x y z",
    "orthoglide": "x y z",
    "4-rrr": "x y yaw",
    "delta": "x y z",
    "6-ups": "x y z roll pitch yaw",
    "five-bar": "x y",
}


def pose_numbers(T):
    angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
    return np.concatenate([T[:3, 3], angles])


@pytest.mark.parametrize("name", FREE)
def test_the_free_coordinates_are_met_and_the_others_follow(name):
    machine = cartstiff.load(name)
    home = pose_numbers(machine.mechanism.at(machine.q).pose)
    wanted = home + 0.02 * np.cos(1.0 + np.arange(6))
    q, notes = at_pose(machine, wanted)
    posture = machine.mechanism.at(q)
    assert np.abs(posture.residual).max() < EXACT
    free = [COORDINATES.index(c) for c in FREE[name].split()]
    reached = pose_numbers(posture.pose)
    assert np.abs((reached - wanted)[free]).max() < EXACT
    if len(free) == 6:
        assert notes == ()
        return
    (note,) = notes
    assert note.code == "pose-follows"
    assert note.values["free"] == FREE[name].split()
    assert set(note.values["follow"]) == set(COORDINATES) - set(FREE[name].split())
    for c, x in note.values["follow"].items():
        assert x == pytest.approx(reached[COORDINATES.index(c)], abs=EXACT)
    # A pose that the body can take is met as a whole.
    again, notes = at_pose(machine, reached)
    assert notes == ()
    assert absolute_error(pose_numbers(machine.mechanism.at(again).pose), reached) < EXACT


def test_the_working_mode_is_kept():
    machine = cartstiff.load("hexaglide")
    q, _ = at_pose(machine, [0.05, 0.02, -0.4, 0.05, -0.1, 0.1])
    P = machine.mechanism.at(q).pose
    for leg in machine.mechanism.legs:
        assert leg.mode(q, P) == leg.mode(machine.q, machine.mechanism.at(machine.q).pose)


def test_all_working_modes_of_six_cranks():
    """In closed form the 64 that random starts find, and nothing is searched for."""
    machine = cartstiff.load("6-rus")
    T = machine.mechanism.at(machine.q).pose
    found = solutions(machine, T, 64)
    assert "in closed form" in str(found.search)
    cranks = [leg.driven for leg in machine.mechanism.legs]
    values = [np.unique(found[:, j].round(9)) for j in cranks]
    assert [len(v) for v in values] == [2] * 6
    assert {tuple(row) for row in found[:, cranks].round(9)} == set(product(*values))


@pytest.mark.parametrize(
    ("name", "pose", "words"),
    [
        ("6-pus", [0.6, 0, 0.5, 0, 0, 0], r"leg\d, which is 0\.\d+ m too short"),
        ("6-rus", [0, 0, 0.6, 0, 0, 0], r"leg\d, which is 0\.\d+ m too short"),
        ("orthoglide", [0.5, 0, 0, 0, 0, 0], r"leg\d, which is 0\.\d+ m too short"),
        ("ur5", [0.3, 0, 0.5, 0, 0, 0], "platforms and bodies carried by legs"),
    ],
)
def test_what_is_out_of_reach_is_refused(name, pose, words):
    with pytest.raises(InputError, match=words):
        at_pose(cartstiff.load(name), pose)


@pytest.mark.parametrize("free", ["x y z", "z roll"])
def test_the_pose_of_m_is_that_of_m(free):
    """Coordinates of M itself are met where the body has fewer freedoms, and named as given."""
    name = "tricept" if free == "x y z" else "3-rps"
    tool = np.eye(4)
    tool[:3, 3] = 0.05, 0.02, -0.1
    machine = cartstiff.load(name, tcp=tool)
    T = machine.mechanism.at(machine.q).pose
    given, wanted = [COORDINATES.index(c) for c in free.split()], pose_numbers(T)
    wanted[given] += 0.04
    q, (note,) = at_pose(machine, wanted, tool, of="M")
    reached = pose_numbers(machine.mechanism.at(q).pose)
    assert np.abs(reached - wanted)[given].max() < EXACT
    assert set(free.split()) <= set(note.values["free"])
    for c, x in note.values["follow"].items():
        assert x == pytest.approx(reached[COORDINATES.index(c)], abs=EXACT)
    assert note.values["given"] == pytest.approx(
        {c: wanted[COORDINATES.index(c)] for c in note.values["follow"]}, abs=EXACT
    )


def test_on_the_command_line():
    code, out, _ = outcome("analyse 3-rps --pose 0,0,0.65,0.1,0,0.2 --json")
    assert code == 0
    answer = json.loads(out)
    assert answer["pose"][2][3] == pytest.approx(0.65, abs=EXACT)
    assert "pose-follows" in [note["code"] for note in answer["notes"]]
    _, out, _ = outcome(
        f"analyse 6-pus --pose 0.01,0,0.55,{np.pi / 36!r},0,0 --tcp 0,0,0.1 --json",
    )
    # The pose is the body's; the tool stands 100 mm above it, tilted by 5 degrees.
    tool = [0.01, -0.1 * np.sin(np.pi / 36), 0.55 + 0.1 * np.cos(np.pi / 36)]
    assert np.array(json.loads(out)["pose"])[:3, 3] == pytest.approx(tool, abs=1e-11)
    code, _, err = outcome("analyse 6-pus --pose 0.6,0,0.5,0,0,0")
    assert code == 2
    assert "--pose: the pose cannot be reached" in err


@pytest.mark.parametrize(("given", "free"), [((2, 3, 4), "z roll pitch"), ((0, 1, 2), "x y z")])
def test_coordinates_that_differ_from_the_file_are_those_of_the_pose(given, free):
    """An Exechon tilts as told: both struts in the plane of the body's y axis, the third across."""
    strut = {"stiffness": 1e8, "end_axis": [0, 1, 0]}
    pair, across = [[-0.4, 0, 0], [0.4, 0, 0]], [0, 0.5, 0]
    ends, end = [[-0.15, 0, 0], [0.15, 0, 0]], [0, 0.2, 0]
    first = {"chain": "UPR", "base": {"points": pair}, "platform": {"points": ends}}
    third = {"chain": "SPR", "base": {"points": [across]}, "platform": {"points": [end]}}
    legs = [first | strut | {"axis": [1, 0, 0]}, third | strut | {"end_axis": [1, 0, 0]}]
    machine = cartstiff.parallel(legs, [0, 0, -0.9, 0, 0, 0])
    wanted = np.array([0, 0, -0.9, 0, 0, 0])
    wanted[[*given]] += [0.05, 0.1, 0.06]
    q, (note,) = at_pose(machine, wanted)
    assert note.values["free"] == free.split()
    T = machine.mechanism.at(q).pose
    assert np.abs(pose_numbers(T) - wanted)[[*given]].max() < EXACT
    R, p = T[:3, :3], T[:3, 3]
    hinge, strut = R @ [0, 1, 0], p + R @ ends[0] - pair[0]
    assert max(abs(hinge[0]), abs(hinge @ strut), abs((p + R @ end - across) @ R[:, 0])) < EXACT
