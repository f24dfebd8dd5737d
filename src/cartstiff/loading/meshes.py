"""Mesh files as arrays, read by a process of its own: vertices, triangles, normals, colours."""

from __future__ import annotations

import importlib.util
import stat
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff.child_process import answer_of
from cartstiff.errors import InputError, MissingDependencyError, one_line

#: Formats whose numbers are all in the file. Of the others some are packed, and some say how much
#: there is and leave it out.
_PLAIN = (".dae", ".stl", ".obj", ".ply", ".off")
_LARGEST = 64 * 1024 * 1024
# Meshes that are kept after their first reading.
_MOST_KEPT = 256


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with normals and colours.

    Attributes
    ----------
    positions : ndarray (n, 3) of float32
        In the file's unit as metres, unscaled.
    faces : ndarray (m, 3) of int32
        Indices of positions.
    normals : ndarray (n, 3) of int8
        Unit normals times 127.
    colours : ndarray (n, 3) of uint8, or None
        None where the whole mesh has `colour`, or the file says nothing.
    colour : tuple of 4 int, or None
        The one colour with opacity, 0 to 255; None where the file names none.
    """

    positions: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.int8]
    colours: NDArray[np.uint8] | None
    colour: tuple[int, int, int, int] | None


# By path, time of the last change, and size: a file that was changed is read again.
_KEPT: dict[tuple[Path, int, int], Mesh] = {}


def read_mesh(path: Path) -> Mesh:
    """Read a DAE, STL, OBJ, PLY or OFF file.

    Raises
    ------
    MissingDependencyError
        Without trimesh, or pycollada for a DAE.
    InputError
        For a file that is no mesh.
    """
    mesh = read_meshes([path])[path]
    if isinstance(mesh, InputError):
        raise mesh
    return mesh


def read_meshes(paths: Iterable[Path]) -> dict[Path, Mesh | InputError]:
    """Read several files at once: each as a mesh, or why it is none.

    Raises
    ------
    MissingDependencyError
        Without trimesh, or pycollada for a DAE.
    """
    read: dict[Path, Mesh | InputError] = {}
    wanted: list[tuple[Path, int, int]] = []
    for path in dict.fromkeys(paths):
        try:
            key = _checked(path)
        except InputError as error:
            read[path] = error
            continue
        if key in _KEPT:
            read[path] = _KEPT[key]
        else:
            wanted.append(key)
    if not wanted:
        return read
    where = one_line(wanted[0][0].name) + (f" and {len(wanted) - 1} others" * (len(wanted) > 1))
    try:
        answer = answer_of(
            str(Path(__file__).with_name("mesh_worker.py")),
            [[str(path.absolute()) for path, *_ in wanted]],
            where,
            "trimesh",
            {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )
        if "meshes" not in answer:
            got = answer.get("error", answer.get("missing"))
            raise InputError("meshes cannot be read", where=where, got=got)
    except InputError as error:
        return read | {path: error for path, *_ in wanted}
    start = 0
    for key, entry in zip(wanted, answer["meshes"], strict=True):
        if "error" in entry:
            place = one_line(key[0].name)
            read[key[0]] = InputError("not a usable mesh", where=place, got=entry["error"])
            continue
        read[key[0]] = mesh = _mesh(entry, answer.get("payload", b""), start)
        start += sum(array.nbytes for array in vars(mesh).values() if hasattr(array, "nbytes"))
        _KEPT[key] = mesh
    while len(_KEPT) > _MOST_KEPT:
        _KEPT.pop(next(iter(_KEPT)), None)
    return read


def _checked(path: Path) -> tuple[Path, int, int]:
    """What identifies a file that may be read as a mesh."""
    place, kind = one_line(path.name), path.suffix.lower()
    for package, name in (("trimesh", "trimesh"), ("collada", "pycollada")):
        if (package == "trimesh" or kind == ".dae") and not importlib.util.find_spec(package):
            raise MissingDependencyError(name, f"the mesh {place}")
    if kind not in _PLAIN:
        raise InputError(
            "unknown kind of mesh",
            where=place,
            expected=f"one of {', '.join(_PLAIN)}",
            got=kind,
        )
    try:
        status = path.stat()
    except OSError as error:
        raise InputError("file cannot be read", where=place, got=error.strerror) from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError("is not a regular file", where=place, expected="a file")
    if status.st_size > _LARGEST:
        raise InputError(
            "file is too large",
            where=place,
            expected=f"at most {_LARGEST} bytes",
            got=str(status.st_size),
        )
    return path, status.st_mtime_ns, status.st_size


def _mesh(entry: dict[str, Any], payload: bytes, start: int) -> Mesh:
    """A mesh from its sizes, and its arrays in the bytes from `start` on."""

    def array(count: int, kind: Any) -> NDArray[Any]:
        nonlocal start
        taken = np.frombuffer(payload, kind, 3 * count, start).reshape(-1, 3)
        start += taken.nbytes
        return taken

    n, m = entry["vertices"], entry["faces"]
    positions, faces = array(n, np.float32), array(m, np.int32)
    normals = array(n, np.int8)
    colours = array(n, np.uint8) if entry["coloured"] else None
    colour = None if entry["colour"] is None else tuple(entry["colour"])
    return Mesh(positions, faces, normals, colours, colour)
