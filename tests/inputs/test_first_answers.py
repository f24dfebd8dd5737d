"""What a user types on the first day: joints of an arm with soft links, other spellings, files."""

import tomllib

import numpy as np
import pytest
from tests.packaging.environment import ROOT
from tests.support.commands import answer, run

import cartstiff

LINKS = """kind: serial
model: ur5
frame: tool0
springs: {shoulder_pan_joint: {stiffness: 3.0e4}, shoulder_lift_joint: {stiffness: 3.0e4},
  elbow_joint: {stiffness: 2.0e4}, wrist_1_joint: {stiffness: 5.0e3},
  wrist_2_joint: {stiffness: 5.0e3}, wrist_3_joint: {stiffness: 4.0e3}}
flexible:
  upper_arm_link: {stiffness: [[4.0e4, 0, 0, 0, 0, 0], [0, 4.0e4, 0, 0, 0, 0],
    [0, 0, 4.0e4, 0, 0, 0], [0, 0, 0, 2.0e6, 0, 0], [0, 0, 0, 0, 2.0e6, 0], [0, 0, 0, 0, 0, 2.0e6]]}
"""
JOINTS = [0.3, -1.1, 1.4, -0.7, 0.9, 0.2]


@pytest.fixture
def soft(tmp_path):
    (path := tmp_path / "soft.yaml").write_text(LINKS)
    return path


def test_joints_alone_are_a_posture_of_an_arm_with_soft_links(soft, tmp_path):
    """Six numbers in --q, Python and tables: the same as all twelve with zeros."""
    arm = cartstiff.load(soft)
    whole = np.zeros(12)
    whole[[arm.names.index(name) for name in cartstiff.load("ur5").names]] = JOINTS
    wanted = answer("analyse", soft, "--analysis none", f"--q={','.join(map(str, whole))}")
    K = wanted["stiffness"]["B"]
    six = ",".join(map(str, JOINTS))
    found = answer("analyse", soft, "--analysis none", f"--q={six}")
    assert found["q"] == pytest.approx(wanted["q"], abs=1e-12)
    np.testing.assert_allclose(found["stiffness"]["B"], K, rtol=1e-9, atol=1e-4)
    python = cartstiff.analyse(arm, JOINTS).to_dict()
    np.testing.assert_allclose(python["stiffness"]["B"], K, rtol=1e-12)
    by_joint = f"--stiffness={','.join(['3e4', '3e4', '2e4', '5e3', '5e3', '4e3'])}"
    found = answer("analyse", soft, "--analysis none", f"--q={six}", by_joint)
    np.testing.assert_allclose(found["stiffness"]["B"], K, rtol=1e-9, atol=1e-4)
    # The compliance is that of the rigid arm and of the link in series: softer along each axis.
    rigid = answer("analyse ur5 --analysis none", f"--q={six}")["compliance"]["B"]
    assert np.linalg.eigvalsh(np.array(found["compliance"]["B"]) - rigid).min() > -1e-12
    refusal = run("analyse", soft, "--q=1,2,3", code=2)
    assert "6 numbers (shoulder_pan_joint, " in refusal


def test_a_path_of_an_arm_with_soft_links_takes_the_joints_that_a_user_knows(soft, tmp_path):
    """The commands are those of the joints, and undo what the load bends."""
    (table := tmp_path / "path.csv").write_text(",".join(map(str, JOINTS)))
    found = answer("equilibrium", soft, "--path", table, "--load 0,0,0,0,0,-100")
    assert len(found["springs"]) == 6
    assert np.abs(found["error_after"]).max() < 1e-9 < 1e-4 < np.abs(found["error_before"]).max()
    free = answer("equilibrium", soft, "--path", table, "--against all")
    assert np.abs(free["error_after"]).max() < 1e-12, "nothing acts: the posture is commanded"
    table.write_text(",".join(map(str, JOINTS + [0.0] * 6)))  # or is it a wrench?
    said = run("equilibrium", soft, "--path", table, "--load 0,0,0,0,0,-100", code=2)
    assert "numbers without names fit two layouts; expected a line of names" in said


def test_american_spelling():
    """A command is understood; in Python the name is told."""
    assert run("analyze ur5") == run("analyse ur5")
    with pytest.raises(AttributeError, match="'analyse'"):
        cartstiff.analyze  # noqa: B018
    with pytest.raises(AttributeError, match="nothing"):
        cartstiff.nothing  # noqa: B018


def test_the_extra_all_is_all_the_others_but_jax():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    extras = tomllib.loads(text)["project"]["optional-dependencies"]
    others = {one for name, extra in extras.items() if name not in ("all", "jax") for one in extra}
    assert set(extras["all"]) == others  # JAX, which is large, is asked for by its name


def test_missing_packages_are_named_with_what_to_do(tmp_path):
    """Of xacro, of meshes of a URDF, and the file that an MJCF file includes."""
    (xacro := tmp_path / "arm.xacro").write_text(
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:include filename="$(find maker_description)/urdf/x.xacro"/></robot>'
    )
    words = run("analyse", xacro, code=2)
    assert "folder maker_description (from the maker's repository)" in words
    assert "--package-path" in words
    (mjcf := tmp_path / "arm.xml").write_text(
        '<mujoco><include file="common/shared.xml"/><worldbody><body><joint/>'
        '<geom size="0.1"/></body></worldbody></mujoco>'
    )
    assert "expected common/shared.xml beside it" in run("analyse", mjcf, code=2)
    from tests.support.robots import visuals_of

    (urdf := tmp_path / "arm.urdf").write_text(
        '<robot name="a"><link name="base"/><link name="tip"><visual><geometry>'
        '<mesh filename="package://maker_description/meshes/x.stl"/></geometry></visual></link>'
        '<joint name="j" type="revolute"><parent link="base"/><child link="tip"/>'
        '<axis xyz="0 0 1"/><origin xyz="1 0 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    _, missing = visuals_of(cartstiff.load(urdf).mechanism)
    assert "maker_description is not found" in missing[0]
    assert "--package-path" in missing[0]


#: Joint origins of a UR20 as its maker prints them (DH): xyz, rpy of each joint in the one before.
UR20 = (
    ("0 0 0.2363", "0 0 0"),
    ("0 0 0", "1.5707963267948966 0 0"),
    ("-0.862 0 0", "0 0 0"),
    ("-0.7287 0 0.201", "0 0 0"),
    ("0 -0.1593 0", "1.5707963267948966 0 0"),
    ("0 0.1543 0", "1.5707963267948966 3.141592653589793 3.141592653589793"),
)


def urdf_of(origins):
    links = "".join(f'<link name="l{i}"/>' for i in range(len(origins) + 1))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
        '<limit lower="-6.28" upper="6.28" effort="1" velocity="1"/></joint>'
        for i, (xyz, rpy) in enumerate(origins, start=1)
    )
    return f'<robot name="arm">{links}{joints}</robot>'


def heights(origins, q):
    """Of the joints' origins, by products of matrices written here."""
    T, found = np.eye(4), []
    for (xyz, rpy), angle in zip(origins, q, strict=True):
        x, y, z = (float(word) for word in rpy.split())
        turn = np.eye(4)
        for axis, a in ((2, z), (1, y), (0, x)):  # fixed axes
            R, i, j = np.eye(4), (axis + 1) % 3, (axis + 2) % 3
            R[i, i] = R[j, j] = np.cos(a)
            R[i, j], R[j, i] = -np.sin(a), np.sin(a)
            turn = turn @ R
        turn[:3, 3] = [float(word) for word in xyz.split()]
        about = np.eye(4)
        about[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        T = T @ turn @ about
        found.append(T[2, 3])
    return np.array(found)


def test_the_default_posture_is_not_through_the_floor():
    """The elbow of a UR20 was 0.41 m below its base; an arm that hangs keeps its posture."""
    old = [0.3, 0.85, -1.45, -0.4, 0.85, -0.8]
    assert heights(UR20, old)[2] == pytest.approx(0.2363 - 0.862 * np.sin(0.85), abs=1e-9)
    arm = cartstiff.load(urdf_of(UR20))
    assert [note.code for note in arm.notes].count("default-posture") == 1
    assert heights(UR20, arm.q).min() >= -1e-9
    values = np.linalg.svd(arm.mechanism.at(arm.q).motion.jacobian)[1]
    assert values[-1] / values[0] > 0.02
    hung = [("0 0 0", "3.141592653589793 0 0"), *UR20[1:]]
    assert cartstiff.load(urdf_of(hung)).q.tolist() == old


def test_the_default_frame_is_no_finger_whatever_its_name():
    """Two jaws on one link at the end of an arm are a hand; one more joint in line is none."""
    jaw = (
        '<joint name="joint{0}" type="prismatic"><parent link="l6"/><child link="tip_{0}"/>'
        '<axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>'
        '<link name="tip_{0}"/>'
    )
    jaws = [jaw.format(i) for i in (7, 8)]
    text = urdf_of(UR20)
    hand = text.replace("</robot>", f"{jaws[0]}{jaws[1]}</robot>")
    assert cartstiff.load(hand).mechanism.frame == "l6"
    assert cartstiff.load(text.replace("</robot>", f"{jaws[0]}</robot>")).mechanism.frame == "tip_7"


PALM = (
    '<link name="palm"/><joint name="p" type="fixed"><parent link="l6"/>'
    '<child link="palm"/></joint>'
)


@pytest.mark.parametrize(
    "name",
    [
        "left_realsense_link",
        "l_hand_force_torque",
        "ankle_constraint_B_link",
        "closedloop2_A",
        "left-plantar-rod",
        "leftPinkyPitch1Link",
        "palm_collision",
    ],
)
def test_the_default_frame_is_no_camera_nor_a_part_of_a_linkage(name):
    """What hangs on the palm would be the frame that is deepest in the tree."""
    end = (
        f'<link name="{name}"/><joint name="{name}_j" type="fixed"><parent link="palm"/>'
        f'<child link="{name}"/></joint></robot>'
    )
    text = urdf_of(UR20).replace("</robot>", PALM + end)
    assert cartstiff.load(text).mechanism.frame == "palm"
    other = text.replace('"palm"', '"LArm_effector"')
    assert cartstiff.load(other).mechanism.frame == "LArm_effector"


def test_a_foot_beside_a_spring_is_no_finger():
    """An ankle branches as a hand does."""
    toes = "".join(
        f'<link name="{name}"/><joint name="{name}" type="revolute"><parent link="l6"/>'
        f'<child link="{name}"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for name in ("heel-spring", "foot-crank", "foot")
    )
    assert (
        cartstiff.load(urdf_of(UR20).replace("</robot>", f"{toes}</robot>")).mechanism.frame
        == "foot"
    )


def test_the_legs_of_a_floating_body_are_no_hand():
    """The six freedoms of a free body are no arm: pelvis and legs of four joints each."""
    leg = (
        '<body name="{0}_thigh" pos="0 {1} 0"><joint name="{0}_x" axis="1 0 0"/>'
        '<joint name="{0}_z" axis="0 0 1"/><joint name="{0}_y" axis="0 1 0"/>'
        '<geom size="0.1"/><body name="{0}_shin" pos="0 0 -0.4">'
        '<joint name="{0}_knee" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.4"/></body></body>'
    )
    text = (
        '<mujoco><worldbody><body name="torso" pos="0 0 1"><freejoint/><geom size="0.2"/>'
        f'<body name="pelvis"><joint name="waist" axis="0 0 1"/><geom size="0.1"/>'
        f"{leg.format('left', 0.1)}{leg.format('right', -0.1)}</body></body></worldbody></mujoco>"
    )
    assert cartstiff.load(text).mechanism.frame == "left_shin"


# An arm whose zero posture reaches below its base: shoulder at 0.4 m, forearm and wrist downwards.
DOWN = (
    ("0 0 0.4", "0 0 0"),
    ("0.1 0 0", "-1.5707963267948966 0 0"),
    ("0.6 0 0", "0 0 0"),
    ("0 0.6 0", "-1.5707963267948966 0 0"),
    ("0 0 0.2", "1.5707963267948966 0 0"),
    ("0 0.1 0", "-1.5707963267948966 0 0"),
)


def test_an_arm_that_reaches_down_at_zero_stays_above_its_floor():
    """Unless it hangs on a torso that has other limbs, or from a ceiling."""
    assert heights(DOWN, np.zeros(6)).min() == pytest.approx(0.4 - 0.6 - 0.2 - 0.1)
    assert heights(DOWN, cartstiff.load(urdf_of(DOWN)).q).min() >= -1e-9
    leg = (
        '<link name="leg"/><joint name="hip" type="revolute"><parent link="l0"/><child link="leg"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    torso = cartstiff.load(urdf_of(DOWN).replace("</robot>", leg))
    assert heights(DOWN, torso.q).min() < -0.1
    hung = [("0 0 -0.4", "3.141592653589793 0 0"), *DOWN[1:]]
    assert heights(hung, cartstiff.load(urdf_of(hung)).q).min() < -0.1


def test_a_declaration_after_a_comment_is_read():
    """Other readers of URDF pass over what comes before it."""
    late = f'\n<!-- made\n<?xml by?> -->\n<?xml version="1.0" encoding="utf-8"?>{urdf_of(UR20)}'
    assert cartstiff.load(late).names == cartstiff.load(urdf_of(UR20)).names
