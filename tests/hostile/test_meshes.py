"""Mesh files of strangers: read by a process of its own, a bad one is a note and a placeholder."""

import os
import struct
import zipfile
import zlib

import pytest
from tests.support.memory import megabytes_of_children
from tests.support.robots import read_all_meshes, read_mesh
from tests.view.viewer import visualizer

import cartstiff
from cartstiff import InputError
from cartstiff.scene import RecordingWindow, Scene

READS_MESHES = """
from pathlib import Path
from cartstiff.files.meshes import read_meshes
def ask(paths):
    assert read_meshes([Path(path) for path in paths])
"""

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
COLLADA = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">
0 0 0 1 0 0 0 1 0</float_array><technique_common><accessor source="#a" count="3" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/>
</vertices><triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p>
</triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">
<node><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def picture(path, side=12000):
    """A PNG of one colour: a few hundred kilobytes that become half a gigabyte."""

    def chunk(kind, data):
        check = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + check

    packer = zlib.compressobj(1)
    rows = b"".join(packer.compress(bytes(1 + 3 * side)) for _ in range(side)) + packer.flush()
    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    """Files that are no meshes, by what is said of them."""
    folder = tmp_path_factory.mktemp("bad")
    files = {
        "nan.obj": (TRIANGLE.replace("1 0 0", "nan 0 0").encode(), "coordinates"),
        "inf.obj": (TRIANGLE.replace("1 0 0", "inf 0 0").encode(), "coordinates"),
        "far.obj": (TRIANGLE.replace("1 0 0", "1e300 0 0").encode(), "coordinates"),
        "entity.dae": (b'<!DOCTYPE a [<!ENTITY b "c">]>' + COLLADA[38:].encode(), "document type"),
        "utf7.dae": (b'<?xml version="1.0" encoding="utf-7"?>' + COLLADA[38:].encode(), "UTF-8"),
        "utf16.dae": (COLLADA.encode("utf-16"), "UTF-8"),
        "secret.obj": (b"v root:x:0:0:root 1 2\nf 1 1 1\n", ""),
        "passwords.stl": (b"root:x:0:0:root:/root:/bin/bash\n", ""),
        "counted.stl": (b" " * 80 + struct.pack("<I", 2**31) + bytes(50), ""),
        "empty.ply": (b"", ""),
    }
    for name, (data, _) in files.items():
        (folder / name).write_bytes(data)
    with zipfile.ZipFile(folder / "packed.dae", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.dae", COLLADA.encode() + b" " * 300_000_000)
    packed = (folder / "packed.dae").read_bytes()
    (folder / "both.dae").write_bytes(COLLADA.encode() + packed)
    os.mkfifo(folder / "pipe.stl")
    (folder / "zero.stl").symlink_to("/dev/zero")
    (folder / "memory.obj").symlink_to("/proc/self/mem")
    (folder / "folder.stl").mkdir()
    words = {name: said for name, (_, said) in files.items()}
    words |= {"packed.dae": "UTF-8", "both.dae": "an archive", "pipe.stl": "regular"}
    words |= {
        "zero.stl": "regular",
        "memory.obj": "",
        "folder.stl": "is a directory",
        "none.stl": "",
    }
    return {folder / name: said for name, said in words.items()}


def test_each_bad_mesh_is_refused_by_name_and_none_spoils_another(bad, tmp_path):
    good = tmp_path / "good.obj"
    good.write_text(TRIANGLE)
    read = read_all_meshes([*bad, good])
    assert read[good].positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    for path, words in bad.items():
        error = read[path]
        assert isinstance(error, InputError), path
        assert words in str(error), path
        assert path.name in str(error)
        assert "root:x" not in str(error)
    assert megabytes_of_children(READS_MESHES, [[*bad, good]]) < 700


def test_images_are_not_opened(tmp_path):
    """Textures of an OBJ and a PLY that would be half a gigabyte; colours of materials are read."""
    picture(tmp_path / "huge.png")
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 1 0 0\nmap_Kd huge.png\n")
    obj, ply = tmp_path / "m.obj", tmp_path / "m.ply"
    obj.write_text("mtllib m.mtl\nvt 0 0\nusemtl red\n" + TRIANGLE.replace("1 2 3", "1/1 2/1 3/1"))
    ply.write_text(
        "ply\nformat ascii 1.0\ncomment TextureFile huge.png\nelement vertex 3\nproperty float x\n"
        "property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 0 0\n0 1 0 0 0\n"
        "3 0 1 2\n"
    )
    assert len(read_mesh(ply).faces) == 1
    mesh = read_mesh(obj)
    assert len(mesh.faces) == 1
    assert mesh.colour is None or mesh.colour[:3] == (255, 0, 0)
    assert megabytes_of_children(READS_MESHES, [[ply], [obj]]) < 400


def test_a_mesh_that_was_changed_is_read_again(tmp_path):
    file = tmp_path / "m.obj"
    file.write_text(TRIANGLE)
    assert read_mesh(file).positions.max() == 1
    file.write_text(TRIANGLE.replace("1 0 0", "7 0 0") + "\n")
    assert read_mesh(file).positions.max() == 7


def robot(folder, meshes, more=""):
    file = folder / "arm.urdf"
    shapes = "".join(
        f"<{kind}><geometry>{mesh}</geometry></{kind}>"
        for mesh in meshes
        for kind in ("visual", "collision")
    )
    file.write_text(
        f"<robot name='r'><link name='a'/><link name='b'>{shapes}{more}</link><link name='c'/>"
        "<joint name='j' type='revolute'><parent link='a'/><child link='b'/>"
        "<limit lower='-1' upper='1' effort='1' velocity='1'/></joint><joint name='k' "
        "type='prismatic'><parent link='b'/><child link='c'/><origin xyz='1 0 0'/>"
        "<limit lower='-1' upper='1' effort='1' velocity='1'/></joint></robot>"
    )
    return file


@pytest.fixture(scope="module")
def shapes(tmp_path_factory):
    """A folder with a good mesh, read once, and bad ones."""
    folder = tmp_path_factory.mktemp("shapes")
    (folder / "nan.obj").write_text(TRIANGLE.replace("1 0 0", "nan 0 0"))
    (folder / "good.obj").write_text(TRIANGLE)
    os.mkfifo(folder / "pipe.stl")
    read_mesh(folder / "good.obj")
    return folder


@pytest.mark.parametrize(
    "shape",
    [
        "<mesh filename='nan.obj'/>",
        "<mesh filename='pipe.stl'/>",
        "<mesh filename='file:///etc/passwd'/>",
        "<mesh filename='file:///dev/zero'/>",
        "<mesh filename='package://../../etc/passwd'/>",
        "<mesh filename='http://localhost/x.stl'/>",
        "<mesh filename='good.obj' scale='nan 1 1'/>",
        "<mesh filename='good.obj' scale='1e300 1 1'/>",
        "<box size='nan 1 1'/>",
        "<cylinder radius='inf' length='1'/>",
        "<sphere radius='1e300'/>",
    ],
)
def test_a_bad_shape_is_a_note_and_a_placeholder(shapes, shape):
    arm = cartstiff.load(robot(shapes, ["<mesh filename='good.obj'/>", shape]))
    picture = Scene(visualizer(RecordingWindow()), arm)
    picture.draw(cartstiff.analyse(arm))
    assert picture.notes[0].startswith(("link b: ", "no picture of"))
    assert "sticks between the joints" in picture.notes[-1]
    assert cartstiff.analyse(arm).wrench.tolist() == [0.0] * 6


MJCF = (
    "<mujoco>{}<worldbody><body name='b'><joint name='j'/><geom size='.1'/>{}</body></worldbody>"
    "</mujoco>"
)


@pytest.mark.parametrize(
    "part",
    [
        "<include file='pipe'/>",
        "<include file='/dev/zero'/>",
        "<include file='/etc/passwd'/>",
        "<include file='../secret.txt'/>",
        "<include file='evil.xml'/>",
        "<include file='laughs.xml'/>",
        "<asset><model name='m' file='pipe'/></asset>",
        "<extension><plugin plugin='no.such.plugin'/></extension>",
        "<extension><plugin plugin='/tmp/evil.so'/></extension>",
        "<compiler meshdir='/dev'/><asset><mesh name='m' file='zero.stl'/></asset>",
        "<asset><mesh name='m' file='pipe.stl'/></asset>",
        "<asset><texture name='t' type='2d' file='huge.png'/><hfield name='h' file='pipe.png' "
        "size='1 1 1 1'/></asset>",
        "<asset><skin name='s' file='pipe.skn'/></asset>",
    ],
)
def test_an_mjcf_file_waits_for_nothing_and_tells_nothing(tmp_path, part):
    pytest.importorskip("mujoco")
    folder = tmp_path / "robot"
    folder.mkdir()
    (tmp_path / "secret.txt").write_text("sesame4711")
    (folder / "laughs.xml").write_text('<!DOCTYPE m [<!ENTITY a "b">]><mujoco>&a;</mujoco>')
    for name in ("pipe", "pipe.stl", "pipe.png", "pipe.skn"):
        os.mkfifo(folder / name)
    (folder / "huge.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    file = folder / "evil.xml"
    geom = "<geom type='mesh' mesh='m'/>" * ("<mesh" in part)
    file.write_text(MJCF.format(part, geom))
    try:
        words = " ".join(map(str, cartstiff.load(file).notes))
    except InputError as error:
        words = str(error)
    assert "sesame" not in words
    assert "root:x" not in words
    assert "does not come to an end" not in words
