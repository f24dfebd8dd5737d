"""Four-bars by hand: which joints have springs, which stay where they were named, what is read.

The linkage: crank and rocker of 0.3 on pivots 0.5 apart, joined by a coupler of 0.5. It is a
parallelogram: the coupler only translates, by l d(theta) across the crank. A spring k at the motor
resists it with k / l^2 along the one motion; with unit twist norm as printed, with l^2 / 2.
"""

import re

import numpy as np
import pytest
from tests.support import refused

import cartstiff
from cartstiff import InputError

L, SPAN = 0.3, 0.5
TREE = f"""
 <link name="base"/><link name="crank"/><link name="coupler"/><link name="rocker"/>
 <joint name="motor" type="revolute"><parent link="base"/><child link="crank"/>
  <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
 <joint name="elbow" type="continuous"><parent link="crank"/><child link="coupler"/>
  <origin xyz="0 0 {L}"/><axis xyz="0 1 0"/></joint>
 <joint name="pivot" type="continuous"><parent link="base"/><child link="rocker"/>
  <origin xyz="{SPAN} 0 0"/><axis xyz="0 1 0"/></joint>
"""
CLOSURE = (
    "closures: [{frames: [coupler, rocker], type: point, "
    f"points: [[{SPAN}, 0, 0], [0, 0, {L}]]}}]\n"
)
BALL = (
    "<drake:ball_constraint>"
    '<drake:ball_constraint_body_A name="coupler"/><drake:ball_constraint_body_B name="rocker"/>'
    f'<drake:ball_constraint_p_AP value="{SPAN} 0 0"/>'
    f'<drake:ball_constraint_p_BQ value="0 0 {L}"/></drake:ball_constraint>'
)
MJCF = f"""<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
<body name="crank"><joint name="motor" type="hinge" axis="0 1 0"/>
 <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
 <body name="coupler" pos="0 0 {L}"><joint name="elbow" type="hinge" axis="0 1 0"/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body>
<body name="rocker" pos="{SPAN} 0 0"><joint name="pivot" type="hinge" axis="0 1 0"/>
 <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
<equality><connect body1="coupler" body2="rocker" anchor="{SPAN} 0 0"/></equality></mujoco>"""


def urdf(beside=""):
    return f'<robot name="fourbar" xmlns:drake="http://drake.mit.edu">{TREE}{beside}</robot>'


def file_of(folder, keys="", beside="", name="m.yaml"):
    (folder / "fourbar.urdf").write_text(urdf(beside), encoding="utf-8")
    head = "kind: closed-chain\nmodel: fourbar.urdf\nframe: coupler\n"
    (folder / name).write_text(head + CLOSURE + keys, encoding="utf-8")
    return folder / name


def about_motor(elastic, q=None):
    """Stiffness that the crank's pivot feels: l^2 over the compliance across the crank."""
    result = cartstiff.analyse(elastic, q)
    C = result.compliances["B"]
    assert C is not None
    return L**2 / float(np.linalg.eigvalsh(C[3:, 3:])[-1])


@pytest.mark.parametrize(
    ("keys", "stiffness", "k"),
    [
        ("springs: {motor: {stiffness: 700}}", None, 700.0),
        ("springs: {motor: {stiffness: 700}}", 1000.0, 1000.0),
        ("actuated: [motor]", None, 1e4),
        ("actuated: [motor]", 1000.0, 1000.0),
        ("actuated: [motor]", {"motor": 1000.0}, 1000.0),
        ("", {"motor": 1000.0}, 1000.0),
        ("passive: [elbow, pivot]", None, 1e4),
        ("passive: [elbow, pivot]", 1000.0, 1000.0),
        # Springs in two joints of one motion add; the elbow turns back as the motor turns.
        ("actuated: [motor, pivot]", 1000.0, 2000.0),
        ("springs: {motor: {stiffness: 700}, elbow: {stiffness: 20}}", None, 720.0),
        ("springs: {motor: {stiffness: 700}}\nactuated: [motor, elbow]", None, 10700.0),
    ],
)
def test_springs_are_those_of_actuated_joints(tmp_path, keys, stiffness, k):
    elastic = cartstiff.load(file_of(tmp_path, keys), stiffness=stiffness)
    assert about_motor(elastic) == pytest.approx(k, rel=1e-9)
    codes = [note.code for note in elastic.notes]
    assert ("stiffness-assumed" in codes) == (k >= 1e4)


def test_with_neither_springs_nor_actuated_joints_the_answer_asks(tmp_path):
    elastic = cartstiff.load(file_of(tmp_path))
    (note,) = [note for note in elastic.notes if note.code == "springs-missing"]
    assert "Which are actuated?" in note.message
    result = cartstiff.analyse(elastic)
    assert result.compliances["B"] is None
    assert result.matrices["B"] is None
    refused("no joint is actuated", elastic.with_springs, 1000.0)
    given = elastic.with_springs({"pivot": 50.0})
    assert "springs-missing" not in [note.code for note in given.notes]
    assert about_motor(given) == pytest.approx(50.0, rel=1e-9)


@pytest.mark.parametrize("name", ["6-pus", "five-bar", "6-rus", "delta", "3-rrr", "grasp"])
def test_one_number_is_not_for_passive_joints(name):
    """The bundled machines have one stiffness in their drives: the same number changes nothing."""
    elastic = cartstiff.load(name)
    k = elastic.springs.stiffness
    driven = k > 0
    again = elastic.with_springs(float(k.max()))
    np.testing.assert_array_equal(again.springs.stiffness > 0, driven)
    assert set(again.springs.stiffness[driven]) == {k.max()}


def test_virtual_joints_of_links_are_not_driven(tmp_path):
    K6 = np.diag([5e3, 5e3, 5e3, 1e6, 1e6, 1e6]).tolist()
    keys = f"actuated: [motor]\nflexible: {{coupler: {{stiffness: {K6}}}}}"
    elastic = cartstiff.load(file_of(tmp_path, keys)).with_springs(300.0)
    k = dict(zip(elastic.names, elastic.springs.stiffness, strict=True))
    assert [name for name, value in k.items() if value] == ["motor"]


def test_lines_hold_a_tree_without_springs(tmp_path):
    """One bar on a pivot, held by a line of stiffness c across it at distance l: c l^2."""
    (tmp_path / "bar.urdf").write_text(
        '<robot name="bar"><link name="base"/><link name="bar"/><joint name="j" type="continuous">'
        '<parent link="base"/><child link="bar"/><axis xyz="0 1 0"/></joint></robot>',
        encoding="utf-8",
    )
    (tmp_path / "m.yaml").write_text(
        "kind: closed-chain\nmodel: bar.urdf\nframe: bar\nlines: [{frames: [base, bar], points: "
        "[[1, 0, 0.4], [0, 0, 0.4]], stiffness: 2000}]\n",
        encoding="utf-8",
    )
    elastic = cartstiff.load(tmp_path / "m.yaml")
    assert "springs-missing" not in [note.code for note in elastic.notes]
    result = cartstiff.analyse(elastic)
    assert 1 / result.compliances["B"][1, 1] == pytest.approx(2000 * 0.4**2)


# -- what is named stays --------------------------------------------------------------------------


def closed(motor):
    """The parallelogram: motor, elbow, pivot."""
    return np.array([motor, -motor, motor])


@pytest.mark.parametrize("source", ["file", "URDF", "MJCF"])
@pytest.mark.parametrize(("name", "sign"), [("motor", 1), ("elbow", -1), ("pivot", 1)])
def test_a_named_joint_is_held(tmp_path, source, name, sign):
    if source == "file":
        path = file_of(tmp_path, "springs: {motor: {stiffness: 700}}")
    else:
        path = tmp_path / ("m.urdf" if source == "URDF" else "m.xml")
        path.write_text(urdf(BALL) if source == "URDF" else MJCF, encoding="utf-8")
    elastic = cartstiff.load(path, frame="coupler", stiffness={"motor": 700.0})
    expected = closed(0.4 * sign)
    j = elastic.names.index(name)
    order = [elastic.names.index(n) for n in ("motor", "elbow", "pivot")]
    result = cartstiff.analyse(elastic, {name: 0.4})
    np.testing.assert_allclose(result.q[order], expected, atol=1e-10)
    assert "actuators-adjusted" not in [note.code for note in result.notes]
    # The pose by hand, and the same from everybody who is asked.
    place = [L * np.sin(0.4 * sign), 0, L * np.cos(0.4 * sign)]
    np.testing.assert_allclose(result.pose[:3, 3], place, atol=1e-10)
    state = cartstiff.equilibrium(elastic, q={name: 0.4})
    np.testing.assert_allclose(state.q, result.q, atol=1e-9)
    row = elastic.q.copy()
    row[j] = 0.4
    for backend in ("auto", "engine"):
        many = cartstiff.analyse_many(elastic, [row], outputs=["pose"], path=backend)
        np.testing.assert_allclose(many.q[0], result.q, atol=1e-9)


def test_what_cannot_be_held_is_named(tmp_path):
    elastic = cartstiff.load(file_of(tmp_path, "springs: {motor: {stiffness: 700}}"))
    result = cartstiff.analyse(elastic, {"motor": 0.4, "elbow": 0.1})
    (note,) = [note for note in result.notes if note.code == "actuators-adjusted"]
    moved = dict(zip(elastic.names, result.q, strict=True))
    assert note.values["motor"] == pytest.approx(moved["motor"] - 0.4)
    assert note.values["elbow"] == pytest.approx(moved["elbow"] - 0.1)


def test_the_posture_of_a_file_is_held(tmp_path):
    elastic = cartstiff.load(file_of(tmp_path, "springs: {motor: {stiffness: 7}}\nq: {motor: 0.4}"))
    np.testing.assert_allclose(elastic.q, closed(0.4), atol=1e-10)


# -- loops and springs in a URDF ------------------------------------------------------------------


def test_a_ball_constraint_is_a_closure(tmp_path):
    path = tmp_path / "m.urdf"
    path.write_text(urdf(BALL), encoding="utf-8")
    elastic = cartstiff.load(path, stiffness={"motor": 640.0})
    assert about_motor(elastic, {"motor": 0.3}) == pytest.approx(640.0)
    path.write_text(urdf(BALL + '<transmission name="t"><joint name="motor"/></transmission>'))
    driven = cartstiff.load(path, stiffness=640.0)
    assert about_motor(driven) == pytest.approx(640.0)


@pytest.mark.parametrize(
    "beside",
    [
        f'<gazebo><joint name="c" type="revolute"><pose>0 0 {L} 0 0 0</pose>'
        "<parent>coupler</parent><child>rocker</child></joint></gazebo>",
        '<constraint name="c" type="revolute"><parent link="coupler"/>'
        f'<parent_origin xyz="{SPAN} 0 0"/><child link="rocker"/>'
        f'<child_origin xyz="0 0 {L}"/><child_axis xyz="0 1 0"/>'
        "</constraint>",
        f'<loop_joint name="c" type="continuous"><link1 link="coupler" xyz="{SPAN} 0 0"/>'
        f'<link2 link="rocker" xyz="0 0 {L}"/><axis xyz="0 1 0"/></loop_joint>',
    ],
)
def test_other_closures_are_refused_with_the_lines_to_write(tmp_path, beside):
    path = tmp_path / "m.urdf"
    path.write_text(urdf(beside), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        cartstiff.load(path)
    lines = re.search(r"closures: \[.*\]\}\]", str(caught.value))
    assert lines is not None
    (tmp_path / "m.yaml").write_text(
        f"kind: closed-chain\nmodel: m.urdf\nframe: coupler\nactuated: [motor]\n{lines[0]}\n",
        encoding="utf-8",
    )
    elastic = cartstiff.load(tmp_path / "m.yaml", stiffness=640.0)
    assert about_motor(elastic) == pytest.approx(640.0)


ARM = (
    '<robot name="r" xmlns:drake="http://drake.mit.edu"><link name="base"/><link name="tool0"/>'
    '<joint name="j" type="revolute"><parent link="base"/><child link="tool0"/>'
    '<axis xyz="0 3 4"/><limit lower="-1" upper="1" effort="1" velocity="1"/>{inside}</joint>'
    '<frame name="fA" link="base"/><frame name="fC" link="tool0"/>{beside}</robot>'
)


@pytest.mark.parametrize(
    ("inside", "beside"),
    [
        ("", '<gazebo reference="j"><springStiffness>70</springStiffness></gazebo>'),
        ('<dynamics damping="0.1" spring_stiffness="70"/>', ""),
        ("<gazebo><springStiffness>70</springStiffness></gazebo>", ""),
    ],
)
def test_springs_of_a_urdf_act(inside, beside):
    elastic = cartstiff.load(ARM.format(inside=inside, beside=beside))
    assert elastic.springs.stiffness.tolist() == [70.0]
    assert elastic.springs.rest.tolist() == [0.0]
    assert "stiffness-assumed" not in [note.code for note in elastic.notes]
    rest = beside.replace("</gazebo>", "<springReference>0.2</springReference></gazebo>")
    if beside:
        moved = cartstiff.load(ARM.format(inside=inside, beside=rest))
        assert moved.springs.rest.tolist() == [0.2]


@pytest.mark.parametrize(
    ("beside", "line"),
    [
        (
            '<drake:linear_bushing_rpy><drake:bushing_frameA name="fA"/><drake:bushing_frameC '
            'name="fC"/><drake:bushing_torque_stiffness value="300 700 900"/>'
            "</drake:linear_bushing_rpy>",
            "springs: {j: {stiffness: 828}}",  # (9 * 700 + 16 * 900) / 25
        ),
        (
            '<force_element name="s"><linear_spring_damper rest_length="0.2" stiffness="1000" '
            'damping="0"><link1 link="base" xyz="1 0 0"/><link2 link="tool0" xyz="0 0 0.2"/>'
            "</linear_spring_damper></force_element>",
            "lines: [{frames: [base, tool0], points: [[1, 0, 0], [0, 0, 0.2]], stiffness: 1000, "
            "rest_length: 0.2}]",
        ),
    ],
)
def test_other_springs_are_refused_with_the_lines_to_write(tmp_path, beside, line):
    (tmp_path / "r.urdf").write_text(ARM.format(inside="", beside=beside), encoding="utf-8")
    refused(re.escape(line), cartstiff.load, tmp_path / "r.urdf")
    (tmp_path / "r.yaml").write_text(f"kind: serial\nmodel: r.urdf\n{line}\n", encoding="utf-8")
    cartstiff.load(tmp_path / "r.yaml")


# -- joints that do not move the frame ------------------------------------------------------------

HAND = (
    '<robot name="r"><link name="base"/><link name="tool0"/><link name="l"/><link name="r"/>'
    '<joint name="j" type="revolute"><parent link="base"/><child link="tool0"/>'
    '<axis xyz="0 1 0"/></joint>'
    '<joint name="jl" type="prismatic"><parent link="tool0"/><child link="l"/>'
    '<axis xyz="0 1 0"/></joint>'
    '<joint name="jr" type="{kind}"><parent link="tool0"/><child link="r"/>'
    '<axis xyz="{axis}"/>{more}</joint>{beside}</robot>'
)
USUAL = {"kind": "prismatic", "axis": "0 1 0", "more": "", "beside": ""}
SPRING = '<force_element><linear_spring_damper stiffness="9"><link1 link="tool0"/><link2 link="r"/>'


@pytest.mark.parametrize(
    "fault",
    [
        {"more": '<limit lower="0" upper="-0.0135" effort="1" velocity="1"/>'},
        {"more": '<limit lower="nan" upper="1" effort="1" velocity="1"/>'},
        {"more": '<mimic joint="jr"/>'},
        {"more": '<mimic joint="jl" multiplier="x"/>'},
        {"more": '<dynamics damping="-1"/>'},
        {"more": '<dynamics spring_stiffness="-1"/>'},
        {"more": "<spring/>"},
        {"kind": "gearbox"},
        {"axis": "0 0 0"},
        {"beside": f"{SPRING}</linear_spring_damper></force_element>"},
    ],
)
def test_joints_off_the_way_never_refuse_the_robot(fault):
    text = HAND.format(**(USUAL | fault))
    plain = cartstiff.load(HAND.format(**USUAL), frame="tool0")
    elastic = cartstiff.load(text)
    assert (elastic.mechanism.frame, elastic.names) == ("tool0", ("j",))
    assert "ignored" in [note.code for note in elastic.notes]
    a, b = (cartstiff.analyse(m, [0.2]) for m in (plain, elastic))
    np.testing.assert_array_equal(a.compliances["B"], b.compliances["B"])
    refused("jr", cartstiff.load, text, frame="r")


def test_couplings_of_fingers_in_mjcf_never_refuse_the_robot():
    text = """<mujoco><worldbody><body name="arm"><joint name="q1" type="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .5 0 0" size=".02" mass="1"/><site name="flange" pos=".5 0 0"/>
<body name="f1" pos=".5 0 0"><joint name="j1" type="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .05 0 0" size=".005" mass=".1"/>
<body name="f2" pos=".05 0 0"><joint name="j2" type="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .05 0 0" size=".005" mass=".1"/></body></body></body></worldbody>
<equality><joint joint1="j2" joint2="j1" polycoef="0 -1 0.3 0 0"/></equality></mujoco>"""
    elastic = cartstiff.load(text)
    assert (elastic.mechanism.frame, elastic.names) == ("flange", ("q1",))
    refused("by a curve", cartstiff.load, text, frame="f2")
