"""Mesh files as arrays that a viewer draws whole: vertices, normals, colours.

The viewer's own reader loses parts of a Collada file with several geometries and materials; here
trimesh reads them all, and each file becomes one mesh with a colour per vertex.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff import numerics
from cartstiff.errors import InputError, imported
from cartstiff.geometry.se3 import Array
from cartstiff.loading.yaml_file import read_bytes
from cartstiff.scene import objects

# Edges sharper than this stay sharp; the surface is smooth across the others.
_SMOOTH = np.cos(np.radians(35.0))
_GREY = (200, 200, 200, 255)
# Formats whose numbers all stand in the file: it bounds what it can become. Of the others some are
# packed, and some say how much there is and leave it out.
_PLAIN = (".dae", ".stl", ".obj", ".ply", ".off")
_LARGEST = 64 * 1024 * 1024
_MOST_VERTICES = 6_000_000
# What a header may count: an element of a PLY, the first line of numbers of an OFF file.
_COUNTED = {
    ".ply": re.compile(rb"^\s*element\s+\w+\s+(\d+)", re.MULTILINE),
    ".off": re.compile(rb"^(?:\s*(?:#.*|C?O?N?OFF))*\s*(\d+)\s+(\d+)", re.MULTILINE),
}


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with normals and colours.

    Attributes
    ----------
    positions : ndarray (n, 3) of float32
        In the file's unit as metres, unscaled.
    faces : ndarray (m, 3) of int
        Indices of positions.
    normals : ndarray (n, 3) of int8
        Unit normals times 127.
    colours : ndarray (n, 3) of uint8, or None
        None where the whole mesh has `colour`, or the file says nothing.
    colour : tuple of 4 int, or None
        The one colour with opacity, 0 to 255; None where the file names none.
    """

    positions: NDArray[np.float32]
    faces: NDArray[np.intp]
    normals: NDArray[np.int8]
    colours: NDArray[np.uint8] | None
    colour: tuple[int, int, int, int] | None

    def geometry(self, coloured: bool = True) -> objects.Object:
        """As a three.js geometry."""
        colours = self.colours if coloured else None
        return objects.mesh(self.positions, self.faces, self.normals, colours)


@lru_cache(maxsize=128)
def read_mesh(path: Path) -> Mesh:
    """Read a DAE, STL, OBJ or other mesh file.

    Raises
    ------
    MissingDependencyError
        Without trimesh, or pycollada for a DAE.
    InputError
        For a file that is no mesh.
    """
    trimesh = imported("trimesh", "trimesh", "the mesh of a robot's link")
    if path.suffix.lower() == ".dae":
        imported("collada", "pycollada", f"the mesh {path.name}")
    _check_size(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pycollada uses NumPy's matrices
            scene = trimesh.load_scene(path, process=False)
            parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    except Exception as error:
        raise InputError("not a usable mesh", where=path.name, got=str(error)) from None
    parts = [part for part in parts if len(part.faces)]
    if not parts and path.suffix.lower() != ".dae":
        raise InputError("not a usable mesh", where=path.name, got="no triangles")
    if not parts:  # a scene may be empty: it shows nothing, as it says
        nothing = np.zeros((0, 3))
        return Mesh(
            nothing.astype(np.float32), nothing.astype(np.intp), nothing.astype(np.int8), None, None
        )
    corners_in_all = sum(3 * len(part.faces) for part in parts)
    if corners_in_all > _MOST_VERTICES:
        raise InputError(
            "mesh is too large",
            where=path.name,
            expected=f"at most {_MOST_VERTICES // 3} triangles",
            got=corners_in_all // 3,
        )
    factor = _metres(scene, path)
    colours = [_colour(part) for part in parts]
    known = {c for c in colours if c is not None}
    single = known.pop() if len(known) == 1 and None not in colours else None
    corners, shades = [], []
    for part, colour in zip(parts, colours, strict=True):
        triangles = np.asarray(part.triangles, float) * factor
        corners.append(triangles.reshape(-1, 3))
        shades.append(
            np.broadcast_to(np.array(colour or _GREY, np.uint8)[:3], (len(corners[-1]), 3))
        )
    positions = np.concatenate(corners).astype(np.float32)
    normals = corner_normals(positions.astype(float))
    several = single is None and any(c is not None for c in colours)
    alike: list[NDArray[Any]] = [positions.view(np.int32), normals]
    if several:
        alike.append(np.concatenate(shades))
    first, faces = _distinct(np.concatenate(alike, axis=1, dtype=np.int64))
    order = np.argsort(first)  # neighbours in the file stay neighbours, which packs better
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    first, faces = first[order], rank[faces.reshape(-1)].reshape(-1, 3)
    return Mesh(
        positions[first],
        faces,
        normals[first],
        np.concatenate(shades)[first] if several else None,
        single,
    )


def _check_size(path: Path) -> None:
    """Refuse what could become more than its bytes say."""
    kind = path.suffix.lower()
    if kind not in _PLAIN:
        raise InputError(
            "unknown kind of mesh",
            where=path.name,
            expected=f"one of {', '.join(_PLAIN)}",
            got=kind,
        )
    data = read_bytes(path, _LARGEST)
    if kind in _COUNTED:
        counts = [
            int(n)
            for match in _COUNTED[kind].findall(data[:65536])
            for n in (match if isinstance(match, tuple) else (match,))
        ]
        if sum(counts) > len(data):
            raise InputError(
                "not a usable mesh",
                where=path.name,
                got=(f"a header that counts {sum(counts)} elements in {len(data)} bytes"),
            )


def _metres(scene: Any, path: Path) -> float:
    """Metres per unit of a file that names its unit; others are taken as they are."""
    if path.suffix.lower() != ".dae" or not scene.units:
        return 1.0
    import trimesh

    try:
        return float(trimesh.units.unit_conversion(scene.units, "meters"))
    except (KeyError, ValueError):
        return 1.0


def _colour(part: Any) -> tuple[int, int, int, int] | None:
    """The one colour of a part; the mean where its vertices differ."""
    visual = part.visual
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    colour = visual.main_color if material is None else material.main_color
    r, g, b, a = (int(c) for c in np.asarray(colour)[:4])
    return r, g, b, a


def corner_normals(corners: Array) -> NDArray[np.int8]:
    """Normals of triangle corners (3 m, 3), times 127: averaged across edges that are not sharp.

    At each corner over the triangles that meet there and whose own normals are within 35 degrees.
    """
    triangles = corners.reshape(-1, 3, 3)
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    sizes = np.linalg.norm(areas, axis=1, keepdims=True)
    units = np.divide(areas, sizes, out=np.zeros_like(areas), where=sizes > 0)
    extent = float(np.ptp(corners, axis=0).max()) or 1.0
    _, at = _distinct(np.round(corners / (numerics.NEARBY * extent)).astype(np.int64))
    order = np.argsort(at, kind="stable")
    counts = np.bincount(at)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    # Corner by corner around each point: as many rounds as triangles meet in the busiest one. What
    # follows is in the order of the points; `take` is twice as fast as an index.
    face, size, start = order // 3, counts[at[order]], starts[at[order]]
    left, place = np.arange(len(order)), np.arange(len(order)) - start
    own, sums = units.take(face, axis=0), np.zeros_like(corners)
    for step in range(min(int(counts.max()), _MOST_AROUND)):
        if not (busy := size > step).all():
            size, start, place, left = size[busy], start[busy], place[busy], left[busy]
            own = own.compress(busy, axis=0)
        around = place + step
        around -= np.where(around >= size, size, 0)
        b = face.take(start + around)
        close = np.flatnonzero(np.einsum("ij,ij->i", own, units.take(b, axis=0)) > _SMOOTH)
        sums[left.take(close)] += areas.take(b.take(close), axis=0)
    total = np.empty_like(sums)
    total[order] = sums
    own = np.repeat(units, 3, axis=0)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normals = np.divide(total, length, out=own, where=length > 0)
    return np.round(127 * normals).astype(np.int8)


def _distinct(rows: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index of the first of each kind of row, and each row's kind.

    By a 64-bit number mixed from each row, which sorts ten times as fast as rows do.
    """
    mixed = np.zeros(len(rows), np.uint64)
    for column in rows.T:
        mixed = (mixed ^ column.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    _, first, kind = np.unique(mixed, return_index=True, return_inverse=True)
    if not np.array_equal(rows[first][kind], rows):  # two kinds got the same number
        _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, kind.reshape(-1)


# A fan with more triangles than this around one point is not averaged whole.
_MOST_AROUND = 64
