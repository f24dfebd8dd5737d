"""Mesh files: every triangle is there, with its colour, and edges are where they are sharp."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.support import read_mesh, robot_file

from cartstiff import InputError
from cartstiff.core.errors import MissingDependencyError

UR5 = "ur_description/meshes/ur5/visual"
# Normals are rounded to 127 steps.
STEP = 1.5 / 127


def area(positions: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (np.asarray(positions, float)[faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")
@pytest.mark.filterwarnings("ignore:Setting the shape on a NumPy array:DeprecationWarning")
@pytest.mark.parametrize("name", ["forearm", "upperarm", "wrist1", "base"])
def test_collada_files_are_whole(name):
    """Against pycollada itself: number of triangles, their area, extent and diffuse colours."""
    collada = pytest.importorskip("collada")
    file = robot_file(f"{UR5}/{name}.dae")
    count, total, colours, points = 0, 0.0, set(), []
    scene = collada.Collada(file).scene
    for geometry in scene.objects("geometry"):
        for primitive in geometry.primitives():
            triangles = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
            positions, index = np.asarray(triangles.vertex), np.asarray(triangles.vertex_index)
            count += len(index)
            total += area(positions, index)
            points.append(positions[index.ravel()])
            diffuse = np.asarray(triangles.material.effect.diffuse[:3], float)
            colours.add(tuple(np.round(255 * diffuse).astype(int).tolist()))
    mesh = read_mesh(Path(file))
    assert len(mesh.faces) == count
    assert area(mesh.positions, mesh.faces) == pytest.approx(total, rel=1e-5)
    np.testing.assert_allclose(
        np.ptp(mesh.positions, axis=0), np.ptp(np.concatenate(points), axis=0), rtol=1e-5
    )
    assert mesh.colours is not None
    found = {tuple(c) for c in np.unique(mesh.colours, axis=0).astype(int).tolist()}
    # A colour may be truncated in place of rounded on the way.
    assert len(found) == len(colours)
    assert all(min(np.abs(np.subtract(c, f)).max() for f in found) <= 1 for c in colours)


def test_stl_against_its_bytes(tmp_path):
    """A binary STL has no colours; its triangles stand in the file one after the other."""
    file = Path(robot_file("xarm_description/meshes/xarm7/visual/link1.stl"))
    data = file.read_bytes()
    (count,) = struct.unpack_from("<I", data, 80)
    records = np.frombuffer(data, np.dtype([("n", "<3f4"), ("v", "<9f4"), ("a", "<u2")]), count, 84)
    mesh = read_mesh(file)
    assert len(mesh.faces) == count
    assert mesh.colours is None
    corners = mesh.positions[mesh.faces].reshape(count, 9)
    np.testing.assert_array_equal(corners, records["v"])


def exported(made, path):
    """A shape of trimesh as it is read from a file."""
    made.export(path)
    return read_mesh(path)


def test_flat_sides_keep_their_edges(tmp_path):
    """A cube has three normals at each corner, all along its axes."""
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    mesh = exported(box, tmp_path / "box.stl")
    corners = mesh.positions[mesh.faces].astype(float)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert len(mesh.faces) == 12
    assert np.array_equal(np.sort(np.abs(across), axis=1), np.tile([0.0, 0.0, 1.0], (12, 1)))
    expected = np.repeat(across[:, None], 3, axis=1)
    np.testing.assert_allclose(mesh.normals[mesh.faces] / 127, expected, atol=STEP)


def test_round_sides_are_smooth(tmp_path):
    """On a fine ball the normal at each corner points away from the centre."""
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(3, radius=2.0)
    mesh = exported(ball, tmp_path / "ball.stl")
    # The mean of five or six unequal triangles is not quite the radius.
    np.testing.assert_allclose(mesh.normals / 127, mesh.positions / 2.0, atol=0.03)


def test_obj_with_a_scale_of_its_own(tmp_path):
    file = tmp_path / "one.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n", encoding="utf-8")
    mesh = read_mesh(file)
    np.testing.assert_array_equal(np.sort(mesh.positions, axis=0)[-1], [1, 2, 0])
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 127]] * 3)


def test_what_is_no_mesh_is_refused(tmp_path):
    file = tmp_path / "broken.stl"
    file.write_bytes(b"solid nothing at all" * 3)
    with pytest.raises(InputError, match=r"broken\.stl: not a usable mesh"):
        read_mesh(file)


@pytest.mark.parametrize("package", ["trimesh", "collada"])
def test_missing_packages_are_named(package, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, package, None)
    named = {"trimesh": "trimesh", "collada": "pycollada"}[package]
    with pytest.raises(MissingDependencyError, match=rf"{named}.*pip install"):
        read_mesh(tmp_path / "some.dae")
