"""Xacro files, packages, names of robot_descriptions, XML text."""

import numpy as np
import pytest
from tests.support.robots import example_robot, example_robots, visuals_of

import cartstiff
from cartstiff import InputError
from cartstiff.core.errors import MissingDependencyError, UnknownNameError

pytest.importorskip("xacro")

SEGMENT = """
<robot xmlns:xacro="http://wiki.ros.org/xacro">
  <xacro:macro name="segment" params="i length">
    <link name="l${i}"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
      iyz="0"/></inertial><visual><geometry>
      <mesh filename="package://arm_description/meshes/rod.stl"/></geometry></visual></link>
    <joint name="j${i}" type="revolute"><parent link="l${i - 1}"/><child link="l${i}"/>
      <origin xyz="0 0 ${length}"/><axis xyz="${i % 2} ${1 - i % 2} 0"/>
      <limit lower="${radians(-170)}" upper="3" effort="1" velocity="1"/></joint>
  </xacro:macro>
</robot>"""
ARM = """
<robot xmlns:xacro="http://wiki.ros.org/xacro" name="arm">
  <xacro:arg name="kind" default="short"/>
  <xacro:include filename="$(find arm_description)/urdf/segment.xacro"/>
  <xacro:property name="config"
    value="${xacro.load_yaml('$(find arm_description)/config/$(arg kind).yaml')}"/>
  <link name="l0"/>
  <xacro:segment i="1" length="${config['length']}"/>
  <xacro:segment i="2" length="${config['length']}"/>
</robot>"""


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A ROS workspace with one package, whose folder has another name than the package."""
    top = tmp_path_factory.mktemp("workspace")
    package = top / "src" / "arm-repository"
    for name, text in {
        "package.xml": "<package format='3'><name>arm_description</name></package>",
        "urdf/arm.urdf.xacro": ARM,
        "urdf/segment.xacro": SEGMENT,
        "config/short.yaml": "length: 0.3",
        "config/long.yaml": "length: 0.9",
        "meshes/rod.stl": "solid a\nendsolid a\n",
    }.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text)
    return top


def reach(elastic):
    return float(elastic.mechanism.at(np.zeros(2)).pose[2, 3])


def test_a_xacro_file_loads_in_one_line(workspace):
    file = workspace / "src/arm-repository/urdf/arm.urdf.xacro"
    short = cartstiff.load(file)
    assert (short.name, short.names) == ("arm", ("j1", "j2"))
    assert reach(short) == 0.6
    assert short.mechanism.tree.coordinates[0].lower == pytest.approx(np.radians(-170))
    assert reach(cartstiff.load(file, xacro_args={"kind": "long"})) == 1.8
    shown, missing = visuals_of(short.mechanism)
    assert missing == []
    assert {v.shape.path.name for v in shown} == {"rod.stl"}


def test_a_mechanism_file_gives_the_arguments(workspace, tmp_path):
    file = tmp_path / "arm.yaml"
    file.write_text(
        f"kind: serial\nmodel: {workspace}/src/arm-repository/urdf/arm.urdf.xacro\n"
        "xacro: {kind: long}\n"
    )
    assert reach(cartstiff.load(file)) == 1.8
    assert reach(cartstiff.load(file, xacro_args={"kind": "short"})) == 0.6


def test_packages_are_found_where_ros_has_them(workspace, tmp_path, monkeypatch):
    """The entry file alone, away from its package."""
    text = "<?xml version='1.0'?>" + ARM
    file = tmp_path / "away" / "arm.urdf.xacro"
    file.parent.mkdir()
    file.write_text(text)
    with pytest.raises(InputError, match=r"package 'arm_description' is not found; .*--package"):
        cartstiff.load(file)
    assert reach(cartstiff.load(file, package_path=[workspace])) == 0.6
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{workspace / 'src'}")
    assert reach(cartstiff.load(file)) == 0.6
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    share = tmp_path / "install" / "share"
    share.mkdir(parents=True)
    (share / "arm_description").symlink_to(workspace / "src/arm-repository")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(share.parent))
    assert reach(cartstiff.load(file)) == 0.6
    (share / "arm_description").unlink()
    with pytest.raises(InputError, match="package 'arm_description' is not found"):
        cartstiff.load(file)
    (tmp_path / "install" / "arm_description").symlink_to(workspace / "src/arm-repository")
    file.write_text(text.replace("find arm_description", "find ../arm_description"))
    with pytest.raises(InputError, match=r"'../arm_description'"):
        cartstiff.load(file)


@pytest.mark.parametrize(
    ("text", "arguments", "words"),
    [
        (ARM, {"knid": "long"}, r"unknown xacro argument; .*closest: kind.*got 'knid'"),
        (ARM, {"kind": "wide"}, r"xacro: .*No such file.*wide.yaml.* in \$\{xacro.load_yaml"),
    ],
)
def test_what_is_wrong_is_one_line(workspace, text, arguments, words):
    file = workspace / "src/arm-repository/urdf/wrong.urdf.xacro"
    file.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        cartstiff.load(file, xacro_args=arguments)
    assert "\n" not in str(caught.value)
    assert "wrong.urdf.xacro" in str(caught.value)


def test_eval_has_the_arguments_by_name(tmp_path):
    """Numbers are numbers, texts texts, and truths truths."""
    (tmp_path / "arm.urdf.xacro").write_text(
        '<robot name="arm" xmlns:xacro="http://wiki.ros.org/xacro">'
        '<xacro:arg name="n" default="3"/><xacro:arg name="tool" default="none"/>'
        '<xacro:arg name="tall" default="true"/><link name="l0"/><link name="l1"/><link name="l2"/>'
        '<joint name="j1" type="continuous"><parent link="l0"/><child link="l1"/></joint>'
        '<xacro:property name="h" value="$(eval n * 0.25)"/>'
        """<xacro:if value="$(eval tall and tool == 'none')">"""
        '<joint name="j2" type="continuous"><parent link="l1"/><child link="l2"/>'
        '<origin xyz="0 0 ${h}"/></joint></xacro:if></robot>'
    )
    path = str(tmp_path / "arm.urdf.xacro")
    assert reach(cartstiff.load(path)) == 0.75
    assert reach(cartstiff.load(path, xacro_args={"n": "2"})) == 0.5
    with pytest.raises(InputError, match="not one tree"):
        cartstiff.load(path, xacro_args={"tool": "hand"})


def test_a_file_that_is_not_there_names_the_empty_arguments(tmp_path):
    head = '<robot name="arm" xmlns:xacro="http://wiki.ros.org/xacro">'
    (tmp_path / "arm.xacro").write_text(
        f'{head}<xacro:arg name="dof" default=""/><xacro:arg name="arm" default="gen"/>'
        '<xacro:include filename="$(arg dof)dof/$(arg arm).xacro"/></robot>'
    )
    with pytest.raises(InputError, match=r"No such file.*--xacro-arg NAME:=VALUE.*empty.*: dof$"):
        cartstiff.load(str(tmp_path / "arm.xacro"))
    (tmp_path / "macro.xacro").write_text(
        f'{head}<xacro:macro name="m" params="i"><link name="l${{i}}"/></xacro:macro></robot>'
    )
    with pytest.raises(InputError, match="defines macros and no robot; expected the file that"):
        cartstiff.load(str(tmp_path / "macro.xacro"))


def test_the_own_package_counts_and_a_second_one_is_named(workspace, tmp_path):
    """An old copy of the package under --package-path, with another length."""
    other = tmp_path / "old" / "arm_description"
    for name, text in {
        "package.xml": "<package><name>arm_description</name></package>",
        "urdf/segment.xacro": SEGMENT.replace("${length}", "${2 * length}"),
        "config/short.yaml": "length: 0.4",
    }.items():
        (other / name).parent.mkdir(parents=True, exist_ok=True)
        (other / name).write_text(text)
    file = workspace / "src/arm-repository/urdf/arm.urdf.xacro"
    arm = cartstiff.load(file, package_path=[other.parent])
    assert reach(arm) == 0.6
    (note,) = (note for note in arm.notes if note.code == "package-twice")
    assert note.values["folders"] == [str(file.parents[1]), str(other)]
    away = tmp_path / "away.urdf.xacro"
    away.write_text(file.read_text())
    assert reach(cartstiff.load(away, package_path=[other.parent])) == 1.6


def test_without_xacro_one_line_says_what_to_install(workspace, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'cartstiff\[xacro\]'"):
        cartstiff.load(workspace / "src/arm-repository/urdf/arm.urdf.xacro")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"package_path": "/nowhere"}, "--package-path: no such folder"),
        ({"package_path": [3]}, "no such folder"),
        ({"xacro_args": "kind:=long"}, "xacro_args is not a mapping"),
        ({"xacro_args": {"kind": "long"}}, "kind stewart-gough has no robot description"),
    ],
)
def test_keys_that_do_not_fit(keys, words):
    with pytest.raises(InputError, match=words):
        cartstiff.load("stewart-gough", **keys)


def test_arguments_belong_to_xacro_files(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text("<robot name='a'><link name='l'/></robot>")
    with pytest.raises(InputError, match=r"is no xacro file; expected no --xacro-arg, got kind"):
        cartstiff.load(file, xacro_args={"kind": "long"})


@pytest.fixture
def descriptions(tmp_path, monkeypatch, workspace):
    """A stand-in for robot_descriptions, with one robot in its cache and one that is not."""
    package = tmp_path / "site" / "robot_descriptions"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "_cache.py").write_text("raise SystemError('a download')")
    (package / "_repositories.py").write_text(
        "from types import SimpleNamespace as N\n"
        "REPOSITORIES = {'arm': N(cache_path='arm'), 'far': N(cache_path='far')}\n"
    )
    body = (
        "from os import path\nfrom ._cache import clone_to_cache\n"
        "REPOSITORY_PATH = clone_to_cache('{0}', commit=None)\n"
        "XACRO_PATH = path.join(REPOSITORY_PATH, 'urdf', 'arm.urdf.xacro')\n"
        "XACRO_ARGS = {{'kind': 'long'}}\n"
    )
    (package / "arm_description.py").write_text(body.format("arm"))
    (package / "far_description.py").write_text(body.format("far"))
    cache = tmp_path / "cache"
    cache.mkdir()
    (cache / "arm").symlink_to(workspace / "src/arm-repository")
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(cache))
    monkeypatch.syspath_prepend(str(package.parent))


@pytest.mark.usefixtures("descriptions")
def test_names_of_robot_descriptions():
    assert reach(cartstiff.load("arm_description")) == 1.8
    assert reach(cartstiff.load("arm_description", xacro_args={"kind": "short"})) == 0.6
    with pytest.raises(InputError, match=r"robot_descriptions pull far_description"):
        cartstiff.load("far_description")
    with pytest.raises(UnknownNameError, match="closest: far_description, arm_description"):
        cartstiff.load("amr_description")


def test_without_robot_descriptions(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match="robot_descriptions"):
        cartstiff.load("arm_description")


@pytest.mark.skipif(not example_robots(), reason="needs example-robot-data")
def test_xml_text_is_the_file():
    path = example_robot("ur5")
    text = cartstiff.load(path.read_text(), frame="tool0")
    file = cartstiff.load(path, frame="tool0")
    assert np.array_equal(
        cartstiff.analyse(text, file.q).B.matrix, cartstiff.analyse(file, file.q).B.matrix
    )


def test_xml_text_of_mjcf():
    pytest.importorskip("mujoco")
    text = (
        "<mujoco><worldbody><body><joint type='hinge' name='a' stiffness='5'/><geom size='1'/>"
        "</body></worldbody></mujoco>"
    )
    assert cartstiff.load(text).springs.stiffness.tolist() == [5.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot", "XML text: not valid XML"),
        ("<mujoco><none/></mujoco>", "XML text: not a usable MJCF"),
    ],
)
def test_texts_that_cannot_be_used(text, words):
    with pytest.raises(InputError, match=words):
        cartstiff.load(text)
