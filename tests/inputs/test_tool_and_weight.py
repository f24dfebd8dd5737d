"""Tool, payload and gravity: the same words mean the same on every command."""

import json
import re

import numpy as np
import pytest
from tests.support.commands import answer, run
from tests.support.pages import stated, tab_of

import cartstiff
from cartstiff import InputError
from cartstiff.geometry import se3

TCP = (0.02, -0.01, 0.1, 0.3, -0.2, 0.5)
T = se3.from_roll_pitch_yaw(TCP[:3], TCP[3:])
DOWN = [0.0, 0.0, -9.81]


@pytest.mark.parametrize("name", ["cubic", "stewart-gough", "grasp", "delta", "five-bar"])
def test_the_tool_moves_m(name):
    """Of every kind: the answer is that of the frame at the tool."""
    if name == "delta":
        pytest.importorskip("example_robot_data")
    units = cartstiff.load(name).units
    tcp = T.copy()
    tcp[:3, 3] *= {"m": 1.0, "cm": 100.0}[units.length]
    bare = cartstiff.load(name)
    with_tool = cartstiff.load(name, tcp=tcp)
    before = cartstiff.analyse(bare)
    expected = before.at(tcp)
    found = cartstiff.analyse(with_tool, before.q)
    assert np.allclose(found.pose, before.pose @ tcp, atol=1e-9)
    assert np.allclose(found.wrench, expected.wrench, atol=1e-7 * (1 + np.abs(found.wrench).max()))
    pairs = [(found.compliances["B"], expected.compliances["B"])]
    if name == "grasp":  # a spin that nothing holds
        pairs = [(found.B.matrix, expected.matrices["B"])]
    for a, b in pairs:
        assert np.abs(a - b).max() <= 1e-8 * np.abs(b).max()


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    links, z = ["<link name='l0'/>"], [1, 0, 0, 0, 1, 0]
    for i in range(1, 7):
        links.append(
            f"<link name='l{i}'><inertial><origin xyz='0.1 0 0.05'/><mass value='{i}'/>"
            "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>"
            f"<joint name='j{i}' type='revolute'><parent link='l{i - 1}'/><child link='l{i}'/>"
            f"<origin xyz='0.1 0.05 0.2'/><axis xyz='0 {1 - z[i - 1]} {z[i - 1]}'/>"
            "<limit lower='-3' upper='3' effort='0' velocity='0'/></joint>"
        )
    path.write_text(f"<robot name='arm'>{''.join(links)}</robot>")
    return path


def text_file(arm, **keys):
    path = arm.with_name("arm.yaml")
    path.write_text(json.dumps({"kind": "serial", "model": "arm.urdf", "frame": "l6", **keys}))
    return path


def matrices(elastic):
    result = cartstiff.analyse(elastic, [0.1, 0.7, -0.9, 0.4, 0.8, 0.2], wrench=[1, 2, 3, 4, 5, 6])
    return np.array([result.A.matrix, result.B.matrix]), result.elastic.springs.rest


def same(a, b):
    return all(np.allclose(x, y, rtol=1e-12, atol=1e-9) for x, y in zip(a, b, strict=True))


def test_options_mean_what_the_file_means(arm):
    offset = {"xyz": list(TCP[:3]), "rpy": list(TCP[3:])}
    file = text_file(
        arm, offset=offset, gravity=[1, 0, -9], payload={"mass": 2, "com": [0, 0, 0.1]}
    )
    given = {"tcp": TCP, "gravity": [1, 0, -9], "payload": [2, 0, 0, 0.1]}
    wanted = matrices(cartstiff.load(file))
    assert same(matrices(cartstiff.load(arm, frame="l6", **given)), wanted)
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(arm))
    assert same(matrices(cartstiff.load(model, frame="l6", **given)), wanted)
    assert not same(matrices(cartstiff.load(arm, frame="l6")), wanted)


def test_payloads_add_up_and_stay_where_they_are(arm):
    """A file's payload keeps its place when M moves; another joins it."""
    file = text_file(arm, gravity=DOWN, payload={"mass": 2, "com": [0.1, 0.2, 0.3]})
    both = cartstiff.load(file, tcp=TCP, payload=[3, 0.1, 0, 0])
    centre = (se3.inverse(T) @ [0.1, 0.2, 0.3, 1])[:3]
    com = (2 * centre + 3 * np.array([0.1, 0, 0])) / 5
    again = text_file(
        arm,
        gravity=DOWN,
        offset={"xyz": list(TCP[:3]), "rpy": list(TCP[3:])},
        payload={"mass": 5, "com": com.tolist()},
    )
    assert same(matrices(both), matrices(cartstiff.load(again)))
    assert both.mechanism.masses()["payload"] == 5


@pytest.mark.parametrize("tcp", [None, TCP])
@pytest.mark.parametrize("frame", ["l6", "l5", "l4"])
def test_a_payload_of_a_file_stays_where_it_is_when_m_goes_to_another_frame(arm, frame, tcp):
    """The weight on the joints before the frame is that of the arm as its file has it."""
    offset = {"xyz": [0.1, -0.2, 0.05], "rpy": [0.3, 0.1, -0.4]}
    file = text_file(arm, offset=offset, payload={"mass": 2, "com": [0.1, 0.2, 0.3]})
    whole = cartstiff.load(file)
    moved = cartstiff.load(file, frame=frame, tcp=tcp)
    joints = int(frame[1])
    q = np.zeros(6)
    q[:joints] = [0.1, 0.7, -0.9, 0.4, 0.8, 0.2][:joints]
    torques = whole.mechanism.at(q).gravity(np.array(DOWN)).gradient
    found = moved.mechanism.at(q[:joints]).gravity(np.array(DOWN)).gradient
    assert np.allclose(found, torques[:joints], rtol=1e-12, atol=1e-9)
    assert moved.masses["payload"] == 2
    assert sum(moved.masses.values()) == pytest.approx(sum(whole.masses.values()))


def test_a_payload_added_to_bodies_without_mass_has_weight(arm):
    """The note that gravity acts on no mass goes."""
    bare = {"joints": [{"alpha": 1.5, "d": 0.3}, {"a": 0.5}, {"a": 0.4}], "convention": "standard"}
    path = arm.with_name("bare.yaml")
    path.write_text(json.dumps({"kind": "serial", "dh": bare, "gravity": DOWN}))
    alone = cartstiff.load(path)
    assert "weightless" in [note.code for note in alone.notes]
    hung = alone.with_payload(3.0)
    assert "weightless" not in [note.code for note in hung.notes]


def test_a_payload_brings_the_earth_along(arm):
    alone = cartstiff.load(arm, payload=4)
    assert "gravity-assumed" in [note.code for note in alone.notes]
    assert same(matrices(alone), matrices(cartstiff.load(arm, payload=[4], gravity=DOWN)))


def test_the_file_s_gravity_of_an_mjcf_stays(tmp_path):
    pytest.importorskip("mujoco")
    text = (
        "<mujoco><option gravity='0 0 -1'/><worldbody><body><joint type='hinge' name='a' "
        "axis='0 1 0' stiffness='5'/><geom size='1' pos='1 0 0'/></body></worldbody></mujoco>"
    )
    assert cartstiff.load(text, payload=4).gravity.tolist() == [0, 0, -1]
    assert cartstiff.load(text, gravity=[0, 0, -2]).gravity.tolist() == [0, 0, -2]


def test_every_command_takes_them(arm, tmp_path):
    """They put M, the masses and the load at the same place on every command."""
    name = str(arm)
    tool = ["--tcp", ",".join(map(str, TCP)), "--gravity", "0,0,-9.81", "--payload", "2,0,0,0.1"]
    q = "--q 0.1,0.1,1.7,-1.7,1.4,-1.7"
    load = "--load 0,0,0,0,0,-100 --world --load-at 0,0,0"
    first = json.loads(run("analyse", name, *tool, q, load, "--json --analysis none"))
    at_rest = answer("equilibrium", name, *tool, q, load)
    assert at_rest["weighed"] == first["weighed"]
    assert at_rest["before_load"] == first["before_load"] == "balanced"
    frames = answer("frames", name, *tool, q)
    assert frames["payload"] == 2
    pose = np.array(first["pose"])
    path = tmp_path / "path.csv"
    rpy = se3.roll_pitch_yaw(pose)
    path.write_text(",".join(map(repr, [*pose[:3, 3].tolist(), *rpy.tolist()])))
    posture = answer("path", name, str(path), *tool, q, load)
    assert np.allclose(posture["poses"][0] if "poses" in posture else pose, pose, atol=1e-8)
    pytest.importorskip("zarr")
    grid = ["--grid", "j1=0.1:0.1:1", "--quantity", "deflection", "-o", str(tmp_path / "m.zarr")]
    found = answer("map", name, *tool, q, load, *grid)
    C = np.array(first["compliance"]["K"])
    expected = np.linalg.norm((C @ np.array(first["wrench"]))[3:])
    assert found["quantities"]["deflection"]["mean"] == pytest.approx(expected, rel=1e-9)


def test_pages_start_with_the_load_that_was_stated(arm):

    tool = {"tcp": list(TCP), "payload": [2.0]}
    load = {"load": [0, 0, 0, 0, 0, -100], "load_at": [0, 0, 0.05], "world": True}
    source = stated(str(arm), **tool, **load, load_kind="follower")
    state = tab_of(source).start
    assert (state.load_axes, state.load_kind) == ("world", "follower")
    assert state.load_at == (0, 0, 0.05)
    assert np.allclose(source.elastic.mechanism.body.T_j_f, T, atol=1e-12)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"tcp": [1, 2]}, "tcp"),
        ({"tcp": [1, 2, np.nan]}, "tcp"),
        ({"tcp": np.ones((4, 4))}, "tcp"),
        ({"tcp": "0,0,1"}, "tcp"),
        ({"gravity": [0, 0]}, "gravity"),
        ({"gravity": [0, 0, -9810]}, "gravity is in m/s"),
        ({"gravity": [0, 0, np.inf]}, "gravity"),
        ({"payload": [1, 2]}, "payload"),
        ({"payload": -1}, "payload: mass is negative"),
        ({"payload": [1, 0, 0, np.nan]}, "payload"),
    ],
)
def test_what_cannot_be_meant(arm, given, words):
    with pytest.raises(InputError, match=words) as caught:
        cartstiff.load(arm, **given)
    assert "\n" not in str(caught.value)


def test_frames_of_legs_are_named():
    """A tool moves M, and with it the numbers of the heads; the feet stay in F."""
    hexapod = cartstiff.load("hexapod", tcp=[0, 0, 0.1])
    text = run("frames hexapod --tcp 0,0,0.1")
    head, first = re.search(r"(Legs.*)\n  leg1: \(.*?\) to \((.*?)\)", text).groups()
    assert head == "Legs, from feet in F to heads in M"
    assert [float(x) for x in first.split(",")] == pytest.approx(
        1e3 * hexapod.mechanism.points[0], abs=0.1
    )
