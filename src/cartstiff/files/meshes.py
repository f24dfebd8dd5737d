"""Read mesh files to arrays in a process of its own: vertices, triangles, normals,
colours.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartstiff.core.errors import InputError, MissingDependencyError, one_line
from cartstiff.files.child_process import answer_of
from cartstiff.files.yaml_file import checked_status

#: Formats whose numbers are all in the file; others are packed, or may have wrong counts.
_PLAIN = (".dae", ".stl", ".obj", ".ply", ".off")
_LARGEST = 64 * 1024 * 1024
# Largest number of cached meshes.
_MAX_CACHED = 256
#: Arrays of a mesh.
_ARRAYS = ("positions", "faces", "normals", "colours")


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with normals and colours.

    Attributes
    ----------
    positions : ndarray (n, 3) of float32
        Unscaled numbers of the file, in metres.
    faces : ndarray (m, 3) of int32
        Indices of positions.
    normals : ndarray (n, 3) of int8
        Unit normals times 127.
    colours : ndarray (n, 3) of uint8, or None
        None where the whole mesh has `colour`, or the file has no colours.
    colour : tuple of 4 int, or None
        Colour of the whole mesh with opacity, 0 to 255; None without one.
    """

    positions: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.int8]
    colours: NDArray[np.uint8] | None
    colour: tuple[int, int, int, int] | None


# Meshes by path, time of the last change, and size, so that changed files are read again.
_CACHE: dict[tuple[Path, int, int], Mesh] = {}


def read_meshes(paths: Iterable[Path]) -> dict[Path, Mesh | InputError]:
    """Read DAE, STL, OBJ, PLY or OFF files at once: each as a mesh or an error.

    Raises
    ------
    MissingDependencyError
        Without trimesh, or pycollada for a DAE.
    """
    # Files that were read before, and have not changed, are in the cache.
    read: dict[Path, Mesh | InputError] = {}
    wanted: list[tuple[Path, int, int]] = []
    for path in dict.fromkeys(paths):
        try:
            key = _checked(path)
        except InputError as error:
            read[path] = error
            continue
        if key in _CACHE:
            read[path] = _CACHE[key]
        else:
            wanted.append(key)
    if not wanted:
        return read
    where = one_line(wanted[0][0].name) + (
        f" and {len(wanted) - 1} others" * (len(wanted) > 1)
    )
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
    arrays = np.load(io.BytesIO(answer["payload"]))
    for number, (key, entry) in enumerate(zip(wanted, answer["meshes"], strict=True)):
        if "error" in entry:
            place, got = one_line(key[0].name), entry["error"]
            read[key[0]] = InputError("not a usable mesh", where=place, got=got)
            continue
        own = {name: arrays.get(f"{number}.{name}") for name in _ARRAYS}
        colour = None if entry["colour"] is None else tuple(entry["colour"])
        read[key[0]] = _CACHE[key] = Mesh(**own, colour=colour)
    while len(_CACHE) > _MAX_CACHED:
        _CACHE.pop(next(iter(_CACHE)), None)
    return read


def _checked(path: Path) -> tuple[Path, int, int]:
    """Identity of a file that may be read as a mesh: path,
    time of the last change, size.
    """
    place, kind = one_line(path.name), path.suffix.lower()
    for package, name in (("trimesh", "trimesh"), ("collada", "pycollada")):
        if (package == "trimesh" or kind == ".dae") and not importlib.util.find_spec(
            package
        ):
            raise MissingDependencyError(name, f"the mesh {place}")
    if kind not in _PLAIN:
        raise InputError(
            "unknown kind of mesh",
            where=place,
            expected=f"one of {', '.join(_PLAIN)}",
            got=kind,
        )
    status = checked_status(path, _LARGEST, place)
    return path, status.st_mtime_ns, status.st_size
