"""Reads mesh files; run as a script in a process of its own (`cartstiff.files.meshes`).

A mesh file from an unknown source may be packed, refer to other files, or have wrong
counts in its header. trimesh reads its triangles here from its bytes alone, without
images, and each file becomes one mesh with normals and a colour per vertex. (The viewer's
own reader loses parts of a Collada file with several geometries and materials.)
"""

from __future__ import annotations

import io
import re
import signal
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cartstiff.core import numerics
from cartstiff.files.child_process import read_regular, serve

#: Limits: bytes of a mesh and of an OBJ's materials; corners of triangles; seconds for
#: one mesh.
LARGEST = 64 * 1024 * 1024
_MAX_MATERIAL_BYTES = 1024 * 1024
MOST_CORNERS = 6_000_000
_SECONDS_FOR_ONE = 15
_MEGABYTES, _SECONDS = 3072, 60
#: Largest coordinate in metres.
_MAX_COORDINATE = 1e6
# Cosine of the largest angle between normals across an edge that is smoothed.
_SMOOTH_COSINE = np.cos(np.radians(35.0))
_GREY = (200, 200, 200, 255)
# Counts in a header: of elements of a PLY, in the first line of numbers of an OFF file.
_COUNTS = {
    ".ply": re.compile(rb"^\s*element\s+\w+\s+(\d+)", re.MULTILINE),
    ".off": re.compile(rb"^(?:\s*(?:#.*|C?O?N?OFF))*\s*(\d+)\s+(\d+)", re.MULTILINE),
}


class RefusedError(Exception):
    """A fault of a mesh file."""


def meshes(paths: list[str]) -> dict[str, Any]:
    """Return for each file its colour or an error, and the arrays of all as those of
    an NPZ file, each with the file's number before its name.
    """
    _refuse_images()
    entries: list[dict[str, Any]] = []
    arrays: dict[str, NDArray[Any]] = {}

    def late(*_: Any) -> None:
        raise RefusedError(f"more than {_SECONDS_FOR_ONE} s are needed")

    signal.signal(signal.SIGPROF, late)
    for number, path in enumerate(map(Path, paths)):
        signal.setitimer(signal.ITIMER_PROF, _SECONDS_FOR_ONE)
        try:
            colour, own = _mesh(path)
            entries.append({"colour": colour})
            arrays |= {f"{number}.{name}": array for name, array in own.items()}
        except RefusedError as error:
            entries.append({"error": str(error)})
        except MemoryError:
            entries.append({"error": "too much memory is needed"})
        except ModuleNotFoundError:
            raise
        except OSError as error:
            entries.append({"error": error.strerror or "it cannot be read"})
        except Exception as error:  # its message may quote the file
            entries.append({"error": type(error).__name__})
    signal.setitimer(signal.ITIMER_PROF, 0)
    packed = io.BytesIO()
    np.savez(packed, **arrays)  # type: ignore[arg-type]
    return {"meshes": entries, "payload": packed.getvalue()}


def _mesh(path: Path) -> tuple[Any, dict[str, NDArray[Any]]]:
    """Colour of a mesh, and its positions, faces, normals and colours."""
    import trimesh

    kind, data = path.suffix.lower(), read_regular(str(path), LARGEST)
    _check_contents(kind, data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pycollada uses NumPy's matrices
        scene = trimesh.load_scene(
            io.BytesIO(data),
            file_type=kind[1:],
            process=False,
            resolver=_Materials(path) if kind == ".obj" else None,  # type: ignore[arg-type]
        )
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    parts = [part for part in parts if len(part.faces)]
    if not parts:  # a scene may be empty
        if kind != ".dae":
            raise RefusedError("no triangles")
        nothing = np.zeros((0, 3), np.float32)
        return None, dict.fromkeys(("positions", "faces", "normals"), nothing)
    count = sum(3 * len(part.faces) for part in parts)
    if count > MOST_CORNERS:
        raise RefusedError(
            f"{count // 3} triangles, and at most {MOST_CORNERS // 3} are read"
        )
    triangles = [np.asarray(part.triangles, float).reshape(-1, 3) for part in parts]
    positions = np.concatenate(triangles) * _metres(scene, path)
    if not np.abs(positions).max() < _MAX_COORDINATE:  # or not a number
        raise RefusedError(f"coordinates that are not below {_MAX_COORDINATE:g} m")
    # One colour is that of the whole mesh; of several each corner has its own.
    colours = [_colour(part) for part in parts]
    if len({*colours}) == 1:
        return colours[0], _packed(positions, None)
    shades = [
        np.broadcast_to(np.array(colour or _GREY, np.uint8)[:3], own.shape)
        for colour, own in zip(colours, triangles, strict=True)
    ]
    return None, _packed(positions, np.concatenate(shades))


def _packed(
    corners: NDArray[Any], shades: NDArray[Any] | None
) -> dict[str, NDArray[Any]]:
    """Arrays of a mesh by the corners of its triangles, alike ones once."""
    positions = corners.astype(np.float32)
    normals = corner_normals(positions.astype(float))
    alike: list[NDArray[Any]] = [positions.view(np.int32), normals]
    alike += [] if shades is None else [shades]
    first, faces = _distinct(np.concatenate(alike, axis=1, dtype=np.int64))
    order = np.argsort(first)  # the order of the file compresses better
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    first, faces = first[order], rank[faces].reshape(-1, 3).astype(np.int32)
    arrays: dict[str, NDArray[Any]] = {"positions": positions[first], "faces": faces}
    arrays["normals"] = normals[first]
    return arrays if shades is None else arrays | {"colours": shades[first]}


def _refuse_images() -> None:
    """Replace the function that opens images by one that refuses them."""
    try:
        from PIL import Image
    except ImportError:
        return

    def refused(*_: Any, **__: Any) -> Any:
        raise OSError("images are not read")

    Image.open = refused


class _Materials:
    """Resolver of an OBJ's references: a list of materials beside it,
    and nothing else.
    """

    def __init__(self, path: Path) -> None:
        self.folder = path.parent

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def get(self, name: str) -> bytes:
        """Read a file of materials."""
        if not name.lower().endswith(".mtl"):
            raise KeyError(name)
        return read_regular(str(self.folder / name), _MAX_MATERIAL_BYTES)


def _check_contents(kind: str, data: bytes) -> None:
    """Refuse contents that could expand to more than the file's bytes."""
    if kind == ".dae":
        head = data[:1024].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
        plain = re.match(
            rb"<\?xml[^>]*encoding\s*=\s*.(utf-8|us-ascii|iso-8859-1|ascii)", head
        )
        if not head.startswith(b"<") or (
            b"encoding" in head.split(b">")[0] and not plain
        ):
            raise RefusedError("not XML as text in UTF-8")
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
            raise RefusedError("XML document types and entities are not supported")
    if data[:2] == b"PK" or zipfile.is_zipfile(io.BytesIO(data)):
        raise RefusedError("an archive")
    if kind in _COUNTS:
        counts = [
            int(n)
            for match in _COUNTS[kind].findall(data[:65536])
            for n in (match if isinstance(match, tuple) else (match,))
        ]
        if sum(counts) > len(data):
            raise RefusedError(
                f"a header that counts {sum(counts)} elements in {len(data)} bytes"
            )


def _metres(scene: Any, path: Path) -> float:
    """Metres per unit of a file; 1 without a unit."""
    if path.suffix.lower() != ".dae" or not scene.units:
        return 1.0
    import trimesh

    try:
        return float(trimesh.units.unit_conversion(scene.units, "meters"))
    except (KeyError, ValueError):
        return 1.0


def _colour(part: Any) -> tuple[int, int, int, int] | None:
    """Colour of a part; the mean where its vertices differ."""
    visual = part.visual
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    colour = visual.main_color if material is None else material.main_color
    r, g, b, a = (int(c) for c in np.asarray(colour)[:4])
    return r, g, b, a


def corner_normals(corners: NDArray[np.float64]) -> NDArray[np.int8]:
    """Return normals (3 m, 3), times 127, of triangle corners,
    averaged across smooth edges.

    The average at a corner is over the triangles around its point that edges of less than
    35 degrees join to its own.
    """
    from trimesh import graph as untyped

    graph: Any = untyped

    triangles = corners.reshape(-1, 3, 3)
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    sizes = np.linalg.norm(areas, axis=1, keepdims=True)
    units = np.divide(areas, sizes, out=np.zeros_like(areas), where=sizes > 0)
    extent = float(np.ptp(corners, axis=0).max()) or 1.0
    _, at = _distinct(
        np.round(corners / (numerics.NEGLIGIBLE_DISTANCE * extent)).astype(np.int64)
    )
    faces = at.reshape(-1, 3)
    pairs, edges = graph.face_adjacency(faces, return_edges=True)
    cosines = np.einsum("ij,ij->i", *(units[side] for side in pairs.T))
    pairs, edges = pairs[cosines > _SMOOTH_COSINE], edges[cosines > _SMOOTH_COSINE]
    # A smooth edge joins the corners at both its ends, each of one triangle to that of
    # the other.
    joined = [
        [3 * side + (faces[side] == end[:, None]).argmax(axis=1) for side in pairs.T]
        for end in edges.T
    ]
    fan = graph.connected_component_labels(np.hstack(joined).T, node_count=len(corners))
    around = np.repeat(areas, 3, axis=0)
    sums = np.stack([np.bincount(fan, weights=own) for own in around.T], axis=1)[fan]
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    normals = np.divide(sums, length, out=np.repeat(units, 3, axis=0), where=length > 0)
    return np.round(127 * normals).astype(np.int8)


def _distinct(rows: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index of the first of each distinct row, and the distinct row of each row.

    Rows are hashed to 64-bit numbers, which sort ten times as fast.
    """
    mixed = np.zeros(len(rows), np.uint64)
    for column in rows.T:
        mixed = (mixed ^ column.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    _, first, kind = np.unique(mixed, return_index=True, return_inverse=True)
    if not np.array_equal(
        rows[first][kind], rows
    ):  # two distinct rows have the same hash
        _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, kind.reshape(-1)


if __name__ == "__main__":
    serve(meshes, _MEGABYTES, _SECONDS)
