"""What drives carry: by lever arms, by MuJoCo's inverse dynamics, and against their limits."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.commands import answer, run

import cartstiff as cs

WEIGHT = 9.81
TWO = """
<robot name="two">
 <link name="g"/>
 <link name="a"><inertial><origin xyz="0.25 0 0"/><mass value="2"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
 <link name="b"><inertial><origin xyz="0.2 0 0"/><mass value="1.2"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
 <link name="tip"/>
 <joint name="s" type="revolute"><parent link="g"/><child link="a"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2" effort="30" velocity="2"/></joint>
 <joint name="e" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/>
  <axis xyz="0 1 0"/><limit effort="12" velocity="2"/></joint>
 <joint name="t" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0.4 0 0"/></joint>
</robot>
"""
Q = 0.2, 0.5


def lever_torques(q: tuple[float, float]) -> dict[str, float]:
    """Motor torques about y, which turn the links downwards, under weight and 80 N."""
    x = np.cos([q[0], q[0] + q[1]])
    elbow = 0.5 * x[0]
    down = {0.25 * x[0]: 2 * WEIGHT, elbow + 0.2 * x[1]: 1.2 * WEIGHT, elbow + 0.4 * x[1]: 80.0}
    shoulder = sum(arm * force for arm, force in down.items())
    beyond = sum((arm - elbow) * force for arm, force in list(down.items())[1:])
    return {"s": -shoulder, "e": -beyond}


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "two.urdf"
    path.write_text(TWO)
    return path


def arm(path, **more):
    setup = {"frame": "tip", "stiffness": 3000.0, "gravity": [0.0, 0.0, -WEIGHT]}
    return cs.load(str(path), **setup | more)


def loaded(elastic):
    return cs.analyse(elastic, Q, wrench=[0, 0, 0, 0, 0, -80], load_axes="world")


def test_torques_are_those_of_lever_arms(urdf):
    forces = {one.name: one for one in loaded(arm(urdf)).forces}
    for name, torque in lever_torques(Q).items():
        assert forces[name].force == pytest.approx(torque, rel=1e-12)
    assert list(forces) == ["s", "e"]  # the most loaded first
    assert forces["s"].used == pytest.approx(-forces["s"].force / 30.0)
    assert forces["e"].margin == pytest.approx(12.0 + forces["e"].force)
    idle = cs.analyse(arm(urdf, gravity=[0.0, 0.0, 0.0]), Q).forces
    assert [one.force for one in idle] == [0.0, 0.0]


def test_torques_at_the_equilibrium_are_those_of_its_posture(urdf):
    state = cs.equilibrium(arm(urdf), Q, cs.DeadForce(np.array([0.0, 0.0, -80.0])))
    for one in state.stiffness.forces:
        torque = lever_torques(tuple(state.q))[one.name]
        assert one.force == pytest.approx(torque, rel=1e-9)


def test_a_rigid_joint_carries_what_a_stiff_one_does(urdf):
    stiff, rigid = (
        {one.name: one.force for one in loaded(arm(urdf, stiffness={"s": k, "e": 3e3})).forces}
        for k in (1e5, np.inf)
    )
    assert rigid == pytest.approx(stiff, rel=1e-9)


@pytest.mark.parametrize("name", ["analyse", "equilibrium"])
def test_a_limit_that_is_passed_is_a_doubt(urdf, name):
    words = f"{name} {urdf} --frame tip --q 0.2,0.5 --stiffness 3000 --gravity 0,0,{-WEIGHT}"
    words += " --load 0,0,0,0,0,-80 --world"
    text = run(words)
    head = text.split("\nForces of the drives")[0]
    assert "torque of s is at -7" in head
    assert "Most loaded: s, 7" in head
    data = answer(words)
    codes = [doubt["code"] for doubt in data["answer"]["doubts"]]
    assert "force-limits" in codes
    assert [one["name"] for one in data["forces"]] == ["s", "e"]


def test_no_limit_is_said_once(urdf):
    urdf.write_text(TWO.replace("effort", "friction").replace("friction", "jerk"))
    words = f"analyse {urdf} --frame tip --q 0.2,0.5 --stiffness 3000"
    text = run(f"{words} --load 0,0,0,0,0,-80 --world")
    assert text.count("no limit of a drive's force is known") == 1


def test_effort_of_a_file_takes_the_place_of_the_robots(urdf, tmp_path):
    file = tmp_path / "two.yaml"
    lines = ["kind: serial", "model: two.urdf", "frame: tip"]
    lines += ["springs: {s: {stiffness: 3000}, e: {stiffness: 3000}}", "effort: {s: [-90, 5]}"]
    file.write_text("\n".join(lines))
    assert cs.load(str(file)).efforts == {"s": (-90.0, 5.0), "e": (-12.0, 12.0)}
    file.write_text(
        "\n".join([*lines[:3], "springs: {s: {stiffness: 3000}}", "passive: [e]", "effort: {e: 4}"])
    )
    with pytest.raises(cs.InputError, match="'e' moves freely: it has no drive"):
        cs.load(str(file))


def test_millimetres_change_a_limit_with_its_torque(urdf):
    from cartstiff.extend import in_units

    here, there = loaded(arm(urdf)), None
    there = cs.analyse(in_units(arm(urdf), "mm"), Q, wrench=[0, 0, 0, 0, 0, -80], load_axes="world")
    for one, other in zip(here.forces, there.forces, strict=True):
        assert other.used == pytest.approx(one.used)
        assert other.force == pytest.approx(1e3 * one.force)


MJCF = """
<mujoco><compiler angle="radian"/><worldbody><body name="a">
  <joint name="s" axis="0 1 0" actuatorfrcrange="-30 25"/>
  <geom type="capsule" fromto="0 0 0 .5 0 0" size=".02" mass="2"/>
  <body name="b" pos=".5 0 0"><joint name="e" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass="1.2"/>
    <site name="tip" pos=".4 0 0"/></body></body></worldbody>
  <actuator><motor joint="s" gear="100" forcerange="-0.5 0.2"/>
    <motor joint="e" gear="-6" forcerange="-1 2"/></actuator></mujoco>
"""


def test_mujoco_has_the_same_torques_and_limits(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    path = tmp_path / "two.xml"
    path.write_text(MJCF)
    elastic = arm(path)
    assert elastic.efforts == {"s": (-30.0, 20.0), "e": (-12.0, 6.0)}
    # What is commanded to a plain motor limits its force, too.
    path.write_text(MJCF.replace('forcerange="-0.5 0.2"', 'ctrlrange="-0.2 0.1"'))
    assert arm(path).efforts == {"s": (-20.0, 10.0), "e": (-12.0, 6.0)}
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[:] = Q
    mujoco.mj_forward(model, data)
    load = np.zeros(model.nv)
    at = data.site_xpos[0]
    mujoco.mj_applyFT(model, data, [0, 0, -80.0], np.zeros(3), at, 2, load)
    mujoco.mj_inverse(model, data)
    forces = {one.name: one.force for one in loaded(elastic).forces}
    assert [forces["s"], forces["e"]] == pytest.approx(data.qfrc_bias - load, rel=1e-8)


def test_shares_of_limits():
    from tests.doors import used_shares

    used = used_shares(
        np.array([0.0, 15.0, -15.0, 10.0, 100.0, 55.0, 3.0]),
        np.array([-30.0, -30.0, -10.0, 10.0, 10.0, 10.0, -np.inf]),
        np.array([30.0, 30.0, 40.0, 100.0, 100.0, 100.0, np.inf]),
    )
    assert used == pytest.approx([0.0, 0.5, 1.5, 1.0, 1.0, 0.0, np.nan], nan_ok=True)
