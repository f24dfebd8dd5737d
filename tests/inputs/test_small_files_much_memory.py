"""Small files that would take much memory or time are refused before they do, in one line."""

import json
import re
import resource
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from tests.support.robots import read_all_meshes, read_mesh

import cartstiff
from cartstiff import InputError

SOURCE = str(Path(cartstiff.__file__).parents[1])
#: Bytes that a process may take here: the libraries' code, and little more.
ROOM = 3 * 1024**3


def _chain(kind, count):
    head = "".join(
        f'<body name="b{i}" pos="0 0 .1"><joint name="j{i}" type="{kind}"/><geom size=".1"/>'
        for i in range(count)
    )
    return f"<mujoco><worldbody>{head}{'</body>' * count}</worldbody></mujoco>"


def _links(kind, count):
    parts = "".join(
        f'<link name="l{i + 1}"/><joint name="j{i}" type="{kind}"><parent link="l{i}"/>'
        f'<child link="l{i + 1}"/><origin xyz="0 0 .1"/></joint>'
        for i in range(count)
    )
    return f'<robot name="r"><link name="l0"/>{parts}</robot>'


def _tied(count):
    bodies = "".join(
        f'<body name="b{i}" pos="{i} 0 .1"><joint name="j{i}"/><geom size=".1"/></body>'
        for i in range(60)
    )
    ties = "".join(
        f'<connect body1="b{i % 60}" body2="b{(i + 7) % 60}" anchor="0 0 0"/>' for i in range(count)
    )
    return f"<mujoco><worldbody>{bodies}</worldbody><equality>{ties}</equality></mujoco>"


CASES = {
    "ball joints": ("arm.xml", _chain("ball", 199), "too many coordinates; expected at most 200"),
    "floating joints": ("arm.urdf", _links("floating", 80), "too many coordinates"),
    "planar joints": ("arm.urdf", _links("planar", 80), "too many coordinates"),
    "ties": ("arm.xml", _tied(1000), "too many equality constraints; expected at most 100"),
    "values": ("arm.yaml", f"kind: springs\nx: [{'1,' * 500_000}]\n", "too many values"),
}


#: Commands one after another in one small process: exit codes and what came out.
_REFUSE = """
import contextlib, io, json, sys
from cartstiff.shown.cli.main import main
found = []
for name in sys.argv[1:]:
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            main(["analyse", name])
        except SystemExit as end:
            found.append([end.code, out.getvalue(), error.getvalue()])
print(json.dumps(found))
"""


def test_much_from_little_is_refused(tmp_path):
    files = [f"{i}-{name}" for i, (name, _, _) in enumerate(CASES.values())]
    for file, (_, text, _) in zip(files, CASES.values(), strict=True):
        (tmp_path / file).write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", _REFUSE, *files],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
        env={"PYTHONPATH": SOURCE, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (ROOM, ROOM)),
    )
    found = dict(zip(CASES, json.loads(done.stdout), strict=True))
    for case, (_, _, words) in CASES.items():
        code, out, line = found[case]
        assert (code, out) == (2, ""), (case, line)
        assert words in line, case
        assert line.count("\n") == 1, case


def test_what_is_within_the_limits_is_read(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(_chain("hinge", 60))
    assert len(cartstiff.load(path).q) == 60


def test_as_many_hinges_as_may_be_take_little(tmp_path):
    """Postures keep poses and Jacobians: none has a workspace of 0.25 GB for itself."""
    (tmp_path / "arm.urdf").write_text(_links("continuous", 200))
    code = (
        "import cartstiff; from cartstiff.core.potentials.loads import DeadForce; "
        "elastic = cartstiff.load('arm.urdf'); "
        "kept = [elastic.mechanism.at(elastic.q + i) for i in range(5)]; "
        "cartstiff.equilibrium(elastic, DeadForce([1.0, 0.0, 0.0])); "
        # The peak of this program alone: ru_maxrss would hold what the tests' own process had.
        "status = open('/proc/self/status').read(); "
        "print(int(status.split('VmHWM:')[1].split()[0]) // 1024)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
        env={"PYTHONPATH": SOURCE, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    assert int(done.stdout) < 600


def _meshes(folder):
    found = {
        "m.off": b"OFF\n1000000000 1 0\n0 0 0\n",
        "c.off": b"OFF # x\n# y\n 7 900000000 0\n",
        "m.ply": b"ply\nformat ascii 1.0\nelement vertex 400000000\nproperty float x\nend_header\n",
        "m.stl": b" " * 80 + struct.pack("<I", 2**31) + b"\0" * 50,
        "m.glb": b"glTF",
        "m.xyz": b"0 0 0\n",
    }
    for name, data in found.items():
        (folder / name).write_bytes(data)
    with zipfile.ZipFile(folder / "m.zip", "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("m.stl", b"\0" * 10_000_000)
    (folder / "m.3mf").write_bytes((folder / "m.zip").read_bytes())
    return [folder / name for name in (*found, "m.zip", "m.3mf")]


def test_a_mesh_is_bounded_by_its_file(tmp_path):
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (16 * ROOM, before[1]))
    try:
        read = read_all_meshes(_meshes(tmp_path))
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert len(read) == 8
    for path, error in read.items():
        assert re.search("unknown kind of mesh|not a usable mesh", str(error)), path


def test_a_mesh_is_refused_by_its_size(tmp_path):
    path = tmp_path / "huge.stl"
    with path.open("wb") as file:
        file.truncate(65 * 1024 * 1024)
    with pytest.raises(InputError, match="file is too large; expected at most 67108864 bytes"):
        read_mesh(path)


def test_plain_meshes_are_read(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    paths = [tmp_path / f"box.{ending}" for ending in ("stl", "obj", "ply", "off")]
    for path in paths:
        trimesh.creation.box((1, 2, 3)).export(path)
    assert [len(mesh.faces) for mesh in read_all_meshes(paths).values()] == [12] * 4
