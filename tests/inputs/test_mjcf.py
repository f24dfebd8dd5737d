"""MJCF files: what is refused, and kinematics and springs against MuJoCo itself."""

import json
import os
from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.inner import reading as mjcf
from tests.inner import worker
from tests.inputs.mjcf_tool import verdict

import cartstiff
from cartstiff import InputError, load

ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <default>
    <joint stiffness="5"/>
    <default class="soft"><joint stiffness="7" axis="0 1 0"/></default>
  </default>
  <worldbody>
    <body name="a" pos="0 0 1">
      <joint name="j1" axis="0 0 1" range="-1 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="b" pos="1 0 0">
        <joint name="j2" class="soft"/>
        <geom type="sphere" size=".1"/>
        <site name="tip" pos="0 0 1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


#: What may break down, or take all memory, is read as users' files are: by a process of its own.
APART = (
    "a thousand million copies",
    "deep bodies",
    "1000 joints",
    "huge axis",
    "stiffness NaN",
    "range NaN",
)


@pytest.fixture(autouse=True)
def same_process(request, monkeypatch):
    """MuJoCo compiles in this process, which is quicker, but for some of the files that are bad."""

    def answer(_file, arguments, *_):
        shown = os.dup(2)
        with Path(os.devnull).open("w") as nowhere:  # for what MuJoCo prints
            os.dup2(nowhere.fileno(), 2)
        try:
            return json.loads(json.dumps(worker.compiled(*arguments)))
        except Exception as error:
            return {"error": str(error) or type(error).__name__}
        finally:
            os.dup2(shown, 2)
            os.close(shown)

    parameters = request.node.callspec.params if hasattr(request.node, "callspec") else {}
    if parameters.get("case") not in APART:
        monkeypatch.setattr(mjcf, "answer_of", answer)


def changed(old, new, count=1):
    assert old in ARM
    return ARM.replace(old, new, count)


def place(text, name="arm.xml"):
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return name


MALFORMED = ["a b c", "0 0", "0 0 0 0", "nan 0 0", "0 inf 0", "0 0 1e200", "0,0,1"]
PLACES = {
    "body pos": ('<body name="a" pos="0 0 1">', '<body name="a" pos="{}">'),
    "body euler": ('<body name="a"', '<body name="a" euler="{}"'),
    "body zaxis": ('<body name="a"', '<body name="a" zaxis="{}"'),
    "joint axis": ('axis="0 0 1" range', 'axis="{}" range'),
    "joint pos": ('name="j1"', 'name="j1" pos="{}"'),
    "default axis": ('stiffness="7" axis="0 1 0"', 'axis="{}"'),
    "site pos": ('name="tip" pos="0 0 1"', 'name="tip" pos="{}"'),
    "inertial pos": ('inertial pos="0 0 0"', 'inertial pos="{}"'),
    "inertia": ('diaginertia="1 1 1"', 'diaginertia="{}"'),
}


def in_mujoco(text):
    model = mujoco.MjModel.from_xml_string(text)
    return mujoco, model, mujoco.MjData(model)


@pytest.mark.parametrize("text", MALFORMED)
@pytest.mark.parametrize("where", PLACES)
def test_malformed_numbers_are_refused_or_are_what_mujoco_makes_of_them(where, text, refused):
    old, new = PLACES[where]
    path = Path(place(changed(old, new.format(text))))
    kind, words = verdict(path)
    assert kind in ("same", "refused", "refused by both"), words
    if kind != "same":
        refused("analyse", str(path), words=("arm.xml",))


BODY_A, JOINT_1, TIP = '<body name="a" pos="0 0 1"', 'name="j1"', '<site name="tip" pos="0 0 1"/>'
END = "</worldbody>"
# What MuJoCo refuses comes with its own words; the rest is what it lets pass.
BAD = {
    "deep bodies": (changed(TIP, "<body>" * 3000 + "</body>" * 3000), ()),
    "1000 joints": (
        changed(
            TIP, "".join(f'<body><joint name="q{i}"/><geom size="1"/></body>' for i in range(1000))
        ),
        ("too many coordinates", "200", "1002"),
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_mjcf_is_refused(case, refused):
    text, words = BAD[case]
    refused("analyse", place(text), words=words)


# -- what must not be refused ---------------------------------------------------------------------

SAME = {
    "byte order mark": b"\xef\xbb\xbf" + ARM.encode(),
    "carriage returns": ARM.replace("\n", "\r\n").encode(),
    "no names of bodies": changed(' name="a"', ""),
    "meshes that are not there": changed(END, END + '<asset><mesh file="none.stl"/></asset>'),
    "mesh shape": changed(
        '<geom type="sphere" size=".1"/>',
        '<geom type="sphere" size=".1"/><geom type="mesh" mesh="none" mass="0"/>',
    ).replace(END, END + '<asset><mesh file="none.stl"/></asset>'),
    "texture that is not there": changed(
        END, END + '<asset><texture name="t" type="2d" file="x.png"/></asset>'
    ),
    "two worldbodies": changed(BODY_A, "</worldbody><worldbody>" + BODY_A.replace("\n", "")),
    "lights and cameras": changed(
        "<worldbody>", "<worldbody><light/><camera/><geom type='plane' size='1 1 1'/>"
    ),
    "inactive tie": changed(
        END, END + '<equality><weld body1="a" body2="b" active="false"/></equality>'
    ),
    "quaternion not of unit length": changed(BODY_A, BODY_A + ' quat="3 0 0 0"'),
    "frame": changed(TIP, f'<frame pos="1 0 0"><frame pos="-1 0 0">{TIP}</frame></frame>'),
    "a joint named universe": changed('"j1"', '"universe"'),
    "a body named universe": changed('name="a"', 'name="universe"'),
    "a joint named like a body": changed('"j1"', '"b"'),
    "a joint named like a site": changed('"j1"', '"tip"'),
    "spring of a tendon elsewhere": changed(
        END,
        '<body name="c" pos="5 0 0"><joint name="j9"/><geom size="1"/></body></worldbody><tendon>'
        '<fixed name="t" stiffness="3"><joint joint="j9" coef="1"/></fixed></tendon>',
    ),
    "spring on a bystander": changed(
        END,
        '<body name="c" pos="5 0 0"><joint name="j9" stiffness="9"/><geom size="1"/></body>'
        "</worldbody>",
    ),
    "stiffness switched on": changed(
        "<worldbody>", '<option><flag gravity="enable" spring="enable"/></option><worldbody>'
    ),
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_arm_in_other_words(case, accepted):
    options = ("--q", "0.3,-0.2", "--frame", "tip")
    place(ARM, "plain.xml")
    got, expected = accepted(place(SAME[case]), *options), accepted("plain.xml", *options)
    assert np.allclose(got["pose"], expected["pose"], atol=1e-14)
    assert np.allclose(got["compliance"]["B"], expected["compliance"]["B"], rtol=1e-12, atol=1e-14)


def test_includes_and_their_defaults(accepted):
    place(ARM, "plain.xml")
    head, _ = ARM.split("<worldbody>")
    default = head[head.index("<default>") : head.rindex("</default>") + 10]
    place(f"<mujocoinclude>{default}</mujocoinclude>", "defaults.xml")
    Path("parts").mkdir()
    text = ARM.replace(default, '<include file="defaults.xml"/>')
    options = ("--q", "0.3,-0.2", "--frame", "tip")
    got, expected = accepted(place(text), *options), accepted("plain.xml", *options)
    assert got["pose"] == expected["pose"]
    assert got["compliance"]["B"] == expected["compliance"]["B"]


def test_joints_without_names_get_some(accepted):
    text = changed(' name="j2"', "").replace('"j1"', '"joint2"')
    assert accepted(place(text))["mechanism"]["joints"] == ["joint2", "joint3"]


# -- against MuJoCo -------------------------------------------------------------------------------

TWO = """<mujoco><compiler {compiler}/><worldbody>
<body name="a" pos="0.1 0.2 1" {orientation}>{joints}<geom size=".1"/>
<body name="e" pos="1 0 .5"><joint name="last" axis="0 1 0.3" pos=".1 .2 .3"/><geom size=".1"/>
</body></body></worldbody></mujoco>"""

JOINTS = {
    "hinge": '<joint name="j" axis="0 0 1"/>',
    "hinge askew": '<joint name="j" axis="1 2 -3" pos="0.3 -0.1 0.2"/>',
    "hinge with springref": '<joint name="j" axis="0 1 1" stiffness="3" springref="0.4"/>',
    "hinge with ref": '<joint name="j" axis="0 1 1" ref="0.3" stiffness="3" springref="0.4"/>',
    "slide": '<joint name="j" type="slide" axis="1 0 2"/>',
    "slide with ref": '<joint name="j" type="slide" ref="0.3" stiffness="3" springref="0.4"/>',
    "two hinges": '<joint name="j" axis="0 0 1" pos="1 0 0"/>'
    '<joint name="k" axis="0 1 0" pos="0 1 0"/>',
    "slide and hinge": '<joint name="j" type="slide" axis="0 1 1"/><joint name="k" pos="0 1 0"/>',
    "ball": '<joint name="j" type="ball"/>',
    "free": '<joint name="j" type="free"/>',
    "three hinges": '<joint name="j"/><joint name="k" axis="1 0 0"/><joint name="l" axis="0 1 0"/>',
    "springs in several": '<joint name="j" stiffness="2" springref="0.2"/><joint name="k" '
    'axis="1 0 0" stiffness="4"/>',
}
ORIENTATIONS = {
    "degrees": ('angle="degree"', 'euler="10 20 30"'),
    "radians": ('angle="radian"', 'euler="0.1 0.2 0.3"'),
    "sequence": ('angle="radian" eulerseq="ZYX"', 'euler="0.1 0.2 0.3"'),
    "quaternion": ("", 'quat="1 2 0.5 -1"'),
    "axis and angle": ("", 'axisangle="1 2 3 40"'),
    "two axes": ("", 'xyaxes="1 1 0 0 1 1"'),
    "z axis": ("", 'zaxis="1 2 3"'),
}


@pytest.mark.parametrize(
    ("joints", "orientation"),
    [*product(JOINTS, ("degrees", "radians")), *product(["hinge"], ORIENTATIONS)],
)
def test_kinematics_springs_and_orientations_are_those_of_mujoco(joints, orientation):
    compiler, turned = ORIENTATIONS[orientation]
    text = TWO.format(compiler=compiler, orientation=turned, joints=JOINTS[joints])
    assert verdict(Path(place(text))) == ("same", "")


def test_what_the_file_switches_off_or_cannot_be_served_is_named(tmp_path):
    path = tmp_path / "arm.xml"
    option = '<option wind="1 0 0" density="1.2"><flag spring="disable"/></option>'
    text = ARM.replace("<worldbody>", option + "<worldbody>", 1)
    path.write_text(text.replace(JOINT_1, JOINT_1 + ' stiffness="5"'), encoding="utf-8")
    notes = {note.code: note.message for note in load(path).notes}
    assert "wind" in notes["ignored"]
    assert "springs, which the file switches off" in notes["ignored"]


def test_a_loose_thing_is_no_tool(tmp_path):
    """A cube to be gripped has six coordinates, as many as the arm that stands beside it."""
    cube = '<body name="cube" pos="1 0 0"><freejoint/><geom size="0.02"/></body>'
    arm = "".join(
        f'<body name="b{i}" pos="0 0 0.1"><joint axis="{i % 2} 1 {(i + 1) % 3}" '
        'stiffness="100"/><geom size="0.02"/>'
        for i in range(3)
    )
    path = tmp_path / "scene.xml"
    path.write_text(f"<mujoco><worldbody>{cube}{arm}{'</body>' * 3}</worldbody></mujoco>")
    found = load(path)
    assert found.mechanism.frame == "b2"
    assert len(found.names) == 3


def test_the_base_of_a_floating_robot_is_held_until_it_is_let_go():
    """The arm of a floating torso is that of a torso welded to the room, with one note more."""
    free = TWO.format(compiler="", orientation="", joints='<joint name="j"/>')
    text = f"<mujoco><worldbody><body pos='0 0 1'>{{root}}{free.split('<worldbody>')[1]}"
    text = text.replace("</worldbody>", "</body></worldbody>")
    floating = load(place(text.replace("{root}", "<freejoint name='root'/>")), frame="e")
    fixed = load(place(text.replace("{root}", "")), frame="e")
    assert floating.names == fixed.names == ("j", "last")
    (note,) = [note for note in floating.notes if note.code == "root-held"]
    assert note.message.startswith("the free-flying joint 'root' is held; floating: true")
    q = np.array([0.3, -0.4])
    np.testing.assert_allclose(
        floating.mechanism.at(q).pose, fixed.mechanism.at(q).pose, rtol=0, atol=1e-14
    )


def test_the_base_of_a_floating_urdf_is_held_too(tmp_path):
    path = tmp_path / "r.urdf"
    path.write_text(
        '<robot name="r"><link name="room"/><link name="torso"/><link name="hand"/>'
        '<joint name="root" type="floating"><parent link="room"/><child link="torso"/>'
        '<origin xyz="0 0 1"/></joint><joint name="j" type="continuous">'
        '<parent link="torso"/><child link="hand"/><axis xyz="0 1 0"/></joint></robot>'
    )
    elastic = load(path)
    assert elastic.names == ("j",)
    assert "root-held" in [note.code for note in elastic.notes]
    np.testing.assert_allclose(elastic.mechanism.at([0.0]).pose[:3, 3], [0, 0, 1])
    file = path.with_suffix(".yaml")
    file.write_text("kind: closed-chain\nmodel: r.urdf\nfloating: true\n", encoding="utf-8")
    assert list(load(file).names) == [
        *(f"root.{a}" for a in ("x", "y", "z", "rx", "ry", "rz")),
        "j",
    ]


# -- actuators and tendons ------------------------------------------------------------------------

HELD = """<mujoco><option gravity="0 0 -9.81"/><worldbody><site name="post" pos="0.2 0.1 1.4"/>
<body name="torso" pos="0 0 0.8">{root}<geom size=".1" mass="4"/>
<body name="upper" pos="0 0.1 0.2"><joint name="a" axis="0 1 0" stiffness="{own}" springref="10"/>
<geom size=".05" mass="1" pos=".1 0 0"/>
<body name="hand" pos="0.3 0 0"><joint name="b" axis="0.2 0.1 1"/><joint name="c" type="slide"
axis="1 0 0"/><geom size=".05" mass="1" pos=".1 0.1 0"/><site name="tip" pos="0.1 0.1 0"/></body>
</body></body></worldbody>{beside}</mujoco>"""
POSITIONS = """<actuator><position joint="a" kp="300"/><position joint="b" kp="200" gear="2"/>
<position joint="b" kp="50"/><general joint="c" gainprm="900" biastype="affine"
biasprm="0 -900 -3"/><motor joint="a" gear="7"/></actuator>"""


def differences(text, q, force):
    """Minus the derivative of one of MuJoCo's joint forces by the positions."""
    mujoco, model, data = in_mujoco(text)
    rows = []
    for j in range(model.nv):
        values = []
        for step in (1e-6, -1e-6):
            data.qpos[:] = q
            data.qpos[j] += step
            mujoco.mj_forward(model, data)
            values.append(np.array(getattr(data, force)))
        rows.append((values[1] - values[0]) / 2e-6)
    return np.array(rows).T


@pytest.mark.parametrize("own", [0, 20])
def test_position_actuators_are_springs_on_request(own):
    text = HELD.format(root="", own=own, beside=POSITIONS)
    path = place(text)
    q = [0.2, -0.3, 0.05]
    elastic = load(path, springs="actuators")
    found = np.diag(differences(text, q, "qfrc_actuator"))
    assert found[0] == pytest.approx(300.0)  # what MuJoCo says of kp
    np.testing.assert_allclose(elastic.springs.stiffness, [found[0] + own, *found[1:]], rtol=1e-6)
    codes = [note.code for note in elastic.notes]
    assert "actuator-springs" in codes
    assert "stiffness-assumed" not in codes
    (ignored,) = [note.message for note in elastic.notes if note.code == "ignored"]
    assert ignored.endswith("no part: actuators (5)")  # the motor
    assert "stiffness-assumed" in [note.code for note in load(path).notes]
    # The rest positions balance what acts: the arm stands where it is, under its weight.
    assert "unbalanced" not in [note.code for note in cartstiff.analyse(elastic, q).notes]
    file = Path(path).with_suffix(".yaml")
    file.write_text(f"kind: serial\nmodel: {path}\nactuator_springs: true\n", encoding="utf-8")
    np.testing.assert_allclose(load(file).springs.stiffness, elastic.springs.stiffness)


def test_robots_without_position_actuators_have_no_such_springs():
    motors = '<actuator><motor joint="a"/><velocity joint="b" kv="3"/></actuator>'
    for beside in ("", motors):
        text = HELD.format(root="", own=1, beside=beside)
        with pytest.raises(InputError, match="no actuator holds a position"):
            load(place(text), springs="actuators")
    with pytest.raises(InputError, match="kind stewart-gough has no actuators"):
        load("stewart-gough", springs="actuators")


@pytest.mark.parametrize("length", ["0.3", "0 0.3", "0 5", "-1"])
def test_straight_tendons_are_lines(length):
    """Spring force and its derivative at the joints, taut and slack, are those of MuJoCo."""
    tendon = (
        f'<tendon><spatial name="t" stiffness="700" springlength="{length}">'
        '<site site="post"/><site site="tip"/></spatial></tendon>'
    )
    text = HELD.format(root="", own=0, beside=tendon)
    elastic = load(place(text), stiffness=[0, 0, 0])
    (line,) = elastic.potentials
    q = [0.2, -0.3, 0.05]
    energy = line.evaluate(elastic.mechanism.at(q))
    hessian = differences(text, q, "qfrc_spring")
    np.testing.assert_allclose(energy.hessian, hessian, atol=1e-5 * max(1.0, abs(hessian).max()))
    mujoco, model, data = in_mujoco(text)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(energy.gradient, -data.qfrc_spring, atol=1e-9)
    assert (length == "0 5") == (not data.qfrc_spring.any())


def test_a_joint_that_an_equality_holds_has_no_position_in_a_file():
    path = place(HELD.format(root="", own=0, beside='<equality><joint joint1="a"/></equality>'))
    file = Path(path).with_suffix(".yaml")
    file.write_text(f"kind: serial\nmodel: {path}\nq: {{a: 0.3}}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"key q: unknown joint.*'a'"):
        load(file)


def test_ranges_of_tendons_are_named_where_they_play_no_part():
    tendon = (
        '<tendon><spatial name="rope" stiffness="7" limited="true" range="0 0.4">'
        '<site site="post"/><site site="tip"/></spatial></tendon>'
    )
    notes = load(place(HELD.format(root="", own=0, beside=tendon))).notes
    (ignored,) = [note.message for note in notes if note.code == "ignored"]
    assert ignored.endswith("no part: ranges of tendons (rope)")


def test_a_free_body_on_tendons_is_not_held():
    tendons = "".join(
        f'<spatial stiffness="700"><site site="{a}"/><site site="{b}"/></spatial>'
        for a, b in (("post", "tip"), ("post", "torso_site"))
    )
    text = HELD.format(
        root='<freejoint/><site name="torso_site" pos="0 0 0.1"/>',
        own=5,
        beside=f"<tendon>{tendons}</tendon>",
    )
    elastic = load(place(text), frame="torso")
    assert len(elastic.names) == 9
    assert len(elastic.potentials) == 2
    bent = tendons.replace('<site site="tip"/>', '<site site="tip"/><site site="torso_site"/>', 1)
    with pytest.raises(InputError, match="stiffness of tendon 1 acts on joint"):
        load(place(text.replace(tendons, bent)), frame="torso")


def test_a_model_of_many_meshes_is_gone_through_once(tmp_path):
    """A thousand meshes on a thousand shapes took half a minute."""
    from tests.inner import worker

    meshes = "".join(f'<mesh name="m{i}" file="m{i}.stl"/>' for i in range(20))
    geoms = "".join(f'<geom type="mesh" mesh="m{i}"/>' for i in range(20))
    (tmp_path / "many.xml").write_text(
        f'<mujoco><asset>{meshes}</asset><worldbody><body name="b"><joint axis="0 0 1"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{geoms}</body></worldbody></mujoco>'
    )

    class Counting:
        def __init__(self, spec):
            self.spec, self.read = spec, []

        def __getattr__(self, name):
            self.read.append(name)
            return getattr(self.spec, name)

    spec = Counting(mujoco.MjSpec.from_file(str(tmp_path / "many.xml")))
    files, lost = worker._reduced(mujoco, spec)
    assert len(files) == 20
    assert not lost
    assert spec.read.count("geoms") == 1
    assert spec.compile().nmesh == 20
