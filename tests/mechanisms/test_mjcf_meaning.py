"""What an MJCF file means is what MuJoCo says: posture, gravity, springs, ties, stiffness."""

import mujoco
import numpy as np
import pytest
from tests.inputs.mjcf_tool import SEEDS, verdict
from tests.support import (
    absolute_error,
    refused,
    relative_error,
)

from cartstiff import analyse, load
from cartstiff.extend import in_units

# Central differences of forces known to 1e-16: step^2 and 1e-16 / step, with margin.
STEP = 1e-6
#: N m/rad of a joint of which nothing is known.
ASSUMED = 1.0e4
DIFFERENCES = 1e-7

ARM = """<mujoco><compiler angle="radian"/><option gravity="0 0 {g}"/>
<default><geom type="capsule" size=".04"/><joint axis="0 1 0" {default}/></default>
<worldbody><body name="b1" pos="0 0 .3"><joint name="j1" axis="0 0 1" {one}/>
<geom fromto="0 0 0 0 0 .2"/>
<body name="b2" pos="0 0 .2" gravcomp="{lift}"><joint name="j2" {two}/><geom fromto="0 0 0 0 0 .4"/>
<body name="b3" pos="0 0 .4"><joint name="j3" {three}/><geom fromto="0 0 0 0 0 .35"/>
<body name="b4" pos="0 0 .35"><joint name="j4" axis="0 0 1"/><geom fromto="0 0 0 0 0 .1"/>
<body name="b5" pos="0 0 .1"><joint name="j5"/><geom fromto="0 0 0 .1 0 .1"/>
<body name="b6" pos=".1 0 .1"><joint name="j6" axis="1 0 0" {six}/><geom fromto="0 0 0 .1 0 0"/>
<site name="tcp" pos=".15 0 .02" euler=".1 .2 .3"/>{more}
</body></body></body></body></body></body></worldbody>{end}</mujoco>"""
PLAIN = {
    "g": "-9.81",
    "default": 'stiffness="1000"',
    "lift": "0",
    "one": "",
    "two": "",
    "three": "",
    "six": "",
    "more": "",
    "end": "",
}
FINGER = (
    '<body name="finger" pos=".1 .02 0"><joint name="f" type="slide" stiffness="50"/>'
    '<geom fromto="0 0 0 .05 0 0"/></body>'
)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """MuJoCo leaves a log of its warnings where it runs."""
    monkeypatch.chdir(tmp_path)


def arm(tmp_path, name="arm.xml", **changes):
    path = tmp_path / name
    path.write_text(ARM.format(**(PLAIN | changes)), encoding="utf-8")
    return path


def codes(elastic):
    return {note.code: note for note in elastic.notes}


# -- stiffness against finite differences of MuJoCo's forces --------------------------------------


class Held:
    """MuJoCo holds a site at a pose; the wrench that this takes, by its own forces."""

    def __init__(self, path, site, qpos):
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.data = mujoco.MjData(self.model)
        self.site = self.model.site(site).id
        self.qpos = np.array(qpos, float)

    def forward(self, q):
        self.data.qpos[:] = q
        mujoco.mj_forward(self.model, self.data)

    def pose(self):
        return (
            self.data.site_xmat[self.site].reshape(3, 3).copy(),
            self.data.site_xpos[self.site].copy(),
        )

    def jacobian(self):
        """Body Jacobian of the site, angular rows first."""
        linear, angular = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, linear, angular, self.site)
        R, _ = self.pose()
        return np.vstack([R.T @ angular, R.T @ linear])

    def torque(self):
        """Generalised force that must be applied to hold the posture: springs and weight."""
        return self.data.qfrc_bias - self.data.qfrc_passive

    def ties(self):
        """Jacobian and gap of the equality constraints."""
        rows = self.data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        J = np.zeros((self.data.nefc, self.model.nv))
        if self.data.nefc:
            J = self.data.efc_J.reshape(-1, self.model.nv)
        return J[rows], self.data.efc_pos[rows]

    def wrench(self):
        """W with J^T W + C^T lam = torque, by least squares; and what is left."""
        C, _ = self.ties()
        A = np.hstack([self.jacobian().T, C.T])
        found, *_ = np.linalg.lstsq(A, self.torque(), rcond=None)
        return found[:6], absolute_error(A @ found, self.torque())

    def moved(self, twist):
        """Newton's method to the site's pose after a body twist, ties closed; W there."""
        self.forward(self.qpos)
        R, p = self.pose()
        turn = np.linalg.norm(twist[:3])
        axis = np.zeros(9)
        quaternion = np.zeros(4)
        mujoco.mju_axisAngle2Quat(quaternion, twist[:3] / turn if turn else [0, 0, 1.0], turn)
        mujoco.mju_quat2Mat(axis, quaternion)
        # The twists used here are pure rotations or pure translations.
        R_goal, p_goal = R @ axis.reshape(3, 3), p + R @ twist[3:]
        q = self.qpos.copy()
        for _ in range(8):
            self.forward(q)
            R, p = self.pose()
            E = R.T @ R_goal
            error = np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]]) / 2
            C, gap = self.ties()
            A = np.vstack([self.jacobian(), C])
            goal = np.concatenate([error, R.T @ (p_goal - p), -gap])
            q = q + np.linalg.lstsq(A, goal, rcond=None)[0]
        self.forward(q)
        return self.wrench()[0]

    def stiffness(self):
        """dW along each body twist: K^A, column by column."""
        columns = [(self.moved(STEP * e) - self.moved(-STEP * e)) / (2 * STEP) for e in np.eye(6)]
        return np.stack(columns, axis=1)


@pytest.mark.parametrize("gravity", ["-9.81", "0"])
@pytest.mark.parametrize("which", ["springs everywhere", "compensated, references"])
def test_stiffness_of_arms_is_that_of_mujocos_forces(tmp_path, which, gravity):
    changes = {"g": gravity}
    if which != "springs everywhere":
        changes |= {
            "lift": "0.7",
            "one": 'stiffness="700 30 20" springref=".2"',
            "two": 'ref=".3"',
            "three": 'pos=".02 .01 0" springref="-.4" ref="-.1"',
        }
    path = arm(tmp_path, **changes)
    elastic = load(path, frame="tcp")
    q = np.array([0.3, -0.5, 0.9, 0.4, 0.7, -0.2])
    held = Held(path, "tcp", q)
    held.forward(q)
    wrench, rest = held.wrench()
    assert rest < 1e-9
    result = analyse(elastic, q)
    assert np.allclose(result.wrench, wrench, rtol=1e-9, atol=1e-9)
    K = held.stiffness()
    assert relative_error(result.matrices["A"], K) < DIFFERENCES


@pytest.mark.parametrize("field", [(0.0, 0.0, -1.62), (3.0, -2.0, 5.0), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("own", ["-9.81", "0"])
def test_gravity_compensation_follows_another_field(tmp_path, own, field):
    """Against MuJoCo's forces in that field, whatever field the file has; in other units, too."""
    path = arm(tmp_path, g=own, lift="0.7")
    q = np.array([0.3, -0.5, 0.9, 0.4, 0.7, -0.2])
    held = Held(path, "tcp", q)
    held.model.opt.gravity[:] = field
    held.forward(q)
    elastic = load(path, frame="tcp").with_gravity(field)
    wrench, _ = held.wrench()
    assert np.allclose(analyse(elastic, q).wrench, wrench, rtol=1e-9, atol=1e-9)
    found = analyse(in_units(elastic, "mm"), q).wrench
    assert np.allclose(found, wrench * np.repeat([1e3, 1.0], 3), rtol=1e-9, atol=1e-9)


def platform(tmp_path, gravity="-9.81", rest=0.0):
    """Six legs, all upright, on a free plate whose pose in the file is above and turned."""
    angles = np.radians([10, 110, 130, 230, 250, 350])
    top = np.radians([50, 70, 170, 190, 290, 310])
    height = 0.5
    legs, ties = "", ""
    for i, (a, t) in enumerate(zip(angles, top, strict=True)):
        foot = np.array([0.4 * np.cos(a), 0.4 * np.sin(a), 0.0])
        head = np.array([0.3 * np.cos(t), 0.3 * np.sin(t), height])
        length = np.linalg.norm(head - foot)
        z = (head - foot) / length
        legs += f"""<body name="hip{i}" pos="{foot[0]} {foot[1]} 0" zaxis="{z[0]} {z[1]} {z[2]}">
<joint name="a{i}" axis="1 0 0"/><joint name="b{i}" axis="0 1 0"/><geom type="sphere" size=".02"/>
<body name="rod{i}" pos="0 0 .1"><joint name="s{i}" type="slide" axis="0 0 1" stiffness="1e5"
springref="{rest}"/><geom type="capsule" size=".01" fromto="0 0 0 0 0 .2"/></body></body>"""
        ties += f"""<connect body1="rod{i}" body2="plate" anchor="0 0 {length - 0.1}"/>"""
    path = tmp_path / "platform.xml"
    path.write_text(
        f"""<mujoco><option gravity="0 0 {gravity}"/><worldbody>{legs}
<body name="plate" pos="0 0 {height}"><freejoint name="root"/>
<geom type="cylinder" size=".3 .02" mass="20"/><site name="tool" pos="0 0 .05"/></body></worldbody>
<equality>{ties}</equality></mujoco>""",
        encoding="utf-8",
    )
    return path


def test_a_stewart_platform_keeps_its_home_pose_and_its_stiffness_is_mujocos(tmp_path):
    path = platform(tmp_path, rest=0.01)
    elastic = load(path, frame="tool")
    result = analyse(elastic)
    assert np.allclose(result.pose[:3, 3], [0, 0, 0.55], atol=1e-12)
    held = Held(path, "tool", mujoco.MjModel.from_xml_path(str(path)).qpos0)
    # A free body's velocity is in six numbers, its position in seven: compare the wrench, and the
    # stiffness with the lines' own, known in closed form.
    held.forward(held.qpos)
    wrench, rest = held.wrench()
    assert rest < 1e-8
    assert np.allclose(result.wrench, wrench, rtol=1e-9, atol=1e-8)
    light = load(platform(tmp_path, "0"), frame="tool")
    expected = np.zeros((6, 6))
    for i in range(6):
        foot = held.data.body(f"hip{i}").xpos
        z = held.data.body(f"hip{i}").xmat.reshape(3, 3)[:, 2]
        line = np.concatenate([np.cross(foot - [0, 0, 0.55], z), z])
        expected += 1e5 * np.outer(line, line)
    K = analyse(light).matrices["B"]
    assert relative_error(K, expected) < 1e-9


LOOP = """<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0"/>
<default><joint axis="0 0 1"/><geom type="capsule" size=".02"/></default>
<worldbody><body name="crank" pos="-.15 0 0"><joint name="m1" stiffness="35" springref="2"/>
<geom fromto="0 0 0 .25 0 0"/><body name="coupler" pos=".25 0 0"><joint name="e1" stiffness="4"/>
<geom fromto="0 0 0 .3 0 0"/><site name="tip" pos=".5 .1 0"/></body></body>
<body name="rocker" pos=".15 0 0"><joint name="m2" stiffness="50"/><geom fromto="0 0 0 .25 0 0"/>
<body name="link" pos=".25 0 0"><joint name="e2"/><geom fromto="0 0 0 .3 0 0"/></body></body>
</worldbody><equality>{tie}</equality>
<keyframe><key name="other" qpos="0 0 0 0"/><key name="home" qpos="2.2 -1.35 .95 1.35"/></keyframe>
</mujoco>"""


# -- postures, gravity, springs --------------------------------------------------------------------


def test_the_home_keyframe_is_the_posture(tmp_path):
    keys = '<keyframe><key name="a" qpos="1 1 1 1 1 1"/>{}</keyframe>'
    home = '<key name="home" qpos=".1 .2 .3 .4 .5 .6"/>'
    first, named = (
        arm(tmp_path, "a.xml", end=keys.format("")),
        arm(tmp_path, "b.xml", end=keys.format(home)),
    )
    assert load(first, frame="tcp").q.tolist() == [1.0] * 6
    assert load(named, frame="tcp").q.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    assert "keyframe" in codes(load(named, frame="tcp"))
    assert "keyframe" not in codes(load(arm(tmp_path), frame="tcp"))


def test_gravity_is_the_files_and_is_said(tmp_path):
    elastic = load(arm(tmp_path, g="-3.7"), frame="tcp")
    assert elastic.gravity.tolist() == [0.0, 0.0, -3.7]
    assert codes(elastic)["gravity-of-file"].values["gravity"] == [0.0, 0.0, -3.7]
    for end in ("", '<option><flag gravity="disable"/></option>'):
        g = "-3.7" if end else "0"
        still = load(arm(tmp_path, g=g, end=end), frame="tcp")
        assert still.gravity is None
        assert "gravity-of-file" not in codes(still)


def test_a_mechanism_file_says_itself_what_gravity_acts(tmp_path):
    arm(tmp_path)
    path = tmp_path / "arm.yaml"
    path.write_text("kind: serial\nmodel: arm.xml\nframe: tcp\n")
    assert load(path).gravity is None
    assert "gravity-left-out" in codes(load(path))
    path.write_text("kind: serial\nmodel: arm.xml\nframe: tcp\ngravity: [0, 0, -1]\n")
    assert load(path).gravity.tolist() == [0, 0, -1]
    assert "gravity-left-out" not in codes(load(path))


def test_a_spring_on_a_finger_does_not_make_the_arm_limp(tmp_path):
    path = arm(tmp_path, default="", more=FINGER)
    hand = load(path, frame="tcp")
    assert hand.names == ("j1", "j2", "j3", "j4", "j5", "j6")
    assert set(hand.springs.stiffness) == {ASSUMED}
    finger = load(path, frame="finger")
    assert finger.springs.stiffness.tolist() == [ASSUMED] * 6 + [50.0]
    assert codes(finger)["stiffness-assumed"].values["joints"] == list(hand.names)


def test_coupled_and_held_joints(tmp_path):
    end = (
        '<equality><joint joint1="j3" joint2="j2" polycoef=".1 -2 0 0 0"/>'
        '<joint joint1="j4" polycoef=".4 0 0 0 0"/></equality>'
    )
    path = arm(tmp_path, two='ref=".3"', three='ref="-.2" springref=".5"', end=end)
    elastic = load(path, frame="tcp")
    assert elastic.names == ("j1", "j2", "j5", "j6")
    q = np.array([0.2, 0.7, -0.3, 0.4])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    # MuJoCo: q3 - ref3 = 0.1 - 2 (q2 - ref2); q4 - ref4 = 0.4.
    follower = -0.2 + 0.1 - 2 * (0.7 - 0.3)
    data.qpos[:] = [0.2, 0.7, follower, 0.4, -0.3, 0.4]
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[:2]).max() < 1e-14
    posture = elastic.mechanism.at(q)
    assert np.allclose(posture.pose[:3, 3], data.site("tcp").xpos, atol=1e-13)
    # The follower's spring works on its leader.
    gradient = elastic.evaluate(posture).gradient
    applied = data.qfrc_bias - data.qfrc_passive
    expected = [applied[0], applied[1] - 2 * applied[2], applied[4], applied[5]]
    assert np.allclose(gradient, expected, atol=1e-9)


def test_a_loop_stands_at_its_home_and_joints_without_springs_are_passive(tmp_path):
    path = tmp_path / "loop.xml"
    path.write_text(LOOP.format(tie='<connect body1="coupler" body2="link" anchor=".5 0 0"/>'))
    elastic = load(path, frame="tip")
    assert "'home'" in codes(elastic)["keyframe"].message
    assert codes(elastic)["passive-joints"].values["joints"] == ["e2"]


def test_ties_that_do_not_move_the_frame_leave_an_arm(tmp_path):
    loop = LOOP[LOOP.index('<body name="crank"') : LOOP.index("</worldbody>")]
    tie = '<equality><connect body1="coupler" body2="link" anchor=".5 0 0"/></equality>'
    text = arm(tmp_path).read_text().replace("</worldbody>", loop + "</worldbody>" + tie)
    path = tmp_path / "both.xml"
    path.write_text(text)
    elastic = load(path, frame="tcp")
    assert elastic.mechanism.kind == "serial"
    assert elastic.names == ("j1", "j2", "j3", "j4", "j5", "j6")
    assert "point tie" in codes(elastic)["ignored"].message
    loop_alone = load(path, frame="tip")
    assert loop_alone.mechanism.kind == "closed-chain"
    assert loop_alone.names == ("m1", "e1", "m2", "e2")
    file = tmp_path / "serial.yaml"
    file.write_text("kind: serial\nmodel: both.xml\nframe: tip\n")
    refused("point tie of bodies 'coupler' and 'link' acts on joint", load, file)


def test_masses_of_missing_meshes_are_named(tmp_path):
    mesh = '<geom type="mesh" mesh="shell"/>'
    end = '<asset><mesh name="shell" file="shell.stl"/></asset>'
    elastic = load(arm(tmp_path, more=mesh, end=end), frame="tcp")
    message = codes(elastic)["masses-unknown"].message
    assert "shell.stl" in message
    assert "'b6'" in message
    plain = load(arm(tmp_path, "plain.xml"), frame="tcp")
    assert np.allclose(elastic.mechanism.tree.masses()[0], plain.mechanism.tree.masses()[0])


def test_massless_bodies_are_served_and_named(tmp_path):
    path = tmp_path / "bare.xml"
    path.write_text(
        '<mujoco><worldbody><body name="a"><joint name="j"/><body name="b" pos="1 0 0"/></body>'
        "</worldbody></mujoco>"
    )
    refused("mjMINVAL", mujoco.MjModel.from_xml_path, str(path), kind=ValueError)
    elastic = load(path, frame="b")
    assert "'a'" in codes(elastic)["masses-unknown"].message or (
        "(a)" in codes(elastic)["masses-unknown"].message
    )
    assert elastic.mechanism.tree.masses()[0].tolist() == [0.0]


def test_legs_of_a_parallel_mechanism_bring_their_springs(tmp_path):
    arm(tmp_path, "leg.xml")
    path = tmp_path / "pair.yaml"
    path.write_text(
        "kind: parallel\nlegs:\n"
        "  - {model: leg.xml, frame: tcp, q: {j2: 0.5, j3: 0.6, j5: 0.4}}\n"
        "  - {model: leg.xml, frame: tcp, q: {j2: 0.5, j3: 0.6, j5: 0.4}}\n"
    )
    elastic = load(path)
    assert set(elastic.springs.stiffness) == {1000.0}
    assert "stiffness-assumed" not in codes(elastic)


# -- the reader ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(len(SEEDS)))
def test_whole_files_are_read_as_mujoco_reads_them(tmp_path, seed):
    path = tmp_path / "file.xml"
    path.write_text(SEEDS[seed])
    assert verdict(path) == ("same", "")
