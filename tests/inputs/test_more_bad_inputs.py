"""What a user may get wrong with robots, units, ranges, collisions, maps: one clear line each."""

import numpy as np
import pytest
from tests.inputs.refusals import rows
from tests.mechanisms.machines import joint, write_urdf
from tests.support.commands import run

import cartstiff
from cartstiff.errors import InputError
from cartstiff.maps.run import prepare_map
from cartstiff.maps.sampling import Grid
from cartstiff.statics.command import commanded
from cartstiff.vibration.chatter import Milling

URDF = """<robot name='r'><link name='l0'/><link name='l1'/><link name='tool0'/>
<joint name='a' type='revolute'><parent link='l0'/><child link='l1'/><axis xyz='0 0 1'/>
<origin xyz='0 0 .4'/><limit lower='-2' upper='2' effort='1' velocity='1'/></joint>
<joint name='b' type='prismatic'><parent link='l1'/><child link='tool0'/><axis xyz='0 1 0'/>
<origin xyz='.3 .1 0'/><limit lower='-.2' upper='.5' effort='1' velocity='1'/></joint></robot>"""
XACRO = '<robot xmlns:xacro="http://ros.org/xacro" name="r">{}</robot>'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("bad")
    files = {
        "r.urdf": URDF,
        "seam.csv": "0.2,0.1,0.4,0,0,0\n",
        "q.csv": "a,b\n0.1,0.2\n",
        "words.csv": "a,b\nhere,there\n",
        "commas.csv": "0,1,0,2\n0,1,0,2\n0,5\n",
        "slip.csv": "a,bb\n1,2\n",
        "short.csv": "a,b\n1\n",
        "pose.csv": "x [furlong],y,z,roll,pitch,yaw\n1,2,3,0,0,0\n",
        "half.csv": "x,y,z,roll\n1,2,3,0\n",
        "pointer.urdf": "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12\n",
        "box_cables.xml": "<!DOCTYPE cables [<!ATTLIST cable_set id ID #REQUIRED>]>"
        "<cables default_cable_set='a'><cable_set id='a'/></cables>",
        "box_bodies.xml": "<links><link_rigid num='1' name='box'/></links>",
        "mesh.urdf": URDF.replace(
            "<link name='l1'/>",
            "<link name='l1'><collision><geometry><mesh filename='no.stl'/></geometry>"
            "</collision></link>",
        ),
        "base.yaml": "kind: serial\nmodel: r.urdf\nbase: {xyz: [1, 2]}\n",
        "turn.yaml": "kind: serial\nmodel: r.urdf\nbase: {xyz: [1, 2, 3], rpy: [0, 0]}\n",
        "tilt.yaml": "kind: serial\nmodel: r.urdf\nbase: {angle: 3}\n",
        "self.yaml": "kind: serial\nmodel: self.yaml\n",
        "m.zarr.txt": "no map",
        "asks.xacro": XACRO.format("<xacro:arg name='n' default='x'/><link name='$(arg m)'/>"),
        "finds.xacro": XACRO.format("<xacro:include filename='$(find nowhere)/x.xacro'/>"),
        "robot.sdf": "<sdf version='1.9'><model name='m'><link name='a'/></model></sdf>",
        "sdf.yaml": "kind: serial\nmodel: robot.sdf\n",
        "axis.xml": "<mujoco><worldbody><body><joint type='hinge' axis='0 0 0'/>"
        "<geom size='.1'/></body></worldbody></mujoco>",
        "round.yaml": "kind: stewart-gough\nlayout: {base: {radius: -1, half_angle: 0.3}, "
        "platform: {radius: 0.1, half_angle: 0.2}, height: 0.3}\nlegs: {stiffness: 1.0e+5}\n",
        "grad.csv": "x [mm],y [mm],z [m],roll [grad],pitch,yaw\n400,100,4,3,0,0.3\n",
        "ragged.csv": "x,y,z\n1,2,3\n1;2;3\n",
    }
    for name, text in files.items():
        (place / name).write_text(text, encoding="utf-8")
    return place


#: Words of the command, and words of the answer.
CASES = rows("odd inputs")


@pytest.mark.parametrize(("words", "expected"), rows("odd inputs"), ids=lambda x: str(x)[:60])
def test_one_clear_line(words, expected, folder, refused, monkeypatch):
    monkeypatch.chdir(folder)
    refused(words, words=(expected,))


TOO_LARGE = {
    "q of a platform": lambda: cartstiff.analyse(cartstiff.load("stewart-gough"), [1e300] * 6),
    "q of an arm": lambda: cartstiff.analyse(cartstiff.load("ur5"), [1e300] * 6),
    "q by name": lambda: cartstiff.analyse(cartstiff.load("ur5"), {"elbow_joint": 1e300}),
    "q of many": lambda: cartstiff.analyse_many(cartstiff.load("ur5"), [[1e300] * 6]),
    "wrench": lambda: cartstiff.analyse(cartstiff.load("ur5"), wrench=[1e300] * 6),
    "wrench of many": lambda: cartstiff.analyse_many(
        cartstiff.load("ur5"), [[0.1] * 6], wrench=[1e300] * 6
    ),
    "wrench of modes": lambda: cartstiff.modes(cartstiff.load("ur5"), wrench=[1e300] * 6),
    "wrench of a rest": lambda: cartstiff.equilibrium(cartstiff.load("ur5"), wrench=[1e300] * 6),
    "springs": lambda: cartstiff.load("ur5").with_springs([1e300] * 6),
}


@pytest.mark.parametrize("case", TOO_LARGE.values(), ids=TOO_LARGE)
def test_numbers_whose_products_overflow_are_refused(case):
    """The command line refuses them; Python must not answer NaN."""
    with pytest.raises(InputError, match=r"too large.*1e\+30"):
        case()


def test_a_number_for_all_joints_is_no_posture():
    with pytest.raises(InputError, match="6 numbers"):
        commanded(cartstiff.load("ur5"), {"elbow_joint": 0.1}, q=0.3)


def test_postures_of_many_are_a_copy():
    q = np.full((3, 6), 0.3)
    found = cartstiff.analyse_many(cartstiff.load("ur5"), q)
    assert np.array_equal(found.q, q)
    assert not np.shares_memory(found.q, q)


def test_a_port_that_does_not_exist_is_refused():
    with pytest.raises(InputError, match=r"99999999.*port"):
        cartstiff.show(cartstiff.load("ur5"), port=99999999)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"milling": Milling(6e8, 0.3, 3, 0.0, np.pi)}, "milling.*limiting_depth"),
        ({"damping": 0.02}, "damping.*damping_1"),
        ({"direction": [0, 0, 1]}, "direction.*along_free"),
        ({"deflect": [0, 0, 0, 0, 0, 1]}, "deflection.*deflection"),
    ],
)
def test_what_no_quantity_of_a_map_needs_is_refused(tmp_path, asked, words):
    elastic = cartstiff.load("ur5")
    grid = Grid({"elbow_joint": (0.5, 1.0, 3)}, elastic.names, elastic.q)
    with pytest.raises(InputError, match=words):
        prepare_map(elastic, grid, ["condition"], tmp_path / "m.zarr", **asked)


@pytest.mark.parametrize("option", ["--by nope", "--kind line"])
def test_options_of_pictures_need_a_picture(tmp_path, option):
    command = "map ur5 --grid elbow_joint=0.5:1:3 --quantity condition -o"
    assert "is for --picture" in run(command, tmp_path / "m.zarr", option, code=2)


def test_sensitivities_of_what_does_not_exist_are_no_table_of_nan(tmp_path):
    """An arm of two joints without masses: no K, no frequencies."""
    file = write_urdf(tmp_path, joint("j1", "base", "b"), joint("j2", "b", "c", (1, 0, 0)))
    out = run("analyse", file, "--sensitivities")
    assert "Sensitivities: none, as no stiffness matrix" in out
    assert "nan" not in out
