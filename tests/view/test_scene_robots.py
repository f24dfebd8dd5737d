"""Robots in the picture: every piece of the file where Pinocchio has it, sticks where none is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from tests.support import robot_file
from tests.support.robots import visuals_of
from tests.view.viewer import Viewer, visualizer

import cartstiff
from cartstiff.scene import Appearance, RecordingWindow, Scene

MECHANISM = "/meshcat/cartstiff/mechanism"
# Positions go through single rotations in double precision.
ROUNDING = 1e-9


def drawn(elastic: Any, q: Any = None, **look: Any) -> tuple[Viewer, Scene, dict[str, Any]]:
    window = RecordingWindow()
    scene = Scene(visualizer(window), elastic)
    legend = scene.draw(cartstiff.analyse(elastic, q), Appearance(**look))
    return Viewer(window.snapshot()), scene, legend


def meshes(viewer: Viewer, below: str = MECHANISM) -> dict[str, str]:
    """Link names and paths of visible pieces (their places are called "number link")."""
    found = {}
    for path in viewer.below(below):
        last = path.rsplit("/", 1)[1]
        if last[0].isdigit():
            found[last.split(" ", 1)[1]] = path
    return found


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("ur5", "ur_description/urdf/ur5_robot.urdf"),
        ("panda", "panda_description/urdf/panda.urdf"),
        ("xarm7", "xarm_description/urdf/xarm7.urdf"),
    ],
)
def test_every_piece_is_where_pinocchio_has_it(name, file):
    path = robot_file(file)
    package = str(Path(path).parents[4])
    model = pin.buildModelFromUrdf(path)
    geometry = pin.buildGeomFromUrdf(
        model, path, pin.GeometryType.VISUAL, package_dirs=[package, str(Path(package) / "..")]
    )
    arm = cartstiff.load(name)
    rng = np.random.default_rng(3)
    q = arm.q + rng.uniform(-0.4, 0.4, len(arm.q))
    full = pin.neutral(model)
    for joint, value in zip(arm.names, q, strict=True):
        full[model.joints[model.getJointId(joint)].idx_q] = value
    data, places = model.createData(), geometry.createData()
    pin.forwardKinematics(model, data, full)
    pin.updateGeometryPlacements(model, data, geometry, places, full)
    viewer, scene, _ = drawn(arm, q)
    assert scene.notes == []
    found = meshes(viewer)
    assert len(found) == len(geometry.geometryObjects)
    for piece, T in zip(geometry.geometryObjects, places.oMg, strict=True):
        link = model.frames[int(piece.parentFrame)].name
        expected = T.homogeneous @ np.diag([*piece.meshScale, 1.0])
        np.testing.assert_allclose(viewer.world(found[link]), expected, atol=ROUNDING)


def test_a_snapshot_is_small():
    """All meshes of a UR5 in a message for a file: 2 MB before compression."""
    window = RecordingWindow()
    arm = cartstiff.load("ur5")
    robot_file("ur_description/urdf/ur5_robot.urdf")
    Scene(visualizer(window), arm).draw(cartstiff.analyse(arm))
    assert sum(map(len, window.snapshot())) < 2e6


URDF = """<robot name="r"><material name="blue"><color rgba="0 0 1 0.5"/></material>
<link name="base"><visual><geometry><box size="0.2 0.3 0.1"/></geometry></visual></link>
<link name="arm">
  <visual><origin xyz="0 0 0.2" rpy="0 1.5707963267948966 0"/>
    <geometry><cylinder radius="0.03" length="0.4"/></geometry><material name="blue"/></visual>
  <visual><geometry><sphere radius="0.05"/></geometry></visual>
  <visual><geometry><mesh filename="{mesh}" scale="2 1 1"/></geometry></visual>
</link>
<link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
  <origin xyz="0 0 0.1"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="push" type="prismatic"><parent link="arm"/><child link="tip"/>
  <origin xyz="0 0 0.4"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"


@pytest.mark.parametrize("place", ["beside", "absolute", "package", "file"])
def test_shapes_and_mesh_files_of_a_urdf(tmp_path, place):
    folder = tmp_path / "pack" / "urdf"
    folder.mkdir(parents=True)
    file = tmp_path / "pack" / "meshes" / "one.obj"
    file.parent.mkdir()
    file.write_text(OBJ, encoding="utf-8")
    name = {
        "beside": "../meshes/one.obj",
        "absolute": str(file),
        "package": "package://pack/meshes/one.obj",
        "file": f"file://{file}",
    }[place]
    (folder / "r.urdf").write_text(URDF.format(mesh=name), encoding="utf-8")
    arm = cartstiff.load(folder / "r.urdf")
    pieces, missing = visuals_of(arm.mechanism)
    assert missing == []
    box, cylinder, ball, mesh = pieces
    assert box.shape.sides == (0.2, 0.3, 0.1)
    assert (cylinder.shape.radius, cylinder.shape.length) == (0.03, pytest.approx(0.4))
    assert cylinder.colour == pytest.approx((0, 0, 1, 0.5))
    np.testing.assert_allclose(cylinder.at.T_j_f[:3, 2], [1, 0, 0], atol=ROUNDING)
    assert ball.shape.radii == (0.05,) * 3
    assert mesh.shape.path.resolve() == file.resolve()
    assert mesh.shape.scale == (2.0, 1.0, 1.0)
    assert [p.at.joint for p in pieces] == [0, 1, 1, 1]
    viewer, scene, _ = drawn(arm, [0.5, 0.1])
    assert scene.notes == []
    (path,) = (p for p in viewer.below(MECHANISM) if "/3 arm" in p)
    turned = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    M = viewer.world(path)
    np.testing.assert_allclose(M[:3, :3], turned @ np.diag([2, 1, 1]), atol=ROUNDING)
    np.testing.assert_allclose(M[:3, 3], [0, 0, 0.1], atol=ROUNDING)
    # No sticks beside what is drawn whole.
    assert not [p for p in viewer.below(MECHANISM) if "bone" in p or "knuckle" in p]


def test_a_missing_mesh_is_a_note_and_sticks(tmp_path):
    (tmp_path / "r.urdf").write_text(URDF.format(mesh="package://gone/m.stl"), encoding="utf-8")
    arm = cartstiff.load(tmp_path / "r.urdf")
    viewer, scene, legend = drawn(arm, [0.5, 0.1])
    assert "mesh package://gone/m.stl is missing" in scene.notes[0]
    assert legend["notes"] == scene.notes
    paths = viewer.below(MECHANISM)
    assert [p for p in paths if "bone" in p]
    # The slider runs from where the prismatic joint starts to where it is.
    (slider,) = (p for p in paths if "slider" in p)
    M = viewer.world(slider)
    start = np.array([0, 0, 0.5])
    along = 0.1 * np.array([np.cos(0.5), np.sin(0.5), 0])
    np.testing.assert_allclose(M[:3, 3], start, atol=ROUNDING)
    np.testing.assert_allclose(M[:3, 0], along, atol=ROUNDING)


@pytest.mark.parametrize("content", [b"solid nothing", b"\x00" * 200])
def test_an_unreadable_mesh_is_a_note(tmp_path, content):
    (tmp_path / "m.stl").write_bytes(content)
    (tmp_path / "r.urdf").write_text(URDF.format(mesh="m.stl"), encoding="utf-8")
    _, scene, _ = drawn(cartstiff.load(tmp_path / "r.urdf"))
    assert "link arm: m.stl: not a usable mesh" in scene.notes[0]


MJCF = """<mujoco><compiler angle="radian" meshdir="meshes"/>
<asset><mesh file="one.obj"/><mesh name="gone" file="gone.stl"/>
  <material name="red" rgba="1 0 0 1"/></asset>
<worldbody><geom type="plane" size="1 1 .1"/>
<body name="arm" pos="0 0 .1"><joint name="turn" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <geom type="capsule" fromto="0 0 0 0 0 .4" size=".04" material="red"/>
  <geom type="ellipsoid" size=".1 .05 .02" pos="0 .1 .2"/>
  <geom type="mesh" mesh="one"/>{gone}
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("gone", ["", '<geom type="mesh" mesh="gone"/>'])
def test_shapes_of_an_mjcf(tmp_path, gone):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "one.obj").write_text(
        OBJ + "v 0 0 1\nf 1 2 4\nf 2 3 4\nf 1 3 4\n", encoding="utf-8"
    )
    (tmp_path / "arm.xml").write_text(MJCF.format(gone=gone), encoding="utf-8")
    arm = cartstiff.load(tmp_path / "arm.xml", frame="arm")
    pieces, missing = visuals_of(arm.mechanism)
    assert missing == (["body arm: mesh gone.stl is missing"] if gone else [])
    capsule, ball, mesh = pieces
    assert (capsule.shape.radius, capsule.shape.length) == (0.04, pytest.approx(0.4))
    assert capsule.colour == (1.0, 0.0, 0.0, 1.0)
    np.testing.assert_allclose(capsule.at.T_j_f[:3, 3], [0, 0, 0.2], atol=ROUNDING)
    assert ball.shape.radii == pytest.approx((0.1, 0.05, 0.02))
    assert mesh.shape.path.name == "one.obj"
    viewer, _, _ = drawn(arm, [0.3])
    # A capsule is a cylinder and two balls.
    parts = [p for p in viewer.below(f"{MECHANISM}/joint 1") if "/0 arm" in p]
    assert len(parts) == 3


@pytest.mark.parametrize(
    "name", ["five-bar", "delta", "grasp", "3-rrr", "6-ups", "simple_humanoid"]
)
def test_mechanisms_without_meshes_are_stick_figures(name):
    """Bones meet: each starts or ends where a joint, a closure or the body frame is."""
    if name == "simple_humanoid":
        robot_file("simple_humanoid_description/urdf/simple_humanoid.urdf")
    elastic = cartstiff.load(name)
    viewer, scene, _ = drawn(elastic)
    assert scene.notes == []
    posture = elastic.mechanism.closed(elastic.q)
    tree = elastic.mechanism.tree
    known = [posture.pose[:3, 3]]
    data = tree.model.createData()
    q = elastic.q if tree.mimic is None else tree.mimic @ elastic.q + tree.offset
    pin.forwardKinematics(tree.model, data, np.asarray(q, float))
    known += [np.array(T.translation) for T in data.oMi]
    for c in elastic.mechanism.closures:
        known += [posture.relative("world", f)[0][:3, 3] for f in (c.frame_a, c.frame_b)]
    bones = [p for p in viewer.below(MECHANISM) if "/bone" in p or "/slider" in p]
    if name != "simple_humanoid":
        assert len(bones) >= 4
        for path in bones:
            M = viewer.world(path)
            for end in (M[:3, 3], M[:3, 3] + M[:3, 0]):
                nearest = min(float(np.linalg.norm(end - k)) for k in known)
                assert nearest < 1e-6 * scene._environment.size, path
    assert viewer.below(MECHANISM)


def test_flexible_links_are_bones_too():
    """The forearm of the delta robot ends at its wrist: 0.45 m after the elbow."""
    viewer, _, _ = drawn(cartstiff.load("delta"))
    lengths = [
        float(np.linalg.norm(viewer.world(p)[:3, 0]))
        for p in viewer.below(MECHANISM)
        if "/bone" in p
    ]
    assert sum(abs(length - 0.45) < 1e-9 for length in lengths) == 3


def test_a_ghost_is_a_second_robot():
    arm = cartstiff.load("five-bar")
    q = arm.mechanism.assembled([2.4, -1.35, 0.95, 1.35])
    viewer, _, _ = drawn(arm, quantity="compliance", ghost=tuple(q))
    other, _, _ = drawn(arm, q)
    ghost = "/meshcat/cartstiff/ghost"
    pale = [p for p in viewer.below(ghost) if "bone" in p]
    assert len(pale) >= 4
    for path in pale:
        np.testing.assert_allclose(
            viewer.world(path), other.world(path.replace(ghost, MECHANISM)), atol=ROUNDING
        )
        assert viewer.places[path].object["materials"][0]["opacity"] < 0.5
