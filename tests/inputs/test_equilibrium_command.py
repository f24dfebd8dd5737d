"""``cartstiff equilibrium``: what it accepts, what it writes, what it refuses in one line."""

import csv
import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from tests.support.commands import answer, run
from tests.support.robots import example_robots

import cartstiff
from cartstiff import DeadForce, equilibrium

ROBOTS = {"ur5", "panda"}
MORE = {
    "answer",
    "residual",
    "stable",
    "iterations",
    "history",
    "eigenvalues",
    "displacement",
    "relaxation",
    "displacement_by_load",
    "displacement_uncertainty",
    "elastic_wrench",
    "reactions",
}
# A posture near the middle of each file, and loads within the elastic range.
LOADS = {
    "ur5": "0,0,0,0,0,-100",
    "panda": "0,0,0,5,-10,20",
    "hexapod": "0,0,0,500,0,-2000",
    "stewart-gough": "0,0,0,0,0,-5",
    "five-bar": "0,0,0,20,-50,0",
    "3-rrr": "0,0,0,50,0,-20",
    "delta": "0,0,0,3,0,-10",
}
needs_plots = pytest.mark.skipif(
    importlib.util.find_spec("matplotlib") is None, reason="matplotlib is not installed"
)


def _needs(mechanism):
    if mechanism in ROBOTS and not example_robots():
        pytest.skip("example-robot-data is not installed")


def _codes(data):
    return [note["code"] for note in data["notes"]]


# -- one equilibrium ------------------------------------------------------------------------------


@pytest.mark.parametrize("mechanism", LOADS)
def test_a_loaded_mechanism(mechanism):
    _needs(mechanism)
    data = answer(f"equilibrium {mechanism} --load", LOADS[mechanism], "--world")
    of_some = {"legs", "task_axes"}
    expected = set(cartstiff.analyse(cartstiff.load("cubic")).to_dict()) | MORE
    assert set(data) - of_some == expected - of_some
    assert data["stable"] is True
    assert data["residual"] < 1e-9
    assert min(data["eigenvalues"]) > 0
    assert "unstable" not in _codes(data)
    assert len(data["history"]) == data["iterations"] + 1
    elastic = cartstiff.load(mechanism)
    force = [float(x) for x in LOADS[mechanism].split(",")][3:]
    state = equilibrium(elastic, DeadForce(force))
    assert data["displacement"] == state.displacement.tolist()
    assert data["q"] == state.q.tolist()
    moved = np.array(data["displacement"][3:])
    if mechanism != "stewart-gough":  # the paper's platform stands under a load of its own
        assert moved @ force > 0


@pytest.mark.parametrize("mechanism", ["hexapod", "stewart-gough", "five-bar"])
def test_text_has_units(mechanism):
    text = run(f"equilibrium {mechanism} --load", LOADS[mechanism])
    length = "cm" if mechanism == "stewart-gough" else "m"
    lines = text.splitlines()
    assert "  The equilibrium is stable" in lines
    (least,) = (line for line in lines if "smallest eigenvalue" in line)
    assert least.endswith(f" N {length}")
    assert any(line.startswith("  It was found after ") for line in lines)
    # The paper's platform is no equilibrium without the wrench of its preload.
    preloaded = mechanism == "stewart-gough"
    part = "by the load, from that rest" if preloaded else "from the start to the equilibrium"
    table = lines[lines.index("Displacement of the body frame, axes of F") :]
    row = next(line for line in table if line.startswith(f"  {part} "))
    assert re.search(r"\) deg  +\(.*\) mm$", row)
    assert "Wrench that the springs balance" not in text or re.search(r"\) N$", text, re.MULTILINE)


def test_text_says_when_there_is_no_load():
    assert "No load is given" in run("equilibrium hexapod")
    assert "loads are included in the stiffness" in run("equilibrium hexapod --load 0,0,0,0,0,-9")


def test_load_in_body_or_inertial_axes():
    pose = "0.01,0.02,0.76,0.3,0.2,0.5"
    R = np.array(answer(f"equilibrium hexapod --pose {pose}")["pose"])[:3, :3]
    force = np.array([100.0, -200.0, 300.0])
    body = answer(
        f"equilibrium hexapod --pose {pose} --load", "0,0,0," + ",".join(map(str, R.T @ force))
    )
    world = answer(f"equilibrium hexapod --pose {pose} --load 0,0,0,100,-200,300 --world")
    np.testing.assert_allclose(body["pose"], world["pose"], rtol=0, atol=1e-14)
    other = answer(f"equilibrium hexapod --pose {pose} --load 0,0,0,100,-200,300")
    assert not np.allclose(body["displacement"], other["displacement"], rtol=1e-3, atol=0)


def test_a_follower_load_is_not_decided():
    data = answer("equilibrium hexapod --load 0,0,0,100,0,-200 --load-kind follower")
    assert data["stable"] is None
    assert data["energy"] is None
    assert "non-conservative" in _codes(data)
    note = next(n for n in data["notes"] if n["code"] == "non-conservative")
    assert "no potential" in note["message"]
    assert data["residual"] < 1e-9
    np.testing.assert_allclose(data["elastic_wrench"], [0, 0, 0, 100, 0, -200], atol=1e-6)
    text = run("equilibrium hexapod --load 0,0,0,100,0,-200 --load-kind follower")
    assert "not decided by definiteness" in text
    assert "energy's Hessian" not in text


def test_a_moment_is_not_decided():
    data = answer("equilibrium hexapod --load 5,0,0,0,0,0 --world")
    assert data["stable"] is None
    assert "non-conservative" in _codes(data)


def test_a_payload_acts_before_the_load():
    """As the own weight, and as a payload of the file; its own sag is that of its weight as a load.

    The note names the options for that.
    """
    heavy = answer("equilibrium hexapod --payload 50,0.1,0,0.2")
    assert heavy["displacement"] == [0.0] * 6
    assert heavy["before_load"] == "balanced"
    assert sum(part["mass"] for part in heavy["weighed"]) == 50.0
    (note,) = [n["message"] for n in heavy["notes"] if n["code"] == "payload-before-load"]
    sag = answer("equilibrium hexapod", note.partition("that of ")[2])
    assert sag["displacement"][5] < 0
    W = np.array(sag["elastic_wrench"])
    np.testing.assert_allclose(np.linalg.norm(W[3:]), 50 * 9.81, rtol=1e-9)
    all_of_it = answer("equilibrium hexapod --payload 50,0.1,0,0.2 --against-gravity 0,0,0")
    np.testing.assert_allclose(all_of_it["displacement"], sag["displacement"], atol=1e-9)


@pytest.mark.parametrize("options", ["", "--payload 12,0,0,-0.1"])
def test_a_start_that_is_no_rest_has_two_displacements(tmp_path, options):
    """The way to the rest before the load, and that by the load: each as of its own equilibrium."""
    _needs("ur5")
    joints = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    rests = (0.3, -1.15, 1.42, -0.7, 0.9, 0.2)
    file = tmp_path / "arm.yaml"
    file.write_text(
        "kind: serial\nmodel: ur5\nframe: tool0\ngravity: [0, 0, -9.81]\n"
        "q: {shoulder_pan_joint: 0.3, shoulder_lift_joint: -1.1, elbow_joint: 1.4, "
        "wrist_1_joint: -0.7, wrist_2_joint: 0.9, wrist_3_joint: 0.2}\nsprings:\n"
        + "".join(
            f"  {joint}_joint: {{stiffness: 2.0e+4, rest: {rest}}}\n"
            for joint, rest in zip(joints, rests, strict=True)
        ),
        encoding="utf-8",
    )
    command = f"equilibrium {file} {options}"
    alone, both = answer(command), answer(f"{command} --load 0,0,0,0,0,-100 --world")
    assert both["before_load"] == "given"
    poses = [np.array(data["pose"]) for data in (alone, both)]
    np.testing.assert_allclose(both["relaxation"], alone["displacement"], rtol=0, atol=1e-9)
    by_load = np.array(both["displacement_by_load"])
    np.testing.assert_allclose(by_load[3:], (poses[1] - poses[0])[:3, 3], rtol=0, atol=1e-9)
    assert np.linalg.norm(both["relaxation"][3:]) > 5 * np.linalg.norm(by_load[3:])
    start = np.array(alone["pose"])[:3, 3] - alone["displacement"][3:]
    np.testing.assert_allclose(both["displacement"][3:], poses[1][:3, 3] - start, atol=1e-9)
    text = run(f"{command} --load 0,0,0,0,0,-100 --world")
    assert "before the load, from the start to its rest" in text
    assert "by the load, from that rest" in text


def test_a_held_displacement_has_a_reaction():
    data = answer("equilibrium hexapod --hold z=-0.001,rx=0.002")
    held = data["reactions"]["held"]
    assert set(held) == {"z", "rx"}
    # The hexapod's home pose has the axes of F.
    np.testing.assert_allclose(data["displacement"][5], -0.001, rtol=0, atol=1e-14)
    np.testing.assert_allclose(data["displacement"][0], 0.002, rtol=0, atol=1e-14)
    K = cartstiff.analyse(cartstiff.load("hexapod")).B.matrix
    linear = np.linalg.inv(np.linalg.inv(K)[np.ix_([0, 5], [0, 5])]) @ [0.002, -0.001]
    np.testing.assert_allclose([held["rx"], held["z"]], linear, rtol=0.02)
    text = run("equilibrium hexapod --hold z=-0.001,rx=0.002")
    assert "\nReactions\n" in text
    assert any(x.startswith("  held z") and x.endswith(" N") for x in text.splitlines())
    assert any(x.startswith("  held rx") and x.endswith(" N m") for x in text.splitlines())


def test_limits_stop_unless_they_are_left_out():
    push = "hexapod --load 0,0,0,0,0,-9e6 --world"
    data = answer("equilibrium", push)
    assert "limit-contact" in _codes(data)
    assert data["reactions"]["limits"]
    assert set(data["reactions"]["limits"]) <= {f"leg{i}" for i in range(1, 7)}
    free = answer("equilibrium", push, "--no-limits")
    assert free["reactions"]["limits"] == {}
    assert "limit-contact" not in _codes(free)


# -- curves and paths -----------------------------------------------------------------------------


def _table(path):
    header, *rows = list(csv.reader(Path(path).read_text(encoding="utf-8").splitlines()))
    return header, np.array(rows, float)


@needs_plots
def test_a_curve_with_its_files(workplace):
    push = "five-bar --load 0,0,0,0,-1000,0 --world --curve 1"
    text = run("equilibrium", push, "-o curve.csv -o curve.png")
    assert "x [mm]" in text
    assert "Critical load: limit at factor 0.4521544917" in text
    data = answer("equilibrium", push)
    header, table = _table("curve.csv")
    assert header[0] == "factor"
    assert header[1:5] == [f"{name} [rad]" for name in cartstiff.load("five-bar").names]
    assert header[-1] == "eigenvalue"
    np.testing.assert_array_equal(table[:, 0], data["factor"])
    np.testing.assert_array_equal(table[:, 5:11], data["displacement"])
    assert data["factor"][0] == 0.0
    assert data["factor"][-1] == pytest.approx(1.0, abs=1e-12)
    assert data["reason"] == "factor-reached"
    assert data["critical"][0]["kind"] == "limit"
    picture = Path("curve.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert b"IEND" in picture[-12:]
    assert sorted(p.name for p in workplace.iterdir()) == ["curve.csv", "curve.png"]


@pytest.mark.parametrize("axes", ["body", "world"])
def test_a_curve_keeps_what_is_held(axes):
    push = "five-bar --load 0,0,0,0,-100,0 --curve 1"
    push += " --world" * (axes == "world")
    free, held = answer("equilibrium", push), answer("equilibrium", push, "--hold x=0")
    R = cartstiff.analyse(cartstiff.load("five-bar")).pose[:3, :3]
    x, other = (R[:, 0], np.eye(3)[0]) if axes == "body" else (np.eye(3)[0], R[:, 0])
    np.testing.assert_allclose(np.array(held["displacement"])[:, 3:] @ x, 0, atol=1e-12)
    assert np.abs(np.array(free["displacement"])[:, 3:] @ x).max() > 1e-5
    assert np.abs(np.array(held["displacement"])[:, 3:] @ other).max() > 1e-4


def test_hold_is_along_the_world_where_the_load_is():
    """The tool of the UR5 is turned: held along z of the world, along no axis of its own."""
    found = answer("equilibrium ur5 --hold z=-0.002 --world")["displacement"]
    assert found[5] == pytest.approx(-0.002, rel=1e-9)
    own = answer("equilibrium ur5 --hold z=-0.002")["displacement"]
    assert abs(own[5] + 0.002) > 1e-4


POSES = [[0.0, 0.0, 0.75, 0.0, 0.0, 0.0], [0.02, 0.01, 0.76, 0.05, 0.1, 0.1]]
WRENCHES = [[0, 0, 0, 10, 0, -300.0], [0, 0, 0, 200, 100, -300.0]]


def _write(name, rows, head=""):
    lines = [",".join(map(str, row)) for row in rows]
    Path(name).write_text(head + "\n".join(lines) + "\n", encoding="utf-8")


def test_a_path_of_postures():
    _write("path.csv", POSES, "# a comment, and an empty line\n\n")
    push = "hexapod --load 0,0,0,10,0,-300 --path path.csv"
    text = run("equilibrium", push, "-o commands.csv")
    assert "along 2 postures" in text
    legs = [line for line in text.splitlines() if line.startswith("  leg")]
    assert len(legs) == 6
    assert all(line.endswith(" mm") for line in legs)
    data = answer("equilibrium", push)
    assert data["springs"] == [f"leg{i}" for i in range(1, 7)]
    header, table = _table("commands.csv")
    assert header[:2] == ["command_leg1 [m]", "command_leg2 [m]"]
    np.testing.assert_array_equal(table[:, :6], data["commands"])
    assert data["stable"] == [True, True]
    assert data["summary"]["before"]["translation_max"] > 1e-5
    assert data["summary"]["after"]["translation_max"] < 1e-12
    assert data["summary"]["after"]["rotation_max"] < 1e-12
    # Commands, given as rest lengths, put the loaded platform where it should be.
    elastic = cartstiff.load("hexapod").with_springs(rest=data["commands"][0])
    state = equilibrium(elastic, DeadForce([10.0, 0.0, -300.0]))
    np.testing.assert_allclose(state.pose, data["poses"][0], rtol=0, atol=1e-12)


@needs_plots
def test_a_path_with_wrenches():
    rows = [pose + wrench for pose, wrench in zip(POSES, WRENCHES, strict=True)]
    _write("path.csv", rows)
    data = answer("equilibrium hexapod --path path.csv --world -o error.png")
    assert Path("error.png").read_bytes().startswith(b"\x89PNG")
    for pose, wrench, before in zip(POSES, WRENCHES, data["error_before"], strict=True):
        _write("one.csv", [pose])
        load = ",".join(map(str, wrench))
        one = answer(f"equilibrium hexapod --path one.csv --load {load} --world")
        np.testing.assert_allclose(one["error_before"][0], before, rtol=1e-9, atol=1e-15)
    body = answer("equilibrium hexapod --path path.csv")
    np.testing.assert_allclose(body["commands"][0], data["commands"][0], rtol=1e-12)
    assert not np.allclose(body["commands"][1], data["commands"][1], rtol=1e-6)
    names = ("x", "y", "z", "roll", "pitch", "yaw", "mx", "my", "mz", "fx", "fy", "fz")
    header = ",".join(reversed(names)) + "\n"
    _write("named.csv", [row[::-1] for row in rows], header)
    assert answer("equilibrium hexapod --path named.csv")["commands"] == body["commands"]
    turning = answer("equilibrium hexapod --path path.csv --load-kind follower")
    np.testing.assert_allclose(turning["commands"], body["commands"], rtol=1e-12)
    assert turning["stable"] == [None, None]


def test_a_payload_adds_to_the_wrenches_of_a_path():
    _write("path.csv", [pose + wrench for pose, wrench in zip(POSES, WRENCHES, strict=True)])
    more = [[*w[:5], w[5] - 98.1] for w in WRENCHES]
    _write("more.csv", [pose + wrench for pose, wrench in zip(POSES, more, strict=True)])
    heavy = answer("equilibrium hexapod --path path.csv --world --payload 10")
    same = answer("equilibrium hexapod --path more.csv --world")
    np.testing.assert_allclose(heavy["commands"], same["commands"], rtol=1e-12)


def test_a_payload_beside_links_without_mass_is_a_mass():
    """Gravity that is given acts on it: nobody is told that it acts on nothing."""
    for more, told in (([], True), (["--payload", "60"], False)):
        found = answer("equilibrium fanuc-r2000ic --gravity 0,0,-9.81", *more)
        assert ("weightless" in _codes(found)) is told


def test_a_payload_without_gravity_weighs_alike_everywhere():
    """Each command assumes the earth's gravity, on the links too, and says so."""
    _write("path.csv", [(0.3, -1.1, 1.4, -0.7, 0.9, 0.2)])
    analysed = cartstiff.analyse(cartstiff.load("ur5", payload=3)).to_dict()
    links = {part["name"]: part["mass"] for part in analysed["weighed"]}
    assert links["payload"] == 3.0
    push = ["--load", "0,0,0,0,0,-50"]
    for more in ([], [*push, "--curve", "1"], [*push, "--path", "path.csv"]):
        found = answer("equilibrium ur5 --payload 3", *more)
        assert found["gravity"] == analysed["gravity"] == [0.0, 0.0, -9.81]
        assert {part["name"]: part["mass"] for part in found["weighed"]} == links
        assert found["before_load"] == analysed["before_load"] == "balanced"
        assert "gravity-assumed" in _codes(found)
        given = answer("equilibrium ur5 --payload 3 --gravity 0,0,-9.81", *more)
        key = "commands" if "--path" in more else "displacement"
        assert found[key] == given[key]
    # Who says that there is none has none.
    assert answer("equilibrium ur5 --payload 3 --gravity 0,0,0")["displacement"] == [0.0] * 6
    assert "weightless" not in _codes(answer("equilibrium hexapod --payload 50"))


# -- refusals -------------------------------------------------------------------------------------


# -- between two gravities ------------------------------------------------------------------------


def _line_stiffness(name):
    """K of unloaded legs about the body frame by their lines, sum of k g g^T (moment, force)."""
    mechanism = cartstiff.load(name).mechanism
    elastic = cartstiff.load(name)
    T = mechanism.at(elastic.q).pose
    K = np.zeros((6, 6))
    for a, b, k in zip(mechanism.anchors, mechanism.points, elastic.springs.stiffness, strict=True):
        arm = T[:3, :3] @ b
        line = T[:3, 3] + arm - a
        u = line / np.linalg.norm(line)
        g = np.append(np.cross(arm, u), u)
        K += k * np.outer(g, g)
    return K


def test_sag_between_two_directions_of_gravity():
    """A table that was calibrated upright and is then tilted: K^-1 times the change of weight."""
    command = "equilibrium cubic --payload 20,0,0.05,0.1 --gravity 0,-9.81,0"
    data = answer(f"{command} --against-gravity 0,0,-9.81")
    change = 20 * 9.81 * np.array([0.0, -1.0, 1.0])
    moment = np.cross([0, 0.05, 0.1], change)
    turn, shift = np.split(np.linalg.solve(_line_stiffness("cubic"), [*moment, *change]), 2)
    found = np.array(data["displacement"])
    np.testing.assert_allclose(found[:3], turn, rtol=0, atol=2e-3 * abs(turn).max())
    np.testing.assert_allclose(found[3:], shift, rtol=0, atol=2e-3 * abs(shift).max())
    (note,) = [note for note in data["notes"] if note["code"] == "against-gravity"]
    assert note["values"]["gravity"] == [0.0, 0.0, -9.81]
    text = run(f"{command} --against-gravity 0,0,-9.81")
    assert "the displacement counts from the rest under gravity (0, 0, -9.81) m/s^2" in text
    assert "no payload" not in text  # there is one


def test_sag_from_and_to_no_gravity_at_all():
    command = "equilibrium cubic --payload 20"
    sag, lift = (
        np.array(answer(f"{command} {options}")["displacement"])
        for options in (
            "--gravity 0,0,-9.81 --against-gravity 0,0,0",
            "--gravity 0,0,0 --against-gravity 0,0,-9.81",
        )
    )
    load = "--load 0,0,0,0,0,-196.2 --world"  # the cubic platform itself has no mass
    plain = answer(f"equilibrium cubic {load}")["displacement"]
    np.testing.assert_allclose(sag, plain, rtol=0, atol=1e-12)
    np.testing.assert_allclose(lift, -sag, rtol=0, atol=1e-3 * np.abs(sag).max())


def test_sag_is_the_difference_of_two_equilibria_of_springs_with_rests(tmp_path):
    """The springs of a file with rest positions: both rests are elsewhere than the posture."""
    file = tmp_path / "arm.yaml"
    file.write_text(
        "kind: serial\nmodel: ur5\nframe: tool0\nq: {shoulder_lift_joint: -1.2, elbow_joint: 1.3}\n"
        "springs:\n"
        + "".join(
            f"  {joint}: {{stiffness: 2.0e+4, rest: {rest}}}\n"
            for joint, rest in {
                "shoulder_pan_joint": 0.0,
                "shoulder_lift_joint": -1.2,
                "elbow_joint": 1.3,
                "wrist_1_joint": 0.0,
                "wrist_2_joint": 0.4,
                "wrist_3_joint": 0.0,
            }.items()
        ),
        encoding="utf-8",
    )
    if not example_robots():
        pytest.skip("example-robot-data is not installed")
    data = answer(f"equilibrium {file} --gravity 0,0,-9.81 --against-gravity 0,5,-8")
    elastic = cartstiff.load(file)
    poses = [equilibrium(elastic.with_gravity(g)).posture.pose for g in ([0, 5, -8], [0, 0, -9.81])]
    np.testing.assert_allclose(
        data["displacement"][3:], poses[1][:3, 3] - poses[0][:3, 3], rtol=0, atol=1e-10
    )


@pytest.mark.parametrize("name", ["hexapod", "6-pus"])
def test_pose_of_the_frame_of_interest(name):
    """M at a pivot: --pose-of M puts it there, whatever the turn; the body follows."""
    elastic = cartstiff.load(name)
    x, y, z = elastic.mechanism.at(elastic.q).pose[:3, 3] + [0.01, 0.02, 0.08]
    tool = "--tcp 0.02,0,0.08,0.1,0,0.2"
    data = answer(f"analyse {name} {tool} --pose {x},{y},{z},0.06,-0.03,0.1 --pose-of M")
    expected = cartstiff.geometry.se3.from_roll_pitch_yaw([x, y, z], [0.06, -0.03, 0.1])
    np.testing.assert_allclose(data["pose"], expected, rtol=0, atol=1e-9)
    body = answer(f"analyse {name} {tool} --pose {x},{y},{z},0.06,-0.03,0.1")
    shift = cartstiff.geometry.se3.from_roll_pitch_yaw([0.02, 0, 0.08], [0.1, 0, 0.2])
    np.testing.assert_allclose(body["pose"], expected @ shift, rtol=0, atol=1e-9)
