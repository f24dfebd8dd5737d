"""URDF files: what is refused, what must not be, and every robot of example-robot-data."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from tests.support.robots import bundled_files, example_robots

import cartstiff
from cartstiff import InputError


def joint(name, parent, child, axis="0 0 1", kind="revolute"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0.2 0.3" rpy="0.3 0.1 -0.2"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>\n'
    )


INERTIAL = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="2"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)
J1, J2, J3 = joint("j1", "a", "b"), joint("j2", "b", "c", "0 1 0"), joint("j3", "c", "d", "1 0 0")
ARM = (
    f'<robot name="arm">\n<link name="a"/>\n<link name="b">{INERTIAL}</link>\n'
    f'<link name="c"/>\n<link name="d"/>\n{J1}{J2}{J3}</robot>\n'
)


def changed(old, new, count=1, text=ARM):
    assert old in text
    return text.replace(old, new, count)


def mimic(joint, inside):
    return changed(
        f'<joint name="{joint}" type="revolute">', f'<joint name="{joint}" type="revolute">{inside}'
    )


def chain(n, kind="revolute"):
    links = "".join(f'<link name="l{i}"/>' for i in range(n + 1))
    return (
        f'<robot name="r">{links}'
        + "".join(joint(f"j{i}", f"l{i}", f"l{i + 1}", kind=kind) for i in range(n))
        + "</robot>"
    )


def place(text, name="arm.urdf"):
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return name


ORIGIN, AXIS = 'xyz="0.1 0.2 0.3"', '<axis xyz="0 0 1"/>'
LIMIT = '<limit lower="-2" upper="2" effort="1" velocity="1"/>'
BAD = {
    "binary": (bytes(range(256)), ("not UTF-8",)),
    "zero bytes": (bytes(1000), ("zero byte",)),
    "Latin-1": (ARM.replace("arm", "Stäubli").encode("latin-1"), ("not UTF-8",)),
    "UTF-16": (ARM.encode("utf-16"), ("not UTF-8",)),
    "2001 joints": (chain(2001), ("too many joints", "2001")),
    "400 moving joints": (chain(400), ("too many moving joints", "400")),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_urdf_is_refused(case, refused):
    text, words = BAD[case]
    refused("analyse", place(text), words=words)


# -- what must not be refused ---------------------------------------------------------------------

SAME = {
    "byte order mark": b"\xef\xbb\xbf" + ARM.encode(),
    "declaration": '<?xml version="1.0" encoding="utf-8"?>\n<!-- arm -->\n' + ARM,
    "carriage returns": ARM.replace("\n", "\r\n").encode(),
    "name of the robot empty": changed('"arm"', '""'),
    "no limits": changed(LIMIT, "", 3),
    "limits in part": changed(LIMIT, '<limit effort="1"/>', 3),
    "no inertias": changed(INERTIAL, ""),
    "inertia of nonsense": changed('ixx="1"', 'ixx="none"'),
    "mass of the root": changed('<link name="a"/>', f'<link name="a">{INERTIAL}</link>'),
    "axis not of unit length": changed('xyz="0 1 0"', 'xyz="0 25 0"'),
    "meshes that are not there": changed(
        '<link name="a"/>',
        '<link name="a"><visual><geometry><mesh filename="package://x/y.dae"/>'
        '</geometry></visual><collision><geometry><mesh filename="z.stl"/></geometry></collision>'
        "</link>",
    ),
    "shapes that are nothing": changed('<link name="a"/>', '<link name="a"><visual/></link>'),
    "damping": changed(AXIS, AXIS + '<dynamics damping="0.4"/><safety_controller/><calibration/>'),
    "materials": changed("</robot>", '<material name="m"/><material name="m"/></robot>'),
    "transmission and gazebo": changed(
        "</robot>", '<transmission name="t"><joint name="j1"/></transmission><gazebo/></robot>'
    ),
    "xacro named only": changed("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" '),
    "version": changed("<robot ", '<robot version="1.0" '),
    "deep and strange": changed(
        '<link name="a"/>', f'<link name="a">{"<x>" * 5000}{"</x>" * 5000}</link>'
    ),
    "mixed order": ARM.replace(J1, "").replace("</robot>", J1 + "</robot>"),
    "white space in numbers": changed(ORIGIN, 'xyz="  1e-1\n+0.20   .3 "'),
    "mimic of a side joint": changed(
        "</robot>",
        '<link name="x"/><link name="y"/>'
        + joint("s1", "a", "x")
        + joint("s2", "x", "y").replace("<axis", '<mimic joint="s1"/><axis')
        + "</robot>",
    ),
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_arm_in_other_words(case, accepted):
    place(ARM, "plain.urdf")
    options = ("--q", "0.3,-0.2,0.5", "--frame", "d", "--stiffness", "100")
    got, expected = accepted(place(SAME[case]), *options), accepted("plain.urdf", *options)
    for key in ("pose", "jacobian"):
        assert np.allclose(got[key], expected[key], atol=1e-15)
    assert np.allclose(got["compliance"]["B"], expected["compliance"]["B"], atol=1e-15)


@pytest.mark.parametrize("name", ["a b.urdf", "робот.urdf", "ARM.URDF", "arm.xml", b"\xff.urdf"])
def test_names_of_files(name, accepted):
    assert accepted(place(ARM, os.fsdecode(name)))["mechanism"]["joints"] == ["j1", "j2", "j3"]


def test_names_of_links_and_joints(accepted):
    text = ARM.replace('"d"', '"Greifer für 六足 &amp; &lt;x&gt;"').replace('"j3"', '"j 3"')
    data = accepted(place(text), "--q", "j 3=0.5")
    assert data["frame"] == "Greifer für 六足 & <x>"
    assert data["q"] == [0, 0, 0.5]


def test_what_is_no_urdf_is_named(accepted):
    text = changed(AXIS, f"{AXIS}<friction/>").replace(
        '"a"/>', '"a"><pose>1 0 0 0 0 0</pose></link>', 1
    )
    (note,) = (n for n in accepted(place(text), "--frame", "d")["notes"] if n["code"] == "ignored")
    assert note["values"]["elements"] == ["<friction> in <joint>", "<pose> in <link>"]


def test_a_remark_between_tags_is_named(accepted):
    text = changed(AXIS, AXIS + " the first one ")
    (note,) = (n for n in accepted(place(text), "--frame", "d")["notes"] if n["code"] == "ignored")
    assert note["values"]["elements"] == ["text 'the first one' in <joint>"]


def test_frame_is_a_link_where_a_joint_elsewhere_has_its_name(accepted):
    at = ("--q", "0.3,-0.2,0.5", "--frame", "d", "--stiffness", "100")
    expected = accepted(place(ARM, "plain.urdf"), *at)
    got = accepted(place(ARM.replace('"j1"', '"d"')), *at)
    for key in ("pose", "jacobian"):
        assert np.allclose(got[key], expected[key], atol=1e-15)
    assert "ambiguous-frame" in [note["code"] for note in got["notes"]]
    assert "ambiguous-frame" not in [note["code"] for note in expected["notes"]]


def test_planar_joint_moves_across_its_axis(accepted):
    axis = np.array([1.0, -2.0, 0.5])
    text = changed('name="j3" type="revolute"', 'name="j3" type="planar"').replace(
        '<axis xyz="1 0 0"/>', '<axis xyz="1 -2 0.5"/>'
    )
    got = accepted(place(text), "--frame", "d", "--q", "0,0,0.1,-0.3,0.7")
    start = accepted(place(text), "--frame", "d", "--q", "0,0,0,0,0")
    step = np.linalg.inv(start["pose"]) @ got["pose"]
    assert abs(axis @ step[:3, 3]) < 1e-15
    assert np.isclose(np.linalg.norm(step[:3, 3]), np.hypot(0.1, 0.3))
    assert np.allclose(step[:3, :3] @ axis, axis)
    assert np.isclose(np.trace(step[:3, :3]), 1 + 2 * np.cos(0.7))
    without = accepted(place(text.replace('<axis xyz="1 -2 0.5"/>', "")), "--frame", "d")
    assert "planar-axis" in [note["code"] for note in without["notes"]]


@pytest.mark.parametrize("name", ["universe", "world", "root_joint", "c"])
def test_names_that_pinocchio_uses_too(name, accepted):
    expected = accepted(place(ARM), "--frame", "d")["pose"]
    assert np.allclose(
        accepted(place(ARM.replace('"j2"', f'"{name}"')), "--frame", "d")["pose"], expected
    )


@pytest.mark.parametrize(("factor", "offset"), [(1.0, 0.0), (-2.0, 0.3), (0.5, -0.1), (0.0, 0.2)])
def test_mimic_joint_moves_as_the_same_arm_without_mimic(factor, offset, accepted):
    tag = f'<mimic joint="j1" multiplier="{factor}" offset="{offset}"/>'
    q1, q2 = 0.4, -0.7
    got = accepted(place(mimic("j3", tag)), "--q", f"{q1},{q2}", "--frame", "d")
    plain = accepted(place(ARM), "--q", f"{q1},{q2},{factor * q1 + offset}", "--frame", "d")
    assert got["mechanism"]["joints"] == ["j1", "j2"]
    assert np.allclose(got["pose"], plain["pose"], atol=1e-14)
    J = np.array(plain["jacobian"])
    expected = np.stack([J[:, 0] + factor * J[:, 2], J[:, 1]], axis=1)
    assert np.allclose(got["jacobian"], expected, atol=1e-14)


@pytest.mark.parametrize("factor", [1.0, -2.0])
def test_a_locked_follower_locks_its_leader(factor, tmp_path, monkeypatch):
    """The coupling is rigid: neither moves without the other."""
    monkeypatch.chdir(tmp_path)
    tag = f'<mimic joint="j1" multiplier="{factor}" offset="0.3"/>'
    at = factor * 0.4 + 0.3
    file = place(mimic("j3", tag))
    free = cartstiff.load(place(ARM, "plain.urdf"), frame="d").mechanism
    for locked in ({"j1": 0.4}, {"j3": at}, {"j1": 0.4, "j3": at}):
        held = cartstiff.load(file, frame="d", locked=locked)
        assert held.names == ("j2",)
        expected = free.at([0.4, -0.7, at]).pose
        assert np.allclose(held.mechanism.at([-0.7]).pose, expected, atol=1e-12)
    with pytest.raises(InputError, match=r"'j3' follows 'j1'.*expected j1 at 0\.4.*got 0\.5"):
        cartstiff.load(file, frame="d", locked={"j1": 0.5, "j3": at})


@pytest.mark.parametrize(
    ("factor", "offset", "lower", "upper"),
    [(4.0, 0.0, -0.5, 0.5), (-4.0, 1.0, -0.25, 0.75), (1.0, 0.0, -2.0, 2.0), (1.0, 4.0, -2.0, 2.0)],
)
def test_limits_of_a_follower_are_limits_of_its_leader(factor, offset, lower, upper, tmp_path):
    """Unless they leave nothing of the leader's own, as in a file where a sign is wrong."""
    tag = f'<mimic joint="j1" multiplier="{factor}" offset="{offset}"/>'
    file = place(mimic("j3", tag), str(tmp_path / "arm.urdf"))
    arm = cartstiff.load(file, frame="d")
    first = arm.mechanism.coordinates[0]
    assert np.allclose([first.lower, first.upper], [lower, upper])
    assert ("limits-contradict" in [note.code for note in arm.notes]) == (offset == 4.0)


def test_a_spring_of_a_follower_that_stays_has_no_effect(tmp_path):
    spring = '<dynamics springStiffness="50" springReference="0.1"/>'
    tag = '<mimic joint="j1" multiplier="0" offset="0.2"/>' + spring
    text = mimic("j3", tag).replace('"j1" type="revolute">', f'"j1" type="revolute">{spring}')
    arm = cartstiff.load(place(text, str(tmp_path / "arm.urdf")), frame="d")
    assert arm.springs.stiffness[0] == 50.0
    assert arm.springs.rest[0] == 0.1


@pytest.mark.parametrize("frame", ["d", "b"])
def test_masses_on_followers_elsewhere_move_with_their_leader(frame, tmp_path):
    """As a rod of a parallelogram beside the chain does; also where the leader is held."""
    pin = pytest.importorskip("pinocchio")
    side = f'<link name="s">{INERTIAL}</link>{joint("side", "b", "s", "0 1 1")}</robot>'
    text = ARM.replace("</robot>", side)
    place(
        text.replace('<axis xyz="0 1 1"', '<mimic joint="j2" multiplier="-2"/><axis xyz="0 1 1"'),
        str(tmp_path / "arm.urdf"),
    )
    q = {"j1": 0.3, "j2": 0.5, "j3": -0.2, "side": -1.0}
    held = "{j1: 0.3, j2: 0.5, j3: -0.2}"
    (tmp_path / "arm.yaml").write_text(
        f"kind: serial\nmodel: arm.urdf\nframe: {frame}\nq: {held}\n", "utf-8"
    )
    arm, g = cartstiff.load(tmp_path / "arm.yaml"), np.array([0.3, -9.0, 2.0])
    model = pin.buildModelFromXML(text)
    model.gravity.linear = g
    at = np.array([q[name] for name in list(model.names)[1:]])
    torques = pin.computeGeneralizedGravity(model, model.createData(), at)
    expected = dict(zip(list(model.names)[1:], torques.tolist(), strict=True))
    expected["j2"] -= 2.0 * expected["side"]
    found = arm.mechanism.at(arm.q).gravity(g).gradient
    assert np.allclose(found, [expected[name] for name in arm.names], atol=1e-12)


def test_mimic_of_a_mimic(accepted):
    text = mimic("j3", '<mimic joint="j2" multiplier="2" offset="0.1"/>').replace(
        '"j2" type="revolute">',
        '"j2" type="revolute"><mimic joint="j1" multiplier="-1" offset="0.2"/>',
    )
    got = accepted(place(text), "--q", "0.5", "--frame", "d")
    plain = accepted(place(ARM), "--q", "0.5,-0.3,-0.5", "--frame", "d")
    assert np.allclose(got["pose"], plain["pose"], atol=1e-14)


def test_mimic_of_a_joint_that_is_not_there_is_free_and_said(accepted):
    got = accepted(place(mimic("j3", '<mimic joint="nobody"/>')), "--frame", "d")
    assert got["mechanism"]["joints"] == ["j1", "j2", "j3"]
    assert "mimic-ignored" in [note["code"] for note in got["notes"]]


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_mimic_of_a_fixed_joint_stands_at_its_offset(kind, accepted):
    free = changed('name="j3" type="revolute"', f'name="j3" type="{kind}"')
    tied = free.replace('name="j2" type="revolute"', 'name="j2" type="fixed"').replace(
        f'"j3" type="{kind}">',
        f'"j3" type="{kind}"><mimic joint="j2" multiplier="3" offset="0.4"/>',
    )
    got = accepted(place(tied), "--q", "0.6", "--frame", "d")
    plain = accepted(place(free), "--q", "0.6,0,0.4", "--frame", "d")
    assert got["mechanism"]["joints"] == ["j1"]
    assert np.allclose(got["pose"], plain["pose"], atol=1e-14)


def test_long_chain_of_fixed_joints(accepted):
    text = chain(1000, "fixed").replace('type="fixed"', 'type="revolute"', 1)
    assert accepted(place(text))["mechanism"]["joints"] == ["j0"]


# -- everything that comes with the library -------------------------------------------------------

MOVES = re.compile(r"type=.(revolute|continuous|prismatic|floating|planar)\b")
ROBOTS = [name for name, path in example_robots().items() if path is not None]


def check_finite(data):
    assert np.isfinite(data["pose"]).all()
    for group in ("stiffness", "compliance"):
        assert set(data[group]) == {"A", "B", "K", "F"}
        for matrix in data[group].values():
            assert matrix is None or (np.shape(matrix) == (6, 6) and np.isfinite(matrix).all())
    if data["stiffness"]["B"] is None:
        assert data["notes"]
    for note in data["notes"]:
        assert set(note) == {"code", "message", "values"}


@pytest.mark.parametrize("name", bundled_files())
def test_bundled_mechanism(name, accepted):
    data = accepted(name)
    check_finite(data)
    rng = np.random.default_rng(7)
    if data["mechanism"]["kind"] in ("serial", "stewart-gough", "springs"):
        far = 1e-3 if name == "flexure-hexapod" else 0.1  # what bends does not go far
        q = np.array(data["q"]) + rng.uniform(-far, far, len(data["q"]))
        check_finite(accepted(name, "--q", ",".join(map(repr, q.tolist()))))


@pytest.mark.skipif(not ROBOTS, reason="example-robot-data is not installed")
@pytest.mark.parametrize("name", ROBOTS)
def test_example_robot_at_a_random_posture(name, accepted, refused):
    path = example_robots()[name]
    if path is None or not path.is_file():
        refused("analyse", name, words=(name,))
        return
    if not MOVES.search(path.read_text(encoding="utf-8")):
        refused("analyse", name, words=("no movable joints",))
        return
    n = len(cartstiff.load(name).q)
    q = np.random.default_rng(sum(name.encode())).uniform(-1, 1, n)
    data = accepted(name, "--q", ",".join(map(repr, q.tolist())))
    assert data["q"] == q.tolist()
    assert np.shape(data["jacobian"]) == (6, n)
    check_finite(data)


# -- the frame that is taken where none is named --------------------------------------------------


def hand(*more):
    """The arm with a hand of two fingers on link d, and further links fixed to d."""
    fingers = (
        '<link name="hand"/>'
        + joint("hand_joint", "d", "hand", kind="fixed")
        + '<link name="left_finger"/>'
        + joint("finger_joint1", "hand", "left_finger", kind="prismatic")
    )
    fixed = "".join(
        f'<link name="{name}"/>{joint(f"to_{name}", "d", name, kind="fixed")}' for name in more
    )
    return ARM.replace("</robot>", f"{fingers}{fixed}</robot>")


@pytest.mark.parametrize(
    ("links", "frame"),
    [
        ((), "hand"),
        (("fr3_hand_tcp",), "fr3_hand_tcp"),
        (("flange", "tool0", "link_ee"), "tool0"),
        (("wrist_ft_sensor", "camera_link"), "hand"),
        (("robot_ee", "robot_flange", "imu_link"), "robot_ee"),
        (("coffee", "settcp2"), "settcp2"),
    ],
)
def test_default_frame_is_a_tool_before_fingers_and_sensors(links, frame, accepted):
    data = accepted(place(hand(*links)))
    assert data["frame"] == frame
    assert data["mechanism"]["joints"] == ["j1", "j2", "j3"]
    (note,) = (n for n in data["notes"] if n["code"] == "default-frame")
    assert note["values"]["frame"] == frame


def test_a_hand_alone_is_all_fingers(accepted):
    text = ARM.replace('"j3"', '"finger_tip"').replace('"j1"', '"finger_base"')
    assert accepted(place(text))["frame"] == "d"


@pytest.mark.skipif(not ROBOTS, reason="example-robot-data is not installed")
@pytest.mark.parametrize(
    ("name", "frame"),
    [
        ("ur5", "tool0"),
        ("ur10", "tool0"),
        ("kinova", "j2s6s200_end_effector"),
        ("xarm7", "link_eef"),
        ("tiago_no_hand", "arm_tool_link"),
        # Bars of a gripper that the smaller file holds still; a range finder in the palm.
        ("talos", "gripper_left_base_link"),
        ("talos_full", "gripper_left_base_link"),
        ("baxter", "left_gripper"),
    ],
)
def test_default_frame_of_example_robots(name, frame):
    path = example_robots()[name]
    assert path is not None
    assert cartstiff.load(path).mechanism.frame == frame


def test_limits_that_look_like_degrees_are_named(tmp_path):
    """Radians in URDF: joints with lower="-170" would turn 27 times."""
    text = """<robot name='a'><link name='b'/><link name='c'/>
    <joint name='j' type='revolute'><parent link='b'/><child link='c'/><axis xyz='0 0 1'/>
    <limit lower='LOW' upper='HIGH' effort='1' velocity='1'/></joint></robot>"""
    for low, high, said in (("-170", "170", True), ("-3.1", "3.1", False), ("-1e6", "1e6", False)):
        path = tmp_path / "a.urdf"
        path.write_text(text.replace("LOW", low).replace("HIGH", high))
        codes = [note.code for note in cartstiff.load(path).notes]
        assert ("limits-of-turns" in codes) is said
