"""Every command says where M is in its link: tool, `--tcp` and the file's offset alike."""

import numpy as np
import pytest
from tests.support.commands import answer, run

#: M in that of the file below, whose offset is (0.1, 0, 0) in the flange: together the tool.
TCP = "--tcp 0.0,0.02,0.3"
TOOL = "M at (100, 20, 300) mm in 'tool0'"
TOOL_POSE = [[1, 0, 0, 0.1], [0, 1, 0, 0.02], [0, 0, 1, 0.3], [0, 0, 0, 1]]
DOWN = "--load 0,0,0,0,0,-10"


@pytest.fixture
def folder(tmp_path):
    pytest.importorskip("example_robot_data")
    (tmp_path / "arm.yaml").write_text(
        "kind: serial\nmodel: ur5\nframe: tool0\noffset: {xyz: [0.1, 0, 0]}\n"
        "springs: {shoulder_lift_joint: {stiffness: '=1e4*a'}, elbow_joint: {stiffness: 1e4}, "
        "shoulder_pan_joint: {stiffness: 1e4}, wrist_1_joint: {stiffness: 1e4}, "
        "wrist_2_joint: {stiffness: 1e4}, wrist_3_joint: {stiffness: 1e4}}\n"
        "parameters: {a: 1.0}\n"
        "q: {elbow_joint: 1.4, shoulder_lift_joint: -1.1, wrist_2_joint: 0.9}\n"
    )
    (tmp_path / "study.yaml").write_text(
        "mechanism: arm.yaml\nvariables: {a: {values: [1.0, 2.0]}}\n"
        "objectives: {stiffness: {value: '=a', goal: largest}}\n"
    )
    (tmp_path / "path.csv").write_text(
        "x,y,z,roll,pitch,yaw\n0.3,0.3,0.2,3.1,0,0\n0.31,0.3,0.2,3.1,0,0\n"
    )
    (tmp_path / "data.csv").write_text(
        "shoulder_pan_joint,shoulder_lift_joint,elbow_joint,wrist_1_joint,wrist_2_joint,"
        "wrist_3_joint,mass,dx,dy,dz\n0,-1.1,1.4,-0.7,0.9,0.2,1,1e-4,2e-4,-5e-4\n"
        "0,-0.8,1.0,-0.7,0.9,0.2,2,2e-4,1e-4,-9e-4\n0,-1.2,0.6,-0.3,0.5,0.2,2,2e-4,1e-4,-8e-4\n"
    )
    (tmp_path / "commands.csv").write_text("0,-1.1,1.4,-0.7,0.9,0.2\n")
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        "analyse arm.yaml",
        f"equilibrium arm.yaml {DOWN}",
        "frames arm.yaml",
        "modes arm.yaml",
        f"map arm.yaml --grid elbow_joint=1:2:3 --quantity deflection {DOWN} -o m.zarr",
        "identify arm.yaml data.csv",
        f"path arm.yaml path.csv --criterion deflection {DOWN}",
        "design study.yaml",
    ],
    ids=lambda words: words.split()[0],
)
def test_arms(words, folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert TOOL in run(words, TCP)
    found = answer(words, TCP)
    assert found["frame"] == "tool0"
    assert np.allclose(found["frame_offset"], TOOL_POSE, atol=1e-12)


def test_reports(folder, monkeypatch):
    monkeypatch.chdir(folder)
    run("report arm.yaml", TCP, DOWN, "-o report.html")
    page = (folder / "report.html").read_text()
    assert "M is at (100, 20, 300) mm in tool0" in page


@pytest.mark.parametrize(
    "words",
    ["workspace hexapod --directions 20 --tcp 0,0,0.02", "assemble hexapod --all --tcp 0,0,0.02"],
)
def test_platforms(words):
    assert "body frame M at (0, 0, 20) mm in 'platform'" in run(words)
    found = answer(words)
    assert found["frame"] == "platform"
    assert np.allclose(np.array(found["frame_offset"])[:3, 3], [0, 0, 0.02])


def test_a_map_s_file_says_it(folder, monkeypatch):
    pytest.importorskip("xarray")
    from cartstiff.maps import open_map

    monkeypatch.chdir(folder)
    where = "--grid elbow_joint=1:2:3 --quantity translation_free_min"
    for name, tool in (("a.zarr", "0,0,0"), ("b.zarr", "0,0.02,0.3")):
        run("map arm.yaml", where, f"--tcp {tool} -o {name}")
    about = open_map("b.zarr").attrs
    assert np.allclose(np.reshape(about["frame_offset"], (4, 4)), TOOL_POSE)
    assert np.allclose(np.reshape(about["base_pose"], (4, 4)), np.eye(4))
